"""Nodes, elements and physical groups of a Gmsh mesh, and their conversion to mesh arrays.

Elements of the highest dimension become cells. Elements of one dimension less become tagged facets
if they are in physical groups.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import basix
import numpy as np
from dolfinx.io.utils import cell_perm_gmsh
from dolfinx.mesh import CellType

from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import MAX_COORDINATE
from pw_elements.meshes.connectivity import (
    check_consistent_nodes_of_cells,
    encode_rows_ignoring_order,
    match_cell_sides_to_facets,
)
from pw_elements.meshes.elements import GMSH_NUMBERS_OF_SUPPORTED_CELLS, gmsh_element_type
from pw_elements.meshes.tagged import MeshArrays, check_constant_z

_MAX_INT32_TAG = np.iinfo(np.int32).max
# Largest number of physical groups of one element; limits the memory that malicious files can use
_MAX_GROUPS_PER_ELEMENT = 100


class _ElementsOfOneType(NamedTuple):
    """Elements of one type: their numbers (n,), nodes (n, k) and indices of combinations (n,).

    A combination is the set of physical groups to which an element belongs.
    """

    numbers: Indices
    nodes: Indices
    combinations: Indices

    def select(self, rows: Mask | Indices) -> "_ElementsOfOneType":
        return _ElementsOfOneType(*(values[rows] for values in self))


class GmshMesh:
    """Mesh of Gmsh: nodes, elements of each type, and the physical groups of each element."""

    def __init__(self) -> None:
        self._node_numbers: list[Indices] = []
        self._coordinates: list[Array] = []
        self._elements: dict[
            int, list[_ElementsOfOneType]
        ] = {}  # by type; nodes are given by numbers
        self._combinations: list[tuple[int, ...]] = [()]
        self._combination_index: dict[tuple[int, ...], int] = {(): 0}
        self._names: dict[tuple[int, int], str] = {}

    def add_nodes(self, numbers: Indices, x: Array) -> None:
        """Add nodes with numbers (n,) and coordinates (n, 3)."""
        self._node_numbers.append(numbers)
        self._coordinates.append(x)

    def add_elements(
        self, type_number: int, numbers: Indices, nodes: Indices, group_combinations: Indices
    ) -> None:
        """Add elements of one type.

        Args:
            type_number: Gmsh's number of the element type.
            numbers: numbers (n,) of the elements.
            nodes: numbers (n, k) of their nodes.
            group_combinations: index (n,) of each element's combination of physical groups, as
                `find_or_add_group_combination` returned it.
        """
        self._elements.setdefault(type_number, []).append(
            _ElementsOfOneType(numbers, nodes, group_combinations)
        )

    def find_or_add_group_combination(self, groups: Iterable[int]) -> int:
        """Return the index of a combination of physical groups, which have the same dimension.

        If the combination does not exist yet, it is added.
        """
        combination = tuple(sorted(groups))
        if len(combination) > _MAX_GROUPS_PER_ELEMENT:
            raise ValueError(
                f"an element is in more than {_MAX_GROUPS_PER_ELEMENT} physical groups"
            )
        if combination and combination[-1] > _MAX_INT32_TAG:
            raise ValueError(f"physical group {combination[-1]}: numbers end at {_MAX_INT32_TAG}")
        if combination not in self._combination_index:
            self._combination_index[combination] = len(self._combinations)
            self._combinations.append(combination)
        return self._combination_index[combination]

    def add_group_name(self, dim: int, group: int, name: str) -> None:
        """Add the name of the physical group with a given dimension and number."""
        if (dim, group) in self._names:
            raise ValueError(f"physical group {group} of dimension {dim} has two names")
        self._names[dim, group] = name

    def make_mesh_arrays(self) -> tuple[MeshArrays, list[str]]:
        """Return the arrays of a mesh with tags of cells and facets, and messages for the log.

        The elements of the highest dimension that are in physical groups become cells. If none of
        them is in a group, all elements of the highest dimension become cells.

        Raises:
            ValueError: if numbers contradict each other, or the mesh is not supported.
        """
        numbers, x = self._join_and_sort_nodes()
        elements = self._join_element_blocks_by_type(numbers)
        dim = max(gmsh_element_type(kind).dim for kind in elements)
        if dim < 2:
            raise ValueError("it has no mesh of plane or solid cells: mesh it in Gmsh first")
        notes: list[str] = []
        type_number, elements_of_cells = self._select_grouped_cells_of_one_type(
            elements, dim, notes
        )
        _, cell, degree, n_nodes = gmsh_element_type(type_number)
        dolfinx_order = cell_perm_gmsh(CellType[cell], n_nodes)
        used_nodes, node_index = np.unique(
            elements_of_cells.nodes[:, dolfinx_order], return_inverse=True
        )
        cells = node_index.reshape(elements_of_cells.nodes.shape).astype(np.int64)
        check_consistent_nodes_of_cells(
            cells, cell, degree, elements_of_cells.numbers, numbers[used_nodes]
        )
        if dim == 2:
            check_constant_z("it", x[used_nodes])
        cell_tags, cell_names = self._assign_tags_to_group_combinations(
            dim, elements_of_cells.combinations, "cells", notes
        )
        facet_tags, facet_names = self._tag_facets(elements, cells, cell, used_nodes, notes)
        tags = {"cells": cell_tags[:, None], "facets": facet_tags}
        names = {"cells": cell_names, "facets": facet_names}
        x = np.ascontiguousarray(x[used_nodes, :dim])
        return MeshArrays((cell, degree), x, cells, tags, names), notes

    def _join_and_sort_nodes(self) -> tuple[Indices, Array]:
        """Return the numbers (n,) of all nodes in ascending order and their coordinates (n, 3)."""
        if not sum(map(len, self._node_numbers)):
            raise ValueError("it has no nodes: mesh it in Gmsh first")
        numbers, x = np.concatenate(self._node_numbers), np.concatenate(self._coordinates)
        ascending = np.argsort(numbers, kind="stable")
        numbers, x = numbers[ascending], x[ascending]
        if (is_repeated := np.diff(numbers) == 0).any():
            raise ValueError(f"it has node {numbers[is_repeated.argmax()]} twice")
        if numbers[0] < 0:
            raise ValueError(f"it has node {numbers[0]}: numbers are not negative")
        if (is_far := ~(np.abs(x) <= MAX_COORDINATE).all(axis=1)).any():
            position = ", ".join(f"{c:g}" for c in x[is_far.argmax()])
            raise ValueError(f"node {numbers[is_far.argmax()]} lies at ({position})")
        return numbers, x

    def _join_element_blocks_by_type(
        self, sorted_node_numbers: Indices
    ) -> dict[int, _ElementsOfOneType]:
        """Return the elements by type number, with indices instead of numbers of their nodes.

        Args:
            sorted_node_numbers: numbers (n,) of all nodes in ascending order.
        """
        elements = {}
        for type_number, blocks in self._elements.items():
            numbers, nodes, combinations = map(np.concatenate, zip(*blocks, strict=True))
            if not len(numbers):
                continue
            node_index = np.searchsorted(sorted_node_numbers, nodes)
            node_index[node_index == len(sorted_node_numbers)] = 0
            if (is_missing := sorted_node_numbers[node_index] != nodes).any():
                row = is_missing.any(axis=1).argmax()
                node = nodes[row][is_missing[row]][0]
                raise ValueError(f"element {numbers[row]} has the node {node}, which is not there")
            elements[type_number] = _ElementsOfOneType(numbers, node_index, combinations)
        if not elements:
            raise ValueError("it has no elements: mesh it in Gmsh first")
        element_numbers = np.sort(np.concatenate([block.numbers for block in elements.values()]))
        if (is_repeated := np.diff(element_numbers) == 0).any():
            raise ValueError(f"it has element {element_numbers[:-1][is_repeated][0]} twice")
        return elements

    def _select_grouped_cells_of_one_type(
        self, elements_by_type: dict[int, _ElementsOfOneType], dim: int, notes: list[str]
    ) -> tuple[int, _ElementsOfOneType]:
        """Return the type number of the cells, and the cells sorted by their lowest group number.

        Args:
            elements_by_type: elements by type number.
            dim: dimension of the cells.
            notes: list to which messages for the log are added.
        """
        cells = {
            type_number: block
            for type_number, block in elements_by_type.items()
            if gmsh_element_type(type_number).dim == dim
        }
        grouped = {type_number: block.combinations > 0 for type_number, block in cells.items()}
        n_grouped = sum(int(is_grouped.sum()) for is_grouped in grouped.values())
        if n_grouped:
            n_cells = sum(map(len, grouped.values()))
            if n_cells > n_grouped:
                n_omitted = n_cells - n_grouped
                notes.append(
                    f"{n_omitted} of {n_cells} cells are in no physical group, and left out"
                )
            cells = {
                type_number: cells[type_number].select(is_grouped)
                for type_number, is_grouped in grouped.items()
                if is_grouped.any()
            }
        description = " and ".join(
            f"{len(block.numbers)} {gmsh_element_type(type_number).describe()}"
            for type_number, block in cells.items()
        )
        if len(cells) > 1:
            raise ValueError(
                f"its cells are {description}, but a mesh has cells of one type: make all of them "
                "alike in Gmsh, or put those of one type into physical groups, and the others into "
                "another file"
            )
        ((type_number, selected),) = cells.items()
        if type_number not in GMSH_NUMBERS_OF_SUPPORTED_CELLS:
            raise ValueError(
                f"its cells are {description}: read are triangles, quadrilaterals, tetrahedra and "
                "hexahedra of degree 1 or 2 with all their nodes (in Gmsh: setOrder(2), and "
                "Mesh.SecondOrderIncomplete = 0)"
            )
        lowest_group = np.array([min(groups, default=0) for groups in self._combinations])
        selected = selected.select(np.argsort(lowest_group[selected.combinations], kind="stable"))
        return type_number, self._join_repeated_cells(selected)

    def _join_repeated_cells(self, cells: _ElementsOfOneType) -> _ElementsOfOneType:
        """Merge cells with equal nodes: files of format 2 list a cell once for each of its groups.

        Raises:
            ValueError: if cells with equal nodes have a group in common, or no group.
        """
        code = encode_rows_ignoring_order(cells.nodes)
        first_row, combinations = self._join_groups_of_equal_elements(code, cells.combinations)
        n_groups = np.array([max(1, len(groups)) for groups in self._combinations])
        n_stated = np.bincount(code, n_groups[cells.combinations])
        if (is_twice := n_stated[code[first_row]] != n_groups[combinations]).any():
            equal_rows = np.flatnonzero(code == code[first_row[is_twice.argmax()]])
            a, b = cells.numbers[equal_rows[:2]]
            raise ValueError(f"elements {a} and {b} have the same nodes")
        return _ElementsOfOneType(cells.numbers[first_row], cells.nodes[first_row], combinations)

    def _join_groups_of_equal_elements(
        self, element_codes: Indices, group_combinations: Indices
    ) -> tuple[Indices, Indices]:
        """Join the group combinations of elements with equal codes.

        Args:
            element_codes: codes (n,) of elements, equal for equal nodes.
            group_combinations: indices (n,) of the elements' group combinations.

        Returns:
            Two arrays (m,) with an entry for each distinct code: index of the first element with
            this code, in ascending order, and index of the combination of all groups of the
            elements with this code.
        """
        distinct_rows = np.unique(
            np.stack([element_codes, group_combinations]), axis=1, return_index=True
        )[1]
        distinct_rows = distinct_rows[np.lexsort((distinct_rows, element_codes[distinct_rows]))]
        code_start = np.flatnonzero(np.diff(element_codes[distinct_rows], prepend=-1))
        n_combinations = np.diff(code_start, append=len(distinct_rows))
        combination_of_code = group_combinations[distinct_rows[code_start]]
        for position in range(1, int(n_combinations.max(initial=0))):
            has_more = n_combinations > position
            pairs = np.stack(
                [
                    combination_of_code[has_more],
                    group_combinations[distinct_rows[code_start[has_more] + position]],
                ]
            )
            pairs, pair_index = np.unique(pairs, axis=1, return_inverse=True)
            unions = [
                self.find_or_add_group_combination({*self._combinations[a], *self._combinations[b]})
                for a, b in pairs.T
            ]
            combination_of_code[has_more] = np.array(unions)[pair_index.ravel()]
        by_row = np.argsort(distinct_rows[code_start])
        return distinct_rows[code_start][by_row], combination_of_code[by_row]

    def _assign_tags_to_group_combinations(
        self, dim: int, group_combinations: Indices, entity_kind: str, notes: list[str]
    ) -> tuple[LocalIndices, dict[str, tuple[int, ...]]]:
        """Return the tags (n,) of cells or facets, and the tags of each group by its name.

        Entities in no group have tag 0; the tag of entities in one group is the group's number.
        Combinations of several groups get tags that are larger than the groups' numbers.

        Args:
            dim: dimension of the entities.
            group_combinations: index (n,) of each entity's combination of groups.
            entity_kind: "cells" or "facets".
            notes: list to which messages for the log are added.
        """
        used_combinations, combination_index, n_entities = np.unique(
            group_combinations, return_inverse=True, return_counts=True
        )
        groups_of = [self._combinations[index] for index in used_combinations]
        next_tag = max((groups[-1] for groups in groups_of if groups), default=0) + 1
        tags, tags_of = [], dict[int, list[int]]()
        for groups in groups_of:
            tag = groups[0] if len(groups) == 1 else 0
            if len(groups) > 1:
                unnamed = [group for group in groups if (dim, group) not in self._names]
                if unnamed or next_tag > _MAX_INT32_TAG:
                    raise ValueError(
                        f"{entity_kind} are in the physical groups "
                        f"{', '.join(map(str, groups[:6]))} "
                        "at once: give all of these names and smaller numbers, or let none overlap"
                    )
                tag, next_tag = next_tag, next_tag + 1
            tags.append(tag)
            for group in groups:
                tags_of.setdefault(group, []).append(tag)
        if n_several := int(n_entities[[len(groups) > 1 for groups in groups_of]].sum()):
            notes.append(
                f"{n_several} {entity_kind} are in several physical groups at once, and have tags "
                f"above all groups' numbers: select them by name, with .{entity_kind}(name)"
            )
        names: dict[str, tuple[int, ...]] = {}
        for group in sorted(tags_of):
            if name := self._names.get((dim, group)):
                names[name] = (*names.get(name, ()), *tags_of[group])
        return np.array(tags, dtype=np.int32)[combination_index.ravel()], names

    def _tag_facets(
        self,
        elements_by_type: dict[int, _ElementsOfOneType],
        cells: Indices,
        cell_type: str,
        used_nodes: Indices,
        notes: list[str],
    ) -> tuple[LocalIndices, dict[str, tuple[int, ...]]]:
        """Return tags (cells, sides) of the cells' facets, and the tags of each group by its name.

        Args:
            elements_by_type: elements by type number.
            cells: indices (cells, k) of the cells' nodes in `used_nodes`, in DOLFINx' order.
            cell_type: type of the cells, such as "triangle".
            used_nodes: indices of the nodes of cells, in ascending order.
            notes: list to which messages for the log are added.
        """
        topology = basix.topology(basix.CellType[cell_type])
        dim, n_corners = len(topology) - 1, len(topology[-2][0])
        tags = np.zeros((len(cells), len(topology[-2])), dtype=np.int32)
        corners: list[Indices] = [np.empty((0, n_corners), dtype=np.int64)]
        combinations: list[Indices] = [np.empty(0, dtype=np.int64)]
        n_grouped = 0
        for type_number, block in elements_by_type.items():
            if (
                gmsh_element_type(type_number).dim == dim - 1
                and (is_grouped := block.combinations > 0).any()
            ):
                n_grouped += int(is_grouped.sum())
                block = block.select(is_grouped & np.isin(block.nodes, used_nodes).all(axis=1))
                if gmsh_element_type(type_number).n_corners == n_corners:
                    corners.append(
                        np.searchsorted(used_nodes, block.nodes[:, :n_corners]).astype(np.int64)
                    )
                    combinations.append(block.combinations)
        if not n_grouped:
            return tags, {}
        facet_corners, combination = np.concatenate(corners), np.concatenate(combinations)
        code = encode_rows_ignoring_order(facet_corners)
        first_row, facet_combinations = self._join_groups_of_equal_elements(code, combination)
        cell_index, side, facet = match_cell_sides_to_facets(
            cells, cell_type, facet_corners[first_row]
        )
        found_facets, facet_position = np.unique(facet, return_inverse=True)
        if n_omitted := n_grouped - int(np.isin(code, code[first_row[found_facets]]).sum()):
            notes.append(
                f"{n_omitted} of {n_grouped} elements of dimension {dim - 1} in physical groups "
                "are no facets of the cells, and left out"
            )
        facet_tags, names = self._assign_tags_to_group_combinations(
            dim - 1, facet_combinations[found_facets], "facets", notes
        )
        tags[cell_index, side] = facet_tags[facet_position]
        return tags, names


def read_gmsh_model(model: Any) -> GmshMesh:  # noqa: ANN401
    """Read nodes, elements and physical groups from Gmsh's model.

    Raises:
        ValueError: if Gmsh is not initialised, or for elements of an unknown type.
    """
    mesh = GmshMesh()
    try:
        numbers, x, _ = model.mesh.getNodes()
        entity_elements = []
        for dim, entity in model.getEntities():
            entity_groups = model.getPhysicalGroupsForEntity(dim, entity)
            entity_elements.append((entity_groups, model.mesh.getElements(dim, entity)))
        named_groups = [
            (*group, model.getPhysicalName(*group)) for group in model.getPhysicalGroups()
        ]
    except Exception as error:  # Gmsh raises plain Exception
        message = f"Gmsh says '{error}'; call gmsh.initialize() and make a model first"
        raise ValueError(message) from error
    mesh.add_nodes(numbers.astype(np.int64), x.reshape(-1, 3))
    for entity_groups, (type_numbers, element_numbers, nodes) in entity_elements:
        combination = mesh.find_or_add_group_combination({*map(int, entity_groups)})
        for type_number, numbers_of_type, node_numbers in zip(
            type_numbers, element_numbers, nodes, strict=True
        ):
            shape = len(numbers_of_type), gmsh_element_type(type_number).n_nodes
            mesh.add_elements(
                int(type_number),
                numbers_of_type.astype(np.int64),
                node_numbers.astype(np.int64).reshape(shape),
                np.full(len(numbers_of_type), combination),
            )
    for dim, group, name in named_groups:
        if name:
            mesh.add_group_name(dim, group, name)
    return mesh

"""Nodes, elements and physical groups of a mesh of Gmsh, from a file or a model.

Elements of the highest dimension are cells, those of one less in groups are facets with tags.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import basix
import numpy as np
from dolfinx.io.utils import cell_perm_gmsh
from dolfinx.mesh import CellType

from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import MAX_COORDINATE
from pw_elements.meshes.connectivity import check_nodes_of_cells, encode_rows, find_facets
from pw_elements.meshes.elements import CELL_TYPES, kind_of
from pw_elements.meshes.tagged import MeshArrays, check_plane

_MAX_TAG = np.iinfo(np.int32).max
# Groups that have one element; more would be no mesh, but a way to exhaust memory
_MAX_GROUPS = 100


class _Elements(NamedTuple):
    """Numbers (n,), nodes (n, k) and combinations of groups (n,) of elements of one type."""

    numbers: Indices
    nodes: Indices
    combinations: Indices

    def select(self, which: Mask | Indices) -> "_Elements":
        return _Elements(*(values[which] for values in self))


class GroupedMesh:
    """Nodes, elements by type, and the combination of groups that each element is in."""

    def __init__(self) -> None:
        self._numbers: list[Indices] = []
        self._x: list[Array] = []
        self._elements: dict[int, list[_Elements]] = {}  # by type, with numbers of nodes
        self._combinations: list[tuple[int, ...]] = [()]
        self._index: dict[tuple[int, ...], int] = {(): 0}
        self._names: dict[tuple[int, int], str] = {}

    def add_nodes(self, numbers: Indices, x: Array) -> None:
        """Add nodes with numbers (n,) at x (n, 3)."""
        self._numbers.append(numbers)
        self._x.append(x)

    def add_elements(
        self, kind: int, numbers: Indices, nodes: Indices, combinations: Indices
    ) -> None:
        """Add elements of one type: numbers (n,), numbers of nodes (n, k), combinations (n,)."""
        self._elements.setdefault(kind, []).append(_Elements(numbers, nodes, combinations))

    def add_combination(self, groups: Iterable[int]) -> int:
        """Return the index of a combination of groups, all of one dimension."""
        combination = tuple(sorted(groups))
        if len(combination) > _MAX_GROUPS:
            raise ValueError(f"an element is in more than {_MAX_GROUPS} physical groups")
        if combination and combination[-1] > _MAX_TAG:
            raise ValueError(f"physical group {combination[-1]}: numbers end at {_MAX_TAG}")
        if combination not in self._index:
            self._index[combination] = len(self._combinations)
            self._combinations.append(combination)
        return self._index[combination]

    def add_name(self, dim: int, group: int, name: str) -> None:
        """Name a physical group of a dimension."""
        if (dim, group) in self._names:
            raise ValueError(f"physical group {group} of dimension {dim} has two names")
        self._names[dim, group] = name

    def arrays(self) -> tuple[MeshArrays, list[str]]:
        """Return cells of one type, tags of cells and facets by groups, and notes for the user.

        Cells are those in groups, or all of the highest dimension if none of them is in a group.

        Raises:
            ValueError: if numbers do not agree with each other, or DOLFINx has no such mesh.
        """
        numbers, x = self._join_nodes()
        elements = self._join_elements(numbers)
        dim = max(kind_of(kind).dim for kind in elements)
        if dim < 2:
            raise ValueError("it has no mesh of plane or solid cells: mesh it in Gmsh first")
        notes: list[str] = []
        number, chosen = self._choose_cells(elements, dim, notes)
        _, cell, degree, n_nodes = kind_of(number)
        order = cell_perm_gmsh(CellType[cell], n_nodes)
        used, member = np.unique(chosen.nodes[:, order], return_inverse=True)
        cells = member.reshape(chosen.nodes.shape).astype(np.int64)
        check_nodes_of_cells(cells, cell, degree, chosen.numbers, numbers[used])
        if dim == 2:
            check_plane("it", x[used])
        cell_tags, cell_names = self._number_tags(dim, chosen.combinations, "cells", notes)
        facet_tags, facet_names = self._tag_facets(elements, cells, cell, used, notes)
        tags = {"cells": cell_tags[:, None], "facets": facet_tags}
        names = {"cells": cell_names, "facets": facet_names}
        x = np.ascontiguousarray(x[used, :dim])
        return MeshArrays((cell, degree), x, cells, tags, names), notes

    def _join_nodes(self) -> tuple[Indices, Array]:
        """Return numbers (n,) of all nodes in ascending order, and their coordinates (n, 3)."""
        if not sum(map(len, self._numbers)):
            raise ValueError("it has no nodes: mesh it in Gmsh first")
        numbers, x = np.concatenate(self._numbers), np.concatenate(self._x)
        order = np.argsort(numbers, kind="stable")
        numbers, x = numbers[order], x[order]
        if (repeated := np.diff(numbers) == 0).any():
            raise ValueError(f"it has node {numbers[repeated.argmax()]} twice")
        if numbers[0] < 0:
            raise ValueError(f"it has node {numbers[0]}: numbers are not negative")
        if (wrong := ~(np.abs(x) <= MAX_COORDINATE).all(axis=1)).any():
            place = ", ".join(f"{c:g}" for c in x[wrong.argmax()])
            raise ValueError(f"node {numbers[wrong.argmax()]} lies at ({place})")
        return numbers, x

    def _join_elements(self, node_numbers: Indices) -> dict[int, _Elements]:
        """Return elements by type, with indices of nodes in place of their numbers."""
        elements = {}
        for kind, blocks in self._elements.items():
            numbers, nodes, combinations = map(np.concatenate, zip(*blocks, strict=True))
            if not len(numbers):
                continue
            index = np.searchsorted(node_numbers, nodes)
            index[index == len(node_numbers)] = 0
            if (missing := node_numbers[index] != nodes).any():
                which = missing.any(axis=1).argmax()
                node = nodes[which][missing[which]][0]
                raise ValueError(
                    f"element {numbers[which]} has the node {node}, which is not there"
                )
            elements[kind] = _Elements(numbers, index, combinations)
        if not elements:
            raise ValueError("it has no elements: mesh it in Gmsh first")
        stated = np.sort(np.concatenate([some.numbers for some in elements.values()]))
        if (repeated := np.diff(stated) == 0).any():
            raise ValueError(f"it has element {stated[:-1][repeated][0]} twice")
        return elements

    def _choose_cells(
        self, elements: dict[int, _Elements], dim: int, notes: list[str]
    ) -> tuple[int, _Elements]:
        """Return the cells and their type, ordered by their groups."""
        cells = {kind: some for kind, some in elements.items() if kind_of(kind).dim == dim}
        in_group = {kind: some.combinations > 0 for kind, some in cells.items()}
        n_chosen = sum(int(mask.sum()) for mask in in_group.values())
        if n_chosen:
            n_cells = sum(map(len, in_group.values()))
            if n_cells > n_chosen:
                n_left = n_cells - n_chosen
                notes.append(f"{n_left} of {n_cells} cells are in no physical group, and left out")
            cells = {k: cells[k].select(mask) for k, mask in in_group.items() if mask.any()}
        words = " and ".join(
            f"{len(some.numbers)} {kind_of(kind).describe()}" for kind, some in cells.items()
        )
        if len(cells) > 1:
            raise ValueError(
                f"its cells are {words}, but a mesh has cells of one type: make all of them "
                "alike in Gmsh, or put those of one type into physical groups"
            )
        ((kind, chosen),) = cells.items()
        if kind not in CELL_TYPES:
            raise ValueError(
                f"its cells are {words}: read are triangles, quadrilaterals, tetrahedra and "
                "hexahedra of degree 1 or 2 with all their nodes (in Gmsh: setOrder(2), and "
                "Mesh.SecondOrderIncomplete = 0)"
            )
        least = np.array([min(groups, default=0) for groups in self._combinations])
        chosen = chosen.select(np.argsort(least[chosen.combinations], kind="stable"))
        return kind, self._join_repeated_cells(chosen)

    def _join_repeated_cells(self, cells: _Elements) -> _Elements:
        """Join cells that are stated once for each of their groups, as files of format 2 do."""
        code = encode_rows(cells.nodes)
        first, joined = self._join_combinations(code, cells.combinations)
        n_groups = np.array([max(1, len(groups)) for groups in self._combinations])
        n_stated = np.bincount(code, n_groups[cells.combinations])
        if (twice := n_stated[code[first]] != n_groups[joined]).any():
            same = np.flatnonzero(code == code[first[twice.argmax()]])
            a, b = cells.numbers[same[:2]]
            raise ValueError(f"elements {a} and {b} have the same nodes")
        return _Elements(cells.numbers[first], cells.nodes[first], joined)

    def _join_combinations(self, code: Indices, combinations: Indices) -> tuple[Indices, Indices]:
        """Return the first element (m,) of each code, and the combination of all that have it."""
        once = np.unique(np.stack([code, combinations]), axis=1, return_index=True)[1]
        once = once[np.lexsort((once, code[once]))]
        start = np.flatnonzero(np.diff(code[once], prepend=-1))
        count = np.diff(start, append=len(once))
        joined = combinations[once[start]]
        for k in range(1, int(count.max(initial=0))):
            several = count > k
            pairs = np.stack([joined[several], combinations[once[start[several] + k]]])
            pairs, member = np.unique(pairs, axis=1, return_inverse=True)
            unions = [
                self.add_combination({*self._combinations[a], *self._combinations[b]})
                for a, b in pairs.T
            ]
            joined[several] = np.array(unions)[member.ravel()]
        order = np.argsort(once[start])
        return once[start][order], joined[order]

    def _number_tags(
        self, dim: int, combinations: Indices, what: str, notes: list[str]
    ) -> tuple[LocalIndices, dict[str, tuple[int, ...]]]:
        """Return tags (n,), 0 being none, and those of each name.

        The tag is the group's number, or a number above all of them for several groups.
        """
        used, member, count = np.unique(combinations, return_inverse=True, return_counts=True)
        groups_of = [self._combinations[index] for index in used]
        next_tag = max((groups[-1] for groups in groups_of if groups), default=0) + 1
        tags, tags_of = [], dict[int, list[int]]()
        for groups in groups_of:
            tag = groups[0] if len(groups) == 1 else 0
            if len(groups) > 1:
                unnamed = [group for group in groups if (dim, group) not in self._names]
                if unnamed or next_tag > _MAX_TAG:
                    raise ValueError(
                        f"{what} are in the physical groups {', '.join(map(str, groups[:6]))} at "
                        "once: give all of these names and smaller numbers, or let none overlap"
                    )
                tag, next_tag = next_tag, next_tag + 1
            tags.append(tag)
            for group in groups:
                tags_of.setdefault(group, []).append(tag)
        if n_several := int(count[[len(groups) > 1 for groups in groups_of]].sum()):
            notes.append(
                f"{n_several} {what} are in several physical groups at once, and have tags above "
                f"all groups' numbers: select them by name, with .{what}(name)"
            )
        names: dict[str, tuple[int, ...]] = {}
        for group in sorted(tags_of):
            if name := self._names.get((dim, group)):
                names[name] = (*names.get(name, ()), *tags_of[group])
        return np.array(tags, dtype=np.int32)[member.ravel()], names

    def _tag_facets(
        self,
        elements: dict[int, _Elements],
        cells: Indices,
        cell: str,
        used: Indices,
        notes: list[str],
    ) -> tuple[LocalIndices, dict[str, tuple[int, ...]]]:
        """Return tags of the sides of cells (n, sides), and those of each name."""
        topology = basix.topology(basix.CellType[cell])
        dim, n_corners = len(topology) - 1, len(topology[-2][0])
        tags = np.zeros((len(cells), len(topology[-2])), dtype=np.int32)
        corners: list[Indices] = [np.empty((0, n_corners), dtype=np.int64)]
        combinations: list[Indices] = [np.empty(0, dtype=np.int64)]
        n_stated = 0
        for kind, some in elements.items():
            if kind_of(kind).dim == dim - 1 and (in_group := some.combinations > 0).any():
                n_stated += int(in_group.sum())
                some = some.select(in_group & np.isin(some.nodes, used).all(axis=1))
                if kind_of(kind).n_corners == n_corners:
                    corners.append(
                        np.searchsorted(used, some.nodes[:, :n_corners]).astype(np.int64)
                    )
                    combinations.append(some.combinations)
        if not n_stated:
            return tags, {}
        rows, combination = np.concatenate(corners), np.concatenate(combinations)
        code = encode_rows(rows)
        first, joined = self._join_combinations(code, combination)
        of_cell, side, facet = find_facets(cells, cell, rows[first])
        matched, member = np.unique(facet, return_inverse=True)
        if n_lost := n_stated - int(np.isin(code, code[first[matched]]).sum()):
            notes.append(
                f"{n_lost} of {n_stated} elements of dimension {dim - 1} in physical groups are no "
                "facets of the cells, and left out"
            )
        tag_of, names = self._number_tags(dim - 1, joined[matched], "facets", notes)
        tags[of_cell, side] = tag_of[member]
        return tags, names


def from_model(model: Any) -> GroupedMesh:  # noqa: ANN401
    """Take nodes, elements and physical groups from Gmsh's model.

    Raises:
        ValueError: if Gmsh has no such model, or elements of a type that is not known here.
    """
    mesh = GroupedMesh()
    try:
        numbers, x, _ = model.mesh.getNodes()
        blocks = []
        for dim, entity in model.getEntities():
            groups = model.getPhysicalGroupsForEntity(dim, entity)
            blocks.append((groups, model.mesh.getElements(dim, entity)))
        named = [(*group, model.getPhysicalName(*group)) for group in model.getPhysicalGroups()]
    except Exception as error:  # Gmsh's own
        words = f"Gmsh says '{error}'; call gmsh.initialize() and make a model first"
        raise ValueError(words) from error
    mesh.add_nodes(numbers.astype(np.int64), x.reshape(-1, 3))
    for groups, (kinds, labels, nodes) in blocks:
        combination = mesh.add_combination({*map(int, groups)})
        for kind, label, rows in zip(kinds, labels, nodes, strict=True):
            shape = len(label), kind_of(kind).n_nodes
            mesh.add_elements(
                int(kind),
                label.astype(np.int64),
                rows.astype(np.int64).reshape(shape),
                np.full(len(label), combination),
            )
    for dim, group, name in named:
        if name:
            mesh.add_name(dim, group, name)
    return mesh

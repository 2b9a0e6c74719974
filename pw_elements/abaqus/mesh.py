"""Arrays of cells and tagged facets of an Abaqus input file, from which DOLFINx creates a mesh.

Quadrilaterals with 8 nodes and hexahedra with 20 nodes become Lagrange cells with 9 and 27 nodes.
The additional nodes lie at the centres of faces and cells. Their positions are computed with the
shape functions of the 8 or 20 nodes, which keeps the shape of the cells unchanged.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import basix
import numpy as np
import scipy.sparse as sp

from pw_elements.abaqus.deck import (
    KEY_OFFSET_PER_PART,
    AbaqusDeck,
    PartNumberAndSetName,
    SurfaceMembers,
    sort_distinct,
)
from pw_elements.abaqus.lines import to_upper_ascii
from pw_elements.abaqus.types import ABAQUS_EDGE_CORNERS, ABAQUS_FACE_CORNERS, AbaqusElementType
from pw_elements.arrays import Array, Indices, Mask

# Abaqus' numbers of the corners, listed in DOLFINx' order
ABAQUS_CORNERS_IN_DOLFINX_ORDER = {
    "triangle": (0, 1, 2),
    "quadrilateral": (0, 1, 3, 2),
    "tetrahedron": (0, 1, 2, 3),
    "hexahedron": (0, 1, 3, 2, 4, 5, 7, 6),
}
# Names of the two sides of a shell: SPOS and SNEG in Abaqus, S1 and S2 in CalculiX, where the edges
# of a shell are S3, S4 ...
SHELL_SIDE_NAMES = ("SPOS", "SNEG", "S1", "S2")
# Largest distance of nodes from their plane, relative to the extent of the nodes
FLATNESS_TOLERANCE_OVER_EXTENT = 1e-9
# Largest number of pairs (node of a set, facet at this node) that are held in memory at once
MAX_NODE_FACET_PAIRS_IN_MEMORY = 2_000_000

TagsBySetName = dict[str, tuple[int, ...]]  # tags of each set by its name


class AbaqusMeshArrays(NamedTuple):
    """Arrays of the mesh and the named sets of an input file.

    Args:
        cell: DOLFINx' name of the cells.
        degree: degree of the geometry.
        x: coordinates (k, dim) of the nodes.
        cells: indices (n, nodes per cell) of the cells' nodes in DOLFINx' order.
        tags: under the key "cells", the tags (n, 1) of the cells; under the key "facets", the tags
            (n, facets per cell) of each cell's facets; 0 for cells and facets without a tag.
        names: under the keys "cells" and "facets", the tags of each named set.
        notes: messages about data that were left out or changed.
    """

    cell: str
    degree: int
    x: Array
    cells: Indices
    tags: dict[str, Indices]
    names: dict[str, TagsBySetName]
    notes: list[str]


def read_abaqus_mesh(path: Path, cell_sets: Sequence[str] | None = None) -> AbaqusMeshArrays:
    """Read the cells and sets of an input file.

    Args:
        path: path of the file.
        cell_sets: names of the ELSETs whose elements become cells. If None, all elements of the
            highest dimension become cells.

    Raises:
        FileNotFoundError: if the file, or a file that it includes, does not exist.
        ValueError: if the file has no supported mesh; the message names file, line and reason.
    """
    deck = AbaqusDeck(path)
    set_labels = _make_unique_set_labels(deck)
    is_selected = _select_elements(deck, set_labels, cell_sets)
    cell_table = _AbaqusCellTable(deck, is_selected)
    facets = _FacetTable(cell_table)
    facets.match_elements_to_facets(
        np.isin(deck.element_keys // KEY_OFFSET_PER_PART, deck.used_part_numbers)
    )
    notes = [*deck.notes]
    if cell_sets is None:
        notes += _describe_omitted_elements(
            deck, is_selected & (cell_table.cell_of_element < 0) & (facets.facet_of_element < 0)
        )
    named_sets = _NamedCellAndFacetSets(deck, set_labels, cell_table, facets)
    coordinates, nodes = cell_table.add_face_and_cell_centre_nodes(facets, notes)
    cell_tags, cell_set_tags = _assign_tags_to_set_combinations(
        named_sets.cells, len(cell_table.nodes)
    )
    facet_tags, facet_set_tags = _assign_tags_to_set_combinations(
        named_sets.facets, len(facets.corners)
    )
    node_order, facet_order = abaqus_nodes_and_facets_in_dolfinx_order(
        cell_table.cell, cell_table.degree
    )
    tags = {
        "cells": cell_tags[:, None],
        "facets": facet_tags[facets.facets_of_cell[:, facet_order]],
    }
    names = {"cells": cell_set_tags, "facets": facet_set_tags}
    notes += named_sets.notes
    return AbaqusMeshArrays(
        cell_table.cell, cell_table.degree, coordinates, nodes[:, node_order], tags, names, notes
    )


def _make_unique_set_labels(deck: AbaqusDeck) -> dict[str, dict[PartNumberAndSetName, str]]:
    """Return the label of each set, by kind: its name, or "INSTANCE.NAME" if it is not unique."""
    used_parts = set(map(int, deck.used_part_numbers))
    labels: dict[str, dict[PartNumberAndSetName, str]] = {}
    names_by_kind = {set_kind: dict.fromkeys(names) for set_kind, names in deck.sets.items()}
    for set_kind, names in {**names_by_kind, "SURFACE": dict.fromkeys(deck.surfaces)}.items():
        labels[set_kind] = {}
        for part, name in names:
            if part not in used_parts:
                continue
            is_ambiguous = len(deck.instance_names) > 1 or (0, name) in names
            needs_instance = part > 0 and part in deck.instance_names and is_ambiguous
            labels[set_kind][part, name] = (
                f"{deck.instance_names[part]}.{name}" if needs_instance else name
            )
    return labels


def _select_elements(
    deck: AbaqusDeck,
    set_labels: dict[str, dict[PartNumberAndSetName, str]],
    cell_sets: Sequence[str] | None,
) -> Mask:
    """Return a mask of the elements in the ELSETs `cell_sets`; if None, in all used parts."""
    if cell_sets is None:
        return np.isin(deck.element_keys // KEY_OFFSET_PER_PART, deck.used_part_numbers)
    is_selected = np.zeros(len(deck.element_keys), dtype=bool)
    by_label = {label: name for name, label in set_labels["ELSET"].items()}
    for cell_set in cell_sets:
        name = by_label.get(cell_set, by_label.get(to_upper_ascii(cell_set)))
        if name is None:
            known_labels = ", ".join(by_label) or "none"
            raise ValueError(
                f"{deck.path}: no ELSET is called {cell_set}; known are {known_labels}"
            )
        is_selected[deck.sets["ELSET"][name]] = True
    return is_selected


def _describe_omitted_elements(deck: AbaqusDeck, is_omitted: Mask) -> list[str]:
    counts = np.bincount(deck.type_index[is_omitted], minlength=len(deck.element_types))
    description = ", ".join(
        f"{n} {kind.name}" for kind, n in zip(deck.element_types, counts, strict=True) if n
    )
    return (
        [f"elements that are neither cells nor facets are left out: {description}"]
        if description
        else []
    )


class _AbaqusCellTable:
    """Cells of an input file, with nodes in Abaqus' order.

    Attributes:
        x: coordinates (k, dim) of the nodes of cells.
        nodes: nodes (n, corners and mid-side nodes) of each cell, as row numbers of `x`; -1 for a
            missing node.
        row_of_node: row number in `x` of each node of the file, -1 for unused nodes.
        cell_of_element: cell number of each element of the file, -1 for elements that are not
            cells.
        element_of_cell: position (n,) in the `AbaqusDeck` of the element that is the cell.
        element_types: element type of each cell.
    """

    def __init__(self, deck: AbaqusDeck, is_selected: Mask) -> None:
        self.deck = deck
        has_elements = (
            np.bincount(deck.type_index[is_selected], minlength=len(deck.element_types)) > 0
        )
        element_types = [
            element_type
            for element_type, is_present in zip(deck.element_types, has_elements, strict=True)
            if is_present
        ]
        self.cell, self.degree, self.dim = self._common_cell_type_degree_and_dim(element_types)
        n_nodes = len(ABAQUS_CORNERS_IN_DOLFINX_ORDER[self.cell]) + (
            len(ABAQUS_EDGE_CORNERS[self.cell]) if self.degree > 1 else 0
        )
        if self.degree > 1 and self.cell == "quadrilateral":
            n_nodes += 1
        tables, positions, self.element_types = [], [], list[AbaqusElementType]()
        for element_type, members, nodes in zip(
            deck.element_types, deck.members, deck.nodes, strict=True
        ):
            is_cell = is_selected[members]
            if element_type.dim != self.dim or not is_cell.any():
                continue
            rows = np.full((int(is_cell.sum()), n_nodes), -1, dtype=np.int64)
            rows[:, : element_type.n_nodes] = deck.find_node_indices(nodes[is_cell])
            tables.append(rows)
            positions.append(members[is_cell])
            self.element_types += [element_type] * len(rows)
        table, self.element_of_cell = np.concatenate(tables), np.concatenate(positions)
        self.cell_of_element = np.full(len(deck.element_keys), -1, dtype=np.int64)
        self.cell_of_element[self.element_of_cell] = np.arange(len(table))
        used_positions = np.unique(table[table >= 0])
        self.row_of_node = np.full(len(deck.node_keys) + 1, -1, dtype=np.int64)
        self.row_of_node[used_positions] = np.arange(len(used_positions))
        self.nodes = self.row_of_node[table]  # index -1 refers to the last entry, -1
        self._keys = deck.node_keys[used_positions]
        self._check_connectivity()
        self.x = np.ascontiguousarray(
            deck.x[used_positions][:, self._choose_coordinate_axes(deck.x[used_positions])]
        )

    def _common_cell_type_degree_and_dim(
        self, element_types: list[AbaqusElementType]
    ) -> tuple[str, int, int]:
        """Return the type, degree and dimension of all cells; raise ValueError if cells differ."""
        path = self.deck.path
        unsupported = sorted(
            element_type.name
            for element_type in element_types
            if not element_type.dim and not element_type.is_optional
        )
        if unsupported:
            raise ValueError(
                f"{path}: elements {', '.join(unsupported)} are not read, since DOLFINx has no "
                "such cells; from_file(path, cells=NAME) reads those of an ELSET alone"
            )
        dim = max((element_type.dim for element_type in element_types), default=0)
        cells_and_degrees = {
            (element_type.cell, element_type.degree)
            for element_type in element_types
            if element_type.dim == dim > 0
        }
        if dim < 2 or len(cells_and_degrees) > 1:
            description = (
                " and ".join(sorted(f"{cell}s of degree {n}" for cell, n in cells_and_degrees))
                or "none"
            )
            type_names = ", ".join(
                sorted({element_type.name for element_type in element_types})[:6]
            )
            advice = f", but {type_names}" if type_names else ""
            if dim > 1:
                advice = "; from_file(path, cells=NAME) reads those of an ELSET"
            raise ValueError(
                f"{path}: a mesh has plane or solid cells of one kind, here are {description}"
                f"{advice}"
            )
        ((cell, degree),) = cells_and_degrees
        return cell, degree, dim

    def _element_label_in_file(self, cell: int) -> str:
        return self.deck.format_instance_and_number(
            self.deck.element_keys[self.element_of_cell[cell]]
        )

    def _node_label_in_file(self, node: int) -> str:
        return self.deck.format_instance_and_number(self._keys[node])

    def _check_connectivity(self) -> None:
        """Raise ValueError for repeated nodes or cells, or inconsistent mid-side nodes."""
        path, corners = self.deck.path, len(ABAQUS_CORNERS_IN_DOLFINX_ORDER[self.cell])
        rows = np.sort(self.nodes, axis=1)
        cell, column = np.nonzero((np.diff(rows, axis=1) == 0) & (rows[:, 1:] >= 0))
        if len(cell):
            node = self._node_label_in_file(rows[cell[0], column[0]])
            raise ValueError(
                f"{path}: element {self._element_label_in_file(cell[0])} has the node {node} "
                "twice: "
                "collapsed cells are not read"
            )
        rows = np.sort(self.nodes[:, :corners], axis=1)
        ordering = np.lexsort(rows.T)
        equal_rows = np.flatnonzero((np.diff(rows[ordering], axis=0) == 0).all(axis=1))
        if len(equal_rows):
            first_cell, second_cell = sorted(ordering[equal_rows[0] : equal_rows[0] + 2])
            raise ValueError(
                f"{path}: elements {self._element_label_in_file(first_cell)} and "
                f"{self._element_label_in_file(second_cell)} have the same corners: one cell is "
                "given twice"
            )
        if self.degree == 1:
            return
        middles = self.nodes[:, corners : corners + len(ABAQUS_EDGE_CORNERS[self.cell])]
        contradictory = np.intersect1d(middles, self.nodes[:, :corners])
        if len(contradictory):
            raise ValueError(
                f"{path}: node {self._node_label_in_file(contradictory[0])} is a corner of one "
                "element and "
                "in the middle of another's edge"
            )
        edge_ends = np.array([[int(c) for c in edge] for edge in ABAQUS_EDGE_CORNERS[self.cell]])
        pairs = np.sort(self.nodes[:, edge_ends], axis=2).reshape(-1, 2)
        ordering = np.lexsort(pairs.T)
        pairs, middle_nodes = pairs[ordering], middles.ravel()[ordering]
        is_torn = (np.diff(pairs, axis=0) == 0).all(axis=1) & (np.diff(middle_nodes) != 0)
        if is_torn.any():
            k = int(np.flatnonzero(is_torn)[0])
            a, b, c, d = (
                self._node_label_in_file(n) for n in (*pairs[k], *middle_nodes[k : k + 2])
            )
            raise ValueError(
                f"{path}: the edge between nodes {a} and {b} has the node {c} in one element and "
                f"{d} in another"
            )
        ordering = np.argsort(middle_nodes, kind="stable")
        pairs, middle_nodes = pairs[ordering], middle_nodes[ordering]
        is_shared = (np.diff(middle_nodes) == 0) & (np.diff(pairs, axis=0) != 0).any(axis=1)
        if is_shared.any():
            node = self._node_label_in_file(middle_nodes[np.flatnonzero(is_shared)[0]])
            raise ValueError(f"{path}: node {node} is in the middle of two edges")

    def _choose_coordinate_axes(self, x: Array) -> list[int]:
        """Return the indices (0, 1 or 2) of the file's coordinate axes that the mesh keeps."""
        if self.dim == 3:
            return [0, 1, 2]
        extent = np.ptp(x, axis=0)
        is_flat = extent <= FLATNESS_TOLERANCE_OVER_EXTENT * extent.max()
        all_shells = all(element_type.is_shell for element_type in set(self.element_types))
        for normal_axis, axes in ((2, [0, 1]), (1, [0, 2]), (0, [1, 2])):
            if is_flat[normal_axis] and (all_shells or normal_axis == 2):
                if normal_axis < 2:
                    a, b, c = ("xyz"[k] for k in (*axes, normal_axis))
                    self.deck.notes.append(
                        f"the shells lie in a plane {c} = {x[0, normal_axis]:g}: {a} and {b} are "
                        "the mesh's x and y"
                    )
                return axes
        raise ValueError(
            f"{self.deck.path} has plane cells that do not lie in one plane z = constant; shells "
            "may lie in a plane x, y or z = constant: turn the nodes into one"
        )

    def add_face_and_cell_centre_nodes(
        self, facets: "_FacetTable", notes: list[str]
    ) -> tuple[Array, Indices]:
        """Add nodes at the centres of faces and cells; return coordinates and the cells' nodes."""
        x, nodes = self.x, self.nodes
        if self.degree == 1 or len(ABAQUS_CORNERS_IN_DOLFINX_ORDER[self.cell]) == self.dim + 1:
            return x, nodes
        if self.cell == "quadrilateral":
            incomplete_cells = np.flatnonzero(nodes[:, 8] < 0)
            if len(incomplete_cells):
                nodes = nodes.copy()
                nodes[incomplete_cells, 8] = len(x) + np.arange(len(incomplete_cells))
                x = np.concatenate(
                    [
                        x,
                        self._serendipity_face_centres(
                            nodes[incomplete_cells, :4], nodes[incomplete_cells, 4:8]
                        ),
                    ]
                )
                notes.append(
                    f"{len(incomplete_cells)} cells of 8 nodes have got a ninth in their middle"
                )
            return x, nodes
        corners = self.nodes[facets.first_cell[:, None], facets.face_corners[facets.first_side]]
        middles = self.nodes[facets.first_cell[:, None], facets.face_middles[facets.first_side]]
        face_centres = self._serendipity_face_centres(corners, middles)
        cell_centres = x[nodes[:, 8:]].sum(axis=1) / 4 - x[nodes[:, :8]].sum(axis=1) / 4
        face_nodes = len(x) + facets.facets_of_cell
        centre_nodes = len(x) + len(face_centres) + np.arange(len(nodes))
        notes.append(
            f"{len(nodes)} cells of 20 nodes have got 7 more, in the middle of faces and cells"
        )
        return np.concatenate([x, face_centres, cell_centres]), np.hstack(
            [nodes, face_nodes, centre_nodes[:, None]]
        )

    def _serendipity_face_centres(self, corner_nodes: Indices, mid_side_nodes: Indices) -> Array:
        """Return the centres (n, dim) of faces with 8 nodes, by means of their shape functions."""
        return self.x[mid_side_nodes].sum(axis=1) / 2 - self.x[corner_nodes].sum(axis=1) / 4


class _FacetTable:
    """Table of the m distinct facets of the n cells.

    Attributes:
        corners: corner nodes (m, corners of a facet) of each facet, in ascending order.
        nodes: all nodes (m, nodes of a facet) of each facet.
        facets_of_cell: facets (n, facets of a cell) of each cell in the order S1, S2 ...
        is_outer: mask (m,) of the facets that belong to one cell only.
        first_cell: first cell (m,) to which each facet belongs.
        first_side: local number (m,) of each facet in its `first_cell`.
        facet_of_element: facet that coincides with each element of the file, or -1.
    """

    def __init__(self, cells: _AbaqusCellTable) -> None:
        self._cells = cells
        cell, n_cells = cells.cell, len(cells.nodes)
        self.face_corners = np.array([[int(c) for c in face] for face in ABAQUS_FACE_CORNERS[cell]])
        edges = [set(edge) for edge in ABAQUS_EDGE_CORNERS[cell]]
        self.face_middles = len(ABAQUS_CORNERS_IN_DOLFINX_ORDER[cell]) + np.array(
            [
                [k for k, edge in enumerate(edges) if edge <= set(face)]
                for face in ABAQUS_FACE_CORNERS[cell]
            ]
        )
        rows = np.sort(cells.nodes[:, self.face_corners], axis=2)
        rows = rows.reshape(-1, self.face_corners.shape[1])
        self.corners, first_index, inverse, n_cells_at_facet = np.unique(
            rows, axis=0, return_index=True, return_inverse=True, return_counts=True
        )
        self.facets_of_cell = inverse.reshape(n_cells, -1)
        self.is_outer = n_cells_at_facet == 1
        self.first_cell, self.first_side = np.divmod(first_index, len(self.face_corners))
        columns = self.face_corners
        if cells.degree > 1:
            columns = np.hstack([self.face_corners, self.face_middles])
        self.nodes = cells.nodes[self.first_cell[:, None], columns[self.first_side]]
        self.facet_of_element = np.full(len(cells.deck.element_keys), -1, dtype=np.int64)

    def match_elements_to_facets(self, is_in_used_part: Mask) -> None:
        """Set `facet_of_element` for elements in used parts that have the facets' dimension."""
        cells, deck = self._cells, self._cells.deck
        is_corner = np.zeros(len(cells.x) + 1, dtype=bool)
        is_corner[cells.nodes[:, : len(ABAQUS_CORNERS_IN_DOLFINX_ORDER[cells.cell])]] = True
        n_corners = self.corners.shape[1]
        for element_type, members, keys in zip(
            deck.element_types, deck.members, deck.nodes, strict=True
        ):
            if element_type.dim != cells.dim - 1 or not is_in_used_part[members].any():
                continue
            elements = members[is_in_used_part[members]]
            nodes = cells.row_of_node[deck.find_node_indices(keys[is_in_used_part[members]])]
            node_is_corner = is_corner[nodes] & (nodes >= 0)
            has_all_corners = node_is_corner.sum(axis=1) == n_corners
            elements, nodes, node_is_corner = (
                elements[has_all_corners],
                nodes[has_all_corners],
                node_is_corner[has_all_corners],
            )
            rows = np.sort(nodes[node_is_corner].reshape(-1, n_corners), axis=1)
            row_code = np.unique(np.concatenate([self.corners, rows]), axis=0, return_inverse=True)[
                1
            ]
            row_code = row_code.ravel()
            facet_of_code = np.full(row_code.max() + 1, -1, dtype=np.int64)
            facet_of_code[row_code[: len(self.corners)]] = np.arange(len(self.corners))
            facet = facet_of_code[row_code[len(self.corners) :]]
            has_same_nodes = (
                (nodes[:, :, None] == self.nodes[facet][:, None]).any(axis=2).all(axis=1)
            )
            self.facet_of_element[elements] = np.where(has_same_nodes & (facet >= 0), facet, -1)

    def find_outer_facets_in_node_sets(self, node_sets: list[Indices]) -> list[Indices]:
        """Return, for each set of nodes, the outer facets that have all their nodes in the set."""
        outer_facets = np.flatnonzero(self.is_outer)
        n_nodes = self.nodes.shape[1]
        columns = np.repeat(np.arange(len(outer_facets)), n_nodes)
        shape = (len(self._cells.x), len(outer_facets))
        ones = np.ones(len(columns), dtype=np.int32)
        facets_at_node = sp.csr_matrix((ones, (self.nodes[outer_facets].ravel(), columns)), shape)
        n_facets_at_node = np.diff(facets_at_node.indptr)
        n_pairs = np.cumsum([int(n_facets_at_node[members].sum()) for members in node_sets])
        batch = n_pairs // MAX_NODE_FACET_PAIRS_IN_MEMORY
        facets_of_set: list[Indices] = []
        for number in np.unique(batch):
            batch_sets = [node_sets[k] for k in np.flatnonzero(batch == number)]
            pointers = np.concatenate([[0], np.cumsum([len(members) for members in batch_sets])])
            members = np.concatenate(batch_sets)
            ones = np.ones(len(members), dtype=np.int32)
            set_nodes = sp.csr_matrix((ones, members, pointers), (len(batch_sets), shape[0]))
            n_nodes_in_set = (set_nodes @ facets_at_node).tocsr()
            is_complete = n_nodes_in_set.data == n_nodes
            ends = np.concatenate([[0], np.cumsum(is_complete)])[n_nodes_in_set.indptr]
            facets_of_set += np.split(outer_facets[n_nodes_in_set.indices[is_complete]], ends[1:-1])
        return facets_of_set


class _NamedCellAndFacetSets:
    """Cells and facets of each named set.

    Empty sets, and sets with names that begin with "_", are left out.

    Attributes:
        cells: cells of each set.
        facets: facets of each set. If sets have the same name, a SURFACE takes precedence over an
            ELSET, and an ELSET takes precedence over an NSET.
        notes: messages about surfaces that contain sides of shells, which are not facets.
    """

    def __init__(
        self,
        deck: AbaqusDeck,
        set_labels: dict[str, dict[PartNumberAndSetName, str]],
        cells: _AbaqusCellTable,
        facets: _FacetTable,
    ) -> None:
        self._deck, self._cells, self._facets = deck, cells, facets
        self._is_shell = np.array([kind.is_shell for kind in cells.element_types])
        self._sets_with_shell_sides: dict[str, None] = {}
        self.cells: dict[str, Indices] = {}
        self.facets: dict[str, Indices] = {}
        visible_sets = {
            set_kind: {name: label for name, label in labels.items() if not name[1].startswith("_")}
            for set_kind, labels in set_labels.items()
        }
        node_sets = {("NSET", name): deck.sets["NSET"][name] for name in visible_sets["NSET"]}
        for name in visible_sets["SURFACE"]:
            if node_parts := [
                part.members for part in deck.surfaces[name] if part.set_kind == "NSET"
            ]:
                node_sets["SURFACE", name] = np.unique(np.concatenate(node_parts))
        rows = [cells.row_of_node[members] for members in node_sets.values()]
        node_set_facets = facets.find_outer_facets_in_node_sets([row[row >= 0] for row in rows])
        facets_of_nodes = dict(zip(node_sets, node_set_facets, strict=True))
        for name, label in visible_sets["NSET"].items():
            self._store_nonempty_set(self.facets, label, facets_of_nodes["NSET", name])
        for name, label in visible_sets["ELSET"].items():
            self._store_nonempty_set(
                self.cells, label, cells.cell_of_element[deck.sets["ELSET"][name]]
            )
            self._store_nonempty_set(
                self.facets, label, facets.facet_of_element[deck.sets["ELSET"][name]]
            )
        for name, label in visible_sets["SURFACE"].items():
            parts = [part for part in deck.surfaces[name] if part.set_kind == "ELSET"]
            chunks = [self._find_facets_of_surface_members(part, label) for part in parts]
            chunks += [
                facets_of_nodes[key] for key in [("SURFACE", name)] if key in facets_of_nodes
            ]
            self._store_nonempty_set(
                self.facets, label, np.concatenate([facets.facets_of_cell[:0, 0], *chunks])
            )
        self.notes = [
            f"{name} has sides of shells, which are no facets"
            for name in self._sets_with_shell_sides
        ]

    def _store_nonempty_set(self, sets: dict[str, Indices], label: str, members: Indices) -> None:
        members = sort_distinct(members[members >= 0])
        if len(members):
            sets[label] = members

    def _find_facets_of_surface_members(
        self, surface_members: SurfaceMembers, label: str
    ) -> Indices:
        """Return the facets that a part of a surface contains.

        An element of the part may be a facet itself. If it is a cell, its facet is the face that
        the part names; all its outer faces are returned if the part names no face.
        """
        facets, cell_numbers = self._facets, self._cells.cell_of_element[surface_members.members]
        chunks = [facets.facet_of_element[surface_members.members]]
        for is_shell in (False, True):
            cells = cell_numbers[(cell_numbers >= 0) & (self._is_shell[cell_numbers] == is_shell)]
            if not len(cells):
                continue
            face_numbers = _face_number_by_name(self._cells.cell, is_shell)
            if not surface_members.face:
                cell_facets = facets.facets_of_cell[cells]
                chunks.append(cell_facets[facets.is_outer[cell_facets]])
            elif surface_members.face in face_numbers:
                chunks.append(facets.facets_of_cell[cells, face_numbers[surface_members.face]])
            elif is_shell and surface_members.face in SHELL_SIDE_NAMES:
                self._sets_with_shell_sides.setdefault(label)
            else:
                raise ValueError(
                    f"{self._deck.path}: a surface has faces {surface_members.face}; a "
                    f"{self._cells.cell} "
                    f"has {[*face_numbers]}"
                )
        return np.concatenate(chunks)


def _face_number_by_name(cell_type: str, is_shell: bool) -> dict[str, int]:
    """Return a mapping from face names to face numbers; edges of shells have two names."""
    count = len(ABAQUS_FACE_CORNERS[cell_type])
    if not is_shell:
        return {f"S{k + 1}": k for k in range(count)}
    return {f"E{k + 1}": k for k in range(count)} | {f"S{k + 3}": k for k in range(count)}


def abaqus_nodes_and_facets_in_dolfinx_order(
    cell_type: str, degree: int
) -> tuple[list[int], list[int]]:
    """Return Abaqus' numbers of the nodes and of the facets of a cell, both in DOLFINx' order."""
    corners = ABAQUS_CORNERS_IN_DOLFINX_ORDER[cell_type]
    dim = 2 if cell_type in ("triangle", "quadrilateral") else 3
    topology = basix.topology(basix.CellType[cell_type])
    face_corners = [set(map(int, face)) for face in ABAQUS_FACE_CORNERS[cell_type]]
    facet_order = [face_corners.index({corners[k] for k in facet}) for facet in topology[dim - 1]]
    node_order = [*corners]
    if degree > 1:
        edge_corners = [set(map(int, edge)) for edge in ABAQUS_EDGE_CORNERS[cell_type]]
        node_order += [
            len(node_order) + edge_corners.index({corners[k] for k in edge}) for edge in topology[1]
        ]
        if cell_type == "hexahedron":
            node_order += [len(node_order) + side for side in facet_order]
        if len(corners) != dim + 1:
            node_order.append(len(node_order))
    return node_order, facet_order


def _assign_tags_to_set_combinations(
    members_of_set: dict[str, Indices], n_entities: int
) -> tuple[Indices, TagsBySetName]:
    """Assign a distinct tag to each combination of sets that occurs among the entities.

    Args:
        members_of_set: entities of each set.
        n_entities: number of entities.

    Returns:
        Tag (n_entities,) of each entity, which is 0 if the entity belongs to no set; and the tags
        of the combinations that contain each set.
    """
    codes = np.zeros(n_entities, dtype=np.int64)
    n_codes = 0
    for members in members_of_set.values():
        distinct_codes, code_index = np.unique(codes[members], return_inverse=True)
        codes[members] = n_codes + 1 + code_index
        n_codes += len(distinct_codes)
    tags = np.unique(codes[codes > 0])
    tag_of_code = np.zeros(n_codes + 1, dtype=np.int64)
    tag_of_code[tags] = np.arange(1, len(tags) + 1)
    entity_tags = tag_of_code[codes]
    return entity_tags, {
        name: tuple(map(int, sort_distinct(entity_tags[set_members])))
        for name, set_members in members_of_set.items()
    }

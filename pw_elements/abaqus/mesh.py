"""Cells and tagged facets of a deck, as arrays that DOLFINx makes a mesh of.

Second-order quadrilaterals and bricks of 8 and 20 nodes become Lagrange cells of 9 and 27: nodes in
the middle of faces and cells are added where the shape functions of 8 and 20 nodes place them, so
that the cells keep their shape.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import basix
import numpy as np
import scipy.sparse as sp

from pw_elements.abaqus.deck import PART, Deck, Name, SurfacePart, unique
from pw_elements.abaqus.lines import capitals
from pw_elements.abaqus.types import EDGES, FACES, Kind
from pw_elements.arrays import Array, Indices, Mask

# Corners in DOLFINx' order, and how many there are
CORNERS = {
    "triangle": (0, 1, 2),
    "quadrilateral": (0, 1, 3, 2),
    "tetrahedron": (0, 1, 2, 3),
    "hexahedron": (0, 1, 3, 2, 4, 5, 7, 6),
}
# Sides of a shell: in Abaqus, and in CalculiX, where its edges are S3, S4 ...
SHELL_SIDES = ("SPOS", "SNEG", "S1", "S2")
# Distance from a plane within which nodes lie in it, over their extent
FLATNESS = 1e-9
# Pairs of a set's node and a facet at it that are in memory at the same time
MAX_PAIRS = 2_000_000

Tags = dict[str, tuple[int, ...]]  # of each set


class DeckMesh(NamedTuple):
    """Arrays of a mesh and its sets.

    Args:
        cell: as DOLFINx calls it.
        degree: of its geometry.
        x: nodes (k, dim).
        cells: nodes (n, nodes of a cell), in DOLFINx' order.
        tags: of "cells" (n, 1) and "facets" (n, facets of a cell), 0 being none.
        names: of sets of "cells" and "facets", with the tags of each.
        notes: what was left out, or is other than it is written.
    """

    cell: str
    degree: int
    x: Array
    cells: Indices
    tags: dict[str, Indices]
    names: dict[str, Tags]
    notes: list[str]


def read_deck(path: Path, cells: Sequence[str] | None = None) -> DeckMesh:
    """Read cells and sets of a file.

    Args:
        path: of the file.
        cells: names of ELSETs whose elements are the cells; all elements if None.

    Raises:
        FileNotFoundError: if the file is not there, or one that it includes.
        ValueError: for a file without such a mesh; the message names file, line and reason.
    """
    deck = Deck(path)
    labels = _labels(deck)
    chosen = _chosen(deck, labels, cells)
    table = _Cells(deck, chosen)
    facets = _Facets(table)
    facets.find_skin(np.isin(deck.element_keys // PART, deck.placed))
    notes = [*deck.notes]
    if cells is None:
        notes += _left_out(deck, chosen & (table.number < 0) & (facets.of_element < 0))
    sets = _Sets(deck, labels, table, facets)
    x, nodes = table.completed(facets, notes)
    cell_tags, of_cells = _numbered(sets.cells, len(table.nodes))
    facet_tags, of_facets = _numbered(sets.facets, len(facets.corners))
    columns, sides = _dolfinx_order(table.cell, table.degree)
    tags = {"cells": cell_tags[:, None], "facets": facet_tags[facets.of_cell[:, sides]]}
    names = {"cells": of_cells, "facets": of_facets}
    notes += sets.notes
    return DeckMesh(table.cell, table.degree, x, nodes[:, columns], tags, names, notes)


def _labels(deck: Deck) -> dict[str, dict[Name, str]]:
    """Names of the sets of each sort: as they are if that is clear, or else "INSTANCE.NAME"."""
    parts = set(map(int, deck.placed))
    labels: dict[str, dict[Name, str]] = {}
    sorts = {sort: dict.fromkeys(named) for sort, named in deck.sets.items()}
    for sort, named in {**sorts, "SURFACE": dict.fromkeys(deck.surfaces)}.items():
        labels[sort] = {}
        for part, name in named:
            if part not in parts:
                continue
            shared = len(deck.instances) > 1 or (0, name) in named
            qualified = part > 0 and part in deck.instances and shared
            labels[sort][part, name] = f"{deck.instances[part]}.{name}" if qualified else name
    return labels


def _chosen(deck: Deck, labels: dict[str, dict[Name, str]], cells: Sequence[str] | None) -> Mask:
    """Which elements are to be cells, as far as they are of the highest dimension."""
    if cells is None:
        return np.isin(deck.element_keys // PART, deck.placed)
    chosen = np.zeros(len(deck.element_keys), dtype=bool)
    by_label = {label: name for name, label in labels["ELSET"].items()}
    for cell_set in cells:
        name = by_label.get(cell_set, by_label.get(capitals(cell_set)))
        if name is None:
            known = ", ".join(by_label) or "none"
            raise ValueError(f"{deck.path}: no ELSET is called {cell_set}; known are {known}")
        chosen[deck.sets["ELSET"][name]] = True
    return chosen


def _left_out(deck: Deck, elements: Mask) -> list[str]:
    counts = np.bincount(deck.kind[elements], minlength=len(deck.kinds))
    words = ", ".join(f"{n} {kind.name}" for kind, n in zip(deck.kinds, counts, strict=True) if n)
    return [f"elements that are neither cells nor facets are left out: {words}"] if words else []


class _Cells:
    """Nodes (n, corners and middles) of the cells, as rows of `x`, in Abaqus' order.

    Attributes:
        x: coordinates (k, dim) of the nodes that cells have.
        node: row of each of the deck's nodes (or -1).
        number: of the cell that each of the deck's elements is (or -1).
        kinds: type of each cell.
    """

    def __init__(self, deck: Deck, chosen: Mask) -> None:
        self.deck = deck
        present = np.bincount(deck.kind[chosen], minlength=len(deck.kinds)) > 0
        kinds = [kind for kind, there in zip(deck.kinds, present, strict=True) if there]
        self.cell, self.degree, self.dim = self._one_kind(kinds)
        width = len(CORNERS[self.cell]) + (len(EDGES[self.cell]) if self.degree > 1 else 0)
        if self.degree > 1 and self.cell == "quadrilateral":
            width += 1
        tables, positions, self.kinds = [], [], list[Kind]()
        for kind, members, nodes in zip(deck.kinds, deck.members, deck.nodes, strict=True):
            own = chosen[members]
            if kind.dim != self.dim or not own.any():
                continue
            rows = np.full((int(own.sum()), width), -1, dtype=np.int64)
            rows[:, : kind.nodes] = deck.node_positions(nodes[own])
            tables.append(rows)
            positions.append(members[own])
            self.kinds += [kind] * len(rows)
        table, self.position = np.concatenate(tables), np.concatenate(positions)
        self.number = np.full(len(deck.element_keys), -1, dtype=np.int64)
        self.number[self.position] = np.arange(len(table))
        used = np.unique(table[table >= 0])
        self.node = np.full(len(deck.node_keys) + 1, -1, dtype=np.int64)
        self.node[used] = np.arange(len(used))
        self.nodes = self.node[table]  # the last entry of node stays -1
        self._keys = deck.node_keys[used]
        self._check_nodes()
        self.x = np.ascontiguousarray(deck.x[used][:, self._axes(deck.x[used])])

    def _one_kind(self, kinds: list[Kind]) -> tuple[str, int, int]:
        path = self.deck.path
        unread = sorted(kind.name for kind in kinds if not kind.dim and not kind.optional)
        if unread:
            raise ValueError(
                f"{path}: elements {', '.join(unread)} are not read, since DOLFINx has no such "
                "cells; from_file(path, cells=NAME) reads those of an ELSET alone"
            )
        dim = max((kind.dim for kind in kinds), default=0)
        found = {(kind.cell, kind.degree) for kind in kinds if kind.dim == dim > 0}
        if dim < 2 or len(found) > 1:
            words = " and ".join(sorted(f"{cell}s of degree {n}" for cell, n in found)) or "none"
            others = ", ".join(sorted({kind.name for kind in kinds})[:6])
            advice = f", but {others}" if others else ""
            if dim > 1:
                advice = "; from_file(path, cells=NAME) reads those of an ELSET"
            raise ValueError(
                f"{path}: a mesh has plane or solid cells of one kind, here are {words}{advice}"
            )
        ((cell, degree),) = found
        return cell, degree, dim

    def _element(self, cell: int) -> str:
        return self.deck.number(self.deck.element_keys[self.position[cell]])

    def _node(self, node: int) -> str:
        return self.deck.number(self._keys[node])

    def _check_nodes(self) -> None:
        """Refuse nodes and cells that are there twice, and edges whose nodes are not one's."""
        path, corners = self.deck.path, len(CORNERS[self.cell])
        rows = np.sort(self.nodes, axis=1)
        cell, column = np.nonzero((np.diff(rows, axis=1) == 0) & (rows[:, 1:] >= 0))
        if len(cell):
            node = self._node(rows[cell[0], column[0]])
            raise ValueError(
                f"{path}: element {self._element(cell[0])} has the node {node} twice: collapsed "
                "cells are not read"
            )
        rows = np.sort(self.nodes[:, :corners], axis=1)
        order = np.lexsort(rows.T)
        same = np.flatnonzero((np.diff(rows[order], axis=0) == 0).all(axis=1))
        if len(same):
            first, second = sorted(order[same[0] : same[0] + 2])
            raise ValueError(
                f"{path}: elements {self._element(first)} and {self._element(second)} have the "
                "same corners: one cell is given twice"
            )
        if self.degree == 1:
            return
        middles = self.nodes[:, corners : corners + len(EDGES[self.cell])]
        both = np.intersect1d(middles, self.nodes[:, :corners])
        if len(both):
            raise ValueError(
                f"{path}: node {self._node(both[0])} is a corner of one element and in the middle "
                "of another's edge"
            )
        ends = np.array([[int(c) for c in edge] for edge in EDGES[self.cell]])
        pairs = np.sort(self.nodes[:, ends], axis=2).reshape(-1, 2)
        order = np.lexsort(pairs.T)
        pairs, middle = pairs[order], middles.ravel()[order]
        torn = (np.diff(pairs, axis=0) == 0).all(axis=1) & (np.diff(middle) != 0)
        if torn.any():
            k = int(np.flatnonzero(torn)[0])
            a, b, c, d = (self._node(n) for n in (*pairs[k], *middle[k : k + 2]))
            raise ValueError(
                f"{path}: the edge between nodes {a} and {b} has the node {c} in one element and "
                f"{d} in another"
            )
        order = np.argsort(middle, kind="stable")
        pairs, middle = pairs[order], middle[order]
        shared = (np.diff(middle) == 0) & (np.diff(pairs, axis=0) != 0).any(axis=1)
        if shared.any():
            node = self._node(middle[np.flatnonzero(shared)[0]])
            raise ValueError(f"{path}: node {node} is in the middle of two edges")

    def _axes(self, x: Array) -> list[int]:
        """Which coordinates are those of the mesh."""
        if self.dim == 3:
            return [0, 1, 2]
        extent = np.ptp(x, axis=0)
        flat = extent <= FLATNESS * extent.max()
        shells = all(kind.shell for kind in set(self.kinds))
        for constant, axes in ((2, [0, 1]), (1, [0, 2]), (0, [1, 2])):
            if flat[constant] and (shells or constant == 2):
                if constant < 2:
                    a, b, c = ("xyz"[k] for k in (*axes, constant))
                    self.deck.notes.append(
                        f"the shells lie in a plane {c} = {x[0, constant]:g}: {a} and {b} are the "
                        "mesh's x and y"
                    )
                return axes
        raise ValueError(
            f"{self.deck.path} has plane cells that do not lie in one plane z = constant; shells "
            "may lie in a plane x, y or z = constant: turn the nodes into one"
        )

    def completed(self, facets: "_Facets", notes: list[str]) -> tuple[Array, Indices]:
        """Return nodes and cells with those in the middle of faces and cells added."""
        x, nodes = self.x, self.nodes
        if self.degree == 1 or len(CORNERS[self.cell]) == self.dim + 1:
            return x, nodes
        if self.cell == "quadrilateral":
            missing = np.flatnonzero(nodes[:, 8] < 0)
            if len(missing):
                nodes = nodes.copy()
                nodes[missing, 8] = len(x) + np.arange(len(missing))
                x = np.concatenate([x, self._middles(nodes[missing, :4], nodes[missing, 4:8])])
                notes.append(f"{len(missing)} cells of 8 nodes have got a ninth in their middle")
            return x, nodes
        corners = self.nodes[facets.first_cell[:, None], facets.face_corners[facets.first_side]]
        middles = self.nodes[facets.first_cell[:, None], facets.face_middles[facets.first_side]]
        of_faces = self._middles(corners, middles)
        centre = x[nodes[:, 8:]].sum(axis=1) / 4 - x[nodes[:, :8]].sum(axis=1) / 4
        on_faces = len(x) + facets.of_cell
        inside = len(x) + len(of_faces) + np.arange(len(nodes))
        notes.append(
            f"{len(nodes)} cells of 20 nodes have got 7 more, in the middle of faces and cells"
        )
        return np.concatenate([x, of_faces, centre]), np.hstack([nodes, on_faces, inside[:, None]])

    def _middles(self, corners: Indices, middles: Indices) -> Array:
        """Places (n, dim) that shape functions of 8 nodes give the middle of a face."""
        return self.x[middles].sum(axis=1) / 2 - self.x[corners].sum(axis=1) / 4


class _Facets:
    """Facets of the cells, each once, by their corners in ascending order.

    Attributes:
        corners: nodes (m, corners of a facet).
        of_cell: numbers (n, facets of a cell) in the order S1, S2 ...
        outer: whether a facet has one cell (m,).
        first_cell, first_side: a cell that has the facet, and which of its facets it is (m,).
        of_element: facet that each of the deck's elements is (or -1).
    """

    def __init__(self, cells: _Cells) -> None:
        self._cells = cells
        kind, count = cells.cell, len(cells.nodes)
        self.face_corners = np.array([[int(c) for c in face] for face in FACES[kind]])
        edges = [set(edge) for edge in EDGES[kind]]
        self.face_middles = len(CORNERS[kind]) + np.array(
            [[k for k, edge in enumerate(edges) if edge <= set(face)] for face in FACES[kind]]
        )
        rows = np.sort(cells.nodes[:, self.face_corners], axis=2)
        rows = rows.reshape(-1, self.face_corners.shape[1])
        self.corners, first, inverse, times = np.unique(
            rows, axis=0, return_index=True, return_inverse=True, return_counts=True
        )
        self.of_cell = inverse.reshape(count, -1)
        self.outer = times == 1
        self.first_cell, self.first_side = np.divmod(first, len(self.face_corners))
        columns = self.face_corners
        if cells.degree > 1:
            columns = np.hstack([self.face_corners, self.face_middles])
        self.nodes = cells.nodes[self.first_cell[:, None], columns[self.first_side]]
        self.of_element = np.full(len(cells.deck.element_keys), -1, dtype=np.int64)

    def find_skin(self, placed: Mask) -> None:
        """Find the facets that elements of one dimension less are."""
        cells, deck = self._cells, self._cells.deck
        corner = np.zeros(len(cells.x) + 1, dtype=bool)
        corner[cells.nodes[:, : len(CORNERS[cells.cell])]] = True
        size = self.corners.shape[1]
        for kind, members, keys in zip(deck.kinds, deck.members, deck.nodes, strict=True):
            if kind.dim != cells.dim - 1 or not placed[members].any():
                continue
            elements = members[placed[members]]
            nodes = cells.node[deck.node_positions(keys[placed[members]])]
            at_corner = corner[nodes] & (nodes >= 0)
            whole = at_corner.sum(axis=1) == size
            elements, nodes, at_corner = elements[whole], nodes[whole], at_corner[whole]
            rows = np.sort(nodes[at_corner].reshape(-1, size), axis=1)
            inverse = np.unique(np.concatenate([self.corners, rows]), axis=0, return_inverse=True)[
                1
            ]
            inverse = inverse.ravel()
            facet_of = np.full(inverse.max() + 1, -1, dtype=np.int64)
            facet_of[inverse[: len(self.corners)]] = np.arange(len(self.corners))
            facet = facet_of[inverse[len(self.corners) :]]
            inside = (nodes[:, :, None] == self.nodes[facet][:, None]).any(axis=2).all(axis=1)
            self.of_element[elements] = np.where(inside & (facet >= 0), facet, -1)

    def with_all_nodes_in(self, sets: list[Indices]) -> list[Indices]:
        """Return the outer facets all of whose nodes are in each of the sets of nodes."""
        outer = np.flatnonzero(self.outer)
        size = self.nodes.shape[1]
        columns = np.repeat(np.arange(len(outer)), size)
        shape = (len(self._cells.x), len(outer))
        ones = np.ones(len(columns), dtype=np.int32)
        at_node = sp.csr_matrix((ones, (self.nodes[outer].ravel(), columns)), shape)
        pairs = np.diff(at_node.indptr)
        cost = np.cumsum([int(pairs[members].sum()) for members in sets])
        batch = cost // MAX_PAIRS
        found: list[Indices] = []
        for number in np.unique(batch):
            own = [sets[k] for k in np.flatnonzero(batch == number)]
            pointers = np.concatenate([[0], np.cumsum([len(members) for members in own])])
            members = np.concatenate(own)
            ones = np.ones(len(members), dtype=np.int32)
            of_sets = sp.csr_matrix((ones, members, pointers), (len(own), shape[0]))
            count = (of_sets @ at_node).tocsr()
            whole = count.data == size
            ends = np.concatenate([[0], np.cumsum(whole)])[count.indptr]
            found += np.split(outer[count.indices[whole]], ends[1:-1])
        return found


class _Sets:
    """Members of the named sets, less sets without any and those that begin with an underscore.

    Attributes:
        cells: cells of each set.
        facets: facets of each set; a SURFACE goes before an ELSET, this before an NSET of the name.
        notes: what is not a facet.
    """

    def __init__(
        self, deck: Deck, labels: dict[str, dict[Name, str]], cells: _Cells, facets: _Facets
    ) -> None:
        self._deck, self._cells, self._facets = deck, cells, facets
        self._shell = np.array([kind.shell for kind in cells.kinds])
        self._of_shells: dict[str, None] = {}
        self.cells: dict[str, Indices] = {}
        self.facets: dict[str, Indices] = {}
        own = {
            sort: {name: label for name, label in named.items() if not name[1].startswith("_")}
            for sort, named in labels.items()
        }
        node_sets = {("NSET", name): deck.sets["NSET"][name] for name in own["NSET"]}
        for name in own["SURFACE"]:
            if nodes := [part.members for part in deck.surfaces[name] if part.sort == "NSET"]:
                node_sets["SURFACE", name] = np.unique(np.concatenate(nodes))
        rows = [cells.node[members] for members in node_sets.values()]
        found = facets.with_all_nodes_in([row[row >= 0] for row in rows])
        of_nodes = dict(zip(node_sets, found, strict=True))
        for name, label in own["NSET"].items():
            self._add(self.facets, label, of_nodes["NSET", name])
        for name, label in own["ELSET"].items():
            self._add(self.cells, label, cells.number[deck.sets["ELSET"][name]])
            self._add(self.facets, label, facets.of_element[deck.sets["ELSET"][name]])
        for name, label in own["SURFACE"].items():
            parts = [part for part in deck.surfaces[name] if part.sort == "ELSET"]
            chunks = [self._of_faces(part, label) for part in parts]
            chunks += [of_nodes[key] for key in [("SURFACE", name)] if key in of_nodes]
            self._add(self.facets, label, np.concatenate([facets.of_cell[:0, 0], *chunks]))
        self.notes = [
            f"{name} has sides of shells, which are no facets" for name in self._of_shells
        ]

    def _add(self, sets: dict[str, Indices], label: str, members: Indices) -> None:
        members = unique(members[members >= 0])
        if len(members):
            sets[label] = members

    def _of_faces(self, part: SurfacePart, label: str) -> Indices:
        """Facets that the elements of a surface are, and those that are faces of its cells."""
        facets, number = self._facets, self._cells.number[part.members]
        chunks = [facets.of_element[part.members]]
        for shell in (False, True):
            cells = number[(number >= 0) & (self._shell[number] == shell)]
            if not len(cells):
                continue
            sides = _face_names(self._cells.cell, shell)
            if not part.face:
                free = facets.of_cell[cells]
                chunks.append(free[facets.outer[free]])
            elif part.face in sides:
                chunks.append(facets.of_cell[cells, sides[part.face]])
            elif shell and part.face in SHELL_SIDES:
                self._of_shells.setdefault(label)
            else:
                raise ValueError(
                    f"{self._deck.path}: a surface has faces {part.face}; a {self._cells.cell} "
                    f"has {[*sides]}"
                )
        return np.concatenate(chunks)


def _face_names(cell: str, shell: bool) -> dict[str, int]:
    """Return the number of each face by its name; a shell's, which are edges, have two names."""
    count = len(FACES[cell])
    if not shell:
        return {f"S{k + 1}": k for k in range(count)}
    return {f"E{k + 1}": k for k in range(count)} | {f"S{k + 3}": k for k in range(count)}


def _dolfinx_order(cell: str, degree: int) -> tuple[list[int], list[int]]:
    """Columns of a cell's nodes, and of its facets, in DOLFINx' order."""
    corners = CORNERS[cell]
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    topology = basix.topology(basix.CellType[cell])
    faces = [set(map(int, face)) for face in FACES[cell]]
    sides = [faces.index({corners[k] for k in facet}) for facet in topology[dim - 1]]
    columns = [*corners]
    if degree > 1:
        edges = [set(map(int, edge)) for edge in EDGES[cell]]
        columns += [len(columns) + edges.index({corners[k] for k in edge}) for edge in topology[1]]
        if cell == "hexahedron":
            columns += [len(columns) + side for side in sides]
        if len(corners) != dim + 1:
            columns.append(len(columns))
    return columns, sides


def _numbered(sets: dict[str, Indices], count: int) -> tuple[Indices, Tags]:
    """Tags (count,) that tell in which of the sets each member is, from 1, and those of a set."""
    codes = np.zeros(count, dtype=np.int64)
    last = 0
    for members in sets.values():
        known, inverse = np.unique(codes[members], return_inverse=True)
        codes[members] = last + 1 + inverse
        last += len(known)
    tags = np.unique(codes[codes > 0])
    tag = np.zeros(last + 1, dtype=np.int64)
    tag[tags] = np.arange(1, len(tags) + 1)
    numbers = tag[codes]
    return numbers, {name: tuple(map(int, unique(numbers[own]))) for name, own in sets.items()}

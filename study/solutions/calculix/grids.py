"""Structured meshes of standard elements, numbered as in CalculiX; they do not need DOLFINx."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product

Point = tuple[float, ...]
PointMarker = Callable[[Point], bool]
LatticeIndex = tuple[int, ...]  # index of a node, in half divisions along each axis

# Corners of each edge and of each face, in CalculiX's order; mid-side nodes follow the corners
_EDGES = {
    "T6": [(0, 1), (1, 2), (2, 0)],
    "Q8": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "T10": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
}
_FACES: dict[str, list[tuple[int, ...]]] = {
    "T6": [(0, 1), (1, 2), (2, 0)],
    "Q8": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "T10": [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)],
}


def _split_unit_cube_into_tetrahedra() -> list[list[LatticeIndex]]:
    """Return the corners of six tetrahedra of positive volume around a unit cube's diagonal."""
    tetrahedra = []
    for axes in permutations(range(3)):
        corner = [0, 0, 0]
        path: list[LatticeIndex] = [(0, 0, 0)]
        for axis in axes:
            corner[axis] = 1
            path.append(tuple(corner))
        is_negative = axes in ((0, 2, 1), (1, 0, 2), (2, 1, 0))
        tetrahedra.append([path[0], path[2], path[1], path[3]] if is_negative else path)
    return tetrahedra


# Corners of the elements in a unit square or cube
_UNIT_CELLS: dict[str, list[list[LatticeIndex]]] = {
    "T6": [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]],
    "Q8": [[(0, 0), (1, 0), (1, 1), (0, 1)]],
    "T10": _split_unit_cube_into_tetrahedra(),
}


@dataclass(frozen=True)
class Grid:
    """Structured mesh of a rectangle or box: two triangles per square, six tetrahedra per cube.

    Nodes and elements are numbered from 1, along x first.

    Args:
        cell: "T6", "Q8" or "T10".
        lower: Corner with the lowest coordinates.
        upper: Corner with the highest coordinates.
        divisions: Numbers of squares or cubes along each axis.
        bulge: Relative increase of the dimensions across x in the middle of the length. Element
            sides are then curved, because mid-side nodes are moved as well.
    """

    cell: str
    lower: Point
    upper: Point
    divisions: LatticeIndex
    bulge: float = 0.0

    @cached_property
    def nodes_without_bulge(self) -> list[Point]:
        """Coordinates of the nodes before the bulge is applied; node k is entry k - 1."""
        axes = list(zip(self.lower, self.upper, self.divisions, strict=True))
        return [
            tuple(a + (b - a) * i / (2 * n) for i, (a, b, n) in zip(index, axes, strict=True))
            for index in self._node_numbers
        ]

    @cached_property
    def nodes(self) -> list[Point]:
        """Coordinates of the nodes; node k is entry k - 1."""
        return [self.move_point_by_bulge(point) for point in self.nodes_without_bulge]

    @cached_property
    def elements(self) -> list[list[int]]:
        """Node numbers of the elements: corners, then mid-side nodes."""
        return [
            [self._node_numbers[index] for index in cell]
            for cell in self._lattice_indices_of_element_nodes
        ]

    def move_point_by_bulge(self, point: Point) -> Point:
        """Return the position to which the bulge moves a point of the straight rectangle or box."""
        start, length = self.lower[0], self.upper[0] - self.lower[0]
        s = (point[0] - start) / length
        widening = 1 + 4 * self.bulge * s * (1 - s)
        middles = [(a + b) / 2 for a, b in zip(self.lower, self.upper, strict=True)]
        across = [m + widening * (x - m) for x, m in zip(point[1:], middles[1:], strict=True)]
        return (point[0], *across)

    def find_nodes(self, is_marked: PointMarker) -> list[int]:
        """Return the numbers of the nodes whose positions without the bulge are marked."""
        return [k for k, point in enumerate(self.nodes_without_bulge, start=1) if is_marked(point)]

    def find_marked_faces(self, is_marked: PointMarker) -> list[tuple[int, int]]:
        """Return the element and face number of each face whose corners are all marked."""
        is_marked_node = [is_marked(point) for point in self.nodes_without_bulge]
        return [
            (k, number)
            for k, cell in enumerate(self.elements, start=1)
            for number, face in enumerate(_FACES[self.cell], start=1)
            if all(is_marked_node[cell[corner] - 1] for corner in face)
        ]

    def nodes_of_face(self, element: int, face_number: int) -> list[int]:
        """Return the node numbers of a face of an element: corners, then mid-side nodes.

        Args:
            element: Number of the element, from 1.
            face_number: CalculiX' number of the face, from 1.
        """
        cell, corners = self.elements[element - 1], set(_FACES[self.cell][face_number - 1])
        start = len(cell) - len(_EDGES[self.cell])
        middles = [start + k for k, e in enumerate(_EDGES[self.cell]) if corners.issuperset(e)]
        return [cell[k] for k in [*_FACES[self.cell][face_number - 1], *middles]]

    @property
    def corner_nodes(self) -> list[int]:
        """Sorted numbers of the nodes at corners of elements."""
        start = len(self.elements[0]) - len(_EDGES[self.cell])
        return sorted({node for cell in self.elements for node in cell[:start]})

    @cached_property
    def _lattice_indices_of_element_nodes(self) -> list[list[LatticeIndex]]:
        """Lattice indices (in half divisions along each axis) of the nodes of each element."""
        cells = []
        for origin in product(*(range(n) for n in reversed(self.divisions))):
            for steps in _UNIT_CELLS[self.cell]:
                corners = [
                    tuple(2 * (o + s) for o, s in zip(reversed(origin), step, strict=True))
                    for step in steps
                ]
                edges = [(corners[a], corners[b]) for a, b in _EDGES[self.cell]]
                cells.append(corners + [_lattice_midpoint(*edge) for edge in edges])
        return cells

    @cached_property
    def _node_numbers(self) -> dict[LatticeIndex, int]:
        """Node numbers by lattice index (in half divisions along each axis)."""
        used = {index for cell in self._lattice_indices_of_element_nodes for index in cell}
        ordered = sorted(used, key=lambda index: index[::-1])
        return {index: k for k, index in enumerate(ordered, start=1)}


def _lattice_midpoint(a: LatticeIndex, b: LatticeIndex) -> LatticeIndex:
    return tuple((p + q) // 2 for p, q in zip(a, b, strict=True))

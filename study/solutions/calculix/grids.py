"""Structured meshes of standard elements in CalculiX's numbering; needs no DOLFINx."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product

Place = tuple[float, ...]
Where = Callable[[Place], bool]
Index = tuple[int, ...]  # in the lattice of half divisions

# Corners of each edge, whose middles follow the corners, and of each face, in CalculiX's order
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


def _tetrahedra() -> list[list[Index]]:
    """Six with the cube's main diagonal in common, none of them inside out."""
    found = []
    for axes in permutations(range(3)):
        corner = [0, 0, 0]
        path: list[Index] = [(0, 0, 0)]
        for axis in axes:
            corner[axis] = 1
            path.append(tuple(corner))
        odd = axes in ((0, 2, 1), (1, 0, 2), (2, 1, 0))
        found.append([path[0], path[2], path[1], path[3]] if odd else path)
    return found


# Corners of the cells of a unit square or cube
_CELLS: dict[str, list[list[Index]]] = {
    "T6": [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]],
    "Q8": [[(0, 0), (1, 0), (1, 1), (0, 1)]],
    "T10": _tetrahedra(),
}


@dataclass(frozen=True)
class Grid:
    """Rectangle or box; two triangles fill a square, six tetrahedra a cube.

    Nodes and elements count from 1 and along x first.

    Args:
        cell: "T6", "Q8" or "T10".
        lower: lowest coordinates.
        upper: highest ones.
        divisions: squares or cubes along each axis.
        bulge: how much wider the middle of its length (along x) is than the ends, as a part.
            Sides are curved then: mid-side nodes move too.
    """

    cell: str
    lower: Place
    upper: Place
    divisions: Index
    bulge: float = 0.0

    @cached_property
    def places(self) -> list[Place]:
        """Coordinates of the nodes before it bulges; node k is entry k - 1."""
        axes = list(zip(self.lower, self.upper, self.divisions, strict=True))
        return [
            tuple(a + (b - a) * i / (2 * n) for i, (a, b, n) in zip(index, axes, strict=True))
            for index in self._numbers
        ]

    @cached_property
    def nodes(self) -> list[Place]:
        """Coordinates of the nodes; node k is entry k - 1."""
        return [self.bulged(place) for place in self.places]

    @cached_property
    def elements(self) -> list[list[int]]:
        """Corner nodes, then those in the middles of edges."""
        return [[self._numbers[index] for index in cell] for cell in self._cells]

    def bulged(self, place: Place) -> Place:
        """Where a place of the box without bulge is."""
        start, length = self.lower[0], self.upper[0] - self.lower[0]
        s = (place[0] - start) / length
        wider = 1 + 4 * self.bulge * s * (1 - s)
        middles = [(a + b) / 2 for a, b in zip(self.lower, self.upper, strict=True)]
        across = [m + wider * (x - m) for x, m in zip(place[1:], middles[1:], strict=True)]
        return (place[0], *across)

    def nodes_where(self, where: Where) -> list[int]:
        """Nodes at whose place, without bulge, a marker holds."""
        return [k for k, place in enumerate(self.places, start=1) if where(place)]

    def faces_where(self, where: Where) -> list[tuple[int, int]]:
        """Elements, and numbers of their faces at all corners of which a marker holds."""
        holds = [where(place) for place in self.places]
        return [
            (k, number)
            for k, cell in enumerate(self.elements, start=1)
            for number, face in enumerate(_FACES[self.cell], start=1)
            if all(holds[cell[corner] - 1] for corner in face)
        ]

    def face(self, element: int, number: int) -> list[int]:
        """Nodes of a face: its corners, then those in the middles of its edges."""
        cell, corners = self.elements[element - 1], set(_FACES[self.cell][number - 1])
        start = len(cell) - len(_EDGES[self.cell])
        middles = [start + k for k, e in enumerate(_EDGES[self.cell]) if corners.issuperset(e)]
        return [cell[k] for k in [*_FACES[self.cell][number - 1], *middles]]

    @property
    def corners(self) -> list[int]:
        """Nodes at corners of elements."""
        start = len(self.elements[0]) - len(_EDGES[self.cell])
        return sorted({node for cell in self.elements for node in cell[:start]})

    @cached_property
    def _cells(self) -> list[list[Index]]:
        """Lattice indices of each element's nodes."""
        cells = []
        for origin in product(*(range(n) for n in reversed(self.divisions))):
            for steps in _CELLS[self.cell]:
                corners = [
                    tuple(2 * (o + s) for o, s in zip(reversed(origin), step, strict=True))
                    for step in steps
                ]
                edges = [(corners[a], corners[b]) for a, b in _EDGES[self.cell]]
                cells.append(corners + [_middle(*edge) for edge in edges])
        return cells

    @cached_property
    def _numbers(self) -> dict[Index, int]:
        """Numbers of the nodes by their lattice indices."""
        used = {index for cell in self._cells for index in cell}
        ordered = sorted(used, key=lambda index: index[::-1])
        return {index: k for k, index in enumerate(ordered, start=1)}


def _middle(a: Index, b: Index) -> Index:
    return tuple((p + q) // 2 for p, q in zip(a, b, strict=True))

"""Gmsh's types of elements: cell, degree and nodes of each, and which of them can be cells here."""

from typing import NamedTuple

_PLURALS = {"tetrahedron": "tetrahedra", "hexahedron": "hexahedra"}
_N_CORNERS = {"point": 1, "line": 2, "triangle": 3, "quadrilateral": 4, "tetrahedron": 4}
_N_CORNERS |= {"pyramid": 5, "prism": 6, "hexahedron": 8}


class Kind(NamedTuple):
    """Dimension, cell, degree of the geometry, and nodes of a type of element."""

    dim: int
    cell: str
    degree: int
    n_nodes: int

    @property
    def n_corners(self) -> int:
        return _N_CORNERS[self.cell]

    def describe(self) -> str:
        """Return words for such elements: "triangles of degree 2 (6 nodes)"."""
        plural = _PLURALS.get(self.cell, f"{self.cell}s")
        return f"{plural} of degree {self.degree} ({self.n_nodes} nodes)"


# By Gmsh's number, up to degree 5; the second of each degree has no nodes within cell or faces.
# "Gmsh Reference Manual", version 4.13, section "MSH file format"
_LINES = {1: 1, 8: 2, 26: 3, 27: 4, 28: 5}
_TRIANGLES = {2: 1, 9: 2, 21: 3, 23: 4, 25: 5}
_QUADRILATERALS = {3: 1, 10: 2, 36: 3, 37: 4, 38: 5}
_TETRAHEDRA = {4: 1, 11: 2, 29: 3, 30: 4, 31: 5}
_HEXAHEDRA = {5: 1, 12: 2, 92: 3, 93: 4, 94: 5}
_KINDS = {
    15: Kind(0, "point", 0, 1),
    **{t: Kind(1, "line", k, k + 1) for t, k in _LINES.items()},
    **{t: Kind(2, "triangle", k, (k + 1) * (k + 2) // 2) for t, k in _TRIANGLES.items()},
    **{t: Kind(2, "triangle", k, 3 * k) for t, k in {20: 3, 22: 4, 24: 5}.items()},
    **{t: Kind(2, "quadrilateral", k, (k + 1) ** 2) for t, k in _QUADRILATERALS.items()},
    **{t: Kind(2, "quadrilateral", k, 4 * k) for t, k in {16: 2, 39: 3, 40: 4, 41: 5}.items()},
    **{
        t: Kind(3, "tetrahedron", k, (k + 1) * (k + 2) * (k + 3) // 6)
        for t, k in _TETRAHEDRA.items()
    },
    **{t: Kind(3, "hexahedron", k, (k + 1) ** 3) for t, k in _HEXAHEDRA.items()},
    17: Kind(3, "hexahedron", 2, 20),
    6: Kind(3, "prism", 1, 6),
    13: Kind(3, "prism", 2, 18),
    18: Kind(3, "prism", 2, 15),
    90: Kind(3, "prism", 3, 40),
    7: Kind(3, "pyramid", 1, 5),
    14: Kind(3, "pyramid", 2, 14),
    19: Kind(3, "pyramid", 2, 13),
    118: Kind(3, "pyramid", 3, 30),
}
# Types that a mesh can have as its cells
CELL_TYPES = (2, 3, 4, 5, 9, 10, 11, 12)


def kind_of(number: int) -> Kind:
    """Return what a type of Gmsh's elements is.

    Raises:
        ValueError: for a number that is not known here.
    """
    if number not in _KINDS:
        raise ValueError(f"elements of Gmsh's type {number} are not known")
    return _KINDS[number]

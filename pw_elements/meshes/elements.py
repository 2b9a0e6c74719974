"""Table of Gmsh's element types: dimension, cell type, degree of geometry and number of nodes."""

from typing import NamedTuple

_IRREGULAR_PLURALS_OF_CELL_NAMES = {"tetrahedron": "tetrahedra", "hexahedron": "hexahedra"}
_N_CORNERS_BY_CELL_TYPE = {
    "point": 1,
    "line": 2,
    "triangle": 3,
    "quadrilateral": 4,
    "tetrahedron": 4,
}
_N_CORNERS_BY_CELL_TYPE |= {"pyramid": 5, "prism": 6, "hexahedron": 8}


class GmshElementType(NamedTuple):
    """Element type of Gmsh: dimension, cell type, degree of the geometry and number of nodes."""

    dim: int
    cell: str
    degree: int
    n_nodes: int

    @property
    def n_corners(self) -> int:
        return _N_CORNERS_BY_CELL_TYPE[self.cell]

    def describe(self) -> str:
        """Return a description of the elements, such as "triangles of degree 2 (6 nodes)"."""
        plural = _IRREGULAR_PLURALS_OF_CELL_NAMES.get(self.cell, f"{self.cell}s")
        return f"{plural} of degree {self.degree} ({self.n_nodes} nodes)"


# Element types by Gmsh's number, up to degree 5. If two types have the same cell and degree, the
# second is incomplete: it has no nodes inside cells or faces.
# "Gmsh Reference Manual", version 4.13, section "MSH file format"
_LINE_DEGREE_BY_GMSH_NUMBER = {1: 1, 8: 2, 26: 3, 27: 4, 28: 5}
_TRIANGLE_DEGREE_BY_GMSH_NUMBER = {2: 1, 9: 2, 21: 3, 23: 4, 25: 5}
_QUADRILATERAL_DEGREE_BY_GMSH_NUMBER = {3: 1, 10: 2, 36: 3, 37: 4, 38: 5}
_TETRAHEDRON_DEGREE_BY_GMSH_NUMBER = {4: 1, 11: 2, 29: 3, 30: 4, 31: 5}
_HEXAHEDRON_DEGREE_BY_GMSH_NUMBER = {5: 1, 12: 2, 92: 3, 93: 4, 94: 5}
_ELEMENT_TYPE_BY_GMSH_NUMBER = {
    15: GmshElementType(0, "point", 0, 1),
    **{t: GmshElementType(1, "line", k, k + 1) for t, k in _LINE_DEGREE_BY_GMSH_NUMBER.items()},
    **{
        t: GmshElementType(2, "triangle", k, (k + 1) * (k + 2) // 2)
        for t, k in _TRIANGLE_DEGREE_BY_GMSH_NUMBER.items()
    },
    **{t: GmshElementType(2, "triangle", k, 3 * k) for t, k in {20: 3, 22: 4, 24: 5}.items()},
    **{
        t: GmshElementType(2, "quadrilateral", k, (k + 1) ** 2)
        for t, k in _QUADRILATERAL_DEGREE_BY_GMSH_NUMBER.items()
    },
    **{
        t: GmshElementType(2, "quadrilateral", k, 4 * k)
        for t, k in {16: 2, 39: 3, 40: 4, 41: 5}.items()
    },
    **{
        t: GmshElementType(3, "tetrahedron", k, (k + 1) * (k + 2) * (k + 3) // 6)
        for t, k in _TETRAHEDRON_DEGREE_BY_GMSH_NUMBER.items()
    },
    **{
        t: GmshElementType(3, "hexahedron", k, (k + 1) ** 3)
        for t, k in _HEXAHEDRON_DEGREE_BY_GMSH_NUMBER.items()
    },
    17: GmshElementType(3, "hexahedron", 2, 20),
    6: GmshElementType(3, "prism", 1, 6),
    13: GmshElementType(3, "prism", 2, 18),
    18: GmshElementType(3, "prism", 2, 15),
    90: GmshElementType(3, "prism", 3, 40),
    7: GmshElementType(3, "pyramid", 1, 5),
    14: GmshElementType(3, "pyramid", 2, 14),
    19: GmshElementType(3, "pyramid", 2, 13),
    118: GmshElementType(3, "pyramid", 3, 30),
}
# Gmsh's numbers of the element types that are supported as cells of a mesh
GMSH_NUMBERS_OF_SUPPORTED_CELLS = (2, 3, 4, 5, 9, 10, 11, 12)


def gmsh_element_type(number: int) -> GmshElementType:
    """Return the element type with a given number in Gmsh.

    Raises:
        ValueError: if the number is unknown.
    """
    if number not in _ELEMENT_TYPE_BY_GMSH_NUMBER:
        raise ValueError(f"elements of Gmsh's type {number} are not known")
    return _ELEMENT_TYPE_BY_GMSH_NUMBER[number]

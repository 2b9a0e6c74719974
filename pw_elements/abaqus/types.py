"""Element types of Abaqus and CalculiX, and the corresponding cells of DOLFINx.

Nodes and faces are numbered as in the "Abaqus Analysis User's Guide", part VI, and in G. Dhondt,
"CalculiX CrunchiX User's Manual", version 2.20, section 6.2. In each element, the corners come
first, then the mid-side nodes.
"""

import re
from typing import NamedTuple

# Corners of the faces S1, S2 ... of a cell; in shells and membranes, of the edges E1, E2 ...
ABAQUS_FACE_CORNERS = {
    "triangle": ("01", "12", "20"),
    "quadrilateral": ("01", "12", "23", "30"),
    "tetrahedron": ("012", "031", "132", "230"),
    "hexahedron": ("0123", "4765", "0451", "1562", "2673", "3740"),
}
# Corners of the edges, in the order of the mid-side nodes
ABAQUS_EDGE_CORNERS = {
    "triangle": ("01", "12", "20"),
    "quadrilateral": ("01", "12", "23", "30"),
    "tetrahedron": ("01", "12", "20", "03", "13", "23"),
    "hexahedron": ("01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"),
}


class AbaqusElementType(NamedTuple):
    """Element type of Abaqus or CalculiX.

    Args:
        name: name of the type, such as "C3D20R".
        n_nodes: number of nodes; 0 if it is unknown or varies.
        dim: dimension of the cell; 0 for types that are not supported.
        cell: DOLFINx' name of the cell type.
        degree: degree of the geometry.
        is_shell: whether the type is a shell or membrane, which may lie in any coordinate plane.
        is_optional: whether elements of this type may be left out because they are not part of a
            solid body (springs, masses ...).
    """

    name: str
    n_nodes: int
    dim: int = 0
    cell: str = ""
    degree: int = 0
    is_shell: bool = False
    is_optional: bool = False


SOLID_CELLS_BY_NODE_COUNT = {
    "4": (4, 3, "tetrahedron", 1),
    "8": (8, 3, "hexahedron", 1),
    "10": (10, 3, "tetrahedron", 2),
    "20": (20, 3, "hexahedron", 2),
}
PLANE_CELLS_BY_NODE_COUNT = {
    "3": (3, 2, "triangle", 1),
    "4": (4, 2, "quadrilateral", 1),
    "6": (6, 2, "triangle", 2),
    "8": (8, 2, "quadrilateral", 2),
}
SHELL_CELLS_BY_NODE_COUNT = PLANE_CELLS_BY_NODE_COUNT | {
    "65": PLANE_CELLS_BY_NODE_COUNT["6"],
    "9": (9, 2, "quadrilateral", 2),
}
LINE_CELLS_BY_NODE_COUNT = {"2": (2, 1, "interval", 1), "3": (3, 1, "interval", 2)}
SUPPORTED_ELEMENT_NAME_PATTERNS = (
    (re.compile(r"[AD]?C3D(\d+)[A-Z]*"), SOLID_CELLS_BY_NODE_COUNT),
    (re.compile(r"(?:CPS|CPEG?|CG?AX|[AD]C2D|[AD]CAX)(\d+)[A-Z]*"), PLANE_CELLS_BY_NODE_COUNT),
    (re.compile(r"(?:S|STRI|DS|SFM3D|M3D)(\d+)[A-Z]*\d?"), SHELL_CELLS_BY_NODE_COUNT),
    (re.compile(r"T[23]D(\d)[A-Z]*"), LINE_CELLS_BY_NODE_COUNT),
)
# Types that are not part of a solid body, with their numbers of nodes (0 if the number varies)
NON_BODY_ELEMENT_NAME_PATTERNS = (
    (re.compile("MASS|ROTARYI|SPRING1|DASHPOT1|DCOUP[23]D|HEATCAP"), 1),
    (re.compile("SPRING[2A]|DASHPOT[2A]|GAPUNI|GAPCYL|GAPSPHER|CONN[23]D2|R2D2|RAX2"), 2),
    (re.compile(r"B[23]1[A-Z]*|PIPE[23]1H?|[SM]AX1|FRAME[23]D"), 2),
    (re.compile(r"B[23]2[A-Z]*|PIPE[23]2H?|[SM]AX2[A-Z]*|D"), 3),
    (re.compile("B[23]3H?"), 2),
    (re.compile("R3D3"), 3),
    (re.compile("R3D4"), 4),
    (re.compile(r"(?:ELBOW|JOINT|DRAG|PSI|ITS|ITT|GAP|CONN)[A-Z0-9]*|US?\d+"), 0),
)
_NODE_COUNT_IN_NAME_PATTERN = re.compile(r"[A-Z]*[23]D(?!27|15V)(\d+)[A-Z]*")


def abaqus_element_type(name: str) -> AbaqusElementType:
    """Return the element type with a given name, which has to be in upper case.

    Types that are not supported have dimension 0.
    """
    for pattern, shapes in SUPPORTED_ELEMENT_NAME_PATTERNS:
        match = pattern.fullmatch(name)
        if match and match[1] in shapes:
            return AbaqusElementType(
                name, *shapes[match[1]], is_shell=shapes is SHELL_CELLS_BY_NODE_COUNT
            )
    for pattern, n_nodes in NON_BODY_ELEMENT_NAME_PATTERNS:
        if pattern.fullmatch(name):
            return AbaqusElementType(name, n_nodes, is_optional=True)
    match = _NODE_COUNT_IN_NAME_PATTERN.fullmatch(name)
    return AbaqusElementType(name, int(match[1]) if match else 0)

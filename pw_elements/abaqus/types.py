"""Types of Abaqus' and CalculiX' elements: which cells they are, or whether they may be left out.

Nodes and faces: "Abaqus Analysis User's Guide", part VI; G. Dhondt, "CalculiX CrunchiX User's
Manual", version 2.20, section 6.2. Corners come first, nodes in the middle of edges then.
"""

import re
from typing import NamedTuple

# Faces S1, S2 ... by their corners; of shells and membranes these are the edges E1, E2 ...
FACES = {
    "triangle": ("01", "12", "20"),
    "quadrilateral": ("01", "12", "23", "30"),
    "tetrahedron": ("012", "031", "132", "230"),
    "hexahedron": ("0123", "4765", "0451", "1562", "2673", "3740"),
}
# Edges by their corners, in the order of the nodes in their middles
EDGES = {
    "triangle": ("01", "12", "20"),
    "quadrilateral": ("01", "12", "23", "30"),
    "tetrahedron": ("01", "12", "20", "03", "13", "23"),
    "hexahedron": ("01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"),
}


class Kind(NamedTuple):
    """Type of an element.

    Args:
        name: such as C3D20R.
        nodes: how many a row has; 0 if that is not known or not the same for all.
        dim: of cells; 0 if it is none that is read.
        cell: as DOLFINx calls it.
        degree: of its edges.
        shell: whether it is a shell or membrane, whose plane may be any.
        optional: whether a mesh without it is the same body: springs, beams, masses ...
    """

    name: str
    nodes: int
    dim: int = 0
    cell: str = ""
    degree: int = 0
    shell: bool = False
    optional: bool = False


SOLIDS = {
    "4": (4, 3, "tetrahedron", 1),
    "8": (8, 3, "hexahedron", 1),
    "10": (10, 3, "tetrahedron", 2),
    "20": (20, 3, "hexahedron", 2),
}
PLANE = {
    "3": (3, 2, "triangle", 1),
    "4": (4, 2, "quadrilateral", 1),
    "6": (6, 2, "triangle", 2),
    "8": (8, 2, "quadrilateral", 2),
}
SHELLS = PLANE | {"65": PLANE["6"], "9": (9, 2, "quadrilateral", 2)}
LINES = {"2": (2, 1, "interval", 1), "3": (3, 1, "interval", 2)}
READ = (
    (re.compile(r"[AD]?C3D(\d+)[A-Z]*"), SOLIDS),
    (re.compile(r"(?:CPS|CPEG?|CG?AX|[AD]C2D|[AD]CAX)(\d+)[A-Z]*"), PLANE),
    (re.compile(r"(?:S|STRI|DS|SFM3D|M3D)(\d+)[A-Z]*\d?"), SHELLS),
    (re.compile(r"T[23]D(\d)[A-Z]*"), LINES),
)
# Beside solids these are no part of the body: numbers of their nodes, where it is one for all
OPTIONAL = (
    (re.compile("MASS|ROTARYI|SPRING1|DASHPOT1|DCOUP[23]D|HEATCAP"), 1),
    (re.compile("SPRING[2A]|DASHPOT[2A]|GAPUNI|GAPCYL|GAPSPHER|CONN[23]D2|R2D2|RAX2"), 2),
    (re.compile(r"B[23]1[A-Z]*|PIPE[23]1H?|[SM]AX1|FRAME[23]D"), 2),
    (re.compile(r"B[23]2[A-Z]*|PIPE[23]2H?|[SM]AX2[A-Z]*|D"), 3),
    (re.compile("B[23]3H?"), 2),
    (re.compile("R3D3"), 3),
    (re.compile("R3D4"), 4),
    (re.compile(r"(?:ELBOW|JOINT|DRAG|PSI|ITS|ITT|GAP|CONN)[A-Z0-9]*|US?\d+"), 0),
)
_COUNT = re.compile(r"[A-Z]*[23]D(?!27|15V)(\d+)[A-Z]*")


def kind_of(name: str) -> Kind:
    """Return the kind of a type by its name in capitals, of dimension 0 if it is not read."""
    for pattern, known in READ:
        match = pattern.fullmatch(name)
        if match and match[1] in known:
            return Kind(name, *known[match[1]], shell=known is SHELLS)
    for pattern, nodes in OPTIONAL:
        if pattern.fullmatch(name):
            return Kind(name, nodes, optional=True)
    match = _COUNT.fullmatch(name)
    return Kind(name, int(match[1]) if match else 0)

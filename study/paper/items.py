"""The paper's figures, tables and numbered equations: printed numbers, and where each is treated.

M. Klisiński, Ch. Luo, E. Postek, "Discussion on application of piece-wise linear weight
functions in 2D contact problems", received August 16, 2001.
"""

from dataclasses import dataclass
from typing import Literal

# Critical stresses of modes 1 and 2 in Pa, as printed in Table 2 and below Eq (27)
TABLE_2 = {
    "Euler": (2660e6, 10640e6),
    "CPS6": (2.6208e9, 9.8096e9),
    "CPS6M": (2.6105e9, 9.6683e9),
    "6-node user element": (2.5608e9, 9.1833e9),
}

# The first six eigenvalues as printed in Table 1, without units
TABLE_1 = {
    "CAX6": (36389.0, 1.9319e6, 3.8114e6, 3.9787e6, 5.7680e6, 7.6025e6),
    "6-node user element": (36386.0, 1.9317e6, 3.8104e6, 3.9763e6, 5.7636e6, 7.5964e6),
    "CAX8": (36386.0, 1.9320e6, 3.8113e6, 3.9784e6, 5.7679e6, 7.6010e6),
    "8-node user element": (36390.0, 1.9310e6, 3.8080e6, 3.9723e6, 5.7537e6, 7.5789e6),
}


@dataclass(frozen=True)
class Item:
    """A figure, table or numbered equation.

    Attributes:
        kind: Which of them.
        number: Its number in the paper.
        content: What it shows.
        treated: The module, figure or case that treats it.
    """

    kind: Literal["figure", "table", "equation"]
    number: str
    content: str
    treated: str


def _figure(number: int, content: str, treated: str) -> Item:
    return Item("figure", str(number), content, treated)


def _table(number: int, content: str, treated: str) -> Item:
    return Item("table", str(number), content, treated)


def _equation(number: int, content: str, treated: str) -> Item:
    return Item("equation", str(number), content, treated)


_MECHANICS = "pw_elements/mechanics.py"
_ELEMENTS = "pw_elements/elements.py"

ITEMS = [
    _figure(1, "6-node triangle in the parent domain", "figures/fig01.py"),
    _figure(2, "weight functions of nodes 1 and 4", "figures/fig02.py"),
    _figure(3, "two triangles make an 8-node quadrilateral", "figures/fig03.py"),
    _figure(4, "the structure of two triangles", "figures/fig04.py"),
    _figure(5, "its reactions by both methods", "figures/fig05.py"),
    _figure(6, "elastic block on a rigid foundation", "figures/fig06.py"),
    _figure(7, "contact stresses, 6-node triangles", "figures/fig07.py"),
    _figure(8, "contact stresses, 8-node quadrilaterals", "figures/fig08.py"),
    _figure(9, "parabolic rigid punch", "figures/fig09.py"),
    _figure(10, "its contact stresses", "figures/fig10.py"),
    _figure(11, "rigid plate: profile and mesh", "figures/fig11.py"),
    _figure(12, "its contact stresses", "figures/fig12.py"),
    _figure(13, "its reaction forces, CPS8", "figures/fig13.py"),
    _figure(14, "its reaction forces, user element", "figures/fig14.py"),
    _figure(15, "stepped column: section and mesh", "figures/fig15.py"),
    *(
        _figure(
            16 + 2 * i + j,
            f"{stress} on contact surface {i + 1}",
            f"figures/fig{16 + 2 * i + j}.py",
        )
        for i in range(4)
        for j, stress in enumerate(("normal pressure", "shear stress"))
    ),
    _figure(24, "half beam, symmetric buckling: mesh and supports", "figures/fig24.py"),
    _figure(25, "half beam, antisymmetric buckling: mesh and supports", "figures/fig25.py"),
    _table(1, "the first six eigenvalues of the stepped column", "figures/tab01.py"),
    _table(2, "critical stresses of the beam", "figures/tab02.py"),
    _equation(1, "equations of motion", _MECHANICS),
    _equation(2, "weak form", _MECHANICS),
    _equation(3, "trial functions", "pw_elements/spaces.py"),
    _equation(4, "accelerations", _MECHANICS),
    _equation(5, "strains", _MECHANICS),
    _equation(6, "stresses", _MECHANICS),
    _equation(7, "test functions", "pw_elements/spaces.py"),
    _equation(8, "gradients of the weight functions", _ELEMENTS),
    _equation(9, "discrete equations of motion", _MECHANICS),
    _equation(10, "stiffness matrix", _MECHANICS),
    _equation(11, "mass matrix", _MECHANICS),
    _equation(12, "force vector", _MECHANICS),
    _equation(13, "harmonic motion", "pw_elements/eigen.py"),
    _equation(14, "eigenvalue problem of vibration", "pw_elements/eigen.py"),
    *(_equation(14 + node, f"weight function of node {node}", _ELEMENTS) for node in range(1, 7)),
    _equation(21, "element stiffness matrix", "study/paper/s3_weight_functions.py"),
    _equation(22, "constitutive matrix of plane stress", _MECHANICS),
    _equation(23, "sum over the four sub-elements", "study/paper/s3_weight_functions.py"),
    _equation(24, "buckling problem", "pw_elements/eigen.py"),
    _equation(25, "initial stress matrix", _MECHANICS),
    _equation(26, "gradients in it", _MECHANICS),
    _equation(27, "Euler's critical stress", "study/paper/s7_6_exact.py"),
]

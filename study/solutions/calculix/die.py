"""CalculiX' parabolic die slid over a block, as in section V17; needs no DOLFINx.

Both bodies have the energy of `study.solutions.calculix.cylinder`, and CPE6 elements on the meshes
of the section. Contact is of faces, by a penalty, the die's being the slave's.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from study.meshes.mesh_lines import growing
from study.solutions.calculix.cylinder import BULK
from study.solutions.calculix.decks import row, text
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.printed import Array, tables

# Lengths over the die's width, which is one, stresses over the shear modulus.
# First distance of the bodies, curvature of the die, and its ways
GAP, CURVATURE, DEPTH, FRICTION = 0.01, 1.2, 0.15, 0.3
ELEMENTS = 10  # of the die, that it slides over
PRESSED, SLID = 4, 16  # increments
BLOCK, DIE = (-1.0, 2.0), (-0.5, 0.5)
GROWTH = 1.4  # of elements, away from the contact


def lines(own: int, opposite: int) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Lines across and upwards of block and die, with so many elements per width at the contact."""
    block, die = (
        np.linspace(*ends, round((ends[1] - ends[0]) * n) + 1, dtype=np.float64)
        for ends, n in ((BLOCK, opposite), (DIE, own))
    )
    below, above = (growing(1 / n, 1.0, GROWTH) for n in (opposite, own))
    return (block, -below[::-1]), (die, above)


# Ends of increments; the die is down at 1 and at its other end at 2. CalculiX goes half of the way
TIMES = [
    *((k + 1) / PRESSED for k in range(PRESSED)),
    *(1 + (k + 1) / SLID for k in range(SLID)),
]
HALF = PRESSED + SLID // 2


def shaped(x: Array) -> Array:
    """Places (n, 2 or 3) of the die, a rectangle between y = 0 and 1 at first."""
    low = GAP + CURVATURE * x[:, 0] ** 2 / 2
    return np.column_stack([x[:, 0], low + x[:, 1] * (1 - low), x[:, 2:]])


@dataclass(frozen=True)
class Die:
    """The die pressed, then slid.

    Args:
        own, opposite: elements of die and block per width.
        penalty: pressure over penetration, in shear moduli over widths.
    """

    own: int
    opposite: int
    penalty: float = 1e3

    stick_slope = 1e2  # shear traction over slip

    @cached_property
    def grids(self) -> tuple[Grid, Grid]:
        """Lattices of block and die."""
        block, die = (tuple(len(x) - 1 for x in body) for body in lines(self.own, self.opposite))
        lower, upper = (
            Grid("T6", (0.0, 0.0), (float(n), float(m)), (n, m)) for n, m in (block, die)
        )
        return lower, upper

    @property
    def nodes(self) -> Iterator[tuple[float, float]]:
        """Places, the block's first."""
        for grid, (x, y), moved in zip(
            self.grids, lines(self.own, self.opposite), (lambda x: x, shaped), strict=True
        ):
            i, j = np.array(grid.places).T
            at = np.interp(i, np.arange(len(x)), x), np.interp(j, np.arange(len(y)), y)
            for place in moved(np.column_stack(at)):
                yield float(place[0]), float(place[1])

    def deck(self) -> str:
        """The input file."""
        block, die = self.grids
        first, begun = len(block.places), len(block.elements)
        upper, width = block.upper[1], die.upper[1]
        slave = die.faces_where(lambda p: p[1] == 0)
        master = block.faces_where(lambda p: p[1] == upper)
        every = [*block.elements, *([k + first for k in cell] for cell in die.elements)]
        return text(
            [
                "*NODE,NSET=ALL",
                *(row([k, *map(_short, (*p, 0.0))]) for k, p in enumerate(self.nodes, start=1)),
                "*ELEMENT,TYPE=CPE6,ELSET=BODIES",
                *(row([k, *cell]) for k, cell in enumerate(every, start=1)),
                f"*MATERIAL,NAME=RUBBER\n*HYPERELASTIC,NEO HOOKE\n.5,{_short(2 / BULK)}",
                "*SOLID SECTION,ELSET=BODIES,MATERIAL=RUBBER\n1.",
                "*NSET,NSET=BASE",
                *(str(node) for node in block.nodes_where(lambda p: p[1] == 0)),
                "*NSET,NSET=TOP",
                *(str(first + node) for node in die.nodes_where(lambda p: p[1] == width)),
                "*SURFACE,NAME=SLAVE",
                *(f"{begun + k},S{face}" for k, face in slave),
                "*SURFACE,NAME=MASTER",
                *(f"{k},S{face}" for k, face in master),
                "*SURFACE INTERACTION,NAME=TOUCH",
                "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
                f"{self.penalty},1e-9",
                f"*FRICTION\n{FRICTION},{self.stick_slope}",
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nSLAVE,MASTER",
                f"*AMPLITUDE,NAME=DOWN\n0.,0.,1.,{-DEPTH},2.,{-DEPTH}",
                f"*AMPLITUDE,NAME=ASIDE\n0.,0.,1.,0.,2.,{_short(ELEMENTS / self.own)}",
                "*TIME POINTS,NAME=PRINTED",
                *(str(time) for time in TIMES[:HALF]),
                "*STEP,NLGEOM,INC=1000\n*STATIC\n.05,1.5,1e-6,.05",
                "*BOUNDARY\nBASE,1,2",
                "*BOUNDARY,AMPLITUDE=DOWN\nTOP,2,2,1.",
                "*BOUNDARY,AMPLITUDE=ASIDE\nTOP,1,1,1.",
                "*NODE PRINT,NSET=TOP,TOTALS=ONLY,TIME POINTS=PRINTED\nRF\n*END STEP",
            ]
        )

    def numbers(self, printed: str) -> dict[str, Array]:
        """Forces on the die's top at the ends of increments."""
        forces = np.concatenate(tables(printed, "total force"))
        return {"N": -forces[:, 1], "T": forces[:, 0]}


def _short(number: float) -> float:
    return float(f"{number:.12g}")


DIES = {f"die-{own}-{opposite}": Die(own, opposite) for own, opposite in ((8, 6),)}

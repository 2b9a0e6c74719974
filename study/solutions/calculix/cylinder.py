"""CalculiX' neo-Hookean block below a rigid cylinder, as in section V16; needs no DOLFINx.

Its energy is C10 (J^(-2/3) I1 - 3) + (J - 1)^2 / D1: not that of section V16, but with the same
moduli at small strains. Contact is of faces, by a penalty; the cylinder is a fine polygon.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from study.meshes.mesh_lines import growing
from study.solutions.calculix.decks import row, text
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.printed import Array, tables

# Lengths over the tool's radius, stresses over the shear modulus.
# Half width and height of the block, and the half width with elements of one size
HALF_WIDTH, HEIGHT, FINE, GROWTH = 3.0, 2.0, 1.5, 1.5
LAYER = 0.25  # below the surface, with elements of that size, too
BULK = 2 * (1 + 0.3) / (3 * (1 - 2 * 0.3))  # of Poisson's ratio 0.3
DOWN, ASIDE = 0.25, 0.1
FACES, HALF_ANGLE, INNER = 240, np.pi / 3, 0.5  # of the tool


def block_lines(elements: int) -> tuple[Array, Array]:
    """Lines of a block with so many elements along the tool's radius: across and from below."""
    size = 1 / elements
    near = np.linspace(-FINE, FINE, round(2 * FINE * elements) + 1)
    far = FINE + growing(size, HALF_WIDTH - FINE, GROWTH)[1:]
    down: Array = size * np.arange(round(LAYER * elements) + 1, dtype=np.float64)
    down = np.concatenate([down, down[-1] + growing(size, HEIGHT - down[-1], GROWTH)[1:]])
    return np.concatenate([-far[::-1], near, far]), -down[::-1]


@dataclass(frozen=True)
class Cylinder:
    """The tool pressed, and with friction moved aside, too; CPE6 elements.

    Args:
        elements: along the tool's radius.
        friction: Coulomb's mu.
        penalty: pressure over penetration, in shear moduli over radii.
    """

    elements: int
    friction: float
    penalty: float = 1e4

    stick_slope = 1e3  # shear traction over slip

    @cached_property
    def grid(self) -> Grid:
        """Its lattice."""
        x, y = (len(lines) - 1 for lines in block_lines(self.elements))
        return Grid("T6", (0.0, 0.0), (float(x), float(y)), (x, y))

    @property
    def nodes(self) -> list[tuple[float, float]]:
        """Places."""
        across, below = block_lines(self.elements)
        i, j = np.arange(len(across)), np.arange(len(below))
        return [
            (float(np.interp(p[0], i, across)), float(np.interp(p[1], j, below)))
            for p in self.grid.places
        ]

    @property
    def ways(self) -> list[tuple[float, float]]:
        """The tool's places at the times that are printed."""
        down = [(0.0, -DOWN * k / 5) for k in range(1, 6)]
        return down + ([(ASIDE * k / 5, -DOWN) for k in range(1, 6)] if self.friction else [])

    def deck(self) -> str:
        """The input file."""
        top, line = self.grid.upper[1], block_lines(self.elements)[0]
        low, high = np.flatnonzero(np.isclose(np.abs(line), FINE))
        sides = self.grid.faces_where(lambda p: p[1] == top and low <= p[0] <= high)
        base = self.grid.nodes_where(lambda p: p[1] == 0)
        first, end = len(self.grid.places) + 1, len(self.ways) / 5
        element = len(self.grid.elements) + 1
        angles = np.linspace(-HALF_ANGLE, HALF_ANGLE, FACES + 1)
        tool = [
            (r * np.sin(angle), 1 - r * np.cos(angle), z)
            for angle in angles
            for r, z in ((1.0, -1.0), (1.0, 1.0), (INNER, -1.0), (INNER, 1.0))
        ]
        brick = np.array([0, 1, 5, 4, 2, 3, 7, 6]) + first
        rub = f"*FRICTION\n{self.friction},{self.stick_slope}"
        return text(
            [
                "*NODE,NSET=ALL",
                *(row([k, *map(_short, (*p, 0.0))]) for k, p in enumerate(self.nodes, start=1)),
                "*NODE,NSET=TOOL",
                *(row([k, *map(_short, p)]) for k, p in enumerate(tool, start=first)),
                "*ELEMENT,TYPE=CPE6,ELSET=BODY",
                *(row([k, *cell]) for k, cell in enumerate(self.grid.elements, start=1)),
                "*ELEMENT,TYPE=C3D8,ELSET=BRICKS",
                *(row([element + k, *(brick + 4 * k)]) for k in range(FACES)),
                f"*MATERIAL,NAME=RUBBER\n*HYPERELASTIC,NEO HOOKE\n.5,{_short(2 / BULK)}",
                "*MATERIAL,NAME=STEEL\n*ELASTIC\n1000.,.3",
                "*SOLID SECTION,ELSET=BODY,MATERIAL=RUBBER\n1.",
                "*SOLID SECTION,ELSET=BRICKS,MATERIAL=STEEL",
                "*NSET,NSET=BASE",
                *(str(node) for node in base),
                "*SURFACE,NAME=SLAVE",
                *(f"{k},S{face}" for k, face in sides),
                "*SURFACE,NAME=MASTER",
                *(f"{element + k},S1" for k in range(FACES)),
                "*SURFACE INTERACTION,NAME=TOUCH",
                "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
                f"{self.penalty},1e-9",
                *([rub] if self.friction else []),
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nSLAVE,MASTER",
                f"*AMPLITUDE,NAME=DOWN\n0.,0.,1.,{-DOWN},2.,{-DOWN}",
                f"*AMPLITUDE,NAME=ASIDE\n0.,0.,1.,0.,2.,{ASIDE}",
                "*TIME POINTS,NAME=PRINTED",
                *(str(k / 5) for k in range(1, len(self.ways) + 1)),
                f"*STEP,NLGEOM,INC=1000\n*STATIC\n.05,{end},1e-6,.05",
                "*BOUNDARY\nBASE,1,2\nTOOL,3,3",
                "*BOUNDARY,AMPLITUDE=DOWN\nTOOL,2,2,1.",
                "*BOUNDARY,AMPLITUDE=ASIDE\nTOOL,1,1,1.",
                "*NODE PRINT,NSET=TOOL,TOTALS=ONLY,TIME POINTS=PRINTED\nRF\n*END STEP",
            ]
        )

    def numbers(self, printed: str) -> dict[str, Array]:
        """The tool's ways, and the forces at their ends."""
        forces = np.concatenate(tables(printed, "total force"))
        x, y = np.array(self.ways).T
        normal = {"down": -y, "N": -forces[:, 1]}
        return normal | ({"aside": x, "T": forces[:, 0]} if self.friction else {})


def _short(number: float) -> float:
    return float(f"{number:.12g}")


CYLINDERS = {f"cylinder-8-{friction}": Cylinder(8, friction) for friction in (0.0, 0.3)}

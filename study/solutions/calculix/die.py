"""CalculiX deck of a parabolic die that slides over a block, as in section V17.

This module does not need DOLFINx. Both bodies have the strain energy of
`study.solutions.calculix.cylinder`, and CPE6 elements on the meshes of section V17. Contact is
surface-to-surface with a penalty; the die is the slave.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from study.meshes.mesh_lines import geometrically_growing_lines
from study.solutions.calculix.cylinder import BULK_MODULUS
from study.solutions.calculix.decks import (
    join_lines_to_text,
    join_with_commas,
    round_to_12_significant_digits,
)
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.output import Array, read_tables_below_heading

# Lengths are relative to the die's width, stresses to the shear modulus.
# Initial gap, curvature and indentation of the die
GAP, CURVATURE, DEPTH, FRICTION = 0.01, 1.2, 0.15, 0.3
SLIDING_ELEMENTS = 10  # length of the sliding path, in elements of the die
N_PRESSING_INCREMENTS, N_SLIDING_INCREMENTS = 4, 16  # numbers of increments
BLOCK_ENDS, DIE_ENDS = (-1.0, 2.0), (-0.5, 0.5)
SIZE_RATIO = 1.4  # of neighbouring elements, away from the contact


def mesh_line_positions_of_block_and_die(
    die_elements_per_width: int, block_elements_per_width: int
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the coordinates (x, y) of the mesh lines of the block and of the die.

    Args:
        die_elements_per_width: Number of the die's elements per die width.
        block_elements_per_width: Number of the block's elements per die width.
    """
    block, die = (
        np.linspace(*ends, round((ends[1] - ends[0]) * n) + 1, dtype=np.float64)
        for ends, n in ((BLOCK_ENDS, block_elements_per_width), (DIE_ENDS, die_elements_per_width))
    )
    below, above = (
        geometrically_growing_lines(1 / n, 1.0, SIZE_RATIO)
        for n in (block_elements_per_width, die_elements_per_width)
    )
    return (block, -below[::-1]), (die, above)


# Times of the ends of increments: at 1 the die is down, at 2 it has slid. CalculiX stops half way
INCREMENT_ENDS = [
    *((k + 1) / N_PRESSING_INCREMENTS for k in range(N_PRESSING_INCREMENTS)),
    *(1 + (k + 1) / N_SLIDING_INCREMENTS for k in range(N_SLIDING_INCREMENTS)),
]
N_CALCULIX_INCREMENTS = N_PRESSING_INCREMENTS + N_SLIDING_INCREMENTS // 2


def map_rectangle_to_die(x: Array) -> Array:
    """Map points (n, 2 or 3) of a rectangle 0 <= y <= 1 to the die with parabolic lower side."""
    low = GAP + CURVATURE * x[:, 0] ** 2 / 2
    return np.column_stack([x[:, 0], low + x[:, 1] * (1 - low), x[:, 2:]])


@dataclass(frozen=True)
class DieSlidingOnBlock:
    """Elastic die that is pressed into an elastic block, then slides over it.

    Args:
        die_elements_per_width: Number of the die's elements per die width.
        block_elements_per_width: Number of the block's elements per die width.
        penalty: Pressure over penetration, in units of shear modulus / die width.
    """

    die_elements_per_width: int
    block_elements_per_width: int
    penalty: float = 1e3

    stick_slope = 1e2  # shear traction over slip

    @cached_property
    def grids(self) -> tuple[Grid, Grid]:
        """Meshes of block and die in index coordinates, where the distance of mesh lines is 1."""
        block, die = (
            tuple(len(x) - 1 for x in body)
            for body in mesh_line_positions_of_block_and_die(
                self.die_elements_per_width, self.block_elements_per_width
            )
        )
        lower, upper = (
            Grid("T6", (0.0, 0.0), (float(n), float(m)), (n, m)) for n, m in (block, die)
        )
        return lower, upper

    @property
    def nodes(self) -> Iterator[tuple[float, float]]:
        """Coordinates of the nodes of the block, then of the die."""
        for grid, (x, y), shape in zip(
            self.grids,
            mesh_line_positions_of_block_and_die(
                self.die_elements_per_width, self.block_elements_per_width
            ),
            (lambda x: x, map_rectangle_to_die),
            strict=True,
        ):
            i, j = np.array(grid.nodes_without_bulge).T
            xy = np.interp(i, np.arange(len(x)), x), np.interp(j, np.arange(len(y)), y)
            for point in shape(np.column_stack(xy)):
                yield float(point[0]), float(point[1])

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        block, die = self.grids
        n_block_nodes, n_block_elements = len(block.nodes_without_bulge), len(block.elements)
        block_top, die_top = block.upper[1], die.upper[1]
        slave = die.find_marked_faces(lambda p: p[1] == 0)
        master = block.find_marked_faces(lambda p: p[1] == block_top)
        elements = [*block.elements, *([k + n_block_nodes for k in cell] for cell in die.elements)]
        sliding_distance = round_to_12_significant_digits(
            SLIDING_ELEMENTS / self.die_elements_per_width
        )
        return join_lines_to_text(
            [
                "*NODE,NSET=ALL",
                *(
                    join_with_commas([k, *map(round_to_12_significant_digits, (*p, 0.0))])
                    for k, p in enumerate(self.nodes, start=1)
                ),
                "*ELEMENT,TYPE=CPE6,ELSET=BODIES",
                *(join_with_commas([k, *cell]) for k, cell in enumerate(elements, start=1)),
                "*MATERIAL,NAME=RUBBER\n*HYPERELASTIC,NEO HOOKE",
                f".5,{round_to_12_significant_digits(2 / BULK_MODULUS)}",
                "*SOLID SECTION,ELSET=BODIES,MATERIAL=RUBBER\n1.",
                "*NSET,NSET=BASE",
                *(str(node) for node in block.find_nodes(lambda p: p[1] == 0)),
                "*NSET,NSET=TOP",
                *(str(n_block_nodes + node) for node in die.find_nodes(lambda p: p[1] == die_top)),
                "*SURFACE,NAME=SLAVE",
                *(f"{n_block_elements + k},S{face}" for k, face in slave),
                "*SURFACE,NAME=MASTER",
                *(f"{k},S{face}" for k, face in master),
                "*SURFACE INTERACTION,NAME=TOUCH",
                "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
                f"{self.penalty},1e-9",
                f"*FRICTION\n{FRICTION},{self.stick_slope}",
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nSLAVE,MASTER",
                f"*AMPLITUDE,NAME=DOWN\n0.,0.,1.,{-DEPTH},2.,{-DEPTH}",
                f"*AMPLITUDE,NAME=ASIDE\n0.,0.,1.,0.,2.,{sliding_distance}",
                "*TIME POINTS,NAME=PRINTED",
                *(str(time) for time in INCREMENT_ENDS[:N_CALCULIX_INCREMENTS]),
                "*STEP,NLGEOM,INC=1000\n*STATIC\n.05,1.5,1e-6,.05",
                "*BOUNDARY\nBASE,1,2",
                "*BOUNDARY,AMPLITUDE=DOWN\nTOP,2,2,1.",
                "*BOUNDARY,AMPLITUDE=ASIDE\nTOP,1,1,1.",
                "*NODE PRINT,NSET=TOP,TOTALS=ONLY,TIME POINTS=PRINTED\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read normal force N and tangential force T on top of the die at the increments' ends."""
        forces = np.concatenate(read_tables_below_heading(output, "total force"))
        return {"N": -forces[:, 1], "T": forces[:, 0]}


DIES = {
    f"die-{die_elements}-{block_elements}": DieSlidingOnBlock(die_elements, block_elements)
    for die_elements, block_elements in ((8, 6),)
}

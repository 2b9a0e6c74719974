"""CalculiX deck of a neo-Hookean block below a rigid cylinder, as in section V16.

This module does not need DOLFINx. CalculiX' strain energy C10 (J^(-2/3) I1 - 3) + (J - 1)^2 / D1
differs from that of section V16 but has the same moduli at small strains. Contact is
surface-to-surface with a penalty; the cylinder is approximated by a fine polygon.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from study.meshes.mesh_lines import geometrically_growing_lines
from study.solutions.calculix.decks import (
    join_lines_to_text,
    list_block_and_round_tool_lines,
    round_to_12_significant_digits,
)
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.output import Array, read_tables_below_heading

# Lengths are relative to the tool's radius, stresses to the shear modulus.
# Half width and height of the block, half width with uniform elements, and growth ratio beyond it
HALF_WIDTH, HEIGHT, FINE_HALF_WIDTH, SIZE_RATIO = 3.0, 2.0, 1.5, 1.5
FINE_DEPTH = 0.25  # depth below the surface with uniform elements
BULK_MODULUS = 2 * (1 + 0.3) / (3 * (1 - 2 * 0.3))  # at Poisson's ratio 0.3
INDENTATION, SLIDING_DISTANCE = 0.25, 0.1
N_TOOL_FACES, TOOL_HALF_ANGLE, TOOL_INNER_RADIUS = 240, np.pi / 3, 0.5  # of the tool


def block_mesh_line_positions(elements_along_tool_radius: int) -> tuple[Array, Array]:
    """Return the coordinates of the block's mesh lines: x, and y from bottom to top.

    Args:
        elements_along_tool_radius: Number of elements along the tool's radius.
    """
    size = 1 / elements_along_tool_radius
    near = np.linspace(
        -FINE_HALF_WIDTH,
        FINE_HALF_WIDTH,
        round(2 * FINE_HALF_WIDTH * elements_along_tool_radius) + 1,
    )
    far = (
        FINE_HALF_WIDTH
        + geometrically_growing_lines(size, HALF_WIDTH - FINE_HALF_WIDTH, SIZE_RATIO)[1:]
    )
    down: Array = size * np.arange(
        round(FINE_DEPTH * elements_along_tool_radius) + 1, dtype=np.float64
    )
    down = np.concatenate(
        [down, down[-1] + geometrically_growing_lines(size, HEIGHT - down[-1], SIZE_RATIO)[1:]]
    )
    return np.concatenate([-far[::-1], near, far]), -down[::-1]


@dataclass(frozen=True)
class CylinderOnRubberBlock:
    """Rigid cylinder that is pressed into a block of CPE6 elements and, with friction, then slides.

    Args:
        elements: Number of elements along the tool's radius.
        friction: Coulomb's coefficient.
        penalty: Pressure over penetration, in units of shear modulus / tool radius.
    """

    elements: int
    friction: float
    penalty: float = 1e4

    stick_slope = 1e3  # shear traction over slip

    @cached_property
    def grid(self) -> Grid:
        """Mesh of the block in index coordinates, where the distance of mesh lines is 1."""
        x, y = (len(lines) - 1 for lines in block_mesh_line_positions(self.elements))
        return Grid("T6", (0.0, 0.0), (float(x), float(y)), (x, y))

    @property
    def nodes(self) -> list[tuple[float, float]]:
        """Coordinates of the block's nodes in the undeformed body."""
        across, below = block_mesh_line_positions(self.elements)
        i, j = np.arange(len(across)), np.arange(len(below))
        return [
            (float(np.interp(p[0], i, across)), float(np.interp(p[1], j, below)))
            for p in self.grid.nodes_without_bulge
        ]

    @property
    def tool_translations_at_output_times(self) -> list[tuple[float, float]]:
        """Translations (x, y) of the tool at the times at which forces are printed."""
        down = [(0.0, -INDENTATION * k / 5) for k in range(1, 6)]
        return down + (
            [(SLIDING_DISTANCE * k / 5, -INDENTATION) for k in range(1, 6)] if self.friction else []
        )

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        top, x_lines = self.grid.upper[1], block_mesh_line_positions(self.elements)[0]
        low, high = np.flatnonzero(np.isclose(np.abs(x_lines), FINE_HALF_WIDTH))
        sides = self.grid.find_marked_faces(lambda p: p[1] == top and low <= p[0] <= high)
        base = self.grid.find_nodes(lambda p: p[1] == 0)
        end = len(self.tool_translations_at_output_times) / 5
        first_brick = len(self.grid.elements) + 1
        angles: Array = np.linspace(
            -TOOL_HALF_ANGLE, TOOL_HALF_ANGLE, N_TOOL_FACES + 1, dtype=float
        )
        friction_law = f"*FRICTION\n{self.friction},{self.stick_slope}"
        return join_lines_to_text(
            [
                *list_block_and_round_tool_lines(
                    self.nodes, self.grid.elements, angles, TOOL_INNER_RADIUS
                ),
                "*MATERIAL,NAME=RUBBER\n*HYPERELASTIC,NEO HOOKE",
                f".5,{round_to_12_significant_digits(2 / BULK_MODULUS)}",
                "*MATERIAL,NAME=STEEL\n*ELASTIC\n1000.,.3",
                "*SOLID SECTION,ELSET=BODY,MATERIAL=RUBBER\n1.",
                "*SOLID SECTION,ELSET=BRICKS,MATERIAL=STEEL",
                "*NSET,NSET=BASE",
                *(str(node) for node in base),
                "*SURFACE,NAME=SLAVE",
                *(f"{k},S{face}" for k, face in sides),
                "*SURFACE,NAME=MASTER",
                *(f"{first_brick + k},S1" for k in range(N_TOOL_FACES)),
                "*SURFACE INTERACTION,NAME=TOUCH",
                "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
                f"{self.penalty},1e-9",
                *([friction_law] if self.friction else []),
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nSLAVE,MASTER",
                f"*AMPLITUDE,NAME=DOWN\n0.,0.,1.,{-INDENTATION},2.,{-INDENTATION}",
                f"*AMPLITUDE,NAME=ASIDE\n0.,0.,1.,0.,2.,{SLIDING_DISTANCE}",
                "*TIME POINTS,NAME=PRINTED",
                *(str(k / 5) for k in range(1, len(self.tool_translations_at_output_times) + 1)),
                f"*STEP,NLGEOM,INC=1000\n*STATIC\n.05,{end},1e-6,.05",
                "*BOUNDARY\nBASE,1,2\nTOOL,3,3",
                "*BOUNDARY,AMPLITUDE=DOWN\nTOOL,2,2,1.",
                "*BOUNDARY,AMPLITUDE=ASIDE\nTOOL,1,1,1.",
                "*NODE PRINT,NSET=TOOL,TOTALS=ONLY,TIME POINTS=PRINTED\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read the normal force N and, with friction, the tangential force T on the tool.

        The tool's translations "down" and "aside" at the output times are returned as well.
        """
        forces = np.concatenate(read_tables_below_heading(output, "total force"))
        x, y = np.array(self.tool_translations_at_output_times).T
        normal = {"down": -y, "N": -forces[:, 1]}
        return normal | ({"aside": x, "T": forces[:, 0]} if self.friction else {})


CYLINDERS = {
    f"cylinder-8-{friction}": CylinderOnRubberBlock(8, friction) for friction in (0.0, 0.3)
}

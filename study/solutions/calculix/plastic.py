"""CalculiX deck of an elastoplastic block below a rigid cylinder, as in section V19.

This module does not need DOLFINx. The law is J2 plasticity with linear isotropic hardening at large
strains, and elements are CPE6 on the mesh of section V19. Contact is surface-to-surface with a
penalty; the cylinder is approximated by a fine polygon.
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

# Lengths are relative to the tool's radius, stresses to the initial yield stress
YOUNGS_MODULUS, POISSONS_RATIO, HARDENING = 1000.0, 0.3, 1.0
DEPTHS = 0.002 * np.arange(1, 7)
"""Depths of the tool at which forces are compared."""
CONTACT_ZONE = 0.2
"""Distance from the axis up to which elements have one size."""
GROWTH_OUTWARDS, GROWTH_DOWNWARDS = 1.25, 1.2
N_TOOL_FACES, TOOL_ANGLE, TOOL_INNER_RADIUS = 400, 0.4, 0.9


def refine_towards_zero(size: float, zone: float, length: float, growth: float) -> Array:
    """Return mesh lines from 0, evenly spaced up to a zone's end and then growing."""
    even = np.arange(0, zone - 1e-9 * zone, size)
    return np.concatenate([even, zone + geometrically_growing_lines(size, length - zone, growth)])


def block_mesh_line_positions(size: float, length: float) -> tuple[Array, Array]:
    """Return the coordinates of the block's mesh lines: x from the axis, and y from the base.

    Args:
        size: Size of the elements in the contact.
        length: Width and height of the block.
    """
    x = refine_towards_zero(size, CONTACT_ZONE, length, GROWTH_OUTWARDS)
    return x, -geometrically_growing_lines(size, length, GROWTH_DOWNWARDS)[::-1]


@dataclass(frozen=True)
class CylinderOnPlasticBlock:
    """Rigid smooth cylinder that is pressed into one half of an elastoplastic block.

    Args:
        size: Size of the elements in the contact.
        penalty: Pressure over penetration, in units of yield stress / tool radius.
    """

    size: float
    penalty: float = 2e5

    @cached_property
    def grid(self) -> Grid:
        """Mesh of the block in index coordinates, where the distance of mesh lines is 1."""
        x, y = (len(lines) - 1 for lines in block_mesh_line_positions(self.size, 1.0))
        return Grid("T6", (0.0, 0.0), (float(x), float(y)), (x, y))

    @property
    def nodes(self) -> list[tuple[float, float]]:
        """Coordinates of the block's nodes in the undeformed body."""
        across, upwards = block_mesh_line_positions(self.size, 1.0)
        i, j = np.arange(len(across)), np.arange(len(upwards))
        return [
            (float(np.interp(p[0], i, across)), float(np.interp(p[1], j, upwards)))
            for p in self.grid.nodes_without_bulge
        ]

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        right, top = self.grid.upper
        n_zone = int(np.searchsorted(block_mesh_line_positions(self.size, 1.0)[0], 0.5))
        sides = self.grid.find_marked_faces(lambda p: p[1] == top and p[0] <= n_zone)
        first_brick = len(self.grid.elements) + 1
        angles: Array = np.linspace(-0.1 * TOOL_ANGLE, TOOL_ANGLE, N_TOOL_FACES + 1, dtype=float)
        return join_lines_to_text(
            [
                *list_block_and_round_tool_lines(
                    self.nodes, self.grid.elements, angles, TOOL_INNER_RADIUS
                ),
                f"*MATERIAL,NAME=METAL\n*ELASTIC\n{YOUNGS_MODULUS},{POISSONS_RATIO}",
                f"*PLASTIC\n1.,0.\n{1 + 10 * HARDENING},10.",
                "*MATERIAL,NAME=STEEL\n*ELASTIC\n1000.,.3",
                "*SOLID SECTION,ELSET=BODY,MATERIAL=METAL\n1.",
                "*SOLID SECTION,ELSET=BRICKS,MATERIAL=STEEL",
                "*NSET,NSET=BASE",
                *(str(node) for node in self.grid.find_nodes(lambda p: p[1] == 0)),
                "*NSET,NSET=SIDES",
                *(str(node) for node in self.grid.find_nodes(lambda p: p[0] in (0.0, right))),
                "*SURFACE,NAME=SLAVE",
                *(f"{k},S{face}" for k, face in sides),
                "*SURFACE,NAME=MASTER",
                *(f"{first_brick + k},S1" for k in range(N_TOOL_FACES)),
                "*SURFACE INTERACTION,NAME=TOUCH",
                "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
                f"{self.penalty},1e-9",
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nSLAVE,MASTER",
                f"*AMPLITUDE,NAME=DOWN\n0.,0.,1.,{-DEPTHS[-1]}",
                "*TIME POINTS,NAME=PRINTED",
                *(str(round_to_12_significant_digits(depth / DEPTHS[-1])) for depth in DEPTHS),
                "*STEP,NLGEOM,INC=1000\n*STATIC\n.02,1.,1e-6,.02",
                "*BOUNDARY\nBASE,2,2\nSIDES,1,1\nTOOL,1,1\nTOOL,3,3",
                "*BOUNDARY,AMPLITUDE=DOWN\nTOOL,2,2,1.",
                "*NODE PRINT,NSET=TOOL,TOTALS=ONLY,TIME POINTS=PRINTED\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read the load N on a whole cylinder of unit length at all depths."""
        forces = np.concatenate(read_tables_below_heading(output, "total force"))
        return {"N": -2 * forces[:, 1]}


PLASTIC_BLOCKS = {"plastic-cylinder": CylinderOnPlasticBlock(0.02)}

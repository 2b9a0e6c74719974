"""CalculiX decks of a tube that is shrunk onto another one, as in section V22.

This module does not need DOLFINx. Meshes and interference are those of section V22. The inner tube
overlaps the outer one by the interference before any motion.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from study.solutions.calculix.grids import Grid
from study.solutions.calculix.output import Array, read_nodal_values_by_block
from study.solutions.calculix.two_bodies import SURFACE_TO_SURFACE, Support, TwoBodyContact

# Lengths are relative to the radius of the fit, stresses to the shear modulus
RADII, LENGTH, INTERFERENCE, POISSONS_RATIO = (0.5, 1.0, 2.0), 0.6, 1e-3, 0.3
"""Inner radius, radius of the fit and outer radius; length; difference of the radii at the fit."""
YOUNGS_MODULUS = 2 * (1 + POISSONS_RATIO)


def divide_tubes(around: int) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """Return the numbers of cells of the inner and of the outer tube along r, the angle and z.

    Args:
        around: Number of cells of a quarter of the outer tube along the angle.
    """
    radial, axial = max(2, around // 2), max(1, around // 3)
    return (max(1, radial - 1), around - 2, axial), (radial, around, axial + 1)


def compute_lame_pressure(radii: tuple[float, float, float], interference: float) -> float:
    """Return Lamé's pressure of two tubes of one material without axial stress, over its modulus.

    Args:
        radii: Inner radius, radius of the fit and outer radius.
        interference: Difference of the radii at the fit.
    """
    inner, fit, outer = radii
    ratios = [(b**2 + a**2) / (b**2 - a**2) for a, b in ((inner, fit), (fit, outer))]
    return YOUNGS_MODULUS * interference / fit / sum(ratios)


@dataclass(frozen=True)
class ShrunkTubes(TwoBodyContact):
    """Quarter of two tubes; the bore of the outer one, the first body, is the slave.

    Args:
        around: Argument of `divide_tubes`.
        matches: Whether the inner tube has as many cells as the outer one, instead of fewer.
    """

    around: int = 8
    matches: bool = False

    ratio = POISSONS_RATIO
    moduli = (YOUNGS_MODULUS, YOUNGS_MODULUS)

    @property
    def grids(self) -> tuple[Grid, Grid]:
        """Meshes of the outer and of the inner tube in cylindrical coordinates (r, angle, z)."""
        inner, outer = divide_tubes(self.around)
        inner = (inner[0], *outer[1:]) if self.matches else inner
        quarter = float(np.pi / 2)
        return (
            Grid("T10", (RADII[1], 0.0, 0.0), (RADII[2], quarter, LENGTH), outer),
            Grid("T10", (RADII[0], 0.0, 0.0), (RADII[1], quarter, LENGTH), inner),
        )

    def place_nodes(self, x: Array, upper: bool) -> Array:
        """Bend a mesh to a tube; widen the fit of the inner one by the interference."""
        r = x[:, 0] + np.where(upper & np.isclose(x[:, 0], RADII[1]), INTERFERENCE, 0.0)
        return np.column_stack([r * np.cos(x[:, 1]), r * np.sin(x[:, 1]), x[:, 2]])

    @property
    def slave_and_master_faces(self) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """Pairs (element, face number) of the bore's faces, and those of the inner tube's faces."""
        n_outer = len(self.grids[0].elements)
        slave, master = (
            grid.find_marked_faces(lambda x: abs(x[0] - RADII[1]) < 1e-9) for grid in self.grids
        )
        return slave, [(k + n_outer, face) for k, face in master]

    def supports(self) -> Iterator[Support]:
        """Yield the supports of the three planes of symmetry."""
        for k, x in enumerate(self.node_points, start=1):
            for axis in range(3):
                if abs(x[axis]) < 1e-9:
                    yield k, axis, 0.0

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read the contact pressures of `slave_nodes`."""
        contact = read_nodal_values_by_block(output)["CONTACT"]
        return {"pressure": np.array([contact[k][3] for k in self.slave_nodes])}


SHRUNK_TUBES = {
    "shrunk-tubes": ShrunkTubes(SURFACE_TO_SURFACE, 1e2),
    "shrunk-tubes-matching": ShrunkTubes(SURFACE_TO_SURFACE, 1e2, matches=True),
}
"""Problems by name.

The penalty is 38 Young's moduli over the radius, within the 5 to 50 that CalculiX' manual suggests.
With larger ones, pressures on meshes that do not match scatter more, as gaps between these meshes
are not small against the interference.
"""

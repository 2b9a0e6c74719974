"""CalculiX decks of two blocks of tetrahedra that touch, turn and slide, as in section V18.

This module does not need DOLFINx. Both blocks have the strain energy of
`study.solutions.calculix.cylinder`, and C3D10 elements on the meshes of section V18. Contact is
surface-to-surface with a penalty, or by CalculiX' mortar method; the upper block is the slave.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from study.meshes.mesh_lines import bend_end_of_block
from study.solutions.calculix.cylinder import BULK_MODULUS
from study.solutions.calculix.decks import (
    join_lines_to_text,
    join_with_commas,
    round_to_12_significant_digits,
)
from study.solutions.calculix.die import FRICTION
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.output import Array, list_nodal_value_blocks
from study.solutions.calculix.two_bodies import MORTAR, SURFACE_TO_SURFACE

Indices = npt.NDArray[np.int64]

GAP = 0.01
"""Initial gap between both bodies, by which their sides are told apart."""

# Patch: two blocks with square sections of side 1 and heights of 0.5
PATCH_GRIDS = (
    Grid("T10", (-0.5, -0.5, -0.5), (0.5, 0.5, 0.0), (3, 3, 2)),
    Grid("T10", (-0.5, -0.5, 0.0), (0.5, 0.5, 0.5), (4, 4, 2)),
)
"""Meshes of the lower block (master) and of the upper one."""
PATCH_STRETCH = 0.9
ROTATION_AXIS, ROTATION_DEGREES, N_ROTATION_INCREMENTS = (1.0, -2.0, 2.0), 70.0, 4

# Sliding: a small block with a convex lower side on a long one
SLIDING_CELL_SIZE = 0.15
"""Length of the small block's elements along the path."""
SLIDING_GRIDS = (
    Grid("T10", (-0.5, -0.4, -0.3), (2.1, 0.4, 0.0), (12, 3, 1)),
    Grid("T10", (-0.3, -0.25, 0.0), (0.3, 0.25, 0.4), (4, 2, 2)),
)
SLIDING_CURVATURE, SLIDING_DEPTH = 0.4, 0.05
N_PRESSING_INCREMENTS, N_SLIDING_INCREMENTS = 2, 20

# Times at which the increments end: at 1 the blocks are pressed, at 2 they have turned or slid
PATCH_TIMES = [
    0.5,
    1.0,
    *(1 + (k + 1) / N_ROTATION_INCREMENTS for k in range(N_ROTATION_INCREMENTS)),
]
SLIDING_TIMES = [
    *((k + 1) / N_PRESSING_INCREMENTS for k in range(N_PRESSING_INCREMENTS)),
    *(1 + (k + 1) / N_SLIDING_INCREMENTS for k in range(N_SLIDING_INCREMENTS)),
]


def rotate_about_general_axis(degrees: float) -> Rotation:
    """Return the rotation by an angle in degrees about `ROTATION_AXIS`."""
    axis = np.array(ROTATION_AXIS) / np.linalg.norm(ROTATION_AXIS)
    return Rotation.from_rotvec(np.radians(degrees) * axis)


def solve_uniaxial_stress(stretch: float, lame: float | None = None) -> tuple[Array, float]:
    """Return stretches (3,), and the pressure on sections z = constant, for a stretch along z.

    Args:
        stretch: Stretch along z.
        lame: Lamé's first constant over the shear modulus in the energy of section V16; None for
            CalculiX' energy.
    """

    def stresses_times_volume_ratio(lateral: float) -> tuple[float, float]:
        J, square = lateral**2 * stretch, 2 * lateral**2 + stretch**2
        if lame is not None:
            lateral_stress, axial_stress = (s**2 - 1 + lame * np.log(J) for s in (lateral, stretch))
        else:
            lateral_stress, axial_stress = (
                J ** (-2 / 3) * (s**2 - square / 3) + BULK_MODULUS * (J - 1) * J
                for s in (lateral, stretch)
            )
        return float(lateral_stress), float(axial_stress)

    lateral = brentq(lambda s: stresses_times_volume_ratio(s)[0], 0.5, 2.0, xtol=1e-15)
    pressure = -stresses_times_volume_ratio(lateral)[1] / (lateral**2 * stretch)
    return np.array([lateral, lateral, stretch]), pressure


def exact_patch_normals_and_pressures(
    x: Array, curvature: float, lame: float | None = None
) -> tuple[Array, Array]:
    """Return normals (m, 3) and pressures (m,) on the common side of the pressed patch.

    Args:
        x: Undeformed nodes (m, 3) of the side.
        curvature: Its curvature along both axes.
        lame: Argument of `solve_uniaxial_stress`.
    """
    stretches, pressure = solve_uniaxial_stress(PATCH_STRETCH, lame)
    normal = np.column_stack([-curvature * x[:, :2], np.ones(len(x))]) / stretches
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return normal, pressure * normal[:, 2] ** 2


def displace_patch(x: Array, time: float, lame: float | None = None) -> Array:
    """Return the displacements (n, 3) of base and top of the patch.

    Args:
        x: Nodes (n, 3) of both blocks; displacements are meaningful at z = -0.5 and at the top.
        time: Time between 0 and 2, see `PATCH_TIMES`.
        lame: Argument of `solve_uniaxial_stress`.
    """
    closed = x - np.outer(np.isclose(x[:, 2], x[:, 2].max()), [0.0, 0.0, GAP])
    stretches, _ = solve_uniaxial_stress(1 - (1 - PATCH_STRETCH) * min(time, 1.0), lame)
    rotation = rotate_about_general_axis(ROTATION_DEGREES * max(0.0, time - 1))
    return np.asarray(rotation.apply(stretches * closed) - x)


def list_sliding_times(n_elements: int) -> list[float]:
    """Return the times of `SLIDING_TIMES` up to the end of a path of some elements.

    Args:
        n_elements: Number of the small block's elements over which it slides, at most 10.
    """
    return SLIDING_TIMES[: N_PRESSING_INCREMENTS + n_elements * N_SLIDING_INCREMENTS // 10]


def displace_sliding_block(x: Array, time: float) -> Array:
    """Return the displacements (n, 3) of base and top of the sliding block and the long one.

    Args:
        x: Nodes (n, 3) of both blocks.
        time: Time between 0 and 2, see `SLIDING_TIMES`.
    """
    travel = 10 * SLIDING_CELL_SIZE * max(0.0, time - 1)
    is_top = np.isclose(x[:, 2], x[:, 2].max())
    return np.asarray(np.outer(is_top, [travel, 0.0, -(GAP + SLIDING_DEPTH) * min(time, 1.0)]))


@dataclass(frozen=True)
class BlocksInSpace(ABC):
    """Two blocks whose base and top are moved.

    Args:
        contact_formulation: CalculiX' name of the contact formulation.
        increments: Least number of CalculiX' increments for each increment of section V18.
        penalty: Pressure over penetration, in units of shear modulus / length.
        stick_slope: Shear traction over slip.
    """

    contact_formulation: str
    increments: int
    penalty: float = 1e3
    stick_slope: float = 1e2

    output_suffix = ".frd"  # of the file from which numbers are read

    @property
    @abstractmethod
    def grids(self) -> tuple[Grid, Grid]:
        """Meshes of the lower and the upper block, with flat sides."""

    @property
    @abstractmethod
    def curvatures(self) -> tuple[float, float]:
        """Curvatures of the lower block's upper side and of the upper block's lower side."""

    @property
    @abstractmethod
    def times(self) -> list[float]:
        """Times at which the increments of section V18 end."""

    @abstractmethod
    def displace_base_and_top(self, time: float) -> Array:
        """Return displacements (n, 3) that hold at the nodes of base and top."""

    @cached_property
    def nodes(self) -> Array:
        """Coordinates (n, 3) of all nodes; node k is row k - 1."""
        lower, upper = (
            bend_end_of_block(np.array(grid.nodes_without_bulge), curvature)
            for grid, curvature in zip(self.grids, self.curvatures, strict=True)
        )
        return np.concatenate([lower, upper + np.array([0.0, 0.0, GAP])])

    @property
    def node_points(self) -> list[tuple[float, ...]]:
        """Coordinates of all nodes as tuples of Python floats."""
        return [tuple(float(part) for part in x) for x in self.nodes]

    @property
    def element_nodes(self) -> list[list[int]]:
        """Node numbers of all elements as Python integers."""
        return [[int(node) for node in cell] for cell in self.elements]

    @cached_property
    def elements(self) -> Indices:
        """Node numbers (n_elements, 10) of all elements; element k is row k - 1."""
        lower, upper = (np.array(grid.elements) for grid in self.grids)
        return np.concatenate([lower, upper + len(self.grids[0].nodes_without_bulge)])

    @property
    def slave_and_master_faces(self) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """Pairs (element, face number) of the slave's faces, and those of the master's faces."""
        master, slave = (grid.find_marked_faces(lambda x: x[2] == 0) for grid in self.grids)
        return [(k + len(self.grids[0].elements), face) for k, face in slave], master

    @cached_property
    def slave_nodes(self) -> Indices:
        """Sorted node numbers of the slave's faces."""
        lower, upper = self.grids
        numbers = np.array(upper.find_nodes(lambda x: x[2] == 0))
        return numbers + len(lower.nodes_without_bulge)

    @cached_property
    def base_and_top(self) -> tuple[Indices, Indices]:
        """Node numbers of the base and of the top."""
        z = self.nodes[:, 2]
        base, top = (np.flatnonzero(np.isclose(z, end)) + 1 for end in (z.min(), z.max()))
        return base, top

    def deck(self) -> str:
        """Return the text of CalculiX' input file; each increment of section V18 is a step."""
        slave, master = self.slave_and_master_faces
        moved = np.concatenate(self.base_and_top)
        step_lines: list[str] = []
        size = 1 / self.increments
        for time in self.times:
            displacement = self.displace_base_and_top(time)
            step_lines += [
                f"*STEP,NLGEOM,INC=1000\n*STATIC\n{size},1.,1e-6,{size}",
                "*BOUNDARY",
                *(
                    join_with_commas([int(k), i + 1, i + 1, _round_displacement(u)])
                    for k in moved
                    for i, u in enumerate(displacement[k - 1])
                ),
                "*NODE FILE,FREQUENCY=1000\nU,RF\n*CONTACT FILE,FREQUENCY=1000\nCSTR\n*END STEP",
            ]
        return join_lines_to_text(
            [
                "*NODE,NSET=ALL",
                *(
                    join_with_commas([k, *map(round_to_12_significant_digits, x)])
                    for k, x in enumerate(self.node_points, start=1)
                ),
                "*ELEMENT,TYPE=C3D10,ELSET=BODIES",
                *(
                    join_with_commas([k, *cell])
                    for k, cell in enumerate(self.element_nodes, start=1)
                ),
                "*MATERIAL,NAME=RUBBER\n*HYPERELASTIC,NEO HOOKE",
                f".5,{round_to_12_significant_digits(2 / BULK_MODULUS)}",
                "*SOLID SECTION,ELSET=BODIES,MATERIAL=RUBBER",
                "*SURFACE,NAME=SLAVE",
                *(f"{k},S{face}" for k, face in slave),
                "*SURFACE,NAME=MASTER",
                *(f"{k},S{face}" for k, face in master),
                "*SURFACE INTERACTION,NAME=TOUCH",
                "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
                f"{self.penalty},1e-9",
                f"*FRICTION\n{FRICTION},{self.stick_slope}",
                f"*CONTACT PAIR,INTERACTION=TOUCH,TYPE={self.contact_formulation}\nSLAVE,MASTER",
                *step_lines,
            ]
        )

    def read_forces_on_top(self, output: str) -> Array:
        """Read the total forces (n_times, 3) of the supports on top at the times of `times`."""
        forces = [values for name, values in list_nodal_value_blocks(output) if name == "FORC"]
        top = self.base_and_top[1]
        return np.array([np.sum([values[k][:3] for k in top], axis=0) for values in forces])


def _round_displacement(value: float) -> float:
    """Round to nine decimals, so that processor and SciPy version do not matter."""
    return round(float(value), 9) + 0.0


@dataclass(frozen=True)
class RotatedPatch(BlocksInSpace):
    """Two blocks that are compressed uniformly, then rotated.

    Args:
        curvature: Curvature of the common side along both axes; zero if it is flat.
    """

    curvature: float = 0.0

    grids = PATCH_GRIDS
    times = PATCH_TIMES

    @property
    def curvatures(self) -> tuple[float, float]:
        """Curvatures of the lower block's upper side and of the upper block's lower side."""
        return self.curvature, self.curvature

    def displace_base_and_top(self, time: float) -> Array:
        """Return displacements (n, 3) that hold at the nodes of base and top."""
        return displace_patch(self.nodes, time)

    @cached_property
    def nodes_of_elements_at_contact(self) -> Indices:
        """Node numbers of all elements that have a node on a contact surface.

        Displacements of these nodes determine the nodal contact forces.
        """
        is_contact_node = np.concatenate(
            [np.array(grid.nodes_without_bulge)[:, 2] == 0 for grid in self.grids]
        )
        return np.unique(self.elements[is_contact_node[self.elements - 1].any(axis=1)])

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read the force on top, nodal pressures, and nodal displacements.

        Forces (3,) "force" and pressures (m,) "pressure" at `slave_nodes` are returned for the
        pressed and, with the suffix "_rotated", for the rotated blocks; displacements (3 k,) of
        `nodes_of_elements_at_contact` for the pressed blocks.
        """
        blocks, forces = list_nodal_value_blocks(output), self.read_forces_on_top(output)
        contact = [values for name, values in blocks if name == "CONTACT"]
        displacements = [values for name, values in blocks if name == "DISP"]
        numbers = {}
        pressed = self.times.index(1.0)
        for suffix, index in (("", pressed), ("_rotated", -1)):
            numbers["force" + suffix] = forces[index]
            pressures = [contact[index][k][3] for k in self.slave_nodes]
            numbers["pressure" + suffix] = np.array(pressures)
        numbers["displacement"] = np.concatenate(
            [displacements[pressed][k][:3] for k in self.nodes_of_elements_at_contact]
        )
        return numbers


@dataclass(frozen=True)
class SlidingBlock(BlocksInSpace):
    """Small convex block that is pressed into a long one, and slides over it.

    Args:
        sliding_elements: Number of its elements over which it slides, at most 10.
    """

    sliding_elements: int = 10

    grids = SLIDING_GRIDS
    curvatures = (0.0, SLIDING_CURVATURE)

    @property
    def times(self) -> list[float]:
        """Times at which the increments of section V18 end."""
        return list_sliding_times(self.sliding_elements)

    def displace_base_and_top(self, time: float) -> Array:
        """Return displacements (n, 3) that hold at the nodes of base and top."""
        return displace_sliding_block(self.nodes, time)

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read normal force N and tangential force T on top at the ends of the increments."""
        forces = self.read_forces_on_top(output)
        return {"N": -forces[:, 2], "T": forces[:, 0]}


FORMULATIONS = {"surface": SURFACE_TO_SURFACE, "mortar": MORTAR}
PATCHES = {
    f"patch-in-space-{side}-{name}": RotatedPatch(formulation, 16, curvature=curvature)
    for name, formulation in FORMULATIONS.items()
    for side, curvature in (("flat", 0.0), ("curved", 0.14))
}
SLIDING_BLOCKS = {
    f"block-sliding-in-space-{name}": SlidingBlock(formulation, 4)
    for name, formulation in FORMULATIONS.items()
}

"""Problems of section V21 with wear, peeling and regularised friction, compared with exact answers.

They are a bent block that wears until its pressure is uniform, an arm that is peeled off a rigid
floor, and two equal cylinders in partial slip.
"""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, Mesh, create_box

from pw_elements import Reduction, SurfaceNodes, assemble_vector, boundary_measure
from pw_elements.contact import ContactPair, ContactProblem, Motion, Parabola, Plane
from pw_elements.contact.model import (
    CohesiveContact,
    ContactState,
    MatchingNodes,
    UnilateralContact,
)
from pw_elements.meshes import triangles
from study.benchmarks.v21_laws.joints import (
    ElasticBlock,
    NodalAreas,
    make_dimensionless_result,
    on_plane,
)
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_lines import geometrically_growing_lines
from study.meshes.two_body_meshes import add_rotated_body
from study.run.store import Result
from study.solutions.half_space import ElasticHalfSpace
from study.solutions.stick_slip import CattaneoPartialSlip

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# A bent block that wears until its pressure is uniform

YOUNGS_MODULUS, POISSONS_RATIO = 1000.0, 0.3
PLANE_STRAIN_MODULUS = YOUNGS_MODULUS / (1 - POISSONS_RATIO**2)
BENDING_STRESS, BLOCK_PRESSURE = 1.0, 1.0
"""Largest bending stress S of the block, and the pressure on its upper side."""
BLOCK_DEPTH = 0.5
"""Size of the block in space along the second axis, in which it is held."""
WORN_DEPTH_PER_INCREMENT = 0.05 / PLANE_STRAIN_MODULUS
"""Depth that the mean pressure wears in an increment: a tenth of what unloads shortest waves."""
SLIP_PER_INCREMENT, N_WEAR_INCREMENTS = 0.3, 150
"""Slip, large compared with displacements, as if an increment were many strokes; their number."""
DRAWN_INCREMENTS = 0, 10, 40, N_WEAR_INCREMENTS
"""Increments of which curves are stored."""


def wear(element: str) -> Result:
    """Wear a bent block on a floor that slides below it under a constant load.

    Bending stresses from -S to S on the ends, linear over the height 1, would give the lower side
    the displacement -S x^2 / E'. The block wears as long as its pressure is not uniform; in the
    end, the worn depth is S x^2 / E' + constant.

    Args:
        element: Name of the element.
    """
    block = _BentBlock(element)
    law = UnilateralContact(
        0.0, wear_coefficient=WORN_DEPTH_PER_INCREMENT / (BLOCK_PRESSURE * SLIP_PER_INCREMENT)
    )
    floor = ContactPair(
        block.base, Plane(np.zeros(block.dim), np.eye(block.dim)[block.up]), interface_law=law
    )
    problem = ContactProblem(block.K, block.make_supports(), floor, block.space)
    load, along = block.assemble_load(), np.eye(block.dim)[0]
    states = [problem.step(problem.undeformed, load)]
    for n in range(1, N_WEAR_INCREMENTS + 1):
        states.append(problem.step(states[-1], load, Motion(n * SLIP_PER_INCREMENT * along)))
    x = states[0].pairs[0].position[:, 0]
    depths = [state.pairs[0].law_history[:, -1] for state in states]
    pressures = [state.pairs[0].force_normal / block.areas.tributary for state in states]
    exact = BENDING_STRESS / PLANE_STRAIN_MODULUS * x**2
    deviation = depths[-1] - exact
    deviation -= block.areas.tributary @ deviation / block.areas.tributary.sum()
    path = N_WEAR_INCREMENTS * SLIP_PER_INCREMENT
    archard = law.wear_coefficient * BLOCK_PRESSURE * block.areas.tributary.sum() * path
    own, tributary = block.areas.largest_errors(states[-1].pairs[0].force_normal, BLOCK_PRESSURE)
    scalars = {
        "shape_error": np.abs(deviation).max() / (BENDING_STRESS / PLANE_STRAIN_MODULUS),
        "volume_error": block.areas.own @ depths[-1] / archard - 1,
        "pressure_own": own,
        "pressure_tributary": tributary,
        "first_pressure": np.ptp(pressures[0]) / BLOCK_PRESSURE,
        "unworn": np.mean(depths[-1] == 0),
    }
    curves = {"x": x, "exact": exact}
    for n in DRAWN_INCREMENTS:
        curves |= {f"depth_{n}": depths[n], f"pressure_{n}": pressures[n]}
    return make_dimensionless_result(scalars, curves, block.n_dofs)


class _BentBlock(ElasticBlock):
    """Block over -1 < x < 1, of height 1, in plane strain, in the plane or in space."""

    def __init__(self, element: str) -> None:
        if element.endswith("T10"):
            corners = [np.array([-1.0, 0.0, 0.0]), np.array([1.0, BLOCK_DEPTH, 1.0])]
            mesh = create_box(MPI.COMM_SELF, corners, [4, 1, 2], CellType.tetrahedron)
        else:
            mesh = triangles(MPI.COMM_SELF, (-1, 0), (1, 1), (8, 4), "left_right")
        super().__init__(element, mesh, POISSONS_RATIO, YOUNGS_MODULUS)
        self.up = self.dim - 1
        self.base = on_plane(self.up, 0.0)
        self.areas = NodalAreas.from_body(self.body, self.base)

    def make_supports(self) -> Reduction:
        """Return supports against sliding, and in space against displacements along its depth."""

        def is_top_middle(x: Array) -> Mask:
            return np.asarray(np.isclose(x[0], 0) & np.isclose(x[self.up], 1))

        sides = [(1, on_plane(1, y)) for y in (0.0, BLOCK_DEPTH)] if self.dim == 3 else []
        return self.supports((0, is_top_middle), *sides)

    def assemble_load(self) -> PETSc.Vec:
        """Return the load (n,) of the pressure on the top and of bending stresses on both ends."""
        load = self.traction_load(-BLOCK_PRESSURE * np.eye(self.dim)[self.up], on_plane(self.up, 1))
        mesh = self.body.spaces.mesh
        stress = BENDING_STRESS * (2 * ufl.SpatialCoordinate(mesh)[self.up] - 1)
        for x in (-1, 1):
            traction = ufl.as_vector([x * stress, *[0.0] * self.up])
            end = boundary_measure(mesh, on_plane(0, x))
            load += assemble_vector(self.body.surface_load(traction, end))
        return load


# An arm that is peeled off a rigid floor

ARM_LENGTH, BOND_LENGTH, ARM_HEIGHT = 10.0, 8.0, 1.0
ARM_COHESION = CohesiveContact(stiffness=2000.0, strength=0.2, toughness=2e-4)
ROTATIONS = tuple(np.arange(4, 29) / 2000)
"""Rotations of the free end, after the increments."""


def peel(element: str, elements: int) -> Result:
    """Bend an arm off a floor by a prescribed rotation of its end, and compare J and toughness.

    A moment M and a normal force N on the end have the J integral 6 M^2 / (E' h^3) + N^2 / (2 E' h)
    for a crack of any length. It is the toughness if the crack's tip has opened completely.

    Args:
        element: Name of the element.
        elements: Number of elements over the height of the arm.
    """
    arm = _BondedArm(element, elements)
    state, ends, imbalances, n_separated = arm.problem.undeformed, [], [], []
    for rotation in ROTATIONS:
        state, moment, force = arm.rotate_end(state, rotation)
        (pair,) = state.pairs
        ends.append((moment, force))
        moment_of_bond = pair.force_vector[:, 1] @ (pair.position[:, 0] - ARM_LENGTH)
        moment_of_bond += pair.force_vector[:, 0].sum() * ARM_HEIGHT / 2
        imbalances.append(float(abs(moment + moment_of_bond) / abs(moment)))
        separation = pair.law_history[:, -1] / ARM_COHESION.final_opening
        n_separated.append(np.count_nonzero(separation >= 1))
    moments, normal_forces = np.transpose(ends)
    j_of_force = normal_forces**2 / (2 * PLANE_STRAIN_MODULUS * ARM_HEIGHT)
    j_of_force /= ARM_COHESION.toughness
    j_of_moment = 6 * moments**2 / (PLANE_STRAIN_MODULUS * ARM_HEIGHT**3)
    j_over_toughness = j_of_moment / ARM_COHESION.toughness + j_of_force
    is_peeling, x = np.array(n_separated) > 0, pair.position[:, 0]
    areas = NodalAreas.from_nodes(arm, x)
    scalars = {
        "j_error": np.abs(j_over_toughness[is_peeling] - 1).max(),
        "j_mean": j_over_toughness[is_peeling].mean(),
        "j_spread": np.ptp(j_over_toughness[is_peeling]),
        "normal_force_share": j_of_force.max(),
        "peeling_increments": is_peeling.sum(),
        "crack_growth": BOND_LENGTH - x[separation >= 1].min(),
        "moment_imbalance": max(imbalances),
    }
    curves: dict[str, npt.NDArray[np.floating]] = {
        "rotation": np.array(ROTATIONS),
        "j_over_toughness": j_over_toughness,
        "x": x,
        "traction_own": pair.force_normal / areas.own,
        "traction_tributary": pair.force_normal / areas.tributary,
        "separation": separation,
    }
    return make_dimensionless_result(scalars, curves, arm.n_dofs)


class _BondedArm(ElasticBlock):
    """Arm with a cohesive bond on its lower side, whose end is rotated.

    Args:
        element: Name of the element.
        elements: Number of elements over the height of the arm.
    """

    def __init__(self, element: str, elements: int) -> None:
        divisions = (int(ARM_LENGTH / ARM_HEIGHT) * elements, elements)
        mesh = triangles(MPI.COMM_SELF, (0, 0), (ARM_LENGTH, ARM_HEIGHT), divisions, "left_right")
        super().__init__(element, mesh, POISSONS_RATIO, YOUNGS_MODULUS)
        end = on_plane(0, ARM_LENGTH)

        def is_bonded(x: Array) -> Mask:
            return np.asarray(np.isclose(x[1], 0) & (x[0] < BOND_LENGTH + 1e-9))

        bond = ContactPair(is_bonded, Plane((0, 0), (0, 1)), interface_law=ARM_COHESION)
        self.problem = ContactProblem(self.K, self.supports((0, end)), bond, self.space)
        self.end_nodes = fem.locate_dofs_geometrical(self.space, end)
        x = self.space.tabulate_dof_coordinates()[self.end_nodes]
        self.lever: Array = x[:, 1] - ARM_HEIGHT / 2

    def rotate_end(self, start: ContactState, rotation: float) -> tuple[ContactState, float, float]:
        """Return the state at a rotation of the end, with the moment and normal force on the end.

        The end's displacements are replaced by a load, so that they are zero in the state.

        Args:
            start: State before.
            rotation: Rotation of the end since the undeformed state.
        """
        prescribed = self.K.createVecRight()
        prescribed.array.reshape(-1, 2)[self.end_nodes, 0] = -rotation * self.lever
        load = self.K * prescribed
        load.scale(-1.0)
        state = self.problem.step(start, load)
        nodal_forces = (self.K * (state.displacement + prescribed)).array.reshape(-1, 2)
        reaction = nodal_forces[self.end_nodes, 0]
        return state, float(-reaction @ self.lever), float(reaction.sum())


# Two equal cylinders in partial slip, with regularised friction

FRICTION, FRICTION_SHARE, RELATIVE_RADIUS = 0.4, 0.5, 1e4
NORMAL_FORCE = np.pi * PLANE_STRAIN_MODULUS / (8 * RELATIVE_RADIUS)
"""Normal force for which Hertz' half width of contact is one."""
PARTIAL_SLIP = CattaneoPartialSlip(1.0, NORMAL_FORCE, FRICTION, FRICTION_SHARE)
SLIP_SCALE = FRICTION * PARTIAL_SLIP.peak_pressure / (PLANE_STRAIN_MODULUS / 2)
"""Slip mu p_0 a / E*."""
RELATIVE_LENGTHS = {"3": 0.3, "10": 0.1, "30": 0.03, "100": 0.01}
"""Lengths of the regularisation over the slip scale, by the rounded inverse."""
ZONE, ZONE_ELEMENTS, HALF_PLANE, DISTANCE = 1.25, 20, 5.0, 1.0
"""Half width of the zone whose nodes may touch; its elements; size and distance of the bodies."""
INNER, BESIDE_STICK_END = 0.9, 0.1
"""Half width in which shear is compared, and distance from the ends of the sticking zone."""


def regularise(element: str) -> Result:
    """Press two equal cylinders together and shear them in one increment with smooth friction.

    The shear is compared with the exact one of Cattaneo, and with that of Coulomb's law on the same
    mesh. The loads are then kept for another increment.

    Args:
        element: Name of the element.
    """
    cylinders = _TwoCylinders(element)
    coulomb = cylinders.shear(None)
    scalars = cylinders.compare("coulomb", coulomb.shear)
    scale = FRICTION * PARTIAL_SLIP.peak_pressure
    curves: dict[str, npt.NDArray[np.floating]] = {
        "x": cylinders.x,
        "exact": PARTIAL_SLIP.shear(cylinders.x) / scale,
        "coulomb": coulomb.shear / scale,
    }
    for name, relative_length in RELATIVE_LENGTHS.items():
        smooth = cylinders.shear(relative_length * SLIP_SCALE)
        scalars |= cylinders.compare(f"smooth_{name}", smooth.shear)
        scalars[f"distance_{name}"] = cylinders.distance(smooth.shear, coulomb.shear)
        scalars[f"creep_{name}"] = smooth.creep
        curves[f"smooth_{name}"] = smooth.shear / scale
    scalars["length_order"] = np.log10(scalars["distance_10"] / scalars["distance_100"])
    return make_dimensionless_result(scalars, curves, cylinders.n_dofs)


@dataclass(frozen=True)
class _Shear:
    """Shear of two cylinders.

    Attributes:
        shear: Shear tractions (m,), from nodal forces over the nodes' own weights.
        creep: Displacement of the upper body in an increment without a change of the loads, over
            that in the increment before.
    """

    shear: Array
    creep: float


class _TwoCylinders(ElasticBlock):
    """Half planes with matching nodes whose far displacements are those of the exact solution."""

    def __init__(self, element: str) -> None:
        super().__init__(element, _mesh_two_cylinders(), POISSONS_RATIO, YOUNGS_MODULUS)
        self.surface = SurfaceNodes.from_body(self.body, _is_on_lower_contact)
        self.outer = fem.locate_dofs_geometrical(self.space, _is_on_outer_sides)
        self.x: Array = self.surface.position[:, 0]

    def shear(self, length: float | None) -> _Shear:
        """Press the cylinders together, shear them in one increment, and keep the loads in another.

        Args:
            length: Length of the regularisation; None for Coulomb's law.
        """
        upper = MatchingNodes(
            _is_on_upper_contact, Parabola((0.0, 0.0), RELATIVE_RADIUS), offset=(0.0, DISTANCE)
        )
        law = UnilateralContact(FRICTION, regularisation_length=length)
        pair = ContactPair(_is_on_lower_contact, upper, interface_law=law)
        supports = self.supports(*((i, _is_on_outer_sides) for i in (0, 1)))
        problem = ContactProblem(self.K, supports, pair, self.space)
        pressing = Motion((0.0, None), (0.0, -NORMAL_FORCE))
        tangential = FRICTION_SHARE * FRICTION * NORMAL_FORCE
        shearing = Motion((None, None), (tangential, -NORMAL_FORCE))
        states: list[ContactState] = [problem.undeformed]
        for utilisation, motion in ((0.0, pressing), *[(FRICTION_SHARE, shearing)] * 2):
            load = self._load_replacing_far_displacements(utilisation)
            states.append(problem.step(states[-1], load, motion))
        positions = [state.pairs[0].translation[0] for state in states]
        (sheared,) = states[2].pairs
        return _Shear(
            self.surface.pressure(sheared.force_tangential[:, 0]),
            (positions[3] - positions[2]) / (positions[2] - positions[1]),
        )

    def _load_replacing_far_displacements(self, utilisation: float) -> PETSc.Vec:
        exact = CattaneoPartialSlip(1.0, NORMAL_FORCE, FRICTION, utilisation)
        x = self.space.tabulate_dof_coordinates()[self.outer, :2]
        is_upper = x[:, 1, None] > DISTANCE / 2
        half_plane = ElasticHalfSpace(YOUNGS_MODULUS, POISSONS_RATIO)
        field = exact.displacement(half_plane, np.where(is_upper, [0.0, DISTANCE] - x, x))
        prescribed = self.K.createVecRight()
        prescribed.array.reshape(-1, 2)[self.outer] = np.where(is_upper, -field, field)
        load = self.K * prescribed
        load.scale(-1.0)
        return load

    def distance(self, shear: Array, other: Array, apart: bool = False) -> float:
        """Return the root mean square of a difference of shears, over that of the exact shear.

        Args:
            shear: Shear (m,).
            other: Shear (m,).
            apart: Whether nodes near the ends of the sticking zone are excluded.
        """
        is_inner = np.abs(self.x) < INNER
        nodes = is_inner
        if apart:
            nodes = is_inner & (
                np.abs(np.abs(self.x) - PARTIAL_SLIP.stick_half_width) > BESIDE_STICK_END
            )
        squares = np.square((shear - other)[nodes]).sum()
        return float(np.sqrt(squares / np.square(PARTIAL_SLIP.shear(self.x[is_inner])).sum()))

    def compare(self, name: str, shear: Array) -> dict[str, float]:
        """Return errors of a shear (m,), with and without nodes near the ends of the sticking zone.

        Args:
            name: Beginning of the names of the errors.
            shear: Shear (m,).
        """
        exact = PARTIAL_SLIP.shear(self.x)
        return {
            f"{name}_error": self.distance(shear, exact),
            f"{name}_error_apart": self.distance(shear, exact, apart=True),
        }


def _mesh_two_cylinders() -> Mesh:
    size = ZONE / ZONE_ELEMENTS
    beside = ZONE + geometrically_growing_lines(size, HALF_PLANE - ZONE, 1.3)[1:]
    half = np.concatenate([np.linspace(0.0, ZONE, ZONE_ELEMENTS + 1), beside])
    depth = -geometrically_growing_lines(size, HALF_PLANE, 1.3)[::-1]
    across = np.concatenate([-half[:0:-1], half])
    lower = mesh_along_lines(MPI.COMM_SELF, across, depth, "triangle", "left_right")
    return add_rotated_body(lower, DISTANCE)


def _is_on_lower_contact(x: Array) -> Mask:
    return np.asarray(np.isclose(x[1], 0) & (np.abs(x[0]) < ZONE + 1e-9))


def _is_on_upper_contact(x: Array) -> Mask:
    return np.asarray(np.isclose(x[1], DISTANCE) & (np.abs(x[0]) < ZONE + 1e-9))


def _is_on_outer_sides(x: Array) -> Mask:
    is_on_end = np.isclose(x[1], -HALF_PLANE) | np.isclose(x[1], DISTANCE + HALF_PLANE)
    return np.asarray(is_on_end | np.isclose(np.abs(x[0]), HALF_PLANE))

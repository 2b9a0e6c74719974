"""Problems of section V21 with known tractions or flows at each node of an interface.

They are bars on a floor under each interface law, a joint whose conductance rises with a linear
pressure, tied blocks in bending, and a block in a groove.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, Mesh, create_box
from scipy.optimize import brentq

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
)
from pw_elements.conduction import interface_conduction
from pw_elements.contact import (
    OPEN,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    Plane,
    solve_contact,
)
from pw_elements.contact.model import (
    CohesiveContact,
    ContactState,
    ElasticInterface,
    InterfaceLaw,
    MatchingNodes,
    PairState,
    Tie,
    UnilateralContact,
)
from pw_elements.meshes import triangles
from pw_elements.spaces import Marker, locate_exterior_facets
from study.meshes.two_body_meshes import join_lower_and_upper_mesh
from study.model.discretisation import make_element_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

NO_WEIGHT = 1e-9
"""Weight over its piecewise-linear counterpart up to which a node counts as weightless."""


def make_dimensionless_result(
    scalars: Mapping[str, float], curves: Mapping[str, npt.NDArray[np.floating]], dofs: int
) -> Result:
    """Return a result whose scalars have no units."""
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, assign_unit_one_to_scalars(numbers), curves, dofs=dofs)


def on_plane(axis: int, coordinate: float) -> Marker:
    """Return a function that marks points (dim, n) whose coordinate along an axis has a value."""

    def is_on_plane(x: Array) -> Mask:
        return np.asarray(np.isclose(x[axis], coordinate))

    return is_on_plane


@dataclass(frozen=True)
class NodalAreas:
    """Areas of the m nodes of an interface.

    Attributes:
        own: Integrals of the nodes' own weight functions, which are quadratic for standard
            elements.
        tributary: Tributary areas, which are the integrals of piecewise-linear functions.
    """

    own: Array
    tributary: Array

    @classmethod
    def from_body(cls, body: Body, marker: Marker) -> "NodalAreas":
        """Integrate weight functions over the marked part of the boundary.

        Args:
            body: Elastic body.
            marker: Marker of the interface.
        """
        surface = SurfaceNodes.from_body(body, marker)
        return cls(surface.weight_area, surface.tributary_area)

    @classmethod
    def from_nodes(cls, blocks: "ElasticBlock", x: Array) -> "NodalAreas":
        """Return the areas of nodes at equal distances x (m,) of a straight line of elements.

        They are Simpson's weights for a standard element with quadratic functions.

        Args:
            blocks: Body with the element.
            x: Positions, in order; those of vertices have even numbers.
        """
        tributary = np.gradient(x)
        tributary[[0, -1]] /= 2
        if not blocks.element.startswith("galerkin"):
            return cls(tributary, tributary)
        factor = np.where(np.arange(len(x)) % 2, 4 / 3, 2 / 3)
        return cls(tributary * factor, tributary)

    @property
    def has_weight(self) -> Mask:
        """Mask (m,) of the nodes whose own weight is not zero."""
        return np.asarray(np.abs(self.own) > NO_WEIGHT * self.tributary)

    def largest_errors(self, nodal_values: Array, exact: Array | float) -> tuple[float, float]:
        """Return the largest errors of tractions, over the largest exact one.

        Args:
            nodal_values: Nodal forces or flows (m,).
            exact: Exact tractions (m,), or a uniform one.

        Returns:
            Errors of values over own weights, at nodes that have one, and over tributary areas.
        """
        scale, nodes = np.abs(exact).max(), self.has_weight
        own = nodal_values[nodes] / self.own[nodes] - np.broadcast_to(exact, nodes.shape)[nodes]
        tributary = nodal_values / self.tributary - exact
        return float(np.abs(own).max() / scale), float(np.abs(tributary).max() / scale)


class ElasticBlock:
    """Elastic body in plane strain or in space, with its stiffness.

    Args:
        element: Name of the element.
        mesh: Mesh on one process.
        poissons_ratio: Poisson's ratio.
        youngs_modulus: Young's modulus.
    """

    def __init__(
        self, element: str, mesh: Mesh, poissons_ratio: float, youngs_modulus: float = 1000.0
    ) -> None:
        self.element, self.dim = element, mesh.geometry.dim
        material = Material(youngs_modulus, poissons_ratio)
        state = "plane strain" if self.dim == 2 else "solid"
        self.body = Body(make_element_spaces(element, mesh), material, state)
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())

    @property
    def n_dofs(self) -> int:
        """Number of displacement components."""
        return int(self.K.getSize()[0])

    def traction_load(self, traction: Array | tuple[float, ...], where: Marker) -> PETSc.Vec:
        """Return the load (n,) of a uniform traction on a part of the boundary."""
        surface = boundary_measure(self.body.spaces.mesh, where)
        return assemble_vector(self.body.surface_load(np.asarray(traction), surface))

    def supports(self, *conditions: tuple[int, Marker] | tuple[int, Marker, float]) -> Reduction:
        """Return supports from conditions (component, marker[, value])."""
        return Reduction.dirichlet(self.space, [prescribe(self.space, *c) for c in conditions])


# Bars with uniform stress on a floor

WIDTH, HEIGHT, YOUNGS_MODULUS = 1.0, 2.0, 1000.0
BAR_STIFFNESS = YOUNGS_MODULUS / HEIGHT
"""Stress of the bar over the displacement of its end."""
LAYER = ElasticInterface(normal_stiffness=400.0, tangential_stiffness=150.0)
COHESION = CohesiveContact(stiffness=2000.0, strength=2.0, toughness=0.02)
OPENING_DISTANCES = 0.004, 0.01
"""Displacements of the floor; the second is reached on the falling branch of the cohesion."""
REGULARISATION_LENGTH, PRESSURE, SHEAR = 0.003, 10.0, 2.0
WEAR, WEAR_SLIPS, PRESSING = 1e-3, (0.4, 0.4, 0.4, 0.4), 0.01
CONDUCTIVITY, TOOL_TEMPERATURE, CONDUCTANCE_PER_PRESSURE = 2.0, 100.0, 0.5


def falling_friction(pressure: Array, path: Array) -> tuple[Array, Array, Array]:
    """Return coefficients that fall with pressure and path, and their derivatives by both."""
    by_pressure, by_path = 1 / (1 + pressure / 40), np.exp(-path / 0.5)
    falling = 0.3 * by_pressure * by_path
    return 0.1 + falling, -falling * by_pressure / 40, -falling / 0.5


class _BarOnFloor(ElasticBlock):
    """Bar without lateral contraction above a rigid floor."""

    def __init__(self, element: str) -> None:
        if element.endswith("T10"):
            corners = [np.zeros(3), np.array([WIDTH, WIDTH, HEIGHT])]
            mesh = create_box(MPI.COMM_SELF, corners, [2, 2, 3], CellType.tetrahedron)
        else:
            mesh = triangles(MPI.COMM_SELF, (0, 0), (WIDTH, HEIGHT), (3, 4))
        super().__init__(element, mesh, 0.0, YOUNGS_MODULUS)
        self.up = self.dim - 1
        self.top, self.base = on_plane(self.up, HEIGHT), on_plane(self.up, 0.0)
        self.area = WIDTH**self.up
        self.areas = NodalAreas.from_body(self.body, self.base)

    def problem(self, law: InterfaceLaw | None, top_displacement: float | None) -> ContactProblem:
        """Return the problem of the bar, whose top is held, or free if the displacement is None."""
        normal = np.eye(self.dim)[self.up]
        floor = ContactPair(self.base, Plane(np.zeros(self.dim), normal), interface_law=law)
        conditions = []
        if top_displacement is not None:
            values = [0.0] * self.up + [top_displacement]
            conditions = [(i, self.top, value) for i, value in enumerate(values)]
        return ContactProblem(self.K, self.supports(*conditions), floor, self.space)

    def translation(self, along: float, up: float) -> Motion:
        """Return a motion of the floor along the first axis and upwards."""
        return Motion(along * np.eye(self.dim)[0] + up * np.eye(self.dim)[self.up])

    def vector(self, along: float, up: float) -> Array:
        """Return a vector (dim,) with components along the first axis and upwards."""
        return np.asarray(along * np.eye(self.dim)[0] + up * np.eye(self.dim)[self.up])


def _layer(bar: _BarOnFloor) -> tuple[Array, float]:
    problem, distance = bar.problem(LAYER, 0.0), 0.01
    (pair,) = problem.step(problem.undeformed, motions=bar.translation(0, -distance)).pairs
    return pair.force_normal, -distance / (1 / BAR_STIFFNESS + 1 / LAYER.normal_stiffness)


def _cohesion(bar: _BarOnFloor) -> tuple[Array, float]:
    problem = bar.problem(COHESION, 0.0)
    state = problem.undeformed
    for distance in OPENING_DISTANCES:
        state = problem.step(state, motions=bar.translation(0, -distance))
    d_0 = COHESION.strength / COHESION.stiffness
    d_f = 2 * COHESION.toughness / COHESION.strength
    slope = COHESION.strength / (d_f - d_0)
    opening = (BAR_STIFFNESS * OPENING_DISTANCES[-1] - slope * d_f) / (BAR_STIFFNESS - slope)
    return state.pairs[0].force_normal, -slope * (d_f - opening)


def _regularised_falling_friction(bar: _BarOnFloor) -> tuple[PairState, float]:
    """Shear the pressed bar uniformly; friction falls with pressure and path, and is smooth.

    Returns:
        Last state of the pair, and the exact slip.
    """
    law = UnilateralContact(falling_friction, regularisation_length=REGULARISATION_LENGTH)
    problem = bar.problem(law, None)
    pressed = bar.traction_load(bar.vector(0, -PRESSURE), bar.top)
    load = bar.traction_load(bar.vector(SHEAR, -PRESSURE), bar.top)
    for x, sign in ((WIDTH, 1), (0.0, -1)):
        load += bar.traction_load(bar.vector(0, sign * SHEAR), on_plane(0, x))
    (pair,) = problem.step(problem.step(problem.undeformed, pressed), load).pairs

    def excess(slip: float) -> float:
        mu = falling_friction(np.array([PRESSURE]), np.array([slip]))[0][0]
        return float(mu * PRESSURE * slip / np.hypot(slip, REGULARISATION_LENGTH) - SHEAR)

    return pair, brentq(excess, 0.0, 2 * REGULARISATION_LENGTH, xtol=1e-16)


def _wear(bar: _BarOnFloor) -> tuple[PairState, float, float]:
    """Return the last state, and the exact pressure and worn depth of a bar between two ends."""
    problem = bar.problem(UnilateralContact(0.0, wear_coefficient=WEAR), -PRESSING)
    state, position, depth, pressure = problem.undeformed, 0.0, 0.0, 0.0
    for slip in (0.0, *WEAR_SLIPS):
        position += slip
        state = problem.step(state, motions=bar.translation(position, 0.0))
        pressure = BAR_STIFFNESS * (PRESSING - depth)
        depth += WEAR * pressure * slip
    return state.pairs[0], pressure, depth


def _heat(bar: _BarOnFloor) -> tuple[Array, float]:
    """Return nodal heat flows from a hot floor into the pressed bar, and the exact flux."""
    problem = bar.problem(None, -PRESSING)
    state = problem.step(problem.undeformed)
    heat = make_element_spaces_for_heat(bar.element, bar.body.spaces.mesh)
    conduction = assemble_conduction(heat)
    joint, load = interface_conduction(
        state,
        bar.body,
        heat,
        lambda pressure, _: CONDUCTANCE_PER_PRESSURE * pressure,
        tool_temperature=TOOL_TEMPERATURE,
    )
    cold = Reduction.dirichlet(heat.trial, [prescribe(heat.trial, 0, bar.top)])
    temperature = solve(conduction + joint, load, cold)
    flows = (conduction * temperature).array[state.pairs[0].node]
    conductance = CONDUCTANCE_PER_PRESSURE * BAR_STIFFNESS * PRESSING
    return flows, TOOL_TEMPERATURE / (HEIGHT / CONDUCTIVITY + 1 / conductance)


def uniform(element: str) -> Result:
    """Put a bar with uniform stress on a floor under each law; compare nodal values.

    Args:
        element: Name of the element.
    """
    bar = _BarOnFloor(element)
    worn, pressure, depth = _wear(bar)
    rubbed, slip = _regularised_falling_friction(bar)
    nodal_values: dict[str, tuple[Array, float]] = {
        "wear": (worn.force_normal, pressure),
        "heat": _heat(bar),
        "layer": _layer(bar),
        "cohesion": _cohesion(bar),
        "friction": (rubbed.force_tangential[:, 0], -SHEAR),
    }
    scalars: dict[str, float] = {}
    for name, (values, exact) in nodal_values.items():
        scalars[f"{name}_own"], scalars[f"{name}_tributary"] = bar.areas.largest_errors(
            values, exact
        )
        scalars[f"{name}_sum"] = abs(values.sum() / (exact * bar.area) - 1)
    scalars |= {
        "largest_own": max(scalars[f"{name}_own"] for name in nodal_values),
        "largest_tributary": max(scalars[f"{name}_tributary"] for name in nodal_values),
        "smallest_tributary": min(scalars[f"{name}_tributary"] for name in nodal_values),
        "worn_depth_error": float(np.abs(worn.law_history[:, -1] / depth - 1).max()),
        "slip_error": float(np.abs(rubbed.slip[:, 0] / slip - 1).max()),
        "weightless": float(np.mean(~bar.areas.has_weight)),
    }
    return make_dimensionless_result(scalars, {}, bar.n_dofs)


def make_element_spaces_for_heat(element: str, mesh: Mesh) -> Spaces:
    """Return scalar spaces of the temperature with the weight functions of an element."""
    make = Spaces.galerkin if element.startswith("galerkin") else Spaces.petrov_galerkin
    return make(mesh, 0)


def assemble_conduction(heat: Spaces) -> PETSc.Mat:
    """Return the matrix of conduction in the bodies."""
    T, w = ufl.TrialFunction(heat.trial), ufl.TestFunction(heat.test)
    return assemble_matrix(CONDUCTIVITY * ufl.inner(ufl.grad(T), ufl.grad(w)) * ufl.dx)


# Two blocks with a linear pressure between them: heat and tie

PRESSURE_SLOPE = 0.9
"""Slope p_1 / p_0 of the pressure p_0 (1 + slope x) between blocks over -1 < x < 1."""
MEAN_PRESSURE = 1.0
BIOT_NUMBER = 2.0
"""Mean conductance of the joint times the height of a block over its conductivity."""
N_MODES = 400


def exact_flux(x: Array) -> Array:
    """Return the heat flux (m,) at positions x (m,) from the upper into the lower block.

    Temperatures are 0 at the base y = 0 and 1 at the top y = 2; the conductance of the joint at
    y = 1 is proportional to the linear pressure. With cosines along x, which meet the insulated
    sides, the jump is 1 less twice the temperature of the lower block, by symmetry. The series
    has `N_MODES` terms, found by Galerkin's method with Gauss quadrature. The flux is computed from
    the surface temperature, whose terms fall faster.

    Args:
        x: Positions between -1 and 1.
    """
    wave_number = np.pi / 2 * np.arange(N_MODES)
    points, weights = np.polynomial.legendre.leggauss(4 * N_MODES)
    compliance = np.ones(N_MODES)  # surface temperature over flux times conductivity
    compliance[1:] = np.tanh(wave_number[1:]) / wave_number[1:]

    def cosines(at: Array) -> Array:
        return np.asarray(np.cos(np.multiply.outer(at + 1, wave_number)))

    modes, conductance = cosines(points), CONDUCTIVITY * BIOT_NUMBER * (1 + PRESSURE_SLOPE * points)
    equations = modes.T @ (
        weights[:, None] * modes * (1 + 2 * np.outer(conductance, compliance) / CONDUCTIVITY)
    )
    amplitude = np.linalg.solve(equations, modes.T @ (weights * conductance))
    surface_temperature = cosines(x) @ (compliance * amplitude) / CONDUCTIVITY
    return CONDUCTIVITY * BIOT_NUMBER * (1 + PRESSURE_SLOPE * x) * (1 - 2 * surface_temperature)


class _StackedBlocks(ElasticBlock):
    """Two blocks over -1 < x < 1, of height 1 each, under a linear pressure on the top.

    Args:
        element: Name of the element.
        divisions: Numbers of elements along the lower and the upper side of the interface.
    """

    def __init__(self, element: str, divisions: tuple[int, int]) -> None:
        meshes = [
            triangles(MPI.COMM_SELF, (-1, y), (1, y + 1), (n, (n + 1) // 2), "left_right")
            for n, y in zip(divisions, (0, 1), strict=True)
        ]
        mesh, _ = join_lower_and_upper_mesh(*meshes)
        super().__init__(element, mesh, 0.3)
        facets = locate_exterior_facets(mesh, on_plane(1, 1.0))
        cells = mesh.topology.connectivity(1, 2)
        x = self.space.tabulate_dof_coordinates()
        height = np.array([x[self.space.dofmap.list[cells.links(f)[0]], 1].mean() for f in facets])
        self.lower_facets, self.upper_facets = facets[height < 1], facets[height > 1]

    def upper_nodes(self) -> npt.NDArray[np.int32]:
        """Return the local numbers of the nodes of the upper block at the interface."""
        return np.asarray(
            fem.locate_dofs_topological(self.space, 1, self.upper_facets), dtype=np.int32
        )

    def solve_linear_pressure(
        self, pair: ContactPair, sign: float, held_points: Array
    ) -> ContactState:
        """Return the state under the pressure times `sign`.

        Args:
            pair: Contact pair.
            sign: 1 for compression, -1 for tension.
            held_points: Heights (k,) at which nodes with x = 0 are held laterally.
        """
        mesh = self.body.spaces.mesh
        pressure = sign * MEAN_PRESSURE * (1 + PRESSURE_SLOPE * ufl.SpatialCoordinate(mesh)[0])
        top = boundary_measure(mesh, on_plane(1, 2.0))
        load = assemble_vector(self.body.surface_load(ufl.as_vector((0, -pressure)), top))

        def is_held_laterally(x: Array) -> Mask:
            is_at_height = np.isclose(x[1][:, None], held_points).any(axis=1)
            return np.asarray(np.isclose(x[0], 0) & is_at_height)

        held = self.supports((1, on_plane(1, 0.0)), (0, is_held_laterally))
        (state,) = solve_contact(self.K, load, held, pair, self.space)
        return state


def joint(element: str, elements: int) -> Result:
    """Conduct heat across a joint whose conductance follows a linear contact pressure.

    Args:
        element: Name of the element.
        elements: Number of elements along the joint.
    """
    blocks = _StackedBlocks(element, (elements, elements))
    lower = fem.locate_dofs_topological(blocks.space, 1, blocks.lower_facets)
    surface = MatchingNodes(lower, Plane((0, 1), (0, 1)))
    pair = ContactPair(blocks.upper_nodes(), surface)
    state = blocks.solve_linear_pressure(pair, 1.0, np.array([0.0, 2.0]))
    heat = make_element_spaces_for_heat(element, blocks.body.spaces.mesh)
    conduction = assemble_conduction(heat)
    scale = CONDUCTIVITY * BIOT_NUMBER / MEAN_PRESSURE
    exchange, _ = interface_conduction(
        state, blocks.body, heat, lambda pressure, _: scale * pressure
    )
    held = [
        prescribe(heat.trial, 0, on_plane(1, y), value) for y, value in ((0.0, 0.0), (2.0, 1.0))
    ]
    temperature = solve(
        conduction + exchange, exchange.createVecLeft(), Reduction.dirichlet(heat.trial, held)
    )
    (contact,) = state.pairs
    x, flows = contact.position[:, 0], -(conduction * temperature).array[contact.node]
    areas = NodalAreas.from_nodes(blocks, x)
    points, weights = np.polynomial.legendre.leggauss(200)
    # the weight function of an end node of the new element has its centroid off the end
    end = np.argmin(x)
    centroid = -1 + (0.0 if element.startswith("galerkin") else np.diff(np.sort(x))[0] / 3)
    exact, at_centroid, exact_at_points = np.split(
        exact_flux(np.concatenate([x, [centroid], points])), [len(x), len(x) + 1]
    )
    pressure = MEAN_PRESSURE * (1 + PRESSURE_SLOPE * x)
    total, inner = weights @ exact_at_points, slice(1, -1)
    flux_at_end = flows[end] / areas.own[end]
    scalars = {
        "total_error": abs(flows.sum() / total - 1),
        "total": flows.sum(),
        "flux_end": flux_at_end / exact[end] - 1,
        "flux_centroid": flux_at_end / at_centroid[0] - 1,
    }
    for reading, area in (("own", areas.own), ("tributary", areas.tributary)):
        for name, values, reference in (
            ("flux", flows, exact),
            ("pressure", contact.force_normal, pressure),
        ):
            error = values / area / reference - 1
            scalars[f"{name}_{reading}"] = np.sqrt(np.mean(error[inner] ** 2))
    curves = {
        "x": x,
        "flux_own": flows / areas.own,
        "flux_tributary": flows / areas.tributary,
        "exact": exact,
    }
    return make_dimensionless_result(scalars, curves, blocks.n_dofs)


def tie(element: str, elements: int) -> Result:
    """Bend and stretch two tied blocks whose meshes do not match.

    Args:
        element: Name of the element, which needs piecewise-linear weights.
        elements: Number of elements of the lower block along the interface; the upper block has
            half as many again.
    """
    blocks = _StackedBlocks(element, (elements, 3 * elements // 2))
    surface = DeformableSurface(blocks.lower_facets)
    pair = ContactPair(blocks.upper_nodes(), surface, interface_law=Tie())
    state = blocks.solve_linear_pressure(pair, -1.0, np.zeros(1))
    (tied,) = state.pairs
    x = tied.position[:, 0]
    areas = NodalAreas.from_nodes(blocks, x)
    exact = -MEAN_PRESSURE * (1 + PRESSURE_SLOPE * x)
    nodes = blocks.space.tabulate_dof_coordinates()[:, :2]
    displacement = state.displacement.array.reshape(-1, 2)
    exact_displacement = _displacement_under_linear_pressure(nodes, -1.0)
    displacement_error = np.abs(displacement - exact_displacement).max()
    scalars = {
        "traction_error": np.abs(tied.force_normal / areas.own - exact)[1:-1].max()
        / np.abs(exact).max(),
        "shear": np.abs(tied.force_tangential[:, 0]).max() / np.abs(tied.force_normal).max(),
        "displacement_error": displacement_error / np.abs(exact_displacement).max(),
        "sum_error": abs(tied.force[1] / (-2 * MEAN_PRESSURE) - 1),
        "moment_error": abs(tied.force_normal @ x / (-2 * MEAN_PRESSURE * PRESSURE_SLOPE / 3) - 1),
    }
    curves = {"x": x, "traction": tied.force_normal / areas.own, "exact": exact}
    return make_dimensionless_result(scalars, curves, blocks.n_dofs)


def _displacement_under_linear_pressure(x: Array, sign: float) -> Array:
    """Return displacements (n, 2) at points (n, 2) of one block of height 2 in plane strain."""
    nu = 0.3
    modulus, ratio = YOUNGS_MODULUS / (1 - nu**2), nu / (1 - nu)
    p, slope = sign * MEAN_PRESSURE / modulus, PRESSURE_SLOPE
    along = ratio * (x[:, 0] + slope * x[:, 0] ** 2 / 2) + slope * x[:, 1] ** 2 / 2
    return np.asarray(p * np.column_stack([along, -(1 + slope * x[:, 0]) * x[:, 1]]))


# A block in a groove, whose lowest nodes belong to two pairs

GROOVE_FRICTION, GROOVE_LENGTH, GROOVE_PRESSURE, GROOVE_SLIP = 0.3, 2.0, 1.0, 1.0


def groove(element: str) -> Result:
    """Press a block into a right-angled groove, and drag the groove along its axis.

    The pressures on the block's other two faces give a uniform stress. Groove and block then have
    the exact normal forces of statics, and a drag of friction over sin 45° times the weight that
    both pressures amount to.

    Args:
        element: Name of the element.
    """
    corners = [np.zeros(3), np.array([1.0, 1.0, GROOVE_LENGTH])]
    mesh = create_box(MPI.COMM_SELF, corners, [2, 2, 3], CellType.tetrahedron)
    block = ElasticBlock(element, mesh, 0.3)
    load = block.traction_load(-GROOVE_PRESSURE * np.eye(3)[0], on_plane(0, 1.0))
    load += block.traction_load(-GROOVE_PRESSURE * np.eye(3)[1], on_plane(1, 1.0))

    def is_far_edge(x: Array) -> Mask:
        return np.asarray(np.isclose(x[0], 1) & np.isclose(x[1], 1))

    held = block.supports((2, is_far_edge))
    planes = [Plane(np.zeros(3), np.eye(3)[i]) for i in range(2)]
    areas = [NodalAreas.from_body(block.body, on_plane(i, 0.0)) for i in range(2)]
    scalars: dict[str, float] = {}
    area = GROOVE_LENGTH  # of each face; its width is 1
    free_of_supports = block.supports((2, on_plane(2, 0.0)))
    smooth = [ContactPair(on_plane(i, 0.0), planes[i]) for i in range(2)]
    (pressed,) = solve_contact(block.K, load, free_of_supports, smooth, block.space)
    errors = np.array(
        [
            a.largest_errors(pair.force_normal, GROOVE_PRESSURE)
            for a, pair in zip(areas, pressed.pairs, strict=True)
        ]
    )
    scalars["pressed_own"], scalars["pressed_tributary"] = errors.max(axis=0)
    scalars["pressed_sum"] = max(
        abs(pair.force_normal.sum() / (GROOVE_PRESSURE * area) - 1) for pair in pressed.pairs
    )
    rough = [ContactPair(p.nodes, p.surface, GROOVE_FRICTION) for p in smooth]
    problem = ContactProblem(block.K, held, rough, block.space)
    state = problem.undeformed
    for slip in (0.0, GROOVE_SLIP):
        state = problem.step(state, load, [Motion((0, 0, slip))] * 2)
    force = np.array([pair.force for pair in state.pairs])
    drag = GROOVE_FRICTION / np.sin(np.pi / 4) * np.sqrt(2) * GROOVE_PRESSURE * area
    cone = [
        np.abs(np.linalg.norm(pair.force_tangential, axis=1) - GROOVE_FRICTION * pair.force_normal)
        for pair in state.pairs
    ]
    largest = max(pair.force_normal.max() for pair in state.pairs)
    scalars |= {
        "drag_over_exact": force[:, 2].sum() / drag,
        "cone_error": max(c.max() for c in cone) / largest,
        "balance_error": np.abs(force[:, :2].sum(axis=0) / (GROOVE_PRESSURE * area) - 1).max(),
        "open": np.mean(np.concatenate([pair.status for pair in state.pairs]) == OPEN),
    }
    return make_dimensionless_result(scalars, {}, block.n_dofs)

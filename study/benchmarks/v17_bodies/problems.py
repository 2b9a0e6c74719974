"""Problems of two deformable bodies that slide on each other at large strains."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, locate_entities_boundary
from scipy.integrate import quad

from pw_elements import Spaces, SurfaceNodes, prescribe
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact import OPEN, SLIP, ContactPair, ContactProblem, DeformableSurface
from pw_elements.contact.interface import gather_boundary_facets
from pw_elements.contact.model import ContactState, PairState
from pw_elements.contact.nodes import MAX_CONTACT_VIOLATION_PER_NODAL_FORCE
from pw_elements.meshes import curved_mesh
from study.benchmarks.v17_bodies.quadratic_multipliers import DualQuadraticContactProblem
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.two_body_meshes import join_meshes
from study.model.discretisation import spaces
from study.model.units import dimensionless
from study.run.store import Result
from study.solutions.calculix.calculix import load_unchanged_answer
from study.solutions.calculix.die import (
    CURVATURE,
    DEPTH,
    DIES,
    FRICTION,
    GAP,
    INCREMENT_ENDS,
    N_CALCULIX_INCREMENTS,
    N_PRESSING_INCREMENTS,
    SLIDING_ELEMENTS,
    mesh_lines,
    shape_die,
)
from study.solutions.rubber import RubberBody, lame_over_shear

# Lengths relative to the width of the die, stresses relative to the shear modulus
QUADRATURE_DEGREE, FIT_QUADRATURE_DEGREE = 4, 6
N_END_NODES = 2
"""Number of nodes at each end of the contact that do not count for evenness."""
MIN_RELATIVE_SLAVE_FORCE = 1e-9
"""Force over the largest nodal force below which a slave's force is round-off."""
MIN_RELATIVE_MASTER_FORCE = 0.3
"""Force over the largest nodal force above which a node of the master counts for evenness."""
CONTACT_LAW_ROUND_OFF = 1e-12
"""Round-off of violations of the contact law, over the largest force."""

# A flat die, whose top is tilted to prevent the rear end from lifting
FLAT_ELEMENTS = (8, 6)
"""Numbers of elements over the die's width, of the flat die and of the block."""
FLAT_HEIGHT, FLAT_TRAVEL, FLAT_DEPTH, FLAT_TILT = 0.4, 1.0, 0.05, 0.5

RING_RADII, RING_DISTANCE, RING_TRAVEL = (0.7, 1.0), 0.005, 0.3
RING_CELLS = ((24, 2), (17, 2))
"""Numbers of cells around and across each half ring."""

TUBE_RADII, HOLE_RADIUS = ((1.0, 1.5), (1.55, 2.0)), 1.35
"""Inner and outer radii of both tubes, and the radius to which the hole of the inner one grows."""
TUBE_CELLS, TUBE_POISSONS_RATIO = 8, 0.49999
"""Number of cells across the inner tube (the outer one has two fewer); Poisson's ratio."""


@dataclass
class SlidingRecord:
    """States at the ends of increments, and violations of the contact law after each iteration."""

    states: list[ContactState] = field(default_factory=list)
    violations: list[list[float]] = field(default_factory=list)

    def summarise_iterations(self) -> dict[str, float]:
        """Count iterations (including abandoned attempts), cut increments and all increments.

        `quadratic` is the fraction of increments whose last iteration converges quadratically.
        """
        last_two = [v[-2:] for v in self.violations if len(v) > 1]
        is_quadratic = [
            last <= max(CONTACT_LAW_ROUND_OFF, 1e3 * previous**2) for previous, last in last_two
        ]
        return {
            "iterations_mean": float(np.mean([state.iterations for state in self.states])),
            "cut": float(sum(bool(state.substates) for state in self.states)),
            "increments": float(len(self.states)),
            "quadratic": float(np.mean(is_quadratic)),
        }

    def largest_force_imbalance(self) -> float:
        """Return the largest imbalance of the forces on both sides, over the force on one."""
        sums = [
            _contact_pair(state).force + _contact_pair(state).opposite_force.sum(axis=0)
            for state in self.states
        ]
        magnitudes = np.linalg.norm([_contact_pair(state).force for state in self.states], axis=1)
        return float((np.linalg.norm(sums, axis=1) / magnitudes).max())

    def largest_cone_violation(self) -> float:
        """Return the largest violation of the friction law, over the largest nodal force."""
        violations = []
        for pair in map(_contact_pair, self.states):
            limit = pair.friction * pair.force_normal
            excess = np.linalg.norm(pair.force_tangential, axis=1) - limit
            distance = np.where(pair.status == SLIP, np.abs(excess), excess)
            violations.append(distance.max() / np.abs(pair.force_vector).max())
        return float(max(0.0, *violations))


def _contact_pair(state: ContactState) -> PairState:
    return state.pairs[0]


def slide_bodies(
    bodies: RubberBody,
    sides: Sequence[Indices],
    set_displacements: Callable[[float, Array], None],
    prescribed_nodes: Sequence[Mask],
    times: Sequence[float],
    is_flat: Callable[[Array], Mask] | None = None,
) -> SlidingRecord:
    """Solve the increments of two bodies that slide on each other.

    Args:
        bodies: Both bodies in one mesh; standard elements have dual quadratic multipliers.
        sides: Facets of the slave and of the master.
        set_displacements: Function that writes prescribed displacements at a time to all nodes
            (n, 2).
        prescribed_nodes: Masks (n,) of the nodes to which these displacements are applied.
        times: Ends of the increments.
        is_flat: Marks nodes whose vertical displacement is zero.
    """
    space, record = bodies.displacements.space, SlidingRecord()
    prescribed = fem.Function(space)
    nodes = np.flatnonzero(np.any(prescribed_nodes, axis=0)).astype(np.int32)
    supports = [fem.dirichletbc(prescribed, nodes)]
    if is_flat is not None:
        supports.append(prescribe(space, 1, is_flat))

    def record_violation(progress: object) -> None:
        if getattr(progress, "state", None) is None:
            violation = getattr(progress, "violation", np.inf)
            record.violations[-1].append(violation * MAX_CONTACT_VIOLATION_PER_NODAL_FORCE)

    slave, master = (side.astype(np.int32) for side in sides)
    slave_dofs = fem.locate_dofs_topological(space, 1, slave)
    pair = ContactPair(slave_dofs, DeformableSurface(master, False), FRICTION)
    arguments = bodies.residual, bodies.solution, supports, pair
    problem: ContactProblem | DualQuadraticContactProblem
    if bodies.element.startswith("pw"):
        problem = ContactProblem.of_residual(*arguments, callback=record_violation)
    else:
        traces = gather_boundary_facets(space, slave), gather_boundary_facets(space, master)
        problem = DualQuadraticContactProblem(*arguments, traces, record_violation)
    state, start = problem.undeformed, 0.0
    for end in times:

        def load(load_factor: float, start: float = start, end: float = end) -> None:
            time = (1 - load_factor) * start + load_factor * end
            set_displacements(time, prescribed.x.array.reshape(-1, 2))

        record.violations.append([])
        state, start = problem.step(state, load), end
        record.states.append(state)
    return record


def make_die_mesh(
    slave_elements: int, master_elements: int
) -> tuple[Mesh, tuple[Indices, Indices]]:
    """Mesh a parabolic die and a block; return the mesh and the facets of slave and master.

    Args:
        slave_elements: Number of elements over the width of the die.
        master_elements: Number of elements of the block over the same width.
    """
    block, upper = mesh_lines(slave_elements, master_elements)
    mesh, _ = join_meshes(
        _make_quadratic_mesh(*block, lambda x: x), _make_quadratic_mesh(*upper, shape_die)
    )

    def is_under_die(x: Array) -> Mask:
        return np.asarray(np.isclose(x[1], GAP + CURVATURE * x[0] ** 2 / 2) & (x[1] > GAP / 2))

    return mesh, (_find_facets(mesh, is_under_die), _find_facets(mesh, partial(_is_at_height, 0.0)))


def _is_at_height(y: float, x: Array) -> Mask:
    return np.asarray(np.isclose(x[1], y))


def _find_facets(mesh: Mesh, is_inside: Callable[[Array], Mask]) -> Indices:
    """Return the exterior facets all of whose vertices are inside a region."""
    return locate_entities_boundary(mesh, mesh.topology.dim - 1, is_inside).astype(np.int64)


def die(element: str, own: int, opposite: int) -> Result:
    """Press a parabolic die into a block and slide it over ten of its elements."""
    bodies, sides, record = _press_and_slide_die(element, own, opposite)
    sliding_states = record.states[N_PRESSING_INCREMENTS:]
    weight_area = _integrate_weight_functions(bodies, sides)
    last, force = (
        _contact_pair(sliding_states[-1]),
        np.array([_contact_pair(s).force for s in record.states]),
    )
    node, master_force = _master_normal_forces(bodies, sliding_states[-1])
    displacement = _nodal_displacement(bodies, sliding_states[-1])
    scalars = record.summarise_iterations() | {
        "balance_error": record.largest_force_imbalance(),
        "moment_defect": max(_relative_moment_defect(bodies, s) for s in sliding_states),
        "cone_error": record.largest_cone_violation(),
        **_measure_evenness(bodies, sliding_states, np.ones(len(bodies.x)), ""),
        **_measure_evenness(bodies, sliding_states, weight_area, "_pressure"),
        "edge_draw": max(
            _tension_ratio(_master_normal_forces(bodies, s)[1]) for s in sliding_states
        ),
        "N": force[-1, 1],
        "T_over_N": abs(force[-1, 0] / force[-1, 1]),
        "slipping": float(np.mean(last.status[last.status != OPEN] == SLIP)),
    }
    curves = {
        "x": (last.position + last.displacement)[:, 0],
        "force_n": last.force_normal,
        "pressure": last.force_normal / weight_area[last.node],
        "status": last.status.astype(float),
        "master_x": bodies.x[node, 0] + displacement[node, 0],
        "master_force": master_force,
        "master_pressure": master_force / weight_area[node],
        "nodes": bodies.x + displacement,
        "cells": bodies.displacements.space.dofmap.list.copy(),
        "N": force[:, 1],
        "T": force[:, 0],
    }
    return _make_result(scalars, curves, len(bodies.solution.x.array))


def _press_and_slide_die(
    element: str, slave_elements: int, master_elements: int, calculix_energy: bool = False
) -> tuple[RubberBody, tuple[Indices, Indices], SlidingRecord]:
    mesh, sides = make_die_mesh(slave_elements, master_elements)
    bodies = RubberBody(element, mesh, QUADRATURE_DEGREE, calculix_energy)
    x = bodies.x
    is_base, is_top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], 1)
    travel = SLIDING_ELEMENTS / slave_elements

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[is_top] = [travel * max(0.0, time - 1), -DEPTH * min(time, 1.0)]

    times = INCREMENT_ENDS[:N_CALCULIX_INCREMENTS] if calculix_energy else INCREMENT_ENDS
    return bodies, sides, slide_bodies(bodies, sides, set_displacements, (is_base, is_top), times)


def against_calculix(element: str, case: str, tracked: str) -> Result:
    """Move the die as in CalculiX, with its strain energy; compare forces with the record."""
    peer, recorded = DIES[case], load_unchanged_answer(case, tracked).numbers
    bodies, _, record = _press_and_slide_die(
        element, peer.die_elements, peer.block_elements, calculix_energy=True
    )
    force = np.array([_contact_pair(state).force for state in record.states])
    normal, tangential = force[:, 1], -force[:, 0]
    largest = recorded["N"].max()
    scalars = {
        "N_difference": np.abs(normal - recorded["N"]).max() / largest,
        "T_difference": np.abs(tangential - recorded["T"]).max() / largest,
        "N": normal[-1],
        "T": tangential[-1],
    }
    curves = {
        "N": normal,
        "T": tangential,
        "N_calculix": recorded["N"],
        "T_calculix": recorded["T"],
    }
    return _make_result(scalars, curves, len(bodies.solution.x.array))


def ironed(element: str) -> Result:
    """Slide a flat die on a block whose upper side stays flat; all nodes slip."""
    (across, _), (die_lines, _) = mesh_lines(*FLAT_ELEMENTS)
    die_heights = GAP + _divide_interval(0.0, FLAT_HEIGHT, 3)
    block = _make_quadratic_mesh(across, _divide_interval(-1.0, 0.0, 3), lambda x: x)
    mesh, _ = join_meshes(block, _make_quadratic_mesh(die_lines, die_heights, lambda x: x))
    sides = [_find_facets(mesh, partial(_is_at_height, y)) for y in (GAP, 0.0)]
    bodies = RubberBody(element, mesh, QUADRATURE_DEGREE)
    x = bodies.x
    is_base, is_top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], die_heights[-1])

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[is_top, 0] = FLAT_TRAVEL * max(0.0, time - 1)
        displacement[is_top, 1] = -FLAT_DEPTH * min(time, 1.0) * (1 - FLAT_TILT * x[is_top, 0])

    times = [0.5, 1.0, *(1 + (k + 1) / 8 for k in range(8))]
    record = slide_bodies(
        bodies, sides, set_displacements, (is_base, is_top), times, lambda x: np.isclose(x[1], 0)
    )
    pairs = [_contact_pair(state) for state in record.states[-4:]]
    scalars = record.summarise_iterations() | {
        "friction_error": max(abs(-p.force[0] / p.force[1] / FRICTION - 1) for p in pairs),
        "slipping": min(float(np.mean(p.status == SLIP)) for p in pairs),
        "cone_error": record.largest_cone_violation(),
        "balance_error": record.largest_force_imbalance(),
    }
    return _make_result(scalars, {}, len(bodies.solution.x.array))


def turned(element: str, degrees: int) -> Result:
    """Rotate the pressed die and block together; forces should rotate with them, without slip."""
    mesh, sides = make_die_mesh(8, 6)
    bodies = RubberBody(element, mesh, QUADRATURE_DEGREE)
    x = bodies.x
    is_base, is_top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], 1)
    n_increments = round(degrees / 17)

    def set_displacements(time: float, displacement: Array) -> None:
        position = x + np.outer(is_top, [0.0, -DEPTH * min(time, 1.0)])
        displacement[:] = position @ _rotation_matrix(degrees * max(0.0, time - 1)).T - x

    times = [0.5, 1.0, *(1 + (k + 1) / n_increments for k in range(n_increments))]
    record = slide_bodies(bodies, sides, set_displacements, (is_base, is_top), times)
    pressed, last = _contact_pair(record.states[1]), _contact_pair(record.states[-1])
    rotated_back = last.force_vector @ _rotation_matrix(degrees)
    largest = np.abs(pressed.force_vector).max()
    slips = [
        np.abs(_contact_pair(s).slip[_contact_pair(s).status != OPEN]).max()
        for s in record.states[2:]
    ]
    scalars = record.summarise_iterations() | {
        "objectivity_error": float(np.abs(rotated_back - pressed.force_vector).max() / largest),
        "slip": float(max(slips)),
        "balance_error": record.largest_force_imbalance(),
    }
    return _make_result(scalars, {}, len(bodies.solution.x.array))


def rings(element: str) -> Result:
    """Press two half rings together twice, with each of them as the slave."""
    forces, scalars, dofs = [], {}, 0
    for is_upper_slave in (False, True):
        half_rings = []
        for number, (n_around, n_across) in enumerate(RING_CELLS):
            angles, radii = (
                _divide_interval(0.0, np.pi, n_around),
                _divide_interval(*RING_RADII, n_across),
            )
            half_rings.append(_make_half_ring(angles, radii, is_upper=number == 1))
        mesh, _ = join_meshes(*half_rings)
        upper_centre = 2 * RING_RADII[1] + RING_DISTANCE

        def is_on_circle(centre: float, x: Array) -> Mask:
            return np.asarray(np.isclose(np.hypot(x[0], x[1] - centre), RING_RADII[1]))

        sides = [
            _find_facets(mesh, partial(is_on_circle, centre)) for centre in (0.0, upper_centre)
        ]
        bodies = RubberBody(element, mesh, QUADRATURE_DEGREE)
        is_low, is_high = (np.isclose(bodies.x[:, 1], height) for height in (0.0, upper_centre))

        def set_displacements(time: float, displacement: Array, is_high: Mask = is_high) -> None:
            displacement[is_high] = [0.0, -RING_TRAVEL * time]

        times = [(k + 1) / 8 for k in range(8)]
        record = slide_bodies(
            bodies,
            sides[::-1] if is_upper_slave else sides,
            set_displacements,
            (is_low, is_high),
            times,
        )
        forces.append(abs(_contact_pair(record.states[-1]).force[1]))
        if not is_upper_slave:
            scalars = record.summarise_iterations() | {
                "cone_error": record.largest_cone_violation()
            }
            scalars["balance_error"] = record.largest_force_imbalance()
            dofs = len(bodies.solution.x.array)
    scalars |= {"N": forces[0], "side_difference": abs(forces[1] / forces[0] - 1)}
    return _make_result(scalars, {}, dofs)


def fit(element: str) -> Result:
    """Widen the hole of an incompressible tube until it presses on an outer tube."""
    strips = [
        mesh_along_lines(
            MPI.COMM_SELF, _divide_interval(*radii, n), _divide_interval(0.0, 0.1, 1), "triangle"
        )
        for radii, n in zip(TUBE_RADII, (TUBE_CELLS, TUBE_CELLS - 2), strict=True)
    ]
    mesh, _ = join_meshes(*strips)
    tubes = spaces(element, mesh)
    solution, (v, q) = fem.Function(tubes.trial), ufl.TestFunctions(tubes.test)
    u, p = ufl.split(solution)
    r = ufl.SpatialCoordinate(mesh)[0]

    def axisymmetric_gradient(f: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        g = ufl.grad(f)
        rows = [[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, f[0] / r]]
        return ufl.as_matrix(rows)

    F = ufl.Identity(3) + axisymmetric_gradient(u)
    J, inverse = ufl.det(F), ufl.inv(F).T
    stress, lame = F - inverse - p * J * inverse, lame_over_shear(TUBE_POISSONS_RATIO)
    density = ufl.inner(stress, axisymmetric_gradient(v)) - q * (J - 1 + p / lame)
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": FIT_QUADRATURE_DEGREE})
    residual = density * 2 * np.pi * r * dx
    axial, hole = fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)
    (inner_radius, contact_radius), (outer_tube_radius, _) = TUBE_RADII
    supports = [
        prescribe(tubes.trial, 1, lambda x: np.full(x.shape[1], True), axial),
        prescribe(tubes.trial, 0, lambda x: np.isclose(x[0], inner_radius), hole),
    ]

    def is_at_radius(radius: float, x: Array) -> Mask:
        return np.asarray(np.isclose(x[0], radius))

    master = DeformableSurface(partial(is_at_radius, outer_tube_radius), True)
    pair = ContactPair(partial(is_at_radius, contact_radius), master)
    problem = ContactProblem.of_residual(residual, solution, supports, pair)
    state, start, record = problem.undeformed, 0.0, SlidingRecord()
    for end in np.linspace(0.0, HOLE_RADIUS - inner_radius, 7)[1:]:

        def load(load_factor: float, start: float = start, end: float = float(end)) -> None:
            hole.value = (1 - load_factor) * start + load_factor * end

        state, start = problem.step(state, load), float(end)
        record.states.append(state)
    last = _contact_pair(state)
    x = last.position + last.displacement
    radius = np.sqrt(contact_radius**2 + HOLE_RADIUS**2 - inner_radius**2)
    exact = _exact_fit_pressure(radius)
    pressure = last.force_normal.sum() / (2 * np.pi * radius * 0.1)
    imbalance = abs((last.force + last.opposite_force.sum(axis=0)) / pressure)
    scalars = {
        "pressure_error": abs(pressure / exact - 1),
        "radius_error": float(np.abs(x[:, 0] / radius - 1).max()),
        "pressure": exact,
        "interference": float(radius / outer_tube_radius - 1),
        "balance_error": float(imbalance.max()),
        "iterations_mean": float(np.mean([s.iterations for s in record.states])),
    }
    return _make_result(scalars, {}, len(solution.x.array))


def _exact_fit_pressure(radius: float) -> float:
    """Return the pressure that widens the incompressible outer tube to an inner radius."""
    inner, outer = TUBE_RADII[1]
    squared_increase = radius**2 - inner**2

    def stress_over_radius(r: float) -> float:
        stretch = r / np.sqrt(r**2 - squared_increase)
        return float((stretch**2 - stretch**-2) / r)

    deformed_outer = np.sqrt(outer**2 + squared_increase)
    return float(quad(stress_over_radius, radius, deformed_outer, epsabs=1e-13)[0])


def _make_half_ring(angles: Array, radii: Array, is_upper: bool) -> Mesh:
    """Mesh the upper half of the lower ring, or the lower half of the upper ring."""

    def bend_to_half_ring(x: Array) -> Array:
        sign = -1.0 if is_upper else 1.0
        y = sign * x[:, 1] * np.sin(x[:, 0])
        centre = 2 * RING_RADII[1] + RING_DISTANCE if is_upper else 0.0
        return np.column_stack([-sign * x[:, 1] * np.cos(x[:, 0]), centre + y, x[:, 2]])

    return _make_quadratic_mesh(angles, radii, bend_to_half_ring)


def _make_quadratic_mesh(x: Array, y: Array, map_nodes: Callable[[Array], Array]) -> Mesh:
    """Mesh a rectangle by quadratic triangles, with all nodes mapped by a function."""
    return curved_mesh(mesh_along_lines(MPI.COMM_SELF, x, y, "triangle"), map_nodes)


def _divide_interval(start: float, end: float, cells: int) -> Array:
    return np.linspace(start, end, cells + 1, dtype=np.float64)


def _rotation_matrix(degrees: float) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def _nodal_displacement(bodies: RubberBody, state: ContactState) -> Array:
    return np.asarray(state.displacement.array_r.reshape(-1, bodies.dim))


def _integrate_weight_functions(bodies: RubberBody, sides: Sequence[Indices]) -> Array:
    """Integrate the nodes' weight functions (n,) over the undeformed sides; one at other nodes."""
    make_spaces = Spaces.petrov_galerkin if bodies.element.startswith("pw") else Spaces.galerkin
    scalar_spaces = make_spaces(bodies.solution.function_space.mesh, 0)
    weight_area = np.ones(len(bodies.x))
    for side in sides:
        surface = SurfaceNodes.from_scalar_spaces(scalar_spaces, side.astype(np.int32))
        weight_area[surface.node] = surface.weight_area
    return weight_area


def _measure_evenness(
    bodies: RubberBody, states: Sequence[ContactState], weight_area: Array, suffix: str
) -> dict[str, float]:
    """Return median ratios of mid-side to corner forces per area (n,), on both sides."""
    on_slave, on_master = [], []
    for state in states:
        pair = _contact_pair(state)
        order = np.argsort(bodies.x[pair.node, 0])
        node, force = pair.node[order], pair.force_normal[order]
        inner = np.flatnonzero(force > MIN_RELATIVE_SLAVE_FORCE * force.max())[
            N_END_NODES:-N_END_NODES
        ]
        on_slave.append(_median_midside_over_corner(bodies, node, force / weight_area[node], inner))
        node, force = _master_normal_forces(bodies, state)
        force = force / weight_area[node]
        inner = np.flatnonzero(force > MIN_RELATIVE_MASTER_FORCE * force.max())
        on_master.append(_median_midside_over_corner(bodies, node, force, inner))
    return {
        f"mid_over_corner{suffix}": float(np.median(on_slave)),
        f"mid_over_corner{suffix}_master": float(np.median(on_master)),
    }


def _median_midside_over_corner(
    bodies: RubberBody, node: Indices, values: Array, inner: Indices
) -> float:
    """Return the median ratio of mid-side values to the mean of both neighbours, along a side."""
    midside = inner[~bodies.is_vertex[node[inner]]]
    return float(np.median(2 * values[midside] / (values[midside - 1] + values[midside + 1])))


def _master_normal_forces(bodies: RubberBody, state: ContactState) -> tuple[Indices, Array]:
    """Return the master's nodes along its side and their normal forces, positive in compression."""
    pair = _contact_pair(state)
    order = np.argsort(bodies.x[pair.opposite_node, 0])
    node, force = pair.opposite_node[order], pair.opposite_force[order]
    x = bodies.x[node] + _nodal_displacement(bodies, state)[node]
    chord = np.gradient(x, axis=0)
    normal = np.stack([chord[:, 1], -chord[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return node, np.sum(normal * force, axis=1)


def _tension_ratio(normal_force: Array) -> float:
    """Return the largest tensile over the largest compressive nodal force."""
    return float(max(0.0, -normal_force.min() / normal_force.max()))


def _relative_moment_defect(bodies: RubberBody, state: ContactState) -> float:
    """Return the moment of the forces on both sides over the sum of the moments' magnitudes."""
    pair = _contact_pair(state)
    nodes = np.concatenate([pair.node, pair.opposite_node])
    force = np.concatenate([pair.force_vector, pair.opposite_force])
    x = (bodies.x + _nodal_displacement(bodies, state))[nodes]
    x = x - x.mean(axis=0)
    moments = x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    return float(abs(moments.sum()) / np.abs(moments).sum())


def _make_result(scalars: dict[str, float], curves: dict[str, Array], dofs: int) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=dofs)

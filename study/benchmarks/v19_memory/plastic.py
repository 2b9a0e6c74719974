"""Rigid cylinders and spheres that indent an elastoplastic block.

The law is J2 plasticity at finite strains with linear isotropic hardening, by J. C. Simo and
T. J. R. Hughes, Computational Inelasticity, Springer 1998, box 9.1: the isochoric elastic left
Cauchy-Green tensor follows from the inverse plastic right one, which is a history variable.
"""

import logging
from collections.abc import Sequence
from functools import partial
from logging.handlers import BufferingHandler
from pathlib import Path
from tempfile import TemporaryDirectory

from mpi4py import MPI

import gmsh
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.optimize import minimize_scalar

from pw_elements import history_space, prescribe
from pw_elements._compat import interpolation_points
from pw_elements.arrays import Array, Mask
from pw_elements.contact import OPEN, ContactPair, ContactProblem, Motion, Plane, Sphere
from pw_elements.contact.model import ContactState
from pw_elements.spaces import Marker
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_families import mesh_with_gmsh
from study.model.discretisation import make_element_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.calculix.calculix import load_recorded_result_if_unchanged
from study.solutions.calculix.plastic import (
    DEPTHS,
    HARDENING,
    PLASTIC_BLOCKS,
    POISSONS_RATIO,
    YOUNGS_MODULUS,
    block_mesh_line_positions,
    refine_towards_zero,
)
from study.solutions.half_space import ElasticHalfSpace

# Lengths are relative to the radius of the indenter, stresses to the initial yield stress
SHEAR_MODULUS = YOUNGS_MODULUS / (2 * (1 + POISSONS_RATIO))
BULK_MODULUS = YOUNGS_MODULUS / (3 * (1 - 2 * POISSONS_RATIO))
HALF_SPACE = ElasticHalfSpace(YOUNGS_MODULUS, POISSONS_RATIO)
MIN_YIELD_FUNCTION = -1e-8
"""Yield function above which points flow.

Points on the yield surface at the start of an increment then have the elastoplastic tangent.
"""

# Plateau: six increments
ELEMENT_SIZE = 0.01
RELEASE_DEPTHS = (0.01195, 0.012, 0.0117, 0.0114, 0.011, 0.008)
"""Depths after the plateau: partial unloading, reloading, and unloading until contact ends."""
BLOCK_SIZES = {"cylinder": 1.0, "sphere": 2.5}
TABOR_STRAIN = 0.2
"""Representative plastic strain below a sphere, over contact radius / sphere's radius."""
INNER_PART = 0.8
"""Distance from the axis, over the contact radius, within which nodal forces are compared."""

# First yield
ELEMENTS_OVER_CONTACT_RADIUS = 8
LOADS_AROUND_YIELD = (0.92, 0.95, 0.965, 0.98, 0.995, 1.01, 1.025)
"""Peak pressures of Hertz over the one at which yielding begins in theory."""

N_SUBSTEPS = 4
"""Increments, in place of one, in which the indenter moves for the comparison with CalculiX."""

# Quarter of a roller of radius 1, crushed by a flat plate
ROLLER_ELEMENT_SIZE, ROLLER_DEPTHS = 0.15, (0.03, 0.06)

# Restart: depths on a coarse mesh, of which a new program continues after the second
RESTART_DEPTHS, RESTART_ELEMENT_SIZE = (0.002, 0.004, 0.006), 0.025


class ElastoplasticBody:
    """Elastoplastic body in plane strain or axisymmetry, in contact with a rigid surface.

    Attributes:
        solution: Displacements and, in hybrid elements, pressures.
        problem: Contact problem of the body.
        plastic_strain: Equivalent plastic strain at quadrature points.
        trial_stress: Equivalent stress over yield stress of the last increment, without plastic
            flow in this increment.
    """

    def __init__(
        self,
        element: str,
        mesh: Mesh,
        supports: Sequence[tuple[int, Marker]],
        pair: ContactPair,
        is_axisymmetric: bool = False,
    ) -> None:
        """Create the body.

        Args:
            element: Name of the element, such as "pw-T6".
            mesh: Mesh.
            supports: Axes and markers of smooth supports.
            pair: Contact nodes and rigid surface.
            is_axisymmetric: Whether the x axis is radial.
        """
        spaces = make_element_spaces(element, mesh)
        is_hybrid, self.is_axisymmetric = "hybrid" in element, is_axisymmetric
        tensors, dx = history_space(spaces, (3, 3))
        numbers, _ = history_space(spaces)
        self.solution = fem.Function(spaces.trial)
        inverse_plastic = fem.Function(tensors, name="inverse plastic right Cauchy-Green tensor")
        self.plastic_strain = fem.Function(numbers, name="equivalent plastic strain")
        self.trial_stress = fem.Function(numbers, name="trial stress over yield stress")
        inverse_plastic.x.array[:] = np.tile(np.eye(3).ravel(), len(inverse_plastic.x.array) // 9)

        test = ufl.TestFunction(spaces.test)
        u, v = (ufl.split(f)[0] if is_hybrid else f for f in (self.solution, test))
        radius = ufl.SpatialCoordinate(mesh)[0]

        def gradient(w: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
            g, hoop = ufl.grad(w), w[0] / radius if is_axisymmetric else 0
            return ufl.as_matrix([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, hoop]])

        F = ufl.Identity(3) + gradient(u)
        J = ufl.det(F)
        isochoric = J ** (-1 / 3) * F
        elastic = isochoric * inverse_plastic * isochoric.T
        trial = SHEAR_MODULUS * ufl.dev(elastic)
        trial_norm = ufl.sqrt(ufl.inner(trial, trial) + 1e-30)
        yield_stress = 1 + HARDENING * self.plastic_strain
        f = trial_norm - np.sqrt(2 / 3) * yield_stress
        mean_elastic = ufl.tr(elastic) / 3
        slope = 2 * SHEAR_MODULUS * mean_elastic + 2 * HARDENING / 3
        flow = ufl.conditional(f > MIN_YIELD_FUNCTION, f / slope, 0)
        deviator = trial - 2 * SHEAR_MODULUS * mean_elastic * flow * trial / trial_norm
        mean = -ufl.split(self.solution)[1] if is_hybrid else BULK_MODULUS * ufl.ln(J)
        self.kirchhoff_stress = mean * ufl.Identity(3) + deviator
        density = ufl.inner(self.kirchhoff_stress * ufl.inv(F).T, gradient(v))
        if is_hybrid:
            density -= ufl.split(test)[1] * (ufl.ln(J) - mean / BULK_MODULUS)
        weight = 2 * np.pi * radius if is_axisymmetric else 1
        to_reference = ufl.inv(isochoric)
        history = {
            inverse_plastic: to_reference
            * (deviator / SHEAR_MODULUS + mean_elastic * ufl.Identity(3))
            * to_reference.T,
            self.plastic_strain: self.plastic_strain + np.sqrt(2 / 3) * flow,
            self.trial_stress: np.sqrt(3 / 2) * trial_norm / yield_stress,
        }
        conditions = [prescribe(spaces.trial, *support) for support in supports]
        self.problem = ContactProblem.of_residual(
            weight * density * dx, self.solution, conditions, pair, history=history
        )

    def move_indenter_to(self, state: ContactState, depth: float) -> ContactState:
        """Return the next state, in which the indenter has moved down by a depth."""
        return self.problem.step(state, motions=Motion((0.0, -depth)))

    def load_and_contact_radius(self, state: ContactState) -> tuple[float, float]:
        """Return the load (of a cylinder: on a unit length) and the (half) width of the contact.

        The contact ends where the gap, extrapolated linearly from the first two open nodes, is zero.
        """
        pair = state.pairs[0]
        x = pair.position[:, 0] + pair.displacement[:, 0]
        load = -pair.force[1] * (1 if self.is_axisymmetric else 2)
        closed = x[pair.status != OPEN].max(initial=0.0)
        is_outside = x > closed
        (x1, x2), (gap1, gap2) = x[is_outside][:2], pair.gap[is_outside][:2]
        edge = np.clip(x1 - gap1 * (x2 - x1) / (gap2 - gap1), closed, x1)
        return float(load), float(edge)

    def mean_pressure(self, state: ContactState) -> float:
        """Return the load over the area of the contact."""
        load, a = self.load_and_contact_radius(state)
        return load / (np.pi * a**2 if self.is_axisymmetric else 2 * a)

    def mid_side_over_corner_force(self, state: ContactState) -> float:
        """Return the median ratio of mid-side forces to those of corners, interpolated there."""
        pair = state.pairs[0]
        x, force = pair.position[:, 0], pair.force_normal
        corners = np.unique(self.solution.function_space.mesh.geometry.x[:, 0])
        is_corner = np.abs(x[:, None] - corners).min(axis=1) < 1e-9
        is_inner = ~is_corner & (x < INNER_PART * x[pair.status != OPEN].max())
        corner = np.interp(x[is_inner], x[is_corner], force[is_corner])
        return float(np.median(force[is_inner] / corner))

    def quadrature_points(self) -> Array:
        """Return the undeformed positions (n, 2) of all quadrature points."""
        space = self.plastic_strain.function_space
        values = fem.Function(space)
        columns = []
        for coordinate in ufl.SpatialCoordinate(space.mesh):
            values.interpolate(fem.Expression(coordinate, interpolation_points(space)))
            columns.append(values.x.array.copy())
        return np.column_stack(columns)

    def stress_at_points(self, component: int) -> Array:
        """Return a normal component of the Kirchhoff stress at all quadrature points."""
        values = fem.Function(self.plastic_strain.function_space)
        points = interpolation_points(values.function_space)
        values.interpolate(fem.Expression(self.kirchhoff_stress[component, component], points))
        return np.asarray(values.x.array)


def _make_block(
    element: str, x_lines: Array, y_lines: Array, indenter: str, friction: float = 0.0
) -> ElastoplasticBody:
    """Return a block on a smooth base between smooth sides, which is indented at x = 0.

    Args:
        element: Name of the element.
        x_lines: Increasing coordinates of vertical mesh lines, from 0.
        y_lines: Increasing coordinates of horizontal mesh lines, up to 0.
        indenter: "cylinder" (plane strain) or "sphere" (axisymmetric).
        friction: Coefficient of friction.
    """
    right, base, zone = x_lines[-1], y_lines[0], x_lines[x_lines < x_lines[-1] / 2][-1]

    def may_touch(x: Array) -> Mask:
        return np.isclose(x[1], 0) & (x[0] < zone * (1 + 1e-9))

    return ElastoplasticBody(
        element,
        mesh_along_lines(MPI.COMM_SELF, x_lines, y_lines, "triangle"),
        [
            (0, lambda x: np.isclose(x[0], 0)),
            (0, lambda x: np.isclose(x[0], right)),
            (1, lambda x: np.isclose(x[1], base)),
        ],
        ContactPair(may_touch, Sphere((0, 1), 1), friction),
        indenter == "sphere",
    )


def _make_plateau_block(
    element: str, indenter: str, friction: float = 0.0, size: float = ELEMENT_SIZE
) -> ElastoplasticBody:
    lines = block_mesh_line_positions(size, BLOCK_SIZES[indenter])
    return _make_block(element, *lines, indenter, friction)


def _indent_to_plateau(block: ElastoplasticBody) -> list[ContactState]:
    states = [block.problem.undeformed]
    for depth in DEPTHS:
        states.append(block.move_indenter_to(states[-1], depth))
    return states[1:]


def indent(element: str, indenter: str, friction: float = 0.0) -> Result:
    """Indent a block in six increments up to the plateau of the mean pressure.

    Args:
        element: Name of the element.
        indenter: "cylinder" or "sphere".
        friction: Coefficient of friction.
    """
    block = _make_plateau_block(element, indenter, friction)
    states = _indent_to_plateau(block)
    pairs = [state.pairs[0] for state in states]
    load, a = block.load_and_contact_radius(states[-1])
    systems = np.array([state.iterations for state in states], dtype=np.float64)
    pressures = [block.mean_pressure(state) for state in states]
    largest_force = np.abs(pairs[-1].force_vector).max()
    scalars = {
        "mean_pressure_over_yield": pressures[-1],
        "mean_pressure_over_flow_stress": pressures[-1] / (1 + HARDENING * TABOR_STRAIN * a),
        "load": load,
        "contact_radius": a,
        "systems_mean": float(systems.mean()),
        "divided_increments": float(sum(len(state.substates) > 0 for state in states)),
        "mid_over_corner": block.mid_side_over_corner_force(states[-1]),
        "plastic_strain": float(block.plastic_strain.x.array.max()),
        "friction_excess": max(
            float((np.linalg.norm(p.force_tangential, axis=1) - friction * p.force_normal).max())
            for p in pairs
        )
        / largest_force,
    }
    for k, (state, pressure) in enumerate(zip(states, pressures, strict=True), start=1):
        radius = block.load_and_contact_radius(state)[1]
        scalars |= {f"strain_{k}": YOUNGS_MODULUS * radius, f"mean_pressure_{k}": pressure}
    curves: dict[str, np.ndarray] = {
        "systems": systems,
        "x": pairs[-1].position[:, 0] / a,
        "force": pairs[-1].force_normal / load,
    }
    return _make_dimensionless_result(scalars, curves, len(block.solution.x.array))


def unload(element: str, indenter: str) -> Result:
    """Indent a block up to the plateau; unload it a little, reload it, and remove the indenter.

    Args:
        element: Name of the element.
        indenter: "cylinder" or "sphere".
    """
    block = _make_plateau_block(element, indenter)
    loaded = _indent_to_plateau(block)[-1]
    plastic_strain = block.plastic_strain.x.array.copy()
    load, a = block.load_and_contact_radius(loaded)
    states = [loaded]
    for depth in RELEASE_DEPTHS:
        states.append(block.move_indenter_to(states[-1], depth))
    raised_load, reloaded_load = (block.load_and_contact_radius(state)[0] for state in states[1:3])
    slope = (load - raised_load) / (DEPTHS[-1] - RELEASE_DEPTHS[0])
    plastic_change = np.abs(block.plastic_strain.x.array - plastic_strain).max()
    stress = block.stress_at_points(0)
    scalars = {
        "slope_over_exact": slope / (2 * HALF_SPACE.plane_strain_modulus * a),
        "reload_error": abs(reloaded_load / load - 1),
        "plastic_strain_increase": float(plastic_change / plastic_strain.max()),
        "residual_tension": float(stress.max()),
        "residual_compression": float(-stress.min()),
        "force_after_release": float(np.abs(states[-1].pairs[0].force_vector).max()),
        "systems_mean": float(np.mean([state.iterations for state in states[1:]])),
    }
    return _make_dimensionless_result(scalars, {}, len(block.solution.x.array))


def _make_dimensionless_result(
    scalars: dict[str, float], curves: dict[str, np.ndarray], dofs: int
) -> Result:
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=dofs)


# First yield


def exact_peak_pressure_at_first_yield(indenter: str) -> tuple[float, float]:
    """Return Hertz' peak pressure, over the yield stress, at first yield, and the depth over a.

    Stresses on the axis are those of K. L. Johnson, Contact Mechanics, Cambridge 1985, sections
    3.4 and 4.2; von Mises' stress is largest there.

    Args:
        indenter: "cylinder" or "sphere".
    """
    nu = POISSONS_RATIO

    def equivalent_stress(depth: float) -> float:
        if indenter == "sphere":
            z, root = depth, 1 / (1 + depth**2)
            radial = -(1 + nu) * (1 - z * np.arctan2(1, z)) + root / 2
            return float(abs(radial + root))
        root = np.sqrt(1 + depth**2)
        x, y = -((1 + 2 * depth**2) / root - 2 * depth), -1 / root
        z = nu * (x + y)
        return float(np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2))

    best = minimize_scalar(lambda z: -equivalent_stress(z), bounds=(0.1, 2.0), method="bounded")
    return float(-1 / best.fun), float(best.x)


def first_yield(element: str, indenter: str) -> Result:
    """Press an indenter with increasing forces; return the peak pressure at which yielding begins.

    The peak pressure is Hertz' for the force at which the largest equivalent stress at a quadrature
    point is the yield stress, interpolated between increments.

    Args:
        element: Name of the element.
        indenter: "cylinder" or "sphere".
    """
    modulus = HALF_SPACE.plane_strain_modulus
    exact, exact_depth = exact_peak_pressure_at_first_yield(indenter)
    is_sphere = indenter == "sphere"
    a = exact * (np.pi / 2 if is_sphere else 2) / modulus
    size = a / ELEMENTS_OVER_CONTACT_RADIUS
    lines = refine_towards_zero(size, 1.5 * a, 1.0, 1.25)
    block = _make_block(element, lines, -lines[::-1], indenter)
    peaks, stresses = exact * np.array(LOADS_AROUND_YIELD), []
    # contact has to begin before forces can hold the indenter
    state = block.move_indenter_to(block.problem.undeformed, a**2 / 4)
    for peak in peaks:
        # half of the load per length, by symmetry
        force = (
            np.pi**3 * peak**3 / (6 * modulus**2) if is_sphere else np.pi * peak**2 / modulus / 2
        )
        state = block.problem.step(state, motions=Motion((0.0, None), (0.0, -force)))
        stresses.append(float(block.trial_stress.x.array.max()))
        if stresses[-1] > 1:
            break
    points = block.quadrature_points()
    depth = float(-points[np.argmax(block.trial_stress.x.array), 1] / a)
    peak = float(np.interp(1.0, stresses, peaks[: len(stresses)]))
    scalars = {
        "peak_pressure_at_yield": peak,
        "exact": exact,
        "error": abs(peak / exact - 1),
        "depth": depth,
        "exact_depth": exact_depth,
    }
    return _make_dimensionless_result(scalars, {}, len(block.solution.x.array))


def restart(element: str, indenter: str) -> Result:
    """Save a state in the middle of a plastic history; continue it in a new problem.

    Args:
        element: Name of the element.
        indenter: "cylinder" or "sphere".
    """
    blocks = [_make_plateau_block(element, indenter, size=RESTART_ELEMENT_SIZE) for _ in range(2)]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pressed.npz"
        state = blocks[0].problem.undeformed
        for depth in RESTART_DEPTHS[:-1]:
            state = blocks[0].move_indenter_to(state, depth)
        blocks[0].problem.save(state, path)
        loaded = blocks[1].problem.load(path)
    ends = [
        block.move_indenter_to(start, RESTART_DEPTHS[-1])
        for block, start in zip(blocks, (state, loaded), strict=True)
    ]
    forces = [end.pairs[0].force_vector for end in ends]
    strains = [block.plastic_strain.x.array for block in blocks]
    scalars = {
        "force_difference": float(np.abs(forces[1] - forces[0]).max() / np.abs(forces[0]).max()),
        "strain_difference": float(np.abs(strains[1] - strains[0]).max() / strains[0].max()),
        "systems": float(ends[1].iterations),
    }
    return _make_dimensionless_result(scalars, {}, len(blocks[0].solution.x.array))


def roller(element: str) -> Result:
    """Crush a roller of curved cells; count warnings of a nearly incompressible tangent.

    Args:
        element: Name of the element.
    """
    body = ElastoplasticBody(
        element,
        mesh_with_gmsh(_add_quarter_of_roller, 2, ROLLER_ELEMENT_SIZE, order=2),
        [(axis, partial(_is_zero, axis)) for axis in (0, 1)],
        ContactPair(
            lambda x: np.isclose(np.hypot(x[0], x[1]), 1) & (x[1] < -0.36), Plane((0, -1), (0, 1))
        ),
    )
    state, systems = body.problem.undeformed, []
    handler, logger = BufferingHandler(capacity=1000), logging.getLogger("pw_elements.contact")
    logger.addHandler(handler)
    try:
        for depth in ROLLER_DEPTHS:
            state = body.move_indenter_to(state, -depth)
            systems.append(state.iterations)
    finally:
        logger.removeHandler(handler)
    warnings = [record for record in handler.buffer if "bulk stiffness" in record.getMessage()]
    scalars = {
        "load": float(2 * state.pairs[0].force[1]),
        "warnings": float(len(warnings)),
        "systems_mean": float(np.mean(systems)),
    }
    return _make_dimensionless_result(scalars, {}, len(body.solution.x.array))


def _is_zero(axis: int, x: Array) -> Mask:
    return np.asarray(np.isclose(x[axis], 0))


def _add_quarter_of_roller() -> None:
    disk = gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
    square = gmsh.model.occ.addRectangle(0, -1, 0, 1, 1)
    gmsh.model.occ.intersect([(2, disk)], [(2, square)])


def against_calculix(element: str, case: str, tracked: str) -> Result:
    """Indent the block as in a stored CalculiX solution; compare the loads.

    Args:
        element: Name of the element.
        case: Name of the CalculiX input deck.
        tracked: Digest that the stored solution must have.
    """
    recorded = load_recorded_result_if_unchanged(case, tracked).numbers["N"]
    block = _make_plateau_block(element, "cylinder", size=PLASTIC_BLOCKS[case].size)
    state, previous, loads = block.problem.undeformed, 0.0, []
    for depth in DEPTHS:
        for substep_end in np.linspace(previous, depth, N_SUBSTEPS + 1)[1:]:
            state = block.move_indenter_to(state, substep_end)
        previous = depth
        loads.append(block.load_and_contact_radius(state)[0])
    largest = recorded.max()
    scalars = {
        "load_difference": float(np.abs(loads - recorded).max() / largest),
        "last_load_difference": float(abs(loads[-1] - recorded[-1]) / largest),
        "load": loads[-1],
        "load_calculix": float(recorded[-1]),
    }
    return _make_dimensionless_result(scalars, {}, len(block.solution.x.array))

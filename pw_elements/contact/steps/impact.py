"""Impact on rigid surfaces: central differences with unilateral contact and friction at nodes.

The guide's page on theory describes the scheme, its energy and its stability ("Impact"). The module
guarantees that no contact node penetrates a surface at the end of a step. It also guarantees that
the sum of kinetic and strain energy changes by the work of loads and contact, up to round-off. It
assumes a symmetric stiffness, a diagonal mass, small displacements and rigid surfaces.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import (
    Reduction,
    check_load,
    check_problem,
    critical_step,
    extract_diagonal_mass,
)
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import (
    arguments,
    call_user_function,
    check_mesh,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.contact.interface import (
    ContactInterface,
    build_interface,
    find_reduced_column_of_each_unknown,
)
from pw_elements.contact.iteration import make_pair_states
from pw_elements.contact.model import (
    ContactPair,
    ContactState,
    FrictionCone,
    Residuals,
    SmallDisplacementMeasures,
)
from pw_elements.contact.nodes import OPEN, SLIP, STICK
from pw_elements.contact.rescue import (
    SmallDisplacementAndSurfacePassingCheck,
    measure_max_strain_and_rotation,
    prepare_gradients_at_vertices,
    warn_if_no_longer_small,
)
from pw_elements.contact.steps.checks import (
    SurfacePathInTime,
    check_contact_arguments,
    check_impact_and_list_surface_paths,
)
from pw_elements.progress import report_activity
from pw_elements.solvers import is_stored_in_blocks
from pw_elements.spaces import read_record

ConstantOrTransientLoad: TypeAlias = PETSc.Vec | Callable[[float], PETSc.Vec]

# Default time step relative to the critical one
_DEFAULT_TO_CRITICAL_STEP_RATIO = 0.9
# Estimated time of one step per entry of the stiffness, in seconds
_SECONDS_PER_STEP_AND_STIFFNESS_ENTRY = 3e-9
# Relative difference between masses of one node, and between numbers of steps, that counts as
# round-off
_RELATIVE_ROUND_OFF_OF_MASS_AND_STEP_COUNT = 1e-9
# Number of bisections that determine, to round-off, the free slip of a node that also has a
# prescribed slip
_N_SLIP_BISECTIONS = 60
# Largest initial penetration, relative to the extent of the contact nodes, that counts as round-off
_MAX_INITIAL_PENETRATION_PER_EXTENT = 1e-6


@dataclass(frozen=True)
class NodalContactForcesAndSlip:
    """Contact forces and slip of the m contact nodes of this process in one time step."""

    force_normal: Array  # (m,)
    force_tangential: Array  # (m, dim)
    gap: Array  # (m,), at the end of the step
    normal: Array  # (m, dim)
    slip: Array  # (m, dim), of the step

    @property
    def force(self) -> Array:
        """Total force (m, dim) of the surface on the body at each node."""
        return self.force_normal[:, None] * self.normal + self.force_tangential


def solve_nodal_contact_of_step(
    contact_free_displacement: Array,
    gap: Array,
    normal: Array,
    surface_displacement: Array,
    is_supported: Mask,
    friction_opposes_support: Mask,
    mass: Array,
    cone: FrictionCone,
    time_step: float,
) -> NodalContactForcesAndSlip:
    """Return contact forces and slip of a step that ends without penetration.

    Friction reduces the slip to zero, or acts against the slip at the limit of the friction law.

    Args:
        contact_free_displacement: displacements (m, dim) that the nodes would have in the step
            without contact.
        gap: gaps (m,) between the nodes at the start of the step and the surfaces at its end.
        normal: unit normals (m, dim) of the surfaces.
        surface_displacement: displacements (m, dim) of the surfaces in the step.
        is_supported: mask (m, dim) of components that supports prescribe. Friction does not change
            the slip in these components.
        friction_opposes_support: mask (m, dim) of components that supports prescribe and in which
            friction opposes the prescribed slip.
        mass: masses (m,) of the nodes.
        cone: friction laws of the nodes.
        time_step: the time step.
    """
    stiffness = mass / time_step**2
    end_gap = gap + np.sum(normal * contact_free_displacement, axis=1)
    normal_force = np.where(end_gap < 0, -stiffness * end_gap, 0.0)
    slip = contact_free_displacement - surface_displacement
    slip = slip - np.sum(slip * normal, axis=1)[:, None] * normal
    prescribed_slip, slip = (
        np.where(friction_opposes_support, slip, 0.0),
        np.where(is_supported, 0.0, slip),
    )
    limit, stick_force = (
        cone.friction_limits_and_slopes(normal_force)[0],
        stiffness * np.linalg.norm(slip, axis=1),
    )
    stopped_ratio: Array = np.minimum(1.0, limit / np.where(stick_force > 0, stick_force, 1.0))
    slip_ratio = np.asarray(1 - stopped_ratio)
    is_dragged: Mask = np.any(prescribed_slip != 0, axis=1)
    if is_dragged.any():
        slip_ratio[is_dragged] = _fraction_of_slip_remaining_under_friction(
            np.linalg.norm(prescribed_slip[is_dragged], axis=1),
            np.linalg.norm(slip[is_dragged], axis=1),
            (limit / stiffness)[is_dragged],
        )
    remaining_slip = (
        np.where(slip_ratio[:, None] > 0, slip_ratio[:, None] * slip, 0.0) + prescribed_slip
    )
    slip_size = np.linalg.norm(remaining_slip, axis=1)[:, None]
    force_against_slip = -limit[:, None] * remaining_slip / np.where(slip_size > 0, slip_size, 1.0)
    force_that_stops = -(stopped_ratio * stiffness)[:, None] * slip
    force = np.where(is_dragged[:, None], force_against_slip, force_that_stops)
    return NodalContactForcesAndSlip(
        normal_force, force, np.maximum(end_gap, 0.0), normal, remaining_slip
    )


def _fraction_of_slip_remaining_under_friction(
    prescribed_slip: Array, frictionless_slip: Array, max_slip_reduction: Array
) -> Array:
    """Return the fraction (n,) of a free slip that remains under friction and a prescribed slip.

    A node has a prescribed slip f, and would have a free slip v perpendicular to it without
    friction. Friction reduces v to x in [0, v], which satisfies
    v - x = r x / |(f, x)| with the largest reduction r. The fraction is x / v.

    Args:
        prescribed_slip: magnitudes f (n,) of the prescribed slips.
        frictionless_slip: magnitudes v (n,) of the free slips without friction.
        max_slip_reduction: largest reductions r (n,) of the slips by friction.
    """
    lower, upper = np.zeros_like(frictionless_slip), frictionless_slip.copy()
    for _ in range(_N_SLIP_BISECTIONS):
        middle = (lower + upper) / 2
        is_too_large = (
            middle + max_slip_reduction * middle / np.hypot(prescribed_slip, middle)
            > frictionless_slip
        )
        lower, upper = np.where(is_too_large, lower, middle), np.where(is_too_large, middle, upper)
    return np.asarray(upper / np.where(frictionless_slip > 0, frictionless_slip, 1.0))


@dataclass(frozen=True)
class Energies:
    """Energies and work (s + 1,) at the half steps of an impact with s steps.

    The first half step is half a time step before the start. The sum of kinetic and strain energy
    changes only by the work, up to round-off.

    Args:
        kinetic: kinetic energy v' M v / 2, with the velocity v and the mass matrix M.
        strain: strain energy u0' K u1 / 2, with the stiffness K and the displacements u0 before and
            u1 after the half step; it may be slightly negative.
        load_work: work of the loads since the start.
        normal_work: work of the normal contact forces since the start, in impacts and by moving
            surfaces.
        friction_work: work of friction since the start.
    """

    kinetic: Array
    strain: Array
    load_work: Array
    normal_work: Array
    friction_work: Array

    @property
    def total(self) -> Array:
        """Sum of kinetic and strain energy at each half step."""
        return self.kinetic + self.strain

    @property
    def imbalance(self) -> float:
        """Largest error of the energy balance, relative to the largest energy or work."""
        work = self.load_work + self.normal_work + self.friction_work
        scale = max(np.abs(part).max() for part in vars(self).values())
        return float(np.abs(self.total - self.total[0] - work).max() / (scale or 1.0))


@dataclass(frozen=True)
class PairHistory:
    """Contact forces of one pair in s steps, with its m nodes sorted by position.

    Args:
        position: undeformed positions (m, dim) of the nodes.
        node: global numbers (m,) of the nodes in the space, valid for this number of processes.
        force: forces (s, m, dim) of the surface on the body at each node, at all times of
            `ImpactHistory` except the last one.
        translation: translations (s + 1, dim) of the surface from its initial position.
    """

    position: Array
    node: Indices
    force: Array
    translation: Array

    @property
    def total_force(self) -> Array:
        """Total force (s, dim) of the surface on the body, summed over all nodes."""
        return np.asarray(self.force.sum(axis=1))


@dataclass(frozen=True)
class ImpactHistory:
    """Result of `solve_impact`: motion, contact forces and energies.

    Args:
        step: the time step.
        critical_step: largest stable time step without contact.
        time: times (s + 1,), starting at 0.
        energies: energies and work, half a step before each of these times.
        pairs: one history per contact pair.
        displacement: displacement vector (n,) at the last time. For the symmetric sibling, its
            entries are coefficients rather than nodal values.
        velocity: velocity vector (n,) half a step before the last time.
        frames: `ContactState`s for `ContactFields` and `write`, with the displacements at
            `frame_times` and the contact forces of the time steps that end there. These states are
            not in equilibrium: their residuals are NaN, and no static increment can continue from
            them.
            For the symmetric sibling, the displacements are the true ones, but gaps and slips are
            computed from the coefficients.
        frame_times: times of the frames.
    """

    step: float
    critical_step: float
    time: Array
    energies: Energies
    pairs: tuple[PairHistory, ...]
    displacement: PETSc.Vec
    velocity: PETSc.Vec
    frames: tuple[ContactState, ...]
    frame_times: tuple[float, ...]


@check_same_arguments_on_all_processes
def solve_impact(
    K: PETSc.Mat,
    M: PETSc.Mat,
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    duration: float,
    velocity: PETSc.Vec,
    load: ConstantOrTransientLoad | None = None,
    paths: SurfacePathInTime | Sequence[SurfacePathInTime | None] = (),
    displacement: PETSc.Vec | None = None,
    step: float | None = None,
    frames: int = 0,
    max_steps: int = 1_000_000,
) -> ImpactHistory:
    """Compute the motion of a body that may hit rigid surfaces, by central differences.

        sibling = Sibling.from_space(U)
        K, M = sibling.matrix(K_standard), lumped_mass(sibling.matrix(M_standard), U)
        history = solve_impact(K, M, sibling.dirichlet(walls), ground, U, 9.0, thrown)
        history.time[:-1], history.pairs[0].total_force, history.energies.kinetic

    Use the symmetric sibling, or the standard element with a positive diagonal mass. Unsymmetric
    stiffnesses are rejected: the eigenvalues in their upper spectrum are complex, and undamped
    motions grow for any time step (section V9 of the validation study, study/benchmarks).

    Args:
        K: symmetric stiffness (n, n), assembled without supports.
        M: mass (n, n), diagonal, positive and equal for all components of a node, for example as
            returned by `lumped_mass`.
        reduction: supports; their values are constant in time.
        pairs: contact pairs with rigid surfaces. Their `motions` are ignored.
        space: trial space of the displacements.
        duration: positive duration; the last step ends at this time or later.
        velocity: initial velocity (n,); it counts as zero where supports prescribe displacements.
        load: load vector (n,), or a function of time that returns it.
        paths: for each pair's surface, a function of time that returns the translation (dim,) of
            the surface from its initial position, or None for a surface at rest. By default all
            surfaces are at rest. For a single pair, the list can be omitted.
        displacement: initial displacement (n,); by default it has the values of the supports, and
            is zero elsewhere.
        step: time step; by default 0.9 times the critical one.
        frames: number of `ContactState`s to keep for `write`, evenly spaced in time and including
            the last one. A warning is logged if strains or rotations are not small in one of them
            or at the end.
        max_steps: largest number of steps.

    Raises:
        TypeError, ValueError: for arguments that do not define such a problem. Examples are a
            stiffness that is not symmetric or has negative eigenvalues; a mass that is not
            diagonal, positive and isotropic; nodes inside a surface at the start; an unstable time
            step; a surface that moves farther than the size of a facet in one step; and too many
            steps.
        DegenerateMesh: for cells that are flat or inverted.
        FloatingPointError: if the motion is not finite.
    """
    contact_pairs = check_contact_arguments(K, reduction, pairs, space, 1, None)
    surface_paths = check_impact_and_list_surface_paths(paths, contact_pairs, space)
    initial_values = {"the velocity": velocity}
    if displacement is not None:
        initial_values["the displacement"] = displacement
    constant_load = {} if load is None or arguments.is_user_function(load) else {"the load": load}
    check_problem(
        {"the stiffness": K, "the mass": M}, initial_values, constant_load, (reduction,), space
    )
    comm = space.mesh.comm
    arguments.check_positive("duration", duration)
    if step is not None:
        arguments.check_positive("step", step)
    arguments.check_integer("frames", frames, 0)
    arguments.check_integer("max_steps", max_steps, 1)
    check_mesh(space.mesh)
    max_stable_step = critical_step(K, M, reduction)
    if step is None:
        step = _DEFAULT_TO_CRITICAL_STEP_RATIO * max_stable_step
    if step > max_stable_step:
        raise ValueError(
            f"step = {step:.6g}: central differences are stable up to {max_stable_step:.6g}"
        )
    n_steps = np.ceil(duration / step * (1 - _RELATIVE_ROUND_OFF_OF_MASS_AND_STEP_COUNT))
    if n_steps > max_steps:
        hours = n_steps * _SECONDS_PER_STEP_AND_STIFFNESS_ENTRY * K.getInfo()["nz_used"] / 3600
        raise ValueError(
            f"duration = {duration:.6g} takes {n_steps:.3g} steps of {step:.3g}, more than "
            f"max_steps = {max_steps}: about {hours:.2g} hours"
        )
    n_steps, sibling = int(n_steps), read_record(K).sibling
    interface = build_interface(contact_pairs, space, reduction, read_record(K))
    interface.raise_error_for_invalid_points(
        interface.shared_nodes.is_shared,
        "belong to two contact pairs, which impact does not support: leave a facet between them",
    )
    is_free = _find_free_unknowns(reduction)
    u, v = reduction.offset.copy(), velocity.copy()
    v.setArray(np.where(is_free, velocity.array_r, 0.0))
    if displacement is not None:
        u.setArray(np.where(is_free, displacement.array_r, reduction.offset.array_r))
    integration = _CentralDifferenceIntegration(
        K,
        _extract_masses_and_check_isotropy(M, space),
        is_free,
        interface,
        surface_paths,
        load,
        step,
        u,
        v,
    )
    smallness, displacement_function = SmallDisplacementMeasures(), fem.Function(space)
    evaluate_gradients = prepare_gradients_at_vertices(displacement_function)
    integration.max_surface_steps = SmallDisplacementAndSurfacePassingCheck(
        interface, space
    ).min_facet_sizes
    kept_steps = np.unique(np.linspace(0, n_steps, frames + 1).round().astype(int))[1:].tolist()
    states = []
    with report_activity(comm, f"{n_steps} time steps"):
        for n in range(1, n_steps + 1):
            contact = integration.advance_one_step()
            if n in kept_steps or n == n_steps:
                true_displacement = u.copy() if sibling is None else sibling.displacement(u)
                state = integration.make_state_of_last_step(true_displacement, contact)
                largest = measure_max_strain_and_rotation(
                    evaluate_gradients, displacement_function, true_displacement
                )
                previous, smallness = smallness, SmallDisplacementMeasures(*largest)
                warn_if_no_longer_small(smallness, previous, f"step {n}", comm)
                states += [replace(state, smallness=smallness)] * (n in kept_steps)
    forces, translations = np.array(integration.forces), np.array(integration.translations)
    return ImpactHistory(
        step=step,
        critical_step=max_stable_step,
        time=step * np.arange(n_steps + 1, dtype=np.float64),
        energies=Energies(*np.array(integration.energies).T),
        pairs=tuple(
            PairHistory(
                position=interface.gather_pair_in_position_order(k, interface.position),
                node=interface.gather_pair_in_position_order(k, interface.node),
                force=interface.gather_pair_in_position_order(k, forces.swapaxes(0, 1)).swapaxes(
                    0, 1
                ),
                translation=translations[:, k],
            )
            for k in range(len(contact_pairs))
        ),
        displacement=u,
        velocity=v,
        frames=tuple(states),
        frame_times=tuple(step * n for n in kept_steps),
    )


class _CentralDifferenceIntegration:
    """Time integration by central differences, with a record of energies, forces and translations.

    Args:
        K: stiffness (n, n).
        mass: masses (n,) of the unknowns of this process.
        is_free: mask (n,) of the unknowns of this process that no support prescribes.
        interface: the m contact nodes.
        paths: translation (dim,) of each pair's surface as a function of time; None for a surface
            at rest.
        load: load vector, or a function of time that returns it; None for no load.
        step: the time step.
        u: displacements (n,) at time zero, changed by `advance_one_step`.
        v: velocities (n,) at time zero. The vector is changed at once to the velocities half a step
            before the displacements, and then by `advance_one_step`.

    Attributes:
        energies: five numbers at each half step: kinetic energy, strain energy, and the work of
            load, normal forces and friction since the start.
        forces: contact forces (m, dim) in each step.
        translations: translations (pairs, dim) of the surfaces at each time.
        max_surface_steps: largest translation (pairs,) of each surface in one step.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        mass: Array,
        is_free: Mask,
        interface: ContactInterface,
        paths: Sequence[SurfacePathInTime | None],
        load: ConstantOrTransientLoad | None,
        step: float,
        u: PETSc.Vec,
        v: PETSc.Vec,
    ) -> None:
        # products with a matrix stored in blocks are faster than with PETSc's inodes
        has_point_blocks = K.getBlockSize() > 1 and not is_stored_in_blocks(K)
        self._K = K.convert("baij", PETSc.Mat()) if has_point_blocks else K
        self._mass, self._step, self._interface = mass, step, interface
        self._inverse_mass = np.where(is_free, 1 / mass, 0.0)
        self._paths, self._load, self._comm = paths, load, interface.comm
        dim = interface.position.shape[1]
        first_row, _ = K.getOwnershipRange()
        self._node_rows = interface.node[:, None] * dim + np.arange(dim) - first_row
        self.energies: list[Array] = []
        self.forces: list[Array] = []
        self.translations = [self._evaluate_surface_translations(0.0)]
        self._u, self._v, self._internal_force = u, v, u.duplicate()
        K.mult(u, self._internal_force)
        # start with the velocity half a step earlier, so that the first step is like all others
        v.setArray(
            v.array_r
            - step
            / 2
            * self._inverse_mass
            * (self._evaluate_load(0.0) - self._internal_force.array_r)
        )
        self._previous_u = u.array_r - step * v.array_r
        self._gap_and_normal = self._evaluate_gaps_and_normals()
        gap, normal = self._gap_and_normal
        gap = gap + np.sum(normal * u.array_r[self._node_rows], axis=1)
        depth = -interface.gather_values(gap).min()
        interface.raise_error_for_invalid_points(
            gap
            < -_MAX_INITIAL_PENETRATION_PER_EXTENT
            * np.ptp(interface.gather_values(interface.position)),
            "lie inside the rigid surface at the start, and would be shot out: let it start "
            f"{depth:.3g} farther away (the sibling's coefficients reach a curved surface a little "
            "earlier)",
        )
        self._record_energies(np.zeros(3))
        self.max_surface_steps = [np.inf] * len(paths)

    def advance_one_step(self) -> NodalContactForcesAndSlip:
        """Advance by one time step and return its contact forces."""
        interface, dt = self._interface, self._step
        time = dt * len(self.forces)
        load, old_u = self._evaluate_load(time), self._u.array_r.copy()
        velocity = self._v.array_r + dt * self._inverse_mass * (load - self._internal_force.array_r)
        self.translations.append(self._evaluate_surface_translations(time + dt))
        shift = self.translations[-1] - self.translations[-2]
        for k, distance in enumerate(np.linalg.norm(shift, axis=1)):
            if distance > self.max_surface_steps[k]:
                raise ValueError(
                    f"the surface of contact pair {k} moves by {distance:.3g} in the step from the "
                    f"time {time:.6g} on, farther than a facet reaches "
                    f"({self.max_surface_steps[k]:.3g}): it would jump into the body; use smaller "
                    "steps, or a slower surface"
                )
        if shift.any():
            self._gap_and_normal = self._evaluate_gaps_and_normals()
        gap, normal = self._gap_and_normal
        gap = gap + np.sum(normal * old_u[self._node_rows], axis=1)
        contact = solve_nodal_contact_of_step(
            dt * velocity[self._node_rows],
            gap,
            normal,
            shift[interface.pair],
            interface.equation < 0,
            interface.held_components,
            self._mass[self._node_rows[:, 0]],
            interface.cone,
            dt,
        )
        if interface.cone.has_user_law:
            interface.raise_law_errors_and_check_slopes()
        velocity[self._node_rows] += dt * self._inverse_mass[self._node_rows] * contact.force
        self._v.setArray(velocity)
        self._u.axpy(dt, self._v)
        self._K.mult(self._u, self._internal_force)

        half_motion = (self._u.array_r - self._previous_u) / 2
        forces = contact.force_normal[:, None] * normal, contact.force_tangential
        self._previous_u = old_u
        self._record_energies(
            np.array(
                [
                    load @ half_motion,
                    *(np.sum(force * half_motion[self._node_rows]) for force in forces),
                ]
            )
        )
        self.forces.append(contact.force)
        return contact

    def make_state_of_last_step(
        self, displacement: PETSc.Vec, contact: NodalContactForcesAndSlip
    ) -> ContactState:
        """Return displacements and contact forces of the last step as a `ContactState`."""
        interface, is_closed = self._interface, contact.force_normal > 0
        slip = np.where(is_closed[:, None], contact.slip, 0.0)
        status = np.where(is_closed, np.where(slip.any(axis=1), SLIP, STICK), OPEN).astype(np.int8)
        pair_values = {
            **vars(replace(contact, slip=slip)),
            "friction": interface.cone.coefficient(contact.force_normal),
            "status": status,
            "displacement": displacement.array_r[self._node_rows],
        }
        pairs = make_pair_states(
            interface, self.translations[-1], contact.force, interface.force, **pair_values
        )
        no_residuals = Residuals(*[np.nan] * 8)
        n_steps = len(self.forces)
        return ContactState(
            displacement, pairs, residuals=no_residuals, increment=n_steps, converged=False
        )

    def _record_energies(self, work_of_step: Array) -> None:
        """Record the energies after a step, and add the work (3,) of the step to the total work."""
        v = self._v.array_r
        energies = [
            self._mass * v @ v / 2,
            self._previous_u @ self._internal_force.array_r / 2,
            *work_of_step,
        ]
        totals = self._comm.allreduce(np.array(energies))
        if not np.isfinite(totals).all():
            raise FloatingPointError(
                f"the motion is not finite after {len(self.energies)} steps: check the loads"
            )
        if self.energies:
            totals[2:] += self.energies[-1][2:]
        self.energies.append(totals)

    def _evaluate_gaps_and_normals(self) -> tuple[Array, Array]:
        """Return gaps (m,) and normals (m, dim) between undeformed nodes and moved surfaces."""
        translations = self.translations[-1]
        gap, normal = self._interface.evaluate_undeformed_gaps_and_normals(translations)
        self._interface.check_gaps_normals_and_supports(gap, normal)
        return gap, normal

    def _evaluate_load(self, time: float) -> Array:
        """Return the part (n,) of the load vector at a given time that this process owns."""
        load = self._load
        if isinstance(load, PETSc.Vec):
            return np.asarray(load.array_r)
        if load is None:
            return np.zeros_like(self._mass)
        with raise_errors_on_all_processes(self._comm):
            vector = call_user_function(self._comm, "the load", load, time)
        check_load(f"the load at the time {time:.6g}", vector, self._K)
        return np.asarray(vector.array_r)

    def _evaluate_surface_translations(self, time: float) -> Array:
        """Return the translations (pairs, dim) of the surfaces at a given time."""
        comm, dim = self._comm, self._node_rows.shape[1]
        translations = np.zeros((len(self._paths), dim))
        if not any(self._paths):
            return translations
        with raise_errors_on_all_processes(comm) as same:
            for k, path in enumerate(self._paths):
                if path is not None:
                    whose = f"the path of contact pair {k}"
                    translations[k] = arguments.check_vector(
                        whose, call_user_function(comm, whose, path, time), dim
                    )
            same["the paths"] = translations
        return translations


def _extract_masses_and_check_isotropy(M: PETSc.Mat, space: fem.FunctionSpace) -> Array:
    """Return the masses (n,) of the unknowns of this process.

    Raises:
        ValueError: if the mass of a node differs between its components.
    """
    mass = extract_diagonal_mass(M).array_r.copy()
    mass_of_node = mass.reshape(-1, space.dofmap.index_map_bs)
    with raise_errors_on_all_processes(space.mesh.comm):
        if np.any(
            np.ptp(mass_of_node, axis=1)
            > _RELATIVE_ROUND_OFF_OF_MASS_AND_STEP_COUNT * mass_of_node[:, 0]
        ):
            raise ValueError(
                "the masses of a node's components differ: friction has no direction then"
            )
    return mass


def _find_free_unknowns(reduction: Reduction) -> Mask:
    """Return a mask (n,) of the unknowns of this process that no support prescribes."""
    column = find_reduced_column_of_each_unknown(reduction.right)
    with raise_errors_on_all_processes(reduction.offset.comm.tompi4py()):
        if reduction.inner_flexibility is not None or np.any(column < -1):
            raise ValueError("explicit dynamics takes Dirichlet conditions, no condensation")
    return np.asarray(column >= 0)

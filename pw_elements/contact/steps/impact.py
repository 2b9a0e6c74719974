"""Impact: central differences with nodal unilateral contact and Coulomb friction.

The guide's page on theory has the scheme, its energy and its stability ("Impact").
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
    check_same_arguments,
    collective_errors,
)
from pw_elements.contact.interface import Interface, build_interface, find_reduced_columns
from pw_elements.contact.iteration import make_pair_states
from pw_elements.contact.model import ContactPair, ContactState, FrictionCone, Residuals, Smallness
from pw_elements.contact.nodes import OPEN, SLIP, STICK
from pw_elements.contact.steps.checks import PathInTime, check_contact_arguments, list_paths
from pw_elements.contact.steps.smallness import (
    SmallnessCheck,
    gradient_at_vertices,
    log_large,
    measure_largest_gradient,
)
from pw_elements.progress import report_activity
from pw_elements.solvers import is_blocked
from pw_elements.spaces import AssemblyRecord

Load: TypeAlias = PETSc.Vec | Callable[[float], PETSc.Vec]

# Part of the critical step that is taken unless another step is given
_COURANT = 0.9
# Seconds a step for each entry of the stiffness, some
_SECONDS = 3e-9
# Of masses that are equal, and of a whole number of steps
_EQUAL = 1e-9
# Halvings by which the slip beside a support's is found to round-off
_BISECTIONS = 60
# Largest penetration at the start that passes for round-off, over the extent of the contact nodes
_ROUND_OFF_DEPTH = 1e-6


@dataclass(frozen=True)
class NodalContact:
    """Contact in one step, at the points (m) of this process."""

    force_normal: Array  # (m,)
    force_tangential: Array  # (m, dim)
    gap: Array  # (m,), at the end of the step
    normal: Array  # (m, dim)
    slip: Array  # (m, dim), of the step

    @property
    def force(self) -> Array:
        """Force (m, dim) of the surface on the body."""
        return self.force_normal[:, None] * self.normal + self.force_tangential


def nodal_contact(
    motion: Array,
    gap: Array,
    normal: Array,
    shift: Array,
    held: Mask,
    acts: Mask,
    mass: Array,
    cone: FrictionCone,
    step: float,
) -> NodalContact:
    """The law at points (m): forces by which a step ends with no penetration, and Coulomb's slip.

    `motion` (m, dim) is how the points would move in the step without contact, `shift` (m, dim) how
    their surfaces do; `gap` (m,) is that at its start, to the surfaces as they are at its end.
    Supports keep components that are `held` (m, dim): friction takes none of their slip back, but
    opposes it where it `acts` (m, dim) on them.
    """
    stiffness = mass / step**2
    reached = gap + np.sum(normal * motion, axis=1)
    pressed = np.where(reached < 0, -stiffness * reached, 0.0)
    slip = motion - shift
    slip = slip - np.sum(slip * normal, axis=1)[:, None] * normal
    fixed, slip = np.where(acts, slip, 0.0), np.where(held, 0.0, slip)
    limit, sticking = cone.limit(pressed)[0], stiffness * np.linalg.norm(slip, axis=1)
    share: Array = np.minimum(1.0, limit / np.where(sticking > 0, sticking, 1.0))
    rest = np.asarray(1 - share)
    dragged: Mask = np.any(fixed != 0, axis=1)
    if dragged.any():
        rest[dragged] = _slip_left(
            np.linalg.norm(fixed[dragged], axis=1),
            np.linalg.norm(slip[dragged], axis=1),
            (limit / stiffness)[dragged],
        )
    left = np.where(rest[:, None] > 0, rest[:, None] * slip, 0.0) + fixed
    size = np.linalg.norm(left, axis=1)[:, None]
    against = -limit[:, None] * left / np.where(size > 0, size, 1.0)
    taken = -(share * stiffness)[:, None] * slip
    force = np.where(dragged[:, None], against, taken)
    return NodalContact(pressed, force, np.maximum(reached, 0.0), normal, left)


def _slip_left(fixed: Array, slip: Array, most: Array) -> Array:
    """Return the share (n,) of slips (n,) that friction leaves beside slips that supports fix (n,).

    Of a slip v beside a fixed one f it leaves x in [0, v] with v - x = most x / |(f, x)|, `most`
    (n,) being the way on which friction of its largest size moves a node.
    """
    low, high = np.zeros_like(slip), slip.copy()
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        beyond = middle + most * middle / np.hypot(fixed, middle) > slip
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return np.asarray(high / np.where(slip > 0, slip, 1.0))


@dataclass(frozen=True)
class Energies:
    """Energies and work (s + 1,) at half steps, the first one half a step before the start.

    kinetic + strain changes by the work alone, to round-off.

    Args:
        kinetic: v' M v / 2.
        strain: u' K u / 2, one u being the displacement before, the other the one after the half
            step: it may be slightly negative.
        load_work: of the loads, since the start.
        normal_work: of normal contact forces, since the start: what impacts take, and what moving
            surfaces do.
        friction_work: of friction, since the start.
    """

    kinetic: Array
    strain: Array
    load_work: Array
    normal_work: Array
    friction_work: Array

    @property
    def total(self) -> Array:
        """Kinetic and strain energy together."""
        return self.kinetic + self.strain

    @property
    def imbalance(self) -> float:
        """Largest difference of the change of energy and the work, over the largest of them."""
        work = self.load_work + self.normal_work + self.friction_work
        scale = max(np.abs(part).max() for part in vars(self).values())
        return float(np.abs(self.total - self.total[0] - work).max() / (scale or 1.0))


@dataclass(frozen=True)
class PairHistory:
    """Contact of one pair over s steps; its m nodes in the order of their positions.

    Args:
        position: (m, dim), undeformed.
        node: (m,), global numbers in the space, valid for this number of processes.
        force: (s, m, dim), of the surface on the body at each node, at the times of
            `ImpactHistory` but the last.
        translation: (s + 1, dim), of the surface from its initial place.
    """

    position: Array
    node: Indices
    force: Array
    translation: Array

    @property
    def total(self) -> Array:
        """Force (s, dim) of the surface on the body."""
        return np.asarray(self.force.sum(axis=1))


@dataclass(frozen=True)
class ImpactHistory:
    """Motion, contact forces and energies that `solve_impact` found.

    Args:
        step: the time step.
        critical_step: the largest stable time step, without contact.
        time: (s + 1,), from 0 on.
        energies: at the half steps before these times.
        pairs: one per contact pair.
        displacement: (n,), at the last time; coefficients with the symmetric sibling.
        velocity: (n,), half a step before the last time.
        frames: `ContactState`s with the displacements at `frame_times` and the contact forces
            that led there, for `ContactFields` and `write`. They are not states of equilibrium:
            residuals are NaN, and no static increment can continue from them. With the sibling
            displacements are true ones, gaps and slips those of the coefficients.
        frame_times: of the frames.
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


@check_same_arguments
def solve_impact(
    K: PETSc.Mat,
    M: PETSc.Mat,
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    duration: float,
    velocity: PETSc.Vec,
    load: Load | None = None,
    paths: PathInTime | Sequence[PathInTime | None] = (),
    displacement: PETSc.Vec | None = None,
    step: float | None = None,
    frames: int = 0,
    max_steps: int = 1_000_000,
) -> ImpactHistory:
    """Motion of a body that may hit rigid surfaces, by central differences.

        sibling = Sibling.from_space(U)
        K, M = sibling.matrix(K_standard), lumped_mass(sibling.matrix(M_standard), U)
        history = solve_impact(K, M, sibling.dirichlet(walls), ground, U, 9.0, thrown)
        history.time[:-1], history.pairs[0].total, history.energies.kinetic

    Use the symmetric sibling, or the standard element with a positive diagonal mass. Unsymmetric
    stiffnesses are rejected: eigenvalues in their upper spectrum are complex, and undamped motions
    grow whatever the step (section V9 of the study).

    Args:
        K: stiffness (n, n), symmetric, all rows and columns free.
        M: mass (n, n), diagonal and positive, the same for all components of a node, such as
            `lumped_mass` makes.
        reduction: supports; they keep their values.
        pairs: contact pairs, against rigid surfaces. Their `motions` do not count here.
        space: trial space of the displacements.
        duration: positive; the last step ends at this time or later.
        velocity: (n,), at the start; zero where supports prescribe displacements.
        load: load vector (n,), or a function of time that gives it.
        paths: of each pair's surface, the translation (dim,) from its initial place as a function
            of time; None for one that rests there; by default all rest. A single one need not be
            in a list.
        displacement: (n,), at the start; by default what supports prescribe, zero elsewhere.
        step: time step; by default 0.9 of the critical one.
        frames: how many `ContactState`s to keep, evenly spaced up to the last, for `write`. Where
            strains or rotations of one, or of the last state, are not small, that is logged.
        max_steps: the most that may be made.

    Raises:
        TypeError, ValueError: for arguments that do not make such a problem; an unsymmetric
            stiffness or one with negative eigenvalues, a mass that is not diagonal, positive and
            isotropic, nodes inside a surface at the start, a step that is not stable or in which a
            surface moves farther than a facet reaches, or too many steps.
        DegenerateMesh: for cells that are flat or inverted.
        FloatingPointError: if the motion is not finite.
    """
    stated = check_contact_arguments(K, reduction, pairs, space, 1, None)
    moves = list_paths(paths, stated, space)
    start = {"the velocity": velocity}
    if displacement is not None:
        start["the displacement"] = displacement
    constant = {} if load is None or arguments.is_user_function(load) else {"the load": load}
    check_problem({"the stiffness": K, "the mass": M}, start, constant, (reduction,), space)
    comm = space.mesh.comm
    arguments.check_positive("duration", duration)
    if step is not None:
        arguments.check_positive("step", step)
    arguments.check_integer("frames", frames, 0)
    arguments.check_integer("max_steps", max_steps, 1)
    check_mesh(space.mesh)
    critical = critical_step(K, M, reduction)
    if step is None:
        step = _COURANT * critical
    if step > critical:
        raise ValueError(f"step = {step:.6g}: central differences are stable up to {critical:.6g}")
    steps = np.ceil(duration / step * (1 - _EQUAL))
    if steps > max_steps:
        raise ValueError(
            f"duration = {duration:.6g} takes {steps:.3g} steps of {step:.3g}, more than max_steps "
            f"= {max_steps}: some {steps * _SECONDS * K.getInfo()['nz_used'] / 3600:.2g} hours"
        )
    steps, sibling = int(steps), AssemblyRecord.read(K).sibling
    interface = build_interface(stated, space, reduction, AssemblyRecord.read(K))
    free = _free(reduction)
    u, v = reduction.offset.copy(), velocity.copy()
    v.setArray(np.where(free, velocity.array_r, 0.0))
    if displacement is not None:
        u.setArray(np.where(free, displacement.array_r, reduction.offset.array_r))
    march = _March(K, _masses(M, space), free, interface, moves, load, step, u, v)
    u, smallness = fem.Function(space), Smallness()
    gradient = gradient_at_vertices(u)
    march.reach = SmallnessCheck(interface, space).finest
    kept = np.unique(np.linspace(0, steps, frames + 1).round().astype(int))[1:].tolist()
    states = []
    with report_activity(comm, f"{steps} steps of time"):
        for n in range(1, steps + 1):
            contact = march.advance()
            if n in kept or n == steps:
                moved = u.copy() if sibling is None else sibling.displacement(u)
                state = march.frame(moved, contact)
                before, smallness = (
                    smallness,
                    Smallness(*measure_largest_gradient(gradient, u, moved)),
                )
                log_large(smallness, before, f"step {n}", comm)
                states += [replace(state, smallness=smallness)] * (n in kept)
    forces, places = np.array(march.forces), np.array(march.places)
    return ImpactHistory(
        step=step,
        critical_step=critical,
        time=step * np.arange(steps + 1, dtype=np.float64),
        energies=Energies(*np.array(march.energies).T),
        pairs=tuple(
            PairHistory(
                position=interface.in_order(k, interface.position),
                node=interface.in_order(k, interface.node),
                force=interface.in_order(k, forces.swapaxes(0, 1)).swapaxes(0, 1),
                translation=places[:, k],
            )
            for k in range(len(stated))
        ),
        displacement=u,
        velocity=v,
        frames=tuple(states),
        frame_times=tuple(step * n for n in kept),
    )


class _March:
    """Displacements and velocities as they go on, and what is kept of each step."""

    def __init__(
        self,
        K: PETSc.Mat,
        mass: Array,
        free: Mask,
        interface: Interface,
        paths: Sequence[PathInTime | None],
        load: Load | None,
        step: float,
        u: PETSc.Vec,
        v: PETSc.Vec,
    ) -> None:
        """Starts from displacements and velocities at the time 0, which `advance` will change."""
        # products by nodes are faster than PETSc's by inodes
        blocked = K.getBlockSize() > 1 and not is_blocked(K)
        self._K = K.convert("baij", PETSc.Mat()) if blocked else K
        self._mass, self._step, self._interface = mass, step, interface
        self._inverse = np.where(free, 1 / mass, 0.0)
        self._paths, self._load, self._comm = paths, load, interface.comm
        dim = interface.position.shape[1]
        first, _ = K.getOwnershipRange()
        self._rows = interface.node[:, None] * dim + np.arange(dim) - first
        self.energies: list[Array] = []
        self.forces: list[Array] = []
        self.places = [self._translations(0.0)]
        self._u, self._v, self._inner = u, v, u.duplicate()
        K.mult(u, self._inner)
        # velocities half a step before the start make the first step like all others
        v.setArray(v.array_r - step / 2 * self._inverse * (self._loads(0.0) - self._inner.array_r))
        self._before = u.array_r - step * v.array_r
        self._surfaces = self._seen()
        gap, normal = self._surfaces
        gap = gap + np.sum(normal * u.array_r[self._rows], axis=1)
        depth = -interface.gathered(gap).min()
        interface.refuse(
            gap < -_ROUND_OFF_DEPTH * np.ptp(interface.gathered(interface.position)),
            "lie inside the rigid surface at the start, and would be shot out: let it come from "
            f"{depth:.3g} farther away (the sibling's coefficients reach a curved surface a little "
            "earlier)",
        )
        self._keep(np.zeros(3))
        self.reach = [np.inf] * len(paths)  # farthest that each surface may move in a step

    def advance(self) -> NodalContact:
        interface, dt = self._interface, self._step
        time = dt * len(self.forces)
        load, now = self._loads(time), self._u.array_r.copy()
        velocity = self._v.array_r + dt * self._inverse * (load - self._inner.array_r)
        self.places.append(self._translations(time + dt))
        shift = self.places[-1] - self.places[-2]
        for k, way in enumerate(np.linalg.norm(shift, axis=1)):
            if way > self.reach[k]:
                raise ValueError(
                    f"the surface of contact pair {k} moves by {way:.3g} in the step from the time "
                    f"{time:.6g} on, farther than a facet reaches ({self.reach[k]:.3g}): it would "
                    "jump into the body; take smaller steps, or a slower surface"
                )
        if shift.any():
            self._surfaces = self._seen()
        gap, normal = self._surfaces
        gap = gap + np.sum(normal * now[self._rows], axis=1)
        contact = nodal_contact(
            dt * velocity[self._rows],
            gap,
            normal,
            shift[interface.pair],
            interface.equation < 0,
            interface.held_components,
            self._mass[self._rows[:, 0]],
            interface.cone,
            dt,
        )
        if interface.cone.has_user_law:
            interface.check_laws()
        velocity[self._rows] += dt * self._inverse[self._rows] * contact.force
        self._v.setArray(velocity)
        self._u.axpy(dt, self._v)
        self._K.mult(self._u, self._inner)

        half = (self._u.array_r - self._before) / 2
        pushes = contact.force_normal[:, None] * normal, contact.force_tangential
        self._before = now
        self._keep(np.array([load @ half, *(np.sum(push * half[self._rows]) for push in pushes)]))
        self.forces.append(contact.force)
        return contact

    def frame(self, displacement: PETSc.Vec, contact: NodalContact) -> ContactState:
        interface, closed = self._interface, contact.force_normal > 0
        slip = np.where(closed[:, None], contact.slip, 0.0)
        status = np.where(closed, np.where(slip.any(axis=1), SLIP, STICK), OPEN).astype(np.int8)
        known = {
            **vars(replace(contact, slip=slip)),
            "friction": interface.cone.coefficient(contact.force_normal),
            "status": status,
            "displacement": displacement.array_r[self._rows],
        }
        pairs = make_pair_states(
            interface, self.places[-1], contact.force, interface.force, **known
        )
        none = Residuals(*[np.nan] * 8)
        steps = len(self.forces)
        return ContactState(displacement, pairs, residuals=none, increment=steps, converged=False)

    def _keep(self, work: Array) -> None:
        """Energies after a step, and the work done in it."""
        v = self._v.array_r
        energies = [self._mass * v @ v / 2, self._before @ self._inner.array_r / 2, *work]
        found = self._comm.allreduce(np.array(energies))
        if not np.isfinite(found).all():
            raise FloatingPointError(
                f"the motion is not finite after {len(self.energies)} steps: look at the loads"
            )
        if self.energies:
            found[2:] += self.energies[-1][2:]
        self.energies.append(found)

    def _seen(self) -> tuple[Array, Array]:
        """Gaps and normals of the undeformed body's points to the surfaces as they are now."""
        place = self.places[-1]
        normal, gap = self._interface.normals(place), self._interface.gaps(place)
        self._interface.check_supports(normal, gap)
        return gap, normal

    def _loads(self, time: float) -> Array:
        """Load (n,) on this process."""
        given = self._load
        if isinstance(given, PETSc.Vec):
            return np.asarray(given.array_r)
        if given is None:
            return np.zeros_like(self._mass)
        with collective_errors(self._comm):
            load = call_user_function(self._comm, "the load", given, time)
        check_load(f"the load at the time {time:.6g}", load, self._K)
        return np.asarray(load.array_r)

    def _translations(self, time: float) -> Array:
        """Translations (pairs, dim) of the surfaces at a time."""
        comm, dim = self._comm, self._rows.shape[1]
        each = np.zeros((len(self._paths), dim))
        if not any(self._paths):
            return each
        with collective_errors(comm) as same:
            for k, path in enumerate(self._paths):
                if path is not None:
                    whose = f"the path of contact pair {k}"
                    each[k] = arguments.check_vector(
                        whose, call_user_function(comm, whose, path, time), dim
                    )
            same["the paths"] = each
        return each


def _masses(M: PETSc.Mat, space: fem.FunctionSpace) -> Array:
    """Masses (n,) on this process, the same for all components of a node."""
    mass = extract_diagonal_mass(M).array_r.copy()
    of_node = mass.reshape(-1, space.dofmap.index_map_bs)
    with collective_errors(space.mesh.comm):
        if np.any(np.ptp(of_node, axis=1) > _EQUAL * of_node[:, 0]):
            raise ValueError(
                "the masses of a node's components differ: friction has no direction then"
            )
    return mass


def _free(reduction: Reduction) -> Mask:
    """Which unknowns (n,) of this process no support holds."""
    column = find_reduced_columns(reduction.right)
    with collective_errors(reduction.offset.comm.tompi4py()):
        if reduction.inner_flexibility is not None or np.any(column < -1):
            raise ValueError("explicit dynamics takes Dirichlet conditions, no condensation")
    return np.asarray(column >= 0)

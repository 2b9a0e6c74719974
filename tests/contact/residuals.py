"""Residuals of contact states, recomputed from the problem's data alone.

The data are the stiffness matrix K, the displacements a, the loads f and the surfaces. The contact
law for small displacements is checked. If r = K a - f are the nodal forces, U is the translation of
a surface, x are the undeformed positions and n is the surface's normal at x - U, then

    gap = gap(x - U) + n·a,    slip = tangential part of the change of (a - U) in the increment.

Only displacements and translations are taken from the library's contact states. The statuses of
nodes are not used: for example, the condition "stick" requires that the slip is zero or the
friction is at its limit. Where a support holds a node along the surface, K a - f does not contain
the friction. This friction follows from the slip; if the slip is zero, it may have any value within
its limit.

Forces are divided by the largest nodal force of the history so far, including the reactions of
supports. Lengths are divided by the largest displacement of a node or surface. Before that, the
round-off is subtracted: 50 eps (|K| max|a| + |f|) from forces, which is the error of a direct
solver, and 64 eps times the sum of the largest coordinate and the largest displacement from
lengths. Errors of tangential forces are also divided by max(1, mu), where mu is the friction
coefficient, so that they count as much as the errors of normal forces that cause them. Lengths are
not checked if all displacements of the history are below their round-off. Forces are not checked if
all of them are below ten times the round-off of lengths times the largest entry of K.

In axisymmetry, all forces are those of the whole circumference, as in K. The functions run in
serial.
"""

from collections.abc import Sequence
from dataclasses import dataclass, make_dataclass, replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.contact import ContactPair, Motion
from pw_elements.contact.model import ContactState
from pw_elements.spaces import read_record

Array = npt.NDArray[np.float64]

_MACHINE_EPSILON = float(np.finfo(float).eps)
# Slips below this share of the largest length count as zero; friction may then have any direction
_ZERO_SLIP_OVER_LARGEST_LENGTH = 1e-8


# The data of a linear contact problem
LinearContactProblemData = make_dataclass(
    "LinearContactProblemData", ("K", "space", "loads", "conditions", "pairs")
)


@dataclass(frozen=True)
class DisplacementAndTranslations:
    """Displacements (nodes, dim) and translations of surfaces (pairs, dim) in one state."""

    displacement: Array
    translations: Array

    @classmethod
    def from_state(cls, state: ContactState) -> "DisplacementAndTranslations":
        translations = np.array([pair.translation for pair in state.pairs])
        return cls(
            state.displacement.array_r.reshape(-1, translations.shape[1]).copy(), translations
        )


def split_increments_at_substeps(problem, states: Sequence[ContactState]):
    """Return the problem with one increment per substep, its solutions and its load factors.

    The solutions are the displacements and translations at the ends of the substeps. Loads and
    motions vary linearly within the original increments. The load factors scale prescribed
    displacements and interference, which act in full from the end of the first increment on.
    """
    loads, steps, load_factors = [], [], []
    motions: list[list[Motion]] = [[] for _ in problem.pairs]
    load = problem.K.createVecLeft()
    start_motions = [(np.zeros(problem.space.mesh.geometry.dim),) * 2 for _ in problem.pairs]
    for k, state in enumerate(states):
        for fraction, substate in [*state.substates, (1.0, state)]:
            f = load.copy()
            f.scale(1 - fraction)
            f.axpy(fraction, problem.loads[k])
            loads.append(f)
            steps.append(DisplacementAndTranslations.from_state(substate))
            load_factors.append(fraction if k == 0 else 1.0)
            for i_pair, pair in enumerate(problem.pairs):
                end = (
                    pair.motions[k]
                    if pair.motions
                    else Motion([0.0] * len(start_motions[i_pair][0]))
                )
                motions[i_pair].append(_interpolate_motion(end, *start_motions[i_pair], fraction))
        load = problem.loads[k]
        start_motions = [(pair.translation, pair.force) for pair in state.pairs]
    pairs = [replace(p, motions=m) for p, m in zip(problem.pairs, motions, strict=True)]
    return replace(problem, loads=loads, pairs=pairs), steps, load_factors


def _interpolate_motion(
    end_motion: Motion, start_translation: Array, start_force: Array, fraction: float
) -> Motion:
    translation = [
        None if prescribed is None else (1 - fraction) * start + fraction * prescribed
        for prescribed, start in zip(end_motion.translation, start_translation, strict=True)
    ]
    force = (1 - fraction) * start_force + fraction * end_motion.force_and_torque()[:-1]
    return Motion(
        translation,
        np.where(np.isnan(end_motion.translation_and_rotation()[:-1]), force, 0.0).tolist(),
    )


def recompute_residuals_per_step(
    problem,
    steps: Sequence[DisplacementAndTranslations],
    load_factors: Sequence[float] | None = None,
) -> list[dict[str, float]]:
    """Return the largest violation of each condition, by name, for every step of a history.

    The history has to begin with the undeformed body. `load_factors` (steps,) scale prescribed
    displacements and interference; they are 1 by default.
    """
    space, dim = problem.space, problem.space.mesh.geometry.dim
    x = space.tabulate_dof_coordinates()[:, :dim]
    prescribed_mask, prescribed = prescribed_mask_and_displacements(problem.conditions, *x.shape)
    contacts = [contact_nodes_and_friction(pair, space) for pair in problem.pairs]
    # friction has no radial component on an axis of revolution
    on_axis_component = np.array(
        ["axisymmetric" in read_record(problem.K).stress_states, *[False] * (dim - 1)]
    )
    force, length = 0.0, 0.0
    previous = DisplacementAndTranslations(np.zeros_like(x), np.zeros((len(contacts), dim)))
    results = []
    for k, step in enumerate(steps):
        a = step.displacement
        r, force_round_off, stiffness = _nodal_forces_round_off_and_max_stiffness(
            problem.K, a, problem.loads[k]
        )
        force = max(force, np.linalg.norm(r, axis=1).max())
        length = max(length, *(np.linalg.norm(u, axis=1).max() for u in (a, step.translations)))
        length_round_off = 64 * _MACHINE_EPSILON * (np.abs(x).max() + length)
        zero_force = 10 * stiffness * length_round_off
        scale = _ReferenceForceAndLength(
            force if force > zero_force else np.inf,
            length if length > length_round_off else np.inf,
            force_round_off,
            length_round_off,
        )
        load_factor = 1.0 if load_factors is None else load_factors[k]
        violations = {
            "supports": scale.largest_relative_length(
                np.where(prescribed_mask, np.abs(a - load_factor * prescribed), 0.0)
            )
        }
        balanced = np.ones(len(x), dtype=bool)
        for i_pair, (pair, (nodes, mu)) in enumerate(zip(problem.pairs, contacts, strict=True)):
            translation, previous_translation = (
                step.translations[i_pair],
                previous.translations[i_pair],
            )
            relative_motion = (a[nodes] - translation) - (
                previous.displacement[nodes] - previous_translation
            )
            shifted_x, still_inside = x[nodes] - translation, np.zeros(len(nodes))
            if pair.interference:
                still_inside = (1 - load_factor) * np.maximum(0.0, -pair.surface.gap(x[nodes]))
            acts = prescribed_mask[nodes] & ~(
                on_axis_component & (np.abs(x[nodes]) < 1e-9 * np.abs(x).max())
            )
            free = ~prescribed_mask[nodes]
            node_data = (
                shifted_x,
                a[nodes],
                relative_motion,
                r[nodes],
                free,
                acts,
                mu,
                nodes,
                still_inside,
            )
            faced, values, on_supports, slack = _contact_law_residuals_and_support_friction(
                pair.surface, scale, *node_data
            )
            balanced[nodes[faced]] = False
            motion = pair.motions[k] if pair.motions else None
            # other components of the force at supports are reactions
            total = np.where(prescribed_mask[nodes], 0.0, r[nodes]).sum(axis=0) + on_supports
            values |= _surface_motion_and_balance_residuals(
                motion, translation, total, slack, scale
            )
            for name, value in values.items():
                violations[name] = max(violations.get(name, 0.0), value)
        unbalanced = np.where(~prescribed_mask & balanced[:, None], np.abs(r), 0.0)
        violations["equilibrium"] = scale.largest_relative_force(unbalanced, np.arange(len(x)))
        results.append(violations)
        previous = step
    return results


def largest_residual(results: Sequence[dict[str, float]]) -> float:
    """Return the largest violation of any condition in any step, or infinity if one is NaN."""
    values = np.array([list(violations.values()) for violations in results])
    return float(np.nan_to_num(values, nan=np.inf).max(initial=0.0))


@dataclass(frozen=True)
class _ReferenceForceAndLength:
    """Reference force and reference length, and the round-off of forces and of lengths."""

    force: float
    length: float
    force_round_off: Array  # (nodes,)
    length_round_off: float

    def largest_relative_force(
        self, forces: Array, nodes: npt.NDArray, mu: Array | float = 0.0
    ) -> float:
        """Return the largest nodal force minus its round-off, relative to the reference force.

        The result is divided by max(1, mu).
        """
        friction_factor = np.maximum(1.0, mu)
        round_off = self.force_round_off[nodes].reshape((-1,) + (1,) * (forces.ndim - 1))
        return float(((forces - round_off) / friction_factor / self.force).max(initial=0.0))

    def largest_relative_length(self, lengths: Array) -> float:
        """Return the largest length minus the round-off, relative to the reference length."""
        return float(((lengths - self.length_round_off) / self.length).max(initial=0.0))


def _contact_law_residuals_and_support_friction(
    surface,
    scale: _ReferenceForceAndLength,
    positions_in_surface_frame,
    a,
    relative_motion,
    r,
    is_free,
    has_support_friction,
    mu,
    nodes,
    allowed_penetration,
):
    """Return the mask of nodes that face the surface, violations there, and friction on supports.

    Friction on supports acts in the components (n, dim) marked by `has_support_friction`. It is
    returned as two vectors (dim,): its sum, and the amount by which this sum may differ because the
    friction at nodes without slip is undetermined. `allowed_penetration` (n,) is the depth by which
    nodes may be inside the surface while interference is applied in substeps.
    """
    gap, normal = (
        surface.gap(positions_in_surface_frame) + allowed_penetration,
        surface.normal(positions_in_surface_frame),
    )
    faced = np.isfinite(gap)
    gap, normal, a, relative_motion, r, is_free, has_support_friction, mu, nodes = (
        values[faced]
        for values in (gap, normal, a, relative_motion, r, is_free, has_support_friction, mu, nodes)
    )
    gap = gap + np.sum(normal * a, axis=1)
    r_n, r_t = _split_into_normal_and_tangential(np.where(is_free, r, 0.0), normal)
    _, slip = _split_into_normal_and_tangential(
        np.where(is_free | has_support_friction, relative_motion, 0.0), normal
    )
    slip = np.where(is_free | has_support_friction, slip, 0.0)
    slip_length, limit = np.linalg.norm(slip, axis=1), mu * np.maximum(0.0, r_n)
    has_no_slip = (
        slip_length <= _ZERO_SLIP_OVER_LARGEST_LENGTH * scale.length + scale.length_round_off
    )
    opposing_friction = -(limit / np.where(has_no_slip, 1.0, slip_length))[:, None] * slip
    on_supports = np.where(has_support_friction & ~has_no_slip[:, None], opposing_friction, 0.0)
    available_friction = np.sqrt(np.maximum(0.0, limit**2 - np.sum(r_t**2, axis=1)))
    slack = np.where(has_support_friction & has_no_slip[:, None], available_friction[:, None], 0.0)
    r_t = r_t + on_supports
    friction, slip_length = np.linalg.norm(r_t, axis=1), np.linalg.norm(slip, axis=1)

    def largest_complementarity_error(
        force: Array, length: Array, friction_coefficient: Array | float = 0.0
    ) -> float:
        """Return the largest relative min(force, length); one of the two has to be zero."""
        force = np.maximum(
            0.0, force - scale.force_round_off[nodes] * np.maximum(1.0, friction_coefficient)
        )
        length = np.maximum(0.0, length - scale.length_round_off)
        relative = force / np.maximum(1.0, friction_coefficient) / scale.force
        return float(np.minimum(relative, length / scale.length).max(initial=0.0))

    # force times slip; it is divided below by the reference length and the reference force
    direction_error = np.linalg.norm(
        slip_length[:, None] * r_t + (mu * r_n)[:, None] * slip, axis=1
    )
    values = {
        "penetration": scale.largest_relative_length(-gap),
        "tension": scale.largest_relative_force(-r_n, nodes),
        "complementarity": largest_complementarity_error(r_n, gap),
        "cone": scale.largest_relative_force(friction - mu * r_n, nodes, mu),
        "stick": largest_complementarity_error(mu * r_n - friction, slip_length, mu),
        "direction": scale.largest_relative_force(direction_error / scale.length, nodes, mu),
    }
    return faced, values, on_supports.sum(axis=0), slack.sum(axis=0)


def _split_into_normal_and_tangential(vectors: Array, normal: Array) -> tuple[Array, Array]:
    normal_component = np.sum(vectors * normal, axis=1)
    return normal_component, vectors - normal_component[:, None] * normal


def _surface_motion_and_balance_residuals(
    motion,
    translation: Array,
    total_force: Array,
    undetermined_friction: Array,
    scale: _ReferenceForceAndLength,
) -> dict[str, float]:
    """Return the errors of prescribed translations and of the force balance in free directions."""
    if motion is None:
        return {"motion": scale.largest_relative_length(np.abs(translation)), "balance": 0.0}
    free = np.array([u is None for u in motion.translation])
    prescribed = np.array([0.0 if u is None else u for u in motion.translation])
    prescribed_force = (
        np.zeros(len(translation)) if motion.force is None else np.asarray(motion.force)
    )
    balance = np.where(
        free,
        np.abs(total_force - prescribed_force)
        - undetermined_friction
        - scale.force_round_off.max(),
        0.0,
    )
    return {
        "motion": scale.largest_relative_length(
            np.where(free, 0.0, np.abs(translation - prescribed))
        ),
        "balance": max(0.0, float(balance.max()))
        / max(scale.force, np.linalg.norm(prescribed_force)),
    }


def _nodal_forces_round_off_and_max_stiffness(
    K: PETSc.Mat, a: Array, load: PETSc.Vec
) -> tuple[Array, Array, float]:
    """Return nodal forces K a - load (nodes, dim), their round-off (nodes,), and max|K|."""
    u, image = K.createVecRight(), K.createVecLeft()
    u.setArray(a.ravel())
    K.mult(u, image)
    f = load.array_r.reshape(a.shape)
    indptr, _, data = K.getValuesCSR()
    size = np.add.reduceat(np.abs(data), indptr[:-1]).reshape(a.shape) * np.abs(a).max() + np.abs(f)
    return (
        image.array_r.reshape(a.shape) - f,
        50 * _MACHINE_EPSILON * size.max(axis=1),
        np.abs(data).max(),
    )


def prescribed_mask_and_displacements(
    conditions: Sequence[fem.DirichletBC], n_nodes: int, dim: int
) -> tuple[npt.NDArray[np.bool_], Array]:
    """Return the mask of prescribed displacements (nodes, dim) and their values (nodes, dim)."""
    mask, values = np.zeros(n_nodes * dim, dtype=bool), np.zeros(n_nodes * dim)
    for condition in conditions:
        dofs = condition.dof_indices()[0]
        mask[dofs], values[dofs] = True, float(condition.g.value)
    return mask.reshape(-1, dim), values.reshape(-1, dim)


def contact_nodes_and_friction(
    pair: ContactPair, space: fem.FunctionSpace
) -> tuple[npt.NDArray[np.int64], Array]:
    """Return a pair's sorted contact nodes and the friction coefficient at each of them."""
    if callable(pair.nodes):
        nodes = fem.locate_dofs_geometrical(space, pair.nodes)
    else:
        nodes = np.asarray(pair.nodes)
        nodes = np.flatnonzero(nodes) if nodes.dtype == bool else nodes
    nodes = np.unique(nodes)
    x = space.tabulate_dof_coordinates()[nodes]
    mu = pair.friction(x.T) if callable(pair.friction) else pair.friction
    return nodes, np.broadcast_to(np.asarray(mu, dtype=float), len(nodes)).copy()

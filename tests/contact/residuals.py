"""Residuals of contact states, recomputed from K, a, f and the surfaces alone.

The law is that of small displacements: with r = K a - f the nodal forces, U the translation of
a surface, x undeformed positions and n the surface's normal at x - U,

    gap = gap(x - U) + n·a,    slip = tangential part of (a - U) less the same one increment ago.

Nothing of the library's contact is asked but for displacements and translations. In particular
no node has a status here: stick is "no slip, or friction used up", and so on. What friction does
where supports hold a node along the surface is no part of K a - f: it follows from the slip, and
may be anything that is left of its limit where there is none.

Forces are compared with the largest nodal force (supports included) of the history so far,
lengths with the largest displacement of a node or surface in it. Round-off is taken off first:
of forces 50 eps (|K| max|a| + |f|), what a direct solver leaves; of lengths 64 eps times the
largest coordinate and displacement (centres lie farther off than nodes). Where friction is
large, an error of the tangential force counts for as much as the error of the normal force that
explains it: it is divided by max(1, mu). A history without displacement or force but round-off
(ten times that of lengths, times |K|) has nothing to compare with, and nothing is asked of
lengths or forces then.
In axisymmetry all forces are those of the whole circumference, as K's are. All is in serial.
"""

from collections.abc import Sequence
from dataclasses import dataclass, make_dataclass, replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.contact import ContactPair, Motion
from pw_elements.contact.model import ContactState
from pw_elements.spaces import Assembled

Array = npt.NDArray[np.float64]

_EPS = float(np.finfo(float).eps)
# Slip over the largest length that is none: friction may have either sign then
_ZERO_SLIP_TOLERANCE = 1e-8


ProblemData = make_dataclass(
    "ProblemData", ("K", "space", "loads", "conditions", "pairs")
)  # a problem


@dataclass(frozen=True)
class StepMotion:
    """What is taken of a state: displacements (nodes, dim), translations (pairs, dim)."""

    displacement: Array
    translations: Array

    @classmethod
    def from_state(cls, state: ContactState) -> "StepMotion":
        moved = np.array([pair.translation for pair in state.pairs])
        return cls(state.displacement.array_r.reshape(-1, moved.shape[1]).copy(), moved)


def split_into_substeps(problem, states: Sequence[ContactState]):
    """The problem in the parts into which its increments were cut, their steps, and shares.

    Loads and motions are on the straight way from one increment to the next; the shares are of
    what supports and interference prescribe, which is there from the first increment on.
    """
    loads, steps, shares = [], [], []
    motions: list[list[Motion]] = [[] for _ in problem.pairs]
    load = problem.K.createVecLeft()
    was = [(np.zeros(problem.space.mesh.geometry.dim),) * 2 for _ in problem.pairs]
    for k, state in enumerate(states):
        for share, part in [*state.substates, (1.0, state)]:
            f = load.copy()
            f.scale(1 - share)
            f.axpy(share, problem.loads[k])
            loads.append(f)
            steps.append(StepMotion.from_state(part))
            shares.append(share if k == 0 else 1.0)
            for number, pair in enumerate(problem.pairs):
                end = pair.motions[k] if pair.motions else Motion([0.0] * len(was[number][0]))
                motions[number].append(_motion_at_fraction(end, *was[number], share))
        load = problem.loads[k]
        was = [(pair.translation, pair.force) for pair in state.pairs]
    pairs = [replace(p, motions=m) for p, m in zip(problem.pairs, motions, strict=True)]
    return replace(problem, loads=loads, pairs=pairs), steps, shares


def _motion_at_fraction(end: Motion, moved: Array, pushed: Array, share: float) -> Motion:
    translation = [
        None if u is None else (1 - share) * was + share * u
        for u, was in zip(end.translation, moved, strict=True)
    ]
    force = (1 - share) * pushed + share * end.forces()[:-1]
    return Motion(translation, np.where(np.isnan(end.prescribed()[:-1]), force, 0.0).tolist())


def measure_residuals(
    problem, steps: Sequence[StepMotion], load_factors: Sequence[float] | None = None
) -> list[dict[str, float]]:
    """Each condition's largest violation, for every step of a history from its beginning.

    Shares are of what supports and interference prescribe, in each step; all unless given.
    """
    space, dim = problem.space, problem.space.mesh.geometry.dim
    x = space.tabulate_dof_coordinates()[:, :dim]
    held, prescribed = prescribed_displacements(problem.conditions, *x.shape)
    contacts = [contact_nodes_and_friction(pair, space) for pair in problem.pairs]
    # on an axis of revolution the radius is no direction of friction
    axis = np.array(["axisymmetric" in Assembled.of(problem.K).states, *[False] * (dim - 1)])
    force, length = 0.0, 0.0
    before = StepMotion(np.zeros_like(x), np.zeros((len(contacts), dim)))
    results = []
    for k, step in enumerate(steps):
        a = step.displacement
        r, lost, stiffness = _nodal_forces(problem.K, a, problem.loads[k])
        force = max(force, np.linalg.norm(r, axis=1).max())
        length = max(length, *(np.linalg.norm(u, axis=1).max() for u in (a, step.translations)))
        lost_length = 64 * _EPS * (np.abs(x).max() + length)
        nothing = 10 * stiffness * lost_length
        scale = _Scales(
            force if force > nothing else np.inf,
            length if length > lost_length else np.inf,
            lost,
            lost_length,
        )
        share = 1.0 if load_factors is None else load_factors[k]
        found = {
            "supports": scale.relative_length(np.where(held, np.abs(a - share * prescribed), 0.0))
        }
        balanced = np.ones(len(x), dtype=bool)
        for number, (pair, (nodes, mu)) in enumerate(zip(problem.pairs, contacts, strict=True)):
            moved, was = step.translations[number], before.translations[number]
            slipped = (a[nodes] - moved) - (before.displacement[nodes] - was)
            place, still_inside = x[nodes] - moved, np.zeros(len(nodes))
            if pair.interference:
                still_inside = (1 - share) * np.maximum(0.0, -pair.surface.gap(x[nodes]))
            acts = held[nodes] & ~(axis & (np.abs(x[nodes]) < 1e-9 * np.abs(x).max()))
            free = ~held[nodes]
            known = (place, a[nodes], slipped, r[nodes], free, acts, mu, nodes, still_inside)
            faced, values, on_supports, slack = _contact_law_residuals(pair.surface, scale, *known)
            balanced[nodes[faced]] = False
            motion = pair.motions[k] if pair.motions else None
            # what else a support holds is its own reaction
            total = np.where(held[nodes], 0.0, r[nodes]).sum(axis=0) + on_supports
            values |= _surface_motion_residuals(motion, moved, total, slack, scale)
            for name, value in values.items():
                found[name] = max(found.get(name, 0.0), value)
        alone = np.where(~held & balanced[:, None], np.abs(r), 0.0)
        found["equilibrium"] = scale.relative_force(alone, np.arange(len(x)))
        results.append(found)
        before = step
    return results


def largest_residual(results: Sequence[dict[str, float]]) -> float:
    """The largest of all conditions and steps; infinite where one is not a number."""
    values = np.array([list(found.values()) for found in results])
    return float(np.nan_to_num(values, nan=np.inf).max(initial=0.0))


@dataclass(frozen=True)
class _Scales:
    force: float
    length: float
    force_round_off: Array  # (nodes,)
    length_round_off: float

    def relative_force(self, values: Array, nodes: npt.NDArray, mu: Array | float = 0.0) -> float:
        """Largest force of nodes over the scale, without round-off."""
        share = np.maximum(1.0, mu)
        lost = self.force_round_off[nodes].reshape((-1,) + (1,) * (values.ndim - 1))
        return float(((values - lost) / share / self.force).max(initial=0.0))

    def relative_length(self, values: Array) -> float:
        return float(((values - self.length_round_off) / self.length).max(initial=0.0))


def _contact_law_residuals(
    surface, scale: _Scales, place, a, slipped, r, free, acts, mu, nodes, still_inside
):
    """Which nodes a surface faces, and how well its law holds there; friction on supports.

    That acts on some components (n, dim): its sum (dim,), and what may be added to it. Nodes may
    still be inside of it by some depth (n,), where interference is resolved in parts.
    """
    gap, normal = surface.gap(place) + still_inside, surface.normal(place)
    faced = np.isfinite(gap)
    gap, normal, a, slipped, r, free, acts, mu, nodes = (
        values[faced] for values in (gap, normal, a, slipped, r, free, acts, mu, nodes)
    )
    gap = gap + np.sum(normal * a, axis=1)
    r_n, r_t = _normal_and_tangential(np.where(free, r, 0.0), normal)
    _, slip = _normal_and_tangential(np.where(free | acts, slipped, 0.0), normal)
    slip = np.where(free | acts, slip, 0.0)
    slid, limit = np.linalg.norm(slip, axis=1), mu * np.maximum(0.0, r_n)
    rests = slid <= _ZERO_SLIP_TOLERANCE * scale.length + scale.length_round_off
    against = -(limit / np.where(rests, 1.0, slid))[:, None] * slip
    on_supports = np.where(acts & ~rests[:, None], against, 0.0)
    left = np.sqrt(np.maximum(0.0, limit**2 - np.sum(r_t**2, axis=1)))
    slack = np.where(acts & rests[:, None], left[:, None], 0.0)
    r_t = r_t + on_supports
    friction, slid = np.linalg.norm(r_t, axis=1), np.linalg.norm(slip, axis=1)

    def both(force: Array, length: Array, share: Array | float = 0.0) -> float:
        """Smaller one of two that may not both be there."""
        force = np.maximum(0.0, force - scale.force_round_off[nodes] * np.maximum(1.0, share))
        length = np.maximum(0.0, length - scale.length_round_off)
        relative = force / np.maximum(1.0, share) / scale.force
        return float(np.minimum(relative, length / scale.length).max(initial=0.0))

    # a product of force and slip, over the largest of both
    against = np.linalg.norm(slid[:, None] * r_t + (mu * r_n)[:, None] * slip, axis=1)
    values = {
        "penetration": scale.relative_length(-gap),
        "tension": scale.relative_force(-r_n, nodes),
        "complementarity": both(r_n, gap),
        "cone": scale.relative_force(friction - mu * r_n, nodes, mu),
        "stick": both(mu * r_n - friction, slid, mu),
        "direction": scale.relative_force(against / scale.length, nodes, mu),
    }
    return faced, values, on_supports.sum(axis=0), slack.sum(axis=0)


def _normal_and_tangential(vectors: Array, normal: Array) -> tuple[Array, Array]:
    along = np.sum(vectors * normal, axis=1)
    return along, vectors - along[:, None] * normal


def _surface_motion_residuals(
    motion, moved: Array, total: Array, slack: Array, scale: _Scales
) -> dict[str, float]:
    """Prescribed components of a translation, and total forces in the others."""
    if motion is None:
        return {"motion": scale.relative_length(np.abs(moved)), "balance": 0.0}
    free = np.array([u is None for u in motion.translation])
    stated = np.array([0.0 if u is None else u for u in motion.translation])
    asked = np.zeros(len(moved)) if motion.force is None else np.asarray(motion.force)
    balance = np.where(free, np.abs(total - asked) - slack - scale.force_round_off.max(), 0.0)
    return {
        "motion": scale.relative_length(np.where(free, 0.0, np.abs(moved - stated))),
        "balance": max(0.0, float(balance.max())) / max(scale.force, np.linalg.norm(asked)),
    }


def _nodal_forces(K: PETSc.Mat, a: Array, load: PETSc.Vec) -> tuple[Array, Array, float]:
    """Nodal forces r = K a - f (nodes, dim), what of them is round-off, and max|K|."""
    u, image = K.createVecRight(), K.createVecLeft()
    u.setArray(a.ravel())
    K.mult(u, image)
    f = load.array_r.reshape(a.shape)
    indptr, _, data = K.getValuesCSR()
    size = np.add.reduceat(np.abs(data), indptr[:-1]).reshape(a.shape) * np.abs(a).max() + np.abs(f)
    return image.array_r.reshape(a.shape) - f, 50 * _EPS * size.max(axis=1), np.abs(data).max()


def prescribed_displacements(
    conditions: Sequence[fem.DirichletBC], nodes: int, dim: int
) -> tuple[npt.NDArray[np.bool_], Array]:
    """Which displacements (nodes, dim) are prescribed, and their values."""
    held, values = np.zeros(nodes * dim, dtype=bool), np.zeros(nodes * dim)
    for condition in conditions:
        dofs = condition.dof_indices()[0]
        held[dofs], values[dofs] = True, float(condition.g.value)
    return held.reshape(-1, dim), values.reshape(-1, dim)


def contact_nodes_and_friction(
    pair: ContactPair, space: fem.FunctionSpace
) -> tuple[npt.NDArray[np.int64], Array]:
    if callable(pair.nodes):
        nodes = fem.locate_dofs_geometrical(space, pair.nodes)
    else:
        nodes = np.asarray(pair.nodes)
        nodes = np.flatnonzero(nodes) if nodes.dtype == bool else nodes
    nodes = np.unique(nodes)
    x = space.tabulate_dof_coordinates()[nodes]
    mu = pair.friction(x.T) if callable(pair.friction) else pair.friction
    return nodes, np.broadcast_to(np.asarray(mu, dtype=float), len(nodes)).copy()

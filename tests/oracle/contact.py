"""Frictional contact by nonlinear Gauss-Seidel on a dense compliance of the contact nodes.

The law of a node, with r the force on it, n the direction in which it is pushed, g the gap and v
the slip since the end of the previous increment:

    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= mu r_n,  |v| r_t + mu r_n v = 0.

Nothing may hold the body but contact, and nothing a surface but its prescribed force: then no
compliance exists. So every contact node is tied to what it faces by springs of stiffness alpha,
and the springs' forces are counted out of the law exactly. With z all free displacements, of
nodes and of surfaces, w = B z the motion of contact nodes relative to what they face, and A z =
f + B^T r the equations,

    (A + alpha B^T B) z = f + B^T s,     s = r + alpha w,     w = w_f + C s:

C exists whatever is free, and any s with the law between r = s - alpha w and w is a solution,
whatever alpha. Gauss-Seidel goes from node to node: with all other s fixed, w_i = const + L_i r_i
with L_i = (1 - alpha C_ii)^-1 C_ii, and r_i is moved to the law's projection of r_i - (g; v) /
|L_i|. Sweeps go to and fro: in one direction only, and with much friction, they can drive a wave of
opening nodes before them for ever. Now and then the statuses that have come up so far are put into
equations, which Newton's method solves; only what obeys the law is accepted.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

MAX_SWEEPS, SWEEPS_PER_NEWTON = 5_000, 10
LAW_TOLERANCE = 1e-11  # of the law, see `law_error`
SINGULAR_CONDITION_NUMBER = 1e13  # condition of a tangent
MACHINE_EPSILON = float(np.finfo(float).eps)
PointFunction = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Pair:
    """Nodes that face one rigid surface, or nodes of another body."""

    nodes: np.ndarray
    gap: PointFunction
    normal: PointFunction
    mu: float | np.ndarray = 0.0
    motions: Sequence[tuple[Sequence[float | None], Sequence[float]]] = ()
    opposite_nodes: np.ndarray | None = None


@dataclass(frozen=True)
class State:
    displacement: np.ndarray
    forces: list[np.ndarray]
    translations: np.ndarray
    law_error: float
    gaps: list[np.ndarray]


class NotConverged(Exception):
    """Gauss-Seidel came to no end."""


def solve_increments(
    K: sparse.spmatrix,
    loads: Sequence[np.ndarray],
    prescribed_mask: np.ndarray,
    pairs: Sequence[Pair],
    nodes: np.ndarray,
    spring_factor: float = 1.0,
) -> list[State]:
    """States at the end of increments."""
    count = sum(len(pair.nodes) for pair in pairs)
    past, translations = np.zeros((count, nodes.shape[1])), np.zeros((len(pairs), nodes.shape[1]))
    system, s, states = None, np.zeros_like(past), []
    for k, load in enumerate(loads):
        prescribed, forces = (
            np.array(part)
            for part in zip(*(_prescribed_motion(p, k, nodes) for p in pairs), strict=True)
        )
        free = np.isnan(prescribed)
        if system is None or not np.array_equal(free, system.free):
            system = _ContactCompliance(K, prescribed_mask, pairs, nodes, free, spring_factor)
        translations = np.where(free, translations, prescribed)
        state, past, s = system.solve_increment(load, translations, forces, past, s)
        translations = state.translations
        states.append(state)
    return states


def measure_law_violation(r: np.ndarray, y: np.ndarray, mu: np.ndarray) -> float:
    """Largest violation of the law's lines over the largest force."""
    size = np.abs(r).max() or 1.0
    (r_n, r_t), (g, v) = ((x[:, 0] / size, x[:, 1:] / size) for x in (r, y))
    friction, slip = np.linalg.norm(r_t, axis=1), np.linalg.norm(v, axis=1)
    against = (slip[:, None] * r_t + (mu * r_n)[:, None] * v) / np.maximum(1.0, slip)[:, None]
    lines = (-r_n, -g, np.minimum(r_n, g), friction - mu * r_n, np.abs(against))
    return float(max(line.max() for line in lines))


def _prescribed_motion(pair: Pair, k: int, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Translation, NaN where it is free, and force."""
    zero = np.zeros(nodes.shape[1])
    moved, force = pair.motions[k] if pair.motions else (zero, zero)
    return np.array([np.nan if u is None else u for u in moved]), np.array(force, dtype=float)


def _project_onto_cone(r: np.ndarray, mu: float) -> np.ndarray:
    """The force (dim,) of Coulomb's cone that the law puts in place of a trial force."""
    normal, tangential = max(0.0, r[0]), r[1:]
    size = np.sqrt(tangential @ tangential)
    shrink = min(1.0, mu * normal / size) if size > 0 else 1.0
    return np.concatenate([[normal], shrink * tangential])


class _ContactCompliance:
    """Compliance of m contact nodes under given supports and free translations."""

    def __init__(self, K, held, pairs, nodes, free, tie) -> None:
        self.pairs, self.nodes, self.free, self.dim = pairs, nodes, free, nodes.shape[1]
        self.node = np.concatenate([pair.nodes for pair in pairs])
        self.pair = np.repeat(np.arange(len(pairs)), [len(pair.nodes) for pair in pairs])
        self.mu = np.concatenate([np.broadcast_to(p.mu, len(p.nodes)) for p in pairs]).astype(float)
        self.mu[held[self.node].any(axis=1)] = 0.0
        self.free_dofs = np.flatnonzero(~held.ravel())
        m, dim, surfaces = len(self.node), self.dim, int(free.sum())

        place = self.node[:, None] * dim + np.arange(dim)
        B = sparse.lil_matrix((m * dim, nodes.size))
        B[np.arange(m * dim), place.ravel()] = 1.0
        for k, pair in enumerate(pairs):
            if pair.opposite is not None:
                rows = np.arange(m * dim).reshape(m, dim)[self.pair == k]
                B[rows.ravel(), (pair.opposite[:, None] * dim + np.arange(dim)).ravel()] = -1.0
        moving = np.zeros((m * dim, surfaces))
        for column, (k, axis) in enumerate(np.argwhere(free)):
            moving[np.flatnonzero(self.pair == k) * dim + axis, column] = -1.0
        self.B = sparse.hstack([B.tocsc()[:, self.free_dofs], moving]).tocsc()
        A = K.tocsc()[self.free_dofs][:, self.free_dofs]
        A = sparse.block_diag([A, sparse.csc_matrix((surfaces, surfaces))])
        self.spring_stiffness = tie * K.diagonal()[place].mean() / m
        self.A = (A + self.spring_stiffness * self.B.T @ self.B).tocsc()
        self.factors = splu(self.A)
        self.C = self.B @ self.factors.solve(self.B.T.toarray())

    def solve_increment(self, load, translations, forces, past, s):
        """One increment: its state, and relative motion w and s (m, dim) at its end.

        A free translation changes gaps, linearly to planes only: they are taken anew until
        nothing changes.
        """
        f = np.concatenate([load[self.free_dofs], forces[self.free]])
        for _ in range(100):
            known = np.where(self.free, 0.0, translations)[self.pair]
            frame, gap = self._frames_and_gaps(translations)
            z, w, s, error = self._solve_fixed_geometry(f, known, frame, gap, past, s)
            translations = translations.copy()
            translations[self.free] = z[len(self.free_dofs) :]
            change = np.abs(self._frames_and_gaps(translations)[1] - gap).max()
            if change <= 8 * MACHINE_EPSILON * max(np.abs(self.nodes).max(), np.abs(w).max()):
                break
        else:
            raise NotConverged(f"the surfaces do not come to rest: gaps change by {change}")
        u = np.zeros(self.nodes.size)
        u[self.free_dofs] = z[: len(self.free_dofs)]
        r, gap = s - self.spring_stiffness * w, gap + np.sum(frame[:, 0] * w, axis=1)
        by_pair = [self.pair == k for k in range(len(self.pairs))]
        state = State(
            u.reshape(self.nodes.shape),
            [r[mine] for mine in by_pair],
            translations,
            error,
            [gap[mine] for mine in by_pair],
        )
        return state, w, s

    def _frames_and_gaps(self, translations):
        """Frames (m, dim, dim), normal first, and gaps (m,) less n·w."""
        shift = translations[self.pair]
        x, normal, gap = self.nodes[self.node] - shift, np.empty((len(self.node), self.dim)), []
        for k, pair in enumerate(self.pairs):
            normal[self.pair == k] = pair.normal(x[self.pair == k])
            gap.append(pair.gap(x[self.pair == k]))
        # a Householder reflection of the first unit vector into the normal has tangents as rows
        h = normal - np.eye(self.dim)[0]
        size = np.maximum(np.sum(h**2, axis=1), 1e-300)
        frame = np.eye(self.dim) - 2 * np.einsum("ma,mb->mab", h, h) / size[:, None, None]
        return frame, np.concatenate(gap) + np.sum(normal * shift, axis=1)

    def _solve_fixed_geometry(self, f, known, frame, gap, past, s):
        """Displacements z, relative motion w and s (m, dim) that obey the law, and its error.

        Long slips, times alpha, take digits from C s: what z lacks for equilibrium is found out
        afterwards, and put right together with what that changes of the law.
        """
        Q = sparse.block_diag(list(frame)).tocsr()
        law = _LawSolver(Q @ (Q @ self.C.T).T, self.spring_stiffness, self.mu)
        y0 = -np.einsum("mab,mb->ma", frame, past)
        y0[:, 0] = gap

        def equilibrium(z, s):
            """z, and y and r in the nodes' frames, after a step of refinement."""
            z = z + self.factors.solve(
                f + self.B.T @ (s + self.spring_stiffness * known).ravel() - self.A @ z
            )
            w = (self.B @ z).reshape(s.shape) - known
            y, r = (np.einsum("mab,mb->ma", frame, x) for x in (w, s - self.spring_stiffness * w))
            return z, w, y + y0, r

        z, w, y, r = equilibrium(np.zeros(self.A.shape[0]), s)
        ds = law.solve_by_gauss_seidel(y, r)
        for _ in range(5):
            s = s + np.einsum("mba,mb->ma", frame, ds)
            z, w, y, r = equilibrium(equilibrium(z, s)[0], s)
            error = law.relative_violation(y, r)
            if error <= 1:
                return z, w, s, error
            ds = law.solve_by_newton(y, r)
        raise NotConverged(f"refinement ends {error} times the accuracy from the law")


class _LawSolver:
    """The law at m nodes in their frames, where dy = C ds and r = s - alpha w."""

    def __init__(self, C, alpha, mu) -> None:
        self.C, self.alpha, self.mu = C, alpha, mu
        m = len(mu)
        dim = len(C) // m
        blocks = C.reshape(m, dim, m, dim)[np.arange(m), :, np.arange(m)]
        self.ds_of_dr = np.linalg.inv(np.eye(dim) - alpha * blocks)  # ds of a dr
        self.node_stiffness = 1 / np.linalg.norm(self.ds_of_dr @ blocks, ord=2, axis=(1, 2))

    def relative_violation(self, y, r):
        """Violation of the law over what is allowed; gaps and slips count times a stiffness.

        Besides `ACCURACY` the round-off of these products is allowed, within bounds: it is more
        only where slips are long against the body's deformation, as a wedge's on soft springs.
        """
        as_forces = self.node_stiffness[:, None] * y
        round_off = 16 * MACHINE_EPSILON * np.abs(as_forces).max() / (np.abs(r).max() or 1.0)
        return measure_law_violation(r, as_forces, self.mu) / (
            LAW_TOLERANCE + min(round_off, 10 * LAW_TOLERANCE)
        )

    def solve_by_gauss_seidel(self, y, r):
        """The change (m, dim) of s that leads from an equilibrium to one that obeys the law."""
        m, dim = r.shape
        total = np.zeros((m, dim))
        for sweep in range(1, MAX_SWEEPS + 1):
            for i in range(m)[:: 1 if sweep % 2 else -1]:
                new = _project_onto_cone(r[i] - self.node_stiffness[i] * y[i], self.mu[i])
                ds = self.ds_of_dr[i] @ (new - r[i])
                dy = (self.C[:, i * dim : (i + 1) * dim] @ ds).reshape(m, dim)
                y, r = y + dy, r - self.alpha * dy
                r[i] += ds
                total[i] += ds
            if sweep % SWEEPS_PER_NEWTON == 0:
                ds = self.solve_by_newton(y, r)
                dy = (self.C @ ds.ravel()).reshape(m, dim)
                dr = ds - self.alpha * dy
                error = self.relative_violation(y + dy, r + dr)
                if error < 0.1 * self.relative_violation(y, r):  # so that it cannot lead in circles
                    y, r, total = y + dy, r + dr, total + ds
                if error <= 1:
                    return total
        raise NotConverged(f"{MAX_SWEEPS} sweeps")

    def solve_by_newton(self, y, r):
        """Newton's method on the equations of the present statuses: a change (m, dim) of s."""
        m, dim = r.shape
        trial = [
            _project_onto_cone(*of)
            for of in zip(r - self.node_stiffness[:, None] * y, self.mu, strict=True)
        ]
        dr_ds, total = np.eye(m * dim) - self.alpha * self.C, np.zeros((m, dim))
        for _ in range(8 if dim == 3 else 2):
            as_forces = self.node_stiffness[:, None] * y
            lines = [
                _status_equations(*of) for of in zip(trial, as_forces, r, self.mu, strict=True)
            ]
            E, G, residual = (list(part) for part in zip(*lines, strict=True))
            G = [step * block for step, block in zip(self.node_stiffness, G, strict=True)]
            E, G = sparse.block_diag(E).tocsr(), sparse.block_diag(G).tocsr()
            tangent = E @ dr_ds + G @ self.C
            if (
                np.linalg.cond(tangent) > SINGULAR_CONDITION_NUMBER
            ):  # statuses that leave the body free
                break
            ds = np.linalg.solve(tangent, -np.concatenate(residual))
            y = y + (self.C @ ds).reshape(m, dim)
            r = r + (dr_ds @ ds).reshape(m, dim)
            total += ds.reshape(m, dim)
            if self.relative_violation(y, r) <= 1:
                break
        return total


def _status_equations(trial, y, r, mu):
    """E dr + G dy = -residual of a node whose status a projected force (dim,) tells.

    Gaps and slips y (dim,) are multiplied by a stiffness, so that E and G are of one size.
    """
    dim = len(r)
    one, none = np.eye(dim), np.zeros((dim, dim))
    friction = np.sqrt(trial[1:] @ trial[1:])
    if trial[0] <= 0:  # open
        return one, none, r
    if friction < mu * trial[0] * (1 - 1e-12):  # stick
        return none, one, y
    # slip: r_t + mu r_n d = 0, d the direction of slip; in the plane that of the trial is surer
    size = np.sqrt(y[1:] @ y[1:]) or 1.0
    d = y[1:] / size if dim == 3 else -np.sign(trial[1:])
    E, G = np.eye(dim), none
    E[0, 0], E[1:, 0], G[0, 0] = 0.0, mu * d, 1.0
    G[1:, 1:] = mu * r[0] / size * (np.eye(dim - 1) - np.outer(d, d)) * (dim == 3)
    return E, G, np.concatenate([y[:1], r[1:] + mu * r[0] * d])

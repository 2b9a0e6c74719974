"""Frictional contact by nonlinear Gauss-Seidel on a dense compliance of the contact nodes.

Let r be the force on a node, n the direction in which contact pushes it, g the gap, v the slip
since the end of the previous increment, and mu the friction coefficient. The law at the node is

    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= mu r_n,  |v| r_t + mu r_n v = 0.

A body may be held by contact alone, and a surface by its prescribed force alone. In such cases
there is no compliance. Therefore springs of stiffness alpha connect every contact node to the point
that it faces, and the law is stated for the contact forces without the forces of these springs. Let
z be all free displacements of nodes and surfaces, A the stiffness matrix and f the loads. The
motion of contact nodes relative to the points that they face is w = B z. The equilibrium equations
A z = f + B^T r become

    (A + alpha B^T B) z = f + B^T s,     s = r + alpha w,     w = w_f + C s.

The compliance C always exists, and w_f is the motion for s = 0. For any alpha, s is a solution if w
and r = s - alpha w obey the law. Gauss-Seidel visits the nodes in turn. If s is fixed at all other
nodes, w_i = const + L_i r_i with L_i = (1 - alpha C_ii)^-1 C_ii. Then r_i is set to the projection
of r_i - (g; v) / |L_i| on the friction cone. Sweeps alternate in direction: with a single direction
and large friction, a wave of opening nodes can travel forever. Every few sweeps, Newton's method
solves the equations for the present statuses; its result is used only if it violates the law by
less than a tenth of the present violation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

MAX_GAUSS_SEIDEL_SWEEPS, GAUSS_SEIDEL_SWEEPS_PER_NEWTON_ATTEMPT = 5_000, 10
# tolerance of the law's conditions, used by `violation_over_tolerance`
LAW_TOLERANCE_OVER_LARGEST_FORCE = 1e-11
SINGULAR_CONDITION_NUMBER = 1e13  # tangents with a larger condition number count as singular
MACHINE_EPSILON = float(np.finfo(float).eps)
PointFunction = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class NodesAndSurface:
    """Contact nodes that face one rigid surface or the nodes of another body.

    `gap` and `normal` are functions of positions (m, dim). `motions` has the translation of the
    surface (None for free components) and the force on it for each increment.
    """

    nodes: np.ndarray
    gap: PointFunction
    normal: PointFunction
    mu: float | np.ndarray = 0.0
    motions: Sequence[tuple[Sequence[float | None], Sequence[float]]] = ()
    opposite_nodes: np.ndarray | None = None


@dataclass(frozen=True)
class IncrementSolution:
    """Displacements (n, dim), and forces (m, dim), translation and gaps (m,) of each pair.

    `law_error` is the violation of the law divided by its tolerance.
    """

    displacement: np.ndarray
    forces: list[np.ndarray]
    translations: np.ndarray
    law_error: float
    gaps: list[np.ndarray]


class NotConverged(Exception):
    """Error that is raised if the iterations of this module do not converge."""


def solve_increments(
    K: sparse.spmatrix,
    loads: Sequence[np.ndarray],
    prescribed_mask: np.ndarray,
    pairs: Sequence[NodesAndSurface],
    node_positions: np.ndarray,
    spring_over_mean_stiffness: float = 1.0,
) -> list[IncrementSolution]:
    """Solve all increments by the method of this module, and return the states at their ends.

    The stiffness of the springs is `spring_over_mean_stiffness` times the mean diagonal entry of K
    at the contact nodes, divided by the number of these nodes.
    """
    n_contact = sum(len(pair.nodes) for pair in pairs)
    previous_motion, translations = (
        np.zeros((n_contact, node_positions.shape[1])),
        np.zeros((len(pairs), node_positions.shape[1])),
    )
    system, spring_force_sum, states = None, np.zeros_like(previous_motion), []
    for k, load in enumerate(loads):
        prescribed, forces = (
            np.array(part)
            for part in zip(
                *(_prescribed_translation_and_force(p, k, node_positions) for p in pairs),
                strict=True,
            )
        )
        free = np.isnan(prescribed)
        if system is None or not np.array_equal(free, system.free):
            system = _ContactCompliance(
                K, prescribed_mask, pairs, node_positions, free, spring_over_mean_stiffness
            )
        translations = np.where(free, translations, prescribed)
        state, previous_motion, spring_force_sum = system.solve_increment(
            load, translations, forces, previous_motion, spring_force_sum
        )
        translations = state.translations
        states.append(state)
    return states


def relative_law_violation(
    forces: np.ndarray, scaled_gaps_and_slips: np.ndarray, mu: np.ndarray
) -> float:
    """Return the largest violation of the law's conditions, divided by the largest force.

    The rows of `forces` (m, dim) and of `scaled_gaps_and_slips` (m, dim), which are gaps and slips
    times a stiffness, begin with the normal component.
    """
    largest = np.abs(forces).max() or 1.0
    (r_n, r_t), (g, v) = (
        (x[:, 0] / largest, x[:, 1:] / largest) for x in (forces, scaled_gaps_and_slips)
    )
    friction, slip = np.linalg.norm(r_t, axis=1), np.linalg.norm(v, axis=1)
    friction_error = (slip[:, None] * r_t + (mu * r_n)[:, None] * v) / np.maximum(1.0, slip)[
        :, None
    ]
    violations = (-r_n, -g, np.minimum(r_n, g), friction - mu * r_n, np.abs(friction_error))
    return float(max(violation.max() for violation in violations))


def _prescribed_translation_and_force(
    pair: NodesAndSurface, increment: int, node_positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the translation and the force that are prescribed in the given increment.

    Free components of the translation are NaN.
    """
    zero = np.zeros(node_positions.shape[1])
    translation, force = pair.motions[increment] if pair.motions else (zero, zero)
    return np.array([np.nan if u is None else u for u in translation]), np.array(force, dtype=float)


def _shrink_to_friction_cone(trial_force: np.ndarray, mu: float) -> np.ndarray:
    """Project a trial force (dim,), normal component first, onto Coulomb's cone.

    The projection is not orthogonal: the shear is shortened to the friction limit of the normal
    force.
    """
    normal, tangential = max(0.0, trial_force[0]), trial_force[1:]
    friction = np.sqrt(tangential @ tangential)
    shrink = min(1.0, mu * normal / friction) if friction > 0 else 1.0
    return np.concatenate([[normal], shrink * tangential])


class _ContactCompliance:
    """Compliance matrix of m contact nodes for given supports and free surface translations."""

    def __init__(self, K, prescribed_mask, pairs, nodes, free, tie) -> None:
        self.pairs, self.nodes, self.free, self.dim = pairs, nodes, free, nodes.shape[1]
        self.node = np.concatenate([pair.nodes for pair in pairs])
        self.pair = np.repeat(np.arange(len(pairs)), [len(pair.nodes) for pair in pairs])
        self.mu = np.concatenate([np.broadcast_to(p.mu, len(p.nodes)) for p in pairs]).astype(float)
        self.mu[prescribed_mask[self.node].any(axis=1)] = 0.0
        self.free_dofs = np.flatnonzero(~prescribed_mask.ravel())
        m, dim, n_free = len(self.node), self.dim, int(free.sum())

        dofs = self.node[:, None] * dim + np.arange(dim)
        B = sparse.lil_matrix((m * dim, nodes.size))
        B[np.arange(m * dim), dofs.ravel()] = 1.0
        for k, pair in enumerate(pairs):
            if pair.opposite_nodes is not None:
                rows = np.arange(m * dim).reshape(m, dim)[self.pair == k]
                opposite_dofs = pair.opposite_nodes[:, None] * dim + np.arange(dim)
                B[rows.ravel(), opposite_dofs.ravel()] = -1.0
        surface_columns = np.zeros((m * dim, n_free))
        for column, (k, axis) in enumerate(np.argwhere(free)):
            surface_columns[np.flatnonzero(self.pair == k) * dim + axis, column] = -1.0
        self.B = sparse.hstack([B.tocsc()[:, self.free_dofs], surface_columns]).tocsc()
        A = K.tocsc()[self.free_dofs][:, self.free_dofs]
        A = sparse.block_diag([A, sparse.csc_matrix((n_free, n_free))])
        self.spring_stiffness = tie * K.diagonal()[dofs].mean() / m
        self.A = (A + self.spring_stiffness * self.B.T @ self.B).tocsc()
        self.factors = splu(self.A)
        self.C = self.B @ self.factors.solve(self.B.T.toarray())

    def solve_increment(
        self, load, translations, surface_forces, previous_relative_motion, augmented_forces
    ):
        """Return the state, relative motion w (m, dim) and augmented force s (m, dim) at the end.

        The module defines w and s. Gaps depend on the free translations, and this dependence is
        linear only for planes. Therefore gaps are recomputed until they no longer change.
        """
        f = np.concatenate([load[self.free_dofs], surface_forces[self.free]])
        for _ in range(100):
            prescribed_translation = np.where(self.free, 0.0, translations)[self.pair]
            frame, gap = self._frames_and_gaps(translations)
            z, w, augmented_forces, error = self._solve_with_fixed_frames_and_gaps(
                f, prescribed_translation, frame, gap, previous_relative_motion, augmented_forces
            )
            translations = translations.copy()
            translations[self.free] = z[len(self.free_dofs) :]
            change = np.abs(self._frames_and_gaps(translations)[1] - gap).max()
            if change <= 8 * MACHINE_EPSILON * max(np.abs(self.nodes).max(), np.abs(w).max()):
                break
        else:
            raise NotConverged(f"the surfaces do not come to rest: gaps change by {change}")
        u = np.zeros(self.nodes.size)
        u[self.free_dofs] = z[: len(self.free_dofs)]
        r, gap = augmented_forces - self.spring_stiffness * w, gap + np.sum(frame[:, 0] * w, axis=1)
        pair_masks = [self.pair == k for k in range(len(self.pairs))]
        state = IncrementSolution(
            u.reshape(self.nodes.shape),
            [r[of_pair] for of_pair in pair_masks],
            translations,
            error,
            [gap[of_pair] for of_pair in pair_masks],
        )
        return state, w, augmented_forces

    def _frames_and_gaps(self, translations):
        """Return frames (m, dim, dim), normal first, and the gaps (m,) at zero relative motion."""
        shift = translations[self.pair]
        x, normal, gap = self.nodes[self.node] - shift, np.empty((len(self.node), self.dim)), []
        for k, pair in enumerate(self.pairs):
            normal[self.pair == k] = pair.normal(x[self.pair == k])
            gap.append(pair.gap(x[self.pair == k]))
        # rows of the Householder reflection that maps the first unit vector to the normal
        h = normal - np.eye(self.dim)[0]
        size = np.maximum(np.sum(h**2, axis=1), 1e-300)
        frame = np.eye(self.dim) - 2 * np.einsum("ma,mb->mab", h, h) / size[:, None, None]
        return frame, np.concatenate(gap) + np.sum(normal * shift, axis=1)

    def _solve_with_fixed_frames_and_gaps(
        self, load, prescribed_translation, frame, gap, previous_relative_motion, s
    ):
        """Return z, w and s (m, dim) that obey the law for fixed frames and gaps.

        The fourth value is the violation of the law divided by its tolerance. The module defines z,
        w, s, C and alpha. If slips are long, alpha w is much larger than the contact forces, and
        digits of C s are lost. Therefore the imbalance of z is computed afterwards, and corrected
        together with its effect on the law.
        """
        Q = sparse.block_diag(list(frame)).tocsr()
        solver = _ContactLawSolver(Q @ (Q @ self.C.T).T, self.spring_stiffness, self.mu)
        y0 = -np.einsum("mab,mb->ma", frame, previous_relative_motion)
        y0[:, 0] = gap

        def refine_equilibrium(z, s):
            """Correct the imbalance of z once, and return z, w, y and r.

            The gaps and slips y (m, dim) and the contact forces r (m, dim) are in the frames of the
            nodes.
            """
            z = z + self.factors.solve(
                load
                + self.B.T @ (s + self.spring_stiffness * prescribed_translation).ravel()
                - self.A @ z
            )
            w = (self.B @ z).reshape(s.shape) - prescribed_translation
            y, r = (np.einsum("mab,mb->ma", frame, x) for x in (w, s - self.spring_stiffness * w))
            return z, w, y + y0, r

        z, w, y, r = refine_equilibrium(np.zeros(self.A.shape[0]), s)
        ds = solver.force_change_by_gauss_seidel(y, r)
        for _ in range(5):
            s = s + np.einsum("mba,mb->ma", frame, ds)
            z, w, y, r = refine_equilibrium(refine_equilibrium(z, s)[0], s)
            error = solver.violation_over_tolerance(y, r)
            if error <= 1:
                return z, w, s, error
            ds = solver.force_change_by_newton(y, r)
        raise NotConverged(f"refinement ends {error} times the accuracy from the law")


class _ContactLawSolver:
    """The law at m nodes in their frames, as a problem for the augmented forces s.

    Changes of the gaps and slips y are dy = C ds, and the contact forces are r = s - alpha w. The
    module defines C, alpha and w.
    """

    def __init__(self, C, alpha, mu) -> None:
        self.C, self.alpha, self.mu = C, alpha, mu
        m = len(mu)
        dim = len(C) // m
        blocks = C.reshape(m, dim, m, dim)[np.arange(m), :, np.arange(m)]
        self.ds_of_dr = np.linalg.inv(np.eye(dim) - alpha * blocks)  # from dr to ds
        self.node_stiffness = 1 / np.linalg.norm(self.ds_of_dr @ blocks, ord=2, axis=(1, 2))

    def violation_over_tolerance(self, gaps_and_slips, forces):
        """Return the violation of the law, divided by its tolerance.

        Gaps and slips are multiplied by a stiffness. The tolerance is
        `LAW_TOLERANCE_OVER_LARGEST_FORCE` plus the round-off of these products, which is limited to
        ten times that value. The round-off matters only if slips are long compared with the body's
        deformation, for example for a wedge on soft springs.
        """
        as_forces = self.node_stiffness[:, None] * gaps_and_slips
        round_off = 16 * MACHINE_EPSILON * np.abs(as_forces).max() / (np.abs(forces).max() or 1.0)
        return relative_law_violation(forces, as_forces, self.mu) / (
            LAW_TOLERANCE_OVER_LARGEST_FORCE + min(round_off, 10 * LAW_TOLERANCE_OVER_LARGEST_FORCE)
        )

    def force_change_by_gauss_seidel(self, gaps_and_slips, forces):
        """Return the change (m, dim) of s that makes a state in equilibrium obey the law."""
        m, dim = forces.shape
        total_ds = np.zeros((m, dim))
        for sweep in range(1, MAX_GAUSS_SEIDEL_SWEEPS + 1):
            for i in range(m)[:: 1 if sweep % 2 else -1]:
                projected = _shrink_to_friction_cone(
                    forces[i] - self.node_stiffness[i] * gaps_and_slips[i], self.mu[i]
                )
                ds = self.ds_of_dr[i] @ (projected - forces[i])
                dy = (self.C[:, i * dim : (i + 1) * dim] @ ds).reshape(m, dim)
                gaps_and_slips, forces = gaps_and_slips + dy, forces - self.alpha * dy
                forces[i] += ds
                total_ds[i] += ds
            if sweep % GAUSS_SEIDEL_SWEEPS_PER_NEWTON_ATTEMPT == 0:
                ds = self.force_change_by_newton(gaps_and_slips, forces)
                dy = (self.C @ ds.ravel()).reshape(m, dim)
                dr = ds - self.alpha * dy
                violation = self.violation_over_tolerance(gaps_and_slips + dy, forces + dr)
                if violation < 0.1 * self.violation_over_tolerance(
                    gaps_and_slips, forces
                ):  # only a large decrease is accepted, which excludes cycles
                    gaps_and_slips, forces, total_ds = (
                        gaps_and_slips + dy,
                        forces + dr,
                        total_ds + ds,
                    )
                if violation <= 1:
                    return total_ds
        raise NotConverged(f"{MAX_GAUSS_SEIDEL_SWEEPS} sweeps")

    def force_change_by_newton(self, gaps_and_slips, forces):
        """Return the change (m, dim) of s that Newton's method finds for the present statuses."""
        m, dim = forces.shape
        trial = [
            _shrink_to_friction_cone(*node_data)
            for node_data in zip(
                forces - self.node_stiffness[:, None] * gaps_and_slips, self.mu, strict=True
            )
        ]
        dr_ds, total_ds = np.eye(m * dim) - self.alpha * self.C, np.zeros((m, dim))
        for _ in range(8 if dim == 3 else 2):
            as_forces = self.node_stiffness[:, None] * gaps_and_slips
            equations = [
                _linearised_status_equations(*node_data)
                for node_data in zip(trial, as_forces, forces, self.mu, strict=True)
            ]
            E, G, residual = (list(items) for items in zip(*equations, strict=True))
            G = [step * block for step, block in zip(self.node_stiffness, G, strict=True)]
            E, G = sparse.block_diag(E).tocsr(), sparse.block_diag(G).tocsr()
            tangent = E @ dr_ds + G @ self.C
            if (
                np.linalg.cond(tangent) > SINGULAR_CONDITION_NUMBER
            ):  # the statuses leave the body free
                break
            ds = np.linalg.solve(tangent, -np.concatenate(residual))
            gaps_and_slips = gaps_and_slips + (self.C @ ds).reshape(m, dim)
            forces = forces + (dr_ds @ ds).reshape(m, dim)
            total_ds += ds.reshape(m, dim)
            if self.violation_over_tolerance(gaps_and_slips, forces) <= 1:
                break
        return total_ds


def _linearised_status_equations(trial_force, scaled_gap_and_slip, force, mu):
    """Return the linear equations E dr + G dy = -residual for the status of a node.

    The status is that of the trial force. The node has the force r (dim,), and the gap and slip y
    (dim,), which are multiplied by a stiffness so that E and G have similar magnitudes.
    """
    dim = len(force)
    identity, zero = np.eye(dim), np.zeros((dim, dim))
    friction = np.sqrt(trial_force[1:] @ trial_force[1:])
    if trial_force[0] <= 0:  # open
        return identity, zero, force
    if friction < mu * trial_force[0] * (1 - 1e-12):  # stick
        return zero, identity, scaled_gap_and_slip
    # slip: r_t + mu r_n d = 0 with d the direction of slip; in the plane the trial force gives d
    slip_size = np.sqrt(scaled_gap_and_slip[1:] @ scaled_gap_and_slip[1:]) or 1.0
    d = scaled_gap_and_slip[1:] / slip_size if dim == 3 else -np.sign(trial_force[1:])
    E, G = np.eye(dim), zero
    E[0, 0], E[1:, 0], G[0, 0] = 0.0, mu * d, 1.0
    G[1:, 1:] = mu * force[0] / slip_size * (np.eye(dim - 1) - np.outer(d, d)) * (dim == 3)
    return E, G, np.concatenate([scaled_gap_and_slip[:1], force[1:] + mu * force[0] * d])

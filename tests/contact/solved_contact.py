"""Contact states as tests read them, and how far round-off may have moved them."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space
from scipy.spatial import cKDTree

from pw_elements.contact import OPEN, STICK
from pw_elements.contact.model import ContactState
from tests.contact.drawn_contact import Stated
from tests.library.properties import dense, terms
from tests.library.random_meshes import EPS

# What the library promises of the law: this part of the largest nodal force, or round-off
LAW = 1e-9


@dataclass(frozen=True)
class Solved:
    """One increment, as the test reads it: from K a - f and the surface, at the contact nodes."""

    stated: Stated
    increment: int
    state: ContactState
    before: "Solved | None"

    def __post_init__(self):
        e, pair = self.stated.elastic, self.state.pairs[0]
        dim = e.grid.dim
        a = self.state.displacement.array.reshape(-1, dim)
        f = self.stated.loads[self.increment].array.reshape(-1, dim)
        node = cKDTree(e.x).query(pair.position)[1]
        x = e.x[node] - pair.translation
        normal = self.stated.pair.surface.normal(x)
        K = dense(e.K)
        r = (K @ a.ravel()).reshape(-1, dim) - f
        relative = a[node] - pair.translation
        slip = relative - (self.before.relative if self.before else 0.0)
        slip = slip - normal * np.sum(normal * slip, axis=1)[:, None]
        r_n = np.sum(normal * r[node], axis=1)
        for name, value in {
            "K": K,
            "a": a,
            "f": f,
            "r": r,
            "node": node,
            "normal": normal,
            "relative": relative,
            "slip": slip,
            "gap": self.stated.pair.surface.gap(x) + np.sum(normal * a[node], axis=1),
            "r_n": r_n,
            "r_t": r[node] - r_n[:, None] * normal,
            "stiffness": np.diag(K).reshape(-1, dim)[node].mean(axis=1),
        }.items():
            object.__setattr__(self, name, value)

    def lost(self):
        """Force (n,) at contact nodes that is nothing but round-off, of forces and of gaps."""
        e = self.stated.elastic
        sums = len(self.K) * e.round_off * (np.abs(self.K) @ np.abs(self.a.ravel())).max()
        return sums + self.stiffness * 8 * EPS * np.abs(e.x).max()

    def tolerance(self):
        """Force (n,) by which the law may be missed at contact nodes."""
        return LAW * np.abs(self.r[self.node]).max() + self.lost()

    def violation(self):
        """What is left (n,) of the equations of contact: forces, zero for the exact solution.

        r_n = max(0, p) with p = r_n - c g; r_t is the nearest to r_t - c v of at most mu max(0, p).
        """
        pressing = np.maximum(0.0, self.r_n - self.stiffness * self.gap)
        shearing = self.r_t - self.stiffness[:, None] * self.slip
        size = np.linalg.norm(shearing, axis=1)
        limit = self.stated.problem.friction * pressing
        shrink = np.where(size > limit, limit / np.where(size > limit, size, 1.0), 1.0)
        tangential = np.linalg.norm(self.r_t - shrink[:, None] * shearing, axis=1)
        return np.abs(self.r_n - pressing) + tangential

    def errors(self):
        """Bounds of the errors of displacements (n dim) and nodal forces, to first order.

        Round-off of data moves every equation a little: equilibrium by d(|K||a| + |f|), closed
        gaps by the rounding of coordinates, slips by the error of the increment before; and
        where directions turn the iteration ends before the law is met to the last digit. The
        inverse of the tangent carries that to the solution.
        """
        e, dim = self.stated.elastic, self.stated.elastic.grid.dim
        right = dense(self.stated.reduction.right)
        d, size = terms(self.K) * e.round_off, np.abs(self.K)
        unbalanced = d * (size @ np.abs(self.a.ravel()) + np.abs(self.f.ravel()))
        rounded = 8 * EPS * np.abs(e.x).max() + d * np.abs(self.a).max()
        earlier = self.before.errors()[0] if self.before else np.zeros(len(self.K))

        left = np.zeros(len(self.K))
        violation = np.minimum(self.violation(), 2 * self.tolerance())
        E, C, moving = np.eye(len(self.K)), np.zeros(self.K.shape), self._free()
        for k, node in enumerate(self.node):
            dofs = node * dim + np.arange(dim)
            E[np.ix_(dofs, dofs)], C[np.ix_(dofs, dofs)] = self._law(k)
            left[dofs] = violation[k]
        shift = np.zeros((len(self.K), len(moving)))
        for column, axis in enumerate(moving):
            shift[self.node * dim + axis, column] = 1.0
        A = np.block(
            [
                [right.T @ (E @ self.K + C) @ right, -right.T @ C @ shift],
                [shift.T @ self.K @ right, np.zeros((len(moving),) * 2)],
            ]
        )
        slipped = rounded + earlier
        wrong = np.concatenate(
            [
                right.T @ (np.abs(E) @ unbalanced + np.abs(C) @ slipped + left),
                shift.T @ unbalanced,
            ]
        )
        moved = np.abs(right) @ (np.abs(np.linalg.inv(A)) @ wrong)[: right.shape[1]]
        return moved, size @ moved + unbalanced

    def _free(self):
        """Axes along which the surface is free to move."""
        motions = self.stated.pair.motions
        translation = motions[self.increment].translation if motions else ()
        return [axis for axis, way in enumerate(translation) if way is None]

    def _law(self, k):
        """E and C (dim, dim) of E r + C (a - U) = 0 at a contact node, in its rows."""
        status, normal, c = self.state.pairs[0].status[k], self.normal[k], self.stiffness[k]
        if status == OPEN:
            return np.eye(len(normal)), np.zeros((len(normal),) * 2)
        tangents = null_space(normal[None]).T
        basis = np.vstack([normal, tangents])
        if status == STICK:
            return 0 * basis, c * np.eye(len(normal))
        rows_E, rows_C = [0 * normal], [c * normal]
        s = self.r_t[k] - c * self.slip[k]
        length, mu = np.linalg.norm(s), self.stated.problem.friction
        along = s / length if length else 0 * s  # without friction, perhaps
        turning = mu * self.r_n[k] / length if length else 0.0
        for t in tangents:
            across = turning * (t - along * (along @ t))
            rows_E.append(t - across - mu * (along @ t) * normal)
            rows_C.append(c * across)
        return basis.T @ np.array(rows_E), basis.T @ np.array(rows_C)


def read(stated, states):
    """The increments one after the other."""
    solved = []
    for k, state in enumerate(states):
        solved.append(Solved(stated, k, state, solved[-1] if solved else None))
    return solved

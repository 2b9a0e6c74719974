"""Contact of a rubber body and a rigid circle at large strains and large sliding, in the plane.

A neo-Hookean body in plane strain, stresses over the shear modulus: the first Piola stress

    P = F - F^-T + lambda ln(J) F^-T,    F = I + grad u,    J = det F,

and the nodal forces F_i = int P grad w_i over the undeformed body. They are zero at free nodes. At
the nodes of the surface r_i = F_i is the force of the circle, with centre c, radius R and
translation U. With y = X + u - U, n = (y - c) / |y - c| and t = n turned by 90 degrees,

    g = |y - c| - R,    v = R times the angle from n at the increment's start to n,
    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= mu r_n,  |v| r_t + mu r_n v = 0.

The law as equations, with max(0, x) smoothed to (x + sqrt(x^2 + 4 eps^2)) / 2, so that r_n g is
eps^2 in place of 0 (Chen, Harker, Kanzow and Smale):

    r_n = N,    r_t = - mu N + max(0, r_t - v + mu N) - max(0, r_t - v - mu N),
    N = max(0, r_n - g).

Newton's method follows their solution, first as the circle goes its way at a large eps, then as eps
tends to zero. No node has a status. All derivatives are by complex steps, exact to round-off.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from tests.oracle.elements import tabulated

STEP = 1e-30  # of complex arguments
WAY = np.linspace(0.25, 1.0, 4)  # shares of the circle's way that are followed at SMOOTH[0]
SMOOTH = 10.0 ** -np.arange(2, 14)  # eps
ACCURACY = 1e-12  # of the equations; on the way a tenth of eps
ITERATIONS = 40


class NotFound(Exception):
    """Newton's method came to no end."""


class Rubber:
    """A neo-Hookean body of T6 triangles (c, 6) with straight sides, in Basix's order.

    `lame` is over the shear modulus, and `rule` one of the reference triangle, or with
    piecewise-linear weights of each of the four sub-triangles.
    """

    def __init__(self, nodes, cells, linear_weights, lame, rule) -> None:
        self.nodes, self.cells, self.lame = nodes, cells, lame
        at = tabulated("T6", linear_weights, *rule)
        jacobian = np.einsum("cna,qnb->qcab", nodes[cells], at.slopes)
        inverse = np.linalg.inv(jacobian)
        self.gradients = np.einsum("qnb,qcba->qcna", at.slopes, inverse)
        self.weight_gradients = np.einsum("qnb,qcba->qcna", at.weight_slopes, inverse)
        self.volume = at.measure[:, None] * np.abs(np.linalg.det(jacobian))

    def forces(self, u: np.ndarray) -> np.ndarray:
        """Nodal forces (n, 2) that hold displacements (n, 2)."""
        total = np.zeros_like(u)
        np.add.at(total, self.cells, self._cell_forces(u[self.cells]))
        return total

    def tangent(self, u: np.ndarray) -> sparse.csr_matrix:
        """Their derivative (2 n, 2 n); unknown = 2 node + component."""
        local, entries = u[self.cells], np.empty((len(self.cells), 12, 12))
        for k in range(12):
            ahead = local.astype(complex)
            ahead[:, k // 2, k % 2] += 1j * STEP
            entries[:, :, k] = self._cell_forces(ahead).imag.reshape(-1, 12) / STEP
        dofs = (2 * self.cells[:, :, None] + np.arange(2)).reshape(-1, 12)
        rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        place = (rows.ravel(), columns.ravel())
        return sparse.coo_matrix((entries.ravel(), place), (u.size, u.size)).tocsr()

    def smallest(self, u: np.ndarray) -> float:
        """Least J at the points of the rule."""
        return float(self._strain(u[self.cells])[1].min())

    def _strain(self, local):
        F = np.eye(2) + np.einsum("cna,qcnb->qcab", local, self.gradients)
        return F, F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]

    def _cell_forces(self, local):
        F, J = self._strain(local)
        a, b, c, d = F[..., 0, 0], F[..., 0, 1], F[..., 1, 0], F[..., 1, 1]
        inverse = np.stack([d, -c, -b, a], axis=-1).reshape(F.shape) / J[..., None, None]  # F^-T
        stress = F + (self.lame * np.log(J) - 1)[..., None, None] * inverse
        return np.einsum("qcab,qcnb,qc->cna", stress, self.weight_gradients, self.volume)


@dataclass(frozen=True)
class Circle:
    """A rigid circle outside of a body, at its initial place."""

    centre: tuple[float, float]
    radius: float
    friction: float = 0.0

    def parts(self, y, r, start):
        """r_n, r_t, g and v (m,) of forces r (m, 2) at y (m, 2), first at start (m, 2)."""
        away, before = y - np.array(self.centre), start - np.array(self.centre)
        distance = np.sqrt(np.sum(away**2, axis=1))
        n = away / distance[:, None]
        turned = before[:, 0] * away[:, 1] - before[:, 1] * away[:, 0]
        angle = np.arctan(turned / np.sum(before * away, axis=1))  # below 90 degrees
        r_t = n[:, 0] * r[:, 1] - n[:, 1] * r[:, 0]
        return np.sum(n * r, axis=1), r_t, distance - self.radius, self.radius * angle

    def law(self, y, r, start, eps):
        r_n, r_t, g, v = self.parts(y, r, start)
        pressed = _positive(r_n - g, eps)
        limit, trial = self.friction * pressed, r_t - v
        cut = -limit + _positive(trial + limit, eps) - _positive(trial - limit, eps)
        return np.stack([r_n - pressed, r_t - cut], axis=1)

    def slopes(self, y, r, start, eps):
        """Derivatives of the law (m, 2, 2) by y, and by r."""
        found, both = np.empty((len(y), 2, 4)), np.concatenate([y, r], axis=1)
        for k in range(4):
            ahead = both.astype(complex)
            ahead[:, k] += 1j * STEP
            found[:, :, k] = self.law(ahead[:, :2], ahead[:, 2:], start, eps).imag / STEP
        return found[:, :, :2], found[:, :, 2:]


@dataclass(frozen=True)
class Contact:
    """A body, numbers of the nodes that may meet the circle, and the mask (n, 2) of supports."""

    body: Rubber
    circle: Circle
    touching: np.ndarray
    held: np.ndarray

    def solve(self, translations) -> list[np.ndarray]:
        """Displacements (n, 2) after each translation (2,) of the circle."""
        states, u, U = [], np.zeros_like(self.body.nodes), np.zeros(2)
        for end in translations:
            start, before, U = self._place(u, U), U, np.array(end)
            for share in WAY:
                u = self._newton(u, (1 - share) * before + share * U, start, SMOOTH[0])
            for eps in SMOOTH[1:]:
                u = self._newton(u, U, start, eps)
            states.append(u)
        return states

    def violations(self, history) -> dict[str, float]:
        """Of each condition in the last increment; of forces and lengths over history's largest.

        A history has displacements (n, 2) and translation (2,), from the undeformed body on.
        """
        (first, was), (u, U) = history[-2:]
        force = max(np.abs(self.body.forces(u)).max() for u, _ in history)
        length = max(max(np.abs(u).max(), np.abs(U).max()) for u, U in history)
        force = force or 1.0  # the circle has not yet met the body
        mu, r, start = self.circle.friction, self.body.forces(u), self._place(first, was)
        free = ~self.held
        free[self.touching] = False
        r_n, r_t, g, v = self.circle.parts(self._place(u, U), r[self.touching], start)
        r_n, r_t, g, v = r_n / force, r_t / force, g / length, v / length
        lines = {
            "supports": np.abs(u[self.held]) / length,
            "equilibrium": np.abs(r[free]) / force,
            "penetration": -g,
            "tension": -r_n,
            "complementarity": np.minimum(r_n, g),
            "cone": np.abs(r_t) - mu * r_n,
            "direction": np.minimum(mu * r_n + np.sign(v) * r_t, np.abs(v)),
        }
        return {name: float(max(0.0, line.max())) for name, line in lines.items()}

    def _place(self, u, U):
        """Nodes (m, 2) as the circle sees them."""
        return (self.body.nodes + u)[self.touching] - U

    def _newton(self, u, U, start, eps):
        """Solution of the smoothed equations, from a guess."""
        dofs = 2 * self.touching[:, None] + np.arange(2)
        kept = np.flatnonzero(~self.held.ravel())

        def residual(u):
            if not self.body.smallest(u) > 0:
                return None
            forces = self.body.forces(u)
            forces[self.touching] = self.circle.law(
                self._place(u, U), forces[self.touching], start, eps
            )
            return forces.ravel()[kept]

        found = residual(u)
        for _ in range(ITERATIONS):
            if np.abs(found).max() <= max(0.1 * eps, ACCURACY):
                return u
            K, y, r = self.body.tangent(u), self._place(u, U), self.body.forces(u)[self.touching]
            slopes = self.circle.slopes(y, r, start, eps)
            by_place, by_force = (self._blocks(part, dofs) for part in slopes)
            others = np.ones(u.size)
            others[dofs] = 0.0
            tangent = (sparse.diags(others) + by_force) @ K + by_place
            way = np.zeros(u.size)
            way[kept] = splu(tangent[kept][:, kept].tocsc()).solve(-found)
            u, found = _shortened(u, way.reshape(u.shape), found, residual)
        raise NotFound(f"{np.abs(found).max():.1e} at eps {eps:.0e}")

    def _blocks(self, blocks, dofs):
        """Matrix (2 n, 2 n) of blocks (m, 2, 2) on the diagonal."""
        rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        place, size = (rows.ravel(), columns.ravel()), self.body.nodes.size
        return sparse.coo_matrix((blocks.ravel(), place), (size, size)).tocsr()


def _positive(x, eps):
    """Smoothed max(0, x)."""
    return (x + np.sqrt(x**2 + 4 * eps**2)) / 2


def _shortened(u, way, found, residual):
    """A step, halved until no cell is turned and the equations' norm falls."""
    for part in 0.5 ** np.arange(12):
        ahead = residual(u + part * way)
        if ahead is not None and np.linalg.norm(ahead) <= (1 - 1e-4 * part) * np.linalg.norm(found):
            return u + part * way, ahead
    raise NotFound("no shorter step helps")

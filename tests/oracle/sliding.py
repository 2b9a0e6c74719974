"""Violations of the contact law by two rubber bodies that slide on each other.

Everything is computed in plain loops. Sides are the polylines through their deformed nodes, ordered
so that the outside is on the right. The normal n of a slave node is that of the chord between its
neighbours and points into the body. A point x(s) = (1 - s) a + s b of a facet with ends a and b,
where the normals are n_a and n_b, is projected along n(s) = (1 - s) n_a + s n_b. The part of the
facet that faces a master facet is the interval of s within [0, 1] between the projections of the
master's ends, up to the point where the normals meet. Two facets are paired only if their normals
oppose each other and their midpoints are close: the distance of the midpoints may exceed that of
the nearest master midpoint by at most half the sum of the slave facet's length and the length of
the longest master facet. With w the linear functions of the facets, integrals over this part are

    W_ij = int w_i w_j,    Q_ik = int w_i w_k,    psi = D W^-1 w,    D_i = sum over j of W_ij,

by Gauss' rule of three points. The indices i and j denote nodes of the slave, and k nodes of the
master. With A_j the sum of D_j over the adjacent facets, a slave node's force r_j is distributed to
the master's nodes by P_jk = int psi_j w_k / A_j. The distances S x, the gap g and the
slip v are

    S x = (sum of W_ji x_i - sum of Q_jk x_k) / A_j,    g = n·S x,    v = t·(S_0 x - S x),

where x are the positions of nodes, t is the tangent and S_0 is S at the increment's start. A node
that faced nothing at the start has slipped by v = t·S x - t_0·S x_0 relative to its present
counterpart, with x_0 and t_0 the positions and tangent at the start. With the normal force r_n, the
tangential force r_t and the friction coefficient mu, the law is

    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= mu r_n,  |v| r_t + mu r_n v = 0.
"""

from dataclasses import dataclass

import numpy as np

from tests.oracle.large import NeoHookeanBody, contact_law_violations, cross_product_in_plane

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)


def inward_nodal_normals(polyline):
    """Return the unit normals (n, 2) of a polyline (n, 2) whose outside is on the right."""
    chord = np.empty_like(polyline)
    chord[1:-1] = polyline[2:] - polyline[:-2]
    chord[0], chord[-1] = polyline[1] - polyline[0], polyline[-1] - polyline[-2]
    return np.stack([-chord[:, 1], chord[:, 0]], axis=1) / np.linalg.norm(chord, axis=1)[:, None]


def interval_facing_master_facet(slave_a, slave_b, normal_a, normal_b, master_c, master_d):
    """Return the interval of s in [0, 1] that faces a master facet with ends c and d, or None.

    The point x(s) = (1 - s) a + s b of the slave facet moves from its end a to its end b, where the
    normals are n_a and n_b. At the projection of a master node p, the cross product of (x(s) - p)
    and the normal is zero and increases with s. If it decreases, p lies beyond the point where the
    normals meet, and the facet faces nothing.
    """
    interval = [0.0, 1.0]
    for k, p, sign in ((0, master_d, 1), (1, master_c, -1)):
        f = np.polynomial.Polynomial(
            [
                cross_product_in_plane(slave_a - p, normal_a),
                cross_product_in_plane(slave_b - slave_a, normal_a)
                + cross_product_in_plane(slave_a - p, normal_b - normal_a),
                cross_product_in_plane(slave_b - slave_a, normal_b - normal_a),
            ]
        )
        real = [root.real for root in f.roots() if abs(root.imag) < 1e-12]
        root = min(real, key=lambda s: abs(s - 0.5), default=np.inf)
        if 0 <= root <= 1:
            if f.deriv()(root) <= 0:
                return None
            interval[k] = root
        elif sign * f(0.5) < 0:
            return None
    return interval if interval[0] < interval[1] else None


def mortar_matrices_normals_and_areas(slave_positions, master_positions):
    """Return matrices P (m, k) and S (m, m + k), normals (m, 2) and areas (m,) of two polylines.

    P distributes the slave's forces to the master's nodes, and S gives the distances between both
    sides (see the module). The slave's nodes are (m, 2), the master's are (k, 2).
    """
    m, k, n = len(slave_positions), len(master_positions), inward_nodal_normals(slave_positions)
    D, S, facets = np.zeros(m), np.zeros((m, m + k)), []
    midpoints = (master_positions[1:] + master_positions[:-1]) / 2
    longest = np.linalg.norm(np.diff(master_positions, axis=0), axis=1).max()
    for i in range(m - 1):
        a, b, W, Q = slave_positions[i], slave_positions[i + 1], np.zeros((2, 2)), np.zeros((2, k))
        distances = np.linalg.norm(midpoints - (a + b) / 2, axis=1)
        reach = distances.min() + (np.linalg.norm(b - a) + longest) / 2
        for j in np.flatnonzero(distances <= reach):
            c, d = master_positions[j], master_positions[j + 1]
            outside = -inward_nodal_normals(master_positions[j : j + 2])[0]
            if np.dot(n[i] + n[i + 1], outside) / 2 < 0.01:
                continue
            interval = interval_facing_master_facet(a, b, n[i], n[i + 1], c, d)
            if interval is None:
                continue
            low, high = interval
            for t, weight in zip(GAUSS_POINTS, GAUSS_WEIGHTS, strict=True):
                s = (low + high) / 2 + (high - low) / 2 * t
                x, direction = (1 - s) * a + s * b, (1 - s) * n[i] + s * n[i + 1]
                master_coordinate = cross_product_in_plane(
                    x - c, direction
                ) / cross_product_in_plane(d - c, direction)
                dx = weight * (high - low) / 2 * np.linalg.norm(b - a)
                w = np.array([1 - s, s])
                W += dx * np.outer(w, w)
                Q[:, [j, j + 1]] += dx * np.outer(w, [1 - master_coordinate, master_coordinate])
        if W.sum() > 1e-6 * np.linalg.norm(b - a):
            D[i : i + 2] += W.sum(axis=1)
            S[i : i + 2, i : i + 2] += W
            S[i : i + 2, m:] -= Q
            facets.append((i, np.diag(W.sum(axis=1)) @ np.linalg.solve(W, Q)))
    area, P = np.where(D > 0, D, 1.0), np.zeros((m, k))
    for i, weights in facets:
        P[i : i + 2] += weights
    return P / area[:, None], S / area[:, None], n, D


@dataclass(frozen=True)
class SlidingContact:
    """Two bodies, the ordered nodes of their sides, the mask (n, 2) of supports, and friction."""

    bodies: NeoHookeanBody
    slave: np.ndarray
    master: np.ndarray
    prescribed_mask: np.ndarray
    friction: float

    def largest_violations_in_last_increment(self, history):
        """Return each condition's largest violation in the last increment, by name.

        The history is a list of displacements (n, 2). Forces and lengths are divided by the largest
        ones of the history.
        """
        previous_u, u = history[-2:]
        force = max(np.abs(self.bodies.nodal_forces(u)).max() for u in history)
        force = force if force > 1e-12 else 1.0  # the bodies have not yet met
        length = max(np.abs(u).max() for u in history)
        slave, master = (self._deformed_positions(u, side) for side in (self.slave, self.master))
        P, S, n, area = mortar_matrices_normals_and_areas(slave, master)
        forces, x = self.bodies.nodal_forces(u), np.concatenate([slave, master])
        r = forces[self.slave]
        forces[self.master] += P.T @ r
        t, separation = np.stack([-n[:, 1], n[:, 0]], axis=1), S @ x
        sides = [self._deformed_positions(previous_u, side) for side in (self.slave, self.master)]
        _, S_0, n_0, area_0 = mortar_matrices_normals_and_areas(*sides)
        t_0 = np.stack([-n_0[:, 1], n_0[:, 0]], axis=1)
        slip_of_earlier_pairs = np.sum(t * (S_0 @ x - separation), axis=1)
        slip_of_new_pairs = np.sum(t * separation - t_0 * (S @ np.concatenate(sides)), axis=1)
        v = np.where(area_0 > 0, slip_of_earlier_pairs, slip_of_new_pairs) / length
        g, r_n, r_t = (
            np.sum(axes * vectors, axis=1) for axes, vectors in ((n, separation), (n, r), (t, r))
        )
        faced = area > 0
        forces[self.slave[faced]] = 0.0
        values = (value[faced] for value in (r_n / force, r_t / force, g / length, v))
        violations = {"equilibrium": np.abs(forces[~self.prescribed_mask]) / force}
        violations |= contact_law_violations(*values, self.friction)
        return {name: float(max(0.0, violation.max())) for name, violation in violations.items()}

    def _deformed_positions(self, u, side_nodes):
        """Return the positions (m, 2) of the nodes of a side after displacements u (n, 2)."""
        return (self.bodies.nodes + u)[side_nodes]

"""Contact of a rubber body and a rigid circle at large strains and large sliding, in the plane.

The body is neo-Hookean and in plane strain. Stresses are divided by the shear modulus. The first
Piola stress is

    P = F - F^-T + lambda ln(J) F^-T,    F = I + grad u,    J = det F,

with u the displacement and lambda Lame's constant. The nodal forces F_i = int P grad w_i are
integrals over the undeformed body with the weights w_i. They are zero at free nodes. At the nodes
of the surface, r_i = F_i is the force of the circle, which has the centre c, the radius R and the
translation U. With X the undeformed positions, y = X + u - U, n = (y - c) / |y - c| and t = n
rotated by 90 degrees, gap g, slip v and the law are

    g = |y - c| - R,    v = R times the angle from n at the increment's start to n,
    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= mu r_n,  |v| r_t + mu r_n v = 0,

with mu the friction coefficient. Displacements and translations of a state are inserted into these
conditions. Statuses of nodes are not used.
"""

from dataclasses import dataclass

import numpy as np

from tests.oracle.elements import tabulate_at_points


class NeoHookeanBody:
    """A neo-Hookean body of six-node triangles (c, 6) with straight sides, in Basix's order.

    `lame` is Lame's constant lambda divided by the shear modulus. `rule` has the points and weights
    of a quadrature rule on the reference triangle, which is applied to the whole cell or, with
    piecewise-linear weights, to each of its four sub-triangles.
    """

    def __init__(self, nodes, cells, linear_weights, lame, rule) -> None:
        self.nodes, self.cells, self.lame = nodes, cells, lame
        functions = tabulate_at_points("T6", linear_weights, *rule)
        jacobian = np.einsum("cna,qnb->qcab", nodes[cells], functions.slopes)
        inverse = np.linalg.inv(jacobian)
        self.gradients = np.einsum("qnb,qcba->qcna", functions.slopes, inverse)
        self.weight_gradients = np.einsum("qnb,qcba->qcna", functions.weight_slopes, inverse)
        self.volume = functions.measure[:, None] * np.abs(np.linalg.det(jacobian))

    def nodal_forces(self, u: np.ndarray) -> np.ndarray:
        """Return the nodal forces (n, 2) at displacements u (n, 2)."""
        F = np.eye(2) + np.einsum("cna,qcnb->qcab", u[self.cells], self.gradients)
        a, b, c, d = F[..., 0, 0], F[..., 0, 1], F[..., 1, 0], F[..., 1, 1]
        J = a * d - b * c
        inverse_transpose = np.stack([d, -c, -b, a], axis=-1).reshape(F.shape) / J[..., None, None]
        stress = F + (self.lame * np.log(J) - 1)[..., None, None] * inverse_transpose
        forces = np.zeros_like(u)
        cell_forces = np.einsum("qcab,qcnb,qc->cna", stress, self.weight_gradients, self.volume)
        np.add.at(forces, self.cells, cell_forces)
        return forces


def cross_product_in_plane(a, b):
    """Return the scalar cross product of two vectors in the plane, each (2, ...)."""
    return a[0] * b[1] - a[1] * b[0]


def contact_law_violations(r_n, r_t, g, v, mu):
    """Return, by name, the violation of each condition of the contact law at nodes.

    `r_n` and `r_t` are the normal and tangential force, `g` the gap, `v` the slip, and `mu` the
    friction coefficient.
    """
    return {
        "penetration": -g,
        "tension": -r_n,
        "complementarity": np.minimum(r_n, g),
        "cone": np.abs(r_t) - mu * r_n,
        "direction": np.minimum(mu * r_n + np.sign(v) * r_t, np.abs(v)),
    }


@dataclass(frozen=True)
class RigidCircle:
    """A rigid circle at its initial position outside a body."""

    centre: tuple[float, float]
    radius: float
    friction: float = 0.0


@dataclass(frozen=True)
class CircleContact:
    """A body and a circle, the nodes that may touch it, and the mask (n, 2) of supports."""

    body: NeoHookeanBody
    circle: RigidCircle
    contact_nodes: np.ndarray
    prescribed_mask: np.ndarray

    def largest_violations_in_last_increment(self, history) -> dict[str, float]:
        """Return each condition's largest violation in the last increment, by name.

        The history is a list of pairs of displacements (n, 2) and a translation (2,), and begins
        with the undeformed body. Forces and lengths are divided by the largest ones of the history.
        """
        force = max(np.abs(self.body.nodal_forces(u)).max() for u, _ in history)
        length = max(max(np.abs(u).max(), np.abs(U).max()) for u, U in history)
        force = force or 1.0  # the circle has not yet met the body
        u, circle = history[-1][0], self.circle
        from_centre_before, from_centre = (
            (self.body.nodes + u)[self.contact_nodes] - U - np.array(circle.centre)
            for u, U in history[-2:]
        )
        distance = np.linalg.norm(from_centre, axis=1)
        n, forces = from_centre / distance[:, None], self.body.nodal_forces(u) / force
        angle = np.arctan(
            cross_product_in_plane(from_centre_before.T, from_centre.T)
            / np.sum(from_centre_before * from_centre, axis=1)
        )  # correct below 90 degrees
        gap, slip = (distance - circle.radius) / length, circle.radius * angle / length
        r, free = forces[self.contact_nodes], ~self.prescribed_mask
        free[self.contact_nodes] = False
        values = {
            "supports": np.abs(u[self.prescribed_mask]) / length,
            "equilibrium": np.abs(forces[free]),
        }
        values |= contact_law_violations(
            np.sum(n * r, axis=1), cross_product_in_plane(n.T, r.T), gap, slip, circle.friction
        )
        return {name: float(max(0.0, value.max())) for name, value in values.items()}

"""Violations of the contact law by two rubber bodies in space that slide on each other.

Everything is computed in plain loops. Sides are flat triangles between the deformed nodes. The
normal n of a slave node points into the body, along the sum of the vectors of the areas around it.
The triangles of the master whose normals oppose that of a slave triangle are projected onto its
plane, along its normal. They are cut off at its sides, and the remaining polygons are divided into
triangles, on which a rule of four points integrates cubic functions exactly. Distances are those of
the curved six-node facets to which the triangles belong, at the same weights.

With w the linear functions of the triangles, the integrals W and Q of their products, the areas,
the forces P^T r on the master, the mean distances S x and the gaps g are those of `sliding`, of
which this module is the counterpart in space. The slip of a node that faced the master at the
increment's start, where S was S_0, is the tangential part of (S_0 - S) x. The slip of other nodes
is that of S x - Z R d, with d the tangential part of S x_0 at the start, and R the rotation by the
angle between the normals n_0 and n about their common perpendicular. Z rotates about n by the angle
by which the master's surface has turned more than R. It is the angle that best fits the deformation
gradients of the master's triangles, averaged first around its nodes and then like positions by S.
With the normal force r_n, the tangential force r_t and the friction coefficient mu, the law is

    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= mu r_n,  |v| r_t + mu r_n v = 0.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from tests.oracle.elements import tabulate_at_points


class NeoHookeanBodyInSpace:
    """A neo-Hookean body of ten-node tetrahedra (c, 10) with straight sides, in Basix's order.

    Weights are piecewise linear, and the stress is that of `large`. `lame` is Lame's constant
    lambda divided by the shear modulus. `rule` has the points and weights of a quadrature rule on
    the reference tetrahedron, which is applied to each sub-cell.
    """

    def __init__(self, nodes, cells, lame, rule) -> None:
        self.nodes, self.cells, self.lame = nodes, cells, lame
        functions = tabulate_at_points("T10", True, *rule)
        jacobian = np.einsum("cna,qnb->qcab", nodes[cells], functions.slopes)
        inverse = np.linalg.inv(jacobian)
        self.gradients = np.einsum("qnb,qcba->qcna", functions.slopes, inverse)
        self.weight_gradients = np.einsum("qnb,qcba->qcna", functions.weight_slopes, inverse)
        self.volume = functions.measure[:, None] * np.abs(np.linalg.det(jacobian))

    def nodal_forces(self, u: np.ndarray) -> np.ndarray:
        """Return the nodal forces (n, 3) at displacements u (n, 3)."""
        F = np.eye(3) + np.einsum("cna,qcnb->qcab", u[self.cells], self.gradients)
        inverse_transpose = np.swapaxes(np.linalg.inv(F), -1, -2)
        log_volume = np.log(np.linalg.det(F))
        stress = F + (self.lame * log_volume - 1)[..., None, None] * inverse_transpose
        forces = np.zeros_like(u)
        cell_forces = np.einsum("qcab,qcnb,qc->cna", stress, self.weight_gradients, self.volume)
        np.add.at(forces, self.cells, cell_forces)
        return forces


def unit(vector):
    return vector / np.sqrt(vector @ vector)


def area_vector(polygon):
    """Return the area of a polygon (k, 3) times its normal, around which corners are ordered."""
    origin = polygon[0]
    return sum(
        np.cross(start - origin, end - origin) / 2 for start, end in itertools.pairwise(polygon[1:])
    )


def inward_nodal_normals(x, triangles):
    """Return unit normals (n, 3) of nodes at x (n, 3); triangles are ordered seen from outside."""
    total = np.zeros_like(x)
    for nodes in triangles:
        for node in nodes:
            total[node] -= area_vector(x[nodes])
    return np.array([unit(vector) for vector in total])


def cut_polygon(polygon, origin, inward):
    """Return the corners of the part of a polygon where inward·(x - origin) is positive."""
    remaining = []
    for start, end in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        height, end_height = inward @ (start - origin), inward @ (end - origin)
        if height >= 0:
            remaining.append(start)
        if height * end_height < 0:
            remaining.append(start + height / (height - end_height) * (end - start))
    return remaining


def barycentric_coordinates(point, triangle, normal):
    """Return the coordinates (3,) of a point in a triangle, which are areas along a direction."""
    whole = normal @ area_vector(triangle)
    parts = [
        normal @ area_vector(np.array([point if k == j else triangle[k] for k in range(3)]))
        for j in range(3)
    ]
    return np.array(parts) / whole


def bilinear_functions(point, corners):
    """Return the bilinear functions (4,) of a flat quadrilateral (4, 3) at a point of its plane."""
    a, b, c, d = corners
    u, v = 0.5, 0.5
    for _ in range(30):
        w = np.array([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
        slopes = [(1 - v) * (b - a) + v * (c - d), (1 - u) * (d - a) + u * (c - b)]
        step = np.linalg.lstsq(np.column_stack(slopes), point - w @ corners)[0]
        u, v = u + step[0], v + step[1]
        if np.abs(step).max() < 1e-14:
            break
    return np.array([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])


# barycentric coordinates of the nodes of a facet; and a rule on triangles, with the weights of the
# corners at each point and fractions of the area
FACET_NODES = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]
)
CUBIC_RULE = [([1 / 3, 1 / 3, 1 / 3], -27 / 48)]
CUBIC_RULE += [(np.roll([0.6, 0.2, 0.2], k), 25 / 48) for k in range(3)]
# coordinates of the nodes of a facet with nine nodes; and a rule of products of Gauss rules
SQUARE_FACET_NODES = np.array(
    [[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0], [0, 0.5], [1, 0.5], [0.5, 1], [0.5, 0.5]]
)
GAUSS_RULE = [
    ((1 + t) / 2, w / 2) for t, w in zip(*np.polynomial.legendre.leggauss(9), strict=True)
]
PRODUCT_RULE = [
    (np.array([s, (1 - s) * t, (1 - s) * (1 - t)]), 2 * (1 - s) * w_s * w_t)
    for s, w_s in GAUSS_RULE
    for t, w_t in GAUSS_RULE
]


def quadratic_functions(weights, triangle, facet):
    """Return the functions (6,) or (9,) of a facet's nodes at a point of one of its parts.

    The weights (k,) are those of the corners of the part at the point. The part (k,) and the facet
    are numbers of nodes.
    """
    if len(facet) == 9:
        position = weights @ SQUARE_FACET_NODES[[list(facet).index(node) for node in triangle]]
        along = [
            {0.0: (1 - t) * (1 - 2 * t), 0.5: 4 * t * (1 - t), 1.0: t * (2 * t - 1)}
            for t in position
        ]
        return np.array([along[0][u] * along[1][v] for u, v in SQUARE_FACET_NODES.tolist()])
    b = weights @ FACET_NODES[[list(facet).index(node) for node in triangle]]
    vertices = b * (2 * b - 1)
    return np.append(vertices, 4 * np.array([b[1] * b[2], b[0] * b[2], b[0] * b[1]]))


def integrate_products_over_overlap(x, slave_nodes, master_nodes, facets):
    """Return integrals over the part of a slave triangle or quadrilateral facing a master's.

    The corners of both, (k,) and (l,), are ordered as seen from outside of their bodies. `facets`
    are the nodes of the facets of both. The positions of all nodes are x.

    The results are the integrals W (k, k) and Q (k, l), and those of the slave's linear or bilinear
    functions times the quadratic functions of the slave's facet and of the master's.
    """
    slave, master = x[slave_nodes], x[master_nodes]
    k, n = len(slave), unit(area_vector(slave))
    W, Q = np.zeros((k, k)), np.zeros((k, len(master)))
    curved = [np.zeros((k, len(facet))) for facet in facets]
    rule = CUBIC_RULE if k + len(master) == 6 else PRODUCT_RULE
    if n @ unit(area_vector(master)) > -0.01:
        return W, Q, *curved
    flat_slave, flat_master = (
        np.array([point - (n @ (point - slave[0])) * n for point in side])
        for side in (slave, master)
    )
    polygon = list(flat_master[::-1])
    for j in range(k):
        edge = flat_slave[(j + 1) % k] - flat_slave[j]
        polygon = cut_polygon(polygon, flat_slave[j], np.cross(n, edge))
    for second, third in itertools.pairwise(polygon[1:]):
        corners = np.array([polygon[0], second, third])
        area = n @ area_vector(corners)
        for fractions, factor in rule:
            point = fractions @ corners
            w, w_master = (
                barycentric_coordinates(point, side, n)
                if len(side) == 3
                else bilinear_functions(point, side)
                for side in (flat_slave, flat_master)
            )
            W += factor * area * np.outer(w, w)
            Q += factor * area * np.outer(w, w_master)
            for i, pair in enumerate(((w, slave_nodes), (w_master, master_nodes))):
                curved[i] += factor * area * np.outer(w, quadratic_functions(*pair, facets[i]))
    return W, Q, *curved


def mortar_matrices_normals_and_areas(x, slave_side, master_side, m):
    """Return matrices P (m, k) and S (m, m + k), normals (m, 3) and areas (m,) of two sides.

    P distributes the slave's forces to the master's nodes, and S gives the distances between both
    sides (see the module). The slave's m nodes come first in the positions x (m + k, 3). A side is
    a pair: the corners (f, k) of triangles or quadrilaterals, and the nodes of the facet of each.
    """
    slave_triangles = slave_side[0]
    D, S, P = np.zeros(m), np.zeros((m, len(x))), np.zeros((m, len(x) - m))
    for slave, slave_facet in zip(*slave_side, strict=True):
        k = len(slave)
        W, Q, distance = np.zeros((k, k)), np.zeros((k, len(x))), np.zeros((k, len(x)))
        for master, master_facet in zip(*master_side, strict=True):
            part_W, part_Q, own, other = integrate_products_over_overlap(
                x, slave, master, (slave_facet, master_facet)
            )
            W += part_W
            Q[:, master] += part_Q
            distance[:, slave_facet] += own
            distance[:, master_facet] -= other
        if W.sum() > 1e-6 * np.linalg.norm(area_vector(x[slave])):
            D[slave] += W.sum(axis=1)
            S[slave] += distance
            P[slave] += np.diag(W.sum(axis=1)) @ np.linalg.solve(W, Q[:, m:])
    area = np.where(D > 0, D, 1.0)[:, None]
    return P / area, S / area, inward_nodal_normals(x[:m], slave_triangles), D


def rotate_between_directions(start, end, vector):
    """Return a vector after the rotation about start x end that turns the first into the second."""
    axis, cosine = np.cross(start, end), start @ end
    return (
        cosine * vector + np.cross(axis, vector) + (axis @ vector) / (1 + cosine) * axis
    )  # Rodrigues' formula


def nodal_surface_gradients(x_0, x, triangles):
    """Return the mean gradients (n, 3, 3) of the triangles around each node, weighted with areas.

    They turn vectors in the plane of a triangle at positions x_0 into those at positions x.
    """
    total, area = np.zeros((len(x), 3, 3)), np.zeros(len(x))
    for nodes in triangles:
        a = area_vector(x_0[nodes])
        size = np.sqrt(a @ a)
        frame, frame_0 = (
            np.column_stack([y[nodes[1]] - y[nodes[0]], y[nodes[2]] - y[nodes[0]], normal])
            for y, normal in ((x, np.zeros(3)), (x_0, a))
        )
        for node in nodes:
            total[node] += size * frame @ np.linalg.inv(frame_0)
            area[node] += size
    return total / np.where(area > 0, area, 1.0)[:, None, None]


def rotate_about_normal_with_surface(F, n_0, n, vector):
    """Return a vector perpendicular to n after the rotation Z of a gradient F (see the module)."""
    start_tangent = unit(np.cross(n_0, np.eye(3)[np.argmin(np.abs(n_0))]))
    cosine, sine = 0.0, 0.0
    for t_0 in (start_tangent, np.cross(n_0, start_tangent)):
        t = rotate_between_directions(n_0, n, t_0)
        cosine += t @ F @ t_0
        sine += n @ np.cross(t, F @ t_0)
    angle = np.arctan2(sine, cosine)
    return np.cos(angle) * vector + np.sin(angle) * np.cross(n, vector)


@dataclass(frozen=True)
class SlidingContactInSpace:
    """Two bodies, the triangles and facets of both sides, the mask of supports, and friction.

    The triangles (f, 3) and (e, 3) are numbers of the bodies' nodes, anticlockwise seen from
    outside, and the facets (f, 6) and (e, 6) those of the facet of each triangle. The mask of
    prescribed components is (n, 3).
    """

    bodies: NeoHookeanBodyInSpace
    slave_triangles: np.ndarray
    master_triangles: np.ndarray
    slave_facets: np.ndarray
    master_facets: np.ndarray
    prescribed_mask: np.ndarray
    friction: float

    def largest_violations_in_last_increment(self, history):
        """Return each condition's largest violation in the last increment, by name.

        The history is a list of displacements (n, 3). Forces and lengths are divided by the largest
        ones of the history.
        """
        start_u, u = history[-2:]
        force = max(np.abs(self.bodies.nodal_forces(u)).max() for u in history)
        force = force if force > 1e-12 else 1.0  # the bodies have not yet met
        length = max(np.abs(u).max() for u in history)
        slave, master = np.unique(self.slave_triangles), np.unique(self.master_triangles)
        sides, m = np.concatenate([slave, master]), len(slave)
        triangles = (
            [np.searchsorted(slave, part) for part in (self.slave_triangles, self.slave_facets)],
            [
                m + np.searchsorted(master, part)
                for part in (self.master_triangles, self.master_facets)
            ],
        )
        x_0, x = ((self.bodies.nodes + v)[sides] for v in (start_u, u))
        _, S_0, n_0, area_0 = mortar_matrices_normals_and_areas(x_0, *triangles, m)
        P, S, n, area = mortar_matrices_normals_and_areas(x, *triangles, m)
        gradients = nodal_surface_gradients(x_0, x, triangles[1][0])
        forces = self.bodies.nodal_forces(u)
        r = forces[slave]
        forces[master] += P.T @ r
        violations = {name: [0.0] for name in ("penetration", "tension", "complementarity")}
        violations |= {"cone": [0.0], "direction": [0.0]}
        for j in np.flatnonzero(area > 0):
            distance = S[j] @ x
            if area_0[j] > 0:
                v = S_0[j] @ x - distance
            else:
                d = S[j] @ x_0
                d = rotate_between_directions(n_0[j], n[j], d - (n_0[j] @ d) * n_0[j])
                F = -np.einsum("k,kab->ab", S[j], gradients)
                v = distance - rotate_about_normal_with_surface(F, n_0[j], n[j], d)
            v = (v - (n[j] @ v) * n[j]) / length
            r_n, g = n[j] @ r[j] / force, n[j] @ distance / length
            r_t, slip = r[j] / force - r_n * n[j], np.sqrt(v @ v)
            opposes = r_t + self.friction * r_n * v / slip if slip > 0 else np.zeros(3)
            violations["penetration"].append(-g)
            violations["tension"].append(-r_n)
            violations["complementarity"].append(min(r_n, g))
            violations["cone"].append(np.sqrt(r_t @ r_t) - self.friction * r_n)
            violations["direction"].append(min(np.sqrt(opposes @ opposes), slip))
            forces[slave[j]] = 0.0
        violations["equilibrium"] = np.abs(forces[~self.prescribed_mask]) / force
        return {name: float(np.max(values)) for name, values in violations.items()}

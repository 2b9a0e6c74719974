"""Mortar interfaces: two deformable bodies whose meshes need not match.

Body 1 (slave) and body 2 (master) are parts of one mesh. With w the piecewise-linear weights of
both, N the quadratic trial functions, and psi the duals of the slave's weights,

    integral of psi_j w_i over the slave's face = delta_ij A_j,     A_j = integral of w_j,

body 2 acts on body 1 by the traction t = sum t_j psi_j, and body 1 on body 2 by -t at the place
across. Tested with the weights v of both bodies these tractions do the work

    integral of t·(v_1 - v_2) = sum over j of t_j·(A_j v_1j - sum over k of M_jk v_2k),

M_jk = integral of psi_j w_k. So r_j = A_j t_j, a force, is all that slave node j gets, and the
master's nodes k get - M_jk r_j / A_j. Pressure p_j = n_j·t_j and gap have the same normal, which is
the slave's averaged one turned inwards: n_j points out of the master, p_j presses the slave along
it, and the mean gap

    g_j = integral of w_j n_j·(x_1 + u_1 - x_2 - u_2) / A_j

is positive where the bodies are apart. The multiplier p_j is a pressure and the integral a length
times an area; the law is stated node by node on p_j A_j and g_j, which have the scales of nodal
forces and gaps, as A_j is the node's own area. H has the unit in a point's own equation, as for
matching nodes; it is not G^T, for tractions are weighted with duals and gaps with weights.

What is exact: H hands on the force, for sum w_k = 1, and the moment of a closed gap, for the
weights reproduce positions on straight sub-facets; across a gap g friction t leaves a moment g t.
An even pressure arrives as it is, whatever the meshes, since sum psi_j = 1. Gaps are weighted
with w and not psi, for w is not negative. On every sub-facet the duals are D M^-1 w, with M the
matrix of the weights over the part of the sub-facet that faces the master and D its row sums: so
all of this holds where a facet is covered in part, too, and p_j is the pressure of that part.
Integrals have the measure of the form, 2 pi r ds in axisymmetry, and are exact for polynomials on
flat faces; of curved ones sub-facets are cut along their chords, between nodes, while positions
and displacements are the quadratic functions: measures, and so pressures, are of second order, on
cylinders and spheres alike. Gaps that meshes of one curved surface leave are as large as the
elements' own errors on coarse meshes: so `DeformableSurface.coincident`.

What is not: psi is negative in places, so that the master's nodal forces need not have one sign
where neighbouring p_j differ by more than a factor of two, next to the edge of contact above all,
and the more the coarser the slave is. Small sliding: who faces whom, and along which averaged
normal of the slave, is settled on the undeformed bodies. Where next to nothing of a sub-facet is
covered, a node's force is right, but not its quotient by the area.

The duals of straight sub-edges and flat sub-triangles that are covered all are 3 w - 1 and
4 w - 1 (B. Wohlmuth, https://doi.org/10.1137/S0036142999350929).
"""

import logging
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.checks import listed
from pw_elements.contact.interface.geometry import (
    Segments,
    Trace,
    facets_of,
    gathered_trace,
    segments,
    sizes,
    stretches,
)
from pw_elements.contact.interface.nodes import BodyNodes
from pw_elements.contact.interface.operators import DEFORMABLE, Points
from pw_elements.contact.model import Cone, ContactPair, DeformableSurface
from pw_elements.elasticity import by_position
from pw_elements.spaces import Assembled, exterior_facets, is_hybrid

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

_SIMPLEX = {2: basix.CellType.interval, 3: basix.CellType.triangle}
# Sub-facets of so many corners
_CELLS = {**_SIMPLEX, 4: basix.CellType.quadrilateral}
# Of products of weights, quadratic functions and, in axisymmetry, the radius, on sub-facets of so
# many corners; and where quadrilaterals are no parallelograms, so that nothing is a polynomial
_DEGREE = {2: 4, 3: 4, 4: 6}
_TWISTED_DEGREE = 10
# Difference of opposite sides of parallelograms, over their size
_PARALLEL = 1e-9

# Cosine up to which a normal is turned into a symmetry plane
_NEARLY = 0.9
# Gap of sides that coincide, over the slave's mean sub-facet: that of an octant of a sphere is 0.01
# with two quadratic facets a side
_COINCIDE = 0.05
# Mean edge of the slave over the master's, both where they face each other, that is much
_COARSE = 3.0

_logger = logging.getLogger("pw_elements.contact")


@dataclass(frozen=True)
class Overlap:
    """Quadrature points (q) of what the slave's sub-facets at own points have of the master.

    Args:
        point: (q, k), numbers of the points that the sub-facet's corners are, -1 for others'.
        weight: (q, k), their weights.
        dual: (q, k), the duals of these.
        measure: (q,), lengths or areas.
        size: (q,), of the slave's sub-facet.
        ratio: (q,), size of the slave's sub-facet over the master's.
        apart: (q, dim), from the master to the slave.
        functions: nodes (q, n) and values (q, n) of the slave's and the master's quadratic
            functions, and of the master's weights.
    """

    point: Indices
    weight: Array
    dual: Array
    measure: Array
    size: Array
    ratio: Array
    apart: Array
    functions: tuple[tuple[Indices, Array], ...]

    @classmethod
    def of(cls, one: Trace, other: Trace, own: Indices, revolved: bool) -> "Overlap":
        """Makes the overlap of both traces, for points of global numbers `own` (m,)."""
        (nodes, corners, _), (their_nodes, their_corners, outward) = one.parts, other.parts
        found, mine = overlaps(one, other, own, outward)
        order = np.argsort(own)
        place = np.searchsorted(own, nodes, sorter=order)
        point = order[np.minimum(place, len(own) - 1)] if len(own) else np.zeros_like(nodes)
        point = np.where(np.isin(nodes, own), point, -1)
        degree = _DEGREE[corners.shape[1]]
        if _twisted(found.on_slave) or _twisted(found.on_master):
            degree = _TWISTED_DEGREE
        points, weights = basix.make_quadrature(_SIMPLEX[one.dim], degree)
        rule = np.column_stack([1 - points.sum(axis=1), points])
        weights = weights / weights.sum()
        slave, master = (np.repeat(k, len(weights)) for k in (mine[found.slave], found.master))
        w1, w2 = (w.reshape(len(slave), w.shape[2]) for w in found.weights(rule))
        seen = np.repeat(found.on_slave, len(weights), axis=0)
        stretch = stretches(corners[slave], w1) / stretches(seen, w1)
        size, theirs = sizes(corners)[slave], sizes(their_corners)[master]
        measure = stretch * np.outer(found.size, weights).ravel()
        (at1, N1), (at2, N2) = one.functions(slave, w1), other.functions(master, w2)
        x1, x2 = one.positions(slave, N1), other.positions(master, N2)
        if revolved:
            measure = measure * 2 * np.pi * x1[:, 0]
        dual = _duals(slave, w1, measure)
        functions = ((at1, N1), (at2, N2), (their_nodes[master], w2))
        return cls(point[slave], w1, dual, measure, size, size / theirs, x1 - x2, functions)

    def edge(self, comm: MPI.Comm) -> float:
        """Mean length of the slave's sub-facets, or root of their areas, of all processes."""
        lengths = self.size ** (1 / (self.apart.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ lengths, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def coarseness(self, comm: MPI.Comm) -> float:
        """Mean of the slave's edges over the master's, of all processes."""
        edges = self.ratio ** (1 / (self.apart.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ edges, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def per_point(self, values: Array, m: int) -> Array:
        """Integrals (m,) of weights times values (q,)."""
        part = (self.weight * (self.measure * values)[:, None])[self.point >= 0]
        return np.asarray(np.bincount(self.point[self.point >= 0], part, minlength=m), dtype=float)

    def integrals(
        self, tested: Array, column: Indices, values: Array, shape: tuple[int, int]
    ) -> sp.csr_array:
        """Matrix of integrals of functions `tested` (q, k) of the points times others (q, n)."""
        part = np.einsum("q,qa,qk->qak", self.measure, tested, values)
        row = np.broadcast_to(self.point[:, :, None], part.shape)
        known = row >= 0
        place = (row[known], np.broadcast_to(column[:, None], part.shape)[known])
        return sp.csr_array(sp.coo_array((part[known], place), shape))


def overlaps(one: Trace, other: Trace, own: Indices, outward: Array) -> tuple[Segments, Indices]:
    """What the slave's sub-facets at own points (m,) have of the master.

    Args:
        one: the slave.
        other: the master.
        own: numbers of nodes.
        outward: (s, dim), normals of the master's sub-facets.

    Returns:
        Overlaps, and numbers of the slave's sub-facets which those of `Segments.slave` count.
    """
    nodes, corners, _ = one.parts
    mine = np.flatnonzero(np.isin(nodes, own).any(axis=1))
    normal = one.normals(nodes[mine]).mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return segments(corners[mine], other.parts[1], normal, outward), mine


def whole_areas(trace: Trace, revolved: bool) -> Array:
    """Integrals (n,) of the weights of a trace's nodes over all of it, seen as an overlap's are."""
    nodes, corners, _ = trace.parts
    k = corners.shape[1]
    points, rule = basix.make_quadrature(_CELLS[k], _DEGREE[k])
    hats = basix.create_element(basix.ElementFamily.P, _CELLS[k], 1).tabulate(0, points)[0, :, :, 0]
    part, w = np.repeat(np.arange(len(corners)), len(rule)), np.tile(hats, (len(corners), 1))
    measure = stretches(corners[part], w) * np.tile(rule, len(corners))
    if revolved:
        _, N = trace.functions(part, w)
        measure = measure * 2 * np.pi * trace.positions(part, N)[:, 0]
    place = np.searchsorted(trace.nodes, nodes[part])
    return np.asarray(np.bincount(place.ravel(), (w * measure[:, None]).ravel()), dtype=float)


def _twisted(corners: Array) -> bool:
    """Whether any cells (q, k, d) are quadrilaterals, but no parallelograms."""
    if corners.shape[1] < 4:
        return False
    apart = corners[:, 3] - corners[:, 2] - corners[:, 1] + corners[:, 0]
    return bool(np.abs(apart).max(initial=0.0) > _PARALLEL)


def _duals(part: Indices, weight: Array, measure: Array) -> Array:
    """D M^-1 w, (q, k), at quadrature points of sub-facets (q,)."""
    if not len(part):
        return weight
    parts, of = np.unique(part, return_inverse=True)
    n = weight.shape[1]
    M = np.zeros((len(parts), n, n))
    np.add.at(M, of, np.einsum("q,qa,qb->qab", measure, weight, weight))
    D = M.sum(axis=2)
    inverse = np.linalg.inv(M)
    return np.asarray(np.einsum("qa,qab,qb->qa", D[of], inverse[of], weight))


@dataclass(frozen=True)
class InitialGap:
    """The gap (m,) at a mortar's own points, which change with the master's rigid motion alone."""

    position: Array
    initial: Array
    direction: Array

    def gap(self, x: Array) -> Array:
        """Gap (m,) of the points (m, dim), as they were or shifted all alike."""
        return self.initial + np.sum(self.direction * (x - self.position), axis=1)

    def normal(self, x: Array) -> Array:  # noqa: ARG002
        """Averaged normals (m, dim), out of the master, wherever the points are."""
        return self.direction


def check_weights(K: PETSc.Mat, space: fem.FunctionSpace) -> None:
    """Raises ValueError for a stiffness (n, n) that is known to be tested with other weights.

    They are told by their values a quarter along an edge, where quadratic ones are down to -1/8.
    """
    assembled = Assembled.of(K)
    if (test := assembled.weights) is None:
        return
    element = (test.sub([0]) if is_hybrid(space) else test).element.basix_element
    quarter = np.eye(1, space.mesh.topology.dim) / 4
    if assembled.sibling is not None or element.tabulate(0, quarter).min() < -0.1:
        raise ValueError(
            "a deformable surface hands on forces of piecewise-linear weights, with which the "
            "stiffness is not made: take Spaces.petrov_galerkin or Spaces.hybrid"
        )


def mortar_points(
    number: int,
    pair: ContactPair,
    node: npt.NDArray[np.int32],
    cone: Cone,
    body: BodyNodes,
    revolved: bool,
    depth: Array | None,
) -> tuple[Points, InitialGap]:
    """Points at the owned nodes of a pair whose opposite is another part of the boundary.

    Points that face nothing have an infinite gap.

    Args:
        number: of the pair, for messages.
        pair: against a `DeformableSurface`.
        node: (m,), owned nodes of the pair.
        cone: of friction.
        body: whose nodes they are.
        revolved: whether areas are those of a circumference.
        depth: (m,), nominal interference of sides that coincide; None of others.

    Raises:
        ValueError: if the pair's surface has an edge, a node belongs to no facet whose nodes are
            all in the pair, the opposite part has no facets, both parts share a node, no part of
            the pair's facets faces the opposite part, friction at supports would be lost, or
            sides that are to coincide do not.
    """
    space, comm, master = body.space, body.space.mesh.comm, pair.surface
    assert isinstance(master, DeformableSurface)
    own = node + np.int64(space.dofmap.index_map.local_range[0])
    one = gathered_trace(space, facets_of(space, node))
    other = gathered_trace(space, exterior_facets(space.mesh, master.where))
    if not len(other.node):
        raise ValueError(
            f"contact pair {number} has no opposite facets: their marker holds nowhere"
        )
    body.refuse(node[~np.isin(own, one.node)], "belong to no facet that is all in their pair")
    body.refuse(node[np.isin(own, other.node)], "belong to both sides of their pair")
    if len(places := one.edges()):
        raise ValueError(
            f"contact pair {number} has an edge at {listed(places)}, where its normal would belong "
            "to neither side: state each side as a pair of its own, one with the nodes of the edge"
        )
    overlap = Overlap.of(one, other, own, revolved)
    if comm.allreduce(len(overlap.measure), MPI.SUM) == 0:
        behind = overlaps(one, other, own, -other.parts[2])[0]
        raise ValueError(
            f"contact pair {number}: no part of its facets faces the opposite part, "
            + (
                "which looks the same way: one of both is on the far side of its body"
                if comm.allreduce(len(behind.share), MPI.SUM)
                else "nothing of which lies across from them: they do not overlap"
            )
        )
    coarseness = overlap.coarseness(comm)
    if comm.rank == 0 and coarseness > _COARSE:
        _logger.warning(
            "contact pair %d: its facets are %.1f times as large as those they face; let the finer "
            "mesh be the pair's, or the opposite body's forces may have either sign",
            number,
            coarseness,
        )
    m, dim = len(node), body.x.shape[1]
    nodes = body.field.sizes[1] // dim
    area = overlap.per_point(np.ones(len(overlap.measure)), m)
    faced = area > 0
    scale = sp.diags_array(1 / np.where(faced, area, 1.0))
    unit = sp.csr_array((np.ones(m), (np.arange(m), own)), (m, nodes))
    alone = sp.diags_array(np.where(faced, 0.0, 1.0)) @ unit
    (at1, N1), (at2, N2), (at3, w2) = overlap.functions
    motion = overlap.integrals(overlap.weight, at1, N1, (m, nodes))
    motion -= overlap.integrals(overlap.weight, at2, N2, (m, nodes))
    force = unit - scale @ overlap.integrals(overlap.dual, at3, w2, (m, nodes))
    meets = overlap.integrals(overlap.weight, at3, w2, (m, nodes))[:, other.nodes] > 0
    lone = (body.column[node] == -1) & ~(meets @ _prescribed(other.nodes, body))
    body.refuse(
        node[faced & cone.rough & lone.any(axis=1)],
        "have a prescribed displacement that none of the nodes which they face has, so that these "
        "would get no friction: exchange both sides",
    )
    into = -one.normals(own)
    into = _in_symmetry_planes(into, body.column[node] >= 0)
    apart = np.stack([overlap.per_point(x, m) for x in overlap.apart.T], axis=1)
    gap = np.where(faced, np.sum(into * apart, axis=1) * scale.diagonal(), np.inf)
    if depth is not None:
        edge = overlap.edge(comm)
        body.refuse(
            node[faced & (np.abs(gap) > _COINCIDE * edge)],
            "lie away from the opposite side, farther than meshes of one surface do (coincident)",
        )
        gap = np.where(faced, -depth, np.inf)
    noise = np.zeros(m)
    if depth is None and pair.interference:
        across = np.einsum("qi,qk->ikq", overlap.apart, overlap.apart)
        square = np.array([[overlap.per_point(x, m) for x in row] for row in across])
        square = np.einsum("mi,ikm,mk->m", into, square, into) * scale.diagonal()
        noise = np.sqrt(np.where(faced, square - gap**2, 0.0).clip(0))
    axes = sp.eye_array(dim)
    at = other.positions_of_nodes()
    points = Points(
        body.x[node],
        cone,
        body.column[node],
        sp.csr_matrix(sp.kron(scale @ motion + alone, axes)),
        sp.csr_matrix(sp.kron(force, axes)),
        body.beside[node],
        body.outward[node],
        own,
        np.full_like(own, DEFORMABLE),
        noise,
        other.nodes[by_position(at)],
    )
    return points, InitialGap(body.x[node], gap, into)


def _prescribed(node: Indices, body: BodyNodes) -> npt.NDArray[np.bool_]:
    """Which displacements (n, dim) of global nodes are, of whichever process."""
    first, last = body.space.dofmap.index_map.local_range
    mine = (node >= first) & (node < last)
    held = np.zeros((len(node), body.x.shape[1]), dtype=np.int8)
    held[mine] = body.column[node[mine] - first] == -1
    body.space.mesh.comm.Allreduce(MPI.IN_PLACE, held, MPI.MAX)
    return held > 0


def _in_symmetry_planes(normal: Array, free: npt.NDArray[np.bool_]) -> Array:
    """Normals (n, dim) without components that are prescribed, if these are small.

    On a symmetry plane the facets of one side alone are averaged.
    """
    inside = np.where(free, normal, 0.0)
    length = np.linalg.norm(inside, axis=1, keepdims=True)
    near = length > _NEARLY
    return np.asarray(np.where(near, inside / np.where(near, length, 1.0), normal))

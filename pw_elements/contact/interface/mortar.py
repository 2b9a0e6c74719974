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

from dataclasses import dataclass

from mpi4py import MPI

import basix
import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices
from pw_elements.contact.interface.geometry import Trace, segments, sizes, stretches

_SIMPLEX = {2: basix.CellType.interval, 3: basix.CellType.triangle}
# Sub-facets of so many corners
_CELLS = {**_SIMPLEX, 4: basix.CellType.quadrilateral}
# Of products of weights, quadratic functions and, in axisymmetry, the radius, on sub-facets of so
# many corners; and where quadrilaterals are no parallelograms, so that nothing is a polynomial
_DEGREE = {2: 4, 3: 4, 4: 6}
_TWISTED_DEGREE = 10
# Difference of opposite sides of parallelograms, over their size
_PARALLEL = 1e-9


@dataclass(frozen=True)
class Overlap:
    """Quadrature points (q) of what the slave's sub-facets at own points have of the master."""

    point: Indices  # (q, k), of the sub-facet's corners, -1 for those of other processes
    weight: Array  # (q, k)
    dual: Array  # (q, k)
    measure: Array  # (q,), lengths or areas
    size: Array  # (q,), of the slave's sub-facet
    ratio: Array  # (q,), size of the slave's sub-facet over the master's
    apart: Array  # (q, dim), from the master to the slave
    # nodes (q, n) and values (q, n) of both quadratic functions, and of the master's weights
    functions: tuple[tuple[Indices, Array], ...]

    @classmethod
    def of(cls, one: Trace, other: Trace, own: Indices, revolved: bool) -> "Overlap":
        """Makes the overlap of both traces, for points of global numbers `own` (m,)."""
        (nodes, corners, _), (their_nodes, their_corners, outward) = one.parts, other.parts
        mine = np.flatnonzero(np.isin(nodes, own).any(axis=1))
        along = one.normals(nodes[mine]).mean(axis=1)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        found = segments(corners[mine], their_corners, along, outward)
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

    def mean_edge(self, size: Array, comm: MPI.Comm) -> float:
        """Mean of lengths, or of roots of areas, (q,), of all processes."""
        edges = size ** (1 / (self.apart.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ edges, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def per_point(self, values: Array, m: int) -> Array:
        """Integrals (m,) of weights times values (q,), or (q, k) for each of the corners."""
        values = values.reshape(len(values), -1)
        part = (self.weight * (self.measure[:, None] * values))[self.point >= 0]
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

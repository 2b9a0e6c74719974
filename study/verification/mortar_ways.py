"""Ways to state contact of two deformable bodies on meshes that do not match.

The new one is the library's, whose gaps are weighted with the test functions. `pw-dual-gap` has
the same test functions and multipliers, but gaps weighted with these, the duals: what a mean gap
over positive functions costs at the edge of contact is the difference of both. The others, for
comparison, have the standard test functions. All but the library's are without friction:
multipliers on the slave's face, its standard functions (`p2-p2`), its linear ones
(`p2-p1`) or the duals of the quadratic ones (`p2-dual`; in space those of the transformed basis
of A. Popp, B. Wohlmuth, M. Gee and W. Wall, https://doi.org/10.1137/110848190), or nodes of the
slave that meet the master's face (`node-to-segment`). Their gap has the weights that the
multipliers' functions are, so that the standard ones are symmetric saddle points; active sets by
Newton.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
)
from pw_elements.contact import ContactPair, DeformableSurface, Motion, solve_contact
from pw_elements.contact.interface import Overlap, Trace, gather_trace
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.spaces import Part

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# With piecewise-linear test functions
NEW = ("pw-dual", "pw-dual-gap")
# Of quadrature in space, where cells are straight but for 1e-3: the degree that the library takes
# for curved ones changes the ninth digit of pressures, and takes half of all time
_DEGREE = 3
# Linear systems of the comparison ways' iteration, which may cycle
_MOST = 40
# What a mid-side function keeps in the transformed basis, and gives to either vertex
_KEPT, _GIVEN = 3 / 4, 1 / 8
# Barycentric coordinates that are on a triangle but for round-off
_ON = -1e-9


@dataclass(frozen=True)
class TwoBodies:
    """Two bodies, parts of one mesh, and where they may touch.

    Args:
        way: see `study.model.vocabulary.WAYS`.
        body: with the test functions of the way.
        K: free stiffness.
        slave: facets, local numbers.
        master: facets.
    """

    way: str
    body: Body
    K: PETSc.Mat
    slave: npt.NDArray[np.int32]
    master: npt.NDArray[np.int32]

    @classmethod
    def of(
        cls,
        way: str,
        mesh: Mesh,
        of_lower: npt.NDArray[np.bool_],
        moduli: tuple[float, float],
        poissons_ratio: float,
        state: StressState,
        sides: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
    ) -> "TwoBodies":
        """Assembles them; `moduli` are the lower and the upper body's, `sides` slave and master."""
        E = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        E.x.array[:] = np.where(of_lower, *moduli)
        spaces = Spaces.petrov_galerkin(mesh) if way in NEW else Spaces.galerkin(mesh)
        degree = _DEGREE if state is StressState.SOLID else None
        body = Body(spaces, Material(E, poissons_ratio), state, quadrature_degree=degree)
        return cls(way, body, assemble_matrix(body.stiffness()), *sides)

    @property
    def space(self) -> fem.FunctionSpace:
        """Of the displacements."""
        return self.body.spaces.trial

    @property
    def x(self) -> Array:
        """Positions (nodes, dim)."""
        return np.asarray(self.space.tabulate_dof_coordinates()[:, : self.space.mesh.geometry.dim])

    def load(self, traction: Array | Sequence[float], where: Part) -> PETSc.Vec:
        """Load vector of a traction on a part of the boundary."""
        surface = boundary_measure(self.space.mesh, where)
        return assemble_vector(self.body.surface_load(np.asarray(traction, dtype=float), surface))

    def solve(
        self,
        loads: PETSc.Vec | list[PETSc.Vec],
        conditions: list[fem.DirichletBC],
        friction: float = 0.0,
        motions: Sequence[Motion] = (),
    ) -> "Solution":
        """Contact of both; friction, several loads and motions for the new way only."""
        reduction = Reduction.dirichlet(self.space, conditions)
        if self.way == "pw-dual":
            nodes = fem.locate_dofs_topological(
                self.space, self.space.mesh.topology.dim - 1, self.slave
            )
            pair = ContactPair(nodes, DeformableSurface(self.master), friction, motions)
            states = solve_contact(self.K, loads, reduction, [pair], self.space)
            return self._of_library(states)
        assert isinstance(loads, PETSc.Vec)
        return _saddle_point(self, loads, conditions)

    def _of_library(self, states: list[ContactState]) -> "Solution":
        (pair,) = states[-1].pairs
        surface = SurfaceNodes.from_body(self.body, self.slave)
        one, other = (gather_trace(self.space, side) for side in (self.slave, self.master))
        overlap = Overlap.from_traces(one, other, pair.node, revolved=False)
        covered = overlap.integrate_per_point(np.ones(len(overlap.measure)), len(pair.node))
        force = np.zeros_like(self.x)
        force[pair.node] = pair.force_vector
        force[pair.opposite_node] = pair.opposite_force
        return Solution(
            pair.node,
            np.where(covered > 0, pair.force_normal / np.where(covered > 0, covered, 1.0), np.nan),
            surface.tributary_area,
            force,
            pair.opposite_node,
            states[-1].displacement.array_r.reshape(self.x.shape),
            max(state.iterations for state in states),
            True,
            states,
        )


@dataclass(frozen=True)
class Solution:
    """What a way finds.

    Args:
        node: (m,), of the slave's face, in the order of positions.
        pressure: (m,), NaN where the way has none.
        area: (m,), tributary.
        force: (nodes, dim), contact forces on both bodies.
        opposite: (k,), nodes of the master's face.
        displacement: (nodes, dim).
        iterations: linear systems; the most of an increment.
        settled: whether the iteration has come to an end.
        states: of the library.
    """

    node: Indices
    pressure: Array
    area: Array
    force: Array
    opposite: Indices
    displacement: Array
    iterations: int
    settled: bool
    states: list[ContactState]

    def balances(self, x: Array) -> dict[str, float]:
        """Sum of the contact forces on both bodies, and their moments, over the magnitudes'."""
        size = np.abs(self.force).sum()
        moments = np.cross(x, self.force) if x.shape[1] == 3 else _cross(x, self.force)[:, None]
        return {
            "balance_force": float(np.abs(self.force.sum(axis=0)).max() / size),
            "balance_moment": float(np.abs(moments.sum(axis=0)).max() / size),
        }


def _cross(x: Array, force: Array) -> Array:
    return np.asarray(x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0])


@dataclass(frozen=True)
class _Coupling:
    """Gaps rows @ u + gap (m,) of multipliers, whose forces are forces.T; scales for the iteration.

    Args:
        rows: (m, nodes), of the vertical displacements.
        forces: (m, nodes), vertical.
        gap: (m,).
        weight: (m,), integral of what the gap is weighted with.
    """

    rows: sp.csr_array
    forces: sp.csr_array
    gap: Array
    weight: Array


def _saddle_point(two: TwoBodies, load: PETSc.Vec, conditions: list[fem.DirichletBC]) -> Solution:
    """Frictionless contact along the last coordinate, which `n` of both faces is near to."""
    x, space = two.x, two.space
    one, other = (gather_trace(space, facets) for facets in (two.slave, two.master))
    nodes, dim = one.nodes, x.shape[1]
    # the slave is pushed along its own inward normal
    sign = -1.0 if one.facet_normals[:, -1].mean() > 0 else 1.0
    build = _of_nodes if two.way == "node-to-segment" else _of_multipliers
    coupling = build(two.way, one, other, len(x), sign)
    G, B = (sp.csr_array(sp.kron(of, np.eye(dim)[-1:])) for of in (coupling.rows, coupling.forces))
    K = sp.csr_array(two.K.getValuesCSR()[::-1], shape=two.K.getSize())
    u = np.zeros(x.size)
    held = np.zeros(x.size, dtype=bool)
    for condition in conditions:
        dofs = condition.dof_indices()[0]
        held[dofs] = True
        condition.set(u)
    free = np.flatnonzero(~held)
    right = (load.array_r - K @ u)[free]
    Kf, Gf, Bf, start = K[free][:, free], G[:, free], B[:, free], coupling.gap + G @ u
    known = np.abs(G).sum(axis=1) > 1e-9 * np.abs(G).sum(axis=1).max()
    stiffness = K.diagonal().mean()
    area = np.abs(coupling.weight).mean()
    # gaps of multipliers are weighted; lambda is a pressure, or a force of node to segment
    scale = stiffness / area**2 if two.way != "node-to-segment" else stiffness
    active = known.copy()
    seen: list[npt.NDArray[np.bool_]] = []
    settled = False
    while not settled and len(seen) < _MOST and not any(np.array_equal(active, a) for a in seen):
        seen.append(active)
        of = Gf[active]
        zero = sp.csr_array((of.shape[0], of.shape[0]))
        matrix = sp.block_array([[Kf, -Bf[active].T], [of, zero]], format="csr")
        solved = _solved(matrix, np.concatenate([right, -start[active]]))
        u[free] = solved[: len(free)]
        multiplier = np.zeros(len(active))
        multiplier[active] = solved[len(free) :]
        gap = coupling.gap + G @ u
        new = known & (multiplier - scale * gap > 1e-10 * np.abs(multiplier).max())
        settled = np.array_equal(new, active)
        active = new
    force = np.zeros_like(x)
    force[:, -1] = coupling.forces.T @ multiplier
    surface = SurfaceNodes.from_body(two.body, two.slave)
    order = np.searchsorted(nodes, surface.node)
    if two.way == "node-to-segment":
        pressure = surface.pressure(multiplier[order])
    else:
        if two.way == "p2-p1":  # linear along each edge
            place = np.searchsorted(nodes, one.facet_nodes)
            for middle, ends in _edges(one.dim):
                multiplier[place[:, middle]] = multiplier[place[:, ends]].mean(axis=1)
                known[place[:, middle]] = known[place[:, ends]].all(axis=1)
        pressure = np.where(known, multiplier, np.nan)[order]
    return Solution(
        surface.node,
        pressure,
        surface.tributary_area,
        force,
        other.nodes,
        u.reshape(x.shape),
        len(seen),
        settled,
        [],
    )


def _solved(matrix: sp.csr_array, right: Array) -> Array:
    """By MUMPS, which pivots."""
    csr = (matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data)
    A = PETSc.Mat().createAIJ(matrix.shape, csr=csr, comm=PETSc.COMM_SELF)
    solver = PETSc.KSP().create(PETSc.COMM_SELF)
    solver.setOperators(A)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")
    b, x = A.createVecLeft(), A.createVecRight()
    b.setArray(right)
    solver.solve(b, x)
    return np.array(x.array_r)


def _of_multipliers(way: str, one: Trace, other: Trace, count: int, sign: float) -> _Coupling:
    """By integrals over the segments of both faces."""
    overlap = Overlap.from_traces(one, other, one.nodes, revolved=False)
    (at1, N1), (at2, N2), (at3, w2) = overlap.functions
    functions: dict[str, Callable[[], Array]] = {
        "pw-dual-gap": lambda: overlap.dual,
        "p2-p2": lambda: N1,
        "p2-p1": lambda: _linear(N1, one.dim),
        "p2-dual": lambda: _duals(at1, N1, overlap.measure, one.dim),
    }
    phi = functions[way]()
    m = len(one.nodes)
    row = overlap.point if way in NEW else np.searchsorted(one.nodes, at1)

    def integrals(column: Indices, values: Array) -> sp.csr_array:
        parts = np.einsum("q,qa,qk->qak", overlap.measure, phi, values)
        place = [
            np.broadcast_to(i, parts.shape).ravel() for i in (row[:, :, None], column[:, None])
        ]
        return sp.csr_array(sp.coo_array((parts.ravel(), tuple(place)), (m, count)))

    rows = forces = sign * (integrals(at1, N1) - integrals(at2, N2))
    if way in NEW:
        forces = sign * (integrals(one.nodes[row], overlap.weight) - integrals(at3, w2))
    measured = overlap.measure[:, None] * phi
    gap = np.bincount(row.ravel(), (sign * overlap.separation[:, -1:] * measured).ravel(), m)
    weight = np.bincount(row.ravel(), measured.ravel(), m)
    return _Coupling(rows, forces, np.asarray(gap, dtype=float), np.asarray(weight, dtype=float))


def _edges(dim: int) -> list[tuple[int, list[int]]]:
    """The node in the middle of each edge of a facet, and those at its ends."""
    return {2: [(2, [0, 1])], 3: [(3, [1, 2]), (4, [0, 2]), (5, [0, 1])]}[dim]


def _linear(N: Array, dim: int) -> Array:
    """Linear functions of vertices (q, k), zero at mid-sides, from quadratic ones (q, k)."""
    result = np.zeros_like(N)
    result[:, :dim] = N[:, :dim]
    for middle, ends in _edges(dim):
        result[:, ends] += N[:, [middle]] / 2
    return result


def _duals(at: Indices, N: Array, measure: Array, dim: int) -> Array:
    """Duals (q, k) of the quadratic functions, in space of the transformed ones."""
    if dim == 3:
        changed = _KEPT * N
        for a, ends in enumerate(((4, 5), (3, 5), (3, 4))):
            changed[:, a] = N[:, a] + _GIVEN * N[:, list(ends)].sum(axis=1)
        N = changed
    facets, of = np.unique(at, axis=0, return_inverse=True)
    M = np.zeros((len(facets), N.shape[1], N.shape[1]))
    np.add.at(M, of.ravel(), np.einsum("q,qa,qb->qab", measure, N, N))
    D = M.sum(axis=2)  # the transformed functions sum up to one, too
    A = np.linalg.pinv(M) * D[:, None, :]
    return np.asarray(np.einsum("qa,qab->qb", N, A[of.ravel()]))


def _of_nodes(way: str, one: Trace, other: Trace, count: int, sign: float) -> _Coupling:  # noqa: ARG001
    """Nodes of the slave, which meet the master's face along the last coordinate."""
    x = one.node_positions()
    _, corners, _ = other.sub_facets
    edges = np.swapaxes(corners[:, 1:, :-1] - corners[:, :1, :-1], 1, 2)
    away = x[:, None, :-1] - corners[None, :, 0, :-1]
    inner = np.einsum("sij,nsj->nsi", np.linalg.inv(edges), away)
    L = np.concatenate([1 - inner.sum(axis=2, keepdims=True), inner], axis=2)
    part = L.min(axis=2).argmax(axis=1)
    place = L[np.arange(len(x)), part]
    meets = place.min(axis=1) > _ON
    at, N = other.evaluate_trial_functions(part, place)
    y = other.interpolate_positions(part, N)
    m = len(x)
    rows = sp.csr_array((np.ones(m), (np.arange(m), one.nodes)), (m, count)) - sp.csr_array(
        (N.ravel(), (np.repeat(np.arange(m), N.shape[1]), at.ravel())), (m, count)
    )
    gap = sign * (x - y)[:, -1]
    rows = sp.csr_array(sp.diags_array(meets * sign) @ rows)
    return _Coupling(rows, rows, gap, meets.astype(float))

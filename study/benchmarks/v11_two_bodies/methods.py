"""Methods for contact of two deformable bodies on meshes that do not match.

Methods with piecewise-linear weights: `pw-dual` is the library's method, which weights gaps with
the test functions. `pw-dual-gap` has the same test functions and multipliers, but weights gaps with
the dual functions of the multipliers; the difference between the two is the error that a mean gap
over positive functions causes at the edge of contact.

Methods with standard test functions, for comparison: multipliers on the slave's face, expanded in
its standard functions (`p2-p2`), its linear ones (`p2-p1`) or the duals of the quadratic ones
(`p2-dual`; in space those of the transformed basis of A. Popp, B. Wohlmuth, M. Gee and W. Wall,
https://doi.org/10.1137/110848190), and nodes of the slave that touch the master's face
(`node-to-segment`). Gaps are weighted with the multipliers' functions; the methods with standard
functions are therefore symmetric saddle-point problems.

All methods except the library's are frictionless; their active sets are found by Newton's method.
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
from pw_elements.contact.interface import BoundaryFacets, OverlapQuadrature, gather_boundary_facets
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.spaces import EntitySelection

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
Facets = npt.NDArray[np.int32]

NEW_WEIGHT_METHODS = ("pw-dual", "pw-dual-gap")
"""Methods with piecewise-linear test functions."""

_QUADRATURE_DEGREE = 3
"""Degree of quadrature in space, where cells are straight to within 1e-3. The degree that the
library uses for curved cells changes the ninth digit of pressures and takes half of all time."""
_MAX_LINEAR_SYSTEMS = 40
"""Largest number of active sets in the methods for comparison, whose iteration may cycle."""
_MID_SIDE_FACTOR, _VERTEX_FACTOR = 3 / 4, 1 / 8
"""Fractions of a mid-side function that stay at its node and that are passed to each vertex in the
transformed basis."""
_INSIDE_TOLERANCE = -1e-9
"""Smallest barycentric coordinate of a point that counts as inside a triangle."""


@dataclass(frozen=True)
class TwoBodies:
    """Two bodies, parts of one mesh, and their contact faces.

    Args:
        method: Name of the method, a key of `study.model.vocabulary.WAYS`.
        body: Both bodies, with the test functions of the method.
        K: Stiffness without supports.
        slave: Local numbers of the slave's facets.
        master: Local numbers of the master's facets.
    """

    method: str
    body: Body
    K: PETSc.Mat
    slave: Facets
    master: Facets

    @classmethod
    def from_mesh(
        cls,
        method: str,
        mesh: Mesh,
        is_lower_cell: Mask,
        moduli: tuple[float, float],
        poissons_ratio: float,
        state: StressState,
        faces: tuple[Facets, Facets],
    ) -> "TwoBodies":
        """Assemble both bodies.

        Args:
            method: Name of the method.
            mesh: Mesh of both bodies.
            is_lower_cell: Mask (cells,) of the cells of the lower body.
            moduli: Young's moduli of the lower and of the upper body.
            poissons_ratio: Poisson's ratio of both bodies.
            state: Plane strain or solid.
            faces: Facets of slave and master.
        """
        E = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        E.x.array[:] = np.where(is_lower_cell, *moduli)
        spaces = (
            Spaces.petrov_galerkin(mesh) if method in NEW_WEIGHT_METHODS else Spaces.galerkin(mesh)
        )
        degree = _QUADRATURE_DEGREE if state is StressState.SOLID else None
        body = Body(spaces, Material(E, poissons_ratio), state, quadrature_degree=degree)
        return cls(method, body, assemble_matrix(body.stiffness()), *faces)

    @property
    def space(self) -> fem.FunctionSpace:
        """Space of the displacements."""
        return self.body.spaces.trial

    @property
    def x(self) -> Array:
        """Positions of the nodes, (nodes, dim)."""
        return np.asarray(self.space.tabulate_dof_coordinates()[:, : self.space.mesh.geometry.dim])

    def load(self, traction: Array | Sequence[float], part: EntitySelection) -> PETSc.Vec:
        """Return the load vector of a traction on a part of the boundary."""
        surface = boundary_measure(self.space.mesh, part)
        return assemble_vector(self.body.surface_load(np.asarray(traction, dtype=float), surface))

    def solve(
        self,
        loads: PETSc.Vec | list[PETSc.Vec],
        conditions: list[fem.DirichletBC],
        friction: float = 0.0,
        motions: Sequence[Motion] = (),
    ) -> "ContactSolution":
        """Solve the contact problem.

        Only the library's method supports friction, several loads and motions.
        """
        if self.method == "pw-dual":
            reduction = Reduction.dirichlet(self.space, conditions)
            nodes = fem.locate_dofs_topological(
                self.space, self.space.mesh.topology.dim - 1, self.slave
            )
            pair = ContactPair(nodes, DeformableSurface(self.master), friction, motions)
            states = solve_contact(self.K, loads, reduction, [pair], self.space)
            return self._library_solution(states)
        assert isinstance(loads, PETSc.Vec)
        return _solve_saddle_point(self, loads, conditions)

    def _library_solution(self, states: list[ContactState]) -> "ContactSolution":
        (pair,) = states[-1].pairs
        surface = SurfaceNodes.from_body(self.body, self.slave)
        slave, master = (
            gather_boundary_facets(self.space, face) for face in (self.slave, self.master)
        )
        overlap = OverlapQuadrature.from_slave_and_master(slave, master, pair.node, revolved=False)
        covered = overlap.integrate_with_weight_functions(
            np.ones(len(overlap.measure)), len(pair.node)
        )
        force = np.zeros_like(self.x)
        force[pair.node] = pair.force_vector
        force[pair.opposite_node] = pair.opposite_force
        return ContactSolution(
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
class ContactSolution:
    """Solution of a contact problem by one of the methods.

    Args:
        slave_node: Nodes (m,) of the slave's face, ordered by position.
        pressure: Pressures (m,), NaN at nodes where the method has none.
        area: Tributary areas (m,).
        force: Contact forces (nodes, dim) on both bodies.
        master_node: Nodes (k,) of the master's face.
        displacement: Displacements (nodes, dim).
        iterations: Largest number of linear systems of an increment.
        has_converged: Whether the iteration has converged.
        states: States of the library's method, otherwise empty.
    """

    slave_node: Indices
    pressure: Array
    area: Array
    force: Array
    master_node: Indices
    displacement: Array
    iterations: int
    has_converged: bool
    states: list[ContactState]

    def force_and_moment_imbalance(self, x: Array) -> dict[str, float]:
        """Return the imbalance of the contact forces on both bodies, and of their moments.

        Both are relative to the sum of the magnitudes of the forces.
        """
        magnitude = np.abs(self.force).sum()
        if x.shape[1] == 3:
            moments = np.cross(x, self.force)
        else:
            moments = (x[:, 0] * self.force[:, 1] - x[:, 1] * self.force[:, 0])[:, None]
        return {
            "balance_force": float(np.abs(self.force.sum(axis=0)).max() / magnitude),
            "balance_moment": float(np.abs(moments.sum(axis=0)).max() / magnitude),
        }


@dataclass(frozen=True)
class FaceCoupling:
    """Gap and force operators that couple both faces along the last coordinate.

    Gaps are `rows @ u + gap`, and multipliers exert the forces `forces.T @ multiplier`.

    Args:
        rows: Matrix (m, nodes) from vertical displacements to changes of gaps.
        forces: Matrix (m, nodes) whose transpose turns multipliers into vertical forces.
        gap: Gaps (m,) of the undeformed bodies.
        weight: Integrals (m,) of the functions that weight the gaps.
    """

    rows: sp.csr_array
    forces: sp.csr_array
    gap: Array
    weight: Array


def _solve_saddle_point(
    bodies: TwoBodies, load: PETSc.Vec, conditions: list[fem.DirichletBC]
) -> ContactSolution:
    """Solve frictionless contact along the last coordinate, which approximates the normals."""
    x, space = bodies.x, bodies.space
    slave, master = (
        gather_boundary_facets(space, facets) for facets in (bodies.slave, bodies.master)
    )
    dim = x.shape[1]
    is_node_to_segment = bodies.method == "node-to-segment"
    # contact pushes the slave along its inward normal
    sign = -1.0 if slave.facet_normals[:, -1].mean() > 0 else 1.0
    if is_node_to_segment:
        coupling = _couple_nodes_to_segments(slave, master, len(x), sign)
    else:
        coupling = integrate_multiplier_coupling(bodies.method, slave, master, len(x), sign)
    G, B = (
        sp.csr_array(sp.kron(matrix, np.eye(dim)[-1:]))
        for matrix in (coupling.rows, coupling.forces)
    )
    K = sp.csr_array(bodies.K.getValuesCSR()[::-1], shape=bodies.K.getSize())
    u = np.zeros(x.size)
    is_prescribed = np.zeros(x.size, dtype=bool)
    for condition in conditions:
        dofs = condition.dof_indices()[0]
        is_prescribed[dofs] = True
        condition.set(u)
    free = np.flatnonzero(~is_prescribed)
    free_load = (load.array_r - K @ u)[free]
    K_free, G_free, B_free = K[free][:, free], G[:, free], B[:, free]
    initial_gap = coupling.gap + G @ u
    row_sums = np.abs(G).sum(axis=1)
    has_row = row_sums > 1e-9 * row_sums.max()  # other nodes do not face the master
    stiffness = K.diagonal().mean()
    area = np.abs(coupling.weight).mean()
    # multipliers are pressures with weighted gaps; in node to segment they are forces
    scale = stiffness if is_node_to_segment else stiffness / area**2

    active = has_row.copy()
    visited: list[Mask] = []
    settled = False
    while (
        not settled
        and len(visited) < _MAX_LINEAR_SYSTEMS
        and not any(np.array_equal(active, earlier_active) for earlier_active in visited)
    ):
        visited.append(active)
        G_active = G_free[active]
        zero = sp.csr_array((G_active.shape[0], G_active.shape[0]))
        matrix = sp.block_array([[K_free, -B_free[active].T], [G_active, zero]], format="csr")
        unknowns = _solve_by_lu(matrix, np.concatenate([free_load, -initial_gap[active]]))
        u[free] = unknowns[: len(free)]
        multiplier = np.zeros(len(active))
        multiplier[active] = unknowns[len(free) :]
        gap = coupling.gap + G @ u
        next_active = has_row & (multiplier - scale * gap > 1e-10 * np.abs(multiplier).max())
        settled = np.array_equal(next_active, active)
        active = next_active

    force = np.zeros_like(x)
    force[:, -1] = coupling.forces.T @ multiplier
    surface = SurfaceNodes.from_body(bodies.body, bodies.slave)
    order = np.searchsorted(slave.nodes, surface.node)
    if is_node_to_segment:
        pressure = surface.pressure(multiplier[order])
    else:
        if bodies.method == "p2-p1":  # linear along each edge
            node = np.searchsorted(slave.nodes, slave.facet_nodes)
            for middle, ends in _facet_edge_nodes(slave.space_dim):
                multiplier[node[:, middle]] = multiplier[node[:, ends]].mean(axis=1)
                has_row[node[:, middle]] = has_row[node[:, ends]].all(axis=1)
        pressure = np.where(has_row, multiplier, np.nan)[order]
    return ContactSolution(
        surface.node,
        pressure,
        surface.tributary_area,
        force,
        master.nodes,
        u.reshape(x.shape),
        len(visited),
        settled,
        [],
    )


def _solve_by_lu(matrix: sp.csr_array, right: Array) -> Array:
    """Solve a sparse linear system by LU with pivoting."""
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


def integrate_multiplier_coupling(
    method: str, slave: BoundaryFacets, master: BoundaryFacets, n_nodes: int, sign: float
) -> FaceCoupling:
    """Return the coupling by multipliers, integrated over the common segments of both faces.

    Args:
        method: "pw-dual-gap", "p2-p2", "p2-p1" or "p2-dual".
        slave: Face of the slave.
        master: Face of the master.
        n_nodes: Number of nodes of both bodies.
        sign: Sign of the slave's inward normal along the last coordinate.
    """
    overlap = OverlapQuadrature.from_slave_and_master(slave, master, slave.nodes, revolved=False)
    (slave_node, N_slave), (master_node, N_master), (weight_node, w_master) = overlap.functions
    functions: dict[str, Callable[[], Array]] = {
        "pw-dual-gap": lambda: overlap.dual,
        "p2-p2": lambda: N_slave,
        "p2-p1": lambda: _linear_from_quadratic_functions(N_slave, slave.space_dim),
        "p2-dual": lambda: dual_quadratic_functions(
            slave_node, N_slave, overlap.measure, slave.space_dim
        ),
    }
    phi = functions[method]()
    m = len(slave.nodes)
    row = (
        overlap.point if method in NEW_WEIGHT_METHODS else np.searchsorted(slave.nodes, slave_node)
    )

    def integrate_products(column: Indices, values: Array) -> sp.csr_array:
        products = np.einsum("q,qa,qk->qak", overlap.measure, phi, values)
        indices = tuple(
            np.broadcast_to(index, products.shape).ravel()
            for index in (row[:, :, None], column[:, None])
        )
        return sp.csr_array(sp.coo_array((products.ravel(), indices), (m, n_nodes)))

    rows = forces = sign * (
        integrate_products(slave_node, N_slave) - integrate_products(master_node, N_master)
    )
    if method in NEW_WEIGHT_METHODS:
        forces = sign * (
            integrate_products(slave.nodes[row], overlap.weight)
            - integrate_products(weight_node, w_master)
        )
    weighted = overlap.measure[:, None] * phi
    gap = np.bincount(row.ravel(), (sign * overlap.separation[:, -1:] * weighted).ravel(), m)
    weight = np.bincount(row.ravel(), weighted.ravel(), m)
    return FaceCoupling(rows, forces, np.asarray(gap, dtype=float), np.asarray(weight, dtype=float))


def _facet_edge_nodes(dim: int) -> list[tuple[int, list[int]]]:
    """Return the middle node and the two end nodes of each edge of a facet."""
    return {2: [(2, [0, 1])], 3: [(3, [1, 2]), (4, [0, 2]), (5, [0, 1])]}[dim]


def _linear_from_quadratic_functions(N: Array, dim: int) -> Array:
    """Return linear functions (q, k), zero for mid-side nodes, from quadratic ones (q, k)."""
    linear = np.zeros_like(N)
    linear[:, :dim] = N[:, :dim]
    for middle, ends in _facet_edge_nodes(dim):
        linear[:, ends] += N[:, [middle]] / 2
    return linear


def dual_quadratic_functions(node: Indices, N: Array, measure: Array, dim: int) -> Array:
    """Return the duals of a face's quadratic functions; in space those of the transformed basis.

    Args:
        node: Nodes (q, k) of the facet of each quadrature point.
        N: Quadratic functions (q, k) at the quadrature points.
        measure: Weights (q,) of the quadrature.
        dim: Dimension of space.

    Returns:
        Dual functions (q, k) at the quadrature points.
    """
    if dim == 3:
        transformed = _MID_SIDE_FACTOR * N
        for vertex, edges in enumerate(((4, 5), (3, 5), (3, 4))):
            transformed[:, vertex] = N[:, vertex] + _VERTEX_FACTOR * N[:, list(edges)].sum(axis=1)
        N = transformed
    facets, facet = np.unique(node, axis=0, return_inverse=True)
    M = np.zeros((len(facets), N.shape[1], N.shape[1]))
    np.add.at(M, facet.ravel(), np.einsum("q,qa,qb->qab", measure, N, N))
    D = M.sum(axis=2)  # the transformed functions sum up to one, too
    A = np.linalg.pinv(M) * D[:, None, :]
    return np.asarray(np.einsum("qa,qab->qb", N, A[facet.ravel()]))


def _couple_nodes_to_segments(
    slave: BoundaryFacets, master: BoundaryFacets, n_nodes: int, sign: float
) -> FaceCoupling:
    """Return the coupling of the slave's nodes with the opposite points of the master."""
    x = slave.node_positions()
    _, corners, _ = master.sub_facet_nodes_corners_and_normals
    edges = np.swapaxes(corners[:, 1:, :-1] - corners[:, :1, :-1], 1, 2)
    from_corner = x[:, None, :-1] - corners[None, :, 0, :-1]
    inner = np.einsum("sij,nsj->nsi", np.linalg.inv(edges), from_corner)
    barycentric = np.concatenate([1 - inner.sum(axis=2, keepdims=True), inner], axis=2)
    sub_facet = barycentric.min(axis=2).argmax(axis=1)
    position = barycentric[np.arange(len(x)), sub_facet]
    faces_master = position.min(axis=1) > _INSIDE_TOLERANCE
    master_node, N = master.evaluate_trial_functions(sub_facet, position)
    y = master.interpolate_positions(sub_facet, N)
    m = len(x)
    slave_values = sp.csr_array((np.ones(m), (np.arange(m), slave.nodes)), (m, n_nodes))
    master_values = sp.csr_array(
        (N.ravel(), (np.repeat(np.arange(m), N.shape[1]), master_node.ravel())), (m, n_nodes)
    )
    gap = sign * (x - y)[:, -1]
    rows = sp.csr_array(sp.diags_array(faces_master * sign) @ (slave_values - master_values))
    return FaceCoupling(rows, rows, gap, faces_master.astype(float))

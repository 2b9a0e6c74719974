"""Methods for contact of two deformable bodies whose meshes do not match.

Two methods use piecewise-linear test functions. `pw-dual` is the library's method, which weights
gaps with the test functions. `pw-dual-gap` has the same test functions and multipliers, but weights
gaps with the dual functions of the multipliers. The difference between them is the error that
arises at the edge of contact if gaps are averaged with nonnegative functions.

The other methods use standard test functions, for comparison. Their multipliers live on the slave
face and are expanded in its quadratic functions (`p2-p2`), its linear functions (`p2-p1`) or the
duals of the quadratic functions (`p2-dual`; in three dimensions, the duals of the transformed basis
of A. Popp, B. Wohlmuth, M. Gee and W. Wall, https://doi.org/10.1137/110848190). In
`node-to-segment` the nodes of the slave touch the face of the master. Gaps are weighted with the
functions of the multipliers, so the methods with standard test functions are symmetric saddle-point
problems.

All methods except the library's are frictionless and find the active set by Newton's method.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

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
from pw_elements.contact.interface import (
    BoundaryFacets,
    OverlapQuadrature,
    gather_boundary_facets,
)
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.spaces import EntitySelection
from study.model.reading import error_norms_on_common_and_other_nodes
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
Facets = npt.NDArray[np.int32]

NEW_WEIGHT_METHODS = ("pw-dual", "pw-dual-gap")
"""Methods with piecewise-linear test functions."""

_QUADRATURE_DEGREE = 3
"""Degree of quadrature in three dimensions, where cells are straight to within 1e-3.

The higher degree that the library chooses for curved cells changes the ninth digit of pressures and
takes half of the total time.
"""
_MAX_LINEAR_SYSTEMS = 40
"""Maximum number of active sets that a comparison method tries, because its iteration may cycle."""
_MID_SIDE_FACTOR, _VERTEX_FACTOR = 3 / 4, 1 / 8
"""Fractions of a mid-side function that stay at its node and that are passed to each vertex in the
transformed basis."""
_INSIDE_TOLERANCE = -1e-9
"""Smallest barycentric coordinate of a point that counts as inside a triangle."""


@dataclass(frozen=True)
class TwoBodies:
    """Two elastic bodies in one mesh, their stiffness matrix, and the two faces that may touch.

    Args:
        method: Name of the contact method, a key of `study.model.vocabulary.WAYS`.
        body: Finite-element model of both bodies, with the test functions of the method.
        K: Stiffness matrix without supports.
        slave: Local indices of the facets of the slave face.
        master: Local indices of the facets of the master face.
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
        """Assemble the stiffness matrix of both bodies for one contact method.

        Args:
            method: Name of the contact method.
            mesh: Mesh of both bodies.
            is_lower_cell: Mask (cells,) of the cells of the lower body.
            moduli: Young's moduli of the lower and of the upper body.
            poissons_ratio: Poisson's ratio of both bodies.
            state: Plane strain or solid.
            faces: Facets of the slave face and of the master face.
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
        """Finite-element space of the displacements."""
        return self.body.spaces.trial

    @property
    def x(self) -> Array:
        """Positions (nodes, dim) of the undeformed nodes."""
        return np.asarray(self.space.tabulate_dof_coordinates()[:, : self.space.mesh.geometry.dim])

    def load(self, traction: Array | Sequence[float], part: EntitySelection) -> PETSc.Vec:
        """Assemble the load vector of a uniform traction.

        Args:
            traction: Traction vector (dim,).
            part: Part of the boundary on which the traction acts.
        """
        surface = boundary_measure(self.space.mesh, part)
        return assemble_vector(self.body.surface_load(np.asarray(traction, dtype=float), surface))

    def solve(
        self,
        loads: PETSc.Vec | list[PETSc.Vec],
        supports: list[fem.DirichletBC],
        friction: float = 0.0,
        motions: Sequence[Motion] = (),
    ) -> "ContactSolution":
        """Solve the contact problem with the method of this object.

        Args:
            loads: One load vector, or one per increment.
            supports: Prescribed displacements.
            friction: Coefficient of friction; only the library's method supports a nonzero one.
            motions: Motion of the master in each increment; library's method only.
        """
        if self.method == "pw-dual":
            reduction = Reduction.dirichlet(self.space, supports)
            nodes = fem.locate_dofs_topological(
                self.space, self.space.mesh.topology.dim - 1, self.slave
            )
            pair = ContactPair(nodes, DeformableSurface(self.master), friction, motions)
            states = solve_contact(self.K, loads, reduction, [pair], self.space)
            return self._convert_library_states(states)
        assert isinstance(loads, PETSc.Vec)
        return _solve_frictionless_contact_by_active_set(self, loads, supports)

    def _convert_library_states(self, states: list[ContactState]) -> "ContactSolution":
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
        slave_node: Nodes (m,) of the slave face, ordered by position.
        pressure: Pressures (m,), NaN at nodes at which the method defines none.
        tributary_area: Tributary areas (m,).
        nodal_contact_force: Contact forces (nodes, dim) on both bodies.
        master_node: Nodes (k,) of the master face.
        displacement: Displacements (nodes, dim).
        iterations: Largest number of linear systems solved in an increment.
        has_converged: Whether the iteration has converged.
        states: States of the library's contact solver; empty for other methods.
    """

    slave_node: Indices
    pressure: Array
    tributary_area: Array
    nodal_contact_force: Array
    master_node: Indices
    displacement: Array
    iterations: int
    has_converged: bool
    states: list[ContactState]

    def relative_force_and_moment_imbalance(self, x: Array) -> dict[str, float]:
        """Return the relative imbalance of the contact forces on both bodies and of their moments.

        The resultant force and the resultant moment are both divided by the sum of the magnitudes
        of the nodal force components.

        Args:
            x: Positions (nodes, dim) of the nodes.
        """
        magnitude = np.abs(self.nodal_contact_force).sum()
        if x.shape[1] == 3:
            moments = np.cross(x, self.nodal_contact_force)
        else:
            moments = (
                x[:, 0] * self.nodal_contact_force[:, 1] - x[:, 1] * self.nodal_contact_force[:, 0]
            )[:, None]
        return {
            "balance_force": float(np.abs(self.nodal_contact_force.sum(axis=0)).max() / magnitude),
            "balance_moment": float(np.abs(moments.sum(axis=0)).max() / magnitude),
        }


@dataclass(frozen=True)
class FaceCoupling:
    """Linear operators that couple the two contact faces along the last coordinate.

    Gaps are `rows @ u + gap`, and multipliers exert the nodal forces `forces.T @ multiplier`, where
    u and the forces are components (nodes,) along the last coordinate.

    Args:
        rows: Matrix (m, nodes) that converts displacements to changes of the m gaps.
        forces: Matrix (m, nodes) whose transpose converts multipliers to nodal forces.
        gap: Gaps (m,) of the undeformed bodies.
        weight: Integrals (m,) of the functions that weight the gaps.
    """

    rows: sp.csr_array
    forces: sp.csr_array
    gap: Array
    weight: Array


def _solve_frictionless_contact_by_active_set(
    bodies: TwoBodies, load: PETSc.Vec, conditions: list[fem.DirichletBC]
) -> ContactSolution:
    """Solve frictionless contact with Lagrange multipliers by an active-set iteration.

    Gaps and forces are taken along the last coordinate, which approximates the contact normal.

    Args:
        bodies: The two bodies.
        load: Load vector.
        conditions: Prescribed displacements.
    """
    x, space = bodies.x, bodies.space
    slave, master = (
        gather_boundary_facets(space, facets) for facets in (bodies.slave, bodies.master)
    )
    dim = x.shape[1]
    is_node_to_segment = bodies.method == "node-to-segment"
    # contact pushes the slave along its inward normal
    sign = -1.0 if slave.facet_normals[:, -1].mean() > 0 else 1.0
    if is_node_to_segment:
        coupling = _couple_slave_nodes_to_master_segments(slave, master, len(x), sign)
    else:
        coupling = integrate_mortar_coupling_of_multipliers(
            bodies.method, slave, master, len(x), sign
        )
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
            for middle, ends in _local_middle_and_end_nodes_of_facet_edges(slave.space_dim):
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


def integrate_mortar_coupling_of_multipliers(
    method: str,
    slave: BoundaryFacets,
    master: BoundaryFacets,
    n_nodes: int,
    inward_normal_sign: float,
) -> FaceCoupling:
    """Integrate the multiplier coupling over the common segments of the slave and the master face.

    Args:
        method: "pw-dual-gap", "p2-p2", "p2-p1" or "p2-dual".
        slave: Slave face.
        master: Master face.
        n_nodes: Number of nodes of both bodies.
        inward_normal_sign: Sign of the slave's inward normal along the last coordinate.
    """
    overlap = OverlapQuadrature.from_slave_and_master(slave, master, slave.nodes, revolved=False)
    (slave_node, N_slave), (master_node, N_master), (weight_node, w_master) = overlap.functions
    functions: dict[str, Callable[[], Array]] = {
        "pw-dual-gap": lambda: overlap.dual,
        "p2-p2": lambda: N_slave,
        "p2-p1": lambda: _combine_quadratic_to_linear_functions(N_slave, slave.space_dim),
        "p2-dual": lambda: evaluate_dual_quadratic_functions(
            slave_node, N_slave, overlap.measure, slave.space_dim
        ),
    }
    phi = functions[method]()
    m = len(slave.nodes)
    row = (
        overlap.point if method in NEW_WEIGHT_METHODS else np.searchsorted(slave.nodes, slave_node)
    )

    def integrate_products_with_multiplier_functions(
        column: Indices, values: Array
    ) -> sp.csr_array:
        products = np.einsum("q,qa,qk->qak", overlap.measure, phi, values)
        indices = tuple(
            np.broadcast_to(index, products.shape).ravel()
            for index in (row[:, :, None], column[:, None])
        )
        return sp.csr_array(sp.coo_array((products.ravel(), indices), (m, n_nodes)))

    rows = forces = inward_normal_sign * (
        integrate_products_with_multiplier_functions(slave_node, N_slave)
        - integrate_products_with_multiplier_functions(master_node, N_master)
    )
    if method in NEW_WEIGHT_METHODS:
        forces = inward_normal_sign * (
            integrate_products_with_multiplier_functions(slave.nodes[row], overlap.weight)
            - integrate_products_with_multiplier_functions(weight_node, w_master)
        )
    weighted = overlap.measure[:, None] * phi
    gap = np.bincount(
        row.ravel(), (inward_normal_sign * overlap.separation[:, -1:] * weighted).ravel(), m
    )
    weight = np.bincount(row.ravel(), weighted.ravel(), m)
    return FaceCoupling(rows, forces, np.asarray(gap, dtype=float), np.asarray(weight, dtype=float))


def _local_middle_and_end_nodes_of_facet_edges(dim: int) -> list[tuple[int, list[int]]]:
    """Return the local numbers of the middle node and of the two end nodes of each edge of a facet.

    Args:
        dim: Dimension of space, 2 (facets are edges) or 3 (facets are triangles).
    """
    return {2: [(2, [0, 1])], 3: [(3, [1, 2]), (4, [0, 2]), (5, [0, 1])]}[dim]


def _combine_quadratic_to_linear_functions(N: Array, dim: int) -> Array:
    """Combine the values of quadratic shape functions into values of linear hat functions.

    Args:
        N: Quadratic shape functions (q, k) of the k nodes of a facet at q points.
        dim: Dimension of space.

    Returns:
        Linear functions (q, k), which are zero for mid-side nodes.
    """
    linear = np.zeros_like(N)
    linear[:, :dim] = N[:, :dim]
    for middle, ends in _local_middle_and_end_nodes_of_facet_edges(dim):
        linear[:, ends] += N[:, [middle]] / 2
    return linear


def evaluate_dual_quadratic_functions(
    facet_nodes: Indices, N: Array, measure: Array, dim: int
) -> Array:
    """Evaluate the functions that are dual to the quadratic shape functions of a face.

    In three dimensions, they are dual to the transformed basis (see the head of the module).

    Args:
        facet_nodes: Nodes (q, k) of the facet that contains each quadrature point.
        N: Quadratic shape functions (q, k) at the quadrature points.
        measure: Quadrature weights (q,), including the surface element.
        dim: Dimension of space.

    Returns:
        Dual functions (q, k) at the quadrature points.
    """
    if dim == 3:
        transformed = _MID_SIDE_FACTOR * N
        for vertex, edges in enumerate(((4, 5), (3, 5), (3, 4))):
            transformed[:, vertex] = N[:, vertex] + _VERTEX_FACTOR * N[:, list(edges)].sum(axis=1)
        N = transformed
    facets, facet = np.unique(facet_nodes, axis=0, return_inverse=True)
    M = np.zeros((len(facets), N.shape[1], N.shape[1]))
    np.add.at(M, facet.ravel(), np.einsum("q,qa,qb->qab", measure, N, N))
    D = M.sum(axis=2)  # the transformed functions sum up to one, too
    A = np.linalg.pinv(M) * D[:, None, :]
    return np.asarray(np.einsum("qa,qab->qb", N, A[facet.ravel()]))


def _couple_slave_nodes_to_master_segments(
    slave: BoundaryFacets, master: BoundaryFacets, n_nodes: int, inward_normal_sign: float
) -> FaceCoupling:
    """Couple each slave node with the opposite point of the master face.

    Args:
        slave: Slave face.
        master: Master face.
        n_nodes: Number of nodes of both bodies.
        inward_normal_sign: Sign of the slave's inward normal along the last coordinate.
    """
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
    gap = inward_normal_sign * (x - y)[:, -1]
    rows = sp.csr_array(
        sp.diags_array(faces_master * inward_normal_sign) @ (slave_values - master_values)
    )
    return FaceCoupling(rows, rows, gap, faces_master.astype(float))


# Comparison with the exact pressure

INNER_RADIUS = 0.8
"""Distance from the middle of the contact, over its half width, within which errors count."""
SLOW_PRESSURE_RATIO = 2.0
"""Largest ratio of pressures at neighbouring nodes for which the pressure varies slowly."""
MIN_RELATIVE_PRESSURE = 1e-9
"""Fraction of the largest pressure below which a pressure counts as zero."""


def compare_pressures_with_exact_ones(
    bodies: TwoBodies,
    solution: ContactSolution,
    exact_pressure: npt.NDArray[np.floating],
    pressure_scale: float,
    inner_radius: float,
    exact_force: float | None = None,
    extra_scalars: dict[str, float] | None = None,
    extra_curves: Mapping[str, npt.NDArray[np.floating]] | None = None,
) -> Result:
    """Compare pressures at the slave nodes with exact ones, and evaluate the forces on both bodies.

    In three dimensions, errors are also given separately for nodes at which the standard element's
    test function has a nonzero integral over the surface (suffix `common`) and for other nodes
    (`alone`).

    Args:
        bodies: The two bodies.
        solution: Solution by one of the contact methods.
        exact_pressure: Exact pressures (m,) at the slave nodes.
        pressure_scale: Pressure to which errors are relative.
        inner_radius: Distance from the origin within which errors count.
        exact_force: Exact total force, if it is known.
        extra_scalars: Further scalars of the result.
        extra_curves: Further nodal values (m,) of the result.
    """
    x, dim = bodies.x, bodies.x.shape[1]
    slave_x, master_x = x[solution.slave_node], x[solution.master_node]
    has_pressure = ~np.isnan(solution.pressure)
    error = np.where(has_pressure, np.abs(solution.pressure - exact_pressure), 0.0)
    counts = has_pressure & (np.linalg.norm(slave_x[:, :-1], axis=1) < inner_radius)
    squared_error = (solution.tributary_area * error**2)[has_pressure].sum()
    squared_pressure = (solution.tributary_area * exact_pressure**2)[has_pressure].sum()
    slave_force = solution.nodal_contact_force[solution.slave_node, -1]
    # positive in compression
    master_force = solution.nodal_contact_force[solution.master_node, -1]
    master_force = master_force * np.sign(master_force.sum())
    # smooth pressures: away from the edge of the contact and from the ends of the faces
    middle_radius = inner_radius if np.isfinite(inner_radius) else INNER_RADIUS
    in_middle = np.linalg.norm(master_x[:, :-1], axis=1) < middle_radius
    if np.isinf(inner_radius):
        in_middle &= (master_x[:, :-1] > 1e-9).all(axis=1)
    mean = master_force[in_middle].mean()
    scalars = {
        "pressure_error": error[counts].max() / pressure_scale,
        "pressure_l2": np.sqrt(squared_error / squared_pressure),
        "pressure_error_median": np.median(error[counts]) / pressure_scale,
        "master_force_min": master_force[in_middle].min() / mean,
        "master_force_max": master_force[in_middle].max() / mean,
        "master_force_least": master_force.min() / mean,
        "slave_force_least": (slave_force * np.sign(slave_force.sum())).min() / mean,
        "iterations": solution.iterations,
        "settled": solution.has_converged,
        **solution.relative_force_and_moment_imbalance(x),
        **(extra_scalars or {}),
    }
    if dim == 3:
        galerkin = replace(bodies.body, spaces=Spaces.galerkin(bodies.space.mesh))
        no_force = np.zeros(len(slave_x))
        standard = SurfaceNodes.from_body(galerkin, bodies.slave).pressure(no_force)
        errors = error_norms_on_common_and_other_nodes(
            np.where(counts, error, np.nan) / pressure_scale, standard
        )
        scalars |= {f"pressure_error_{which}": size for which, size in errors.items()}
    varies_slowly = _mask_master_nodes_with_smooth_pressure(bodies, solution)
    if varies_slowly.any():
        scalars["master_force_slow"] = master_force[varies_slowly].min() / mean
    if exact_force is not None:
        scalars["force_error"] = abs(np.abs(slave_force.sum()) / exact_force - 1)
    stored = {
        "x": slave_x,
        "pressure": solution.pressure / pressure_scale,
        "exact_pressure": exact_pressure / pressure_scale,
        "area": solution.tributary_area,
        "force": slave_force,
        "opposite_x": master_x,
        "opposite_force": solution.nodal_contact_force[solution.master_node, -1],
        **(extra_curves or {}),
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, assign_unit_one_to_scalars(numbers), stored, dofs=dim * len(x))


def _mask_master_nodes_with_smooth_pressure(bodies: TwoBodies, solution: ContactSolution) -> Mask:
    """Return the mask (k,) of the master nodes around which the slave's pressure varies slowly.

    The pressure varies slowly if the ratio of the largest to the smallest slave pressure near a
    node is below `SLOW_PRESSURE_RATIO`. Slave nodes are near if their distance is at most the
    longest adjacent master edge plus the longest slave edge.
    """
    dim = bodies.x.shape[1]
    reach: Array = np.zeros(len(bodies.x))
    edges = []
    for facets in (bodies.slave, bodies.master):
        trace = gather_boundary_facets(bodies.space, facets)
        corners = trace.facet_x[:, :dim]
        edges.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1))
    np.maximum.at(reach, trace.facet_nodes.ravel(), np.repeat(edges[1], trace.facet_nodes.shape[1]))
    has_pressure = ~np.isnan(solution.pressure)
    neighbours = cKDTree(bodies.x[solution.slave_node[has_pressure], :-1]).query_ball_point(
        bodies.x[solution.master_node, :-1], reach[solution.master_node] + edges[0].max()
    )
    pressures = [solution.pressure[has_pressure][nodes] for nodes in neighbours]
    smallest = MIN_RELATIVE_PRESSURE * np.nanmax(solution.pressure)
    return np.array(
        [
            len(p) > 0 and smallest < p.min() and p.max() < SLOW_PRESSURE_RATIO * p.min()
            for p in pressures
        ]
    )

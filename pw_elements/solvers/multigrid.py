"""Two-level p-multigrid, with quadratic functions on the fine level and linear ones on the coarse.

If P interpolates vertex values at all nodes, P^T K P is the stiffness of linear elements. This
holds for the stiffness K of standard and of new elements. K is neither changed nor copied for
supports and contact: a projection Pi removes constrained components from vectors, and the operator
is Pi K Pi + (1 - Pi). Springs between nodes are added to K.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem, la
from dolfinx.fem.petsc import interpolation_matrix

from pw_elements.arrays import Array, Indices
from pw_elements.checks import count_local_and_global_dofs
from pw_elements.solvers.matrices import (
    ConstrainedOperator,
    ConstraintProjection,
    Supports,
    add_scaled,
    block_diagonal_matrix,
    collect_garbage,
    destroy_objects,
    diagonal_blocks,
    galerkin_product,
    index_set,
    is_stored_in_blocks,
    matrix_from_python_context,
)
from pw_elements.spaces import scalar_component_space

# If a larger fraction of the constrained nodes than the first number has changed, the coarse matrix
# is assembled again; if larger than the second number, the aggregates of algebraic multigrid are
# chosen again
_CHANGED_NODE_FRACTION_TO_REBUILD_COARSE = 0.1
_CHANGED_NODE_FRACTION_TO_REAGGREGATE = 0.5
# Smaller changes of a node's projector are not counted; if a node closes, its projector changes by
# one
_MIN_COUNTED_PROJECTOR_CHANGE = 0.3


def linear_space_vertex_nodes_and_interpolation(
    space: fem.FunctionSpace,
) -> tuple[fem.FunctionSpace, Indices, PETSc.Mat]:
    """Return the space of linear functions on the same mesh, and their interpolation matrix.

    Args:
        space: quadratic space.

    Returns:
        The linear space; the local node number in `space` of each vertex that this process owns;
        and the matrix P (n, n_linear) that maps the vertex values of linear functions to their
        values at the nodes of `space`.
    """
    mesh, cells, block = space.mesh, space.dofmap.list, space.dofmap.index_map_bs
    shape = tuple(space.ufl_element().reference_value_shape)
    linear = fem.functionspace(mesh, ("Lagrange", 1, shape))
    index_map = linear.dofmap.index_map
    node = np.empty(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    corner = [dofs[0] for dofs in space.element.basix_element.entity_dofs[0]]
    node[linear.dofmap.list] = cells[:, corner]
    fine, coarse = (scalar_component_space(V) if block > 1 else V for V in (space, linear))
    scalar_P = interpolation_matrix(coarse, fine)
    scalar_P.assemble()
    indptr, indices, data = scalar_P.getValuesCSR()
    shape = len(indptr) - 1, index_map.size_global
    rows = sp.csr_array((np.round(data, 12), indices, indptr), shape)
    rows.eliminate_zeros()  # entries of vertices whose function is zero at the node
    rows = sp.kron(rows, sp.eye_array(block), "csr")
    csr = *(part.astype(PETSc.IntType) for part in (rows.indptr, rows.indices)), rows.data
    P = PETSc.Mat().createAIJ(
        (count_local_and_global_dofs(space), count_local_and_global_dofs(linear)),
        csr=csr,
        comm=mesh.comm,
    )
    destroy_objects(scalar_P)
    return linear, node[: index_map.size_local], P


def rigid_body_null_space(linear_space: fem.FunctionSpace) -> PETSc.NullSpace | None:
    """Return the rigid motions of a space of linear displacements, as a null space.

    The result is None in one dimension, and for fields other than displacements (for example
    temperatures), which have constants instead of rigid motions.
    """
    block, dim = linear_space.dofmap.index_map_bs, linear_space.mesh.geometry.dim
    if block != dim or dim == 1:
        return None
    sizes = count_local_and_global_dofs(linear_space)
    coordinates = PETSc.Vec().createMPI(sizes, bsize=block, comm=linear_space.mesh.comm)
    coordinates.setArray(linear_space.tabulate_dof_coordinates()[: sizes[0] // dim, :dim].ravel())
    return PETSc.NullSpace().createRigidBody(coordinates)


class LinearCoarseLevel:
    """Coarse level of multigrid, with the matrix of linear functions under constraints.

    Let P interpolate vertex values at all nodes. The projection Pi removes constrained components
    at nodes, and Pi_c at vertices. The interpolation is Pi P Pi_c, and the coarse matrix is
    Pi_c P^T Pi K Pi P Pi_c, with a mean stiffness on the diagonal in the directions that Pi_c
    removes. The matrix is assembled only once; after that, only its part near nodes that contact
    may constrain is replaced.

    Args:
        K: stiffness (n, n) without supports.
        supports: free unknowns of the space.
        fine: projection Pi.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports, fine: ConstraintProjection) -> None:
        space = supports.space
        self._K, self._fine, self._space = K, fine, space
        self._block = space.dofmap.index_map_bs
        linear, self._vertex_node, self._P = linear_space_vertex_nodes_and_interpolation(space)
        free = supports.free.reshape(-1, self._block)[self._vertex_node].ravel()
        self._coarse = ConstraintProjection(free, self._block)
        at_vertices, at_nodes = self._P.createVecs()
        for vector, mask in ((at_vertices, free), (at_nodes, supports.free)):
            vector.setArray(mask.astype(float))
        self._P.diagonalScale(at_nodes, at_vertices)
        self._near_null_space = rigid_body_null_space(linear)
        self._projected_P = _ProjectedInterpolation(self._P, fine, self._coarse)
        self.interpolation = matrix_from_python_context(
            self._P.getSizes(), self._projected_P, K.comm
        )
        self.springs: PETSc.Mat | None = None
        self._contact_rows: _InterpolationNearContact | None = None
        self._matrix: PETSc.Mat | None = None
        self._spring_part: PETSc.Mat | None = None  # P^T B P with the springs B
        self.has_changed_spring_pattern = False  # whether the matrix lacks entries for the springs
        self._replaceable: PETSc.Mat | None = None  # other part of the matrix that contact changes

    def set_contact_nodes_once(self, nodes: Indices) -> None:
        """Set the nodes that contact may constrain; only the first call has an effect.

        Args:
            nodes: local numbers of the nodes.
        """
        if self._contact_rows is None:
            self._contact_rows = _InterpolationNearContact(self._P, self._space, nodes)
            self._matrix = None

    def discard_matrix(self) -> None:
        self._contact_rows = self._matrix = None

    def set_constrained_directions(
        self, nodes: Indices, projectors: Array, stiffnesses: Array
    ) -> None:
        """Constrain directions at those of m nodes that are vertices.

        Args:
            nodes: local numbers (m,) of the nodes, the same in each call.
            projectors: projectors (m, block, block) onto the constrained directions.
            stiffnesses: stiffnesses (m,) of the constrained directions.
        """
        vertex = np.flatnonzero(np.isin(self._vertex_node, nodes))
        order = np.argsort(nodes)
        index = order[np.searchsorted(nodes, self._vertex_node[vertex], sorter=order)]
        self._coarse.set_constrained_directions(vertex, projectors[index], stiffnesses[index])

    def update_matrix(self) -> PETSc.Mat:
        """Return the coarse matrix for the current constraints.

        Until `discard_matrix` is called, the same matrix object is updated and returned.
        """
        contact, comm, columns = self._contact_rows, self._K.comm, self._P.getSizes()[1]
        has_pattern = self._matrix is not None  # with entries for the replaceable part
        if self._matrix is None:
            self._matrix, self._spring_part = galerkin_product(self._K, self._P), None
            self._replaceable = (
                galerkin_product(self._K, contact.P, contact.rows) if contact else None
            )
        if self._replaceable is not None:
            add_scaled(self._matrix, -1.0, self._replaceable, same_pattern=has_pattern)
        if self._spring_part is not None:
            add_scaled(self._matrix, -1.0, self._spring_part, same_pattern=has_pattern)
        free = self._coarse.free_projectors(np.arange(len(self._vertex_node)))
        part = None
        if self.springs is not None:
            self._spring_part = galerkin_product(self.springs, self._P)
            same_pattern = has_pattern and not self.has_changed_spring_pattern
            self._add_spring_part(1.0, same_pattern)
            self.has_changed_spring_pattern = False
        elif contact is not None:
            left = block_diagonal_matrix(
                self._fine.free_projectors(contact.nodes), contact.P.getSizes()[0], comm
            )
            right = block_diagonal_matrix(free, columns, comm)
            left_P = left.matMult(contact.P)
            P = left_P.matMult(right)  # Pi P Pi_c near contact
            part = galerkin_product(self._K, P, contact.rows)
            destroy_objects(left, right, left_P, P)
            add_scaled(self._matrix, 1.0, part, destroy_term=False, same_pattern=has_pattern)
        mean_stiffness = self._matrix.getDiagonal().sum() / columns[1]
        diagonal = block_diagonal_matrix(
            mean_stiffness * (np.eye(self._block) - free), columns, comm
        )
        add_scaled(self._matrix, 1.0, diagonal, destroy_term=False, same_pattern=has_pattern)
        if part is not None:
            add_scaled(part, 1.0, diagonal)
        self._replaceable = diagonal if part is None else part
        self._matrix.setBlockSize(self._block)
        if self._near_null_space is not None:
            self._matrix.setNearNullSpace(self._near_null_space)
        return self._matrix

    @contextmanager
    def springs_removed(self) -> Iterator[None]:
        """Subtract the springs from the coarse matrix within a `with` block.

        The sparsity pattern stays the same, with zeros where only springs connect nodes.
        """
        if self._spring_part is None:
            yield
            return
        self._add_spring_part(-1.0, same_pattern=True)
        try:
            yield
        finally:
            self._add_spring_part(1.0, same_pattern=True)

    def _add_spring_part(self, factor: float, same_pattern: bool) -> None:
        assert self._matrix is not None
        assert self._spring_part is not None
        add_scaled(
            self._matrix,
            factor,
            self._spring_part,
            destroy_term=False,
            same_pattern=same_pattern,
        )


class _ProjectedInterpolation:
    """Interpolation Pi P Pi_c of `LinearCoarseLevel`, as the Python context of a PETSc matrix.

    Args:
        P: matrix (n, n_linear) that interpolates vertex values at all nodes.
        fine: projection Pi that removes constrained components at nodes.
        coarse: projection Pi_c that removes constrained components at vertices.
    """

    def __init__(
        self, P: PETSc.Mat, fine: ConstraintProjection, coarse: ConstraintProjection
    ) -> None:
        self._P, self._fine, self._coarse = P, fine, coarse
        self._coarse_work, self._fine_work = P.createVecs()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        x.copy(self._coarse_work)
        self._coarse.zero_constrained_components(self._coarse_work.array)
        self._P.mult(self._coarse_work, y)
        self._fine.zero_constrained_components(y.array)

    def multAdd(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec, z: PETSc.Vec) -> None:
        self.mult(_, x, self._fine_work)
        z.array[:] = y.array_r + self._fine_work.array_r

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        x.copy(self._fine_work)
        self._fine.zero_constrained_components(self._fine_work.array)
        self._P.multTranspose(self._fine_work, y)
        self._coarse.zero_constrained_components(y.array)


class _InterpolationNearContact:
    """Rows of the interpolation at k nodes near contact.

    Two nodes are neighbours if the linear function of one vertex is nonzero at both of them. The
    nodes near contact are all nodes of the cells around neighbours of contact nodes.

    Args:
        P: interpolation (n, n_linear).
        space: fine space.
        contact_nodes: local numbers of the nodes that contact may constrain.

    Attributes:
        nodes: local numbers (k,) of the nodes near contact, in ascending order.
        rows: global numbers (k block,) of these nodes' unknowns.
        P: rows of the interpolation that belong to these unknowns.
    """

    def __init__(self, P: PETSc.Mat, space: fem.FunctionSpace, contact_nodes: Indices) -> None:
        index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
        owned = index_map.size_local
        fine, coarse = P.createVecLeft(), P.createVecRight()
        fine.array.reshape(-1, block)[contact_nodes] = 1.0
        P.multTranspose(fine, coarse)
        P.mult(coarse, fine)  # positive at nodes that share a vertex function with a contact node
        is_near = la.vector(index_map, 1)
        is_near.array[:] = 0.0
        is_near.array[:owned] = fine.array_r.reshape(-1, block).max(axis=1) > 0
        is_near.array[contact_nodes] = 1.0
        is_near.scatter_forward()
        topology = space.mesh.topology
        cells = space.dofmap.list[: topology.index_map(topology.dim).size_local]
        nodes_around = cells[(is_near.array[cells] > 0).any(axis=1)]
        is_near.array[:] = 0.0
        is_near.array[nodes_around] = 1.0
        is_near.scatter_reverse(la.InsertMode.add)
        self.nodes: Indices = np.flatnonzero(is_near.array[:owned]).astype(np.int64)
        numbers = self.nodes + index_map.local_range[0]
        self.rows: Indices = (numbers[:, None] * block + np.arange(block)).ravel()
        rows = index_set(self.rows, P.comm)
        columns = index_set(np.arange(*P.getOwnershipRangeColumn()), P.comm)
        self.P: PETSc.Mat = P.createSubMatrix(rows, columns)
        destroy_objects(fine, coarse, rows, columns)


class _NodeBlockJacobiSmoother:
    """Smoother that inverts the operator's diagonal blocks; Python context of a `PETSc.PC`.

    The operator is Pi (K + B) Pi + (1 - Pi), with the projection Pi that removes constrained
    components and the matrix B of springs between nodes.

    Args:
        K: stiffness (n, n).
        block: number of unknowns of a node.
    """

    def __init__(self, K: PETSc.Mat, block: int) -> None:
        self._K, self._block = K, block
        is_finite = bool(np.isfinite(self._inverse_diagonal_blocks()).all())
        if not K.comm.tompi4py().allreduce(is_finite, MPI.LAND):
            raise ValueError("a node has no stiffness")
        self._unconstrained = PETSc.PC().create(K.comm)
        self._unconstrained.setOperators(K)
        self._unconstrained.setType("pbjacobi")
        self._unconstrained.setUp()
        self._nodes: Indices = np.empty(0, dtype=np.int64)
        self._constrained_inverse: Array = np.empty((0, block, block))

    def update_constrained_blocks(
        self, projection: ConstraintProjection, springs: PETSc.Mat | None
    ) -> None:
        """Recompute the inverse blocks at constrained nodes and at nodes with springs."""
        nodes, stiffness = ((), 0.0) if springs is None else diagonal_blocks(springs, self._block)
        self._nodes, free, weighted = projection.constrained_nodes_free_projectors_and_stiffness(
            nodes
        )
        blocks = np.linalg.inv(self._inverse_diagonal_blocks()[self._nodes])
        blocks[np.searchsorted(self._nodes, nodes)] += stiffness
        self._constrained_inverse = np.asarray(np.linalg.inv(free @ blocks @ free + weighted))

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._unconstrained.apply(x, y)
        vectors = x.array_r.reshape(-1, self._block)[self._nodes]
        image = np.einsum("nij,nj->ni", self._constrained_inverse, vectors)
        y.array.reshape(-1, self._block)[self._nodes] = image

    def _inverse_diagonal_blocks(self) -> Array:
        """Return the inverse diagonal blocks (nodes, block, block) of K.

        The array is PETSc's memory and must not be changed.
        """
        inverse: Array = self._K.invertBlockDiagonal()
        return inverse.reshape(-1, self._block, self._block)


class Multigrid:
    """Two-level multigrid preconditioner for a matrix under supports and contact constraints.

    The operator is Pi (K + B) Pi + (1 - Pi). The projection Pi removes components that supports or
    `set_constrained_directions` constrain; B contains the springs that `set_constrained_directions`
    has received. The smoother is a Chebyshev polynomial of degree 2 with the inverse diagonal
    blocks of nodes. The coarse level uses one cycle of algebraic multigrid that knows the rigid
    motions. Its aggregates are chosen without springs, since an aggregate with nodes of two bodies
    could not represent the sliding of these bodies on each other. Products with K are computed in
    the blocked format, which makes them twice as fast.

    Args:
        K: matrix (n, n) without supports.
        supports: free unknowns of the space.

    Raises:
        ValueError: if a node has no stiffness.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports) -> None:
        self._block = supports.space.dofmap.index_map_bs
        needs_copy = self._block > 1 and not is_stored_in_blocks(K)
        self.block_matrix = K.convert("baij", PETSc.Mat()) if needs_copy else K
        self._projection = ConstraintProjection(supports.free, self._block)
        self._constrained = ConstrainedOperator(self.block_matrix, self._projection)
        self.operator = matrix_from_python_context(K.getSizes(), self._constrained, K.comm)
        self._smoother = _NodeBlockJacobiSmoother(self.block_matrix, self._block)
        self._linear = LinearCoarseLevel(K, supports, self._projection)
        self._smoother.update_constrained_blocks(self._projection, None)
        self._coarse_projectors: Array | None = None  # used in the coarse matrix
        self._aggregate_projectors: Array | None = None  # used to choose aggregates
        self._coarse: PETSc.Mat | None = None
        self._preconditioner: PETSc.PC | None = None
        self._has_aggregates = self._has_eigenvalues = False

    @property
    def coarse_matrix(self) -> PETSc.Mat:
        if self._coarse is None:
            self._coarse = self._linear.update_matrix()
        return self._coarse

    def set_up_levels(self) -> None:
        if self._preconditioner is None:
            return
        coarse = self._preconditioner.getMGCoarseSolve()
        coarse.setOperators(self.coarse_matrix)
        if not self._has_aggregates:
            with self._linear.springs_removed():
                coarse.setUp()
            self._has_aggregates = True
        coarse.setUp()
        if not self._has_eigenvalues:
            self._preconditioner.setUp()
            smoother = self._preconditioner.getMGSmoother(1)
            operators = smoother.getOperators()
            for operator in operators:
                operator.stateIncrease()  # otherwise PETSc keeps the old eigenvalues
            smoother.setUp()
            # without a reset, PETSc would keep the vectors of the eigenvalue estimate in memory
            smoother.reset()
            smoother.setOperators(*operators)
            self._has_eigenvalues = True

    def update_for_changed_matrix(self) -> None:
        """Discard all that depends on K after K has changed; it is computed again when needed."""
        self._linear.discard_matrix()
        self._has_eigenvalues = False
        self._discard_coarse_matrix(with_aggregates=True)

    def announce_changed_spring_pattern(self) -> None:
        """Announce that the springs of the next active set may connect other nodes.

        The smoother's eigenvalues are estimated again: with other springs they may be larger than
        the old bounds, and the smoother would then increase errors.
        """
        self._linear.has_changed_spring_pattern = True
        self._has_eigenvalues = False

    def re_estimate_smoother_eigenvalues(self) -> None:
        """Estimate the smoother's eigenvalues again, for the current constraints."""
        self._has_eigenvalues = False
        self.set_up_levels()

    def configure_petsc_pc(self, preconditioner: PETSc.PC) -> None:
        preconditioner.setType("mg")
        preconditioner.setUseAmat(True)
        preconditioner.setMGLevels(2)
        preconditioner.setMGInterpolation(1, self._linear.interpolation)
        smoother = preconditioner.getMGSmoother(1)
        smoother.setType("chebyshev")
        smoother.setTolerances(max_it=2)
        smoother.getPC().setType("python")
        smoother.getPC().setPythonContext(self._smoother)
        coarse = preconditioner.getMGCoarseSolve()
        coarse.setType("preonly")
        coarse.getPC().setType("gamg")
        coarse.setFromOptions()  # otherwise PETSc reads the options after the first aggregates
        self._preconditioner = preconditioner

    def set_constrained_directions(
        self,
        nodes: Indices,
        projectors: Array,
        stiffnesses: Array,
        springs: PETSc.Mat | None = None,
    ) -> None:
        """Constrain directions at contact nodes, in addition to the supports.

        The directions are constrained by the projection or, if `springs` are given, by the springs.
        The coarse matrix is assembled again if the projectors have changed at more than a tenth of
        the constrained nodes.

        Args:
            nodes: local numbers (m,) of the nodes, the same in each call.
            projectors: projectors (m, dim, dim) onto the constrained directions.
            stiffnesses: stiffnesses (m,) of the constrained directions.
            springs: matrix (n, n) of springs that constrain the directions instead of the
                projection. It must be given in all calls or in none.
        """
        self._constrained.springs = springs
        if springs is None:
            self._projection.set_constrained_directions(nodes, projectors, stiffnesses)
            self._linear.set_contact_nodes_once(nodes)
        is_first_call = self._coarse_projectors is None
        if self._coarse_projectors is None or self._aggregate_projectors is None:
            self._coarse_projectors = self._aggregate_projectors = np.zeros_like(projectors)
        is_constrained = np.abs(projectors).max(axis=(1, 2), initial=0.0) > 0
        aggregates_differ, coarse_differs = (
            np.abs(projectors - reference).max(axis=(1, 2), initial=0.0)
            > _MIN_COUNTED_PROJECTOR_CHANGE
            for reference in (self._aggregate_projectors, self._coarse_projectors)
        )
        counts = np.array([is_constrained.sum(), coarse_differs.sum(), aggregates_differ.sum()])
        self.block_matrix.comm.tompi4py().Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        self._smoother.update_constrained_blocks(self._projection, springs)
        lacks_springs = springs is not None and self._coarse is None
        if (
            is_first_call
            or lacks_springs
            or counts[1] > _CHANGED_NODE_FRACTION_TO_REBUILD_COARSE * counts[0]
        ):
            self._coarse_projectors = projectors
            self._linear.springs = springs
            if springs is None:
                self._linear.set_constrained_directions(nodes, projectors, stiffnesses)
            with_aggregates = (
                is_first_call
                or self._linear.has_changed_spring_pattern
                or counts[2] > _CHANGED_NODE_FRACTION_TO_REAGGREGATE * counts[0]
            )
            if with_aggregates:
                self._aggregate_projectors = projectors
            self._discard_coarse_matrix(with_aggregates)
        self.set_up_levels()

    def release(self) -> None:
        if self._preconditioner is not None:
            destroy_objects(self._preconditioner)
        destroy_objects(self.operator, self._linear.interpolation)

    def _discard_coarse_matrix(self, with_aggregates: bool) -> None:
        """Discard the coarse matrix; it is assembled again when it is needed.

        Args:
            with_aggregates: whether the aggregates of algebraic multigrid are chosen again.
        """
        if with_aggregates and self._coarse is not None and self._preconditioner is not None:
            self._preconditioner.getMGCoarseSolve().reset()
            self._has_aggregates = False
        self._coarse = None
        collect_garbage(self.block_matrix)

"""Two-level p-multigrid: quadratic functions on the fine level, linear ones on the coarse.

With P the interpolation of vertex values to all nodes, P^T K P is the stiffness of linear
elements, for standard and new elements alike. Nothing of K is copied or changed by supports:
what they (or contact) hold is taken out of vectors by a projection, Pi K Pi + (1 - Pi). Springs
between nodes are added to K.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem, la
from dolfinx.fem.petsc import interpolation_matrix

from pw_elements.arrays import Array, Indices
from pw_elements.checks import vector_sizes
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
    is_blocked,
    python_matrix,
)
from pw_elements.spaces import scalar_space

# Part of the held nodes whose change is worth a new coarse level, and new aggregates below it
_RENEWED = 0.1
_AGGREGATED = 0.5
# Change of a projector that counts: open to closed is one
_TURNED = 0.3


def linear_interpolation(space: fem.FunctionSpace) -> tuple[fem.FunctionSpace, Indices, PETSc.Mat]:
    """Linear functions on a space's mesh, and the matrix of their values at its nodes.

    Between them the local node at each owned vertex.
    """
    mesh, cells, block = space.mesh, space.dofmap.list, space.dofmap.index_map_bs
    shape = tuple(space.ufl_element().reference_value_shape)
    linear = fem.functionspace(mesh, ("Lagrange", 1, shape))
    index_map = linear.dofmap.index_map
    node = np.empty(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    corner = [dofs[0] for dofs in space.element.basix_element.entity_dofs[0]]
    node[linear.dofmap.list] = cells[:, corner]
    fine, coarse = (scalar_space(each) if block > 1 else each for each in (space, linear))
    every = interpolation_matrix(coarse, fine)
    every.assemble()
    indptr, indices, data = every.getValuesCSR()
    shape = len(indptr) - 1, index_map.size_global
    rows = sp.csr_array((np.round(data, 12), indices, indptr), shape)
    rows.eliminate_zeros()  # at corners that a node does not see
    rows = sp.kron(rows, sp.eye_array(block), "csr")
    csr = *(part.astype(PETSc.IntType) for part in (rows.indptr, rows.indices)), rows.data
    P = PETSc.Mat().createAIJ((vector_sizes(space), vector_sizes(linear)), csr=csr, comm=mesh.comm)
    destroy_objects(every)
    return linear, node[: index_map.size_local], P


def near_null_space(linear: fem.FunctionSpace) -> PETSc.NullSpace | None:
    """Rigid motions; None for fields that are no displacements, of which constants are known."""
    block, dim = linear.dofmap.index_map_bs, linear.mesh.geometry.dim
    if block != dim or dim == 1:
        return None
    sizes = vector_sizes(linear)
    places = PETSc.Vec().createMPI(sizes, bsize=block, comm=linear.mesh.comm)
    places.setArray(linear.tabulate_dof_coordinates()[: sizes[0] // dim, :dim].ravel())
    return PETSc.NullSpace().createRigidBody(places)


class LinearLevel:
    """The coarse level: P^T K P of linear functions, K being free, less what is held on each level.

    The matrix is P^T Pi K Pi P between the vertices' projections, with multiples of one where these
    hold. It is made once; then only the part near nodes that are held at times is exchanged. The
    interpolation from vertices to nodes is without what is held on either side.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports, fine: ConstraintProjection) -> None:
        space = supports.space
        self._K, self._fine, self._space = K, fine, space
        self._block = space.dofmap.index_map_bs
        linear, self._vertex_node, self._P = linear_interpolation(space)
        free = supports.free.reshape(-1, self._block)[self._vertex_node].ravel()
        self._held = ConstraintProjection(free, self._block)
        at_vertices, at_nodes = self._P.createVecs()
        for vector, mask in ((at_vertices, free), (at_nodes, supports.free)):
            vector.setArray(mask.astype(float))
        self._P.diagonalScale(at_nodes, at_vertices)
        self._near_null = near_null_space(linear)
        self._moved = _Interpolation(self._P, fine, self._held)
        self.interpolation = python_matrix(self._P.getSizes(), self._moved, K.comm)
        self.springs: PETSc.Mat | None = None
        self._near: _Near | None = None
        self._matrix: PETSc.Mat | None = None
        self._exchanged: PETSc.Mat | None = None  # the part of it that is

    def watch(self, nodes: Indices) -> None:
        if self._near is None:
            self._near = _Near(self._P, self._space, nodes)
            self._matrix = None

    def renew(self) -> None:
        self._near = self._matrix = None

    def hold(self, nodes: Indices, held: Array, weight: Array) -> None:
        """Holds at the vertices what is held at local nodes (m,), always the same ones."""
        vertex = np.flatnonzero(np.isin(self._vertex_node, nodes))
        order = np.argsort(nodes)
        at = order[np.searchsorted(nodes, self._vertex_node[vertex], sorter=order)]
        self._held.constrain(vertex, held[at], weight[at])

    def matrix(self) -> PETSc.Mat:
        """The matrix under what is held now, always the same object."""
        near, comm, columns = self._near, self._K.comm, self._P.getSizes()[1]
        again = self._matrix is not None  # and has places for what is exchanged
        if self._matrix is None:
            self._matrix = galerkin_product(self._K, self._P)
            self._exchanged = galerkin_product(self._K, near.P, near.rows) if near else None
        if self._exchanged is not None:
            add_scaled(self._matrix, -1.0, self._exchanged, same_pattern=again)
        free = self._held.free_projectors(np.arange(len(self._vertex_node)))
        part = None
        if self.springs is not None:
            part = galerkin_product(self.springs, self._P)
            add_scaled(self._matrix, 1.0, part, destroy_term=False, same_pattern=again)
        elif near is not None:
            left = block_diagonal_matrix(
                self._fine.free_projectors(near.nodes), near.P.getSizes()[0], comm
            )
            right = block_diagonal_matrix(free, columns, comm)
            half = left.matMult(near.P)
            P = half.matMult(right)  # what linear functions move near contact
            part = galerkin_product(self._K, P, near.rows)
            destroy_objects(left, right, half, P)
            add_scaled(self._matrix, 1.0, part, destroy_term=False, same_pattern=again)
        size = self._matrix.getDiagonal().sum() / columns[1]
        rest = block_diagonal_matrix(size * (np.eye(self._block) - free), columns, comm)
        add_scaled(self._matrix, 1.0, rest, destroy_term=False, same_pattern=again)
        if part is not None:
            add_scaled(part, 1.0, rest)
        self._exchanged = rest if part is None else part
        self._matrix.setBlockSize(self._block)
        if self._near_null is not None:
            self._matrix.setNearNullSpace(self._near_null)
        return self._matrix


class _Interpolation:
    """Pi P Pi_c, for `PETSc.Mat.createPython`."""

    def __init__(
        self, P: PETSc.Mat, fine: ConstraintProjection, coarse: ConstraintProjection
    ) -> None:
        self._P, self._fine, self._coarse = P, fine, coarse
        self._on_coarse, self._on_fine = P.createVecs()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        x.copy(self._on_coarse)
        self._coarse.remove_constrained(self._on_coarse.array)
        self._P.mult(self._on_coarse, y)
        self._fine.remove_constrained(y.array)

    def multAdd(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec, z: PETSc.Vec) -> None:
        self.mult(_, x, self._on_fine)
        z.array[:] = y.array_r + self._on_fine.array_r

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        x.copy(self._on_fine)
        self._fine.remove_constrained(self._on_fine.array)
        self._P.multTranspose(self._on_fine, y)
        self._coarse.remove_constrained(y.array)


class _Near:
    """Nodes whose interpolation may be held, and those that they couple to.

    Nodes (k,) are local and ascending; P has their rows of the interpolation, which are `rows`.
    """

    def __init__(self, P: PETSc.Mat, space: fem.FunctionSpace, held: Indices) -> None:
        index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
        owned = index_map.size_local
        fine, coarse = P.createVecLeft(), P.createVecRight()
        fine.array.reshape(-1, block)[held] = 1.0
        P.multTranspose(fine, coarse)
        P.mult(coarse, fine)  # all nodes that see a vertex which a held node sees
        touched = la.vector(index_map, 1)
        touched.array[:] = 0.0
        touched.array[:owned] = fine.array_r.reshape(-1, block).max(axis=1) > 0
        touched.array[held] = 1.0
        touched.scatter_forward()
        topology = space.mesh.topology
        cells = space.dofmap.list[: topology.index_map(topology.dim).size_local]
        around = cells[(touched.array[cells] > 0).any(axis=1)]
        touched.array[:] = 0.0
        touched.array[around] = 1.0
        touched.scatter_reverse(la.InsertMode.add)
        self.nodes: Indices = np.flatnonzero(touched.array[:owned]).astype(np.int64)
        numbers = self.nodes + index_map.local_range[0]
        self.rows: Indices = (numbers[:, None] * block + np.arange(block)).ravel()
        rows, columns = (
            index_set(some, P.comm) for some in (self.rows, np.arange(*P.getOwnershipRangeColumn()))
        )
        self.P: PETSc.Mat = P.createSubMatrix(rows, columns)
        destroy_objects(fine, coarse, rows, columns)


class _NodeBlocks:
    """Inverse of the diagonal blocks of Pi K Pi + (1 - Pi), for a `PETSc.PC` in Python."""

    def __init__(self, K: PETSc.Mat, block: int) -> None:
        self._K, self._block = K, block
        finite = bool(np.isfinite(self._inverse()).all())
        if not K.comm.tompi4py().allreduce(finite, MPI.LAND):
            raise ValueError("a node has no stiffness")
        self._every = PETSc.PC().create(K.comm)
        self._every.setOperators(K)
        self._every.setType("pbjacobi")
        self._every.setUp()
        self._nodes: Indices = np.empty(0, dtype=np.int64)
        self._other: Array = np.empty((0, block, block))

    def update(self, projection: ConstraintProjection, springs: PETSc.Mat | None) -> None:
        """Takes over what is held, and the blocks of springs."""
        nodes, sprung = ((), 0.0) if springs is None else diagonal_blocks(springs, self._block)
        self._nodes, free, rest = projection.constrained_blocks(nodes)
        own = np.linalg.inv(self._inverse()[self._nodes])
        own[np.searchsorted(self._nodes, nodes)] += sprung
        self._other = np.asarray(np.linalg.inv(free @ own @ free + rest))

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._every.apply(x, y)
        given = x.array_r.reshape(-1, self._block)[self._nodes]
        image = np.einsum("nij,nj->ni", self._other, given)
        y.array.reshape(-1, self._block)[self._nodes] = image

    def _inverse(self) -> Array:
        """Inverse blocks (nodes, block, block) of K, which PETSc keeps: not to be changed."""
        inverse: Array = self._K.invertBlockDiagonal()
        return inverse.reshape(-1, self._block, self._block)


class Multigrid:
    """The levels for one free matrix, and PETSc's preconditioner that runs through them.

    Smoother: Chebyshev polynomial of degree 2 with the inverse blocks of nodes. On the coarse level
    one cycle of algebraic multigrid that knows the rigid motions.

    K in blocks multiplies twice as fast. The operator is Pi (K + B) Pi + (1 - Pi) with the springs
    B of `hold`. A node without stiffness is a ValueError.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports) -> None:
        self._block = supports.space.dofmap.index_map_bs
        copied = self._block > 1 and not is_blocked(K)
        self.block_matrix = K.convert("baij", PETSc.Mat()) if copied else K
        self._projection = ConstraintProjection(supports.free, self._block)
        self._masked = ConstrainedOperator(self.block_matrix, self._projection)
        self.operator = python_matrix(K.getSizes(), self._masked, K.comm)
        self._smoother = _NodeBlocks(self.block_matrix, self._block)
        self._linear = LinearLevel(K, supports, self._projection)
        self._smoother.update(self._projection, None)
        self._held_before: Array | None = None  # when the coarse level was made
        self._aggregated: Array | None = None  # and when aggregates below it were
        self._coarse: PETSc.Mat | None = None
        self._preconditioner: PETSc.PC | None = None
        self._estimated = False

    @property
    def coarse_matrix(self) -> PETSc.Mat:
        if self._coarse is None:
            self._coarse = self._linear.matrix()
        return self._coarse

    def set_up_levels(self) -> None:
        if self._preconditioner is None:
            return
        coarse = self._preconditioner.getMGCoarseSolve()
        coarse.setOperators(self.coarse_matrix)
        coarse.setUp()
        if not self._estimated:
            self._preconditioner.setUp()
            smoother = self._preconditioner.getMGSmoother(1)
            operators = smoother.getOperators()
            for operator in operators:
                operator.stateIncrease()  # or it would keep eigenvalues
            smoother.setUp()
            # it would keep the vectors with which it has estimated them
            smoother.reset()
            smoother.setOperators(*operators)
            self._estimated = True

    def refresh(self) -> None:
        """Has everything made anew of what K has become."""
        self._linear.renew()
        self._estimated = False
        self._forget(hierarchy=True)

    def re_estimate_eigenvalues(self) -> None:
        """Has the smoother's eigenvalues estimated anew, for what is solved now."""
        self._estimated = False
        self.set_up_levels()

    def set_up(self, preconditioner: PETSc.PC) -> None:
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
        self._preconditioner = preconditioner

    def constrain(
        self,
        nodes: Indices,
        projectors: Array,
        stiffnesses: Array,
        springs: PETSc.Mat | None = None,
    ) -> None:
        """Holds directions at local nodes (m,), always the same ones, besides the supports.

        Projectors (m, dim, dim) are onto what is held, weights (m,) its stiffness; springs hold it
        if they are given, (n, n), always or never. The coarse level is made anew where it would
        differ at more than some of them.
        """
        self._masked.springs = springs
        if springs is None:
            self._projection.constrain(nodes, projectors, stiffnesses)
            self._linear.watch(nodes)
        first = self._held_before is None
        if self._held_before is None or self._aggregated is None:
            self._held_before = self._aggregated = np.zeros_like(projectors)
        some = np.abs(projectors).max(axis=(1, 2), initial=0.0) > 0
        since, other = (
            np.abs(projectors - before).max(axis=(1, 2), initial=0.0) > _TURNED
            for before in (self._aggregated, self._held_before)
        )
        counts = np.array([some.sum(), other.sum(), since.sum()])
        self.block_matrix.comm.tompi4py().Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        self._smoother.update(self._projection, springs)
        if first or counts[1] > _RENEWED * counts[0]:
            self._held_before = projectors
            self._linear.springs = springs
            if springs is None:
                self._linear.hold(nodes, projectors, stiffnesses)
            anew = first or counts[2] > _AGGREGATED * counts[0]
            if anew:
                self._aggregated = projectors
            self._forget(hierarchy=anew)
        self.set_up_levels()

    def release(self) -> None:
        if self._preconditioner is not None:
            destroy_objects(self._preconditioner)
        destroy_objects(self.operator, self._linear.interpolation)

    def _forget(self, hierarchy: bool) -> None:
        """Has the coarse level made anew; the hierarchy goes, too, or keeps its aggregates."""
        if hierarchy and self._coarse is not None and self._preconditioner is not None:
            self._preconditioner.getMGCoarseSolve().reset()
        self._coarse = None
        collect_garbage(self.block_matrix)

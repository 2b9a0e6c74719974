"""Two-level p-multigrid: quadratic functions on the fine level, linear ones on the coarse.

With P the interpolation of vertex values to all nodes, P^T K P is the stiffness of linear
elements, for standard and new elements alike. Nothing of K is copied or changed by supports:
what they (or contact) hold is taken out of vectors by a projection, Pi K Pi + (1 - Pi).
"""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from dolfinx.fem.petsc import interpolation_matrix
from scipy import sparse as sp
from scipy.sparse.csgraph import connected_components

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Rows of a matrix in blocks (a multiple of any block) that are converted at once, to save memory,
# and the most parts in which it is done, for their sum takes time
_AT_ONCE, _PARTS = 12_000, 32
# Part of the held nodes whose change is worth a new coarse level
_RENEWED = 0.02
# Change of a projector that counts: open to closed is one
_TURNED = 0.3


@dataclass(frozen=True)
class Supports:
    """Which degrees of freedom of a space are free, the others being prescribed.

    Args:
        space: of the trial functions.
        free: (owned dofs,).
    """

    space: fem.FunctionSpace
    free: npt.NDArray[np.bool_]


class Projection:
    """Takes the held parts out of vectors: whole unknowns, and directions at some nodes."""

    def __init__(self, free: npt.NDArray[np.bool_], block: int) -> None:
        self._free, self._block = free.astype(float), block
        none = np.empty(0)
        self.hold(none.astype(np.int64), none.reshape(0, block, block), none)

    def hold(self, nodes: Indices, held: Array, weight: Array) -> None:
        """Holds at local nodes (m,) what the projectors (m, block, block) leave of a vector.

        They get the stiffness `weight` (m,), prescribed unknowns 1.
        """
        self._nodes, self._held, self._weight = nodes, held, weight[:, None]

    def __call__(self, values: Array) -> Array:
        """What is free of a vector (owned dofs,)."""
        kept: Array = values * self._free
        if len(self._nodes):
            at = kept.reshape(-1, self._block)
            at[self._nodes] -= np.einsum("nij,nj->ni", self._held, at[self._nodes])
        return kept

    def rest(self, values: Array) -> Array:
        """What is held of it, weighted."""
        kept = values * self._free
        rest: Array = values - kept
        if len(self._nodes):
            at, to = kept.reshape(-1, self._block), rest.reshape(-1, self._block)
            to[self._nodes] += self._weight * np.einsum("nij,nj->ni", self._held, at[self._nodes])
        return rest

    def blocks(self) -> tuple[Indices, Array, Array]:
        """Nodes with anything held, projectors (k, block, block) onto what is free, and the rest.

        The latter is weighted.
        """
        free = self._free.reshape(-1, self._block)
        some = np.union1d(np.flatnonzero((free == 0).any(axis=1)), self._nodes)
        blocks = np.eye(self._block) * free[some][:, None, :]
        rest = np.eye(self._block) - blocks
        at = np.searchsorted(some, self._nodes)
        blocks[at] -= self._held
        rest[at] += self._weight[:, :, None] * self._held
        return some, blocks, rest

    def all_blocks(self) -> Array:
        """The projectors (nodes, block, block) onto what is free."""
        every = np.tile(np.eye(self._block), (len(self._free) // self._block, 1, 1))
        nodes, free, _ = self.blocks()
        every[nodes] = free
        return every


class Masked:
    """Pi K Pi + (1 - Pi), for `PETSc.Mat.createPython`."""

    def __init__(self, K: PETSc.Mat, projection: Projection) -> None:
        self._K, self._projection = K, projection
        self._kept = K.createVecRight()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        self._kept.array[:] = self._projection(x.array_r)
        self._K.mult(self._kept, y)
        y.array[:] = self._projection(y.array_r) + self._projection.rest(x.array_r)

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x under the transposed matrix."""
        self._kept.array[:] = self._projection(x.array_r)
        self._K.multTranspose(self._kept, y)
        y.array[:] = self._projection(y.array_r) + self._projection.rest(x.array_r)


class _NodeBlocks:
    """Inverse of the diagonal blocks of Pi K Pi + (1 - Pi), for a `PETSc.PC` in Python."""

    def __init__(self, inverse: Array, sizes: tuple[int, int], comm: PETSc.Comm) -> None:
        self._inverse, self._every = inverse, block_diagonal(inverse, sizes, comm)
        self._nodes: Indices = np.empty(0, dtype=np.int64)
        self._other: Array = inverse[:0]

    def update(self, projection: Projection) -> None:
        """Takes over what is held; only those nodes differ."""
        self._nodes, free, rest = projection.blocks()
        own = np.linalg.inv(self._inverse[self._nodes])
        self._other = np.asarray(np.linalg.inv(free @ own @ free + rest))

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        self._every.mult(x, y)
        block = self._inverse.shape[1]
        given = x.array_r.reshape(-1, block)[self._nodes]
        y.array.reshape(-1, block)[self._nodes] = np.einsum("nij,nj->ni", self._other, given)


class _Interpolation:
    """Pi P Pi_c, for `PETSc.Mat.createPython`."""

    def __init__(self, P: PETSc.Mat, fine: Projection, coarse: Projection) -> None:
        self._P, self._fine, self.coarse = P, fine, coarse
        self._on_coarse, self._on_fine = P.createVecs()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Values y at all nodes from x at vertices."""
        self._on_coarse.array[:] = self.coarse(x.array_r)
        self._P.mult(self._on_coarse, y)
        y.array[:] = self._fine(y.array_r)

    def multAdd(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec, z: PETSc.Vec) -> None:
        """The same, added to y."""
        self.mult(_, x, self._on_fine)
        z.array[:] = y.array_r + self._on_fine.array_r

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Forces y at vertices from x at all nodes."""
        self._on_fine.array[:] = self._fine(x.array_r)
        self._P.multTranspose(self._on_fine, y)
        y.array[:] = self.coarse(y.array_r)


class Multigrid:
    """The levels for one matrix, and PETSc's preconditioner that runs through them.

    Smoother: Chebyshev polynomial of degree 2 with the inverse blocks of nodes. On the coarse
    level one cycle of algebraic multigrid that knows the rigid motions.

    Args:
        K: (n, n), all rows and columns free.
        supports: of its space.

    Attributes:
        operator: Pi K Pi + (1 - Pi).
        blocked: K in blocks, with which it multiplies.

    Raises:
        ValueError: if a node has no stiffness.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports) -> None:
        space = supports.space
        self._K, self._block = K, space.dofmap.index_map_bs
        # twice as fast
        copied = self._block > 1 and not is_blocked(K)
        self.blocked = K.convert("baij", PETSc.Mat()) if copied else K
        self._projection = Projection(supports.free, self._block)
        self.operator = python_matrix(K.getSizes(), Masked(self.blocked, self._projection), K.comm)
        linear, self._vertex_node = _linear_space(space)
        at_vertices = supports.free.reshape(-1, self._block)[self._vertex_node].ravel()
        self._at_vertices = Projection(at_vertices, self._block)
        self._P = interpolation_matrix(linear, space)
        self._P.assemble()
        interpolation = _Interpolation(self._P, self._projection, self._at_vertices)
        self._interpolation = python_matrix(self._P.getSizes(), interpolation, K.comm)
        self._near_null = _near_null_space(linear)
        # a copy, for PETSc keeps this array for itself
        inverse = np.array(self.blocked.invertBlockDiagonal())
        inverse = inverse.reshape(-1, self._block, self._block)
        finite = bool(np.isfinite(inverse).all())
        if not K.comm.tompi4py().allreduce(finite, MPI.LAND):
            raise ValueError("a node has no stiffness")
        self._smoother = _NodeBlocks(inverse, K.getSizes()[0], K.comm)
        self._smoother.update(self._projection)
        self._held_before: Array = np.empty((0, self._block, self._block))
        self._coarse: PETSc.Mat | None = None
        self._coarse_ksp: PETSc.KSP | None = None

    @property
    def coarse(self) -> PETSc.Mat:
        """Linear elements' matrix under what is held, as it was last made."""
        if self._coarse is None:
            self._coarse = self._made_coarse()
        return self._coarse

    def ready(self) -> None:
        """Gives the coarse level to the preconditioner."""
        if self._coarse_ksp is not None:
            self._coarse_ksp.setOperators(self.coarse)

    def set_up(self, preconditioner: PETSc.PC) -> None:
        """Makes a preconditioner one of these levels; its options prefix has been set."""
        preconditioner.setType("mg")
        preconditioner.setMGLevels(2)
        preconditioner.setMGInterpolation(1, self._interpolation)
        smoother = preconditioner.getMGSmoother(1)
        smoother.setType("chebyshev")
        smoother.setTolerances(max_it=2)
        smoother.setOperators(self.operator, self.operator)
        smoother.getPC().setType("python")
        smoother.getPC().setPythonContext(self._smoother)
        self._coarse_ksp = preconditioner.getMGCoarseSolve()
        self._coarse_ksp.setType("preonly")
        self._coarse_ksp.getPC().setType("gamg")

    def hold(self, nodes: Indices, held: Array, weight: Array) -> None:
        """Holds directions at local nodes (m,), always the same ones, besides the supports.

        The coarse level is made anew where it would differ at more than a few of them.

        Args:
            nodes: (m,).
            held: projectors (m, dim, dim) onto what is held, zero for what is free.
            weight: (m,), stiffness of what is held.
        """
        self._projection.hold(nodes, held, weight)
        self._smoother.update(self._projection)
        before = self._held_before if len(self._held_before) else np.zeros_like(held)
        some = np.abs(held).max(axis=(1, 2), initial=0.0) > 0
        other = np.abs(held - before).max(axis=(1, 2), initial=0.0) > _TURNED
        counts = np.array([some.sum(), other.sum()])
        self._K.comm.tompi4py().Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        if counts[1] > _RENEWED * counts[0]:
            self._held_before = held
            vertex = np.flatnonzero(np.isin(self._vertex_node, nodes))
            order = np.argsort(nodes)
            at = order[np.searchsorted(nodes, self._vertex_node[vertex], sorter=order)]
            self._at_vertices.hold(vertex, held[at], weight[at])
            self._coarse = None
        self.ready()

    def _made_coarse(self) -> PETSc.Mat:
        """What linear functions make of Pi K Pi; where vertices are held, multiples of one."""
        fine, coarse = self._projection.all_blocks(), self._at_vertices.all_blocks()
        (rows, columns), comm = self._P.getSizes(), self._K.comm
        kept = block_diagonal(coarse, columns, comm, "aij")
        P = block_diagonal(fine, rows, comm, "aij").matMult(self._P).matMult(kept)
        made = _projected(self._K, P)
        size = made.getDiagonal().sum() / columns[1]
        held = block_diagonal(size * (np.eye(self._block) - coarse), columns, comm, "aij")
        made.axpy(1.0, held, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        made.setBlockSize(self._block)
        if self._near_null is not None:
            made.setNearNullSpace(self._near_null)
        return made


def connected_pieces(space: fem.FunctionSpace) -> tuple[npt.NDArray[np.int64], int]:
    """Number of the connected piece of the mesh that each node (ghosts too) belongs to."""
    comm, cells = space.mesh.comm, space.dofmap.list
    index_map = space.dofmap.index_map
    local = index_map.size_local + index_map.num_ghosts
    row = np.repeat(np.arange(len(cells)), cells.shape[1])
    shape = (len(cells), local)
    of_cell = sp.csr_matrix((np.ones(cells.size, dtype=np.int8), (row, cells.ravel())), shape)
    count, part = connected_components(of_cell.T @ of_cell, directed=False)
    first = sum(comm.allgather(count)[: comm.rank])
    # parts of two processes are one piece if they share a node: the owner's number tells which
    number = la.vector(index_map, 1)
    number.array[:] = part + first
    number.scatter_forward()
    ghosts = np.arange(index_map.size_local, local)
    ends = np.stack([part[ghosts] + first, number.array[ghosts].astype(np.int64)])
    total = comm.allreduce(count, MPI.SUM)
    links = np.unique(np.concatenate(comm.allgather(ends), axis=1), axis=1)
    graph = sp.csr_matrix((np.ones(links.shape[1]), links), (total, total))
    pieces, piece = connected_components(graph, directed=False)
    return piece[part + first].astype(np.int64), int(pieces)


def _linear_space(space: fem.FunctionSpace) -> tuple[fem.FunctionSpace, Indices]:
    """Linear functions on a space's mesh, and the local node of the space at each owned vertex."""
    mesh = space.mesh
    shape = space.ufl_element().reference_value_shape
    linear = fem.functionspace(mesh, ("Lagrange", 1, tuple(shape)))
    corner = [dofs[0] for dofs in space.element.basix_element.entity_dofs[0]]
    owned = linear.dofmap.index_map.size_local
    node = np.empty(owned + linear.dofmap.index_map.num_ghosts, dtype=np.int64)
    node[linear.dofmap.list] = space.dofmap.list[:, corner]
    return linear, node[:owned]


def _near_null_space(linear: fem.FunctionSpace) -> PETSc.NullSpace | None:
    """Rigid motions; None for fields that are no displacements, of which constants are known."""
    block, dim = linear.dofmap.index_map_bs, linear.mesh.geometry.dim
    if block != dim or dim == 1:
        return None
    index_map = linear.dofmap.index_map
    sizes = (index_map.size_local * block, index_map.size_global * block)
    places = PETSc.Vec().createMPI(sizes, bsize=block, comm=linear.mesh.comm)
    places.setArray(linear.tabulate_dof_coordinates()[: index_map.size_local, :dim].ravel())
    return PETSc.NullSpace().createRigidBody(places)


def is_blocked(matrix: PETSc.Mat) -> bool:
    """Whether a matrix is stored in blocks of nodes."""
    return "baij" in matrix.getType()


def _projected(K: PETSc.Mat, P: PETSc.Mat) -> PETSc.Mat:
    """P^T K P; PETSc has no such product of matrices in blocks: parts of them are converted."""
    if not is_blocked(K):
        product = K.ptap(P)
        made = product.copy()
        product.destroy()  # which keeps what it was made by
        return made
    comm, first, rows = K.comm, K.getOwnershipRange()[0], K.getLocalSize()[0]
    most = comm.tompi4py().allreduce(rows, MPI.MAX)
    at_once = _AT_ONCE * max(1, -(-most // (_AT_ONCE * _PARTS)))
    sets = [
        PETSc.IS().createStride(last - start, start, 1, comm=comm)
        for start, last in (K.getOwnershipRangeColumn(), P.getOwnershipRangeColumn())
    ]
    total = None
    for begin in range(0, most, at_once):
        start, last = min(begin, rows), min(begin + at_once, rows)
        mine = PETSc.IS().createStride(last - start, first + start, 1, comm=comm)
        K_part, P_part = (
            matrix.createSubMatrix(mine, columns)
            for matrix, columns in zip((K, P), sets, strict=True)
        )
        some = P_part.transposeMatMult(K_part.convert("aij", PETSc.Mat()).matMult(P))
        if total is None:
            total = some.copy()
        else:
            total.axpy(1.0, some, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        for matrix in (some, K_part, P_part):
            matrix.destroy()
    return total


def block_diagonal(
    blocks: Array, sizes: tuple[int, int], comm: PETSc.Comm, kind: str = "baij"
) -> PETSc.Mat:
    """Matrix of blocks (nodes, b, b) along its diagonal; `sizes` local and global."""
    n, b = blocks.shape[:2]
    first = comm.tompi4py().exscan(n) or 0
    if kind == "baij":
        indptr = np.arange(n + 1, dtype=PETSc.IntType)
        columns = np.arange(first, first + n, dtype=PETSc.IntType)
        csr = (indptr, columns, blocks.ravel())
        return PETSc.Mat().createBAIJ((sizes, sizes), b, csr=csr, comm=comm)
    indptr = b * np.arange(n * b + 1, dtype=PETSc.IntType)
    columns = np.arange(first * b, (first + n) * b).reshape(n, 1, b).repeat(b, axis=1)
    csr = (indptr, columns.ravel().astype(PETSc.IntType), blocks.ravel())
    return PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=comm)


def python_matrix(
    sizes: tuple[tuple[int, int], ...], context: object, comm: PETSc.Comm
) -> PETSc.Mat:
    """Matrix whose products a Python object makes."""
    matrix = PETSc.Mat().createPython(sizes, context, comm=comm)
    matrix.setUp()
    return matrix

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
        self.hold(np.empty(0, dtype=np.int64), np.empty((0, block, block)))

    def hold(self, nodes: Indices, held: Array) -> None:
        """Holds at local nodes (m,) what the projectors (m, block, block) leave of a vector."""
        self._nodes, self._held = nodes, held

    def __call__(self, values: Array) -> Array:
        """What is free of a vector (owned dofs,)."""
        kept: Array = values * self._free
        if len(self._nodes):
            at = kept.reshape(-1, self._block)
            at[self._nodes] -= np.einsum("nij,nj->ni", self._held, at[self._nodes])
        return kept

    def all_blocks(self) -> Array:
        """The projectors (nodes, block, block) onto what is free."""
        every = np.tile(np.eye(self._block), (len(self._free) // self._block, 1, 1))
        nodes, free = self.blocks()
        every[nodes] = free
        return every

    def blocks(self) -> tuple[Indices, Array]:
        """Nodes with anything held, and the projectors (k, block, block) onto what is free."""
        free = self._free.reshape(-1, self._block)
        some = np.union1d(np.flatnonzero((free == 0).any(axis=1)), self._nodes)
        blocks = np.eye(self._block) * free[some][:, None, :]
        blocks[np.searchsorted(some, self._nodes)] -= self._held
        return some, blocks


class Masked:
    """Pi K Pi + (1 - Pi), for `PETSc.Mat.createPython`."""

    def __init__(self, K: PETSc.Mat, projection: Projection) -> None:
        self._K, self._projection = K, projection
        self._kept = K.createVecRight()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        given = x.array_r
        kept = self._projection(given)
        self._kept.array[:] = kept
        self._K.mult(self._kept, y)
        y.array[:] = self._projection(y.array_r) + given - kept


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
        coarse: linear elements' matrix under what is held.
        coarse_set_ups: how often the coarse level was made.

    Raises:
        ValueError: if a node has no stiffness.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports) -> None:
        space = supports.space
        self._block = space.dofmap.index_map_bs
        # multiplies twice as fast
        blocked = K.convert("baij", PETSc.Mat()) if self._block > 1 else K
        self.projection = Projection(supports.free, self._block)
        self.operator = _python(K.getSizes(), Masked(blocked, self.projection), K.comm)
        linear, self._fine_node = _linear_space(space)
        self._coarse_projection = Projection(self._at_vertices(supports.free), self._block)
        P = interpolation_matrix(linear, space)
        P.assemble()
        self._K, self._P = K, P
        self._near_null = _near_null_space(linear)
        context = _Interpolation(P, self.projection, self._coarse_projection)
        self._interpolation = _python(P.getSizes(), context, K.comm)
        # a copy, for PETSc keeps this array for itself
        self._inverse = np.array(blocked.invertBlockDiagonal()).reshape(
            -1, self._block, self._block
        )
        finite = bool(np.isfinite(self._inverse).all())
        if not K.comm.tompi4py().allreduce(finite, MPI.LAND):
            raise ValueError("a node has no stiffness")
        self._smoothing = _block_diagonal(self._inverse, K.getSizes()[0], K.comm)
        self._changed: Indices = np.empty(0, dtype=np.int64)
        self._coarse_ksp: PETSc.KSP | None = None
        self.coarse_set_ups = 0
        self.update()

    def set_up(self, preconditioner: PETSc.PC) -> None:
        """Makes a preconditioner one of these levels; its options prefix has been set."""
        preconditioner.setType("mg")
        preconditioner.setMGLevels(2)
        preconditioner.setMGInterpolation(1, self._interpolation)
        smoother = preconditioner.getMGSmoother(1)
        smoother.setType("chebyshev")
        smoother.setTolerances(max_it=2)
        smoother.setOperators(self.operator, self._smoothing)
        smoother.getPC().setType("mat")
        self._coarse_ksp = preconditioner.getMGCoarseSolve()
        self._coarse_ksp.setType("preonly")
        self._coarse_ksp.getPC().setType("gamg")
        self._coarse_ksp.setOperators(self.coarse)

    def hold(self, nodes: Indices, held: Array) -> None:
        """Holds directions at local nodes in addition to the supports, on the fine level."""
        self.projection.hold(nodes, held)
        self.update_smoother()

    def update(self) -> None:
        """Brings both levels up to what is held now."""
        self.update_smoother()
        self.update_coarse()

    def update_smoother(self) -> None:
        """Block inverses of Pi K Pi + (1 - Pi); only nodes where something is held differ."""
        nodes, free = self.projection.blocks()
        one = np.eye(self._block)
        values = free @ np.linalg.inv(self._inverse[nodes]) @ free + one - free
        back = np.setdiff1d(self._changed, nodes)
        first = self._smoothing.getOwnershipRange()[0] // self._block
        for where, blocks in ((back, self._inverse[back]), (nodes, np.linalg.inv(values))):
            for node, block in zip(where + first, blocks, strict=True):
                self._smoothing.setValuesBlocked(node, node, block)
        self._smoothing.assemble()
        self._changed = nodes

    def update_coarse(self) -> None:
        """What linear functions make of Pi K Pi; where vertices are held, multiples of one."""
        fine, coarse = self.projection.all_blocks(), self._coarse_projection.all_blocks()
        sizes = self._P.getSizes()
        kept = _block_diagonal(coarse, sizes[1], self._K.comm, "aij")
        P = _block_diagonal(fine, sizes[0], self._K.comm, "aij").matMult(self._P).matMult(kept)
        self.coarse = self._K.ptap(P)
        size = self.coarse.getDiagonal().sum() / sizes[1][1]
        held = size * (np.eye(self._block) - coarse)
        self.coarse.axpy(
            1.0,
            _block_diagonal(held, sizes[1], self._K.comm, "aij"),
            PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN,
        )
        self.coarse.setBlockSize(self._block)
        if self._near_null is not None:
            self.coarse.setNearNullSpace(self._near_null)
        if self._coarse_ksp is not None:
            self._coarse_ksp.setOperators(self.coarse)
        self.coarse_set_ups += 1

    def _at_vertices(self, values: npt.NDArray) -> npt.NDArray:
        """Values (owned dofs,) at the vertices' nodes."""
        return values.reshape(-1, self._block)[self._fine_node].ravel()


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


def _block_diagonal(
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


def _python(sizes: tuple[tuple[int, int], ...], context: object, comm: PETSc.Comm) -> PETSc.Mat:
    matrix = PETSc.Mat().createPython(sizes, context, comm=comm)
    matrix.setUp()
    return matrix

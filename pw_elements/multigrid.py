"""Two-level p-multigrid: quadratic functions on the fine level, linear ones on the coarse.

With P the interpolation of vertex values to all nodes, P^T K P is the stiffness of linear
elements, for standard and new elements alike. Nothing of K is copied or changed by supports:
what they (or contact) hold is taken out of vectors by a projection, Pi K Pi + (1 - Pi).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from scipy import sparse as sp
from scipy.sparse.csgraph import connected_components

from pw_elements.ties import Ties, diagonal_blocks

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

    def blocks(self, others: Sequence[int] | Indices = ()) -> tuple[Indices, Array, Array]:
        """Nodes with anything held, projectors (k, block, block) onto what is free, and the rest.

        The latter is weighted; `others` are nodes that are wanted, too.
        """
        free = self._free.reshape(-1, self._block)
        held = np.union1d(np.flatnonzero((free == 0).any(axis=1)), self._nodes)
        some = np.union1d(held, np.asarray(others, dtype=np.int64))
        blocks = np.eye(self._block) * free[some][:, None, :]
        rest = np.eye(self._block) - blocks
        at = np.searchsorted(some, self._nodes)
        blocks[at] -= self._held
        rest[at] += self._weight[:, :, None] * self._held
        return some, blocks, rest

    def all_blocks(self) -> Array:
        """The projectors (nodes, block, block) onto what is free."""
        return self.blocks_at(np.arange(len(self._free) // self._block))

    def blocks_at(self, some: Indices) -> Array:
        """The same at some nodes (k,), in ascending order."""
        every = np.tile(np.eye(self._block), (len(some), 1, 1))
        nodes, free, _ = self.blocks()
        mine = np.isin(nodes, some)
        every[np.searchsorted(some, nodes[mine])] = free[mine]
        return every


class Masked:
    """Pi W^T K W Pi + (1 - Pi), for `PETSc.Mat.createPython`; W is one without ties."""

    def __init__(self, K: PETSc.Mat, projection: Projection) -> None:
        self._K, self._projection = K, projection
        self._kept = K.createVecRight()
        self.ties: Ties | None = None

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        self._kept.array[:] = self._projection(x.array_r)
        if self.ties:
            self.ties.follow(self._kept)
        self._K.mult(self._kept, y)
        if self.ties:
            self.ties.hand_on(y)
        y.array[:] = self._projection(y.array_r) + self._projection.rest(x.array_r)

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x under the transposed matrix."""
        self._kept.array[:] = self._projection(x.array_r)
        if self.ties:
            self.ties.follow(self._kept)
        self._K.multTranspose(self._kept, y)
        if self.ties:
            self.ties.hand_on(y)
        y.array[:] = self._projection(y.array_r) + self._projection.rest(x.array_r)


class _NodeBlocks:
    """Inverse of the diagonal blocks of Pi K Pi + (1 - Pi), for a `PETSc.PC` in Python.

    Raises:
        ValueError: if a node has no stiffness.
    """

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

    def update(self, projection: Projection, nodes: Indices, carried: Array) -> None:
        """Takes over what is held; only those nodes differ, and those (k,) that others follow.

        The latter carry blocks (k, block, block) of the others.
        """
        self._nodes, free, rest = projection.blocks(nodes)
        own = np.linalg.inv(self._inverse()[self._nodes])
        own[np.searchsorted(self._nodes, nodes)] += carried
        self._other = np.asarray(np.linalg.inv(free @ own @ free + rest))

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        self._every.apply(x, y)
        given = x.array_r.reshape(-1, self._block)[self._nodes]
        image = np.einsum("nij,nj->ni", self._other, given)
        y.array.reshape(-1, self._block)[self._nodes] = image

    def _inverse(self) -> Array:
        """Inverse blocks (nodes, block, block) of K, which PETSc keeps: not to be changed."""
        inverse: Array = self._K.invertBlockDiagonal()
        return inverse.reshape(-1, self._block, self._block)


class _Interpolation:
    """Pi P Pi_c, for `PETSc.Mat.createPython`."""

    def __init__(self, P: PETSc.Mat, fine: Projection, coarse: Projection) -> None:
        self._P, self._fine, self.coarse = P, fine, coarse
        self._on_coarse, self._on_fine = P.createVecs()
        self.ties: Ties | None = None

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Values y at all nodes from x at vertices."""
        self._on_coarse.array[:] = self.coarse(x.array_r)
        if self.ties:
            self.ties.follow(self._on_coarse)
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
        if self.ties:
            self.ties.hand_on(y)
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
        self._masked = Masked(self.blocked, self._projection)
        self.operator = python_matrix(K.getSizes(), self._masked, K.comm)
        linear, self._vertex_node = _linear_space(space)
        at_vertices = supports.free.reshape(-1, self._block)[self._vertex_node].ravel()
        self._at_vertices = Projection(at_vertices, self._block)
        self._P = _interpolation_matrix(linear, space, supports.free, at_vertices)
        self._interpolated = _Interpolation(self._P, self._projection, self._at_vertices)
        self._interpolation = python_matrix(self._P.getSizes(), self._interpolated, K.comm)
        self._near_null = _near_null_space(linear)
        self._smoother = _NodeBlocks(self.blocked, self._block)
        self._smoother.update(self._projection, *self._carried())
        self._space = space
        self._held_before: Array = np.empty((0, self._block, self._block))
        self._near: _Near | None = None
        self._tied: PETSc.Mat | None = None
        self._fixed: PETSc.Mat | None = None
        self._coarse: PETSc.Mat | None = None
        self._preconditioner: PETSc.PC | None = None
        self._estimated = False

    @property
    def coarse(self) -> PETSc.Mat:
        """Linear elements' matrix under what is held, as it was last made."""
        if self._coarse is None:
            self._coarse = self._made_coarse()
        return self._coarse

    def ready(self) -> None:
        """Gives the coarse level to the preconditioner."""
        if self._preconditioner is None:
            return
        self._preconditioner.getMGCoarseSolve().setOperators(self.coarse)
        if not self._estimated:
            self._preconditioner.setUp()
            # it would keep the vectors with which it has estimated eigenvalues
            smoother = self._preconditioner.getMGSmoother(1)
            operators = smoother.getOperators()
            smoother.reset()
            smoother.setOperators(*operators)
            self._estimated = True

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
        coarse = preconditioner.getMGCoarseSolve()
        coarse.setType("preonly")
        coarse.getPC().setType("gamg")
        self._preconditioner = preconditioner

    def tie(self, nodes: Indices, opposite: PETSc.Mat) -> Ties:
        """Has what is held of local nodes (m,) follow others from now on, by (m block, n) weights.

        A body that nothing else holds is then held by the other one.
        """
        vertex, at = self._vertices_of(nodes)
        self._interpolated.ties = Ties(opposite.matMult(self._P), vertex, self._block, at)
        self._masked.ties = Ties(opposite, nodes, self._block)
        return self._masked.ties

    def _vertices_of(self, nodes: Indices) -> tuple[Indices, Indices]:
        """Local vertices (k,) among local nodes (m,), and which of the nodes they are."""
        vertex = np.flatnonzero(np.isin(self._vertex_node, nodes))
        order = np.argsort(nodes)
        return vertex, order[np.searchsorted(nodes, self._vertex_node[vertex], sorter=order)]

    def _carried(self) -> tuple[Indices, Array]:
        """Nodes (k,) that others follow, and the blocks (k, block, block) of K they so get."""
        ties = self._masked.ties
        if ties is None:
            return np.empty(0, dtype=np.int64), np.empty((0, self._block, self._block))
        near, comm = self._near, self._K.comm
        assert near is not None, "what is held at times is known before"
        if self._tied is None:
            first = near.K.getOwnershipRange()[0] // self._block
            rows = first + np.searchsorted(near.nodes, np.sort(ties.nodes))
            held = PETSc.IS().createBlock(self._block, rows.astype(PETSc.IntType), comm=comm)
            self._tied = near.K.createSubMatrix(held, held)
        order = np.argsort(np.argsort(ties.nodes))
        followed = ties.followed(order, len(order))
        carried = self._tied.ptap(followed)
        found = diagonal_blocks(carried, self._block)
        _destroy(carried, followed)
        return found

    def hold(self, nodes: Indices, held: Array, weight: Array) -> None:
        """Holds directions at local nodes (m,), always the same ones, besides the supports.

        The coarse level is made anew where it would differ at more than a few of them.

        Args:
            nodes: (m,).
            held: projectors (m, dim, dim) onto what is held, zero for what is free.
            weight: (m,), stiffness of what is held.
        """
        self._projection.hold(nodes, held, weight)
        if self._masked.ties:
            self._masked.ties.hold(held)
        before = self._held_before if len(self._held_before) else np.zeros_like(held)
        some = np.abs(held).max(axis=(1, 2), initial=0.0) > 0
        other = np.abs(held - before).max(axis=(1, 2), initial=0.0) > _TURNED
        counts = np.array([some.sum(), other.sum()])
        self._K.comm.tompi4py().Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        if self._near is None:
            self._near = _Near.of(self.blocked, self._P, self._space, nodes)
            self._forget()
            self._fixed = None
        self._smoother.update(self._projection, *self._carried())
        if counts[1] > _RENEWED * counts[0]:
            self._held_before = held
            vertex, at = self._vertices_of(nodes)
            self._at_vertices.hold(vertex, held[at], weight[at])
            if self._interpolated.ties:
                self._interpolated.ties.hold(held[at])
            self._forget()
        self.ready()

    def _forget(self) -> None:
        """Frees the coarse level before another one is made."""
        if self._coarse is not None:
            if self._preconditioner is not None:
                self._preconditioner.getMGCoarseSolve().reset()
            self._coarse.destroy()
            self._coarse = None
        collect_garbage(self._K, self._P)

    def _made_coarse(self) -> PETSc.Mat:
        """What linear functions make of Pi K Pi; where vertices are held, multiples of one.

        What lies far from the nodes that are held at times is computed once.
        """
        near, comm, columns = self._near, self._K.comm, self._P.getSizes()[1]
        if self._fixed is None:
            self._fixed = _projected(self._K, self._P)
            if near is not None:
                _add(self._fixed, -1.0, _projected(near.K, near.P))
        made = self._fixed.copy()
        coarse = self._at_vertices.all_blocks()
        if near is not None:
            P = self._moved_near(near, coarse)
            _add(made, 1.0, _projected(near.K, P))
            _destroy(P)
        size = made.getDiagonal().sum() / columns[1]
        _add(made, 1.0, block_diagonal(size * (np.eye(self._block) - coarse), columns, comm, "aij"))
        made.setBlockSize(self._block)
        if self._near_null is not None:
            made.setNearNullSpace(self._near_null)
        return made

    def _moved_near(self, near: "_Near", coarse: Array) -> PETSc.Mat:
        """What linear functions, (vertices, block, block) of which are free, move near contact."""
        columns, comm = self._P.getSizes()[1], self._K.comm
        fine = self._projection.blocks_at(near.nodes)
        left = block_diagonal(fine, near.P.getSizes()[0], comm, "aij")
        right = block_diagonal(coarse, columns, comm, "aij")
        at_nodes, at_vertices = self._masked.ties, self._interpolated.ties
        if at_vertices is not None:
            followed = at_vertices.followed(at_vertices.nodes, len(coarse))
            _add(right, 1.0, followed.matMult(right))
            _destroy(followed)
        half = left.matMult(near.P)
        P = half.matMult(right)
        if at_nodes is not None and at_vertices is not None:
            rows = np.searchsorted(near.nodes, at_nodes.nodes)
            followed = at_nodes.followed(rows, len(near.nodes), at_vertices.opposite)
            _add(P, 1.0, followed.matMult(right))
            _destroy(followed)
        _destroy(left, right, half)
        return P


@dataclass(frozen=True)
class _Near:
    """The part of K at nodes whose interpolation may be held, and at those that they couple to.

    Args:
        nodes: (k,), local, ascending.
        K: (k block, k block).
        P: rows of the interpolation.
    """

    nodes: Indices
    K: PETSc.Mat
    P: PETSc.Mat

    @classmethod
    def of(cls, K: PETSc.Mat, P: PETSc.Mat, space: fem.FunctionSpace, held: Indices) -> "_Near":
        """Around the local nodes that are held at times."""
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
        nodes = np.flatnonzero(touched.array[:owned]).astype(np.int64)
        numbers = (nodes + index_map.local_range[0]).astype(PETSc.IntType)
        rows = PETSc.IS().createBlock(block, numbers, comm=K.comm)
        start, last = P.getOwnershipRangeColumn()
        columns = PETSc.IS().createStride(last - start, start, 1, comm=K.comm)
        part = K.createSubMatrix(rows, rows)
        near = part
        if is_blocked(part):
            near = part.convert("aij", PETSc.Mat())
            _destroy(part)
        made = cls(nodes, near, P.createSubMatrix(rows, columns))
        _destroy(fine, coarse, rows, columns)
        return made


def connected_pieces(space: fem.FunctionSpace) -> tuple[npt.NDArray[np.int64], int]:
    """Number of the connected piece of the mesh that each node (ghosts too) belongs to."""
    comm, cells = space.mesh.comm, space.dofmap.list
    index_map = space.dofmap.index_map
    local = index_map.size_local + index_map.num_ghosts
    others = cells[:, 1:]  # a cell's first node links them
    edges = (np.repeat(cells[:, 0], others.shape[1]), others.ravel())
    graph = sp.csr_matrix((np.ones(others.size, dtype=np.int8), edges), (local, local))
    count, part = connected_components(graph, directed=False)
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


def _interpolation_matrix(
    linear: fem.FunctionSpace,
    space: fem.FunctionSpace,
    free: npt.NDArray[np.bool_],
    at_vertices: npt.NDArray[np.bool_],
) -> PETSc.Mat:
    """Values at free nodes from those at free vertices; DOLFINx's has a cell's zeros, too."""
    element, corners = space.element.basix_element, linear.element.basix_element
    values = corners.tabulate(0, np.asarray(element.points))[0, :, :, 0]
    weights: Array = np.round(np.asarray(element.interpolation_matrix) @ values, 12)
    cells, block = space.dofmap.list, space.dofmap.index_map_bs
    owned = space.dofmap.index_map.size_local
    index_map = linear.dofmap.index_map
    entry = np.empty(owned + space.dofmap.index_map.num_ghosts, dtype=np.int64)
    entry[cells] = np.arange(cells.size).reshape(cells.shape)
    cell, place = np.divmod(entry[:owned], cells.shape[1])
    vertices = linear.dofmap.list[cell]
    columns = index_map.local_to_global(vertices.ravel()).reshape(vertices.shape)
    columns = columns.astype(PETSc.IntType)
    order = np.argsort(columns, axis=1)
    columns = np.take_along_axis(columns, order, axis=1)
    weight = np.take_along_axis(weights[place], order, axis=1)
    shape = (owned, block, columns.shape[1])
    some = np.broadcast_to((weight != 0)[:, None], shape)
    components = np.arange(block, dtype=PETSc.IntType)[:, None]
    indices = (columns[:, None] * block + components)[some]
    data = np.broadcast_to(weight[:, None], shape)[some]
    indptr = np.zeros(owned * block + 1, dtype=PETSc.IntType)
    np.cumsum(some.sum(axis=2).ravel(), out=indptr[1:])
    sizes = tuple(
        (m.size_local * block, m.size_global * block) for m in (space.dofmap.index_map, index_map)
    )
    P = PETSc.Mat().createAIJ(sizes, csr=(indptr, indices, data), comm=space.mesh.comm)
    coarse, fine = P.createVecs()
    fine.setArray(free.astype(float))
    coarse.setArray(at_vertices.astype(float))
    P.diagonalScale(fine, coarse)
    return P


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
        plain = K_part.convert("aij", PETSc.Mat())
        _destroy(K_part)
        half = plain.matMult(P)
        some = P_part.transposeMatMult(half)
        if total is None:
            total = some.copy()
            _destroy(some)
        else:
            _add(total, 1.0, some)
        _destroy(plain, half, P_part, mine)
    _destroy(*sets)
    return total


def _add(total: PETSc.Mat, factor: float, some: PETSc.Mat) -> None:
    """Adds a multiple of a matrix, which is no longer needed then."""
    total.axpy(factor, some, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    _destroy(some)


def _destroy(*things: PETSc.Object) -> None:
    """Frees what Python alone would not on several processes, see `collect_garbage`."""
    for thing in things:
        thing.destroy()


def collect_garbage(*like: PETSc.Object) -> None:
    """Frees objects that have gone out of use and live where these do; collective.

    On several processes petsc4py leaves them alone until then: Python may drop them in any order.
    """
    for thing in like:
        PETSc.garbage_cleanup(thing.comm)


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

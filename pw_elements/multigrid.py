"""Two-level p-multigrid: quadratic functions on the fine level, linear ones on the coarse.

With P the interpolation of vertex values to all nodes, P^T K P is the stiffness of linear
elements, for standard and new elements alike. Nothing of K is copied or changed by supports:
what they (or contact) hold is taken out of vectors by a projection, Pi K Pi + (1 - Pi), or moves
with other nodes, see `ties`.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.linear_level import LinearLevel
from pw_elements.matrices import collect_garbage, destroy, is_blocked, python_matrix
from pw_elements.projection import Masked, Projection, Supports
from pw_elements.ties import Ties

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Part of the held nodes whose change is worth a new coarse level, and new aggregates below it
_RENEWED, _AGGREGATED = 0.1, 0.5
# Change of a projector that counts: open to closed is one
_TURNED = 0.3


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


class Multigrid:
    """The levels for one matrix, and PETSc's preconditioner that runs through them.

    Smoother: Chebyshev polynomial of degree 2 with the inverse blocks of nodes. On the coarse
    level one cycle of algebraic multigrid that knows the rigid motions.

    The blocks are those of Pi K Pi + (1 - Pi), but what is smoothed, and whose residual goes to
    the coarse level, is the operator that is solved: that matrix of a linear problem, E K + C of
    contact. With the former alone, contact takes four tenths more iterations.

    Args:
        K: (n, n), all rows and columns free.
        supports: of its space.

    Attributes:
        operator: Pi W^T K W Pi + (1 - Pi); W is one unless `tie` says more.
        blocked: K in blocks, with which it multiplies.

    Raises:
        ValueError: if a node has no stiffness.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports) -> None:
        self._block = supports.space.dofmap.index_map_bs
        # twice as fast
        copied = self._block > 1 and not is_blocked(K)
        self.blocked = K.convert("baij", PETSc.Mat()) if copied else K
        self._projection = Projection(supports.free, self._block)
        self._masked = Masked(self.blocked, self._projection)
        self.operator = python_matrix(K.getSizes(), self._masked, K.comm)
        self._smoother = _NodeBlocks(self.blocked, self._block)
        self._linear = LinearLevel(K, supports, self._projection)
        self._smoother.update(self._projection, *self._linear.carried())
        self._held_before: Array | None = None  # when the coarse level was made
        self._aggregated: Array | None = None  # and when aggregates below it were
        self._coarse: PETSc.Mat | None = None
        self._preconditioner: PETSc.PC | None = None
        self._estimated = False

    @property
    def coarse(self) -> PETSc.Mat:
        """Linear elements' matrix under what is held, as it was last made."""
        if self._coarse is None:
            self._coarse = self._linear.matrix()
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

    def tie(self, nodes: Indices, opposite: PETSc.Mat) -> Ties:
        """Has what is held of local nodes (m,) follow others from now on, by (m block, n) weights.

        A body that nothing else holds is then held by the other one.
        """
        self._masked.ties = Ties(opposite, nodes, self._block)
        self._linear.tie(self._masked.ties)
        return self._masked.ties

    def hold(self, nodes: Indices, held: Array, weight: Array) -> None:
        """Holds directions at local nodes (m,), always the same ones, besides the supports.

        The coarse level is made anew where it would differ at more than some of them.

        Args:
            nodes: (m,).
            held: projectors (m, dim, dim) onto what is held, zero for what is free.
            weight: (m,), stiffness of what is held.
        """
        self._projection.hold(nodes, held, weight)
        if self._masked.ties:
            self._masked.ties.hold(held)
        first = self._held_before is None
        if self._held_before is None or self._aggregated is None:
            self._held_before = self._aggregated = np.zeros_like(held)
        some = np.abs(held).max(axis=(1, 2), initial=0.0) > 0
        since, other = (
            np.abs(held - before).max(axis=(1, 2), initial=0.0) > _TURNED
            for before in (self._aggregated, self._held_before)
        )
        counts = np.array([some.sum(), other.sum(), since.sum()])
        self.blocked.comm.tompi4py().Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        self._linear.watch(nodes)
        self._smoother.update(self._projection, *self._linear.carried())
        if first or counts[1] > _RENEWED * counts[0]:
            self._held_before = held
            self._linear.hold(nodes, held, weight)
            anew = first or counts[2] > _AGGREGATED * counts[0] or not self._linear.keeps_pattern
            if anew:
                self._aggregated = held
            self._forget(hierarchy=anew)
        self.ready()

    def release(self) -> None:
        """Frees what PETSc's objects hold of Python's, on all processes."""
        if self._preconditioner is not None:
            destroy(self._preconditioner)
        destroy(self.operator, self._linear.interpolation)

    def _forget(self, hierarchy: bool) -> None:
        """Has the coarse level made anew.

        The hierarchy below it is forgotten, too, or keeps its aggregates, which is cheaper.
        """
        if hierarchy and self._coarse is not None and self._preconditioner is not None:
            self._preconditioner.getMGCoarseSolve().reset()
        self._coarse = None
        collect_garbage(self.blocked)

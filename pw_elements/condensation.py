"""Static condensation of inner nodes, each of which has a stiffness of its own."""

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.collective import collective
from pw_elements.conditions import check_any, prescribed
from pw_elements.given import Problem
from pw_elements.hybrid import is_hybrid
from pw_elements.linear_solver import SingularSystem
from pw_elements.matrices import selection, unblocked
from pw_elements.parts import numbered

# Entries of a matrix below this, over its largest, are zeros
_ROUND_OFF = 1e-13


def condensed(
    K: PETSc.Mat,
    space: fem.FunctionSpace,
    nodes: npt.NDArray[np.integer] | npt.NDArray[np.bool_],
    conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
) -> tuple[PETSc.Mat, PETSc.Mat, PETSc.Vec, PETSc.Mat]:
    """L, R, a_0 and Q of `Reduction.condensation`, which says what it takes and raises."""
    Problem({"the stiffness": K}, space=space)
    if is_hybrid(space):
        raise ValueError("nodes of hybrid spaces cannot be condensed: their pressures stay")
    K = unblocked(K)
    free, offset = prescribed(space, conditions)
    block, index_map = space.dofmap.index_map_bs, space.dofmap.index_map
    comm = space.mesh.comm
    inner = np.zeros(len(free), dtype=bool)
    with collective(comm):
        known = index_map.size_local + index_map.num_ghosts
        chosen = numbered(comm, "the nodes to be condensed", nodes, known)
        inner.reshape(-1, block)[chosen[chosen < index_map.size_local]] = True
        if np.any(inner & ~free):
            raise ValueError("a Dirichlet condition holds on a node that is to be condensed")
    check_any(free & ~inner, space, "there is nothing but inner and prescribed nodes")
    Q = _inner_flexibility(K, inner, block)
    kept = selection(free & ~inner, offset)
    right, left = kept.copy(), kept.copy()
    different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
    right.axpy(-1.0, Q.matMult(K.matMult(kept)), different)
    left.axpy(-1.0, Q.transposeMatMult(K.transposeMatMult(kept)), different)
    return left, right, offset, Q


def _inner_flexibility(K: PETSc.Mat, inner: npt.NDArray[np.bool_], block: int) -> PETSc.Mat:
    """Q (n, n): inverse of K_ii, whose blocks belong to one node each, and zeros.

    Raises:
        ValueError: if K couples inner nodes.
        SingularSystem: if a block is singular.
    """
    comm: MPI.Comm = K.comm.tompi4py()
    chosen = selection(inner, K.createVecLeft())
    K_ii = chosen.transposeMatMult(K.matMult(chosen))
    first, last = K_ii.getOwnershipRange()
    indptr, column, value = K_ii.getValuesCSR()
    row = np.repeat(np.arange(first, last), np.diff(indptr))
    own = row // block == column // block
    blocks = np.zeros(((last - first) // block, block, block))
    blocks[(row[own] - first) // block, row[own] % block, column[own] % block] = value[own]
    size = comm.allreduce(np.abs(blocks).max(initial=0.0), MPI.MAX)
    with collective(comm):
        if not np.isfinite(value).all():
            raise ValueError("the stiffness of a node that is to be condensed is not finite")
        if np.abs(value[~own]).max(initial=0.0) > _ROUND_OFF * size:
            raise ValueError(
                "the stiffness couples nodes that are to be condensed: no two of them may share a "
                "cell"
            )
        if len(blocks) and not np.all(np.linalg.cond(blocks) < 1 / _ROUND_OFF):
            raise SingularSystem("a node that is to be condensed has no stiffness")
    inverse = np.linalg.inv(blocks)

    width = np.where(inner, block, 0)
    indptr = np.concatenate(([0], np.cumsum(width))).astype(PETSc.IntType)
    dofs = np.flatnonzero(inner).reshape(-1, block) + K.getOwnershipRange()[0]
    indices = np.repeat(dofs, block, axis=0).ravel().astype(PETSc.IntType)
    return PETSc.Mat().createAIJ(K.getSizes(), csr=(indptr, indices, inverse.ravel()), comm=comm)

"""Eigenvalues near a shift and Guyan's reduction, for matrices that may be unsymmetric."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigs, splu


def eigenvalues_nearest_to_shift(
    K: sparse.spmatrix,
    M: sparse.spmatrix,
    prescribed_mask: np.ndarray,
    count: int,
    shift: float = 0.0,
) -> np.ndarray:
    """Return the `count` eigenvalues lambda of K x = lambda M x that are nearest to the shift.

    Distances from the shift are measured in the complex plane. The eigenvalues are complex and
    sorted by their real parts.
    """
    free_dofs = np.flatnonzero(~prescribed_mask.ravel())
    K, M = (matrix.tocsc()[free_dofs][:, free_dofs] for matrix in (K, M))
    factors = splu((K - shift * M).tocsc())
    inverse = LinearOperator(K.shape, lambda x: factors.solve(M @ x))
    start = np.random.default_rng(0).standard_normal(K.shape[0])
    values = eigs(inverse, count, v0=start, tol=1e-14, return_eigenvectors=False)
    return np.sort_complex(shift + 1 / values)


def guyan_reduction(
    K: sparse.spmatrix, M: sparse.spmatrix, inner_nodes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return K and M after Guyan's reduction, which condenses the inner nodes statically.

    The rows of both matrices are combined with the rows of K, and the columns with its columns.
    Therefore M becomes unsymmetric if K is.
    """
    inner_dofs = (2 * inner_nodes[:, None] + [0, 1]).ravel()
    outer_dofs = np.setdiff1d(np.arange(K.shape[0]), inner_dofs)
    K = K.tocsc()
    inverse = splu(K[inner_dofs][:, inner_dofs])
    right = -inverse.solve(K[inner_dofs][:, outer_dofs].toarray())
    left = -inverse.solve(K[outer_dofs][:, inner_dofs].T.toarray(), "T").T

    def reduce_matrix(A: sparse.spmatrix) -> np.ndarray:
        kk, ki, ik, ii = (
            A.tocsc()[rows][:, columns]
            for rows in (outer_dofs, inner_dofs)
            for columns in (outer_dofs, inner_dofs)
        )
        return kk.toarray() + ki @ right + left @ ik.toarray() + left @ (ii @ right)

    return reduce_matrix(K), reduce_matrix(M)

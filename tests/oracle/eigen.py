"""The smallest eigenvalues of a pair of matrices that need not be symmetric."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigs, splu


def eigenvalues_nearest_to(
    K: sparse.spmatrix,
    M: sparse.spmatrix,
    prescribed_mask: np.ndarray,
    count: int,
    shift: float = 0.0,
) -> np.ndarray:
    """Eigenvalues (count,) of K x = lambda M x nearest to the shift, sorted by their real parts."""
    kept = np.flatnonzero(~prescribed_mask.ravel())
    K, M = (matrix.tocsc()[kept][:, kept] for matrix in (K, M))
    factors = splu((K - shift * M).tocsc())
    inverse = LinearOperator(K.shape, lambda x: factors.solve(M @ x))
    start = np.random.default_rng(0).standard_normal(K.shape[0])
    values = eigs(inverse, count, v0=start, tol=1e-14, return_eigenvectors=False)
    return np.sort_complex(shift + 1 / values)


def guyan_reduction(
    K: sparse.spmatrix, M: sparse.spmatrix, inner: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """K and M by Guyan's reduction: inner nodes follow the others as they do in statics.

    Rows are combined as K's rows ask, columns as its columns do, so that M may be unsymmetric.
    """
    out = (2 * inner[:, None] + [0, 1]).ravel()
    kept = np.setdiff1d(np.arange(K.shape[0]), out)
    K = K.tocsc()
    inverse = splu(K[out][:, out])
    right = -inverse.solve(K[out][:, kept].toarray())
    left = -inverse.solve(K[kept][:, out].T.toarray(), "T").T

    def reduced(A: sparse.spmatrix) -> np.ndarray:
        kk, ki, ik, ii = (
            A.tocsc()[rows][:, columns] for rows in (kept, out) for columns in (kept, out)
        )
        return kk.toarray() + ki @ right + left @ ik.toarray() + left @ (ii @ right)

    return reduced(K), reduced(M)

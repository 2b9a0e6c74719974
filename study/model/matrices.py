"""Dense copies of small matrices, and the relative difference of two."""

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def to_dense_array(matrix: PETSc.Mat) -> Array:
    """Return the entries (m, n) of a matrix on one process."""
    copy = matrix.convert("dense", PETSc.Mat())  # outlives the view of its array
    return np.array(copy.getDenseArray())


def relative_difference(a: Array, b: Array) -> float:
    """Return the norm of a - b over that of a."""
    return float(np.linalg.norm(a - b) / np.linalg.norm(a))

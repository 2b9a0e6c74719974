"""Dense copies of small matrices, and relative differences of arrays."""

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def to_dense_array(matrix: PETSc.Mat) -> Array:
    """Return the entries (m, n) of a matrix that resides on one process."""
    copy = matrix.convert("dense", PETSc.Mat())  # must outlive the view of its array
    return np.array(copy.getDenseArray())


def relative_norm_of_difference(a: Array, b: Array) -> float:
    """Return the norm of a - b, divided by the norm of a."""
    return float(np.linalg.norm(a - b) / np.linalg.norm(a))

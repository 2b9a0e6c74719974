"""Small matrices as arrays, and how much two of them differ."""

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def dense(matrix: PETSc.Mat) -> Array:
    """The entries (m, n) of a matrix on one process."""
    copy = matrix.convert("dense", PETSc.Mat())  # outlives the view of its array
    return np.array(copy.getDenseArray())


def relative_difference(a: Array, b: Array) -> float:
    """Norm of a - b over that of a."""
    return float(np.linalg.norm(a - b) / np.linalg.norm(a))

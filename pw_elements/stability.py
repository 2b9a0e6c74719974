"""What central differences need: a symmetric stiffness, a diagonal mass, and a step that is stable.

They multiply the part of a motion that belongs to an eigenvalue w of M^-1 K by factors rho with
rho^2 - (2 - dt^2 w) rho + 1 = 0, whose product is one: unless w is real and dt^2 w <= 4, one of
them is larger than one, and that part grows.
"""

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np

from pw_elements.collective import collective
from pw_elements.eigen import NoModes
from pw_elements.given import Problem
from pw_elements.reduction import Reduction

# Largest |K - K^T| over |K| of a symmetric matrix, by its assembly's round-off
_ROUND_OFF = 1e-10
# Relative residual of the largest eigenvalue; its error is of the size of the square
_TOLERANCE = 1e-8
_MAX_ITERATIONS = 1000


def critical_step(K: PETSc.Mat, M: PETSc.Mat, reduction: Reduction) -> float:
    """Largest stable time step of central differences: 2 over the highest frequency.

    Args:
        K: stiffness (n, n), symmetric, free.
        M: mass (n, n), diagonal and positive.
        reduction: supports.

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite, a stiffness
            that is not symmetric, or a mass that is not diagonal and positive.
        NoModes: if the highest frequency is not found.
    """
    Problem({"the stiffness": K, "the mass": M}, reductions=(reduction,))
    refuse_unsymmetric(K)
    inverse = diagonal_mass(M)
    inverse.reciprocal()
    inverse.sqrtabs()
    scaled = K.copy()
    scaled.diagonalScale(inverse, inverse)
    # rows of supports go: what they leave is M^-1/2 K M^-1/2 of the free unknowns
    scaled = reduction.right.transposeMatMult(scaled.matMult(reduction.right))
    eigensolver = SLEPc.EPS().create(scaled.comm)
    eigensolver.setOperators(scaled)
    eigensolver.setProblemType(SLEPc.EPS.ProblemType.HEP)
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    eigensolver.setTolerances(_TOLERANCE, _MAX_ITERATIONS)
    eigensolver.solve()
    if eigensolver.getConverged() < 1:
        raise NoModes("the highest frequency, and with it the critical step, was not found")
    largest = eigensolver.getEigenvalue(0).real
    eigensolver.destroy()
    if not 0 < largest < np.inf:
        raise NoModes(f"the largest eigenvalue of mass and stiffness is {largest:.6g}")
    return float(2 / np.sqrt(largest))


def refuse_unsymmetric(K: PETSc.Mat) -> None:
    """Raises ValueError for a stiffness that differs from its transpose."""
    difference = K.transpose(PETSc.Mat())
    difference.axpy(-1.0, K, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    share = difference.norm(PETSc.NormType.FROBENIUS) / K.norm(PETSc.NormType.FROBENIUS)
    if not share <= _ROUND_OFF:
        raise ValueError(
            f"the stiffness is not symmetric, it differs from its transpose by {share:.1e}: some "
            "of its upper eigenvalues are complex, and undamped motions would grow whatever the "
            "time step; use the symmetric sibling, Sibling.of(space).matrix(K_standard), whose "
            "nodal forces are even, too"
        )


def diagonal_mass(M: PETSc.Mat) -> PETSc.Vec:
    """Masses (n,) of a diagonal matrix.

    Raises:
        ValueError: if it is not diagonal, or they are not positive.
    """
    mass = M.getDiagonal()
    first, last = M.getOwnershipRange()
    indptr, column, value = M.getValuesCSR()
    row = np.repeat(np.arange(first, last), np.diff(indptr))
    with collective(M.comm.tompi4py()):
        if np.any(value[row != column] != 0):
            raise ValueError(
                "the mass is not diagonal, as explicit dynamics needs it: lumped_mass makes one"
            )
        if not np.all(mass.array_r > 0):
            raise ValueError(
                "a mass is not positive: standard elements' row sums are not; take those of the "
                "symmetric sibling, Sibling.matrix(M), or of piecewise-linear weights"
            )
    return mass

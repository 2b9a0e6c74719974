"""Buckling factors of an unsymmetric pair, Eq (24), by SLEPc."""

from dataclasses import dataclass

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import numpy.typing as npt

from pw_elements.algebra import Reduction, factorise, symmetric_part

_TOLERANCE = 1e-12
_MAX_ITERATIONS = 500


class NoBuckling(RuntimeError):
    """The eigenvalue problem has no (or too few) positive real factors."""


@dataclass(frozen=True)
class BucklingModes:
    """Buckling factors, smallest positive first.

    Args:
        factors: (n,), multiples of the prestress' load.
        shapes: n full vectors, in the trial space's numbering, largest entry 1.
        residuals: (n,), |K d + factor K_sigma d| / |K d|.
        imaginary: largest |Im| / |Re| of them: 0 where the unsymmetric pair stays real.
    """

    factors: npt.NDArray[np.float64]
    shapes: list[PETSc.Vec]
    residuals: npt.NDArray[np.float64]
    imaginary: float


def buckling(
    K: PETSc.Mat,
    K_sigma: PETSc.Mat,
    reduction: Reduction,
    count: int = 1,
    symmetrised: bool = False,
) -> BucklingModes:
    """Smallest positive factors of (K + factor K_sigma) d = 0.

    Args:
        K: stiffness, (n, n), free.
        K_sigma: initial stress matrix of the load to be multiplied, (n, n), free.
        reduction: supports; prescribed values do not move in a mode.
        count: how many factors.
        symmetrised: take the symmetric parts of both matrices, as a symmetric eigenvalue
            solver does with an unsymmetric element.

    Raises:
        SingularSystem: if the supports leave the body a rigid motion.
        NoBuckling: if fewer than `count` positive factors exist, or some did not converge.
    """
    A, B = reduction.matrix(K_sigma), reduction.matrix(K)
    if symmetrised:
        A, B = symmetric_part(A), symmetric_part(B)
    size = A.norm(PETSc.NormType.FROBENIUS)
    if not 0 < size < np.inf:
        raise NoBuckling("the initial stress matrix is zero or not finite: there is no prestress")
    # K_sigma d = mu K d with mu = -scale/factor: the largest positive -mu is the smallest
    # positive factor, and the scale brings mu to order one whatever the units of the load
    scale = B.norm(PETSc.NormType.FROBENIUS) / size
    A.scale(-scale)

    solver = SLEPc.EPS().create(A.comm)
    solver.setOperators(A, B)
    kind = SLEPc.EPS.ProblemType
    solver.setProblemType(kind.GHEP if symmetrised else kind.GNHEP)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    solver.setDimensions(nev=count)
    solver.setTolerances(_TOLERANCE, _MAX_ITERATIONS)
    inverse = factorise(B, symmetric=symmetrised)
    if symmetrised and inverse.getPC().getFactorMatrix().getInertia()[0] > 0:
        raise NoBuckling(
            "the symmetric part of the stiffness is not positive definite: on so coarse a mesh "
            "the symmetrised element is no stable one; refine the mesh"
        )
    solver.getST().setKSP(inverse)
    solver.solve()
    if solver.getConverged() < count:
        raise NoBuckling(
            f"only {solver.getConverged()} of {count} buckling factors converged "
            f"in {solver.getIterationNumber()} iterations"
        )

    factors, shapes, residuals, imaginary = [], [], [], 0.0
    real, imag = B.createVecRight(), B.createVecRight()
    for i in range(count):
        value = solver.getEigenpair(i, real, imag)
        if value.real <= 0:
            raise NoBuckling(
                f"only {i} of {count} factors are positive: the load pulls where it should press"
            )
        imaginary = max(imaginary, abs(value.imag) / abs(value.real))
        residuals.append(_residual(A, B, value.real, real))
        factors.append(scale / value.real)
        mode = reduction.shape(real)
        mode.scale(1 / _largest_entry(mode))
        shapes.append(mode)
    solver.destroy()
    return BucklingModes(np.array(factors), shapes, np.array(residuals), imaginary)


def _residual(A: PETSc.Mat, B: PETSc.Mat, mu: float, mode: PETSc.Vec) -> float:
    difference, image = B.createVecLeft(), B.createVecLeft()
    A.mult(mode, difference)
    B.mult(mode, image)
    difference.axpy(-mu, image)
    return float(difference.norm() / (mu * image.norm()))


def _largest_entry(vector: PETSc.Vec) -> float:
    """Entry of largest absolute value, with its sign."""
    low, high = vector.min()[1], vector.max()[1]
    return float(high if abs(high) >= abs(low) else low)

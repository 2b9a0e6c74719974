"""Accuracy and result of the linear solution for one active set."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from petsc4py import PETSc

from pw_elements.arrays import Array

# Accuracy of a linear solution: "rough" for an intermediate iterate, "final" for an iterate that
# may be the last of an increment, and "tightened" for the same system solved again with a smaller
# residual
LinearSolveAccuracy: TypeAlias = Literal["rough", "final", "tightened"]


@dataclass(frozen=True)
class LocalTangentSolution:
    """The part of the solution of one contact system that this process owns.

    Args:
        unknowns: unknowns (n,) of this process; on the last process followed by the free motions.
        is_exact: whether round-off alone limits the accuracy.
        is_final: whether the solution is accurate enough to end an increment.
    """

    unknowns: Array
    is_exact: bool
    is_final: bool


@dataclass(frozen=True)
class ContactSystemSolution:
    """Solution of one contact system.

    Args:
        reduced_unknowns: displacements reduced by the supports.
        free_motions: free motions (free,) of the surfaces, the same on every process.
        additional_forces: forces (m, dim) of all contact points that are not the first one at their
            node; zero at all other points.
        is_exact: whether round-off alone limits the accuracy.
        is_final: whether the solution is accurate enough to end an increment.
    """

    reduced_unknowns: PETSc.Vec
    free_motions: Array
    additional_forces: Array
    is_exact: bool
    is_final: bool

"""Accuracies and results of the linear solution for one active set."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from petsc4py import PETSc

from pw_elements.arrays import Array

# "rough" for an intermediate iterate, "final" for one that may be the last of an increment, and
# "tightened" for a repeated solution of the same system with a smaller residual
Accuracy: TypeAlias = Literal["rough", "final", "tightened"]


@dataclass(frozen=True)
class TangentSolution:
    """Solution of one contact system on this process.

    Args:
        unknowns: (n,) of this process; on the last process the free motions follow.
        is_exact: whether round-off alone limits the accuracy.
        is_final: whether the solution is accurate enough to end an increment.
    """

    unknowns: Array
    is_exact: bool
    is_final: bool


@dataclass(frozen=True)
class Solution:
    """Solution of one contact system.

    Args:
        reduced_unknowns: reduced displacements.
        free_motions: (free,), on every process.
        is_exact: whether round-off alone limits the accuracy.
        is_final: whether the solution is accurate enough to end an increment.
    """

    reduced_unknowns: PETSc.Vec
    free_motions: Array
    is_exact: bool
    is_final: bool

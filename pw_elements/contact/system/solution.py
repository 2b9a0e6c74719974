"""What a solver of the linear system of an active set takes and gives."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from petsc4py import PETSc

from pw_elements.arrays import Array

# Of a solution: "rough" on the way, "final" for one that may be the last of an increment, and
# "tightened" for the same system once more, as exactly as it can be solved
Accuracy: TypeAlias = Literal["rough", "final", "tightened"]


@dataclass(frozen=True)
class TangentSolution:
    """Unknowns of this process, those of free motions being at the end of the last process'.

    Args:
        unknowns: (n,).
        is_exact: whether the same system, solved again, would give nothing better.
        is_final: whether it is exact enough to be the last of an increment.
    """

    unknowns: Array
    is_exact: bool
    is_final: bool


@dataclass(frozen=True)
class Solution:
    """Reduced displacements, and the free motions on every process; flags as `TangentSolution`."""

    reduced: PETSc.Vec
    free_motions: Array
    is_exact: bool
    is_final: bool

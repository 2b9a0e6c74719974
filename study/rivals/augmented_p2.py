"""Augmented Lagrangian with quadratic multipliers, see `augmented_p1`."""

from study.rivals import augmented_p1
from study.rivals.problem import Answer, Problem

SWEEP = augmented_p1.SWEEP


def solve(problem: Problem, parameter: float) -> Answer:
    """Multipliers of degree 2."""
    return augmented_p1.solve(problem, parameter, degree=2)

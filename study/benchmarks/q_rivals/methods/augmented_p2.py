"""Augmented Lagrangian with quadratic multipliers, see `augmented_p1`."""

from study.benchmarks.q_rivals.methods import augmented_p1
from study.solutions.hertz_problem import Answer, Problem

SWEEP = augmented_p1.SWEEP


def solve(problem: Problem, parameter: float) -> Answer:
    """Solve with multipliers of degree 2."""
    return augmented_p1.solve(problem, parameter, degree=2)

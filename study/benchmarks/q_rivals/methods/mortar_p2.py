"""Mortar with standard quadratic multipliers, see `mortar_p1`."""

from study.benchmarks.q_rivals.methods import mortar_p1
from study.solutions.hertz_problem import Answer, Problem


def solve(problem: Problem) -> Answer:
    """Solve with multipliers of degree 2."""
    return mortar_p1.solve(problem, degree=2)

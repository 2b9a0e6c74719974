"""Mortar with standard quadratic multipliers, see `mortar_p1`."""

from study.rivals import mortar_p1
from study.rivals.problem import Answer, Problem


def solve(problem: Problem) -> Answer:
    """Multipliers of degree 2."""
    return mortar_p1.solve(problem, degree=2)

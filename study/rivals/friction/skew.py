"""Nitsche's method, skew-symmetric, see `nitsche`."""

from study.rivals.friction import nitsche
from study.rivals.problem import Form, Problem

SWEEP = nitsche.SWEEP


def solve(problem: Problem, parameter: float) -> tuple[Form, Form, int]:
    """The form with theta = -1."""
    return nitsche.solve(problem, parameter, theta=-1.0)

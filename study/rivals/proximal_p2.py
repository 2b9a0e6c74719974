"""Proximal Galerkin with a quadratic latent variable, see `proximal_p1`."""

from study.rivals import proximal_p1
from study.rivals.problem import Answer, Problem

SWEEP = proximal_p1.SWEEP


def solve(problem: Problem, parameter: float) -> Answer:
    """A latent variable of degree 2."""
    return proximal_p1.solve(problem, parameter, degree=2)

"""Proximal Galerkin with a quadratic latent variable, see `proximal_p1`."""

from study.benchmarks.q_rivals.methods import proximal_p1
from study.solutions.hertz_problem import Answer, Problem

SWEEP = proximal_p1.SWEEP


def solve(problem: Problem, parameter: float) -> Answer:
    """Solve with a latent variable of degree 2."""
    return proximal_p1.solve(problem, parameter, degree=2)

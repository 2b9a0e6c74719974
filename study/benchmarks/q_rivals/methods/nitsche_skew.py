"""Nitsche's method, skew-symmetric: F. Chouly, P. Hild and Y. Renard, see `nitsche_symmetric`."""

from study.benchmarks.q_rivals.methods import nitsche_symmetric
from study.solutions.hertz_problem import Answer, Problem

SWEEP = (0.01, 0.1, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)  # gamma h / E; stable for all of them


def solve(problem: Problem, parameter: float) -> Answer:
    """Solve the form with theta = -1."""
    return nitsche_symmetric.solve(problem, parameter, theta=-1.0)

"""Nitsche's method, symmetric: F. Chouly, P. Hild, Y. Renard, 10.1090/S0025-5718-2014-02913-X."""

import ufl
from dolfinx import fem

from study.rivals.problem import Answer, E, Problem, newton

SWEEP = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)  # gamma h / E


def solve(problem: Problem, parameter: float, theta: float = 1.0) -> Answer:
    """Contact at integration points, by the stress of the body; theta -1 is the skew form."""
    V = problem.space()
    u, v, y = fem.Function(V), ufl.TestFunction(V), problem.up
    gamma = fem.Constant(problem.mesh, parameter * E / problem.size)
    sign = fem.Constant(problem.mesh, theta)
    of_u, of_v = (problem.stress(w)[y, y] for w in (u, v))
    pressure = ufl.max_value(0, gamma * (u[y] - problem.gap) - of_u)
    terms = pressure * (gamma * v[y] - sign * of_v) - sign * of_u * of_v
    count = newton(problem.work(u, v) + terms / gamma * problem.surface, u, problem.supports(V))
    return Answer(u, pressure, u.x.array.size, count, V)

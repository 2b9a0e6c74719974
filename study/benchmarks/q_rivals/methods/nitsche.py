"""Nitsche's method: F. Chouly, P. Hild, Y. Renard, doi 10.1090/S0025-5718-2014-02913-X."""

import ufl
from dolfinx import fem

from study.solutions.hertz_problem import E, Problem, Solution, solve_newton

SYMMETRIC_SWEEP = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)  # values of gamma h / E
SKEW_SWEEP = (0.01, 0.1, *SYMMETRIC_SWEEP)  # this form is stable for all of them


def solve(problem: Problem, scaled_gamma: float, theta: float = 1.0) -> Solution:
    """Solve; `parameter` is gamma h / E; theta is 1 (symmetric) or -1 (skew-symmetric)."""
    V = problem.make_space()
    u, v, y = fem.Function(V), ufl.TestFunction(V), problem.normal_axis
    gamma = fem.Constant(problem.mesh, scaled_gamma * E / problem.edge_length)
    sign = fem.Constant(problem.mesh, theta)
    stress_u, stress_v = (problem.stress(w)[y, y] for w in (u, v))
    pressure = ufl.max_value(0, gamma * (u[y] - problem.gap) - stress_u)
    terms = pressure * (gamma * v[y] - sign * stress_v) - sign * stress_u * stress_v
    count = solve_newton(
        problem.virtual_work(u, v) + terms / gamma * problem.contact_measure,
        u,
        problem.far_field_supports(V),
    )
    return Solution(u, pressure, u.x.array.size, count, V)

"""Penalty: springs that act in compression only, at integration points."""

import ufl
from dolfinx import fem

from study.solutions.hertz_problem import E, Problem, Solution, solve_newton

SWEEP = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)  # values of the stiffness times h / E


def solve(problem: Problem, parameter: float) -> Solution:
    """Solve with a pressure proportional to the penetration."""
    V = problem.make_space()
    u, v, y = fem.Function(V), ufl.TestFunction(V), problem.normal_axis
    stiffness = fem.Constant(problem.mesh, parameter * E / problem.size)
    pressure = stiffness * ufl.max_value(0, u[y] - problem.gap)
    form = problem.virtual_work(u, v) + pressure * v[y] * problem.contact_measure
    count = solve_newton(form, u, problem.far_field_supports(V))
    return Solution(u, pressure, u.x.array.size, count, V)

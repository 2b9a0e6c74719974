"""Penalty method: springs at integration points that act in compression only."""

import ufl
from dolfinx import fem

from study.solutions.hertz_problem import E, Problem, Solution, solve_newton

SWEEP = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)  # values of the stiffness times h / E


def solve(problem: Problem, scaled_stiffness: float) -> Solution:
    """Solve with a pressure `parameter` E / h times the penetration."""
    V = problem.make_space()
    u, v, y = fem.Function(V), ufl.TestFunction(V), problem.normal_axis
    stiffness = fem.Constant(problem.mesh, scaled_stiffness * E / problem.edge_length)
    pressure = stiffness * ufl.max_value(0, u[y] - problem.gap)
    form = problem.virtual_work(u, v) + pressure * v[y] * problem.contact_measure
    count = solve_newton(form, u, problem.far_field_supports(V))
    return Solution(u, pressure, u.x.array.size, count, V)

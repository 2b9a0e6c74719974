"""Augmented Lagrangian method: P. Alart, A. Curnier, doi 10.1016/0045-7825(91)90022-X."""

import ufl
from dolfinx import fem

from study.solutions.hertz_problem import E, Problem, Solution, solve_newton

SWEEP = (0.1, 1.0, 10.0, 100.0, 1e3, 1e4)  # values of the augmentation parameter times h / E


def solve(problem: Problem, scaled_augmentation: float, degree: int = 1) -> Solution:
    """Solve with multipliers of a degree; `parameter` is the augmentation times h / E."""
    W = problem.make_space(multiplier_degree=degree)
    w, (v, m), y = fem.Function(W), ufl.TestFunctions(W), problem.normal_axis
    u, pressure = ufl.split(w)
    augmentation = fem.Constant(problem.mesh, scaled_augmentation * E / problem.edge_length)
    contact_pressure = ufl.max_value(0, pressure + augmentation * (u[y] - problem.gap))
    law = contact_pressure * v[y] + (contact_pressure - pressure) * m / augmentation
    supports = [*problem.far_field_supports(W.sub(0)), problem.zero_multipliers_outside(W.sub(1))]
    count = solve_newton(problem.virtual_work(u, v) + law * problem.contact_measure, w, supports)
    return problem.make_solution(w, count)

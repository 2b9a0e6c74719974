"""Augmented Lagrangian, integrated: P. Alart, A. Curnier, doi 10.1016/0045-7825(91)90022-X."""

import ufl
from dolfinx import fem

from study.solutions.hertz_problem import Answer, E, Problem, newton

SWEEP = (0.1, 1.0, 10.0, 100.0, 1e3, 1e4)  # values of the augmentation times h / E


def solve(problem: Problem, parameter: float, degree: int = 1) -> Answer:
    """Solve by a semismooth Newton method, with multipliers of a degree."""
    W = problem.space(multiplier=degree)
    w, (v, m), y = fem.Function(W), ufl.TestFunctions(W), problem.up
    u, pressure = ufl.split(w)
    augmentation = fem.Constant(problem.mesh, parameter * E / problem.size)
    contact_pressure = ufl.max_value(0, pressure + augmentation * (u[y] - problem.gap))
    law = contact_pressure * v[y] + (contact_pressure - pressure) * m / augmentation
    supports = [*problem.supports(W.sub(0)), problem.no_multipliers_outside(W.sub(1))]
    count = newton(problem.work(u, v) + law * problem.surface, w, supports)
    return problem.make_answer(w, count)

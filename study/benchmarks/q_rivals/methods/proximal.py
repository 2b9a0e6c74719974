"""Proximal Galerkin (LVPP): B. Keith and T. M. Surowiec, doi 10.1007/s10208-024-09681-8."""

import numpy as np
import ufl
from dolfinx import fem

from study.solutions.hertz_problem import NoSolution, Problem, Solution, prepare_newton

SWEEP = (0.1, 1.0, 10.0)  # values of the first proximal step times the peak pressure
STEP_GROWTH = 4.0  # ratio of successive proximal steps: the second parameter
MAX_STEPS = 30


def solve(problem: Problem, scaled_first_step: float, degree: int = 1) -> Solution:
    """Solve with gap exp(latent variable); `parameter` is first step times peak pressure."""
    W = problem.make_space(multiplier_degree=degree)
    w, previous, (v, m), y = (
        fem.Function(W),
        fem.Function(W),
        ufl.TestFunctions(W),
        problem.normal_axis,
    )
    (u, latent), (_, previous_latent) = ufl.split(w), ufl.split(previous)
    step = fem.Constant(problem.mesh, scaled_first_step / problem.exact.peak_pressure)
    pressure, gap = (previous_latent - latent) / step, problem.exact.approach * ufl.exp(latent)
    law = pressure * v[y] + (problem.gap - u[y] - gap) * m
    supports = [*problem.far_field_supports(W.sub(0)), problem.zero_multipliers_outside(W.sub(1))]
    displacement_dofs, count = W.sub(0).collapse()[1], 0
    newton = prepare_newton(problem.virtual_work(u, v) + law * problem.contact_measure, w, supports)
    for _ in range(MAX_STEPS):
        count += newton()
        change = np.abs(w.x.array - previous.x.array)[displacement_dofs].max()
        if change < 1e-9 * problem.exact.approach:
            return problem.make_solution(w, count, pressure)
        previous.x.array[:] = w.x.array
        step.value *= STEP_GROWTH
    raise NoSolution

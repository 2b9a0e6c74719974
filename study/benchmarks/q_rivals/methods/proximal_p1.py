"""Proximal Galerkin (LVPP): B. Keith and T. M. Surowiec, doi 10.1007/s10208-024-09681-8."""

import numpy as np
import ufl
from dolfinx import fem

from study.solutions.hertz_problem import Answer, NoSolution, Problem, prepare_newton

SWEEP = (0.1, 1.0, 10.0)  # first proximal step times the peak of the pressure
GROWTH, MAX_STEPS = 4.0, 30  # factor from step to step (the second parameter); steps


def solve(problem: Problem, parameter: float, degree: int = 1) -> Answer:
    """Solve with a gap that is the exponential of a latent variable of a degree."""
    W = problem.space(multiplier=degree)
    w, before, (v, m), y = fem.Function(W), fem.Function(W), ufl.TestFunctions(W), problem.up
    (u, latent), (_, previous_latent) = ufl.split(w), ufl.split(before)
    step = fem.Constant(problem.mesh, parameter / problem.exact.peak)
    pressure, gap = (previous_latent - latent) / step, problem.exact.approach * ufl.exp(latent)
    law = pressure * v[y] + (problem.gap - u[y] - gap) * m
    supports = [*problem.supports(W.sub(0)), problem.no_multipliers_outside(W.sub(1))]
    displacement_dofs, count = W.sub(0).collapse()[1], 0
    newton = prepare_newton(problem.work(u, v) + law * problem.surface, w, supports)
    for _ in range(MAX_STEPS):
        count += newton()
        change = np.abs(w.x.array - before.x.array)[displacement_dofs].max()
        if change < 1e-9 * problem.exact.approach:
            return problem.make_answer(w, count, pressure)
        before.x.array[:] = w.x.array
        step.value *= GROWTH
    raise NoSolution

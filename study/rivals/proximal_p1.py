"""Proximal Galerkin (LVPP): B. Keith and T. M. Surowiec, doi 10.1007/s10208-024-09681-8."""

import numpy as np
import ufl
from dolfinx import fem

from study.rivals.problem import Answer, NoSolution, Problem, iteration

SWEEP = (0.1, 1.0, 10.0)  # first proximal step times the peak of the pressure
GROWTH, STEPS = 4.0, 30  # of the steps from one to the next, the second parameter; at most


def solve(problem: Problem, parameter: float, degree: int = 1) -> Answer:
    """The gap is the exponential of a latent variable of a degree."""
    W = problem.space(multiplier=degree)
    w, before, (v, m), y = fem.Function(W), fem.Function(W), ufl.TestFunctions(W), problem.up
    (u, latent), (_, last) = ufl.split(w), ufl.split(before)
    step = fem.Constant(problem.mesh, parameter / problem.known.peak)
    pressure, gap = (last - latent) / step, problem.known.approach * ufl.exp(latent)
    law = pressure * v[y] + (problem.gap - u[y] - gap) * m
    supports = [*problem.supports(W.sub(0)), problem.nowhere_else(W.sub(1))]
    moved, count = W.sub(0).collapse()[1], 0
    newton = iteration(problem.work(u, v) + law * problem.surface, w, supports)
    for _ in range(STEPS):
        count += newton()
        change = np.abs(w.x.array - before.x.array)[moved].max()
        if change < 1e-9 * problem.known.approach:
            return problem.answer_of(w, count, pressure)
        before.x.array[:] = w.x.array
        step.value *= GROWTH
    raise NoSolution

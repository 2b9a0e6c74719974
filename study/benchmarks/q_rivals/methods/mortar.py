"""Mortar method with standard multipliers: B. Wohlmuth, doi 10.1017/S0962492911000079."""

import numpy as np
import ufl
from dolfinx import fem

from study.solutions.hertz_problem import MAX_SOLVES, Answer, Mask, NoSolution, Problem, solve_lu


def solve(problem: Problem, degree: int = 1) -> Answer:
    """Solve by a primal-dual active set, with multipliers of a degree."""
    W = problem.space(multiplier=degree)
    (u, p), (v, m), y = ufl.TrialFunctions(W), ufl.TestFunctions(W), problem.up
    form = problem.work(u, v) + (p * v[y] + u[y] * m) * problem.surface
    A = fem.assemble_matrix(fem.form(form)).to_scipy().tocsr()
    b = fem.assemble_vector(fem.form(problem.gap * m * problem.surface)).array
    supports = [*problem.supports(W.sub(0)), problem.no_multipliers_outside(W.sub(1))]
    x, free = fem.Function(W), np.ones(b.size, dtype=bool)
    for bc in supports:
        bc.set(x.x.array)
    free[np.concatenate([bc.dof_indices()[0] for bc in supports])] = False
    multipliers = np.intersect1d(W.sub(1).collapse()[1], np.flatnonzero(free))
    active: Mask = np.ones(len(multipliers), dtype=bool)
    for count in range(1, MAX_SOLVES + 1):
        free[multipliers] = active
        x.x.array[multipliers[~active]] = 0.0
        right = b - A @ np.where(free, 0.0, x.x.array)
        x.x.array[free] = solve_lu(A[free][:, free], right[free])
        closing = (A @ x.x.array - b)[multipliers] > 0
        previous, active = active, np.where(active, x.x.array[multipliers] > 0, closing)
        if np.array_equal(previous, active):
            return problem.make_answer(x, count)
    raise NoSolution

"""Mortar method with standard multipliers: B. Wohlmuth, doi 10.1017/S0962492911000079."""

import numpy as np
import ufl
from dolfinx import fem

from study.solutions.hertz_problem import MAX_SOLVES, Mask, NoSolution, Problem, Solution, solve_lu


def solve(problem: Problem, degree: int = 1) -> Solution:
    """Solve by a primal-dual active-set method, with pressure multipliers of the given degree."""
    W = problem.make_space(multiplier_degree=degree)
    (u, p), (v, m), y = ufl.TrialFunctions(W), ufl.TestFunctions(W), problem.normal_axis
    form = problem.virtual_work(u, v) + (p * v[y] + u[y] * m) * problem.contact_measure
    A = fem.assemble_matrix(fem.form(form)).to_scipy().tocsr()
    b = fem.assemble_vector(fem.form(problem.gap * m * problem.contact_measure)).array
    supports = [*problem.far_field_supports(W.sub(0)), problem.zero_multipliers_outside(W.sub(1))]
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
            return problem.make_solution(x, count)
    raise NoSolution

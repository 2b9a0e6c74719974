"""Standard element by PETSc's SNES; nodal forces times T, over the new element's weights."""

from pw_elements import force_transfer, test_space
from study.benchmarks.q_rivals.methods.snes_vi import solve_displacements_below_gap
from study.solutions.hertz_problem import Problem, Solution, make_function


def solve(problem: Problem) -> Solution:
    """Solve, and apply T: a mid-side node passes 1/8 of its force to each end of its side."""
    u, count = solve_displacements_below_gap(problem)
    V = u.function_space
    forces = make_function(V, problem.nodal_forces(u, V).ravel())
    even_forces = force_transfer(V) * forces.x.petsc_vec
    normal_forces = even_forces.array_r.reshape(-1, problem.normal_axis + 1)[:, problem.normal_axis]
    pressure = problem.divide_by_test_function_integrals(normal_forces, test_space(V))
    return Solution(u, problem.interpolate_on_sub_cells(pressure), u.x.array.size, count, V)

"""The standard element by SNES, with forces multiplied by T and divided by the new weights."""

from pw_elements import force_transfer, test_space
from study.benchmarks.q_rivals.methods.snes_vi import solve_displacements
from study.solutions.hertz_problem import Problem, Solution, make_function


def solve(problem: Problem) -> Solution:
    """Solve; mid-side nodes keep 3/4 of their force and pass 1/8 to each end of the side."""
    u, count = solve_displacements(problem)
    V = u.function_space
    forces = make_function(V, problem.nodal_forces(u, V).ravel())
    even_forces = force_transfer(V) * forces.x.petsc_vec
    normal_forces = even_forces.array_r.reshape(-1, problem.normal_axis + 1)[:, problem.normal_axis]
    pressure = problem.divide_by_weights(normal_forces, test_space(V))
    return Solution(u, problem.interpolate_linearly(pressure), u.x.array.size, count, V)

"""The standard element by SNES, forces times T over the new element's weights."""

from pw_elements import force_transfer, test_space
from study.rivals.problem import Answer, Problem, function
from study.rivals.snes_vi import displacements


def solve(problem: Problem) -> Answer:
    """Three quarters of a mid-side node's force stay with it, an eighth goes to either corner."""
    u, count = displacements(problem)
    V = u.function_space
    forces = function(V, problem.forces(u, V).ravel())
    even = force_transfer(V) * forces.x.petsc_vec
    tested, dim = test_space(V), problem.up + 1
    pressure = problem.over_weights(even.array_r.reshape(-1, dim)[:, problem.up], tested)
    return Answer(u, problem.joined(pressure), u.x.array.size, count, V)

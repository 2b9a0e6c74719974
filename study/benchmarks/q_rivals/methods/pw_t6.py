"""The new element of pw_elements, with a contact pressure at every node of the surface."""

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix
from pw_elements.contact import ContactPair, Motion, Parabola, solve_contact
from pw_elements.elasticity import StressState
from study.solutions.hertz_problem import NU, RADIUS, E, Problem, Solution, make_function


def solve(problem: Problem) -> Solution:
    """Solve nodal contact with quadratic trial functions and piecewise-linear test functions."""
    spaces, origin = Spaces.petrov_galerkin(problem.mesh), (0.0,) * (problem.normal_axis + 1)
    state = StressState.PLANE_STRAIN if problem.normal_axis == 1 else StressState.SOLID
    body = Body(spaces, Material(E, NU), state)
    K = assemble_matrix(body.stiffness())
    supports = Reduction.dirichlet(spaces.trial, problem.far_field_supports(spaces.trial))
    down = Motion((*origin[1:], -problem.exact.approach))
    pair = ContactPair(problem.may_touch, Parabola(origin, RADIUS), motions=[down])
    (solution,) = solve_contact(K, K.createVecLeft(), supports, [pair], spaces.trial)
    u = make_function(spaces.trial, solution.displacement.array_r)
    pressure = problem.pressure_from_nodal_forces(u, spaces.test)
    return Solution(u, pressure, u.x.array.size, solution.iterations, spaces.test)

"""The new element, by the library: a pressure at every node of the surface."""

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix
from pw_elements.contact import ContactPair, Motion, Parabola, solve_contact
from pw_elements.elasticity import StressState
from study.rivals.problem import NU, RADIUS, Answer, E, Problem, function


def solve(problem: Problem) -> Answer:
    """Quadratic trial functions, piecewise-linear test functions."""
    spaces, origin = Spaces.petrov_galerkin(problem.mesh), (0.0,) * (problem.up + 1)
    state = StressState.PLANE_STRAIN if problem.up == 1 else StressState.SOLID
    body = Body(spaces, Material(E, NU), state)
    K = assemble_matrix(body.stiffness())
    supports = Reduction.dirichlet(spaces.trial, problem.supports(spaces.trial))
    down = Motion((*origin[1:], -problem.known.approach))
    pair = ContactPair(problem.touching, Parabola(origin, RADIUS), motions=[down])
    (found,) = solve_contact(K, K.createVecLeft(), supports, [pair], spaces.trial)
    u = function(spaces.trial, found.displacement.array_r)
    pressure = problem.over_own_weights(u, spaces.test)
    return Answer(u, pressure, u.x.array.size, found.iterations, spaces.test)

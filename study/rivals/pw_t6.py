"""The new element, by the library: a pressure at every node of the surface."""

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix
from pw_elements.contact import ContactPair, Motion, Parabola, solve_contact
from study.rivals.problem import NU, RADIUS, Answer, E, Problem, function


def solve(problem: Problem) -> Answer:
    """Quadratic trial functions, piecewise-linear test functions."""
    spaces, origin = Spaces.petrov_galerkin(problem.mesh), (0.0,) * (problem.up + 1)
    body = Body(spaces, Material(E, NU), ("plane strain", "solid")[problem.up - 1])
    K = assemble_matrix(body.stiffness())
    supports = Reduction.dirichlet(spaces.trial, problem.supports(spaces.trial))
    down = Motion((*origin[1:], -problem.known.approach))
    pair = ContactPair(problem.touching, Parabola(origin, RADIUS), motions=[down])
    (state,) = solve_contact(K, K.createVecLeft(), supports, [pair], spaces.trial)
    u = function(spaces.trial, state.displacement.array_r)
    forces = problem.forces(u, spaces.test)[:, problem.up]
    pressure = problem.joined(problem.over_weights(forces, spaces.test))
    return Answer(u, pressure, u.x.array.size, state.iterations, spaces.test)

"""The new element, or the standard one, by the library's contact with friction."""

import numpy as np

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix
from pw_elements.contact import ContactPair, Motion, Parabola, solve_contact
from pw_elements.elasticity import StressState
from study.rivals.friction import COEFFICIENT
from study.rivals.problem import NU, RADIUS, E, Form, Problem


def solve(problem: Problem, spaces: Spaces) -> tuple[Form, Form, int]:
    """Pressure and shear over own weights, and how many linear systems were solved."""
    body = Body(spaces, Material(E, NU), StressState.PLANE_STRAIN)
    K = assemble_matrix(body.stiffness())
    supports = Reduction.dirichlet(spaces.trial, problem.supports(spaces.trial))
    down = Motion((0.0, -problem.known.approach))
    pair = ContactPair(problem.touching, Parabola((0.0, 0.0), RADIUS), COEFFICIENT, [down])
    (state,) = solve_contact(K, K.createVecLeft(), supports, [pair], spaces.trial)
    (contact,), forces = state.pairs, np.zeros((2, spaces.trial.dofmap.index_map.size_local))
    forces[:, contact.node] = contact.force_normal, -contact.force_tangential[:, 0]
    pressure, shear = (problem.joined(problem.over_weights(f, spaces.test)) for f in forces)
    return pressure, shear, state.iterations

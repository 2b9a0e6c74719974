"""The oracle checks accepted states of contact at large strains, in fixed and random problems."""

from dataclasses import replace
from functools import cached_property

from mpi4py import MPI

import basix
import numpy as np
import pytest
from dolfinx import fem
from dolfinx import mesh as meshes

from pw_elements import Spaces, prescribe
from pw_elements.contact import ContactFailed, ContactPair, ContactProblem, Motion, Sphere
from tests.contact.cases import (
    list_states_and_substates,
    make_finite_strain_unknown_and_residual,
    neo_hookean_piola_stress,
    on_plane,
)
from tests.oracle.large import CircleContact, NeoHookeanBody, RigidCircle

RELATIVE_LAW_TOLERANCE = 1e-8
QUADRATURE_DEGREE = 4
TRIANGLE_QUADRATURE_RULE = basix.make_quadrature(basix.CellType.triangle, QUADRATURE_DEGREE)
MAX_REFUSED_FRACTION_OF_PROBLEMS = 0.05  # of the number of random problems


class CircleProblem:
    """A block on a fixed base, its top at height 0, and a circle that comes from above.

    An increment is given by the translation (2,) of the circle at its end. If the force is
    prescribed, it is given by the horizontal translation, None and the total vertical force. Nodes
    are displaced at random by up to `jiggle` times the cell size. Nodes on the boundary stay on
    their sides.
    """

    def __init__(
        self,
        linear_weights,
        friction,
        increments,
        offset=0.0,
        radius=0.6,
        gap=0.0,
        nu=0.3,
        divisions=(6, 3),
        jiggle=0.0,
        seed=0,
    ):
        self.mesh = meshes.create_rectangle(
            MPI.COMM_SELF, [(-1.0, -1.0), (1.0, 0.0)], divisions, meshes.CellType.triangle
        )
        x, rng = self.mesh.geometry.x, np.random.default_rng(seed)
        for axis, (low, high) in enumerate([(-1.0, 1.0), (-1.0, 0.0)]):
            is_inner = ~np.isclose(x[:, axis], low) & ~np.isclose(x[:, axis], high)
            step = jiggle * (high - low) / divisions[axis] * rng.uniform(-1, 1, len(x))
            x[:, axis] += np.where(is_inner, step, 0.0)
        self.linear_weights, self.lame = linear_weights, 2 * nu / (1 - 2 * nu)
        self.increments = [step if len(step) == 3 else (*step, 0.0) for step in increments]
        self.circle = RigidCircle((offset, radius + gap), radius, friction)

    @cached_property
    def accepted_states_and_error(self):
        """Return the undeformed and all accepted states, and the final error or None."""
        spaces = (Spaces.petrov_galerkin if self.linear_weights else Spaces.galerkin)(self.mesh)
        lame = fem.Constant(self.mesh, self.lame)

        stress = lambda F: neo_hookean_piola_stress(F, lame_lambda=lame)  # noqa: E731
        u, residual = make_finite_strain_unknown_and_residual(spaces, stress, QUADRATURE_DEGREE)
        conditions = [prescribe(spaces.trial, k, on_plane(1, -1.0)) for k in range(2)]
        surface = Sphere(self.circle.centre, self.circle.radius)
        pair = ContactPair(on_plane(1, 0.0), surface, self.circle.friction)
        problem = ContactProblem.of_residual(residual, u, conditions, pair)
        self.nodes = spaces.trial.tabulate_dof_coordinates()[:, :2]
        self.cells = spaces.trial.dofmap.list
        states = [problem.undeformed]
        for translation_x, translation_y, force in self.increments:
            motion = Motion((translation_x, translation_y), force=(0.0, force))
            try:
                states.append(problem.step(states[-1], motions=motion))
            except ContactFailed as error:
                return states, error
        return states, None

    def oracle_contact(self, linear_weights=None):
        """Return the oracle's model of the problem, by default with the problem's weights.

        The property `accepted_states_and_error` has to be evaluated before.
        """
        oracle_weights = self.linear_weights if linear_weights is None else linear_weights
        body = NeoHookeanBody(
            self.nodes, self.cells, oracle_weights, self.lame, TRIANGLE_QUADRATURE_RULE
        )
        contact_nodes = np.flatnonzero(np.isclose(self.nodes[:, 1], 0.0))
        prescribed_mask = np.tile(np.isclose(self.nodes[:, 1:], -1.0), (1, 2))
        return CircleContact(body, self.circle, contact_nodes, prescribed_mask)

    @classmethod
    def from_seed(cls, seed):
        """Return the random problem of a seed, with lengths in units of the block's height.

        The shear modulus is 1.
        """
        rng = np.random.default_rng(seed)
        radius = rng.uniform(0.4, 1.5)
        translation, depth, increments = 0.0, 0.0, []
        by_force = rng.random() < 0.25
        for k in range(rng.integers(2, 6)):
            if k == 0 or rng.random() < 0.5:
                depth = rng.uniform(0.02, 0.3)  # depth below the first contact / radius
            if k > 0 or rng.random() < 0.3:
                translation += rng.uniform(-0.5, 0.5)
            if by_force and k > 0:
                increments.append((translation * radius, None, -2.0 * depth * radius))
            else:
                increments.append((translation * radius, -depth * min(radius, 1.0)))
        return cls(
            linear_weights=bool(rng.random() < 0.6),
            friction=0.0 if rng.random() < 0.15 else rng.uniform(0.02, 0.8),
            increments=increments,
            offset=rng.uniform(-0.4, 0.4),
            radius=radius,
            gap=rng.choice([0.0, rng.uniform(0.0, 0.02)]),
            nu=rng.uniform(0.0, 0.45),
            divisions=rng.integers((6, 3), (10, 7)),
            jiggle=rng.uniform(0.0, 0.2),
            seed=seed,
        )


def displacement_and_translation(state):
    """Return the displacements (n, 2) of a state and the circle's translation (2,)."""
    return state.displacement.array_r.reshape(-1, 2), state.pairs[0].translation


PRESSING_TRANSLATIONS = [(0.0, -0.1), (0.0, -0.25)]
CIRCLE_PROBLEMS_BY_NAME = {
    "new": CircleProblem(
        True, 0.3, [*PRESSING_TRANSLATIONS, (0.4, -0.25), (0.75, -0.25)], jiggle=0.1
    ),
    "new, without friction": CircleProblem(
        True, 0.0, [*PRESSING_TRANSLATIONS, (0.35, -0.3)], offset=-0.17
    ),
    "new, to and fro": CircleProblem(
        True, 0.5, [(0.1, -0.2), (0.4, -0.2), (0.05, -0.22)], offset=0.13
    ),
    "standard": CircleProblem(
        False, 0.3, [*PRESSING_TRANSLATIONS, (0.4, -0.25), (0.75, -0.25)], offset=-0.2
    ),
    "standard, without friction": CircleProblem(
        False, 0.0, [*PRESSING_TRANSLATIONS, (0.35, -0.3)], jiggle=0.1
    ),
}


def solve_and_find_largest_violations(problem):
    """Return each condition's largest violation in the accepted states, and the library's error."""
    states, error = problem.accepted_states_and_error
    contact, history, all_violations = (
        problem.oracle_contact(),
        [displacement_and_translation(states[0])],
        [],
    )
    for motion, start, end in zip(problem.increments, states, states[1:], strict=False):
        for fraction, substate in (*end.substates, (1.0, end)):
            history.append(displacement_and_translation(substate))
            violations = contact.largest_violations_in_last_increment(history)
            all_violations.append(
                violations
                | {"drive": prescribed_motion_error(contact, start, substate, fraction, motion)}
            )
    return largest_violation_by_name(all_violations), error


def largest_violation_by_name(violations_of_states):
    """Return the largest value of each name in a list of dictionaries."""
    return {
        name: max(violations[name] for violations in violations_of_states)
        for name in (violations_of_states[0] if violations_of_states else ())
    }


def prescribed_motion_error(contact, start, substate, fraction, prescribed_end):
    """Return the relative error of prescribed translations or forces within an increment.

    Prescribed values are linear in the fraction of the increment.
    """
    (u, U), (end_x, end_y, end_force) = displacement_and_translation(substate), prescribed_end
    r = contact.body.nodal_forces(u)
    (_, start_translation), length = displacement_and_translation(start), np.abs(U).max()
    errors = [abs(U[0] - start_translation[0] - fraction * (end_x - start_translation[0])) / length]
    if end_y is None:
        start_force = start.pairs[0].force[1]
        errors.append(
            abs(
                r[contact.contact_nodes, 1].sum()
                - start_force
                - fraction * (end_force - start_force)
            )
        )
        errors[1] /= np.abs(r).max()
    else:
        errors.append(
            abs(U[1] - start_translation[1] - fraction * (end_y - start_translation[1])) / length
        )
    return max(errors)


def disturb_supports(u, contact):
    """Disturb the displacements at the supports."""
    u[contact.prescribed_mask] += 1e-6


def disturb_inner_node(u, contact):
    """Disturb the displacement of one node inside the body."""
    u[np.abs(contact.body.nodes + np.array([0.0, 0.5])).sum(axis=1).argmin()] += 1e-6


def lift_open_node(u, contact):
    """Lift one node that is not in contact."""
    u[np.isclose(contact.body.nodes, [-1.0, 0.0]).all(axis=1), 1] += 1e-4


@pytest.mark.parametrize("name", CIRCLE_PROBLEMS_BY_NAME)
def test_states_obey_the_law_with_weights_of_their_kind_alone(name):
    problem = CIRCLE_PROBLEMS_BY_NAME[name]
    violations, error = solve_and_find_largest_violations(problem)
    assert error is None
    assert max(violations.values()) < RELATIVE_LAW_TOLERANCE
    states, _ = problem.accepted_states_and_error
    contact_with_other_weights, history = (
        problem.oracle_contact(not problem.linear_weights),
        list(map(displacement_and_translation, states)),
    )
    assert (
        contact_with_other_weights.largest_violations_in_last_increment(history)["equilibrium"]
        > 1e-3
    )
    cell_size = 2.0 / 6
    slip = np.abs(states[-1].pairs[0].slip).max()
    assert slip > cell_size or name.endswith("friction") or name == "new, to and fro"


# changes of displacements and of the translation, and factor of the friction coefficient
DISTURBANCES_BY_CONDITION = {
    "supports": (disturb_supports, 0.0, 1.0),
    "equilibrium": (disturb_inner_node, 0.0, 1.0),
    "tension": (lift_open_node, 0.0, 1.0),
    "penetration": (None, -1e-6, 1.0),
    "complementarity": (None, 1e-6, 1.0),
    "cone": (None, 0.0, 1 - 1e-5),
    "direction": (None, 0.0, 1 + 1e-5),
}


@pytest.mark.parametrize("name", DISTURBANCES_BY_CONDITION)
def test_a_disturbed_state_violates_the_condition(name):
    problem, (change, vertical_shift, mu_factor) = (
        CIRCLE_PROBLEMS_BY_NAME["new, to and fro"],
        DISTURBANCES_BY_CONDITION[name],
    )
    history = [
        displacement_and_translation(state)
        for state in list_states_and_substates(problem.accepted_states_and_error[0])
    ]
    contact = problem.oracle_contact()
    assert (
        max(contact.largest_violations_in_last_increment(history).values()) < RELATIVE_LAW_TOLERANCE
    )
    u, U = history[-1]
    u = u.copy()
    if change is not None:
        change(u, contact)
    circle = replace(contact.circle, friction=mu_factor * contact.circle.friction)
    changed_contact, shift = replace(contact, circle=circle), np.array([0.0, vertical_shift])
    assert (
        changed_contact.largest_violations_in_last_increment([*history[:-1], (u, U + shift)])[name]
        > 10 * RELATIVE_LAW_TOLERANCE
    )


def assert_law_holds_and_few_are_refused(solve_and_find_violations, seeds):
    """Assert that all accepted states obey the law and that few problems are refused."""
    refused = []
    for seed in seeds:
        violations, error = solve_and_find_violations(seed)
        assert max(violations.values(), default=0.0) < RELATIVE_LAW_TOLERANCE, (seed, violations)
        refused += [seed] * (error is not None)
    assert len(refused) <= MAX_REFUSED_FRACTION_OF_PROBLEMS * len(seeds), refused


@pytest.mark.random
def test_law_holds_in_every_accepted_state_and_few_problems_are_refused(request):
    # the last three problems have a second state that obeys the law but is unstable
    seeds = range(200) if request.config.getoption("--nightly") else (*range(7), 31, 129, 153)
    assert_law_holds_and_few_are_refused(
        lambda seed: solve_and_find_largest_violations(CircleProblem.from_seed(seed)), seeds
    )

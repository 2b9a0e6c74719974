"""Contact at large strains: accepted states of stated and random problems by outside arithmetic."""

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
from tests.contact.cases import finite_strain_residual, neo_hookean_stress, on_plane
from tests.oracle.large import CircleContact, NeoHookeanBody, RigidCircle

TOLERANCE = 1e-8
QUADRATURE_DEGREE = 4
TRIANGLE_RULE = basix.make_quadrature(basix.CellType.triangle, QUADRATURE_DEGREE)
MAX_REFUSED_SHARE = 0.05  # of random problems, at most


class CircleProblem:
    """A block on a held base, its top at height 0, and a circle that comes from above.

    Its way is the translation (2,) at the end of each increment; or across, None for a free
    vertical component, and the total force in that. Nodes are jiggled by a share of the cells'
    size; those of the boundary stay on their sides.
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
            inside = ~np.isclose(x[:, axis], low) & ~np.isclose(x[:, axis], high)
            step = jiggle * (high - low) / divisions[axis] * rng.uniform(-1, 1, len(x))
            x[:, axis] += np.where(inside, step, 0.0)
        self.linear_weights, self.lame = linear_weights, 2 * nu / (1 - 2 * nu)
        self.increments = [step if len(step) == 3 else (*step, 0.0) for step in increments]
        self.circle = RigidCircle((offset, radius + gap), radius, friction)

    @cached_property
    def accepted_states(self):
        """States of the library, the undeformed one first, and the error that ends them."""
        spaces = (Spaces.petrov_galerkin if self.linear_weights else Spaces.galerkin)(self.mesh)
        lame = fem.Constant(self.mesh, self.lame)

        stress = lambda F: neo_hookean_stress(F, lame=lame)  # noqa: E731
        u, residual = finite_strain_residual(spaces, stress, QUADRATURE_DEGREE)
        held = [prescribe(spaces.trial, k, on_plane(1, -1.0)) for k in range(2)]
        surface = Sphere(self.circle.centre, self.circle.radius)
        pair = ContactPair(on_plane(1, 0.0), surface, self.circle.friction)
        problem = ContactProblem.of_residual(residual, u, held, pair)
        self.nodes = spaces.trial.tabulate_dof_coordinates()[:, :2]
        self.cells = spaces.trial.dofmap.list
        states = [problem.undeformed]
        for across, down, force in self.increments:
            motion = Motion((across, down), force=(0.0, force))
            try:
                states.append(problem.step(states[-1], motions=motion))
            except ContactFailed as error:
                return states, error
        return states, None

    def oracle_contact(self, linear_weights=None):
        """The same contact by the oracle, once the library has stated its nodes."""
        linear = self.linear_weights if linear_weights is None else linear_weights
        body = NeoHookeanBody(self.nodes, self.cells, linear, self.lame, TRIANGLE_RULE)
        touching = np.flatnonzero(np.isclose(self.nodes[:, 1], 0.0))
        held = np.tile(np.isclose(self.nodes[:, 1:], -1.0), (1, 2))
        return CircleContact(body, self.circle, touching, held)

    @classmethod
    def from_seed(cls, seed):
        """Lengths over the block's height, stresses over the shear modulus."""
        rng = np.random.default_rng(seed)
        radius = rng.uniform(0.4, 1.5)
        across, down, way = 0.0, 0.0, []
        pushed = rng.random() < 0.25
        for k in range(rng.integers(2, 6)):
            if k == 0 or rng.random() < 0.5:
                down = rng.uniform(0.02, 0.3)  # depth below the first contact, over the radius
            if k > 0 or rng.random() < 0.3:
                across += rng.uniform(-0.5, 0.5)
            if pushed and k > 0:
                way.append((across * radius, None, -2.0 * down * radius))
            else:
                way.append((across * radius, -down * min(radius, 1.0)))
        return cls(
            linear_weights=bool(rng.random() < 0.6),
            friction=0.0 if rng.random() < 0.15 else rng.uniform(0.02, 0.8),
            way=way,
            offset=rng.uniform(-0.4, 0.4),
            radius=radius,
            gap=rng.choice([0.0, rng.uniform(0.0, 0.02)]),
            nu=rng.uniform(0.0, 0.45),
            divisions=rng.integers((6, 3), (10, 7)),
            jiggle=rng.uniform(0.0, 0.2),
            seed=seed,
        )


def states_with_substates(states):
    """Each state, after the inner ends of the parts into which its increment was cut."""
    return [part for state in states for part in (*(at for _, at in state.substates), state)]


def of(state):
    """Displacements (n, 2) and the circle's translation."""
    return state.displacement.array_r.reshape(-1, 2), state.pairs[0].translation


PRESSED = [(0.0, -0.1), (0.0, -0.25)]
CASES = {
    "new": CircleProblem(True, 0.3, [*PRESSED, (0.4, -0.25), (0.75, -0.25)], jiggle=0.1),
    "new, without friction": CircleProblem(True, 0.0, [*PRESSED, (0.35, -0.3)], offset=-0.17),
    "new, to and fro": CircleProblem(
        True, 0.5, [(0.1, -0.2), (0.4, -0.2), (0.05, -0.22)], offset=0.13
    ),
    "standard": CircleProblem(False, 0.3, [*PRESSED, (0.4, -0.25), (0.75, -0.25)], offset=-0.2),
    "standard, without friction": CircleProblem(False, 0.0, [*PRESSED, (0.35, -0.3)], jiggle=0.1),
}


def outcome(problem):
    """Largest violation of each condition in the states that the library accepts; its error."""
    states, error = problem.accepted_states
    contact, history, every = problem.oracle_contact(), [of(states[0])], []
    for motion, start, end in zip(problem.increments, states, states[1:], strict=False):
        for share, part in (*end.substates, (1.0, end)):
            history.append(of(part))
            found = contact.violations(history)
            every.append(found | {"drive": drive_error(contact, start, part, share, motion)})
    return largest_violations(every), error


def largest_violations(every):
    """The largest of each of some numbers by name."""
    return {name: max(found[name] for found in every) for name in (every[0] if every else ())}


def drive_error(contact, start, part, share, motion):
    """How far translation and force are from the way to those at the end of the increment."""
    (u, U), (across, down, force) = of(part), motion
    r = contact.body.nodal_forces(u)
    (_, was), size = of(start), np.abs(U).max()
    away = [abs(U[0] - was[0] - share * (across - was[0])) / size]
    if down is None:
        pushed = start.pairs[0].force[1]
        away.append(abs(r[contact.contact_nodes, 1].sum() - pushed - share * (force - pushed)))
        away[1] /= np.abs(r).max()
    else:
        away.append(abs(U[1] - was[1] - share * (down - was[1])) / size)
    return max(away)


def held(u, contact):
    u[contact.prescribed_mask] += 1e-6


def inside(u, contact):
    u[np.abs(contact.body.nodes + np.array([0.0, 0.5])).sum(axis=1).argmin()] += 1e-6


def open_node(u, contact):
    u[np.isclose(contact.body.nodes, [-1.0, 0.0]).all(axis=1), 1] += 1e-4


@pytest.mark.parametrize("name", CASES)
def test_states_obey_the_law_with_weights_of_their_kind_alone(name):
    problem = CASES[name]
    found, error = outcome(problem)
    assert error is None
    assert max(found.values()) < TOLERANCE
    states, _ = problem.accepted_states
    other, history = problem.oracle_contact(not problem.linear_weights), list(map(of, states))
    assert other.violations(history)["equilibrium"] > 1e-3
    element = 2.0 / 6
    slid = np.abs(states[-1].pairs[0].slip).max()
    assert slid > element or name.endswith("friction") or name == "new, to and fro"


WRONG = {  # line that sees it: change of displacements, of the translation, factor of mu
    "supports": (held, 0.0, 1.0),
    "equilibrium": (inside, 0.0, 1.0),
    "tension": (open_node, 0.0, 1.0),
    "penetration": (None, -1e-6, 1.0),
    "complementarity": (None, 1e-6, 1.0),
    "cone": (None, 0.0, 1 - 1e-5),
    "direction": (None, 0.0, 1 + 1e-5),
}


@pytest.mark.parametrize("name", WRONG)
def test_outside_arithmetic_sees_what_is_wrong(name):
    problem, (change, lowered, factor) = CASES["new, to and fro"], WRONG[name]
    history = [of(state) for state in states_with_substates(problem.accepted_states[0])]
    contact = problem.oracle_contact()
    assert max(contact.violations(history).values()) < TOLERANCE
    u, U = history[-1]
    u = u.copy()
    if change is not None:
        change(u, contact)
    circle = replace(contact.circle, friction=factor * contact.circle.friction)
    wrong, moved = replace(contact, circle=circle), np.array([0.0, lowered])
    assert wrong.violations([*history[:-1], (u, U + moved)])[name] > 10 * TOLERANCE


def assert_law_in_accepted_states(outcome, seeds):
    """In every accepted state of problems of which few are given up."""
    given_up = []
    for seed in seeds:
        worst, error = outcome(seed)
        assert max(worst.values(), default=0.0) < TOLERANCE, (seed, worst)
        given_up += [seed] * (error is not None)
    assert len(given_up) <= MAX_REFUSED_SHARE * len(seeds), given_up


@pytest.mark.random
def test_law_holds_in_every_accepted_state_and_few_problems_are_given_up(request):
    # the last ways have a state besides that obeys the law, but is not stable
    seeds = range(200) if request.config.getoption("--nightly") else (*range(7), 31, 129, 153)
    assert_law_in_accepted_states(lambda seed: outcome(CircleProblem.from_seed(seed)), seeds)

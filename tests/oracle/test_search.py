"""The oracle's search of all statuses, its proofs, and bodies that are loose."""

from dataclasses import replace
from itertools import product

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.contact import (
    ContactPair,
    ContactProblem,
    Motion,
    NoEquilibrium,
    NotFound,
    NotUnique,
    Plane,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from tests.contact.cases import at
from tests.contact.residuals import Step, _supports, residuals, worst
from tests.oracle.proofs import contradictions, contradicts, linear_increment
from tests.oracle.random_contact import problem
from tests.oracle.search import Found, search


def equilibria(increment):
    """All motions that obey the law, by trying each set of statuses."""
    points, size = increment.normal.shape
    mu, found = increment.mu, []
    for statuses in product(range(4), repeat=points):
        rows = [increment.balance]
        for i, status in enumerate(statuses):
            r_n, r_t = increment.normal[i], increment.shear[i]
            slides = r_t + (0, 0, 1, -1)[status] * mu[i] * r_n
            rows.append(r_n if status == 0 else increment.gap[i])
            rows.append(increment.slip[i] if status == 1 else slides)
        A = np.vstack(rows)
        scale = np.abs(A[:, :-1]).max(axis=1, keepdims=True)
        A = A / np.where(scale > 0, scale, 1.0)
        if np.linalg.cond(A[:, :-1]) > 1e10:
            continue
        z = np.append(np.linalg.solve(A[:, :-1], -A[:, -1]), 1.0)
        n, t, g, v = (
            part @ z for part in (increment.normal, increment.shear, increment.gap, increment.slip)
        )
        force, length = 1e-9 * np.abs(n).max(), 1e-9 * np.abs(z[:-1]).max()
        held = np.abs(t) <= mu * n + force
        braked = (t * v <= force * np.abs(v).max()) | np.isin(statuses, (0, 1))
        if n.min() >= -force and g.min() >= -length and held.all() and braked.all():
            found.append(z[: size - 1])
    return found


class Pressed:
    """A block with five nodes under a plate that a force presses and pushes."""

    def __init__(self, seed):
        rng = np.random.default_rng((11, seed))
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, float(rng.uniform(0.4, 1.0))), (2, 1))
        top = mesh.geometry.x[:, 1].max()
        method = (Spaces.galerkin, Spaces.petrov_galerkin)[seed % 2]
        body = Body(method(mesh), Material(1000.0, 0.3), StressState.PLANE_STRAIN)
        self.space = body.spaces.trial
        self.K = assemble_matrix(body.stiffness())
        self.conditions = [prescribe(self.space, axis, at(1, 0.0)) for axis in (0, 1)]
        mu, smooth = float(rng.uniform(0.2, 2.5)), float(rng.uniform(0.2, 1.8))
        slope = rng.uniform(-0.3, 0.3)
        touching = np.array([0.0 if slope > 0 else 2.0, top])
        push = float(rng.uniform(-1, 1)) * mu
        motion = Motion((None, None), (push, -1.0))
        friction = lambda x: mu * (x[0] > smooth)  # noqa: E731
        plate = Plane(touching, (slope, -1.0))
        self.pairs = [ContactPair(at(1, top), plate, friction, [motion])]
        self.loads = [self.K.createVecLeft()]

    def stated(self):
        supports = Reduction.dirichlet(self.space, self.conditions)
        return ContactProblem(self.K, supports, self.pairs, self.space)

    def increment(self):
        return linear_increment(self, [])


KINDS = {seed: bool(equilibria(Pressed(seed).increment())) for seed in range(24)}


def test_brute_force_meets_both():
    assert 5 <= sum(KINDS.values()) <= 19


@pytest.mark.parametrize("seed", KINDS)
def test_search_finds_a_state_where_trying_all_statuses_does_and_nowhere_else(seed):
    increment = Pressed(seed).increment()
    found = search(increment)
    assert (found.z is not None) == KINDS[seed]
    assert bool(found.closed) != KINDS[seed]
    if found.closed:
        assert contradicts(contradictions(increment, found.closed))


@pytest.mark.parametrize("seed", [seed for seed, there in KINDS.items() if not there])
def test_increments_without_a_state_are_refused(seed):
    stated = Pressed(seed)
    with pytest.raises((NoEquilibrium, NotFound)):
        stated.stated().step(stated.stated().undeformed, stated.loads[0], stated.pairs[0].motions)


# -- proofs ----------------------------------------------------------------------------------


def refused(seed, kind):
    stated = problem(seed)
    with pytest.raises(kind) as caught:
        stated.solve()
    assert type(caught.value) is kind
    return stated, caught.value


def test_closed_branches_contradict_the_law_and_hold_all_statuses():
    """Statics alone do not rule an equilibrium out here, but elasticity does."""
    stated, error = refused(276, NotFound)
    increment = linear_increment(stated, error.states)
    branches = search(increment).closed
    assert contradicts(contradictions(increment, branches))
    # what is no proof is not taken for one
    assert not contradicts(contradictions(increment, branches[1:]))
    assert not contradicts(contradictions(increment, (*branches, branches[0])))
    stretched = replace(branches[0], normal=1.001 * branches[0].normal)
    assert not contradicts(contradictions(increment, (stretched, *branches[1:])))
    wider = branches[-1].allowed | branches[-1].allowed.any(axis=1, keepdims=True)
    widened = replace(branches[-1], allowed=wider)
    assert not contradicts(contradictions(increment, (*branches[:-1], widened)))
    # a search that is not finished proves nothing
    assert search(increment, most=30_000) == Found()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1310, 2276])
def test_other_searches_prove_it_too(seed):
    stated, error = refused(seed, NotFound)
    increment = linear_increment(stated, error.states)
    branches = search(increment).closed
    assert branches
    assert contradicts(contradictions(increment, branches))


# -- loose bodies ----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [103, 762, 1386])
def test_loose_bodies_are_told(seed):
    """The state attached has no forces and open gaps everywhere, so that others do, too."""
    stated, error = refused(seed, NotUnique)
    assert "the body is loose" in str(error)
    steps = [Step.of(state) for state in (*error.states, error.state)]
    rng = np.random.default_rng(seed)
    x = stated.space.tabulate_dof_coordinates()[:, : steps[-1].displacement.shape[1]]
    least = min(pair.gap.min() for pair in error.state.pairs)
    assert least > 0
    turn = rng.normal(size=(x.shape[1], x.shape[1]))
    rigid = rng.normal(size=x.shape[1]) + (x - x.mean(axis=0)) @ (turn - turn.T) / np.ptp(x)
    moved = 0.1 * least / np.abs(rigid).max() * rigid
    moved[_supports(stated.conditions, *x.shape)[0]] = 0.0
    for displacement in (steps[-1].displacement, steps[-1].displacement + moved):
        steps[-1] = replace(steps[-1], displacement=displacement)
        assert worst(residuals(stated, steps)[-1:]) < 1e-8

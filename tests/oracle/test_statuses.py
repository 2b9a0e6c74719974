"""All sets of statuses of five nodes against the library, and bodies that are loose."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import prescribe
from pw_elements.contact import ContactPair, Motion, NoEquilibrium, NotFound, NotUnique, Plane
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, PW, Elastic, at
from tests.contact.residuals import Step, _supports, residuals, worst
from tests.oracle.proofs import linear_increment
from tests.oracle.random_contact import problem
from tests.oracle.search import search


class Pressed(Elastic):
    """A block with five nodes under a plate that a force presses and pushes."""

    def __init__(self, seed):
        rng = np.random.default_rng((11, seed))
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, float(rng.uniform(0.4, 1.0))), (2, 1))
        super().__init__(mesh, (GALERKIN, PW)[seed % 2])
        top = self.x[:, 1].max()
        self.mu, self.smooth = float(rng.uniform(0.2, 2.5)), float(rng.uniform(0.2, 1.8))
        slope = rng.uniform(-0.3, 0.3)
        self.touching = np.array([0.0 if slope > 0 else 2.0, top])
        self.normal = np.array([slope, -1.0]) / np.hypot(slope, 1.0)
        self.force = float(rng.uniform(-1, 1)) * self.mu, -1.0
        self.nodes = np.flatnonzero(np.isclose(self.x[:, 1], top))
        self.pair = ContactPair(
            at(1, top),
            Plane(self.touching, self.normal),
            lambda x: self.mu * (x[0] > self.smooth),
            [Motion((None, None), self.force)],
        )
        self.foot = self.clamped(at(1, 0.0))

    def equilibria(self):
        """All motions z, of nodes and of the plate, that obey the law: each set of statuses tried.

        What the law speaks of is linear in (z; 1), by the Schur complement of the nodes.
        """
        K, m = self.K[:, :], len(self.nodes)
        touch = (2 * self.nodes[:, None] + [0, 1]).ravel()
        foot = np.flatnonzero(np.isclose(self.x[:, 1], 0.0))
        held = (2 * foot[:, None] + [0, 1]).ravel()
        inner = np.setdiff1d(np.arange(len(K)), [*touch, *held])
        there = np.linalg.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, touch)])
        r, w = np.zeros((2, m, 2, 2 * m + 3))
        r[..., : 2 * m] = (K[np.ix_(touch, touch)] - K[np.ix_(touch, inner)] @ there).reshape(
            m, 2, -1
        )
        w[..., : 2 * m], w[..., 2 * m : -1] = np.eye(2 * m).reshape(m, 2, -1), -np.eye(2)
        tangent = np.array([-self.normal[1], self.normal[0]])
        (normal, shear), (gap, slip) = ((self.normal @ of, tangent @ of) for of in (r, w))
        gap[:, -1] = (self.x[self.nodes] - self.touching) @ self.normal
        balance = r.sum(axis=0)
        balance[:, -1] = -np.array(self.force)
        mu = self.mu * (self.x[self.nodes, 0] > self.smooth)
        found = []
        for statuses in product(range(4), repeat=m):
            rows = [balance]
            for i, status in enumerate(statuses):
                slides = shear[i] + (0, 0, 1, -1)[status] * mu[i] * normal[i]
                rows.append(normal[i] if status == 0 else gap[i])
                rows.append(slip[i] if status == 1 else slides)
            A = np.vstack(rows)
            A = A / np.maximum(np.abs(A[:, :-1]).max(axis=1, keepdims=True), 1e-300)
            if np.linalg.cond(A[:, :-1]) > 1e10:
                continue
            z = np.append(np.linalg.solve(A[:, :-1], -A[:, -1]), 1.0)
            n, t, g, v = (part @ z for part in (normal, shear, gap, slip))
            force, length = 1e-9 * np.abs(n).max(), 1e-9 * np.abs(z[:-1]).max()
            within = np.abs(t) <= mu * n + force
            braked = (t * v <= force * np.abs(v).max()) | np.isin(statuses, (0, 1))
            if n.min() >= -force and g.min() >= -length and within.all() and braked.all():
                found.append(z[:-1])
        return found


KINDS = {seed: Pressed(seed).equilibria() for seed in range(12)}


def test_brute_force_meets_both():
    assert 3 <= sum(map(bool, KINDS.values())) <= 9


@pytest.mark.parametrize("seed", KINDS)
def test_library_finds_a_state_where_trying_all_statuses_does_and_nowhere_else(seed):
    stated = Pressed(seed)
    if not KINDS[seed]:
        with pytest.raises((NoEquilibrium, NotFound)):
            stated.contact(stated.pair, stated.foot)
        return
    (state,) = stated.contact(stated.pair, stated.foot)
    moved = state.displacement.array_r.reshape(-1, 2)[stated.nodes].ravel()
    found = np.append(moved, state.pairs[0].translation)
    assert min(np.abs(found - z).max() for z in KINDS[seed]) < 1e-8 * np.abs(found).max()


@pytest.mark.parametrize("seed", [103, 762])
def test_loose_bodies_are_told(seed):
    """The state attached has no forces and open gaps everywhere, so that others do, too."""
    stated = problem(seed)
    with pytest.raises(NotUnique, match="the body is loose") as caught:
        stated.solve()
    error = caught.value
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


@pytest.mark.parametrize("seed", KINDS)
def test_search_finds_a_state_where_trying_all_statuses_does_and_nowhere_else(seed):
    one = Pressed(seed)
    stated = SimpleNamespace(
        K=one.K,
        space=one.space,
        loads=[one.K.createVecLeft()],
        conditions=[prescribe(one.space, axis, at(1, 0.0)) for axis in (0, 1)],
        pairs=[one.pair],
    )
    found = search(linear_increment(stated, []))
    assert (found is not None) == bool(KINDS[seed])

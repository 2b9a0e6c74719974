"""All sets of statuses of five nodes against the library, and bodies that are loose."""

from dataclasses import replace
from itertools import product

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


class Pressed(Elastic):
    """A block with five nodes under a plate that a force presses and pushes."""

    def __init__(self, seed):
        rng = np.random.default_rng((11, seed))
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, float(rng.uniform(0.4, 1.0))), (2, 1))
        top = mesh.geometry.x[:, 1].max()
        super().__init__(mesh, (GALERKIN, PW)[seed % 2])
        self.conditions = [prescribe(self.space, axis, at(1, 0.0)) for axis in (0, 1)]
        mu, smooth = float(rng.uniform(0.2, 2.5)), float(rng.uniform(0.2, 1.8))
        slope = rng.uniform(-0.3, 0.3)
        touching = np.array([0.0 if slope > 0 else 2.0, top])
        motion = Motion((None, None), (float(rng.uniform(-1, 1)) * mu, -1.0))
        friction = lambda x: mu * (x[0] > smooth)  # noqa: E731
        plate = Plane(touching, (slope, -1.0))
        self.pairs = [ContactPair(at(1, top), plate, friction, [motion])]
        self.loads = [self.nothing]


KINDS = {seed: equilibria(linear_increment(Pressed(seed), [])) for seed in range(12)}


def test_brute_force_meets_both():
    assert 3 <= sum(map(bool, KINDS.values())) <= 9


@pytest.mark.parametrize("seed", KINDS)
def test_library_finds_a_state_where_trying_all_statuses_does_and_nowhere_else(seed):
    stated = Pressed(seed)
    supports = stated.clamped(at(1, 0.0))
    if not KINDS[seed]:
        with pytest.raises((NoEquilibrium, NotFound)):
            stated.contact(stated.pairs, supports)
        return
    (state,) = stated.contact(stated.pairs, supports)
    place = linear_increment(stated, []).place
    nodes = [np.argmin(np.linalg.norm(stated.x - x, axis=1)) for x in place]
    moved = state.displacement.array_r.reshape(-1, 2)[nodes].ravel()
    found = np.append(moved, state.pairs[0].translation)
    assert min(np.abs(found - z).max() for z in KINDS[seed]) < 1e-8 * np.abs(found).max()


def refused(seed, kind):
    stated = problem(seed)
    with pytest.raises(kind) as caught:
        stated.solve()
    assert type(caught.value) is kind
    return stated, caught.value


@pytest.mark.parametrize("seed", [103, 762])
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

"""All sets of statuses of five nodes against the library, and bodies that are loose."""

from dataclasses import replace
from itertools import product

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import prescribe
from pw_elements.contact import ContactPair, Motion, NoEquilibrium, NotFound, NotUnique, Plane
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, PW, ElasticBody, on_plane
from tests.contact.residuals import (
    StepMotion,
    largest_residual,
    measure_residuals,
    prescribed_displacements,
)
from tests.oracle.proofs import linear_increment
from tests.oracle.random_contact import make_problem
from tests.oracle.search import search_statuses


class Pressed(ElasticBody):
    """A block with five nodes under a plate that a force presses and pushes."""

    def __init__(self, seed):
        rng = np.random.default_rng((11, seed))
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, float(rng.uniform(0.4, 1.0))), (2, 1))
        super().__init__(mesh, (GALERKIN, PW)[seed % 2])
        top = self.x[:, 1].max()
        mu, smooth = float(rng.uniform(0.2, 2.5)), float(rng.uniform(0.2, 1.8))
        slope = rng.uniform(-0.3, 0.3)
        plate = Plane((0.0 if slope > 0 else 2.0, top), (slope, -1.0))
        pushed = Motion((None, None), (float(rng.uniform(-1, 1)) * mu, -1.0))
        friction = lambda x: mu * (x[0] > smooth)  # noqa: E731
        self.nodes = np.flatnonzero(np.isclose(self.x[:, 1], top))
        self.pairs = [ContactPair(on_plane(1, top), plate, friction, [pushed])]
        self.foot, self.loads = self.clamp(on_plane(1, 0.0)), [self.zero_load]
        self.conditions = [prescribe(self.space, axis, on_plane(1, 0.0)) for axis in (0, 1)]

    def equilibria(self):
        """All motions z, of nodes and plate, that obey the law: each set of statuses is tried."""
        law = linear_increment(self, [])
        rows, mu, found = (law.normal, law.shear, law.gap, law.slip), law.mu, []
        for statuses in product(range(4), repeat=len(mu)):
            equations = [law.balance]
            for status, limit, normal, shear, gap, slip in zip(statuses, mu, *rows, strict=True):
                slides = shear + (0, 0, 1, -1)[status] * limit * normal
                equations += [normal if status == 0 else gap, slip if status == 1 else slides]
            A = np.vstack(equations)
            A = A / np.maximum(np.abs(A[:, :-1]).max(axis=1, keepdims=True), 1e-300)
            if np.linalg.cond(A[:, :-1]) > 1e10:
                continue
            z = np.append(np.linalg.solve(A[:, :-1], -A[:, -1]), 1.0)
            n, t, g, v = (part @ z for part in rows)
            force, length = 1e-9 * np.abs(n).max(), 1e-9 * np.abs(z[:-1]).max()
            within = np.abs(t) <= mu * n + force
            braked = (t * v <= force * np.abs(v).max()) | np.isin(statuses, (0, 1))
            if n.min() >= -force and g.min() >= -length and within.all() and braked.all():
                found.append(z[:-1])
        return found


def test_library_and_search_find_a_state_where_trying_all_statuses_does_and_nowhere_else():
    solved = []
    for seed in range(8):
        stated = Pressed(seed)
        known = stated.equilibria()
        assert (search_statuses(linear_increment(stated, [])) is not None) == bool(known), seed
        solved.append(bool(known))
        if not known:
            with pytest.raises((NoEquilibrium, NotFound)):
                stated.solve_contact(stated.pairs, stated.foot)
            continue
        (state,) = stated.solve_contact(stated.pairs, stated.foot)
        moved = state.displacement.array_r.reshape(-1, 2)[stated.nodes].ravel()
        found = np.append(moved, state.pairs[0].translation)
        assert min(np.abs(found - z).max() for z in known) < 1e-8 * np.abs(found).max(), seed
    assert 3 <= sum(solved) <= 6


@pytest.mark.parametrize("seed", [103, 762])
def test_loose_bodies_are_told(seed):
    """The state attached has no forces, nor has one that is moved off whatever just touches."""
    stated = make_problem(seed)
    with pytest.raises(NotUnique, match="the body is loose") as caught:
        stated.solve()
    error = caught.value
    steps = [StepMotion.from_state(state) for state in (*error.states, error.state)]
    rng = np.random.default_rng(seed)
    x = stated.space.tabulate_dof_coordinates()[:, : steps[-1].displacement.shape[1]]
    gaps = np.concatenate([pair.gap for pair in error.state.pairs])
    least = gaps[gaps > 1e-12 * np.ptp(x)].min()
    assert np.sum(gaps <= 1e-12 * np.ptp(x)) <= 1
    turn = rng.normal(size=(x.shape[1], x.shape[1]))
    rigid = rng.normal(size=x.shape[1]) + (x - x.mean(axis=0)) @ (turn - turn.T) / np.ptp(x)
    moved = 0.1 * least / np.abs(rigid).max() * rigid
    moved[prescribed_displacements(stated.conditions, *x.shape)[0]] = 0.0

    def wrong(way):
        there = replace(steps[-1], displacement=steps[-1].displacement + way * moved)
        return largest_residual(measure_residuals(stated, [*steps[:-1], there])[-1:])

    assert wrong(0) < 1e-8
    assert min(wrong(1), wrong(-1)) < 1e-8

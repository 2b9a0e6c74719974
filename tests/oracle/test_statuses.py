"""The library finds the states that trying all statuses of five contact nodes finds.

Another test shows that the position of a loose body is not unique.
"""

from dataclasses import replace
from itertools import product

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import prescribe
from pw_elements.contact import (
    ContactPair,
    Motion,
    NoEquilibrium,
    NotUnique,
    Plane,
    SolutionNotFound,
)
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, ElasticBody, on_plane
from tests.contact.residuals import (
    DisplacementAndTranslations,
    largest_residual,
    prescribed_mask_and_displacements,
    recompute_residuals_per_step,
)
from tests.oracle.proofs import linearise_next_increment
from tests.oracle.random_contact import make_problem
from tests.oracle.search import find_state_by_status_search


class PlateOnFiveNodes(ElasticBody):
    """A block with five contact nodes under a plate that a force presses and pushes."""

    def __init__(self, seed):
        rng = np.random.default_rng((11, seed))
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, float(rng.uniform(0.4, 1.0))), (2, 1))
        super().__init__(mesh, (GALERKIN, PETROV_GALERKIN)[seed % 2])
        top = self.x[:, 1].max()
        mu, frictionless_end = float(rng.uniform(0.2, 2.5)), float(rng.uniform(0.2, 1.8))
        slope = rng.uniform(-0.3, 0.3)
        plate = Plane((0.0 if slope > 0 else 2.0, top), (slope, -1.0))
        pushed = Motion((None, None), (float(rng.uniform(-1, 1)) * mu, -1.0))
        friction = lambda x: mu * (x[0] > frictionless_end)  # noqa: E731
        self.nodes = np.flatnonzero(np.isclose(self.x[:, 1], top))
        self.pairs = [ContactPair(on_plane(1, top), plate, friction, [pushed])]
        self.base_supports, self.loads = (
            self.make_clamping_supports(on_plane(1, 0.0)),
            [self.zero_load],
        )
        self.conditions = [prescribe(self.space, axis, on_plane(1, 0.0)) for axis in (0, 1)]

    def find_equilibria_by_enumeration(self):
        """Return all motions z of nodes and plate that obey the law, by trying all statuses."""
        law = linearise_next_increment(self, [])
        rows, mu, solutions = (law.normal, law.shear, law.gap, law.slip), law.mu, []
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
            n, t, g, v = (row_set @ z for row_set in rows)
            force, length = 1e-9 * np.abs(n).max(), 1e-9 * np.abs(z[:-1]).max()
            in_cone = np.abs(t) <= mu * n + force
            is_dissipative = (t * v <= force * np.abs(v).max()) | np.isin(statuses, (0, 1))
            if n.min() >= -force and g.min() >= -length and in_cone.all() and is_dissipative.all():
                solutions.append(z[:-1])
        return solutions


def test_library_and_search_find_a_state_exactly_where_trying_all_statuses_does():
    has_solution = []
    for seed in range(8):
        problem = PlateOnFiveNodes(seed)
        equilibria = problem.find_equilibria_by_enumeration()
        assert (
            find_state_by_status_search(linearise_next_increment(problem, [])) is not None
        ) == bool(equilibria), seed
        has_solution.append(bool(equilibria))
        if not equilibria:
            with pytest.raises((NoEquilibrium, SolutionNotFound)):
                problem.solve_contact(problem.pairs, problem.base_supports)
            continue
        (state,) = problem.solve_contact(problem.pairs, problem.base_supports)
        node_motion = state.displacement.array_r.reshape(-1, 2)[problem.nodes].ravel()
        motion = np.append(node_motion, state.pairs[0].translation)
        assert min(np.abs(motion - z).max() for z in equilibria) < 1e-8 * np.abs(motion).max(), seed
    assert 3 <= sum(has_solution) <= 6


@pytest.mark.parametrize("seed", [103, 762])
def test_loose_bodies_are_not_unique(seed):
    """The position of a loose body is not unique: two states without contact forces exist.

    One of them is the state in the error. In the other one, the body is moved by a small rigid
    motion, away from the surface that one of its nodes may touch without force.
    """
    problem = make_problem(seed)
    with pytest.raises(NotUnique, match="the body is loose") as caught:
        problem.solve()
    error = caught.value
    steps = [
        DisplacementAndTranslations.from_state(state) for state in (*error.states, error.state)
    ]
    rng = np.random.default_rng(seed)
    x = problem.space.tabulate_dof_coordinates()[:, : steps[-1].displacement.shape[1]]
    gaps = np.concatenate([pair.gap for pair in error.state.pairs])
    smallest_gap = gaps[gaps > 1e-12 * np.ptp(x)].min()
    assert np.sum(gaps <= 1e-12 * np.ptp(x)) <= 1
    matrix = rng.normal(size=(x.shape[1], x.shape[1]))
    rigid_motion = rng.normal(size=x.shape[1]) + (x - x.mean(axis=0)) @ (
        matrix - matrix.T
    ) / np.ptp(x)
    shift = 0.1 * smallest_gap / np.abs(rigid_motion).max() * rigid_motion
    shift[prescribed_mask_and_displacements(problem.conditions, *x.shape)[0]] = 0.0

    def largest_residual_of_shifted_state(sign):
        moved_step = replace(steps[-1], displacement=steps[-1].displacement + sign * shift)
        return largest_residual(
            recompute_residuals_per_step(problem, [*steps[:-1], moved_step])[-1:]
        )

    assert largest_residual_of_shifted_state(0) < 1e-8
    assert min(largest_residual_of_shifted_state(1), largest_residual_of_shifted_state(-1)) < 1e-8

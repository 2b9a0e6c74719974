"""A loose block on another one, up to a million times as stiff or soft, pressed and pushed."""

import numpy as np
import pytest

from pw_elements import Direct, Iterative, Reduction, prescribe
from pw_elements.contact import ContactProblem, NoEquilibrium, NotFound, NotUnique
from tests.contact.cases import on_plane
from tests.contact.two_bodies import StackedBlocks
from tests.oracle.search import LinearIncrement, search_statuses

SUITE, NIGHTLY = (*range(5), 9), range(60)  # the last of few is refused


class Blocks:
    """A problem by seed: meshes that do not match, friction, forces on top in one or two steps."""

    def __init__(self, seed, **options):
        random = np.random.default_rng(seed)
        ratio = 10 ** (random.uniform(2, 6) * random.choice([-1, 1]))
        divisions = tuple(int(n) for n in random.integers(2, 6, 2))
        cell, slave = (
            random.choice(["triangle", "quadrilateral"]),
            random.choice(["upper", "lower"]),
        )
        stack = StackedBlocks(
            divisions,
            cell,
            upper_range=(random.uniform(0, 0.2), random.uniform(0.7, 1)),
            modulus_ratio=ratio,
        )
        mu, press = random.uniform(0.1, 0.7), 1e-3 * min(1.0, ratio)
        push = random.uniform(-0.95, 0.95) * mu * press
        self.loads = [stack.traction_load((0.0, -press)), stack.traction_load((push, -press))][
            random.integers(2) :
        ]
        held = [prescribe(stack.space, i, on_plane(1, 0.0)) for i in (0, 1)]
        self.x = stack.space.tabulate_dof_coordinates()
        supports = Reduction.dirichlet(stack.space, held)
        self.problem = ContactProblem(
            stack.K, supports, stack.make_pair(slave, mu), stack.space, **options
        )

    def solve(self):
        """States, the one that a refusal follows last, and the load that is refused, if any."""
        states = [self.problem.undeformed]
        for load in self.loads:
            try:
                states.append(self.problem.step(states[-1], load))
            except NoEquilibrium:
                return states, None
            except (NotFound, NotUnique):
                return states, load
        return states, None

    def round_off(self, state):
        """That of a row of K a, of some 40 terms, over the largest contact force."""
        K = self.problem._K.copy()
        K.setValuesCSR(*K.getValuesCSR()[:2], np.abs(K.getValuesCSR()[2]))
        K.assemble()
        size = state.displacement.copy()
        size.abs()
        force = max(np.abs(pair.force_vector).max() for pair in state.pairs)
        return 20 * np.finfo(float).eps * (K * size).max()[1] / force

    def is_solved_by_search(self, state, load):
        """Whether a search of all statuses finds a state, by the contact points' motions alone."""
        interface, K = self.problem._stepping.interface, self.problem._K[:, :]
        kept = np.flatnonzero(self.x[:, 1].repeat(2) > 0.0)
        G, H = interface.motion[:, :][:, kept], interface.force[:, :][kept]
        n, m = len(kept), len(G)
        equations = np.block([[K[np.ix_(kept, kept)], -H], [G, np.zeros((m, m))]])
        known = np.zeros((n + m, m + 1))
        known[:n, -1], known[n:, :-1] = load.array_r[kept], np.eye(m)
        force = np.linalg.solve(equations, known)[n:].reshape(-1, 2, m + 1)
        moved, before = np.eye(m, m + 1).reshape(-1, 2, m + 1), np.zeros((m, m + 1))
        before[:, -1] = G @ state.displacement.array_r[kept]
        normal, gap = interface.normals(None), interface.gaps(None)
        tangent = normal[:, ::-1] * [-1.0, 1.0]

        def along(axes, vectors):
            return np.einsum("ma,mak->mk", axes, vectors)

        faced, seen = np.isfinite(gap), along(normal, moved)
        seen[faced, -1] += gap[faced]
        stated = LinearIncrement(
            along(normal, force),
            along(tangent, force),
            seen,
            along(tangent, moved - before.reshape(moved.shape)),
            np.zeros((0, m + 1)),
            interface.cone.steepest,
            faced,
            np.diag(K)[2 * interface.node].mean(),
        )
        return search_statuses(stated) is not None


@pytest.mark.random
def test_loose_blocks_are_refused_with_cause_only_and_iterations_solve_them_as_factors_do(request):
    """Whichever block is the stiffer one, and whichever has the nodes of the pair.

    Residuals are those of round-off, which is the stiffer body's; iterations need no remedies.
    """
    systems, most = 0, 0
    for seed in NIGHTLY if request.config.getoption("--nightly") else SUITE:
        blocks = Blocks(seed)
        states, load = blocks.solve()
        for state in states[1:]:
            assert state.residuals.largest() < 1e-9 + blocks.round_off(state), seed
        assert load is None or not blocks.is_solved_by_search(states[-1], load), seed
        (known, refused), (found, load) = (
            Blocks(seed, solver=solver, remedies=()).solve() for solver in (Direct(), Iterative())
        )
        assert (load is None) >= (refused is None), seed
        for a, b in zip(found[1:], known[1:], strict=False):
            assert (a.displacement - b.displacement).norm() < 1e-6 * b.displacement.norm(), seed
            systems, most = systems + a.iterations, most + a.report.krylov_iterations
    assert most < 40 * systems

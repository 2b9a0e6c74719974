"""Nodes that belong to several contact pairs: corners, grooves, slots and corners of two bodies."""

from itertools import chain, combinations

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, compute_midpoints, create_box, locate_entities_boundary
from scipy.optimize import fsolve

from pw_elements import Direct, Iterative, Sibling, Spaces, lumped_mass, prescribe
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactFields,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    NotUnique,
    Plane,
    SolutionNotFound,
    plot,
    solve_impact,
    write,
)
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals
from pw_elements.solvers import automatic
from tests.contact.cases import (
    ElasticBody,
    make_finite_strain_unknown_and_residual,
    on_plane,
)
from tests.contact.test_friction import assert_friction_law
from tests.contact.test_matching import BLOCK_HEIGHT, BLOCK_LENGTH, MatchingBlocks
from tests.contact.two_bodies import join_meshes
from tests.parallel import assert_same_on_processes

CORNER_FORCE = np.array([1.0, 2.0, 1.5])  # by which the block is pressed into the corner
BALL_WEIGHT = 3.0
NOT_DETERMINED = NotUnique, SolutionNotFound


class CornerBlock(ElasticBody):
    """A block with edges of length 1 in a corner at the origin, in the plane or in space."""

    def __init__(self, dim, divisions=3, comm=MPI.COMM_SELF, **options):
        if dim == 2:
            mesh = quadrilaterals(comm, (0, 0), (1, 1), (divisions, divisions))
        else:
            corners = [np.zeros(3), np.ones(3)]
            mesh = create_box(comm, corners, [divisions] * 3, CellType.hexahedron)
        super().__init__(mesh, state="plane strain" if dim == 2 else "solid", **options)

    def corner_pairs(self, mu=0.0, extent=2.0):
        """Return a pair with each coordinate plane; nodes lie within `extent` of the corner."""

        def make_pair(axis):
            return ContactPair(
                lambda x: np.isclose(x[axis], 0) & (x.max(axis=0) < extent),
                Plane(np.zeros(self.dim), np.eye(self.dim)[axis]),
                mu,
            )

        return [make_pair(axis) for axis in range(self.dim)]

    def press_into_corner(self, force):
        return self.body_force_load(-np.asarray(force))


def forces_of_pairs(state):
    return np.array([pair.force for pair in state.pairs])


def values_at_origin(pair):
    (k,) = np.flatnonzero(np.isclose(pair.position, 0).all(axis=1))
    return pair.force_vector[k], pair.slip[k], pair.friction[k] * pair.force_normal[k]


def solve_by_enumeration(K, load, normals, dofs):
    """Return displacements (n,) and forces (c,) that satisfy all conditions without friction.

    All subsets of the c conditions are tried: those of the subset are closed, and all others open.
    `dofs` (c, dim) are the unknowns of the node of each condition, and `normals` (c, dim) the
    normals of planes that touch it.
    """
    n, n_conditions = len(load), len(normals)
    N = np.zeros((n, n_conditions))
    N[dofs, np.arange(n_conditions)[:, None]] = normals
    size = np.abs(load).max()
    solutions = []
    for closed in chain.from_iterable(
        combinations(range(n_conditions), k) for k in range(n_conditions + 1)
    ):
        of_closed = N[:, closed]
        matrix = np.block([[K, -of_closed], [of_closed.T, np.zeros((len(closed),) * 2)]])
        if np.linalg.cond(matrix) > 1e12:
            continue
        solution = np.linalg.solve(matrix, np.append(load, np.zeros(len(closed))))
        u, force = solution[:n], np.zeros(n_conditions)
        force[list(closed)] = solution[n:]
        if force.min() > -1e-10 * size and (N.T @ u).min() > -1e-10 * np.abs(u).max():
            solutions.append((u, force))
    assert solutions, "no subset satisfies the conditions"
    for u, force in solutions[1:]:
        np.testing.assert_allclose(u, solutions[0][0], atol=1e-9 * np.abs(u).max())
        np.testing.assert_allclose(force, solutions[0][1], atol=1e-9 * size)
    return solutions[0]


@pytest.mark.parametrize(("dim", "extent"), [(2, 0.9), (3, 0.7)])
def test_frictionless_corner_is_the_only_solution_of_all_subsets(dim, extent):
    block, random = CornerBlock(dim, divisions=1), np.random.default_rng(dim)
    supports = block.make_clamping_supports(on_plane(0, 1.0))
    problem = block.contact_problem(block.corner_pairs(extent=extent), supports)
    free = np.flatnonzero(np.repeat(~np.isclose(block.x[:, 0], 1.0), dim))
    pairs = problem.undeformed.pairs
    normals = np.concatenate([pair.normal for pair in pairs])
    dofs = np.concatenate([dim * pair.node[:, None] + np.arange(dim) for pair in pairs])
    counts = np.zeros(dim + 1, dtype=int)  # of contacts at the corner
    for corner_load in (-1.0, -0.5, 1.0, 2.0):
        load = block.zero_load
        load.array[:] = random.normal(0.0, 0.2, load.array.size)
        load.array[dofs[np.isclose(block.x[dofs[:, 0] // dim], 0).all(axis=1)]] = corner_load
        state = problem.step(problem.undeformed, load)
        u, force = solve_by_enumeration(
            block.K[:, :][np.ix_(free, free)],
            load.array[free],
            normals,
            np.searchsorted(free, dofs),
        )
        np.testing.assert_allclose(
            state.displacement.array[free], u, atol=1e-9 * np.abs(u).max(), rtol=0
        )
        forces = np.concatenate([pair.force_normal for pair in state.pairs])
        np.testing.assert_allclose(forces, force, atol=1e-9, rtol=0)
        at_corner = [np.linalg.norm(values_at_origin(pair)[0]) > 1e-3 for pair in state.pairs]
        counts[sum(at_corner)] += 1
    assert counts[2:].sum() > 0, "the corner never touches two planes"
    assert counts[:2].sum() > 0, "the corner always touches two planes"


@pytest.mark.parametrize("dim", [2, 3])
def test_block_in_frictionless_corner_has_forces_of_statics(dim):
    block = CornerBlock(dim)
    problem = block.contact_problem(block.corner_pairs())
    state = problem.step(problem.undeformed, block.press_into_corner(CORNER_FORCE[:dim]))
    np.testing.assert_allclose(forces_of_pairs(state), np.diag(CORNER_FORCE[:dim]), atol=1e-10)
    corner_forces = [values_at_origin(pair)[0] for pair in state.pairs]
    assert np.all(np.diag(corner_forces) > 0.01)
    assert state.unique
    assert state.iterations == 1


@pytest.mark.parametrize("dim", [2, 3])
def test_block_in_rough_corner_satisfies_coulombs_law_in_each_pair(dim):
    block = CornerBlock(dim, divisions=5 - dim)
    problem = block.contact_problem(block.corner_pairs(0.3))
    state, motions = problem.undeformed, [None] * dim
    statuses = set()
    for factor, shift in ((1, 0.0), (1.5, 0.0), (1.5, 1e-3), (1.5, 2e-3)):
        force = factor * CORNER_FORCE[:dim]
        motions[0] = Motion((shift, *[-shift] * (dim - 1)))
        state = problem.step(state, block.press_into_corner(force), motions)
        np.testing.assert_allclose(forces_of_pairs(state).sum(axis=0), force, atol=1e-10)
        for pair in state.pairs:
            assert_friction_law(pair, lambda force, mu: mu * force, 0.3)
            statuses |= set(pair.status.tolist())
    assert {STICK, SLIP} <= statuses


@pytest.mark.parametrize(("dim", "n_paths"), [(2, 8), (3, 2)])
def test_random_load_paths_into_a_rough_corner_are_solved(dim, n_paths):
    block, n_mobilised = CornerBlock(dim, divisions=2), 0
    for seed in range(n_paths):
        random = np.random.default_rng(seed)
        coefficients = random.choice([0.1, 0.3, 0.6, 0.9], dim)
        pairs = [
            ContactPair(pair.nodes, pair.surface, mu)
            for pair, mu in zip(block.corner_pairs(), coefficients, strict=True)
        ]
        problem = block.contact_problem(pairs)
        state = problem.undeformed
        for size in (0.0, 1e-3, 1e-3):
            force = random.uniform(0.4, 2.0, dim)
            motions = [Motion(size * random.normal(size=dim)) for _ in range(dim)]
            state = problem.step(state, block.press_into_corner(force), motions)
            np.testing.assert_allclose(forces_of_pairs(state).sum(axis=0), force, atol=1e-9)
            for pair, mu in zip(state.pairs, coefficients, strict=True):
                slip_size = np.linalg.norm(pair.slip, axis=1, keepdims=True)
                limit = mu * np.maximum(0, pair.force_normal)[:, None]
                friction = np.linalg.norm(pair.force_tangential, axis=1, keepdims=True)
                assert (friction < limit + 1e-8 * force.max()).all()
                error = slip_size * pair.force_tangential + limit * pair.slip
                assert np.abs(error).max() < 1e-8 * force.max() * 1e-3
                force_at_corner, slip, _ = values_at_origin(pair)
                n_mobilised += np.linalg.norm(slip) > 1e-4 and force_at_corner.any()
    assert n_mobilised > n_paths


def test_node_that_two_planes_hold_has_friction_of_the_start():
    block = CornerBlock(2)
    problem = block.contact_problem(block.corner_pairs(0.3))
    pressed = problem.step(problem.undeformed, block.press_into_corner((1.0, 2.0)))
    for axis, pair in enumerate(pressed.pairs):
        force, slip, _ = values_at_origin(pair)
        assert abs(force[1 - axis]) < 1e-9 * force[axis]
        assert np.abs(slip).max() < 1e-15
    # the first plane pushes the block along the second one, on which the common node slips
    motions = [Motion((1e-3, 0.0)), None]
    pushed = problem.step(pressed, block.press_into_corner((1.0, 2.0)), motions)
    force, slip, limit = values_at_origin(pushed.pairs[1])
    np.testing.assert_allclose(slip, [1e-3, 0.0], atol=1e-15)
    assert force[0] == pytest.approx(-limit, rel=1e-9)
    force, _, limit = values_at_origin(pushed.pairs[0])
    assert abs(force[1]) < 1e-9 * force[0]
    # the friction of the end of this increment remains if nothing moves any more
    kept = problem.step(pushed, block.press_into_corner((1.0, 2.0)), motions)
    assert kept.iterations == 1
    for pair, pair_before in zip(kept.pairs, pushed.pairs, strict=True):
        np.testing.assert_allclose(
            values_at_origin(pair)[0], values_at_origin(pair_before)[0], atol=1e-9
        )


def test_state_reports_undetermined_friction(caplog):
    """A node that two planes hold may have any friction; where it slips, friction is determined."""
    block = CornerBlock(2)
    problem = block.contact_problem(block.corner_pairs(0.3))
    with caplog.at_level("INFO", logger="pw_elements"):
        pressed = problem.step(problem.undeformed, block.press_into_corner((1.0, 2.0)))
    assert "2 forces have a part of friction that is not determined" in caplog.text
    at_origin = [np.isclose(pair.position, 0).all(axis=1) for pair in pressed.pairs]
    np.testing.assert_array_equal(pressed.find_undetermined_friction(), at_origin)
    # the other choice of forces is admissible as well: the same sum, and friction within its limit
    (wall, _, wall_limit), (floor, _, floor_limit) = map(values_at_origin, pressed.pairs)
    change = 0.1 * min(wall_limit, floor_limit) * np.array([0.0, 1.0])
    other_wall, other_floor = wall + change, floor - change
    assert abs(other_wall[1]) < 0.3 * other_wall[0]
    assert abs(other_floor[0]) < 0.3 * other_floor[1]
    # the wall pushes the block along the floor, on which the common node slips
    pushed = problem.step(pressed, block.press_into_corner((1.0, 2.0)), [Motion((1e-3, 0.0)), None])
    wall_mask, floor_mask = pushed.find_undetermined_friction()
    assert np.count_nonzero(wall_mask) == 1
    assert not floor_mask.any()
    smooth = block.contact_problem(block.corner_pairs())
    state = smooth.step(smooth.undeformed, block.press_into_corner((1.0, 2.0)))
    assert not np.concatenate(state.find_undetermined_friction()).any()


def test_sticking_planes_share_friction_along_their_edge_equally():
    block = CornerBlock(3, divisions=2)
    problem = block.contact_problem(block.corner_pairs(0.8)[:2])
    state = problem.step(problem.undeformed, block.press_into_corner((1.0, 2.0, 0.2)))
    on_edges = [np.isclose(pair.position[:, :2], 0).all(axis=1) for pair in state.pairs]
    along_edge = [
        pair.force_tangential[on_edge, 2]
        for pair, on_edge in zip(state.pairs, on_edges, strict=True)
    ]
    for pair, on_edge in zip(state.pairs, on_edges, strict=True):
        assert (pair.status[on_edge] == STICK).all()
    np.testing.assert_allclose(*along_edge, atol=1e-8)
    assert np.abs(along_edge[0]).min() > 1e-4


def test_pairs_on_one_plane_that_share_a_node_are_refused():
    block = CornerBlock(2)
    halves = [
        ContactPair(lambda x, side=side: np.isclose(x[1], 0) & side(x[0]), Plane((0, 0), (0, 1)))
        for side in (lambda x: x < 0.4, lambda x: x > 0.3)
    ]
    with pytest.raises(ValueError, match=r"nodes at \(0\.3333, 0\) belong to two .* same normal"):
        block.contact_problem(halves)


class Ball(ElasticBody):
    """The half z > 0 of a ball of radius 1 and given weight, in a groove along z.

    The planes of the groove form the given angle with the vertical y.
    """

    def __init__(self, half_angle):
        box = create_box(MPI.COMM_SELF, [[-1, -1, 0], [1, 1, 1]], [2, 2, 1], CellType.hexahedron)

        def map_cube_to_ball(x):
            a, b, c = (x**2).T
            return x * np.sqrt(
                1 - np.stack([b + c, c + a, a + b]).T / 2 + np.stack([b * c, c * a, a * b]).T / 3
            )

        super().__init__(curved_mesh(box, map_cube_to_ball), state="solid")
        self.normals = [
            np.array([sign * np.cos(half_angle), np.sin(half_angle), 0]) for sign in (1, -1)
        ]
        volume = self.body_force_load((0, 1.0, 0)).sum()
        self.weight_load = self.body_force_load((0, -BALL_WEIGHT / volume, 0))
        top = self.x[np.argmax(self.x[:, 1])]
        self.supports = self.make_supports(
            (2, on_plane(2, 0.0)), (0, lambda x: np.isclose(x[:2], top[:2, None]).all(axis=0))
        )

    def groove_pairs(self, mu=0.0):
        """Return pairs of the nodes of the lower surface with each plane."""
        return [
            ContactPair(
                lambda x: np.isclose(np.linalg.norm(x, axis=0), 1.0) & (x[1] < 0.5),
                Plane(-normal, normal),
                mu,
            )
            for normal in self.normals
        ]


@pytest.mark.parametrize("half_angle", [np.pi / 4, 1.1])
def test_ball_in_frictionless_groove_has_forces_of_statics(half_angle):
    ball = Ball(half_angle)
    problem = ball.contact_problem(ball.groove_pairs(), ball.supports)
    state = problem.step(problem.undeformed, ball.weight_load)
    for pair, normal in zip(state.pairs, ball.normals, strict=True):
        exact = BALL_WEIGHT / 2 / np.sin(half_angle) * normal
        np.testing.assert_allclose(pair.force, exact, atol=1e-10)
        assert set(pair.status.tolist()) == {OPEN, SLIP}


def test_ball_in_rough_groove_is_in_equilibrium():
    ball = Ball(np.pi / 4)
    problem = ball.contact_problem(ball.groove_pairs(0.3), ball.supports)
    state = problem.step(problem.undeformed, ball.weight_load)
    forces = forces_of_pairs(state)
    np.testing.assert_allclose(forces.sum(axis=0)[:2], (0, BALL_WEIGHT), atol=1e-10)
    np.testing.assert_allclose(forces[0], forces[1] * [-1, 1, 1], atol=1e-8)
    frictionless = BALL_WEIGHT / 2 / np.sin(np.pi / 4)
    for pair in state.pairs:
        assert_friction_law(pair, lambda force, mu: mu * force, 0.3)
        assert pair.force_normal.sum() < 0.99 * frictionless


class Wedge(ElasticBody):
    """A block with the width 1 whose lower side is a wedge: its middle is its lowest point."""

    def __init__(self, slope):
        mesh = move_nodes(
            quadrilaterals(MPI.COMM_SELF, (0, 0), (1, 1), (4, 4)),
            lambda x: x + [0, 1, 0] * ((1 - x[:, 1:2]) * slope * np.abs(x[:, :1] - 0.5)),
        )
        super().__init__(mesh)
        self.slope = slope

    def groove_pairs(self, second_gap=0.0, mu=0.0):
        """Return pairs of both sides of the wedge with those of the groove; the tip is in both."""

        def make_pair(sign, gap):
            return ContactPair(
                lambda x: (
                    np.isclose(x[1], self.slope * np.abs(x[0] - 0.5))
                    & (sign * (x[0] - 0.5) > -1e-9)
                ),
                Plane((0.5, -gap), (-sign * self.slope, 1.0)),
                mu,
            )

        return [make_pair(1, 0.0), make_pair(-1, second_gap)]


@pytest.mark.parametrize("degrees", [1.0, 30.0, 60.0])
def test_wedge_in_groove_has_forces_of_statics(degrees):
    wedge = Wedge(np.tan(np.radians(degrees)))
    problem = wedge.contact_problem(wedge.groove_pairs())
    state = problem.step(problem.undeformed, wedge.body_force_load((0, -1.0)))
    weight = 1 - wedge.slope / 4
    half_normal_force = weight / 2 / np.cos(np.radians(degrees))
    for pair in state.pairs:
        assert pair.force_normal.sum() == pytest.approx(half_normal_force, abs=1e-10)
    tip_forces = [pair.force_normal[np.argmin(pair.position[:, 1])] for pair in state.pairs]
    assert tip_forces[0] == pytest.approx(tip_forces[1], abs=1e-8)
    assert tip_forces[0] > 0.01


def test_nearly_parallel_normals_are_refused():
    wedge = Wedge(np.tan(np.radians(0.4)))
    with pytest.raises(ValueError, match=r"\(0\.5, 0\) belong to two .* within 1 degree"):
        wedge.contact_problem(wedge.groove_pairs())
    # the planes have different gaps at first
    held = wedge.make_clamping_supports(on_plane(1, 1.0))
    problem = wedge.contact_problem(wedge.groove_pairs(second_gap=1e-3), held)
    apart = problem.step(problem.undeformed, None, [Motion((0, 1e-3)), Motion((0, 1.5e-3))])
    assert min(pair.force_normal.max() for pair in apart.pairs) > 0
    with pytest.raises(
        NOT_DETERMINED, match=r"nodes at \(0\.5, 0\) are pressed .* is not determined"
    ):
        problem.step(problem.undeformed, None, [Motion((0, 1e-3)), Motion((0, 2e-3))])


def test_more_planes_than_dimensions_at_a_node_are_refused():
    block = CornerBlock(2)
    chamfer = ContactPair(lambda x: np.isclose(x, 0).all(axis=0), Plane((-1e-3, -1e-3), (1.0, 1.0)))
    pairs = [*block.corner_pairs(), chamfer]
    problem = block.contact_problem(pairs)
    load = block.press_into_corner(CORNER_FORCE[:2])
    free = problem.step(problem.undeformed, load)
    assert free.pairs[2].force_normal[0] == 0
    with pytest.raises(NOT_DETERMINED, match="is not determined"):
        problem.step(problem.undeformed, load, [None, None, Motion((1e-3, 1e-3))])


def box_pairs(mu=0.0):
    """Return pairs of all four sides of a plane block with rigid planes; corners are in two."""
    corners = [(axis, end) for end in (0.0, 1.0) for axis in (0, 1)]
    return [
        ContactPair(
            on_plane(axis, end), Plane(np.full(2, end), (1 - 2 * end) * np.eye(2)[axis]), mu
        )
        for axis, end in corners
    ]


def test_rubber_block_between_four_planes_has_forces_of_uniform_stress():
    block = CornerBlock(2, divisions=2)
    u, residual = make_finite_strain_unknown_and_residual(block.body.spaces)
    problem = ContactProblem.of_residual(residual, u, [], box_pairs())
    shifts = [Motion((0.05, 0.0)), Motion((0.0, 0.05))]
    plates = [Motion((-0.05, 0.0)), Motion((0.0, -0.05))]
    state = problem.step(problem.undeformed, motions=[*shifts, *plates])
    plates = [Motion((None, 0.0), force=(-0.4, 0)), Motion((0.0, None), force=(0, -0.2))]
    state = problem.step(state, motions=[*shifts, *plates])
    exact = [(0.4, 0), (0, 0.2), (-0.4, 0), (0, -0.2)]
    np.testing.assert_allclose(forces_of_pairs(state), exact, atol=1e-9)

    def stress_errors(stretches):
        a, b = stretches
        log_J = np.log(a * b)
        return [a - 1 / a + 1.5 * log_J / a + 0.4, b - 1 / b + 1.5 * log_J / b + 0.2]

    a, b = fsolve(stress_errors, (0.9, 0.95), xtol=1e-13)
    assert state.pairs[2].translation[0] == pytest.approx(0.05 + a - 1, abs=1e-9)
    assert state.pairs[3].translation[1] == pytest.approx(0.05 + b - 1, abs=1e-9)
    corner, _, _ = values_at_origin(state.pairs[0])
    assert corner == pytest.approx((0.4 / 8, 0), abs=1e-9)


def test_rubber_block_in_rough_corner_satisfies_coulombs_law():
    block = CornerBlock(2, divisions=3)
    u, residual = make_finite_strain_unknown_and_residual(block.body.spaces)
    problem = ContactProblem.of_residual(residual, u, [], box_pairs(0.3))
    state = problem.undeformed
    for lift in (0.0, 0.02, 0.04):
        motions = [
            Motion((0.05, lift)),
            Motion((0.0, 0.05)),
            Motion((-0.05, -lift)),
            Motion((0.01, -0.03)),
        ]
        state = problem.step(state, motions=motions)
        np.testing.assert_allclose(forces_of_pairs(state).sum(axis=0), 0, atol=1e-9)
        for pair in state.pairs:
            assert_friction_law(pair, lambda force, mu: mu * force, 0.3)
        assert any(np.linalg.norm(values_at_origin(pair)[0]) > 1e-3 for pair in state.pairs)


def assert_states_of_direct_solver(solve_states, has_unique_shares=True):
    """Assert that both solvers give the same displacements, forces of nodes, gaps and slips.

    Forces of single pairs are compared at nodes whose friction is determined, and at all nodes if
    `has_unique_shares`.
    """
    direct_states, krylov_states = (solve_states(solver) for solver in (Direct(), Iterative()))
    for direct, krylov in zip(direct_states, krylov_states, strict=True):
        assert krylov.report.factorisations == 0
        assert krylov.residuals.largest() < 1e-9
        difference = (krylov.displacement - direct.displacement).norm()
        assert difference < 1e-9 * direct.displacement.norm()
        largest = max(np.abs(pair.force_vector).max() for pair in direct.pairs)
        node_force_error = sum_forces_at_nodes(krylov) - sum_forces_at_nodes(direct)
        assert np.abs(node_force_error).max() < 1e-9 * largest
        masks = krylov.find_undetermined_friction()
        undetermined_nodes = np.concatenate(
            [pair.node[mask] for pair, mask in zip(krylov.pairs, masks, strict=True)]
        )
        for pair, expected in zip(krylov.pairs, direct.pairs, strict=True):
            assert pair.translation == pytest.approx(expected.translation, rel=1e-9, abs=1e-12)
            np.testing.assert_allclose(pair.gap, expected.gap, atol=1e-11)
            np.testing.assert_allclose(pair.slip, expected.slip, atol=1e-11)
            error = np.abs(pair.force_vector - expected.force_vector).max(axis=1)
            is_compared = has_unique_shares | ~np.isin(pair.node, undetermined_nodes)
            assert error[is_compared].max() < 1e-9 * largest


def sum_forces_at_nodes(state):
    """Return the sum of the forces of all pairs at each node, for nodes 0 to the largest one."""
    dim = state.pairs[0].force_vector.shape[1]
    total = np.zeros((1 + max(pair.node.max() for pair in state.pairs), dim))
    for pair in state.pairs:
        np.add.at(total, pair.node, pair.force_vector)
    return total


@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("dim", [2, 3])
def test_krylov_method_has_the_states_of_the_direct_solver_in_a_corner(dim, mu):
    block = CornerBlock(dim, divisions=5 - dim)

    def solve_states(solver):
        problem = block.contact_problem(
            block.corner_pairs(mu), block.make_supports(), solver=solver
        )
        state, states = problem.undeformed, []
        for factor, shift in ((1, 0.0), (1.5, 0.0), (1.5, 1e-3)):
            motions = [Motion((shift, *[-shift] * (dim - 1))), *[None] * (dim - 1)]
            load = block.press_into_corner(factor * CORNER_FORCE[:dim])
            state = problem.step(state, load, motions)
            states.append(state)
        return states

    # along the edges in space, equal shares of friction would exceed the limit of one pair
    assert_states_of_direct_solver(solve_states, has_unique_shares=mu == 0 or dim == 2)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_krylov_method_has_the_states_of_the_direct_solver_in_grooves(mu):
    wedge, ball = Wedge(np.tan(np.pi / 6)), Ball(np.pi / 4)
    cases = [
        (wedge, wedge.make_supports(), wedge.body_force_load((0, -1.0))),
        (ball, ball.supports, ball.weight_load),
    ]
    for body, supports, load in cases:

        def solve_states(solver, body=body, supports=supports, load=load):
            problem = body.contact_problem(body.groove_pairs(mu=mu), supports, solver=solver)
            return [problem.step(problem.undeformed, load)]

        assert_states_of_direct_solver(solve_states)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_krylov_method_has_the_states_of_the_direct_solver_between_four_planes(mu):
    """Both plates move freely under forces; each of them shares its end nodes with other pairs."""
    block = CornerBlock(2, divisions=3)
    plates = [Motion((None, 0.0), force=(-0.4, 0)), Motion((0.0, None), force=(0, -0.2))]

    def solve_states(solver):
        problem = block.contact_problem(box_pairs(mu), block.make_supports(), solver=solver)
        return [problem.step(problem.undeformed, motions=[None, None, *plates])]

    assert_states_of_direct_solver(solve_states)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_krylov_method_has_the_states_of_the_direct_solver_in_rubber(mu):
    block = CornerBlock(2, divisions=3)
    u, residual = make_finite_strain_unknown_and_residual(block.body.spaces)

    def solve_states(solver):
        problem = ContactProblem.of_residual(residual, u, [], box_pairs(mu), solver=solver)
        state, states = problem.undeformed, []
        for lift in (0.0, 0.02, 0.04):
            shifts = (0.05, lift), (0.0, 0.05), (-0.05, -lift), (0.01, -0.03)
            state = problem.step(state, motions=[Motion(shift) for shift in shifts])
            states.append(state)
        return states

    # without friction at first, some corners would exceed the limit of friction of one pair
    assert_states_of_direct_solver(solve_states, has_unique_shares=mu == 0)


def test_automatic_choice_of_a_solver_includes_krylov_method(monkeypatch):
    for limit in ("_MIN_KRYLOV_DOFS", "_MIN_KRYLOV_DOFS_IF_HELD_BY_CONTACT"):
        monkeypatch.setattr(automatic, limit, 100)
    block = CornerBlock(3, divisions=2)
    problem = block.contact_problem(block.corner_pairs(), solver="auto")
    state = problem.step(problem.undeformed, block.press_into_corner(CORNER_FORCE))
    assert state.report.method.startswith("GMRES")
    np.testing.assert_allclose(forces_of_pairs(state), np.diag(CORNER_FORCE), atol=1e-9)


class CornerOfThreeBlocks(ElasticBody):
    """A block with edges of length 1 on a second block and beside a third one."""

    def __init__(self, comm=MPI.COMM_SELF, divisions=(4, 3, 3)):
        corners = [((0, 0), (1, 1)), ((0, -1), (1, 0)), ((-1, 0), (0, 1))]
        block, floor, wall = (
            quadrilaterals(MPI.COMM_SELF, *ends, (n, n))
            for ends, n in zip(corners, divisions, strict=True)
        )
        super().__init__(join_meshes(join_meshes(block, floor), wall, comm))
        self.supports = self.make_supports(
            (1, on_plane(1, -1.0)),
            (0, lambda x: np.isclose(x[1], -1) & np.isclose(x[0], 0)),
            (0, on_plane(0, -1.0)),
            (1, lambda x: np.isclose(x[0], -1) & np.isclose(x[1], 0)),
        )

    def find_facets(self, axis, coordinate, of_block):
        """Return the facets at x[axis] = `coordinate` of the block, or of the other bodies."""
        facets = locate_entities_boundary(self.mesh, 1, on_plane(axis, coordinate))
        self.mesh.topology.create_connectivity(1, 2)
        links = self.mesh.topology.connectivity(1, 2).links
        cells = np.array([links(facet)[0] for facet in facets], dtype=np.int32)
        midpoints = compute_midpoints(self.mesh, 2, cells).reshape(-1, 3)
        return facets[(midpoints[:, :2] > 0).all(axis=1) == of_block]

    def block_nodes(self, axis, coordinate):
        facets = self.find_facets(axis, coordinate, of_block=True)
        return fem.locate_dofs_topological(self.space, 1, facets)

    def corner_pairs(self, mu=0.0):
        """Return pairs of the block's lower and left side with the other bodies."""
        return [
            ContactPair(
                self.block_nodes(axis, 0.0),
                DeformableSurface(self.find_facets(axis, 0.0, of_block=False), revolved=False),
                mu,
            )
            for axis in (1, 0)
        ]

    def plate_pairs(self):
        """Return pairs of the block's upper and right side with rigid planes."""
        return [
            ContactPair(self.block_nodes(axis, 1.0), Plane((1, 1), -np.eye(2)[axis]))
            for axis in (1, 0)
        ]


def test_block_in_corner_of_two_blocks_transfers_uniform_pressures():
    bodies = CornerOfThreeBlocks()
    pairs = [*bodies.corner_pairs(), *bodies.plate_pairs()]
    problem = bodies.contact_problem(pairs, bodies.supports)
    plates = [Motion((0, None), force=(0, -3.0)), Motion((None, 0), force=(-2.0, 0))]
    state = problem.step(problem.undeformed, motions=[None, None, *plates])
    exact = [(0, 3.0), (2.0, 0), (0, -3.0), (-2.0, 0)]
    np.testing.assert_allclose(forces_of_pairs(state), exact, atol=1e-9)
    for pair, force in zip(state.pairs[:2], (3.0, 2.0), strict=True):
        at_end = np.isclose(pair.position, 0) | np.isclose(pair.position, 1)
        tributary = np.where(at_end.all(axis=1), 1 / 16, 1 / 8)
        np.testing.assert_allclose(pair.force_normal, force * tributary, atol=1e-9)
        assert pair.opposite_force.sum(axis=0) == pytest.approx(-pair.force, abs=1e-9)


def collect_results_of_pairs(name, state):
    """Return forces, gaps and slips by name; tangential forces of the pairs with friction only."""
    results = {f"{name} displacement": state.displacement.norm()}
    for number, pair in enumerate(state.pairs):
        for attribute in ("force", "force_normal", "gap", "slip"):
            results[f"{name} {number} {attribute}"] = getattr(pair, attribute)
        if number < 2:
            results[f"{name} {number} force_tangential"] = pair.force_tangential
    return results


def solve_rough_corner_of_three_blocks(comm):
    """Press the block and move a body that it touches, at small and at large sliding."""
    bodies, results = CornerOfThreeBlocks(comm), {}
    pairs = [*bodies.corner_pairs(0.3), *bodies.plate_pairs()]
    problem = bodies.contact_problem(pairs, bodies.supports)
    state = problem.undeformed
    for k, (shift, force) in enumerate(((0.0, 2.0), (0.0, 3.0), (0.01, 3.0))):
        plates = [Motion((0, None), force=(0, -3.0)), Motion((None, 0), force=(-force, 0))]
        state = problem.step(state, motions=[Motion((shift, 0.0)), None, *plates])
        results |= collect_results_of_pairs(f"small {k}", state)
    u, residual = make_finite_strain_unknown_and_residual(bodies.body.spaces)
    clamped = [
        prescribe(bodies.space, component, on_plane(axis, -1.0))
        for axis in (0, 1)
        for component in (0, 1)
    ]
    problem = ContactProblem.of_residual(residual, u, clamped, pairs)
    state = problem.undeformed
    for k, (depth, shift) in enumerate(((0.03, 0.0), (0.06, 0.0), (0.06, 0.1))):
        plates = [Motion((0, -depth)), Motion((-depth, 0))]
        state = problem.step(state, motions=[None, Motion((0, shift)), *plates])
        results |= collect_results_of_pairs(f"large {k}", state)
    return results


def solve_corner_of_three_blocks_by_krylov_method(comm, solver=None):
    bodies, results = CornerOfThreeBlocks(comm), {}
    for mu in (0.0, 0.3):
        pairs = [*bodies.corner_pairs(mu), *bodies.plate_pairs()]
        solver = Iterative() if solver is None else solver
        problem = bodies.contact_problem(pairs, bodies.supports, solver=solver)
        state = problem.undeformed
        for k, (shift, force) in enumerate(((0.0, 2.0), (0.0, 3.0), (0.01, 3.0))):
            plates = [Motion((0, None), force=(0, -3.0)), Motion((None, 0), force=(-force, 0))]
            state = problem.step(state, motions=[Motion((shift, 0.0)), None, *plates])
            for number, pair in enumerate(state.pairs):
                for attribute in ("force", "force_vector", "gap", "slip"):
                    results[f"{mu} {k} {number} {attribute}"] = getattr(pair, attribute)
    return results


def test_krylov_method_solves_corner_of_three_blocks_on_several_processes():
    by_factors, by_krylov_method = (
        solve_corner_of_three_blocks_by_krylov_method(MPI.COMM_SELF, solver)
        for solver in (Direct(), Iterative())
    )
    for name, expected in by_factors.items():
        np.testing.assert_allclose(by_krylov_method[name], expected, atol=2e-9, err_msg=name)
    assert_same_on_processes(solve_corner_of_three_blocks_by_krylov_method, rel=1e-9)


def test_rough_corner_of_three_blocks_on_several_processes():
    results = solve_rough_corner_of_three_blocks(MPI.COMM_SELF)
    for name in [f"{kind} {k}" for kind in ("small", "large") for k in range(3)]:
        forces = [results[f"{name} {number} force"] for number in range(4)]
        np.testing.assert_allclose(np.sum(forces, axis=0), 0, atol=1e-9)
        for number in (0, 1):
            normal, tangential = (
                results[f"{name} {number} force_{part}"] for part in ("normal", "tangential")
            )
            assert np.linalg.norm(tangential, axis=1) == pytest.approx(
                np.minimum(np.linalg.norm(tangential, axis=1), 0.3 * normal), abs=1e-9
            )
    assert np.abs(results["small 2 0 slip"]).max() > 1e-3
    assert np.abs(results["large 2 1 slip"]).max() > 0.05
    assert_same_on_processes(solve_rough_corner_of_three_blocks)


def test_supports_along_the_edge_of_a_corner_give_plane_strain():
    block, flat = CornerBlock(3, divisions=2), CornerBlock(2, divisions=2)
    supports = block.make_supports((2, on_plane(2, 0.0)), (2, on_plane(2, 1.0)))
    for mu in (0.0, 0.3):
        problem = block.contact_problem(block.corner_pairs(mu)[:2], supports)
        flat_problem = flat.contact_problem(flat.corner_pairs(mu))
        state, flat_state = problem.undeformed, flat_problem.undeformed
        for force, shift in (((1.0, 2.0), 0.0), ((1.5, 1.0), 0.0), ((1.5, 1.0), 1e-3)):
            load, motions = block.press_into_corner((*force, 0)), [Motion((shift, 0, 0)), None]
            state = problem.step(state, load, motions)
            flat_load, flat_motions = flat.press_into_corner(force), [Motion((shift, 0)), None]
            flat_state = flat_problem.step(flat_state, flat_load, flat_motions)
            difference = forces_of_pairs(state)[:, :2] - forces_of_pairs(flat_state)
            assert np.abs(difference).max() < 1e-9


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_block_between_matching_block_and_wall_has_forces_of_statics(mu):
    blocks = MatchingBlocks(gap=0.1)
    wall = ContactPair(
        lambda x: np.isclose(x[0], 0) & (x[1] > BLOCK_HEIGHT + 0.05), Plane((0, 0), (1, 0)), mu
    )
    problem = blocks.contact_problem(
        [blocks.make_pair(mu), wall], blocks.make_clamping_supports(on_plane(1, 0.0))
    )
    load, shift = blocks.traction_load((-1.0, -3.0)), Motion((0, 0.1))
    state = problem.step(problem.undeformed, load, [shift, None])
    forces = forces_of_pairs(state)
    np.testing.assert_allclose(forces.sum(axis=0), BLOCK_LENGTH * np.array([1, 3]), atol=1e-9)
    if mu == 0:
        np.testing.assert_allclose(forces[1], (BLOCK_LENGTH, 0), atol=1e-9)
    for pair in state.pairs:
        assert_friction_law(pair, lambda force, mu: mu * force, mu)
    corner_force = [pair.force_normal[np.argmin(pair.position.sum(axis=1))] for pair in state.pairs]
    assert min(corner_force) > 0.01


def test_states_with_shared_nodes_are_stored_and_shown(tmp_path):
    block = CornerBlock(2)
    problem = block.contact_problem(block.corner_pairs(0.3))
    pressed = problem.step(problem.undeformed, block.press_into_corner((1.0, 2.0)))
    problem.save(pressed, tmp_path / "pressed.npz")
    same_problem = block.contact_problem(block.corner_pairs(0.3))
    resumed = same_problem.load(tmp_path / "pressed.npz")
    load, motions = block.press_into_corner((1.5, 1.0)), [None, Motion((0.0, 1e-3))]
    states = [
        case.step(s, load, motions) for case, s in ((problem, pressed), (same_problem, resumed))
    ]
    for pair, resumed_pair in zip(*(state.pairs for state in states), strict=True):
        np.testing.assert_allclose(resumed_pair.force_vector, pair.force_vector, atol=1e-12)
    fields = ContactFields.from_state(pressed, block.body)
    (origin,) = np.flatnonzero(np.isclose(block.x, 0).all(axis=1))
    force = fields.force.x.array.reshape(-1, 2)[origin]
    exact = sum(values_at_origin(pair)[0] for pair in pressed.pairs)
    np.testing.assert_allclose(force, exact, atol=1e-14)
    total = fields.force.x.array.reshape(-1, 2).sum(axis=0)
    np.testing.assert_allclose(total, (1.0, 2.0), atol=1e-10)
    largest = max(pressed.pairs, key=lambda pair: values_at_origin(pair)[0].max())
    assert fields.pressure.x.array[origin] == pytest.approx(12 * values_at_origin(largest)[0].max())
    assert fields.gap.x.array[origin] == pytest.approx(0, abs=1e-15)
    with pytest.raises(ValueError, match="nodes belong to several contact pairs"):
        fields.error_indicator()
    write(tmp_path / "corner.bp", [pressed], block.body)
    plot(pressed, block.body)


def test_what_does_not_support_shared_nodes_is_refused():
    block = CornerBlock(2)
    pairs = block.corner_pairs()
    standard = CornerBlock(2, method=Spaces.galerkin)
    sibling = Sibling.from_space(standard.space)
    with pytest.raises(ValueError, match="the symmetric sibling element does not support"):
        ContactProblem(sibling.matrix(standard.K), sibling.dirichlet([]), pairs, standard.space)
    at_rest, mass = standard.zero_load, lumped_mass(standard.M, standard.space)
    with pytest.raises(ValueError, match="which impact does not support"):
        solve_impact(
            *(standard.K, mass, standard.make_supports(), pairs, standard.space, 1e-3, at_rest)
        )
    problem = block.contact_problem(pairs)
    state = problem.step(problem.undeformed, block.press_into_corner((1.0, 2.0)))
    with pytest.raises(ValueError, match="belong to several pairs: its derivatives"):
        problem.sensitivity(
            [problem.undeformed, state], [("force", 0, 0)], [("motion", 0, np.ones((2, 2)))]
        )

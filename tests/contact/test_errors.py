"""Errors raised for invalid contact problems, and for problems with several solutions or none."""

from dataclasses import replace
from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from pw_elements import Reduction, prescribe
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactPair,
    ContactProblem,
    FreeBody,
    Motion,
    NoEquilibrium,
    NotUnique,
    Parabola,
    Plane,
    SignedDistance,
    SolutionNotFound,
    Sphere,
)
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import move_nodes, triangles
from tests.contact.cases import BlockOnFloor, ElasticBody, GrecoFrictionBenchmark, on_plane

BLOCK, FLOOR, ON_BASE = BlockOnFloor(4), Plane((0, 0), (0, 1)), on_plane(1, 0.0)


def solve_block(pair=None, load=BLOCK.pressure_load, reduction=BLOCK.no_supports, **options):
    """Return the states of the block under a load; by default the block lies on the rough floor."""
    return BLOCK.solve_contact(
        floor_pair_with() if pair is None else pair, reduction, load, **options
    )


def floor_pair_with(mu=0.3, motions=(), nodes=ON_BASE):
    return ContactPair(nodes, FLOOR, mu, motions)


def base_pair_with_surface(surface, *pair_options):
    return ContactPair(on_plane(1, 0.0), surface, *pair_options)


def floor_pair_with_middle_friction(middle_mu):
    """Return the floor pair with a different friction coefficient at the node in the middle."""
    return floor_pair_with(lambda x: np.where(np.isclose(x[0], 2.0), middle_mu, 0.3))


def left_side_supports(axis):
    return BLOCK.make_supports((axis, lambda x: np.isclose(x[0], 0)))


def displacement_doubling_reduction():
    """Return a reduction that doubles all displacements, which contact problems do not allow."""
    twice = 2.0 * BLOCK.no_supports.right
    return Reduction(twice, twice, BLOCK.no_supports.offset)


OVERTURNING_LOAD = BLOCK.pressure_load + BLOCK.traction_load(
    (1800.0, 0.0), lambda x: on_plane(0, 4.0)(x) & (x[1] > 0.9)
)


class SurfaceWithGapFunction:
    """A rigid surface with a given gap function and a constant normal."""

    def __init__(self, gap, normal=(0.0, 1.0)):
        self.gap, self._normal = gap, normal

    def normal(self, x):
        return np.tile(np.asarray(self._normal), (len(x), 1))


def gap_to_circle_or_nan(x):
    """Return the gap to a circle of radius 6 below the block, or NaN far from the circle."""
    return x[:, 1] - np.sqrt(36 - (x[:, 0] - 2.0) ** 2) + 6.0


def flat_pair_with_normal(normal):
    """Return the contact pair of a flat surface that returns the given normal at all points."""
    return base_pair_with_surface(SurfaceWithGapFunction(lambda x: x[:, 1], normal))


N_BLOCK_NODES = len(BLOCK.x)
ARC_PAIR_WITH_NAN_GAP_AFTER_MOTION = base_pair_with_surface(
    SurfaceWithGapFunction(gap_to_circle_or_nan), 0.3, [Motion((0, 0)), Motion((-5, 0))]
)
WALL_PAIR = ContactPair(on_plane(0, 0.0), Plane((0, 0), (1, 0)))
REVERSED_SURFACE_PAIR = ContactPair(on_plane(1, 2.0), SignedDistance(lambda x: x[:, 1] - 2.0))
# invalid pairs, each with a part of the error message
INVALID_PAIRS_AND_MESSAGES = [
    *(
        (floor_pair_with_middle_friction(mu), r"nodes at \(2, 0\) have a friction")
        for mu in (-0.1, np.nan, np.inf)
    ),
    (
        base_pair_with_surface(Plane((0, 0.1), (0, 1)), 0.3),
        r"\(0, 0\)(, .*){5} and 3 more lie inside the rigid .* by 0\.1,",
    ),
    ([floor_pair_with(), floor_pair_with()], "belong to two contact pairs"),
    (
        base_pair_with_surface(SurfaceWithGapFunction(lambda x: np.sqrt(x[:, 0] - 0.1))),
        r"\(0, 0\).* whose gap is not a number",
    ),
    *(
        (flat_pair_with_normal(n), "normal is no unit vector")
        for n in ((0.0, 2.0), (0.0, 0.0), (np.nan, 1.0))
    ),
    (
        base_pair_with_surface(Parabola((0.0,), -1.0)),
        "the apex of its surface has 1 components in 2-D",
    ),
    (
        floor_pair_with(nodes=np.array([N_BLOCK_NODES])),
        rf"nodes of contact pair 0 .* {N_BLOCK_NODES} in all",
    ),
    (
        floor_pair_with(nodes=np.full(N_BLOCK_NODES - 1, True)),
        rf"nodes of contact pair 0 .* {N_BLOCK_NODES} in all",
    ),
    (floor_pair_with(nodes=lambda x: x[1] < 0.6), "lie inside of the body, not on its boundary"),
    (REVERSED_SURFACE_PAIR, "reverse it"),
    (
        base_pair_with_surface(SignedDistance(lambda x: x[1])),
        r"of the shape \(2,\) .* takes points as rows",
    ),
    (
        base_pair_with_surface(SurfaceWithGapFunction(lambda x: x[:1, 1])),
        r"the gap of .* pair 0 gave .* shape \(1,\)",
    ),
    (
        floor_pair_with(lambda x: np.full(len(x), 0.3)),
        r"the friction of .* pair 0 .* points as columns",
    ),
]
INVALID_CALLS_AND_MESSAGES = [
    (
        lambda: solve_block(reduction=left_side_supports(1)),
        r"at \(0, 0\) have a pre.*away from the support",
    ),
    (
        lambda: solve_block(WALL_PAIR, reduction=left_side_supports(0)),
        "prescribed normal displacement",
    ),
    (
        lambda: solve_block(reduction=displacement_doubling_reduction()),
        "combines the displacements",
    ),
    (
        lambda: solve_block(ARC_PAIR_WITH_NAN_GAP_AFTER_MOTION, [BLOCK.pressure_load] * 2),
        "gap is not a number",
    ),
    (lambda: solve_block(remedies=("prayer",)), "give some of 'springs', 'cutback'"),
]


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        *(
            (lambda pair=pair: solve_block(pair), message)
            for pair, message in INVALID_PAIRS_AND_MESSAGES
        ),
        *INVALID_CALLS_AND_MESSAGES,
    ],
)
def test_invalid_problems_are_refused_with_their_cause(attempt, message):
    with pytest.raises(ValueError, match=message):
        attempt()


@pytest.mark.parametrize(
    ("attempt", "kind", "message"),
    [
        (
            lambda: solve_block(floor_pair_with(10.0), OVERTURNING_LOAD),
            NoEquilibrium,
            r"rotation about \(4, 0\) of the body, by which the body lifts off pair 0",
        ),
        (
            lambda: GrecoFrictionBenchmark(16).solve(10.0, remedies=()),
            SolutionNotFound,
            "runs through the same",
        ),
        (
            lambda: GrecoFrictionBenchmark(16).solve(1, max_iterations=3, remedies=()),
            SolutionNotFound,
            "after 3 iterations",
        ),
    ],
)
def test_problems_without_solution_are_refused_with_their_cause(attempt, kind, message):
    with pytest.raises(kind, match=message):
        attempt()


def test_valid_problems_that_resemble_invalid_ones_are_solved():
    (state,) = solve_block(reduction=left_side_supports(0))
    assert state.residuals.largest() < 1e-12
    (state,) = solve_block(floor_pair_with(motions=[Motion((0, 0.1))]))
    assert state.pairs[0].force[1] == pytest.approx(800)
    node_support = BLOCK.make_supports((0, lambda x: np.isclose(x[0], 2) & np.isclose(x[1], 0)))
    solve_block(
        base_pair_with_surface(Sphere((2, -3), 3.0)), reduction=node_support
    )  # the normals of a circle prevent the rotation
    (state,) = solve_block()
    base_mask = np.isclose(BLOCK.x[:, 1], 0.0)
    for nodes in (base_mask, np.flatnonzero(base_mask)):
        (repeated,) = solve_block(floor_pair_with(nodes=nodes))
        assert repeated.pairs[0].force_normal == pytest.approx(state.pairs[0].force_normal)


def test_the_penetration_that_is_refused_grows_with_the_body():
    """The initial penetration that is allowed is a millionth of the body's diagonal.

    Slightly smaller penetrations are accepted, and slightly larger ones are refused. This tolerance
    is needed for round-off and for curved sides that the mesh approximates by facets.
    """
    body = ElasticBody(triangles(MPI.COMM_SELF, (0.0, 0.0), (600.0, 800.0), (3, 4)))
    supports = body.make_clamping_supports(on_plane(1, 800.0))
    for depth, is_refused in ((0.9e-3, False), (1.1e-3, True)):
        pair = ContactPair(on_plane(1, 0.0), Plane((0, depth), (0, 1)), 0.2)
        if is_refused:
            with pytest.raises(ValueError, match="inside the rigid surface before any motion"):
                body.solve_contact(pair, supports)
        else:
            assert body.solve_contact(pair, supports)[0].pairs[0].force[1] > 0


RING = ElasticBody(triangles(MPI.COMM_SELF, (1.0, 0.0), (2.0, 1.0), (2, 2)), state="axisymmetric")
SHAFT_PAIR = ContactPair(on_plane(0, 1.0), Plane((1.0, 0.0), (1.0, 0.0)), 0.3)
FREE_SHAFT_MOTIONS = [Motion((None, 0.1)), Motion((None, 0.1), force=(5.0, 0.0))]


def make_ring_problem_with_residual(write_quotient, **pair_options):
    """Return the problem of the ring on its shaft, defined by a residual.

    `write_quotient` is a function that writes the hoop strain as a quotient of a radial component
    and the radius.
    """
    space = RING.space
    u, v = fem.Function(space), ufl.TestFunction(RING.body.spaces.test)
    r = ufl.SpatialCoordinate(space.mesh)[0]
    work = ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v))
    work += write_quotient(u[0], r) * write_quotient(v[0], r)
    supports = [prescribe(space, 1, on_plane(1, 0.0))]
    pair = replace(SHAFT_PAIR, **pair_options)
    return ContactProblem.of_residual(work * r * ufl.dx, u, supports, pair)


@pytest.mark.parametrize("motion", FREE_SHAFT_MOTIONS)
@pytest.mark.parametrize("surface", [SHAFT_PAIR.surface, Sphere((0.0, 0.0), 1.0)])
def test_free_radial_motions_are_refused_in_axisymmetry(surface, motion):
    """A free radial motion is refused, with the pair and the remedy, and others are not.

    Without a force it would let a shaft vanish. A prescribed one changes the radius of the shaft.
    """
    supports, message = RING.make_supports((1, on_plane(1, 0.0))), "pair 0 is free in the radial"
    pair = replace(SHAFT_PAIR, surface=surface)
    with pytest.raises(ValueError, match=message):
        RING.solve_contact(replace(pair, motions=[motion]), supports)
    problem = RING.contact_problem(pair, supports)
    with pytest.raises(ValueError, match=f"{message}.*give 0"):
        problem.step(problem.undeformed, motions=motion)


def test_a_shaft_that_is_free_along_the_axis_may_grow_in_its_ring():
    problem = RING.contact_problem(SHAFT_PAIR, RING.make_supports((1, on_plane(1, 0.0))))
    state = problem.step(problem.undeformed, motions=Motion((1e-3, None)))
    assert (state.pairs[0].force_normal > 0).all()
    assert state.pairs[0].force[1] == pytest.approx(0.0, abs=1e-9 * state.pairs[0].force[0])


def make_ring_problem_with_body_forms(**pair_options):
    """Return the problem of the ring on its shaft, defined by the forms of its body."""
    u = fem.Function(RING.space)
    residual = ufl.action(RING.body.stiffness(), u)
    supports = [prescribe(RING.space, 1, on_plane(1, 0.0))]
    return ContactProblem.of_residual(residual, u, supports, replace(SHAFT_PAIR, **pair_options))


@pytest.mark.parametrize(
    "make_problem",
    [
        partial(make_ring_problem_with_residual, lambda component, r: component / r),
        make_ring_problem_with_body_forms,
    ],
)
def test_free_radial_motions_and_rotations_are_refused_with_an_axisymmetric_residual(make_problem):
    problem = make_problem()
    for motion in FREE_SHAFT_MOTIONS:
        with pytest.raises(ValueError, match="pair 0 is free in the radial direction"):
            problem.step(problem.undeformed, motions=motion)
    with pytest.raises(ValueError, match="rotation without a pivot: in axisymmetry no surface"):
        problem.step(problem.undeformed, motions=Motion((0.0, 0.0), rotation=None, torque=1.0))
    with pytest.raises(ValueError, match="pair 0 has a pivot, but in axisymmetry no surface"):
        make_problem(pivot=(0.0, 0.0))


def test_a_plane_residual_that_depends_on_position_allows_free_motions():
    """Quotients of the radius and stiffnesses that vary with x are not taken for hoop strains."""
    problem = make_ring_problem_with_residual(
        lambda component, r: component * r / (1 + r), pivot=(0.0, 0.0)
    )
    pressed = problem.step(problem.undeformed, motions=Motion((0.1, 0.0)))
    force = 1.1 * pressed.pairs[0].force[0]
    state = problem.step(pressed, motions=Motion((None, 0.0), (force, 0.0)))
    assert state.pairs[0].translation[0] > 0.105


def test_an_error_names_its_increment():
    with pytest.raises(FreeBody, match=r"^increment 2: ") as caught:
        solve_block(load=[BLOCK.pressure_load, BLOCK.pressure_load, -1.0 * BLOCK.pressure_load])
    assert len(caught.value.states) == 2
    assert caught.value.states[1].pairs[0].force[1] == pytest.approx(800)


def test_large_friction_without_a_unique_solution_is_reported():
    """Large friction that leaves several solutions or none is reported.

    All nodes are fixed except one contact node, which a force pulls along the floor.
    """

    def corner(x):
        return np.isclose(x[0], 1.0) & np.isclose(x[1], 0.0)

    body = ElasticBody(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1)), E=10.0)
    supports = body.make_clamping_supports(lambda x: ~corner(x))
    (tt, _), (nt, _) = supports.matrix(body.K)[:, :]
    tangential_sign, critical = np.sign(nt), abs(tt / nt)

    def solve_pulled(mu, pull, starts_slipping=False, **options):
        """Return the state after a pull; the contact node sticks or slips in the start state."""
        load = nodal_load(body.space, corner, (-tangential_sign * pull, -1.0))
        problem = body.contact_problem(ContactPair(corner, FLOOR, mu), supports, **options)
        start = problem.undeformed
        if starts_slipping:
            (pair,) = start.pairs
            slip_fields = {
                "direction": np.array([[tangential_sign, 0.0]]),
                "friction_ratio": np.ones(1),
            }
            pair = replace(pair, status=np.array([SLIP], dtype=np.int8), **slip_fields)
            start = replace(start, pairs=(pair,), increment=1)
        return problem.step(start, load)

    below_limit = solve_pulled(0.5 * critical, 0.6 * critical)
    assert below_limit.unique
    assert below_limit.pairs[0].status.tolist() == [SLIP]

    # the equations of slip have no solution here, and infinitely many at the limit of sticking
    with pytest.raises(SolutionNotFound, match="the equations have no solution"):
        solve_pulled(critical, 2 * critical, remedies=())
    lifted = solve_pulled(critical, 2 * critical)
    assert lifted.pairs[0].status.tolist() == [OPEN]
    assert lifted.pairs[0].gap > 0.1
    # the equations are singular up to round-off, which would reverse the slip at the limit itself
    near_critical = critical * (1 - 1e-13)
    with pytest.raises(NotUnique, match="too large for a unique answer") as caught:
        solve_pulled(near_critical, near_critical, starts_slipping=True)
    assert caught.value.state.residuals.largest() < 1e-5
    assert np.abs(caught.value.state.pairs[0].slip).max() > 1e-3

    # the node may stick, or it may slip and thereby reduce its pressure
    stick = solve_pulled(3 * critical, 1.5 * critical)
    assert stick.pairs[0].status.tolist() == [STICK]
    slip = solve_pulled(3 * critical, 1.5 * critical, starts_slipping=True)
    assert slip.pairs[0].status.tolist() == [SLIP]
    assert slip.pairs[0].force_normal < 0.9 * stick.pairs[0].force_normal
    assert max(state.residuals.largest() for state in (stick, slip)) < 1e-12

    assert GrecoFrictionBenchmark(16).solve(1.0).unique
    assert not GrecoFrictionBenchmark(16).solve(50.0).unique


def test_nodes_without_a_facet_are_logged_before_anything_is_solved(caplog):
    """A contact node that belongs to no complete facet is logged before anything is solved.

    The first set of contact nodes ends in the middle of a facet. The second set ends at a vertex,
    and no message is logged.
    """
    BLOCK.contact_problem(floor_pair_with(nodes=lambda x: np.isclose(x[1], 0) & (x[0] < 1.6)))
    (record,) = caplog.records
    assert "contact pair 0: its nodes at (1.5, 0) belong to no facet" in record.getMessage()
    assert "write and plot will refuse the states" in record.getMessage()
    BLOCK.contact_problem(floor_pair_with(nodes=lambda x: np.isclose(x[1], 0) & (x[0] < 1.1)))
    assert len(caplog.records) == 1


class BlockInGroove:
    """A block with slanted sides in a groove of two planes that fits it, held by contact alone."""

    def __init__(self, mu=0.1):
        mesh = triangles(MPI.COMM_SELF, (-1.0, 0.0), (1.0, 1.0), (4, 2))
        move_nodes(mesh, lambda x: np.column_stack([x[:, 0] * (1 + x[:, 1]) / 2, x[:, 1]]))
        self.body = ElasticBody(mesh, E=1e4)
        side_markers = [
            lambda x, sign=sign: np.isclose(x[0], sign * (1 + x[1]) / 2) for sign in (-1, 1)
        ]
        planes = [Plane((sign / 2, 0.0), (-sign * 2.0, 1.0)) for sign in (-1, 1)]
        pairs = [
            ContactPair(side, plane, mu) for side, plane in zip(side_markers, planes, strict=True)
        ]
        self.problem = self.body.contact_problem(pairs, self.body.make_supports())
        self.top_load = self.body.traction_load((0.0, -1.0), on_plane(1, 1.0))
        self.pressed = self.problem.step(self.problem.undeformed, self.top_load)


GROOVE_MOTIONS_BY_CASE = {
    "unloaded": [None, None],
    "the groove sinks": [Motion((0.0, -0.1))] * 2,
    "the groove opens": [Motion((-0.1, 0.0)), Motion((0.1, 0.0))],
    "one side goes": [Motion((-0.1, 0.0)), None],
    "pressed out": [Motion((0.01, 0.0)), Motion((-0.01, 0.0))],
}


@pytest.mark.parametrize("case", GROOVE_MOTIONS_BY_CASE)
def test_a_body_that_loses_all_contact_forces_has_no_unique_position(case):
    """A body that loses all contact forces is refused, because its position is not unique.

    The computed state has no contact forces and no penetration. A rigid motion that closes no gap
    leads to another such state.
    """
    groove = BlockInGroove()
    assert groove.pressed.pairs[0].force[1] == pytest.approx(1.0)
    with pytest.raises(NotUnique, match=r"the body is loose.*Nothing stops") as caught:
        groove.problem.step(groove.pressed, 0.0 * groove.top_load, GROOVE_MOTIONS_BY_CASE[case])
    state = caught.value.state
    assert not state.converged
    assert max(np.abs(pair.force_vector).max() for pair in state.pairs) < 1e-9
    assert min(pair.gap.min() for pair in state.pairs) > -1e-9
    # the body is held if it is loaded again
    reloaded = groove.problem.step(groove.pressed, 0.5 * groove.top_load, [Motion((0.0, -0.1))] * 2)
    assert sum(pair.force[1] for pair in reloaded.pairs) == pytest.approx(1.0)


def test_planes_that_touch_without_force_may_fix_a_body():
    """An unloaded square in a frame that fits it is accepted, because it cannot move.

    If one of the four sides of the frame is missing, the square can move and is refused.
    """
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    body = ElasticBody(mesh, E=1e4)
    sides = {(0, 0.0): (1, 0), (0, 1.0): (-1, 0), (1, 0.0): (0, 1), (1, 1.0): (0, -1)}

    def solve_between_planes(*side_keys):
        where = {name: on_plane(*name) for name in side_keys}
        corners = lambda x: np.isclose(np.abs(x[0] - 0.5) + np.abs(x[1] - 0.5), 1.0)  # noqa: E731
        pairs = [
            ContactPair(
                lambda x, name=name: where[name](x) & ~corners(x),
                Plane(np.eye(2)[name[0]] * name[1], sides[name]),
            )
            for name in side_keys
        ]
        problem = body.contact_problem(pairs, body.make_supports())
        return problem.step(
            problem.undeformed, 0.0 * body.traction_load((0.0, 1.0), on_plane(1, 1.0))
        )

    assert solve_between_planes(*sides).residuals.largest() < 1e-9  # the body is fixed on all sides
    for missing in ((0, 1.0), (1, 0.0)):
        with pytest.raises((NotUnique, FreeBody)):
            solve_between_planes(*(name for name in sides if name != missing))

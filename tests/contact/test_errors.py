"""What is no contact problem, and what has no solution or several."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import Reduction
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactPair,
    FreeBody,
    Motion,
    NoEquilibrium,
    NotFound,
    NotUnique,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
)
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import move_nodes, triangles
from tests.contact.cases import Block, Elastic, Greco, at

BLOCK, FLOOR, BELOW = Block(4), Plane((0, 0), (0, 1)), at(1, 0.0)


def solved(pair=None, load=BLOCK.pressure, reduction=BLOCK.free, **options):
    return BLOCK.contact(floor() if pair is None else pair, reduction, load, **options)


def floor(mu=0.3, motions=(), nodes=BELOW):
    return ContactPair(nodes, FLOOR, mu, motions)


def under(surface, *options):
    return ContactPair(at(1, 0.0), surface, *options)


def strange(mu):
    return floor(lambda x: np.where(np.isclose(x[0], 2.0), mu, 0.3))


def corner_held(axis):
    return BLOCK.held((axis, lambda x: np.isclose(x[0], 0)))


def doubled():
    twice = 2.0 * BLOCK.free.right
    return Reduction(twice, twice, BLOCK.free.offset)


OVERTURNING = BLOCK.pressure + BLOCK.load((1800.0, 0.0), lambda x: at(0, 4.0)(x) & (x[1] > 0.9))


class Gap:
    def __init__(self, gap, normal=(0.0, 1.0)):
        self.gap, self._normal = gap, normal

    def normal(self, x):
        return np.tile(np.asarray(self._normal), (len(x), 1))


def arc(x):
    return x[:, 1] - np.sqrt(36 - (x[:, 0] - 2.0) ** 2) + 6.0


def tilted(normal):
    return under(Gap(lambda x: x[:, 1], normal))


COUNT = len(BLOCK.x)
PASSING = under(Gap(arc), 0.3, [Motion((0, 0)), Motion((-5, 0))])
WALL = ContactPair(at(0, 0.0), Plane((0, 0), (1, 0)))
ABOVE = ContactPair(at(1, 2.0), SignedDistance(lambda x: x[:, 1] - 2.0))
# pairs that state no problem, and what is said
PAIRS = [
    *((strange(mu), r"nodes at \(2, 0\) have a friction") for mu in (-0.1, np.nan, np.inf)),
    (
        under(Plane((0, 0.1), (0, 1)), 0.3),
        r"\(0, 0\)(, .*){5} and 3 more lie inside the rigid .* by 0\.1,",
    ),
    ([floor(), floor()], "belong to two contact pairs"),
    (under(Gap(lambda x: np.sqrt(x[:, 0] - 0.1))), r"\(0, 0\).* whose gap is not a number"),
    *((tilted(n), "normal is no unit vector") for n in ((0.0, 2.0), (0.0, 0.0), (np.nan, 1.0))),
    (under(Parabola((0.0,), -1.0)), "the apex of its surface has 1 components in 2-D"),
    (floor(nodes=np.array([COUNT])), rf"nodes of contact pair 0 .* {COUNT} in all"),
    (floor(nodes=np.full(COUNT - 1, True)), rf"nodes of contact pair 0 .* {COUNT} in all"),
    (floor(nodes=lambda x: x[1] < 0.6), "lie inside of the body, not on its boundary"),
    (ABOVE, "reverse it"),
    (under(SignedDistance(lambda x: x[1])), r"of the shape \(2,\) .* takes points as rows"),
    (under(Gap(lambda x: x[:1, 1])), r"the gap of .* pair 0 gave .* shape \(1,\)"),
    (floor(lambda x: np.full(len(x), 0.3)), r"the friction of .* pair 0 .* points as columns"),
]
CALLS = [
    (lambda: solved(reduction=corner_held(1)), r"at \(0, 0\) have a pre.*away from the support"),
    (lambda: solved(WALL, reduction=corner_held(0)), "prescribed normal displacement"),
    (lambda: solved(reduction=doubled()), "combines the displacements"),
    (lambda: solved(PASSING, [BLOCK.pressure] * 2), "gap is not a number"),
    (lambda: solved(remedies=("prayer",)), "give some of 'springs', 'cutback'"),
]


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize(
    ("attempt", "message"), [*((lambda of=of: solved(of), said) for of, said in PAIRS), *CALLS]
)
def test_what_states_no_problem_is_named(attempt, message):
    with pytest.raises(ValueError, match=message):
        attempt()


@pytest.mark.parametrize(
    ("attempt", "kind", "message"),
    [
        (
            lambda: solved(floor(10.0), OVERTURNING),
            NoEquilibrium,
            r"rotation about \(4, 0\) of the body, by which the body lifts off pair 0",
        ),
        (lambda: Greco(16).solve(10.0, remedies=()), NotFound, "runs through the same"),
        (lambda: Greco(16).solve(1, max_iterations=3, remedies=()), NotFound, "after 3 iterations"),
    ],
)
def test_what_has_no_solution_is_named(attempt, kind, message):
    with pytest.raises(kind, match=message):
        attempt()


def test_what_looks_similar_is_solved():
    (state,) = solved(reduction=corner_held(0))
    assert state.residuals.largest() < 1e-12
    (state,) = solved(floor(motions=[Motion((0, 0.1))]))
    assert state.pairs[0].force[1] == pytest.approx(800)
    middle = BLOCK.held((0, lambda x: np.isclose(x[0], 2) & np.isclose(x[1], 0)))
    solved(under(Sphere((2, -3), 3.0)), reduction=middle)  # a circle's normals hold the rotation
    (state,) = solved()
    marked = np.isclose(BLOCK.x[:, 1], 0.0)
    for nodes in (marked, np.flatnonzero(marked)):
        (again,) = solved(floor(nodes=nodes))
        assert again.pairs[0].force_normal == pytest.approx(state.pairs[0].force_normal)


def test_what_counts_as_inside_a_surface_grows_with_the_body():
    """A millionth of its diagonal is round-off, or the faceting of curved sides."""
    body = Elastic(triangles(MPI.COMM_SELF, (0.0, 0.0), (600.0, 800.0), (3, 4)))
    top = body.clamped(at(1, 800.0))
    for depth, inside in ((0.9e-3, False), (1.1e-3, True)):
        pair = ContactPair(at(1, 0.0), Plane((0, depth), (0, 1)), 0.2)
        if inside:
            with pytest.raises(ValueError, match="inside the rigid surface before any motion"):
                body.contact(pair, top)
        else:
            assert body.contact(pair, top)[0].pairs[0].force[1] > 0


def test_error_names_its_increment():
    with pytest.raises(FreeBody, match=r"^increment 2: ") as caught:
        solved(load=[BLOCK.pressure, BLOCK.pressure, -1.0 * BLOCK.pressure])
    assert len(caught.value.states) == 2
    assert caught.value.states[1].pairs[0].force[1] == pytest.approx(800)


def test_large_friction_has_several_answers_and_says_so():
    """A body all fixed but for one contact node, which a force pulls along the floor."""

    def corner(x):
        return np.isclose(x[0], 1.0) & np.isclose(x[1], 0.0)

    body = Elastic(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1)), E=10.0)
    rest = body.clamped(lambda x: ~corner(x))
    (tt, _), (nt, _) = rest.matrix(body.K)[:, :]
    side, critical = np.sign(nt), abs(tt / nt)

    def pulled(mu, pull, slips=False, **options):
        """The state of a node that sticks or slips at first."""
        load = nodal_load(body.space, corner, (-side * pull, -1.0))
        problem = body.problem(ContactPair(corner, FLOOR, mu), rest, **options)
        before = problem.undeformed
        if slips:
            (pair,) = before.pairs
            way = {"direction": np.array([[side, 0.0]]), "turning": np.ones(1)}
            pair = replace(pair, status=np.array([SLIP], dtype=np.int8), **way)
            before = replace(before, pairs=(pair,), increment=1)
        return problem.step(before, load)

    below = pulled(0.5 * critical, 0.6 * critical)
    assert below.unique
    assert below.pairs[0].status.tolist() == [SLIP]

    # the equations of slip have no solution, or at the limit of stick one for any slip
    with pytest.raises(NotFound, match="the equations have no solution"):
        pulled(critical, 2 * critical, remedies=())
    lifted = pulled(critical, 2 * critical)
    assert lifted.pairs[0].status.tolist() == [OPEN]
    assert lifted.pairs[0].gap > 0.1
    # singular but for round-off, which would turn the slip around at the limit itself
    almost = critical * (1 - 1e-13)
    with pytest.raises(NotUnique, match="too large for a unique answer") as caught:
        pulled(almost, almost, slips=True)
    assert caught.value.state.residuals.largest() < 1e-5
    assert np.abs(caught.value.state.pairs[0].slip).max() > 1e-3

    # the node may stick, or slip and thereby relieve itself
    stick = pulled(3 * critical, 1.5 * critical)
    assert stick.pairs[0].status.tolist() == [STICK]
    slip = pulled(3 * critical, 1.5 * critical, slips=True)
    assert slip.pairs[0].status.tolist() == [SLIP]
    assert slip.pairs[0].force_normal < 0.9 * stick.pairs[0].force_normal
    assert max(state.residuals.largest() for state in (stick, slip)) < 1e-12

    assert Greco(16).solve(1.0).unique
    assert not Greco(16).solve(50.0).unique


def test_nodes_without_a_facet_are_told_before_anything_is_solved(caplog):
    """The last of them is in the middle of a facet."""
    BLOCK.problem(floor(nodes=lambda x: np.isclose(x[1], 0) & (x[0] < 1.6)))
    (record,) = caplog.records
    assert "contact pair 0: its nodes at (1.5, 0) belong to no facet" in record.getMessage()
    assert "write and plot will refuse the states" in record.getMessage()
    BLOCK.problem(floor(nodes=lambda x: np.isclose(x[1], 0) & (x[0] < 1.1)))
    assert len(caplog.records) == 1


class Groove:
    """A block with slanted sides in a groove of two planes that fits it, held by nothing else."""

    def __init__(self, mu=0.1):
        mesh = triangles(MPI.COMM_SELF, (-1.0, 0.0), (1.0, 1.0), (4, 2))
        move_nodes(mesh, lambda x: np.column_stack([x[:, 0] * (1 + x[:, 1]) / 2, x[:, 1]]))
        self.body = Elastic(mesh, E=1e4)
        sides = [lambda x, s=s: np.isclose(x[0], s * (1 + x[1]) / 2) for s in (-1, 1)]
        planes = [Plane((s / 2, 0.0), (-s * 2.0, 1.0)) for s in (-1, 1)]
        pairs = [ContactPair(side, plane, mu) for side, plane in zip(sides, planes, strict=True)]
        self.problem = self.body.problem(pairs, self.body.held())
        self.weight = self.body.load((0.0, -1.0), at(1, 1.0))
        self.sunk = self.problem.step(self.problem.undeformed, self.weight)


MOVED = {
    "unloaded": [None, None],
    "the groove sinks": [Motion((0.0, -0.1))] * 2,
    "the groove opens": [Motion((-0.1, 0.0)), Motion((0.1, 0.0))],
    "one side goes": [Motion((-0.1, 0.0)), None],
    "pressed out": [Motion((0.01, 0.0)), Motion((-0.01, 0.0))],
}


@pytest.mark.parametrize("moved", MOVED)
def test_a_body_that_ends_clear_of_all_forces_has_no_unique_position(moved):
    """There is another state: the one that is reached, moved to where it closes no gap."""
    groove = Groove()
    assert groove.sunk.pairs[0].force[1] == pytest.approx(1.0)
    with pytest.raises(NotUnique, match=r"the body is loose.*Nothing stops") as caught:
        groove.problem.step(groove.sunk, 0.0 * groove.weight, MOVED[moved])
    state = caught.value.state
    assert not state.converged
    assert max(np.abs(pair.force_vector).max() for pair in state.pairs) < 1e-9
    assert min(pair.gap.min() for pair in state.pairs) > -1e-9
    # loaded again it is held
    again = groove.problem.step(groove.sunk, 0.5 * groove.weight, [Motion((0.0, -0.1))] * 2)
    assert sum(pair.force[1] for pair in again.pairs) == pytest.approx(1.0)


def test_what_touches_without_a_force_may_stop_a_body_all_the_same():
    """A square in a frame that fits it, without load: only where it closes no gap may it go."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    body = Elastic(mesh, E=1e4)
    sides = {(0, 0.0): (1, 0), (0, 1.0): (-1, 0), (1, 0.0): (0, 1), (1, 1.0): (0, -1)}

    def step(*names):
        where = {name: at(*name) for name in names}
        corners = lambda x: np.isclose(np.abs(x[0] - 0.5) + np.abs(x[1] - 0.5), 1.0)  # noqa: E731
        pairs = [
            ContactPair(
                lambda x, name=name: where[name](x) & ~corners(x),
                Plane(np.eye(2)[name[0]] * name[1], sides[name]),
            )
            for name in names
        ]
        problem = body.problem(pairs, body.held())
        return problem.step(problem.undeformed, 0.0 * body.load((0.0, 1.0), at(1, 1.0)))

    assert step(*sides).residuals.largest() < 1e-9  # stopped all around
    for missing in ((0, 1.0), (1, 0.0)):
        with pytest.raises((NotUnique, FreeBody)):
            step(*(name for name in sides if name != missing))

"""The policies of the active-set iteration, each alone, and how few iterations they take."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements.contact import OPEN, SLIP, STICK, NotFound
from pw_elements.contact.iteration import ActiveSet, Contact
from pw_elements.contact.iteration.policy import Cycles, EdgeRelease, LastHold
from pw_elements.contact.model import Cone, Coulomb
from tests.contact.two_bodies import Stack

SELF = MPI.COMM_SELF
N = 4


def active(*status, direction=0.0):
    n = len(status)
    slipping = np.array(status) == SLIP
    return ActiveSet(
        np.array(status, dtype=np.int8),
        np.where(slipping, direction, 0.0)[:, None] * np.ones((n, 1)),
        *np.zeros((3, n)),
    )


def contact(force, gap=None, slip=None, friction=0.3):
    """Points in the plane, their normal upwards; forces (n, 2) are normal and tangential."""
    force = np.asarray(force, dtype=float)
    n = len(force)
    frame = np.tile(np.array([[0.0, 1.0], [1.0, 0.0]]), (n, 1, 1))
    gap = np.zeros(n) if gap is None else np.asarray(gap, dtype=float)
    slip = np.zeros(n) if slip is None else np.asarray(slip, dtype=float)
    return Contact(
        frame, gap, slip[:, None], force, Cone([Coulomb(0.0)], [np.full(n, friction)]), np.ones(n)
    )


PULLED = contact([[-1.0, 0.0], [-2.0, 0.0], [-3.0, 0.0], [-4.0, 0.0]])


def hold(is_free):
    """The last hold of points of one pair, with a rule for what leaves the body free."""

    def free_motions(candidate, frame):
        assert frame.shape == (len(candidate.status), 2, 2)
        return ["translation y"] if is_free(candidate) else []

    return LastHold(free_motions, np.zeros(N, dtype=np.int32), 1, SELF)


ALL_OPEN, ALL_STICK = active(*[OPEN] * N), active(*[STICK] * N)


@pytest.mark.parametrize(
    ("is_free", "new", "old", "state", "kept", "rescues"),
    [
        # a set that holds is taken as it is
        (lambda _: False, active(OPEN, OPEN, STICK, STICK), ALL_STICK, PULLED, "OOSS", 0),
        # all would open: half of them, those that pull least, stay for an iteration
        (lambda a: np.all(a.status == OPEN), ALL_OPEN, ALL_STICK, PULLED, "SSOO", 0),
        # the mildest alone holds in no case: three have to stay
        (lambda a: np.sum(a.status == STICK) < 3, ALL_OPEN, ALL_STICK, PULLED, "SSSO", 0),
        # points that slip grip before the body is let go
        (
            lambda a: not np.any(a.status[:3] == STICK),
            active(SLIP, SLIP, SLIP, OPEN, direction=1.0),
            active(SLIP, SLIP, SLIP, STICK, direction=1.0),
            contact([[1.0, 0.3], [1.0, 0.3], [1.0, 0.3], [-1.0, 0.0]]),
            "SSSO",
            1,
        ),
        # the last point to stick yields; those that slid the other way come to rest one by one,
        # the slowest first: forces against slip, and on the last more than friction can give
        (
            lambda a: not np.any(a.status == STICK),
            replace(active(*[SLIP] * N), direction=np.array([[1.0], [1.0], [-1.0], [-1.0]])),
            replace(
                active(SLIP, SLIP, SLIP, STICK), direction=np.array([[1.0], [1.0], [-1.0], [0.0]])
            ),
            contact(
                [[1.0, 0.3], [1.0, 0.3], [1.0, -0.3], [1.0, -0.8]], slip=[-2e-3, -1e-3, 1e-3, 0.0]
            ),
            "LSLL",
            0,
        ),
    ],
)
def test_what_lets_the_body_go_is_kept(is_free, new, old, state, kept, rescues):
    policy = hold(is_free)
    found = policy.kept(new, old, state)
    letters = {"O": OPEN, "S": STICK, "L": SLIP}
    assert found.status.tolist() == [letters[letter] for letter in kept]
    assert policy.rescues == rescues


def test_an_open_pair_lands_at_its_nearest_point():
    number = np.array([0, 0, 1, 1], dtype=np.int32)
    policy = LastHold(
        lambda a, _: [] if a.status[2] != OPEN else ["rotation about (0, 0)"], number, 2, SELF
    )
    apart = contact([[-1.0, 0], [-1.0, 0], [0, 0], [0, 0]], gap=[0, 0, 0.1, 0.2])
    new = policy.kept(active(OPEN, STICK, OPEN, OPEN), active(STICK, STICK, OPEN, OPEN), apart)
    assert new.status.tolist() == [OPEN, STICK, STICK, OPEN]


def test_what_nothing_holds_is_named_and_no_more_than_three_rescues_are_tried():
    policy = hold(lambda _: True)
    with pytest.raises(NotFound, match=r"^translation y: .*4 open, 0 sticking, 0 slipping"):
        policy.kept(active(*[OPEN] * N), active(*[STICK] * N), PULLED)
    rescued = hold(lambda a: not np.any(a.status == STICK))
    slid = contact([[1.0, 0.3]] * N)
    old, new = active(STICK, *[SLIP] * 3), active(*[SLIP] * N)
    for _ in range(3):
        assert STICK in rescued.kept(new, old, contact([[1.0, 0.3]] * N, slip=[1.0] * N)).status
    # the fourth time the mildest one is still kept where that suffices, but nothing grips
    alone = hold(lambda a: not np.any(a.status[1:] == STICK))
    for _ in range(3):
        alone.kept(new, old, slid)
    with pytest.raises(NotFound):
        alone.kept(new, old, slid)


def test_points_that_cycle_change_one_at_a_time():
    """Points that swap their states: the remedy lets the worst one go first."""
    cycles = Cycles(SELF)
    a, b = active(STICK, STICK, OPEN, OPEN), active(OPEN, OPEN, STICK, STICK)
    assert not cycles.repeats(a)
    assert not cycles.repeats(b)
    assert cycles.repeats(a)
    wrong = contact([[-1.0, 0], [-2.0, 0], [0, 0], [0, 0]], gap=[0, 0, -0.5, -0.1])
    assert wrong.active_set(a).status.tolist() == b.status.tolist()
    assert cycles.slowed(a, wrong).status.tolist() == [STICK, OPEN, OPEN, OPEN]
    assert not cycles.repeats(a)
    assert not cycles.repeats(b)
    with pytest.raises(NotFound, match="2 active sets"):
        cycles.repeats(a)


def rounded(dim):
    """A block with a round foot on a flat one, the finer of the two."""

    def foot(x):
        away = np.sum((x[:, : dim - 1] - 0.5) ** 2, axis=1)
        x[:, dim - 1] += (2 - x[:, dim - 1]) * away / 4
        return x

    cell, divisions = ("triangle", (24, 17)) if dim == 2 else ("tetrahedron", (6, 4))
    stack = Stack(divisions, cell, shape=foot)
    return stack, stack.moved_top([0.002] * (dim - 1) + [-0.02])


@pytest.mark.parametrize(("dim", "friction"), [(2, 0.0), (2, 0.3), (3, 0.0)])
def test_a_cold_start_takes_few_iterations(monkeypatch, dim, friction):
    stack, supports = rounded(dim)
    states = []
    for alone in (False, True):
        if alone:
            monkeypatch.setattr(EdgeRelease, "deeper", lambda _, new, *__: new)
        states += stack.contact(stack.pair("lower", friction), supports)
    assert states[0].iterations <= 8
    assert dim == 3 or states[0].iterations < states[1].iterations
    moved = [state.displacement.array for state in states]
    assert moved[0] == pytest.approx(moved[1], abs=1e-10 * np.abs(moved[1]).max())

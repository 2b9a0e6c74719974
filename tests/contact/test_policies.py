"""The policies of the active-set iteration, each alone."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements.contact import OPEN, SLIP, STICK, Coulomb, NotFound
from pw_elements.contact.iteration.updates import CycleGuard, SetHistory
from pw_elements.contact.model import Cone
from pw_elements.contact.nodes import ActiveSet, ContactNodes

SELF = MPI.COMM_SELF
N = 4


def active(*status, direction=0.0):
    n = len(status)
    slipping = np.array(status) == SLIP
    return ActiveSet(
        np.array(status, dtype=np.int8),
        np.where(slipping, direction, 0.0)[:, None] * np.ones((n, 1)),
        *np.zeros((4, n)),
        *np.zeros((2, n, 1)),
    )


def contact(force, gap=None, slip=None, friction=0.3):
    """Points in the plane, their normal upwards; forces (n, 2) are normal and tangential."""
    force = np.asarray(force, dtype=float)
    n = len(force)
    frame = np.tile(np.array([[0.0, 1.0], [1.0, 0.0]]), (n, 1, 1))
    gap = np.zeros(n) if gap is None else np.asarray(gap, dtype=float)
    slip = np.zeros(n) if slip is None else np.asarray(slip, dtype=float)
    cone, no = Cone([Coulomb(0.0)], [np.full(n, friction)]), np.zeros(n, dtype=bool)
    return ContactNodes(frame, gap, slip[:, None], force, cone, np.ones(n), no[:, None], no, no)


def test_points_that_cycle_change_one_at_a_time():
    cycles = CycleGuard(SELF)
    a, b = active(STICK, STICK, OPEN, OPEN), active(OPEN, OPEN, STICK, STICK)
    assert not cycles.record_and_detect(a)
    assert not cycles.record_and_detect(b)
    assert cycles.record_and_detect(a)
    wrong = contact([[-1.99, 0], [-2.0, 0], [0, 0], [0, 0]], gap=[0, 0, -0.5, -0.1])
    assert wrong.next_active_set(a).status.tolist() == b.status.tolist()
    assert cycles.propose(a, wrong).status.tolist() == [STICK, OPEN, OPEN, OPEN]
    assert not cycles.record_and_detect(a)
    assert not cycles.record_and_detect(b)
    with pytest.raises(NotFound, match="2 active sets"):
        cycles.record_and_detect(a)


def test_a_set_that_comes_back_is_kept_until_its_equations_are_solved():
    history = SetHistory(SELF)
    one, other = active(SLIP, STICK, direction=1.0), active(OPEN, STICK)
    assert [history.record_and_ask_to_keep(active(SLIP, STICK), 1.0) for _ in range(8)] == [
        False
    ] * 8  # it stays
    kept = [history.record_and_ask_to_keep((one, other)[k % 2], 1.0) for k in range(6)]
    assert kept == [False] * 5 + [True]
    assert history.record_and_ask_to_keep(other, 1e-3)
    assert not history.record_and_ask_to_keep(other, 1e-9)  # solved
    assert [history.record_and_ask_to_keep(one, 1.0) for _ in range(6)] == [True] * 5 + [
        False
    ]  # not for ever


def test_cycle_names_the_nodes_that_change():
    history, two = SetHistory(SELF), (active(SLIP, STICK, direction=1.0), active(OPEN, STICK))
    points = SimpleNamespace(
        pair=np.zeros(2), position=np.array([[3.0, 1.0], [4.0, 1.0]]), gathered=lambda x: x
    )
    assert str(history.make_error("no set", points)) == "no set"
    for k in range(8):
        history.record_and_ask_to_keep(two[k % 2], 1.0)
    words = str(history.make_error("no set", points))
    assert "2 sets come back, which differ at 1 of the nodes, at (3, 1)" in words

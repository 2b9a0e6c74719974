"""Separate tests of the policies that update the active set of contact nodes."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements.contact import OPEN, SLIP, STICK, Coulomb, SolutionNotFound
from pw_elements.contact.iteration.updates import (
    ActiveSetHistory,
    ActiveSetUpdate,
    report_no_free_motions,
)
from pw_elements.contact.model import FrictionCone
from pw_elements.contact.nodes import ActiveSet, ContactNodes

SELF_COMM = MPI.COMM_SELF


def make_active_set(*statuses, slip_direction=0.0):
    """Return an active set with the given statuses and one direction for all slipping nodes."""
    n = len(statuses)
    slipping = np.array(statuses) == SLIP
    return ActiveSet(
        np.array(statuses, dtype=np.int8),
        np.where(slipping, slip_direction, 0.0)[:, None] * np.ones((n, 1)),
        *np.zeros((4, n)),
        *np.zeros((2, n, 1)),
    )


def make_contact_nodes(force, gap=None, slip=None, friction=0.3):
    """Return plane contact nodes whose normal is y; `force` (n, 2) is normal and tangential."""
    force = np.asarray(force, dtype=float)
    n = len(force)
    frame = np.tile(np.array([[0.0, 1.0], [1.0, 0.0]]), (n, 1, 1))
    gap = np.zeros(n) if gap is None else np.asarray(gap, dtype=float)
    slip = np.zeros(n) if slip is None else np.asarray(slip, dtype=float)
    cone, none_marked = (
        FrictionCone([Coulomb(0.0)], [np.full(n, friction)]),
        np.zeros(n, dtype=bool),
    )
    return ContactNodes(
        frame,
        gap,
        slip[:, None],
        force,
        cone,
        np.ones(n),
        none_marked[:, None],
        none_marked,
        none_marked,
    )


def test_nodes_that_cycle_change_one_at_a_time():
    interface = SimpleNamespace(comm=SELF_COMM, shared_nodes=SimpleNamespace(exist=False))
    update = ActiveSetUpdate(report_no_free_motions, interface)
    first_set, second_set = (
        make_active_set(STICK, STICK, OPEN, OPEN),
        make_active_set(OPEN, OPEN, STICK, STICK),
    )
    assert not update.record_set_and_limit_cycling_nodes(first_set)
    assert not update.record_set_and_limit_cycling_nodes(second_set)
    assert update.record_set_and_limit_cycling_nodes(first_set)
    cycling_nodes = make_contact_nodes(
        [[-1.99, 0], [-2.0, 0], [0, 0], [0, 0]], gap=[0, 0, -0.5, -0.1]
    )
    assert cycling_nodes.next_active_set(first_set).status.tolist() == second_set.status.tolist()
    assert update.propose_set_changing_one_cycling_node(
        first_set, cycling_nodes
    ).status.tolist() == [
        STICK,
        OPEN,
        OPEN,
        OPEN,
    ]
    assert not update.record_set_and_limit_cycling_nodes(first_set)
    assert not update.record_set_and_limit_cycling_nodes(second_set)
    with pytest.raises(SolutionNotFound, match="2 active sets"):
        update.record_set_and_limit_cycling_nodes(first_set)


def test_a_recurring_set_is_kept_until_its_equations_are_solved():
    history = ActiveSetHistory(SELF_COMM)
    slip_set, open_set = (
        make_active_set(SLIP, STICK, slip_direction=1.0),
        make_active_set(OPEN, STICK),
    )
    assert [
        history.record_and_decide_to_keep_set(make_active_set(SLIP, STICK), 1.0) for _ in range(8)
    ] == [False] * 8  # the set does not change
    answers = [
        history.record_and_decide_to_keep_set((slip_set, open_set)[k % 2], 1.0) for k in range(6)
    ]
    assert answers == [False] * 5 + [True]
    assert history.record_and_decide_to_keep_set(open_set, 1e-3)
    assert not history.record_and_decide_to_keep_set(open_set, 1e-9)  # solved
    assert [history.record_and_decide_to_keep_set(slip_set, 1.0) for _ in range(6)] == [
        True
    ] * 5 + [False]  # the set is not kept forever


def test_the_error_of_a_cycle_names_the_nodes_that_change():
    history, sets = (
        ActiveSetHistory(SELF_COMM),
        (make_active_set(SLIP, STICK, slip_direction=1.0), make_active_set(OPEN, STICK)),
    )
    nodes = SimpleNamespace(
        pair=np.zeros(2), position=np.array([[3.0, 1.0], [4.0, 1.0]]), gather_values=lambda x: x
    )
    assert str(history.make_error_naming_cycling_nodes("no set", nodes)) == "no set"
    for k in range(8):
        history.record_and_decide_to_keep_set(sets[k % 2], 1.0)
    message = str(history.make_error_naming_cycling_nodes("no set", nodes))
    assert "2 active sets recur, which differ at 1 of the nodes, at (3, 1)" in message

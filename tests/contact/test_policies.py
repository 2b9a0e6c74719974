"""The policies of the active-set iteration, each alone, and how few iterations they take."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements.contact import OPEN, SLIP, STICK, Coulomb, NotFound
from pw_elements.contact.iteration import ActiveSet, Contact
from pw_elements.contact.iteration.policy import Cycles, EdgeRelease
from pw_elements.contact.model import Cone
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


def test_points_that_cycle_change_one_at_a_time():
    cycles = Cycles(SELF)
    a, b = active(STICK, STICK, OPEN, OPEN), active(OPEN, OPEN, STICK, STICK)
    assert not cycles.repeats(a)
    assert not cycles.repeats(b)
    assert cycles.repeats(a)
    wrong = contact([[-1.99, 0], [-2.0, 0], [0, 0], [0, 0]], gap=[0, 0, -0.5, -0.1])
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

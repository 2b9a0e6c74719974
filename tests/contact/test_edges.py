"""How far the edges of a contact recede: against exact pressures of contacts taken too large."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements.contact import OPEN, SLIP, STICK
from pw_elements.contact.iteration import ActiveSet, Contact
from pw_elements.contact.iteration.policy import EdgeRelease
from pw_elements.contact.model import Cone, Coulomb
from tests.contact.two_bodies import Stack


def receded(x, closed, pressure, shear=None, friction=0.0, stuck=True):
    """The law's next set and the one that goes deeper, of points (n, dim)."""
    n, dim = x.shape
    force = np.zeros((n, dim))
    force[:, 0] = np.where(closed, pressure, 0.0)
    if shear is not None:
        force[:, 1] = np.where(closed, shear, 0.0)
    cone = Cone([Coulomb(0.0)], [np.full(n, friction)])
    gap, slip = np.where(closed, 0.0, 1.0), np.zeros((n, dim - 1))  # open points stay so
    known = Contact(np.tile(np.eye(dim), (n, 1, 1)), gap, slip, force, cone, np.ones(n))
    held = np.where((friction > 0) & stuck, STICK, SLIP)
    status = np.where(closed, held, OPEN).astype(np.int8)
    old = ActiveSet(status, np.zeros((n, dim - 1)), *np.zeros((3, n)))
    edges = EdgeRelease(x, np.zeros(n, dtype=np.int32), [0], MPI.COMM_SELF)
    law = known.active_set(old)
    return law, edges.deeper(law, old, known)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_contact_taken_too_large_is_found_at_once(dim):
    """Of a cylinder under its force, or of a sphere at its approach, stuck up to a wider edge s."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        a, h = 1.0, rng.uniform(0.02, 0.04)
        wide = a + rng.uniform(4 * h, 0.3)
        line = np.arange(-1.5, 1.5, h) + rng.uniform(0, h)
        x = np.array(np.meshgrid(*[line] * (dim - 1))).reshape(dim - 1, -1).T
        x, r = np.column_stack([x, np.zeros(len(x))]), np.linalg.norm(x, axis=1)
        closed = r < wide
        depth = np.sqrt(np.maximum(wide**2 - r**2, 1e-3 * h))
        law, next_ = receded(x, closed, ((a**2 + wide**2) / 2 - r**2) / depth)
        edges = [r[some.status != OPEN].max() for some in (law, next_)]
        excess = wide - a
        assert edges[0] > a + excess / 2 - 2 * h
        # nodes where pressures change sign are known to one distance each, e to first order
        assert edges[1] < a + 2 * h + excess**2
        assert np.all(next_.status[r < a - 2 * h] != OPEN)


def test_what_sticks_recedes_likewise():
    """Shear of Cattaneo's contact, stuck up to a wider edge."""
    a, stick, wide, mu, h = 1.0, 0.6, 0.75, 0.3, 0.02
    x = np.column_stack([np.arange(-1.5, 1.5, h), np.zeros(150)])
    s = np.abs(x[:, 0])
    pressure = np.sqrt(np.maximum(a**2 - s**2, 0.0))
    lack = ((stick**2 + wide**2) / 2 - s**2) / np.sqrt(np.maximum(wide**2 - s**2, 1e-5))
    shear = mu * np.where(s < wide, pressure - lack, pressure)
    law, next_ = receded(x, s < a, pressure, shear, mu, s < wide)
    assert law.status[s < 0.5].tolist() == next_.status[s < 0.5].tolist()
    edges = [s[some.status == STICK].max() for some in (law, next_)]
    assert edges[0] == pytest.approx(np.sqrt((stick**2 + wide**2) / 2), abs=2 * h)
    assert edges[1] == pytest.approx(stick, abs=1.5 * h)
    slipping = (next_.status == SLIP) & (law.status == STICK)
    assert slipping.any()
    assert next_.direction[slipping] == pytest.approx(1.0, rel=1e-12)
    assert np.all(next_.turning[slipping] == 1.0)


def test_a_pocket_that_pulls_opens_alone():
    x = np.column_stack([np.linspace(-1.5, 1.5, 151), np.zeros(151)])
    closed, pocket = np.abs(x[:, 0]) < 1, np.abs(x[:, 0]) < 0.2
    law, next_ = receded(x, closed, np.where(pocket, -1.0, 1.0))
    assert np.array_equal(next_.status, law.status)
    assert np.array_equal(next_.status == OPEN, pocket | ~closed)


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

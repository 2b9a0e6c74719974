"""Interfaces: G and H as builders make them, and a law that couples a point to many nodes."""

import numpy as np
import pytest
import scipy.sparse as sp

from pw_elements import Direct
from pw_elements.contact import ContactPair, Parabola, Plane
from pw_elements.contact.interface import Interface, nodal_interface
from pw_elements.contact.interface.operators import Points
from pw_elements.contact.iteration import (
    ContactSystem,
    Increment,
    LinearEquilibrium,
    Policy,
    Reference,
    contact_state,
    newton,
    undeformed,
)
from pw_elements.contact.iteration.law import sticking
from pw_elements.contact.iteration.policy import LastHold
from pw_elements.contact.model import Smallness
from pw_elements.solvers import SolverReport
from pw_elements.spaces import SubSpace
from tests.contact.cases import Block, at

BLOCK = Block(6)
HELD = BLOCK.clamped(at(1, 2.0))
RIGID, CURVED = Plane((0, 0), (0, 1)), Parabola((2, 0), radius=-20.0)


def dense(matrix):
    return matrix.convert("dense").getDenseArray().copy()


def coupled():
    """Points whose motion is a mean of three nodes and whose force acts on a fourth, too."""
    nodal = nodal_interface([ContactPair(at(1, 0.0), RIGID, 0.3)], BLOCK.space, HELD)
    order = np.argsort(nodal.position[:, 0])
    own, n = sp.csr_matrix(dense(nodal.motion)), BLOCK.K.getSize()[0]
    m = len(order)
    mean = np.zeros((m, m))
    for i, point in enumerate(order):
        mean[point, order[max(i - 1, 0)]] += 0.25
        mean[point, point] += 0.5
        mean[point, order[min(i + 1, m - 1)]] += 0.25
    y = BLOCK.x[:, 1]
    inner = np.flatnonzero(np.isclose(y, y[y > 1e-9].min()))[:m]
    elsewhere = sp.lil_matrix((2 * m, n))
    for i, node in enumerate(np.resize(inner, m)):
        elsewhere[2 * i, 2 * node], elsewhere[2 * i + 1, 2 * node + 1] = 0.2, 0.3
    motion = (sp.kron(mean, np.eye(2)) @ own).tocsr()
    force = (2.0 * own + elsewhere.tocsr()).tocsr()
    zero, law = np.zeros_like(nodal.position), (nodal.cone, nodal.equation)
    points = Points(
        nodal.position, *law, motion, force, zero, zero, nodal.node, nodal.faced, nodal.noise
    )
    interface = Interface([points], [CURVED], SubSpace.displacements(BLOCK.space))
    return interface, motion.toarray(), force.toarray().T


@pytest.mark.parametrize("descent", [0.0, 0.01])
@pytest.mark.parametrize("driven", ["motion", "force"])
def test_a_point_may_couple_to_many_nodes_and_its_force_act_elsewhere(descent, driven):
    """Stick, slip and open points: a, r and U satisfy equilibrium with G and H, and the law."""
    interface, G, H = coupled()
    load = BLOCK.load((6.0, 0.0), at(0, 4.0))
    free = () if driven == "motion" else ((0, 1),)
    system = ContactSystem(BLOCK.K, HELD, interface, free, Direct())
    prescribed = np.array([[0.0, np.nan if free else 0.06 + descent]])
    totals = np.array([40.0 + 1e3 * descent] * len(free))
    zero = np.zeros_like(interface.position)
    past = Reference(zero, zero, np.zeros((1, 2)))
    equilibrium = LinearEquilibrium.of(system, BLOCK.K, load)
    increment = Increment(system, equilibrium, prescribed, totals, past)
    policy = Policy(LastHold(lambda *_: [], interface.pair, 1, interface.comm), interface.comm)
    place = increment.kinematics(np.nan_to_num(prescribed), zero, zero)
    start = sticking(np.ones(len(zero), dtype=bool), interface.cone, 1)
    now = newton(increment, start, place, policy, 50)

    # all of it once more, from K, G, H and the law as the paper's readers know it
    K, f, a = dense(BLOCK.K), load.array_r, now.full.array_r
    r, moved = now.force, (G @ a).reshape(-1, 2) - now.translations[0]
    unbalanced = (K @ a - f - H @ r.ravel()).reshape(-1, 2)
    assert np.abs(unbalanced[~np.isclose(BLOCK.x[:, 1], 2.0)]).max() < 1e-9 * np.abs(r).max()
    gap, slip = CURVED.gap(interface.position) + moved[:, 1], moved[:, 0]
    limit, closed = 0.3 * r[:, 1], gap < 1e-9
    assert min(gap.min(), 1e-3 * r[:, 1].min()) > -1e-12
    assert np.abs(r[:, 1] * gap).max() < 1e-10 * np.abs(r).max()
    assert np.all(np.abs(r[:, 0]) <= limit + 1e-9)
    assert np.abs((limit - np.abs(r[:, 0])) * slip).max() < 1e-9
    assert np.all(r[:, 0] * slip <= 1e-9)
    assert (gap > 1e-6).any()
    assert (limit[closed] - np.abs(r[closed, 0]) > 1e-6).any()
    assert (np.abs(slip)[closed] > 1e-6).any()
    if free:
        assert r[:, 1].sum() == pytest.approx(totals[0])
    before = undeformed(interface, BLOCK.K.createVecRight())
    state = contact_state(increment, now, 1, before, SolverReport("LU", 1), Smallness())
    assert state.residuals.largest() < 1e-10

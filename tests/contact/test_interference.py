"""Interference: a ring that is shrunk onto a rigid shaft, by Lamé's solution."""

from dataclasses import make_dataclass

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import prescribe
from pw_elements.contact import SLIP, ContactPair, NotFound, Plane
from pw_elements.contact.steps.stepping import Target, between, held_by, in_parts
from pw_elements.meshes import quadrilaterals, triangles
from tests.contact.cases import GALERKIN, PW, Elastic, at
from tests.contact.residuals import residuals, walked, worst

INNER, OUTER, HEIGHT = 2.0, 3.5, 0.6
MODULUS, NU, DEPTH = 500.0, 0.3, 0.01
# what residuals are recomputed from
Stated = make_dataclass("Stated", ("K", "space", "loads", "conditions", "pairs"))


def lame():
    """Pressure between the shaft and a ring in plane strain; G. Lamé (1852), any textbook."""
    opening = (1 - 2 * NU) * INNER + OUTER**2 / INNER
    return DEPTH * MODULUS / (1 + NU) * (OUTER**2 - INNER**2) / INNER**2 / opening


class Ring(Elastic):
    """A ring between two smooth planes, its bore smaller than the shaft by `DEPTH`."""

    def __init__(self, n, method=PW, build=triangles):
        mesh = build(MPI.COMM_SELF, (INNER, 0.0), (OUTER, HEIGHT), (n, 2))
        super().__init__(mesh, method, "axisymmetric", MODULUS, NU)
        self.ends = self.held(*((1, at(1, z)) for z in (0.0, HEIGHT)))

    def pair(self, mu=0.0, interference=True):
        shaft = Plane((INNER + DEPTH, 0), (1, 0))
        return ContactPair(at(0, INNER), shaft, mu, interference=interference)

    def stepping(self, mu=0.0):
        """A problem, its stepping, and the increment's start and end."""
        problem = self.problem(self.pair(mu), self.ends)
        stepping = problem._stepping
        start = held_by(problem.undeformed, self.K, stepping.interface)
        return problem, stepping, start, Target.of(self.nothing, (), stepping.interface)


@pytest.mark.parametrize(
    ("method", "build"), [(PW, triangles), (GALERKIN, triangles), (PW, quadrilaterals)]
)
def test_a_shrunk_ring_has_lames_pressure(method, build):
    errors = []
    for ring in (Ring(n, method, build) for n in (3, 6)):
        one, two = ring.contact(ring.pair(), ring.ends, [ring.nothing] * 2)
        errors.append(abs(one.pairs[0].force[0] / (2 * np.pi * INNER * HEIGHT) / lame() - 1))
        assert np.abs(one.pairs[0].gap).max() < 1e-12
        # gone after the first increment
        assert two.displacement.array_r == pytest.approx(one.displacement.array_r, abs=1e-12)
    assert errors[1] < 1e-4
    assert errors[1] < errors[0] / 6


def test_interference_has_to_be_asked_for():
    ring = Ring(3)
    with pytest.raises(ValueError, match="is to say interference=True"):
        ring.contact(ring.pair(interference=False), ring.ends)


def test_parts_of_a_fit_are_parts_of_its_depth():
    """Without friction the way does not matter, and a quarter of the depth has its forces."""
    ring = Ring(3)
    problem, stepping, start, end = ring.stepping()
    whole, state = problem.step(problem.undeformed, ring.nothing), problem.undeformed
    for share in (0.25, 0.5, 1.0):
        state = stepping._solved(state, between(start, end, share))
        part = state.pairs[0]
        assert part.force == pytest.approx(share * whole.pairs[0].force, rel=1e-10)
        assert np.all(part.status == SLIP)


def test_a_fit_in_parts_obeys_the_law_in_each_of_them():
    ring = Ring(3)
    problem, stepping, start, end = ring.stepping(0.2)

    def timid(state, target):
        if target.stated - (0.0 if state is problem.undeformed else 0.5) > 0.5:
            raise NotFound("too much")
        return stepping._solved(state, target)

    cut = in_parts(timid, problem.undeformed, start, end)
    conditions = [prescribe(ring.space, 1, at(1, z)) for z in (0.0, HEIGHT)]
    stated = Stated(ring.K, ring.space, [ring.nothing], conditions, [ring.pair(0.2)])
    assert [share for share, _ in cut.substates] == [0.5]
    assert worst(residuals(*walked(stated, [cut]))) < 1e-9
    unscaled, steps, _ = walked(stated, [cut])
    assert worst(residuals(unscaled, steps)) > 1e-3

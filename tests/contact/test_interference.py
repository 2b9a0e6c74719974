"""Interference: a ring that is shrunk onto a rigid shaft, by Lamé's solution."""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from dolfinx import fem

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.contact import (
    SLIP,
    ContactPair,
    ContactProblem,
    NotFound,
    Plane,
    solve_contact,
)
from pw_elements.contact.rescue import Budget
from pw_elements.contact.steps.stepping import Target, between, held_by, in_parts
from pw_elements.elasticity import StressState
from pw_elements.meshes import quadrilaterals, triangles
from tests.contact.cases import at
from tests.contact.residuals import residuals, walked, worst

INNER, OUTER, HEIGHT = 2.0, 3.5, 0.6
MODULUS, NU, DEPTH = 500.0, 0.3, 0.01


@dataclass(frozen=True)
class Stated:
    """What residuals are recomputed from."""

    K: PETSc.Mat
    space: fem.FunctionSpace
    loads: list
    conditions: list
    pairs: list


def lame():
    """Pressure between the shaft and a ring in plane strain; G. Lamé (1852), any textbook."""
    opening = (1 - 2 * NU) * INNER + OUTER**2 / INNER
    return DEPTH * MODULUS / (1 + NU) * (OUTER**2 - INNER**2) / INNER**2 / opening


class Ring:
    """A ring between two smooth planes, its bore smaller than the shaft by `DEPTH`."""

    def __init__(self, n, method=Spaces.petrov_galerkin, build=triangles):
        mesh = build(MPI.COMM_SELF, (INNER, 0.0), (OUTER, HEIGHT), (n, 2))
        body = Body(method(mesh), Material(MODULUS, NU), StressState.AXISYMMETRIC)
        self.space = body.spaces.trial
        self.K = assemble_matrix(body.stiffness())
        ends = [prescribe(self.space, 1, at(1, z)) for z in (0.0, HEIGHT)]
        self.conditions = ends
        self.reduction = Reduction.dirichlet(self.space, ends)
        self.nothing = self.K.createVecLeft()

    def pair(self, mu=0.0, interference=True):
        shaft = Plane((INNER + DEPTH, 0), (1, 0))
        return ContactPair(at(0, INNER), shaft, mu, interference=interference)

    def solve(self, **options):
        return solve_contact(
            self.K, self.nothing, self.reduction, self.pair(**options), self.space
        )[0]

    def pressure_error(self):
        force = self.solve().pairs[0].force[0]
        return force / (2 * np.pi * INNER * HEIGHT) / lame() - 1


@pytest.mark.parametrize(
    ("method", "build"),
    [
        (Spaces.petrov_galerkin, triangles),
        (Spaces.galerkin, triangles),
        (Spaces.petrov_galerkin, quadrilaterals),
    ],
)
def test_a_shrunk_ring_has_lames_pressure(method, build):
    coarse, fine = (abs(Ring(n, method, build).pressure_error()) for n in (3, 6))
    assert fine < 1e-4
    assert fine < coarse / 6


def test_interference_has_to_be_asked_for():
    with pytest.raises(ValueError, match="is to say interference=True"):
        Ring(3).solve(interference=False)


def test_interference_is_gone_after_the_first_increment():
    ring = Ring(3)
    one, two = solve_contact(ring.K, [ring.nothing] * 2, ring.reduction, ring.pair(), ring.space)
    assert np.abs(one.pairs[0].gap).max() < 1e-12
    assert two.displacement.array_r == pytest.approx(one.displacement.array_r, abs=1e-12)


def test_parts_of_a_fit_are_parts_of_its_depth():
    """Without friction the way does not matter, and a quarter of the depth has its forces."""
    ring = Ring(3)
    problem = ContactProblem(ring.K, ring.reduction, ring.pair(), ring.space)
    whole = problem.step(problem.undeformed, ring.nothing)
    start = held_by(problem.undeformed, ring.K, problem._stepping.interface)
    end = Target.of(ring.nothing, (), problem._stepping.interface)
    state = problem.undeformed
    for share in (0.25, 0.5, 1.0):
        state = problem._stepping._solved(state, between(start, end, share))
        part = state.pairs[0]
        assert part.force == pytest.approx(share * whole.pairs[0].force, rel=1e-10)
        assert np.all(part.status == SLIP)


def test_a_fit_in_parts_obeys_the_law_in_each_of_them():
    ring = Ring(3)
    pair = ring.pair(mu=0.2)
    problem = ContactProblem(ring.K, ring.reduction, pair, ring.space)
    start = held_by(problem.undeformed, ring.K, problem._stepping.interface)
    end = Target.of(ring.nothing, (), problem._stepping.interface)

    def timid(state, target):
        if target.stated - (0.0 if state is problem.undeformed else 0.5) > 0.5:
            raise NotFound("too much")
        return problem._stepping._solved(state, target)

    _, cut = in_parts(timid, problem.undeformed, start, end, Budget(np.inf))
    stated = Stated(ring.K, ring.space, [ring.nothing], ring.conditions, [pair])
    assert [share for share, _ in cut.substates] == [0.5]
    assert worst(residuals(*walked(stated, [cut]))) < 1e-9
    unscaled, steps, _ = walked(stated, [cut])
    assert worst(residuals(unscaled, steps)) > 1e-3

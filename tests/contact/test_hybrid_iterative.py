"""Contact of hybrid bodies by the iterative solver: the states of factors, in space."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_unit_cube

from pw_elements import Body, Direct, Iterative, Material, Reduction, Spaces, assemble_matrix
from pw_elements import prescribe as held
from pw_elements.contact import ContactPair, Motion, NotFound, Plane, solve_contact
from pw_elements.contact.model import MatchingNodes
from tests.contact.cases import at
from tests.contact.iterative import CASES, STACKED, Solid, held_by_contact
from tests.contact.test_iterative import compare
from tests.contact.two_bodies import Stack

METHOD = "GMRES with p-multigrid in a block triangle"


def both(arguments):
    """States by iterations and by factors."""
    return [solve_contact(*arguments, solver=solver) for solver in (Iterative(), Direct())]


def same(states, exact):
    """Those of factors; pressures, too. Their stability constants of 0.14 cost a digit."""
    compare(states, exact, near=1e-9)
    for a, b in zip(states, exact, strict=True):
        assert (a.unknowns - b.unknowns).norm() < 1e-9 * b.unknowns.norm()
    assert (states[-1].report.method, states[-1].report.factorisations) == (METHOD, 0)


@pytest.mark.parametrize(
    ("case", "nu"), [*((case, 0.5) for case in CASES), ("sphere", 0.3), ("sphere", 0.4999)]
)
def test_states_are_those_of_factors(case, nu):
    states, exact = both(Solid(method=Spaces.hybrid, nu=nu).arguments(case))
    same(states, exact)
    assert states[-1].report.krylov_iterations < 150


@pytest.mark.parametrize("method", [Spaces.hybrid, Spaces.taylor_hood])
@pytest.mark.parametrize("case", ["sphere", "plate by forces"])
def test_of_hexahedra_and_standard_weights(case, method):
    cell = "hexahedron" if method == Spaces.hybrid else "tetrahedron"
    same(*both(Solid(cell, method, nu=0.5).arguments(case)))


@pytest.mark.parametrize("case", STACKED)
def test_two_bodies(case):
    stack = Stack((4, 3), "tetrahedron", upper=(0.13, 0.83), element="hybrid", nu=0.5)
    states, exact = both(STACKED[case](stack, "lower" if case == "smooth" else "upper"))
    same(states, exact)
    assert states[-1].report.krylov_iterations < 220


def test_matching_nodes():
    stack = Stack((3, 3), "tetrahedron", element="hybrid", nu=0.4999)
    surface = MatchingNodes(stack.nodes("lower"), Plane((0, 0, 1), (0, 0, 1)))
    same(*both(held_by_contact(stack, "upper", surface)))


def test_units_do_not_matter():
    """Forces and pressures in TPa or in nPa."""
    counts = []
    for unit in (1e-12, 1.0, 1e9):
        solid = Solid(method=Spaces.hybrid, nu=0.4999)
        solid.body = Body(solid.body.spaces, Material(1000.0 * unit, 0.4999), "solid")
        solid.K = assemble_matrix(solid.body.stiffness())
        states, exact = both(solid.arguments("sphere"))
        same(states, exact)
        counts.append(states[-1].report.krylov_iterations)
    assert max(counts) - min(counts) <= 2


def test_a_system_takes_less_than_ten_iterations_on_average():
    for n in (3, 6):
        arguments = Solid(method=Spaces.hybrid, n=n, nu=0.4999).arguments("rough floor")
        (state,) = solve_contact(*arguments, solver=Iterative())
        assert state.report.krylov_iterations < 10 * state.iterations


def test_auto_takes_it_for_large_bodies_in_space():
    arguments = Solid(method=Spaces.hybrid, n=7, nu=0.5).arguments("rough floor")
    (state,) = solve_contact(*arguments)
    assert state.report.method == METHOD


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_enclosed_bodies_are_named(friction):
    mesh = create_unit_cube(MPI.COMM_SELF, 2, 2, 2, CellType.tetrahedron)
    body = Body(Spaces.hybrid(mesh), Material(1.0, 0.5), "solid")
    W = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    walls = [held(W, k, at(k, end)) for k in (0, 1) for end in (0.0, 1.0)]
    supports = Reduction.dirichlet(W, [*walls, held(W, 2, at(2, 0.0))])
    lid = ContactPair(at(2, 1.0), Plane((0, 0, 1), (0, 0, -1)), friction, [Motion((0, 0, -0.01))])
    with pytest.raises(NotFound, match="Supports and contact enclose an incompressible body"):
        solve_contact(K, K.createVecLeft(), supports, lid, W, solver=Iterative())
    body = Body(body.spaces, Material(1.0, 0.49), "solid")
    arguments = assemble_matrix(body.stiffness()), K.createVecLeft(), supports, lid, W
    states, exact = both(arguments)
    same(states, exact)
    # oedometric, with Lame's constants
    nu = 0.49
    modulus = (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    assert states[0].pairs[0].force_normal.sum() == pytest.approx(0.01 * modulus, rel=1e-9)
    assert np.all(states[0].pairs[0].force_normal > 0)

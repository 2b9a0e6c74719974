"""Contact by the iterative solver: the states of the direct one, in space."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_unit_cube
from scipy.sparse.linalg import LinearOperator, gmres

from pw_elements import Direct, Iterative, Spaces
from pw_elements.contact import (
    STICK,
    ContactPair,
    ContactProblem,
    FreeBody,
    Motion,
    NotFound,
    Plane,
    solve_contact,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.solvers import SolverReport
from study.elements import taylor_hood
from tests.contact.cases import GALERKIN, PW, ElasticBody, on_plane
from tests.contact.iterative import (
    SOLID_CASES,
    STACKED_CASES,
    SolidBlock,
    nearly_sliding_arguments,
    upper_on_lower_arguments,
)
from tests.contact.two_bodies import StackedBlocks

HYBRID, TAYLOR_HOOD = Spaces.hybrid, taylor_hood
METHODS = {False: "GMRES with p-multigrid", True: "GMRES with p-multigrid in a block triangle"}


def compare(found, known, near=1e-10):
    """Statuses to be the same, displacements to `near`, forces to 1e-9 of the largest."""
    for a, b in zip(found, known, strict=True):
        assert (a.displacement - b.displacement).norm() < near * b.displacement.norm()
        assert (a.unknowns - b.unknowns).norm() < 1e-9 * b.unknowns.norm()  # pressures, too
        for p, q in zip(a.pairs, b.pairs, strict=True):
            assert np.array_equal(p.status, q.status)
            largest = np.abs(q.force_normal).max()
            assert np.abs(p.force_normal - q.force_normal).max() < 1e-9 * largest
            assert np.abs(p.force_tangential - q.force_tangential).max() < 1e-9 * largest
            assert p.translation == pytest.approx(q.translation, rel=1e-9, abs=1e-12)
        assert a.residuals.largest() < 1e-9


def iterated(arguments, hybrid=False, most=150):
    """States by iterations, which are those of factors: a hybrid's stability costs a digit."""
    states = solve_contact(*arguments, solver=Iterative())
    near = 1e-9 if hybrid else 1e-10
    compare(states, solve_contact(*arguments, solver=Direct()), near)
    report = states[-1].report
    assert (report.method, report.factorisations) == (METHODS[hybrid], 0)
    assert 0 < report.krylov_iterations < most
    assert states[-1].unique is None
    return states


@pytest.mark.parametrize(
    ("case", "cell", "method", "nu"),
    [
        *((case, "tetrahedron", PW, 0.3) for case in SOLID_CASES),
        *((case, "tetrahedron", HYBRID, 0.5) for case in ("tilted", "sphere by forces")),
        ("corner", "hexahedron", PW, 0.3),
        ("tilted", "hexahedron", GALERKIN, 0.3),
        ("rough floor", "tetrahedron", GALERKIN, 0.3),
        ("plate by forces", "hexahedron", HYBRID, 0.5),
        ("sphere", "tetrahedron", TAYLOR_HOOD, 0.5),
    ],
)
def test_states_are_those_of_the_direct_solver(case, cell, method, nu):
    hybrid = method in (HYBRID, TAYLOR_HOOD)
    iterated(SolidBlock(cell, method, nu=nu).case_arguments(case), hybrid)


@pytest.mark.parametrize("method", [PW, HYBRID])
def test_the_solvers_tolerance_is_that_of_contact(method):
    arguments, known = SolidBlock(method=method).case_arguments("rough floor"), None
    for tolerance in (1e-13, 1e-11, 1e-2):  # 1e-10 at most
        (state,) = solve_contact(*arguments, solver=Iterative(tolerance=tolerance))
        work = state.report.krylov_iterations
        if known is not None:
            compare([state], [known[0]], near=1e-9)
            assert work < known[1]
        assert state.residuals.equilibrium < max(min(tolerance, 1e-10), 1e-12)
        known = state, work


def test_steps_go_on_from_any_state():
    solid = SolidBlock()
    K, loads, supports, pair, U = solid.case_arguments("sphere")
    problem = solid.contact_problem(pair, supports, solver=Iterative())
    pressed = problem.step(problem.undeformed, loads[0], [pair.motions[0]])
    other = problem.step(pressed, loads[0], [pair.motions[1]])
    again = problem.step(pressed, loads[0], [pair.motions[1]])
    compare([again], [other])  # the coarse level may be another one
    compare([pressed, other], solve_contact(K, loads, supports, pair, U, solver=Direct()))


def test_bodies_that_hardly_hold_are_solved():
    """No node sticks in the end: what the preconditioner holds is not what the law holds."""
    states = iterated(nearly_sliding_arguments(SolidBlock()))
    assert not np.any(states[1].pairs[0].status == STICK)
    for state in states:
        assert state.report.krylov_iterations < 8 * state.iterations


def test_failures_are_those_of_contact():
    solid = SolidBlock()
    K, load, supports, pair, U = solid.case_arguments("rough floor")
    pulled = load.copy()
    pulled.scale(-1.0)
    with pytest.raises(FreeBody):
        solve_contact(K, pulled, supports, pair, U, solver=Iterative())
    with pytest.raises(NotFound):
        solve_contact(K, load, supports, pair, U, max_iterations=2, solver=Iterative())


@pytest.mark.parametrize(
    ("case", "slave", "element"),
    [
        *((case, "upper", "petrov_galerkin") for case in STACKED_CASES),
        ("on a floor", "lower", "hybrid"),
        ("forces through contact", "lower", "hybrid"),
    ],
)
def test_two_bodies_have_the_states_of_the_direct_solver(case, slave, element):
    hybrid = element == "hybrid"
    nu = 0.5 if hybrid else 0.3
    stack = StackedBlocks((3, 2), "tetrahedron", upper_range=(0.13, 0.83), element=element, nu=nu)
    iterated(STACKED_CASES[case](stack, slave), hybrid, 220)


@pytest.mark.parametrize(("element", "nu"), [("petrov_galerkin", 0.3), ("hybrid", 0.4999)])
def test_matching_nodes_have_the_states_of_the_direct_solver(element, nu):
    stack = StackedBlocks((2, 2), "tetrahedron", element=element, nu=nu)
    surface = MatchingNodes(stack.side_nodes("lower"), Plane((0, 0, 1), (0, 0, 1)))
    iterated(upper_on_lower_arguments(stack, "upper", surface), element == "hybrid")


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_enclosed_bodies_are_named(friction):
    """Nearly incompressible, one has the oedometric modulus."""
    mesh, nu = create_unit_cube(MPI.COMM_SELF, 2, 2, 2, CellType.tetrahedron), 0.49
    walls = [(k, on_plane(k, end)) for k in (0, 1) for end in (0.0, 1.0)] + [(2, on_plane(2, 0.0))]
    lid = ContactPair(
        on_plane(2, 1.0), Plane((0, 0, 1), (0, 0, -1)), friction, [Motion((0, 0, -0.01))]
    )
    body = ElasticBody(mesh, HYBRID, "solid", 1.0, 0.5)
    with pytest.raises(NotFound, match="Supports and contact enclose an incompressible body"):
        body.solve_contact(lid, body.make_supports(*walls), solver=Iterative())
    body = ElasticBody(mesh, HYBRID, "solid", 1.0, nu)
    (state,) = iterated((body.K, body.zero_load, body.make_supports(*walls), lid, body.space), True)
    modulus = (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    assert state.pairs[0].force_normal.sum() == pytest.approx(0.01 * modulus, rel=1e-9)
    assert np.all(state.pairs[0].force_normal > 0)


class Foreign:
    """SciPy's GMRES, which knows neither levels nor contact."""

    matrix_free, determinant_signs, report = True, (), SolverReport("GMRES by SciPy", 0)

    def prepare(self, *_, **__):
        return self

    def iterate(self, product, precondition, right, size):
        n = len(right)
        A, M = (LinearOperator((n, n), of, dtype=float) for of in (product, precondition))
        found, failed = gmres(A, right, rtol=0.0, atol=size, restart=200, M=M)
        assert not failed
        return found

    def release(self):
        pass


def test_another_krylov_method_has_the_states_of_the_direct_solver():
    """With a free surface, whose translations border the matrix, and with two bodies."""
    plate = SolidBlock(n=2).case_arguments("plate by forces")
    stacked = upper_on_lower_arguments(
        StackedBlocks((3, 2), "tetrahedron", upper_range=(0.13, 0.83)), "upper"
    )
    for arguments in (plate, stacked):
        states = solve_contact(*arguments, solver=Foreign())
        compare(states, solve_contact(*arguments, solver=Direct()))
        assert states[-1].report.method == "GMRES by SciPy"
    failing, tries = Foreign(), iter([0])
    failing.iterate = lambda *args: Foreign().iterate(*args) if next(tries, 1) else 1 / 0
    problem = ContactProblem(plate[0], *plate[2:], solver=failing)
    load, motions = plate[1][0], plate[3].motions[:1]
    with pytest.raises(ZeroDivisionError):
        problem.step(problem.undeformed, load, motions)
    problem.step(problem.undeformed, load, motions)  # what has failed is forgotten
    lacking = Foreign()
    lacking.iterate = None
    with pytest.raises(TypeError, match="iterate"):
        solve_contact(*plate, solver=lacking)


def test_what_is_no_solver_is_named():
    with pytest.raises(TypeError, match="the solver is 'quick'"):
        solve_contact(*SolidBlock().case_arguments("rough floor"), solver="quick")

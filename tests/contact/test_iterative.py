"""Contact problems of solids, solved iteratively and compared with states by a direct solver."""

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
    Plane,
    SolutionNotFound,
    solve_contact,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.solvers import SolverReport
from study.model.elements import taylor_hood_spaces
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, ElasticBody, on_plane
from tests.contact.iterative import (
    SOLID_CASE_MAKERS_BY_NAME,
    STACKED_CASE_MAKERS_BY_NAME,
    SolidBlock,
    nearly_sliding_contact_arguments,
    upper_on_lower_contact_arguments,
)
from tests.contact.two_bodies import StackedBlocks

HYBRID, TAYLOR_HOOD = Spaces.hybrid, taylor_hood_spaces
KRYLOV_METHOD_NAME_BY_IS_HYBRID = {
    False: "GMRES with p-multigrid",
    True: "GMRES with p-multigrid in a block triangle",
}


def assert_same_states(states, expected, relative_displacement_tolerance=1e-10):
    """Assert that states have the same statuses and nearly the same displacements and forces.

    Displacements may differ by `relative_displacement_tolerance` relative to their norm, and forces
    by 1e-9 of the largest force.
    """
    for state, reference in zip(states, expected, strict=True):
        assert (
            state.displacement - reference.displacement
        ).norm() < relative_displacement_tolerance * reference.displacement.norm()
        assert (
            state.unknowns - reference.unknowns
        ).norm() < 1e-9 * reference.unknowns.norm()  # pressures included
        for pair, expected_pair in zip(state.pairs, reference.pairs, strict=True):
            assert np.array_equal(pair.status, expected_pair.status)
            largest = np.abs(expected_pair.force_normal).max()
            assert np.abs(pair.force_normal - expected_pair.force_normal).max() < 1e-9 * largest
            assert (
                np.abs(pair.force_tangential - expected_pair.force_tangential).max()
                < 1e-9 * largest
            )
            assert pair.translation == pytest.approx(expected_pair.translation, rel=1e-9, abs=1e-12)
        assert state.residuals.largest() < 1e-9


def solve_and_compare_with_direct_solver(
    contact_arguments, is_hybrid=False, max_krylov_iterations=150
):
    """Solve a problem iteratively, compare it with the direct solver, and return the states.

    The displacements of hybrid elements are compared to one digit less, because the stability of
    these elements limits the accuracy.
    """
    states = solve_contact(*contact_arguments, solver=Iterative())
    tolerance = 1e-9 if is_hybrid else 1e-10
    assert_same_states(states, solve_contact(*contact_arguments, solver=Direct()), tolerance)
    report = states[-1].report
    assert (report.method, report.factorisations) == (KRYLOV_METHOD_NAME_BY_IS_HYBRID[is_hybrid], 0)
    assert 0 < report.krylov_iterations < max_krylov_iterations
    assert states[-1].unique is None
    return states


@pytest.mark.parametrize(
    ("case", "cell", "method", "nu"),
    [
        *((case, "tetrahedron", PETROV_GALERKIN, 0.3) for case in SOLID_CASE_MAKERS_BY_NAME),
        *((case, "tetrahedron", HYBRID, 0.5) for case in ("tilted", "sphere by forces")),
        ("corner", "hexahedron", PETROV_GALERKIN, 0.3),
        ("tilted", "hexahedron", GALERKIN, 0.3),
        ("rough floor", "tetrahedron", GALERKIN, 0.3),
        ("plate by forces", "hexahedron", HYBRID, 0.5),
        ("sphere", "tetrahedron", TAYLOR_HOOD, 0.5),
    ],
)
def test_states_are_those_of_the_direct_solver(case, cell, method, nu):
    is_hybrid = method in (HYBRID, TAYLOR_HOOD)
    solve_and_compare_with_direct_solver(
        SolidBlock(cell, method, nu=nu).contact_arguments_of_case(case), is_hybrid
    )


@pytest.mark.parametrize("method", [PETROV_GALERKIN, HYBRID])
def test_the_solvers_tolerance_is_used_in_contact(method):
    arguments, previous = SolidBlock(method=method).contact_arguments_of_case("rough floor"), None
    for tolerance in (1e-13, 1e-11, 1e-2):  # at most 1e-10 is used as the tolerance
        (state,) = solve_contact(*arguments, solver=Iterative(tolerance=tolerance))
        n_krylov = state.report.krylov_iterations
        if previous is not None:
            assert_same_states([state], [previous[0]], relative_displacement_tolerance=1e-9)
            assert n_krylov < previous[1]
        assert state.residuals.equilibrium < max(min(tolerance, 1e-10), 1e-12)
        previous = state, n_krylov


def test_steps_may_start_from_any_state():
    solid = SolidBlock()
    K, loads, supports, pair, U = solid.contact_arguments_of_case("sphere")
    problem = solid.contact_problem(pair, supports, solver=Iterative())
    pressed_state = problem.step(problem.undeformed, loads[0], [pair.motions[0]])
    moved_state = problem.step(pressed_state, loads[0], [pair.motions[1]])
    repeated_state = problem.step(pressed_state, loads[0], [pair.motions[1]])
    assert_same_states([repeated_state], [moved_state])  # the coarse level may differ
    assert_same_states(
        [pressed_state, moved_state], solve_contact(K, loads, supports, pair, U, solver=Direct())
    )


def test_bodies_that_nearly_slide_are_solved():
    """A body that nearly slides as a whole is solved with few Krylov iterations.

    Under the largest push no node sticks at the end; the preconditioner therefore has to fix more
    nodes than the contact law does.
    """
    states = solve_and_compare_with_direct_solver(nearly_sliding_contact_arguments(SolidBlock()))
    assert not np.any(states[1].pairs[0].status == STICK)
    for state in states:
        assert state.report.krylov_iterations < 8 * state.iterations


def test_failures_are_the_same_as_with_a_direct_solver():
    solid = SolidBlock()
    K, load, supports, pair, U = solid.contact_arguments_of_case("rough floor")
    reversed_load = load.copy()
    reversed_load.scale(-1.0)
    with pytest.raises(FreeBody):
        solve_contact(K, reversed_load, supports, pair, U, solver=Iterative())
    with pytest.raises(SolutionNotFound):
        solve_contact(K, load, supports, pair, U, max_iterations=2, solver=Iterative())


@pytest.mark.parametrize(
    ("case", "slave", "element"),
    [
        *((case, "upper", "petrov_galerkin") for case in STACKED_CASE_MAKERS_BY_NAME),
        ("on a floor", "lower", "hybrid"),
        ("forces through contact", "lower", "hybrid"),
    ],
)
def test_two_bodies_have_the_states_of_the_direct_solver(case, slave, element):
    is_hybrid = element == "hybrid"
    nu = 0.5 if is_hybrid else 0.3
    stack = StackedBlocks((3, 2), "tetrahedron", upper_range=(0.13, 0.83), element=element, nu=nu)
    solve_and_compare_with_direct_solver(
        STACKED_CASE_MAKERS_BY_NAME[case](stack, slave), is_hybrid, 220
    )


@pytest.mark.parametrize(("element", "nu"), [("petrov_galerkin", 0.3), ("hybrid", 0.4999)])
def test_matching_nodes_have_the_states_of_the_direct_solver(element, nu):
    stack = StackedBlocks((2, 2), "tetrahedron", element=element, nu=nu)
    surface = MatchingNodes(stack.side_node_mask("lower"), Plane((0, 0, 1), (0, 0, 1)))
    solve_and_compare_with_direct_solver(
        upper_on_lower_contact_arguments(stack, "upper", surface), element == "hybrid"
    )


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_enclosed_incompressible_bodies_are_refused(friction):
    """An incompressible body that is enclosed on all sides is refused.

    A nearly incompressible body is solved, and its force is that of the oedometric modulus.
    """
    mesh, nu = create_unit_cube(MPI.COMM_SELF, 2, 2, 2, CellType.tetrahedron), 0.49
    walls = [(k, on_plane(k, end)) for k in (0, 1) for end in (0.0, 1.0)] + [(2, on_plane(2, 0.0))]
    lid = ContactPair(
        on_plane(2, 1.0), Plane((0, 0, 1), (0, 0, -1)), friction, [Motion((0, 0, -0.01))]
    )
    body = ElasticBody(mesh, HYBRID, "solid", 1.0, 0.5)
    with pytest.raises(
        SolutionNotFound, match="Supports and contact enclose an incompressible body"
    ):
        body.solve_contact(lid, body.make_supports(*walls), solver=Iterative())
    body = ElasticBody(mesh, HYBRID, "solid", 1.0, nu)
    (state,) = solve_and_compare_with_direct_solver(
        (body.K, body.zero_load, body.make_supports(*walls), lid, body.space), True
    )
    modulus = (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    assert state.pairs[0].force_normal.sum() == pytest.approx(0.01 * modulus, rel=1e-9)
    assert np.all(state.pairs[0].force_normal > 0)


class ScipyGmres:
    """A user's solver by SciPy's GMRES, which ignores multigrid levels and data of the contact."""

    matrix_free, determinant_signs, report = True, (), SolverReport("GMRES by SciPy", 0)

    def prepare(self, *_, **__):
        return self

    def iterate(self, product, precondition, right, tolerance):
        n = len(right)
        A, M = (
            LinearOperator((n, n), function, dtype=float) for function in (product, precondition)
        )
        solution, info = gmres(A, right, rtol=0.0, atol=tolerance, restart=200, M=M)
        assert not info
        return solution

    def release(self):
        pass


def test_a_users_krylov_method_has_the_states_of_the_direct_solver():
    """A user's Krylov method gives the states of the direct solver.

    One problem has a free surface, whose translations add rows and columns to the matrix; the other
    one has two bodies. Errors of the user's method are raised and do not affect later steps.
    """
    plate_arguments = SolidBlock(n=2).contact_arguments_of_case("plate by forces")
    stacked_arguments = upper_on_lower_contact_arguments(
        StackedBlocks((3, 2), "tetrahedron", upper_range=(0.13, 0.83)), "upper"
    )
    for arguments in (plate_arguments, stacked_arguments):
        states = solve_contact(*arguments, solver=ScipyGmres())
        assert_same_states(states, solve_contact(*arguments, solver=Direct()))
        assert states[-1].report.method == "GMRES by SciPy"
    failing_solver, calls = ScipyGmres(), iter([0])
    failing_solver.iterate = lambda *args: ScipyGmres().iterate(*args) if next(calls, 1) else 1 / 0
    problem = ContactProblem(plate_arguments[0], *plate_arguments[2:], solver=failing_solver)
    load, motions = plate_arguments[1][0], plate_arguments[3].motions[:1]
    with pytest.raises(ZeroDivisionError):
        problem.step(problem.undeformed, load, motions)
    problem.step(problem.undeformed, load, motions)  # the failure has no effect on later steps
    incomplete_solver = ScipyGmres()
    incomplete_solver.iterate = None
    with pytest.raises(TypeError, match="iterate"):
        solve_contact(*plate_arguments, solver=incomplete_solver)


def test_an_invalid_solver_is_refused():
    with pytest.raises(TypeError, match="the solver is 'quick'"):
        solve_contact(*SolidBlock().contact_arguments_of_case("rough floor"), solver="quick")

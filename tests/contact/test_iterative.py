"""Contact by the iterative solver: the states of the direct one, in space."""

import numpy as np
import pytest
from scipy.sparse.linalg import LinearOperator, gmres

from pw_elements import Direct, Iterative, Spaces
from pw_elements.contact import STICK, ContactProblem, FreeBody, NotFound, Plane, solve_contact
from pw_elements.contact.iteration import ContactSystem, LinearisedLaw
from pw_elements.contact.iteration.krylov import NodePoints, _apart
from pw_elements.contact.model import MatchingNodes
from pw_elements.solvers import SolverReport
from tests.contact.iterative import CASES, STACKED, Solid, held_by_contact, nearly_sliding
from tests.contact.two_bodies import Stack

ELEMENTS = [
    ("tetrahedron", Spaces.petrov_galerkin),
    ("tetrahedron", Spaces.galerkin),
    ("hexahedron", Spaces.petrov_galerkin),
    ("hexahedron", Spaces.galerkin),
]


@pytest.fixture(scope="module", params=ELEMENTS, ids=lambda p: f"{p[1].__name__}-{p[0]}")
def solid(request):
    return Solid(*request.param)


def compare(found, known, near=1e-10):
    """Statuses to be the same, displacements to `near`, forces to 1e-9 of the largest."""
    for a, b in zip(found, known, strict=True):
        size = b.displacement.norm()
        assert (a.displacement - b.displacement).norm() < near * size
        for p, q in zip(a.pairs, b.pairs, strict=True):
            assert np.array_equal(p.status, q.status)
            largest = np.abs(q.force_normal).max()
            assert np.abs(p.force_normal - q.force_normal).max() < 1e-9 * largest
            assert np.abs(p.force_tangential - q.force_tangential).max() < 1e-9 * largest
            assert p.translation == pytest.approx(q.translation, rel=1e-9, abs=1e-12)
        assert a.residuals.largest() < 1e-9


@pytest.mark.parametrize("case", CASES)
def test_states_are_those_of_the_direct_solver(solid, case):
    arguments = solid.arguments(case)
    states = solve_contact(*arguments, solver=Iterative())
    compare(states, solve_contact(*arguments, solver=Direct()))
    assert states[-1].unique is None
    report = states[-1].report
    assert (report.method, report.factorisations) == ("GMRES with p-multigrid", 0)
    assert 0 < report.krylov_iterations < 150


def test_on_the_way_solutions_are_inexact():
    """All of an increment's systems together take about what a single exact one takes."""
    (state,) = solve_contact(*Solid(n=5).arguments("rough floor"), solver=Iterative())
    assert state.iterations > 5
    assert state.report.krylov_iterations < 8 * state.iterations


@pytest.mark.parametrize("bodies", [1, 2])
def test_the_shell_is_the_assembled_tangent(bodies):
    """Products with random active sets against the matrix that factors are made of."""
    if bodies == 1:
        K, _, supports, pair, U = Solid(n=2).arguments("plate by forces")
    else:
        K, _, supports, pair, U = STACKED["forces through contact"](
            Stack((2, 3), "tetrahedron", upper=(0.13, 0.83)), "upper"
        )
    exact, shell = (ContactProblem(K, supports, pair, U, s) for s in (Direct(), Iterative()))
    free = ((0, 0), (0, 2))
    assembled, krylov = (problem._stepping._bound(free)[0] for problem in (exact, shell))
    rng = np.random.default_rng(3)
    m, dim = assembled.interface.position.shape
    E, C, D = rng.normal(size=(3, m, dim, dim))
    load = assembled.reduction.load(K, K.createVecLeft())
    tangent = assembled.tangent
    law = LinearisedLaw(E, C, D, np.zeros((m, dim)))
    tangent.solve(load.array_r, np.zeros(2), law, "final")
    kept = supports.supports.free
    given = rng.normal(size=int(kept.sum()) + 2)
    x, y = tangent.matrix.createVecs()
    x.setArray(given)
    tangent.matrix.mult(x, y)

    operator = krylov.tangent._operator
    krylov.tangent._context.state(law)
    full, image = operator.createVecs()
    whole = np.append(kept, [True, True])
    values = np.zeros(len(whole))
    values[whole] = given
    full.setArray(values)
    operator.mult(full, image)
    assert np.abs(image.array_r[whole] - y.array_r).max() < 1e-11 * np.abs(y.array_r).max()
    assert np.all(image.array_r[~whole] == 0)


def test_points_at_nodes(solid):
    K, _, supports, pair, U = solid.arguments("tilted")
    problem = ContactProblem(K, supports, pair, U, Iterative())
    system: ContactSystem = problem._stepping._bound(())[0]
    points: NodePoints = system.tangent._points
    x = U.tabulate_dof_coordinates()[points.node]
    assert x == pytest.approx(system.interface.position)
    assert np.array_equal(points.own, points.node[:, None] * 3 + np.arange(3))
    direct = ContactProblem(K, supports, pair, U, Direct())._stepping._bound(())[0]
    assert points.scale == pytest.approx(direct.scale, rel=1e-12)


@pytest.mark.parametrize(("method", "nu"), [(Spaces.petrov_galerkin, 0.3), (Spaces.hybrid, 0.5)])
def test_a_coarser_mesh_state_saves_work(method, nu):
    coarse = Solid(method=method, n=3, nu=nu).arguments("rough floor")
    (coarse,) = solve_contact(*coarse, solver=Iterative())
    fine = Solid(method=method, n=6, nu=nu).arguments("rough floor")
    (cold,) = solve_contact(*fine, solver=Iterative())
    (nested,) = solve_contact(*fine, solver=Iterative(), start=coarse)
    compare([nested], [cold])
    assert nested.report.krylov_iterations < 0.85 * cold.report.krylov_iterations
    assert nested.iterations < cold.iterations


def test_steps_go_on_from_any_state():
    solid = Solid()
    K, loads, supports, pair, U = solid.arguments("sphere")
    problem = ContactProblem(K, supports, pair, U, Iterative())
    pressed = problem.step(problem.undeformed, loads[0], [pair.motions[0]])
    other = problem.step(pressed, loads[0], [pair.motions[1]])
    again = problem.step(pressed, loads[0], [pair.motions[1]])
    compare([again], [other])  # the coarse level may be another one
    compare([pressed, other], solve_contact(K, loads, supports, pair, U, solver=Direct()))


def test_bodies_that_hardly_hold_are_solved():
    """No node sticks in the end: what the preconditioner holds is not what the law holds."""
    arguments = nearly_sliding(Solid())
    states = solve_contact(*arguments, solver=Iterative())
    compare(states, solve_contact(*arguments, solver=Direct()))
    assert not np.any(states[1].pairs[0].status == STICK)
    for state in states:
        assert state.report.krylov_iterations < 8 * state.iterations


@pytest.mark.parametrize("dim", [2, 3])
def test_anchors_are_apart(dim):
    rng = np.random.default_rng(dim)
    x = rng.normal(size=(50, dim)) * [3.0, 1.0, 0.5][:dim]
    triangle = x[_apart(x)]
    edges = triangle[1:] - triangle[0]
    assert len(edges) == dim - 1
    assert np.sqrt(np.linalg.det(edges @ edges.T)) > np.prod(np.ptp(x, axis=0)[: dim - 1]) / 2
    assert _apart(x[:0]) == []
    assert len(_apart(np.tile(x[0], (4, 1)))) == 1


def test_failures_are_those_of_contact():
    solid = Solid()
    K, load, supports, pair, U = solid.arguments("rough floor")
    pulled = load.copy()
    pulled.scale(-1.0)
    with pytest.raises(FreeBody):
        solve_contact(K, pulled, supports, pair, U, solver=Iterative())
    with pytest.raises(NotFound):
        solve_contact(K, load, supports, pair, U, max_iterations=2, solver=Iterative())


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("case", STACKED)
def test_two_bodies_have_the_states_of_the_direct_solver(case, slave):
    """One of them is held by contact alone, or by forces through it."""
    arguments = STACKED[case](Stack((4, 3), "tetrahedron", upper=(0.13, 0.83)), slave)
    states = solve_contact(*arguments, solver=Iterative())
    compare(states, solve_contact(*arguments, solver=Direct()))
    assert states[-1].report.krylov_iterations < 220


def test_two_bodies_of_hexahedra():
    arguments = held_by_contact(Stack((3, 2), "hexahedron", upper=(0.13, 0.83)), "upper")
    compare(*(solve_contact(*arguments, solver=solver) for solver in (Iterative(), Direct())))


def test_a_slave_that_is_stiffer_takes_more_iterations():
    iterations = []
    for ratio in (0.01, 1.0, 100.0):
        stack = Stack((4, 3), "tetrahedron", upper=(0.13, 0.83), ratio=ratio)
        arguments = held_by_contact(stack, "upper")
        (found,) = solve_contact(*arguments, solver=Iterative())
        compare([found], solve_contact(*arguments, solver=Direct()))
        iterations.append(found.report.krylov_iterations)
    soft, equal, stiff = iterations
    assert soft < 1.5 * equal < stiff


def test_matching_nodes_have_the_states_of_the_direct_solver():
    stack = Stack((3, 3), "tetrahedron")
    surface = MatchingNodes(stack.nodes("lower"), Plane((0, 0, 1), (0, 0, 1)))
    arguments = held_by_contact(stack, "upper", surface)
    compare(*(solve_contact(*arguments, solver=solver) for solver in (Iterative(), Direct())))


class Foreign:
    """SciPy's GMRES, which knows neither levels nor contact."""

    matrix_free, orientations, report = True, frozenset(), SolverReport("GMRES by SciPy", 0)

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
    plate = Solid(n=2).arguments("plate by forces")
    stacked = held_by_contact(Stack((3, 2), "tetrahedron", upper=(0.13, 0.83)), "upper")
    for arguments in (plate, stacked):
        states = solve_contact(*arguments, solver=Foreign())
        compare(states, solve_contact(*arguments, solver=Direct()))
        assert states[-1].report.method == "GMRES by SciPy"
    lacking = Foreign()
    lacking.iterate = None
    with pytest.raises(TypeError, match="iterate"):
        solve_contact(*plate, solver=lacking)


def test_what_is_no_solver_is_named():
    with pytest.raises(TypeError, match="the solver is 'quick'"):
        solve_contact(*Solid().arguments("rough floor"), solver="quick")

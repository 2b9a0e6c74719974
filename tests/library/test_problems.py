"""Problems given by a residual: exact solutions, increments and errors."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle

from pw_elements import (
    Direct,
    Iterative,
    NotConverged,
    PetrovGalerkinProblem,
    Reduction,
    SingularSystem,
    Spaces,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    prescribe,
    reactions,
    solve,
    test_space,
)
from tests.contact.cases import make_finite_strain_unknown_and_residual, on_plane
from tests.library.properties import boundary_dofs, make_distorted_unit_mesh

DX_OF_DEGREE_6 = ufl.dx(metadata={"quadrature_degree": 6})
DEFORMATION_GRADIENT = np.array([[1.3, 0.2, -0.1], [-0.15, 0.8, 0.1], [0.05, -0.2, 1.1]])


def make_scalar_space_u_v_and_boundary_dofs(mesh):
    V = fem.functionspace(mesh, ("Lagrange", 2))
    return V, fem.Function(V), ufl.TestFunction(test_space(V)), boundary_dofs(V)


def interpolate(V, field):
    g = fem.Function(V)
    g.interpolate(field)
    return g


def make_rubber_residual(mesh, method=Spaces.petrov_galerkin):
    spaces = method(mesh)
    return spaces.trial, *make_finite_strain_unknown_and_residual(spaces, quadrature_degree=6)


def make_pressed_square_problem(vertical_displacement, cells_per_side=4):
    """Create a problem in which the left half of a square's top is pressed and cannot slide.

    Return it with the constant that prescribes the vertical displacement.
    """
    mesh = create_rectangle(
        MPI.COMM_SELF, [(0.0, 0.0), (1.0, 1.0)], [cells_per_side, cells_per_side]
    )
    (V, u, F), move = make_rubber_residual(mesh), fem.Constant(mesh, vertical_displacement)

    def is_on_left_half_of_top(x):
        return np.isclose(x[1], 1.0) & (x[0] < 0.5 + 1e-9)

    conditions = [
        prescribe(V, 1, is_on_left_half_of_top, move),
        prescribe(V, 0, is_on_left_half_of_top),
    ]
    conditions += [prescribe(V, i, on_plane(1, 0.0)) for i in (0, 1)]
    return PetrovGalerkinProblem(F, u, conditions), move


@pytest.mark.parametrize(
    ("cell", "sizes"),
    [
        (CellType.triangle, (6, 12)),
        (CellType.quadrilateral, (6, 12)),
        (CellType.tetrahedron, (3, 6)),
    ],
)
def test_nonlinear_poisson_converges_with_orders_three_and_two(cell, sizes):
    errors = []
    for n in sizes:
        V, u, v, rim = make_scalar_space_u_v_and_boundary_dofs(make_distorted_unit_mesh(cell, n))
        x = ufl.SpatialCoordinate(V.mesh)
        exact = ufl.sin(2 * x[0]) * ufl.exp(x[1])
        f = -ufl.div((1 + exact**2) * ufl.grad(exact))
        F = ufl.inner((1 + u**2) * ufl.grad(u), ufl.grad(v)) * ufl.dx - f * v * DX_OF_DEGREE_6
        nodal_exact = interpolate(V, lambda x: np.sin(2 * x[0]) * np.exp(x[1]))
        PetrovGalerkinProblem(F, u, fem.dirichletbc(nodal_exact, rim)).solve()
        e = u - exact
        errors.append(
            [
                np.sqrt(assemble_scalar(w * DX_OF_DEGREE_6))
                for w in (e**2, ufl.inner(ufl.grad(e), ufl.grad(e)))
            ]
        )
    orders = np.log2(np.array(errors[0]) / errors[1])
    assert orders == pytest.approx([3.0, 2.0], abs=0.25)


def test_a_linear_residual_has_the_solution_and_reactions_of_solve():
    V, u, v, rim = make_scalar_space_u_v_and_boundary_dofs(
        make_distorted_unit_mesh(CellType.tetrahedron, 2)
    )
    x, w = ufl.SpatialCoordinate(V.mesh), ufl.TrialFunction(V)
    a = (1 + x[0]) * ufl.inner(
        ufl.grad(w), ufl.grad(v)
    ) * DX_OF_DEGREE_6 + 3.0 * w * v * DX_OF_DEGREE_6
    L = ufl.exp(x[1]) * v * DX_OF_DEGREE_6
    condition = fem.dirichletbc(interpolate(V, lambda x: x[0] * x[2]), rim)
    problem = PetrovGalerkinProblem(ufl.action(a, u) - L, u, condition, Direct())
    assert problem.solve() is u
    K, f = assemble_matrix(a), assemble_vector(L)
    expected = solve(K, f, Reduction.dirichlet(V, condition))
    assert np.abs(u.x.array - expected.array).max() < 1e-13
    difference = problem.reactions() - reactions(K, expected, f)
    assert difference.norm() < 1e-13
    (increment,) = problem.increments
    assert (increment.load_factor, increment.relative_corrections) == (1.0, (1.0,))


@pytest.mark.parametrize("cell", [CellType.triangle, CellType.tetrahedron, CellType.hexahedron])
def test_homogeneous_deformation_is_exact(cell):
    mesh = make_distorted_unit_mesh(cell, 2)
    V, u, F = make_rubber_residual(mesh)
    dim = mesh.geometry.dim
    strain = DEFORMATION_GRADIENT[:dim, :dim] - np.eye(dim)
    g = fem.Function(V)

    def set_boundary_displacement(load_factor):
        g.interpolate(lambda x: load_factor * strain @ x[:dim])

    problem = PetrovGalerkinProblem(F, u, fem.dirichletbc(g, boundary_dofs(V)))
    problem.solve(set_boundary_displacement)
    exact = V.tabulate_dof_coordinates()[:, :dim] @ strain.T
    assert np.abs(u.x.array.reshape(-1, dim) - exact).max() < 1e-13
    # reactions are the stress times the weights' integrals: forces on one side are the traction
    F_exact = DEFORMATION_GRADIENT[:dim, :dim]
    inverse = np.linalg.inv(F_exact).T
    stress = F_exact - inverse + 1.5 * np.log(np.linalg.det(F_exact)) * inverse
    v = ufl.TestFunction(test_space(V))
    P = fem.Constant(mesh, stress)
    forces = assemble_vector(ufl.inner(ufl.dot(P, ufl.FacetNormal(mesh)), v) * ufl.ds)
    assert (problem.reactions() - forces).norm() < 1e-12 * forces.norm()


def test_an_increment_is_cut_where_it_fails_as_a_whole():
    problem, move = make_pressed_square_problem(-0.6, 8)
    problem.solve(move)
    assert len(problem.increments) > 1
    assert problem.increments[-1].load_factor == 1.0
    assert move.value == -0.6
    gentle, small = make_pressed_square_problem(-0.6, 8)
    gentle.solve(small, increments=8)
    assert np.abs(problem.u.x.array - gentle.u.x.array).max() < 1e-8


def test_after_a_failure_u_is_the_last_solution():
    problem, move = make_pressed_square_problem(-1.5)  # the top would be pressed through the bottom
    with pytest.raises(NotConverged, match=r"of the load; u is the solution at 0\.\d+"):
        problem.solve(move)
    reached = problem.increments[-1].load_factor
    assert move.value == pytest.approx(-1.5 * reached, abs=1e-15)
    inner = problem.reactions().array.reshape(-1, 2)
    x = problem.u.function_space.tabulate_dof_coordinates()
    free = ~(np.isclose(x[:, 1], 0.0) | np.isclose(x[:, 1], 1.0))
    assert np.abs(inner[free]).max() < 1e-9 * np.abs(inner).max()
    move.value *= 0.9
    problem.solve(move)  # starts from the last solution, not from 0
    assert problem.increments[0].relative_corrections[0] < 0.5


def test_a_failed_solve_without_load_is_not_cut_and_keeps_u():
    problem, _ = make_pressed_square_problem(-1.5)
    with pytest.raises(NotConverged, match="u is as before: start nearer"):
        problem.solve()
    assert not problem.u.x.array.any()


def test_a_second_load_starts_from_the_first_solution():
    problem, move = make_pressed_square_problem(-0.1)
    problem.solve(move)
    move.value = -0.2
    problem.solve([move], increments=2)
    at_once, whole = make_pressed_square_problem(-0.2)
    at_once.solve(whole)
    assert np.abs(problem.u.x.array - at_once.u.x.array).max() < 1e-12
    assert [i.load_factor for i in problem.increments] == [0.5, 1.0]
    increment = problem.increments[0]
    assert increment.relative_corrections[0] < 0.6  # starts from -0.1, not from 0


def test_a_body_without_supports_is_refused_as_singular():
    _, u, F = make_rubber_residual(make_distorted_unit_mesh(CellType.triangle, 2))
    v = F.arguments()[0]
    problem = PetrovGalerkinProblem(F - v[0] * DX_OF_DEGREE_6, u)
    with pytest.raises(SingularSystem, match="conditions leave a motion free"):
        problem.solve()


def laplace_residual(u, v):
    return ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx


def test_invalid_problems_are_refused():
    V, u, v, rim = make_scalar_space_u_v_and_boundary_dofs(
        make_distorted_unit_mesh(CellType.triangle, 2)
    )
    linear_space = fem.functionspace(V.mesh, ("Lagrange", 1))
    problem_type, test, trial = (
        PetrovGalerkinProblem,
        ufl.TestFunction(linear_space),
        ufl.TrialFunction(linear_space),
    )
    F, twice = laplace_residual(u, v), [fem.dirichletbc(value, rim, V) for value in (0.0, 1.0)]
    problem, one_free = problem_type(F, u, twice[0]), "solve with one free matrix under supports"
    for attempt, kind, words in (
        (lambda: problem_type(u * ufl.dx, u), ValueError, "no test function"),
        (lambda: problem_type(u * v * v * ufl.dx, u), ValueError, "no form linear in its weights"),
        (
            lambda: problem_type(u * ufl.dx + u * v * ufl.dx, u),
            ValueError,
            "no form linear in its weights",
        ),
        (
            lambda: problem_type(laplace_residual(fem.Function(V), v), u),
            ValueError,
            "does not depend on u",
        ),
        (lambda: problem_type(laplace_residual(trial, v), u), ValueError, "and no trial function"),
        (
            lambda: problem_type(laplace_residual(u, test), u),
            RuntimeError,
            "number their nodes differently",
        ),
        (lambda: problem_type(ufl.as_ufl(0) * 0, u), TypeError, "the residual is of the type Zero"),
        (lambda: problem_type(F, V), TypeError, "u is of the type FunctionSpace"),
        (lambda: problem_type(F, u, solver="mumps"), TypeError, "the solver is 'mumps'"),
        (lambda: problem_type(F, u, solver=Iterative()), ValueError, one_free),
        (lambda: problem_type(F, u, solver="auto"), ValueError, one_free),
        (lambda: problem_type(F, u, twice), ValueError, "contradict each other"),
        (lambda: problem.solve(increments=0), ValueError, "increments = 0"),
        (lambda: problem.solve([3]), TypeError, "a load is 3: give a fem"),
        (lambda: problem.solve(lambda share: share / 0), ValueError, "failed: ZeroDivisionError"),
    ):
        with pytest.raises(kind, match=words):
            attempt()


def test_a_residual_that_is_not_finite_is_no_solution():
    V, u, v, rim = make_scalar_space_u_v_and_boundary_dofs(
        make_distorted_unit_mesh(CellType.triangle, 2)
    )
    condition = fem.dirichletbc(0.0, rim, V)
    with pytest.raises(NotConverged, match="the residual is not finite"):
        PetrovGalerkinProblem(
            laplace_residual(u, v) - ufl.ln(u) * v * DX_OF_DEGREE_6, u, condition
        ).solve()
    source = fem.Constant(V.mesh, np.nan)
    with pytest.raises(NotConverged, match="the residual is not finite"):
        PetrovGalerkinProblem(
            laplace_residual(u, v) - source * v * DX_OF_DEGREE_6, u, condition
        ).solve()
    assert not u.x.array.any()


def test_functionals_of_weight_functions_on_tetrahedra_are_exact():
    mesh = make_distorted_unit_mesh(CellType.tetrahedron, 2)
    W = Spaces.petrov_galerkin(mesh, 0).test
    w, v = fem.Function(W), ufl.TestFunction(W)
    w.x.array[:] = np.cos(np.arange(len(w.x.array)))
    M = assemble_matrix(ufl.inner(ufl.TrialFunction(W), v) * ufl.dx)
    expected = w.x.petsc_vec.dot(M * w.x.petsc_vec)
    assert assemble_scalar(w**2 * ufl.dx) == pytest.approx(expected, rel=1e-13)
    with pytest.raises(ValueError, match="needs a form without test functions; this one is linear"):
        assemble_scalar(v * ufl.dx)
    volume = 1.0 * ufl.dx(domain=mesh)
    assert assemble_scalar(volume) == pytest.approx(
        fem.assemble_scalar(fem.form(volume)), rel=1e-13
    )

"""Direct solvers: what they report, when old factors serve, and whose options pass."""

import gc

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from dolfinx.mesh import create_unit_square

from pw_elements import (
    Body,
    Direct,
    Material,
    Reduction,
    SingularSystem,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
    vibration_modes,
)
from pw_elements.algebra import factorise, symmetric_part
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from study.matrices import dense
from tests.contact.cases import Block, at

N = 200


def matrix_of(dense):
    matrix = PETSc.Mat().createAIJ(dense.shape, comm=MPI.COMM_SELF)
    matrix.setUp()
    n = len(dense)
    matrix.setValues(range(n), range(n), dense)
    matrix.assemble()
    return matrix


def vector_of(values):
    vector = PETSc.Vec().createSeq(len(values))
    vector.setArray(values)
    return vector


@pytest.fixture
def dense():
    rng = np.random.default_rng(5)
    return rng.normal(size=(N, N)) + 20 * np.eye(N)


def test_one_factorisation_serves_after_small_changes(dense):
    matrix, right = matrix_of(dense), np.arange(float(N))
    factors = Direct().prepare(matrix)
    assert factors.report.factorisations == 0
    x = factors.solve(vector_of(right))
    assert dense @ x.array_r == pytest.approx(right, abs=1e-11)
    dense[7] = -dense[7]
    dense[8, 3] += 5.0
    matrix.setValues([7, 8], range(N), dense[[7, 8]])
    matrix.assemble()
    corrected = factors.solve_changed(vector_of(right), rows=2)
    assert dense @ corrected.array_r == pytest.approx(right, abs=1e-10)
    assert factors.report.factorisations == 1
    assert 0 < factors.report.krylov_iterations <= 3
    assert factors.orientations == (int(np.sign(np.linalg.det(matrix_before(dense)))),)
    assert factors.solve_changed(vector_of(right), rows=10**6) is None
    anew = factors.solve(vector_of(right))
    assert dense @ anew.array_r == pytest.approx(right, abs=1e-11)
    assert factors.report.factorisations == 2
    assert set(factors.orientations) == {-1, 1}  # a row has changed its sign


def matrix_before(dense):
    before = dense.copy()
    before[7] = -before[7]
    before[8, 3] -= 5.0
    return before


def test_more_changes_than_said_are_not_passed_off_as_a_solution(dense):
    matrix = matrix_of(dense)
    factors = Direct().prepare(matrix)
    factors.solve(vector_of(np.ones(N)))
    other = np.random.default_rng(6).normal(size=(N, N)) + 20 * np.eye(N)
    matrix.setValues(range(N), range(N), other)
    matrix.assemble()
    assert factors.solve_changed(vector_of(np.ones(N)), rows=1) is None


@pytest.mark.parametrize("package", ["mumps", "superlu_dist", "petsc"])
def test_singular_matrices_are_refused_by_any_package(package):
    dense = np.diag(np.arange(30.0))
    options = {"pc_factor_mat_solver_type": package}
    prepared = Direct(options).prepare(matrix_of(dense))
    with pytest.raises((SingularSystem, PETSc.Error)):
        prepared.set_up()


@pytest.fixture(scope="module")
def beam():
    mesh = triangles(MPI.COMM_SELF, (0.0, -0.5), (8.0, 0.5), (16, 4))
    body = Body(Spaces.petrov_galerkin(mesh), Material(2.0, 0.3), StressState.PLANE_STRESS)
    U = body.spaces.trial
    K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
    f = assemble_vector(body.surface_load((-1.0, 0.0), boundary_measure(mesh, at(0, 8.0))))
    held = Reduction.dirichlet(U, [prescribe(U, i, at(0, 0.0)) for i in (0, 1)])
    return body, K, M, f, held


PACKAGES = [
    None,
    Direct(),
    Direct({"pc_factor_mat_solver_type": "superlu_dist"}),
    Direct({"mat_mumps_icntl_7": 0}),  # minimum degree
]


def method(solver):
    package = (solver or Direct()).options.get("pc_factor_mat_solver_type", "mumps")
    return f"LU by {package}"


@pytest.mark.parametrize("solver", PACKAGES)
def test_every_computation_takes_a_solver_and_says_what_ran(beam, solver):
    _, K, M, f, held = beam
    a, reference = solve(K, f, held, solver=solver), solve(K, f, held)
    assert (a - reference).norm() < 1e-10 * reference.norm()
    report = a.getAttr("report")
    assert (report.method, report.factorisations) == (method(solver), 1)
    modes = vibration_modes(K, M, held, 3, solver=solver)
    assert modes.eigenvalues == pytest.approx(vibration_modes(K, M, held, 3).eigenvalues, rel=1e-9)
    assert modes.report.method == method(solver)
    assert modes.report.factorisations in (1, 2)  # slender bodies take a second shift


def test_a_symmetric_pair_wants_its_pivots_counted(beam):
    _, K, M, _, held = beam
    with pytest.raises(ValueError, match="does not count negative pivots"):
        vibration_modes(
            K, M, held, 1, symmetrised=True, solver=Direct({"pc_factor_mat_solver_type": "petsc"})
        )


def test_options_reach_mumps(beam):
    _, K, _, _, held = beam
    prepared = Direct({"mat_mumps_icntl_7": 0, "-mat_mumps_icntl_14": 77}).prepare(held.matrix(K))
    prepared.set_up()
    factor = prepared.ksp.getPC().getFactorMatrix()
    assert (factor.getMumpsIcntl(7), factor.getMumpsIcntl(14)) == (0, 77)
    default = Direct().prepare(held.matrix(K))
    default.set_up()
    assert default.ksp.getPC().getFactorMatrix().getMumpsIcntl(14) != 77


def test_the_count_of_an_eigenvalue_problem_is_of_both_shifts():
    """A slender free-standing bar takes a second shift, and so a second factorisation."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (100.0, 1.0), (100, 1))
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, 0.3), StressState.PLANE_STRESS)
    K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
    U = body.spaces.trial
    clamped = Reduction.dirichlet(U, [prescribe(U, i, at(0, 0.0)) for i in (0, 1)])
    assert vibration_modes(K, M, clamped).report.factorisations == 2
    short = Block(4)
    M = assemble_matrix(short.body.mass())
    held = Reduction.dirichlet(short.space, [prescribe(short.space, i, at(1, 0.0)) for i in (0, 1)])
    assert vibration_modes(short.K, M, held).report.factorisations == 1


def left(x):
    return np.isclose(x[0], 0.0)


def right(x):
    return np.isclose(x[0], 1.0)


@pytest.fixture(params=[Spaces.galerkin, Spaces.petrov_galerkin])
def problem(request):
    """A square pulled to the right: body, K, f."""
    spaces = request.param(create_unit_square(MPI.COMM_SELF, 3, 3))
    body = Body(spaces, Material(7.0, 0.3), StressState.PLANE_STRESS)
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.surface_load((1.0, 0.2), boundary_measure(spaces.mesh, right)))
    return body, K, f


def test_prescribed_values_against_dense_algebra(problem):
    body, K, f = problem
    U = body.spaces.trial
    conditions = [prescribe(U, 0, left), prescribe(U, 1, left), prescribe(U, 0, right, 0.03)]
    a = solve(K, f, Reduction.dirichlet(U, conditions)).array

    A, b = dense(K), f.array.copy()
    for condition in conditions:
        dofs, _ = condition.dof_indices()
        values = np.zeros(len(b))
        condition.set(values)
        A[dofs], b[dofs] = 0, values[dofs]
        A[dofs, dofs] = 1
    assert np.abs(a - np.linalg.solve(A, b)).max() < 1e-12


@pytest.mark.parametrize("components", [(), (0,), (1,)])
def test_missing_supports_end_in_an_error(problem, components):
    # one component held on one side leaves a translation (and a rotation) free
    body, K, f = problem
    U = body.spaces.trial
    supports = Reduction.dirichlet(U, [prescribe(U, i, left) for i in components])
    with pytest.raises(SingularSystem, match="rigid motion"):
        solve(K, f, supports)


def test_a_balanced_load_does_not_hide_a_missing_support():
    # the right-hand side is consistent, so the residual alone would be small
    spaces = Spaces.petrov_galerkin(create_unit_square(MPI.COMM_SELF, 4, 4))
    body = Body(spaces, Material(1.0, 0.3), StressState.PLANE_STRESS)
    K = assemble_matrix(body.stiffness())
    mesh = spaces.mesh
    f = assemble_vector(body.surface_load((1.0, 0.0), boundary_measure(mesh, right)))
    f.axpy(1.0, assemble_vector(body.surface_load((-1.0, 0.0), boundary_measure(mesh, left))))
    with pytest.raises(SingularSystem):
        solve(K, f, Reduction.dirichlet(spaces.trial, []))


def test_bad_conditioning_alone_is_no_singularity():
    # a slender cantilever, stiffness entries over 1e11 and a tip that moves 1e5 times its strain
    from dolfinx.mesh import create_rectangle

    mesh = create_rectangle(MPI.COMM_SELF, [(0, 0), (100, 1)], [200, 1])
    spaces = Spaces.petrov_galerkin(mesh)
    body = Body(spaces, Material(2e11), StressState.PLANE_STRESS)
    K = assemble_matrix(body.stiffness())
    end = boundary_measure(mesh, lambda x: np.isclose(x[0], 100))
    f = assemble_vector(body.surface_load((0.0, -1.0), end))
    U = spaces.trial
    a = solve(K, f, Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)]))
    assert a.array.min() == pytest.approx(-(100**3) / (3 * 2e11 / 12), rel=2e-3)


def test_symmetric_part_and_inertia(problem):
    body, K, _ = problem
    part = dense(symmetric_part(K))
    assert np.abs(part - part.T).max() == 0
    assert np.abs(part - (dense(K) + dense(K).T) / 2).max() < 1e-15
    U = body.spaces.trial
    held = Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)])
    reduced = symmetric_part(held.matrix(K))
    eigenvalues = np.linalg.eigvalsh(dense(reduced))
    assert factorise(reduced, symmetric=True).negative_pivots == (eigenvalues < 0).sum()


def test_matrices_and_vectors_outlive_their_mesh():
    def make():
        spaces = Spaces.petrov_galerkin(create_unit_square(MPI.COMM_SELF, 8, 8))
        body = Body(spaces, Material(1.0), StressState.PLANE_STRESS)
        U = spaces.trial
        held = Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)])
        f = assemble_vector(body.body_load((0.0, -1.0)))
        return assemble_matrix(body.stiffness()), f, held

    systems = [make() for _ in range(5)]
    gc.collect()
    solutions = [solve(*system).norm() for system in systems]
    assert solutions == pytest.approx([solutions[0]] * 5, rel=1e-12)

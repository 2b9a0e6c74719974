"""Linear algebra and direct solvers: dense references, reports, and corrected factors."""

import gc

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from dolfinx.mesh import create_rectangle, create_unit_square

from pw_elements import Direct, SingularSystem, prescribe, solve, vibration_modes
from pw_elements.algebra import factorise, symmetric_part
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, ElasticBody, on_plane
from tests.library.properties import dense_solution, to_dense_array

COMM, MATRIX_SIZE = MPI.COMM_SELF, 200


def make_unit_square_body(method=PETROV_GALERKIN, cells_per_side=3):
    return ElasticBody(
        create_unit_square(COMM, cells_per_side, cells_per_side), method, "plane stress", 7.0
    )


@pytest.fixture(params=[GALERKIN, PETROV_GALERKIN])
def unit_square_body(request):
    return make_unit_square_body(request.param)


def test_displacements_with_prescribed_values_equal_dense_algebra(unit_square_body):
    prescribed = [(0, on_plane(0, 0.0)), (1, on_plane(0, 0.0)), (0, on_plane(0, 1.0), 0.03)]
    f = unit_square_body.traction_load((1.0, 0.2), on_plane(0, 1.0))
    a = solve(unit_square_body.K, f, unit_square_body.make_supports(*prescribed)).array
    conditions = [prescribe(unit_square_body.space, *condition) for condition in prescribed]
    assert np.abs(a - dense_solution(unit_square_body.K, f, conditions)).max() < 1e-12


@pytest.mark.parametrize("components", [(), (0,), (1,)])
def test_missing_supports_raise_singular_system(unit_square_body, components):
    """Missing supports are detected even for balanced loads, which make the residual small."""
    supports = unit_square_body.make_supports(*((i, on_plane(0, 0.0)) for i in components))
    pull = unit_square_body.traction_load((1.0, 0.0), on_plane(0, 1.0))
    for f in (pull, pull + unit_square_body.traction_load((-1.0, 0.0), on_plane(0, 0.0))):
        with pytest.raises(SingularSystem, match="rigid motion"):
            solve(unit_square_body.K, f, supports)


def test_bad_conditioning_alone_is_no_singularity():
    """A badly conditioned matrix is not mistaken for a singular one.

    In the matrix of a slender cantilever, entries differ by a factor of 1e11. The tip moves by 1e5
    times the strain.
    """
    beam = ElasticBody(
        create_rectangle(COMM, [(0, 0), (100, 1)], [200, 1]),
        PETROV_GALERKIN,
        "plane stress",
        2e11,
        0,
    )
    a = solve(
        beam.K,
        beam.traction_load((0.0, -1.0), on_plane(0, 100.0)),
        beam.make_clamping_supports(on_plane(0, 0.0)),
    )
    assert a.array.min() == pytest.approx(-(100**3) / (3 * 2e11 / 12), rel=2e-3)


def test_symmetric_part_and_its_negative_pivots_are_exact(unit_square_body):
    part, K = to_dense_array(symmetric_part(unit_square_body.K)), to_dense_array(unit_square_body.K)
    assert np.abs(part - part.T).max() == 0
    assert np.abs(part - (K + K.T) / 2).max() < 1e-15
    reduced = symmetric_part(
        unit_square_body.make_clamping_supports(on_plane(0, 0.0)).matrix(unit_square_body.K)
    )
    eigenvalues = np.linalg.eigvalsh(to_dense_array(reduced))
    assert factorise(reduced, symmetric=True).negative_pivots == (eigenvalues < 0).sum()


def test_matrices_and_vectors_outlive_their_mesh():
    def assemble_system():
        square = make_unit_square_body(cells_per_side=8)
        return (
            square.K,
            square.body_force_load((0.0, -1.0)),
            square.make_clamping_supports(on_plane(0, 0.0)),
        )

    systems = [assemble_system() for _ in range(5)]
    gc.collect()
    solutions = [solve(*system).norm() for system in systems]
    assert solutions == pytest.approx([solutions[0]] * 5, rel=1e-12)


# -- factors ---------------------------------------------------------------------------------------


def make_petsc_matrix(dense):
    matrix = PETSc.Mat().createAIJ(dense.shape, comm=COMM)
    matrix.setUp()
    return change_rows(matrix, range(len(dense)), dense)


def change_rows(matrix, rows, values):
    matrix.setValues(rows, range(matrix.getSize()[1]), values)
    matrix.assemble()
    return matrix


def random_matrix(seed=5):
    return np.random.default_rng(seed).normal(size=(MATRIX_SIZE, MATRIX_SIZE)) + 20 * np.eye(
        MATRIX_SIZE
    )


def test_one_factorisation_serves_after_small_changes():
    A, right = random_matrix(), PETSc.Vec().createSeq(MATRIX_SIZE)
    right.setArray(np.arange(float(MATRIX_SIZE)))
    matrix, sign = make_petsc_matrix(A), int(np.sign(np.linalg.det(A)))
    factors = Direct().prepare(matrix)
    assert factors.report.factorisations == 0
    assert A @ factors.solve(right).array_r == pytest.approx(right.array_r, abs=1e-11)
    A[7] = -A[7]
    A[8, 3] += 5.0
    change_rows(matrix, [7, 8], A[[7, 8]])
    corrected = factors.solve_with_changed_rows(right, np.array([7, 8]))
    assert A @ corrected.array_r == pytest.approx(right.array_r, abs=1e-10)
    assert factors.report.factorisations == 1
    assert 0 < factors.report.krylov_iterations <= 3
    assert factors.determinant_signs == (sign, int(np.sign(np.linalg.det(A)))) == (1, -1)
    assert factors.solve_with_changed_rows(right, np.arange(MATRIX_SIZE)) is None
    assert A @ factors.solve(right).array_r == pytest.approx(right.array_r, abs=1e-11)
    assert factors.report.factorisations == 2
    assert set(factors.determinant_signs) == {-1, 1}  # a row has changed its sign


def test_unannounced_row_changes_are_noticed():
    matrix, right = make_petsc_matrix(random_matrix()), PETSc.Vec().createSeq(MATRIX_SIZE)
    right.set(1.0)
    factors = Direct().prepare(matrix)
    factors.solve(right)
    change_rows(matrix, range(MATRIX_SIZE), random_matrix(6))
    assert factors.solve_with_changed_rows(right, np.array([7])) is None


@pytest.mark.parametrize("package", ["mumps", "superlu_dist", "petsc"])
def test_singular_matrices_are_refused_by_any_package(package):
    options = {"pc_factor_mat_solver_type": package}
    prepared = Direct(options).prepare(make_petsc_matrix(np.diag(np.arange(30.0))))
    with pytest.raises((SingularSystem, PETSc.Error)):
        prepared.set_up()


def test_factors_recover_from_a_matrix_with_nan():
    matrix, right = make_petsc_matrix(random_matrix(5)), PETSc.Vec().createSeq(MATRIX_SIZE)
    right.set(1.0)
    factors = Direct().prepare(matrix)
    expected = factors.solve(right).array_r.copy()
    good = matrix.copy()
    matrix.scale(np.nan)
    with pytest.raises(SingularSystem):
        factors.solve(right)
    good.copy(matrix)
    assert np.abs(factors.solve(right).array_r - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.fixture(scope="module")
def clamped_beam():
    mesh = triangles(COMM, (0.0, -0.5), (8.0, 0.5), (16, 4))
    beam = ElasticBody(mesh, PETROV_GALERKIN, "plane stress", 2.0)
    beam.foot = beam.make_clamping_supports(on_plane(0, 0.0))
    return beam


@pytest.mark.parametrize(
    ("solver", "package"),
    [
        (None, "mumps"),
        (Direct(), "mumps"),
        (Direct({"pc_factor_mat_solver_type": "superlu_dist"}), "superlu_dist"),
        (Direct({"mat_mumps_icntl_7": 0}), "mumps"),  # ordering by minimum degree
    ],
)
def test_statics_and_vibration_use_and_report_the_given_solver(clamped_beam, solver, package):
    f = clamped_beam.traction_load((-1.0, 0.0), on_plane(0, 8.0))
    a, reference = (
        solve(clamped_beam.K, f, clamped_beam.foot, solver=solver),
        solve(clamped_beam.K, f, clamped_beam.foot),
    )
    assert (a - reference).norm() < 1e-10 * reference.norm()
    report = a.getAttr("report")
    assert (report.method, report.factorisations) == (f"LU by {package}", 1)
    modes, expected_modes = (
        vibration_modes(clamped_beam.K, clamped_beam.M, clamped_beam.foot, 3, solver=s)
        for s in (solver, None)
    )
    assert modes.eigenvalues == pytest.approx(expected_modes.eigenvalues, rel=1e-9)
    assert modes.report.method == f"LU by {package}"
    assert modes.report.factorisations == 1  # slender bodies need a second shift


def test_symmetrised_modes_refuse_packages_without_pivot_counts(clamped_beam):
    solver = Direct({"pc_factor_mat_solver_type": "petsc"})
    with pytest.raises(ValueError, match="does not count negative pivots"):
        vibration_modes(
            clamped_beam.K, clamped_beam.M, clamped_beam.foot, 1, symmetrised=True, solver=solver
        )


def test_options_reach_mumps(clamped_beam):
    def read_mumps_parameters(options, *numbers):
        prepared = Direct(options).prepare(clamped_beam.foot.matrix(clamped_beam.K))
        prepared.set_up()
        factor = prepared.ksp.getPC().getFactorMatrix()
        return [factor.getMumpsIcntl(n) for n in numbers]

    options_dict = {"mat_mumps_icntl_7": 0, "-mat_mumps_icntl_14": 77}
    assert read_mumps_parameters(options_dict, 7, 14) == [0, 77]
    assert read_mumps_parameters({}, 14) != [77]

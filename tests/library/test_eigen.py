"""Buckling and vibration: exact and dense eigenvalues, rigid modes, lumped mass, and refusals."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    TooFewModes,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    buckling,
    lumped_mass,
    prescribe,
    solve,
    vibration_modes,
)
from pw_elements.algebra import symmetric_part
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from study.meshes.distortion import distort_unit_domain_smoothly
from study.model.discretisation import discretise, reduction_for_mass_condensation
from study.model.elements import serendipity_spaces
from study.model.matrices import to_dense_array
from study.paper.s7_6_exact import CompressedStrip
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, ElasticBody, on_plane

COMM, STRIP_LENGTH, E = MPI.COMM_SELF, 4.0, 3.0
STANDARD_AND_NEW_SPACE_MAKERS = [GALERKIN, PETROV_GALERKIN]


def assemble_strip_under_axial_stress(method, stress=-1.0, divisions=(16, 4)):
    """Return stiffness, initial stress matrix and supports of a strip under uniform axial stress.

    The strip is simply supported.
    """
    mesh = create_rectangle(COMM, [(0.0, -0.5), (STRIP_LENGTH, 0.5)], list(divisions))
    body = ElasticBody(mesh, method, "plane stress", E, 0.2)
    centre = (0, lambda x: np.isclose(x[0], 0.0) & np.isclose(x[1], 0.0))
    S = fem.Constant(mesh, np.array([[stress, 0.0], [0.0, 0.0]]))
    supports = body.make_supports((1, on_plane(0, 0.0)), (1, on_plane(0, STRIP_LENGTH)), centre)
    return body.K, assemble_matrix(body.body.geometric_stiffness(S)), supports


@pytest.mark.parametrize("method", STANDARD_AND_NEW_SPACE_MAKERS)
def test_first_three_buckling_factors_of_a_strip_are_exact(method):
    modes = buckling(*assemble_strip_under_axial_stress(method), count=3)
    exact = [CompressedStrip(E, 0.2, STRIP_LENGTH).exact_critical_stress(n, "G") for n in (1, 2, 3)]
    assert modes.factors == pytest.approx(exact, rel=2e-3)
    assert np.all(modes.factors > exact[0] * (1 - 1e-9))
    assert modes.imaginary_ratio == 0
    assert modes.residuals.max() < 1e-9
    for shape in modes.shapes:
        assert shape.norm(3) == pytest.approx(1.0)  # the largest entry is one


def test_buckling_factors_equal_dense_eigenvalues():
    K, K_sigma, supports = assemble_strip_under_axial_stress(PETROV_GALERKIN, divisions=(6, 2))
    A, B = (to_dense_array(supports.matrix(matrix)) for matrix in (K_sigma, K))
    for symmetrised in (False, True):
        if symmetrised:
            A, B = (A + A.T) / 2, (B + B.T) / 2
        mu = np.linalg.eigvals(np.linalg.solve(B, -A))
        real = np.sort(mu[np.abs(mu.imag) < 1e-10 * np.abs(mu)].real)[::-1]
        modes = buckling(K, K_sigma, supports, count=4, symmetrised=symmetrised)
        assert modes.factors == pytest.approx(1 / real[:4], rel=1e-9)


def test_buckling_under_tension_is_refused():
    with pytest.raises(TooFewModes, match="pulls"):
        buckling(*assemble_strip_under_axial_stress(GALERKIN, stress=1.0))


def assemble_clamped_column(stress, E=1.0, width=1.0, form="G", hybrid=False):
    """Return stiffness, initial stress matrix and supports of a column that is loaded at its top.

    The column has the height 1 and is clamped at its base. The load is a vertical traction.
    """
    mesh = quadrilaterals(COMM, (0.0, 0.0), (width, 1.0), (4, 8))
    spaces = Spaces.hybrid(mesh) if hybrid else Spaces.petrov_galerkin(mesh)
    body = Body(spaces, Material(E, 0.3), "plane strain")
    K = assemble_matrix(body.stiffness())
    load = body.surface_load((0.0, stress), boundary_measure(mesh, on_plane(1, 1.0)))
    supports = [prescribe(spaces.trial, k, on_plane(1, 0.0)) for k in (0, 1)]
    supports = Reduction.dirichlet(spaces.trial, supports)
    prestress = body.stress(as_function(spaces.trial, solve(K, assemble_vector(load), supports)))
    return K, assemble_matrix(body.geometric_stiffness(prestress, form)), supports


@pytest.mark.parametrize("E", [1.0, 2e11])
@pytest.mark.parametrize("form", ["G", "J"])
@pytest.mark.parametrize("hybrid", [False, True])
def test_a_clamped_column_does_not_buckle_under_tension(E, form, hybrid):
    with pytest.raises(TooFewModes, match=r"prestress is .* times the stiffness.*reverse it"):
        buckling(*assemble_clamped_column(1.0, E, 0.5, form, hybrid))
    modes = buckling(*assemble_clamped_column(-1.0, E, 0.5, form, hybrid), count=2)
    # the first ratio is near the strain at buckling, sigma (1 - nu^2) / E
    assert 0.3 < modes.prestress_ratios[0] / (modes.factors[0] * 0.91 / E) < 1.5
    assert (modes.prestress_ratios < 0.4).all()


def test_prestress_ratio_is_that_of_the_part_that_buckles():
    """The prestress ratio is that of the part of the body that buckles.

    A soft column is loaded in tension. A separate unloaded column, which is a million times as
    stiff, must not hide its large prestress ratio.
    """
    K, K_sigma, supports = assemble_clamped_column(1.0)
    stiff = assemble_clamped_column(0.0, 1e6)[0]
    pair = [
        PETSc.Mat().createNest([[A, None], [None, B]]) for A, B in ((K, stiff), (K_sigma, 0 * K))
    ]
    K, K_sigma = (matrix.convert("aij") for matrix in pair)
    offset = K.createVecRight()
    pairs = [
        PETSc.Mat().createNest([[A, None], [None, A]]).convert("aij") for A in (supports.left,)
    ]
    doubled = Reduction(pairs[0], pairs[0], offset)
    with pytest.raises(TooFewModes, match="times the stiffness"):
        buckling(K, K_sigma, doubled)


def make_distorted_square(cells_per_side=6):
    return move_nodes(
        triangles(COMM, (0.0, 0.0), (1.0, 1.0), (cells_per_side, cells_per_side)),
        distort_unit_domain_smoothly,
    )


def make_tetrahedral_box():
    return create_box(COMM, [(0, 0, 0), (1, 2, 1)], [2, 3, 2], CellType.tetrahedron)


FREE_BODY_SETTINGS = {
    "2-D": (make_distorted_square, "plane stress", 3),
    "2-D curved": (
        lambda: curved_mesh(make_distorted_square(4), distort_unit_domain_smoothly),
        "plane strain",
        3,
    ),
    "slender": (lambda: triangles(COMM, (0.0, 0.0), (100.0, 1.0), (100, 1)), "plane stress", 3),
    "axisymmetric": (make_distorted_square, "axisymmetric", 1),
    "3-D": (make_tetrahedral_box, "solid", 6),
}


def make_free_steel_body(setting, method=PETROV_GALERKIN):
    """Return a free steel body and the number of its rigid modes."""
    make_mesh, state, rigid = FREE_BODY_SETTINGS[setting]
    material = Material(2.1e11, 0.3, density=7856.0)
    return ElasticBody(make_mesh(), method, state, material=material), rigid


@pytest.mark.parametrize("symmetrised", [False, True])
@pytest.mark.parametrize("method", STANDARD_AND_NEW_SPACE_MAKERS)
@pytest.mark.parametrize("setting", FREE_BODY_SETTINGS)
def test_free_bodies_have_the_exact_number_of_rigid_modes(setting, method, symmetrised):
    body, rigid = make_free_steel_body(setting, method)
    modes = vibration_modes(body.K, body.M, body.make_supports(), 9, symmetrised)
    assert modes.imaginary_ratio == 0
    if setting == "2-D curved" and symmetrised and method == PETROV_GALERKIN:
        # a rotation is not in the test space on curved cells, so K^T converts it into forces
        assert modes.n_rigid == 2
        assert -1e-3 * modes.eigenvalues[3] < modes.eigenvalues[0] < 0
        return
    assert modes.n_rigid == rigid
    elastic = modes.eigenvalues[rigid:]
    assert np.abs(modes.eigenvalues[:rigid]).max() < 1e-6 * elastic[0]
    assert np.all(np.diff(elastic) >= 0)
    assert modes.residuals.max() < 1e-7
    K = symmetric_part(body.K) if symmetrised else body.K
    for shape in modes.shapes[:rigid]:
        assert (K * shape).norm(3) < 1e-8 * K.norm(3)


@pytest.mark.parametrize("element", ["pw-Q8", "pw-Q9"])
def test_guyan_reduction_with_either_left_matrix_equals_dense_eigenvalues(element):
    def make_distorted_mesh(cell):
        make = quadrilaterals if cell == "quadrilateral" else triangles
        return move_nodes(make(COMM, (0.0, 0.0), (1.0, 1.0), (3, 3)), distort_unit_domain_smoothly)

    body = discretise(element, make_distorted_mesh, Material(2.0, 0.3), StressState.PLANE_STRESS)
    K, M, eigenvalues = body.K, assemble_matrix(body.body.mass()), {}
    conditions = [prescribe(body.space, i, on_plane(0, 0.0)) for i in (0, 1)]
    condensed = body.supports(conditions)
    full_eigenvalues = vibration_modes(
        K, M, Reduction.dirichlet(body.space, conditions), 4
    ).eigenvalues
    for name in ("transposed", "same"):
        reduction = reduction_for_mass_condensation(condensed, name)
        modes = vibration_modes(K, M, reduction, 4)
        L, R = to_dense_array(reduction.left), to_dense_array(reduction.right)
        A, B = (L.T @ to_dense_array(matrix) @ R for matrix in (K, M))
        exact = np.sort(np.linalg.eigvals(np.linalg.solve(B, A)).real)[:4]
        assert modes.eigenvalues == pytest.approx(exact, rel=1e-9)
        assert modes.imaginary_ratio == 0
        assert 1e-6 < np.abs(modes.eigenvalues / full_eigenvalues - 1).max() < 0.05
        eigenvalues[name] = modes.eigenvalues
        # the reduction preserves translations, which therefore have the mass of the body
        reduced = reduction_for_mass_condensation(body.supports([]), name)
        shift = np.tile([1.0, 0.0], reduced.right.getSize()[1] // 2)
        mass = shift @ to_dense_array(reduced.matrix(M)) @ shift
        assert mass == pytest.approx(to_dense_array(M)[::2, ::2].sum(), rel=1e-12)
    assert np.abs(eigenvalues["same"] / eigenvalues["transposed"] - 1).max() > 1e-6


@pytest.mark.parametrize("method", STANDARD_AND_NEW_SPACE_MAKERS)
def test_no_rigid_mode_is_missed_however_few_modes_are_asked_for(method):
    body, rigid = make_free_steel_body("slender", method)
    n_rigid = [
        vibration_modes(body.K, body.M, body.make_supports(), n).n_rigid for n in range(1, 9)
    ]
    assert n_rigid == [min(count, rigid) for count in range(1, 9)]


def test_slender_cantilever_is_not_taken_for_free():
    n = 500
    bar = ElasticBody(
        triangles(COMM, (0.0, 0.0), (n, 1.0), (n, 1)), PETROV_GALERKIN, "plane stress", 1.0, 0.0
    )
    modes = vibration_modes(bar.K, bar.M, bar.make_clamping_supports(on_plane(0, 0.0)), 2)
    assert modes.n_rigid == 0
    assert modes.report.factorisations == 2  # the second one is for the second shift
    assert modes.eigenvalues[0] == pytest.approx(1.8751040687**4 / 12 / n**4, rel=2e-3)
    assert vibration_modes(bar.K, bar.M, bar.make_supports(), 4).n_rigid == 3


def test_square_column_has_eulers_double_buckling_factor():
    mesh = create_box(COMM, [(-0.5, -0.5, 0), (0.5, 0.5, 8)], (2, 2, 12), CellType.hexahedron)
    column = ElasticBody(mesh, PETROV_GALERKIN, "solid", 1.0, 0.0)
    S = ufl.as_matrix(((0, 0, 0), (0, 0, 0), (0, 0, -1.0)))
    K_sigma = assemble_matrix(column.body.geometric_stiffness(S))
    lowest, second, third = buckling(
        column.K, K_sigma, column.make_clamping_supports(on_plane(2, 0.0)), 3
    ).factors
    assert second == pytest.approx(lowest, rel=1e-9)
    assert lowest == pytest.approx(np.pi**2 / (4 * 8**2) / 12, rel=0.02)  # Euler; shear lowers it
    assert third > 8 * lowest


@pytest.mark.parametrize("setting", FREE_BODY_SETTINGS)
def test_lumped_mass_of_the_new_element_is_positive_and_keeps_the_total(setting):
    body, rigid = make_free_steel_body(setting)
    lumped = lumped_mass(body.M, body.space)
    diagonal = lumped.getDiagonal()
    assert np.count_nonzero(to_dense_array(lumped)) == lumped.getSize()[0]
    assert diagonal.min()[1] > 0
    assert diagonal.sum() == pytest.approx(to_dense_array(body.M).sum(), rel=1e-12)
    modes, consistent = (
        vibration_modes(body.K, mass, body.make_supports(), rigid + 1) for mass in (lumped, body.M)
    )
    assert modes.n_rigid == rigid
    assert modes.eigenvalues[rigid] == pytest.approx(consistent.eigenvalues[rigid], rel=0.2)


def test_lumped_mass_of_standard_elements_is_refused():
    """The lumped mass of standard elements is refused, because it is not positive at vertices.

    There, it is zero on triangles and negative on 8-node quadrilaterals.
    """
    T6 = triangles(COMM, (0.0, 0.0), (1.0, 1.0), (1, 1))
    Q8 = quadrilaterals(COMM, (0.0, 0.0), (1.0, 1.0), (2, 1))
    for count, mesh, method, state in (
        (4, T6, GALERKIN, "plane stress"),
        (6, Q8, serendipity_spaces, "plane stress"),
        (36, make_tetrahedral_box(), GALERKIN, "solid"),
    ):
        body, three = ElasticBody(mesh, method, state), r"(.*\(.*, .*, .*\)){3}"
        with pytest.raises(ValueError, match=f"^{count} nodes have no positive lumped mass{three}"):
            lumped_mass(body.M, body.space)


def test_an_indefinite_symmetrised_body_is_refused():
    mesh = triangles(COMM, (0.0, -0.5), (4.0, 0.5), (2, 4), "crossed")
    body = ElasticBody(mesh, PETROV_GALERKIN, "plane stress")
    assert vibration_modes(body.K, body.M, body.make_supports(), 4).n_rigid == 3
    with pytest.raises(TooFewModes, match="not positive definite"):
        vibration_modes(body.K, body.M, body.make_supports(), 4, symmetrised=True)

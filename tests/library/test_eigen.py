from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle

from pw_elements import (
    Body,
    Material,
    NoModes,
    Reduction,
    SingularSystem,
    Spaces,
    assemble_matrix,
    buckling,
    lumped_mass,
    prescribe,
    vibration_modes,
)
from pw_elements.algebra import symmetric_part
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved, mapped, quadrilaterals, triangles
from study.discretisation import discretise
from study.matrices import dense
from study.paper.s7_6_exact import Strip
from study.verification.t_identity import distorted

LENGTH, E = 4.0, 3.0


def left(x):
    return np.isclose(x[0], 0.0)


def right(x):
    return np.isclose(x[0], LENGTH)


def centre(x):
    return left(x) & np.isclose(x[1], 0.0)


def strip(method, stress=-1.0, divisions=(16, 4), held=True):
    """Simply supported strip under a given uniform axial stress: K, K_sigma, supports."""
    mesh = create_rectangle(MPI.COMM_SELF, [(0.0, -0.5), (LENGTH, 0.5)], list(divisions))
    body = Body(method(mesh), Material(E, 0.2), StressState.PLANE_STRESS)
    U = body.spaces.trial
    conditions = [prescribe(U, 1, left), prescribe(U, 1, right)]
    if held:
        conditions.append(prescribe(U, 0, centre))
    S = fem.Constant(mesh, np.array([[stress, 0.0], [0.0, 0.0]]))
    K, K_sigma = (assemble_matrix(form) for form in (body.stiffness(), body.initial_stress(S)))
    return K, K_sigma, Reduction.dirichlet(U, conditions)


@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
def test_first_three_modes_of_a_strip(method):
    modes = buckling(*strip(method), count=3)
    exact = [Strip(E, 0.2, LENGTH).elasticity(n, "G") for n in (1, 2, 3)]
    assert modes.factors == pytest.approx(exact, rel=2e-3)
    assert np.all(modes.factors > exact[0] * (1 - 1e-9))
    assert modes.imaginary == 0
    assert modes.residuals.max() < 1e-9
    for shape in modes.shapes:
        assert shape.norm(3) == pytest.approx(1.0)  # largest entry


def test_against_dense_eigenvalues():
    K, K_sigma, supports = strip(Spaces.petrov_galerkin, divisions=(6, 2))
    A, B = (dense(supports.matrix(matrix)) for matrix in (K_sigma, K))
    mu = np.linalg.eigvals(np.linalg.solve(B, -A))
    real = np.sort(mu[np.abs(mu.imag) < 1e-10 * np.abs(mu)].real)[::-1]
    modes = buckling(K, K_sigma, supports, count=4)
    assert modes.factors == pytest.approx(1 / real[:4], rel=1e-9)
    As, Bs = (A + A.T) / 2, (B + B.T) / 2
    symmetric = np.sort(np.linalg.eigvals(np.linalg.solve(Bs, -As)).real)[::-1]
    modes = buckling(K, K_sigma, supports, count=4, symmetrised=True)
    assert modes.factors == pytest.approx(1 / symmetric[:4], rel=1e-9)


def test_refuses_what_cannot_buckle():
    with pytest.raises(NoModes, match="pulls"):
        buckling(*strip(Spaces.galerkin, stress=1.0))
    with pytest.raises(NoModes, match="no prestress"):
        buckling(*strip(Spaces.galerkin, stress=0.0))
    with pytest.raises(SingularSystem):
        buckling(*strip(Spaces.galerkin, held=False))


METHODS = [Spaces.galerkin, Spaces.petrov_galerkin]
STEEL = Material(2.1e11, 0.3, density=7856.0)


def pair(method, mesh, state, material=STEEL):
    """K, M and the space of a free body."""
    body = Body(method(mesh), material, state)
    return (
        assemble_matrix(body.stiffness()),
        assemble_matrix(body.mass()),
        body.spaces.trial,
    )


def square(n=6):
    return mapped(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (n, n)), distorted)


def box():
    return create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 2, 1)], [2, 3, 2], CellType.tetrahedron)


BODIES = {
    "2-D": (square, StressState.PLANE_STRESS, 3),
    "2-D curved": (lambda: curved(square(4), distorted), StressState.PLANE_STRAIN, 3),
    "slender": (
        lambda: triangles(MPI.COMM_SELF, (0.0, 0.0), (100.0, 1.0), (100, 1)),
        StressState.PLANE_STRESS,
        3,
    ),
    "axisymmetric": (square, StressState.AXISYMMETRIC, 1),
    "3-D": (box, StressState.SOLID, 6),
}


@pytest.mark.parametrize("symmetrised", [False, True])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("setting", BODIES)
def test_rigid_modes_of_a_free_body(setting, method, symmetrised):
    make_mesh, state, rigid = BODIES[setting]
    K, M, U = pair(method, make_mesh(), state)
    modes = vibration_modes(K, M, Reduction.dirichlet(U, []), 9, symmetrised)
    assert modes.imaginary == 0
    if setting == "2-D curved" and symmetrised and method == Spaces.petrov_galerkin:
        # a rotation is no test function there, so K^T gives it forces
        assert modes.rigid == 2
        assert -1e-3 * modes.eigenvalues[3] < modes.eigenvalues[0] < 0
        return
    assert modes.rigid == rigid
    elastic = modes.eigenvalues[rigid:]
    assert np.abs(modes.eigenvalues[:rigid]).max() < 1e-6 * elastic[0]
    assert np.all(np.diff(elastic) >= 0)
    assert modes.residuals.max() < 1e-7
    image = K.createVecLeft()
    for shape in modes.shapes[:rigid]:
        (symmetric_part(K) if symmetrised else K).mult(shape, image)
        assert image.norm(3) < 1e-8 * K.norm(3)


@pytest.mark.parametrize("symmetrised", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_frequencies_against_dense_eigenvalues(method, symmetrised):
    K, M, U = pair(method, square(), StressState.PLANE_STRESS)
    supports = Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)])
    modes = vibration_modes(K, M, supports, 6, symmetrised)
    A, B = (dense(supports.matrix(matrix)) for matrix in (K, M))
    if symmetrised:
        A, B = (A + A.T) / 2, (B + B.T) / 2
    exact = np.linalg.eigvals(np.linalg.solve(B, A))
    exact = np.sort(exact.real)[:6]
    assert modes.rigid == 0
    assert modes.imaginary == 0
    assert modes.eigenvalues == pytest.approx(exact, rel=1e-9)
    nearer = vibration_modes(K, M, supports, 5, symmetrised, shift=0.9 * exact[0])
    assert nearer.eigenvalues == pytest.approx(exact[:5], rel=1e-9)
    for shape in modes.shapes:
        assert shape.norm(3) == pytest.approx(1.0)
        assert np.abs(shape.array[dense(supports.right).sum(axis=1) == 0]).max() == 0


@pytest.mark.parametrize("element", ["pw-Q8", "pw-Q9"])
def test_both_left_matrices_of_guyans_reduction(element):
    def build(cell):
        make = quadrilaterals if cell == "quadrilateral" else triangles
        return mapped(make(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (3, 3)), distorted)

    body = discretise(element, build, Material(2.0, 0.3), StressState.PLANE_STRESS)
    U, K, M = body.space, body.K, assemble_matrix(body.body.mass())
    condensed = body.supports([prescribe(U, i, left) for i in (0, 1)])
    found = {}
    for name in ("transposed", "same"):
        reduction = condensed.guyan(name)
        modes = vibration_modes(K, M, reduction, 4)
        L, R = dense(reduction.left), dense(reduction.right)
        A, B = (L.T @ dense(matrix) @ R for matrix in (K, M))
        exact = np.sort(np.linalg.eigvals(np.linalg.solve(B, A)).real)[:4]
        assert modes.eigenvalues == pytest.approx(exact, rel=1e-9)
        assert modes.imaginary == 0
        found[name] = modes.eigenvalues
    every = vibration_modes(
        K, M, Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)]), 4
    )
    for name in found:
        assert 1e-6 < np.abs(found[name] / every.eigenvalues - 1).max() < 0.05
    assert np.abs(found["same"] / found["transposed"] - 1).max() > 1e-6
    with pytest.raises(ValueError, match="'symmetric': the names are"):
        condensed.guyan("symmetric")


@pytest.mark.parametrize("method", METHODS)
def test_no_rigid_mode_is_missed_however_few_modes_are_asked_for(method):
    make_mesh, state, rigid = BODIES["slender"]
    K, M, U = pair(method, make_mesh(), state)
    free = Reduction.dirichlet(U, [])
    found = [vibration_modes(K, M, free, count).rigid for count in range(1, 9)]
    assert found == [min(count, rigid) for count in range(1, 9)]


@pytest.mark.parametrize("slenderness", [500])
def test_slender_cantilever_is_not_taken_for_free(slenderness):
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (slenderness, 1.0), (slenderness, 1))
    K, M, U = pair(Spaces.petrov_galerkin, mesh, StressState.PLANE_STRESS, Material(1.0))
    clamped = Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)])
    modes = vibration_modes(K, M, clamped, 2)
    assert modes.rigid == 0
    bernoulli = 1.8751040687**4 / 12 / slenderness**4
    assert modes.eigenvalues[0] == pytest.approx(bernoulli, rel=2e-3)
    assert vibration_modes(K, M, Reduction.dirichlet(U, []), 4).rigid == 3


def test_double_buckling_factor_of_a_square_column():
    mesh = create_box(
        MPI.COMM_SELF, [(-0.5, -0.5, 0), (0.5, 0.5, 8)], (2, 2, 12), CellType.hexahedron
    )
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0), StressState.SOLID)
    U = body.spaces.trial
    S = ufl.as_matrix(((0, 0, 0), (0, 0, 0), (0, 0, -1.0)))
    K, K_sigma = (assemble_matrix(form) for form in (body.stiffness(), body.initial_stress(S)))
    foot = Reduction.dirichlet(
        U, [prescribe(U, i, lambda x: np.isclose(x[2], 0)) for i in range(3)]
    )
    first, second, third = buckling(K, K_sigma, foot, 3).factors
    assert second == pytest.approx(first, rel=1e-9)
    assert first == pytest.approx(np.pi**2 / (4 * 8**2) / 12, rel=0.02)  # Euler; shear lowers it
    assert third > 8 * first


@pytest.mark.parametrize("setting", BODIES)
def test_lumped_mass_of_the_new_element(setting):
    make_mesh, state, rigid = BODIES[setting]
    K, M, U = pair(Spaces.petrov_galerkin, make_mesh(), state)
    lumped = lumped_mass(M, U)
    diagonal = lumped.getDiagonal()
    assert np.count_nonzero(dense(lumped)) == lumped.getSize()[0]
    assert diagonal.min()[1] > 0
    assert diagonal.sum() == pytest.approx(dense(M).sum(), rel=1e-12)
    free = Reduction.dirichlet(U, [])
    modes, consistent = (vibration_modes(K, mass, free, rigid + 1) for mass in (lumped, M))
    assert modes.rigid == rigid
    assert modes.eigenvalues[rigid] == pytest.approx(consistent.eigenvalues[rigid], rel=0.2)


def test_lumped_mass_of_standard_elements_is_refused():
    def refused(method, mesh, state):
        _, M, U = pair(method, mesh, state)
        with pytest.raises(ValueError, match="no positive lumped mass") as error:
            lumped_mass(M, U)
        return str(error.value)

    lower, upper = (0.0, 0.0), (1.0, 1.0)
    T6 = triangles(MPI.COMM_SELF, lower, upper, (1, 1))
    message = refused(Spaces.galerkin, T6, StressState.PLANE_STRESS)
    assert message.startswith("4 nodes ")  # the vertices, zeros
    assert message.count(".0, 0.0)") == 3
    Q8 = quadrilaterals(MPI.COMM_SELF, lower, upper, (2, 1))
    assert refused(Spaces.serendipity, Q8, StressState.PLANE_STRESS).startswith(
        "6 nodes "
    )  # negative
    assert refused(Spaces.galerkin, box(), StressState.SOLID).startswith("36 nodes ")


def test_frequencies_refuse_what_has_none():
    K, M, U = pair(Spaces.petrov_galerkin, square(2), StressState.PLANE_STRESS)
    free = Reduction.dirichlet(U, [])
    with pytest.raises(SingularSystem):
        vibration_modes(K, M, free, shift=0.0)
    high = 1e3 * vibration_modes(K, M, free, 4).eigenvalues[3]
    with pytest.raises(NoModes, match="eigenvalues below the shift"):
        vibration_modes(K, M, free, 3, symmetrised=True, shift=high)
    with pytest.raises(NoModes, match="lie above the shift"):
        vibration_modes(K, M, free, M.getSize()[0], shift=high)
    with pytest.raises(ValueError, match="count = 0: has to be a whole number, 1 at least"):
        vibration_modes(K, M, free, 0)
    with pytest.raises(NoModes, match="60 eigenvalues of 50 degrees of freedom"):
        vibration_modes(K, M, free, 60)
    M.scale(0.0)
    with pytest.raises(NoModes, match="zero or not finite"):
        vibration_modes(K, M, free)


def test_says_when_a_symmetrised_body_is_unstable():
    K, M, U = pair(
        Spaces.petrov_galerkin,
        triangles(MPI.COMM_SELF, (0.0, -0.5), (4.0, 0.5), (2, 4), "crossed"),
        StressState.PLANE_STRESS,
    )
    free = Reduction.dirichlet(U, [])
    assert vibration_modes(K, M, free, 4).rigid == 3
    with pytest.raises(NoModes, match="not positive definite"):
        vibration_modes(K, M, free, 4, symmetrised=True)

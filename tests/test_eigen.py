from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import create_rectangle

from pw_elements import (
    Body,
    Material,
    NoBuckling,
    Reduction,
    SingularSystem,
    Spaces,
    State,
    assemble_matrix,
    buckling,
    support,
)
from study.ex76 import HalfBeam, half_beam_body
from study.exact import Strip
from tests.test_algebra import dense

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
    body = Body(method(mesh), Material(E, 0.2), State.PLANE_STRESS)
    U = body.spaces.trial
    conditions = [support(U, 1, left), support(U, 1, right)]
    if held:
        conditions.append(support(U, 0, centre))
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


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_factors_scale_with_the_load(unit):
    reference = buckling(*strip(Spaces.petrov_galerkin)).factors[0]
    scaled = buckling(*strip(Spaces.petrov_galerkin, stress=-unit)).factors[0]
    assert scaled * unit == pytest.approx(reference, rel=1e-9)


def test_refuses_what_cannot_buckle():
    with pytest.raises(NoBuckling, match="pulls"):
        buckling(*strip(Spaces.galerkin, stress=1.0))
    with pytest.raises(NoBuckling, match="no prestress"):
        buckling(*strip(Spaces.galerkin, stress=0.0))
    with pytest.raises(SingularSystem):
        buckling(*strip(Spaces.galerkin, held=False))


def test_says_when_the_symmetrised_stiffness_is_indefinite():
    # four elongated triangles a rectangle: the unsymmetric element has no trouble with them
    body = half_beam_body("pwsym-T6", (2, 4), "crossed")
    for symmetrised in (False, True):
        model = HalfBeam(body, "point", "centre", "centre", symmetrised)
        K = model.stiffness()
        prestress = model.prestress(K, 1)
        if symmetrised:
            with pytest.raises(NoBuckling, match="not positive definite"):
                model.critical_stress(K, prestress, 1, "G")
        else:
            assert model.critical_stress(K, prestress, 1, "G").factors[0] > 0

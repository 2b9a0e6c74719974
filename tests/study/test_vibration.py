"""Section V8: exact eigenvalues by the frequency equation, and the elements against them."""

import numpy as np
import pytest

from pw_elements import Body, Material, Reduction, assemble_matrix, prescribe, vibration_modes
from pw_elements.elasticity import StressState
from study.discretisation import spaces
from study.verification import v8_vibration
from study.verification.v8_exact import Rod, rectangle_eigenvalues, wave_speeds_squared

MATERIAL = Material(1.0, 0.3)


def test_frequency_equation_gives_published_eigenvalues():
    published = [8.32708524, 18.69438659, 21.0458481, 24.33204579, 32.8373545, 41.46258448]
    assert Rod(MATERIAL, 0.5, 1.0).eigenvalues(6) == pytest.approx(published, rel=2e-9)


def test_slow_waves_in_a_thin_rod_are_those_of_a_bar():
    # Rayleigh's correction for lateral inertia: E k^2 / rho (1 - (nu k a)^2 / 2)
    material, radius, length = Material(7.0, 0.3, density=2.0), 0.02, 3.0
    k = np.pi * np.arange(1, 4) / length
    bar = 7.0 / 2.0 * k**2
    exact = np.array(Rod(material, radius, length).eigenvalues(3))
    assert exact == pytest.approx(bar * (1 - (0.3 * k * radius) ** 2 / 2), rel=1e-6)
    assert np.all(exact < bar * (1 - 1e-5))


def test_wave_speeds_of_plane_states():
    solid, shear = wave_speeds_squared(MATERIAL, StressState.PLANE_STRAIN)
    plate, same = wave_speeds_squared(MATERIAL, StressState.PLANE_STRESS)
    assert shear == same == pytest.approx(1 / 2.6)
    assert plate / shear == pytest.approx(2 / (1 - 0.3))
    assert solid / shear == pytest.approx(2 * (1 - 0.3) / (1 - 0.6))


@pytest.mark.parametrize("state", [StressState.PLANE_STRESS, StressState.PLANE_STRAIN])
def test_modes_of_a_rectangle_between_walls(state):
    # unequal sides, so that no two modes share an eigenvalue
    sides = (1.0, 0.7)
    mesh = v8_vibration._mesh(sides, (12, 9), "triangle")
    body = Body(spaces("pw-T6", mesh), MATERIAL, state)
    U = body.spaces.trial
    held = [(i, value) for i in (0, 1) for value in (0.0, sides[i])]
    walls = [prescribe(U, i, lambda x, i=i, v=value: np.isclose(x[i], v)) for i, value in held]
    K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
    modes = vibration_modes(K, M, Reduction.dirichlet(U, walls), 8)
    exact = np.array(rectangle_eigenvalues(MATERIAL, state, sides, 8))
    assert len(set(np.round(exact, 9))) == 8
    assert modes.eigenvalues == pytest.approx(exact, rel=3e-3)
    assert np.all(modes.eigenvalues > exact)


@pytest.mark.parametrize("problem", [v8_vibration.rod, v8_vibration.square, v8_vibration.strip])
def test_orders_of_the_elements(problem):
    squares = (4, 8) if problem is v8_vibration.strip else (8, 16)
    expected = {
        ("galerkin-T6", "transposed"): 4,
        ("pw-T6", "transposed"): 4,
        ("pw-Q9", "all nodes"): 4,
        ("pwsym-T6", "transposed"): 2,
        ("pw-T6", "lumped"): 2,
    }
    if problem is not v8_vibration.strip:  # there the condensed node carries little inertia
        expected |= {("pw-Q8", "transposed"): 2, ("pw-Q8", "same"): 2}
    for (element, treatment), order in expected.items():
        result = problem(element, treatment, squares)
        names = [f"vibration_{n}" for n in (1, 2, 3)]
        if problem is not v8_vibration.strip:
            names = v8_vibration.EIGENVALUES
        found = [result.scalars[f"{name}_order"] for name in names]
        assert np.median(found) == pytest.approx(order, abs=0.45), (element, treatment)
        assert result.scalars["rigid"] == (1 if problem is v8_vibration.strip else 0)


def test_buckling_and_vibration_of_the_strip_share_one_number():
    scalars = v8_vibration.strip("pw-T6", "transposed", (2, 4)).scalars
    for n in (1, 2, 3):
        assert scalars[f"vibration_{n}_exact"] == scalars[f"buckling_{n}_exact"]
        for kind in ("vibration", "buckling"):
            assert 0 < scalars[f"{kind}_{n}_error"] < 6e-4


@pytest.mark.parametrize("element", ["galerkin-T6", "pw-T6"])
def test_axisymmetric_quadrature_is_far_more_exact_than_the_mesh(element):
    # what justifies degree 8, the default of axisymmetric forms
    for squares in (4, 8):
        scalars = v8_vibration.quadrature(element, squares).scalars
        assert scalars["change_8"] < 1e-4 * scalars["error"]
        changes = [scalars[f"change_{degree}"] for degree in (2, 4, 6, 8)]
        assert np.all(np.diff(changes) < 0)


@pytest.mark.parametrize("element", ["galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q9"])
def test_default_degree_of_axisymmetry_is_8(element):
    cell = "triangle" if element.endswith("T6") else "quadrilateral"

    def difference(inner, degree, other):
        mesh = v8_vibration._mesh((0.5, 1.0), (3, 4), cell, inner)
        bodies = [
            Body(spaces(element, mesh), MATERIAL, StressState.AXISYMMETRIC, quadrature_degree=d)
            for d in (degree, other)
        ]
        U = bodies[0].spaces.trial
        held = [prescribe(U, 0, lambda x: np.isclose(x[0], inner))]
        reduction = Reduction.dirichlet(U, held)
        a, b = (reduction.matrix(assemble_matrix(body.stiffness())) for body in bodies)
        return (a - b).norm() / b.norm()

    assert difference(0.2, None, 8) == 0
    assert difference(0.2, 8, 20) < 1e-7
    # entries of cells that touch the axis by one vertex have singular integrands
    assert difference(0.0, 8, 20) < 1e-4


def test_free_bodies_have_their_rigid_modes():
    for state, rigid in (("plane stress", 3), ("axisymmetric", 1), ("solid", 6)):
        element = "pw-T10" if state == "solid" else "pw-T6"
        scalars = v8_vibration.free(element, state).scalars
        assert scalars["rigid"] == rigid
        assert scalars["zero"] < 1e-12


def test_lame():
    scalars = v8_vibration.tube("pw-T6", (8, 16)).scalars
    assert scalars["order"] == pytest.approx(3, abs=0.25)
    assert scalars["error"] < 2e-5
    assert v8_vibration.cylinder("pw-T6").scalars["displacement_error"] < 1e-13

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

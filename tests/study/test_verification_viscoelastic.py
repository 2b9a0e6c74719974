"""Test the viscoelastic law of section V19 by its rate equation, and exact forces of blocks."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import create_unit_square
from scipy.integrate import solve_ivp

from study.benchmarks.v19_memory import viscoelastic
from study.benchmarks.v19_memory.viscoelastic import BRANCH_MODULUS, advance_stresses

ELEMENT = "pw-hybrid-T6"


def shear_gradient(time):
    """Return a deformation gradient (3, 3) that shears, stretches and rotates."""
    angle = 0.7 * time
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return rotation @ np.array([[1 + 0.2 * time, 0.5 * time, 0], [0, 1, 0], [0, 0, 1]])


def slow_stress(F):
    """Return mu times the derivative of tr(C) det(C)^(-1/3) with respect to C."""
    C = F.T @ F
    return np.linalg.det(C) ** (-1 / 3) * (np.eye(3) - np.trace(C) / 3 * np.linalg.inv(C))


def test_the_branch_follows_its_rate_equation_at_second_order():
    """The stress of the branch after many steps solves Q' + Q = g S', at second order."""

    def rate(time, Q):
        change = slow_stress(shear_gradient(time + 1e-6)) - slow_stress(shear_gradient(time - 1e-6))
        return BRANCH_MODULUS * change.ravel() / 2e-6 - Q

    exact = solve_ivp(rate, (0, 1), np.zeros(9), rtol=1e-9, atol=1e-11).y[:, -1].reshape(3, 3)
    mesh = create_unit_square(MPI.COMM_SELF, 1, 1)
    F, branch, slow = (fem.Constant(mesh, np.zeros((3, 3))) for _ in range(3))
    duration = fem.Constant(mesh, 0.0)
    stresses = [
        fem.Expression(stress, np.array([[0.3, 0.3]]))
        for stress in advance_stresses(F, branch, slow, duration)
    ]
    errors = []
    for n in (20, 40):
        duration.value, branch.value[:], slow.value[:] = 1 / n, 0.0, 0.0
        for k in range(1, n + 1):
            F.value[:] = shear_gradient(k / n)
            values = [s.eval(mesh, np.array([0], dtype=np.int32)) for s in stresses]
            branch.value[:], slow.value[:] = (np.reshape(v, (3, 3)) for v in values)
        errors.append(np.abs(branch.value - exact).max() / np.abs(exact).max())
    assert errors[1] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def test_a_suddenly_compressed_block_relaxes_exactly_in_unequal_steps():
    result = viscoelastic.relaxing_block(ELEMENT)
    assert result.scalars["force_error"] < 1e-12
    assert result.curves["force"][0] > 2 * result.curves["force"][-1]


def test_a_ramped_block_converges_to_the_convolution_integral_at_second_order():
    errors = [viscoelastic.ramped_block(ELEMENT, n).scalars["force_error"] for n in (4, 8)]
    assert errors[1] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)

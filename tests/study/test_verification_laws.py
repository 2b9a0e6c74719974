"""Test the exact solutions of section V21 by methods that share no code with them."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from study.benchmarks.v21_laws.joints import (
    BIOT_NUMBER,
    CONDUCTIVITY,
    PRESSURE_SLOPE,
    exact_flux,
)


def flux_by_finite_volumes(n):
    """Return positions (2 n + 1,) and fluxes on a joint, from squares of size 1 / n.

    By symmetry, half the temperature difference of 1 falls over the lower block and half the joint.
    """
    h, x = 1 / n, np.linspace(-1, 1, 2 * n + 1)
    difference = sparse.diags([-1.0, 1.0], [0, 1], (2 * n, 2 * n + 1))
    width = np.full(2 * n + 1, h)
    width[[0, -1]] = h / 2
    height = np.full(n + 1, h)
    height[[0, -1]] = h / 2
    rise = sparse.diags([-1.0, 1.0], [0, 1], (n, n + 1))
    along = sparse.kron(sparse.diags(height), difference.T @ difference / h)
    up = sparse.kron(rise.T @ rise / h, sparse.diags(width))
    conductance = CONDUCTIVITY * BIOT_NUMBER * (1 + PRESSURE_SLOPE * x)
    exchange = np.zeros((n + 1, 2 * n + 1))
    exchange[-1] = conductance * width
    matrix = sparse.csr_matrix(CONDUCTIVITY * (along + up) + sparse.diags(2 * exchange.ravel()))
    is_free = np.arange(matrix.shape[0]) >= 2 * n + 1  # the base has zero temperature
    temperature = spsolve(matrix[is_free][:, is_free], exchange.ravel()[is_free])
    return x, conductance * (1 - 2 * temperature[-2 * n - 1 :])


def test_the_flux_across_a_joint_is_that_of_finite_volumes():
    """The series has the flux of a fine grid at each node, and differences fall at second order."""
    errors = []
    for n in (20, 40, 80):
        x, flux = flux_by_finite_volumes(n)
        errors.append(np.abs(flux - exact_flux(x)).max())
    assert errors[-1] < 2e-4
    assert min(np.log2(errors[0] / errors[1]), np.log2(errors[1] / errors[2])) > 1.7

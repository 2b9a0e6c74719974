"""Section V9: what the lumped mass may be combined with."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import vibration_modes
from pw_elements.meshes import mapped, triangles
from study.verification import v9_explicit
from study.verification.t_identity import distorted


@pytest.mark.parametrize("matrices", ["pwsym-lumped", "galerkin-lumped", "sibling-lumped"])
def test_symmetric_pairs_vibrate_without_end(matrices):
    scalars = v9_explicit.pair(matrices, 4).scalars
    assert scalars["imaginary"] == 0
    assert scalars["smallest_real"] > 0
    assert scalars["growth_per_step"] < 1e-14
    assert scalars["amplification"] < 1.5


def test_unsymmetric_pair_grows():
    scalars = v9_explicit.pair("pw-lumped", 4).scalars
    assert scalars["lumped_smallest"] > 0
    assert scalars["imaginary"] > 1e-3
    assert scalars["growth_per_step"] > 1e-3
    assert scalars["amplification"] > 50


def test_spectrum_begins_with_the_frequencies():
    mesh = mapped(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 4)), distorted)
    K, M, held, _ = v9_explicit.PAIRS["pw-consistent"](mesh)
    spectrum = np.sort(v9_explicit.pair("pw-consistent", 4).curves["real"])
    assert vibration_modes(K, M, held, 4).eigenvalues == pytest.approx(spectrum[:4], rel=1e-9)

"""Section V9: what the lumped mass may be combined with."""

import pytest

from study.verification import explicit


@pytest.mark.parametrize("matrices", ["pwsym-lumped", "galerkin-lumped"])
def test_symmetric_pairs_vibrate_without_end(matrices):
    scalars = explicit.pair(matrices, 4).scalars
    assert scalars["imaginary"] == 0
    assert scalars["smallest_real"] > 0
    assert scalars["growth_per_step"] < 1e-14
    assert scalars["amplification"] < 1.5


def test_unsymmetric_pair_grows():
    scalars = explicit.pair("pw-lumped", 4).scalars
    assert scalars["lumped_smallest"] > 0
    assert scalars["imaginary"] > 1e-3
    assert scalars["growth_per_step"] > 1e-3
    assert scalars["amplification"] > 50


def test_frequencies_are_those_of_the_spectrum():
    curves = explicit.pair("pw-consistent", 4).curves
    lowest = sorted(curves["real"])[0]
    symmetric = explicit.pair("galerkin-lumped", 4).curves
    assert lowest == pytest.approx(min(symmetric["real"]), rel=0.02)  # one body, two masses

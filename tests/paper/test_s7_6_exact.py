import numpy as np
import pytest

from study.paper.s7_6_exact import Strip

BEAM = Strip(2.07e11, 0.0, 8.0)

# Published or computed independently of this code
REFERENCES = {
    "G": (2.549732978e9, 9.099805943e9),
    "J": (2.613156933e9, 9.926530181e9),
    "deflection": (2.580580e9, 9.472353e9),
}


@pytest.mark.parametrize("form", REFERENCES)
def test_reference_roots(form):
    for n, value in enumerate(REFERENCES[form], start=1):
        assert BEAM.elasticity(n, form) == pytest.approx(value, rel=5e-7)


@pytest.mark.parametrize("nu", [0.0, 0.2, 0.45])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_determinant_and_rayleigh_lamb_have_the_same_root(n, nu):
    strip = Strip(3.0, nu, 6.0)
    assert strip.elasticity(n, "G") == pytest.approx(strip.rayleigh_lamb(n), rel=1e-10)


def test_slender_strips_are_euler_beams():
    for theory in (Strip.engesser, Strip.haringx, lambda s, n: s.elasticity(n, "J")):
        errors = [theory(Strip(1.0, 0.0, k), 1) / Strip(1.0, 0.0, k).euler(1) - 1 for k in (20, 40)]
        assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
        assert abs(errors[1]) < 3e-3


def test_shear_stiffness_of_haringx_and_engesser():
    # both solve 1 / s = 1 / euler + something / (kappa G), Haringx with s / euler in it
    rigidity = 5 / 6 * BEAM.shear_modulus
    for n in (1, 2):
        euler = BEAM.euler(n)
        assert 1 / BEAM.engesser(n) == pytest.approx(1 / euler + 1 / rigidity, rel=1e-13)
        s = BEAM.haringx(n)
        assert s * (1 + s / rigidity) == pytest.approx(euler, rel=1e-12)
    assert np.isclose(BEAM.euler(2), 4 * BEAM.euler(1))

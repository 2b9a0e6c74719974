"""Section 7.6: buckling of a simply supported beam (Figs 24 and 25, Table 2, Eq. (27)).

Printed: E = 2.07e11, Poisson's ratio 0, a thickness of 0.1 m, Euler's stresses, and Table 2. The
mesh is lost; the study's 5 x 2 crossed squares stand in for it.
"""

import numpy as np
import pytest

from study.paper.items import TABLE_2
from study.paper.s7_6_exact import Strip
from tests.oracle.eigen import eigenvalues_nearest_to_shift
from tests.oracle.problem import (
    StudyComparison,
    assert_agrees_with_own_weights_alone,
    assert_study_agrees_with_oracle,
    combine_markers_by_and,
    make_oracle_body,
    make_plane_row_marker,
    solve_with_zero_supports,
    symmetric_part,
)

ELEMENTS = ("galerkin-T6", "pw-T6", "pwsym-T6", "galerkin-Q8")
LOADS = {"": False, "-uniform-8x2": True}


def beam(result, element, uniform):
    """Half of the beam, symmetric and antisymmetric, under the load at A or a uniform one."""

    def ours(linear):
        body = make_oracle_body(
            result, element, linear, "plane stress", 2.07e11, 0.0, thickness=0.1
        )
        end, middle = make_plane_row_marker(0, 0.0), make_plane_row_marker(0, 4.0)
        A, centre = (
            combine_markers_by_and(end, make_plane_row_marker(1, 0.0)),
            combine_markers_by_and(middle, make_plane_row_marker(1, 0.0)),
        )
        symmetrised = element.startswith("pwsym")
        K = symmetric_part(body.stiffness()) if symmetrised else body.stiffness()
        found = {}
        for mode in (1, 2):
            held = body.component_mask(end if uniform else A, (1,))
            if mode == 1:
                held |= body.component_mask(middle, (0,))
            else:
                held |= body.component_mask(centre, (0,))
                held |= body.component_mask(middle if uniform else centre, (1,))
            if uniform:
                f = body.traction_load(end, (1.0, 0.0))
                f += body.traction_load(middle, (-1.0, 0.0)) * (mode == 2)
            else:
                f = 0.1 * body.component_mask(A, (0,)).ravel()
            K_sigma = body.geometric_stiffness(solve_with_zero_supports(K, f, held))
            K_sigma = symmetric_part(K_sigma) if symmetrised else K_sigma
            factors = eigenvalues_nearest_to_shift(K, -K_sigma, held, 4).real
            found[f"sigma_cr_{mode}"] = factors[factors > 0].min()
        return found

    return StudyComparison(
        {name: result.scalars[name] for name in ("sigma_cr_1", "sigma_cr_2")}, ours
    )


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("element", ELEMENTS)
def test_oracle_finds_the_numbers_of_the_study(element, load, results):
    problem = beam(results[f"7.6/{element}{load}"], element, LOADS[load])
    (assert_study_agrees_with_oracle if load else assert_agrees_with_own_weights_alone)(
        problem, element
    )
    if load and element == "pw-T6":  # K_PW = T K, and K_sigma alike: no weights make a difference
        assert_study_agrees_with_oracle(problem, "galerkin-T6")


def test_eulers_stress_by_eq_27(results):
    """With L / h = 8, which follows from the printed stresses: I / A = h**2 / 12."""
    for mode in (1, 2):
        stress = mode**2 * np.pi**2 * 2.07e11 / 12 / 8**2
        assert results.scalar("7.6/exact", f"euler_{mode}") == pytest.approx(stress, rel=1e-12)
        assert stress == pytest.approx(TABLE_2["Euler"][mode - 1], rel=2e-4)


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

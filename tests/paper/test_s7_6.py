"""Section 7.6: buckling of a simply supported beam (Figs 24 and 25, Table 2, Eq. (27)).

Printed: E = 2.07e11, Poisson's ratio 0, a thickness of 0.1 m, Euler's stresses, and Table 2. The
mesh is lost; the study's 5 x 2 crossed squares stand in for it.
"""

import numpy as np
import pytest

from study.paper import s7_6_buckling
from study.paper.items import TABLE_2
from tests.oracle.eigen import smallest
from tests.oracle.problem import (
    Problem,
    assert_agrees,
    assert_differs,
    both,
    displacement,
    on,
    oracle_body,
    symmetric_part,
)
from tests.paper.statements import judged, printed

test_statement = judged("7.6")
ELEMENTS = ("galerkin-T6", "pw-T6", "pwsym-T6", "galerkin-Q8")
LOADS = {"": False, "-uniform-8x2": True}

PRINTED = """
CPS6                  2.6208E+09  9.8096E+09
CPS6M                 2.6105E+09  9.6683E+09
6-node user element   2.5608E+09  9.1833E+09
"""
EULER = (2660e6, 10640e6)


def beam(result, element, uniform):
    """Half of the beam, symmetric and antisymmetric, under the load at A or a uniform one."""

    def ours(linear):
        body = oracle_body(result, element, linear, "plane stress", 2.07e11, 0.0, thickness=0.1)
        end, middle = on(0, 0.0), on(0, 4.0)
        A, centre = both(end, on(1, 0.0)), both(middle, on(1, 0.0))
        symmetrised = element.startswith("pwsym")
        K = symmetric_part(body.stiffness()) if symmetrised else body.stiffness()
        found = {}
        for mode in (1, 2):
            held = body.at_nodes(end if uniform else A, (1,))
            if mode == 1:
                held |= body.at_nodes(middle, (0,))
            else:
                held |= body.at_nodes(centre, (0,))
                held |= body.at_nodes(middle if uniform else centre, (1,))
            if uniform:
                f = body.traction(end, (1.0, 0.0))
                f += body.traction(middle, (-1.0, 0.0)) * (mode == 2)
            else:
                f = 0.1 * body.at_nodes(A, (0,)).ravel()
            K_sigma = body.geometric_stiffness(displacement(K, f, held))
            K_sigma = symmetric_part(K_sigma) if symmetrised else K_sigma
            factors = smallest(K, -K_sigma, held, 4).real
            found[f"sigma_cr_{mode}"] = factors[factors > 0].min()
        return found

    return Problem({name: result.scalars[name] for name in ("sigma_cr_1", "sigma_cr_2")}, ours)


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("element", ELEMENTS)
def test_oracle_finds_the_numbers_of_the_study(element, load, results):
    assert_agrees(beam(results[f"7.6/{element}{load}"], element, LOADS[load]), element)


def test_with_the_other_weights_it_does_not(results):
    """Else the test above could not tell whether the weights are the piecewise-linear ones."""
    assert_differs(beam(results["7.6/pw-T6"], "pw-T6", uniform=False))


def test_evenly_compressed_beams_buckle_alike_with_any_weights(results):
    """K_PW = T K and K_sigma alike: there is no difference that the test above could see."""
    assert_agrees(
        beam(results["7.6/pw-T6-uniform-8x2"], "galerkin-T6", uniform=True), "galerkin-T6"
    )


def test_table_2_is_the_printed_one():
    rows = [line.rsplit(maxsplit=2) for line in PRINTED.strip().splitlines()]
    typed = {name: tuple(map(float, numbers)) for name, *numbers in rows}
    assert {"Euler": EULER} | typed == TABLE_2


def test_printed_numbers():
    study = s7_6_buckling
    assert (study.YOUNGS_MODULUS, study.POISSONS_RATIO, study.THICKNESS) == (2.07e11, 0.0, 0.1)
    assert (printed("76-difference-1"), printed("76-difference-2")) == (3.7, 13.7)
    for mode, percent in ((0, 3.7), (1, 13.7)):
        off = 100 * (1 - TABLE_2["6-node user element"][mode] / EULER[mode])
        assert off == pytest.approx(percent, abs=0.05)


def test_eulers_stress_by_eq_27(results):
    """With L / h = 8, which follows from the printed stresses: I / A = h**2 / 12."""
    for mode in (1, 2):
        stress = mode**2 * np.pi**2 * 2.07e11 / 12 / 8**2
        assert results.scalar("7.6/exact", f"euler_{mode}") == pytest.approx(stress, rel=1e-12)
        assert stress == pytest.approx(EULER[mode - 1], rel=2e-4)

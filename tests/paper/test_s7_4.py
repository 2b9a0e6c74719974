"""Section 7.4: a rigid plate on an elastic body (Figs 11 to 14).

Printed: E = 1.2e8 kN/m2, Poisson's ratio 0.25, friction angle 20 degrees, unit thickness, a force
of 40 kN, sides and base held. Dimensions are reconstructed.
"""

import numpy as np
import pytest

from study.paper import s7_4_rigid_plate
from tests.oracle.contact import Pair, solve
from tests.oracle.problem import (
    NORMAL_DOWN,
    STATIC,
    assert_agrees,
    assert_differs,
    both,
    contact_problem,
    either,
    on,
    oracle_body,
    plane,
    sorted_nodes,
    within,
)
from tests.paper.statements import judged, printed

test_statement = judged("7.4")
ELEMENTS = STATIC


def plate(result, element):
    """A plate two metres wide, pressed by 40 kN in five steps on a body held all around."""

    def solved(linear):
        body = oracle_body(result, element, linear, "plane stress", 1.2e8, 0.25)
        outside = either(on(0, -20.0), on(0, 20.0), on(1, -10.0))
        below = sorted_nodes(result.curves, both(on(1, 0.0), within(1.0)))
        motions = [((0.0, None), (0.0, -40.0 * k / 5)) for k in range(1, 6)]
        pair = Pair(below, *plane(NORMAL_DOWN), np.tan(np.pi / 9), motions)
        loads, held = [np.zeros(body.nodes.size)] * 5, body.at_nodes(outside, (0, 1))
        return solve(body.stiffness(), loads, held, [pair], body.nodes)[-1]

    translation = (result.scalars["translation"], lambda state: -state.translations[0, 1])
    return contact_problem(result, solved, NORMAL_DOWN, translation=translation)


@pytest.mark.parametrize("element", ELEMENTS)
def test_oracle_finds_the_numbers_of_the_study(element, results):
    problem = plate(results[f"7.4/{element}"], element)
    assert_agrees(problem, element)


def test_with_the_other_weights_it_does_not(results):
    """Else the test above could not tell whether the weights are the piecewise-linear ones."""
    assert_differs(plate(results["7.4/pw-T6"], "pw-T6"))


def test_printed_numbers():
    study = s7_4_rigid_plate
    assert (study.YOUNGS_MODULUS, study.POISSONS_RATIO) == (1.2e8, 0.25)
    assert (study.FRICTION_ANGLE, study.FORCE) == (20.0, 40.0)
    assert printed("74-balance") == 40.0

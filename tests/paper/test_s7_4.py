"""Section 7.4: a rigid plate on an elastic body (Figs 11 to 14).

Printed: E = 1.2e8 kN/m2, Poisson's ratio 0.25, friction angle 20 degrees, unit thickness, a force
of 40 kN, sides and base held. Dimensions are reconstructed.
"""

import numpy as np
import pytest

from tests.oracle.contact import Pair, solve
from tests.oracle.problem import (
    NORMAL_DOWN,
    STATIC,
    assert_found,
    both,
    contact_problem,
    either,
    on,
    oracle_body,
    plane,
    sorted_nodes,
    within,
)


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


@pytest.mark.parametrize("element", STATIC)
def test_oracle_finds_the_numbers_of_the_study(element, results):
    assert_found(plate(results[f"7.4/{element}"], element), element)

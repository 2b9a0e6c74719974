"""Section 7.3: a parabolic rigid punch on an elastic body (Figs 9 and 10).

Printed: E = 1000, Poisson's ratio 0.25, friction 0.6, 76 8-node quadrilaterals, an indentation of
0.25 under about 215, and a tangential force of 10 % of that. Dimensions are reconstructed.
"""

import numpy as np
import pytest

from tests.oracle.contact import Pair, solve
from tests.oracle.problem import (
    NORMAL_DOWN,
    assert_found,
    contact_problem,
    on,
    oracle_body,
    parabola,
    sorted_nodes,
)


def punch(result, element):
    """Pressed in by 0.25 in twenty steps, then pushed aside by a tenth of that force."""

    def solved(linear):
        body = oracle_body(result, element, linear, "plane stress", 1000.0, 0.25)
        K, held = body.stiffness(), body.at_nodes(on(1, 0.0), (0, 1))
        top = sorted_nodes(result.curves, on(1, 4.0))
        steps = np.arange(1, 21) / 20
        down = [((0.0, -0.25 * s), (0.0, 0.0)) for s in steps]

        def pressed(motions):
            pair = Pair(top, *parabola(4.0, 8.0), 0.6, motions)
            return solve(K, [np.zeros(body.nodes.size)] * len(motions), held, [pair], body.nodes)

        force = -pressed(down)[-1].forces[0][:, 1].sum()
        aside = [((None, -0.25), (0.1 * force * s, 0.0)) for s in steps]
        return pressed(down + aside)[-1]

    translation = (result.scalars["translation"], lambda state: state.translations[0, 0])
    return contact_problem(result, solved, NORMAL_DOWN, translation=translation)


@pytest.mark.parametrize("element", ["galerkin-T6", "pw-T6", "galerkin-Q8"])
def test_oracle_finds_the_numbers_of_the_study(element, results):
    assert_found(punch(results[f"7.3/{element}"], element), element)

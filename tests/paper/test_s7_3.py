"""Section 7.3: a parabolic rigid punch on an elastic body (Figs 9 and 10).

Printed: E = 1000, Poisson's ratio 0.25, friction 0.6, 76 8-node quadrilaterals, an indentation of
0.25 under about 215, and a tangential force of 10 % of that. Dimensions are reconstructed.
"""

import numpy as np
import pytest

from study.paper import s7_3_parabolic_punch
from tests.oracle.contact import Pair, solve
from tests.oracle.problem import (
    NORMAL_DOWN,
    STATIC,
    assert_agrees,
    assert_differs,
    contact_problem,
    on,
    oracle_body,
    parabola,
    sorted_nodes,
)
from tests.paper.statements import judged, printed

test_statement = judged("7.3")
ELEMENTS = STATIC


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


@pytest.mark.parametrize("element", ELEMENTS)
def test_oracle_finds_the_numbers_of_the_study(element, results):
    problem = punch(results[f"7.3/{element}"], element)
    assert_agrees(problem, element)


def test_with_the_other_weights_it_does_not(results):
    """Else the test above could not tell whether the weights are the piecewise-linear ones."""
    assert_differs(punch(results["7.3/pw-T6"], "pw-T6"))


def test_printed_numbers(results):
    study = s7_3_parabolic_punch
    assert (study.YOUNGS_MODULUS, study.POISSONS_RATIO, study.FRICTION) == (1000.0, 0.25, 0.6)
    assert (study.DEPTH, study.TANGENTIAL_SHARE) == (0.25, 0.1)
    assert (printed("73-force"), printed("73-mesh")) == (215.0, 76.0)
    assert len(results.curves("7.3/galerkin-Q8")["cells"]) == 76
    assert results.scalar("7.3/galerkin-Q8", "force_indentation") == pytest.approx(215, abs=5)

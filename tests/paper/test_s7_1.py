"""Section 7.1: two triangles under unit load; the reactions of their lower side (Figs 4 and 5).

Printed: with Galerkin's method the central reaction is four times the others; with the new one
the distribution is even. Fig. 5 itself is lost in our copy.
"""

import pytest

from tests.oracle.problem import (
    STATIC,
    Problem,
    assert_agrees,
    assert_differs,
    both,
    displacement,
    on,
    oracle_body,
    sorted_nodes,
)
from tests.paper.statements import judged, printed

test_statement = judged("7.1")
ELEMENTS = STATIC


def row(result, element):
    """Squares on a smooth base under unit load, cut in two triangles each."""

    def ours(linear):
        body = oracle_body(result, element, linear, "plane stress", 1.0, 0.3)
        lower = sorted_nodes(result.curves, on(1, 0.0))
        held = body.at_nodes(on(1, 0.0), (1,))
        held |= body.at_nodes(both(on(0, 0.0), on(1, 0.0)), (0,))
        f = body.traction(on(1, 1.0), (0.0, -1.0))
        K = body.stiffness()
        residual = (K @ displacement(K, f, held) - f).reshape(-1, 2)
        return {"reaction": residual[lower, 1], "sum": residual[lower, 1].sum()}

    theirs = {"reaction": result.curves["reaction"], "sum": result.scalars["sum"]}
    return Problem(theirs, ours)


@pytest.mark.parametrize("element", ELEMENTS)
def test_oracle_finds_the_numbers_of_the_study(element, results):
    problem = row(results[f"7.1/{element}-row"], element)
    assert_agrees(problem, element)


def test_with_the_other_weights_it_does_not(results):
    """Else the test above could not tell whether the weights are the piecewise-linear ones."""
    assert_differs(row(results["7.1/pw-T6-row"], "pw-T6"))


@pytest.mark.parametrize(
    ("element", "shares"),
    [("galerkin-T6", (1 / 6, 2 / 3, 1 / 6)), ("pw-T6", (1 / 4, 1 / 2, 1 / 4))],
)
def test_reactions_of_fig_5(element, shares, results):
    reaction = results.curves(f"7.1/{element}")["reaction"]
    assert reaction == pytest.approx(shares, rel=1e-12)


def test_printed_numbers():
    assert printed("71-four") == 4.0
    assert printed("71-left") == 0.25

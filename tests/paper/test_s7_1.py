"""Section 7.1: two triangles under unit load; the reactions of their lower side (Figs 4 and 5).

Printed: with Galerkin's method the central reaction is four times the others; with the new one
the distribution is even. Fig. 5 itself is lost in our copy.
"""

import pytest

from tests.oracle.problem import (
    STATIC,
    Problem,
    assert_found,
    both,
    displacement,
    on,
    oracle_body,
    sorted_nodes,
)


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


@pytest.mark.parametrize("element", STATIC)
def test_oracle_finds_the_numbers_of_the_study(element, results):
    assert_found(row(results[f"7.1/{element}-row"], element), element)

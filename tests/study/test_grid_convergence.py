"""Test grid convergence by series of known order and examples of Celik et al. (2008)."""

import numpy as np
import pytest

from study.judge.grid_convergence import (
    MAX_ORDER,
    MIN_ORDER,
    SAFETY_FACTOR,
    grid_convergence,
)

MESH_SIZE_TRIPLES = [(1, 1 / 2, 1 / 4), (1, 1 / 3, 1 / 6), (3, 2, 1)]


@pytest.mark.parametrize("sizes", MESH_SIZE_TRIPLES)
@pytest.mark.parametrize("order", [0.6, 1.0, 1.09, 2.0, 4.0])
@pytest.mark.parametrize("coefficient", [0.3, -0.02])
def test_an_exact_power_law_gives_its_order_limit_and_error(sizes, order, coefficient):
    limit = -7.0
    values = [limit + coefficient * size**order for size in sizes]
    convergence = grid_convergence(values, sizes)
    assert convergence.reason == ""
    assert convergence.values == pytest.approx(tuple(values))
    assert convergence.order == pytest.approx(order, rel=1e-9)
    assert convergence.extrapolated == pytest.approx(limit, rel=1e-10)
    fine_error = abs(values[-1] - limit) / abs(values[-1])
    assert convergence.index == pytest.approx(SAFETY_FACTOR * fine_error, rel=1e-8)
    assert convergence.coarse_error == pytest.approx(values[0] / limit - 1, rel=1e-8)


def test_values_may_come_in_any_order():
    forwards = grid_convergence([3.0, 2.25, 2.0625], [1, 1 / 2, 1 / 4])
    assert grid_convergence([2.0625, 3.0, 2.25], [1 / 4, 1, 1 / 2]) == forwards
    assert forwards.values == (3.0, 2.25, 2.0625)
    assert forwards.order == pytest.approx(2)
    assert forwards.extrapolated == pytest.approx(2)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ((1.0, 1.2, 1.1), "oscillatory"),
        ((1.0, 0.9, 1.3), "oscillatory"),
        ((1.0, 1.1, 1.3), "divergent"),
        ((1.0, 1.1, 1.2), "divergent"),  # equal changes, as of log(h)
        ((1.0, 1.1, 1.1), "equal on two meshes"),
        ((1.0, 1.0, 1.1), "equal on two meshes"),
        ((2.0, 2.0, 2.0), "equal on two meshes"),
        ((0.0, 0.0, 0.0), "equal on two meshes"),
        ((1.0, 1.0 + 1e-3, 1.0 + 1e-3 + 1e-8), "order out of range"),
    ],
)
def test_values_that_are_not_asymptotic_have_a_named_reason(values, reason):
    convergence = grid_convergence(values, (1, 1 / 2, 1 / 4))
    assert convergence.reason == reason
    assert convergence.extrapolated is convergence.index is convergence.coarse_error is None


@pytest.mark.parametrize("order", [MIN_ORDER - 0.01, MAX_ORDER + 0.01])
def test_an_order_out_of_range_is_reported_but_gives_no_index(order):
    convergence = grid_convergence(
        [1 + h**order for h in MESH_SIZE_TRIPLES[0]], MESH_SIZE_TRIPLES[0]
    )
    assert convergence.reason == "order out of range"
    assert convergence.order == pytest.approx(order)
    assert convergence.index is None


def test_divergence_is_detected_with_unequal_refinement_ratios():
    sizes = (1, 1 / 2, 1 / 6)
    assert grid_convergence(np.log(sizes), sizes).reason == "divergent"
    assert grid_convergence([h**-0.5 for h in sizes], sizes).reason == "divergent"


# Table 1 of Celik et al. (2008): numbers of cells in the plane and values, both from the fine to
# the coarse mesh; order, extrapolated value, and grid convergence index in per cent
PUBLISHED_EXAMPLES = [
    ((18000, 8000, 4500), (6.063, 5.972, 5.863), 1.53, 6.1685, 2.2),
    ((18000, 4500, 980), (10.7880, 10.7250, 10.6050), 0.75, 10.8801, 1.1),
]


@pytest.mark.parametrize(
    ("n_cells", "values", "order", "limit", "index_percent"), PUBLISHED_EXAMPLES
)
def test_published_examples_are_reproduced_to_the_printed_digits(
    n_cells, values, order, limit, index_percent
):
    convergence = grid_convergence(values, [n**-0.5 for n in n_cells])
    assert convergence.reason == ""
    assert convergence.order == pytest.approx(order, abs=0.005)
    assert convergence.extrapolated == pytest.approx(limit, abs=5e-5)
    assert 100 * convergence.index == pytest.approx(index_percent, abs=0.05)


def test_the_published_oscillating_example_is_not_accepted():
    """Values for which Celik et al. give an order of 1.51 are rejected, because they oscillate."""
    sizes = [n**-0.5 for n in (18000, 4500, 980)]
    assert grid_convergence((6.0042, 5.9624, 6.0909), sizes).reason == "oscillatory"


@pytest.mark.parametrize(
    ("values", "sizes", "message"),
    [
        ((1.0, 2.0), (2.0, 1.0), "expected three"),
        ((1.0, 2.0, np.nan), (4.0, 2.0, 1.0), "finite"),
        ((1.0, 2.0, 3.0), (4.0, 2.0, 0.0), "finite"),
        ((1.0, 2.0, 3.0), (4.0, 2.0, 1.9), "ratio below 1.3"),
    ],
)
def test_unsuitable_values_and_sizes_are_refused(values, sizes, message):
    with pytest.raises(ValueError, match=message):
        grid_convergence(values, sizes)

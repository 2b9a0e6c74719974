"""Test variants of cases in data that the paper does not print, and envelopes of their curves."""

import numpy as np
import pytest

from study.judge.measures.paper_statements import _evaluate_test_functions_on_line
from study.paper.bands import (
    OTHER_DIAGONALS,
    UNPRINTED_DATA,
    envelope_of_lines,
    list_keys_of_case_and_variants,
)
from study.run.cases import load_section


@pytest.mark.parametrize("section", UNPRINTED_DATA)
def test_variants_differ_from_their_base_in_the_varied_parameters_only(section):
    cases = {case.key: case.stored_parameters for case in load_section(section).cases}
    for variants in (UNPRINTED_DATA, OTHER_DIAGONALS):
        complete = [
            key for key in cases if set(list_keys_of_case_and_variants(key, variants)) <= set(cases)
        ]
        element = "pw-Q9" if variants is UNPRINTED_DATA and section == "7.3" else "pw-T6"
        assert f"{section}/{element}" in complete
        for key in complete:
            for suffix, changes in variants[section].items():
                base, variant = cases[key], cases[key + suffix]
                differing = {name for name in base if base[name] != variant[name]}
                assert set() < differing <= set(changes), key + suffix


@pytest.mark.parametrize("section", OTHER_DIAGONALS)
def test_base_case_and_variants_cover_all_diagonal_patterns(section):
    (case,) = (
        section_case for section_case in load_section(section).cases if section_case.name == "pw-T6"
    )
    patterns = {changes["pattern"] for changes in OTHER_DIAGONALS[section].values()}
    patterns.add(case.stored_parameters["pattern"])
    assert patterns == {"right", "left", "left_right", "right_left", "crossed"}


def test_envelope_spans_the_first_curves_range_and_encloses_all_curves():
    rng = np.random.default_rng(3)
    lines = []
    for count in (5, 9, 4):
        x = np.sort(rng.uniform(-1, 1, count))
        x[[0, -1]] = -1 - rng.uniform(), 1 + rng.uniform()
        lines.append((x, rng.normal(size=count)))
    lines[1][1][3] = np.nan  # no pressure at a node whose weight vanishes
    x, low, high = envelope_of_lines(lines)
    assert (x[0], x[-1]) == (lines[0][0][0], lines[0][0][-1])
    for positions, values in lines:
        is_number = ~np.isnan(values)
        for position in np.linspace(x[0], x[-1], 101):
            value = np.interp(position, positions[is_number], values[is_number])
            lower, upper = np.interp(position, x, low), np.interp(position, x, high)
            assert lower - 1e-12 <= value <= upper + 1e-12
    assert low.min() == pytest.approx(min(np.nanmin(values) for _, values in lines))


@pytest.mark.parametrize(
    ("is_standard", "edge_integrals_times_six"), [(True, (1, 4, 1)), (False, (1.5, 3, 1.5))]
)
def test_line_weight_functions_sum_to_one_and_have_the_elements_integrals(
    is_standard, edge_integrals_times_six
):
    """Weight functions along a contact line sum to one and have the integrals of their element.

    The study averages shear along a line with these functions, which are one at their own nodes.
    Divided by the length of an edge, the integrals over the edge are 1/6, 2/3, 1/6 for the standard
    element and 1/4, 1/2, 1/4 for the new one. The contact line of this test has two edges.
    """
    nodes = np.array([0.0, 0.5, 1.0, 2.0, 3.0])
    x = np.linspace(0, 3, 30_001)
    functions = _evaluate_test_functions_on_line(nodes, x, is_standard)
    assert functions.sum(axis=0) == pytest.approx(1.0)
    assert functions[np.arange(5), np.searchsorted(x, nodes)] == pytest.approx(1.0)
    integrals = np.trapezoid(functions, x, axis=1)
    first, middle, last = (np.array(edge_integrals_times_six) / 6).tolist()
    expected = [first, middle, last + 2 * first, 2 * middle, 2 * last]
    assert integrals == pytest.approx(expected, rel=1e-6)

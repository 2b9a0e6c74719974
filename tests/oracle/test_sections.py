"""Numbers of the study's own sections, found again by a solver of their own.

What is compared, and how far apart it may be, is the same everywhere: all nodal forces along the
contact, their sums, displacements, translations, eigenvalues, relative to the largest of each.
"""

import pytest

from tests.oracle import sections
from tests.oracle.problem import STATIC, assert_agrees, assert_differs

T6 = ("galerkin-T6", "pw-T6")

PROBLEMS = {
    "V1": (sections.patch_test, STATIC, {}),
    "V1-curved": (sections.patch_test, T6, {"mesh": "curved"}),
    "V1-round": (sections.patch_test, STATIC, {"state": "axisymmetric"}),
    "V4": (sections.spence_punch, ("pw-T6", "pw-Q8"), {}),
    "V4-plane stress": (sections.spence_punch, ("pw-T6",), {"state": "plane stress"}),
    "V5": (sections.partial_slip, ("pw-T6", "pw-Q9"), {}),
    "V8-rod": (sections.vibrating_rod, (*T6, "pwsym-T6", "galerkin-Q8", "pw-Q9", "pw-Q8"), {}),
}
CASES = [(name, element) for name, (_, elements, _) in PROBLEMS.items() for element in elements]


def problem(name, element):
    make, _, parameters = PROBLEMS[name]
    return make(element, **parameters)


@pytest.mark.parametrize(("name", "element"), CASES)
def test_oracle_finds_the_numbers_of_the_study(name, element):
    assert_agrees(problem(name, element), element)


@pytest.mark.parametrize("name", PROBLEMS)
def test_with_the_other_weights_it_does_not(name):
    """Else the test above could not tell whether the weights are the piecewise-linear ones."""
    assert_differs(problem(name, "pw-T6"))

"""Numbers of the study's own sections, found again by a solver of their own.

What is compared, and how far apart it may be, is the same everywhere: all nodal forces along the
contact, their sums, displacements, translations, eigenvalues, relative to the largest of each.
"""

from unittest.mock import patch

import pytest

from pw_elements.elasticity import body
from tests.oracle import sections
from tests.oracle.problem import STATIC, assert_agrees, assert_differs
from tests.paper.test_s7_5 import stepped_column

T6 = ("galerkin-T6", "pw-T6")
VIBRATION = (*T6, "pwsym-T6", "galerkin-Q8", "pw-Q9")

PROBLEMS = {
    "V1": (sections.patch_test, STATIC, {}),
    "V1-curved": (sections.patch_test, T6, {"mesh": "curved"}),
    "V1-round": (sections.patch_test, STATIC, {"state": "axisymmetric"}),
    "V4": (sections.spence_punch, ("pw-T6", "pw-Q8"), {}),
    "V4-plane stress": (sections.spence_punch, ("pw-T6",), {"state": "plane stress"}),
    "V5": (sections.partial_slip, ("pw-T6", "pw-Q9"), {}),
    "V7": (sections.sliding_wedge, T6, {}),
    "V8-rod": (sections.vibrating, (*VIBRATION, "pw-Q8"), {"case": "rod"}),
    "V8-square": (sections.vibrating, (*VIBRATION, "pw-Q8"), {"case": "square"}),
    "V8-strip": (sections.vibrating, VIBRATION, {"case": "strip"}),
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


# Against the oracle's rule, on the coarse mesh; on the mesh of the study, whose triangles at the
# axis are smaller, the largest differences of all were 8e-8 and 7e-9. The forces of face 1 are
# relative to its largest nodal force; those along it next to the axis are touched most
LEFT_BY_DEGREE_8 = {
    "galerkin-T6": {"omega2": 2e-7, "displacement": 2e-6, "force_n_1": 4e-6, "force_t_1": 5e-5},
    "pw-T6": {"omega2": 6e-9, "displacement": 1.2e-7, "force_n_1": 2e-7, "force_t_1": 4e-6},
}


@pytest.mark.parametrize("element", T6)
def test_what_the_rule_of_degree_8_leaves_on_the_axis(element):
    """Section 7.5 by the study's own rule; some of its triangles touch the axis in one point."""
    assert body._RATIONAL_DEGREE == 8
    with patch.object(sections, "RULES", dict.fromkeys(sections.RULES, (8, 16))):
        differences = stepped_column(element).differences(element.startswith("pw"))
    for name, left in LEFT_BY_DEGREE_8[element].items():
        assert left / 2 < differences[name] < left, (name, differences[name])

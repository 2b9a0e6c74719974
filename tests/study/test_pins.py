"""Regression: the numbers that are only recorded, computed anew without any stored results."""

import pytest

from study.judge.claims import judge, load_claims
from tests.study.computed_results import ComputedResults

PINS = [claim for claim in load_claims() if claim.kind == "pin"]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return ComputedResults(tmp_path_factory.mktemp("pins"))


@pytest.mark.parametrize("pin", PINS, ids=lambda pin: pin.id)
def test_a_recorded_number_is_found_again(pin, results):
    (found,) = judge([pin], results)
    assert found.verdict == "holds", found.measured
    assert not found.differs

"""Test each finding and each pinned number of the study in a test that has its id.

Results that `./run study` has stored are read if they were computed with the current code. Other
cases are computed if that takes less than a CPU second. Tests that need slower cases without a
stored result are skipped before any computation, or fail if the environment variable
STUDY_RESULTS_REQUIRED is set.
"""

import os
import random
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from study.judge import checks, pins
from study.judge.claims import PAPER_KINDS, judge_claims, load_claims
from study.judge.measures.general import largest
from study.run import runner
from study.run.expected import read_table_of_expected_seconds
from study.run.store import Results, StoredResult, StudyError
from tests.study.computed_results import ComputedResults, load_cases_by_key

STORED_RESULTS_FOLDER = Path(__file__).parents[2] / "results"
FINDINGS_AND_PINS = [claim for claim in load_claims() if claim.kind not in PAPER_KINDS]


def _claim_id(claim):
    return claim.id


@cache
def open_stored_results():
    return Results(STORED_RESULTS_FOLDER)


@cache
def find_states_of_section(section):
    """Return the states of the stored results of a section, by key of the case.

    The state of a case is "stored" if its result was computed with the current code. Cases without
    a stored result are left out.
    """
    stored_cases = [
        case
        for key, case in load_cases_by_key().items()
        if case.section == section and key in open_stored_results()
    ]
    return (
        runner.find_states_of_stored_results(stored_cases, open_stored_results())
        if stored_cases
        else {}
    )


def find_state(key):
    return find_states_of_section(key.partition("/")[0]).get(key, "missing")


def takes_too_long(key):
    """Return whether computing a case, rather than reading a record, takes a CPU second or more."""
    return key in read_table_of_expected_seconds() and not load_cases_by_key()[key].record


class StoredOrQuickResults(ComputedResults):
    """Results read from the project's folder if they are current, and otherwise computed.

    Tests that need a slow case without a current result are skipped, or fail if results are
    required.
    """

    def __getitem__(self, key):
        state = find_state(key)
        if state == "stored":
            return open_stored_results()[key]
        if not takes_too_long(key):
            return super().__getitem__(key)
        message = f"{key} is {state} in {STORED_RESULTS_FOLDER}: run ./run study"
        if os.environ.get("STUDY_RESULTS_REQUIRED"):
            pytest.fail(message)
        pytest.skip(message)


class ValueForEveryName(dict):
    """Mapping that has the same value for every name."""

    def __init__(self, value):
        super().__init__()
        self.value = value

    def __contains__(self, name):
        return True

    def __missing__(self, name):
        return self.value


class ResultsWithArbitraryNumbers(StoredOrQuickResults):
    """Results that show which cases a judgement reads, without computing any of them.

    Numbers differ between cases, so that few judgements fail because of equal numbers.
    """

    def __init__(self, folder):
        super().__init__(folder)
        self.n_results_read = 0

    def __getitem__(self, key):
        if takes_too_long(key):
            return super().__getitem__(key)
        self.n_results_read += 1
        number = 1.0 / (1 + self.n_results_read)
        section, _, case = key.partition("/")
        return StoredResult(
            section,
            case,
            load_cases_by_key()[key].stored_parameters,
            ValueForEveryName(number),
            ValueForEveryName("1"),
            lambda: ValueForEveryName(np.full(3, number)),
            {},
        )


def skip_if_slow_result_is_unavailable(claim):
    """Skip the test of a claim, or fail, if the claim needs a slow case without a current result.

    A claim that cannot be judged with arbitrary numbers is not skipped here, but when it reads the
    result of the slow case.
    """
    with suppress(StudyError), np.errstate(all="ignore"):
        judge_claims([claim], ResultsWithArbitraryNumbers(STORED_RESULTS_FOLDER))


@pytest.fixture(scope="module")
def stored_or_quick_results(results):
    return StoredOrQuickResults(results.folder)


@pytest.mark.parametrize("claim", FINDINGS_AND_PINS, ids=_claim_id)
def test_finding_or_pin_has_its_expected_verdict(claim, stored_or_quick_results):
    skip_if_slow_result_is_unavailable(claim)
    (verdict,) = judge_claims([claim], stored_or_quick_results)
    assert not verdict.differs, (
        f"{claim.statement} {verdict.verdict} with {verdict.measured}, not "
        f"{verdict.expected_verdict}"
    )


def test_checks_with_unknown_relation_or_non_finite_bound_are_refused():
    with pytest.raises(StudyError, match="relation '==' is none of"):
        checks.check("X-1", "It is one.", largest, "==", 1.0, why="")
    with pytest.raises(StudyError, match="have to be finite"):
        checks.check("X-1", "It is one.", largest, "=", float("nan"), why="")


def test_pins_with_unknown_keys_are_refused(tmp_path):
    path = tmp_path / "pins.json"
    path.write_text('[{"id": "X-1", "colour": "red"}]')
    with pytest.raises(StudyError, match=r"pin X-1 lacks or should not have .*colour"):
        pins.load_pins(path)


@pytest.mark.parametrize("claim", random.Random(20).sample(FINDINGS_AND_PINS, 20), ids=_claim_id)
def test_number_beyond_its_bound_changes_the_verdict(claim):
    """The verdict of a check changes if it measures a number on the wrong side of its bound.

    Otherwise, the check could not fail. The checks are drawn at random.
    """
    judgement = claim.judgement
    wrong_direction = {"<": 1, "<=": 1, "=": 1, ">": -1, ">=": -1}[judgement.relation]
    wrong_number = judgement.value + wrong_direction * (
        2 * judgement.tol + 1e-6 * (abs(judgement.value) + 1)
    )
    altered_claim = replace(
        claim, judgement=replace(judgement, function=lambda *_, **__: wrong_number)
    )
    (verdict,) = judge_claims([altered_claim], Results(STORED_RESULTS_FOLDER))
    assert verdict.differs

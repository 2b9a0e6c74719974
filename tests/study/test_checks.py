"""Test each finding and each pinned number of the study in a test that has its id.

Cases that take less than a CPU second are computed. Slower ones are read from the results that
`./run study` has stored, if these were computed with the current code. Otherwise, tests that need
slower cases are skipped, or fail if the environment variable STUDY_RESULTS_REQUIRED is set.
"""

import os
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from study.judge import checks, pins
from study.judge.claims import PAPER_KINDS, judge_claims, load_claims
from study.judge.measures.general import largest
from study.run import runner
from study.run.expected import read_table_of_expected_seconds
from study.run.store import Results, StudyError
from tests.study.computed_results import ComputedResults, load_cases_by_key

STORED_RESULTS_FOLDER = Path(__file__).parents[2] / "results"
FINDINGS_AND_PINS = [claim for claim in load_claims() if claim.kind not in PAPER_KINDS]


def _claim_id(claim):
    return claim.id


@cache
def load_stored_results_and_states():
    """Return the stored results of the project, and a map from keys of slow cases to their states.

    The state of a case is "stored" if its result was computed with the current code.
    """
    results = Results(STORED_RESULTS_FOLDER)
    slow_cases = [
        case for key, case in load_cases_by_key().items() if key in read_table_of_expected_seconds()
    ]
    return results, runner.find_states_of_stored_results(slow_cases, results)


class QuickOrStoredResults(ComputedResults):
    """Results of cases, read from files if computing them takes a CPU second or longer."""

    def __getitem__(self, key):
        if key not in read_table_of_expected_seconds() or load_cases_by_key()[key].record:
            return super().__getitem__(key)
        results, states = load_stored_results_and_states()
        if states[key] == "stored":
            return results[key]
        message = f"{key} is {states[key]} in {STORED_RESULTS_FOLDER}: run ./run study"
        if os.environ.get("STUDY_RESULTS_REQUIRED"):
            pytest.fail(message)
        pytest.skip(message)


@pytest.fixture(scope="module")
def quick_or_stored_results(results):
    return QuickOrStoredResults(results.folder)


@pytest.mark.parametrize("claim", FINDINGS_AND_PINS, ids=_claim_id)
def test_finding_or_pin_has_its_expected_verdict(claim, quick_or_stored_results):
    (verdict,) = judge_claims([claim], quick_or_stored_results)
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

"""Checks of the pages, findings and pins, each one a test of its name.

Cases of less than a CPU second are computed. Others are read from the stored results of
`./run study`, if these are of the present code; without them, a check that needs one is skipped,
or fails if STUDY_RESULTS_REQUIRED is set, as in the gate.
"""

import os
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from study.judge import checks, pins
from study.judge.claims import PAPER, judge, load_claims
from study.judge.measures.general import largest
from study.run import runner
from study.run.expected import read_expected_table
from study.run.store import Results, StudyError
from tests.study.computed_results import ComputedResults, cases

STORED = Path(__file__).parents[2] / "results"
RECORDED_VERDICTS = [claim for claim in load_claims() if claim.kind not in PAPER]


def _name(claim):
    return claim.id


@cache
def stored_results():
    """Return the stored results of the project, and whether each is of the present code."""
    results = Results(STORED)
    slow = [case for key, case in cases().items() if key in read_expected_table()]
    return results, runner.states(slow, results)


class QuickOrStoredResults(ComputedResults):
    """Results that are computed if this takes less than a second, and else read."""

    def __getitem__(self, key):
        if key not in read_expected_table() or cases()[key].record:
            return super().__getitem__(key)
        results, states = stored_results()
        if states[key] == "stored":
            return results[key]
        message = f"{key} is {states[key]} in {STORED}: run ./run study"
        if os.environ.get("STUDY_RESULTS_REQUIRED"):
            pytest.fail(message)
        pytest.skip(message)


@pytest.fixture(scope="module")
def quick_or_stored(results):
    return QuickOrStoredResults(results.folder)


@pytest.mark.parametrize("claim", RECORDED_VERDICTS, ids=_name)
def test_check(claim, quick_or_stored):
    (verdict,) = judge([claim], quick_or_stored)
    assert not verdict.differs, (
        f"{claim.statement} {verdict.verdict} with {verdict.measured}, not {verdict.expected}"
    )


def test_checks_with_wrong_numbers_are_refused():
    with pytest.raises(StudyError, match="relation '==' is none of"):
        checks.check("X-1", "It is one.", largest, "==", 1.0, why="")
    with pytest.raises(StudyError, match="have to be finite"):
        checks.check("X-1", "It is one.", largest, "=", float("nan"), why="")


def test_pins_with_unknown_keys_are_refused(tmp_path):
    path = tmp_path / "pins.json"
    path.write_text('[{"id": "X-1", "colour": "red"}]')
    with pytest.raises(StudyError, match=r"pin X-1 lacks or should not have .*colour"):
        pins.load_pins(path)


@pytest.mark.parametrize("claim", random.Random(20).sample(RECORDED_VERDICTS, 20), ids=_name)
def test_a_wrong_number_is_noticed(claim):
    """Judged with a number on the wrong side of its bound, a check drawn at random differs."""
    how = claim.judgement
    wrong = {"<": 1, "<=": 1, "=": 1, ">": -1, ">=": -1}[how.relation]
    number = how.value + wrong * (2 * how.tol + 1e-6 * (abs(how.value) + 1))
    planted = replace(claim, judgement=replace(how, function=lambda *_, **__: number))
    (verdict,) = judge([planted], Results(STORED))
    assert verdict.differs

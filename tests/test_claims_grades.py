"""The author of a claim proposes its grade; these tests enforce it.

Reproduced: it reads computed results, and another element or law turns the verdict. Consistent by
construction: one of the reasons that a machine can check holds. The cases that are needed are
computed here, without any stored results.
"""

import re
from dataclasses import replace
from fractions import Fraction
from importlib import import_module

import numpy as np
import pytest

from study.core.store import MissingResult, Results
from study.judge.claims import GRADES, PAPER, judge, load_claims
from study.paper.s7_5_profiles import PROFILES
from tests.computed_results import ComputedResults, SwappedResults

CLAIMS = load_claims()
STATEMENTS = [claim for claim in CLAIMS if claim.kind in PAPER]


def graded(grade, *bases):
    found = [c for c in STATEMENTS if c.grade == grade and (not bases or c.basis in bases)]
    assert found
    return pytest.mark.parametrize("claim", found, ids=lambda claim: claim.id)


@pytest.fixture(scope="session")
def folder(tmp_path_factory, worker_id):
    base = tmp_path_factory.getbasetemp()
    return (base if worker_id == "master" else base.parent) / "computed"  # one for all workers


def verdict(claim, results):
    (one,) = judge([claim], results)
    return one


def swapped(claim, folder):
    """The verdict with another element or law: in the arguments, else in the results' keys."""
    (old, new) = claim.swap.get("element") or claim.swap["law"]
    how = claim.judgement
    args = {key: exchanged(value, old, new) for key, value in how.args.items()}
    if args != how.args:
        other = replace(claim, judgement=replace(how, args=args))
        return verdict(other, ComputedResults(folder))
    return verdict(claim, SwappedResults(folder, old, new))


def exchanged(value, old, new):
    if isinstance(value, list):
        return [exchanged(one, old, new) for one in value]
    return value.replace(old, new) if isinstance(value, str) else value


def agrees(measured, gives):
    return measured == pytest.approx(gives, rel=0.01, abs=1e-9)


@graded("reproduced")
def test_reproduced_claim_holds_and_another_element_or_law_turns_it(claim, folder):
    assert verdict(claim, ComputedResults(folder)).verdict == "holds"
    other = swapped(claim, folder)
    assert other.verdict == "fails"
    assert agrees(other.measured, claim.swap["gives"])


@graded("reproduced")
def test_reproduced_claim_reads_computed_results(claim, tmp_path):
    assert verdict(claim, Results(tmp_path)).verdict == "not judged"


@graded("consistent by construction", "printed")
def test_arithmetic_on_printed_numbers_needs_no_result(claim, tmp_path):
    assert verdict(claim, Results(tmp_path)).verdict == "holds"


@graded("consistent by construction", "identity")
def test_identity_gives_a_simple_fraction_to_round_off(claim, folder):
    measured = verdict(claim, ComputedResults(folder)).measured
    assert abs(measured - Fraction(measured).limit_denominator(12)) < 1e-9


OTHER_INPUTS = {
    "study.paper.s7_3_parabolic_punch.RADIUS": {"radius": 10.0},
    "study.paper.s7_3_parabolic_punch.DIVISIONS": {"divisions": (18, 4)},
    "study.paper.s7_4_rigid_plate.FORCE": 41.0,
    "study.paper.s7_5_profiles.PROFILES": "first",
    "study.paper.s7_6_buckling.LENGTH": 9.0,
    "study.paper.s7_6_buckling.PAPER_DIVISIONS": {"divisions": (2, 1)},
}
"""For what was put in or fitted: another parameter of the cases, or another constant."""


@graded("consistent by construction", "input", "fit")
def test_what_was_put_in_or_fitted_decides_the_verdict(claim, monkeypatch, tmp_path):
    """With another input the number is not met: that it is met says what was put in."""
    parameters = {}
    match OTHER_INPUTS[claim.chosen]:
        case dict(parameters):
            pass
        case str(name):
            profile = PROFILES[name]
            wider = tuple(1.1 * radius for radius in profile.radii)
            higher = tuple(1.1 * height for height in profile.heights)
            other = replace(profile, radii=wider, heights=higher, ring_divisions=(4, 1, 7, 4))
            monkeypatch.setitem(PROFILES, name, other)
        case constant:
            monkeypatch.setattr(claim.chosen, constant)
    assert verdict(claim, ComputedResults(tmp_path, parameters)).verdict == "fails"


@graded("consistent by construction", "input")
def test_input_is_the_number_itself(claim):
    module, _, name = claim.chosen.rpartition(".")
    assert claim.judgement.value == np.prod(getattr(import_module(module), name))


INSENSITIVE = [c for c in STATEMENTS if c.grade == "consistent by construction" and c.swap]


@pytest.mark.parametrize("claim", INSENSITIVE, ids=lambda claim: claim.id)
def test_swap_does_not_turn_what_holds_by_construction(claim, folder):
    assert verdict(claim, ComputedResults(folder)).verdict == "holds"
    other = swapped(claim, folder)
    assert other.verdict == "holds"
    assert agrees(other.measured, claim.swap["gives"])


def test_every_statement_of_the_paper_has_a_grade_and_nothing_else_has():
    assert all(claim.grade in GRADES and claim.quote for claim in STATEMENTS)
    assert {claim.grade for claim in CLAIMS if claim.kind not in PAPER} == {None}


@pytest.mark.parametrize("claim", STATEMENTS, ids=lambda claim: claim.id)
def test_quote_is_short_and_implied_statements_say_whose_reading_they_are(claim):
    assert len(claim.quote.split()) <= 25
    assert ("implied" in claim.source) == (claim.kind == "implied")
    if claim.kind == "implied":
        assert "this study's" in claim.statement


@pytest.mark.parametrize("part", ["Section 1", "Section 8"])
def test_introduction_and_conclusions_are_judged(part):
    assert sum(bool(re.match(rf"{part}\b", claim.source)) for claim in STATEMENTS) >= 4


def test_the_shear_of_fig_10_is_judged():
    assert any("shear" in c.statement and "Fig. 10" in c.source for c in STATEMENTS)


def test_missing_results_are_computed_once(folder):
    results = ComputedResults(folder)
    assert results["7.1/pw-T6"].scalars == ComputedResults(folder)["7.1/pw-T6"].scalars
    with pytest.raises(MissingResult):
        results["7.1/no-such"]

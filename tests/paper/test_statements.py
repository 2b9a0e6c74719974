"""The author of a claim proposes its grade; these tests enforce it.

Reproduced: it reads computed results, and another element or law turns it. Consistent by
construction: one of the reasons that a machine can check holds. Statements that the same mutations
turn rest on one fact. The cases that are needed are computed here, without any stored results.
"""

import ast
import json
import re
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from study.judge.claims import GRADES, PAPER, judge, load_claims
from study.judge.facts import (
    COMPUTED,
    PRINTED,
    facts_of,
    load_facts,
    misread,
    own_number,
    signature,
    turned_by,
)
from study.paper.s7_5_profiles import PROFILES
from study.run.store import Results, write_json
from tests.study.computed_results import ComputedResults

ROOT = Path(__file__).parents[2]
CLAIMS = load_claims()
STATEMENTS = [claim for claim in CLAIMS if claim.kind in PAPER]
# What rests on printed numbers but is no statement of the paper; scans take too long
ON_PRINT = [
    claim
    for claim in CLAIMS
    if claim.kind not in PAPER
    and re.match("printed|gap_left|computed_over", claim.judgement.measure)
]
FACTS = load_facts()
LONG = re.compile("7[25]-even-shear.*")  # on fine meshes; that of 7.4 is measured alike


def given(claims):
    assert claims
    marks = {True: [pytest.mark.slow], False: []}
    named = [pytest.param(c, id=c.id, marks=marks[bool(LONG.match(c.id))]) for c in claims]
    return pytest.mark.parametrize("claim", named)


def graded(grade, *bases):
    return given([c for c in STATEMENTS if c.grade == grade and (not bases or c.basis in bases)])


@pytest.fixture(scope="session")
def turned(results, request):
    """What turns each statement: found once for all workers, for it takes long."""
    path, quick = results.folder / "turned.json", "not slow" in request.config.option.markexpr
    if not path.exists():
        taken = [c for c in STATEMENTS + ON_PRINT if not (quick and LONG.match(c.id))]
        write_json(path, turned_by(judge(taken, results), results))
    return json.loads(path.read_text())


@pytest.fixture(scope="session")
def facts(turned):
    return facts_of(STATEMENTS, turned, FACTS)


def verdict(claim, results):
    (one,) = judge([claim], results)
    return one


@given(STATEMENTS)
def test_statement_has_the_verdict_of_its_grade(claim, results):
    one = verdict(claim, results)
    assert not one.differs, (one.verdict, one.measured)
    if claim.grade == "consistent by construction":
        assert one.verdict == "by construction"


@graded("reproduced")
def test_another_element_or_law_turns_what_is_reproduced(claim, turned):
    assert {one.name for one in COMPUTED if one.kind in ("element", "law")} & {*turned[claim.id]}


@graded("consistent by construction", "insensitive")
def test_no_element_turns_what_does_not_distinguish_them(claim, turned):
    assert not {one.name for one in COMPUTED if one.kind == "element"} & {*turned[claim.id]}


def test_every_printed_number_is_turned_by_a_misprint(turned):
    found = {name for names in turned.values() for name in names}
    assert {one.name for one in PRINTED} <= found
    for claim in (c for c in STATEMENTS if c.printed):
        computed = claim.grade == "reproduced"  # "around half" of the examples
        assert computed or own_number(claim) in turned[claim.id], claim.id


def test_statements_share_a_fact_if_the_same_mutations_turn_them(turned, facts):
    assert facts.keys() == {claim.id for claim in STATEMENTS}
    of = {claim.id: signature(claim, turned.get(claim.id, ())) for claim in STATEMENTS}
    for one in of:
        for other in of:
            if of[one] and of[other]:
                assert (facts[one] == facts[other]) == (of[one] == of[other]), (one, other)


def test_each_fact_is_one_that_statements_rest_on_and_names_a_test(facts):
    assert {fact.id for fact in FACTS} == {*facts.values()}
    assert len({fact.says for fact in FACTS}) == len(FACTS)
    for fact in FACTS:
        assert all(facts[name] == fact.id for name in fact.statements), fact.id
        path, _, name = fact.test.partition("::")
        module = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        assert name in {one.name for one in module.body if isinstance(one, ast.FunctionDef)}, name


@pytest.mark.parametrize(
    ("number", "expected"),
    [(0.3, (0.2, 0.4)), (76.0, (75.0, 77.0)), (9.6683e9, (9.5683e9, 9.7683e9)), (4.0, (3.0, 5.0))],
)
def test_a_misread_number_has_another_second_digit(number, expected):
    assert misread(number) == pytest.approx(expected)


@graded("reproduced")
def test_reproduced_claim_reads_computed_results(claim, tmp_path):
    assert verdict(claim, Results(tmp_path)).verdict == "not judged"


@graded("consistent by construction", "printed")
def test_arithmetic_on_printed_numbers_needs_no_result(claim, tmp_path):
    assert verdict(claim, Results(tmp_path)).verdict == "by construction"


@graded("consistent by construction", "identity")
def test_identity_gives_a_simple_fraction_to_round_off(claim, results):
    measured = verdict(claim, results).measured
    assert abs(measured - Fraction(measured).limit_denominator(12)) < 1e-9


OTHER_INPUTS = {
    "study.paper.s7_2_block.DIVISIONS": {"divisions": (18, 10)},
    "study.paper.s7_3_parabolic_punch.RADIUS": {"radius": 10.0},
    "study.paper.s7_3_parabolic_punch.DIVISIONS": {"divisions": (18, 4), "increments": 1},
    "study.paper.s7_4_rigid_plate.FORCE": 41.0,
    "study.paper.s7_5_profiles.PROFILES": "first",
    "study.paper.s7_6_buckling.LENGTH": 9.0,
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
            coarse = {"ring_divisions": (4, 1, 7, 4), "height_divisions": (6, 4, 5, 2)}
            monkeypatch.setitem(PROFILES, name, replace(PROFILES[name], **coarse))
        case constant:
            monkeypatch.setattr(claim.chosen, constant)
    assert verdict(claim, ComputedResults(tmp_path, parameters)).verdict == "fails"


@graded("consistent by construction", "input")
def test_input_is_the_number_itself(claim):
    module, _, name = claim.chosen.rpartition(".")
    halves = 2 if "T6" in claim.judgement.args["key"] else 1  # of a square
    assert claim.judgement.value == halves * np.prod(getattr(import_module(module), name))


@graded("not testable")
def test_what_is_not_testable_names_what_is_missing(claim):
    assert claim.missing
    assert claim.missing != claim.grade_why


def test_every_statement_of_the_paper_has_a_grade_and_a_short_quote_and_nothing_else_has():
    assert {claim.grade for claim in CLAIMS if claim.kind not in PAPER} == {None}
    for claim in STATEMENTS:
        assert claim.grade in GRADES, claim.id
        assert 0 < len(claim.quote.split()) <= 25, claim.id
        assert ("implied" in claim.source) == (claim.kind == "implied"), claim.id
        assert claim.kind != "implied" or "this study's" in claim.statement, claim.id

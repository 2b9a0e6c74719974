"""Test that each statement of the paper meets the conditions of its grade.

The author of a claim proposes its grade. A reproduced statement reads computed results, and another
element or law reverses its verdict. A statement is consistent by construction if one of the reasons
that can be checked automatically applies. Statements whose verdicts are reversed by the same
mutations belong to the same fact. All cases needed are computed here; stored results are not used.
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

from study.judge.claims import GRADES, PAPER_KINDS, judge_claims, load_claims
from study.judge.facts import (
    MISPRINT_MUTATIONS,
    RESULT_MUTATIONS,
    assign_facts_to_paper_statements,
    find_mutations_that_reverse_verdicts,
    load_facts,
    misprints_of_second_digit,
    mutations_that_identify_fact,
    name_of_own_number_misprint,
)
from study.paper.s7_5_profiles import PROFILES
from study.run.store import Results, write_json
from tests.study.computed_results import ComputedResults

pytestmark = pytest.mark.xdist_group("statements")  # one worker finds the mutations

ROOT = Path(__file__).parents[2]
CLAIMS = load_claims()
PAPER_STATEMENTS = [claim for claim in CLAIMS if claim.kind in PAPER_KINDS]
# Findings and pins on printed numbers, except those that search many models (too slow)
FINDINGS_ON_PRINTED_NUMBERS = [
    claim
    for claim in CLAIMS
    if claim.kind not in PAPER_KINDS
    and re.match("printed|stress_difference_misfit|computed_deviation", claim.judgement.measure)
]
LISTED_FACTS = load_facts()
SLOW_CLAIM_ID_PATTERN = re.compile(
    "7[25]-even-shear.*"
)  # they need fine meshes; the same measure is tested with section 7.4


def parametrize_claims(claims):
    assert claims
    marks_by_slowness = {True: [pytest.mark.slow], False: []}
    claim_parameters = [
        pytest.param(
            claim, id=claim.id, marks=marks_by_slowness[bool(SLOW_CLAIM_ID_PATTERN.match(claim.id))]
        )
        for claim in claims
    ]
    return pytest.mark.parametrize("claim", claim_parameters)


def parametrize_graded_statements(grade, *bases):
    return parametrize_claims(
        [
            claim
            for claim in PAPER_STATEMENTS
            if claim.grade == grade and (not bases or claim.basis in bases)
        ]
    )


@pytest.fixture(scope="session")
def turning_mutations_by_claim(results, request):
    """Return, for each claim, the names of the mutations of the results that reverse its verdict.

    Finding them takes long; they are found once and stored.
    """
    path, is_quick = results.folder / "turned.json", "not slow" in request.config.option.markexpr
    if not path.exists():
        judged_statements = [
            claim
            for claim in PAPER_STATEMENTS + FINDINGS_ON_PRINTED_NUMBERS
            if not (is_quick and SLOW_CLAIM_ID_PATTERN.match(claim.id))
        ]
        write_json(
            path,
            find_mutations_that_reverse_verdicts(judge_claims(judged_statements, results), results),
        )
    return json.loads(path.read_text())


@pytest.fixture(scope="session")
def fact_ids_by_statement(turning_mutations_by_claim):
    return assign_facts_to_paper_statements(
        PAPER_STATEMENTS, turning_mutations_by_claim, LISTED_FACTS
    )


def judge_claim(claim, results):
    (judged_claim,) = judge_claims([claim], results)
    return judged_claim


@parametrize_claims(PAPER_STATEMENTS)
def test_statement_has_the_verdict_of_its_grade(claim, results):
    judged_claim = judge_claim(claim, results)
    assert not judged_claim.differs, (judged_claim.verdict, judged_claim.measured)
    if claim.grade == "consistent by construction":
        assert judged_claim.verdict == "by construction"


@parametrize_graded_statements("reproduced")
def test_another_element_or_law_turns_each_reproduced_statement(claim, turning_mutations_by_claim):
    assert {
        mutation.name for mutation in RESULT_MUTATIONS if mutation.kind in ("element", "law")
    } & {*turning_mutations_by_claim[claim.id]}


@parametrize_graded_statements("consistent by construction", "insensitive")
def test_no_element_turns_statements_that_do_not_distinguish_elements(
    claim, turning_mutations_by_claim
):
    assert not {mutation.name for mutation in RESULT_MUTATIONS if mutation.kind == "element"} & {
        *turning_mutations_by_claim[claim.id]
    }


def test_a_misprint_of_any_printed_number_turns_a_statement(turning_mutations_by_claim):
    turning_mutations = {name for names in turning_mutations_by_claim.values() for name in names}
    assert {mutation.name for mutation in MISPRINT_MUTATIONS} <= turning_mutations
    for claim in (statement for statement in PAPER_STATEMENTS if statement.printed):
        is_computed = claim.grade == "reproduced"  # e.g. "around half"
        assert (
            is_computed
            or name_of_own_number_misprint(claim) in turning_mutations_by_claim[claim.id]
        ), claim.id


def test_statements_share_a_fact_if_the_same_mutations_turn_them(
    turning_mutations_by_claim, fact_ids_by_statement
):
    assert fact_ids_by_statement.keys() == {claim.id for claim in PAPER_STATEMENTS}
    signatures = {
        claim.id: mutations_that_identify_fact(claim, turning_mutations_by_claim.get(claim.id, ()))
        for claim in PAPER_STATEMENTS
    }
    for statement_id in signatures:
        for other_id in signatures:
            if signatures[statement_id] and signatures[other_id]:
                assert (fact_ids_by_statement[statement_id] == fact_ids_by_statement[other_id]) == (
                    signatures[statement_id] == signatures[other_id]
                ), (statement_id, other_id)


def test_each_fact_supports_a_statement_and_names_an_existing_test(fact_ids_by_statement):
    assert {fact.id for fact in LISTED_FACTS} == {*fact_ids_by_statement.values()}
    assert len({fact.says for fact in LISTED_FACTS}) == len(LISTED_FACTS)
    for fact in LISTED_FACTS:
        assert all(fact_ids_by_statement[name] == fact.id for name in fact.statements), fact.id
        path, _, test_name = fact.test.partition("::")
        module = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        assert test_name in {
            definition.name for definition in module.body if isinstance(definition, ast.FunctionDef)
        }, test_name


@pytest.mark.parametrize(
    ("number", "expected"),
    [(0.3, (0.2, 0.4)), (76.0, (75.0, 77.0)), (9.6683e9, (9.5683e9, 9.7683e9)), (4.0, (3.0, 5.0))],
)
def test_misread_digits_change_the_second_digit_or_the_only_one(number, expected):
    assert misprints_of_second_digit(number) == pytest.approx(expected)


@parametrize_graded_statements("reproduced")
def test_reproduced_claim_is_not_judged_without_results(claim, tmp_path):
    assert judge_claim(claim, Results(tmp_path)).verdict == "not judged"


@parametrize_graded_statements("consistent by construction", "printed")
def test_arithmetic_on_printed_numbers_needs_no_result(claim, tmp_path):
    assert judge_claim(claim, Results(tmp_path)).verdict == "by construction"


@parametrize_graded_statements("consistent by construction", "identity")
def test_identity_gives_a_simple_fraction_to_round_off(claim, results):
    measured = judge_claim(claim, results).measured
    assert abs(measured - Fraction(measured).limit_denominator(12)) < 1e-9


CHANGED_INPUTS_BY_CONSTANT = {
    "study.paper.s7_2_block.DIVISIONS": {"divisions": (18, 10)},
    "study.paper.s7_3_parabolic_punch.RADIUS": {"radius": 10.0},
    "study.paper.s7_3_parabolic_punch.DIVISIONS": {"divisions": (18, 4), "increments": 1},
    "study.paper.s7_4_rigid_plate.FORCE": 41.0,
    "study.paper.s7_5_profiles.PROFILES": "first",
    "study.paper.s7_6_buckling.LENGTH": 9.0,
}
"""Map from each constant that is an input or was fitted to another value.

A dictionary replaces parameters of the cases, a string names a profile to be meshed more coarsely,
and any other value replaces the constant.
"""


@parametrize_graded_statements("consistent by construction", "input", "fit")
def test_claim_fails_with_another_input_or_fitted_value(claim, monkeypatch, tmp_path):
    """A claim that holds because of an input or fitted value fails with another value.

    Its agreement with the printed number is a consequence of the chosen value.
    """
    parameters = {}
    match CHANGED_INPUTS_BY_CONSTANT[claim.chosen]:
        case dict(parameters):
            pass
        case str(name):
            coarse_divisions = {"ring_divisions": (4, 1, 7, 4), "height_divisions": (6, 4, 5, 2)}
            monkeypatch.setitem(PROFILES, name, replace(PROFILES[name], **coarse_divisions))
        case constant:
            monkeypatch.setattr(claim.chosen, constant)
    assert judge_claim(claim, ComputedResults(tmp_path, parameters)).verdict == "fails"


@parametrize_graded_statements("consistent by construction", "input")
def test_input_constant_is_the_number_of_the_statement(claim):
    module, _, constant_name = claim.chosen.rpartition(".")
    n_halves = 2 if "T6" in claim.judgement.args["key"] else 1  # triangles: two for each square
    assert claim.judgement.value == n_halves * np.prod(
        getattr(import_module(module), constant_name)
    )


@parametrize_graded_statements("not testable")
def test_untestable_statement_names_what_is_missing(claim):
    assert claim.missing
    assert claim.missing != claim.grade_why


def test_every_statement_of_the_paper_has_a_grade_and_a_short_quote_and_nothing_else_has():
    assert {claim.grade for claim in CLAIMS if claim.kind not in PAPER_KINDS} == {None}
    for claim in PAPER_STATEMENTS:
        assert claim.grade in GRADES, claim.id
        assert 0 < len(claim.quote.split()) <= 25, claim.id
        assert ("implied" in claim.source) == (claim.kind == "implied"), claim.id
        assert claim.kind != "implied" or "this study's" in claim.statement, claim.id

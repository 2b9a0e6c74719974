"""Test that errors name every mistake in a file of claims and that verdicts follow from numbers."""

import json

import jsonschema
import pytest

from study.judge.claims import (
    SCHEMA_FILE,
    claims_from_pins,
    format_verdict_table,
    judge_claims,
    load_claims,
    read_claims,
    summarise_verdicts,
    write_claims,
)
from study.run.store import Result, Results, StudyError, save
from tests.study.toystudy import TOY_MEASURES_MODULE, make_claim_toml, make_finding_toml

PIN_ENTRY = {
    "id": "number",
    "source": "This study, section 1",
    "statement": "It is five.",
    "measure": "scalar",
    "args": {"key": "1/b", "name": "y"},
    "relation": "=",
    "bound": 5.0,
    "tolerance": 1e-12,
}
CONTRADICTED_GRADE_TOML = '"contradicted"'
BY_CONSTRUCTION_GRADE_TOML = '"consistent by construction"'
PINNED_NUMBER_CLAIM_CHANGES = {"found": 1, "found_tol": 0}
NOT_TESTABLE_CLAIM_CHANGES = {
    "grade": '"not testable"',
    "missing": '"A second force."',
    **dict.fromkeys(
        ("measure", "args", "relation", "value", "tol", "tol_why", "tol_set", "why", "unit")
    ),
}


@pytest.fixture
def results(tmp_path):
    save(tmp_path, "1", "b", Result({"y": 5.0}, {"y": "N"}), {"problem": "toy"}, {})
    return Results(tmp_path)


@pytest.fixture
def read_toml_claims(tmp_path):
    def write_and_read_claims(*texts):
        path = tmp_path / "claims.toml"
        path.write_text("\n".join(texts))
        return read_claims([path], TOY_MEASURES_MODULE)

    return write_and_read_claims


def judge_changed_claim(read_toml_claims, results, **changes):
    (judged_claim,) = judge_claims(read_toml_claims(make_claim_toml(**changes)), results)
    return judged_claim


@pytest.mark.parametrize(
    ("relation", "holding_values_and_tolerances", "failing_values_and_tolerances"),
    [
        ("=", [(5.0, 0.0), (5.25, 0.25), (4.75, 0.25)], [(5.25, 0.125), (4.75, 0.125)]),
        ("<", [(5.0, 0.25)], [(5.0, 0.0), (4.75, 0.25)]),
        ("<=", [(5.0, 0.0), (4.75, 0.25)], [(4.5, 0.25)]),
        (">", [(5.0, 0.25)], [(5.0, 0.0), (5.25, 0.25)]),
        (">=", [(5.0, 0.0), (5.25, 0.25)], [(5.5, 0.25)]),
    ],
)
def test_verdict_follows_from_relation_and_tolerance(
    read_toml_claims,
    results,
    relation,
    holding_values_and_tolerances,
    failing_values_and_tolerances,
):
    for expected, values_and_tolerances in (
        ("holds", holding_values_and_tolerances),
        ("fails", failing_values_and_tolerances),
    ):
        for value, tol in values_and_tolerances:
            judged_claim = judge_changed_claim(
                read_toml_claims, results, relation=f'"{relation}"', value=value, tol=tol
            )
            assert (judged_claim.measured, judged_claim.verdict) == (5.0, expected)
            assert judged_claim.differs == (expected == "fails")


def test_arguments_reach_the_measure(read_toml_claims, results):
    args = '{ key = "1/b", name = "y", factor = 2.0 }'
    assert judge_changed_claim(read_toml_claims, results, args=args).measured == 10.0


@pytest.mark.parametrize(("pinned_number", "differs"), [(5.1, False), (4.5, True), (5.5, True)])
def test_pinned_failure_with_another_number_differs(
    read_toml_claims, results, pinned_number, differs
):
    judged_claim = judge_changed_claim(
        read_toml_claims,
        results,
        value=1,
        grade=CONTRADICTED_GRADE_TOML,
        found=pinned_number,
        found_tol=0.2,
    )
    assert (judged_claim.verdict, judged_claim.differs) == ("fails", differs)
    assert judged_claim.expected_verdict == f"fails with {pinned_number} ± 0.2"


@pytest.mark.parametrize(
    ("changes", "expected_verdict"),
    [
        ({"grade": BY_CONSTRUCTION_GRADE_TOML, "basis": '"identity"'}, "by construction"),
        ({"grade": BY_CONSTRUCTION_GRADE_TOML, "basis": '"identity"', "value": 4.0}, "fails"),
        (
            {"grade": '"not explained"', "value": 1.0, "found": 5.0, "found_tol": 0.1},
            "not explained",
        ),
        ({"grade": '"not explained"', "found": 5.0, "found_tol": 0.1}, "holds"),
    ],
)
def test_grade_turns_holds_into_by_construction_and_fails_into_not_explained(
    read_toml_claims, results, changes, expected_verdict
):
    judged_claim = judge_changed_claim(read_toml_claims, results, **changes)
    assert judged_claim.verdict == expected_verdict
    assert judged_claim.differs == (expected_verdict in ("fails", "holds"))


@pytest.mark.parametrize(
    ("factor", "expected_verdict"), [(0.1, "holds"), (1.0, "not judged: no reference")]
)
def test_reference_is_accepted_if_its_error_is_below_a_third_of_the_tolerance(
    read_toml_claims, results, factor, expected_verdict
):
    args = f'{{ key = "1/b", name = "y", factor = {factor} }}'
    reference = f'{{ measure = "value", args = {args} }}'
    judged_claim = judge_changed_claim(
        read_toml_claims, results, value=4.0, tol=2.0, reference=reference
    )
    assert (judged_claim.verdict, judged_claim.measured) == (expected_verdict, 5.0)
    not_testable_entries = {
        "grade": NOT_TESTABLE_CLAIM_CHANGES["grade"],
        "missing": NOT_TESTABLE_CLAIM_CHANGES["missing"],
    }
    assert judge_changed_claim(
        read_toml_claims, results, tol=2.0, reference=reference, **not_testable_entries
    ).differs == (factor == 0.1)


def test_claim_without_result_is_not_judged(read_toml_claims, results):
    judged_claim = judge_changed_claim(
        read_toml_claims, results, args='{ key = "7/no", name = "y" }'
    )
    assert (judged_claim.verdict, judged_claim.measured, judged_claim.differs) == (
        "not judged",
        None,
        True,
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"colour": '"red"'}, "the-claim: colour"),
        ({"why": None}, "the-claim: why is missing"),
        ({"value": "nan"}, "the-claim: value cannot be nan"),
        ({"relation": '"=="'}, "the-claim: relation is '=='"),
        ({"pinned": '"holds"'}, "the-claim: pinned is not a key of it"),
        ({"grade": CONTRADICTED_GRADE_TOML, "found": 1}, "the-claim: found_tol is missing"),
        ({"found": 1.0}, "the-claim: found belongs to statements that fail"),
        ({"measure": '"velocity"'}, "the-claim: measure 'velocity' is not in toy_measures"),
        ({"args": '{ key = "1/b" }'}, "the-claim: args do not suit value: .*'name'"),
        (
            {"grade": CONTRADICTED_GRADE_TOML, "basis": '"fit"', **PINNED_NUMBER_CLAIM_CHANGES},
            "the-claim: basis is not a key",
        ),
        ({"reference": '{ measure = "value" }'}, "the-claim: reference.args is missing"),
        ({"grade": BY_CONSTRUCTION_GRADE_TOML}, "the-claim: basis is missing"),
        ({"grade": BY_CONSTRUCTION_GRADE_TOML, "basis": '"fit"'}, "the-claim: chosen is missing"),
        ({"grade": '"not testable"'}, "the-claim: missing is missing"),
        ({"grade": '"not testable"', "missing": '"x"'}, "the-claim: (args|measure) is not a key"),
        ({"reading_of": '"another"'}, "the-claim: reading_of names no other claim"),
    ],
)
def test_error_of_a_malformed_claim_names_claim_and_key(read_toml_claims, changes, message):
    with pytest.raises(StudyError, match=message):
        read_toml_claims(make_claim_toml(**changes))


def test_only_statements_of_the_paper_have_grades(read_toml_claims):
    (claim_read,) = read_toml_claims(make_finding_toml())
    assert (claim_read.kind, claim_read.grade) == ("finding", None)
    with pytest.raises(StudyError, match="finding the-claim: grade is not a key of it"):
        read_toml_claims(make_finding_toml(grade='"reproduced"'))


def test_untestable_statement_has_no_measure_and_never_differs(read_toml_claims, results):
    (judged_claim,) = judge_claims(
        read_toml_claims(make_claim_toml(**NOT_TESTABLE_CLAIM_CHANGES)), results
    )
    assert (judged_claim.verdict, judged_claim.measured, judged_claim.differs) == (
        "not testable",
        None,
        False,
    )
    assert "not testable" in format_verdict_table([judged_claim])


@pytest.mark.parametrize(
    "text", ["[[claim]", "title = 1", "claim = 3", make_claim_toml() + make_claim_toml()]
)
def test_error_names_file_of_malformed_toml_or_claim_with_repeated_id(read_toml_claims, text):
    with pytest.raises(StudyError, match=r"claims\.toml|the-claim: its id"):
        read_toml_claims(text)


@pytest.mark.parametrize(
    ("measure", "message"),
    [("broken", "broken failed with ZeroDivisionError"), ("nothing", "nothing gave nan")],
)
def test_error_names_a_failing_measure_and_its_claim(read_toml_claims, results, measure, message):
    with pytest.raises(StudyError, match=f"the-claim: {message}"):
        judge_changed_claim(read_toml_claims, results, measure=f'"{measure}"', args=None)


def test_claims_are_written_with_verdict_fact_and_turning_mutations(read_toml_claims, results):
    judged_claims = judge_claims(
        read_toml_claims(
            make_claim_toml(), make_claim_toml(id='"other"', args='{ key = "7/no", name = "y" }')
        ),
        results,
    )
    write_claims(
        results.folder, judged_claims, {"the-claim": "force"}, {"the-claim": ("exchange",)}
    )
    first, second = results.claims()
    assert first == {
        "id": "the-claim", "kind": "paper", "source": "Sec. 1, Eq. 3", "quote": "a force of 5",
        "statement": "The force is 5 N.", "reading_of": None, "grade": "reproduced",
        "grade_why": "A computed force.", "basis": None, "missing": None, "measured": 5.0,
        "relation": "=", "value": 5.0, "tol": 1e-12, "verdict": "holds", "pinned": "holds",
        "differs": False, "why": "Twice 2.5.", "unit": "N", "tol_why": "Round-off.",
        "tol_set": "after", "fact": "force", "turned_by": ["exchange"],
    }  # fmt: skip
    assert (second["fact"], second["turned_by"]) == (None, [])
    assert second["measured"] is None
    assert json.loads((results.folder / "claims.json").read_text()) == [first, second]


def test_summary_counts_verdicts_and_table_lists_differing_claims(read_toml_claims, results):
    judged_claims = judge_claims(
        read_toml_claims(
            make_claim_toml(),
            make_claim_toml(id='"wrong"', value=4.0),
            make_claim_toml(id='"absent"', args='{ key = "7/no", name = "y" }'),
            make_claim_toml(id='"open"', **NOT_TESTABLE_CLAIM_CHANGES),
            make_finding_toml(id='"own"'),
        )
        + claims_from_pins([PIN_ENTRY]),
        results,
    )
    assert summarise_verdicts(judged_claims) == (
        "4 statements of the paper: 3 reproduced, 1 not testable; 1 findings: 1 hold, 0 fail; "
        "1 pins: 1 hold, 0 fail; 1 not judged; 1 other than pinned"
    )
    lines = format_verdict_table(
        [judged_claim for judged_claim in judged_claims if judged_claim.differs]
    ).splitlines()
    assert [line.split()[0] for line in lines] == ["wrong", "absent"]
    assert "= 4 ± 1e-12" in lines[0]
    assert lines[0].endswith("fails, pinned: holds")
    assert format_verdict_table([]) == ""


def test_schema_of_claims_is_a_valid_json_schema():
    jsonschema.Draft202012Validator.check_schema(json.loads(SCHEMA_FILE.read_bytes()))


def test_claims_of_the_study_can_be_loaded_and_are_of_four_kinds():
    assert {loaded_claim.kind for loaded_claim in load_claims()} == {
        "paper",
        "implied",
        "finding",
        "pin",
    }

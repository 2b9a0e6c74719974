"""Claims: every mistake in the file is named, and the verdict follows from the numbers alone."""

import json

import jsonschema
import pytest

from study.judge.claims import (
    SCHEMA,
    claims_of_pins,
    judge,
    load_claims,
    read_claims,
    summary,
    table,
    write,
)
from study.run.store import Result, Results, StudyError, save
from tests.study.toystudy import MEASURED, claim, finding

PIN = {
    "id": "number",
    "source": "This study, section 1",
    "statement": "It is five.",
    "measure": "scalar",
    "args": {"key": "1/b", "name": "y"},
    "relation": "=",
    "bound": 5.0,
    "tolerance": 1e-12,
}
CONTRADICTED = '"contradicted"'
CONSTRUCTED = '"consistent by construction"'
FOUND = {"found": 1, "found_tol": 0}
NOT_TESTABLE = {
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
def load(tmp_path):
    def read(*texts):
        path = tmp_path / "claims.toml"
        path.write_text("\n".join(texts))
        return read_claims([path], MEASURED)

    return read


def verdict(load, results, **changes):
    (one,) = judge(load(claim(**changes)), results)
    return one


@pytest.mark.parametrize(
    ("relation", "holds", "fails"),
    [
        ("=", [(5.0, 0.0), (5.25, 0.25), (4.75, 0.25)], [(5.25, 0.125), (4.75, 0.125)]),
        ("<", [(5.0, 0.25)], [(5.0, 0.0), (4.75, 0.25)]),
        ("<=", [(5.0, 0.0), (4.75, 0.25)], [(4.5, 0.25)]),
        (">", [(5.0, 0.25)], [(5.0, 0.0), (5.25, 0.25)]),
        (">=", [(5.0, 0.0), (5.25, 0.25)], [(5.5, 0.25)]),
    ],
)
def test_verdict_follows_from_relation_and_tolerance(load, results, relation, holds, fails):
    for expected, numbers in (("holds", holds), ("fails", fails)):
        for value, tol in numbers:
            one = verdict(load, results, relation=f'"{relation}"', value=value, tol=tol)
            assert (one.measured, one.verdict) == (5.0, expected)
            assert one.differs == (expected == "fails")


def test_arguments_reach_the_measure(load, results):
    args = '{ key = "1/b", name = "y", factor = 2.0 }'
    assert verdict(load, results, args=args).measured == 10.0


@pytest.mark.parametrize(("found", "differs"), [(5.1, False), (4.5, True), (5.5, True)])
def test_pinned_failure_with_another_number_differs(load, results, found, differs):
    one = verdict(load, results, value=1, grade=CONTRADICTED, found=found, found_tol=0.2)
    assert (one.verdict, one.differs) == ("fails", differs)
    assert one.expected == f"fails with {found} ± 0.2"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"grade": CONSTRUCTED, "basis": '"identity"'}, "by construction"),
        ({"grade": CONSTRUCTED, "basis": '"identity"', "value": 4.0}, "fails"),
        (
            {"grade": '"not explained"', "value": 1.0, "found": 5.0, "found_tol": 0.1},
            "not explained",
        ),
        ({"grade": '"not explained"', "found": 5.0, "found_tol": 0.1}, "holds"),
    ],
)
def test_what_cannot_fail_does_not_hold_and_what_is_not_explained_does_not_fail(
    load, results, changes, expected
):
    one = verdict(load, results, **changes)
    assert one.verdict == expected
    assert one.differs == (expected in ("fails", "holds"))


@pytest.mark.parametrize(
    ("factor", "expected"), [(0.1, "holds"), (1.0, "not judged: no reference")]
)
def test_a_reference_is_one_if_its_error_is_below_a_third_of_the_tolerance(
    load, results, factor, expected
):
    args = f'{{ key = "1/b", name = "y", factor = {factor} }}'
    reference = f'{{ measure = "value", args = {args} }}'
    one = verdict(load, results, value=4.0, tol=2.0, reference=reference)
    assert (one.verdict, one.measured) == (expected, 5.0)
    open_ = {"grade": NOT_TESTABLE["grade"], "missing": NOT_TESTABLE["missing"]}
    assert verdict(load, results, tol=2.0, reference=reference, **open_).differs == (factor == 0.1)


def test_claim_without_result_is_not_judged(load, results):
    one = verdict(load, results, args='{ key = "7/no", name = "y" }')
    assert (one.verdict, one.measured, one.differs) == ("not judged", None, True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"colour": '"red"'}, "the-claim: colour"),
        ({"why": None}, "the-claim: why is missing"),
        ({"value": "nan"}, "the-claim: value cannot be nan"),
        ({"relation": '"=="'}, "the-claim: relation is '=='"),
        ({"pinned": '"holds"'}, "the-claim: pinned is not a key of it"),
        ({"grade": CONTRADICTED, "found": 1}, "the-claim: found_tol is missing"),
        ({"found": 1.0}, "the-claim: found belongs to statements that fail"),
        ({"measure": '"velocity"'}, "the-claim: measure 'velocity' is not in toy_measures"),
        ({"args": '{ key = "1/b" }'}, "the-claim: args do not suit value: .*'name'"),
        ({"grade": CONTRADICTED, "basis": '"fit"', **FOUND}, "the-claim: basis is not a key"),
        ({"reference": '{ measure = "value" }'}, "the-claim: reference.args is missing"),
        ({"grade": CONSTRUCTED}, "the-claim: basis is missing"),
        ({"grade": CONSTRUCTED, "basis": '"fit"'}, "the-claim: chosen is missing"),
        ({"grade": '"not testable"'}, "the-claim: missing is missing"),
        ({"grade": '"not testable"', "missing": '"x"'}, "the-claim: (args|measure) is not a key"),
        ({"reading_of": '"another"'}, "the-claim: reading_of names no other claim"),
    ],
)
def test_mistake_is_named_by_claim_and_key(load, changes, message):
    with pytest.raises(StudyError, match=message):
        load(claim(**changes))


def test_grades_are_the_paper_s_alone(load):
    (one,) = load(finding())
    assert (one.kind, one.grade) == ("finding", None)
    with pytest.raises(StudyError, match="finding the-claim: grade is not a key of it"):
        load(finding(grade='"reproduced"'))


def test_what_is_not_testable_has_no_measure_and_never_differs(load, results):
    (one,) = judge(load(claim(**NOT_TESTABLE)), results)
    assert (one.verdict, one.measured, one.differs) == ("not testable", None, False)
    assert "not testable" in table([one])


@pytest.mark.parametrize("text", ["[[claim]", "title = 1", "claim = 3", claim() + claim()])
def test_file_that_is_no_list_of_different_claims_is_named(load, text):
    with pytest.raises(StudyError, match=r"claims\.toml|the-claim: its id"):
        load(text)


@pytest.mark.parametrize(
    ("measure", "message"),
    [("broken", "broken failed with ZeroDivisionError"), ("nothing", "nothing gave nan")],
)
def test_measure_that_breaks_is_named_with_its_claim(load, results, measure, message):
    with pytest.raises(StudyError, match=f"the-claim: {message}"):
        verdict(load, results, measure=f'"{measure}"', args=None)


def test_verdicts_are_written_for_the_report(load, results):
    found = judge(load(claim(), claim(id='"other"', args='{ key = "7/no", name = "y" }')), results)
    write(results.folder, found, {"the-claim": "force"}, {"the-claim": ("exchange",)})
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


def test_summary_counts_and_table_names(load, results):
    found = judge(
        load(
            claim(),
            claim(id='"wrong"', value=4.0),
            claim(id='"absent"', args='{ key = "7/no", name = "y" }'),
            claim(id='"open"', **NOT_TESTABLE),
            finding(id='"own"'),
        )
        + claims_of_pins([PIN]),
        results,
    )
    assert summary(found) == (
        "4 statements of the paper: 3 reproduced, 1 not testable; 1 findings: 1 hold, 0 fail; "
        "1 pins: 1 hold, 0 fail; 1 not judged; 1 other than pinned"
    )
    lines = table([one for one in found if one.differs]).splitlines()
    assert [line.split()[0] for line in lines] == ["wrong", "absent"]
    assert "= 4 ± 1e-12" in lines[0]
    assert lines[0].endswith("fails, pinned: holds")
    assert table([]) == ""


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(json.loads(SCHEMA.read_bytes()))


def test_the_paper_s_own_claims_are_well_formed():
    assert {claim.kind for claim in load_claims()} == {"paper", "implied", "finding", "pin"}

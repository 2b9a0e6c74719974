"""Test records of costly results, and the command that renews and checks them."""

import copy
import json
import operator
import re
from dataclasses import replace
from datetime import date
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import study.publish.command
from study.benchmarks.k_cost import measure
from study.paper.table_1 import ensemble
from study.paper.table_1 import family as shifts
from study.paper.table_2 import family as buckling_models
from study.publish import renew_records
from study.run import records
from study.run.cases import load_section
from study.run.store import StudyError
from study.solutions.calculix import calculix

QUICK_CASE_KEY, TIMED_CASE_KEY = "V13/square-own-64", "Q/seconds-penalty-16"
COSTLY_CASES_BY_KEY = renew_records.find_costly_cases()
RECORD_KINDS = renew_records.list_record_kinds()


def read_rows_of_costly_cases():
    return records.read_rows(records.COSTLY_CASES)


@pytest.mark.parametrize("kind", RECORD_KINDS, ids=operator.attrgetter("title"))
def test_rows_of_a_record_have_complete_headers_and_known_keys(kind):
    rows = records.read_rows(kind.path)
    assert rows.keys() <= set(kind.list_keys())
    # Costly cases without a row are computed
    if not isinstance(kind, renew_records.CostlyCaseRecords):
        assert rows.keys() == set(kind.list_keys())
    for key, row in rows.items():
        assert [other for other in RECORD_KINDS if other.may_have_key(key)] == [kind]
        assert row.versions
        assert date(2026, 11, 1) <= date.fromisoformat(row.date)
        assert re.fullmatch("[0-9a-f]{64}", row.input_sha256)
        assert (row.machine is not None) is isinstance(kind, renew_records.TimeAndMemoryRecords)


def test_rows_of_costly_cases_have_their_parameters_and_digest():
    for key, row in read_rows_of_costly_cases().items():
        assert row.content["parameters"] == COSTLY_CASES_BY_KEY[key].stored_parameters
        assert row.input_sha256 == records.digest_input(COSTLY_CASES_BY_KEY[key].stored_parameters)


def test_measured_rows_have_the_digest_of_their_measurement():
    for row in records.read_rows(records.TIME_AND_MEMORY).values():
        assert row.key == measure.measurement_from_record_row(row).key
        assert row.input_sha256 == records.digest_input(row.content["row"])


def test_rows_of_tables_have_the_digests_of_their_columns_models_and_treatments():
    for path, digests in (
        (records.TABLE_1_COLUMNS, map(ensemble.digest_input, ensemble.SUPPORTS)),
        (records.TABLE_1_SHIFTS, map(shifts.digest_input, ensemble.read_columns())),
        (records.TABLE_2, map(buckling_models.digest_input, buckling_models.MESHES)),
    ):
        assert [row.input_sha256 for row in records.read_rows(path).values()] == list(digests)


def test_only_costly_cases_are_recorded():
    assert all(map(records.takes_long_enough_to_record, read_rows_of_costly_cases().values()))


def test_rows_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "record.json"
    rows = [
        records.create_row_with_current_date("V1/a", "0" * 64, {"scalars": {"y": 0.1 + 0.2}}),
        records.create_row_with_current_date(
            "K/b", "1" * 64, {}, {"calculix": "2.20"}, "a machine"
        ),
        records.create_row_with_current_date(
            "table-2/c", "2" * 64, {"x": [[1, None], []], "what": "[a, \n b]"}
        ),
    ]
    assert records.read_rows(path) == {}
    records.write_rows(path, rows)
    assert list(records.read_rows(path).values()) == rows


@pytest.mark.parametrize("text", ["{", "[]", '{"rows": [{"key": "V1/a"}]}'])
def test_a_file_of_another_format_is_refused_with_its_name(tmp_path, text):
    path = tmp_path / "record.json"
    path.write_text(text)
    with pytest.raises(StudyError, match=r"record\.json is no record"):
        records.read_rows(path)


def test_two_rows_of_one_key_are_refused(tmp_path):
    records.write_rows(
        tmp_path / "record.json", 2 * [records.create_row_with_current_date("V1/a", "", {})]
    )
    with pytest.raises(StudyError, match="two rows of V1/a"):
        records.read_rows(tmp_path / "record.json")


@pytest.mark.parametrize("section", sorted({case.section for case in COSTLY_CASES_BY_KEY.values()}))
def test_sections_read_costly_cases_from_the_record(section):
    section_cases = {case.key: case for case in load_section(section).cases}
    for key, costly_case in COSTLY_CASES_BY_KEY.items():
        if costly_case.section == section and key in read_rows_of_costly_cases():
            case = section_cases[key]
            assert case.record == "study/run/recorded/costly_cases.json"
            assert case.computing_case == costly_case
            assert costly_case.stored_parameters.items() <= case.stored_parameters.items()
            assert case.run(**case.parameters).dofs > 0


def test_a_record_of_other_parameters_is_not_read(tmp_path, monkeypatch):
    key, row = next(iter(read_rows_of_costly_cases().items()))
    monkeypatch.setattr(records, "COSTLY_CASES", tmp_path / "record.json")
    row_of_other_parameters = replace(
        row, input_sha256=records.digest_input({"problem": "another"})
    )
    records.write_rows(records.COSTLY_CASES, [row_of_other_parameters])
    (case,) = (
        listed_case
        for listed_case in load_section(COSTLY_CASES_BY_KEY[key].section).cases
        if listed_case.key == key
    )
    assert not case.record


def test_check_of_costly_cases_ignores_times_and_notices_a_changed_number(
    tmp_path, monkeypatch, capsys
):
    cases = {
        key: replace(find_case_by_key(key), costly=True) for key in (QUICK_CASE_KEY, TIMED_CASE_KEY)
    }
    monkeypatch.setattr(renew_records, "find_costly_cases", lambda: cases)
    monkeypatch.setattr(records, "COSTLY_CASES", tmp_path / "record.json")
    monkeypatch.setattr(records, "COSTLY_SECONDS", 0.0)
    assert renew_records.main(["[QV]*"]) == 0  # writes both rows
    assert renew_records.main(["--check", *cases]) == 0  # ignores the CPU times, which have changed
    content = json.loads(records.COSTLY_CASES.read_text())
    content["rows"][0]["scalars"]["nodes"] += 1
    records.COSTLY_CASES.write_text(json.dumps(content))
    assert renew_records.main(["--check", QUICK_CASE_KEY]) == 1
    assert "TOO LARGE: V13/square-own-64 nodes 128 and 127" in capsys.readouterr().out
    assert renew_records.main([QUICK_CASE_KEY]) == 0  # renews this row and keeps the other
    assert list(read_rows_of_costly_cases()) == list(cases)
    assert renew_records.main(["--check", QUICK_CASE_KEY]) == 0


def find_case_by_key(key):
    if key in COSTLY_CASES_BY_KEY:
        return COSTLY_CASES_BY_KEY[key]
    (case,) = (
        listed_case
        for listed_case in load_section(key.partition("/")[0]).cases
        if listed_case.key == key
    )
    return case


def test_check_of_costs_compares_counts_and_not_times(monkeypatch, capsys):
    key = "K/contact-pw-T10-5-Iterative"
    row = records.read_rows(records.TIME_AND_MEMORY)[key]

    def make_measure_of_changed_numbers(**changes):
        measured = row.content["measured"] | {"seconds": 99.0, "iterations": 9} | changes
        return lambda *_: replace(row, content=row.content | {"measured": measured})

    monkeypatch.setattr(measure, "measure_and_make_record_row", make_measure_of_changed_numbers())
    assert renew_records.main(["--check", key]) == 0
    monkeypatch.setattr(
        measure, "measure_and_make_record_row", make_measure_of_changed_numbers(sticking=1.0)
    )
    assert renew_records.main(["--check", key]) == 1
    assert f"TOO LARGE: {key} sticking" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("TABLE_1_COLUMNS", "table-1-columns/4"),
        ("TABLE_1_SHIFTS", "table-1-shifts/1-1"),
        ("TABLE_2", "table-2/right-2x1"),
    ],
)
def test_check_of_tables_notices_a_changed_digit_and_another_input(
    name, key, tmp_path, monkeypatch, capsys
):
    """The computation is replaced; tests of sections 7.5 and 7.6 compute some rows."""
    rows = records.read_rows(getattr(records, name))
    (kind,) = (kind for kind in RECORD_KINDS if kind.may_have_key(key))
    monkeypatch.setattr(records, name, tmp_path / "record.json")
    monkeypatch.setattr(import_module(kind.module_name), "compute_row", lambda key: rows[key])
    assert renew_records.main(["--check", key]) == 1
    assert renew_records.main([key]) == 0  # writes the row
    assert list(records.read_rows(tmp_path / "record.json").values()) == [rows[key]]
    assert renew_records.main(["--check", key]) == 0
    content = copy.deepcopy(rows[key].content)
    if name == "TABLE_1_COLUMNS":
        content["least"] += 2e-3
    else:
        content["six" if name == "TABLE_1_SHIFTS" else "new_mode_2"][-1][-1] += 4
    records.write_rows(tmp_path / "record.json", [replace(rows[key], content=content)])
    assert renew_records.main(["--check", key]) == 1
    records.write_rows(tmp_path / "record.json", [replace(rows[key], input_sha256="0" * 64)])
    assert renew_records.main(["--check", key]) == 1
    messages = [line.partition(" (")[0] for line in capsys.readouterr().err.splitlines()]
    assert [message for message in messages if message.startswith("renew_records")] == [
        f"renew_records: {key}: not in the record",
        f"renew_records: {key}: differs by {'2.0e+01' if name == 'TABLE_1_COLUMNS' else '4.0e+00'}",
        f"renew_records: {key}: the input is not the one of the record",
    ]


def test_columns_differ_by_their_lengths_and_infinitely_by_their_meshes():
    row = records.read_rows(records.TABLE_1_COLUMNS)["table-1-columns/1"]
    columns = row.content["columns"]
    (topology, lengths, *ends), *others = columns
    longer = [topology, [lengths[0] + 3e-7, *lengths[1:]], *ends]
    for changed_columns, difference in (
        (columns, 0.0),
        ([longer, *others], pytest.approx(3.0)),
        (others, np.inf),
        ([*others, columns[0]], np.inf),
    ):
        changed_row = replace(row, content=row.content | {"columns": changed_columns})
        assert ensemble.difference_of_rows(changed_row, row) == difference


@pytest.mark.parametrize(
    "key", ["V13/square-own-65", "K/none-*", "calculix/none", "table-1-shifts/2-*"]
)
def test_unknown_keys_are_refused(key, capsys):
    with pytest.raises(SystemExit):
        renew_records.main([key])
    assert f"{key}, but " in capsys.readouterr().err


def test_check_reports_skipped_rows_where_calculix_is_not_installed(monkeypatch, capsys):
    monkeypatch.setattr(calculix, "find_calculix", lambda: None)
    assert renew_records.main(["--check", "calculix/block-*", "K/*-CalculiX"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["SKIPPED", "SKIPPED"]
    assert "10 rows of answers of CalculiX: ccx" in lines[0]


def test_docs_and_usage_give_the_recorded_computing_times():
    """The times stated in docs/study.md and in the usage of `./run study` follow from the records.

    They are the CPU time of all costly cases and the time of all repeated runs of section K.
    """
    costly_minutes = round(
        sum(row.content["seconds"] for row in read_rows_of_costly_cases().values()) / 60
    )
    run_seconds = [
        row.content["measured"]["whole_seconds"]
        for row in records.read_rows(records.TIME_AND_MEMORY).values()
        if measure.is_measured_without_peers(measure.measurement_from_record_row(row))
    ]
    n_runs = [
        1 if seconds > measure.LONG_RUN_SECONDS else measure.N_RUNS for seconds in run_seconds
    ]
    cost_minutes = round(sum(map(operator.mul, run_seconds, n_runs)) / 60)
    study_page = (Path(__file__).parents[2] / "docs" / "study.md").read_text()
    for text in (study_page, study.publish.command.USAGE):
        assert f"{costly_minutes} CPU minutes more" in text
        assert re.search(rf"\b{cost_minutes}\s+minutes (more|for the times of section K)", text)

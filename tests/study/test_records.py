"""The record of costly cases."""

import json
import operator
import re
from dataclasses import replace
from pathlib import Path

import pytest

import study.publish.command
from study.benchmarks.k_cost import measure
from study.publish import renew_records
from study.run import records
from study.run.cases import load_section

QUICK, TIMED = "V13/square-own-64", "Q/seconds-penalty-16"
COSTLY = renew_records.costly_cases()


def test_the_record_is_of_cases_that_pages_mark_with_their_parameters():
    for key, row in records.read_rows().items():
        assert row["parameters"] == COSTLY[key].stored_parameters


def test_only_costly_cases_are_recorded():
    assert all(map(records.is_costly, records.read_rows().values()))


@pytest.mark.parametrize("section", sorted({case.section for case in COSTLY.values()}))
def test_sections_show_the_record(section):
    shown = {case.key: case for case in load_section(section).cases}
    for key, computed in COSTLY.items():
        if computed.section == section and key in records.read_rows():
            case = shown[key]
            assert case.record == "study/run/records.json"
            assert case.recomputed == computed
            assert computed.stored_parameters.items() <= case.stored_parameters.items()
            assert case.run(**case.parameters).dofs > 0


def test_a_record_of_other_parameters_is_not_read(tmp_path, monkeypatch):
    content = json.loads(records.RECORD.read_text(encoding="utf-8"))
    key = next(iter(records.read_rows()))
    content["rows"] = [records.read_rows()[key] | {"parameters": {"problem": "another"}}]
    monkeypatch.setattr(records, "RECORD", tmp_path / "records.json")
    records.RECORD.write_text(json.dumps(content))
    (case,) = (one for one in load_section(COSTLY[key].section).cases if one.key == key)
    assert not case.record


def test_check_passes_and_notices_a_changed_number(tmp_path, monkeypatch, capsys):
    case = replace(COSTLY[QUICK] if QUICK in COSTLY else _case(QUICK), costly=True)
    timed = replace(COSTLY[TIMED] if TIMED in COSTLY else _case(TIMED), costly=True)
    monkeypatch.setattr(renew_records, "costly_cases", lambda: {QUICK: case, TIMED: timed})
    monkeypatch.setattr(records, "RECORD", tmp_path / "records.json")
    monkeypatch.setattr(records, "COSTLY_SECONDS", 0.0)
    assert renew_records.main([]) == 0  # writes both
    assert renew_records.main(["--check", QUICK, TIMED]) == 0  # CPU seconds are never the same
    content = json.loads(records.RECORD.read_text())
    content["rows"][0]["scalars"]["nodes"] += 1
    records.RECORD.write_text(json.dumps(content))
    records.forget_rows()
    assert renew_records.main(["--check", QUICK]) == 1
    assert "TOO LARGE: V13/square-own-64 nodes 128 and 127" in capsys.readouterr().out
    assert renew_records.main([QUICK]) == 0  # computes the row again, and keeps the other
    assert len(json.loads(records.RECORD.read_text())["rows"]) == 2
    assert renew_records.main(["--check", QUICK]) == 0


def _case(key):
    section = key.partition("/")[0]
    (case,) = (one for one in load_section(section).cases if one.key == key)
    return case


def test_unknown_cases_are_refused(capsys):
    with pytest.raises(SystemExit):
        renew_records.main(["V13/square-own-65"])
    assert "no costly case V13/square-own-65" in capsys.readouterr().err


def test_the_documents_say_how_long_the_recorded_results_take():
    """As the records say: CPU time of the costly cases, and of all runs that measure costs."""
    minutes = round(sum(row["seconds"] for row in records.read_rows().values()) / 60)
    whole = [
        entry["measured"]["whole_seconds"]
        for entry in json.loads(measure.RECORD.read_text())["rows"]
        if entry["row"]["method"] != "CalculiX"
    ]
    repeats = [1 if seconds > measure.LONG_RUN else measure.N_RUNS for seconds in whole]
    cost_minutes = round(sum(map(operator.mul, whole, repeats)) / 60)
    page = (Path(__file__).parents[2] / "docs" / "study.md").read_text()
    for text in (page, study.publish.command.USAGE):
        assert f"{minutes} CPU minutes more" in text
        assert re.search(rf"\b{cost_minutes} minutes (more|for the times of section K)", text)

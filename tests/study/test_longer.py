"""The longer series and its record."""

import json
import operator
import re
from pathlib import Path

import pytest

import study.run.command
from study.benchmarks.k_cost import measure
from study.run.cases import load_section
from study.verification import longer, recorded

QUICK, TIMED = "V13/square-own-64", "Q/seconds-penalty-16"


def test_record_has_the_whole_series_and_nothing_else():
    known = {f"{row['section']}/{row['case']}": row["parameters"] for row in recorded.rows()}
    assert known == {key: case.stored_parameters for key, case in longer.CASES.items()}


@pytest.mark.parametrize("section", sorted({case.section for case in longer.CASES.values()}))
def test_sections_show_the_record(section):
    shown = {case.key: case for case in load_section(section).cases}
    for key, computed in longer.CASES.items():
        if computed.section == section:
            case = shown[key]
            assert computed.stored_parameters.items() <= case.stored_parameters.items()
            assert case.run(**case.parameters).dofs > 0


def test_check_passes_and_notices_a_changed_number(tmp_path, monkeypatch, capsys):
    content = json.loads(recorded.RECORD.read_text(encoding="utf-8"))
    copy = tmp_path / "longer.json"
    copy.write_text(json.dumps(content))
    for module in (longer, recorded):
        monkeypatch.setattr(module, "RECORD", copy)
    assert longer.main(["--check", QUICK, TIMED]) == 0  # CPU seconds are never the same
    (row,) = [row for row in content["rows"] if row["case"] == "square-own-64"]
    row["scalars"]["nodes"] += 1
    copy.write_text(json.dumps(content))
    assert longer.main(["--check", QUICK]) == 1
    assert "TOO LARGE: V13/square-own-64 nodes 128 and 127" in capsys.readouterr().out
    assert longer.main([QUICK]) == 0  # computes the row again, and keeps the others
    again = json.loads(copy.read_text())
    assert [one["case"] for one in again["rows"]] == [one["case"] for one in content["rows"]]
    assert longer.main(["--check", QUICK]) == 0


def test_unknown_cases_are_refused(capsys):
    with pytest.raises(SystemExit):
        longer.main(["V13/square-own-65"])
    assert "no longer case V13/square-own-65" in capsys.readouterr().err


def test_the_documents_say_how_long_the_recorded_results_take():
    """As the records say: CPU time of the longer series, and of all runs that measure costs."""
    longer_minutes = round(sum(row["seconds"] for row in recorded.rows()) / 60)
    whole = [
        entry["measured"]["whole_seconds"]
        for entry in json.loads(measure.RECORD.read_text())["rows"]
        if entry["row"]["method"] != "CalculiX"
    ]
    repeats = [1 if seconds > measure.LONG_RUN else measure.N_RUNS for seconds in whole]
    cost_minutes = round(sum(map(operator.mul, whole, repeats)) / 60)
    page = (Path(__file__).parents[2] / "docs" / "study.md").read_text()
    for text in (page, study.run.command.USAGE):
        assert f"{longer_minutes} CPU minutes more" in text
        assert re.search(rf"\b{cost_minutes} minutes (more|for the times of section K)", text)

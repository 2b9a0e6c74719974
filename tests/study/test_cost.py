"""Section K: each task runs and measures what the record has; rows are measured on demand."""

import json

import pytest

import study.publish.command
from study.benchmarks.k_cost import measure
from study.benchmarks.k_cost.measure import RECORD, TASKS, Row, list_rows
from study.run.cases import load_section

OF_PROCESS = {"wall_seconds", "whole_seconds", "megabytes"}
"""Numbers that are added to those of a task."""
SMALL_ROWS = [
    Row("assembly", "galerkin-T6", 2),
    Row("factors", "pw-T10", 2),
    Row("frequencies", "pw-T6", 4),
    Row("contact", "pw-T10", 2),
    Row("contact", "pw-hybrid-T10", 2, "Iterative"),
    Row("bodies", "pw-T10", 3, "compared"),
    Row("bodies", "pw-T10", 3, "Iterative"),
    Row("search", "pw-T10", 3, "graded"),
    Row("pieces", "pw-T6", 2),
    Row("sliding", "pw-T10", 2, "Iterative"),
    Row("incompressible", "galerkin-hybrid-T10", 2, "Iterative"),
    Row("linear", "pw-T10", 3, "Iterative"),
]


@pytest.mark.parametrize("row", SMALL_ROWS, ids=lambda row: row.name)
def test_a_task_measures_what_the_record_has(row):
    entries = json.loads(RECORD.read_text(encoding="utf-8"))["rows"]
    recorded = {(e["row"]["task"], e["row"]["method"]): set(e["measured"]) for e in entries}
    numbers = TASKS[row.task](row)
    assert numbers.keys() == recorded[row.task, row.method] - OF_PROCESS
    assert numbers["dofs"] > 0
    assert numbers["seconds"] > 0


def test_every_task_is_tried():
    assert {row.task for row in SMALL_ROWS} == TASKS.keys() == {row.task for row in list_rows()}


def test_costs_are_measured_anew_on_demand(tmp_path, monkeypatch):
    """Each row once; those of CalculiX stay read from the record."""
    entries = json.loads(RECORD.read_text(encoding="utf-8"))["rows"]
    recorded = {Row(**entry["row"]): entry["measured"] for entry in entries}
    measured_names = []

    def measure_row(row):
        measured_names.append(row.name)
        return {**recorded[row], "whole_seconds": 2 * recorded[row]["whole_seconds"]}

    own_rows = [row for row in recorded if row.method != "CalculiX"]
    monkeypatch.setattr(measure, "measure_row", measure_row)
    monkeypatch.setattr(measure, "list_rows", lambda: own_rows)
    tracked = load_section("K").cases
    anew = study.publish.command._recomputed(tracked, tmp_path)
    assert [case.name for case in anew] == [case.name for case in tracked]
    assert len(measured_names) == len({*measured_names}) > 100
    for case, before in zip(anew, tracked, strict=True):
        assert before.record == "study/benchmarks/k_cost/record.json"
        is_measured = case.name in measured_names
        assert bool(case.record) is not is_measured
        assert case.run(**case.parameters).dofs == before.run(**before.parameters).dofs
        seconds = [one.parameters["measured"]["whole_seconds"] for one in (case, before)]
        assert seconds[0] == (2 if is_measured else 1) * seconds[1]

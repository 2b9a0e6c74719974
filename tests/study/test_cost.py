"""Section K: each task runs and measures what the record has; rows are measured on demand."""

from dataclasses import replace

import pytest

import study.publish.command
from study.benchmarks.k_cost import measure
from study.benchmarks.k_cost.measure import CALCULIX, list_measurements, measurement_of_row
from study.benchmarks.k_cost.tasks import TASKS, Measurement
from study.run import records
from study.run.cases import load_section

NUMBERS_OF_PROCESS = {"wall_seconds", "whole_seconds", "megabytes"}
"""Numbers that are added to those of a task."""
SMALL_MEASUREMENTS = [
    Measurement("assembly", "galerkin-T6", 2),
    Measurement("factors", "pw-T10", 2),
    Measurement("frequencies", "pw-T6", 4),
    Measurement("contact", "pw-T10", 2),
    Measurement("contact", "pw-hybrid-T10", 2, "Iterative"),
    Measurement("bodies", "pw-T10", 3, "compared"),
    Measurement("bodies", "pw-T10", 3, "Iterative"),
    Measurement("pieces", "pw-T10", 2, "Iterative"),
    Measurement("sliding", "pw-T10", 2, "Iterative"),
    Measurement("incompressible", "galerkin-hybrid-T10", 2, "Iterative"),
    Measurement("linear", "pw-T10", 3, "Iterative"),
]


def read_measured_numbers():
    """Return the numbers of the record by their measurements."""
    rows = records.read_rows(records.TIME_AND_MEMORY).values()
    return {measurement_of_row(row): row.content["measured"] for row in rows}


@pytest.mark.parametrize("measurement", SMALL_MEASUREMENTS, ids=lambda one: one.name)
def test_a_task_measures_what_the_record_has(measurement):
    recorded = {(m.task, m.method): set(numbers) for m, numbers in read_measured_numbers().items()}
    numbers = TASKS[measurement.task](measurement)
    assert numbers.keys() == recorded[measurement.task, measurement.method] - NUMBERS_OF_PROCESS
    assert numbers["dofs"] > 0
    assert numbers["seconds"] > 0


def test_every_task_is_tried():
    tried, listed = ({one.task for one in s} for s in (SMALL_MEASUREMENTS, list_measurements()))
    assert tried == TASKS.keys() == listed


def test_all_measurements_are_recorded():
    assert read_measured_numbers().keys() == set(list_measurements())


def test_costs_are_measured_anew_on_demand(tmp_path, monkeypatch):
    """Each once; those of CalculiX stay read from the record."""
    rows = records.read_rows(records.TIME_AND_MEMORY)
    measured_keys = []

    def measure_with_doubled_time(measurement):
        measured_keys.append(measurement.key)
        row = rows[measurement.key]
        numbers = row.content["measured"]
        doubled = {**numbers, "whole_seconds": 2 * numbers["whole_seconds"]}
        return replace(row, content=row.content | {"measured": doubled})

    monkeypatch.setattr(measure, "measure", measure_with_doubled_time)
    tracked = load_section("K").cases
    remeasured = study.publish.command._recomputed(tracked, tmp_path)
    assert [case.name for case in remeasured] == [case.name for case in tracked]
    assert len(measured_keys) == len({*measured_keys}) == len(rows) - 2
    for case, before in zip(remeasured, tracked, strict=True):
        assert before.record == "study/run/recorded/time_and_memory.json"
        is_measured = case.key in measured_keys
        assert is_measured is (CALCULIX not in case.name)
        assert bool(case.record) is not is_measured
        assert case.run(**case.parameters).dofs == before.run(**before.parameters).dofs
        seconds = [one.parameters["measured"]["whole_seconds"] for one in (case, before)]
        assert seconds[0] == (2 if is_measured else 1) * seconds[1]

"""Test that tasks of section K measure the recorded quantities, and that costs can be renewed."""

from dataclasses import replace

import pytest

import study.publish.command
from study.benchmarks.k_cost import measure
from study.benchmarks.k_cost.measure import (
    is_measured_without_peers,
    list_measurements,
    measurement_from_record_row,
)
from study.benchmarks.k_cost.tasks import TASKS, Measurement
from study.run import records
from study.run.cases import load_section

NAMES_OF_NUMBERS_ADDED_TO_TASKS = {"wall_seconds", "whole_seconds", "megabytes"}
"""Names of recorded numbers that the measuring process adds to those of the task."""
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
    Measurement("sliding-bodies", "pw-T10", 3),
    Measurement("sliding-bodies", "pw-T10", 3, "Iterative"),
    Measurement("incompressible", "galerkin-hybrid-T10", 2, "Iterative"),
    Measurement("linear", "pw-T10", 3, "Iterative"),
    Measurement("peer-block", "pw-T10", 4, "Iterative"),
    Measurement("peer-rubber", "pw-T6", 4, "Direct"),
    Measurement("peer-sliding", "pw-T10", 1, "Direct"),
    Measurement("peer-fit", "pw-T10", 4, "Direct"),
]


def read_recorded_numbers_by_measurement():
    """Return a dictionary from each recorded measurement to its numbers."""
    rows = records.read_rows(records.TIME_AND_MEMORY).values()
    return {measurement_from_record_row(row): row.content["measured"] for row in rows}


@pytest.mark.parametrize("measurement", SMALL_MEASUREMENTS, ids=lambda one: one.name)
def test_each_task_returns_the_named_numbers_of_its_record(measurement):
    recorded_names = {
        (recorded_measurement.task, recorded_measurement.method): set(numbers)
        for recorded_measurement, numbers in read_recorded_numbers_by_measurement().items()
    }
    numbers = TASKS[measurement.task](measurement)
    assert (
        numbers.keys()
        == recorded_names[measurement.task, measurement.method] - NAMES_OF_NUMBERS_ADDED_TO_TASKS
    )
    assert numbers["dofs"] > 0
    assert numbers["seconds"] > 0


def test_small_and_listed_measurements_cover_every_task():
    tried_tasks, listed_tasks = (
        {measurement.task for measurement in measurements}
        for measurements in (SMALL_MEASUREMENTS, list_measurements())
    )
    assert tried_tasks == TASKS.keys() == listed_tasks


def test_recorded_measurements_are_exactly_the_listed_ones():
    assert read_recorded_numbers_by_measurement().keys() == set(list_measurements())


def test_remeasured_costs_replace_recorded_ones_except_comparisons(tmp_path, monkeypatch):
    """Each row of the record is measured exactly once, except comparisons with other programs.

    The rows of other programs and those compared with them are read from the record. A stub
    replaces the measurement and doubles `whole_seconds`, so that the numbers of a case show whether
    it was measured.
    """
    rows = records.read_rows(records.TIME_AND_MEMORY)
    measured_keys = []

    def measure_with_doubled_time(measurement):
        measured_keys.append(measurement.key)
        row = rows[measurement.key]
        numbers = row.content["measured"]
        doubled = {**numbers, "whole_seconds": 2 * numbers["whole_seconds"]}
        return replace(row, content=row.content | {"measured": doubled})

    monkeypatch.setattr(measure, "measure_and_make_record_row", measure_with_doubled_time)
    recorded_cases = load_section("K").cases
    remeasured = study.publish.command._replace_recorded_and_remeasure_cost_cases(
        recorded_cases, tmp_path
    )
    assert [case.name for case in remeasured] == [case.name for case in recorded_cases]
    keys_without_peers = {
        measurement.key for measurement in filter(is_measured_without_peers, list_measurements())
    }
    assert len(measured_keys) == len({*measured_keys}) == len(rows) - 16
    for case, recorded_case in zip(remeasured, recorded_cases, strict=True):
        assert recorded_case.record == "study/run/recorded/time_and_memory.json"
        is_measured = case.key in measured_keys
        assert is_measured is (case.key in keys_without_peers)
        assert bool(case.record) is not is_measured
        assert (
            case.run(**case.parameters).dofs == recorded_case.run(**recorded_case.parameters).dofs
        )
        seconds = [
            timed_case.parameters["measured"]["whole_seconds"]
            for timed_case in (case, recorded_case)
        ]
        assert seconds[0] == (2 if is_measured else 1) * seconds[1]

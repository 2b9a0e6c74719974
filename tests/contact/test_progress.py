"""Progress of a computation: loggers, the user's callback, lines on stderr."""

import logging
from time import perf_counter

import numpy as np
import pytest

from pw_elements import assemble_matrix, progress, vibration_modes
from pw_elements.contact import OPEN, SLIP, STICK
from tests.contact.cases import BlockOnFloor

BLOCK_ON_FLOOR = BlockOnFloor(8)


@pytest.fixture(autouse=True)
def _remove_logging_configuration(monkeypatch):
    """Remove, for one test, logging handlers and levels that other tests or the study have set."""
    level = progress.logger.level
    monkeypatch.setattr(progress.logger, "handlers", [])
    progress.logger.setLevel(logging.NOTSET)
    yield
    progress.logger.setLevel(level)


def solve_block_in_three_increments(callback=None):
    loads = [
        0.01 * load for load in BLOCK_ON_FLOOR.press_then_pull_loads(60.0, 2)
    ]  # small displacements
    return BLOCK_ON_FLOOR.solve_contact(
        BLOCK_ON_FLOOR.floor_pair(0.3), loads=loads, callback=callback
    )


def test_the_log_has_a_line_for_each_increment_and_iteration(caplog):
    with caplog.at_level(logging.DEBUG, "pw_elements"):
        states = solve_block_in_three_increments()
    contact_records = [record for record in caplog.records if record.name == "pw_elements.contact"]
    increments = [
        record.getMessage() for record in contact_records if record.levelno == logging.INFO
    ]
    iterations = [
        record.getMessage() for record in contact_records if record.levelno == logging.DEBUG
    ]
    assert len(increments) == 3
    assert len(iterations) == sum(state.iterations for state in states)
    for k, (line, state) in enumerate(zip(increments, states, strict=True)):
        status = state.pairs[0].status
        counts = [np.count_nonzero(status == kind) for kind in (OPEN, STICK, SLIP)]
        assert line.startswith(f"increment {k}: {state.iterations} iterations, {counts[0]} open, ")
        assert f"{counts[1]} stick, {counts[2]} slip, residual " in line
        assert f"LU by mumps, {state.report.factorisations} factorisations" in line
    assert iterations[0].startswith("increment 0: iteration 1: ")
    factor_records = [
        record for record in caplog.records if record.name == "pw_elements.linear_solver"
    ]
    assert len(factor_records) == sum(state.report.factorisations for state in states)


def test_eigenvalue_problems_are_logged(caplog):
    M = assemble_matrix(BLOCK_ON_FLOOR.body.mass())
    with caplog.at_level(logging.INFO, "pw_elements"):
        vibration_modes(BLOCK_ON_FLOOR.K, M, BLOCK_ON_FLOOR.no_supports, 4)
    (line,) = [
        record.getMessage() for record in caplog.records if record.name == "pw_elements.eigen"
    ]
    assert line.startswith(f"4 eigenvalues of {BLOCK_ON_FLOOR.K.getSize()[0]} unknowns: ")


def test_the_callback_receives_iterations_and_increments():
    events = []
    states = solve_block_in_three_increments(events.append)
    ends = [event for event in events if event.state is not None]
    assert [event.state for event in ends] == states
    assert len(events) == sum(state.iterations + 1 for state in states)
    assert [event.increment for event in ends] == [0, 1, 2]
    for event, state in zip(ends, states, strict=True):
        status = state.pairs[0].status
        counts = [np.count_nonzero(status == kind) for kind in (OPEN, STICK, SLIP)]
        assert [event.open, event.stick, event.slip] == counts
        assert (event.iteration, event.violation <= 1) == (state.iterations, True)
    first_events = [event for event in events if event.increment == 0]
    assert [event.iteration for event in first_events[:-1]] == list(range(1, len(first_events)))
    assert first_events[0].violation > 1e3
    for state, repeated_state in zip(states, solve_block_in_three_increments(), strict=True):
        assert np.array_equal(state.displacement.array_r, repeated_state.displacement.array_r)


def test_a_callback_that_raises_ends_the_computation():
    class CallbackError(Exception):
        pass

    def raise_at_end_of_increment(event):
        if event.state is not None:
            raise CallbackError(str(event))

    with pytest.raises(CallbackError, match=r"\d+ open, \d+ stick, \d+ slip"):
        solve_block_in_three_increments(raise_at_end_of_increment)
    problem = BLOCK_ON_FLOOR.contact_problem(
        BLOCK_ON_FLOOR.floor_pair(0.3), callback=lambda _: 1 / 0
    )
    with pytest.raises(ZeroDivisionError):
        problem.step(problem.undeformed, BLOCK_ON_FLOOR.pressure_load)
    with pytest.raises(TypeError, match="callback is of the type list: it has to be a function"):
        solve_block_in_three_increments([])


def compute_modes_and_contact():
    vibration_modes(
        BLOCK_ON_FLOOR.K, assemble_matrix(BLOCK_ON_FLOOR.body.mass()), BLOCK_ON_FLOOR.no_supports, 4
    )
    solve_block_in_three_increments(lambda _: None)


def test_progress_lines_are_written_after_a_pause(monkeypatch, capsys):
    monkeypatch.setattr(progress, "_last_report_time", perf_counter())
    compute_modes_and_contact()
    assert capsys.readouterr() == ("", "")  # within ten seconds
    monkeypatch.setattr(progress, "_MIN_SECONDS_BETWEEN_REPORTS", -1.0)
    compute_modes_and_contact()
    lines, n_dofs = capsys.readouterr().err.splitlines(), BLOCK_ON_FLOOR.K.getSize()[0]
    template = "{} of 3 increments done, contact increment {}"
    assert {template.format(k, k) for k in range(3)} < {*lines}
    assert f"4 eigenvalues of {n_dofs} unknowns" in lines
    assert f"LU by mumps of {n_dofs} unknowns" in lines


@pytest.mark.parametrize("case", ["log", "silent", "null"])
def test_no_progress_line_is_written_where_a_log_is_configured(case, monkeypatch, caplog, capsys):
    monkeypatch.setattr(progress, "_MIN_SECONDS_BETWEEN_REPORTS", -1.0)
    if case == "null":
        monkeypatch.setattr(progress.logger, "handlers", [logging.NullHandler()])
    else:
        caplog.set_level(logging.INFO if case == "log" else logging.ERROR, "pw_elements")
    compute_modes_and_contact()
    assert capsys.readouterr().err == ""
    assert any(message.startswith("increment 2: ") for message in caplog.messages) == (
        case == "log"
    )

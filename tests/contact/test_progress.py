"""What is told while a computation runs: loggers, the user's function, lines on stderr."""

import logging
from time import perf_counter

import numpy as np
import pytest

from pw_elements import assemble_matrix, progress, vibration_modes
from pw_elements.contact import OPEN, SLIP, STICK
from tests.contact.cases import BlockOnFloor

BLOCK = BlockOnFloor(8)


@pytest.fixture(autouse=True)
def _own_log(monkeypatch):
    """Without handlers and levels of whoever has been here before, as the study's."""
    level = progress.logger.level
    monkeypatch.setattr(progress.logger, "handlers", [])
    progress.logger.setLevel(logging.NOTSET)
    yield
    progress.logger.setLevel(level)


def solved(callback=None):
    loads = [0.01 * load for load in BLOCK.pull_loads(60.0, 2)]  # small displacements
    return BLOCK.solve_contact(BLOCK.floor_pair(0.3), loads=loads, callback=callback)


def test_the_log_has_a_line_for_each_increment_and_iteration(caplog):
    with caplog.at_level(logging.DEBUG, "pw_elements"):
        states = solved()
    mine = [record for record in caplog.records if record.name == "pw_elements.contact"]
    increments = [r.getMessage() for r in mine if r.levelno == logging.INFO]
    iterations = [r.getMessage() for r in mine if r.levelno == logging.DEBUG]
    assert len(increments) == 3
    assert len(iterations) == sum(state.iterations for state in states)
    for k, (line, state) in enumerate(zip(increments, states, strict=True)):
        status = state.pairs[0].status
        count = [np.count_nonzero(status == which) for which in (OPEN, STICK, SLIP)]
        assert line.startswith(f"increment {k}: {state.iterations} iterations, {count[0]} open, ")
        assert f"{count[1]} stick, {count[2]} slip, residual " in line
        assert f"LU by mumps, {state.report.factorisations} factorisations" in line
    assert iterations[0].startswith("increment 0: iteration 1: ")
    factors = [r for r in caplog.records if r.name == "pw_elements.linear_solver"]
    assert len(factors) == sum(state.report.factorisations for state in states)


def test_eigenvalue_problems_are_logged(caplog):
    M = assemble_matrix(BLOCK.body.mass())
    with caplog.at_level(logging.INFO, "pw_elements"):
        vibration_modes(BLOCK.K, M, BLOCK.no_supports, 4)
    (line,) = [r.getMessage() for r in caplog.records if r.name == "pw_elements.eigen"]
    assert line.startswith(f"4 eigenvalues of {BLOCK.K.getSize()[0]} unknowns: ")


def test_the_callback_sees_iterations_and_increments():
    seen = []
    states = solved(seen.append)
    ends = [event for event in seen if event.state is not None]
    assert [event.state for event in ends] == states
    assert len(seen) == sum(state.iterations + 1 for state in states)
    assert [event.increment for event in ends] == [0, 1, 2]
    for event, state in zip(ends, states, strict=True):
        status = state.pairs[0].status
        counts = [np.count_nonzero(status == which) for which in (OPEN, STICK, SLIP)]
        assert [event.open, event.stick, event.slip] == counts
        assert (event.iteration, event.violation <= 1) == (state.iterations, True)
    first = [event for event in seen if event.increment == 0]
    assert [event.iteration for event in first[:-1]] == list(range(1, len(first)))
    assert first[0].violation > 1e3
    for state, other in zip(states, solved(), strict=True):
        assert np.array_equal(state.displacement.array_r, other.displacement.array_r)


def test_a_callback_that_raises_ends_the_computation():
    class Enough(Exception):
        pass

    def once(event):
        if event.state is not None:
            raise Enough(str(event))

    with pytest.raises(Enough, match=r"\d+ open, \d+ stick, \d+ slip"):
        solved(once)
    problem = BLOCK.contact_problem(BLOCK.floor_pair(0.3), callback=lambda _: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        problem.step(problem.undeformed, BLOCK.pressure_load)
    with pytest.raises(TypeError, match="callback is of the type list: it has to be a function"):
        solved([])


def computed():
    vibration_modes(BLOCK.K, assemble_matrix(BLOCK.body.mass()), BLOCK.no_supports, 4)
    solved(lambda _: None)


def test_lines_say_now_and_then_what_is_done(monkeypatch, capsys):
    monkeypatch.setattr(progress, "_written", perf_counter())
    computed()
    assert capsys.readouterr() == ("", "")  # within ten seconds
    monkeypatch.setattr(progress, "_PAUSE", -1.0)
    computed()
    lines, size = capsys.readouterr().err.splitlines(), BLOCK.K.getSize()[0]
    done = "{} of 3 increments done, contact increment {}"
    assert {done.format(k, k) for k in range(3)} < {*lines}
    assert f"4 eigenvalues of {size} unknowns" in lines
    assert f"LU by mumps of {size} unknowns" in lines


@pytest.mark.parametrize("case", ["log", "silent", "null"])
def test_no_line_where_the_log_speaks_or_is_to_be_silent(case, monkeypatch, caplog, capsys):
    monkeypatch.setattr(progress, "_PAUSE", -1.0)
    if case == "null":
        monkeypatch.setattr(progress.logger, "handlers", [logging.NullHandler()])
    else:
        caplog.set_level(logging.INFO if case == "log" else logging.ERROR, "pw_elements")
    computed()
    assert capsys.readouterr().err == ""
    assert any(said.startswith("increment 2: ") for said in caplog.messages) == (case == "log")

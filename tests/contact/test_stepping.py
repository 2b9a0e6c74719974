"""Histories that stop and go on: `ContactProblem.step`, and states in files."""

import io
import json
import shutil
import subprocess
import sys
from dataclasses import FrozenInstanceError
from pathlib import Path

from petsc4py import PETSc

import numpy as np
import pytest

from pw_elements import Direct
from pw_elements.contact import (
    OPEN,
    ContactPair,
    ContactProblem,
    FreeBody,
    Motion,
    Parabola,
    Plane,
    solve_contact,
)
from tests.contact.cases import Block, Punch, at
from tests.contact.restart import RESUMED, fields, histories, resumed, whole

PROJECT = Path(__file__).parents[2]
# Two ways to one state: their systems are solved to 1e-13 of the load by factors of another matrix,
# and forces of two bodies come out some ten times worse
SAME = 1e-11


def scale_of(name, states):
    """What differences of a field are compared with: the history's largest force or length."""
    length = max(np.abs(fields(state)["displacement"]).max() for state in states)
    force = max(np.abs(fields(state)["force_normal 0"]).max() for state in states)
    kind = name.split()[0]
    if "force" in kind:
        return force
    return length if kind in ("displacement", "gap", "slip", "translation") else 1.0


def distance(states, others, scaled_by=()):
    """Largest difference of any field, over its scale in a history."""
    worst = 0.0
    for name in fields(others[-1]):
        scale = scale_of(name, [*others, *scaled_by])
        for a, b in zip(states, others, strict=True):
            worst = max(worst, np.abs(fields(a)[name] - fields(b)[name]).max(initial=0.0) / scale)
    return worst


@pytest.mark.parametrize("name", histories)
def test_a_history_resumed_is_the_history(name):
    problem, steps = histories[name]()
    states = whole(problem, steps)
    again, _ = histories[name]()  # another problem object: nothing but the state goes over
    rest = resumed(again, steps, states[RESUMED - 1])
    assert distance(rest, states[RESUMED:], states) < SAME
    assert [state.increment for state in rest] == list(range(RESUMED + 1, len(steps) + 1))
    # what `start` takes it for, a guess without history, is another problem
    if name == "block":
        guessed = whole(again, steps[RESUMED:], guess=states[RESUMED - 1])
        assert distance(guessed, states[RESUMED:], states) > 0.01


@pytest.mark.parametrize("name", histories)
def test_a_state_from_a_file_goes_on_as_before(name, tmp_path):
    problem, steps = histories[name]()
    states = whole(problem, steps)
    problem.save(states[RESUMED - 1], tmp_path / "state.npz")
    again, _ = histories[name]()
    read = again.load(tmp_path / "state.npz")
    stored = states[RESUMED - 1]
    assert (read.increment, read.unique, read.report) == (RESUMED, stored.unique, stored.report)
    assert distance(resumed(again, steps, read), states[RESUMED:], states) < SAME


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
@pytest.mark.parametrize("processes", [(1, 3), (3, 1), (2, 3)])
def test_a_file_goes_on_with_other_processes(processes, tmp_path):
    """Written on some processes, gone on from on others, compared with one process throughout."""
    found = {}
    for kind, count in zip(("write", "resume"), processes, strict=True):
        command = ["mpirun", "-n", str(count), sys.executable, "-m", "mpi4py", "-m"]
        command += ["tests.contact.restart", kind, str(tmp_path)]
        done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=1800)
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
    for name in histories:
        problem, steps = histories[name]()
        states = whole(problem, steps)[RESUMED:]
        for state, numbers in zip(states, found[name], strict=True):
            for field, values in fields(state).items():
                if field != "displacement":  # in the numbering of the processes
                    scale = scale_of(field, states)
                    assert np.abs(np.array(numbers[field]) - values).max() < 1e-9 * scale, field
            assert numbers["size"] == pytest.approx(state.displacement.norm(), rel=1e-9)


def test_a_step_changes_no_state_and_can_be_repeated():
    problem, steps = histories["block"]()
    first = problem.step(problem.undeformed, *steps[0])
    kept = {name: values.copy() for name, values in fields(first).items()}
    second = problem.step(first, *steps[1])
    other = problem.step(first, *steps[-1])
    again = problem.step(first, *steps[1])
    assert distance([again], [second]) < 1e-12
    assert distance([other], [second]) > 1e-3
    for name, values in fields(first).items():
        assert np.array_equal(values, kept[name])
    with pytest.raises(ValueError, match="read-only"):
        first.pairs[0].force_normal[:] = 0.0
    with pytest.raises(FrozenInstanceError):
        first.iterations = 3


def test_solve_contact_is_a_loop_over_step():
    block = Block(20)
    loads = block.pulled(60.0, 3)
    states = solve_contact(block.K, loads, block.free, [block.pair(0.3)], block.space)
    problem = ContactProblem(block.K, block.free, block.pair(0.3), block.space)
    state = problem.undeformed
    assert state.increment == 0
    assert np.all(state.pairs[0].status == OPEN)
    for load, expected in zip(loads, states, strict=True):
        state = problem.step(state, load)
        assert distance([state], [expected]) == 0
        assert state.report == expected.report


def test_a_load_step_that_fails_leaves_the_state_before_it():
    """A cut-back is a loop over `step`: the plate that would be dragged off is pushed less."""
    block = Block(4)
    problem = ContactProblem(block.K, block.free, block.pair(0.3, smooth=0.0), block.space)
    pressed = problem.step(problem.undeformed, block.pressure)
    pull = block.load((100.0, 0.0), at(0, 4.0))
    share = 2.0
    with pytest.raises(FreeBody, match="slides along x"):
        problem.step(pressed, block.pressure + pull * share)
    while True:
        try:
            state = problem.step(pressed, block.pressure + pull * share)
            break
        except FreeBody:
            share /= 2
    assert share == 1.0
    assert state.pairs[0].force[0] == pytest.approx(-200.0)


def test_what_a_step_refuses():
    block = Block(4)
    problem = ContactProblem(block.K, block.free, block.pair(0.3), block.space)
    coarse = Block(2)
    other = ContactProblem(coarse.K, coarse.free, coarse.pair(0.3), coarse.space).undeformed
    bad = block.pressure.copy()
    bad.set(np.nan)
    start, load = problem.undeformed, block.pressure
    for arguments, message in (
        ((other, load), "the state belongs to other contact nodes"),
        ((start, bad), "the load is not finite"),
        ((start, load, [None, None]), "2 motions for 1 contact pairs"),
        ((start, load, [Motion((0, 0, 0))]), "the motion of contact pair 0 is not 2-D"),
    ):
        with pytest.raises(ValueError, match=message):
            problem.step(*arguments)


def test_files_that_are_no_state_of_this_problem(tmp_path):
    block, other = Block(4), Block(6)
    problem = ContactProblem(block.K, block.free, block.pair(0.3), block.space)
    path = tmp_path / "state.npz"
    with pytest.raises(OSError, match=r"state\.npz"):
        problem.load(path)
    path.write_text("nothing")
    with pytest.raises(ValueError, match=r"state\.npz holds no contact state"):
        problem.load(path)
    problem.save(problem.undeformed, path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])  # a copy that was broken off
    with pytest.raises(ValueError, match=r"state\.npz holds no contact state"):
        problem.load(path)
    np.savez(path, state=np.load(io.BytesIO(whole))["state"])  # without its arrays
    with pytest.raises(ValueError, match=r"state\.npz holds no contact state"):
        problem.load(path)
    another = ContactProblem(other.K, other.free, other.pair(0.3), other.space)
    another.save(another.undeformed, path)
    with pytest.raises(ValueError, match="the state of another mesh"):
        problem.load(path)
    half = ContactPair(lambda x: at(1, 0.0)(x) & (x[0] < 2.1), Plane((0, 0), (0, 1)), 0.3)
    fewer = ContactProblem(block.K, block.free, half, block.space)
    fewer.save(fewer.undeformed, path)
    with pytest.raises(ValueError, match="belongs to other contact nodes"):
        problem.load(path)
    with pytest.raises(OSError, match="missing"):
        problem.save(problem.undeformed, tmp_path / "missing" / "state.npz")
    assert [file.name for file in tmp_path.iterdir()] == ["state.npz"]  # no remains


def test_nodes_that_coincide_keep_their_displacements(tmp_path):
    """Two blocks that touch have nodes in one place, which a file has to tell apart."""
    from tests.contact.test_matching import two_blocks

    problem, load = two_blocks()
    state = problem.step(problem.undeformed, load)
    problem.save(state, tmp_path / "state.npz")
    again, _ = two_blocks()
    read = again.load(tmp_path / "state.npz")
    assert np.array_equal(read.displacement.array_r, state.displacement.array_r)


def test_uniqueness_is_not_examined_without_determinants():
    block = Block(8)
    options = {"pc_factor_mat_solver_type": "superlu_dist"}
    (state,) = solve_contact(
        block.K, block.pressure, block.free, block.pair(0.3), block.space, solver=Direct(options)
    )
    (by_mumps,) = solve_contact(block.K, block.pressure, block.free, block.pair(0.3), block.space)
    assert state.unique is None
    assert by_mumps.unique is True
    assert state.report.method == "LU by superlu_dist"
    assert by_mumps.report.method == "LU by mumps"
    difference = state.displacement - by_mumps.displacement
    assert difference.norm() < 1e-10 * by_mumps.displacement.norm()


def test_old_factors_serve_while_few_rows_change():
    """On a mesh large enough for it, most increments of a slow pull need no new factors."""
    block = Block(80)
    states = block.solve(0.3, 60.0, increments=10)
    reports = [state.report for state in states]
    assert reports[0].factorisations >= 1
    assert sum(report.factorisations for report in reports) == FACTORISATIONS
    assert sum(state.iterations for state in states) > 2 * FACTORISATIONS
    assert sum(report.krylov_iterations for report in reports) > 0


FACTORISATIONS = 14  # as many as with the rule's first version, for 51 linear systems


def test_motions_and_forces_may_alternate():
    """Free and prescribed translations may alternate: the systems are exchanged."""
    punch = Punch()
    pair = ContactPair(at(1, 4.0), Parabola((0, 4), 8.0), 0.0)
    problem = ContactProblem(punch.K, punch.foot, pair, punch.space)
    nothing = punch.K.createVecLeft()
    driven = problem.step(problem.undeformed, nothing, [Motion((0, -0.2))])
    force = driven.pairs[0].force
    loaded = problem.step(driven, nothing, [Motion((0, None), (0, force[1]))])
    back = problem.step(loaded, nothing, [Motion((0, -0.2))])
    assert loaded.pairs[0].translation == pytest.approx((0, -0.2))
    assert (driven.free, loaded.free, back.free) == ((), ((0, 1),), ())
    size = driven.displacement.norm(PETSc.NormType.INFINITY)
    assert (back.displacement - driven.displacement).norm() < 1e-9 * size

"""Histories that stop and go on: `ContactProblem.step`, and states in files."""

import io
import os
import resource
import signal
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

from petsc4py import PETSc

import numpy as np
import pytest

from pw_elements import Direct
from pw_elements.contact import ContactPair, Motion, Plane
from tests.contact.cases import GALERKIN, BlockOnFloor, ElasticBody, PunchedBlock, on_plane
from tests.contact.histories import (
    HISTORIES,
    RESUME_INCREMENT,
    field_scale,
    resume_history,
    solve_history,
    state_fields,
)
from tests.contact.test_matching import Blocks

# Two ways to one state: their systems are solved to 1e-13 of the load by factors of another matrix,
# and forces of two bodies come out some ten times worse
SAME = 1e-11
BLOCK = BlockOnFloor(4)
PROBLEM = BLOCK.contact_problem(BLOCK.floor_pair(0.3))
LOWER = Plane((0, -0.01), (0, 1))


def distance(states, others, scaled_by=()):
    """Largest difference of any field, over its scale in a history."""
    worst = 0.0
    for name in state_fields(others[-1]):
        scale = field_scale(name, [*others, *scaled_by])
        for a, b in zip(states, others, strict=True):
            worst = max(
                worst,
                np.abs(state_fields(a)[name] - state_fields(b)[name]).max(initial=0.0) / scale,
            )
    return worst


@pytest.mark.parametrize("name", HISTORIES)
def test_a_history_resumed_from_a_state_or_a_file_is_the_history(name, tmp_path):
    problem, steps = HISTORIES[name]()
    states = solve_history(problem, steps)
    stored = states[RESUME_INCREMENT - 1]
    again, _ = HISTORIES[name]()  # another problem object: nothing but the state goes over
    problem.save(stored, tmp_path / "state.npz")
    read = again.load(tmp_path / "state.npz")
    assert (read.increment, read.unique, read.report) == (
        RESUME_INCREMENT,
        stored.unique,
        stored.report,
    )
    for start in (stored, read):
        rest = resume_history(again, steps, start)
        assert distance(rest, states[RESUME_INCREMENT:], states) < SAME
        assert [state.increment for state in rest] == list(
            range(RESUME_INCREMENT + 1, len(steps) + 1)
        )


def test_a_step_changes_no_state_and_can_be_repeated():
    problem, steps = HISTORIES["block"]()
    first = problem.step(problem.undeformed, *steps[0])
    kept = {name: values.copy() for name, values in state_fields(first).items()}
    second, other, again = (problem.step(first, *steps[k]) for k in (1, -2, 1))
    assert distance([again], [second]) < 1e-12
    assert distance([other], [second]) > 1e-3
    for name, values in state_fields(first).items():
        assert np.array_equal(values, kept[name])
    with pytest.raises(ValueError, match="read-only"):
        first.pairs[0].force_normal[:] = 0.0
    with pytest.raises(FrozenInstanceError):
        first.iterations = 3


def _archive(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def test_files_that_are_no_state_of_this_problem(tmp_path):
    path = tmp_path / "state.npz"

    def refused(message, kind=ValueError):
        with pytest.raises(kind, match=message):
            PROBLEM.load(path)

    refused(r"state\.npz", OSError)
    path.write_text("nothing")
    refused(r"state\.npz holds no contact state")
    for mine in (b"nothing", _archive(nodes=np.zeros(3))):
        path.write_bytes(mine)
        with pytest.raises(FileExistsError, match="was not written by pw_elements"):
            PROBLEM.save(PROBLEM.undeformed, path)
        assert path.read_bytes() == mine
    path.unlink()
    PROBLEM.save(PROBLEM.undeformed, path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])  # a copy that was broken off
    refused(r"state\.npz holds no contact state")
    PROBLEM.save(PROBLEM.undeformed, path)
    np.savez(path, state=np.load(io.BytesIO(content))["state"])  # without its arrays
    refused(r"state\.npz holds no contact state")
    half = ContactPair(lambda x: on_plane(1, 0.0)(x) & (x[0] < 2.1), Plane((0, 0), (0, 1)), 0.3)
    for case, pair, message in (
        (BlockOnFloor(6), BLOCK.floor_pair(0.3), "the state of another mesh"),
        (BLOCK, half, "of a problem with another surface"),
        (BLOCK, replace(BLOCK.floor_pair(0.3), friction=0.3), "of a problem with another friction"),
        (BLOCK, BLOCK.floor_pair(0.4), "of a problem with another friction"),
        (BLOCK, replace(BLOCK.floor_pair(0.3), surface=LOWER), "of a problem with another surface"),
        (
            ElasticBody(BLOCK.mesh, GALERKIN, "plane stress"),
            BLOCK.floor_pair(0.3),
            "with another stiffness",
        ),
    ):
        other = case.contact_problem(pair)
        other.save(other.undeformed, path)
        refused(message)
    with pytest.raises(OSError, match="missing"):
        PROBLEM.save(PROBLEM.undeformed, tmp_path / "missing" / "state.npz")
    assert [file.name for file in tmp_path.iterdir()] == ["state.npz"]  # no remains


def test_any_change_of_a_file_is_seen(tmp_path):
    path, random = tmp_path / "state.npz", np.random.default_rng(5)
    state = PROBLEM.step(PROBLEM.undeformed, BLOCK.pressure_load)
    PROBLEM.save(state, path)
    content = path.read_bytes()
    with np.load(path) as archive:
        arrays = dict(archive)
    for name, values in arrays.items():
        other = values.copy()
        if other.dtype.kind == "U":
            other = np.array(str(other).replace("true", "false", 1).replace("0", "1", 1))
        elif other.size:
            other.flat[-1] += 1
        for changed in ({**arrays, name: other}, {k: v for k, v in arrays.items() if k != name}):
            if changed.keys() == arrays.keys() and not other.size:
                continue
            np.savez(path, **changed)
            with pytest.raises(ValueError, match=r"state\.npz holds no contact state"):
                PROBLEM.load(path)
    for place in random.integers(len(content), size=60):
        spoilt = bytearray(content)
        spoilt[place] ^= 1 << random.integers(8)
        for data in (bytes(spoilt), content[:place]):
            path.write_bytes(data)
            try:
                read = PROBLEM.load(path)
            except ValueError as error:
                assert "holds no contact state" in str(error)  # noqa: PT017
            else:
                assert np.array_equal(read.displacement.array_r, state.displacement.array_r)
                assert np.array_equal(read.pairs[0].force_normal, state.pairs[0].force_normal)


def test_nothing_but_regular_files_is_written_and_read(tmp_path):
    start = PROBLEM.undeformed
    fifo, folder, link, real = (tmp_path / name for name in ("fifo", "folder", "link", "real"))
    os.mkfifo(fifo)
    folder.mkdir()
    for path in (fifo, folder, Path("/dev/null")):
        with pytest.raises(FileExistsError, match="no regular file"):
            PROBLEM.save(start, path)
        with pytest.raises(FileExistsError, match="no regular file"):
            PROBLEM.load(path)
    link.symlink_to(real)
    PROBLEM.save(start, link)
    assert link.is_symlink()
    assert PROBLEM.load(real).increment == 0


def test_full_disk_and_another_writer_leave_the_file_whole(tmp_path, monkeypatch):
    path = tmp_path / "state.npz"
    PROBLEM.save(PROBLEM.undeformed, path)
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        with pytest.raises(OSError, match="cannot be written to"):
            PROBLEM.save(PROBLEM.undeformed, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert path.read_bytes() == before
    put = os.replace

    def meanwhile(source, target):
        monkeypatch.setattr("os.replace", put)
        PROBLEM.save(PROBLEM.undeformed, path)
        put(source, target)

    monkeypatch.setattr("os.replace", meanwhile)
    PROBLEM.save(PROBLEM.undeformed, path)
    assert PROBLEM.load(path).increment == 0
    assert list(tmp_path.iterdir()) == [path]


def test_nodes_that_coincide_keep_their_displacements(tmp_path):
    """Two blocks that touch have nodes in one place, which a file has to tell apart."""
    blocks = Blocks()
    problem = blocks.contact_problem(blocks.make_pair(), blocks.base_supports)
    state = problem.step(problem.undeformed, blocks.traction_load((0.0, -3.0)))
    problem.save(state, tmp_path / "state.npz")
    read = problem.load(tmp_path / "state.npz")
    assert np.array_equal(read.displacement.array_r, state.displacement.array_r)


def test_uniqueness_is_not_examined_without_determinants():
    solver = Direct({"pc_factor_mat_solver_type": "superlu_dist"})
    state, by_mumps = (
        BLOCK.solve_contact(BLOCK.floor_pair(0.3), loads=BLOCK.pressure_load, **options)[0]
        for options in ({"solver": solver}, {})
    )
    assert (state.unique, state.report.method) == (None, "LU by superlu_dist")
    assert (by_mumps.unique, by_mumps.report.method) == (True, "LU by mumps")
    difference = state.displacement - by_mumps.displacement
    assert difference.norm() < 1e-10 * by_mumps.displacement.norm()


FACTORISATIONS = 4  # at most, for 51 linear systems


def test_old_factors_serve_while_few_rows_change():
    """On a mesh large enough for it, most increments of a slow pull need no new factors."""
    states = BlockOnFloor(48).solve(0.3, 60.0, increments=10)
    reports = [state.report for state in states]
    assert reports[0].factorisations >= 1
    assert sum(report.factorisations for report in reports) <= FACTORISATIONS
    assert sum(state.iterations for state in states) > 10 * FACTORISATIONS


def test_motions_and_forces_may_alternate():
    punch = PunchedBlock()
    problem, nothing = (
        punch.contact_problem(punch.punch_pair(0.0), punch.base_supports),
        punch.zero_load,
    )
    driven = problem.step(problem.undeformed, nothing, [Motion((0, -0.2))])
    pushed = Motion((0, None), (0, driven.pairs[0].force[1]))
    loaded = problem.step(driven, nothing, [pushed])
    back = problem.step(loaded, nothing, [Motion((0, -0.2))])
    assert loaded.pairs[0].translation == pytest.approx((0, -0.2))
    assert (driven.free_motions, loaded.free_motions, back.free_motions) == ((), ((0, 1),), ())
    size = driven.displacement.norm(PETSc.NormType.INFINITY)
    assert (back.displacement - driven.displacement).norm() < 1e-9 * size

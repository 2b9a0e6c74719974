"""Histories that are stopped and resumed: `ContactProblem.step`, and states in files."""

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
    HISTORY_MAKERS_BY_NAME,
    INCREMENTS_BEFORE_RESUME,
    collect_comparable_fields,
    largest_force_or_length_in_history,
    resume_history,
    solve_history,
)
from tests.contact.test_matching import MatchingBlocks

# Largest relative difference between two computations of a state. Linear systems are solved to
# 1e-13 of the load with the factors of another matrix, and forces between two bodies are about ten
# times less accurate
RELATIVE_RESTART_TOLERANCE = 1e-11
BLOCK_ON_FLOOR = BlockOnFloor(4)
BLOCK_PROBLEM = BLOCK_ON_FLOOR.contact_problem(BLOCK_ON_FLOOR.floor_pair(0.3))
LOWER_PLANE = Plane((0, -0.01), (0, 1))


def largest_relative_field_difference(states, reference_states, scale_states=()):
    """Return the largest difference between states, relative to the scale of each field.

    The scale of a field is taken from `reference_states` and `scale_states`.
    """
    largest = 0.0
    for name in collect_comparable_fields(reference_states[-1]):
        scale = largest_force_or_length_in_history(name, [*reference_states, *scale_states])
        for state, reference in zip(states, reference_states, strict=True):
            largest = max(
                largest,
                np.abs(
                    collect_comparable_fields(state)[name]
                    - collect_comparable_fields(reference)[name]
                ).max(initial=0.0)
                / scale,
            )
    return largest


@pytest.mark.parametrize("name", HISTORY_MAKERS_BY_NAME)
def test_a_history_resumed_from_a_state_or_a_file_is_the_same(name, tmp_path):
    problem, steps = HISTORY_MAKERS_BY_NAME[name]()
    states = solve_history(problem, steps)
    stored_state = states[INCREMENTS_BEFORE_RESUME - 1]
    second_problem, _ = HISTORY_MAKERS_BY_NAME[
        name
    ]()  # a second problem object, which gets only the state
    problem.save(stored_state, tmp_path / "state.npz")
    loaded_state = second_problem.load(tmp_path / "state.npz")
    assert (loaded_state.increment, loaded_state.unique, loaded_state.report) == (
        INCREMENTS_BEFORE_RESUME,
        stored_state.unique,
        stored_state.report,
    )
    for start in (stored_state, loaded_state):
        remaining_states = resume_history(second_problem, steps, start)
        assert (
            largest_relative_field_difference(
                remaining_states, states[INCREMENTS_BEFORE_RESUME:], states
            )
            < RELATIVE_RESTART_TOLERANCE
        )
        assert [state.increment for state in remaining_states] == list(
            range(INCREMENTS_BEFORE_RESUME + 1, len(steps) + 1)
        )


def test_a_step_changes_no_state_and_can_be_repeated():
    problem, steps = HISTORY_MAKERS_BY_NAME["block"]()
    first_state = problem.step(problem.undeformed, *steps[0])
    copies = {
        name: values.copy() for name, values in collect_comparable_fields(first_state).items()
    }
    second_state, other_state, repeated_state = (
        problem.step(first_state, *steps[k]) for k in (1, -2, 1)
    )
    assert largest_relative_field_difference([repeated_state], [second_state]) < 1e-12
    assert largest_relative_field_difference([other_state], [second_state]) > 1e-3
    for name, values in collect_comparable_fields(first_state).items():
        assert np.array_equal(values, copies[name])
    with pytest.raises(ValueError, match="read-only"):
        first_state.pairs[0].force_normal[:] = 0.0
    with pytest.raises(FrozenInstanceError):
        first_state.iterations = 3


def _serialise_as_npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def test_files_without_a_state_of_this_problem_are_refused(tmp_path):
    path = tmp_path / "state.npz"

    def assert_refused(message, kind=ValueError):
        with pytest.raises(kind, match=message):
            BLOCK_PROBLEM.load(path)

    assert_refused(r"state\.npz", OSError)
    path.write_text("nothing")
    assert_refused(r"state\.npz holds no contact state")
    for foreign_content in (b"nothing", _serialise_as_npz(nodes=np.zeros(3))):
        path.write_bytes(foreign_content)
        with pytest.raises(FileExistsError, match="was not written by pw_elements"):
            BLOCK_PROBLEM.save(BLOCK_PROBLEM.undeformed, path)
        assert path.read_bytes() == foreign_content
    path.unlink()
    BLOCK_PROBLEM.save(BLOCK_PROBLEM.undeformed, path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])  # an incomplete copy
    assert_refused(r"state\.npz holds no contact state")
    BLOCK_PROBLEM.save(BLOCK_PROBLEM.undeformed, path)
    np.savez(path, state=np.load(io.BytesIO(content))["state"])  # a file without its arrays
    assert_refused(r"state\.npz holds no contact state")
    half_pair = ContactPair(
        lambda x: on_plane(1, 0.0)(x) & (x[0] < 2.1), Plane((0, 0), (0, 1)), 0.3
    )
    for case, pair, message in (
        (BlockOnFloor(6), BLOCK_ON_FLOOR.floor_pair(0.3), "the state of another mesh"),
        (BLOCK_ON_FLOOR, half_pair, "of a problem with another surface"),
        (
            BLOCK_ON_FLOOR,
            replace(BLOCK_ON_FLOOR.floor_pair(0.3), friction=0.3),
            "of a problem with another friction",
        ),
        (BLOCK_ON_FLOOR, BLOCK_ON_FLOOR.floor_pair(0.4), "of a problem with another friction"),
        (
            BLOCK_ON_FLOOR,
            replace(BLOCK_ON_FLOOR.floor_pair(0.3), surface=LOWER_PLANE),
            "of a problem with another surface",
        ),
        (
            ElasticBody(BLOCK_ON_FLOOR.mesh, GALERKIN, "plane stress"),
            BLOCK_ON_FLOOR.floor_pair(0.3),
            "with another stiffness",
        ),
    ):
        other_problem = case.contact_problem(pair)
        other_problem.save(other_problem.undeformed, path)
        assert_refused(message)
    with pytest.raises(OSError, match="missing"):
        BLOCK_PROBLEM.save(BLOCK_PROBLEM.undeformed, tmp_path / "missing" / "state.npz")
    assert [file.name for file in tmp_path.iterdir()] == ["state.npz"]  # no temporary files


def test_any_change_of_a_file_is_detected(tmp_path):
    path, rng = tmp_path / "state.npz", np.random.default_rng(5)
    state = BLOCK_PROBLEM.step(BLOCK_PROBLEM.undeformed, BLOCK_ON_FLOOR.pressure_load)
    BLOCK_PROBLEM.save(state, path)
    content = path.read_bytes()
    with np.load(path) as archive:
        arrays = dict(archive)
    for name, values in arrays.items():
        changed_values = values.copy()
        if changed_values.dtype.kind == "U":
            changed_values = np.array(
                str(changed_values).replace("true", "false", 1).replace("0", "1", 1)
            )
        elif changed_values.size:
            changed_values.flat[-1] += 1
        for changed_arrays in (
            {**arrays, name: changed_values},
            {k: v for k, v in arrays.items() if k != name},
        ):
            if changed_arrays.keys() == arrays.keys() and not changed_values.size:
                continue
            np.savez(path, **changed_arrays)
            with pytest.raises(ValueError, match=r"state\.npz holds no contact state"):
                BLOCK_PROBLEM.load(path)
    for position in rng.integers(len(content), size=60):
        damaged = bytearray(content)
        damaged[position] ^= 1 << rng.integers(8)
        for data in (bytes(damaged), content[:position]):
            path.write_bytes(data)
            try:
                loaded_state = BLOCK_PROBLEM.load(path)
            except ValueError as error:
                assert "holds no contact state" in str(error)  # noqa: PT017
            else:
                assert np.array_equal(loaded_state.displacement.array_r, state.displacement.array_r)
                assert np.array_equal(
                    loaded_state.pairs[0].force_normal, state.pairs[0].force_normal
                )


def test_only_regular_files_are_written_and_read(tmp_path):
    state = BLOCK_PROBLEM.undeformed
    fifo, folder, link, real = (tmp_path / name for name in ("fifo", "folder", "link", "real"))
    os.mkfifo(fifo)
    folder.mkdir()
    for path in (fifo, folder, Path("/dev/null")):
        with pytest.raises(FileExistsError, match="no regular file"):
            BLOCK_PROBLEM.save(state, path)
        with pytest.raises(FileExistsError, match="no regular file"):
            BLOCK_PROBLEM.load(path)
    link.symlink_to(real)
    BLOCK_PROBLEM.save(state, link)
    assert link.is_symlink()
    assert BLOCK_PROBLEM.load(real).increment == 0


def test_a_full_disk_and_another_writer_leave_the_file_complete(tmp_path, monkeypatch):
    path = tmp_path / "state.npz"
    BLOCK_PROBLEM.save(BLOCK_PROBLEM.undeformed, path)
    old_content = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    old_handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        with pytest.raises(OSError, match="cannot be written to"):
            BLOCK_PROBLEM.save(BLOCK_PROBLEM.undeformed, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, old_handler)
    assert path.read_bytes() == old_content
    replace_file = os.replace

    def save_state_before_replacing_file(source, target):
        monkeypatch.setattr("os.replace", replace_file)
        BLOCK_PROBLEM.save(BLOCK_PROBLEM.undeformed, path)
        replace_file(source, target)

    monkeypatch.setattr("os.replace", save_state_before_replacing_file)
    BLOCK_PROBLEM.save(BLOCK_PROBLEM.undeformed, path)
    assert BLOCK_PROBLEM.load(path).increment == 0
    assert list(tmp_path.iterdir()) == [path]


def test_coinciding_nodes_keep_their_displacements_in_files(tmp_path):
    """Nodes at the same position keep their own displacements if a state is saved and loaded.

    These nodes belong to two blocks that touch each other.
    """
    blocks = MatchingBlocks()
    problem = blocks.contact_problem(blocks.make_pair(), blocks.base_supports)
    state = problem.step(problem.undeformed, blocks.traction_load((0.0, -3.0)))
    problem.save(state, tmp_path / "state.npz")
    loaded_state = problem.load(tmp_path / "state.npz")
    assert np.array_equal(loaded_state.displacement.array_r, state.displacement.array_r)


def test_uniqueness_is_not_examined_without_determinants():
    solver = Direct({"pc_factor_mat_solver_type": "superlu_dist"})
    state, by_mumps = (
        BLOCK_ON_FLOOR.solve_contact(
            BLOCK_ON_FLOOR.floor_pair(0.3), loads=BLOCK_ON_FLOOR.pressure_load, **options
        )[0]
        for options in ({"solver": solver}, {})
    )
    assert (state.unique, state.report.method) == (None, "LU by superlu_dist")
    assert (by_mumps.unique, by_mumps.report.method) == (True, "LU by mumps")
    difference = state.displacement - by_mumps.displacement
    assert difference.norm() < 1e-10 * by_mumps.displacement.norm()


MAX_FACTORISATIONS_OF_51_SYSTEMS = 4  # upper limit, for 51 linear systems


def test_factors_are_reused_while_few_rows_change():
    """The factors of a matrix are reused while few of its rows change.

    Most increments of a slow pull need no new factors if the mesh is as fine as in this test.
    """
    states = BlockOnFloor(48).solve(0.3, 60.0, n_pull_increments=10)
    reports = [state.report for state in states]
    assert reports[0].factorisations >= 1
    assert sum(report.factorisations for report in reports) <= MAX_FACTORISATIONS_OF_51_SYSTEMS
    assert sum(state.iterations for state in states) > 10 * MAX_FACTORISATIONS_OF_51_SYSTEMS


def test_motions_and_forces_may_alternate():
    punch = PunchedBlock()
    problem, zero_load = (
        punch.contact_problem(punch.punch_pair(0.0), punch.base_supports),
        punch.zero_load,
    )
    moved_state = problem.step(problem.undeformed, zero_load, [Motion((0, -0.2))])
    force_motion = Motion((0, None), (0, moved_state.pairs[0].force[1]))
    pushed_state = problem.step(moved_state, zero_load, [force_motion])
    returned_state = problem.step(pushed_state, zero_load, [Motion((0, -0.2))])
    assert pushed_state.pairs[0].translation == pytest.approx((0, -0.2))
    assert moved_state.free_motions == returned_state.free_motions == ()
    assert pushed_state.free_motions == ((0, 1),)
    largest = moved_state.displacement.norm(PETSc.NormType.INFINITY)
    assert (returned_state.displacement - moved_state.displacement).norm() < 1e-9 * largest

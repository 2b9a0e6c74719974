"""Contact on two processes, or on three at night; one start of MPI computes all cases."""

import logging
import os
import re
from contextlib import nullcontext
from functools import partial
from unittest.mock import patch

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType

from pw_elements import Iterative, Spaces, reactions
from pw_elements.contact import (
    ContactFields,
    ContactPair,
    Motion,
    Plane,
    Sphere,
    SurfacePassed,
    write,
)
from pw_elements.meshes import triangles
from tests.contact import test_large as large
from tests.contact import test_turning as turning
from tests.contact.blocks_in_space import BlocksInSpace
from tests.contact.cases import BlockOnFloor, PunchedBlock, on_plane
from tests.contact.histories import (
    HISTORY_MAKERS_BY_NAME,
    INCREMENTS_BEFORE_RESUME,
    collect_comparable_fields,
    largest_force_or_length_in_history,
    resume_history,
    solve_history,
)
from tests.contact.sliding import DIE_TOP_TRANSLATIONS, make_die_on_block, slide_along_path
from tests.contact.test_fields import solve_ball_on_block
from tests.contact.test_matching import MatchingBlocks
from tests.contact.test_refusals import collect_refusal_messages
from tests.contact.test_sensitivity import RandomRubber
from tests.contact.two_bodies import StackedBlocks
from tests.library import vtx
from tests.oracle.random_contact import make_problem as random_problem
from tests.parallel import assert_same_values, run_on_processes

HYBRID_BLOCKS = {"element": "hybrid", "compressibility": 1e-3}
CASES_WITH_FILES = "block", "drag", "mortar", "flat mortar", "matching"


def solve_stacked_blocks(comm, cell, divisions):
    """Return two stacked blocks with non-matching meshes, and a list with their state.

    The upper block is pressed and moved sideways. It covers only a part of the lower block.
    """
    stack = StackedBlocks(divisions, cell, upper_range=(0.13, 0.83), comm=comm)
    return stack, [stack.solve_shifted_top("lower")]


def solve_matching_blocks(comm):
    """Return two blocks with matching nodes and their states; contact alone holds the upper one."""
    blocks = MatchingBlocks(divisions=(12, 6), comm=comm)
    loads = [blocks.traction_load((pull, -3.0)) for pull in (0.0, 0.4)]
    states = blocks.solve_contact(
        blocks.make_pair(0.3), blocks.make_clamping_supports(on_plane(1, 0.0)), loads
    )
    reaction = reactions(blocks.K, states[-1].displacement, loads[-1]).array_r
    force = ContactFields.from_state(states[-1], blocks.space).force.x.array[: len(reaction)]
    difference = np.abs(reaction - force).reshape(-1, 2)[
        ~np.isclose(blocks.x[: len(reaction) // 2, 1], 0.0)
    ]
    assert difference.max(initial=0.0) < 1e-8 * np.abs(states[-1].pairs[0].force).max()
    return blocks, states


def solve_block_on_floor(comm):
    """Return a block on a floor and its states; several processes own contact nodes."""
    body = BlockOnFloor(20, comm=comm)
    owned = body.x[: body.space.dofmap.index_map.size_local, 1]
    has_contact_nodes = comm.allgather(np.isclose(owned, 0.0).any())
    assert comm.size == 1 or sum(has_contact_nodes) > 1, "the partition spares the contact"
    return body, body.solve(0.3, 60.0, n_pull_increments=2)


def solve_random_contact(comm, seed):
    problem = random_problem(seed, comm)
    return problem, problem.solve()


CASE_SOLVERS_BY_NAME = {
    "block": solve_block_on_floor,
    "drag": solve_ball_on_block,
    "mortar": partial(solve_stacked_blocks, cell="tetrahedron", divisions=(3, 2)),
    "flat mortar": partial(solve_stacked_blocks, cell="triangle", divisions=(5, 4)),
    "matching": solve_matching_blocks,
    "rubber": partial(solve_ball_on_block, method=Spaces.hybrid, nu=0.5),
    **{f"seed {seed}": partial(solve_random_contact, seed=seed) for seed in (158, 316)},
}


def numbers_in_surface_passed_error(comm, surface, depth):
    """Return the numbers in the error message about a surface that passes through the body."""
    case = PunchedBlock(comm=comm)
    pair = ContactPair(on_plane(1, 4.0), surface, 0.3, [Motion((0, -depth))])
    with pytest.raises(SurfacePassed) as error:
        case.solve_contact(pair, case.base_supports)
    return [float(number) for number in re.findall(r"-?[0-9.]*[0-9]", str(error.value))]


def solve_and_write_cases_and_collect_numbers(comm, folder):
    """Solve all cases, write files of some of them, and return the results by name."""
    numbers = {
        "ball passes": numbers_in_surface_passed_error(comm, Sphere((0, 6), 2.0), 5.0),
        "plate passes": numbers_in_surface_passed_error(comm, Plane((0, 4), (0, -1)), 6.0),
    }
    for name, solve in CASE_SOLVERS_BY_NAME.items():
        body, states = solve(comm)
        if name in CASES_WITH_FILES:
            write(folder / f"{name}.bp", states, body.body)
        for k, state in enumerate(states):
            (pair,) = state.pairs
            for field in ("position", "force_normal", "force_tangential", "status", "gap", "slip"):
                numbers[f"{name} {k} {field}"] = np.nan_to_num(getattr(pair, field), posinf=-1.0)
            if len(pair.opposite_node):
                numbers[f"{name} {k} opposite force"] = pair.opposite_force
            numbers[f"{name} {k} translation"] = pair.translation
            numbers[f"{name} {k} force"] = pair.force
            numbers[f"{name} {k} displacement"] = state.displacement.norm()
            numbers[f"{name} {k} smallness"] = list(vars(state.smallness).values())
            numbers[f"{name} {k} scale"] = list(vars(state.scale).values())
    return numbers


def collect_errors_of_obstructed_writing(comm, folder):
    """Write while only rank 0 meets obstacles; return the messages and the final file names."""
    body, states = solve_block_on_floor(comm)
    path, messages = folder / "block.bp", []
    if comm.rank == 0:
        path.mkdir()
        (path / "md.idx").write_text("mine")
    comm.barrier()
    full_disk = patch.object(
        os, "posix_fallocate", side_effect=OSError(28, "No space left on device")
    )
    for failure in (None, full_disk):
        with failure or nullcontext():
            try:
                write(path, states, body.body)
            except OSError as error:
                messages.append(str(error))
        comm.barrier()
        if failure is None and comm.rank == 0:
            messages.append((path / "md.idx").read_text())
            (path / "md.idx").unlink()
            path.rmdir()
        comm.barrier()
    for _ in range(2):
        write(path, states, body.body)
    comm.barrier()
    return messages, sorted(os.listdir(folder))


def test_an_obstacle_to_writing_on_one_process_is_reported_on_all(tmp_path):
    for rank, (messages, file_names) in enumerate(
        run_on_processes(2, collect_errors_of_obstructed_writing, tmp_path)
    ):
        foreign_folder, *contents, full_disk = messages
        assert "does not say that it is a time series" in foreign_folder
        assert contents == ["mine"] * (rank == 0)
        assert "No space left on device: it takes about" in full_disk
        assert file_names == ["block.bp"]


def write_with_failure_on_rank_1(comm, folder):
    """Write a file; rank 1 fails in doing so, and the other processes wait for it."""
    body, states = solve_block_on_floor(comm)
    fill = ContactFields.fill

    def fail_on_rank_1(self, state):
        if comm.rank == 1 and state is states[1]:
            raise OSError("no more")
        fill(self, state)

    with (
        patch.object(ContactFields, "fill", fail_on_rank_1),
        patch(f"{write.__module__}._MAX_WAIT_AFTER_ERROR_IN_SECONDS", 1.0),
    ):
        write(folder / "block.bp", states, body.body)


def test_processes_do_not_wait_for_one_that_failed_while_writing(tmp_path):
    with pytest.raises(AssertionError, match="writing failed on process 1 alone: no more"):
        run_on_processes(2, write_with_failure_on_rank_1, tmp_path, limit=300)
    assert not (tmp_path / "block.bp").exists()


def solve_whole_and_resumed_histories(name, problems, motions, folder, further_fields=()):
    """Return the fields at the end of the motions, from one whole history and two resumed ones.

    In the resumed histories, a second problem object starts from the state before the last motion.
    This state is either loaded from a file or passed directly.
    """
    (problem, second_problem), path = problems, folder / f"{name}.npz"
    *_, previous, end_state = large.step_through(problem, motions)
    if not path.exists():
        problem.save(previous, path)
    end_states = {f"{name} whole": end_state}
    for kind, start in (("resumed", second_problem.load(path)), ("taken up", previous)):
        (end_states[f"{name} {kind}"],) = large.step_through(second_problem, motions[-1:], start)
    return large.collect_first_pair_fields(end_states, further_fields)


def solve_and_collect_finite_strain_fields(comm, folder):
    """Return fields of large-strain problems with moved tools and with two rubber bodies.

    They include derivatives of outputs with respect to parameters.
    """
    fields = {}
    for name, solver in large.SOLVERS_BY_NAME.items():
        problems = [
            large.make_hardening_rubber_and_hardness(comm, solver=solver)[0].problem
            for _ in range(2)
        ]
        fields |= solve_whole_and_resumed_histories(name, problems, large.CIRCLE_MOTIONS, folder)
    roller = turning.make_rubber_under_roller(
        mesh=triangles(comm, (-1.0, -1.0), (1.0, 0.0), (8, 4))
    ).problem
    fields |= solve_whole_and_resumed_histories(
        "turned", [roller] * 2, turning.ROLLER_MOTIONS, folder, turning.POSE_AND_TORQUE_FIELDS
    )
    fields |= large.collect_first_pair_fields(
        {"hybrid": large.solve_pressed_and_pushed_rubber("hybrid", Iterative(), comm)}
    )
    (pair,) = slide_along_path(
        make_die_on_block(comm=comm, divisions=((8, 2), (6, 2))), DIE_TOP_TRANSLATIONS[:3]
    )[-1].pairs
    for field in ("force_normal", "force_tangential", "slip", "gap", "opposite_force"):
        fields[f"die's {field}"] = np.nan_to_num(getattr(pair, field), posinf=-1.0)
    for name, options in (
        ("blocks", {}),
        ("hexahedra", {"cell": CellType.hexahedron}),
        ("hybrid hexahedra", {"cell": CellType.hexahedron} | HYBRID_BLOCKS),
        ("hybrid blocks", HYBRID_BLOCKS),
    ):
        blocks = BlocksInSpace(upper_is_slave=False, comm=comm, **options)
        has_contact_nodes = comm.allgather(any(np.isclose(blocks.owned_positions[:, 2], 0.0)))
        assert comm.size == 1 or sum(has_contact_nodes) > 1, "the partition spares the contact"
        (pair,) = blocks.slide([(0.0, 0.0, -0.06), (0.1, 0.02, -0.06)])[-1].pairs
        for field in ("force_normal", "force_tangential", "slip", "gap", "opposite_force"):
            fields[f"{name}' {field}"] = np.nan_to_num(getattr(pair, field), posinf=-1.0)
    case = RandomRubber(0, comm=comm)
    problem, states = case.solve()
    arguments = states, case.outputs, list(case.parameters.values()), case.loads
    fields["derivatives"] = problem.sensitivity(*arguments)
    weights = np.cos(np.arange(15.0)).reshape(3, 5)
    return fields | {"adjoint": problem.sensitivity(*arguments, weights)}


EXPECTED_REFUSAL_TYPES = ["NoEquilibrium"] * 8 + ["FreeBody"] * 9


def check_callback_and_collect_log(comm):
    """Return whether a callback given on rank 1 is called only there, and the lines of the log."""
    case, lines, events = BlockOnFloor(8, comm=comm), [], []
    case.pressure_load.scale(0.01)  # reduces the load, so that displacements are small

    def solve(callback=None):
        return case.solve_contact(
            case.floor_pair(0.3), case.no_supports, case.pressure_load, callback=callback
        )

    class LineHandler(logging.Handler):
        def emit(self, record):
            lines.append(record.getMessage())

    (state,) = solve(events.append if comm.rank == 1 else None)
    handler, library = LineHandler(), logging.getLogger("pw_elements")
    library.addHandler(handler)
    library.setLevel(logging.INFO)
    if comm.rank == 0:  # one process that logs more must not stop the others
        logging.getLogger("pw_elements.contact").setLevel(logging.DEBUG)
    solve()
    return len(events) == (state.iterations + 1 if comm.rank == 1 else 0), lines


def comparable_fields_with_displacement_norm(state):
    """Return the fields of a state, in which the displacement is replaced by its norm."""
    return collect_comparable_fields(state) | {"displacement": state.displacement.norm()}


def compute_results_to_compare(comm, resume_folder, folder):
    """Return all results that must not depend on the number of processes.

    If `resume_folder` is given, histories continue from the states that fewer processes have saved
    in it.
    """
    results = {
        "numbers": solve_and_write_cases_and_collect_numbers(comm, folder),
        "words": collect_refusal_messages(comm),
        "histories": {},
    }
    results["large"] = solve_and_collect_finite_strain_fields(comm, resume_folder or folder)
    for name, history in HISTORY_MAKERS_BY_NAME.items():
        problem, steps = history(comm)
        if resume_folder is None:
            states = solve_history(problem, steps)
        else:
            loaded_state = problem.load(resume_folder / f"{name}.npz")
            states = [None] * (INCREMENTS_BEFORE_RESUME - 1) + [
                loaded_state,
                *resume_history(problem, steps, loaded_state),
            ]
        problem.save(states[INCREMENTS_BEFORE_RESUME - 1], folder / f"{name}.npz")
        results["histories"][name] = list(
            map(comparable_fields_with_displacement_norm, states[INCREMENTS_BEFORE_RESUME:])
        )
    if comm.size > 1:
        results["told"] = check_callback_and_collect_log(comm)
    return results


def merge_coinciding_points(step_fields):
    """Return the fields of a step with coinciding points merged, sorted by position.

    The values at coinciding points have to agree.
    """
    x = step_fields["geometry"]
    order = np.lexsort(np.round(x, 9).T)
    is_new_point = np.append(True, np.any(np.abs(np.diff(x[order], axis=0)) > 1e-9, axis=1))
    group = np.cumsum(is_new_point) - 1
    merged = {}
    for name, field in step_fields.items():
        if name != "connectivity":
            merged[name] = field[order][is_new_point]
            assert np.allclose(field[order], merged[name][group], 1e-12, 1e-14, equal_nan=True), (
                name
            )
    return merged


def assert_same_time_series(case_name, serial_folder, parallel_folder):
    """Compare the time series of a case that were written by one and by several processes."""
    serial_steps, parallel_steps = (
        vtx.read_times_and_fields(path / f"{case_name}.bp")
        for path in (serial_folder, parallel_folder)
    )
    for (time, serial), (parallel_time, parallel) in zip(serial_steps, parallel_steps, strict=True):
        assert time == parallel_time
        if case_name == "matching":  # nodes of both bodies coincide
            ends = [
                [np.nanmax(step["pressure"]), np.nanmin(step["contact_force"])]
                for step in (serial, parallel)
            ]
            assert ends[0] == pytest.approx(ends[1], rel=1e-8)
            continue
        serial, parallel = merge_coinciding_points(serial), merge_coinciding_points(parallel)
        for field, values in serial.items():
            # a slip is a difference of displacements
            reference = serial["displacement"] if field == "slip" else values
            scale = np.nanmax(np.abs(reference)) if field != "gap" else 1.0
            difference = np.abs(values - parallel[field])
            assert np.array_equal(np.isnan(values), np.isnan(parallel[field])), field
            # the law holds to 1e-9 of the largest force, and forces to a few times 1e-9
            assert np.nanmax(difference) < 1e-8 * max(scale, 1e-3), field


def assert_same_histories(name, serial_result, parallel_results, folder):
    """Compare histories that are interrupted and continued on other numbers of processes.

    They have begun on one process and continued on several; this function continues them on one.
    """
    problem, steps = HISTORY_MAKERS_BY_NAME[name]()
    resumed_states = resume_history(problem, steps, problem.load(folder / f"{name}.npz"))
    serial_fields = serial_result["histories"][name]
    for states in (
        *(result["histories"][name] for result in parallel_results),
        map(comparable_fields_with_displacement_norm, resumed_states),
    ):
        for state, expected in zip(states, serial_fields, strict=True):
            for field, values in expected.items():
                scale = (
                    values
                    if field == "displacement"
                    else largest_force_or_length_in_history(field, resumed_states)
                )
                assert np.abs(state[field] - values).max() < 1e-9 * scale, f"{name}: {field}"


def assert_rank_0_alone_logs(rank_0_result, *other_results):
    """Assert that rank 0 alone logs, and that callbacks are called on the expected processes."""
    (callback_is_right, lines), other_lines = (
        rank_0_result,
        [rank_lines for _, rank_lines in other_results],
    )
    assert callback_is_right
    assert all(other_callback_is_right for other_callback_is_right, _ in other_results)
    assert len(lines) > 2
    assert all(line.startswith(("increment 0: ", "LU by ")) for line in lines)
    assert not any(
        line.startswith("increment") for rank_lines in other_lines for line in rank_lines
    )


def test_one_and_several_processes_agree(tmp_path, request):
    """One process and several processes produce the same results, files and messages.

    All parts are in one test, so that parallel workers of pytest do not repeat computations.
    """
    folders = [tmp_path / name for name in ("one", "several")]
    for folder in folders:
        folder.mkdir()
    serial = compute_results_to_compare(MPI.COMM_SELF, None, folders[0])
    assert [message.split(":")[0] for message in serial["words"]] == EXPECTED_REFUSAL_TYPES
    for name, values in serial["large"].items():
        reference = serial["large"][re.sub("resumed|taken up", "whole", name)]
        assert np.abs(values - reference).max() < 1e-12, name
    parallel_results = run_on_processes(
        3 if request.config.getoption("--nightly") else 2, compute_results_to_compare, *folders
    )
    for parallel in parallel_results:
        assert parallel["words"] == serial["words"]
        assert_same_values(serial["numbers"], parallel["numbers"], 1e-10, "of several")
        assert_same_values(serial["large"], parallel["large"], 1e-9, "of several")
    for name in CASES_WITH_FILES if vtx.load_adios2_library() else ():
        assert_same_time_series(name, *folders)
    for name in HISTORY_MAKERS_BY_NAME:
        assert_same_histories(name, serial, parallel_results, folders[-1])
    assert_rank_0_alone_logs(*(parallel["told"] for parallel in parallel_results))

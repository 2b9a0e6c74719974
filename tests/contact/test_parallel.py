"""Contact on two processes, at night on three: one start computes all that is compared."""

import logging
import os
import re
from contextlib import nullcontext
from functools import partial
from unittest.mock import patch

from mpi4py import MPI

import numpy as np
import pytest

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
from tests.contact.cases import BlockOnFloor, PunchedBlock, on_plane
from tests.contact.histories import (
    HISTORIES,
    RESUME_INCREMENT,
    field_scale,
    resume_history,
    solve_history,
    state_fields,
)
from tests.contact.sliding import DIE_PATH, make_die_on_block, slide_along_path
from tests.contact.test_fields import solve_ball_on_block
from tests.contact.test_matching import Blocks
from tests.contact.test_refusals import refusal_messages
from tests.contact.test_sensitivity import RandomRubber
from tests.contact.two_bodies import StackedBlocks
from tests.library import vtx
from tests.oracle.random_contact import make_problem as random_problem
from tests.parallel import assert_same, run_on

FILES = "block", "drag", "mortar", "flat mortar", "matching"


def mortar(comm, cell, divisions):
    """A body on another, which it covers in part, pressed and drawn askew."""
    stack = StackedBlocks(divisions, cell, upper_range=(0.13, 0.83), comm=comm)
    return stack, [stack.solve_shifted_top("lower")]


def matching(comm):
    """Two blocks, the upper one held by the lower alone; their nodes coincide."""
    blocks = Blocks(divisions=(12, 6), comm=comm)
    loads = [blocks.traction_load((pull, -3.0)) for pull in (0.0, 0.4)]
    states = blocks.solve_contact(blocks.make_pair(0.3), blocks.clamp(on_plane(1, 0.0)), loads)
    left = reactions(blocks.K, states[-1].displacement, loads[-1]).array_r
    force = ContactFields.from_state(states[-1], blocks.space).force.x.array[: len(left)]
    wrong = np.abs(left - force).reshape(-1, 2)[~np.isclose(blocks.x[: len(left) // 2, 1], 0.0)]
    assert wrong.max(initial=0.0) < 1e-8 * np.abs(states[-1].pairs[0].force).max()
    return blocks, states


def block(comm):
    body = BlockOnFloor(20, comm=comm)
    owned = body.x[: body.space.dofmap.index_map.size_local, 1]
    parts = comm.allgather(np.isclose(owned, 0.0).any())
    assert comm.size == 1 or sum(parts) > 1, "the partition spares the contact"
    return body, body.solve(0.3, 60.0, increments=2)


def by_seed(comm, seed):
    stated = random_problem(seed, comm)
    return stated, stated.solve()


CASES = {
    "block": block,
    "drag": solve_ball_on_block,
    "mortar": partial(mortar, cell="tetrahedron", divisions=(3, 2)),
    "flat mortar": partial(mortar, cell="triangle", divisions=(5, 4)),
    "matching": matching,
    "rubber": partial(solve_ball_on_block, method=Spaces.hybrid, nu=0.5),
    **{f"seed {seed}": partial(by_seed, seed=seed) for seed in (158, 316)},
}


def passed(comm, surface, depth):
    """Numbers in the message, the same on all processes, on a surface that passes through."""
    case = PunchedBlock(comm=comm)
    pair = ContactPair(on_plane(1, 4.0), surface, 0.3, [Motion((0, -depth))])
    with pytest.raises(SurfacePassed) as error:
        case.solve_contact(pair, case.base_supports)
    return [float(number) for number in re.findall(r"-?[0-9.]*[0-9]", str(error.value))]


def numbers(comm, folder):
    found = {
        "ball passes": passed(comm, Sphere((0, 6), 2.0), 5.0),
        "plate passes": passed(comm, Plane((0, 4), (0, -1)), 6.0),
    }
    for name, solved in CASES.items():
        body, states = solved(comm)
        if name in FILES:
            write(folder / f"{name}.bp", states, body.body)
        for k, state in enumerate(states):
            (pair,) = state.pairs
            for field in ("position", "force_normal", "force_tangential", "status", "gap", "slip"):
                found[f"{name} {k} {field}"] = np.nan_to_num(getattr(pair, field), posinf=-1.0)
            if len(pair.opposite_node):
                found[f"{name} {k} opposite force"] = pair.opposite_force
            found[f"{name} {k} translation"] = pair.translation
            found[f"{name} {k} force"] = pair.force
            found[f"{name} {k} displacement"] = state.displacement.norm()
            found[f"{name} {k} smallness"] = list(vars(state.smallness).values())
            found[f"{name} {k} scale"] = list(vars(state.scale).values())
    return found


def refusals_to_write(comm, folder):
    """What each process is told where one alone meets what is in the way; then it is written."""
    body, states = block(comm)
    path, told = folder / "block.bp", []
    if comm.rank == 0:
        path.mkdir()
        (path / "md.idx").write_text("mine")
    comm.barrier()
    none = patch.object(os, "posix_fallocate", side_effect=OSError(28, "No space left on device"))
    for failure in (None, none):
        with failure or nullcontext():
            try:
                write(path, states, body.body)
            except OSError as error:
                told.append(str(error))
        comm.barrier()
        if failure is None and comm.rank == 0:
            told.append((path / "md.idx").read_text())
            (path / "md.idx").unlink()
            path.rmdir()
        comm.barrier()
    for _ in range(2):
        write(path, states, body.body)
    comm.barrier()
    return told, sorted(os.listdir(folder))


def test_what_stops_one_process_from_writing_is_told_on_all(tmp_path):
    for rank, (told, left) in enumerate(run_on(2, refusals_to_write, tmp_path)):
        foreign, *mine, room = told
        assert "does not say that it is a time series" in foreign
        assert mine == ["mine"] * (rank == 0)
        assert "No space left on device: it takes about" in room
        assert left == ["block.bp"]


def failing_alone(comm, folder):
    """A process that fails within the writing, while the others wait for it."""
    body, states = block(comm)
    fill = ContactFields.fill

    def failing(self, state):
        if comm.rank == 1 and state is states[1]:
            raise OSError("no more")
        fill(self, state)

    with patch.object(ContactFields, "fill", failing), patch(f"{write.__module__}._PATIENCE", 1.0):
        write(folder / "block.bp", states, body.body)


def test_processes_do_not_wait_for_one_that_failed_while_writing(tmp_path):
    with pytest.raises(AssertionError, match="writing failed on process 1 alone: no more"):
        run_on(2, failing_alone, tmp_path, limit=300)
    assert not (tmp_path / "block.bp").exists()


def whole_and_resumed(name, problems, motions, folder, more=()):
    """Ends of a way, and of another problem that goes on before the last part, by a file or not."""
    (problem, again), path = problems, folder / f"{name}.npz"
    *_, before, end = large.step_through(problem, motions)
    if not path.exists():
        problem.save(before, path)
    ends = {f"{name} whole": end}
    for way, start in (("resumed", again.load(path)), ("taken up", before)):
        (ends[f"{name} {way}"],) = large.step_through(again, motions[-1:], start)
    return large.collect_pair_fields(ends, more)


def at_large_strains(comm, folder):
    """Tools that are pressed, drawn and turned, rubber on rubber, and derivatives."""
    found = {}
    for name, solver in large.SOLVERS.items():
        both = [large.make_hardening_rubber(comm, solver=solver)[0].problem for _ in range(2)]
        found |= whole_and_resumed(name, both, large.CIRCLE_MOTIONS, folder)
    roller = turning.make_roller(mesh=triangles(comm, (-1.0, -1.0), (1.0, 0.0), (8, 4))).problem
    found |= whole_and_resumed(
        "turned", [roller] * 2, turning.ROLLER_MOTIONS, folder, turning.POSE_FIELDS
    )
    found |= large.collect_pair_fields(
        {"hybrid": large.solve_pressed_and_pushed("hybrid", Iterative(), comm)}
    )
    (pair,) = slide_along_path(
        make_die_on_block(comm=comm, divisions=((8, 2), (6, 2))), DIE_PATH[:3]
    )[-1].pairs
    for field in ("force_normal", "force_tangential", "slip", "gap", "opposite_force"):
        found[f"die's {field}"] = np.nan_to_num(getattr(pair, field), posinf=-1.0)
    case = RandomRubber(0, comm=comm)
    problem, states = case.solve()
    given = states, case.outputs, list(case.parameters.values()), case.loads
    found["derivatives"] = problem.sensitivity(*given)
    weights = np.cos(np.arange(15.0)).reshape(3, 5)
    return found | {"adjoint": problem.sensitivity(*given, weights)}


KINDS = ["NoEquilibrium"] * 8 + ["FreeBody"] * 8


def told(comm):
    """What is logged where, and whether the callback of one process is called there alone."""
    case, lines, seen = BlockOnFloor(8, comm=comm), [], []
    case.pressure_load.scale(0.01)  # small displacements

    def solved(callback=None):
        return case.solve_contact(
            case.floor_pair(0.3), case.no_supports, case.pressure_load, callback=callback
        )

    class Lines(logging.Handler):
        def emit(self, record):
            lines.append(record.getMessage())

    (state,) = solved(seen.append if comm.rank == 1 else None)
    handler, library = Lines(), logging.getLogger("pw_elements")
    library.addHandler(handler)
    library.setLevel(logging.INFO)
    if comm.rank == 0:  # whoever listens on one process only must not stop the others
        logging.getLogger("pw_elements.contact").setLevel(logging.DEBUG)
    solved()
    return len(seen) == (state.iterations + 1 if comm.rank == 1 else 0), lines


def compared(state):
    return state_fields(state) | {"displacement": state.displacement.norm()}


def everything(comm, before, folder):
    """All that is compared; histories go on from where fewer processes have stopped."""
    found = {"numbers": numbers(comm, folder), "words": refusal_messages(comm), "histories": {}}
    found["large"] = at_large_strains(comm, before or folder)
    for name, history in HISTORIES.items():
        problem, steps = history(comm)
        if before is None:
            states = solve_history(problem, steps)
        else:
            kept = problem.load(before / f"{name}.npz")
            states = [None] * (RESUME_INCREMENT - 1) + [kept, *resume_history(problem, steps, kept)]
        problem.save(states[RESUME_INCREMENT - 1], folder / f"{name}.npz")
        found["histories"][name] = list(map(compared, states[RESUME_INCREMENT:]))
    if comm.size > 1:
        found["told"] = told(comm)
    return found


def unique(values):
    """A step's fields with each point once, in order of positions; ghosts have to agree."""
    x = values["geometry"]
    order = np.lexsort(np.round(x, 9).T)
    first = np.append(True, np.any(np.abs(np.diff(x[order], axis=0)) > 1e-9, axis=1))
    group = np.cumsum(first) - 1
    found = {}
    for name, field in values.items():
        if name != "connectivity":
            found[name] = field[order][first]
            assert np.allclose(field[order], found[name][group], 1e-12, 1e-14, equal_nan=True), name
    return found


def assert_same_files(name, folder, another):
    one, more = (vtx.read(of / f"{name}.bp") for of in (folder, another))
    for (time, serial), (other, parallel) in zip(one, more, strict=True):
        assert time == other
        if name == "matching":  # nodes of two bodies are in one place
            ends = [
                [np.nanmax(of["pressure"]), np.nanmin(of["contact_force"])]
                for of in (serial, parallel)
            ]
            assert ends[0] == pytest.approx(ends[1], rel=1e-8)
            continue
        serial, parallel = unique(serial), unique(parallel)
        for field, values in serial.items():
            # a slip is a difference of displacements
            of = serial["displacement"] if field == "slip" else values
            scale = np.nanmax(np.abs(of)) if field != "gap" else 1.0
            difference = np.abs(values - parallel[field])
            assert np.array_equal(np.isnan(values), np.isnan(parallel[field])), field
            # the law holds to 1e-9 of the largest force, and forces to a few times that
            assert np.nanmax(difference) < 1e-8 * max(scale, 1e-3), field


def assert_same_histories(name, first, others, last):
    """Written on one process, gone on from on several, and back on one."""
    problem, steps = HISTORIES[name]()
    back = resume_history(problem, steps, problem.load(last / f"{name}.npz"))
    known = first["histories"][name]
    for states in (*(other["histories"][name] for other in others), map(compared, back)):
        for state, expected in zip(states, known, strict=True):
            for field, values in expected.items():
                scale = values if field == "displacement" else field_scale(field, back)
                assert np.abs(state[field] - values).max() < 1e-9 * scale, f"{name}: {field}"


def assert_told(one, *others):
    """One process speaks."""
    (heard, lines), beside = one, [words for _, words in others]
    assert heard
    assert all(found for found, _ in others)
    assert len(lines) > 2
    assert all(line.startswith(("increment 0: ", "LU by ")) for line in lines)
    assert not any(line.startswith("increment") for words in beside for line in words)


def test_one_and_several_processes_agree(tmp_path, request):
    """In one test, which other workers would else compute once more for its parts."""
    folders = [tmp_path / name for name in ("one", "several")]
    for folder in folders:
        folder.mkdir()
    one = everything(MPI.COMM_SELF, None, folders[0])
    assert [said.split(":")[0] for said in one["words"]] == KINDS
    for name, values in one["large"].items():
        whole = one["large"][re.sub("resumed|taken up", "whole", name)]
        assert np.abs(values - whole).max() < 1e-12, name
    several = run_on(3 if request.config.getoption("--nightly") else 2, everything, *folders)
    for process in several:
        assert process["words"] == one["words"]
        assert_same(one["numbers"], process["numbers"], 1e-10, "of several")
        assert_same(one["large"], process["large"], 1e-9, "of several")
    for name in FILES if vtx.library() else ():
        assert_same_files(name, *folders)
    for name in HISTORIES:
        assert_same_histories(name, one, several, folders[-1])
    assert_told(*(process["told"] for process in several))

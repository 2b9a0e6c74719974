"""Contact on one, two and three processes: one start each computes what all tests compare."""

import logging
import re

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box

from pw_elements import Spaces, reactions
from pw_elements.contact import (
    ContactFields,
    ContactPair,
    Motion,
    Plane,
    Sphere,
    SurfacePassed,
    write,
)
from tests.contact.cases import PW, Block, Elastic, Punch, at
from tests.contact.histories import RESUMED, fields, histories, resumed, scale_of, whole
from tests.contact.test_matching import Blocks
from tests.contact.test_refusals import messages
from tests.contact.two_bodies import Stack
from tests.library import vtx
from tests.oracle.random_contact import problem as random_problem
from tests.parallel import assert_same, run_on

FILES = "block", "drag", "mortar", "flat mortar", "matching"


def drag(comm, method=PW, nu=0.3):
    mesh = create_box(comm, [(-1, -1, 0), (1, 1, 1)], (4, 4, 2), CellType.tetrahedron)
    body = Elastic(mesh, method, "solid", nu=nu)
    motions = [Motion((0, 0, -0.1)), Motion((0.01, 0.02, None), (0, 0, -80.0))]
    pair = ContactPair(at(2, 1.0), Sphere((0, 0, 3), 2.0), 0.3, motions)
    return body, body.contact(pair, body.clamped(at(2, 0.0)))


def mortar(comm, cell="tetrahedron", element="petrov_galerkin", nu=0.3):
    """A body on another, which it covers in part, pressed and drawn askew."""
    divisions = (3, 2) if cell == "tetrahedron" else (5, 4)
    stack = Stack(divisions, cell, upper=(0.13, 0.83), element=element, nu=nu, comm=comm)
    return stack, [stack.askew("lower")]


def matching(comm):
    """Two blocks, the upper one held by the lower alone; their nodes coincide."""
    blocks = Blocks(divisions=(12, 6), comm=comm)
    loads = [blocks.load((pull, -3.0)) for pull in (0.0, 0.4)]
    states = blocks.contact(blocks.pair(0.3), blocks.clamped(at(1, 0.0)), loads)
    left = reactions(blocks.K, states[-1].displacement, loads[-1]).array_r
    force = ContactFields.of(states[-1], blocks.space).force.x.array[: len(left)]
    wrong = np.abs(left - force).reshape(-1, 2)[~np.isclose(blocks.x[: len(left) // 2, 1], 0.0)]
    assert wrong.max(initial=0.0) < 1e-8 * np.abs(states[-1].pairs[0].force).max()
    return blocks, states


def block(comm):
    body = Block(20, comm=comm)
    owned = body.x[: body.space.dofmap.index_map.size_local, 1]
    parts = comm.allgather(np.isclose(owned, 0.0).any())
    assert comm.size == 1 or sum(parts) > 1, "the partition spares the contact"
    return body, body.solve(0.3, 60.0, increments=2)


def punch(comm):
    body = Punch(comm=comm)
    motions = [Motion((0, None), (0, -217.3)), Motion((None, None), (21.73, -217.3))]
    return body, body.solve(0.6, motions)


def by_seed(seed):
    def solved(comm):
        stated = random_problem(seed, comm)
        return stated, stated.solve()

    return solved


CASES = {
    "block": block,
    "drag": drag,
    "mortar": mortar,
    "flat mortar": lambda comm: mortar(comm, "triangle"),
    "matching": matching,
    "punch": punch,
    "rubber": lambda comm: drag(comm, Spaces.hybrid, 0.5),
    "rubber mortar": lambda comm: mortar(comm, element="hybrid", nu=0.5),
    **{f"seed {seed}": by_seed(seed) for seed in (158, 316)},
}


def passed(comm, surface, depth):
    """Numbers in the message, the same on all processes, on a surface that passes through."""
    case = Punch(comm=comm)
    pair = ContactPair(at(1, 4.0), surface, 0.3, [Motion((0, -depth))])
    with pytest.raises(SurfacePassed) as error:
        case.contact(pair, case.foot)
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
            if len(pair.opposite):
                found[f"{name} {k} opposite force"] = pair.opposite_force
            found[f"{name} {k} translation"] = pair.translation
            found[f"{name} {k} force"] = pair.force
            found[f"{name} {k} displacement"] = state.displacement.norm()
            found[f"{name} {k} smallness"] = list(vars(state.smallness).values())
            found[f"{name} {k} scale"] = list(vars(state.scale).values())
    return found


KINDS = ["NoEquilibrium"] * 8 + ["FreeBody"] * 8


def told(comm):
    """What is logged where, and whether the callback of one process is called there alone."""
    case, lines, seen = Block(8, comm=comm), [], []
    case.pressure.scale(0.01)  # small displacements

    def solved(callback=None):
        return case.contact(case.pair(0.3), case.free, case.pressure, callback=callback)

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
    return fields(state) | {"displacement": state.displacement.norm()}


def everything(comm, before, folder):
    """All that is compared; histories go on from where fewer processes have stopped."""
    found = {"numbers": numbers(comm, folder), "words": messages(comm), "histories": {}}
    for name, history in histories.items():
        problem, steps = history(comm)
        if before is None:
            states = whole(problem, steps)
        else:
            kept = problem.load(before / f"{name}.npz")
            states = [None] * (RESUMED - 1) + [kept, *resumed(problem, steps, kept)]
        problem.save(states[RESUMED - 1], folder / f"{name}.npz")
        found["histories"][name] = list(map(compared, states[RESUMED:]))
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


def assert_same_histories(name, found, last):
    """Written on one process, gone on from on two, from there on three, and back on one."""
    problem, steps = histories[name]()
    back = resumed(problem, steps, problem.load(last / f"{name}.npz"))
    (first,), *later = ([of["histories"][name] for of in processes] for processes in found)
    others = [states for processes in later for states in processes]
    others.append(list(map(compared, back)))
    for states in others:
        for state, known in zip(states, first, strict=True):
            for field, values in known.items():
                scale = values if field == "displacement" else scale_of(field, back)
                assert np.abs(state[field] - values).max() < 1e-9 * scale, f"{name}: {field}"


def assert_told(one, other):
    """One process speaks."""
    (first, lines), (second, others) = one, other
    assert first
    assert second
    assert len(lines) > 2
    assert all(line.startswith(("increment 0: ", "LU by ")) for line in lines)
    assert not any(line.startswith("increment") for line in others)


def test_one_two_and_three_processes_agree(tmp_path):
    """In one test, which other workers would else compute once more for its parts."""
    folders = [tmp_path / str(count) for count in (1, 2, 3)]
    for folder in folders:
        folder.mkdir()
    found = [[everything(MPI.COMM_SELF, None, folders[0])]]
    assert [said.split(":")[0] for said in found[0][0]["words"]] == KINDS
    for count in (2, 3):
        found.append(run_on(count, everything, folders[count - 2], folders[count - 1]))
        for process in found[-1]:
            assert process["words"] == found[0][0]["words"]
            assert_same(found[0][0]["numbers"], process["numbers"], 1e-10, f"of {count}")
        for name in FILES if vtx.library() else ():
            assert_same_files(name, folders[0], folders[count - 1])
    for name in histories:
        assert_same_histories(name, found, folders[-1])
    assert_told(*(process["told"] for process in found[1]))

"""Problems with other friction or stiffness, and tables of results for many values."""

import csv
import logging
from contextlib import ExitStack
from dataclasses import replace
from unittest.mock import patch

from mpi4py import MPI

import dolfinx.jit
import numpy as np
import pytest

from pw_elements import Spaces, prescribe, progress
from pw_elements.contact import SLIP, ContactPair, ContactProblem, Motion, Sphere, solve_for_values
from pw_elements.contact.steps import stepping
from pw_elements.files import ForeignFileOrFolder
from pw_elements.meshes import triangles
from tests.contact.cases import PunchedBlock, make_finite_strain_unknown_and_residual, on_plane
from tests.contact.two_bodies import StackedBlocks
from tests.parallel import assert_same_on_processes

PRESS, PUSH = Motion((0, None), force=(0, -20)), Motion((0.02, None), force=(0, -20))
FRICTION_VALUES = np.linspace(0.0, 0.6, 7)
COMPARED_VALUES = ("displacement", "force_normal", "force_tangential", "slip", "friction", "gap")


def press_and_push(problem, load=None):
    pressed = problem.step(problem.undeformed, load, PRESS)
    return [pressed, problem.step(pressed, load, PUSH)]


def make_punch_problem(block, mu, K=None):
    return ContactProblem(
        block.K if K is None else K, block.base_supports, block.punch_pair(mu), block.space
    )


def summarise(state):
    (pair,) = state.pairs
    return {
        "force": pair.force[0],
        "depth": -pair.translation[1],
        "slipping": np.sum(pair.status == SLIP),
    }


def largest_relative_difference(states, references):
    """Return the largest difference of values of pairs, relative to the largest value."""
    pairs = [
        pair_and_reference
        for state, reference in zip(states, references, strict=True)
        for pair_and_reference in zip(state.pairs, reference.pairs, strict=True)
    ]
    return max(
        np.abs(getattr(pair, name) - getattr(reference, name)).max()
        / max(np.abs(getattr(reference, name)).max() for _, reference in pairs)
        for pair, reference in pairs
        for name in COMPARED_VALUES
        if getattr(reference, name).any()
    )


@pytest.fixture(scope="module")
def block():
    return PunchedBlock()


@pytest.mark.parametrize("initial_mu", [0.0, 0.3])
def test_other_friction_gives_the_same_states_as_a_new_problem(block, initial_mu):
    problem = make_punch_problem(block, initial_mu)
    for mu in FRICTION_VALUES[[0, 3, 6, 1]]:  # also from no friction to friction, and back
        changed = problem.with_changes(friction=mu)
        new = make_punch_problem(block, mu)
        states, references = press_and_push(changed), press_and_push(new)
        assert largest_relative_difference(states, references) < 1e-12
        assert np.array_equal(
            changed.undeformed.pairs[0].friction, references[-1].pairs[0].friction
        )
        assert [s.iterations for s in states] == [s.iterations for s in references]
    assert problem.pairs[0].friction == initial_mu  # not changed
    assert press_and_push(problem)[-1].pairs[0].friction.max() == initial_mu


def test_other_friction_law_and_function(block):
    problem = make_punch_problem(block, 0.3)
    varying = problem.with_changes(friction=lambda x: 0.2 + 0.1 * (x[0] > 0))
    new = make_punch_problem(block, lambda x: 0.2 + 0.1 * (x[0] > 0))
    assert largest_relative_difference(press_and_push(varying), press_and_push(new)) < 1e-12
    for invalid in (-0.1, np.nan, "rough"):
        with pytest.raises(ValueError, match="friction = "):
            problem.with_changes(friction=invalid)
    with pytest.raises(ValueError, match="negative or not finite"):
        problem.with_changes(friction=lambda x: x[0] - 1)
    with pytest.raises(ValueError, match="2 values of friction for 1 contact pairs"):
        problem.with_changes(friction=[0.1, 0.2])


def test_other_stiffness_gives_the_same_states_as_a_new_problem(block):
    problem = make_punch_problem(block, 0.3)
    for ratio in (0.5, 10.0):
        changed = problem.with_changes(stiffness=block.K * ratio, friction=0.2)
        new = make_punch_problem(block, 0.2, block.K * ratio)
        assert largest_relative_difference(press_and_push(changed), press_and_push(new)) < 1e-12
    with pytest.raises(ValueError, match="the stiffness has 110"):
        problem.with_changes(stiffness=PunchedBlock((5, 2)).K)
    with pytest.raises(ValueError, match=r"trace|diagonal|-K"):
        problem.with_changes(stiffness=block.K * -1.0)


def test_series_builds_one_contact_system_and_contact_compiles_nothing(block):
    problem = make_punch_problem(block, 0.3)
    builders = {
        "compilation": (dolfinx.jit, "ffcx_jit"),
        "interface": (stepping, "build_interface"),
        "system": (stepping, "ContactSystem"),
        "rigid motions": (stepping, "RigidMotions"),
    }

    def count_calls(function):
        with ExitStack() as stack:
            calls = {
                name: stack.enter_context(patch.object(*target, side_effect=getattr(*target)))
                for name, target in builders.items()
            }
            function()
            return {name: call.call_count for name, call in calls.items()}

    def solve(mu):
        return summarise(press_and_push(problem.with_changes(friction=mu))[-1])

    in_series = count_calls(lambda: solve_for_values("mu", FRICTION_VALUES, solve))
    assert in_series == {"compilation": 0, "interface": 0, "system": 1, "rigid motions": 1}
    in_new_problem = count_calls(lambda: press_and_push(make_punch_problem(block, 0.3)))
    assert in_new_problem == {"compilation": 0, "interface": 1, "system": 1, "rigid motions": 1}
    assert count_calls(lambda: PunchedBlock((5, 2)).K)["compilation"] >= 1


def test_released_and_rescaled_problems_stay_solvable(block):
    K = block.K.copy()
    problem = make_punch_problem(block, 0.3, K)
    changed = problem.with_changes(friction=0.2)
    references = press_and_push(changed)
    problem.release()  # frees the factors that both share
    assert largest_relative_difference(press_and_push(changed), references) < 1e-12
    K.scale(2.0)
    new = press_and_push(make_punch_problem(block, 0.2, K))
    assert largest_relative_difference(press_and_push(changed), new) < 1e-12
    assert largest_relative_difference(press_and_push(problem.with_changes(friction=0.2)), new) < (
        1e-12
    )


def test_two_bodies_with_other_friction():
    blocks = StackedBlocks((3, 4))
    supports = blocks.fixed_base_moved_top_supports([0.01, -0.02])
    pair = blocks.make_pair(friction=0.0)
    problem = ContactProblem(blocks.K, supports, pair, blocks.space)
    for mu in (0.2, 0.4):
        changed = problem.with_changes(friction=mu)
        new = ContactProblem(blocks.K, supports, replace(pair, friction=mu), blocks.space)
        states, references = ([p.step(p.undeformed)] for p in (changed, new))
        assert largest_relative_difference(states, references) < 1e-12


def test_residual_with_other_friction():
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (8, 4))
    spaces = Spaces.petrov_galerkin(mesh)
    u, F = make_finite_strain_unknown_and_residual(spaces)
    held = [prescribe(spaces.trial, i, on_plane(1, 0.0)) for i in (0, 1)]

    def make_problem(mu):
        roller = ContactPair(on_plane(1, 1.0), Sphere((1.0, 2.0), 1.0), mu)
        return ContactProblem.of_residual(F, u, held, roller)

    def solve(problem):
        pressed = problem.step(problem.undeformed, motions=Motion((0, -0.1)))
        return [pressed, problem.step(pressed, motions=Motion((0.1, -0.1)))]

    problem = make_problem(0.0)
    solve(problem)  # leaves its solution in u
    assert (
        largest_relative_difference(
            solve(problem.with_changes(friction=0.3)), solve(make_problem(0.3))
        )
        < 1e-12
    )
    with pytest.raises(ValueError, match="change constants of the residual"):
        problem.with_changes(stiffness=PunchedBlock((5, 2)).K)


def test_table_has_the_results_of_single_problems(block, tmp_path):
    problem, path = make_punch_problem(block, 0.3), tmp_path / "mu.csv"
    for _ in range(2):  # a table of the same parameter is replaced
        table = solve_for_values(
            "mu",
            FRICTION_VALUES,
            lambda mu: summarise(press_and_push(problem.with_changes(friction=mu))[-1]),
            path,
        )
    assert table.dtype.names == ("mu", "force", "depth", "slipping")
    assert np.array_equal(table["mu"], FRICTION_VALUES)
    for row in table:
        single = summarise(press_and_push(make_punch_problem(block, row["mu"]))[-1])
        assert [row[name] for name in single] == pytest.approx(
            list(single.values()), rel=1e-12, abs=1e-12
        )
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    assert head == ["mu", "force", "depth", "slipping", "failure"]
    assert [[float(x) for x in row[:-1]] for row in rows] == [list(row) for row in table]
    assert {row[-1] for row in rows} == {""}


def push_by_force(problem):
    def solve(force):
        pressed = problem.step(problem.undeformed, None, PRESS)
        pushed = problem.step(pressed, None, Motion((None, None), force=(force, -20)))
        return {"shift": pushed.pairs[0].translation[0]}

    return solve


def test_value_without_solution_gets_nan_and_the_series_goes_on(block, tmp_path, caplog):
    problem, path = make_punch_problem(block, 0.3), tmp_path / "pushes.csv"
    table = solve_for_values("push", [7.0, 2.0], push_by_force(problem), path)
    assert np.isnan(table["shift"][0])
    (message,) = (m for m in caplog.messages if "no solution" in m)
    assert message.startswith("push = 7 (1 of 2): no solution, NoEquilibrium: no contact forces")
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[1][:2] == ["7.0", "nan"]
    assert rows[1][2].startswith("no contact forces")
    assert rows[2] == ["2.0", repr(float(table["shift"][1])), ""]
    alone = solve_for_values("push", [2.0], push_by_force(problem))
    assert table["shift"][1] == pytest.approx(alone["shift"][0], rel=1e-12)
    with pytest.raises(RuntimeError, match="no contact forces balance"):
        solve_for_values("push", [7.0, 8.0], push_by_force(problem))


def test_error_names_the_value_and_keeps_rows(tmp_path):
    path = tmp_path / "table.csv"
    with pytest.raises(ValueError, match=r"solve, at a = 3, failed: ZeroDivisionError"):
        solve_for_values("a", [1.0, 2.0, 3.0], lambda a: {"b": 1 / (a - 3)}, path)
    assert path.read_text() == "a,b,failure\n1.0,-0.5,\n2.0,-1.0,\n"


def test_invalid_results_and_arguments_are_errors(tmp_path):
    for results, message in (
        (None, "at a = 1, returned"),
        ({}, "numbers by name"),
        ({"b": "x"}, "has to be a real number"),
        ({"a": 1.0}, "named a result 'a'"),
        ({3: 1.0}, "named a result 3"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            solve_for_values("a", [1.0], lambda _a, results=results: results)
    with pytest.raises(ValueError, match=r"at a = 2, returned the results \['c'\]"):
        solve_for_values("a", [1.0, 2.0], lambda a: {"b" if a < 2 else "c": a})
    with pytest.raises(ValueError, match="the values of a"):
        solve_for_values("a", [], lambda a: {"b": a})
    with pytest.raises(TypeError, match="solve is 3"):
        solve_for_values("a", [1.0], 3)
    foreign = tmp_path / "notes.csv"
    foreign.write_text("x,y\n1,2\n")
    called = []
    with pytest.raises(ForeignFileOrFolder, match="not replaced"):
        solve_for_values("a", [1.0], lambda a: called.append(a) or {"b": a}, foreign)
    assert not called
    assert foreign.read_text() == "x,y\n1,2\n"


def test_progress_line_counts_values(block, monkeypatch, capsys, caplog):
    problem = make_punch_problem(block, 0.3)
    monkeypatch.setattr(progress, "_MIN_SECONDS_BETWEEN_REPORTS", -1.0)
    # other tests may have left a configuration that makes progress silent
    monkeypatch.setattr(progress.logger, "handlers", [])
    caplog.set_level(logging.WARNING)
    caplog.set_level(logging.NOTSET, "pw_elements")

    def solve(force):
        state = problem.step(problem.undeformed, None, Motion((0, None), force=(0, -force)))
        return {"depth": -state.pairs[0].translation[1]}

    capsys.readouterr()
    solve_for_values("force [N]", [5.0, 10.0], solve)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "0 of 2 values of force [N] done"
    assert "1 of 2 values of force [N] done, contact increment 0" in lines
    caplog.set_level(logging.INFO, "pw_elements")
    solve_for_values("force [N]", [5.0, 10.0], solve)
    assert sum(m.startswith("force [N] = 10 (2 of 2): ") for m in caplog.messages) == 1


def solve_series(comm):
    block = PunchedBlock(comm=comm)
    problem = make_punch_problem(block, 0.3)
    table = solve_for_values(
        "mu",
        FRICTION_VALUES[:4],
        lambda mu: summarise(press_and_push(problem.with_changes(friction=mu))[-1]),
        comm=comm,
    )
    errors = []
    if comm.size > 1:
        for solve in (lambda _: {"rank": comm.rank}, lambda _: {"b": 1 / comm.rank}):
            with pytest.raises(ValueError, match=r"differs|at mu = 0, failed.*ZeroDivision"):
                solve_for_values("mu", [0.0], solve, comm=comm)
            errors.append(solve)
        with pytest.raises(ValueError, match="friction"):
            problem.with_changes(friction=-1.0 if comm.rank else 0.1)
        assert len(errors) == 2
    return {name: table[name] for name in table.dtype.names}


def test_series_is_the_same_on_two_processes():
    assert_same_on_processes(solve_series, process_counts=(2,))

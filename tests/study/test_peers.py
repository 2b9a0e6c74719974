"""Test that recorded answers of CalculiX belong to the current decks and can be reproduced.

The findings of section P show that the decks describe the study's problems, because the answers
agree node by node. Most tests do not need DOLFINx. To run them on a system with CalculiX, use
`python3 -m pytest tests/study/test_peers.py`.
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from study.benchmarks.k_cost import measure, tasks
from study.benchmarks.k_cost.measure import make_calculix_block_on_rough_plane, measure_calculix_run
from study.benchmarks.k_cost.tasks import Measurement
from study.model.corner_forces import corner_over_midside_on_face, corner_over_midside_on_line
from study.publish import renew_records
from study.run import records
from study.solutions.calculix import calculix
from study.solutions.calculix.output import (
    CalculixError,
    read_nodal_values_by_block,
    read_tables_below_heading,
)
from study.solutions.calculix.problems import PROBLEMS
from study.solutions.calculix.standard_decks import SPECIMENS, BlockOnRoughRigidPlane
from study.solutions.felupe import cylinder

ROOT = Path(__file__).parents[2]

needs_calculix = pytest.mark.skipif(
    calculix.find_calculix() is None,
    reason="CalculiX (ccx, Debian's calculix-ccx) is not installed",
)
needs_felupe = pytest.mark.skipif(
    bool(cylinder.find_missing_packages()), reason="felupe or pypardiso is not installed"
)


@pytest.mark.parametrize("case", PROBLEMS)
def test_recorded_answer_has_the_digest_of_its_deck(case):
    deck_digest = records.digest_input(PROBLEMS[case].deck())
    assert calculix.load_recorded_result(case).deck_sha256 == deck_digest


def test_recorded_calculix_rows_have_only_its_version_and_numbers():
    for row in records.read_rows(records.CALCULIX).values():
        assert row.versions.keys() == {"calculix"}
        assert row.content.keys() == {"numbers"}


@needs_calculix
def test_check_notices_a_changed_number_and_a_changed_deck(tmp_path, monkeypatch, capsys):
    key = "calculix/two-triangles"
    row = records.read_rows(records.CALCULIX)[key]
    monkeypatch.setattr(records, "CALCULIX", tmp_path / "record.json")
    records.write_rows(records.CALCULIX, [row])
    assert renew_records.main(["--check", key]) == 0
    reaction = row.content["numbers"]["reaction"]
    changed = [reaction[0], reaction[1] * (1 + 1e-4), *reaction[2:]]
    numbers = row.content["numbers"] | {"reaction": changed}
    records.write_rows(records.CALCULIX, [replace(row, content={"numbers": numbers})])
    assert renew_records.main(["--check", key]) == 1
    records.write_rows(records.CALCULIX, [replace(row, input_sha256="0" * 64)])
    assert renew_records.main(["--check", key]) == 1
    assert renew_records.main([key]) == 0  # writes the row again
    assert renew_records.main(["--check", key]) == 0
    messages = capsys.readouterr().err
    assert "differs by 1.0e-04" in messages
    assert "the input is not the one of the record" in messages


@needs_calculix
def test_a_deck_that_calculix_refuses_is_an_error(monkeypatch):
    problem = replace(PROBLEMS["two-triangles"])
    deck = problem.deck().replace("*ELASTIC", "*PLASTIC", 1)
    monkeypatch.setattr(type(problem), "deck", lambda _: deck)
    with pytest.raises(CalculixError, match="two-triangles: CalculiX failed"):
        calculix.run_calculix_on_problem("two-triangles", calculix.find_calculix())


def test_largest_difference_is_relative_and_infinite_for_other_shapes():
    answer = calculix.CalculixResult("1", "", {"a": np.array([1.0, 2.0])})
    assert calculix.largest_relative_difference(answer, answer) == 0.0
    changed_answer = replace(answer, numbers={"a": np.array([1.0, 2.0 + 1e-3])})
    assert calculix.largest_relative_difference(changed_answer, answer) == pytest.approx(
        1e-3 / 2.001
    )
    assert (
        calculix.largest_relative_difference(
            replace(answer, numbers={"a": np.array([1.0])}), answer
        )
        == np.inf
    )


def test_tables_of_calculix_output_are_read_below_their_headings():
    output = """
 forces (fx,fy,fz) for set A and time  0.1E+01

        12 -5.5E-16  1.6E-01  0.0E+00
        13  1.0E-16  6.6E-01  0.0E+00

 displacements (vx,vy,vz) for set A and time  0.1E+01

        12  0.0E+00  1.0E+00  0.0E+00

 forces (fx,fy,fz) for set A and time  0.2E+01

        12  0.0E+00  3.0E+00  0.0E+00
"""
    first, second = read_tables_below_heading(output, "forces")
    assert first.tolist() == [[12, -5.5e-16, 0.16, 0], [13, 1e-16, 0.66, 0]]
    assert second.tolist() == [[12, 0, 3, 0]]


def test_no_number_of_a_deck_is_longer_than_calculix_reads():
    for problem in (*SPECIMENS.values(), make_calculix_block_on_rough_plane(8)):
        data_lines = (line for line in problem.deck().splitlines() if not line.startswith("*"))
        assert max(len(number) for line in data_lines for number in line.split(",")) <= 20


def test_benchmark_blocks_have_the_documented_sizes_and_decks(tmp_path):
    assert [3 * len(make_calculix_block_on_rough_plane(n).grid.nodes) for n in (8, 11)] == [
        28_611,
        71_415,
    ]
    command = [sys.executable, "-m", "tests.speed.calculix_block", "--cells", "2"]
    subprocess.run([*command, "--deck", str(tmp_path)], cwd=ROOT, check=True)
    assert (tmp_path / "block-2.inp").read_text() == make_calculix_block_on_rough_plane(2).deck()


@needs_calculix
def test_cost_of_calculix_is_measured_and_a_failed_run_is_refused(monkeypatch):
    cost = measure_calculix_run(calculix.find_calculix(), make_calculix_block_on_rough_plane(2))
    assert cost["dofs"] == 3 * len(make_calculix_block_on_rough_plane(2).grid.nodes)
    assert cost["iterations"] > 1
    assert cost["whole_seconds"] > 0
    assert cost["megabytes"] > 5
    monkeypatch.setattr(BlockOnRoughRigidPlane, "deck", lambda _: "*NODE\n*PLASTIC\n")
    with pytest.raises(CalculixError, match="CalculiX failed"):
        measure_calculix_run(calculix.find_calculix(), make_calculix_block_on_rough_plane(2))


# Comparisons of cost


def test_rows_compared_with_other_programs_have_the_versions_of_their_program():
    rows = records.read_rows(records.TIME_AND_MEMORY).values()
    compared = {
        measure.measurement_from_record_row(row): row.versions
        for row in rows
        if row.key.startswith("K/peer-")
    }
    assert {measurement.peer for measurement in compared} == {"", *tasks.PEERS}
    for measurement, versions in compared.items():
        program = {"CalculiX": "calculix", "felupe": "felupe", "": "dolfinx"}[measurement.peer]
        assert program in versions, measurement.key


def test_rows_of_a_comparison_need_its_program(monkeypatch):
    monkeypatch.setattr(calculix, "find_calculix", lambda: None)
    monkeypatch.setattr(cylinder, "PACKAGES", ("numpy", "no_such_package"))
    missing = {
        measurement.key: measure.find_missing_peer(measurement)
        for measurement in measure.list_measurements()
    }
    assert "ccx" in missing["K/peer-block-pw-T10-5-Iterative"]
    assert missing["K/peer-rubber-pw-T6-16-Direct"] == (
        "no_such_package (packages of Python) not installed"
    )
    assert "ccx" in missing["K/contact-C3D10-8-CalculiX"]
    assert not missing["K/contact-pw-T10-8-Iterative"]


def test_runs_of_a_comparison_alternate_and_the_fastest_counts(monkeypatch):
    compared = [m for m in measure.list_measurements() if m.task == "peer-rubber"]
    seconds = iter([3.0, 7.0, 9.0, 2.0, 8.0, 8.0, 4.0, 6.0, 7.0])
    measured = []

    def measure_next_run(measurement):
        measured.append(measurement)
        return {"whole_seconds": next(seconds), "run": len(measured)}

    monkeypatch.setattr(measure, "measure_one_run_in_new_processes", measure_next_run)
    fastest = measure.measure_alternately.__wrapped__("peer-rubber")
    assert measured == 3 * compared
    assert [fastest[m] for m in compared] == [
        {"whole_seconds": 2.0, "run": 4},
        {"whole_seconds": 6.0, "run": 8},
        {"whole_seconds": 7.0, "run": 9},
    ]


def test_an_environment_variable_names_calculix(tmp_path, monkeypatch):
    monkeypatch.setenv("CALCULIX", str(tmp_path / "ccx"))
    assert calculix.find_calculix() is None
    (tmp_path / "ccx").write_text("#!/bin/sh\n")
    (tmp_path / "ccx").chmod(0o700)
    assert calculix.find_calculix() == str(tmp_path / "ccx")


def test_ratios_of_corner_and_midside_forces():
    """The rim and the ends, which carry other forces, are left out."""
    line = np.array([9.0, 9.0, 9.0, 2.0, 1.0, 2.0, 1.0, 2.0, 9.0, 9.0, 9.0])
    is_corner = np.arange(11) % 2 == 1
    assert corner_over_midside_on_line(line, is_corner) == pytest.approx(2.0)
    cells = 4
    x, y = (a.ravel() for a in np.meshgrid(np.arange(17) / 8, np.arange(9) / 8, indexing="ij"))
    index = cells * np.column_stack([x, y])
    force = np.where((index == np.round(index)).all(axis=1), 0.5, 2.0)
    is_rim = (x < 0.3) | (x > 1.7) | (y < 0.3) | (y > 0.7)
    force[is_rim] = 100.0
    position = np.column_stack([x, y, 0 * x])
    assert corner_over_midside_on_face(position, force, cells) == pytest.approx(0.25)


def test_contact_of_calculix_at_nodes_differs_only_in_its_type():
    decks = [make_calculix_block_on_rough_plane(2, by_nodes).deck() for by_nodes in (False, True)]
    assert decks[1] == decks[0].replace("TYPE=SURFACE TO SURFACE", "TYPE=NODE TO SURFACE")
    assert decks[1] != decks[0]


@needs_calculix
def test_nodal_forces_of_calculix_balance_the_loads():
    pytest.importorskip("dolfinx", reason="DOLFINx is not installed")
    run = Measurement("peer-block", "C3D10", 4, "CalculiX-nodes")
    numbers = measure.measure_one_run_in_new_processes(run)
    assert numbers["normal"] == pytest.approx(200.0, rel=1e-4)
    assert numbers["tangential"] == pytest.approx(20 * 1.25**0.5, rel=1e-4)
    assert abs(numbers["corner_over_mid"]) < 0.05


@needs_felupe
def test_felupe_computes_the_forces_of_the_library():
    pytest.importorskip("dolfinx", reason="DOLFINx is not installed")
    compared = [
        Measurement("peer-rubber", "galerkin-T6", 8, "Direct"),
        Measurement("peer-rubber", "triangle6", 8, "felupe"),
    ]
    ours, peers = map(measure.measure_one_run_in_new_processes, compared)
    assert ours.keys() == peers.keys()
    assert peers["dofs"] == ours["dofs"]
    for force in ("normal", "tangential"):
        assert peers[force] == pytest.approx(ours[force], rel=0.02)


def test_renewal_of_records_imports_no_dolfinx():
    module = "study.publish.renew_records"
    code = f"import sys, {module}; print({{'dolfinx', 'mpi4py'}} & set(sys.modules))"
    completed = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert completed.stdout == "set()\n"


def test_node_values_are_read_from_a_file_of_results():
    file_text = (
        "    1PSTEP                         1\n"
        " -4  DISP        4    1\n"
        " -5  D1          1    2    1    0\n"
        " -1       442-1.09849E-06 0.00000E+00 1.97729E+02\n"
        " -1         7 1.00000E+00-2.00000E+00 3.00000E+00\n"
        " -3\n"
        " -1         8 1.00000E+00\n"
        " -4  CONTACT     6    1\n"
        " -1         9 4.00000E+00\n"
        " -3\n"
    )
    assert read_nodal_values_by_block(file_text) == {
        "DISP": {442: [-1.09849e-6, 0.0, 197.729], 7: [1.0, -2.0, 3.0]},
        "CONTACT": {9: [4.0]},
    }


@pytest.mark.parametrize("problem", ["two-triangles", "statics-C3D10"])
def test_recorded_answer_with_another_digest_is_refused(problem):
    pytest.importorskip("dolfinx", reason="DOLFINx is not installed")
    from study.benchmarks.p_calculix import page

    compare = page.reactions if problem == "two-triangles" else page.against_standard
    with pytest.raises(ValueError, match=f"{problem} has changed"):
        compare(problem, "0")

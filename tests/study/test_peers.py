"""CalculiX's tracked answers: from these decks, and the same when it is run again.

Whether the decks are of our problems, findings of section P tell: answers agree node by node.

Runs without DOLFINx too: `python3 -m pytest tests/study/test_peers.py` where CalculiX is.
"""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from study.solutions.calculix import calculix
from study.solutions.calculix.printed import fields, tables
from study.solutions.calculix.problems import PROBLEMS
from study.solutions.calculix.standard_decks import SPECIMENS, RoughBlock
from tests.speed import calculix_block

ROOT = Path(__file__).parents[2]

needs_ccx = pytest.mark.skipif(
    calculix.executable() is None, reason="CalculiX (ccx, Debian's calculix-ccx) is not installed"
)


@pytest.mark.parametrize("case", PROBLEMS)
def test_tracked_file_belongs_to_the_deck(case):
    assert calculix.load(case).deck_sha256 == calculix.digest(PROBLEMS[case].deck())


def test_each_case_has_a_tracked_file_of_version_deck_and_numbers_alone():
    assert {path.stem for path in calculix.RESULTS.iterdir()} == set(PROBLEMS)
    for case in PROBLEMS:
        content = json.loads((calculix.RESULTS / f"{case}.json").read_text())
        assert set(content) == {"case", "program", "version", "deck_sha256", "numbers"}
        assert content["case"] == case


@needs_ccx
def test_check_notices_a_changed_number_and_a_changed_deck(tmp_path, monkeypatch, capsys):
    shutil.copytree(calculix.RESULTS, tmp_path / "results")
    monkeypatch.setattr(calculix, "RESULTS", tmp_path / "results")
    assert calculix.main(["--check", "two-triangles"]) == 0
    path = tmp_path / "results" / "two-triangles.json"
    content = json.loads(path.read_text())
    content["numbers"]["reaction"][1] *= 1 + 1e-4
    path.write_text(json.dumps(content))
    assert calculix.main(["--check", "two-triangles"]) == 1
    content["deck_sha256"] = "0" * 64
    path.write_text(json.dumps(content))
    assert calculix.main(["--check", "two-triangles"]) == 1
    said = capsys.readouterr().err
    assert "differs by 1.0e-04" in said
    assert "the deck is not that of the tracked file" in said


@needs_ccx
def test_a_deck_that_calculix_refuses_is_an_error(monkeypatch):
    unheld = replace(PROBLEMS["two-triangles"])
    deck = unheld.deck().replace("*ELASTIC", "*PLASTIC", 1)
    monkeypatch.setattr(type(unheld), "deck", lambda _: deck)
    with pytest.raises(calculix.PeerError, match="two-triangles: CalculiX failed"):
        calculix.compute("two-triangles", calculix.executable())


def test_without_calculix_the_program_says_so(monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    assert calculix.main(["--check"]) == 1
    assert "not installed" in capsys.readouterr().err


def test_difference_sees_shape_and_size():
    peer = calculix.Peer("1", "", {"a": np.array([1.0, 2.0])})
    assert calculix.difference(peer, peer) == 0.0
    other = replace(peer, numbers={"a": np.array([1.0, 2.0 + 1e-3])})
    assert calculix.difference(other, peer) == pytest.approx(1e-3 / 2.001)
    assert calculix.difference(replace(peer, numbers={"a": np.array([1.0])}), peer) == np.inf


def test_tables_are_found_below_their_headings():
    printed = """
 forces (fx,fy,fz) for set A and time  0.1E+01

        12 -5.5E-16  1.6E-01  0.0E+00
        13  1.0E-16  6.6E-01  0.0E+00

 displacements (vx,vy,vz) for set A and time  0.1E+01

        12  0.0E+00  1.0E+00  0.0E+00

 forces (fx,fy,fz) for set A and time  0.2E+01

        12  0.0E+00  3.0E+00  0.0E+00
"""
    first, second = tables(printed, "forces")
    assert first.tolist() == [[12, -5.5e-16, 0.16, 0], [13, 1e-16, 0.66, 0]]
    assert second.tolist() == [[12, 0, 3, 0]]


def test_no_number_of_a_deck_is_longer_than_calculix_reads():
    for problem in (*SPECIMENS.values(), calculix_block.block(8)):
        data = (line for line in problem.deck().splitlines() if not line.startswith("*"))
        assert max(len(number) for line in data for number in line.split(",")) <= 20


def test_blocks_of_the_benchmark_are_as_large_as_they_are_said_to_be(tmp_path):
    assert [3 * len(calculix_block.block(n).grid.nodes) for n in (8, 11)] == [28_611, 71_415]
    command = [sys.executable, "-m", "tests.speed.calculix_block", "--cells", "2"]
    subprocess.run([*command, "--deck", str(tmp_path)], cwd=ROOT, check=True)
    assert (tmp_path / "block-2.inp").read_text() == calculix_block.block(2).deck()


@needs_ccx
def test_benchmark_tells_the_cost_of_a_run_and_refuses_a_failed_one(monkeypatch):
    cost = calculix_block.measure(calculix.executable(), calculix_block.block(2))
    assert cost.iterations > 1
    assert cost.cpu > 0
    assert cost.megabytes > 5
    monkeypatch.setattr(RoughBlock, "deck", lambda _: "*NODE\n*PLASTIC\n")
    with pytest.raises(calculix.PeerError, match="CalculiX failed"):
        calculix_block.measure(calculix.executable(), calculix_block.block(2))


def test_script_starts_without_dolfinx():
    module = "study.solutions.calculix.calculix"
    code = f"import sys, {module}; print({{'dolfinx', 'mpi4py'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "set()\n"


def test_fields_of_a_file_of_results():
    written = (
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
    assert fields(written) == {
        "DISP": {442: [-1.09849e-6, 0.0, 197.729], 7: [1.0, -2.0, 3.0]},
        "CONTACT": {9: [4.0]},
    }


@pytest.mark.parametrize("problem", ["two-triangles", "statics-C3D10"])
def test_a_file_that_has_changed_meanwhile_is_refused(problem):
    pytest.importorskip("dolfinx", reason="DOLFINx is not installed")
    from study.benchmarks.p_calculix import page

    run = page.reactions if problem == "two-triangles" else page.against_standard
    with pytest.raises(ValueError, match=f"{problem} has changed"):
        run(problem, "0")

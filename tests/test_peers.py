"""CalculiX's tracked answers: from these decks, and the same when it is run again.

Runs without DOLFINx too: `python3 -m pytest tests/test_peers.py` where CalculiX is.
"""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from study.peers import calculix
from study.peers.decks import BOTTOM, LEFT, PROBLEMS, RIGHT, TOP, Block, HalfBeam, TrianglePairs

ROOT = Path(__file__).parents[1]
MESH = TrianglePairs((0.0, -1.0), (3.0, 1.0), (3, 2))

needs_ccx = pytest.mark.skipif(
    calculix.executable() is None, reason="CalculiX (ccx, Debian's calculix-ccx) is not installed"
)


@needs_ccx
@pytest.mark.parametrize("case", PROBLEMS)
def test_calculix_gives_the_tracked_numbers_again(case):
    new, old = calculix.compute(case, calculix.executable()), calculix.load(case)
    assert new.deck_sha256 == old.deck_sha256
    assert calculix.difference(new, old) < calculix.TOLERANCE


@pytest.mark.parametrize("case", PROBLEMS)
def test_tracked_file_belongs_to_the_deck(case):
    assert calculix.load(case).deck_sha256 == calculix.digest(PROBLEMS[case].deck())


def test_there_is_a_tracked_file_for_each_case_and_no_other():
    assert {path.stem for path in calculix.RESULTS.iterdir()} == set(PROBLEMS)


def test_a_tracked_file_says_nothing_but_version_deck_and_numbers():
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
    first, second = calculix.tables(printed, "forces")
    assert first.tolist() == [[12, -5.5e-16, 0.16, 0], [13, 1e-16, 0.66, 0]]
    assert second.tolist() == [[12, 0, 3, 0]]


@pytest.mark.parametrize(
    ("elements", "face", "axis", "value"),
    [
        (MESH.bottom(), BOTTOM, 1, -1.0),
        (MESH.top(1.0, 3.0), TOP, 1, 1.0),
        (MESH.left(), LEFT, 0, 0.0),
        (MESH.right(), RIGHT, 0, 3.0),
    ],
)
def test_faces_lie_on_their_side(elements, face, axis, value):
    assert len(elements) == 2 + (elements == MESH.bottom())
    x = np.array(MESH.nodes)
    for element in elements:
        cell = MESH.elements[element - 1]
        side = [cell[face - 1], cell[face % 3], cell[3 + face - 1]]
        assert [x[k - 1, axis] for k in side] == [value] * 3


def test_mid_side_nodes_are_in_the_middle_and_triangles_turn_left():
    x = np.array(MESH.nodes)
    for cell in MESH.elements:
        corners, middles = x[np.array(cell[:3]) - 1], x[np.array(cell[3:]) - 1]
        assert middles == pytest.approx((corners + np.roll(corners, -1, axis=0)) / 2)
        (a, b), (c, d) = corners[1] - corners[0], corners[2] - corners[0]
        assert a * d - b * c > 0


def test_block_has_the_constants_of_plane_stress():
    """E / (1 - nu^2) and shear modulus are those of plane strain with the converted ones."""
    problem = Block()
    E, nu = problem._constants()
    plane_strain = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    assert plane_strain == pytest.approx(problem.modulus / (1 - problem.ratio**2))
    assert E / (1 + nu) == pytest.approx(problem.modulus / (1 + problem.ratio))


def test_script_starts_without_dolfinx():
    code = "import sys, study.peers.calculix; print({'dolfinx', 'mpi4py'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "set()\n"


class TestAgainstOurs:
    """What needs DOLFINx."""

    @pytest.fixture(autouse=True)
    def _dolfinx(self):
        pytest.importorskip("dolfinx", reason="DOLFINx is not installed")

    def test_meshes_are_the_study_s(self):
        from pw_elements._compat import cell_nodes
        from study.peers.p_compare import _triangles

        mesh = _triangles(MESH)
        ours = mesh.geometry.x[cell_nodes(mesh)][:, :, :2]
        theirs = np.array(MESH.nodes)[np.array(MESH.elements)[:, :3] - 1]

        def triangles(corners):
            return sorted(sorted(map(tuple, np.round(cell, 9).tolist())) for cell in corners)

        assert triangles(ours) == triangles(theirs)

    def test_examples_are_the_study_s(self):
        from study.paper import s7_2_block, s7_6_buckling

        block = Block()
        assert (block.modulus, block.ratio) == (
            s7_2_block.YOUNGS_MODULUS,
            s7_2_block.POISSONS_RATIO,
        )
        assert block.mesh.upper == (s7_2_block.LENGTH, s7_2_block.HEIGHT)
        assert (block.pressure, block.mesh.divisions) == (s7_2_block.PRESSURE, s7_2_block.DIVISIONS)
        assert block.increments == s7_2_block.INCREMENTS
        assert PROBLEMS["block-friction-0.30"].friction == s7_2_block.FRICTION
        beam = HalfBeam((8, 2), 1)
        assert (beam.modulus, beam.ratio) == (
            s7_6_buckling.YOUNGS_MODULUS,
            s7_6_buckling.POISSONS_RATIO,
        )
        assert (beam.length, beam.height, beam.thickness) == (
            s7_6_buckling.LENGTH,
            s7_6_buckling.HEIGHT,
            s7_6_buckling.THICKNESS,
        )

    @pytest.mark.parametrize("case", ["block-part", "block-lifting", "block-friction-0.30"])
    def test_forces_agree_node_by_node(self, case):
        from study.peers import p_compare

        scalars = p_compare.contact(case, calculix.tracked_digest(case)).scalars
        directions = ["normal"] + ["tangential"] * ("friction" in case)
        for name in directions:
            assert scalars[f"raw_{name}"] < 5e-4
            assert scalars[f"beyond_control_{name}"] < 5e-4
            assert scalars[f"elsewhere_{name}"] < 5e-3

    def test_a_file_that_has_changed_meanwhile_is_refused(self):
        from study.peers import p_compare

        with pytest.raises(ValueError, match="two-triangles has changed"):
            p_compare.reactions("two-triangles", "0")

"""CalculiX's tracked answers: from these decks, and the same when it is run again.

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

from study.benchmarks import calculix_block
from study.peers import calculix
from study.peers.decks import BOTTOM, LEFT, RIGHT, TOP, Block, HalfBeam, TrianglePairs
from study.peers.grids import Grid
from study.peers.printed import fields, tables
from study.peers.problems import PROBLEMS
from study.peers.standard_decks import SPECIMENS, RoughBlock
from study.peers.two_bodies import PAIRS

ROOT = Path(__file__).parents[2]
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
    first, second = tables(printed, "forces")
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


@pytest.fixture(params=["T6", "Q8", "T10"])
def grid(request):
    if request.param == "T10":
        return Grid("T10", (0.5, 0.0, -1.0), (2.0, 1.0, 1.0), (3, 2, 2))
    return Grid(request.param, (0.5, 0.0), (2.0, 1.0), (3, 2))


EDGES = {"T6": "01 12 20", "Q8": "01 12 23 30", "T10": "01 12 20 03 13 23"}


def test_mid_side_nodes_of_a_grid_are_in_the_middle(grid):
    x = np.array(grid.nodes)
    edges = [(int(a), int(b)) for a, b in EDGES[grid.cell].split()]
    for cell in grid.elements:
        nodes = x[np.array(cell) - 1]
        middles = np.array([(nodes[a] + nodes[b]) / 2 for a, b in edges])
        assert nodes[-len(edges) :] == pytest.approx(middles)
    assert {node for cell in grid.elements for node in cell} == set(range(1, len(x) + 1))
    assert len({tuple(place) for place in x.tolist()}) == len(x)


def test_cells_of_a_grid_are_not_inside_out_and_fill_it(grid):
    x = np.array(grid.nodes)
    corners = [x[np.array(cell) - 1][: len(grid.lower) + 1] for cell in grid.elements]
    volumes = [np.linalg.det(c[1:] - c[0]) for c in corners]
    share = {"T6": 1 / 2, "Q8": 1, "T10": 1 / 6}[grid.cell]
    assert min(volumes) > 0
    assert sum(volumes) * share == pytest.approx(np.prod(np.subtract(grid.upper, grid.lower)))


def test_faces_of_a_grid_cover_its_sides_once(grid):
    up = len(grid.lower) - 1
    faces = grid.faces_where(lambda x: x[up] == grid.upper[up])
    nodes = [set(grid.face(*face)) for face in faces]
    assert set.union(*nodes) == set(grid.nodes_where(lambda x: x[up] == grid.upper[up]))
    assert len(faces) == (3 if up == 1 else 3 * 2 * 2)
    assert {len(face) for face in nodes} == {3 if up == 1 else 6}


def test_a_grid_bulges_between_its_ends(grid):
    wide = replace(grid, bulge=0.2)
    x, y = np.array(grid.nodes), np.array(wide.nodes)
    ends = (x[:, 0] == 0.5) | (x[:, 0] == 2.0)
    assert y[ends] == pytest.approx(x[ends])
    assert np.ptp(y[:, 1]) == pytest.approx(1.2 * np.ptp(x[:, 1]), rel=0.03)


def test_a_push_on_mid_side_nodes_is_the_traction_times_the_area():
    block = SPECIMENS["contact-C3D10-surface"]
    rows = [line.split(",") for line in block.pushed(block.on(0, 0.0), (0.02, 0.01))[1:]]
    for axis, size in (("1", 0.02), ("2", 0.01)):
        assert sum(float(force) for _, a, force in rows if a == axis) == pytest.approx(size)


def test_no_number_of_a_deck_is_longer_than_calculix_reads():
    for problem in (*SPECIMENS.values(), calculix_block.block(8)):
        data = (line for line in problem.deck().splitlines() if not line.startswith("*"))
        assert max(len(number) for line in data for number in line.split(",")) <= 20


def test_blocks_of_the_benchmark_are_as_large_as_they_are_said_to_be(tmp_path):
    assert [3 * len(calculix_block.block(n).grid.nodes) for n in (8, 11)] == [28_611, 71_415]
    command = [sys.executable, "-m", "study.benchmarks.calculix_block", "--cells", "2"]
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

    @pytest.mark.parametrize(
        ("case", "name", "reduced", "exact"),
        [
            ("statics-C3D10", "displacement", 1e-6, 0.0),
            ("statics-C3D10-curved", "reaction", 1e-6, 1e-3),
            ("statics-CAX6", "reaction", 1e-6, 1e-4),
            ("frequencies-CAX6", "eigenvalue", 1e-6, 1e-3),
            ("frequencies-CAX8", "eigenvalue", 1e-6, 1e-6),
            ("frequencies-C3D10-curved", "eigenvalue", 1e-6, 1e-3),
            ("buckling-CPE6", "critical_pressure", 1e-6, 0.0),
            ("buckling-CPE8", "critical_pressure", 1e-6, 0.0),
            ("contact-CAX6", "force_normal", 2e-5, 1e-3),
            ("contact-C3D10", "force_normal", 2e-5, 0.0),
            ("contact-C3D10-friction", "force_tangential", 2e-3, 0.0),
        ],
    )
    def test_differences_are_those_of_quadrature(self, case, name, reduced, exact):
        from study.peers import p_standard

        scalars = p_standard.against_standard(case, calculix.tracked_digest(case)).scalars
        assert scalars[f"reduced_{name}"] < reduced
        assert scalars[f"exact_{name}"] > exact

    @pytest.mark.parametrize("problem", ["two-triangles", "statics-C3D10"])
    def test_a_file_that_has_changed_meanwhile_is_refused(self, problem):
        from study.peers import p_compare, p_standard

        run = p_compare.reactions if problem == "two-triangles" else p_standard.against_standard
        with pytest.raises(ValueError, match=f"{problem} has changed"):
            run(problem, "0")


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


@pytest.mark.parametrize("case", PAIRS)
def test_faces_of_two_bodies_meet(case):
    problem = PAIRS[case]
    slave, master = (problem.nodes[nodes - 1] for nodes in (problem.slave, problem.master))
    assert set(problem.slave) | set(problem.master) <= set(problem.around)
    radius = getattr(problem, "radius", np.inf)
    assert slave[:, 2] == pytest.approx(slave[0, 2], abs=1e-15)
    heights = (master[:, 0] ** 2 + master[:, 1] ** 2) / (2 * radius)
    assert master[:, 2] - slave[0, 2] == pytest.approx(heights, abs=1e-15)
    for nodes in (problem.slave, problem.master):
        held = {node for node, _, _ in problem.supports()} & set(nodes)
        assert bool(held) == ("spheres" in case)  # supports that mortar could not have

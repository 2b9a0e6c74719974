"""The library finds the same meshes and sets in Abaqus decks as two independent readers.

One of them is CalculiX, the other one is `IndependentDeckReader`.
"""

import json

from mpi4py import MPI

import basix
import numpy as np
import pytest
import ufl
from dolfinx.fem import functionspace, locate_dofs_topological

from pw_elements import assemble_scalar
from pw_elements._compat import cell_geometry_nodes
from pw_elements.meshes import from_file
from tests.library import deck_calculix
from tests.library.deck_models import DECKS_BY_ELEMENT_TYPE
from tests.library.deck_reading import IndependentDeckReader
from tests.library.hostile_decks import HOSTILE_DECK_FILES_AND_REFUSAL_BY_NAME

COMM = MPI.COMM_SELF
needs_calculix = pytest.mark.skipif(
    deck_calculix.find_calculix_executable() is None,
    reason="CalculiX (ccx, Debian's calculix-ccx) is not installed",
)


def read_deck_text(folder, deck_text, **options):
    data = deck_text if isinstance(deck_text, bytes) else deck_text.encode()
    (folder / "deck.inp").write_bytes(data)
    return from_file(folder / "deck.inp", COMM, **options)


def corner_coordinates(tagged_mesh, dim, entity_numbers):
    """Return the corners of cells or facets, each as a frozen set of coordinates."""
    mesh = tagged_mesh.mesh
    cell_type = mesh.basix_cell()
    corner_columns = np.arange(len(basix.geometry(cell_type)))[None]  # corners are the first nodes
    cells, local_facet = np.asarray(entity_numbers), np.zeros(len(entity_numbers), dtype=int)
    if dim < mesh.topology.dim:
        mesh.topology.create_connectivity(dim, mesh.topology.dim)
        cells_of_facet = mesh.topology.connectivity(dim, mesh.topology.dim)
        facets_of_cell = mesh.topology.connectivity(mesh.topology.dim, dim)
        cells = np.array([cells_of_facet.links(entity)[0] for entity in entity_numbers], dtype=int)
        local_facet = [
            np.flatnonzero(facets_of_cell.links(cell) == entity)[0]
            for cell, entity in zip(cells, entity_numbers, strict=True)
        ]
        corner_columns = np.array(basix.topology(cell_type)[dim])
    nodes = np.take_along_axis(
        cell_geometry_nodes(mesh)[cells], corner_columns[local_facet], axis=1
    )
    return [frozenset(map(tuple, rows)) for rows in mesh.geometry.x[nodes].tolist()]


def integrate_over_cells(tagged_mesh, cells=None, weight=1.0, quadrature_degree=9):
    """Return the integral of a weight over the given cells, or over all cells by default."""
    mesh, metadata = tagged_mesh.mesh, {"quadrature_degree": quadrature_degree}
    if cells is None:
        return assemble_scalar(weight * ufl.dx(mesh, metadata=metadata))
    dx = ufl.Measure("dx", mesh, subdomain_data=[(1, cells)], metadata=metadata)
    return assemble_scalar(weight * dx(1))


def assert_equal_to_independent_reading(tagged_mesh, deck_path):
    """Assert that an independent reading of a deck gives the sets and the volume of a mesh.

    Members of sets are compared by the coordinates of their corners.
    """
    reading, dim = IndependentDeckReader(deck_path), tagged_mesh.mesh.topology.dim
    mesh = tagged_mesh.mesh
    expected = {
        name: members
        for name, members in reading.get_cell_corners_by_set().items()
        if name[0] != "_"
    }
    assert {*tagged_mesh.names["cells"]} == {*expected}
    for name, members in expected.items():
        facets_or_cells = corner_coordinates(tagged_mesh, dim, tagged_mesh.cells(name))
        assert len(facets_or_cells) == len({*facets_or_cells})
        assert {*facets_or_cells} == members, name
    expected = {
        name: members
        for name, members in reading.get_facet_corners_by_set().items()
        if name[0] != "_"
    }
    assert {*tagged_mesh.names["facets"]} == {*expected}
    for name, members in expected.items():
        assert {*corner_coordinates(tagged_mesh, dim - 1, tagged_mesh.facets(name))} == members, (
            name
        )
    used_nodes = {
        reading.nodes[n]
        for _, _, nodes in reading.iterate_cells_of_highest_dimension()
        for n in nodes
    }
    assert used_nodes <= {*map(tuple, mesh.geometry.x.tolist())}
    volumes = reading.compute_cell_volumes()
    assert mesh.topology.index_map(dim).size_local == len(volumes)
    assert integrate_over_cells(tagged_mesh) == pytest.approx(sum(volumes.values()), rel=1e-12)


@pytest.mark.parametrize("kind", DECKS_BY_ELEMENT_TYPE)
def test_an_independent_reader_finds_the_same_sets_and_volume(tmp_path, kind):
    part = read_deck_text(tmp_path, DECKS_BY_ELEMENT_TYPE[kind])
    assert len(part.names["cells"]) == 4
    assert {*part.names["facets"]} == {"ALL", "EVERYTHING", "BOTTOM", "BASE", "FRONT"}
    assert_equal_to_independent_reading(part, tmp_path / "deck.inp")


def assert_equal_to_calculix(tagged_mesh, deck_path, element_type, calculix_result):
    """Assert that the volumes of cells in sets, and the facets of node sets, are CalculiX's.

    CalculiX prints seven digits. Its axisymmetric elements are wedges of two degrees, whose round
    side is a chord (for elements of degree 1) or close to the arc (degree 2). Its quadrature of
    curved tetrahedra and of reduced elements is inexact, so the same number of points is used here.
    """
    weight = 1.0
    degree = (
        2
        if element_type in ("CAX6", "C3D10", "C3D10T")
        else 3
        if element_type in ("CAX8R", "C3D20R")
        else 9
    )
    if element_type.startswith("CAX"):
        angle = np.radians(2)
        is_straight = element_type in ("CAX3", "CAX4")
        weight = ufl.SpatialCoordinate(tagged_mesh.mesh)[0] * (
            np.sin(angle) if is_straight else angle
        )
    for name in deck_calculix.PRINTED_ELEMENT_SETS:
        expected = sorted(calculix_result["volumes"][str(n)] for n in calculix_result["sets"][name])
        cells = tagged_mesh.cells(name)
        volumes = sorted(
            integrate_over_cells(tagged_mesh, np.array([cell]), weight, degree) for cell in cells
        )
        assert volumes == pytest.approx(expected, rel=1e-6), name
    reading, dim = IndependentDeckReader(deck_path), tagged_mesh.mesh.topology.dim - 1
    reading.sets["NSET"] = {
        name: {*calculix_result["sets"][name]} for name in deck_calculix.PRINTED_NODE_SETS
    }
    reading.surfaces = {}
    for name, expected in reading.get_facet_corners_by_set().items():
        assert {*corner_coordinates(tagged_mesh, dim, tagged_mesh.facets(name))} == expected, name


@pytest.mark.parametrize("kind", DECKS_BY_ELEMENT_TYPE)
def test_calculix_has_the_same_sets_and_volumes(tmp_path, kind):
    answer = json.loads(deck_calculix.CALCULIX_RESULTS_FILE.read_text())[kind]
    assert answer["sha256"] == deck_calculix.compute_deck_sha256(kind)
    assert_equal_to_calculix(
        read_deck_text(tmp_path, DECKS_BY_ELEMENT_TYPE[kind]), tmp_path / "deck.inp", kind, answer
    )


@needs_calculix
def test_installed_calculix_reproduces_the_stored_results():
    answers = json.loads(deck_calculix.CALCULIX_RESULTS_FILE.read_text())
    assert {*answers} == {*DECKS_BY_ELEMENT_TYPE}
    for kind, answer in answers.items():
        assert (
            deck_calculix.compute_volumes_and_sets_by_calculix(
                kind, deck_calculix.find_calculix_executable()
            )
            == answer
        )


TWO_SQUARE_CELLS_DECK = """*NODE, NSET=ALL
1, 0., 0.
2, 1., 0.
3, 2., 0.
4, 0., 1.
5, 1., 1.
6, 2., 1.
*ELEMENT, TYPE=CPS4, ELSET=LEFT
1, 1, 2, 5, 4
*ELEMENT, TYPE=CPS4, ELSET=RIGHT
2, 2, 3, 6, 5
"""


def test_only_cells_of_the_requested_sets_are_read(tmp_path):
    part = read_deck_text(tmp_path, TWO_SQUARE_CELLS_DECK, cells="right")
    assert integrate_over_cells(part) == pytest.approx(1.0)
    assert {*part.names["cells"]} == {"RIGHT"}
    assert integrate_over_cells(
        read_deck_text(tmp_path, TWO_SQUARE_CELLS_DECK, cells=["LEFT", "RIGHT"])
    ) == pytest.approx(2.0)
    with pytest.raises(ValueError, match="no ELSET is called TOP; known are LEFT, RIGHT"):
        read_deck_text(tmp_path, TWO_SQUARE_CELLS_DECK, cells="TOP")
    for wrong_value in (5, [5]):
        with pytest.raises(TypeError, match=r"cells .*: give the name of an ELSET, or several"):
            read_deck_text(tmp_path, TWO_SQUARE_CELLS_DECK, cells=wrong_value)
    mixed = TWO_SQUARE_CELLS_DECK + "*ELEMENT, TYPE=CPS3, ELSET=T\n3, 3, 7, 6\n*NODE\n7, 3., .5\n"
    with pytest.raises(ValueError, match=r"of degree 1 and triangles .* cells=NAME"):
        read_deck_text(tmp_path, mixed)
    assert integrate_over_cells(read_deck_text(tmp_path, mixed, cells="T")) == pytest.approx(0.5)


def test_shells_and_springs_beside_solids_are_left_out_and_named(tmp_path, caplog):
    text = (
        DECKS_BY_ELEMENT_TYPE["C3D10"]
        + """*NODE
9001, 9., 9., 9.
9002, 10., 9., 9.
9003, 10., 10., 9.
9004, 9., 10., 9.
*ELEMENT, TYPE=S4, ELSET=SHELL
9001, 9001, 9002, 9003, 9004
*ELEMENT, TYPE=SPRINGA, ELSET=SPRING
9002, 9001, 9002
"""
    )
    part = read_deck_text(tmp_path, text)
    assert part.mesh.topology.dim == 3
    assert "neither cells nor facets are left out: 1 S4, 1 SPRINGA" in caplog.text
    assert not {"SHELL", "SPRING"} & {*part.names["cells"], *part.names["facets"]}
    shell = read_deck_text(tmp_path, text, cells="SHELL")
    assert shell.mesh.topology.dim == 2
    assert integrate_over_cells(shell) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("axes", "message"), [((0, 2), "y = 7: x and z"), ((1, 2), "x = 7: y and z")]
)
def test_shells_in_other_planes_keep_two_coordinates(tmp_path, caplog, axes, message):
    lines = TWO_SQUARE_CELLS_DECK.splitlines()
    for k in range(1, 7):
        number, *x = lines[k].split(",")
        coordinates = ["7."] * 3
        coordinates[axes[0]], coordinates[axes[1]] = x
        lines[k] = ",".join([number, *coordinates])
    text = "\n".join(lines)
    with pytest.raises(ValueError, match="do not lie in one plane z = constant"):
        read_deck_text(tmp_path, text)
    part = read_deck_text(tmp_path, text.replace("CPS4", "S4"))
    assert message in caplog.text
    assert sorted(map(tuple, part.mesh.geometry.x[:, :2].tolist())) == [
        (x, y) for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0)
    ]


def test_20_node_bricks_get_face_nodes_and_keep_their_facet_sets(tmp_path, caplog):
    """Sets of all nodes of a face still select its facet after a centre node is added to the face.

    Faces of C3D20 elements have eight nodes, the facets of the mesh have nine.
    """
    part = read_deck_text(tmp_path, DECKS_BY_ELEMENT_TYPE["C3D20"])
    assert "8 cells of 20 nodes have got 7 more" in caplog.text
    space = functionspace(part.mesh, ("Lagrange", 2))
    part.mesh.topology.create_connectivity(2, 3)
    count = len(locate_dofs_topological(space, 2, part.facets("BASE")))
    assert len(part.facets("BASE")) == 4
    assert count == 25


def test_element_rows_with_too_many_nodes_are_cut_and_counted(tmp_path, caplog):
    read_deck_text(tmp_path, TWO_SQUARE_CELLS_DECK.replace("1, 1, 2, 5, 4", "1, 1, 2, 5, 4, 6"))
    assert "1 rows of CPS4 have more than 4 nodes" in caplog.text


def test_quoted_set_names_keep_commas_and_case(tmp_path):
    text = (
        TWO_SQUARE_CELLS_DECK
        + '*NSET, NSET="A=b, C"\n1, 2\n*SURFACE, NAME=S, TYPE=NODE\n"A=b, C"\n'
    )
    part = read_deck_text(tmp_path, text)
    assert {*part.names["facets"]} == {"ALL", "A=b, C", "S"}
    assert np.array_equal(part.facets("A=b, C"), part.facets("s"))
    with pytest.raises(ValueError, match="no set of facets is called A=B"):
        part.facets("A=B")


def test_node_sets_may_be_made_of_an_element_set_or_a_range_with_gaps(tmp_path):
    text = TWO_SQUARE_CELLS_DECK + "*NSET, NSET=N, ELSET=LEFT\n*NSET, NSET=GAPS, GENERATE\n1, 90\n"
    part = read_deck_text(tmp_path, text)
    assert len(part.facets("N")) == 3
    assert len(part.facets("GAPS")) == 6


def test_set_ranges_with_missing_numbers_give_a_warning(tmp_path, caplog):
    read_deck_text(tmp_path, TWO_SQUARE_CELLS_DECK + "*NSET, NSET=GAPS, GENERATE\n1, 90\n")
    assert "ranges of NSET GAPS have numbers of nothing that is there" in caplog.text
    caplog.clear()
    read_deck_text(tmp_path, TWO_SQUARE_CELLS_DECK + "*NSET, NSET=WHOLE, GENERATE\n1, 6\n")
    assert not caplog.text


def test_nodes_are_read_from_the_file_named_by_input(tmp_path):
    nodes, cells = TWO_SQUARE_CELLS_DECK.split("*ELEMENT", 1)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "Nodes.txt").write_text(nodes.partition("\n")[2])
    text = f"*NODE, NSET=ALL, INPUT=sub/Nodes.txt\n*ELEMENT{cells}"
    assert integrate_over_cells(read_deck_text(tmp_path, text)) == pytest.approx(2.0)


PART_AND_ASSEMBLY_DECK_TEMPLATE = """*PART, NAME=P
{nodes}*ELSET, ELSET=SAME
1
*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=I, PART=P
{shift}{inside}*END INSTANCE
*ELSET, ELSET=SAME, INSTANCE=I
2
*END ASSEMBLY
"""


def test_sets_of_one_name_in_part_and_assembly_stay_two(tmp_path):
    part = read_deck_text(
        tmp_path,
        PART_AND_ASSEMBLY_DECK_TEMPLATE.format(nodes=TWO_SQUARE_CELLS_DECK, shift="", inside=""),
    )
    assert {*part.names["cells"]} == {"LEFT", "RIGHT", "I.SAME", "SAME"}
    assert part.cells("I.SAME").tolist() != part.cells("SAME").tolist()


def test_a_mesh_may_stand_in_the_instance_unless_that_is_moved(tmp_path):
    inside = TWO_SQUARE_CELLS_DECK.replace("*ELEMENT", "** the part is empty\n*ELEMENT")
    text = PART_AND_ASSEMBLY_DECK_TEMPLATE.replace("*ELSET, ELSET=SAME\n1\n", "")
    assert integrate_over_cells(
        read_deck_text(tmp_path, text.format(nodes="", shift="", inside=inside))
    ) == pytest.approx(2)
    with pytest.raises(ValueError, match="nodes in an instance that is moved are not read"):
        read_deck_text(tmp_path, text.format(nodes="", shift="1., 0., 0.\n", inside=inside))


def test_deck_errors_name_file_and_line(tmp_path):
    with pytest.raises(ValueError, match=r"deck\.inp, line 4, \*NODE: 'nan' is no number"):
        read_deck_text(tmp_path, "*NODE\n1, 0., 0.\n** comment\n3, nan, 0.\n")
    with pytest.raises(ValueError, match="edge between nodes 2 and 3 has the node"):
        read_deck_text(
            tmp_path, HOSTILE_DECK_FILES_AND_REFUSAL_BY_NAME["middles that differ"][0]["deck.inp"]
        )

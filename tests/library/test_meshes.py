"""Meshes and sets from files of Gmsh and Abaqus; errors name unsupported content."""

import re

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
import ufl
from dolfinx.mesh import compute_midpoints

from pw_elements import assemble_scalar, boundary_measure
from pw_elements._compat import cell_geometry_nodes
from pw_elements.meshes import from_file, from_gmsh
from tests.parallel import assert_same_on_processes

COMM = MPI.COMM_SELF


@pytest.fixture
def gmsh_model():
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    yield gmsh.model
    gmsh.finalize()


@pytest.fixture
def gmsh_square(gmsh_model):
    """Return Gmsh's model of a unit square that consists of two halves."""
    left, right = (gmsh_model.occ.addRectangle(x, 0, 0, 0.5, 1) for x in (0, 0.5))
    gmsh_model.occ.fragment([(2, left)], [(2, right)])
    gmsh_model.occ.synchronize()
    return gmsh_model


@pytest.fixture
def ball_deck(gmsh_model, tmp_path):
    """Return the path of a deck of an eighth of a ball of radius 1, written by Gmsh."""
    body = gmsh_model.occ.addSphere(0, 0, 0, 1, -1, 0, np.pi / 2, np.pi / 2)
    gmsh_model.occ.synchronize()
    for dim, tag, name in ((2, 1, "round"), (2, 2, "flat"), (3, body, "ball")):
        gmsh_model.addPhysicalGroup(dim, [tag], name=name)
    gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 1)
    gmsh_model.mesh.generate(3)
    gmsh_model.mesh.setOrder(2)
    gmsh.write(str(tmp_path / "ball.inp"))
    return tmp_path / "ball.inp"


@pytest.mark.parametrize("order", [1, 2])
def test_a_mesh_from_gmsh_has_its_groups(gmsh_square, order):
    gmsh_square.addPhysicalGroup(2, [1], 4)
    gmsh_square.addPhysicalGroup(2, [2], 7)
    lower_edges = gmsh_square.getEntitiesInBoundingBox(-1, -1e-6, -1, 2, 1e-6, 1, 1)
    gmsh_square.addPhysicalGroup(1, [tag for _, tag in lower_edges], 3)
    gmsh_square.mesh.generate(2)
    gmsh_square.mesh.setOrder(order)
    mesh, cells, facets, _ = from_gmsh(MPI.COMM_SELF, gmsh_square)
    assert mesh.geometry.dim == 2
    assert mesh.ufl_domain().ufl_coordinate_element().degree == order
    for group in (4, 7):
        dx = ufl.Measure("dx", domain=mesh, subdomain_data=cells, subdomain_id=group)
        assert assemble_scalar(1.0 * dx) == pytest.approx(0.5)
    ds = boundary_measure(mesh, facets.find(3))
    assert assemble_scalar(1.0 * ds) == pytest.approx(1.0)


def test_a_file_gives_the_mesh_it_was_written_from(gmsh_square, tmp_path):
    gmsh_square.addPhysicalGroup(2, [1, 2], 1)
    gmsh_square.mesh.generate(2)
    gmsh.write(str(tmp_path / "square.msh"))
    n_nodes = len(gmsh_square.mesh.getNodes()[0])
    gmsh.clear()  # the file is read without Gmsh
    mesh, _, facets, _ = from_gmsh(MPI.COMM_SELF, tmp_path / "square.msh")
    assert mesh.geometry.index_map().size_global == n_nodes
    assert len(facets.find(1)) == 0
    assert len(gmsh_square.mesh.getNodes()[0]) == 0


def test_gmsh_models_without_usable_mesh_are_refused(gmsh_square, tmp_path):
    with pytest.raises(ValueError, match="has no nodes: mesh it"):
        from_gmsh(MPI.COMM_SELF, gmsh_square)
    gmsh_square.mesh.generate(2)
    with pytest.raises(ValueError, match="not lie in one plane"):
        gmsh_square.mesh.setNode(1, [0, 0, 0.1], []) or from_gmsh(MPI.COMM_SELF, gmsh_square)
    gmsh_square.mesh.setNode(1, [0, 0, 0], [])
    with pytest.raises(FileNotFoundError, match="nowhere"):
        from_gmsh(MPI.COMM_SELF, tmp_path / "nowhere.msh")
    (tmp_path / "bad.msh").write_text("no mesh")
    with pytest.raises(ValueError, match="cannot be read"):
        from_gmsh(MPI.COMM_SELF, tmp_path / "bad.msh")
    gmsh.finalize()
    with pytest.raises(ValueError, match=r"call gmsh.initialize\(\)"):
        from_gmsh(MPI.COMM_SELF, gmsh_square)
    gmsh.initialize(interruptible=False)


def test_cells_outside_of_all_physical_groups_are_left_out_and_counted(gmsh_square, caplog):
    """Cells outside all physical groups are left out, and a message states their number.

    Without groups of cells, all cells are read.
    """
    gmsh_square.mesh.generate(2)
    tags, _ = gmsh_square.mesh.getElementsByType(2)
    grouped, _ = gmsh_square.mesh.getElementsByType(2, gmsh_square.getEntities(2)[0][1])
    gmsh_square.addPhysicalGroup(1, [1], 3)  # a group of facets does not select cells
    all_cells = from_gmsh(MPI.COMM_SELF, gmsh_square).mesh
    assert all_cells.topology.index_map(2).size_global == len(tags)
    assert caplog.text == ""
    gmsh_square.addPhysicalGroup(2, [gmsh_square.getEntities(2)[0][1]], 4)
    part = from_gmsh(MPI.COMM_SELF, gmsh_square).mesh
    assert part.topology.index_map(2).size_global == len(grouped)
    n_omitted = len(tags) - len(grouped)
    assert f"{n_omitted} of {len(tags)} cells are in no physical group, and left out" in caplog.text


# Two plane cells that form a unit square whose upper side bulges. In this drawing, face S1 of the
# first cell is the lower side and S2 the right side; face S2 of the second cell is the upper side
# and S3 the left side.
#   4 -- 7 -- 3
#   8    9    6
#   1 -- 5 -- 2
CURVED_SQUARE_DECK = """*Heading
 two cells; 99 is a reference point
*Node, nset=all
1, 0., 0.
2, 1., 0.
3, 1., 1.,
4, 0., 1., 0.
5, .5, 0.
6, 1., .5
7, .5, 1.1
8, 0., .5
9, .5, .5
99, 7., 7.
*Element, type=CPS6, elset=lower
1, 1, 2, 3, 5, 6, 9
** a comment
*Element, type=CPS6,
 elset=Upper
4, 1, 3, 4,
 9, 7, 8
*Nset, nset=left, generate
 4, 8, 4
*Nset, nset=LEFT
1
*Nset, nset=corner
3
*Elset, elset=both
lower, 4
*Elset, elset=_TOP_S2, internal
4,
*Surface, type=ELEMENT, name=top
_TOP_S2, S2
*Surface, name=rim
both,
*Surface, type=NODE, name=nodes
left
*Surface, name=right
1, S2
*Step
*Node
nothing of this is read
"""
# sqrt(1 + s^2) / 2 + arsinh(s) / (2 s) is the length of the bulge of slope s = 0.4
FACET_SET_LENGTHS = {
    "TOP": 1.02606,
    "LEFT": 1.0,
    "NODES": 1.0,
    "RIGHT": 1.0,
    "RIM": 4.02606,
    "ALL": 4.02606,
}


def read_deck_text(folder, deck_text, comm=COMM):
    (folder / "deck.inp").write_text(deck_text)
    return from_file(folder / "deck.inp", comm)


def volume(tagged_mesh):
    return assemble_scalar(1.0 * ufl.dx(tagged_mesh.mesh, metadata={"quadrature_degree": 6}))


def test_a_deck_has_its_sets_cells_and_curved_sides(tmp_path):
    part = read_deck_text(tmp_path, CURVED_SQUARE_DECK)
    assert volume(part) == pytest.approx(1 + 2 / 3 * 0.1)  # a segment of a parabola is added
    assert {*part.names["facets"]} == {*FACET_SET_LENGTHS}
    for name, length in FACET_SET_LENGTHS.items():
        measure = boundary_measure(part.mesh, part.facets(name.lower()))
        assert assemble_scalar(1.0 * measure) == pytest.approx(length, abs=1e-4), name
    middles = rounded_facet_midpoints(part.mesh)
    assert middles[part.facets("TOP")].tolist() == [[0.5, 1.0]]
    assert part.names["cells"] == {"LOWER": (1,), "UPPER": (2,), "BOTH": (1, 2)}
    assert len(part.cells("both")) == 2
    assert part.cell_tags.find(1).tolist() == part.cells("LOWER").tolist()
    with pytest.raises(
        ValueError, match="no set of cells is called TOP; known are LOWER, UPPER, BOTH"
    ):
        part.cells("TOP")


def rounded_facet_midpoints(mesh):
    dim = mesh.topology.dim - 1
    mesh.topology.create_connectivity(dim, dim + 1)
    count = mesh.topology.index_map(dim).size_local
    return compute_midpoints(mesh, dim, np.arange(count, dtype=np.int32))[:, :2].round(1)


@pytest.mark.parametrize("shift", [0, 1])
def test_parts_instances_and_included_files_are_the_same_mesh(tmp_path, shift):
    nodes, elements_and_sets = CURVED_SQUARE_DECK[CURVED_SQUARE_DECK.index("*Node") :].split(
        "*Element", 1
    )
    cells = elements_and_sets.partition("*Nset")[0]
    (tmp_path / "nodes.inp").write_text(nodes.replace("*Node, nset=all\n", ""))
    text = f"""*Part, name=Plate
*Node, nset=all
*Include, input=nodes.inp
*Element{cells}*End Part
*Assembly, name=Assembly
*Instance, name=Plate-1, part=PLATE
{shift}., 0., 0.
*End Instance
*Surface, name=top
Plate-1.upper, S2
*Nset, nset=base, instance=Plate-1
1, 2, 5
*End Assembly
"""
    part = read_deck_text(tmp_path, text)
    assert volume(part) == pytest.approx(1 + 2 / 3 * 0.1)
    assert rounded_facet_midpoints(part.mesh)[part.facets("TOP")].tolist() == [[0.5 + shift, 1]]
    assert rounded_facet_midpoints(part.mesh)[part.facets("BASE")].tolist() == [[0.5 + shift, 0]]
    assert len(part.cells("upper")) == 1


def get_coordinate_element(mesh):
    """Return the coordinate element of a mesh; DOLFINx 0.11 has one for each type of cell."""
    geometry = mesh.geometry
    return geometry.cmaps[0] if hasattr(geometry, "cmaps") else geometry.cmap


@pytest.mark.parametrize("kind", ["C3D10", "C3D10M"])
def test_mid_side_nodes_of_abaqus_tetrahedra_keep_their_edges(tmp_path, kind):
    """Mid-side nodes of Abaqus tetrahedra are assigned to the edges on which they lie.

    In Abaqus, nodes 5 to 10 are in the middle of the edges 1-2, 2-3, 3-1, 1-4, 2-4 and 3-4.
    """
    rng = np.random.default_rng(29)
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    pairs = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    middles = x[pairs].mean(axis=1) + 0.05 * rng.standard_normal((6, 3))
    rows = "\n".join(f"{k}, {a}, {b}, {c}" for k, (a, b, c) in enumerate([*x, *middles], 1))
    deck = f"*NODE\n{rows}\n*ELEMENT, TYPE={kind}\n1, {', '.join(map(str, range(1, 11)))}\n"
    mesh = read_deck_text(tmp_path, deck).mesh
    nodes = mesh.geometry.x[cell_geometry_nodes(mesh)[0]]
    for (a, b), position in zip(pairs, middles, strict=True):
        reference_point = np.zeros(3)
        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
        ends = [int(np.linalg.norm(nodes[:4] - x[k], axis=1).argmin()) for k in (a, b)]
        reference_point = corners[ends].mean(axis=0)[None]
        assert get_coordinate_element(mesh).push_forward(reference_point, nodes)[
            0
        ] == pytest.approx(position)


def test_gmshs_own_deck_has_the_volume_and_the_faces_of_an_eighth_of_a_ball(ball_deck):
    part = from_file(ball_deck, COMM)
    assert volume(part) == pytest.approx(np.pi / 6, rel=3e-3)
    flat, curved = (
        assemble_scalar(1.0 * boundary_measure(part.mesh, part.facets(name)))
        for name in ("FLAT", "ROUND")
    )
    assert flat == pytest.approx(np.pi / 4, rel=1e-3)
    assert curved == pytest.approx(np.pi / 2, rel=3e-3)
    # elements on the surface and the set of its nodes select the same facets
    assert np.array_equal(part.facets("FLAT"), part.facets("SURFACE2"))
    assert np.array_equal(part.cells("BALL"), np.arange(part.mesh.topology.index_map(3).size_local))


def measure_ball_volume_and_faces(comm, ball_deck):
    part = from_file(ball_deck, comm)
    sizes = {"volume": volume(part)}
    for name in part.names["facets"]:
        sizes[name] = assemble_scalar(1.0 * boundary_measure(part.mesh, part.facets(name)))
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none\.inp"):
        from_file(ball_deck.with_name("none.inp"), comm)
    return sizes


def test_two_processes_read_the_same_mesh(ball_deck):
    assert_same_on_processes(measure_ball_volume_and_faces, ball_deck, process_counts=[2])


SQUARE_DECK_WITHOUT_SETS = CURVED_SQUARE_DECK[: CURVED_SQUARE_DECK.index("*Nset")]
REFUSED_DECKS_WITH_MESSAGES = [
    ("C3D15 are not read, since DOLFINx has no such cells",
     SQUARE_DECK_WITHOUT_SETS
     + "*Element, type=C3D15\n20, 1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 2, 3, 4, 5, 6\n"),
    ("F3D8 are not read",
     SQUARE_DECK_WITHOUT_SETS + "*Element, type=F3D8\n20, 1, 2, 3, 4, 5, 6, 7, 8\n"),
    ("cells of one kind, here are none", SQUARE_DECK_WITHOUT_SETS.replace("CPS6", "B31")),
    ("element 1 ends after 5 of 6",
     SQUARE_DECK_WITHOUT_SETS.replace("CPS6", "CPE6").replace(", 5, 6, 9", ", 5, 6")),
    (r"\*NGEN: this is not read", SQUARE_DECK_WITHOUT_SETS + "*NGEN\n1, 2\n"),
    ("node 77, which is not there", SQUARE_DECK_WITHOUT_SETS.replace("9, 7, 8", "9, 7, 77")),
    ("ELSET NOWHERE is not defined", SQUARE_DECK_WITHOUT_SETS + "*Surface, name=a\nnowhere, S1\n"),
    (r"has faces SPOS; a triangle has \['S1', 'S2', 'S3'\]",
     SQUARE_DECK_WITHOUT_SETS + "*Surface, name=a\n1, SPOS\n"),
    (r"has faces S0; ", SQUARE_DECK_WITHOUT_SETS + "*Surface, name=a\n1, S0\n"),
    ("not lie in one plane", SQUARE_DECK_WITHOUT_SETS.replace("1., 1.,", "1., 1., 1.")),
    ("there is no file .*other.inp", "*Include, input=other.inp\n"),
    (r"\*SURFACE: NAME=... is missing", SQUARE_DECK_WITHOUT_SETS + "*Surface\n1, S1\n"),
    (r"\*ELEMENT: TYPE=... is missing", SQUARE_DECK_WITHOUT_SETS + "*Element\n9, 1, 2, 3\n"),
    ("GENERATE takes the first number, the last",
     SQUARE_DECK_WITHOUT_SETS + "*Nset, nset=a, generate\n1\n"),
    ("COMBINE is not read", SQUARE_DECK_WITHOUT_SETS + "*Surface, name=a, combine=union\n"),
    ("cells of one kind, here are none", "*Node\n1, 0., 0.\n"),
    ("quadrilaterals of degree 1 and triangles of degree 2",
     SQUARE_DECK_WITHOUT_SETS + "*Element, type=CPS4\n20, 1, 2, 3, 4\n"),
    ("parts that are turned", "*Part, name=a\n*Instance, name=b, part=a\n1,0,0\n0,0,0,0,0,1,90\n"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "text"),
    REFUSED_DECKS_WITH_MESSAGES,
    ids=[words for words, _ in REFUSED_DECKS_WITH_MESSAGES],
)
def test_unsupported_deck_content_is_named_in_the_error(tmp_path, words, text):
    with pytest.raises((ValueError, FileNotFoundError), match=words):
        read_deck_text(tmp_path, text)


def test_linear_cells_are_read_and_point_masses_left_out(tmp_path):
    text = "*Node\n1, 0, 0\n2, 2, 0\n3, 2, 1\n4, 0, 1\n*Element, type=CPE4R\n1, 1, 2, 3, 4\n"
    part = read_deck_text(
        tmp_path,
        text + "*Element, type=MASS, elset=m\n7, 2\n*Elset, elset=n\nm\n*Surface, name=up\n1, S3\n",
    )
    assert volume(part) == pytest.approx(2)
    assert rounded_facet_midpoints(part.mesh)[part.facets("UP")].tolist() == [[1, 1]]
    with pytest.raises(ValueError, match=re.escape("end with .msh (Gmsh) or .inp")):
        from_file(tmp_path / "part.vtk", COMM)

"""Abaqus' decks: read as CalculiX reads them, and as a second reading does that shares no code."""

import json

from mpi4py import MPI

import basix
import numpy as np
import pytest
import ufl

from pw_elements import assemble_scalar
from pw_elements._compat import cell_nodes
from pw_elements.meshes import from_file
from tests.library import deck_calculix
from tests.library.deck_models import MODELS
from tests.library.deck_reading import Reading

COMM = MPI.COMM_SELF
needs_ccx = pytest.mark.skipif(
    deck_calculix.executable() is None,
    reason="CalculiX (ccx, Debian's calculix-ccx) is not installed",
)


def read(tmp_path, text, **options):
    data = text if isinstance(text, bytes) else text.encode()
    (tmp_path / "deck.inp").write_bytes(data)
    return from_file(tmp_path / "deck.inp", COMM, **options)


def corners(part, dim, entities):
    """Coordinates of the corners of cells or facets, each as a frozen set of triples."""
    mesh = part.mesh
    kind = mesh.basix_cell()
    columns = np.arange(len(basix.geometry(kind)))[None]  # corners are the first nodes
    cells, side = np.asarray(entities), np.zeros(len(entities), dtype=int)
    if dim < mesh.topology.dim:
        mesh.topology.create_connectivity(dim, mesh.topology.dim)
        above = mesh.topology.connectivity(dim, mesh.topology.dim)
        below = mesh.topology.connectivity(mesh.topology.dim, dim)
        cells = np.array([above.links(entity)[0] for entity in entities], dtype=int)
        side = [
            np.flatnonzero(below.links(cell) == entity)[0]
            for cell, entity in zip(cells, entities, strict=True)
        ]
        columns = np.array(basix.topology(kind)[dim])
    nodes = np.take_along_axis(cell_nodes(mesh)[cells], columns[side], axis=1)
    return [frozenset(map(tuple, rows)) for rows in mesh.geometry.x[nodes].tolist()]


def volume(part, cells=None, weight=1.0, degree=9):
    """Integral over cells, all of them if None."""
    mesh, metadata = part.mesh, {"quadrature_degree": degree}
    if cells is None:
        return assemble_scalar(weight * ufl.dx(mesh, metadata=metadata))
    dx = ufl.Measure("dx", mesh, subdomain_data=[(1, cells)], metadata=metadata)
    return assemble_scalar(weight * dx(1))


def check_against_second_reading(part, path):
    """Compare all sets by the digits of their corners, and the volume."""
    reading, dim = Reading(path), part.mesh.topology.dim
    mesh = part.mesh
    expected = {name: own for name, own in reading.cell_sets().items() if name[0] != "_"}
    assert {*part.names["cells"]} == {*expected}
    for name, own in expected.items():
        found = corners(part, dim, part.cells(name))
        assert len(found) == len({*found})
        assert {*found} == own, name
    expected = {name: own for name, own in reading.facet_sets().items() if name[0] != "_"}
    assert {*part.names["facets"]} == {*expected}
    for name, own in expected.items():
        assert {*corners(part, dim - 1, part.facets(name))} == own, name
    used = {reading.nodes[n] for _, _, nodes in reading.cells() for n in nodes}
    assert used <= {*map(tuple, mesh.geometry.x.tolist())}
    volumes = reading.volumes()
    assert mesh.topology.index_map(dim).size_local == len(volumes)
    assert volume(part) == pytest.approx(sum(volumes.values()), rel=1e-12)


@pytest.mark.parametrize("kind", MODELS)
def test_a_second_reading_finds_the_same_sets_and_volume(tmp_path, kind):
    part = read(tmp_path, MODELS[kind])
    assert len(part.names["cells"]) == 4
    assert {*part.names["facets"]} == {"ALL", "EVERYTHING", "BOTTOM", "BASE", "FRONT"}
    check_against_second_reading(part, tmp_path / "deck.inp")


def check_against_calculix(part, path, kind, answer):
    """Compare cells of sets, each cell's volume, and facets whose nodes are in CalculiX' sets.

    CalculiX prints seven digits. It makes a wedge of two degrees of axisymmetric elements, whose
    round side is a chord, or, in second order, close to the arc. Four points in curved tetrahedra
    and two in each direction of reduced elements do not give the volume exactly: we take as many.
    """
    weight = 1.0
    degree = 2 if kind in ("CAX6", "C3D10", "C3D10T") else 3 if kind in ("CAX8R", "C3D20R") else 9
    if kind.startswith("CAX"):
        angle = np.radians(2)
        straight = kind in ("CAX3", "CAX4")
        weight = ufl.SpatialCoordinate(part.mesh)[0] * (np.sin(angle) if straight else angle)
    for name in deck_calculix.ELSETS:
        expected = sorted(answer["volumes"][str(n)] for n in answer["sets"][name])
        cells = part.cells(name)
        volumes = sorted(volume(part, np.array([cell]), weight, degree) for cell in cells)
        assert volumes == pytest.approx(expected, rel=1e-6), name
    reading, dim = Reading(path), part.mesh.topology.dim - 1
    reading.sets["NSET"] = {name: {*answer["sets"][name]} for name in deck_calculix.NSETS}
    reading.surfaces = {}
    for name, expected in reading.facet_sets().items():
        assert {*corners(part, dim, part.facets(name))} == expected, name


@pytest.mark.parametrize("kind", MODELS)
def test_calculix_has_the_same_sets_and_volumes(tmp_path, kind):
    answer = json.loads(deck_calculix.ANSWERS.read_text())[kind]
    assert answer["sha256"] == deck_calculix.digest(kind)
    check_against_calculix(read(tmp_path, MODELS[kind]), tmp_path / "deck.inp", kind, answer)


@needs_ccx
def test_calculix_answers_as_it_did():
    answers = json.loads(deck_calculix.ANSWERS.read_text())
    assert {*answers} == {*MODELS}
    for kind, answer in answers.items():
        assert deck_calculix.compute(kind, deck_calculix.executable()) == answer

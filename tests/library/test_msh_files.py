"""Mesh files of Gmsh are data: valid ones are read right, hostile ones run and break nothing."""

from mpi4py import MPI

import pytest
from dolfinx import fem

from pw_elements.meshes import from_file
from tests.library.hostile_meshes import (
    CPU_SECONDS,
    MEGABYTES,
    differences,
    hostile_files,
    read_all,
)
from tests.library.msh_files import CELLS, FORMATS, RARE_FORMATS, lattice, read, write


@pytest.mark.parametrize("form", [*FORMATS, *RARE_FORMATS])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_a_valid_file_is_read_as_another_reader_does(cell, degree, form, tmp_path):
    path = tmp_path / "mesh.msh"
    path.write_bytes(data := write(lattice(cell, degree), form))
    assert differences(from_file(path, MPI.COMM_SELF), read(data)) == ""


def test_facets_of_a_file_name_nodes_at_once(tmp_path):
    """DOLFINx finds them by a connectivity, which users need not make."""
    path = tmp_path / "mesh.msh"
    path.write_bytes(write(lattice("triangle", 2), "4.1"))
    part = from_file(path, MPI.COMM_SELF)
    V = fem.functionspace(part.mesh, ("Lagrange", 2))
    nodes = fem.locate_dofs_topological(V, 1, part.facets("left side"))
    assert len(nodes) == 5


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """What becomes of each hostile file, and the folder in which commands would leave files."""
    folder, ran = (tmp_path_factory.mktemp(name) for name in ("hostile", "ran"))
    for number, (name, data) in enumerate(hostile_files().items()):
        command = str(ran / str(number)).encode()
        (folder / f"{name}.msh").write_bytes(data.replace(b"{ran}", command))
    return read_all(folder), ran


def test_no_command_of_a_file_is_run(outcomes):
    assert [*outcomes[1].iterdir()] == []


def test_hostile_files_end_in_a_mesh_or_an_error_of_the_library(outcomes):
    wrong = {
        name: result["outcome"]
        for name, result in outcomes[0].items()
        if result["outcome"] not in ("read", "refused")
        or (name.startswith("refused ") and result["outcome"] != "refused")
    }
    assert wrong == {}
    assert len(outcomes[0]) > 180


def test_hostile_files_cost_little(outcomes):
    dear = {
        name: result
        for name, result in outcomes[0].items()
        if result.get("seconds", 0) > CPU_SECONDS or result.get("megabytes", 0) > MEGABYTES
    }
    assert dear == {}


def test_no_hostile_file_becomes_another_mesh(outcomes):
    changed = {
        name: result["differences"]
        for name, result in outcomes[0].items()
        if result["outcome"] == "read" and result["differences"]
    }
    assert changed == {}

"""Mesh files of all formats are read as they are, others are refused, and nothing is run."""

import logging
import re

from mpi4py import MPI

import gmsh
import numpy as np
import pytest

from pw_elements.meshes import from_file, from_gmsh
from tests.library.hostile_meshes import MEGABYTES, differences, hostile_files, read_all
from tests.library.msh_files import (
    CELLS,
    FORMATS,
    RARE_FORMATS,
    Block,
    lattice,
    read,
    write,
)
from tests.parallel import run_on

COMM = MPI.COMM_SELF


def from_bytes(folder, data, comm=COMM):
    path = folder / "a.msh"
    path.write_bytes(data)
    return from_file(path, comm)


def test_hostile_files_run_nothing_and_are_refused_or_read_as_they_are(tmp_path):
    files, ran = hostile_files(), tmp_path / "ran"
    assert len(files) > 200
    assert max(len(data) for data, _ in files.values()) < 1_000_000
    (tmp_path / "other.geo").write_text(f'SystemCall "touch {ran}";\n')
    for name, (data, _) in files.items():
        (tmp_path / f"{name}.msh").write_bytes(data.replace(b"{ran}", str(ran).encode()))
    results = read_all(tmp_path)
    assert not ran.exists()
    wrong, n_read = {}, 0
    for name, (_, words) in files.items():
        result = results[f"{name}.msh"]
        message = result.get("message", "")
        n_read += result["outcome"] == "read"
        is_refused = result["outcome"] == "refused" and re.search(words or "", message)
        is_read = words is None and result["outcome"] == "read" and not result["differences"]
        if not (is_refused or is_read) or result["megabytes"] > MEGABYTES:
            wrong[name] = result
    assert wrong == {}
    assert n_read > 10


@pytest.mark.parametrize("form", FORMATS + RARE_FORMATS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_a_file_of_each_format_is_read_as_it_is(tmp_path, cell, degree, form):
    stated = lattice(cell, degree, seed=degree)
    data = write(stated, form)
    part = from_bytes(tmp_path, data)
    assert differences(part, read(data)) == ""
    assert differences(part, stated) == ""
    assert part.mesh.topology.cell_name() == cell
    assert part.names == {"cells": {"Körper": (3,)}, "facets": {"left side": (3,)}}
    assert len(part.cells("Körper")) == len(stated.blocks[0].elements)


def test_a_difference_is_seen(tmp_path):
    stated = lattice("triangle", 2)
    part = from_bytes(tmp_path, write(stated, "4.1"))
    row = stated.blocks[0].elements[0]
    row[4], row[5] = row[5], row[4]
    assert "cells" in differences(part, stated)
    row[4], row[5] = row[5], row[4]
    stated.blocks[1].groups = (8,)
    assert "tags" in differences(part, stated)
    stated.blocks[1].groups, stated.blocks[2].groups = (7,), ()
    assert "facets" in differences(part, stated)


@pytest.mark.parametrize("version", [2.2, 4.0, 4.1])
@pytest.mark.parametrize("options", ["", "Binary", "SaveParametric"])
def test_gmshs_own_files_are_read_as_they_are(tmp_path, version, options):
    if version == 4.0 and options == "Binary":
        pytest.skip("Gmsh does not write it")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        if options:
            gmsh.option.setNumber(f"Mesh.{options}", 1)
        occ = gmsh.model.occ
        occ.fragment([(2, occ.addDisk(0, 0, 0, 1, 1))], [(2, occ.addRectangle(0, 0, 0, 2, 1))])
        occ.synchronize()
        bodies = [tag for _, tag in gmsh.model.getEntities(2)]
        gmsh.model.addPhysicalGroup(2, bodies, 4, "all")
        gmsh.model.addPhysicalGroup(2, bodies[:1], 2, "one")
        gmsh.model.addPhysicalGroup(1, [1, 2, 3], 9, "lines")
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(tmp_path / "a.msh"))
        model = from_gmsh(COMM, gmsh.model)
    finally:
        gmsh.finalize()
    if (version, options) == (2.2, "SaveParametric"):
        with pytest.raises(ValueError, match=r"Mesh\.SaveParametric = 0"):
            from_file(tmp_path / "a.msh", COMM)
        return
    part = from_file(tmp_path / "a.msh", COMM)
    stated = read((tmp_path / "a.msh").read_bytes())
    assert differences(part, stated) == ""
    if options == "Binary":  # text has not all digits
        assert differences(model, stated) == ""
    assert 0 < len(part.cells("one")) < len(part.cells("all"))


def test_a_script_is_named_and_options_in_the_users_folders_are_not_read(tmp_path, monkeypatch):
    ran = tmp_path / "ran"
    call = f'SystemCall "touch {ran}";\n'
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for name in (".gmshrc", ".gmsh-options", "a.msh.opt", "a.geo", "a.pos", "a.opt"):
        (tmp_path / name).write_text(call)
    stated = lattice("triangle", 1)
    assert differences(from_bytes(tmp_path, write(stated, "4.1")), stated) == ""
    for name in ("a.geo", "a.pos", "a.opt"):
        with pytest.raises(ValueError, match=r"Scripts .* are not run"):
            from_gmsh(COMM, name)
        with pytest.raises(ValueError, match=r"end with \.msh"):
            from_file(name, COMM)
    assert not ran.exists()


@pytest.mark.parametrize("form", ["2.2", "4.1"])
def test_without_groups_all_cells_are_taken_and_with_some_the_others_are_counted(
    tmp_path, caplog, form
):
    stated = lattice("triangle", 2)
    stated.names = {}
    for block in stated.blocks[:2]:
        block.groups = ()
    part = from_bytes(tmp_path, write(stated, form))
    assert differences(part, stated) == ""
    assert part.mesh.topology.index_map(2).size_global == 8
    assert len(part.cell_tags.values) == 0
    assert caplog.text == ""
    stated.blocks[1].groups = (2,)
    with caplog.at_level(logging.WARNING, "pw_elements"):
        part = from_bytes(tmp_path, write(stated, form))
    assert differences(part, stated) == ""
    assert "a.msh: 4 of 8 cells are in no physical group, and left out" in caplog.text
    assert "2 of 2 elements of dimension 1 in physical groups are no facets" in caplog.text


@pytest.mark.parametrize("form", ["2.2", "2.2 binary", "4.0", "4.1"])
def test_groups_that_overlap_are_found_by_their_names(tmp_path, caplog, form):
    stated = lattice("quadrilateral", 1)
    stated.blocks[0].groups, stated.blocks[1].groups = (3, 5), (5,)
    stated.names = {(2, 3): "half", (2, 5): "all", (1, 3): "side"}
    with caplog.at_level(logging.WARNING, "pw_elements"):
        part = from_bytes(tmp_path, write(stated, form))
    assert "2 cells are in several physical groups at once" in caplog.text
    tags = {name: {*tags} for name, tags in part.names["cells"].items()}
    assert tags == {"half": {6}, "all": {5, 6}}
    assert len(part.cells("half")) == 2
    assert len(part.cells("all")) == 4
    stated.names.pop((2, 5))
    with pytest.raises(ValueError, match="cells are in the physical groups 3, 5 at once: give all"):
        from_bytes(tmp_path, write(stated, form))


def test_cells_of_one_type_in_groups_are_read_beside_others(tmp_path):
    stated = lattice("quadrilateral", 1)
    quad = stated.blocks[0].elements.pop(0)
    a, b, c, d = quad[1:]
    stated.blocks.append(Block(2, 9, (), [[91, a, b, c], [92, a, c, d]]))
    part = from_bytes(tmp_path, write(stated, "4.1"))
    assert part.mesh.topology.cell_name() == "quadrilateral"
    assert part.mesh.topology.index_map(2).size_global == 3


def model_of(kinds):
    """Put elements by Gmsh's type, with the numbers of their nodes, into Gmsh's model."""
    gmsh.model.addDiscreteEntity(2, 1)
    x = np.random.default_rng(4).random((20, 3)) * [1, 1, 0]
    gmsh.model.mesh.addNodes(2, 1, range(1, 21), x.ravel())
    for kind, nodes in kinds.items():
        gmsh.model.mesh.addElementsByType(1, kind, [], nodes)


MODELS = [
    ({2: [1, 2, 3], 3: [2, 4, 5, 6]}, "1 triangles .* and 1 quadrilaterals .* cells of one type"),
    ({21: range(1, 11)}, "1 triangles of degree 3 .*10 nodes.* read are"),
    ({16: range(1, 9)}, "1 quadrilaterals of degree 2 .*8 nodes.* read are"),
    ({2: [1, 2, 3, 3, 2, 1]}, "elements 1 and 2 have the same nodes"),
    ({2: [1, 2, 2]}, "element 1 has a node twice"),
]


@pytest.mark.parametrize(("kinds", "words"), MODELS)
def test_a_model_is_checked_as_a_file_is(kinds, words):
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        model_of(kinds)
        with pytest.raises(ValueError, match="Gmsh's model cannot be read: .*" + words):
            from_gmsh(COMM, gmsh.model)
    finally:
        gmsh.finalize()


def refusals(comm, folder):
    """Return the message about each of a few files on this process."""
    messages = []
    for path in sorted(folder.glob("*.msh")):
        with pytest.raises(ValueError, match="cannot be read") as refused:
            from_file(path, comm)
        messages.append(str(refused.value))
    return messages


def test_all_processes_refuse_a_file_in_the_same_words(tmp_path):
    files = hostile_files()
    for name in ("script plain", "missing node 2.2", "two equal cells 4.1", "1e12 4.1"):
        (tmp_path / f"{name}.msh").write_bytes(files[name][0])
    first, second = run_on(2, refusals, tmp_path)
    assert len(first) == 4
    assert first == second == refusals(COMM, tmp_path)


def test_a_file_with_a_flat_cell_is_refused_by_its_name(tmp_path):
    stated = lattice("triangle", 1)
    x = {node[0]: node for node in stated.nodes}
    a, b, c = (x[number] for number in stated.blocks[0].elements[0][1:])
    c[1:3] = [(p + q) / 2 for p, q in zip(a[1:3], b[1:3], strict=True)]
    with pytest.raises(ValueError, match=r"a\.msh: cells around .* have no volume"):
        from_bytes(tmp_path, write(stated, "4.1"))

"""Gmsh files of all formats are read exactly; hostile ones are refused, and scripts never run."""

import logging
import re
import warnings

from mpi4py import MPI

import gmsh
import numpy as np
import pytest

from pw_elements.meshes import from_file, from_gmsh, msh
from tests.library.hostile_meshes import (
    describe_mesh_differences,
    make_hostile_files_with_error_patterns,
)
from tests.library.limited_reading import (
    MAX_MEGABYTES_OF_MEMORY_PER_FILE,
    read_files_under_cpu_and_memory_limits,
)
from tests.library.msh_files import (
    COMMON_MSH_FORMATS,
    GMSH_TYPES_BY_CELL_AND_DEGREE,
    RARE_MSH_FORMATS,
    ElementBlock,
    decode_msh,
    encode_msh,
    make_grouped_lattice_mesh,
)
from tests.parallel import run_on_processes

COMM = MPI.COMM_SELF


def read_msh_bytes(folder, file_bytes, comm=COMM):
    path = folder / "a.msh"
    path.write_bytes(file_bytes)
    return from_file(path, comm)


def test_hostile_files_run_nothing_and_are_refused_or_read_as_they_are(tmp_path):
    files, marker_file = make_hostile_files_with_error_patterns(), tmp_path / "ran"
    assert len(files) > 200
    assert max(len(data) for data, _ in files.values()) < 1_000_000
    (tmp_path / "other.geo").write_text(f'SystemCall "touch {marker_file}";\n')
    paths = {name: tmp_path / f"{name}.msh" for name in files}
    for name, (data, _) in files.items():
        paths[name].write_bytes(data.replace(b"{ran}", str(marker_file).encode()))
    results = read_files_under_cpu_and_memory_limits(
        paths.values(), "tests.library.hostile_meshes:describe_differences_from_file"
    )
    assert not marker_file.exists()
    unexpected, n_read = {}, 0
    for name, (_, pattern) in files.items():
        result = results[paths[name]]
        n_read += result["outcome"] == "read"
        is_refused = result["outcome"] == "refused" and re.search(pattern or "", result["message"])
        is_read = pattern is None and result["outcome"] == "read" and not result["differences"]
        if not (is_refused or is_read) or result["megabytes"] > MAX_MEGABYTES_OF_MEMORY_PER_FILE:
            unexpected[name] = result
    assert unexpected == {}
    assert n_read > 10


@pytest.mark.parametrize("file_format", COMMON_MSH_FORMATS + RARE_MSH_FORMATS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", GMSH_TYPES_BY_CELL_AND_DEGREE)
def test_a_file_of_each_format_is_read_as_it_is(tmp_path, cell, degree, file_format):
    mesh_data = make_grouped_lattice_mesh(cell, degree, seed=degree)
    data = encode_msh(mesh_data, file_format)
    part = read_msh_bytes(tmp_path, data)
    assert describe_mesh_differences(part, decode_msh(data)) == ""
    assert describe_mesh_differences(part, mesh_data) == ""
    assert part.mesh.topology.cell_name() == cell
    assert part.names == {"cells": {"Körper": (3,)}, "facets": {"left side": (3,)}}
    assert len(part.cells("Körper")) == len(mesh_data.blocks[0].elements)


def test_warnings_of_other_code_do_not_end_the_reading_of_a_file(tmp_path, monkeypatch):
    read_text_rows = msh.TextRowReader.read_count

    def warn_and_read(reader):
        warnings.warn("NumPy changes something else", DeprecationWarning, stacklevel=1)
        return read_text_rows(reader)

    monkeypatch.setattr(msh.TextRowReader, "read_count", warn_and_read)
    mesh_data = make_grouped_lattice_mesh("triangle", 1)
    data = encode_msh(mesh_data, COMMON_MSH_FORMATS[0])
    with pytest.warns(DeprecationWarning, match="something else"):
        part = read_msh_bytes(tmp_path, data)
    assert describe_mesh_differences(part, mesh_data) == ""


def test_describe_mesh_differences_detects_changed_cells_tags_and_facets(tmp_path):
    mesh_data = make_grouped_lattice_mesh("triangle", 2)
    part = read_msh_bytes(tmp_path, encode_msh(mesh_data, "4.1"))
    row = mesh_data.blocks[0].elements[0]
    row[4], row[5] = row[5], row[4]
    assert "cells" in describe_mesh_differences(part, mesh_data)
    row[4], row[5] = row[5], row[4]
    mesh_data.blocks[1].groups = (8,)
    assert "tags" in describe_mesh_differences(part, mesh_data)
    mesh_data.blocks[1].groups, mesh_data.blocks[2].groups = (7,), ()
    assert "facets" in describe_mesh_differences(part, mesh_data)


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
    mesh_data = decode_msh((tmp_path / "a.msh").read_bytes())
    assert describe_mesh_differences(part, mesh_data) == ""
    if options == "Binary":  # text files have fewer digits
        assert describe_mesh_differences(model, mesh_data) == ""
    assert 0 < len(part.cells("one")) < len(part.cells("all"))


def test_scripts_are_refused_and_the_users_gmsh_options_are_not_read(tmp_path, monkeypatch):
    ran = tmp_path / "ran"
    call = f'SystemCall "touch {ran}";\n'
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for name in (".gmshrc", ".gmsh-options", "a.msh.opt", "a.geo", "a.pos", "a.opt"):
        (tmp_path / name).write_text(call)
    mesh_data = make_grouped_lattice_mesh("triangle", 1)
    assert (
        describe_mesh_differences(read_msh_bytes(tmp_path, encode_msh(mesh_data, "4.1")), mesh_data)
        == ""
    )
    for name in ("a.geo", "a.pos", "a.opt"):
        with pytest.raises(ValueError, match=r"Scripts .* are not run"):
            from_gmsh(COMM, name)
        with pytest.raises(ValueError, match=r"end with \.msh"):
            from_file(name, COMM)
    assert not ran.exists()


@pytest.mark.parametrize("file_format", ["2.2", "4.1"])
def test_without_groups_all_cells_are_taken_and_with_some_the_others_are_counted(
    tmp_path, caplog, file_format
):
    mesh_data = make_grouped_lattice_mesh("triangle", 2)
    mesh_data.names = {}
    for block in mesh_data.blocks[:2]:
        block.groups = ()
    part = read_msh_bytes(tmp_path, encode_msh(mesh_data, file_format))
    assert describe_mesh_differences(part, mesh_data) == ""
    assert part.mesh.topology.index_map(2).size_global == 8
    assert len(part.cell_tags.values) == 0
    assert caplog.text == ""
    mesh_data.blocks[1].groups = (2,)
    with caplog.at_level(logging.WARNING, "pw_elements"):
        part = read_msh_bytes(tmp_path, encode_msh(mesh_data, file_format))
    assert describe_mesh_differences(part, mesh_data) == ""
    assert "a.msh: 4 of 8 cells are in no physical group, and left out" in caplog.text
    assert "2 of 2 elements of dimension 1 in physical groups are no facets" in caplog.text


@pytest.mark.parametrize("file_format", ["2.2", "2.2 binary", "4.0", "4.1"])
def test_groups_that_overlap_are_found_by_their_names(tmp_path, caplog, file_format):
    mesh_data = make_grouped_lattice_mesh("quadrilateral", 1)
    mesh_data.blocks[0].groups, mesh_data.blocks[1].groups = (3, 5), (5,)
    mesh_data.names = {(2, 3): "half", (2, 5): "all", (1, 3): "side"}
    with caplog.at_level(logging.WARNING, "pw_elements"):
        part = read_msh_bytes(tmp_path, encode_msh(mesh_data, file_format))
    assert "2 cells are in several physical groups at once" in caplog.text
    tags = {name: {*tags} for name, tags in part.names["cells"].items()}
    assert tags == {"half": {6}, "all": {5, 6}}
    assert len(part.cells("half")) == 2
    assert len(part.cells("all")) == 4
    mesh_data.names.pop((2, 5))
    with pytest.raises(ValueError, match="cells are in the physical groups 3, 5 at once: give all"):
        read_msh_bytes(tmp_path, encode_msh(mesh_data, file_format))


def test_cells_of_one_type_in_groups_are_read_beside_others(tmp_path):
    mesh_data = make_grouped_lattice_mesh("quadrilateral", 1)
    quad = mesh_data.blocks[0].elements.pop(0)
    a, b, c, d = quad[1:]
    mesh_data.blocks.append(ElementBlock(2, 9, (), [[91, a, b, c], [92, a, c, d]]))
    part = read_msh_bytes(tmp_path, encode_msh(mesh_data, "4.1"))
    assert part.mesh.topology.cell_name() == "quadrilateral"
    assert part.mesh.topology.index_map(2).size_global == 3


def add_elements_to_gmsh_model(nodes_by_gmsh_type):
    """Add elements to Gmsh's model, given by their nodes for each of Gmsh's type numbers."""
    gmsh.model.addDiscreteEntity(2, 1)
    x = np.random.default_rng(4).random((20, 3)) * [1, 1, 0]
    gmsh.model.mesh.addNodes(2, 1, range(1, 21), x.ravel())
    for kind, nodes in nodes_by_gmsh_type.items():
        gmsh.model.mesh.addElementsByType(1, kind, [], nodes)


REFUSED_GMSH_MODELS_WITH_MESSAGES = [
    ({2: [1, 2, 3], 3: [2, 4, 5, 6]}, "1 triangles .* and 1 quadrilaterals .* cells of one type"),
    ({21: range(1, 11)}, "1 triangles of degree 3 .*10 nodes.* read are"),
    ({16: range(1, 9)}, "1 quadrilaterals of degree 2 .*8 nodes.* read are"),
    ({2: [1, 2, 3, 3, 2, 1]}, "elements 1 and 2 have the same nodes"),
    ({2: [1, 2, 2]}, "element 1 has a node twice"),
]


@pytest.mark.parametrize(("kinds", "words"), REFUSED_GMSH_MODELS_WITH_MESSAGES)
def test_invalid_gmsh_models_are_refused_like_files(kinds, words):
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        add_elements_to_gmsh_model(kinds)
        with pytest.raises(ValueError, match="Gmsh's model cannot be read: .*" + words):
            from_gmsh(COMM, gmsh.model)
    finally:
        gmsh.finalize()


def collect_error_messages(comm, folder):
    """Return the error messages about all files in a folder, as raised on this process."""
    messages = []
    for path in sorted(folder.glob("*.msh")):
        with pytest.raises(ValueError, match="cannot be read") as refused:
            from_file(path, comm)
        messages.append(str(refused.value))
    return messages


def test_all_processes_refuse_a_file_in_the_same_words(tmp_path):
    files = make_hostile_files_with_error_patterns()
    for name in ("script plain", "missing node 2.2", "two equal cells 4.1", "1e12 4.1"):
        (tmp_path / f"{name}.msh").write_bytes(files[name][0])
    rank_0, rank_1 = run_on_processes(2, collect_error_messages, tmp_path)
    assert len(rank_0) == 4
    assert rank_0 == rank_1 == collect_error_messages(COMM, tmp_path)


def test_a_file_with_a_flat_cell_is_named_in_the_error(tmp_path):
    mesh_data = make_grouped_lattice_mesh("triangle", 1)
    x = {node[0]: node for node in mesh_data.nodes}
    a, b, c = (x[number] for number in mesh_data.blocks[0].elements[0][1:])
    c[1:3] = [(p + q) / 2 for p, q in zip(a[1:3], b[1:3], strict=True)]
    with pytest.raises(ValueError, match=r"a\.msh: cells around .* have no volume"):
        read_msh_bytes(tmp_path, encode_msh(mesh_data, "4.1"))

"""Read meshes and named sets from Gmsh and Abaqus files, and from Gmsh's model in memory."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from pw_elements.abaqus import read_abaqus_mesh
from pw_elements.checks import (
    DegenerateMesh,
    arguments,
    check_cell_shapes_and_facets,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.meshes.groups import read_gmsh_model
from pw_elements.meshes.msh import read_msh
from pw_elements.meshes.tagged import MeshArrays, TaggedMesh, create_tagged_mesh
from pw_elements.progress import log_on_root


@check_same_arguments_on_all_processes
def from_file(
    path: str | Path,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    cells: str | Sequence[str] | None = None,
) -> TaggedMesh:
    """Read a mesh and its named sets from a file of Gmsh (`.msh`), Abaqus or CalculiX (`.inp`).

        part = from_file("seal.inp")
        K = assemble_matrix(Body(Spaces.petrov_galerkin(part.mesh), steel, "solid").stiffness())
        pressed = boundary_measure(part.mesh, part.facets("TOP"))

    Supported elements of `.inp` files are C3D4, C3D8, C3D10, C3D20, and plane elements, shells and
    membranes with 3, 4, 6 or 8 nodes, such as CPS6, CPE8, CAX6 or S8R. Plane elements have to lie
    in a plane z = constant; shells may also lie in a plane x = constant or y = constant. Plane
    elements with 8 nodes and C3D20 get additional nodes at the centres of faces and cells, which do
    not change their shape. Elements of the highest dimension become cells, elements of one
    dimension less become facets. A warning in the log lists all other elements.

    ELSETs are sets of cells or facets, SURFACEs are sets of facets. An NSET becomes the set of all
    facets of the boundary that have all their nodes in the NSET. If a SURFACE and another set have
    the same name, the facets of the SURFACE are used. Sets without cells and facets, and sets with
    names that begin with an underscore, are left out. A set of a part keeps its name if there is
    only one part and the assembly has no set of this name; otherwise it is called "INSTANCE.SET".
    Names are converted to upper case unless they are in quotes.

    Args:
        path: path of the file.
        comm: communicator of the mesh.
        cells: for an `.inp` file, names of the ELSETs whose elements become cells. If None, all
            elements of the highest dimension become cells.

    Raises:
        FileNotFoundError: if the file, or a file that it includes, does not exist.
        ValueError: if the file has another format or no supported mesh. The message gives the
            reason and, where possible, the line.
    """
    arguments.check_communicator(comm)
    arguments.check_type("path", path, (str, Path), "it has to be the path of a file")
    allowed_types = (str, Sequence, type(None))
    arguments.check_type("cells", cells, allowed_types, "give the name of an ELSET, or several")
    path = Path(path)
    if path.suffix.lower() == ".msh":
        if cells is not None:
            raise ValueError(f"{path}: cells = {cells!r} names ELSETs, which only .inp files have")
        return from_gmsh(comm, path)
    if path.suffix.lower() == ".inp":
        cell_sets = (cells,) if isinstance(cells, str) else cells
        if cell_sets is not None and not all(isinstance(name, str) for name in cell_sets):
            raise TypeError(f"cells = {cells!r}: give the name of an ELSET, or several")
        return _read_abaqus_file(path, comm, cell_sets)
    raise ValueError(f"{path}: files end with .msh (Gmsh) or .inp (Abaqus, CalculiX)")


@check_same_arguments_on_all_processes
def from_gmsh(comm: MPI.Comm, source: Any) -> TaggedMesh:  # noqa: ANN401
    """Read a mesh and its physical groups from a `.msh` file or from Gmsh's model in memory.

        mesh, cell_tags, facet_tags, names = from_gmsh(MPI.COMM_WORLD, gmsh.model)

    The degree of the geometry is the order of Gmsh's mesh: after `gmsh.model.mesh.setOrder(2)` the
    sides of the cells are curved. The mesh has as many coordinates as its cells have dimensions.
    Only cells in physical groups are read, and the log reports how many other cells there are. If
    no cell is in a group, all elements of the highest dimension become cells.

    The tag of a cell or facet is the number of its group. Cells and facets in several groups have
    tags that are larger than all group numbers; `names` lists the tags of each named group.

    The library itself parses files of the formats 2 to 2.2, 4.0 and 4.1, text or binary. Gmsh need
    not be installed. It is not used to open files, because it would run a script whatever the name
    of the file.

    Args:
        comm: communicator of the mesh.
        source: path of a file, or `gmsh.model`, which is read on process 0.

    Raises:
        FileNotFoundError: if the file does not exist.
        ValueError: if the file has another format (a script, for example) or contains contradictory
            numbers; if there are cells of several types, or of degree 3 or more; if the model has
            no mesh; if a mesh of dimension 2 does not lie in a plane z = constant; if cells of a
            file are flat or partly inside out; or if overlapping groups have no names.
    """
    arguments.check_communicator(comm)
    path = Path(source) if isinstance(source, str | Path) else None
    arrays, notes = None, list[str]()
    with raise_errors_on_all_processes(comm) as shared:
        shared["source"] = path  # a model exists on process 0 only
        if comm.rank == 0:
            arrays, notes = _read_gmsh_model_or_file(source, path)
    for note in notes:
        log_on_root(comm, logging.WARNING, note)
    # users may still move the nodes of a model's mesh: its cells are checked when a body is created
    return (
        create_tagged_mesh(comm, arrays)
        if path is None
        else _distribute_and_check_mesh(comm, arrays, str(path))
    )


def _read_gmsh_model_or_file(model: Any, path: Path | None) -> tuple[MeshArrays, list[str]]:  # noqa: ANN401
    """Read a file or, if `path` is None, Gmsh's model.

    Returns:
        Arrays of the mesh, and messages for the log.
    """
    if path is None and not hasattr(model, "getPhysicalGroups"):
        expected = "it has to be a file's name, or gmsh.model"
        raise TypeError(f"the source is {arguments.describe_value_or_type(model)}: {expected}")
    source = "Gmsh's model" if path is None else str(path)
    try:
        mesh = read_gmsh_model(model) if path is None else read_msh(path)
        arrays, notes = mesh.make_mesh_arrays()
    except ValueError as error:
        raise ValueError(f"{source} cannot be read: {error}") from error
    return arrays, [f"{source}: {note}" for note in notes]


def _read_abaqus_file(path: Path, comm: MPI.Comm, cell_sets: Sequence[str] | None) -> TaggedMesh:
    """Read an input file on process 0, log messages about it, and distribute the mesh."""
    arrays, notes = None, list[str]()
    with raise_errors_on_all_processes(comm):
        if comm.rank == 0:
            deck = read_abaqus_mesh(path, cell_sets)
            cell_and_degree = deck.cell, deck.degree
            arrays, notes = (
                MeshArrays(cell_and_degree, deck.x, deck.cells, deck.tags, deck.names),
                deck.notes,
            )
    if notes := comm.bcast(notes):
        log_on_root(comm, logging.WARNING, f"{path}: {'; '.join(notes)}")
    return _distribute_and_check_mesh(comm, arrays, str(path))


def _distribute_and_check_mesh(
    comm: MPI.Comm, arrays: MeshArrays | None, source_name: str
) -> TaggedMesh:
    """Distribute the mesh of a file and check its cells.

    Raises:
        DegenerateMesh: for flat, inverted or folded cells; the message contains `source_name`.
    """
    tagged = create_tagged_mesh(comm, arrays)
    try:
        check_cell_shapes_and_facets(tagged.mesh)
    except DegenerateMesh as error:
        raise DegenerateMesh(f"{source_name}: {error}") from error
    return tagged

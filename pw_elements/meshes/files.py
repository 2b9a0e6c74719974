"""Meshes of Gmsh and Abaqus, with their sets."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from pw_elements.abaqus import read_deck
from pw_elements.checks import (
    DegenerateMesh,
    arguments,
    check_cells,
    check_same_arguments,
    collective_errors,
)
from pw_elements.meshes.groups import from_model
from pw_elements.meshes.msh import read_msh
from pw_elements.meshes.tagged import MeshArrays, TaggedMesh, distribute
from pw_elements.progress import log_on_root


@check_same_arguments
def from_file(
    path: str | Path,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    cells: str | Sequence[str] | None = None,
) -> TaggedMesh:
    """Mesh and sets from a file of Gmsh (`.msh`) or of Abaqus or CalculiX (`.inp`).

        part = from_file("seal.inp")
        K = assemble_matrix(Body(Spaces.petrov_galerkin(part.mesh), steel, "solid").stiffness())
        pressed = boundary_measure(part.mesh, part.facets("TOP"))

    Of `.inp` files: C3D4, C3D8, C3D10, C3D20, and plane elements, shells and membranes with 3, 4, 6
    or 8 nodes, such as CPS6, CPE8, CAX6, S8R; plane ones lie in a plane z = constant, shells may
    lie in one x or y = constant, too. C3D20 and those of 8 nodes get nodes in the middle of faces
    and cells, with the same shape. Elements of the highest dimension are cells, those of one less
    are facets; the log names what is left out, as a warning.

    ELSETs are sets of cells or facets; SURFACEs are sets of facets, and so are NSETs: of the
    boundary's facets with all nodes in them. If a SURFACE and a set have one name, the SURFACE's
    facets count. Sets without any facet or cell, and those whose names begin with an underscore,
    are left out. Sets of parts keep their names if there is one part that has no name in common
    with the assembly; otherwise they are called "INSTANCE.SET". Names are in capitals, but those in
    quotes are as they are.

    Args:
        path: of the file.
        comm: communicator.
        cells: of an `.inp` file, names of ELSETs whose elements are the cells; all if None.

    Raises:
        FileNotFoundError: if there is no such file, or it includes one that is not there.
        ValueError: for a file of another kind, or one that states no such mesh; the message says
            where and why, such as elements C3D15, which DOLFINx has no cells for.
    """
    arguments.check_communicator(comm)
    arguments.check_type("path", path, (str, Path), "it has to be the path of a file")
    one_or_more = (str, Sequence, type(None))
    arguments.check_type("cells", cells, one_or_more, "give the name of an ELSET, or several")
    path = Path(path)
    if path.suffix.lower() == ".msh":
        if cells is not None:
            raise ValueError(f"{path}: cells = {cells!r} names ELSETs, which .inp files alone have")
        return from_gmsh(comm, path)
    if path.suffix.lower() == ".inp":
        names = (cells,) if isinstance(cells, str) else cells
        if names is not None and not all(isinstance(name, str) for name in names):
            raise TypeError(f"cells = {cells!r}: give the name of an ELSET, or several")
        return _from_abaqus(path, comm, names)
    raise ValueError(f"{path}: files end with .msh (Gmsh) or .inp (Abaqus, CalculiX)")


@check_same_arguments
def from_gmsh(comm: MPI.Comm, source: Any) -> TaggedMesh:  # noqa: ANN401
    """Mesh from a `.msh` file or from the model that Gmsh has just meshed, with physical groups.

        mesh, cell_tags, facet_tags, names = from_gmsh(MPI.COMM_WORLD, gmsh.model)

    Gmsh's own order is kept: after `gmsh.model.mesh.setOrder(2)` the mesh's sides are curved. The
    mesh lies in a space of the cells' own dimension. Cells are those in physical groups, and the
    log says how many are left out; if no cell is in a group, all of the highest dimension are.

    The tag of a cell or facet is the number of its group. Those in several groups have tags above
    all groups' numbers, which `names` lists.

    A file is data: formats 2 to 2.2, 4.0 and 4.1 are read here, as text and in binary. Gmsh, which
    would run a script whatever its name is, is not asked, and need not be installed.

    Args:
        comm: communicator.
        source: path of a file, or `gmsh.model`, which is read on process 0.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file of another kind, such as a script, or one whose numbers do not agree
            with each other; cells of several types, or of degree 3 and more; a model without a
            mesh; a mesh of dimension 2 that does not lie in a plane z = constant; cells of a file
            without volume or partly inside out; or groups that overlap and have no names.
    """
    arguments.check_communicator(comm)
    path = Path(source) if isinstance(source, str | Path) else None
    arrays, notes = None, list[str]()
    with collective_errors(comm) as same:
        same["source"] = path  # a model is process 0's
        if comm.rank == 0:
            arrays, notes = _read_gmsh(source, path)
    for note in notes:
        log_on_root(comm, logging.WARNING, note)
    # of a model cells are checked where a body is made of them: until then they may be moved
    return distribute(comm, arrays) if path is None else _make_checked(comm, arrays, str(path))


def _read_gmsh(model: Any, path: Path | None) -> tuple[MeshArrays, list[str]]:  # noqa: ANN401
    if path is None and not hasattr(model, "getPhysicalGroups"):
        words = "it has to be a file's name, or gmsh.model"
        raise TypeError(f"the source is {arguments.describe(model)}: {words}")
    whose = "Gmsh's model" if path is None else str(path)
    try:
        mesh = from_model(model) if path is None else read_msh(path)
        arrays, notes = mesh.arrays()
    except ValueError as error:
        raise ValueError(f"{whose} cannot be read: {error}") from error
    return arrays, [f"{whose}: {note}" for note in notes]


def _from_abaqus(path: Path, comm: MPI.Comm, chosen: Sequence[str] | None) -> TaggedMesh:
    arrays, notes = None, list[str]()
    with collective_errors(comm):
        if comm.rank == 0:
            deck = read_deck(path, chosen)
            kind = deck.cell, deck.degree
            arrays, notes = MeshArrays(kind, deck.x, deck.cells, deck.tags, deck.names), deck.notes
    if notes := comm.bcast(notes):
        log_on_root(comm, logging.WARNING, f"{path}: {'; '.join(notes)}")
    return _make_checked(comm, arrays, str(path))


def _make_checked(comm: MPI.Comm, arrays: MeshArrays | None, whose: str) -> TaggedMesh:
    """Distribute a mesh, and refuse cells that are flat or inverted in the file's name."""
    tagged = distribute(comm, arrays)
    try:
        check_cells(tagged.mesh)
    except DegenerateMesh as error:
        raise DegenerateMesh(f"{whose}: {error}") from error
    return tagged

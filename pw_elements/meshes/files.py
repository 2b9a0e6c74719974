"""Meshes of Gmsh and Abaqus, with their sets."""

import logging
from pathlib import Path
from typing import Any

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
from dolfinx.io.utils import cell_perm_vtk
from dolfinx.mesh import CellType

from pw_elements.abaqus import FACES, Model
from pw_elements.arrays import Array, Indices
from pw_elements.checks import arguments, collective, same_everywhere
from pw_elements.meshes.groups import from_model
from pw_elements.meshes.msh import read_msh
from pw_elements.meshes.tagged import MeshArrays, Names, TaggedMesh, check_plane, distribute
from pw_elements.progress import told


@same_everywhere
def from_file(path: str | Path, comm: MPI.Comm = MPI.COMM_WORLD) -> TaggedMesh:
    """Mesh and sets from a file of Gmsh (`.msh`) or of Abaqus or CalculiX (`.inp`).

        part = from_file("seal.inp")
        K = assemble_matrix(Body(Spaces.petrov_galerkin(part.mesh), steel, "solid").stiffness())
        pressed = boundary_measure(part.mesh, part.facets("TOP"))

    Of `.inp` files: C3D10, C3D4, C3D8, and plane elements and shells with 3, 4 or 6 nodes, such as
    CPS6, CPE6, CAX6, S6, all in one plane z = constant. Elements of the highest dimension are
    cells, those of one less are facets. ELSETs are sets of cells or facets; SURFACEs are sets of
    facets, and so are NSETs: of the boundary's facets with all nodes in them. If a SURFACE and a
    set have one name, the SURFACE's facets count. Sets without any facet or cell, and those whose
    names begin with an underscore, are left out. Sets of parts keep their names if there is one
    part; otherwise they are called "INSTANCE.SET". Names are in capitals.

    Args:
        path: of the file.
        comm: communicator.

    Raises:
        FileNotFoundError: if there is no such file, or it includes one that is not there.
        ValueError: for a file of another kind, or one that states no such mesh; the message names
            what cannot be read, such as elements C3D20 and CPS8, which DOLFINx has no cells for.
    """
    arguments.communicator(comm)
    arguments.of_type("path", path, (str, Path), "it has to be the path of a file")
    path = Path(path)
    if path.suffix.lower() == ".msh":
        return from_gmsh(comm, path)
    if path.suffix.lower() == ".inp":
        return _from_abaqus(path, comm)
    raise ValueError(f"{path}: files end with .msh (Gmsh) or .inp (Abaqus, CalculiX)")


@same_everywhere
def from_gmsh(comm: MPI.Comm, source: Any) -> TaggedMesh:  # noqa: ANN401
    """Mesh from a `.msh` file or from the model that Gmsh has just meshed, with physical groups.

        mesh, cell_tags, facet_tags, names = from_gmsh(MPI.COMM_WORLD, gmsh.model)

    Gmsh's own order is kept: after `gmsh.model.mesh.setOrder(2)` the mesh's sides are curved. The
    mesh lies in a space of the cells' own dimension.

    Args:
        comm: communicator.
        source: path of a file, or `gmsh.model`, which is read on process 0.

    Raises:
        ModuleNotFoundError: if Gmsh's Python module is not installed.
        FileNotFoundError: if there is no such file.
        ValueError: for a file that Gmsh cannot read, a model without a mesh or without a physical
            group of cells, or a mesh of dimension 2 that does not lie in a plane z = constant.
    """
    arguments.communicator(comm)
    path = Path(source) if isinstance(source, str | Path) else None
    arrays, notes = None, list[str]()
    with collective(comm) as same:
        same["source"] = path  # a model is process 0's
        if comm.rank == 0:
            arrays, notes = _read_gmsh(source, path)
    for note in notes:
        told(comm, logging.WARNING, note)
    return distribute(comm, arrays)


def _read_gmsh(model: Any, path: Path | None) -> tuple[MeshArrays, list[str]]:  # noqa: ANN401
    if path is None and not hasattr(model, "getPhysicalGroups"):
        words = "it has to be a file's name, or gmsh.model"
        raise TypeError(f"the source is {arguments.described(model)}: {words}")
    whose = "Gmsh's model" if path is None else str(path)
    try:
        mesh = from_model(model) if path is None else read_msh(path)
        arrays, notes = mesh.arrays()
    except ValueError as error:
        raise ValueError(f"{whose} cannot be read: {error}") from error
    return arrays, [f"{whose}: {note}" for note in notes]


def _from_abaqus(path: Path, comm: MPI.Comm) -> TaggedMesh:
    with collective(comm):
        arrays = None if comm.rank else MeshArrays(*_deck(path))
    return distribute(comm, arrays)


def _deck(path: Path) -> tuple[tuple[str, int], Array, Indices, dict[str, Indices], Names]:
    """Cell and degree, nodes (k, dim), cells (n, nodes of each) in DOLFINx' order, tags, names.

    Tags are of "cells" (n, 1) and of "facets" (n, facets of each), 0 being none.
    """
    model = Model(path)
    placed = {"", *model.instances.values()} if model.instances else {k[0] for k in model.nodes}
    elements = {key: element for key, element in model.elements.items() if key[0] in placed}
    dim = max((kind[0] for kind, _ in elements.values()), default=0)
    kinds = {kind[1:3] for kind, _ in elements.values() if kind[0] == dim}
    if dim < 2 or len(kinds) > 1:
        found = " and ".join(sorted(f"{name}s of degree {n}" for name, n in kinds)) or "none"
        raise ValueError(f"{path}: a mesh has plane or solid cells of one kind, here are {found}")
    ((cell, degree),) = kinds
    own = {key: nodes for key, (kind, nodes) in elements.items() if kind[0] == dim}
    used = {node for nodes in own.values() for node in nodes}
    if lost := used - model.nodes.keys():
        raise ValueError(f"{path}: elements have the node {min(lost)[1]}, which is not there")
    x = np.array([at for key, at in model.nodes.items() if key in used])
    row = {key: k for k, key in enumerate(key for key in model.nodes if key in used)}
    cells = np.array([[row[node] for node in nodes] for nodes in own.values()])
    order = cell_perm_vtk(CellType[cell], cells.shape[1])  # Abaqus' is VTK's
    cells = cells[:, order]
    if dim == 2:
        check_plane(str(path), x)

    # every facet once, by its corners, and which of them each cell has
    corners = np.array(basix.topology(basix.CellType[cell])[dim - 1])
    rows = np.sort(cells[:, corners], axis=2).reshape(-1, corners.shape[1])
    facets, which, times = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(len(cells), -1)
    outer = times[which] == 1
    element = basix.ufl.element("Lagrange", cell, degree)
    with_middles = np.array(element.entity_closure_dofs[dim - 1])
    sides: list[set[int]] = [{*map(int, facet)} for facet in corners]
    side = {
        f"S{n}": sides.index({order.index(int(k)) for k in face})
        for n, face in enumerate(FACES[cell], 1)
    }
    number = {key: k for k, key in enumerate(own)}
    by_corners = {tuple(row): k for k, row in enumerate(facets.tolist())}
    ends, skin = {*rows.ravel().tolist()}, {}
    for key, (made_as, nodes) in elements.items():
        if made_as[0] == dim - 1:
            corner = tuple(sorted({row.get(node, -1) for node in nodes} & ends))
            if corner not in by_corners:
                raise ValueError(
                    f"{path}: element {key[1]} is no facet of a cell: shells are not read"
                )
            skin[key] = by_corners[corner]

    def facets_of(kind: str, members: list[Any]) -> list[int]:
        if kind == "NSET":
            inside = np.isin(np.arange(len(x)), [row[key] for key in members if key in row])
            return which[inside[cells[:, with_middles]].all(axis=2) & outer].tolist()
        if kind == "ELSET":
            return [skin[key] for key in members if key in skin]
        of = {made: [m[1:] for m in members if m[0] == made] for made in ("NSET", "ELSET")}
        found = [facet for made in of for facet in facets_of(made, [key for _, key in of[made]])]
        for face, key in of["ELSET"]:
            if (k := number.get(key)) is None:
                continue
            if face and face not in side:
                raise ValueError(f"{path}: a surface has faces {face}; a {cell} has {[*side]}")
            found += [which[k, side[face]]] if face else [*which[k][outer[k]]]
        return found

    sets: dict[str, dict[str, Indices]] = {"cells": {}, "facets": {}}
    instance = {part: name for name, part in model.instances.items() if len(model.instances) > 1}
    for sort, named in model.sets.items():
        for (part, title), members in named.items():
            if part not in placed or title.startswith("_"):
                continue
            label = f"{instance[part]}.{title}" if part in instance else title
            if chosen := facets_of(sort, members):
                sets["facets"][label] = np.unique(chosen)
            if sort == "ELSET" and not number.keys().isdisjoint(members):
                sets["cells"][label] = np.unique([number[key] for key in members if key in number])
    cell_tags, of_cells = _numbered(sets["cells"], len(cells))
    facet_tags, of_facets = _numbered(sets["facets"], len(facets))
    tags = {"cells": cell_tags[:, None], "facets": facet_tags[which]}
    names = {"cells": of_cells, "facets": of_facets}
    return (cell, degree), np.ascontiguousarray(x[:, :dim]), cells, tags, names


def _numbered(sets: dict[str, Indices], count: int) -> tuple[Indices, dict[str, tuple[int, ...]]]:
    """Tags (count,) that tell in which of the sets each member is, from 1, and those of a set."""
    codes: Indices = np.zeros(count, dtype=np.int64)
    for members in sets.values():
        inside = np.isin(np.arange(count), members)
        codes = np.unique(2 * codes + inside, return_inverse=True)[1].astype(np.int64)
    tag: dict[int, int] = {}
    names = {}
    for name, members in sets.items():
        own = map(int, np.unique(codes[members]))
        names[name] = tuple(tag.setdefault(code, len(tag) + 1) for code in own)
    return np.array([tag.get(code, 0) for code in range(codes.max() + 1)])[codes], names

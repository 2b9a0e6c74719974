"""Structured rectangles, their smooth images, and meshes of Gmsh and Abaqus with their sets."""

import logging
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    DiagonalType,
    Mesh,
    MeshTags,
    create_mesh,
    create_rectangle,
    meshtags,
)

from pw_elements._compat import model_to_mesh
from pw_elements.abaqus import DeckMesh, capitals, read_deck
from pw_elements.arrays import Array, Local
from pw_elements.checks import (
    DegenerateMesh,
    answer,
    arguments,
    check_cells,
    collective,
    compare_function,
    same_everywhere,
)
from pw_elements.progress import told

__all__ = ["curved", "from_file", "from_gmsh", "mapped", "quadrilaterals", "triangles"]

Pattern = Literal["right", "left", "right_left", "left_right", "crossed"]
PATTERNS: tuple[Pattern, ...] = get_args(Pattern)
Names = dict[str, dict[str, tuple[int, ...]]]  # of "cells" and "facets": the tags of each set
Map = Callable[[Array], Array]  # of points as rows, (n, 3)


@same_everywhere
def triangles(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    pattern: Pattern = "right",
) -> Mesh:
    """Meshes a rectangle with triangles.

    Args:
        comm: communicator.
        lower: corner (x, y).
        upper: the opposite corner, above and to the right.
        divisions: squares in each direction.
        pattern: how a square is cut into triangles; "crossed" gives four, the others two.

    Raises:
        ValueError: for an empty rectangle, no divisions, or an unknown pattern.
    """
    if not arguments.is_one_of(pattern, PATTERNS):
        raise ValueError(f"diagonal pattern {pattern!r}: the patterns are {', '.join(PATTERNS)}")
    return _rectangle(comm, lower, upper, divisions, diagonal=DiagonalType[pattern])


@same_everywhere
def quadrilaterals(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
) -> Mesh:
    """Meshes a rectangle with quadrilaterals.

    Args:
        comm: communicator.
        lower: corner (x, y).
        upper: the opposite corner, above and to the right.
        divisions: quadrilaterals in each direction.

    Raises:
        ValueError: for an empty rectangle or no divisions.
    """
    return _rectangle(comm, lower, upper, divisions, cell_type=CellType.quadrilateral)


class TaggedMesh(NamedTuple):
    """A mesh, tags of its cells and facets, and which tags a named set has.

    Sets of Abaqus' files may overlap: cells, or facets, that lie in the same sets share one tag.

    Args:
        mesh: the mesh.
        cell_tags: `cell_tags.find(STEEL)` are the local cells of one tag.
        facet_tags: `facet_tags.find(BASE)` are the local facets of one tag.
        names: of sets of "cells" and of "facets", with the tags of each, such as
            {"cells": {"STEEL": (1,)}, "facets": {"BASE": (1, 3)}}.
    """

    mesh: Mesh
    cell_tags: MeshTags
    facet_tags: MeshTags
    names: Names

    def cells(self, name: str) -> Local:
        """Local numbers of the cells in a named set.

        Args:
            name: of the set; upper and lower case are alike for Abaqus' files.

        Raises:
            ValueError: if there is no such set.
        """
        return self._find("cells", self.cell_tags, name)

    def facets(self, name: str) -> Local:
        """Local numbers of the facets in a named set, as `boundary_measure` takes them.

        Args:
            name: of the set; upper and lower case are alike for Abaqus' files.

        Raises:
            ValueError: if there is no such set.
        """
        return self._find("facets", self.facet_tags, name)

    def _find(self, kind: str, tags: MeshTags, name: str) -> Local:
        known = self.names[kind]
        own = known.get(name, known.get(capitals(name), ()))
        if not own:
            raise ValueError(
                f"no set of {kind} is called {name}; known are {', '.join(known) or 'none'}"
            )
        return tags.indices[np.isin(tags.values, own)]


@same_everywhere
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
    arguments.communicator(comm)
    arguments.of_type("path", path, (str, Path), "it has to be the path of a file")
    one_or_more = (str, Sequence, type(None))
    arguments.of_type("cells", cells, one_or_more, "give the name of an ELSET, or several")
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
    with collective(comm):
        import gmsh
    path = Path(source) if isinstance(source, str | Path) else None
    with collective(comm) as same:
        same["source"] = path  # a model is process 0's
        if comm.rank == 0 and path is None and not hasattr(source, "getPhysicalGroups"):
            words = "it has to be a file's name, or gmsh.model"
            raise TypeError(f"the source is {arguments.described(source)}: {words}")
    dim, names = 0, Names()
    with ExitStack() as opened:
        with collective(comm):
            if comm.rank == 0:
                if path is not None:
                    _open(gmsh, path, opened)
                dim = _checked_dimension(gmsh.model)
                names = _group_names(gmsh.model)
        dim, names = comm.bcast((dim, names))
        mesh, cell_tags, facet_tags = model_to_mesh(gmsh.model, comm, 0, gdim=dim)[:3]
    if facet_tags is None:  # DOLFINx 0.10 and later, of models without groups of facets
        none = np.empty(0, dtype=np.int32)
        facet_tags = meshtags(mesh, mesh.topology.dim - 1, none, none)
    return TaggedMesh(mesh, cell_tags, facet_tags, names)


@same_everywhere
def mapped(mesh: Mesh, image: Map) -> Mesh:
    """Moves the mesh's nodes in place; straight sides stay straight.

    Args:
        mesh: the mesh.
        image: function of points as rows, (n, 3) to (n, 3), or to (n, dim) in dim dimensions.

    Raises:
        ValueError: if the image fails, has the wrong shape, or is not finite; nothing is moved
            then.
    """
    arguments.mesh(mesh)
    mesh.geometry.x[:, : mesh.geometry.dim] = _placed(mesh, image, mesh.geometry.x)
    return mesh


@same_everywhere
def curved(mesh: Mesh, image: Map) -> Mesh:
    """New mesh of degree-2 geometry whose nodes, including mid-side ones, are mapped.

    Args:
        mesh: of straight sides.
        image: function of points as rows, (n, 3) to (n, 3), or to (n, dim) in dim dimensions.

    Raises:
        ValueError: if the image fails, has the wrong shape, or is not finite.
    """
    arguments.mesh(mesh)
    dimension = mesh.geometry.dim
    element = basix.ufl.element("Lagrange", mesh.topology.cell_name(), 2, shape=(dimension,))
    nodes = fem.functionspace(mesh, element)
    index_map = nodes.dofmap.index_map
    cells_owned = mesh.topology.index_map(mesh.topology.dim).size_local
    # cells in the order of the old mesh's making, in which pairs of triangles follow each other
    order = np.argsort(mesh.topology.original_cell_index[:cells_owned])
    local = nodes.dofmap.list[order]
    cells = index_map.local_to_global(local.ravel().astype(np.int32)).reshape(local.shape)
    x = _placed(mesh, image, nodes.tabulate_dof_coordinates()[: index_map.size_local])
    return create_mesh(mesh.comm, cells=cells, x=np.ascontiguousarray(x), e=element)


def _placed(mesh: Mesh, image: Map, x: Array) -> Array:
    dim = mesh.geometry.dim
    with collective(mesh.comm):
        if callable(image) and not arguments.is_function(image):
            raise TypeError(f"the image is {arguments.described(image)}: give a function of points")
        given = np.asarray(answer(mesh.comm, "the image of the mesh", image, x.copy()))
        shape = (len(x), dim if given.shape[1:] == (dim,) else 3)
        placed = arguments.field(
            "the image of the mesh", given, shape, f"rows (n, 3) to (n, 3) or (n, {dim})"
        )
        if not np.isfinite(placed).all():
            raise ValueError("the image of the mesh is not finite at a node")
    compare_function(mesh.comm, "the image of the mesh", image, x)
    return placed[:, :dim]


def _rectangle(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    **kind: CellType | DiagonalType,
) -> Mesh:
    arguments.communicator(comm)
    if not np.all(arguments.vector("lower", lower, 2) < arguments.vector("upper", upper, 2)):
        raise ValueError(f"a rectangle from {lower} to {upper} has no area")
    numbers = arguments.vector("divisions", divisions, 2)
    if numbers.min() < 1 or np.any(numbers % 1 != 0):
        raise ValueError(f"divisions {divisions}: at least one in each direction")
    return create_rectangle(comm, [lower, upper], [int(n) for n in numbers], **kind)


def _open(gmsh: Any, path: Path, opened: ExitStack) -> None:  # noqa: ANN401
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    if gmsh.isInitialized():
        raise ValueError(f"Gmsh is at work: call gmsh.finalize() before {path} is read")
    gmsh.initialize(interruptible=False)
    opened.callback(gmsh.finalize)
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        gmsh.open(str(path))
    except Exception as error:  # Gmsh's own
        raise ValueError(f"{path} cannot be read: {error}") from error


def _checked_dimension(model: Any) -> int:  # noqa: ANN401
    """The dimension of a model's cells, which have to be there, and in a physical group."""
    dim, x = model.getDimension(), np.reshape(model.mesh.getNodes()[1], (-1, 3))
    if dim < 2 or not len(x):
        raise ValueError("Gmsh's model has no mesh: call gmsh.model.mesh.generate first")
    if dim == 2:
        _check_plane("Gmsh's model", x)
    if not model.getPhysicalGroups(dim):
        raise ValueError(
            "no physical group has the cells: gmsh.model.addPhysicalGroup(dim, tags, number) "
            "makes one, and DOLFINx takes only what is in groups"
        )
    return dim


def _group_names(model: Any) -> Names:  # noqa: ANN401
    names: Names = {"cells": {}, "facets": {}}
    highest = model.getDimension()
    for dim, tag in model.getPhysicalGroups():
        name = model.getPhysicalName(dim, tag)
        if name and dim >= highest - 1:
            names["cells" if dim == highest else "facets"][name] = (tag,)
    return names


def _check_plane(whose: str, x: Array) -> None:
    if np.ptp(x[:, 2]) > 1e-9 * np.ptp(x, axis=0).max():
        raise ValueError(f"{whose} has plane cells that do not lie in one plane z = constant")


def _from_abaqus(path: Path, comm: MPI.Comm, chosen: Sequence[str] | None) -> TaggedMesh:
    with collective(comm):
        own = None if comm.rank else read_deck(path, chosen)
    deck: DeckMesh = comm.bcast(own)
    x, cells, dim = deck.x, deck.cells, deck.x.shape[1]
    if deck.notes:
        told(comm, logging.WARNING, f"{path}: {'; '.join(deck.notes)}")
    if comm.rank:
        x, cells = x[:0], cells[:0]
    element = basix.ufl.element("Lagrange", deck.cell, deck.degree, shape=(dim,))
    mesh = create_mesh(comm, cells=cells, x=x, e=element)
    mesh.topology.create_connectivity(dim, dim - 1)
    given = mesh.topology.original_cell_index
    entities = {
        "cells": np.arange(len(given), dtype=np.int32),
        "facets": mesh.topology.connectivity(dim, dim - 1).array,
    }
    found = []
    for k, (kind, entity) in enumerate(entities.items()):
        tag = deck.tags[kind][given].ravel()
        each, first = np.unique(entity[tag > 0], return_index=True)
        found.append(meshtags(mesh, dim - k, each, tag[tag > 0][first].astype(np.int32)))
    try:
        check_cells(mesh)
    except DegenerateMesh as error:
        raise DegenerateMesh(f"{path}: {error}") from error
    return TaggedMesh(mesh, found[0], found[1], deck.names)

"""Structured rectangles, their smooth images, and meshes of Gmsh and Abaqus with their sets."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
from dolfinx import fem
from dolfinx.io.utils import cell_perm_vtk
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
from pw_elements.abaqus import FACES, Model
from pw_elements.arrays import Array, Indices, Local
from pw_elements.checks import answer, arguments, collective, compare_function, same_everywhere

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
        own = known.get(name, known.get(name.upper(), ()))
        if not own:
            raise ValueError(
                f"no set of {kind} is called {name}; known are {', '.join(known) or 'none'}"
            )
        return tags.indices[np.isin(tags.values, own)]


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


def _from_abaqus(path: Path, comm: MPI.Comm) -> TaggedMesh:
    with collective(comm):
        deck = None if comm.rank else _deck(path)
    (cell, degree), x, cells, tags, names = comm.bcast(deck)
    dim = x.shape[1]
    if comm.rank:
        x, cells = x[:0], cells[:0]
    element = basix.ufl.element("Lagrange", cell, degree, shape=(dim,))
    mesh = create_mesh(comm, cells=cells, x=x, e=element)
    mesh.topology.create_connectivity(dim, dim - 1)
    given = mesh.topology.original_cell_index
    entities = {
        "cells": np.arange(len(given), dtype=np.int32),
        "facets": mesh.topology.connectivity(dim, dim - 1).array,
    }
    found = []
    for k, (kind, entity) in enumerate(entities.items()):
        tag = tags[kind][given].ravel()
        each, first = np.unique(entity[tag > 0], return_index=True)
        found.append(meshtags(mesh, dim - k, each, tag[tag > 0][first].astype(np.int32)))
    return TaggedMesh(mesh, found[0], found[1], names)


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
        _check_plane(str(path), x)

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

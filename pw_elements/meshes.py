"""Structured rectangles in the patterns of the examples, their smooth images, and Gmsh's meshes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
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

from pw_elements.checks import answer, arguments, collective, field, same_everywhere, vector

__all__ = ["curved", "from_gmsh", "mapped", "on_lines", "quadrilaterals", "triangles"]

Array = npt.NDArray[np.float64]
Pattern = Literal["right", "left", "right_left", "left_right", "crossed"]
PATTERNS: tuple[Pattern, ...] = ("right", "left", "right_left", "left_right", "crossed")
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
    arguments.communicator(comm)
    _check(lower, upper, divisions, pattern)
    cells = [int(n) for n in divisions]
    return create_rectangle(comm, [lower, upper], cells, diagonal=DiagonalType[pattern])


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
    arguments.communicator(comm)
    _check(lower, upper, divisions)
    cells = [int(n) for n in divisions]
    return create_rectangle(comm, [lower, upper], cells, CellType.quadrilateral)


@same_everywhere
def on_lines(
    comm: MPI.Comm,
    x_lines: npt.NDArray[np.float64],
    y_lines: npt.NDArray[np.float64],
    cell: str,
    pattern: Pattern = "right",
) -> Mesh:
    """Meshes a rectangle along given lines.

    Args:
        comm: communicator.
        x_lines: increasing coordinates (m,) of the lines x = constant.
        y_lines: the same (n,) of the lines y = constant.
        cell: "triangle" or "quadrilateral".
        pattern: how rectangles are cut into triangles.

    Raises:
        ValueError: if lines do not increase, or the cell or the pattern is unknown.
    """
    arguments.communicator(comm)
    for name, lines in (("x_lines", x_lines), ("y_lines", y_lines)):
        if not np.all(np.diff(vector(name, lines)) > 0):
            raise ValueError("mesh lines have to increase")
    if cell not in ("triangle", "quadrilateral"):
        raise ValueError(f'cell {cell!r}: the cells are "triangle" and "quadrilateral"')
    divisions = (len(x_lines) - 1, len(y_lines) - 1)
    corners = (0.0, 0.0), (float(divisions[0]), float(divisions[1]))

    def placed(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        moved = x.copy()
        for axis, lines in enumerate((x_lines, y_lines)):
            moved[:, axis] = np.interp(x[:, axis], np.arange(len(lines)), lines)
        return moved

    if cell == "triangle":
        return mapped(triangles(comm, *corners, divisions, pattern), placed)
    return mapped(quadrilaterals(comm, *corners, divisions), placed)


class TaggedMesh(NamedTuple):
    """A mesh and the numbers of Gmsh's physical groups.

    Args:
        mesh: the mesh.
        cell_tags: of the groups of cells; `cell_tags.find(STEEL)` are those of one group.
        facet_tags: of the groups of facets; `facet_tags.find(BASE)` are those of one group.
    """

    mesh: Mesh
    cell_tags: MeshTags
    facet_tags: MeshTags


@same_everywhere
def from_gmsh(comm: MPI.Comm, source: Any, dim: int = 3) -> TaggedMesh:  # noqa: ANN401
    """Mesh from a `.msh` file or from the model that Gmsh has just meshed, with physical groups.

        mesh, cell_tags, facet_tags = from_gmsh(MPI.COMM_WORLD, "gasket.msh", dim=2)
        mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model, dim=2)

    Gmsh's own order is kept: after `gmsh.model.mesh.setOrder(2)` the mesh's sides are curved.

    Args:
        comm: communicator.
        source: path of a file, or `gmsh.model`, which is read on process 0.
        dim: of the space in which the mesh lies: 2 for plane meshes.

    Raises:
        ModuleNotFoundError: if Gmsh's Python module is not installed.
        FileNotFoundError: if there is no such file.
        ValueError: for a dimension other than 2 or 3, a file that Gmsh cannot read, or a model
            without a mesh or without a physical group of cells.
    """
    arguments.communicator(comm)
    import gmsh

    from pw_elements._compat import model_to_mesh

    if dim not in (2, 3):
        raise ValueError(f"dim = {dim!r}: meshes from Gmsh lie in 2 or 3 dimensions")
    with collective(comm) as same:
        from_file = isinstance(source, str | Path)
        same["source"] = source if from_file else None  # a model is process 0's
        if comm.rank == 0 and not (from_file or hasattr(source, "getPhysicalGroups")):
            words = "it has to be a file's name, or gmsh.model"
            raise TypeError(f"the source is {arguments.described(source)}: {words}")
        if comm.rank == 0 and from_file:
            _open(gmsh, Path(source))
    try:
        with collective(comm):
            if comm.rank == 0:
                _check_model(gmsh.model, dim)
        read = model_to_mesh(gmsh.model, comm, 0, gdim=dim)
    finally:
        if comm.rank == 0 and from_file:
            gmsh.finalize()
    mesh, cell_tags, facet_tags = read[0], read[1], read[2]
    if facet_tags is None:  # DOLFINx 0.10 and later, of models without groups of facets
        none = np.empty(0, dtype=np.int32)
        facet_tags = meshtags(mesh, mesh.topology.dim - 1, none, none)
    return TaggedMesh(mesh, cell_tags, facet_tags)


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
        given = np.asarray(answer(mesh.comm, "the image of the mesh", image, x.copy()))
        shape = (len(x), dim if given.shape[1:] == (dim,) else 3)
        placed = field(
            "the image of the mesh", given, shape, f"rows (n, 3) to (n, 3) or (n, {dim})"
        )
        if not np.isfinite(placed).all():
            raise ValueError("the image of the mesh is not finite at a node")
    return placed[:, :dim]


def _check(
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    pattern: Pattern = "right",
) -> None:
    if not np.all(vector("lower", lower, 2) < vector("upper", upper, 2)):
        raise ValueError(f"a rectangle from {lower} to {upper} has no area")
    numbers = vector("divisions", divisions, 2)
    if numbers.min() < 1 or np.any(numbers % 1 != 0):
        raise ValueError(f"divisions {divisions}: at least one in each direction")
    if pattern not in PATTERNS:
        raise ValueError(f"diagonal pattern {pattern!r}: the patterns are {', '.join(PATTERNS)}")


def _open(gmsh: Any, path: Path) -> None:  # noqa: ANN401
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    if gmsh.isInitialized():
        raise ValueError(f"Gmsh is at work: call gmsh.finalize() before {path} is read")
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        gmsh.open(str(path))
    except Exception as error:  # Gmsh's own
        gmsh.finalize()
        raise ValueError(f"{path} cannot be read: {error}") from error


def _check_model(model: Any, dim: int) -> None:  # noqa: ANN401
    """Raises unless Gmsh's model has a mesh with a physical group of cells."""
    highest = model.getDimension()
    if highest < 2 or not len(model.mesh.getNodes()[0]):
        raise ValueError("Gmsh's model has no mesh: call gmsh.model.mesh.generate first")
    if highest > dim:
        raise ValueError(f"Gmsh's model has cells of {highest} dimensions: give dim={highest}")
    if not model.getPhysicalGroups(highest):
        raise ValueError(
            "no physical group has the cells: gmsh.model.addPhysicalGroup(dim, tags, number) "
            "makes one, and DOLFINx takes only what is in groups"
        )

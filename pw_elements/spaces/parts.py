"""Parts of a body as users name them: by a marker, by local numbers, or by a mask of these."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias, cast

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh, MeshTags, exterior_facet_indices, locate_entities_boundary

from pw_elements.arrays import Array, LocalIndices, Mask
from pw_elements.checks import (
    arguments,
    call_user_function,
    check_same_function,
    collective_errors,
)
from pw_elements.spaces.hybrid import SubSpace

# of points as columns (3, n): True or False for each, (n,)
Marker: TypeAlias = Callable[[Array], Mask]
# of facets or nodes: a marker, local numbers of any integer type, or a mask of all of them
Part: TypeAlias = Marker | npt.NDArray[np.integer] | Mask


def evaluate_marker(comm: MPI.Comm, name: str, marker: Marker, x: Array) -> Mask:
    """Mask (n,) of the points (3, n) at which a marker holds; local, for use under the guard."""
    if not arguments.is_user_function(marker):
        raise TypeError(
            f"{name} is of the type {type(marker).__name__}: give a function of points. Tagged "
            "facets are taken by prescribe, boundary_measure and nodal_flux"
        )
    n = x.shape[1]
    if n == 0:
        return np.zeros(0, dtype=bool)
    layout = "it takes points as columns (3, n) and gives True or False for each, (n,)"
    return arguments.check_function_values(
        name, call_user_function(comm, name, marker, np.array(x, order="C")), (n,), layout, bool
    )


def local_numbers(comm: MPI.Comm, name: str, selection: Any, count: int) -> LocalIndices:  # noqa: ANN401
    """Local numbers, each once, of what numbers (m,) or a mask (count,) name; local."""
    if isinstance(selection, MeshTags):
        raise TypeError(f"{name} are tags: give the tagged ones, tags.find(value)")
    numbers = np.asarray(selection)
    if numbers.shape == (0,) and numbers.dtype != bool:  # a list without entries is of floats
        return np.zeros(0, dtype=np.int32)
    here = f"of which process {comm.rank} has {count}" if comm.size > 1 else f"{count} in all"
    if numbers.ndim != 1 or numbers.dtype.kind not in "iub":
        raise ValueError(
            f"{name} are {numbers.dtype} of the shape {numbers.shape}: they are a marker, local "
            f"numbers (integers), or a mask of all of them, {here}"
        )
    if numbers.dtype == bool:
        if len(numbers) != count:
            raise ValueError(f"{name} are a mask of {len(numbers)}: it is one of all, {here}")
        return np.flatnonzero(numbers).astype(np.int32)
    if numbers.min() < 0 or numbers.max() >= count:
        raise ValueError(
            f"{name} have the numbers {numbers.min()} to {numbers.max()}: local numbers are "
            f"counted from 0, {here}"
        )
    return np.unique(numbers).astype(np.int32)


def locate_nodes(space: fem.FunctionSpace, name: str, where: Part) -> LocalIndices:
    """Local numbers (ghosts too) of a space's nodes, mid-side ones too; collective.

    Of a hybrid space they are those of its displacements; numbers in `where` are of its unknowns, a
    mask may be one of nodes.
    """
    asked = _AskedMarker(space.mesh.comm, f"the marker of {name}", where)
    with collective_errors(space.mesh.comm):
        nodes = _local_nodes(space, name, where, asked)
    asked.compare()
    return nodes


def _local_nodes(
    space: fem.FunctionSpace, whose: str, where: Part, asked: "_AskedMarker"
) -> LocalIndices:
    """Return what `nodes_of` does; local, for use under the guard."""
    comm, field = space.mesh.comm, SubSpace.displacements(space)
    x, index_map = field.space.tabulate_dof_coordinates(), space.dofmap.index_map
    if asked.is_marker:
        return np.flatnonzero(asked.holds(x.T)).astype(np.int32)
    mask = np.asarray(where).dtype == bool and len(np.asarray(where)) == len(x)
    by_node = field.is_whole_space or mask
    count = len(x) if by_node else index_map.size_local + index_map.num_ghosts
    numbers = local_numbers(comm, f"the nodes of {whose}", where, count)
    if by_node:
        return numbers
    inside = np.isin(field.unknowns, numbers)
    nodes = inside.all(axis=1)
    if np.any(inside.any(axis=1) != nodes) or (len(numbers) and not nodes.any()):
        raise ValueError(
            f"the nodes of {whose} are not whole nodes of the hybrid space U: give a marker "
            "or numbers of U itself, fem.locate_dofs_topological(U, tags.dim, tags.find(value))"
        )
    return np.flatnonzero(nodes).astype(np.int32)


def locate_any_nodes(space: fem.FunctionSpace, name: str, where: Part) -> LocalIndices:
    """As `nodes_of`, but a ValueError if there are none on all processes together; collective."""
    nodes = locate_nodes(space, name, where)
    if space.mesh.comm.allreduce(len(nodes), MPI.SUM) == 0:
        raise ValueError("the marker holds at no node of the space: check its coordinates")
    return nodes


def locate_exterior_facets(mesh: Mesh, where: Part, skip_interior: bool = True) -> LocalIndices:
    """Local numbers of a part of the boundary's facets; a marker has to hold at all vertices.

    Given numbers of facets within the body are left out, or refused unless `inner`.
    """
    topology, dimension = mesh.topology, mesh.topology.dim - 1
    topology.create_connectivity(dimension, topology.dim)
    topology.create_connectivity(topology.dim, dimension)
    index_map = topology.index_map(dimension)
    asked = _AskedMarker(mesh.comm, "the marker of the boundary", where)
    with collective_errors(mesh.comm):
        if asked.is_marker:
            facets: LocalIndices = locate_entities_boundary(mesh, dimension, asked.holds)
        else:
            count = index_map.size_local + index_map.num_ghosts
            given = local_numbers(mesh.comm, "facets", where, count)
            facets = np.intersect1d(given, exterior_facet_indices(topology))
            if not skip_interior and np.sum(given < index_map.size_local) > len(facets):
                raise ValueError(
                    "the prescribed part has facets within the body: numbers are those of facets "
                    "of its boundary, tags.find(value); for nodes there is fem.dirichletbc"
                )
    asked.compare()
    return facets


class _AskedMarker:
    """A part as a user names it, and where its marker has been asked, if it is named by one."""

    def __init__(self, comm: MPI.Comm, whose: str, where: Part) -> None:
        self._comm, self._whose, self._where = comm, whose, where
        self.is_marker = arguments.is_user_function(where)
        self._points: list[Array] = [np.empty((0, 3))]
        self._marks: list[Mask] = [np.zeros(0, dtype=bool)]

    def holds(self, x: Array) -> Mask:
        """Return the mask (n,) of points (3, n) at which the marker holds; local."""
        marks = evaluate_marker(self._comm, self._whose, cast(Marker, self._where), x)
        self._points.append(np.array(x.T))
        self._marks.append(marks)
        return marks

    def compare(self) -> None:
        """Raise ValueError where all processes have markers, but others; collective."""
        if not self._comm.allreduce(self.is_marker, MPI.LAND):
            return
        where, x, marks = self._where, np.concatenate(self._points), np.concatenate(self._marks)

        def mark(points: Array) -> Mask:
            return cast(Marker, where)(np.array(points.T, order="C"))

        check_same_function(self._comm, self._whose, mark, x[marks], x[~marks])


def piecewise_constants_by_tag(
    mesh: Mesh, cell_tags: MeshTags, values: Mapping[int, Sequence[float]]
) -> list[fem.Function]:
    """Functions that are constant in each cell, of its material's numbers, by tags; collective."""
    comm, dim = mesh.comm, mesh.topology.dim
    mesh.topology.create_entities(dim)
    owned = mesh.topology.index_map(dim).size_local
    with collective_errors(comm):
        arguments.check_type(
            "the cells' tags", cell_tags, MeshTags, "dolfinx.mesh.meshtags makes them"
        )
        if cell_tags.dim != dim:
            raise ValueError(f"the tags are those of {cell_tags.dim}-D entities: cells are {dim}-D")
        if cell_tags.topology != mesh.topology._cpp_object:
            raise ValueError("the tags are those of another mesh")
        mine = cell_tags.indices < owned
        cells, tags = cell_tags.indices[mine], cell_tags.values[mine]
        if len(cells) < owned:
            raise ValueError(f"{owned - len(cells)} of {owned} cells have no tag, so no material")
    found = set().union(*comm.allgather(set(tags.tolist())))
    if missing := sorted(found - set(values)):
        raise ValueError(f"no material is given for the tags {missing}, which cells have")
    if unknown := sorted(set(values) - found):
        raise ValueError(f"a material is given for the tags {unknown}, which no cell has")
    space = fem.functionspace(mesh, ("DG", 0))
    functions = [fem.Function(space) for _ in next(iter(values.values()))]
    for tag, numbers in values.items():
        at = space.dofmap.list[cells[tags == tag], 0]
        for function, value in zip(functions, numbers, strict=True):
            function.x.array[at] = value
    for function in functions:
        function.x.scatter_forward()
    return functions

"""Selection of parts of a body by a marker, by local numbers or by a mask of local entities."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias, cast

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh, MeshTags, exterior_facet_indices, locate_entities_boundary

from pw_elements.arrays import Array, LocalIndices, Mask
from pw_elements.checks import (
    JoinedSpace,
    arguments,
    call_user_function,
    check_same_function,
    list_bodies,
    raise_errors_on_all_processes,
)
from pw_elements.spaces.hybrid import SubSpace

# Function of points (3, n), one in each column, that returns a mask (n,)
Marker: TypeAlias = Callable[[Array], Mask]


# Selection of facets or nodes: a marker, local numbers of any integer type, or a mask of all local
# facets or nodes
OneMeshSelection: TypeAlias = Marker | npt.NDArray[np.integer] | Mask
# The same, or a mesh and the selection on it, for one of several bodies that have a mesh each
EntitySelection: TypeAlias = OneMeshSelection | tuple[Mesh, OneMeshSelection]


def separate_mesh(where: EntitySelection) -> tuple[Mesh | None, OneMeshSelection]:
    """Return the mesh of a selection, or None if it names no mesh; and the selection on it."""
    if isinstance(where, tuple) and len(where) == 2 and isinstance(where[0], Mesh):
        return where
    return None, cast(OneMeshSelection, where)


def evaluate_marker(comm: MPI.Comm, name: str, marker: Marker, x: Array) -> Mask:
    """Evaluate a user's marker at points (3, n); return the mask (n,).

    The function does not communicate; call it in a block of `raise_errors_on_all_processes`.

    Args:
        comm: communicator of the processes. Error messages contain the rank of this process.
        name: name of the marker, used in error messages.
        marker: the user's function, which takes points (3, n) and returns a mask (n,).
        x: points (3, n), one in each column.

    Raises:
        TypeError: if the marker is not a function.
        ValueError: if the marker raises an error or does not return truth values.
    """
    if not arguments.is_user_function(marker):
        raise TypeError(
            f"{name} is of the type {type(marker).__name__}: give a function of points. Tagged "
            "facets are taken by prescribe, boundary_measure and nodal_flux"
        )
    n = x.shape[1]
    if n == 0:
        return np.zeros(0, dtype=bool)
    layout = "it takes points as columns (3, n) and gives True or False for each, (n,)"
    return arguments.check_user_function_values(
        name, call_user_function(comm, name, marker, np.array(x, order="C")), (n,), layout, bool
    )


def selected_local_numbers(
    comm: MPI.Comm,
    entity_name: str,
    selection: Any,  # noqa: ANN401
    n_entities: int,
) -> LocalIndices:
    """Return the distinct local numbers of the entities in a user's selection.

    The function does not communicate; call it in a block of `raise_errors_on_all_processes`.

    Args:
        comm: communicator of the processes. Error messages contain the rank of this process.
        entity_name: name of the entities, used in error messages.
        selection: local numbers (m,) of the selected entities, or a mask (n_entities,) of all local
            entities.
        n_entities: number of local entities, including ghosts.

    Raises:
        TypeError: if the selection is of the type `MeshTags`.
        ValueError: if the selection consists neither of local numbers nor of a mask of all local
            entities.
    """
    if isinstance(selection, MeshTags):
        raise TypeError(f"{entity_name} are tags: give the tagged ones, tags.find(value)")
    numbers = np.asarray(selection)
    if numbers.shape == (0,) and numbers.dtype != bool:  # NumPy turns an empty list into floats
        return np.zeros(0, dtype=np.int32)
    available = (
        f"of which process {comm.rank} has {n_entities}"
        if comm.size > 1
        else f"{n_entities} in all"
    )
    if numbers.ndim != 1 or numbers.dtype.kind not in "iub":
        raise ValueError(
            f"{entity_name} are {numbers.dtype} of the shape {numbers.shape}: they are a marker, "
            "local "
            f"numbers (integers), or a mask of all of them, {available}"
        )
    if numbers.dtype == bool:
        if len(numbers) != n_entities:
            raise ValueError(
                f"{entity_name} are a mask of {len(numbers)}: it is one of all, {available}"
            )
        return np.flatnonzero(numbers).astype(np.int32)
    if numbers.min() < 0 or numbers.max() >= n_entities:
        raise ValueError(
            f"{entity_name} have the numbers {numbers.min()} to {numbers.max()}: local numbers are "
            f"counted from 0, {available}"
        )
    return np.unique(numbers).astype(np.int32)


def locate_nodes(space: fem.FunctionSpace, name: str, where: EntitySelection) -> LocalIndices:
    """Return the local numbers of a space's nodes in a part of the body; collective.

    Mid-side nodes and ghosts are included.

    Args:
        space: space of the nodes. If it is hybrid, the nodes of the displacements are returned; in
            this case local numbers in `where` refer to unknowns, and a mask to unknowns or nodes.
        name: name of the nodes, used in error messages.
        where: marker, local numbers or mask of the nodes, or a part of one mesh.
    """
    mesh, selection = separate_mesh(where)
    if mesh is not None or (
        isinstance(space, JoinedSpace) and not arguments.is_user_function(where)
    ):
        body = list_bodies(space)[_find_body_of_part(space, name, mesh)]
        return body.nodes[locate_nodes(body.space, name, selection)]
    recorder = _MarkerRecorder(space.mesh.comm, f"the marker of {name}", where)
    with raise_errors_on_all_processes(space.mesh.comm):
        nodes = _locate_nodes_without_communication(space, name, where, recorder)
    recorder.check_same_on_all_processes()
    return nodes


def _find_body_of_part(space: fem.FunctionSpace | JoinedSpace, name: str, mesh: Mesh | None) -> int:
    """Return the index of the body of a space that has a mesh; collective.

    Args:
        space: space of one or several bodies.
        name: name of the selected nodes or facets, used in error messages.
        mesh: mesh that the selection names, or None if it names none.

    Raises:
        ValueError: if the mesh is missing, or is that of none of the bodies.
    """
    meshes = [body.space.mesh for body in list_bodies(space)]
    with raise_errors_on_all_processes(space.mesh.comm) as same:
        if mesh is None:
            raise ValueError(
                f"{name} is given by numbers or a mask, which belong to one of {len(meshes)} "
                "meshes: give the mesh before them, (mesh, numbers)"
            )
        indices = [k for k, body_mesh in enumerate(meshes) if body_mesh is mesh]
        if not indices:
            raise ValueError(f"{name} is a part of a mesh that none of the bodies has")
        same["the mesh of a part"] = indices
    return indices[0]


def locate_exterior_facets_of_bodies(
    space: fem.FunctionSpace | JoinedSpace, name: str, where: EntitySelection
) -> list[LocalIndices]:
    """Return, for each body of a space, its exterior facets in a part of the boundary; collective.

    Args:
        space: space of one or several bodies.
        name: name of the facets, used in error messages.
        where: marker, local numbers or mask of the facets, or a part of one mesh.
    """
    bodies, (mesh, selection) = list_bodies(space), separate_mesh(where)
    if mesh is None and (len(bodies) == 1 or arguments.is_user_function(where)):
        return [locate_exterior_facets(body.space.mesh, selection) for body in bodies]
    index = _find_body_of_part(space, name, mesh)
    facets: list[LocalIndices] = [np.empty(0, dtype=np.int32) for _ in bodies]
    facets[index] = locate_exterior_facets(bodies[index].space.mesh, selection)
    return facets


def _locate_nodes_without_communication(
    space: fem.FunctionSpace, name: str, where: EntitySelection, recorder: "_MarkerRecorder"
) -> LocalIndices:
    """Return the local numbers of the nodes in a part of the body.

    The function does not communicate; call it in a block of `raise_errors_on_all_processes`.
    """
    comm, field = space.mesh.comm, SubSpace.displacements(space)
    x, index_map = field.space.tabulate_dof_coordinates(), space.dofmap.index_map
    if recorder.is_marker:
        return np.flatnonzero(recorder.evaluate(x.T)).astype(np.int32)
    is_node_mask = np.asarray(where).dtype == bool and len(np.asarray(where)) == len(x)
    selects_nodes = field.is_whole_space or is_node_mask
    count = len(x) if selects_nodes else index_map.size_local + index_map.num_ghosts
    numbers = selected_local_numbers(comm, f"the nodes of {name}", where, count)
    if selects_nodes:
        return numbers
    is_selected = np.isin(field.unknowns, numbers)
    nodes = is_selected.all(axis=1)
    if np.any(is_selected.any(axis=1) != nodes) or (len(numbers) and not nodes.any()):
        raise ValueError(
            f"the nodes of {name} are not whole nodes of the hybrid space U: give a marker "
            "or numbers of U itself, fem.locate_dofs_topological(U, tags.dim, tags.find(value))"
        )
    return np.flatnonzero(nodes).astype(np.int32)


def require_nodes(space: fem.FunctionSpace, name: str, where: EntitySelection) -> LocalIndices:
    """Return the local numbers of a space's nodes in a part, which must have nodes; collective.

    The arguments are those of `locate_nodes`.

    Raises:
        ValueError: if no process has a node in the part.
    """
    nodes = locate_nodes(space, name, where)
    if space.mesh.comm.allreduce(len(nodes), MPI.SUM) == 0:
        raise ValueError("the marker holds at no node of the space: check its coordinates")
    return nodes


def locate_exterior_facets(
    mesh: Mesh, where: EntitySelection, skip_interior: bool = True
) -> LocalIndices:
    """Return the local numbers of the exterior facets in a part of the boundary; collective.

    Args:
        mesh: mesh of the body.
        where: marker, which has to hold at all vertices of a facet; or local numbers or a mask of
            facets.
        skip_interior: whether interior facets in `where` are left out; if not, a ValueError is
            raised for them.
    """
    topology, dimension = mesh.topology, mesh.topology.dim - 1
    topology.create_connectivity(dimension, topology.dim)
    topology.create_connectivity(topology.dim, dimension)
    index_map = topology.index_map(dimension)
    recorder = _MarkerRecorder(mesh.comm, "the marker of the boundary", where)
    with raise_errors_on_all_processes(mesh.comm):
        if recorder.is_marker:
            facets: LocalIndices = locate_entities_boundary(mesh, dimension, recorder.evaluate)
        else:
            count = index_map.size_local + index_map.num_ghosts
            selected = selected_local_numbers(mesh.comm, "facets", where, count)
            facets = np.intersect1d(selected, exterior_facet_indices(topology))
            if not skip_interior and np.sum(selected < index_map.size_local) > len(facets):
                raise ValueError(
                    "the prescribed part has facets within the body: numbers are those of facets "
                    "of its boundary, tags.find(value); for nodes there is fem.dirichletbc"
                )
    recorder.check_same_on_all_processes()
    return facets


class _MarkerRecorder:
    """Evaluator of a user's marker that records its values for a comparison between processes.

    Args:
        comm: communicator of the processes.
        name: name of the marker, used in error messages.
        where: marker, local numbers or mask.
    """

    def __init__(self, comm: MPI.Comm, name: str, where: EntitySelection) -> None:
        self._comm, self._name, self._where = comm, name, where
        self.is_marker = arguments.is_user_function(where)
        self._points: list[Array] = [np.empty((0, 3))]
        self._marks: list[Mask] = [np.zeros(0, dtype=bool)]

    def evaluate(self, x: Array) -> Mask:
        """Return the marker's mask (n,) at points (3, n), without communication."""
        marks = evaluate_marker(self._comm, self._name, cast(Marker, self._where), x)
        self._points.append(np.array(x.T))
        self._marks.append(marks)
        return marks

    def check_same_on_all_processes(self) -> None:
        """Raise ValueError if the processes have different markers; collective.

        Nothing is compared if a process has local numbers or a mask instead of a marker.
        """
        if not self._comm.allreduce(self.is_marker, MPI.LAND):
            return
        where, x, marks = self._where, np.concatenate(self._points), np.concatenate(self._marks)

        def evaluate_marker_at_rows(points: Array) -> Mask:
            return cast(Marker, where)(np.array(points.T, order="C"))

        check_same_function(self._comm, self._name, evaluate_marker_at_rows, x[marks], x[~marks])


def piecewise_constants_by_tag(
    mesh: Mesh, cell_tags: MeshTags, values: Mapping[int, Sequence[float]]
) -> list[fem.Function]:
    """Create functions that are constant in each cell, with values that depend on the cell's tag.

    Collective.

    Args:
        mesh: mesh of the functions.
        cell_tags: tags of all cells.
        values: for each tag, the values (k,) of the k functions in the cells with this tag.

    Returns:
        List of k functions.

    Raises:
        ValueError: if the tags are not tags of cells or belong to another mesh, a cell has no tag,
            a tag has no values, or no cell has a tag for which values are given.
    """
    comm, dim = mesh.comm, mesh.topology.dim
    mesh.topology.create_entities(dim)
    owned = mesh.topology.index_map(dim).size_local
    with raise_errors_on_all_processes(comm):
        arguments.check_type(
            "the cells' tags", cell_tags, MeshTags, "dolfinx.mesh.meshtags makes them"
        )
        if cell_tags.dim != dim:
            raise ValueError(f"the tags are those of {cell_tags.dim}-D entities: cells are {dim}-D")
        if cell_tags.topology != mesh.topology._cpp_object:
            raise ValueError("the tags are those of another mesh")
        is_owned = cell_tags.indices < owned
        cells, tags = cell_tags.indices[is_owned], cell_tags.values[is_owned]
        if len(cells) < owned:
            raise ValueError(f"{owned - len(cells)} of {owned} cells have no tag, so no material")
    used_tags = set().union(*comm.allgather(set(tags.tolist())))
    if missing := sorted(used_tags - set(values)):
        raise ValueError(f"no material is given for the tags {missing}, which cells have")
    if unknown := sorted(set(values) - used_tags):
        raise ValueError(f"a material is given for the tags {unknown}, which no cell has")
    space = fem.functionspace(mesh, ("DG", 0))
    functions = [fem.Function(space) for _ in next(iter(values.values()))]
    for tag, numbers in values.items():
        dofs = space.dofmap.list[cells[tags == tag], 0]
        for function, value in zip(functions, numbers, strict=True):
            function.x.array[dofs] = value
    for function in functions:
        function.x.scatter_forward()
    return functions

"""Displacements of several bodies, each with a mesh of its own, as unknowns of one problem.

The cells of a mesh have one type in DOLFINx's forms. Bodies with cells of different types, such as
tetrahedra and hexahedra, therefore need a mesh each. The module joins the unknowns of their spaces
by a common numbering of nodes. On each process, the owned nodes of the first body come first,
followed by those of the second one, and so on; the ghosts follow in the same order. This is also
the numbering of a PETSc matrix that is nested by bodies.

Code that deals with nodes only uses a `JoinedSpace` like a space of DOLFINx. Code that needs cells
or facets uses the spaces of the bodies, see `list_bodies`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la

from pw_elements._compat import make_index_map
from pw_elements.arrays import Array, Indices, LocalIndices


@dataclass(frozen=True)
class JoinedBody:
    """One of the bodies of a space.

    Args:
        space: space of the body's displacements.
        nodes: number in the whole space, on this process, of each local node of the body.
    """

    space: fem.FunctionSpace
    nodes: LocalIndices


class _JoinedGeometry:
    """Dimension and node positions of the meshes of several bodies."""

    def __init__(self, spaces: Sequence[fem.FunctionSpace]) -> None:
        self._spaces = spaces
        self.dim: int = spaces[0].mesh.geometry.dim

    @property
    def x(self) -> Array:
        """Positions (k, 3) of the nodes of all meshes on this process."""
        return np.concatenate([space.mesh.geometry.x for space in self._spaces])


class JoinedSpace:
    """Space of the displacements of several bodies with a mesh each; its creation is collective.

    It has the nodes, their numbers and positions, but no cells and no element.

    Args:
        spaces: spaces of the bodies' displacements, with the same number of components.

    Attributes:
        bodies: the bodies, with the numbers of their nodes in this space.
        mesh: communicator and geometry of all meshes; it has no topology.
        dofmap: index map of the nodes, and the number of components as its block size.
    """

    def __init__(self, spaces: Sequence[fem.FunctionSpace]) -> None:
        comm: MPI.Comm = spaces[0].mesh.comm
        maps = [space.dofmap.index_map for space in spaces]
        n_owned = [index_map.size_local for index_map in maps]
        n_ghosts = [index_map.num_ghosts for index_map in maps]
        owned_of_ranks = np.array(comm.allgather(n_owned), dtype=np.int64)  # (ranks, bodies)
        before = np.cumsum(owned_of_ranks.ravel()) - owned_of_ranks.ravel()
        self._first_number = before.reshape(owned_of_ranks.shape)
        self._first_number_in_body = np.cumsum(owned_of_ranks, axis=0) - owned_of_ranks
        ends = np.cumsum([0, *n_owned, *n_ghosts])
        self.bodies = [
            JoinedBody(
                space,
                np.concatenate(
                    [np.arange(ends[k], ends[k + 1]) for k in (body, body + len(spaces))]
                ).astype(np.int32),
            )
            for body, space in enumerate(spaces)
        ]
        index_map = make_index_map(
            comm,
            sum(n_owned),
            np.concatenate([self.number_nodes(k, m.ghosts) for k, m in enumerate(maps)]),
            np.concatenate([m.owners for m in maps]).astype(np.int32),
        )
        block = spaces[0].dofmap.index_map_bs
        self.dofmap = SimpleNamespace(index_map=index_map, index_map_bs=block, bs=block)
        self.mesh = SimpleNamespace(comm=comm, geometry=_JoinedGeometry(spaces))

    def number_nodes(self, body: int, global_nodes: Indices) -> Indices:
        """Return the global numbers in this space of nodes of a body.

        Args:
            body: index of the body.
            global_nodes: global numbers (...) of the nodes in the body's own space.
        """
        first = self._first_number_in_body[:, body]
        rank = np.searchsorted(first, global_nodes, side="right") - 1
        return np.asarray(self._first_number[rank, body] + global_nodes - first[rank])

    def tabulate_dof_coordinates(self) -> Array:
        """Return the positions (nodes, 3) of the nodes of this process, including ghosts."""
        return self.join_nodal_values([b.space.tabulate_dof_coordinates() for b in self.bodies])

    def join_nodal_values(self, values_of_bodies: Sequence[npt.NDArray]) -> npt.NDArray:
        """Return the nodal values (nodes, ...) of all bodies, including ghosts."""
        first = values_of_bodies[0]
        joined = np.empty((sum(map(len, values_of_bodies)), *first.shape[1:]), dtype=first.dtype)
        for body, values in zip(self.bodies, values_of_bodies, strict=True):
            joined[body.nodes] = values
        return joined


def list_bodies(space: fem.FunctionSpace | JoinedSpace) -> list[JoinedBody]:
    """Return the bodies of a space, which is a single one unless the space is a joined one."""
    if isinstance(space, JoinedSpace):
        return space.bodies
    index_map = space.dofmap.index_map
    nodes = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    return [JoinedBody(space, nodes)]


def evaluate_at_owned_nodes(
    function: Callable[[fem.FunctionSpace], npt.NDArray], space: fem.FunctionSpace | JoinedSpace
) -> npt.NDArray:
    """Return values (owned nodes, ...) of a function that takes the space of a body."""
    return np.concatenate([function(body.space) for body in list_bodies(space)])


class JoinedFunction:
    """Displacements of several bodies with a mesh each.

    Args:
        parts: displacements of the bodies.

    Attributes:
        function_space: space of all displacements.
        x: values of this function, which `copy_to_parts` copies into the bodies' functions.
    """

    def __init__(self, parts: Sequence[fem.Function]) -> None:
        self.parts = list(parts)
        self.function_space = JoinedSpace([part.function_space for part in parts])
        dofmap = self.function_space.dofmap
        self.x = la.vector(dofmap.index_map, dofmap.index_map_bs)
        self.x.array[:] = 0.0

    @cached_property
    def _values_by_node(self) -> Array:
        return self.x.array.reshape(-1, self.function_space.dofmap.index_map_bs)

    def copy_to_parts(self) -> None:
        """Set the functions of the bodies, including ghosts, to the values of this function."""
        for part, body in zip(self.parts, self.function_space.bodies, strict=True):
            part.x.array[:] = self._values_by_node[body.nodes].ravel()

"""Nodes of a body, and those of two parts of its boundary that face each other."""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from scipy.spatial import cKDTree

from pw_elements._compat import cell_nodes
from pw_elements.algebra import Reduction
from pw_elements.checks import listed
from pw_elements.contact.model import MatchingNodes
from pw_elements.spaces import Part, SubSpace, assemble_vector, nodes_of

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Cells at a time, to save memory
_CELLS_AT_ONCE = 20_000

# Largest distance of a node from where its counterpart should be, over the body's diagonal
_MATCHING = 1e-6


@dataclass(frozen=True)
class BodyNodes:
    """Where the nodes of a body are, and which unknowns and equations they have."""

    field: SubSpace  # the displacements among the unknowns
    x: Array  # (nodes, dim), ghosts too
    column: Indices  # (owned nodes, dim), as of `free_columns`
    outward: Array  # (owned nodes, dim), integrated with the shape functions
    beside: Array  # (nodes, dim), mean midpoint of the cells around
    diagonal: float  # length of the bounding box's

    @classmethod
    def of(cls, space: fem.FunctionSpace, reduction: Reduction) -> "BodyNodes":
        """Looks them up in a space with displacements under a reduction."""
        field = SubSpace.displacements(space)
        space, dim = field.space, space.mesh.geometry.dim
        return cls(
            field,
            space.tabulate_dof_coordinates()[:, :dim],
            free_columns(reduction.right)[field.owned],
            _outward(space).reshape(-1, dim),
            midpoints_around(space),
            float(np.linalg.norm(extents(space.mesh.comm, space.mesh.geometry.x))),
        )

    @property
    def space(self) -> fem.FunctionSpace:
        """The space of the displacements alone."""
        return self.field.space

    def refuse(self, node: npt.NDArray[np.int32], what: str) -> None:
        """Raises a ValueError that names the positions of nodes, if there are any."""
        places = np.concatenate(self.space.mesh.comm.allgather(self.x[node]))
        if len(places):
            raise ValueError(f"contact nodes at {listed(places)} {what}")


def owned_nodes(whose: str, nodes: Part, space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Local numbers of the nodes that this process owns; refuses what names no nodes."""
    given = nodes_of(space, whose, nodes)
    return given[given < space.dofmap.index_map.size_local]


def midpoints_around(space: fem.FunctionSpace) -> Array:
    """Mean of the midpoints of the cells around each node, ghosts too: (nodes, dim)."""
    mesh = space.mesh
    dim, owned = mesh.geometry.dim, mesh.topology.index_map(mesh.topology.dim).size_local
    sums = la.vector(space.dofmap.index_map, dim + 1)
    sums.array[:] = 0.0
    for first in range(0, owned, _CELLS_AT_ONCE):
        some = slice(first, min(first + _CELLS_AT_ONCE, owned))
        middle = mesh.geometry.x[cell_nodes(mesh)[some], :dim].mean(axis=1)
        parts = np.concatenate([middle, np.ones((len(middle), 1))], axis=1)
        cells = space.dofmap.list[some]
        every = np.repeat(parts, cells.shape[1], axis=0)
        np.add.at(sums.array.reshape(-1, dim + 1), cells.ravel(), every)
    sums.scatter_reverse(la.InsertMode.add)
    sums.scatter_forward()
    values = sums.array.reshape(-1, dim + 1)
    return np.asarray(values[:, :dim] / values[:, dim:])


def free_columns(right: PETSc.Mat) -> Indices:
    """Column of each owned row of R that is a row of the identity.

    Empty rows (prescribed values) get -1, combinations -2.
    """
    indptr, indices, data = right.getValuesCSR()
    count = np.diff(indptr)
    column = np.where(count == 0, -1, -2).astype(np.int64)
    single = np.flatnonzero(count == 1)
    kept = single[data[indptr[single]] == 1.0]
    column[kept] = indices[indptr[kept]]
    return column


def _outward(space: fem.FunctionSpace) -> Array:
    """Outward normals of the owned nodes (nodes dim,), integrated with their shape functions."""
    v = ufl.TestFunction(space)
    normal = assemble_vector(ufl.inner(ufl.FacetNormal(space.mesh), v) * ufl.ds)
    # a view would keep the vector on the one process whose error holds these nodes
    return np.array(normal.array_r)


def extents(comm: MPI.Comm, x: Array) -> Array:
    """Extents (dim,) along the axes of points (n, dim) of all processes."""
    ends = np.stack([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, ends, MPI.MIN)
    return -ends.sum(axis=0)


def opposite_nodes(
    number: int,
    matching: MatchingNodes,
    node: npt.NDArray[np.int32],
    theirs: npt.NDArray[np.int32],
    rough: npt.NDArray[np.bool_],
    body: BodyNodes,
) -> Indices:
    """Global number (m,) of the node of the opposite side that each of a pair's nodes faces.

    `theirs` are nodes of the opposite side that this process owns, `rough` (m,) tells where there
    is friction: it would be lost where a displacement is prescribed on the pair's own side only.
    """
    comm, dim = body.space.mesh.comm, body.x.shape[1]
    offset = np.zeros(dim) if matching.offset is None else np.asarray(matching.offset, dtype=float)
    if offset.shape != (dim,):
        raise ValueError(f"contact pair {number}: its offset {offset.tolist()} is not {dim}-D")
    first = body.space.dofmap.index_map.local_range[0]
    known, place, held = (
        np.concatenate(comm.allgather(values))
        for values in (theirs + np.int64(first), body.x[theirs], body.column[theirs] == -1)
    )
    if not len(known):
        raise ValueError(f"contact pair {number} has no opposite nodes: their marker holds nowhere")
    distance, nearest = cKDTree(place).query(body.x[node] + offset)
    body.refuse(node[distance > _MATCHING * body.diagonal], "face no node of the opposite side")
    times = np.bincount(nearest, minlength=len(known))
    comm.Allreduce(MPI.IN_PLACE, times, MPI.SUM)
    body.refuse(node[times[nearest] > 1], "face the same node of the opposite side")
    alone = ((body.column[node] == -1) & ~held[nearest]).any(axis=1)
    body.refuse(
        node[alone & rough],
        "have a prescribed displacement that their counterparts have not: exchange both sides",
    )
    return np.asarray(known[nearest])

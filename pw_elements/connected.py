"""The connected pieces of a mesh, across processes."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from scipy import sparse as sp
from scipy.sparse.csgraph import connected_components


def connected_pieces(space: fem.FunctionSpace) -> tuple[npt.NDArray[np.int64], int]:
    """Number of the connected piece of the mesh that each node (ghosts too) belongs to."""
    comm, cells = space.mesh.comm, space.dofmap.list
    index_map = space.dofmap.index_map
    local = index_map.size_local + index_map.num_ghosts
    others = cells[:, 1:]  # a cell's first node links them
    edges = (np.repeat(cells[:, 0], others.shape[1]), others.ravel())
    graph = sp.csr_matrix((np.ones(others.size, dtype=np.int8), edges), (local, local))
    count, part = connected_components(graph, directed=False)
    first = sum(comm.allgather(count)[: comm.rank])
    # parts of two processes are one piece if they share a node: the owner's number tells which
    number = la.vector(index_map, 1)
    number.array[:] = part + first
    number.scatter_forward()
    ghosts = np.arange(index_map.size_local, local)
    ends = np.stack([part[ghosts] + first, number.array[ghosts].astype(np.int64)])
    total = comm.allreduce(count, MPI.SUM)
    links = np.unique(np.concatenate(comm.allgather(ends), axis=1), axis=1)
    graph = sp.csr_matrix((np.ones(links.shape[1]), links), (total, total))
    pieces, piece = connected_components(graph, directed=False)
    return piece[part + first].astype(np.int64), int(pieces)

"""Nodes of two parts of one mesh's boundary that face each other."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from pw_elements.contact.nodes import BodyNodes
from pw_elements.contact.pairs import MatchingNodes

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Largest distance of a node from where its counterpart should be, over the body's diagonal
_MATCHING = 1e-6


def opposite_nodes(
    number: int,
    matching: MatchingNodes,
    node: npt.NDArray[np.int32],
    theirs: npt.NDArray[np.int32],
    friction: Array,
    body: BodyNodes,
) -> Indices:
    """Global number (m,) of the node of the opposite side that each of a pair's nodes faces.

    Args:
        number: of the pair, for messages.
        matching: the opposite side, as the user states it.
        node: (m,), the pair's own nodes.
        theirs: nodes of the opposite side that this process owns.
        friction: (m,).
        body: whose nodes they are.

    Raises:
        ValueError: if there is none or the same for two, if an offset has another dimension, or
            a displacement is prescribed on the pair's own side of a rough contact only.
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
        node[alone & (friction > 0)],
        "have a prescribed displacement that their counterparts have not: exchange both sides",
    )
    return np.asarray(known[nearest])

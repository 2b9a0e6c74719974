"""Nodes that a preconditioner holds where hardly any node sticks.

Friction may hold a body of which all nodes slide: it turns with the slip, and so makes the tangent
regular. Multigrid for K knows nothing of that: with nothing held along the surface it is singular,
and GMRES breaks down. A few nodes are therefore held in the preconditioner, not in the equations,
which changes it by a matrix of low rank and costs about as many iterations.
"""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.connected import connected_pieces

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Sticking nodes of a piece that hold it well enough
_ENOUGH = 6


@dataclass(frozen=True)
class Anchors:
    """As many nodes of each connected piece as there are dimensions, far from each other.

    Args:
        piece: (m,), number of the piece that each contact node of this process belongs to.
        chosen: (m,), whether it is an anchor.
        pieces: their number.
        comm: of the processes.
    """

    piece: npt.NDArray[np.integer]
    chosen: npt.NDArray[np.bool_]
    pieces: int
    comm: MPI.Comm

    @classmethod
    def of(cls, space: fem.FunctionSpace, nodes: Indices) -> "Anchors":
        """Anchors among local contact nodes (m,)."""
        comm: MPI.Comm = space.mesh.comm
        piece, pieces = connected_pieces(space)
        x = space.tabulate_dof_coordinates()[nodes, : space.mesh.geometry.dim]
        every, where = (np.concatenate(comm.allgather(part)) for part in (x, piece[nodes]))
        chosen = np.zeros(len(every), dtype=bool)
        for k in range(pieces):
            mine = np.flatnonzero(where == k)
            chosen[mine[_apart(every[mine])]] = True
        first = sum(comm.allgather(len(nodes))[: comm.rank])
        return cls(piece[nodes], chosen[first : first + len(nodes)], pieces, comm)

    def held(self, projectors: Array) -> Array:
        """Projectors (m, dim, dim) onto what is held, with the anchors where few nodes stick."""
        dim = projectors.shape[1]
        sticks = np.einsum("naa->n", projectors) > dim - 0.5
        count = np.bincount(self.piece[sticks], minlength=self.pieces)
        self.comm.Allreduce(MPI.IN_PLACE, count, MPI.SUM)
        loose = self.chosen & (count < _ENOUGH)[self.piece]
        return np.where(loose[:, None, None], np.eye(dim), projectors)


def _apart(x: Array) -> list[int]:
    """Points of x (n, dim), the first far from their mean, each next one from those before."""
    if not len(x):
        return []
    chosen = [int(np.argmax(np.linalg.norm(x - x.mean(axis=0), axis=1)))]
    rest = x - x[chosen[0]]
    for _ in range(x.shape[1] - 1):
        far = int(np.argmax(np.linalg.norm(rest, axis=1)))
        size = np.linalg.norm(rest[far])
        if size == 0:
            break
        chosen.append(far)
        rest = rest - np.outer(rest @ rest[far], rest[far]) / size**2
    return chosen

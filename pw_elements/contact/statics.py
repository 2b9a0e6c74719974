"""Rigid motions that supports and contact leave free, by name."""

from itertools import combinations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.contact.errors import listed
from pw_elements.contact.law import ActiveSet, equations
from pw_elements.contact.nodes import free_columns
from pw_elements.contact.system import ContactSystem
from pw_elements.multigrid import connected_pieces

Array = npt.NDArray[np.float64]

# Stiffness of a motion, over what it would be for an arbitrary one: as good as none below
_FREE = 1e-8
_AXES = "xyz"
# Rows that are factorised at once, to save memory
_AT_ONCE = 100_000


class RigidMotions:
    """Translations and rotations of each connected piece, and free translations of surfaces."""

    def __init__(self, system: ContactSystem, space: fem.FunctionSpace) -> None:
        self._system = system
        dim = space.mesh.geometry.dim
        owned = space.dofmap.index_map.size_local
        x = space.tabulate_dof_coordinates()[:owned, :dim]
        piece, count = connected_pieces(space)
        self._planes = list(combinations(range(dim), 2))
        self._centres, self._lengths = np.zeros((count, dim)), np.zeros(count)
        modes = [self._modes(x, piece[:owned] == k, k) for k in range(count)]
        columns = np.concatenate(modes, axis=2).reshape(owned * dim, -1)
        self._at_points = self._motions(columns)
        self._held = self._hold_of_supports(columns)

    def left_free(self, active: ActiveSet, frame: Array) -> list[str]:
        """Names of the motions that an active set in its frames (m, dim, dim) leaves free."""
        friction = self._system.interface.friction
        B = equations(active, friction, np.ones_like(friction))[1]
        return self.free(np.einsum("nab,nbj->naj", B, frame))

    def free(self, constraints: Array) -> list[str]:
        """Names of the motions against which neither stiffness nor constraints act.

        Args:
            constraints: (m, dim, dim), rows that act on the motion of each contact point
                relative to its surface, of unit size.
        """
        system = self._system
        m, dim, bodies = self._at_points.shape
        relative = np.zeros((m, dim, bodies + len(system.free)))
        relative[..., :bodies] = self._at_points
        for k, (pair, axis) in enumerate(system.free):
            relative[system.interface.pair == pair, axis, bodies + k] = -1.0
        motions = relative.shape[2]
        rows = np.einsum("nab,nbm->nam", constraints, relative).reshape(m * dim, motions)
        held = np.pad(self._held, ((0, motions), (0, motions - bodies)))
        _, values, vectors = np.linalg.svd(np.vstack([held, _triangle(rows, system.comm)]))
        return [self._name(vector) for vector in vectors[values < _FREE * np.sqrt(motions)]]

    def _modes(self, x: Array, mine: npt.NDArray[np.bool_], piece: int) -> Array:
        """Translations and rotations (n, dim, modes) of size one of a piece's nodes."""
        comm, dim = self._system.comm, x.shape[1]
        own = x[mine]
        count = comm.allreduce(len(own), MPI.SUM)
        centre = np.array([comm.allreduce(own[:, k].sum(), MPI.SUM) for k in range(dim)]) / count
        length = float(np.sqrt(comm.allreduce(((own - centre) ** 2).sum(), MPI.SUM) / count))
        self._centres[piece], self._lengths[piece] = centre, length
        modes = np.zeros((len(x), dim, dim + len(self._planes)))
        modes[mine, :, :dim] = np.eye(dim)
        s = (own - centre) / length
        for k, (i, j) in enumerate(self._planes):
            modes[mine, i, dim + k] = -s[:, j]
            modes[mine, j, dim + k] = s[:, i]
        return modes

    def _motions(self, modes: Array) -> Array:
        """Motions (m, dim, modes) of the contact points in modes (owned dofs, modes)."""
        system, columns = self._system, []
        for mode in modes.T:
            full = system.interface.motion.createVecRight()
            full.setArray(mode)
            columns.append(system.motions(full))
        return np.stack(columns, axis=2)

    def _hold_of_supports(self, modes: Array) -> Array:
        """What modes do at prescribed displacements, and their forces K m, by `_triangle`.

        Forces count over the stiffness; they are there in axisymmetry, say, where only a
        translation along the axis is without strain.
        """
        system = self._system
        column = free_columns(system.reduction.right)
        first = system.stiffness.getOwnershipRange()[0]
        kept = column >= 0
        images: Array = np.empty((system.stiffness.getLocalSize()[0], modes.shape[1]))
        for k in range(modes.shape[1]):
            vector = system.stiffness.createVecRight()
            local = vector.array
            local[column[kept] - first] = modes[kept, k]
            del local
            image = system.stiffness.createVecLeft()
            system.stiffness.mult(vector, image)
            images[:, k] = image.array_r
        largest = system.comm.allreduce(system.scale.max(initial=0.0), MPI.MAX)
        images /= largest
        return _triangle(np.vstack([images, modes[column == -1]]), system.comm)

    def _name(self, vector: Array) -> str:
        dim, bodies = self._centres.shape[1], self._at_points.shape[2]
        pieces = vector[:bodies].reshape(len(self._centres), -1)
        piece = int(np.argmax(np.linalg.norm(pieces, axis=1)))
        motion, whose = pieces[piece], ""
        if len(pieces) > 1:
            whose = f" of the body around {listed(self._centres[piece : piece + 1])}"
        turning = motion[dim:]
        if np.abs(turning).max(initial=0.0) > 1e-6:
            if dim == 2:
                return f"rotation{whose} about {self._pole(piece, motion)}"
            axis = [turning[self._planes.index(p)] for p in ((1, 2), (0, 2), (0, 1))]
            main = int(np.argmax(np.abs(axis)))
            return f"rotation{whose} about an axis along {_AXES[main]}"
        if np.abs(motion[:dim]).max() > 1e-6:
            return f"translation {_AXES[int(np.argmax(np.abs(motion[:dim])))]}{whose}"
        pair, axis_of = self._system.free[int(np.argmax(np.abs(vector[bodies:])))]
        return f"translation {_AXES[axis_of]} of the surface of pair {pair}"

    def _pole(self, piece: int, motion: Array) -> str:
        """The point of the plane at rest: u = t + w (x - centre) turned by a quarter."""
        t, w = motion[:2], motion[2] / self._lengths[piece]
        pole = self._centres[piece] + np.array([-t[1], t[0]]) / w
        return listed(np.array([pole]))


def _triangle(rows: Array, comm: MPI.Comm) -> Array:
    """R (<= n, n) of a QR factorisation of the rows (m, n) of all processes.

    A Gram matrix would square what is small, and lose it.
    """
    own: Array = np.zeros((0, rows.shape[1]))
    for first in range(0, len(rows), _AT_ONCE):
        part = np.vstack([own, rows[first : first + _AT_ONCE]])
        own = np.asarray(np.linalg.qr(part, mode="r"))
    return np.asarray(np.linalg.qr(np.vstack(comm.allgather(own)), mode="r"))

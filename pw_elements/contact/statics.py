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

Array = npt.NDArray[np.float64]

# Squared stiffness of a motion, over what it would be for an arbitrary one: round-off below
_FREE = 1e-16
_AXES = "xyz"


class RigidMotions:
    """Translations and rotations of the body, and free translations of the surfaces."""

    def __init__(self, system: ContactSystem, space: fem.FunctionSpace) -> None:
        self._system = system
        dim = space.mesh.geometry.dim
        owned = space.dofmap.index_map.size_local
        x = space.tabulate_dof_coordinates()[:owned, :dim]
        comm = system.comm
        count = comm.allreduce(owned, MPI.SUM)
        self._centre = np.array([comm.allreduce(x[:, k].sum(), MPI.SUM) for k in range(dim)])
        self._centre /= count
        spread = comm.allreduce(((x - self._centre) ** 2).sum(), MPI.SUM)
        self._length = float(np.sqrt(spread / count))
        self._planes = list(combinations(range(dim), 2))
        modes = self._modes(x)
        self._at_points = self._motions(modes.reshape(owned * dim, modes.shape[2]))
        self._held = self._gram_of_supports(modes.reshape(owned * dim, modes.shape[2]))

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
        rows = np.einsum("nab,nbm->nam", constraints, relative).reshape(m * dim, relative.shape[2])
        gram = np.ascontiguousarray(rows.T @ rows)
        system.comm.Allreduce(MPI.IN_PLACE, gram, MPI.SUM)
        gram[:bodies, :bodies] += self._held
        values, vectors = np.linalg.eigh(gram)
        return [self._name(vector) for vector in vectors[:, values < _FREE * len(gram)].T]

    def _modes(self, x: Array) -> Array:
        """Translations and rotations (n, dim, modes) of size one."""
        dim = x.shape[1]
        modes = np.zeros((len(x), dim, dim + len(self._planes)))
        modes[:, :, :dim] = np.eye(dim)
        s = (x - self._centre) / self._length
        for k, (i, j) in enumerate(self._planes):
            modes[:, i, dim + k] = -s[:, j]
            modes[:, j, dim + k] = s[:, i]
        return modes

    def _motions(self, modes: Array) -> Array:
        """Motions (m, dim, modes) of the contact points in modes (owned dofs, modes)."""
        interface, columns = self._system.interface, []
        for mode in modes.T:
            full = interface.motion.createVecRight()
            full.setArray(mode)
            columns.append(interface.motions(full))
        return np.stack(columns, axis=2)

    def _gram_of_supports(self, modes: Array) -> Array:
        """Squares of what modes do at prescribed displacements, and of their forces K m.

        Forces count over the stiffness; they are there in axisymmetry, say, where only a
        translation along the axis is without strain.
        """
        system = self._system
        column = free_columns(system.reduction.right)
        first = system.stiffness.getOwnershipRange()[0]
        kept = column >= 0
        images = []
        for mode in modes.T:
            vector = system.stiffness.createVecRight()
            local = vector.array
            local[column[kept] - first] = mode[kept]
            del local
            image = system.stiffness.createVecLeft()
            system.stiffness.mult(vector, image)
            images.append(image.array_r.copy())
        largest = system.comm.allreduce(system.scale.max(initial=0.0), MPI.MAX)
        forces, prescribed = np.array(images) / largest, modes[column == -1]
        gram = np.ascontiguousarray(forces @ forces.T + prescribed.T @ prescribed)
        system.comm.Allreduce(MPI.IN_PLACE, gram, MPI.SUM)
        return gram

    def _name(self, vector: Array) -> str:
        dim, bodies = len(self._centre), self._at_points.shape[2]
        turning = vector[dim:bodies]
        if np.abs(turning).max(initial=0.0) > 1e-6:
            if dim == 2:
                return f"rotation about {self._pole(vector)}"
            axis = [turning[self._planes.index(p)] for p in ((1, 2), (0, 2), (0, 1))]
            main = int(np.argmax(np.abs(axis)))
            return f"rotation about an axis along {_AXES[main]}"
        if np.abs(vector[:dim]).max() > 1e-6:
            return f"translation {_AXES[int(np.argmax(np.abs(vector[:dim])))]}"
        pair, axis_of = self._system.free[int(np.argmax(np.abs(vector[bodies:])))]
        return f"translation {_AXES[axis_of]} of the surface of pair {pair}"

    def _pole(self, vector: Array) -> str:
        """The point of the plane at rest: u = t + w (x - centre) turned by a quarter."""
        t, w = vector[:2], vector[2] / self._length
        pole = self._centre + np.array([-t[1], t[0]]) / w
        return listed(np.array([pole]))

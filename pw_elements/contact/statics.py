"""Rigid motions under supports: which ones are free, and what loads and contact do in them."""

from collections.abc import Iterable, Iterator

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.contact.law import ActiveSet, equations
from pw_elements.contact.nodes import free_columns
from pw_elements.contact.rigid import Basis, RigidModes
from pw_elements.contact.system import ContactSystem
from pw_elements.matrices import collect_garbage

Array = npt.NDArray[np.float64]

# Stiffness of a motion, over what it would be for an arbitrary one: as good as none below, and
# no more than round-off where something is to be proved by it
_FREE, _NONE = 1e-8, 1e-11
# Rows that are factorised at once, to save memory
_AT_ONCE = 20_000


class RigidMotions:
    """Rigid motions of the pieces of a supported body and of free surfaces.

    Attributes:
        modes: all of them, supported or not.
    """

    def __init__(self, system: ContactSystem, space: fem.FunctionSpace) -> None:
        self._system = system
        self.modes = RigidModes(space, system.free, system.interface.pairs)
        motion, self._column = system.interface.motion, free_columns(system.reduction.right)
        self._relative = self._at_points(motion * mode for mode in self._full())
        self._held = self._hold_of_supports(transposed=False)
        collect_garbage(motion, system.stiffness)

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
        m, dim, motions = self._relative.shape
        rows = np.einsum("nab,nbm->nam", constraints, self._relative).reshape(m * dim, motions)
        held = np.pad(self._held, ((0, 0), (0, motions - self._held.shape[1])))
        free = _null_space(np.vstack([held, _triangle(rows, self._system.comm)]), _FREE)
        if not len(free):
            return []
        return self.modes.names(self.modes.simplest(free).motions)

    def virtual(self) -> tuple[Basis, Array]:
        """Motions in which no forces but loads and contact's do work, whatever the strains.

        Returns:
            A basis of k of them, each of a single piece or surface, and the motions (m, dim, k)
            relative to surfaces in which forces at the contact points do work.
        """
        held = self._hold_of_supports(transposed=True)
        pieces, motions = len(self.modes.centre), self.modes.number
        basis = []
        for k in range(pieces):
            mine = self.modes.of_piece(k)
            free = _null_space(held[:, mine], _NONE)
            basis.append(np.zeros((len(free), motions)))
            basis[-1][:, mine] = free
        surfaces = np.eye(motions)[held.shape[1] :]
        chosen = self.modes.simplest(np.concatenate([*basis, surfaces]))
        return chosen, self._at_points(self._works()) @ chosen.motions.T

    def power(self, load: PETSc.Vec, totals: Array) -> tuple[Array, Array]:
        """What reduced loads and forces on free surfaces do in each mode, and its round-off.

        Returns:
            Work (modes,), and the sum (modes,) of the magnitudes of its parts.
        """
        work, size = np.zeros((2, self.modes.number))
        magnitude = load.copy()
        magnitude.abs()
        for k, mode in enumerate(self._reduced()):
            work[k] = load.dot(mode)
            mode.abs()
            size[k] = magnitude.dot(mode)
        work[len(work) - len(totals) :] = totals
        size[len(work) - len(totals) :] = np.abs(totals)
        return work, size

    def _full(self) -> Iterator[PETSc.Vec]:
        """Displacements (n,) of the pieces' modes."""
        for mode in self.modes.displacements():
            vector = self._system.interface.motion.createVecRight()
            vector.setArray(self._system.interface.field.spread(mode))
            yield vector

    def _reduced(self) -> Iterator[PETSc.Vec]:
        """The same, where they are not prescribed, under the reduction."""
        stiffness, kept = self._system.stiffness, self._column >= 0
        field = self._system.interface.field
        own = self._column[kept] - stiffness.getOwnershipRange()[0]
        for mode in self.modes.displacements():
            vector = stiffness.createVecRight()
            values = np.zeros(vector.getLocalSize())
            values[own] = field.spread(mode)[kept]
            vector.setArray(values)
            yield vector

    def _works(self) -> Iterator[PETSc.Vec]:
        """Motions (points dim,) in which contact forces do work, in the pieces' modes."""
        force = self._system.interface.force
        for mode in self._full():
            work = force.createVecRight()
            force.multTranspose(mode, work)
            yield work

    def _at_points(self, motions: Iterable[PETSc.Vec]) -> Array:
        """Of the pieces' modes (points dim,) and the surfaces': (m, dim, modes), relative."""
        interface, free = self._system.interface, self.modes.free
        m, dim = interface.position.shape
        relative = np.zeros((m, dim, self.modes.number))
        for k, motion in enumerate(motions):
            relative[..., k] = motion.array_r.reshape(m, dim)
        for k, (pair, axis) in enumerate(free, start=self.modes.of_pieces):
            relative[interface.pair == pair, axis, k] = -1.0
        return relative

    def _hold_of_supports(self, transposed: bool) -> Array:
        """What pieces' modes do at prescribed displacements, and their forces, by `_triangle`.

        Forces K m count over the stiffness. They are there in axisymmetry, say, where only a
        translation along the axis is without strain. K^T m tells of which modes no state of
        strain changes the balance of forces; where it is unsymmetric, they may be fewer.
        """
        system = self._system
        largest = system.comm.allreduce(system.scale.max(initial=0.0), MPI.MAX)
        image = system.stiffness.createVecLeft()
        forces = np.empty((image.getLocalSize(), self.modes.of_pieces))
        for k, mode in enumerate(self._reduced()):
            if transposed:
                system.stiffness.multTranspose(mode, image)
            else:
                system.stiffness.mult(mode, image)
            forces[:, k] = image.array_r / largest
        held, field = self._column == -1, system.interface.field
        prescribed = [field.spread(mode)[held] for mode in self.modes.displacements()]
        return _triangle(np.stack(prescribed, axis=1), system.comm, forces)


def _null_space(rows: Array, tolerance: float) -> Array:
    """Orthonormal vectors (k, n) that rows (m, n) of unit size take to nothing."""
    n = rows.shape[1]
    _, values, vectors = np.linalg.svd(np.vstack([rows, np.zeros((n, n))]))
    return np.asarray(vectors[values < tolerance * np.sqrt(n)])


def _triangle(rows: Array, comm: MPI.Comm, *more: Array) -> Array:
    """R (<= n, n) of a QR factorisation of the rows (m, n) of all processes, and of more of them.

    A Gram matrix would square what is small, and lose it.
    """
    own: Array = np.zeros((0, rows.shape[1]))
    for each in (rows, *more):
        for first in range(0, len(each), _AT_ONCE):
            part = np.vstack([own, each[first : first + _AT_ONCE]])
            own = np.asarray(np.linalg.qr(part, mode="r"))
    return np.asarray(np.linalg.qr(np.vstack(comm.allgather(own)), mode="r"))

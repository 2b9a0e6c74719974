"""E K + C as a product with K alone, and a preconditioner of it bordered by free translations."""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.contact.interface import ROUND_OFF, Interface
from pw_elements.contact.state import Free

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class NodePoints:
    """The contact points (m of this process) where each of them is a node.

    Args:
        node: (m,), local number.
        own: (m, dim), local number of each point's own equations, -1 where there is none.
        flexible: (m, dim), what makes forces of equations.
        scale: (m,), c of the law.
        moved: (m, dim), number of the free translation that moves a component, -1 if none does.
        translations: number of the free translations.
        round_off: force that may be nothing but round-off of coordinates, at all points together.
    """

    node: Indices
    own: Indices
    flexible: Array
    scale: Array
    moved: Indices
    translations: int
    round_off: float

    @classmethod
    def of(
        cls, interface: Interface, own: Indices, flexible: Array, scale: Array, free: Free
    ) -> "NodePoints":
        """Those of an interface whose every point is a node that faces a rigid surface."""
        dim = own.shape[1]
        first = interface.motion.getOwnershipRangeColumn()[0]
        node = (interface.motion.getValuesCSR()[1][::dim] - first) // dim
        moved = np.full(own.shape, -1, dtype=np.int64)
        for k, (pair, axis) in enumerate(free):
            moved[interface.pair == pair, axis] = k
        lost = ROUND_OFF * np.linalg.norm(scale[:, None] * interface.position)
        round_off = interface.comm.allreduce(float(lost), MPI.SUM)
        return cls(node.astype(np.int64), own, flexible, scale, moved, len(free), round_off)

    def read(self, equations: Array) -> Array:
        """Forces (m, dim); 0 where the law is not stated."""
        return np.where(self.own >= 0, equations[self.own] * self.flexible, 0.0)


class Unassembled:
    """E K + C with its border, for `PETSc.Mat.createPython`.

    Attributes:
        force: (m, dim), K a at the contact points, of the last product.
    """

    def __init__(self, K: PETSc.Mat, free: npt.NDArray[np.bool_], points: NodePoints) -> None:
        self._K, self._points = K, points
        self._prescribed: Indices = np.flatnonzero(~free)
        self._stated = points.own >= 0
        self._comm: MPI.Comm = K.comm.tompi4py()
        some = self._comm.allreduce(len(self._prescribed), MPI.SUM) > 0
        bordered = points.translations > 0
        self._motion = K.createVecRight() if some or bordered else None
        self._image = K.createVecLeft() if bordered else None
        self.force: Array = np.zeros(points.own.shape)

    def state(self, E: Array, C: Array, D: Array) -> None:
        """Takes over the combinations (m, dim, dim) of an active set."""
        self._E, self._C, self._D = E, C, D

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        points, n = self._points, self._K.getLocalSize()[1]
        given, motion = x.array_r, x
        if self._motion is not None:
            motion = self._motion
            motion.array[:] = given[:n]
            motion.array[self._prescribed] = 0.0
        moved = motion.array_r.reshape(-1, points.own.shape[1])[points.node]
        image = y if self._image is None else self._image
        self._K.mult(motion, image)
        self.force = force = points.read(image.array_r)
        law = np.einsum("nab,nb->na", self._E, force) + np.einsum("nab,nb->na", self._C, moved)
        totals = np.zeros(0)
        if points.translations:
            last = self._comm.size - 1
            U = np.append(self._comm.bcast(given[n:].copy(), last), 0.0)
            law -= np.einsum("nab,nb->na", self._D, U[points.moved])
            totals = np.zeros(points.translations)
            some = points.moved >= 0
            np.add.at(totals, points.moved[some], force[some])
            self._comm.Allreduce(MPI.IN_PLACE, totals, MPI.SUM)
        result = y.array
        if image is not y:
            result[:n] = image.array_r
            result[n:] = totals[: len(given) - n]
        result[self._prescribed] = given[self._prescribed]
        result[points.own[self._stated]] = law[self._stated]


class Bordered:
    """Preconditioner of the bordered system from one without border, for a `PETSc.PC` in Python."""

    def __init__(self, inner: PETSc.PC, sums: list[Array], comm: MPI.Comm, like: PETSc.Vec) -> None:
        self._inner, self._sums, self._comm = inner, sums, comm
        self._x, self._y = like.duplicate(), like.duplicate()
        self._images: list[Array] = []
        self._schur = np.eye(len(sums))

    def update(self, columns: list[Array]) -> None:
        """Takes over the columns (n,) of the free translations."""
        self._images = [self._solved(column) for column in columns]
        self._schur = -np.array([self._summed(image) for image in self._images]).T

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        given, n = x.array_r, self._x.getLocalSize()
        balance = self._comm.bcast(given[n:].copy(), self._comm.size - 1)
        result = self._solved(given[:n])
        U = np.linalg.lstsq(self._schur, balance - self._summed(result))[0]
        for moved, image in zip(U, self._images, strict=True):
            result -= moved * image
        y.array[:n] = result
        y.array[n:] = U[: len(given) - n]

    def _solved(self, right: Array) -> Array:
        self._x.array[:] = right
        self._inner.apply(self._x, self._y)
        return np.array(self._y.array_r)

    def _summed(self, values: Array) -> Array:
        totals = np.array([total @ values for total in self._sums])
        self._comm.Allreduce(MPI.IN_PLACE, totals, MPI.SUM)
        return totals

"""E K + C as a product with K alone, and a preconditioner of it bordered by free translations."""

from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.contact.interface import ROUND_OFF, Interface
from pw_elements.contact.state import Free
from pw_elements.hybrid import SubSpace
from pw_elements.ties import Ties

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class NodePoints:
    """The contact points (m of this process), each of which is a node or has the force of one.

    Args:
        node: (m,), local number.
        motion: G, (m dim, n).
        spread: what forces do to the equations of other nodes, (m dim, n); None if nothing.
        own: (m, dim), local number of each point's own equations, -1 where there is none.
        flexible: (m, dim), what makes forces of equations.
        scale: (m,), c of the law.
        moved: (m, dim), number of the free translation that moves a component, -1 if none does.
        translations: number of the free translations.
        round_off: force that may be nothing but round-off of coordinates, at all points together.
    """

    node: Indices
    motion: PETSc.Mat
    spread: PETSc.Mat | None
    own: Indices
    flexible: Array
    scale: Array
    moved: Indices
    translations: int
    round_off: float

    @classmethod
    def of(
        cls,
        interface: Interface,
        spread: PETSc.Mat | None,
        own: Indices,
        flexible: Array,
        scale: Array,
        free: Free,
    ) -> "NodePoints":
        """Those of an interface."""
        node = interface.node - interface.field.space.dofmap.index_map.local_range[0]
        moved = np.full(own.shape, -1, dtype=np.int64)
        for k, (pair, axis) in enumerate(free):
            moved[interface.pair == pair, axis] = k
        lost = ROUND_OFF * np.linalg.norm(scale[:, None] * interface.position)
        round_off = interface.comm.allreduce(float(lost), MPI.SUM)
        motion = interface.motion
        return cls(node, motion, spread, own, flexible, scale, moved, len(free), round_off)

    def of_displacements(self, field: SubSpace) -> "NodePoints":
        """The same points where displacements are all unknowns; no surface is free there."""
        number = np.full(field.rows[0] + 1, -1, dtype=np.int64)  # -1 stays what it is
        number[field.owned.ravel()] = np.arange(field.owned.size)
        columns = field.selection().transpose(PETSc.Mat())
        spread = None if self.spread is None else self.spread.matMult(columns)
        motion = self.motion.matMult(columns)
        return replace(self, motion=motion, spread=spread, own=number[self.own], translations=0)

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
        self._moved = points.motion.createVecLeft()
        self._carried = None if points.spread is None else K.createVecLeft()
        self.force: Array = np.zeros(points.own.shape)

    def state(self, E: Array, C: Array, D: Array) -> None:
        """Takes over the combinations (m, dim, dim) of an active set."""
        self._E, self._C, self._D = E, C, D

    def of_motion(self, x: PETSc.Vec) -> Array:
        """C G a - D U, (m, dim): what the law says of a motion, without its forces."""
        return self._of_motion(x, self._unsupported(x))

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        points, n = self._points, self._K.getLocalSize()[1]
        given, motion = x.array_r, self._unsupported(x)
        law = self._of_motion(x, motion)
        image = y if self._image is None else self._image
        self._K.mult(motion, image)
        self.force = force = points.read(image.array_r)
        if points.spread is not None:
            self._moved.array[:] = force.ravel()
            points.spread.multTranspose(self._moved, self._carried)
            image.axpy(1.0, self._carried)
        law += np.einsum("nab,nb->na", self._E, force)
        totals = np.zeros(0)
        if points.translations:
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

    def _unsupported(self, x: PETSc.Vec) -> PETSc.Vec:
        """The motion a of x, zero where it is prescribed."""
        if self._motion is None:
            return x
        self._motion.array[:] = x.array_r[: self._K.getLocalSize()[1]]
        self._motion.array[self._prescribed] = 0.0
        return self._motion

    def _of_motion(self, x: PETSc.Vec, motion: PETSc.Vec) -> Array:
        points = self._points
        points.motion.mult(motion, self._moved)
        moved = self._moved.array_r.reshape(points.own.shape)
        law: Array = np.einsum("nab,nb->na", self._C, moved)
        if points.translations:
            n, last = self._K.getLocalSize()[1], self._comm.size - 1
            U = np.append(self._comm.bcast(x.array_r[n:].copy(), last), 0.0)
            law -= np.einsum("nab,nb->na", self._D, U[points.moved])
        return law


class Tied:
    """Preconditioner of E K + C from one of bodies that are tied, for a `PETSc.PC` in Python.

    The ties move a node as weighted means of its own side's weights would, were these lumped; what
    is left of its stated gap is taken out once more.
    """

    def __init__(self, inner: PETSc.PC, ties: Ties, points: NodePoints) -> None:
        self._inner, self._ties, self._points = inner, ties, points
        self._motion, self._nodal = ties.opposite.createVecLeft(), ties.opposite.createVecRight()
        self._rest = self._nodal.duplicate()
        self._held: Array = np.zeros((0, 1, 1))

    def hold(self, held: Array) -> None:
        """Takes over projectors (m, dim, dim)."""
        self._held = held

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x. Forces that are stated act on the opposite nodes, too."""
        points, opposite = self._points, self._ties.opposite
        stated = np.where(points.own >= 0, x.array_r[points.own], 0.0)
        fixed = np.einsum("nij,nj->ni", self._held, stated)
        self._motion.array[:] = (stated - fixed).ravel()
        opposite.multTranspose(self._motion, self._nodal)
        self._rest.waxpy(-1.0, self._nodal, x)
        self._inner.apply(self._rest, y)
        self._ties.follow(y)
        points.motion.mult(y, self._motion)
        wrong = fixed / points.scale[:, None] - self._motion.array_r.reshape(fixed.shape)
        nodal = y.array.reshape(-1, fixed.shape[1])
        nodal[points.node] += np.einsum("nij,nj->ni", self._held, wrong)


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

"""The matrix E K + C of one active set as a product with vectors, never assembled.

With y = K a, the rows of the contact points become E r + C G a - D U with r read from y; all
others stay, but those of opposite nodes, which r acts on, too. It assumes that each equation holds
the force of one component of one point.
"""

from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface import DEFORMABLE, ROUND_OFF, Interface
from pw_elements.contact.model import FreeMotions
from pw_elements.contact.nodes import LinearisedLaw
from pw_elements.spaces import SubSpace


@dataclass(frozen=True)
class NodePoints:
    """The contact points (m of this process), each of which is a node or has the force of one."""

    node: Indices  # (m,), local number
    motion: PETSc.Mat  # G, (m dim, n)
    force: PETSc.Mat  # H^T, (m dim, n), under the supports
    spread: PETSc.Mat | None  # what forces do to the equations of other nodes, (m dim, n)
    own: Indices  # (m, dim), local number of each point's own equations, -1 where there is none
    flexible: Array  # (m, dim), what makes forces of equations
    scale: Array  # (m,), c of the law
    moved: Indices  # (m, dim), number of the free translation that moves it, or -1
    translations: int
    facing: Mask  # (m,), whether it may hold its body at all
    round_off: float  # force that may be nothing but round-off, at all points together

    @classmethod
    def of(
        cls,
        interface: Interface,
        force: PETSc.Mat,
        spread: PETSc.Mat | None,
        own: Indices,
        flexible: Array,
        scale: Array,
        free: FreeMotions,
    ) -> "NodePoints":
        node = interface.node - interface.field.space.dofmap.index_map.local_range[0]
        moved = np.full(own.shape, -1, dtype=np.int64)
        for k, (pair, axis) in enumerate(free):
            moved[interface.pair == pair, axis] = k
        lost = ROUND_OFF * np.linalg.norm(scale[:, None] * interface.position)
        round_off = interface.comm.allreduce(float(lost), MPI.SUM)
        indptr, _, value = force.getValuesCSR()
        used = np.bincount(np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))[value != 0])
        several = np.pad(used, (0, own.size - len(used))).reshape(own.shape).max(axis=1) > 1
        facing = several | (interface.faced != DEFORMABLE)
        moves = interface.motion, force, spread
        return cls(node, *moves, own, flexible, scale, moved, len(free), facing, round_off)

    def of_displacements(self, field: SubSpace) -> "NodePoints":
        """The same points where displacements are all unknowns; no surface is free there."""
        number = np.full(field.full_sizes[0] + 1, -1, dtype=np.int64)  # -1 stays what it is
        number[field.owned_unknowns.ravel()] = np.arange(field.owned_unknowns.size)
        columns = field.selection_matrix().transpose(PETSc.Mat())
        motion, force = (each.matMult(columns) for each in (self.motion, self.force))
        return replace(self, motion=motion, force=force, own=number[self.own], translations=0)

    def read(self, equations: Array) -> Array:
        return np.where(self.own >= 0, equations[self.own] * self.flexible, 0.0)


class Unassembled:
    """E K + C with its border, for `PETSc.Mat.createPython`; it keeps K a (m, dim) as `force`."""

    def __init__(self, K: PETSc.Mat, free: Mask, points: NodePoints) -> None:
        self._K, self._points = K, points
        self._prescribed: Indices = np.flatnonzero(~free)
        self._stated = points.own >= 0
        self._comm: MPI.Comm = K.comm.tompi4py()
        self._motion, self._image = K.createVecs()
        self._moved = points.motion.createVecLeft()
        self._carried = None if points.spread is None else K.createVecLeft()
        self.force: Array = np.zeros(points.own.shape)
        self.springs: Array = np.zeros(points.translations)  # of the free translations

    def state(self, law: LinearisedLaw) -> None:
        self._E, self._C, self._D = law.E, law.C, law.D

    def of_motion(self, x: PETSc.Vec) -> Array:
        """C G a - D U, (m, dim): what the law says of a motion, without its forces."""
        points, motion = self._points, self._motion
        motion.array[:] = x.array_r[: self._K.getLocalSize()[1]]
        motion.array[self._prescribed] = 0.0
        points.motion.mult(motion, self._moved)
        moved = self._moved.array_r.reshape(points.own.shape)
        law: Array = np.einsum("nab,nb->na", self._C, moved)
        if points.translations:
            n, last = self._K.getLocalSize()[1], self._comm.size - 1
            U = np.append(self._comm.bcast(x.array_r[n:].copy(), last), 0.0)
            law -= np.einsum("nab,nb->na", self._D, U[points.moved])
        return law

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        points, n = self._points, self._K.getLocalSize()[1]
        given, law, image = x.array_r, self.of_motion(x), self._image
        self._K.mult(self._motion, image)
        self.force = force = points.read(image.array_r)
        if points.spread is not None:
            self._moved.array[:] = force.ravel()
            points.spread.multTranspose(self._moved, self._carried)
            image.axpy(1.0, self._carried)
        law += np.einsum("nab,nb->na", self._E, force)
        totals = np.zeros(points.translations)
        if points.translations:
            some = points.moved >= 0
            np.add.at(totals, points.moved[some], force[some])
            self._comm.Allreduce(MPI.IN_PLACE, totals, MPI.SUM)
            totals += self.springs * self._comm.bcast(given[n:].copy(), self._comm.size - 1)
        result = y.array
        result[:n] = image.array_r
        result[n:] = totals[: len(given) - n]
        result[self._prescribed] = given[self._prescribed]
        result[points.own[self._stated]] = law[self._stated]


def stated_mean(values: Array, stated: Mask) -> Array:
    """Mean (m,) of values (m, dim) where the law is stated; 1 where it is not at all."""
    count, total = np.sum(stated, axis=1), np.sum(values * stated, axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), 1.0)

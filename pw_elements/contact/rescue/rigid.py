"""Rigid motions under supports: which ones are free, and what loads and contact do in them.

Modes are motions of the connected pieces of a body and of surfaces; there are words for each.
"""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem
from scipy.linalg import block_diag

from pw_elements.arrays import Array, Indices
from pw_elements.checks import listed
from pw_elements.contact.interface import free_columns
from pw_elements.contact.iteration import ContactSystem, LeftFree, local_rows, null_space
from pw_elements.contact.model import Free
from pw_elements.solvers import Pieces, collect_garbage

_AXES = "xyz"
# Part of a motion, over its largest one, that is none
NOTHING = 1e-6

# Stiffness of a motion, over what it would be for an arbitrary one, that is no more than round-off:
# something is to be proved by it
_ZERO_STIFFNESS = 1e-11


@dataclass(frozen=True)
class Basis:
    """Independent rigid motions (k, modes); each has a pivot (k,), a mode that no other has."""

    motions: Array
    pivot: Indices


class RigidModes:
    """Translations and rotations of each connected piece, and free translations of surfaces.

    Motions are vectors of all modes: those of one piece after another, see `Pieces`, then the
    surfaces' translations.
    """

    def __init__(self, pieces: Pieces, free: Free, pairs: int) -> None:
        self.centre, self.length = pieces.centre, pieces.length
        self.free, self._pairs = free, pairs
        self.each = pieces.motion.shape[2]
        self.of_pieces = len(pieces.centre) * self.each
        self.number = self.of_pieces + len(free)

    def parts(self, motion: Array) -> tuple[Array, Array, Array]:
        """Translations (pieces, dim), rotations (pieces, 1 or 3), and surfaces' (pairs, dim).

        Rotations are over the length; in space they are vectors along the axis.
        """
        dim = self.centre.shape[1]
        pieces = motion[: self.of_pieces].reshape(len(self.centre), -1)
        turning = pieces[:, dim:]
        if dim == 3:  # planes xy, xz, yz
            turning = turning[:, ::-1] * [1.0, -1.0, 1.0]
        surfaces = np.zeros((self._pairs, dim))
        for at, value in zip(self.free, motion[self.of_pieces :], strict=True):
            surfaces[at] = value
        return pieces[:, :dim], turning, surfaces

    def simplest(self, motions: Array) -> Basis:
        """Another basis of the motions (k, modes), the one that takes the fewest words.

        Each of its motions has a mode that none of the others has, a rotation if possible. So
        what turns does not also move along what is free anyhow, and translations are along axes.
        """
        turns = np.arange(self.of_pieces) % self.each >= self.centre.shape[1]
        rank = np.concatenate([np.where(turns, 0, 1), np.full(len(self.free), 2)])
        order = np.argsort(rank, kind="stable")
        rows, pivot = reduced_echelon(motions[:, order])
        return Basis(rows[:, np.argsort(order)], order[pivot])

    def names(self, motions: Array) -> list[str]:
        """Names what moves how in each of the motions (k, modes).

        Rotations of a piece are about a point at rest in all of them, if there is one.
        """
        words = []
        for motion in motions:
            how: dict[str, list[str]] = {}
            for who, movement in self.movers(motion, motions):
                how.setdefault(movement, []).append(who)
            if list(how.values()) == [["the body"]]:
                words.append(next(iter(how)))
            else:
                parts = [f"{what} of {' and '.join(who)}" for what, who in how.items()]
                words.append(" with ".join(parts))
        return words

    def movers(self, motion: Array, motions: Array) -> list[tuple[str, str]]:
        """Names of bodies and surfaces that move in one of the motions, and how, in words."""
        translation, turning, surface = self.parts(motion)
        nothing, words = NOTHING * np.abs(motion).max(), []
        for k in range(len(translation)):
            if np.abs(np.append(translation[k], turning[k])).max() > nothing:
                around = listed(self.centre[k : k + 1])
                who = "the body" + (f" around {around}" if len(self.centre) > 1 else "")
                if np.abs(turning[k]).max(initial=0.0) > nothing:
                    words.append((who, self._rotation(k, motion, motions)))
                else:
                    words.append((who, f"translation {direction(translation[k])}"))
        for k in range(len(surface)):
            if np.abs(surface[k]).max() > nothing:
                words.append((f"the surface of pair {k}", f"translation {direction(surface[k])}"))
        return words

    def _rotation(self, k: int, motion: Array, motions: Array) -> str:
        moved, turned = (part[0] for part in self._in_space(k, motion[None]))
        pole, rest = self._pole(k, motions)
        if rest > NOTHING:
            pole, _ = self._pole(k, motion[None])
        if len(pole) == 2:
            return f"rotation about {listed(pole[None])}"
        axis = direction(turned * np.sign(turned[np.argmax(np.abs(turned))]))
        along = abs(moved @ turned) > NOTHING * (turned @ turned)
        return (
            f"rotation about the axis along {axis} through {listed(pole[None])}"
            f"{' with a translation along it' if along else ''}"
        )

    def _pole(self, k: int, motions: Array) -> tuple[Array, float]:
        """The point (dim,) next to a piece's centre that moves least, and how fast it does."""
        moved, turned = self._in_space(k, motions)
        turns = np.abs(turned).max(axis=1) > NOTHING * np.abs(motions).max(axis=1)
        moved, turned = moved[turns], turned[turns]
        arms = np.cross(turned[:, None], np.eye(3)).transpose(0, 2, 1).reshape(-1, 3)
        shift = np.linalg.lstsq(arms, -moved.ravel(), rcond=NOTHING)[0]
        speed = float(np.abs(arms @ shift + moved.ravel()).max())
        return self.centre[k] + self.length[k] * shift[: self.centre.shape[1]], speed

    def _in_space(self, k: int, motions: Array) -> tuple[Array, Array]:
        """Translations and rotations (motions, 3) of a piece, the plane being one in space."""
        parts = [self.parts(motion) for motion in motions]
        moved = np.array([translation[k] for translation, _, _ in parts])
        turned = np.array([turning[k] for _, turning, _ in parts])
        more = ((0, 0), (0, 3 - moved.shape[1]))
        return np.pad(moved, more), np.pad(turned, ((0, 0), (3 - turned.shape[1], 0)))


def reduced_echelon(rows: Array) -> tuple[Array, Indices]:
    """Reduced echelon form of independent rows (k, n), and its pivots (k,)."""
    rows = rows.copy()
    pivot: list[int] = []
    for column in range(rows.shape[1]):
        done = len(pivot)
        if done == len(rows):
            break
        best = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[best, column]) <= NOTHING * np.abs(rows[best]).max():
            rows[done:, column] = 0.0
            continue
        rows[[done, best]] = rows[[best, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= rows[others, column, None] * rows[done]
        pivot.append(column)
    return rows, np.array(pivot, dtype=np.int64)


def direction(vector: Array) -> str:
    """The axis along a vector (dim,), with a sign, or else its unit vector."""
    vector = vector / np.linalg.norm(vector)
    main = int(np.argmax(np.abs(vector)))
    if np.linalg.norm(np.delete(vector, main)) <= NOTHING:
        return ("-" if vector[main] < 0 else "") + _AXES[main]
    return listed(vector[None])


class RigidMotions:
    """Rigid motions of the pieces of a supported body and of free surfaces."""

    def __init__(self, system: ContactSystem, space: fem.FunctionSpace) -> None:
        self._system, self._pieces = system, Pieces.of(space)
        interface, modes = system.interface, self._pieces.motion
        self.modes = RigidModes(self._pieces, system.free, interface.pairs)
        # the unknown of each node's component (owned nodes, dim), and its reduced one here if any
        own, dofs = interface.field.owned, free_columns(system.reduction.right)
        self._prescribed, self._kept = dofs[own] == -1, dofs[own] >= 0
        self._row = dofs[own] - system.stiffness.getOwnershipRange()[0]
        # displacements (n, pieces' modes)
        motion, each = interface.motion, self.modes.each
        columns = self._pieces.number[: len(own), None, None] * each + np.arange(each)
        columns = np.broadcast_to(columns, modes.shape).ravel()
        entries = modes.ravel(), (np.repeat(own.ravel(), each), columns)
        rows = sp.csr_matrix(entries, (motion.getLocalSize()[1], self.modes.of_pieces))
        csr = rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data
        sizes = motion.getSizes()[1], (PETSc.DECIDE, self.modes.of_pieces)
        self._full = PETSc.Mat().createAIJ(sizes, csr=csr, comm=system.comm)
        relative = self._at_points(motion.matMult(self._full))
        held = block_diag(*self._hold_of_supports(transposed=False))
        self.left_free = LeftFree(relative, held, system.comm, self._names)
        collect_garbage(motion, system.stiffness)

    def _names(self, motions: Array) -> list[str]:
        return self.modes.names(self.modes.simplest(motions).motions)

    def virtual(self) -> tuple[Basis, Array]:
        """Motions in which no forces but loads and contact's do work, whatever the strains.

        A basis of k of them, each of a single piece or surface, and the motions (m, dim, k)
        relative to surfaces in which forces at the contact points do work.
        """
        held = self._hold_of_supports(transposed=True)
        free = [null_space(triangle, _ZERO_STIFFNESS) for triangle in held]
        surfaces = np.eye(len(self.modes.free))
        chosen = self.modes.simplest(block_diag(*free, surfaces))
        works = self._system.interface.force.transposeMatMult(self._full)
        return chosen, self._at_points(works) @ chosen.motions.T

    def power(self, load: PETSc.Vec, totals: Array) -> tuple[Array, Array]:
        """Work (modes,) of reduced loads and forces on free surfaces, and its parts' magnitudes."""
        pieces = self._pieces
        force, sums = np.zeros(self._kept.shape), np.zeros((2, len(pieces.centre), self.modes.each))
        force[self._kept] = load.array_r[self._row[self._kept]]
        parts = force[:, :, None] * pieces.motion
        for total, part in zip(sums, (parts.sum(axis=1), np.abs(parts).sum(axis=1)), strict=True):
            np.add.at(total, pieces.number[: len(part)], part)
        self._system.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        work, size = sums.reshape(2, -1)
        return np.append(work, totals), np.append(size, np.abs(totals))

    def _at_points(self, motions: PETSc.Mat) -> Array:
        """Relative motions (m, dim, modes) of the points, from the pieces' (points dim, modes)."""
        interface, free = self._system.interface, self.modes.free
        m, dim = interface.position.shape
        relative = np.zeros((m, dim, self.modes.number))
        of_pieces = local_rows(motions, 0).toarray()
        relative[..., : self.modes.of_pieces] = of_pieces.reshape(m, dim, self.modes.of_pieces)
        for k, (pair, axis) in enumerate(free, start=self.modes.of_pieces):
            relative[interface.pair == pair, axis, k] = -1.0
        return relative

    def _hold_of_supports(self, transposed: bool) -> Array:
        """Displacements of pieces' modes at supports and the forces they cause, by `triangles`.

        Forces K m count over the stiffness. They are there in axisymmetry, say, where only a
        translation along the axis is without strain. K^T m tells of which modes no state of
        strain changes the balance of forces; where it is unsymmetric, they may be fewer.
        """
        system, kept, modes = self._system, self._kept, self._pieces.motion
        largest = system.comm.allreduce(system.scale.max(initial=0.0), MPI.MAX)
        motion, image = system.stiffness.createVecs()
        multiply = system.stiffness.multTranspose if transposed else system.stiffness.mult
        rows = np.where(self._prescribed[:, :, None], modes, 0.0)
        for k in range(self.modes.each):  # of all pieces at once, which K does not couple
            motion.array[self._row[kept]] = modes[:, :, k][kept]
            multiply(motion, image)
            rows[kept, k] = image.array_r[self._row[kept]] / largest
        return self._pieces.triangles(rows)

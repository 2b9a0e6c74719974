"""Rigid motions under supports: which ones are free, and what loads and contact do in them.

Modes are motions of the connected pieces of a body and of surfaces; there are words for each.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.arrays import Array, Indices
from pw_elements.checks import listed
from pw_elements.contact.interface import free_columns
from pw_elements.contact.iteration import ContactSystem, LeftFree, null_space, triangle
from pw_elements.contact.model import Free
from pw_elements.solvers import collect_garbage, connected_pieces

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

    Motions are vectors of all modes: piece after piece its translations and its rotations about its
    centre (over its length, so that displacements are of the translations' size), then the
    surfaces' translations. Centres (pieces, dim) are means of a piece's nodes, by which pieces are
    sorted; the length (pieces,) is the radius of gyration of these nodes.
    """

    def __init__(self, space: fem.FunctionSpace, free: Free, pairs: int) -> None:
        dim = space.mesh.geometry.dim
        owned = space.dofmap.index_map.size_local
        x = space.tabulate_dof_coordinates()[:owned, :dim]
        piece, count = connected_pieces(space)
        piece = piece[:owned]
        self.free, self._pairs = free, pairs
        self._planes = list(combinations(range(dim), 2))
        sums = np.zeros((count, dim + 1))
        np.add.at(sums, piece, np.column_stack([x, np.ones(owned)]))
        space.mesh.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        centre, nodes = sums[:, :dim] / sums[:, dim:], sums[:, dim]
        squares = np.zeros(count)
        np.add.at(squares, piece, np.sum((x - centre[piece]) ** 2, axis=1))
        space.mesh.comm.Allreduce(MPI.IN_PLACE, squares, MPI.SUM)
        length = np.sqrt(squares / nodes)
        order = np.lexsort(np.round(np.column_stack([length, centre[:, ::-1]]) / length.max(), 9).T)
        self.centre, self.length = centre[order], length[order]
        self._x, self._piece = x, np.argsort(order)[piece]
        self._each = dim + len(self._planes)

    @property
    def of_pieces(self) -> int:
        return len(self.centre) * self._each

    @property
    def number(self) -> int:
        return self.of_pieces + len(self.free)

    def of_piece(self, k: int) -> slice:
        return slice(k * self._each, (k + 1) * self._each)

    def displacements(self) -> Iterator[Array]:
        """Displacements (owned dofs,) of this process' nodes in each of the pieces' modes."""
        for k in range(len(self.centre)):
            mine = self._piece == k
            s = (self._x[mine] - self.centre[k]) / self.length[k]
            for axis in range(self._x.shape[1]):
                mode = np.zeros_like(self._x)
                mode[mine, axis] = 1.0
                yield mode.ravel()
            for i, j in self._planes:
                mode = np.zeros_like(self._x)
                mode[mine, i], mode[mine, j] = -s[:, j], s[:, i]
                yield mode.ravel()

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
        turns = np.arange(self.of_pieces) % self._each >= self.centre.shape[1]
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
        self._system = system
        self.modes = RigidModes(space, system.free, system.interface.pairs)
        motion, self._column = system.interface.motion, free_columns(system.reduction.right)
        relative = self._at_points(motion * mode for mode in self._full())
        held = self._hold_of_supports(transposed=False)
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
        pieces, motions = len(self.modes.centre), self.modes.number
        basis = []
        for k in range(pieces):
            mine = self.modes.of_piece(k)
            free = null_space(held[:, mine], _ZERO_STIFFNESS)
            basis.append(np.zeros((len(free), motions)))
            basis[-1][:, mine] = free
        surfaces = np.eye(motions)[held.shape[1] :]
        chosen = self.modes.simplest(np.concatenate([*basis, surfaces]))
        return chosen, self._at_points(self._works()) @ chosen.motions.T

    def power(self, load: PETSc.Vec, totals: Array) -> tuple[Array, Array]:
        """Work (modes,) of reduced loads and forces on free surfaces, and its parts' magnitudes."""
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
        """Reduced displacements of the pieces' modes, where they are not prescribed."""
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
        """Relative motions (m, dim, modes) of the points, from the pieces' (points dim,) modes."""
        interface, free = self._system.interface, self.modes.free
        m, dim = interface.position.shape
        relative = np.zeros((m, dim, self.modes.number))
        for k, motion in enumerate(motions):
            relative[..., k] = motion.array_r.reshape(m, dim)
        for k, (pair, axis) in enumerate(free, start=self.modes.of_pieces):
            relative[interface.pair == pair, axis, k] = -1.0
        return relative

    def _hold_of_supports(self, transposed: bool) -> Array:
        """Displacements of pieces' modes at supports and the forces they cause, by `triangle`.

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
        return triangle(np.stack(prescribed, axis=1), system.comm, forces)

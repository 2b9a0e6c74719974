"""Rigid motions under supports: which ones are free, and what loads and contact do in them.

Modes are motions of the connected pieces of a body and of surfaces; there are words for each.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.arrays import Array, Indices
from pw_elements.checks import listed
from pw_elements.contact.interface import free_columns
from pw_elements.contact.iteration import (
    OPEN,
    SLIP,
    STICK,
    ActiveSet,
    Contact,
    ContactSystem,
    border_columns,
    equations,
    local_rows,
    mixed,
)
from pw_elements.contact.model import Free
from pw_elements.solvers import Pieces, destroy, galerkin_product

# Rows (r, k) on some modes (k,)
Block = tuple[Indices, Array]

_AXES = "xyz"
# Part of a motion, over its largest one, that is none
NOTHING = 1e-6

# Stiffness of a motion, over what it would be for an arbitrary one, that is no more than round-off:
# something is to be proved by it
_ZERO_STIFFNESS = 1e-11
# The same, as good as none
_FREE_STIFFNESS = 1e-8
# Pieces and surfaces' motions that are looked at together
_TOGETHER = 20
# Rows that are factorised at once, to save memory
_AT_ONCE = 20_000


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
        self._pieces, self.each = pieces, pieces.motion.shape[2]
        self.of_pieces = len(pieces.centre) * self.each
        self.number = self.of_pieces + len(free)

    @property
    def group(self) -> Indices:
        """The piece (modes,) that moves, or a number of its own for each of the surfaces' modes."""
        pieces = len(self.centre)
        of_piece, surfaces = np.repeat(np.arange(pieces), self.each), np.arange(len(self.free))
        return np.concatenate([of_piece, pieces + surfaces])

    def displacements(self) -> sp.csr_array:
        """Displacements (owned dofs, modes) of this process' nodes in the modes."""
        values = self._pieces.motion
        mode = self._pieces.number[: len(values), None, None] * self.each + np.arange(self.each)
        mode = np.broadcast_to(mode, values.shape)
        known = values != 0
        pointers = np.append(0, np.cumsum(known.sum(axis=2)))
        shape = (values.shape[0] * values.shape[1], self.number)
        return sp.csr_array((values[known], mode[known], pointers), shape)

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


def triangles(rows: sp.csr_array, group: Indices, comm: MPI.Comm) -> list[Block]:
    """R of QR factorisations of all processes' rows (n, modes), one of those on the same groups.

    A Gram matrix would lose what is small.
    """
    rows.eliminate_zeros()
    of = sp.csr_array((np.ones(len(group)), (np.arange(len(group)), group)))
    touched = sp.csr_array((np.ones(rows.nnz), rows.indices, rows.indptr), rows.shape) @ of
    touched.sort_indices()
    touched.data[:] = 1.0
    which = touched @ np.random.default_rng(0).random(touched.shape[1])
    order = np.argsort(which, kind="stable")
    own: list[Block] = []
    for part in np.split(order, np.flatnonzero(np.diff(which[order])) + 1):
        groups = touched[part[:1]].indices
        if not len(groups):
            continue
        modes = np.flatnonzero(np.isin(group, groups))
        triangle = np.zeros((0, len(modes)))
        for first in range(0, len(part), _AT_ONCE):
            some = rows[part[first : first + _AT_ONCE]][:, modes].toarray()
            triangle = np.asarray(np.linalg.qr(np.vstack([triangle, some]), mode="r"))
        own.append((modes, triangle))
    return [block for blocks in comm.allgather(own) for block in blocks]


def null_space(blocks: list[Block], group: Indices, tolerance: float) -> Array:
    """Orthonormal motions (k, modes) that blocks of rows of unit size take to nothing.

    Groups of modes hang together in parts. In large ones those that are held, alone or by others
    that are, go first, one by one: what is left is little, or hangs together in smaller parts.
    """
    at: list[list[int]] = [[*map(int, np.unique(group[modes]))] for modes, _ in blocks]
    touching: list[list[int]] = [[] for _ in range(group.max(initial=-1) + 1)]
    for b, groups in enumerate(at):
        for k in groups:
            touching[k].append(b)

    def parts(free: set[int]) -> Iterator[list[int]]:
        while free:
            part = [free.pop()]
            for k in part:  # which grows
                beside = {j for b in touching[k] for j in at[b]} & free
                free -= beside
                part += beside
            yield part

    def kernel(groups: list[int], chosen: Iterable[int]) -> Array:
        modes, rows = np.flatnonzero(np.isin(group, groups)), []
        for b in chosen:
            rows.append(np.zeros((len(blocks[b][1]), len(group))))
            rows[-1][:, blocks[b][0]] = blocks[b][1]
        dense = np.concatenate([np.zeros((len(modes), len(group))), *rows])[:, modes]
        _, values, vectors = np.linalg.svd(dense, full_matrices=False)
        none = values < tolerance * np.sqrt(len(group))
        found = np.zeros((int(none.sum()), len(group)))
        found[:, modes] = vectors[none]
        return found

    def held(part: list[int]) -> set[int]:
        free, waiting = set(part), list(part)
        while waiting:
            k = waiting.pop()
            alone = [b for b in touching[k] if free.isdisjoint({*at[b]} - {k})]
            if k in free and alone and not len(kernel([k], alone)):
                free.remove(k)
                waiting += [j for b in touching[k] for j in at[b] if j in free]
        return set(part) - free

    whole = list(parts(set(range(len(touching)))))
    large = [part for part in whole if len(part) > _TOGETHER]
    small = [part for part in whole if len(part) <= _TOGETHER]
    small += [rest for part in large for rest in parts(set(part) - held(part))]
    found = [kernel(part, sorted({b for k in part for b in touching[k]})) for part in small]
    return np.concatenate([np.zeros((0, len(group))), *found])


class RigidMotions:
    """Rigid motions of the pieces of a supported body, of a stiffness K (n, n), and of surfaces."""

    def __init__(self, system: ContactSystem, K: PETSc.Mat, space: fem.FunctionSpace) -> None:
        self._system, self._K = system, K
        self.modes = RigidModes(Pieces.of(space), system.free, system.interface.pairs)
        field, at = system.interface.field, system.interface.field.owned.ravel()
        of_owned = sp.csr_array(
            (np.ones(len(at)), (at, np.arange(len(at)))), (field.rows[0], len(at))
        )
        self._full = sp.csr_array(of_owned @ self.modes.displacements())  # (unknowns, modes)
        column = free_columns(system.reduction.right)
        self._prescribed = column == -1
        kept = np.flatnonzero(column >= 0)
        first, last = system.stiffness.getOwnershipRange()
        ones = (np.ones(len(kept)), (column[kept] - first, kept))
        self._reduced = sp.csr_array(ones, (last - first, len(column))) @ self._full
        self._held = self._hold(transposed=False)
        self._relative = self._at_points(works=False)

    def left_free(self, active: ActiveSet, frame: Array) -> list[str]:
        """Names of the motions that an active set in its frames (m, dim, dim) leaves free."""
        free = self._free(active, frame)
        return self.modes.names(self.modes.simplest(free).motions) if len(free) else []

    def slides(self, contact: Contact, lost: float) -> bool:
        """Whether friction is used up, but for lost forces, so that a body may slide on and on."""
        comm, shear, at_rest = self._system.comm, contact.force[:, 1:], contact.active_set()
        size, limit = np.linalg.norm(shear, axis=1), contact.limits[0]
        used = contact.cone.rough & (at_rest.status != OPEN) & (size > lost)
        used &= size >= limit - lost
        if not comm.allreduce(bool(used.any()), MPI.LOR):
            return False
        direction = shear / np.where(used, size, 1.0)[:, None]
        sliding = ActiveSet(np.full_like(at_rest.status, SLIP), direction, *np.ones((3, len(used))))
        free = self._free(mixed(~used, at_rest, sliding), contact.frame)
        moved = (self._relative @ free.T).reshape(*contact.frame.shape[:2], len(free))
        along = np.einsum("nab,na,nbk->nk", contact.frame[:, 1:], direction, moved)
        along = along[used & (at_rest.status == STICK)]
        ends = comm.allgather([along.max(initial=0.0), -along.min(initial=0.0)])
        # a single motion has to go against all friction of what does not slip yet, or its reverse
        return len(free) > 1 or (len(free) == 1 and np.max(ends, axis=0).min() <= _FREE_STIFFNESS)

    def virtual(self) -> tuple[Basis, Array]:
        """Motions in which no forces but loads and contact's do work, whatever the strains.

        A basis of k of them, each of a single piece or surface, and the motions (m, dim, k)
        relative to surfaces in which forces at the contact points do work.
        """
        group = self.modes.group
        alone = [
            (modes[group[modes] == k], rows[:, group[modes] == k])
            for modes, rows in self._hold(transposed=True)
            for k in np.unique(group[modes])
        ]
        chosen = self.modes.simplest(null_space(alone, group, _ZERO_STIFFNESS))
        works = self._at_points(works=True) @ chosen.motions.T
        return chosen, works.reshape(*self._system.interface.position.shape, works.shape[1])

    def power(self, load: PETSc.Vec, totals: Array) -> tuple[Array, Array]:
        """Work (modes,) of reduced loads and forces on free surfaces, and its parts' magnitudes."""
        forces = load.array_r
        parts = np.array([self._reduced.T @ forces, abs(self._reduced).T @ np.abs(forces)])
        self._system.comm.Allreduce(MPI.IN_PLACE, parts, MPI.SUM)
        parts[:, self.modes.of_pieces :] = totals, np.abs(totals)
        return parts[0], parts[1]

    def _free(self, active: ActiveSet, frame: Array) -> Array:
        """The motions (k, modes) that an active set in its frames (m, dim, dim) leaves free."""
        m, dim = frame.shape[:2]
        constraints = equations(active, np.ones(m))[1] @ frame
        turned = sp.bsr_array((constraints, np.arange(m), np.arange(m + 1)), (m * dim,) * 2)
        group = self.modes.group
        rows = triangles(sp.csr_array(turned @ self._relative), group, self._system.comm)
        return null_space(self._held + rows, group, _FREE_STIFFNESS)

    def _at_points(self, works: bool) -> sp.csr_array:
        """Relative motions (m dim, modes) of the points, or those in which their forces do work."""
        interface, modes = self._system.interface, self._matrix(self._full)
        product = interface.force.transposeMatMult if works else interface.motion.matMult
        moved = product(modes)
        dim, of_pieces = interface.position.shape[1], local_rows(moved, 0)
        destroy(modes, moved)
        surfaces = border_columns(self.modes.free, interface.pair, dim)
        still = sp.csr_array((len(interface.pair) * dim, self.modes.of_pieces))
        return sp.csr_array(of_pieces - sp.hstack([still, surfaces]))

    def _hold(self, transposed: bool) -> list[Block]:
        """Displacements in the pieces' modes at supports, and the forces that these cause.

        Forces K m count over the stiffness. They are there in axisymmetry, say, where only a
        translation along the axis is without strain. K^T m tells of which modes no state of
        strain changes the balance of forces; where it is unsymmetric, they may be fewer.
        """
        system, K, modes = self._system, self._K, self._matrix(self._reduced)
        right, left = system.reduction.right, system.reduction.left
        moved = (left if transposed else right).matMult(modes)
        if transposed:
            forces = galerkin_product(K, right, moved)
            forces.transpose()
        else:
            forces = galerkin_product(K, moved, left)
        largest = system.comm.allreduce(system.scale.max(initial=0.0), MPI.MAX)
        rows = sp.vstack([self._full[self._prescribed], local_rows(forces, 0) / largest])
        destroy(modes, moved, forces)
        return triangles(sp.csr_array(rows), self.modes.group, system.comm)

    def _matrix(self, motions: sp.csr_array) -> PETSc.Mat:
        """Motions (rows of this process, modes) as those of all processes."""
        comm, n = self._system.comm, self.modes.number
        places = (x.astype(PETSc.IntType) for x in (motions.indptr, motions.indices))
        sizes = (motions.shape[0], PETSc.DETERMINE), (n if comm.rank == 0 else 0, n)
        return PETSc.Mat().createAIJ(sizes, csr=(*places, motions.data), comm=comm)

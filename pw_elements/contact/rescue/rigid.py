"""Rigid motions under supports: which ones are free, and what loads and contact do in them.

Modes are motions of the connected pieces of a body and of surfaces; there are words for each.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem
from scipy.linalg import qr
from scipy.optimize import linprog

from pw_elements.arrays import Array, Indices
from pw_elements.checks import format_points
from pw_elements.contact.interface import find_reduced_columns
from pw_elements.contact.model import FreeMotions
from pw_elements.contact.nodes import (
    OPEN,
    SLIP,
    STICK,
    ActiveSet,
    ContactNodes,
    assemble_node_equations,
    select_nodes,
)
from pw_elements.contact.system import ContactSystem, extract_local_rows, make_border_columns
from pw_elements.solvers import RigidComponents, destroy_objects, null_space, qr_triangle

_AXES = "xyz"
# Part of a motion, over its largest one, that is none
NOTHING = 1e-6
# The same, in what is solved for
_NO_PART = 1e-12
# By how much a mode's part of motions may be larger before it comes first
_PREFERRED = 1e3

# Stiffness of a motion, over what it would be for an arbitrary one, that is no more than round-off:
# something is to be proved by it
_ZERO_STIFFNESS = 1e-11
# The same, as good as none
_FREE_STIFFNESS = 1e-8


@dataclass(frozen=True)
class Basis:
    """Independent rigid motions (k, modes); each has a pivot (k,), a mode that no other has."""

    motions: Array
    pivot: Indices


class RigidModes:
    """Translations and rotations of each connected piece, and free translations of surfaces.

    Motions are vectors of all modes: those of one piece after another, see `RigidComponents`, then
    the surfaces' translations.
    """

    def __init__(self, pieces: RigidComponents, free: FreeMotions, pairs: int) -> None:
        self.centre, self.length = pieces.centre, pieces.length
        self.free, self._pairs = free, pairs
        self.each = pieces.modes.shape[2]
        self.of_pieces = len(pieces.centre) * self.each
        self.number = self.of_pieces + len(free)
        # the piece (modes,) that moves, or a number of its own for each of the surfaces' modes
        n_pieces = len(pieces.centre)
        of_piece, surfaces = np.repeat(np.arange(n_pieces), self.each), np.arange(len(free))
        self.group: Indices = np.concatenate([of_piece, n_pieces + surfaces])

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
        _, pivots = qr(motions / _PREFERRED**rank, mode="r", pivoting=True)
        pivot = np.array(sorted(pivots[: len(motions)], key=lambda k: (rank[k], k)), dtype=int)
        rows = np.asarray(np.linalg.solve(motions[:, pivot], motions), dtype=float)
        return Basis(np.where(np.abs(rows) <= _NO_PART, 0.0, rows), pivot)

    def name(self, motion: Array) -> str:
        """What moves how in a motion (modes,), in words."""
        translation, turning, surface = self.parts(motion)
        nothing, words = NOTHING * np.abs(motion).max(), []
        around = [
            f" around {format_points(self.centre[k : k + 1])}" for k in range(len(self.centre))
        ]
        for k, place in enumerate(around):
            who = f"the body{place if len(around) > 1 else ''}"
            if np.abs(turning[k]).max(initial=0.0) > nothing:
                words.append(f"{self._rotation(k, translation[k], turning[k])} of {who}")
            elif np.abs(translation[k]).max() > nothing:
                words.append(f"translation {direction(translation[k])} of {who}")
        for k in range(len(surface)):
            if np.abs(surface[k]).max() > nothing:
                words.append(f"translation {direction(surface[k])} of the surface of pair {k}")
        return " with ".join(words)

    def _rotation(self, k: int, moved: Array, turned: Array) -> str:
        dim = len(moved)
        v, w = np.pad(moved, (0, 3 - dim)), np.pad(turned, (3 - len(turned), 0))
        pole = self.centre[k] + self.length[k] * np.cross(w, v)[:dim] / (w @ w)
        if dim == 2:
            return f"rotation about {format_points(pole[None])}"
        axis = direction(w * np.sign(w[np.argmax(np.abs(w))]))
        along = " with a translation along it" if abs(v @ w) > NOTHING * (w @ w) else ""
        return f"rotation about the axis along {axis} through {format_points(pole[None])}{along}"


def direction(vector: Array) -> str:
    """The axis along a vector (dim,), with a sign, or else its unit vector."""
    vector = vector / np.linalg.norm(vector)
    main = int(np.argmax(np.abs(vector)))
    if np.linalg.norm(np.delete(vector, main)) <= NOTHING:
        return ("-" if vector[main] < 0 else "") + _AXES[main]
    return format_points(vector[None])


class RigidMotions:
    """Rigid motions of the pieces of a supported body, of a stiffness K (n, n), and of surfaces."""

    def __init__(self, system: ContactSystem, K: PETSc.Mat, space: fem.FunctionSpace) -> None:
        self._system, self._K, self._space = system, K, space
        pieces = RigidComponents.from_space(space)
        self.modes = RigidModes(pieces, system.free_motions, system.interface.pairs)
        self._at = system.interface.field.owned_unknowns.ravel()
        self._held = qr_triangle(self._resisted(pieces, transposed=False), system.comm)
        self._relative = self._at_points(pieces, works=False)
        if isinstance(self._held, np.ndarray):  # of few modes
            self._relative = self._relative.toarray()

    def left_free(self, active: ActiveSet, frame: Array) -> list[str]:
        """Names of the motions that an active set in its frames (m, dim, dim) leaves free."""
        free = self._free(active, frame)
        if not len(free):
            return []
        return [self.modes.name(motion) for motion in self.modes.simplest(free).motions]

    def slides(self, nodes: ContactNodes, lost: float) -> bool:
        """Whether friction is used up, to within a force `lost`: a body may slide for ever then."""
        comm, shear, active = self._system.comm, nodes.force[:, 1:], nodes.active_set
        size, limit = np.linalg.norm(shear, axis=1), nodes.friction_limits[0]
        used = nodes.cone.has_friction & (active.status != OPEN) & (size > lost)
        used &= size >= limit - lost
        if not comm.allreduce(bool(used.any()), MPI.LOR):
            return False
        direction = shear / np.where(used, size, 1.0)[:, None]
        sliding = replace(
            active,
            status=np.full_like(active.status, SLIP),
            direction=direction,
            **{name: np.ones(len(used)) for name in ("turning", "slope", "intercept")},
        )
        free = self._free(select_nodes(~used, active, sliding), nodes.frame)
        moved = (self._relative @ free.T).reshape(*nodes.frame.shape[:2], len(free))
        along = np.einsum("nab,na,nbk->nk", nodes.frame[:, 1:], direction, moved)
        along = along[used & (active.status == STICK)]
        ends = comm.allgather([along.max(initial=0.0), -along.min(initial=0.0)])
        # a single motion has to go against all friction of what does not slip yet, or its reverse
        return len(free) > 1 or (len(free) == 1 and np.max(ends, axis=0).min() <= _FREE_STIFFNESS)

    def loose(self, nodes: ContactNodes, lost: float) -> list[str]:
        """Names of motions of pieces that no contact force holds, and that no surface stops.

        Forces up to `lost` are none. Points that touch without a force stop a motion into their
        surface, and no other one.
        """
        comm, (m, dim, _) = self._system.comm, nodes.frame.shape
        pressed = nodes.force[:, 0] > lost
        at_pressed = sp.diags_array(np.repeat(pressed.astype(float), dim)) @ abs(self._relative)
        held = comm.allreduce(np.asarray(at_pressed.sum(axis=0)).ravel(), MPI.SUM) > 0
        held[self.modes.of_pieces :] = True
        group = self.modes.group
        held = np.isin(group, group[held])
        if held.all():
            return []
        fixed = np.eye(self.modes.number)[held]
        dense = isinstance(self._held, np.ndarray)
        free = null_space(
            _stacked([self._held, fixed if dense else sp.csr_array(fixed)]), _FREE_STIFFNESS
        )
        if not len(free):
            return []
        moved = (self._relative @ free.T).reshape(m, dim, len(free))
        touching = np.isfinite(nodes.gap) & (nodes.scale * nodes.gap <= lost) & ~pressed
        opening = np.einsum("na,nak->nk", nodes.frame[:, 0], moved)[touching]
        opening = np.concatenate(comm.allgather(opening))
        motion = comm.bcast(unstopped(opening) if comm.rank == 0 else None)
        return [] if motion is None else [self.modes.name(motion @ free)]

    def virtual(self) -> tuple[Basis, Array]:
        """Motions in which no forces but loads and contact's do work, whatever the strains.

        A basis of k of them, each of a single piece or surface, and the motions (m, dim, k)
        relative to surfaces in which forces at the contact points do work.
        """
        pieces, group = RigidComponents.from_space(self._space), self.modes.group
        hold = qr_triangle(self._resisted(pieces, transposed=True), self._system.comm)
        alone = [hold @ sp.diags_array((group == k).astype(float)) for k in np.unique(group)]
        free = null_space(_stacked([hold[:0], *alone]), _ZERO_STIFFNESS)
        chosen = self.modes.simplest(free)
        works = self._at_points(pieces, works=True) @ chosen.motions.T
        return chosen, works.reshape(*self._system.interface.position.shape, works.shape[1])

    def power(self, load: PETSc.Vec, totals: Array) -> tuple[Array, Array]:
        """Work (modes,) of reduced loads and forces on free surfaces, and its parts' magnitudes."""
        column = self._columns()
        forces, kept = np.zeros(len(column)), column >= 0
        forces[kept] = load.array_r[column[kept] - load.getOwnershipRange()[0]]
        pieces = RigidComponents.from_space(self._space)
        motions = pieces.mode_matrix(pieces.modes, len(self.modes.free))
        parts = np.array([motions.T @ forces, abs(motions).T @ np.abs(forces)])
        self._system.comm.Allreduce(MPI.IN_PLACE, parts, MPI.SUM)
        parts[:, self.modes.of_pieces :] = totals, np.abs(totals)
        return parts[0], parts[1]

    def _free(self, active: ActiveSet, frame: Array) -> Array:
        """The motions (k, modes) that an active set in its frames (m, dim, dim) leaves free."""
        m, dim = frame.shape[:2]
        constraints, relative = (
            assemble_node_equations(active, np.ones(m))[1] @ frame,
            self._relative,
        )
        if isinstance(relative, np.ndarray):
            rows = constraints @ relative.reshape(m, dim, relative.shape[1])
            rows = rows.reshape(relative.shape)
        else:
            turned = sp.bsr_array((constraints, np.arange(m), np.arange(m + 1)), (m * dim,) * 2)
            rows = sp.csr_array(turned @ relative)
        held = _stacked([self._held, qr_triangle(rows, self._system.comm)])
        return null_space(held, _FREE_STIFFNESS)

    def _columns(self) -> Indices:
        return find_reduced_columns(self._system.reduction.right)[self._at]

    def _resisted(self, pieces: RigidComponents, transposed: bool) -> sp.csr_array:
        """Displacements in the pieces' modes at supports, and the forces that these cause.

        There are forces in axisymmetry, say, where only a translation along the axis is without
        strain. K^T m tells of which modes no state of strain changes the balance of forces; where
        it is unsymmetric, they may be fewer.
        """
        free = self._columns() != -1
        return pieces.resistance(self._K, free, self._at, transposed, len(self.modes.free))

    def _at_points(self, pieces: RigidComponents, works: bool) -> sp.csr_array:
        """Relative motions (m dim, modes) of the points, or those in which their forces do work."""
        system, modes = self._system, self.modes
        interface, comm, field = system.interface, system.comm, system.interface.field
        own = pieces.mode_matrix(pieces.modes, len(modes.free))
        spread = sp.csr_array(
            (np.ones(len(self._at)), (self._at, np.arange(len(self._at)))),
            (field.full_sizes[0], len(self._at)),
        )
        full = sp.csr_array(spread @ own)  # (unknowns, modes)
        places = (x.astype(PETSc.IntType) for x in (full.indptr, full.indices))
        sizes = field.full_sizes, (modes.number if comm.rank == 0 else 0, modes.number)
        motions = PETSc.Mat().createAIJ(sizes, csr=(*places, full.data), comm=comm)
        product = interface.force.transposeMatMult if works else interface.motion.matMult
        moved = product(motions)
        dim, of_pieces = interface.position.shape[1], extract_local_rows(moved, 0)
        destroy_objects(motions, moved)
        surfaces = make_border_columns(modes.free, interface.pair, dim)
        still = sp.csr_array((len(interface.pair) * dim, modes.of_pieces))
        return sp.csr_array(of_pieces - sp.hstack([still, surfaces]))


def unstopped(opening: Array) -> Array | None:
    """Return a motion z (k,) that closes no gap, `opening` (m, k) @ z >= 0; None if all do."""
    k = opening.shape[1]
    for way in (*np.eye(k), *-np.eye(k)):
        found = linprog(-way, A_ub=-opening, b_ub=np.zeros(len(opening)), bounds=(-1, 1))
        if found.success and found.x @ way > NOTHING:
            return np.asarray(found.x, dtype=float)
    return None


def _stacked(parts: Sequence[sp.csr_array | Array]) -> sp.csr_array | Array:
    dense = isinstance(parts[0], np.ndarray)
    return np.vstack(parts) if dense else sp.vstack(parts, "csr")

"""Large strains: equilibrium of any residual, and contact at the deformed body.

The guide's page on theory has the kinematics of surfaces that move and turn, and of slip ("Large
strains"). Residuals need no areas: the force of a node is the residual's entry, r = L F(u), and

    K a = f + H r,    K = F'(u_k),    f = K u_k - F(u_k)

is a linear equilibrium for the next u. Newton's step to it is halved as long as it turns a cell.

Of two bodies H(u) and the places of both sides are those of `SlidingMortar`. Then K has -dH r
besides, and the law is one of three motions of a node, whose rows G are made anew in each
iteration: the changes of its gap and slip, and the angle by which its normal turns.
"""

from collections.abc import Sequence
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import scipy.sparse as sp
import ufl
from basix import PolysetType
from dolfinx import fem
from ufl.algorithms import extract_elements

from pw_elements._compat import cell_nodes
from pw_elements.algebra import Reduction, System
from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import (
    PATH_PIECES,
    RIGID,
    ROUND_OFF,
    Interface,
    SlidingReference,
)
from pw_elements.contact.iteration.law import (
    TOLERANCE,
    Levers,
    Place,
    along_supports,
    frames,
    held_tangents,
)
from pw_elements.contact.iteration.newton import LinearEquilibrium, Reference
from pw_elements.contact.iteration.system import ContactSystem
from pw_elements.contact.model import ContactPair, NotFound
from pw_elements.spaces import SubSpace, is_hybrid

# Of a node that another body faces: gap, slip and angle
_MOTIONS = 3
# Largest sum of the magnitudes in a row of K over its diagonal, roughly
_ROW_OVER_DIAGONAL = 4.0
# A step is halved so often at most
_HALVINGS = 10
# Below this s the arc's factor is as exact by its series as by its formula
_SMALL_TURN = 1e-3
# s of normals at a right angle, beyond which a point has jumped; the largest s that `_arc` is given
_RIGHT_ANGLE, _FARTHEST = np.sqrt(0.5), 0.99
# Shares of a point's way at which it is looked for within the surface
_WAY = np.linspace(0.05, 0.95, 19)


class Sliding:
    """Both sides of all pairs of bodies in one increment.

    Args:
        interface: the contact points (m).
        start: all unknowns (n,) where it starts.
        before, after: placements (pairs, dim + 1) of the opposite bodies there, and at its end.

    Attributes:
        motion: G of the law, (m p, n), where its motions have been looked for last.
    """

    def __init__(self, interface: Interface, start: PETSc.Vec, before: Array, after: Array) -> None:
        self._interface, self._translations = interface, after[:, :-1]
        self._start = {
            k: mortar.make_reference(self._place(k, start, before[:, :-1]))
            for k, mortar in interface.mortars.items()
        }
        # points of this process, and their places among the slave's nodes
        self._own = {k: np.flatnonzero(interface.pair == k) for k in self._start}
        self._among = {
            k: np.searchsorted(interface.mortars[k].nodes[: interface.mortars[k].slaves], node)
            for k, node in ((k, interface.node[own]) for k, own in self._own.items())
        }
        self.motion: PETSc.Mat = interface.motion

    def meet(self, unknowns: PETSc.Vec) -> PETSc.Mat:
        """Goes to all unknowns (n,); H, (n, m dim)."""
        interface = self._interface
        self._x = {k: self._place(k, unknowns, self._translations) for k in self._start}
        self._met = {k: interface.mortars[k].meet(x) for k, x in self._x.items()}
        m, (_, dofs), dim = len(interface.node), interface.field.sizes, interface.position.shape[1]
        entries = [(np.arange(m), interface.node, np.ones(m))]
        for k, met in self._met.items():
            mortar, parts = interface.mortars[k], sp.coo_array(met.parts[self._among[k]])
            node = mortar.nodes[mortar.slaves :][parts.col]
            entries.append((self._own[k][parts.row], node, -parts.data))
        row, column, value = (np.concatenate(each) for each in zip(*entries, strict=True))
        nodal = sp.csr_matrix((value, (row, column)), (m, dofs // dim))
        rows = sp.csr_matrix(sp.kron(nodal, sp.eye_array(dim)))
        return interface.rows(rows).transpose(PETSc.Mat())

    def stiffness(self, force: Array) -> PETSc.Mat:
        """Derivative (n, n) of -H r for forces r (m, dim) that are fixed."""
        interface, dim = self._interface, force.shape[1]
        first, rows = interface.field.space.dofmap.index_map.local_range[0], interface.field.sizes
        total = sp.csr_matrix(rows)
        for k, met in self._met.items():
            mortar = interface.mortars[k]
            every = np.zeros((mortar.slaves, dim))
            every[self._among[k]] = force[self._own[k]]
            interface.comm.Allreduce(MPI.IN_PLACE, every, MPI.SUM)
            part = sp.coo_array(met.turned(every))
            dofs = (mortar.nodes[:, None] * dim + np.arange(dim)).ravel()
            row = dofs[mortar.slaves * dim :][part.row] - first * dim
            mine = (row >= 0) & (row < rows[0])
            place = row[mine], dofs[part.col[mine]]
            total += sp.csr_matrix((part.data[mine], place), rows)
        matrix, field = interface.rows(total), interface.field
        return matrix if field.is_all else field.selection().transposeMatMult(matrix)

    def into(self, place: Place, force: Array) -> Place:
        """A place (m) with the points of these pairs in it, under forces (m, dim)."""
        interface, (m, dim) = self._interface, force.shape
        gap, slip, frame = place.gap.copy(), place.slip.copy(), place.frame.copy()
        at, moved, turned = (
            np.pad(v, [(0, 0)] * (v.ndim - 1) + [(0, _MOTIONS - dim)])
            for v in (place.at, place.moved, place.turned)
        )
        node = interface.node * dim
        rigid = np.flatnonzero(interface.faced == RIGID)
        rows = [(rigid * _MOTIONS + a, node[rigid] + a, np.ones(len(rigid))) for a in range(dim)]
        for k, met in self._met.items():
            mortar, own, among = interface.mortars[k], self._own[k], self._among[k]
            slips, motions = met.motions(self._start[k], self._x[k])
            known, tangent, faced = met.normals[among], met.tangents[among], met.faced[among]
            frame[own] = frames(known, interface.equation[own] >= 0)
            side = np.sum(frame[own, 1] * tangent, axis=1)
            gap[own] = np.where(faced, met.gaps[among], np.inf)
            slip[own, 0] = np.where(faced, side * slips[among], 0.0)
            pressed, sheared = (np.sum(part * force[own], axis=1) for part in (known, tangent))
            moved[own], turned[own] = 0.0, 0.0
            moved[own, 0, 0], moved[own, 1, 1] = faced, faced * side
            turned[own, 0, 2], turned[own, 1, 2] = sheared, -side * pressed
            shift = self._x[k] - mortar.x
            shift[mortar.slaves :] -= self._translations[k]
            dofs = (mortar.nodes[:, None] * dim + np.arange(dim)).ravel()
            for number, change in enumerate(motions):
                part = sp.coo_array(change[among])
                rows.append((own[part.row] * _MOTIONS + number, dofs[part.col], part.data))
                at[own, number] = change[among] @ shift.ravel()
        row, column, value = (np.concatenate(each) for each in zip(*rows, strict=True))
        shape = (m * _MOTIONS, interface.field.sizes[1])
        self.motion = interface.rows(sp.csr_matrix((value, (row, column)), shape))
        return replace(place, frame=frame, gap=gap, slip=slip, at=at, moved=moved, turned=turned)

    @property
    def references(self) -> dict[int, SlidingReference]:
        """What slip of each pair counts from."""
        return self._start

    @property
    def positions(self) -> dict[int, Array]:
        """Positions (nodes, dim) of both sides of each pair, where they met last."""
        return self._x

    def integrate_slip(self, slip: Array) -> Array:
        """Return slip (m, dim) with that of these pairs' points on the path from the start."""
        slip = slip.copy()
        for k, mortar in self._interface.mortars.items():
            path = mortar.integrate_slip(self._start[k].x, self._x[k])
            slip[self._own[k]] = path[self._among[k]]
        return slip

    def _place(self, pair: int, unknowns: PETSc.Vec, translations: Array) -> Array:
        """Positions (nodes, dim) of both sides of a pair, of all processes."""
        mortar = self._interface.mortars[pair]
        moved = self._interface.at_nodes(mortar.nodes, unknowns)
        moved[mortar.slaves :] += translations[pair]
        return np.asarray(mortar.x + moved)


class Tools:
    """Surfaces of all pairs as they are at placements q, (pairs, dim + 1): U, then the angle."""

    def __init__(self, interface: Interface, pairs: Sequence[ContactPair]) -> None:
        self._pair, dim = interface.pair, interface.position.shape[1]
        self._pivots = [pair.spin(dim) for pair in pairs]
        pivots, spins = zip(*self._pivots, strict=True)
        self._away = interface.position - np.array(pivots)[self._pair]
        self._spin = np.array(spins)[self._pair]  # J v = w x v, (m, dim, dim)

    def turned(self, places: Array) -> Array:
        """R - I, (m, dim, dim)."""
        angle, J = places[self._pair, -1, None, None], self._spin
        return np.asarray(np.sin(angle) * J + 2 * np.sin(angle / 2) ** 2 * J @ J)

    def within(self, places: Array, displacement: Array) -> Array:
        """Way y - X (m, dim) of points that have moved by a."""
        at = displacement - places[self._pair, :-1]
        return at + np.einsum("nba,nb->na", self.turned(places), at + self._away)

    def see_from_surface(self, pair: int, place: Array, x: Array) -> Array:
        """Return positions (n, dim) of any points in the frame of a pair's surface at its start."""
        dim = x.shape[1]
        pivot, J = self._pivots[pair]
        angle = place[dim]
        R = np.eye(dim) + np.sin(angle) * J + 2 * np.sin(angle / 2) ** 2 * J @ J
        return np.asarray(pivot + (x - place[:dim] - pivot) @ R)

    def carried(self, places: Array, within: Array) -> Array:
        """Displacements (m, dim) of what has gone such a way."""
        turned = np.einsum("nab,nb->na", self.turned(places), within + self._away)
        return within + turned + places[self._pair, :-1]

    def levers(self, places: Array, displacement: Array, force: Array) -> Levers:
        """Levers of points that have moved by a, under forces (m, dim)."""
        at, J = displacement - places[self._pair, :-1], self._spin
        arm, spun = (np.einsum("nab,nb->na", J, v) for v in (self._away + at, force))
        straight = np.broadcast_to(np.eye(J.shape[1]), J.shape)
        return Levers(np.concatenate([straight, arm[:, :, None]], axis=2), spun, at)


class DeformedKinematics:
    """Gaps, frames and slips of deformed points since an increment's start."""

    def __init__(
        self, interface: Interface, tools: Tools, past: Reference, sliding: Sliding | None = None
    ) -> None:
        self._interface, self._tools, self._sliding = interface, tools, sliding
        self._past = past
        self._start = tools.within(past.translations, past.displacement)
        gap, self._normal, self._bend = interface.closest(self._start)
        # slip of what faces nothing at first counts from where it is then, as along its surface
        self._faced = np.isfinite(gap)
        self._gap = np.where(self._faced, gap, 0.0)
        self._point = interface.position + self._start - self._gap[:, None] * self._normal

    def stuck(self, places: Array, displacement: Array, closed: Mask) -> Array:
        """Displacements (m, dim) of closed points that have gone with their surfaces."""
        return np.where(closed[:, None], self._tools.carried(places, self._start), displacement)

    def __call__(self, places: Array, displacement: Array, force: Array) -> Place:
        """Linearisation at placements (pairs, dim + 1), motions and forces (m, dim)."""
        interface, tools = self._interface, self._tools
        at, R = tools.within(places, displacement), np.eye(force.shape[1]) + tools.turned(places)
        gap, normal, bend = interface.closest(at)
        held = interface.held_components
        frame = frames(np.einsum("nab,nb->na", R, normal), interface.equation >= 0)
        frame = along_supports(frame, held)
        levers, force = tools.levers(places, displacement, force), np.where(held, 0.0, force)
        tangents = frame[:, 1:] @ R
        bent = tangents @ bend  # t·N
        away = np.where(np.isfinite(gap), gap, 0.0)  # of what faces nothing, which bears no force
        chord = interface.position + at - away[:, None] * normal - self._point
        before = self._normals_before(normal, gap)
        s = np.linalg.norm(normal - before, axis=1) / 2
        factor, rise = _arc(np.minimum(s, _FARTHEST))
        along = np.einsum("nta,na->nt", tangents, chord)
        across = np.sum(normal * chord, axis=1)
        turning = np.einsum("na,nab->nb", before, bend) / 4
        slipped = factor[:, None, None] * (tangents - (away + across)[:, None, None] * bent)
        slipped -= (rise[:, None] * along)[:, :, None] * turning[:, None]
        pressed, back = np.sum(frame[:, 0] * force, axis=1), np.swapaxes(R, 1, 2)
        by_turn = np.einsum("na,nab->nb", force, R @ bend)[:, None], -pressed[:, None, None] * bent
        moved = np.concatenate([normal[:, None], slipped], axis=1) @ back
        turned = np.concatenate(by_turn, axis=1) @ back
        rigid = (interface.faced == RIGID)[:, None, None]
        followed, spun = (np.where(rigid, -part @ levers.carried, 0.0) for part in (moved, turned))
        spun[:, :, -1] -= np.einsum("nab,nb->na", frame, levers.spun)
        place = Place(
            interface.pair,
            levers,
            displacement,
            places,
            frame,
            gap,
            factor[:, None] * along,
            moved,
            followed,
            turned,
            spun,
            held_tangents(frame, held),
        )
        return place if self._sliding is None else self._sliding.into(place, force)

    def check_surfaces(self, place: Place, pressed: Mask) -> None:
        """Raise ValueError where differences contradict a surface at `pressed` (m,) nodes."""
        end = self._tools.within(place.translations, place.at[:, : self._start.shape[1]])
        self._interface.check_closest(end, pressed)

    def _normals_before(self, normal: Array, gap: Array) -> Array:
        """Normals (m, dim) at the start, those of now where nothing faces a point then or now."""
        return np.where((self._faced & np.isfinite(gap))[:, None], self._normal, normal)

    def by_start(self, place: Place) -> Array:
        """Derivatives (m, dim - 1, dim) of a place's slip by the motions where it began."""
        normal, tangents = place.frame[:, 0], place.frame[:, 1:]
        before = self._normals_before(normal, place.gap)
        s = np.linalg.norm(normal - before, axis=1) / 2
        factor, rise = _arc(np.minimum(s, _FARTHEST))
        across = self._normal[:, :, None] * self._normal[:, None, :]
        point = np.eye(normal.shape[1]) - np.where(self._faced[:, None, None], across, 0.0)
        point -= self._gap[:, None, None] * self._bend  # of the closest point there
        turning = np.einsum("na,nab->nb", normal, self._bend) / 4
        turned = (rise / factor)[:, None, None] * place.slip[:, :, None] * turning[:, None]
        return -factor[:, None, None] * (tangents @ point) - turned

    def integrate_slip(self, places: Array, displacement: Array) -> Array:
        """Return slip (m, dim) on the straight path to placements and motions (m, dim).

        In the frame of a tool, closest points go along it in `PATH_PIECES` chords. Vectors in its
        tangent plane turn as the normal does, about an axis that is at right angles to it.
        """
        interface, tools, past = self._interface, self._tools, self._past
        normal, point, slip = self._normal, self._point, np.zeros_like(displacement)
        for share in np.arange(1, PATH_PIECES + 1) / PATH_PIECES:
            at = tools.within(
                (1 - share) * past.translations + share * places,
                (1 - share) * past.displacement + share * displacement,
            )
            gap, toward, _ = interface.look_for_closest(at)
            known = np.isfinite(gap)[:, None]  # others are left out
            toward = np.where(known, toward, normal)
            away = np.where(known[:, 0], gap, 0.0)
            on = np.where(known, interface.position + at - away[:, None] * toward, point)
            middle = normal + toward
            middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), _SMALL_TURN)
            chord = on - point
            chord -= np.sum(chord * middle, axis=1, keepdims=True) * middle
            slip = _carry(slip, normal, toward) + _carry(chord, middle, toward)
            normal, point = toward, on
        slip += np.einsum("nab,nb->na", tools.turned(places), slip)
        return slip if self._sliding is None else self._sliding.integrate_slip(slip)

    def lost(self, place: Place, pressed: Mask) -> Mask:
        """Points (m,) whose normals have turned by a right angle, pressed or past their surface."""
        interface = self._interface
        end = self._tools.within(place.translations, place.at[:, : self._start.shape[1]])
        gap, normal, _ = interface.closest(end)
        turned = np.linalg.norm(normal - self._normals_before(normal, gap), axis=1)
        jumped = turned > 2 * _RIGHT_ANGLE
        if len(interface.gathered(jumped[jumped])):
            for share in _WAY:
                pressed = pressed | (
                    interface.closest((1 - share) * self._start + share * end)[0] < 0
                )
        return jumped & pressed


def _carry(vectors: Array, normal: Array, toward: Array) -> Array:
    """Return tangential vectors (m, dim), turned as unit normals turn from one to the other."""
    cosine = 1 + np.sum(normal * toward, axis=1, keepdims=True)
    ahead = np.sum(vectors * toward, axis=1, keepdims=True)
    return vectors - ahead / np.maximum(cosine, _SMALL_TURN) * (normal + toward)


def _arc(s: Array) -> tuple[Array, Array]:
    """Arc over the chord's tangential part (m,), and its derivative by s over s."""
    large = np.where(s < _SMALL_TURN, 0.5, s)
    w, angle = np.sqrt(1 - large**2), np.arcsin(large)
    rise = (large - angle * (1 - 2 * large**2) / w) / (large**3 * w**2)
    small = s < _SMALL_TURN
    return (
        np.where(small, 1 + 2 * s**2 / 3, angle / (large * w)),
        np.where(small, 4 / 3 + 32 * s**2 / 15, rise),
    )


class CellGuard:
    """Looks for cells that u turns inside out, at all quadrature points of a form's integrals."""

    def __init__(self, u: fem.Function, form: ufl.Form) -> None:
        self._mesh = u.function_space.mesh
        moved = ufl.split(u)[0] if is_hybrid(u.function_space) else u
        volume = ufl.det(ufl.Identity(self._mesh.geometry.dim) + ufl.grad(moved))
        rules = [_points(part) for part in form.integrals() if part.integral_type() == "cell"]
        self._points = np.unique(np.concatenate(rules), axis=0)
        self._volume = fem.Expression(volume, self._points)
        owned = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        self._cells = np.arange(owned, dtype=np.int32)
        largest = np.abs(self._mesh.geometry.x).max(initial=0.0)
        self.extent: float = self._mesh.comm.allreduce(largest, MPI.MAX)

    def smallest(self) -> float:
        """The least det(I + grad u); below any number where it is none."""
        values = np.nan_to_num(self._values(), nan=-np.inf)
        return float(self._mesh.comm.allreduce(values.min(initial=np.inf), MPI.MIN))

    def places(self) -> Array:
        """Midpoints (k, dim), undeformed, of the cells that are turned, of all processes."""
        turned = self._cells[~(self._values() > 0).all(axis=1)]
        mesh = self._mesh
        middle = mesh.geometry.x[cell_nodes(mesh)[turned]].mean(axis=1)
        return np.concatenate(mesh.comm.allgather(middle[:, : mesh.geometry.dim]))

    def _values(self) -> Array:
        values = self._volume.eval(self._mesh, self._cells)
        return np.asarray(values).reshape(len(self._cells), len(self._points))


def _points(integral: ufl.Integral) -> Array:
    """Points (q, dim) of an integral's rule in the reference cell."""
    metadata = integral.metadata()
    if "quadrature_points" in metadata:
        return np.array(metadata["quadrature_points"])
    cell = integral.ufl_domain().ufl_coordinate_element().cell_type
    halved = any(e.polyset_type is PolysetType.macroedge for e in extract_elements(integral))
    kind = PolysetType.macroedge if halved else PolysetType.standard
    degree = int(np.max(metadata["quadrature_degree"]))
    return np.asarray(basix.make_quadrature(cell, degree, polyset_type=kind)[0])


class FiniteEquilibrium:
    """An `Equilibrium` F(u) = H r under large strains, linearised where the iteration is.

    It begins at all unknowns (n,) `start`; the reduction has what supports prescribe at the end.
    """

    def __init__(
        self,
        body: System,
        system: ContactSystem,
        reduction: Reduction,
        guard: CellGuard,
        start: PETSc.Vec,
        sliding: Sliding | None = None,
    ) -> None:
        self._body, self._system, self._reduction, self._guard = body, system, reduction, guard
        self._sliding = sliding
        self._at = start.copy()
        self._field = SubSpace.displacements(body.u.function_space)
        self.offset = reduction.offset
        # coordinates' round-off, as forces
        self._lost = ROUND_OFF * float(system.scale.max(initial=0.0)) * guard.extent
        self._lost = system.comm.allreduce(self._lost, MPI.MAX) or np.finfo(float).tiny
        diagonal = self._field.part(body.matrix.getDiagonal())
        self._row_sum = _ROW_OVER_DIAGONAL * float(diagonal.norm(PETSc.NormType.INFINITY))
        self._lost_volumes: Array | float = 0.0
        body.take(start)
        if guard.smallest() <= 0:
            raise NotFound.at("cells at {} are turned inside out at the start", guard.places())
        kept = reduction.right.createVecRight()
        kept.set(1.0)
        away = np.abs(start.array_r - self.offset.array_r)[(reduction.right * kept).array_r == 0]
        away = system.comm.allreduce(away.max(initial=0.0), MPI.MAX)
        self._reached = bool(away <= ROUND_OFF * guard.extent)  # what supports prescribe
        self._arrive()

    def take(self, reduced: PETSc.Vec) -> float:
        """Goes to a solution of the linear equations, or so far that no cell is turned."""
        step = self._linear().expanded(reduced)
        step.axpy(-1.0, self._at)
        share = 1.0
        for _ in range(_HALVINGS):
            there = self._at.copy()
            there.axpy(share, step)
            self._body.take(there)
            if self._guard.smallest() > 0:
                break
            share /= 2
        else:
            raise NotFound.at("cells at {} would be turned inside out", self._guard.places())
        self._at, self._reached = there, share == 1
        self._arrive()
        return share

    @property
    def sides(self) -> dict[int, tuple[SlidingReference, Array]]:
        """What slip counts from and positions (nodes, dim) now, of each pair of bodies."""
        if self._sliding is None:
            return {}
        positions = self._sliding.positions
        return {k: (start, positions[k]) for k, start in self._sliding.references.items()}

    def residual(self, reduced: PETSc.Vec) -> PETSc.Vec:  # noqa: ARG002
        return self._residual

    def expanded(self, reduced: PETSc.Vec) -> PETSc.Vec:  # noqa: ARG002
        return self._at

    def violation(self, unbalanced: Array, contact: float, full: PETSc.Vec) -> float:  # noqa: ARG002
        """Unbalanced forces over those of contact and supports; infinite before all is applied.

        Round-off of forces is allowed for: a body that has left its tool may have moved far, with
        no force to compare with. Equations of pressures are volumes, which have round-off, too.
        """
        moved = self._field.part(self._at).norm(PETSc.NormType.INFINITY)
        of_volumes = np.asarray(self._lost_volumes)
        allowed = TOLERANCE * self._size + self._lost + of_volumes
        allowed = allowed + np.where(of_volumes > 0, 0.0, ROUND_OFF * self._row_sum * moved)
        return float(np.max(unbalanced / allowed, initial=0.0)) if self._reached else np.inf

    @property
    def load(self) -> PETSc.Vec:
        """Right-hand side f of the linear equations, reduced; the system gets their matrix."""
        return self._linear().load

    @property
    def tangent(self) -> PETSc.Mat:
        """K there, (n, n)."""
        self._linear()
        return self._tangent

    def _round_off_of_volumes(self, K: PETSc.Mat) -> Array | float:
        """What round-off leaves in the reduced equations (n_r,): nothing but in pressures'."""
        if not is_hybrid(self._body.u.function_space):
            return 0.0
        (x, image), own = K.createVecs(), self._field.owned
        position = self._field.space.tabulate_dof_coordinates()[: len(own), : own.shape[1]]
        x.array[own.ravel()] = position.ravel()
        K.mult(x, image)
        image.array[own.ravel()] = 0.0
        volumes = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(image, volumes)
        return ROUND_OFF * np.abs(volumes.array_r)

    def _arrive(self) -> None:
        self._forces = self._body.forces()
        self._size = self._field.part(self._forces).norm(PETSc.NormType.INFINITY)
        self._residual = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(self._forces, self._residual)
        if self._sliding is not None:
            self._system.hand_on(self._sliding.meet(self._at))
        self._linearised: LinearEquilibrium | None = None

    def _linear(self) -> LinearEquilibrium:
        """The linear equations there; no tangent is made where the iteration ends."""
        if self._linearised is None:
            K, reduction, motion = self._body.matrix, self._reduction, None
            self._body.assemble()
            if self._sliding is not None:
                more = self._sliding.stiffness(self._system.forces(self._residual)[0])
                more.axpy(1.0, K, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
                K, motion = more, self._sliding.motion
            self._system.renew(K, motion)
            self._tangent, self._lost_volumes = K, self._round_off_of_volumes(K)
            load = K.createVecLeft()
            K.mult(self._at, load)
            load.axpy(-1.0, self._forces)
            reduced = reduction.load(K, load)
            self._linearised = LinearEquilibrium(
                self._system.stiffness, reduced, reduction.right, reduction.offset
            )
        return self._linearised

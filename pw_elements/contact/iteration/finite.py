"""Large strains: equilibrium of any residual, and contact at the deformed body.

A node is at y = X + u - U in the frame of its surface, which is moved by U without rotation. With
the closest point p = y - g n of the surface, its normal n there, and N the derivative of n by y,

    dg = n·dy,   dp = (I - n n^T - g N) dy,   dt = -(t·N dy) n

for tangents t that turn with n. Slip is the way of p along the surface since the start of the
increment, where p and n were p_0 and n_0: the chord's tangential part t·(p - p_0), times
asin(s) / (s (1 - s^2)^(1/2)) with s = |n - n_0| / 2. So it is the arc on planes, circles and
spheres, and differs from it by the third order of its length on others.

Residuals need no areas: the force of a node is the residual's entry, r = L F(u), and

    K a = f + H r,    K = F'(u_k),    f = K u_k - F(u_k)

is a linear equilibrium for the next u. Newton's step to it is halved as long as it turns a cell.
"""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import ufl
from basix import PolysetType
from dolfinx import fem
from ufl.algorithms import extract_elements

from pw_elements.algebra import Reduction, System
from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import ROUND_OFF, Interface
from pw_elements.contact.iteration.law import ActiveSet, LinearisedLaw, equations, frames
from pw_elements.contact.iteration.newton import TOLERANCE, LinearEquilibrium, Reference
from pw_elements.contact.iteration.system import ContactSystem
from pw_elements.contact.model import NotFound
from pw_elements.spaces import SubSpace, is_hybrid

# A step is halved so often at most
_HALVINGS = 10
# Below this s the series of the arc's factor are as exact
_SMALL_TURN = 1e-3
# Normals that turn further have jumped; s of a right angle, and one that is finite beyond it
_RIGHT_ANGLE, _FARTHEST = np.sqrt(0.5), 0.99
# Shares of a point's way at which it is looked for within the surface
_WAY = np.linspace(0.05, 0.95, 19)


@dataclass(frozen=True)
class DeformedPlace:
    """Gap, slip and force components about deformed nodes, linear in y = X + a - U and r."""

    interface: Interface  # contact points (m)
    translations: Array  # U there, (pairs, dim)
    at: Array  # a - U there, (m, dim)
    frame: Array  # normals and tangents, (m, dim, dim)
    gap: Array  # (m,)
    slip: Array  # (m, dim - 1)
    moved: Array  # derivatives of gap and slip by y, (m, dim, dim)
    turned: Array  # of the force components, by the turning of the frame, (m, dim, dim)
    jumped: Mask  # (m,), whether the normal has turned by a right angle since the start

    def gaps(self, displacement: Array, translations: Array) -> Array:
        """Gaps (m,) at displacements (m, dim) and translations (pairs, dim)."""
        return self.gap + self._changes(displacement, translations, self.moved[:, :1])[:, 0]

    def slips(self, displacement: Array, translations: Array) -> Array:
        """Slip components (m, dim - 1) likewise."""
        return self.slip + self._changes(displacement, translations, self.moved[:, 1:])

    def forces(self, force: Array, translations: Array) -> Array:  # noqa: ARG002
        """Components (m, dim) along the frame of forces (m, dim)."""
        return np.einsum("nab,nb->na", self.frame, force)

    def law(self, active: ActiveSet, scale: Array) -> LinearisedLaw:
        """The law of an active set, in the nodes' coordinates; its factors c are (m,)."""
        A, B, b = equations(active, scale)
        E, C = A @ self.frame, A @ self.turned + B @ self.moved
        known = np.concatenate([self.gap[:, None], self.slip], axis=1)
        c = b - np.einsum("nab,nb->na", B, known) + np.einsum("nab,nb->na", C, self.at)
        to_nodes = np.swapaxes(self.frame, 1, 2)
        E, C, c = to_nodes @ E, to_nodes @ C, np.einsum("nab,nb->na", to_nodes, c)
        return LinearisedLaw(E, C, C, c)

    def _changes(self, displacement: Array, translations: Array, rows: Array) -> Array:
        away = displacement - translations[self.interface.pair] - self.at
        return np.asarray(np.einsum("nab,nb->na", rows, away))


class DeformedKinematics:
    """Gaps, frames and slips of deformed points at rigid surfaces since an increment's start."""

    def __init__(self, interface: Interface, past: Reference) -> None:
        self._interface = interface
        self._start = past.displacement - past.translations[interface.pair]
        gap, self._normal, _ = interface.closest(self._start)
        self._point = interface.position + self._start - gap[:, None] * self._normal

    def __call__(self, translations: Array, displacement: Array, force: Array) -> DeformedPlace:
        """Linearisation at translations (pairs, dim), motions and forces (m, dim)."""
        interface = self._interface
        at = displacement - translations[interface.pair]
        gap, normal, bend = interface.closest(at)
        frame = frames(normal, interface.equation >= 0)
        tangents = frame[:, 1:]
        bent = tangents @ bend  # t·N
        chord = interface.position + at - gap[:, None] * normal - self._point
        s = np.linalg.norm(normal - self._normal, axis=1) / 2
        factor, rise = _arc(np.minimum(s, _FARTHEST))
        along = np.einsum("nta,na->nt", tangents, chord)
        across = np.sum(normal * chord, axis=1)
        turning = np.einsum("na,nab->nb", self._normal, bend) / 4
        slipped = factor[:, None, None] * (tangents - (gap + across)[:, None, None] * bent)
        slipped -= (rise[:, None] * along)[:, :, None] * turning[:, None]
        pressed = np.sum(normal * force, axis=1)
        turned = [np.einsum("na,nab->nb", force, bend)[:, None], -pressed[:, None, None] * bent]
        return DeformedPlace(
            interface,
            translations,
            at,
            frame,
            gap,
            factor[:, None] * along,
            np.concatenate([normal[:, None], slipped], axis=1),
            np.concatenate(turned, axis=1),
            s > _RIGHT_ANGLE,
        )

    def passed(self, place: DeformedPlace) -> Mask:
        """Points (m,) whose normals have turned over, on a straight way through the surface."""
        within = np.zeros(len(place.gap), dtype=bool)
        if not len(self._interface.gathered(place.jumped[place.jumped])):
            return within
        for share in _WAY:
            within |= self._interface.closest((1 - share) * self._start + share * place.at)[0] < 0
        return place.jumped & within


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
        middle = mesh.geometry.x[mesh.geometry.dofmap[turned]].mean(axis=1)
        return np.concatenate(mesh.comm.allgather(middle[:, : mesh.geometry.dim]))

    def _values(self) -> Array:
        values = self._volume.eval(self._mesh, self._cells)
        return np.asarray(values).reshape(len(self._cells), len(self._points))


def _points(integral: ufl.Integral) -> Array:
    """Points (q, dim) of an integral's rule in the reference cell."""
    metadata = integral.metadata()
    if "quadrature_points" in metadata:
        return np.array(metadata["quadrature_points"])
    cell = basix.CellType[str(integral.ufl_domain().ufl_cell().cellname())]
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
    ) -> None:
        self._body, self._system, self._reduction, self._guard = body, system, reduction, guard
        self._at, self._reached = start.copy(), False
        self._field = SubSpace.displacements(body.u.function_space)
        self.offset = reduction.offset
        # coordinates' round-off, as forces
        self._lost = ROUND_OFF * float(system.scale.max(initial=0.0)) * guard.extent
        self._lost = system.comm.allreduce(self._lost, MPI.MAX) or np.finfo(float).tiny
        body.take(start)
        if guard.smallest() <= 0:
            raise NotFound.at("cells at {} are turned inside out at the start", guard.places())
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

    def residual(self, reduced: PETSc.Vec) -> PETSc.Vec:  # noqa: ARG002
        """Residual F(u), reduced, of now."""
        return self._residual

    def expanded(self, reduced: PETSc.Vec) -> PETSc.Vec:  # noqa: ARG002
        """Gives all unknowns (n,)."""
        return self._at

    def violation(self, unbalanced: float, contact: float, full: PETSc.Vec) -> float:  # noqa: ARG002
        """Unbalanced forces over those of contact and supports; infinite before all is applied."""
        return unbalanced / (TOLERANCE * self._size + self._lost) if self._reached else np.inf

    @property
    def load(self) -> PETSc.Vec:
        """Right-hand side f of the linear equations, reduced; the system gets their matrix."""
        return self._linear().load

    def _arrive(self) -> None:
        """Takes the residual where the body is."""
        self._forces = self._body.forces()
        self._size = self._field.part(self._forces).norm(PETSc.NormType.INFINITY)
        self._residual = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(self._forces, self._residual)
        self._linearised: LinearEquilibrium | None = None

    def _linear(self) -> LinearEquilibrium:
        """The linear equations there; no tangent is made where the iteration ends."""
        if self._linearised is None:
            K, reduction = self._body.matrix, self._reduction
            self._body.assemble()
            self._system.renew(K)
            load = K.createVecLeft()
            K.mult(self._at, load)
            load.axpy(-1.0, self._forces)
            reduced = reduction.load(K, load)
            self._linearised = LinearEquilibrium(
                self._system.stiffness, reduced, reduction.right, reduction.offset
            )
        return self._linearised

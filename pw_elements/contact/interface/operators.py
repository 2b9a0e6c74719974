"""The interface: contact points, and two operators that couple them to the body.

With a the displacements (n,) of all nodes and r the contact forces at the points,

    motion of the points  = G a,          G (points x dim, n),
    K a - f               = H r,          H (n, points x dim).

Builders make the `Points` of a pair. What the rest relies on is that the force can be read from
`Points.equation`, and that G's unit times H's is a stiffness over K's, by which the law's scale is
found. Law, kinematics and loop see points only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import arguments, call_user_function, collective_errors, format_points
from pw_elements.contact.interface.sliding import SlidingMortar
from pw_elements.contact.model import (
    BUILT_IN_CLOSEST_POINTS,
    CLOSED_FORM_SURFACES,
    SURFACES_DEFINED_EVERYWHERE,
    ClosestPointSurface,
    FrictionCone,
    NotFound,
    PairState,
    Surface,
    describe_wrong_derivatives,
)
from pw_elements.elasticity import order_by_position
from pw_elements.spaces import SubSpace, gather_from_owners

# Values of `faced` that are no node: a rigid surface, or a deformable one, which has many
RIGID, DEFORMABLE = -1, -2

# What of a coordinate may be round-off
ROUND_OFF = 4 * float(np.finfo(float).eps)
# Largest initial penetration that passes for round-off and faceting, over the body's diagonal
_PENETRATION = 1e-6
# Largest normal component of a prescribed displacement, a cosine
_TANGENTIAL = 1e-8
# Step of differences of closest points, over the extent of the contact nodes
_DIFFERENCES = 1e-6
# Difference of prescribed displacements, over their size, up to which they are alike
_UNLIKE = 1e-9
# Largest difference of a normal's length from one
_UNIT = 1e-6
# Cosine from which on a push counts as outwards
OUTWARDS = 0.1


@dataclass(frozen=True)
class Points:
    """The contact points (m) of one pair that belong to this process."""

    position: Array  # (m, dim), undeformed
    cone: FrictionCone
    # (m, dim), the reduced equation, owned by this process, that holds this component of the
    # point's force and of no other; -1 where none does: the law is not stated there
    equation: Indices
    motion: sp.csr_matrix  # (m dim, n), rows of G, for the displacements alone
    force: sp.csr_matrix  # (m dim, n), columns of H, transposed, likewise
    # (m, dim), mean midpoint of the cells around: tells points apart that coincide, such as those
    # of two bodies that touch
    beside: Array
    outward: Array  # (m, dim), the body's outward normal; zero where there is none
    node: Indices  # (m,), global number of the node that the point is, or whose force it has
    # (m,), global number of the node that it faces, or `RIGID` or `DEFORMABLE`
    faced: Indices
    on_axis: Mask  # (m, dim), radial components of nodes on the axis of a body of revolution
    # (m, dim), global number of the nearest node of a deformable surface that supports hold in this
    # component, too; -1 without any
    counterpart: Indices
    # (k,), global numbers of a deformable surface's nodes, of all processes, `order_by_position`
    opposite: Indices = field(default_factory=lambda: np.empty(0, dtype=np.int64))


@dataclass(frozen=True)
class InitialGap:
    """The gap (m,) at a mortar's own points, which change with the master's rigid motion alone."""

    position: Array
    initial: Array
    direction: Array

    def gap(self, x: Array) -> Array:
        """Gap (m,) of the points (m, dim), as they were or shifted all alike."""
        return self.initial + np.sum(self.direction * (x - self.position), axis=1)

    def normal(self, x: Array) -> Array:  # noqa: ARG002
        return self.direction


# Surfaces of which each process asks for its own points alone, and those that cannot fail there
_ASKED_LOCALLY = (*CLOSED_FORM_SURFACES, InitialGap)
_CANNOT_FAIL = (*SURFACES_DEFINED_EVERYWHERE, InitialGap)


class NoContactStated(ValueError):
    """Points of which no contact is stated, where they or their surfaces are."""


class Interface:
    """All contact points of this process (m of them), pair after pair, as in `Points`."""

    def __init__(
        self,
        points: Sequence[Points],
        surfaces: Sequence[Surface],
        field: SubSpace,
        interfering: Sequence[bool],
        inverse: PETSc.Mat | None,
        mortars: Mapping[int, SlidingMortar],
    ) -> None:
        """Puts pairs together, whose points move with displacements among the unknowns (n,).

        Surfaces, at their initial places, may cut the body in pairs that are `interfering`.
        Unknowns are displacements, or coefficients which `inverse`, (n, n), makes of these. Pairs
        of bodies at large sliding have `mortars`, which tell `force` and the rest anew.
        """
        self.mortars = mortars
        self.field = field
        self.comm: MPI.Comm = field.space.mesh.comm
        self.surfaces, self.pairs = list(surfaces), len(surfaces)
        self._cannot_fail = all(type(surface) in _CANNOT_FAIL for surface in surfaces)
        counts = [len(part.position) for part in points]
        self.pair = np.repeat(np.arange(len(points), dtype=np.int32), counts)
        cones = [part.cone for part in points]
        self.cone = FrictionCone([c.laws[0] for c in cones], [c.parameters[0] for c in cones], [])

        def joined(name: str) -> npt.NDArray:
            return np.concatenate([getattr(part, name) for part in points])

        self.position: Array = joined("position")
        self.equation, self.node, self.faced = map(joined, ("equation", "node", "faced"))
        self.outward, self._beside = joined("outward"), joined("beside")
        self.opposite = [part.opposite for part in points]
        self.motion = self.rows(sp.vstack([part.motion for part in points], "csr"))
        self.force = self.rows(sp.vstack([part.force for part in points], "csr")).transpose(
            PETSc.Mat()
        )
        self._inverse = inverse
        # (m, dim), components that supports prescribe and along which friction acts all the same:
        # not on the axis, where it has no direction, nor between bodies that supports hold alike
        stated = (self.equation >= 0) | (self.faced == DEFORMABLE)[:, None]
        self.held_components: Mask = ~stated & ~joined("on_axis") & self.cone.has_friction[:, None]
        self._counterpart = joined("counterpart")
        between = (self.equation < 0) & (self.faced == DEFORMABLE)[:, None] & ~joined("on_axis")
        self._held_between = between & self.cone.has_friction[:, None]
        self.holds_friction: bool = self.comm.allreduce(bool(self.held_components.any()), MPI.LOR)
        self._interfering = np.array(interfering)[self.pair]

    def check(self, diagonal: float) -> None:
        """Raises ValueError for what states no contact problem.

        `diagonal` is the size of the body, against which penetrations are measured.
        """
        for k in range(self.pairs):
            if self.comm.allreduce(int(np.sum(self.pair == k)), MPI.SUM) == 0:
                raise ValueError(f"contact pair {k} has no nodes: its marker holds nowhere")
        with np.errstate(invalid="ignore"):  # of an infinite coefficient
            nothing, slope = self.cone.limit(np.zeros(len(self.pair)))
        rises = self.cone.find_rising_coefficients()
        self.check_laws()
        wrong = ~(np.isfinite(slope) & (slope >= 0) & (nothing == 0))
        self.refuse(wrong, "have a friction coefficient that is negative or not finite")
        self.refuse(
            rises,
            "have a law of friction whose coefficient, the limit over the normal force, rises with "
            "the force: it may stay or fall, so that its slope at zero bounds it",
        )
        self.check_supports(self.normals(None), self.gaps(None))
        gap = self._by_pair("gap", None)
        cut = ~(gap >= -_PENETRATION * diagonal) & ~self._interfering
        deepest = -self.gathered(np.where(cut, gap, 0.0)).min()
        apart = f"move them apart by {deepest:.3g}, or the pair is to say interference=True"
        rigid = self.faced == RIGID
        self.refuse(cut & rigid, f"lie inside the rigid surface before any motion: {apart}")
        self.refuse(cut & ~rigid, f"lie inside the body that they face before any motion: {apart}")
        self._check_sides()

    def check_laws(self, force: Array | None = None) -> None:
        """Raise, on all processes, what a law of friction has raised on one.

        Laws that do not hold what is asked of them at normal forces (m,) are a ValueError.
        """
        if force is not None:
            slope, difference, unlike = self.cone.compare_slopes(force)
            rises = self.cone.find_rising_coefficients_at(force)
        with collective_errors(self.comm):
            call_user_function(self.comm, "a law of friction", self.cone.raise_law_error)
        if force is None:
            return
        with collective_errors(self.comm):
            if unlike.any():
                k = int(unlike.argmax())
                raise ValueError(
                    f"the law of friction of contact pair {self.pair[k]} gives the slope "
                    f"{slope[k]:.6g} at the normal force {force[k]:.6g} of the node at "
                    f"{format_points(self.position[[k]])}, but differences of its limit give "
                    f"{difference[k]:.6g}: return the limit's derivative by the force"
                )
            if rises.any():
                k = int(rises.argmax())
                raise ValueError(
                    f"the law of friction of contact pair {self.pair[k]} has a coefficient, the "
                    f"limit over the normal force, that rises up to the normal force {force[k]:.6g}"
                    f" of the node at {format_points(self.position[[k]])}, or there: it may stay "
                    "or fall, so that its slope at zero bounds it"
                )

    @cached_property
    def interference(self) -> Array:
        """Depth (m,) of the points inside their surface, zero unless that is asked for."""
        return np.where(self._interfering, np.maximum(0.0, -self._by_pair("gap", None)), 0.0)

    def check_supports(self, normal: Array, gap: Array) -> None:
        """Raise ValueError if a point that a surface faces cannot move along its normal.

        Normals (m, dim) and gaps (m,) that are none are refused likewise.
        """
        self.refuse(np.isnan(gap), "see a surface whose gap is not a number")
        faced = np.isfinite(gap)
        length = np.linalg.norm(normal, axis=1)
        self.refuse(~(np.abs(length - 1) < _UNIT), "see a surface whose normal is no unit vector")
        along = np.where(self.equation < 0, normal, 0.0)
        held = np.abs(along).max(axis=1, initial=0) > _TANGENTIAL
        self.refuse(
            held & faced,
            "have a prescribed normal displacement: they cannot be in contact. Let the pair end "
            "one facet away from the support",
        )

    def check_supports_between(
        self, prescribed: PETSc.Vec, translations: Array, pressed: Mask
    ) -> None:
        """Raise ValueError where supports move the sides of a rough pair of bodies unlike.

        Only nodes (m,) that are `pressed` on the other body matter. Where supports move both alike,
        as on a plane of symmetry, there is no friction along them. `prescribed` (n,) is what they
        prescribe, translations are (pairs, dim), NaN where they are free.
        """
        held, counterpart = self._held_between, self._counterpart
        every = np.unique(self.gathered(counterpart[held]))
        if not len(every):
            return
        dim = held.shape[1]
        values = self.at_nodes(np.maximum(every, 0), prescribed)
        number = np.searchsorted(every, np.where(held, counterpart, every[0]))
        theirs = np.take_along_axis(values[number], np.arange(dim)[None, :, None], axis=2)[..., 0]
        theirs = theirs + translations[self.pair, :dim]
        own = self.at_points(prescribed)
        apart = np.where(counterpart < 0, np.inf, np.abs(own - theirs))
        allowed = _UNLIKE * (np.abs(own) + np.abs(theirs)) + ROUND_OFF * self.extent
        wrong = held & pressed[:, None] & ~(apart <= allowed)
        places = self.gathered(self.position[wrong.any(axis=1)])
        if len(places):
            raise ValueError(
                f"contact nodes at {format_points(places)} have a displacement along the surface "
                "that supports prescribe, but what they face is not moved in the same way: "
                "friction between two bodies is not known there. Prescribe the same of both sides, "
                "leave these nodes free, or make the body that is dragged along a rigid surface"
            )

    def _check_sides(self) -> None:
        pushed = np.sum(self.normals(None) * self.outward, axis=1)
        wrong = pushed > OUTWARDS * np.linalg.norm(self.outward, axis=1)
        known = np.any(self.outward != 0, axis=1) & np.isfinite(self.gaps(None))
        for k in range(self.pairs):
            right = self.gathered(~wrong[known & (self.pair == k)])
            if len(right) and not right.any():
                raise ValueError(
                    f"the surface of contact pair {k} pushes the body outwards at each of its "
                    "nodes: its direction is to point from the rigid into the body; reverse it"
                )

    def refuse(self, wrong: Mask, what: str) -> None:
        """Raises NoContactStated, with the positions of points, if there are any."""
        places = self.gathered(self.position[wrong])
        if len(places):
            raise NoContactStated(f"contact nodes at {format_points(places)} {what}")

    def gathered(self, values: npt.NDArray) -> npt.NDArray:
        return np.concatenate(self.comm.allgather(values))

    def in_order(self, pair: int, values: npt.NDArray) -> npt.NDArray:
        """Values (m, ...) at a pair's points of all processes, sorted by position."""
        return self.gathered(values[self.pair == pair])[self._order[pair]]

    def gather_pairs(self, values: Mapping[str, npt.NDArray]) -> list[dict[str, npt.NDArray]]:
        """Return values (m, ...) of each pair, at its points of all processes, as `in_order`."""
        of_ranks = self.comm.allgather((self.pair, dict(values)))
        return [
            {
                name: np.concatenate([part[name][pair == k] for pair, part in of_ranks])[order]
                for name in values
            }
            for k, order in enumerate(self._order)
        ]

    def local(self, states: Sequence[PairState], *names: str) -> list[npt.NDArray]:
        """Return attributes (m, ...) of the pairs' states at the points of this process."""
        own = list(zip(states, self._rows_in_order, strict=True))
        return [
            np.concatenate([getattr(state, name)[rows] for state, rows in own]) for name in names
        ]

    def rows(self, rows: sp.csr_matrix) -> PETSc.Mat:
        """A matrix with these rows on this process, of displacements, for all unknowns."""
        csr = (rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data)
        sizes = ((rows.shape[0], PETSc.DETERMINE), self.field.sizes)
        matrix = PETSc.Mat().createAIJ(sizes, csr=csr, comm=self.comm)
        return (
            matrix if self.field.is_whole_space else matrix.matMult(self.field.selection_matrix())
        )

    @cached_property
    def _order(self) -> list[npt.NDArray[np.intp]]:
        """Order by position of each pair's points as they are gathered."""
        return [
            order_by_position(
                self.gathered(self.position[self.pair == k]),
                self.gathered(self._beside[self.pair == k]),
            )
            for k in range(self.pairs)
        ]

    @cached_property
    def _rows_in_order(self) -> list[Indices]:
        """Places of this process' points of each pair among those of all, sorted by position."""
        rows = []
        for k, order in enumerate(self._order):
            counts = self.comm.allgather(int(np.sum(self.pair == k)))
            first = sum(counts[: self.comm.rank])
            rows.append(np.argsort(order)[first : first + counts[self.comm.rank]])
        return rows

    @property
    def own_nodes(self) -> Indices:
        """Numbers (m,) of the points' nodes on this process, which owns them."""
        first: int = self.field.space.dofmap.index_map.local_range[0]
        return np.asarray(self.node - first)

    @cached_property
    def first_nodes(self) -> list[Array]:
        """Position (1, dim) of each pair's first node: who has no points asks surfaces there.

        So all processes call a user's surface equally often, which may communicate.
        """
        return [self.in_order(k, self.position)[:1] for k in range(self.pairs)]

    @cached_property
    def extent(self) -> float:
        return float(extents(self.comm, self.position).max())

    def on_opposite(self, force: Array, force_operator: PETSc.Mat) -> list[Array]:
        """Return nodal forces (k, dim) of forces (m, dim) on the `opposite` nodes of each pair.

        `force_operator` is H, (n, m dim).
        """
        forces: list[Array] = [np.zeros((0, force.shape[1])) for _ in self.opposite]
        for k, nodes in enumerate(self.opposite):
            if len(nodes):
                points = force_operator.createVecRight()
                points.setArray(np.where((self.pair == k)[:, None], force, 0.0).ravel())
                forces[k] = self.at_nodes(nodes, force_operator * points)
        return forces

    def at_points(self, unknowns: PETSc.Vec) -> Array:
        """What unknowns (n,) have at the points' nodes, (m, dim)."""
        values = self.field.extract(unknowns).array_r.reshape(-1, self.position.shape[1])
        return np.asarray(values[self.own_nodes])

    def at_nodes(self, nodes: Indices, unknowns: PETSc.Vec) -> Array:
        """What unknowns (n,), or their equations, have at global nodes (k,): (k, dim)."""
        values = self.field.extract(unknowns).array_r.reshape(-1, self.position.shape[1])
        return gather_from_owners(self.field.space, nodes, values)

    def gaps(self, translations: Array | None) -> Array:
        """Gap (m,) of the undeformed body to the translated surfaces, as the unknowns see it.

        Gaps of a sibling's coefficients are T^-T g, as if gaps were displacements. A node keeps its
        own where any node on which its coefficient depends faces nothing.
        """
        gap, inverse = self._by_pair("gap", translations), self._inverse
        if inverse is None:
            return gap
        normal = self.normals(translations)
        faced = np.isfinite(gap)
        first, last = inverse.getOwnershipRange()
        dim = normal.shape[1]
        node = self.node - first // dim

        def transformed(values: Array) -> Array:
            vector = inverse.createVecRight()
            of_nodes = np.zeros(((last - first) // dim, dim))
            of_nodes[node] = values
            vector.setArray(of_nodes.ravel())
            return np.asarray((inverse * vector).array_r.reshape(-1, dim)[node])

        whole = np.abs(transformed(np.tile(faced[:, None], dim))[:, 0] - 1) < _UNIT
        away = transformed(np.where(faced, gap, 0.0)[:, None] * normal)
        return np.where(whole, np.sum(away * normal, axis=1), gap)

    def normals(self, translations: Array | None) -> Array:
        """Normals (m, dim) of the translated surfaces at the undeformed body."""
        return self._by_pair("normal", translations)

    def closest(self, moved: Array) -> tuple[Array, Array, Array]:
        """Gap (m,), normal (m, dim), its derivative (m, dim, dim) of points that have moved.

        They are zero in pairs of bodies; gaps are infinite where nothing faces a point.

        Raises:
            NotFound: if a point has no closest point.
        """
        gap, normal, bend = self.look_for_closest(moved)
        lost = self.gathered(self.position[np.isnan(gap)])
        if len(lost):
            raise NotFound.with_positions("contact nodes first at {} have no closest point", lost)
        return gap, normal, bend

    def look_for_closest(self, moved: Array) -> tuple[Array, Array, Array]:
        """Return the same as `closest`, with NaN for points that have no closest point."""
        dim = moved.shape[1]
        layout = "it takes points as rows (n, dim), gives (n,), (n, dim) and (n, dim, dim)"
        found = [np.zeros((len(moved), *shape)) for shape in ((), (dim,), (dim, dim))]
        # surfaces without closest points are refused before
        self._ask("closest", self.position + moved, found, layout)
        gap, normal, bend = found
        known = np.isfinite(gap) & np.isfinite(bend).all(axis=(1, 2)) | np.isposinf(gap)
        known &= np.isfinite(normal).all(axis=1)
        for values in found:
            values[~known] = np.nan
        return gap, normal, bend

    def check_closest(self, moved: Array, pressed: Mask) -> None:
        """Raise ValueError where a user's surface gives wrong derivatives at nodes (m,) in contact.

        These have moved (m, dim) in the frame of their surfaces.
        """
        x, step = self.position + moved, _DIFFERENCES * (self.extent or 1.0)
        users = [
            (k, surface, self.gathered(x[(self.pair == k) & pressed]))
            for k, surface in enumerate(self.surfaces)
            if k not in self.mortars and type(surface) not in BUILT_IN_CLOSEST_POINTS
        ]
        with collective_errors(self.comm):
            for k, surface, points in users:
                if not isinstance(surface, ClosestPointSurface) or not len(points):
                    continue
                whose = f"the closest points of the surface of contact pair {k}"
                wrong = call_user_function(
                    self.comm, whose, describe_wrong_derivatives, surface, points, step
                )
                if wrong:
                    raise ValueError(f"{whose} have the {wrong}: correct it")

    def _by_pair(self, what: Literal["gap", "normal"], translations: Array | None) -> Array:
        values = np.empty_like(self.position if what == "normal" else self.position[:, 0])
        gives = "(n, dim)" if what == "normal" else "(n,)"
        moved = 0.0 if translations is None else translations[self.pair]
        layout = f"it takes points as rows (n, dim) and gives {gives}"
        self._ask(what, self.position - moved, [values], layout)
        return values

    def _ask(self, what: str, x: Array, answers: Sequence[Array], layout: str) -> None:
        """Fill in what surfaces say of points x (m, dim), or raise what one of them raises.

        A user's surface is asked of the points of all processes on each of them, so that all call
        it equally often: it may communicate, or look for closest points until all are found. Its
        errors, and answers of the wrong shape, are a ValueError on all processes.
        """
        asked = [
            (k, surface, self.pair == k)
            for k, surface in enumerate(self.surfaces)
            if not (what == "closest" and k in self.mortars)
        ]
        if self._cannot_fail:
            for _, surface, mine in asked:
                given = getattr(surface, what)(x[mine])
                for values, known in zip(answers, _as_tuple(given, answers), strict=True):
                    values[mine] = known
            return
        name = "closest points" if what == "closest" else what
        pairs = []
        for k, surface, mine in asked:
            if type(surface) in _ASKED_LOCALLY:
                points, own = x[mine], slice(None)
            else:
                points, own = gather_points(self.comm, x[mine])
            if len(points):
                pairs.append((k, mine, points, own))
        with collective_errors(self.comm):
            for k, mine, points, own in pairs:
                whose = f"the {name} of the surface of contact pair {k}"
                given = call_user_function(
                    self.comm, whose, getattr(self.surfaces[k], what), points
                )
                for values, known in zip(answers, _as_tuple(given, answers), strict=True):
                    shape = (len(points), *values.shape[1:])
                    values[mine] = arguments.check_function_values(whose, known, shape, layout)[own]


def _as_tuple(given: Any, answers: Sequence[Array]) -> Sequence[Any]:  # noqa: ANN401
    """Return the answers of a surface's method, of which a single one is given alone."""
    return given if len(answers) > 1 else (given,)


def gather_points(comm: MPI.Comm, x: Array) -> tuple[Array, slice]:
    """Return the points (n, dim) of all processes, and which of them are this one's; collective."""
    parts = comm.allgather(x)
    first = sum(map(len, parts[: comm.rank]))
    return np.concatenate(parts), slice(first, first + len(x))


def extents(comm: MPI.Comm, x: Array) -> Array:
    """Extents (dim,) along the axes of points (n, dim) of all processes."""
    ends = np.stack([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, ends, MPI.MIN)
    return -ends.sum(axis=0)

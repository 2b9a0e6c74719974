"""Both sides of a pair of deformable surfaces: areas of what they share, results at the opposite.

Contact is stated at the nodes j of the pair's own side. Those k of the opposite side have the
forces that the mortar hands on, of each r_j a part M_jk / A_j, and areas likewise: with a_j the
area by which r_j is a pressure and n_j the normal, the area vector of node k is

    b_k = sum of M_jk a_j n_j / A_j.

It is along the normal, and its length divides the force on k. So an even pressure without shear is
one on both sides, whatever the meshes, also where facets face each other in part; and the
opposite's pressures times their areas sum up to the force. On flat faces |b_k| is the integral of
w_k over what faces the pair. The pressures are sums over duals that have either sign: where the
opposite mesh is the finer one they are off by a part of the differences of neighbouring p_j.

At large sliding the sides meet as they are deformed, while a_j is an area of the undeformed pair,
or of the deformed one for true pressures.

At the opposite nodes no law is stated. Forces are the nodes' own, pressures these over areas. Gap,
slip and friction are means of those of the pairs' nodes, weighted with integrals of the products
of both weights, and the status is that of which a node faces most.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.arrays import Array, Indices, Local, Mask
from pw_elements.checks import listed
from pw_elements.contact.interface import (
    Overlap,
    SlidingMortar,
    Trace,
    gathered_trace,
    of_owners,
    whole_areas,
)
from pw_elements.contact.iteration import OPEN
from pw_elements.contact.model import ContactState, PairState
from pw_elements.elasticity import Body, StressState, SurfaceNodes, facets_between

# Part of a node's area that has to face the other side for quotients by it. Where the pressure is
# linear, they are off by up to 0.3 % at a quarter, 1 % at a twentieth, and 10 % at a 200th
TRUSTED = 0.1
STATUSES = 4


# Largest difference of forces that are handed on, over the largest of them
_HANDED = 1e-6
# Part of an own node's area that faces the other side below which round-off of what it hands on,
# some 1e-16 over the part's square, is no longer small
_BARELY = 1e-4


@dataclass(frozen=True)
class OppositeResults:
    """Results at nodes (n) of opposite sides, summed over the pairs that they face."""

    facing: Array  # (n,), integrals of the nodes' weights over what they face
    gap: Array  # (n,), means times `facing`
    slip: Array  # (n, dim), likewise, of the nodes on the pair's own side
    friction: Array  # (n,), likewise
    statuses: Array  # (n, 4), what of `facing` is open, sticks, slips and is held
    pressed: Array  # (n,), normal forces, compression positive
    pulled: Array  # (n, dim), tangential ones, on the nodes
    area: Array  # (n,), that make pressures of forces; zero without a body
    tributary: Array  # (n,), the same from tributary areas
    share: Array  # (n,), part of the nodes' areas that faces a pair

    def on(self, rows: Local, n: int) -> "OppositeResults":
        """Spreads the results over n nodes, at rows of theirs; negative rows are left out."""
        values = []
        for part in fields(self):
            own = getattr(self, part.name)
            values.append(np.zeros((n, *own.shape[1:])))
            values[-1][rows[rows >= 0]] = own[rows >= 0]
        return OppositeResults(*values)

    def __add__(self, other: "OppositeResults") -> "OppositeResults":
        both = zip(vars(self).values(), vars(other).values(), strict=True)
        return OppositeResults(*(one + another for one, another in both))

    @property
    def faced(self) -> Mask:
        """Which nodes face a pair."""
        return self.facing > 0

    def mean(self, values: Array) -> Array:
        """`gap`, `slip` or `friction` over `facing`; zero where nothing is faced."""
        return (values.T / np.where(self.faced, self.facing, 1.0)).T

    @property
    def status(self) -> npt.NDArray[np.int8]:
        """Status (n,) of the greatest part of what each node faces."""
        return self.statuses.argmax(axis=1).astype(np.int8)

    @property
    def pressure(self) -> Array:
        """Pressure (n,) by measure 2; NaN where too little of a node's area faces a closed pair."""
        return self._over(self.pressed, self.area)

    @property
    def tributary_pressure(self) -> Array:
        """Pressure (n,) by measure 3; NaN where that by measure 2 is."""
        return self._over(self.pressed, self.tributary)

    @property
    def draw(self) -> float:
        """Largest force that draws, over the largest that presses; zero where nothing presses."""
        pressed = self.pressed.max(initial=0.0)
        return float(max(0.0, -self.pressed.min(initial=0.0)) / pressed) if pressed > 0 else 0.0

    @property
    def traction(self) -> Array:
        """Tangential traction (n, dim); NaN where the pressure is."""
        return self._over(self.pulled, self.area)

    def _over(self, force: Array, area: Array) -> Array:
        closed = np.delete(self.statuses, OPEN, axis=1).any(axis=1)
        over = np.where(closed, np.where(self.share < TRUSTED, np.nan, area), np.inf)
        return np.asarray((force.T / over).T)


@dataclass(frozen=True)
class Opposite:
    """The deformable surface of a pair, whose m nodes it faces; k nodes, on every process."""

    own: Indices  # (m,), global numbers of the pair's nodes
    node: Indices  # (k,), of its own
    means: sp.csr_array  # (k, m), integrals of products of both sides' weights
    handed: sp.csr_array | None  # (k, m), parts of the pair's forces as above; None without a body
    covered: Array  # (m,), part of the pair's nodes' areas that faces it
    barely: Mask  # (k,), those with forces of a node that barely faces them
    area: Array  # (k, dim), vectors as above, out of the pair's body; zero without a body
    tributary: Array  # (k, dim), the same from tributary areas
    share: Array  # (k,), part of the nodes' areas that faces the pair
    surface: SurfaceNodes | None  # None without a body

    def is_of(self, pair: PairState) -> bool:
        """Whether a pair has the same nodes."""
        return np.array_equal(self.own, pair.node) and np.array_equal(self.node, pair.opposite)

    def results(self, pair: PairState) -> OppositeResults:
        """Results at the nodes; a ValueError where the body's measure hands on other forces."""
        if self.handed is not None:
            off = np.abs(pair.opposite_force + self.handed @ pair.force_vector)[~self.barely]
            if off.max(initial=0.0) > _HANDED * np.abs(pair.opposite_force).max(initial=0.0):
                raise ValueError(
                    "a pair's forces on a deformable surface are not of the body's measure: "
                    "DeformableSurface is to be revolved=True in axisymmetry, and only there"
                )
        facing = np.asarray(self.means.sum(axis=1))
        length = np.linalg.norm(self.area, axis=1)
        normal = self.normal
        pressed = np.sum(pair.opposite_force * normal, axis=1)
        gap = np.where(np.isfinite(pair.gap), pair.gap, 0.0)
        return OppositeResults(
            facing,
            self.means @ gap,
            self.means @ pair.slip,
            self.means @ pair.friction,
            self.means @ np.eye(STATUSES)[pair.status],
            pressed,
            pair.opposite_force - pressed[:, None] * normal,
            length,
            np.linalg.norm(self.tributary, axis=1),
            self.share,
        )

    def vectors(self, pair: PairState, area: Array) -> Array:
        """Area vectors (k, dim) of whole areas (m,) of the pair's nodes; zero without a body."""
        if self.handed is None:
            return np.zeros_like(self.area)
        return -np.asarray(self.handed @ ((area * self.covered)[:, None] * pair.normal))

    @property
    def normal(self) -> Array:
        """Unit normals (k, dim) out of the pair's body; zero where nothing faces it."""
        length = np.linalg.norm(self.area, axis=1, keepdims=True)
        return np.asarray(self.area / np.where(length > 0, length, 1.0))


def mortar_sides(
    number: int, state: ContactState, body: Body | None, space: fem.FunctionSpace
) -> tuple[SurfaceNodes | None, Opposite | None]:
    """A pair's own surface, with a body, and what it faces, where that is deformable.

    The space is that of the displacements. Areas of the own surface are of what faces the opposite
    one, and NaN where that is too little for a pressure; nodes that face nothing have their whole
    areas, and no forces. At large sliding the own surface has whole areas.
    """
    pair, deformed = state.pairs[number], state.smallness is None
    own = None if body is None else _surface(number, pair, body, space)
    if not len(pair.opposite):
        return own, None
    nodes = pair.node, pair.opposite
    one, other = (gathered_trace(space, facets_between(space, side)) for side in nodes)
    revolved = body is not None and body.state is StressState.AXISYMMETRIC
    if not deformed:
        means, duals = _fixed(space, pair, one, other, revolved)
        covered = np.asarray(duals.sum(axis=0))
        handed = duals @ sp.diags_array(1 / np.where(covered > 0, covered, 1.0))
    else:
        mortar = SlidingMortar(one, other, revolved)
        moved = state.displacement.array_r.reshape(-1, mortar.x.shape[1])
        x = mortar.x + of_owners(space, mortar.nodes, moved)
        x[mortar.slaves :] += pair.translation
        slaves, masters = (np.searchsorted(np.sort(side), side) for side in nodes)
        mortar.kept[slaves] = pair.normal != 0
        met = mortar.meet(x)
        covered, handed = met.areas[slaves], met.parts[slaves][:, masters].T
        means = -met.rows[slaves][:, mortar.slaves + masters].T @ sp.diags_array(covered)
        one, other = one.moved(x[: mortar.slaves]), other.moved(x[mortar.slaves :])
    if own is None or body is None:
        none = np.zeros_like(pair.opposite_force)
        return None, Opposite(
            *nodes, means, None, covered, none[:, 0] > 0, none, none, none[:, 0], None
        )
    whole, opposite_whole = (
        whole_areas(trace, revolved)[np.searchsorted(trace.nodes, side)]
        for trace, side in zip((one, other), nodes, strict=True)
    )
    share = covered / whole
    barely = np.asarray(abs(handed) @ (share < _BARELY) > 0)
    part = (handed @ covered) / opposite_whole
    opposite = SurfaceNodes.of(body, facets_between(space, pair.opposite))
    if not np.array_equal(opposite.node, pair.opposite):
        raise ValueError(f"contact pair {number} faces a surface that has two nodes at one place")
    own_areas = own.own_area, own.tributary_area
    if not deformed:
        counts = np.where(covered > 0, np.where(share < TRUSTED, np.nan, share), 1.0)
        counted = [area * counts for area in own_areas]
        own = replace(own, own_area=counted[0], tributary_area=counted[1])
    none = np.zeros_like(pair.opposite_force)
    seen = Opposite(*nodes, means, handed, share, barely, none, none, part, opposite)
    area, tributary = (seen.vectors(pair, area) for area in own_areas)
    return own, replace(seen, area=area, tributary=tributary)


def _fixed(
    space: fem.FunctionSpace, pair: PairState, one: Trace, other: Trace, revolved: bool
) -> tuple[sp.csr_array, sp.csr_array]:
    """Integrals (k, m) of the opposite's weights times the pair's, undeformed, and their duals."""
    first, last = space.dofmap.index_map.local_range
    mine = np.flatnonzero((pair.node >= first) & (pair.node < last))
    overlap = Overlap.of(one, other, pair.node[mine], revolved=False)
    means = _integrals(space, pair, overlap, mine, overlap.weight)
    if revolved:
        overlap = Overlap.of(one, other, pair.node[mine], revolved)
    return means, _integrals(space, pair, overlap, mine, overlap.dual)


def _integrals(
    space: fem.FunctionSpace, pair: PairState, overlap: Overlap, mine: Indices, tested: Array
) -> sp.csr_array:
    """Integrals (k, m) of the opposite's weights times functions of the nodes `mine`."""
    node, opposite = pair.node, pair.opposite
    at, w = overlap.functions[2]
    order = np.argsort(opposite)
    at = order[np.searchsorted(opposite, at, sorter=order)]
    found = overlap.integrals(tested, at, w, (len(mine), len(opposite))).tocoo()
    every = zip(*space.mesh.comm.allgather((found.col, mine[found.row], found.data)), strict=True)
    row, column, value = (np.concatenate(parts) for parts in every)
    return sp.csr_array((value, (row, column)), shape=(len(opposite), len(node)))


def _surface(number: int, pair: PairState, body: Body, space: fem.FunctionSpace) -> SurfaceNodes:
    """The surface of a pair: the facets that have all their nodes in it."""
    facets = facets_between(space, pair.node)
    lone = pair.position
    if space.mesh.comm.allreduce(len(facets)):
        surface = SurfaceNodes.of(body, facets)
        if np.array_equal(surface.node, pair.node):
            return surface
        lone = pair.position[~np.isin(pair.node, surface.node)]
    raise ValueError(
        f"contact pair {number}: its nodes at {listed(lone)} belong to no facet that has all of "
        "its nodes in the pair, so that they have no pressure: let the pair end at vertices, or "
        "give it the nodes of whole facets, fem.locate_dofs_topological(space, dim - 1, facets)"
    )


def over_areas(surface: SurfaceNodes, pair: PairState) -> tuple[Array, Array, Array]:
    """A pair's pressures by measures 2 and 3, and its traction; zero at open nodes of NaN areas."""
    none = np.isnan(surface.own_area) & (pair.status == OPEN)
    pressure, tributary, traction = (
        np.where(none, 0.0, values.T).T
        for values in (
            surface.pressure(pair.force_normal),
            surface.tributary_pressure(pair.force_normal),
            surface.pressure(pair.force_tangential),
        )
    )
    return pressure, tributary, traction

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

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.arrays import Array, Indices
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


@dataclass(frozen=True)
class OppositeResults:
    """Results at the nodes (k) of an opposite side; pressures are NaN without a body."""

    normal: Array  # (k, dim), out of the pair's body; zero where nothing faces it
    gap: Array  # (k,)
    slip: Array  # (k, dim), of the nodes on the pair's own side
    friction: Array  # (k,)
    status: npt.NDArray[np.int8]  # (k,)
    pressed: Array  # (k,), normal forces, compression positive
    pressure: Array  # (k,), NaN where too little of a node's area faces a closed pair
    traction: Array  # (k, dim), tangential; NaN where the pressure is

    @property
    def draw(self) -> float:
        """Largest force that draws, over the largest that presses; zero where nothing presses."""
        pressed = self.pressed.max(initial=0.0)
        return float(max(0.0, -self.pressed.min(initial=0.0)) / pressed) if pressed > 0 else 0.0


@dataclass(frozen=True)
class Opposite:
    """The deformable surface of a pair, whose m nodes it faces; k nodes, on every process."""

    node: Indices  # (k,), global numbers
    facing: Array  # (k,), integrals of the nodes' weights over what they face
    means: sp.csr_array  # (k, m), means over the pair's nodes; zero where nothing is faced
    handed: sp.csr_array  # (k, m), parts of the pair's forces as above
    covered: Array  # (m,), part of the pair's nodes' areas that faces it
    share: Array  # (k,), part of the nodes' areas that faces the pair; zero without a body
    own_area: Array  # (m,), of the pair's nodes
    surface: SurfaceNodes | None  # None without a body

    def results(self, pair: PairState, own_area: Array | None = None) -> OppositeResults:
        """Results at the nodes; of true pressures with areas (m,) of the deformed pair."""
        area = self.own_area if own_area is None else own_area
        vectors = -np.asarray(self.handed @ ((area * self.covered)[:, None] * pair.normal))
        length = np.linalg.norm(vectors, axis=1)
        normal = (vectors.T / np.where(length > 0, length, 1.0)).T
        pressed = np.sum(pair.opposite_force * normal, axis=1)
        statuses = self.means @ np.eye(STATUSES)[pair.status]
        closed = np.delete(statuses, OPEN, axis=1).any(axis=1)
        over = np.where(closed, np.where(self.share < TRUSTED, np.nan, length), np.inf)
        return OppositeResults(
            normal,
            self.means @ np.where(np.isfinite(pair.gap), pair.gap, 0.0),
            self.means @ pair.slip,
            self.means @ pair.friction,
            statuses.argmax(axis=1).astype(np.int8),
            pressed,
            pressed / over,
            ((pair.opposite_force - pressed[:, None] * normal).T / over).T,
        )


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
    facing = np.asarray(means.sum(axis=1))
    means = sp.diags_array(1 / np.where(facing > 0, facing, 1.0)) @ means
    if own is None or body is None:
        none = np.zeros(len(pair.opposite))
        return None, Opposite(nodes[1], facing, means, handed, covered, none, 0 * covered, None)
    whole, opposite_whole = (
        whole_areas(trace, revolved)[np.searchsorted(trace.nodes, side)]
        for trace, side in zip((one, other), nodes, strict=True)
    )
    opposite = SurfaceNodes.of(body, facets_between(space, pair.opposite))
    if not np.array_equal(opposite.node, pair.opposite):
        raise ValueError(f"contact pair {number} faces a surface that has two nodes at one place")
    share, part = covered / whole, (handed @ covered) / opposite_whole
    seen = Opposite(nodes[1], facing, means, handed, share, part, own.own_area, opposite)
    if not deformed:
        counts = np.where(covered > 0, np.where(share < TRUSTED, np.nan, share), 1.0)
        areas = own.own_area * counts, own.tributary_area * counts
        own = replace(own, own_area=areas[0], tributary_area=areas[1])
    return own, seen


def _fixed(
    space: fem.FunctionSpace, pair: PairState, one: Trace, other: Trace, revolved: bool
) -> tuple[sp.csr_array, sp.csr_array]:
    """Integrals (k, m) of the opposite's weights times the pair's, undeformed, and their duals."""
    first, last = space.dofmap.index_map.local_range
    mine = np.flatnonzero((pair.node >= first) & (pair.node < last))
    overlap, k = Overlap.of(one, other, pair.node[mine], revolved), len(pair.opposite)
    at, w = overlap.functions[2]
    order = np.argsort(pair.opposite)
    at = order[np.searchsorted(pair.opposite, at, sorter=order)]

    def gathered(tested: Array) -> sp.csr_array:
        found = overlap.integrals(tested, at, w, (len(mine), k)).tocoo()
        every = space.mesh.comm.allgather((found.col, mine[found.row], found.data))
        row, column, value = (np.concatenate(parts) for parts in zip(*every, strict=True))
        return sp.csr_array((value, (row, column)), shape=(k, len(pair.node)))

    return gathered(overlap.weight), gathered(overlap.dual)


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

"""States as functions on the body.

    fields = ContactFields.of(states[-1], body)  # fields.pressure, fields.gap, fields.status ...

Without the body, its trial space in place of it, there are no pressures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import ufl
from dolfinx import fem

from pw_elements.arrays import Array, Indices, LocalIndices
from pw_elements.checks import (
    arguments,
    check_same_arguments,
    collective_errors,
    format_points,
    vector_sizes,
)
from pw_elements.contact.interface import (
    Overlap,
    SlidingMortar,
    Trace,
    compute_tributary_areas,
    gather_trace,
)
from pw_elements.contact.model import ContactState, PairState
from pw_elements.contact.nodes import HELD, OPEN
from pw_elements.elasticity import (
    Body,
    StressState,
    SurfaceNodes,
    boundary_measure,
    facets_with_all_nodes,
)
from pw_elements.spaces import (
    SubSpace,
    as_function,
    assemble_vector,
    gather_from_owners,
    is_hybrid,
    scalar_space,
    split,
    test_space,
)

# Largest difference of a node's positions in a state and in the space, over the largest coordinate
_NEAR = 1e-9
# Of squares of stresses and pressures, both linear
_INDICATOR_DEGREE = 2
STATE_REMEDY = "solve_contact gives a list of states, ContactProblem.step one of them"
# Part of a node's area that has to face the other side for quotients by it. Where the pressure is
# linear, they are off by up to 0.3 % at a quarter, 1 % at a twentieth, and 10 % at a 200th
_TRUSTED = 0.1


@dataclass(frozen=True)
class SideResults:
    """Results at the nodes (k) of one side of a pair; pressures are NaN without a body."""

    normal: Array  # (k, dim), into the side's own body; zero where it faces nothing
    gap: Array  # (k,)
    slip: Array  # (k, dim), of the nodes on the pair's own side
    friction: Array  # (k,)
    status: npt.NDArray[np.int8]  # (k,)
    pressed: Array  # (k,), normal forces, compression positive
    pressure: Array  # (k,), NaN where too little of a node's area faces a closed pair
    traction: Array  # (k, dim), tangential; NaN where the pressure is

    @property
    def draw(self) -> float:
        """Largest tensile nodal force over the largest compressive one; 0 without compression."""
        pressed = self.pressed.max(initial=0.0)
        return float(max(0.0, -self.pressed.min(initial=0.0)) / pressed) if pressed > 0 else 0.0


@dataclass(frozen=True)
class Opposite:
    """The deformable surface of a pair, whose m nodes it faces; k nodes, on every process.

    Its nodes have areas that are handed on as forces are: see the guide's page on theory ("Two
    bodies"). Means are weighted with integrals of the products of both weights.
    """

    node: Indices  # (k,), global numbers
    facing: Array  # (k,), integrals of the nodes' weights over what they face
    means: sp.csr_array  # (k, m), means over the pair's nodes; zero where nothing is faced
    handed: sp.csr_array  # (k, m), parts of the pair's forces as above
    covered: Array  # (m,), part of the pair's nodes' areas that faces it
    share: Array  # (k,), part of the nodes' areas that faces the pair; zero without a body
    own_area: Array  # (m,), of the pair's nodes
    surface: SurfaceNodes | None  # None without a body

    def results(self, pair: PairState, own_area: Array | None = None) -> SideResults:
        """Results at the nodes; of true pressures with areas (m,) of the deformed pair."""
        area = self.own_area if own_area is None else own_area
        vectors = -np.asarray(self.handed @ ((area * self.covered)[:, None] * pair.normal))
        length = np.linalg.norm(vectors, axis=1)
        normal = (vectors.T / np.where(length > 0, length, 1.0)).T
        pressed = np.sum(pair.opposite_force * normal, axis=1)
        statuses = self.means @ np.eye(HELD + 1)[pair.status]
        closed = np.delete(statuses, OPEN, axis=1).any(axis=1)
        over = np.where(closed, np.where(self.share < _TRUSTED, np.nan, length), np.inf)
        return SideResults(
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
    if not len(pair.opposite_node):
        return own, None
    nodes = pair.node, pair.opposite_node
    one, other = (gather_trace(space, facets_with_all_nodes(space, side)) for side in nodes)
    revolved = body is not None and body.state is StressState.AXISYMMETRIC
    if not deformed:
        means, duals = _fixed(space, pair, one, other, revolved)
        covered = np.asarray(duals.sum(axis=0))
        handed = duals @ sp.diags_array(1 / np.where(covered > 0, covered, 1.0))
    else:
        mortar = SlidingMortar(one, other, revolved)
        moved = state.displacement.array_r.reshape(-1, mortar.x.shape[1])
        x = mortar.x + gather_from_owners(space, mortar.nodes, moved)
        x[mortar.n_slave_nodes :] += pair.translation
        slaves, masters = (np.searchsorted(np.sort(side), side) for side in nodes)
        mortar.allowed_components[slaves] = pair.normal != 0
        met = mortar.linearise(x)
        covered, handed = met.areas[slaves], met.master_fractions[slaves][:, masters].T
        means = -met.distance_rows[slaves][:, mortar.n_slave_nodes + masters].T @ sp.diags_array(
            covered
        )
        one, other = (
            one.with_positions(x[: mortar.n_slave_nodes]),
            other.with_positions(x[mortar.n_slave_nodes :]),
        )
    facing = np.asarray(means.sum(axis=1))
    means = sp.diags_array(1 / np.where(facing > 0, facing, 1.0)) @ means
    if own is None or body is None:
        none = np.zeros(len(pair.opposite_node))
        return None, Opposite(nodes[1], facing, means, handed, covered, none, 0 * covered, None)
    whole, opposite_whole = (
        compute_tributary_areas(trace, revolved)[np.searchsorted(trace.nodes, side)]
        for trace, side in zip((one, other), nodes, strict=True)
    )
    opposite = SurfaceNodes.from_body(body, facets_with_all_nodes(space, pair.opposite_node))
    if not np.array_equal(opposite.node, pair.opposite_node):
        raise ValueError(f"contact pair {number} faces a surface that has two nodes at one place")
    share, part = covered / whole, (handed @ covered) / opposite_whole
    seen = Opposite(nodes[1], facing, means, handed, share, part, own.weight_area, opposite)
    if not deformed:
        counts = np.where(covered > 0, np.where(share < _TRUSTED, np.nan, share), 1.0)
        areas = own.weight_area * counts, own.tributary_area * counts
        own = replace(own, weight_area=areas[0], tributary_area=areas[1])
    return own, seen


def _fixed(
    space: fem.FunctionSpace, pair: PairState, one: Trace, other: Trace, revolved: bool
) -> tuple[sp.csr_array, sp.csr_array]:
    """Integrals (k, m) of the opposite's weights times the pair's, undeformed, and their duals."""
    first, last = space.dofmap.index_map.local_range
    mine = np.flatnonzero((pair.node >= first) & (pair.node < last))
    overlap, k = Overlap.from_traces(one, other, pair.node[mine], revolved), len(pair.opposite_node)
    at, w = overlap.functions[2]
    order = np.argsort(pair.opposite_node)
    at = order[np.searchsorted(pair.opposite_node, at, sorter=order)]

    def gathered(tested: Array) -> sp.csr_array:
        found = overlap.assemble_integrals(tested, at, w, (len(mine), k)).tocoo()
        every = space.mesh.comm.allgather((found.col, mine[found.row], found.data))
        row, column, value = (np.concatenate(parts) for parts in zip(*every, strict=True))
        return sp.csr_array((value, (row, column)), shape=(k, len(pair.node)))

    return gathered(overlap.weight), gathered(overlap.dual)


def _surface(number: int, pair: PairState, body: Body, space: fem.FunctionSpace) -> SurfaceNodes:
    surface = SurfaceNodes.from_body(body, facets_with_all_nodes(space, pair.node))
    if not np.array_equal(surface.node, pair.node):
        lone = pair.position[~np.isin(pair.node, surface.node)]
        raise ValueError(
            f"contact pair {number}: its nodes at {format_points(lone)} belong to no facet that "
            "has all of its nodes in the pair, so that they have no pressure: let the pair end at "
            "vertices, or give it the nodes of whole facets, fem.locate_dofs_topological"
        )
    return surface


def own_results(surface: SurfaceNodes, pair: PairState) -> SideResults:
    """Results at a pair's own nodes; quotients are zero at open nodes of NaN areas."""
    none = np.isnan(surface.weight_area) & (pair.status == OPEN)
    pressure, traction = (
        np.where(none, 0.0, surface.pressure(force).T).T
        for force in (pair.force_normal, pair.force_tangential)
    )
    known = pair.normal, pair.gap, pair.slip, pair.friction, pair.status, pair.force_normal
    return SideResults(*known, pressure, traction)


@dataclass(frozen=True)
class ContactFields:
    """A state as functions: vectors in the trial space, scalars in the space of its components.

    Fields of the contact surface are zero elsewhere, except for the gap, which is NaN, because zero
    would mean contact. ParaView draws NaN in a separate colour and ignores it in ranges. Where
    nodes match, the nodes that a pair's own face have the same scalars and the opposite vectors.

    Nodes of a deformable surface have pressures and tractions of their own forces, over the areas
    that face the pair (see `Opposite`). The law is not stated there: gap and slip are means of
    those of the pair's nodes that they face, and the status is the prevailing one; nodes that face
    two pairs have the forces of both and the rest of the one that they face most. On both sides,
    pressures and tractions are NaN at loaded nodes of whose area less than a tenth faces the other
    side: the forces are right there, but not their quotients by such an area. At large sliding
    the areas are those of the pair's own nodes, which hand them on as they do their forces.

    Pressures are forces over areas and need the body (thickness, circumference); they are None if
    only the space is given. `SurfaceNodes` explains the three measures of pressure. They
    are nodal values: interpolated by the *test* functions, linearly between nodes where the weights
    are linear, they integrate to the total force. The functions here interpolate by the trial
    functions, and their integrals are only close to it.

    Pressures are nominal: over areas of the undeformed surface. At large strains the true pressure
    of node i, with its test function w_i and the deformation gradient F = I + grad u, is

        p_i = force_normal_i / integral of w_i |det F F^-T N| dA.

    Args:
        displacement: vector.
        force: vector, "contact_force": of the surface on the body at each node.
        gap: scalar; NaN off the contact surface and at nodes that nothing faces.
        slip: vector, of this increment.
        status: scalar, OPEN (0), STICK (1), SLIP (2) or HELD (3); OPEN off the surface.
        pressure: scalar, compression positive: the normal nodal force over the integral of the
            node's own test function (measure 2); NaN where a node has no weight.
        tributary_pressure: scalar, the same over the node's tributary area (measure 3); `pressure`
            at nodes of a deformable surface, whose weights are linear.
        traction: vector, the tangential force of the surface on the body over the area that
            `pressure` has.
        surfaces: `SurfaceNodes` of each pair, () without body; at small sliding with the areas that
            face a deformable surface.
        opposite: of each pair the deformable surface that it faces, or None; its `results` of a
            `PairState` are arrays (k, ...) at the nodes there, on every process.
        body_pressure: scalar, the pressure that is an unknown of hybrid bodies, everywhere; None
            of others. Where materials meet it is that of either side.
        hybrid: mixed trial space of a hybrid body; None of others.
        true_pressure: scalar, as above, the thickness being that of the body; None unless the
            state is one of `ContactProblem.of_residual` and the body is given. NaN where `pressure`
            is.
        body: the body, if it was given; else None.
    """

    displacement: fem.Function
    force: fem.Function
    gap: fem.Function
    slip: fem.Function
    status: fem.Function
    pressure: fem.Function | None
    tributary_pressure: fem.Function | None
    traction: fem.Function | None
    surfaces: tuple[SurfaceNodes, ...]
    opposite: tuple[Opposite | None, ...]
    body_pressure: fem.Function | None = None
    hybrid: fem.FunctionSpace | None = None
    true_pressure: fem.Function | None = None
    body: Body | None = None

    @classmethod
    @check_same_arguments
    def of(cls, state: ContactState, body: Body | fem.FunctionSpace) -> "ContactFields":
        """Functions with the values of a state; every process calls it.

        Args:
            state: of a contact problem on the space.
            body: whose contact it is; its trial space serves all but the pressures.

        Raises:
            TypeError: for arguments of the wrong type.
            ValueError: for a state of another space, or if pressures are asked for and a node
                belongs to no facet that has all of its nodes in the pair.
        """
        space = trial_space(body)
        check_state(state, space)
        scalars = scalar_space(space)
        known, whole = (body, body.spaces.trial) if isinstance(body, Body) else (None, body)

        def function(name: str, of: fem.FunctionSpace, wanted: bool) -> fem.Function | None:
            return fem.Function(of, name=name) if wanted else None

        sides = [mortar_sides(k, state, known, space) for k in range(len(state.pairs))]
        fields = cls(
            fem.Function(space, name="displacement"),
            fem.Function(space, name="contact_force"),
            fem.Function(scalars, name="gap"),
            fem.Function(space, name="slip"),
            fem.Function(scalars, name="status"),
            function("pressure", scalars, known is not None),
            function("tributary_pressure", scalars, known is not None),
            function("traction", space, known is not None),
            tuple(surface for surface, _ in sides if surface is not None),
            tuple(opposite for _, opposite in sides),
            function("body_pressure", scalars, is_hybrid(whole)),
            whole if is_hybrid(whole) else None,
            function("true_pressure", scalars, known is not None and state.smallness is None),
            known,
        )
        fields.fill(state)
        return fields

    @check_same_arguments
    def fill(self, state: ContactState) -> None:
        """Gives the functions the values of another state.

        Args:
            state: another one of the same problem.

        Raises:
            ValueError: for one of another space or other pairs.
        """
        space = self.displacement.function_space
        check_state(state, space)
        pairs = state.pairs
        known, given = ([part.node.tolist() for part in parts] for parts in (self.surfaces, pairs))
        faced = [[] if side is None else side.node.tolist() for side in self.opposite]
        if known not in ([], given) or faced != [pair.opposite_node.tolist() for pair in pairs]:
            raise ValueError("the state has other contact nodes than the fields")
        if state.smallness is None:  # who faces whom has changed
            both = [mortar_sides(k, state, self.body, space) for k in range(len(pairs))]
            object.__setattr__(self, "opposite", tuple(other for _, other in both))
        as_function(space, state.displacement, out=self.displacement)
        _spread(self.force, pairs, [pair.force_vector for pair in pairs])
        for pair in pairs:
            here = _here(space, pair.opposite_node)
            forces = self.force.x.array.reshape(-1, space.dofmap.index_map_bs)
            forces[here[here >= 0]] += pair.opposite_force[here >= 0]
        gaps = [np.where(np.isfinite(pair.gap), pair.gap, np.nan) for pair in pairs]
        _spread(self.gap, pairs, gaps, np.nan)
        _spread(self.slip, pairs, [pair.slip for pair in pairs])
        _spread(self.status, pairs, [pair.status for pair in pairs])
        own = [own_results(s, p) for s, p in zip(self.surfaces, pairs, strict=False)]
        _spread(self.pressure, pairs, [side.pressure for side in own])
        _spread(self.traction, pairs, [side.traction for side in own])
        tributary = [
            np.where(side.pressure == 0, 0.0, surface.tributary_pressure(side.pressed))
            for side, surface in zip(own, self.surfaces, strict=True)
        ]
        _spread(self.tributary_pressure, pairs, tributary)
        deformed = self._deformed(pairs)
        true = [
            np.where(np.isnan(side.pressure), np.nan, surface.pressure(side.pressed))
            for side, surface in zip(own, deformed, strict=False)
        ]
        _spread(self.true_pressure, pairs, true)
        self._fill_opposite(pairs, deformed)
        if self.body_pressure is not None and self.hybrid is not None:
            self.body_pressure.interpolate(split(self.hybrid, state.unknowns)[1])

    def _deformed(self, pairs: Sequence[PairState]) -> list[SurfaceNodes]:
        """The pairs' own surfaces with areas as they are deformed, if true pressures are wanted."""
        if self.true_pressure is None or self.body is None:
            return []
        space, u = self.displacement.function_space, self.displacement
        stretch = SurfaceNodes.stretch(u)
        if self.body.state is StressState.AXISYMMETRIC:
            stretch *= 1 + u[0] / ufl.SpatialCoordinate(space.mesh)[0]
        facets = [facets_with_all_nodes(space, pair.node) for pair in pairs]
        return [SurfaceNodes.from_body(self.body, where, stretch) for where in facets]

    def _fill_opposite(self, pairs: Sequence[PairState], deformed: Sequence[SurfaceNodes]) -> None:
        """Results at nodes that face pairs and are in none: of the pair that they face most."""
        space = self.displacement.function_space
        most = np.zeros(len(self.gap.x.array))
        for pair in pairs:
            here = _here(space, np.concatenate([pair.node, pair.faced_node]))
            most[here[here >= 0]] = np.inf
        for k, (other, pair) in enumerate(zip(self.opposite, pairs, strict=True)):
            if other is None:
                continue
            seen, here = other.results(pair), _here(space, pair.opposite_node)
            mine = (here >= 0) & (other.facing > most[here])
            at = here[mine]
            most[at] = other.facing[mine]
            true = other.results(pair, deformed[k].weight_area).pressure if deformed else None
            for out, values in (
                (self.gap, seen.gap),
                (self.status, seen.status),
                (self.slip, -seen.slip),
                (self.pressure, seen.pressure),
                (self.tributary_pressure, seen.pressure),
                (self.traction, seen.traction),
                (self.true_pressure, true),
            ):
                if out is not None and values is not None:
                    block = out.function_space.dofmap.index_map_bs
                    out.x.array.reshape(-1, block)[at] = values[mine].reshape(-1, block)

    @check_same_arguments
    def indicator(self) -> fem.Function:
        """Error indicator, one value per cell, which says where to refine the contact surfaces.

        Stresses have larger errors than nodal forces, so that the distance of both is about the
        error of stresses: over the part of the pairs' own surfaces in cell K,

            eta_K^2 = integral of (n·sigma n + p)^2,

        with the nodal pressures p interpolated by the weight functions.

        The root of the sum of squares is the error of all, in stress times root of area. It is zero
        in cells off these surfaces, and where a node has no pressure.

        Raises:
            ValueError: without the body, of a hybrid one, and at large strains, where the material
                of a body is not that of the residual; where nodes have no weight, as the corners
                of the standard 10-node tetrahedron.
        """
        if self.body is None or self.pressure is None or self.hybrid or self.true_pressure:
            raise ValueError(
                "stresses follow from the displacements of a Body at small strains, one that is "
                "not hybrid: give it to ContactFields.of, or integrate your own stress"
            )
        if any(np.isnan(each.pressure(each.weight_area)).any() for each in self.surfaces):
            raise ValueError(
                "nodes of this element have no weight on the surface, so no pressure to compare "
                "with stresses: Spaces.petrov_galerkin gives them one"
            )
        mesh, weights = self.body.spaces.mesh, test_space(self.pressure.function_space)
        facets = [
            facets_with_all_nodes(self.displacement.function_space, s.node) for s in self.surfaces
        ]
        surface = boundary_measure(mesh, np.unique(np.concatenate(facets)), _INDICATOR_DEGREE)
        p, n = fem.Function(weights), ufl.FacetNormal(mesh)
        p.x.array[:] = self.pressure.x.array
        stress = self.body.stress(self.displacement)
        sides = range(len(n))  # in axisymmetry stress has a hoop, too
        pull = sum(n[i] * stress[i, j] * n[j] for i in sides for j in sides)
        cells = fem.functionspace(mesh, ("Discontinuous Lagrange", 0))
        squares = assemble_vector((pull + p) ** 2 * ufl.TestFunction(cells) * surface)
        found = as_function(cells, squares, "error_indicator")
        found.x.array[:] = np.sqrt(np.nan_to_num(found.x.array))
        return found

    def functions(self) -> list[fem.Function]:
        """All functions, in the order of the attributes."""
        return [value for value in vars(self).values() if isinstance(value, fem.Function)]


def _spread(
    out: fem.Function | None,
    pairs: Sequence[PairState],
    values: Sequence[npt.NDArray],
    elsewhere: float = 0.0,
) -> None:
    """Fills a function with values (m,) or (m, dim) at the nodes of pairs."""
    if out is None:
        return
    space = out.function_space
    array = out.x.array.reshape(-1, space.dofmap.index_map_bs)
    array[:] = elsewhere
    for pair, own in zip(pairs, values, strict=True):
        columns = own.reshape(len(own), -1)
        for nodes, sign in ((pair.node, 1.0), (pair.faced_node, 1.0 if own.ndim == 1 else -1.0)):
            here = _here(space, nodes)
            array[here[here >= 0]] = sign * columns[here >= 0]


def _here(space: fem.FunctionSpace, nodes: Indices) -> LocalIndices:
    """Local numbers (m,) of nodes, ghosts too; -1 for those of other processes, and no nodes."""
    local = space.dofmap.index_map.global_to_local(np.maximum(nodes, 0))
    return np.where(nodes < 0, -1, local)


def trial_space(body: Body | fem.FunctionSpace) -> fem.FunctionSpace:
    kinds = (Body, fem.FunctionSpace)
    arguments.check_type("body", body, kinds, "it has to be a Body, or its trial space")
    if not isinstance(body, Body):
        arguments.check_space(body)
    return SubSpace.displacements(body.spaces.trial if isinstance(body, Body) else body).space


def check_state(state: ContactState, space: fem.FunctionSpace) -> None:
    first, last = space.dofmap.index_map.local_range
    x = space.tabulate_dof_coordinates()[:, : space.mesh.geometry.dim]
    with collective_errors(space.mesh.comm):
        arguments.check_type("state", state, ContactState, STATE_REMEDY)
        alike = state.displacement.getSizes() == vector_sizes(space)
        for pair in state.pairs if alike else ():
            mine = (pair.node >= first) & (pair.node < last)
            away = np.abs(x[pair.node[mine] - first] - pair.position[mine])
            alike &= bool(away.max(initial=0.0) <= _NEAR * np.abs(pair.position).max(initial=0.0))
        if not alike:
            raise ValueError("the state belongs to another space, or other processes, than this")

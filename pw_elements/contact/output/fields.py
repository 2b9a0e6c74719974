"""Results of a contact state as functions on the body: forces, pressures, gap, slip and status.

    fields = ContactFields.from_state(states[-1], body)
    fields.pressure, fields.gap, fields.status

If the trial space is given in place of the body, the fields have no pressures. The module
guarantees that each pressure times its area equals the normal nodal force. It assumes that the
state was computed on the same mesh, with the same space and the same number of processes.
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

# Largest distance between a node's positions in a state and in the space, relative to the largest
# coordinate
_MAX_NODE_DISTANCE = 1e-9
# Quadrature degree that integrates squares of stresses and pressures, which are linear in a cell
_INDICATOR_DEGREE = 2
STATE_REMEDY = "solve_contact gives a list of states, ContactProblem.step one of them"
# Least fraction of a node's area that has to face the other side; below it the node has no
# pressure. For a linear pressure, the error of nodal values is up to 0.3 % at a fraction of 1/4,
# 1 % at 1/20, and 10 % at 1/200
_MIN_COVERED_FRACTION = 0.1


@dataclass(frozen=True)
class SideResults:
    """Results at the k nodes of one side of a contact pair.

    Pressures and tractions are NaN if no body is given.

    Args:
        normal: unit normals (k, dim) that point into the body of this side; zero at nodes that
            face nothing.
        gap: gaps (k,).
        slip: slips (k, dim) of the nodes on the pair's own side.
        friction: friction coefficients (k,).
        status: contact status (k,) of each node, as in `ContactFields`.
        normal_force: normal nodal forces (k,), compression positive.
        pressure: pressures (k,); NaN where the pair is closed and too little of a node's area faces
            the other side.
        traction: tangential tractions (k, dim); NaN where the pressure is NaN.
    """

    normal: Array
    gap: Array
    slip: Array
    friction: Array
    status: npt.NDArray[np.int8]
    normal_force: Array
    pressure: Array
    traction: Array

    @property
    def tension_ratio(self) -> float:
        """Ratio of the largest tensile to the largest compressive nodal force.

        The ratio is zero if no nodal force is compressive.
        """
        max_compression = self.normal_force.max(initial=0.0)
        return (
            float(max(0.0, -self.normal_force.min(initial=0.0)) / max_compression)
            if max_compression > 0
            else 0.0
        )


@dataclass(frozen=True)
class OppositeSurface:
    """The deformable surface with k nodes that the m nodes of a contact pair face.

    All processes hold the same values. The pair's nodal areas are transferred to the nodes of this
    surface in the same way as the nodal forces: see the guide's page on theory ("Two bodies"). A
    mean of nodal values of the pair at a node of this surface is weighted with the integrals of the
    node's weight function times those of the pair's nodes.

    Args:
        node: global numbers (k,) of the surface's nodes.
        facing_area: integrals (k,) of the nodes' weight functions over the part of the surface that
            faces the pair.
        means: matrix (k, m) that takes nodal values of the pair to their means at the nodes of the
            surface; the rows of nodes that do not face the pair are zero.
        force_transfer: matrix (k, m) with the part of each nodal force of the pair that each node
            of the surface receives.
        pair_fraction: fraction (m,) of the area of each node of the pair that faces the surface.
        opposite_fraction: fraction (k,) of the area of each node of the surface that faces the
            pair; zero if no body is given.
        weight_area: areas (m,) of the pair's nodes.
        surface: nodes of the surface; None if no body is given.
    """

    node: Indices
    facing_area: Array
    means: sp.csr_array
    force_transfer: sp.csr_array
    pair_fraction: Array
    opposite_fraction: Array
    weight_area: Array
    surface: SurfaceNodes | None

    def results(self, pair: PairState, weight_area: Array | None = None) -> SideResults:
        """Return the results at the nodes of the surface.

        Args:
            pair: state of the contact pair.
            weight_area: areas (m,) of the pair's nodes in the deformed body, which give true
                pressures. By default, areas in the undeformed body are used.
        """
        area = self.weight_area if weight_area is None else weight_area
        area_vectors = -np.asarray(
            self.force_transfer @ ((area * self.pair_fraction)[:, None] * pair.normal)
        )
        area_of_node = np.linalg.norm(area_vectors, axis=1)
        normal = (area_vectors.T / np.where(area_of_node > 0, area_of_node, 1.0)).T
        normal_force = np.sum(pair.opposite_force * normal, axis=1)
        status_weights = self.means @ np.eye(HELD + 1)[pair.status]
        is_closed = np.delete(status_weights, OPEN, axis=1).any(axis=1)
        divisor = np.where(
            is_closed,
            np.where(self.opposite_fraction < _MIN_COVERED_FRACTION, np.nan, area_of_node),
            np.inf,
        )
        return SideResults(
            normal,
            self.means @ np.where(np.isfinite(pair.gap), pair.gap, 0.0),
            self.means @ pair.slip,
            self.means @ pair.friction,
            status_weights.argmax(axis=1).astype(np.int8),
            normal_force,
            normal_force / divisor,
            ((pair.opposite_force - normal_force[:, None] * normal).T / divisor).T,
        )


def make_pair_sides(
    number: int, state: ContactState, body: Body | None, space: fem.FunctionSpace
) -> tuple[SurfaceNodes | None, OppositeSurface | None]:
    """Return the nodes of a pair's own surface and the deformable surface that the pair faces.

    The first value is None if no body is given, the second one if the pair faces no deformable
    surface. A node's area on the own surface is the area that faces the opposite surface, and NaN
    where it is too small for a pressure. Nodes that face nothing keep their whole areas and have
    no forces. At large sliding all nodes of the own surface keep their whole areas.

    Args:
        number: number of the pair.
        state: state that contains the pair.
        body: the body, or None if no pressures are needed.
        space: space of the displacements.

    Raises:
        ValueError: if a node of the pair belongs to no facet whose nodes are all in the pair, or if
            two nodes of the opposite surface coincide.
    """
    pair, is_deformed = state.pairs[number], state.smallness is None
    surface = None if body is None else _make_pair_surface(number, pair, body, space)
    if not len(pair.opposite_node):
        return surface, None
    nodes = pair.node, pair.opposite_node
    slave_trace, master_trace = (
        gather_trace(space, facets_with_all_nodes(space, side)) for side in nodes
    )
    is_axisymmetric = body is not None and body.state is StressState.AXISYMMETRIC
    if not is_deformed:
        means, dual_integrals = _integrate_undeformed_sides(
            space, pair, slave_trace, master_trace, is_axisymmetric
        )
        covered_area = np.asarray(dual_integrals.sum(axis=0))
        force_transfer = dual_integrals @ sp.diags_array(
            1 / np.where(covered_area > 0, covered_area, 1.0)
        )
    else:
        mortar = SlidingMortar(slave_trace, master_trace, is_axisymmetric)
        displacement = state.displacement.array_r.reshape(-1, mortar.x.shape[1])
        x = mortar.x + gather_from_owners(space, mortar.nodes, displacement)
        x[mortar.n_slave_nodes :] += pair.translation
        slaves, masters = (np.searchsorted(np.sort(side), side) for side in nodes)
        mortar.allowed_components[slaves] = pair.normal != 0
        mortar_state = mortar.linearise(x)
        covered_area = mortar_state.areas[slaves]
        force_transfer = mortar_state.master_fractions[slaves][:, masters].T
        rows = mortar_state.distance_rows[slaves][:, mortar.n_slave_nodes + masters]
        means = -rows.T @ sp.diags_array(covered_area)
        slave_trace = slave_trace.with_positions(x[: mortar.n_slave_nodes])
        master_trace = master_trace.with_positions(x[mortar.n_slave_nodes :])
    facing = np.asarray(means.sum(axis=1))
    means = sp.diags_array(1 / np.where(facing > 0, facing, 1.0)) @ means
    if surface is None or body is None:
        no_fractions = np.zeros(len(pair.opposite_node))
        return None, OppositeSurface(
            nodes[1],
            facing,
            means,
            force_transfer,
            covered_area,
            no_fractions,
            0 * covered_area,
            None,
        )
    whole_areas_of_pair, opposite_whole_areas = (
        compute_tributary_areas(trace, is_axisymmetric)[np.searchsorted(trace.nodes, side)]
        for trace, side in zip((slave_trace, master_trace), nodes, strict=True)
    )
    opposite = SurfaceNodes.from_body(body, facets_with_all_nodes(space, pair.opposite_node))
    if not np.array_equal(opposite.node, pair.opposite_node):
        raise ValueError(f"contact pair {number} faces a surface that has two nodes at one place")
    pair_fraction = covered_area / whole_areas_of_pair
    opposite_fraction = (force_transfer @ covered_area) / opposite_whole_areas
    opposite_side = OppositeSurface(
        nodes[1],
        facing,
        means,
        force_transfer,
        pair_fraction,
        opposite_fraction,
        surface.weight_area,
        opposite,
    )
    if not is_deformed:
        area_factor = np.where(
            covered_area > 0,
            np.where(pair_fraction < _MIN_COVERED_FRACTION, np.nan, pair_fraction),
            1.0,
        )
        areas = surface.weight_area * area_factor, surface.tributary_area * area_factor
        surface = replace(surface, weight_area=areas[0], tributary_area=areas[1])
    return surface, opposite_side


def _integrate_undeformed_sides(
    space: fem.FunctionSpace,
    pair: PairState,
    slave_trace: Trace,
    master_trace: Trace,
    is_axisymmetric: bool,
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return two matrices (k, m) of integrals over the contact surface.

    The first one has integrals of the weight functions of the k opposite nodes times those of the
    pair's m nodes, the second one times the dual functions of the pair's weights.

    Args:
        space: space of the displacements.
        pair: state of the pair, with its m nodes and the k opposite ones.
        slave_trace: trace of the pair's side.
        master_trace: trace of the opposite side.
        is_axisymmetric: whether the body is axisymmetric.
    """
    first_node, end_node = space.dofmap.index_map.local_range
    owned = np.flatnonzero((pair.node >= first_node) & (pair.node < end_node))
    overlap, n_opposite = (
        Overlap.from_traces(slave_trace, master_trace, pair.node[owned], is_axisymmetric),
        len(pair.opposite_node),
    )
    node, weight = overlap.functions[2]
    order = np.argsort(pair.opposite_node)
    node = order[np.searchsorted(pair.opposite_node, node, sorter=order)]

    def gather_integrals(tested_functions: Array) -> sp.csr_array:
        integrals = overlap.assemble_integrals(
            tested_functions, node, weight, (len(owned), n_opposite)
        ).tocoo()
        parts_of_ranks = space.mesh.comm.allgather(
            (integrals.col, owned[integrals.row], integrals.data)
        )
        row, column, value = (np.concatenate(parts) for parts in zip(*parts_of_ranks, strict=True))
        return sp.csr_array((value, (row, column)), shape=(n_opposite, len(pair.node)))

    return gather_integrals(overlap.weight), gather_integrals(overlap.dual)


def _make_pair_surface(
    number: int, pair: PairState, body: Body, space: fem.FunctionSpace
) -> SurfaceNodes:
    """Return the surface nodes of a pair, or raise ValueError if a node belongs to no facet."""
    surface = SurfaceNodes.from_body(body, facets_with_all_nodes(space, pair.node))
    if not np.array_equal(surface.node, pair.node):
        isolated = pair.position[~np.isin(pair.node, surface.node)]
        raise ValueError(
            f"contact pair {number}: its nodes at {format_points(isolated)} belong to no facet "
            "that has all of its nodes in the pair, so that they have no pressure: let the pair "
            "end at vertices, or give it the nodes of whole facets, fem.locate_dofs_topological"
        )
    return surface


def make_pair_results(surface: SurfaceNodes, pair: PairState) -> SideResults:
    """Return the results at a pair's own nodes.

    Pressures and tractions are zero at open nodes whose area is NaN.
    """
    has_no_pressure = np.isnan(surface.weight_area) & (pair.status == OPEN)
    pressure, traction = (
        np.where(has_no_pressure, 0.0, surface.pressure(force).T).T
        for force in (pair.force_normal, pair.force_tangential)
    )
    nodal_values = pair.normal, pair.gap, pair.slip, pair.friction, pair.status, pair.force_normal
    return SideResults(*nodal_values, pressure, traction)


@dataclass(frozen=True)
class ContactFields:
    """Results of a contact state as finite element functions.

    Vectors are functions in the trial space, scalars in the scalar space of its components.

    Fields of the contact surface are zero elsewhere, except for the gap, which is NaN there,
    because zero would mean contact. ParaView draws NaN in a separate colour and ignores it in
    ranges. Where the nodes of two sides match, both nodes have the same scalars and opposite
    vectors.

    At the nodes of an opposite deformable surface, pressures and tractions are the forces on these
    nodes divided by the areas that face the pair (see `OppositeSurface`). The contact law is
    imposed at the pair's own nodes only. At an opposite node, gap and slip are means over the
    pair's nodes that it faces, and the status is the most frequent status of these nodes. If a node
    faces two pairs, its force is the sum of both; all other fields are those of the pair that it
    faces with the larger area. On both sides, pressures and tractions are NaN at loaded nodes if
    less than a tenth of the node's area faces the other side. The nodal forces are right there, but
    their quotients by such a small area are not. At large sliding the areas are those of the pair's
    own nodes, transferred to the opposite nodes in the same way as the forces.

    Pressures are forces divided by areas. They need the body, for its thickness or circumference,
    and are None if only the space is given. `SurfaceNodes` explains the three measures of pressure.
    Pressures are nodal values. If they are interpolated by the *test* functions (linearly between
    nodes where the weights are linear), they integrate to the total force. The functions here
    interpolate by the trial functions, so that their integrals are only close to the total force.

    Pressures are nominal, that is, relative to areas of the undeformed surface. At large strains
    the true pressure of node i is

        p_i = force_normal_i / integral of w_i |det F F^-T N| dA,

    with the node's test function w_i, the deformation gradient F = I + grad u and the unit normal N
    of the undeformed surface.

    Args:
        displacement: vector of displacements.
        force: vector "contact_force", the force of the surface on the body at each node.
        gap: scalar; NaN off the contact surface and at nodes that face nothing.
        slip: vector of the slip in this increment.
        status: scalar, OPEN (0), STICK (1), SLIP (2) or HELD (3); OPEN off the surface.
        pressure: scalar, compression positive. It is the normal nodal force divided by the integral
            of the node's test function (measure 2), and NaN where this integral is zero.
        tributary_pressure: scalar, the normal nodal force divided by the node's tributary area
            (measure 3). It equals `pressure` at nodes of an opposite deformable surface, where the
            weights are linear.
        traction: vector, the tangential force of the surface on the body divided by the area that
            `pressure` uses.
        surfaces: `SurfaceNodes` of each pair, with the areas that face a deformable surface at
            small sliding; an empty tuple without a body.
        opposite: for each pair the deformable surface that it faces, or None. The method `results`
            of this `OppositeSurface` returns arrays (k, ...) for its k nodes on every process.
        body_pressure: scalar, the pressure unknown of a hybrid body, in the whole body; None for
            other bodies. Where materials meet it has the value of one of them.
        hybrid: mixed trial space of a hybrid body; None for other bodies.
        true_pressure: scalar, the true pressure defined above, with the thickness of the body; NaN
            where `pressure` is NaN. It is None unless the body is given and the state was computed
            by `ContactProblem.of_residual`.
        body: the body, if it was given; None otherwise.
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
    opposite: tuple[OppositeSurface | None, ...]
    body_pressure: fem.Function | None = None
    hybrid: fem.FunctionSpace | None = None
    true_pressure: fem.Function | None = None
    body: Body | None = None

    @classmethod
    @check_same_arguments
    def from_state(cls, state: ContactState, body: Body | fem.FunctionSpace) -> "ContactFields":
        """Create functions with the values of a state; collective.

        Args:
            state: state of a contact problem on the trial space.
            body: body of the contact problem; or its trial space, if no pressures are needed.

        Raises:
            TypeError: for arguments of the wrong type.
            ValueError: for a state of another space. If the body is given, also for a contact node
                that belongs to no facet whose nodes are all in the pair.
        """
        space = displacement_space(body)
        check_state(state, space)
        scalars = scalar_space(space)
        given_body, whole_space = (
            (body, body.spaces.trial) if isinstance(body, Body) else (None, body)
        )

        def make_function(
            name: str, functions: fem.FunctionSpace, is_wanted: bool
        ) -> fem.Function | None:
            return fem.Function(functions, name=name) if is_wanted else None

        sides = [make_pair_sides(k, state, given_body, space) for k in range(len(state.pairs))]
        fields = cls(
            fem.Function(space, name="displacement"),
            fem.Function(space, name="contact_force"),
            fem.Function(scalars, name="gap"),
            fem.Function(space, name="slip"),
            fem.Function(scalars, name="status"),
            make_function("pressure", scalars, given_body is not None),
            make_function("tributary_pressure", scalars, given_body is not None),
            make_function("traction", space, given_body is not None),
            tuple(surface for surface, _ in sides if surface is not None),
            tuple(opposite for _, opposite in sides),
            make_function("body_pressure", scalars, is_hybrid(whole_space)),
            whole_space if is_hybrid(whole_space) else None,
            make_function(
                "true_pressure", scalars, given_body is not None and state.smallness is None
            ),
            given_body,
        )
        fields.fill(state)
        return fields

    @check_same_arguments
    def fill(self, state: ContactState) -> None:
        """Set the functions to the values of another state of the same problem; collective.

        Args:
            state: another state of the same problem.

        Raises:
            ValueError: for a state of another space or with other pairs.
        """
        space = self.displacement.function_space
        check_state(state, space)
        pairs = state.pairs
        surface_nodes, pair_nodes = (
            [part.node.tolist() for part in parts] for parts in (self.surfaces, pairs)
        )
        opposite_nodes = [[] if side is None else side.node.tolist() for side in self.opposite]
        if surface_nodes not in ([], pair_nodes) or opposite_nodes != [
            pair.opposite_node.tolist() for pair in pairs
        ]:
            raise ValueError("the state has other contact nodes than the fields")
        if state.smallness is None:  # after large sliding, other parts of the sides face each other
            sides = [make_pair_sides(k, state, self.body, space) for k in range(len(pairs))]
            object.__setattr__(self, "opposite", tuple(opposite for _, opposite in sides))
        as_function(space, state.displacement, out=self.displacement)
        _set_nodal_values(self.force, pairs, [pair.force_vector for pair in pairs])
        for pair in pairs:
            local = _find_local_nodes(space, pair.opposite_node)
            forces = self.force.x.array.reshape(-1, space.dofmap.index_map_bs)
            forces[local[local >= 0]] += pair.opposite_force[local >= 0]
        gaps = [np.where(np.isfinite(pair.gap), pair.gap, np.nan) for pair in pairs]
        _set_nodal_values(self.gap, pairs, gaps, np.nan)
        _set_nodal_values(self.slip, pairs, [pair.slip for pair in pairs])
        _set_nodal_values(self.status, pairs, [pair.status for pair in pairs])
        results = [
            make_pair_results(surface, pair)
            for surface, pair in zip(self.surfaces, pairs, strict=False)
        ]
        _set_nodal_values(self.pressure, pairs, [side.pressure for side in results])
        _set_nodal_values(self.traction, pairs, [side.traction for side in results])
        tributary_pressures = [
            np.where(side.pressure == 0, 0.0, surface.tributary_pressure(side.normal_force))
            for side, surface in zip(results, self.surfaces, strict=True)
        ]
        _set_nodal_values(self.tributary_pressure, pairs, tributary_pressures)
        deformed_surfaces = self._make_deformed_surfaces(pairs)
        true_pressures = [
            np.where(np.isnan(side.pressure), np.nan, surface.pressure(side.normal_force))
            for side, surface in zip(results, deformed_surfaces, strict=False)
        ]
        _set_nodal_values(self.true_pressure, pairs, true_pressures)
        self._fill_opposite(pairs, deformed_surfaces)
        if self.body_pressure is not None and self.hybrid is not None:
            self.body_pressure.interpolate(split(self.hybrid, state.unknowns)[1])

    def _make_deformed_surfaces(self, pairs: Sequence[PairState]) -> list[SurfaceNodes]:
        """Return the pairs' own surfaces with the areas of the deformed body.

        The list is empty if there are no true pressures.
        """
        if self.true_pressure is None or self.body is None:
            return []
        space, u = self.displacement.function_space, self.displacement
        area_ratio = SurfaceNodes.stretch(u)
        if self.body.state is StressState.AXISYMMETRIC:
            area_ratio *= 1 + u[0] / ufl.SpatialCoordinate(space.mesh)[0]
        facets = [facets_with_all_nodes(space, pair.node) for pair in pairs]
        return [
            SurfaceNodes.from_body(self.body, facets_of_pair, area_ratio)
            for facets_of_pair in facets
        ]

    def _fill_opposite(
        self, pairs: Sequence[PairState], deformed_surfaces: Sequence[SurfaceNodes]
    ) -> None:
        """Set the values at nodes of opposite surfaces that are not nodes of a pair themselves.

        A node that faces several pairs gets the values of the pair that it faces with the largest
        area.
        """
        space = self.displacement.function_space
        max_facing = np.zeros(len(self.gap.x.array))
        for pair in pairs:
            local = _find_local_nodes(space, np.concatenate([pair.node, pair.faced_node]))
            max_facing[local[local >= 0]] = np.inf
        for k, (opposite, pair) in enumerate(zip(self.opposite, pairs, strict=True)):
            if opposite is None:
                continue
            results, local = opposite.results(pair), _find_local_nodes(space, pair.opposite_node)
            is_set = (local >= 0) & (opposite.facing_area > max_facing[local])
            nodes = local[is_set]
            max_facing[nodes] = opposite.facing_area[is_set]
            true_pressure = (
                opposite.results(pair, deformed_surfaces[k].weight_area).pressure
                if deformed_surfaces
                else None
            )
            for function, values in (
                (self.gap, results.gap),
                (self.status, results.status),
                (self.slip, -results.slip),
                (self.pressure, results.pressure),
                (self.tributary_pressure, results.pressure),
                (self.traction, results.traction),
                (self.true_pressure, true_pressure),
            ):
                if function is not None and values is not None:
                    block = function.function_space.dofmap.index_map_bs
                    function.x.array.reshape(-1, block)[nodes] = values[is_set].reshape(-1, block)

    @check_same_arguments
    def indicator(self) -> fem.Function:
        """Return an error indicator per cell, for the refinement of contact surfaces.

        Stresses have larger errors than nodal forces. The difference between the normal stress and
        the pressure from nodal forces is therefore about the error of the stress. The indicator
        eta_K of a cell K follows from

            eta_K^2 = integral of (n·sigma n + p)^2

        over the part of the pairs' own surfaces that belongs to the cell. Here n is the outward
        normal, sigma the stress, and p the nodal pressure, interpolated by the weight functions.
        The square root of the sum of all eta_K^2 is the total error, in units of stress times
        square root of area. The indicator is zero in cells off these surfaces, and in cells with a
        node that has no pressure.

        Raises:
            ValueError: if the body was not given or is hybrid; at large strains, since the body's
                material is not that of the residual; or if the weight functions of some nodes are
                zero, such as those of the corners of the standard 10-node tetrahedron.
        """
        if self.body is None or self.pressure is None or self.hybrid or self.true_pressure:
            raise ValueError(
                "stresses follow from the displacements of a Body at small strains, one that is "
                "not hybrid: give it to ContactFields.from_state, or integrate your own stress"
            )
        if any(
            np.isnan(surface_nodes.pressure(surface_nodes.weight_area)).any()
            for surface_nodes in self.surfaces
        ):
            raise ValueError(
                "nodes of this element have no weight on the surface, so no pressure to compare "
                "with stresses: Spaces.petrov_galerkin gives them one"
            )
        mesh, weights = self.body.spaces.mesh, test_space(self.pressure.function_space)
        facets = [
            facets_with_all_nodes(self.displacement.function_space, surface.node)
            for surface in self.surfaces
        ]
        ds = boundary_measure(mesh, np.unique(np.concatenate(facets)), _INDICATOR_DEGREE)
        p, n = fem.Function(weights), ufl.FacetNormal(mesh)
        p.x.array[:] = self.pressure.x.array
        stress = self.body.stress(self.displacement)
        components = range(len(n))  # an axisymmetric stress has a hoop component
        normal_stress = sum(n[i] * stress[i, j] * n[j] for i in components for j in components)
        cells = fem.functionspace(mesh, ("Discontinuous Lagrange", 0))
        squares = assemble_vector((normal_stress + p) ** 2 * ufl.TestFunction(cells) * ds)
        eta = as_function(cells, squares, "error_indicator")
        eta.x.array[:] = np.sqrt(np.nan_to_num(eta.x.array))
        return eta

    def functions(self) -> list[fem.Function]:
        """Return all functions that are not None, in the order of the attributes."""
        return [value for value in vars(self).values() if isinstance(value, fem.Function)]


def _set_nodal_values(
    function: fem.Function | None,
    pairs: Sequence[PairState],
    values: Sequence[npt.NDArray],
    elsewhere: float = 0.0,
) -> None:
    """Set a function to nodal values of contact pairs, and to a constant elsewhere.

    Opposite nodes that match nodes of a pair get the same scalars and the opposite vectors.

    Args:
        function: function to set; nothing is done for None.
        pairs: states of the pairs.
        values: values (m,) or (m, dim) at the m nodes of each pair.
        elsewhere: value at all other nodes.
    """
    if function is None:
        return
    space = function.function_space
    array = function.x.array.reshape(-1, space.dofmap.index_map_bs)
    array[:] = elsewhere
    for pair, nodal_values in zip(pairs, values, strict=True):
        columns = nodal_values.reshape(len(nodal_values), -1)
        for nodes, sign in (
            (pair.node, 1.0),
            (pair.faced_node, 1.0 if nodal_values.ndim == 1 else -1.0),
        ):
            local = _find_local_nodes(space, nodes)
            array[local[local >= 0]] = sign * columns[local >= 0]


def _find_local_nodes(space: fem.FunctionSpace, nodes: Indices) -> LocalIndices:
    """Return local numbers (m,) of nodes, including ghosts, for global numbers (m,).

    The local number is -1 if the node is not on this process, or if the global number is negative.
    """
    local = space.dofmap.index_map.global_to_local(np.maximum(nodes, 0))
    return np.where(nodes < 0, -1, local)


def displacement_space(body: Body | fem.FunctionSpace) -> fem.FunctionSpace:
    """Return the space of displacements of a body or a trial space; reject other arguments."""
    kinds = (Body, fem.FunctionSpace)
    arguments.check_type("body", body, kinds, "it has to be a Body, or its trial space")
    if not isinstance(body, Body):
        arguments.check_space(body)
    return SubSpace.displacements(body.spaces.trial if isinstance(body, Body) else body).space


def check_state(state: ContactState, space: fem.FunctionSpace) -> None:
    """Raise an error unless a state belongs to the given space of displacements; collective."""
    first_node, end_node = space.dofmap.index_map.local_range
    x = space.tabulate_dof_coordinates()[:, : space.mesh.geometry.dim]
    with collective_errors(space.mesh.comm):
        arguments.check_type("state", state, ContactState, STATE_REMEDY)
        is_same_space = state.displacement.getSizes() == vector_sizes(space)
        for pair in state.pairs if is_same_space else ():
            is_owned = (pair.node >= first_node) & (pair.node < end_node)
            distance = np.abs(x[pair.node[is_owned] - first_node] - pair.position[is_owned])
            is_same_space &= bool(
                distance.max(initial=0.0)
                <= _MAX_NODE_DISTANCE * np.abs(pair.position).max(initial=0.0)
            )
        if not is_same_space:
            raise ValueError("the state belongs to another space, or other processes, than this")

"""Results of a contact state as functions on the body: forces, pressures, gap, slip and status.

    fields = ContactFields.from_state(states[-1], body)
    fields.pressure, fields.gap, fields.status

If the trial space is given in place of the body, the fields have no pressures. The module
guarantees that each pressure times its area equals the normal nodal force. It assumes that the
state was computed on the same mesh, with the same space and the same number of processes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from pw_elements.arrays import Indices, LocalIndices, Mask
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    count_local_and_global_dofs,
    raise_errors_on_all_processes,
)
from pw_elements.contact.model import ContactState, PairState
from pw_elements.contact.nodes import OPEN
from pw_elements.contact.output.sides import (
    OppositeSurface,
    make_own_and_opposite_surface,
    make_results_of_own_side,
)
from pw_elements.elasticity import (
    Body,
    StressState,
    SurfaceNodes,
    boundary_measure,
    exterior_facets_with_all_nodes,
)
from pw_elements.spaces import (
    SubSpace,
    as_function,
    assemble_vector,
    is_hybrid,
    scalar_component_space,
    split,
    test_space,
)

# Largest distance between the positions of a node in a state and in the space, relative to the
# largest coordinate
_MAX_SAME_NODE_DISTANCE_PER_LARGEST_COORDINATE = 1e-9
# Quadrature degree that integrates squares of stresses and pressures, which are linear in a cell
_ERROR_INDICATOR_QUADRATURE_DEGREE = 2
STATE_ARGUMENT_ADVICE = "solve_contact gives a list of states, ContactProblem.step one of them"


@dataclass(frozen=True)
class ContactFields:
    """Results of a contact state as finite element functions.

    Vectors are functions in the trial space, scalars in the scalar space of its components.

    Fields of the contact surface are zero elsewhere, except for the gap, which is NaN there,
    because zero would mean contact. ParaView draws NaN in a separate colour and ignores it in
    ranges. Where the nodes of two sides match, both nodes have the same scalars and opposite
    vectors.

    At a node that belongs to several pairs, the force is the sum of the pairs' forces. All other
    fields are those of the pair with the largest normal force there, or, without force, of the pair
    with the smallest gap. Results of each pair are in `ContactState.pairs`.

    At the nodes of an opposite deformable surface, pressures and tractions are the forces on these
    nodes divided by the areas that face the pair (see `OppositeSurface`). The contact law is
    imposed at the pair's own nodes only. At an opposite node, gap and slip are means over the
    pair's nodes that it faces, and the status is the most frequent status of these nodes. If a node
    faces two pairs, its force is the sum of both; all other fields are those of the pair that it
    faces with the larger area. On both sides, pressures and tractions are NaN at loaded nodes if
    less than a tenth of the node's area faces the other side. The nodal forces are correct there,
    but dividing them by such small areas is inaccurate. At large sliding the areas are those of the
    pair's own nodes, transferred to the opposite nodes in the same way as the forces.

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
    @check_same_arguments_on_all_processes
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
        check_state_fits_space(state, space)
        scalars = scalar_component_space(space)
        given_body, whole_space = (
            (body, body.spaces.trial) if isinstance(body, Body) else (None, body)
        )

        def make_function(
            name: str, functions: fem.FunctionSpace, is_wanted: bool
        ) -> fem.Function | None:
            return fem.Function(functions, name=name) if is_wanted else None

        sides = [
            make_own_and_opposite_surface(k, state, given_body, space)
            for k in range(len(state.pairs))
        ]
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

    @check_same_arguments_on_all_processes
    def fill(self, state: ContactState) -> None:
        """Set the functions to the values of another state of the same problem; collective.

        Args:
            state: another state of the same problem.

        Raises:
            ValueError: for a state of another space or with other pairs.
        """
        space = self.displacement.function_space
        check_state_fits_space(state, space)
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
            sides = [
                make_own_and_opposite_surface(k, state, self.body, space) for k in range(len(pairs))
            ]
            object.__setattr__(self, "opposite", tuple(opposite for _, opposite in sides))
        as_function(space, state.displacement, out=self.displacement)
        is_shown = _select_pair_of_each_node(pairs)
        _set_nodal_values(self.force, pairs, [pair.force_vector for pair in pairs], is_shown)
        if not all(mask.all() for mask in is_shown):
            self._add_forces_of_hidden_pairs(pairs, is_shown)
        for pair in pairs:
            local = _convert_to_local_nodes(space, pair.opposite_node)
            forces = self.force.x.array.reshape(-1, space.dofmap.index_map_bs)
            forces[local[local >= 0]] += pair.opposite_force[local >= 0]
        gaps = [np.where(np.isfinite(pair.gap), pair.gap, np.nan) for pair in pairs]
        _set_nodal_values(self.gap, pairs, gaps, is_shown, np.nan)
        _set_nodal_values(self.slip, pairs, [pair.slip for pair in pairs], is_shown)
        _set_nodal_values(self.status, pairs, [pair.status for pair in pairs], is_shown)
        results = [
            make_results_of_own_side(surface, pair)
            for surface, pair in zip(self.surfaces, pairs, strict=False)
        ]
        _set_nodal_values(self.pressure, pairs, [side.pressure for side in results], is_shown)
        _set_nodal_values(self.traction, pairs, [side.traction for side in results], is_shown)
        tributary_pressures = [
            np.where(side.pressure == 0, 0.0, surface.tributary_pressure(side.normal_force))
            for side, surface in zip(results, self.surfaces, strict=True)
        ]
        _set_nodal_values(self.tributary_pressure, pairs, tributary_pressures, is_shown)
        deformed_surfaces = self._make_surfaces_with_deformed_areas(pairs)
        true_pressures = [
            np.where(np.isnan(side.pressure), np.nan, surface.pressure(side.normal_force))
            for side, surface in zip(results, deformed_surfaces, strict=False)
        ]
        _set_nodal_values(self.true_pressure, pairs, true_pressures, is_shown)
        self._fill_opposite_nodes(pairs, deformed_surfaces)
        if self.body_pressure is not None and self.hybrid is not None:
            self.body_pressure.interpolate(split(self.hybrid, state.unknowns)[1])

    def _add_forces_of_hidden_pairs(
        self, pairs: Sequence[PairState], is_shown: Sequence[Mask]
    ) -> None:
        """Add the forces of pairs at nodes at which the fields are those of another pair."""
        space = self.displacement.function_space
        forces = self.force.x.array.reshape(-1, space.dofmap.index_map_bs)
        for pair, shown in zip(pairs, is_shown, strict=True):
            local = _convert_to_local_nodes(space, pair.node)
            is_added = ~shown & (local >= 0)
            forces[local[is_added]] += pair.force_vector[is_added]

    def _make_surfaces_with_deformed_areas(self, pairs: Sequence[PairState]) -> list[SurfaceNodes]:
        """Return the pairs' own surfaces with the areas of the deformed body.

        The list is empty if there are no true pressures.
        """
        if self.true_pressure is None or self.body is None:
            return []
        space, u = self.displacement.function_space, self.displacement
        area_ratio = SurfaceNodes.area_stretch(u)
        if self.body.state is StressState.AXISYMMETRIC:
            area_ratio *= 1 + u[0] / ufl.SpatialCoordinate(space.mesh)[0]
        facets = [exterior_facets_with_all_nodes(space, pair.node) for pair in pairs]
        return [
            SurfaceNodes.from_body(self.body, facets_of_pair, area_ratio)
            for facets_of_pair in facets
        ]

    def _fill_opposite_nodes(
        self, pairs: Sequence[PairState], deformed_surfaces: Sequence[SurfaceNodes]
    ) -> None:
        """Set the values at nodes of opposite surfaces that are not nodes of a pair themselves.

        A node that faces several pairs gets the values of the pair that it faces with the largest
        area.
        """
        space = self.displacement.function_space
        max_facing = np.zeros(len(self.gap.x.array))
        for pair in pairs:
            local = _convert_to_local_nodes(space, np.concatenate([pair.node, pair.faced_node]))
            max_facing[local[local >= 0]] = np.inf
        for k, (opposite, pair) in enumerate(zip(self.opposite, pairs, strict=True)):
            if opposite is None:
                continue
            results, local = (
                opposite.results(pair),
                _convert_to_local_nodes(space, pair.opposite_node),
            )
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

    @check_same_arguments_on_all_processes
    def error_indicator(self) -> fem.Function:
        """Return an error indicator per cell, for the refinement of contact surfaces.

        Stresses have larger errors than nodal forces. Therefore the difference between the normal
        stress and the pressure from nodal forces is close to the error of the stress. The indicator
        eta_K of a cell K follows from

            eta_K^2 = integral of (n·sigma n + p)^2

        over the part of the pairs' own surfaces that belongs to the cell. Here n is the outward
        normal, sigma the stress, and p the nodal pressure, interpolated by the weight functions.
        The square root of the sum of all eta_K^2 is the total error, in units of stress times
        square root of area. The indicator is zero in cells off these surfaces, and in cells with a
        node that has no pressure.

        Raises:
            ValueError: if the body was not given or is hybrid; at large strains, since the body's
                material is not that of the residual; if the weight functions of some nodes are
                zero, such as those of the corners of the standard 10-node tetrahedron; or if nodes
                belong to several pairs.
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
        nodes = np.concatenate([surface.node for surface in self.surfaces])
        if len(np.unique(nodes)) < len(nodes):
            raise ValueError(
                "nodes belong to several contact pairs, and these fields have the pressure of one "
                "of them only: leave a facet between the pairs, or integrate the difference with "
                "the pressures of each pair"
            )
        mesh, weights = self.body.spaces.mesh, test_space(self.pressure.function_space)
        facets = [
            exterior_facets_with_all_nodes(self.displacement.function_space, surface.node)
            for surface in self.surfaces
        ]
        ds = boundary_measure(
            mesh, np.unique(np.concatenate(facets)), _ERROR_INDICATOR_QUADRATURE_DEGREE
        )
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


def _select_pair_of_each_node(pairs: Sequence[PairState]) -> list[Mask]:
    """Return, for each pair, a mask (m,) of the nodes at which the fields are those of this pair.

    At a node that belongs to several pairs, it is the pair with the largest normal force, and
    without force the pair with the smallest gap.
    """
    node, force, gap, status = (
        np.concatenate([getattr(pair, name) for pair in pairs])
        for name in ("node", "force_normal", "gap", "status")
    )
    order = np.lexsort((gap, np.where(status == OPEN, 0.0, -force), node))
    is_first = np.diff(node[order], prepend=-1) != 0
    is_shown = np.zeros(len(node), dtype=bool)
    is_shown[order[is_first]] = True
    return np.split(is_shown, np.cumsum([len(pair.node) for pair in pairs])[:-1])


def _set_nodal_values(
    function: fem.Function | None,
    pairs: Sequence[PairState],
    values: Sequence[npt.NDArray],
    is_shown: Sequence[Mask],
    elsewhere: float = 0.0,
) -> None:
    """Set a function to nodal values of contact pairs, and to a constant elsewhere.

    Opposite nodes that match nodes of a pair get the same scalars and the opposite vectors.

    Args:
        function: function to set; if it is None, nothing is done.
        pairs: states of the pairs.
        values: values (m,) or (m, dim) at the m nodes of each pair.
        is_shown: mask (m,) of the own nodes of each pair at which its values are set.
        elsewhere: value at all other nodes.
    """
    if function is None:
        return
    space = function.function_space
    array = function.x.array.reshape(-1, space.dofmap.index_map_bs)
    array[:] = elsewhere
    for pair, nodal_values, shown in zip(pairs, values, is_shown, strict=True):
        columns = nodal_values.reshape(len(nodal_values), -1)
        for nodes, is_set, sign in (
            (pair.node, shown, 1.0),
            (pair.faced_node, np.ones_like(shown), 1.0 if nodal_values.ndim == 1 else -1.0),
        ):
            local = _convert_to_local_nodes(space, nodes)
            is_set = is_set & (local >= 0)
            array[local[is_set]] = sign * columns[is_set]


def _convert_to_local_nodes(space: fem.FunctionSpace, nodes: Indices) -> LocalIndices:
    """Return local numbers (m,) of nodes, including ghosts, for global numbers (m,).

    The local number is -1 if the node is not on this process, or if the global number is negative.
    """
    local = space.dofmap.index_map.global_to_local(np.maximum(nodes, 0))
    return np.where(nodes < 0, -1, local)


def displacement_space(body: Body | fem.FunctionSpace) -> fem.FunctionSpace:
    """Return the space of displacements of a body or trial space; check the argument's type."""
    kinds = (Body, fem.FunctionSpace)
    arguments.check_type("body", body, kinds, "it has to be a Body, or its trial space")
    if not isinstance(body, Body):
        arguments.check_function_space(body)
    return SubSpace.displacements(body.spaces.trial if isinstance(body, Body) else body).space


def check_state_fits_space(state: ContactState, space: fem.FunctionSpace) -> None:
    """Raise an error unless a state belongs to the given space of displacements; collective."""
    first_node, end_node = space.dofmap.index_map.local_range
    x = space.tabulate_dof_coordinates()[:, : space.mesh.geometry.dim]
    with raise_errors_on_all_processes(space.mesh.comm):
        arguments.check_type("state", state, ContactState, STATE_ARGUMENT_ADVICE)
        is_same_space = state.displacement.getSizes() == count_local_and_global_dofs(space)
        for pair in state.pairs if is_same_space else ():
            is_owned = (pair.node >= first_node) & (pair.node < end_node)
            distance = np.abs(x[pair.node[is_owned] - first_node] - pair.position[is_owned])
            is_same_space &= bool(
                distance.max(initial=0.0)
                <= _MAX_SAME_NODE_DISTANCE_PER_LARGEST_COORDINATE
                * np.abs(pair.position).max(initial=0.0)
            )
        if not is_same_space:
            raise ValueError("the state belongs to another space, or other processes, than this")

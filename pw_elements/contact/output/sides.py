"""Results at the nodes of both sides of a contact pair: normals, gaps, forces and pressures.

The module guarantees that each pressure times its area equals the normal nodal force. It assumes
that the state was computed on the same mesh, with the same space and the same number of processes.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.arrays import Array, Indices
from pw_elements.checks import format_points
from pw_elements.contact.interface import (
    BoundaryFacets,
    OverlapQuadrature,
    compute_tributary_areas,
    gather_boundary_facets,
    make_sliding_mortar,
)
from pw_elements.contact.model import ContactState, PairState
from pw_elements.contact.nodes import HELD, OPEN
from pw_elements.elasticity import Body, StressState, SurfaceNodes, exterior_facets_with_all_nodes
from pw_elements.spaces import gather_nodal_values

# Smallest fraction of a node's area that has to face the other side for the node to have a
# pressure. For a linear pressure, the error of nodal values is up to 0.3 % at a fraction of 1/4,
# 1 % at 1/20, and 10 % at 1/200
_MIN_FACING_AREA_FRACTION_FOR_PRESSURE = 0.1


@dataclass(frozen=True)
class ContactSideResults:
    """Results at the k nodes of one side of a contact pair.

    On an opposite surface without a body, normals and normal forces are zero, and pressures and
    tractions are NaN at nodes in contact.

    Args:
        normal: unit normals (k, dim) that point into the body of this side; zero at nodes that do
            not face the other side.
        gap: gaps (k,).
        slip: slips (k, dim) of the pair's own nodes; at opposite nodes, means of these slips.
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
    surface in the same way as the nodal forces (theory page, "Two bodies"). Nodal values of the
    pair are averaged at each node of this surface. In this mean, a node of the pair has as weight
    the integral of both nodes' weight functions times each other.

    Args:
        node: global numbers (k,) of the surface's nodes.
        facing_area: integrals (k,) of the nodes' weight functions over the part of the surface that
            faces the pair.
        means: matrix (k, m) that turns nodal values of the pair into their means at the nodes of
            the surface; the rows of nodes that do not face the pair are zero.
        force_transfer: matrix (k, m) with the fraction of each nodal force of the pair that each
            node of the surface receives.
        pair_fraction: fraction (m,) of the area of each node of the pair that faces the surface;
            the facing area itself if no body is given.
        opposite_fraction: fraction (k,) of the area of each node of the surface that faces the
            pair; zero if no body is given.
        weight_area: areas (m,) of the pair's nodes; zero if no body is given.
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

    @property
    def facing_area_of_pair(self) -> Array:
        """Areas (m,) of the pair's nodes that face the surface; zero if no body is given."""
        return self.weight_area * self.pair_fraction

    def results(self, pair: PairState, weight_area: Array | None = None) -> ContactSideResults:
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
            np.where(
                self.opposite_fraction < _MIN_FACING_AREA_FRACTION_FOR_PRESSURE,
                np.nan,
                area_of_node,
            ),
            np.inf,
        )
        return ContactSideResults(
            normal,
            self.means @ np.where(np.isfinite(pair.gap), pair.gap, 0.0),
            self.means @ pair.slip,
            self.means @ pair.friction,
            status_weights.argmax(axis=1).astype(np.int8),
            normal_force,
            normal_force / divisor,
            ((pair.opposite_force - normal_force[:, None] * normal).T / divisor).T,
        )


def make_own_and_opposite_surface(
    pair_number: int, state: ContactState, body: Body | None, space: fem.FunctionSpace
) -> tuple[SurfaceNodes | None, OppositeSurface | None]:
    """Return the nodes of a pair's own surface and the deformable surface that the pair faces.

    The first value is None if no body is given, and the second one if the pair faces no deformable
    surface. On the own surface, the area of a node is the part that faces the opposite surface, or
    NaN if this part is too small for a pressure. Nodes that do not face the opposite surface keep
    their whole areas and have no forces. At large sliding all nodes of the own surface keep their
    whole areas.

    Args:
        pair_number: number of the pair.
        state: state that contains the pair.
        body: the body, or None if no pressures are needed.
        space: space of the displacements.

    Raises:
        ValueError: if a node of the pair belongs to no facet whose nodes are all in the pair, or if
            two nodes of the opposite surface coincide.
    """
    pair, is_deformed = state.pairs[pair_number], state.smallness is None
    surface = None if body is None else _make_pair_surface(pair_number, pair, body, space)
    if not len(pair.opposite_node):
        return surface, None
    nodes = pair.node, pair.opposite_node
    slave_trace, master_trace = (
        gather_boundary_facets(space, exterior_facets_with_all_nodes(space, side)) for side in nodes
    )
    is_axisymmetric = body is not None and body.state is StressState.AXISYMMETRIC
    if not is_deformed:
        means, dual_integrals = _assemble_undeformed_mortar_matrices(
            space, pair, slave_trace, master_trace, is_axisymmetric
        )
        covered_area = np.asarray(dual_integrals.sum(axis=0))
        force_transfer = dual_integrals @ sp.diags_array(
            1 / np.where(covered_area > 0, covered_area, 1.0)
        )
    else:
        mortar = make_sliding_mortar(slave_trace, master_trace, is_axisymmetric)
        displacement = state.displacement.array_r.reshape(-1, mortar.x.shape[1])
        x = mortar.x + gather_nodal_values(space, mortar.nodes, displacement)
        x[mortar.n_slave_nodes :] += pair.translation
        slaves, masters = (np.searchsorted(np.sort(side), side) for side in nodes)
        mortar.allowed_components[slaves] = pair.normal != 0
        mortar_state = mortar.linearise(x)
        covered_area = mortar_state.areas[slaves]
        force_transfer = mortar_state.master_fractions[slaves][:, masters].T
        means = mortar_state.mixed_products[slaves][:, masters].T
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
    opposite = SurfaceNodes.from_body(
        body, exterior_facets_with_all_nodes(space, pair.opposite_node)
    )
    if not np.array_equal(opposite.node, pair.opposite_node):
        raise ValueError(
            f"contact pair {pair_number} faces a surface that has two nodes at one place"
        )
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
            np.where(pair_fraction < _MIN_FACING_AREA_FRACTION_FOR_PRESSURE, np.nan, pair_fraction),
            1.0,
        )
        areas = surface.weight_area * area_factor, surface.tributary_area * area_factor
        surface = replace(surface, weight_area=areas[0], tributary_area=areas[1])
    return surface, opposite_side


def _assemble_undeformed_mortar_matrices(
    space: fem.FunctionSpace,
    pair: PairState,
    slave_trace: BoundaryFacets,
    master_trace: BoundaryFacets,
    is_axisymmetric: bool,
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return two matrices (k, m) of integrals over the contact surface; collective.

    The entries of the first matrix are integrals of the weight functions of the k opposite nodes
    times the weight functions of the pair's m nodes. In the second matrix, the dual functions of
    the pair's nodes replace their weight functions.

    Args:
        space: space of the displacements.
        pair: state of the pair, with its m nodes and the k opposite ones.
        slave_trace: boundary facets of the pair's side.
        master_trace: boundary facets of the opposite side.
        is_axisymmetric: whether the body is axisymmetric.
    """
    first_node, end_node = space.dofmap.index_map.local_range
    owned = np.flatnonzero((pair.node >= first_node) & (pair.node < end_node))
    overlap, n_opposite = (
        OverlapQuadrature.from_slave_and_master(
            slave_trace, master_trace, pair.node[owned], is_axisymmetric
        ),
        len(pair.opposite_node),
    )
    node, weight = overlap.functions[2]
    order = np.argsort(pair.opposite_node)
    node = order[np.searchsorted(pair.opposite_node, node, sorter=order)]

    def gather_integrals(tested_functions: Array) -> sp.csr_array:
        integrals = overlap.assemble_product_integrals(
            tested_functions, node, weight, (len(owned), n_opposite)
        ).tocoo()
        parts_of_ranks = space.mesh.comm.allgather(
            (integrals.col, owned[integrals.row], integrals.data)
        )
        row, column, value = (np.concatenate(parts) for parts in zip(*parts_of_ranks, strict=True))
        return sp.csr_array((value, (row, column)), shape=(n_opposite, len(pair.node)))

    return gather_integrals(overlap.weight), gather_integrals(overlap.dual)


def _make_pair_surface(
    pair_number: int, pair: PairState, body: Body, space: fem.FunctionSpace
) -> SurfaceNodes:
    """Return the surface nodes of a pair, or raise ValueError if a node belongs to no facet."""
    surface = SurfaceNodes.from_body(body, exterior_facets_with_all_nodes(space, pair.node))
    if not np.array_equal(surface.node, pair.node):
        isolated = pair.position[~np.isin(pair.node, surface.node)]
        raise ValueError(
            f"contact pair {pair_number}: its nodes at {format_points(isolated)} belong to no "
            "facet "
            "that has all of its nodes in the pair, so that they have no pressure: let the pair "
            "end at vertices, or give it the nodes of whole facets, fem.locate_dofs_topological"
        )
    return surface


def make_results_of_own_side(surface: SurfaceNodes, pair: PairState) -> ContactSideResults:
    """Return the results at a pair's own nodes.

    Pressures and tractions are zero at open nodes whose areas in `surface` are NaN.
    """
    has_no_pressure = np.isnan(surface.weight_area) & (pair.status == OPEN)
    pressure, traction = (
        np.where(has_no_pressure, 0.0, surface.pressure(force).T).T
        for force in (pair.force_normal, pair.force_tangential)
    )
    nodal_values = pair.normal, pair.gap, pair.slip, pair.friction, pair.status, pair.force_normal
    return ContactSideResults(*nodal_values, pressure, traction)

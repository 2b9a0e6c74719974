"""Contact points of one pair: against rigid surfaces, with matching nodes, and by mortars.

The module guarantees points whose equations and opposite sides exist and are unique. It assumes
pairs that `build_interface` has checked. Functions are collective, unless they only rearrange
values of this process, such as `find_reduced_column_of_each_unknown`.
"""

import logging
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem, la
from scipy.spatial import cKDTree

from pw_elements._compat import cell_geometry_nodes
from pw_elements.algebra import Reduction
from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import JoinedSpace, format_points
from pw_elements.contact.interface.mortars import (
    BoundaryFacets,
    OverlapQuadrature,
    PlaneSlidingMortar,
    SlidingMortar,
    SpaceSlidingMortar,
    compute_tributary_areas,
    gather_boundary_facets_of_bodies,
    integrate_outward_normals,
)
from pw_elements.contact.model import (
    ContactPair,
    DeformableSurface,
    FrictionCone,
    MatchingNodes,
)
from pw_elements.elasticity import (
    StressState,
    exterior_facets_of_bodies_with_all_nodes,
    order_by_position,
)
from pw_elements.progress import log_on_root
from pw_elements.spaces import (
    AssemblyRecord,
    EntitySelection,
    SubSpace,
    gather_nodal_values,
    is_hybrid,
    locate_exterior_facets_of_bodies,
    locate_nodes,
    read_record,
)

# Values of `faced` for points that do not face a single node, but a rigid surface, or a deformable
# surface with many nodes
FACED_INDEX_OF_RIGID_SURFACE, FACED_INDEX_OF_DEFORMABLE_SURFACE = -1, -2

# Number of cells that are processed at once, to limit memory
_MAX_CELLS_AT_ONCE = 20_000
# Largest distance of a node from the expected position of its opposite node, relative to the body's
# diagonal
_MAX_MATCHING_DISTANCE_PER_BODY_DIAGONAL = 1e-6
# Largest distance of a node on the axis of revolution from the axis, relative to the body's
# diagonal
_MAX_AXIS_DISTANCE_PER_BODY_DIAGONAL = 1e-10
# Smallest cosine between a normal and its projection into a symmetry plane at which the projection
# replaces the normal
_MIN_COSINE_OF_NORMAL_TO_SYMMETRY_PLANE = 0.9
# Facing part of the area of a point above which it counts as the whole area
_MIN_FRACTION_OF_WHOLE_AREA = 1 - 1e-9
# Largest gap between coincident sides, relative to the mean edge of the slave's sub-facets. The
# ratio is 0.01 on an octant of a sphere with two quadratic facets along each side
_MAX_COINCIDENT_GAP_PER_SLAVE_EDGE = 0.05
# Limit of (mesh gap / edge length) / (interference / body diagonal). Above it pressures change by a
# tenth, and a warning is logged
_MAX_MESH_GAP_PER_EDGE_TO_DEPTH_PER_DIAGONAL = 0.03
_MESH_GAP_WARNING_MESSAGE = (
    "contact pair %d: gaps between the meshes within facets are a large part of its interference, "
    "and pressures are off by a tenth or more: use finer meshes, or DeformableSurface(..., "
    "coincident=True) and the depth as interference"
)
# Largest ratio of the mean edge of the slave to the mean edge of the master where they face each
# other. Above it a warning is logged
_MAX_SLAVE_TO_MASTER_EDGE_RATIO = 3.0
_NO_FACET_MESSAGE = "belong to no facet that is all in their pair"
_NO_OVERLAP_MESSAGE = (
    "contact pair %d: no part of its facets faces the opposite part: one of both is on the far "
    "side of its body, or they do not overlap"
)


@dataclass(frozen=True)
class ContactPairPoints:
    """The contact points (m) of one pair that belong to this process.

    Args:
        position: (m, dim), undeformed positions.
        cone: friction laws of the points.
        equation: (m, dim), for each component of a point's force, row of the reduced system in
            which it is the only contact force. This process owns the row. The number is -1 where
            the contact law does not apply because supports prescribe the displacement.
        motion_rows: (m dim, n), rows of the motion operator, which turns displacements into motions
            of the points.
        force_columns: (m dim, n), columns of the force operator as rows. The operator turns forces
            on the points into nodal forces.
        mean_cell_midpoint: (m, dim), mean midpoint of the adjacent cells. It distinguishes
            coincident points, for example of two bodies in contact.
        outward: (m, dim), vectors along the outward normal of the body, not normalised; zero where
            it is not defined.
        node: (m,), global index of the node at the point.
        faced: (m,), global index of the node that the point faces, or
            `FACED_INDEX_OF_RIGID_SURFACE` or `FACED_INDEX_OF_DEFORMABLE_SURFACE`.
        on_axis: (m, dim), mask of radial components at nodes on the axis of an axisymmetric body.
        counterpart: (m, dim), for each displacement component, global index of the nearest node of
            the deformable surface at which supports prescribe this component; -1 if there is none.
        opposite: (k,), global indices of the nodes of a deformable surface on all processes, in
            the order of `order_by_position`.
        facing_fraction: (m,), part of the area of each point that faces the other side before any
            motion; 1 at large sliding, where this part changes.
    """

    position: Array
    cone: FrictionCone
    equation: Indices
    motion_rows: sp.csr_matrix
    force_columns: sp.csr_matrix
    mean_cell_midpoint: Array
    outward: Array
    node: Indices
    faced: Indices
    on_axis: Mask
    counterpart: Indices
    opposite: Indices
    facing_fraction: Array


@dataclass(frozen=True)
class TangentPlaneSurface:
    """Surface that is defined by its gaps and its constant normals at given points.

    Args:
        position: (m, dim), initial positions of the points.
        initial_gap: (m,), gaps of the points at their initial positions.
        initial_normal: (m, dim), normals at the points.
    """

    position: Array
    initial_gap: Array
    initial_normal: Array

    def gap(self, x: Array) -> Array:
        """Return the gaps (m,) of the points after a translation to positions x (m, dim)."""
        return self.initial_gap + np.sum(self.initial_normal * (x - self.position), axis=1)

    def normal(self, x: Array) -> Array:  # noqa: ARG002
        return self.initial_normal


class BodyNodes:
    """Nodes of a body, with their positions, normals, and columns in the reduced system.

    Args:
        unknowns_space: space of all unknowns.
        reduction: supports of the body.

    Attributes:
        unknowns_space: space of all unknowns.
        displacements: the displacements among the unknowns.
        space: space of the displacements.
        x: (nodes, dim), positions of owned nodes and ghosts.
        reduced_column: (owned nodes, dim), column of each displacement in the reduced system, see
            `find_reduced_column_of_each_unknown`.
        outward_normal: (owned nodes, dim), outward normals of the boundary, integrated with the
            shape functions of the nodes.
        mean_cell_midpoint: (nodes, dim), mean of the midpoints of the adjacent cells.
        diagonal: length of the diagonal of the body's bounding box.
        on_axis: (nodes, dim), mask of radial components at nodes on an axis of revolution.
    """

    def __init__(self, unknowns_space: fem.FunctionSpace, reduction: Reduction) -> None:
        self.unknowns_space = unknowns_space
        self.displacements = SubSpace.displacements(unknowns_space)
        self.space = self.displacements.space
        mesh = self.space.mesh
        dim = mesh.geometry.dim
        self.x: Array = self.space.tabulate_dof_coordinates()[:, :dim]
        self.reduced_column: Indices = find_reduced_column_of_each_unknown(reduction.right)[
            self.displacements.owned_unknowns
        ]
        self.outward_normal = integrate_outward_normals(self.space)
        self.mean_cell_midpoint = average_midpoints_of_adjacent_cells(self.space)
        self.diagonal = float(
            np.linalg.norm(compute_bounding_box_extents(mesh.comm, mesh.geometry.x))
        )
        self.on_axis: Mask = np.zeros(self.x.shape, dtype=bool)

    def mark_axis_nodes(self, assembly: AssemblyRecord | None) -> None:
        """Mark radial components at nodes on the axis if the stiffness is known as axisymmetric.

        `assembly` is the record of how the stiffness was assembled, or None if there is none.
        """
        if assembly is not None and StressState.AXISYMMETRIC.value in assembly.stress_states:
            self.on_axis[:, 0] = (
                np.abs(self.x[:, 0]) <= _MAX_AXIS_DISTANCE_PER_BODY_DIAGONAL * self.diagonal
            )

    def find_owned_nodes(self, name_in_messages: str, part: EntitySelection) -> LocalIndices:
        """Return those nodes of a part of the body that this process owns.

        `name_in_messages` is the name of the part in error messages.
        """
        selected = locate_nodes(self.unknowns_space, name_in_messages, part)
        return selected[selected < self.space.dofmap.index_map.size_local]

    def raise_error_for_invalid_nodes(self, invalid_nodes: LocalIndices, reason: str) -> None:
        """Raise ValueError if `invalid_nodes` is not empty on some process; collective.

        The message lists the positions of these nodes of all processes, followed by `reason`.
        """
        positions = np.concatenate(self.space.mesh.comm.allgather(self.x[invalid_nodes]))
        if len(positions):
            raise ValueError(f"contact nodes at {format_points(positions)} {reason}")


def average_midpoints_of_adjacent_cells(space: fem.FunctionSpace | JoinedSpace) -> Array:
    """Return the mean midpoint (nodes, dim) of the cells around each node, ghosts included."""
    if isinstance(space, JoinedSpace):
        return space.join_nodal_values(
            [average_midpoints_of_adjacent_cells(body.space) for body in space.bodies]
        )
    mesh = space.mesh
    dim, n_owned = mesh.geometry.dim, mesh.topology.index_map(mesh.topology.dim).size_local
    sums = la.vector(space.dofmap.index_map, dim + 1)
    sums.array[:] = 0.0
    for start in range(0, n_owned, _MAX_CELLS_AT_ONCE):
        block = slice(start, min(start + _MAX_CELLS_AT_ONCE, n_owned))
        midpoint = mesh.geometry.x[cell_geometry_nodes(mesh)[block], :dim].mean(axis=1)
        midpoint_and_count = np.concatenate([midpoint, np.ones((len(midpoint), 1))], axis=1)
        cells = space.dofmap.list[block]
        repeated = np.repeat(midpoint_and_count, cells.shape[1], axis=0)
        np.add.at(sums.array.reshape(-1, dim + 1), cells.ravel(), repeated)
    sums.scatter_reverse(la.InsertMode.add)
    sums.scatter_forward()
    values = sums.array.reshape(-1, dim + 1)
    return np.asarray(values[:, :dim] / values[:, dim:])


def find_reduced_column_of_each_unknown(right_reduction_matrix: PETSc.Mat) -> Indices:
    """Return the column (reduced unknown) to which each owned unknown is equal.

    The rows of `right_reduction_matrix` express all unknowns in terms of the reduced ones. The
    column is -1 if the row has no entries, which means that the unknown is prescribed. It is -2 if
    the row has entries but is not a row of the identity.
    """
    indptr, indices, data = right_reduction_matrix.getValuesCSR()
    count = np.diff(indptr)
    column = np.where(count == 0, -1, -2).astype(np.int64)
    single = np.flatnonzero(count == 1)
    identity = single[data[indptr[single]] == 1.0]
    column[identity] = indices[indptr[identity]]
    return column


def make_contact_points_at_nodes(
    body: BodyNodes, nodes: LocalIndices, cone: FrictionCone, opposite_nodes: Indices | None
) -> ContactPairPoints:
    """Return contact points at owned nodes that face a rigid surface or matching nodes.

    Args:
        body: nodes of the body.
        nodes: (m,), owned nodes of the pair.
        cone: friction laws of the points.
        opposite_nodes: (m,), global numbers of the opposite nodes that the nodes face. None if
            there are no matching opposite nodes.
    """
    dim = body.x.shape[1]
    number = (nodes + body.space.dofmap.index_map.local_range[0]).astype(np.int64)
    ends = [(number, 1.0)] + ([] if opposite_nodes is None else [(opposite_nodes, -1.0)])
    dofs = [(end[:, None] * dim + np.arange(dim)).ravel() for end, _ in ends]
    value = np.repeat([sign for _, sign in ends], len(nodes) * dim)
    row = np.tile(np.arange(len(nodes) * dim), len(ends))
    shape = (len(nodes) * dim, body.displacements.local_and_global_size[1])
    motion = sp.csr_matrix((value, (row, np.concatenate(dofs))), shape)
    return ContactPairPoints(
        body.x[nodes],
        cone,
        body.reduced_column[nodes],
        motion,
        motion,
        body.mean_cell_midpoint[nodes],
        body.outward_normal[nodes],
        number,
        np.full_like(number, FACED_INDEX_OF_RIGID_SURFACE)
        if opposite_nodes is None
        else opposite_nodes,
        body.on_axis[nodes],
        np.full(body.x[nodes].shape, -1, dtype=np.int64),
        np.empty(0, dtype=np.int64),
        np.ones(len(nodes)),
    )


def match_opposite_nodes(
    pair_index: int,
    matching: MatchingNodes,
    nodes: LocalIndices,
    opposite_nodes: LocalIndices,
    has_friction: Mask,
    body: BodyNodes,
) -> Indices:
    """Return the global number (m,) of the opposite node that each node of a pair faces.

    Args:
        pair_index: index of the pair.
        matching: opposite part and its offset.
        nodes: (m,), owned nodes of the pair.
        opposite_nodes: (k,), owned nodes of the opposite side.
        has_friction: (m,), mask of the nodes that have friction.
        body: nodes of both bodies.

    Raises:
        ValueError: if nodes do not match one to one, or if a displacement of a node with friction
            is prescribed on the pair's own side only, so that the friction would be lost.
    """
    comm, dim = body.space.mesh.comm, body.x.shape[1]
    offset = np.zeros(dim) if matching.offset is None else np.asarray(matching.offset, dtype=float)
    if offset.shape != (dim,):
        raise ValueError(f"contact pair {pair_index}: its offset {offset.tolist()} is not {dim}-D")
    first_number = np.int64(body.space.dofmap.index_map.local_range[0])
    opposite_number, opposite_x, opposite_prescribed = (
        np.concatenate(comm.allgather(values))
        for values in (
            opposite_nodes + first_number,
            body.x[opposite_nodes],
            body.reduced_column[opposite_nodes] == -1,
        )
    )
    if not len(opposite_number):
        raise ValueError(
            f"contact pair {pair_index} has no opposite nodes: their marker holds nowhere"
        )
    distance, nearest = cKDTree(opposite_x).query(body.x[nodes] + offset)
    far = distance > _MAX_MATCHING_DISTANCE_PER_BODY_DIAGONAL * body.diagonal
    body.raise_error_for_invalid_nodes(nodes[far], "face no node of the opposite side")
    count = np.bincount(nearest, minlength=len(opposite_number))
    comm.Allreduce(MPI.IN_PLACE, count, MPI.SUM)
    body.raise_error_for_invalid_nodes(
        nodes[count[nearest] > 1], "face the same node of the opposite side"
    )
    prescribed = body.reduced_column[nodes] == -1
    one_sided = (prescribed & ~opposite_prescribed[nearest]).any(axis=1)
    body.raise_error_for_invalid_nodes(
        nodes[one_sided & has_friction],
        "have a prescribed displacement that their counterparts have not: exchange both sides",
    )
    return np.asarray(opposite_number[nearest])


def check_piecewise_linear_weight_functions(K: PETSc.Mat, space: fem.FunctionSpace) -> None:
    """Raise ValueError if a stiffness K has weight functions that are not piecewise linear.

    A stiffness without a record of its assembly is accepted. Weight functions are recognised by
    their values at a quarter of an edge, where quadratic functions are as low as -1/8.
    """
    assembled = read_record(K)
    if (test := assembled.test_space) is None:
        return
    element = (test.sub([0]) if is_hybrid(space) else test).element.basix_element
    quarter = np.eye(1, space.mesh.topology.dim) / 4
    if assembled.sibling is not None or element.tabulate(0, quarter).min() < -0.1:
        raise ValueError(
            "a deformable surface transfers forces by piecewise-linear weights, but the stiffness "
            "has other ones: use Spaces.petrov_galerkin or Spaces.hybrid"
        )


def _slave_node_numbers_and_facets_of_both_sides(
    pair_index: int, pair: ContactPair, nodes: LocalIndices, body: BodyNodes
) -> tuple[Indices, BoundaryFacets, BoundaryFacets]:
    """Return global numbers (m,) of a pair's owned nodes, and boundary facets of both sides.

    Args:
        pair_index: index of the pair.
        pair: pair with a deformable surface.
        nodes: (m,), owned nodes of the pair.
        body: nodes of both bodies.

    Raises:
        ValueError: for an empty side, nodes that belong to no facet or to both sides, or a sharp
            edge of the slave.
    """
    space, master, name = body.space, pair.surface, f"contact pair {pair_index}"
    assert isinstance(master, DeformableSurface)
    owned = nodes + np.int64(space.dofmap.index_map.local_range[0])
    pair_nodes = np.concatenate(space.mesh.comm.allgather(owned))
    if not len(pair_nodes):
        raise ValueError(f"{name} has no nodes: its marker holds nowhere")
    slave_sides, master_sides = (
        gather_boundary_facets_of_bodies(space, facets_of_bodies)
        for facets_of_bodies in (
            exterior_facets_of_bodies_with_all_nodes(space, pair_nodes),
            locate_exterior_facets_of_bodies(space, f"the surface of {name}", master.where),
        )
    )
    if not master_sides:
        raise ValueError(f"{name} has no opposite facets: their marker holds nowhere")
    if not slave_sides:
        body.raise_error_for_invalid_nodes(nodes, _NO_FACET_MESSAGE)
    if len(slave_sides) > 1 or len(master_sides) > 1:
        raise ValueError(
            f"{name} has a side on several meshes: give its mesh, as in (mesh, marker)"
        )
    (slave_trace,), (master_trace,) = slave_sides, master_sides
    without_facet = nodes[~np.isin(owned, slave_trace.facet_nodes)]
    body.raise_error_for_invalid_nodes(without_facet, _NO_FACET_MESSAGE)
    on_master = nodes[np.isin(owned, master_trace.facet_nodes)]
    body.raise_error_for_invalid_nodes(on_master, "belong to both sides of their pair")
    if len(edge_positions := slave_trace.find_sharp_edge_node_positions()):
        raise ValueError(
            f"{name} has an edge at {format_points(edge_positions)}, where its normal would belong "
            "to neither side: state each side as a pair of its own, one with the nodes of the edge"
        )
    return owned, slave_trace, master_trace


def make_sliding_mortar(
    slave: BoundaryFacets, master: BoundaryFacets, revolved: bool
) -> SlidingMortar:
    """Return the mortar of two sides at large sliding, in the plane or in space.

    Args:
        slave: boundary facets of the undeformed slave.
        master: boundary facets of the undeformed master.
        revolved: whether areas are those of the whole circumference (axisymmetric bodies).
    """
    if slave.space_dim == 2:
        return PlaneSlidingMortar(slave, master, revolved)
    return SpaceSlidingMortar(slave, master)


def make_large_sliding_mortar_points(
    pair_index: int,
    pair: ContactPair,
    nodes: LocalIndices,
    cone: FrictionCone,
    body: BodyNodes,
    revolved: bool,
) -> tuple[ContactPairPoints, TangentPlaneSurface, SlidingMortar]:
    """Return points, initial gaps and mortar of a pair of two bodies at large sliding.

    Args:
        pair_index: index of the pair.
        pair: pair with a deformable surface.
        nodes: (m,), owned nodes of the pair.
        cone: friction laws of the points.
        body: nodes of both bodies.
        revolved: whether areas are those of the whole circumference (axisymmetric bodies).
    """
    owned, slave, master = _slave_node_numbers_and_facets_of_both_sides(
        pair_index, pair, nodes, body
    )
    mortar = make_sliding_mortar(slave, master, revolved)
    undeformed = mortar.linearise(mortar.x)
    if not undeformed.faces_master.any():
        raise ValueError(_NO_OVERLAP_MESSAGE % pair_index)
    free = ~_find_prescribed_components(slave.nodes, body)
    # the same condition as in `_project_normals_into_symmetry_planes`
    near = (
        np.linalg.norm(undeformed.normals * free, axis=1) > _MIN_COSINE_OF_NORMAL_TO_SYMMETRY_PLANE
    )
    mortar.allowed_components[near] = free[near]
    undeformed = mortar.linearise(mortar.x)
    index = np.searchsorted(slave.nodes, owned)
    gap = np.where(undeformed.faces_master, undeformed.gaps, np.inf)[index]
    points = replace(
        make_contact_points_at_nodes(body, nodes, cone, None),
        **_make_master_fields_of_contact_points(owned, nodes, master, body),
    )
    return points, TangentPlaneSurface(body.x[nodes], gap, undeformed.normals[index]), mortar


def _make_master_fields_of_contact_points(
    global_nodes: Indices, local_nodes: LocalIndices, master: BoundaryFacets, body: BodyNodes
) -> dict[str, Any]:
    """Return the fields `faced`, `opposite` and `counterpart` of `ContactPairPoints`.

    These fields describe the master.

    Args:
        global_nodes: (m,), global numbers of the pair's owned nodes.
        local_nodes: (m,), local numbers of the same nodes.
        master: boundary facets of the master.
        body: nodes of both bodies.
    """
    x = master.node_positions()
    order, prescribed = order_by_position(x), _find_prescribed_components(master.nodes, body)
    counterpart = np.full(body.x[local_nodes].shape, -1, dtype=np.int64)
    for axis in range(x.shape[1]):
        candidates = np.flatnonzero(prescribed[:, axis])
        if len(candidates):
            nearest = cKDTree(x[candidates]).query(body.x[local_nodes])[1]
            counterpart[:, axis] = master.nodes[candidates[nearest]]
    return {
        "faced": np.full_like(global_nodes, FACED_INDEX_OF_DEFORMABLE_SURFACE),
        "opposite": master.nodes[order],
        "counterpart": counterpart,
    }


def make_small_sliding_mortar_points(
    pair_index: int,
    pair: ContactPair,
    nodes: LocalIndices,
    cone: FrictionCone,
    body: BodyNodes,
    revolved: bool,
    nominal_interference: Array | None,
) -> tuple[ContactPairPoints, TangentPlaneSurface]:
    """Return points and initial gaps of a pair of two bodies at small sliding.

    Points that do not face the master have an infinite gap.

    Args:
        pair_index: index of the pair.
        pair: pair with a deformable surface.
        nodes: (m,), owned nodes of the pair.
        cone: friction laws of the points.
        body: nodes of both bodies.
        revolved: whether areas are those of the whole circumference (axisymmetric bodies).
        nominal_interference: (m,), nominal interference if both sides are declared coincident; None
            for other pairs.
    """
    comm = body.space.mesh.comm
    owned, slave, master = _slave_node_numbers_and_facets_of_both_sides(
        pair_index, pair, nodes, body
    )
    overlap = OverlapQuadrature.from_slave_and_master(slave, master, owned, revolved)
    if comm.allreduce(len(overlap.measure), MPI.SUM) == 0:
        raise ValueError(_NO_OVERLAP_MESSAGE % pair_index)
    edge_ratio = overlap.average_edge_length(overlap.size_ratio, comm)
    if edge_ratio > _MAX_SLAVE_TO_MASTER_EDGE_RATIO:
        words = (
            f"contact pair {pair_index}: its facets are {edge_ratio:.1f} times as large as those "
            "they "
            "face; let the finer mesh be the pair's, or the opposite body's forces may have either "
            "sign"
        )
        log_on_root(comm, logging.WARNING, words, ".contact")
    m, dim = len(nodes), body.x.shape[1]
    shape = m, body.displacements.local_and_global_size[1] // dim
    area = overlap.integrate_with_weight_functions(np.ones(len(overlap.measure)), m)
    faced = area > 0
    inverse_area = sp.diags_array(1 / np.where(faced, area, 1.0))
    identity = sp.csr_array((np.ones(m), (np.arange(m), owned)), shape)
    unfaced_identity = sp.diags_array(np.where(faced, 0.0, 1.0)) @ identity
    (nodes1, N1), (nodes2, N2), (weight_nodes2, w2) = overlap.functions
    motion = overlap.assemble_product_integrals(overlap.weight, nodes1, N1, shape)
    motion -= overlap.assemble_product_integrals(overlap.weight, nodes2, N2, shape)
    force = identity - inverse_area @ overlap.assemble_product_integrals(
        overlap.dual, weight_nodes2, w2, shape
    )
    coupled = (
        overlap.assemble_product_integrals(overlap.weight, weight_nodes2, w2, shape)[
            :, master.nodes
        ]
        > 0
    )
    prescribed = body.reduced_column[nodes] == -1
    one_sided = prescribed & ~(coupled @ _find_prescribed_components(master.nodes, body))
    body.raise_error_for_invalid_nodes(
        nodes[faced & cone.has_friction & one_sided.any(axis=1)],
        "have a prescribed displacement that none of the nodes which they face has, so that these "
        "would get no friction: exchange both sides",
    )
    normal = _project_normals_into_symmetry_planes(
        -slave.average_normals(owned), body.reduced_column[nodes] >= 0
    )
    distance = np.stack(
        [overlap.integrate_with_weight_functions(x, m) for x in overlap.separation.T], axis=1
    )
    gap = np.where(faced, np.sum(normal * distance, axis=1) * inverse_area.diagonal(), np.inf)
    edge = overlap.average_edge_length(overlap.slave_size, comm)
    if nominal_interference is not None:
        body.raise_error_for_invalid_nodes(
            nodes[faced & (np.abs(gap) > _MAX_COINCIDENT_GAP_PER_SLAVE_EDGE * edge)],
            "lie away from the opposite side, farther than meshes of one surface do (coincident)",
        )
        gap = np.where(faced, -nominal_interference, np.inf)
    elif pair.interference:
        normal_distance = np.einsum("qki,qi->qk", normal[overlap.point], overlap.separation)
        mean_squares = (
            overlap.integrate_with_weight_functions(normal_distance**2, m) * inverse_area.diagonal()
        )
        _warn_of_mesh_gaps_large_for_interference(pair_index, mean_squares, gap, body, edge)
    axes = sp.eye_array(dim)
    whole_area = compute_tributary_areas(slave, revolved)[np.searchsorted(slave.nodes, owned)]
    fraction = area / whole_area
    points = replace(
        make_contact_points_at_nodes(body, nodes, cone, None),
        facing_fraction=np.where(fraction > _MIN_FRACTION_OF_WHOLE_AREA, 1.0, fraction),
        motion_rows=sp.csr_matrix(sp.kron(inverse_area @ motion + unfaced_identity, axes)),
        force_columns=sp.csr_matrix(sp.kron(force, axes)),
        **_make_master_fields_of_contact_points(owned, nodes, master, body),
    )
    return points, TangentPlaneSurface(body.x[nodes], gap, normal)


def _warn_of_mesh_gaps_large_for_interference(
    pair_index: int,
    mean_square_gap: Array,
    mean_gap: Array,
    body: BodyNodes,
    mean_edge_length: float,
) -> None:
    """Log a warning if gaps between the meshes are large relative to the interference.

    Args:
        pair_index: index of the pair.
        mean_square_gap: (m,), mean squares of the distances between both sides around each point.
        mean_gap: (m,), means of these distances.
        body: nodes of both bodies.
        mean_edge_length: mean length of an edge of the slave's sub-facets.
    """
    comm, pressed = body.space.mesh.comm, mean_gap < 0
    variance = (mean_square_gap - mean_gap**2)[pressed].clip(0)
    sums = np.array([np.sum(variance), np.sum(mean_gap[pressed]), len(variance)])
    total, depth, count = comm.allreduce(sums, MPI.SUM)
    if (
        np.sqrt(total * count) * body.diagonal
        > -_MAX_MESH_GAP_PER_EDGE_TO_DEPTH_PER_DIAGONAL * mean_edge_length * depth
    ):
        log_on_root(comm, logging.WARNING, _MESH_GAP_WARNING_MESSAGE % pair_index, ".contact")


def _find_prescribed_components(global_nodes: Indices, body: BodyNodes) -> Mask:
    """Return a mask (n, dim) of prescribed displacements of global nodes (n,); collective."""
    return (
        gather_nodal_values(body.space, global_nodes, (body.reduced_column == -1).astype(np.int8))
        > 0
    )


def _project_normals_into_symmetry_planes(normal: Array, is_free_component: Mask) -> Array:
    """Return unit normals (n, dim) in which small components along supports are set to zero.

    The normal at a node on a symmetry plane is the mean of the normals of facets on one side of the
    plane only, and may therefore point slightly out of the plane. `is_free_component` (n, dim) is a
    mask of the components that supports do not prescribe.
    """
    inside = np.where(is_free_component, normal, 0.0)
    length = np.linalg.norm(inside, axis=1, keepdims=True)
    near = length > _MIN_COSINE_OF_NORMAL_TO_SYMMETRY_PLANE
    return np.asarray(np.where(near, inside / np.where(near, length, 1.0), normal))


def gather_points_and_local_slice(comm: MPI.Comm, x: Array) -> tuple[Array, slice]:
    """Gather the points x (n, dim) of all processes; collective.

    Returns:
        The points of all processes in rank order, and the slice with the points of this process.
    """
    parts = comm.allgather(x)
    offset = sum(map(len, parts[: comm.rank]))
    return np.concatenate(parts), slice(offset, offset + len(x))


def compute_bounding_box_extents(comm: MPI.Comm, x: Array) -> Array:
    """Return the extents (dim,) along the axes of the points x of all processes; collective."""
    ends = np.stack([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, ends, MPI.MIN)
    return -ends.sum(axis=0)

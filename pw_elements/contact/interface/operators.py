"""The contact interface: contact points, and two operators that couple them to the bodies.

Let a be the displacements (n,) of all nodes, r the contact forces at the m points, K the stiffness
and f the load. The motion operator G and the force operator H are defined by

    motion of the points  = G a,          G (m dim, n),
    K a - f               = H r,          H (n, m dim).

`build_interface` makes the `ContactPairPoints` of each pair. Contact law, kinematics and iteration
deal with points only.

The module guarantees operators and surface values at the points of each process, and that errors
are raised on all processes. It assumes that only forces on its own node act in the equations of a
point, which `ContactPairPoints.equation` gives. It also assumes units in which G K^-1 H is a length
per force, since the factor c of the contact law is a force per length.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property
from itertools import pairwise
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import (
    arguments,
    call_user_function,
    format_points,
    raise_errors_on_all_processes,
)
from pw_elements.contact.interface.mortars import SlidingMortar
from pw_elements.contact.interface.pair_points import (
    FACED_INDEX_OF_DEFORMABLE_SURFACE,
    FACED_INDEX_OF_RIGID_SURFACE,
    ContactPairPoints,
    TangentPlaneSurface,
    compute_bounding_box_extents,
    gather_points_and_local_slice,
)
from pw_elements.contact.interface.shared_nodes import SharedNodes
from pw_elements.contact.model import (
    CLOSED_FORM_SURFACE_TYPES,
    SURFACE_TYPES_WITH_NORMAL_EVERYWHERE,
    FrictionCone,
    InterfaceLawEvaluation,
    PairState,
    SolutionNotFound,
    Surface,
)
from pw_elements.elasticity import order_by_position
from pw_elements.solvers import ComponentRigidModes
from pw_elements.spaces import SubSpace, gather_nodal_values

# Round-off of coordinates, relative to their magnitude
RELATIVE_COORDINATE_ROUND_OFF = 4 * float(np.finfo(float).eps)
# Largest initial penetration attributed to round-off and faceting, relative to the body's diagonal
_MAX_INITIAL_PENETRATION_PER_BODY_DIAGONAL = 1e-6
# Largest cosine between the normal and a direction in which a support prescribes the displacement
_MAX_COSINE_OF_NORMAL_TO_SUPPORTED_AXIS = 1e-8
# Largest relative difference between prescribed displacements that count as equal
_RELATIVE_SUPPORT_DISPLACEMENT_TOLERANCE = 1e-9
# Largest deviation of a unit normal's length from 1
_MAX_DEVIATION_FROM_UNIT_LENGTH = 1e-6
# Smallest cosine between a surface's normal and the body's outward normal at which the surface
# pushes the body outwards
MIN_COSINE_OF_OUTWARD_PUSHING_SURFACE_NORMAL = 0.1

# Types of surfaces that each process evaluates at its own points only; and types of surfaces whose
# evaluation cannot fail
_SURFACE_TYPES_EVALUATED_LOCALLY = (*CLOSED_FORM_SURFACE_TYPES, TangentPlaneSurface)
_SURFACE_TYPES_THAT_NEVER_RAISE = (*SURFACE_TYPES_WITH_NORMAL_EVERYWHERE, TangentPlaneSurface)
# For each method of a surface: name of its result, and layout of its argument and results, both for
# error messages
_RESULT_NAME_AND_LAYOUT_BY_SURFACE_METHOD = {
    "gap": ("gap", "it takes points as rows (n, dim) and gives (n,)"),
    "normal": ("normal", "it takes points as rows (n, dim) and gives (n, dim)"),
    "gap_normal_and_curvature": (
        "closest points",
        "it takes points as rows (n, dim), gives (n,), (n, dim) and (n, dim, dim)",
    ),
}


class InvalidContactNodes(ValueError):
    """Contact conditions cannot be stated at some nodes, due to their positions or surfaces."""


class ContactInterface:
    """The m contact points of this process, sorted by pair, with motion and force operators.

    Args:
        points: contact points of each pair.
        surfaces: surfaces of the pairs at their initial positions.
        field: subspace of the displacements in the space of all n unknowns.
        allows_interference: for each pair, whether its points may be inside its surface initially.
        sibling_inverse: matrix (n, n) that turns displacements into the coefficients of the
            symmetric sibling element; None if the unknowns are displacements.
        mortars: mortar of each pair of two bodies at large sliding, keyed by pair index. For these
            pairs it takes the place of `force` and of the kinematics.

    Attributes:
        pair: (m,), index of the pair of each point.
        pairs: number of pairs.
        motion: motion operator (m dim, n), which turns unknowns into motions of the points.
        force: force operator (n, m dim), which turns forces on the points into nodal forces.
        held_components: (m, dim), mask of components that supports hold at points with friction.
        holds_friction: whether any process has such held components.
        shared_nodes: points grouped by node; a node has one point for each of its pairs.
        laws: interface laws of the pairs; None if no pair has one.
        facing_fraction: (m,), see `ContactPairPoints`.
    """

    def __init__(
        self,
        points: Sequence[ContactPairPoints],
        surfaces: Sequence[Surface],
        field: SubSpace,
        allows_interference: Sequence[bool],
        sibling_inverse: PETSc.Mat | None,
        mortars: Mapping[int, SlidingMortar],
    ) -> None:
        self.mortars = mortars
        self.laws: InterfaceLawEvaluation | None = None
        self.field = field
        self.comm: MPI.Comm = field.space.mesh.comm
        self.surfaces, self.pairs = list(surfaces), len(surfaces)
        self._needs_no_guard = all(
            type(surface) in _SURFACE_TYPES_THAT_NEVER_RAISE for surface in surfaces
        )
        counts = [len(part.position) for part in points]
        self.pair = np.repeat(np.arange(len(points), dtype=np.int32), counts)
        ends = np.cumsum([0, *counts])
        self._points_of_each_pair = [slice(*range_of_pair) for range_of_pair in pairwise(ends)]

        def concatenate_over_pairs(attribute_name: str) -> npt.NDArray:
            return np.concatenate([getattr(part, attribute_name) for part in points])

        self.position: Array = concatenate_over_pairs("position")
        self.equation, self.node, self.faced, self.facing_fraction = map(
            concatenate_over_pairs, ("equation", "node", "faced", "facing_fraction")
        )
        self.shared_nodes = SharedNodes.from_node_numbers(self.node, self.comm)
        self.outward, self._mean_cell_midpoint = (
            concatenate_over_pairs("outward"),
            concatenate_over_pairs("mean_cell_midpoint"),
        )
        self.opposite = [part.opposite for part in points]
        self.motion = self.assemble_matrix_over_all_unknowns(
            sp.vstack([part.motion_rows for part in points], "csr")
        )
        self.force = self.assemble_matrix_over_all_unknowns(
            sp.vstack([part.force_columns for part in points], "csr")
        ).transpose(PETSc.Mat())
        self._sibling_inverse = sibling_inverse
        self._on_axis: Mask = concatenate_over_pairs("on_axis")
        self._counterpart = concatenate_over_pairs("counterpart")
        self._allows_interference = np.array(allows_interference)[self.pair]
        self._set_friction([part.cone for part in points])

    def _set_friction(self, cone_of_each_pair: Sequence[FrictionCone]) -> None:
        """Set the friction laws, and the components at which supports prescribe the slip."""
        self.cone = FrictionCone(
            [cone.laws[0] for cone in cone_of_each_pair],
            [cone.parameters[0] for cone in cone_of_each_pair],
            [],
        )
        # there is no friction on the axis of revolution, where it has no direction, nor between two
        # bodies along supports that prescribe the same motion of both
        faces_body = (self.faced == FACED_INDEX_OF_DEFORMABLE_SURFACE)[:, None]
        prescribed = (self.equation < 0) & ~self._on_axis & self.cone.has_friction[:, None]
        self.held_components: Mask = prescribed & ~faces_body
        self._held_between_bodies = prescribed & faces_body
        self.holds_friction: bool = self.comm.allreduce(bool(self.held_components.any()), MPI.LOR)

    def with_friction(self, cone_of_each_pair: Sequence[FrictionCone]) -> "ContactInterface":
        """Return the same interface with other friction laws, which are checked; collective.

        All else is shared with this interface. The points that have friction must stay the same in
        pairs of two bodies.

        Args:
            cone_of_each_pair: laws and parameters at the points of each pair.

        Raises:
            ValueError: if a law is invalid.
        """
        changed = copy(self)
        changed._set_friction(cone_of_each_pair)
        changed._check_friction_laws()
        return changed

    def check_laws_supports_and_initial_gaps(self, body_diagonal: float) -> None:
        """Check pairs, friction laws, supports, normals and initial gaps; collective.

        Args:
            body_diagonal: diagonal of the body's bounding box, to which penetrations are compared.

        Raises:
            ValueError: if pairs, laws, supports, normals or gaps do not define a contact problem.
        """
        for k in range(self.pairs):
            if self.comm.allreduce(int(np.sum(self.pair == k)), MPI.SUM) == 0:
                raise ValueError(f"contact pair {k} has no nodes: its marker holds nowhere")
        self._check_friction_laws()
        self.check_gaps_normals_and_supports(*self.evaluate_undeformed_gaps_and_normals(None))
        (gap,) = self._evaluate_surfaces_at_undeformed_points(None, "gap")
        cut = (
            ~(gap >= -_MAX_INITIAL_PENETRATION_PER_BODY_DIAGONAL * body_diagonal)
            & ~self._allows_interference
        )
        deepest = -self.gather_values(np.where(cut, gap, 0.0)).min()
        remedy = f"move them apart by {deepest:.3g}, or set interference=True in the pair"
        rigid = self.faced == FACED_INDEX_OF_RIGID_SURFACE
        self.raise_error_for_invalid_points(
            cut & rigid, f"lie inside the rigid surface before any motion: {remedy}"
        )
        self.raise_error_for_invalid_points(
            cut & ~rigid, f"lie inside the body that they face before any motion: {remedy}"
        )
        self._check_surface_normals_point_into_body()

    def _check_friction_laws(self) -> None:
        """Raise ValueError if a law or its coefficients are invalid; collective."""
        with np.errstate(invalid="ignore"):  # the coefficient may be infinite
            limit_at_zero, slope = self.cone.friction_limits_and_slopes(np.zeros(len(self.pair)))
        rises = self.cone.find_coefficients_rising_with_force()
        self.raise_law_errors_and_check_slopes()
        is_invalid = ~(np.isfinite(slope) & (slope >= 0) & (limit_at_zero == 0))
        self.raise_error_for_invalid_points(
            is_invalid, "have a friction coefficient that is negative or not finite"
        )
        self.raise_error_for_invalid_points(
            rises,
            "have a law of friction whose coefficient, the limit over the normal force, rises with "
            "the force: it must not rise, so that the slope of the limit at zero bounds it",
        )

    def raise_law_errors_and_check_slopes(self, normal_force: Array | None = None) -> None:
        """Raise the collected errors of users' friction laws on all processes; collective.

        Args:
            normal_force: normal forces (m,) at which slopes and coefficients are checked. If None,
                only collected errors are raised.

        Raises:
            ValueError: if a law gives a wrong slope or a coefficient that rises with the force.
        """
        if normal_force is not None:
            slope, difference, is_wrong = self.cone.compare_slopes_with_finite_differences(
                normal_force
            )
            rises = self.cone.find_coefficients_rising_near_force(normal_force)
        with raise_errors_on_all_processes(self.comm):
            call_user_function(self.comm, "a law of friction", self.cone.raise_collected_law_error)
        if normal_force is None:
            return
        with raise_errors_on_all_processes(self.comm):
            if is_wrong.any():
                k = int(is_wrong.argmax())
                raise ValueError(
                    f"the law of friction of contact pair {self.pair[k]} gives the slope "
                    f"{slope[k]:.6g} at the normal force {normal_force[k]:.6g} of the node at "
                    f"{format_points(self.position[[k]])}, but differences of its limit give "
                    f"{difference[k]:.6g}: return the limit's derivative by the force"
                )
            if rises.any():
                k = int(rises.argmax())
                raise ValueError(
                    f"the law of friction of contact pair {self.pair[k]} has a coefficient, the "
                    f"limit over the normal force, that rises at or below the normal force "
                    f"{normal_force[k]:.6g} of the node at {format_points(self.position[[k]])}: "
                    "it must "
                    "not rise, so that the slope of the limit at zero bounds it"
                )

    @cached_property
    def initial_interference(self) -> Array:
        """Initial depth (m,) of points inside their surface; zero in pairs without interference."""
        (gap,) = self._evaluate_surfaces_at_undeformed_points(None, "gap")
        return np.where(self._allows_interference, np.maximum(0.0, -gap), 0.0)

    def check_gaps_normals_and_supports(self, gap: Array, normal: Array) -> None:
        """Check gaps (m,), normals (m, dim), and that points can move along normals; collective.

        Raises:
            InvalidContactNodes: if the gap or normal of a node is invalid, or if a support
                prescribes the displacement of a node along its normal.
        """
        self.raise_error_for_invalid_points(
            np.isnan(gap), "face a surface whose gap is not a number"
        )
        faced = np.isfinite(gap)
        length = np.linalg.norm(normal, axis=1)
        is_unit = np.abs(length - 1) < _MAX_DEVIATION_FROM_UNIT_LENGTH
        self.raise_error_for_invalid_points(
            ~is_unit, "face a surface whose normal is no unit vector"
        )
        supported_part = np.where(self.equation < 0, normal, 0.0)
        is_held = (
            np.abs(supported_part).max(axis=1, initial=0) > _MAX_COSINE_OF_NORMAL_TO_SUPPORTED_AXIS
        )
        self.raise_error_for_invalid_points(
            is_held & faced,
            "have a prescribed normal displacement: they cannot be in contact. Let the pair end "
            "one facet away from the support",
        )

    def check_supports_move_both_sides_equally(
        self, prescribed_displacements: PETSc.Vec, master_translations: Array, pressed: Mask
    ) -> None:
        """Check that supports move both sides of each pair with friction equally; collective.

        The check applies to pairs of two bodies. If supports prescribe the same motion of both
        sides, as on a plane of symmetry, there is no friction along the supports.

        Args:
            prescribed_displacements: prescribed displacements (n,).
            master_translations: translations (pairs, dim) of the masters, NaN where they are free.
            pressed: (m,), mask of nodes with a contact force. Other nodes are not checked.

        Raises:
            ValueError: if the prescribed displacements of the two sides differ.
        """
        is_held, counterpart = self._held_between_bodies, self._counterpart
        counterparts = np.unique(self.gather_values(counterpart[is_held]))
        if not len(counterparts):
            return
        dim = is_held.shape[1]
        values = self.extract_displacements_at_nodes(
            np.maximum(counterparts, 0), prescribed_displacements
        )
        index = np.searchsorted(counterparts, np.where(is_held, counterpart, counterparts[0]))
        master = np.take_along_axis(values[index], np.arange(dim)[None, :, None], axis=2)[..., 0]
        master = master + master_translations[self.pair, :dim]
        slave = self.extract_displacements_at_points(prescribed_displacements)
        difference = np.where(counterpart < 0, np.inf, np.abs(slave - master))
        allowed = (
            _RELATIVE_SUPPORT_DISPLACEMENT_TOLERANCE * (np.abs(slave) + np.abs(master))
            + RELATIVE_COORDINATE_ROUND_OFF * self.max_extent_of_points
        )
        is_invalid = is_held & pressed[:, None] & ~(difference <= allowed)
        positions = self.gather_values(self.position[is_invalid.any(axis=1)])
        if len(positions):
            raise ValueError(
                f"contact nodes at {format_points(positions)} have a prescribed displacement "
                "along the surface, but the opposite side is not moved in the same way: friction "
                "between the two bodies is not defined there. Prescribe the same displacement on "
                "both sides, leave these nodes free, or replace the moved body by a rigid surface"
            )

    def _check_surface_normals_point_into_body(self) -> None:
        gap, normal = self.evaluate_undeformed_gaps_and_normals(None)
        pushed = np.sum(normal * self.outward, axis=1)
        is_outwards = pushed > MIN_COSINE_OF_OUTWARD_PUSHING_SURFACE_NORMAL * np.linalg.norm(
            self.outward, axis=1
        )
        is_checked = np.any(self.outward != 0, axis=1) & np.isfinite(gap)
        for k in range(self.pairs):
            is_inwards = self.gather_values(~is_outwards[is_checked & (self.pair == k)])
            if len(is_inwards) and not is_inwards.any():
                raise ValueError(
                    f"the surface of contact pair {k} pushes the body outwards at each of its "
                    "nodes: its direction has to point from the rigid surface into the body; "
                    "reverse it"
                )

    def raise_error_for_invalid_points(self, is_invalid: Mask, fault: str) -> None:
        """Raise InvalidContactNodes if any point of any process is invalid; collective.

        Args:
            is_invalid: (m,), mask of invalid points. The message lists their positions.
            fault: verb phrase that follows "contact nodes at ..." in the message.
        """
        positions = self.gather_values(self.position[is_invalid])
        if len(positions):
            raise InvalidContactNodes(f"contact nodes at {format_points(positions)} {fault}")

    def gather_values(self, values: npt.NDArray) -> npt.NDArray:
        """Return the concatenated values (k, ...) of all processes in rank order; collective."""
        return np.concatenate([values] if self.comm.size == 1 else self.comm.allgather(values))

    def gather_pair_in_position_order(self, pair_index: int, values: npt.NDArray) -> npt.NDArray:
        """Gather the values at the points of one pair from all processes; collective.

        Args:
            pair_index: index of the pair.
            values: (m, ...), values at all contact points of this process.

        Returns:
            Values (k, ...) at the pair's points of all processes, sorted by position.
        """
        return self.gather_values(values[self._points_of_each_pair[pair_index]])[
            self._position_order_of_each_pair[pair_index]
        ]

    def gather_all_pairs_in_position_order(
        self, values: Mapping[str, npt.NDArray]
    ) -> list[dict[str, npt.NDArray]]:
        """Gather named values at the points of each pair, sorted by position; collective.

        Args:
            values: arrays (m, ...) at the points of this process, by name.

        Returns:
            For each pair, arrays (k, ...) at its points of all processes, by name.
        """
        own_part = self.pair, dict(values)
        of_ranks = [own_part] if self.comm.size == 1 else self.comm.allgather(own_part)
        return [
            {
                name: np.concatenate([part[name][pair == k] for pair, part in of_ranks])[order]
                for name in values
            }
            for k, order in enumerate(self._position_order_of_each_pair)
        ]

    def extract_local_pair_state_values(
        self, pair_states: Sequence[PairState], *attribute_names: str
    ) -> list[npt.NDArray]:
        """Return attributes (m, ...) of the pairs' states at this process' contact points.

        Args:
            pair_states: state of each pair.
            attribute_names: names of the attributes.
        """
        local_rows = list(
            zip(pair_states, self._rows_of_local_points_in_position_order, strict=True)
        )
        return [
            np.concatenate([getattr(state, name)[rows] for state, rows in local_rows])
            for name in attribute_names
        ]

    def assemble_matrix_over_all_unknowns(self, displacement_rows: sp.csr_matrix) -> PETSc.Mat:
        """Return the distributed matrix with the given rows and one column per unknown.

        Each process contributes its own `displacement_rows`, in which a column belongs to a
        displacement. The matrix has a column for each of the n unknowns.
        """
        csr = (
            displacement_rows.indptr.astype(PETSc.IntType),
            displacement_rows.indices.astype(PETSc.IntType),
            displacement_rows.data,
        )
        sizes = ((displacement_rows.shape[0], PETSc.DETERMINE), self.field.local_and_global_size)
        matrix = PETSc.Mat().createAIJ(sizes, csr=csr, comm=self.comm)
        return (
            matrix if self.field.is_whole_space else matrix.matMult(self.field.extraction_matrix())
        )

    @cached_property
    def _position_order_of_each_pair(self) -> list[npt.NDArray[np.intp]]:
        """Indices that sort the points of each pair, gathered from all processes, by position."""
        return [
            order_by_position(
                self.gather_values(self.position[self.pair == k]),
                self.gather_values(self._mean_cell_midpoint[self.pair == k]),
            )
            for k in range(self.pairs)
        ]

    @cached_property
    def _rows_of_local_points_in_position_order(self) -> list[Indices]:
        """For each pair, rows of this process' points in `gather_pair_in_position_order`."""
        rows = []
        for k, order in enumerate(self._position_order_of_each_pair):
            counts = self.comm.allgather(int(np.sum(self.pair == k)))
            offset = sum(counts[: self.comm.rank])
            rows.append(np.argsort(order)[offset : offset + counts[self.comm.rank]])
        return rows

    @property
    def local_node_indices(self) -> Indices:
        """Local indices (m,) of the nodes at the points, all of which this process owns."""
        node_offset: int = self.field.space.dofmap.index_map.local_range[0]
        return np.asarray(self.node - node_offset)

    @cached_property
    def first_node_position_of_each_pair(self) -> list[Array]:
        """Position (1, dim) of the first node of each pair.

        Processes without points evaluate users' surfaces at this position. Thus all processes call
        a surface equally often, and the surface may use collective communication.
        """
        return [self.gather_pair_in_position_order(k, self.position)[:1] for k in range(self.pairs)]

    @cached_property
    def rigid_modes_of_pieces(self) -> ComponentRigidModes:
        """Rigid modes of the connected pieces of the undeformed body."""
        return ComponentRigidModes.from_space(self.field.space)

    @cached_property
    def max_extent_of_points(self) -> float:
        """Largest extent, along any axis, of the undeformed contact points of all processes."""
        return float(compute_bounding_box_extents(self.comm, self.position).max())

    def compute_forces_on_opposite_nodes(
        self, point_forces: Array, force_operator: PETSc.Mat
    ) -> list[Array]:
        """Return the nodal forces (k, dim) on the `opposite` nodes of each pair; collective.

        Args:
            point_forces: forces (m, dim) on the points.
            force_operator: matrix (n, m dim) that turns forces on the points into nodal forces.
        """
        forces: list[Array] = [np.zeros((0, point_forces.shape[1])) for _ in self.opposite]
        for k, nodes in enumerate(self.opposite):
            if len(nodes):
                points = force_operator.createVecRight()
                points.setArray(np.where((self.pair == k)[:, None], point_forces, 0.0).ravel())
                forces[k] = self.extract_displacements_at_nodes(nodes, force_operator * points)
        return forces

    def extract_displacements_at_points(self, unknowns: PETSc.Vec) -> Array:
        """Return the displacements (m, dim) of the nodes at the points, given all unknowns (n,)."""
        values = self.field.extract(unknowns).array_r.reshape(-1, self.position.shape[1])
        return np.asarray(values[self.local_node_indices])

    def extract_displacements_at_nodes(self, global_nodes: Indices, unknowns: PETSc.Vec) -> Array:
        """Return the displacements (k, dim) at nodes with global numbers (k,); collective.

        The displacements are taken from all `unknowns` (n,).
        """
        values = self.field.extract(unknowns).array_r.reshape(-1, self.position.shape[1])
        return gather_nodal_values(self.field.space, global_nodes, values)

    def evaluate_undeformed_gaps_and_normals(
        self, surface_translations: Array | None
    ) -> tuple[Array, Array]:
        """Return gaps (m,) and normals (m, dim) of translated surfaces; collective.

        Surfaces are evaluated at the undeformed points. They are translated by
        `surface_translations` (pairs, dim), or not at all if these are None. For the symmetric
        sibling element, gaps are transformed to its basis in the same way as displacements.
        """
        normal, gap = self._evaluate_surfaces_at_undeformed_points(
            surface_translations, "normal", "gap"
        )
        if self._sibling_inverse is not None:
            gap = self._transform_gaps_to_sibling_element_basis(self._sibling_inverse, gap, normal)
        return gap, normal

    def evaluate_undeformed_normals(self, surface_translations: Array | None) -> Array:
        """Return the normals (m, dim) of translated surfaces at the undeformed points; collective.

        Surfaces are translated by `surface_translations` (pairs, dim), or not at all if these are
        None.
        """
        (normal,) = self._evaluate_surfaces_at_undeformed_points(surface_translations, "normal")
        return normal

    def _evaluate_surfaces_at_undeformed_points(
        self, translations: Array | None, *method_names: str
    ) -> list[Array]:
        """Return values (m, ...) of methods of surfaces translated by (pairs, dim); collective."""
        shapes = {"gap": self.position[:, 0], "normal": self.position}
        values = [np.empty_like(shapes[method]) for method in method_names]
        translation = 0.0 if translations is None else translations[self.pair]
        results = {method: [array] for method, array in zip(method_names, values, strict=True)}
        self._call_method_of_all_surfaces(self.position - translation, results)
        return values

    def _transform_gaps_to_sibling_element_basis(
        self, sibling_inverse: PETSc.Mat, gap: Array, normal: Array
    ) -> Array:
        """Return gaps (m,), transformed to the basis of the symmetric sibling element; collective.

        A node keeps its own gap if its coefficient depends on another node that no surface faces.

        Args:
            sibling_inverse: matrix (n, n) that turns displacements into coefficients of the sibling
                element.
            gap: gaps (m,) at the nodes.
            normal: normals (m, dim) at the nodes.
        """
        faced = np.isfinite(gap)
        begin, end = sibling_inverse.getOwnershipRange()
        dim = normal.shape[1]
        node = self.node - begin // dim

        def apply_inverse(values: Array) -> Array:
            vector = sibling_inverse.createVecRight()
            nodal_values = np.zeros(((end - begin) // dim, dim))
            nodal_values[node] = values
            vector.setArray(nodal_values.ravel())
            return np.asarray((sibling_inverse * vector).array_r.reshape(-1, dim)[node])

        row_sums = apply_inverse(np.tile(faced[:, None], dim))[:, 0]
        depends_on_faced_nodes = np.abs(row_sums - 1) < _MAX_DEVIATION_FROM_UNIT_LENGTH
        gap_vector = apply_inverse(np.where(faced, gap, 0.0)[:, None] * normal)
        return np.where(depends_on_faced_nodes, np.sum(gap_vector * normal, axis=1), gap)

    def evaluate_gaps_normals_and_curvatures(
        self, motion_in_surface_frame: Array
    ) -> tuple[Array, Array, Array]:
        """Return gaps (m,), normals (m, dim) and derivatives (m, dim, dim) of normals; collective.

        Derivatives are with respect to the positions of the points. Gaps are infinite where no
        surface faces a point. In pairs of two bodies all values are zero.

        Args:
            motion_in_surface_frame: (m, dim), motions of the points in the frames of their
                surfaces.

        Raises:
            SolutionNotFound: if a surface has no point that is closest to a contact point.
        """
        gap, normal, curvature = self.evaluate_gaps_normals_and_curvatures_or_nan(
            motion_in_surface_frame
        )
        positions = self.gather_values(self.position[np.isnan(gap)])
        if len(positions):
            raise SolutionNotFound.with_positions(
                "contact nodes initially at {} have no closest point", positions
            )
        return gap, normal, curvature

    def evaluate_gaps_normals_and_curvatures_or_nan(
        self, motion_in_surface_frame: Array
    ) -> tuple[Array, Array, Array]:
        """Return gaps, normals and curvatures, NaN where there is no closest point; collective."""
        dim = motion_in_surface_frame.shape[1]
        results = [
            np.zeros((len(motion_in_surface_frame), *shape)) for shape in ((), (dim,), (dim, dim))
        ]
        # it has been checked that all surfaces have a method `gap_normal_and_curvature`
        self._call_method_of_all_surfaces(
            self.position + motion_in_surface_frame, {"gap_normal_and_curvature": results}
        )
        gap, normal, curvature = results
        is_finite = np.isfinite(gap) & np.isfinite(curvature).all(axis=(1, 2))
        is_valid = (is_finite | np.isposinf(gap)) & np.isfinite(normal).all(axis=1)
        for values in results:
            values[~is_valid] = np.nan
        return gap, normal, curvature

    def _call_method_of_all_surfaces(
        self, x: Array, output_arrays: Mapping[str, Sequence[Array]]
    ) -> None:
        """Call methods of all surfaces at points x (m, dim); write the values to `output_arrays`.

        Each process calls a user's surface with the points of all processes. Thus all processes
        call the surface equally often, and the surface may communicate between processes, or
        iterate until all points converge.

        Args:
            x: positions (m, dim) of the points in the frames of their surfaces.
            output_arrays: for each method ("gap", "normal" or "gap_normal_and_curvature"), one
                array (m, ...) for each array that the method returns.

        Raises:
            ValueError: on all processes, if a user's surface raises an error or returns arrays of
                wrong shapes.
        """
        calls = [
            (k, surface, self._points_of_each_pair[k])
            for k, surface in enumerate(self.surfaces)
            if not ("gap_normal_and_curvature" in output_arrays and k in self.mortars)
        ]
        if self._needs_no_guard:
            for _, surface, of_pair in calls:
                for method, arrays in output_arrays.items():
                    value = getattr(surface, method)(x[of_pair])
                    values = _wrap_single_result_in_tuple(method, value)
                    for array, part in zip(arrays, values, strict=True):
                        array[of_pair] = part
            return
        calls_with_points = []
        for k, surface, of_pair in calls:
            if type(surface) in _SURFACE_TYPES_EVALUATED_LOCALLY:
                points, local_part = x[of_pair], slice(None)
            else:
                points, local_part = gather_points_and_local_slice(self.comm, x[of_pair])
            if len(points):
                calls_with_points.append((k, of_pair, points, local_part))
        for method, arrays in output_arrays.items():
            quantity, layout = _RESULT_NAME_AND_LAYOUT_BY_SURFACE_METHOD[method]
            with raise_errors_on_all_processes(self.comm):
                for k, of_pair, points, local_part in calls_with_points:
                    subject = f"the {quantity} of the surface of contact pair {k}"
                    function = getattr(self.surfaces[k], method)
                    value = call_user_function(self.comm, subject, function, points.copy())
                    for array, part in zip(
                        arrays, _wrap_single_result_in_tuple(method, value), strict=True
                    ):
                        shape = (len(points), *array.shape[1:])
                        part = arguments.check_user_function_values(subject, part, shape, layout)
                        array[of_pair] = part[local_part]


def _wrap_single_result_in_tuple(method: str, value: Any) -> Sequence[Any]:  # noqa: ANN401
    """Return the result of a surface's method, one or several arrays, as a sequence."""
    return value if method == "gap_normal_and_curvature" else (value,)

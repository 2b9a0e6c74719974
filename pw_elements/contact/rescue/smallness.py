"""Checks of the assumptions of a solved increment; warnings or errors report violations.

Displacements have to be small, and rigid surfaces have to stay outside the body. The slip that the
friction law uses (`PairState.slip`) has to agree with the slip along the path of material points
(`PairState.path_slip`). The guide's page on theory explains which motions of rigid surfaces are
refused ("Contact"). The module assumes a body at small strains and a solution of the increment.
"""

import logging
from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices

from pw_elements._compat import cell_geometry_nodes
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import format_points, raise_errors_on_all_processes
from pw_elements.contact.interface import (
    FACED_INDEX_OF_RIGID_SURFACE,
    MIN_COSINE_OF_OUTWARD_PUSHING_SURFACE_NORMAL,
    ContactInterface,
    compute_facet_nodes_positions_and_facet_normals,
)
from pw_elements.contact.iteration import IncrementEquations, NewtonIterate
from pw_elements.contact.model import (
    ContactState,
    PairState,
    SmallDisplacementMeasures,
    SurfacePassed,
)
from pw_elements.contact.nodes import OPEN, IncrementStart
from pw_elements.progress import log_on_root

# Number of cells whose gradients are evaluated at once
_GRADIENT_BATCH_SIZE_IN_CELLS = 4_000

# Strain below which no node of a body can have been pushed beyond the far side of the body. The
# strain around such a node would be about one
_MIN_STRAIN_TO_CROSS_THICKNESS = 0.5
# Largest distance between positions that counts as round-off, relative to the largest coordinate
_RELATIVE_POSITION_ROUND_OFF = 1e-9
# Step along a surface's path, and depth from which on a node counts as inside the surface, both
# relative to the smallest facet
_SURFACE_PATH_STEP_IN_FACETS = 0.25
_MIN_DEPTH_INSIDE_SURFACE_IN_FACETS = 1e-3
_MAX_SURFACE_PATH_STEPS = 10_000
# Offset of positions, relative to the smallest facet, that avoids points where a surface has no
# normal
_OFFSET_FROM_SINGULAR_POINTS_IN_FACETS = 1e-7

# Largest accepted difference between `PairState.slip` and `path_slip`, relative to the larger one
MAX_RELATIVE_PATH_SLIP_DIFFERENCE = 0.1
# Difference between both slips that is allowed in any case. For two sliding bodies, where slip is a
# mean over facets, it is relative to the shortest facet around a node. For all other pairs, it is
# relative to the largest displacement
_ALLOWED_SLIP_DIFFERENCE_PER_FACET_SIZE, _ALLOWED_SLIP_DIFFERENCE_PER_MAX_DISPLACEMENT = 0.05, 1e-6

# Limits of small displacements. Neglected second-order terms change a strain e by e^2/2. A rotation
# w turns forces by w and causes strains of w^2/2. After a slip of half a facet, a node would face a
# different node
_SMALL_DISPLACEMENT_LIMITS = SmallDisplacementMeasures(strain=0.05, rotation=0.05, slip=0.5)


def prepare_gradients_at_vertices(u: fem.Function) -> Callable[[slice], Array]:
    """Return a function that evaluates the gradient of displacements u at vertices of cells.

    On straight simplices with quadratic displacements, the gradient is linear, so the norms of its
    symmetric and antisymmetric parts are largest at vertices. The derivatives of the shape
    functions are tabulated, since it would take longer to compile or load a form.

    Args:
        u: displacements, with nodal values as unknowns.

    Returns:
        Function that takes a range of owned cells and returns gradients (cells, vertices, dim, dim)
        of the present values of u.
    """
    space, mesh = u.function_space, u.function_space.mesh
    dim, vertices = mesh.geometry.dim, basix.geometry(mesh.basix_cell())
    geometry = mesh.ufl_domain().ufl_coordinate_element().basix_element
    is_affine = geometry.degree == 1 and len(vertices) == dim + 1

    def tabulate_slopes(element: basix.finite_element.FiniteElement, points: Array) -> Array:
        """Return derivatives (nodes, dim, points) with respect to reference coordinates."""
        return np.moveaxis(element.tabulate(1, points)[1:, :, :, 0], 2, 0)

    def derive(slopes: Array, nodal_vectors: Array) -> Array:
        """Return derivatives (cells, points, dim, dim) for vectors (cells, nodes, dim)."""
        n_nodes, _, n_points = slopes.shape
        components = np.swapaxes(nodal_vectors, 1, 2).reshape(-1, n_nodes)
        derivatives = components @ slopes.reshape(n_nodes, -1)
        return derivatives.reshape(-1, dim, dim, n_points).transpose(0, 3, 1, 2)

    n_cells = mesh.topology.index_map(mesh.topology.dim).size_local
    x = mesh.geometry.x[cell_geometry_nodes(mesh)[:n_cells], :dim]
    geometry_slopes = tabulate_slopes(geometry, vertices[:1] if is_affine else vertices)
    inverse_jacobians = np.linalg.inv(derive(geometry_slopes, x))
    slopes, nodes = tabulate_slopes(space.element.basix_element, vertices), space.dofmap.list

    def evaluate_gradients(cells: slice) -> Array:
        nodal_displacements = u.x.array.reshape(-1, dim)[nodes[cells]]
        return np.asarray(derive(slopes, nodal_displacements) @ inverse_jacobians[cells])

    return evaluate_gradients


def measure_max_strain_and_rotation(
    evaluate_gradients: Callable[[slice], Array], u: fem.Function, displacement: PETSc.Vec
) -> tuple[float, float]:
    """Return the largest strain and the largest rotation in the cells of all processes.

    Strain and rotation are the spectral norms of the symmetric and the antisymmetric part of the
    gradient; the rotation is an angle in radians. The hoop strain of axisymmetric bodies is left
    out, since the stiffness does not show whether a body is axisymmetric.

    Args:
        evaluate_gradients: function that `prepare_gradients_at_vertices` returns for u.
        u: function that is set to the displacements.
        displacement: displacement vector (n,) in the numbering of the space of u.
    """
    mesh = u.function_space.mesh
    u.x.array[: displacement.getLocalSize()] = displacement.array_r
    u.x.scatter_forward()
    dim, n_cells = mesh.geometry.dim, mesh.topology.index_map(mesh.topology.dim).size_local
    strain, rotation = 0.0, 0.0
    for first_cell in range(0, n_cells, _GRADIENT_BATCH_SIZE_IN_CELLS):
        cells = slice(first_cell, min(first_cell + _GRADIENT_BATCH_SIZE_IN_CELLS, n_cells))
        values = evaluate_gradients(cells).reshape(-1, dim, dim)
        transposed = np.swapaxes(values, 1, 2)
        symmetric, skew = (values + transposed) / 2, (values - transposed) / 2
        frobenius = np.linalg.norm(symmetric, axis=(1, 2))
        # the spectral norm is at most the Frobenius norm, and at least that norm divided by
        # sqrt(dim)
        strain = max(strain, float(frobenius.max()) / np.sqrt(dim))
        principal_strains = np.linalg.eigvalsh(symmetric[frobenius >= strain])
        strain = float(np.abs(principal_strains).max(initial=strain))
        # the spectral norm is the length of the axial vector; each component of this vector occurs
        # twice in the matrix
        angles = np.linalg.norm(skew, axis=(1, 2)) / np.sqrt(2)
        rotation = max(rotation, float(angles.max()))
    return mesh.comm.allreduce(strain, MPI.MAX), mesh.comm.allreduce(rotation, MPI.MAX)


def warn_if_no_longer_small(
    smallness: SmallDisplacementMeasures,
    previous_smallness: SmallDisplacementMeasures,
    message_start: str,
    comm: MPI.Comm,
) -> None:
    """Log a warning if strain, rotation or slip leaves the range of small displacements.

    A quantity that was out of range before causes no further warning.

    Args:
        smallness: strain, rotation and slip of a state.
        previous_smallness: strain, rotation and slip of the previous state.
        message_start: start of the message.
        comm: communicator of the mesh.
    """
    large_quantities = [
        f"largest {name} {value:.3g} (above {limit:g})"
        for name, value in vars(smallness).items()
        if value
        > (limit := getattr(_SMALL_DISPLACEMENT_LIMITS, name))
        >= getattr(previous_smallness, name)
    ]
    if large_quantities:
        quantities = ", ".join(large_quantities)
        words = f"{message_start} leaves the range of small displacements: {quantities}"
        log_on_root(comm, logging.WARNING, words, ".contact")


class SmallDisplacementAndSurfacePassingCheck:
    """Check that displacements stay small, and that rigid surfaces stay outside the body.

    Args:
        interface: the m contact nodes.
        space: space of the displacements.

    Attributes:
        min_facet_sizes: size of the smallest facet of each pair.
    """

    def __init__(self, interface: ContactInterface, space: fem.FunctionSpace) -> None:
        self._interface, self._comm = interface, interface.comm
        self._u = fem.Function(space)
        self._evaluate_gradients = prepare_gradients_at_vertices(self._u)
        self._node_of_facet, self._facet_normal, size = _nodes_normals_and_sizes_of_exterior_facets(
            interface.node, space
        )
        self._facet_size = np.full(len(interface.node), np.inf)
        np.minimum.at(self._facet_size, self._node_of_facet, size)
        in_pairs = [interface.pair == k for k in range(interface.pairs)]
        self.min_facet_sizes = [
            self._comm.allreduce(self._facet_size[in_pair].min(initial=np.inf), MPI.MIN)
            for in_pair in in_pairs
        ]
        self._is_rigid_pair = [
            not self._comm.allreduce(
                bool(np.any(interface.faced[in_pair] != FACED_INDEX_OF_RIGID_SURFACE)), MPI.LOR
            )
            for in_pair in in_pairs
        ]

    def raise_if_prescribed_motion_passes_body(self, increment: IncrementEquations) -> None:
        """Raise SurfacePassed if prescribed translations move a rigid surface through the body."""
        start = increment.start
        is_prescribed = np.isfinite(increment.prescribed_motions)
        self._raise_if_surfaces_pass_body(
            start, np.where(is_prescribed, increment.prescribed_motions, start.q)
        )

    def check_passing_and_measure_smallness(
        self, increment: IncrementEquations, end: NewtonIterate, start_state: ContactState
    ) -> SmallDisplacementMeasures:
        """Return the largest strain, rotation and slip of a solution; warn if one is too large.

        Args:
            increment: the equations of the increment.
            end: solution of the increment.
            start_state: state at the start of the increment.

        Raises:
            SurfacePassed: if a rigid surface has gone through the body or pushes it outwards.
        """
        self._raise_if_surfaces_pass_body(increment.start, end.q)
        interface, nodes = self._interface, end.nodes
        displacement = interface.field.extract(end.unknowns)
        strain, rotation = measure_max_strain_and_rotation(
            self._evaluate_gradients, self._u, displacement
        )
        is_closed = nodes.active_set.status != OPEN
        cosine = self._min_cosine_to_outward_normals(nodes.frame[:, 0])
        for k in np.flatnonzero(self._is_rigid_pair):
            in_pair = is_closed & (interface.pair == k)
            self._raise_surface_passed_if_any(
                k,
                in_pair & (cosine > MIN_COSINE_OF_OUTWARD_PUSHING_SURFACE_NORMAL),
                "pushes the body outwards at",
            )
            if strain > _MIN_STRAIN_TO_CROSS_THICKNESS:
                is_beyond = in_pair & self._find_nodes_pushed_beyond_far_side(end)
                self._raise_surface_passed_if_any(
                    k, is_beyond, "is through the whole thickness of the body at"
                )
        smallness = SmallDisplacementMeasures(
            strain, rotation, self._measure_max_slip_in_facets(increment, end)
        )
        when = f"increment {start_state.increment}"
        warn_if_no_longer_small(
            smallness, start_state.smallness or SmallDisplacementMeasures(), when, self._comm
        )
        return smallness

    def _measure_max_slip_in_facets(
        self, increment: IncrementEquations, end: NewtonIterate
    ) -> float:
        """Return the largest slip of a closed node, divided by the size of its facets.

        On rigid surfaces, slip is measured from the start of the increment; between two bodies, it
        is measured from the undeformed state.
        """
        interface, nodes = self._interface, end.nodes
        relative_motion = end.displacement - end.q[interface.pair]
        start_motion = increment.start.displacement - increment.start.q[interface.pair]
        relative_motion = relative_motion - np.where(
            (interface.faced == FACED_INDEX_OF_RIGID_SURFACE)[:, None], start_motion, 0.0
        )
        slip = np.linalg.norm(np.einsum("nab,nb->na", nodes.frame[:, 1:], relative_motion), axis=1)
        is_closed = nodes.active_set.status != OPEN
        max_slip = np.max(slip / self._facet_size, where=is_closed, initial=0.0)
        return float(self._comm.allreduce(max_slip, MPI.MAX))

    def _min_cosine_to_outward_normals(self, unit_vectors: Array) -> Array:
        """Return the smallest cosine (m,) between a node's vector and its facets' outward normals.

        Args:
            unit_vectors: unit vectors (m, dim) at the nodes.
        """
        min_cosine = np.full(len(unit_vectors), np.inf)
        cosine = np.sum(unit_vectors[self._node_of_facet] * self._facet_normal, axis=1)
        np.minimum.at(min_cosine, self._node_of_facet, cosine)
        return min_cosine

    def _raise_if_surfaces_pass_body(self, start: IncrementStart, end_translations: Array) -> None:
        """Raise SurfacePassed if a rigid surface passes through the body on its path.

        Args:
            start: start of the increment, and of the paths.
            end_translations: translations (pairs, dim) of the surfaces at the end of the paths.
        """
        for k, is_rigid in enumerate(self._is_rigid_pair):
            path = end_translations[k] - start.q[k]
            if (
                is_rigid
                and np.linalg.norm(path) > _SURFACE_PATH_STEP_IN_FACETS * self.min_facet_sizes[k]
            ):
                is_swallowed = self._find_nodes_reached_from_behind(k, start, path)
                self._raise_surface_passed_if_any(
                    k, is_swallowed, "passes through the body: it goes through the nodes at"
                )

    def _find_nodes_reached_from_behind(
        self, pair_number: int, start: IncrementStart, surface_path: Array
    ) -> Mask:
        """Return a mask (m,) of the nodes that a rigid surface reaches from the wrong side.

        Relative to the surface, each node moves along the reverse of the surface's path, by half
        its gap or at least one step at a time. The surface reaches it from the wrong side if the
        node gets inside the surface at a point where the surface's normal points out of the body.

        Args:
            pair_number: number of the pair.
            start: start of the increment.
            surface_path: straight path (dim,) of the pair's surface.
        """
        interface, in_pair = self._interface, self._interface.pair == pair_number
        surface, facet_size = interface.surfaces[pair_number], self.min_facet_sizes[pair_number]
        x, displacement = (
            interface.position[in_pair] - start.q[pair_number],
            start.displacement[in_pair],
        )
        length = float(np.linalg.norm(surface_path))
        step = max(_SURFACE_PATH_STEP_IN_FACETS * facet_size, length / _MAX_SURFACE_PATH_STEPS)
        # avoid points where a surface has no normal, such as the centre of a sphere
        x = x + _OFFSET_FROM_SINGULAR_POINTS_IN_FACETS * facet_size * np.sqrt(
            np.arange(2, 2 + x.shape[1])
        )

        path_ratio, is_swallowed = np.zeros(len(x)), np.zeros(len(in_pair), dtype=bool)
        normals = np.zeros_like(interface.position)
        n_nodes, substitute, is_finished = (
            len(x),
            interface.first_node_position_of_each_pair[pair_number],
            False,
        )
        while not is_finished:
            with raise_errors_on_all_processes(self._comm):
                position = x - path_ratio[:, None] * surface_path if n_nodes else substitute
                gap, normal = surface.gap(position)[:n_nodes], surface.normal(position)[:n_nodes]
                depth = -(gap + np.sum(normal * displacement, axis=1))
                normals[in_pair] = normal
                is_outwards = (
                    self._min_cosine_to_outward_normals(normals)[in_pair]
                    > MIN_COSINE_OF_OUTWARD_PUSHING_SURFACE_NORMAL
                )
                is_swallowed[in_pair] |= is_outwards & (
                    depth > _MIN_DEPTH_INSIDE_SURFACE_IN_FACETS * facet_size
                )
                # the surface is about one gap away; half of it is safe if gaps are not distances
                stride = np.maximum(np.where(np.isfinite(gap), gap / 2, 0.0), step)
                last_ratio, path_ratio = path_ratio, np.minimum(path_ratio + stride / length, 1.0)
            is_finished = self._comm.allreduce(bool(last_ratio.min(initial=1.0) >= 1), MPI.LAND)
        return is_swallowed

    def _find_nodes_pushed_beyond_far_side(self, end: NewtonIterate) -> Mask:
        """Return a mask (m,) of the contact nodes that have been pushed beyond the body's far side.

        The far side consists of the nodes that are farthest along the contact normal in the
        undeformed body.
        """
        interface, u = self._interface, self._u  # u was set by `measure_max_strain_and_rotation`
        dim, normal = interface.position.shape[1], end.nodes.frame[:, 0]
        x = u.function_space.tabulate_dof_coordinates()[:, :dim]
        deformed, normals = x + u.x.array.reshape(-1, dim), interface.gather_values(normal)
        far_ends = np.array([(x @ n).max() for n in normals])
        far_ends = (
            np.max(self._comm.allgather(far_ends), axis=0)
            - _RELATIVE_POSITION_ROUND_OFF * np.abs(x).max()
        )
        deformed_ends = [
            (deformed @ n).max(where=x @ n >= end, initial=-np.inf)
            for n, end in zip(normals, far_ends, strict=True)
        ]
        first_row = sum(self._comm.allgather(len(normal))[: self._comm.rank])
        far_side = np.max(self._comm.allgather(deformed_ends), axis=0)[
            first_row : first_row + len(normal)
        ]
        position_along_normal = np.sum(normal * (interface.position + end.displacement), axis=1)
        return position_along_normal >= far_side - _RELATIVE_POSITION_ROUND_OFF * np.abs(far_side)

    def _raise_surface_passed_if_any(self, pair_number: int, is_wrong: Mask, problem: str) -> None:
        """Raise SurfacePassed with the positions of the nodes in a mask, unless it is empty.

        Args:
            pair_number: number of the pair.
            is_wrong: mask (m,) of the nodes.
            problem: description of the surface's action at these nodes, for the error message.
        """
        positions = self._interface.gather_values(self._interface.position[is_wrong])
        if len(positions):
            raise SurfacePassed(
                f"the surface of contact pair {pair_number} {problem} {format_points(positions)}; "
                "contact is "
                "stated for small displacements and surfaces that come from outside: move it less "
                "far, or around the body in increments without contact"
            )


def _nodes_normals_and_sizes_of_exterior_facets(
    node: Indices, space: fem.FunctionSpace
) -> tuple[Indices, Array, Array]:
    """Return data (f, ...) of the exterior facets around m nodes of this process; collective.

    A facet occurs once for each of the m nodes that it contains. Facets that belong to other
    processes are included.

    Args:
        node: global numbers (m,) of the nodes.
        space: space of the displacements.

    Returns:
        For each facet, the index of the node among the m nodes; the outward normal; and the size,
        which is the largest distance between two nodes of the facet.
    """
    mesh, comm = space.mesh, space.mesh.comm
    mesh.topology.create_connectivity(mesh.topology.dim - 1, mesh.topology.dim)
    nodes, x, normal = compute_facet_nodes_positions_and_facet_normals(
        space, exterior_facet_indices(mesh.topology)
    )
    number = space.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
    facet, corner = np.nonzero(np.isin(number, np.concatenate(comm.allgather(node))))
    diameter = np.linalg.norm(x[facet][:, :, None] - x[facet][:, None], axis=3).max(axis=(1, 2))
    node_of_facet, outward, size = (
        np.concatenate(comm.allgather(part))
        for part in (number[facet, corner], normal[facet], diameter)
    )
    order = np.argsort(node, kind="stable")
    # a node occurs several times among the m nodes if it belongs to several pairs
    first = np.searchsorted(node, node_of_facet, side="left", sorter=order)
    end = np.searchsorted(node, node_of_facet, side="right", sorter=order)
    n_copies = end - first
    shift = first - (np.cumsum(n_copies) - n_copies)
    node_number = order[np.repeat(shift, n_copies) + np.arange(n_copies.sum())]
    return node_number, np.repeat(outward, n_copies, axis=0), np.repeat(size, n_copies)


def warn_if_slip_and_path_slip_differ(
    state: ContactState, interface: ContactInterface, warned_pairs: set[int]
) -> None:
    """Log a warning, once for each pair, if the two measures of slip of `PairState` differ.

    The friction law uses `PairState.slip`; `PairState.path_slip` is the slip along the path of
    material points. They are compared at nodes with friction.

    Args:
        state: state at the end of an increment.
        interface: the contact nodes.
        warned_pairs: numbers of the pairs for which a warning has been logged. The function adds
            the pairs for which it logs a warning.
    """
    for k, pair in enumerate(state.pairs):
        difference = measure_difference_of_slip_and_path_slip(pair)
        allowed: Array | float = _ALLOWED_SLIP_DIFFERENCE_PER_MAX_DISPLACEMENT * state.scale.length
        if k in interface.mortars:
            mortar = interface.mortars[k]
            slave_number = np.searchsorted(mortar.nodes[: mortar.n_slave_nodes], pair.node)
            allowed = (
                _ALLOWED_SLIP_DIFFERENCE_PER_FACET_SIZE
                * mortar.measure_shortest_facet_at_slave_nodes()[slave_number]
            )
        slip_sizes = [np.linalg.norm(slip, axis=1) for slip in (pair.slip, pair.path_slip)]
        has_friction = (pair.status != OPEN) & (pair.friction > 0)
        is_wrong = has_friction & (
            difference
            > np.maximum(MAX_RELATIVE_PATH_SLIP_DIFFERENCE * np.maximum(*slip_sizes), allowed)
        )
        if is_wrong.any() and k not in warned_pairs:
            warned_pairs.add(k)
            words = (
                f"increment {state.increment - 1}, contact pair {k}: slip differs from that "
                f"of the path by up to {difference[is_wrong].max():.3g}, more than "
                f"{MAX_RELATIVE_PATH_SLIP_DIFFERENCE:.0%} of it, at {is_wrong.sum()} contact "
                "nodes first at "
                f"{format_points(pair.position[is_wrong])}, where friction may be wrong: make "
                "smaller increments and compare `PairState.slip` with `path_slip`"
            )
            log_on_root(interface.comm, logging.WARNING, words, ".contact")


def measure_difference_of_slip_and_path_slip(pair: PairState) -> Array:
    """Return the length (m,) of `path_slip` minus `slip` at the nodes of a pair."""
    return np.asarray(np.linalg.norm(pair.slip - pair.path_slip, axis=1))

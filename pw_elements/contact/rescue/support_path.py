"""Supports of a body at large strains, and their path during an increment.

The module guarantees that a path contains the displacements that the conditions prescribe at
equally spaced fractions of the increment. It assumes that conditions prescribe the same nodes at
all times.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import free_dofs_and_prescribed_values
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import label_components_of_space
from pw_elements.contact.interface import ContactInterface
from pw_elements.contact.model import ContactState
from pw_elements.contact.nodes import OPEN, RigidSurfaceMotion
from pw_elements.contact.rescue.passing import interpolate_placements_and_path
from pw_elements.contact.rescue.placing import (
    PiecesMovingWithSupports,
    does_rigid_motion_end_all_contact,
)
from pw_elements.contact.rescue.substeps import count_equal_nearly_straight_segments

# Function that sets loads and conditions at a fraction (0, 1] of an increment
LoadFractionSetter: TypeAlias = Callable[[float], None]

# Initial and largest number of samples of the support path per increment, and number of samples in
# the check that a motion separates bodies and surfaces
_INITIAL_PATH_SAMPLE_COUNT, _MAX_PATH_SAMPLE_COUNT, _SEPARATION_CHECK_SAMPLE_COUNT = 16, 256, 128


class BodySupports:
    """Supported nodes of a body, and the displacements that conditions prescribe there.

    Args:
        interface: contact points of all pairs.
        whole_space: trial space of all unknowns.
        conditions: Dirichlet conditions, whose values may change.
        apply_load: function that applies a load at a fraction of the increment.
    """

    def __init__(
        self,
        interface: ContactInterface,
        whole_space: fem.FunctionSpace,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
        apply_load: Callable[[LoadFractionSetter | None, float], None],
    ) -> None:
        self._interface, self._whole_space = interface, whole_space
        self._conditions, self._apply_load = conditions, apply_load

    def prescribed_displacements(self) -> PETSc.Vec:
        """Return the displacements (n,) that the conditions currently prescribe, zero elsewhere."""
        return free_dofs_and_prescribed_values(self._whole_space, self._conditions)[1]

    @property
    def free_unknowns(self) -> Mask:
        """Mask (n,) of the unknowns of this process that no condition prescribes."""
        return free_dofs_and_prescribed_values(self._whole_space, self._conditions)[0]

    @property
    def is_supported(self) -> Mask:
        """Mask (owned nodes, dim) of displacement components that supports prescribe."""
        return np.asarray(~self.free_unknowns[self._interface.field.owned_unknowns])

    @property
    def node_positions(self) -> Array:
        """Undeformed positions (owned nodes, dim) of the nodes of this process."""
        owned, dim = self._interface.field.owned_unknowns.shape
        return np.asarray(self._interface.field.space.tabulate_dof_coordinates()[:owned, :dim])

    @cached_property
    def connected_piece_of_node(self) -> Indices:
        """Number (owned nodes,) of the connected component of the mesh that contains each node."""
        number, _ = label_components_of_space(self._interface.field.space)
        return number[: len(self.node_positions)]

    def supported_axes(self) -> Mask:
        """Return a mask (dim,) of the axes along which supports hold at least one node."""
        is_supported: Mask = np.any(self.is_supported, axis=0)
        self._interface.comm.Allreduce(MPI.IN_PLACE, is_supported, MPI.LOR)
        return is_supported

    def sample_path_adaptively(self, state: ContactState, load: LoadFractionSetter | None) -> Array:
        """Return prescribed displacements (samples + 1, nodes, dim) along the increment.

        The samples are equally spaced. Their number is increased, up to a limit, until the path
        consists of nearly straight segments that are longer than the distance between two samples.
        """
        if load is None:
            return self.sample_path(state, None, 1)
        n_samples = _INITIAL_PATH_SAMPLE_COUNT
        path = self.sample_path(state, load, n_samples)
        while (
            2 * count_equal_nearly_straight_segments(path, self._interface.comm) > n_samples
            and n_samples < _MAX_PATH_SAMPLE_COUNT
        ):
            n_samples *= 4
            path = self.sample_path(state, load, n_samples)
        return path

    def sample_path(
        self, state: ContactState, load: LoadFractionSetter | None, n_samples: int
    ) -> Array:
        """Return prescribed displacements (samples + 1, nodes, dim), zero for free components."""
        field, dim = self._interface.field, self._interface.position.shape[1]
        start_unknowns = state.unknowns.copy()
        start_unknowns.array[self.free_unknowns] = 0.0
        path = [start_unknowns]
        for k in range(1, n_samples + 1):
            self._apply_load(load, k / n_samples)
            path.append(self.prescribed_displacements())
        return np.array(
            [field.extract(unknowns).array_r.reshape(-1, dim).copy() for unknowns in path]
        )


def find_rigidly_moved_contact_free_start(
    interface: ContactInterface,
    surfaces: RigidSurfaceMotion,
    supports: BodySupports,
    state: ContactState,
    load: LoadFractionSetter | None,
    *,
    q_at_start_and_end: tuple[Array, Array],
    support_path: Array,
) -> PETSc.Vec | None:
    """Return unknowns (n,) of a body that has moved rigidly with its supports out of contact.

    The result is None if no node is in contact at the start, or if it is not certain that the
    motion ends all contact.

    Args:
        interface: contact points of all pairs.
        surfaces: rigid motion of the surfaces.
        supports: supports of the body.
        state: state at the start of the increment.
        load: load of the increment.
        q_at_start_and_end: motions (pairs, dim + 1) of the surfaces at the start and at the end.
        support_path: prescribed displacements (samples + 1, nodes, dim) along the increment.
    """
    is_closed = interface.extract_local_pair_state_values(state.pairs, "status")[0] != OPEN
    if not interface.comm.allreduce(bool(is_closed.any()), MPI.LOR):
        return None
    positions, is_supported = supports.node_positions, supports.is_supported
    component = supports.connected_piece_of_node
    support_path = support_path[[0, -1]]
    for n_samples in (1, _SEPARATION_CHECK_SAMPLE_COUNT):  # the two ends exclude most cases cheaply
        if n_samples > 1:
            support_path = supports.sample_path(state, load, n_samples)
        surface_path, _ = interpolate_placements_and_path(
            *q_at_start_and_end, support_path, n_samples
        )
        pieces = PiecesMovingWithSupports.fit_rigid_motions_to_supports(
            positions, is_supported, component, support_path, interface.comm
        )
        if not does_rigid_motion_end_all_contact(
            interface, surfaces, pieces, surface_path, state.unknowns
        ):
            return None
    start_unknowns, owned = state.unknowns.duplicate(), interface.field.owned_unknowns
    displacement = pieces.compute_rigid_paths_of_points(positions, component)[-1] - positions
    start_unknowns.setArray(interface.field.embed(displacement.ravel()))
    start_unknowns.array[owned] = np.where(
        is_supported, support_path[-1], start_unknowns.array_r[owned]
    )
    return start_unknowns

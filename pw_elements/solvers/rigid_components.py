"""Rigid motions of the connected components of a mesh, and the resistance to these motions."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import label_components_of_space
from pw_elements.solvers.matrices import Supports, null_space_basis, qr_triangle

# Smallest force of one component on another that is not due to round-off, relative to the largest
# stiffness
_MIN_COUPLING_FORCE_OVER_MAX_STIFFNESS = 1e-11
# A rigid motion is free if its stiffness, relative to that of an arbitrary motion, is smaller
_MAX_FREE_OVER_ARBITRARY_MOTION_STIFFNESS = 1e-8


@dataclass(frozen=True)
class ComponentRigidModes:
    """Connected components of a mesh, sorted by their centres, and rigid motions of their nodes.

    The k modes of a component are its translations and its rotations about its centre. Rotations
    are divided by the component's length; their displacements are then about as large as those of
    translations. For fields other than displacements, the modes are constants.
    """

    component_of_node: Indices  # (nodes,), including ghosts
    centre: Array  # (components, dim), mean position of each component's nodes
    length: Array  # (components,), radius of gyration of each component's nodes
    modes: Array  # (owned nodes, block, k), displacement of each node in its component's modes
    comm: MPI.Comm

    @classmethod
    def from_space(cls, space: fem.FunctionSpace) -> "ComponentRigidModes":
        comm, dim, block = space.mesh.comm, space.mesh.geometry.dim, space.dofmap.index_map_bs
        component, count = label_components_of_space(space)
        owned = component[: space.dofmap.index_map.size_local]

        def sum_by_component(values: Array) -> Array:
            sums = np.zeros((count, values.shape[1]))
            np.add.at(sums, owned, values)
            comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
            return sums

        x, ones = space.tabulate_dof_coordinates()[: len(owned), :dim], np.ones((len(owned), 1))
        n_nodes = sum_by_component(ones)
        centre = sum_by_component(x) / n_nodes
        arm = x - centre[owned]
        length = np.sqrt(sum_by_component(np.sum(arm**2, axis=1)[:, None]) / n_nodes)[:, 0]
        arm /= length[owned, None]
        planes = list(combinations(range(dim), 2)) if block == dim else []
        modes = np.zeros((len(owned), block, block + len(planes)))
        modes[:, :, :block] = np.eye(block)
        for k, (i, j) in enumerate(planes, start=block):
            modes[:, i, k], modes[:, j, k] = -arm[:, j], arm[:, i]
        order = np.lexsort(np.round(np.column_stack([length, centre[:, ::-1]]) / length.max(), 9).T)
        return cls(np.argsort(order)[component], centre[order], length[order], modes, comm)

    def matrix_with_mode_columns(
        self, values_in_modes: Array, n_empty_columns: int = 0
    ) -> sp.csr_array:
        """Return a matrix with one column for each mode of each component.

        Args:
            values_in_modes: values (owned nodes, block, k) at each node in the k modes of its
                component.
            n_empty_columns: number of empty columns to append.

        Returns:
            Matrix (owned dofs, k components + n_empty_columns).
        """
        n, block, k = values_in_modes.shape
        mode = np.broadcast_to(
            self.component_of_node[:n, None, None] * k + np.arange(k), values_in_modes.shape
        )
        nonzero = values_in_modes != 0
        pointers = np.append(0, np.cumsum(nonzero.sum(axis=2)))
        shape = n * block, len(self.centre) * k + n_empty_columns
        return sp.csr_array((values_in_modes[nonzero], mode[nonzero], pointers), shape)

    def forces_and_support_displacements_of_modes(
        self,
        K: PETSc.Mat,
        free: Mask,
        rows_in_K: LocalIndices | None = None,
        transposed: bool = False,
        n_empty_columns: int = 0,
    ) -> sp.csr_array:
        """Return a matrix that shows how supports and stiffness resist each rigid mode.

        The column of a mode contains the mode's displacements at prescribed unknowns. At free
        unknowns it contains the forces that the mode causes: the stiffness times the displacements
        of free unknowns, divided by the largest diagonal entry of the stiffness.

        Args:
            K: stiffness (n, n).
            free: mask (owned dofs,) of the free displacements.
            rows_in_K: local rows (owned dofs,) of the displacements in K; None if K has no other
                unknowns.
            transposed: whether to compute forces with the transpose of K.
            n_empty_columns: number of empty columns to append.

        Returns:
            Matrix (owned dofs, modes + n_empty_columns).
        """
        rows_in_K = np.arange(len(free), dtype=np.int32) if rows_in_K is None else rows_in_K
        multiply = K.multTranspose if transposed else K.mult
        free, diagonal = free.reshape(self.modes.shape[:2]), K.getDiagonal()
        largest = np.abs(diagonal.array_r[rows_in_K]).max(initial=0.0)
        stiffness = self.comm.allreduce(largest, MPI.MAX)
        motion, image = K.createVecs()

        def forces(displacement: Array) -> Array:
            motion.array[rows_in_K] = np.where(free, displacement, 0.0).ravel()
            multiply(motion, image)
            return image.array_r[rows_in_K].reshape(free.shape)

        def force_or_support_displacement(modes: Array) -> Array:
            columns = [np.where(free, forces(u) / stiffness, u) for u in np.moveaxis(modes, 2, 0)]
            return np.stack(columns, axis=2)

        if not self._has_coupled_components(forces, stiffness):
            return self.matrix_with_mode_columns(
                force_or_support_displacement(self.modes), n_empty_columns
            )
        component = self.component_of_node[: len(free), None, None]
        shape = len(rows_in_K), self.modes.shape[2]
        columns = [
            sp.csr_array(
                force_or_support_displacement(np.where(component == k, self.modes, 0.0)).reshape(
                    shape
                )
            )
            for k in range(len(self.centre))
        ]
        return sp.csr_array(sp.hstack([*columns, sp.csr_array((len(rows_in_K), n_empty_columns))]))

    def _has_coupled_components(
        self, compute_forces: Callable[[Array], Array], max_stiffness: float
    ) -> bool:
        """Return whether components exert forces on each other, for example through springs.

        If they do, one product with the stiffness cannot give the forces of the modes of all
        components at once.

        Args:
            compute_forces: function that takes displacements (owned nodes, block) and returns the
                forces that they cause.
            max_stiffness: largest diagonal entry of the stiffness.
        """
        if len(self.centre) == 1:
            return False
        nodes, block, _ = self.modes.shape
        arbitrary = 1.0 + np.cos(np.arange(nodes * block)).reshape(nodes, block)
        weight = 1.0 + np.cos(self.component_of_node[:nodes, None])
        coupling = np.abs(
            compute_forces(weight * arbitrary) - weight * compute_forces(arbitrary)
        ).max(initial=0.0)
        return bool(
            self.comm.allreduce(coupling, MPI.MAX)
            > _MIN_COUPLING_FORCE_OVER_MAX_STIFFNESS * max_stiffness
        )


def has_free_rigid_motion(K: PETSc.Mat, supports: Supports) -> bool:
    """Return whether there is a rigid motion that neither supports nor stiffness resist.

    Rigid motions of the connected components of the mesh are considered.

    Args:
        K: stiffness (n, n) without supports.
        supports: free unknowns of the space.
    """
    components = ComponentRigidModes.from_space(supports.space)
    resistance = qr_triangle(
        components.forces_and_support_displacements_of_modes(K, supports.free), components.comm
    )
    return len(null_space_basis([resistance], _MAX_FREE_OVER_ARBITRARY_MOTION_STIFFNESS)) > 0

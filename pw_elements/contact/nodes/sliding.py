"""Gap, slip and forces of two deformed bodies that slide on each other, by mortar integrals.

In d dimensions, a slave node that faces the master has 2 d - 1 motions: the change of its gap, the
changes of its slip along d - 1 tangents, and those of its normal along the same tangents. The
motion operator G turns unknowns into these motions, and the force operator H turns contact forces r
into nodal forces. Both are assembled again at each iterate. See the theory page ("Large strains").

The module guarantees G and H at the current positions, and the derivative of H r at constant r. It
assumes that, at each iterate, `linearise_mortars_and_assemble_force_operator` is called before any
other evaluation.
"""

from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array
from pw_elements.contact.interface import (
    FACED_INDEX_OF_RIGID_SURFACE,
    ContactInterface,
    MortarSlipReference,
)
from pw_elements.contact.nodes.frames import make_frames
from pw_elements.contact.nodes.nodes import LinearisedKinematics


class MortarKinematics:
    """Kinematics of all pairs of two bodies at large sliding in one increment.

    Args:
        interface: contact points (m) of all pairs.
        start: all unknowns (n,) at the start of the increment.
        q_start: motions (pairs, dim + 1) of the masters at the start.
        q_end: motions (pairs, dim + 1) of the masters at the end.

    Attributes:
        motion_operator: matrix (m p, n) at the last iterate, which turns the unknowns into the p
            motions of each point.
    """

    def __init__(
        self, interface: ContactInterface, start: PETSc.Vec, q_start: Array, q_end: Array
    ) -> None:
        self._interface, self._translations = interface, q_end[:, :-1]
        self._references = {
            k: mortar.make_slip_reference(
                self._gather_mortar_node_positions(k, start, q_start[:, :-1])
            )
            for k, mortar in interface.mortars.items()
        }
        # points of each pair on this process, and their indices among the slave's nodes
        self._points = {k: np.flatnonzero(interface.pair == k) for k in self._references}
        self._slave_indices = {
            k: np.searchsorted(
                interface.mortars[k].nodes[: interface.mortars[k].n_slave_nodes], node
            )
            for k, node in ((k, interface.node[points]) for k, points in self._points.items())
        }
        self.motion_operator: PETSc.Mat = interface.motion

    def linearise_mortars_and_assemble_force_operator(self, unknowns: PETSc.Vec) -> PETSc.Mat:
        """Linearise the mortars at given unknowns (n,) and return the force operator (n, m dim).

        The operator turns forces on the points into nodal forces.
        """
        interface = self._interface
        self._positions = {
            k: self._gather_mortar_node_positions(k, unknowns, self._translations)
            for k in self._references
        }
        self._mortars = {k: interface.mortars[k].linearise(x) for k, x in self._positions.items()}
        m, (_, n_dofs), dim = (
            len(interface.node),
            interface.field.local_and_global_size,
            interface.position.shape[1],
        )
        entries = [(np.arange(m), interface.node, np.ones(m))]
        for k, mortar_state in self._mortars.items():
            mortar, parts = (
                interface.mortars[k],
                sp.coo_array(mortar_state.master_fractions[self._slave_indices[k]]),
            )
            node = mortar.nodes[mortar.n_slave_nodes :][parts.col]
            entries.append((self._points[k][parts.row], node, -parts.data))
        row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
        nodal = sp.csr_matrix((value, (row, column)), (m, n_dofs // dim))
        rows = sp.csr_matrix(sp.kron(nodal, sp.eye_array(dim)))
        return interface.assemble_matrix_over_all_unknowns(rows).transpose(PETSc.Mat())

    def assemble_stiffness_of_force_operator_change(self, force: Array) -> PETSc.Mat:
        """Return the stiffness (n, n) due to the change of the force operator with the unknowns.

        It is the derivative of -H r with respect to the unknowns, with the force operator H, for
        constant forces r (m, dim) on the points.
        """
        interface, dim = self._interface, force.shape[1]
        node_offset = interface.field.space.dofmap.index_map.local_range[0]
        sizes = interface.field.local_and_global_size
        total = sp.csr_matrix(sizes)
        for k, mortar_state in self._mortars.items():
            mortar = interface.mortars[k]
            slave_force = np.zeros((mortar.n_slave_nodes, dim))
            slave_force[self._slave_indices[k]] = force[self._points[k]]
            interface.comm.Allreduce(MPI.IN_PLACE, slave_force, MPI.SUM)
            part = sp.coo_array(mortar_state.differentiate_master_forces(slave_force))
            dofs = (mortar.nodes[:, None] * dim + np.arange(dim)).ravel()
            row = dofs[mortar.n_slave_nodes * dim :][part.row] - node_offset * dim
            is_owned = (row >= 0) & (row < sizes[0])
            indices = row[is_owned], dofs[part.col[is_owned]]
            total += sp.csr_matrix((part.data[is_owned], indices), sizes)
        matrix, field = interface.assemble_matrix_over_all_unknowns(total), interface.field
        return (
            matrix if field.is_whole_space else field.extraction_matrix().transposeMatMult(matrix)
        )

    def fill_in_deformable_pairs(
        self, kinematics: LinearisedKinematics, force: Array
    ) -> LinearisedKinematics:
        """Return a copy of `kinematics` with the values of pairs of two bodies filled in.

        These values are linearised at the contact forces `force` (m, dim) on the points.
        """
        interface, (m, dim) = self._interface, force.shape
        n_motions = 2 * dim - 1
        gap, slip = kinematics.gap.copy(), kinematics.slip.copy()
        frame = kinematics.frame.copy()
        v0, motion_by_v, force_by_v = (
            np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, n_motions - dim)])
            for values in (kinematics.v0, kinematics.motion_by_v, kinematics.force_by_v)
        )
        node = interface.node * dim
        rigid = np.flatnonzero(interface.faced == FACED_INDEX_OF_RIGID_SURFACE)
        rows = [(rigid * n_motions + a, node[rigid] + a, np.ones(len(rigid))) for a in range(dim)]
        for k, mortar_state in self._mortars.items():
            mortar, points, number = interface.mortars[k], self._points[k], self._slave_indices[k]
            slips, motions = mortar_state.measure_slip_and_motion_derivatives(
                self._references[k], self._positions[k]
            )
            normal, tangents, faced = (
                mortar_state.normals[number],
                mortar_state.directions.tangents[number],
                mortar_state.faces_master[number],
            )
            frame[points] = make_frames(normal, interface.equation[points] >= 0)
            # components of the frame's tangents along the mortar's; zero rows without tangent
            turn = frame[points, 1:] @ np.swapaxes(tangents, 1, 2)
            gap[points] = np.where(faced, mortar_state.gaps[number], np.inf)
            slip[points] = np.where(
                faced[:, None], np.einsum("nst,nt->ns", turn, slips[number]), 0.0
            )
            normal_force = np.sum(normal * force[points], axis=1)
            motion_by_v[points], force_by_v[points] = 0.0, 0.0
            motion_by_v[points, 0, 0] = faced
            motion_by_v[points, 1:, 1:dim] = faced[:, None, None] * turn
            force_by_v[points, 0, dim:] = np.einsum("nta,na->nt", tangents, force[points])
            force_by_v[points, 1:, dim:] = -turn * normal_force[:, None, None]
            shift = self._positions[k] - mortar.x
            shift[mortar.n_slave_nodes :] -= self._translations[k]
            dofs = (mortar.nodes[:, None] * dim + np.arange(dim)).ravel()
            for motion, change in enumerate(motions):
                part = sp.coo_array(change[number])
                rows.append(
                    (
                        points[part.row] * n_motions + motion,
                        dofs[part.col],
                        part.data,
                    )
                )
                v0[points, motion] = change[number] @ shift.ravel()
        row, column, value = (np.concatenate(part) for part in zip(*rows, strict=True))
        shape = (m * n_motions, interface.field.local_and_global_size[1])
        self.motion_operator = interface.assemble_matrix_over_all_unknowns(
            sp.csr_matrix((value, (row, column)), shape)
        )
        return replace(
            kinematics,
            frame=frame,
            gap=gap,
            slip=slip,
            v0=v0,
            motion_by_v=motion_by_v,
            force_by_v=force_by_v,
        )

    @property
    def slip_references(self) -> dict[int, MortarSlipReference]:
        """Reference states from which slip is measured, keyed by pair index."""
        return self._references

    @property
    def slip_references_and_positions(self) -> dict[int, tuple[MortarSlipReference, Array]]:
        """For each pair of two bodies, by index: slip reference and node positions (nodes, dim).

        The positions are those at the last iterate.
        """
        return {k: (start, self._positions[k]) for k, start in self._references.items()}

    def fill_in_path_slip_of_deformable_pairs(self, slip: Array) -> Array:
        """Return path slips (m, dim) with the values of pairs of two bodies filled in."""
        slip = slip.copy()
        for k, mortar in self._interface.mortars.items():
            path_slip = mortar.integrate_slip_along_path(self._references[k].x, self._positions[k])
            slip[self._points[k]] = path_slip[self._slave_indices[k]]
        return slip

    def _gather_mortar_node_positions(
        self, pair_index: int, unknowns: PETSc.Vec, master_translations: Array
    ) -> Array:
        """Return the node positions (nodes, dim) of both sides of a pair; collective.

        All processes get the positions of all nodes. In addition to their displacements in the
        `unknowns` (n,), the master's nodes are translated by `master_translations` (pairs, dim).
        """
        mortar = self._interface.mortars[pair_index]
        displacement = self._interface.extract_displacements_at_nodes(mortar.nodes, unknowns)
        displacement[mortar.n_slave_nodes :] += master_translations[pair_index]
        return np.asarray(mortar.x + displacement)

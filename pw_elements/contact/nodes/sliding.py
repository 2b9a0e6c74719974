"""Gap, slip and forces of two deformed bodies that slide on each other, by mortars.

A node that another body faces has three motions: the changes of its gap and slip, and the angle by
which its normal turns. The rows G of these motions are made anew at each iterate, and so is H,
which hands forces on to the other body. See the guide's page on theory ("Large strains").
"""

from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array
from pw_elements.contact.interface import RIGID, Interface, SlidingReference
from pw_elements.contact.nodes.nodes import LinearisedKinematics, make_frames

# Motions of a node that another body faces: gap, slip and angle
_N_MOTIONS = 3


class MortarKinematics:
    """Kinematics of all pairs of two bodies in one increment.

    Args:
        interface: the contact points (m).
        start: all unknowns (n,) where the increment starts.
        q_start: motions (pairs, dim + 1) of the opposite bodies there.
        q_end: the same at its end.

    Attributes:
        motion: G of the law, (m p, n), at the last iterate.
    """

    def __init__(
        self, interface: Interface, start: PETSc.Vec, q_start: Array, q_end: Array
    ) -> None:
        self._interface, self._translations = interface, q_end[:, :-1]
        self._references = {
            k: mortar.make_reference(self._positions_of(k, start, q_start[:, :-1]))
            for k, mortar in interface.mortars.items()
        }
        # points of this process, and their numbers among the slave's nodes
        self._points = {k: np.flatnonzero(interface.pair == k) for k in self._references}
        self._slave_number = {
            k: np.searchsorted(
                interface.mortars[k].nodes[: interface.mortars[k].n_slave_nodes], node
            )
            for k, node in ((k, interface.node[points]) for k, points in self._points.items())
        }
        self.motion: PETSc.Mat = interface.motion

    def update(self, unknowns: PETSc.Vec) -> PETSc.Mat:
        """Evaluate the mortars at all unknowns (n,) and return H, (n, m dim)."""
        interface = self._interface
        self._positions = {
            k: self._positions_of(k, unknowns, self._translations) for k in self._references
        }
        self._mortars = {k: interface.mortars[k].linearise(x) for k, x in self._positions.items()}
        m, (_, n_dofs), dim = (
            len(interface.node),
            interface.field.sizes,
            interface.position.shape[1],
        )
        entries = [(np.arange(m), interface.node, np.ones(m))]
        for k, met in self._mortars.items():
            mortar, parts = (
                interface.mortars[k],
                sp.coo_array(met.master_fractions[self._slave_number[k]]),
            )
            node = mortar.nodes[mortar.n_slave_nodes :][parts.col]
            entries.append((self._points[k][parts.row], node, -parts.data))
        row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
        nodal = sp.csr_matrix((value, (row, column)), (m, n_dofs // dim))
        rows = sp.csr_matrix(sp.kron(nodal, sp.eye_array(dim)))
        return interface.rows(rows).transpose(PETSc.Mat())

    def force_stiffness(self, force: Array) -> PETSc.Mat:
        """Return the derivative (n, n) of -H r for forces r (m, dim) that are fixed."""
        interface, dim = self._interface, force.shape[1]
        first, sizes = interface.field.space.dofmap.index_map.local_range[0], interface.field.sizes
        total = sp.csr_matrix(sizes)
        for k, met in self._mortars.items():
            mortar = interface.mortars[k]
            slave_force = np.zeros((mortar.n_slave_nodes, dim))
            slave_force[self._slave_number[k]] = force[self._points[k]]
            interface.comm.Allreduce(MPI.IN_PLACE, slave_force, MPI.SUM)
            part = sp.coo_array(met.differentiate_master_forces(slave_force))
            dofs = (mortar.nodes[:, None] * dim + np.arange(dim)).ravel()
            row = dofs[mortar.n_slave_nodes * dim :][part.row] - first * dim
            is_owned = (row >= 0) & (row < sizes[0])
            indices = row[is_owned], dofs[part.col[is_owned]]
            total += sp.csr_matrix((part.data[is_owned], indices), sizes)
        matrix, field = interface.rows(total), interface.field
        return matrix if field.is_whole_space else field.selection_matrix().transposeMatMult(matrix)

    def fill_pairs(self, kinematics: LinearisedKinematics, force: Array) -> LinearisedKinematics:
        """Return kinematics with the points of these pairs filled in, under forces (m, dim)."""
        interface, (m, dim) = self._interface, force.shape
        gap, slip = kinematics.gap.copy(), kinematics.slip.copy()
        frame = kinematics.frame.copy()
        v0, motion_by_v, force_by_v = (
            np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, _N_MOTIONS - dim)])
            for values in (kinematics.v0, kinematics.motion_by_v, kinematics.force_by_v)
        )
        node = interface.node * dim
        rigid = np.flatnonzero(interface.faced == RIGID)
        rows = [(rigid * _N_MOTIONS + a, node[rigid] + a, np.ones(len(rigid))) for a in range(dim)]
        for k, met in self._mortars.items():
            mortar, points, number = interface.mortars[k], self._points[k], self._slave_number[k]
            slips, motions = met.measure_slip_and_rates(self._references[k], self._positions[k])
            normal, tangent, faced = (
                met.normals[number],
                met.tangents[number],
                met.faces_master[number],
            )
            frame[points] = make_frames(normal, interface.equation[points] >= 0)
            side = np.sum(frame[points, 1] * tangent, axis=1)
            gap[points] = np.where(faced, met.gaps[number], np.inf)
            slip[points, 0] = np.where(faced, side * slips[number], 0.0)
            normal_force = np.sum(normal * force[points], axis=1)
            tangential_force = np.sum(tangent * force[points], axis=1)
            motion_by_v[points], force_by_v[points] = 0.0, 0.0
            motion_by_v[points, 0, 0], motion_by_v[points, 1, 1] = faced, faced * side
            force_by_v[points, 0, 2] = tangential_force
            force_by_v[points, 1, 2] = -side * normal_force
            shift = self._positions[k] - mortar.x
            shift[mortar.n_slave_nodes :] -= self._translations[k]
            dofs = (mortar.nodes[:, None] * dim + np.arange(dim)).ravel()
            for motion, change in enumerate(motions):
                part = sp.coo_array(change[number])
                rows.append((points[part.row] * _N_MOTIONS + motion, dofs[part.col], part.data))
                v0[points, motion] = change[number] @ shift.ravel()
        row, column, value = (np.concatenate(part) for part in zip(*rows, strict=True))
        shape = (m * _N_MOTIONS, interface.field.sizes[1])
        self.motion = interface.rows(sp.csr_matrix((value, (row, column)), shape))
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
    def references(self) -> dict[int, SlidingReference]:
        """State of both sides of each pair from which slip counts."""
        return self._references

    @property
    def sides(self) -> dict[int, tuple[SlidingReference, Array]]:
        """Reference state and, at the last iterate, positions (nodes, dim) of both sides."""
        return {k: (start, self._positions[k]) for k, start in self._references.items()}

    def fill_path_slip(self, slip: Array) -> Array:
        """Return slips (m, dim) along the path with those of these pairs filled in."""
        slip = slip.copy()
        for k, mortar in self._interface.mortars.items():
            path_slip = mortar.integrate_slip(self._references[k].x, self._positions[k])
            slip[self._points[k]] = path_slip[self._slave_number[k]]
        return slip

    def _positions_of(self, pair: int, unknowns: PETSc.Vec, translations: Array) -> Array:
        """Positions (nodes, dim) of both sides of a pair, of all processes."""
        mortar = self._interface.mortars[pair]
        displacement = self._interface.at_nodes(mortar.nodes, unknowns)
        displacement[mortar.n_slave_nodes :] += translations[pair]
        return np.asarray(mortar.x + displacement)

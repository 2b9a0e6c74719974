"""Products of the matrix of one active set with vectors; the matrix is never assembled.

In the product with displacements a and free translations U, the rows of the contact points are
E r + C G a - D U, the linearised contact law. E, C and D are the coefficients of the law, G a are
the motions of the points, and the contact forces r are computed from the product K a with the
stiffness. All other rows are rows of K a, from which the contact forces are subtracted at opposite
nodes. The module guarantees the same products on any number of processes. It assumes that each
equation contains the force of at most one component of one contact point.
"""

from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface import (
    FACED_INDEX_OF_DEFORMABLE_SURFACE,
    RELATIVE_COORDINATE_ROUND_OFF,
    ContactInterface,
    SharedNodes,
)
from pw_elements.contact.model import FreeMotionIndices
from pw_elements.contact.nodes import LinearisedContactLaw
from pw_elements.contact.system.additional_forces import AdditionalForceElimination
from pw_elements.solvers import StiffnessWithAddedMatrix
from pw_elements.spaces import SubSpace


@dataclass(frozen=True)
class ContactPointOperators:
    """Operators and factors of the m contact points of this process.

    Each contact point is located at a node, on which its contact force acts.
    """

    node: Indices  # local number (m,) of the node of each point
    motion: PETSc.Mat  # motion operator (m p, n), with p motions per point
    # displacement (m dim, n) of each point relative to its opposite surface
    relative_displacement: PETSc.Mat
    force: PETSc.Mat  # transposed force operator (m dim, n), reduced by the supports
    # part of the force operator at equations of other nodes, transposed and with opposite sign
    # (m dim, n); None if it is zero
    opposite_force: PETSc.Mat | None
    has_two_bodies: bool  # whether any pair consists of two bodies
    equations: Indices  # local number (m, dim) of each component's own equation, -1 for none
    # local number (m, dim) of each component's law in the right-hand side, -1 for none. It differs
    # from `equations` at points that are not the first one of their node
    law_equations: Indices
    shared_nodes: SharedNodes  # the points grouped by node
    force_factor: Array  # nodal force (m, dim) divided by the value of its equation
    law_scale: Array  # stiffness (m,) that converts lengths into forces in the law
    # number (m, dim) of the free translation that moves the opposite surface along each axis, or -1
    free_translation: Indices
    n_translations: int  # number of free translations
    can_hold_body: Mask  # whether each point (m,) faces a surface that may hold its body
    force_round_off: float  # norm of the round-off in the forces of all points

    @classmethod
    def from_interface(
        cls,
        interface: ContactInterface,
        motion: PETSc.Mat,
        relative_displacement: PETSc.Mat,
        force: PETSc.Mat,
        opposite_force: PETSc.Mat | None,
        equations: Indices,
        law_equations: Indices,
        force_factor: Array,
        law_scale: Array,
        free_motions: FreeMotionIndices,
    ) -> "ContactPointOperators":
        """Build the operators and factors for the contact points of an interface; collective.

        `free_motions` contains the pair index and component index of each free motion. All other
        arguments after `interface` are the attributes of the same names.
        """
        node = interface.node - interface.field.space.dofmap.index_map.local_range[0]
        free_translation = np.full(equations.shape, -1, dtype=np.int64)
        for k, (pair, axis) in enumerate(free_motions):
            free_translation[interface.pair == pair, axis] = k
        local_round_off = RELATIVE_COORDINATE_ROUND_OFF * np.linalg.norm(
            law_scale[:, None] * interface.position
        )
        round_off = interface.comm.allreduce(float(local_round_off), MPI.SUM)
        indptr, _, value = force.getValuesCSR()
        n_entries = np.bincount(np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))[value != 0])
        n_entries = np.pad(n_entries, (0, equations.size - len(n_entries)))
        has_opposite_nodes = n_entries.reshape(equations.shape).max(axis=1) > 1
        can_hold_body = has_opposite_nodes | (interface.faced != FACED_INDEX_OF_DEFORMABLE_SURFACE)
        return cls(
            node,
            motion,
            relative_displacement,
            force,
            opposite_force,
            opposite_force is not None or bool(interface.mortars),
            equations,
            law_equations,
            interface.shared_nodes,
            force_factor,
            law_scale,
            free_translation,
            len(free_motions),
            can_hold_body,
            round_off,
        )

    def restrict_to_displacements(self, field: SubSpace) -> "ContactPointOperators":
        """Return a copy that is restricted to the displacements of a hybrid space.

        The copy has neither pressures nor free translations. `field` is the subspace of the
        displacements.
        """
        number = np.full(field.full_sizes[0] + 1, -1, dtype=np.int64)  # number[-1] stays -1
        number[field.owned_unknowns.ravel()] = np.arange(field.owned_unknowns.size)
        columns = field.extraction_matrix().transpose(PETSc.Mat())
        motion, force = (operator.matMult(columns) for operator in (self.motion, self.force))
        relative_displacement = motion
        if self.relative_displacement is not self.motion:
            relative_displacement = self.relative_displacement.matMult(columns)
        return replace(
            self,
            motion=motion,
            relative_displacement=relative_displacement,
            force=force,
            equations=number[self.equations],
            n_translations=0,
        )

    def extract_nodal_forces(self, equation_values: Array) -> Array:
        """Return the nodal forces (m, dim) of the contact points.

        `equation_values` (n,) are the entries of stiffness times displacements in the equations of
        this process. At a node with several points, the first point has the whole force.
        """
        rows = self.rows
        return np.where(rows >= 0, equation_values[rows] * self.force_factor, 0.0)

    def extract_motions_by_own_displacement(self, n_motions: int) -> Array:
        """Return the derivatives (m, p, dim) of each point's motions by its node's displacement.

        `n_motions` is the number p of motions of a point. The derivatives are zero for components
        without an equation.
        """
        m, dim = self.equations.shape
        indptr, column, value = self.motion.getValuesCSR()
        row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
        point, motion = np.divmod(row, n_motions)
        column = column - self.motion.getOwnershipRangeColumn()[0]
        derivatives = np.zeros((m, n_motions, dim))
        for axis in range(dim):
            is_own = (column >= 0) & (column == self.equations[point, axis])
            derivatives[point[is_own], motion[is_own], axis] = value[is_own]
        return derivatives

    def distribute_to_opposite_nodes(self, force: Array) -> Array:
        """Return the part (n,) that this process owns of the forces on opposite nodes; collective.

        The contact forces `force` (m, dim) act on the points; the result has the opposite sign.
        """
        if self.opposite_force is None:
            return np.zeros(self.motion.getLocalSize()[1])
        opposite, forces = self.opposite_force.createVecs()
        forces.setArray(force)
        self.opposite_force.multTranspose(forces, opposite)
        return np.array(opposite.array_r)

    @property
    def rows(self) -> Indices:
        """Local number (m, dim) of the equation that each point's law replaces, -1 for none.

        At a node with several points, the first point has the equations of the node.
        """
        return np.where(self.shared_nodes.is_additional[:, None], -1, self.equations)


class MatrixFreeContactOperator:
    """Matrix of the contact system, as the Python context of a `PETSc.Mat`.

    Rows of the contact law replace the equations of the contact points. The last rows are the force
    balances of free translations.

    Args:
        K: stiffness (n, n).
        free: mask (n,) of the unknowns of this process that no support prescribes.
        points: contact points.

    Attributes:
        force: nodal forces (m, dim) in the last product.
        elimination: elimination of the additional forces of nodes with several points, or None.
        force_of_right_hand_side: constant part (m, dim) of the points' forces, which follows from
            the right-hand side of the law at nodes with several points.
        springs: stiffness (translations,) of the spring of each free translation.
    """

    def __init__(self, K: PETSc.Mat, free: Mask, points: ContactPointOperators) -> None:
        self._stiffness = StiffnessWithAddedMatrix(K)
        self._prescribed: Indices = np.flatnonzero(~free)
        self._comm: MPI.Comm = K.comm.tompi4py()
        self._free_displacement, self._product = K.createVecs()
        self._opposite_product = K.createVecLeft() if points.has_two_bodies else None
        self.set_points(points, None)
        self.force: Array = np.zeros(points.equations.shape)
        self.springs: Array = np.zeros(points.n_translations)
        self.elimination: AdditionalForceElimination | None = None
        if points.shared_nodes.exist:
            self.elimination = AdditionalForceElimination(
                points.shared_nodes, points.equations >= 0, points.law_scale, self._comm
            )
        self.force_of_right_hand_side: Array = np.zeros(points.equations.shape)

    def set_points(self, points: ContactPointOperators, added_stiffness: PETSc.Mat | None) -> None:
        """Set the operators of the same contact points at another iterate.

        Args:
            points: operators of the contact points.
            added_stiffness: matrix (n, n) that is added to the stiffness, such as that of forces
                which move with the bodies; None for none.
        """
        self._points, self._stiffness.added = points, added_stiffness
        self._rows = points.rows
        self._has_row = self._rows >= 0
        self._motions, self._point_forces = (
            operator.createVecLeft() for operator in (points.motion, points.force)
        )

    def sum_force_rows(self, weights: Array) -> Array:
        """Return the part (n,) that this process owns of the row of a weighted sum of nodal forces.

        The nodal forces follow from the product of the stiffness with displacements, and are
        weighted with `weights` (m, dim).
        """
        point_factors, row = self._product.duplicate(), self._free_displacement.duplicate()
        factors = self._points.force_factor * weights
        point_factors.array[self._rows[self._has_row]] = factors[self._has_row]
        self._stiffness.multTranspose(None, point_factors, row)
        return np.array(row.array_r)

    def set_law(self, law: LinearisedContactLaw) -> Array:
        """Set the linearised law, and return its force coefficients (m, dim, dim).

        At nodes with several points, they are those of the equations that remain without the
        additional forces.

        Raises:
            SingularSystem: if the law does not determine the additional forces.
        """
        self._E, self._C, self._D = law.E, law.C, law.D
        if self.elimination is None:
            return law.E
        if self._points.motion is not self._points.relative_displacement:
            by_own_displacement = self._points.extract_motions_by_own_displacement(law.C.shape[2])
            law = replace(law, C=law.C @ by_own_displacement)
        return self.elimination.set_law(law)

    def reduce_right_hand_side(self, law_right: Array) -> Array:
        """Return the right-hand side (m, dim) of the equations at each point's `rows`.

        The forces that the right-hand side `law_right` (m, dim) of all points' laws causes are
        stored in `force_of_right_hand_side`.
        """
        if self.elimination is None:
            return law_right
        self.force_of_right_hand_side = self.elimination.compute_force_changes(law_right)
        return self.elimination.reduce_law_values(law_right)

    def evaluate_motion_terms_of_law(self, x: PETSc.Vec) -> Array:
        """Return the terms (m, dim) of the equations that depend on motions, not on forces.

        The equations are those at each point's `rows`. The vector `x` contains the displacements
        and the free translations.
        """
        law_values = self._evaluate_motion_terms_of_all_points(x)
        if self.elimination is None:
            return law_values
        return self.elimination.reduce_law_values(law_values)

    def _evaluate_motion_terms_of_all_points(self, x: PETSc.Vec) -> Array:
        points, displacement = self._points, self._free_displacement
        n = displacement.getLocalSize()
        displacement.array[:] = x.array_r[:n]
        displacement.array[self._prescribed] = 0.0
        points.motion.mult(displacement, self._motions)
        m, _, n_motions = self._C.shape
        motions = self._motions.array_r.reshape(m, n_motions)
        law_values: Array = np.einsum("nab,nb->na", self._C, motions)
        if points.n_translations:
            last_rank = self._comm.size - 1
            U = np.append(self._comm.bcast(x.array_r[n:].copy(), last_rank), 0.0)
            law_values -= np.einsum("nab,nb->na", self._D, U[points.free_translation])
        return law_values

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        points, values, product = self._points, x.array_r, self._product
        n = product.getLocalSize()
        law_values = self._evaluate_motion_terms_of_all_points(x)
        self._stiffness.mult(None, self._free_displacement, product)
        force = points.extract_nodal_forces(product.array_r)
        law_values += np.einsum("nab,nb->na", self._E, force)
        if self.elimination is not None:
            force -= self.elimination.compute_force_changes(law_values)
            law_values = self.elimination.reduce_law_values(law_values)
        self.force = force + self.force_of_right_hand_side
        if points.opposite_force is not None:
            self._point_forces.setArray(force)
            points.opposite_force.multTranspose(self._point_forces, self._opposite_product)
            product.axpy(1.0, self._opposite_product)
        totals = np.zeros(points.n_translations)
        if points.n_translations:
            is_moved = points.free_translation >= 0
            np.add.at(totals, points.free_translation[is_moved], force[is_moved])
            self._comm.Allreduce(MPI.IN_PLACE, totals, MPI.SUM)
            totals += self.springs * self._comm.bcast(values[n:].copy(), self._comm.size - 1)
        result = y.array
        result[:n] = product.array_r
        result[n:] = totals[: len(values) - n]
        result[self._prescribed] = values[self._prescribed]
        result[self._rows[self._has_row]] = law_values[self._has_row]


def masked_row_mean_or_one(values: Array, mask: Mask) -> Array:
    """Return the mean (m,) of each row of values (m, dim) where `mask` is True.

    The mean is 1 for a row in which the mask is never True.
    """
    count, total = np.sum(mask, axis=1), np.sum(values * mask, axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), 1.0)

"""Equilibrium F(u) = H r at large strains, linearised at each iterate.

F is the residual of the body, r the contact forces at the contact points, and the force operator H
(n, m dim) distributes these forces to the equations. The contact forces are read from the
residual's entries at the contact points. The linear equilibrium of the next iterate a is

    K a = f + H r,    K = F'(u_k),    f = K u_k - F(u_k)

with the current iterate u_k. Newton's step is halved until no cell is inverted, and `line_search`
may shorten it further. For two bodies that slide on each other, `MortarKinematics` evaluates H(u),
and K includes the derivative of -H(u) r.

The module guarantees that no iterate has an inverted cell. It assumes a residual whose tangent is
assembled with the same sparsity pattern at each iterate.
"""

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import ufl
from basix import PolysetType
from dolfinx import fem
from ufl.algorithms import extract_elements

from pw_elements._compat import cell_geometry_nodes
from pw_elements.algebra import (
    JoinedResidualSystem,
    Reduction,
    ResidualSystem,
    reduce_load_and_update_offset,
)
from pw_elements.arrays import Array
from pw_elements.contact.interface import RELATIVE_COORDINATE_ROUND_OFF
from pw_elements.contact.iteration.increment import LinearEquilibrium
from pw_elements.contact.model import SolutionNotFound
from pw_elements.contact.nodes import (
    MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    MortarKinematics,
    TorqueMap,
)
from pw_elements.contact.system import ContactSystem
from pw_elements.spaces import SubSpace, is_hybrid

# Estimated largest absolute row sum of the tangent K, divided by the largest diagonal entry of K
_ESTIMATED_ROW_SUM_TO_MAX_DIAGONAL = 4.0
# Largest number of halvings of a Newton step
_MAX_NEWTON_STEP_HALVINGS = 10


class CellInversionCheck:
    """Check that det(I + grad u) > 0 at all quadrature points of the bodies' cell integrals.

    Args:
        bodies: for each body, its displacements, or displacements and pressure in a hybrid space;
            and a form whose cell integrals define the quadrature points.

    Attributes:
        extent: largest magnitude of a coordinate of the meshes.
    """

    def __init__(self, bodies: Sequence[tuple[fem.Function, ufl.Form]]) -> None:
        self._bodies = [_VolumeRatios(u, form) for u, form in bodies]
        self._comm: MPI.Comm = self._bodies[0].mesh.comm
        max_coordinate = max(np.abs(b.mesh.geometry.x).max(initial=0.0) for b in self._bodies)
        self.extent: float = self._comm.allreduce(max_coordinate, MPI.MAX)

    def compute_min_volume_ratio(self) -> float:
        """Return the smallest determinant det(I + grad u) over all processes; collective.

        The result is minus infinity if any determinant is NaN.
        """
        smallest = min(
            np.nan_to_num(body.evaluate(), nan=-np.inf).min(initial=np.inf) for body in self._bodies
        )
        return float(self._comm.allreduce(smallest, MPI.MIN))

    def find_midpoints_of_inverted_cells(self) -> Array:
        """Return the undeformed midpoints (k, dim) of all inverted cells; collective."""
        midpoints = np.concatenate(
            [body.find_midpoints_of_inverted_cells() for body in self._bodies]
        )
        return np.concatenate(self._comm.allgather(midpoints))


class _VolumeRatios:
    """Determinants det(I + grad u) of one body at the quadrature points of a form.

    Args:
        u: displacements, or displacements and pressure in a hybrid space.
        form: form whose cell integrals define the quadrature points.
    """

    def __init__(self, u: fem.Function, form: ufl.Form) -> None:
        self.mesh = u.function_space.mesh
        displacement = ufl.split(u)[0] if is_hybrid(u.function_space) else u
        F = ufl.Identity(self.mesh.geometry.dim) + ufl.grad(displacement)
        rules = [
            _reference_quadrature_points(i) for i in form.integrals() if i.integral_type() == "cell"
        ]
        self._points = np.unique(np.concatenate(rules), axis=0)
        self._determinant = fem.Expression(ufl.det(F), self._points)
        n_owned = self.mesh.topology.index_map(self.mesh.topology.dim).size_local
        self._cells = np.arange(n_owned, dtype=np.int32)

    def evaluate(self) -> Array:
        """Return the determinants (owned cells, points)."""
        values = self._determinant.eval(self.mesh, self._cells)
        return np.asarray(values).reshape(len(self._cells), len(self._points))

    def find_midpoints_of_inverted_cells(self) -> Array:
        """Return the undeformed midpoints (k, dim) of the inverted cells of this process."""
        inverted = self._cells[~(self.evaluate() > 0).all(axis=1)]
        corners = self.mesh.geometry.x[cell_geometry_nodes(self.mesh)[inverted]]
        return np.asarray(corners.mean(axis=1)[:, : self.mesh.geometry.dim])


def _reference_quadrature_points(integral: ufl.Integral) -> Array:
    """Return the quadrature points (q, dim) in the reference cell that an integral uses."""
    metadata = integral.metadata()
    if "quadrature_points" in metadata:
        return np.array(metadata["quadrature_points"])
    cell = integral.ufl_domain().ufl_coordinate_element().cell_type
    is_macro = any(e.polyset_type is PolysetType.macroedge for e in extract_elements(integral))
    kind = PolysetType.macroedge if is_macro else PolysetType.standard
    degree = int(np.max(metadata["quadrature_degree"]))
    return np.asarray(basix.make_quadrature(cell, degree, polyset_type=kind)[0])


class LargeStrainEquilibrium:
    """Equilibrium at large strains of a body in contact with rigid surfaces.

    The residual of the body is balanced by the contact forces.

    Args:
        body: residual of the body and its tangent.
        system: contact system, to which each new tangent is passed.
        reduction: reduction by the supports, with the displacements prescribed at the end of the
            increment.
        guard: check for inverted cells.
        start: all unknowns (n,) of the initial iterate.

    Attributes:
        tangent: tangent (n, n) of the last linearisation.

    Raises:
        SolutionNotFound: if cells are inverted at the start.
    """

    requires_accurate_last_linear_solve = False
    tangent: PETSc.Mat
    _linear: LinearEquilibrium
    # unknowns (n,), and whether they satisfied the supports
    _linearisation_point: tuple[PETSc.Vec, bool]

    def __init__(
        self,
        body: ResidualSystem | JoinedResidualSystem,
        system: ContactSystem,
        reduction: Reduction,
        guard: CellInversionCheck,
        start: PETSc.Vec,
    ) -> None:
        self._body, self._system, self._reduction, self._guard = body, system, reduction, guard
        self._u = start.copy()
        self._field = SubSpace.displacements(body.u.function_space)
        self.prescribed_displacements = reduction.offset
        # forces that correspond to the round-off of coordinates
        round_off = (
            RELATIVE_COORDINATE_ROUND_OFF * float(system.law_scale.max(initial=0.0)) * guard.extent
        )
        self._round_off = system.comm.allreduce(round_off, MPI.MAX) or np.finfo(float).tiny
        diagonal = self._field.extract(body.tangent.getDiagonal())
        self._max_row_sum = _ESTIMATED_ROW_SUM_TO_MAX_DIAGONAL * float(
            diagonal.norm(PETSc.NormType.INFINITY)
        )
        self._volume_round_off: Array | float = 0.0
        body.set_unknowns(start)
        if guard.compute_min_volume_ratio() <= 0:
            raise SolutionNotFound.with_positions(
                "cells at {} are inverted at the start", guard.find_midpoints_of_inverted_cells()
            )
        free = reduction.right.createVecRight()
        free.set(1.0)
        is_prescribed = (reduction.right * free).array_r == 0
        distance = np.abs(start.array_r - self.prescribed_displacements.array_r)[is_prescribed]
        distance = system.comm.allreduce(distance.max(initial=0.0), MPI.MAX)
        self._satisfies_supports = bool(distance <= RELATIVE_COORDINATE_ROUND_OFF * guard.extent)
        self._evaluate_residual_at_iterate()

    @property
    def satisfies_supports(self) -> bool:
        """Whether the iterate has the prescribed displacements of the end of the increment."""
        return self._satisfies_supports

    def move_towards_and_return_step_length(
        self, reduced_unknowns: PETSc.Vec, max_step_length: float = 1.0
    ) -> float:
        """Move from the last linearisation point towards a linear solution; return the step length.

        The step is halved until no cell is inverted.

        Args:
            reduced_unknowns: linear solution (n_r,), reduced by the supports. A step of length 1
                leads to it.
            max_step_length: largest length of the step.

        Raises:
            SolutionNotFound: if even the shortest step inverts cells.
        """
        start, satisfied_supports = self._linearisation_point
        step = self._linear.all_unknowns(reduced_unknowns)
        step.axpy(-1.0, start)
        step_length = max_step_length
        for _ in range(_MAX_NEWTON_STEP_HALVINGS):
            u = start.copy()
            u.axpy(step_length, step)
            self._body.set_unknowns(u)
            if self._guard.compute_min_volume_ratio() > 0:
                break
            step_length /= 2
        else:
            midpoints = self._guard.find_midpoints_of_inverted_cells()
            raise SolutionNotFound.with_positions("cells at {} would be inverted", midpoints)
        self._u, self._satisfies_supports = u, satisfied_supports or step_length == 1
        self._evaluate_residual_at_iterate()
        return step_length

    def linearise_load_at_iterate(self) -> PETSc.Vec:
        """Return the load K u - F(u) (n_r,) at the iterate, with the tangent K of the last one.

        With this load, the linear system gives the correction of a simplified Newton iteration.
        """
        load = self.tangent.createVecLeft()
        self.tangent.mult(self._u, load)
        load.axpy(-1.0, self._forces)
        return reduce_load_and_update_offset(self._reduction, self.tangent, load)[1]

    def norm_of_displacement_change(
        self, reduced_unknowns: PETSc.Vec, from_linearisation_point: bool = False
    ) -> float:
        """Return the norm of the displacements from an iterate to a linear solution; collective.

        Args:
            reduced_unknowns: linear solution (n_r,), reduced by the supports.
            from_linearisation_point: whether the change is measured from the last linearisation
                point instead of the present iterate.
        """
        change = self._linear.all_unknowns(reduced_unknowns)
        change.axpy(-1.0, self._linearisation_point[0] if from_linearisation_point else self._u)
        return float(self._field.extract(change).norm())

    def residual_without_contact(self, reduced_unknowns: PETSc.Vec) -> PETSc.Vec:  # noqa: ARG002
        return self._residual

    def all_unknowns(self, reduced_unknowns: PETSc.Vec) -> PETSc.Vec:  # noqa: ARG002
        return self._u

    def max_imbalance_to_tolerance_ratio(
        self,
        unbalanced_magnitudes: Array,
        tolerance_from_contact_forces: float,  # noqa: ARG002
        unknowns: PETSc.Vec,  # noqa: ARG002
    ) -> float:
        """Return the largest ratio of an unbalanced force to its tolerance.

        The ratio is infinite until the prescribed displacements are reached. The tolerance is a
        fraction of the largest nodal force plus round-off. Round-off is included because a body
        that has lost contact may have large displacements and no forces. In the pressure equations
        of hybrid bodies, the round-off of volumes replaces the round-off of displacements.

        Args:
            unbalanced_magnitudes: magnitudes (n_r,) of the unbalanced forces in the equations
                of this process.
            tolerance_from_contact_forces: not used here.
            unknowns: not used here.
        """
        displacement = self._field.extract(self._u).norm(PETSc.NormType.INFINITY)
        volume_round_off = np.asarray(self._volume_round_off)
        allowed = (
            MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * self._max_force
            + self._round_off
            + volume_round_off
        )
        force_round_off = RELATIVE_COORDINATE_ROUND_OFF * self._max_row_sum * displacement
        allowed = allowed + np.where(volume_round_off > 0, 0.0, force_round_off)
        if not self._satisfies_supports:
            return np.inf
        return float(np.max(unbalanced_magnitudes / allowed, initial=0.0))

    def linearise_and_return_load(self, torque_map: TorqueMap) -> PETSc.Vec:
        """Linearise at the current iterate: update the contact system and return the load (n_r,).

        The load is K u - F(u) with the unknowns u of the iterate, the tangent K and the residual
        F(u). It is reduced by the supports.

        Args:
            torque_map: map from motions of the surfaces to velocities of the contact nodes.
        """
        K, reduction = self._body.tangent, self._reduction
        self._body.assemble_tangent()
        K = self._set_contact_system_tangent(K, torque_map)
        self.tangent, self._volume_round_off = K, self._estimate_round_off_of_pressure_equations(K)
        self._linearisation_point = self._u, self._satisfies_supports
        reduced = self.linearise_load_at_iterate()
        self._linear = LinearEquilibrium(
            self._system.stiffness, reduced, reduction.right, reduction.offset
        )
        return reduced

    def _set_contact_system_tangent(
        self, body_tangent: PETSc.Mat, torque_map: TorqueMap
    ) -> PETSc.Mat:
        """Pass the tangent of the equilibrium to the contact system and return it.

        Args:
            body_tangent: tangent (n, n) of the body alone.
            torque_map: map from motions of the surfaces to velocities of the contact nodes.

        Returns:
            The tangent (n, n) of the whole equilibrium, including the contact forces.
        """
        self._system.update_stiffness(body_tangent, torque_map)
        return body_tangent

    def _estimate_round_off_of_pressure_equations(self, tangent: PETSc.Mat) -> Array | float:
        """Return the round-off (n_r,) of the reduced pressure equations of a hybrid body.

        The entries of displacement equations are zero. For a body without pressure unknowns, the
        result is the number 0.

        Args:
            tangent: tangent (n, n) of the equilibrium.
        """
        if not is_hybrid(self._body.u.function_space):
            return 0.0
        (x, image), owned = tangent.createVecs(), self._field.owned_unknowns
        position = self._field.space.tabulate_dof_coordinates()[: len(owned), : owned.shape[1]]
        x.array[owned.ravel()] = position.ravel()
        tangent.mult(x, image)
        image.array[owned.ravel()] = 0.0
        volumes = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(image, volumes)
        return RELATIVE_COORDINATE_ROUND_OFF * np.abs(volumes.array_r)

    def _evaluate_residual_at_iterate(self) -> None:
        """Evaluate the residual of the current iterate, reduce it, and store its largest force."""
        self._forces = self._body.assemble_residual()
        self._max_force = self._field.extract(self._forces).norm(PETSc.NormType.INFINITY)
        self._residual = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(self._forces, self._residual)


class SlidingBodiesEquilibrium(LargeStrainEquilibrium):
    """Equilibrium at large strains of bodies that slide on each other.

    The force operator, which distributes contact forces to the nodes of both bodies, is evaluated
    from mortar integrals at each iterate.

    Args:
        body, system, reduction, guard, start: arguments of `LargeStrainEquilibrium`.
        mortars: kinematics of all pairs that consist of two bodies.
    """

    def __init__(
        self,
        body: ResidualSystem | JoinedResidualSystem,
        system: ContactSystem,
        reduction: Reduction,
        guard: CellInversionCheck,
        start: PETSc.Vec,
        *,
        mortars: MortarKinematics,
    ) -> None:
        self._mortars = mortars
        super().__init__(body, system, reduction, guard, start)

    def _evaluate_residual_at_iterate(self) -> None:
        super()._evaluate_residual_at_iterate()
        self._system.set_force_operator(
            self._mortars.linearise_mortars_and_assemble_force_operator(self._u)
        )

    def _set_contact_system_tangent(
        self, body_tangent: PETSc.Mat, torque_map: TorqueMap
    ) -> PETSc.Mat:
        force_change = self._mortars.assemble_stiffness_of_force_operator_change(
            self._system.split_residual_into_contact_and_unbalanced_forces(self._residual)[0]
        )
        return self._system.update_stiffness_and_motion_operator(
            body_tangent, force_change, torque_map, self._mortars.motion_operator
        )

"""Equilibrium F(u) = H r at large strains, linearised at each iterate.

The nodal forces are entries of the residual, r = L F(u), and

    K a = f + H r,    K = F'(u_k),    f = K u_k - F(u_k)

is the linear equilibrium of the next iterate. Newton's step is halved while it inverts a cell. For
two bodies that slide on each other, `MortarKinematics` evaluates H(u), and K also contains the
derivative of -H(u) r.

The module guarantees that no iterate has an inverted cell. It assumes a residual whose tangent is
assembled with the same sparsity pattern at each iterate.
"""

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import ufl
from basix import PolysetType
from dolfinx import fem
from ufl.algorithms import extract_elements

from pw_elements._compat import cell_nodes
from pw_elements.algebra import Reduction, ResidualSystem, reduce_load
from pw_elements.arrays import Array
from pw_elements.contact.interface import COORDINATE_ROUND_OFF
from pw_elements.contact.iteration.increment import LinearEquilibrium
from pw_elements.contact.model import NotFound
from pw_elements.contact.nodes import FORCE_TOLERANCE, MortarKinematics, TorqueMap
from pw_elements.contact.system import ContactSystem
from pw_elements.spaces import SubSpace, is_hybrid

# Estimate of the largest sum of magnitudes in a row of K, relative to the diagonal
_ROW_SUM_TO_DIAGONAL_RATIO = 4.0
# Largest number of halvings of a Newton step
_MAX_HALVINGS = 10


class CellGuard:
    """Check of det(I + grad u) > 0 at all quadrature points of a form's cell integrals.

    Args:
        u: displacements, or displacements and pressure of a hybrid space.
        form: form whose integrals define the quadrature points.

    Attributes:
        extent: largest magnitude of the mesh's coordinates.
    """

    def __init__(self, u: fem.Function, form: ufl.Form) -> None:
        self._mesh = u.function_space.mesh
        displacement = ufl.split(u)[0] if is_hybrid(u.function_space) else u
        F = ufl.Identity(self._mesh.geometry.dim) + ufl.grad(displacement)
        rules = [_quadrature_points(i) for i in form.integrals() if i.integral_type() == "cell"]
        self._points = np.unique(np.concatenate(rules), axis=0)
        self._determinant = fem.Expression(ufl.det(F), self._points)
        n_owned = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        self._cells = np.arange(n_owned, dtype=np.int32)
        max_coordinate = np.abs(self._mesh.geometry.x).max(initial=0.0)
        self.extent: float = self._mesh.comm.allreduce(max_coordinate, MPI.MAX)

    def min_determinant(self) -> float:
        """Return the smallest determinant, minus infinity if one is not a number; collective."""
        values = np.nan_to_num(self._evaluate_determinants(), nan=-np.inf)
        return float(self._mesh.comm.allreduce(values.min(initial=np.inf), MPI.MIN))

    def find_inverted_midpoints(self) -> Array:
        """Return the undeformed midpoints (k, dim) of all inverted cells; collective."""
        inverted = self._cells[~(self._evaluate_determinants() > 0).all(axis=1)]
        mesh = self._mesh
        midpoints = mesh.geometry.x[cell_nodes(mesh)[inverted]].mean(axis=1)
        return np.concatenate(mesh.comm.allgather(midpoints[:, : mesh.geometry.dim]))

    def _evaluate_determinants(self) -> Array:
        values = self._determinant.eval(self._mesh, self._cells)
        return np.asarray(values).reshape(len(self._cells), len(self._points))


def _quadrature_points(integral: ufl.Integral) -> Array:
    """Return the quadrature points (q, dim) of an integral in the reference cell."""
    metadata = integral.metadata()
    if "quadrature_points" in metadata:
        return np.array(metadata["quadrature_points"])
    cell = integral.ufl_domain().ufl_coordinate_element().cell_type
    is_macro = any(e.polyset_type is PolysetType.macroedge for e in extract_elements(integral))
    kind = PolysetType.macroedge if is_macro else PolysetType.standard
    degree = int(np.max(metadata["quadrature_degree"]))
    return np.asarray(basix.make_quadrature(cell, degree, polyset_type=kind)[0])


class FiniteEquilibrium:
    """An `Equilibrium` F(u) = H r at large strains with rigid surfaces.

    Args:
        body: residual and tangent.
        system: linear systems of the contact nodes, which receive each new tangent.
        reduction: reduction by the supports with the displacements prescribed at the end.
        guard: check of inverted cells.
        start: all unknowns (n,) at the initial iterate.

    Attributes:
        tangent: K, (n, n), of the last linearisation.

    Raises:
        NotFound: if cells are inverted at the start.
    """

    needs_final_solution = False
    tangent: PETSc.Mat
    _linear: LinearEquilibrium

    def __init__(
        self,
        body: ResidualSystem,
        system: ContactSystem,
        reduction: Reduction,
        guard: CellGuard,
        start: PETSc.Vec,
    ) -> None:
        self._body, self._system, self._reduction, self._guard = body, system, reduction, guard
        self._u = start.copy()
        self._field = SubSpace.displacements(body.u.function_space)
        self.offset = reduction.offset
        # forces due to round-off of coordinates
        round_off = COORDINATE_ROUND_OFF * float(system.law_scale.max(initial=0.0)) * guard.extent
        self._round_off = system.comm.allreduce(round_off, MPI.MAX) or np.finfo(float).tiny
        diagonal = self._field.extract(body.tangent.getDiagonal())
        self._max_row_sum = _ROW_SUM_TO_DIAGONAL_RATIO * float(
            diagonal.norm(PETSc.NormType.INFINITY)
        )
        self._volume_round_off: Array | float = 0.0
        body.set_unknowns(start)
        if guard.min_determinant() <= 0:
            raise NotFound.with_positions(
                "cells at {} are inverted at the start", guard.find_inverted_midpoints()
            )
        free = reduction.right.createVecRight()
        free.set(1.0)
        is_prescribed = (reduction.right * free).array_r == 0
        distance = np.abs(start.array_r - self.offset.array_r)[is_prescribed]
        distance = system.comm.allreduce(distance.max(initial=0.0), MPI.MAX)
        self._satisfies_supports = bool(distance <= COORDINATE_ROUND_OFF * guard.extent)
        self._update_forces()

    def line_search_to(self, reduced: PETSc.Vec) -> float:
        """Update u towards the solution of the linear equations; return the step length.

        A step of length 1, the full step, is halved until no cell is inverted.

        Raises:
            NotFound: if the shortest step inverts cells.
        """
        step = self._linear.displacements(reduced)
        step.axpy(-1.0, self._u)
        step_length = 1.0
        for _ in range(_MAX_HALVINGS):
            u = self._u.copy()
            u.axpy(step_length, step)
            self._body.set_unknowns(u)
            if self._guard.min_determinant() > 0:
                break
            step_length /= 2
        else:
            midpoints = self._guard.find_inverted_midpoints()
            raise NotFound.with_positions("cells at {} would be inverted", midpoints)
        self._u, self._satisfies_supports = u, step_length == 1
        self._update_forces()
        return step_length

    def residual(self, reduced: PETSc.Vec) -> PETSc.Vec:  # noqa: ARG002
        return self._residual

    def displacements(self, reduced: PETSc.Vec) -> PETSc.Vec:  # noqa: ARG002
        return self._u

    def violation(
        self,
        unbalanced: Array,
        contact_allowance: float,  # noqa: ARG002
        unknowns: PETSc.Vec,  # noqa: ARG002
    ) -> float:
        """Return the largest ratio of an unbalanced force to its tolerance.

        The ratio is infinite until the prescribed displacements are reached. Tolerances are
        relative to the largest force and include round-off: a body that has lost contact may have
        large displacements and no forces. Equations of pressures have the round-off of volumes.
        """
        displacement = self._field.extract(self._u).norm(PETSc.NormType.INFINITY)
        volume_round_off = np.asarray(self._volume_round_off)
        allowed = FORCE_TOLERANCE * self._max_force + self._round_off + volume_round_off
        force_round_off = COORDINATE_ROUND_OFF * self._max_row_sum * displacement
        allowed = allowed + np.where(volume_round_off > 0, 0.0, force_round_off)
        if not self._satisfies_supports:
            return np.inf
        return float(np.max(unbalanced / allowed, initial=0.0))

    def linearise(self, torque_map: TorqueMap) -> PETSc.Vec:
        """Assemble K and f at u, pass K to the contact system and return the reduced f."""
        K, reduction = self._body.tangent, self._reduction
        self._body.assemble_tangent()
        K = self._update_system(K, torque_map)
        self.tangent, self._volume_round_off = K, self._estimate_volume_round_off(K)
        load = K.createVecLeft()
        K.mult(self._u, load)
        load.axpy(-1.0, self._forces)
        _, reduced = reduce_load(reduction, K, load)
        self._linear = LinearEquilibrium(
            self._system.stiffness, reduced, reduction.right, reduction.offset
        )
        return reduced

    def _update_system(self, K: PETSc.Mat, torque_map: TorqueMap) -> PETSc.Mat:
        """Pass the tangent K (n, n) of the body to the contact system; return the full tangent."""
        self._system.update_stiffness(K, torque_map)
        return K

    def _estimate_volume_round_off(self, K: PETSc.Mat) -> Array | float:
        """Return the round-off (n_r,) of the reduced pressure equations, zero in all others."""
        if not is_hybrid(self._body.u.function_space):
            return 0.0
        (x, image), owned = K.createVecs(), self._field.owned_unknowns
        position = self._field.space.tabulate_dof_coordinates()[: len(owned), : owned.shape[1]]
        x.array[owned.ravel()] = position.ravel()
        K.mult(x, image)
        image.array[owned.ravel()] = 0.0
        volumes = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(image, volumes)
        return COORDINATE_ROUND_OFF * np.abs(volumes.array_r)

    def _update_forces(self) -> None:
        """Evaluate the residual F(u), its reduction and its largest force at the current u."""
        self._forces = self._body.assemble_residual()
        self._max_force = self._field.extract(self._forces).norm(PETSc.NormType.INFINITY)
        self._residual = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(self._forces, self._residual)


class SlidingEquilibrium(FiniteEquilibrium):
    """A `FiniteEquilibrium` of bodies that slide on each other, whose H follows the mortars.

    Args:
        body, system, reduction, guard, start: arguments of `FiniteEquilibrium`.
        mortars: kinematics of all pairs of two bodies.
    """

    def __init__(
        self,
        body: ResidualSystem,
        system: ContactSystem,
        reduction: Reduction,
        guard: CellGuard,
        start: PETSc.Vec,
        *,
        mortars: MortarKinematics,
    ) -> None:
        self._mortars = mortars
        super().__init__(body, system, reduction, guard, start)

    def _update_forces(self) -> None:
        super()._update_forces()
        self._system.set_force_operator(self._mortars.update_force_operator(self._u))

    def _update_system(self, K: PETSc.Mat, torque_map: TorqueMap) -> PETSc.Mat:
        tangent = self._mortars.force_operator_stiffness(
            self._system.split_residual(self._residual)[0]
        )
        tangent.axpy(1.0, K, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._system.update_stiffness_and_motion(tangent, torque_map, self._mortars.motion_operator)
        return tangent

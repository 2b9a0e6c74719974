"""Equilibrium F(u) = H r at large strains, linearised where the iteration is.

Residuals need no areas: the force of a node is the residual's entry, r = L F(u), and

    K a = f + H r,    K = F'(u_k),    f = K u_k - F(u_k)

is a linear equilibrium for the next u. Newton's step to it is halved as long as it inverts a cell.
Of two bodies H(u) is that of `MortarKinematics`, and K has -dH r besides.
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
from pw_elements.contact.interface import ROUND_OFF
from pw_elements.contact.iteration.increment import LinearEquilibrium
from pw_elements.contact.model import NotFound
from pw_elements.contact.nodes import TOLERANCE, MortarKinematics, TorqueMap
from pw_elements.contact.system import ContactSystem
from pw_elements.spaces import SubSpace, is_hybrid

# Largest sum of the magnitudes in a row of K over its diagonal, roughly
_ROW_SUM_OVER_DIAGONAL = 4.0
# A step is halved so often at most
_MAX_HALVINGS = 10


class CellGuard:
    """Checks det(I + grad u) > 0 at all quadrature points of a form's integrals."""

    def __init__(self, u: fem.Function, form: ufl.Form) -> None:
        self._mesh = u.function_space.mesh
        displacement = ufl.split(u)[0] if is_hybrid(u.function_space) else u
        F = ufl.Identity(self._mesh.geometry.dim) + ufl.grad(displacement)
        rules = [_quadrature_points(i) for i in form.integrals() if i.integral_type() == "cell"]
        self._points = np.unique(np.concatenate(rules), axis=0)
        self._determinant = fem.Expression(ufl.det(F), self._points)
        n_owned = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        self._cells = np.arange(n_owned, dtype=np.int32)
        largest = np.abs(self._mesh.geometry.x).max(initial=0.0)
        self.extent: float = self._mesh.comm.allreduce(largest, MPI.MAX)

    def min_determinant(self) -> float:
        """Return the least determinant; minus infinity where it is not a number."""
        values = np.nan_to_num(self._determinants(), nan=-np.inf)
        return float(self._mesh.comm.allreduce(values.min(initial=np.inf), MPI.MIN))

    def inverted_midpoints(self) -> Array:
        """Return the undeformed midpoints (k, dim) of inverted cells of all processes."""
        inverted = self._cells[~(self._determinants() > 0).all(axis=1)]
        mesh = self._mesh
        midpoints = mesh.geometry.x[cell_nodes(mesh)[inverted]].mean(axis=1)
        return np.concatenate(mesh.comm.allgather(midpoints[:, : mesh.geometry.dim]))

    def _determinants(self) -> Array:
        values = self._determinant.eval(self._mesh, self._cells)
        return np.asarray(values).reshape(len(self._cells), len(self._points))


def _quadrature_points(integral: ufl.Integral) -> Array:
    """Points (q, dim) of an integral's rule in the reference cell."""
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
        body: the residual and its tangent.
        system: of the contact nodes; its matrix follows the tangent.
        reduction: by the supports, with what they prescribe at the end.
        guard: against inverted cells.
        start: all unknowns (n,) at which the iteration begins.

    Raises:
        NotFound: if cells are inverted at the start.
    """

    needs_final_solution = False
    tangent: PETSc.Mat  # (n, n), where it has been linearised last
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
        # coordinates' round-off, as forces
        round_off = ROUND_OFF * float(system.law_scale.max(initial=0.0)) * guard.extent
        self._round_off = system.comm.allreduce(round_off, MPI.MAX) or np.finfo(float).tiny
        diagonal = self._field.extract(body.tangent.getDiagonal())
        self._max_row_sum = _ROW_SUM_OVER_DIAGONAL * float(diagonal.norm(PETSc.NormType.INFINITY))
        self._volume_round_off: Array | float = 0.0
        body.set_unknowns(start)
        if guard.min_determinant() <= 0:
            raise NotFound.with_positions(
                "cells at {} are turned inside out at the start", guard.inverted_midpoints()
            )
        free = reduction.right.createVecRight()
        free.set(1.0)
        is_prescribed = (reduction.right * free).array_r == 0
        distance = np.abs(start.array_r - self.offset.array_r)[is_prescribed]
        distance = system.comm.allreduce(distance.max(initial=0.0), MPI.MAX)
        self._satisfies_supports = bool(distance <= ROUND_OFF * guard.extent)
        self._update_forces()

    def line_search_to(self, reduced: PETSc.Vec) -> float:
        """Go to a solution of the linear equations, or so far that no cell is inverted.

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
            midpoints = self._guard.inverted_midpoints()
            raise NotFound.with_positions("cells at {} would be turned inside out", midpoints)
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
        full: PETSc.Vec,  # noqa: ARG002
    ) -> float:
        """Return unbalanced forces over the largest ones; infinite before supports are satisfied.

        Round-off of forces is allowed for: a body that has left its tool may have moved far, with
        no force to compare with. Equations of pressures are volumes, which have round-off, too.
        """
        displacement = self._field.extract(self._u).norm(PETSc.NormType.INFINITY)
        of_volumes = np.asarray(self._volume_round_off)
        allowed = TOLERANCE * self._max_force + self._round_off + of_volumes
        of_forces = ROUND_OFF * self._max_row_sum * displacement
        allowed = allowed + np.where(of_volumes > 0, 0.0, of_forces)
        satisfied = self._satisfies_supports
        return float(np.max(unbalanced / allowed, initial=0.0)) if satisfied else np.inf

    def linearise(self, torque_map: TorqueMap) -> PETSc.Vec:
        """Assemble K and f at u, set the system's matrix and return f, reduced."""
        K, reduction = self._body.tangent, self._reduction
        self._body.assemble_tangent()
        K = self._renew_system(K, torque_map)
        self.tangent, self._volume_round_off = K, self._round_off_of_volumes(K)
        load = K.createVecLeft()
        K.mult(self._u, load)
        load.axpy(-1.0, self._forces)
        _, reduced = reduce_load(reduction, K, load)
        self._linear = LinearEquilibrium(
            self._system.stiffness, reduced, reduction.right, reduction.offset
        )
        return reduced

    def _renew_system(self, K: PETSc.Mat, torque_map: TorqueMap) -> PETSc.Mat:
        """Set the system's matrix; return the tangent (n, n)."""
        self._system.update_stiffness(K, torque_map)
        return K

    def _round_off_of_volumes(self, K: PETSc.Mat) -> Array | float:
        """Round-off of the reduced equations (n_r,) of pressures; zero in all others."""
        if not is_hybrid(self._body.u.function_space):
            return 0.0
        (x, image), owned = K.createVecs(), self._field.owned_unknowns
        position = self._field.space.tabulate_dof_coordinates()[: len(owned), : owned.shape[1]]
        x.array[owned.ravel()] = position.ravel()
        K.mult(x, image)
        image.array[owned.ravel()] = 0.0
        volumes = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(image, volumes)
        return ROUND_OFF * np.abs(volumes.array_r)

    def _update_forces(self) -> None:
        """Evaluate the residual at u."""
        self._forces = self._body.assemble_residual()
        self._max_force = self._field.extract(self._forces).norm(PETSc.NormType.INFINITY)
        self._residual = self._reduction.left.createVecRight()
        self._reduction.left.multTranspose(self._forces, self._residual)


class SlidingEquilibrium(FiniteEquilibrium):
    """A `FiniteEquilibrium` of two bodies that slide on each other: H follows their mortars.

    Args:
        body, system, reduction, guard, start: as of `FiniteEquilibrium`.
        mortars: both sides of all pairs of bodies.
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
        self._system.set_force_operator(self._mortars.update(self._u))

    def _renew_system(self, K: PETSc.Mat, torque_map: TorqueMap) -> PETSc.Mat:
        tangent = self._mortars.force_stiffness(self._system.split_residual(self._residual)[0])
        tangent.axpy(1.0, K, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._system.update_stiffness_and_motion(tangent, torque_map, self._mortars.motion)
        return tangent

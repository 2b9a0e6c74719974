"""Block-triangular preconditioner for hybrid bodies.

Displacements are preconditioned by multigrid and pressures by their mass matrix. The guide's page
on theory defines the blocks ("Large systems").
"""

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix, assemble_vector

from pw_elements.solvers.direct import FreeConstantPressure, set_options
from pw_elements.solvers.matrices import (
    ConstrainedOperator,
    ConstraintProjection,
    Supports,
    destroy_objects,
    galerkin_product,
    matrix_from_python_context,
)
from pw_elements.solvers.multigrid import Multigrid, linear_space_vertex_nodes_and_interpolation
from pw_elements.spaces import (
    CONSTANT_PRESSURE_ROUND_OFF_OVER_STIFFNESS,
    SubSpace,
    pressure_equilibration_scales,
)

# For each cell type: bounds of the eigenvalues of the P1 or Q1 mass matrix after scaling to a unit
# diagonal, and degree of the Chebyshev polynomial that approximates the inverse of this matrix
_MASS_SPECTRUM_AND_CHEBYSHEV_DEGREE_BY_CELL = {
    "triangle": (0.5, 2.0, 6),
    "quadrilateral": (0.25, 2.25, 9),
    "tetrahedron": (0.5, 2.5, 6),
    "hexahedron": (0.125, 3.375, 12),
}


class BlockTriangularPreconditioner:
    """Preconditioner for a matrix of a hybrid space, used instead of a `Multigrid`.

    The diagonal matrix s of `pressure_equilibration_scales` scales pressures to lengths, and the
    projection Pi sets prescribed unknowns to zero.

    Args:
        K: matrix (n, n) of displacements and pressures, without supports.
        supports: free unknowns of the space.

    Attributes:
        scaled_matrix: the matrix s K s.
        operator: the matrix under supports, Pi s K s Pi + (1 - Pi).
        displacement_block: stiffness A of the displacements, stored in blocks, and its supports.
        multigrid: multigrid preconditioner for A.
        displacement_pc: preconditioner for A: `multigrid` or, in contact, `SpringPreconditioner`.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports) -> None:
        space, comm = supports.space, K.comm
        self._K = K
        self.displacements, self._pressure = SubSpace.displacements(space), SubSpace.pressure(space)
        self._scale = pressure_equilibration_scales(space, K)
        self.operator, self.scaled_matrix = (
            matrix_from_python_context(
                K.getSizes(),
                ConstrainedOperator(K, ConstraintProjection(free, 1), self._scale),
                comm,
            )
            for free in (supports.free, np.ones_like(supports.free))
        )
        free_displacements = supports.free[self.displacements.owned_unknowns.ravel()]
        self._free_pressures = supports.free[self._pressure.owned_unknowns.ravel()].astype(float)
        A = self._extract_blocks_and_set_pressure_solver()
        self.displacement_block = A, Supports(self.displacements.space, free_displacements)
        self.multigrid = Multigrid(*self.displacement_block)
        self.displacement_pc = PETSc.PC().create(comm)
        self._force, self._displacement = A.createVecs()
        self._pressure_correction, self._volume_residual = (
            self._B.createVecLeft(),
            self._B.createVecLeft(),
        )

    def _extract_blocks_and_set_pressure_solver(
        self, reused_displacement_block: PETSc.Mat | None = None
    ) -> PETSc.Mat:
        """Extract the blocks of K, set up the pressure solver and return the displacement block.

        Args:
            reused_displacement_block: matrix to overwrite with the block of the displacements; None
                creates a new matrix.
        """
        space = self.displacements.space
        u, p = (field.global_numbers() for field in (self.displacements, self._pressure))
        aij = self._K.createSubMatrix(u, u)
        aij.setBlockSize(space.mesh.geometry.dim)
        reused_displacement_block = aij.convert("baij", reused_displacement_block or PETSc.Mat())
        destroy_objects(aij)
        self._B = self._K.createSubMatrix(p, u)
        scale = self._pressure.extract(self._scale)
        S = _pressure_mass_over_twice_shear_modulus(
            space, self._pressure.space, reused_displacement_block, self._B
        )
        compressibility = self._K.createSubMatrix(p, p)
        S.axpy(-1.0, compressibility, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        S.diagonalScale(scale, scale)
        self._B.diagonalScale(scale)
        self._mass_solver = _create_pressure_mass_solver(S, space.mesh.topology.cell_name())
        return reused_displacement_block

    def update_for_changed_matrix(self) -> None:
        """Extract the blocks again after K has changed, and update the multigrid."""
        self._extract_blocks_and_set_pressure_solver(self.displacement_block[0])
        self.multigrid.update_for_changed_matrix()

    def configure_petsc_pc(self, preconditioner: PETSc.PC) -> None:
        self.displacement_pc.setOptionsPrefix(preconditioner.getOptionsPrefix())
        self.displacement_pc.setOperators(self.multigrid.operator)
        self.multigrid.configure_petsc_pc(self.displacement_pc)
        self.displacement_pc.setFromOptions()
        preconditioner.setType("python")
        preconditioner.setPythonContext(self)

    def release(self) -> None:
        destroy_objects(self.displacement_pc, self.operator, self.scaled_matrix)
        self.multigrid.release()

    def set_up_levels(self) -> None:
        """Set up the coarse level of the multigrid.

        Raises:
            FreeConstantPressure: if the pressure is determined only up to a constant.
        """
        if self.has_free_constant_pressure(self.operator):
            raise FreeConstantPressure
        self.multigrid.set_up_levels()

    def has_free_constant_pressure(self, operator: PETSc.Mat) -> bool:
        """Return whether an operator maps a constant pressure to zero.

        Args:
            operator: matrix (n, n), or a larger one in which the n unknowns come first on each
                process.
        """
        constant, effect = operator.createVecs()
        pressures = self._pressure.embed(self._free_pressures)
        constant.array[: len(pressures)] = pressures
        operator.mult(constant, effect)
        infinity = PETSc.NormType.INFINITY
        stiffness = self.displacement_block[0].norm(infinity)
        return bool(effect.norm(infinity) <= CONSTANT_PRESSURE_ROUND_OFF_OVER_STIFFNESS * stiffness)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        values = x.array_r
        self._force.setArray(values[self.displacements.owned_unknowns.ravel()])
        self.displacement_pc.apply(self._force, self._displacement)
        self._B.mult(self._displacement, self._volume_residual)
        prescribed = values[self._pressure.owned_unknowns.ravel()]
        self._volume_residual.setArray(
            (self._volume_residual.array_r - prescribed) * self._free_pressures
        )
        self._mass_solver.solve(self._volume_residual, self._pressure_correction)
        u = self.displacements.embed(self._displacement.array_r)
        p = np.where(self._free_pressures > 0, self._pressure_correction.array_r, prescribed)
        y.setArray(u + self._pressure.embed(p))


def _pressure_mass_over_twice_shear_modulus(
    displacement_space: fem.FunctionSpace,
    pressure_space: fem.FunctionSpace,
    displacement_stiffness: PETSc.Mat,
    volume_change_matrix: PETSc.Mat,
) -> PETSc.Mat:
    """Return the mass matrix of pressures, divided by twice the shear modulus.

    The modulus, multiplied by the thickness, is estimated at each vertex by the ratio of the
    diagonals of P^T A P and of the stiffness of linear elements with a unit modulus, where P
    interpolates linear functions at all nodes. The thickness of plane bodies (in axisymmetry, the
    circumference) is the ratio of B u to the integrals of the vertex functions, where u are the
    displacements of a unit strain.

    Args:
        displacement_space: space of the displacements.
        pressure_space: space of the pressures.
        displacement_stiffness: stiffness A of the displacements.
        volume_change_matrix: matrix B that maps displacements to integrals of the volume change.
    """
    mesh = displacement_space.mesh
    linear, _, P = linear_space_vertex_nodes_and_interpolation(displacement_space)
    u, v = ufl.TrialFunction(linear), ufl.TestFunction(linear)
    unit = assemble_matrix(fem.form(2 * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) * ufl.dx))
    unit.assemble()
    dim = mesh.geometry.dim
    stiffness, unit_stiffness = (
        matrix.getDiagonal().array_r.reshape(-1, dim).sum(axis=1)
        for matrix in (galerkin_product(displacement_stiffness, P), unit)
    )
    q = ufl.TestFunction(pressure_space)
    areas = assemble_vector(fem.form(q * ufl.dx))
    areas.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    unit_strain, volumes = volume_change_matrix.createVecs()
    x = displacement_space.tabulate_dof_coordinates()[: unit_strain.getLocalSize() // dim]
    unit_strain.array.reshape(-1, dim)[:, -1] = x[:, dim - 1]
    volume_change_matrix.mult(unit_strain, volumes)
    thickness = np.abs(volumes.array_r / areas.array_r)
    modulus = np.abs(stiffness / unit_stiffness)
    weight = fem.Function(pressure_space)
    weight.x.array[: len(modulus)] = thickness**2 / (2 * modulus)
    weight.x.scatter_forward()
    mass = assemble_matrix(fem.form(weight * ufl.TrialFunction(pressure_space) * q * ufl.dx))
    mass.assemble()
    return mass


def _create_pressure_mass_solver(mass: PETSc.Mat, cell: str) -> PETSc.KSP:
    least, largest, degree = _MASS_SPECTRUM_AND_CHEBYSHEV_DEGREE_BY_CELL[cell]
    ksp = PETSc.KSP().create(mass.comm)
    ksp.setOperators(mass)
    ksp.setType("chebyshev")
    ksp.setNormType(PETSc.KSP.NormType.NONE)
    ksp.setTolerances(max_it=degree)
    ksp.getPC().setType("jacobi")
    set_options(ksp, {"ksp_chebyshev_eigenvalues": f"{least},{largest}"})
    return ksp

"""Preconditioner of the hybrid element: a block triangle for Krylov's method.

With A the stiffness of displacements, B that of volume and S the pressure's mass over its moduli,
-(1/(2 mu) + 1/lambda), the triangle [A 0; B S] takes the place of the matrix: A by multigrid, S by
a Chebyshev polynomial. It is linear, so that plain GMRES does. See H. Elman, D. Silvester,
A. Wathen, "Finite Elements and Fast Iterative Solvers" (2014), 4.2; of mass matrices, A. Wathen,
IMA J. Numer. Anal. 7 (1987), doi:10.1093/imanum/7.4.449.
"""

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix, assemble_vector

from pw_elements.hybrid import FREE_PRESSURE, NOTHING, SubSpace, equilibration
from pw_elements.linear_functions import linear_interpolation
from pw_elements.linear_solver import SingularSystem, set_options
from pw_elements.matrices import destroy, galerkin_product, python_matrix
from pw_elements.multigrid import Multigrid
from pw_elements.projection import Masked, Projection, Supports

Array = npt.NDArray[np.float64]

# Eigenvalues of P1 or Q1 mass matrices over their diagonal, and the polynomial's degree
_MASS = {
    "triangle": (0.5, 2.0, 6),
    "quadrilateral": (0.25, 2.25, 9),
    "tetrahedron": (0.5, 2.5, 6),
    "hexahedron": (0.125, 3.375, 12),
}


class SaddlePoint:
    """The levels for one matrix of hybrid spaces, in the place of a `Multigrid`.

    Pressures are scaled to lengths, as by `hybrid.equilibration`.

    Args:
        K: (n, n), all rows and columns free.
        supports: of its space.

    Attributes:
        operator: Pi s K s Pi + (1 - Pi), with the scale s.
        scaled: s K s.
        displacements: among the unknowns.
        elastic: A in blocks, and its supports.
        levels: of A.
        inner: preconditioner of A by them, or one that has more to do.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports) -> None:
        space, comm = supports.space, K.comm
        self.displacements, self._p = SubSpace.displacements(space), SubSpace.pressure(space)
        scale, every = equilibration(space, K), np.ones_like(supports.free)
        self.operator, self.scaled = (
            python_matrix(K.getSizes(), Masked(K, Projection(free, 1), scale), comm)
            for free in (supports.free, every)
        )
        u, p = (field.selection() for field in (self.displacements, self._p))
        columns = u.transpose(PETSc.Mat()), p.transpose(PETSc.Mat())
        of_equilibrium, of_volume = u.matMult(K), p.matMult(K)
        plain = of_equilibrium.matMult(columns[0])
        plain.setBlockSize(space.mesh.geometry.dim)
        A = plain.convert("baij", PETSc.Mat())
        destroy(of_equilibrium, plain)
        self._B = of_volume.matMult(columns[0])
        own = supports.free[self.displacements.owned.ravel()]
        self.elastic = A, Supports(self.displacements.space, own)
        self.levels = Multigrid(*self.elastic)
        self._free = supports.free[self._p.owned.ravel()].astype(float)
        scales = self._p.part(scale)
        S = _mass(self.displacements.space, self._p.space, A, self._B)
        S.axpy(-1.0, of_volume.matMult(columns[1]), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        S.diagonalScale(scales, scales)
        self._B.diagonalScale(scales)
        self._pressure = _chebyshev(S, space.mesh.topology.cell_name())
        self.inner = PETSc.PC().create(comm)
        self._given, self._found = A.createVecs()
        self._pressed, self._rest = S.createVecs()

    def set_up(self, preconditioner: PETSc.PC) -> None:
        """Makes a preconditioner this one; its options prefix is the multigrid's, too."""
        self.inner.setOptionsPrefix(preconditioner.getOptionsPrefix())
        self.inner.setOperators(self.levels.operator)
        self.levels.set_up(self.inner)
        self.inner.setFromOptions()
        preconditioner.setType("python")
        preconditioner.setPythonContext(self)

    def release(self) -> None:
        """Frees what Python objects are in, on all processes."""
        destroy(self.inner, self.operator, self.scaled)
        self.levels.release()

    def ready(self) -> None:
        """Makes the multigrid's coarse level.

        Raises:
            SingularSystem: if a constant pressure acts on no displacement, nor on a volume.
        """
        if self.free_pressure(self.operator):
            raise SingularSystem(FREE_PRESSURE)
        self.levels.ready()

    def free_pressure(self, operator: PETSc.Mat) -> bool:
        """Whether a constant pressure does nothing under an operator (n, n), or a larger one.

        Its other unknowns come last.
        """
        constant, effect = operator.createVecs()
        pressures = self._p.spread(self._free)
        constant.array[: len(pressures)] = pressures
        operator.mult(constant, effect)
        largest = PETSc.NormType.INFINITY
        return bool(effect.norm(largest) <= NOTHING * self.elastic[0].norm(largest))

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        values = x.array_r
        self._given.setArray(values[self.displacements.owned.ravel()])
        self.inner.apply(self._given, self._found)
        self._B.mult(self._found, self._rest)
        wanted = values[self._p.owned.ravel()]
        self._rest.setArray((self._rest.array_r - wanted) * self._free)
        self._pressure.solve(self._rest, self._pressed)
        out = self.displacements.spread(self._found.array_r)
        p = np.where(self._free > 0, self._pressed.array_r, wanted)
        y.setArray(out + self._p.spread(p))


def _mass(
    displacements: fem.FunctionSpace, pressures: fem.FunctionSpace, A: PETSc.Mat, B: PETSc.Mat
) -> PETSc.Mat:
    """Mass matrix of pressures over twice the shear modulus, which A and B tell at vertices.

    A's product with linear functions is the stiffness of linear elements; B's with a unit strain,
    integrals of the vertices' functions. They have the thickness of plane bodies, and the radius.
    """
    mesh = displacements.mesh
    linear, P = linear_interpolation(displacements)
    u, v = ufl.TrialFunction(linear), ufl.TestFunction(linear)
    unit = assemble_matrix(fem.form(2 * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) * ufl.dx))
    unit.assemble()
    dim = mesh.geometry.dim
    mine, theirs = (
        matrix.getDiagonal().array_r.reshape(-1, dim).sum(axis=1)
        for matrix in (galerkin_product(A, P), unit)
    )
    q = ufl.TestFunction(pressures)
    areas = assemble_vector(fem.form(q * ufl.dx))
    areas.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    strained, volumes = B.createVecs()
    x = displacements.tabulate_dof_coordinates()[: strained.getLocalSize() // dim]
    strained.array.reshape(-1, dim)[:, -1] = x[:, dim - 1]
    B.mult(strained, volumes)
    thickness, modulus = np.abs(volumes.array_r / areas.array_r), np.abs(mine / theirs)
    weight = fem.Function(pressures)
    weight.x.array[: len(modulus)] = thickness**2 / (2 * modulus)
    weight.x.scatter_forward()
    mass = assemble_matrix(fem.form(weight * ufl.TrialFunction(pressures) * q * ufl.dx))
    mass.assemble()
    return mass


def _chebyshev(matrix: PETSc.Mat, cell: str) -> PETSc.KSP:
    """A polynomial for a mass matrix over its diagonal."""
    least, largest, degree = _MASS[cell]
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOperators(matrix)
    ksp.setType("chebyshev")
    ksp.setNormType(PETSc.KSP.NormType.NONE)
    ksp.setTolerances(max_it=degree)
    ksp.getPC().setType("jacobi")
    set_options(ksp, {"ksp_chebyshev_eigenvalues": f"{least},{largest}"})
    return ksp

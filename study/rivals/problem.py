"""A rigid parabola on an elastic half plane, or paraboloid on a half space: stated once for all.

The body is below y = 0 (in space z = 0), smooth contact is possible up to `zone`, and the far
sides have Hertz' exact displacements. Lengths over the half width of the contact, stresses over E.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from petsc4py import PETSc

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from dolfinx.mesh import Mesh, locate_entities_boundary, meshtags

from pw_elements import Spaces, assemble_vector
from study.meshes import mesh_lines
from study.meshes.solid_meshes import box
from study.model.elements import one_cut
from study.solutions.half_space import Elastic, HertzLine, HertzSphere
from study.solutions.half_space_shear import hertz_force
from study.solutions.indentation import OUTER, graded_square

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int32]
Form = Any  # of UFL, which has no types

E, NU = 1.0, 0.3
RADIUS = 1e3  # of the parabola, so large that slopes are small
ZONE = 1.3  # where nodes may touch
TOLERANCE, MOST = 1e-12, 60  # of a correction over the approach; linear systems of one solution


class NoSolution(Exception):
    """A method does not converge."""


class Answer(NamedTuple):
    """What a method gives.

    Args:
        u: displacements.
        pressure: UFL expression on the surface.
        unknowns: displacements and multipliers that are solved for.
        factorisations: of matrices of that size.
        tested: space of the test functions by which nodal forces are defined.
    """

    u: fem.Function
    pressure: Form
    unknowns: int
    factorisations: int
    tested: fem.FunctionSpace


@dataclass(frozen=True)
class Problem:
    """The problem on a mesh.

    Args:
        mesh: of triangles or tetrahedra.
        size: length of the edges that may touch.
        zone: distance up to which nodes may touch.
        outer: distance of the far sides.
        known: exact solution.
    """

    mesh: Mesh
    size: float
    zone: float
    outer: float
    known: HertzLine | HertzSphere

    @property
    def up(self) -> int:
        """The axis across the surface."""
        return int(self.mesh.geometry.dim) - 1

    @property
    def distance(self) -> Form:
        """Distance from the middle of the contact."""
        x = ufl.SpatialCoordinate(self.mesh)
        return ufl.sqrt(sum(x[i] ** 2 for i in range(self.up)))

    @property
    def gap(self) -> Form:
        """What the displacement upwards may not exceed."""
        return self.distance**2 / (2 * RADIUS) - self.known.approach

    @cached_property
    def surface(self) -> ufl.Measure:
        """Integral over the surface that may touch."""
        tags = meshtags(self.mesh, self.up, self.facets, np.ones_like(self.facets))
        rule = {"quadrature_degree": 6}
        return ufl.Measure("ds", self.mesh, subdomain_data=tags, metadata=rule)(1)

    @cached_property
    def facets(self) -> Indices:
        """Those that may touch."""
        found: Indices = locate_entities_boundary(self.mesh, self.up, self.touching)
        return found

    def touching(self, x: Array) -> Mask:
        """Whether points as columns may touch."""
        inside = np.max(x[: self.up], axis=0) < self.zone + 1e-9
        return np.asarray(np.isclose(x[self.up], 0.0) & inside)

    def stress(self, u: Form) -> Form:
        """Hooke's, in plane strain or space."""
        first, second = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
        return first * ufl.div(u) * ufl.Identity(self.up + 1) + 2 * second * ufl.sym(ufl.grad(u))

    def work(self, u: Form, v: Form) -> Form:
        """Internal virtual work."""
        return ufl.inner(self.stress(u), ufl.grad(v)) * ufl.dx

    def space(self, degree: int = 2, multiplier: int = 0) -> fem.FunctionSpace:
        """Displacements; beside them multipliers of a degree, if one is given."""
        cell = self.mesh.basix_cell()
        vector = basix.ufl.element("Lagrange", cell, degree, shape=(self.up + 1,))
        if not multiplier:
            return fem.functionspace(self.mesh, vector)
        scalar = basix.ufl.element("Lagrange", cell, multiplier)
        return fem.functionspace(
            self.mesh, basix.ufl.displacement_pressure_element([vector, scalar])
        )

    def supports(self, displacement: fem.FunctionSpace) -> list[fem.DirichletBC]:
        """Exact displacements far away, and symmetry; of a space or a part of one."""
        return [self._component(displacement.sub(axis), axis) for axis in range(self.up + 1)]

    def _component(self, sub: fem.FunctionSpace, axis: int) -> fem.DirichletBC:
        part, _ = sub.collapse()

        def held(x: Array) -> Mask:
            far = np.isclose(np.abs(x[: self.up + 1]).max(axis=0), self.outer)
            return np.asarray(far | (np.isclose(x[axis], 0.0) & (axis < self.up)))

        dofs, value = fem.locate_dofs_geometrical((sub, part), held), fem.Function(part)
        value.x.array[dofs[1]] = self.far_field(part.tabulate_dof_coordinates()[dofs[1]])[:, axis]
        return fem.dirichletbc(value, dofs, sub)

    def far_field(self, x: Array) -> Array:
        """Exact displacements (n, dim) of points (n, 3) far from the contact; 0 on symmetry."""
        if self.up == 1:
            field = self.known.displacement(x[:, :2])
            return np.where(np.isclose(x[:, :2] * [1, 0] + [0, 1], 0.0), 0.0, field)
        r = np.hypot(x[:, 0], x[:, 1])
        of_r = self.known.displacement(np.column_stack([r, x[:, 2]]))
        return np.column_stack([of_r[:, :1] * x[:, :2] / np.maximum(r, 1e-12)[:, None], of_r[:, 1]])

    def nowhere_else(self, multiplier: fem.FunctionSpace) -> fem.DirichletBC:
        """No multipliers off the surface that may touch; of a part of a space."""
        part, _ = multiplier.collapse()
        dofs = fem.locate_dofs_geometrical((multiplier, part), lambda x: ~self.touching(x))
        return fem.dirichletbc(fem.Function(part), dofs, multiplier)

    def normal(self, space: fem.FunctionSpace) -> Indices:
        """Unknowns of the displacement upwards of nodes that may touch."""
        nodes = fem.locate_dofs_geometrical(space, self.touching)
        return np.asarray(nodes * (self.up + 1) + self.up, dtype=np.int32)

    def gap_at(self, x: Array) -> Array:
        """The gap of points (n, 3)."""
        squares = (x[:, : self.up] ** 2).sum(axis=1)
        return np.asarray(squares / (2 * RADIUS) - self.known.approach)

    def answer_of(self, w: fem.Function, count: int, pressure: Form = None) -> Answer:
        """The answer of displacements and multipliers, which are the pressure if none is given."""
        u, multiplier = fem.Function(self.space()), w.sub(1).collapse()
        u.interpolate(w.sub(0))
        Q = multiplier.function_space
        unknowns = u.x.array.size + fem.locate_dofs_geometrical(Q, self.touching).size
        given = multiplier if pressure is None else pressure
        return Answer(u, given, unknowns, count, u.function_space)

    def forces(self, u: fem.Function, tested: fem.FunctionSpace) -> Array:
        """Nodal forces (n, dim) of the body on what holds it, by the test functions of a space."""
        vector = assemble_vector(self.work(u, ufl.TestFunction(tested)))
        return np.array(-vector.array.reshape(-1, self.up + 1))

    def over_weights(self, forces: Array, tested: fem.FunctionSpace) -> Array:
        """Forces upwards (n,) over the integrals of their test functions; 0 where those vanish."""
        areas = assemble_vector(ufl.TestFunction(tested)[self.up] * self.surface).array
        weights = areas.reshape(-1, self.up + 1)[:, self.up]
        has = weights > 1e-9 * weights.max()
        return np.divide(forces, weights, out=np.zeros_like(forces), where=has)

    def over_own_weights(self, u: fem.Function, tested: fem.FunctionSpace) -> fem.Function:
        """Pressure of nodal forces over the integrals of their test functions, of degree 2."""
        forces = self.forces(u, tested)[:, self.up]
        return self.joined(self.over_weights(forces, tested))

    def joined(self, values: Array) -> fem.Function:
        """Values (n,) at the nodes of quadratic elements, linear between all of a facet's nodes."""
        spaces = one_cut(self.mesh, ()) if self.up == 2 else Spaces.petrov_galerkin(self.mesh, 0)
        return function(spaces.test, values)


def line(edges: int, offset: float) -> Problem:
    """The half plane, x >= 0.

    Args:
        edges: of triangles over the half width of the contact.
        offset: where in the next one it ends, as a part of its length.
    """
    body, size = Elastic(E, NU), 1 / (edges + offset)
    known = HertzLine(body, RADIUS, np.pi * body.plane_modulus / (4 * RADIUS))
    lines = size * np.arange(np.ceil(ZONE / size) + 1)
    return Problem(graded_square(lines, OUTER, "triangle"), size, lines[-1], OUTER, known)


def sphere(edges: int, offset: float) -> Problem:
    """A quarter of the half space, on tetrahedra; arguments as of `line`."""
    body, lines = Elastic(E, NU), mesh_lines.graded(edges + offset - mesh_lines.PLACE)
    known = HertzSphere(body, RADIUS, hertz_force(body, RADIUS))
    mesh = box("tetrahedron", lines.beside, lines.beside, lines.below)
    return Problem(mesh, 1 / (edges + offset), lines.zone, mesh_lines.OUTER, known)


def function(space: fem.FunctionSpace, values: Array) -> fem.Function:
    """The function of a space with these coefficients (n,)."""
    made = fem.Function(space)
    made.x.array[:] = values
    return made


def newton(form: Form, w: fem.Function, supports: list[fem.DirichletBC]) -> int:
    """Solve form(w) = 0, and return how many factorisations that took.

    Raises:
        NoSolution: if it does not converge.
    """
    return iteration(form, w, supports)()


def iteration(form: Form, w: fem.Function, supports: list[fem.DirichletBC]) -> Callable[[], int]:
    """Return what `newton` does, for a form whose constants and other functions change."""
    residual, tangent = fem.form(form), fem.form(ufl.derivative(form, w))
    held = np.concatenate([bc.dof_indices()[0] for bc in supports])
    K, ksp = petsc.create_matrix(tangent), PETSc.KSP().create(w.function_space.mesh.comm)
    ksp.setOperators(K)
    direct(ksp)
    x, right = K.createVecs()

    def solve() -> int:
        for bc in supports:
            bc.set(w.x.array)
        for count in range(1, MOST + 1):
            right.array[:] = fem.assemble_vector(residual).array
            right.array[held] = 0.0
            K.zeroEntries()
            petsc.assemble_matrix(K, tangent, bcs=supports)
            K.assemble()
            ksp.solve(right, x)
            step = x.array_r
            w.x.array[:] -= step
            if not np.isfinite(step).all():
                break
            if np.abs(step).max() < TOLERANCE * np.abs(w.x.array).max():
                return count
        raise NoSolution

    return solve


def solved(matrix: Any, right: Array) -> Array:  # noqa: ANN401
    """Solution of a sparse system of SciPy's by MUMPS."""
    csr = matrix.tocsr()
    K = PETSc.Mat().createAIJ(csr.shape, csr=(csr.indptr, csr.indices, csr.data))
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K)
    direct(ksp)
    x, b = K.createVecs()
    b.array[:] = right
    ksp.solve(b, x)
    return np.array(x.array_r)


def direct(ksp: PETSc.KSP) -> None:
    """Have systems solved by MUMPS' factors."""
    ksp.setType("preonly")
    ksp.pc.setType("lu")
    ksp.pc.setFactorSolverType("mumps")

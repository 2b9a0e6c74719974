"""Hertz' problem for any contact method: a rigid parabola or paraboloid on an elastic body.

The body is part of the half plane y < 0 or half space z < 0. Frictionless contact is possible up to
the distance `contact_zone_size` from the middle, and Hertz' exact displacements are prescribed on
the far sides. Lengths are relative to the half width of the contact, stresses to Young's modulus.
`study.benchmarks.q_rivals` solves this problem by many methods.
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
from study.meshes.solid_meshes import mesh_box_along_lines
from study.model.elements import p1_iso_p2_weight_spaces
from study.solutions.half_space import ElasticHalfSpace, HertzLine, HertzSphere
from study.solutions.half_space_shear import force_that_gives_contact_radius_1
from study.solutions.indentation import BODY_SIZE, mesh_graded_square

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int32]
Form = Any  # UFL expressions, for which UFL provides no types

E, NU = 1.0, 0.3
RADIUS = 1e3
"""Radius of curvature of the parabola, large enough for small slopes."""
CONTACT_ZONE_SIZE = 1.3
"""Smallest distance from the middle up to which nodes may come into contact."""
NEWTON_TOLERANCE = 1e-12
"""Largest entry of the last Newton correction, relative to the largest unknown."""
MAX_SOLVES = 60
"""Largest number of linear systems that one nonlinear solution may solve."""


class NoSolution(Exception):
    """Raised if a contact method does not converge."""


class Solution(NamedTuple):
    """Solution of Hertz' problem by a contact method.

    Args:
        u: Displacements.
        pressure: Contact pressure as a UFL expression on the surface, positive in compression.
        unknowns: Number of unknown displacements and multipliers.
        factorisations: Number of factorised matrices.
        test_space: Space of the test functions with which nodal forces are defined.
    """

    u: fem.Function
    pressure: Form
    n_unknowns: int
    n_factorisations: int
    test_space: fem.FunctionSpace


@dataclass(frozen=True)
class Problem:
    """Hertz' problem on a mesh.

    Args:
        mesh: Mesh of triangles or tetrahedra.
        edge_length: Length of the element edges in the zone that may touch.
        contact_zone_size: Distance from the middle up to which nodes may come into contact.
        body_size: Distance of the far sides from the middle.
        exact: Hertz' exact solution.
    """

    mesh: Mesh
    edge_length: float
    contact_zone_size: float
    body_size: float
    exact: HertzLine | HertzSphere

    @property
    def normal_axis(self) -> int:
        """Index of the axis normal to the surface: 1 in the plane, 2 in space."""
        return int(self.mesh.geometry.dim) - 1

    @property
    def distance_from_middle(self) -> Form:
        """Distance from the middle of the contact as a UFL expression."""
        x = ufl.SpatialCoordinate(self.mesh)
        return ufl.sqrt(sum(x[i] ** 2 for i in range(self.normal_axis)))

    @property
    def gap(self) -> Form:
        """Initial gap, the upper bound of the upward displacement, as a UFL expression."""
        return self.distance_from_middle**2 / (2 * RADIUS) - self.exact.approach

    @cached_property
    def contact_measure(self) -> ufl.Measure:
        """UFL measure of the part of the surface that may come into contact."""
        tags = meshtags(
            self.mesh, self.normal_axis, self.contact_facets, np.ones_like(self.contact_facets)
        )
        rule = {"quadrature_degree": 6}
        return ufl.Measure("ds", self.mesh, subdomain_data=tags, metadata=rule)(1)

    @cached_property
    def contact_facets(self) -> Indices:
        """Indices of the boundary facets that may come into contact."""
        facets: Indices = locate_entities_boundary(self.mesh, self.normal_axis, self.may_touch)
        return facets

    def may_touch(self, x: Array) -> Mask:
        """Return a mask (n,) of the points x (3, n) that may come into contact."""
        inside = np.max(x[: self.normal_axis], axis=0) < self.contact_zone_size + 1e-9
        return np.asarray(np.isclose(x[self.normal_axis], 0.0) & inside)

    def stress(self, u: Form) -> Form:
        """Return the linear elastic stress of a displacement, in plane strain or in space."""
        lame, shear = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
        return lame * ufl.div(u) * ufl.Identity(self.normal_axis + 1) + 2 * shear * ufl.sym(
            ufl.grad(u)
        )

    def virtual_work(self, u: Form, v: Form) -> Form:
        """Return the internal virtual work of a displacement u and a virtual displacement v."""
        return ufl.inner(self.stress(u), ufl.grad(v)) * ufl.dx

    def make_space(self, degree: int = 2, multiplier_degree: int = 0) -> fem.FunctionSpace:
        """Create a displacement space, or a mixed space of displacements and scalar multipliers.

        Args:
            degree: Degree of the displacements.
            multiplier_degree: Degree of the multipliers; 0 for displacements alone.
        """
        cell = self.mesh.basix_cell()
        vector = basix.ufl.element("Lagrange", cell, degree, shape=(self.normal_axis + 1,))
        if not multiplier_degree:
            return fem.functionspace(self.mesh, vector)
        scalar = basix.ufl.element("Lagrange", cell, multiplier_degree)
        return fem.functionspace(self.mesh, basix.ufl.mixed_element([vector, scalar]))

    def far_field_supports(self, displacement: fem.FunctionSpace) -> list[fem.DirichletBC]:
        """Return symmetry conditions, and conditions of exact displacements on the far sides.

        Args:
            displacement: Displacement space, or the displacement subspace of a mixed space.
        """
        return [
            self._prescribe_component_of_exact_field(displacement.sub(axis), axis)
            for axis in range(self.normal_axis + 1)
        ]

    def _prescribe_component_of_exact_field(
        self, sub: fem.FunctionSpace, axis: int
    ) -> fem.DirichletBC:
        part, _ = sub.collapse()

        def is_on_far_side_or_symmetry_plane(x: Array) -> Mask:
            is_far = np.isclose(np.abs(x[: self.normal_axis + 1]).max(axis=0), self.body_size)
            return np.asarray(is_far | (np.isclose(x[axis], 0.0) & (axis < self.normal_axis)))

        dofs, value = (
            fem.locate_dofs_geometrical((sub, part), is_on_far_side_or_symmetry_plane),
            fem.Function(part),
        )
        x = part.tabulate_dof_coordinates()[dofs[1]]
        value.x.array[dofs[1]] = self.exact_displacement(x)[:, axis]
        return fem.dirichletbc(value, dofs, sub)

    def exact_displacement(self, x: Array) -> Array:
        """Return Hertz' exact displacements (n, dim) at points (n, 3) far from the contact."""
        if self.normal_axis == 1:
            field = self.exact.displacement(x[:, :2])
            return np.where(np.isclose(x[:, :2] * [1, 0] + [0, 1], 0.0), 0.0, field)
        r = np.hypot(x[:, 0], x[:, 1])
        u = self.exact.displacement(np.column_stack([r, x[:, 2]]))  # radial and axial
        return np.column_stack([u[:, :1] * x[:, :2] / np.maximum(r, 1e-12)[:, None], u[:, 1]])

    def zero_multipliers_outside(self, multiplier: fem.FunctionSpace) -> fem.DirichletBC:
        """Return the condition that multipliers are zero outside the zone that may touch.

        Args:
            multiplier: Multiplier subspace of a mixed space.
        """
        part, _ = multiplier.collapse()
        dofs = fem.locate_dofs_geometrical((multiplier, part), lambda x: ~self.may_touch(x))
        return fem.dirichletbc(fem.Function(part), dofs, multiplier)

    def normal_dofs_that_may_touch(self, space: fem.FunctionSpace) -> Indices:
        """Return the dofs of the normal displacements of nodes that may come into contact."""
        nodes = fem.locate_dofs_geometrical(space, self.may_touch)
        return np.asarray(nodes * (self.normal_axis + 1) + self.normal_axis, dtype=np.int32)

    def gap_at(self, x: Array) -> Array:
        """Return the initial gaps (n,) at points (n, 3)."""
        squares = (x[:, : self.normal_axis] ** 2).sum(axis=1)
        return np.asarray(squares / (2 * RADIUS) - self.exact.approach)

    def make_solution(
        self, w: fem.Function, factorisations: int, pressure: Form | None = None
    ) -> Solution:
        """Create the `Solution` from a mixed function of displacements and multipliers.

        Args:
            w: Displacements and multipliers.
            factorisations: Number of factorised matrices.
            pressure: Contact pressure; by default the multipliers.
        """
        u, multiplier = fem.Function(self.make_space()), w.sub(1).collapse()
        u.interpolate(w.sub(0))
        Q = multiplier.function_space
        unknowns = u.x.array.size + fem.locate_dofs_geometrical(Q, self.may_touch).size
        if pressure is None:
            pressure = multiplier
        return Solution(u, pressure, unknowns, factorisations, u.function_space)

    def nodal_forces(self, u: fem.Function, test_space: fem.FunctionSpace) -> Array:
        """Return nodal forces (n, dim) of the body on its surroundings for given test functions."""
        vector = assemble_vector(self.virtual_work(u, ufl.TestFunction(test_space)))
        return np.array(-vector.array.reshape(-1, self.normal_axis + 1))

    def divide_by_test_function_integrals(
        self, forces: Array, test_space: fem.FunctionSpace
    ) -> Array:
        """Divide nodal forces (n,) by the integrals of their test functions over the surface.

        The result is 0 where the integral is 0.
        """
        areas = assemble_vector(
            ufl.TestFunction(test_space)[self.normal_axis] * self.contact_measure
        ).array
        weights = areas.reshape(-1, self.normal_axis + 1)[:, self.normal_axis]
        has_weight = weights > 1e-9 * weights.max()
        return np.divide(forces, weights, out=np.zeros_like(forces), where=has_weight)

    def pressure_from_nodal_forces(
        self, u: fem.Function, test_space: fem.FunctionSpace
    ) -> fem.Function:
        """Return the pressure whose nodal values are forces over integrals of test functions.

        Args:
            u: Quadratic displacements.
            test_space: Space of the test functions.
        """
        forces = self.nodal_forces(u, test_space)[:, self.normal_axis]
        return self.interpolate_on_sub_cells(
            self.divide_by_test_function_integrals(forces, test_space)
        )

    def interpolate_on_sub_cells(self, values: Array) -> fem.Function:
        """Interpolate values (n,) at the nodes of quadratic elements linearly on sub-cells."""
        spaces = (
            p1_iso_p2_weight_spaces(self.mesh, ())
            if self.normal_axis == 2
            else Spaces.petrov_galerkin(self.mesh, 0)
        )
        return make_function(spaces.test, values)


def line_contact_problem(edges: int, offset: float) -> Problem:
    """Create Hertz' line contact problem, with a mesh of triangles for the half x >= 0.

    Args:
        edges: Number of whole element edges over the half width of the contact.
        offset: Position of the end of the contact within the next edge, as a fraction of the edge.
    """
    body, size = ElasticHalfSpace(E, NU), 1 / (edges + offset)
    exact = HertzLine(body, RADIUS, np.pi * body.plane_strain_modulus / (4 * RADIUS))
    lines = size * np.arange(np.ceil(CONTACT_ZONE_SIZE / size) + 1)
    return Problem(
        mesh_graded_square(lines, BODY_SIZE, "triangle"), size, lines[-1], BODY_SIZE, exact
    )


def make_quarter_sphere_contact_problem(edges: int, offset: float) -> Problem:
    """Create Hertz' problem of a sphere, with a mesh of tetrahedra for a quarter of the body.

    The arguments are those of `line_contact_problem`, along the contact radius.
    """
    body, lines = (
        ElasticHalfSpace(E, NU),
        mesh_lines.mesh_lines_of_body_under_sphere(
            edges + offset - mesh_lines.CONTACT_EDGE_POSITION
        ),
    )
    exact = HertzSphere(body, RADIUS, force_that_gives_contact_radius_1(body, RADIUS))
    mesh = mesh_box_along_lines("tetrahedron", lines.horizontal, lines.horizontal, lines.vertical)
    return Problem(mesh, 1 / (edges + offset), lines.contact_zone_size, mesh_lines.BODY_SIZE, exact)


def make_function(space: fem.FunctionSpace, values: Array) -> fem.Function:
    """Create a function in a space from its coefficients (n,) or a constant coefficient."""
    f = fem.Function(space)
    f.x.array[:] = values
    return f


def solve_newton(form: Form, w: fem.Function, supports: list[fem.DirichletBC]) -> int:
    """Solve form(w) = 0 by Newton's method and return the number of factorisations.

    Args:
        form: Residual as a UFL form that depends on `w`.
        w: Unknown function, which is overwritten by the solution; its value is the first iterate.
        supports: Prescribed values.

    Raises:
        NoSolution: If the iteration does not converge in `MAX_SOLVES` steps.
    """
    return prepare_newton(form, w, supports)()


def prepare_newton(
    form: Form, w: fem.Function, supports: list[fem.DirichletBC]
) -> Callable[[], int]:
    """Compile a residual and its tangent once; return a function that solves as `solve_newton`.

    The returned function has no arguments and can be called repeatedly.
    """
    residual, tangent = fem.form(form), fem.form(ufl.derivative(form, w))
    prescribed = np.concatenate([bc.dof_indices()[0] for bc in supports])
    K, ksp = petsc.create_matrix(tangent), PETSc.KSP().create(w.function_space.mesh.comm)
    ksp.setOperators(K)
    use_mumps_lu(ksp)
    correction, right = K.createVecs()

    def solve_and_count_factorisations() -> int:
        for bc in supports:
            bc.set(w.x.array)
        for count in range(1, MAX_SOLVES + 1):
            right.array[:] = fem.assemble_vector(residual).array
            right.array[prescribed] = 0.0
            K.zeroEntries()
            petsc.assemble_matrix(K, tangent, bcs=supports)
            K.assemble()
            ksp.solve(right, correction)
            step = correction.array_r
            w.x.array[:] -= step
            if not np.isfinite(step).all():
                break
            if np.abs(step).max() < NEWTON_TOLERANCE * np.abs(w.x.array).max():
                return count
        raise NoSolution

    return solve_and_count_factorisations


def solve_lu(matrix: Any, right: Array) -> Array:  # noqa: ANN401
    """Solve a linear system with a sparse SciPy matrix by LU factorisation (MUMPS)."""
    csr = matrix.tocsr()
    K = PETSc.Mat().createAIJ(csr.shape, csr=(csr.indptr, csr.indices, csr.data))
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K)
    use_mumps_lu(ksp)
    x, b = K.createVecs()
    b.array[:] = right
    ksp.solve(b, x)
    return np.array(x.array_r)


def use_mumps_lu(ksp: PETSc.KSP) -> None:
    """Set the options of a PETSc solver for an LU factorisation by MUMPS."""
    ksp.setType("preonly")
    ksp.pc.setType("lu")
    ksp.pc.setFactorSolverType("mumps")

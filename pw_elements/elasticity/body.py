"""Isotropic linear elasticity as UFL forms, with different trial and test spaces.

Equations are numbered as in the paper of Klisiński, Luo and Postek that `pw_elements` cites. The
equations of motion, Eq. (1), are div sigma + b - rho u'' = 0, with stress sigma, body force b,
density rho and displacement u. The paper misprints the sign of the last term in Eq. (1); the sign
is correct in the weak form, Eq. (2). The discretised equations are M a'' + K a = f, Eq. (9), with
nodal displacements a, and with the mass M, stiffness K and load f that the forms of `Body` define.
The accelerations have the same trial functions as the displacements, Eq. (4). UFL's gradients
replace the paper's strain matrices B, Eq. (8).

The units are the user's choice but have to be consistent, for example N, m, Pa and kg/m³.
"""

import logging
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, MeshTags
from ufl.core.expr import Expr
from ufl.domain import extract_unique_domain

from pw_elements.algebra import check_problem
from pw_elements.arrays import RealVector
from pw_elements.checks import (
    arguments,
    check_mesh,
    check_same_arguments_on_all_processes,
    format_points,
)
from pw_elements.elasticity.incompressibility import (
    SINGULAR_STIFFNESS_WARNING_AND_REMEDY,
    bulk_over_shear,
    has_only_parallelepiped_cells,
    max_bulk_over_shear_without_pressure,
)
from pw_elements.elasticity.material import Material, ScalarCoefficient
from pw_elements.progress import log_on_root
from pw_elements.spaces import (
    STRESS_STATE_METADATA_KEY,
    Spaces,
    add_sub_cell_quadrature_rules,
    check_part_tags_type,
    is_hybrid,
    read_record,
)

VectorCoefficient: TypeAlias = RealVector | Expr

# Quadrature degree for integrands that are not polynomials (hoop strain, curved cells, a varying
# modulus). The error of natural frequencies due to this quadrature is less than 1e-4 of the
# discretisation error (section V8 of the validation study, study/benchmarks)
_NON_POLYNOMIAL_QUADRATURE_DEGREE = 8
# Poisson's ratio above which `Body.from_mesh` adds a pressure, and above which a warning is logged
_MIN_POISSONS_RATIO_FOR_HYBRID_SPACES = 0.48
_MIN_POISSONS_RATIO_FOR_LOCKING_WARNING = 0.49
_LOCKING_WARNING_MESSAGE = (
    "nu = %g in displacements alone: they lock, and pressures oscillate. At 0.4999 they are some "
    "50 times less accurate than with Spaces.hybrid(mesh), on tetrahedra some 150 times"
)

_CONTINUOUS_PRESSURE_WARNING_MESSAGE = (
    "the material varies and the pressure is continuous: where the material jumps displacements "
    "err by ten per cent and more; give cell tags, Spaces.hybrid(mesh, parts)"
)

# Magnitudes up to which a value may be due to round-off: for a row sum of the mass matrix, relative
# to the diagonal entry; for a negative radius, relative to the largest radius
_LUMPED_MASS_ROUND_OFF_OVER_DIAGONAL = 1e-12
_NEGATIVE_RADIUS_ROUND_OFF_OVER_MAX_RADIUS = 1e-12


class StressState(Enum):
    """State of stress and strain of a body; `Body` also accepts the value as a string."""

    PLANE_STRESS = "plane stress"
    PLANE_STRAIN = "plane strain"
    AXISYMMETRIC = "axisymmetric"  # coordinates are (r, z), with the axis of rotation at r = 0
    SOLID = "solid"


@dataclass(frozen=True)
class Body:
    """Elastic body: its spaces, material and state of stress, and the forms of its equations.

    With the spaces of `Spaces.hybrid`, the unknowns are displacements u and a pressure p. For all
    weight functions w of u and q of p they satisfy

        int 2 mu eps(u) : eps(w) - p div w = load(w),    int -q (div u + p/lambda) = 0,

    with strain eps, Poisson's ratio nu, shear modulus mu and Lamé's constant lambda. The quotient
    1/lambda = (1 - 2 nu) / (2 mu nu) is zero for nu = 1/2. The argument `u` of `stress` then has to
    contain both fields, as a function of the mixed space does.

    Args:
        spaces: trial and test space of the displacements, or of displacements and pressure.
        material: elastic constants and density.
        state: a `StressState`, or its value as a string: "plane stress", "plane strain",
            "axisymmetric" or "solid".
        thickness: thickness of a plane body, a number or a UFL expression.
        quadrature_degree: degree of quadrature of all integrals over cells. If None, the degree
            makes integrals exact over straight simplices, parallelograms and parallelepipeds with
            constant data; it is 5 (3 points in each direction) for other straight quadrilaterals
            and hexahedra, and 8 for curved cells, axisymmetry and varying data.

    Raises:
        ValueError: if the state does not suit the dimension; if the mesh is a surface in space or
            crosses the axis of rotation; if an incompressible material, except in plane stress,
            is used without hybrid spaces; if hybrid spaces are used in plane stress or with
            nu <= 0; or if the thickness is not positive.
        DegenerateMesh: if cells are flat, inverted, folded or overlapping, or nodes are hanging.
    """

    spaces: Spaces
    material: Material
    state: StressState
    thickness: ScalarCoefficient
    quadrature_degree: int | None

    # written by hand, because the argument `state` has more types than the attribute
    @check_same_arguments_on_all_processes
    def __init__(
        self,
        spaces: Spaces,
        material: Material,
        state: StressState | str,
        thickness: ScalarCoefficient = 1.0,
        quadrature_degree: int | None = None,
    ) -> None:
        for name, value in (
            ("spaces", spaces),
            ("material", material),
            ("thickness", thickness),
            ("quadrature_degree", quadrature_degree),
        ):
            _set_frozen_attribute(self, name, value)
        arguments.check_type(
            "spaces", self.spaces, Spaces, "Spaces.petrov_galerkin(mesh) makes some"
        )
        arguments.check_type("material", self.material, Material, "Material(E, nu) makes one")
        try:
            _set_frozen_attribute(self, "state", StressState(state))
        except ValueError:
            names = ", ".join(repr(known_state.value) for known_state in StressState)
            raise ValueError(f"state {state!r}: the states are {names}") from None
        mesh = self.spaces.mesh
        dimension = mesh.geometry.dim
        if (self.state is StressState.SOLID) != (dimension == 3) or dimension == 1:
            raise ValueError(f"a {dimension}-D mesh cannot be in the state {self.state.value!r}")
        shape = self.spaces.trial.ufl_element().reference_value_shape
        hybrid = self.spaces.is_hybrid
        if shape != (dimension + hybrid,):
            raise ValueError(
                f"the values of the spaces have the shape {shape}: displacements in {dimension}-D "
                f"have {dimension} components"
            )
        check_mesh(mesh)
        if self.state is StressState.AXISYMMETRIC:
            r = mesh.geometry.x[:, 0]
            radius = mesh.comm.allreduce(r.min(initial=np.inf), MPI.MIN)
            largest_radius = mesh.comm.allreduce(np.abs(r).max(initial=0.0), MPI.MAX)
            if radius < -_NEGATIVE_RADIUS_ROUND_OFF_OVER_MAX_RADIUS * largest_radius:
                raise ValueError(f"the mesh crosses the axis of rotation: its least r is {radius}")
        nu = self.material.poissons_ratio
        if hybrid:
            if self.state is StressState.PLANE_STRESS:
                raise ValueError(
                    "hybrid spaces are of no use in plane stress, where nothing locks: use "
                    "Spaces.petrov_galerkin"
                )
            rule = "has to be positive in hybrid spaces, the pressure being -lambda div u"
            arguments.check_coefficient(
                "poissons_ratio", nu, lambda values: values > 0, rule, mesh.comm
            )
            is_constant = arguments.is_real_number(nu) and arguments.is_real_number(
                self.material.youngs_modulus
            )
            if not is_constant and self.spaces.parts is None:
                log_on_root(mesh.comm, logging.WARNING, _CONTINUOUS_PRESSURE_WARNING_MESSAGE)
        elif self.state is not StressState.PLANE_STRESS:
            rule = "in plane stress only may it be 0.5, or in the spaces of Spaces.hybrid(mesh)"
            arguments.check_coefficient(
                "poissons_ratio", nu, lambda values: values < 0.5, rule, mesh.comm
            )
            max_nu = _max_value(nu, mesh.comm)
            warnings = [self._singular_stiffness_warning(max_nu)]
            if max_nu > _MIN_POISSONS_RATIO_FOR_LOCKING_WARNING:
                warnings.insert(0, _LOCKING_WARNING_MESSAGE % max_nu)
            if warning := ". ".join(filter(None, warnings)):
                log_on_root(mesh.comm, logging.WARNING, warning)
        thickness = arguments.check_positive_coefficient("thickness", self.thickness, mesh.comm)
        _set_frozen_attribute(self, "thickness", thickness)
        if self.quadrature_degree is not None:
            arguments.check_integer("quadrature_degree", self.quadrature_degree, 0)

    @classmethod
    @check_same_arguments_on_all_processes
    def from_mesh(
        cls, mesh: Mesh, material: Material, state: StressState | str, parts: MeshTags | None = None
    ) -> "Body":
        """Create a body with the element that its material needs.

        If Poisson's ratio exceeds 0.48 anywhere and the state is not plane stress, the body gets
        the spaces of `Spaces.hybrid`, and the log says so. Otherwise it gets the spaces of
        `Spaces.petrov_galerkin`.

            body = Body.from_mesh(mesh, Material(1e6, 0.499), "axisymmetric")
            U = body.spaces.trial

        Args:
            mesh: mesh of the body.
            material: elastic constants and density.
            state: state of stress, as in `Body`.
            parts: tags of all cells, one tag for each material. They are used only if the spaces
                are hybrid, see `Spaces.hybrid`.

        Raises:
            TypeError: for arguments of the wrong type.
            ValueError: in the same cases as `Body`.
        """
        arguments.check_double_precision_mesh(mesh)
        arguments.check_type("material", material, Material, "Material(E, nu) makes one")
        check_part_tags_type(parts)
        max_nu = _max_value(material.poissons_ratio, mesh.comm)
        is_valid = isinstance(state, str | StressState)  # other objects may not be comparable
        plane_stress_names = StressState.PLANE_STRESS, StressState.PLANE_STRESS.value
        is_plane_stress = is_valid and state in plane_stress_names
        if max_nu <= _MIN_POISSONS_RATIO_FOR_HYBRID_SPACES or is_plane_stress:
            spaces = Spaces.petrov_galerkin(mesh)
        else:
            spaces = Spaces.hybrid(mesh, parts)
            words = f"hybrid: nu = {max_nu:g}, displacements alone would lock"
            log_on_root(mesh.comm, logging.INFO, words)
        return cls(spaces, material, state)

    def _singular_stiffness_warning(self, nu: float) -> str:
        """Return a warning if the stiffness may be singular for this Poisson's ratio, else ""."""
        limit, ratio = max_bulk_over_shear_without_pressure(self.spaces.mesh), bulk_over_shear(nu)
        if self.spaces.test is self.spaces.trial or ratio <= limit:
            return ""
        return (
            f"The bulk modulus is {ratio:.3g} times the shear modulus, more than {limit:g}. "
            f"With piecewise-linear weights on these cells {SINGULAR_STIFFNESS_WARNING_AND_REMEDY}"
        )

    def strain(self, u: Expr) -> Expr:
        """Return the tensor of small strains, Eq. (5).

        In axisymmetry it is 3 x 3 and contains the hoop strain u_r / r.

        Args:
            u: displacement, a function or an argument of a form. In hybrid spaces it may contain
                both displacement and pressure.

        Raises:
            TypeError: if `u` is not a UFL expression.
        """
        arguments.check_type(
            "displacement", u, Expr, "as_function(U, a) makes a function of a vector"
        )
        return ufl.sym(self._displacement_gradient(u))

    def stress(self, u: Expr) -> Expr:
        """Return the stress tensor, Eq. (6) and Eq. (22), of the same shape as the strain tensor.

        Args:
            u: displacement, a function or an argument of a form. In hybrid spaces it contains both
                displacement and pressure.

        Raises:
            ValueError: if the spaces are hybrid, but `u` has no pressure.
        """
        E, nu = (
            self._as_constant(self.material.youngs_modulus),
            self._as_constant(self.material.poissons_ratio),
        )
        mu = E / (2 * (1 + nu))
        if self.spaces.is_hybrid:
            strain, (_, p) = self.strain(u), self._split_displacement_and_pressure(u)
            if p is None:
                raise ValueError(
                    "stresses of hybrid spaces need the pressure, too: give both fields, "
                    "as_function(body.spaces.trial, a) of the whole vector"
                )
            return 2 * mu * strain - p * ufl.Identity(strain.ufl_shape[0])
        if self.state is StressState.PLANE_STRESS:
            lame = E * nu / (1 - nu**2)
        else:
            lame = E * nu / ((1 + nu) * (1 - 2 * nu))
        strain = self.strain(u)
        return lame * ufl.tr(strain) * ufl.Identity(strain.ufl_shape[0]) + 2 * mu * strain

    def von_mises(self, u: Expr) -> Expr:
        """Return von Mises' equivalent stress as an expression, to be drawn or evaluated.

        In plane strain it includes the stress perpendicular to the plane.

        Args:
            u: displacement, a function. In hybrid spaces it contains both displacement and
                pressure.
        """
        stress = self.stress(u)
        trace, squares = ufl.tr(stress), ufl.inner(stress, stress)
        if self.state is StressState.PLANE_STRAIN:
            _, p = self._split_displacement_and_pressure(u)
            out_of_plane = (
                self._as_constant(self.material.poissons_ratio) * trace if p is None else -p
            )
            trace, squares = trace + out_of_plane, squares + out_of_plane**2
        return ufl.sqrt((3 * squares - trace**2) / 2)

    @check_same_arguments_on_all_processes
    def stiffness(self) -> ufl.Form:
        """Return the bilinear form of the stiffness matrix, Eq. (10)."""
        u, v = self._trial_and_test_functions()
        work = self._integrate_trial_times_test(ufl.inner(self.stress(u), self.strain(v)), 2)
        if not self.spaces.is_hybrid:
            return work
        E, nu = (
            self._as_constant(self.material.youngs_modulus),
            self._as_constant(self.material.poissons_ratio),
        )
        flexibility = (1 + nu) * (1 - 2 * nu) / (E * nu)
        (_, p), (_, q) = (
            self._split_displacement_and_pressure(u),
            self._split_displacement_and_pressure(v),
        )
        volume = ufl.tr(self.strain(u)) + flexibility * p
        return work + self._integrate_over_body(-q * volume, 2)

    @check_same_arguments_on_all_processes
    def mass(self) -> ufl.Form:
        """Return the bilinear form of the consistent mass matrix, Eq. (11)."""
        (u, _), (v, _) = map(
            self._split_displacement_and_pressure, self._trial_and_test_functions()
        )
        return self._integrate_trial_times_test(
            self._as_constant(self.material.density) * ufl.inner(u, v), 4
        )

    @check_same_arguments_on_all_processes
    def surface_load(self, traction: VectorCoefficient, surface: ufl.Measure) -> ufl.Form:
        """Return the linear form of the load by a traction on a part of the boundary, Eq. (12).

        A form may contain one surface measure only. For several loads, assemble a vector of each
        form and add the vectors.

        Args:
            traction: force per area (dim,), as numbers or an expression.
            surface: measure of the part of the boundary, created by `boundary_measure`.

        Raises:
            TypeError, ValueError: if `surface` is not a measure of exterior facets of the body's
                mesh, or the traction has the wrong size.
        """
        arguments.check_type(
            "surface", surface, ufl.Measure, "boundary_measure(mesh, where) makes one"
        )
        if surface.integral_type() != "exterior_facet":
            raise ValueError(
                f"the measure is one of {surface.integral_type()}s: boundary_measure makes the "
                "exterior facets' that a surface load needs"
            )
        if surface.ufl_domain() not in (None, self.spaces.mesh.ufl_domain()):
            raise ValueError("the measure is one of another mesh: make it on the body's")
        v, _ = self._split_displacement_and_pressure(ufl.TestFunction(self.spaces.test))
        work = ufl.inner(self._as_vector("traction", traction), v) * self._out_of_plane_depth()
        return work * self._add_stress_state_metadata(surface)

    @check_same_arguments_on_all_processes
    def body_load(self, force: VectorCoefficient) -> ufl.Form:
        """Return the linear form of the load by a body force, Eq. (12).

        Args:
            force: force per volume (dim,), as numbers or an expression.
        """
        v, _ = self._split_displacement_and_pressure(ufl.TestFunction(self.spaces.test))
        return self._integrate_over_body(ufl.inner(self._as_vector("force", force), v), 2)

    @check_same_arguments_on_all_processes
    def geometric_stiffness(self, stress: Expr, form: Literal["G", "J"] = "G") -> ufl.Form:
        """Return the bilinear form of the initial stress matrix, Eq. (25) and Eq. (26).

        Args:
            stress: tensor S of the prestress, such as `body.stress(u)`. It has the shape of the
                strain tensor.
            form: choice of the integrand. "G" is the paper's integrand grad(v) : grad(u) S, with
                displacement u and weight function v. "J" subtracts 2 S : (eps(v) eps(u)) from it,
                with the strain eps, and corresponds to continuum elements with an objective stress
                rate.

        Raises:
            ValueError: if the form is unknown or the tensor has the wrong shape.
        """
        arguments.check_type("stress", stress, Expr, "body.stress(u) makes one")
        u, v = self._trial_and_test_functions()
        if stress.ufl_shape != (shape := self.strain(u).ufl_shape):
            raise ValueError(f"stress has the shape {stress.ufl_shape}: the strain's is {shape}")
        if not arguments.is_one_of(form, ("G", "J")):
            raise ValueError(f"geometric stiffness {form!r}: the forms are 'G' and 'J'")
        integrand = ufl.inner(
            ufl.dot(self._displacement_gradient(u), stress), self._displacement_gradient(v)
        )
        if form == "J":
            integrand -= 2 * ufl.inner(stress, ufl.dot(self.strain(v), self.strain(u)))
        return self._integrate_trial_times_test(integrand, 3, parallelepiped_degree=5)

    def _trial_and_test_functions(self) -> tuple[Expr, Expr]:
        return ufl.TrialFunction(self.spaces.trial), ufl.TestFunction(self.spaces.test)

    def _split_displacement_and_pressure(self, u: Expr) -> tuple[Expr, Expr]:
        """Split `u` into displacement and pressure; the pressure is None if `u` has none."""
        dimension = self.spaces.mesh.geometry.dim
        if not (self.spaces.is_hybrid and u.ufl_shape == (dimension + 1,)):
            return u, None
        return ufl.as_vector([u[k] for k in range(dimension)]), u[dimension]

    def _displacement_gradient(self, u: Expr) -> Expr:
        u, _ = self._split_displacement_and_pressure(u)
        dim = self.spaces.mesh.geometry.dim
        if u.ufl_shape != (dim,):
            raise ValueError(
                f"the displacement has the shape {u.ufl_shape}: a vector in {dim}-D has ({dim},)"
            )
        if extract_unique_domain(u) != self.spaces.mesh.ufl_domain():
            raise ValueError("the displacement does not belong to the body's mesh")
        grad = ufl.grad(u)
        if self.state is not StressState.AXISYMMETRIC:
            return grad
        hoop = u[0] / ufl.SpatialCoordinate(self.spaces.mesh)[0]
        return ufl.as_tensor(
            [[grad[0, 0], grad[0, 1], 0], [grad[1, 0], grad[1, 1], 0], [0, 0, hoop]]
        )

    def _out_of_plane_depth(self) -> ScalarCoefficient:
        """Return the volume per area of a plane mesh (thickness or 2 pi r); 1 for a solid."""
        if self.state is StressState.AXISYMMETRIC:
            return 2 * np.pi * ufl.SpatialCoordinate(self.spaces.mesh)[0]
        if self.state is StressState.SOLID:
            return 1.0
        return self._as_constant(self.thickness)

    def _integrate_trial_times_test(
        self, integrand: Expr, galerkin_simplex_degree: int, parallelepiped_degree: int = 3
    ) -> ufl.Form:
        """Return the form of a product of trial and test functions, integrated over the body.

        Args:
            integrand: integrand of the form.
            galerkin_simplex_degree: degree of the integrand on straight simplices with quadratic
                test functions. With piecewise-linear test functions it is one less.
            parallelepiped_degree: degree of quadrature on parallelograms and parallelepipeds with
                piecewise-linear test functions.
        """
        if self.spaces.test is self.spaces.trial:
            return self._integrate_over_body(integrand, galerkin_simplex_degree)
        return self._integrate_over_body(
            integrand, galerkin_simplex_degree - 1, parallelepiped_degree
        )

    def _integrate_over_body(
        self, integrand: Expr, simplex_degree: int, parallelepiped_degree: int = 5
    ) -> ufl.Form:
        """Return the form of an integrand, with the degree of quadrature that the cells need.

        Args:
            integrand: integrand of the form.
            simplex_degree: degree of the integrand on straight simplices.
            parallelepiped_degree: degree of quadrature on parallelograms and parallelepipeds.
        """
        degree = self.quadrature_degree
        if degree is None:
            degree = self._default_quadrature_degree(simplex_degree, parallelepiped_degree)
        dx = ufl.Measure("dx", self.spaces.mesh, metadata={"quadrature_degree": degree})
        return add_sub_cell_quadrature_rules(
            integrand * self._out_of_plane_depth() * self._add_stress_state_metadata(dx)
        )

    def _add_stress_state_metadata(self, measure: ufl.Measure) -> ufl.Measure:
        return measure.reconstruct(
            metadata={**measure.metadata(), STRESS_STATE_METADATA_KEY: self.state.value}
        )

    def _default_quadrature_degree(self, simplex_degree: int, parallelepiped_degree: int) -> int:
        geometry = self.spaces.mesh.ufl_domain().ufl_coordinate_element()
        data = (*vars(self.material).values(), self.thickness)
        is_curved = geometry.degree > 1
        if (
            is_curved
            or self.state is StressState.AXISYMMETRIC
            or not all(map(_is_constant_in_each_cell, data))
        ):
            return _NON_POLYNOMIAL_QUADRATURE_DEGREE
        if self.spaces.mesh.topology.cell_name() in ("interval", "triangle", "tetrahedron"):
            return simplex_degree
        return parallelepiped_degree if has_only_parallelepiped_cells(self.spaces.mesh) else 5

    def _as_constant(self, value: ScalarCoefficient) -> Expr:
        """Turn a number into a `fem.Constant`: a form is not compiled again for other numbers."""
        if not arguments.is_real_number(value):
            return value
        return fem.Constant(self.spaces.mesh, float(value))

    def _as_vector(self, name: str, value: VectorCoefficient) -> Expr:
        mesh = self.spaces.mesh
        vector = arguments.check_vector_or_expression(name, value, mesh.geometry.dim)
        return vector if isinstance(vector, Expr) else fem.Constant(mesh, vector)


@check_same_arguments_on_all_processes
def lumped_mass(M: PETSc.Mat, space: fem.FunctionSpace) -> PETSc.Mat:
    """Lump a mass matrix: return the diagonal matrix (n, n) of its row sums.

    Each row sum is the integral of density times a test function. With piecewise-linear weight
    functions it is positive. For density 1, it is A/12 at vertices and A/4 at mid-side nodes of a
    6-node triangle of area A, and V/32 at vertices and 7V/48 at mid-side nodes of a 10-node
    tetrahedron of volume V. On the standard 6-node triangle it is zero at the vertices.

    In explicit dynamics, combine the lumped mass with a symmetric stiffness, preferably that of
    `Sibling`, whose mass matrix has positive row sums, too. With the unsymmetric stiffness of
    piecewise-linear weight functions the upper eigenvalues are complex, and undamped vibrations
    grow for any time step (section V9 of the validation study, study/benchmarks).

    Args:
        M: mass matrix (n, n) without boundary conditions.
        space: trial space of the matrix.

    Raises:
        ValueError: if a row sum is not positive (the message names the nodes), or the matrix does
            not belong to the space.
    """
    arguments.check_function_space(space)
    check_problem({"the mass matrix": M}, space=space)
    if is_hybrid(space):
        raise ValueError("a pressure has no mass: lump that of Spaces.petrov_galerkin(mesh)")
    mass = M.getRowSum()
    lacks_mass = mass.array_r <= _LUMPED_MASS_ROUND_OFF_OVER_DIAGONAL * M.getDiagonal().array_r
    nodes = np.unique(np.flatnonzero(lacks_mass) // space.dofmap.index_map_bs)
    if count := space.mesh.comm.allreduce(len(nodes), MPI.SUM):
        positions = space.mesh.comm.allgather(space.tabulate_dof_coordinates()[nodes[:3]])
        examples = format_points(np.concatenate(positions)[:3])
        raise ValueError(
            f"{count} nodes have no positive lumped mass, among them those at {examples}: row sums "
            "serve piecewise-linear weights"
        )
    lumped = PETSc.Mat().createAIJ(M.getSizes(), nnz=1, comm=M.comm)
    lumped.setDiagonal(mass)
    lumped.assemble()
    return replace(read_record(M), lumped=True).attach(lumped)


def _is_constant_in_each_cell(value: ScalarCoefficient) -> bool:
    if isinstance(value, fem.Function):
        return value.function_space.ufl_element().embedded_superdegree == 0
    return arguments.is_real_number(value) or isinstance(value, fem.Constant)


def _max_value(coefficient: ScalarCoefficient, comm: MPI.Comm) -> float:
    values = arguments.coefficient_values_if_available(coefficient)
    return float(comm.allreduce(values.max(initial=-np.inf), MPI.MAX))


def _set_frozen_attribute(instance: object, name: str, value: object) -> None:
    object.__setattr__(instance, name, value)

"""Isotropic linear elasticity as UFL forms over a trial/test pair.

The equations of motion, Eq. (1), are div sigma + b - rho u'' = 0; the paper misprints the last
sign, which its Eq. (2) has right. In weak form, Eq. (2), they are M a'' + K a = f, Eq. (9), with
the forms of `Body`; accelerations are a field like displacements, Eq. (4), and UFL's gradients
take the place of the matrices B, of shape functions, and of Eq. (8), of weight functions.

Units are consistent ones of the user's choice (N, m, Pa, kg/m³ throughout, say).
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh, MeshTags, meshtags
from ufl.core.expr import Expr
from ufl.domain import extract_unique_domain

from pw_elements.algebra import check_problem
from pw_elements.arrays import Array
from pw_elements.checks import (
    arguments,
    check_mesh,
    check_same_arguments,
    defer_errors_if_parallel,
    format_points,
)
from pw_elements.elasticity.incompressibility import (
    HYBRID_SPACES_REMEDY,
    bulk_over_shear,
    has_parallel_cells,
    max_bulk_over_shear,
)
from pw_elements.progress import log_on_root
from pw_elements.spaces import (
    STRESS_STATE_KEY,
    AssemblyRecord,
    Marker,
    Part,
    Spaces,
    SubSpace,
    add_sub_cell_rules,
    check_part_tags,
    is_hybrid,
    locate_any_nodes,
    locate_exterior_facets,
    piecewise_constants_by_tag,
)

Scalar: TypeAlias = float | Expr
Vector: TypeAlias = Sequence[float] | Array | Expr

# Degree for integrands that are no polynomials (hoop strain, curved cells, a varying modulus): its
# error of natural frequencies is below 1e-4 of the mesh's own, see section V8 of the study
_RATIONAL_DEGREE = 8
# Poisson's ratio above which `Body.on` adds a pressure, and above which displacements alone lock
_HYBRID_NU = 0.48
_LOCKING_NU = 0.49
_LOCKS = (
    "nu = %g in displacements alone: they lock, and pressures oscillate. At 0.4999 they are some "
    "50 times less accurate than with Spaces.hybrid(mesh), on tetrahedra some 150 times"
)

_JUMPS = (
    "the material varies and the pressure is continuous: where the material jumps displacements "
    "err by ten per cent and more; give cell tags, Spaces.hybrid(mesh, parts)"
)

# A row sum of the mass matrix below this, over its diagonal entry, is zero
_ZERO_MASS = 1e-12


class StressState(Enum):
    """State of stress and strain of a body: each may be given by its value, a string."""

    PLANE_STRESS = "plane stress"
    PLANE_STRAIN = "plane strain"
    AXISYMMETRIC = "axisymmetric"  # coordinates (r, z), the axis at r = 0
    SOLID = "solid"


@dataclass(frozen=True)
class Material:
    """Isotropic elastic material: numbers, or UFL expressions where it varies in space.

        steel = Material(210e3, 0.3, 7.85e-9)  # N, mm, t, s

    `by_tag` combines several materials in one mesh, of one body or of several. Numbers,
    `fem.Constant`s and nodal values of Lagrange functions are checked; other expressions cannot be.

    Args:
        youngs_modulus: E, positive, a stress.
        poissons_ratio: nu, above -1 and at most 1/2, which plane stress and hybrid spaces allow.
        density: positive, mass per volume.

    Raises:
        ValueError: for a modulus or density that is not positive, or nu outside (-1, 1/2].
    """

    youngs_modulus: Scalar
    poissons_ratio: Scalar = 0.0
    density: Scalar = 1.0

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        for name in ("youngs_modulus", "density"):
            _set(self, name, arguments.check_positive_coefficient(name, getattr(self, name)))
        nu = arguments.check_coefficient(
            "poissons_ratio",
            self.poissons_ratio,
            lambda values: (values > -1) & (values <= 0.5),
            "has to lie between -1 and 0.5",
        )
        _set(self, "poissons_ratio", nu)

    @classmethod
    @check_same_arguments
    def by_tag(
        cls, mesh: Mesh, cell_tags: MeshTags, materials: Mapping[int, "Material"]
    ) -> "Material":
        """Combines several materials, each in the cells with its tag.

            material = Material.by_tag(mesh, cell_tags, {1: Material(210e3, 0.3), 2: rubber})

        Args:
            mesh: of the body.
            cell_tags: tags of all of its cells.
            materials: by tag; their constants are numbers.

        Raises:
            TypeError: for arguments of the wrong type.
            ValueError: for tags of facets or of another mesh, cells without a tag, tags without a
                material, materials without a cell, or constants that are not numbers.
        """
        arguments.check_mesh_type(mesh)
        arguments.check_type(
            "the mapping of tags", materials, Mapping, "give {tag: Material(E, nu), ...}"
        )
        constants = {}
        for tag, one in materials.items():
            of = f"the material of tag {tag}"
            arguments.check_type(of, one, Material, "Material(E, nu) makes one")
            numbers = vars(one).items()
            constants[tag] = [
                arguments.check_number(f"{name} of {of}", value) for name, value in numbers
            ]
        return cls(*piecewise_constants_by_tag(mesh, cell_tags, constants))


@dataclass(frozen=True)
class Body:
    """An elastic body: spaces, material, state of stress, and the forms that they make.

    With the spaces of `Spaces.hybrid` the forms are those of displacements and a pressure p,

        int 2 mu eps(u) : eps(w) - p div w = load(w),    int -q (div u + p/lambda) = 0,

    where 1/lambda = (1 - 2 nu) / (2 mu nu) is zero for nu = 1/2. In `strain` and `stress`, `u` then
    stands for both fields, such as a function of the mixed space.

    Args:
        spaces: trial and test space of the displacements, or of displacements and pressure.
        material: elastic constants and density.
        state: a `StressState`, or its value as a string: "plane stress", "plane strain",
            "axisymmetric" or "solid".
        thickness: t(x, y) of a plane body, number or UFL expression.
        quadrature_degree: by default exact for straight simplices, parallelograms and
            parallelepipeds with constant data; 5 (3 points in each direction) for other straight
            quadrilaterals and hexahedra; 8 for curved cells, axisymmetry and varying data.

    Raises:
        ValueError: if the state does not suit the dimension; the mesh is a surface in space or
            crosses the axis of rotation; an incompressible material is neither in plane stress
            nor in hybrid spaces; hybrid spaces are in plane stress or have nu <= 0; or the
            thickness is not positive.
        DegenerateMesh: if the cells or the boundary are not those of a body.
    """

    spaces: Spaces
    material: Material
    state: StressState
    thickness: Scalar = 1.0
    quadrature_degree: int | None = None

    @check_same_arguments
    def __post_init__(self) -> None:
        arguments.check_type(
            "spaces", self.spaces, Spaces, "Spaces.petrov_galerkin(mesh) makes some"
        )
        arguments.check_type("material", self.material, Material, "Material(E, nu) makes one")
        try:
            _set(self, "state", StressState(self.state))
        except ValueError:
            names = ", ".join(repr(state.value) for state in StressState)
            raise ValueError(f"state {self.state!r}: the states are {names}") from None
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
            size = mesh.comm.allreduce(np.abs(r).max(initial=0.0), MPI.MAX)
            if radius < -_ZERO_MASS * size:
                raise ValueError(f"the mesh crosses the axis of rotation: its least r is {radius}")
        nu = self.material.poissons_ratio
        if hybrid:
            if self.state is StressState.PLANE_STRESS:
                raise ValueError(
                    "hybrid spaces are of no use in plane stress, where nothing locks: use "
                    "Spaces.petrov_galerkin"
                )
            below = "has to be positive in hybrid spaces, the pressure being -lambda div u"
            arguments.check_coefficient(
                "poissons_ratio", nu, lambda values: values > 0, below, mesh.comm
            )
            varies = not (
                arguments.is_number(nu) and arguments.is_number(self.material.youngs_modulus)
            )
            if varies and self.spaces.parts is None:
                log_on_root(mesh.comm, logging.WARNING, _JUMPS)
        elif self.state is not StressState.PLANE_STRESS:
            above = "in plane stress only may it be 0.5, or in the spaces of Spaces.hybrid(mesh)"
            arguments.check_coefficient(
                "poissons_ratio", nu, lambda values: values < 0.5, above, mesh.comm
            )
            largest = _largest(nu, mesh.comm)
            if largest > _LOCKING_NU:
                log_on_root(mesh.comm, logging.WARNING, _LOCKS % largest + self._loss(largest))
        thickness = arguments.check_positive_coefficient("thickness", self.thickness, mesh.comm)
        _set(self, "thickness", thickness)
        if self.quadrature_degree is not None:
            arguments.check_integer("quadrature_degree", self.quadrature_degree, 0)

    @classmethod
    @check_same_arguments
    def on(
        cls, mesh: Mesh, material: Material, state: StressState | str, parts: MeshTags | None = None
    ) -> "Body":
        """Makes a body with the element that its material needs.

        That is `Spaces.hybrid` if Poisson's ratio exceeds 0.48 anywhere (this is logged), and
        `Spaces.petrov_galerkin` otherwise, and always in plane stress.

            body = Body.on(mesh, Material(1e6, 0.499), "axisymmetric")
            U = body.spaces.trial

        Args:
            mesh: of the body.
            material: constants and density.
            state: as of `Body`.
            parts: tags of all cells, one for each material of a hybrid body, see `Spaces.hybrid`.

        Raises:
            TypeError: for arguments of the wrong type.
            ValueError: as `Body`.
        """
        arguments.check_mesh_type(mesh)
        arguments.check_type("material", material, Material, "Material(E, nu) makes one")
        check_part_tags(parts)
        largest = _largest(material.poissons_ratio, mesh.comm)
        named = isinstance(state, str | StressState)  # other things may refuse to be compared
        stresses = StressState.PLANE_STRESS, StressState.PLANE_STRESS.value
        plane_stress = named and state in stresses
        if largest <= _HYBRID_NU or plane_stress:
            spaces = Spaces.petrov_galerkin(mesh)
        else:
            spaces = Spaces.hybrid(mesh, parts)
            words = f"hybrid: nu = {largest:g}, displacements alone would lock"
            log_on_root(mesh.comm, logging.INFO, words)
        return cls(spaces, material, state)  # type: ignore[arg-type]

    def _loss(self, nu: float) -> str:
        """Return what to say if the stiffness may be singular at a ratio nu, else nothing."""
        limit, ratio = max_bulk_over_shear(self.spaces.mesh), bulk_over_shear(nu)
        if self.spaces.test is self.spaces.trial or ratio <= limit:
            return ""
        return (
            f". The bulk modulus is {ratio:.3g} times the shear modulus, more than {limit:g}. "
            f"With piecewise-linear weights on these cells {HYBRID_SPACES_REMEDY}"
        )

    def strain(self, u: Expr) -> Expr:
        """Small strain tensor, Eq. (5); in axisymmetry 3 x 3 with the hoop strain u_r / r.

        Args:
            u: displacement, a function or an argument of a form; of hybrid spaces both fields.

        Raises:
            TypeError: for anything but such an expression.
        """
        arguments.check_type(
            "displacement", u, Expr, "as_function(U, a) makes a function of a vector"
        )
        return ufl.sym(self._gradient(u))

    def stress(self, u: Expr) -> Expr:
        """Stress tensor, Eq. (6) and Eq. (22), of the strain tensor's shape.

        Args:
            u: displacement, a function or an argument of a form; of hybrid spaces both fields.

        Raises:
            ValueError: for a displacement alone of hybrid spaces.
        """
        E, nu = self._value(self.material.youngs_modulus), self._value(self.material.poissons_ratio)
        mu = E / (2 * (1 + nu))
        if self.spaces.is_hybrid:
            strain, (_, p) = self.strain(u), self._split(u)
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
        """Von Mises' equivalent stress of displacements u, for pictures and assessment.

        In plane strain the out-of-plane stress is included.

        Args:
            u: displacement, a function; of hybrid spaces both fields.
        """
        stress = self.stress(u)
        trace, squares = ufl.tr(stress), ufl.inner(stress, stress)
        if self.state is StressState.PLANE_STRAIN:
            _, p = self._split(u)
            third = self._value(self.material.poissons_ratio) * trace if p is None else -p
            trace, squares = trace + third, squares + third**2
        return ufl.sqrt((3 * squares - trace**2) / 2)

    @check_same_arguments
    def stiffness(self) -> ufl.Form:
        """The bilinear form of the stiffness, Eq. (10)."""
        u, v = self._arguments()
        work = self._bilinear(ufl.inner(self.stress(u), self.strain(v)), 2)
        if not self.spaces.is_hybrid:
            return work
        E, nu = self._value(self.material.youngs_modulus), self._value(self.material.poissons_ratio)
        flexibility = (1 + nu) * (1 - 2 * nu) / (E * nu)
        (_, p), (_, q) = self._split(u), self._split(v)
        volume = ufl.tr(self.strain(u)) + flexibility * p
        return work + self._integral(-q * volume, 2)

    @check_same_arguments
    def mass(self) -> ufl.Form:
        """The bilinear form of the consistent mass, Eq. (11)."""
        (u, _), (v, _) = map(self._split, self._arguments())
        return self._bilinear(self._value(self.material.density) * ufl.inner(u, v), 4)

    @check_same_arguments
    def surface_load(self, traction: Vector, surface: ufl.Measure) -> ufl.Form:
        """Load of a traction vector (force per area), Eq. (12), over a `boundary_measure`.

        Loads of several measures are added as vectors; a form may have one of them.

        Args:
            traction: (dim,), numbers or an expression.
            surface: measure of a part of the boundary.

        Raises:
            TypeError, ValueError: for anything but a measure of exterior facets of the body's mesh,
                or a traction of the wrong size.
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
        v, _ = self._split(ufl.TestFunction(self.spaces.test))
        return (
            ufl.inner(self._vector("traction", traction), v) * self._depth() * self._stated(surface)
        )

    @check_same_arguments
    def body_load(self, force: Vector) -> ufl.Form:
        """Load of a body force vector (force per volume), Eq. (12).

        Args:
            force: (dim,), numbers or an expression.
        """
        v, _ = self._split(ufl.TestFunction(self.spaces.test))
        return self._integral(ufl.inner(self._vector("force", force), v), 2)

    @check_same_arguments
    def initial_stress(self, stress: Expr, form: Literal["G", "J"] = "G") -> ufl.Form:
        """Initial stress form, Eq. (25) and Eq. (26), for a prestress tensor.

        Args:
            stress: tensor of the strain's shape, e.g. `body.stress(prestress_displacement)`.
            form: "G" is the paper's, grad(v) : grad(u) S; "J" subtracts 2 S : (eps(v) eps(u)), as
                continuum elements with an objective stress rate do.

        Raises:
            ValueError: for an unknown form, or a tensor of the wrong shape.
        """
        arguments.check_type("stress", stress, Expr, "body.stress(u) makes one")
        u, v = self._arguments()
        if stress.ufl_shape != (shape := self.strain(u).ufl_shape):
            raise ValueError(f"stress has the shape {stress.ufl_shape}: the strain's is {shape}")
        if not arguments.is_one_of(form, ("G", "J")):
            raise ValueError(f"geometric stiffness {form!r}: the forms are 'G' and 'J'")
        integrand = ufl.inner(ufl.dot(self._gradient(u), stress), self._gradient(v))
        if form == "J":
            integrand -= 2 * ufl.inner(stress, ufl.dot(self.strain(v), self.strain(u)))
        return self._bilinear(integrand, 3, in_box=5)

    def _arguments(self) -> tuple[Expr, Expr]:
        return ufl.TrialFunction(self.spaces.trial), ufl.TestFunction(self.spaces.test)

    def _split(self, u: Expr) -> tuple[Expr, Expr]:
        """Displacement, and pressure: None of one field, or a displacement alone."""
        dimension = self.spaces.mesh.geometry.dim
        if not (self.spaces.is_hybrid and u.ufl_shape == (dimension + 1,)):
            return u, None
        return ufl.as_vector([u[k] for k in range(dimension)]), u[dimension]

    def _gradient(self, u: Expr) -> Expr:
        u, _ = self._split(u)
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

    def _depth(self) -> Scalar:
        """The factor that makes a volume of an area of the mesh."""
        if self.state is StressState.AXISYMMETRIC:
            return 2 * np.pi * ufl.SpatialCoordinate(self.spaces.mesh)[0]
        if self.state is StressState.SOLID:
            return 1.0
        return self._value(self.thickness)

    def _bilinear(self, integrand: Expr, exact_degree: int, in_box: int = 3) -> ufl.Form:
        """Integrates a product of trial and test functions; linear weights take a degree less."""
        if self.spaces.test is self.spaces.trial:
            return self._integral(integrand, exact_degree)
        return self._integral(integrand, exact_degree - 1, in_box)

    def _integral(self, integrand: Expr, exact_degree: int, in_box: int = 5) -> ufl.Form:
        """Integrates a form whose degree on a straight simplex, and in a box if odd, is known."""
        degree = self.quadrature_degree
        if degree is None:
            degree = self._sufficient_degree(exact_degree, in_box)
        dx = ufl.Measure("dx", self.spaces.mesh, metadata={"quadrature_degree": degree})
        return add_sub_cell_rules(integrand * self._depth() * self._stated(dx))

    def _stated(self, measure: ufl.Measure) -> ufl.Measure:
        return measure.reconstruct(
            metadata={**measure.metadata(), STRESS_STATE_KEY: self.state.value}
        )

    def _sufficient_degree(self, exact_degree: int, in_box: int) -> int:
        geometry = self.spaces.mesh.ufl_domain().ufl_coordinate_element()
        data = (*vars(self.material).values(), self.thickness)
        curved = geometry.degree > 1
        if curved or self.state is StressState.AXISYMMETRIC or not all(map(_constant, data)):
            return _RATIONAL_DEGREE
        if self.spaces.mesh.topology.cell_name() in ("interval", "triangle", "tetrahedron"):
            return exact_degree
        return in_box if has_parallel_cells(self.spaces.mesh) else 5

    def _value(self, value: Scalar) -> Expr:
        """A number as a constant of the form, so that a new number compiles nothing anew."""
        if not arguments.is_number(value):
            return value
        return fem.Constant(self.spaces.mesh, float(value))

    def _vector(self, name: str, value: Vector) -> Expr:
        mesh = self.spaces.mesh
        vector = arguments.check_components(name, value, mesh.geometry.dim)
        return vector if isinstance(vector, Expr) else fem.Constant(mesh, vector)


@check_same_arguments
def boundary_measure(mesh: Mesh, where: Part, quadrature_degree: int = 4) -> ufl.Measure:
    """Surface measure of a part of the boundary, for `Body.surface_load` and other forms.

    Args:
        mesh: the mesh.
        where: marker, which takes points as columns (3, n) and has to hold at every vertex of a
            facet; or local numbers of facets, as `MeshTags.find` gives them; or a mask of all.
        quadrature_degree: of the facet integrals.

    Raises:
        ValueError: if no exterior facet is marked, the marker fails or does not return truth
            values, or a number does not belong to a facet.
    """
    arguments.check_mesh_type(mesh)
    arguments.check_integer("quadrature_degree", quadrature_degree, 0)
    dimension = mesh.topology.dim - 1
    facets = locate_exterior_facets(mesh, where)
    if mesh.comm.allreduce(len(facets), MPI.SUM) == 0:
        raise ValueError("the marker holds on no exterior facet of the mesh: nothing to load")
    tags = meshtags(mesh, dimension, facets, np.ones(len(facets), dtype=np.int32))
    return ufl.Measure(
        "ds",
        domain=mesh,
        subdomain_data=tags,
        subdomain_id=1,
        metadata={"quadrature_degree": quadrature_degree},
    )


@check_same_arguments
def prescribe(
    space: fem.FunctionSpace,
    component: int | Literal["pressure"],
    where: Part,
    value: float | fem.Constant = 0.0,
) -> fem.DirichletBC:
    """Prescribes one displacement component at all nodes, mid-side ones too, of a part.

        held = Reduction.dirichlet(U, [prescribe(U, 1, lambda x: np.isclose(x[1], 0))])
        held = Reduction.dirichlet(U, [prescribe(U, k, facet_tags.find(BASE)) for k in (0, 1)])

    Args:
        space: trial space.
        component: counted from 0; or "pressure" of a hybrid space, whose nodes are the vertices.
        where: marker of the nodes' positions as columns (3, n); or local numbers of facets, as
            `MeshTags.find` gives them, or a mask of all.
        value: of the component; the value of a `fem.Constant` may change later.

    Raises:
        ValueError: if there is no such node or no such component, the marker fails or does not
            return truth values, or the value is not a finite number.
    """
    arguments.check_space(space)
    hybrid = is_hybrid(space)
    fluid = hybrid and component == "pressure"
    field = SubSpace.pressure(space) if fluid else SubSpace.displacements(space)
    components = field.unknowns.shape[1]
    if not (fluid or (arguments.is_number(component) and component in range(components))):
        raise ValueError(f"component {component}: the space has {components}, counted from 0")
    now = value.value if isinstance(value, fem.Constant) else value
    arguments.check_number("the prescribed value", now)
    axis = 0 if fluid else int(component)
    if arguments.is_user_function(where):
        nodes = locate_any_nodes(field.space, "the prescribed nodes", where)
    else:
        # nodes given in place of facets are hardly ever all of the boundary's
        facets = locate_exterior_facets(space.mesh, where, skip_interior=False)
        if space.mesh.comm.allreduce(len(facets), MPI.SUM) == 0:
            raise ValueError("the prescribed part has no facet")
        nodes = fem.locate_dofs_topological(field.space, space.mesh.topology.dim - 1, facets)
    dofs = field.unknowns[nodes, axis]
    part = space.sub(int(fluid)) if hybrid else space
    if part.num_sub_spaces:
        part = part.sub(axis)
    held = default_scalar_type(now) if now is value else value
    return fem.dirichletbc(held, np.ascontiguousarray(dofs), part)


@check_same_arguments
def nodal_load(space: fem.FunctionSpace, where: Marker, force: Sequence[float]) -> PETSc.Vec:
    """Load vector of a concentrated force at each node that a marker selects.

    It is the same for every test space with W_i(x_i) = 1.

    Args:
        space: trial space.
        where: marker of the nodes' positions as columns (3, n).
        force: (components,), on each of the nodes.

    Raises:
        ValueError: if there is no such node, the marker fails or does not return truth values, or
            the force has another number of components than the space, or one that is not finite.
    """
    arguments.check_space(space)
    comm, field = space.mesh.comm, SubSpace.displacements(space)
    arguments.check_vector("nodal force", force, field.unknowns.shape[1])
    nodes = locate_any_nodes(field.space, "the loaded nodes", where)
    nodes = nodes[nodes < len(field.owned_unknowns)]
    values = np.zeros(field.owned_unknowns.shape)
    values[nodes] = force
    load = PETSc.Vec().createMPI(field.full_sizes, comm=comm)
    load.setArray(field.embed(values.ravel()))
    return load


@check_same_arguments
def lumped_mass(M: PETSc.Mat, space: fem.FunctionSpace) -> PETSc.Mat:
    """Diagonal matrix (n, n) of the row sums of a mass matrix.

    They are integrals of density times test function: positive with piecewise-linear weights
    (A/12 and A/4 on a 6-node triangle, V/32 and 7V/48 on a 10-node tetrahedron), zero at the
    vertices of the standard triangle.

    In explicit dynamics combine it with a symmetric stiffness, preferably that of the `Sibling`,
    whose own mass has positive row sums, too. With the unsymmetric stiffness the upper spectrum is
    complex, and undamped vibrations grow whatever the time step (section V9 of the study).

    Args:
        M: mass (n, n), free.
        space: trial space.

    Raises:
        ValueError: if a row sum is not positive (it names the nodes), or the matrix is not one of
            the space.
    """
    arguments.check_space(space)
    check_problem({"the mass matrix": M}, space=space)
    if is_hybrid(space):
        raise ValueError("a pressure has no mass: lump that of Spaces.petrov_galerkin(mesh)")
    mass = M.getRowSum()
    bad = mass.array_r <= _ZERO_MASS * M.getDiagonal().array_r
    nodes = np.unique(np.flatnonzero(bad) // space.dofmap.index_map_bs)
    if count := space.mesh.comm.allreduce(len(nodes), MPI.SUM):
        places = space.mesh.comm.allgather(space.tabulate_dof_coordinates()[nodes[:3]])
        raise ValueError(
            f"{count} nodes have no positive lumped mass, among them those at "
            f"{format_points(np.concatenate(places)[:3])}: row sums serve piecewise-linear weights"
        )
    lumped = PETSc.Mat().createAIJ(M.getSizes(), nnz=1, comm=M.comm)
    lumped.setDiagonal(mass)
    lumped.assemble()
    return replace(AssemblyRecord.read(M), lumped=True).attach(lumped)


def _constant(value: Scalar) -> bool:
    if isinstance(value, fem.Function):
        return value.function_space.ufl_element().embedded_superdegree == 0
    return arguments.is_number(value) or isinstance(value, fem.Constant)


def _largest(ratio: Scalar, comm: MPI.Comm) -> float:
    values = arguments.available_values(ratio)
    return float(comm.allreduce(values.max(initial=-np.inf), MPI.MAX))


def _set(instance: object, name: str, value: object) -> None:
    object.__setattr__(instance, name, value)

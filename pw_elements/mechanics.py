"""Isotropic linear elasticity as UFL forms over a trial/test pair.

The equations of motion, Eq. (1), in weak form, Eq. (2), are M a'' + K a = f, Eq. (9), with the
forms of `Body`; accelerations are a field like displacements, Eq. (4), and UFL's gradients take
the place of the matrices B, of shape functions, and of Eq. (8), of weight functions.

Units are consistent ones of the user's choice (N, m, Pa, kg/m³ throughout, say).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Literal, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh, exterior_facet_indices, locate_entities_boundary, meshtags
from ufl.core.expr import Expr

from pw_elements._compat import renamed
from pw_elements.quadrature import cell_measure
from pw_elements.spaces import Spaces

Scalar: TypeAlias = float | Expr
Vector: TypeAlias = Sequence[float] | npt.NDArray[np.float64] | Expr
Marker: TypeAlias = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.bool_]]
Part: TypeAlias = Marker | npt.NDArray[np.int32]  # of the boundary: a marker, or facets

# Integrands that are no polynomials (hoop strain, curved cells, a varying modulus): what it leaves
# of natural frequencies is below 1e-4 of the mesh's own error, see tests/test_vibration.py
_RATIONAL_DEGREE = 8
# A row sum of the mass matrix below this, over its diagonal entry, is zero
_ROUND_OFF = 1e-12


class StressState(Enum):
    """How the third direction behaves."""

    PLANE_STRESS = "plane stress"
    PLANE_STRAIN = "plane strain"
    AXISYMMETRIC = "axisymmetric"  # coordinates (r, z), the axis at r = 0
    SOLID = "solid"


@dataclass(frozen=True)
class Material:
    """Isotropic elastic material; numbers, or UFL expressions where it varies in space.

    Raises:
        ValueError: for a modulus or density that is not positive, or nu outside (-1, 1/2].
    """

    youngs_modulus: Scalar
    poissons_ratio: Scalar = 0.0
    density: Scalar = 1.0

    def __post_init__(self) -> None:
        for name in ("youngs_modulus", "density"):
            value = getattr(self, name)
            if _is_number(value) and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} = {value}: has to be a positive number")
        nu = self.poissons_ratio
        if _is_number(nu) and not -1 < nu <= 0.5:
            raise ValueError(f"poissons_ratio = {nu}: has to lie between -1 and 0.5")


@dataclass(frozen=True)
class Body:
    """An elastic body: spaces, material and state, and the forms that go with them.

    Args:
        spaces: trial and test space of the displacements.
        material: elastic constants and density.
        state: a `StressState`, or its value as a string: "plane stress", "plane strain",
            "axisymmetric" or "solid".
        thickness: t(x, y) of a plane body, number or UFL expression.
        quadrature_degree: exact degree is chosen for straight simplices with constant data,
            3 points a direction for straight quadrilaterals and 8 else, unless given.

    Raises:
        ValueError: where dimension and state do not fit, the mesh is a surface in space or
            crosses the axis of rotation, an incompressible material is not in plane stress, or
            the thickness is not positive.
    """

    spaces: Spaces
    material: Material
    state: StressState
    thickness: Scalar = 1.0
    quadrature_degree: int | None = None

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "state", StressState(self.state))
        except ValueError:
            names = ", ".join(repr(state.value) for state in StressState)
            raise ValueError(f"state {self.state!r}: the states are {names}") from None
        mesh = self.spaces.mesh
        dimension = mesh.geometry.dim
        if mesh.topology.dim != dimension:
            raise ValueError(
                f"a mesh of {mesh.topology.dim}-D cells in {dimension}-D space is no body: give "
                "its nodes as many coordinates as its cells have dimensions"
            )
        if (self.state is StressState.SOLID) != (dimension == 3) or dimension == 1:
            raise ValueError(f"a {dimension}-D mesh cannot be in the state {self.state.value!r}")
        if self.state is StressState.AXISYMMETRIC:
            r = mesh.geometry.x[:, 0]
            radius = mesh.comm.allreduce(r.min(initial=np.inf), MPI.MIN)
            size = mesh.comm.allreduce(np.abs(r).max(initial=0.0), MPI.MAX)
            if radius < -_ROUND_OFF * size:
                raise ValueError(f"the mesh crosses the axis of rotation: its least r is {radius}")
        nu = self.material.poissons_ratio
        if self.state is not StressState.PLANE_STRESS and _is_number(nu) and nu == 0.5:
            raise ValueError("poissons_ratio = 0.5: in plane stress only may it be 0.5")
        if _is_number(self.thickness) and not (np.isfinite(self.thickness) and self.thickness > 0):
            raise ValueError(f"thickness = {self.thickness}: has to be a positive number")

    def strain(self, u: Expr) -> Expr:
        """Small strain tensor, Eq. (5); in axisymmetry 3 x 3 with the hoop strain u_r / r."""
        plane = ufl.sym(ufl.grad(u))
        if self.state is not StressState.AXISYMMETRIC:
            return plane
        hoop = u[0] / self._radius()
        return ufl.as_tensor(
            [[plane[0, 0], plane[0, 1], 0], [plane[1, 0], plane[1, 1], 0], [0, 0, hoop]]
        )

    def stress(self, u: Expr) -> Expr:
        """Stress tensor, Eq. (6) and Eq. (22), of the strain tensor's shape."""
        E, nu = self._value(self.material.youngs_modulus), self._value(self.material.poissons_ratio)
        mu = E / (2 * (1 + nu))
        if self.state is StressState.PLANE_STRESS:
            lame = E * nu / (1 - nu**2)
        else:
            lame = E * nu / ((1 + nu) * (1 - 2 * nu))
        strain = self.strain(u)
        return lame * ufl.tr(strain) * ufl.Identity(strain.ufl_shape[0]) + 2 * mu * strain

    def stiffness(self) -> ufl.Form:
        """Stiffness form, Eq. (10)."""
        u, v = self._arguments()
        return self._bilinear(ufl.inner(self.stress(u), self.strain(v)), 2)

    def mass(self) -> ufl.Form:
        """Consistent mass form, Eq. (11)."""
        u, v = self._arguments()
        return self._bilinear(self._value(self.material.density) * ufl.inner(u, v), 4)

    def surface_load(self, traction: Vector, surface: ufl.Measure) -> ufl.Form:
        """Load of a traction vector (force per area), Eq. (12), over a `boundary_measure`.

        Loads of several measures are added as vectors; a form may have one of them.
        """
        v = ufl.TestFunction(self.spaces.test)
        return ufl.inner(self._vector(traction), v) * self._depth() * surface

    def body_load(self, force: Vector) -> ufl.Form:
        """Load of a body force vector (force per volume), Eq. (12)."""
        v = ufl.TestFunction(self.spaces.test)
        return self._integral(ufl.inner(self._vector(force), v), 2)

    def initial_stress(self, stress: Expr, form: Literal["G", "J"] = "G") -> ufl.Form:
        """Initial stress form, Eq. (25) and Eq. (26), for a prestress tensor.

        Args:
            stress: tensor of the strain's shape, e.g. `body.stress(prestress_displacement)`.
            form: "G" is the paper's, grad(v) : grad(u) S; "J" takes 2 S : (eps(v) eps(u)) off,
                as continuum elements with an objective stress rate do.

        Raises:
            ValueError: for another form.
        """
        u, v = self._arguments()
        if form not in ("G", "J"):
            raise ValueError(f"geometric stiffness {form!r}: the forms are 'G' and 'J'")
        integrand = ufl.inner(ufl.dot(self._gradient(u), stress), self._gradient(v))
        if form == "J":
            integrand -= 2 * ufl.inner(stress, ufl.dot(self.strain(v), self.strain(u)))
        return self._bilinear(integrand, 3)

    def _arguments(self) -> tuple[Expr, Expr]:
        return ufl.TrialFunction(self.spaces.trial), ufl.TestFunction(self.spaces.test)

    def _gradient(self, u: Expr) -> Expr:
        grad = ufl.grad(u)
        if self.state is not StressState.AXISYMMETRIC:
            return grad
        hoop = u[0] / self._radius()
        return ufl.as_tensor(
            [[grad[0, 0], grad[0, 1], 0], [grad[1, 0], grad[1, 1], 0], [0, 0, hoop]]
        )

    def _radius(self) -> Expr:
        return ufl.SpatialCoordinate(self.spaces.mesh)[0]

    def _depth(self) -> Scalar:
        """What an area of the mesh is multiplied by to be a volume."""
        if self.state is StressState.AXISYMMETRIC:
            return 2 * np.pi * self._radius()
        if self.state is StressState.SOLID:
            return 1.0
        return self._value(self.thickness)

    def _bilinear(self, integrand: Expr, exact_degree: int) -> ufl.Form:
        """As `_integral`; linear weights take a degree less, which pays on tetrahedra."""
        pair = self.spaces.test is not self.spaces.trial
        tetrahedra = self.spaces.mesh.topology.cell_name() == "tetrahedron"
        return self._integral(integrand, exact_degree - (pair and tetrahedra))

    def _integral(self, integrand: Expr, exact_degree: int) -> ufl.Form:
        """Integral over the volume; `exact_degree` is the integrand's on a straight simplex."""
        degree = self.quadrature_degree
        if degree is None:
            degree = self._sufficient_degree(exact_degree)
        return integrand * self._depth() * cell_measure(self.spaces.test, degree)

    def _sufficient_degree(self, exact_degree: int) -> int:
        geometry = self.spaces.mesh.ufl_domain().ufl_coordinate_element()
        material = self.material
        data = (
            material.youngs_modulus,
            material.poissons_ratio,
            material.density,
            self.thickness,
        )
        curved = geometry.degree > 1
        if curved or self.state is StressState.AXISYMMETRIC or not all(map(_is_number, data)):
            return _RATIONAL_DEGREE
        simplex = self.spaces.mesh.topology.cell_name() in ("interval", "triangle", "tetrahedron")
        return exact_degree if simplex else 5  # 3 points a direction

    def _value(self, value: Scalar) -> Expr:
        """A number as a constant of the form, so that a new number compiles nothing anew."""
        if not _is_number(value):
            return value
        return fem.Constant(self.spaces.mesh, default_scalar_type(value))

    def _vector(self, value: Vector) -> Expr:
        if isinstance(value, Sequence | np.ndarray):
            return fem.Constant(self.spaces.mesh, np.asarray(value, dtype=default_scalar_type))
        return value


def exterior_facets(mesh: Mesh, where: Part) -> npt.NDArray[np.int32]:
    """Local numbers of a part of the boundary's facets, of owned cells.

    Args:
        mesh: the mesh.
        where: marker, which takes points (3, n) and has to hold at every vertex of a facet, or
            local numbers of facets, as `MeshTags.find` gives them.

    Raises:
        ValueError: if a number is none of a facet.
    """
    dimension = mesh.topology.dim - 1
    mesh.topology.create_connectivity(dimension, mesh.topology.dim)
    if callable(where):
        marked = locate_entities_boundary(mesh, dimension, where)
    else:
        marked = np.asarray(where)
        index_map = mesh.topology.index_map(dimension)
        count = index_map.size_local + index_map.num_ghosts
        if len(marked) and (marked.min() < 0 or marked.max() >= count):
            raise ValueError(f"facets: there are {count} of them on this process, counted from 0")
    return np.intersect1d(marked, exterior_facet_indices(mesh.topology)).astype(np.int32)


def boundary_measure(mesh: Mesh, where: Part, quadrature_degree: int = 4) -> ufl.Measure:
    """Surface measure of a part of the boundary, see `exterior_facets`.

    Args:
        mesh: the mesh.
        where: marker, or facets.
        quadrature_degree: of the facet integrals.

    Raises:
        ValueError: if no exterior facet is marked.
    """
    dimension = mesh.topology.dim - 1
    facets = exterior_facets(mesh, where)
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


def prescribe(
    space: fem.FunctionSpace, component: int, where: Marker, value: float = 0.0
) -> fem.DirichletBC:
    """Prescribed displacement component at all nodes (mid-side ones too) a marker holds on.

    Raises:
        ValueError: if there is no such node, or no such component.
    """
    components = space.dofmap.index_map_bs
    if not 0 <= component < components:
        raise ValueError(f"component {component}: the space has {components}, counted from 0")
    dofs = _nodes(space, where) * space.dofmap.index_map_bs + component
    return fem.dirichletbc(default_scalar_type(value), dofs, space.sub(component))


def nodal_load(space: fem.FunctionSpace, where: Marker, force: Sequence[float]) -> PETSc.Vec:
    """Load vector of a concentrated force at each node a marker holds on.

    It is the same for every test space with W_i(x_i) = 1.

    Raises:
        ValueError: if there is no such node, or the force has another number of components
            than the space, or one that is not finite.
    """
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    if len(force) != block or not np.all(np.isfinite(force)):
        raise ValueError(f"nodal force {list(force)}: it needs {block} finite components")
    nodes = _nodes(space, where)
    nodes = nodes[nodes < index_map.size_local]
    first = index_map.local_range[0]
    load = PETSc.Vec().createMPI(
        (index_map.size_local * block, index_map.size_global * block), comm=space.mesh.comm
    )
    for component, value in enumerate(force):
        dofs = ((nodes + first) * block + component).astype(PETSc.IntType)
        load.setValues(dofs, np.full(len(dofs), value))
    load.assemble()
    return load


def lumped_mass(M: PETSc.Mat, space: fem.FunctionSpace) -> PETSc.Mat:
    """Diagonal matrix (n, n) of the row sums of a mass matrix.

    They are integrals of density times test function: positive with piecewise-linear weights
    (A/12 and A/4 on a 6-node triangle, V/32 and 7V/48 on a 10-node tetrahedron), zero at the
    vertices of the standard triangle.

    In explicit dynamics combine it with the symmetric part of the stiffness or with the standard
    one: with the unsymmetric stiffness the upper spectrum is complex, and undamped vibrations
    grow whatever the time step (section V9 of the study).

    Raises:
        ValueError: if a row sum is not positive; it names the nodes.
    """
    mass, ones, diagonal = M.createVecLeft(), M.createVecRight(), M.getDiagonal()
    ones.set(1.0)
    M.mult(ones, mass)
    bad = mass.array_r <= _ROUND_OFF * diagonal.array_r
    nodes = np.unique(np.flatnonzero(bad) // space.dofmap.index_map_bs)
    count = space.mesh.comm.allreduce(len(nodes), MPI.SUM)
    if count > 0:
        places = space.mesh.comm.allgather(space.tabulate_dof_coordinates()[nodes[:3]])
        named = [tuple(x.round(6).tolist()) for x in np.concatenate(places)[:3]]
        raise ValueError(
            f"{count} nodes have no positive lumped mass, among them those at "
            f"{', '.join(map(str, named))}: row sums serve elements with piecewise-linear weights"
        )
    lumped = PETSc.Mat().createAIJ(M.getSizes(), nnz=1, comm=M.comm)
    lumped.setDiagonal(mass)
    lumped.assemble()
    lumped.setAttr("form", M.getAttr("form"))
    return lumped


def _nodes(space: fem.FunctionSpace, where: Marker) -> npt.NDArray[np.int32]:
    """Local node numbers (ghosts too) at which the marker holds."""
    nodes = fem.locate_dofs_geometrical(space, where)
    if space.mesh.comm.allreduce(len(nodes), MPI.SUM) == 0:
        raise ValueError("the marker holds at no node of the space: check its coordinates")
    return nodes


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | np.number)


__getattr__ = renamed(
    __name__,
    {"State": ("StressState", StressState), "support": ("prescribe", prescribe)},
)

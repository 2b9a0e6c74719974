"""Nearly incompressible bodies: the hybrid element, displacements and a pressure.

One-field elements lock as Poisson's ratio goes to 1/2. With the pair of Taylor and Hood, weighted
by that of Bercovier and Pironneau, nothing does: manufactured solutions in the plane and in space,
Cook's membrane, and Hertz's line contact, standard weights and new ones side by side. Stability,
layers, friction, spheres and a seal have modules of their own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from pw_elements import (
    Body,
    Material,
    Reduction,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
    split,
)
from pw_elements.contact import Parabola
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes, triangles
from study.meshes.distorted_meshes import unit_mesh
from study.meshes.mesh_families import cell_size
from study.model.discretisation import displacement_space, held_nodes, spaces
from study.model.units import NONE, dimensionless
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions.half_space import Elastic, HertzLine
from study.solutions.indentation import INNER, Indenter, indented
from study.solutions.manufactured import plane, plane_pressure, solid, solid_pressure
from study.verification.v15_contact import PLACE, RADIUS, ZONE, presses, pushed, sphere
from study.verification.v15_layers import layers
from study.verification.v15_seal import seal
from study.verification.v15_stability import identity, infsup

SECTION = "V15"
TITLE = "Nearly incompressible bodies"

Array = npt.NDArray[np.float64]

YOUNGS_MODULUS = 1.0
DEGREE = 8  # of integrals of known fields
HALF_WIDTH = 1.0  # of Hertz's contact


def square(element: str, nu: float, n: int) -> Result:
    """A unit square of triangles or quadrilaterals with sides of 1/n, in plane strain."""
    return _manufactured(element, nu, n)


def cube(element: str, nu: float, n: int) -> Result:
    """A unit cube of tetrahedra or hexahedra with sides of 1/n."""
    return _manufactured(element, nu, n)


def enclosed(element: str, nu: float, n: int) -> Result:
    """The same, with the known displacements on all sides in place of tractions."""
    return _manufactured(element, nu, n, enclosed=True)


@dataclass(frozen=True)
class _Known:
    """A solenoidal field plus g/lambda, with the pressure -div g, which stays bounded at nu = 1/2.

    Args:
        body: on which it is.
        nu: Poisson's ratio.
    """

    body: Body
    nu: float

    def displacement(self) -> Expr:
        """Of the body."""
        field = solid if self.body.spaces.mesh.geometry.dim == 3 else plane
        return ufl.as_vector(field(ufl, self._x(), self._constant(self.flexibility)))

    def pressure(self) -> Expr:
        """Of the body, -lambda div u."""
        field = solid_pressure if self.body.spaces.mesh.geometry.dim == 3 else plane_pressure
        return -ufl.div(ufl.as_vector(field(ufl, self._x(), self._constant(1.0))))

    def stress(self) -> Expr:
        """Of the body, 2 mu eps(u) - p I."""
        u, p = self.displacement(), self.pressure()
        mu = self._constant(YOUNGS_MODULUS / (2 * (1 + self.nu)))
        return 2 * mu * ufl.sym(ufl.grad(u)) - p * ufl.Identity(len(u))

    @property
    def flexibility(self) -> float:
        """1/lambda."""
        return (1 + self.nu) * (1 - 2 * self.nu) / (YOUNGS_MODULUS * self.nu)

    def at(self, x: Array) -> Array:
        """Displacements (n, dim) at points (n, 3)."""
        field = solid if self.body.spaces.mesh.geometry.dim == 3 else plane
        return np.column_stack(field(np, x.T, self.flexibility))

    def _x(self) -> Expr:
        return ufl.SpatialCoordinate(self.body.spaces.mesh)

    def _constant(self, value: float) -> fem.Constant:
        return fem.Constant(self.body.spaces.mesh, value)


def _manufactured(element: str, nu: float, n: int, enclosed: bool = False) -> Result:
    """Errors over the size of what is known, tractions and body force being prescribed.

    Displacements are given on the bottom, or on all sides.
    """
    mesh = unit_mesh(element, 1 / n)
    state = StressState.SOLID if mesh.geometry.dim == 3 else StressState.PLANE_STRAIN
    body = Body(spaces(element, mesh), Material(YOUNGS_MODULUS, nu), state)
    known, W = _Known(body, nu), body.spaces.trial
    exact_body = Body(body.spaces, body.material, state, quadrature_degree=DEGREE)
    f = assemble_vector(exact_body.body_load(-ufl.div(known.stress())))
    traction = known.stress() * ufl.FacetNormal(mesh)
    rim = boundary_measure(mesh, lambda x: np.ones(x.shape[1], dtype=bool), DEGREE)
    f.axpy(1.0, assemble_vector(body.surface_load(traction, rim)))
    K = assemble_matrix(body.stiffness())
    u, p = _fields(body, solve(K, f, Reduction.dirichlet(W, _held(W, known, enclosed))))

    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": DEGREE})

    def size(value: Expr) -> float:
        return float(np.sqrt(fem.assemble_scalar(fem.form(ufl.inner(value, value) * dx))))

    exact, exact_p = known.displacement(), known.pressure()
    scalars = {
        "h1_error": size(ufl.grad(u - exact)) / size(ufl.grad(exact)),
        "l2_error": size(u - exact) / size(exact),
        "pressure_error": size(p - exact_p) / size(exact_p),
        "h": cell_size(mesh),
    }
    return Result(scalars, dimensionless(scalars), {}, dofs=K.getSize()[0])


def _held(space: fem.FunctionSpace, known: _Known, enclosed: bool) -> fem.DirichletBC:
    """The known displacements on the bottom, or on all sides."""
    x = displacement_space(space).tabulate_dof_coordinates()
    dim = space.mesh.geometry.dim
    held = np.isclose(x[:, 1], 0.0)
    if enclosed:
        held = np.any(np.isclose(x[:, :dim], 0.0) | np.isclose(x[:, :dim], 1.0), axis=1)
    nodes = np.flatnonzero(held).astype(np.int32)
    return held_nodes(space, nodes, known.at(x[nodes]))


def _fields(body: Body, a: PETSc.Vec) -> tuple[Expr, Expr]:
    """Displacement, and pressure -lambda div u, which one-field elements have by it."""
    if body.spaces.is_hybrid:
        return split(body.spaces.trial, a)
    u = as_function(body.spaces.trial, a)
    nu = body.material.poissons_ratio
    lame = YOUNGS_MODULUS * nu / ((1 + nu) * (1 - 2 * nu))
    return u, -lame * ufl.div(u)


def cook(element: str, n: int, nu: float = 0.4999) -> Result:
    """Cook's membrane in plane strain, n elements a side; `tip` is its deflection times E t/F."""

    def tapered(x: Array) -> Array:
        return np.column_stack(
            [48 * x[:, 0], 44 * x[:, 0] + x[:, 1] * (44 - 28 * x[:, 0]), x[:, 2]]
        )

    mesh = move_nodes(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (n, n)), tapered)
    body = Body(spaces(element, mesh), Material(YOUNGS_MODULUS, nu), StressState.PLANE_STRAIN)
    W = body.spaces.trial
    clamped = [prescribe(W, k, lambda x: np.isclose(x[0], 0.0)) for k in (0, 1)]
    right = boundary_measure(mesh, lambda x: np.isclose(x[0], 48.0))
    f = assemble_vector(body.surface_load((0.0, 1 / 16), right))  # a force of 1
    K = assemble_matrix(body.stiffness())
    u, _ = _fields(body, solve(K, f, Reduction.dirichlet(W, clamped)))
    x = displacement_space(W).tabulate_dof_coordinates()
    corner = np.flatnonzero(np.isclose(x[:, 0], 48.0) & np.isclose(x[:, 1], 60.0))
    scalars = {"tip": float(u.x.array.reshape(-1, 2)[corner[0], 1])}
    return Result(scalars, dimensionless(scalars), {}, dofs=K.getSize()[0])


def hertz(element: str, n: int, nu: float = 0.4999) -> Result:
    """A rigid parabola pressed on a half plane, n elements over the contact's half width.

    `pressure_rms` is that of the error, of pressures over the nodes' own weights, over p0 and
    away from the edge of the contact; `pressure_rms_all` counts all nodes inside.
    """
    body = Elastic(YOUNGS_MODULUS, nu)
    force = np.pi * HALF_WIDTH**2 * body.plane_modulus / (4 * RADIUS)
    known = HertzLine(body, RADIUS, force)
    indenter = Indenter(known, Parabola((0.0, 0.0), RADIUS), StressState.PLANE_STRAIN, NONE)
    size = HALF_WIDTH / (n + PLACE)
    lines = size * np.arange(np.ceil(ZONE * (n + PLACE)) + 1)
    result = indented(element, indenter, lines)
    curves = result.curves
    error = (curves["pressure"] - curves["exact_pressure"]) / known.peak

    def rms(within: float) -> float:
        return float(np.sqrt(np.mean(error[curves["x"] < within * HALF_WIDTH] ** 2)))

    scalars = {
        "pressure_rms": rms(INNER),
        "pressure_rms_all": rms(1.0),
        "sawtooth": result.scalars["sawtooth"],
        "iterations": result.scalars["iterations"],
        "residual": result.scalars["residual"],
    }
    kept = {name: curves[name] for name in ("x", "force_n", "pressure", "exact_pressure", "status")}
    return Result(scalars, dimensionless(scalars), kept, dofs=result.dofs)


ONE_FIELD, HYBRID = ("galerkin-T6", "pw-T6"), ("galerkin-hybrid-T6", "pw-hybrid-T6")
T10, HYBRID_T10 = ("galerkin-T10", "pw-T10"), ("galerkin-hybrid-T10", "pw-hybrid-T10")
HYBRID_Q9 = ("galerkin-hybrid-Q9", "pw-hybrid-Q9")
HYBRID_H27 = ("galerkin-hybrid-H27", "pw-hybrid-H27")
RATIOS = (0.3, 0.4999, 0.5)


def _known(
    run: Callable[..., Result],
    elements: Sequence[str],
    levels: Sequence[int],
    ratios: Sequence[float] = RATIOS,
) -> list[Case]:
    """At each Poisson's ratio that an element takes."""
    return [
        Case(
            "V15",
            f"{run.__name__}-{element}-{nu:g}-{n}",
            run,
            {"element": element, "nu": nu, "n": n},
        )
        for nu in ratios
        for element in elements
        if nu < 0.5 or "hybrid" in element
        for n in levels
    ]


def _on_levels(
    run: Callable[..., Result], elements: Sequence[str], levels: Sequence[int]
) -> list[Case]:
    return [
        Case("V15", f"{run.__name__}-{element}-{n}", run, {"element": element, "n": n})
        for element in elements
        for n in levels
    ]


CASES = [
    *_known(square, (*ONE_FIELD, *HYBRID, *HYBRID_Q9), (8, 16, 32)),
    *_known(cube, (*T10, *HYBRID_T10), (3, 6)),
    *_known(enclosed, HYBRID_H27, (4,), (0.4999,)),
    Case("V15", "identity-pw-hybrid-T6", identity, {"element": "pw-hybrid-T6"}),
    *_on_levels(infsup, (*HYBRID, *HYBRID_Q9), (4, 8, 16, 32)),
    *_on_levels(infsup, HYBRID_T10, (2, 4, 6)),
    *(
        Case("V15", f"layers-{element}", layers, {"element": element})
        for element in (*HYBRID, *HYBRID_Q9, *HYBRID_T10, *HYBRID_H27)
    ),
    *_on_levels(cook, (*ONE_FIELD, *HYBRID), (4, 8, 16, 32)),
    *_on_levels(hertz, (*ONE_FIELD, *HYBRID), (8, 16, 32)),
    *_on_levels(presses, ONE_FIELD, (8, 16, 32)),
    *_on_levels(presses, HYBRID, (8, 16, 32, 64)),
    *_on_levels(pushed, ("pw-T6", *HYBRID), (30,)),
    *_on_levels(sphere, T10, (3,)),
    *_on_levels(sphere, (*HYBRID_T10, *HYBRID_H27), (3,)),
    *_on_levels(sphere, HYBRID_T10, (6,)),
    *_on_levels(seal, HYBRID, (8,)),
    *_on_levels(seal, HYBRID[1:], (12,)),
]
CASES = mark_costly(
    CASES,
    *("square-*-Q9-*", "cube-*", "enclosed-*", "infsup-*-Q9-*", "infsup-*-T10-*", "layers-*-T10"),
    *("layers-*-H27", "presses-*-64", "pushed-*", "seal-*-12", "sphere-*-H27-3"),
    "sphere-*-hybrid-T10-6",
)
CASES += mark_costly(
    [
        *_known(cube, HYBRID_H27, (2, 4)),
        *_known(cube, HYBRID_H27, (8, 12, 16), (0.4999,)),
        *_on_levels(infsup, HYBRID_H27, (2, 4, 6)),
    ]
)

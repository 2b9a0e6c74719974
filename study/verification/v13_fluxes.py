"""Nodal fluxes at prescribed nodes: reactions over areas, against exact fluxes.

Ways: "standard", the standard element's reactions over geometric areas; "own", over the integrals
of its test functions; "transferred", evened out by T, over geometric areas; "pw", the new element's
over geometric areas. Steady conduction in a graded material is judged by `v13_graded`, too.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, Mesh, create_box, create_rectangle

from pw_elements import (
    PetrovGalerkinProblem,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    force_transfer,
    nodal_flux,
    reactions,
    solve,
)
from pw_elements.meshes import triangles
from study.model.units import dimensionless
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.verification.v13_graded import (
    Conduction,
    Graded,
    Sourced,
    Trefftz,
    polynomial_error,
)

SECTION = "V13"
TITLE = "Fluxes at prescribed nodes, and graded conduction"

Array = npt.NDArray[np.float64]

RATIO = 100.0  # of conductivities
DEGREE = 8  # of quadrature, where the integrand is no polynomial


@dataclass(frozen=True)
class Way:
    """How nodal reactions become fluxes: the element, the area, and whether T comes first."""

    element: str
    spaces: Callable[[Mesh, int], Spaces]
    area: Literal["geometric", "weight"] = "geometric"
    evened: bool = False


WAYS = {
    "standard": Way("galerkin", Spaces.galerkin),
    "own": Way("galerkin", Spaces.galerkin, "weight"),
    "transferred": Way("galerkin", Spaces.galerkin, evened=True),
    "pw": Way("pw", Spaces.petrov_galerkin),
}


def square(way: str, elements: int) -> Result:
    """-laplace(u) = f on the unit square, u = sin(2 x) exp(y) + y^2; the flux at y = 1."""
    return _poisson(way, triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (elements, elements)))


def cube(way: str, elements: int) -> Result:
    """The same in the unit cube, u = sin(2 x) exp(z) + y^2; the flux at z = 1."""
    corners, divisions = [np.zeros(3), np.ones(3)], [elements] * 3
    return _poisson(way, create_box(MPI.COMM_SELF, corners, divisions, CellType.tetrahedron))


def graded(way: str, elements: int, cell: str = "triangle", ratio: float = RATIO) -> Result:
    """A graded wall without a source."""
    return _conduction(way, elements, Graded(ratio), cell)


def sourced(way: str, elements: int, cell: str = "triangle", ratio: float = RATIO) -> Result:
    """A graded square with a source and a smooth temperature."""
    return _conduction(way, elements, Sourced(ratio), cell)


def trefftz(known: str, degree: int, transformed: bool = True, ratio: float = RATIO) -> Result:
    """The same by Trefftz's way: the wall, or the square with the source."""
    problem: Conduction = Graded(ratio) if known == "graded" else Sourced(ratio)
    answer = Trefftz(problem, degree, transformed)
    line: Array = np.linspace(0, 1, 33, dtype=np.float64)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    exact = problem.temperature(x, y)
    off = np.abs(answer.flux(line) - problem.flux(line)) / np.abs(problem.flux(line)).max()
    scalars = {
        "temperature_error": np.abs(answer.temperature(x, y) - exact).max() / np.abs(exact).max(),
        "flux_error_median": np.median(off),
        "flux_error_max": off.max(),
        "boundary_misfit": answer.residual,
        "polynomial_error": polynomial_error(problem, degree, transformed),
        "iterations": answer.steps,
    }
    curves = {"x": line, "flux": answer.flux(line), "exact_flux": problem.flux(line)}
    return _result(scalars, curves, answer.unknowns)


def _poisson(way: str, mesh: Mesh) -> Result:
    spaces = WAYS[way].spaces(mesh, 0)
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    last = mesh.geometry.dim - 1
    place = ufl.SpatialCoordinate(mesh)
    known = ufl.sin(2 * place[0]) * ufl.exp(place[last]) + place[1] ** 2
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(-ufl.div(ufl.grad(known)) * v * ufl.dx(metadata={"quadrature_degree": 6}))
    given = _interpolated(spaces.trial, lambda x: np.sin(2 * x[0]) * np.exp(x[last]) + x[1] ** 2)
    a = solve(K, f, Reduction.dirichlet(spaces.trial, fem.dirichletbc(given, _rim(spaces.trial))))

    def exact(x: Array) -> Array:
        return np.sin(2 * x[:, 0]) * np.e + (2 * x[:, 1] if last == 1 else 0.0)

    error = float(np.abs(a.array_r - given.x.array).max() / np.abs(given.x.array).max())
    return _compared(way, spaces, reactions(K, a, f), last, exact, {"temperature_error": error})


def _conduction(way: str, elements: int, problem: Conduction, cell: str) -> Result:
    corners = (0.0, 0.0), (1.0, 1.0)
    if cell == "triangle":
        mesh = triangles(MPI.COMM_SELF, *corners, (elements, elements))
    else:
        mesh = create_rectangle(MPI.COMM_SELF, corners, (elements, elements), CellType[cell])
    spaces = WAYS[way].spaces(mesh, 0)
    u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    dx = ufl.dx(metadata={"quadrature_degree": DEGREE})
    x = ufl.SpatialCoordinate(mesh)
    base = ufl.exp(problem.growth * x[0])
    F = base * (1 + u) * ufl.inner(ufl.grad(u), ufl.grad(v)) * dx
    if not problem.insulated:
        known = ufl.cos(x[0]) * ufl.exp(x[1] / 2) / 2
        F += ufl.div(base * (1 + known) * ufl.grad(known)) * v * dx
    given = _interpolated(spaces.trial, lambda x: problem.temperature(x[0], x[1]))
    held = (
        fem.locate_dofs_geometrical(spaces.trial, lambda x: np.isclose(np.abs(x[0] - 0.5), 0.5))
        if problem.insulated
        else _rim(spaces.trial)
    )
    u.x.array[:] = given.x.array.mean()
    stated = PetrovGalerkinProblem(F, u, fem.dirichletbc(given, held))
    stated.solve()
    (increment,) = stated.increments
    scalars = {
        "temperature_error": np.abs(u.x.array - given.x.array).max() / np.abs(given.x.array).max(),
        "iterations": len(increment.relative_corrections),
    }
    return _compared(way, spaces, stated.reactions(), 0, lambda x: problem.flux(x[:, 1]), scalars)


def _compared(
    way: str,
    spaces: Spaces,
    forces: PETSc.Vec,
    axis: int,
    exact: Callable[[Array], Array],
    further: dict[str, float],
) -> Result:
    """Errors of the flux at the inner nodes of the side x_axis = 1, over the largest flux there."""
    if WAYS[way].evened:
        forces = force_transfer(spaces.trial) * forces
    found = nodal_flux(spaces, forces, lambda x: np.isclose(x[axis], 1.0), WAYS[way].area)
    surface = found.surface
    inside = ~surface.rim
    x, flux = surface.position[inside], found.flux[inside]
    known = exact(x)
    off = np.abs(flux - known) / np.abs(known).max()
    weightless = surface.weight_area < 1e-9 * surface.tributary_area
    if way == "transferred":  # T gives each node its share
        weightless[:] = False
    scalars = {
        "flux_error_median": np.nanmedian(off),
        "flux_error_max": np.nanmax(off),
        "weightless_nodes": weightless[inside].sum(),
        "nodes": len(x),
        **further,
    }
    curves = {"x": x, "flux": flux, "exact_flux": known}
    return _result(scalars, curves, forces.getSize())


def _result(scalars: dict[str, Any], curves: dict[str, Array], dofs: int) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=dofs)


def _interpolated(space: fem.FunctionSpace, field: Callable[[Array], Array]) -> fem.Function:
    function = fem.Function(space)
    function.interpolate(field)
    return function


def _rim(space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """All nodes of the boundary of a unit square or cube."""
    dim = space.mesh.geometry.dim
    return fem.locate_dofs_geometrical(
        space, lambda x: np.isclose(np.abs(x[:dim] - 0.5).max(axis=0), 0.5)
    )


def _cases(
    problem: Callable[..., Result],
    cell: str,
    sizes: tuple[int, ...],
    ways: Iterable[str] = WAYS,
) -> list[Case]:
    return [
        Case(
            "V13",
            f"{problem.__name__}-{way}-{n}",
            problem,
            {"way": way, "elements": n},
            {"element": f"{WAYS[way].element}-{cell}"},
        )
        for way in ways
        for n in sizes
    ]


def _quadrilaterals(n: int) -> Case:
    parameters = {"way": "pw", "elements": n, "cell": "quadrilateral"}
    return Case("V13", f"graded-pw-Q9-{n}", graded, parameters, {"element": "pw-Q9"})


def _trefftz(known: str, degree: int, suffix: str = "", **options: float) -> Case:
    parameters = {"known": known, "degree": degree, **options}
    return Case("V13", f"{known}-trefftz-{degree}{suffix}", trefftz, parameters)


CASES = [
    *_cases(square, "T6", (8, 16, 32)),
    *_cases(cube, "T10", (4,)),
    *_cases(graded, "T6", (16, 32, 64)),
    *_cases(sourced, "T6", (16, 32, 64)),
    *(_trefftz(known, degree) for known in ("graded", "sourced") for degree in (6, 8, 10, 12)),
    *(
        _trefftz(known, degree, "-direct", transformed=False)
        for known, degrees in (("graded", (10, 12, 16, 20)), ("sourced", (6, 8, 10)))
        for degree in degrees
    ),
    *(_trefftz("graded", 10, f"-ratio{ratio:.0f}", ratio=ratio) for ratio in (10.0, 400.0)),
]
CASES = mark_costly(CASES, "graded-[ost]*-64", "sourced-[ost]*-64")
CASES += mark_costly(
    [
        *_cases(square, "T6", (64, 128)),
        *_cases(cube, "T10", (8, 16, 24)),
        *_cases(graded, "T6", (128, 256, 512), ("own", "pw")),
        *_cases(sourced, "T6", (128,), ("own", "pw")),
        *(_quadrilaterals(n) for n in (32, 64, 128, 256)),
    ]
)

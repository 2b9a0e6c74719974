"""Verification of heat fluxes at nodes with prescribed temperature.

The flux at a node is the nodal reaction divided by an area; it is compared with the exact flux.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

from mpi4py import MPI
from petsc4py import PETSc

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, Mesh, create_box, create_rectangle
from matplotlib.figure import Figure

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
from study.benchmarks.v13_fluxes.graded_conduction import (
    ConductionProblem,
    GradedSquareWithHeatSource,
    GradedWallWithInsulatedSides,
)
from study.benchmarks.v13_fluxes.trefftz import (
    TrefftzSolution,
    chebyshev_interpolation_error_of_unknown,
)
from study.judge.checks import check
from study.judge.measures.general import largest, scalar, smallest
from study.model.units import assign_unit_one_to_scalars
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Result, Results

SECTION = "V13"
TITLE = "Fluxes at prescribed nodes, and graded conduction"
FACTS = {
    "geometry": "a unit square and cube; a graded wall, and a graded square with a source",
    "mesh": "4 to 512 elements along a side: triangles, quadrilaterals, tetrahedra",
    "material": "conductivity 1, or exp(g x) (1 + u), which grows a hundredfold across the body",
    "supports": "prescribed temperatures, insulated sides",
    "load": "sources of the known fields",
    "reference": "exact fluxes (Kirchhoff's transformation); Trefftz's method, which shares no "
    "finite element",
    "uncertainty": "the misfit of that method, which is shown",
}
SHORT_FACTS = {
    "reference": "exact fluxes (Kirchhoff's transformation); Trefftz's method",
    "uncertainty": "the misfit of that method, shown",
}

# Problems and exact solutions

PROBLEM = r"""
Where a temperature or a hydraulic head is prescribed, the nodal reactions are the flux that enters the body, and a code
that divides them by areas or passes them on meets the same unevenness. The fluxes are known exactly for Poisson problems
on a square and a cube, and for conduction through a graded wall, whose conductivity grows a hundredfold with position and
also depends on temperature.
"""

THEORY = r"""
Four problems have known fluxes. Two are $-\Delta u = f$ on a square and on a cube, with
$u = \sin\, 2x\, \mathrm{e}^y + y^2$ and $u = \sin\, 2x\, \mathrm{e}^z + y^2$. The other two are steady conduction in a
functionally graded material, whose conductivity $k = \mathrm{e}^{gx} (1 + u)$ grows a hundredfold across a unit square and
also grows with temperature: a *wall* between two surfaces, without a source (exact by Kirchhoff's transformation), and a
square with the source for which $u = \cos\, x\, \mathrm{e}^{y/2}/2$ is the solution.
"""

CONDUCTIVITY_RATIO = 100.0
"""Ratio of the conductivities at x = 1 and x = 0 at equal temperature."""

# Method

METHOD = r"""
**Methods.** Fluxes are obtained in four ways: the reactions of the standard element are divided by geometric areas; they
are divided by the integrals of the element's own test functions; they are redistributed by $\boldsymbol{T}$ and then
divided by geometric areas; and the reactions of the new element are divided by geometric areas, which are the integrals of
its weights. Errors are taken at the inner nodes of one side, relative to the largest flux there.

**An independent answer.** The paper's file ends in a stray, garbled fragment of the next article of its journal, on heat
conduction in graded materials by a boundary-type method. Where its text says “finite method” it must originally have said
“Trefftz method”; E. Kita, Y. Ikeda and N. Kamiya published it. As far as the fragment can be read, these parts of the
method are theirs: the equation is written as a nonlinear Poisson equation; its inhomogeneous term is approximated at
collocation points by a polynomial in the coordinates, which yields the particular solution; and harmonic functions,
determined by the boundary conditions, supply the rest. The degrees, the points, the least-squares fit, the simple
iteration and the problems are ours. No finite elements are involved. The accuracy is limited by how well a polynomial can
follow the unknown, and the temperature of the wall falls steeply and contains a square root. Instead of $u$ one may
therefore solve for $v = \mathrm{e}^{gx/2} (u + u^2/2)$, which also satisfies a Poisson equation with an inhomogeneous
term: $\Delta v = (g/2)^2\, v - \mathrm{e}^{-gx/2}\, Q$. “Degree” is that of the inhomogeneous term in each coordinate.
Both unknowns are tried. The last column is the error made by interpolating the unknown itself with a polynomial of that
degree, which involves no equation.
"""

Array = npt.NDArray[np.float64]

DEGREE = 8
"""Degree of quadrature of integrands that are not polynomials."""
MAX_RELATIVE_WEIGHT_AREA = 1e-9
"""Test-function integral over tributary area up to which the integral counts as zero."""


@dataclass(frozen=True)
class NodalFluxMethod:
    """Method that converts nodal reactions to fluxes.

    Args:
        element: Kind of element, "galerkin" (standard) or "pw" (piecewise-linear test functions).
        make_spaces: Function that makes the element's spaces from a mesh and a number of components
            (0 for scalars).
        area: Area by which reactions are divided: "geometric" for the tributary area, or "weight"
            for the integral of the node's test function.
        applies_force_transfer: Whether reactions are first multiplied by the force-transfer matrix
            T.
    """

    element: str
    make_spaces: Callable[[Mesh, int], Spaces]
    area: Literal["geometric", "weight"] = "geometric"
    applies_force_transfer: bool = False


FLUX_METHODS = {
    "standard": NodalFluxMethod("galerkin", Spaces.galerkin),
    "own": NodalFluxMethod("galerkin", Spaces.galerkin, "weight"),
    "transferred": NodalFluxMethod("galerkin", Spaces.galerkin, applies_force_transfer=True),
    "pw": NodalFluxMethod("pw", Spaces.petrov_galerkin),
}


def square(way: str, elements: int) -> Result:
    """Return errors of the flux at y = 1 of the unit square with u = sin(2 x) exp(y) + y^2.

    Args:
        way: Name of the flux method, a key of `FLUX_METHODS`.
        elements: Number of elements along a side.
    """
    return _solve_poisson_and_compare_flux(
        way, triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (elements, elements))
    )


def cube(way: str, elements: int) -> Result:
    """Return errors of the flux at z = 1 of the unit cube with u = sin(2 x) exp(z) + y^2.

    Args:
        way: Name of the flux method, a key of `FLUX_METHODS`.
        elements: Number of elements along a side.
    """
    corners, divisions = [np.zeros(3), np.ones(3)], [elements] * 3
    return _solve_poisson_and_compare_flux(
        way, create_box(MPI.COMM_SELF, corners, divisions, CellType.tetrahedron)
    )


def graded(
    way: str, elements: int, cell: str = "triangle", ratio: float = CONDUCTIVITY_RATIO
) -> Result:
    """Return errors of the flux at x = 1 of a graded wall without a heat source.

    Args:
        way: Name of the flux method, a key of `FLUX_METHODS`.
        elements: Number of elements along a side.
        cell: "triangle" or "quadrilateral".
        ratio: Ratio of the conductivities at x = 1 and x = 0.
    """
    return _solve_graded_conduction_and_compare_flux(
        way, elements, GradedWallWithInsulatedSides(ratio), cell
    )


def sourced(
    way: str, elements: int, cell: str = "triangle", ratio: float = CONDUCTIVITY_RATIO
) -> Result:
    """Return errors of the flux at x = 1 of a graded square with a heat source.

    Args:
        way: Name of the flux method, a key of `FLUX_METHODS`.
        elements: Number of elements along a side.
        cell: "triangle" or "quadrilateral".
        ratio: Ratio of the conductivities at x = 1 and x = 0.
    """
    return _solve_graded_conduction_and_compare_flux(
        way, elements, GradedSquareWithHeatSource(ratio), cell
    )


def trefftz(
    known: str, degree: int, transformed: bool = True, ratio: float = CONDUCTIVITY_RATIO
) -> Result:
    """Solve a graded conduction problem by Trefftz's method; return errors of temperature and flux.

    Args:
        known: Problem with a known exact solution: "graded" for the wall without a heat source, or
            "sourced" for the square with a heat source.
        degree: Degree of the polynomial that approximates the right side of Poisson's equation.
        transformed: Whether the unknown is the transformed field v; otherwise it is the
            temperature.
        ratio: Ratio of the conductivities at x = 1 and x = 0.
    """
    problem: ConductionProblem = (
        GradedWallWithInsulatedSides(ratio)
        if known == "graded"
        else GradedSquareWithHeatSource(ratio)
    )
    solution = TrefftzSolution(problem, degree, transformed)
    line: Array = np.linspace(0, 1, 33, dtype=np.float64)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    exact = problem.temperature(x, y)
    temperature_error = np.abs(solution.temperature(x, y) - exact).max() / np.abs(exact).max()
    flux, exact_flux = solution.flux(line), problem.flux(line)
    flux_errors = np.abs(flux - exact_flux) / np.abs(exact_flux).max()
    scalars = {
        "temperature_error": temperature_error,
        "flux_error_median": np.median(flux_errors),
        "flux_error_max": flux_errors.max(),
        "boundary_misfit": solution.boundary_misfit,
        "polynomial_error": chebyshev_interpolation_error_of_unknown(problem, degree, transformed),
        "iterations": solution.n_iterations,
    }
    curves = {"x": line, "flux": flux, "exact_flux": exact_flux}
    return _make_dimensionless_result(scalars, curves, solution.n_unknowns)


def _solve_poisson_and_compare_flux(method_name: str, mesh: Mesh) -> Result:
    spaces = FLUX_METHODS[method_name].make_spaces(mesh, 0)
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    axis = mesh.geometry.dim - 1
    x = ufl.SpatialCoordinate(mesh)
    exact = ufl.sin(2 * x[0]) * ufl.exp(x[axis]) + x[1] ** 2
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(-ufl.div(ufl.grad(exact)) * v * ufl.dx(metadata={"quadrature_degree": 6}))
    nodal = _interpolate_field(
        spaces.trial, lambda x: np.sin(2 * x[0]) * np.exp(x[axis]) + x[1] ** 2
    )
    boundary = fem.dirichletbc(nodal, _find_boundary_nodes_of_unit_domain(spaces.trial))
    a = solve(K, f, Reduction.dirichlet(spaces.trial, boundary))

    def exact_flux(x: Array) -> Array:
        return np.sin(2 * x[:, 0]) * np.e + (2 * x[:, 1] if axis == 1 else 0.0)

    error = float(np.abs(a.array_r - nodal.x.array).max() / np.abs(nodal.x.array).max())
    scalars = {"temperature_error": error}
    return _compare_side_flux_with_exact_flux(
        method_name, spaces, reactions(K, a, f), axis, exact_flux, scalars
    )


def _solve_graded_conduction_and_compare_flux(
    method_name: str, elements: int, problem: ConductionProblem, cell: str
) -> Result:
    corners = (0.0, 0.0), (1.0, 1.0)
    if cell == "triangle":
        mesh = triangles(MPI.COMM_SELF, *corners, (elements, elements))
    else:
        mesh = create_rectangle(MPI.COMM_SELF, corners, (elements, elements), CellType[cell])
    spaces = FLUX_METHODS[method_name].make_spaces(mesh, 0)
    u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    dx = ufl.dx(metadata={"quadrature_degree": DEGREE})
    x = ufl.SpatialCoordinate(mesh)
    base = ufl.exp(problem.growth * x[0])
    F = base * (1 + u) * ufl.inner(ufl.grad(u), ufl.grad(v)) * dx
    if not problem.is_insulated:
        exact = ufl.cos(x[0]) * ufl.exp(x[1] / 2) / 2
        F += ufl.div(base * (1 + exact) * ufl.grad(exact)) * v * dx
    nodal = _interpolate_field(spaces.trial, lambda x: problem.temperature(x[0], x[1]))
    prescribed = (
        fem.locate_dofs_geometrical(spaces.trial, lambda x: np.isclose(np.abs(x[0] - 0.5), 0.5))
        if problem.is_insulated
        else _find_boundary_nodes_of_unit_domain(spaces.trial)
    )
    u.x.array[:] = nodal.x.array.mean()
    nonlinear = PetrovGalerkinProblem(F, u, fem.dirichletbc(nodal, prescribed))
    nonlinear.solve()
    (increment,) = nonlinear.increments
    scalars = {
        "temperature_error": np.abs(u.x.array - nodal.x.array).max() / np.abs(nodal.x.array).max(),
        "iterations": len(increment.relative_corrections),
    }
    forces = nonlinear.reactions()
    return _compare_side_flux_with_exact_flux(
        method_name, spaces, forces, 0, lambda x: problem.flux(x[:, 1]), scalars
    )


def _compare_side_flux_with_exact_flux(
    method_name: str,
    spaces: Spaces,
    nodal_reactions: PETSc.Vec,
    normal_axis: int,
    exact_flux: Callable[[Array], Array],
    other_scalars: dict[str, float],
) -> Result:
    """Compare nodal fluxes with exact ones at inner nodes of a side of the unit square or cube.

    Errors are relative to the largest exact flux at these nodes.

    Args:
        method_name: Name of the flux method, a key of `FLUX_METHODS`.
        spaces: Scalar spaces of the element.
        nodal_reactions: Nodal reactions.
        normal_axis: Axis normal to the side; the side is that at coordinate 1.
        exact_flux: Function that returns exact fluxes (n,) at points (n, dim).
        other_scalars: Further scalars of the result.
    """
    method = FLUX_METHODS[method_name]
    if method.applies_force_transfer:
        nodal_reactions = force_transfer(spaces.trial) * nodal_reactions
    side = nodal_flux(
        spaces, nodal_reactions, lambda x: np.isclose(x[normal_axis], 1.0), method.area
    )
    surface = side.surface
    inside = ~surface.rim
    x, flux = surface.position[inside], side.flux[inside]
    exact = exact_flux(x)
    errors = np.abs(flux - exact) / np.abs(exact).max()
    is_weightless = surface.weight_area < MAX_RELATIVE_WEIGHT_AREA * surface.tributary_area
    if method.applies_force_transfer:  # T gives weight to each node
        is_weightless[:] = False
    scalars = {
        "flux_error_median": np.nanmedian(errors),
        "flux_error_max": np.nanmax(errors),
        "weightless_nodes": is_weightless[inside].sum(),
        "nodes": len(x),
        **other_scalars,
    }
    curves = {"x": x, "flux": flux, "exact_flux": exact}
    return _make_dimensionless_result(scalars, curves, nodal_reactions.getSize())


def _make_dimensionless_result(
    scalars: dict[str, Any], curves: dict[str, Array], dofs: int
) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, assign_unit_one_to_scalars(numbers), curves, dofs=dofs)


def _interpolate_field(space: fem.FunctionSpace, field: Callable[[Array], Array]) -> fem.Function:
    function = fem.Function(space)
    function.interpolate(field)
    return function


def _find_boundary_nodes_of_unit_domain(space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Return the indices of the nodes on the boundary of the unit square or cube."""
    dim = space.mesh.geometry.dim
    return fem.locate_dofs_geometrical(
        space, lambda x: np.isclose(np.abs(x[:dim] - 0.5).max(axis=0), 0.5)
    )


# Cases


def _make_flux_cases(
    problem: Callable[..., Result],
    cell: str,
    elements_per_side: tuple[int, ...],
    method_names: Iterable[str] = FLUX_METHODS,
) -> list[Case]:
    return [
        Case(
            "V13",
            f"{problem.__name__}-{way}-{n}",
            problem,
            {"way": way, "elements": n},
            {"element": f"{FLUX_METHODS[way].element}-{cell}"},
        )
        for way in method_names
        for n in elements_per_side
    ]


def _make_quadrilateral_graded_wall_case(elements_per_side: int) -> Case:
    parameters = {"way": "pw", "elements": elements_per_side, "cell": "quadrilateral"}
    return Case(
        "V13", f"graded-pw-Q9-{elements_per_side}", graded, parameters, {"element": "pw-Q9"}
    )


def _make_trefftz_case(known: str, degree: int, suffix: str = "", **options: float) -> Case:
    parameters = {"known": known, "degree": degree, **options}
    return Case("V13", f"{known}-trefftz-{degree}{suffix}", trefftz, parameters)


CASES = [
    *_make_flux_cases(square, "T6", (8, 16, 32)),
    *_make_flux_cases(cube, "T10", (4,)),
    *_make_flux_cases(graded, "T6", (16, 32, 64)),
    *_make_flux_cases(sourced, "T6", (16, 32, 64)),
    *(
        _make_trefftz_case(known, degree)
        for known in ("graded", "sourced")
        for degree in (6, 8, 10, 12)
    ),
    *(
        _make_trefftz_case(known, degree, "-direct", transformed=False)
        for known, degrees in (("graded", (10, 12, 16, 20)), ("sourced", (6, 8, 10)))
        for degree in degrees
    ),
    *(
        _make_trefftz_case("graded", 10, f"-ratio{ratio:.0f}", ratio=ratio)
        for ratio in (10.0, 400.0)
    ),
]
CASES = mark_costly(CASES, "graded-[ost]*-64", "sourced-[ost]*-64")
CASES += mark_costly(
    [
        *_make_flux_cases(square, "T6", (64, 128)),
        *_make_flux_cases(cube, "T10", (8, 16, 24)),
        *_make_flux_cases(graded, "T6", (128, 256, 512), ("pw",)),
        *_make_flux_cases(sourced, "T6", (128,), ("pw",)),
        *(_make_quadrilateral_graded_wall_case(n) for n in (32, 64, 128, 256)),
    ]
)

# Results

DETAILS = r"""
{% call table("v13-fluxes-errors", "Fluxes: errors.") %}
| Method | Square, 32: median | largest error | Cube, 8: median | largest error | nodes without weight | Graded wall, 64: median | largest error | temperature | Graded, source, 64: largest error | temperature |
|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|
{% for way, name in (("standard", "standard element"), ("own", "standard, own weights"), ("transferred", "standard, times T"), ("pw", "new element")) %}{% set square = "V13/square-" ~ way ~ "-32" %}{% set cube = "V13/cube-" ~ way ~ "-8" %}{% set wall = "V13/graded-" ~ way ~ "-64" %}{% set sourced = "V13/sourced-" ~ way ~ "-64" %}
| {{ name }} | {{ num(s(square, "flux_error_median"), 2) }} | {{ num(s(square, "flux_error_max"), 2) }} | {{ num(s(cube, "flux_error_median"), 2) }} | {{ num(s(cube, "flux_error_max"), 2) }} | {{ fixed(s(cube, "weightless_nodes"), 0) }} of {{ fixed(s(cube, "nodes"), 0) }} | {{ num(s(wall, "flux_error_median"), 2) }} | {{ num(s(wall, "flux_error_max"), 2) }} | {{ num(s(wall, "temperature_error"), 2) }} | {{ num(s(sourced, "flux_error_max"), 2) }} | {{ num(s(sourced, "temperature_error"), 2) }} |
{% endfor %}
{% endcall %}

{% call table("v13-trefftz-s-method-errors", "Trefftz's method: errors.") %}
| Trefftz's method | unknown | degree | temperature | flux: largest error | iterations | unknown, interpolated |
|---|---|---:|---:|---:|---:|---:|
{% for known, name, suffix, unknown, degrees in (("graded", "graded wall", "", "v", (6, 8, 10, 12)), ("graded", "graded wall", "-direct", "u", (10, 12, 16, 20)), ("sourced", "graded, source", "", "v", (6, 8, 10, 12)), ("sourced", "graded, source", "-direct", "u", (6, 8, 10))) %}{% for degree in degrees %}{% set case = "V13/" ~ known ~ "-trefftz-" ~ degree ~ suffix %}
| {{ name }} | *{{ unknown }}* | {{ degree }} | {{ num(s(case, "temperature_error"), 2) }} | {{ num(s(case, "flux_error_max"), 2) }} | {{ fixed(s(case, "iterations"), 0) }} | {{ num(s(case, "polynomial_error"), 2) }} |
{% endfor %}{% endfor %}
{% endcall %}

{% call table("v13-finer-meshes", "Finer meshes.") %}
| Finer meshes: new element | elements | flux: median | largest error | temperature |
|---|---:|---:|---:|---:|
{% for case, name, n in (("square-pw-64", "square", 64), ("square-pw-128", "square", 128), ("cube-pw-16", "cube", 16), ("cube-pw-24", "cube", 24), ("graded-pw-128", "graded wall", 128), ("graded-pw-256", "graded wall", 256), ("graded-pw-512", "graded wall", 512), ("graded-pw-Q9-256", "graded wall, quadrilaterals", 256), ("sourced-pw-128", "graded, source", 128)) %}
| {{ name }} | {{ n }} | {{ num(s("V13/" ~ case, "flux_error_median"), 2) }} | {{ num(s("V13/" ~ case, "flux_error_max"), 2) }} | {{ num(s("V13/" ~ case, "temperature_error"), 2) }} |
{% endfor %}
{% endcall %}

<p class="note">The last table, the cube with 8 elements a side, quadrilaterals, and the graded walls with 64 elements
(other than the new element's) come from a longer series that is computed and compared by <code>./run nightly</code>.</p>
"""

PLOT_LOOKS = {
    "standard": ELEMENT_LOOK["galerkin-T6"] | {"label": "standard T6"},
    "own": {"color": "#B87A00", "marker": "s", "label": "standard T6, own-function"},
    "transferred": ELEMENT_LOOK["transferred-T10"] | {"label": "standard T6, times T"},
    "pw": ELEMENT_LOOK["pw-T6"] | {"label": "new T6"},
}
PLOT_SIZES = (16, 32, 64)
"""Numbers of elements along a side of the graded wall."""
PLOT_SQUARE_KEY, PLOT_WALL_KEY = "V13/square-{}-8", "V13/graded-{}-16"
PLOT_TREFFTZ_KEY = "V13/graded-trefftz-10"


def draw_nodal_fluxes_and_errors(results: Results) -> Figure:
    """Draw nodal fluxes at nodes with prescribed temperature, and their errors.

    The panels show the fluxes along one side of the square, the fluxes along one side of the graded
    wall, and the largest errors for the wall over the number of elements.
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.3))
    for ax, key, axis in ((axes[0], PLOT_SQUARE_KEY, 0), (axes[1], PLOT_WALL_KEY, 1)):
        for way, look in PLOT_LOOKS.items():
            curves = results.curves(key.format(way))
            size = np.abs(curves["exact_flux"]).max()
            x, style = curves["x"][:, axis], "-" if way == "standard" else "none"
            small = {"markersize": 2.5, "linewidth": 0.6, "linestyle": style}
            ax.plot(x, curves["flux"] / size, **look | small)
        exact = ELEMENT_LOOK["exact"] | {"linewidth": 0.8, "zorder": 3}
        ax.plot(x, curves["exact_flux"] / size, **exact)
    curves = results.curves(PLOT_TREFFTZ_KEY)
    size = np.abs(curves["exact_flux"]).max()
    look = {"color": "#6A4C93", "marker": "x", "linestyle": "none", "markersize": 4, "zorder": 4}
    axes[1].plot(curves["x"][::4], curves["flux"][::4] / size, label="Trefftz", **look)
    axes[0].set(title="(a) square", xlabel="$x$", ylabel="flux / largest exact one")
    axes[1].set(title="(b) graded wall", xlabel="$y$")
    axes[1].legend(
        handles=[line for line in axes[1].lines if line.get_label() == "Trefftz"], loc="upper right"
    )
    for way, look in PLOT_LOOKS.items():
        errors = [results.scalar(f"V13/graded-{way}-{n}", "flux_error_max") for n in PLOT_SIZES]
        axes[2].loglog(PLOT_SIZES, errors, **look)
    axes[2].set(title="(c) graded wall", xlabel="elements along a side", ylabel="largest error")
    axes[2].set_xticks(PLOT_SIZES, [str(n) for n in PLOT_SIZES])
    axes[2].minorticks_off()
    axes[2].legend(handles=axes[0].lines, loc="center", bbox_to_anchor=(0.55, 0.72), fontsize=6)
    return fig


FIGURES = [
    PageFigure(
        "v13_fluxes",
        draw_nodal_fluxes_and_errors,
        needs=[
            *(key.format(way) for key in (PLOT_SQUARE_KEY, PLOT_WALL_KEY) for way in PLOT_LOOKS),
            *(f"V13/graded-{way}-{n}" for way in PLOT_LOOKS for n in PLOT_SIZES[1:]),
            PLOT_TREFFTZ_KEY,
        ],
        caption="Fluxes from nodal reactions (over tributary areas, unless marked own-function) against "
        "the exact flux (line): (a) on the upper side of the square, 8 elements along it; (b) "
        "where heat enters the graded wall, 16 elements (crosses: Trefftz method, degree 10). "
        "(c) Largest error at any inner node, over the largest flux.",
        alt="Two plots of flux along a side: the standard element's zigzags by a third about the exact "
        "curve, all others lie on it. A third plot of errors over elements: the standard one's "
        "stays at a third, the others fall fourfold with each halving.",
    ),
]

VERIFICATION = r"""
| flux into a square | exact | flux, largest | {{ pct(s("V13/square-pw-32", "flux_error_max")) }} | {{ pct(s("V13/square-own-32", "flux_error_max")) }} |
"""

# Findings

CHECKS = [
    check(
        "V13-standard",
        "Fluxes: divided by geometric areas, the standard element's largest error does not "
        "fall with refinement.",
        lambda results: smallest(
            results,
            section="V13",
            cases="(square|graded|sourced)-standard-.*",
            name="flux_error_max",
        ),
        ">",
        0.3,
        tolerance_why="none: a third is what even flux gives",
        tolerance_set="after",
        why="A mid-side node's test function integrates to two thirds of a side, whose half is "
        "the node's share; vertices' to the rest.",
    ),
    check(
        "V13-square-max",
        "Fluxes, square, 32 elements: largest error of the new element, over the largest flux.",
        lambda results: scalar(results, key="V13/square-pw-32", name="flux_error_max"),
        "<",
        0.0026,
        tolerance_why="none: what a prototype gave",
        tolerance_set="before",
        why="As its median.",
    ),
    check(
        "V13-trefftz",
        "Graded conduction with and without a source, ratio 100: with Trefftz's method of "
        "degree 10 temperatures are exact.",
        lambda results: largest(
            results, section="V13", cases="(graded|sourced)-trefftz-10", name="temperature_error"
        ),
        "<",
        1e-10,
        tolerance_why="none: 1e-10 was asked for before it was computed",
        tolerance_set="before",
        why="Polynomials approximate an entire function faster than any power, and the unknown "
        "is one.",
    ),
]

FINDINGS = r"""
The standard element's fluxes over tributary areas zigzag on every mesh ({{ ref("v13_fluxes") }}). Divided by the integrals
of the nodes' own shape functions they are as good as the new element's (largest error
{{ pct(s("V13/square-own-32", "flux_error_max")) }} against {{ pct(s("V13/square-pw-32", "flux_error_max")) }} on the
square), provided that the integral is not zero. On the cube it is zero at
{{ fixed(s("V13/cube-standard-8", "weightless_nodes"), 0) }} of {{ fixed(s("V13/cube-standard-8", "nodes"), 0) }} nodes.
$\boldsymbol{T}$ repairs the fluxes everywhere. On the wall a Trefftz method, which shares nothing with finite elements,
gives the exact temperatures to {{ num(s("V13/graded-trefftz-12", "temperature_error"), 1) }}. It was suggested by a fragment
of another article, with which our copy of the paper happens to end {{ cite("kita") }}. The new element's temperatures on
64 × 64 squares are exact to {{ num(s("V13/graded-pw-64", "temperature_error"), 1) }} (both relative).

{{ figure("v13_fluxes") }}
"""

FURTHER_FINDINGS = r"""
1. **With the source** the largest error is {{ num(s("V13/sourced-own-64", "flux_error_max"), 2) }} with the standard
   element's own weights and {{ num(s("V13/sourced-pw-64", "flux_error_max"), 2) }} with the new element. The new element
   needs neither remedy: its nodal values can be passed on as they are.
2. **Fluxes are of second order**: on the graded wall, halving the element size divides the largest error of the new
   element by
   {{ fixed(1 / measure("ratio", key="V13/graded-pw-64", other="V13/graded-pw-32", name="flux_error_max"), 1) }}.
3. **The accuracy of Trefftz's method depends on the unknown.** With $v$, degree 10 is exact to
   {{ num(s("V13/graded-trefftz-10", "temperature_error"), 2) }} on the wall and
   {{ num(s("V13/sourced-trefftz-10", "temperature_error"), 2) }} with the source. With $u$ itself, the error on the wall is
   {{ num(s("V13/graded-trefftz-10-direct", "temperature_error"), 2) }}, and still
   {{ num(s("V13/graded-trefftz-20-direct", "temperature_error"), 2) }} with degree 20: polynomials of these degrees cannot
   come closer (last column). The iteration with $v$ contracts by the factor $(g/2)^2/\pi^2$ on the wall. It takes
   {{ fixed(s("V13/graded-trefftz-10", "iterations"), 0) }} steps for a conductivity ratio of 100,
   {{ fixed(s("V13/graded-trefftz-10-ratio10", "iterations"), 0) }} for 10 and
   {{ fixed(s("V13/graded-trefftz-10-ratio400", "iterations"), 0) }} for 400 (error
   {{ num(s("V13/graded-trefftz-10-ratio400", "temperature_error"), 2) }}), and cannot converge from a ratio of
   $\mathrm{e}^{2\pi} = 535$ on.
4. **The two methods agree.** The nodal temperatures of the new element are exact to
   {{ num(s("V13/sourced-pw-64", "temperature_error"), 2) }} with the source (64 × 64 squares, triangles) and to
   {{ num(s("V13/graded-pw-Q9-128", "temperature_error"), 2) }} on the wall with 128 × 128 quadrilaterals. On the
   quadrilaterals they are of fourth order ({{ num(s("V13/graded-pw-Q9-32", "temperature_error"), 2) }},
   {{ num(s("V13/graded-pw-Q9-64", "temperature_error"), 2) }} with 32 and 64). On triangles, whose diagonals have no mirror
   image across an insulated side, they are of third order: {{ num(s("V13/graded-pw-64", "temperature_error"), 2) }} with 64,
   {{ num(s("V13/graded-pw-512", "temperature_error"), 2) }} with 512.
"""

# Limits

LIMITS = r"""
The sides are flat and the meshes structured. Nodes at the ends or edges of a side are left out, because where another side
with prescribed values meets it, a reaction belongs to both sides. The examples of the article itself are not known.
"""

"""Verification of stiffness, mass and geometric stiffness by problems with exact solutions.

The problems are free vibration, buckling, and axisymmetric bodies under pressure.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from matplotlib.figure import Figure

from pw_elements import (
    Body,
    Material,
    Reduction,
    assemble_matrix,
    buckling,
    lumped_mass,
    prescribe,
    solve,
    vibration_modes,
)
from pw_elements.algebra import VibrationModes
from pw_elements.elasticity import StressState
from pw_elements.spaces import Marker
from study.benchmarks.v8_vibration.exact_eigenvalues import (
    AxisymmetricRodBetweenWalls,
    eigenvalues_of_rectangle_between_walls,
)
from study.benchmarks.v8_vibration.mesh_series import (
    MeshSolution,
    compare_values_on_mesh_series_with_exact,
    mesh_rectangle_with_bent_inner_lines,
    mesh_solid_box,
)
from study.judge.checks import check
from study.judge.measures.general import scalar, smallest
from study.model.discretisation import (
    Discretisation,
    discretise,
    is_symmetrised,
    make_element_spaces,
    reduction_for_mass_condensation,
    requires_quadrilateral_cells,
)
from study.model.units import assign_unit_one_to_scalars
from study.paper.s7_6_exact import CompressedStrip
from study.publish.plots.style import ELEMENT_LOOK, LABEL_BOX, PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Result, Results

SECTION = "V8"
TITLE = "Vibration with known answers"
FACTS = {
    "geometry": "a rod (radius 1/2, length 1), a unit square, a strip 8 × 1, free bodies, a tube of "
    "the radii 1 and 2, a cylinder",
    "mesh": "4, 8, 16 and 32 squares over a side (strip: 1, 2, 4 and 8 over its height), inner "
    "lines bent",
    "material": "linear elastic, axisymmetric, plane stress and solid; E = 1, ν = 0.3, density 1",
    "supports": "smooth walls, simple supports, or none",
    "load": "free vibration; axial compression of the strip; internal or external pressure",
    "reference": "Pochhammer's and Chree's equation, plane waves, Rayleigh and Lamb, Lamé",
    "uncertainty": "roots are found numerically to round-off",
}
SHORT_FACTS = {
    "reference": "Pochhammer and Chree, plane waves, Rayleigh and Lamb, Lamé",
    "uncertainty": "roots are found to round-off",
}
MACROS = r"""
{% set variants = [
    ("galerkin-T6", "standard T6"),
    ("pw-T6", "new T6"),
    ("pwsym-T6", "new T6, symmetrised"),
    ("pw-T6-lumped", "new T6, lumped mass"),
    ("composite-T6", "composite T6"),
    ("galerkin-Q8", "standard Q8"),
    ("pw-Q9-nine", "new quadrilateral, all nine nodes"),
    ("pw-Q9", "new quadrilateral, centre by Guyan"),
    ("pw-Q8", "new Q8, pair by Guyan"),
    ("pw-Q8-same", "new Q8, pair by Guyan with L = R"),
    ("pw-Q8-lumped", "new Q8, lumped mass, pair by Guyan"),
] %}
"""

# Problems and exact solutions

THEORY = r"""
The geometry behind Table 1 is lost, so its eigenvalues have no exact counterpart. The following problems do have an
exact solution:

- a round rod (radius 1/2, length 1, $E = \rho = 1$, $\nu = 0.3$) whose ends stand against smooth rigid walls, in
  axisymmetric vibration: the eigenvalues are roots of the Pochhammer–Chree frequency equation {{ cite("pochhammer") }}
  for the wave numbers $k = n\pi/L$. The smallest roots are found numerically: $\omega^2$ =
  {% for n in range(1, 7) %}{{ fixed(s("V8/rod-pw-T6", "omega2_" ~ n ~ "_exact"), 8) }}{{ ", " if n < 6 else "" }}{% endfor %};
- a square in plane stress on rollers all around: waves $u = A\, \sin\, kx\, \cos\, ly$,
  $v = B\, \cos\, kx\, \sin\, ly$, which are dilatational if $(A, B)$ is parallel to $(k, l)$ and shear waves if it is perpendicular, give
  $\omega^2 = c^2\, (k^2 + l^2)$ with the wave speed $c$; many of these eigenvalues are double;
- a strip, $L/h = 8$, simply supported: $\omega^2\, \rho/k^2$ of its bending modes equals the critical stress of the same
  shape under uniform compression (form G), because both add the same multiple of the displacements to the equilibrium of
  the strip, so that one number tests $\boldsymbol{K}$, $\boldsymbol{K}_\sigma$ and $\boldsymbol{M}$;
- unsupported bodies;
- a tube (radii 1 and 2) under internal pressure and a solid cylinder under external pressure.
"""

Array = npt.NDArray[np.float64]
Support = tuple[int, float, int]
"""Axis and value of a coordinate that define a plane, and the displacement component that is zero
on it.
"""

# E, the density and a length of each body are one: all numbers are dimensionless
MATERIAL = Material(1.0, 0.3)
N_MODES = 6
EIGENVALUE_NAMES = [f"omega2_{n}" for n in range(1, N_MODES + 1)]
ROD = AxisymmetricRodBetweenWalls(MATERIAL, radius=0.5, length=1.0)
ROD_WALLS: list[Support] = [(0, 0.0, 0), (1, 0.0, 1), (1, ROD.length, 1)]
STRIP_LENGTH = 8.0
"""Ratio of the strip's length to its height."""
N_STRIP_MODES = 3
"""Number of bending modes that are compared; they are the lowest modes of the strip."""
RIGID_MODE_COUNTS = {StressState.PLANE_STRESS: 3, StressState.AXISYMMETRIC: 1, StressState.SOLID: 6}
TUBE_RADII = (1.0, 2.0)
QUADRATURE_DEGREES, REFERENCE_DEGREE = (2, 4, 6, 8), 16

# Method

METHOD = r"""
Eigenvalues are computed by shift-and-invert iteration with a small negative shift, for which the matrix is regular even
if the body is free. Modes whose eigenvalue is zero to within the round-off of the eigenvalues of single elements are
counted as rigid. The inner mesh lines are curved. Condensed nodes are eliminated by Guyan's reduction:
$\boldsymbol{K}_r = \boldsymbol{L}^\mathrm{T} \boldsymbol{K} \boldsymbol{R}$,
$\boldsymbol{M}_r = \boldsymbol{L}^\mathrm{T} \boldsymbol{M} \boldsymbol{R}$, with $\boldsymbol{L}$ from the transposed
problem or, as in a symmetric code, $\boldsymbol{L} = \boldsymbol{R}$; $\boldsymbol{K}_r$ is the same in both cases. The lumped mass
has the row sums of $\boldsymbol{M}$ on its diagonal. “Symmetrised” means that the symmetric parts of both matrices are
used. The largest relative residual of all computed pairs is
{{ num(measure("largest", section="V8", cases="(rod|square|strip|free-.*)-.*", name="residual"), 1) }}.
"""

Treatment = Literal["transposed", "same", "all nodes", "lumped"]
"""Treatment of inner nodes and of the mass matrix.

"all nodes" keeps all nodes. The others condense inner nodes out: "transposed" with the left
reduction L of the transposed problem, "same" with L equal to the right reduction R. "lumped" is
"transposed" with a lumped mass.
"""


def rod(element: str, treatment: Treatment, squares: Sequence[int]) -> Result:
    """Compute eigenvalues of a round rod between smooth rigid walls in axisymmetry.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        treatment: Treatment of inner nodes and mass (see `Treatment`).
        squares: Numbers of squares over the radius, from coarse to fine.
    """

    def solve_on_mesh(n: int) -> MeshSolution:
        sizes, divisions = (ROD.radius, ROD.length), (n, 2 * n)
        body = _discretise_rectangle(element, sizes, divisions, StressState.AXISYMMETRIC)
        modes = _compute_vibration_modes(body, ROD_WALLS, N_MODES, treatment)
        return modes.eigenvalues, _measure_quality_of_modes(modes), body

    return compare_values_on_mesh_series_with_exact(
        solve_on_mesh, squares, EIGENVALUE_NAMES, ROD.eigenvalues(N_MODES)
    )


def square(element: str, treatment: Treatment, squares: Sequence[int]) -> Result:
    """Compute eigenvalues of a square in plane stress that is supported by rollers on all sides.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        treatment: Treatment of inner nodes and mass (see `Treatment`).
        squares: Numbers of squares along a side, from coarse to fine.
    """
    rollers: list[Support] = [(i, x, i) for i in (0, 1) for x in (0.0, 1.0)]

    def solve_on_mesh(n: int) -> MeshSolution:
        body = _discretise_rectangle(element, (1.0, 1.0), (n, n), StressState.PLANE_STRESS)
        modes = _compute_vibration_modes(body, rollers, N_MODES, treatment)
        return modes.eigenvalues, _measure_quality_of_modes(modes), body

    exact = eigenvalues_of_rectangle_between_walls(
        MATERIAL, StressState.PLANE_STRESS, (1.0, 1.0), N_MODES
    )
    return compare_values_on_mesh_series_with_exact(solve_on_mesh, squares, EIGENVALUE_NAMES, exact)


def strip(element: str, treatment: Treatment, squares: Sequence[int]) -> Result:
    """Compute bending vibrations and buckling stresses of a simply supported strip.

    The values `vibration_n` are rho omega^2 / k^2 with the wave number k, and the values
    `buckling_n` are critical stresses; both have the same exact value. In vibration the strip has a
    rigid mode along its axis; in buckling one corner is fixed.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        treatment: Treatment of inner nodes and mass (see `Treatment`).
        squares: Numbers of squares over the height, from coarse to fine.
    """
    ends: list[Support] = [(0, 0.0, 1), (0, STRIP_LENGTH, 1)]
    modes = range(1, N_STRIP_MODES + 1)
    wave_numbers = np.array(modes) * np.pi / STRIP_LENGTH

    def solve_on_mesh(n: int) -> MeshSolution:
        sizes, divisions = (STRIP_LENGTH, 1.0), (int(STRIP_LENGTH) * n, n)
        body = _discretise_rectangle(element, sizes, divisions, StressState.PLANE_STRESS)
        vibration = _compute_vibration_modes(body, ends, N_STRIP_MODES + 1, treatment)
        stress = MATERIAL.density * vibration.eigenvalues[1:] / wave_numbers**2
        corner = prescribe(body.space, 0, lambda x: np.isclose(x[0], 0.0) & np.isclose(x[1], 0.0))
        prestress = fem.Constant(body.body.spaces.mesh, np.array([[-1.0, 0.0], [0.0, 0.0]]))
        critical = buckling(
            body.K,
            assemble_matrix(body.body.geometric_stiffness(prestress)),
            _reduce_by_supports_and_mass_condensation(
                body, [*_make_support_conditions(body, ends), corner], treatment
            ),
            N_STRIP_MODES,
            is_symmetrised(element),
        )
        quality = _measure_quality_of_modes(vibration)
        quality["residual"] = max(quality["residual"], critical.residuals.max())
        quality["imaginary"] = max(quality["imaginary"], critical.imaginary_ratio)
        return np.concatenate([stress, critical.factors]), quality, body

    theory = CompressedStrip(MATERIAL.youngs_modulus, MATERIAL.poissons_ratio, STRIP_LENGTH)
    exact = [theory.exact_critical_stress(n, "G") for n in modes]
    names = [f"{kind}_{n}" for kind in ("vibration", "buckling") for n in modes]
    return compare_values_on_mesh_series_with_exact(solve_on_mesh, squares, names, exact * 2)


def free(element: str, state: str) -> Result:
    """Compute the rigid modes of an unsupported body (in axisymmetry, u_r = 0 on the axis).

    The scalar `rigid` is the number of modes with zero frequency, and `rigid_error` this number
    minus the exact number. `zero` is the largest eigenvalue of these modes over the smallest
    elastic one.

    Args:
        element: Element name such as "pw-T6" or "galerkin-T10".
        state: Name of the stress state.
    """
    stress_state = StressState(state)
    build_square = partial(mesh_rectangle_with_bent_inner_lines, (1.0, 1.0), (6, 6))
    build = mesh_solid_box if stress_state is StressState.SOLID else build_square
    body = discretise(element, build, MATERIAL, stress_state)
    axis: list[Support] = [(0, 0.0, 0)] if stress_state is StressState.AXISYMMETRIC else []
    modes = _compute_vibration_modes(body, axis, N_MODES + 1, "transposed")
    eigenvalues = np.abs(modes.eigenvalues)
    scalars = {
        "zero": eigenvalues[: modes.n_rigid].max() / eigenvalues[modes.n_rigid],
        "rigid_error": float(modes.n_rigid - RIGID_MODE_COUNTS[stress_state]),
    }
    scalars |= _measure_quality_of_modes(modes)
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=body.K.getSize()[0])


def tube(element: str, squares: Sequence[int]) -> Result:
    """Solve Lamé's tube under internal pressure between smooth rigid walls.

    The value `displacement` is one plus the largest error of a nodal displacement over the largest
    displacement. Its exact value is one, so its relative error is the displacement error.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        squares: Numbers of squares across the wall of the tube, from coarse to fine.
    """
    inner_radius, outer = TUBE_RADII
    E, nu = MATERIAL.youngs_modulus, MATERIAL.poissons_ratio

    def exact_radial_displacement(r: Array) -> Array:
        factor = (1 + nu) / E * inner_radius**2 / (outer**2 - inner_radius**2)
        return factor * ((1 - 2 * nu) * r + outer**2 / r)

    def solve_on_mesh(n: int) -> MeshSolution:
        sizes = (outer - inner_radius, 1.0)
        body = _discretise_rectangle(element, sizes, (n, n), StressState.AXISYMMETRIC, inner_radius)
        inside = partial(_is_at_coordinate, 0, inner_radius)
        error = _largest_axisymmetric_displacement_error(
            body, [], inside, (1.0, 0.0), exact_radial_displacement
        )
        return np.array([1 + error]), {}, body

    return compare_values_on_mesh_series_with_exact(solve_on_mesh, squares, ["displacement"], [1.0])


def cylinder(element: str) -> Result:
    """Solve a solid cylinder under external pressure; return the largest displacement error.

    The exact displacement u_r = c r is a trial function, so the error should be round-off.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
    """
    body = _discretise_rectangle(element, (1.0, 1.0), (4, 4), StressState.AXISYMMETRIC)
    E, nu = MATERIAL.youngs_modulus, MATERIAL.poissons_ratio
    factor = -(1 + nu) * (1 - 2 * nu) / E
    axis: list[Support] = [(0, 0.0, 0)]
    outside = partial(_is_at_coordinate, 0, 1.0)
    error = _largest_axisymmetric_displacement_error(
        body, axis, outside, (-1.0, 0.0), lambda r: factor * r
    )
    scalars = {"displacement_error": error}
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=body.K.getSize()[0])


def quadrature(element: str, squares: int) -> Result:
    """Compute eigenvalues of the rod with several degrees of quadrature.

    The curve `change` contains, for each entry of the curve `degree`, the largest relative
    difference of an eigenvalue from that with `REFERENCE_DEGREE`. The scalar `error` is the largest
    relative error with `REFERENCE_DEGREE`.

    Args:
        element: Element name such as "pw-T6".
        squares: Number of squares over the radius.
    """
    eigenvalues = {}
    sizes, divisions = (ROD.radius, ROD.length), (squares, 2 * squares)
    cell = "quadrilateral" if requires_quadrilateral_cells(element) else "triangle"
    for degree in (*QUADRATURE_DEGREES, REFERENCE_DEGREE):
        element_spaces = make_element_spaces(
            element, mesh_rectangle_with_bent_inner_lines(sizes, divisions, cell)
        )
        body = Body(element_spaces, MATERIAL, StressState.AXISYMMETRIC, quadrature_degree=degree)
        discretised = Discretisation(element, body, assemble_matrix(body.stiffness()))
        modes = _compute_vibration_modes(discretised, ROD_WALLS, N_MODES, "all nodes")
        eigenvalues[degree] = modes.eigenvalues
    reference = eigenvalues[REFERENCE_DEGREE]
    change = [np.abs(eigenvalues[degree] / reference - 1).max() for degree in QUADRATURE_DEGREES]
    error = np.abs(reference / ROD.eigenvalues(N_MODES) - 1).max()
    scalars = {"error": error} | {
        f"change_{degree}": value for degree, value in zip(QUADRATURE_DEGREES, change, strict=True)
    }
    curves = {"degree": np.array(QUADRATURE_DEGREES), "change": np.array(change)}
    return Result(
        scalars, assign_unit_one_to_scalars(scalars), curves, dofs=discretised.K.getSize()[0]
    )


def _compute_vibration_modes(
    body: Discretisation, supports: list[Support], count: int, treatment: Treatment
) -> VibrationModes:
    M = assemble_matrix(body.body.mass())
    if treatment == "lumped":
        M = lumped_mass(M, body.space)
    reduction = _reduce_by_supports_and_mass_condensation(
        body, _make_support_conditions(body, supports), treatment
    )
    return vibration_modes(body.K, M, reduction, count, is_symmetrised(body.element))


def _reduce_by_supports_and_mass_condensation(
    body: Discretisation, conditions: list[fem.DirichletBC], treatment: Treatment
) -> Reduction:
    if treatment == "all nodes":
        return Reduction.dirichlet(body.space, conditions)
    return reduction_for_mass_condensation(
        body.supports(conditions), "same" if treatment == "same" else "transposed"
    )


def _make_support_conditions(
    body: Discretisation, supports: list[Support]
) -> list[fem.DirichletBC]:
    return [
        prescribe(body.space, component, partial(_is_at_coordinate, axis, value))
        for axis, value, component in supports
    ]


def _is_at_coordinate(axis: int, value: float, x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[axis], value)


def _measure_quality_of_modes(modes: VibrationModes) -> dict[str, float]:
    return {
        "rigid": float(modes.n_rigid),
        "residual": modes.residuals.max(),
        "imaginary": modes.imaginary_ratio,
    }


def _largest_axisymmetric_displacement_error(
    body: Discretisation,
    supports: list[Support],
    loaded_part: Marker,
    traction: tuple[float, float],
    radial_displacement: Callable[[Array], Array],
) -> float:
    """Return the largest error of a nodal displacement of an axisymmetric body under pressure.

    The error is relative to the largest exact displacement. Smooth rigid walls support the body at
    z = 0 and z = 1.

    Args:
        body: Discretised body.
        supports: Further supports.
        loaded_part: Marker of the loaded part of the boundary.
        traction: Traction (t_r, t_z) on this part.
        radial_displacement: Function that returns exact radial displacements (n,) at radii (n,).
    """
    walls: list[Support] = [(1, 0.0, 1), (1, 1.0, 1)]
    load = body.surface_load(traction, loaded_part)
    a = solve(body.K, load, body.supports(_make_support_conditions(body, supports + walls)))
    exact = np.zeros((a.getSize() // 2, 2))
    exact[:, 0] = radial_displacement(body.space.tabulate_dof_coordinates()[:, 0])
    return float(np.abs(a.array_r.reshape(-1, 2) - exact).max() / np.abs(exact).max())


def _discretise_rectangle(
    element: str,
    sizes: tuple[float, float],
    divisions: tuple[int, int],
    state: StressState,
    inner_radius: float = 0.0,
) -> Discretisation:
    build = partial(
        mesh_rectangle_with_bent_inner_lines, sizes, divisions, inner_radius=inner_radius
    )
    return discretise(element, build, MATERIAL, state)


# Cases

ELEMENTS = (
    "galerkin-T6",
    "pw-T6",
    "pwsym-T6",
    "galerkin-Q8",
    "pw-Q8",
    "pw-Q9",
    "composite-T6",
)
ELEMENT_VARIANTS: dict[str, tuple[str, Treatment]] = {
    name: (name, "transposed") for name in ELEMENTS
}
ELEMENT_VARIANTS |= {
    "pw-Q8-same": ("pw-Q8", "same"),
    "pw-Q9-nine": ("pw-Q9", "all nodes"),
    "pw-T6-lumped": ("pw-T6", "lumped"),
    "pw-Q8-lumped": ("pw-Q8", "lumped"),
}
SQUARES_BY_PROBLEM = {rod: (4, 8, 16, 32), square: (4, 8, 16, 32), strip: (1, 2, 4, 8)}
FREE_ELEMENTS = {
    StressState.PLANE_STRESS: ELEMENTS,
    StressState.AXISYMMETRIC: ELEMENTS,
    StressState.SOLID: ("galerkin-T10", "pw-T10"),
}
STATIC_ELEMENTS = [element for element in ELEMENTS if not is_symmetrised(element)]

CASES = [
    Case(
        "V8",
        f"{problem.__name__}-{name}",
        problem,
        {"element": element, "treatment": treatment, "squares": squares},
    )
    for problem, squares in SQUARES_BY_PROBLEM.items()
    for name, (element, treatment) in ELEMENT_VARIANTS.items()
]
CASES += [
    Case(
        "V8",
        f"free-{state.value.replace(' ', '-')}-{element}",
        free,
        {"element": element, "state": state.value},
    )
    for state, elements in FREE_ELEMENTS.items()
    for element in elements
]
CASES += [
    case
    for element in STATIC_ELEMENTS
    for case in (
        Case("V8", f"tube-{element}", tube, {"element": element, "squares": (4, 8, 16, 32)}),
        Case("V8", f"cylinder-{element}", cylinder, {"element": element}),
    )
]
CASES += [
    Case("V8", f"quadrature-{element}", quadrature, {"element": element, "squares": 16})
    for element in ("galerkin-T6", "pw-T6", "pw-Q9")
]
CASES = mark_costly(CASES, "quadrature-*", "*-pw-Q8-lumped", "[rst]*-pw-Q9", "[rst]*-composite-T6")

# Results

DETAILS = r"""
{% call table("v8-errors-of-the-rod-s-eigenvalues", "Round rod: relative errors of ω² in 10⁻⁶ on the finest mesh, " ~ fixed(curves("V8/rod-pw-T6").squares[-1], 0) ~ " squares over the radius, and the lowest order of the six.") %}
| Element |{% for n in range(1, 7) %} Mode {{ n }} |{% endfor %} Order |
|---|{% for n in range(1, 7) %}---:|{% endfor %}---:|
{% for variant, words in variants %}{% set key = "V8/rod-" ~ variant %}
| {{ words }} |{% for n in range(1, 7) %} {{ short(1e6 * s(key, "omega2_" ~ n ~ "_error"), 3) }} |{% endfor %} {{ fixed(s(key, "order"), 2) }} |
{% endfor %}
{% endcall %}

{% call table("v8-square-and-strip", "Square and strip: largest relative error on the finest mesh, lowest order, and the largest |Im ω²| over |Re ω²| of all meshes.") %}
| Element | Square: error | Order | \|Im\| / \|Re\| | Strip: mode 1 in vibration | Mode 1 in buckling | Mode 3 in vibration | Mode 3 in buckling |
|---|---:|---:|---:|---:|---:|---:|---:|
{% for variant, words in variants %}{% set square, strip = "V8/square-" ~ variant, "V8/strip-" ~ variant %}
| {{ words }} | {{ num(s(square, "error"), 2) }} | {{ fixed(s(square, "order"), 2) }} | {{ num(s(square, "imaginary"), 2) }} |{% for name in ("vibration_1", "buckling_1", "vibration_3", "buckling_3") %} {{ num(s(strip, name ~ "_error"), 2) }} |{% endfor %}

{% endfor %}
{% endcall %}

{% call table("v8-cylinders-under-pressure", "Cylinders under pressure: largest error of a nodal displacement over the largest displacement.") %}
| Element | Solid cylinder | Tube | Order |
|---|---:|---:|---:|
{% for element, words in elements %}
| {{ words }} | {{ num(s("V8/cylinder-" ~ element, "displacement_error"), 1) }} | {{ num(s("V8/tube-" ~ element, "error"), 2) }} | {{ fixed(s("V8/tube-" ~ element, "order"), 2) }} |
{% endfor %}
{% endcall %}

{% call table("v8-quadrature-in-axisymmetry", "Rod, quadrature of lower degrees: largest relative change of the six eigenvalues against degree 16, and the error of the mesh.") %}
| Element |{% for degree in (2, 4, 6, 8) %} Degree {{ degree }} |{% endfor %} Error of the mesh |
|---|---:|---:|---:|---:|---:|
{% for element, words in [("galerkin-T6", "standard T6"), ("pw-T6", "new T6 (degree on each sub-triangle)"), ("pw-Q9", "new quadrilateral (degree on each sub-cell)")] %}{% set key = "V8/quadrature-" ~ element %}
| {{ words }} |{% for degree in (2, 4, 6, 8) %} {{ num(s(key, "change_" ~ degree), 2) }} |{% endfor %} {{ num(s(key, "error"), 2) }} |
{% endfor %}
{% endcall %}
"""

PLOT_TITLES = {
    "rod": ("round rod, axisymmetric", "squares over the radius"),
    "square": ("square, plane stress", "squares over a side"),
    "strip": ("strip, vibration", "squares over the height"),
}
"""Panel title and label of the abscissa, by problem."""
HOLLOW_MARKERS = {"linestyle": ":", "markerfacecolor": "none", "markersize": 8}
PLOT_LOOKS: dict[str, dict[str, Any]] = {
    "galerkin-T6": ELEMENT_LOOK["galerkin-T6"],
    "pw-T6": ELEMENT_LOOK["pw-T6"] | HOLLOW_MARKERS,
    "galerkin-Q8": ELEMENT_LOOK["galerkin-Q8"],
    "pw-Q9-nine": ELEMENT_LOOK["pw-Q9"] | HOLLOW_MARKERS | {"label": "new Q9, all nodes"},
    "pwsym-T6": ELEMENT_LOOK["pwsym-T6"],
    "pw-T6-lumped": ELEMENT_LOOK["pw-T6"] | {"linestyle": "--", "label": "new T6, lumped mass"},
    "pw-Q8": ELEMENT_LOOK["pw-Q8"] | {"label": "new Q8 (Guyan)"},
    "pw-Q8-same": ELEMENT_LOOK["pw-Q8"]
    | {"linestyle": "--", "markerfacecolor": "none", "label": "new Q8 (Guyan, L = R)"},
}
"""Line styles in the order of the legend; dotted curves coincide with others."""


def draw_convergence_of_frequencies(results: Results) -> Figure:
    """Draw the convergence of natural frequencies to exact ones.

    Each panel shows the largest relative error of all modes of one problem over the mesh density.
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 3.3), sharey=True)
    for ax, (problem, (title, density)) in zip(axes, PLOT_TITLES.items(), strict=True):
        for variant, look in PLOT_LOOKS.items():
            curves = results.curves(f"V8/{problem}-{variant}")
            errors = np.abs(_select_vibration_errors(problem, curves["errors"]))
            squares = curves["squares"]
            ax.loglog(squares, errors.max(axis=1), **look)
        ends = squares[[0, -1]].astype(float)
        for order, start, side in ((4, 2e-3, "top"), (2, 0.25, "bottom")):
            line = start * (ends / ends[0]) ** -order
            ax.loglog(ends, line, color="#777777", linewidth=0.8)
            middle = np.sqrt(ends.prod()), np.sqrt(line.prod())
            align = {"ha": "right" if side == "top" else "left", "va": side}
            ax.annotate(f"order {order}", middle, fontsize=7, bbox=LABEL_BOX, **align)
        ax.set(title=title, xlabel=density, ylim=(3e-7, 0.6))
        ax.set_xticks(squares, [f"{n}" for n in squares])
        ax.set_xticks([], minor=True)
    axes[0].set_ylabel("largest relative error of $\\omega^2$")
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def _select_vibration_errors(problem: str, errors: Array) -> Array:
    """Return the errors of natural frequencies and leave out the errors of buckling stresses.

    Args:
        problem: Name of the problem; only "strip" has buckling stresses.
        errors: Errors (m, n) on m meshes; in the problem "strip" the first half of the columns
            belongs to vibration, the second to buckling.
    """
    return errors[:, : errors.shape[1] // 2] if problem == "strip" else errors


def caption_convergence_of_frequencies(results: Results) -> str:
    """Return the caption of the convergence figure, including observed orders."""
    orders = {
        variant: results.scalar(f"V8/rod-{variant}", "order")
        for variant in ("galerkin-T6", "pw-T6", "pwsym-T6", "pw-T6-lumped", "pw-Q8")
    }
    return (
        "Largest relative error of the eigenvalues (six of the rod and of the square, three of the "
        f"strip). Lowest observed orders for the rod: standard triangle "
        f"{orders['galerkin-T6']:.2f}, new triangle {orders['pw-T6']:.2f}; symmetrised "
        f"{orders['pwsym-T6']:.2f}; with lumped mass {orders['pw-T6-lumped']:.2f}; 8-node element "
        f"by Guyan's reduction {orders['pw-Q8']:.2f}. New elements that keep all their nodes "
        "(hollow circles and crosses) lie on the lines of the standard ones."
    )


FIGURES = [
    PageFigure(
        "v8_vibration_convergence",
        draw_convergence_of_frequencies,
        needs=[f"V8/{problem}-{variant}" for problem in PLOT_TITLES for variant in PLOT_LOOKS],
        caption=caption_convergence_of_frequencies,
        alt="Three log-log plots of the largest error over mesh density. Standard and new triangles "
        "fall together with slope four, below them the standard 8-node and the new 9-node "
        "quadrilateral; the symmetrised, lumped and Guyan-reduced elements fall with slope two, "
        "the last one in the strip at first with slope four.",
    ),
]

VERIFICATION = r"""
| round rod, six eigenvalues | exact {{ cite("pochhammer") }} | eigenvalues, largest; order | {{ num(s("V8/rod-pw-T6", "error"), 2) }}; {{ fixed(s("V8/rod-pw-T6", "order"), 1) }} | {{ num(s("V8/rod-galerkin-T6", "error"), 2) }}; {{ fixed(s("V8/rod-galerkin-T6", "order"), 1) }} |
"""

# Findings

CHECKS = [
    check(
        "V8-rod",
        "Round rod between smooth rigid walls: on the finest mesh the new triangle has all "
        "six eigenvalues within 1e-5 of the roots of Pochhammer's frequency equation.",
        lambda results: scalar(results, key="V8/rod-pw-T6", name="error"),
        "<",
        1e-05,
        tolerance_why="none: a bound",
        why="The element and its mass and stiffness in axisymmetry are right.",
    ),
    check(
        "V8-order-rod",
        "The eigenvalues of the rod converge with order 4.",
        lambda results: scalar(results, key="V8/rod-pw-T6", name="order"),
        "=",
        4.0,
        tolerance=0.1,
        tolerance_why="the lowest order of six modes, the shortest of which is not in its final "
        "slope yet",
        why="As with the same test and trial functions: the errors of both sides multiply.",
    ),
    check(
        "V8-lumped",
        "The positive row-sum mass of the new triangle costs two orders.",
        lambda results: smallest(
            results,
            section="V8",
            cases={"element": "pw-T6", "squares": [4, 8, 16, 32], "treatment": "lumped"},
            name="order",
        ),
        "=",
        2.0,
        tolerance=0.1,
        tolerance_why="not in the final slope yet",
        why="As with every mass lumping by row sums of a quadratic element. The standard "
        "triangle has none: its vertices get zero.",
    ),
]

FINDINGS = r"""
In a round rod between smooth walls, whose frequencies are known, the eigenvalues converge with order
{{ fixed(s("V8/rod-pw-T6", "order"), 1) }}. Accuracy is lost by modifying the matrices: symmetrising them reduces the
order to {{ fixed(s("V8/rod-pwsym-T6", "order"), 1) }}, Guyan's reduction {{ cite("guyan") }} to the 8-node element to
{{ fixed(s("V8/rod-pw-Q8", "order"), 1) }}, a lumped mass to {{ fixed(s("V8/rod-pw-T6-lumped", "order"), 1) }}
({{ ref("v8_vibration_convergence") }}). In statics the reduction is exact; in vibrations the inner node should be kept.

{{ figure("v8_vibration_convergence") }}
"""

FURTHER_FINDINGS = r"""
1. **Order 4, with slightly smaller errors.** With its consistent mass the new triangle has the order of the standard one.
   Its error is at most {{ most(measure("largest_mode_error_ratio", key="V8/rod-pw-T6", other="V8/rod-galerkin-T6")) }}
   times that of the standard one in the rod and
   {{ most(measure("largest_mode_error_ratio", key="V8/square-pw-T6", other="V8/square-galerkin-T6")) }} times in the
   square. The largest of the rod's six errors is {{ num(s("V8/rod-pw-T6", "error"), 2) }} on the finest mesh.
2. **Symmetrising** reverses the sign of the error: all eigenvalues of the rod are too low, by up to
   {{ num(s("V8/rod-pwsym-T6", "error"), 2) }} on the finest mesh. The differences in Table 1 have this sign; see section
   7.5.
3. **Guyan's reduction** costs two orders with either left matrix: the condensed node follows its neighbours without
   inertia of its own. The same pair of triangles with all its nodes is the new T6, and the native quadrilateral with all
   nine nodes has order {{ fixed(s("V8/rod-pw-Q9-nine", "order"), 2) }}, and with its centre node reduced
   {{ fixed(s("V8/rod-pw-Q9", "order"), 2) }}. In bending (the strip) the effect is small on coarse meshes.
4. **Complex eigenvalues occur.** The consistent new triangle has none among its lowest (its upper spectrum is another
   matter, section V9). In the square, whose exact eigenvalues are partly double, the native quadrilateral has pairs with
   |Im| / |Re| up to {{ num(s("V8/square-pw-Q9-nine", "imaginary"), 2) }} on the coarsest mesh,
   {{ num(measure("finest_imaginary", key="V8/square-pw-Q9-nine"), 2) }} on the finest, and the triangle with lumped mass
   up to {{ num(s("V8/square-pw-T6-lumped", "imaginary"), 2) }}. These imaginary parts are smaller than the errors of the
   eigenvalues and vanish with them, but a code that takes real frequencies for granted may fail.
5. **Axisymmetry.** Degree 8 changes the eigenvalues of the standard triangle by
   {{ num(measure("scalar_ratio", key="V8/quadrature-galerkin-T6", name="change_8", other="error"), 1) }} times the error of
   the mesh, and those of the new one by
   {{ num(measure("scalar_ratio", key="V8/quadrature-pw-T6", name="change_8", other="error"), 1) }}. Nodes on the axis need
   $u_r = 0$ and nothing else.
6. **The composite triangle** has order 4 in vibration too; but in axisymmetric statics, where displacements enter the
   strains as such, its nodal displacements have order {{ fixed(s("V8/tube-composite-T6", "order"), 2) }}.
"""

# Limits

LIMITS = r"""
That eigenvalues of the new triangle are real is observed, not proved. The meshes are smooth images of squares; orders on
unstructured and curved meshes are given in section C. None of these bodies has a re-entrant corner; the stepped column
does, and its eigenvalues converge more slowly with any element.
"""

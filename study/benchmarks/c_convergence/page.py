"""Orders of convergence against manufactured solutions and known eigenvalues."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from study.benchmarks.c_convergence.eigenvalues import VIBRATIONS, VibrationBetweenWalls, modes
from study.benchmarks.c_convergence.statics import (
    SCANNED_SETTINGS,
    SETTINGS,
    ManufacturedProblem,
    scan,
    statics,
)
from study.judge.checks import check
from study.judge.measures.general import smallest
from study.judge.measures.known_solutions import largest_ratio_on_meshes, ratio_at_poissons_ratio
from study.publish.plots.style import ELEMENT_LOOK, LABEL_BOX, PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Results

SECTION = "C"
TITLE = "Orders of convergence"
VERIFICATION = ""  # told in the text of the report
FACTS = {
    "geometry": "a unit square, a quarter ring with radii 1 and 2, a unit cube, an eighth of a "
    "hollow ball",
    "mesh": "unstructured triangles and tetrahedra, mapped quadrilaterals, straight and curved; "
    "three or four sizes, down to 1/64",
    "material": "linear elastic; E = 1, ν = 0.3 to 0.4999; plane stress, plane strain, "
    "axisymmetric, solid",
    "supports": "one side prescribed; smooth walls for waves",
    "load": "body forces and tractions of prescribed smooth fields",
    "reference": "these fields; known waves between smooth walls",
    "uncertainty": "orders are slopes through the three finest meshes; the spread over settings is "
    "shown",
}
SHORT_FACTS = {
    "reference": "these fields; known waves",
    "uncertainty": "orders are slopes through three meshes; their spread is shown",
}
MACROS = r"""
{% set settings = [("plane-stress", "plane stress"), ("plane-strain", "plane strain"), ("axisymmetric", "axisymmetry"), ("ring", "ring, curved outline"), ("curved-ring", "ring, all sides curved")] %}
{% set solids = [("galerkin-T10", "standard T10"), ("pw-T10", "new T10")] %}
{% macro row(name, setting, key) %}
| {{ name }} | {{ setting }} |{% for norm in ("H1", "L2", "stress", "force") %} {{ fixed(s(key, "order_" ~ norm), 2) }} |{% endfor %}{% for norm in ("H1", "force") %} {{ num(s(key, "error_" ~ norm), 3) }} |{% endfor %}
{% endmacro %}
"""

# Problem

THEORY = r"""
The new element tests equilibrium with functions other than its trial functions. Does this cost an order of convergence,
or accuracy at the same order, in any state of stress, on unstructured meshes or on curved sides?
"""

# Method

METHOD = r"""
Statics: smooth displacement fields are chosen as exact solutions, and body forces and tractions are derived from them
symbolically. Displacements are prescribed on one side and tractions on the others. The bodies are the unit square (in
axisymmetry with one side on the axis), a quarter ring, a cube and the eighth of a hollow ball; triangles and tetrahedra
are made by Gmsh, quadrilaterals and their pairs of triangles by a smooth map. Curved sides have geometry of degree 2,
either along the outline only or everywhere. Relative errors are given for displacements in the H1 seminorm and the L2
norm, for stresses in L2, and for nodal forces on the fixed side, which are compared with the exact integrals of the
traction times the element's own test functions. Every field has a part without dilatation and a part whose pressure
stays bounded as Poisson's ratio tends to 1/2.

Eigenvalues: the bodies are enclosed by smooth rigid walls, so that their modes are known: a square in plane stress, a
cylinder (zeros of $J_1$) and a cube. In addition, the breathing mode of a quarter ring with free arcs is computed.
Orders are slopes through the results of the three finest meshes.
"""

# Cases


def _names_of_state_field_and_mesh(setting: ManufacturedProblem) -> dict[str, object]:
    return {
        "state": setting.state.value,
        "field": setting.field.__name__,
        "mesh": setting.mesh.__name__,
    }


def _state_field_mesh_ratio_and_cell_sides(setting: ManufacturedProblem) -> dict[str, object]:
    return {
        **_names_of_state_field_and_mesh(setting),
        "poissons_ratio": setting.poissons_ratio,
        "sides": setting.cell_sides,
    }


def _state_mesh_and_cell_sides_of_vibration(vibration: VibrationBetweenWalls) -> dict[str, object]:
    return {
        "state": vibration.state.value,
        "mesh": vibration.mesh.__name__,
        "sides": vibration.cell_sides,
    }


CASES = [
    Case(
        "C",
        f"{element}-{name}",
        statics,
        {"element": element, "setting": name},
        _state_field_mesh_ratio_and_cell_sides(setting),
    )
    for name, setting in SETTINGS.items()
    for element in setting.elements
]
CASES += [
    Case(
        "C",
        f"{element}-nu-{name}",
        scan,
        {"element": element, "setting": name},
        _names_of_state_field_and_mesh(setting),
    )
    for name, setting in SCANNED_SETTINGS.items()
    for element in setting.elements
]
CASES += [
    Case(
        "C",
        f"{element}-modes-{name}",
        modes,
        {"element": element, "vibration": name},
        _state_mesh_and_cell_sides_of_vibration(vibration),
    )
    for name, vibration in VIBRATIONS.items()
    for element in vibration.elements
]
CASES += [
    Case(
        "C",
        f"{element}-modes-square-same",
        modes,
        {"element": element, "vibration": "square", "left": "same"},
        _state_mesh_and_cell_sides_of_vibration(VIBRATIONS["square"]),
    )
    for element in ("pw-Q8", "pw-Q9")
]
CASES = mark_costly(
    CASES,
    *("*-ball", "*-modes-cube", "onecut-*", "*-Q[89]-*ring", "*-Q[89]-incompressible*"),
    *("composite-T6-*ring", "composite-T6-incompressible*", "*-T6-plane-strain"),
    *("*-Q[89]-plane-strain", "*-T6-axisymmetric", "*-Q[89]-axisymmetric"),
    *("composite-T6-modes-cylinder", "*-Q[89]-modes-cylinder", "*-modes-square-same"),
)

# Results

RESULT = r"""
**No order is lost at $\nu = 0.3$.** On unstructured meshes, in plane stress and strain, in axisymmetry, with curved sides
and on tetrahedra, the new element converges with the orders of the standard one. They are two in the displacement
gradient (H1), three in displacements (L2) and four in eigenvalues ({{ ref("observed-orders") }},
{{ ref("c_orders_norms") }}). Its H1 error exceeds the standard one's by at most
{{ pct(measure("largest_error_ratio", settings="plane-stress|plane-strain|axisymmetric|ring|curved-ring|solid|ball", name="error_H1") - 1) }},
and its nodal forces are *more* accurate: their error is
{{ fixed(measure("largest_error_ratio", settings="plane-stress", name="error_force"), 2) }} times the standard one's in
plane stress, {{ fixed(measure("largest_error_ratio", settings="solid", name="error_force"), 2) }} times on tetrahedra.

{% call table("observed-orders", "Observed orders of convergence over the three finest meshes (manufactured solutions, ν = 0.3), and the ratio of the new element's error to the standard one's on the finest mesh.") %}
| Setting | Order, standard: H1 | L2 | stress | forces | Order, new: H1 | L2 | stress | forces | Error, new over standard: H1 | forces |
|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|
{% for setting, nodes, name in (("plane-stress", "T6", "plane stress"), ("plane-strain", "T6", "plane strain"), ("axisymmetric", "T6", "axisymmetry"), ("curved-ring", "T6", "ring, all sides curved"), ("solid", "T10", "cube of tetrahedra")) %}
| {{ name }} |{% for kind in ("galerkin-", "pw-") %}{% for norm in ("H1", "L2", "stress", "force") %} {{ fixed(s("C/" ~ kind ~ nodes ~ "-" ~ setting, "order_" ~ norm), 2) }} |{% endfor %}{% endfor %}{% for norm in ("H1", "force") %} {{ fixed(measure("largest_error_ratio", settings=setting, name="error_" ~ norm), 2) }} |{% endfor %}

{% endfor %}
{% endcall %}

{{ figure("c_orders_norms") }}
"""

DETAILS = r"""
{% call table("c-orders-of-convergence-in-statics", "The same for the other elements and settings.", long=True) %}
| Element | Setting, ν = 0.3 | Order H1 | Order L2 | Order of stresses | Order of nodal forces | Finest error H1 | Finest error of nodal forces |
|---|---|---:|---:|---:|---:|---:|---:|
{% for setting, name in settings %}{% for element, element_name in elements %}{% if (setting == "ring") == element.endswith("T6") or element == "composite-T6" %}
{{ row(element_name, name, "C/" ~ element ~ "-" ~ setting) }}
{% endif %}{% endfor %}{% endfor %}
{{ row("standard T6", "plane stress, the pairs of Q8", "C/galerkin-T6-pairs") }}
{% for element, name in solids %}
{{ row(name, "hollow ball, curved outline", "C/" ~ element ~ "-ball") }}
{% endfor %}
{% endcall %}

{% call table("c-orders-of-convergence-of-eigenvalues", "Orders of convergence of eigenvalues.") %}
| Element | Square: order | finest error | Cylinder: order | finest error |
|---|---:|---:|---:|---:|
{% for element, name in elements %}
| {{ name }} |{% for body in ("square", "cylinder") %} {{ fixed(s("C/" ~ element ~ "-modes-" ~ body, "order_eigenvalue"), 2) }} | {{ num(s("C/" ~ element ~ "-modes-" ~ body, "error_eigenvalue"), 3) }} |{% endfor %}

{% endfor %}
{% for element, name in (("pw-Q8", "new Q8, Guyan's reduction with R for L"), ("pw-Q9", "new quadrilateral, Guyan's reduction with R for L")) %}
| {{ name }} | {{ fixed(s("C/" ~ element ~ "-modes-square-same", "order_eigenvalue"), 2) }} | {{ num(s("C/" ~ element ~ "-modes-square-same", "error_eigenvalue"), 3) }} | – | – |
{% endfor %}
| new T6, symmetrised | {{ fixed(s("C/pwsym-T6-modes-square", "order_eigenvalue"), 2) }} | {{ num(s("C/pwsym-T6-modes-square", "error_eigenvalue"), 3) }} | – | – |
{% endcall %}

{% call table("c-eigenvalues-of-ring-and-cube", "Eigenvalues of ring and cube.") %}
| Body | Standard: order | finest error | New: order | finest error | Error, new over standard |
|---|---:|---:|---:|---:|---:|
{% for body, nodes, name in (("ring", "T6", "ring, curved outline"), ("curved-ring", "T6", "ring, all sides curved"), ("cube", "T10", "cube of tetrahedra")) %}
| {{ name }} |{% for element in ("galerkin-", "pw-") %} {{ fixed(s("C/" ~ element ~ nodes ~ "-modes-" ~ body, "order_eigenvalue"), 2) }} | {{ num(s("C/" ~ element ~ nodes ~ "-modes-" ~ body, "error_eigenvalue"), 3) }} |{% endfor %} {{ fixed(measure("largest_error_ratio", settings="modes-" ~ body, name="error_eigenvalue"), 2) }} |
{% endfor %}
{% endcall %}

#### Near incompressibility

{% call table("c-errors-near-incompressibility", "Errors near incompressibility.") %}
| Setting, ν = 0.4999 | Finest error H1, standard | new | New over standard, finest mesh | worst mesh | Nodal forces, finest mesh |
|---|---:|---:|---:|---:|---:|
{% for setting, nodes, name in (("incompressible", "T6", "plane strain, straight sides"), ("incompressible-pressure", "T6", "the same, pressure alone balances the body force"), ("incompressible-axisymmetric", "T6", "axisymmetry, straight sides"), ("incompressible-ring", "T6", "ring, curved outline"), ("incompressible-curved-ring", "T6", "ring, all sides curved"), ("incompressible-solid", "T10", "cube of tetrahedra")) %}
| {{ name }} |{% for element in ("galerkin-", "pw-") %} {{ num(s("C/" ~ element ~ nodes ~ "-" ~ setting, "error_H1"), 3) }} |{% endfor %} {{ num(measure("largest_error_ratio", settings=setting, name="error_H1"), 3) }} | {{ num(measure("largest_ratio_on_meshes", settings=setting, name="error_H1"), 3) }} | {{ num(measure("largest_error_ratio", settings=setting, name="error_force"), 3) }} |
{% endfor %}
{% endcall %}

{% call table("c-all-elements-near-incompressibility", "All elements near incompressibility.") %}
| Element, plane strain, straight sides, ν = 0.4999 | Finest error H1 | Nodal forces | Pressure alone: H1 | Nodal forces |
|---|---:|---:|---:|---:|
{% for element, name in elements %}
| {{ name }} |{% for setting in ("incompressible", "incompressible-pressure") %}{% for error in ("error_H1", "error_force") %} {{ num(s("C/" ~ element ~ "-" ~ setting, error), 3) }} |{% endfor %}{% endfor %}

{% endfor %}
{% endcall %}
"""

PLOTTED_ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
ERROR_PANELS = (
    ("H1 seminorm of the displacements", "plane-stress", "H1", ((1, 5e-3), (2, 6e-5))),
    ("L2 norm of the displacements", "plane-stress", "L2", ((2, 1e-4), (3, 4e-7))),
    ("nodal forces on the held side", "plane-stress", "force", ((1, 4e-3), (2, 1.3e-5))),
    ("lowest four eigenvalues", "modes-square", "eigenvalue", ((2, 3e-4), (4, 5e-7))),
)
"""Title, setting, name of the error, and slope lines (order, error at the fine end)."""
SLOPE_LINE_RANGE = (0.014, 0.03)
"""Range of element sizes over which the slope lines are drawn."""


def draw_errors_over_element_size(results: Results) -> Figure:
    """Draw relative errors of displacements, nodal forces and eigenvalues over the element size.

    Each panel shows one kind of error for several elements, with lines of the expected slopes.
    """
    fig, axes = plt.subplots(2, 2, figsize=(PAGE_WIDTH, 3.1), sharex=True, layout="constrained")
    fine, coarse = SLOPE_LINE_RANGE
    for ax, (title, setting, name, slopes) in zip(axes.flat, ERROR_PANELS, strict=True):
        for element in PLOTTED_ELEMENTS:
            look = dict(ELEMENT_LOOK[element])
            if element == "pw-T6":  # drawn over the standard element
                look |= {"linestyle": ":", "markerfacecolor": "none", "markersize": 8}
            elif element == "pw-Q9":
                look |= {"linestyle": ":", "markerfacecolor": "none", "markersize": 7}
            curves = results.curves(f"C/{element}-{setting}")
            ax.loglog(curves["dofs"] ** -0.5, curves[f"error_{name}"], **look)
        for slope, fine_error in slopes:
            coarse_error = fine_error * (coarse / fine) ** slope
            ax.loglog([fine, coarse], [fine_error, coarse_error], color="#777777", linewidth=0.8)
            ax.annotate(
                f"order {slope}",
                (coarse, coarse_error),
                (3, 0),
                textcoords="offset points",
                fontsize=7,
                va="center",
                color="#555555",
                bbox=LABEL_BOX,
            )
        ax.set(title=title)
        ax.margins(y=0.12)  # keeps the label of the lowest slope clear of the axis
        ax.set_xticks([0.01, 0.02, 0.05, 0.1], ["0.01", "0.02", "0.05", "0.1"])
        ax.set_xticks([], minor=True)
    for ax in axes[1]:
        ax.set_xlabel("(degrees of freedom)$^{-1/2}$")
    for ax in axes[:, 0]:
        ax.set_ylabel("relative error")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def caption_errors_over_element_size(results: Results) -> str:
    """Return the caption of `draw_errors_over_element_size`, with ratios of eigenvalue errors."""
    pw, galerkin, pairs, standard = (
        results.scalar(f"C/{element}-modes-square", "error_eigenvalue")
        for element in ("pw-T6", "galerkin-T6", "pw-Q8", "galerkin-Q8")
    )
    return (
        "Relative errors on the unit square in plane stress (triangles by Gmsh; quadrilaterals and "
        "pairs of triangles smoothly distorted). New and standard triangle coincide in the "
        "displacements. Eigenvalues: the largest error of the lowest four; on the finest mesh the "
        f"new triangle's is {pw / galerkin:.2f} times the standard one's, and that of the new "
        f"8-node quadrilateral with Guyan's reduction {pairs / standard:.0f} times the standard "
        "one's."
    )


PLOTTED_SCANS = (
    ("plane-strain", "plane strain, straight sides", "#0072B2", "o", "T6"),
    ("pressure", "plane strain, pressure alone", "#D55E00", "^", "T6"),
    ("axisymmetric", "axisymmetry, straight sides", "#B87A00", "s", "T6"),
    ("ring", "ring, curved outline", "#007A5A", "D", "T6"),
    ("curved-ring", "ring, all sides curved", "#6A4C93", "P", "T6"),
    ("solid", "cube of tetrahedra", "#B0568C", "v", "T10"),
)
"""Key in `SCANNED_SETTINGS`, label, colour, marker, and suffix of the elements' names."""


def draw_errors_near_incompressibility(results: Results) -> Figure:
    """Draw H1 errors of the new and the standard element near incompressibility.

    The left panel shows the ratio of the two errors over Poisson's ratio; the right panel shows
    both errors over the cell size h at Poisson's ratio 0.4999.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.4), layout="constrained")
    for name, label, color, marker, nodes in PLOTTED_SCANS:
        pw, galerkin = (
            results.curves(f"C/{element}-{nodes}-nu-{name}") for element in ("pw", "galerkin")
        )
        look = {"color": color, "marker": marker}
        ratio = pw["error_H1"] / galerkin["error_H1"]
        left.loglog(0.5 - pw["nu"], ratio, label=label, **look)
        for element, line in (("pw", "-"), ("galerkin", ":")):
            curves = results.curves(
                f"C/{element}-{nodes}-{_key_of_setting_at_poissons_ratio_04999(name)}"
            )
            marker_face = {} if element == "pw" else {"markerfacecolor": "none"}
            right.loglog(curves["h"], curves["error_H1"], linestyle=line, **look, **marker_face)
    nu = results.curves("C/pw-T6-nu-pressure")["nu"]
    left.set_xticks(0.5 - nu, [f"{value:g}" for value in nu], rotation=60, fontsize=7)
    left.set_xticks([], minor=True)
    left.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
    left.set_yticks([], minor=True)
    left.invert_xaxis()
    left.set(title="(a) H1 error of the new over the standard", xlabel="Poisson's ratio")
    left.set_ylabel("ratio of errors")
    right.set(title="(b) Poisson's ratio 0.4999", xlabel="cell size $h$")
    right.set_ylabel("relative H1 error")
    right.set_xticks([0.02, 0.05, 0.1, 0.2], ["0.02", "0.05", "0.1", "0.2"])
    right.set_xticks([], minor=True)
    right.plot([], [], "-", color="black", label="new")
    right.plot([], [], ":", color="black", label="standard")
    right.legend(loc="lower right", fontsize=7)
    fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    return fig


def _key_of_setting_at_poissons_ratio_04999(scanned_setting: str) -> str:
    """Return the key in `SETTINGS` for a key of `SCANNED_SETTINGS` at Poisson's ratio 0.4999."""
    return f"incompressible-{scanned_setting}".removesuffix("-plane-strain")


def caption_errors_near_incompressibility(results: Results) -> str:
    """Return the caption of `draw_errors_near_incompressibility`, with error ratios at two nu."""
    scans = [name for name, *_ in PLOTTED_SCANS if name not in ("plane-strain", "pressure")]
    settings = "|".join(scans)
    worst = ratio_at_poissons_ratio(results, settings, "error_H1", 0.4999)
    safe = ratio_at_poissons_ratio(results, f"plane-strain|{settings}", "error_H1", 0.49)
    safe_pressure, worst_pressure = (
        ratio_at_poissons_ratio(results, "pressure", "error_H1", nu) for nu in (0.49, 0.4999)
    )
    return (
        "Error of the displacement gradient (H1) under a body force. (a) New over standard element "
        f"on one mesh. Up to ν = 0.49 the ratio is at most {safe:.2f}, or {safe_pressure:.2f} if "
        f"pressure alone balances the body force; at 0.4999 it reaches {worst:.0f} where the "
        f"identity with T fails and stays 1 where it holds, unless pressure alone balances the "
        f"body force ({worst_pressure:.0f}). (b) Both elements over the cell size at 0.4999; an "
        "error of 1 means that the result is useless."
    )


FIGURES = [
    PageFigure(
        "c_orders_norms",
        draw_errors_over_element_size,
        needs=[
            f"C/{element}-{setting}"
            for setting in ("plane-stress", "modes-square")
            for element in PLOTTED_ELEMENTS
        ],
        caption=caption_errors_over_element_size,
        alt="Four log-log plots of errors over the elements' size. Displacements: all quadratic "
        "elements fall with slopes two and three, the composite triangle with one and two. Nodal "
        "forces: slope two, the composite triangle one. Eigenvalues: slope four, but two for both "
        "new quadrilaterals.",
    ),
    PageFigure(
        "c_orders_incompressible",
        draw_errors_near_incompressibility,
        needs=[
            f"C/{element}-{nodes}-{case}"
            for name, _, _, _, nodes in PLOTTED_SCANS
            for element in ("galerkin", "pw")
            for case in (f"nu-{name}", _key_of_setting_at_poissons_ratio_04999(name))
        ],
        caption=caption_errors_near_incompressibility,
        alt="Six curves of the ratio of errors over Poisson's ratio, all near one up to 0.49, "
        "five of them rising steeply towards one half; and errors over h of both elements; the "
        "new element's curves lie above the standard one's, up to an error of one and more.",
    ),
]

# Findings

CHECKS = [
    check(
        "C-H1",
        "The new elements converge with order 2 in the H1 seminorm, on straight and curved "
        "sides, in all states at nu = 0.3.",
        lambda results: smallest(
            results,
            section="C",
            cases={"element": ["pw-Q8", "pw-Q9", "pw-T10", "pw-T6"], "poissons_ratio": 0.3},
            name="order_H1",
        ),
        ">=",
        2.0,
        tolerance=0.1,
        tolerance_why="a twentieth of the order: meshes that are not similar scatter as if their sizes "
        "did",
        why="The trial functions are complete quadratics, and the test functions are as many.",
    ),
    check(
        "C-eigenvalues",
        "Eigenvalues of the new triangle and tetrahedron converge with order 4, also on "
        "curved sides.",
        lambda results: smallest(
            results,
            section="C",
            cases={"element": ["pw-T10", "pw-T6"], "problem": "modes"},
            name="order_eigenvalue",
        ),
        ">=",
        4.0,
        tolerance=0.2,
        tolerance_why="a twentieth of the order: meshes that are not similar scatter as if their sizes "
        "did",
        why="Twice the order of the H1 seminorm. The test functions approximate the modes of "
        "the transposed problem with order 1 only, which alone would promise 2 + 1.",
    ),
    check(
        "C-near-solid",
        "At nu = 0.4999 on tetrahedra it is more than ten times the standard one's on the "
        "worst mesh.",
        lambda results: largest_ratio_on_meshes(
            results, settings="incompressible-solid", name="error_H1"
        ),
        ">",
        10.0,
        tolerance_why="none: a bound set with the measured values known, to record their size",
        tolerance_set="after",
        why="No identity holds in 3-D.",
    ),
]

FINDINGS = r"""
**Where the new element is worse.**

- *Near incompressibility.* Wherever $\boldsymbol{K}_\mathrm{new}$ differs from
  $\boldsymbol{T} \boldsymbol{K}_\mathrm{standard}$, the difference is multiplied by the bulk modulus. At $\nu = 0.4999$
  the H1 error is up to
  {{ fixed(measure("largest_ratio_on_meshes", settings="incompressible-curved-ring", name="error_H1"), 0) }} times the
  standard one's with curved sides,
  {{ fixed(measure("largest_ratio_on_meshes", settings="incompressible-solid", name="error_H1"), 0) }} times on tetrahedra,
  and {{ fixed(measure("largest_ratio_on_meshes", settings="incompressible-pressure", name="error_H1"), 0) }} times where a
  body force is balanced by pressure alone. Up to $\nu = 0.49$ it stays within
  {{ pct(measure("ratio_at_poissons_ratio", settings="plane-strain|axisymmetric|ring|curved-ring|solid", name="error_H1", nu=0.49) - 1) }}
  of the standard one's, with pressure alone at
  {{ fixed(measure("ratio_at_poissons_ratio", settings="pressure", name="error_H1", nu=0.49), 1) }} times
  ({{ ref("c_orders_incompressible") }}).{% if has("V15/hertz-pw-hybrid-T6-32") %} The hybrid element of {{ ref("V15") }} is the remedy.{% endif %}

- *Undamped dynamics* is unstable; the symmetric sibling is the remedy ({{ ref("V12") }}).
- *Eigenvalues.* With Guyan's reduction the error of the paper's 8-node element on the finest square is
  {{ num(measure("ratio", key="C/pw-Q8-modes-square", other="C/galerkin-Q8-modes-square", name="error_eigenvalue"), 2) }}
  times that of the standard one. With all sides curved the triangle's error is
  {{ fixed(measure("largest_error_ratio", settings="modes-curved-ring", name="error_eigenvalue"), 1) }} times the standard
  one's, at the same order.
- *Diagonals.* With all diagonals in one direction the error of the nodal forces of condensed pairs is
  {{ fixed(measure("ratio", key="C/pw-Q8-plane-stress", other="C/galerkin-Q8-plane-stress", name="error_force"), 1) }} times
  that of the standard quadrilateral. The mesh is the cause: on it the standard triangle's error is
  {{ fixed(measure("ratio", key="C/galerkin-T6-pairs", other="C/galerkin-Q8-plane-stress", name="error_force"), 1) }} times
  as large.
- *Large rotations:* moments balance only approximately ({{ ref("V14") }}). *Two bodies:* tensile forces at the edge of
  contact ({{ ref("V11") }}). *Shear stress* below a curved punch zigzags with every element ({{ ref("7.3") }}). *Cost:*
  see {{ ref("K") }}.

{{ figure("c_orders_incompressible") }}
"""

FURTHER_FINDINGS = r"""
1. The composite triangle has the orders 1 in H1 and 2 in L2, and its nodal forces are only of order 1 where displacements
   are prescribed. Its eigenvalues, however, are of order 4, with
   {{ fixed(measure("ratio", key="C/composite-T6-modes-square", other="C/galerkin-T6-modes-square", name="error_eigenvalue"), 2) }}
   times the error of the standard triangle on the square.
2. On curved sides at $\nu = 0.3$ the new element is no less accurate in statics.
3. On straight-sided triangles in the plane the new element is as accurate near incompressibility as the standard one,
   unless the body force is balanced by pressure alone. Tetrahedra cut along one diagonal have
   {{ fixed(measure("ratio", key="C/onecut-T10-incompressible-solid", other="C/pw-T10-incompressible-solid", name="error_H1"), 0) }}
   times the error of the mean of the three cuts on the finest mesh. The orders measured there are not asymptotic: the
   meshes are only just fine enough for the error to fall.
4. The eigenvalues of plane and axisymmetric bodies computed here are real (those in section V8 are not). Some of the
   threefold eigenvalues of the cube are complex: $|\mathrm{Im}| / |\mathrm{Re}|$ is up to
   {{ num(s("C/pw-T10-modes-cube", "imaginary"), 2) }} on coarse meshes, which is less than their errors.
"""

# Limits

LIMITS = r"""
Orders are measured on three meshes, not proved. The meshes of the hollow ball are too coarse for the stresses to show
order 2 with either element. Smooth solutions say nothing about corners or the edges of contact zones. The quadrilaterals
are smoothly distorted: on badly shaped ones the standard 8-node element is known to lose an order. Body forces and
tractions are integrated with a rule of fixed degree, and raising it by two changes any error by less than a fifth of a
per cent.
"""

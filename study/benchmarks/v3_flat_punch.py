"""Verification of flat punches with sharp edges.

The punches are smooth or bonded in plane strain, or smooth in axisymmetry.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pw_elements.contact import FlatPunch
from pw_elements.elasticity import StressState
from study.judge.checks import check
from study.judge.measures.general import curve_difference, smallest
from study.model.units import assign_units_to_scalars
from study.publish.plots import convergence
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case
from study.run.pages import PageFigure
from study.run.store import Result, Results
from study.solutions.half_space import (
    BondedLinePunch,
    ElasticHalfSpace,
    ExactIndentation,
    FlatLinePunch,
    FlatRoundPunch,
)
from study.solutions.indentation import (
    BODY_SIZE,
    ELEMENTS,
    Indenter,
    ends_of_tributary_lengths,
    solve_indentation_on_refined_meshes,
)

SECTION = "V3"
TITLE = "Flat punches"
FACTS = {
    "geometry": "flat punches of half width 1 with sharp edges: in the plane, smooth and bonded, "
    "and round; one half, 5 wide and deep",
    "mesh": "4, 8, 16 and 32 elements over the half width, equal or graded towards the edge",
    "material": "linear elastic, plane strain and axisymmetric; E = 1000, ν = 0.3",
    "supports": "exact displacements of the half space on the outer sides",
    "load": "a normal force of 3",
    "reference": "M. Sadowsky, J. Boussinesq, and the oscillating solution of a bonded punch",
    "uncertainty": "stresses are unbounded at the edge: pressures are compared within the inner "
    "80 %",
}
SHORT_FACTS = {
    "reference": "M. Sadowsky, J. Boussinesq, a bonded punch",
    "uncertainty": "unbounded at the edge: the inner 80 % are compared",
}

# Problem and exact solution

THEORY = r"""
Rigid flat punches of half width $b$ with sharp edges are pressed on elastic half spaces with $\nu$ =
{{ fixed(s("V3/smooth-exact", "poissons_ratio"), 1) }}:

- a smooth one in plane strain (M. Sadowsky {{ cite("sadowsky") }}: $p = P/(\pi \sqrt{b^2 - x^2})$);
- one bonded to the half plane (pressure and shear oscillate as cos and sin of $\eta\,\log((b + x)/(b - x))$,
  $\eta = \log(3 - 4\nu)/(2\pi)$ = {{ fixed(s("V3/bonded-exact", "oscillation"), 4) }});
- and a smooth round one (J. Boussinesq: $p = P/(2\pi b \sqrt{b^2 - r^2})$, depth $P/(2 E^* b)$).
"""

ELASTIC_BODY, HALF_WIDTH, FORCE = ElasticHalfSpace(1000.0, 0.3), 1.0, 3.0
PUNCHES: dict[str, tuple[ExactIndentation, StressState]] = {
    "smooth": (FlatLinePunch(ELASTIC_BODY, HALF_WIDTH, FORCE), StressState.PLANE_STRAIN),
    "bonded": (BondedLinePunch(ELASTIC_BODY, HALF_WIDTH, FORCE), StressState.PLANE_STRAIN),
    "round": (FlatRoundPunch(ELASTIC_BODY, HALF_WIDTH, FORCE), StressState.AXISYMMETRIC),
}
"""Exact solution and stress state of each kind of punch."""


def exact(kind: str) -> Result:
    """Return the exact tractions below a punch, up to its edge, and the mean pressure.

    The pressure below the bonded punch oscillates near the edge. From the middle outwards, its
    first change of sign is where eta log((b + x)/(b - x)) = pi/2, with the half width b and the
    oscillation exponent eta; the scalar `sign_change` is 1 - x/b at this point.

    Args:
        kind: Kind of punch, a key of `PUNCHES`.
    """
    solution, state = PUNCHES[kind]
    x = HALF_WIDTH * np.sin(np.linspace(0, np.pi / 2, 400)[:-1])
    area = np.pi * HALF_WIDTH**2 if state is StressState.AXISYMMETRIC else 2 * HALF_WIDTH
    scalars = {"mean_pressure": FORCE / area, "poissons_ratio": ELASTIC_BODY.poissons_ratio}
    curves = {"x": x, "pressure": solution.pressure(x)}
    if isinstance(solution, BondedLinePunch):
        curves["shear"] = -solution.shear(x)
        scalars["oscillation"] = solution.oscillation_exponent
        scalars["sign_change"] = float(1 - np.tanh(np.pi / (4 * solution.oscillation_exponent)))
    return Result(
        scalars, assign_units_to_scalars(scalars, {"mean_pressure": "stress", "*": "1"}), curves
    )


# Method

METHOD = r"""
As in V2, one half of the body is modelled as a square of side $5b$ with the exact displacements on its outer sides, the
force is prescribed, and there are 4 to 32 elements over $b$. The bonded punch has so much friction that all nodes stick.
A mesh line ends at the edge of the punch. There are two series of meshes: with elements of equal size below the punch,
and with elements graded towards its edge, $x = b\,(1 - (1 - s)^{1.5})$. The pressure is unbounded at the edge, so errors
of pressures are taken over the inner 80 %, and those of nodal forces over all nodes.

With elements of equal size, the singularity reduces the order in energy to one half, and the error everywhere else is of
order 1; the force of the edge node is of order 1/2. If the element at the edge is $b/n^{1.5}$ long, these become 3/2
and 3/4.
"""

ELEMENT_COUNTS = (4, 8, 16, 32)
"""Numbers of elements over the half width of the punch."""
GRADING_EXPONENT = 1.5
"""Exponent g of graded meshes, whose lines are at x = b (1 - (1 - s)^g) with equal steps of s."""


def punch(
    element: str, kind: str, graded: bool = False, outer: float = BODY_SIZE, far_field: bool = True
) -> Result:
    """Solve the contact below one kind of flat punch on a series of meshes.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        kind: Kind of punch, a key of `PUNCHES`.
        graded: Whether elements become smaller towards the edge of the punch; otherwise they are
            equal.
        outer: Side of the meshed body over the half width of the punch.
        far_field: Whether the exact displacements are prescribed on the outer sides; otherwise
            these are fixed.
    """
    solution, state = PUNCHES[kind]
    surface = FlatPunch((0.0, 0.0), (0.0, -1.0), HALF_WIDTH)
    meshes = {
        n: [_make_graded_mesh_lines_below_punch(n, GRADING_EXPONENT if graded else 1.0)]
        for n in ELEMENT_COUNTS
    }
    result = solve_indentation_on_refined_meshes(
        element, Indenter(solution, surface, state), meshes, outer, far_field
    )
    if not isinstance(solution, BondedLinePunch):
        return result
    return _add_exact_shear_forces_and_error(result, solution)


def _add_exact_shear_forces_and_error(result: Result, solution: BondedLinePunch) -> Result:
    """Return the result with the exact shear forces of a bonded punch and the error of their sum.

    The sum is taken over one half of the punch; exact nodal forces are integrals over tributary
    areas.

    Args:
        result: Computed result.
        solution: Exact solution of the bonded punch.
    """
    exact_force = -float(solution.shear_force_from_middle_to(np.array([HALF_WIDTH]))[0])
    scalars = {
        "exact_force_tangential": exact_force,
        "error_force_tangential": abs(result.scalars["force_tangential"] / exact_force - 1),
    }
    unit_kinds = {"exact_force_tangential": "force", "error_*": "1"}
    nodal_forces = -np.diff(
        solution.shear_force_from_middle_to(ends_of_tributary_lengths(result.curves["x"]))
    )
    return replace(
        result,
        scalars={**result.scalars, **scalars},
        units={**result.units, **assign_units_to_scalars(scalars, unit_kinds)},
        curves={**result.curves, "exact_force_t": nodal_forces},
    )


def _make_graded_mesh_lines_below_punch(
    elements: int, grading_exponent: float
) -> npt.NDArray[np.float64]:
    return HALF_WIDTH * (1 - np.linspace(1, 0, elements + 1) ** grading_exponent)


# Cases

CASES = [
    Case("V3", f"{kind}-{element}{suffix}", punch, {"element": element, "kind": kind, **mesh})
    for kind in PUNCHES
    for element in ELEMENTS
    for suffix, mesh in (("", {}), ("-graded", {"graded": True}))
]
CASES += [
    Case("V3", f"{kind}-pw-T6-{suffix}", punch, {"element": "pw-T6", "kind": kind, **size})
    for kind in PUNCHES
    for suffix, size in (("held", {"far_field": False}), ("outer10", {"outer": 10.0}))
]
CASES += [Case("V3", f"{kind}-exact", exact, {"kind": kind}) for kind in PUNCHES]

# Results

DETAILS = r"""
{{ figure("v3_punch_pressure") }}

{{ figure("v3_punch_convergence") }}

Errors with 32 elements over $b$; observed orders over the last two doublings in brackets.

{% call table("v3-flat-punches-errors", "Flat punches: errors.") %}
| Punch | Element | Nodal forces, even | graded | Own test function, even | graded | Depth, graded | Mid-side over corner force |
|---|---|---:|---:|---:|---:|---:|---:|
{% for kind in ("smooth", "bonded", "round") %}{% for element, name in elements %}{% set key = "V3/" ~ kind ~ "-" ~ element %}
| {{ kind }} | {{ name }} |{% for case, error in [(key, "force"), (key ~ "-graded", "force"), (key, "pressure_own_inner"), (key ~ "-graded", "pressure_own_inner"), (key ~ "-graded", "approach")] %} {{ num(s(case, "error_" ~ error), 2) }} ({{ fixed(s(case, "order_" ~ error), 2) }}) |{% endfor %} {{ fixed(s(key, "sawtooth"), 3) }} |
{% endfor %}{% endfor %}
{% endcall %}
"""


def draw_tractions_below_punches(results: Results) -> Figure:
    """Draw the tractions below flat punches, one panel per traction."""
    panels = {
        "smooth: pressure": ("smooth", "pressure", 1),
        "bonded: pressure": ("bonded", "pressure", 1),
        "bonded: shear": ("bonded", "shear", -1),  # drawn with the opposite sign
        "round, smooth: pressure": ("round", "pressure", 1),
    }
    fig, axes = plt.subplots(1, 4, figsize=(PAGE_WIDTH, 2.7), sharex=True)
    for ax, (title, panel) in zip(axes, panels.items(), strict=True):
        _draw_traction_below_punch(ax, results, *panel)
        ax.set_title(title, fontsize=8)
        ax.set(xlabel="$x / b$", xlim=(-0.03, 1.03))
    axes[0].set_ylabel("traction / mean pressure")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def _draw_traction_below_punch(
    ax: Axes, results: Results, kind: str, quantity: str, sign: int
) -> None:
    exact_curves = results.curves(f"V3/{kind}-exact")
    mean = sign * results.scalar(f"V3/{kind}-exact", "mean_pressure")
    for element in ("galerkin-T6", "pw-T6"):
        curves = results.curves(f"V3/{kind}-{element}")
        ax.plot(curves["x"], curves[quantity] / mean, **ELEMENT_LOOK[element])
    b = curves["x"].max()
    x, traction = exact_curves["x"], exact_curves[quantity]
    ax.plot(x / b, traction / mean, **ELEMENT_LOOK["exact"], linestyle="--", zorder=3)
    ax.set_ylim(0, traction[x < 0.97 * b][-1] / mean)


def draw_convergence_below_punches(results: Results) -> Figure:
    """Draw the convergence of contact pressures below flat punches.

    Each panel shows one kind of punch, with uniform and graded meshes.
    """
    titles = {"smooth": "smooth", "bonded": "bonded", "round": "round, smooth"}
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 3.2), sharex=True, sharey=True)
    for ax, (kind, title) in zip(axes, titles.items(), strict=True):
        convergence.set_log_axes_with_element_ticks(ax, results, CONVERGENCE_CASE_KEYS[0])
        for mesh, line in MESH_LINE_STYLES.items():
            keys = {element: f"V3/{kind}-{element}{mesh}" for element in convergence.ELEMENTS}
            convergence.plot_error_over_number_of_elements(
                ax, results, keys, "error_pressure_own_inner", linestyle=line
            )
        convergence.draw_line_of_convergence_order(ax, results, CONVERGENCE_CASE_KEYS[0], 1, 0.15)
        convergence.draw_line_of_convergence_order(
            ax, results, CONVERGENCE_CASE_KEYS[0], 1.5, 0.011
        )
        ax.set(title=title, xlabel="elements over half width")
    axes[0].set_ylabel("error of pressure, inner part")
    handles, _ = axes[0].get_legend_handles_labels()
    handles = handles[: len(convergence.ELEMENTS)]
    for handle in handles:
        handle.set_linestyle("-")
    handles += [
        Line2D([], [], color="#333333", linestyle=line, label=label)
        for line, label in (("-", "equal elements"), ("--", "finer towards the edge"))
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def caption_tractions_below_punches(results: Results) -> str:
    """Return the caption of the tractions, including the number of elements."""
    elements = results.curves(PRESSURE_CASE_KEYS[0])["elements"][1]
    return (
        f"Own-function tractions below flat punches of half width b with {elements:.0f} equal "
        "elements over it, and the exact ones, which are unbounded at the edge. The shear is that "
        "of the body on the punch, towards the middle. At the standard element's node on the axis "
        "of the round punch the integral of the shape function is zero."
    )


def caption_convergence_below_punches(results: Results) -> str:
    """Return the caption of the convergence figure, including observed orders."""
    even, graded = (
        results.scalar(f"V3/smooth-pw-T6{mesh}", "order_pressure_own_inner")
        for mesh in MESH_LINE_STYLES
    )
    return (
        "Root mean square error of the contact pressure (own-function) below the "
        "inner 80 % of flat punches. Observed orders of the new triangle, smooth punch: "
        f"{even:.2f} on uniform meshes, {graded:.2f} on graded ones, as the singularity allows. "
        "The composite triangle has the nodal forces of the new one here."
    )


MESH_LINE_STYLES = {"": "-", "-graded": "--"}
"""Line styles of uniform and graded meshes, by the suffix of the case name."""
PRESSURE_CASE_KEYS = [
    f"V3/{kind}-{curve}" for kind in PUNCHES for curve in ("galerkin-T6", "pw-T6", "exact")
]
CONVERGENCE_CASE_KEYS = [
    f"V3/{kind}-{element}{mesh}"
    for kind in PUNCHES
    for element in convergence.ELEMENTS
    for mesh in MESH_LINE_STYLES
]
FIGURES = [
    PageFigure(
        "v3_punch_pressure",
        draw_tractions_below_punches,
        needs=PRESSURE_CASE_KEYS,
        caption=caption_tractions_below_punches,
        alt="Four plots of tractions over x, even in the middle and rising steeply to the punch's "
        "edge, the shear from zero. Markers of both elements lie on the exact curves but for the "
        "last element.",
    ),
    PageFigure(
        "v3_punch_convergence",
        draw_convergence_below_punches,
        needs=CONVERGENCE_CASE_KEYS,
        caption=caption_convergence_below_punches,
        alt="Three log-log plots of error over the number of elements. Solid lines of even meshes "
        "fall with slope one, dashed ones of graded meshes with slope one and a half; the native "
        "quadrilateral lies lowest.",
    ),
]

VERIFICATION = r"""
| smooth flat punch, graded mesh, inner 80 % | exact {{ cite("sadowsky") }} | pressure, rms | {{ pct(s("V3/smooth-pw-T6-graded", "error_pressure_own_inner")) }} | {{ pct(s("V3/smooth-galerkin-T6-graded", "error_pressure_own_inner")) }} |
"""

# Findings

CHECKS = [
    check(
        "V3-graded-low",
        "With elements finer towards the edge (x = b (1 - (1 - s)^1.5)) it converges with "
        "order 1.5, not less.",
        lambda results: smallest(
            results, section="V3", cases={"graded": True}, name="order_pressure_own_inner"
        ),
        ">=",
        1.5,
        tolerance=0.2,
        tolerance_why="0.2: the observed order is not yet asymptotic",
        why="The element at the edge is b/n^1.5 long.",
    ),
    check(
        "V3-transfer",
        "T times the standard triangle's nodal forces below the smooth punch are the new one's.",
        lambda results: curve_difference(
            results,
            key="V3/smooth-galerkin-T6",
            name="force_n_T",
            other="V3/smooth-pw-T6",
            other_name="force_n",
        ),
        "=",
        0.0,
        tolerance=1e-09,
        tolerance_why="round-off of the contact iteration",
        why="All nodes touch from the first iteration on, so that both solve the same equations"
        " (section T).",
    ),
]

FINDINGS = r"""
**Flat punches.** Below rigid flat punches (smooth, bonded and round) the pressure is singular at the edge. All elements
have the order that the singularity allows: the new triangle
{{ fixed(s("V3/smooth-pw-T6", "order_pressure_own_inner"), 2) }} on uniform and
{{ fixed(s("V3/smooth-pw-T6-graded", "order_pressure_own_inner"), 2) }} on graded meshes (own-function pressure, inner
80 %). The errors of the standard and the new triangle are alike. $\boldsymbol{T}$ times the standard forces gives the new
ones to a relative
{{ num(measure("curve_difference", key="V3/smooth-galerkin-T6", name="force_n_T", other="V3/smooth-pw-T6", other_name="force_n"), 1) }},
since all nodes are in contact from the start.
"""

FURTHER_FINDINGS = r"""
1. With pressures by the nodes' own test functions, all elements have the orders that the singularity allows:
   {{ fixed(s("V3/smooth-pw-T6", "order_pressure_own_inner"), 2) }} on uniform meshes and
   {{ fixed(s("V3/smooth-pw-T6-graded", "order_pressure_own_inner"), 2) }} on graded ones for the new triangle below the
   smooth punch. The standard and the new triangle have the same errors there; those of the native quadrilateral are
   {{ fixed(1 / measure("ratio", key="V3/smooth-pw-Q9-graded", other="V3/smooth-pw-T6-graded", name="error_pressure_own_inner"), 1) }}
   times smaller.
2. On a flat surface the composite triangle also has the same nodal forces.
3. **Bonded.** The total shear of one half is off by {{ num(100 * s("V3/bonded-pw-T6", "error_force_tangential"), 2) }} %
   on the uniform mesh and {{ num(100 * s("V3/bonded-pw-T6-graded", "error_force_tangential"), 1) }} % on the graded one.
   The exact pressure first changes sign at $x = b\,(1 - \epsilon)$ with $\epsilon$ =
   {{ num(s("V3/bonded-exact", "sign_change"), 1) }}, which no mesh resolves.
4. **Round.** The node of the standard elements on the axis opens: the pressure grows outwards, and the node's test
   function, whose integral is zero, turns it into a tensile force. No node of the new elements opens.
5. **Finite bodies.** A body twice as large changes nothing. With fixed outer sides the inner pressure is off by
   {{ num(100 * s("V3/smooth-pw-T6-held", "error_pressure_own_inner"), 2) }} % (smooth),
   {{ num(100 * s("V3/round-pw-T6-held", "error_pressure_own_inner"), 2) }} % (round), including discretisation errors.
"""

# Limits

LIMITS = r"""
The contact zone is given by the punch, so nothing is shown about finding it. A sharp rigid edge is a limit; pressures at
the edge node depend on the mesh alone. The force at which a bonded punch would slip or peel off is not studied.
"""

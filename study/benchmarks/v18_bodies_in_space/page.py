"""Verification of two deformable bodies of tetrahedra that slide on each other in space.

A patch is rotated, blocks slide, and a rotated ball is pressed on a block.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from study.benchmarks.v18_bodies_in_space.problems import (
    flat,
    hertz,
    patch,
    patch_by_calculix,
    slide,
    slide_by_calculix,
    transfer,
)
from study.judge.checks import check
from study.judge.measures.general import largest, scalar
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Results
from study.solutions.calculix.blocks_in_space import PATCHES, SLIDING_BLOCKS
from study.solutions.calculix.calculix import digest_recorded_result

SECTION = "V18"
TITLE = "Two bodies sliding in space"
FACTS = {
    "geometry": "two blocks with a flat or curved common side; a convex and a flat block on others; "
    "a ball on a block, outer sides 2.5 contact radii away",
    "mesh": "T10 or H27 that do not match: 4 on 3, 4 on 12, 3 on 7 elements; T10, 2 and 3 over "
    "the contact radius",
    "material": "neo-Hookean, ν = 0.3",
    "supports": "base and top held and moved; friction 0.3; exact displacements around the ball, "
    "without friction",
    "load": "compression by 10 %, rotation by 70° about a general axis; sliding over ten elements in "
    "20 increments",
    "reference": "uniaxial stress; Coulomb; Hertz; CalculiX on the same meshes",
    "uncertainty": "the convex block has no known forces",
}

# Problem

PROBLEM = r"""
As in {{ ref("V17") }}, but in space: two bodies of tetrahedra or hexahedra, whose meshes do not match, slide and turn at large
strains.
"""

THEORY = r"""
**Patch.** Two blocks with a common side, flat or of curvature 0.14 over their width, are compressed by 10 %. Base and top move
as in uniaxial stress, lateral sides are free, and both blocks stick together: the exact solution is uniform, with the
pressure $p\,n_z^2$ on the common side with the normal $\boldsymbol{n}$. Then base and top are rotated by 70° about
(1, -2, 2) in four increments.

**Sliding.** A convex block is pressed into a long one, and slid over ten of its elements in 20 increments. A flat block slides
on one whose upper side is held vertically, so that it stays flat; once as it is, and once with all lateral displacements
held, so that all nodes slip in one direction.

**Hertz.** A ball and a block start rotated by 70° and are pressed together, with the exact displacements of two half spaces
on all outer sides {{ cite("johnson") }}.

**CalculiX** {{ cite("calculix") }} computes the patch and the sliding block (C3D10) by a penalty of 1000 moduli over the
length, at points of the slave's faces, and by its mortar method; we then use its energy. It takes at least 16 increments
for each of ours in the patch, 4 in sliding. Pressures are those that it prints for nodes; nodal forces, those of its
elements under its displacements.
"""

# Method

METHOD = r"""
Weights are linear on triangles between all nodes, and bilinear on quadrilaterals of H27; distances are those of the
curved facets. The library refuses standard elements, which have other weights; here the same mortar transfers their forces. Dual quadratic multipliers need another
basis of displacements in space, because the weights of corners have no mean; only their transfer of a uniform pressure
between flat sides is computed, as in {{ ref("V11") }}.

Pressures are nodal forces over the integrals of the nodes' own weights on the deformed facets. Nodes with less than 2 % of
the largest weight, which are corners of the standard T10, have none. The radius of Hertz' contact follows from the mean of
$r^2$, weighted by forces, which is $2\,a^2/5$. Ripple is the largest deviation of a force from a parabola over the last 14
increments.
"""

# Cases

ELEMENTS = ("pw-T10", "galerkin-T10")
NEW_ELEMENTS = ("pw-T10", "pw-H27")
CURVATURES = {"flat": 0.0, "curved": 0.14}
HERTZ_MESHES = (2, 3)

CASES = [
    *(
        Case("V18", f"patch-{name}-{element}", patch, {"element": element, "curvature": curvature})
        for name, curvature in CURVATURES.items()
        for element in (*ELEMENTS, "pw-H27")
    ),
    Case(
        "V18", "transfer-galerkin-T10", transfer, {"element": "galerkin-T10", "method": "p2-dual"}
    ),
    *mark_costly(
        [
            Case("V18", f"slide-{element}", slide, {"element": element})
            for element in (*ELEMENTS, "pw-H27")
        ],
        "slide-galerkin-T10",
    ),
    *(
        Case("V18", f"{name}-{element}", flat, {"element": element, "plane_strain": plane_strain})
        for name, plane_strain in (("flat", False), ("flat-plane-strain", True))
        for element in NEW_ELEMENTS
    ),
    *mark_costly(
        [
            Case(
                "V18", f"hertz-{element}-{n}", hertz, {"element": element, "elements_per_radius": n}
            )
            for n in HERTZ_MESHES
            for element in ELEMENTS
        ],
        "hertz-*-3",
    ),
    *mark_costly(
        Case(
            "V18",
            f"calculix-{case}",
            problem,
            {"element": "pw-T10", "case": case, "tracked": digest_recorded_result(case)},
        )
        for problem, cases in ((patch_by_calculix, PATCHES), (slide_by_calculix, SLIDING_BLOCKS))
        for case in cases
    ),
]

# Results

DETAILS = r"""
{{ figure("v18_patch") }}

{% call table("v18-patch", "Uniform stress across a common side, rotated by 70°: largest errors, over the pressure and over the largest force.") %}
| Side | element | pressure: slave | master | nodes without pressure: slave | master | change by the rotation | moments |
|---|---|---:|---:|---:|---:|---:|---:|
{% for side in ("flat", "curved") %}{% for element in ("pw-T10", "pw-H27", "galerkin-T10") %}{% set case = "V18/patch-" ~ side ~ "-" ~ element %}
| {{ side }} | {{ names[element] }} | {% for name in ("force_over_weight_error", "force_over_weight_error_master", "weightless_nodes", "weightless_nodes_master") %}{{ num(100 * s(case, name), 2) }} % | {% endfor %} {{ most(s(case, "objectivity_error")) }} | {{ most(s(case, "moment_error")) }} |
{% endfor %}{% endfor %}
{% endcall %}

{% call table("v18-slide", "A convex block slid over ten of its elements. Iterations include those of abandoned attempts.") %}
| Element | iterations, mean | divided increments | order of convergence | ripple: normal force | friction | T / N |
|---|---:|---:|---:|---:|---:|---:|
{% for element in ("pw-T10", "pw-H27", "galerkin-T10") %}{% set case = "V18/slide-" ~ element %}
| {{ names[element] }} | {{ fixed(s(case, "iterations_mean"), 1) }} | {{ fixed(s(case, "cut"), 0) }} | {{ fixed(s(case, "convergence_order"), 1) }} | {{ num(100 * s(case, "ripple_N"), 2) }} % | {{ num(100 * s(case, "ripple_T"), 2) }} % | {{ fixed(s(case, "T_over_N"), 4) }} |
{% endfor %}
{% endcall %}

{% call table("v18-hertz", "A ball on a block, both rotated by 70°: errors relative to Hertz. The root mean square is over nodes within 0.8 contact radii.") %}
| Elements over the radius | element | force | contact radius: ball | block | peak pressure: ball | block | pressure, rms: ball | block |
|---|---|---:|---:|---:|---:|---:|---:|---:|
{% for n in (2, 3) %}{% for element in ("pw-T10", "galerkin-T10") %}{% set case = "V18/hertz-" ~ element ~ "-" ~ n %}
| {{ n }} | {{ names[element] }} | {{ num(100 * s(case, "force_error"), 2) }} % |{% for name in ("radius", "peak", "pressure") %} {{ num(100 * s(case, name ~ "_error"), 2) }} % | {{ num(100 * s(case, name ~ "_error_master"), 2) }} % |{% endfor %}

{% endfor %}{% endfor %}
{% endcall %}

{% call table("v18-calculix", "CalculiX on the same meshes, with the same energy. Patch: errors of the force, and of pressures at the slave's nodes, before and after rotation.") %}
| Patch | program | force | rotated | pressure, median | largest | rotated, median | largest |
|---|---|---:|---:|---:|---:|---:|---:|
{% for side in ("flat", "curved") %}{% for words, kind, prefix in (("new T10", "surface", ""), ("CalculiX, surface", "surface", "calculix_"), ("CalculiX, mortar", "mortar", "calculix_")) %}{% set case = "V18/calculix-patch-in-space-" ~ side ~ "-" ~ kind %}
| {{ side }} | {{ words }} |{% for name in ("force_error", "force_error_rotated", "median_error", "largest_error", "median_error_rotated", "largest_error_rotated") %} {{ num(100 * s(case, prefix ~ name), 2) }} % |{% endfor %}

{% endfor %}{% endfor %}
{% endcall %}

{% call table("v18-calculix-sliding", "The sliding block by CalculiX: forces at the end; increments and CPU time of the program to press it and slide over one element (least of three runs).") %}
| Program | N | T | ripple: N | T | increments | CPU time, s |
|---|---:|---:|---:|---:|---:|---:|
{% for words, kind, prefix, row in (("new T10", "surface", "", "pw-T10-1-Direct"), ("CalculiX, surface", "surface", "calculix_", "C3D10-1-CalculiX-surface"), ("CalculiX, mortar", "mortar", "calculix_", "C3D10-1-CalculiX-mortar")) %}{% set case = "V18/calculix-block-sliding-in-space-" ~ kind %}{% set row = "K/peer-sliding-" ~ row %}
| {{ words }} |{% for name in ("N", "T") %} {{ fixed(s(case, prefix ~ name), 4) }} |{% endfor %}{% for name in ("N", "T") %} {{ num(100 * s(case, prefix ~ "ripple_" ~ name), 2) }} % |{% endfor %} {{ fixed(s(row, "increments"), 0) }} | {{ num(s(row, "whole_seconds"), 2) }} |
{% endfor %}
{% endcall %}
"""

# Figure

PRESSURE_RANGE = Normalize(0.4, 1.6)


def draw_pressures_of_patch_and_sliding_forces(results: Results) -> Figure:
    """Draw nodal pressures on both sides of a rotated patch, and forces of a sliding block."""
    fig, axes = plt.subplot_mosaic(
        [["pw-T10", "pw-T10_master", "force"], ["galerkin-T10", "galerkin-T10_master", "force"]],
        figsize=(PAGE_WIDTH, 4.0),
        width_ratios=(1, 1, 1.25),
    )
    maps = []
    for element in ELEMENTS:
        curves = results.curves(f"V18/patch-flat-{element}")
        for side, body in (("", "slave"), ("_master", "master")):
            ax = axes[element + side]
            maps.append(ax)
            _draw_nodal_pressures(
                ax, *(curves[name + side] for name in ("x", "force", "weight", "exact"))
            )
            ax.set_title(f"{ELEMENT_LOOK[element]['label']}, {body}")
    fig.colorbar(
        ScalarMappable(PRESSURE_RANGE, "RdBu_r"),
        ax=maps,
        location="bottom",
        label="pressure / exact (crosses: node without pressure)",
        aspect=30,
    )
    curves, ax = results.curves("V18/slide-pw-T10"), axes["force"]
    increments = np.arange(1, len(curves["N"]) + 1)
    mean, look = curves["N"].mean(), ELEMENT_LOOK["pw-T10"]
    ax.plot(increments, curves["N"] / mean, **look | {"label": "normal force $N$"})
    friction = {"label": "$|T| / \\mu$", "linestyle": "--", "markerfacecolor": "white"}
    ax.plot(increments, curves["T"] / (0.3 * mean), **look | friction)
    ax.set(title="new T10, sliding", xlabel="increment", ylabel="force / mean $N$")
    ax.set(ylim=(0.9, 1.1), xticks=(0, 5, 10, 15, 20))
    ax.legend(loc="upper right")
    return fig


def _draw_nodal_pressures(
    ax: Axes, x: np.ndarray, force: np.ndarray, weight: np.ndarray, exact: np.ndarray
) -> None:
    has_weight = weight > 0
    pressure = force[has_weight] / (weight * exact)[has_weight]
    ax.scatter(
        x[has_weight, 0],
        x[has_weight, 1],
        c=pressure,
        cmap="RdBu_r",
        norm=PRESSURE_RANGE,
        s=36,
        edgecolors="0.35",
        linewidths=0.4,
    )
    ax.scatter(x[~has_weight, 0], x[~has_weight, 1], marker="x", color="0.35", s=12, linewidths=0.8)
    ax.spines[:].set_visible(False)
    ax.set(aspect="equal", xticks=(), yticks=(), xlim=(-0.58, 0.58), ylim=(-0.58, 0.58))


FIGURES = [
    PageFigure(
        "v18_patch",
        draw_pressures_of_patch_and_sliding_forces,
        needs=["V18/patch-flat-pw-T10", "V18/patch-flat-galerkin-T10", "V18/slide-pw-T10"],
        caption="Nodal pressures on both sides of a rotated flat patch, over the exact one; forces "
        "of a convex block that slides over ten of its elements.",
        alt="Four maps of nodes and a plot. Nodes of the new tetrahedron have the exact pressure; of "
        "the standard one, corners have none, others are up to half off. Forces vary by 2 %.",
    ),
]

VERIFICATION = r"""
| two blocks of tetrahedra, uniform stress, rotated by 70° | exact | pressure, largest, master | {{ most(s("V18/patch-flat-pw-T10", "force_over_weight_error_master")) }} | {{ pct(s("V18/patch-flat-galerkin-T10", "force_over_weight_error_master")) }} |
| a ball on a block, rotated by 70° | Hertz | pressure within 0.8 radii, rms, block | {{ pct(s("V18/hertz-pw-T10-3", "pressure_error_master")) }} | {{ pct(s("V18/hertz-galerkin-T10-3", "pressure_error_master")) }} |
"""

# Findings

CHECKS = [
    check(
        "V18-objective",
        "Two blocks turned by 70 degrees: forces, turned back, and gaps less those before, over the "
        "largest force and the initial gap.",
        lambda results: largest(results, "V18", "patch-.*-pw-.*", "objectivity_error"),
        "<",
        1e-09,
        tolerance_why="what Newton's method leaves",
        tolerance_set="before",
        why="A rigid motion of both bodies leaves the mortar's operators as they are.",
    ),
    check(
        "V18-balance",
        "Sum of the forces on both sides, over the force; and of the moments on flat sides, over "
        "that of their sizes.",
        lambda results: max(
            largest(results, "V18", ".*-pw-.*", "balance_error"),
            largest(results, "V18", "patch-flat-pw-.*", "moment_error"),
        ),
        "<",
        1e-10,
        tolerance_why="round-off",
        tolerance_set="before",
        why="The master receives all of a slave's force, and weights reproduce linear functions.",
    ),
    check(
        "V18-patch",
        "Uniform stress across a flat side: largest error of force over weight, slave and master.",
        lambda results: max(
            largest(results, "V18", "patch-flat-pw-.*", f"force_over_weight_error{side}")
            for side in ("", "_master")
        ),
        "<",
        0.05,
        tolerance_why="none: a bound",
        tolerance_set="before",
        why="Both sides are weighted alike; a uniform pressure is transferred exactly.",
    ),
    check(
        "V18-iterations",
        "A block slid by half an element in each increment: mean number of iterations.",
        lambda results: largest(results, "V18", "slide-pw-.*", "iterations_mean"),
        "<",
        9.0,
        tolerance_why="none: a bound",
        tolerance_set="before",
        why="The tangent has all derivatives of the mortar.",
    ),
    check(
        "V18-quadratic",
        "Share of the increments of sliding whose last violation is at most 1000 times the square of "
        "the one before, or round-off.",
        lambda results: min(
            scalar(results, f"V18/slide-{element}", "quadratic") for element in NEW_ELEMENTS
        ),
        ">",
        0.99,
        tolerance_why="none: all",
        tolerance_set="before",
        why="The tangent has all derivatives of the mortar.",
    ),
    check(
        "V18-friction",
        "A flat side that slips all over: largest error of a node's friction, over Coulomb's.",
        lambda results: largest(results, "V18", "flat-pw-.*", "nodal_friction_error"),
        "<",
        1e-06,
        tolerance_why="what Newton's method leaves",
        tolerance_set="before",
        why="Friction acts at each node along its slip.",
    ),
    check(
        "V18-friction-sum",
        "The friction force less the sum of Coulomb's forces along the slips of all nodes, over the "
        "former.",
        lambda results: largest(results, "V18", "flat-pw-.*", "friction_sum_error"),
        "<",
        1e-10,
        tolerance_why="what Newton's method leaves",
        tolerance_set="before",
        why="The force is the sum of nodal forces, each along its own slip.",
    ),
    check(
        "V18-coefficient",
        "With lateral displacements held, so that all nodes slip in one direction: error of T/N, "
        "over the coefficient of friction.",
        lambda results: largest(results, "V18", "flat-plane-strain-pw-.*", "friction_error"),
        "<",
        1e-06,
        tolerance_why="what Newton's method leaves",
        tolerance_set="before",
        why="Parallel nodal forces add up to the coefficient times the normal force.",
    ),
    check(
        "V18-hertz",
        "A rotated ball on a block, 3 elements over the radius: error of the force.",
        lambda results: scalar(results, "V18/hertz-pw-T10-3", "force_error"),
        "<",
        0.02,
        tolerance_why="none: a bound",
        tolerance_set="before",
        why="The exact displacements are prescribed around both bodies.",
    ),
    check(
        "V18-calculix",
        "The sliding block: largest difference of its forces from CalculiX', over the largest "
        "normal force.",
        lambda results: max(
            scalar(results, "V18/calculix-block-sliding-in-space-surface", f"{force}_difference")
            for force in ("N", "T")
        ),
        "<",
        0.03,
        tolerance_why="penetration, up to 2 % of the depth, and the mesh",
        tolerance_set="after",
        why="Energy and mesh are the same.",
    ),
]

FINDINGS = r"""
**Finding.** Across a flat side, uniform stress is exact with the new tetrahedra, to
{{ most(s("V18/patch-flat-pw-T10", "force_over_weight_error")) }} of the pressure at the nodes of both bodies, and forces turn
with the bodies to {{ most(s("V18/patch-flat-pw-T10", "objectivity_error")) }}. With the forces of the standard element the same
mortar has errors of up to {{ num(100 * s("V18/patch-flat-galerkin-T10", "force_over_weight_error"), 2) }} %. A block slides
over ten of its elements with {{ fixed(s("V18/slide-pw-T10", "iterations_mean"), 1) }} iterations in each increment on average,
and a ripple of {{ num(100 * s("V18/slide-pw-T10", "ripple_N"), 1) }} % of the normal force; the standard element takes
{{ fixed(s("V18/slide-galerkin-T10", "iterations_mean"), 1) }}. With 3 elements over the radius of
Hertz' contact, pressures are off by {{ num(100 * s("V18/hertz-pw-T10-3", "pressure_error"), 2) }} % on the ball and
{{ num(100 * s("V18/hertz-pw-T10-3", "pressure_error_master"), 2) }} % on the block (root mean square), those of the standard
one by {{ num(100 * s("V18/hertz-galerkin-T10-3", "pressure_error"), 2) }} and
{{ num(100 * s("V18/hertz-galerkin-T10-3", "pressure_error_master"), 2) }} %.
"""

FURTHER_FINDINGS = r"""
1. **Curved sides.** The triangles of both meshes do not coincide: the pressure is off by up to
   {{ num(100 * s("V18/patch-curved-pw-T10", "force_over_weight_error"), 2) }} %.
2. **Dual quadratic multipliers** transfer a uniform pressure between flat sides as exactly, to
   {{ most(s("V18/transfer-galerkin-T10", "force_over_weight_error_master")) }}, but
   {{ num(100 * s("V18/transfer-galerkin-T10", "weightless_nodes"), 2) }} % of the slave's nodes, its corners, have no force.
3. **Friction.** Where a whole flat side slips, friction is Coulomb's at each node to
   {{ most(s("V18/flat-pw-T10", "nodal_friction_error")) }}. The quotient $T/N$ of sums is below the coefficient by
   {{ most(s("V18/flat-pw-T10", "friction_error")) }}, because lateral displacements change while the block slides, and nodes
   slip in slightly different directions: along these, Coulomb's forces add up to $T$ to {{ most(s("V18/flat-pw-T10", "friction_sum_error")) }}. With
   lateral displacements held, $T/N$ is the coefficient to {{ most(s("V18/flat-plane-strain-pw-T10", "friction_error")) }}.
{% set flat = "V18/calculix-patch-in-space-flat-surface" %}{% set curved = "V18/calculix-patch-in-space-curved-surface" %}{% set sliding = "V18/calculix-block-sliding-in-space-surface" %}
4. **CalculiX is closer on a curved side** that is pressed: its pressures at points of the slave are off by at most
   {{ num(100 * s(curved, "calculix_largest_error"), 2) }} %, and its forces over weights by
   {{ num(100 * s(curved, "calculix_force_over_weight_error"), 2) }} %, ours by
   {{ num(100 * s(curved, "largest_error"), 2) }} %; its corners have no force. Its penalty costs
   {{ num(100 * s(flat, "calculix_force_error"), 1) }} % of the force. Rotation spoils its pressures by up to
   {{ num(100 * s(flat, "calculix_largest_error_rotated"), 2) }} and
   {{ num(100 * s(curved, "calculix_largest_error_rotated"), 2) }} %. Its mortar method loses nodes at the rim, but is
   steadier. Forces of the sliding block differ from ours by at most {{ num(100 * s(sliding, "N_difference"), 1) }} ($N$) and
   {{ num(100 * s(sliding, "T_difference"), 1) }} % of $N$ ($T$); ripples are alike.
5. **Hexahedra** transfer a uniform pressure between flat sides to
   {{ most(s("V18/patch-flat-pw-H27", "force_over_weight_error_master")) }}; the block slides with
   {{ fixed(s("V18/slide-pw-H27", "iterations_mean"), 1) }} iterations and a ripple of
   {{ num(100 * s("V18/slide-pw-H27", "ripple_N"), 1) }} %.
"""

# Limits

LIMITS = r"""
With 2 elements over the radius, pressures on the ball, the slave, are as inaccurate with the new element
({{ num(100 * s("V18/hertz-pw-T10-2", "pressure_error"), 2) }} %) as with the standard one. The standard H27 is not
compared, and H27 is not compared with CalculiX. `./run nightly` computes the recorded cases.
"""

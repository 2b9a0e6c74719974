"""Verification of two deformable bodies at large sliding: a die, rings, and a press fit.

Neo-Hookean bodies with meshes that do not match are in contact. The balance of forces, the
smoothness of nodal forces on both sides, friction at the nodes, and iterations of Newton's method
are measured. Forces should depend neither on the choice of the slave nor on a rotation of both
bodies nor on the increments. The pressure of an incompressible press fit has a known value. The
problems are in `problems`.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.benchmarks.v17_bodies.problems import (
    against_calculix,
    die,
    fit,
    ironed,
    rings,
    turned,
)
from study.judge.checks import check
from study.judge.measures.general import scalar
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Results
from study.solutions.calculix.calculix import digest_recorded_result
from study.solutions.calculix.die import DIES

SECTION = "V17"
TITLE = "Two deformable bodies at large sliding"
FACTS = {
    "geometry": "a parabolic die of width 1 on a block 4 × 1; half rings of radii 0.7 and 1; tubes "
    "of radii 1 to 1.5 and 1.55 to 2",
    "mesh": "curved T6 that do not match, 16 over the die's width, 8 to 24 of the block; 24 × 2 "
    "and 17 × 2 of the rings; 8 and 6 through the tubes",
    "material": "neo-Hookean; plane strain, ν = 0.3; axisymmetric and hybrid, ν = 0.49999",
    "supports": "back sides held and moved, smooth tubes, otherwise μ = 0.3",
    "load": "the die pressed by 0.15 in 4 and slid over ten of its elements in 16 increments; both "
    "bodies turned by 90° and 170°; rings pressed by 0.3; the inner tube's hole grown by 35 %",
    "reference": "balance of forces; forces before bodies are turned; incompressible tubes; 100 "
    "random problems by outside arithmetic",
    "uncertainty": "no forces of the sliding problems are known: properties are judged",
}
SHORT_FACTS = {
    "reference": "balance; forces before turning; tubes; random problems",
    "uncertainty": "properties are judged, no forces known",
}

# Problem

PROBLEM = r"""
Two deformable bodies slide on each other with meshes that do not match. Dual mortar weights {{ cite("popp") }}, normals
and partners are those of the deformed sides, found anew in each iteration.
"""

THEORY = r"""
A parabolic die is pressed into a block and slid over ten of its elements with friction; the pressed bodies are turned
together; two half rings are pressed together; an inner tube is opened until it presses an outer one, both incompressible;
a flat die is slid on a block whose upper side stays flat.

For comparison the die is also computed with the standard element and dual quadratic multipliers, on curved sides and with
as consistent a tangent; and, on one of the meshes, with CalculiX (CPE6, surface to surface, by a penalty), whose energy
is then ours, too.
"""

# Method

METHOD = r"""
Sides are polylines through all nodes, along which the weights are linear. Slip is the change of the mortar operators
since the start of the increment, applied to the present positions, so that a rigid motion of both bodies is no slip. The
tangent has the derivatives of weights, duals, normals and segments by all positions, by automatic differentiation.
"""

# Cases


def _make_die_case(element: str, name_suffix: str, n_block_elements: int) -> Case:
    parameters = {"element": element, "own": 12, "opposite": n_block_elements}
    return Case("V17", f"die-{element}-{name_suffix}", die, parameters)


CASES = [
    _make_die_case("pw-T6", "equal", 12),
    _make_die_case("pw-T6", "finer", 18),
    _make_die_case("pw-T6", "coarser", 6),
    _make_die_case("galerkin-T6", "equal", 12),
    *mark_costly(
        [_make_die_case("galerkin-T6", "finer", 18), _make_die_case("galerkin-T6", "coarser", 6)]
    ),
    Case("V17", "turned-pw-T6-90", turned, {"element": "pw-T6", "degrees": 90}),
    Case("V17", "turned-pw-T6-170", turned, {"element": "pw-T6", "degrees": 170}),
    Case("V17", "ironed-pw-T6", ironed, {"element": "pw-T6"}),
    Case("V17", "rings-pw-T6", rings, {"element": "pw-T6"}),
    Case("V17", "fit-pw-hybrid-T6", fit, {"element": "pw-hybrid-T6"}),
    *(
        Case(
            "V17",
            f"calculix-pw-T6-{case}",
            against_calculix,
            {"element": "pw-T6", "case": case, "tracked": digest_recorded_result(case)},
        )
        for case in DIES
    ),
]

# Results

DETAILS = r"""
{{ figure("v17_die") }}

{% call table("v17-die", "A die slid over ten of its elements, 20 increments. Iterations include those of abandoned attempts; mid-side over corner of forces, and of forces over the nodes' own weights.") %}
| Elements over the die's width: die (slave), block | element | iterations, mean | mid-side over corner, forces: die | block | over weights: die | block | largest tension over peak, block | T / N |
|---|---|---:|---:|---:|---:|---:|---:|---:|
{% for name, words in (("coarser", "12, 6"), ("equal", "12, 12"), ("finer", "12, 18")) %}{% for element, called in (("pw", "new"), ("galerkin", "standard")) %}{% set case = "V17/die-" ~ element ~ "-T6-" ~ name %}
| {{ words }} | {{ called }} | {{ fixed(s(case, "iterations_mean"), 1) }} | {{ fixed(s(case, "mid_over_corner"), 3) }} | {{ fixed(s(case, "mid_over_corner_master"), 3) }} | {{ fixed(s(case, "mid_over_corner_pressure"), 3) }} | {{ fixed(s(case, "mid_over_corner_pressure_master"), 3) }} | {{ num(100 * s(case, "edge_draw"), 2) }} % | {{ fixed(s(case, "T_over_N"), 4) }} |
{% endfor %}{% endfor %}
{% endcall %}
"""

# Figure


def draw_forces_of_die_and_block(results: Results) -> Figure:
    """Draw nodal forces on a sliding die and its block, and the total force over increments."""
    fig, (die_axis, block_axis, force_axis) = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.4))
    block_axis.sharey(die_axis)
    for element in ("galerkin-T6", "pw-T6"):
        curves = results.curves(f"V17/die-{element}-equal")
        total = curves["force_n"].sum()
        die_axis.plot(curves["x"], 100 * curves["force_n"] / total, **ELEMENT_LOOK[element])
        order = np.argsort(curves["master_x"])
        x, force = curves["master_x"][order], curves["master_force"][order]
        block_axis.plot(x, 100 * force / total, **ELEMENT_LOOK[element])
        for component, line in (("N", "-"), ("T", "--")):
            look = ELEMENT_LOOK[element] | {"linestyle": line, "label": None}
            increments = np.arange(1, len(curves[component]) + 1)
            force_axis.plot(increments, np.abs(curves[component]), **look)
    die_axis.set(title="die (slave)", xlabel="$x$", ylabel="normal nodal force / sum, %")
    block_axis.set(title="block (master)", xlabel="$x$", xlim=(0.2, 1.4))
    force_axis.set(title="N (solid), |T| (dashed)", xlabel="increment", ylim=(0, 0.2))
    force_axis.set_xticks((0, 5, 10, 15, 20))
    force_axis.set_ylabel("force of the die / $(G \\times 1)$")
    fig.legend(*die_axis.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return fig


FIGURES = [
    PageFigure(
        "v17_die",
        draw_forces_of_die_and_block,
        needs=["V17/die-galerkin-T6-equal", "V17/die-pw-T6-equal"],
        caption="A die slid over a block with as many elements over its width: normal nodal "
        "forces on both sides at the end, and normal and friction force during pressing (four "
        "increments) and sliding (sixteen).",
        alt="Three plots. Nodal forces of the standard element alternate on both sides, those of "
        "the new one form bells. The normal force rises in the first four increments and stays; "
        "the friction force rises in the next three.",
    ),
]

VERIFICATION = r"""
| two incompressible tubes, one within the other | exact | pressure, largest | {{ pct(s("V17/fit-pw-hybrid-T6", "pressure_error")) }} (hybrid) | |
"""

# Findings

CHECKS = [
    check(
        "V17-objective-90",
        "Two bodies at large sliding: forces after both have been turned by 90 degrees, "
        "turned back, less those before, over the largest.",
        lambda results: scalar(results, key="V17/turned-pw-T6-90", name="objectivity_error"),
        "<",
        1e-09,
        tolerance_why="what Newton's method leaves",
        tolerance_set="before",
        why="Slip is measured by the change of the mortar's operators, which a rigid motion "
        "leaves as they are.",
    ),
    check(
        "V17-rings",
        "Two half rings pressed together: difference of the forces with either ring as the slave.",
        lambda results: scalar(results, key="V17/rings-pw-T6", name="side_difference"),
        "<",
        0.03,
        tolerance_why="the meshes' errors",
        tolerance_set="before",
        why="Both sides are weighted alike.",
    ),
    check(
        "V17-fit",
        "Press fit of incompressible tubes: error of the pressure.",
        lambda results: scalar(results, key="V17/fit-pw-hybrid-T6", name="pressure_error"),
        "<",
        0.001,
        tolerance_why="Poisson's ratio 0.49999, and the mesh",
        tolerance_set="before",
        why="Forces are exact for the pressure of a cylinder.",
    ),
]

FINDINGS = r"""
**Finding.** A die slides over ten of its elements in 20 increments, with
{{ fixed(s("V17/die-pw-T6-equal", "iterations_mean"), 1) }} iterations in each on average. The ratio of mid-side to corner
force is {{ fixed(s("V17/die-pw-T6-equal", "mid_over_corner"), 2) }} on the die, the slave, and
{{ fixed(s("V17/die-pw-T6-equal", "mid_over_corner_master"), 2) }} on the block;
{{ fixed(s("V17/die-pw-T6-coarser", "mid_over_corner"), 2) }} on a die that sees the kinks of a block twice as coarse. Dual
weights are negative in places: at the edge of contact, nodes of the block are in tension by
{{ num(100 * s("V17/die-pw-T6-equal", "edge_draw"), 1) }} % of the peak, and those of a finer block by
{{ num(100 * s("V17/die-pw-T6-finer", "edge_draw"), 1) }} %. Forces balance to round-off, and turn with the bodies to
{{ most(s("V17/turned-pw-T6-90", "objectivity_error")) }}. The pressure between two incompressible tubes is off by
{{ most(s("V17/fit-pw-hybrid-T6", "pressure_error")) }}.
"""

FURTHER_FINDINGS = r"""
1. **Frames and sides.** Turned by 170° the forces are off by
   {{ most(s("V17/turned-pw-T6-170", "objectivity_error")) }}. Whichever ring is the slave, the force is the same to
   {{ num(100 * s("V17/rings-pw-T6", "side_difference"), 1) }} %.
2. **Flat sides.** Where the whole of a flat interface slips, $T/N$ is the coefficient of friction to
   {{ most(s("V17/ironed-pw-T6", "friction_error")) }}.
3. **Dual quadratic multipliers.** The standard element converges as well. Its nodal forces alternate, but over the nodes'
   own weights, as multipliers, they are as even as the new element's, and more even on a coarser block, since its sides
   stay curved. At the edge of contact its nodes are more in tension, but less on a finer block.
4. **CalculiX.** Over half of the way $N$ differs by at most
   {{ num(100 * s("V17/calculix-pw-T6-die-8-6", "N_difference"), 1) }} % of the largest $N$, and $T$ by
   {{ num(100 * s("V17/calculix-pw-T6-die-8-6", "T_difference"), 1) }} %. Its contact is a penalty, on quadratic faces.
5. **Moments.** Gaps and polylines keep the moments of both sides from cancelling: they add up to at most
   {{ most(s("V17/die-pw-T6-equal", "moment_defect")) }} of the sum of their sizes.
"""

# Limits

LIMITS = r"""
Sides are polylines: a slave sees the kinks of a coarser master, and mid-side over corner forces swing about one as it
passes them. Let the slave be the finer side all the same: single nodes of a finer master are in tension at the edge of
contact. Section V18 has bodies in space. The standard element's results on meshes of unequal fineness come from a longer
series that is computed and compared by `./run nightly`.
"""

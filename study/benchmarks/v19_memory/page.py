"""Verification of contact of materials with memory: plastic indentation, viscoelastic relaxation.

The problems of plasticity are in `plastic`, those of viscoelasticity in `viscoelastic`.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.benchmarks.v19_memory.plastic import (
    against_calculix,
    first_yield,
    indent,
    restart,
    roller,
    unload,
)
from study.benchmarks.v19_memory.viscoelastic import VISCOELASTIC_CASES, convergence_order
from study.judge.checks import check
from study.judge.measures.general import largest, scalar
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Results
from study.solutions.calculix.calculix import digest_recorded_result
from study.solutions.calculix.plastic import PLASTIC_BLOCKS

SECTION = "V19"
TITLE = "Materials with memory in contact"
FACTS = {
    "geometry": "rigid cylinder (plane strain) and sphere of radius R on a block; one half; a "
    "rubber block and a round seal below a plate",
    "mesh": "T6 of size R/100 up to 0.2 R, growing beyond; for first yield 8 over the contact radius",
    "material": "J2 plasticity at finite strains, E = 1000 Y, ν = 0.3, hardening modulus Y; "
    "incompressible rubber with one Maxwell branch",
    "supports": "smooth base and sides; no friction, or μ = 0.3",
    "load": "depth of 0.012 R in six increments, up to E a / (R Y) = 172; unloading; compression by "
    "30 % and relaxation",
    "reference": "first yield below Hertz' pressure; Prandtl's punch; Tabor's hardness; exact "
    "relaxation",
    "uncertainty": "the block has a finite size; hardness is known to some per cent",
}
REFERENCES = {
    "tabor": {"text": "D. Tabor. The Hardness of Metals. Clarendon Press, Oxford, 1951."},
    "simohughes": {
        "text": "J. C. Simo, T. J. R. Hughes. Computational Inelasticity. Springer, New York, 1998."
    },
    "deuflhard": {
        "text": "P. Deuflhard. Newton Methods for Nonlinear Problems. Springer, Berlin, 2004."
    },
    "oliver": {
        "text": "W. C. Oliver, G. M. Pharr. An improved technique for determining hardness and elastic "
        "modulus. Journal of Materials Research 7, 1564-1583, 1992.",
        "url": "https://doi.org/10.1557/JMR.1992.1564",
    },
}

# Problem

PROBLEM = r"""
Plastic strains are values at quadrature points that belong to a state of contact, like slip. A rigid cylinder and a rigid
sphere indent an elastoplastic block, far beyond first yield, and are removed. Viscoelastic rubber below a plate relaxes.
"""

THEORY = r"""
**First yield.** Below Hertz' pressure von Mises' stress is largest on the axis {{ cite("johnson") }}. It reaches the yield
stress $Y$ at a peak pressure of {{ fixed(s("V19/yield-cylinder-pw-T6", "exact"), 3) }} $Y$ below the cylinder, at a depth of
{{ fixed(s("V19/yield-cylinder-pw-T6", "exact_depth"), 2) }} $a$, and of
{{ fixed(s("V19/yield-sphere-pw-T6", "exact"), 3) }} $Y$ below the sphere, at
{{ fixed(s("V19/yield-sphere-pw-T6", "exact_depth"), 2) }} $a$ ($a$: half width or radius of the contact).

**Plateau.** When the plastic zone has reached the surface, the mean pressure hardly grows any more. Below a flat punch in plane
strain it is Prandtl's $(2 + \pi)\,k = 2.97\,Y$, with the shear yield stress $k = Y/\sqrt{3}$; a cylinder with a shallow imprint
is close to that. Spheres have 2.8 to 3.0 times the flow stress {{ cite("tabor") }}, which hardening raises to
$Y + 0.2\,H a / R$ at Tabor's representative strain.

**Unloading** is elastic at first, with the slope $2 E^* a$ of force over depth below a sphere {{ cite("oliver") }}. Residual
stresses remain.

**Relaxation.** A homogeneous block that is compressed and held has the slow force plus that of the Maxwell branch, which decays
by $e^{-t/\tau}$; if it is compressed at a constant rate, its force is a convolution integral, computed by quadrature.
"""

# Method

METHOD = r"""
The law is that of Simo and Hughes {{ cite("simohughes") }} with logarithmic volume changes. History variables are the inverse
of the plastic right Cauchy-Green tensor and the equivalent plastic strain, at the points of `history_space`; both elements
integrate at the same points. Points on the yield surface at the start of an increment have the elastoplastic tangent at once.
The axisymmetric form is the user's own, with the hoop strain and the weight $2 \pi r$. Hybrid elements have the mean Kirchhoff
stress as a field, with $p = -K \ln J$.

Systems are linear systems with a new factorisation, those of abandoned attempts included. The line search needs a
back-substitution with factors that are there already for each length that it tries {{ cite("deuflhard") }}; these are not
counted. The contact ends where the gap of the next two nodes, extrapolated, is zero. First yield is interpolated between
increments of 1.5 % of the pressure.

The branch is integrated by the midpoint rule (Simo 1987). The time at the start of a step is a history variable, so that each
substep of a divided increment has its own length.
"""

# Cases

INDENTERS = ("cylinder", "sphere")
ELEMENTS = ("pw-T6", "galerkin-T6", "pw-hybrid-T6", "galerkin-hybrid-T6")

CASES = [
    *(
        Case(
            "V19",
            f"yield-{indenter}-{element}",
            first_yield,
            {"element": element, "indenter": indenter},
        )
        for indenter in INDENTERS
        for element in ELEMENTS[:2]
    ),
    *mark_costly(
        [
            Case(
                "V19",
                f"plateau-{indenter}-{element}",
                indent,
                {"element": element, "indenter": indenter},
            )
            for indenter in INDENTERS
            for element in ELEMENTS
        ],
        "plateau-sphere-*",
        "plateau-*-hybrid-*",
    ),
    *mark_costly(
        [
            Case(
                "V19",
                f"friction-cylinder-{element}",
                indent,
                {"element": element, "indenter": "cylinder", "friction": 0.3},
            )
            for element in ELEMENTS[:2]
        ]
    ),
    *mark_costly(
        [
            Case(
                "V19",
                f"calculix-{element}-{case}",
                against_calculix,
                {"element": element, "case": case, "tracked": digest_recorded_result(case)},
            )
            for case in PLASTIC_BLOCKS
            for element in ELEMENTS[:2]
        ]
    ),
    *(Case("V19", f"roller-{element}", roller, {"element": element}) for element in ELEMENTS[:3]),
    *mark_costly(
        [
            Case(
                "V19",
                f"unload-sphere-{element}",
                unload,
                {"element": element, "indenter": "sphere"},
            )
            for element in ELEMENTS[:2]
        ]
    ),
    Case("V19", "restart-pw-T6", restart, {"element": "pw-T6", "indenter": "cylinder"}),
    Case("V19", "restart-pw-hybrid-T6", restart, {"element": "pw-hybrid-T6", "indenter": "sphere"}),
    *VISCOELASTIC_CASES,
]

# Results

DETAILS = r"""
{{ figure("v19_plateau") }}

{% call table("v19-yield", "Hertz' peak pressure, over the yield stress, at first yield.") %}
| Indenter | exact | new | standard | error: new | standard |
|---|---:|---:|---:|---:|---:|
{% for indenter in ("cylinder", "sphere") %}{% set case = "V19/yield-" ~ indenter %}
| {{ indenter }} | {{ fixed(s(case ~ "-pw-T6", "exact"), 3) }} | {{ fixed(s(case ~ "-pw-T6", "peak_pressure_at_yield"), 3) }} | {{ fixed(s(case ~ "-galerkin-T6", "peak_pressure_at_yield"), 3) }} | {{ num(100 * s(case ~ "-pw-T6", "error"), 2) }} % | {{ num(100 * s(case ~ "-galerkin-T6", "error"), 2) }} % |
{% endfor %}
{% endcall %}

{% call table("v19-plateau", "The last of six increments of loading: mean pressure, load, mid-side over corner forces, systems per increment, and largest equivalent plastic strain.") %}
| Indenter | element | mean pressure / Y | load / (Y R) or (Y R²) | mid-side over corner | systems, mean | divided increments | plastic strain |
|---|---|---:|---:|---:|---:|---:|---:|
{% for indenter in ("cylinder", "sphere") %}{% for element in ("pw-T6", "galerkin-T6", "pw-hybrid-T6", "galerkin-hybrid-T6") %}{% set case = "V19/plateau-" ~ indenter ~ "-" ~ element %}
| {{ indenter }} | {{ names[element] }} | {{ fixed(s(case, "mean_pressure_over_yield"), 3) }} | {{ fixed(s(case, "load"), 4) }} | {{ fixed(s(case, "mid_over_corner"), 3) }} | {{ fixed(s(case, "systems_mean"), 1) }} | {{ fixed(s(case, "divided_increments"), 0) }} | {{ fixed(s(case, "plastic_strain"), 3) }} |
{% endfor %}{% endfor %}
{% for element in ("pw-T6", "galerkin-T6") %}{% set case = "V19/friction-cylinder-" ~ element %}
| cylinder, μ = 0.3 | {{ names[element] }} | {{ fixed(s(case, "mean_pressure_over_yield"), 3) }} | {{ fixed(s(case, "load"), 4) }} | {{ fixed(s(case, "mid_over_corner"), 3) }} | {{ fixed(s(case, "systems_mean"), 1) }} | {{ fixed(s(case, "divided_increments"), 0) }} | {{ fixed(s(case, "plastic_strain"), 3) }} |
{% endfor %}
{% endcall %}
"""

# Figure

LABEL_BY_INDENTER = {"cylinder": "(a) cylinder", "sphere": "(b) sphere"}
LIMITS_BY_INDENTER = {"cylinder": (2.97, 2.97), "sphere": (2.8, 3.0)}


def draw_mean_pressures_and_nodal_forces(results: Results) -> Figure:
    """Draw mean pressures below cylinders and spheres, and nodal forces below a cylinder."""
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.7), width_ratios=(1, 1, 1.5))
    for ax, indenter in zip(axes, INDENTERS, strict=False):
        for element in ELEMENTS:
            key = f"V19/plateau-{indenter}-{element}"
            strain, pressure = (
                np.array([results.scalar(key, f"{name}_{k}") for k in range(1, 7)])
                for name in ("strain", "mean_pressure")
            )
            ax.plot(strain, pressure, **ELEMENT_LOOK[element] | {"linewidth": 0.7})
        low, high = LIMITS_BY_INDENTER[indenter]
        ax.axhspan(low - 0.003, high + 0.003, color="0.8", zorder=0)
        ax.set(title=LABEL_BY_INDENTER[indenter], xlabel="$E a / (R\\,Y)$", ylim=(2.5, 3.1))
    axes[0].set_ylabel("mean pressure / $Y$")
    for element in ELEMENTS[:2]:
        curves = results.curves(f"V19/plateau-cylinder-{element}")
        look = ELEMENT_LOOK[element] | {"linewidth": 0.7, "markersize": 3}
        axes[2].plot(curves["x"], 100 * curves["force"], **look)
    axes[2].set(title="(c) cylinder, last increment", xlabel="$x / a$", xlim=(0, 1.15))
    axes[2].set_ylabel("nodal force / load, %")
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=4)
    return fig


FIGURES = [
    PageFigure(
        "v19_plateau",
        draw_mean_pressures_and_nodal_forces,
        needs=[
            *(
                f"V19/plateau-{indenter}-{element}"
                for indenter in INDENTERS
                for element in ELEMENTS
            ),
        ],
        caption="Mean pressure below (a) a cylinder and (b) a sphere, in six increments; grey: "
        "Prandtl's 2.97 and Tabor's 2.8 to 3.0. (c) Nodal forces below the cylinder at the end.",
        alt="Mean pressures rise from 2.6 to the grey limits, alike with all elements. Nodal forces of the standard "
        "element alternate between two levels, those of the new one lie on one level, with "
        "scatter near the edge.",
    ),
]

VERIFICATION = r"""
| sphere on an elastoplastic block, first yield | Hertz, von Mises | peak pressure | {{ pct(s("V19/yield-sphere-pw-T6", "error")) }} | {{ pct(s("V19/yield-sphere-galerkin-T6", "error")) }} |
"""

# Findings

CHECKS = [
    check(
        "V19-first-yield",
        "First yield below cylinder and sphere, both elements: largest error of the peak pressure.",
        lambda results: largest(results, "V19", "yield-.*", "error"),
        "<",
        0.03,
        tolerance_why="8 elements over the contact radius",
        tolerance_set="before",
        why="Up to there the problem is Hertz'.",
    ),
    check(
        "V19-plateau-cylinder",
        "Cylinder: mean pressure over yield stress in the last increment, new element.",
        lambda results: scalar(results, "V19/plateau-cylinder-pw-T6", "mean_pressure_over_yield"),
        "=",
        2.97,
        tolerance=0.09,
        tolerance_why="3 %: the cylinder is no flat punch, and the block hardens",
        tolerance_set="before",
        why="Prandtl's mean pressure is (2 + pi) Y / sqrt(3).",
    ),
    check(
        "V19-plateau-sphere",
        "Sphere: mean pressure over flow stress in the last increment, new element.",
        lambda results: scalar(
            results, "V19/plateau-sphere-pw-T6", "mean_pressure_over_flow_stress"
        ),
        "=",
        2.9,
        tolerance=0.1,
        tolerance_why="the range that experiments have",
        tolerance_set="before",
        why="Tabor's hardness is 2.8 to 3.0 times the flow stress at a representative strain.",
    ),
    check(
        "V19-systems",
        "Cylinder, both elements: linear systems in an increment, mean of six.",
        lambda results: largest(
            results, "V19", "plateau-cylinder-(pw|galerkin)-T6", "systems_mean"
        ),
        "<",
        30.0,
        tolerance_why="none: at most 180 systems in all were asked for",
        tolerance_set="before",
        why="Steps of Newton's method are shortened by the monotonicity test.",
    ),
    check(
        "V19-unloading",
        "Sphere: initial slope of unloading, over 2 E* a, new element.",
        lambda results: scalar(results, "V19/unload-sphere-pw-T6", "slope_over_exact"),
        "=",
        1.0,
        tolerance=0.1,
        tolerance_why="the block is finite, and the surface not flat",
        tolerance_set="after",
        why="Unloading is elastic, and the contact that of a flat punch at first.",
    ),
    check(
        "V19-restart",
        "An increment from a file in the middle of a plastic history: largest difference of a nodal "
        "force or plastic strain, over the largest.",
        lambda results: max(
            largest(results, "V19", "restart-.*", name)
            for name in ("force_difference", "strain_difference")
        ),
        "<",
        1e-12,
        tolerance_why="round-off",
        tolerance_set="before",
        why="Files contain all values at quadrature points.",
    ),
    check(
        "V19-relaxation",
        "A viscoelastic block, compressed suddenly and held: largest relative error of the force over "
        "4 relaxation times in unequal steps.",
        lambda results: scalar(results, "V19/relaxing-pw-hybrid-T6", "force_error"),
        "<",
        1e-10,
        tolerance_why="round-off",
        tolerance_set="after",
        why="The branch decays exactly if the stress of slow deformations is constant.",
    ),
    check(
        "V19-order",
        "A viscoelastic seal: order in the time step by which its force after the compression "
        "converges (3, 6 and 12 steps).",
        lambda results: convergence_order(results, name="ramp_force"),
        "=",
        2.0,
        tolerance=0.15,
        tolerance_why="2.06 was the first value; nodes come into contact one by one",
        tolerance_set="after",
        why="The midpoint rule is of second order.",
    ),
]

FINDINGS = r"""
**Finding.** Both elements yield first at Hertz' pressure, to
{{ num(100 * measure("largest", section="V19", cases="yield-.*", name="error"), 2) }} %, and both reach the plateau: in the last
increment the mean pressure is {{ fixed(s("V19/plateau-cylinder-pw-T6", "mean_pressure_over_yield"), 2) }} $Y$ below the cylinder
(standard: {{ fixed(s("V19/plateau-cylinder-galerkin-T6", "mean_pressure_over_yield"), 2) }}; Prandtl: 2.97), and
{{ fixed(s("V19/plateau-sphere-pw-T6", "mean_pressure_over_flow_stress"), 2) }} times the flow stress below the sphere (standard:
{{ fixed(s("V19/plateau-sphere-galerkin-T6", "mean_pressure_over_flow_stress"), 2) }}). What differs are the nodal forces: below
the cylinder the ratio of mid-side to corner force is {{ fixed(s("V19/plateau-cylinder-pw-T6", "mid_over_corner"), 2) }}, and
{{ fixed(s("V19/plateau-cylinder-galerkin-T6", "mid_over_corner"), 2) }} with the standard element. Six increments take
{{ fixed(6 * s("V19/plateau-cylinder-pw-T6", "systems_mean"), 0) }} systems with the new and
{{ fixed(6 * s("V19/plateau-cylinder-galerkin-T6", "systems_mean"), 0) }} with the standard element. A state from a file continues
with equal forces and plastic strains, to {{ most(measure("largest", section="V19", cases="restart-.*", name="force_difference")) }}.
"""

FURTHER_FINDINGS = r"""
1. **Displacements and hybrids.** Without a pressure field the load of the cylinder differs by
   {{ num(100 * (s("V19/plateau-cylinder-pw-T6", "load") / s("V19/plateau-cylinder-pw-hybrid-T6", "load") - 1), 2) }} % from
   that with one (standard:
   {{ num(100 * (s("V19/plateau-cylinder-galerkin-T6", "load") / s("V19/plateau-cylinder-galerkin-hybrid-T6", "load") - 1), 2) }} %),
   so that isochoric flow hardly locks on these triangles. Hybrids need more systems, up to
   {{ fixed(measure("largest", section="V19", cases="plateau-.*-hybrid-.*", name="systems_mean"), 0) }} in an increment, since some
   increments are divided.
2. **Curved cells.** A roller of curved cells is crushed by 6 % of its radius. The tangent's bulk stiffness becomes large compared
   with its shear stiffness, since the latter falls in plastic flow, and the library warns that the stiffness with piecewise-linear
   weights may be singular ({{ fixed(s("V19/roller-pw-T6", "warnings"), 0) }} warning). Here it is not: the load is
   {{ num(100 * (s("V19/roller-pw-T6", "load") / s("V19/roller-pw-hybrid-T6", "load") - 1) | abs, 2) }} % off the hybrid element's
   and {{ num(100 * (s("V19/roller-pw-T6", "load") / s("V19/roller-galerkin-T6", "load") - 1) | abs, 2) }} % off the standard one's.
3. **Unloading.** The sphere's first unloading has {{ fixed(s("V19/unload-sphere-pw-T6", "slope_over_exact"), 2) }} times the slope
   $2 E^* a$ (standard: {{ fixed(s("V19/unload-sphere-galerkin-T6", "slope_over_exact"), 2) }}). Raised by $5 \cdot 10^{-5} R$ and
   lowered again, it has its former load to {{ most(s("V19/unload-sphere-pw-T6", "reload_error")) }}. Once the sphere is free, the
   block has a radial tension of up to {{ num(s("V19/unload-sphere-pw-T6", "residual_tension"), 2) }} $Y$ and a compression of up to
   {{ num(s("V19/unload-sphere-pw-T6", "residual_compression"), 2) }} $Y$; unloading adds
   {{ num(100 * s("V19/unload-sphere-pw-T6", "plastic_strain_increase"), 1) }} % of the largest plastic strain.
4. **Friction** of 0.3 changes the load of the cylinder by
   {{ num(100 * (s("V19/friction-cylinder-pw-T6", "load") / s("V19/plateau-cylinder-pw-T6", "load") - 1), 2) }} % (standard:
   {{ num(100 * (s("V19/friction-cylinder-galerkin-T6", "load") / s("V19/plateau-cylinder-galerkin-T6", "load") - 1), 2) }} %).
5. **Size of the increments, and CalculiX.** Plastic flow within an increment is integrated to first order only. With
   four increments in place of one, on elements twice as large, the loads differ from those of CalculiX, which takes 54
   increments of its own, by at most
   {{ num(100 * s("V19/calculix-pw-T6-plastic-cylinder", "load_difference"), 2) }} % of the largest (standard:
   {{ num(100 * s("V19/calculix-galerkin-T6-plastic-cylinder", "load_difference"), 2) }} %; CPE6, by a penalty). Six increments
   end {{ num(100 * (1 - s("V19/plateau-cylinder-pw-T6", "load") / s("V19/calculix-pw-T6-plastic-cylinder", "load")), 2) }} %
   lower.
6. **Viscoelastic rubber.** A block that is compressed and held has the exact force, to
   {{ most(s("V19/relaxing-pw-hybrid-T6", "force_error")) }}. After a compression in 3, 6 and 12 steps it is off by
   {{ num(100 * s("V19/ramp-pw-hybrid-T6-3", "force_error"), 2) }},
   {{ num(100 * s("V19/ramp-pw-hybrid-T6-6", "force_error"), 2) }} and
   {{ num(100 * s("V19/ramp-pw-hybrid-T6-12", "force_error"), 2) }} %. The force of a seal, which has no exact value, is
   {{ fixed(s("V19/seal-pw-hybrid-T6-3", "ramp_force"), 4) }}, {{ fixed(s("V19/seal-pw-hybrid-T6-6", "ramp_force"), 4) }} and
   {{ fixed(s("V19/seal-pw-hybrid-T6-12", "ramp_force"), 4) }} shear moduli times its radius.
"""

# Limits

LIMITS = r"""
The contact radius between nodes is uncertain by some per cent, and with it the mean pressures: they do not grow steadily. How
it is measured was decided after first values had been seen: half-way between nodes instead, the sphere's pressure was several
per cent higher in the last increment. The steps towards first yield were refined after errors of up to 1.9 % had been seen.
Near the edge of contact nodal forces scatter with both elements. Increments are large
compared with the yield strain: each increases the plastic strain by up to twenty times this strain, and the path within an
increment is not followed. Equilibrium is not unique after large increments: the new element's sphere, raised at once from 0.012
to 0.009 $R$, reached another solution, in which one node at the edge still touches, drawn out by large plastic strains. Hence
the indenter is raised in smaller increments. Results on spheres, of hybrids, with friction and of the comparison with CalculiX
come from a longer series that is computed and compared by `./run nightly`.
"""

"""What is known about the element: solvability, uniqueness and the family P_k."""

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pw_elements.elasticity.incompressibility import (
    MAX_BULK_OVER_SHEAR_CURVED_CELLS,
    MAX_BULK_OVER_SHEAR_STRAIGHT_CELLS,
    bulk_over_shear,
)
from study.benchmarks.e_element.family import (
    DEGREES,
    NODES_OVER_HALF_WIDTH,
    element_of_degree,
    hertz,
)
from study.benchmarks.e_element.solvability import (
    GROUPS_WITH_ALL_RATIOS,
    POISSONS_RATIOS,
    POISSONS_RATIOS_OF_CONTACT,
    POISSONS_RATIOS_OF_HYBRID,
    ambiguous_contact,
    contact_uniqueness,
    mass_pairs,
    solvability_map,
)
from study.judge.checks import check
from study.publish.plots.style import PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Results

SECTION = "E"
TITLE = "The element: when it has a solution, when only one, and other degrees"
VERIFICATION = ""  # told in the text of the page
FACTS = {
    "geometry": "a unit square or cube, cells stretched up to a thousandfold; a half plane",
    "mesh": "4 × 4 squares, also as triangles; 2 × 2 × 2 cubes, also as tetrahedra; regular, with "
    "moved vertices, with curved edges",
    "material": "linear elastic, ν = 0.3 to 0.5; plane strain, solid",
    "supports": "one side clamped",
    "load": "a body force; a frictionless rigid plane; a rigid parabola",
    "reference": "the standard element on the same meshes; Hertz",
    "uncertainty": "random meshes: what they do not show is not excluded",
}
SHORT_FACTS = {"reference": "the standard element; Hertz"}

# Problem

THEORY = r"""
The element's matrix $\boldsymbol{K}$ is unsymmetric, and its authors prove nothing about it. When is it regular? When
does frictionless contact have one solution? What is the idea worth for other degrees? Section T proves
$\boldsymbol{K} = \boldsymbol{T} \boldsymbol{K}_\mathrm{G}$ for triangles with straight sides ($\boldsymbol{K}_\mathrm{G}$ is
the standard matrix); $\boldsymbol{T}$ is regular, and so is $\boldsymbol{K}$. Nothing is proved for other cells.
"""

# Method

METHOD = r"""
**Solvability.** Let $\boldsymbol{K}_\mathrm{G} = \boldsymbol{L} \boldsymbol{L}^\mathrm{T}$. The map gives, for random meshes
of each cell, the least singular value $\sigma$ of $\boldsymbol{L}^{-1} \boldsymbol{K} \boldsymbol{L}^{-\mathrm{T}}$, which is 1
for the standard element and 0 for a singular matrix; the least eigenvalue of its symmetric part; the sign of
$\det \boldsymbol{K}$; and the difference of the displacements from the standard element's under a uniform body force, in
its energy norm. Cells are *regular* (a linear map of a grid), *straight* (vertices moved by up to 0.1, 0.2 and 0.3 of a
cell) or *curved* (vertices moved by up to 0.1, mid-side, face and centre nodes by up to 0.02, 0.05 and 0.1). They are
compact; or *layers*, 10, 100 and 1000 times as long as high, along the clamped side; or *columns*, which stand on it;
or *needles*, distorted first and stretched then, so that angles approach 180°. Q8 is a pair of triangles with a condensed
node. With a pressure field the norm is that of section V15, and $\sigma$ is relative to the standard hybrid element's.

*Verdicts* were fixed before the map was complete (after T6 and Q8): yes, if no determinant differs in sign from the
standard element's and displacements (with a pressure field, displacements and pressures) differ by at most 10 %; with
care, up to 30 %; no, otherwise.

**Uniqueness.** Let $\boldsymbol{S}$ be the Schur complement of $\boldsymbol{K}$ on the normal displacements of contact nodes.
Frictionless contact has exactly one solution for any loads and gaps if and only if all principal minors of
$\boldsymbol{S}$ are positive. All minors of nine nodes are computed in the plane, and 500 random ones of 25 nodes in space.

**Other degrees.** The weight functions of P$k$ are hat functions on the $k^2$ sub-triangles between equidistant nodes.
Poisson's equation has a known solution on distorted meshes of up to 16 × 16 squares cut in two; Hertz' line contact is that
of section V2, with the same distance of nodes for all degrees. P3 was to be called worth using if, for equally many
unknowns, its pressure in the inner 80 % had at most half the error of P2's.
"""

# Cases

ELEMENTS = ("pw-T6", "pw-Q8", "pw-Q9", "pw-T10", "pw-H27")
ELEMENTS_IN_CONTACT = ("pw-T6", "pw-Q9", "pw-T10", "pw-H27")
GEOMETRIES = ("affine", "straight", "curved")
AMBIGUOUS_CONTACT = (
    ("pw-T6", "curved", 0.499, 0.05, 0),
    ("pw-T10", "straight", 0.4999, 0.2, 6),
    ("pw-H27", "straight", 0.4999, 0.1, 0),
)
"""Element, geometry, Poisson's ratio, shift and seed of contact problems with two solutions."""
HERTZ_DEGREES = (2, 3, 4)

CASES = [
    Case(
        "E",
        f"map-{element}-{geometry}",
        solvability_map,
        {"element": element, "geometry": geometry},
    )
    for element in ELEMENTS
    for geometry in GEOMETRIES
]
CASES += [
    Case(
        "E",
        f"contact-{element}-{geometry}",
        contact_uniqueness,
        {"element": element, "geometry": geometry},
    )
    for element in ELEMENTS_IN_CONTACT
    for geometry in GEOMETRIES[1:]
]
CASES = mark_costly(CASES)
CASES += [
    Case(
        "E",
        f"two-solutions-{element}-{geometry}",
        ambiguous_contact,
        {"element": element, "geometry": geometry, "nu": nu, "shift": shift, "seed": seed},
    )
    for element, geometry, nu, shift, seed in AMBIGUOUS_CONTACT
]
CASES += [
    Case(
        "E",
        f"degree-{degree}",
        element_of_degree,
        {"degree": degree},
        {"compared": [f"galerkin-P{degree}", f"pw-P{degree}"]},
    )
    for degree in DEGREES
]
CASES += [
    Case(
        "E",
        f"hertz-{kind}-P{degree}",
        hertz,
        {"degree": degree, "weights": weights},
        {"method": f"{kind}-P{degree}"},
    )
    for kind, weights in (("pw", "new"), ("galerkin", "standard"))
    for degree in HERTZ_DEGREES
]
CASES += [
    Case("E", f"mass-{element}", mass_pairs, {"element": element})
    for element in ("pw-T6", "pw-T10")
]

# Figure

GEOMETRY_NAMES = {"affine": "regular", "straight": "straight", "curved": "curved"}
LONG_CELLS = {
    "columns-10": "columns 10",
    "columns-100": "columns 100",
    "needles-10": "needles 10",
    "needles-100": "needles 100",
}
HYBRID_GROUPS = {"compact": "compact", "layers": "layers"} | LONG_CELLS
MAX_DIFFERENCES = (0.1, 0.3)
"""Largest differences of displacements for the verdicts yes and with care."""
VERDICTS = {"yes": "#D7EBF7", "care": "#F5C04F", "no": "#8C1C13"}
"""Colours of the verdicts, from light to dark."""


class Entry(NamedTuple):
    """Verdict on a kind of cell, and the number that is printed."""

    verdict: str
    sigma: float


def judge_displacements(results: Results, key: str, groups: Sequence[str], nu: float) -> Entry:
    """Judge an element without a pressure on all meshes of some groups."""
    names = [f"{group}_{nu:g}" for group in groups]
    return _judge(results, key, names, ("sigma_min", "difference", "negative"))


def judge_hybrid(results: Results, key: str, group: str) -> Entry:
    """Judge an element with a pressure, for the worst Poisson's ratio."""
    names = [f"{group}_{nu:g}" for nu in POISSONS_RATIOS_OF_HYBRID]
    return _judge(results, key, names, ("hybrid", "hybrid_difference", "hybrid_negative"))


def _judge(results: Results, key: str, names: Sequence[str], prefixes: Sequence[str]) -> Entry:
    sigma, difference, negative = (
        [results.scalar(key, f"{prefix}_{name}") for name in names] for prefix in prefixes
    )
    allowed = [
        verdict
        for verdict, largest in zip(VERDICTS, MAX_DIFFERENCES, strict=False)
        if max(difference) <= largest
    ]
    return Entry(allowed[0] if allowed and not any(negative) else "no", min(sigma))


def draw_map(results: Results) -> Figure:
    """Draw which cells may be used, by Poisson's ratio and by shape."""
    rows = [(element, geometry) for element in ELEMENTS for geometry in GEOMETRIES]
    keys = [f"E/map-{element}-{geometry}" for element, geometry in rows]
    n_columns = len(POISSONS_RATIOS), len(LONG_CELLS), len(HYBRID_GROUPS)
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 4.6), sharey=True, width_ratios=n_columns)
    by_poissons_ratio = [
        [judge_displacements(results, key, GROUPS_WITH_ALL_RATIOS, nu) for nu in POISSONS_RATIOS]
        for key in keys
    ]
    by_shape = [
        [judge_displacements(results, key, (group,), 0.3) for group in LONG_CELLS] for key in keys
    ]
    with_pressure = [
        [judge_hybrid(results, key, group) for group in HYBRID_GROUPS] if "Q8" not in key else []
        for key in keys
    ]
    labels = [f"{nu:g}".removeprefix("0") for nu in POISSONS_RATIOS]
    _draw_verdicts(axes[0], by_poissons_ratio, labels, r"(a) displacements only: $\nu$")
    _draw_verdicts(axes[1], by_shape, list(LONG_CELLS.values()), r"(b) the same, $\nu = 0.3$")
    title = r"(c) with pressure, $\nu \leq 0.5$"
    _draw_verdicts(axes[2], with_pressure, list(HYBRID_GROUPS.values()), title)
    names = [f"{element.removeprefix('pw-')} {GEOMETRY_NAMES[g]}" for element, g in rows]
    axes[0].set_yticks(range(len(rows)), names, fontsize=7)
    axes[0].invert_yaxis()
    words = {"yes": "yes, use it", "care": "with care", "no": "no"}
    patches = [Rectangle((0, 0), 1, 1, color=colour) for colour in VERDICTS.values()]
    fig.legend(patches, words.values(), loc="outside lower center", ncols=3, fontsize=8)
    return fig


def _draw_verdicts(
    axis: Axes, entries: Sequence[Sequence[Entry]], labels: Sequence[str], title: str
) -> None:
    """Draw rows of entries, which are empty where there is no such element."""
    for row, line in enumerate(entries):
        if not line:
            axis.text(len(labels) / 2 - 0.5, row, "–", ha="center", va="center", fontsize=6)
        for column, entry in enumerate(line):
            corner, colour = (column - 0.5, row - 0.5), VERDICTS[entry.verdict]
            axis.add_patch(Rectangle(corner, 1, 1, facecolor=colour, edgecolor="white"))
            text = f"{entry.sigma:.2f}".removeprefix("0")
            colour = "white" if entry.verdict == "no" else "black"
            axis.text(column, row, text, ha="center", va="center", fontsize=5.5, color=colour)
    axis.set_title(title, fontsize=8)
    axis.set_xticks(range(len(labels)), labels, rotation=90, fontsize=7)
    for row in range(len(GEOMETRIES), len(entries), len(GEOMETRIES)):
        axis.axhline(row - 0.5, color="black", linewidth=0.8)
    axis.set(xlim=(-0.5, len(labels) - 0.5), ylim=(-0.5, len(entries) - 0.5))
    axis.grid(visible=False)
    axis.tick_params(length=0)


def describe_map(results: Results) -> str:
    """Return the text alternative of the map: the largest allowed Poisson's ratio of each cell."""
    limits = []
    for element in ELEMENTS:
        for geometry in GEOMETRIES:
            key = f"E/map-{element}-{geometry}"
            allowed = [
                nu
                for nu in POISSONS_RATIOS
                if judge_displacements(results, key, GROUPS_WITH_ALL_RATIOS, nu).verdict == "yes"
            ]
            name = f"{element.removeprefix('pw-')} {GEOMETRY_NAMES[geometry]}"
            limits.append(f"{name} up to {max(allowed, default=0):g}")
    return (
        "Table of verdicts. Without a pressure field, compact cells and layers are allowed for: "
        + ("; ".join(limits) + ".")
    )


FIGURES = [
    PageFigure(
        "e_map",
        draw_map,
        needs=[f"E/map-{e}-{g}" for e in ELEMENTS for g in GEOMETRIES],
        caption="May I use this cell here? Find its row; then (a) the column of Poisson's ratio, for "
        "compact cells and layers up to 1000 times as long as high; (b) its shape, if it is long; "
        "(c) its shape, if a pressure field is added. Regular: a linear map of a grid; straight: "
        "vertices moved, sides straight; curved: mid-side nodes moved, too. Columns 10: slender bodies "
        "of cells ten times as long as thick; needles 10: distorted cells stretched to ten times their "
        "length, with angles near 180°. Colours are verdicts: displacements differ from the standard "
        "element's by up to 10 % (yes) or 30 % (with care) and no determinant changes its sign; else "
        "no. Numbers are least singular values over all meshes, relative to the standard element's. "
        "Q8 has no variant with pressure.",
        alt=describe_map,
    ),
]

# Results

RESULT = r"""
{{ figure("e_map") }}
"""

DETAILS = r"""
{% call table("e-contact", "Frictionless contact on compact meshes: meshes with a negative principal minor, by Poisson's ratio.") %}
| Element | Meshes | Minors of each | ν = 0.3 | 0.49 | 0.499 | 0.4999 |
|---|---:|---:|---:|---:|---:|---:|
{% for element in ("pw-T6", "pw-Q9", "pw-T10", "pw-H27") %}{% for geometry in ("straight", "curved") %}{% set key = "E/contact-" ~ element ~ "-" ~ geometry %}
| {{ names[element] }}, {{ geometry }} | {{ fixed(s(key, "meshes"), 0) }} | {{ fixed(s(key, "minors") / s(key, "meshes"), 0) }} |{% for nu in ("0.3", "0.49", "0.499", "0.4999") %} {{ fixed(s(key, "meshes_negative_" ~ nu), 0) }} |{% endfor %}

{% endfor %}{% endfor %}
{% endcall %}

{% call table("e-family", "Degrees 1 to 5: least over largest nodal force of a uniform load on a regular mesh; what remains of the difference of K and T times the standard K on a triangle, for a T that may join all nodes, and for one that is assembled; least singular value and least eigenvalue of the symmetric part; condition number and L2 error over the standard element's; observed orders.") %}
| k | Force: standard | new | T, one triangle | T, assembled | σ | symmetric part | Condition, ratio | L2 error, ratio | Order H1 | L2 |
|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|
{% for k in (1, 2, 3, 4, 5) %}{% set key = "E/degree-" ~ k %}
| {{ k }} | {{ fixed(s(key, "least_force_standard"), 2) }} | {{ fixed(s(key, "least_force_new"), 2) }} | {{ num(s(key, "defect_element"), 1) }} | {{ num(s(key, "defect_assembled"), 1) }} | {{ fixed(s(key, "sigma_min"), 2) }} | {{ fixed(s(key, "symmetric_min"), 2) }} | {{ fixed(s(key, "condition_new") / s(key, "condition_standard"), 2) }} | {{ fixed(s(key, "error_L2_new") / s(key, "error_L2_standard"), 2) }} | {{ fixed(s(key, "order_H1_new"), 1) }} | {{ fixed(s(key, "order_L2_new"), 1) }} |
{% endfor %}
{% endcall %}

{% call table("e-hertz", "Hertz' line contact: error of the pressure relative to its peak, per cent, with 24 and 48 nodes over the half width.") %}
| Element | Inner 80 %: 24 nodes | 48 | All nodes: 24 | 48 | Unknowns: 24 | 48 |
|---|---:|---:|---:|---:|---:|---:|
{% for kind, word in (("galerkin", "standard"), ("pw", "new")) %}{% for k in (2, 3, 4) %}{% set key = "E/hertz-" ~ kind ~ "-P" ~ k %}
| {{ word }} P{{ k }} |{% for name in ("error_inner_24", "error_inner_48", "error_24", "error_48") %} {{ num(100 * s(key, name), 2) }} |{% endfor %} {{ fixed(s(key, "unknowns_24"), 0) }} | {{ fixed(s(key, "unknowns_48"), 0) }} |
{% endfor %}{% endfor %}
{% endcall %}
"""

# Findings


def max_bulk_over_shear(element: str, geometry: str) -> float:
    """Return the ratio of bulk and shear modulus beyond which `Body` warns."""
    if geometry == "curved":
        return MAX_BULK_OVER_SHEAR_CURVED_CELLS
    is_limited = element == "pw-T10" or (element == "pw-H27" and geometry == "straight")
    return MAX_BULK_OVER_SHEAR_STRAIGHT_CELLS if is_limited else np.inf


def count_negative_within_limits(results: Results) -> float:
    """Return the number of negative determinants of compact cells and layers within the limits."""
    return sum(
        results.scalar(f"E/map-{element}-{geometry}", f"negative_{group}_{nu:g}")
        for element in ELEMENTS
        for geometry in GEOMETRIES
        for group in GROUPS_WITH_ALL_RATIOS
        for nu in POISSONS_RATIOS
        if bulk_over_shear(nu) <= max_bulk_over_shear(element, geometry)
    )


def largest_difference_of_straight_triangles(results: Results) -> float:
    """Return the largest difference of displacements of straight T6 from standard ones."""
    scalars = results["E/map-pw-T6-straight"].scalars
    return max(value for name, value in scalars.items() if name.startswith("difference"))


def count_negative_minors(results: Results) -> float:
    """Return the number of negative principal minors for Poisson's ratios up to 0.49."""
    return sum(
        results.scalar(f"E/contact-{element}-{geometry}", f"negative_{nu:g}")
        for element in ELEMENTS_IN_CONTACT
        for geometry in GEOMETRIES[1:]
        for nu in POISSONS_RATIOS_OF_CONTACT[:2]
    )


def error_ratio_of_cubic_triangles(results: Results) -> float:
    """Return the inner error of P3 over that of P2 with equally many unknowns.

    The errors of P2 on two meshes are interpolated by a power law.
    """
    coarse, fine = (
        [
            np.log(results.scalar("E/hertz-pw-P2", f"{name}_{n}"))
            for name in ("unknowns", "error_inner")
        ]
        for n in NODES_OVER_HALF_WIDTH
    )
    unknowns = np.log(results.scalar("E/hertz-pw-P3", f"unknowns_{NODES_OVER_HALF_WIDTH[0]}"))
    expected = np.interp(unknowns, [coarse[0], fine[0]], [coarse[1], fine[1]])
    error = results.scalar("E/hertz-pw-P3", f"error_inner_{NODES_OVER_HALF_WIDTH[0]}")
    return float(error / np.exp(expected))


CHECKS = [
    check(
        "E-straight-triangles",
        "On straight triangles of any shape displacements under a uniform body force are those of "
        "the standard element.",
        largest_difference_of_straight_triangles,
        "<",
        1e-4,
        tolerance_why="round-off: condition numbers are up to 1e12",
        tolerance_set="after",
        why="K = T K_G with a regular T, and f = T f_G.",
    ),
    check(
        "E-limits",
        "Up to the ratios of bulk and shear modulus at which `Body` warns, no determinant is "
        "negative on compact cells and layers.",
        count_negative_within_limits,
        "=",
        0.0,
        tolerance_why="none: a count",
        tolerance_set="after",
        why="The limits were set by these meshes.",
    ),
    check(
        "E-minors",
        "Up to a Poisson's ratio of 0.49 no principal minor of a contact stiffness is negative.",
        count_negative_minors,
        "=",
        0.0,
        tolerance_why="none: a count",
        tolerance_set="after",
        why="The matrix is close to the product of T on the contact side and a symmetric one.",
    ),
    check(
        "E-cubic",
        "In Hertz' line contact P3 does not halve the error of P2 with equally many unknowns.",
        error_ratio_of_cubic_triangles,
        ">",
        0.5,
        tolerance_why="the bound that was set for P3 to be worth using",
        tolerance_set="before",
        why="The singular slope at the edge of contact limits all degrees.",
    ),
]

FINDINGS = r"""
**Regular where it is proved, and on compact cells elsewhere.** On straight triangles of any shape displacements are the
standard element's. On other compact cells, and on layers, they differ by at most
{{ pct(measure("largest", section="E", cases="map-.*", name="difference_layers_0.3")) }} at $\nu = 0.3$ and by
{{ pct(measure("largest", section="E", cases="map-.*", name="difference_layers_0.48")) }} at 0.48 (curved T10). Near incompressibility the determinant
changes its sign on curved cells, on layers of T10 at $\nu = 0.49$ already
({{ fixed(s("E/map-pw-T10-curved", "negative_layers_0.49"), 0) }} of 36 meshes), and on straight T10 and H27. The limits of `Body` were
lowered for that reason: on curved cells from a ratio of bulk and shear modulus of 50 ($\nu = 0.49$), where displacements
may differ by {{ pct(s("E/map-pw-T6-curved", "difference_compact_0.49")) }}, to 25; on straight T10 and H27 from 250 (0.498),
where they may differ by {{ pct(s("E/map-pw-H27-straight", "difference_compact_0.498")) }} (and at 0.499 by
{{ pct(s("E/map-pw-H27-straight", "difference_compact_0.499")) }}), to 100 (0.495).
"""

FURTHER_FINDINGS = r"""
1. **Slender tetrahedra are too stiff in bending.** Columns whose cells are 10 times as long as thick bend
   {{ pct(s("E/map-pw-T10-affine", "difference_columns-10_0.3")) }} (regular) and
   {{ pct(s("E/map-pw-T10-straight", "difference_columns-10_0.3")) }} (straight) differently from the standard T10, and at a
   ratio of 100 {{ pct(s("E/map-pw-T10-affine", "difference_columns-100_0.3")) }}, at $\nu = 0.3$ and on undistorted meshes.
   A pressure field does not help
   ({{ pct(s("E/map-pw-T10-affine", "hybrid_difference_columns-10_0.3")) }} at 10). H27 differs by
   {{ pct(s("E/map-pw-H27-affine", "difference_columns-10_0.3")) }}, T6 not at all.
2. **The hybrid element holds on compact cells and layers only.** There no sign differs up to $\nu = 0.5$, displacements and
   pressures differ by at most
   {{ pct(measure("largest", section="E", cases="map-pw-(T6|Q9|T10|H27)-.*", name="hybrid_difference_layers_0.5")) }}, and the
   least singular value is at least
   {{ fixed(measure("smallest", section="E", cases="map-pw-(T6|Q9|T10|H27)-.*", name="hybrid_compact_0.5"), 2) }} of the
   standard hybrid element's. On needles and on curved columns it fails like the others.
3. **Frictionless contact is unique where the element is far from singular.** On straight T6 all minors are positive; the
   sum of reactions that bounds them (page "Solvability" of the guide) is at most
   {{ fixed(s("E/contact-pw-T6-straight", "reaction"), 2) }}, and 4 would be needed. No element has a negative minor up to
   $\nu = 0.49$; beyond the limits of `Body` many meshes have some. Each gives a problem with two solutions: the results
   `two-solutions-*` hold nodes of cells, loads, gaps and forces (curved T6 at $\nu = 0.499$, T10 and H27 at 0.4999), and
   `solve_contact` finds one of the two without a word of the other.
4. **The identity with $\boldsymbol{T}$ is that of degree 2.** On a single triangle it also holds for $k = 3$, not for
   $k = 4$; but the matrix of $k = 3$ joins nodes of different sides, and none can be assembled. A test proves both in
   exact fractions. Displacements of P3 are therefore not the standard ones, but as accurate.
5. **P3 in contact**: with 24 nodes over the half width its pressure is off by
   {{ num(100 * s("E/hertz-pw-P3", "error_inner_24"), 2) }} % of the peak in the inner 80 %, P2's by
   {{ num(100 * s("E/hertz-pw-P2", "error_inner_24"), 2) }} % with two thirds of the unknowns; over all nodes both are at
   0.3 %. The standard P3, whose vertices get an eighth of a side, is off by
   {{ num(100 * s("E/hertz-galerkin-P3", "error_inner_24"), 2) }} %. By the rule that was set it is not worth an element of
   its own, which Basix' macro elements, whose edges are halved, could not provide.
6. **Mass.** On a distorted mesh of T6 {{ fixed(s("E/mass-pw-T6", "complex_lumped"), 0) }} eigenvalues of $\boldsymbol{K}$
   and the lumped mass are complex (imaginary parts up to {{ pct(s("E/mass-pw-T6", "imaginary_lumped")) }} of the largest
   eigenvalue), so that undamped motions grow (section V9). With $\boldsymbol{T}$ times this mass none is, as
   $\boldsymbol{T}^{-1} \boldsymbol{K}$ is symmetric: a pair with even forces and positive eigenvalues, in the plane only.
   With the same $\boldsymbol{T}$ on T10 {{ fixed(s("E/mass-pw-T10", "complex_transferred"), 0) }} instead of
   {{ fixed(s("E/mass-pw-T10", "complex_lumped"), 0) }} eigenvalues are complex; with the sibling none.
"""

# Limits

LIMITS = r"""
Meshes are coarse, with one side clamped and one load; random meshes show what may happen, not what is excluded. Verdicts
compare with the standard element, not with the exact solution. Axisymmetry, plane stress, large strains and friction are
not mapped. No guard of the library looks at the shape of cells: that slender tetrahedra and needles are bad is only told
here. The bound for straight triangles is computed on the listed meshes, not proved for all. Degrees above 2 are tested on
straight triangles; of tetrahedra of degree 3 only the shares of loads are known.
"""

"""Verification of partial slip of two equal bodies in plane strain (Cattaneo, Mindlin)."""

from dataclasses import dataclass
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh
from matplotlib.figure import Figure

from pw_elements import Material, SurfaceNodes, prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, Motion, Parabola, solve_contact
from pw_elements.contact.model import ContactState, MatchingNodes
from pw_elements.elasticity import StressState
from study.judge.checks import check
from study.judge.measures.general import largest, scalar
from study.judge.measures.known_solutions import refinement_order
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_lines import geometrically_growing_lines
from study.meshes.two_body_meshes import add_rotated_body
from study.model.discretisation import Discretisation, discretise, mesh_nodes_and_cells
from study.model.units import assign_unit_one_to_scalars
from study.model.vocabulary import OWN_FUNCTION_READING
from study.publish.plots import convergence
from study.publish.plots.style import ELEMENT_LOOK, LABEL_BOX, PAIR_WIDE_WIDTH
from study.publish.plots.zones import contact_zone_legend_handles, draw_contact_zone_strip
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Result, Results
from study.solutions.half_space import ElasticHalfSpace
from study.solutions.stick_slip import CattaneoPartialSlip

Array = npt.NDArray[np.float64]

SECTION = "V5"
TITLE = "Partial slip: Cattaneo and Mindlin"
FACTS = {
    "geometry": "two equal cylinders, as half planes 5 wide and deep, lengths over the contact's "
    "half width",
    "mesh": "matching, 8, 16 and 32 elements over the half width",
    "material": "linear elastic, plane strain; E = 1, ν = 0.3",
    "supports": "displacements of half planes on the outer sides; contact with μ = 0.4",
    "load": "a normal force P, then a tangential one of μ P/2 in two increments",
    "reference": "C. Cattaneo (1938), R. D. Mindlin (1949)",
    "uncertainty": "errors are root mean squares away from the end of the sticking zone, where the "
    "shear has a vertical tangent",
}
SHORT_FACTS = {"uncertainty": "root mean squares away from the end of the sticking zone"}

# Problem and exact solution

PROBLEM = r"""
Two equal elastic cylinders (plane strain, $\nu = 0.3$) are pressed together by $P$ and then pulled along each other by
$Q$ = {{ short(s("V5/pw-T6-20", "force_tangential") / (s("V5/pw-T6-20", "friction") * s("V5/pw-T6-20", "force_normal")), 3) }}
$\mu P$, with $\mu$ = {{ short(s("V5/pw-T6-20", "friction"), 2) }}. According to Cattaneo and Mindlin
{{ cite("mindlin") }}, the pressure remains that of Hertz, the contact sticks for
$|x| < c = a \sqrt{1 - Q/(\mu P)}$, and the shear is $\mu p$ less $\mu p_0 (c/a) \sqrt{1 - x^2/c^2}$ there.
"""

# Lengths over the half width a of the contact, stresses over E, forces over E a
YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
FRICTION_COEFFICIENT = 0.4
FRICTION_SHARE = 0.5
"""Ratio Q/(mu P) of the tangential force to the friction limit."""
RELATIVE_RADIUS = 1e4
"""Radius of the relative curvature, so large that sliding does not move the contact zone."""
NORMAL_FORCE = np.pi * YOUNGS_MODULUS / (2 * (1 - POISSONS_RATIO**2)) / (4 * RELATIVE_RADIUS)
"""Normal force P for which Hertz's half width of contact is one."""
EXACT_SOLUTION = CattaneoPartialSlip(
    half_width=1.0,
    force=NORMAL_FORCE,
    friction=FRICTION_COEFFICIENT,
    friction_utilisation=FRICTION_SHARE,
)

N_SURFACE_FORCES = 64
"""Number of line forces that replace the tractions; displacements are then exact to round-off."""


def exact_partial_slip_displacement(x: Array, friction_fraction: float) -> np.ndarray:
    """Return exact displacements (n, 2) of the lower half plane at points off the contact.

    They are Gauss-Chebyshev sums over line forces on the surface: the forces of full slip minus a
    correction in the stick zone.

    Args:
        x: Points (n, 2).
        friction_fraction: Ratio Q/(mu P) of the tangential force to the friction limit.
    """
    half_plane = ElasticHalfSpace(YOUNGS_MODULUS, POISSONS_RATIO)
    theta = np.arange(1, N_SURFACE_FORCES + 1) * np.pi / (N_SURFACE_FORCES + 1)
    s, weight = np.cos(theta), 2 / (N_SURFACE_FORCES + 1) * np.sin(theta) ** 2
    normal, zero = NORMAL_FORCE * weight, np.zeros(N_SURFACE_FORCES)
    if not friction_fraction:
        return half_plane.displacement_by_line_forces(x, s, normal, zero)
    stick = float(np.sqrt(1 - friction_fraction))
    stick_correction = (1 - friction_fraction) * FRICTION_COEFFICIENT * normal
    displacement = half_plane.displacement_by_line_forces(
        x, s, normal, FRICTION_COEFFICIENT * normal
    )
    displacement -= half_plane.displacement_by_line_forces(x, stick * s, zero, stick_correction)
    return displacement


# Method

METHOD = r"""
**Two bodies, one rigid surface.** The solution holds if pressure alone does not make the surfaces slide on each other, as
between equal bodies or on an incompressible half plane; near $\nu = 1/2$, though, triangles lock and their nodal forces
oscillate. Both bodies are therefore meshed; the upper one is the lower one rotated by 180°, so that the nodes match. A
change of variables makes the displacement of each lower contact node relative to its upper neighbour; the contact force
at that node is then the interaction of the two bodies, and the problem is again that of a body and a rigid parabola with
the relative curvature. Nothing else in the solver changes.

**Half planes.** On the sides, five half widths away, the displacements of half planes under the known tractions are
prescribed at each step (sums of Flamant's solution), so that there is no truncation error. The radius of the parabola is
$10^4$ half widths: with $10^3$ the sliding visibly shifts the contact zone on the finest meshes.

The pressure is applied in one step and the tangential force in two. There are 8, 16 and 32 elements of equal size over
the half width, so that the edge of the contact zone falls on a node. Errors are root mean squares over $|x| < 0.9 a$.
Those of the shear are also given without $|x| = c \pm 0.1 a$, since the shear has a vertical tangent at $c$ and the error
there is dominated by a single node.
"""

N_INCREMENTS = 2
"""Number of increments of the tangential force."""
ZONE_HALF_WIDTH, BODY_HALF_WIDTH = 1.25, 5.0
"""Half width of the zone whose nodes may touch, and half width of each body."""
MESH_GROWTH = 1.3
"""Size ratio of adjacent elements beside and below the zone."""
MESH_DISTANCE = 1.0
"""Initial distance between the meshes of the two bodies."""
INNER_HALF_WIDTH, MIN_DISTANCE_FROM_STICK_END = 0.9, 0.1
"""Half width of the part where tractions are compared, and minimum distance from the ends of the
stick zone.
"""


def partial_slip(
    element: str, zone_elements: int, far_field: bool = True, increments: int = N_INCREMENTS
) -> Result:
    """Solve the partial-slip problem; compare stick zone and tractions with the exact solution.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        zone_elements: Number of elements over `ZONE_HALF_WIDTH`.
        far_field: Whether the displacements of half planes under the exact tractions are prescribed
            on the outer sides; otherwise these are fixed.
        increments: Number of increments of the tangential force.
    """
    shares = FRICTION_SHARE * np.arange(increments + 1) / increments
    motions = [Motion((0.0, None), (0.0, -NORMAL_FORCE))]
    motions += [
        Motion((None, None), (share * FRICTION_COEFFICIENT * NORMAL_FORCE, -NORMAL_FORCE))
        for share in shares[1:]
    ]
    upper = MatchingNodes(
        _is_on_upper_contact, Parabola((0.0, 0.0), RELATIVE_RADIUS), offset=(0.0, MESH_DISTANCE)
    )
    pair = ContactPair(_is_on_lower_contact, upper, FRICTION_COEFFICIENT, motions)
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    mesh = partial(_build_mesh_of_both_bodies, zone_elements)
    body = discretise(element, mesh, material, StressState.PLANE_STRAIN)
    loads = [_load_replacing_outer_side_displacements(body, share, far_field) for share in shares]
    supports = body.supports([prescribe(body.space, i, _is_on_outer_sides) for i in (0, 1)])
    states = solve_contact(body.K, loads, supports, [pair], body.space)
    return _compare_with_exact_solution(body, states)


def _load_replacing_outer_side_displacements(
    body: Discretisation, friction_fraction: float, far_field: bool
) -> PETSc.Vec:
    """Return the load vector that replaces prescribed displacements of the outer sides.

    The load acts on bodies whose outer sides are fixed.

    Args:
        body: Discretised bodies.
        friction_fraction: Ratio Q/(mu P) of the tangential force to the friction limit.
        far_field: Whether the displacements are the exact ones; otherwise they are zero.
    """
    displacement = body.K.createVecRight()
    if far_field:
        nodes = fem.locate_dofs_geometrical(body.space, _is_on_outer_sides)
        x = body.space.tabulate_dof_coordinates()[nodes, :2]
        is_upper = x[:, 1, None] > MESH_DISTANCE / 2
        rotated = np.where(is_upper, [0.0, MESH_DISTANCE] - x, x)  # the upper body, by 180 degrees
        lower = exact_partial_slip_displacement(rotated, friction_fraction)
        displacement.array.reshape(-1, 2)[nodes] = np.where(is_upper, -lower, lower)
    load = body.K * displacement
    load.scale(-1.0)
    return load


@dataclass(frozen=True)
class _ContactTraction:
    """Computed and exact traction component at the contact nodes.

    Attributes:
        force: Nodal forces (m,).
        computed: Nodal forces over the integrals of the nodes' test functions, (m,).
        exact: Exact tractions (m,) at the nodes.
    """

    force: Array
    computed: Array
    exact: Array

    def relative_l2_errors(self, x: Array, name: str) -> dict[str, float]:
        """Return two relative L2 errors of the traction in the inner part of the contact.

        The error `error_<name>` includes all inner nodes; `error_<name>_apart` excludes nodes near
        the ends of the stick zone.

        Args:
            x: Positions (m,) of the nodes.
            name: Name of the traction.
        """
        is_inner = np.abs(x) < INNER_HALF_WIDTH
        is_away_from_c = is_inner & (
            np.abs(np.abs(x) - EXACT_SOLUTION.stick_half_width) > MIN_DISTANCE_FROM_STICK_END
        )
        weight = np.gradient(x)

        def relative_l2_error(nodes: npt.NDArray[np.bool_]) -> float:
            squares = weight[nodes] * (self.computed - self.exact)[nodes] ** 2
            scale = weight[is_inner] * self.exact[is_inner] ** 2
            return float(np.sqrt(squares.sum() / scale.sum()))

        return {
            f"error_{name}": relative_l2_error(is_inner),
            f"error_{name}_apart": relative_l2_error(is_away_from_c),
        }


def _compare_with_exact_solution(body: Discretisation, states: list[ContactState]) -> Result:
    """Return forces, tractions and stick zone of the last state, with their errors.

    The scalar `stick_off` is the error of the stick zone's half width over the distance between
    nodes.

    Args:
        body: Discretised bodies.
        states: States at the ends of all increments.
    """
    (contact,) = states[-1].pairs
    surface = SurfaceNodes.from_body(body.body, _is_on_lower_contact)
    x, status = contact.position[:, 0], contact.status
    normal, tangential = contact.force_normal, contact.force_tangential[:, 0]
    pressure = _ContactTraction(normal, surface.pressure(normal), EXACT_SOLUTION.pressure(x))
    shear = _ContactTraction(tangential, surface.pressure(tangential), EXACT_SOLUTION.shear(x))
    sticking, is_closed = x[status == STICK], status != OPEN
    left, right = (
        _midpoint_beside_last_sticking_node(x, end) for end in (sticking.min(), sticking.max())
    )
    element_size = ZONE_HALF_WIDTH / _count_elements_over_zone_half_width(x)
    scalars = {
        "force_normal": pressure.force.sum(),
        "force_tangential": shear.force.sum(),
        "iterations": sum(state.iterations for state in states),
        "residual": max(state.residuals.largest() for state in states),
        "sawtooth": surface.sawtooth(pressure.force, is_closed),
        "unevenness": surface.unevenness(pressure.computed, is_closed),
        "peak_pressure": pressure.computed.max(),
        "element_size": element_size,
        "stick": (right - left) / 2,
        "stick_centre": (right + left) / 2,
        "stick_off": abs((right - left) / 2 - EXACT_SOLUTION.stick_half_width) / (element_size / 2),
        "stick_known": EXACT_SOLUTION.stick_half_width,
        "peak_known": EXACT_SOLUTION.peak_pressure,
        "friction": FRICTION_COEFFICIENT,
        "half_width": np.abs(x[is_closed]).max(),
        **pressure.relative_l2_errors(x, "pressure"),
        **shear.relative_l2_errors(x, "shear"),
    }
    scalars = {name: float(value) for name, value in scalars.items()}
    curves: dict[str, np.ndarray] = {
        "x": x,
        "status": status,
        "friction": contact.friction,
        "force_n": pressure.force,
        "force_t": shear.force,
        "pressure": pressure.computed,
        "shear": shear.computed,
        "known_pressure": pressure.exact,
        "known_shear": shear.exact,
        **mesh_nodes_and_cells(body.space),
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=body.K.getSize()[0])


def _midpoint_beside_last_sticking_node(x: Array, last_sticking: float) -> float:
    """Return the midpoint between the last sticking node on one side and its slipping neighbour.

    Args:
        x: Positions (m,) of the contact nodes.
        last_sticking: Position of the last sticking node; its sign defines the side.
    """
    i = int(np.flatnonzero(x == last_sticking)[0])
    neighbour = i + (1 if last_sticking > 0 else -1)
    return float((x[i] + x[neighbour]) / 2)


def _count_elements_over_zone_half_width(x: Array) -> int:
    """Return the number of elements over `ZONE_HALF_WIDTH` from contact-node positions (m,)."""
    return (len(x) - 1) // 4


def _build_mesh_of_both_bodies(zone_elements: int, cell: str) -> Mesh:
    smallest = ZONE_HALF_WIDTH / zone_elements
    in_zone = np.linspace(0.0, ZONE_HALF_WIDTH, zone_elements + 1)
    beside_zone = (
        ZONE_HALF_WIDTH
        + geometrically_growing_lines(smallest, BODY_HALF_WIDTH - ZONE_HALF_WIDTH, MESH_GROWTH)[1:]
    )
    right = np.concatenate([in_zone, beside_zone])
    x_lines = np.concatenate([-right[:0:-1], right])
    y_lines = -geometrically_growing_lines(smallest, BODY_HALF_WIDTH, MESH_GROWTH)[::-1]
    lower = mesh_along_lines(MPI.COMM_SELF, x_lines, y_lines, cell, "left_right")
    return add_rotated_body(lower, MESH_DISTANCE)


def _is_on_lower_contact(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0) & (np.abs(x[0]) < ZONE_HALF_WIDTH + 1e-9)


def _is_on_upper_contact(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], MESH_DISTANCE) & (np.abs(x[0]) < ZONE_HALF_WIDTH + 1e-9)


def _is_on_outer_sides(x: Array) -> npt.NDArray[np.bool_]:
    is_on_end = np.isclose(x[1], -BODY_HALF_WIDTH) | np.isclose(
        x[1], MESH_DISTANCE + BODY_HALF_WIDTH
    )
    return is_on_end | np.isclose(np.abs(x[0]), BODY_HALF_WIDTH)


# Cases

ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
ZONE_ELEMENT_COUNTS = (10, 20, 40)
PARAMETER_VARIANTS: dict[str, dict[str, object]] = {
    "held": {"far_field": False},
    "one-step": {"increments": 1},
    "ten-steps": {"increments": 10},
}
CASES = [
    Case("V5", f"{element}-{n}", partial_slip, {"element": element, "zone_elements": n})
    for element in ELEMENTS
    for n in ZONE_ELEMENT_COUNTS
]
CASES += [
    Case(
        "V5",
        f"pw-T6-20-{name}",
        partial_slip,
        {"element": "pw-T6", "zone_elements": 20} | parameters,
    )
    for name, parameters in PARAMETER_VARIANTS.items()
]
CASES = mark_costly(CASES, "composite-*-[24]0", "*-Q[89]-[24]0")

# Results

RESULT = r"""
{{ figure("v5_cattaneo") }}

{{ figure("v5_cattaneo_convergence") }}

{% call table("v5-partial-slip-errors", "Partial slip: errors.") %}
| Element, 32 over a half width (observed order) | $c/a$ (exact {{ fixed(s("V5/pw-T6-40", "stick_known"), 4) }}) | Pressure, own | Shear, own | Shear, own, apart from $c$ | Mid-side over corner force |
|---|---:|---:|---:|---:|---:|
{% for element, name in elements %}{% set key = "V5/" ~ element ~ "-40" %}
| {{ name }} | {{ fixed(s(key, "stick"), 4) }} |{% for error in ("error_pressure", "error_shear", "error_shear_apart") %} {{ num(s(key, error), 2) }} ({{ fixed(measure("refinement_order", element=element, name=error), 1) }}) |{% endfor %} {{ fixed(s(key, "sawtooth"), 3) }} |
{% endfor %}
{% endcall %}
"""


def draw_partial_slip_tractions(results: Results) -> Figure:
    """Draw the pressure and shear tractions in partial slip, and the contact zones.

    Tractions of the standard and of the new element are compared with exact ones.
    """
    fig, ax = plt.subplots(figsize=(PAIR_WIDE_WIDTH, 3.2))
    for element, key in TRACTION_CASE_KEYS.items():
        curves, peak = results.curves(key), results.scalar(key, "peak_known")
        for quantity, line in (("pressure", "-"), ("shear", ":")):
            look = {**ELEMENT_LOOK[element], "linestyle": line, "markersize": 3}
            look["label"] = f"{look['label']}: {quantity}"
            if element == "pw-T6":  # drawn over the other element
                look |= {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.6}
            scale = peak if quantity == "pressure" else results.scalar(key, "friction") * peak
            ax.plot(curves["x"], curves[quantity] / scale, **look)
    x = np.linspace(-1, 1, 801)
    stick = results.scalar(key, "stick_known")
    pressure = np.sqrt(1 - x**2)
    shear = pressure - stick * np.sqrt(np.maximum(0, 1 - (x / stick) ** 2))
    ax.plot(x, pressure, color="black", linewidth=0.8, zorder=3)
    ax.plot(x, shear, color="black", linewidth=0.8, label="exact", zorder=3)
    ax.set(xlabel="$x/a$", ylabel="$p/p_0$ and $q/(\\mu p_0)$", xlim=(-1.25, 1.25), ylim=(0, 1.1))
    draw_contact_zone_strip(ax, curves)
    handles = [*ax.get_legend_handles_labels()[0], *contact_zone_legend_handles(curves)]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def draw_convergence_of_tractions(results: Results) -> Figure:
    """Draw errors of pressure and shear in partial slip over refinement, one panel each."""
    titles = {
        "error_pressure": f"(a) {OWN_FUNCTION_READING.name} pressure",
        "error_shear_apart": f"(b) {OWN_FUNCTION_READING.name} shear",
    }
    fig, axes = plt.subplots(1, 2, figsize=(PAIR_WIDE_WIDTH, 2.9), sharex=True, sharey=True)
    size = np.array(
        [results.scalar(f"V5/galerkin-T6-{n}", "element_size") for n in ZONE_ELEMENT_COUNTS]
    )
    for ax, (name, title) in zip(axes, titles.items(), strict=True):
        for element in convergence.ELEMENTS:
            errors = [results.scalar(f"V5/{element}-{n}", name) for n in ZONE_ELEMENT_COUNTS]
            ax.plot(1 / size, errors, **ELEMENT_LOOK[element])
        ax.set(xscale="log", yscale="log", xlabel="elements over half width")
        ax.set_title(title, fontsize=8)
        ax.set_xticks(1 / size, [f"{1 / h:.0f}" for h in size], minor=False)
        ax.minorticks_off()
    for order, start in ((1, 1.6e-2), (2, 6e-4)):
        heights = start * (size / size[0]) ** order
        axes[0].plot(1 / size, heights, color="#888888", lw=0.8, ls="--")
        axes[0].annotate(
            f"order {order}",
            (1 / size[1], heights[1]),
            xytext=(3, 4) if order == 1 else (-30, -11),
            textcoords="offset points",
            fontsize=7,
            color="#666666",
            bbox=LABEL_BOX,
        )
    axes[0].set_ylabel("relative error")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def caption_partial_slip_tractions(results: Results) -> str:
    """Return the caption of the tractions, including the half widths of the stick zone."""
    scalars = results[TRACTION_CASE_KEYS["pw-T6"]].scalars
    return (
        f"{OWN_FUNCTION_READING.name.capitalize()} pressure p and shear q between two equal cylinders, pressed "
        "together and then pulled by half of what friction can hold, 16 elements over the half "
        f"width a. Strip: contact zones of the new triangle; it sticks for |x| < "
        f"{scalars['stick']:.3f} a, by Cattaneo and Mindlin for |x| < "
        f"{scalars['stick_known']:.4f} a."
    )


def caption_convergence_of_tractions(results: Results) -> str:
    """Return the caption of the convergence figure, including observed orders."""

    def describe_convergence_orders(element: str) -> str:
        orders = [
            refinement_order(results, element, name)
            for name in ("error_pressure", "error_shear_apart")
        ]
        return f"{ELEMENT_LOOK[element]['label']} {orders[0]:.1f} and {orders[1]:.1f}"

    return (
        "Root mean square errors of contact pressure and shear where |x| < 0.9 a, shear without "
        "the neighbourhood of the ends of the sticking zone. Mean observed orders of "
        "pressure and shear: "
        + "; ".join(map(describe_convergence_orders, convergence.ELEMENTS))
        + "."
    )


TRACTION_CASE_KEYS = {element: f"V5/{element}-20" for element in ("galerkin-T6", "pw-T6")}
FIGURES = [
    PageFigure(
        "v5_cattaneo",
        draw_partial_slip_tractions,
        needs=list(TRACTION_CASE_KEYS.values()),
        caption=caption_partial_slip_tractions,
        alt="Pressure and shear over x: a semi-ellipse, and below it the shear with peaks at both "
        "ends of the sticking zone. Both elements lie on the exact curves.",
    ),
    PageFigure(
        "v5_cattaneo_convergence",
        draw_convergence_of_tractions,
        needs=[
            f"V5/{element}-{n}" for element in convergence.ELEMENTS for n in ZONE_ELEMENT_COUNTS
        ],
        caption=caption_convergence_of_tractions,
        alt="Two log-log plots of error over the number of elements. All errors fall, the composite "
        "triangle's with slope one and the others' with slopes near two.",
    ),
]

VERIFICATION = r"""
| equal cylinders, partial slip | exact | shear, rms | {{ pct(s("V5/pw-T6-40", "error_shear_apart")) }} | {{ pct(s("V5/galerkin-T6-40", "error_shear_apart")) }} |
"""

# Findings

CHECKS = [
    check(
        "V5-stick",
        "Partial slip: the half width of the sticking zone is Cattaneo's and Mindlin's a "
        "sqrt(1 - Q/(mu P)), off by less than half a node distance, for all elements and "
        "meshes.",
        lambda results: largest(
            results, section="V5", cases={"far_field": True, "increments": 2}, name="stick_off"
        ),
        "<",
        0.5,
        tolerance_why="none: half a node distance, since the border is read midway between nodes",
        why="The solution's normal and tangential parts are uncoupled, and so are the computed "
        "ones.",
    ),
    check(
        "V5-shear",
        "Partial slip: root mean square error of the new triangle's shear on the finest "
        "mesh, without the neighbourhood of the sticking zone's ends.",
        lambda results: scalar(results, key="V5/pw-T6-40", name="error_shear_apart"),
        "<",
        0.002,
        tolerance_why="none: 0.2 % is the bound",
        why="32 elements over the half width.",
    ),
]

FINDINGS = r"""
1. All elements find the same stick zone, as close to the exact one as their nodes allow (at most
   {{ fixed(measure("largest", section="V5", cases=".*-(10|20|40)", name="stick_off"), 2) }} node distances off).
2. Divided by the integrals of the nodes' own test functions, the pressures of all elements converge, with order two
   except for the composite triangle, whose order is one.
3. The pressures of the standard and of the new triangle are equally accurate once each is obtained from its own test
   functions. The shear of the new one is somewhat more accurate ({{ num(s("V5/pw-T6-40", "error_shear_apart"), 2) }}
   against {{ num(s("V5/galerkin-T6-40", "error_shear_apart"), 2) }}), and the native quadrilateral is the most accurate
   on all meshes.
4. One, two or ten steps of the tangential force give the same forces to round-off
   ({{ num(measure("curve_difference", key="V5/pw-T6-20-one-step", name="force_t", other="V5/pw-T6-20-ten-steps", other_name="force_t"), 1) }}):
   slip only spreads.
5. With the sides fixed instead, the peak pressure is off by
   {{ fixed(100 * (measure("scalar_ratio", key="V5/pw-T6-20-held", name="peak_pressure", other="peak_known") - 1), 1) }} %.
"""

# Limits

LIMITS = r"""
Contact between the two bodies is restricted to matching nodes and small displacements; it is a change of variables and
not a contact search. Pressure and shear do not influence each other here; in section V4 they do. Unloading, in which slip
reverses, is not tested.
"""

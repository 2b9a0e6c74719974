"""Verification of a wedge that is pushed up a rough incline against springs (NAFEMS CGS-4)."""

from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from matplotlib.figure import Figure

from pw_elements import (
    Material,
    SurfaceNodes,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
)
from pw_elements.contact import OPEN, SLIP, ContactPair, FreeBody, Plane, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from study.judge.checks import check
from study.judge.measures.general import relative_difference, scalar_ratio
from study.model.contact_result import CONTACT_QUANTITIES
from study.model.discretisation import Discretisation, discretise, mesh_nodes_and_cells
from study.model.units import SI_UNITS, assign_unit_one_to_scalars, assign_units_to_scalars
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case
from study.run.pages import PageFigure
from study.run.store import Result, Results

Array = npt.NDArray[np.float64]

SECTION = "V7"
TITLE = "Wedge sliding up a rough incline"
FACTS = {
    "geometry": "a wedge 4 m long and 1.2 m high on an incline of 1:10 (NAFEMS CGS-4; its shape is "
    "this study's)",
    "mesh": "8 × 2, 16 × 4 and 32 × 8 squares",
    "material": "linear elastic, plane strain; E = 10 MPa, ν = 0.3, which do not enter the answer",
    "supports": "contact with μ = 0, 0.1 or 0.2; horizontal springs of 1194, 882 or 563.9 N/m",
    "load": "a weight of 3058 N, then a horizontal push of 1500 N in five increments",
    "reference": "statics of a rigid wedge",
    "uncertainty": "none: the answer is statics alone",
}

# Problem and exact solution

PROBLEM = r"""
A wedge of weight $G = 3058$ N rests on an incline of 1:10 and is pushed uphill by $F = 1500$ N against horizontal springs
(NAFEMS benchmark CGS-4 {{ cite("cgs") }}). By statics it slides while the horizontal contact force is
$(\tan\,\alpha + \mu)/(1 - \mu\,\tan\,\alpha)$ times the weight, where $\alpha$ is the angle of the slope. For each friction
coefficient the springs are chosen so that it comes to rest after 1 m.
"""

INCLINE_SLOPE, WEIGHT, PUSH_FORCE = 0.1, 3058.0, 1500.0
"""Slope of the incline, and weight and push in N."""
SPRING_STIFFNESSES = {0.0: 1194.0, 0.1: 882.0, 0.2: 563.9}
"""Spring stiffness in N/m for which the wedge slides by 1 m, by coefficient of friction."""


def horizontal_to_vertical_force_while_sliding(friction: float) -> float:
    """Return the ratio of horizontal to vertical contact force as a rigid wedge slides uphill."""
    return (INCLINE_SLOPE + friction) / (1 - friction * INCLINE_SLOPE)


def exact_sliding_distance(friction: float) -> float:
    """Return the distance in m that the wedge slides until springs and friction stop it."""
    return (
        PUSH_FORCE - WEIGHT * horizontal_to_vertical_force_while_sliding(friction)
    ) / SPRING_STIFFNESSES[friction]


# Method

METHOD = r"""
The wedge is elastic, 4 m long, and rests on a rigid inclined plane. Its shape and material are this study's choice, since
statics alone determine the answer. The weight is applied first and then the push in five steps; the springs are
distributed over the left side. The wedge is soft (10 MPa), since a body some $10^8$ times as stiff as its springs counts
as unsupported in this library's check of rigid motions.

Without springs, the limit of the push is found by twenty bisections between a push with an equilibrium and one for which
the solver reports an unsupported body.
"""

LENGTH, HEIGHT = 4.0, 1.2
"""Size of the wedge in m, chosen so that no corner lifts; the lower side follows the incline."""
YOUNGS_MODULUS, POISSONS_RATIO = 1e7, 0.3
"""Young's modulus in Pa (soft, so that the springs count as a support) and Poisson's ratio."""
N_PUSH_INCREMENTS = 5
"""Number of increments of the push, which follow the increment of the weight."""
N_BISECTIONS = 20
"""Number of bisections of the interval that contains the limit of the push without springs."""


def sliding(element: str, friction: float, divisions: tuple[int, int]) -> Result:
    """Push the wedge against springs; return contact forces and the sliding distance.

    The scalar `sliding` is the mean horizontal displacement, in m, of the left side, on which the
    springs and the push act; `sliding_known` is its exact value. `ratio` is the ratio of the
    horizontal to the vertical contact force, and `ratio_known` its exact value.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        friction: Coefficient of friction, a key of `SPRING_STIFFNESSES`.
        divisions: Numbers of squares along the wedge and over its height.
    """
    wedge = _discretise_wedge(element, divisions)
    springs = _assemble_left_side_spring_stiffness(wedge, SPRING_STIFFNESSES[friction])
    wedge_on_springs = Discretisation(element, wedge.body, wedge.K + springs)
    weight, push = _assemble_weight_load(wedge), _assemble_push_load(wedge)
    loads = [weight + push * (k / N_PUSH_INCREMENTS) for k in range(N_PUSH_INCREMENTS + 1)]
    states = _solve_wedge_contact_on_rough_incline(wedge_on_springs, loads, friction)

    (contact,) = states[-1].pairs
    force_n, force_t = (
        contact.force_normal,
        -contact.force_tangential @ _unit_vector_up_the_incline(),
    )
    surface = SurfaceNodes.from_body(wedge.body, _is_on_base)
    pressure, closed = surface.pressure(force_n), contact.status != OPEN
    scalars = {
        "force_normal": force_n.sum(),
        "force_tangential": force_t.sum(),
        "iterations": sum(state.iterations for state in states),
        "residual": max(state.residuals.largest() for state in states),
        "sawtooth": surface.sawtooth(force_n, closed),
        "peak_pressure": pressure.max(),
        "slipping": np.mean(contact.status == SLIP),
        "sliding": _mean_horizontal_left_side_displacement(wedge, states[-1].displacement),
        "sliding_known": exact_sliding_distance(friction),
        "ratio": -contact.force[0] / contact.force[1],
        "ratio_known": horizontal_to_vertical_force_while_sliding(friction),
    }
    scalars = {name: float(value) for name, value in scalars.items()}
    kinds = {**CONTACT_QUANTITIES, "slipping": "1", "sliding*": "length", "ratio*": "1"}
    curves: dict[str, np.ndarray] = {
        "x": contact.position[:, 0],
        "force_n": force_n,
        "force_t": force_t,
        "pressure": pressure,
        "shear": surface.pressure(force_t),
        "status": contact.status,
        **mesh_nodes_and_cells(wedge.space),
    }
    return Result(
        scalars,
        assign_units_to_scalars(scalars, kinds, SI_UNITS),
        curves,
        dofs=wedge.K.getSize()[0],
    )


def limit(element: str, friction: float, divisions: tuple[int, int]) -> Result:
    """Find the ratio of push to weight at which a wedge without springs begins to slide.

    The interval from a push that needs no friction to twice the exact limit is bisected. The scalar
    `holds` is the largest ratio for which an equilibrium was found, and `slides` the smallest one
    for which there was none.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        friction: Coefficient of friction.
        divisions: Numbers of squares along the wedge and over its height.
    """
    wedge = _discretise_wedge(element, divisions)
    weight, unit_push = (
        _assemble_weight_load(wedge),
        _assemble_push_load(wedge) * (WEIGHT / PUSH_FORCE),
    )
    exact = horizontal_to_vertical_force_while_sliding(friction)
    holds, slides = INCLINE_SLOPE, 2 * exact
    for _ in range(N_BISECTIONS):
        middle = (holds + slides) / 2
        loads = [weight + unit_push * INCLINE_SLOPE, weight + unit_push * middle]
        try:
            _solve_wedge_contact_on_rough_incline(wedge, loads, friction)
        except FreeBody:
            slides = middle
        else:
            holds = middle
    scalars = {"holds": holds, "slides": slides, "ratio_known": exact}
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=wedge.K.getSize()[0])


def _solve_wedge_contact_on_rough_incline(
    wedge: Discretisation, loads: list[PETSc.Vec], friction: float
) -> list[ContactState]:
    uphill = _unit_vector_up_the_incline()
    incline = ContactPair(_is_on_base, Plane((0.0, 0.0), (-uphill[1], uphill[0])), friction)
    return solve_contact(wedge.K, loads, wedge.supports([]), [incline], wedge.space)


def _discretise_wedge(element: str, divisions: tuple[int, int]) -> Discretisation:
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    return discretise(
        element, partial(_build_wedge_mesh, divisions), material, StressState.PLANE_STRAIN
    )


def _build_wedge_mesh(divisions: tuple[int, int], cell: str) -> Mesh:
    def raise_lower_side_to_incline(x: Array) -> Array:
        position = x.copy()
        position[:, 1] += INCLINE_SLOPE * x[:, 0] * (1 - x[:, 1] / HEIGHT)
        return position

    build = triangles if cell == "triangle" else quadrilaterals
    rectangle = build(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, HEIGHT), divisions)
    return move_nodes(rectangle, raise_lower_side_to_incline)


def _assemble_weight_load(wedge: Discretisation) -> PETSc.Vec:
    area = LENGTH * (HEIGHT - INCLINE_SLOPE * LENGTH / 2)
    return assemble_vector(wedge.body.body_load((0.0, -WEIGHT / area)))


def _assemble_push_load(wedge: Discretisation) -> PETSc.Vec:
    return wedge.surface_load((PUSH_FORCE / HEIGHT, 0.0), _is_on_left_side)


def _assemble_left_side_spring_stiffness(wedge: Discretisation, stiffness: float) -> PETSc.Mat:
    """Assemble the matrix of horizontal springs that are distributed over the left side.

    Args:
        wedge: Discretised wedge.
        stiffness: Total stiffness in N/m.
    """
    spaces = wedge.body.spaces
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    left_side = boundary_measure(spaces.mesh, _is_on_left_side)
    return assemble_matrix(stiffness / HEIGHT * u[0] * v[0] * left_side)


def _mean_horizontal_left_side_displacement(
    wedge: Discretisation, displacement: PETSc.Vec
) -> float:
    """Return the mean horizontal displacement of the left side, in m."""
    u = as_function(wedge.space, displacement)
    left_side = boundary_measure(wedge.body.spaces.mesh, _is_on_left_side)
    return float(fem.assemble_scalar(fem.form(u[0] / HEIGHT * left_side)))


def _unit_vector_up_the_incline() -> Array:
    """Return the unit vector (2,) that points up the incline."""
    return np.array([1.0, INCLINE_SLOPE]) / np.hypot(1.0, INCLINE_SLOPE)


def _is_on_base(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], INCLINE_SLOPE * x[0])


def _is_on_left_side(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


# Cases

ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
MESH_DIVISIONS = ((8, 2), (16, 4), (32, 8))
HIGHEST_FRICTION = max(SPRING_STIFFNESSES)
CASES = [
    Case(
        "V7",
        f"{element}-mu{friction}-{divisions[0]}x{divisions[1]}",
        sliding,
        {"element": element, "friction": friction, "divisions": divisions},
    )
    for element in ELEMENTS
    for friction in SPRING_STIFFNESSES
    for divisions in (MESH_DIVISIONS if friction == HIGHEST_FRICTION else MESH_DIVISIONS[1:2])
]
CASES += [
    Case(
        "V7",
        f"{element}-limit",
        limit,
        {"element": element, "friction": HIGHEST_FRICTION, "divisions": MESH_DIVISIONS[0]},
    )
    for element in ("galerkin-T6", "pw-T6")
]

# Results

RESULT = r"""
{{ figure("v7_wedge") }}

{% call table("v7-wedge-force-ratios-and-sliding-distances", "Wedge: force ratios and sliding distances.") %}
| Element, 16 × 4 |{% for mu in ("0.0", "0.1", "0.2") %} contact force, horizontal / vertical, $\mu$ = {{ mu }} | Sliding / m |{% endfor %} Mid-side over corner force, $\mu = 0.2$ |
|---|---:|---:|---:|---:|---:|---:|---:|
{% for element, name in elements %}
| {{ name }} |{% for mu in ("0.0", "0.1", "0.2") %}{% set key = "V7/" ~ element ~ "-mu" ~ mu ~ "-16x4" %} {{ num(s(key, "ratio"), 8) }} | {{ num(s(key, "sliding"), 7) }} |{% endfor %} {{ fixed(s("V7/" ~ element ~ "-mu0.2-16x4", "sawtooth"), 3) }} |
{% endfor %}
| statics |{% for mu in ("0.0", "0.1", "0.2") %}{% set key = "V7/pw-T6-mu" ~ mu ~ "-16x4" %} {{ num(s(key, "ratio_known"), 8) }} | {{ num(s(key, "sliding_known"), 7) }} |{% endfor %} |
{% endcall %}
"""


def draw_wedge_force_ratio_and_nodal_forces(results: Results) -> Figure:
    """Draw a wedge's force ratio over friction, and nodal forces along its base."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.8))
    mu = np.linspace(0, 0.25, 51)
    left.plot(
        mu,
        [horizontal_to_vertical_force_while_sliding(m) for m in mu],
        color="black",
        lw=1.0,
        label="statics",
    )
    for element in PLOT_ELEMENTS:
        ratios = [results.scalar(f"V7/{element}-mu{m}-16x4", "ratio") for m in SPRING_STIFFNESSES]
        look = {**ELEMENT_LOOK[element], "linestyle": "none"}
        if element == "pw-T6":  # the markers of both elements coincide
            look |= {"markerfacecolor": "none", "markersize": 9}
        left.plot(list(SPRING_STIFFNESSES), ratios, **look)
        curves = results.curves(f"V7/{element}-mu{HIGHEST_FRICTION}-16x4")
        right.plot(curves["x"], curves["force_n"], **ELEMENT_LOOK[element])
    left.set(
        title="(a)",
        xlabel="friction coefficient $\\mu$",
        ylabel="horizontal / vertical force",
        ylim=(0, None),
    )
    right.set(title="(b)", xlabel="$x$ / m", ylabel="nodal normal force / N", ylim=(0, None))
    left.legend(loc="lower right")
    right.legend(loc="lower center")
    return fig


def caption_wedge_force_ratio_and_nodal_forces(results: Results) -> str:
    """Return the caption of the wedge figure, including the sliding distances."""
    distances = ", ".join(
        f"{results.scalar(f'V7/pw-T6-mu{m}-16x4', 'sliding'):.4f} m" for m in SPRING_STIFFNESSES
    )
    return (
        "Wedge pushed up an incline of 1:10 against springs (NAFEMS CGS-4). (a) Ratio of the "
        "total contact forces. (b) Nodal forces normal to the incline at the largest "
        f"friction. Sliding distances for the three friction coefficients: {distances}."
    )


PLOT_ELEMENTS = ("galerkin-T6", "pw-T6")
FIGURES = [
    PageFigure(
        "v7_wedge",
        draw_wedge_force_ratio_and_nodal_forces,
        needs=[
            f"V7/{element}-mu{mu}-16x4" for element in PLOT_ELEMENTS for mu in SPRING_STIFFNESSES
        ],
        caption=caption_wedge_force_ratio_and_nodal_forces,
        alt="Three measured force ratios on the curve of statics. Nodal forces along the "
        "base: the standard element's alternate by a factor of two, the new element's are even.",
    )
]

VERIFICATION = r"""
| wedge on an incline | statics | force ratio | {{ num(measure("relative_difference", section="V7", cases="pw-T6-mu.*", name="ratio", other="ratio_known"), 1) }} | {{ num(measure("relative_difference", section="V7", cases="galerkin-T6-mu.*", name="ratio", other="ratio_known"), 1) }} |
"""

# Findings

CHECKS = [
    check(
        "V7-ratio",
        "Wedge on an incline: horizontal over vertical contact force is (tan a + mu)/(1 - "
        "mu tan a) while it slides, for all elements, meshes and friction coefficients.",
        lambda results: relative_difference(
            results, section="V7", cases={"problem": "sliding"}, name="ratio", other="ratio_known"
        ),
        "=",
        0.0,
        tolerance=1e-09,
        tolerance_why="round-off: the springs are 1e4 times as soft as the wedge",
        why="All nodes slip, and |r_t| = mu r_n at each of them; the rest is statics.",
    ),
    check(
        "V7-slides",
        "Wedge without springs: the smallest push for which the solver reports a free body,"
        " over the known limit.",
        lambda results: scalar_ratio(
            results, key="V7/pw-T6-limit", name="slides", other="ratio_known"
        ),
        "=",
        1.0,
        tolerance=2e-06,
        tolerance_why="the interval is halved twenty times",
        why="Above it nothing holds the wedge, and no unbalanced state is returned.",
    ),
]

FINDINGS = r"""
1. Force ratio and sliding distance are exact on every mesh (8 × 2 to 32 × 8), whatever the element: relative differences
   up to
   {{ num(measure("relative_difference", section="V7", cases=".*mu.*", name="ratio", other="ratio_known"), 1) }} and
   {{ num(measure("relative_difference", section="V7", cases=".*mu.*", name="sliding", other="sliding_known"), 1) }}, which
   is the round-off for a wedge $10^4$ times as stiff as its springs. There is no order of convergence to observe.
2. The distance of 1 m is met to
   {{ num(1000 * measure("largest_deviation_from", section="V7", cases=".*mu.*", name="sliding", value=1.0), 1) }} mm, which is the
   effect of rounding in the printed stiffnesses.
3. Without springs ($\mu = 0.2$, new triangle) equilibria are found up to {{ num(s("V7/pw-T6-limit", "holds"), 7) }} $G$
   and none from {{ num(s("V7/pw-T6-limit", "slides"), 7) }} $G$ on; statics gives
   {{ num(s("V7/pw-T6-limit", "ratio_known"), 7) }} $G$. For the standard triangle the interval is
   {{ num(s("V7/galerkin-T6-limit", "holds"), 7) }} to {{ num(s("V7/galerkin-T6-limit", "slides"), 7) }} $G$.
4. Again, only the distribution of the nodal forces distinguishes the elements.
"""

# Limits

LIMITS = r"""
The benchmark is about large sliding between two bodies; here the lower one is a rigid plane, on which sliding of any
length is exact in a small-displacement theory. The distribution of the pressure has no known answer.
"""

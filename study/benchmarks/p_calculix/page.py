"""Compare nodal results of CalculiX with those of the library on the same problems and meshes."""

from dataclasses import asdict, dataclass

from mpi4py import MPI
from petsc4py import PETSc

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh
from matplotlib.figure import Figure

from pw_elements import Material, Spaces, force_transfer, forces_along, prescribe
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from study.benchmarks.p_calculix.standard_elements import (
    against_standard,
    parameters_implied_by_specimen,
)
from study.judge.checks import check
from study.judge.measures.peers import largest_peer_difference, peer_standard_difference
from study.model.discretisation import Discretisation, discretise
from study.model.units import assign_unit_one_to_scalars, assign_units_to_scalars
from study.paper import s7_1_two_triangles, s7_6_buckling
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case
from study.run.pages import PageFigure
from study.run.store import Result, Results
from study.solutions.calculix.calculix import (
    digest_recorded_result,
    load_recorded_result_if_unchanged,
)
from study.solutions.calculix.decks import (
    BlockWithPrintedContactPressure,
    BucklingHalfBeam,
    PressedAndPulledBlock,
    PressedSquareOfTwoTriangles,
    RectangleOfTrianglePairs,
)
from study.solutions.calculix.problems import PROBLEMS
from study.solutions.calculix.standard_decks import SPECIMENS

Array = npt.NDArray[np.float64]

SECTION = "P"
TITLE = "An independent code: CalculiX"
FACTS = {
    "geometry": "the blocks and beams of section 7; a ring, a cylinder, columns and boxes",
    "mesh": "the same in both codes: CPS6, CPE6, CPE8, CAX6, CAX8 and C3D10 elements",
    "material": "as in section 7; linear elastic, plane strain in place of plane stress where "
    "CalculiX has wedges",
    "supports": "as in section 7; friction 0.3 or none everywhere below the block",
    "load": "the same, a thousand times smaller where CalculiX follows displacements",
    "reference": "CalculiX (G. Dhondt): stored answers with version and checksum of each deck",
    "uncertainty": "CalculiX' penalty and elastic sticking, as stiff as its iterations allow",
}
SHORT_FACTS = {
    "reference": "CalculiX (G. Dhondt), stored with versions and checksums",
    "uncertainty": "its penalties, as stiff as it allows",
}
MACROS = r"""
{% macro p(name, component, cases) %}{{ num(measure("largest_peer_difference", name=name, component=component, cases=cases), 2) }}{% endmacro %}
{% macro d(case, rule, name, digits=2) %}{{ num(s("P/" ~ case, rule ~ "_" ~ name), digits) }}{% endmacro %}
{% macro up(name, component, cases) %}{{ most(measure("largest_peer_difference", name=name, component=component, cases=cases)) }}{% endmacro %}
{% set friction = ["block-friction-0.15", "block-friction-0.30"] %}
"""

# Problem

PROBLEM = r"""
Everything above was computed with one library. CalculiX {{ cite("calculix") }} is independent of it throughout: elements,
contact and solver. It has no piecewise-linear weights, but its 6-node triangle is the standard one. On the same mesh its
forces therefore have to be those of the standard element, and $\boldsymbol{T}$ times its forces those of the new one.
Contact in CalculiX was modelled node by node, each node facing a fixed brick of its own, with penalties as stiff as its
iterations allow. Plane stress was obtained from plane strain with the modulus $E (1 + 2 \nu)/(1 + \nu)^2$ and Poisson's
ratio $\nu/(1 + \nu)$; loads were kept small enough for linear behaviour.
"""

# Method

METHOD = r"""
The same structured meshes are written as decks for CalculiX, whose answers are stored with its version and the deck's
checksum; where the program is installed, the tests run it again. Three measures make a node-by-node comparison possible:

- **Contact at nodes.** Each contact node faces its own fixed brick (node-to-surface contact), and the force on the brick
  is the nodal force. Normal contact is enforced by a penalty and sticking is elastic; both are made as stiff as the
  iterations allow. Pressure and pull are applied in a single step of CalculiX, because a new step relaxes the penetration
  of the last one.
- **Plane stress.** CalculiX expands plane elements into wedges, and in plane stress their thickness strain is an
  independent field. Plane strain with $E (1 + 2 \nu)/(1 + \nu)^2$ and $\nu/(1 + \nu)$ is exactly equivalent to plane
  stress and is used for the block.
- **Small loads.** CalculiX takes finite displacements into account; the loads on the block are therefore divided by a
  thousand, and the resulting forces multiplied by a thousand.

The block of section 7.2 has friction everywhere or nowhere here, so that no node is shared by a smooth and a rough
element. Without friction it is pressed uniformly, on the middle half, or on a short part left of the middle, where its
right end lifts off.
"""

GALERKIN, PW = "galerkin-T6", "pw-T6"
NODES_AT_EDGE = 4
"""Distance, in nodes, from an end or change of status within which a node is near an edge."""


@dataclass(frozen=True)
class ContactForcesOnLowerSide:
    """Nodal contact forces along the lower side of a block, computed with one kind of element.

    Args:
        x: Positions (m,) of the nodes.
        force: Tangential and normal forces (m, 2) of the foundation on the block.
        force_multiplied_by_T: Forces (m, 2) multiplied by the force transfer matrix T.
        status: Contact status (m,) of the nodes.
    """

    x: Array
    force: Array
    force_multiplied_by_T: Array
    status: npt.NDArray[np.int8]


def reactions(case: str, tracked: str) -> Result:
    """Compare CalculiX' reactions of the two triangles of section 7.1 with the library's.

    Differences are relative to the new element's mean reaction: `raw_normal` compares CalculiX with
    the standard element, `transferred_normal` compares T times CalculiX' reactions with the new
    element.

    Args:
        case: Name of the problem in `PROBLEMS`.
        tracked: Digest of the recorded CalculiX result, which must not have changed.
    """
    problem, peer = PROBLEMS[case], load_recorded_result_if_unchanged(case, tracked)
    assert isinstance(problem, PressedSquareOfTwoTriangles)
    standard, new = (s7_1_two_triangles.structure(element).curves for element in (GALERKIN, PW))
    peer_force = np.column_stack([np.zeros(3), peer.numbers["reaction"]])
    space = Spaces.galerkin(_create_mesh_of_triangle_pairs(problem.mesh)).trial
    transferred = _multiply_lower_side_forces_by_T(space, peer.numbers["x"], peer_force)[:, 1]
    scalars = {
        "raw_normal": _max_abs(peer_force[:, 1] - standard["reaction"]),
        "transferred_normal": _max_abs(transferred - new["reaction"]),
    }
    scalars = {name: value / float(new["reaction"].mean()) for name, value in scalars.items()}
    curves = {
        "x": peer.numbers["x"],
        "peer_normal": peer_force[:, 1],
        "peer_T_normal": transferred,
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=new["nodes"].size)


def contact(case: str, tracked: str) -> Result:
    """Compare CalculiX' nodal contact forces below the block of section 7.2 with the library's.

    All differences are relative to the mean normal nodal force. `raw` compares CalculiX with the
    standard element; `transferred` compares T times CalculiX' forces with the new element, and
    `elsewhere` does so away from the edges of contact zones; `control` compares T times the forces
    of the library's standard element with the new one. Curves are in the units of section 7.2.

    Args:
        case: Name of the problem in `PROBLEMS`.
        tracked: Digest of the recorded CalculiX result, which must not have changed.
    """
    problem = PROBLEMS[case]
    assert isinstance(problem, PressedAndPulledBlock)
    peer = load_recorded_result_if_unchanged(case, tracked)
    bodies = [_discretise_block(problem, element) for element in (GALERKIN, PW)]
    standard, new = (_solve_contact_of_block(problem, body) for body in bodies)
    zeros = np.zeros(len(standard.x))
    peer_force = np.column_stack(
        [peer.numbers.get("force_tangential", zeros), peer.numbers["force_normal"]]
    )
    transferred = _multiply_lower_side_forces_by_T(bodies[0].space, standard.x, peer_force)

    mean = float(standard.force[:, 1].mean())
    is_elsewhere = _is_away_from_ends_and_status_changes(standard.status, new.status)
    scalars = {
        "mean_force": mean,
        "open_nodes": float(np.sum(peer_force[:, 1] < 1e-6 * mean)),
        "nodes_elsewhere": float(is_elsewhere.sum()),
    }
    curves: dict[str, np.ndarray] = {"x": standard.x}
    curves |= {f"status_{GALERKIN}": standard.status, f"status_{PW}": new.status}
    for axis, name in _axes_and_names_of_compared_forces(problem):
        raw = peer_force[:, axis] - standard.force[:, axis]
        difference = transferred[:, axis] - new.force[:, axis]
        control = standard.force_multiplied_by_T[:, axis] - new.force[:, axis]
        scalars |= {
            f"raw_{name}": _max_abs(raw) / mean,
            f"transferred_{name}": _max_abs(difference) / mean,
            f"elsewhere_{name}": _max_abs(difference[is_elsewhere]) / mean,
            f"control_{name}": _max_abs(control) / mean,
            f"beyond_control_{name}": _max_abs(difference - control) / mean,
        }
        curves |= {
            f"peer_{name}": peer_force[:, axis],
            f"peer_T_{name}": transferred[:, axis],
            f"{GALERKIN}_{name}": standard.force[:, axis],
            f"{PW}_{name}": new.force[:, axis],
        }
    units = assign_units_to_scalars(scalars, {"mean_force": "force", "*": "1"})
    return Result(scalars, units, curves, dofs=bodies[0].K.getSize()[0])


def native_pressure(case: str, tracked: str) -> Result:
    """Evaluate the contact pressure that CalculiX prints below a uniformly pressed block.

    Pressures are relative to the applied one. `corner` and `midside` are medians over corner and
    mid-side nodes away from the ends.

    Args:
        case: Name of the problem in `PROBLEMS`.
        tracked: Digest of the recorded CalculiX result, which must not have changed.
    """
    problem, peer = PROBLEMS[case], load_recorded_result_if_unchanged(case, tracked)
    assert isinstance(problem, BlockWithPrintedContactPressure)
    pressure = peer.numbers["pressure"] / problem.pressure
    corner, midside = float(np.median(pressure[2:-2:2])), float(np.median(pressure[1::2]))
    scalars = {"corner": corner, "midside": midside, "ratio": midside / corner}
    curves = {"x": peer.numbers["x"], "pressure": pressure}
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves)


def critical_stress(case: str, tracked: str) -> Result:
    """Compare CalculiX' critical stress (Pa) of the half beam of section 7.6 with the library's.

    Args:
        case: Name of the problem in `PROBLEMS`.
        tracked: Digest of the recorded CalculiX result, which must not have changed.
    """
    problem, peer = PROBLEMS[case], load_recorded_result_if_unchanged(case, tracked)
    assert isinstance(problem, BucklingHalfBeam)
    (peer_stress,) = peer.numbers["critical_stress"]
    scalars = {"peer": float(peer_stress)}
    dofs = 0
    for element in (GALERKIN, PW):
        result = s7_6_buckling.beam(
            element, "G", "uniform", problem.divisions, "right", "face", "face"
        )
        stress = result.scalars[f"sigma_cr_{problem.mode}"]
        scalars |= {element: stress, f"difference_{element}": abs(peer_stress / stress - 1)}
        dofs = result.dofs
    return Result(
        scalars, assign_units_to_scalars(scalars, {"difference_*": "1", "*": "Pa"}), dofs=dofs
    )


def _discretise_block(problem: PressedAndPulledBlock, element: str) -> Discretisation:
    mesh = problem.mesh
    material = Material(problem.modulus, problem.ratio)
    return discretise(
        element, lambda _: _create_mesh_of_triangle_pairs(mesh), material, StressState.PLANE_STRESS
    )


def _solve_contact_of_block(
    problem: PressedAndPulledBlock, body: Discretisation
) -> ContactForcesOnLowerSide:
    """Solve the contact of the block with the library; return the forces after the last load."""
    (_, y0), (x1, y1) = problem.mesh.lower, problem.mesh.upper

    def is_on_lower_side(x: Array) -> npt.NDArray[np.bool_]:
        return np.isclose(x[1], y0)

    def is_on_pressed_part_of_upper_side(x: Array) -> npt.NDArray[np.bool_]:
        start, end = problem.pressed
        is_inside = (x[0] > start - 1e-9) & (x[0] < end + 1e-9)
        return np.isclose(x[1], y1) & is_inside

    loads = [body.surface_load((0.0, -problem.pressure), is_on_pressed_part_of_upper_side)]
    supports = []
    if problem.pull:
        traction = (problem.pull * problem.pressure, 0.0)
        pull = body.surface_load(traction, lambda x: np.isclose(x[0], x1))
        steps = problem.increments
        loads += [loads[0] + pull * (k / steps) for k in range(1, steps + 1)]
    if not problem.friction:
        middle = problem.mesh.nodes[problem.mesh.node_number(problem.mesh.divisions[0], 0) - 1][0]
        supports = [
            prescribe(body.space, 0, lambda x: is_on_lower_side(x) & np.isclose(x[0], middle))
        ]
    foundation = ContactPair(is_on_lower_side, Plane((0.0, y0), (0.0, 1.0)), problem.friction)
    states = solve_contact(body.K, loads, body.supports(supports), [foundation], body.space)
    (pair,) = states[-1].pairs
    force = np.column_stack([pair.force_tangential[:, 0], pair.force_normal])
    x = pair.position[:, 0]
    return ContactForcesOnLowerSide(
        x, force, _multiply_lower_side_forces_by_T(body.space, x, force), pair.status
    )


def _multiply_lower_side_forces_by_T(space: fem.FunctionSpace, x: Array, force: Array) -> Array:
    """Multiply nodal forces on the lower side by the force transfer matrix T.

    Args:
        space: Displacement space.
        x: Positions (m,) of the nodes on the lower side.
        force: Forces (m, 2) on these nodes; forces on all other nodes are zero.

    Returns:
        Transferred forces (m, 2) on the lower side.
    """
    nodes = space.tabulate_dof_coordinates()
    y = nodes[:, 1].min()
    T = force_transfer(space)
    residual: PETSc.Vec = T.createVecRight()
    values = np.zeros((len(nodes), 2))
    for position, components in zip(x, force, strict=True):
        (node,) = np.flatnonzero(np.isclose(nodes[:, 0], position) & np.isclose(nodes[:, 1], y))
        values[node] = components
    residual.setArray(values.ravel())
    return forces_along(space, T * residual, lambda p: np.isclose(p[1], y)).force


def _is_away_from_ends_and_status_changes(
    *statuses_by_element: npt.NDArray[np.int8],
) -> npt.NDArray[np.bool_]:
    """Return a mask (m,) of the nodes away from the ends and from changes of contact status.

    Args:
        statuses_by_element: One or several statuses (m,) of the same nodes, one for each element.
    """
    index = np.arange(len(statuses_by_element[0]))
    changes = [np.flatnonzero(np.diff(s)) + 0.5 for s in statuses_by_element]
    edges = np.concatenate([[0.0, index[-1]], *changes])
    return np.abs(index[:, None] - edges).min(axis=1) >= NODES_AT_EDGE


def _axes_and_names_of_compared_forces(problem: PressedAndPulledBlock) -> list[tuple[int, str]]:
    """Return the axis and name of each force component that is compared for a block."""
    return [(1, "normal"), (0, "tangential")] if problem.friction else [(1, "normal")]


def _create_mesh_of_triangle_pairs(mesh: RectangleOfTrianglePairs) -> Mesh:
    return triangles(MPI.COMM_SELF, mesh.lower, mesh.upper, mesh.divisions)


def _max_abs(values: Array) -> float:
    return float(np.abs(values).max())


# Cases

PROBLEM_FUNCTIONS = {
    PressedSquareOfTwoTriangles: reactions,
    PressedAndPulledBlock: contact,
    BlockWithPrintedContactPressure: native_pressure,
    BucklingHalfBeam: critical_stress,
}


def _parameters_implied_by_calculix_problem(
    problem: PressedSquareOfTwoTriangles | PressedAndPulledBlock | BucklingHalfBeam,
) -> dict[str, object]:
    """Return the parameters to store with the results of a CalculiX problem.

    They include the elements of the library with which CalculiX, which has only the standard
    element, is compared.
    """
    fields = asdict(problem)
    return {
        "compared": [GALERKIN]
        if isinstance(problem, BlockWithPrintedContactPressure)
        else [GALERKIN, PW],
        "peer_element": fields.pop("element", "CPS6"),
        "divisions": problem.mesh.divisions,
        **fields,
    }


# With the digest among the parameters, a result is outdated when the recorded answer changes
CASES = [
    Case(
        "P",
        name,
        PROBLEM_FUNCTIONS[type(problem)],
        {"case": name, "tracked": digest_recorded_result(name)},
        _parameters_implied_by_calculix_problem(problem),
    )
    for name, problem in PROBLEMS.items()
    if isinstance(
        problem, PressedSquareOfTwoTriangles | PressedAndPulledBlock | BucklingHalfBeam
    )  # others: below, V11, Q
]
CASES += [
    Case(
        "P",
        name,
        against_standard,
        {"case": name, "tracked": digest_recorded_result(name)},
        parameters_implied_by_specimen(specimen),
    )
    for name, specimen in SPECIMENS.items()
]

# Results

RESULT = r"""
{% call table("peers", "Nodal forces on the block of the paper's section 7.2, with friction everywhere or nowhere: largest difference at any node, in % of the mean normal force. “Away from edges”: at least two elements away from the ends of the contact and of its zones.") %}
| Load | Force | CalculiX against standard T6 | T × CalculiX against new T6 | the same, away from edges | T × standard T6 against new T6, both ours |
|---|---|---:|---:|---:|---:|
{% for case, words in [("block-even", "uniform pressure"), ("block-part", "pressure on the middle half"), ("block-lifting", "pressure on a short part, ends lift off"), ("block-friction-0.15", "friction, t/p = 0.15"), ("block-friction-0.30", "friction, t/p = 0.3")] %}
{% for component in (["normal", "tangential"] if "friction" in case else ["normal"]) %}
| {{ words }} | {{ component }} |{% for name in ("raw", "transferred", "elsewhere", "control") %} {{ p(name, component, [case]) }} |{% endfor %}

{% endfor %}
{% endfor %}
{% endcall %}

{{ figure("p_peer_forces") }}

{% call table("quadrature", "Largest relative difference between CalculiX's standard elements and ours, when ours are integrated exactly and with CalculiX's integration points.") %}
| Integration |{% for words in ("CAX6, CPE6", "CAX8, CPE8", "C3D10", "C3D10, curved") %} {{ words }}: exact | CalculiX's |{% endfor %}

|---|---:|---:|---:|---:|---:|---:|---:|---:|
{% for words, problem, name, elements in [
  ("displacements", "statics", "displacement", ("CAX6", "CAX8", "C3D10", "C3D10-curved")),
  ("reactions", "statics", "reaction", ("CAX6", "CAX8", "C3D10", "C3D10-curved")),
  ("eigenvalues ω²", "frequencies", "eigenvalue", ("CAX6", "CAX8", "C3D10", "C3D10-curved")),
  ("buckling pressures", "buckling", "critical_pressure", ("CPE6", "CPE8", none, none)),
  ("contact forces", "contact", "force_normal", ("CAX6", "CAX8", "C3D10", none))] %}
| {{ words }} |{% for element in elements %}{% for rule in ("exact", "reduced") %} {% if element %}{{ d(problem ~ "-" ~ element, rule, name, 1) }}{% else %}–{% endif %} |{% endfor %}{% endfor %}

{% endfor %}
{% endcall %}

With CalculiX's integration points eigenvalues, buckling pressures and reactions agree to the seven digits that it prints.
The differences that remain with exact integration are the error of its three points in a triangle and four in a
tetrahedron. Contact forces agree to within the finite stiffness of its penalties.
"""

DETAILS = r"""
{% call table("p-critical-stresses", "Critical stresses.") %}
| Half beam, uniform load | Mode | CalculiX, MPa | standard T6, form G, MPa | new T6, form G, MPa |
|---|---:|---:|---:|---:|
{% for mesh in ("8x2", "16x4") %}
{% for mode in (1, 2) %}
{% set key = "P/beam-" ~ mesh ~ "-mode" ~ mode %}
| {{ mesh | replace("x", " × ") }} squares | {{ mode }} |{% for name in ("peer", "galerkin-T6", "pw-T6") %} {{ fixed(s(key, name) / 1e6, 3) }} |{% endfor %}

{% endfor %}
{% endfor %}
{% endcall %}
"""

DRAWN_CASE = "P/block-friction-0.30"
COMPONENTS = (("normal", "normal nodal force"), ("tangential", "tangential nodal force"))
DRAWN_PAIRS = (("peer", GALERKIN, "CalculiX"), ("peer_T", PW, "T × CalculiX"))


def draw_nodal_forces_beside_calculix(results: Results) -> Figure:
    """Draw the nodal forces of CalculiX and of the library below the block with friction.

    The upper panels show normal and tangential forces, the lower ones their differences.
    """
    curves, mean = results.curves(DRAWN_CASE), results.scalar(DRAWN_CASE, "mean_force")
    heights = {"height_ratios": (3, 2)}
    fig, axes = plt.subplots(2, 2, figsize=(PAGE_WIDTH, 3.1), sharex=True, gridspec_kw=heights)
    for (above, below), (name, title) in zip(axes.T, COMPONENTS, strict=True):
        for peer, element, label in DRAWN_PAIRS:
            look, peer_force = ELEMENT_LOOK[element], curves[f"{peer}_{name}"] / mean
            force = curves[f"{element}_{name}"] / mean
            line = {"color": look["color"], "label": look["label"]}
            above.plot(curves["x"], force, lw=1.0, **line)
            dots = {"marker": look["marker"], "ls": "none", "mfc": "none", "mew": 0.8}
            above.plot(curves["x"], peer_force, color=look["color"], label=label, **dots)
            difference = 100 * np.abs(peer_force - force)
            difference_look = {"label": f"{label}, {look['label']}", "lw": 0.8, "ms": 2.5}
            below.semilogy(curves["x"], difference, **{**look, **difference_look})
        below.axhline(0.5, color="black", lw=0.8, ls=":", label="0.5 %")
        above.set(title=title)
        below.set(xlabel="$x$", ylim=(1e-5, 10))
    axes[0, 0].set(ylabel="force / mean")
    axes[0, 0].set_ylim(bottom=0)
    axes[1, 0].set(ylabel="difference, %")
    handles = [ax.get_legend_handles_labels() for ax in (axes[0, 0], axes[1, 0])]
    fig.legend(*handles[0], loc="outside upper center", ncols=4)
    fig.legend(*handles[1], loc="outside lower center", ncols=3)
    return fig


def caption_nodal_forces_beside_calculix(results: Results) -> str:
    """Return the caption of `draw_nodal_forces_beside_calculix`, with the largest differences."""
    raw, transferred = (
        max(100 * results.scalar(DRAWN_CASE, f"{kind}_{name}") for name, _ in COMPONENTS)
        for kind in ("raw", "transferred")
    )
    return (
        "Nodal forces on the block (traction over pressure 0.3, friction 0.3 everywhere): lines "
        "are ours, open markers CalculiX's as computed and multiplied by T. The last two panels "
        f"show their differences, at most {raw:.2g} % of the mean nodal force between the standard "
        f"elements and {transferred:.2g} % between T times CalculiX's and the new element's, at "
        "the edges of slip zones; 0.5 % is the bound set for nodes away from them."
    )


def describe_nodal_forces_beside_calculix(results: Results) -> str:
    """Return the alternative text of `draw_nodal_forces_beside_calculix`, with some forces."""
    curves, mean = results.curves(DRAWN_CASE), results.scalar(DRAWN_CASE, "mean_force")
    values = "; ".join(
        f"{ELEMENT_LOOK[element]['label']}: {corner:.2f} at a corner and {midside:.2f} at a mid-side node"
        for _, element, _ in DRAWN_PAIRS
        for corner, midside in [curves[f"{element}_normal"][18:20] / mean]
    )
    return (
        "Four panels over x: normal and tangential nodal forces, and their differences on a "
        f"logarithmic scale. In the middle of the block, {values}. CalculiX's markers lie on the "
        "lines."
    )


FIGURES = [
    PageFigure(
        "p_peer_forces",
        draw_nodal_forces_beside_calculix,
        needs=[DRAWN_CASE],
        caption=caption_nodal_forces_beside_calculix,
        alt=describe_nodal_forces_beside_calculix,
    ),
]

VERIFICATION = r"""
| beam, half model, uniform load | CalculiX, seven digits | critical stresses | {{ num(measure("peer_critical_stress_difference", element="pw-T6"), 1) }} | {{ num(measure("peer_critical_stress_difference", element="galerkin-T6"), 1) }} |
"""

# Findings

CHECKS = [
    check(
        "P-normal",
        "Node by node, CalculiX's normal contact forces are those of our standard element.",
        lambda results: largest_peer_difference(results, name="raw", component="normal"),
        "=",
        0.0,
        tolerance=0.02,
        tolerance_why="penalty in place of an exact gap, and seven printed digits",
        unit="% of the mean nodal force",
        why="The same mesh and the same law at nodes; CalculiX has it by penalty, here it is an"
        " active set.",
    ),
    check(
        "P-transferred",
        "T times CalculiX's normal contact forces is what the new element gives, with "
        "friction everywhere and without.",
        lambda results: largest_peer_difference(
            results,
            name="transferred",
            component="normal",
            cases=["block-even", "block-part", "block-friction-0.15", "block-friction-0.30"],
        ),
        "=",
        0.0,
        tolerance=0.5,
        tolerance_why="half a per cent of the mean nodal force, set before it was measured",
        tolerance_set="before",
        unit="% of the mean nodal force",
        why="Exact without friction and lift-off; with partial slip Coulomb's law is stated on "
        "forces that T has not yet redistributed.",
    ),
    check(
        "P-reduced-contact",
        "Frictionless forces at contact nodes, partly lifted off, are CalculiX's under its "
        "quadrature rule: axisymmetric and solid elements.",
        lambda results: peer_standard_difference(
            results,
            rule="reduced",
            name="force_normal",
            cases=["contact-CAX6", "contact-CAX8", "contact-C3D10"],
        ),
        "=",
        0.0,
        tolerance=2e-05,
        tolerance_why="ten times stricter than in the plane, because the penalty is a hundred times "
        "stiffer: with the plane's the block of tetrahedra was 7.6e-4 off, and the "
        "difference falls with the penalty",
        tolerance_set="after",
        unit="of the mean nodal force",
        why="The same law at nodes; corner nodes of tetrahedra carry next to nothing in both.",
    ),
]

FINDINGS = r"""
**Finding.** The standard element is the same in both programs: forces differ by at most
{{ most(measure("largest_peer_difference", name="raw", component="normal"), 1) }} % (normal) and
{{ most(measure("largest_peer_difference", name="raw", component="tangential", cases=friction), 1) }} % (tangential), critical stresses
by a relative {{ num(measure("peer_critical_stress_difference", element="galerkin-T6"), 1) }}. $\boldsymbol{T}$ turns CalculiX's forces
into those of the new element to {{ p("transferred", "normal", ["block-even", "block-part"]) }} % where there is neither
friction nor lift-off. At the edges of contact zones it cannot, since it mixes the force of a slipping node with that of a
sticking one; $\boldsymbol{T}$ times our own standard element shows the same difference. With its surface-to-face contact,
CalculiX itself returns {{ num(s("P/block-native", "corner"), 2) }} of a uniform pressure at corner nodes and
{{ num(s("P/block-native", "midside"), 2) }} at mid-side nodes, which is the sawtooth from which the paper starts.
"""

FURTHER_FINDINGS = r"""
1. The reactions of the two triangles differ by {{ num(100 * s("P/two-triangles", "raw_normal"), 1) }} %. Elsewhere than at
   the edges of zones the differences are at most {{ most(measure("largest_peer_difference", name="elsewhere", component="normal")) }} %
   and {{ up("elsewhere", "tangential", friction) }} %.
2. **CalculiX's plane-stress triangle** without this substitution, with a thickness of one, changes the contact forces by
   {{ p("raw", "normal", ["block-part-CPS6"]) }} %; a hundred times thinner, by
   {{ p("raw", "normal", ["block-part-CPS6-thin"]) }} %.

#### Other elements of CalculiX, and the cost of reduced quadrature

Axisymmetric (CAX6, CAX8), plane (CPE6, CPE8, CPS6) and solid (C3D10) elements are compared with the standard ones of this
study. CalculiX integrates with three points on a triangle, four in a tetrahedron and nine on a quadrilateral. Ours are
computed twice: with the quadrature that the library chooses, which is exact or nearly so, and with CalculiX's points. The
problems are a ring and a block between two approaching plates; the lowest six eigenvalues of the same bodies, fixed at the
bottom; a column with a fixed foot under pressure, whose prestress is not uniform near the foot; a cylinder and a block on
a rigid plane, pressed around the middle of the upper side so that the rim lifts off, where the block is also pulled with
friction 0.3. "Curved" is the block with bulging sides. Contact is enforced at nodes, as above.

The table gives the largest difference from CalculiX. Differences of displacements and reactions are relative to the
largest value, those of eigenvalues and buckling pressures to each value itself, and those of contact forces (without
friction) to the mean nodal force.

1. **Quadrature explains the differences.** With CalculiX's points, eigenvalues, buckling pressures (plane strain) and
   reactions agree to all seven printed digits. With exact quadrature they differ by up to
   {{ num(measure("peer_standard_difference", rule="exact", name="eigenvalue", cases=["frequencies-CAX6", "frequencies-C3D10", "frequencies-C3D10-curved"]), 2) }}
   (eigenvalues), {{ d("statics-C3D10-curved", "exact", "reaction") }} (reactions of curved tetrahedra) and
   {{ d("contact-CAX6", "exact", "force_normal") }} (contact forces of CAX6): rules with three and four points are exact to
   degree 2, which suffices for the stiffness of straight CPE6 and C3D10 elements, but not for their mass or for any
   axisymmetric or curved element. With nine points on a quadrilateral the difference is
   {{ d("frequencies-CAX8", "exact", "eigenvalue") }}.
2. **Displacements of axisymmetric bodies** agree to {{ d("statics-CAX6", "reduced", "displacement") }} of the largest only.
   Axial displacements agree to all digits, but the radial displacement that CalculiX prints is a mean over components at
   spatial nodes up to one degree away from the plane. These cosines are corrected for here; without the correction, a
   radial displacement would be too small by up to 1 − cos 1°.
3. **Plane-stress triangles** (CPS6) remain a different element. With the thickness equal to the width the column buckles
   at a pressure that is {{ num(100 * s("P/buckling-CPS6", "reduced_critical_pressure"), 2) }} % higher; with a hundredth of
   that thickness the difference is {{ d("buckling-CPS6-thin", "reduced", "critical_pressure") }} and does not become
   smaller for thinner columns, because the thickness strain of these elements is continuous across elements, while that
   of plane stress jumps.
4. **Contact forces** agree as closely as the stiffness of the penalty allows. Without friction it can be a hundred times
   stiffer than in the plane problems, and a difference of {{ d("contact-C3D10", "reduced", "force_normal") }} of the mean
   nodal force remains on tetrahedra. With friction {{ d("contact-C3D10-friction", "reduced", "force_normal") }} of normal
   and {{ d("contact-C3D10-friction", "reduced", "force_tangential") }} of friction forces remain, the latter because of
   elastic sticking: a ten times softer stick stiffness leaves
   {{ d("contact-C3D10-friction-soft", "reduced", "force_tangential") }}.
5. **Surface-to-surface contact**, which CalculiX also offers, enforces the contact law at integration points of faces. The
   displacements of a block that is pressed and pushed with friction 0.3 then differ by up to
   {{ num(100 * s("P/contact-C3D10-surface", "reduced_displacement"), 2) }} % of the largest displacement from those with the
   law at nodes, and with ten times stiffer penalties by
   {{ num(100 * s("P/contact-C3D10-surface-stiff", "reduced_displacement"), 2) }} %; the forces on the plane are the same.
"""

# Limits

LIMITS = r"""
CalculiX has no piecewise-linear weight functions: it confirms the standard elements, the contact law at nodes and,
through $\boldsymbol{T}$, the new element's forces where $\boldsymbol{T}$ is exact. Where the new element is a different
discretisation (axisymmetry, dynamics, 3-D), CalculiX says nothing about it. The paper's block, with frictionless elements
at both ends, is not compared.
"""

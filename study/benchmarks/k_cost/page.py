"""CPU time and memory of the elements and solvers.

Each case reads one row of the record `time_and_memory.json`; nothing is measured when the report is
built.
"""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study.benchmarks.k_cost.measure import (
    compute_time_ratios_of_contact_to_its_parts,
    is_measured_without_peers,
    measurement_from_record_row,
)
from study.judge.checks import check
from study.judge.measures.general import growth_exponent, ratio
from study.model.units import assign_units_to_scalars
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH, label_log_y_axis_with_plain_numbers
from study.run import records
from study.run.cases import Case
from study.run.pages import PageFigure
from study.run.store import Result, Results

SECTION = "K"
TITLE = "Cost"
VERIFICATION = ""  # told in the text of the report
FACTS = {
    "geometry": "a block 2 × 1 or 2 × 1 × 1; a stiffer one on top for two bodies",
    "mesh": "regular triangles and tetrahedra, up to two million unknowns",
    "material": "linear elastic, plane strain and solid; E = 1000, ν = 0.3, and 0.5 with a "
    "pressure field",
    "supports": "clamped base, or contact with μ = 0.3 (0.2 between two bodies) alone",
    "load": "pressure 100 on top, a push of 20 on a side",
    "reference": "the standard element by the same solvers; CalculiX and felupe on the same meshes",
    "uncertainty": "one shared machine: CPU times, medians of three runs (one where it takes "
    "long), from a tracked record",
}
SHORT_FACTS = {
    "reference": "the standard element; CalculiX and felupe",
    "uncertainty": "CPU times of one shared machine, medians of three runs",
}

# Problems and method

PROBLEM = r"""
Costs were measured on a block clamped at its base, and on the same block pressed against a rough plane ($\mu = 0.3$) and
held by contact alone. Times are medians of three runs, or of a single run where it takes long; the machine has
{{ parameters("K/factors-pw-T10-8-Direct")["machine"] }}. The numbers come from a stored record, which
`python3 -m study.publish.renew_records` renews.
"""

METHOD = r"""
Five problems are timed. In the first, a block 2 × 1 (× 1) is clamped at its base; its stiffness is assembled and
factorised by MUMPS (LDLᵀ for the symmetric standard element, LU for the new one), and its six lowest frequencies are
computed. In the second, the block stands on a rough rigid plane ($\mu = 0.3$), pressed from above, pushed at a side and
held by contact alone, for $\nu = 0.3$ and, with a pressure field, for $\nu = 1/2$. In the third, a stiffer block with
finer tetrahedra stands on another block and is held only by contact with it ($\mu = 0.2$, the mortar method of section
V11). In the fourth, the clamped block at $\nu = 1/2$, with an independent pressure field, is pressed and pushed from
above. In the fifth, a rough ball, or a block of rubber, is pressed into rubber and moved along it, at large strains
(friction 0.2 between the blocks, which slide by 0.1).

A script (`python3 -m study.publish.renew_records`) runs each row in separate processes and writes a record that is kept
under version control and read by this section; nothing is measured when the report is built. Seconds are CPU time,
the median of three runs or, for long runs, a single one. CalculiX solves the contact problem of the block on the rigid
plane with one thread and surface-to-surface contact of its C3D10 elements; the record also has two bodies that slide,
for {{ ref("V18") }}.

Two problems are also solved by other programs, on the same meshes, with the same loads, motions and increments: the
block by CalculiX {{ cite("calculix") }}, and neo-Hookean rubber in plane strain that a rough rigid cylinder
($\mu = 0.3$) presses down by half of its radius and irons by 0.6 of it by felupe {{ cite("felupe") }}. All rows of a problem
are run in turn, three times; the run with the least CPU time counts. Both programs have penalties. Their values were
chosen by one criterion, stated in advance: the least CPU time among those tried for which penalties ten times stiffer
change the largest displacement of the block, or the forces of the cylinder, by at most 1 %. Not computed alike are:

- **CalculiX.** Loads are a thousandth, since displacements are taken into account; forces and displacements are multiplied
  by a thousand. A penalty of {{ num(1e6, 1) }} holds the nodes or the points within faces, and sticking is elastic
  ({{ num(1e5, 1) }}). Its solver is SPOOLES (LU); its Krylov solver takes symmetric matrices only. Nodal forces are not
  printed: they are the stiffness of the same element times the printed displacements. Its mortar contact did not end
  within 100 s on a mesh with 4 cells along the height, where the other two kinds took 1 to 3 s.
- **felupe.** Contact is at nodes, as here; a penalty of 200 times the length of an element, and elastic slip of 0.01
  radii, take the place of exact conditions, and the linear systems are solved by PARDISO (MKL). It integrates over a
  triangle with three points, the library with six. Tolerances are each program's own defaults.

Two columns relate the time of contact to the time that its parts take on their own, with plain linear solutions of the
clamped block. “Over parts” divides it by the time of the assembly, one set-up of the multigrid levels, and one plain
solution for each Newton step, with the same reduction of the residual as that step required. “Over solutions” divides it
by the time of the assembly and of one plain solution per step with the residual reduced to {{ num(0.02, 1) }} of the
right-hand side, which is what most steps required when these rows were measured; the set-up of levels and the exact last
step are not included. Seconds of contact are those of the whole run, including imports and assembly; memory is likewise
the largest resident size of all processes together. Machine: {{ parameters("K/factors-pw-T10-8-Direct")["machine"] }}.
"""

# Cases

UNITS = {"*seconds": "s", "megabytes": "MB", "*": "1"}


def recorded(
    task: str,
    element: str,
    cells: int,
    method: str,
    processes: int,
    machine: str,
    measured: dict[str, float],
) -> Result:
    """Return one row of the record as a result: CPU seconds, memory and counts.

    Scalars `seconds` are CPU times of the task and `whole_seconds` of the whole process; both are
    medians of several runs.

    Args:
        task: Name of the task.
        element: Name of the element.
        cells: Number of cells along the height of the block.
        method: Method for the linear systems.
        processes: Number of MPI processes.
        machine: Description of the machine by `describe_machine_and_load`.
        measured: Measured quantities by name.
    """
    del task, element, cells, method
    scalars = {**measured, "processes": float(processes)}
    return Result(scalars, assign_units_to_scalars(scalars, UNITS), {}, dofs=int(measured["dofs"]))


def recorded_of_peer(
    task: str,
    peer_element: str,
    cells: int,
    method: str,
    processes: int,
    machine: str,
    measured: dict[str, float],
) -> Result:
    """Return one row of the record that was measured with another program.

    Args:
        task: Name of the task.
        peer_element: Name of the element in that program.
        cells: Number of cells along the height of the block, or along the cylinder's radius.
        method: Name of the program, and of its kind of contact.
        processes: Number of processes.
        machine: Description of the machine by `describe_machine_and_load`.
        measured: Measured quantities by name.
    """
    return recorded(task, peer_element, cells, method, processes, machine, measured)


def load_cases_from_record(path: Path = records.TIME_AND_MEMORY) -> list[Case]:
    """Return a case for each row of a record.

    Args:
        path: The tracked record, or a newly measured copy of it.
    """
    rows = {measurement_from_record_row(row): row for row in records.read_rows(path).values()}
    measured_numbers = {key: row.content["measured"] for key, row in rows.items()}
    cases = []
    for measurement, measured in measured_numbers.items():
        problem: Callable[..., Result] = recorded
        parameters = {**asdict(measurement), "machine": rows[measurement].machine}
        if measurement.peer:
            problem, parameters["peer_element"] = recorded_of_peer, parameters.pop("element")
        parameters["measured"] = measured | compute_time_ratios_of_contact_to_its_parts(
            measurement, measured_numbers
        )
        is_tracked = path == records.TIME_AND_MEMORY or not is_measured_without_peers(measurement)
        record = records.path_relative_to_project(records.TIME_AND_MEMORY) if is_tracked else ""
        cases.append(Case("K", measurement.name, problem, parameters, record=record))
    return cases


CASES = load_cases_from_record()

# Results

MACROS = r"""
{% macro over(mesh, task, name) %}{{ fixed(measure("ratio", key="K/" ~ task ~ "-pw-" ~ mesh, other="K/" ~ task ~ "-galerkin-" ~ mesh, name=name), 1) }}{% endmacro %}
{% macro power(series, small, large) %}{{ fixed(measure("growth_exponent", key="K/" ~ series ~ "-" ~ small ~ "-Iterative", other="K/" ~ series ~ "-" ~ large ~ "-Iterative", name="seconds", over="dofs"), 2) }}{% endmacro %}
{% set with_bare = ("contact-pw-T10-8-Iterative", "contact-pw-T10-11-Iterative", "contact-pw-T10-16-Iterative", "contact-pw-T10-27-Iterative", "contact-pw-T10-35-Iterative-2") %}
{% set contacts = [
  ("contact-pw-T10-11-Direct", "direct (LU)"),
  ("contact-pw-T10-11-Iterative", "Krylov with multigrid"),
  ("contact-galerkin-T10-11-Iterative", "the same, standard T10"),
  ("contact-C3D10-11-CalculiX", "CalculiX, C3D10, direct"),
  ("contact-pw-T10-16-Iterative", "Krylov with multigrid"),
  ("contact-pw-T10-27-Iterative", "Krylov with multigrid"),
  ("contact-pw-T10-35-Iterative-2", "Krylov with multigrid"),
] %}
{% set further_contacts = [
  ("contact-C3D10-8-CalculiX", "CalculiX, C3D10"),
  ("contact-pw-T10-8-Direct", "direct"),
  ("contact-pw-T10-8-Iterative", "Krylov"),
  ("contact-pw-T10-16-Iterative-2", "Krylov"),
  ("contact-pw-hybrid-T10-11-Direct", "with a pressure, direct"),
  ("contact-pw-hybrid-T10-11-Iterative", "with a pressure, Krylov"),
  ("contact-pw-hybrid-T10-22-Iterative", "with a pressure, Krylov"),
  ("bodies-pw-T10-10-Direct", "two bodies, direct"),
  ("bodies-pw-T10-10-Iterative", "two bodies, Krylov"),
  ("bodies-pw-T10-20-Iterative", "two bodies, Krylov"),
  ("bodies-pw-T10-20-Iterative-2", "two bodies, Krylov"),
  ("bodies-pw-T10-20-Iterative-3", "two bodies, Krylov"),
  ("sliding-bodies-pw-T10-6-Direct", "sliding bodies, direct"),
  ("sliding-bodies-pw-T10-6-Iterative", "sliding bodies, Krylov"),
  ("sliding-bodies-pw-T10-10-Direct", "sliding bodies, direct"),
  ("sliding-bodies-pw-T10-10-Iterative", "sliding bodies, Krylov"),
  ("sliding-bodies-pw-T10-17-Iterative", "sliding bodies, Krylov"),
] %}
{% macro over_peer(peer, ours, problem, name, digits=1) %}{{ fixed(measure("ratio", key="K/peer-" ~ problem ~ "-" ~ peer, other="K/peer-" ~ problem ~ "-" ~ ours, name=name), digits) }}{% endmacro %}
{% set compared_programs = [
  ("new T10, direct", "block-pw-T10-5-Direct"),
  ("new T10, Krylov", "block-pw-T10-5-Iterative"),
  ("standard T10, Krylov", "block-galerkin-T10-5-Iterative"),
  ("CalculiX, C3D10, nodes on face", "block-C3D10-5-CalculiX-nodes"),
  ("CalculiX, C3D10, surface to surface", "block-C3D10-5-CalculiX"),
  ("new T6, direct", "rubber-pw-T6-16-Direct"),
  ("standard T6, direct", "rubber-galerkin-T6-16-Direct"),
  ("felupe, T6, PARDISO", "rubber-triangle6-16-felupe"),
] %}
{% set ball = "K/sliding-pw-T10-10-Iterative" %}
{% set small_ball = "K/sliding-pw-T10-5-Iterative" %}
{% set large_ball = "K/sliding-pw-T10-17-Iterative" %}
{% macro steps(cells) %}{% set case = "K/sliding-bodies-pw-T10-" ~ cells ~ "-Iterative" %}{{ fixed(s(case, "krylov_iterations") / s(case, "iterations"), 0) }}{% endmacro %}
"""

RESULT = r"""
{% call table("costs", "Cost of the stiffness matrix K: assembly, and factorisation by MUMPS (LDLᵀ for the symmetric standard element, LU for the new one). CPU times.") %}
| Element | Unknowns | Assembly, s | Entries of $\boldsymbol{K}$ | Factorisation, s | Entries of the factors | Memory, MB |
|---|---:|---:|---:|---:|---:|---:|
{% for element, cells in (("galerkin-T6", 256), ("pw-T6", 256), ("galerkin-T10", 11), ("pw-T10", 11)) %}{% set end = element ~ "-" ~ cells ~ "-Direct" %}
| {{ names[element] }} | {{ count(s("K/assembly-" ~ end, "dofs")) }} | {{ num(s("K/assembly-" ~ end, "seconds"), 2) }} | {{ num(s("K/assembly-" ~ end, "entries"), 2) }} | {{ num(s("K/factors-" ~ end, "seconds"), 2) }} | {{ num(s("K/factors-" ~ end, "entries"), 2) }} | {{ fixed(s("K/factors-" ~ end, "megabytes"), 0) }} |
{% endfor %}
{% endcall %}

**The unsymmetric matrix is the price.** Assembly takes {{ over("T6-256-Direct", "assembly", "seconds") }} times as long
as the standard element's on triangles and {{ over("T10-11-Direct", "assembly", "seconds") }} times on tetrahedra, where
straight cells take four points. The factors have {{ over("T6-256-Direct", "factors", "entries") }} and
{{ over("T10-11-Direct", "factors", "entries") }} times as many entries and take
{{ over("T6-256-Direct", "factors", "seconds") }} and {{ over("T10-11-Direct", "factors", "seconds") }} times as long. With
friction the standard element's matrix is unsymmetric too, and its factors have as many entries (ratio
{{ fixed(measure("factor_entries_ratio", key="I/factors-pw-T6", other="I/factors-galerkin-T6"), 2) }}): there the paper is
right that “in practice this drawback may not matter at all”.

{% call table("contacts", "Cost of contact with friction in three dimensions, new T10 unless stated otherwise: the whole run, including imports and assembly.") %}
| Solver | Unknowns | Processes | CPU time, s | Wall time, s | Memory, MB | Newton steps | Krylov steps |{% if sheet %} Over parts | Over solutions |{% endif %}

|---|---:|---:|---:|---:|---:|---:|---:|{% if sheet %}---:|---:|{% endif %}

{% for name, words in contacts + (further_contacts if sheet else []) %}{% set key = "K/" ~ name %}
| {{ words }} | {{ count(s(key, "dofs")) }} | {{ fixed(s(key, "processes"), 0) }} | {{ num(s(key, "whole_seconds"), 2) }} | {{ "–" if "sliding" in name else num(s(key, "wall_seconds"), 2) }} | {{ fixed(s(key, "megabytes"), 0) }} | {{ fixed(s(key, "iterations"), 0) }} | {{ fixed(s(key, "krylov_iterations"), 0) if "CalculiX" not in name else "–" }} |{% if sheet %}{% for ratio in ("over_bare", "over_solutions") %} {{ fixed(s(key, ratio), 2) if name in with_bare else "–" }} |{% endfor %}{% endif %}

{% endfor %}
{% endcall %}

{{ figure("k_cost") }}
"""

DETAILS = r"""
{{ figure("k_growth") }}

{% call table("k-other-programs", "Contact with friction by other programs on the same mesh: a block of tetrahedra (upper five rows) and rubber ironed by a cylinder in the plane. CPU time is that of the fastest of three runs of the whole program; forces are the sums over the contact; corner over mid-side is the ratio of nodal normal forces, 1 if they are even.") %}
| Program and element | Unknowns | Increments | Newton steps | Factorisations | CPU time, s | Memory, MB | Normal force | Tangential force | Corner / mid-side | Largest displacement |
|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|
{% for words, name in compared_programs %}{% set key = "K/peer-" ~ name %}
| {{ words }} | {{ count(s(key, "dofs")) }} | {{ fixed(s(key, "increments"), 0) }} | {{ fixed(s(key, "iterations"), 0) }} | {{ "–" if "CalculiX" in name else fixed(s(key, "factorisations"), 0) }} | {{ num(s(key, "whole_seconds"), 3) }} | {{ fixed(s(key, "megabytes"), 0) }} | {{ num(s(key, "normal"), 5) }} | {{ num(s(key, "tangential"), 5) }} | {{ fixed(s(key, "corner_over_mid"), 2) }} | {{ num(s(key, "largest_displacement"), 4) if "block" in name else "–" }} |
{% endfor %}
{% endcall %}

{% call table("k-cost-of-incompressible-bodies-in-space", "Cost of incompressible bodies in space.") %}
| With a pressure, $\nu = 1/2$ | solved by | Unknowns | Processes | CPU time, s | Memory, MB | Krylov iterations |
|---|---|---:|---:|---:|---:|---:|
{% for element, cells, method in (("galerkin-hybrid-T10", 8, "Direct"), ("galerkin-hybrid-T10", 8, "Iterative"), ("galerkin-hybrid-T10", 22, "Iterative"), ("pw-hybrid-T10", 8, "Direct"), ("pw-hybrid-T10", 8, "Iterative"), ("pw-hybrid-T10", 16, "Iterative"), ("pw-hybrid-T10", 22, "Iterative"), ("pw-hybrid-T10", 22, "Iterative-2")) %}{% set key = "K/incompressible-" ~ element ~ "-" ~ cells ~ "-" ~ method %}
| {{ names[element] }} | {{ "factors" if method == "Direct" else "Krylov" }} | {{ fixed(s(key, "dofs"), 0) }} | {{ fixed(s(key, "processes"), 0) }} | {{ num(s(key, "whole_seconds"), 3) }} | {{ fixed(s(key, "megabytes"), 0) }} | {{ fixed(s(key, "krylov_iterations"), 0) }} |
{% endfor %}
{% endcall %}
"""

# Figure: cost over the unknowns

COST_PANELS = {
    "factors": "(a) factorisation",
    "frequencies": "(b) six frequencies",
    "contact": "(c) contact with friction",
}
COST_ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-T10", "pw-T10")
CALCULIX_ELEMENTS = {"galerkin-T10": "C3D10"}
"""Names of the corresponding CalculiX elements."""
LINE_STYLES = {"Direct": "-", "Iterative": "--", "CalculiX": "-."}


def draw_time_and_memory_over_unknowns(results: Results) -> Figure:
    """Draw CPU time (upper row) and memory (lower row) over the number of unknowns.

    The columns are factorisation, six frequencies, and contact with friction.
    """
    fig, axes = plt.subplots(2, 3, figsize=(PAGE_WIDTH, 3.6), sharex="col")
    for column, (task, title) in zip(axes.T, COST_PANELS.items(), strict=True):
        for element in COST_ELEMENTS:
            for method in LINE_STYLES:
                _draw_time_and_memory_of_one_task(column, results, task, element, method)
        column[0].set_title(title)
        column[1].set_xlabel("unknowns")
    axes[0, 0].set_ylabel("CPU time / s")
    axes[1, 0].set_ylabel("memory / MB")
    for ax in axes.flat:
        ax.set(xscale="log", yscale="log")
    for ax in axes[1]:
        label_log_y_axis_with_plain_numbers(ax)
    labels = {"Direct": "direct", "Iterative": "Krylov", "CalculiX": "CalculiX"}
    handles = [Line2D([], [], **ELEMENT_LOOK[element]) for element in COST_ELEMENTS]
    handles += [
        Line2D([], [], color="#555555", linestyle=line, label=labels[method])
        for method, line in LINE_STYLES.items()
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=7)
    return fig


def _draw_time_and_memory_of_one_task(
    time_and_memory_axes: list[Axes], results: Results, task: str, element: str, method: str
) -> None:
    """Draw CPU time and memory of a task on one process over the number of unknowns.

    Args:
        time_and_memory_axes: The axes for time and for memory.
        results: All results.
        task: Name of the task.
        element: Name of the study's element; for CalculiX its own element is used instead.
        method: Name of the method.
    """
    name = CALCULIX_ELEMENTS.get(element, element) if method == "CalculiX" else element
    rows = [
        results[f"K/{case}"].scalars
        for case in results.cases("K")
        if case.startswith(f"{task}-{name}-") and case.endswith(method)
    ]
    if not rows:
        return
    rows.sort(key=lambda row: row["dofs"])
    look = ELEMENT_LOOK[element] | {"linestyle": LINE_STYLES[method]}
    seconds = "whole_seconds" if task == "contact" else "seconds"
    for ax, quantity in zip(time_and_memory_axes, (seconds, "megabytes"), strict=True):
        ax.plot([row["dofs"] for row in rows], [row[quantity] for row in rows], **look)


def caption_time_and_memory_over_unknowns(results: Results) -> str:
    """Return the caption of `draw_time_and_memory_over_unknowns`, which names the machine."""
    machine = results["K/factors-pw-T10-8-Direct"].parameters["machine"]
    return (
        "CPU time and largest resident memory of the process for a block 2 × 1 (× 1): "
        "(a) factorisation of the stiffness (LDLᵀ for the standard elements, LU for the new ones); "
        "(b) the six lowest frequencies; (c) contact on a rough plane, the whole run, by a direct "
        "and by a Krylov solver with multigrid, and by CalculiX with its C3D10 and "
        f"surface-to-surface contact. Medians of three runs, or a single long run, on {machine}."
    )


# Figure: growth of contact's cost

GROWTH_SERIES = {
    "rigid surface": ("contact-pw-T10", (8, 11, 16, 27), "#0072B2", "o"),
    "two bodies": ("bodies-pw-T10", (7, 10, 14, 20), "#D55E00", "s"),
    "with a pressure, ν = 1/2": ("contact-pw-hybrid-T10", (8, 11, 16, 22), "#009E73", "^"),
    "loose pieces": ("pieces-pw-T10", (10, 25, 50, 100), "#444444", "D"),
}
"""Task with element, mesh sizes, colour and marker of each curve, by label."""
GROWTH_KEYS = {
    label: [f"K/{task}-{size}-Iterative" for size in sizes]
    for label, (task, sizes, *_) in GROWTH_SERIES.items()
}


def draw_contact_cost_per_unknown(results: Results) -> Figure:
    """Draw the CPU time and the memory of contact analyses per unknown over the number of unknowns.

    The curves are contact with a rigid surface, contact of two bodies, an incompressible body, and
    loose pieces. A horizontal curve means that the cost is proportional to the number of unknowns.
    """
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.5))
    panels = (
        ("seconds", 1e6, "CPU time per unknown / µs"),
        ("megabytes", 1e3, "memory per unknown / kB"),
    )
    for ax, (name, unit, axis_label) in zip(axes, panels, strict=True):
        for label, (*_, colour, marker) in GROWTH_SERIES.items():
            rows = [results[key].scalars for key in GROWTH_KEYS[label]]
            dofs = [row["dofs"] for row in rows]
            per_unknown = [unit * row[name] / row["dofs"] for row in rows]
            ax.plot(dofs, per_unknown, color=colour, marker=marker, label=label)
        ax.set(xscale="log", yscale="log", xlabel="unknowns", ylabel=axis_label)
        label_log_y_axis_with_plain_numbers(ax)
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=7)
    return fig


def caption_contact_cost_per_unknown(results: Results) -> str:
    """Return the caption of `draw_contact_cost_per_unknown`, which names the machine."""
    machine = results["K/bodies-pw-T10-20-Iterative"].parameters["machine"]
    return (
        "Contact with friction in space by the Krylov solver on one process, new T10: CPU time of "
        "the solution and largest resident memory, both over the number of unknowns, of a block on "
        "a rigid plane, of two blocks, of the block at ν = 1/2 with an independent pressure, and "
        "of 10 to 100 loose cubes on a plane. A level line is growth in proportion; memory "
        f"includes some 130 MB for the imports. Machine: {machine}."
    )


FIGURES = [
    PageFigure(
        "k_cost",
        draw_time_and_memory_over_unknowns,
        needs=[
            "K/factors-pw-T10-8-Direct",
            "K/contact-pw-T10-8-Direct",
            "K/contact-pw-T10-8-Iterative",
        ],
        caption=caption_time_and_memory_over_unknowns,
        alt="Six plots with logarithmic axes; time and memory grow with the number of unknowns, by "
        "factors in space much faster than by Krylov's method, whose time is nearly proportional.",
    ),
    PageFigure(
        "k_growth",
        draw_contact_cost_per_unknown,
        needs=[key for keys in GROWTH_KEYS.values() for key in keys],
        caption=caption_contact_cost_per_unknown,
        alt="Two plots with logarithmic axes; lines of CPU time per unknown are nearly level, a "
        "little rising, and those of memory per unknown fall towards a level.",
    ),
]

# Findings

CHECKS = [
    check(
        "K-incompressible-contact",
        "Contact of the block at nu = 1/2, new tetrahedra with a pressure, 74 727 unknowns:"
        " the Krylov solver takes less than a fifth of the CPU time of factorisation.",
        lambda results: ratio(
            results,
            key="K/contact-pw-hybrid-T10-11-Iterative",
            other="K/contact-pw-hybrid-T10-11-Direct",
            name="seconds",
        ),
        "<",
        0.2,
        tolerance_why="none: a bound set with the measured values known, to record their size",
        tolerance_set="after",
        why="Nothing is factorised, and contact holds displacements alone.",
    ),
    check(
        "K-sliding-bodies",
        "Two bodies of rubber that slide on each other: from 10 584 to 201 792 unknowns, CPU time"
        " of the Krylov solver grows with less than their power 1.2.",
        lambda results: growth_exponent(
            results,
            key="K/sliding-bodies-pw-T10-6-Iterative",
            other="K/sliding-bodies-pw-T10-17-Iterative",
            name="seconds",
            over="dofs",
        ),
        "<",
        1.2,
        tolerance_why="none: a bound set with the measured values known, to record their size",
        tolerance_set="after",
        why="The multigrid levels of the stiffness are kept while the bodies slide.",
    ),
    check(
        "K-sliding-solvers",
        "The displacements of both solvers at 42 522 unknowns have the same norm to 1e-9.",
        lambda results: ratio(
            results,
            key="K/sliding-bodies-pw-T10-10-Iterative",
            other="K/sliding-bodies-pw-T10-10-Direct",
            name="displacement",
        ),
        "=",
        1.0,
        tolerance=1e-9,
        tolerance_why="the accuracy to which both solvers satisfy the contact law",
        tolerance_set="before",
        why="Both solve the same equations.",
    ),
]

FINDINGS = r"""
**In three dimensions the solver decides, not the element.** At {{ count(s("K/contact-pw-T10-11-Direct", "dofs")) }}
unknowns the direct solver takes
{{ fixed(1 / measure("ratio", key="K/contact-pw-T10-11-Iterative", other="K/contact-pw-T10-11-Direct", name="whole_seconds"), 0) }}
times the CPU time of the Krylov solver, with the same numbers of sticking and slipping nodes. With the Krylov solver,
contact of the standard element takes
{{ fixed(measure("ratio", key="K/contact-galerkin-T10-11-Iterative", other="K/contact-pw-T10-11-Iterative", name="whole_seconds"), 2) }}
times as long as contact of the new one. CalculiX {{ cite("calculix") }} with its C3D10 element on the same mesh, with
surface-to-surface contact and a direct solver, takes
{{ fixed(measure("ratio", key="K/contact-C3D10-11-CalculiX", other="K/contact-pw-T10-11-Direct", name="whole_seconds"), 1) }}
times the CPU time of our direct solver. It also follows large displacements, which this run of ours does not. All this
holds for one machine, one body and $\nu = 0.3$; nearer to 1/2 the Krylov solver needs several times as many steps.
"""

FURTHER_FINDINGS = r"""
1. **The Krylov solver also works for two bodies, one held only by the other.** At
   {{ fixed(s("K/bodies-pw-T10-10-Direct", "dofs"), 0) }} unknowns its displacements differ from those obtained by
   factorisation by {{ num(s("K/bodies-pw-T10-10-compared", "difference"), 1) }} of the largest displacement, and
   {{ fixed(s("K/bodies-pw-T10-10-compared", "other_statuses"), 0) }} nodes have a different contact status;
   {{ fixed(s("K/bodies-pw-T10-20-Iterative", "dofs"), 0) }} unknowns take
   {{ fixed(s("K/bodies-pw-T10-20-Iterative", "seconds"), 0) }} s and
   {{ fixed(s("K/bodies-pw-T10-20-Iterative", "megabytes"), 0) }} MB.
2. **With an independent pressure the Krylov solver stays fast up to $\nu = 1/2$.** A block-triangular preconditioner
   (multigrid for the displacements, the mass matrix for the pressure) takes
   {{ fixed(s("K/incompressible-pw-hybrid-T10-5-Iterative", "krylov_iterations"), 0) }},
   {{ fixed(s("K/incompressible-pw-hybrid-T10-11-Iterative", "krylov_iterations"), 0) }} and
   {{ fixed(s("K/incompressible-pw-hybrid-T10-22-Iterative", "krylov_iterations"), 0) }} iterations at
   {{ fixed(s("K/incompressible-pw-hybrid-T10-5-Iterative", "dofs"), 0) }},
   {{ fixed(s("K/incompressible-pw-hybrid-T10-11-Iterative", "dofs"), 0) }} and
   {{ fixed(s("K/incompressible-pw-hybrid-T10-22-Iterative", "dofs"), 0) }} unknowns, and as many with the standard
   weights. In contact at {{ fixed(s("K/contact-pw-hybrid-T10-11-Direct", "dofs"), 0) }} unknowns it takes
   {{ fixed(1 / measure("ratio", key="K/contact-pw-hybrid-T10-11-Iterative", other="K/contact-pw-hybrid-T10-11-Direct", name="seconds"), 0) }}
   times less CPU time than factorisation and
   {{ fixed(1 / measure("ratio", key="K/contact-pw-hybrid-T10-11-Iterative", other="K/contact-pw-hybrid-T10-11-Direct", name="megabytes"), 1) }}
   times less memory, for the same numbers of sticking and slipping nodes.
3. **CPU time grows nearly in proportion to the unknowns.** Between the smallest and the largest of four sizes it grows
   with their power {{ power("contact-pw-T10", 8, 27) }} for a block on a rigid plane,
   {{ power("bodies-pw-T10", 7, 20) }} for two bodies, {{ power("contact-pw-hybrid-T10", 8, 22) }} with an independent
   pressure at $\nu = 1/2$, and {{ power("pieces-pw-T10", 10, 100) }} for 10 to 100 loose cubes on a plane.
4. **At large strains an increment costs four to five linear solutions.** A rough ball is pressed into neo-Hookean rubber
   of {{ fixed(s(ball, "dofs"), 0) }} unknowns and moved along it, in two increments. One of them takes
   {{ fixed(s(ball, "over_linear"), 1) }} times the CPU time of one linear contact solution on the same mesh
   ({{ fixed(s(small_ball, "over_linear"), 1) }} times at {{ fixed(s(small_ball, "dofs"), 0) }} unknowns). Both together
   take {{ fixed(s(ball, "iterations"), 0) }} Newton steps, each of which assembles a tangent,
   {{ fixed(s(ball, "krylov_iterations"), 0) }} Krylov iterations, and {{ fixed(s(ball, "megabytes"), 0) }} MB. The
   multigrid levels are kept over Newton steps and increments. At {{ fixed(s(large_ball, "dofs"), 0) }} unknowns
   {{ fixed(s(large_ball, "megabytes"), 0) }} MB are enough, and an increment takes
   {{ fixed(s(large_ball, "over_linear"), 1) }} linear solutions: {{ fixed(s(large_ball, "iterations"), 0) }} Newton steps
   need {{ fixed(s(large_ball, "krylov_iterations"), 0) }} Krylov iterations.
5. **The cost of sliding bodies grows nearly in proportion, too.** At
   {{ fixed(s("K/sliding-bodies-pw-T10-10-Direct", "dofs"), 0) }} unknowns the direct solver takes
   {{ fixed(measure("ratio", key="K/sliding-bodies-pw-T10-10-Direct", other="K/sliding-bodies-pw-T10-10-Iterative", name="seconds"), 1) }} times the CPU time of the
   Krylov solver. Each Newton step takes {{ steps(6) }}, {{ steps(10) }} and {{ steps(17) }} Krylov iterations, and CPU time grows
   with the power {{ power("sliding-bodies-pw-T10", 6, 17) }} of the unknowns.
6. **Other programs on the same meshes.** CalculiX takes {{ over_peer("C3D10-5-CalculiX-nodes", "pw-T10-5-Direct", "block", "whole_seconds") }} times
   the CPU time of our direct solver and {{ over_peer("C3D10-5-CalculiX-nodes", "pw-T10-5-Iterative", "block", "whole_seconds") }} times that of the
   Krylov solver for the block with contact at nodes, and {{ over_peer("C3D10-5-CalculiX", "pw-T10-5-Direct", "block", "whole_seconds") }} and
   {{ over_peer("C3D10-5-CalculiX", "pw-T10-5-Iterative", "block", "whole_seconds") }} times with surface-to-surface contact. felupe takes
   {{ over_peer("triangle6-16-felupe", "galerkin-T6-16-Direct", "rubber", "whole_seconds") }} times the CPU time of our standard
   element for the rubber, and {{ over_peer("triangle6-16-felupe", "pw-T6-16-Direct", "rubber", "whole_seconds") }} times that of the new one, in
   {{ fixed(s("K/peer-rubber-triangle6-16-felupe", "iterations"), 0) }} Newton steps against
   {{ fixed(s("K/peer-rubber-galerkin-T6-16-Direct", "iterations"), 0) }} and
   {{ fixed(s("K/peer-rubber-pw-T6-16-Direct", "iterations"), 0) }}; its normal force is
   {{ over_peer("triangle6-16-felupe", "galerkin-T6-16-Direct", "rubber", "normal", 3) }} and its tangential force
   {{ over_peer("triangle6-16-felupe", "galerkin-T6-16-Direct", "rubber", "tangential", 3) }} times that of our standard element. Nodal
   forces alternate in both programs as they do with our standard elements; those of the new elements do not
   (column “Corner / mid-side” above).
"""

# Limits

LIMITS = r"""
The measurements cover one machine with two cores, which had other work at times, blocks, and one material
($\nu = 0.3$, or 1/2 with a pressure field). Near $\nu = 1/2$ the Krylov solver takes several times as many iterations for
a displacement-only formulation. At two million unknowns each row is a single run on two processes, whose waiting for each
other counts as CPU time; runs of the same row one after the other differ by up to a fifth, and the last two columns are
no more certain than that. The machine's speed changed much within hours, so rows that are compared were measured one
after the other; others, such as blocks and two bodies, were not. Sliding bodies were measured on another
machine with much other work, which makes CPU times longer by a varying factor, and wall times meaningless;
compare them only with each other. The direct solver was not tried at their largest size. Comparisons with other
programs are on small meshes, on a busy machine, and include about a second for Python's imports; CalculiX' penalties
were chosen with 4 and 8 cells along the height, not with the 5 that are shown.
"""

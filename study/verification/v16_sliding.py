"""Large strains and large sliding: rubber below a rigid cylinder and a rigid sphere.

A neo-Hookean block is pressed by half of the tool's radius and ironed by 0.6 of it. The weights
enter by the residual alone; what is measured is how even nodal forces are, what Newton's method
needs, what depends on the step, and the work that nodal forces do.
"""

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements import prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, Motion, Sphere
from pw_elements.contact.model import ContactState
from study.model.units import dimensionless
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions.calculix.calculix import peer_of, tracked_digest
from study.solutions.calculix.cylinder import CYLINDERS, HALF_WIDTH, HEIGHT
from study.verification.v16_known import compressed, hertz, sheared
from study.verification.v16_rubber import (
    SPACE_HEIGHT,
    SPACE_WIDTH,
    Array,
    Rubber,
    Run,
    block,
    cube,
    follow,
)
from study.verification.v16_turning import bush, wheel

SECTION = "V16"
TITLE = "Large strains and large sliding: rubber below a cylinder"

FRICTION, DOWN, ASIDE = 0.3, 0.5, 0.6
EDGE = 3  # nodes at each end of the contact that do not count
ZONE = 0.9  # of the half width, in which nodes may touch
ROUND_OFF = 1e-6  # corners of the standard tetrahedron carry nothing
BASE = {2: HEIGHT, 3: SPACE_HEIGHT}


def cylinder(element: str, elements: int, pressed: int, ironed: int) -> Result:
    """The block pressed and ironed by a cylinder, in so many increments each."""
    rubber, run = _run(element, elements, pressed, ironed, FRICTION)
    states, last = run.states[1:], run.states[-1].pairs[0]
    forces = np.array([state.pairs[0].force for state in states])
    nominal, true = rubber.areas(last.node)
    spent = sum(_friction(state) for state in states)
    work = run.tools_work()
    place = last.position + last.displacement
    curves = {
        "x": last.position[:, 0],
        "place": place,
        "force_n": last.force_normal,
        "force_t": last.force_tangential[:, 0],
        "nominal_pressure": last.force_normal / nominal,
        "true_pressure": last.force_normal / true,
        "status": last.status.astype(float),
        "N": -forces[:, 1],
        "T": forces[:, 0],
        "iterations": np.array([float(state.iterations) for state in states]),
        "nodes": rubber.x + rubber.displacement,
        "cells": rubber.field.space.dofmap.list.copy(),
    }
    scalars = _counts(states) | {
        "mid_over_corner": np.median([_along(state, rubber.corner) for state in states[pressed:]]),
        "N_pressed": -forces[pressed - 1, 1],
        "N": -forces[-1, 1],
        "T": forces[-1, 0],
        "T_over_N": -forces[-1, 0] / forces[-1, 1],
        "sticking": np.sum(last.status == STICK),
        "closed": np.sum(last.status != OPEN),
        "peak_nominal_pressure": curves["nominal_pressure"].max(),
        "peak_true_pressure": curves["true_pressure"].max(),
        "base_defect": run.base_defect(),
        "tools_work": work,
        "stored": run.stored[-1],
        "dissipated": spent,
        "energy_remainder": (work - run.stored[-1] - spent) / work,
    }
    return _result(scalars, curves, rubber)


def steps(element: str, elements: int, pressed: int, ironed: int) -> Result:
    """Of the same way in other increments what depends on them."""
    rubber, run = _run(element, elements, pressed, ironed, FRICTION)
    states, last = run.states[1:], run.states[-1].pairs[0]
    scalars = _counts(states) | {
        "N_pressed": -states[pressed - 1].pairs[0].force[1],
        "N": -last.force[1],
        "T": last.force[0],
        "T_over_N": -last.force[0] / last.force[1],
        "sticking": np.sum(last.status == STICK),
    }
    return _result(scalars, {}, rubber)


def energy(element: str, elements: int, pressed: int) -> Result:
    """The work of nodal forces without friction, less the energy stored, over that work."""
    rubber, run = _run(element, elements, pressed, 0, 0.0)
    work, tools = run.work(), run.tools_work()
    scalars = {
        "energy_remainder": (work - run.stored[-1]) / work,
        "tools_remainder": (tools - run.stored[-1]) / tools,
        "work": work,
        "stored": run.stored[-1],
    }
    return _result(scalars, {}, rubber)


def against_calculix(element: str, case: str, tracked: str) -> Result:
    """The total force on the tool along CalculiX' way, with its energy, from its tracked record."""
    peer, known = CYLINDERS[case], peer_of(case, tracked).numbers
    rubber = Rubber(element, block(peer.elements), peer=True)
    run = _follow(rubber, peer.ways, peer.friction, ironed=True)
    force = np.array([state.pairs[0].force for state in run.states[1:]])
    normal, tangential = -force[:, 1], force[:, 0]
    largest = known["N"].max()
    scalars = {
        "N_difference": np.abs(normal - known["N"]).max() / largest,
        "N": normal[-1],
        "T": tangential[-1],
    }
    if "T" in known:
        scalars["T_difference"] = np.abs(tangential - known["T"]).max() / largest
    curves = known | {"N_calculix": known["N"], "N": normal, "T": tangential}
    return _result(scalars, curves, rubber)


def sphere(element: str, elements: int, pressed: int, ironed: int = 0) -> Result:
    """A block in space, pressed by a sphere and perhaps ironed, half or a quarter of it."""
    rubber, run = _run(element, elements, pressed, ironed, FRICTION)
    states, last = run.states[1:], run.states[-1].pairs[0]
    x = last.position
    away = np.linalg.norm(x[:, :2] - last.translation[:2], axis=1)
    near = away < away[last.status != OPEN].max() / 2
    mirrors = [1] if ironed else [0, 1]
    if not ironed:  # mirrored diagonals meet there: four or eight triangles, elsewhere six
        near &= away > 1e-9
    # the other half's force on a node in a plane of symmetry is the same
    force = last.force_normal * np.prod(np.where(np.abs(x[:, mirrors]) < 1e-9, 2.0, 1.0), axis=1)
    corner = rubber.corner[last.node]
    scalars = _counts(states) | {
        "mid_over_corner": _quotient(force[near & ~corner].mean(), force[near & corner].mean()),
        "corner_over_mid": force[near & corner].mean() / force[near & ~corner].mean(),
        "corners": np.sum(near & corner),
        "N": -last.force[2],
        "T": last.force[0],
        "T_over_N": -last.force[0] / last.force[2],
        "base_defect": run.base_defect([0, 2] if ironed else [2]),
    }
    curves = {"x": x, "force_n": force, "corner": corner.astype(float)}
    return _result(scalars, curves, rubber)


def _run(
    element: str, elements: int, pressed: int, ironed: int, friction: float
) -> tuple[Rubber, Run]:
    plane = element.endswith("T6")
    rubber = Rubber(element, block(elements) if plane else cube(elements, half=ironed > 0))
    ways = [(0.0, -DOWN * (k + 1) / pressed) for k in range(pressed)]
    ways += [(ASIDE * (k + 1) / ironed, -DOWN) for k in range(ironed)]
    return rubber, _follow(rubber, ways, friction, ironed > 0)


def _follow(rubber: Rubber, ways: list[tuple[float, float]], friction: float, ironed: bool) -> Run:
    plane = rubber.dim == 2
    dim, wide = rubber.dim, HALF_WIDTH if plane else SPACE_WIDTH
    axis, height = dim - 1, BASE[dim]

    def below(x: Array) -> npt.NDArray[np.bool_]:
        return np.asarray(np.isclose(x[axis], -height))

    def above(x: Array) -> npt.NDArray[np.bool_]:
        near = (np.abs(x[:axis]) < ZONE * wide).all(axis=0)
        return np.asarray(np.isclose(x[axis], 0) & near)

    space = rubber.w.function_space
    held = [prescribe(space, k, below) for k in range(dim)]
    if not plane:
        held += [_mirror(space, k) for k in ([1] if ironed else [0, 1])]
    centre = (*[0.0] * axis, 1.0)
    pair = ContactPair(above, Sphere(centre, 1.0), friction=friction)
    motions = [Motion((x, *[0.0] * (dim - 2), y)) for x, y in ways]
    return follow(rubber, pair, held, motions, below(rubber.x.T))


def _mirror(space: fem.FunctionSpace, axis: int) -> fem.DirichletBC:
    return prescribe(space, axis, lambda x: np.isclose(x[axis], 0))


def _counts(states: list[ContactState]) -> dict[str, float]:
    """Iterations, those of abandoned attempts too, and increments that were cut."""
    return {
        "iterations_mean": sum(state.iterations for state in states) / len(states),
        "iterations_most": max(state.iterations for state in states),
        "cut": sum(bool(state.substates) for state in states),
        "increments": len(states),
    }


def _along(state: ContactState, corner: npt.NDArray[np.bool_]) -> float:
    """Median of mid-side forces over the mean of their neighbours', away from the edges."""
    pair = state.pairs[0]
    inner = np.flatnonzero(pair.status != OPEN)[EDGE:-EDGE]
    middle = inner[~corner[pair.node[inner]]]
    force = pair.force_normal
    return float(np.median(2 * force[middle] / (force[middle - 1] + force[middle + 1])))


def _quotient(force: float, over: float) -> float:
    """Of forces; where the second one is round-off, what cannot be told from more."""
    return float(force / max(abs(over), ROUND_OFF * abs(force)))


def _friction(state: ContactState) -> float:
    """Work that friction takes in an increment, in its parts, by forces at their ends."""
    ends = [part.pairs[0] for _, part in state.substates]
    last = state.pairs[0]
    own = last.slip - sum((pair.slip for pair in ends), np.zeros_like(last.slip))
    works = [np.sum(pair.force_tangential * pair.slip) for pair in ends]
    return -float(np.sum([*works, np.sum(last.force_tangential * own)]))


def _result(scalars: dict[str, float], curves: dict[str, Array], rubber: Rubber) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=len(rubber.w.x.array))


def _cylinder(element: str, elements: int, pressed: int, ironed: int, suffix: str = "") -> Case:
    stated = {"element": element, "elements": elements, "pressed": pressed, "ironed": ironed}
    return Case("V16", f"cylinder-{element}-{elements}{suffix}", cylinder, stated)


def _steps(element: str, pressed: int, ironed: int) -> Case:
    stated = {"element": element, "elements": 8, "pressed": pressed, "ironed": ironed}
    return Case("V16", f"steps-{element}-{pressed}-{ironed}", steps, stated)


CASES = [
    *(_cylinder(element, 8, 2, 2) for element in ("pw-T6", "galerkin-T6", "pw-hybrid-T6")),
    *(_cylinder(element, 16, 10, 24) for element in ("pw-T6", "galerkin-T6")),
    *(_steps("pw-T6", n, n) for n in (1, 2, 4, 8)),
    *(_steps("pw-hybrid-T6", n, n) for n in (2, 4, 8)),
]
CASES += mark_costly([_cylinder("pw-T6", 16, 20, 48, "-68")])
CASES += [
    Case("V16", f"energy-{element}-{n}", energy, {"element": element, "elements": n, "pressed": 20})
    for element in ("pw-T6", "galerkin-T6")
    for n in (4, 8)
]
CASES += [
    Case("V16", f"sphere-{element}-6", sphere, {"element": element, "elements": 6, "pressed": 4})
    for element in ("pw-T10", "galerkin-T10")
]
_IRONED = {"element": "pw-T10", "elements": 3, "pressed": 2, "ironed": 2}
CASES.append(Case("V16", "ironing-pw-T10-3", sphere, _IRONED))
CASES += [
    Case("V16", f"{name}-{element}", run, {"element": element})
    for name, run in (("compression", compressed), ("shear", sheared))
    for element in ("pw-T6", "pw-T10")
]
CASES += [
    Case("V16", f"hertz-pw-T6-{n}", hertz, {"element": "pw-T6", "radius": float(n)})
    for n in (4, 16, 64)
]
CASES += [
    Case("V16", "bush-pw-T6", bush, {"element": "pw-T6"}),
    Case("V16", "wheel-pw-hybrid-T6-4", wheel, {"element": "pw-hybrid-T6", "elements": 4}),
]
CASES += [
    Case("V16", f"calculix-pw-T6-{case}", against_calculix, stated)
    for case in CYLINDERS
    for stated in [{"element": "pw-T6", "case": case, "tracked": tracked_digest(case)}]
]

"""Two deformable bodies at large sliding: a die, bodies turned together, rings, a press fit.

Neo-Hookean bodies of section V16 touch each other with meshes that do not match. What is measured
is what no choice of side, frame or step should change: balance, even forces on both sides, friction
node by node, Newton's iterations; and the pressure of an incompressible fit, which is known.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, locate_entities_boundary
from scipy.integrate import quad

from pw_elements import Spaces, SurfaceNodes, prescribe
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact import OPEN, SLIP, ContactPair, ContactProblem, DeformableSurface
from pw_elements.contact.interface import gather_trace
from pw_elements.contact.model import ContactState, PairState
from pw_elements.contact.nodes import FORCE_TOLERANCE
from pw_elements.meshes import curved_mesh
from study.meshes.graded_meshes import joined
from study.meshes.line_mesh import on_lines
from study.model.discretisation import spaces
from study.model.units import dimensionless
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions.calculix.calculix import peer_of, tracked_digest
from study.solutions.calculix.die import (
    CURVATURE,
    DEPTH,
    DIES,
    ELEMENTS,
    FRICTION,
    GAP,
    HALF,
    PRESSED,
    TIMES,
    lines,
    shaped,
)
from study.verification.sliding_quadratic import DualQuadraticProblem
from study.verification.v16_rubber import Rubber

SECTION = "V17"
TITLE = "Two deformable bodies at large sliding"

# Lengths over the die's width, which is one, stresses over the shear modulus
EDGE = 2  # nodes at each end of the contact that do not count
PRESSED_LEAST = 1e-9  # of the largest nodal force: less is round-off, of either sign
INNER = 0.3  # of the master's largest nodal force, below which its nodes do not count
ROUND_OFF = 1e-12  # of the law, over the largest force
# A flat die: elements per width of its side and the block's, height, and way; its top is tilted,
# or the rear end would lift, and the side not be flat
FLAT, HEIGHT, SLIDE, FLAT_DEPTH, TILT = (8, 6), 0.4, 1.0, 0.05, 0.5
# Rings: radii, distance at first, and way; cells round and across
RADII, APART, WAY, RINGS = (0.7, 1.0), 0.005, 0.3, ((24, 2), (17, 2))
# Tubes: radii, what the inner one's hole grows to, cells across, Poisson's ratio
TUBES, GROWN, ACROSS, RATIO = ((1.0, 1.5), (1.55, 2.0)), 1.35, 8, 0.49999


@dataclass
class Course:
    """What is seen on the way: states, and the violation of the law after each iteration."""

    states: list[ContactState] = field(default_factory=list)
    violations: list[list[float]] = field(default_factory=list)

    def counts(self) -> dict[str, float]:
        """Iterations with those of abandoned attempts; share of increments with a quadratic end."""
        ends = [v[-2:] for v in self.violations if len(v) > 1]
        quadratic = [last <= max(ROUND_OFF, 1e3 * before**2) for before, last in ends]
        return {
            "iterations_mean": float(np.mean([state.iterations for state in self.states])),
            "cut": float(sum(bool(state.substates) for state in self.states)),
            "increments": float(len(self.states)),
            "quadratic": float(np.mean(quadratic)),
        }

    def balance(self) -> float:
        """Largest sum of the forces on both sides, over the force."""
        sums = [
            _pair(state).force + _pair(state).opposite_force.sum(axis=0) for state in self.states
        ]
        sizes = np.linalg.norm([_pair(state).force for state in self.states], axis=1)
        return float((np.linalg.norm(sums, axis=1) / sizes).max())

    def cone(self) -> float:
        """Largest distance of friction from its cone, over the largest nodal force."""
        worst = []
        for pair in map(_pair, self.states):
            limit = pair.friction * pair.force_normal
            beyond = np.linalg.norm(pair.force_tangential, axis=1) - limit
            away = np.where(pair.status == SLIP, np.abs(beyond), beyond)
            worst.append(away.max() / np.abs(pair.force_vector).max())
        return float(max(0.0, *worst))


def _pair(state: ContactState) -> PairState:
    return state.pairs[0]


def follow(
    bodies: Rubber,
    sides: Sequence[Indices],
    hold: Callable[[float, Array], None],
    held: Sequence[Mask],
    times: Sequence[float],
    flat: Callable[[Array], Mask] | None = None,
) -> Course:
    """Two bodies' way, at the ends of increments.

    Args:
        bodies: of one mesh; standard elements have dual quadratic multipliers.
        sides: facets of the slave and of the master.
        hold: writes displacements of all nodes (n, 2) at a time.
        held: masks of nodes (n,) that are held so.
        times: of the ends.
        flat: marker of nodes that do not move vertically.
    """
    space, course = bodies.field.space, Course()
    given = fem.Function(space)
    nodes = np.flatnonzero(np.any(held, axis=0)).astype(np.int32)
    conditions = [fem.dirichletbc(given, nodes)]
    if flat is not None:
        conditions.append(prescribe(space, 1, flat))

    def told(progress: object) -> None:
        if getattr(progress, "state", None) is None:
            course.violations[-1].append(getattr(progress, "violation", np.inf) * FORCE_TOLERANCE)

    own, opposite = (side.astype(np.int32) for side in sides)
    of_pair = fem.locate_dofs_topological(space, 1, own)
    pair = ContactPair(of_pair, DeformableSurface(opposite, False), FRICTION)
    stated = bodies.residual, bodies.w, conditions, pair
    problem: ContactProblem | DualQuadraticProblem
    if bodies.element.startswith("pw"):
        problem = ContactProblem.of_residual(*stated, callback=told)
    else:
        traces = gather_trace(space, own), gather_trace(space, opposite)
        problem = DualQuadraticProblem(*stated, traces, told)
    state, before = problem.undeformed, 0.0
    for end in times:

        def load(share: float, before: float = before, end: float = end) -> None:
            hold((1 - share) * before + share * end, given.x.array.reshape(-1, 2))

        course.violations.append([])
        state, before = problem.step(state, load), end
        course.states.append(state)
    return course


def die_meshes(own: int, opposite: int) -> tuple[Mesh, tuple[Indices, Indices]]:
    """A parabolic die and a block, with so many elements per width; facets of their sides."""
    block, upper = lines(own, opposite)
    mesh, _ = joined(_degree_two(*block, lambda x: x), _degree_two(*upper, shaped))

    def under(x: Array) -> Mask:
        return np.asarray(np.isclose(x[1], GAP + CURVATURE * x[0] ** 2 / 2) & (x[1] > GAP / 2))

    return mesh, (_facets(mesh, under), _facets(mesh, partial(_at_height, 0.0)))


def _at_height(y: float, x: Array) -> Mask:
    return np.asarray(np.isclose(x[1], y))


def _facets(mesh: Mesh, where: Callable[[Array], Mask]) -> Indices:
    """Exterior facets of which all vertices are there."""
    return locate_entities_boundary(mesh, mesh.topology.dim - 1, where).astype(np.int64)


def die(element: str, own: int, opposite: int) -> Result:
    """A parabolic die pressed into a block and slid over ten of its elements."""
    bodies, sides, course = _die(element, own, opposite)
    slid = course.states[PRESSED:]
    weights = _weights(bodies, sides)
    last, force = _pair(slid[-1]), np.array([_pair(s).force for s in course.states])
    place = last.position + last.displacement
    node, pressed = _on_master(bodies, slid[-1])
    scalars = course.counts() | {
        "balance_error": course.balance(),
        "moment_defect": max(_moment(bodies, s) for s in slid),
        "cone_error": course.cone(),
        **_evenness(bodies, slid, np.ones(len(bodies.x)), ""),
        **_evenness(bodies, slid, weights, "_pressure"),
        "edge_draw": max(_draw(_on_master(bodies, s)[1]) for s in slid),
        "N": force[-1, 1],
        "T_over_N": abs(force[-1, 0] / force[-1, 1]),
        "slipping": float(np.mean(last.status[last.status != OPEN] == SLIP)),
    }
    curves = {
        "x": place[:, 0],
        "force_n": last.force_normal,
        "pressure": last.force_normal / weights[last.node],
        "status": last.status.astype(float),
        "master_x": bodies.x[node, 0] + _moved(bodies, slid[-1])[node, 0],
        "master_force": pressed,
        "master_pressure": pressed / weights[node],
        "nodes": bodies.x + _moved(bodies, slid[-1]),
        "cells": bodies.field.space.dofmap.list.copy(),
        "N": force[:, 1],
        "T": force[:, 0],
    }
    return _result(scalars, curves, len(bodies.w.x.array))


def _die(
    element: str, own: int, opposite: int, peer: bool = False
) -> tuple[Rubber, tuple[Indices, Indices], Course]:
    mesh, sides = die_meshes(own, opposite)
    bodies = Rubber(element, mesh, peer)
    x = bodies.x
    base, top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], 1)
    way = ELEMENTS / own

    def hold(time: float, given: Array) -> None:
        given[top] = [way * max(0.0, time - 1), -DEPTH * min(time, 1.0)]

    times = TIMES[:HALF] if peer else TIMES
    return bodies, sides, follow(bodies, sides, hold, (base, top), times)


def against_calculix(element: str, case: str, tracked: str) -> Result:
    """The force on the die along CalculiX' way, with its energy, from its tracked record."""
    peer, known = DIES[case], peer_of(case, tracked).numbers
    bodies, _, course = _die(element, peer.own, peer.opposite, peer=True)
    force = np.array([_pair(state).force for state in course.states])
    normal, tangential = force[:, 1], -force[:, 0]
    largest = known["N"].max()
    scalars = {
        "N_difference": np.abs(normal - known["N"]).max() / largest,
        "T_difference": np.abs(tangential - known["T"]).max() / largest,
        "N": normal[-1],
        "T": tangential[-1],
    }
    curves = {"N": normal, "T": tangential, "N_calculix": known["N"], "T_calculix": known["T"]}
    return _result(scalars, curves, len(bodies.w.x.array))


def ironed(element: str) -> Result:
    """A flat die that slips all over, on a block whose upper side stays flat."""
    (across, _), (width, _) = lines(*FLAT)
    up = GAP + _lines(0.0, HEIGHT, 3)
    block = _degree_two(across, _lines(-1.0, 0.0, 3), lambda x: x)
    mesh, _ = joined(block, _degree_two(width, up, lambda x: x))
    sides = [_facets(mesh, partial(_at_height, y)) for y in (GAP, 0.0)]
    bodies = Rubber(element, mesh)
    x = bodies.x
    base, top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], up[-1])

    def hold(time: float, given: Array) -> None:
        given[top, 0] = SLIDE * max(0.0, time - 1)
        given[top, 1] = -FLAT_DEPTH * min(time, 1.0) * (1 - TILT * x[top, 0])

    times = [0.5, 1.0, *(1 + (k + 1) / 8 for k in range(8))]
    course = follow(bodies, sides, hold, (base, top), times, lambda x: np.isclose(x[1], 0))
    slid = [_pair(state) for state in course.states[-4:]]
    scalars = course.counts() | {
        "friction_error": max(abs(-p.force[0] / p.force[1] / FRICTION - 1) for p in slid),
        "slipping": min(float(np.mean(p.status == SLIP)) for p in slid),
        "cone_error": course.cone(),
        "balance_error": course.balance(),
    }
    return _result(scalars, {}, len(bodies.w.x.array))


def turned(element: str, degrees: int) -> Result:
    """The pressed die and block turned together: forces should turn along, and nothing slip."""
    mesh, sides = die_meshes(8, 6)
    bodies = Rubber(element, mesh)
    x = bodies.x
    base, top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], 1)
    parts = round(degrees / 17)

    def hold(time: float, given: Array) -> None:
        moved = x + np.outer(top, [0.0, -DEPTH * min(time, 1.0)])
        given[:] = moved @ _turn(degrees * max(0.0, time - 1)).T - x

    times = [0.5, 1.0, *(1 + (k + 1) / parts for k in range(parts))]
    course = follow(bodies, sides, hold, (base, top), times)
    before, after = _pair(course.states[1]), _pair(course.states[-1])
    back = after.force_vector @ _turn(degrees)
    size = np.abs(before.force_vector).max()
    slips = [np.abs(_pair(s).slip[_pair(s).status != OPEN]).max() for s in course.states[2:]]
    scalars = course.counts() | {
        "objectivity_error": float(np.abs(back - before.force_vector).max() / size),
        "slip": float(max(slips)),
        "balance_error": course.balance(),
    }
    return _result(scalars, {}, len(bodies.w.x.array))


def rings(element: str) -> Result:
    """Two half rings pressed together; once with either of them as the slave."""
    found, scalars, dofs = [], {}, 0
    for exchanged in (False, True):
        halves = []
        for number, cells in enumerate(RINGS):
            angle, radius = _lines(0.0, np.pi, cells[0]), _lines(*RADII, cells[1])
            halves.append(_half_ring(angle, radius, upper=number == 1))
        mesh, _ = joined(*halves)
        centre = np.array([0.0, 2 * RADII[1] + APART])

        def outside(c: float, x: Array) -> Mask:
            return np.asarray(np.isclose(np.hypot(x[0], x[1] - c), RADII[1]))

        sides = [_facets(mesh, partial(outside, c)) for c in (0.0, centre[1])]
        bodies = Rubber(element, mesh)
        low, high = (np.isclose(bodies.x[:, 1], c) for c in (0.0, centre[1]))

        def hold(time: float, given: Array, high: Mask = high) -> None:
            given[high] = [0.0, -WAY * time]

        times = [(k + 1) / 8 for k in range(8)]
        course = follow(bodies, sides[::-1] if exchanged else sides, hold, (low, high), times)
        found.append(abs(_pair(course.states[-1]).force[1]))
        if not exchanged:
            scalars = course.counts() | {"cone_error": course.cone()}
            scalars["balance_error"], dofs = course.balance(), len(bodies.w.x.array)
    scalars |= {"N": found[0], "side_difference": abs(found[1] / found[0] - 1)}
    return _result(scalars, {}, dofs)


def fit(element: str) -> Result:
    """Incompressible tubes: the inner one's hole grows until it presses the outer one far open."""
    strips = [
        on_lines(MPI.COMM_SELF, _lines(*radii, n), _lines(0.0, 0.1, 1), "triangle")
        for radii, n in zip(TUBES, (ACROSS, ACROSS - 2), strict=True)
    ]
    mesh, _ = joined(*strips)
    tubes = spaces(element, mesh)
    w, (v, q) = fem.Function(tubes.trial), ufl.TestFunctions(tubes.test)
    u, p = ufl.split(w)
    r = ufl.SpatialCoordinate(mesh)[0]

    def gradient(f: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        inner = ufl.grad(f)
        rows = [[inner[0, 0], inner[0, 1], 0], [inner[1, 0], inner[1, 1], 0], [0, 0, f[0] / r]]
        return ufl.as_matrix(rows)

    F = ufl.Identity(3) + gradient(u)
    J, inverse = ufl.det(F), ufl.inv(F).T
    stress, lame = F - inverse - p * J * inverse, 2 * RATIO / (1 - 2 * RATIO)
    density = ufl.inner(stress, gradient(v)) - q * (J - 1 + p / lame)
    residual = density * 2 * np.pi * r * ufl.dx(domain=mesh, metadata={"quadrature_degree": 6})
    axial, hole = fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)
    inner_radius = TUBES[0][0]
    held = [
        prescribe(tubes.trial, 1, lambda x: np.full(x.shape[1], True), axial),
        prescribe(tubes.trial, 0, lambda x: np.isclose(x[0], inner_radius), hole),
    ]

    def at(radius: float, x: Array) -> Mask:
        return np.asarray(np.isclose(x[0], radius))

    surface = DeformableSurface(partial(at, TUBES[1][0]), True)
    problem = ContactProblem.of_residual(
        residual, w, held, ContactPair(partial(at, TUBES[0][1]), surface)
    )
    state, before, course = problem.undeformed, 0.0, Course()
    for end in np.linspace(0.0, GROWN - inner_radius, 7)[1:]:

        def load(share: float, before: float = before, end: float = float(end)) -> None:
            hole.value = (1 - share) * before + share * end

        state, before = problem.step(state, load), float(end)
        course.states.append(state)
    pair = _pair(state)
    x = pair.position + pair.displacement
    contact = np.sqrt(TUBES[0][1] ** 2 + GROWN**2 - inner_radius**2)
    exact = _pressure(contact)
    total = pair.force_normal.sum() / (2 * np.pi * contact * 0.1)
    scalars = {
        "pressure_error": abs(total / exact - 1),
        "radius_error": float(np.abs(x[:, 0] / contact - 1).max()),
        "pressure": exact,
        "interference": float(contact / TUBES[1][0] - 1),
        "balance_error": float(abs((pair.force + pair.opposite_force.sum(axis=0)) / total).max()),
        "iterations_mean": float(np.mean([s.iterations for s in course.states])),
    }
    return _result(scalars, {}, len(w.x.array))


def _pressure(contact: float) -> float:
    """On an incompressible tube whose inner radius has become so large; it is free outside."""
    inner, outer = TUBES[1]
    grown = contact**2 - inner**2

    def stress(r: float) -> float:
        stretch = r / np.sqrt(r**2 - grown)
        return float((stretch**2 - stretch**-2) / r)

    return float(quad(stress, contact, np.sqrt(outer**2 + grown), epsabs=1e-13)[0])


def _half_ring(angle: Array, radius: Array, upper: bool) -> Mesh:
    """Half a ring above its centre, or below one above the other ring."""

    def shaped(x: Array) -> Array:
        sign = -1.0 if upper else 1.0
        y = sign * x[:, 1] * np.sin(x[:, 0])
        shift = 2 * RADII[1] + APART if upper else 0.0
        return np.column_stack([-sign * x[:, 1] * np.cos(x[:, 0]), shift + y, x[:, 2]])

    return _degree_two(angle, radius, shaped)


def _degree_two(x: Array, y: Array, image: Callable[[Array], Array]) -> Mesh:
    """A rectangle's mesh with its nodes, mid-side ones too, mapped: straight sides have corners."""
    return curved_mesh(on_lines(MPI.COMM_SELF, x, y, "triangle"), image)


def _lines(first: float, last: float, cells: int) -> Array:
    return np.linspace(first, last, cells + 1, dtype=np.float64)


def _turn(degrees: float) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def _moved(bodies: Rubber, state: ContactState) -> Array:
    return np.asarray(state.displacement.array_r.reshape(-1, bodies.dim))


def _weights(bodies: Rubber, sides: Sequence[Indices]) -> Array:
    """Integrals (n,) of nodes' own test functions over the undeformed sides, ones elsewhere."""
    way = Spaces.petrov_galerkin if bodies.element.startswith("pw") else Spaces.galerkin
    scalars, weights = way(bodies.w.function_space.mesh, 0), np.ones(len(bodies.x))
    for side in sides:
        surface = SurfaceNodes.from_scalar_spaces(scalars, side.astype(np.int32))
        weights[surface.node] = surface.weight_area
    return weights


def _evenness(
    bodies: Rubber, states: Sequence[ContactState], weights: Array, of: str
) -> dict[str, float]:
    """Medians of mid-side over mean corner values of both sides, forces over weights (n,)."""
    own, theirs = [], []
    for state in states:
        pair = _pair(state)
        order = np.argsort(bodies.x[pair.node, 0])
        node, force = pair.node[order], pair.force_normal[order]
        inner = np.flatnonzero(force > PRESSED_LEAST * force.max())[EDGE:-EDGE]
        own.append(_middle(bodies, node, force / weights[node], inner))
        node, force = _on_master(bodies, state)
        force = force / weights[node]
        inner = np.flatnonzero(force > INNER * force.max())
        theirs.append(_middle(bodies, node, force, inner))
    names = f"mid_over_corner{of}", f"mid_over_corner{of}_master"
    return {name: float(np.median(v)) for name, v in zip(names, (own, theirs), strict=True)}


def _middle(bodies: Rubber, node: Indices, values: Array, inner: Indices) -> float:
    """Median of mid-side values over the mean of their neighbours', in the order of places."""
    middle = inner[~bodies.corner[node[inner]]]
    return float(np.median(2 * values[middle] / (values[middle - 1] + values[middle + 1])))


def _on_master(bodies: Rubber, state: ContactState) -> tuple[Indices, Array]:
    """The master's nodes in order, and what presses them."""
    pair = _pair(state)
    order = np.argsort(bodies.x[pair.opposite_node, 0])
    node, force = pair.opposite_node[order], pair.opposite_force[order]
    x = bodies.x[node] + _moved(bodies, state)[node]
    chord = np.gradient(x, axis=0)
    normal = np.stack([chord[:, 1], -chord[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return node, np.sum(normal * force, axis=1)


def _draw(pressed: Array) -> float:
    """What draws the most over what presses the most."""
    return float(max(0.0, -pressed.min() / pressed.max()))


def _moment(bodies: Rubber, state: ContactState) -> float:
    """Sum of moments of forces on both sides, over the sum of their sizes."""
    pair, moved = _pair(state), _moved(bodies, state)
    nodes = np.concatenate([pair.node, pair.opposite_node])
    force, x = np.concatenate([pair.force_vector, pair.opposite_force]), (bodies.x + moved)[nodes]
    x = x - x.mean(axis=0)
    moments = x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    return float(abs(moments.sum()) / np.abs(moments).sum())


def _result(scalars: dict[str, float], curves: dict[str, Array], dofs: int) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=dofs)


def _die_case(element: str, name: str, opposite: int) -> Case:
    return Case(
        "V17", f"die-{element}-{name}", die, {"element": element, "own": 12, "opposite": opposite}
    )


CASES = [_die_case("pw-T6", *of) for of in (("equal", 12), ("finer", 18), ("coarser", 6))]
CASES.append(_die_case("galerkin-T6", "equal", 12))
CASES += mark_costly([_die_case("galerkin-T6", *of) for of in (("finer", 18), ("coarser", 6))])
CASES += [
    Case("V17", f"turned-pw-T6-{degrees}", turned, {"element": "pw-T6", "degrees": degrees})
    for degrees in (90, 170)
]
CASES.append(Case("V17", "ironed-pw-T6", ironed, {"element": "pw-T6"}))
CASES.append(Case("V17", "rings-pw-T6", rings, {"element": "pw-T6"}))
CASES.append(Case("V17", "fit-pw-hybrid-T6", fit, {"element": "pw-hybrid-T6"}))
CASES += [
    Case("V17", f"calculix-pw-T6-{case}", against_calculix, stated)
    for case in DIES
    for stated in [{"element": "pw-T6", "case": case, "tracked": tracked_digest(case)}]
]

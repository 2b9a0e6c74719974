"""Generator of random problems of large strains and large sliding, each defined by a seed.

The tests check the library's accepted states for seeds 0 to 399. A rubber block of two to six cells
in depth lies under a rigid tool, or under another rubber body:

    circle    pressed and dragged, by translations or by a vertical force
    roller    a circle that rotates about its centre, by up to more than a turn per increment, or
              about another pivot
    plane     pressed on a whole side, straight or tilted, and dragged; it may rotate a little
    held      a plane on a block with supports along x at its sides or at the ends of its top; the
              supports may move
    bodies    a parabolic or flat die on a block that is wider or narrower, slid over its ends

Friction coefficients are between 0 and 1, weights are piecewise linear or standard, and the nodes
of the meshes are displaced at random.
"""

from dataclasses import dataclass, field
from functools import cached_property

from mpi4py import MPI

import basix
import numpy as np
from dolfinx import fem
from dolfinx import mesh as meshes

from pw_elements import Spaces
from pw_elements.contact import (
    ContactFailed,
    ContactPair,
    ContactProblem,
    Motion,
    Plane,
    Sphere,
)
from pw_elements.contact.model import ContactState
from tests.contact.cases import (
    list_states_and_substates,
    make_finite_strain_unknown_and_residual,
    neo_hookean_piola_stress,
    on_plane,
)
from tests.contact.sliding import SlidingBodies, make_die_on_block, yield_states_along_path
from tests.oracle.large import NeoHookeanBody
from tests.oracle.sliding import SlidingContact
from tests.oracle.tools import RigidTool, ToolContact, ToolState

PROBLEM_KIND_PROBABILITIES = {
    "circle": 0.25,
    "roller": 0.15,
    "plane": 0.25,
    "held": 0.15,
    "bodies": 0.2,
}
QUADRATURE_DEGREE = 4
TRIANGLE_QUADRATURE_RULE = basix.make_quadrature(basix.CellType.triangle, QUADRATURE_DEGREE)


@dataclass(frozen=True)
class PrescribedIncrementEnd:
    """Prescribed values at the end of one increment; motions are relative to initial positions."""

    across: float
    down: float | None  # translation; None if a force is prescribed
    force: float = 0.0  # upwards, from the tool on the body
    angle: float = 0.0
    support_displacement: float = 0.0  # horizontal displacement of the supports


@dataclass(frozen=True)
class SlidingSketch:
    """Numbers that define a random problem of large sliding.

    Lengths are divided by half the block's width, stresses by the shear modulus. Sketches of two
    bodies use only the friction coefficient, the steps, and the arguments of `make_die_on_block` in
    `die_options`.
    """

    seed: int
    kind: str
    friction: float
    steps: tuple[PrescribedIncrementEnd, ...]
    linear_weights: bool = True
    nu: float = 0.3
    height: float = 1.0
    divisions: tuple[int, int] = (6, 3)
    jiggle: float = 0.0
    radius: float = 0.0
    tilt: float = 0.0
    offset: float = 0.0
    gap: float = 0.0
    pivot: tuple[float, float] = (0.0, 0.0)
    support_kind: str = "base"  # or "sides" or "ends" of the top, besides the base
    die_options: dict = field(default_factory=dict)


def draw_sketch(seed: int) -> SlidingSketch:
    """Return the numbers that define the problem of a seed."""
    rng = np.random.default_rng([47, seed])
    kind = str(
        rng.choice(list(PROBLEM_KIND_PROBABILITIES), p=list(PROBLEM_KIND_PROBABILITIES.values()))
    )
    friction = 0.0 if rng.random() < 0.12 else float(rng.uniform(0.02, 1.0))
    if kind == "bodies":
        return _draw_two_body_sketch(seed, rng, friction)
    height = float(rng.uniform(0.4, 1.0))
    cells = rng.integers((4, 2), (10, 4))
    divisions = (int(cells[0]), int(cells[1]) if kind in ("plane", "held") else int(cells[1]) + 1)
    radius = float(rng.uniform(0.4, 1.5)) if kind in ("circle", "roller") else 0.0
    tilt = float(rng.uniform(-0.15, 0.15)) if kind == "plane" and rng.random() < 0.6 else 0.0
    offset = float(rng.uniform(-0.4, 0.4)) if radius else 0.0
    gap = float(rng.choice([0.0, rng.uniform(0.0, 0.02)]))
    supports_move = kind == "held" and rng.random() < 0.5
    tool_rotates = kind == "roller" or (kind == "plane" and rng.random() < 0.3)
    centred = bool(rng.random() < 0.6)
    pivot = (offset, radius + gap) if centred else tuple(rng.uniform(0.0, 0.8, 2).tolist())
    largest_turn = 0.05 if kind == "plane" else 0.6
    if kind == "roller" and centred:
        largest_turn = 7.0 if rng.random() < 0.2 else 1.2
    by_force = rng.random() < 0.2 and kind != "held"
    size = min(height, radius or height)
    translation = angle = support_displacement = 0.0
    depth = float(rng.uniform(0.02, 0.25)) * size
    steps = []
    for k in range(rng.integers(2, 6)):
        if k > 0 and rng.random() < 0.4:
            depth = float(rng.uniform(0.02, 0.25)) * size
        if k > 0 or rng.random() < 0.3:
            translation += float(rng.uniform(-0.5, 0.5)) * (radius or 0.7)
            angle += float(rng.uniform(-1, 1)) * largest_turn if tool_rotates else 0.0
            support_displacement += float(rng.uniform(-0.2, 0.2)) if supports_move else 0.0
        force_acts = by_force and k > 0
        # the centre of the circle moves across and down for any pivot
        arm = np.array([offset, radius + gap]) - pivot if radius else np.zeros(2)
        lift = arm - [
            np.cos(angle) * arm[0] - np.sin(angle) * arm[1],
            np.sin(angle) * arm[0] + np.cos(angle) * arm[1],
        ]
        circle_motion = np.array([translation, -depth]) + lift
        vertical = None if force_acts else float(circle_motion[1])
        steps.append(
            PrescribedIncrementEnd(
                float(circle_motion[0]),
                vertical,
                -2.0 * depth * force_acts,
                angle,
                support_displacement,
            )
        )
    return SlidingSketch(
        seed,
        kind,
        friction,
        tuple(steps),
        linear_weights=bool(rng.random() < 0.7),
        nu=float(rng.uniform(0.0, 0.45)),
        height=height,
        divisions=divisions,
        jiggle=float(rng.uniform(0.0, 0.15)),
        radius=radius,
        tilt=tilt,
        offset=offset,
        gap=gap,
        pivot=pivot,
        support_kind=str(rng.choice(["sides", "ends"])) if kind == "held" else "base",
    )


def _draw_two_body_sketch(seed: int, rng: np.random.Generator, friction: float) -> SlidingSketch:
    """Return the numbers that define a problem of two bodies."""
    translation, steps = 0.0, []
    for k in range(rng.integers(2, 5)):
        if k == 0 or rng.random() < 0.4:
            depth = float(rng.uniform(0.02, 0.15))
        if k > 0 or rng.random() < 0.3:
            translation += float(rng.uniform(-0.4, 0.4))
        steps.append(PrescribedIncrementEnd(translation, -depth))
    options = {
        "upper_is_slave": bool(rng.random() < 0.5),
        "curvature": 0.0 if rng.random() < 0.3 else float(rng.uniform(0.3, 1.8)),
        "half_width": float(rng.uniform(0.55, 1.5)),
        "divisions": ((int(rng.integers(6, 13)), 3), (int(rng.integers(4, 9)), 3)),
        "rotation_degrees": float(rng.choice([0.0, rng.uniform(-60, 60)])),
    }
    return SlidingSketch(seed, "bodies", friction, tuple(steps), die_options=options)


class RigidToolProblem:
    """A block and a rigid tool, solved by the library and checked by the oracle (`tools`)."""

    def __init__(self, sketch: SlidingSketch) -> None:
        self.sketch = sketch

    @cached_property
    def accepted_states_and_error(self) -> tuple[list[ContactState], ContactFailed | None]:
        """Return the undeformed and all accepted states, and the final error or None."""
        sketch, mesh = self.sketch, self._make_mesh()
        spaces = (Spaces.petrov_galerkin if sketch.linear_weights else Spaces.galerkin)(mesh)
        lame = fem.Constant(mesh, 2 * sketch.nu / (1 - 2 * sketch.nu))
        u, residual = make_finite_strain_unknown_and_residual(
            spaces, lambda F: neo_hookean_piola_stress(F, lame_lambda=lame), QUADRATURE_DEGREE
        )
        self.nodes = spaces.trial.tabulate_dof_coordinates()[:, :2]
        self.cells = spaces.trial.dofmap.list
        self.prescribed_mask = self._make_prescribed_mask()
        self.contact_nodes = np.flatnonzero(np.isclose(self.nodes[:, 1], 0.0))
        support_value = fem.Constant(mesh, 0.0)
        conditions = []
        for axis, value in enumerate((support_value, fem.Constant(mesh, 0.0))):
            space = spaces.trial.sub(axis)
            dofs = (2 * np.flatnonzero(self.prescribed_mask[:, axis]) + axis).astype(np.int32)
            conditions.append(fem.dirichletbc(value, dofs, space))
        pair = ContactPair(
            on_plane(1, 0.0), self._make_surface(), sketch.friction, pivot=sketch.pivot
        )
        problem = ContactProblem.of_residual(residual, u, conditions, pair)
        states, previous_displacement = [problem.undeformed], 0.0
        for step in sketch.steps:

            def set_support_displacement(
                load_factor: float, ends=(previous_displacement, step.support_displacement)
            ) -> None:
                support_value.value = (1 - load_factor) * ends[0] + load_factor * ends[1]

            motion = Motion((step.across, step.down), (0.0, step.force), step.angle)
            try:
                states.append(problem.step(states[-1], set_support_displacement, motion))
            except ContactFailed as error:
                return states, error
            previous_displacement = step.support_displacement
        return states, None

    def violations_per_accepted_state(self) -> list[dict[str, float]]:
        """Return the violations of the law in each accepted state and substate."""
        states, _ = self.accepted_states_and_error
        sketch, results, previous_displacement = self.sketch, [], 0.0
        body = NeoHookeanBody(
            self.nodes,
            self.cells,
            sketch.linear_weights,
            2 * sketch.nu / (1 - 2 * sketch.nu),
            TRIANGLE_QUADRATURE_RULE,
        )
        contact, history = (
            ToolContact(body, self.tool, self.contact_nodes, self.prescribed_mask),
            [self.tool_state(states[0])],
        )
        for step, start, end in zip(sketch.steps, states, states[1:], strict=False):
            for fraction, substate in (*end.substates, (1.0, end)):
                history.append(self.tool_state(substate))
                prescribed = np.zeros_like(self.nodes)
                prescribed[:, 0] = (
                    1 - fraction
                ) * previous_displacement + fraction * step.support_displacement
                violations = contact.largest_violations_in_last_increment(history, prescribed)
                results.append(
                    violations
                    | {
                        "drive": self._prescribed_motion_error(
                            body, start, substate, fraction, step
                        )
                    }
                )
            previous_displacement = step.support_displacement
        return results

    @property
    def tool(self) -> RigidTool:
        """Return the tool at its initial position."""
        sketch = self.sketch
        normal = np.array([np.sin(sketch.tilt), -np.cos(sketch.tilt)])
        if sketch.radius:
            centre = np.array([sketch.offset, sketch.radius + sketch.gap])
            return RigidTool(centre, normal, sketch.friction, sketch.radius, np.array(sketch.pivot))
        # the plane touches this corner first, or lies above it by the gap
        corner = np.array([-np.sign(sketch.tilt), sketch.gap])
        return RigidTool(corner, normal, sketch.friction, pivot=np.array(sketch.pivot))

    def _make_surface(self) -> Plane | Sphere:
        tool = self.tool
        return Sphere(tool.point, tool.radius) if tool.radius else Plane(tool.point, tool.normal)

    def _make_mesh(self) -> meshes.Mesh:
        sketch = self.sketch
        low, high = np.array([-1.0, -sketch.height]), np.array([1.0, 0.0])
        mesh = meshes.create_rectangle(
            MPI.COMM_SELF, [low, high], sketch.divisions, meshes.CellType.triangle
        )
        x, rng = mesh.geometry.x, np.random.default_rng(sketch.seed)
        for axis in range(2):
            is_inner = ~np.isclose(x[:, axis], low[axis]) & ~np.isclose(x[:, axis], high[axis])
            cell = (high[axis] - low[axis]) / sketch.divisions[axis]
            x[:, axis] += np.where(is_inner, sketch.jiggle * cell * rng.uniform(-1, 1, len(x)), 0.0)
        return mesh

    def _make_prescribed_mask(self) -> np.ndarray:
        """Return the mask (n, 2) of prescribed displacements."""
        x, y = self.nodes.T
        mask = np.tile(np.isclose(y, -self.sketch.height)[:, None], (1, 2))
        sides = np.isclose(np.abs(x), 1.0)
        if self.sketch.support_kind == "sides":
            mask[:, 0] |= sides
        elif self.sketch.support_kind == "ends":
            mask[:, 0] |= (np.abs(x) > 0.6) & np.isclose(y, 0.0)
        return mask

    def tool_state(self, state: ContactState) -> ToolState:
        """Return the displacements, the tool's motion and the tool's nodal forces in a state."""
        (pair,) = state.pairs
        force = np.zeros_like(self.nodes)
        force[pair.node] = pair.force_vector
        u = state.displacement.array_r.reshape(-1, 2).copy()
        return ToolState(u, pair.translation, float(pair.rotation), force)

    def _prescribed_motion_error(self, body, start, substate, fraction, prescribed_end) -> float:
        """Return the largest relative error of the tool's prescribed translation, angle or force.

        Within an increment, prescribed values are linear in the load factor `fraction`.
        """
        (start_pair,), (pair,) = start.pairs, substate.pairs
        length = max(np.abs(pair.translation).max(), 1e-3)

        def error(value: float, begin: float, end: float) -> float:
            return abs(value - begin - fraction * (end - begin))

        errors = [
            error(pair.translation[0], start_pair.translation[0], prescribed_end.across) / length,
            error(float(pair.rotation), float(start_pair.rotation), prescribed_end.angle),
        ]
        if prescribed_end.down is not None:
            errors.append(
                error(pair.translation[1], start_pair.translation[1], prescribed_end.down) / length
            )
        else:
            r = body.nodal_forces(substate.displacement.array_r.reshape(-1, 2))
            total_force = r[self.contact_nodes, 1].sum()
            errors.append(
                error(total_force, start_pair.force[1], prescribed_end.force) / np.abs(r).max()
            )
        return float(max(errors))


class TwoBodyProblem:
    """Two rubber bodies, solved by the library and checked by the oracle (`sliding`)."""

    def __init__(self, sketch: SlidingSketch) -> None:
        self.sketch = sketch

    @cached_property
    def accepted_states_and_error(self) -> tuple[list[ContactState], ContactFailed | None]:
        """Return the undeformed and all accepted states, and the final error or None."""
        self.bodies = make_die_on_block(friction=self.sketch.friction, **self.sketch.die_options)
        states = [self.bodies.problem.undeformed]
        try:
            for state in yield_states_along_path(
                self.bodies, [(s.across, s.down) for s in self.sketch.steps]
            ):
                states.append(state)
        except ContactFailed as error:
            return states, error
        return states, None

    def violations_per_accepted_state(self) -> list[dict[str, float]]:
        """Return the violations of the law in each accepted state and substate."""
        states, _ = self.accepted_states_and_error
        problem = make_oracle_contact(self.bodies)
        history = [
            accepted.displacement.array_r.reshape(-1, 2).copy()
            for accepted in list_states_and_substates(states)
        ]
        return [
            problem.largest_violations_in_last_increment(history[:k])
            for k in range(2, len(history) + 1)
        ]


def make_oracle_contact(bodies: SlidingBodies) -> SlidingContact:
    """Return the oracle's model of the contact between two bodies."""
    nodes = bodies.space.tabulate_dof_coordinates()[:, :2]
    body = NeoHookeanBody(nodes, bodies.space.dofmap.list, True, 1.5, TRIANGLE_QUADRATURE_RULE)
    (pair,) = bodies.problem.undeformed.pairs
    sides = [side[np.argsort(nodes[side, 0])] for side in (pair.node, pair.opposite_node)]
    below = int(nodes[sides[1], 1].mean() < nodes[sides[0], 1].mean())
    sides[below] = sides[below][::-1]  # the outside of the lower body is above it
    mask = np.zeros_like(nodes, dtype=bool)
    for condition in bodies.conditions:
        mask.ravel()[condition.dof_indices()[0]] = True
    return SlidingContact(body, *sides, mask, bodies.pair.law.mu)


def make_problem(seed: int) -> RigidToolProblem | TwoBodyProblem:
    """Return the problem of a seed, with a tool or with two bodies."""
    sketch = draw_sketch(seed)
    return TwoBodyProblem(sketch) if sketch.kind == "bodies" else RigidToolProblem(sketch)

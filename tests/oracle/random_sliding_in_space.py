"""Generator of random problems of two bodies in space that slide, each defined by a seed.

A block of rubber with two or four facets on its top lies under another block, or under a
tetrahedron that stands on one of its facets. Sizes, meshes, positions and friction are random. The
upper body is turned about the vertical and tilted a little, and both bodies are turned together by
a random rotation. The base is fixed and the upper body's top is pressed down, slid and twisted. In
half of the problems, base and top also rotate together during the increments.
"""

from dataclasses import dataclass
from functools import cached_property

from mpi4py import MPI

import basix
import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_mesh
from scipy.spatial.transform import Rotation

from pw_elements import Spaces
from pw_elements.contact import ContactFailed, ContactPair, ContactProblem, DeformableSurface
from pw_elements.contact.model import ContactState
from tests.contact.cases import (
    list_states_and_substates,
    make_finite_strain_unknown_and_residual,
)
from tests.contact.two_bodies import join_meshes
from tests.oracle.sliding_in_space import NeoHookeanBodyInSpace, SlidingContactInSpace

QUADRATURE_DEGREE = 2
TETRAHEDRON_QUADRATURE_RULE = basix.make_quadrature(basix.CellType.tetrahedron, QUADRATURE_DEGREE)
LOWER_HEIGHT = 0.5


@dataclass(frozen=True)
class TopMotion:
    """Motion of the upper body's top at the end of an increment, before the common rotation."""

    translation: tuple[float, float, float]
    twist: float  # about the vertical, in radians
    common_rotation: tuple[float, float, float]  # vector of the rotation of base and top


@dataclass(frozen=True)
class SpaceSlidingSketch:
    """Numbers that define a random problem; stresses are divided by the shear modulus."""

    seed: int
    friction: float
    upper_is_slave: bool
    is_tetrahedron: bool  # whether the upper body is a single tetrahedron
    lower_size: tuple[float, float]
    lower_divisions: tuple[int, int]
    upper_size: tuple[float, float, float]
    upper_divisions: tuple[int, int]
    offset: tuple[float, float]
    turn: tuple[float, float, float]  # vector of the rotation of the upper body
    frame: tuple[float, float, float]  # vector of the rotation of both bodies
    gap: float
    steps: tuple[TopMotion, ...]


def draw_sketch(seed: int) -> SpaceSlidingSketch:
    """Return the numbers that define the problem of a seed."""
    rng = np.random.default_rng([53, seed])

    def draw(low: float, high: float, count: int) -> tuple[float, ...]:
        return tuple(rng.uniform(low, high, count).tolist())

    divisions = ((1, 1), (2, 1), (1, 2))
    depth, slide, twist, rotates = 0.0, np.zeros(2), 0.0, rng.random() < 0.5
    common, steps = np.zeros(3), []
    for k in range(rng.integers(2, 4)):
        if k == 0 or rng.random() < 0.4:
            depth = float(rng.uniform(0.02, 0.07))
        if k > 0 or rng.random() < 0.3:
            slide = slide + rng.uniform(-0.2, 0.2, 2)
            twist += float(rng.uniform(-0.15, 0.15))
            common = common + rotates * rng.uniform(-0.25, 0.25, 3)
        steps.append(TopMotion((*slide.tolist(), -depth), twist, tuple(common.tolist())))
    return SpaceSlidingSketch(
        seed,
        0.0 if rng.random() < 0.12 else float(rng.uniform(0.02, 1.0)),
        bool(rng.random() < 0.6),
        bool(rng.random() < 0.3),
        draw(0.8, 1.5, 2),
        divisions[rng.integers(3)],
        draw(0.4, 0.8, 3),
        divisions[rng.integers(3)],
        draw(-0.3, 0.3, 2),
        (*draw(-0.04, 0.04, 2), *draw(-3.0, 3.0, 1)),
        draw(-2.0, 2.0, 3),
        float(rng.uniform(0.0, 0.01)),
        tuple(steps),
    )


class SpaceSlidingProblem:
    """Two rubber bodies, solved by the library and checked by the oracle (`sliding_in_space`)."""

    def __init__(self, sketch: SpaceSlidingSketch) -> None:
        self.sketch = sketch
        self.frame = Rotation.from_rotvec(sketch.frame).as_matrix()
        lower, upper, bottom, height = self._make_meshes()
        lower_x, upper_x = lower.geometry.x, upper.geometry.x
        turn = Rotation.from_rotvec(sketch.turn).as_matrix()
        upper_x[:] = upper_x @ turn.T + [*sketch.offset, 0.0]
        # the lowest corner is above the lower body by the gap
        rise = sketch.gap + 1e-3 - upper_x[bottom, 2].min()
        upper_x[:, 2] += rise
        for x in (lower_x, upper_x):
            x[:] = x @ self.frame.T
        mesh = join_meshes(lower, upper)
        self.space = (spaces := Spaces.petrov_galerkin(mesh)).trial
        self.nodes = self.space.tabulate_dof_coordinates()
        unturned = self.nodes @ self.frame
        is_upper = np.zeros(len(self.nodes), dtype=bool)
        cells_x = unturned[self.space.dofmap.list]
        is_upper[self.space.dofmap.list[cells_x.mean(axis=1)[:, 2] > 0]] = True
        self.is_upper = is_upper
        local = (unturned - [*sketch.offset, rise]) @ turn  # in the frame of the upper body
        self._bottom_marker = lambda x: np.isclose(
            ((x.T @ self.frame - [*sketch.offset, rise]) @ turn)[:, 2], 0.0
        )
        self._top_marker = lambda x: np.isclose((x.T @ self.frame)[:, 2], 0.0)
        share = 0.49 if sketch.is_tetrahedron else 1 - 1e-9
        self.top = is_upper & (local[:, 2] > share * height)
        self.base = ~is_upper & np.isclose(unturned[:, 2], -LOWER_HEIGHT)
        self.displacement = fem.Function(self.space)
        self.conditions = [
            fem.dirichletbc(self.displacement, np.flatnonzero(mask).astype(np.int32))
            for mask in (self.base, self.top)
        ]
        u, residual = make_finite_strain_unknown_and_residual(
            spaces, quadrature_degree=QUADRATURE_DEGREE
        )
        sides = self._bottom_marker, self._top_marker
        slave, master = sides if sketch.upper_is_slave else sides[::-1]
        pair = ContactPair(slave, DeformableSurface(master), friction=sketch.friction)
        self.problem = ContactProblem.of_residual(residual, u, self.conditions, pair)

    def _make_meshes(self):
        """Return meshes of both bodies, numbers of the upper's lowest nodes, and its height.

        The lower side of the upper mesh is at z = 0.
        """
        sketch = self.sketch
        half = np.array(sketch.lower_size) / 2
        lower = create_box(
            MPI.COMM_SELF,
            [[*-half, -LOWER_HEIGHT], [*half, 0.0]],
            (*sketch.lower_divisions, 1),
            CellType.tetrahedron,
        )
        width, depth, height = sketch.upper_size
        if not sketch.is_tetrahedron:
            low, high = [-width / 2, -depth / 2, 0.0], [width / 2, depth / 2, height]
            divisions = (*sketch.upper_divisions, 1)
            upper = create_box(MPI.COMM_SELF, [low, high], divisions, CellType.tetrahedron)
        else:
            x = [[-width / 2, -depth / 2, 0.0], [width / 2, -depth / 2, 0.0]]
            x += [[0.0, depth / 2, 0.0], [0.0, 0.0, height]]
            upper = create_mesh(
                MPI.COMM_SELF,
                cells=np.array([[0, 1, 2, 3]], dtype=np.int64),
                x=np.array(x),
                e=lower.ufl_domain().ufl_coordinate_element(),
            )
        return lower, upper, np.isclose(upper.geometry.x[:, 2], 0.0), height

    def prescribe_motion(self, start: TopMotion, end: TopMotion, load_factor: float) -> None:
        """Prescribe the displacements of base and top between the ends of an increment."""
        translation, (twist,), common = (
            (1 - load_factor) * np.atleast_1d(a) + load_factor * np.atleast_1d(b)
            for a, b in zip(vars(start).values(), vars(end).values(), strict=True)
        )
        x = self.nodes @ self.frame
        centre = [*self.sketch.offset, 0.0]
        twisted = (x - centre) @ Rotation.from_rotvec([0.0, 0.0, twist]).as_matrix().T
        end_x = np.where(self.top[:, None], twisted + centre + translation, x)
        rotation = Rotation.from_rotvec(common).as_matrix()
        moved = (end_x @ rotation.T @ self.frame.T - self.nodes) * (self.top | self.base)[:, None]
        self.displacement.x.array[:] = moved.ravel()

    @cached_property
    def accepted_states_and_error(self) -> tuple[list[ContactState], ContactFailed | None]:
        """Return the undeformed and all accepted states, and the final error or None."""
        states = [self.problem.undeformed]
        start = TopMotion((0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0))
        for end in self.sketch.steps:

            def load(load_factor: float, start=start, end=end) -> None:
                self.prescribe_motion(start, end, load_factor)

            try:
                states.append(self.problem.step(states[-1], load))
            except ContactFailed as error:
                return states, error
            start = end
        return states, None

    @property
    def upward_direction_at_end(self) -> np.ndarray:
        """Return the normal (3,) of the lower body's top after the last common rotation."""
        common = Rotation.from_rotvec(self.sketch.steps[-1].common_rotation).as_matrix()
        return self.frame @ common[:, 2]

    @property
    def displacement_history(self) -> list[np.ndarray]:
        """Return the displacements (n, 3) of all states and substates."""
        states, _ = self.accepted_states_and_error
        return [
            state.displacement.array_r.reshape(-1, 3).copy()
            for state in list_states_and_substates(states)
        ]

    @cached_property
    def oracle_contact(self) -> SlidingContactInSpace:
        """Return the oracle's model of the contact."""
        cells = self.space.dofmap.list
        body = NeoHookeanBodyInSpace(self.nodes, cells, 1.5, TETRAHEDRON_QUADRATURE_RULE)
        marks = [marker(self.nodes.T) for marker in (self._bottom_marker, self._top_marker)]
        sides = [
            _list_outward_sub_triangles(self.nodes, cells, mark & (self.is_upper == on_upper))
            for mark, on_upper in zip(marks, (True, False), strict=True)
        ]
        (slave, slave_facets), (master, master_facets) = (
            sides if self.sketch.upper_is_slave else sides[::-1]
        )
        mask = np.tile((self.base | self.top)[:, None], (1, 3))
        return SlidingContactInSpace(
            body, slave, master, slave_facets, master_facets, mask, self.sketch.friction
        )

    def violations_per_accepted_state(self) -> list[dict[str, float]]:
        """Return the violations of the law in each accepted state and substate."""
        history = self.displacement_history
        return [
            self.oracle_contact.largest_violations_in_last_increment(history[:k])
            for k in range(2, len(history) + 1)
        ]


# nodes of the facets of a tetrahedron in Basix's order, and of a facet's sub-triangles
_FACETS = ((1, 2, 3, 4, 5, 6), (0, 2, 3, 4, 7, 8), (0, 1, 3, 5, 7, 9), (0, 1, 2, 6, 8, 9))
_SUB_TRIANGLES = ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5))


def _list_outward_sub_triangles(x, cells, on_side) -> tuple[np.ndarray, np.ndarray]:
    """Return sub-triangles (f, 3), anticlockwise from outside, and the facet (f, 6) of each."""
    triangles, facets = [], []
    for cell in cells:
        for facet in _FACETS:
            nodes = cell[list(facet)]
            if on_side[nodes].all():
                for triangle in _SUB_TRIANGLES:
                    a, b, c = nodes[list(triangle)]
                    outside = np.cross(x[b] - x[a], x[c] - x[a]) @ (x[a] - x[cell].mean(axis=0))
                    triangles.append((a, b, c) if outside > 0 else (a, c, b))
                    facets.append(nodes)
    return np.array(triangles), np.array(facets)


def make_problem(seed: int) -> SpaceSlidingProblem:
    """Return the problem of a seed."""
    return SpaceSlidingProblem(draw_sketch(seed))

"""Random contact problems: bodies pressed on planes, and punches pressed into bodies.

Everything is of size one in a body at home, with a modulus of one, and may be placed elsewhere.
"""

from dataclasses import dataclass, field

import numpy as np
from hypothesis import strategies as st

from pw_elements import Material, Reduction, assemble_vector, boundary_measure, prescribe
from pw_elements.contact import (
    ContactPair,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    Sphere,
    solve_contact,
)
from tests.library.properties import METHODS, Elastic
from tests.library.random_meshes import SEEDS, Grid, Placement, grids

CELLS = {
    "plane stress": ("triangle", "quadrilateral"),
    "plane strain": ("triangle", "quadrilateral"),
    "axisymmetric": ("triangle", "quadrilateral"),
    "solid": ("tetrahedron", "hexahedron"),
}
SIZES = {2: (2.0, 1.0), 3: (1.0, 1.0, 0.7)}
INNER = 1.0  # radius of the bore in axisymmetry


@dataclass(frozen=True)
class Problem:
    """One problem; `at` tells where and of what it is built.

    Args:
        grid: at home.
        method: of the element.
        state: of the body.
        poisson: its ratio.
        kind: "block" on a plane, free or held at a side, or "punch" into a clamped block.
        surface: of the punch.
        friction: Coulomb's mu.
        held: of a block, whether its side is clamped; of a punch, whether its motion is given
            and not its force.
        press: traction, depth or force of the first increment.
        push: the tangential one (dim - 1,) of the second, over the normal one.
        middle: where the punch touches first (dim - 1,).
        roundness: of the punch, radius or half width.
        tilt: of a plane punch.
        far: from the block to the plane, if it is held.
    """

    grid: Grid
    method: str
    state: str
    poisson: float
    kind: str
    surface: str
    friction: float
    held: bool
    press: float
    push: np.ndarray
    middle: np.ndarray
    roundness: float
    tilt: float
    far: float

    @property
    def dim(self):
        return self.grid.dim

    @property
    def height(self):
        return SIZES[self.dim][-1]

    @property
    def first(self):
        """Least first coordinate."""
        return INNER if self.state == "axisymmetric" else 0.0

    def at(self, place=None, modulus=1.0, grid=None):
        place = place or Placement(1.0, np.eye(self.dim), np.zeros(self.dim))
        material = Material(modulus, self.poisson)
        elastic = Elastic(grid or self.grid, place, self.method, self.state, material)
        return Stated(self, elastic, modulus)


@dataclass(frozen=True)
class Stated:
    """A problem in the library's terms."""

    problem: Problem
    elastic: Elastic
    modulus: float
    pair: ContactPair = field(init=False)
    loads: list = field(init=False)
    reduction: Reduction = field(init=False)

    def __post_init__(self):
        p, block = self.problem, self.problem.kind == "block"
        for name, value in (
            ("pair", self._block() if block else self._punch()),
            ("loads", self._loads() if block else [self.elastic.K.createVecLeft()] * 2),
            ("reduction", self._supports(p.held if block else True)),
        ):
            object.__setattr__(self, name, value)

    def solve(self):
        e = self.elastic
        return solve_contact(e.K, self.loads, self.reduction, [self.pair], e.space)

    # -- how it is stated ------------------------------------------------------------------------

    @property
    def place(self):
        return self.elastic.placement

    def _supports(self, clamped):
        if not clamped:
            return Reduction.dirichlet(self.elastic.space, [])
        p = self.problem
        side = (0, p.first) if p.kind == "block" else (p.dim - 1, 0.0)
        marker = self.place.side(*side)
        held = [prescribe(self.elastic.space, i, marker) for i in range(p.dim)]
        return Reduction.dirichlet(self.elastic.space, held)

    def _block(self):
        p, point, up = self.problem, np.zeros(self.problem.dim), np.eye(self.problem.dim)[-1]
        below, beside = self.place.side(p.dim - 1, 0.0), self.place.side(0, p.first)
        nodes = (lambda x: below(x) & ~beside(x)) if p.held else below
        gap = p.far if p.held else 0.0
        plane = Plane(self.place.point(point - gap * up), self.place.vector(up))
        return ContactPair(nodes, plane, p.friction)

    def _loads(self):
        """Pressed, then pushed, too."""
        p, e = self.problem, self.elastic
        top = boundary_measure(e.body.spaces.mesh, self.place.side(p.dim - 1, p.height))
        vectors = []
        for push in (0.0 * p.push, p.push):
            traction = self.modulus * p.press * np.append(push, -1.0)
            vectors.append(assemble_vector(e.body.surface_load(self.place.vector(traction), top)))
        return vectors

    def _punch(self):
        p, place = self.problem, self.place
        down = -np.eye(p.dim)[-1]
        touch = np.append(p.middle, p.height)
        if p.surface == "plane":
            down[0] = p.tilt
            touch[0] = p.first + (p.tilt < 0) * SIZES[p.dim][0]  # the corner it meets first
            surface = Plane(place.point(touch), place.vector(down))
        elif p.surface == "flat":
            half = p.roundness / 4 * place.unit
            surface = FlatPunch(place.point(touch), place.vector(down), half)
        elif p.surface == "parabola":
            surface = Parabola(place.point(touch), p.roundness * place.unit)
        else:
            touch[-1] += p.roundness
            surface = Sphere(place.point(touch), p.roundness * place.unit)
        motions = [self._motion(0.0 * p.push), self._motion(p.push)]
        marker = place.side(p.dim - 1, p.height)
        return ContactPair(marker, surface, p.friction, motions)

    def _motion(self, push):
        p, unit = self.problem, self.place.unit
        way = p.press * np.append(push, -1.0)
        if p.held:
            return Motion(tuple(unit * self.place.vector(way)))
        force = np.append(0.0 * push, -p.press) * self.modulus * unit ** (p.dim - 1)
        if p.state == "axisymmetric":
            force = force * 2 * np.pi * unit
        # turned by right angles only, so that each axis stays one
        turn = self.place.matrix
        translation = [
            None if np.argmax(np.abs(row)) == p.dim - 1 else unit * float(row[:-1] @ way[:-1])
            for row in turn
        ]
        return Motion(translation, tuple(turn @ force))


@st.composite
def problems(draw, states=tuple(CELLS)):
    state, kind = draw(st.sampled_from(states)), draw(st.sampled_from(("block", "punch")))
    dim = 3 if state == "solid" else 2
    grid = draw(grids(CELLS[state], SIZES[dim], {2: 4, 3: 2}[dim]))
    if state == "axisymmetric":
        grid = grid.moved(lambda x: x + np.array([INNER, 0.0]))
    rng = np.random.default_rng(draw(SEEDS))
    push = rng.uniform(-1, 1, dim - 1) / np.sqrt(dim - 1)
    if state == "axisymmetric" and kind == "punch":
        push = 0 * push  # a rigid ring does not widen
    middle = rng.uniform(0.25, 0.75, dim - 1) * SIZES[dim][:-1]
    middle[0] += grid.x[:, 0].min()
    return Problem(
        grid,
        draw(st.sampled_from(list(METHODS))),
        state,
        draw(st.sampled_from((0.0, 0.2, 0.3, 0.45))),
        kind,
        draw(st.sampled_from(("plane", "flat", "sphere", "parabola"))),
        draw(st.integers(0, 15)) / 10,
        draw(st.booleans()),
        rng.uniform(0.005, 0.05),
        push,
        middle,
        rng.uniform(1.0, 4.0),
        rng.uniform(-0.05, 0.05),
        rng.uniform(0.0, 0.01),
    )

"""Random contact problems: bodies pressed on planes, and punches pressed into bodies.

Everything is of size one in a body at home, with a modulus of one, and may be placed elsewhere.
"""

from dataclasses import dataclass, field

import numpy as np
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.spatial import cKDTree

from pw_elements import Material, Reduction, assemble_vector, boundary_measure, support
from pw_elements.contact import (
    OPEN,
    STICK,
    ContactPair,
    ContactState,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    Sphere,
    solve_contact,
)
from tests.properties import METHODS, Elastic, dense, terms
from tests.random_meshes import EPS, SEEDS, Grid, Placement, grids

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
        held = [support(self.elastic.space, i, marker) for i in range(p.dim)]
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


@dataclass(frozen=True)
class Solved:
    """One increment, as the test reads it: from K a - f and the surface, at the contact nodes."""

    stated: Stated
    increment: int
    state: ContactState
    before: "Solved | None"

    def __post_init__(self):
        e, pair = self.stated.elastic, self.state.pairs[0]
        dim = e.grid.dim
        a = self.state.displacement.array.reshape(-1, dim)
        f = self.stated.loads[self.increment].array.reshape(-1, dim)
        node = cKDTree(e.x).query(pair.position)[1]
        x = e.x[node] - pair.translation
        normal = self.stated.pair.surface.normal(x)
        K = dense(e.K)
        r = (K @ a.ravel()).reshape(-1, dim) - f
        relative = a[node] - pair.translation
        slip = relative - (self.before.relative if self.before else 0.0)
        slip = slip - normal * np.sum(normal * slip, axis=1)[:, None]
        r_n = np.sum(normal * r[node], axis=1)
        for name, value in {
            "K": K,
            "a": a,
            "f": f,
            "r": r,
            "node": node,
            "normal": normal,
            "relative": relative,
            "slip": slip,
            "gap": self.stated.pair.surface.gap(x) + np.sum(normal * a[node], axis=1),
            "r_n": r_n,
            "r_t": r[node] - r_n[:, None] * normal,
            "stiffness": np.diag(K).reshape(-1, dim)[node].mean(axis=1),
        }.items():
            object.__setattr__(self, name, value)

    def lost(self):
        """Force (n,) at contact nodes that is nothing but round-off, of forces and of gaps."""
        e = self.stated.elastic
        sums = len(self.K) * e.round_off * (np.abs(self.K) @ np.abs(self.a.ravel())).max()
        return sums + self.stiffness * 8 * EPS * np.abs(e.x).max()

    def violation(self):
        """What is left (n,) of the equations of contact: forces, zero for the exact solution.

        r_n = max(0, p) with p = r_n - c g; r_t is the nearest to r_t - c v of at most mu max(0, p).
        """
        pressing = np.maximum(0.0, self.r_n - self.stiffness * self.gap)
        shearing = self.r_t - self.stiffness[:, None] * self.slip
        size = np.linalg.norm(shearing, axis=1)
        limit = self.stated.problem.friction * pressing
        shrink = np.where(size > limit, limit / np.where(size > limit, size, 1.0), 1.0)
        tangential = np.linalg.norm(self.r_t - shrink[:, None] * shearing, axis=1)
        return np.abs(self.r_n - pressing) + tangential

    def errors(self):
        """Bounds of the errors of displacements (n dim) and nodal forces, to first order.

        Round-off of data moves every equation a little: equilibrium by d(|K||a| + |f|), closed
        gaps by the rounding of coordinates, slips by the error of the increment before; and
        where directions turn the iteration ends before the law is met to the last digit. The
        inverse of the tangent carries that to the solution.
        """
        e, dim = self.stated.elastic, self.stated.elastic.grid.dim
        right = dense(self.stated.reduction.right)
        d, size = terms(self.K) * e.round_off, np.abs(self.K)
        unbalanced = d * (size @ np.abs(self.a.ravel()) + np.abs(self.f.ravel()))
        rounded = 8 * EPS * np.abs(e.x).max() + d * np.abs(self.a).max()
        earlier = self.before.errors()[0] if self.before else np.zeros(len(self.K))

        left, violation = np.zeros(len(self.K)), self.violation()
        E, C, moving = np.eye(len(self.K)), np.zeros(self.K.shape), self._free()
        for k, node in enumerate(self.node):
            dofs = node * dim + np.arange(dim)
            own_E, own_C = self._law(k, right[dofs].any(axis=1))
            E[np.ix_(dofs, dofs)], C[np.ix_(dofs, dofs)] = own_E, own_C
            left[dofs] = violation[k]
        shift = np.zeros((len(self.K), len(moving)))
        for column, axis in enumerate(moving):
            shift[self.node * dim + axis, column] = 1.0
        A = np.block(
            [
                [right.T @ (E @ self.K + C) @ right, -right.T @ C @ shift],
                [shift.T @ self.K @ right, np.zeros((len(moving),) * 2)],
            ]
        )
        slipped = rounded + earlier
        wrong = np.concatenate(
            [
                right.T @ (np.abs(E) @ unbalanced + np.abs(C) @ slipped + left),
                shift.T @ unbalanced,
            ]
        )
        moved = np.abs(right) @ (np.abs(np.linalg.inv(A)) @ wrong)[: right.shape[1]]
        return moved, size @ moved + unbalanced

    def _free(self):
        """Axes along which the surface is free to move."""
        motions = self.stated.pair.motions
        translation = motions[self.increment].translation if motions else ()
        return [axis for axis, way in enumerate(translation) if way is None]

    def _law(self, k, free):
        """E and C (dim, dim) of E r + C (a - U) = 0 at a contact node, in its rows."""
        dim, status, normal = len(free), self.state.pairs[0].status[k], self.normal[k]
        one, c = np.eye(dim), self.stiffness[k]
        if status == OPEN:
            return one, 0 * one
        blocked = np.vstack([normal, one[~free]])
        tangents = null_space(blocked).T
        rows_E, rows_C = [0 * normal], [c * normal]
        s = self.r_t[k] - c * self.slip[k]
        length, mu = np.linalg.norm(s), self.stated.problem.friction
        for t in tangents:
            if status == STICK or not length:
                sliding = status != STICK  # without friction nothing else is said of it
                rows_E.append(t if sliding else 0 * t)
                rows_C.append(0 * t if sliding else c * t)
            else:
                along = s / length
                turning = mu * self.r_n[k] / length
                M_t = turning * (t - along * (along @ t))
                rows_E.append(t - M_t - mu * (along @ t) * normal)
                rows_C.append(c * M_t)
        # prescribed components keep some row, which is dropped
        basis = np.vstack([normal, tangents, one[~free]])[:dim]
        rows_E += [0 * normal] * (dim - len(rows_E))
        rows_C += [0 * normal] * (dim - len(rows_C))
        return basis.T @ np.array(rows_E), basis.T @ np.array(rows_C)


def read(stated, states):
    """The increments one after the other."""
    solved = []
    for k, state in enumerate(states):
        solved.append(Solved(stated, k, state, solved[-1] if solved else None))
    return solved


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

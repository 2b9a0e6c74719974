"""Random contact problems by seed.

A seed is drawn in two steps: `sketch` takes all random decisions as plain numbers, `problem`
makes mesh, matrices and pairs of them. So what occurs can be counted without a mesh.

A body is a box whose last axis points up, sides named by (axis, end). Meshes are smooth functions
of position, so no number of processes changes them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import CellType, Mesh, create_box, locate_entities_boundary

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
)
from pw_elements.contact import (
    ContactPair,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    solve_contact,
)
from pw_elements.contact.model import ContactState, Surface
from pw_elements.elasticity import StressState, nodal_load
from pw_elements.meshes import DIAGONAL_PATTERNS, move_nodes, quadrilaterals, triangles
from study.elements import composite, serendipity
from tests.contact.polyline import Polyline

Array = npt.NDArray[np.float64]
Side = tuple[int, int]  # axis and end of the box

CELLS = {"triangle": 0.38, "quadrilateral": 0.34, "tetrahedron": 0.23, "hexahedron": 0.05}
SOLID = ("tetrahedron", "hexahedron")
# One word for what happens in the increments, with press and drag at their ends, over the largest
PATHS = {
    "one step": [(1.0, 1.0)],
    "press, then drag": [(1.0, 0.0), (1.0, 0.5), (1.0, 1.0)],
    "proportional": [(0.25, 0.25), (0.5, 0.5), (0.75, 0.75), (1.0, 1.0)],
    "reversal": [(1.0, 0.0), (1.0, 1.0), (1.0, 0.0), (1.0, -1.0), (1.0, 0.5)],
    "unloading": [(0.5, 0.0), (1.0, 0.3), (0.6, 0.3), (0.2, 0.1)],
    "total unloading": [(1.0, 0.4), (0.3, 0.4), (0.0, 0.0), (0.5, 0.0)],
    "wandering": [],
}


@dataclass(frozen=True)
class PairSketch:
    """One pair in numbers; lengths over the body's size, mu phi F is the tangential force."""

    side: Side
    kind: str
    shape: dict[str, float]
    mu: float
    friction: str = "constant"
    part: tuple[float, float] = (0.0, 1.0)
    gap: float = 0.0
    drive: str = "rest"
    along: str = "held"
    press: float = 0.0
    drag: tuple[float, ...] = ()


@dataclass(frozen=True)
class Sketch:
    """A problem in numbers."""

    seed: int
    cell: str
    element: str
    state: str
    divisions: tuple[int, ...]
    pattern: str
    size: tuple[float, ...]
    lower: tuple[float, ...]
    waves: tuple[float, ...]
    crown: dict[int, float]
    modulus: float
    nu: float
    thickness: float
    support: str
    held: tuple[tuple[Side, int, float], ...]
    pairs: tuple[PairSketch, ...]
    loads: tuple[tuple[Side, str, tuple[float, ...], tuple[float, ...]], ...]
    path: str
    steps: tuple[tuple[float, float], ...]
    strain: float

    @property
    def dim(self) -> int:
        return len(self.divisions)

    @property
    def driven_by_force(self) -> bool:
        return bool(self.loads) or any(pair.drive == "pushed" for pair in self.pairs)


@dataclass(frozen=True)
class Problem:
    """All that is stated, and `solve`."""

    sketch: Sketch
    K: PETSc.Mat
    space: fem.FunctionSpace
    loads: list[PETSc.Vec]
    conditions: list[fem.DirichletBC]
    reduction: Reduction
    pairs: list[ContactPair]

    def solve(self, **options) -> list[ContactState]:
        return solve_contact(self.K, self.loads, self.reduction, self.pairs, self.space, **options)


# -- drawing ---------------------------------------------------------------------------------


def sketch(seed: int) -> Sketch:
    rng = np.random.default_rng((2004, seed))  # of which the first 60 have some of everything
    cell = _pick(rng, CELLS)
    dim = 3 if cell in SOLID else 2
    state = "solid"
    if dim == 2:
        state = _pick(rng, {"plane stress": 0.3, "plane strain": 0.35, "axisymmetric": 0.35})
    rest = {"triangle": "composite", "quadrilateral": "serendipity"}.get(cell, "galerkin")
    if rest == "composite" and state == "axisymmetric":
        rest = "galerkin"
    element = _pick(rng, {"petrov_galerkin": 0.5, "galerkin": 0.3}, rest=rest)
    pattern = str(rng.choice(DIAGONAL_PATTERNS))
    low, high = {
        "triangle": ((4, 2), (8, 4)) if pattern == "crossed" else ((6, 3), (12, 6)),
        "quadrilateral": ((6, 3), (15, 9)),
        "tetrahedron": ((2, 2, 1), (4, 3, 2)),
        "hexahedron": ((2, 2, 1), (3, 2, 2)),
    }[cell]
    divisions = rng.integers(low, high, endpoint=True)

    unit = 10 ** rng.uniform(-3, 3) if _chance(rng, 0.6) else 1.0
    size = unit * rng.uniform([0.8] * (dim - 1) + [0.4], [2.0] * (dim - 1) + [1.2])
    lower = unit * rng.uniform(-3, 3, dim) if _chance(rng, 0.3) else np.zeros(dim)
    hollow = state == "axisymmetric" and _chance(rng, 0.5)
    if state == "axisymmetric":
        lower[0] = unit * rng.uniform(0.3, 2.0) if hollow else 0.0

    support, held = _supports(rng, dim, state, hollow)
    strain = 10 ** rng.uniform(-4, -1.6)
    pairs, loads = _pairs_and_loads(rng, dim, state, hollow, support, strain)
    path, steps = _path(rng, support, pairs)
    crown = {}
    if _chance(rng, 0.25):
        up = dim - 1
        sides = [end for end in (0, 1) if any(pair.side == (up, end) for pair in pairs)]
        crown = {end: rng.uniform(0.0, 0.2) * _flatness(rng, strain) for end in sides}
    waves = rng.uniform([0.0, 2.0, 0.0] * dim, [0.05, 8.0, 6.0] * dim)
    nu = rng.uniform(0.0, 0.45)
    if _chance(rng, 0.1):
        nu = 0.5 - 10 ** rng.uniform(-4, -1.5)
    elif _chance(rng, 0.05):
        nu = -rng.uniform(0.0, 0.5)
    modulus, thickness = 10 ** rng.uniform(-3, 11), 10 ** rng.uniform(-1, 1)
    shape = (tuple(numbers.tolist()) for numbers in (divisions, size, lower, waves))
    divided, size, lower, waves = shape
    kinds = (seed, cell, element, state, divided, pattern)
    made = (*kinds, size, lower, waves, crown, modulus, nu, thickness, support, held)
    return Sketch(*made, tuple(pairs), tuple(loads), path, steps, strain)


def _pick(rng: np.random.Generator, weights: dict[str, float], rest: str = "") -> str:
    names, values = list(weights), list(weights.values())
    if rest:
        names, values = [*names, rest], [*values, 1 - sum(values)]
    return names[int(rng.choice(len(names), p=np.array(values) / sum(values)))]


def _chance(rng: np.random.Generator, probability: float) -> bool:
    return bool(rng.random() < probability)


def _supports(rng, dim, state, hollow):
    up = dim - 1
    base, left = (up, 0), (0, 0)
    lines: list[tuple[Side, int, float]] = [((axis, 0), axis, 0.0) for axis in range(up)]
    if state == "axisymmetric":
        kind = _pick(rng, {"clamped": 0.45}, rest="contact alone")
        held = [] if hollow else lines
    else:
        kinds = {"clamped": 0.26, "roller": 0.1, "cantilever": 0.14, "symmetry": 0.22}
        kind = _pick(rng, kinds, rest="contact alone")
        held = lines if kind in ("roller", "symmetry") else []
    if kind == "clamped":
        lift = rng.uniform(-1, 1) if _chance(rng, 0.15) else 0.0
        held = held + [(base, axis, lift if axis == up else 0.0) for axis in range(dim)]
    elif kind == "roller":
        held = [*held, (base, up, 0.0)]
    elif kind == "cantilever":
        held = [(left, axis, 0.0) for axis in range(dim)]
    return kind, tuple(held)


def _pairs_and_loads(rng, dim, state, hollow, support, strain):
    up = dim - 1
    top, base, right, left = (up, 1), (up, 0), (0, 1), (0, 0)
    round_axis = state == "axisymmetric" and not hollow  # nothing may slide over the axis
    fixed = support in ("clamped", "roller", "cantilever")
    pairs: list[PairSketch] = []
    loads: list = []

    def pair(side: Side, drive: str, floor: bool = False, **numbers) -> PairSketch:
        mu = _friction(rng)
        loose = support == "contact alone" and state != "axisymmetric"
        if floor and loose and mu < 0.1 and _chance(rng, 0.95):
            mu = float(rng.uniform(0.1, 1.0))
        steep = 0.6 * mu if floor and not fixed else 1.0
        centred = (round_axis or support == "symmetry") and side[0] == up and _chance(rng, 0.7)
        flat = floor and support == "contact alone" and not _chance(rng, 0.1)
        kind, shape = _surface(rng, side, dim, steep, centred, flat, strain)
        along, drag = "held", (0.0,) * up
        if drive != "rest" and _chance(rng, 0.75) and not (state == "axisymmetric" and side == top):
            along = "moved"
            if drive == "pushed" and mu > 0:
                along = _pick(rng, {"free": 0.6}, rest="moved")
            most = 0.9 if _chance(rng, 0.85) else 1.3
            drag = tuple((rng.uniform(-most, most, up) / np.sqrt(up)).tolist())
        return PairSketch(
            side,
            kind,
            shape,
            mu,
            _pick(rng, {"constant": 0.75, "graded": 0.15}, rest="half smooth"),
            gap=rng.uniform(0.1, 0.8) if _chance(rng, 0.3) else 0.0,
            drive=drive,
            along=along,
            press=rng.uniform(0.3, 1.5) if drive != "rest" else 0.0,
            drag=drag,
            **numbers,
        )

    def parted(side: Side, drives: Sequence[str], **numbers) -> list[PairSketch]:
        if len(drives) == 1:
            ends = [0.0, 1.0] if _chance(rng, 0.85) else np.sort(rng.uniform(0, 1, 2)).tolist()
            if ends[1] - ends[0] < 0.4:
                ends = [0.0, 1.0]
            return [pair(side, drives[0], part=tuple(ends), **numbers)]
        middle = rng.uniform(0.35, 0.65)
        return [
            pair(side, drives[0], part=(0.0, middle - 0.05), **numbers),
            pair(side, drives[1], part=(middle + 0.05, 1.0), **numbers),
        ]

    def load(side: Side, pressing: float, dragging: Array) -> None:
        kind = _pick(rng, {"traction": 0.8}, rest="nodal")
        vector = np.zeros(dim)
        vector[side[0]] = pressing * (1 - 2 * side[1])
        tangential = np.zeros(dim)
        tangential[[axis for axis in range(dim) if axis != side[0]]] = dragging
        loads.append((side, kind, tuple(vector.tolist()), tuple(tangential.tolist())))

    def drive(loaded: float) -> str:
        return _pick(rng, {"moved": 0.42 - 0.4 * loaded, "loaded": loaded}, rest="pushed")

    if fixed:
        way = drive(0.18)
        first = "rest" if way == "loaded" else way
        if way != "loaded" and _chance(rng, 0.18):
            pairs += parted(top, [first, drive(0.0)])
        else:
            pairs += parted(top, [first])
        if way == "loaded":  # bends or lifts the body against the surface above
            upwards = np.zeros(up)
            upwards[-1] = rng.uniform(0.2, 1.0)
            load(right, rng.uniform(-0.3, 0.3), upwards)
        if support == "cantilever" and _chance(rng, 0.5):
            pairs += parted(base, ["rest"], floor=True)
        elif _chance(rng, 0.3):
            pairs.append(pair(right, _pick(rng, {"rest": 0.5, "moved": 0.25}, rest="pushed")))
        if support == "clamped" and (hollow or state != "axisymmetric") and _chance(rng, 0.15):
            pairs.append(pair(left, _pick(rng, {"rest": 0.6}, rest="moved")))
        return pairs, loads

    pairs += parted(base, ["rest", "rest"] if _chance(rng, 0.2) else ["rest"], floor=True)
    way = drive(0.42)
    if way == "loaded":
        pressing = rng.uniform(0.3, 1.5)
        least = {"constant": 1.0, "graded": 0.6, "half smooth": 0.4}
        most = min(pair.mu * least[pair.friction] for pair in pairs)
        most *= 0.9 if _chance(rng, 0.85) else 1.3
        if state == "axisymmetric" or support == "symmetry":
            most = 0.5 * _chance(rng, 0.5)
        load(top, pressing, min(most, 1.5) * pressing * rng.uniform(-1, 1, up) / np.sqrt(up))
    else:
        pairs.append(pair(top, way))
    if _chance(rng, 0.2):
        pairs.append(pair(right, _pick(rng, {"rest": 0.7}, rest="moved")))
    if state != "axisymmetric" and support != "symmetry" and _chance(rng, 0.08):
        pairs.append(pair(left, "rest"))
    return pairs, loads


def _friction(rng: np.random.Generator) -> float:
    """mu: mostly between 0 and 2, often none, sometimes up to 30."""
    kind = _pick(rng, {"none": 0.17, "common": 0.5, "large": 0.27}, rest="huge")
    if kind == "none":
        return 0.0
    low, high = {"common": (0.02, 0.8), "large": (0.8, 2.0), "huge": (2.0, 30.0)}[kind]
    return float(10 ** rng.uniform(np.log10(low), np.log10(high)))


def _surface(rng, side, dim, steep, centred, flat, strain):
    """Kind and numbers of a surface, lengths over the width of the side.

    `place` is the middle along the part's axes, `steep` the largest slope, and a `flat` one
    can hold a body that lies on it.
    """
    flatness = _flatness(rng, strain)
    kinds = {"plane": 0.34, "sphere": 0.2, "flat punch": 0.12, "signed distance": 0.12}
    if side[0] == dim - 1:
        kinds["parabola"] = 0.12
    if dim == 2:
        kinds["polyline"] = 0.15
    if flat:
        kinds = {"plane": 0.75, "polyline": 0.15 * (dim == 2), "flat punch": 0.1}
    kind = _pick(rng, kinds)
    numbers = {"place": 0.0 if centred else rng.uniform(0.2, 0.8)}
    numbers["place 1"] = 0.0 if centred else rng.uniform(0.2, 0.8)
    if kind == "plane":
        tilted = _chance(rng, 0.35) and not centred
        most = min(steep, 0.35 * flatness) * tilted
        numbers |= {"slope": rng.uniform(-most, most), "slope 1": rng.uniform(-most, most)}
    elif kind in ("sphere", "parabola"):
        numbers["radius"] = 10 ** rng.uniform(-0.4, 0.9) / max(flatness, 0.01)
    elif kind == "flat punch":
        numbers["half width"] = rng.uniform(0.3, 0.6) * (2 if centred else 1)
        if flat:
            numbers |= {"place": 0.5, "place 1": 0.5, "half width": rng.uniform(0.35, 0.6)}
    elif kind == "signed distance":
        longer = max(flatness, 0.01) ** -0.5
        numbers |= {"long": longer * rng.uniform(0.5, 3.0), "short": rng.uniform(0.3, 1.5)}
        numbers["gradient"] = float(_chance(rng, 0.5))
    else:
        numbers |= {"flat": rng.uniform(0.1, 0.4) * (1.5 if flat else 1.0)}
        numbers |= {name: flatness * rng.uniform(0.05, 0.8) for name in ("left", "right")}
        numbers["rounding"] = rng.uniform(0.1, 0.5) if _chance(rng, 0.7) else 0.0
    return kind, numbers


def _flatness(rng: np.random.Generator, strain: float) -> float:
    """Factor of slopes and curvatures: often the strain's size, so that many nodes touch."""
    return min(1.0, strain * 10 ** rng.uniform(0.0, 1.3)) if _chance(rng, 0.65) else 1.0


def _path(rng, support, pairs):
    weights = {
        "one step": 0.2,
        "press, then drag": 0.2,
        "proportional": 0.12,
        "reversal": 0.16,
        "unloading": 0.1,
        "total unloading": 0.1,
    }
    name = _pick(rng, weights, rest="wandering")
    if name == "wandering":
        count = int(rng.integers(2, 6))
        steps = np.column_stack((rng.uniform(0.3, 1.0, count), rng.uniform(-1, 1, count)))
        return name, tuple(map(tuple, steps.tolist()))
    # what nothing else holds is let go in a few problems only: it cannot be solved
    held = support != "contact alone" and all(pair.drive != "pushed" for pair in pairs)
    if name == "total unloading" and not held and not _chance(rng, 0.1):
        return name, tuple((max(p, 0.01), min(q, 0.01 if p <= 0 else q)) for p, q in PATHS[name])
    return name, tuple(PATHS[name])


# -- making ----------------------------------------------------------------------------------


def problem(seed: int, comm: MPI.Comm = MPI.COMM_SELF) -> Problem:
    return _Maker(sketch(seed), comm).problem()


class _Maker:
    def __init__(self, plan: Sketch, comm: MPI.Comm) -> None:
        self.plan, self.comm = plan, comm
        self.size, self.lower = np.array(plan.size), np.array(plan.lower)
        mesh, self.facets = self._mesh()
        own = {"composite": composite, "serendipity": serendipity}
        spaces = (own.get(plan.element) or getattr(Spaces, plan.element))(mesh)
        thickness = plan.thickness if plan.state.startswith("plane") else 1.0
        material = Material(plan.modulus, plan.nu)
        self.body = Body(spaces, material, StressState(plan.state), thickness)
        self.space = spaces.trial
        self.x = self.space.tabulate_dof_coordinates()[:, : plan.dim]  # ghosts too
        self.owned = self.space.dofmap.index_map.size_local

    def problem(self) -> Problem:
        plan = self.plan
        conditions, held = self._conditions()
        K = assemble_matrix(self.body.stiffness())
        nodes, taken = [], np.zeros(len(self.x), dtype=bool)
        for pair in plan.pairs:  # a node of two sides goes to the first
            mine = self._may_touch(pair, held) & ~taken
            taken |= mine
            nodes.append(mine)
        pairs = [self._pair(pair, mine) for pair, mine in zip(plan.pairs, nodes, strict=True)]
        supports = Reduction.dirichlet(self.space, conditions)
        loads = self._loads(K)
        return Problem(plan, K, self.space, loads, conditions, supports, pairs)

    # -- the body ----------------------------------------------------------------------------

    def _mesh(self) -> tuple[Mesh, dict[Side, npt.NDArray[np.int32]]]:
        plan, dim = self.plan, self.plan.dim
        if dim == 3:
            box = [(0.0,) * 3, (1.0,) * 3]
            mesh = create_box(self.comm, box, plan.divisions, CellType[plan.cell])
        elif plan.cell == "triangle":
            mesh = triangles(self.comm, (0.0, 0.0), (1.0, 1.0), plan.divisions, plan.pattern)
        else:
            mesh = quadrilaterals(self.comm, (0.0, 0.0), (1.0, 1.0), plan.divisions)
        facets = {
            (axis, end): locate_entities_boundary(
                mesh, dim - 1, lambda x, axis=axis, end=end: np.isclose(x[axis], end)
            )
            for axis in range(dim)
            for end in (0, 1)
        }
        return move_nodes(mesh, self._image), facets

    def _image(self, x: Array) -> Array:
        """Of the unit box: waves inside of it, its crown, and its size."""
        plan, dim = self.plan, self.plan.dim
        s = x[:, :dim].copy()
        for axis in range(dim):
            height, number, phase = plan.waves[3 * axis : 3 * axis + 3]
            across = x[:, (axis + 1) % dim]
            s[:, axis] += height * np.sin(np.pi * x[:, axis]) * np.cos(number * across + phase)
        middle = 0.0 if plan.support == "symmetry" or plan.lower[0] == 0.0 else 0.5
        off = np.mean(((s[:, :-1] - middle) / (1 - middle)) ** 2, axis=1)
        top, base = (plan.crown.get(end, 0.0) * off for end in (1, 0))
        s[:, -1] += base * (1 - s[:, -1]) - top * s[:, -1]
        image = x.copy()
        image[:, :dim] = self.lower + s * self.size
        return image

    def _nodes(self, side: Side) -> npt.NDArray[np.int32]:
        facet = self.plan.dim - 1
        mesh = self.body.spaces.mesh
        mesh.topology.create_connectivity(facet, mesh.topology.dim)
        return fem.locate_dofs_topological(self.space, facet, self.facets[side])

    def _conditions(self) -> tuple[list[fem.DirichletBC], npt.NDArray[np.bool_]]:
        """Supports, and which displacements (nodes, dim) they hold."""
        plan, dim = self.plan, self.plan.dim
        conditions, held = [], np.zeros(self.x.shape, dtype=bool)
        for side, axis, lift in plan.held:
            nodes = self._nodes(side)
            held[nodes, axis] = True
            value = default_scalar_type(lift * plan.strain * self.size[-1])
            dofs = (nodes * dim + axis).astype(np.int32)
            conditions.append(fem.dirichletbc(value, dofs, self.space.sub(axis)))
        return conditions, held

    def _loads(self, K: PETSc.Mat) -> list[PETSc.Vec]:
        plan = self.plan
        unit = plan.modulus * plan.strain
        parts = []
        for side, kind, pressing, dragging in plan.loads:
            vectors = [unit * np.array(vector) for vector in (pressing, dragging)]
            if kind == "traction":
                measure = boundary_measure(self.body.spaces.mesh, self.facets[side])
                forms = [self.body.surface_load(vector, measure) for vector in vectors]
                parts.append([assemble_vector(form) for form in forms])
            else:
                area = 0.3 * self._area(side)
                where = self._middle_of(side)
                parts.append([nodal_load(self.space, where, area * vector) for vector in vectors])
        loads = []
        for press, drag in plan.steps:
            load = K.createVecLeft()
            load.set(0.0)
            for pressing, dragging in parts:
                load.axpy(max(press, 0.0), pressing)
                load.axpy(drag, dragging)
            loads.append(load)
        return loads

    def _middle_of(self, side: Side) -> Callable[[Array], npt.NDArray[np.bool_]]:
        """Marker of the node nearest to the middle of a side."""
        x = self._gathered(self._nodes(side))
        middle = self.lower + 0.5 * self.size
        middle[side[0]] = self.lower[side[0]] + side[1] * self.size[side[0]]
        place = x[np.argmin(np.linalg.norm(x - middle, axis=1))]
        near = 1e-6 * self.size.min()
        return lambda x: np.linalg.norm(x[: len(place)].T - place, axis=1) < near

    def _gathered(self, nodes: npt.NDArray[np.int32]) -> Array:
        """Positions of nodes of all processes, in one order."""
        mine = self.x[nodes[nodes < self.owned]]
        x = np.concatenate(self.comm.allgather(mine))
        return x[np.lexsort(np.round(x / self.size.max(), 9).T)]

    def _area(self, side: Side) -> float:
        """Of a side, of the whole circumference in axisymmetry, times the thickness."""
        lengths = np.delete(self.size, side[0])
        area = float(np.prod(lengths))
        if self.plan.state == "axisymmetric":
            inner, outer = self.lower[0], self.lower[0] + self.size[0]
            radius = (inner + outer) / 2 if side[0] else (inner, outer)[side[1]]
            area *= 2 * np.pi * radius
        return area * (self.plan.thickness if self.plan.state.startswith("plane") else 1.0)

    # -- its contacts ------------------------------------------------------------------------

    def _may_touch(self, pair: PairSketch, held: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Nodes of a pair: those of its side whose normals no support can hold."""
        side, dim = pair.side, self.plan.dim
        first = 0 if side[0] else 1
        s = (self.x[:, first] - self.lower[first]) / self.size[first]
        touching = np.zeros(len(self.x), dtype=bool)
        touching[self._nodes(side)] = True
        touching &= (s > pair.part[0] - 1e-6) & (s < pair.part[1] + 1e-6)
        for axis in range(dim):
            touching &= ~(held[:, axis] & ~self._normal_to(pair, axis))
        return touching

    def _normal_to(self, pair: PairSketch, axis: int) -> npt.NDArray[np.bool_]:
        """At which nodes the normal stays orthogonal to an axis."""
        if axis == pair.side[0]:
            return np.zeros(len(self.x), dtype=bool)
        number = self._tangential(pair.side).index(axis)
        suffix = "" if number == 0 else " 1"
        if pair.kind in ("sphere", "signed distance"):
            centre = self.lower[axis] + self._places(pair)[number] * self.size[axis]
            still = pair.drive == "rest" or pair.along == "held"
            return still & (np.abs(self.x[:, axis] - centre) < 1e-9 * self.size[axis])
        straight = pair.kind in ("parabola", "flat punch")
        straight |= pair.kind == "plane" and pair.shape["slope" + suffix] == 0.0
        return np.full(len(self.x), straight)

    def _tangential(self, side: Side) -> list[int]:
        return [axis for axis in range(self.plan.dim) if axis != side[0]]

    def _places(self, pair: PairSketch) -> Array:
        """Middle of the surface along the side's axes, over the lengths of the box."""
        low, high = pair.part
        first = low + pair.shape["place"] * (high - low)
        return np.array([first, pair.shape["place 1"]])[: self.plan.dim - 1]

    def _pair(self, pair: PairSketch, mine: npt.NDArray[np.bool_]) -> ContactPair:
        surface = self._surface(pair, self._gathered(np.flatnonzero(mine)))
        # both ways to state nodes occur, and friction as a number and as a function
        nodes = mine if self.plan.seed % 2 else np.flatnonzero(mine).astype(np.int32)
        return ContactPair(nodes, surface, self._friction(pair), self._motions(pair))

    def _surface(self, pair: PairSketch, x: Array) -> Surface:
        """The surface, which touches the nearest of the pair's nodes x or is a gap away."""
        side, shape = pair.side, pair.shape
        axes = self._tangential(side)
        out = np.zeros(self.plan.dim)
        out[side[0]] = 2 * side[1] - 1
        gap = pair.gap * self.plan.strain * self.size[-1]
        if pair.kind == "plane":
            direction = -out
            direction[axes] = [shape["slope"], shape["slope 1"]][: len(axes)]
            return Plane(x[np.argmin(x @ direction)] + gap * out, direction)
        # the surface's point next to the side
        near = np.zeros(self.plan.dim)
        near[axes] = self.lower[axes] + self._places(pair) * self.size[axes]
        near += (x @ out).max() * out
        for _ in range(4):
            surface = self._surface_at(pair, near, out, axes)
            nearest = surface.gap(x).min()
            if np.isfinite(nearest):
                near -= (nearest - gap) * out
        return surface

    def _surface_at(self, pair: PairSketch, near: Array, out: Array, axes: list[int]) -> Surface:
        shape, width = pair.shape, self.size[axes].max()
        if pair.kind == "sphere":
            radius = shape["radius"] * width
            return Sphere(near + radius * out, radius)
        if pair.kind == "parabola":
            return Parabola(near, shape["radius"] * width * out[-1])
        if pair.kind == "flat punch":
            return FlatPunch(near, -out, shape["half width"] * width)
        if pair.kind == "signed distance":
            return _ellipsoid(near, out, width, shape)
        along = np.zeros(2)
        along[axes] = 1.0
        s = width * np.array([-2.0, -shape["flat"], shape["flat"], 2.0])
        far = 2.0 - shape["flat"]
        depth = width * far * np.array([shape["left"], 0.0, 0.0, shape["right"]])
        points = near + s[:, None] * along + depth[:, None] * out
        if along[1] * out[0] - along[0] * out[1] < 0:  # the body has to be on the left
            points = points[::-1]
        return Polyline(points, shape["rounding"] * shape["flat"] * width)

    def _friction(self, pair: PairSketch) -> float | Callable[[Array], Array]:
        if pair.friction == "constant":
            return pair.mu
        first = 0 if pair.side[0] else 1
        lower, size = self.lower[first], self.size[first]

        def friction(x: Array) -> Array:
            s = (x[first] - lower) / size
            return pair.mu * (0.5 + 0.5 * s if pair.friction == "graded" else (s > 0.4999))

        return friction

    def _motions(self, pair: PairSketch) -> list[Motion]:
        if pair.drive == "rest":
            return []
        plan, side, axes = self.plan, pair.side, self._tangential(pair.side)
        out = 2 * side[1] - 1
        depth = pair.press * plan.strain * self.size[-1]
        force = pair.press * plan.strain * plan.modulus * self._area(side)
        motions = []
        for press, drag in plan.steps:
            translation: list[float | None] = [0.0] * plan.dim
            forces = np.zeros(plan.dim)
            if pair.drive == "moved":
                translation[side[0]] = -out * (press + pair.gap / pair.press) * depth
            else:
                translation[side[0]] = None
                forces[side[0]] = -out * max(press, 0.0) * force
            for axis, share in zip(axes, pair.drag, strict=True):
                if pair.along == "moved":
                    translation[axis] = drag * share * depth
                elif pair.along == "free":
                    translation[axis] = None
                    forces[axis] = drag * share * pair.mu * force * max(press, 0.0)
            motions.append(Motion(translation, forces.tolist()))
        return motions


def _ellipsoid(near: Array, out: Array, width: float, shape: dict[str, float]) -> SignedDistance:
    """Ellipse or ellipsoid as a level set that is no distance."""
    axes = np.where(out == 0, shape["long"], shape["short"]) * width
    centre = near + shape["short"] * width * out

    def function(x: Array) -> Array:
        return np.sum(((x - centre) / axes) ** 2, axis=1) - 1.0

    def gradient(x: Array) -> Array:
        return 2 * (x - centre) / axes**2

    return SignedDistance(
        function, gradient if shape["gradient"] else None, 1e-6 * float(axes.min())
    )

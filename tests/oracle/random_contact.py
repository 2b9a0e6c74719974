"""Random contact problems, each of which is defined by a seed.

A problem is made in two steps. `draw_sketch` makes all random decisions and returns them as plain
numbers. `make_problem` builds mesh, matrices and pairs from them. Therefore the kinds of problems
can be counted without building meshes.

A body is a box whose last axis points up. Its sides are named by (axis, end). Meshes are smooth
images of a regular mesh, so they do not depend on the number of processes.
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
from study.model.elements import composite_spaces, serendipity_spaces
from tests.contact.polyline import PolylineSurface

Array = npt.NDArray[np.float64]
BoxSide = tuple[int, int]  # axis and end (0 or 1) of the box

CELL_PROBABILITIES = {
    "triangle": 0.38,
    "quadrilateral": 0.34,
    "tetrahedron": 0.23,
    "hexahedron": 0.05,
}
SOLID_CELLS = ("tetrahedron", "hexahedron")
# Factors of the normal and the tangential load or motion at the end of each increment, by path
PRESS_AND_DRAG_FACTORS_BY_PATH = {
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
    """Numbers that define one pair; lengths are relative to the body's size.

    `drag` has one factor for each tangential axis. The tangential force on a surface that is free
    to move is this factor times the friction coefficient times the normal force.
    """

    side: BoxSide
    kind: str
    shape: dict[str, float]
    mu: float
    friction: str = "constant"
    side_range: tuple[float, float] = (0.0, 1.0)
    gap: float = 0.0
    normal_drive: str = "rest"
    tangential_drive: str = "held"
    press: float = 0.0
    drag: tuple[float, ...] = ()


@dataclass(frozen=True)
class ProblemSketch:
    """Numbers that define a random contact problem."""

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
    prescribed: tuple[tuple[BoxSide, int, float], ...]
    pairs: tuple[PairSketch, ...]
    loads: tuple[tuple[BoxSide, str, tuple[float, ...], tuple[float, ...]], ...]
    path: str
    steps: tuple[tuple[float, float], ...]
    strain: float

    @property
    def dim(self) -> int:
        return len(self.divisions)

    @property
    def is_driven_by_force(self) -> bool:
        return bool(self.loads) or any(pair.normal_drive == "pushed" for pair in self.pairs)


@dataclass(frozen=True)
class RandomContactProblem:
    """A random problem with its stiffness matrix, loads, supports and contact pairs."""

    sketch: ProblemSketch
    K: PETSc.Mat
    space: fem.FunctionSpace
    loads: list[PETSc.Vec]
    conditions: list[fem.DirichletBC]
    reduction: Reduction
    pairs: list[ContactPair]

    def solve(self, **options) -> list[ContactState]:
        return solve_contact(self.K, self.loads, self.reduction, self.pairs, self.space, **options)


# -- drawing ---------------------------------------------------------------------------------


def draw_sketch(seed: int) -> ProblemSketch:
    """Return the numbers that define the problem of a seed."""
    rng = np.random.default_rng((2004, seed))  # the first 60 seeds include all kinds of problems
    cell = _draw_name(rng, CELL_PROBABILITIES)
    dim = 3 if cell in SOLID_CELLS else 2
    state = "solid"
    if dim == 2:
        state = _draw_name(rng, {"plane stress": 0.3, "plane strain": 0.35, "axisymmetric": 0.35})
    fallback_element = {"triangle": "composite", "quadrilateral": "serendipity"}.get(
        cell, "galerkin"
    )
    if fallback_element == "composite" and state == "axisymmetric":
        fallback_element = "galerkin"
    element = _draw_name(rng, {"petrov_galerkin": 0.5, "galerkin": 0.3}, default=fallback_element)
    pattern = str(rng.choice(DIAGONAL_PATTERNS))
    min_divisions, max_divisions = {
        "triangle": ((4, 2), (8, 4)) if pattern == "crossed" else ((6, 3), (12, 6)),
        "quadrilateral": ((6, 3), (15, 9)),
        "tetrahedron": ((2, 2, 1), (4, 3, 2)),
        "hexahedron": ((2, 2, 1), (3, 2, 2)),
    }[cell]
    divisions = rng.integers(min_divisions, max_divisions, endpoint=True)

    unit = 10 ** rng.uniform(-3, 3) if _draw_bool(rng, 0.6) else 1.0
    size = unit * rng.uniform([0.8] * (dim - 1) + [0.4], [2.0] * (dim - 1) + [1.2])
    lower = unit * rng.uniform(-3, 3, dim) if _draw_bool(rng, 0.3) else np.zeros(dim)
    is_hollow = state == "axisymmetric" and _draw_bool(rng, 0.5)
    if state == "axisymmetric":
        lower[0] = unit * rng.uniform(0.3, 2.0) if is_hollow else 0.0

    support, prescribed = _draw_supports(rng, dim, state, is_hollow)
    strain = 10 ** rng.uniform(-4, -1.6)
    pairs, loads = _draw_pair_sketches_and_loads(rng, dim, state, is_hollow, support, strain)
    path, steps = _draw_load_path(rng, support, pairs)
    crown = {}
    if _draw_bool(rng, 0.25):
        up = dim - 1
        sides = [end for end in (0, 1) if any(pair.side == (up, end) for pair in pairs)]
        crown = {
            end: rng.uniform(0.0, 0.2) * _draw_slope_and_curvature_factor(rng, strain)
            for end in sides
        }
    waves = rng.uniform([0.0, 2.0, 0.0] * dim, [0.05, 8.0, 6.0] * dim)
    nu = rng.uniform(0.0, 0.45)
    if _draw_bool(rng, 0.1):
        nu = 0.5 - 10 ** rng.uniform(-4, -1.5)
    elif _draw_bool(rng, 0.05):
        nu = -rng.uniform(0.0, 0.5)
    modulus, thickness = 10 ** rng.uniform(-3, 11), 10 ** rng.uniform(-1, 1)
    tuples = (tuple(values.tolist()) for values in (divisions, size, lower, waves))
    n_cells, size, lower, waves = tuples
    discrete_arguments = (seed, cell, element, state, n_cells, pattern)
    arguments = (
        *discrete_arguments,
        size,
        lower,
        waves,
        crown,
        modulus,
        nu,
        thickness,
        support,
        prescribed,
    )
    return ProblemSketch(*arguments, tuple(pairs), tuple(loads), path, steps, strain)


def _draw_name(rng: np.random.Generator, weights: dict[str, float], default: str = "") -> str:
    """Draw one of the names by their weights; the default has the remaining probability."""
    names, values = list(weights), list(weights.values())
    if default:
        names, values = [*names, default], [*values, 1 - sum(values)]
    return names[int(rng.choice(len(names), p=np.array(values) / sum(values)))]


def _draw_bool(rng: np.random.Generator, probability: float) -> bool:
    """Return True with the given probability."""
    return bool(rng.random() < probability)


def _draw_supports(rng, dim, state, is_hollow):
    """Draw the kind of the supports, and a tuple (side, axis, displacement) for each condition."""
    up = dim - 1
    base, left = (up, 0), (0, 0)
    symmetry_conditions: list[tuple[BoxSide, int, float]] = [
        ((axis, 0), axis, 0.0) for axis in range(up)
    ]
    if state == "axisymmetric":
        kind = _draw_name(rng, {"clamped": 0.45}, default="contact alone")
        prescribed = [] if is_hollow else symmetry_conditions
    else:
        kinds = {"clamped": 0.26, "roller": 0.1, "cantilever": 0.14, "symmetry": 0.22}
        kind = _draw_name(rng, kinds, default="contact alone")
        prescribed = symmetry_conditions if kind in ("roller", "symmetry") else []
    if kind == "clamped":
        lift = rng.uniform(-1, 1) if _draw_bool(rng, 0.15) else 0.0
        prescribed = prescribed + [(base, axis, lift if axis == up else 0.0) for axis in range(dim)]
    elif kind == "roller":
        prescribed = [*prescribed, (base, up, 0.0)]
    elif kind == "cantilever":
        prescribed = [(left, axis, 0.0) for axis in range(dim)]
    return kind, tuple(prescribed)


def _draw_pair_sketches_and_loads(rng, dim, state, is_hollow, support, strain):
    """Draw contact pairs and loads that suit the supports."""
    up = dim - 1
    top, base, right, left = (up, 1), (up, 0), (0, 1), (0, 0)
    round_axis = state == "axisymmetric" and not is_hollow  # no node may slide across the axis
    is_held_normally = support in ("clamped", "roller", "cantilever")
    pairs: list[PairSketch] = []
    loads: list = []

    def draw_pair(side: BoxSide, drive: str, floor: bool = False, **numbers) -> PairSketch:
        mu = _draw_friction_coefficient(rng)
        is_loose = support == "contact alone" and state != "axisymmetric"
        if floor and is_loose and mu < 0.1 and _draw_bool(rng, 0.95):
            mu = float(rng.uniform(0.1, 1.0))
        max_slope = 0.6 * mu if floor and not is_held_normally else 1.0
        centred = (round_axis or support == "symmetry") and side[0] == up and _draw_bool(rng, 0.7)
        must_be_flat = floor and support == "contact alone" and not _draw_bool(rng, 0.1)
        kind, shape = _draw_surface_kind_and_numbers(
            rng, side, dim, max_slope, centred, must_be_flat, strain
        )
        tangential_motion, drag = "held", (0.0,) * up
        if (
            drive != "rest"
            and _draw_bool(rng, 0.75)
            and not (state == "axisymmetric" and side == top)
        ):
            tangential_motion = "moved"
            if drive == "pushed" and mu > 0:
                tangential_motion = _draw_name(rng, {"free": 0.6}, default="moved")
            limit = 0.9 if _draw_bool(rng, 0.85) else 1.3
            drag = tuple((rng.uniform(-limit, limit, up) / np.sqrt(up)).tolist())
        # a surface round the axis has no free radial motion
        is_round_body = state == "axisymmetric" and side[0] == 0
        return PairSketch(
            side,
            kind,
            shape,
            mu,
            _draw_name(rng, {"constant": 0.75, "graded": 0.15}, default="half smooth"),
            gap=rng.uniform(0.1, 0.8) if _draw_bool(rng, 0.3) else 0.0,
            normal_drive="moved" if drive == "pushed" and is_round_body else drive,
            tangential_drive=tangential_motion,
            press=rng.uniform(0.3, 1.5) if drive != "rest" else 0.0,
            drag=drag,
            **numbers,
        )

    def draw_side_pairs(side: BoxSide, drives: Sequence[str], **numbers) -> list[PairSketch]:
        if len(drives) == 1:
            ends = [0.0, 1.0] if _draw_bool(rng, 0.85) else np.sort(rng.uniform(0, 1, 2)).tolist()
            if ends[1] - ends[0] < 0.4:
                ends = [0.0, 1.0]
            return [draw_pair(side, drives[0], side_range=tuple(ends), **numbers)]
        middle = rng.uniform(0.35, 0.65)
        return [
            draw_pair(side, drives[0], side_range=(0.0, middle - 0.05), **numbers),
            draw_pair(side, drives[1], side_range=(middle + 0.05, 1.0), **numbers),
        ]

    def draw_load(side: BoxSide, pressing: float, dragging: Array) -> None:
        kind = _draw_name(rng, {"traction": 0.8}, default="nodal")
        vector = np.zeros(dim)
        vector[side[0]] = pressing * (1 - 2 * side[1])
        tangential = np.zeros(dim)
        tangential[[axis for axis in range(dim) if axis != side[0]]] = dragging
        loads.append((side, kind, tuple(vector.tolist()), tuple(tangential.tolist())))

    def draw_normal_drive(load_probability: float) -> str:
        return _draw_name(
            rng,
            {"moved": 0.42 - 0.4 * load_probability, "loaded": load_probability},
            default="pushed",
        )

    if is_held_normally:
        top_drive = draw_normal_drive(0.18)
        pair_drive = "rest" if top_drive == "loaded" else top_drive
        if top_drive != "loaded" and _draw_bool(rng, 0.18):
            pairs += draw_side_pairs(top, [pair_drive, draw_normal_drive(0.0)])
        else:
            pairs += draw_side_pairs(top, [pair_drive])
        if top_drive == "loaded":  # loads that bend or lift the body against the surface above
            upwards = np.zeros(up)
            upwards[-1] = rng.uniform(0.2, 1.0)
            draw_load(right, rng.uniform(-0.3, 0.3), upwards)
        if support == "cantilever" and _draw_bool(rng, 0.5):
            pairs += draw_side_pairs(base, ["rest"], floor=True)
        elif _draw_bool(rng, 0.3):
            pairs.append(
                draw_pair(right, _draw_name(rng, {"rest": 0.5, "moved": 0.25}, default="pushed"))
            )
        if (
            support == "clamped"
            and (is_hollow or state != "axisymmetric")
            and _draw_bool(rng, 0.15)
        ):
            pairs.append(draw_pair(left, _draw_name(rng, {"rest": 0.6}, default="moved")))
        return pairs, loads

    pairs += draw_side_pairs(
        base, ["rest", "rest"] if _draw_bool(rng, 0.2) else ["rest"], floor=True
    )
    top_drive = draw_normal_drive(0.42)
    if top_drive == "loaded":
        pressing = rng.uniform(0.3, 1.5)
        least_friction = {"constant": 1.0, "graded": 0.6, "half smooth": 0.4}
        limit = min(pair.mu * least_friction[pair.friction] for pair in pairs)
        limit *= 0.9 if _draw_bool(rng, 0.85) else 1.3
        if state == "axisymmetric" or support == "symmetry":
            limit = 0.5 * _draw_bool(rng, 0.5)
        draw_load(top, pressing, min(limit, 1.5) * pressing * rng.uniform(-1, 1, up) / np.sqrt(up))
    else:
        pairs.append(draw_pair(top, top_drive))
    if _draw_bool(rng, 0.2):
        pairs.append(draw_pair(right, _draw_name(rng, {"rest": 0.7}, default="moved")))
    if state != "axisymmetric" and support != "symmetry" and _draw_bool(rng, 0.08):
        pairs.append(draw_pair(left, "rest"))
    return pairs, loads


def _draw_friction_coefficient(rng: np.random.Generator) -> float:
    """Draw a friction coefficient: mostly between 0 and 2, often 0, sometimes up to 30."""
    kind = _draw_name(rng, {"none": 0.17, "common": 0.5, "large": 0.27}, default="huge")
    if kind == "none":
        return 0.0
    low, high = {"common": (0.02, 0.8), "large": (0.8, 2.0), "huge": (2.0, 30.0)}[kind]
    return float(10 ** rng.uniform(np.log10(low), np.log10(high)))


def _draw_surface_kind_and_numbers(rng, side, dim, max_slope, is_centred, must_be_flat, strain):
    """Draw the kind and the numbers of a surface, with lengths relative to the width of the side.

    The numbers "place" and "place 1" are the positions of the surface's middle along the side.
    `max_slope` limits the slope of planes. If `must_be_flat`, only surfaces on which a body can
    rest are drawn.
    """
    flatness = _draw_slope_and_curvature_factor(rng, strain)
    kinds = {"plane": 0.34, "sphere": 0.2, "flat punch": 0.12, "signed distance": 0.12}
    if side[0] == dim - 1:
        kinds["parabola"] = 0.12
    if dim == 2:
        kinds["polyline"] = 0.15
    if must_be_flat:
        kinds = {"plane": 0.75, "polyline": 0.15 * (dim == 2), "flat punch": 0.1}
    kind = _draw_name(rng, kinds)
    numbers = {"place": 0.0 if is_centred else rng.uniform(0.2, 0.8)}
    numbers["place 1"] = 0.0 if is_centred else rng.uniform(0.2, 0.8)
    if kind == "plane":
        tilted = _draw_bool(rng, 0.35) and not is_centred
        largest = min(max_slope, 0.35 * flatness) * tilted
        numbers |= {
            "slope": rng.uniform(-largest, largest),
            "slope 1": rng.uniform(-largest, largest),
        }
    elif kind in ("sphere", "parabola"):
        numbers["radius"] = 10 ** rng.uniform(-0.4, 0.9) / max(flatness, 0.01)
    elif kind == "flat punch":
        numbers["half width"] = rng.uniform(0.3, 0.6) * (2 if is_centred else 1)
        if must_be_flat:
            numbers |= {"place": 0.5, "place 1": 0.5, "half width": rng.uniform(0.35, 0.6)}
    elif kind == "signed distance":
        stretch = max(flatness, 0.01) ** -0.5
        numbers |= {"long": stretch * rng.uniform(0.5, 3.0), "short": rng.uniform(0.3, 1.5)}
        numbers["gradient"] = float(_draw_bool(rng, 0.5))
    else:
        numbers |= {"flat": rng.uniform(0.1, 0.4) * (1.5 if must_be_flat else 1.0)}
        numbers |= {name: flatness * rng.uniform(0.05, 0.8) for name in ("left", "right")}
        numbers["rounding"] = rng.uniform(0.1, 0.5) if _draw_bool(rng, 0.7) else 0.0
    return kind, numbers


def _draw_slope_and_curvature_factor(rng: np.random.Generator, strain: float) -> float:
    """Draw a factor of slopes and curvatures, which is often so small that many nodes touch."""
    return min(1.0, strain * 10 ** rng.uniform(0.0, 1.3)) if _draw_bool(rng, 0.65) else 1.0


def _draw_load_path(rng, support, pairs):
    """Draw a load path: its name, and the factors of press and drag after each increment."""
    weights = {
        "one step": 0.2,
        "press, then drag": 0.2,
        "proportional": 0.12,
        "reversal": 0.16,
        "unloading": 0.1,
        "total unloading": 0.1,
    }
    name = _draw_name(rng, weights, default="wandering")
    if name == "wandering":
        count = int(rng.integers(2, 6))
        steps = np.column_stack((rng.uniform(0.3, 1.0, count), rng.uniform(-1, 1, count)))
        return name, tuple(map(tuple, steps.tolist()))
    # bodies that only contact holds are rarely unloaded, because they then have no solution
    is_held = support != "contact alone" and all(pair.normal_drive != "pushed" for pair in pairs)
    if name == "total unloading" and not is_held and not _draw_bool(rng, 0.1):
        return name, tuple(
            (max(p, 0.01), min(q, 0.01 if p <= 0 else q))
            for p, q in PRESS_AND_DRAG_FACTORS_BY_PATH[name]
        )
    return name, tuple(PRESS_AND_DRAG_FACTORS_BY_PATH[name])


# -- making ----------------------------------------------------------------------------------


def make_problem(seed: int, comm: MPI.Comm = MPI.COMM_SELF) -> RandomContactProblem:
    """Return the problem that belongs to a seed."""
    return _ProblemBuilder(draw_sketch(seed), comm).build()


class _ProblemBuilder:
    """Builder of the mesh, matrices and pairs of a sketch."""

    def __init__(self, sketch: ProblemSketch, comm: MPI.Comm) -> None:
        self.sketch, self.comm = sketch, comm
        self.size, self.lower = np.array(sketch.size), np.array(sketch.lower)
        mesh, self.facets = self._make_mesh_and_side_facets()
        study_elements = {"composite": composite_spaces, "serendipity": serendipity_spaces}
        spaces = (study_elements.get(sketch.element) or getattr(Spaces, sketch.element))(mesh)
        thickness = sketch.thickness if sketch.state.startswith("plane") else 1.0
        material = Material(sketch.modulus, sketch.nu)
        self.body = Body(spaces, material, StressState(sketch.state), thickness)
        self.space = spaces.trial
        self.x = self.space.tabulate_dof_coordinates()[:, : sketch.dim]  # with ghosts
        self.owned = self.space.dofmap.index_map.size_local

    def build(self) -> RandomContactProblem:
        """Return the problem; a node that lies on two sides belongs to the first pair."""
        sketch = self.sketch
        conditions, prescribed_mask = self._make_conditions_and_prescribed_mask()
        K = assemble_matrix(self.body.stiffness())
        nodes, is_taken = [], np.zeros(len(self.x), dtype=bool)
        for pair in sketch.pairs:
            mask = self._contact_node_mask(pair, prescribed_mask) & ~is_taken
            is_taken |= mask
            nodes.append(mask)
        pairs = [
            self._make_pair(pair, mask) for pair, mask in zip(sketch.pairs, nodes, strict=True)
        ]
        supports = Reduction.dirichlet(self.space, conditions)
        loads = self._assemble_loads(K)
        return RandomContactProblem(sketch, K, self.space, loads, conditions, supports, pairs)

    # -- the body ----------------------------------------------------------------------------

    def _make_mesh_and_side_facets(self) -> tuple[Mesh, dict[BoxSide, npt.NDArray[np.int32]]]:
        """Return the mesh, and the facets on each side."""
        sketch, dim = self.sketch, self.sketch.dim
        if dim == 3:
            box = [(0.0,) * 3, (1.0,) * 3]
            mesh = create_box(self.comm, box, sketch.divisions, CellType[sketch.cell])
        elif sketch.cell == "triangle":
            mesh = triangles(self.comm, (0.0, 0.0), (1.0, 1.0), sketch.divisions, sketch.pattern)
        else:
            mesh = quadrilaterals(self.comm, (0.0, 0.0), (1.0, 1.0), sketch.divisions)
        facets = {
            (axis, end): locate_entities_boundary(
                mesh, dim - 1, lambda x, axis=axis, end=end: np.isclose(x[axis], end)
            )
            for axis in range(dim)
            for end in (0, 1)
        }
        return move_nodes(mesh, self._map_unit_box_to_body), facets

    def _map_unit_box_to_body(self, x: Array) -> Array:
        """Map points of the unit box: add inner waves, crown two sides, scale and move the box."""
        sketch, dim = self.sketch, self.sketch.dim
        s = x[:, :dim].copy()
        for axis in range(dim):
            height, number, phase = sketch.waves[3 * axis : 3 * axis + 3]
            cross_coordinate = x[:, (axis + 1) % dim]
            s[:, axis] += (
                height * np.sin(np.pi * x[:, axis]) * np.cos(number * cross_coordinate + phase)
            )
        middle = 0.0 if sketch.support == "symmetry" or sketch.lower[0] == 0.0 else 0.5
        squared_distance = np.mean(((s[:, :-1] - middle) / (1 - middle)) ** 2, axis=1)
        top, base = (sketch.crown.get(end, 0.0) * squared_distance for end in (1, 0))
        s[:, -1] += base * (1 - s[:, -1]) - top * s[:, -1]
        image = x.copy()
        image[:, :dim] = self.lower + s * self.size
        return image

    def _side_nodes(self, side: BoxSide) -> npt.NDArray[np.int32]:
        facet = self.sketch.dim - 1
        mesh = self.body.spaces.mesh
        mesh.topology.create_connectivity(facet, mesh.topology.dim)
        return fem.locate_dofs_topological(self.space, facet, self.facets[side])

    def _make_conditions_and_prescribed_mask(
        self,
    ) -> tuple[list[fem.DirichletBC], npt.NDArray[np.bool_]]:
        """Return the conditions, and the mask (nodes, dim) of prescribed displacements."""
        sketch, dim = self.sketch, self.sketch.dim
        conditions, prescribed_mask = [], np.zeros(self.x.shape, dtype=bool)
        for side, axis, lift in sketch.prescribed:
            nodes = self._side_nodes(side)
            prescribed_mask[nodes, axis] = True
            value = default_scalar_type(lift * sketch.strain * self.size[-1])
            dofs = (nodes * dim + axis).astype(np.int32)
            conditions.append(fem.dirichletbc(value, dofs, self.space.sub(axis)))
        return conditions, prescribed_mask

    def _assemble_loads(self, K: PETSc.Mat) -> list[PETSc.Vec]:
        """Return the load vectors of all increments."""
        sketch = self.sketch
        stress_unit = sketch.modulus * sketch.strain
        vectors_of_loads = []
        for side, kind, pressing, dragging in sketch.loads:
            vectors = [stress_unit * np.array(vector) for vector in (pressing, dragging)]
            if kind == "traction":
                measure = boundary_measure(self.body.spaces.mesh, self.facets[side])
                forms = [self.body.surface_load(vector, measure) for vector in vectors]
                vectors_of_loads.append([assemble_vector(form) for form in forms])
            else:
                area = 0.3 * self._side_area(side)
                where = self._middle_node_marker(side)
                vectors_of_loads.append(
                    [nodal_load(self.space, where, area * vector) for vector in vectors]
                )
        loads = []
        for press, drag in sketch.steps:
            load = K.createVecLeft()
            load.set(0.0)
            for pressing, dragging in vectors_of_loads:
                load.axpy(max(press, 0.0), pressing)
                load.axpy(drag, dragging)
            loads.append(load)
        return loads

    def _middle_node_marker(self, side: BoxSide) -> Callable[[Array], npt.NDArray[np.bool_]]:
        """Return a function that marks the node nearest to the middle of a side."""
        x = self._gather_positions(self._side_nodes(side))
        middle = self.lower + 0.5 * self.size
        middle[side[0]] = self.lower[side[0]] + side[1] * self.size[side[0]]
        node_x = x[np.argmin(np.linalg.norm(x - middle, axis=1))]
        tolerance = 1e-6 * self.size.min()
        return lambda x: np.linalg.norm(x[: len(node_x)].T - node_x, axis=1) < tolerance

    def _gather_positions(self, nodes: npt.NDArray[np.int32]) -> Array:
        """Return the positions of the nodes of all processes, in the same order on each process."""
        local_x = self.x[nodes[nodes < self.owned]]
        x = np.concatenate(self.comm.allgather(local_x))
        return x[np.lexsort(np.round(x / self.size.max(), 9).T)]

    def _side_area(self, side: BoxSide) -> float:
        """Return the area of a side: with the thickness, or around the axis in axisymmetry."""
        lengths = np.delete(self.size, side[0])
        area = float(np.prod(lengths))
        if self.sketch.state == "axisymmetric":
            inner, outer = self.lower[0], self.lower[0] + self.size[0]
            radius = (inner + outer) / 2 if side[0] else (inner, outer)[side[1]]
            area *= 2 * np.pi * radius
        return area * (self.sketch.thickness if self.sketch.state.startswith("plane") else 1.0)

    # -- its contacts ------------------------------------------------------------------------

    def _contact_node_mask(
        self, pair: PairSketch, prescribed_mask: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """Return the mask of a pair's nodes, without those with prescribed normal displacements."""
        side, dim = pair.side, self.sketch.dim
        range_axis = 0 if side[0] else 1
        s = (self.x[:, range_axis] - self.lower[range_axis]) / self.size[range_axis]
        touching = np.zeros(len(self.x), dtype=bool)
        touching[self._side_nodes(side)] = True
        touching &= (s > pair.side_range[0] - 1e-6) & (s < pair.side_range[1] + 1e-6)
        for axis in range(dim):
            touching &= ~(
                prescribed_mask[:, axis] & ~self._mask_of_normals_orthogonal_to_axis(pair, axis)
            )
        return touching

    def _mask_of_normals_orthogonal_to_axis(
        self, pair: PairSketch, axis: int
    ) -> npt.NDArray[np.bool_]:
        """Return the mask of nodes whose surface normal is always orthogonal to an axis."""
        if axis == pair.side[0]:
            return np.zeros(len(self.x), dtype=bool)
        number = self._tangential_axes(pair.side).index(axis)
        suffix = "" if number == 0 else " 1"
        if pair.kind in ("sphere", "signed distance"):
            centre = (
                self.lower[axis] + self._surface_middle_in_box_units(pair)[number] * self.size[axis]
            )
            does_not_move = pair.normal_drive == "rest" or pair.tangential_drive == "held"
            return does_not_move & (np.abs(self.x[:, axis] - centre) < 1e-9 * self.size[axis])
        has_no_slope = pair.kind in ("parabola", "flat punch")
        has_no_slope |= pair.kind == "plane" and pair.shape["slope" + suffix] == 0.0
        return np.full(len(self.x), has_no_slope)

    def _tangential_axes(self, side: BoxSide) -> list[int]:
        """Return the axes that are parallel to a side."""
        return [axis for axis in range(self.sketch.dim) if axis != side[0]]

    def _surface_middle_in_box_units(self, pair: PairSketch) -> Array:
        """Return the middle of the surface along the side's axes, in units of the box's lengths."""
        low, high = pair.side_range
        middle = low + pair.shape["place"] * (high - low)
        return np.array([middle, pair.shape["place 1"]])[: self.sketch.dim - 1]

    def _make_pair(self, pair: PairSketch, node_mask: npt.NDArray[np.bool_]) -> ContactPair:
        """Return the contact pair of a sketch with the nodes in a mask."""
        surface = self._make_surface(pair, self._gather_positions(np.flatnonzero(node_mask)))
        # nodes are given as a mask for odd seeds, and as numbers for even ones
        nodes = node_mask if self.sketch.seed % 2 else np.flatnonzero(node_mask).astype(np.int32)
        return ContactPair(nodes, surface, self._make_friction(pair), self._make_motions(pair))

    def _make_surface(self, pair: PairSketch, positions: Array) -> Surface:
        """Return the surface of a pair, at the pair's gap from the nearest given position."""
        side, shape = pair.side, pair.shape
        axes = self._tangential_axes(side)
        outward = np.zeros(self.sketch.dim)
        outward[side[0]] = 2 * side[1] - 1
        gap = pair.gap * self.sketch.strain * self.size[-1]
        if pair.kind == "plane":
            direction = -outward
            direction[axes] = [shape["slope"], shape["slope 1"]][: len(axes)]
            return Plane(positions[np.argmin(positions @ direction)] + gap * outward, direction)
        # the point of the surface nearest to the side
        surface_point = np.zeros(self.sketch.dim)
        surface_point[axes] = (
            self.lower[axes] + self._surface_middle_in_box_units(pair) * self.size[axes]
        )
        surface_point += (positions @ outward).max() * outward
        for _ in range(4):
            surface = self._make_surface_through(pair, surface_point, outward, axes)
            nearest = surface.gap(positions).min()
            if np.isfinite(nearest):
                surface_point -= (nearest - gap) * outward
        return surface

    def _make_surface_through(
        self, pair: PairSketch, surface_point: Array, outward: Array, axes: list[int]
    ) -> Surface:
        """Return the surface of a pair that passes through a point next to the side."""
        shape, width = pair.shape, self.size[axes].max()
        if pair.kind == "sphere":
            radius = shape["radius"] * width
            return Sphere(surface_point + radius * outward, radius)
        if pair.kind == "parabola":
            return Parabola(surface_point, shape["radius"] * width * outward[-1])
        if pair.kind == "flat punch":
            return FlatPunch(surface_point, -outward, shape["half width"] * width)
        if pair.kind == "signed distance":
            return _ellipsoid_level_set(surface_point, outward, width, shape)
        tangent = np.zeros(2)
        tangent[axes] = 1.0
        s = width * np.array([-2.0, -shape["flat"], shape["flat"], 2.0])
        flank_length = 2.0 - shape["flat"]
        depth = width * flank_length * np.array([shape["left"], 0.0, 0.0, shape["right"]])
        points = surface_point + s[:, None] * tangent + depth[:, None] * outward
        if tangent[1] * outward[0] - tangent[0] * outward[1] < 0:  # the body has to lie on the left
            points = points[::-1]
        return PolylineSurface(points, shape["rounding"] * shape["flat"] * width)

    def _make_friction(self, pair: PairSketch) -> float | Callable[[Array], Array]:
        """Return the friction coefficient of a pair, or a function of positions."""
        if pair.friction == "constant":
            return pair.mu
        range_axis = 0 if pair.side[0] else 1
        lower, size = self.lower[range_axis], self.size[range_axis]

        def friction(x: Array) -> Array:
            s = (x[range_axis] - lower) / size
            return pair.mu * (0.5 + 0.5 * s if pair.friction == "graded" else (s > 0.4999))

        return friction

    def _make_motions(self, pair: PairSketch) -> list[Motion]:
        """Return the motions of a pair's surface in all increments."""
        if pair.normal_drive == "rest":
            return []
        sketch, side, axes = self.sketch, pair.side, self._tangential_axes(pair.side)
        outward = 2 * side[1] - 1
        depth = pair.press * sketch.strain * self.size[-1]
        force = pair.press * sketch.strain * sketch.modulus * self._side_area(side)
        motions = []
        for press, drag in sketch.steps:
            translation: list[float | None] = [0.0] * sketch.dim
            forces = np.zeros(sketch.dim)
            if pair.normal_drive == "moved":
                translation[side[0]] = -outward * (press + pair.gap / pair.press) * depth
            else:
                translation[side[0]] = None
                forces[side[0]] = -outward * max(press, 0.0) * force
            for axis, drag_factor in zip(axes, pair.drag, strict=True):
                if pair.tangential_drive == "moved":
                    translation[axis] = drag * drag_factor * depth
                elif pair.tangential_drive == "free":
                    translation[axis] = None
                    forces[axis] = drag * drag_factor * pair.mu * force * max(press, 0.0)
            motions.append(Motion(translation, forces.tolist()))
        return motions


def _ellipsoid_level_set(
    surface_point: Array, outward: Array, width: float, shape: dict[str, float]
) -> SignedDistance:
    """Return an ellipse or ellipsoid, given by a level-set function that is not a distance."""
    axes = np.where(outward == 0, shape["long"], shape["short"]) * width
    centre = surface_point + shape["short"] * width * outward

    def level_set_value(x: Array) -> Array:
        return np.sum(((x - centre) / axes) ** 2, axis=1) - 1.0

    def gradient(x: Array) -> Array:
        return 2 * (x - centre) / axes**2

    return SignedDistance(
        level_set_value, gradient if shape["gradient"] else None, 1e-6 * float(axes.min())
    )

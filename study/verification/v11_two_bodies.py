"""Contact of two deformable bodies whose meshes do not match, by the ways of `mortar_ways`."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import basix
import gmsh
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import CellType, Mesh, create_box, create_rectangle
from scipy.spatial import cKDTree

from pw_elements import Spaces, SurfaceNodes, assemble_matrix, prescribe
from pw_elements.contact import STICK, Motion
from pw_elements.contact.interface import Trace, compute_cell_sizes, gather_trace
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh, move_nodes
from pw_elements.spaces import locate_exterior_facets
from study.meshes.graded_meshes import joined
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_families import meshed
from study.meshes.mesh_lines import OUTER, graded, growing
from study.meshes.solid_meshes import box
from study.model.reading import compared
from study.model.units import dimensionless
from study.model.vocabulary import WAYS
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions.calculix.calculix import peer_of, tracked_digest
from study.solutions.calculix.two_bodies import PAIRS, Blocks
from study.solutions.half_space import Elastic, HertzLine, HertzSphere
from study.solutions.stick_slip import Cattaneo
from study.verification.mortar_ways import NEW, Solution, TwoBodies

SECTION = "V11"
TITLE = "Two deformable bodies"

Array = npt.NDArray[np.floating[Any]]
Doubles = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Facets = npt.NDArray[np.int32]

# Lengths over the half width or radius of the contact, stresses over the lower body's E
POISSONS_RATIO = 0.3
MODULI = (1.0, 3.0)
RATIO = 0.7  # of the master's edges' number to the slave's
RADIUS = 1e3  # of the relative curvature, so large that slopes are small
PRESSURE = 1e-3  # of patches
END = 0.83  # of the narrower block
FAR, ZONE, GROWTH = 5.0, 1.4, 1.3  # sides of plane bodies, where they may touch, their cells
PLACE = 0.375  # where the contact's edge lies in an element
INNER = 0.8
FRICTION, SHARE = 0.4, 0.5  # of partial slip
ROUGH = 0.3  # of unequal bodies
CALCULIX_DEGREE = 2  # what its four points in a tetrahedron integrate exactly
TWOFOLD, OPEN = 2.0, 1e-9  # of pressures that vary slowly, and over the largest one that are none
FINEST_EDGES = 32  # by which others are judged

# NAFEMS R0094-1 in N and mm: steel cylinder, aluminium block, their half widths and height, force
CYLINDER, BLOCK, HEIGHT, FORCE = 50.0, 100.0, 200.0, 35e3
STEEL, ALUMINIUM = 210e3, 70e3
FINEST, COARSENING, AROUND = 0.6, 0.12, 9.0  # sizes of cells, and distance up to which they stay
LOADED = 30.0  # half width of the load on top
EXPECTED_WIDTH, EXPECTED_PEAK = 6.215, 3585.4  # Hertz's, as the benchmark has them


def patch(way: str, dim: int) -> Result:
    """A block on another, pressed evenly: uniaxial stress."""
    return _blocks(way, dim, 1.0)


def overhang(way: str, dim: int) -> Result:
    """The same where the slave is wider; what the master leaves of it is pressed by loads."""
    return _blocks(way, dim, END)


def _blocks(way: str, dim: int, width: float) -> Result:
    two, up = _two_blocks(way, dim, width), dim - 1
    down = np.zeros(dim)
    down[up] = -PRESSURE
    load = two.load(down, lambda x: np.isclose(x[up], 2.0))
    if width < 1:
        nodes, forces = _beyond(gather_trace(two.space, two.slave), width, way in NEW)
        values = load.array.reshape(-1, dim)
        np.add.at(values[:, up], nodes, -PRESSURE * forces)
        load.array[:] = values.ravel()
    symmetry = [prescribe(two.space, i, _at(i, 0.0)) for i in range(dim)]
    found = two.solve(load, symmetry)
    x = two.x[found.node]
    # on the end itself part of a node's weights is loaded
    return _result(two, found, np.where(x[:, 0] < width + 1, PRESSURE, 0.0), PRESSURE, np.inf)


def _two_blocks(way: str, dim: int, width: float) -> TwoBodies:
    """The upper one of a width, on one as wide as 1."""
    up, count = dim - 1, (4, 7) if dim == 2 else (2, 3)

    def block(n: int, bottom: float) -> Mesh:
        build, cell = (create_rectangle, "triangle") if dim == 2 else (create_box, "tetrahedron")
        ends = [[0.0] * up + [bottom], [1.0] * up + [bottom + 1]]
        return build(MPI.COMM_SELF, ends, [n, n + 1, n][:dim], CellType[cell])

    narrow = move_nodes(block(count[0], 1.0), lambda x: x * [width, 1.0, 1.0])
    mesh, low = joined(block(count[1], 0.0), narrow)
    state = StressState.PLANE_STRAIN if dim == 2 else StressState.SOLID
    sides = _sides(mesh, low, lambda x: np.isclose(x[up], 1.0))
    return TwoBodies.of(way, mesh, low, (1.0, 1.0), POISSONS_RATIO, state, sides)


def _beyond(trace: Trace, end: float, linear: bool) -> tuple[npt.NDArray[np.int64], Array]:
    """Nodes and integrals of their test functions over what has x > end, of a flat trace.

    Sub-facets are cut at the end and rules of degree 2 put on what is left.
    """
    nodes, corners, _ = trace.sub_facets
    points, weights = basix.make_quadrature(
        {2: basix.CellType.interval, 3: basix.CellType.triangle}[trace.dim], 2
    )
    rule, weights = np.column_stack([1 - points.sum(axis=1), points]), weights / weights.sum()
    at, values = [], []
    for part in range(len(corners)):
        corner: Array = corners[part]
        kept: list[Array] = []
        ends: list[Array] = [np.eye(trace.dim)[k] for k in range(trace.dim)]
        for a, b in zip(ends, ends[1:] + ends[:1], strict=True):
            xa, xb = (float(c @ corner[:, 0]) for c in (a, b))
            if xa > end:
                kept.append(a)
            if (xa > end) != (xb > end):
                kept.append(a + (end - xa) / (xb - xa) * (b - a))
        if trace.dim == 2:
            pieces = [kept[:2]] if len(kept) > 1 else []
        else:
            pieces = [[kept[0], *kept[i : i + 2]] for i in range(1, len(kept) - 1)]
        for piece in pieces:
            share = np.array(piece)
            size = compute_cell_sizes((share @ corner)[None])[0]
            place = rule @ share
            if linear:
                at.append(nodes[part])
                values.append(size * weights @ place)
            else:
                which, N = trace.evaluate_trial_functions(np.full(len(place), part), place)
                at.append(which[0])
                values.append(size * weights @ N)
    return np.concatenate(at), np.concatenate(values)


def hertz(way: str, edges: int, ratio: float = RATIO) -> Result:
    """Half of two cylinders of unequal moduli without friction; far fields are exact."""
    lower, upper = (Elastic(E, POISSONS_RATIO) for E in MODULI)
    force = np.pi / (4 * RADIUS) / _compliance(lower, upper)
    known = [HertzLine(b, np.pi * b.plane_modulus / (4 * force), force) for b in (lower, upper)]
    two = _halves(way, edges, ratio)
    moved = _far_field(two, known, lambda k, x: k.displacement(x))
    symmetry = prescribe(two.space, 0, lambda x: np.isclose(x[0], 0.0) & ~_far(x))
    found = two.solve(two.K.createVecLeft(), [moved, symmetry])
    x = two.x[found.node][:, 0]
    return _result(two, found, known[0].pressure(x), known[0].peak, INNER, force / 2)


def unequal(way: str, edges: int) -> Result:
    """Two cylinders of unequal moduli pressed with friction, the sides moved as without it.

    Errors are differences from a mesh of 32 edges.
    """
    result, fine = (_unequal(way, n) for n in (edges, FINEST_EDGES))
    x, area = result.curves["x"][:, 0], result.curves["area"]
    of = {
        name: np.interp(x, fine.curves["x"][:, 0], fine.curves[name])
        for name in ("pressure", "shear")
    }
    off = {name: np.abs(result.curves[name] - exact) for name, exact in of.items()}
    inner = x < INNER
    scalars = {
        "pressure_error": off["pressure"][inner].max(),
        "pressure_error_median": np.median(off["pressure"][inner]),
        "pressure_l2": np.sqrt(
            (area * off["pressure"] ** 2).sum() / (area * of["pressure"] ** 2).sum()
        ),
        "shear_error": off["shear"][inner].max(),
        "stick_off": abs(result.scalars["stick"] - fine.scalars["stick"]) * edges,
        "force_error": abs(result.scalars["force"] / fine.scalars["force"] - 1),
    }
    numbers = {**result.scalars, **{name: float(value) for name, value in scalars.items()}}
    del numbers["force"]
    curves = {**result.curves, "exact_pressure": of["pressure"], "exact_shear": of["shear"]}
    return replace(result, scalars=numbers, units=dimensionless(numbers), curves=curves)


def _unequal(way: str, edges: int) -> Result:
    lower, upper = (Elastic(E, POISSONS_RATIO) for E in MODULI)
    force = np.pi / (4 * RADIUS) / _compliance(lower, upper)
    known = [HertzLine(b, np.pi * b.plane_modulus / (4 * force), force) for b in (lower, upper)]
    two = _halves(way, edges, RATIO)
    moved = _far_field(two, known, lambda k, x: k.displacement(x))
    symmetry = prescribe(two.space, 0, lambda x: np.isclose(x[0], 0.0) & ~_far(x))
    found = two.solve(two.K.createVecLeft(), [moved, symmetry], ROUGH)
    x = two.x[found.node][:, 0]
    (pair,) = found.states[-1].pairs
    pressed = float(pair.force_normal.sum()) / force
    sticking = {"stick": float(x[pair.status == STICK].max(initial=0.0)), "force": pressed}
    shear = pair.force_tangential[:, 0] / found.area / known[0].peak
    exact, peak, curves = known[0].pressure(x), known[0].peak, {"shear": shear}
    return _result(two, found, exact, peak, INNER, force / 2, sticking, curves)


def cattaneo(way: str, edges: int) -> Result:
    """Two equal cylinders pressed and then pushed by forces, their approach and shift free."""
    body = Elastic(1.0, POISSONS_RATIO)
    force = np.pi / (4 * RADIUS) / _compliance(body, body)
    known = Cattaneo(1.0, force, FRICTION, SHARE)
    two = _halves(way, edges, RATIO, (1.0, 1.0), whole=True)
    loads = []
    for share in (0.0, SHARE / 2, SHARE):
        moved = two.K.createVecRight()
        nodes = fem.locate_dofs_geometrical(two.space, _far)
        x = two.x[nodes]
        upper = (_upper(two)[nodes])[:, None]
        field = _pushed(body, force, share, np.where(upper, -x, x))
        moved.array.reshape(-1, 2)[nodes] = np.where(upper, -field, field)
        load = two.K * moved
        load.scale(-1.0)
        loads.append(load)
    held = [prescribe(two.space, i, _far) for i in (0, 1)]
    motions = [
        Motion((None, None), (share * FRICTION * force, -force))
        for share in (0.0, SHARE / 2, SHARE)
    ]
    motions[0] = Motion((0.0, None), (0.0, -force))
    found = two.solve(loads, held, FRICTION, motions)
    x = two.x[found.node][:, 0]
    (pair,) = found.states[-1].pairs
    scale = FRICTION * known.peak
    shear = pair.force_tangential[:, 0] / found.area
    away = (np.abs(np.abs(x) - known.stick) > 1.5 / edges) & (np.abs(x) < 1 - 1.5 / edges)
    sticking = x[pair.status == STICK]
    further = {
        "stick": float(np.ptp(sticking)) / 2,
        "stick_off": abs(float(np.ptp(sticking)) / 2 - known.stick) * edges,
        "shear_error": float(np.abs(shear - known.shear(x))[away].max()) / scale,
    }
    curves = {"shear": shear / known.peak, "exact_shear": known.shear(x) / known.peak}
    return _result(two, found, known.pressure(x), known.peak, INNER, force, further, curves)


def spheres(way: str, edges: float, ratio: float = 0.71) -> Result:
    """A quarter of two spheres of unequal moduli without friction; far fields are exact."""
    two, known = _two_spheres(way, edges, ratio)
    force = known[0].force

    def beyond(x: Array) -> Mask:
        return (np.abs(x[2]) > OUTER - 1e-9) | np.isclose(np.maximum(x[0], x[1]), OUTER)

    nodes = fem.locate_dofs_geometrical(two.space, beyond)
    x, above = two.x[nodes], _upper(two)[nodes]
    field = fem.Function(two.space)
    values = field.x.array.reshape(-1, 3)
    for body, of, turn in zip(known, (~above, above), (1.0, -1.0), strict=True):
        r = np.hypot(x[of, 0], x[of, 1])
        moved = body.displacement(np.column_stack([r, turn * x[of, 2]]))
        values[nodes[of], :2] = moved[:, :1] * x[of, :2] / np.maximum(r, 1e-12)[:, None]
        values[nodes[of], 2] = turn * moved[:, 1]
    values[nodes[above], 2] -= sum(body.approach for body in known)
    conditions = [fem.dirichletbc(field, nodes)]

    def symmetry(axis: int) -> Callable[[Array], Mask]:
        return lambda p: np.isclose(p[axis], 0.0) & ~beyond(p)

    conditions += [prescribe(two.space, i, symmetry(i)) for i in (0, 1)]
    found = two.solve(two.K.createVecLeft(), conditions)
    r = np.linalg.norm(two.x[found.node][:, :2], axis=1)
    return _result(two, found, known[0].pressure(r), known[0].peak, INNER, force / 4)


def _two_spheres(way: str, edges: float, ratio: float) -> tuple[TwoBodies, list[HertzSphere]]:
    """A quarter of both, and their exact fields."""
    bodies = [Elastic(E, POISSONS_RATIO) for E in MODULI]
    force = 4 / 3 / RADIUS / _compliance(*bodies)
    known = [HertzSphere(b, 4 * b.plane_modulus / (3 * force), force) for b in bodies]
    lines = graded(edges)
    other = graded(edges * ratio)
    lower = box("tetrahedron", lines.beside, lines.beside, lines.below)
    upper = curved_mesh(
        box("tetrahedron", other.beside, other.beside, -other.below[::-1]),
        lambda x: x + (x[:, :1] ** 2 + x[:, 1:2] ** 2) / (2 * RADIUS) * [0.0, 0.0, 1.0],
    )
    mesh, low = joined(curved_mesh(lower, lambda x: x), upper)

    def near(x: Array) -> Mask:
        return np.abs(x[2]) < (x[0] ** 2 + x[1] ** 2) / (2 * RADIUS) + 1e-9

    sides = _sides(mesh, low, near)
    two = TwoBodies.of(way, mesh, low, MODULI, POISSONS_RATIO, StressState.SOLID, sides)
    return _within(two, lambda x: np.maximum(x[:, 0], x[:, 1]) < lines.zone + 1e-9), known


def calculix(case: str, tracked: str) -> Result:
    """What CalculiX says of the same bodies on the same mesh.

    Pressures are those that it gives to the slave's nodes; nodal forces are residuals of the
    standard element, with its quadrature, under its displacements.
    """
    problem, peer = PAIRS[case], peer_of(case, tracked)
    known: list[HertzSphere] = []
    if isinstance(problem, Blocks):
        two = _two_blocks("p2-p2", 3, 1.0)
    else:
        two, known = _two_spheres("p2-p2", problem.edges, problem.other)
    x, place = two.x, problem.nodes
    # nodes of both may coincide: each body's are moved apart from the other's
    face, of_lower = place[problem.slave[0] - 1, -1], len(problem.grids[0].places)
    theirs = np.column_stack([place, np.arange(len(place)) >= of_lower])
    distance, number = cKDTree(theirs).query(np.column_stack([x, _upper(two, face)]))
    assert distance.max() < 1e-9
    assert len(np.unique(number)) == len(place) == len(x)
    moved = np.zeros_like(place)
    moved[problem.around - 1] = peer.numbers["displacement"].reshape(-1, 3)
    body = replace(two.body, quadrature_degree=CALCULIX_DEGREE)
    u = two.K.createVecRight()
    u.setArray(moved[number].ravel())
    residual = (assemble_matrix(body.stiffness()) * u).array_r.reshape(x.shape)
    surface = SurfaceNodes.from_body(two.body, two.slave)
    opposite = gather_trace(two.space, two.master).nodes
    force = np.zeros_like(x)
    for nodes in (surface.node, opposite):
        force[nodes, -1] = residual[nodes, -1]
    pressure = np.zeros(len(place))
    pressure[problem.slave - 1] = peer.numbers["pressure"]
    at, area = surface.node, surface.tributary_area
    pressures = pressure[number[at]]
    found = Solution(at, pressures, area, force, opposite, moved[number], 0, True, [])
    if isinstance(problem, Blocks):
        exact = np.full(len(at), problem.pressure)
        result = _result(two, found, exact, problem.pressure, np.inf)
    else:
        r = np.linalg.norm(x[at, :-1], axis=1)
        result = _result(two, found, known[0].pressure(r), known[0].peak, INNER, known[0].force / 4)
    numbers = {k: v for k, v in result.scalars.items() if k not in ("iterations", "settled")}
    return replace(result, scalars=numbers, units=dimensionless(numbers))


def r0094(way: str) -> Result:
    """NAFEMS R0094-1 as it stands: half of a steel cylinder pressed into an aluminium block."""

    def cylinder() -> None:
        disc = gmsh.model.occ.addDisk(0, CYLINDER, 0, CYLINDER, CYLINDER)
        half = gmsh.model.occ.addRectangle(0, 0, 0, CYLINDER, 2 * CYLINDER)
        gmsh.model.occ.intersect([(2, disc)], [(2, half)])

    def block() -> None:
        gmsh.model.occ.addRectangle(0, -HEIGHT, 0, BLOCK, HEIGHT)

    def growth(finest: float) -> str:
        return f"{finest} + {COARSENING} * Max(0, Sqrt(x * x + y * y) - {AROUND})"

    above = meshed(cylinder, 2, FINEST, 2, growth(FINEST))
    below = meshed(block, 2, FINEST / RATIO, 2, growth(FINEST / RATIO))
    mesh, low = joined(below, above)

    def near(x: Array) -> Mask:
        return (x[0] < 2 * AROUND) & (
            np.isclose(x[1], 0.0)
            | (np.isclose(np.hypot(x[0], x[1] - CYLINDER), CYLINDER) & (x[1] < CYLINDER))
        )

    def top(x: Array) -> Mask:
        round_ = np.isclose(np.hypot(x[0], x[1] - CYLINDER), CYLINDER)
        return round_ & (x[1] > CYLINDER) & (x[0] < LOADED)

    lower, upper = _sides(mesh, low, near)
    two = TwoBodies.of(
        way, mesh, low, (ALUMINIUM, STEEL), POISSONS_RATIO, StressState.PLANE_STRAIN, (upper, lower)
    )
    two = _within(two, lambda x: x[:, 0] < AROUND)
    load = two.load((0.0, -1.0), top)
    load.scale(FORCE / 2 / -load.sum())
    symmetry = [prescribe(two.space, 0, _at(0, 0.0)), prescribe(two.space, 1, _at(1, -HEIGHT))]
    found = two.solve(load, symmetry)
    x = two.x[found.node][:, 0]
    bodies = Elastic(ALUMINIUM, POISSONS_RATIO), Elastic(STEEL, POISSONS_RATIO)
    width = np.sqrt(4 * FORCE * CYLINDER * _compliance(*bodies) / np.pi)
    peak = 2 * FORCE / (np.pi * width)
    exact = peak * np.sqrt(np.maximum(0.0, 1 - (x / width) ** 2))
    # p² = p0² (1 - x²/a²) is a straight line over x²
    fitted = (x < 0.9 * width) & ~np.isnan(found.pressure)
    slope, start = np.polyfit(x[fitted] ** 2, found.pressure[fitted] ** 2, 1)
    further = {
        "width_error": np.sqrt(start / -slope) / EXPECTED_WIDTH - 1,
        "peak_error": np.sqrt(start) / EXPECTED_PEAK - 1,
    }
    return _result(two, found, exact, peak, INNER * width, FORCE / 2, further)


def _halves(
    way: str,
    edges: int,
    ratio: float,
    moduli: tuple[float, float] = MODULI,
    whole: bool = False,
) -> TwoBodies:
    """Bodies of two cylinders, the lower one flat and the slave; half of them, or all."""

    def lines(n: int) -> tuple[Doubles, Doubles, float]:
        size = 1 / (n + PLACE)
        near = size * np.arange(np.ceil(ZONE / size) + 1)
        across = np.concatenate([near, near[-1] + growing(size, FAR - near[-1], GROWTH)[1:]])
        if whole:
            across = np.concatenate([-across[:0:-1], across])
        return across, growing(size, FAR, GROWTH), float(near[-1])

    def rounded(x: Doubles) -> Doubles:
        return x + x[:, :1] ** 2 / (2 * RADIUS) * [0.0, 1.0, 0.0]

    (x, depth, zone), (x2, height, _) = lines(edges), lines(max(1, round(ratio * edges)))
    comm = MPI.COMM_SELF
    lower = curved_mesh(on_lines(comm, x, -depth[::-1], "triangle", "left_right"), lambda x: x)
    upper = curved_mesh(on_lines(comm, x2, height, "triangle", "left_right"), rounded)
    mesh, low = joined(lower, upper)
    sides = _sides(mesh, low, lambda x: np.abs(x[1]) < x[0] ** 2 / (2 * RADIUS) + 1e-9)
    two = TwoBodies.of(way, mesh, low, moduli, POISSONS_RATIO, StressState.PLANE_STRAIN, sides)
    return _within(two, lambda x: np.abs(x[:, 0]) < zone + 1e-9)


def _within(two: TwoBodies, near: Callable[[Array], Mask]) -> TwoBodies:
    """The same with less of the slave's face: facets all of whose nodes (n, dim) are near."""
    trace = gather_trace(two.space, two.slave)
    inside = near(trace.facet_x.reshape(-1, trace.dim)).reshape(trace.facet_nodes.shape).all(axis=1)
    return TwoBodies(two.way, two.body, two.K, two.slave[inside], two.master)


def _sides(mesh: Mesh, low: Mask, near: Callable[[Array], Mask]) -> tuple[Facets, Facets]:
    """Facets of the lower and of the upper body."""
    facets, dim = locate_exterior_facets(mesh, near), mesh.topology.dim
    behind = mesh.topology.connectivity(dim - 1, dim)
    of_lower = low[behind.array[behind.offsets[facets]]]
    return facets[of_lower], facets[~of_lower]


def _upper(two: TwoBodies, face: float = 0.0) -> Mask:
    """Nodes of the body above a face."""
    space, up = two.space, two.x.shape[1] - 1
    cells = space.dofmap.list
    nodes = np.zeros(len(two.x), dtype=bool)
    nodes[cells[two.x[cells, up].mean(axis=1) > face]] = True
    return nodes


def _far_field(
    two: TwoBodies, known: list[Any], displacement: Callable[[Any, Array], Array]
) -> fem.DirichletBC:
    """Both bodies' far sides: exact displacements, the upper one's with the approach of both."""
    nodes = fem.locate_dofs_geometrical(two.space, _far)
    upper = _upper(two)[nodes]
    field = fem.Function(two.space)
    values, x = field.x.array.reshape(-1, 2), two.x[nodes]
    values[nodes[~upper]] = displacement(known[0], x[~upper])
    values[nodes[upper]] = displacement(known[1], x[upper] * [1, -1]) * [1, -1]
    values[nodes[upper], 1] -= sum(body.approach for body in known)
    return fem.dirichletbc(field, nodes)


def _pushed(body: Elastic, force: float, share: float, x: Array) -> Array:
    """Displacements (n, 2) of the lower half plane under the tractions of partial slip."""
    sources = 64
    theta = np.arange(1, sources + 1) * np.pi / (sources + 1)
    s, weight = np.cos(theta), 2 / (sources + 1) * np.sin(theta) ** 2
    pressing, none = force * weight, np.zeros(sources)
    stick = np.sqrt(1 - share)
    field = body.line_displacement(x, s, pressing, FRICTION * pressing if share else none)
    if share:
        held = (1 - share) * FRICTION * pressing
        field = field - body.line_displacement(x, stick * s, none, held)
    return np.asarray(field)


def _far(x: Array) -> Mask:
    return np.isclose(np.abs(x[0]), FAR) | np.isclose(x[1], -FAR) | (x[1] > FAR - 1e-9)


def _at(axis: int, value: float) -> Callable[[Array], Mask]:
    return lambda x: np.isclose(x[axis], value)


def _compliance(*bodies: Elastic) -> float:
    """1/E* of both."""
    return sum(1 / body.plane_modulus for body in bodies)


def _result(
    two: TwoBodies,
    found: Solution,
    exact: Array,
    scale: float,
    inner: float,
    force: float | None = None,
    further: dict[str, float] | None = None,
    curves: dict[str, Array] | None = None,
) -> Result:
    """Errors of the pressure (m,) at the slave's nodes against `exact`, forces on both bodies.

    In space errors are given on the nodes that the standard element reads, `common`, and on others.

    Args:
        two: the bodies.
        found: what a way gives.
        exact: (m,).
        scale: what errors are over.
        inner: distance from the origin within which errors count.
        force: exact total.
        further: scalars.
        curves: values (m,) to store.
    """
    x, dim = two.x, two.x.shape[1]
    at, theirs = x[found.node], x[found.opposite]
    known = ~np.isnan(found.pressure)
    error = np.where(known, np.abs(found.pressure - exact), 0.0)
    near = known & (np.linalg.norm(at[:, :-1], axis=1) < inner)
    squares = (found.area * error**2)[known].sum() / (found.area * exact**2)[known].sum()
    # positive where it presses on the master
    all_of = found.force[found.opposite, -1]
    all_of = all_of * np.sign(all_of.sum())
    mine = found.force[found.node, -1]
    # smooth pressures: away from the edge of the contact and from the ends of the faces
    middle = np.linalg.norm(theirs[:, :-1], axis=1) < (inner if np.isfinite(inner) else INNER)
    if np.isinf(inner):
        middle &= (theirs[:, :-1] > 1e-9).all(axis=1)
    mean = all_of[middle].mean()
    slowly = _slowly(two, found)
    scalars = {
        "pressure_error": error[near].max() / scale,
        "pressure_l2": np.sqrt(squares),
        "pressure_error_median": np.median(error[near]) / scale,
        "master_force_min": all_of[middle].min() / mean,
        "master_force_max": all_of[middle].max() / mean,
        "master_force_least": all_of.min() / mean,
        "slave_force_least": (mine * np.sign(mine.sum())).min() / mean,
        "iterations": found.iterations,
        "settled": found.settled,
        **found.balances(x),
        **(further or {}),
    }
    if dim == 3:
        galerkin = replace(two.body, spaces=Spaces.galerkin(two.space.mesh))
        standard = SurfaceNodes.from_body(galerkin, two.slave).pressure(np.zeros(len(at)))
        errors = compared(np.where(near, error, np.nan) / scale, standard)
        scalars |= {f"pressure_error_{of}": size for of, size in errors.items()}
    if slowly.any():
        scalars["master_force_slow"] = all_of[slowly].min() / mean
    if force is not None:
        pressed = np.abs(mine.sum())
        scalars["force_error"] = abs(pressed / force - 1)
    stored = {
        "x": at,
        "pressure": found.pressure / scale,
        "exact_pressure": exact / scale,
        "area": found.area,
        "force": mine,
        "opposite_x": theirs,
        "opposite_force": found.force[found.opposite, -1],
        **(curves or {}),
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), stored, dofs=dim * len(x))


def _slowly(two: TwoBodies, found: Solution) -> Mask:
    """Nodes of the master (k,) around which the slave's pressures differ by less than twofold.

    Those count that are no farther than a facet of each body.
    """
    dim = two.x.shape[1]
    reach: Array = np.zeros(len(two.x))
    edges = []
    for facets in (two.slave, two.master):
        trace = gather_trace(two.space, facets)
        corners = trace.facet_x[:, :dim]
        edges.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1))
    np.maximum.at(reach, trace.facet_nodes.ravel(), np.repeat(edges[1], trace.facet_nodes.shape[1]))
    known = ~np.isnan(found.pressure)
    near = cKDTree(two.x[found.node[known], :-1]).query_ball_point(
        two.x[found.opposite, :-1], reach[found.opposite] + edges[0].max()
    )
    pressures = [found.pressure[known][around] for around in near]
    least = OPEN * np.nanmax(found.pressure)
    return np.array(
        [len(p) > 0 and least < p.min() and p.max() < TWOFOLD * p.min() for p in pressures]
    )


def _case(name: str, problem: Callable[..., Result], way: str, **parameters: float) -> Case:
    in_space = problem is spheres or parameters.get("dim") == 3
    element = ("pw" if way in NEW else "galerkin") + ("-T10" if in_space else "-T6")
    stated = {"way": way, **parameters}
    return Case("V11", name.format(way), problem, stated, {"element": element})


DUAL = (*NEW, "p2-dual")
CASES = [
    _case(f"{problem.__name__}-{dim}d-{{}}", problem, way, dim=dim)
    for problem in (patch, overhang)
    for dim in (2, 3)
    for way in WAYS
]
CASES += [
    _case(f"hertz-2d-{{}}-{edges}", hertz, way, edges=edges) for way in WAYS for edges in (4, 8, 16)
]
CASES += [
    _case(f"hertz-2d-{{}}-16-ratio{ratio}", hertz, way, edges=16, ratio=ratio)
    for way in WAYS
    for ratio in (0.5, 1.0, 2.0)
]
CASES += [
    _case(f"{problem.__name__}-{{}}-{edges}", problem, "pw-dual", edges=edges)
    for problem in (cattaneo, unequal)
    for edges in (8, 16)
]
CASES += [_case("r0094-{}", r0094, way) for way in WAYS]
CASES += [_case("spheres-{}-3", spheres, way, edges=3) for way in WAYS]
# the finer and the coarser mesh of others exchanged
CASES += [_case("hertz-2d-{}-8-ratio2.0", hertz, way, edges=8, ratio=2.0) for way in DUAL]
CASES += mark_costly([_case("spheres-{}-5", spheres, way, edges=5) for way in WAYS])
CASES += mark_costly(
    [_case("spheres-{}-3.55-ratio1.41", spheres, way, edges=3.55, ratio=1.41) for way in DUAL]
)
CASES += mark_costly(
    [
        _case("spheres-{}-5-ratio1.37", spheres, way, edges=5, ratio=1.37)
        for way in ("node-to-segment", *DUAL)
    ]
)
CASES += [
    Case(
        "V11",
        f"{problem}-calculix-{way}",
        calculix,
        {"case": case, "tracked": tracked_digest(case)},
        {"element": "galerkin-T10"},
    )
    for case, problem, way in (
        ("two-blocks-surface", "patch-3d", "surface"),
        ("two-blocks-mortar", "patch-3d", "mortar"),
        ("two-spheres-surface", "spheres", "surface-3"),
        ("two-spheres-surface-stiff", "spheres", "surface-3-stiff"),
    )
]

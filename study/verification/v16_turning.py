"""Known answers of tools that turn: Carter's creep of a driven wheel, and a shaft in a bush."""

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh, create_mesh
from scipy.integrate import solve_bvp

from pw_elements import prescribe
from pw_elements.contact import OPEN, SLIP, STICK, ContactPair, ContactProblem, Motion, Sphere
from pw_elements.meshes import curved_mesh
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_lines import growing
from study.model.units import dimensionless
from study.run.store import Result
from study.verification.v16_rubber import RATIO, Array, Rubber, follow

Mask = npt.NDArray[np.bool_]

# A rigid wheel, large beside Hertz's half width of its contact, which is one; rubber's extent
RADIUS, EXTENT, GROWTH, BESIDE = 1000.0, 400.0, 1.6, 1.5
FRICTION, TRACTION, WAY = 0.3, 0.5, 4.0  # traction over friction's limit; way of the wheel

# A shaft of radius one in a bush, whose outer radius 2 is made smaller; angles of the shaft
OUTER, NARROWED, AROUND, ACROSS = 2.0, 0.15, 64, 10
ANGLES = (0.02, 0.05, 0.1, 0.3, 0.6, 1.2)
LAME = 2 * RATIO / (1 - 2 * RATIO)


def wheel(element: str, elements: int) -> Result:
    """A rigid wheel driven over incompressible rubber by a torque, under a weight.

    Forces of bodies that are alike, or of a rigid one on an incompressible one, press without
    shear; so creep is F. W. Carter's (1926, doi:10.1098/rspa.1926.0100), mu a / R (1 - (1 - Q /
    mu P)^(1/2)), if strains are small.
    """
    size = 1 / elements
    low, high = -BESIDE, BESIDE + WAY
    near = np.linspace(low, high, round((high - low) * elements) + 1)
    far = growing(size, EXTENT, GROWTH)[1:]
    lines, depths = (
        np.concatenate([low - far[::-1], near, high + far]),
        -growing(size, EXTENT, GROWTH)[::-1],
    )
    rubber = Rubber(element, on_lines(MPI.COMM_SELF, lines, depths, "triangle"))
    space = rubber.w.function_space
    held = [prescribe(space, k, lambda x: np.isclose(x[1], -EXTENT)) for k in (0, 1)]

    def above(x: Array) -> Mask:
        inside = (x[0] > low - size / 9) & (x[0] < high + size / 9)
        return np.asarray(np.isclose(x[1], 0) & inside)

    centre, force = (0.0, RADIUS), np.pi / RADIUS  # over the shear modulus
    pair = ContactPair(above, Sphere(centre, RADIUS), FRICTION, pivot=centre)
    problem = ContactProblem.of_residual(rubber.residual, rubber.w, held, pair)
    state = problem.step(problem.undeformed, motions=Motion((0.0, -1 / RADIUS)))
    state = problem.step(state, motions=Motion((0.0, None), (0.0, -force)))
    traction = TRACTION * FRICTION * force
    down, torque = (0.0, -force), -traction * RADIUS
    places = np.arange(1, round(2 * WAY * elements) + 1) * size / 2  # from node to node
    states = []
    for x in places:
        state = problem.step(state, motions=Motion((x, None), down, None, torque))
        states.append(state)
    angle = -np.array([state.pairs[0].rotation for state in states])
    creep = np.diff(angle * RADIUS, prepend=0.0) / np.diff(places, prepend=0.0) - 1
    carter = FRICTION / RADIUS * (1 - np.sqrt(1 - TRACTION))
    (last,), steady = state.pairs, places > WAY - 1
    closed, share = last.status != OPEN, last.force_normal / last.force_normal.sum()
    x = (last.position + last.displacement)[:, 0]
    half = 2 * np.sqrt(share @ (x - share @ x) ** 2)  # of an elliptic pressure
    scalars = {
        "creep_over_carter": creep[steady].mean() / carter,
        "width_over_hertz": half,
        "force_over_traction": -last.force[0] / traction,
        "balance": abs(last.torque / RADIUS / traction + 1),
        "sticking": np.mean(last.status[closed] == STICK),
        "iterations_mean": np.mean([state.iterations for state in states]),
        "cut": sum(bool(state.substates) for state in states),
    }
    curves = {"place": places, "creep": creep / carter}
    return _result(scalars, curves, rubber)


def bush(element: str) -> Result:
    """A rubber bush on a rigid shaft that turns: torques and forces of a boundary value problem."""
    rubber = Rubber(element, _ring())
    x, outside = rubber.x, np.isclose(np.hypot(*rubber.x.T), OUTER)
    narrowed = fem.Function(rubber.w.function_space)
    nodes = np.flatnonzero(outside).astype(np.int32)

    def loading(k: int, share: float) -> None:
        moved = -NARROWED / OUTER * (share if k == 0 else 1.0) * x
        narrowed.x.array[:] = np.where(outside[:, None], moved, 0.0).ravel()

    shaft = ContactPair(
        lambda x: np.isclose(np.hypot(x[0], x[1]), 1),
        Sphere((0.0, 0.0), 1.0),
        FRICTION,
        pivot=(0.0, 0.0),
    )
    motions = [Motion((0.0, 0.0), rotation=angle) for angle in (0.0, *ANGLES)]
    held = [fem.dirichletbc(narrowed, nodes)]
    run = follow(rubber, shaft, held, motions, outside, loading)
    pairs = [state.pairs[0] for state in run.states[2:]]
    torque = np.array([float(pair.torque) for pair in pairs])
    normal = np.array([pair.force_normal.sum() for pair in pairs])
    known = np.array([_twisted(angle) for angle in ANGLES])
    friction = np.linalg.norm(pairs[-1].force_tangential, axis=1).sum()
    slips = [bool(np.all(pair.status == SLIP)) for pair in pairs]
    scalars = {
        "torque_error": np.abs(torque - known[:, 0]).max() / known[-1, 0],
        "normal_error": np.abs(normal / known[:, 1] - 1).max(),
        "friction_error": abs(friction / (FRICTION * normal[-1]) - 1),
        "slip_torque_error": abs(torque[-1] / (FRICTION * normal[-1]) - 1),
        "torque": torque[-1],
        "slipping": sum(slips),
        "iterations_mean": np.mean([state.iterations for state in run.states[1:]]),
        "cut": sum(bool(state.substates) for state in run.states),
    }
    curves = {"angle": np.array(ANGLES), "torque": torque, "exact": known[:, 0]}
    return _result(scalars, curves, rubber)


def _ring() -> Mesh:
    """Triangles with curved sides on both circles."""
    radii, angles = np.linspace(1, OUTER, ACROSS + 1), 2 * np.pi * np.arange(AROUND) / AROUND
    x = radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    row, column = np.divmod(np.arange(ACROSS * AROUND), AROUND)
    following = (column + 1) % AROUND
    a, b, c, d = (
        r * AROUND + k
        for r, k in ((row, column), (row, following), (row + 1, column), (row + 1, following))
    )
    cells = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    flat = create_mesh(MPI.COMM_SELF, cells=cells, x=x.reshape(-1, 2), e=element)
    chord = np.cos(np.pi / AROUND)

    def image(x: Array) -> Array:
        away = np.hypot(x[:, 0], x[:, 1])
        middle = np.isclose(away, chord) | np.isclose(away, OUTER * chord)
        return np.asarray(x / np.where(middle, chord, 1.0)[:, None])

    return curved_mesh(flat, image)


def _twisted(angle: float) -> tuple[float, float]:
    """Torque and normal force on the shaft of the even bush, by its radii and angles alone.

    Equilibrium of energy's density W(r', r, r angle') around the axis, rho W integrated.
    """
    rho = np.linspace(1, OUTER, 41)

    def slopes(rho: Array, y: Array, p: Array) -> Array:
        r, q, _ = y
        s = LAME * np.log(q * r / rho) - 1
        right = p[0] ** 2 / (rho * r**3) + r / rho + rho * s / r - (q + s / q)
        bent = (right - LAME * (rho / r - 1 / q)) / (rho * (1 + (LAME - s) / q**2))
        return np.stack([q, bent, p[0] / (rho * r**2)])

    def pressure(y: Array) -> float:
        s = LAME * np.log(y[1] * y[0]) - 1
        return float(-(y[1] + s / y[1]))

    for slips in (False, True):

        def ends(a: Array, b: Array, p: Array, slips: bool = slips) -> Array:
            last = p[0] - FRICTION * pressure(a) if slips else a[2] + angle
            return np.array([a[0] - 1, b[0] - OUTER + NARROWED, b[2], last])

        start = np.stack([1 + (rho - 1) * (1 - NARROWED), np.full(41, 1 - NARROWED), 0 * rho])
        found = solve_bvp(slopes, ends, rho, start, p=[0.1], tol=1e-8)
        pressed = pressure(found.y[:, 0])
        if abs(found.p[0]) <= FRICTION * pressed:
            break
    return 2 * np.pi * float(found.p[0]), 2 * np.pi * pressed


def _result(scalars: dict[str, float], curves: dict[str, Array], rubber: Rubber) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=len(rubber.w.x.array))

"""Rotating tools with known solutions: a driven wheel on rubber, and a shaft in a rubber bush."""

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
from study.benchmarks.v16_sliding.exact import DEGREE, make_dimensionless_rubber_result
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_lines import geometrically_growing_lines
from study.run.store import Result
from study.solutions.rubber import (
    POISSONS_RATIO,
    Array,
    NeoHookeanBody,
    first_lame_constant_over_shear_modulus,
    solve_increments_of_tool_motion,
)

Mask = npt.NDArray[np.bool_]

FRICTION = 0.3

# A rigid wheel: lengths relative to the half width of its contact by Hertz
WHEEL_RADIUS, WHEEL_BLOCK_SIZE, WHEEL_BLOCK_GROWTH = 1000.0, 400.0, 1.6
"""Radius of the wheel, depth of the rubber (also its width beyond the uniform elements on each
side), and size ratio of adjacent elements.
"""
WHEEL_TRAVEL, FINE_MARGIN = 4.0, 1.5
"""Travel of the wheel, and length of the part with uniform elements beyond it on each side."""
TRACTION_RATIO = 0.5
"""Tangential force on the wheel over the friction limit."""

# A shaft of radius one in a bush whose outer radius is reduced
BUSH_RADIUS, OUTER_RADIUS_REDUCTION = 2.0, 0.15
BUSH_CELLS_AROUND, BUSH_CELLS_ACROSS = 64, 10
SHAFT_ANGLES = (0.02, 0.05, 0.1, 0.3, 0.6, 1.2)


def wheel(element: str, elements: int) -> Result:
    """Drive a loaded rigid wheel over incompressible rubber; compare its creep with Carter's.

    Pressing a rigid body on an incompressible one causes no shear. At small strains the creep ratio
    is therefore mu a / R (1 - (1 - Q / (mu P))^(1/2)), with the half width a of the contact, the
    radius R of the wheel, its normal force P and its tangential force Q (F. W. Carter, 1926,
    doi:10.1098/rspa.1926.0100).

    Args:
        element: Name of a hybrid element such as "pw-hybrid-T6".
        elements: Number of elements over the half width of the contact.
    """
    size = 1 / elements
    low, high = -FINE_MARGIN, FINE_MARGIN + WHEEL_TRAVEL
    near = np.linspace(low, high, round((high - low) * elements) + 1)
    far = geometrically_growing_lines(size, WHEEL_BLOCK_SIZE, WHEEL_BLOCK_GROWTH)[1:]
    lines = np.concatenate([low - far[::-1], near, high + far])
    depths = -geometrically_growing_lines(size, WHEEL_BLOCK_SIZE, WHEEL_BLOCK_GROWTH)[::-1]
    mesh = mesh_along_lines(MPI.COMM_SELF, lines, depths, "triangle")
    rubber = NeoHookeanBody(element, mesh, DEGREE[2])
    space = rubber.solution.function_space
    supports = [prescribe(space, k, lambda x: np.isclose(x[1], -WHEEL_BLOCK_SIZE)) for k in (0, 1)]

    def is_below_wheel(x: Array) -> Mask:
        is_inside = (x[0] > low - size / 9) & (x[0] < high + size / 9)
        return np.asarray(np.isclose(x[1], 0) & is_inside)

    centre, force = (0.0, WHEEL_RADIUS), np.pi / WHEEL_RADIUS  # force over the shear modulus
    pair = ContactPair(is_below_wheel, Sphere(centre, WHEEL_RADIUS), FRICTION, pivot=centre)
    problem = ContactProblem.of_residual(rubber.residual, rubber.solution, supports, pair)
    state = problem.step(problem.undeformed, motions=Motion((0.0, -1 / WHEEL_RADIUS)))
    state = problem.step(state, motions=Motion((0.0, None), (0.0, -force)))
    traction = TRACTION_RATIO * FRICTION * force
    weight, torque = (0.0, -force), -traction * WHEEL_RADIUS
    # the wheel rolls from node to node
    centre_positions = np.arange(1, round(2 * WHEEL_TRAVEL * elements) + 1) * size / 2
    states = []
    for x in centre_positions:
        state = problem.step(state, motions=Motion((x, None), weight, None, torque))
        states.append(state)
    angle = -np.array([state.pairs[0].rotation for state in states])
    rolled = np.diff(angle * WHEEL_RADIUS, prepend=0.0)
    creep = rolled / np.diff(centre_positions, prepend=0.0) - 1
    carter = FRICTION / WHEEL_RADIUS * (1 - np.sqrt(1 - TRACTION_RATIO))
    (last,), is_steady = state.pairs, centre_positions > WHEEL_TRAVEL - 1
    is_closed = last.status != OPEN
    force_fraction = last.force_normal / last.force_normal.sum()
    x = (last.position + last.displacement)[:, 0]
    # half width of an elliptic pressure with the same second moment
    half_width = 2 * np.sqrt(force_fraction @ (x - force_fraction @ x) ** 2)
    scalars = {
        "creep_over_carter": creep[is_steady].mean() / carter,
        "width_over_hertz": half_width,
        "force_over_traction": -last.force[0] / traction,
        "balance": abs(last.torque / WHEEL_RADIUS / traction + 1),
        "sticking": np.mean(last.status[is_closed] == STICK),
        "iterations_mean": np.mean([state.iterations for state in states]),
        "cut": sum(bool(state.substates) for state in states),
    }
    curves = {"place": centre_positions, "creep": creep / carter}
    return make_dimensionless_rubber_result(scalars, curves, rubber)


def bush(element: str) -> Result:
    """Turn a rigid shaft in a rubber bush; compare its torque with a one-dimensional solution.

    Args:
        element: Element name such as "pw-T6".
    """
    rubber = NeoHookeanBody(element, _make_curved_bush_mesh(), DEGREE[2])
    x, is_outside = rubber.x, np.isclose(np.hypot(*rubber.x.T), BUSH_RADIUS)
    prescribed = fem.Function(rubber.solution.function_space)
    nodes = np.flatnonzero(is_outside).astype(np.int32)

    def set_prescribed_displacements(increment: int, load_factor: float) -> None:
        fraction = load_factor if increment == 0 else 1.0
        displacement = -OUTER_RADIUS_REDUCTION / BUSH_RADIUS * fraction * x
        prescribed.x.array[:] = np.where(is_outside[:, None], displacement, 0.0).ravel()

    shaft = ContactPair(
        lambda x: np.isclose(np.hypot(x[0], x[1]), 1),
        Sphere((0.0, 0.0), 1.0),
        FRICTION,
        pivot=(0.0, 0.0),
    )
    motions = [Motion((0.0, 0.0), rotation=angle) for angle in (0.0, *SHAFT_ANGLES)]
    supports = [fem.dirichletbc(prescribed, nodes)]
    history = solve_increments_of_tool_motion(
        rubber, shaft, supports, motions, is_outside, set_prescribed_displacements
    )
    pairs = [state.pairs[0] for state in history.states[2:]]
    torque = np.array([float(pair.torque) for pair in pairs])
    normal_force = np.array([pair.force_normal.sum() for pair in pairs])
    exact = np.array([_solve_shaft_torque_and_normal_force(angle) for angle in SHAFT_ANGLES])
    friction_force = np.linalg.norm(pairs[-1].force_tangential, axis=1).sum()
    all_slip = [bool(np.all(pair.status == SLIP)) for pair in pairs]
    scalars = {
        "torque_error": np.abs(torque - exact[:, 0]).max() / exact[-1, 0],
        "normal_error": np.abs(normal_force / exact[:, 1] - 1).max(),
        "friction_error": abs(friction_force / (FRICTION * normal_force[-1]) - 1),
        "slip_torque_error": abs(torque[-1] / (FRICTION * normal_force[-1]) - 1),
        "torque": torque[-1],
        "slipping": sum(all_slip),
        "iterations_mean": np.mean([state.iterations for state in history.states[1:]]),
        "cut": sum(bool(state.substates) for state in history.states),
    }
    curves = {"angle": np.array(SHAFT_ANGLES), "torque": torque, "exact": exact[:, 0]}
    return make_dimensionless_rubber_result(scalars, curves, rubber)


def _make_curved_bush_mesh() -> Mesh:
    """Mesh the ring-shaped bush with triangles whose sides on both circles are curved."""
    radii = np.linspace(1, BUSH_RADIUS, BUSH_CELLS_ACROSS + 1)
    angles = 2 * np.pi * np.arange(BUSH_CELLS_AROUND) / BUSH_CELLS_AROUND
    x = radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    row, column = np.divmod(np.arange(BUSH_CELLS_ACROSS * BUSH_CELLS_AROUND), BUSH_CELLS_AROUND)
    next_column = (column + 1) % BUSH_CELLS_AROUND
    a, b, c, d = (
        r * BUSH_CELLS_AROUND + k
        for r, k in ((row, column), (row, next_column), (row + 1, column), (row + 1, next_column))
    )
    cells = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    straight = create_mesh(MPI.COMM_SELF, cells=cells, x=x.reshape(-1, 2), e=element)
    chord = np.cos(np.pi / BUSH_CELLS_AROUND)

    def move_midside_nodes_to_circles(x: Array) -> Array:
        radius = np.hypot(x[:, 0], x[:, 1])
        is_midside = np.isclose(radius, chord) | np.isclose(radius, BUSH_RADIUS * chord)
        return np.asarray(x / np.where(is_midside, chord, 1.0)[:, None])

    return curved_mesh(straight, move_midside_nodes_to_circles)


def _solve_shaft_torque_and_normal_force(shaft_angle: float) -> tuple[float, float]:
    """Solve the bush as a boundary value problem in the radius; return torque and normal force.

    The unknowns are the deformed radius r and the angle of rotation as functions of the undeformed
    radius rho. They make the integral of rho W stationary, where W(r', r / rho, r angle') is the
    strain-energy density. Sticking is tried first, then slip.

    Args:
        shaft_angle: Angle of rotation of the shaft in radians.

    Returns:
        Torque and total normal force on the shaft per thickness, over the shear modulus.
    """
    lame = first_lame_constant_over_shear_modulus(POISSONS_RATIO)
    rho = np.linspace(1, BUSH_RADIUS, 41)

    def evaluate_ode_derivatives(rho: Array, y: Array, p: Array) -> Array:
        r, q, _ = y
        s = lame * np.log(q * r / rho) - 1
        right = p[0] ** 2 / (rho * r**3) + r / rho + rho * s / r - (q + s / q)
        second = (right - lame * (rho / r - 1 / q)) / (rho * (1 + (lame - s) / q**2))
        return np.stack([q, second, p[0] / (rho * r**2)])

    def evaluate_shaft_pressure(y: Array) -> float:
        s = lame * np.log(y[1] * y[0]) - 1
        return float(-(y[1] + s / y[1]))

    for slips in (False, True):

        def boundary_residual(a: Array, b: Array, p: Array, slips: bool = slips) -> Array:
            friction_or_angle = (
                p[0] - FRICTION * evaluate_shaft_pressure(a) if slips else a[2] + shaft_angle
            )
            outer = b[0] - BUSH_RADIUS + OUTER_RADIUS_REDUCTION
            return np.array([a[0] - 1, outer, b[2], friction_or_angle])

        stretch = 1 - OUTER_RADIUS_REDUCTION
        start = np.stack([1 + (rho - 1) * stretch, np.full(41, stretch), 0 * rho])
        solution = solve_bvp(
            evaluate_ode_derivatives, boundary_residual, rho, start, p=[0.1], tol=1e-8
        )
        pressure = evaluate_shaft_pressure(solution.y[:, 0])
        if abs(solution.p[0]) <= FRICTION * pressure:
            break
    return 2 * np.pi * float(solution.p[0]), 2 * np.pi * pressure

"""Contact of nearly incompressible bodies: pressed in steps with friction, in space, and pushed.

Friction keeps what an increment leaves behind. On an incompressible half plane nothing moves along
the surface, so that all shear below a parabola which is pressed, in however many steps, is due to
the elements.
"""

from functools import partial

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from pw_elements import Material, SurfaceNodes, prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, Motion, Parabola, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from study.benchmarks.v10_space.page import sphere as pressed_sphere
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_lines import growing
from study.model.discretisation import discretise, displacement_space, held_nodes
from study.model.units import dimensionless
from study.run.store import Result
from study.solutions.half_space import Elastic, HertzLine
from study.solutions.indentation import INNER, OUTER, graded_square

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

NU, FRICTION = 0.4999, 0.35
# Half width of the contact 1
RADIUS, YOUNGS_MODULUS = 1e3, 1.0
PLACE = 0.375  # of the contact's edge in an element
ZONE = 1.3  # may touch, over the half width
PRESSES = 4
# The half plane that is pressed and pushed: consistent units of its own
MODULUS, PARABOLA, FORCE, PUSHES = 1000.0, 20.0, 4.0, (0.2, 0.4)
DEPTH, GROWTH = 75.0, 1.2  # over the half width of the contact


def sphere(element: str, n: int) -> Result:
    """A quarter of a rigid sphere on a half space, n elements along its contact's radius."""
    return pressed_sphere(element, n, NU)


def presses(element: str, n: int) -> Result:
    """A rough parabola pressed in four steps, n elements over the contact's half width.

    `shear_spurious` is the largest tangential traction over the nodes' own weights, over mu p0;
    `shear_spurious_inner` that for x < 0.8 a, away from the edge of the contact.
    """
    body = Elastic(YOUNGS_MODULUS, NU)
    force = np.pi * body.plane_modulus / (4 * RADIUS)
    steps = [HertzLine(body, RADIUS, force * (k + 1) / PRESSES) for k in range(PRESSES)]
    lines = np.arange(np.ceil(ZONE * (n + PLACE)) + 1) / (n + PLACE)
    block = discretise(
        element,
        partial(graded_square, lines, OUTER),
        Material(YOUNGS_MODULUS, NU),
        StressState.PLANE_STRAIN,
    )
    space, known = block.space, steps[-1]
    x = displacement_space(space).tabulate_dof_coordinates()[:, :2]
    far = np.isclose(x[:, 0], OUTER) | np.isclose(x[:, 1], -OUTER)
    outside = np.flatnonzero(far).astype(np.int32)
    middle = prescribe(space, 0, lambda p: np.isclose(p[0], 0.0))

    # what the outer sides' displacements in the half plane do, as loads
    loads = []
    for step in steps:
        sides = held_nodes(space, outside, step.displacement(x[outside]))
        load = block.K * block.supports([sides, middle]).offset
        load.scale(-1.0)
        loads.append(load)
    supports = block.supports([held_nodes(space, outside, 0 * x[outside]), middle])

    def touching(p: Array) -> Mask:
        return np.isclose(p[1], 0.0) & (p[0] < lines[-1] * (1 + 1e-9))

    down = [Motion((0.0, None), (0.0, -step.force / 2)) for step in steps]
    pair = ContactPair(touching, Parabola((0.0, 0.0), RADIUS), FRICTION, down)
    states = solve_contact(block.K, loads, supports, pair, space)
    surface = SurfaceNodes.from_body(block.body, touching)
    (contact,) = states[-1].pairs
    at = contact.position[:, 0]
    shear = surface.pressure(-contact.force_tangential[:, 0]) / (FRICTION * known.peak)
    pressure, exact = surface.pressure(contact.force_normal) / known.peak, known.pressure(at)
    inside = at < 1
    scalars = {
        "shear_spurious": float(np.nanmax(np.abs(shear))),
        "shear_spurious_inner": float(np.nanmax(np.abs(shear[at < INNER]))),
        "pressure_rms_all": _rms(pressure - exact / known.peak, inside),
        **_effort(states),
    }
    curves = {"x": at, "shear": shear, "pressure": pressure, "status": contact.status}
    return Result(scalars, dimensionless(scalars), curves, dofs=block.K.getSize()[0])


def pushed(element: str, n: int) -> Result:
    """A rough parabola pressed, and pushed in two steps, n elements over 1.3 half widths.

    `stick` is the half width of what sticks, over that of the contact: by Cattaneo and Mindlin
    sqrt(1 - Q/(mu P)) on the incompressible half plane.
    """
    plane_modulus = MODULUS / (1 - NU**2)
    a = float(np.sqrt(4 * FORCE * PARABOLA / (np.pi * plane_modulus)))
    zone, bottom = ZONE * a, -DEPTH * a
    block = discretise(
        element, partial(_both_sides, a, n), Material(MODULUS, NU), StressState.PLANE_STRAIN
    )

    def touching(p: Array) -> Mask:
        return np.isclose(p[1], 0.0) & (np.abs(p[0]) < zone * (1 + 1e-9))

    base = [prescribe(block.space, k, lambda p: np.isclose(p[1], bottom)) for k in (0, 1)]
    motions = [Motion((0.0, None), (0.0, -FORCE))]
    motions += [Motion((None, None), (q * FRICTION * FORCE, -FORCE)) for q in PUSHES]
    pair = ContactPair(touching, Parabola((0.0, 0.0), PARABOLA), FRICTION, motions)
    nothing = [block.K.createVecLeft()] * len(motions)
    states = solve_contact(block.K, nothing, block.supports(base), pair, block.space)
    (contact,) = states[-1].pairs
    x, status = np.abs(contact.position[:, 0]), contact.status
    border = (x[status == STICK].max() + x[(status != STICK) & (status != OPEN)].min()) / 2
    scalars = {"stick": float(border / a), **_effort(states)}
    curves = {"x": contact.position[:, 0] / a, "status": status}
    return Result(scalars, dimensionless(scalars), curves, dofs=block.K.getSize()[0])


def _both_sides(a: float, n: int, cell: str) -> Mesh:
    """A block for a half plane below a contact of the half width a."""
    zone = ZONE * a
    size = zone / n
    beside = zone + growing(size * GROWTH, DEPTH * a - zone, GROWTH)[1:]
    right = np.concatenate([np.linspace(0, zone, n + 1), beside])
    below = -growing(size, DEPTH * a, GROWTH)[::-1]
    return on_lines(MPI.COMM_SELF, np.concatenate([-right[:0:-1], right]), below, cell)


def _effort(states: list[ContactState]) -> dict[str, float]:
    return {
        "iterations_most": float(max(state.iterations for state in states)),
        "iterations": float(sum(state.iterations for state in states)),
        "residual": max(state.residuals.largest() for state in states),
    }


def _rms(values: Array, counts: Mask) -> float:
    return float(np.sqrt(np.mean(values[counts] ** 2)))

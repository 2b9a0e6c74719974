"""7.4 Rigid plate acting on an elastic body (Figs 11-14)."""

from functools import partial

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import Mesh

from pw_elements import Material, prescribe
from pw_elements.contact import ContactPair, FlatPunch, Motion, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern
from study.meshes.line_mesh import on_lines
from study.model.contact_result import contact_result
from study.model.discretisation import discretise
from study.model.units import KN_M
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA
from study.run.cases import Case
from study.run.store import Result

SECTION = "7.4"
TITLE = "Rigid plate acting on an elastic body"

# In kN and m. Printed: E, nu, friction angle, force, sides and base held, smallest elements under
# the plate. Reconstructed: plate 2 wide, body 40 x 10, elements growing by 1.4 away from the plate.
YOUNGS_MODULUS, POISSONS_RATIO, FRICTION_ANGLE = 1.2e8, 0.25, 20.0
FORCE = 40.0
HALF_PLATE, HALF_WIDTH, DEPTH = 1.0, 20.0, 10.0
ELEMENTS_UNDER_HALF, GROWTH = 4, 1.4
PATTERN: DiagonalPattern = "left_right"  # alternating cuts keep the symmetry
INCREMENTS = 5


def plate(
    element: str,
    friction_angle: float = FRICTION_ANGLE,
    state: str = "plane stress",
    under_half: int = ELEMENTS_UNDER_HALF,
    half_width: float = HALF_WIDTH,
    depth: float = DEPTH,
    pattern: DiagonalPattern = PATTERN,
) -> Result:
    """Contact forces below the plate, pressed by its force; `translation` is its settlement.

    `edge_force_left` and `edge_force_right` are normal forces of the nodes at the plate's edges.
    """
    build = partial(_mesh, under_half, half_width, depth, pattern)
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = discretise(element, build, material, StressState(state))
    held = [prescribe(body.space, i, partial(_sides_and_base, half_width, depth)) for i in (0, 1)]
    steps = np.arange(1, INCREMENTS + 1) / INCREMENTS
    motions = [Motion((0.0, None), (0.0, -FORCE * s)) for s in steps]
    friction = float(np.tan(np.deg2rad(friction_angle)))
    pair = ContactPair(_below, FlatPunch((0.0, 0.0), (0.0, -1.0), HALF_PLATE), friction, motions)
    nothing = [body.K.createVecLeft()] * INCREMENTS
    states = solve_contact(body.K, nothing, body.supports(held), [pair], body.space)
    (contact,) = states[-1].pairs
    return contact_result(
        body,
        states,
        nothing[-1],
        _below,
        FORCE / (2 * HALF_PLATE),
        KN_M,
        translation=-contact.translation[1],
        edge_force_left=contact.force_normal[0],
        edge_force_right=contact.force_normal[-1],
    )


def _mesh(
    under_half: int, half_width: float, depth: float, pattern: DiagonalPattern, cell: str
) -> Mesh:
    smallest = HALF_PLATE / under_half
    beside = HALF_PLATE + _growing(GROWTH * smallest, half_width - HALF_PLATE)
    right = np.concatenate([np.linspace(0, HALF_PLATE, under_half + 1), beside[1:]])
    x_lines = np.concatenate([-right[:0:-1], right])
    y_lines = -_growing(smallest, depth)[::-1]
    return on_lines(MPI.COMM_SELF, x_lines, y_lines, cell, pattern)


def _growing(first: float, length: float) -> np.ndarray:
    """Mesh lines from 0 to the length, elements growing by GROWTH; the last one is what is left.

    A remainder of less than 0.6 of the element before is added to that one.
    """
    count = int(np.log1p(length / first * (GROWTH - 1)) / np.log(GROWTH))
    steps = first * GROWTH ** np.arange(count)
    lines = np.concatenate([[0.0], np.cumsum(steps)])
    if length - lines[-1] < 0.6 * steps[-1]:
        lines = lines[:-1]
    return np.append(lines, length)


def _below(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 0.0) & (np.abs(x[0]) < HALF_PLATE + 1e-9)


def _sides_and_base(half_width: float, depth: float, x: np.ndarray) -> np.ndarray:
    return np.isclose(np.abs(x[0]), half_width) | np.isclose(x[1], -depth)


ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
CASES = [Case("7.4", element, plate, {"element": element}) for element in ELEMENTS]
CASES += [
    Case("7.4", f"{element}-mu0", plate, {"element": element, "friction_angle": 0.0})
    for element in ELEMENTS
]
CASES += [
    Case(
        "7.4", f"{element}-strain", plate, {"element": element, **UNPRINTED_DATA["7.4"]["-strain"]}
    )
    for element in ("galerkin-T6", "composite-T6", "pw-Q9")
]
CASES += [
    Case("7.4", element + suffix, plate, {"element": element, **given})
    for element in ("galerkin-Q8", "pw-T6", "pw-Q8")
    for suffix, given in UNPRINTED_DATA["7.4"].items()
]
CASES += [
    Case("7.4", element + suffix, plate, {"element": element, **given})
    for element in ("galerkin-T6", "pw-T6")
    for suffix, given in OTHER_DIAGONALS["7.4"].items()
]
CASES += [
    Case("7.4", f"{element}-fine", plate, {"element": element, "under_half": 16})
    for element in ("pw-T6", "pw-Q9")
]

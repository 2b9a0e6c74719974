"""7.2 Elastic block on a rigid surface, pressed from above and pulled to the right (Figs 6-8)."""

from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx.mesh import Mesh

from pw_elements import Material
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern, quadrilaterals, triangles
from study.model.contact_result import contact_result
from study.model.discretisation import Discretisation, discretise
from study.model.units import UNSTATED
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA
from study.run.cases import Case
from study.run.store import Result

SECTION = "7.2"
TITLE = "Elastic block on a rigid surface"

# Printed: E, nu, mu, 400 triangles or 200 quadrilaterals, the first and last contact element
# frictionless. Reconstructed: 4 x 2 with 20 x 10 squares, pressure 200, traction 60, and that the
# pressure comes first (the paper: "pressed ... and at the same time pulled").
YOUNGS_MODULUS, POISSONS_RATIO = 1000.0, 0.3
LENGTH, HEIGHT = 4.0, 2.0
PRESSURE = 200.0
FRICTION, PULL = 0.3, 0.3  # pull: tangential traction over pressure
DIVISIONS = (20, 10)
SMOOTH = 0.2  # length of the frictionless element at either end
INCREMENTS = 10  # of the pull, after the pressure


def block(
    element: str,
    friction: float = FRICTION,
    pull: float = PULL,
    divisions: tuple[int, int] = DIVISIONS,
    shared_is_rough: bool = True,
    state: str = "plane stress",
    pressed_first: bool = True,
    height: float = HEIGHT,
    pattern: DiagonalPattern = "right",
) -> Result:
    """Contact forces below the block after the last increment."""
    body = discretise(
        element,
        partial(mesh, divisions, height=height, pattern=pattern),
        Material(YOUNGS_MODULUS, POISSONS_RATIO),
        StressState(state),
    )
    loads = press_and_pull(body, pull, pressed_first, height)
    # the end element of a mesh as coarse as the paper's
    smooth = LENGTH * max(1, divisions[0] // DIVISIONS[0]) / divisions[0]
    states = on_foundation(body, loads, friction, shared_is_rough, smooth)
    return contact_result(body, states, loads[-1], lower_side, PRESSURE, UNSTATED)


def press_and_pull(
    body: Discretisation, pull: float, pressed_first: bool = True, height: float = HEIGHT
) -> list[PETSc.Vec]:
    """Loads at the end of each increment: the pressure, then the pull in equal steps, or both."""
    pressure = body.surface_load((0.0, -PRESSURE), lambda x: np.isclose(x[1], height))
    traction = body.surface_load((pull * PRESSURE, 0.0), _right_side)
    steps = [k / INCREMENTS for k in range(INCREMENTS + 1)]
    if pressed_first:
        return [pressure + traction * step for step in steps]
    return [(pressure + traction) * step for step in steps[1:]]


def on_foundation(
    body: Discretisation,
    loads: list[PETSc.Vec],
    friction: float,
    shared_is_rough: bool,
    smooth: float = SMOOTH,
) -> list[ContactState]:
    """Contact states at the end of each increment."""
    edge = smooth - 1e-9 if shared_is_rough else smooth + 1e-9

    def per_node(x: np.ndarray) -> np.ndarray:
        return np.where((x[0] > edge) & (x[0] < LENGTH - edge), friction, 0.0)

    foundation = ContactPair(lower_side, Plane((0.0, 0.0), (0.0, 1.0)), per_node)
    return solve_contact(body.K, loads, body.supports([]), [foundation], body.space)


def mesh(
    divisions: tuple[int, int],
    cell: str,
    height: float = HEIGHT,
    pattern: DiagonalPattern = "right",
) -> Mesh:
    """The block of "triangle" or "quadrilateral" cells."""
    if cell == "triangle":
        return triangles(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, height), divisions, pattern)
    return quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, height), divisions)


def lower_side(x: np.ndarray) -> np.ndarray:
    """Marker of the contact surface."""
    return np.isclose(x[1], 0.0)


def _right_side(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[0], LENGTH)


ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
CASES = [Case("7.2", element, block, {"element": element}) for element in ELEMENTS]
CASES += [
    Case("7.2", f"{element}-80x40", block, {"element": element, "divisions": (80, 40)})
    for element in ("pw-T6", "pw-Q9")
]
# Everything rough sticks: there T times the standard forces has to be the new ones exactly
CASES += [
    Case("7.2", f"{element}-stick", block, {"element": element, "friction": 5.0, "pull": 0.1})
    for element in ("galerkin-T6", "pw-T6")
]
CASES += [
    Case("7.2", element + suffix, block, {"element": element, **given})
    for element in ("galerkin-T6", "pw-T6")
    for suffix, given in OTHER_DIAGONALS["7.2"].items()
]
CASES += [
    Case("7.2", f"pw-T6{suffix}", block, {"element": "pw-T6", **given})
    for suffix, given in UNPRINTED_DATA["7.2"].items()
]
CASES += [
    Case(
        "7.2",
        "galerkin-T6-smooth",
        block,
        {"element": "galerkin-T6", **UNPRINTED_DATA["7.2"]["-smooth"]},
    )
]

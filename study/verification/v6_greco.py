"""GRECO/Raous plate on a rough rigid plane: zones that are open, slip and stick."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from pw_elements import Material, prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, Plane, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import quadrilaterals, triangles
from study.model.contact_result import contact_result
from study.model.discretisation import discretise
from study.model.units import SI
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions.stick_slip import GRECO_PLACES

SECTION = "V6"
TITLE = "GRECO plate with open, slipping and sticking zones"

Array = npt.NDArray[np.float64]

# Half of a plate, its middle at x = SIDE; code_aster's validation manual V6.04.128 (SSNV128)
SIDE = 0.04
YOUNGS_MODULUS, POISSONS_RATIO, FRICTION = 1.3e11, 0.2, 1.0
PRESSURE_TOP, PRESSURE_LEFT = 5e7, 15e7


def plate(element: str, squares: int) -> Result:
    """Displacements and contact forces of the loaded plate.

    A multiple of 16 `squares` along a side puts a node at each of the manual's places. Scalars
    besides those of `contact_result`: `u_1` to `u_5`, horizontal displacements there, and the ends
    of zones of contact, halfway between two nodes: `open_up_to` and `sticking_from`.
    """
    body = discretise(
        element,
        partial(_mesh, squares),
        Material(YOUNGS_MODULUS, POISSONS_RATIO),
        StressState.PLANE_STRAIN,
    )
    load = body.surface_load((0.0, -PRESSURE_TOP), _top)
    load.axpy(1.0, body.surface_load((PRESSURE_LEFT, 0.0), _left))
    symmetry = body.supports([prescribe(body.space, 0, _middle)])
    ground = ContactPair(_base, Plane((0.0, 0.0), (0.0, 1.0)), FRICTION)
    states = solve_contact(body.K, load, symmetry, [ground], body.space)

    result = contact_result(body, states, load, _base, PRESSURE_TOP, SI)
    u = _along_base(result.curves)
    places = [u[np.argmin(np.abs(result.curves["x"] - x))] for x in GRECO_PLACES]
    named = {f"u_{i}": float(value) for i, value in enumerate(places, start=1)}
    named |= _ends_of_zones(result.curves["x"], result.curves["status"])
    return replace(
        result,
        scalars={**result.scalars, **named},
        units={**result.units, **dict.fromkeys(named, SI.length)},
        curves={**result.curves, "u": u},
    )


def _ends_of_zones(x: Array, status: npt.NDArray[np.integer]) -> dict[str, float]:
    """Return where the open zone ends and the sticking zone begins, along nodes at x (m,)."""
    last_open = int(np.flatnonzero(status == OPEN).max())
    first_sticking = int(np.flatnonzero(status == STICK).min())
    return {
        "open_up_to": float(x[last_open : last_open + 2].mean()),
        "sticking_from": float(x[first_sticking - 1 : first_sticking + 1].mean()),
    }


def _along_base(curves: Mapping[str, np.ndarray]) -> Array:
    """Horizontal displacements of the contact nodes, in their order."""
    base = np.flatnonzero(_base(curves["nodes"].T))
    base = base[np.argsort(curves["nodes"][base, 0])]
    return curves["displacement"][base, 0]


def _mesh(squares: int, cell: str) -> Mesh:
    build = triangles if cell == "triangle" else quadrilaterals
    return build(MPI.COMM_SELF, (0.0, 0.0), (SIDE, SIDE), (squares, squares))


def _base(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0)


def _top(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], SIDE)


def _left(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


def _middle(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], SIDE)


ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
SQUARES = (16, 32, 64)
FINEST = {"pw-T6": 128, "galerkin-Q8": 128}
CASES = [
    Case("V6", f"{element}-{n}", plate, {"element": element, "squares": n})
    for element in ELEMENTS
    for n in SQUARES
]
CASES += [
    Case("V6", f"{element}-{n}", plate, {"element": element, "squares": n})
    for element, n in FINEST.items()
]
CASES = mark_costly(CASES, "galerkin-Q8-128", "composite-*-64", "*-Q[89]-64")

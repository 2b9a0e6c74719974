"""7.3 Contact of an elastic body and a parabolic rigid punch (Figs 9 and 10)."""

from collections.abc import Callable
from functools import partial

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import Mesh

from pw_elements import Material, prescribe
from pw_elements.contact import ContactPair, Motion, Parabola, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.meshes import mapped, quadrilaterals, triangles
from study.contact_result import contact_result
from study.core.cases import Case
from study.core.store import Result
from study.discretisation import Discretisation, discretise
from study.units import UNSTATED

TITLE = "Contact of an elastic body and a parabolic rigid punch"

# Printed: E, nu, mu, 76 quadrilaterals, depth 0.25, normal force about 215, tangential force a
# tenth of it. Reconstructed: width, height, the fixed base, the punch's radius, the grading, and
# that the depth is held during the push.
YOUNGS_MODULUS, POISSONS_RATIO, FRICTION = 1000.0, 0.25, 0.6
DEPTH, TANGENTIAL_SHARE = 0.25, 0.1
WIDTH, HEIGHT, RADIUS = 8.0, 4.0, 8.0
DIVISIONS = (19, 4)
GRADING = 1.5  # largest element over the central one, about
INCREMENTS = 20  # of the indentation, and of the tangential force


def punch(
    element: str,
    friction: float = FRICTION,
    divisions: tuple[int, int] = DIVISIONS,
    width: float = WIDTH,
    height: float = HEIGHT,
    radius: float = RADIUS,
    tangential_share: float = TANGENTIAL_SHARE,
) -> Result:
    """Contact forces below the punch, pressed in and then pushed to the right.

    Further scalars: `force_indentation`, before the tangential force, and the punch's
    `translation` to the right.
    """
    build = partial(_mesh, (divisions[0], divisions[1]), width, height)
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = discretise(element, build, material, StressState.PLANE_STRESS)
    solve = partial(_solve, body, friction, height, radius)

    steps = np.arange(1, INCREMENTS + 1) / INCREMENTS
    indentation = [Motion((0.0, -DEPTH * s)) for s in steps]
    states = solve(indentation)
    force = -states[-1].pairs[0].force[1]
    if tangential_share:
        pushed = tangential_share * force
        states = solve([*indentation, *(Motion((None, -DEPTH), (pushed * s, 0.0)) for s in steps)])
    return contact_result(
        body,
        states,
        body.K.createVecLeft(),
        _top(height),
        force / (2 * radius),
        UNSTATED,
        force_indentation=force,
        translation=states[-1].pairs[0].translation[0],
    )


def _solve(
    body: Discretisation, friction: float, height: float, radius: float, motions: list[Motion]
) -> list[ContactState]:
    base = [prescribe(body.space, i, _base) for i in range(2)]
    pair = ContactPair(_top(height), Parabola((0.0, height), radius), friction, motions)
    nothing = [body.K.createVecLeft()] * len(motions)
    return solve_contact(body.K, nothing, body.supports(base), [pair], body.space)


def _mesh(divisions: tuple[int, int], width: float, height: float, cell: str) -> Mesh:
    def graded(x: np.ndarray) -> np.ndarray:
        s = x[:, 0]
        stretched = (s + (GRADING - 1) * s**3) / GRADING
        return np.column_stack([width / 2 * stretched, height * x[:, 1], x[:, 2]])

    build = triangles if cell == "triangle" else quadrilaterals
    return mapped(build(MPI.COMM_SELF, (-1.0, 0.0), (1.0, 1.0), divisions), graded)


def _top(height: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.isclose(x[1], height)


def _base(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 0.0)


ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
GEOMETRIES: dict[str, dict[str, float]] = {
    "-4x2-R2": {"width": 4.0, "height": 2.0, "radius": 2.0},
    "-16x4-R8": {"width": 16.0, "height": 4.0, "radius": 8.0},
}
FINE = {"divisions": (114, 24)}
SMOOTH = {"friction": 0.0, "tangential_share": 0.0}
CASES = [Case("7.3", element, punch, {"element": element}) for element in ELEMENTS]
CASES += [
    Case("7.3", f"galerkin-Q8{name}", punch, {"element": "galerkin-Q8", **geometry})
    for name, geometry in GEOMETRIES.items()
]
CASES += [
    Case("7.3", f"{element}-mu0", punch, {"element": element, **SMOOTH}) for element in ELEMENTS
]
CASES += [
    Case("7.3", "pw-T6-114x24", punch, {"element": "pw-T6", **FINE}),
    Case("7.3", "pw-T6-mu0-114x24", punch, {"element": "pw-T6", **FINE, **SMOOTH}),
]

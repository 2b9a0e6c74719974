"""7.3 Contact of an elastic body and a parabolic rigid punch (Figs 9 and 10)."""

from collections.abc import Callable
from functools import partial

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import Mesh

from pw_elements import Material, prescribe
from pw_elements.contact import ContactPair, ContactProblem, Motion, Parabola
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern, move_nodes, quadrilaterals, triangles
from study.model.contact_result import contact_result
from study.model.discretisation import discretise
from study.model.units import UNSTATED
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA
from study.run.cases import Case
from study.run.store import Result

SECTION = "7.3"
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
    depth_held: bool = True,
    increments: int = INCREMENTS,
    pattern: DiagonalPattern = "right",
) -> Result:
    """Contact forces below the punch, pressed in and then pushed to the right.

    While it is pushed either its depth is held or its normal force.

    Further scalars: `force_indentation`, before the tangential force, and the punch's
    `translation` to the right.
    """
    build = partial(_mesh, (divisions[0], divisions[1]), width, height, pattern)
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = discretise(element, build, material, StressState.PLANE_STRESS)
    base = [prescribe(body.space, i, _base) for i in range(2)]
    pair = ContactPair(_top(height), Parabola((0.0, height), radius), friction)
    problem = ContactProblem(body.K, body.supports(base), pair, body.space)

    steps = np.arange(1, increments + 1) / increments
    states = [problem.undeformed]
    for s in steps:
        states.append(problem.step(states[-1], motions=Motion((0.0, -DEPTH * s))))
    force = -states[-1].pairs[0].force[1]
    if tangential_share:
        depth, normal = (-DEPTH, 0.0) if depth_held else (None, -force)
        for s in steps:
            push = Motion((None, depth), (tangential_share * force * s, normal))
            states.append(problem.step(states[-1], motions=push))
    return contact_result(
        body,
        states[1:],
        body.K.createVecLeft(),
        _top(height),
        force / (2 * radius),
        UNSTATED,
        force_indentation=force,
        translation=states[-1].pairs[0].translation[0],
    )


def _mesh(
    divisions: tuple[int, int], width: float, height: float, pattern: DiagonalPattern, cell: str
) -> Mesh:
    def graded(x: np.ndarray) -> np.ndarray:
        s = x[:, 0]
        stretched = (s + (GRADING - 1) * s**3) / GRADING
        return np.column_stack([width / 2 * stretched, height * x[:, 1], x[:, 2]])

    build = partial(triangles, pattern=pattern) if cell == "triangle" else quadrilaterals
    return move_nodes(build(MPI.COMM_SELF, (-1.0, 0.0), (1.0, 1.0), divisions), graded)


def _top(height: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.isclose(x[1], height)


def _base(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 0.0)


ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
FINE = {"divisions": (114, 24)}
SMOOTH = {"friction": 0.0, "tangential_share": 0.0}
CASES = [Case("7.3", element, punch, {"element": element}) for element in ELEMENTS]
CASES += [
    Case("7.3", element + suffix, punch, {"element": element, **given})
    for element in ("galerkin-T6", "pw-T6")
    for suffix, given in OTHER_DIAGONALS["7.3"].items()
]
CASES += [
    Case("7.3", f"pw-Q9{suffix}", punch, {"element": "pw-Q9", **given})
    for suffix, given in UNPRINTED_DATA["7.3"].items()
]
CASES += [
    Case("7.3", f"{element}-mu0", punch, {"element": element, **SMOOTH}) for element in ELEMENTS
]
CASES += [
    Case("7.3", "pw-T6-114x24", punch, {"element": "pw-T6", **FINE}),
    Case("7.3", "pw-T6-mu0-114x24", punch, {"element": "pw-T6", **FINE, **SMOOTH}),
    # how far the shear of the fine mesh can be trusted: another element, four times the increments
    Case(
        "7.3",
        "pw-Q9-57x12",
        punch,
        {"element": "pw-Q9", "divisions": (57, 12), "increments": 4 * INCREMENTS},
    ),
]

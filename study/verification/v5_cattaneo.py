"""Partial slip of two equal bodies in the plane: Cattaneo's and Mindlin's problem."""

from dataclasses import dataclass
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import Material, SurfaceNodes, prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, Motion, Parabola, solve_contact
from pw_elements.contact.model import ContactState, MatchingNodes
from pw_elements.elasticity import StressState
from study.meshes.graded_meshes import with_counterpart
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_lines import growing
from study.model.discretisation import Discretisation, discretise, mesh_curves
from study.model.units import dimensionless
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions.half_space import Elastic
from study.solutions.stick_slip import Cattaneo

SECTION = "V5"
TITLE = "Partial slip: Cattaneo and Mindlin"

Array = npt.NDArray[np.float64]

# Two equal cylinders in plane strain; lengths over the half width a of their contact, stresses
# over E, forces over E a. The radius
# is large, so that sliding does not move the contact, and makes the force follow from Hertz.
YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
FRICTION, SHARE = 0.4, 0.5  # mu, Q/(mu P)
RADIUS = 1e4  # of the relative curvature
FORCE = np.pi * YOUNGS_MODULUS / (2 * (1 - POISSONS_RATIO**2)) / (4 * RADIUS)
KNOWN = Cattaneo(half_width=1.0, force=FORCE, friction=FRICTION, share=SHARE)
INCREMENTS = 2  # of the tangential force

ZONE, OUTER = 1.25, 5.0  # nodes that may touch; the bodies' sides
GROWTH = 1.3  # of elements beside and below the zone
DISTANCE = 1.0  # between the meshes of both bodies
INNER, APART = 0.9, 0.1  # where tractions are compared: part of the half width, distance from c
_SOURCES = 64  # of the far field; exact to round-off on the sides


def partial_slip(
    element: str, zone_elements: int, far_field: bool = True, increments: int = INCREMENTS
) -> Result:
    """Stick zone and tractions of the lower body against the known ones.

    The sides have the displacements of half planes under the known tractions, or are held.
    `stick_off` is the error of the sticking zone's half width over the distance of nodes.
    """
    shares = SHARE * np.arange(increments + 1) / increments
    motions = [Motion((0.0, None), (0.0, -FORCE))]
    motions += [Motion((None, None), (s * FRICTION * FORCE, -FORCE)) for s in shares[1:]]
    upper = MatchingNodes(_opposite, Parabola((0.0, 0.0), RADIUS), offset=(0.0, DISTANCE))
    pair = ContactPair(_touching, upper, FRICTION, motions)
    body = discretise(
        element,
        partial(_mesh, zone_elements),
        Material(YOUNGS_MODULUS, POISSONS_RATIO),
        StressState.PLANE_STRAIN,
    )
    loads = [_held_sides(body, share, far_field) for share in shares]
    sides = body.supports([prescribe(body.space, i, _sides) for i in (0, 1)])
    return _result(body, solve_contact(body.K, loads, sides, [pair], body.space))


def _held_sides(body: Discretisation, share: float, far_field: bool) -> PETSc.Vec:
    """Load that stands for displacements of the sides, which the supports then hold."""
    moved = body.K.createVecRight()
    if far_field:
        nodes = fem.locate_dofs_geometrical(body.space, _sides)
        x = body.space.tabulate_dof_coordinates()[nodes, :2]
        upper = x[:, 1] > DISTANCE / 2
        turned = np.where(upper[:, None], [0.0, DISTANCE] - x, x)
        field = _far_field(turned, share)
        moved.array.reshape(-1, 2)[nodes] = np.where(upper[:, None], -field, field)
    load = body.K * moved
    load.scale(-1.0)
    return load


def _far_field(x: Array, share: float) -> np.ndarray:
    """Displacements (n, 2) of the lower half plane, by Gauss-Chebyshev sums of forces."""
    half_plane = Elastic(YOUNGS_MODULUS, POISSONS_RATIO)
    theta = np.arange(1, _SOURCES + 1) * np.pi / (_SOURCES + 1)
    s, weight = np.cos(theta), 2 / (_SOURCES + 1) * np.sin(theta) ** 2
    force, none = FORCE * weight, np.zeros(_SOURCES)
    if not share:
        return half_plane.line_displacement(x, s, force, none)
    stick, held = float(np.sqrt(1 - share)), (1 - share) * FRICTION * force
    field = half_plane.line_displacement(x, s, force, FRICTION * force)
    field -= half_plane.line_displacement(x, stick * s, none, held)
    return field


@dataclass(frozen=True)
class _Traction:
    """A traction along the contact: nodal forces, what is read from them and what is known."""

    force: Array
    own: Array
    known: Array

    def errors(self, x: Array, name: str) -> dict[str, float]:
        """Relative L2 errors, the second one apart from the border of stick."""
        inner = np.abs(x) < INNER
        apart = inner & (np.abs(np.abs(x) - KNOWN.stick) > APART)
        weight = np.gradient(x)

        def error(where: npt.NDArray[np.bool_]) -> float:
            squares = weight[where] * (self.own - self.known)[where] ** 2
            scale = weight[inner] * self.known[inner] ** 2
            return float(np.sqrt(squares.sum() / scale.sum()))

        return {
            f"error_{name}": error(inner),
            f"error_{name}_apart": error(apart),
        }


def _result(body: Discretisation, states: list[ContactState]) -> Result:
    (contact,) = states[-1].pairs
    surface = SurfaceNodes.from_body(body.body, _touching)
    x, status = contact.position[:, 0], contact.status
    known = (KNOWN.pressure(x), KNOWN.shear(x))
    forces = (contact.force_normal, contact.force_tangential[:, 0])
    pressure, shear = (
        _Traction(r, surface.pressure(r), t) for r, t in zip(forces, known, strict=True)
    )
    sticking, closed = x[status == STICK], status != OPEN
    left, right = (_border(x, end) for end in (sticking.min(), sticking.max()))
    scalars = {
        "force_normal": pressure.force.sum(),
        "force_tangential": shear.force.sum(),
        "iterations": sum(state.iterations for state in states),
        "residual": max(state.residuals.largest() for state in states),
        "sawtooth": surface.sawtooth(pressure.force, closed),
        "unevenness": surface.unevenness(pressure.own, closed),
        "peak_pressure": pressure.own.max(),
        "element_size": ZONE / _zone_elements(x),
        "stick": (right - left) / 2,
        "stick_centre": (right + left) / 2,
        "stick_off": abs((right - left) / 2 - KNOWN.stick) / (ZONE / _zone_elements(x) / 2),
        "stick_known": KNOWN.stick,
        "peak_known": KNOWN.peak,
        "friction": FRICTION,
        "half_width": np.abs(x[closed]).max(),
        **pressure.errors(x, "pressure"),
        **shear.errors(x, "shear"),
    }
    curves: dict[str, np.ndarray] = {
        "x": x,
        "status": status,
        "friction": contact.friction,
        "force_n": pressure.force,
        "force_t": shear.force,
        "pressure": pressure.own,
        "shear": shear.own,
        "known_pressure": pressure.known,
        "known_shear": shear.known,
        **mesh_curves(body.space),
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=body.K.getSize()[0])


def _border(x: Array, end: float) -> float:
    """Middle between the last sticking node and its neighbour outside."""
    i = int(np.flatnonzero(x == end)[0])
    outside = i + (1 if end > 0 else -1)
    return float((x[i] + x[outside]) / 2)


def _zone_elements(x: Array) -> int:
    return (len(x) - 1) // 4


def _mesh(zone_elements: int, cell: str) -> Mesh:
    smallest = ZONE / zone_elements
    half = np.linspace(0.0, ZONE, zone_elements + 1)
    half = np.concatenate([half, ZONE + growing(smallest, OUTER - ZONE, GROWTH)[1:]])
    x_lines = np.concatenate([-half[:0:-1], half])
    y_lines = -growing(smallest, OUTER, GROWTH)[::-1]
    lower = on_lines(MPI.COMM_SELF, x_lines, y_lines, cell, "left_right")
    return with_counterpart(lower, DISTANCE)


def _touching(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0) & (np.abs(x[0]) < ZONE + 1e-9)


def _opposite(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], DISTANCE) & (np.abs(x[0]) < ZONE + 1e-9)


def _sides(x: Array) -> npt.NDArray[np.bool_]:
    ends = np.isclose(x[1], -OUTER) | np.isclose(x[1], DISTANCE + OUTER)
    return ends | np.isclose(np.abs(x[0]), OUTER)


ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
ZONE_ELEMENTS = (10, 20, 40)
CASES = [
    Case("V5", f"{element}-{n}", partial_slip, {"element": element, "zone_elements": n})
    for element in ELEMENTS
    for n in ZONE_ELEMENTS
]
VARIANTS: dict[str, dict[str, object]] = {
    "held": {"far_field": False},
    "one-step": {"increments": 1},
    "ten-steps": {"increments": 10},
}
CASES += [
    Case("V5", f"pw-T6-20-{name}", partial_slip, {"element": "pw-T6", "zone_elements": 20} | other)
    for name, other in VARIANTS.items()
]
CASES = mark_costly(CASES, "composite-*-[24]0", "*-Q[89]-[24]0")

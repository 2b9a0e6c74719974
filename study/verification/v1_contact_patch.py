"""Contact patch test: uniform pressure must arrive at a rigid plane as it is."""

from functools import partial

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from pw_elements import Material, SurfaceNodes, prescribe
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from study.model.contact_result import CONTACT_UNITS
from study.model.discretisation import discretise, mesh_curves
from study.model.units import units_of
from study.run.cases import Case
from study.run.store import Result

SECTION = "V1"
TITLE = "Contact patch test"

Array = npt.NDArray[np.float64]

YOUNGS_MODULUS, POISSONS_RATIO, PRESSURE = 1000.0, 0.3, 3.0
LENGTH, HEIGHT = 2.0, 1.0
DIVISIONS = (6, 3)
# Largest random move of a node, over the side of a square
MOVE = 0.15


def patch(element: str, mesh: str, state: str = "plane strain") -> Result:
    """A block pressed evenly on a smooth rigid plane; forces, pressures and displacements.

    Every error is the largest one of all nodes, over the exact value (of the even pressure, the
    largest nodal force, the largest displacement). Nodes that have no weight have no pressure
    by their own test function; `weightless` counts them.
    """
    body = discretise(
        element,
        partial(_mesh, mesh),
        Material(YOUNGS_MODULUS, POISSONS_RATIO),
        StressState(state),
    )
    space = body.space
    load = body.surface_load((0.0, -PRESSURE), lambda x: np.isclose(x[1], HEIGHT))
    middle = prescribe(space, 0, lambda x: np.isclose(x[0], 0.0))
    foundation = ContactPair(_lower_side, Plane((0.0, 0.0), (0.0, 1.0)))
    (solved,) = solve_contact(body.K, load, body.supports([middle]), [foundation], space)
    (contact,) = solved.pairs

    surface = SurfaceNodes.from_body(body.body, _lower_side)
    force = contact.force_normal
    own, tributary = surface.pressure(force), surface.tributary_pressure(force)
    displacement = solved.displacement.array_r.reshape(-1, 2)
    exact = _displacement(space.tabulate_dof_coordinates(), StressState(state))
    scalars = {
        "error_force": np.abs(force - PRESSURE * surface.weight_area).max() / force.max(),
        "error_pressure_own": np.nanmax(np.abs(own / PRESSURE - 1)),
        "error_pressure_tributary": np.abs(tributary / PRESSURE - 1).max(),
        "error_displacement": np.abs(displacement - exact).max() / np.abs(exact).max(),
        "weightless": np.isnan(own).sum(),
        "applied_pressure": PRESSURE,
        "force_normal": force.sum(),
        "force_tangential": contact.force_tangential.sum(),
        "sawtooth": surface.sawtooth(force),
        "unevenness": surface.unevenness(own),
        "peak_pressure": np.nanmax(own),
        "iterations": solved.iterations,
        "residual": solved.residuals.largest(),
    }
    curves: dict[str, np.ndarray] = {
        "x": contact.position[:, 0],
        "force_n": force,
        "force_t": -contact.force_tangential[:, 0],
        "pressure": own,
        "pressure_tributary": tributary,
        "status": contact.status,
        **mesh_curves(space),
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    kinds = {
        **CONTACT_UNITS,
        "error_*": "1",
        "weightless": "1",
        "applied_pressure": "stress",
    }
    return Result(numbers, units_of(numbers, kinds), curves, dofs=body.K.getSize()[0])


def _mesh(kind: str, cell: str) -> Mesh:
    build = triangles if cell == "triangle" else quadrilaterals
    mesh = build(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, HEIGHT), DIVISIONS)
    if kind == "distorted":
        return move_nodes(mesh, _moved)
    return curved_mesh(mesh, _bent) if kind == "curved" else mesh


def _moved(x: Array) -> Array:
    """Moves nodes (n, 3) at random; those of the outline along it."""
    moved = x.copy()
    random = np.random.default_rng(1)
    for axis, (size, count) in enumerate(zip((LENGTH, HEIGHT), DIVISIONS, strict=True)):
        inside = ~np.isclose(x[:, axis] % size, 0.0)
        step = MOVE * size / count * random.uniform(-1, 1, len(x))
        moved[:, axis] += np.where(inside, step, 0.0)
    return moved


def _bent(x: Array) -> Array:
    """Bends all lines of nodes (n, 3) but the outline, along which nodes slide."""
    s, t = np.pi * x[:, 0] / LENGTH, np.pi * x[:, 1] / HEIGHT
    bent = x.copy()
    bent[:, 0] += 0.06 * LENGTH * np.sin(s) * np.cos(1.5 * t)
    bent[:, 1] += 0.06 * HEIGHT * np.sin(t) * np.cos(1.5 * s)
    return bent


def _displacement(x: Array, state: StressState) -> Array:
    """Exact displacements (n, 2) at nodes (n, 3): uniaxial stress, or plane strain."""
    E, nu = YOUNGS_MODULUS, POISSONS_RATIO
    if state is StressState.PLANE_STRAIN:
        E, nu = E / (1 - nu**2), nu / (1 - nu)
    return PRESSURE / E * x[:, :2] * np.array([nu, -1.0])


def _lower_side(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0)


ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
MESHES = ("straight", "distorted", "curved")
CASES = [
    Case("V1", f"{element}-{mesh}", patch, {"element": element, "mesh": mesh})
    for element in ELEMENTS
    for mesh in MESHES
]
CASES += [
    Case(
        "V1",
        f"{element}-round",
        patch,
        {"element": element, "mesh": "distorted", "state": "axisymmetric"},
    )
    for element in ELEMENTS
]

"""Orders of convergence against manufactured solutions."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import Body, Material, as_function, assemble_matrix, prescribe, solve
from pw_elements.elasticity import StressState
from pw_elements.spaces import Marker, macro_element
from study.meshes.mesh_families import (
    INNER,
    cell_size,
    on_cube,
    on_curved_ring,
    on_hollow_ball,
    on_pairs,
    on_ring,
    on_square,
    order,
)
from study.model.discretisation import Discretisation, spaces
from study.model.units import dimensionless
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions import manufactured as c_manufactured
from study.solutions.manufactured import Field, Manufactured
from study.verification import c_eigenvalue_orders

SECTION = "C"
TITLE = "Orders of convergence"

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

YOUNGS_MODULUS = 1.0
NORMS = ("H1", "L2", "stress", "force")
_CLOSE = 1e-6


def _anywhere(x: Array) -> Flags:
    return np.ones(x.shape[1], dtype=bool)


def _bottom(x: Array) -> Flags:
    return np.asarray(np.abs(x[1]) < _CLOSE)


def _inner_arc(x: Array) -> Flags:
    return np.asarray(np.abs(np.hypot(x[0], x[1]) - INNER) < _CLOSE)


def _inner_sphere(x: Array) -> Flags:
    return np.asarray(np.abs(np.linalg.norm(x, axis=0) - INNER) < _CLOSE)


def _axis(x: Array) -> Flags:
    return np.asarray(np.abs(x[0]) < _CLOSE)


def _off_the_axis(x: Array) -> Flags:
    """Marks the other three sides of the square, each as a whole."""
    return np.asarray((np.abs(x[0] - 1) < _CLOSE) | (np.abs(x[1] - 0.5) > 0.5 - _CLOSE))


@dataclass(frozen=True)
class Setting:
    """A body with a known displacement.

    Args:
        state: plane stress, plane strain, axisymmetric or solid.
        poissons_ratio: the material's.
        field: the displacement.
        mesh: makes a mesh for an element, its sides about a given length long.
        held: side of prescribed displacements, whose nodal forces are compared.
        sides: lengths of the elements' sides, coarse to fine.
        elements: to be tried.
    """

    state: StressState
    poissons_ratio: float = 0.3
    field: Field = c_manufactured.plane
    mesh: Callable[[str, float], Mesh] = on_square
    held: Marker = _bottom
    sides: tuple[float, ...] = (1 / 4, 1 / 8, 1 / 16, 1 / 32)
    elements: tuple[str, ...] = ("galerkin-T6", "pw-T6", "composite-T6")


TRIANGLES = ("galerkin-T6", "pw-T6")
QUADRILATERALS = ("galerkin-Q8", "pw-Q8", "pw-Q9")
TETRAHEDRA = ("galerkin-T10", "pw-T10")
PLANE = (*Setting.elements, *QUADRILATERALS)

PLANE_STRESS = Setting(StressState.PLANE_STRESS, elements=PLANE)
PLANE_STRAIN = Setting(StressState.PLANE_STRAIN, elements=PLANE)
AXISYMMETRIC = Setting(StressState.AXISYMMETRIC, field=c_manufactured.round_about, elements=PLANE)
RING = Setting(StressState.PLANE_STRESS, mesh=on_ring, held=_inner_arc)
FINER = (1 / 8, 1 / 16, 1 / 32, 1 / 64)
CURVED_RING = replace(RING, mesh=on_curved_ring, elements=PLANE, sides=FINER)
SOLID = Setting(
    StressState.SOLID,
    field=c_manufactured.solid,
    mesh=on_cube,
    sides=(1 / 2, 1 / 4, 1 / 8),
    elements=TETRAHEDRA,
)
PAIRS = replace(PLANE_STRESS, mesh=on_pairs, elements=("galerkin-T6",))
PRESSURE = replace(PLANE_STRAIN, field=c_manufactured.plane_pressure)
PLANE_STRAIN_RING = replace(RING, state=StressState.PLANE_STRAIN, elements=TRIANGLES)
PLANE_STRAIN_CURVED_RING = replace(PLANE_STRAIN_RING, mesh=on_curved_ring, sides=FINER)

SETTINGS = {
    "plane-stress": PLANE_STRESS,
    "pairs": PAIRS,
    "plane-strain": PLANE_STRAIN,
    "axisymmetric": AXISYMMETRIC,
    "ring": RING,
    "curved-ring": CURVED_RING,
    "solid": SOLID,
    "ball": replace(SOLID, mesh=on_hollow_ball, held=_inner_sphere, sides=(0.5, 0.35, 0.2)),
}
NEARLY_INCOMPRESSIBLE = {
    "incompressible": PLANE_STRAIN,
    "incompressible-pressure": PRESSURE,
    "incompressible-axisymmetric": replace(AXISYMMETRIC, elements=TRIANGLES),
    "incompressible-ring": PLANE_STRAIN_RING,
    "incompressible-curved-ring": PLANE_STRAIN_CURVED_RING,
    "incompressible-solid": replace(SOLID, elements=(*TETRAHEDRA, "onecut-T10")),
}
SETTINGS |= {
    name: replace(setting, poissons_ratio=0.4999) for name, setting in NEARLY_INCOMPRESSIBLE.items()
}

RATIOS = (0.3, 0.4, 0.45, 0.49, 0.499, 0.4999)
# Settings whose Poisson's ratio is varied, on the mesh before the finest
SCANNED = {
    "plane-strain": replace(PLANE_STRAIN, elements=TRIANGLES),
    "pressure": replace(PRESSURE, elements=TRIANGLES),
    "axisymmetric": replace(AXISYMMETRIC, elements=TRIANGLES),
    "ring": PLANE_STRAIN_RING,
    "curved-ring": PLANE_STRAIN_CURVED_RING,
    "solid": SOLID,
}


def statics(element: str, setting: str) -> Result:
    """Errors of an element on all meshes of a setting, and their orders.

    Curves, a number a mesh: `h`, the diameter that cells would have if they were cubes, `dofs`,
    and `error_*` of each norm. Scalars: orders, and the errors on the finest mesh.
    """
    rows = [errors(element, SETTINGS[setting], side) for side in SETTINGS[setting].sides]
    curves = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    scalars = {f"order_{name}": order(curves["h"], curves[f"error_{name}"]) for name in NORMS}
    scalars |= {f"error_{name}": float(curves[f"error_{name}"][-1]) for name in NORMS}
    return Result(scalars, dimensionless(scalars), curves, dofs=int(curves["dofs"][-1]))


def scan(element: str, setting: str) -> Result:
    """Errors of an element over Poisson's ratio: curves `nu` and `error_*`."""
    scanned = SCANNED[setting]
    rows = [
        errors(element, replace(scanned, poissons_ratio=nu), scanned.sides[-2]) for nu in RATIOS
    ]
    curves = {f"error_{name}": np.array([row[f"error_{name}"] for row in rows]) for name in NORMS}
    curves["nu"] = np.array(RATIOS)
    scalars = {f"error_{name}": float(curves[f"error_{name}"][-1]) for name in NORMS}
    return Result(scalars, dimensionless(scalars), curves, dofs=int(rows[0]["dofs"]))


def errors(element: str, setting: Setting, side: float) -> dict[str, float]:
    """Relative errors on one mesh, its `h` and `dofs`."""
    mesh = setting.mesh(element, side)
    material = Material(YOUNGS_MODULUS, setting.poissons_ratio)
    body = Body(spaces(element, mesh), material, setting.state)
    discretisation = Discretisation(element, body, assemble_matrix(body.stiffness()))
    known = Manufactured(body, setting.field)
    K, U = discretisation.K, discretisation.space

    exact = fem.Function(U)
    exact.x.array[:] = known.at_nodes(U).ravel()
    held = fem.locate_dofs_geometrical(U, setting.held)
    conditions = [fem.dirichletbc(exact, held)]
    rim = _anywhere
    if setting.state is StressState.AXISYMMETRIC:
        conditions.append(prescribe(U, 0, _axis))
        rim = _off_the_axis
    f = known.load(rim)
    supports = discretisation.supports(conditions)
    a = solve(K, f, supports)

    u = as_function(U, a)
    piecewise_linear = u
    if element == "composite-T6":  # its own gradient is an assumed one
        piecewise_linear = as_function(fem.functionspace(mesh, macro_element("triangle", (2,))), a)
    found = known.errors(u, piecewise_linear)

    # reactions are integrals of the traction times test functions: f has it on the held side, too
    dofs = (held[:, None] * len(exact) + np.arange(len(exact))).ravel()
    force = known.traction_load(setting.held)
    found["force"] = _norm((K * a - f).array[dofs]) / _norm(force.array[dofs])
    return {f"error_{norm}": value for norm, value in found.items()} | {
        "h": cell_size(mesh),
        "dofs": float(supports.right.getSize()[1]),
    }


def _norm(values: Array) -> float:
    return float(np.linalg.norm(values))


def _stated(setting: Setting) -> dict[str, object]:
    """What a setting's name implies."""
    return {
        "state": setting.state.value,
        "field": setting.field.__name__,
        "mesh": setting.mesh.__name__,
    }


def _fixed(setting: Setting) -> dict[str, object]:
    return {
        **_stated(setting),
        "poissons_ratio": setting.poissons_ratio,
        "sides": setting.sides,
    }


CASES = [
    Case("C", f"{element}-{name}", statics, {"element": element, "setting": name}, _fixed(setting))
    for name, setting in SETTINGS.items()
    for element in setting.elements
]
CASES += [
    Case("C", f"{element}-nu-{name}", scan, {"element": element, "setting": name}, _stated(setting))
    for name, setting in SCANNED.items()
    for element in setting.elements
]
CASES += c_eigenvalue_orders.CASES
CASES = mark_costly(
    CASES,
    *("*-ball", "*-modes-cube", "onecut-*", "*-Q[89]-*ring", "*-Q[89]-incompressible*"),
    *("composite-T6-*ring", "composite-T6-incompressible*", "*-T6-plane-strain"),
    *("*-Q[89]-plane-strain", "*-T6-axisymmetric", "*-Q[89]-axisymmetric"),
    *("composite-T6-modes-cylinder", "*-Q[89]-modes-cylinder", "*-modes-square-same"),
)

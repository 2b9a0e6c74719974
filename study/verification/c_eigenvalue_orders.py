"""Orders of convergence of eigenvalues of bodies on smooth rigid walls, which are known exactly."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.optimize import brentq
from scipy.special import jn_zeros, jv, jvp, yv, yvp

from pw_elements import Body, Material, assemble_matrix, prescribe, vibration_modes
from pw_elements.elasticity import StressState
from study.meshes.mesh_families import (
    INNER,
    OUTER,
    cell_size,
    on_cube,
    on_curved_ring,
    on_ring,
    on_square,
    order,
)
from study.model.discretisation import Discretisation, is_symmetrised, mass_left, spaces
from study.model.units import dimensionless
from study.run.cases import Case
from study.run.store import Result

Array = npt.NDArray[np.float64]

E, NU = 1.0, 0.3
SHEAR = E / (2 * (1 + NU))
CONFINED = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))  # strain in one direction only
PLANE_STRESS = E / (1 - NU**2)
# Eigenvalues that are compared: the lowest ones
COUNT = 4
_WAVES = range(4)


def square() -> Array:
    """Plane stress, unit square: shear waves and compression waves of whole half-wavelengths."""
    squares = [m**2 + n**2 for m in _WAVES for n in _WAVES]
    shear = [m**2 + n**2 for m in _WAVES for n in _WAVES if m and n]
    return _lowest(SHEAR * np.pi**2 * np.array(shear), PLANE_STRESS * np.pi**2 * np.array(squares))


def cube() -> Array:
    """As `square`; a shear wave has two polarisations, but one if it runs in a wall's plane."""
    waves = [(k, m, n) for k in _WAVES for m in _WAVES for n in _WAVES]
    shear = [
        k**2 + m**2 + n**2
        for k, m, n in waves
        for _ in range({0: 2, 1: 1}.get((k, m, n).count(0), 0))
    ]
    squares = [k**2 + m**2 + n**2 for k, m, n in waves]
    return _lowest(SHEAR * np.pi**2 * np.array(shear), CONFINED * np.pi**2 * np.array(squares))


def cylinder() -> Array:
    """Radius and height 1: u_r = J1(k r) cos(m pi z) with J1(k) = 0, and pure axial motion."""
    radial = jn_zeros(1, len(_WAVES)) ** 2
    axial = np.pi**2 * np.array(_WAVES) ** 2
    shear = radial[:, None] + axial[1:]
    compression = np.append(0.0, radial)[:, None] + axial
    return _lowest(SHEAR * shear, CONFINED * compression)


def ring() -> Array:
    """The breathing mode (1,) of a ring with free arcs: u_r = J1(k r) + c Y1(k r)."""

    def stress_at_rim(k: float) -> float:
        values = [
            [k * derivative(1, k * r) + NU * bessel(1, k * r) / r for r in (INNER, OUTER)]
            for bessel, derivative in ((jv, jvp), (yv, yvp))
        ]
        return float(np.linalg.det(values))

    # near that of a thin ring of the mean radius
    thin = 2 / (INNER + OUTER)
    k = brentq(stress_at_rim, 0.5 * thin, 1.5 * thin, xtol=1e-14, rtol=1e-14)
    return np.array([PLANE_STRESS * k**2])


@dataclass(frozen=True)
class Vibration:
    """A body on smooth rigid walls.

    Args:
        state: plane stress, axisymmetric or solid.
        exact: its lowest eigenvalues, or one of them.
        mesh: makes a mesh for an element, its sides about a given length long.
        sides: lengths of the elements' sides, coarse to fine.
        walls: planes x_i = c that hold the displacement u_i, as pairs (i, c).
        elements: to be tried.
    """

    state: StressState
    exact: Callable[[], Array]
    mesh: Callable[[str, float], Mesh]
    sides: tuple[float, ...] = (1 / 4, 1 / 8, 1 / 16, 1 / 32)
    walls: tuple[tuple[int, float], ...] = ((0, 0.0), (1, 0.0), (0, 1.0), (1, 1.0))
    elements: tuple[str, ...] = ("galerkin-T6", "pw-T6", "composite-T6")


QUADRILATERALS = ("galerkin-Q8", "pw-Q8", "pw-Q9")
_RING = Vibration(
    StressState.PLANE_STRESS, ring, on_ring, (1 / 2, 1 / 4, 1 / 8, 1 / 16), ((0, 0.0), (1, 0.0))
)
VIBRATIONS = {
    "square": Vibration(
        StressState.PLANE_STRESS,
        square,
        on_square,
        elements=(*Vibration.elements, "pwsym-T6", *QUADRILATERALS),
    ),
    "cylinder": Vibration(
        StressState.AXISYMMETRIC,
        cylinder,
        on_square,
        elements=(*Vibration.elements, *QUADRILATERALS),
    ),
    "cube": Vibration(
        StressState.SOLID,
        cube,
        on_cube,
        (1 / 3, 1 / 5, 1 / 8),
        tuple((i, c) for i in range(3) for c in (0.0, 1.0)),
        ("galerkin-T10", "pw-T10"),
    ),
    "ring": _RING,
    "curved-ring": replace(
        _RING, mesh=on_curved_ring, sides=Vibration.sides, elements=("galerkin-T6", "pw-T6")
    ),
}


def modes(
    element: str, vibration: str, left: Literal["transposed", "same"] = "transposed"
) -> Result:
    """Errors of eigenvalues on all meshes, and their order; `left` as in `mass_left`.

    Curves, a number a mesh: `h`, `dofs`, `error_eigenvalue` (the largest relative one of those
    compared). Scalars: the order, the error on the finest mesh, and the largest |Im| / |Re|.
    """
    vibrating = VIBRATIONS[vibration]
    exact = vibrating.exact()
    rows = []
    for side in vibrating.sides:
        mesh = vibrating.mesh(element, side)
        body = Body(spaces(element, mesh), Material(E, NU), vibrating.state)
        K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
        discretisation = Discretisation(element, body, K)
        walls = [_wall(discretisation.space, i, place) for i, place in vibrating.walls]
        reduction = mass_left(discretisation.supports(walls), left)
        found = vibration_modes(K, M, reduction, COUNT, is_symmetrised(element))
        near = found.eigenvalues
        if len(exact) == 1:
            near = near[[np.abs(near - exact).argmin()]]
        rows.append(
            {
                "h": cell_size(mesh),
                "dofs": reduction.right.getSize()[1],
                "error_eigenvalue": np.abs(near / exact - 1).max(),
                "imaginary": found.imaginary_ratio,
            }
        )
    curves = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    scalars = {
        "order_eigenvalue": order(curves["h"], curves["error_eigenvalue"]),
        "error_eigenvalue": float(curves["error_eigenvalue"][-1]),
        "imaginary": float(curves["imaginary"].max()),
    }
    return Result(scalars, dimensionless(scalars), curves, dofs=int(curves["dofs"][-1]))


def _wall(space: fem.FunctionSpace, component: int, place: float) -> fem.DirichletBC:
    return prescribe(space, component, lambda x: np.isclose(x[component], place))


def _lowest(*families: Array) -> Array:
    values = np.sort(np.concatenate([np.ravel(family) for family in families]))
    return values[values > 0][:COUNT]


def _stated(vibration: Vibration) -> dict[str, object]:
    """What a vibration's name implies."""
    return {
        "state": vibration.state.value,
        "mesh": vibration.mesh.__name__,
        "sides": vibration.sides,
    }


CASES = [
    Case(
        "C",
        f"{element}-modes-{name}",
        modes,
        {"element": element, "vibration": name},
        _stated(vibration),
    )
    for name, vibration in VIBRATIONS.items()
    for element in vibration.elements
]
CASES += [
    Case(
        "C",
        f"{element}-modes-square-same",
        modes,
        {"element": element, "vibration": "square", "left": "same"},
        _stated(VIBRATIONS["square"]),
    )
    for element in ("pw-Q8", "pw-Q9")
]

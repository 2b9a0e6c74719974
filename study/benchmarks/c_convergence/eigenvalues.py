"""Bodies on smooth rigid walls, their exact eigenvalues, and the errors of an element."""

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
from study.run.store import Result

Array = npt.NDArray[np.float64]

YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
SHEAR_MODULUS = YOUNGS_MODULUS / (2 * (1 + POISSONS_RATIO))
UNIAXIAL_STRAIN_MODULUS = (
    YOUNGS_MODULUS * (1 - POISSONS_RATIO) / ((1 + POISSONS_RATIO) * (1 - 2 * POISSONS_RATIO))
)
PLANE_STRESS_MODULUS = YOUNGS_MODULUS / (1 - POISSONS_RATIO**2)
N_COMPARED = 4
"""The lowest eigenvalues, which are compared."""
HALF_WAVES = range(4)
"""Numbers of half-wavelengths along an axis among which the lowest eigenvalues are."""

# Exact eigenvalues; the density is one


def square_eigenvalues() -> Array:
    """Return the lowest eigenvalues of the unit square in plane stress.

    Shear waves and compression waves have whole numbers of half-wavelengths along both sides.
    """
    squares = [m**2 + n**2 for m in HALF_WAVES for n in HALF_WAVES]
    shear = [m**2 + n**2 for m in HALF_WAVES for n in HALF_WAVES if m and n]
    return _select_lowest(
        SHEAR_MODULUS * np.pi**2 * np.array(shear),
        PLANE_STRESS_MODULUS * np.pi**2 * np.array(squares),
    )


def cube_eigenvalues() -> Array:
    """Return the lowest eigenvalues of the unit cube, of waves as in the square.

    A shear wave has two polarisations, but one if it runs in the plane of a wall.
    """
    waves = [(k, m, n) for k in HALF_WAVES for m in HALF_WAVES for n in HALF_WAVES]
    n_polarisations = {0: 2, 1: 1}  # by the number of axes along which the wave is constant
    shear = [
        k**2 + m**2 + n**2
        for k, m, n in waves
        for _ in range(n_polarisations.get((k, m, n).count(0), 0))
    ]
    squares = [k**2 + m**2 + n**2 for k, m, n in waves]
    return _select_lowest(
        SHEAR_MODULUS * np.pi**2 * np.array(shear),
        UNIAXIAL_STRAIN_MODULUS * np.pi**2 * np.array(squares),
    )


def cylinder_eigenvalues() -> Array:
    """Return the lowest axisymmetric eigenvalues of a cylinder of radius and height 1.

    Modes are u_r = J1(k r) cos(m pi z) with J1(k) = 0, and purely axial ones.
    """
    radial = jn_zeros(1, len(HALF_WAVES)) ** 2
    axial = np.pi**2 * np.array(HALF_WAVES) ** 2
    shear = radial[:, None] + axial[1:]
    compression = np.append(0.0, radial)[:, None] + axial
    return _select_lowest(SHEAR_MODULUS * shear, UNIAXIAL_STRAIN_MODULUS * compression)


def ring_eigenvalue() -> Array:
    """Return the eigenvalue (1,) of the breathing mode of a ring with free arcs.

    The mode is u_r = J1(k r) + c Y1(k r).
    """

    def radial_stress_determinant(k: float) -> float:
        stresses = [
            [
                k * derivative(1, k * r) + POISSONS_RATIO * bessel(1, k * r) / r
                for r in (INNER, OUTER)
            ]
            for bessel, derivative in ((jv, jvp), (yv, yvp))
        ]
        return float(np.linalg.det(stresses))

    thin_ring_k = 2 / (INNER + OUTER)  # of a thin ring of the mean radius
    bracket = 0.5 * thin_ring_k, 1.5 * thin_ring_k
    k = brentq(radial_stress_determinant, *bracket, xtol=1e-14, rtol=1e-14)
    return np.array([PLANE_STRESS_MODULUS * k**2])


def _select_lowest(*families: Array) -> Array:
    eigenvalues = np.sort(np.concatenate([np.ravel(family) for family in families]))
    return eigenvalues[eigenvalues > 0][:N_COMPARED]


# Problems


@dataclass(frozen=True)
class Vibration:
    """A body on smooth rigid walls.

    Args:
        state: plane stress, axisymmetric or solid.
        exact: returns its lowest eigenvalues, or one of them.
        mesh: makes a mesh for an element, its sides about a given length long.
        cell_sides: lengths of the elements' sides, coarse to fine.
        walls: planes x_i = c that hold the displacement u_i, as pairs (i, c).
        elements: elements that are compared.
    """

    state: StressState
    exact: Callable[[], Array]
    mesh: Callable[[str, float], Mesh]
    cell_sides: tuple[float, ...] = (1 / 4, 1 / 8, 1 / 16, 1 / 32)
    walls: tuple[tuple[int, float], ...] = ((0, 0.0), (1, 0.0), (0, 1.0), (1, 1.0))
    elements: tuple[str, ...] = ("galerkin-T6", "pw-T6", "composite-T6")


QUADRILATERALS = ("galerkin-Q8", "pw-Q8", "pw-Q9")
RING = Vibration(
    StressState.PLANE_STRESS,
    ring_eigenvalue,
    on_ring,
    (1 / 2, 1 / 4, 1 / 8, 1 / 16),
    ((0, 0.0), (1, 0.0)),
)
VIBRATIONS = {
    "square": Vibration(
        StressState.PLANE_STRESS,
        square_eigenvalues,
        on_square,
        elements=(*Vibration.elements, "pwsym-T6", *QUADRILATERALS),
    ),
    "cylinder": Vibration(
        StressState.AXISYMMETRIC,
        cylinder_eigenvalues,
        on_square,
        elements=(*Vibration.elements, *QUADRILATERALS),
    ),
    "cube": Vibration(
        StressState.SOLID,
        cube_eigenvalues,
        on_cube,
        (1 / 3, 1 / 5, 1 / 8),
        tuple((i, c) for i in range(3) for c in (0.0, 1.0)),
        ("galerkin-T10", "pw-T10"),
    ),
    "ring": RING,
    "curved-ring": replace(
        RING,
        mesh=on_curved_ring,
        cell_sides=Vibration.cell_sides,
        elements=("galerkin-T6", "pw-T6"),
    ),
}


def modes(
    element: str, vibration: str, left: Literal["transposed", "same"] = "transposed"
) -> Result:
    """Return errors of eigenvalues on all meshes, and their order.

    Curves, a number a mesh: `h`, `dofs`, `error_eigenvalue` (the largest relative one of those
    compared). Scalars: the order, the error on the finest mesh, and the largest |Im| / |Re|.

    Args:
        element: its name.
        vibration: name of a body in `VIBRATIONS`.
        left: left matrix of the condensation, as in `mass_left`.
    """
    body_on_walls = VIBRATIONS[vibration]
    exact = body_on_walls.exact()
    rows = []
    for side in body_on_walls.cell_sides:
        mesh = body_on_walls.mesh(element, side)
        material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
        body = Body(spaces(element, mesh), material, body_on_walls.state)
        K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
        discretisation = Discretisation(element, body, K)
        supports = [_support_at_wall(discretisation.space, i, c) for i, c in body_on_walls.walls]
        reduction = mass_left(discretisation.supports(supports), left)
        computed = vibration_modes(K, M, reduction, N_COMPARED, is_symmetrised(element))
        eigenvalues = computed.eigenvalues
        if len(exact) == 1:
            eigenvalues = eigenvalues[[np.abs(eigenvalues - exact).argmin()]]
        rows.append(
            {
                "h": cell_size(mesh),
                "dofs": reduction.right.getSize()[1],
                "error_eigenvalue": np.abs(eigenvalues / exact - 1).max(),
                "imaginary": computed.imaginary_ratio,
            }
        )
    curves = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    scalars = {
        "order_eigenvalue": order(curves["h"], curves["error_eigenvalue"]),
        "error_eigenvalue": float(curves["error_eigenvalue"][-1]),
        "imaginary": float(curves["imaginary"].max()),
    }
    return Result(scalars, dimensionless(scalars), curves, dofs=int(curves["dofs"][-1]))


def _support_at_wall(space: fem.FunctionSpace, axis: int, position: float) -> fem.DirichletBC:
    return prescribe(space, axis, lambda x: np.isclose(x[axis], position))

"""Vibration eigenvalues of bodies between smooth rigid walls: exact values and elements' errors."""

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
    INNER_RADIUS,
    OUTER_RADIUS,
    fit_convergence_order,
    mean_cell_size,
    on_cube,
    on_curved_ring,
    on_ring,
    on_square,
)
from study.model.discretisation import (
    Discretisation,
    is_symmetrised,
    make_element_spaces,
    reduction_for_mass_condensation,
)
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result

Array = npt.NDArray[np.float64]

YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
SHEAR_MODULUS = YOUNGS_MODULUS / (2 * (1 + POISSONS_RATIO))
UNIAXIAL_STRAIN_MODULUS = (
    YOUNGS_MODULUS * (1 - POISSONS_RATIO) / ((1 + POISSONS_RATIO) * (1 - 2 * POISSONS_RATIO))
)
PLANE_STRESS_MODULUS = YOUNGS_MODULUS / (1 - POISSONS_RATIO**2)
N_COMPARED_EIGENVALUES = 4
"""Number of lowest eigenvalues that are compared."""
HALF_WAVE_NUMBERS = range(4)
"""Numbers of half-wavelengths along one axis that are tried to find the lowest eigenvalues."""

# Exact eigenvalues for density 1


def exact_eigenvalues_of_walled_square() -> Array:
    """Return the lowest exact eigenvalues omega² (m,) of the unit square in plane stress.

    The square lies between smooth rigid walls and has density 1. Shear and compression waves have
    an integer number of half-wavelengths along each side.
    """
    squares = [m**2 + n**2 for m in HALF_WAVE_NUMBERS for n in HALF_WAVE_NUMBERS]
    shear = [m**2 + n**2 for m in HALF_WAVE_NUMBERS for n in HALF_WAVE_NUMBERS if m and n]
    return _select_lowest_positive_eigenvalues(
        SHEAR_MODULUS * np.pi**2 * np.array(shear),
        PLANE_STRESS_MODULUS * np.pi**2 * np.array(squares),
    )


def exact_eigenvalues_of_walled_cube() -> Array:
    """Return the lowest exact eigenvalues omega² (m,) of the unit cube between smooth rigid walls.

    Shear and compression waves have an integer number of half-wavelengths along each edge. A shear
    wave has two polarisations, or only one if it propagates parallel to a wall.
    """
    waves = [
        (k, m, n) for k in HALF_WAVE_NUMBERS for m in HALF_WAVE_NUMBERS for n in HALF_WAVE_NUMBERS
    ]
    n_polarisations = {0: 2, 1: 1}  # key: number of axes along which the wave is constant
    shear = [
        k**2 + m**2 + n**2
        for k, m, n in waves
        for _ in range(n_polarisations.get((k, m, n).count(0), 0))
    ]
    squares = [k**2 + m**2 + n**2 for k, m, n in waves]
    return _select_lowest_positive_eigenvalues(
        SHEAR_MODULUS * np.pi**2 * np.array(shear),
        UNIAXIAL_STRAIN_MODULUS * np.pi**2 * np.array(squares),
    )


def exact_eigenvalues_of_walled_cylinder() -> Array:
    """Return the lowest exact axisymmetric eigenvalues omega² (m,) of a cylinder between walls.

    The cylinder has radius and height 1; the walls are smooth and rigid. The modes have the radial
    displacement J1(k r) cos(m pi z) with J1(k) = 0, or are purely axial.
    """
    radial = jn_zeros(1, len(HALF_WAVE_NUMBERS)) ** 2
    axial = np.pi**2 * np.array(HALF_WAVE_NUMBERS) ** 2
    shear = radial[:, None] + axial[1:]
    compression = np.append(0.0, radial)[:, None] + axial
    return _select_lowest_positive_eigenvalues(
        SHEAR_MODULUS * shear, UNIAXIAL_STRAIN_MODULUS * compression
    )


def exact_breathing_eigenvalue_of_ring() -> Array:
    """Return the exact eigenvalue omega² (1,) of the breathing mode of a ring with free arcs.

    The radial displacement of this mode is u_r = J1(k r) + c Y1(k r).
    """

    def determinant_of_radial_stresses_at_both_arcs(k: float) -> float:
        stresses = [
            [
                k * derivative(1, k * r) + POISSONS_RATIO * bessel(1, k * r) / r
                for r in (INNER_RADIUS, OUTER_RADIUS)
            ]
            for bessel, derivative in ((jv, jvp), (yv, yvp))
        ]
        return float(np.linalg.det(stresses))

    thin_ring_k = 2 / (INNER_RADIUS + OUTER_RADIUS)  # wave number of a thin ring of the mean radius
    bracket = 0.5 * thin_ring_k, 1.5 * thin_ring_k
    k = brentq(determinant_of_radial_stresses_at_both_arcs, *bracket, xtol=1e-14, rtol=1e-14)
    return np.array([PLANE_STRESS_MODULUS * k**2])


def _select_lowest_positive_eigenvalues(*eigenvalues_by_wave_type: Array) -> Array:
    eigenvalues = np.sort(np.concatenate([np.ravel(family) for family in eigenvalues_by_wave_type]))
    return eigenvalues[eigenvalues > 0][:N_COMPARED_EIGENVALUES]


# Problems


@dataclass(frozen=True)
class VibrationBetweenWalls:
    """Vibration problem of a body between smooth rigid walls.

    Args:
        state: Plane stress, axisymmetric or solid.
        exact_eigenvalues: Function that returns the lowest exact eigenvalues (m,), or (1,) if only
            one eigenvalue is known.
        mesh: Function of an element's name and a cell side length that returns a mesh.
        cell_sides: Side lengths of the cells, from coarse to fine.
        normal_axes_and_positions_of_walls: Walls x_i = c on which the displacement u_i is zero, as
            pairs (i, c).
        elements: Names of the elements that are compared.
    """

    state: StressState
    exact_eigenvalues: Callable[[], Array]
    mesh: Callable[[str, float], Mesh]
    cell_sides: tuple[float, ...] = (1 / 4, 1 / 8, 1 / 16, 1 / 32)
    normal_axes_and_positions_of_walls: tuple[tuple[int, float], ...] = (
        (0, 0.0),
        (1, 0.0),
        (0, 1.0),
        (1, 1.0),
    )
    elements: tuple[str, ...] = ("galerkin-T6", "pw-T6", "composite-T6")


QUADRILATERAL_ELEMENTS = ("galerkin-Q8", "pw-Q8", "pw-Q9")
RING_VIBRATION = VibrationBetweenWalls(
    StressState.PLANE_STRESS,
    exact_breathing_eigenvalue_of_ring,
    on_ring,
    (1 / 2, 1 / 4, 1 / 8, 1 / 16),
    ((0, 0.0), (1, 0.0)),
)
VIBRATIONS = {
    "square": VibrationBetweenWalls(
        StressState.PLANE_STRESS,
        exact_eigenvalues_of_walled_square,
        on_square,
        elements=(*VibrationBetweenWalls.elements, "pwsym-T6", *QUADRILATERAL_ELEMENTS),
    ),
    "cylinder": VibrationBetweenWalls(
        StressState.AXISYMMETRIC,
        exact_eigenvalues_of_walled_cylinder,
        on_square,
        elements=(*VibrationBetweenWalls.elements, *QUADRILATERAL_ELEMENTS),
    ),
    "cube": VibrationBetweenWalls(
        StressState.SOLID,
        exact_eigenvalues_of_walled_cube,
        on_cube,
        (1 / 3, 1 / 5, 1 / 8),
        tuple((i, c) for i in range(3) for c in (0.0, 1.0)),
        ("galerkin-T10", "pw-T10"),
    ),
    "ring": RING_VIBRATION,
    "curved-ring": replace(
        RING_VIBRATION,
        mesh=on_curved_ring,
        cell_sides=VibrationBetweenWalls.cell_sides,
        elements=("galerkin-T6", "pw-T6"),
    ),
}


def modes(
    element: str, vibration: str, left: Literal["transposed", "same"] = "transposed"
) -> Result:
    """Compute the errors of the lowest eigenvalues on a series of meshes, and their order.

    Curves have one entry per mesh: the mean cell size `h`, the number of unknowns `dofs`, and
    `error_eigenvalue`, the largest relative error of the compared eigenvalues. Scalars are the
    observed order of convergence, the error on the finest mesh, and the largest ratio |Im| / |Re|
    of the computed eigenvalues.

    Args:
        element: Name of the element.
        vibration: A key of `VIBRATIONS`.
        left: Left matrix L of the condensed mass L^T M R, see `reduction_for_mass_condensation`.
    """
    problem = VIBRATIONS[vibration]
    exact = problem.exact_eigenvalues()
    rows = []
    for side in problem.cell_sides:
        mesh = problem.mesh(element, side)
        material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
        body = Body(make_element_spaces(element, mesh), material, problem.state)
        K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
        discretisation = Discretisation(element, body, K)
        supports = [
            _fix_normal_displacement_at_wall(discretisation.space, i, c)
            for i, c in problem.normal_axes_and_positions_of_walls
        ]
        reduction = reduction_for_mass_condensation(discretisation.supports(supports), left)
        computed = vibration_modes(K, M, reduction, N_COMPARED_EIGENVALUES, is_symmetrised(element))
        eigenvalues = computed.eigenvalues
        if len(exact) == 1:
            eigenvalues = eigenvalues[[np.abs(eigenvalues - exact).argmin()]]
        rows.append(
            {
                "h": mean_cell_size(mesh),
                "dofs": reduction.right.getSize()[1],
                "error_eigenvalue": np.abs(eigenvalues / exact - 1).max(),
                "imaginary": computed.imaginary_ratio,
            }
        )
    curves = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    scalars = {
        "order_eigenvalue": fit_convergence_order(curves["h"], curves["error_eigenvalue"]),
        "error_eigenvalue": float(curves["error_eigenvalue"][-1]),
        "imaginary": float(curves["imaginary"].max()),
    }
    return Result(
        scalars, assign_unit_one_to_scalars(scalars), curves, dofs=int(curves["dofs"][-1])
    )


def _fix_normal_displacement_at_wall(
    space: fem.FunctionSpace, axis: int, position: float
) -> fem.DirichletBC:
    return prescribe(space, axis, lambda x: np.isclose(x[axis], position))

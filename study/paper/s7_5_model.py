"""Model of the stepped column in section 7.5: contact on four surfaces, and vibration."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from pw_elements import (
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    lumped_mass,
    prescribe,
    vibration_modes,
)
from pw_elements.algebra import VibrationModes
from pw_elements.contact import ContactPair, Motion, Plane, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern
from pw_elements.spaces import AssemblyRecord
from study.model.contact_result import (
    CONTACT_QUANTITIES,
    compute_pair_scalars_and_curves,
    mesh_and_displacement_curves,
    summarise_solver_statistics,
)
from study.model.discretisation import (
    Discretisation,
    discretise,
    is_symmetrised,
    reduction_for_mass_condensation,
)
from study.model.units import KN_M_UNITS, SI_UNITS, assign_units_to_scalars
from study.paper import s7_5_profiles
from study.paper.s7_5_profiles import PROFILES, ColumnProfile
from study.run.store import Result

# Printed: E in kN/m², density in kg/m³. As they stand, these units give eigenvalues in 1000/s²,
# and Table 1 for the synthetic column; the other reading is SI, with E in N/m²
YOUNGS_MODULUS, POISSONS_RATIO, DENSITY = 2.1e8, 0.3, 7856.0
YOUNGS_MODULUS_SI = 2.1e11
FRICTION = 0.3
DESCENT = 1e-3
"""Total downward displacement of the plane on surface 4, in m."""

# Chosen
GAPS = (1e-4, 2e-4)
"""Gaps of surfaces 2 and 3, in m, at which all four surfaces become loaded."""
INCREMENTS = 10

MODES = 6
MassKind = Literal["consistent", "lumped", "standard"]
LeftReduction = Literal["transposed", "same"]
"""Left matrix of the condensation: that of the transposed problem, or equal to the right one."""


def stepped_column(
    element: str,
    gaps: tuple[float, float] = GAPS,
    refined: int = 1,
    section: str = "first",
    pattern: DiagonalPattern = "right",
) -> Result:
    """Compute the contact forces on all four surfaces, and the eigenvalues of Table 1.

    Contact forces are those at the end of the last increment. Names of scalars and curves of
    surface k end in `_k`; those without a number belong to surface 4.

    Args:
        element: Name of the element.
        gaps: Initial gaps of surfaces 2 and 3, in m.
        refined: Factor by which all numbers of divisions are multiplied.
        section: Name of the synthetic column, "first" or "second".
        pattern: Diagonals of the quadrilaterals.
    """
    profile = PROFILES[section]
    body = _discretise_column(element, profile, refined, pattern)
    states = _press_column_on_supports(body, profile, (gaps[0], gaps[1]))
    scalars, curves = (
        summarise_solver_statistics(states),
        mesh_and_displacement_curves(body, states[-1]),
    )
    no_load = body.K.createVecLeft()
    for pair, face in enumerate(profile.faces):
        force = states[-1].pairs[pair].force_normal.sum()
        mean_pressure = force / (np.pi * (face.outer**2 - face.inner**2))
        surface_scalars, surface_curves = compute_pair_scalars_and_curves(
            body, states[-1], pair, no_load, face.contains, mean_pressure
        )
        scalars |= {f"{name}_{pair + 1}": value for name, value in surface_scalars.items()}
        curves |= {f"{name}_{pair + 1}": curve for name, curve in surface_curves.items()}
    scalars |= surface_scalars  # of surface 4
    scalars |= {"initial_gap_2": gaps[0], "initial_gap_3": gaps[1], "descent": DESCENT}
    for k, (radius, height) in enumerate(zip(profile.radii, profile.heights, strict=True), 1):
        scalars |= {f"radius_{k}": radius, f"height_{k}": height}
    modes = _compute_vibration_modes(body, profile)
    scalars |= _eigenvalue_scalars(modes)
    for i, shape in enumerate(modes.shapes, start=1):
        curves[f"shape_{i}"] = shape.array_r.reshape(-1, 2)
    return Result(scalars, _scalar_units(scalars), curves, dofs=body.K.getSize()[0])


def vibration(
    element: str,
    mass: MassKind = "consistent",
    guyan: LeftReduction = "transposed",
    pattern: DiagonalPattern = "right",
    refined: int = 1,
    quadrature_degree: int | None = None,
    youngs_modulus: float = YOUNGS_MODULUS,
    section: str = "first",
) -> Result:
    """Compute the eigenvalues of Table 1 for a variant of an element, without contact.

    Args:
        element: Name of the element. Matrices of a symmetrised element ("pwsym-...") are replaced
            by their symmetric parts after the condensation.
        mass: "consistent", "lumped" (row sums) or "standard" (mass of the element with standard
            weights). Inner nodes are condensed afterwards.
        guyan: Left matrix of the condensation of 8-node elements, see
            `reduction_for_mass_condensation`.
        pattern: Diagonals of the quadrilaterals.
        refined: Factor by which all numbers of divisions are multiplied.
        quadrature_degree: Degree for both matrices on each sub-triangle, where 1 means one point;
            None for the default of the library.
        youngs_modulus: Young's modulus, as printed (kN/m²) or in SI (N/m²).
        section: Name of the synthetic column, "first" or "second".
    """
    profile = PROFILES[section]
    body = _discretise_column(element, profile, refined, pattern, quadrature_degree, youngs_modulus)
    modes = _compute_vibration_modes(body, profile, mass, guyan)
    scalars = _eigenvalue_scalars(modes)
    return Result(scalars, _scalar_units(scalars, youngs_modulus), dofs=body.K.getSize()[0])


def compute_column_eigenvalues(element: str, profile: ColumnProfile) -> npt.NDArray[np.float64]:
    """Return the first six eigenvalues omega² (6,) of a column on its base, in 1000/s²."""
    return _compute_vibration_modes(_discretise_column(element, profile), profile).eigenvalues


def _discretise_column(
    element: str,
    profile: ColumnProfile,
    refined: int = 1,
    pattern: DiagonalPattern = "right",
    quadrature_degree: int | None = None,
    youngs_modulus: float = YOUNGS_MODULUS,
) -> Discretisation:
    material = Material(youngs_modulus, POISSONS_RATIO, DENSITY)
    build = partial(s7_5_profiles.mesh_column, profile, refined=refined, pattern=pattern)
    body = discretise(element, build, material, StressState.AXISYMMETRIC)
    if quadrature_degree is None:
        return body
    elastic_body = replace(body.body, quadrature_degree=quadrature_degree)
    return Discretisation(element, elastic_body, assemble_matrix(elastic_body.stiffness()))


def _press_column_on_supports(
    body: Discretisation, profile: ColumnProfile, gaps: tuple[float, float]
) -> list[ContactState]:
    """Press the column onto its three supports in equal increments.

    The plane on surface 4 moves down by `DESCENT` in total.

    Returns:
        Contact states at the ends of the increments.
    """
    gap_by_face = (0.0, *gaps, 0.0)
    levels = [face.level - gap for face, gap in zip(profile.faces, gap_by_face, strict=True)]
    load_factors = np.arange(1, INCREMENTS + 1) / INCREMENTS
    descent = [Motion((0.0, -DESCENT * factor)) for factor in load_factors]
    pairs = [
        ContactPair(face.contains, Plane((0.0, level), (0.0, -face.outward)), FRICTION, motions)
        for face, level, motions in zip(profile.faces, levels, ([], [], [], descent), strict=True)
    ]
    supports = body.supports([prescribe(body.space, 0, s7_5_profiles.on_axis)])
    no_load = [body.K.createVecLeft()] * INCREMENTS
    return solve_contact(body.K, no_load, supports, pairs, body.space)


def _compute_vibration_modes(
    body: Discretisation,
    profile: ColumnProfile,
    mass: MassKind = "consistent",
    guyan: LeftReduction = "transposed",
) -> VibrationModes:
    """Compute vibration modes of the column on its base, which supports it vertically only."""
    M = assemble_matrix(body.body.mass())
    if mass == "standard":  # without the record of its weights, which the solver would refuse
        standard_body = replace(body.body, spaces=Spaces(body.space, body.space))
        M = AssemblyRecord().attach(assemble_matrix(standard_body.mass()).copy())
    elif mass == "lumped":
        M = lumped_mass(M, body.space)
    supports: Reduction = body.supports(
        [
            prescribe(body.space, 0, s7_5_profiles.on_axis),
            prescribe(body.space, 1, profile.faces[0].contains),
        ]
    )
    if len(body.inner_nodes()):
        supports = reduction_for_mass_condensation(supports, guyan)
    return vibration_modes(body.K, M, supports, MODES, is_symmetrised(body.element))


def _eigenvalue_scalars(modes: VibrationModes) -> dict[str, float]:
    scalars = {f"omega2_{i}": value for i, value in enumerate(modes.eigenvalues, start=1)}
    return scalars | {
        "mode_residual": float(modes.residuals.max()),
        "imaginary": modes.imaginary_ratio,
        "rigid": float(modes.n_rigid),
    }


def _scalar_units(scalars: Iterable[str], youngs_modulus: float = YOUNGS_MODULUS) -> dict[str, str]:
    """Return the units of scalars, which depend on the unit of Young's modulus.

    With the printed data, forces are in kN and eigenvalues in 1000/s².
    """
    is_si = youngs_modulus == YOUNGS_MODULUS_SI
    kinds = {
        **CONTACT_QUANTITIES,
        "radius_*": "length",
        "height_*": "length",
        "initial_gap_*": "length",
        "descent": "length",
        "omega2_*": "1/s²" if is_si else "1000/s²",
        "mode_residual": "1",
        "imaginary": "1",
        "rigid": "1",
    }
    return assign_units_to_scalars(scalars, kinds, SI_UNITS if is_si else KN_M_UNITS)

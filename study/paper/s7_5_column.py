"""7.5 Stepped column on rigid surfaces: contact with friction (Figs 15-23) and vibration (Table 1).

The section is synthetic, see `study.paper.s7_5_profiles`; so are the supports and gaps.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from pw_elements import (
    Material,
    Reduction,
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
from study.model.contact_result import (
    CONTACT_UNITS,
    deformation_curves,
    solver_scalars,
    surface_result,
)
from study.model.discretisation import Discretisation, discretise, is_symmetrised, mass_left
from study.model.units import KN_M, SI, units_of
from study.paper import s7_5_profiles
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA
from study.paper.s7_5_profiles import PROFILES, Profile
from study.run.cases import Case
from study.run.store import Result

SECTION = "7.5"
TITLE = "Column of changing cross-section on rigid surfaces"

# Printed: E in kN/m2, nu, mu, the density in kg/m3, the displacement of surface 4, u_r = 0 on the
# axis. These numbers as they stand give eigenvalues in 1000/s2, and Table 1 for the synthetic
# column: the other reading is SI, with E in N/m2
YOUNGS_MODULUS, POISSONS_RATIO, DENSITY = 2.1e8, 0.3, 7856.0
YOUNGS_MODULUS_SI = 2.1e11
FRICTION, DESCENT = 0.3, 1e-3
# Chosen: gaps of surfaces 2 and 3 at which all four get loaded, and the increments
GAPS = (1e-4, 2e-4)
INCREMENTS = 10
MODES = 6


def stepped_column(
    element: str,
    gaps: tuple[float, float] = GAPS,
    refined: int = 1,
    section: str = "first",
    pattern: DiagonalPattern = "right",
) -> Result:
    """Contact forces on all four surfaces after the last increment, and Table 1's eigenvalues.

    Scalars and curves of surface k end in `_k`; those without a number are of surface 4.
    """
    geometry = PROFILES[section]
    body = _discretised(element, geometry, refined, pattern)
    states = _pressed(body, geometry, (gaps[0], gaps[1]))
    scalars, curves = solver_scalars(states), deformation_curves(body, states[-1])
    nothing = body.K.createVecLeft()
    for pair, face in enumerate(geometry.faces):
        force = states[-1].pairs[pair].force_normal.sum()
        mean = force / (np.pi * (face.outer**2 - face.inner**2))
        numbers, lines = surface_result(body, states[-1], pair, nothing, face.holds, mean)
        scalars |= {f"{name}_{pair + 1}": value for name, value in numbers.items()}
        curves |= {f"{name}_{pair + 1}": line for name, line in lines.items()}
    scalars |= numbers
    scalars |= {"initial_gap_2": gaps[0], "initial_gap_3": gaps[1], "descent": DESCENT}
    for k, (radius, height) in enumerate(zip(geometry.radii, geometry.heights, strict=True), 1):
        scalars |= {f"radius_{k}": radius, f"height_{k}": height}
    modes = _modes(body, geometry)
    scalars |= _mode_scalars(modes)
    for i, shape in enumerate(modes.shapes, start=1):
        curves[f"shape_{i}"] = shape.array_r.reshape(-1, 2)
    return Result(scalars, _units(scalars), curves, dofs=body.K.getSize()[0])


def vibration(
    element: str,
    mass: Literal["consistent", "lumped"] = "consistent",
    guyan: Literal["transposed", "same"] = "transposed",
    pattern: DiagonalPattern = "right",
    refined: int = 1,
    quadrature_degree: int | None = None,
    youngs_modulus: float = YOUNGS_MODULUS,
    section: str = "first",
) -> Result:
    """Table 1's eigenvalues alone, for a variant of an element.

    Args:
        element: its name; a symmetrised one has symmetric parts of both matrices, after the
            condensation.
        mass: consistent, or its row sums, which are condensed afterwards.
        guyan: left matrix of the 8-node element's condensation.
        pattern: diagonals of the quadrilaterals.
        refined: factor of all divisions.
        quadrature_degree: of both matrices on each sub-triangle; 1 is one point.
        youngs_modulus: as printed or in SI.
        section: which synthetic column.
    """
    geometry = PROFILES[section]
    body = _discretised(element, geometry, refined, pattern, quadrature_degree, youngs_modulus)
    modes = _modes(body, geometry, mass, guyan)
    scalars = _mode_scalars(modes)
    return Result(scalars, _units(scalars, youngs_modulus), dofs=body.K.getSize()[0])


def eigenvalues(element: str, section: Profile) -> npt.NDArray[np.float64]:
    """The first six (6,) of a column on an element, in 1000/s2."""
    return _modes(_discretised(element, section), section).eigenvalues


def _discretised(
    element: str,
    section: Profile,
    refined: int = 1,
    pattern: DiagonalPattern = "right",
    quadrature_degree: int | None = None,
    youngs_modulus: float = YOUNGS_MODULUS,
) -> Discretisation:
    material = Material(youngs_modulus, POISSONS_RATIO, DENSITY)
    build = partial(s7_5_profiles.mesh, section, refined=refined, pattern=pattern)
    body = discretise(element, build, material, StressState.AXISYMMETRIC)
    if quadrature_degree is None:
        return body
    elastic = replace(body.body, quadrature_degree=quadrature_degree)
    return Discretisation(element, elastic, assemble_matrix(elastic.stiffness()))


def _pressed(
    body: Discretisation, section: Profile, gaps: tuple[float, float]
) -> list[ContactState]:
    """The column on its three supports, the rigid plane on surface 4 moving down in equal steps."""
    levels = [face.level - gap for face, gap in zip(section.faces, (0.0, *gaps, 0.0), strict=True)]
    steps = np.arange(1, INCREMENTS + 1) / INCREMENTS
    descents = [[], [], [], [Motion((0.0, -DESCENT * s)) for s in steps]]
    pairs = [
        ContactPair(face.holds, Plane((0.0, level), (0.0, -face.outward)), FRICTION, motions)
        for face, level, motions in zip(section.faces, levels, descents, strict=True)
    ]
    on_axis = body.supports([prescribe(body.space, 0, s7_5_profiles.axis)])
    nothing = [body.K.createVecLeft()] * INCREMENTS
    return solve_contact(body.K, nothing, on_axis, pairs, body.space)


def _modes(
    body: Discretisation,
    section: Profile,
    mass: Literal["consistent", "lumped"] = "consistent",
    guyan: Literal["transposed", "same"] = "transposed",
) -> VibrationModes:
    """The column standing on its base, which may slide."""
    M = assemble_matrix(body.body.mass())
    if mass == "lumped":
        M = lumped_mass(M, body.space)
    standing: Reduction = body.supports(
        [
            prescribe(body.space, 0, s7_5_profiles.axis),
            prescribe(body.space, 1, section.faces[0].holds),
        ]
    )
    if len(body.inner_nodes()):
        standing = mass_left(standing, guyan)
    return vibration_modes(body.K, M, standing, MODES, is_symmetrised(body.element))


def _mode_scalars(modes: VibrationModes) -> dict[str, float]:
    scalars = {f"omega2_{i}": value for i, value in enumerate(modes.eigenvalues, start=1)}
    return scalars | {
        "mode_residual": float(modes.residuals.max()),
        "imaginary": modes.imaginary_ratio,
        "rigid": float(modes.n_rigid),
    }


def _units(scalars: Iterable[str], youngs_modulus: float = YOUNGS_MODULUS) -> dict[str, str]:
    """With the printed numbers forces are in kN and eigenvalues as the module's head says."""
    si = youngs_modulus == YOUNGS_MODULUS_SI
    kinds = {
        **CONTACT_UNITS,
        "radius_*": "length",
        "height_*": "length",
        "initial_gap_*": "length",
        "descent": "length",
        "omega2_*": "1/s²" if si else "1000/s²",
        "mode_residual": "1",
        "imaginary": "1",
        "rigid": "1",
    }
    return units_of(scalars, kinds, SI if si else KN_M)


ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
_SAME: dict[str, object] = {"guyan": "same"}
_LUMPED: dict[str, object] = {"mass": "lumped"}
# what can be done to the matrices
TREATMENTS: dict[str, dict[str, object]] = {
    "pwsym-T6": {"element": "pwsym-T6"},
    "pw-T6-lumped": {"element": "pw-T6", **_LUMPED},
    "pwsym-T6-lumped": {"element": "pwsym-T6", **_LUMPED},
    "pw-T6-onepoint": {"element": "pw-T6", "quadrature_degree": 1},
    "pwsym-T6-onepoint": {"element": "pwsym-T6", "quadrature_degree": 1},
    "pw-Q8-same": {"element": "pw-Q8", **_SAME},
    "pw-Q8-lumped": {"element": "pw-Q8", **_LUMPED},
    "pw-Q8-same-lumped": {"element": "pw-Q8", **_SAME, **_LUMPED},
    "pwsym-Q8": {"element": "pwsym-Q8"},
    "pwsym-Q8-same": {"element": "pwsym-Q8", **_SAME},
    "pwsym-Q8-lumped": {"element": "pwsym-Q8", **_LUMPED},
    "pwsym-Q8-same-lumped": {"element": "pwsym-Q8", **_SAME, **_LUMPED},
}
VARIANTS: dict[str, dict[str, object]] = {
    **TREATMENTS,
    # what the lost mesh could change
    "pwsym-T6-left": {"element": "pwsym-T6", "pattern": "left"},
    "galerkin-T6-fine": {"element": "galerkin-T6", "refined": 2},
    "pwsym-T6-fine": {"element": "pwsym-T6", "refined": 2},
    "pw-T6-lumped-fine": {"element": "pw-T6", **_LUMPED, "refined": 2},
    # quadrature for hoop strains, which are no polynomials
    "galerkin-T6-degree12": {"element": "galerkin-T6", "quadrature_degree": 12},
    "pw-T6-degree12": {"element": "pw-T6", "quadrature_degree": 12},
    "galerkin-Q8-degree12": {"element": "galerkin-Q8", "quadrature_degree": 12},
    "galerkin-Q8-SI": {"element": "galerkin-Q8", "youngs_modulus": YOUNGS_MODULUS_SI},
}
# with contact, matrices are those of `vibration` by its defaults
_UNTREATED: dict[str, object] = {
    "mass": "consistent",
    "guyan": "transposed",
    "quadrature_degree": None,
    "youngs_modulus": YOUNGS_MODULUS,
    "friction": FRICTION,
}


def _in_contact(element: str, suffix: str = "", **parameters: object) -> Case:
    given = {"element": element, **parameters}
    return Case("7.5", element + suffix, stepped_column, given, _UNTREATED)


CASES = [_in_contact(element) for element in ELEMENTS]
CASES += [_in_contact(element, "-fine", refined=2) for element in ("pw-T6", "pw-Q9")]
CASES += [_in_contact("pw-T6", suffix, **given) for suffix, given in UNPRINTED_DATA["7.5"].items()]
CASES += [
    _in_contact(element, suffix, **given)
    for element in ("galerkin-T6", "pw-T6")
    for suffix, given in OTHER_DIAGONALS["7.5"].items()
]
CASES += [Case("7.5", name, vibration, variant) for name, variant in VARIANTS.items()]

# what the lost section could change: another column with the printed eigenvalues
_SECOND = UNPRINTED_DATA["7.5"]["-second"]
CASES += [
    _in_contact(element, "-second", **_SECOND)
    for element in ("galerkin-T6", "galerkin-Q8", "pw-Q8")
]
CASES += [
    Case("7.5", f"{name}-second", vibration, {**variant, **_SECOND})
    for name, variant in TREATMENTS.items()
]

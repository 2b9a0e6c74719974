"""Flat punches with sharp edges: smooth and bonded in the plane, smooth and round."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pw_elements.contact import FlatPunch
from pw_elements.elasticity import StressState
from study.model.units import units_of
from study.run.cases import Case
from study.run.store import Result
from study.solutions.half_space import BondedLine, Elastic, FlatLine, FlatRound, KnownContact
from study.solutions.indentation import ELEMENTS, OUTER, Indenter, borders, series

SECTION = "V3"
TITLE = "Flat punches"

BODY, HALF_WIDTH, FORCE = Elastic(1000.0, 0.3), 1.0, 3.0
KINDS: dict[str, tuple[KnownContact, StressState]] = {
    "smooth": (FlatLine(BODY, HALF_WIDTH, FORCE), StressState.PLANE_STRAIN),
    "bonded": (BondedLine(BODY, HALF_WIDTH, FORCE), StressState.PLANE_STRAIN),
    "round": (FlatRound(BODY, HALF_WIDTH, FORCE), StressState.AXISYMMETRIC),
}
# Elements over the half width
LEVELS = (4, 8, 16, 32)
# Graded meshes have lines at x = b (1 - (1 - s)^GRADING), s in equal steps
GRADING = 1.5


def punch(
    element: str, kind: str, graded: bool = False, outer: float = OUTER, far_field: bool = True
) -> Result:
    """One kind of punch on one element.

    Args:
        element: name.
        kind: of `KINDS`.
        graded: whether elements get finer towards the punch's edge; they are even otherwise.
        outer: side of the body over the half width of the punch.
        far_field: whether its outer sides have the exact displacements, or are held.
    """
    known, state = KINDS[kind]
    surface = FlatPunch((0.0, 0.0), (0.0, -1.0), HALF_WIDTH)
    meshes = {n: [_lines(n, GRADING if graded else 1.0)] for n in LEVELS}
    result = series(element, Indenter(known, surface, state), meshes, outer, far_field)
    if not isinstance(known, BondedLine):
        return result
    exact = -float(known.shear_within(np.array([HALF_WIDTH]))[0])
    scalars = {
        "exact_force_tangential": exact,
        "error_force_tangential": abs(result.scalars["force_tangential"] / exact - 1),
    }
    exact_force = {"exact_force_t": -np.diff(known.shear_within(borders(result.curves["x"])))}
    kinds = {"exact_force_tangential": "force", "error_*": "1"}
    return replace(
        result,
        scalars={**result.scalars, **scalars},
        units={**result.units, **units_of(scalars, kinds)},
        curves={**result.curves, **exact_force},
    )


def exact(kind: str) -> Result:
    """Exact tractions of the body on a punch, and their mean; none at the edge."""
    known, state = KINDS[kind]
    x = HALF_WIDTH * np.sin(np.linspace(0, np.pi / 2, 400)[:-1])
    area = np.pi * HALF_WIDTH**2 if state is StressState.AXISYMMETRIC else 2 * HALF_WIDTH
    scalars = {"mean_pressure": FORCE / area, "poissons_ratio": BODY.poissons_ratio}
    curves = {"x": x, "pressure": known.pressure(x)}
    if isinstance(known, BondedLine):
        curves["shear"] = -known.shear(x)
        scalars["oscillation"] = known.oscillation
        # 1 - x/b where eta log((b + x)/(b - x)) = pi/2
        scalars["sign_change"] = float(1 - np.tanh(np.pi / (4 * known.oscillation)))
    return Result(scalars, units_of(scalars, {"mean_pressure": "stress", "*": "1"}), curves)


def _lines(elements: int, grading: float) -> npt.NDArray[np.float64]:
    return HALF_WIDTH * (1 - np.linspace(1, 0, elements + 1) ** grading)


CASES = [
    Case("V3", f"{kind}-{element}{suffix}", punch, {"element": element, "kind": kind, **mesh})
    for kind in KINDS
    for element in ELEMENTS
    for suffix, mesh in (("", {}), ("-graded", {"graded": True}))
]
CASES += [
    Case("V3", f"{kind}-pw-T6-{suffix}", punch, {"element": "pw-T6", "kind": kind, **size})
    for kind in KINDS
    for suffix, size in (("held", {"far_field": False}), ("outer10", {"outer": 10.0}))
]
CASES += [Case("V3", f"{kind}-exact", exact, {"kind": kind}) for kind in KINDS]

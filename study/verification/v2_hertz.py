"""Hertz contact: a rigid cylinder on a half plane, a rigid sphere on a half space.

The cylinder has the numbers of the NAFEMS contact benchmark 1 (A. W. A. Konter, "Advanced Finite
Element Contact Benchmarks", NAFEMS R0094, 2006): a steel cylinder of radius 50 mm pressed with 35
kN into an aluminium block 200 mm x 200 mm of thickness 1 mm, plane strain. There both bodies are
elastic. In Hertz's theory a rigid cylinder of the same radius on a half plane of the composite
modulus 1/E* = (1 - nu1²)/E1 + (1 - nu2²)/E2 has the same width and pressure, and that is what is
computed. The benchmark's contact of two meshes, and its friction, are not.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pw_elements.contact import Parabola, Sphere
from pw_elements.elasticity import StressState
from study.model.units import N_MM, units_of
from study.run.cases import Case
from study.run.store import Result
from study.solutions.half_space import Elastic, HertzLine, HertzSphere
from study.solutions.indentation import ELEMENTS, OUTER, Indenter, series
from study.verification.recorded import longer, parted

TITLE = "Hertz contact"

# NAFEMS R0094-1 in N and mm
RADIUS, FORCE, POISSONS_RATIO = 50.0, 35e3, 0.3
STEEL, ALUMINIUM = 210e3, 70e3

# Elements over the half width; its end falls on these parts of an element
LEVELS = (4, 8, 16, 32)
PLACES = (0.125, 0.375, 0.625, 0.875)
# Elements may touch up to this many half widths
ZONE = 1.3


def cylinder(
    element: str, true_circle: bool = False, outer: float = OUTER, far_field: bool = True
) -> Result:
    """The rigid cylinder on the half plane of the composite modulus.

    Args:
        element: name.
        true_circle: gaps to the circle along its normal, instead of Hertz's parabola.
        outer: side of the body over the half width of the contact.
        far_field: whether its outer sides have the exact displacements, or are held.
    """
    compliance = (1 - POISSONS_RATIO**2) * (1 / STEEL + 1 / ALUMINIUM)
    body = Elastic((1 - POISSONS_RATIO**2) / compliance, POISSONS_RATIO)
    known = HertzLine(body, RADIUS, FORCE)
    circle = Sphere((0.0, RADIUS), RADIUS)
    surface = circle if true_circle else Parabola((0.0, 0.0), RADIUS)
    indenter = Indenter(known, surface, StressState.PLANE_STRAIN, N_MM)
    return _against(element, indenter, outer, far_field)


def sphere(element: str, outer: float = OUTER, far_field: bool = True) -> Result:
    """A rigid sphere with the cylinder's radius, force and material on a half space."""
    known = HertzSphere(Elastic(ALUMINIUM, POISSONS_RATIO), RADIUS, FORCE)
    paraboloid = Parabola((0.0, 0.0), RADIUS)
    indenter = Indenter(known, paraboloid, StressState.AXISYMMETRIC, N_MM)
    return _against(element, indenter, outer, far_field)


def _against(element: str, indenter: Indenter, outer: float, far_field: bool) -> Result:
    known = indenter.known
    assert isinstance(known, HertzLine | HertzSphere)
    meshes = {n: [_lines(known.half_width, n + q) for q in PLACES] for n in LEVELS}
    result = series(element, indenter, meshes, outer, far_field)
    scalars = {
        "exact_radius": known.half_width,
        "exact_peak": known.peak,
        "indenter_radius": known.radius,
    }
    kinds = {"*_radius": "length", "exact_peak": "stress"}
    return replace(
        result,
        scalars={**result.scalars, **scalars},
        units={**result.units, **units_of(scalars, kinds, indenter.units)},
    )


def _lines(half_width: float, elements: float) -> npt.NDArray[np.float64]:
    size = half_width / elements
    return size * np.arange(np.ceil(ZONE * elements) + 1)


CASES = [Case("V2", f"line-{element}", cylinder, {"element": element}) for element in ELEMENTS]
CASES += [Case("V2", f"sphere-{element}", sphere, {"element": element}) for element in ELEMENTS]
CASES += [
    Case("V2", f"{name}-pw-T6-{suffix}", run, {"element": "pw-T6", **size})
    for name, run in (("line", cylinder), ("sphere", sphere))
    for suffix, size in (("held", {"far_field": False}), ("outer10", {"outer": 10.0}))
]
CASES.append(Case("V2", "line-pw-T6-circle", cylinder, {"element": "pw-T6", "true_circle": True}))
CASES, LONGER = parted(CASES, "*-pw-T6-*", "*-pw-Q8")
"""Computed by `longer`."""
CASES += longer("V2")

"""What is known about the element: solvability, uniqueness and the family P_k."""

from study.benchmarks.e_element.family import DEGREES, element_of_degree, hertz
from study.benchmarks.e_element.solvability import (
    ambiguous_contact,
    contact_uniqueness,
    mass_pairs,
    solvability_map,
)
from study.run.cases import Case, mark_costly

SECTION = "E"
TITLE = "When the element has a solution, and when only one"
FACTS = {
    "geometry": "a unit square or cube, stretched up to a thousandfold; a half plane",
    "reference": "the standard element's matrices on the same meshes",
    "uncertainty": "random meshes",
}
RESULT = "..."

ELEMENTS = ("pw-T6", "pw-Q8", "pw-Q9", "pw-T10", "pw-H27")
ELEMENTS_IN_CONTACT = ("pw-T6", "pw-Q9", "pw-T10", "pw-H27")
GEOMETRIES = ("affine", "straight", "curved")
CASES = [
    Case("E", f"map-{e}-{g}", solvability_map, {"element": e, "geometry": g})
    for e in ELEMENTS
    for g in GEOMETRIES
]
CASES += [
    Case("E", f"contact-{e}-{g}", contact_uniqueness, {"element": e, "geometry": g})
    for e in ELEMENTS_IN_CONTACT
    for g in GEOMETRIES[1:]
]
CASES = mark_costly(CASES)
CASES += [
    Case(
        "E",
        f"two-solutions-{element}-{geometry}",
        ambiguous_contact,
        {"element": element, "geometry": geometry, "nu": nu, "shift": shift, "seed": seed},
    )
    for element, geometry, nu, shift, seed in (
        ("pw-T6", "curved", 0.499, 0.05, 0),
        ("pw-T10", "straight", 0.4999, 0.3, 0),
        ("pw-H27", "straight", 0.4999, 0.2, 0),
    )
]
CASES += [
    Case(
        "E",
        f"degree-{degree}",
        element_of_degree,
        {"degree": degree},
        {"compared": [f"galerkin-P{degree}", f"pw-P{degree}"]},
    )
    for degree in DEGREES
]
CASES += [
    Case(
        "E",
        f"hertz-{kind}-P{degree}",
        hertz,
        {"degree": degree, "weights": weights},
        {"method": f"{kind}-P{degree}"},
    )
    for kind, weights in (("pw", "new"), ("galerkin", "standard"))
    for degree in DEGREES[1:4]
]
CASES += [Case("E", f"mass-{e}", mass_pairs, {"element": e}) for e in ("pw-T6", "pw-T10")]

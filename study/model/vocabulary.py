"""Names of elements, methods, loads and contact statuses.

This module does not import the solver. Each element has the same name, marker and colour in all
tables, legends, captions and claims.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class ElementStyle:
    """Name and appearance of an element or a method in tables and figures.

    Attributes:
        name: Name in tables, legends and prose.
        marker: Matplotlib marker for nodes.
        colour: Colour of lines and markers, from Okabe and Ito's palette; two colours are darker
            for contrast with a white background.
    """

    name: str
    marker: str
    colour: str


# Elements by their names in result files, which contain T (triangle or tetrahedron),
# Q (quadrilateral) or H (hexahedron) and the number of nodes
ELEMENTS = {
    "galerkin-T6": ElementStyle("standard T6", "^", "#D55E00"),
    "pw-T6": ElementStyle("new T6", "o", "#0072B2"),
    "pwsym-T6": ElementStyle("new T6, symmetrised", "d", "#56B4E9"),
    "sibling-T6": ElementStyle("symmetric sibling T6", "x", "#2B7FB8"),
    "composite-T6": ElementStyle("composite T6", "v", "#B0568C"),
    "galerkin-Q8": ElementStyle("standard Q8", "s", "#B87A00"),
    "pw-Q8": ElementStyle("new Q8, condensed pair", "D", "#007A5A"),
    "pwsym-Q8": ElementStyle("new Q8, symmetrised", "p", "#5FB596"),
    "pw-Q9": ElementStyle("new Q9, condensed centre", "P", "#6A4C93"),
    "galerkin-T10": ElementStyle("standard T10", "<", "#8C3B00"),
    "transferred-T10": ElementStyle("standard T10, forces times T", "X", "#E07B39"),
    "sibling-T10": ElementStyle("symmetric sibling T10", "H", "#3A9BD9"),
    "pw-T10": ElementStyle("new T10", ">", "#00406B"),
    "onecut-T10": ElementStyle("new T10, one cut", "h", "#4D8FB8"),
    "galerkin-H27": ElementStyle("standard H27", "8", "#806000"),
    "pw-H27": ElementStyle("new H27", "*", "#00543D"),
    "galerkin-hybrid-T6": ElementStyle("standard hybrid T6", "+", "#A65E2E"),
    "pw-hybrid-T6": ElementStyle("new hybrid T6", ".", "#1B9E9E"),
    "galerkin-hybrid-T10": ElementStyle("standard hybrid T10", "1", "#6B4226"),
    "pw-hybrid-T10": ElementStyle("new hybrid T10", "2", "#0B6E6E"),
    "galerkin-hybrid-Q9": ElementStyle("standard hybrid Q9", r"$\ominus$", "#9C6BAA"),
    "pw-hybrid-Q9": ElementStyle("new hybrid Q9", r"$\oplus$", "#3F2A5E"),
    "galerkin-hybrid-H27": ElementStyle("standard hybrid H27", r"$\otimes$", "#A08A3C"),
    "pw-hybrid-H27": ElementStyle("new hybrid H27", r"$\odot$", "#2F7A4F"),
    "exact": ElementStyle("exact", "", "#000000"),
}

# Methods for contact between two bodies with non-matching meshes
TWO_BODY_METHODS = {
    "pw-dual": ElementStyle("new weights, their duals", "o", "#0072B2"),
    "pw-dual-gap": ElementStyle("new weights, gaps by duals", "P", "#56B4E9"),
    "p2-dual": ElementStyle("standard, dual quadratic", "D", "#007A5A"),
    "p2-p2": ElementStyle("standard, quadratic multipliers", "^", "#D55E00"),
    "p2-p1": ElementStyle("standard, linear multipliers", "s", "#B87A00"),
    "node-to-segment": ElementStyle("standard, node to segment", "v", "#B0568C"),
}


@dataclass(frozen=True)
class StressReading:
    """Rule that gives the stress at a contact node from its force.

    Attributes:
        name: Adjective that precedes the word "stress".
        meaning: Definition of the stress, including the divisor of the force.
    """

    name: str
    meaning: str


# In result files, the curves "pressure" and "shear" are own-function readings; curves whose names
# end in "_tributary" are tributary readings
OWN_FUNCTION_READING = StressReading(
    "own-function", "nodal force over the integral of the node's own test function"
)
TRIBUTARY_READING = StressReading(
    "tributary",
    "nodal force over the part of the surface nearest to the node, as node-to-surface codes print",
)
UNDEFINED_READING_NOTE = (
    "no reading where that integral is zero: at corners of the standard T10, and on the axis of "
    "rotation for the standard T6 and Q8"
)
"""Note on the nodes at which the own-function reading is undefined."""

PLANE_ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
"""Elements of the plane contact examples, in the order of tables."""

# Loads of the beam in section 7.6: the load of the paper, and one for which the critical stresses
# converge
BEAM_LOAD_NAMES = {"point": "concentrated load at A", "uniform": "uniform load on the end"}

# Status of a contact node, numbered as in the library (checked by a test)
OPEN, STICK, SLIP = 0, 1, 2
STATUS_NAMES = {OPEN: "open", STICK: "sticking", SLIP: "slipping"}

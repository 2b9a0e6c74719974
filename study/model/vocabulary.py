"""Words that the whole study shares, free of any solver: elements, loads, states of contact nodes.

An element has one name, one marker and one colour in tables, legends, captions and claims.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Element:
    """An element that the study compares.

    Attributes:
        name: In tables, legends and prose.
        marker: Matplotlib's, for its nodes in figures.
        colour: Of its lines and markers; Okabe and Ito's, two of them darkened to be seen on white.
    """

    name: str
    marker: str
    colour: str


# By the names of result files; T: triangles or tetrahedra, Q: quadrilaterals, H: hexahedra, with
# their nodes
ELEMENTS = {
    "galerkin-T6": Element("standard T6", "^", "#D55E00"),
    "pw-T6": Element("new T6", "o", "#0072B2"),
    "pwsym-T6": Element("new T6, symmetrised", "d", "#56B4E9"),
    "sibling-T6": Element("symmetric sibling T6", "x", "#2B7FB8"),
    "composite-T6": Element("composite T6", "v", "#B0568C"),
    "galerkin-Q8": Element("standard Q8", "s", "#B87A00"),
    "pw-Q8": Element("new Q8, condensed pair", "D", "#007A5A"),
    "pwsym-Q8": Element("new Q8, symmetrised", "p", "#5FB596"),
    "pw-Q9": Element("new Q9, condensed centre", "P", "#6A4C93"),
    "galerkin-T10": Element("standard T10", "<", "#8C3B00"),
    "transferred-T10": Element("standard T10, forces times T", "X", "#E07B39"),
    "sibling-T10": Element("symmetric sibling T10", "H", "#3A9BD9"),
    "pw-T10": Element("new T10", ">", "#00406B"),
    "onecut-T10": Element("new T10, one cut", "h", "#4D8FB8"),
    "galerkin-H27": Element("standard H27", "8", "#806000"),
    "pw-H27": Element("new H27", "*", "#00543D"),
    "galerkin-hybrid-T6": Element("standard hybrid T6", "+", "#A65E2E"),
    "pw-hybrid-T6": Element("new hybrid T6", ".", "#1B9E9E"),
    "galerkin-hybrid-T10": Element("standard hybrid T10", "1", "#6B4226"),
    "pw-hybrid-T10": Element("new hybrid T10", "2", "#0B6E6E"),
    "galerkin-hybrid-Q9": Element("standard hybrid Q9", r"$\ominus$", "#9C6BAA"),
    "pw-hybrid-Q9": Element("new hybrid Q9", r"$\oplus$", "#3F2A5E"),
    "galerkin-hybrid-H27": Element("standard hybrid H27", r"$\otimes$", "#A08A3C"),
    "pw-hybrid-H27": Element("new hybrid H27", r"$\odot$", "#2F7A4F"),
    "exact": Element("exact", "", "#000000"),
}

# Ways to state contact of two bodies whose meshes do not match
WAYS = {
    "pw-dual": Element("new weights, their duals", "o", "#0072B2"),
    "pw-dual-gap": Element("new weights, gaps by duals", "P", "#56B4E9"),
    "p2-dual": Element("standard, dual quadratic", "D", "#007A5A"),
    "p2-p2": Element("standard, quadratic multipliers", "^", "#D55E00"),
    "p2-p1": Element("standard, linear multipliers", "s", "#B87A00"),
    "node-to-segment": Element("standard, node to segment", "v", "#B0568C"),
}


@dataclass(frozen=True)
class Reading:
    """A way to read the stress at a contact node from its force.

    Attributes:
        name: Of the stress, as an adjective.
        meaning: What the force is divided by.
    """

    name: str
    meaning: str


# By the curves of result files: "pressure" and "shear" are read by OWN, with the ending
# "_tributary" by TRIBUTARY
OWN = Reading("own-function", "nodal force over the integral of the node's own test function")
TRIBUTARY = Reading(
    "tributary",
    "nodal force over the part of the surface nearest to the node, as node-to-surface codes print",
)
NO_WEIGHT = (
    "no reading where that integral is zero: at corners of the standard T10, and on the axis of "
    "rotation for the standard T6 and Q8"
)
"""Where OWN is undefined."""

PLANE_ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
"""Those of the contact examples, in the order of tables."""

# Loads of the beam in section 7.6: printed, and the one whose values converge
LOADS = {"point": "concentrated load at A", "uniform": "uniform load on the end"}

# What a contact node does, as the library numbers it; a test compares
OPEN, STICK, SLIP = 0, 1, 2
STATUS = {OPEN: "open", STICK: "sticking", SLIP: "slipping"}

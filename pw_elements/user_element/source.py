"""Source files of a user element: the kernels in the frame of Abaqus' user subroutine UEL."""

import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import ffcx

import pw_elements
from pw_elements.abaqus import ABAQUS_EDGE_CORNERS, abaqus_nodes_and_facets_in_dolfinx_order
from pw_elements.elasticity import StressState
from pw_elements.user_element.forms import create_element_forms
from pw_elements.user_element.kernels import generate_kernels

CELLS = ("triangle", "tetrahedron")
LAWS = ("linear", "neo-hookean")

# Kernels in the order of the members of `struct kernels` in uel.c
_KERNEL_NAMES = (
    "jacobian_determinant",
    "volume_ratio",
    "internal_force",
    "stiffness",
    "initial_stress",
    "mass",
    "pressure",
    "traction",
    "body_force",
    "stress",
)
_GEOMETRY_DEGREES = {"straight": 1, "curved": 2}
_N_STRESS_POINTS = 4
_HEADER_WIDTH = 92


@dataclass(frozen=True)
class UserElement:
    """Source code of a user element.

    Args:
        name: name of the C function, such as "pw_t6_plane_strain".
        c_source: C source with the user subroutine UEL, which needs no other file.
        fortran_source: UEL in Fortran, which may replace that of the C source.
    """

    name: str
    c_source: str
    fortran_source: str


@dataclass(frozen=True)
class _ElementKind:
    """Cell, state of stress and law of an element, and the numbers that follow from them."""

    cell: str
    state: StressState
    law: str

    def __post_init__(self) -> None:
        if self.cell not in CELLS:
            raise ValueError(f"cell {self.cell!r}: the cells are {', '.join(CELLS)}")
        if (self.cell == "tetrahedron") != self.is_solid:
            raise ValueError(
                f"a {self.cell} in the state {self.state.value!r}: tetrahedra need 'solid', "
                "triangles another state"
            )
        if self.law not in LAWS:
            raise ValueError(f"law {self.law!r}: the laws are {', '.join(LAWS)}")
        if not self.is_linear and self.state is not StressState.PLANE_STRAIN:
            raise ValueError("the law 'neo-hookean' is available in plane strain only")

    @property
    def is_solid(self) -> bool:
        return self.state is StressState.SOLID

    @property
    def is_axisymmetric(self) -> bool:
        return self.state is StressState.AXISYMMETRIC

    @property
    def is_linear(self) -> bool:
        return self.law == "linear"

    @property
    def has_thickness(self) -> bool:
        return not (self.is_solid or self.is_axisymmetric)

    @property
    def dim(self) -> int:
        return 3 if self.is_solid else 2

    @property
    def n_nodes(self) -> int:
        return 10 if self.is_solid else 6

    @property
    def n_properties(self) -> int:
        return 4 if self.has_thickness else 3

    @property
    def n_stresses(self) -> int:
        return 6 if self.is_solid else 4

    @property
    def name(self) -> str:
        if self.is_solid:
            return "pw_t10"
        return "pw_t6_" + (self.state.value.replace(" ", "_") if self.is_linear else "neo_hookean")

    @property
    def title(self) -> str:
        cell = "10-node tetrahedron" if self.is_solid else f"6-node triangle, {self.state.value}"
        law = "linear elastic" if self.is_linear else "neo-Hookean"
        return f"{cell}, {law}, with piecewise-linear weight functions"

    @property
    def max_poissons_ratio(self) -> str:
        """Condition of C for Poisson's ratio; 1/2 needs plane stress."""
        return "<= 0.5" if self.state is StressState.PLANE_STRESS else "< 0.5"


def generate_user_element(cell: str, state: StressState | str, law: str = "linear") -> UserElement:
    """Generate the source code of a user element from the UFL forms of the library.

    Args:
        cell: "triangle" (6 nodes) or "tetrahedron" (10 nodes).
        state: a `StressState`, or its value as a string, such as "plane strain".
        law: "linear" for linear elasticity, or "neo-hookean" for large strains in plane strain.

    Raises:
        ValueError: if there is no such element.
    """
    try:
        state = StressState(state)
    except ValueError:
        names = ", ".join(repr(known_state.value) for known_state in StressState)
        raise ValueError(f"state {state!r}: the states are {names}") from None
    kind = _ElementKind(cell, state, law)
    kernels: list[str] = []
    tables: dict[str, str] = {}
    for geometry, degree in _GEOMETRY_DEGREES.items():
        forms = create_element_forms(cell, state, not kind.is_linear, degree)
        functions = generate_kernels(forms, geometry)
        kernels += functions.values()
        tables[geometry.upper()] = ", ".join(
            f"{geometry}_{name}" if name in functions else "NULL" for name in _KERNEL_NAMES
        )
    values = {
        **_template_values(kind),
        **tables,
        "KERNELS": "\n\n".join(kernels),
        "HEADER": _describe_element(kind),
    }
    folder = Path(__file__).parent
    return UserElement(
        kind.name,
        _fill_template((folder / "uel.c").read_text(), values),
        _fill_template((folder / "uel.f").read_text(), values),
    )


def _fill_template(template: str, values: Mapping[str, object]) -> str:
    """Replace @NAME@ by the value of NAME."""
    return re.sub(r"@([A-Z_]+)@", lambda match: str(values[match[1]]), template)


def _template_values(kind: _ElementKind) -> dict[str, object]:
    node_numbers, face_of_facet = abaqus_nodes_and_facets_in_dolfinx_order(kind.cell, 2)
    edges = ABAQUS_EDGE_CORNERS[kind.cell]
    nu = kind.max_poissons_ratio
    conditions = ["props[0] > 0", "props[1] > -1", f"props[1] {nu}", "props[2] >= 0"]
    rules = ["Young's modulus > 0", f"Poisson's ratio > -1 and {nu}", "density >= 0"]
    if kind.has_thickness:
        conditions.append("props[3] > 0")
        rules.append("thickness > 0")
    return {
        "NAME": kind.name,
        "UPPER_NAME": kind.name.upper(),
        "TITLE": kind.title,
        "VERSION": pw_elements.__version__,
        "FFCX": ffcx.__version__,
        "DIM": kind.dim,
        "NODES": kind.n_nodes,
        "STRESS_POINTS": _N_STRESS_POINTS,
        "STRESSES": kind.n_stresses,
        "PROPERTIES": kind.n_properties,
        "IS_LINEAR": int(kind.is_linear),
        "IS_AXISYMMETRIC": int(kind.is_axisymmetric),
        "NODE_NUMBERS": ", ".join(map(str, node_numbers)),
        "FACE_NUMBERS": ", ".join(str(face_of_facet.index(k)) for k in range(kind.dim + 1)),
        "EDGE_ENDS": ", ".join(f"{{{', '.join(ends)}}}" for ends in edges),
        "PROPERTY_CHECK": " && ".join(conditions),
        "PROPERTY_RULE": ", ".join(rules),
        "PERTURBED_STRESS": (
            "kernels->stress(stress, change, props, NULL, x, NULL);"
            if kind.is_linear
            else "memcpy(stress, svars, sizeof stress); /* those of the base state */"
        ),
    }


def _describe_element(kind: _ElementKind) -> str:
    """Return the text at the top of the C file: theory, units, lines of the deck, limits."""
    units = "Units: any consistent ones, such as N, mm, MPa, t and s."
    if kind.is_axisymmetric:
        units += " Coordinates are (r, z); forces are those of the whole circumference."
    element = (
        f"*USER ELEMENT, TYPE=U1, NODES={kind.n_nodes}, COORDINATES={kind.dim}, PROPERTIES="
        f"{kind.n_properties}, VARIABLES={_N_STRESS_POINTS * kind.n_stresses}, UNSYMM"
    )
    degrees_of_freedom = ", ".join(str(i + 1) for i in range(kind.dim))
    properties = "*UEL PROPERTY: 1 Young's modulus, 2 Poisson's ratio, 3 density"
    if kind.has_thickness:
        properties += ", 4 thickness"
    loads = (
        "*DLOAD: Un pressure on face Sn; Ukn force per area in direction k on face Sn, such as "
        "U21; U4k force per volume in direction k. Loads act on the undeformed element. Types "
        "UnNU are not supported."
    )
    eigenvalues = (
        "Abaqus uses symmetric parts of the matrices in frequency steps, and does not call user "
        "elements in *BUCKLE steps: see docs/how-to/user-element.md."
    )
    paragraphs = [
        _describe_theory(kind),
        units,
        _describe_geometry(kind),
        element,
        degrees_of_freedom,
        properties + ".",
        loads,
        _describe_stresses(kind),
        _describe_procedures(kind),
        eigenvalues,
    ]
    lines = [
        line
        for text in paragraphs
        for line in textwrap.wrap(text, _HEADER_WIDTH, break_on_hyphens=False)
    ]
    return "\n".join(f" * {line}" for line in lines)


def _describe_theory(kind: _ElementKind) -> str:
    text = (
        "Theory: M. Klisinski, Ch. Luo, E. Postek, Discussion on application of piece-wise linear "
        "weight functions in 2D contact problems (2001). Displacements are quadratic, Eq. (4); "
        "weights are linear on sub-cells, Eq. (15) to (20)"
    )
    text += (
        ", here on twelve sub-cells of the tetrahedron, which the paper does not have. "
        if kind.is_solid
        else ". "
    )
    if kind.is_linear:
        text += (
            "Strain Eq. (5), stress Eq. (6), stiffness Eq. (10), mass Eq. (11), loads Eq. (12), "
            "initial stress Eq. (25) and (26). "
        )
    else:
        text += (
            "Mass Eq. (11), loads Eq. (12). The first Piola-Kirchhoff stress is "
            "P = mu (F - F^-T) + lambda ln(J) F^-T with J = det F, and mu and lambda follow from "
            "Young's modulus and Poisson's ratio. "
        )
    return text + "The matrices are not symmetric."


def _describe_geometry(kind: _ElementKind) -> str:
    if kind.is_solid:
        nodes = (
            "Nodes as in C3D10: corners 1 to 4, mid-side nodes 5 (1-2), 6 (2-3), 7 (3-1), 8 (1-4), "
            "9 (2-4), 10 (3-4). Faces: S1 1-2-3, S2 1-4-2, S3 2-4-3, S4 3-4-1."
        )
    else:
        nodes = (
            "Nodes as in CPE6: corners 1 to 3, mid-side nodes 4 (1-2), 5 (2-3), 6 (3-1). "
            "Faces: S1 1-2, S2 2-3, S3 3-1."
        )
    return nodes + (
        " A cell is straight if all mid-side nodes lie in the middle of their edges to 1e-6 of the "
        "length; otherwise all its integrals are those of a curved cell."
    )


def _describe_stresses(kind: _ElementKind) -> str:
    components = "11, 22, 33, 12, 13, 23" if kind.is_solid else "11, 22, 33, 12"
    points = (
        "the corners 1 to 4"
        if kind.is_solid
        else "the centres of the sub-triangles at corners 1, 2, 3 and in the middle"
    )
    text = (
        f"State variables (SDV): stresses {components} at the first of four points, then at the "
        f"next ones: {points}."
    )
    if kind.state is StressState.PLANE_STRESS:
        return text + " Stress 33 is zero."
    return text if kind.is_linear else text + " They are true stresses."


def _describe_procedures(kind: _ElementKind) -> str:
    text = (
        "Procedures: static steps, also by Riks' method; static perturbation steps; stiffness and "
        "mass for frequency steps. No implicit dynamics, no damping. "
    )
    if kind.is_linear:
        return text + (
            "Strains are small, and NLGEOM changes nothing in a general step. In a perturbation "
            "step after one with NLGEOM, the stiffness contains the initial stress of the base "
            "state."
        )
    return text + (
        "Strains are large, and all steps need NLGEOM=YES. In perturbation steps the state "
        "variables keep the stresses of the base state."
    )

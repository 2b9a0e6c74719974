"""Source files of a user element: the kernels in the frame of Abaqus' user subroutine UEL."""

import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import ffcx

import pw_elements
from pw_elements.abaqus import ABAQUS_EDGE_CORNERS, abaqus_nodes_and_facets_in_dolfinx_order
from pw_elements.elasticity import StressState
from pw_elements.user_element.forms import create_element_forms
from pw_elements.user_element.kernels import generate_kernels

Law = Literal["linear", "neo-hookean"]

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
_WIDTH_OF_HEADER = 92


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


def generate_user_element(cell: str, state: StressState, law: Law = "linear") -> UserElement:
    """Generate the source code of a user element from the UFL forms of the library.

    Args:
        cell: "triangle" (6 nodes) or "tetrahedron" (10 nodes).
        state: state of stress.
        law: "linear" for linear elasticity, or "neo-hookean" for large strains in plane strain.

    Raises:
        ValueError: if there is no such element.
    """
    if cell not in ("triangle", "tetrahedron"):
        raise ValueError(f"cell {cell!r}: the cells are 'triangle' and 'tetrahedron'")
    if (cell == "tetrahedron") != (state is StressState.SOLID):
        raise ValueError(
            f"a {cell} in the state {state.value!r}: tetrahedra need 'solid', triangles another one"
        )
    if law not in ("linear", "neo-hookean"):
        raise ValueError(f"law {law!r}: the laws are 'linear' and 'neo-hookean'")
    if law == "neo-hookean" and state is not StressState.PLANE_STRAIN:
        raise ValueError("the law 'neo-hookean' is available in plane strain only")
    is_linear, is_solid = law == "linear", state is StressState.SOLID
    dim = 3 if is_solid else 2
    n_nodes, name = (10, "pw_t10") if is_solid else (6, "pw_t6_" + state.value.replace(" ", "_"))
    if not is_linear:
        name = "pw_t6_neo_hookean"
    kernels, members = [], {}
    for degree, prefix in ((1, "straight"), (2, "curved")):
        functions = generate_kernels(
            create_element_forms(cell, state, not is_linear, degree), prefix
        )
        kernels += functions.values()
        members[prefix] = ", ".join(
            f"{prefix}_{kernel}" if kernel in functions else "NULL" for kernel in _KERNEL_NAMES
        )
    node_numbers, face_of_facet = abaqus_nodes_and_facets_in_dolfinx_order(cell, 2)
    is_plane = state in (StressState.PLANE_STRESS, StressState.PLANE_STRAIN)
    allows_incompressible = state is StressState.PLANE_STRESS
    values = {
        "NAME": name,
        "UPPER_NAME": name.upper(),
        "VERSION": pw_elements.__version__,
        "FFCX": ffcx.__version__,
        "DIM": dim,
        "NODES": n_nodes,
        "STRESSES": 6 if is_solid else 4,
        "PROPERTIES": 4 if is_plane else 3,
        "IS_LINEAR": int(is_linear),
        "IS_AXISYMMETRIC": int(state is StressState.AXISYMMETRIC),
        "NODE_NUMBERS": ", ".join(map(str, node_numbers)),
        "FACE_NUMBERS": ", ".join(str(face_of_facet.index(face)) for face in range(dim + 1)),
        "EDGE_ENDS": ", ".join(
            "{" + ", ".join(corners) + "}" for corners in ABAQUS_EDGE_CORNERS[cell]
        ),
        "KERNELS": "\n\n".join(kernels),
        "STRAIGHT": members["straight"],
        "CURVED": members["curved"],
        "PROPERTY_CHECK": "props[0] > 0 && props[1] > -1 && props[1] "
        + ("<= 0.5" if allows_incompressible else "< 0.5")
        + " && props[2] >= 0"
        + (" && props[3] > 0" if is_plane else ""),
        "PROPERTY_RULE": "Young's modulus > 0, Poisson's ratio > -1 and "
        + ("<= 0.5" if allows_incompressible else "< 0.5")
        + ", density >= 0"
        + (", thickness > 0" if is_plane else ""),
        "PERTURBED_STRESS": "kernels->stress(stress, change, props, NULL, x, NULL);"
        if is_linear
        else "memcpy(stress, svars, sizeof stress); /* those of the base state */",
    }
    title = {
        "solid": "10-node tetrahedron",
        "axisymmetric": "Axisymmetric 6-node triangle",
    }.get(state.value, f"6-node triangle in {state.value}")
    values["TITLE"] = (
        f"{title} with piecewise-linear weight functions, "
        f"{'linear elastic' if is_linear else 'neo-Hookean'}"
    )
    values["HEADER"] = _describe_element(state, is_linear, values)
    folder = Path(__file__).parent
    return UserElement(
        name,
        _fill_template((folder / "uel.c").read_text(), values),
        _fill_template((folder / "uel.f").read_text(), values),
    )


def _fill_template(template: str, values: Mapping[str, object]) -> str:
    return re.sub(r"@([A-Z_]+)@", lambda match: str(values[match[1]]), template)


def _describe_element(state: StressState, is_linear: bool, values: Mapping[str, object]) -> str:
    """Return the text at the top of the C file, as the lines of a C comment."""
    is_solid, is_plane = state is StressState.SOLID, values["PROPERTIES"] == 4
    dim, n_state_variables = (3, 24) if is_solid else (2, 16)
    faces = (
        "S1: nodes 1-2-3, S2: 1-4-2, S3: 2-4-3, S4: 3-4-1"
        if is_solid
        else "S1: nodes 1-2, S2: 2-3, S3: 3-1"
    )
    order = (
        "Nodes: as C3D10, corners 1 to 4, mid-side nodes 5 (1-2), 6 (2-3), 7 (3-1), 8 (1-4), "
        "9 (2-4), 10 (3-4)."
        if is_solid
        else "Nodes: as CPE6, corners 1 to 3, mid-side nodes 4 (1-2), 5 (2-3), 6 (3-1)."
    )
    components = "11, 22, 33, 12, 13, 23" if is_solid else "11, 22, 33, 12"
    points = (
        "the corners 1 to 4"
        if is_solid
        else "the centres of the sub-triangles at corners 1, 2, 3 and in the middle"
    )
    thickness = ", 4 thickness" if is_plane else ""
    directions = "1 to 3" if is_solid else "1 and 2"
    paragraphs = [
        "Theory: M. Klisinski, Ch. Luo, E. Postek, Discussion on application of piece-wise linear "
        "weight functions in 2D contact problems (2001). Displacements are quadratic, Eq. (4); the "
        "weights are linear on the sub-cells of the element, Eq. (15) to (20)"
        + (
            "; on tetrahedra, which the paper does not have, on twelve sub-cells. "
            if is_solid
            else ". "
        )
        + (
            "Strain Eq. (5), stress Eq. (6), stiffness Eq. (10), mass Eq. (11), loads Eq. (12), "
            "initial stress Eq. (25) and (26). "
            if is_linear
            else "Mass Eq. (11), loads Eq. (12). First Piola-Kirchhoff stress "
            "P = mu (F - F^-T) + lambda ln(J) F^-T, J = det F; mu and lambda of E and nu. "
        )
        + "The matrices are not symmetric.",
        "Units: consistent ones of your choice, such as N, mm, MPa, t and s."
        + (
            " Coordinates are (r, z); forces are those of the whole circumference."
            if state is StressState.AXISYMMETRIC
            else ""
        ),
        order + " Faces " + faces + ". Cells are straight if all mid-side nodes lie in the middle "
        "of their edges to 1e-6 of the length; otherwise all integrals are those of a curved cell.",
        f"*USER ELEMENT, TYPE=U1, NODES={values['NODES']}, COORDINATES={dim}, "
        f"PROPERTIES={values['PROPERTIES']}, VARIABLES={n_state_variables}, UNSYMM",
        ", ".join(str(i + 1) for i in range(dim)),
        f"*UEL PROPERTY: 1 Young's modulus, 2 Poisson's ratio, 3 density{thickness}.",
        f"*DLOAD: Un pressure on face Sn; Ukn force per area in direction k on face Sn, as U21; "
        f"U4k force per volume in direction k (k is {directions}). Loads act on the undeformed "
        "element. Types UnNU are not supported.",
        f"State variables (SDV): stresses {components} at four points, one point after the other: "
        f"{points}. "
        + (
            "Stresses per deformed area."
            if not is_linear
            else "In plane stress, 33 is zero."
            if state is StressState.PLANE_STRESS
            else ""
        ).strip(),
        "Procedures: static steps (also with Riks' method); static perturbation steps; stiffness "
        "and mass for frequency and other steps. No implicit dynamics, no damping. "
        + (
            "Small strains: NLGEOM changes nothing in a general step. In a perturbation step with "
            "NLGEOM the stiffness includes the initial stress of the base state."
            if is_linear
            else "Large strains: every step needs NLGEOM=YES. In perturbation steps the stresses "
            "in the state variables remain those of the base state."
        ),
        "Abaqus uses symmetric parts of the matrices in frequency steps, and does not call user "
        "elements in *BUCKLE steps: see docs/how-to/user-element.md.",
    ]
    lines = [
        line
        for paragraph in paragraphs
        for line in textwrap.wrap(
            paragraph, _WIDTH_OF_HEADER, break_long_words=False, break_on_hyphens=False
        )
    ]
    return "\n".join(f" * {line}" for line in lines)

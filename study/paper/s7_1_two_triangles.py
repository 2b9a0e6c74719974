"""7.1 Simple structure with two elements: the reactions under a uniform load (Figs 4 and 5)."""

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import Mesh

from pw_elements import Material, forces_along, prescribe, reactions, solve
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern, quadrilaterals, triangles
from study.judge.checks import check
from study.judge.measures.two_triangles import reaction_spread
from study.model.discretisation import discretise, mesh_nodes_and_cells
from study.model.units import UNSTATED_UNITS
from study.run.cases import Case
from study.run.store import Result

SECTION = "7.1"
TITLE = "Simple structure with two elements"
FACTS = {
    "geometry": "a unit square; a row of six such squares",
    "mesh": "each square cut into two triangles, along either diagonal",
    "material": "linear elastic, plane stress; E = 1, ν = 0.3; other moduli, Poisson's ratios and "
    "plane strain change nothing",
    "supports": "vertically along the lower side, horizontally at one node",
    "load": "uniform unit load on the upper side",
    "reference": "integrals of the test functions; the paper's statements",
    "uncertainty": "none but round-off; the paper prints neither modulus nor Poisson's ratio",
}
SHORT_FACTS = {"uncertainty": "modulus and Poisson's ratio are not printed"}

# Problem

PROBLEM = r"""
**Printed.** A unit square of two 6-node triangles stands on a smooth base under a unit load. With the Galerkin method the
reaction at the middle node is four times those at the corners; with the new method the distribution is even.
**Reconstructed.** Young's modulus and Poisson's ratio, which have no influence: with other moduli, $\nu$ from 0 to 0.45,
plane strain and the other diagonal the reactions change by at most
{{ num([measure("reaction_spread", element="pw-T6"), measure("reaction_spread", element="galerkin-T6")] | max, 1) }}.

<div class="pair">
{{ figure("fig04") }}
{{ figure("fig05") }}
</div>
"""

YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
"""Elastic constants: not printed, but without influence, as the cases of `MATERIALS` show."""

# Method

METHOD = r"""
Plane stress with $E = 1$ and $\nu = 0.3$; the reactions are $r = K a - f$ at the three lower nodes. The exact stress is
uniform and both elements represent it, so the reactions are integrals of the test functions and cannot depend on the
material. A row of six such squares is used to check what the paper says about more than two elements.
"""


def structure(
    element: str,
    squares: int = 1,
    pattern: DiagonalPattern = "right",
    youngs_modulus: float = YOUNGS_MODULUS,
    poissons_ratio: float = POISSONS_RATIO,
    state: str = "plane stress",
) -> Result:
    """Compute the vertical reactions below a row of unit squares.

    Each square is cut into two triangles, or one quadrilateral, as the element requires.

    Args:
        element: Name of the element.
        squares: Number of squares.
        pattern: Diagonals of the squares.
        youngs_modulus: Young's modulus E, in force per area.
        poissons_ratio: Poisson's ratio nu.
        state: "plane stress" or "plane strain".
    """

    def mesh_row_of_squares(cell: str) -> Mesh:
        corners, divisions = ((0.0, 0.0), (float(squares), 1.0)), (squares, 1)
        if cell == "quadrilateral":
            return quadrilaterals(MPI.COMM_SELF, *corners, divisions)
        return triangles(MPI.COMM_SELF, *corners, divisions, pattern)

    material = Material(youngs_modulus, poissons_ratio)
    body = discretise(element, mesh_row_of_squares, material, StressState(state))
    K, U = body.K, body.space
    f = body.surface_load((0.0, -1.0), _on_upper_side)
    supports = [prescribe(U, 1, _on_lower_side), prescribe(U, 0, _at_lower_left_corner)]
    a = solve(K, f, body.supports(supports))

    base = forces_along(U, reactions(K, a, f), _on_lower_side)
    vertical = base.force[:, 1]
    scalars = {f"reaction_{i}": float(reaction) for i, reaction in enumerate(vertical)}
    scalars["sum"] = float(vertical.sum())
    units = dict.fromkeys(scalars, UNSTATED_UNITS.force)
    curves = {"x": base.position[:, 0], "reaction": vertical, **mesh_nodes_and_cells(U)}
    return Result(scalars, units, curves, dofs=K.getSize()[0])


def _on_upper_side(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 1.0)


def _on_lower_side(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 0.0)


def _at_lower_left_corner(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 0.0) & np.isclose(x[0], 0.0)


# Cases

MATERIALS: dict[str, dict[str, float | str]] = {
    "E1e9": {"youngs_modulus": 1e9},
    "nu0": {"poissons_ratio": 0.0},
    "nu0.45": {"poissons_ratio": 0.45},
    "strain": {"state": "plane strain"},
    "strain-nu0.45": {"state": "plane strain", "poissons_ratio": 0.45},
}
VARIANTS: dict[str, dict[str, float | str]] = {
    "": {},
    "-left": {"pattern": "left"},
    # Paper: "If there are more than two elements located along the boundary surface"
    "-row": {"squares": 6},
}
VARIANTS |= {f"-{name}": material for name, material in MATERIALS.items()}
CASES = [
    Case("7.1", element + suffix, structure, {"element": element, **parameters})
    for element in ("galerkin-T6", "pw-T6")
    for suffix, parameters in VARIANTS.items()
]
# Nodal forces of the elements that the paper does not use here
CASES += [
    Case("7.1", element + suffix, structure, {"element": element, **VARIANTS[suffix]})
    for element in ("galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
    for suffix in ("", "-row")
]

# Results

DETAILS = r"""
{% call table("7-1-reactions", "Reactions.") %}
| Element | Left | Centre | Right | Centre over side | Corner over mid-side, row | Spread over materials and diagonals |
|---|---:|---:|---:|---:|---:|---:|
{% for element, words in [("galerkin-T6", "Galerkin"), ("pw-T6", "piecewise linear")] %}
| {{ words }} |{% for i in range(3) %} {{ num(s("7.1/" ~ element, "reaction_" ~ i), 6) }} |{% endfor %} {{ num(measure("middle_over_side", element=element), 6) }} | {{ num(measure("corner_over_midside", element=element), 6) }} | {{ num(measure("reaction_spread", element=element), 2) }} |
{% endfor %}
{% endcall %}

{{ figure("s7_1_sawtooth") }}
"""

# Findings

CHECKS = [
    check(
        "71-constants",
        "The reactions depend on neither E, nu, the stress state nor the diagonal: new element.",
        lambda results: reaction_spread(results, element="pw-T6"),
        "=",
        0.0,
        tolerance=1e-12,
        tolerance_why="round-off of a small linear system",
        why="The exact stress is uniform, both elements represent it, and reactions are then "
        "integrals of the test functions.",
    ),
]

FINDINGS = r"""
**Computed.** {% for i in range(3) %}{{ fixed(s("7.1/pw-T6", "reaction_" ~ i), 4) }}{{ ", " if i < 2 }}{% endfor %} (new)
and {% for i in range(3) %}{{ fixed(s("7.1/galerkin-T6", "reaction_" ~ i), 4) }}{{ ", " if i < 2 }}{% endfor %} (standard);
deviations from 1/4, 1/2, 1/4 and from “four times” are round-off. **Finding.** Both statements are exact. Under uniform
stress the reactions are integrals of the weights, whatever the displacements are: the example shows what weights do to
forces, not how well an element solves a problem.
"""

# Limits

LIMITS = r"""
The values of Fig. 5 are lost in our copy; only the statements in the text are judged.
"""

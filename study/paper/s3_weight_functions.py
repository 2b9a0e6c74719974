"""Sections 3, 4 and 6: weight functions, Eq. (15) to Eq. (20), and their matrices (Figs 1, 2)."""

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, create_mesh

from pw_elements import Body, Material, Spaces, assemble_matrix
from pw_elements.elasticity import StressState
from pw_elements.spaces import piecewise_linear_sub_cell_element, quadratic_element
from study.model.elements import BASIX_DOF_OF_PAPER_NODE
from study.model.matrices import relative_norm_of_difference, to_dense_array
from study.model.units import assign_unit_one_to_scalars
from study.run.cases import Case
from study.run.store import Result

SECTION = "3"
TITLE = "The element: weight functions and matrices"
FACTS = {
    "geometry": "the reference triangle; a triangle without symmetries, corners (0.1, 0.2), "
    "(1.3, −0.1) and (0.4, 0.9)",
    "mesh": "one element; 1000 random points",
    "material": "linear elastic, plane stress; E = 1, ν = 0.3, density 1",
    "supports": "none",
    "load": "none: functions and matrices of one element",
    "reference": "Eqs (15) to (23) written out by hand; Basix's own macro element",
    "uncertainty": "none but round-off",
}

Points = npt.NDArray[np.float64]

# Problem and exact functions

PROBLEM = r"""
**Weight functions.** The displacements keep the quadratic shape functions $N$. Equilibrium is tested with weight
functions $w$, linear on the four sub-triangles that corners and mid-side nodes of a triangle span. Each is 1 at its own
node and 0 at the others. Along a loaded edge of unit length their integrals are 1/4, 1/2, 1/4; those of the shape
functions are 1/6, 2/3, 1/6. Since two edges meet at a corner, corner and mid-side nodes then get equal forces. The
element matrices are the usual integrals with one factor of each kind (unit thickness),

$$
\boldsymbol{K} = \int\, \overline{\boldsymbol{B}}^\mathrm{T} \boldsymbol{D} \boldsymbol{B} \,\mathrm{d}A, \quad
\boldsymbol{M} = \int\, \rho\, \boldsymbol{W}^\mathrm{T} \boldsymbol{N} \,\mathrm{d}A, \quad
\overline{\boldsymbol{B}} = \nabla\boldsymbol{W}, \quad \boldsymbol{B} = \nabla\boldsymbol{N},
$$

where $\boldsymbol{W}$ and $\boldsymbol{N}$ hold the weight and shape functions, $\nabla$ takes strains and
$\boldsymbol{D}$ is the elasticity matrix. They are unsymmetric: in a triangle of general shape
$\|\boldsymbol{K} - \boldsymbol{K}^\mathrm{T}\| / \|\boldsymbol{K}\|$ =
{{ num(s("3/matrices", "pw_stiffness_unsymmetry"), 2) }}, and {{ num(s("3/matrices", "pw_mass_unsymmetry"), 2) }} for the
mass matrix. The space of the weights is known as P1-iso-P2 {{ cite("bercovier") }}; using it to weight contact forces is
the paper's idea. The printed Eqs (15)–(20) were compared with this study's element at random points of all four
sub-triangles; the largest difference is {{ num(s("3/weights", "printed_difference"), 1) }}. All computations use DOLFINx
{{ cite("dolfinx") }}.

{{ figure("fig01") }}

{{ figure("fig02") }}
"""

THEORY = r"""
Four principles define the weight functions (sections 3, 4 and 6): each is non-zero only on the sub-elements at its node,
linear on each, continuous, and 1 at its node and 0 at all others.
"""

SUBELEMENTS = ((1, 4, 6), (4, 2, 5), (6, 5, 3), (4, 5, 6))
"""Nodes of the sub-elements A1 to A4 of Fig. 1, as the paper numbers them."""


def evaluate_printed_weights(points: Points, subelement: npt.NDArray[np.int64]) -> Points:
    """Evaluate Eq. (15) to Eq. (20) as printed.

    Args:
        points: Points (n, 2) of the reference triangle.
        subelement: Number (n,) of the sub-element of each point, 1 to 4.

    Returns:
        Six weight functions (n, 6).
    """
    x, y = points.T
    zero = np.zeros_like(x)
    w1 = [1 - 2 * x - 2 * y, zero, zero, zero]  # Eq. (15)
    w2 = [zero, 2 * x - 1, zero, zero]  # Eq. (16)
    w3 = [zero, zero, 2 * y - 1, zero]  # Eq. (17)
    w4 = [2 * x, 2 - 2 * x - 2 * y, zero, 1 - 2 * y]  # Eq. (18)
    w5 = [zero, 2 * y, 2 * x, 2 * x + 2 * y - 1]  # Eq. (19)
    w6 = [2 * y, zero, 2 - 2 * x - 2 * y, 1 - 2 * x]  # Eq. (20)
    weights = [np.choose(subelement - 1, w) for w in (w1, w2, w3, w4, w5, w6)]
    return np.stack(weights, axis=1)


# Method

METHOD = r"""
The element is built as a custom Basix element. Principles 2 and 3 define a space, the continuous piecewise-linear
polynomials on the halved cell; principle 4 defines its basis, and principle 1 follows. The same construction serves
intervals, quadrilaterals and hexahedra, and tetrahedra by the mean over its three cuts (section T). It is also compared
with Basix's own macro element. Stiffness, mass and initial stress matrices are formed on one triangle without
symmetries; the stiffness is compared with the sum in Eq. (23) evaluated by hand.
"""

RANDOM_POINTS, SEED = 1000, 2001
CORNERS = np.array([[0.1, 0.2], [1.3, -0.1], [0.4, 0.9]])
"""Corners of a triangle without symmetries."""
YOUNGS_MODULUS, POISSONS_RATIO, DENSITY = 1.0, 0.3, 1.0
"""Constants of a material; Poisson's ratio is not zero, so that normal strains are coupled."""


def weight_functions() -> Result:
    """Compare the new weights with printed equations, Basix' iso element and required properties.

    Curves: `nodes` (6, 2) and `subelements` (4, 3) in the paper's order; for plots, the points
    `grid` (n, 2) with their cells `grid_cells` (m, 3), and the `weights` (n, 6) and shape functions
    `shapes` (n, 6) at these points.
    """
    element = piecewise_linear_sub_cell_element("triangle")
    nodes = element._element.points[BASIX_DOF_OF_PAPER_NODE]  # in the paper's order

    random = np.random.default_rng(SEED)
    barycentric = random.dirichlet(np.ones(3), RANDOM_POINTS)
    subelement = np.arange(RANDOM_POINTS) % 4 + 1
    corners = nodes[np.array(SUBELEMENTS)[subelement - 1] - 1]
    points = np.einsum("nc,ncd->nd", barycentric, corners)
    weights = _tabulate_in_paper_order(element, points)
    printed_weights = evaluate_printed_weights(points, subelement)
    has_node = np.array(
        [[node in corner_nodes for node in range(1, 7)] for corner_nodes in SUBELEMENTS]
    )
    is_outside_support = ~has_node[subelement - 1]

    builtin = basix.ufl.element("iso", "triangle", 1)
    errors = {
        "printed_difference": np.abs(weights - printed_weights).max(),
        "builtin_difference": np.abs(weights - _tabulate_in_paper_order(builtin, points)).max(),
        "partition_of_unity_error": np.abs(weights.sum(axis=1) - 1).max(),
        "outside_support": np.abs(weights[is_outside_support]).max(),
        "nodal_error": np.abs(_tabulate_in_paper_order(element, nodes) - np.eye(6)).max(),
        "continuity_jump": _max_jump_across_sides_of_subelement_A4(element, nodes),
        "linearity_error": _max_nonlinearity_in_subelements(weights, barycentric, corners, element),
    }
    grid, grid_cells = _triangulate_reference_triangle(24)
    curves = {
        "nodes": nodes,
        "subelements": np.array(SUBELEMENTS) - 1,
        "grid": grid,
        "grid_cells": grid_cells,
        "weights": _tabulate_in_paper_order(element, grid),
        "shapes": _tabulate_in_paper_order(quadratic_element("triangle"), grid),
    }
    scalars = {name: float(error) for name, error in errors.items()}
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=6)


def _tabulate_in_paper_order(element: basix.ufl._ElementBase, points: Points) -> Points:
    """Return the values (n, 6) of an element's functions at reference points (n, 2).

    The functions are in the paper's order of nodes.
    """
    return element.tabulate(0, points)[0][:, BASIX_DOF_OF_PAPER_NODE]


def _max_jump_across_sides_of_subelement_A4(
    element: basix.ufl._ElementBase, nodes: Points
) -> float:
    """Return the largest jump of the functions across the sides of the inner sub-element A4.

    The element is evaluated at a small distance on either side, and both values are extrapolated
    to the side by the gradients there.
    """
    relative_distance = 1e-6
    max_jump = 0.0
    for first, second, opposite in ((4, 5, 6), (5, 6, 4), (6, 4, 5)):
        s = np.linspace(0.1, 0.9, 9)[:, None]
        side = (1 - s) * nodes[first - 1] + s * nodes[second - 1]
        inward = nodes[opposite - 1] - side.mean(axis=0)
        limits = []
        for offset in (relative_distance * inward, -relative_distance * inward):
            values, *gradients = element.tabulate(1, side + offset)[:, :, BASIX_DOF_OF_PAPER_NODE]
            limits.append(values - np.einsum("d,dnf->nf", offset, np.array(gradients)))
        max_jump = max(max_jump, float(np.abs(limits[0] - limits[1]).max()))
    return max_jump


def _max_nonlinearity_in_subelements(
    weights: Points, barycentric: Points, corners: Points, element: basix.ufl._ElementBase
) -> float:
    """Return the largest deviation of weight functions from linear functions on the sub-elements.

    The linear functions interpolate the values at the corners of the sub-elements.

    Args:
        weights: Weight functions (n, 6) at random points.
        barycentric: Barycentric coordinates (n, 3) of the points in their sub-elements.
        corners: Corners (n, 3, 2) of these sub-elements.
        element: Element that defines the weight functions.
    """
    corner_values = _tabulate_in_paper_order(element, corners.reshape(-1, 2)).reshape(
        *corners.shape[:2], 6
    )
    interpolated = np.einsum("nc,ncf->nf", barycentric, corner_values)
    return float(np.abs(weights - interpolated).max())


def _triangulate_reference_triangle(n: int) -> tuple[Points, npt.NDArray[np.int64]]:
    """Return points (n_points, 2) and cells (n_cells, 3) of a grid on the reference triangle.

    Each side is divided into n parts.
    """
    index: dict[tuple[int, int], int] = {}
    points: list[tuple[float, float]] = []
    for j in range(n + 1):
        for i in range(n + 1 - j):
            index[i, j] = len(points)
            points.append((i / n, j / n))
    cells = []
    for i, j in index:
        if i + j < n:
            cells.append((index[i, j], index[i + 1, j], index[i, j + 1]))
        if i + j < n - 1:
            cells.append((index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]))
    return np.array(points), np.array(cells)


def element_matrices() -> Result:
    """Compute symmetry, rank and row sums of the matrices of one element, and check Eq. (23).

    The matrices are K, M and K_sigma. Eq. (23), the stiffness as a sum over sub-elements, is
    evaluated without UFL.
    """
    mesh = _mesh_one_triangle(CORNERS)
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO, DENSITY)
    bodies = {
        "pw": Body(Spaces.petrov_galerkin(mesh), material, StressState.PLANE_STRESS),
        "galerkin": Body(Spaces.galerkin(mesh), material, StressState.PLANE_STRESS),
    }
    x = ufl.SpatialCoordinate(mesh)
    uniform_stress = ufl.as_tensor([[-1.0, 0.0], [0.0, 0.0]])
    values = {}
    for name, body in bodies.items():
        forms = {
            "stiffness": body.stiffness(),
            "mass": body.mass(),
            "initial_stress_uniform": body.geometric_stiffness(uniform_stress),
            "initial_stress_linear": body.geometric_stiffness(uniform_stress * x[1]),
        }
        matrices = {kind: to_dense_array(assemble_matrix(form)) for kind, form in forms.items()}
        for kind, matrix in matrices.items():
            values[f"{name}_{kind}_unsymmetry"] = relative_norm_of_difference(matrix, matrix.T)
        rank = np.linalg.matrix_rank(matrices["stiffness"], tol=1e-10)
        values[f"{name}_rigid_motions"] = 12 - rank
        row_sums = matrices["mass"].sum(axis=1)[::2] / (DENSITY * _triangle_area(CORNERS))
        values[f"{name}_mass_row_vertex"] = row_sums[0]
        values[f"{name}_mass_row_midside"] = row_sums[3]
        if name == "pw":
            by_hand = _sum_stiffness_of_subelements_by_eq_23(body.spaces.trial)
            values["eq23_difference"] = relative_norm_of_difference(matrices["stiffness"], by_hand)
    scalars = {name: float(value) for name, value in values.items()}
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=12)


def _mesh_one_triangle(corners: Points) -> Mesh:
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    return create_mesh(MPI.COMM_SELF, cells=np.array([[0, 1, 2]]), x=corners, e=element)


def _sum_stiffness_of_subelements_by_eq_23(U: fem.FunctionSpace) -> Points:
    """Return the stiffness (12, 12) of Eq. (21), evaluated by the sum of Eq. (23).

    Rows and columns have the numbering of the space. One integration point, the centroid of each
    sub-element, is exact, as the gradients of the weights are constant on a sub-element and those
    of the shape functions linear.
    """
    mesh_nodes = U.dofmap.list[0][BASIX_DOF_OF_PAPER_NODE]
    nodes = U.tabulate_dof_coordinates()[mesh_nodes, :2]
    # Eq. (22)
    D = (
        YOUNGS_MODULUS
        / (1 - POISSONS_RATIO**2)
        * np.array(
            [[1, POISSONS_RATIO, 0], [POISSONS_RATIO, 1, 0], [0, 0, (1 - POISSONS_RATIO) / 2]]
        )
    )
    jacobian = np.array([nodes[1] - nodes[0], nodes[2] - nodes[0]])  # rows: d(x, y)/d(xi), d(eta)
    to_physical = np.linalg.inv(jacobian)
    shapes, weights = quadratic_element("triangle"), piecewise_linear_sub_cell_element("triangle")
    reference_nodes = weights._element.points[BASIX_DOF_OF_PAPER_NODE]
    K = np.zeros((12, 12))
    for subelement in np.array(SUBELEMENTS) - 1:
        centroid = reference_nodes[subelement].mean(axis=0, keepdims=True)
        shape_gradients, weight_gradients = (
            to_physical @ element.tabulate(1, centroid)[1:, 0, :][:, BASIX_DOF_OF_PAPER_NODE]
            for element in (shapes, weights)
        )
        B, B_bar = _strain_matrix(shape_gradients), _strain_matrix(weight_gradients)
        K += _triangle_area(nodes[subelement]) * B_bar.T @ D @ B
    dofs = (2 * mesh_nodes[:, None] + np.arange(2)).ravel()
    renumbered = np.empty_like(K)
    renumbered[np.ix_(dofs, dofs)] = K
    return renumbered


def _strain_matrix(gradients: Points) -> Points:
    """Return the strain matrix B (3, 12) of Eq. (6) for gradients (2, 6)."""
    B = np.zeros((3, 12))
    B[0, 0::2] = B[2, 1::2] = gradients[0]
    B[1, 1::2] = B[2, 0::2] = gradients[1]
    return B


def _triangle_area(corners: Points) -> float:
    (a, b), (c, d) = corners[1] - corners[0], corners[2] - corners[0]
    return float(abs(a * d - b * c) / 2)


# Cases

CASES = [
    Case("3", "weights", weight_functions, implied_parameters={"element": "pw-T6"}),
    Case(
        "3", "matrices", element_matrices, implied_parameters={"compared": ["pw-T6", "galerkin-T6"]}
    ),
]

# Results

DETAILS = r"""
{% call table("3-checks-of-the-weight-functions", "Checks of the weight functions.") %}
| Quantity | Piecewise linear | Galerkin |
|---|---:|---:|
| largest difference from Eqs (15)–(20) | {{ num(s("3/weights", "printed_difference"), 2) }} | – |
| largest difference from Basix's macro element | {{ num(s("3/weights", "builtin_difference"), 2) }} | – |
| error of the partition of unity | {{ num(s("3/weights", "partition_of_unity_error"), 2) }} | – |
| stiffness against Eq. (23) by hand, relative | {{ num(s("3/matrices", "eq23_difference"), 2) }} | – |
{% for kind, words in [("stiffness", "stiffness $K$"), ("mass", "mass $M$"), ("initial_stress_uniform", "initial stress matrix, uniform stress"), ("initial_stress_linear", "initial stress matrix, linear stress")] %}
| $\|A - A^\mathrm{T}\| / \|A\|$ of the {{ words }} | {{ num(s("3/matrices", "pw_" ~ kind ~ "_unsymmetry"), 3) }} | {{ num(s("3/matrices", "galerkin_" ~ kind ~ "_unsymmetry"), 2) }} |
{% endfor %}
| rigid motions of $K$ | {{ fixed(s("3/matrices", "pw_rigid_motions"), 0) }} | {{ fixed(s("3/matrices", "galerkin_rigid_motions"), 0) }} |
| row sum of $M$ over element mass: vertex | {{ num(s("3/matrices", "pw_mass_row_vertex"), 5) }} | {{ num(s("3/matrices", "galerkin_mass_row_vertex"), 2) }} |
| row sum of $M$ over element mass: mid-side | {{ num(s("3/matrices", "pw_mass_row_midside"), 5) }} | {{ num(s("3/matrices", "galerkin_mass_row_midside"), 5) }} |
{% endcall %}
"""

# Findings

FINDINGS = r"""
**A mass that can be lumped.** The row sums of the new mass matrix are positive: at each corner
{{ num(s("3/matrices", "pw_mass_row_vertex"), 3) }} (one twelfth) of a triangle's mass, where the standard element has
zero. Which stiffness may be combined with it is discussed in {{ ref("V12") }}.
"""

# Limits

LIMITS = r"""
Equality with the printed equations says nothing about the accuracy of the element, which is the subject of sections C,
V2 and V8.
"""

"""3, 4, 6: the weight functions, Eq. (15) to Eq. (20), and their matrices (Figs 1, 2)."""

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, create_mesh

from pw_elements import Body, Material, Spaces, assemble_matrix
from pw_elements.elasticity import StressState
from pw_elements.spaces import macro_element, quadratic_element
from study.model.elements import PAPER_NODES
from study.model.matrices import dense, relative_difference
from study.model.units import dimensionless
from study.run.cases import Case
from study.run.store import Result

SECTION = "3"
TITLE = "The element: weight functions and matrices"

Points = npt.NDArray[np.float64]

# Sub-elements A1..A4 of Fig. 1 by the paper's node numbers
SUBELEMENTS = ((1, 4, 6), (4, 2, 5), (6, 5, 3), (4, 5, 6))
RANDOM_POINTS, SEED = 1000, 2001
# A triangle without symmetries, and a material with coupled normal strains
CORNERS = np.array([[0.1, 0.2], [1.3, -0.1], [0.4, 0.9]])
YOUNGS_MODULUS, POISSONS_RATIO, DENSITY = 1.0, 0.3, 1.0


def printed_weights(points: Points, subelement: npt.NDArray[np.int64]) -> Points:
    """Eq. (15) to Eq. (20) to the letter: (n, 6) at points (n, 2) of sub-elements 1..4."""
    x, y = points.T
    zero = np.zeros_like(x)
    w1 = [1 - 2 * x - 2 * y, zero, zero, zero]  # Eq. (15)
    w2 = [zero, 2 * x - 1, zero, zero]  # Eq. (16)
    w3 = [zero, zero, 2 * y - 1, zero]  # Eq. (17)
    w4 = [2 * x, 2 - 2 * x - 2 * y, zero, 1 - 2 * y]  # Eq. (18)
    w5 = [zero, 2 * y, 2 * x, 2 * x + 2 * y - 1]  # Eq. (19)
    w6 = [2 * y, zero, 2 - 2 * x - 2 * y, 1 - 2 * x]  # Eq. (20)
    chosen = [np.choose(subelement - 1, w) for w in (w1, w2, w3, w4, w5, w6)]
    return np.stack(chosen, axis=1)


def weight_functions() -> Result:
    """The Basix element against the printed equations, Basix's own, and the four principles.

    Curves: `nodes` (6, 2) and `subelements` (4, 3) in the paper's order, `grid` (n, 2) with the
    weights (n, 6) and shape functions (n, 6) on it, `grid_cells` (m, 3).
    """
    element = macro_element("triangle")
    nodes = element._element.points[PAPER_NODES]  # in the paper's order

    random = np.random.default_rng(SEED)
    barycentric = random.dirichlet(np.ones(3), RANDOM_POINTS)
    subelement = np.arange(RANDOM_POINTS) % 4 + 1
    corners = nodes[np.array(SUBELEMENTS)[subelement - 1] - 1]
    points = np.einsum("nc,ncd->nd", barycentric, corners)
    weights = _weights(element, points)
    neighbours = np.array([[node in s for node in range(1, 7)] for s in SUBELEMENTS])
    outside = ~neighbours[subelement - 1]

    builtin = basix.ufl.element("iso", "triangle", 1)
    scalars = {
        "printed_difference": np.abs(weights - printed_weights(points, subelement)).max(),
        "builtin_difference": np.abs(weights - _weights(builtin, points)).max(),
        "partition_of_unity_error": np.abs(weights.sum(axis=1) - 1).max(),
        "outside_support": np.abs(weights[outside]).max(),
        "nodal_error": np.abs(_weights(element, nodes) - np.eye(6)).max(),
        "continuity_jump": _continuity_jump(element, nodes),
        "linearity_error": _linearity_error(weights, barycentric, corners, element),
    }
    grid, cells = _triangle_grid(24)
    curves = {
        "nodes": nodes,
        "subelements": np.array(SUBELEMENTS) - 1,
        "grid": grid,
        "grid_cells": cells,
        "weights": _weights(element, grid),
        "shapes": _weights(quadratic_element("triangle"), grid),
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=6)


def element_matrices() -> Result:
    """K, M and K_sigma of one element: Eq. (23) as a sum over sub-elements, and symmetry."""
    mesh = _one_triangle(CORNERS)
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO, DENSITY)
    bodies = {
        "pw": Body(Spaces.petrov_galerkin(mesh), material, StressState.PLANE_STRESS),
        "galerkin": Body(Spaces.galerkin(mesh), material, StressState.PLANE_STRESS),
    }
    x = ufl.SpatialCoordinate(mesh)
    uniform = ufl.as_tensor([[-1.0, 0.0], [0.0, 0.0]])
    scalars = {}
    for name, body in bodies.items():
        matrices = {
            "stiffness": body.stiffness(),
            "mass": body.mass(),
            "initial_stress_uniform": body.initial_stress(uniform),
            "initial_stress_linear": body.initial_stress(uniform * x[1]),
        }
        entries = {kind: dense(assemble_matrix(form)) for kind, form in matrices.items()}
        for kind, matrix in entries.items():
            scalars[f"{name}_{kind}_unsymmetry"] = relative_difference(matrix, matrix.T)
        scalars[f"{name}_rigid_motions"] = 12 - np.linalg.matrix_rank(
            entries["stiffness"], tol=1e-10
        )
        rows = entries["mass"].sum(axis=1)[::2] / (DENSITY * _area(CORNERS))
        scalars[f"{name}_mass_row_vertex"] = rows[0]
        scalars[f"{name}_mass_row_midside"] = rows[3]
        if name == "pw":
            order = _mesh_nodes_in_paper_order(body.spaces.trial)
            by_hand = _stiffness_by_subelements(body.spaces.trial, order)
            scalars["eq23_difference"] = relative_difference(entries["stiffness"], by_hand)
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), dofs=12)


def _weights(element: basix.ufl._ElementBase, points: Points) -> Points:
    """Values (n, 6) at reference points (n, 2), functions in the paper's order."""
    return element.tabulate(0, points)[0][:, PAPER_NODES]


def _continuity_jump(element: basix.ufl._ElementBase, nodes: Points) -> float:
    """Largest difference of the two one-sided limits across the sides of A4.

    The element is evaluated a hair on either side, and both values are carried back to the
    side by the gradients there.
    """
    hair = 1e-6
    jump = 0.0
    for a, b, other in ((4, 5, 6), (5, 6, 4), (6, 4, 5)):
        s = np.linspace(0.1, 0.9, 9)[:, None]
        side = (1 - s) * nodes[a - 1] + s * nodes[b - 1]
        inward = nodes[other - 1] - side.mean(axis=0)
        limits = []
        for step in (hair * inward, -hair * inward):
            table = element.tabulate(1, side + step)[:, :, PAPER_NODES]
            limits.append(table[0] - np.einsum("d,dnf->nf", step, table[1:]))
        jump = max(jump, float(np.abs(limits[0] - limits[1]).max()))
    return jump


def _linearity_error(
    weights: Points, barycentric: Points, corners: Points, element: basix.ufl._ElementBase
) -> float:
    """Weights against the linear interpolation of their values at the sub-element's corners."""
    at_corners = _weights(element, corners.reshape(-1, 2)).reshape(*corners.shape[:2], 6)
    return float(np.abs(weights - np.einsum("nc,ncf->nf", barycentric, at_corners)).max())


def _triangle_grid(n: int) -> tuple[Points, npt.NDArray[np.int64]]:
    """Points of the reference triangle on a lattice of n divisions, and its small triangles."""
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


def _one_triangle(corners: Points) -> Mesh:
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    return create_mesh(MPI.COMM_SELF, cells=np.array([[0, 1, 2]]), x=corners, e=element)


def _mesh_nodes_in_paper_order(U: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    return U.dofmap.list[0][PAPER_NODES]


def _stiffness_by_subelements(U: fem.FunctionSpace, order: npt.NDArray[np.int32]) -> Points:
    """Eq. (21) as Eq. (23) without quadrature: B is linear, centroids of sub-elements do."""
    nodes = U.tabulate_dof_coordinates()[order, :2]
    D = (
        YOUNGS_MODULUS
        / (1 - POISSONS_RATIO**2)
        * np.array(
            [[1, POISSONS_RATIO, 0], [POISSONS_RATIO, 1, 0], [0, 0, (1 - POISSONS_RATIO) / 2]]
        )
    )
    jacobian = np.array([nodes[1] - nodes[0], nodes[2] - nodes[0]])  # rows: d(x, y)/d(xi), d(eta)
    to_physical = np.linalg.inv(jacobian)
    shapes, weights = quadratic_element("triangle"), macro_element("triangle")
    reference_nodes = weights._element.points[PAPER_NODES]
    K = np.zeros((12, 12))
    for subelement in np.array(SUBELEMENTS) - 1:
        centroid = reference_nodes[subelement].mean(axis=0, keepdims=True)
        dN, dW = (
            to_physical @ e.tabulate(1, centroid)[1:, 0, :][:, PAPER_NODES]
            for e in (shapes, weights)
        )
        K += _area(nodes[subelement]) * _strain_matrix(dW).T @ D @ _strain_matrix(dN)
    numbering = (2 * order[:, None] + np.arange(2)).ravel()
    result = np.empty_like(K)
    result[np.ix_(numbering, numbering)] = K
    return result


def _strain_matrix(gradients: Points) -> Points:
    """B of Eq. (6), (3, 12), from gradients (2, 6)."""
    B = np.zeros((3, 12))
    B[0, 0::2] = B[2, 1::2] = gradients[0]
    B[1, 1::2] = B[2, 0::2] = gradients[1]
    return B


def _area(corners: Points) -> float:
    (a, b), (c, d) = corners[1] - corners[0], corners[2] - corners[0]
    return float(abs(a * d - b * c) / 2)


CASES = [
    Case("3", "weights", weight_functions, implied={"element": "pw-T6"}),
    Case("3", "matrices", element_matrices, implied={"compared": ["pw-T6", "galerkin-T6"]}),
]

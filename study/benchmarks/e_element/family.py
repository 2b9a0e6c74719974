"""The family P_k: polynomials of degree k, and hat functions on the k^2 sub-triangles as weights.

All triangles are straight, so that the integrals on the reference triangle are computed once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, Literal

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from study.meshes.mesh_lines import geometrically_growing_lines
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result, StudyError
from study.solutions.half_space import ElasticHalfSpace, HertzLine

Array = npt.NDArray[Any]
Indices = npt.NDArray[np.int64]
Weights = Literal["new", "standard"]

DEGREES = (1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Triangle:
    """Element P_k on the reference triangle, with equidistant nodes.

    Attributes:
        degree: Degree k.
        lattice: Integer barycentric coordinates (n, 3) of the nodes, whose sum is k.
        parts: Nodes (k^2, 3) of the sub-triangles.
        inverse_vandermonde: Coefficients (n, n) of the shape functions' monomials.
        exponents: Exponents (n, 2) of these monomials in x and y.
    """

    degree: int
    lattice: Indices
    parts: Indices
    inverse_vandermonde: Array
    exponents: Indices

    @property
    def nodes(self) -> Array:
        """Positions (n, 2) of the nodes."""
        return self.lattice[:, 1:] / self.degree

    def shape_functions(self, x: Array) -> tuple[Array, Array]:
        """Return values (q, n) and slopes (2, q, n) of the shape functions at points (q, 2)."""
        p, q = self.exponents.T
        X, Y = x[:, :1], x[:, 1:]
        value = X**p * Y**q
        slopes = [p * X ** np.maximum(p - 1, 0) * Y**q, q * X**p * Y ** np.maximum(q - 1, 0)]
        return value @ self.inverse_vandermonde, np.array(slopes) @ self.inverse_vandermonde

    def sub_triangle_rule(self, degree: int) -> tuple[Array, Array, Array, Array]:
        """Return a quadrature rule on all sub-triangles, and the weight functions there.

        Returns:
            Points (q, 2), weights (q,), values (q, n) and slopes (2, q, n) of weight functions.
        """
        points, weights = basix.make_quadrature(basix.CellType.triangle, degree)
        hats = np.column_stack([1 - points.sum(axis=1), points])
        shape = (len(self.parts), len(points), len(self.lattice))
        values, slopes = np.zeros(shape), np.zeros((2, *shape))
        corners = self.nodes[self.parts]
        for part, nodes in enumerate(self.parts):
            to_local = np.linalg.inv(corners[part, 1:] - corners[part, 0])
            values[part][:, nodes] = hats
            slopes[:, part][:, :, nodes] = (to_local @ [[-1, 1, 0], [-1, 0, 1]])[:, None]
        positions = (hats @ corners).reshape(-1, 2)
        n = len(positions)
        dx = np.tile(weights, len(self.parts)) / self.degree**2
        return positions, dx, values.reshape(n, -1), slopes.reshape(2, n, -1)


@cache
def make_triangle(degree: int) -> Triangle:
    """Make the element P_k."""
    k = degree
    lattice = np.array([(k - i - j, i, j) for j in range(k + 1) for i in range(k + 1 - j)])
    number = {(int(i), int(j)): n for n, (_, i, j) in enumerate(lattice)}
    upright = [(i, j) for i, j in number if i + j < k]
    parts = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in upright]
    parts += [
        (number[i + 1, j], number[i + 1, j + 1], number[i, j + 1])
        for i, j in upright
        if i + j < k - 1
    ]
    exponents = np.array(list(number))
    x = lattice[:, 1:] / k
    vandermonde = np.prod(x[:, None] ** exponents, axis=2)
    return Triangle(k, lattice, np.array(parts), np.linalg.inv(vandermonde), exponents)


def slope_products(degree: int, weights: Weights) -> Array:
    """Return the integrals (2, 2, n, n) of slopes of weight functions times those of shapes."""
    element = make_triangle(degree)
    points, dx, _, slopes = element.sub_triangle_rule(2 * degree)
    _, shapes = element.shape_functions(points)
    test = slopes if weights == "new" else shapes
    return np.einsum("q,aqi,bqj->abij", dx, test, shapes)


@dataclass(frozen=True)
class TriangleMesh:
    """Mesh of straight triangles of degree k.

    Attributes:
        degree: Degree k.
        corners: Positions (cells, 3, 2) of the vertices.
        cells: Numbers (cells, n) of the nodes.
        nodes: Positions (nodes, 2).
    """

    degree: int
    corners: Array
    cells: Indices
    nodes: Array

    @classmethod
    def from_vertices(cls, degree: int, vertices: Array, triangles: Indices) -> "TriangleMesh":
        """Number the nodes of triangles (cells, 3) between vertices (n, 2)."""
        lattice = make_triangle(degree).lattice
        # a node is named by the vertices that it depends on, and by its share of each
        named = triangles[:, None] * (degree + 1) + lattice
        keys = np.sort(np.where(lattice > 0, named, -1), axis=2).reshape(-1, 3)
        _, first, cells = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        positions = np.einsum("nv,cvd->cnd", lattice / degree, vertices[triangles])
        return cls(
            degree,
            vertices[triangles],
            cells.reshape(len(triangles), -1),
            positions.reshape(-1, 2)[first],
        )

    def assemble(self, moduli: Array, weights: Weights) -> sparse.csr_matrix:
        """Assemble the integral of moduli (m, 2, m, 2) times slopes of weights and of shapes.

        Args:
            moduli: Stress component (c, p) for the slope q of the component d of a displacement;
                m = 1 for a scalar field.
            weights: Kind of the weight functions.
        """
        m = len(moduli)
        edges = (self.corners[:, 1:] - self.corners[:, :1]).transpose(0, 2, 1)
        inverse, area = np.linalg.inv(edges), np.linalg.det(edges)
        reference = slope_products(self.degree, weights)
        operands = area, inverse, inverse, moduli, reference
        integrals = np.einsum("e,epa,eqb,cadb,pqij->eicjd", *operands, optimize=True)
        dofs = (self.cells[:, :, None] * m + np.arange(m)).reshape(len(self.cells), -1)
        rows = np.repeat(dofs, dofs.shape[1], axis=1).ravel()
        columns = np.tile(dofs, (1, dofs.shape[1])).ravel()
        n = len(self.nodes) * m
        return sparse.csr_matrix((integrals.ravel(), (rows, columns)), shape=(n, n))

    def load(self, source: Callable[[Array], Array], weights: Weights) -> Array:
        """Return the integrals (nodes,) of a source, a function of points (n, 2), times weights."""
        element = make_triangle(self.degree)
        points, dx, values, _ = element.sub_triangle_rule(2 * self.degree)
        if weights == "standard":
            values, _ = element.shape_functions(points)
        x = self.positions(points)
        integrals = np.einsum("e,q,eq,qi->ei", self.determinants, dx, source(x), values)
        return np.bincount(self.cells.ravel(), integrals.ravel(), len(self.nodes))

    def positions(self, points: Array) -> Array:
        """Return positions (cells, q, 2) of points (q, 2) of the reference triangle."""
        barycentric = np.column_stack([1 - points.sum(axis=1), points])
        return np.einsum("qv,cvd->cqd", barycentric, self.corners)

    @property
    def determinants(self) -> Array:
        """Twice the areas (cells,) of the triangles."""
        return np.linalg.det(self.corners[:, 1:] - self.corners[:, :1])


def grid(x: Array, y: Array) -> tuple[Array, Indices]:
    """Return vertices (n, 2) and triangles (cells, 3) of a grid of lines, each box cut in two."""
    vertices = np.array(list(product(x, y)))
    number = np.arange(len(vertices)).reshape(len(x), len(y))
    a, b, c, d = (
        part.ravel()
        for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    return vertices, np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def distorted_square(degree: int, n: int, seed: int = 0) -> TriangleMesh:
    """Return a mesh of the unit square whose inner vertices are shifted by up to `SHIFT` cells."""
    lines = np.linspace(0, 1, n + 1)
    vertices, triangles = grid(lines, lines)
    shifts = np.random.default_rng(seed).uniform(-1, 1, vertices.shape) * SHIFT / n
    is_inner = np.all((vertices > 0) & (vertices < 1), axis=1)
    return TriangleMesh.from_vertices(degree, vertices + shifts * is_inner[:, None], triangles)


SHIFT = 0.2
"""Largest random shift of vertices relative to the size of cells."""


# Force transfer


def transfer_defects(degree: int) -> tuple[float, float]:
    """Return how far the new element is from one whose forces are transferred standard ones.

    The rows of a matrix T are sought for which the integrals of s . grad(w - T N) vanish for all
    vector fields s of degree k - 1: then K = T K_standard on every straight triangle and for every
    constant law. The defect is the norm of the remaining integrals, relative to those of w.

    Returns:
        Largest defect of a node, if T may combine all nodes of the triangle, and if its entries
        have to be those of an assembled matrix: a column belongs to a node, and only nodes that
        are in all triangles of this node may have entries in it.
    """
    element = make_triangle(degree)
    points, dx, _, slopes = element.sub_triangle_rule(2 * degree)
    _, shapes = element.shape_functions(points)
    exponents = [(p, q) for p in range(degree) for q in range(degree - p)]
    s = np.array([points[:, 0] ** p * points[:, 1] ** q for p, q in exponents])
    new, standard = (
        np.einsum("q,mq,aqi->ami", dx, s, f).reshape(-1, len(element.lattice))
        for f in (slopes, shapes)
    )
    is_on_side = element.lattice == 0
    may_combine = (is_on_side[:, None] >= is_on_side).all(axis=2)  # sides of the column's node
    defects = []
    for allowed in (np.ones_like(may_combine), may_combine):
        remaining = []
        for row in range(len(element.lattice)):
            columns = standard[:, allowed[row]]
            coefficients = np.linalg.lstsq(columns, new[:, row], rcond=None)[0]
            remainder = columns @ coefficients - new[:, row]
            remaining.append(float(np.linalg.norm(remainder) / np.linalg.norm(new[:, row])))
        defects.append(max(remaining))
    return defects[0], defects[1]


# Cases

CELLS_PER_SIDE = (4, 8, 16)
LAPLACE = np.eye(2)[None, :, None, :]


def element_of_degree(degree: int) -> Result:
    """Compare the new element of degree k with the standard one.

    Scalars are shares of a uniform load, defects of the force transfer, singular values and
    condition numbers, and errors and orders of convergence for Poisson's equation.

    Args:
        degree: Degree k of the shape functions.
    """
    scalars = dict(
        zip(("defect_element", "defect_assembled"), transfer_defects(degree), strict=True)
    )
    lines = np.linspace(0, 1, 5)
    regular = TriangleMesh.from_vertices(degree, *grid(lines, lines))
    is_inner = ((regular.nodes > 1e-9) & (regular.nodes < 1 - 1e-9)).all(axis=1)
    mesh = distorted_square(degree, CELLS_PER_SIDE[0])
    free = mesh.nodes[:, 1] > 1e-9
    matrices: dict[str, Array] = {}
    for weights in ("new", "standard"):
        forces = regular.load(lambda x: np.ones(x.shape[:-1]), weights)[is_inner]
        scalars[f"least_force_{weights}"] = float(forces.min() / forces.max())
        matrices[weights] = mesh.assemble(LAPLACE, weights).toarray()[np.ix_(free, free)]
        scalars[f"condition_{weights}"] = float(np.linalg.cond(matrices[weights]))
        h1, l2 = np.array([_errors_of_poisson(degree, n, weights) for n in CELLS_PER_SIDE]).T
        for name, errors in (("H1", h1), ("L2", l2)):
            scalars[f"error_{name}_{weights}"] = float(errors[-1])
            scalars[f"order_{name}_{weights}"] = float(np.log2(errors[-2] / errors[-1]))
    L = np.linalg.cholesky(matrices["standard"])
    scaled = np.linalg.solve(L, np.linalg.solve(L, matrices["new"]).T).T
    scalars["sigma_min"] = float(np.linalg.svd(scaled, compute_uv=False)[-1])
    scalars["symmetric_min"] = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0])
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=len(mesh.nodes))


def _errors_of_poisson(degree: int, n: int, weights: Weights) -> tuple[float, float]:
    """Return relative H1 and L2 errors for u = sin(2 x + 1) cosh(y) + x y, given on all sides."""

    def exact(x: Array) -> tuple[Array, Array, Array]:
        a, b = 2 * x[..., 0] + 1, x[..., 1]
        slopes = [2 * np.cos(a) * np.cosh(b) + b, np.sin(a) * np.sinh(b) + x[..., 0]]
        return np.sin(a) * np.cosh(b) + x[..., 0] * b, np.array(slopes), 3 * np.sin(a) * np.cosh(b)

    mesh = distorted_square(degree, n)
    free = ((mesh.nodes > 1e-9) & (mesh.nodes < 1 - 1e-9)).all(axis=1)
    K = mesh.assemble(LAPLACE, weights)[free]
    u = exact(mesh.nodes)[0]
    f = mesh.load(lambda x: exact(x)[2], weights)[free]
    u[free] = splu(K[:, free].tocsc()).solve(f - K[:, ~free] @ u[~free])
    element = make_triangle(degree)
    points, dx = basix.make_quadrature(basix.CellType.triangle, 2 * degree + 4)
    values, slopes = element.shape_functions(points)
    inverse = np.linalg.inv(mesh.corners[:, 1:] - mesh.corners[:, :1])  # transposed Jacobians
    u_exact, slopes_exact, _ = exact(mesh.positions(points))
    error = u[mesh.cells] @ values.T - u_exact
    gradient = np.einsum("eap,pqi,ei->aeq", inverse, slopes, u[mesh.cells])
    area = mesh.determinants[:, None] * dx
    squares = [
        (area * (gradient - slopes_exact) ** 2).sum() / (area * slopes_exact**2).sum(),
        (area * error**2).sum() / (area * u_exact**2).sum(),
    ]
    return float(np.sqrt(squares[0])), float(np.sqrt(squares[1]))


# Hertz' line contact

YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
RADIUS = 1e3
BODY_SIZE, GROWTH, CONTACT_ZONE, INNER_PART = 5.0, 1.3, 1.3, 0.8
"""Side of the body, growth of elements, zone that may touch, and part with errors, relative to a."""
NODES_OVER_HALF_WIDTH = (24, 48)
EDGE_POSITIONS = (0.125, 0.375, 0.625, 0.875)
"""Positions of the edge of contact within an element, relative to its length."""


def hertz(degree: int, weights: Weights) -> Result:
    """Press a parabola on a half plane, with the same spacing of nodes for every degree.

    Scalars are the errors of the pressure (force over the integral of the node's weight function)
    in the inner 80 % and everywhere, relative to the peak: root mean squares over four positions
    of the edge of contact. The index is the number of nodes over the half width.

    Args:
        degree: Degree k of the shape functions.
        weights: "new" or "standard".
    """
    scalars: dict[str, float] = {}
    for n in NODES_OVER_HALF_WIDTH:
        squares = [_errors_of_hertz(degree, weights, n / degree + edge) for edge in EDGE_POSITIONS]
        inner, everywhere, unknowns = np.mean(squares, axis=0)
        scalars[f"error_inner_{n}"] = float(np.sqrt(inner))
        scalars[f"error_{n}"] = float(np.sqrt(everywhere))
        scalars[f"unknowns_{n}"] = float(unknowns)
    unit = assign_unit_one_to_scalars(scalars)
    return Result(scalars, unit, dofs=int(scalars[f"unknowns_{NODES_OVER_HALF_WIDTH[-1]}"]))


def _errors_of_hertz(degree: int, weights: Weights, elements: float) -> tuple[float, float, float]:
    """Return mean squares of the pressure's error, inside and everywhere, and unknowns."""
    half_width = 1.0
    modulus = YOUNGS_MODULUS / (1 - POISSONS_RATIO**2)
    exact = HertzLine(
        ElasticHalfSpace(YOUNGS_MODULUS, POISSONS_RATIO), RADIUS, np.pi * modulus / (4 * RADIUS)
    )
    size = half_width / elements
    zone = size * np.arange(np.ceil(CONTACT_ZONE * elements) + 1)
    rest = geometrically_growing_lines(size * GROWTH, BODY_SIZE - zone[-1], GROWTH)
    depth = geometrically_growing_lines(size, BODY_SIZE, GROWTH)
    x_lines = np.concatenate([zone, zone[-1] + rest[1:]])
    mesh = TriangleMesh.from_vertices(degree, *grid(x_lines, -depth[::-1]))
    x, y = mesh.nodes.T
    lame = YOUNGS_MODULUS * POISSONS_RATIO / ((1 + POISSONS_RATIO) * (1 - 2 * POISSONS_RATIO))
    shear, one = YOUNGS_MODULUS / (2 * (1 + POISSONS_RATIO)), np.eye(2)
    moduli = lame * np.einsum("ca,db->cadb", one, one)
    moduli += shear * (np.einsum("cd,ab->cadb", one, one) + np.einsum("cb,ad->cadb", one, one))
    K = mesh.assemble(moduli, weights)
    is_far = np.isclose(x, BODY_SIZE) | np.isclose(y, -BODY_SIZE)
    is_known = np.column_stack([is_far | np.isclose(x, 0.0), is_far])
    u = np.zeros_like(mesh.nodes)
    u[is_far] = exact.displacement(mesh.nodes[is_far])
    u[np.isclose(x, 0.0), 0] = 0.0
    surface = np.flatnonzero(np.isclose(y, 0.0) & (x < zone[-1] + 1e-9))
    bound = x[surface] ** 2 / (2 * RADIUS) - exact.approach
    closed = x[surface] < half_width
    for _ in range(MAX_ACTIVE_SETS):
        known = is_known.copy()
        known[surface[closed], 1] = True
        u[surface[closed], 1] = bound[closed]
        free = ~known.ravel()
        v = u.ravel()
        v[free] = splu(K[free][:, free].tocsc()).solve(-K[free][:, ~free] @ v[~free])
        force = -(K @ v).reshape(-1, 2)[surface, 1]
        trial = np.where(closed, force > 0, u[surface, 1] > bound)
        if (trial == closed).all():
            break
        closed = trial
    else:
        raise StudyError(f"contact with P{degree} does not converge")
    pressure = force / _surface_weights(mesh, weights, surface)
    error = (pressure - exact.pressure(x[surface])) / exact.peak_pressure
    inner = x[surface] < INNER_PART * half_width
    return float(np.mean(error[inner] ** 2)), float(np.mean(error[closed] ** 2)), float(free.sum())


MAX_ACTIVE_SETS = 60


def _surface_weights(mesh: TriangleMesh, weights: Weights, surface: Indices) -> Array:
    """Return the integrals of the weight functions of nodes over a straight row of sides."""
    k = mesh.degree
    side = np.linspace(0, 1, k + 1)
    shares: Array = np.full(k + 1, 1 / k)
    shares[[0, -1]] /= 2
    if weights == "standard":
        shares = np.linalg.solve(side ** np.arange(k + 1)[:, None], 1 / np.arange(1, k + 2))
    order = np.argsort(mesh.nodes[surface, 0])
    x = mesh.nodes[surface[order], 0]
    integrals = np.zeros(len(surface))
    for start in range(0, len(order) - 1, k):
        integrals[order[start : start + k + 1]] += shares * (x[start + k] - x[start])
    return integrals

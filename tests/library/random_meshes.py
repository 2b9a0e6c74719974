"""Random meshes of all cell types, and transformations under which a problem stays the same.

Strategies draw only a few numbers, among them a seed for NumPy's random generator. If Hypothesis
drew whole arrays, this would take more time than the finite elements.
"""

from dataclasses import dataclass, replace

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
from dolfinx.mesh import create_mesh
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from tests.oracle.elements import REFERENCE_ELEMENTS

DIMENSION_BY_CELL_NAME = {
    "interval": 1,
    "triangle": 2,
    "quadrilateral": 2,
    "tetrahedron": 3,
    "hexahedron": 3,
}
CELL_NAMES = tuple(DIMENSION_BY_CELL_NAME)
BODY_CELL_NAMES = CELL_NAMES[1:]  # cells of elastic bodies
SIMPLICES = ("interval", "triangle", "tetrahedron")
MACHINE_EPSILON = float(np.finfo(float).eps)

# Largest shift of a vertex in a structured mesh, relative to half the distance to its nearest
# neighbour. Cells stay convex if it is below 1/2
_MAX_SHIFT_OVER_HALF_SPACING = 0.4


@dataclass(frozen=True)
class Grid:
    """Coordinates `x` (n, dim) of vertices, and vertex numbers `cells` (m, k) in Basix's order."""

    cell: str
    x: np.ndarray
    cells: np.ndarray

    @property
    def dim(self):
        return DIMENSION_BY_CELL_NAME[self.cell]

    def mesh(self):
        return create_mesh(
            MPI.COMM_SELF,
            cells=self.cells.astype(np.int64),
            x=np.ascontiguousarray(self.x, dtype=float),
            e=basix.ufl.element("Lagrange", self.cell, 1, shape=(self.dim,)),
        )

    def map_vertices(self, point_map):
        return replace(self, x=point_map(self.x))

    def min_cell_thickness_bound(self):
        """Return a lower bound of the thickness of all cells (of simplices, the smallest altitude).

        The bound is the inverse of the largest gradient of a linear shape function at the corners
        of cells.
        """
        element = basix.create_element(basix.ElementFamily.P, basix.CellType[self.cell], 1)
        gradients = element.tabulate(1, element.points)[1:, :, :, 0]
        jacobian = np.einsum("jpn,cni->cpij", gradients, self.x[self.cells])
        physical_gradients = np.einsum("jpn,cpji->cpni", gradients, np.linalg.inv(jacobian))
        return 1 / np.linalg.norm(physical_gradients, axis=-1).max()

    def relative_gradient_round_off(self):
        """Return the relative round-off in gradients of shape functions due to rounded vertices."""
        return MACHINE_EPSILON * np.abs(self.x).max() / self.min_cell_thickness_bound()

    def make_renumbered_copy(self, seed):
        """Return the same grid with vertices, cells and corners of cells in random order.

        The corners of quadrilaterals and hexahedra are permuted by symmetries of the cube.
        """
        rng = np.random.default_rng(seed)
        new_numbers = rng.permutation(len(self.x))
        x = np.empty_like(self.x)
        x[new_numbers] = self.x
        cells = new_numbers[self.cells[rng.permutation(len(self.cells))]]
        cells = np.array([c[_random_corner_permutation(self.cell, rng)] for c in cells])
        return replace(self, x=x, cells=cells)


def _random_corner_permutation(cell, rng):
    dim = DIMENSION_BY_CELL_NAME[cell]
    if cell in SIMPLICES:
        return rng.permutation(dim + 1)
    corners = np.arange(2**dim).reshape((2,) * dim).transpose(rng.permutation(dim))
    return np.flip(corners, np.flatnonzero(rng.random(dim) < 0.5)).ravel()


@dataclass(frozen=True)
class AffinePlacement:
    """Affine map of points x to unit A (x + offset): change of units, rigid motion or skew.

    The matrix A is the field `matrix`, by default the identity.
    """

    unit: float = 1.0
    matrix: np.ndarray | float = 1.0
    offset: np.ndarray | float = 0.0

    def place_points(self, x):
        return self.unit * self.map_vectors_by_matrix(np.asarray(x) + self.offset)

    def map_vectors_by_matrix(self, v):
        """Map directions (..., dim) by the matrix, without the factor `unit`."""
        v = np.asarray(v, dtype=float)
        return v @ self.matrix.T if np.ndim(self.matrix) else v

    def map_points_back(self, x):
        inverse = np.linalg.inv(self.matrix) if np.ndim(self.matrix) else np.float64(1.0)
        return AffinePlacement(1.0, inverse).map_vectors_by_matrix(x / self.unit) - self.offset

    def side_marker(self, axis, coordinate):
        """Return a function that marks the placed image of the plane x[axis] = coordinate."""

        def is_on_side(x):
            dim = len(self.matrix) if np.ndim(self.matrix) else np.size(self.offset)
            # far from the origin, errors are 1e-10; neighbouring nodes are more than 1e-3 apart
            return (
                np.abs(self.map_points_back(x.T[:, : max(dim, axis + 1)])[:, axis] - coordinate)
                < 1e-6
            )

        return is_on_side


def random_rotation_matrix(dim, seed):
    Q, R = np.linalg.qr(np.random.default_rng(seed).standard_normal((dim, dim)))
    Q *= np.sign(np.diag(R))
    Q[0] *= np.sign(np.linalg.det(Q))
    return Q


def match_nodes(x, y, placement=None):
    """Return the index in x of each node of y, where y has the nodes of x in another order.

    If a placement is given, x is mapped by it first.
    """
    if placement is not None:
        x = placement.place_points(x)
    distance, node_index = cKDTree(x).query(y)
    # mid-side nodes are computed from vertices that were rounded
    assert distance.max() <= 8 * MACHINE_EPSILON * np.abs(x).max() * x.shape[1]
    assert len(np.unique(node_index)) == len(x) == len(y)
    return node_index


def random_cell_points(cell, n_points, seed):
    """Return random points (n, dim) in a reference cell.

    All sub-cells of a tetrahedron have the same number of points, so there may be a few more.
    """
    rng, corners = np.random.default_rng(seed), basix.geometry(basix.CellType[cell])
    if cell != "tetrahedron":
        return rng.dirichlet(np.ones(len(corners)), n_points) @ corners
    nodes, sub_cells = (
        np.array(REFERENCE_ELEMENTS["T10"].nodes) / 2,
        np.array(REFERENCE_ELEMENTS["T10"].sub_cells),
    )
    nodes = np.vstack([nodes, nodes[4:].mean(axis=0)])
    weights = rng.dirichlet(np.ones(4), (len(sub_cells), -(-n_points // len(sub_cells))))
    return (weights @ nodes[sub_cells]).reshape(-1, 3)


# -- builders ------------------------------------------------------------------------------------


def structured_grid(cell, coordinate_lines, seed=0, distortion=0.0):
    """Return the grid of a box that coordinate lines define; triangles have random diagonals.

    `distortion` (0 to 1) scales the random shifts of the vertices. Vertices on sides stay on them.
    """
    rng = np.random.default_rng(seed)
    dim, shape = DIMENSION_BY_CELL_NAME[cell], tuple(len(line) for line in coordinate_lines)
    x = np.stack(np.meshgrid(*coordinate_lines, indexing="ij"), axis=-1).reshape(-1, dim)
    vertex_numbers = np.arange(len(x)).reshape(shape)
    offsets = np.array(np.meshgrid(*[(0, 1)] * dim, indexing="ij")).reshape(dim, -1)[::-1].T
    corner_numbers = [
        vertex_numbers[
            tuple(slice(o, n - 1 + o) for o, n in zip(offset, shape, strict=True))
        ].ravel()
        for offset in offsets
    ]
    cells = np.stack(corner_numbers, axis=1)
    x = x + distortion * _MAX_SHIFT_OVER_HALF_SPACING * _random_vertex_shifts(coordinate_lines, rng)
    if cell == "triangle":
        has_other_diagonal = rng.random(len(cells)) < 0.5
        halves = np.where(
            has_other_diagonal[:, None, None],
            cells[:, [[0, 1, 3], [0, 2, 3]]],
            cells[:, [[0, 1, 2], [1, 2, 3]]],
        )
        cells = halves.reshape(-1, 3)
    elif cell == "tetrahedron":
        tetrahedra = [
            [0, 1, 3, 7],
            [0, 1, 5, 7],
            [0, 2, 3, 7],
            [0, 2, 6, 7],
            [0, 4, 5, 7],
            [0, 4, 6, 7],
        ]
        cells = cells[:, tetrahedra].reshape(-1, 4)
    return Grid(cell, x, cells)


def _random_vertex_shifts(coordinate_lines, rng):
    """Return random vectors (n, dim) at grid points, up to half the distance to neighbours.

    Components normal to the sides of the box are zero on these sides.
    """
    max_shifts = []
    for line in coordinate_lines:
        spacing = np.diff(line)
        half_gap = np.minimum(np.append(spacing, np.inf), np.append(np.inf, spacing)) / 2
        half_gap[[0, -1]] = 0.0
        max_shifts.append(half_gap)
    max_shifts = np.stack(np.meshgrid(*max_shifts, indexing="ij"), axis=-1).reshape(
        -1, len(coordinate_lines)
    )
    return max_shifts * rng.uniform(-1, 1, max_shifts.shape)


def random_graded_line(n_cells, length, seed):
    """Return n_cells + 1 coordinates from 0 to `length`; steps differ by a factor of up to 4."""
    steps = np.random.default_rng(seed).uniform(0.25, 1.0, n_cells)
    return length * np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()


# -- strategies ----------------------------------------------------------------------------------

SEED_STRATEGY = st.integers(0, 2**32 - 1)


@st.composite
def grids(draw, cells=CELL_NAMES, box_lengths=None, max_divisions=None):
    """Draw a graded grid of a box, which may be distorted; by default, the box has sides of 1."""
    cell, seed, is_distorted = (
        draw(st.sampled_from(cells)),
        draw(SEED_STRATEGY),
        draw(st.booleans()),
    )
    dim = DIMENSION_BY_CELL_NAME[cell]
    max_divisions = max_divisions or {1: 8, 2: 4, 3: 2}[dim]
    lines = [
        random_graded_line(draw(st.integers(1, max_divisions)), length, (seed, axis))
        for axis, length in enumerate([1.0] * dim if box_lengths is None else box_lengths)
    ]
    return structured_grid(cell, lines, seed, float(is_distorted))


def random_deformation_gradient(dim, seed):
    """Return a random matrix (dim, dim) with singular values from 1/2 to 2 and det > 0."""
    rng = np.random.default_rng(seed)
    return (
        random_rotation_matrix(dim, rng)
        @ np.diag(rng.uniform(0.5, 2.0, dim))
        @ random_rotation_matrix(dim, rng)
    )


def log_uniform_strategy(min_exponent, max_exponent):
    """Return a strategy for numbers between two powers of ten, with uniformly drawn exponents."""
    return st.integers(10 * min_exponent, 10 * max_exponent).map(
        lambda exponent: 10.0 ** (exponent / 10)
    )


LENGTH_UNIT_STRATEGY = st.sampled_from([1.0, 1e-3, 1e3, 1e6, 25.4e-3])  # m, km, mm, um, 39.4 m
YOUNGS_MODULUS_STRATEGY = log_uniform_strategy(-9, 12)

"""Random meshes of all cells, and what may be done to one without changing the problem on it.

Strategies draw few numbers, one of them the seed of everything else: arrays drawn by hypothesis
would cost more than the finite elements.
"""

from dataclasses import dataclass, replace

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
from dolfinx.mesh import create_mesh
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from tests.oracle.elements import ELEMENTS

CELL_DIMENSION = {
    "interval": 1,
    "triangle": 2,
    "quadrilateral": 2,
    "tetrahedron": 3,
    "hexahedron": 3,
}
CELLS = tuple(CELL_DIMENSION)
BODY_CELLS = CELLS[1:]  # cells of elastic bodies
SIMPLICES = ("interval", "triangle", "tetrahedron")
MACHINE_EPSILON = float(np.finfo(float).eps)

# How far a vertex is moved in a structured mesh, over half the distance to the next one: cells
# stay convex below 1/2
_MOVED = 0.4


@dataclass(frozen=True)
class Grid:
    """Vertices (n, dim) and cells (m, k) with their vertices in Basix's order."""

    cell: str
    x: np.ndarray
    cells: np.ndarray

    @property
    def dim(self):
        return CELL_DIMENSION[self.cell]

    def mesh(self):
        return create_mesh(
            MPI.COMM_SELF,
            cells=self.cells.astype(np.int64),
            x=np.ascontiguousarray(self.x, dtype=float),
            e=basix.ufl.element("Lagrange", self.cell, 1, shape=(self.dim,)),
        )

    def map_vertices(self, point_map):
        return replace(self, x=point_map(self.x))

    def altitude(self):
        """A length no cell is thinner than; of simplices, their least altitude.

        Half the inverse of the largest norm of the inverse Jacobian at the cells' corners, for
        simplices the inverse of the largest gradient of a hat function.
        """
        element = basix.create_element(basix.ElementFamily.P, basix.CellType[self.cell], 1)
        gradients = element.tabulate(1, element.points)[1:, :, :, 0]
        jacobian = np.einsum("jpn,cni->cpij", gradients, self.x[self.cells])
        slopes = np.einsum("jpn,cpji->cpni", gradients, np.linalg.inv(jacobian))
        return 1 / np.linalg.norm(slopes, axis=-1).max()

    def slope_round_off(self):
        """Relative error of slopes of shape functions: vertices are rounded, heights are small."""
        return MACHINE_EPSILON * np.abs(self.x).max() / self.altitude()

    def renumber(self, seed):
        """The same cells: vertices and cells in another order, and the vertices within cells.

        Within quadrilaterals and hexahedra the cube's symmetries may change it.
        """
        rng = np.random.default_rng(seed)
        new = rng.permutation(len(self.x))
        x = np.empty_like(self.x)
        x[new] = self.x
        cells = new[self.cells[rng.permutation(len(self.cells))]]
        cells = np.array([c[_turned(self.cell, rng)] for c in cells])
        return replace(self, x=x, cells=cells)


def _turned(cell, rng):
    dim = CELL_DIMENSION[cell]
    if cell in SIMPLICES:
        return rng.permutation(dim + 1)
    corners = np.arange(2**dim).reshape((2,) * dim).transpose(rng.permutation(dim))
    return np.flip(corners, np.flatnonzero(rng.random(dim) < 0.5)).ravel()


@dataclass(frozen=True)
class Placement:
    """x -> unit A (x + offset): another unit of length, a rigid motion or a skewed body."""

    unit: float = 1.0
    matrix: np.ndarray | float = 1.0
    offset: np.ndarray | float = 0.0

    def place_points(self, x):
        return self.unit * self.place_vectors(np.asarray(x) + self.offset)

    def place_vectors(self, v):
        """Directions (..., dim), without the unit."""
        v = np.asarray(v, dtype=float)
        return v @ self.matrix.T if np.ndim(self.matrix) else v

    def undo(self, x):
        inverse = np.linalg.inv(self.matrix) if np.ndim(self.matrix) else np.float64(1.0)
        return Placement(1.0, inverse).place_vectors(x / self.unit) - self.offset

    def side_marker(self, axis, value):
        """Marker of a plane x[axis] = value of the body before it was placed."""

        def there(x):
            dim = len(self.matrix) if np.ndim(self.matrix) else np.size(self.offset)
            # far from the origin coordinates keep 1e-10; neighbours are 1e-3 apart or more
            return np.abs(self.undo(x.T[:, : max(dim, axis + 1)])[:, axis] - value) < 1e-6

        return there


def random_rotation(dim, seed):
    Q, R = np.linalg.qr(np.random.default_rng(seed).standard_normal((dim, dim)))
    Q *= np.sign(np.diag(R))
    Q[0] *= np.sign(np.linalg.det(Q))
    return Q


def match_nodes(x, y, placement=None):
    """For each node of y its number in x, where y are the nodes x, placed elsewhere."""
    if placement is not None:
        x = placement.place_points(x)
    distance, at = cKDTree(x).query(y)
    # mid-side nodes are computed from vertices that were rounded
    assert distance.max() <= 8 * MACHINE_EPSILON * np.abs(x).max() * x.shape[1]
    assert len(np.unique(at)) == len(x) == len(y)
    return at


def random_cell_points(cell, count, seed):
    """Some `count` points of a reference cell; as many in each sub-cell of a tetrahedron."""
    rng, corners = np.random.default_rng(seed), basix.geometry(basix.CellType[cell])
    if cell != "tetrahedron":
        return rng.dirichlet(np.ones(len(corners)), count) @ corners
    nodes, parts = np.array(ELEMENTS["T10"].nodes) / 2, np.array(ELEMENTS["T10"].sub_cells)
    nodes = np.vstack([nodes, nodes[4:].mean(axis=0)])
    weights = rng.dirichlet(np.ones(4), (len(parts), -(-count // len(parts))))
    return (weights @ nodes[parts]).reshape(-1, 3)


# -- builders ------------------------------------------------------------------------------------


def structured_grid(cell, lines, seed=0, distortion=0.0):
    """Box between grid lines, graded where these are; each square of triangles cut at random.

    `moved`, 0 to 1, is how far vertices leave their places; those on sides stay on them.
    """
    rng = np.random.default_rng(seed)
    dim, shape = CELL_DIMENSION[cell], tuple(len(line) for line in lines)
    x = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, dim)
    number = np.arange(len(x)).reshape(shape)
    offsets = np.array(np.meshgrid(*[(0, 1)] * dim, indexing="ij")).reshape(dim, -1)[::-1].T
    parts = [
        number[tuple(slice(o, n - 1 + o) for o, n in zip(off, shape, strict=True))].ravel()
        for off in offsets
    ]
    boxes = np.stack(parts, axis=1)
    x = x + distortion * _MOVED * _shifts(lines, rng)
    if cell == "triangle":
        cut = rng.random(len(boxes)) < 0.5
        halves = np.where(
            cut[:, None, None], boxes[:, [[0, 1, 3], [0, 2, 3]]], boxes[:, [[0, 1, 2], [1, 2, 3]]]
        )
        boxes = halves.reshape(-1, 3)
    elif cell == "tetrahedron":
        paths = [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]]
        boxes = boxes[:, paths].reshape(-1, 4)
    return Grid(cell, x, boxes)


def _shifts(lines, rng):
    """Random vectors (n, dim) at grid points, up to half the way to the next one."""
    room = []
    for line in lines:
        step = np.diff(line)
        least = np.minimum(np.append(step, np.inf), np.append(np.inf, step)) / 2
        least[[0, -1]] = 0.0
        room.append(least)
    room = np.stack(np.meshgrid(*room, indexing="ij"), axis=-1).reshape(-1, len(lines))
    return room * rng.uniform(-1, 1, room.shape)


def random_graded_line(count, length, seed):
    """Increasing coordinates of count + 1 lines, steps up to 4 times as long as others."""
    steps = np.random.default_rng(seed).uniform(0.25, 1.0, count)
    return length * np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()


# -- strategies ----------------------------------------------------------------------------------

SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def grids(draw, cells=CELLS, size=None, max_divisions=None):
    """A box, by default of side 1, graded or distorted."""
    cell, seed, distorted = draw(st.sampled_from(cells)), draw(SEEDS), draw(st.booleans())
    dim = CELL_DIMENSION[cell]
    max_divisions = max_divisions or {1: 8, 2: 4, 3: 2}[dim]
    lines = [
        random_graded_line(draw(st.integers(1, max_divisions)), length, (seed, axis))
        for axis, length in enumerate([1.0] * dim if size is None else size)
    ]
    return structured_grid(cell, lines, seed, float(distorted))


def random_skew_matrix(dim, seed):
    """A matrix of positive determinant, its singular values between 1/2 and 2."""
    rng = np.random.default_rng(seed)
    return (
        random_rotation(dim, rng) @ np.diag(rng.uniform(0.5, 2.0, dim)) @ random_rotation(dim, rng)
    )


def powers_of_ten(low, high):
    """Numbers between 10**low and 10**high, evenly in the exponent (floats would crowd at 0)."""
    return st.integers(10 * low, 10 * high).map(lambda exponent: 10.0 ** (exponent / 10))


LENGTH_UNITS = st.sampled_from([1.0, 1e-3, 1e3, 1e6, 25.4e-3])  # m, km, mm, um, 25.4 m
MODULI = powers_of_ten(-9, 12)

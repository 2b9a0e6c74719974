"""Columns of section 7.5 as families of moving meshes, and their matrices and eigenvalues.

The mesh of a column keeps its topology while radii, heights, grading and fillets change: matrices
are assembled anew, forms are compiled once. Matrices here are SciPy's, and the eigenvalue solver is
ARPACK, unlike those of the page (`study.paper.s7_5_model`), by which they are tested.

Units are those of the paper as printed: kN, m, kg; eigenvalues are in 1000/s².
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.sparse import csc_matrix, csr_matrix, diags, eye, kron
from scipy.sparse.linalg import LinearOperator, eigs, splu

from pw_elements import Body, Material, Spaces
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern
from study.meshes.inner_nodes import mid_diagonal_nodes
from study.model.elements import serendipity_spaces
from study.paper.s7_5_model import DENSITY, MODES, POISSONS_RATIO, YOUNGS_MODULUS
from study.paper.s7_5_profiles import Profile, mesh_column

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

EIGENVALUE_TOLERANCE = 1e-11
"""Relative, of the eigenvalue solver."""
MAX_IMAGINARY_RATIO = 1e-6
"""|Im| / |Re| above which an eigenvalue is complex: the treatment has no row of Table 1."""

REFERENCE_LENGTHS = (1.0, 2.0, 3.0, 0.5, 1.0, 1.0, 1.0, 1.0)
"""Radii and heights on which the topology is made; all columns have radii 4 < 1 < 2 < 3."""
N_RADII = 4


class Supports(NamedTuple):
    """Surfaces that support the vibration, by their numbers; in their plane, too, if `tangential`.

    `axis_open` frees the standard elements' nodes on the axis, which carry no contact force.
    """

    surfaces: tuple[int, ...]
    tangential: bool
    axis_open: bool = False


class Shape(NamedTuple):
    """What decides a column besides the topology of its mesh.

    Args:
        lengths: radii and heights (8,) from the base upwards, in m.
        grading: length of the elements farthest from re-entrant corners and ends over those there.
        fillet: radius of the fillets over the shortest length that meets the corner; 0 for none.
    """

    lengths: Array
    grading: float = 1.0
    fillet: float = 0.0


class Topology(NamedTuple):
    """Divisions of the rings from the axis and of the heights from the base, and the diagonals."""

    rings: tuple[int, ...]
    heights: tuple[int, ...]
    pattern: DiagonalPattern

    @property
    def reference(self) -> Profile:
        """Return the column on which the mesh is made."""
        return _profile(np.array(REFERENCE_LENGTHS), self)


class MovingMesh:
    """Mesh of one topology, whose vertices follow a shape."""

    def __init__(self, topology: Topology, cell: str) -> None:
        self.topology = topology
        self.mesh: Mesh = mesh_column(topology.reference, cell, pattern=topology.pattern)
        self.reference_points = self.mesh.geometry.x.copy()
        reference_lines = mesh_lines(Shape(np.array(REFERENCE_LENGTHS)), topology)
        self._index = [
            np.abs(self.reference_points[:, k, None] - lines).argmin(axis=1)
            for k, lines in enumerate(reference_lines)
        ]

    def move(self, shape: Shape) -> None:
        """Put the vertices where a shape has them."""
        r, z = grid_points(shape, self.topology)
        self.mesh.geometry.x[:, 0] = r[self._index[0], self._index[1]]
        self.mesh.geometry.x[:, 1] = z[self._index[0], self._index[1]]


@dataclass
class Element:
    """One element on a moving mesh: its forms, and the nodes on axis and surfaces.

    Args:
        mesh: the moving mesh, in its reference position when this is made.
        spaces: of displacements and weights.
        degrees: quadrature degree of each set of forms; None is the library's.
        node_points: nodes (n, 3) in the reference position.
    """

    mesh: MovingMesh
    spaces: Spaces
    degrees: tuple[int | None, ...] = (None,)
    node_points: Array = field(init=False)

    def __post_init__(self) -> None:
        material = Material(YOUNGS_MODULUS, POISSONS_RATIO, DENSITY)
        self._stiffness, self._mass = {}, {}
        for degree in self.degrees:
            body = Body(self.spaces, material, StressState.AXISYMMETRIC, quadrature_degree=degree)
            self._stiffness[degree] = fem.form(body.stiffness())
            self._mass[degree] = fem.form(body.mass())
        self.node_points = self.spaces.trial.tabulate_dof_coordinates().copy()
        x = self.node_points.T
        self._on_axis = np.isclose(x[0], 0.0)
        self._on_surface = [face.contains(x) for face in self.mesh.topology.reference.faces]

    def stiffness(self, degree: int | None = None) -> csr_matrix:
        """Assemble the stiffness (n, n) on the mesh as it lies."""
        return fem.assemble_matrix(self._stiffness[degree]).to_scipy().tocsr()

    def mass(self, degree: int | None = None) -> csr_matrix:
        """Assemble the consistent mass (n, n) on the mesh as it lies."""
        return fem.assemble_matrix(self._mass[degree]).to_scipy().tocsr()

    def free_dofs(self, supports: Supports, axis_open: bool = False) -> Indices:
        """Return the degrees of freedom that supports leave, component by component of nodes."""
        fixed = np.zeros((len(self.node_points), 2), dtype=bool)
        fixed[self._on_axis, 0] = True
        for surface in supports.surfaces:
            closed = self._on_surface[surface - 1]
            if axis_open:
                closed = closed & ~self._on_axis
            fixed[closed, 1] = True
            if supports.tangential:
                fixed[closed, 0] = True
        return np.flatnonzero(~fixed.ravel())

    @cached_property
    def inner_dofs(self) -> Indices:
        """Return the degrees of freedom (m,) of the nodes inside pairs of triangles."""
        nodes = mid_diagonal_nodes(self.spaces.trial)
        return np.asarray((2 * nodes[:, None] + [0, 1]).ravel(), dtype=np.intp)


def standard_triangle(topology: Topology) -> Element:
    """Return the standard 6-node triangle on a column's mesh."""
    mesh = MovingMesh(topology, "triangle")
    return Element(mesh, Spaces.galerkin(mesh.mesh))


def standard_quadrilateral(topology: Topology) -> Element:
    """Return the standard 8-node quadrilateral on a column's mesh."""
    mesh = MovingMesh(topology, "quadrilateral")
    return Element(mesh, serendipity_spaces(mesh.mesh))


def standard_eigenvalues(element: Element, shape: Shape, supports: Supports) -> Array:
    """Return the first eigenvalues (6,) of a standard element."""
    element.mesh.move(shape)
    free = element.free_dofs(supports, supports.axis_open)
    return Stiffness(element.stiffness(), free).lowest_eigenvalues(element.mass())


class Stiffness:
    """Stiffness (n, n) on free unknowns, factorised once for all masses."""

    def __init__(self, K: csr_matrix, free: Indices) -> None:
        self._free = free
        K_free = csc_matrix(K.tocsr()[free][:, free])
        self._factors = splu(K_free, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01)

    def lowest_eigenvalues(self, M: csr_matrix) -> Array:
        """Return the smallest eigenvalues (6,) of (K - lambda M) d = 0 with a mass (n, n).

        They are NaN if one of them is complex or not positive.
        """
        M_free = M.tocsr()[self._free][:, self._free]
        inverse = LinearOperator(
            M_free.shape, lambda d: self._factors.solve(M_free @ d), dtype=float
        )
        start = np.random.default_rng(0).standard_normal(len(self._free))
        options = {"v0": start, "tol": EIGENVALUE_TOLERANCE, "return_eigenvectors": False}
        values = 1 / eigs(inverse, k=MODES, ncv=24, which="LM", **options)
        is_complex = np.abs(values.imag) > MAX_IMAGINARY_RATIO * np.abs(values.real)
        if is_complex.any() or values.real.min() <= 0:
            return np.full(MODES, np.nan)
        return np.asarray(np.sort(values.real))


def _profile(lengths: Array, topology: Topology) -> Profile:
    r1, r2, r3, r4, h1, h2, h3, h4 = (float(length) for length in lengths)
    return Profile((r1, r2, r3, r4), (h1, h2, h3, h4), topology.rings, topology.heights)


# Mesh lines, graded to the re-entrant corners, and fillets


def mesh_lines(shape: Shape, topology: Topology) -> tuple[Array, Array]:
    """Return the radii and levels of the mesh lines, graded to those of corners and rims."""
    profile = _profile(shape.lengths, topology)
    radii = np.array([0.0, *sorted(profile.radii)])
    # Corners are at radii 4, 1 and 2 and at the three steps; supported ends have singular rims
    r = _graded(radii, topology.rings, (False, True, True, True, False), shape.grading)
    z = _graded(profile.levels, topology.heights, (True,) * 5, shape.grading)
    return r, z


def _graded(
    borders: Array, divisions: tuple[int, ...], has_corner: tuple[bool, ...], grading: float
) -> Array:
    lines = [borders[:1]]
    for k, n in enumerate(divisions):
        middles = (np.arange(n) + 0.5) / n
        distances = [middles] * has_corner[k] + [1 - middles] * has_corner[k + 1]
        farthest = 0.5 if len(distances) == 2 else 1.0
        sizes = grading ** (np.min(distances, axis=0) / farthest)
        ends = np.cumsum(sizes) / sizes.sum()
        lines.append(borders[k] + (borders[k + 1] - borders[k]) * ends)
    return np.concatenate(lines)


def grid_points(shape: Shape, topology: Topology) -> tuple[Array, Array]:
    """Return radii and levels of all points of the grid, each (n_r, n_z), moved by the fillets."""
    lines_r, lines_z = mesh_lines(shape, topology)
    points = np.stack(np.meshgrid(lines_r, lines_z, indexing="ij"), axis=-1)
    if shape.fillet:
        points += _fillet_displacement(points, shape)
    return points[..., 0], points[..., 1]


def _fillet_displacement(points: Array, shape: Shape) -> Array:
    """Return displacements (n_r, n_z, 2) of the grid that round its re-entrant corners.

    Boundary points on the legs of a corner, within one radius of it, move to the arc; points inside
    follow as the mean of their neighbours.
    """
    radii, heights = shape.lengths[:N_RADII], shape.lengths[N_RADII:]
    levels = np.cumsum(heights)
    r1, r2, r3, r4 = radii
    # Corner, direction of the horizontal leg is outwards; of the vertical one: down, down, up
    corners = (
        (r1, levels[0], -1.0, min(r2 - r1, heights[0])),
        (r2, levels[1], -1.0, min(r3 - r2, heights[1])),
        (r4, levels[2], 1.0, min(r3 - r4, heights[3])),
    )
    moved = np.zeros_like(points)
    for r_corner, z_corner, direction, shortest in corners:
        radius = shape.fillet * shortest
        r, z = points[..., 0] - r_corner, direction * (points[..., 1] - z_corner)
        on_vertical = np.isclose(r, 0.0) & (z > -1e-12) & (z < radius)
        on_horizontal = np.isclose(z, 0.0) & (r > -1e-12) & (r < radius)
        along = np.where(on_vertical, -z, r)
        angle = np.pi / 4 * (along / radius + 1)
        arc = radius * np.stack([1 - np.cos(angle), direction * (1 - np.sin(angle))], axis=-1)
        leg = np.stack([r, direction * z], axis=-1)
        on_legs = on_vertical | on_horizontal
        moved[on_legs] = (arc - leg)[on_legs]

    centres = (points[1:, 1:] + points[:-1, :-1]) / 2
    cylinder = np.searchsorted(levels[:-1], centres[..., 1])
    is_inside = centres[..., 0] < radii[cylinder]
    n_cells = np.zeros(points.shape[:2], dtype=int)
    for i in (0, 1):
        for k in (0, 1):
            n_cells[i : i + len(is_inside), k : k + is_inside.shape[1]] += is_inside
    n_r, n_z = points.shape[:2]
    chains = [diags([np.ones(n - 1), np.ones(n - 1)], [-1, 1]) for n in (n_r, n_z)]
    neighbours = (kron(chains[0], eye(n_z)) + kron(eye(n_r), chains[1])).tocsr()
    inside = np.flatnonzero(n_cells.ravel() == 4)
    displacement = moved.reshape(-1, 2)
    laplacian = (4 * eye(len(inside)) - neighbours[inside][:, inside]).tocsc()
    displacement[inside] = splu(laplacian).solve(neighbours[inside] @ displacement)
    return displacement.reshape(points.shape)

"""Matrices and eigenvalues of the columns of section 7.5, on meshes whose vertices move.

The mesh of a column keeps its topology while radii, heights, grading and fillets change, so that
forms are compiled once and only matrices are assembled anew. Matrices are SciPy's, and the
eigenvalue solver is ARPACK, unlike in `study.paper.s7_5_model`, with which tests compare them.

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
from study.paper.s7_5_profiles import ColumnProfile, mesh_column

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

EIGENVALUE_TOLERANCE = 1e-11
"""Relative tolerance of the eigenvalue solver."""
MAX_IMAGINARY_RATIO = 1e-6
"""Ratio |Im| / |Re| above which an eigenvalue is complex, so that Table 1 cannot contain it."""

REFERENCE_LENGTHS = (1.0, 2.0, 3.0, 0.5, 1.0, 1.0, 1.0, 1.0)
"""Radii and heights (8,) for which meshes are made; all columns have radii 4 < 1 < 2 < 3."""
N_RADII = 4


class Supports(NamedTuple):
    """Supports of the column during vibration.

    Args:
        surfaces: Numbers of the contact surfaces that are supported in the normal direction.
        tangential: Whether these surfaces are supported in the tangential direction, too.
        axis_open: Whether nodes of standard elements on the axis are not supported, since they
            carry no contact force.
    """

    surfaces: tuple[int, ...]
    tangential: bool
    axis_open: bool = False


class Shape(NamedTuple):
    """Dimensions of a column and positions of its mesh lines.

    Args:
        lengths: Radii and heights (8,) from the base upwards, in m.
        grading: Size of the elements farthest from re-entrant corners and ends, divided by the size
            of the elements there.
        fillet: Radius of the fillets, divided by the shortest length that meets the corner; 0
            without fillets.
    """

    lengths: Array
    grading: float = 1.0
    fillet: float = 0.0


class Topology(NamedTuple):
    """Topology of the mesh of a column.

    Args:
        ring_divisions: Numbers of elements between successive radii, from the axis outwards.
        heights: Numbers of elements over the heights of the cylinders, from the base upwards.
        pattern: Pattern of the diagonals that cut quadrilaterals into triangles.
    """

    ring_divisions: tuple[int, ...]
    heights: tuple[int, ...]
    pattern: DiagonalPattern

    @property
    def reference(self) -> ColumnProfile:
        """Column with `REFERENCE_LENGTHS`, on which the mesh is made before its vertices move."""
        return _make_profile(np.array(REFERENCE_LENGTHS), self)


class MovingMesh:
    """Mesh of a column with a fixed topology, whose vertices are moved to different shapes.

    Args:
        topology: Divisions and diagonals.
        cell: "triangle" or "quadrilateral".
    """

    def __init__(self, topology: Topology, cell: str) -> None:
        self.topology = topology
        self.mesh: Mesh = mesh_column(topology.reference, cell, pattern=topology.pattern)
        self.reference_points = self.mesh.geometry.x.copy()
        reference_lines = graded_mesh_lines(Shape(np.array(REFERENCE_LENGTHS)), topology)
        self._index = [
            np.abs(self.reference_points[:, k, None] - lines).argmin(axis=1)
            for k, lines in enumerate(reference_lines)
        ]

    def move_vertices_to_shape(self, shape: Shape) -> None:
        """Move the vertices to the grid points of a shape."""
        r, z = grid_points_moved_by_fillets(shape, self.topology)
        self.mesh.geometry.x[:, 0] = r[self._index[0], self._index[1]]
        self.mesh.geometry.x[:, 1] = z[self._index[0], self._index[1]]


@dataclass
class MovingMeshElement:
    """Compiled forms of an element on a moving mesh, and its nodes on the axis and the surfaces.

    Args:
        mesh: Moving mesh, which must be in its reference position.
        spaces: Trial and test spaces.
        degrees: Quadrature degrees for which forms are compiled; None is the library's default.
        node_points: Nodes (n, 3) in the reference position.
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
        """Assemble the stiffness (n, n) on the present position of the mesh.

        `degree` is one of the quadrature degrees of the element.
        """
        return fem.assemble_matrix(self._stiffness[degree]).to_scipy().tocsr()

    def mass(self, degree: int | None = None) -> csr_matrix:
        """Assemble the consistent mass (n, n) on the present position of the mesh.

        `degree` is one of the quadrature degrees of the element.
        """
        return fem.assemble_matrix(self._mass[degree]).to_scipy().tocsr()

    def free_dofs(self, supports: Supports, axis_nodes_unsupported: bool = False) -> Indices:
        """Return the numbers of the degrees of freedom that are not supported.

        Dof 2 i + k is component k of node i. If `axis_nodes_unsupported` is true, nodes on the axis
        are not supported in the normal direction of the surfaces.
        """
        fixed = np.zeros((len(self.node_points), 2), dtype=bool)
        fixed[self._on_axis, 0] = True
        for surface in supports.surfaces:
            closed = self._on_surface[surface - 1]
            if axis_nodes_unsupported:
                closed = closed & ~self._on_axis
            fixed[closed, 1] = True
            if supports.tangential:
                fixed[closed, 0] = True
        return np.flatnonzero(~fixed.ravel())

    @cached_property
    def inner_dofs(self) -> Indices:
        """Degrees of freedom (m,) of the mid-side nodes inside pairs of triangles."""
        nodes = mid_diagonal_nodes(self.spaces.trial)
        return np.asarray((2 * nodes[:, None] + [0, 1]).ravel(), dtype=np.intp)


def make_standard_triangle_element(topology: Topology) -> MovingMeshElement:
    """Return the standard 6-node triangle on the moving mesh of a topology."""
    mesh = MovingMesh(topology, "triangle")
    return MovingMeshElement(mesh, Spaces.galerkin(mesh.mesh))


def make_standard_quadrilateral_element(topology: Topology) -> MovingMeshElement:
    """Return the standard 8-node quadrilateral on the moving mesh of a topology."""
    mesh = MovingMesh(topology, "quadrilateral")
    return MovingMeshElement(mesh, serendipity_spaces(mesh.mesh))


def compute_standard_element_eigenvalues(
    element: MovingMeshElement, shape: Shape, supports: Supports
) -> Array:
    """Move the mesh of a standard element to a shape and return the first eigenvalues (6,)."""
    element.mesh.move_vertices_to_shape(shape)
    free = element.free_dofs(supports, supports.axis_open)
    return FactorisedStiffness(element.stiffness(), free).lowest_eigenvalues(element.mass())


class FactorisedStiffness:
    """Stiffness on free degrees of freedom, factorised once for several mass matrices.

    Args:
        K: Stiffness (n, n).
        free: Numbers of the free degrees of freedom.
    """

    def __init__(self, K: csr_matrix, free: Indices) -> None:
        self._free = free
        K_free = csc_matrix(K.tocsr()[free][:, free])
        self._factors = splu(K_free, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01)

    def lowest_eigenvalues(self, M: csr_matrix) -> Array:
        """Return the smallest eigenvalues (6,) of (K - lambda M) d = 0 for a mass M (n, n).

        All are NaN if one of them is complex or not positive.
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


def _make_profile(lengths: Array, topology: Topology) -> ColumnProfile:
    r1, r2, r3, r4, h1, h2, h3, h4 = (float(length) for length in lengths)
    return ColumnProfile(
        (r1, r2, r3, r4), (h1, h2, h3, h4), topology.ring_divisions, topology.heights
    )


# Mesh lines, graded to the re-entrant corners, and fillets


def graded_mesh_lines(shape: Shape, topology: Topology) -> tuple[Array, Array]:
    """Return radii and heights of the mesh lines, graded towards re-entrant corners and rims."""
    profile = _make_profile(shape.lengths, topology)
    radii = np.array([0.0, *sorted(profile.radii)])
    # Corners are at radii 4, 1 and 2 and at the three steps; supported ends have singular rims
    r = _grade_lines_towards_corners(
        radii, topology.ring_divisions, (False, True, True, True, False), shape.grading
    )
    z = _grade_lines_towards_corners(
        profile.levels_above_base, topology.heights, (True,) * 5, shape.grading
    )
    return r, z


def _grade_lines_towards_corners(
    borders: Array, divisions: tuple[int, ...], has_corner: tuple[bool, ...], grading: float
) -> Array:
    """Return mesh lines between borders, with smaller elements near borders that have corners.

    Args:
        borders: Coordinates (n + 1,) between which the intervals lie.
        divisions: Numbers (n,) of elements in the intervals.
        has_corner: Whether elements are refined towards each border, (n + 1,).
        grading: Size of the largest elements divided by that of the smallest.
    """
    lines = [borders[:1]]
    for k, n in enumerate(divisions):
        middles = (np.arange(n) + 0.5) / n
        distances = [middles] * has_corner[k] + [1 - middles] * has_corner[k + 1]
        farthest = 0.5 if len(distances) == 2 else 1.0
        sizes = grading ** (np.min(distances, axis=0) / farthest)
        ends = np.cumsum(sizes) / sizes.sum()
        lines.append(borders[k] + (borders[k + 1] - borders[k]) * ends)
    return np.concatenate(lines)


def grid_points_moved_by_fillets(shape: Shape, topology: Topology) -> tuple[Array, Array]:
    """Return radii and heights, each (n_r, n_z), of grid points that are moved by the fillets.

    The grid includes points outside of the cross-section.
    """
    lines_r, lines_z = graded_mesh_lines(shape, topology)
    points = np.stack(np.meshgrid(lines_r, lines_z, indexing="ij"), axis=-1)
    if shape.fillet:
        points += _grid_displacement_by_fillets(points, shape)
    return points[..., 0], points[..., 1]


def _grid_displacement_by_fillets(points: Array, shape: Shape) -> Array:
    """Return the displacements (n_r, n_z, 2) of grid points that round the re-entrant corners.

    Boundary points on the legs of a corner, within one radius of it, move to the arc. Displacements
    of inner points are the means of their four neighbours'.
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
    boundary_displacement = np.zeros_like(points)
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
        boundary_displacement[on_legs] = (arc - leg)[on_legs]

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
    displacement = boundary_displacement.reshape(-1, 2)
    laplacian = (4 * eye(len(inside)) - neighbours[inside][:, inside]).tocsc()
    displacement[inside] = splu(laplacian).solve(neighbours[inside] @ displacement)
    return displacement.reshape(points.shape)

"""Largest ratios of bulk to shear stiffness at which elements without a pressure are safe.

With piecewise-linear weight functions and without a pressure, the stiffness matrix may become
singular, or its determinant may change sign, if the bulk modulus is large compared with the shear
modulus. On straight triangles this never happens, because the stiffness is the product of the
matrix of `force_transfer` and the stiffness of the standard element. On straight quadrilaterals and
on parallelepipeds it does not happen at any ratio, unless angles approach 180 degrees. On other
cells it may happen above the limits in this module, which section E of the study determines; see
the guide's page "Solvability".
"""

import logging
from itertools import combinations

from mpi4py import MPI

import basix
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements._compat import cell_geometry_nodes, interpolation_points
from pw_elements.arrays import Array
from pw_elements.checks import format_points
from pw_elements.progress import log_on_root
from pw_elements.spaces import compile_form

# Ratio of bulk to shear modulus up to which the stiffness K is far from singular. The corresponding
# Poisson's ratio is given in brackets. The "relative singular value" is the least singular value of
# K divided by that of the standard element's stiffness. At the limits, displacements under a body
# force differ from the standard element's by about 10 % at most on the compact meshes and layers of
# section E of the study; in the range of det K < 0 the difference has no bound.
# Curved cells: limit 25 (0.48), where the relative singular value is 0.1 or more; det K < 0 occurs
# from 100 (0.495).
# Straight tetrahedra, and hexahedra other than parallelepipeds: limit 100 (0.495), where the
# relative singular value is 0.1 or more; 0.01 occurs at 500 (0.499), det K < 0 from 1000 (0.4995).
MAX_BULK_OVER_SHEAR_CURVED_CELLS = 25.0
MAX_BULK_OVER_SHEAR_STRAIGHT_CELLS = 100.0
# Largest deviation of a node from its position in a cell with straight edges, relative to the
# largest extent of a cell; and largest deviation of a corner from its position in a parallelepiped,
# relative to the largest component of an edge vector
STRAIGHT_CELL_TOLERANCE_OVER_EXTENT = 1e-8
PARALLELEPIPED_TOLERANCE_OVER_EDGE = 1e-12

SINGULAR_STIFFNESS_WARNING_AND_REMEDY = (
    "the stiffness may be singular there, or its determinant negative, and displacements may be "
    "off by any amount: add a pressure, Spaces.hybrid(mesh), which serves up to and including "
    "nu = 0.5"
)


def bulk_over_shear(nu: float) -> float:
    """Return the ratio of bulk to shear modulus for Poisson's ratio nu; infinite for nu = 1/2."""
    return np.inf if nu >= 0.5 else 2 * (1 + nu) / (3 * (1 - 2 * nu))


def max_bulk_over_shear_without_pressure(mesh: Mesh) -> float:
    """Return the largest ratio of bulk to shear modulus at which no pressure is needed on a mesh.

    Up to this ratio, the stiffness of displacements without a pressure, with piecewise-linear
    weight functions, is far from singular. The ratio is infinite for types of cells on which the
    stiffness is never singular.
    """
    if not has_only_straight_cells(mesh):
        return MAX_BULK_OVER_SHEAR_CURVED_CELLS
    cell = mesh.topology.cell_name()
    safe = cell in ("interval", "triangle", "quadrilateral")
    if safe or (cell == "hexahedron" and has_only_parallelepiped_cells(mesh)):
        return np.inf
    return MAX_BULK_OVER_SHEAR_STRAIGHT_CELLS


def has_only_straight_cells(mesh: Mesh) -> bool:
    """Return whether all cells have straight edges and bilinear faces; collective."""
    element = mesh.ufl_domain().ufl_coordinate_element()
    if element.degree == 1:
        return True
    cell = element.cell_type
    linear = basix.create_element(basix.ElementFamily.P, cell, 1)
    points = element.basix_element.points
    weights = linear.tabulate(0, points)[0, :, :, 0]
    x = mesh.geometry.x[cell_geometry_nodes(mesh)]
    vertices = x[:, : weights.shape[1]]  # vertices are the first nodes of a cell
    off = np.abs(x - np.einsum("nv,cvi->cni", weights, vertices)).max(initial=0.0)
    size = np.ptp(vertices, axis=1).max(initial=0.0)
    straight = off <= STRAIGHT_CELL_TOLERANCE_OVER_EXTENT * size
    return bool(mesh.comm.allreduce(straight, MPI.LAND))


def has_only_parallelepiped_cells(mesh: Mesh) -> bool:
    """Return whether all quadrilaterals or hexahedra are parallelograms or parallelepipeds.

    Collective.
    """
    x = mesh.geometry.x[cell_geometry_nodes(mesh)][:, : 2**mesh.topology.dim]
    corners = x.shape[1]
    bits = np.arange(corners)[:, None] >> np.arange(corners.bit_length() - 1) & 1
    edges = x[:, 1 << np.arange(bits.shape[1])] - x[:, :1]
    off = np.abs(x - x[:, :1] - np.einsum("vk,cki->cvi", bits, edges)).max(initial=0.0)
    parallel = off <= PARALLELEPIPED_TOLERANCE_OVER_EDGE * np.abs(edges).max(initial=0.0)
    return bool(mesh.comm.allreduce(parallel, MPI.LAND))


class TangentBulkShearRatio:
    """Ratio of bulk to shear stiffness of a residual's tangent in each cell, at the current u.

    Let F be the deformation gradient and H a symmetric matrix, which is constant in a cell with the
    deformed midpoint c. The displacement w(H) = H (x + u - c) at the point x changes the
    deformation gradient by H F. If the deformation gradient is exp(t H) F, the second derivative of
    the cell's work with respect to t is, at t = 0,

        m(H) = dR(w(H); w(H)) + R(w(H^2)),

    where R is the residual integrated over the cell and dR is its derivative with respect to u. The
    second term ensures that a pressure contributes nothing to m if the motion preserves the volume.
    The bulk stiffness is computed from m of the unit matrix; the shear stiffness is the mean of m
    over matrices H with zero trace. In linear elasticity, the ratio equals that of the bulk modulus
    to the shear modulus.

    Args:
        form: residual, a linear form of displacements alone.
        u: function of the unknown displacements.

    Raises:
        ValueError: if the form of the work cannot be compiled.
    """

    def __init__(self, form: ufl.Form, u: fem.Function) -> None:
        space = u.function_space
        self._mesh, dim = space.mesh, space.mesh.geometry.dim
        self._midpoint = fem.Function(fem.functionspace(self._mesh, ("DG", 0, (dim,))))
        self._direction = fem.Constant(self._mesh, np.zeros((dim, dim)))
        x = ufl.SpatialCoordinate(self._mesh) + u
        points = interpolation_points(self._midpoint.function_space)
        self._deformed = fem.Expression(x, points)
        cells = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        self._cells = np.arange(cells, dtype=np.int32)
        H, arm = self._direction, x - self._midpoint
        inner = ufl.Form([part for part in form.integrals() if part.integral_type() == "cell"])
        (weight,), trial = inner.arguments(), ufl.TrialFunction(space)
        tangent = ufl.algorithms.expand_derivatives(ufl.derivative(inner, u, trial))
        work = ufl.replace(tangent, {weight: H * arm, trial: H * arm})
        work += ufl.replace(inner, {weight: H * H * arm})
        cell = ufl.TestFunction(fem.functionspace(self._mesh, ("DG", 0)))
        parts = [part.reconstruct(integrand=cell * part.integrand()) for part in work.integrals()]
        self._work = compile_form(ufl.Form(parts), 1, "the work of cells")
        self._numbers = self._work.function_spaces[0].dofmap.map().ravel()[self._cells]

    def compute_in_cells(self) -> Array:
        """Return the ratio (cells,) in each owned cell; 0 where shear stiffness is not positive.

        Collective.
        """
        dim = self._mesh.geometry.dim
        dofs = self._midpoint.function_space.dofmap.list[self._cells, 0]
        midpoints = self._deformed.eval(self._mesh, self._cells)
        self._midpoint.x.array.reshape(-1, dim)[dofs] = np.reshape(midpoints, (-1, dim))
        self._midpoint.x.scatter_forward()
        volume, shears = np.eye(dim) / np.sqrt(dim), []
        for i, j in combinations(range(dim), 2):
            shears.append(np.zeros((dim, dim)))
            shears[-1][[i, j], [j, i]] = np.sqrt(0.5)
        for k in range(1, dim):
            diagonal = np.append(np.ones(k), [-k, *[0.0] * (dim - k - 1)])
            shears.append(np.diag(diagonal / np.linalg.norm(diagonal)))
        m_volume = self._second_derivative_of_cell_work(volume)  # dim lambda + 2 mu
        m_shear = np.mean([self._second_derivative_of_cell_work(H) for H in shears], axis=0)  # 2 mu
        is_positive = m_shear > 0
        dim_lambda = np.where(is_positive, m_volume - m_shear, 0.0)
        two_mu = np.where(is_positive, m_shear, 1.0)
        return np.where(is_positive, 2 * dim_lambda / (dim * two_mu) + 2 / 3, 0.0)

    def _second_derivative_of_cell_work(self, direction: Array) -> Array:
        """Return the second derivative m(H), (cells,), of the work of each cell."""
        self._direction.value = direction
        return np.array(fem.assemble_vector(self._work).array[self._numbers])


class TangentBulkShearMonitor:
    """Monitor that warns once if the bulk stiffness of a tangent is too large for the element.

    Args:
        form: residual of displacements alone, with piecewise-linear weight functions.
        u: function of the unknown displacements.
    """

    def __init__(self, form: ufl.Form, u: fem.Function) -> None:
        self._mesh = u.function_space.mesh
        self._limit = max_bulk_over_shear_without_pressure(self._mesh)
        self._has_warned, self._ratio = False, None
        if np.isfinite(self._limit):
            try:
                self._ratio = TangentBulkShearRatio(form, u)
            except ValueError as error:
                words = (
                    "bulk over shear stiffness of the tangent is not measured, and no warning of a "
                    f"nearly incompressible body can be given: {error}"
                )
                log_on_root(self._mesh.comm, logging.WARNING, words, ".contact")

    def is_beyond_limit(self) -> bool:
        """Return whether the bulk stiffness of the tangent is too large at the current u.

        Collective. A warning is logged the first time that it is too large.
        """
        if self._ratio is None:
            return False
        comm, ratio = self._mesh.comm, self._ratio.compute_in_cells()
        largest = comm.allreduce(ratio.max(initial=0.0), MPI.MAX)
        if largest <= self._limit:
            return False
        if not self._has_warned:
            cells = np.flatnonzero(ratio > self._limit)
            local_midpoints = self._mesh.geometry.x[cell_geometry_nodes(self._mesh)[cells]].mean(
                axis=1
            )
            dim = self._mesh.geometry.dim
            midpoints = np.concatenate(comm.allgather(local_midpoints[:, :dim]))
            log_on_root(
                comm,
                logging.WARNING,
                f"the tangent's bulk stiffness is up to {largest:.3g} times its shear stiffness, "
                f"in {len(midpoints)} cells, first around {format_points(midpoints[:3])}, more "
                f"than {self._limit:g} times. With displacements and piecewise-linear weights on "
                f"such cells {SINGULAR_STIFFNESS_WARNING_AND_REMEDY}. "
                "Signs of determinants do not tell instability there",
                ".contact",
            )
            self._has_warned = True
        return True

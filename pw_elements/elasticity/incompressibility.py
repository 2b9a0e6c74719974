"""Limits of displacement elements for nearly incompressible bodies: bulk over shear stiffness.

With piecewise-linear weights and without a pressure, the stiffness becomes singular, or its
determinant changes sign, when the bulk modulus is large compared with the shear modulus. On
straight triangles and quadrilaterals and on parallelepipeds this never happens, because K = T K_G
or nearly so; on other cells it happens above the limits below, which a map shows
(`tests/library/near_incompressible.py`, and the guide's page on theory, "Nearly incompressible
bodies").
"""

import logging
from itertools import combinations

from mpi4py import MPI

import basix
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements._compat import cell_nodes, interpolation_points
from pw_elements.arrays import Array
from pw_elements.checks import format_points
from pw_elements.progress import log_on_root
from pw_elements.spaces import compile_form

# Bulk over shear modulus up to which K is far from singular. Curved cells: 50 (nu = 0.49), where
# the least singular value over the standard element's is 0.13; det K < 0 occurs from 140 (0.4965).
# Straight tetrahedra, and hexahedra other than parallelepipeds: 250 (0.498), where it is 0.1;
# values of 0.002 occur from 1000 (0.4995), det K < 0 from 5000 (0.4999).
MAX_RATIO_CURVED = 50.0
MAX_RATIO_STRAIGHT = 250.0
# Distance of a node from its position in a cell with straight edges, over the largest extent of a
# cell; and of a corner from its position in a parallelepiped, over the longest edge component
STRAIGHT_TOLERANCE = 1e-8
PARALLEL_TOLERANCE = 1e-12

HYBRID_SPACES_REMEDY = (
    "the stiffness may be singular there, or its determinant negative, and displacements may be "
    "off by any amount: add a pressure, Spaces.hybrid(mesh), which serves up to and including "
    "nu = 0.5"
)


def bulk_over_shear(nu: float) -> float:
    """Return bulk over shear modulus of an isotropic body; infinite for nu = 1/2."""
    return np.inf if nu >= 0.5 else 2 * (1 + nu) / (3 * (1 - 2 * nu))


def max_bulk_over_shear(mesh: Mesh) -> float:
    """Return the largest ratio at which K of displacements with linear weights is safe."""
    if not has_straight_cells(mesh):
        return MAX_RATIO_CURVED
    cell = mesh.topology.cell_name()
    safe = cell in ("interval", "triangle", "quadrilateral")
    if safe or (cell == "hexahedron" and has_parallel_cells(mesh)):
        return np.inf
    return MAX_RATIO_STRAIGHT


def has_straight_cells(mesh: Mesh) -> bool:
    """Return whether the edges of all cells, of all processes, are straight and faces bilinear."""
    element = mesh.ufl_domain().ufl_coordinate_element()
    if element.degree == 1:
        return True
    cell = element.cell_type
    linear = basix.create_element(basix.ElementFamily.P, cell, 1)
    points = element.basix_element.points
    weights = linear.tabulate(0, points)[0, :, :, 0]
    x = mesh.geometry.x[cell_nodes(mesh)]
    vertices = x[:, : weights.shape[1]]  # come first among the nodes of a cell
    off = np.abs(x - np.einsum("nv,cvi->cni", weights, vertices)).max(initial=0.0)
    size = np.ptp(vertices, axis=1).max(initial=0.0)
    straight = off <= STRAIGHT_TOLERANCE * size
    return bool(mesh.comm.allreduce(straight, MPI.LAND))


def has_parallel_cells(mesh: Mesh) -> bool:
    """Return whether all quadrilaterals or hexahedra are parallelograms or parallelepipeds."""
    x = mesh.geometry.x[cell_nodes(mesh)][:, : 2**mesh.topology.dim]
    corners = x.shape[1]
    bits = np.arange(corners)[:, None] >> np.arange(corners.bit_length() - 1) & 1
    edges = x[:, 1 << np.arange(bits.shape[1])] - x[:, :1]
    off = np.abs(x - x[:, :1] - np.einsum("vk,cki->cvi", bits, edges)).max(initial=0.0)
    parallel = off <= PARALLEL_TOLERANCE * np.abs(edges).max(initial=0.0)
    return bool(mesh.comm.allreduce(parallel, MPI.LAND))


class TangentRatio:
    """Bulk over shear stiffness of a residual's tangent in each cell, at the present values of u.

    A change H F of the deformation gradient F, with a constant symmetric H in a cell, belongs to
    displacements H (x + u - c), where c is the cell's midpoint. Along exp(t H) F the cell's work
    has the second derivative with respect to t

        m(H) = dR(H (x + u - c); H (x + u - c)) + R(H^2 (x + u - c))

    with the residual R integrated over the cell. The second term ensures that a pressure makes
    motions that preserve the volume neither stiff nor soft. The bulk stiffness is m(I), the shear
    stiffness the mean of m over all H without trace. In linear elasticity the ratio is that of bulk
    and shear modulus.

    Args:
        form: residual (rank 1), of displacements alone.
        u: unknown function.

    Raises:
        ValueError: if the form of the measure cannot be compiled.
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

    def compute(self) -> Array:
        """Return the ratio (cells,) of this process' cells; 0 without positive shear stiffness."""
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
        m_volume = self._second_derivative(volume)  # dim lambda + 2 mu
        m_shear = np.mean([self._second_derivative(H) for H in shears], axis=0)  # 2 mu
        is_positive = m_shear > 0
        dim_lambda = np.where(is_positive, m_volume - m_shear, 0.0)
        two_mu = np.where(is_positive, m_shear, 1.0)
        return np.where(is_positive, 2 * dim_lambda / (dim * two_mu) + 2 / 3, 0.0)

    def _second_derivative(self, H: Array) -> Array:
        """Return m(H), (cells,), the second derivative of the work of each cell."""
        self._direction.value = H
        return np.array(fem.assemble_vector(self._work).array[self._numbers])


class TangentRatioMonitor:
    """Warns once when the tangent's bulk stiffness exceeds the limit of displacement elements.

    Args:
        form: residual, of displacements alone with piecewise-linear weights.
        u: unknown function.
    """

    def __init__(self, form: ufl.Form, u: fem.Function) -> None:
        self._mesh = u.function_space.mesh
        self._limit = max_bulk_over_shear(self._mesh)
        self._has_warned, self._ratio = False, None
        if np.isfinite(self._limit):
            try:
                self._ratio = TangentRatio(form, u)
            except Exception as error:
                words = f"bulk over shear stiffness of the tangent is not measured: {error}"
                log_on_root(self._mesh.comm, logging.INFO, words, ".contact")

    def is_beyond_limit(self) -> bool:
        """Return whether the tangent at u has too large a bulk stiffness; log it the first time."""
        if self._ratio is None:
            return False
        comm, ratio = self._mesh.comm, self._ratio.compute()
        largest = comm.allreduce(ratio.max(initial=0.0), MPI.MAX)
        if largest <= self._limit:
            return False
        if not self._has_warned:
            cells = np.flatnonzero(ratio > self._limit)
            local_midpoints = self._mesh.geometry.x[cell_nodes(self._mesh)[cells]].mean(axis=1)
            dim = self._mesh.geometry.dim
            midpoints = np.concatenate(comm.allgather(local_midpoints[:, :dim]))
            log_on_root(
                comm,
                logging.WARNING,
                f"the tangent's bulk stiffness is up to {largest:.3g} times its shear stiffness, "
                f"in {len(midpoints)} cells, first around {format_points(midpoints[:3])}, more "
                f"than {self._limit:g} times. With displacements and piecewise-linear weights on "
                f"such cells {HYBRID_SPACES_REMEDY}. "
                "Signs of determinants do not tell instability there",
                ".contact",
            )
            self._has_warned = True
        return True

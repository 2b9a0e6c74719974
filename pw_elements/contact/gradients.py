"""Largest strain and rotation in a field of displacements."""

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, la

from pw_elements._compat import cell_nodes

Array = npt.NDArray[np.float64]

# Cells at a time
_CHUNK = 4_000


class Gradients:
    """Gradients of displacements at the vertices of all cells, and within where they curve.

    On straight simplices with quadratic displacements they are linear, and the norms of their
    parts are largest at vertices. Elsewhere quadrature points of degree 4 are taken, too.
    """

    def __init__(self, space: fem.FunctionSpace) -> None:
        self._space, mesh = space, space.mesh
        shape = mesh.ufl_domain().ufl_coordinate_element().basix_element
        element = space.element.basix_element
        points = basix.geometry(shape.cell_type)
        straight = shape.degree == 1 and len(points) == len(points[0]) + 1
        if not (straight and element.family is basix.ElementFamily.P and element.degree <= 2):
            points = np.vstack([points, basix.make_quadrature(shape.cell_type, 4)[0]])
        self._dim = mesh.geometry.dim
        self._slopes = self._rows(element.tabulate(1, points))
        self._shape_slopes = self._rows(shape.tabulate(1, points[:1] if straight else points))
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        self._nodes, self._places = space.dofmap.list[:owned], cell_nodes(mesh)[:owned]

    def largest(self, displacement: PETSc.Vec) -> tuple[float, float]:
        """Largest spectral norms of the symmetric and the antisymmetric part, of all processes.

        The latter is the largest angle of rotation in radians. Hoop strains are left out: whether
        the body is one of revolution is not known here.
        """
        moved = with_ghosts(self._space, displacement)
        strain, rotation = 0.0, 0.0
        for first in range(0, len(self._nodes), _CHUNK):
            cells = slice(first, first + _CHUNK)
            gradient = self._gradient(moved, cells)
            strain = _largest_symmetric(gradient, strain)
            skew = (gradient - np.swapaxes(gradient, 1, 2)) / 2
            # two entries for each component of the axial vector, whose length is the norm
            squares = np.einsum("pij,pij->p", skew, skew) / 2
            rotation = max(rotation, float(np.sqrt(squares.max(initial=0.0))))
        comm = self._space.mesh.comm
        return comm.allreduce(strain, MPI.MAX), comm.allreduce(rotation, MPI.MAX)

    def _gradient(self, moved: Array, cells: slice) -> Array:
        """(cells points, dim, dim), du_i/dx_k."""
        dim, x = self._dim, self._space.mesh.geometry.x[self._places[cells]][:, :, : self._dim]
        u = moved[self._nodes[cells]]
        # (cells, points, reference direction, component)
        du, dx = (
            (slopes @ values).reshape(len(u), -1, dim, dim)
            for slopes, values in ((self._slopes, u), (self._shape_slopes, x))
        )
        return np.swapaxes(np.linalg.inv(dx) @ du, 2, 3).reshape(-1, dim, dim)

    @staticmethod
    def _rows(tabulated: Array) -> Array:
        """Derivatives (points dim, nodes) of a table (1 + dim, points, nodes, 1)."""
        slopes = tabulated[1:, :, :, 0].swapaxes(0, 1)
        return np.ascontiguousarray(slopes.reshape(-1, slopes.shape[2]))


def _largest_symmetric(gradient: Array, least: float) -> float:
    """Largest spectral norm of the symmetric parts of (n, dim, dim), and of a number."""
    symmetric = (gradient + np.swapaxes(gradient, 1, 2)) / 2
    frobenius = np.sqrt(np.einsum("pij,pij->p", symmetric, symmetric))
    # the norm lies between this and this over sqrt(dim): few are to be looked at
    least = max(least, float(frobenius.max(initial=0.0)) / np.sqrt(gradient.shape[1]))
    values = np.linalg.eigvalsh(symmetric[frobenius >= least])
    return float(np.abs(values).max(initial=least))


def with_ghosts(space: fem.FunctionSpace, values: PETSc.Vec) -> Array:
    """Values (local nodes, dim) of a vector (n,), those of ghosts too."""
    u = la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)
    u.array[: values.getLocalSize()] = values.array_r
    u.scatter_forward()
    return np.asarray(u.array.reshape(-1, space.dofmap.index_map_bs).copy())

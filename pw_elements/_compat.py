"""What DOLFINx 0.9 and its successors name differently, and what petsc4py lacks."""

from ctypes import CDLL, byref, c_int64

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements.arrays import Array, LocalIndices

__all__ = ["cell_nodes", "interpolation_points", "is_petsc_option_used", "single_entry_matrix"]


def cell_nodes(mesh: Mesh) -> LocalIndices:
    """Numbers (cells, nodes) of the geometry's nodes in each cell, ghosts included."""
    geometry = mesh.geometry
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap


def interpolation_points(space: fem.FunctionSpace) -> Array:
    """Points (n, dim) of the reference cell at which functions of the space are interpolated."""
    points = space.element.interpolation_points
    return points() if callable(points) else points


def is_petsc_option_used(name: str) -> bool:
    """Whether PETSc has asked for an option, by its name with prefix; petsc4py does not tell."""
    used = c_int64(0)  # a PetscBool is shorter
    CDLL(PETSc.__file__).PetscOptionsUsed(None, name.encode(), byref(used))
    return bool(used.value)


def single_entry_matrix(
    columns: npt.NDArray[np.integer],
    sizes: tuple[tuple[int, int], tuple[int, int]],
    comm: MPI.Comm | PETSc.Comm,
    values: Array | float = 1.0,
) -> PETSc.Mat:
    """Matrix whose rows here have one entry each, at a global column; none where that is -1."""
    stated = columns >= 0
    pointers = np.concatenate([[0], np.cumsum(stated)]).astype(PETSc.IntType)
    values = np.broadcast_to(values, columns.shape)[stated]
    csr = (pointers, columns[stated].astype(PETSc.IntType), values)
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)

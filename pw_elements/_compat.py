"""Bridge the differences between DOLFINx versions, and add functions that petsc4py lacks."""

from collections.abc import Sequence
from ctypes import CDLL, byref, c_int64
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.common import IndexMap
from dolfinx.mesh import Mesh

from pw_elements.arrays import Array, LocalIndices

__all__ = [
    "cell_geometry_nodes",
    "create_form_from_cell_kernels",
    "interpolation_points",
    "is_petsc_option_used",
    "make_index_map",
    "matrix_with_single_entry_rows",
]

# Tag of messages by which DOLFINx 0.11 sets up an index map
_INDEX_MAP_MESSAGE_TAG = 58


def cell_geometry_nodes(mesh: Mesh) -> LocalIndices:
    """Return the geometry nodes (cells, nodes per cell) of all local cells, including ghosts."""
    geometry = mesh.geometry
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap


def interpolation_points(space: fem.FunctionSpace) -> Array:
    """Return the interpolation points (n, dim) of a space in the reference cell."""
    points = space.element.interpolation_points
    return points() if callable(points) else points


def is_petsc_option_used(name: str) -> bool:
    """Return whether PETSc has read an option; `name` is its full name with the prefix."""
    is_used = c_int64(0)  # large enough for PetscBool
    CDLL(PETSc.__file__).PetscOptionsUsed(None, name.encode(), byref(is_used))
    return bool(is_used.value)


def matrix_with_single_entry_rows(
    columns: npt.NDArray[np.integer],
    sizes: tuple[tuple[int, int], tuple[int, int]],
    comm: MPI.Comm | PETSc.Comm,
    values: Array | float = 1.0,
) -> PETSc.Mat:
    """Create a distributed matrix with at most one entry in each row.

    Args:
        columns: global column (n,) of the entry in each row of this process; -1 for an empty row.
        sizes: local and global number of rows, then local and global number of columns.
        comm: communicator of the matrix.
        values: entries (n,) of the rows, or one value for all rows.
    """
    has_entry = columns >= 0
    pointers = np.concatenate([[0], np.cumsum(has_entry)]).astype(PETSc.IntType)
    values = np.broadcast_to(values, columns.shape)[has_entry]
    csr = (pointers, columns[has_entry].astype(PETSc.IntType), values)
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)


def create_form_from_cell_kernels(
    spaces: Sequence[fem.FunctionSpace],
    kernels: Sequence[tuple[int, LocalIndices, npt.NDArray[np.int8]]],
    coefficients: Sequence[fem.Function],
    constants: Sequence[fem.Constant],
) -> Any:  # noqa: ANN401
    """Create DOLFINx's C++ object of a form whose cell integrals are compiled functions.

    Args:
        spaces: spaces of the form's arguments.
        kernels: for each integral, the address of its function, the cells, and the numbers of the
            coefficients that the function reads.
        coefficients: coefficients of the form. A function finds their values one after the other.
        constants: constants of the form, likewise.
    """
    integrals = [(number, *kernel) for number, kernel in enumerate(kernels)]
    mesh = spaces[0].mesh
    return fem.form_cpp_class(np.float64)(
        [space._cpp_object for space in spaces],
        {fem.IntegralType.cell: integrals},
        [function._cpp_object for function in coefficients],
        [constant._cpp_object for constant in constants],
        False,  # integrals over interior facets would need permutations
        {} if dolfinx.__version__.startswith("0.9.") else [],  # maps between meshes
        mesh._cpp_object,
    )


def make_index_map(
    comm: MPI.Comm,
    n_owned: int,
    ghosts: npt.NDArray[np.int64],
    owners: npt.NDArray[np.int32],
) -> IndexMap:
    """Create the index map of n_owned nodes on this process and of ghosts; collective.

    Args:
        comm: communicator of the processes.
        n_owned: number of nodes that this process owns.
        ghosts: global numbers (k,) of the ghosts.
        owners: processes (k,) that own the ghosts.
    """
    tag = () if dolfinx.__version__.startswith("0.9.") else (_INDEX_MAP_MESSAGE_TAG,)
    return IndexMap(comm, n_owned, ghosts, owners, *tag)

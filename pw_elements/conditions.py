"""Dirichlet conditions: what they prescribe, once they are known to agree."""

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements import arguments
from pw_elements.collective import collective
from pw_elements.hybrid import fields_of, positions
from pw_elements.mesh_checks import listed

# Largest difference of values that are prescribed as the same, over the largest of them
_SAME_VALUE = 1e-9


def prescribed(
    space: fem.FunctionSpace, conditions: fem.DirichletBC | Sequence[fem.DirichletBC]
) -> tuple[npt.NDArray[np.bool_], PETSc.Vec]:
    """Which owned degrees of freedom are free, and the prescribed values (zero where free).

    Raises:
        TypeError: for anything but a space and conditions.
        ValueError: if a prescribed value is not finite, two of them contradict each other, or a
            condition is another space's.
    """
    arguments.space(space)
    each = [conditions] if isinstance(conditions, fem.DirichletBC) else conditions
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    owned, comm = index_map.size_local * block, space.mesh.comm
    values = np.zeros(owned + index_map.num_ghosts * block)
    free = np.ones(owned, dtype=bool)
    difference = np.zeros(owned)
    with collective(comm):
        arguments.of_type("the list of conditions", each, Sequence, "`prescribe` makes its items")
        for condition in each:
            _check_condition(condition, space)
            own = np.zeros(len(values))
            condition.set(own)
            dofs = condition.dof_indices()[0]  # the number of owned ones is wrong in DOLFINx 0.9
            dofs = dofs[dofs < owned]
            again = dofs[~free[dofs]]
            difference[again] = np.maximum(difference[again], np.abs(own - values)[again])
            free[dofs] = False
            values[dofs] = own[dofs]
        if not np.isfinite(values[:owned]).all():
            raise ValueError("a prescribed value is not a finite number")
    size = np.zeros(owned)
    for field in fields_of(space):
        largest = np.abs(values[field.owned]).max(initial=0.0)
        size[field.owned] = comm.allreduce(largest, MPI.MAX)
    twice = np.flatnonzero(difference > _SAME_VALUE * size)
    if comm.allreduce(len(twice), MPI.SUM):
        x = positions(space)[twice, : space.mesh.geometry.dim]
        places = np.unique(np.concatenate(comm.allgather(x)), axis=0)
        raise ValueError(
            f"Dirichlet conditions contradict each other at {listed(places)}: a degree of freedom "
            "can have one value"
        )
    offset = PETSc.Vec().createMPI((owned, index_map.size_global * block), comm=comm)
    offset.setArray(values[:owned])
    return free, offset


def _check_condition(condition: fem.DirichletBC, space: fem.FunctionSpace) -> None:
    """Raises ValueError for a condition on another mesh, or on a space with other nodes; local."""
    arguments.of_type("a condition", condition, fem.DirichletBC, "`prescribe` makes one")
    theirs = condition.function_space
    other, own = theirs.dofmap.index_map, space.dofmap.index_map
    same_nodes = (other.size_global, other.size_local) == (own.size_global, own.size_local)
    if theirs.mesh is not space.mesh._cpp_object or not same_nodes:
        raise ValueError(
            "a Dirichlet condition was made on another space: its degrees of freedom would be "
            "taken for others here; make it on the trial space"
        )


def check_any(chosen: npt.NDArray[np.bool_], space: fem.FunctionSpace, otherwise: str) -> None:
    """Raises ValueError if no degree of freedom of any process is chosen."""
    if space.mesh.comm.allreduce(int(chosen.sum()), MPI.SUM) == 0:
        raise ValueError(otherwise)

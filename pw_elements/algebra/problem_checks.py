"""Checks of a problem's matrices, vectors and settings, made once before any computation.

Matrices and vectors from `assemble_matrix` and `assemble_vector` carry a record of the spaces of
their form (see `AssemblyRecord`). They are refused if their meshes or weight functions differ.
Matrices and vectors that were created in other ways have no record; only their sizes are checked.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.checks import JoinedSpace, arguments, raise_errors_on_all_processes
from pw_elements.spaces import AssemblyRecord, SubSpace, read_record

_STIFFNESS_NAME_IN_MESSAGES = "the stiffness"
_FROBENIUS_NORM_TYPE, _INFINITY_NORM_TYPE = PETSc.NormType.FROBENIUS, PETSc.NormType.INFINITY
# If a row sum of a matrix is larger, the sum of squares of its finite entries may overflow
_ROW_SUM_WHOSE_SQUARE_MAY_OVERFLOW = 1e100


def check_problem(
    matrices: Mapping[str, PETSc.Mat],
    vectors: Mapping[str, PETSc.Vec] | None = None,
    loads: Mapping[str, PETSc.Vec] | None = None,
    reductions: Sequence[Any] = (),
    space: fem.FunctionSpace | None = None,
    solver: object = None,
) -> None:
    """Check that matrices (n, n), vectors (n,), reductions, space and solver fit together.

    Args:
        matrices: matrices by their names in error messages; the first one is the stiffness.
        vectors: vectors of unknowns, such as displacements, by name.
        loads: load vectors by name; their weight functions must be those of the stiffness.
        reductions: reductions of the stiffness.
        space: trial space.
        solver: a `LinearSolver`, "auto" or None.

    Raises:
        TypeError: on all processes, for arguments of the wrong type.
        ValueError: on all processes, for all other errors.
    """
    loads = loads or {}
    all_vectors = {**(vectors or {}), **loads}
    K_name, K = next(iter(matrices.items()))
    comm = arguments.find_largest_communicator(
        *all_vectors.values(), *matrices.values(), *reductions, space
    )
    with raise_errors_on_all_processes(comm):
        for name, matrix in matrices.items():
            arguments.check_assembled_square_matrix(name, matrix)
        for name, vector in all_vectors.items():
            arguments.check_petsc_vector(name, vector)
        check_solver_type(solver)
        tensors, spaces, K_record = {**matrices, **all_vectors}, {}, read_record(K)
        for reduction in reductions:
            check_reduction_type(reduction)
            tensors["the reduction"], spaces["the reduction"] = reduction.offset, reduction.space
        for name, tensor in tensors.items():
            processes = MPI.Comm.Compare(tensor.comm.tompi4py(), K.comm.tompi4py())
            if processes not in (MPI.IDENT, MPI.CONGRUENT):
                raise ValueError(f"{name} lives on other processes than {K_name}")
            sizes = tensor.getSizes()[0] if name in matrices else tensor.getSizes()
            arguments.check_equal_vector_sizes(name, sizes, K_name, K.getSizes()[0])
            _check_same_mesh(name, read_record(tensor).mesh, K_record)
        if space is not None:
            arguments.check_function_space(space)
            arguments.check_equal_vector_sizes(K_name, K.getSizes()[0], "the space", space)
            spaces["the space"] = space
        for name, V in spaces.items():
            has_one_mesh = V is not None and not isinstance(V, JoinedSpace)
            _check_same_mesh(name, V.mesh._cpp_object if has_one_mesh else None, K_record)
        for name, tensor in {**matrices, **loads}.items():
            _check_same_weights_and_stress_state(name, read_record(tensor), K_record)
    for name, matrix in matrices.items():
        # a sum of squares is NaN if any process has a NaN, which a maximum may lose
        frobenius, largest_sum = (
            matrix.norm(kind) for kind in (_FROBENIUS_NORM_TYPE, _INFINITY_NORM_TYPE)
        )
        if (
            not np.isfinite(frobenius)
            and not _ROW_SUM_WHOSE_SQUARE_MAY_OVERFLOW < largest_sum < np.inf
        ):
            raise ValueError(f"{name} has entries that are not finite")
        arguments.check_magnitude(name, largest_sum)
    for name, vector in all_vectors.items():
        if not is_finite(vector):
            raise ValueError(f"{name} is not finite")
        arguments.check_magnitude(name, vector.norm(_INFINITY_NORM_TYPE))


def check_load(name: str, load: PETSc.Vec, K: PETSc.Mat) -> None:
    """Raise an error unless a load is a finite vector (n,) and belongs to the matrix K (n, n).

    Load and matrix have to be assembled with the same weight functions.

    Args:
        name: name of the load in error messages.
        load: load vector (n,).
        K: stiffness (n, n).
    """
    with raise_errors_on_all_processes(K.comm.tompi4py()):
        arguments.check_petsc_vector(name, load, _STIFFNESS_NAME_IN_MESSAGES, K.getSizes()[0])
        record, K_record = read_record(load), read_record(K)
        _check_same_mesh(name, record.mesh, K_record)
        _check_same_weights_and_stress_state(name, record, K_record)
    if not is_finite(load):
        raise ValueError(f"{name} is not finite")
    arguments.check_magnitude(name, load.norm(_INFINITY_NORM_TYPE))


def _check_same_mesh(name: str, mesh: Any, K_record: AssemblyRecord) -> None:  # noqa: ANN401
    if None not in (K_record.mesh, mesh) and mesh is not K_record.mesh:
        raise ValueError(
            f"{name} belongs to another mesh than {_STIFFNESS_NAME_IN_MESSAGES}: their nodes have "
            "other "
            "numbers, even where there are as many"
        )


def _check_same_weights_and_stress_state(
    name: str, record: AssemblyRecord, K_record: AssemblyRecord
) -> None:
    """Raise ValueError on this process if weight functions or stress states differ from K's."""
    states, K_states = record.stress_states, K_record.stress_states
    if states and K_states and states != K_states:
        state_names, K_state_names = (" and ".join(sorted(names)) for names in (states, K_states))
        raise ValueError(
            f"{name} is one in {state_names}, {_STIFFNESS_NAME_IN_MESSAGES} in {K_state_names}"
        )
    if K_record.form is None or K_record.test_space is None or record.test_space is None:
        return
    if (K_record.sibling is None) != (record.sibling is None):
        raise ValueError(
            f"one of {name} and {_STIFFNESS_NAME_IN_MESSAGES} belongs to the symmetric sibling, "
            "whose unknowns "
            "are coefficients: use Sibling.matrix and Sibling.load for both or for none"
        )
    test, trial = K_record.form.function_spaces
    if not _have_same_element(record.test_space, test):
        constructor = "galerkin" if _have_same_element(test, trial) else "petrov_galerkin"
        raise ValueError(
            f"{name} was made with other weight functions than {_STIFFNESS_NAME_IN_MESSAGES}: "
            "nodal forces "
            f"differ by some per cent; use the test space of Spaces.{constructor} in both"
        )


def _have_same_element(space: Any, other_space: Any) -> bool:  # noqa: ANN401
    """Return whether two C++ spaces have the same element.

    DOLFINx's own comparison does not work for mixed elements.
    """
    n_parts = space.element.num_sub_elements
    if n_parts != other_space.element.num_sub_elements:
        return False
    if n_parts == 0:
        return bool(space.element == other_space.element)
    return all(_have_same_element(space.sub([k]), other_space.sub([k])) for k in range(n_parts))


def check_reduction_type(reduction: object) -> None:
    parts = ("left", "right", "offset", "space")
    if isinstance(reduction, type) or not all(hasattr(reduction, part) for part in parts):
        conditions = isinstance(reduction, fem.DirichletBC | list | tuple)
        raise TypeError(
            "the reduction is "
            + (
                "Dirichlet conditions"
                if conditions
                else arguments.describe_value_or_type(reduction)
            )
            + ": make one by Reduction.dirichlet(space, conditions)"
        )


def check_solver_type(solver: object) -> None:
    if solver is None or arguments.is_one_of(solver, ("auto",)):
        return
    if isinstance(solver, type) or not callable(getattr(solver, "prepare", None)):
        raise TypeError(
            f"the solver is {arguments.describe_value_or_type(solver)}: give a LinearSolver such "
            "as Direct() or "
            'Iterative(), or "auto"'
        )


def is_finite(vector: PETSc.Vec) -> bool:
    """Return whether a vector is finite on all processes; its maximum norm might miss NaN."""
    is_local_part_finite = bool(np.isfinite(vector.array_r).all())
    return bool(vector.comm.tompi4py().allreduce(is_local_part_finite, MPI.LAND))


def refuse_negative_displacement_block_trace(
    name: str, matrix: PETSc.Mat, space: fem.FunctionSpace | None = None
) -> None:
    """Raise ValueError if the sum of the displacements' diagonal entries is negative.

    The sum is the trace of the displacement block, that is, the sum of its eigenvalues.

    Args:
        name: name of the matrix in the error message.
        matrix: square matrix (n, n).
        space: trial space, by which displacements are distinguished from pressures; None if there
            are no pressures.
    """
    diagonal = matrix.getDiagonal()
    if space is not None:
        diagonal = SubSpace.displacements(space).extract(diagonal)
    trace = diagonal.sum()
    if trace < 0:
        raise ValueError(
            f"the diagonal of {name} adds up to {trace:.3g}: a body's is positive; look at the "
            "sign of its form and its material"
        )

"""The problem that a solver is given, checked once before anything is computed.

Matrices and vectors that `assemble_matrix` and `assemble_vector` made know the spaces of their
form (see `Assembled`), so that what comes from different meshes or weight functions is told
apart; those that were made by hand know none and are judged by their sizes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.checks import arguments, collective_errors
from pw_elements.spaces import AssemblyRecord, SubSpace

_STIFFNESS = "the stiffness"
_FROBENIUS, _INFINITY = PETSc.NormType.FROBENIUS, PETSc.NormType.INFINITY
_LARGEST = 1e100  # of a sum in a row, whose square may be infinite


def check_problem(
    matrices: Mapping[str, PETSc.Mat],
    vectors: Mapping[str, PETSc.Vec] | None = None,
    loads: Mapping[str, PETSc.Vec] | None = None,
    reductions: Sequence[Any] = (),
    space: fem.FunctionSpace | None = None,
    solver: object = None,
) -> None:
    """Checks that matrices (n, n), vectors (n,), reduction, space and solver belong together.

    The first matrix is the stiffness; with its weight functions loads have to be made. Things of
    the wrong type are TypeErrors, all else ValueErrors, on all processes.
    """
    loads = loads or {}
    every = {**(vectors or {}), **loads}
    first, K = next(iter(matrices.items()))
    with collective_errors(
        arguments.find_communicator(*every.values(), *matrices.values(), *reductions, space)
    ):
        for name, matrix in matrices.items():
            arguments.check_matrix(name, matrix)
        for name, vector in every.items():
            arguments.check_petsc_vector(name, vector)
        check_solver(solver)
        things, spaces = {**matrices, **every}, {}
        for reduction in reductions:
            check_reduction(reduction)
            things["the reduction"], spaces["the reduction"] = reduction.offset, reduction.space
        for name, thing in things.items():
            processes = MPI.Comm.Compare(thing.comm.tompi4py(), K.comm.tompi4py())
            if processes not in (MPI.IDENT, MPI.CONGRUENT):
                raise ValueError(f"{name} lives on other processes than {first}")
            sizes = thing.getSizes()[0] if name in matrices else thing.getSizes()
            arguments.check_sizes(name, sizes, first, K.getSizes()[0])
            _check_mesh(name, AssemblyRecord.read(thing).mesh, K)
        if space is not None:
            arguments.check_space(space)
            arguments.check_sizes(first, K.getSizes()[0], "the space", space)
            spaces["the space"] = space
        for name, known in spaces.items():
            _check_mesh(name, None if known is None else known.mesh._cpp_object, K)
        for name, thing in {**matrices, **loads}.items():
            _check_likeness(name, thing, K)
    for name, matrix in matrices.items():
        # sums of squares keep NaN, on whichever process it is; largest values may lose it
        size, largest = (matrix.norm(kind) for kind in (_FROBENIUS, _INFINITY))
        if not np.isfinite(size) and not _LARGEST < largest < np.inf:
            raise ValueError(f"{name} has entries that are not finite")
        arguments.check_magnitude(name, largest)
    for name, vector in every.items():
        if not is_finite(vector):
            raise ValueError(f"{name} is not finite")
        arguments.check_magnitude(name, vector.norm(_INFINITY))


def check_load(name: str, load: PETSc.Vec, K: PETSc.Mat) -> None:
    """Raises unless a load is a finite vector (n,) made with the weight functions of K (n, n)."""
    with collective_errors(K.comm.tompi4py()):
        arguments.check_petsc_vector(name, load, _STIFFNESS, K.getSizes()[0])
        _check_mesh(name, AssemblyRecord.read(load).mesh, K)
        _check_likeness(name, load, K)
    if not is_finite(load):
        raise ValueError(f"{name} is not finite")
    arguments.check_magnitude(name, load.norm(_INFINITY))


def _check_mesh(name: str, mesh: Any, K: PETSc.Mat) -> None:  # noqa: ANN401
    known = AssemblyRecord.read(K).mesh
    if None not in (known, mesh) and mesh is not known:
        raise ValueError(
            f"{name} belongs to another mesh than {_STIFFNESS}: their nodes have other numbers, "
            "even where there are as many"
        )


def _check_likeness(name: str, thing: PETSc.Vec | PETSc.Mat, K: PETSc.Mat) -> None:
    """Raises ValueError unless weights and state of stress are those of K; local."""
    own, other = AssemblyRecord.read(K), AssemblyRecord.read(thing)
    if own.stress_states and other.stress_states and own.stress_states != other.stress_states:
        theirs, ours = (" and ".join(sorted(known.stress_states)) for known in (other, own))
        raise ValueError(f"{name} is one in {theirs}, {_STIFFNESS} in {ours}")
    if own.form is None or own.test_space is None or other.test_space is None:
        return
    if (own.sibling is None) != (other.sibling is None):
        raise ValueError(
            f"one of {name} and {_STIFFNESS} belongs to the symmetric sibling, whose unknowns are "
            "coefficients: use Sibling.matrix and Sibling.load for both or for none"
        )
    test, trial = own.form.function_spaces
    if not _same_element(other.test_space, test):
        standard = "galerkin" if _same_element(test, trial) else "petrov_galerkin"
        raise ValueError(
            f"{name} was made with other weight functions than {_STIFFNESS}: nodal forces differ "
            f"by some per cent; use the test space of Spaces.{standard} in both"
        )


def _same_element(one: Any, other: Any) -> bool:  # noqa: ANN401
    """Whether two C++ spaces have one element; DOLFINx compares no mixed ones."""
    parts = one.element.num_sub_elements
    if parts != other.element.num_sub_elements:
        return False
    if parts == 0:
        return bool(one.element == other.element)
    return all(_same_element(one.sub([k]), other.sub([k])) for k in range(parts))


def check_reduction(reduction: object) -> None:
    parts = ("left", "right", "offset", "space")
    if isinstance(reduction, type) or not all(hasattr(reduction, part) for part in parts):
        conditions = isinstance(reduction, fem.DirichletBC | list | tuple)
        raise TypeError(
            "the reduction is "
            + ("Dirichlet conditions" if conditions else arguments.describe(reduction))
            + ": make one by Reduction.dirichlet(space, conditions)"
        )


def check_solver(solver: object) -> None:
    if solver is None or arguments.is_one_of(solver, ("auto",)):
        return
    if isinstance(solver, type) or not callable(getattr(solver, "prepare", None)):
        raise TypeError(
            f"the solver is {arguments.describe(solver)}: give a LinearSolver such as Direct() or "
            'Iterative(), or "auto"'
        )


def is_finite(vector: PETSc.Vec) -> bool:
    """Whether all entries on all processes are finite: a norm's maximum may pass over NaN."""
    own = bool(np.isfinite(vector.array_r).all())
    return bool(vector.comm.tompi4py().allreduce(own, MPI.LAND))


def refuse_negative_trace(
    name: str, matrix: PETSc.Mat, space: fem.FunctionSpace | None = None
) -> None:
    """Refuses a diagonal, and so eigenvalues, of negative sum; displacements alone count."""
    diagonal = matrix.getDiagonal()
    if space is not None:
        diagonal = SubSpace.displacements(space).extract(diagonal)
    trace = diagonal.sum()
    if trace < 0:
        raise ValueError(
            f"the diagonal of {name} adds up to {trace:.3g}: a body's is positive; look at the "
            "sign of its form and its material"
        )

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

from pw_elements.checks import arguments, collective
from pw_elements.spaces import Assembled, SubSpace


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
    stiffness, K = next(iter(matrices.items()))
    with collective(arguments.processes(*every.values(), *matrices.values(), *reductions, space)):
        for name, matrix in matrices.items():
            arguments.matrix(name, matrix)
        for name, vector in every.items():
            arguments.petsc_vector(name, vector)
        if space is not None:
            arguments.space(space)
        for reduction in reductions:
            check_reduction(reduction)
        check_solver(solver)
        things = {**matrices, **every}
        spaces = {"the space": space}
        for reduction in reductions:
            things["the reduction"], spaces["the reduction"] = reduction.offset, reduction.space
        _check_sizes(things, space)
        _check_meshes(things, spaces)
        for name, load in loads.items():
            check_load(name, load, stiffness, K)
    for name, matrix in matrices.items():
        # sums of squares keep NaN, on whichever process it is; largest values may lose it
        if not np.isfinite(matrix.norm(PETSc.NormType.FROBENIUS)):
            raise ValueError(f"{name} has entries that are not finite")
    for name, vector in every.items():
        if not is_finite(vector):
            raise ValueError(f"{name} is not finite")
    for reduction in reductions:
        if not is_finite(reduction.offset):
            raise ValueError("a prescribed value is not finite")


def _check_sizes(
    things: Mapping[str, PETSc.Mat | PETSc.Vec], space: fem.FunctionSpace | None
) -> None:
    """Raises ValueError unless all have the processes and the rows of the first, a matrix."""
    (first, K), *others = things.items()
    comm, sizes = K.comm.tompi4py(), K.getSizes()[0]
    for name, thing in others:
        if MPI.Comm.Compare(thing.comm.tompi4py(), comm) not in (MPI.IDENT, MPI.CONGRUENT):
            raise ValueError(f"{name} lives on other processes than {first}")
        found = thing.getSizes()
        arguments.same_sizes(
            name, found[0] if isinstance(thing, PETSc.Mat) else found, first, sizes
        )
    if space is not None:
        arguments.same_sizes(first, sizes, "the space", space)


def _check_meshes(
    things: Mapping[str, PETSc.Mat | PETSc.Vec], spaces: Mapping[str, fem.FunctionSpace | None]
) -> None:
    known: dict[str, object] = {name: Assembled.of(thing).mesh for name, thing in things.items()}
    known |= {name: space.mesh._cpp_object for name, space in spaces.items() if space is not None}
    known = {name: mesh for name, mesh in known.items() if mesh is not None}
    for name, mesh in known.items():
        first = next(iter(known))
        if mesh is not known[first]:
            raise ValueError(
                f"{name} belongs to another mesh than {first}: their nodes have other numbers, "
                "even where there are as many"
            )


def check_load(name: str, load: PETSc.Vec, stiffness: str, K: PETSc.Mat) -> None:
    """Raises unless a load is a vector (n,) made with the weight functions of K (n, n); local."""
    arguments.petsc_vector(name, load)
    arguments.same_sizes(name, load.getSizes(), stiffness, K.getSizes()[0])
    check_weights(name, load, stiffness, K)


def check_weights(name: str, thing: PETSc.Vec | PETSc.Mat, stiffness: str, K: PETSc.Mat) -> None:
    """Raises ValueError unless a load or matrix has the mesh and weight functions of K; local."""
    own, other = Assembled.of(K), Assembled.of(thing)
    if own.form is None or other.form is None:
        return
    if (own.sibling is None) != (other.sibling is None):
        raise ValueError(
            f"one of {name} and {stiffness} belongs to the symmetric sibling, whose unknowns are "
            "coefficients: use Sibling.matrix and Sibling.load for both or for none"
        )
    (test, trial), theirs = own.form.function_spaces, other.weights
    if theirs.mesh is not test.mesh:
        raise ValueError(f"{name} belongs to another mesh than {stiffness}")
    if not _same_element(theirs, test):
        standard = _same_element(test, trial)
        raise ValueError(
            f"{name} was made with other weight functions than {stiffness}: nodal forces differ by "
            "some per cent; use the test space of "
            + ("Spaces.galerkin" if standard else "Spaces.petrov_galerkin")
            + " in both"
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
            + ("Dirichlet conditions" if conditions else arguments.described(reduction))
            + ": make one by Reduction.dirichlet(space, conditions)"
        )


def check_solver(solver: object) -> None:
    if solver is None or solver == "auto":
        return
    if isinstance(solver, type) or not callable(getattr(solver, "prepare", None)):
        raise TypeError(
            f"the solver is {arguments.described(solver)}: give a LinearSolver such as Direct() or "
            'Iterative(), or "auto"'
        )


def is_finite(vector: PETSc.Vec) -> bool:
    """Whether all entries on all processes are finite: a norm's maximum may pass over NaN."""
    own = bool(np.isfinite(vector.array_r).all())
    return bool(vector.comm.tompi4py().allreduce(own, MPI.LAND))


def refuse_negative(name: str, matrix: PETSc.Mat, space: fem.FunctionSpace | None = None) -> None:
    """Refuses a diagonal, and so eigenvalues, of negative sum; displacements alone count."""
    diagonal = matrix.getDiagonal()
    if space is not None:
        diagonal = SubSpace.displacements(space).part(diagonal)
    trace = diagonal.sum()
    if trace < 0:
        raise ValueError(
            f"the diagonal of {name} adds up to {trace:.3g}: a body's is positive; look at the "
            "sign of its form and its material"
        )

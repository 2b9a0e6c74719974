"""The problem that a solver is given, checked once before anything is computed.

Matrices and vectors that `assemble_matrix` and `assemble_vector` made know the spaces of their
form (attribute "form"), so that what comes from different meshes or weight functions is told
apart; those that were made by hand know none and are judged by their sizes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.checks import arguments, collective
from pw_elements.solvers import LinearSolver
from pw_elements.spaces import SubSpace


@runtime_checkable
class Reduced(Protocol):
    """What a problem asks of its `Reduction`."""

    @property
    def left(self) -> PETSc.Mat:
        """L, (n, n_r)."""
        ...

    @property
    def right(self) -> PETSc.Mat:
        """R, (n, n_r)."""
        ...

    @property
    def offset(self) -> PETSc.Vec:
        """a_0, (n,)."""
        ...

    @property
    def space(self) -> fem.FunctionSpace | None:
        """Trial space, if it is known."""
        ...


@dataclass(frozen=True)
class Problem:
    """Matrices (n, n), vectors (n,), reduction, space and solver that belong together.

    Args:
        matrices: by their names in messages; the first one is the stiffness.
        vectors: by their names.
        loads: vectors which have to be made with the weight functions of the first matrix.
        reductions: supports, one or none.
        space: trial space; None where it is not given.
        solver: of linear systems; None for the default.

    Raises:
        TypeError: on all processes, for a thing of the wrong type.
        ValueError: on all processes, for a matrix that is not square, not assembled or not
            finite, sizes, meshes or spaces that do not go together, a load of other weight
            functions, or vectors that are not finite.
    """

    matrices: Mapping[str, PETSc.Mat]
    vectors: Mapping[str, PETSc.Vec] = field(default_factory=dict)
    loads: Mapping[str, PETSc.Vec] = field(default_factory=dict)
    reductions: Sequence[Reduced] = ()
    space: fem.FunctionSpace | None = None
    solver: LinearSolver | Literal["auto"] | None = None

    def __post_init__(self) -> None:
        everything = [*self._vectors.values(), *self.matrices.values()]
        with collective(arguments.processes(*everything, *self.reductions, self.space)):
            self._check_types()
            self._check_sizes()
            self._check_meshes()
            stiffness, K = next(iter(self.matrices.items()))
            for name, load in self.loads.items():
                check_load(name, load, stiffness, K)
        for name, matrix in self.matrices.items():
            # sums of squares keep NaN, on whichever process it is; largest values may lose it
            if not np.isfinite(matrix.norm(PETSc.NormType.FROBENIUS)):
                raise ValueError(f"{name} has entries that are not finite")
        for name, vector in self._vectors.items():
            if not is_finite(vector):
                raise ValueError(f"{name} is not finite")
        for reduction in self.reductions:
            if not is_finite(reduction.offset):
                raise ValueError("a prescribed value is not finite")

    @property
    def _vectors(self) -> dict[str, PETSc.Vec]:
        return {**self.vectors, **self.loads}

    def _check_types(self) -> None:
        for name, matrix in self.matrices.items():
            arguments.matrix(name, matrix)
        for name, vector in self._vectors.items():
            arguments.petsc_vector(name, vector)
        if self.space is not None:
            arguments.space(self.space)
        for reduction in self.reductions:
            check_reduction(reduction)
        check_solver(self.solver)

    def _check_sizes(self) -> None:
        (first, K), *others = self.matrices.items()
        comm, sizes = K.comm.tompi4py(), K.getSizes()[0]
        parts = [
            *((name, M.comm, M.getSizes()[0]) for name, M in others),
            *((name, v.comm, v.getSizes()) for name, v in self._vectors.items()),
            *(("the reduction", r.offset.comm, r.offset.getSizes()) for r in self.reductions),
        ]
        for name, theirs, found in parts:
            if MPI.Comm.Compare(theirs.tompi4py(), comm) not in (MPI.IDENT, MPI.CONGRUENT):
                raise ValueError(f"{name} lives on other processes than {first}")
            arguments.same_sizes(name, found, first, sizes)
        if self.space is not None:
            arguments.same_sizes(first, sizes, "the space", self.space)

    def _check_meshes(self) -> None:
        known: dict[str, object] = {
            name: form_mesh(thing) for name, thing in {**self.matrices, **self._vectors}.items()
        }
        if self.space is not None:
            known["the space"] = self.space.mesh._cpp_object
        for reduction in self.reductions:
            if reduction.space is not None:
                known["the reduction"] = reduction.space.mesh._cpp_object
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
    own, other = K.getAttr("form"), thing.getAttr("form")
    if own is None or other is None:
        return
    if (K.getAttr("sibling") is None) != (thing.getAttr("sibling") is None):
        raise ValueError(
            f"one of {name} and {stiffness} belongs to the symmetric sibling, whose unknowns are "
            "coefficients: use Sibling.matrix and Sibling.load for both or for none"
        )
    (test, trial), theirs = own.function_spaces, other.function_spaces[0]
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
    """Raises unless it is a `Reduction` of matrices and a vector that fit; local."""
    if not isinstance(reduction, Reduced) or isinstance(reduction, type):
        conditions = isinstance(reduction, fem.DirichletBC | list | tuple)
        raise TypeError(
            "the reduction is "
            + ("Dirichlet conditions" if conditions else arguments.described(reduction))
            + ": make one by Reduction.dirichlet(space, conditions)"
        )


def check_solver(solver: object) -> None:
    """Raises TypeError unless it is a `LinearSolver`, "auto" or None; local."""
    if solver is None or solver == "auto":
        return
    if isinstance(solver, type) or not callable(getattr(solver, "prepare", None)):
        raise TypeError(
            f"the solver is {arguments.described(solver)}: give a LinearSolver such as Direct() or "
            'Iterative(), or "auto"'
        )


def form_mesh(thing: PETSc.Mat | PETSc.Vec) -> object:
    """Mesh of the form that a matrix or vector was assembled from, None if it is not known."""
    form = thing.getAttr("form")
    return None if form is None else form.function_spaces[0].mesh


def is_finite(vector: PETSc.Vec) -> bool:
    """Whether all entries on all processes are finite: a norm's maximum may pass over NaN."""
    own = bool(np.isfinite(vector.array_r).all())
    return bool(vector.comm.tompi4py().allreduce(own, MPI.LAND))


def refuse_negative(name: str, matrix: PETSc.Mat, space: fem.FunctionSpace | None = None) -> None:
    """Raises ValueError if the sum of a matrix's diagonal, that of its eigenvalues, is negative.

    Displacements alone count where the space has a pressure, too.
    """
    diagonal = matrix.getDiagonal()
    if space is not None:
        diagonal = SubSpace.displacements(space).part(diagonal)
    trace = diagonal.sum()
    if trace < 0:
        raise ValueError(
            f"the diagonal of {name} adds up to {trace:.3g}: a body's is positive; look at the "
            "sign of its form and its material"
        )

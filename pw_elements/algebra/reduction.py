"""Supports and static condensation: the reduction L^T K R of a free system.

Condensed inner nodes may not be coupled to each other, and each needs a stiffness; Dirichlet
conditions that overlap have to prescribe the same values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_type_hints

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.algebra.problem_checks import check_problem
from pw_elements.arrays import Mask
from pw_elements.checks import arguments, check_same_arguments, collective_errors, format_points
from pw_elements.solvers import (
    NO_SUPPORTS_MESSAGE,
    ConstrainedOperator,
    ConstraintProjection,
    SingularSystem,
    Supports,
    add_scaled,
    block_diagonal_matrix,
    diagonal_blocks,
    python_matrix,
    selection_matrix,
    to_aij,
)
from pw_elements.spaces import (
    AssemblyRecord,
    Spaces,
    equilibration_scale,
    has_split_pressure,
    is_hybrid,
    list_fields,
    local_numbers,
    tie_pressures,
)

# Largest difference of values that are prescribed as the same, over the largest of them
_SAME_VALUE = 1e-9

# Entries of a matrix below this, over its largest, are zeros
_ZERO_ENTRY = 1e-13


def evaluate_conditions(
    space: fem.FunctionSpace, conditions: fem.DirichletBC | Sequence[fem.DirichletBC]
) -> tuple[Mask, PETSc.Vec]:
    """Which owned degrees of freedom are free, and the prescribed values (zero where free)."""
    arguments.check_space(space)
    each = [conditions] if isinstance(conditions, fem.DirichletBC) else conditions
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    owned, comm = index_map.size_local * block, space.mesh.comm
    values = np.zeros(owned + index_map.num_ghosts * block)
    free = np.ones(owned, dtype=bool)
    difference = np.zeros(owned)
    with collective_errors(comm):
        arguments.check_type(
            "the list of conditions", each, Sequence, "`prescribe` makes its items"
        )
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
        size = np.abs(values[:owned]).max(initial=0.0)
        arguments.check_magnitude("the largest prescribed value", float(size), minimum=0.0)
    places = np.zeros((0, space.mesh.geometry.dim))
    for field in list_fields(space):
        largest = comm.allreduce(np.abs(values[field.owned_unknowns]).max(initial=0.0), MPI.MAX)
        twice = (difference[field.owned_unknowns] > _SAME_VALUE * largest).any(axis=1)
        if twice.any():
            x = field.space.tabulate_dof_coordinates()[: len(twice)][twice]
            places = np.vstack([places, x[:, : places.shape[1]]])
    places = np.unique(np.concatenate(comm.allgather(places)), axis=0)
    if len(places):
        raise ValueError(
            f"Dirichlet conditions contradict each other at {format_points(places)}: a degree of "
            "freedom can have one value"
        )
    offset = PETSc.Vec().createMPI((owned, index_map.size_global * block), comm=comm)
    offset.setArray(values[:owned])
    return free, offset


def _check_condition(condition: fem.DirichletBC, space: fem.FunctionSpace) -> None:
    arguments.check_type("a condition", condition, fem.DirichletBC, "`prescribe` makes one")
    theirs = condition.function_space
    other, own = theirs.dofmap.index_map, space.dofmap.index_map
    same_nodes = (other.size_global, other.size_local) == (own.size_global, own.size_local)
    if theirs.mesh is not space.mesh._cpp_object or not same_nodes:
        raise ValueError(
            "a Dirichlet condition was made on another space: its degrees of freedom would be "
            "taken for others here; make it on the trial space"
        )


def require_any_dof(chosen: Mask, space: fem.FunctionSpace, otherwise: str) -> None:
    if space.mesh.comm.allreduce(int(chosen.sum()), MPI.SUM) == 0:
        raise ValueError(otherwise)


def _inner_flexibility(K: PETSc.Mat, inner: Mask, block: int) -> PETSc.Mat:
    """Q (n, n): inverse of K_ii, whose blocks belong to one node each, and zeros."""
    chosen = selection_matrix(inner, K.createVecLeft())
    K_ii = chosen.transposeMatMult(K.matMult(chosen))
    (nodes, own), (sizes, _) = diagonal_blocks(K_ii, block), K_ii.getSizes()
    blocks = np.zeros((sizes[0] // block, block, block))
    blocks[nodes] = own
    largest = PETSc.NormType.INFINITY
    size = K_ii.norm(largest)
    add_scaled(K_ii, -1.0, block_diagonal_matrix(blocks, sizes, K.comm))
    coupled = K_ii.norm(largest) > _ZERO_ENTRY * size
    with collective_errors(K.comm.tompi4py()):
        if coupled:
            raise ValueError(
                "the stiffness couples nodes that are to be condensed: no two of them may share a "
                "cell"
            )
        if len(blocks) and not np.all(np.linalg.cond(blocks) < 1 / _ZERO_ENTRY):
            raise SingularSystem("a node that is to be condensed has no stiffness")
    inverse = block_diagonal_matrix(np.linalg.inv(blocks), sizes, K.comm)
    return chosen.matMult(inverse).matMult(chosen.transpose(PETSc.Mat()))


@dataclass(frozen=True)
class Reduction:
    """K_r = L^T K R, f_r = L^T (f - K a_0), a = R a_r + a_0.

    Static condensation is a reduction, too. With kept (e) and inner (i) unknowns, and K
    unsymmetric,

        L^T = [I, -K_ei K_ii^-1],   R = [I; -K_ii^-1 K_ie],   a_i = K_ii^-1 (f_i - K_ie a_e).

    The displacements that a load causes at inner nodes alone, Q f with Q = [0, 0; 0, K_ii^-1], are
    added to the offset: `under` makes the reduction for one load. Reduced loads do not need this,
    since L^T K Q = 0. Guyan's reduction applies `matrix` to the mass matrix as well.

    Args:
        left: L, (n, n_r); the same matrix as `right` for Dirichlet conditions.
        right: R, (n, n_r); kept unknowns have rows of the identity.
        offset: a_0, (n,): prescribed values.
        inner: Q, (n, n), of a condensation.
        space: trial space whose degrees of freedom are reduced, if it is known.
        supports: the arguments of `dirichlet`, which an iterative solver needs; None otherwise.

    Raises:
        TypeError: for anything but matrices and vectors.
        ValueError: for sizes that do not match.
    """

    left: PETSc.Mat
    right: PETSc.Mat
    offset: PETSc.Vec
    inner_flexibility: PETSc.Mat | None = None
    space: fem.FunctionSpace | None = None
    supports: Supports | None = None

    @check_same_arguments
    def __post_init__(self) -> None:
        with collective_errors(arguments.find_communicator(self.offset, self.space)):
            remedy = "`Reduction.dirichlet` and `condensation` make it"
            for name, kind in get_type_hints(type(self)).items():
                part = getattr(self, name)
                arguments.check_type(f"its part `{name}`", part, kind, remedy)
                if isinstance(part, PETSc.Object):
                    arguments.check_petsc_object(f"its part `{name}`", part)
            sizes = self.right.getSizes()
            if self.left.getSizes() != sizes or self.offset.getSizes() != sizes[0]:
                raise ValueError(
                    "left and right matrix of a reduction have one shape (n, n_r), its offset (n,)"
                )

    @classmethod
    @check_same_arguments
    def dirichlet(
        cls,
        space: fem.FunctionSpace | Spaces,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
    ) -> "Reduction":
        """Eliminates the prescribed degrees of freedom.

        Args:
            space: trial space; or a `Spaces` pair, which also ties a split pressure within each
                part of a body, see `Spaces.hybrid`.
            conditions: Dirichlet conditions on it; a single one need not be in a list.

        Raises:
            TypeError: for anything but a space and conditions.
            ValueError: if they leave nothing free or contradict each other, a prescribed value is
                not finite, or a condition was made on another space.
        """
        parts = None
        if isinstance(space, Spaces):
            space, parts = space.trial, space.parts
        free, offset = evaluate_conditions(space, conditions)
        require_any_dof(free, space, "the Dirichlet conditions leave no degree of freedom free")
        if has_split_pressure(space):
            kept = tie_pressures(space, parts, free)
            return cls(kept, kept, offset, space=space)
        kept = selection_matrix(free, offset)
        return cls(kept, kept, offset, space=space, supports=Supports(space, free))

    @classmethod
    @check_same_arguments
    def condensation(
        cls,
        K: PETSc.Mat,
        space: fem.FunctionSpace,
        nodes: npt.NDArray[np.integer] | Mask,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC] = (),
    ) -> "Reduction":
        """Condenses inner nodes statically, and eliminates prescribed degrees of freedom.

        Args:
            K: stiffness (n, n), free; it may be unsymmetric.
            space: trial space.
            nodes: local numbers of the inner nodes, or a mask of these (ghosts are skipped),
                no two of which share a cell: K_ii is inverted node by node.
            conditions: Dirichlet conditions on the other nodes; a single one need not be in a list.

        Raises:
            TypeError: for anything but a matrix, a space and conditions.
            ValueError: if K is not of the space or not finite, couples inner nodes, a node is
                none of the space's, a condition holds on one or was made on another space,
                conditions contradict each other, nothing is left free, or a prescribed value is
                not finite.
            SingularSystem: if an inner node has no stiffness.
        """
        arguments.check_space(space)
        check_problem({"the stiffness": K}, space=space)
        if is_hybrid(space):
            raise ValueError("nodes of hybrid spaces cannot be condensed: their pressures stay")
        K = to_aij(K)
        free, offset = evaluate_conditions(space, conditions)
        block, index_map = space.dofmap.index_map_bs, space.dofmap.index_map
        comm = space.mesh.comm
        inner = np.zeros(len(free), dtype=bool)
        with collective_errors(comm):
            known = index_map.size_local + index_map.num_ghosts
            chosen = local_numbers(comm, "the nodes to be condensed", nodes, known)
            inner.reshape(-1, block)[chosen[chosen < index_map.size_local]] = True
            if np.any(inner & ~free):
                raise ValueError("a Dirichlet condition holds on a node that is to be condensed")
        require_any_dof(free & ~inner, space, "there is nothing but inner and prescribed nodes")
        Q = _inner_flexibility(K, inner, block)
        kept = selection_matrix(free & ~inner, offset)
        right, left = kept.copy(), kept.copy()
        different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        right.axpy(-1.0, Q.matMult(K.matMult(kept)), different)
        left.axpy(-1.0, Q.transposeMatMult(K.transposeMatMult(kept)), different)
        return cls(left, right, offset, Q, space)

    @check_same_arguments
    def for_load(self, K: PETSc.Mat, f: PETSc.Vec) -> "Reduction":
        """Makes the reduction for a load f (n,) that acts on inner nodes, too.

        Args:
            K: stiffness (n, n).
            f: load (n,).

        Raises:
            TypeError, ValueError: if K and f do not match the reduction.
        """
        self._check_system(K, f)
        return _reduction_for_load(self, K, f)

    @check_same_arguments
    def matrix(self, K: PETSc.Mat) -> PETSc.Mat:
        """Reduces a matrix K (n, n) to L^T K R, (n_r, n_r).

        Raises:
            TypeError, ValueError: if K is not a matrix that matches the reduction.
        """
        self._check_system(K)
        return reduce_matrix(self, K)

    @check_same_arguments
    def load(self, K: PETSc.Mat, f: PETSc.Vec) -> PETSc.Vec:
        """Reduces a load to L^T (f - K a_0).

        Args:
            K: stiffness (n, n).
            f: load (n,).

        Raises:
            TypeError, ValueError: if K and f do not match the reduction.
        """
        self._check_system(K, f)
        return _reduced_load(self, K, f)

    @check_same_arguments
    def expand(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """R a_r + a_0.

        Args:
            reduced: vector (n_r,), a_r.

        Raises:
            TypeError, ValueError: if it is not a vector (n_r,).
        """
        expected = self.right.getSizes()[1]
        arguments.check_petsc_vector("the reduced vector", reduced, "the reduced system", expected)
        return self.right * reduced + self.offset

    def _check_system(self, K: PETSc.Mat, *loads: PETSc.Vec) -> None:
        sizes = self.offset.getSizes()
        with collective_errors(self.offset.comm.tompi4py()):
            arguments.check_matrix("the matrix", K, "the reduction", sizes)
            for f in loads:
                arguments.check_petsc_vector("the load", f, "the reduction", sizes)


def reduce_matrix(reduction: Reduction, K: PETSc.Mat) -> PETSc.Mat:
    """Return L^T K R, (n_r, n_r), of a matrix (n, n) that is known to match the reduction."""
    reduced = reduction.left.transposeMatMult(to_aij(K).matMult(reduction.right))
    return AssemblyRecord.read(K).attach(reduced)


def reduce_load(reduction: Reduction, K: PETSc.Mat, f: PETSc.Vec) -> tuple[Reduction, PETSc.Vec]:
    """Return the reduction for a load f (n,), and the reduced load.

    K (n, n) and f are known to match the reduction, as in the steps of a problem that was checked.
    """
    reduction = _reduction_for_load(reduction, K, f)
    return reduction, _reduced_load(reduction, K, f)


def _reduction_for_load(reduction: Reduction, K: PETSc.Mat, f: PETSc.Vec) -> Reduction:
    """Return the reduction with the displacements that a load f causes at inner nodes alone."""
    if reduction.inner_flexibility is None:
        return reduction
    a = reduction.offset
    return replace(reduction, offset=a - reduction.inner_flexibility * (K * a - f))


def _reduced_load(reduction: Reduction, K: PETSc.Mat, f: PETSc.Vec) -> PETSc.Vec:
    reduced = reduction.left.createVecRight()
    reduction.left.multTranspose(f - K * reduction.offset, reduced)
    return reduced


def full_size_reduction(reduction: Reduction) -> Reduction:
    """The reduction that keeps all unknowns and sets prescribed ones to zero."""
    if reduction.supports is None:
        raise ValueError(NO_SUPPORTS_MESSAGE)
    unknowns, free = reduction.right.getSize()
    if free == unknowns:  # nothing is prescribed: contact alone holds the body
        return reduction
    kept = selection_matrix(reduction.supports.free, reduction.offset, renumbered=False)
    return replace(reduction, left=kept, right=kept)


def constrained_operator(reduction: Reduction, K: PETSc.Mat) -> PETSc.Mat:
    """The matrix of `masked` supports without assembling it: ones where values are prescribed."""
    if reduction.supports is None:
        raise ValueError(NO_SUPPORTS_MESSAGE)
    space = reduction.supports.space
    projection = ConstraintProjection(reduction.supports.free, space.dofmap.index_map_bs)
    scale = reduction.right.getDiagonal() if is_hybrid(space) else None  # see `equilibrated`
    return python_matrix(K.getSizes(), ConstrainedOperator(K, projection, scale), K.comm)


def scale_pressures(reduction: Reduction, K: PETSc.Mat) -> Reduction:
    """The reduction with pressures of hybrid spaces scaled to a displacement's size.

    In consistent units displacement and pressure may be 15 orders of magnitude apart, and
    factorisations and Krylov methods would lose one of them. `expand` returns the same values.
    """
    if reduction.space is None or not is_hybrid(reduction.space):
        return reduction
    scale = equilibration_scale(reduction.space, K)
    left, right = reduction.left.copy(), reduction.right.copy()
    for side in (left, right):
        side.diagonalScale(scale)
    return replace(reduction, left=left, right=right)

"""Supports and static condensation, applied as a reduction of a system without conditions.

A stiffness K is reduced to L^T K R, with the matrices L and R of `Reduction`. Inner nodes that are
condensed must not be coupled to each other, and each of them needs a stiffness. Dirichlet
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
from pw_elements.checks import (
    JoinedSpace,
    arguments,
    check_same_arguments_on_all_processes,
    count_local_and_global_dofs,
    format_points,
    raise_errors_on_all_processes,
)
from pw_elements.solvers import (
    ITERATIVE_NEEDS_SUPPORTS_MESSAGE,
    ConstrainedOperator,
    ConstraintProjection,
    SingularSystem,
    Supports,
    add_scaled,
    block_diagonal_matrix,
    diagonal_blocks,
    identity_with_free_columns,
    matrix_from_python_context,
    to_aij,
)
from pw_elements.spaces import (
    Spaces,
    has_discontinuous_pressure,
    is_hybrid,
    list_fields,
    pressure_continuity_matrix,
    pressure_equilibration_scales,
    read_record,
    selected_local_numbers,
)

# Difference between values prescribed at one degree of freedom, relative to the largest prescribed
# value, that may be due to round-off
_PRESCRIBED_VALUE_TOLERANCE_OVER_LARGEST = 1e-9

# Magnitude of a matrix entry, relative to the largest entry, that may be due to round-off
_ROUND_OFF_OVER_LARGEST_ENTRY = 1e-13


def free_dofs_and_prescribed_values(
    space: fem.FunctionSpace | JoinedSpace,
    conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
) -> tuple[Mask, PETSc.Vec]:
    """Return a mask (owned dofs,) of free degrees of freedom, and the prescribed values (n,).

    The prescribed values are zero at free degrees of freedom.

    Args:
        space: trial space.
        conditions: Dirichlet conditions on the space, one or a sequence.

    Raises:
        TypeError: for anything but Dirichlet conditions.
        ValueError: if conditions contradict each other, a value is not finite, or a condition was
            made on another space.
    """
    arguments.check_function_space(space)
    condition_list = [conditions] if isinstance(conditions, fem.DirichletBC) else conditions
    if isinstance(space, JoinedSpace):
        return _free_dofs_and_prescribed_values_of_bodies(space, condition_list)
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    owned, comm = index_map.size_local * block, space.mesh.comm
    values = np.zeros(owned + index_map.num_ghosts * block)
    free = np.ones(owned, dtype=bool)
    difference = np.zeros(owned)
    with raise_errors_on_all_processes(comm):
        arguments.check_type(
            "the list of conditions", condition_list, Sequence, "`prescribe` makes its items"
        )
        for condition in condition_list:
            _check_condition(condition, space)
            condition_values = np.zeros(len(values))
            condition.set(condition_values)
            dofs = condition.dof_indices()[0]  # DOLFINx 0.9 returns a wrong number of owned ones
            dofs = dofs[dofs < owned]
            repeated = dofs[~free[dofs]]
            change = np.abs(condition_values - values)[repeated]
            difference[repeated] = np.maximum(difference[repeated], change)
            free[dofs] = False
            values[dofs] = condition_values[dofs]
        if not np.isfinite(values[:owned]).all():
            raise ValueError("a prescribed value is not a finite number")
        largest = np.abs(values[:owned]).max(initial=0.0)
        arguments.check_magnitude("the largest prescribed value", float(largest), min_nonzero=0.0)
    contradictions = np.zeros((0, space.mesh.geometry.dim))
    for field in list_fields(space):
        largest = comm.allreduce(np.abs(values[field.owned_unknowns]).max(initial=0.0), MPI.MAX)
        differs = (
            difference[field.owned_unknowns] > _PRESCRIBED_VALUE_TOLERANCE_OVER_LARGEST * largest
        ).any(axis=1)
        if differs.any():
            x = field.space.tabulate_dof_coordinates()[: len(differs)][differs]
            contradictions = np.vstack([contradictions, x[:, : contradictions.shape[1]]])
    contradictions = np.concatenate(comm.allgather(contradictions))
    if len(contradictions):
        positions = format_points(np.unique(contradictions, axis=0))
        raise ValueError(
            f"Dirichlet conditions contradict each other at {positions}: a degree of freedom can "
            "have one value"
        )
    offset = PETSc.Vec().createMPI((owned, index_map.size_global * block), comm=comm)
    offset.setArray(values[:owned])
    return free, offset


def _free_dofs_and_prescribed_values_of_bodies(
    space: JoinedSpace, conditions: Sequence[fem.DirichletBC]
) -> tuple[Mask, PETSc.Vec]:
    """Return a mask of free degrees of freedom, and the prescribed values, of several bodies."""
    parts = [
        free_dofs_and_prescribed_values(body.space, body_conditions)
        for body, body_conditions in zip(
            space.bodies, sort_conditions_by_body(space, conditions), strict=True
        )
    ]
    offset = PETSc.Vec().createMPI(count_local_and_global_dofs(space), comm=space.mesh.comm)
    offset.setArray(np.concatenate([values.array_r for _, values in parts]))
    return np.concatenate([free for free, _ in parts]), offset


def sort_conditions_by_body(
    space: JoinedSpace, conditions: fem.DirichletBC | Sequence[fem.DirichletBC]
) -> list[list[fem.DirichletBC]]:
    """Return the Dirichlet conditions on each of several bodies.

    Raises:
        TypeError: for anything but Dirichlet conditions.
        ValueError: for a condition on another mesh.
    """
    condition_list = [conditions] if isinstance(conditions, fem.DirichletBC) else conditions
    meshes = [body.space.mesh._cpp_object for body in space.bodies]
    sorted_conditions: list[list[fem.DirichletBC]] = [[] for _ in meshes]
    with raise_errors_on_all_processes(space.mesh.comm):
        arguments.check_type(
            "the list of conditions", condition_list, Sequence, "`prescribe` makes its items"
        )
        for condition in condition_list:
            arguments.check_type("a condition", condition, fem.DirichletBC, "`prescribe` makes one")
            bodies = [k for k, mesh in enumerate(meshes) if condition.function_space.mesh is mesh]
            if not bodies:
                raise ValueError(
                    "a Dirichlet condition was made on a mesh of none of the bodies: make it on "
                    "the trial space of a body"
                )
            sorted_conditions[bodies[0]].append(condition)
    return sorted_conditions


def _check_condition(condition: fem.DirichletBC, space: fem.FunctionSpace) -> None:
    arguments.check_type("a condition", condition, fem.DirichletBC, "`prescribe` makes one")
    V = condition.function_space
    sizes, expected_sizes = (
        (index_map.size_global, index_map.size_local)
        for index_map in (V.dofmap.index_map, space.dofmap.index_map)
    )
    if V.mesh is not space.mesh._cpp_object or sizes != expected_sizes:
        raise ValueError(
            "a Dirichlet condition was made on another space: its degrees of freedom would be "
            "taken for others here; make it on the trial space"
        )


def require_any_dof(mask: Mask, space: fem.FunctionSpace, message: str) -> None:
    if space.mesh.comm.allreduce(int(mask.sum()), MPI.SUM) == 0:
        raise ValueError(message)


def _invert_inner_stiffness(K: PETSc.Mat, is_inner: Mask, dofs_per_node: int) -> PETSc.Mat:
    """Return a matrix (n, n) with the inverse stiffness of inner unknowns, and zeros elsewhere.

    Args:
        K: stiffness (n, n).
        is_inner: mask (owned dofs,) of the inner unknowns.
        dofs_per_node: number of unknowns of a node.

    Raises:
        ValueError: if the stiffness couples inner nodes.
        SingularSystem: if an inner node has no stiffness.
    """
    select = identity_with_free_columns(is_inner, K.createVecLeft())
    K_ii = select.transposeMatMult(K.matMult(select))
    (nodes, nonzero_blocks), (sizes, _) = diagonal_blocks(K_ii, dofs_per_node), K_ii.getSizes()
    blocks = np.zeros((sizes[0] // dofs_per_node, dofs_per_node, dofs_per_node))
    blocks[nodes] = nonzero_blocks
    infinity = PETSc.NormType.INFINITY
    stiffness = K_ii.norm(infinity)
    add_scaled(K_ii, -1.0, block_diagonal_matrix(blocks, sizes, K.comm))
    are_coupled = K_ii.norm(infinity) > _ROUND_OFF_OVER_LARGEST_ENTRY * stiffness
    with raise_errors_on_all_processes(K.comm.tompi4py()):
        if are_coupled:
            raise ValueError(
                "the stiffness couples nodes that are to be condensed: no two of them may share a "
                "cell"
            )
        if len(blocks) and not np.all(np.linalg.cond(blocks) < 1 / _ROUND_OFF_OVER_LARGEST_ENTRY):
            raise SingularSystem("a node that is to be condensed has no stiffness")
    inverse = block_diagonal_matrix(np.linalg.inv(blocks), sizes, K.comm)
    return select.matMult(inverse).matMult(select.transpose(PETSc.Mat()))


@dataclass(frozen=True)
class Reduction:
    """Reduction of a system K a = f of n unknowns to n_r unknowns a_r.

    With a = R a_r + a_0, the reduced system has the matrix K_r = L^T K R and the right-hand side
    f_r = L^T (f - K a_0).

    Dirichlet conditions and static condensation are such reductions. In static condensation,
    unknowns are either inner (i) or remaining (e). For a K that may be unsymmetric,

        L^T = [I, -K_ei K_ii^-1],   R = [I; -K_ii^-1 K_ie],   a_i = K_ii^-1 (f_i - K_ie a_e).

    A load f on inner nodes causes displacements Q f with Q = [0, 0; 0, K_ii^-1], which
    `with_offset_for_load` adds to a_0. This does not change reduced loads, since L^T K Q = 0. For
    Guyan's reduction, apply the method `matrix` to the mass matrix as well.

    Args:
        left: matrix L (n, n_r); for Dirichlet conditions the same object as `right`.
        right: matrix R (n, n_r), whose rows for remaining unknowns are rows of the identity.
        offset: vector a_0 (n,) of prescribed values.
        inner_flexibility: matrix Q (n, n) of a condensation; None for other reductions.
        space: trial space whose degrees of freedom are reduced, if it is known.
        supports: free degrees of freedom of a reduction made by `dirichlet`, which an iterative
            solver needs; None for other reductions, and if a split pressure is made continuous.

    Raises:
        TypeError: for anything but matrices and vectors.
        ValueError: for sizes that do not match.
    """

    left: PETSc.Mat
    right: PETSc.Mat
    offset: PETSc.Vec
    inner_flexibility: PETSc.Mat | None = None
    space: fem.FunctionSpace | JoinedSpace | None = None
    supports: Supports | None = None

    @check_same_arguments_on_all_processes
    def __post_init__(self) -> None:
        with raise_errors_on_all_processes(
            arguments.find_largest_communicator(self.offset, self.space)
        ):
            remedy = "`Reduction.dirichlet` and `condensation` make it"
            for name, kind in get_type_hints(type(self)).items():
                part = getattr(self, name)
                arguments.check_type(f"its part `{name}`", part, kind, remedy)
                if isinstance(part, PETSc.Object):
                    arguments.refuse_empty_petsc_object(f"its part `{name}`", part)
            sizes = self.right.getSizes()
            if self.left.getSizes() != sizes or self.offset.getSizes() != sizes[0]:
                raise ValueError(
                    "left and right matrix of a reduction have one shape (n, n_r), its offset (n,)"
                )

    @classmethod
    @check_same_arguments_on_all_processes
    def dirichlet(
        cls,
        space: fem.FunctionSpace | Spaces,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
    ) -> "Reduction":
        """Return the reduction that eliminates prescribed degrees of freedom.

        Args:
            space: trial space, or a `Spaces` object. Given `Spaces` with `parts`, the reduction
                makes the pressure continuous within each part of a body, see `Spaces.hybrid`.
            conditions: Dirichlet conditions on the space, one or a sequence.

        Raises:
            TypeError: for anything but a space and conditions.
            ValueError: if the conditions leave no degree of freedom free or contradict each other,
                a prescribed value is not finite, or a condition was made on another space.
        """
        parts = None
        if isinstance(space, Spaces):
            space, parts = space.trial, space.parts
        free, offset = free_dofs_and_prescribed_values(space, conditions)
        require_any_dof(free, space, "the Dirichlet conditions leave no degree of freedom free")
        if has_discontinuous_pressure(space):
            tied = pressure_continuity_matrix(space, parts, free)
            return cls(tied, tied, offset, space=space)
        select = identity_with_free_columns(free, offset)
        return cls(select, select, offset, space=space, supports=Supports(space, free))

    @classmethod
    @check_same_arguments_on_all_processes
    def condensation(
        cls,
        K: PETSc.Mat,
        space: fem.FunctionSpace,
        nodes: npt.NDArray[np.integer] | Mask,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC] = (),
    ) -> "Reduction":
        """Return the reduction that condenses inner nodes and eliminates prescribed unknowns.

        Args:
            K: stiffness (n, n), assembled without conditions; it may be unsymmetric.
            space: trial space.
            nodes: local numbers of the inner nodes, or a mask of all local nodes; ghosts are
                ignored. No two inner nodes may share a cell, since the stiffness of inner unknowns
                is inverted node by node.
            conditions: Dirichlet conditions on other nodes, one or a sequence.

        Raises:
            TypeError: for anything but a matrix, a space and conditions.
            ValueError: if K does not belong to the space, is not finite or couples inner nodes; if
                the space is hybrid; if an inner node does not exist or has a condition; or if
                conditions were made on another space, contradict each other, leave no degree of
                freedom free, or prescribe a value that is not finite.
            SingularSystem: if an inner node has no stiffness.
        """
        arguments.check_function_space(space)
        check_problem({"the stiffness": K}, space=space)
        if is_hybrid(space):
            raise ValueError("nodes of hybrid spaces cannot be condensed: their pressures stay")
        K = to_aij(K)
        free, offset = free_dofs_and_prescribed_values(space, conditions)
        block, index_map = space.dofmap.index_map_bs, space.dofmap.index_map
        comm = space.mesh.comm
        inner = np.zeros(len(free), dtype=bool)
        with raise_errors_on_all_processes(comm):
            n_nodes = index_map.size_local + index_map.num_ghosts
            numbers = selected_local_numbers(comm, "the nodes to be condensed", nodes, n_nodes)
            inner.reshape(-1, block)[numbers[numbers < index_map.size_local]] = True
            if np.any(inner & ~free):
                raise ValueError("a Dirichlet condition holds on a node that is to be condensed")
        require_any_dof(free & ~inner, space, "there is nothing but inner and prescribed nodes")
        Q = _invert_inner_stiffness(K, inner, block)
        select = identity_with_free_columns(free & ~inner, offset)
        right, left = select.copy(), select.copy()
        different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        right.axpy(-1.0, Q.matMult(K.matMult(select)), different)
        left.axpy(-1.0, Q.transposeMatMult(K.transposeMatMult(select)), different)
        return cls(left, right, offset, Q, space)

    @check_same_arguments_on_all_processes
    def with_offset_for_load(self, K: PETSc.Mat, f: PETSc.Vec) -> "Reduction":
        """Return the reduction whose offset includes displacements due to a load on inner nodes.

        Displacements of inner nodes due to prescribed values are included as well.

        Args:
            K: stiffness (n, n).
            f: load (n,).

        Raises:
            TypeError, ValueError: if K and f do not match the reduction.
        """
        self._check_matrix_and_load_sizes(K, f)
        return _update_offset_for_load(self, K, f)

    @check_same_arguments_on_all_processes
    def matrix(self, K: PETSc.Mat) -> PETSc.Mat:
        """Return the reduced matrix L^T K R (n_r, n_r).

        Args:
            K: matrix (n, n).

        Raises:
            TypeError, ValueError: if K is not a matrix that matches the reduction.
        """
        self._check_matrix_and_load_sizes(K)
        return reduce_matrix(self, K)

    @check_same_arguments_on_all_processes
    def load(self, K: PETSc.Mat, f: PETSc.Vec) -> PETSc.Vec:
        """Return the reduced load L^T (f - K a_0), a vector (n_r,).

        Args:
            K: stiffness (n, n).
            f: load (n,).

        Raises:
            TypeError, ValueError: if K and f do not match the reduction.
        """
        self._check_matrix_and_load_sizes(K, f)
        return _reduced_load(self, K, f)

    @check_same_arguments_on_all_processes
    def expand(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """Return all unknowns R a_r + a_0, a vector (n,).

        Args:
            reduced: reduced unknowns a_r (n_r,).

        Raises:
            TypeError, ValueError: if `reduced` is not a vector (n_r,).
        """
        expected = self.right.getSizes()[1]
        arguments.check_petsc_vector("the reduced vector", reduced, "the reduced system", expected)
        return self.right * reduced + self.offset

    def _check_matrix_and_load_sizes(self, K: PETSc.Mat, *loads: PETSc.Vec) -> None:
        sizes = self.offset.getSizes()
        with raise_errors_on_all_processes(self.offset.comm.tompi4py()):
            arguments.check_assembled_square_matrix("the matrix", K, "the reduction", sizes)
            for f in loads:
                arguments.check_petsc_vector("the load", f, "the reduction", sizes)


def reduce_matrix(reduction: Reduction, K: PETSc.Mat) -> PETSc.Mat:
    """Return the reduced matrix L^T K R (n_r, n_r) without checks.

    Args:
        reduction: the reduction, with its matrices L and R.
        K: matrix (n, n) that is known to match the reduction.
    """
    reduced = reduction.left.transposeMatMult(to_aij(K).matMult(reduction.right))
    return read_record(K).attach(reduced)


def reduce_load_and_update_offset(
    reduction: Reduction, K: PETSc.Mat, f: PETSc.Vec
) -> tuple[Reduction, PETSc.Vec]:
    """Return the reduction with the offset for a load, and the reduced load (n_r,), unchecked.

    Args:
        reduction: the reduction.
        K: matrix (n, n) that is known to match the reduction.
        f: load (n,) that is known to match the reduction.
    """
    reduction = _update_offset_for_load(reduction, K, f)
    return reduction, _reduced_load(reduction, K, f)


def _update_offset_for_load(reduction: Reduction, K: PETSc.Mat, f: PETSc.Vec) -> Reduction:
    """Return a reduction whose offset includes the displacements of inner nodes under a load f."""
    if reduction.inner_flexibility is None:
        return reduction
    a = reduction.offset
    return replace(reduction, offset=a - reduction.inner_flexibility * (K * a - f))


def _reduced_load(reduction: Reduction, K: PETSc.Mat, f: PETSc.Vec) -> PETSc.Vec:
    reduced = reduction.left.createVecRight()
    reduction.left.multTranspose(f - K * reduction.offset, reduced)
    return reduced


def full_size_masking_reduction(reduction: Reduction) -> Reduction:
    """Return a reduction that keeps all n unknowns and sets the prescribed ones to zero.

    Raises:
        ValueError: if the reduction has no `supports`.
    """
    if reduction.supports is None:
        raise ValueError(ITERATIVE_NEEDS_SUPPORTS_MESSAGE)
    unknowns, free = reduction.right.getSize()
    if free == unknowns:  # nothing is prescribed
        return reduction
    mask = identity_with_free_columns(
        reduction.supports.free, reduction.offset, drop_other_columns=False
    )
    return replace(reduction, left=mask, right=mask)


def matrix_free_constrained_operator(reduction: Reduction, K: PETSc.Mat) -> PETSc.Mat:
    """Return a matrix-free operator (n, n) that acts as the matrix K under supports.

    The rows of prescribed unknowns are those of the identity.

    Raises:
        ValueError: if the reduction has no `supports`.
    """
    if reduction.supports is None:
        raise ValueError(ITERATIVE_NEEDS_SUPPORTS_MESSAGE)
    space = reduction.supports.space
    projection = ConstraintProjection(reduction.supports.free, space.dofmap.index_map_bs)
    # see `scale_pressures_to_displacements`
    scale = reduction.right.getDiagonal() if is_hybrid(space) else None
    return matrix_from_python_context(
        K.getSizes(), ConstrainedOperator(K, projection, scale), K.comm
    )


def scale_pressures_to_displacements(reduction: Reduction, K: PETSc.Mat) -> Reduction:
    """Return a reduction whose reduced pressures are scaled to the magnitude of displacements.

    The reduction of a space without pressures is returned unchanged. In consistent units,
    displacements and pressures may differ by 15 orders of magnitude, and factorisations and Krylov
    methods would lose one of the two. The method `expand` still returns unscaled pressures.
    """
    if reduction.space is None or not is_hybrid(reduction.space):
        return reduction
    scale = pressure_equilibration_scales(reduction.space, K)
    left, right = reduction.left.copy(), reduction.right.copy()
    for side in (left, right):
        side.diagonalScale(scale)
    return replace(reduction, left=left, right=right)

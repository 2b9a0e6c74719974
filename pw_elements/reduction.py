"""Supports and static condensation: the reduction L^T K R of a free system."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements import arguments
from pw_elements.collective import collective
from pw_elements.condensation import condensed
from pw_elements.conditions import check_any, prescribed
from pw_elements.given import check_reduction
from pw_elements.hybrid import equilibration, is_split, tied
from pw_elements.iterative import NO_SUPPORTS
from pw_elements.matrices import python_matrix, selection, unbalanced, unblocked
from pw_elements.projection import Masked, Projection, Supports
from pw_elements.spaces import Spaces


@dataclass(frozen=True)
class Reduction:
    """K_r = L^T K R, f_r = L^T (f - K a_0), a = R a_r + a_0.

    Static condensation is a reduction, too. With kept (e) and inner (i) unknowns, and K
    unsymmetric,

        L^T = [I, -K_ei K_ii^-1],   R = [I; -K_ii^-1 K_ie],   a_i = K_ii^-1 (f_i - K_ie a_e).

    The displacements that a load causes at inner nodes alone, Q f with Q = [0, 0; 0, K_ii^-1], are
    added to the offset: `under` makes the reduction for one load. Reduced loads do not need this,
    since L^T K Q = 0. Guyan's reduction applies `matrix` to the mass matrix as well: see `guyan`.

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
    inner: PETSc.Mat | None = None
    space: fem.FunctionSpace | None = None
    supports: Supports | None = None

    def __post_init__(self) -> None:
        with collective(arguments.processes(self.offset, self.space)):
            for name, matrix in (("left", self.left), ("right", self.right)):
                arguments.of_type(f"the {name} matrix", matrix, PETSc.Mat, "give a PETSc matrix")
            arguments.petsc_vector("the offset", self.offset)
            sizes = self.right.getSizes()
            if self.left.getSizes() != sizes or self.offset.getSizes() != sizes[0]:
                raise ValueError(
                    "left and right matrix of a reduction have one shape (n, n_r), its offset (n,)"
                )

    @classmethod
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
        free, offset = prescribed(space, conditions)
        check_any(free, space, "the Dirichlet conditions leave no degree of freedom free")
        if is_split(space):
            kept = tied(space, parts, free)
            return cls(kept, kept, offset, space=space)
        kept = selection(free, offset)
        return cls(kept, kept, offset, space=space, supports=Supports(space, free))

    @classmethod
    def condensation(
        cls,
        K: PETSc.Mat,
        space: fem.FunctionSpace,
        nodes: npt.NDArray[np.integer] | npt.NDArray[np.bool_],
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
        left, right, offset, inner = condensed(K, space, nodes, conditions)
        return cls(left, right, offset, inner, space)

    def under(self, K: PETSc.Mat, f: PETSc.Vec) -> "Reduction":
        """This reduction for a load f (n,) that acts on inner nodes, too.

        Args:
            K: stiffness (n, n).
            f: load (n,).

        Raises:
            TypeError, ValueError: if K and f do not match the reduction.
        """
        self._check_system(K, f)
        if self.inner is None:
            return self
        rest = unbalanced(K, self.offset, f)
        rest.scale(-1.0)
        offset = self.offset.duplicate()
        self.inner.multAdd(rest, self.offset, offset)
        return replace(self, offset=offset)

    def scaled(self, share: float) -> "Reduction":
        """This reduction with a share of the prescribed values.

        Args:
            share: factor of the prescribed values.
        """
        if share == 1:
            return self
        offset = self.offset.copy()
        offset.scale(share)
        return replace(self, offset=offset)

    def masked(self) -> "Reduction":
        """The same supports, the unknowns being numbered as before and zero where prescribed.

        Raises:
            ValueError: if this reduction does more than prescribe values.
        """
        if self.supports is None:
            raise ValueError(NO_SUPPORTS)
        comm = self.offset.comm.tompi4py()
        if comm.allreduce(bool(self.supports.free.all()), MPI.LAND):
            return self
        kept = selection(self.supports.free, self.offset, renumbered=False)
        return replace(self, left=kept, right=kept)

    def supported(self, K: PETSc.Mat) -> PETSc.Mat:
        """The matrix of `masked` supports without assembling it: ones where values are prescribed.

        Args:
            K: stiffness (n, n).

        Raises:
            ValueError: as `masked` says.
        """
        if self.supports is None:
            raise ValueError(NO_SUPPORTS)
        projection = Projection(self.supports.free, self.supports.space.dofmap.index_map_bs)
        return python_matrix(K.getSizes(), Masked(K, projection), K.comm)

    def equilibrated(self, K: PETSc.Mat) -> "Reduction":
        """This reduction with pressures of hybrid spaces scaled to be of a displacement's size.

        In consistent units displacement and pressure may be 15 orders of magnitude apart, and
        factorisations and Krylov methods would lose one of them. `expand` returns the same values.

        Args:
            K: stiffness (n, n).
        """
        scale = None if self.space is None else equilibration(self.space, K)
        if scale is None:
            return self
        right = self.right.copy()
        right.diagonalScale(scale)
        left = right
        if self.left != self.right:
            left = self.left.copy()
            left.diagonalScale(scale)
        return replace(self, left=left, right=right)

    def guyan(self, left: Literal["transposed", "same"]) -> "Reduction":
        """This condensation for mass matrices, where two left matrices L are in use.

        Args:
            left: "transposed" is this L, from the transposed problem; "same" takes R for L, the
                recipe of symmetric codes. L^T K R is the same, since K R vanishes in the inner
                rows; L^T M R is not.

        Raises:
            ValueError: for an unknown name.
        """
        if left not in ("transposed", "same"):
            raise ValueError(f'left matrix {left!r}: the names are "transposed" and "same"')
        return self if left == "transposed" else replace(self, left=self.right)

    def matrix(self, K: PETSc.Mat) -> PETSc.Mat:
        """L^T K R.

        Args:
            K: matrix (n, n).

        Raises:
            TypeError, ValueError: if K is not a matrix that matches the reduction.
        """
        self._check_system(K)
        reduced = self.left.transposeMatMult(unblocked(K).matMult(self.right))
        reduced.setAttr("form", K.getAttr("form"))
        return reduced

    def load(self, K: PETSc.Mat, f: PETSc.Vec) -> PETSc.Vec:
        """L^T (f - K a_0).

        Args:
            K: stiffness (n, n).
            f: load (n,).

        Raises:
            TypeError, ValueError: if K and f do not match the reduction.
        """
        self._check_system(K, f)
        remainder = K.createVecLeft()
        K.mult(self.offset, remainder)
        remainder.aypx(-1.0, f)
        reduced = self.left.createVecRight()
        self.left.multTranspose(remainder, reduced)
        return reduced

    def expand(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """R a_r + a_0.

        Args:
            reduced: vector (n_r,), a_r.

        Raises:
            TypeError, ValueError: if it is not a vector (n_r,).
        """
        self._check_reduced(reduced)
        full = self.offset.duplicate()
        self.right.multAdd(reduced, self.offset, full)
        return full

    def expand_mode(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """R a_r: a mode, which vanishes where values are prescribed.

        Args:
            reduced: vector (n_r,), a_r.

        Raises:
            TypeError, ValueError: if it is not a vector (n_r,).
        """
        self._check_reduced(reduced)
        full = self.offset.duplicate()
        self.right.mult(reduced, full)
        return full

    def shape(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """The old name of `expand_mode`."""
        warnings.warn("Reduction.shape is now called expand_mode", DeprecationWarning, stacklevel=2)
        return self.expand_mode(reduced)

    def _check_system(self, K: PETSc.Mat, *loads: PETSc.Vec) -> None:
        sizes = self.offset.getSizes()
        with collective(self.offset.comm.tompi4py()):
            arguments.matrix("the matrix", K)
            arguments.same_sizes("the matrix", K.getSizes()[0], "the reduction", sizes)
            for f in loads:
                arguments.petsc_vector("the load", f)
                arguments.same_sizes("the load", f.getSizes(), "the reduction", sizes)

    def _check_reduced(self, reduced: PETSc.Vec) -> None:
        with collective(self.offset.comm.tompi4py()):
            arguments.petsc_vector("the reduced vector", reduced)
            expected = self.right.getSizes()[1]
            arguments.same_sizes(
                "the reduced vector", reduced.getSizes(), "the reduced system", expected
            )

    def then(self, inner: "Reduction") -> "Reduction":
        """This reduction followed by another one of the reduced system.

        Args:
            inner: a reduction of the system that this one leaves.

        Raises:
            TypeError, ValueError: if it is not a reduction of that system.
        """
        with collective(self.offset.comm.tompi4py()):
            check_reduction(inner)
        self._check_reduced(inner.offset)
        Q = self.inner
        if inner.inner is not None:
            lifted = self.right.matMult(inner.inner)
            lifted = lifted.matMult(self.left.transpose(PETSc.Mat()))
            if Q is not None:
                lifted.axpy(1.0, Q, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            Q = lifted
        return Reduction(
            self.left.matMult(inner.left),
            self.right.matMult(inner.right),
            self.expand(inner.offset),
            Q,
            self.space,
        )

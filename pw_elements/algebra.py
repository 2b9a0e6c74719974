"""Free assembly, the reduction L^T K R, and solves that refuse a singular system.

DOLFINx sets no Dirichlet conditions on a matrix whose test and trial spaces differ. Here the
matrix is assembled free, and conditions are a `Reduction`; for -Δu = 1 with u = 0 around:

    V = fem.functionspace(mesh, ("Lagrange", 2))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(test_space(V))
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(v * ufl.dx)
    rim = fem.locate_dofs_topological(V, 1, exterior_facet_indices(mesh.topology))
    a = solve(K, f, Reduction.dirichlet(V, [fem.dirichletbc(0.0, rim, V)]))
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix as _assemble_matrix
from dolfinx.fem.petsc import assemble_vector as _assemble_vector
from dolfinx.fem.petsc import create_matrix

from pw_elements.iterative import NO_SUPPORTS, Iterative, Solver, chosen
from pw_elements.linear_solver import Direct, LinearSolver, PreparedSolver, SingularSystem
from pw_elements.multigrid import Masked, Projection, Supports, is_blocked, python_matrix

# Backward error of a direct solve is some round-offs; above this the factorisation went wrong.
_RESIDUAL = 1e-10
# Entries of a matrix below this, over its largest, are zeros
_ROUND_OFF = 1e-13


def assemble_matrix(form: ufl.Form, blocked: bool = False) -> PETSc.Mat:
    """Matrix of a bilinear form, all rows and columns free.

    The form (and by it mesh and spaces) lives as long as the matrix.

    Args:
        form: of trial and test functions.
        blocked: stores a vector field's matrix by nodes (PETSc's BAIJ), in 0.7 of the memory, as
            `Iterative` needs it: another format is copied by it. Everything else converts it.

    Raises:
        ValueError: if it is not bilinear.
    """
    _check_rank(form, 2, "a matrix")
    compiled = fem.form(form)
    matrix = create_matrix(compiled, "baij" if blocked else None)
    _assemble_matrix(matrix, compiled)
    matrix.assemble()
    matrix.setAttr("form", compiled)
    return matrix


def assemble_vector(form: ufl.Form) -> PETSc.Vec:
    """Vector of a linear form, contributions of all processes added.

    Raises:
        ValueError: if it is not linear.
    """
    _check_rank(form, 1, "a vector")
    compiled = fem.form(form)
    vector = _assemble_vector(compiled)
    vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    vector.setAttr("form", compiled)
    return vector


@dataclass(frozen=True)
class Reduction:
    """K_r = L^T K R, f_r = L^T (f - K a_0), a = R a_r + a_0.

    Static condensation is one, too. For unsymmetric K, kept (e) and inner (i) unknowns,

        L^T = [I, -K_ei K_ii^-1],   R = [I; -K_ii^-1 K_ie],   a_i = K_ii^-1 (f_i - K_ie a_e).

    What a load does to inner nodes alone, Q f with Q = [0, 0; 0, K_ii^-1], adds to the offset:
    `under` gives the reduction for one load. Reduced loads do not need it, for L^T K Q = 0.
    Guyan's reduction is `matrix` of a mass matrix, too: see `guyan`.

    Args:
        left: L, (n, n_r); the same matrix as `right` for Dirichlet conditions.
        right: R, (n, n_r); kept unknowns have rows of the identity.
        offset: a_0, (n,): prescribed values.
        inner: Q, (n, n), of a condensation.
        supports: what `dirichlet` was told, which an iterative solver needs; None of others.
    """

    left: PETSc.Mat
    right: PETSc.Mat
    offset: PETSc.Vec
    inner: PETSc.Mat | None = None
    supports: Supports | None = None

    @classmethod
    def dirichlet(
        cls, space: fem.FunctionSpace, conditions: Sequence[fem.DirichletBC]
    ) -> "Reduction":
        """Drops the prescribed degrees of freedom; `conditions` are set on the trial space.

        Raises:
            ValueError: if they leave nothing free, a prescribed value is not finite, or a
                condition was made on another space.
        """
        free, offset = _prescribed(space, conditions)
        _check_any(free, space, "the Dirichlet conditions leave no degree of freedom free")
        selection = _selection(free, offset)
        return cls(selection, selection, offset, supports=Supports(space, free))

    @classmethod
    def condensation(
        cls,
        K: PETSc.Mat,
        space: fem.FunctionSpace,
        nodes: npt.NDArray[np.int32],
        conditions: Sequence[fem.DirichletBC] = (),
    ) -> "Reduction":
        """Condenses inner nodes statically, and drops prescribed degrees of freedom.

        Args:
            K: stiffness (n, n), free; it may be unsymmetric.
            space: trial space.
            nodes: local numbers of the inner nodes (ghosts are passed over), no two of which
                share a cell: K_ii is inverted node by node.
            conditions: Dirichlet conditions on the other nodes.

        Raises:
            ValueError: if K couples inner nodes, a condition holds on one or was made on
                another space, nothing is left free, or a prescribed value is not finite.
            SingularSystem: if an inner node has no stiffness.
        """
        K = unblocked(K)
        free, offset = _prescribed(space, conditions)
        block = space.dofmap.index_map_bs
        inner = np.zeros(len(free), dtype=bool)
        inner.reshape(-1, block)[nodes[nodes < space.dofmap.index_map.size_local]] = True
        comm = space.mesh.comm
        if comm.allreduce(int(np.any(inner & ~free)), MPI.MAX):
            raise ValueError("a Dirichlet condition holds on a node that is to be condensed")
        _check_any(free & ~inner, space, "there is nothing but inner and prescribed nodes")
        Q = _inner_flexibility(K, inner, block)
        kept = _selection(free & ~inner, offset)
        right, left = kept.copy(), kept.copy()
        different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        right.axpy(-1.0, Q.matMult(K.matMult(kept)), different)
        left.axpy(-1.0, Q.transposeMatMult(K.transposeMatMult(kept)), different)
        return cls(left, right, offset, Q)

    def under(self, K: PETSc.Mat, f: PETSc.Vec) -> "Reduction":
        """This reduction for a load f (n,) that acts on inner nodes, too."""
        if self.inner is None:
            return self
        unbalanced = reactions(K, self.offset, f)
        unbalanced.scale(-1.0)
        offset = self.offset.duplicate()
        self.inner.multAdd(unbalanced, self.offset, offset)
        return replace(self, offset=offset)

    def masked(self) -> "Reduction":
        """The same supports, the unknowns being numbered as before and zero where prescribed.

        Raises:
            ValueError: if this reduction does more than prescribe values.
        """
        if self.supports is None:
            raise ValueError(NO_SUPPORTS)
        kept = _selection(self.supports.free, self.offset, renumbered=False)
        return replace(self, left=kept, right=kept)

    def supported(self, K: PETSc.Mat) -> PETSc.Mat:
        """What `matrix` is of `masked` supports, not assembled: ones where values are prescribed.

        Raises:
            ValueError: as `masked` says.
        """
        if self.supports is None:
            raise ValueError(NO_SUPPORTS)
        projection = Projection(self.supports.free, self.supports.space.dofmap.index_map_bs)
        return python_matrix(K.getSizes(), Masked(K, projection), K.comm)

    def guyan(self, left: Literal["transposed", "same"]) -> "Reduction":
        """This condensation for mass matrices, where two left matrices L are in use.

        Args:
            left: "transposed" is this L, from the transposed problem; "same" takes R for L, the
                recipe of symmetric codes. L^T K R is the same, since K R vanishes in the inner
                rows; L^T M R is not.

        Raises:
            ValueError: for another name.
        """
        if left not in ("transposed", "same"):
            raise ValueError(f'left matrix {left!r}: the names are "transposed" and "same"')
        return self if left == "transposed" else replace(self, left=self.right)

    def matrix(self, K: PETSc.Mat) -> PETSc.Mat:
        """L^T K R."""
        reduced = self.left.transposeMatMult(unblocked(K).matMult(self.right))
        reduced.setAttr("form", K.getAttr("form"))
        return reduced

    def load(self, K: PETSc.Mat, f: PETSc.Vec) -> PETSc.Vec:
        """L^T (f - K a_0)."""
        remainder = K.createVecLeft()
        K.mult(self.offset, remainder)
        remainder.aypx(-1.0, f)
        reduced = self.left.createVecRight()
        self.left.multTranspose(remainder, reduced)
        return reduced

    def expand(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """R a_r + a_0."""
        full = self.offset.duplicate()
        self.right.multAdd(reduced, self.offset, full)
        return full

    def expand_mode(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """R a_r: a mode, which vanishes where values are prescribed."""
        full = self.offset.duplicate()
        self.right.mult(reduced, full)
        return full

    def shape(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """The old name of `expand_mode`."""
        warnings.warn("Reduction.shape is now called expand_mode", DeprecationWarning, stacklevel=2)
        return self.expand_mode(reduced)

    def then(self, inner: "Reduction") -> "Reduction":
        """This reduction followed by another one of the reduced system."""
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
        )


def solve(K: PETSc.Mat, f: PETSc.Vec, reduction: Reduction, solver: Solver = None) -> PETSc.Vec:
    """Displacements a (n,) of K a = f under a reduction.

    The vector's attribute "report", `a.getAttr("report")`, is the `SolverReport`.

    Args:
        K: stiffness (n, n), all rows and columns free.
        f: load (n,).
        reduction: supports, condensation.
        solver: `Direct()`, `Iterative()`, or "auto" for the latter in space from 15 000 unknowns
            on, which is taken unless one is given.

    Raises:
        SingularSystem: if the reduced system has no unique solution.
        SolverNotConverged: if an iterative solver does not come near enough to it.
        ValueError: if the load is not finite, or the solver does not serve the reduction.
    """
    taken = chosen(solver, reduction.supports)
    if isinstance(taken, Iterative):
        reduction = reduction.masked()
    reduction = reduction.under(K, f)
    load = reduction.load(K, f)
    if not is_finite(load):
        raise ValueError("the load vector or a prescribed value is not finite")
    if isinstance(taken, Iterative):
        prepared = ready(taken.prepare(K, supports=reduction.supports))
        solution = prepared.solve(load)
    else:
        matrix = reduction.matrix(K)
        prepared = factorise(matrix, solver=taken)
        solution = load.duplicate()
        prepared.ksp.solve(load, solution)
        _check_residual(matrix, solution, load)
    prepared.ksp.destroy()
    full = reduction.expand(solution)
    full.setAttr("report", prepared.report)
    return full


def reactions(K: PETSc.Mat, a: PETSc.Vec, f: PETSc.Vec) -> PETSc.Vec:
    """Nodal forces r = K a - f (n,) that supports exert on the body."""
    r = f.duplicate()
    K.mult(a, r)
    r.axpy(-1.0, f)
    return r


def symmetric_part(matrix: PETSc.Mat) -> PETSc.Mat:
    """(A + A^T) / 2: what a symmetric solver makes of an unsymmetric element's matrix."""
    part = matrix.copy()
    part.axpy(1.0, matrix.transpose(PETSc.Mat()), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    part.scale(0.5)
    part.setAttr("form", matrix.getAttr("form"))
    return part


def unblocked(matrix: PETSc.Mat) -> PETSc.Mat:
    """The matrix, or a copy of one stored in blocks, in the format that products need."""
    if not is_blocked(matrix):
        return matrix
    converted = matrix.convert("aij", PETSc.Mat())
    converted.setAttr("form", matrix.getAttr("form"))
    return converted


def factorise(
    matrix: PETSc.Mat, symmetric: bool = False, solver: LinearSolver | None = None
) -> PreparedSolver:
    """A solver that is ready for a regular matrix (n, n): MUMPS' factors unless another is given.

    Raises:
        SingularSystem: if a known solution does not come back, or a pivot is zero.
    """
    return ready((solver or Direct()).prepare(matrix, symmetric))


def ready(prepared: PreparedSolver) -> PreparedSolver:
    """A solver that has been set up.

    Raises:
        SingularSystem: if its matrix is singular.
    """
    try:
        prepared.set_up()
    except SingularSystem as error:
        prepared.ksp.destroy()
        raise SingularSystem(
            f"{error}: the supports leave a rigid motion free, a node has no stiffness, or the "
            "body is far too slender; add Dirichlet conditions"
        ) from None
    return prepared


def is_finite(vector: PETSc.Vec) -> bool:
    """Whether all entries on all processes are finite: a norm's maximum may pass over NaN."""
    own = int(np.isfinite(vector.array_r).all())
    return bool(vector.comm.tompi4py().allreduce(own, MPI.MIN))


def _check_rank(form: ufl.Form, arguments: int, of: str) -> None:
    found = len(form.arguments())
    if found != arguments:
        kinds = {0: "a number (no test function)", 1: "linear", 2: "bilinear"}
        raise ValueError(
            f"{of} needs a {kinds[arguments]} form; this one is {kinds.get(found, found)}"
        )


def _check_residual(matrix: PETSc.Mat, solution: PETSc.Vec, load: PETSc.Vec) -> None:
    residual = load.duplicate()
    matrix.mult(solution, residual)
    residual.axpy(-1.0, load)
    scale = matrix.norm(PETSc.NormType.INFINITY) * solution.norm(PETSc.NormType.INFINITY)
    scale += load.norm(PETSc.NormType.INFINITY)
    if scale > 0 and not residual.norm(PETSc.NormType.INFINITY) <= _RESIDUAL * scale:
        raise SingularSystem(
            f"the direct solver left the relative residual "
            f"{residual.norm(PETSc.NormType.INFINITY) / scale:.1e}: the matrix is too badly "
            "conditioned; check supports and units"
        )


def _prescribed(
    space: fem.FunctionSpace, conditions: Sequence[fem.DirichletBC]
) -> tuple[npt.NDArray[np.bool_], PETSc.Vec]:
    """Which owned degrees of freedom are free, and the prescribed values (zero where free).

    Raises:
        ValueError: if a prescribed value is not finite, or a condition is another space's.
    """
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    owned = index_map.size_local * block
    values = np.zeros(owned + index_map.num_ghosts * block)
    free = np.ones(owned, dtype=bool)
    for condition in conditions:
        _check_space(condition, space)
        dofs = condition.dof_indices()[0]  # the number of owned ones is wrong in DOLFINx 0.9
        free[dofs[dofs < owned]] = False
        condition.set(values)
    comm = space.mesh.comm
    if not comm.allreduce(int(np.isfinite(values[:owned]).all()), MPI.MIN):
        raise ValueError("a prescribed value is not a finite number")
    offset = PETSc.Vec().createMPI((owned, index_map.size_global * block), comm=comm)
    offset.setArray(values[:owned])
    return free, offset


def _check_space(condition: fem.DirichletBC, space: fem.FunctionSpace) -> None:
    """Raises ValueError for a condition on another mesh, or on a space with other nodes."""
    theirs = condition.function_space
    other, own = theirs.dofmap.index_map, space.dofmap.index_map
    same_nodes = (other.size_global, other.size_local) == (own.size_global, own.size_local)
    if theirs.mesh is not space.mesh._cpp_object or not same_nodes:
        raise ValueError(
            "a Dirichlet condition was made on another space: its degrees of freedom would be "
            "taken for others here; make it on the trial space"
        )


def _check_any(chosen: npt.NDArray[np.bool_], space: fem.FunctionSpace, otherwise: str) -> None:
    if space.mesh.comm.allreduce(int(chosen.sum()), MPI.SUM) == 0:
        raise ValueError(otherwise)


def _inner_flexibility(K: PETSc.Mat, inner: npt.NDArray[np.bool_], block: int) -> PETSc.Mat:
    """Q (n, n): inverse of K_ii, whose blocks belong to one node each, and zeros.

    Raises:
        ValueError: if K couples inner nodes.
        SingularSystem: if a block is singular.
    """
    comm: MPI.Comm = K.comm.tompi4py()
    chosen = _selection(inner, K.createVecLeft())
    K_ii = chosen.transposeMatMult(K.matMult(chosen))
    first, last = K_ii.getOwnershipRange()
    indptr, column, value = K_ii.getValuesCSR()
    row = np.repeat(np.arange(first, last), np.diff(indptr))
    own = row // block == column // block
    blocks = np.zeros(((last - first) // block, block, block))
    blocks[(row[own] - first) // block, row[own] % block, column[own] % block] = value[own]
    size = np.abs(blocks).max(initial=0.0)
    coupling = np.abs(value[~own]).max(initial=0.0)
    if comm.allreduce(coupling, MPI.MAX) > _ROUND_OFF * comm.allreduce(size, MPI.MAX):
        raise ValueError(
            "the stiffness couples nodes that are to be condensed: no two of them may share a cell"
        )
    singular = bool(len(blocks)) and not np.all(np.linalg.cond(blocks) < 1 / _ROUND_OFF)
    if comm.allreduce(int(singular), MPI.MAX):
        raise SingularSystem("a node that is to be condensed has no stiffness")
    inverse = np.linalg.inv(blocks)

    width = np.where(inner, block, 0)
    indptr = np.concatenate(([0], np.cumsum(width))).astype(PETSc.IntType)
    dofs = np.flatnonzero(inner).reshape(-1, block) + K.getOwnershipRange()[0]
    indices = np.repeat(dofs, block, axis=0).ravel().astype(PETSc.IntType)
    return PETSc.Mat().createAIJ(K.getSizes(), csr=(indptr, indices, inverse.ravel()), comm=comm)


def _selection(free: np.ndarray, rows: PETSc.Vec, renumbered: bool = True) -> PETSc.Mat:
    """Columns of the identity that belong to the free ones of the owned rows.

    Those of the others are left out, or else zero.
    """
    comm = rows.comm.tompi4py()
    count = int(free.sum()) if renumbered else len(free)
    first = comm.scan(count) - count
    indptr = np.concatenate(([0], np.cumsum(free))).astype(PETSc.IntType)
    columns = np.arange(count) if renumbered else np.flatnonzero(free)
    return PETSc.Mat().createAIJ(
        (rows.getSizes(), (count, PETSc.DETERMINE)),
        csr=(indptr, (first + columns).astype(PETSc.IntType), np.ones(len(columns))),
        comm=rows.comm,
    )

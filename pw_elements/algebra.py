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

from pw_elements import arguments
from pw_elements.collective import collective
from pw_elements.hybrid import (
    FREE_PRESSURE,
    NOTHING,
    SubSpace,
    equilibration,
    fields_of,
    is_hybrid,
    is_split,
    positions,
    tied,
)
from pw_elements.iterative import NO_SUPPORTS, Iterative, Solver, chosen
from pw_elements.linear_solver import Direct, LinearSolver, PreparedSolver, SingularSystem
from pw_elements.mesh_checks import listed
from pw_elements.multigrid import Masked, Projection, Supports, is_blocked, python_matrix
from pw_elements.parts import numbered
from pw_elements.problem import Problem, check_reduction
from pw_elements.progress import doing
from pw_elements.quadrature import with_cell_rules
from pw_elements.spaces import Spaces

# Backward error of a direct solve is some round-offs; above this the factorisation went wrong.
_RESIDUAL = 1e-10
# Largest difference of values that are prescribed as the same, over the largest of them
_SAME_VALUE = 1e-9
# Entries of a matrix below this, over its largest, are zeros
_ROUND_OFF = 1e-13


def assemble_matrix(form: ufl.Form, blocked: bool = False) -> PETSc.Mat:
    """Matrix of a bilinear form, all rows and columns free.

    Integrals over tetrahedra with piecewise-linear functions get the rule these need. The form
    (and by it mesh and spaces) lives as long as the matrix.

    Args:
        form: of trial and test functions.
        blocked: stores a vector field's matrix by nodes (PETSc's BAIJ), in 0.7 of the memory, as
            `Iterative` needs it: another format is copied by it. Everything else converts it.

    Raises:
        TypeError: if it is no UFL form.
        ValueError: if it is not bilinear, cannot be compiled, or has a measure that names a rule
            that is wrong for it.
    """
    compiled = compiled_form(form, 2, "a matrix")
    matrix = create_matrix(compiled, "baij" if blocked else None)
    _assemble_matrix(matrix, compiled)
    matrix.assemble()
    matrix.setAttr("form", compiled)
    return matrix


def assemble_vector(form: ufl.Form) -> PETSc.Vec:
    """Vector (n,) of a linear form, contributions of all processes added.

    Integrals over tetrahedra with piecewise-linear functions get the rule these need.

    Args:
        form: of a test function.

    Raises:
        TypeError: if it is no UFL form.
        ValueError: if it is not linear, cannot be compiled, or has a measure that names a rule
            that is wrong for it.
    """
    compiled = compiled_form(form, 1, "a vector")
    vector = _assemble_vector(compiled)
    vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    vector.setAttr("form", compiled)
    return vector


def assemble_scalar(form: ufl.Form) -> float:
    """Value of a functional (an energy, an error's square), summed over all processes.

        area = assemble_scalar(1.0 * boundary_measure(mesh, where))

    Integrals over tetrahedra with piecewise-linear functions get the rule these need.

    Args:
        form: without arguments.

    Raises:
        TypeError: if it is no UFL form.
        ValueError: if it has a test function, belongs to no mesh, cannot be compiled, or has a
            measure that names a rule that is wrong for it.
    """
    compiled = compiled_form(form, 0, "a functional")
    return float(compiled.mesh.comm.allreduce(fem.assemble_scalar(compiled), MPI.SUM))


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
        space: trial space whose degrees of freedom are reduced, if it is known.
        supports: what `dirichlet` was told, which an iterative solver needs; None of others.

    Raises:
        TypeError: for what is no matrix or vector.
        ValueError: for sizes that do not go together.
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
        """Drops the prescribed degrees of freedom.

        Args:
            space: trial space, or both spaces; these tie the pressure within each part of a body
                where it is split, see `Spaces.hybrid`.
            conditions: made on it; a single one needs no list.

        Raises:
            TypeError: for what is no space, or are no conditions.
            ValueError: if they leave nothing free or contradict each other, a prescribed value is
                not finite, or a condition was made on another space.
        """
        parts = None
        if isinstance(space, Spaces):
            space, parts = space.trial, space.parts
        free, offset = prescribed(space, conditions)
        _check_any(free, space, "the Dirichlet conditions leave no degree of freedom free")
        if is_split(space):
            selection = tied(space, parts, free)
            return cls(selection, selection, offset, space=space)
        selection = _selection(free, offset)
        return cls(selection, selection, offset, space=space, supports=Supports(space, free))

    @classmethod
    def condensation(
        cls,
        K: PETSc.Mat,
        space: fem.FunctionSpace,
        nodes: npt.NDArray[np.integer] | npt.NDArray[np.bool_],
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC] = (),
    ) -> "Reduction":
        """Condenses inner nodes statically, and drops prescribed degrees of freedom.

        Args:
            K: stiffness (n, n), free; it may be unsymmetric.
            space: trial space.
            nodes: local numbers of the inner nodes, or a mask of these (ghosts are passed over),
                no two of which share a cell: K_ii is inverted node by node.
            conditions: Dirichlet conditions on the other nodes; a single one needs no list.

        Raises:
            TypeError: for what is no matrix or space, or are no conditions.
            ValueError: if K is not of the space or not finite, couples inner nodes, a node is
                none of the space's, a condition holds on one or was made on another space,
                conditions contradict each other, nothing is left free, or a prescribed value is
                not finite.
            SingularSystem: if an inner node has no stiffness.
        """
        Problem({"the stiffness": K}, space=space)
        if is_hybrid(space):
            raise ValueError("nodes of hybrid spaces cannot be condensed: their pressures stay")
        K = unblocked(K)
        free, offset = prescribed(space, conditions)
        block, index_map = space.dofmap.index_map_bs, space.dofmap.index_map
        comm = space.mesh.comm
        inner = np.zeros(len(free), dtype=bool)
        with collective(comm):
            known = index_map.size_local + index_map.num_ghosts
            chosen = numbered(comm, "the nodes to be condensed", nodes, known)
            inner.reshape(-1, block)[chosen[chosen < index_map.size_local]] = True
            if np.any(inner & ~free):
                raise ValueError("a Dirichlet condition holds on a node that is to be condensed")
        _check_any(free & ~inner, space, "there is nothing but inner and prescribed nodes")
        Q = _inner_flexibility(K, inner, block)
        kept = _selection(free & ~inner, offset)
        right, left = kept.copy(), kept.copy()
        different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        right.axpy(-1.0, Q.matMult(K.matMult(kept)), different)
        left.axpy(-1.0, Q.transposeMatMult(K.transposeMatMult(kept)), different)
        return cls(left, right, offset, Q, space)

    def under(self, K: PETSc.Mat, f: PETSc.Vec) -> "Reduction":
        """This reduction for a load f (n,) that acts on inner nodes, too.

        Raises:
            TypeError, ValueError: if K and f do not go with the reduction.
        """
        self._check_system(K, f)
        if self.inner is None:
            return self
        unbalanced = _unbalanced(K, self.offset, f)
        unbalanced.scale(-1.0)
        offset = self.offset.duplicate()
        self.inner.multAdd(unbalanced, self.offset, offset)
        return replace(self, offset=offset)

    def scaled(self, share: float) -> "Reduction":
        """This reduction with a share of the prescribed values."""
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

    def equilibrated(self, K: PETSc.Mat) -> "Reduction":
        """This reduction with pressures of hybrid spaces scaled to be of a displacement's size.

        In consistent units displacement and pressure may be 15 powers of ten apart: factors and
        Krylov methods would lose one of them. What `expand` gives is the same.
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
            ValueError: for another name.
        """
        if left not in ("transposed", "same"):
            raise ValueError(f'left matrix {left!r}: the names are "transposed" and "same"')
        return self if left == "transposed" else replace(self, left=self.right)

    def matrix(self, K: PETSc.Mat) -> PETSc.Mat:
        """L^T K R.

        Raises:
            TypeError, ValueError: if K is no matrix that goes with the reduction.
        """
        self._check_system(K)
        reduced = self.left.transposeMatMult(unblocked(K).matMult(self.right))
        reduced.setAttr("form", K.getAttr("form"))
        return reduced

    def load(self, K: PETSc.Mat, f: PETSc.Vec) -> PETSc.Vec:
        """L^T (f - K a_0).

        Raises:
            TypeError, ValueError: if K and f do not go with the reduction.
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

        Raises:
            TypeError, ValueError: if a_r is no vector (n_r,).
        """
        self._check_reduced(reduced)
        full = self.offset.duplicate()
        self.right.multAdd(reduced, self.offset, full)
        return full

    def expand_mode(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """R a_r: a mode, which vanishes where values are prescribed.

        Raises:
            TypeError, ValueError: if a_r is no vector (n_r,).
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

        Raises:
            TypeError, ValueError: if that is no reduction of it.
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
        TypeError, ValueError: for things that do not make one problem, see `problem.Problem`, or
            a solver that does not serve the reduction.
    """
    Problem({"the stiffness": K}, loads={"the load": f}, reductions=(reduction,), solver=solver)
    taken = chosen(solver, reduction.supports)
    if isinstance(taken, Iterative):
        reduction = reduction.masked()
    reduction = reduction.equilibrated(K).under(K, f)
    load = reduction.load(K, f)
    if isinstance(taken, Iterative):
        prepared = ready(taken.prepare(K, supports=reduction.supports))
        solution = prepared.solve(load)
    else:
        matrix = reduction.matrix(K)
        prepared = factorise(matrix, solver=taken, reduction=reduction)
        solution = load.duplicate()
        prepared.ksp.solve(load, solution)
        _check_residual(matrix, solution, load)
    prepared.ksp.destroy()
    full = reduction.expand(solution)
    full.setAttr("report", prepared.report)
    return full


def reactions(K: PETSc.Mat, a: PETSc.Vec, f: PETSc.Vec) -> PETSc.Vec:
    """Nodal forces r = K a - f (n,) that supports exert on the body.

    Args:
        K: stiffness (n, n), all rows and columns free.
        a: displacement (n,).
        f: load (n,).

    Raises:
        TypeError, ValueError: for things that do not go together, see `problem.Problem`.
    """
    Problem({"the stiffness": K}, {"the displacement": a}, {"the load": f})
    return _unbalanced(K, a, f)


def _unbalanced(K: PETSc.Mat, a: PETSc.Vec, f: PETSc.Vec) -> PETSc.Vec:
    r = f.duplicate()
    K.mult(a, r)
    r.axpy(-1.0, f)
    return r


def free_pressure(
    matrix: PETSc.Mat, reduction: Reduction, beside: npt.NDArray[np.integer] | None = None
) -> bool:
    """Whether a constant pressure of a hybrid space acts on no displacement.

    Args:
        matrix: the stiffness under the reduction.
        reduction: of hybrid or other spaces.
        beside: this process' own local numbers of reduced equations that do not count.
    """
    if reduction.space is None or not is_hybrid(reduction.space):
        return False
    pressure = SubSpace.pressure(reduction.space)
    constant = reduction.offset.duplicate()
    constant.setArray(pressure.spread(np.ones(len(pressure.owned))))
    unknown, effect = matrix.createVecRight(), matrix.createVecLeft()
    reduction.right.multTranspose(constant, unknown)
    unknown.setArray(np.array(unknown.array_r != 0, dtype=float))  # several may be tied
    matrix.mult(unknown, effect)
    if beside is not None:
        effect.array[beside] = 0.0
    largest = PETSc.NormType.INFINITY
    size = matrix.norm(largest) * unknown.norm(largest)
    return bool(size > 0 and effect.norm(largest) <= NOTHING * size)


def symmetric_part(matrix: PETSc.Mat) -> PETSc.Mat:
    """(A + A^T) / 2: what a symmetric solver makes of an unsymmetric element's matrix.

    Args:
        matrix: A, (n, n); it stays as it is.

    Raises:
        TypeError, ValueError: if it is no square matrix.
    """
    with collective(arguments.processes(matrix)):
        arguments.matrix("the matrix", matrix)
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
    matrix: PETSc.Mat,
    symmetric: bool = False,
    solver: LinearSolver | None = None,
    reduction: Reduction | None = None,
) -> PreparedSolver:
    """A solver that is ready for a regular matrix (n, n): MUMPS' factors unless another is given.

    Args:
        matrix: to be factorised.
        symmetric: whether LDL^T will do.
        solver: another one.
        reduction: by which the matrix was made, that of hybrid spaces say, for better words.

    Raises:
        SingularSystem: if a known solution does not come back, or a pivot is zero.
    """
    try:
        return ready((solver or Direct()).prepare(matrix, symmetric))
    except SingularSystem:
        if reduction is not None and free_pressure(matrix, reduction):
            raise SingularSystem(FREE_PRESSURE) from None
        raise


def ready(prepared: PreparedSolver) -> PreparedSolver:
    """A solver that has been set up.

    Raises:
        SingularSystem: if its matrix is singular.
    """
    try:
        prepared.set_up()
    except SingularSystem as error:
        prepared.ksp.destroy()
        if str(error) == FREE_PRESSURE:
            raise
        raise SingularSystem(
            f"{error}: the supports leave a rigid motion free, a node has no stiffness, or the "
            "body is far too slender; add Dirichlet conditions"
        ) from None
    return prepared


def compiled_form(form: ufl.Form, rank: int, of: str) -> fem.Form:
    """A form of the right rank on one mesh, compiled."""
    arguments.of_type("the form", form, ufl.Form, "an integrand times a measure makes a ufl.Form")
    kinds = {0: "a number (no test function)", 1: "linear", 2: "bilinear"}
    found = len(form.arguments())
    if found != rank:
        needed = f"a {kinds[rank]} form" if rank else "a form without test functions"
        raise ValueError(f"{of} needs {needed}; this one is {kinds.get(found, found)}")
    spaces = [argument.ufl_function_space() for argument in form.arguments()]
    for space in spaces:
        arguments.space(space, "the space of a form's argument")
    functions = [f for f in form.coefficients() if isinstance(f, fem.Function)]
    meshes = [thing.mesh for thing in (*spaces, *(f.function_space for f in functions))]
    domains = form.ufl_domains()
    if any(mesh is not meshes[0] for mesh in meshes) or len(domains) != 1:
        raise ValueError("the form mixes meshes: its functions and measures have to share one")
    if (mesh := domains[0].ufl_cargo()) is None:
        raise ValueError("the form belongs to no mesh: give its measure a domain")
    ruled = with_cell_rules(form)
    try:
        with doing(mesh.comm, "compiling a form"):
            return fem.form(ruled)
    except Exception as error:
        raise ValueError(f"the form cannot be compiled: {error}") from error


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


def prescribed(
    space: fem.FunctionSpace, conditions: fem.DirichletBC | Sequence[fem.DirichletBC]
) -> tuple[npt.NDArray[np.bool_], PETSc.Vec]:
    """Which owned degrees of freedom are free, and the prescribed values (zero where free).

    Raises:
        TypeError: for what is no space, or are no conditions.
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
    size = comm.allreduce(np.abs(blocks).max(initial=0.0), MPI.MAX)
    with collective(comm):
        if not np.isfinite(value).all():
            raise ValueError("the stiffness of a node that is to be condensed is not finite")
        if np.abs(value[~own]).max(initial=0.0) > _ROUND_OFF * size:
            raise ValueError(
                "the stiffness couples nodes that are to be condensed: no two of them may share a "
                "cell"
            )
        if len(blocks) and not np.all(np.linalg.cond(blocks) < 1 / _ROUND_OFF):
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

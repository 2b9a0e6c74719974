"""Linear problems of nearly incompressible bodies: manufactured solutions, Cook's membrane, layers.

The stability of the mixed formulation is measured by its inf-sup constant.
"""

from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    Mesh,
    MeshTags,
    compute_midpoints,
    create_unit_cube,
    create_unit_square,
    meshtags,
)
from scipy.sparse.linalg import LinearOperator, eigs
from ufl.core.expr import Expr

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    force_transfer,
    prescribe,
    solve,
    split,
)
from pw_elements.algebra import factorise
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes, triangles
from pw_elements.spaces import SubSpace
from study.meshes.distorted_meshes import (
    CELL_TYPE_BY_ELEMENT_SUFFIX,
    mesh_distorted_unit_grid,
    mesh_unit_square_or_cube,
)
from study.meshes.distortion import distort_unit_domain_smoothly
from study.meshes.mesh_families import mean_cell_size
from study.model.discretisation import (
    collapsed_displacement_space,
    make_element_spaces,
    prescribe_node_displacements,
)
from study.model.elements import taylor_hood_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.manufactured import (
    plane,
    plane_pressure,
    solid,
    spatial_field_of_bounded_pressure,
)

Array = npt.NDArray[np.float64]

YOUNGS_MODULUS = 1.0
DEGREE = 8
"""Degree of quadrature of integrals of exact fields."""


# Known fields


def square(element: str, nu: float, n: int) -> Result:
    """Return errors of a manufactured solution in a unit square in plane strain.

    Args:
        element: Element name such as "pw-hybrid-T6".
        nu: Poisson's ratio.
        n: Number of cells along a side.
    """
    return _measure_errors_of_manufactured_solution(element, nu, n)


def cube(element: str, nu: float, n: int) -> Result:
    """Return errors of a manufactured solution in a unit cube.

    Args:
        element: Element name such as "pw-hybrid-T10".
        nu: Poisson's ratio.
        n: Number of cells along a side.
    """
    return _measure_errors_of_manufactured_solution(element, nu, n)


def enclosed(element: str, nu: float, n: int) -> Result:
    """Return errors of a manufactured solution in a unit cube that is supported on all sides.

    The exact displacements, and no tractions, are prescribed on all sides.

    Args:
        element: Element name such as "pw-hybrid-T10".
        nu: Poisson's ratio.
        n: Number of cells along a side.
    """
    return _measure_errors_of_manufactured_solution(element, nu, n, prescribes_all_sides=True)


@dataclass(frozen=True)
class ManufacturedDisplacementAndPressure:
    """Manufactured displacement and pressure that stay bounded as Poisson's ratio approaches 1/2.

    The displacement is a solenoidal field plus g/lambda, with Lamé's first constant lambda; the
    pressure is therefore -div g.

    Args:
        body: Body on whose mesh the fields are evaluated.
        nu: Poisson's ratio.
    """

    body: Body
    nu: float

    def displacement_expression(self) -> Expr:
        """Return the exact displacement as a UFL expression."""
        field = solid if self.body.spaces.mesh.geometry.dim == 3 else plane
        return ufl.as_vector(
            field(ufl, self._x(), self._make_constant(self.reciprocal_lame_constant))
        )

    def pressure_expression(self) -> Expr:
        """Return the exact pressure -lambda div u as a UFL expression."""
        field = (
            spatial_field_of_bounded_pressure
            if self.body.spaces.mesh.geometry.dim == 3
            else plane_pressure
        )
        return -ufl.div(ufl.as_vector(field(ufl, self._x(), self._make_constant(1.0))))

    def stress_expression(self) -> Expr:
        """Return the exact stress 2 mu eps(u) - p I as a UFL expression."""
        u, p = self.displacement_expression(), self.pressure_expression()
        mu = self._make_constant(YOUNGS_MODULUS / (2 * (1 + self.nu)))
        return 2 * mu * ufl.sym(ufl.grad(u)) - p * ufl.Identity(len(u))

    @property
    def reciprocal_lame_constant(self) -> float:
        """Reciprocal 1/lambda of Lamé's first constant."""
        return (1 + self.nu) * (1 - 2 * self.nu) / (YOUNGS_MODULUS * self.nu)

    def evaluate_displacement(self, x: Array) -> Array:
        """Return displacements (n, dim) at points (n, 3)."""
        field = solid if self.body.spaces.mesh.geometry.dim == 3 else plane
        return np.column_stack(field(np, x.T, self.reciprocal_lame_constant))

    def _x(self) -> Expr:
        return ufl.SpatialCoordinate(self.body.spaces.mesh)

    def _make_constant(self, value: float) -> fem.Constant:
        return fem.Constant(self.body.spaces.mesh, value)


def _measure_errors_of_manufactured_solution(
    element: str, nu: float, n: int, prescribes_all_sides: bool = False
) -> Result:
    """Solve for a manufactured solution; return errors relative to the norms of the exact fields.

    Args:
        element: Element name.
        nu: Poisson's ratio.
        n: Number of cells along a side.
        prescribes_all_sides: Whether exact displacements are prescribed on all sides; otherwise
            they are prescribed on the bottom, and exact tractions on the other sides.
    """
    mesh = mesh_unit_square_or_cube(element, 1 / n)
    state = StressState.SOLID if mesh.geometry.dim == 3 else StressState.PLANE_STRAIN
    body = Body(make_element_spaces(element, mesh), Material(YOUNGS_MODULUS, nu), state)
    exact, W = ManufacturedDisplacementAndPressure(body, nu), body.spaces.trial
    load_body = Body(body.spaces, body.material, state, quadrature_degree=DEGREE)
    f = assemble_vector(load_body.body_load(-ufl.div(exact.stress_expression())))
    traction = exact.stress_expression() * ufl.FacetNormal(mesh)
    boundary = boundary_measure(mesh, lambda x: np.ones(x.shape[1], dtype=bool), DEGREE)
    f.axpy(1.0, assemble_vector(body.surface_load(traction, boundary)))
    K = assemble_matrix(body.stiffness())
    supports = Reduction.dirichlet(
        W, _prescribe_exact_displacements(W, exact, prescribes_all_sides)
    )
    u, p = _displacement_and_pressure_expressions(body, solve(K, f, supports))

    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": DEGREE})

    def l2_norm(value: Expr) -> float:
        return float(np.sqrt(fem.assemble_scalar(fem.form(ufl.inner(value, value) * dx))))

    exact_u, exact_p = exact.displacement_expression(), exact.pressure_expression()
    scalars = {
        "h1_error": l2_norm(ufl.grad(u - exact_u)) / l2_norm(ufl.grad(exact_u)),
        "l2_error": l2_norm(u - exact_u) / l2_norm(exact_u),
        "pressure_error": l2_norm(p - exact_p) / l2_norm(exact_p),
        "h": mean_cell_size(mesh),
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), {}, dofs=K.getSize()[0])


def _prescribe_exact_displacements(
    space: fem.FunctionSpace, exact: ManufacturedDisplacementAndPressure, prescribes_all_sides: bool
) -> fem.DirichletBC:
    """Prescribe the exact displacements on all sides if the flag is set, else on the bottom."""
    x = collapsed_displacement_space(space).tabulate_dof_coordinates()
    dim = space.mesh.geometry.dim
    is_held = np.isclose(x[:, 1], 0.0)
    if prescribes_all_sides:
        is_held = np.any(np.isclose(x[:, :dim], 0.0) | np.isclose(x[:, :dim], 1.0), axis=1)
    nodes = np.flatnonzero(is_held).astype(np.int32)
    return prescribe_node_displacements(space, nodes, exact.evaluate_displacement(x[nodes]))


def _displacement_and_pressure_expressions(
    body: Body, coefficients: PETSc.Vec
) -> tuple[Expr, Expr]:
    """Return displacement and pressure of a solution vector as UFL expressions.

    Without a pressure field, the pressure is -lambda div u.

    Args:
        body: Discretised body.
        coefficients: Solution vector.
    """
    if body.spaces.is_hybrid:
        return split(body.spaces.trial, coefficients)
    u = as_function(body.spaces.trial, coefficients)
    nu = body.material.poissons_ratio
    lame = YOUNGS_MODULUS * nu / ((1 + nu) * (1 - 2 * nu))
    return u, -lame * ufl.div(u)


# Cook's membrane


def cook(element: str, n: int, nu: float = 0.4999) -> Result:
    """Solve Cook's membrane in plane strain; return the dimensionless deflection of its tip.

    The scalar `tip` is E t / F times the vertical displacement of the upper right corner, with
    thickness t and total force F.

    Args:
        element: Element name such as "pw-hybrid-T6".
        n: Number of elements along a side.
        nu: Poisson's ratio.
    """

    def map_to_cook_trapezoid(x: Array) -> Array:
        return np.column_stack(
            [48 * x[:, 0], 44 * x[:, 0] + x[:, 1] * (44 - 28 * x[:, 0]), x[:, 2]]
        )

    mesh = move_nodes(
        triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (n, n)), map_to_cook_trapezoid
    )
    body = Body(
        make_element_spaces(element, mesh), Material(YOUNGS_MODULUS, nu), StressState.PLANE_STRAIN
    )
    W = body.spaces.trial
    clamp = [prescribe(W, k, lambda x: np.isclose(x[0], 0.0)) for k in (0, 1)]
    right_side = boundary_measure(mesh, lambda x: np.isclose(x[0], 48.0))
    f = assemble_vector(body.surface_load((0.0, 1 / 16), right_side))  # a force of 1
    K = assemble_matrix(body.stiffness())
    u, _ = _displacement_and_pressure_expressions(body, solve(K, f, Reduction.dirichlet(W, clamp)))
    x = collapsed_displacement_space(W).tabulate_dof_coordinates()
    upper_corner = np.flatnonzero(np.isclose(x[:, 0], 48.0) & np.isclose(x[:, 1], 60.0))
    scalars = {"tip": float(u.x.array.reshape(-1, 2)[upper_corner[0], 1])}
    return Result(scalars, assign_unit_one_to_scalars(scalars), {}, dofs=K.getSize()[0])


# Layers: strain and pressure are constant in each layer, and the pressure jumps between them.
# Elements whose pressure is split there are exact; those with a continuous pressure are not.

LAYER_CELLS_PER_SIDE = 4
"""Number of cells along a side."""
LAYER_YOUNGS_MODULI, LAYER_POISSONS_RATIOS = np.array([2.0, 20.0]), np.array([0.4999, 0.3])
"""Young's moduli and Poisson's ratios of the lower and the upper layer."""


def layers(element: str) -> Result:
    """Press two layers of different materials uniformly between smooth rigid walls.

    The scalars are the largest errors of a displacement component over the largest displacement:
    `error` with a pressure that may be discontinuous between the layers, `error_one` with a
    continuous pressure.

    Args:
        element: Name of a hybrid element such as "pw-hybrid-T6".
    """
    make_spaces = Spaces.hybrid if element.startswith("pw") else taylor_hood_spaces
    mesh = make_distorted_two_layer_mesh(
        MPI.COMM_SELF, CELL_TYPE_BY_ELEMENT_SUFFIX[element.rsplit("-", 1)[1]]
    )
    scalars = {
        name: largest_displacement_error_of_two_layers(make_spaces, mesh, name == "error")
        for name in ("error", "error_one")
    }
    dofmap = make_spaces(mesh, None).trial.dofmap
    dofs = dofmap.index_map.size_global * dofmap.index_map_bs
    return Result(scalars, assign_unit_one_to_scalars(scalars), {}, dofs=dofs)


def make_distorted_two_layer_mesh(comm: MPI.Comm, cell: CellType) -> Mesh:
    """Make a distorted mesh of a unit square or cube that consists of two layers.

    All inner nodes are moved, except those between the layers.

    Args:
        comm: MPI communicator of the mesh.
        cell: Cell type.
    """
    n = LAYER_CELLS_PER_SIDE
    if cell in (CellType.triangle, CellType.quadrilateral):
        return move_nodes(
            create_unit_square(comm, n, n, cell), _distort_mesh_keeping_layer_interface
        )
    return move_nodes(create_unit_cube(comm, n, n, n, cell), _distort_mesh_keeping_layer_interface)


def largest_displacement_error_of_two_layers(
    make_spaces: Callable[[Mesh, MeshTags | None], Spaces], mesh: Mesh, has_pressure_jump: bool
) -> float:
    """Return the largest displacement error of two pressed layers, over the largest displacement.

    Args:
        make_spaces: Function that makes hybrid spaces from a mesh and the tags of cells between
            which the pressure may jump, or None.
        mesh: Mesh of the unit square or cube; the layers meet at half of the height.
        has_pressure_jump: Whether the pressure may be discontinuous between the layers.
    """
    dim = mesh.geometry.dim
    up = dim - 1
    index_map = mesh.topology.index_map(dim)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    layer = (compute_midpoints(mesh, dim, cells)[:, up] > 0.5).astype(np.int32)
    E, nu = (fem.Function(fem.functionspace(mesh, ("DG", 0))) for _ in range(2))
    E.x.array[:], nu.x.array[:] = LAYER_YOUNGS_MODULI[layer], LAYER_POISSONS_RATIOS[layer]
    pair = make_spaces(mesh, meshtags(mesh, dim, cells, layer) if has_pressure_jump else None)
    state = StressState.PLANE_STRAIN if dim == 2 else StressState.SOLID
    body = Body(pair, Material(E, nu), state)

    def make_side_marker(axis: int, coordinate: float) -> Callable[[Array], npt.NDArray[np.bool_]]:
        return lambda x: np.isclose(x[axis], coordinate)

    W = pair.trial
    walls = [prescribe(W, k, make_side_marker(k, end)) for k in range(up) for end in (0.0, 1.0)]
    supports = Reduction.dirichlet(pair, [*walls, prescribe(W, up, make_side_marker(up, 0.0))])
    traction = np.zeros(dim)
    traction[up] = -1.0
    f = assemble_vector(
        body.surface_load(traction, boundary_measure(mesh, make_side_marker(up, 1.0)))
    )
    u, _ = split(W, solve(assemble_matrix(body.stiffness()), f, supports))
    nu_factor = (1 + LAYER_POISSONS_RATIOS) * (1 - 2 * LAYER_POISSONS_RATIOS)
    strain = nu_factor / ((1 - LAYER_POISSONS_RATIOS) * LAYER_YOUNGS_MODULI)
    z = u.function_space.tabulate_dof_coordinates()[:, up]
    exact = np.zeros((len(z), dim))
    exact[:, up] = -np.minimum(z, 0.5) * strain[0] - np.maximum(z - 0.5, 0.0) * strain[1]
    error = np.abs(u.x.array.reshape(-1, dim) - exact).max(initial=0.0)
    largest = mesh.comm.allreduce(np.abs(exact).max(initial=0.0), MPI.MAX)
    return float(mesh.comm.allreduce(error, MPI.MAX) / largest)


def _distort_mesh_keeping_layer_interface(x: Array) -> Array:
    """Move inner points (n, 3) of the unit square or cube, except those between the layers."""
    dim = 3 if x[:, 2].any() else 2
    x_moved = x[:, :dim]
    n_half_waves = np.array([1.0, 1.0, 2.0])[-dim:]
    bubble = np.prod(np.sin(np.pi * n_half_waves * x_moved), axis=1, keepdims=True)
    position = x.copy()
    position[:, :dim] += 0.06 * bubble * np.cos(2 * x_moved + np.arange(dim))
    return position


# Stability: trial and weight functions may each form a stable pair with the pressure without being
# stable together. The inf-sup constant is the infimum, over all (u, p) of norm one, of the supremum
# over (w, q) of b((u, p), (w, q)) / |(w, q)|, where
#
#     b = int 2 mu eps(u) : eps(w) - p div w - q div u,
#     |(u, p)|^2 = int 2 mu eps(u) : eps(u) + p^2 / (2 mu),
#
# at nu = 1/2. It is the smallest singular value of the matrix of b between the two norms.

SHEAR_MODULUS = 1.0


def infsup(element: str, n: int) -> Result:
    """Return the inf-sup constant of a mixed element on a unit square or cube with a fixed base.

    Args:
        element: Name of a hybrid element such as "pw-hybrid-T6".
        n: Number of cells along a side.
    """
    mesh = mesh_distorted_unit_grid(element, n)
    state = StressState.SOLID if mesh.geometry.dim == 3 else StressState.PLANE_STRAIN
    body = Body(make_element_spaces(element, mesh), Material(3 * SHEAR_MODULUS, 0.5), state)
    W, dim = body.spaces.trial, mesh.geometry.dim
    base = [prescribe(W, k, lambda x: np.isclose(x[dim - 1], 0.0)) for k in range(dim)]
    supports = Reduction.dirichlet(W, base)
    b = supports.matrix(assemble_matrix(body.stiffness()))
    trial_gram, weight_gram = (
        supports.matrix(assemble_matrix(_inner_product_of_displacement_and_pressure(body, space)))
        for space in (W, body.spaces.test)
    )
    scalars = {"inf_sup": _smallest_singular_value_between_norms(b, trial_gram, weight_gram)}
    return Result(scalars, assign_unit_one_to_scalars(scalars), {}, dofs=b.getSize()[0])


def identity(element: str) -> Result:
    """Return the relative difference of the stiffness K from T K_standard on a distorted square.

    The force-transfer matrix T acts on the equations of equilibrium and leaves the volume equations
    unchanged. The differences of both groups of rows are relative to the norm of these rows of K.

    Args:
        element: Name of a hybrid element with piecewise-linear test functions.
    """
    mesh = move_nodes(
        triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (6, 5)), distort_unit_domain_smoothly
    )
    bodies = [
        Body(make_element_spaces(name, mesh), Material(2.0, 0.4999), StressState.PLANE_STRAIN)
        for name in (element, "galerkin-hybrid-T6")
    ]
    K, K_standard = (assemble_matrix(body.stiffness()) for body in bodies)
    W = bodies[1].spaces.trial
    displacements = SubSpace.displacements(W)
    select_equilibrium = displacements.extraction_matrix()
    select_volume = SubSpace.pressure(W).extraction_matrix()
    T = force_transfer(displacements.space)
    scalars = {}
    for name, select, expected in (
        ("equilibrium", select_equilibrium, T.matMult(select_equilibrium.matMult(K_standard))),
        ("volume", select_volume, select_volume.matMult(K_standard)),
    ):
        rows = select.matMult(K)
        expected.axpy(-1.0, rows, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        scalars[f"{name}_difference"] = float(expected.norm() / rows.norm())
    return Result(scalars, assign_unit_one_to_scalars(scalars), {})


def _inner_product_of_displacement_and_pressure(body: Body, space: fem.FunctionSpace) -> ufl.Form:
    """Return the inner product 2 mu eps(u):eps(w) + p q / (2 mu) as a bilinear form.

    Args:
        body: Body whose strain definition is used.
        space: Mixed space of displacements and pressures.
    """
    u, w = ufl.TrialFunction(space), ufl.TestFunction(space)
    (_, p), (_, q) = ufl.split(u), ufl.split(w)
    strains = ufl.inner(body.strain(u), body.strain(w))
    return (2 * SHEAR_MODULUS * strains + p * q / (2 * SHEAR_MODULUS)) * ufl.dx


def _smallest_singular_value_between_norms(
    b: PETSc.Mat, trial_gram: PETSc.Mat, weight_gram: PETSc.Mat
) -> float:
    """Return the smallest singular value of a matrix between the norms of trial and test functions.

    Args:
        b: Matrix (n, n) of the mixed problem.
        trial_gram: Gram matrix (n, n) of the norm of the trial functions.
        weight_gram: Gram matrix (n, n) of the norm of the test functions.
    """
    factors = factorise(b).ksp
    solve_b = _wrap_petsc_action_for_arrays(factors.solve, b)
    solve_b_transposed = _wrap_petsc_action_for_arrays(factors.solveTranspose, b)
    trial, weights = (
        _wrap_petsc_action_for_arrays(trial_gram.mult, b),
        _wrap_petsc_action_for_arrays(weight_gram.mult, b),
    )
    n = b.getSize()[0]
    # 1 / s^2 is the largest eigenvalue of b^-1 M_w b^-T M_u, as b^T M_w^-1 b u = s^2 M_u u
    product = LinearOperator(
        (n, n), lambda x: solve_b(weights(solve_b_transposed(trial(np.ravel(x))))), dtype=float
    )
    (largest,) = eigs(product, k=1, which="LM", v0=np.ones(n), return_eigenvectors=False, tol=1e-8)
    factors.destroy()
    return float(1 / np.sqrt(largest.real))


def _wrap_petsc_action_for_arrays(
    action: Callable[[PETSc.Vec, PETSc.Vec], None], matrix: PETSc.Mat
) -> Callable[[Array], Array]:
    """Wrap an operation on PETSc vectors as a function of NumPy arrays (n,).

    Args:
        action: Operation that reads its first vector and overwrites the second.
        matrix: Matrix with whose layout the vectors are created.
    """
    argument, image = matrix.createVecs()

    def apply_action_to_array(x: Array) -> Array:
        argument.setArray(x)
        action(argument, image)
        return np.array(image.array_r)

    return apply_action_to_array

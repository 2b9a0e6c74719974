"""Linear problems of nearly incompressible bodies: known fields, Cook's membrane, layers, stability."""

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
    mesh_distorted_grid,
    mesh_unit_domain,
)
from study.meshes.distortion import smooth_distortion
from study.meshes.mesh_families import mean_cell_size
from study.model.discretisation import displacement_space, prescribe_nodes, spaces
from study.model.elements import taylor_hood_spaces
from study.model.units import dimensionless
from study.run.store import Result
from study.solutions.manufactured import plane, plane_pressure, solid, solid_pressure

Array = npt.NDArray[np.float64]

YOUNGS_MODULUS = 1.0
DEGREE = 8
"""Degree of quadrature of integrals of exact fields."""


# Known fields


def square(element: str, nu: float, n: int) -> Result:
    """Return errors in a unit square in plane strain, cells of size 1/n."""
    return _solve_manufactured(element, nu, n)


def cube(element: str, nu: float, n: int) -> Result:
    """Return errors in a unit cube, cells of size 1/n."""
    return _solve_manufactured(element, nu, n)


def enclosed(element: str, nu: float, n: int) -> Result:
    """Return errors in a unit cube with exact displacements, not tractions, on all sides."""
    return _solve_manufactured(element, nu, n, is_enclosed=True)


@dataclass(frozen=True)
class ManufacturedField:
    """A solenoidal field plus g/lambda, with the pressure -div g, which stays bounded at nu = 1/2.

    Args:
        body: Body in which the field is evaluated.
        nu: Poisson's ratio.
    """

    body: Body
    nu: float

    def displacement_expression(self) -> Expr:
        """Return the exact displacement as a UFL expression."""
        field = solid if self.body.spaces.mesh.geometry.dim == 3 else plane
        return ufl.as_vector(field(ufl, self._x(), self._constant(self.inverse_lame)))

    def pressure_expression(self) -> Expr:
        """Return the exact pressure -lambda div u as a UFL expression."""
        field = solid_pressure if self.body.spaces.mesh.geometry.dim == 3 else plane_pressure
        return -ufl.div(ufl.as_vector(field(ufl, self._x(), self._constant(1.0))))

    def stress_expression(self) -> Expr:
        """Return the exact stress 2 mu eps(u) - p I as a UFL expression."""
        u, p = self.displacement_expression(), self.pressure_expression()
        mu = self._constant(YOUNGS_MODULUS / (2 * (1 + self.nu)))
        return 2 * mu * ufl.sym(ufl.grad(u)) - p * ufl.Identity(len(u))

    @property
    def inverse_lame(self) -> float:
        """Reciprocal 1/lambda of Lamé's first constant."""
        return (1 + self.nu) * (1 - 2 * self.nu) / (YOUNGS_MODULUS * self.nu)

    def evaluate_displacement(self, x: Array) -> Array:
        """Return displacements (n, dim) at points (n, 3)."""
        field = solid if self.body.spaces.mesh.geometry.dim == 3 else plane
        return np.column_stack(field(np, x.T, self.inverse_lame))

    def _x(self) -> Expr:
        return ufl.SpatialCoordinate(self.body.spaces.mesh)

    def _constant(self, value: float) -> fem.Constant:
        return fem.Constant(self.body.spaces.mesh, value)


def _solve_manufactured(element: str, nu: float, n: int, is_enclosed: bool = False) -> Result:
    """Solve for a known field; return errors relative to its norms.

    Displacements are prescribed on the bottom only, or on all sides if `is_enclosed` is true;
    tractions are prescribed on the remaining sides.
    """
    mesh = mesh_unit_domain(element, 1 / n)
    state = StressState.SOLID if mesh.geometry.dim == 3 else StressState.PLANE_STRAIN
    body = Body(spaces(element, mesh), Material(YOUNGS_MODULUS, nu), state)
    exact, W = ManufacturedField(body, nu), body.spaces.trial
    load_body = Body(body.spaces, body.material, state, quadrature_degree=DEGREE)
    f = assemble_vector(load_body.body_load(-ufl.div(exact.stress_expression())))
    traction = exact.stress_expression() * ufl.FacetNormal(mesh)
    boundary = boundary_measure(mesh, lambda x: np.ones(x.shape[1], dtype=bool), DEGREE)
    f.axpy(1.0, assemble_vector(body.surface_load(traction, boundary)))
    K = assemble_matrix(body.stiffness())
    supports = Reduction.dirichlet(W, _prescribe_exact_displacements(W, exact, is_enclosed))
    u, p = _displacement_and_pressure(body, solve(K, f, supports))

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
    return Result(scalars, dimensionless(scalars), {}, dofs=K.getSize()[0])


def _prescribe_exact_displacements(
    space: fem.FunctionSpace, exact: ManufacturedField, is_enclosed: bool
) -> fem.DirichletBC:
    """Prescribe the exact displacements on the bottom, or on all sides."""
    x = displacement_space(space).tabulate_dof_coordinates()
    dim = space.mesh.geometry.dim
    is_held = np.isclose(x[:, 1], 0.0)
    if is_enclosed:
        is_held = np.any(np.isclose(x[:, :dim], 0.0) | np.isclose(x[:, :dim], 1.0), axis=1)
    nodes = np.flatnonzero(is_held).astype(np.int32)
    return prescribe_nodes(space, nodes, exact.evaluate_displacement(x[nodes]))


def _displacement_and_pressure(body: Body, a: PETSc.Vec) -> tuple[Expr, Expr]:
    """Return displacement and pressure; without a pressure field, the pressure is -lambda div u."""
    if body.spaces.is_hybrid:
        return split(body.spaces.trial, a)
    u = as_function(body.spaces.trial, a)
    nu = body.material.poissons_ratio
    lame = YOUNGS_MODULUS * nu / ((1 + nu) * (1 - 2 * nu))
    return u, -lame * ufl.div(u)


# Cook's membrane


def cook(element: str, n: int, nu: float = 0.4999) -> Result:
    """Solve Cook's membrane in plane strain, n elements along a side; `tip` is E t/F times the deflection."""

    def taper(x: Array) -> Array:
        return np.column_stack(
            [48 * x[:, 0], 44 * x[:, 0] + x[:, 1] * (44 - 28 * x[:, 0]), x[:, 2]]
        )

    mesh = move_nodes(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (n, n)), taper)
    body = Body(spaces(element, mesh), Material(YOUNGS_MODULUS, nu), StressState.PLANE_STRAIN)
    W = body.spaces.trial
    clamp = [prescribe(W, k, lambda x: np.isclose(x[0], 0.0)) for k in (0, 1)]
    right_side = boundary_measure(mesh, lambda x: np.isclose(x[0], 48.0))
    f = assemble_vector(body.surface_load((0.0, 1 / 16), right_side))  # a force of 1
    K = assemble_matrix(body.stiffness())
    u, _ = _displacement_and_pressure(body, solve(K, f, Reduction.dirichlet(W, clamp)))
    x = displacement_space(W).tabulate_dof_coordinates()
    upper_corner = np.flatnonzero(np.isclose(x[:, 0], 48.0) & np.isclose(x[:, 1], 60.0))
    scalars = {"tip": float(u.x.array.reshape(-1, 2)[upper_corner[0], 1])}
    return Result(scalars, dimensionless(scalars), {}, dofs=K.getSize()[0])


# Layers: strain and pressure are constant in each layer, and the pressure jumps between them.
# Elements whose pressure is split there are exact; those with a continuous pressure are not.

LAYER_CELLS_PER_SIDE = 4
"""Number of cells along a side."""
LAYER_YOUNGS_MODULI, LAYER_POISSONS_RATIOS = np.array([2.0, 20.0]), np.array([0.4999, 0.3])
"""Young's moduli and Poisson's ratios of the lower and the upper layer."""


def layers(element: str) -> Result:
    """Press two layers uniformly between smooth walls.

    Scalars are the largest errors of a displacement, over the largest displacement: `error` with a
    pressure that may jump between the layers, `error_one` with a continuous pressure.
    """
    make_spaces = Spaces.hybrid if element.startswith("pw") else taylor_hood_spaces
    mesh = make_layered_mesh(MPI.COMM_SELF, CELL_TYPE_BY_ELEMENT_SUFFIX[element.rsplit("-", 1)[1]])
    scalars = {
        name: largest_layer_displacement_error(make_spaces, mesh, name == "error")
        for name in ("error", "error_one")
    }
    dofmap = make_spaces(mesh, None).trial.dofmap
    dofs = dofmap.index_map.size_global * dofmap.index_map_bs
    return Result(scalars, dimensionless(scalars), {}, dofs=dofs)


def make_layered_mesh(comm: MPI.Comm, cell: CellType) -> Mesh:
    """Return a unit square or cube with inner nodes, except those between the layers, moved."""
    n = LAYER_CELLS_PER_SIDE
    if cell in (CellType.triangle, CellType.quadrilateral):
        return move_nodes(create_unit_square(comm, n, n, cell), _distort_keeping_layers)
    return move_nodes(create_unit_cube(comm, n, n, n, cell), _distort_keeping_layers)


def largest_layer_displacement_error(
    make_spaces: Callable[[Mesh, MeshTags | None], Spaces], mesh: Mesh, has_split_pressure: bool
) -> float:
    """Return the largest error of a displacement of two layers over the largest displacement."""
    dim = mesh.geometry.dim
    up = dim - 1
    index_map = mesh.topology.index_map(dim)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    layer = (compute_midpoints(mesh, dim, cells)[:, up] > 0.5).astype(np.int32)
    E, nu = (fem.Function(fem.functionspace(mesh, ("DG", 0))) for _ in range(2))
    E.x.array[:], nu.x.array[:] = LAYER_YOUNGS_MODULI[layer], LAYER_POISSONS_RATIOS[layer]
    pair = make_spaces(mesh, meshtags(mesh, dim, cells, layer) if has_split_pressure else None)
    state = StressState.PLANE_STRAIN if dim == 2 else StressState.SOLID
    body = Body(pair, Material(E, nu), state)

    def on_side(axis: int, coordinate: float) -> Callable[[Array], npt.NDArray[np.bool_]]:
        return lambda x: np.isclose(x[axis], coordinate)

    W = pair.trial
    walls = [prescribe(W, k, on_side(k, end)) for k in range(up) for end in (0.0, 1.0)]
    supports = Reduction.dirichlet(pair, [*walls, prescribe(W, up, on_side(up, 0.0))])
    traction = np.zeros(dim)
    traction[up] = -1.0
    f = assemble_vector(body.surface_load(traction, boundary_measure(mesh, on_side(up, 1.0))))
    u, _ = split(W, solve(assemble_matrix(body.stiffness()), f, supports))
    nu_factor = (1 + LAYER_POISSONS_RATIOS) * (1 - 2 * LAYER_POISSONS_RATIOS)
    strain = nu_factor / ((1 - LAYER_POISSONS_RATIOS) * LAYER_YOUNGS_MODULI)
    z = u.function_space.tabulate_dof_coordinates()[:, up]
    exact = np.zeros((len(z), dim))
    exact[:, up] = -np.minimum(z, 0.5) * strain[0] - np.maximum(z - 0.5, 0.0) * strain[1]
    error = np.abs(u.x.array.reshape(-1, dim) - exact).max(initial=0.0)
    largest = mesh.comm.allreduce(np.abs(exact).max(initial=0.0), MPI.MAX)
    return float(mesh.comm.allreduce(error, MPI.MAX) / largest)


def _distort_keeping_layers(x: Array) -> Array:
    """Move points (n, 3) of the unit square or cube, except those on its sides and between layers."""
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
    """Return the inf-sup constant on a unit square or cube fixed at its base, n cells a side."""
    mesh = mesh_distorted_grid(element, n)
    state = StressState.SOLID if mesh.geometry.dim == 3 else StressState.PLANE_STRAIN
    body = Body(spaces(element, mesh), Material(3 * SHEAR_MODULUS, 0.5), state)
    W, dim = body.spaces.trial, mesh.geometry.dim
    base = [prescribe(W, k, lambda x: np.isclose(x[dim - 1], 0.0)) for k in range(dim)]
    supports = Reduction.dirichlet(W, base)
    b = supports.matrix(assemble_matrix(body.stiffness()))
    trial_gram, weight_gram = (
        supports.matrix(assemble_matrix(_natural_inner_product(body, space)))
        for space in (W, body.spaces.test)
    )
    scalars = {"inf_sup": _smallest_singular_value(b, trial_gram, weight_gram)}
    return Result(scalars, dimensionless(scalars), {}, dofs=b.getSize()[0])


def identity(element: str) -> Result:
    """Return |K - T K_standard| / |K| on a distorted square.

    T acts on the equations of equilibrium and leaves the volume equations unchanged.
    """
    mesh = move_nodes(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (6, 5)), smooth_distortion)
    bodies = [
        Body(spaces(name, mesh), Material(2.0, 0.4999), StressState.PLANE_STRAIN)
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
    return Result(scalars, dimensionless(scalars), {})


def _natural_inner_product(body: Body, space: fem.FunctionSpace) -> ufl.Form:
    """Return the inner product of the norm |(u, p)| in a space."""
    u, w = ufl.TrialFunction(space), ufl.TestFunction(space)
    (_, p), (_, q) = ufl.split(u), ufl.split(w)
    strains = ufl.inner(body.strain(u), body.strain(w))
    return (2 * SHEAR_MODULUS * strains + p * q / (2 * SHEAR_MODULUS)) * ufl.dx


def _smallest_singular_value(b: PETSc.Mat, trial_gram: PETSc.Mat, weight_gram: PETSc.Mat) -> float:
    """Return the smallest singular value of b between the norms of trial and weight functions."""
    factors = factorise(b).ksp
    solve_b = _wrap_for_arrays(factors.solve, b)
    solve_b_transposed = _wrap_for_arrays(factors.solveTranspose, b)
    trial, weights = _wrap_for_arrays(trial_gram.mult, b), _wrap_for_arrays(weight_gram.mult, b)
    n = b.getSize()[0]
    # 1 / s^2 is the largest eigenvalue of b^-1 M_w b^-T M_u, as b^T M_w^-1 b u = s^2 M_u u
    product = LinearOperator(
        (n, n), lambda x: solve_b(weights(solve_b_transposed(trial(np.ravel(x))))), dtype=float
    )
    (largest,) = eigs(product, k=1, which="LM", v0=np.ones(n), return_eigenvectors=False, tol=1e-8)
    factors.destroy()
    return float(1 / np.sqrt(largest.real))


def _wrap_for_arrays(
    action: Callable[[PETSc.Vec, PETSc.Vec], None], matrix: PETSc.Mat
) -> Callable[[Array], Array]:
    """Wrap a PETSc operation on vectors of the matrix as a function of arrays (n,)."""
    argument, image = matrix.createVecs()

    def act(x: Array) -> Array:
        argument.setArray(x)
        action(argument, image)
        return np.array(image.array_r)

    return act

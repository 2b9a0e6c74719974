"""Hybrid element with displacement u in P2 and pressure p in P1, and the Taylor-Hood element.

Results are compared with exact solutions, and those of the iterative solver with those of the
direct one.
"""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from basix.ufl import element
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    create_unit_cube,
    create_unit_square,
    meshtags,
)

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    PetrovGalerkinProblem,
    Reduction,
    SingularSystem,
    Spaces,
    assemble_matrix,
    assemble_scalar,
    buckling,
    prescribe,
    reactions,
    solve,
    split,
    test_space,
    vibration_modes,
)
from pw_elements.meshes import triangles
from pw_elements.spaces import SubSpace
from pw_elements.spaces.hybrid import displacement_pressure_element
from study.benchmarks.v15_incompressible.fields import (
    largest_displacement_error_of_two_layers,
    make_distorted_two_layer_mesh,
)
from study.model.elements import taylor_hood_spaces
from tests.contact.cases import PETROV_GALERKIN, ElasticBody, on_plane
from tests.library.properties import boundary_dofs

COMM = MPI.COMM_SELF
CELL_NAMES = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
SPACE_MAKERS_BY_METHOD = {"new": Spaces.hybrid, "standard": taylor_hood_spaces}
WITH_BOTH_SOLVERS = pytest.mark.parametrize(
    "solver", [Direct(), Iterative()], ids=["factors", "krylov"]
)
DX_OF_DEGREE_6 = ufl.dx(metadata={"quadrature_degree": 6})


def make_distorted_unit_mesh(cell, cells_per_side=3):
    """Create a unit square or cube whose inner vertices are displaced."""
    flat = cell in CELL_NAMES[:2]
    build = create_unit_square if flat else create_unit_cube
    mesh = build(COMM, *[cells_per_side] * (2 if flat else 3), CellType[cell])
    x = mesh.geometry.x[:, : mesh.geometry.dim]
    inner = np.all((x > 1e-9) & (x < 1 - 1e-9), axis=1)
    x[inner] += 0.2 / cells_per_side * np.sin(9 * x + 5 * np.roll(x, 1, axis=1))[inner]
    return mesh


def tag_cells(mesh, tag_values):
    """Create cell tags with the given values for the first cells of a mesh."""
    cells = np.arange(len(tag_values), dtype=np.int32)
    return meshtags(mesh, mesh.topology.dim, cells, np.asarray(tag_values, dtype=np.int32))


def default_stress_state(mesh):
    return "solid" if mesh.geometry.dim == 3 else "plane strain"


@pytest.mark.parametrize("nu", [0.3, 0.5])
@pytest.mark.parametrize("method", SPACE_MAKERS_BY_METHOD)
@pytest.mark.parametrize("cell", CELL_NAMES)
def test_uniaxial_stress_is_exact_whatever_the_units(cell, method, nu):
    E, t = 2e11, 1e6
    body = ElasticBody(
        mesh := make_distorted_unit_mesh(cell),
        SPACE_MAKERS_BY_METHOD[method],
        default_stress_state(mesh),
        E,
        nu,
    )
    W, dim = body.space, body.dim
    supports = body.make_supports(*((k, on_plane(k, 0.0)) for k in range(dim)))
    pull = np.eye(dim)[-1] * t
    f = body.traction_load(pull, on_plane(dim - 1, 1.0))
    a = solve(body.K, f, supports)
    u, p = split(W, a)
    stress = np.zeros(3)
    stress[dim - 1] = t
    if dim == 2:
        stress[2] = nu * t
    strain = ((1 + nu) * stress - nu * stress.sum()) / E
    # p = 2 mu eps - sigma along any axis
    assert np.abs(p.x.array - E / (1 + nu) * strain[0]).max() < 1e-9 * t
    displacements = u.x.array.reshape(-1, dim)
    assert np.abs(displacements - body.x * strain[:dim]).max() < 1e-10 * np.abs(strain).max()
    below = SubSpace.displacements(W).extract(reactions(body.K, a, f)).array_r.reshape(-1, dim)
    assert below.sum(axis=0) == pytest.approx(-pull, abs=1e-9 * t)


def compute_ring_errors(method, cells_per_side):
    """Return the relative errors of displacement and pressure in an incompressible ring.

    The ring is axisymmetric and is loaded by an inner pressure.
    """
    inner, outer, load, E = 1.0, 2.0, 3.0, 5.0
    C = load / (2 * E / 3 * (1 / inner**2 - 1 / outer**2))
    exact_p = -2 * E / 3 * C / outer**2
    mesh = create_unit_square(COMM, cells_per_side, cells_per_side)
    mesh.geometry.x[:, 0] += inner
    body = ElasticBody(mesh, SPACE_MAKERS_BY_METHOD[method], "axisymmetric", E, 0.5)
    supports = body.make_supports(*((1, on_plane(1, end)) for end in (0.0, 1.0)))
    u, p = split(
        body.space, solve(body.K, body.traction_load((load, 0), on_plane(0, inner)), supports)
    )
    x = ufl.SpatialCoordinate(mesh)
    exact = ufl.as_vector([C / x[0], 0])

    def norm(value):
        return np.sqrt(assemble_scalar(ufl.inner(value, value) * x[0] * DX_OF_DEGREE_6))

    return norm(u - exact) / norm(exact), norm(p - exact_p) / abs(exact_p)


@pytest.mark.parametrize("method", SPACE_MAKERS_BY_METHOD)
def test_an_incompressible_ring_in_axisymmetry_has_the_exact_pressure(method):
    coarse, fine = compute_ring_errors(method, 4), compute_ring_errors(method, 8)
    assert fine[0] < 1e-4
    assert coarse[0] / fine[0] > 2**2.8
    assert fine[1] < 2e-2
    assert coarse[1] / fine[1] > 2**1.7


@WITH_BOTH_SOLVERS
@pytest.mark.parametrize(("cell", "n"), [("triangle", 4), ("tetrahedron", 3)])
def test_an_enclosed_incompressible_body_needs_its_pressure_fixed(cell, n, solver):
    body = ElasticBody(
        mesh := make_distorted_unit_mesh(cell, n),
        Spaces.hybrid,
        default_stress_state(mesh),
        1.0,
        0.5,
    )
    W, dim, force = body.space, body.dim, np.array([2.0, 1.0, -4.0])
    rim = [fem.dirichletbc(fem.Function(W), boundary_dofs(W.sub(0)))]
    f, enclosed = body.body_force_load(force[:dim]), Reduction.dirichlet(W, rim)
    with pytest.raises(SingularSystem, match=r"^an incompressible .* prescribe it at a vertex"):
        solve(body.K, f, enclosed, solver)
    if dim == 2:
        with pytest.raises(SingularSystem, match="prescribe it at a vertex"):
            vibration_modes(body.K, body.M, enclosed)
    corner = prescribe(W, "pressure", lambda x: np.linalg.norm(x, axis=0) < 1e-9, 3.0)
    u, p = split(W, solve(body.K, f, Reduction.dirichlet(W, [*rim, corner]), solver))
    # the body rests under its weight, as a fluid would
    x = p.function_space.tabulate_dof_coordinates()[:, :dim]
    assert np.abs(p.x.array - (3 + x @ force[:dim])).max() < 1e-9
    assert np.abs(u.x.array).max() < 1e-11


@pytest.mark.parametrize(
    ("method", "nu", "state", "warned"),
    [
        (PETROV_GALERKIN, 0.495, "plane strain", True),
        (Spaces.galerkin, 0.495, "axisymmetric", True),
        (PETROV_GALERKIN, 0.49, "plane strain", False),
        (PETROV_GALERKIN, 0.5, "plane stress", False),
        (Spaces.hybrid, 0.5, "plane strain", False),
    ],
)
def test_displacements_alone_warn_near_incompressibility(caplog, method, nu, state, warned):
    Body(method(create_unit_square(COMM, 2, 2)), Material(1.0, nu), state)
    assert ("in displacements alone: they lock" in caplog.text) is warned


def test_layers_are_exact_where_the_pressure_is_split_between_them(caplog):
    mesh = make_distorted_two_layer_mesh(COMM, CellType.triangle)
    assert (
        largest_displacement_error_of_two_layers(Spaces.hybrid, mesh, has_pressure_jump=True)
        < 1e-12
    )
    assert "the pressure is continuous" not in caplog.text
    assert (
        largest_displacement_error_of_two_layers(Spaces.hybrid, mesh, has_pressure_jump=False)
        > 1e-3
    )
    assert "the pressure is continuous" in caplog.text


def test_split_pressure_must_be_tied_and_needs_direct_solver():
    mesh = create_unit_square(COMM, 2, 2)
    spaces, trial = Spaces.hybrid(mesh, tag_cells(mesh, [1] * 8)), Spaces.hybrid(mesh).trial
    conditions = [prescribe(spaces.trial, 0, on_plane(0, 0.0))]
    with pytest.raises(ValueError, match="dirichlet needs both spaces"):
        Reduction.dirichlet(spaces.trial, conditions)
    with pytest.raises(ValueError, match="of all of them"):
        Reduction.dirichlet(Spaces.hybrid(mesh, tag_cells(mesh, [1] * 3)), conditions)
    # one part has the pressure of a body without parts
    tied = Reduction.dirichlet(spaces, conditions).right.getSize()[1]
    whole = Reduction.dirichlet(trial, [prescribe(trial, 0, on_plane(0, 0.0))])
    assert tied == whole.right.getSize()[1]
    spaces = Spaces.hybrid(mesh, tag_cells(mesh, [0, 1] * 4))
    conditions = Reduction.dirichlet(spaces, [prescribe(spaces.trial, 0, on_plane(0, 0.0))])
    K = assemble_matrix(Body(spaces, Material(1.0, 0.4), "plane strain").stiffness())
    with pytest.raises(ValueError, match="a pressure that is split, need Direct"):
        solve(K, K.createVecLeft(), conditions, Iterative())
    w, residual = make_incompressible_residual(spaces)
    with pytest.raises(ValueError, match="no residual ties it"):
        PetrovGalerkinProblem(residual, w)


def test_shear_vibrations_of_an_incompressible_block_are_exact():
    """Shear vibrations of an incompressible block have the exact frequency.

    The mode u_x = sin(pi y / 2), u_y = 0 preserves volume. Its angular frequency omega is given by
    omega^2 = mu (pi / 2)^2 / rho, with mu the shear modulus and rho the density.
    """
    mu, rho = 7e9 / 3, 2e3
    for method, near in (("standard", 1e-4), ("new", 1e-2)):
        material = Material(3 * mu, 0.5, rho)
        body = ElasticBody(
            create_unit_square(COMM, 6, 6), SPACE_MAKERS_BY_METHOD[method], material=material
        )
        ends = [(1, on_plane(0, 0.0)), (1, on_plane(0, 1.0)), (1, on_plane(1, 1.0))]
        supports = body.make_supports((0, on_plane(1, 0.0)), (1, on_plane(1, 0.0)), *ends)
        values = vibration_modes(body.K, body.M, supports, 6).eigenvalues
        assert np.abs(values / (mu / rho * (np.pi / 2) ** 2) - 1).min() < near


def test_an_incompressible_column_buckles_as_euler_says():
    E, length, height = 2e11, 10.0, 1.0
    mesh = triangles(COMM, (0.0, 0.0), (length, height), (40, 4))
    column = ElasticBody(mesh, Spaces.hybrid, E=E, nu=0.5)
    foot, load = (
        column.make_clamping_supports(on_plane(0, 0.0)),
        column.traction_load((-1.0, 0.0), on_plane(0, length)),
    )
    euler = np.pi**2 / 4 * E / (1 - 0.5**2) * height**3 / 12 / length**2
    factors = buckling(column.K, column.initial_stress_matrix(load, foot), foot).factors
    assert factors[0] == pytest.approx(euler, rel=0.01)


@pytest.mark.parametrize("cell", CELL_NAMES)
def test_weights_of_a_users_mixed_space_equal_those_of_hybrid_spaces(cell):
    mesh = make_distorted_unit_mesh(cell, 2)
    mixed_space, pair = taylor_hood_spaces(mesh).trial, Spaces.hybrid(mesh)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    mine, theirs = (
        assemble_matrix(ufl.inner(ufl.TrialFunction(trial), ufl.TestFunction(test)) * dx)
        for trial, test in ((mixed_space, test_space(mixed_space)), (pair.trial, pair.test))
    )
    assert (mine - theirs).norm() < 1e-14 * mine.norm()
    straight = element("Lagrange", cell, 1, shape=(mesh.geometry.dim,))
    linear = fem.functionspace(mesh, displacement_pressure_element(straight))
    with pytest.raises(ValueError, match="alone or beside a pressure of degree 1"):
        test_space(linear)


def test_contradictions_of_conditions_are_judged_for_each_field():
    W = Spaces.hybrid(make_distorted_unit_mesh("triangle", 2)).trial
    corner = lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 0)  # noqa: E731
    conditions = [prescribe(W, "pressure", corner, 1e12), prescribe(W, 0, on_plane(0, 0.0), 1e-3)]
    Reduction.dirichlet(W, conditions)
    with pytest.raises(ValueError, match="contradict each other"):
        Reduction.dirichlet(W, [*conditions, prescribe(W, 0, on_plane(1, 0.0), 2e-3)])


def test_von_mises_stress_of_hybrid_bodies_does_not_depend_on_pressure():
    mesh = make_distorted_unit_mesh("triangle", 2)
    tags = tag_cells(mesh, np.arange(8) % 2)
    material = Material.by_tag(mesh, tags, {0: Material(3.0, 0.3), 1: Material(3.0, 0.499)})
    body = Body.from_mesh(mesh, material, "plane strain", parts=tags)
    assert body.spaces.is_hybrid
    w = fem.Function(body.spaces.trial)
    # pure shear under pressure: sqrt(3) tau, whatever the pressure
    u, p = (SubSpace.displacements(w.function_space), SubSpace.pressure(w.function_space))
    y = u.space.tabulate_dof_coordinates()[:, 1]
    w.x.array[u.unknowns[:, 0]], w.x.array[p.unknowns[:, 0]] = 0.1 * y, 7.0
    shear = (3 / 2.6 + 3 / 2.998) / 2 * 0.1
    mean = assemble_scalar(body.von_mises(w) * ufl.dx)
    assert mean == pytest.approx(np.sqrt(3) * shear, rel=0.02)


@pytest.mark.parametrize(
    ("nu", "state", "hybrid"),
    [
        (0.48, "plane strain", False),
        (0.481, "plane strain", True),
        (0.5, "solid", True),
        (0.5, "plane stress", False),
    ],
)
def test_nearly_incompressible_materials_select_the_hybrid_element(caplog, nu, state, hybrid):
    caplog.set_level("INFO", logger="pw_elements")
    mesh = make_distorted_unit_mesh("tetrahedron" if state == "solid" else "triangle", 2)
    body = Body.from_mesh(mesh, Material(1.0, nu), state)
    assert body.spaces.is_hybrid is hybrid
    assert (f"hybrid: nu = {nu:g}" in caplog.text) is hybrid


def test_the_largest_poissons_ratio_of_a_body_selects_its_element(caplog):
    mesh = make_distorted_unit_mesh("triangle", 2)
    nu = fem.Function(fem.functionspace(mesh, ("DG", 0)))
    nu.x.array[:] = 0.3
    assert not Body.from_mesh(mesh, Material(1.0, nu), "plane strain").spaces.is_hybrid
    nu.x.array[-1:] = 0.495
    Body(PETROV_GALERKIN(mesh), Material(1.0, nu), "plane strain")
    assert "nu = 0.495 in displacements alone" in caplog.text
    tags = tag_cells(mesh, nu.x.array > 0.4)
    assert Body.from_mesh(mesh, Material(1.0, nu), "plane strain", parts=tags).spaces.parts is tags


# -- Krylov's method gives the numbers of factors --------------------------------------------------


class ClampedBlock(ElasticBody):
    """Block that is clamped at its base and pushed sideways and down."""

    def __init__(self, mesh, nu=0.5, E=2e11, method=Spaces.hybrid, state=None, length=1.0):
        super().__init__(mesh, method, state or default_stress_state(mesh), E, nu)
        vertical, kept = self.dim - 1, slice(3 - self.dim, None)
        self.f = self.body_force_load([2e8, 1e8, -4e8][kept])
        self.f += self.traction_load([1e8, 1e8, -2e8][kept], on_plane(vertical, 1.0))
        self.foot = [(k, on_plane(vertical, 0.0), 0.01 * k * length) for k in range(self.dim)]
        self.supports = self.make_supports(*self.foot)

    def compare_solvers(self):
        """Return the largest relative difference between iterative and direct solutions.

        Displacements and pressures are compared. The second value is the number of Krylov
        iterations.
        """
        a, exact = (
            solve(self.K, self.f, self.supports, solver_type())
            for solver_type in (Iterative, Direct)
        )
        fields = zip(split(self.space, a), split(self.space, exact), strict=True)
        off = [np.abs(p.x.array - q.x.array).max() / np.abs(q.x.array).max() for p, q in fields]
        report = a.getAttr("report")
        assert report.method == "GMRES with p-multigrid in a block triangle"
        return max(off), report.krylov_iterations


@pytest.mark.parametrize("nu", [0.3, 0.5])
@pytest.mark.parametrize("method", SPACE_MAKERS_BY_METHOD.values())
@pytest.mark.parametrize("cell", CELL_NAMES)
def test_displacement_and_pressure_equal_those_of_the_direct_solver(cell, method, nu):
    case = ClampedBlock(
        make_distorted_unit_mesh(cell, 12 if cell in CELL_NAMES[:2] else 3), nu, method=method
    )
    off, iterations = case.compare_solvers()
    assert off < 1e-9
    assert iterations < 55


def test_krylov_iterations_depend_neither_on_the_mesh_nor_on_units():
    counts = [
        ClampedBlock(make_distorted_unit_mesh("tetrahedron", n)).compare_solvers()[1]
        for n in (2, 3, 5)
    ]
    assert max(counts) < 60
    assert counts[2] <= counts[1] + 3
    counts = []
    for length, modulus in ((1.0, 2e11), (1e-3, 2e-6), (1e3, 2e5)):
        mesh = make_distorted_unit_mesh("tetrahedron", 3)
        case = ClampedBlock(mesh, E=modulus, length=length)
        mesh.geometry.x[:] *= length
        case.K = assemble_matrix(case.body.stiffness())
        case.f.scale(modulus / 2e11 * length**2)
        off, iterations = case.compare_solvers()
        assert off < 1e-9
        counts.append(iterations)
    assert max(counts) - min(counts) <= 2


def test_krylov_solver_handles_a_varying_modulus_and_axisymmetry():
    mesh = make_distorted_unit_mesh("tetrahedron", 3)
    E = fem.Function(fem.functionspace(mesh, ("Lagrange", 1)))
    E.interpolate(lambda x: 10.0 ** (4 * x[0]))
    off, iterations = ClampedBlock(mesh, 0.4999, E).compare_solvers()
    assert off < 1e-7
    assert iterations < 90
    mesh = make_distorted_unit_mesh("triangle", 12)
    mesh.geometry.x[:, 0] += 0.01
    assert ClampedBlock(mesh, state="axisymmetric").compare_solvers()[1] < 60


@pytest.mark.parametrize(("support_kind", "nu"), [("clamped", 0.4), ("free", 0.5)])
def test_vibration_modes_equal_those_of_the_direct_solver(support_kind, nu):
    """Vibration modes of the iterative solver agree with those of the direct solver.

    Frequencies, displacements and pressures of the modes are compared.
    """
    mesh = make_distorted_unit_mesh("tetrahedron", 2)
    case = ClampedBlock(mesh, nu)
    mesh.geometry.x[:] *= 1.0, 0.7, 2.0  # modes of cubes are double and triple
    case.K = assemble_matrix(case.body.stiffness())
    rigid, supports = (0, case.supports) if support_kind == "clamped" else (6, case.make_supports())
    mine, exact = (
        vibration_modes(case.K, case.M, supports, rigid + 2, solver=solver)
        for solver in (Iterative(), Direct())
    )
    assert mine.report.factorisations == 0
    assert mine.n_rigid == exact.n_rigid == rigid
    assert mine.eigenvalues[rigid:] == pytest.approx(exact.eigenvalues[rigid:], rel=1e-9)
    for k in range(rigid, rigid + 2):
        fields = (split(case.space, modes.shapes[k]) for modes in (mine, exact))
        for a, b in zip(*fields, strict=True):
            a, b = a.x.array, b.x.array
            assert min(np.abs(a - b).max(), np.abs(a + b).max()) < 1e-7 * np.abs(b).max()


def test_buckling_factors_equal_those_of_the_direct_solver_and_free_bodies_are_refused():
    case = ClampedBlock(make_distorted_unit_mesh("tetrahedron", 2), E=2e9)
    K_sigma = case.initial_stress_matrix(case.f, case.supports)
    mine, exact = (
        buckling(case.K, K_sigma, case.supports, solver=solver_type())
        for solver_type in (Iterative, Direct)
    )
    assert mine.factors == pytest.approx(exact.factors, rel=1e-8)
    loose = case.make_supports(*case.foot[:2])
    with pytest.raises(SingularSystem, match="leave a rigid motion free"):
        buckling(case.K, K_sigma, loose, solver=Iterative())
    with pytest.raises(SingularSystem, match="leave a rigid motion free"):
        solve(case.K, case.f, loose, Iterative())


# -- large strains, by the residual ----------------------------------------------------------------


def make_incompressible_residual(spaces, shear_modulus=1.0):
    """Return the unknowns and the residual of an incompressible neo-Hookean body.

    The pressure is zero in the undeformed body.
    """
    w, (v, q) = fem.Function(spaces.trial), ufl.split(ufl.TestFunction(spaces.test))
    u, p = ufl.split(w)
    F = ufl.Identity(len(u)) + ufl.grad(u)
    J, inverse = ufl.det(F), ufl.inv(F).T
    stress = shear_modulus * (F - inverse) - p * J * inverse
    return w, ufl.inner(stress, ufl.grad(v)) * DX_OF_DEGREE_6 - q * (J - 1) * DX_OF_DEGREE_6


@pytest.mark.parametrize(("cell", "mu"), [("triangle", 7e10), ("tetrahedron", 1.0)])
@pytest.mark.parametrize("method", SPACE_MAKERS_BY_METHOD)
def test_an_incompressible_block_is_stretched_exactly_whatever_the_units(method, cell, mu):
    """The solution for a stretched incompressible block is exact in any units.

    Displacements, pressures and forces are compared with the exact ones. The exact stress in plane
    strain is sigma = mu (l^2 - l^-2), with l the stretch and mu the shear modulus.
    """
    size, stretch = 1e-3, 1.4
    mesh = make_distorted_unit_mesh(cell, 2)
    mesh.geometry.x[:] *= size
    spaces, dim = SPACE_MAKERS_BY_METHOD[method](mesh), mesh.geometry.dim
    (w, residual), end = (
        make_incompressible_residual(spaces, mu),
        fem.Constant(mesh, (stretch - 1) * size),
    )

    def side_marker(axis, coordinate):
        return lambda x: np.isclose(x[axis], coordinate * size)

    conditions = [prescribe(spaces.trial, k, side_marker(k, 0.0)) for k in range(dim)]
    conditions += [prescribe(spaces.trial, k, side_marker(k, 1.0)) for k in range(2, dim)]
    conditions.append(prescribe(spaces.trial, 0, side_marker(0, 1.0), end))
    problem = PetrovGalerkinProblem(residual, w, conditions)
    problem.solve(end, increments=2)
    u, p = (field_of(spaces.trial) for field_of in (SubSpace.displacements, SubSpace.pressure))
    x = u.space.tabulate_dof_coordinates()[:, :dim]
    exact = x * (stretch - 1, 1 / stretch - 1, 0.0)[:dim]
    assert np.abs(w.x.array[u.unknowns] - exact).max() < 1e-9 * size
    # the transverse stress mu (l^-2 - 1) - p vanishes
    assert np.abs(w.x.array[p.unknowns] - mu * (stretch**-2 - 1)).max() < 1e-8 * mu
    forces = problem.reactions().array_r[u.owned_unknowns]
    expected = mu * (stretch**2 - stretch**-2) * size ** (dim - 1) / stretch
    lateral_force = forces[np.isclose(x[:, 0], size)].sum(axis=0)[:2]
    assert lateral_force == pytest.approx([expected, 0.0], abs=1e-8 * expected)

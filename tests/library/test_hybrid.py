"""The hybrid element, u in P2 and p in P1, against exact solutions and its Galerkin twin."""

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
    Material,
    Reduction,
    SingularSystem,
    Spaces,
    as_function,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    boundary_measure,
    buckling,
    force_transfer,
    prescribe,
    reactions,
    solve,
    split,
    test_space,
    vibration_modes,
)
from pw_elements.meshes import mapped, triangles
from pw_elements.spaces import SubSpace
from pw_elements.spaces.hybrid import mixed_element
from study.verification.t_identity import distorted
from study.verification.v15_layers import error, layered

COMM = MPI.COMM_WORLD
CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
MAKERS = {"new": Spaces.hybrid, "standard": Spaces.taylor_hood}


def block(cell, n=3):
    """A unit square or cube whose inner nodes have been moved."""
    if cell in ("triangle", "quadrilateral"):
        mesh = create_unit_square(COMM, n, n, getattr(CellType, cell))
    else:
        mesh = create_unit_cube(COMM, n, n, n, getattr(CellType, cell))
    dim = mesh.geometry.dim
    x = mesh.geometry.x[:, :dim]
    inner = np.all((x > 1e-9) & (x < 1 - 1e-9), axis=1)
    moved = 0.2 / n * np.sin(9 * x + 5 * np.roll(x, 1, axis=1))
    mesh.geometry.x[inner, :dim] += moved[inner]
    return mesh


def side(axis, end):
    return lambda x: np.isclose(x[axis], end)


@pytest.mark.parametrize("nu", [0.3, 0.4999, 0.5])
@pytest.mark.parametrize("method", MAKERS)
@pytest.mark.parametrize("cell", CELLS)
def test_uniaxial_stress_is_exact_whatever_the_units(cell, method, nu):
    mesh = block(cell)
    dim, E, t = mesh.geometry.dim, 2e11, 1e6
    state = "plane strain" if dim == 2 else "solid"
    body = Body(MAKERS[method](mesh), Material(E, nu), state)
    W = body.spaces.trial
    held = Reduction.dirichlet(W, [prescribe(W, k, side(k, 0.0)) for k in range(dim)])
    top = boundary_measure(mesh, side(dim - 1, 1.0))
    pull = np.eye(dim)[-1] * t
    f = assemble_vector(body.surface_load(pull, top))
    K = assemble_matrix(body.stiffness())
    a = solve(K, f, held)
    u, p = split(W, a)
    stress = np.zeros(3)
    stress[dim - 1] = t
    if dim == 2:
        stress[2] = nu * t
    strain = ((1 + nu) * stress - nu * stress.sum()) / E
    # p = 2 mu eps - sigma, along any axis
    exact = E / (1 + nu) * strain[0]
    assert np.abs(p.x.array - exact).max() < 1e-9 * t
    x = u.function_space.tabulate_dof_coordinates()[:, :dim]
    moved = u.x.array.reshape(-1, dim)
    assert np.abs(moved - x * strain[:dim]).max() < 1e-10 * np.abs(strain).max()
    below = SubSpace.displacements(W).part(reactions(K, a, f)).array_r.reshape(-1, dim)
    assert below.sum(axis=0) == pytest.approx(-pull, abs=1e-9 * t)


def test_in_the_plane_both_blocks_are_galerkins_with_equations_shared_out():
    """K = T K_TaylorHood, T acting on equilibrium and not on the equations of volume."""
    mesh = mapped(triangles(COMM, (0.0, 0.0), (1.0, 1.0), (6, 5)), distorted)
    K, standard = (
        assemble_matrix(Body(make(mesh), Material(2.0, 0.45), "plane strain").stiffness())
        for make in (Spaces.hybrid, Spaces.taylor_hood)
    )
    W = Spaces.taylor_hood(mesh).trial
    u, p = (field.selection() for field in (SubSpace.displacements(W), SubSpace.pressure(W)))
    T = force_transfer(SubSpace.displacements(W).space)
    for field, rows in (("displacement", u), ("pressure", p)):
        expected = rows.matMult(standard)
        if field == "displacement":
            expected = T.matMult(expected)
        for columns in (u, p):
            mine = rows.matMult(K).matTransposeMult(columns)
            theirs = expected.matTransposeMult(columns)
            assert (mine - theirs).norm() < 1e-13 * max(mine.norm(), 1e-30), field
    assert (K - standard).norm() > 1e-2 * K.norm()


def ring(method, n):
    """An incompressible ring under inner pressure, in axisymmetry: relative errors of u and p."""
    inner, outer, load, E = 1.0, 2.0, 3.0, 5.0
    C = load / (2 * E / 3 * (1 / inner**2 - 1 / outer**2))
    exact_p = -2 * E / 3 * C / outer**2
    mesh = create_unit_square(COMM, n, n)
    mesh.geometry.x[:, 0] += inner
    body = Body(MAKERS[method](mesh), Material(E, 0.5), "axisymmetric")
    W = body.spaces.trial
    x = ufl.SpatialCoordinate(mesh)
    held = Reduction.dirichlet(W, [prescribe(W, 1, side(1, end)) for end in (0.0, 1.0)])
    f = assemble_vector(body.surface_load((load, 0), boundary_measure(mesh, side(0, inner))))
    u, p = split(W, solve(assemble_matrix(body.stiffness()), f, held))
    exact, dx = ufl.as_vector([C / x[0], 0]), ufl.dx(metadata={"quadrature_degree": 8})

    def norm(value):
        return np.sqrt(assemble_scalar(ufl.inner(value, value) * x[0] * dx))

    return norm(u - exact) / norm(exact), norm(p - exact_p) / abs(exact_p)


@pytest.mark.parametrize("method", MAKERS)
def test_an_incompressible_ring_in_axisymmetry_has_the_exact_pressure(method):
    coarse, fine = ring(method, 4), ring(method, 8)
    assert fine[0] < 1e-4
    assert coarse[0] / fine[0] > 2**2.8
    assert fine[1] < 2e-2
    assert coarse[1] / fine[1] > 2**1.7


def enclosed(fixed):
    mesh = create_unit_square(COMM, 4, 4)
    body = Body(Spaces.hybrid(mesh), Material(1.0, 0.5), "plane strain")
    W = body.spaces.trial
    rim = [
        prescribe(W, k, lambda x: np.any(np.isclose(np.abs(x[:2] - 0.5), 0.5), axis=0))
        for k in (0, 1)
    ]
    corner = prescribe(W, "pressure", lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 0), 2.0)
    K = assemble_matrix(body.stiffness())
    if not fixed:
        with pytest.raises(SingularSystem, match="prescribe it at a vertex"):
            vibration_modes(K, assemble_matrix(body.mass()), Reduction.dirichlet(W, rim))
    f = assemble_vector(body.body_load((0.0, -3.0)))
    return W, solve(K, f, Reduction.dirichlet(W, [*rim, *([corner] if fixed else [])]))


def test_an_enclosed_incompressible_body_needs_its_pressure_fixed():
    with pytest.raises(SingularSystem, match="prescribe it at a vertex"):
        enclosed(fixed=False)
    u, p = split(*enclosed(fixed=True))
    # it rests under its weight, as a fluid would
    depth = p.function_space.tabulate_dof_coordinates()[:, 1]
    assert np.abs(p.x.array - (2 - 3 * depth)).max() < 1e-12
    assert np.abs(u.x.array).max() < 1e-13


@pytest.mark.parametrize(
    ("method", "nu", "state", "warned"),
    [
        (Spaces.petrov_galerkin, 0.495, "plane strain", True),
        (Spaces.galerkin, 0.495, "axisymmetric", True),
        (Spaces.petrov_galerkin, 0.49, "plane strain", False),
        (Spaces.petrov_galerkin, 0.5, "plane stress", False),
        (Spaces.hybrid, 0.5, "plane strain", False),
    ],
)
def test_displacements_alone_warn_near_incompressibility(caplog, method, nu, state, warned):
    Body(method(create_unit_square(COMM, 2, 2)), Material(1.0, nu), state)
    assert ("in displacements alone: they lock" in caplog.text) is warned


def test_layers_are_exact_where_the_pressure_is_split_between_them(caplog):
    mesh = layered(COMM, CellType.triangle)
    assert error(Spaces.hybrid, mesh, split_pressure=True) < 1e-12
    assert "the pressure is continuous" not in caplog.text
    assert error(Spaces.hybrid, mesh, split_pressure=False) > 1e-3
    assert "the pressure is continuous" in caplog.text


def test_a_split_pressure_has_to_be_tied():
    mesh = create_unit_square(COMM, 2, 2)
    some = meshtags(mesh, 2, np.arange(8, dtype=np.int32), np.ones(8, dtype=np.int32))
    spaces = Spaces.hybrid(mesh, some)
    held = [prescribe(spaces.trial, 0, side(0, 0.0))]
    with pytest.raises(ValueError, match="dirichlet needs both spaces"):
        Reduction.dirichlet(spaces.trial, held)
    few = meshtags(mesh, 2, np.arange(3, dtype=np.int32), np.ones(3, dtype=np.int32))
    with pytest.raises(ValueError, match="of all of them"):
        Reduction.dirichlet(Spaces.hybrid(mesh, few), held)
    # one part has the pressure of a body without parts
    tied = Reduction.dirichlet(spaces, held).right.getSize()[1]
    one = Spaces.hybrid(mesh).trial
    whole = Reduction.dirichlet(one, [prescribe(one, 0, side(0, 0.0))])
    assert tied == whole.right.getSize()[1]


def test_shear_vibrations_of_an_incompressible_block_are_exact():
    """u_x = sin(pi y / 2), u_y = 0 keeps volumes: omega^2 = mu (pi / 2)^2 / rho."""
    E, rho = 7e9, 2e3
    mesh = create_unit_square(COMM, 6, 6)
    found = []
    for method in (Spaces.hybrid, Spaces.taylor_hood):
        body = Body(method(mesh), Material(E, 0.5, rho), "plane strain")
        W = body.spaces.trial
        base = [prescribe(W, k, side(1, 0.0)) for k in (0, 1)]
        sides = [prescribe(W, 1, side(0, end)) for end in (0.0, 1.0)]
        held = Reduction.dirichlet(W, [*base, *sides, prescribe(W, 1, side(1, 1.0))])
        K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
        values = vibration_modes(K, M, held, 6).eigenvalues
        found.append(np.abs(values / (E / 3 / rho * (np.pi / 2) ** 2) - 1).min())
    assert found[1] < 1e-4
    assert found[0] < 1e-2


def test_a_body_takes_the_element_that_the_softest_of_its_materials_needs(caplog):
    mesh = block("triangle", 2)
    nu = fem.Function(fem.functionspace(mesh, ("DG", 0)))
    nu.x.array[:] = 0.3
    assert not Body.on(mesh, Material(1.0, nu), "plane strain").spaces.is_hybrid
    nu.x.array[-1:] = 0.495
    Body(Spaces.petrov_galerkin(mesh), Material(1.0, nu), "plane strain")
    assert "nu = 0.495 in displacements alone" in caplog.text
    cells = np.arange(len(nu.x.array), dtype=np.int32)
    parts = meshtags(mesh, 2, cells, (nu.x.array > 0.4).astype(np.int32))
    body = Body.on(mesh, Material(1.0, nu), "plane strain", parts=parts)
    assert body.spaces.parts is parts


def test_an_incompressible_column_buckles_as_euler_says():
    E, length, height = 2e11, 10.0, 1.0
    mesh = triangles(COMM, (0.0, 0.0), (length, height), (40, 4))
    body = Body(Spaces.hybrid(mesh), Material(E, 0.5), "plane strain")
    W = body.spaces.trial
    foot = Reduction.dirichlet(W, [prescribe(W, k, side(0, 0.0)) for k in (0, 1)])
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.surface_load((-1.0, 0.0), boundary_measure(mesh, side(0, length))))
    pressed = as_function(W, solve(K, f, foot))
    K_sigma = assemble_matrix(body.initial_stress(body.stress(pressed)))
    euler = np.pi**2 / 4 * E / (1 - 0.5**2) * height**3 / 12 / length**2
    assert buckling(K, K_sigma, foot).factors[0] == pytest.approx(euler, rel=0.01)


@pytest.mark.parametrize("cell", CELLS)
def test_a_mixed_space_of_ones_own_has_the_same_weights(cell):
    mesh = block(cell, 2)
    own, pair = Spaces.taylor_hood(mesh).trial, Spaces.hybrid(mesh)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    mine, theirs = (
        assemble_matrix(ufl.inner(ufl.TrialFunction(trial), ufl.TestFunction(test)) * dx)
        for trial, test in ((own, test_space(own)), (pair.trial, pair.test))
    )
    assert (mine - theirs).norm() < 1e-14 * mine.norm()
    straight = element("Lagrange", cell, 1, shape=(mesh.geometry.dim,))
    linear = fem.functionspace(mesh, mixed_element(straight))
    with pytest.raises(ValueError, match="alone or beside a pressure of degree 1"):
        test_space(linear)


def test_conditions_contradict_each_other_field_by_field():
    W = Spaces.hybrid(block("triangle", 2)).trial
    corner = lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 0)  # noqa: E731
    held = [prescribe(W, "pressure", corner, 1e12), prescribe(W, 0, side(0, 0.0), 1e-3)]
    Reduction.dirichlet(W, held)
    with pytest.raises(ValueError, match="contradict each other"):
        Reduction.dirichlet(W, [*held, prescribe(W, 0, side(1, 0.0), 2e-3)])


def test_von_mises_stress_and_materials_by_tag_know_the_pressure():
    mesh = block("triangle", 2)
    cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
    tags = meshtags(mesh, 2, cells, (cells % 2).astype(np.int32))
    both = Material.by_tag(mesh, tags, {0: Material(3.0, 0.3), 1: Material(3.0, 0.499)})
    body = Body.on(mesh, both, "plane strain", parts=tags)
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
def test_a_body_takes_the_element_that_its_material_needs(caplog, nu, state, hybrid):
    caplog.set_level("INFO", logger="pw_elements")
    mesh = block("tetrahedron" if state == "solid" else "triangle", 2)
    body = Body.on(mesh, Material(1.0, nu), state)
    assert body.spaces.is_hybrid is hybrid
    assert (f"hybrid: nu = {nu:g}" in caplog.text) is hybrid

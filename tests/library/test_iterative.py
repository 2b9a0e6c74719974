"""The iterative solver gives the numbers of the direct one, or says why it does not."""

import logging

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import interpolation_matrix
from dolfinx.mesh import CellType, create_box, create_mesh, exterior_facet_indices
from scipy.linalg import block_diag

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    NotConverged,
    Reduction,
    SingularSystem,
    Spaces,
    as_function,
    assemble_matrix,
    assemble_vector,
    buckling,
    prescribe,
    solve,
    test_space,
    vibration_modes,
)
from pw_elements._compat import cell_nodes
from pw_elements.meshes import curved, mapped, quadrilaterals, triangles
from pw_elements.solvers import Multigrid, auto_solver, matrices
from study.inner_nodes import centre_nodes
from tests.contact.cases import at


def box(cell, n=2, comm=MPI.COMM_SELF):
    mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (2 * n, n, n), CellType[cell])
    return mapped(mesh, lambda x: x + 0.05 * np.sin(3 * x[:, [1, 2, 0]]) * x[:, :1])


def rectangle(cell):
    build = triangles if cell == "triangle" else quadrilaterals
    mesh = build(MPI.COMM_SELF, (1.0, 0.0), (3.0, 1.0), (8, 4))
    return mapped(mesh, lambda x: x + 0.05 * np.sin(3 * x[:, [1, 2, 0]]) * [1, 1, 0])


def bent(build):
    return curved(build, lambda x: x + 0.1 * np.sin(2 * x[:, [1, 2, 0]]) * (x**0 * [1, 1, 0]))


BODIES = {
    "pw-T10": lambda: (Spaces.petrov_galerkin(box("tetrahedron")), "solid"),
    "galerkin-T10": lambda: (Spaces.galerkin(box("tetrahedron")), "solid"),
    "pw-H27": lambda: (Spaces.petrov_galerkin(box("hexahedron")), "solid"),
    "galerkin-H27": lambda: (Spaces.galerkin(box("hexahedron")), "solid"),
    "pw-T6": lambda: (Spaces.petrov_galerkin(rectangle("triangle")), "plane strain"),
    "galerkin-T6": lambda: (Spaces.galerkin(rectangle("triangle")), "plane stress"),
    "pw-Q9": lambda: (Spaces.petrov_galerkin(rectangle("quadrilateral")), "axisymmetric"),
    "galerkin-Q8": lambda: (Spaces.serendipity(rectangle("quadrilateral")), "plane stress"),
    "composite-T6": lambda: (Spaces.composite(rectangle("triangle")), "plane stress"),
    "pw-T6, curved": lambda: (Spaces.petrov_galerkin(bent(rectangle("triangle"))), "axisymmetric"),
    "pw-T10, curved": lambda: (Spaces.petrov_galerkin(bent(box("tetrahedron"))), "solid"),
}


def case(name, nu=0.3):
    """Stiffness, load and supports with prescribed displacements that are not zero."""
    spaces, state = BODIES[name]()
    body = Body(spaces, Material(1000.0, nu), state)
    U = spaces.trial
    dim = spaces.mesh.geometry.dim
    x = U.tabulate_dof_coordinates()
    left, right = x[:, 0].min(), x[:, 0].max()
    held = [
        prescribe(U, i, lambda x, left=left: x[0] < left + 0.1, 0.01 * i - 0.005)
        for i in range(dim)
    ]
    held.append(prescribe(U, dim - 1, lambda x: x[0] > right - 0.1, 0.02))
    f = assemble_vector(body.body_load([0.3, -1.0, 0.2][:dim]))
    return body, assemble_matrix(body.stiffness()), f, Reduction.dirichlet(U, held)


def difference(a, b):
    return (a - b).norm() / b.norm()


@pytest.mark.parametrize("name", BODIES)
def test_displacements_are_those_of_the_direct_solver(name):
    _, K, f, held = case(name)
    before = K.norm()
    a = solve(K, f, held, Iterative())
    assert difference(a, solve(K, f, held, Direct())) < 1e-10
    assert K.norm() == before  # nothing is written into it
    report = a.getAttr("report")
    assert report.method == "GMRES with p-multigrid"
    assert report.factorisations == 0
    assert 5 < report.krylov_iterations < 80


@pytest.mark.parametrize("name", ["pw-T10", "pw-H27", "galerkin-H27", "pw-T6", "galerkin-Q8"])
def test_the_coarse_level_is_the_stiffness_of_linear_elements(name):
    """P^T K P against a matrix that is assembled from linear functions on both sides."""
    spaces, state = BODIES[name]()
    degree = 8  # any, but the same: cells are not parallelepipeds
    material = Material(1000.0, 0.3)
    K = assemble_matrix(Body(spaces, material, state, quadrature_degree=degree).stiffness())
    shape = (spaces.mesh.geometry.dim,)
    linear = fem.functionspace(spaces.mesh, ("Lagrange", 1, shape))
    both = Spaces(linear, linear)
    expected = assemble_matrix(Body(both, material, state, quadrature_degree=degree).stiffness())
    free = Reduction.dirichlet(spaces.trial, []).supports
    coarse = Multigrid(K, free).coarse
    # macro functions see the points of each sub-cell: exact on straight simplices only
    exact = "T" in name or name.startswith("galerkin")
    assert (coarse - expected).norm() < (1e-12 if exact else 1e-3) * expected.norm()


@pytest.mark.parametrize("sprung", [False, True])
@pytest.mark.parametrize("blocked", [False, True])
def test_the_coarse_level_follows_what_is_held(blocked, sprung):
    """It is P^T K P by DOLFINx's P with all that is held taken out of K and P, always anew.

    Springs hold in place of that what they join to the far end.
    """
    random = np.random.default_rng(3)
    body = Body(Spaces.petrov_galerkin(box("tetrahedron")), Material(1000.0, 0.3), "solid")
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness(), blocked)
    clamped = [prescribe(U, 1, lambda x: np.isclose(x[0], 0))]
    supports = Reduction.dirichlet(U, clamped).supports
    grid = Multigrid(K, supports)
    linear = fem.functionspace(U.mesh, ("Lagrange", 1, (3,)))
    x, at_vertices = U.tabulate_dof_coordinates(), linear.tabulate_dof_coordinates()
    vertex = np.argmin(np.linalg.norm(x[:, None] - at_vertices, axis=2), axis=0)
    P = interpolation_matrix(linear, U)
    P.assemble()
    P, K = P[:, :], K[:, :]
    nodes = random.permutation(np.flatnonzero((x[:, 2] < 0.2) & (x[:, 0] > 0.1)))
    far = np.flatnonzero((x[:, 2] > 0.8) & (x[:, 0] > 0.1))
    apart = np.zeros((3 * len(nodes), len(K)))
    apart[:, (far[:, None] * 3 + np.arange(3)).ravel()] = -1 / len(far)
    apart[:, (nodes[:, None] * 3 + np.arange(3)).ravel()] += np.eye(len(apart))
    for _ in range(3):
        normal = random.normal(size=(len(nodes), 3))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        held = np.einsum("na,nb->nab", normal, normal) * random.integers(0, 2, (len(nodes), 1, 1))
        B, springs = apart.T @ block_diag(*held) @ apart, None
        if sprung:
            springs = PETSc.Mat().createDense(B.shape, array=B, comm=MPI.COMM_SELF).convert("aij")
        grid.hold(nodes, held, np.ones(len(nodes)), springs)
        blocks = np.eye(3) * supports.free.reshape(-1, 1, 3)
        if not sprung:
            blocks[nodes] -= held
        free, coarse = (block_diag(*some) for some in (blocks, blocks[vertex]))
        moved = free @ P @ coarse
        expected = moved.T @ (K + B * sprung) @ moved
        expected += np.trace(expected) / len(expected) * (np.eye(len(expected)) - coarse)
        assert np.abs(grid.coarse[:, :] - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("rows", [12_000, 90])
def test_matrices_in_blocks(monkeypatch, rows):
    """They give the same, coarse level included, however many rows are converted at once."""
    monkeypatch.setattr(matrices, "_ROWS_AT_ONCE", rows)
    body, K, f, held = case("pw-T10")
    blocked = assemble_matrix(body.stiffness(), blocked=True)
    assert blocked.getType() == "seqbaij"
    free = Reduction.dirichlet(body.spaces.trial, []).supports
    coarse = Multigrid(K, free).coarse
    assert (Multigrid(blocked, free).coarse - coarse).norm() < 1e-14 * coarse.norm()
    known = solve(K, f, held, Direct())
    for solver in (Direct(), Iterative()):
        assert difference(solve(blocked, f, held, solver), known) < 1e-10
        modes = [
            vibration_modes(
                assemble_matrix(body.stiffness(), b), assemble_matrix(body.mass(), b), held, 3
            ).eigenvalues
            for b in (True, False)
        ]
        assert modes[0] == pytest.approx(modes[1], rel=1e-10)


def test_a_scalar_field():
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], (4, 4, 4))
    V = fem.functionspace(mesh, ("Lagrange", 2))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(test_space(V))
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(v * ufl.dx)
    mesh.topology.create_connectivity(2, 3)
    rim = fem.locate_dofs_topological(V, 2, exterior_facet_indices(mesh.topology))
    held = Reduction.dirichlet(V, [fem.dirichletbc(0.5, rim, V)])
    assert difference(solve(K, f, held, Iterative()), solve(K, f, held, Direct())) < 1e-10
    with pytest.raises(SingularSystem):
        solve(K, f, Reduction.dirichlet(V, []), Iterative())


def test_options_pass_through():
    _, K, f, held = case("pw-T10")
    plain = solve(K, f, held, Iterative()).getAttr("report")
    options = {"ksp_type": "fgmres", "mg_levels_1_ksp_max_it": 6, "-mg_coarse_pc_type": "lu"}
    thorough = solve(K, f, held, Iterative(options=options)).getAttr("report")
    assert thorough.method == "FGMRES with p-multigrid"
    assert thorough.krylov_iterations < plain.krylov_iterations
    rough = solve(K, f, held, Iterative(1e-3)).getAttr("report")
    assert rough.krylov_iterations < plain.krylov_iterations / 2


def test_what_does_not_converge_is_not_returned():
    _, K, f, held = case("pw-T10")
    with pytest.raises(NotConverged, match=r"after 6 iterations in all: Poisson.* use Direct\(\)"):
        solve(K, f, held, Iterative(options={"ksp_max_it": 3}))  # begun twice


def test_a_body_without_supports_is_refused():
    body, K, f, _ = case("pw-T10")
    U = body.spaces.trial
    for components in (0, 2):
        few = [prescribe(U, i, lambda x: x[0] < 0.1) for i in range(components)]
        with pytest.raises(SingularSystem, match="the supports leave a rigid motion free"):
            solve(K, f, Reduction.dirichlet(U, few), Iterative())
    corner = [prescribe(U, i, lambda x: np.linalg.norm(x, axis=0) < 1e-9) for i in range(3)]
    with pytest.raises(SingularSystem, match="the supports leave a rigid motion free"):
        solve(K, f, Reduction.dirichlet(U, corner), Iterative())


def two_cubes():
    """Two tetrahedral cubes that share no node."""
    one = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], (2, 2, 2))
    x, cells = one.geometry.x, cell_nodes(one)
    both = np.vstack([x, x + np.array([3.0, 0, 0])]), np.vstack([cells, cells + len(x)])
    return create_mesh(
        MPI.COMM_SELF,
        cells=both[1].astype(np.int64),
        x=both[0],
        e=one.ufl_domain().ufl_coordinate_element(),
    )


def test_each_of_two_bodies_needs_supports():
    body = Body(Spaces.petrov_galerkin(two_cubes()), Material(1.0, 0.3), "solid")
    U, K = body.spaces.trial, assemble_matrix(body.stiffness())
    f = assemble_vector(body.body_load((0.0, 1.0, 1.0)))
    left = [prescribe(U, i, at(0, 0.0)) for i in range(3)]
    both = left + [prescribe(U, i, at(0, 4.0)) for i in range(3)]
    with pytest.raises(SingularSystem, match="the supports leave a rigid motion free"):
        solve(K, f, Reduction.dirichlet(U, left), Iterative())
    held = Reduction.dirichlet(U, both)
    assert difference(solve(K, f, held, Iterative()), solve(K, f, held, Direct())) < 1e-10


def test_auto_takes_factors_in_the_plane_and_of_small_bodies(caplog):
    small, large = (
        Reduction.dirichlet(Spaces.galerkin(box("hexahedron", n)).trial, []).supports
        for n in (4, 7)
    )
    fine = quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (80, 60))
    flat = Reduction.dirichlet(Spaces.galerkin(fine).trial, []).supports
    with caplog.at_level(logging.INFO, logger="pw_elements"):
        for word in (None, "auto"):
            assert (
                auto_solver(word, small)
                == auto_solver(word, flat)
                == auto_solver(word, None)
                == Direct()
            )
        assert not caplog.records
        assert auto_solver("auto", large) == auto_solver(None, large) == Iterative()
        assert auto_solver("auto", large, "a reason") == Direct()
    said = [record.getMessage() for record in caplog.records]
    assert said[0] == "auto: Iterative for 19575 unknowns in space; factors take some 0.2 GB"
    assert "auto: Direct for 19575 unknowns in space (a reason)" in said[2]
    asked = Iterative(1e-3)
    assert auto_solver(asked, None) is asked
    with pytest.raises(ValueError, match="solver 'fast': use"):
        auto_solver("fast", small)
    with pytest.raises(ValueError, match=r"tolerance = 0\.0"):
        Iterative(0.0)


@pytest.mark.parametrize(
    ("name", "free"), [("pw-T10", False), ("galerkin-H27", True), ("pw-T6", True)]
)
def test_natural_frequencies_are_those_of_the_direct_solver(name, free):
    body, K, _, held = case(name)
    M = assemble_matrix(body.mass())
    if free:
        held = Reduction.dirichlet(body.spaces.trial, [])
    a, b = (vibration_modes(K, M, held, 8, solver=s) for s in (Iterative(), Direct()))
    assert a.rigid == b.rigid == (free and {2: 3, 3: 6}[body.spaces.mesh.geometry.dim])
    assert a.eigenvalues[a.rigid :] == pytest.approx(b.eigenvalues[a.rigid :], rel=1e-9)
    assert a.residuals.max() < 1e-9
    assert a.report.method == "GMRES with p-multigrid"
    assert a.report.krylov_iterations > 100
    assert b.report.method == ("LDL^T" if name.startswith("galerkin") else "LU") + " by mumps"


@pytest.mark.parametrize("name", ["galerkin-T10", "pw-T10", "pw-T6"])
def test_buckling_factors_are_those_of_the_direct_solver(name):
    body, K, f, held = case(name)
    U = body.spaces.trial
    prestress = body.stress(as_function(U, solve(K, f, held, Direct())))
    K_sigma = assemble_matrix(body.initial_stress(prestress))
    a, b = (buckling(K, K_sigma, held, 2, solver=s) for s in (Iterative(), Direct()))
    assert a.factors == pytest.approx(b.factors, rel=1e-8)
    assert b.report.method == ("LDL^T" if name.startswith("galerkin") else "LU") + " by mumps"
    with pytest.raises(SingularSystem, match="rigid motion free"):
        buckling(K, K_sigma, Reduction.dirichlet(U, []), solver=Iterative())


def test_modes_that_need_factors_or_more_iterations():
    body, K, _, held = case("pw-T10")
    M = assemble_matrix(body.mass())
    with pytest.raises(ValueError, match="does not count negative pivots"):
        vibration_modes(K, M, held, symmetrised=True, solver=Iterative())
    with pytest.raises(NotConverged, match="left a mode with the residual"):
        vibration_modes(K, M, held, solver=Iterative(options={"ksp_max_it": 3}))


def test_condensation_needs_factors():
    spaces = Spaces.petrov_galerkin(rectangle("quadrilateral"))
    body = Body(spaces, Material(1.0, 0.3), "plane stress")
    U, K = spaces.trial, assemble_matrix(body.stiffness())
    f = assemble_vector(body.body_load((0.0, 1.0)))
    held = [prescribe(U, i, lambda x: x[0] < 1.1) for i in (0, 1)]
    condensed = Reduction.condensation(K, U, centre_nodes(U), held)
    with pytest.raises(ValueError, match=r"static condensation .* need Direct\(\)"):
        solve(K, f, condensed, Iterative())
    assert solve(K, f, condensed).getAttr("report").method == "LU by mumps"

"""Iterative solver: agreement with the direct solver, multigrid levels, fallbacks and errors."""

import logging
import os

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import interpolation_matrix
from dolfinx.mesh import CellType, create_box, create_mesh
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
    assemble_matrix,
    assemble_vector,
    buckling,
    prescribe,
    solve,
    test_space,
    vibration_modes,
)
from pw_elements._compat import cell_geometry_nodes
from pw_elements.contact import ContactPair, NoEquilibrium, Plane, solve_contact
from pw_elements.contact.system import preconditioners
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from pw_elements.solvers import Multigrid, automatic, choose_solver, iterative, matrices
from study.meshes.inner_nodes import centre_nodes
from study.model.elements import composite_spaces
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, Q8, ElasticBody, on_plane
from tests.contact.iterative import SolidBlock, nearly_sliding_contact_arguments
from tests.library.properties import boundary_dofs


def make_distorted_box(cell, n=2, comm=MPI.COMM_SELF):
    mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (2 * n, n, n), CellType[cell])
    return move_nodes(mesh, lambda x: x + 0.05 * np.sin(3 * x[:, [1, 2, 0]]) * x[:, :1])


def make_distorted_rectangle(cell):
    build = triangles if cell == "triangle" else quadrilaterals
    mesh = build(MPI.COMM_SELF, (1.0, 0.0), (3.0, 1.0), (8, 4))
    return move_nodes(mesh, lambda x: x + 0.05 * np.sin(3 * x[:, [1, 2, 0]]) * [1, 1, 0])


def bend_edges(mesh):
    return curved_mesh(mesh, lambda x: x + 0.1 * np.sin(2 * x[:, [1, 2, 0]]) * (x**0 * [1, 1, 0]))


ELASTIC_BODY_ARGUMENTS = {
    "pw-T10": lambda: (make_distorted_box("tetrahedron"), PETROV_GALERKIN, "solid"),
    "galerkin-T10": lambda: (make_distorted_box("tetrahedron"), GALERKIN, "solid"),
    "pw-H27": lambda: (make_distorted_box("hexahedron"), PETROV_GALERKIN, "solid"),
    "galerkin-H27": lambda: (make_distorted_box("hexahedron"), GALERKIN, "solid"),
    "pw-T6": lambda: (make_distorted_rectangle("triangle"), PETROV_GALERKIN, "plane strain"),
    "galerkin-T6": lambda: (make_distorted_rectangle("triangle"), GALERKIN, "plane stress"),
    "pw-Q9": lambda: (make_distorted_rectangle("quadrilateral"), PETROV_GALERKIN, "axisymmetric"),
    "galerkin-Q8": lambda: (make_distorted_rectangle("quadrilateral"), Q8, "plane stress"),
    "composite-T6": lambda: (
        make_distorted_rectangle("triangle"),
        composite_spaces,
        "plane stress",
    ),
    "pw-T6, curved": lambda: (
        bend_edges(make_distorted_rectangle("triangle")),
        PETROV_GALERKIN,
        "axisymmetric",
    ),
    "pw-T10, curved": lambda: (
        bend_edges(make_distorted_box("tetrahedron")),
        PETROV_GALERKIN,
        "solid",
    ),
}


class LoadedBody(ElasticBody):
    """Body with a body force, and supports with non-zero prescribed displacements."""

    def __init__(self, name, nu=0.3):
        super().__init__(*ELASTIC_BODY_ARGUMENTS[name](), nu=nu)
        left, right = self.x[:, 0].min(), self.x[:, 0].max()
        self.f = self.body_force_load([0.3, -1.0, 0.2][: self.dim])
        foot = [(i, lambda x: x[0] < left + 0.1, 0.01 * i - 0.005) for i in range(self.dim)]
        self.supports = self.make_supports(
            *foot, (self.dim - 1, lambda x: x[0] > right - 0.1, 0.02)
        )

    def solve_by(self, solver):
        return solve(self.K, self.f, self.supports, solver)


def relative_difference(a, b):
    return (a - b).norm() / b.norm()


@pytest.mark.parametrize("name", ELASTIC_BODY_ARGUMENTS)
def test_iterative_displacements_are_those_of_the_direct_solver(name):
    case = LoadedBody(name)
    norm = case.K.norm()
    a = case.solve_by(Iterative())
    assert relative_difference(a, case.solve_by(Direct())) < 1e-10
    assert case.K.norm() == norm  # the solver does not write into the matrix
    report = a.getAttr("report")
    assert report.method == "GMRES with p-multigrid"
    assert report.factorisations == 0
    assert 5 < report.krylov_iterations < 80


def test_flexible_gmres_applies_one_multigrid_cycle_per_iteration():
    case = LoadedBody("pw-T10")
    prepared = Iterative().prepare(case.K, supports=case.supports.supports)
    prepared.set_up()
    levels, applied = prepared.ksp.getPC(), []

    class CountingPreconditioner:
        def apply(self, _, x, y):
            applied.append(1)
            levels.apply(x, y)

    ksp = prepared.create_flexible_ksp(prepared.operator, CountingPreconditioner())
    a, rhs = prepared.solve(case.f), case.f.duplicate()
    ksp.solve(case.f, rhs)
    assert len(applied) == ksp.getIterationNumber() > 5
    assert relative_difference(rhs, a) < 1e-10


@pytest.mark.parametrize("name", ["pw-T10", "pw-H27", "galerkin-H27", "pw-T6", "galerkin-Q8"])
def test_the_coarse_level_is_the_stiffness_of_linear_elements(name):
    """The coarse matrix equals the stiffness matrix of linear trial and test functions.

    The coarse matrix is P^T K P, with the stiffness K and the interpolation P from linear elements.
    """
    mesh, method, state = ELASTIC_BODY_ARGUMENTS[name]()
    linear, spaces = fem.functionspace(mesh, ("Lagrange", 1, (mesh.geometry.dim,))), method(mesh)
    K, expected = (  # the same rule for both, because cells are not parallelepipeds
        assemble_matrix(Body(pair, Material(1.0, 0.3), state, quadrature_degree=8).stiffness())
        for pair in (spaces, Spaces(linear, linear))
    )
    coarse = Multigrid(K, Reduction.dirichlet(spaces.trial, []).supports).coarse_matrix
    # integrals of weights use points in each sub-cell, and are exact on straight simplices only
    exact = "T" in name or name.startswith("galerkin")
    assert (coarse - expected).norm() < (1e-12 if exact else 1e-3) * expected.norm()


@pytest.mark.parametrize("sprung", [False, True])
@pytest.mark.parametrize("blocked", [False, True])
def test_the_coarse_level_follows_the_constraints(blocked, sprung):
    """The coarse matrix takes account of the directions in which nodes are constrained.

    The reference is P^T K P, with the interpolation P from linear elements, which DOLFINx computes.
    Supports are removed from P and the stiffness K. Constrained directions of nodes are projected
    out as well or, if `sprung`, springs in these directions are added to K.
    """
    random = np.random.default_rng(3)
    body = ElasticBody(make_distorted_box("tetrahedron"), state="solid")
    U, K = body.space, assemble_matrix(body.body.stiffness(), blocked)
    supports = body.make_supports((1, on_plane(0, 0.0))).supports
    grid = Multigrid(K, supports)
    linear = fem.functionspace(U.mesh, ("Lagrange", 1, (3,)))
    x, at_vertices = U.tabulate_dof_coordinates(), linear.tabulate_dof_coordinates()
    vertex = np.argmin(np.linalg.norm(x[:, None] - at_vertices, axis=2), axis=0)
    P = interpolation_matrix(linear, U)
    P.assemble()
    P, K = P[:, :], K[:, :]
    nodes = random.permutation(np.flatnonzero((x[:, 2] < 0.2) & (x[:, 0] > 0.1)))
    far = np.flatnonzero((x[:, 2] > 0.8) & (x[:, 0] > 0.1))
    separation = np.zeros((3 * len(nodes), len(K)))
    separation[:, (far[:, None] * 3 + np.arange(3)).ravel()] = -1 / len(far)
    separation[:, (nodes[:, None] * 3 + np.arange(3)).ravel()] += np.eye(len(separation))
    for _ in range(3):
        normal = random.normal(size=(len(nodes), 3))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        projectors = np.einsum("na,nb->nab", normal, normal) * random.integers(
            0, 2, (len(nodes), 1, 1)
        )
        B, springs = separation.T @ block_diag(*projectors) @ separation, None
        if sprung:
            springs = PETSc.Mat().createAIJ(B.shape, nnz=len(B), comm=MPI.COMM_SELF)
            springs.setValues(range(len(B)), range(len(B)), B)  # zeros are stored as well
            springs.assemble()
        grid.set_constrained_directions(nodes, projectors, np.ones(len(nodes)), springs)
        blocks = np.eye(3) * supports.free.reshape(-1, 1, 3)
        if not sprung:
            blocks[nodes] -= projectors
        free, coarse = (block_diag(*node_blocks) for node_blocks in (blocks, blocks[vertex]))
        projected_P = free @ P @ coarse
        expected = projected_P.T @ (K + B * sprung) @ projected_P
        expected += np.trace(expected) / len(expected) * (np.eye(len(expected)) - coarse)
        assert np.abs(grid.coarse_matrix[:, :] - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("rows", [12_000, 90])
def test_block_matrices_give_the_same_results(monkeypatch, rows):
    monkeypatch.setattr(matrices, "_MIN_ROWS_PER_AIJ_CONVERSION", rows)
    case = LoadedBody("pw-T10")
    blocked = assemble_matrix(case.body.stiffness(), blocked=True)
    assert blocked.getType() == "seqbaij"
    coarse = Multigrid(case.K, case.make_supports().supports).coarse_matrix
    again = Multigrid(blocked, case.make_supports().supports).coarse_matrix
    assert (again - coarse).norm() < 1e-14 * coarse.norm()
    expected, mass = case.solve_by(Direct()), assemble_matrix(case.body.mass(), blocked=True)
    for solver in (Direct(), Iterative()):
        assert relative_difference(solve(blocked, case.f, case.supports, solver), expected) < 1e-10
    modes = [
        vibration_modes(K, M, case.supports, 3).eigenvalues
        for K, M in ((blocked, mass), (case.K, case.M))
    ]
    assert modes[0] == pytest.approx(modes[1], rel=1e-10)


def test_iterative_solver_solves_scalar_fields_and_refuses_singular_ones():
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], (4, 4, 4))
    V = fem.functionspace(mesh, ("Lagrange", 2))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(test_space(V))
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(v * ufl.dx)
    supports = Reduction.dirichlet(V, [fem.dirichletbc(0.5, boundary_dofs(V), V)])
    assert (
        relative_difference(solve(K, f, supports, Iterative()), solve(K, f, supports, Direct()))
        < 1e-10
    )
    with pytest.raises(SingularSystem):
        solve(K, f, Reduction.dirichlet(V, []), Iterative())


def test_petsc_options_reach_the_iterative_solver():
    case = LoadedBody("pw-T10")
    options = {"ksp_type": "fgmres", "mg_levels_1_ksp_max_it": 6, "-mg_coarse_pc_type": "lu"}
    plain, thorough, rough = (
        case.solve_by(Iterative(**settings)).getAttr("report")
        for settings in ({}, {"options": options}, {"tolerance": 1e-3})
    )
    assert thorough.method == "FGMRES with p-multigrid"
    assert thorough.krylov_iterations < plain.krylov_iterations
    assert rough.krylov_iterations < plain.krylov_iterations / 2


def test_an_unconverged_solution_is_refused():
    with pytest.raises(NotConverged, match=r"after 6 iterations in all: Poisson.* use Direct\(\)"):
        LoadedBody("pw-T10").solve_by(Iterative(options={"ksp_max_it": 3}))  # two starts of 3


def test_a_body_without_supports_is_refused():
    case = LoadedBody("pw-T10")
    corner = [(i, lambda x: np.linalg.norm(x, axis=0) < 1e-9) for i in range(3)]
    for few in ([], [(0, on_plane(0, 0.0)), (1, on_plane(0, 0.0))], corner):
        with pytest.raises(SingularSystem, match="the supports leave a rigid motion free"):
            solve(case.K, case.f, case.make_supports(*few), Iterative())


def make_mesh_of_two_separate_cubes():
    cube = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], (2, 2, 2))
    x, cells = cube.geometry.x, cell_geometry_nodes(cube)
    meshes = np.vstack([x, x + np.array([3.0, 0, 0])]), np.vstack([cells, cells + len(x)])
    return create_mesh(
        MPI.COMM_SELF,
        cells=meshes[1].astype(np.int64),
        x=meshes[0],
        e=cube.ufl_domain().ufl_coordinate_element(),
    )


def test_each_of_two_bodies_needs_supports():
    body = ElasticBody(make_mesh_of_two_separate_cubes(), state="solid")
    f, left = body.body_force_load((0.0, 1.0, 1.0)), [(i, on_plane(0, 0.0)) for i in range(3)]
    with pytest.raises(SingularSystem, match="the supports leave a rigid motion free"):
        solve(body.K, f, body.make_supports(*left), Iterative())
    supports = body.make_supports(*left, *((i, on_plane(0, 4.0)) for i in range(3)))
    a, expected = (solve(body.K, f, supports, solver) for solver in (Iterative(), Direct()))
    assert relative_difference(a, expected) < 1e-10


def test_auto_selects_direct_for_plane_and_small_bodies(caplog):
    small, large = (
        Reduction.dirichlet(Spaces.galerkin(make_distorted_box("hexahedron", n)).trial, []).supports
        for n in (4, 7)
    )
    fine = quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (80, 60))
    flat = Reduction.dirichlet(Spaces.galerkin(fine).trial, []).supports
    with caplog.at_level(logging.INFO, logger="pw_elements"):
        for word in (None, "auto"):
            assert (
                choose_solver(word, small)
                == choose_solver(word, flat)
                == choose_solver(word, None)
                == Direct()
            )
        assert not caplog.records
        assert choose_solver("auto", large) == choose_solver(None, large) == Iterative()
        assert choose_solver("auto", large, "a reason") == Direct()
    said = [record.getMessage() for record in caplog.records]
    assert said[0] == "auto: Iterative for 19575 unknowns in space; factors take some 0.2 GB"
    assert "auto: Direct for 19575 unknowns in space (a reason)" in said[2]
    asked = Iterative(1e-3)
    assert choose_solver(asked, None) is asked
    with pytest.raises(ValueError, match="solver 'fast': use"):
        choose_solver("fast", small)
    with pytest.raises(ValueError, match=r"tolerance = 0\.0"):
        Iterative(0.0)


@pytest.mark.parametrize(
    ("name", "free"), [("pw-T10", False), ("galerkin-H27", True), ("pw-T6", True)]
)
def test_natural_frequencies_are_those_of_the_direct_solver(name, free):
    case = LoadedBody(name)
    supports = case.make_supports() if free else case.supports
    a, b = (vibration_modes(case.K, case.M, supports, 8, solver=s) for s in (Iterative(), Direct()))
    assert a.n_rigid == b.n_rigid == (free and {2: 3, 3: 6}[case.dim])
    assert a.eigenvalues[a.n_rigid :] == pytest.approx(b.eigenvalues[a.n_rigid :], rel=1e-9)
    assert a.residuals.max() < 1e-9
    assert a.report.method == "GMRES with p-multigrid"
    assert a.report.krylov_iterations > 100
    assert b.report.method == ("LDL^T" if name.startswith("galerkin") else "LU") + " by mumps"


@pytest.mark.parametrize("name", ["galerkin-T10", "pw-T10", "pw-T6"])
def test_buckling_factors_are_those_of_the_direct_solver(name):
    case = LoadedBody(name)
    K_sigma = case.initial_stress_matrix(case.f, case.supports)
    a, b = (buckling(case.K, K_sigma, case.supports, 2, solver=s) for s in (Iterative(), Direct()))
    assert a.factors == pytest.approx(b.factors, rel=1e-8)
    assert b.report.method == ("LDL^T" if name.startswith("galerkin") else "LU") + " by mumps"
    with pytest.raises(SingularSystem, match="rigid motion free"):
        buckling(case.K, K_sigma, case.make_supports(), solver=Iterative())


def test_modes_that_the_iterative_solver_cannot_compute_are_refused():
    case = LoadedBody("pw-T10")
    problem = case.K, case.M, case.supports
    with pytest.raises(ValueError, match="does not count negative pivots"):
        vibration_modes(*problem, symmetrised=True, solver=Iterative())
    with pytest.raises(NotConverged, match="left a mode with the residual"):
        vibration_modes(*problem, solver=Iterative(options={"ksp_max_it": 3}))


def test_iterative_solver_refuses_condensation():
    case = LoadedBody("pw-Q9")
    U = case.space
    conditions = [prescribe(U, i, lambda x: x[0] < 1.1) for i in (0, 1)]
    condensed = Reduction.condensation(case.K, U, centre_nodes(U), conditions)
    with pytest.raises(ValueError, match=r"static condensation .* need Direct\(\)"):
        solve(case.K, case.f, condensed, Iterative())
    assert solve(case.K, case.f, condensed).getAttr("report").method == "LU by mumps"


FALLBACK_LOG_MESSAGE = "auto: Iterative gave up, Direct goes on; factors take some"


@pytest.fixture
def treat_all_bodies_as_large(monkeypatch):
    """Make "auto" treat bodies of any size as large."""
    for limit in (
        "_MIN_KRYLOV_DOFS",
        "_MIN_KRYLOV_DOFS_IF_HELD_BY_CONTACT",
        "_MIN_KRYLOV_DOFS_FOR_MODES",
    ):
        monkeypatch.setattr(automatic, limit, 1)
    monkeypatch.setattr(
        preconditioners, "_MIN_STICKING_NODES_WITHOUT_ANCHORS", 0
    )  # GMRES then fails where no node sticks


@pytest.mark.parametrize(
    ("is_top_clamped", "method"), [(False, "LU by mumps"), (True, "GMRES with p-m")]
)
def test_auto_selects_direct_for_larger_bodies_that_only_contact_supports(
    monkeypatch, is_top_clamped, method
):
    monkeypatch.setattr(automatic, "_MIN_KRYLOV_DOFS", 1)
    solid = SolidBlock(n=2)
    supports = (
        solid.make_supports(*((i, on_plane(2, 1.0)) for i in range(3)))
        if is_top_clamped
        else solid.no_supports
    )
    pair = ContactPair(on_plane(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
    load = solid.traction_load((0.0, 0.0, -1.0), on_plane(0, 0.0)) + solid.traction_load(
        (0.0, 0.0, -1.0), on_plane(0, 2.0)
    )
    (state,) = solve_contact(solid.K, load, supports, pair, solid.space)
    assert state.report.method.startswith(method)


@pytest.mark.usefixtures("treat_all_bodies_as_large")
def test_contact_falls_back_to_the_direct_solver(caplog):
    arguments = nearly_sliding_contact_arguments(SolidBlock(n=2))
    expected = solve_contact(*arguments, solver=Direct())
    with pytest.raises(NotConverged, match=r"use Direct\(\)") as failed:
        solve_contact(*arguments, solver=Iterative())
    assert "auto" not in str(failed.value)
    messages = []
    with caplog.at_level(logging.INFO, logger="pw_elements"):
        states = solve_contact(*arguments, callback=messages.append)
    methods = [state.report.method for state in states]
    assert methods == ["GMRES with p-multigrid", "LU by mumps", "LU by mumps"]
    assert [state.increment for state in states] == [1, 2, 3]
    said = [record.getMessage() for record in caplog.records if record.name == "pw_elements"]
    assert sum(words.startswith(FALLBACK_LOG_MESSAGE) for words in said) == 1
    assert [progress.state for progress in messages if progress.state] == states
    for state, exact in zip(states, expected, strict=True):
        assert relative_difference(state.displacement, exact.displacement) < 1e-9
        assert np.array_equal(state.pairs[0].status, exact.pairs[0].status)
        assert state.pairs[0].force == pytest.approx(exact.pairs[0].force, rel=1e-9, abs=1e-9)


@pytest.mark.usefixtures("treat_all_bodies_as_large")
def test_auto_raises_if_memory_is_too_small_for_the_direct_solver(monkeypatch):
    arguments = nearly_sliding_contact_arguments(SolidBlock(n=2))
    monkeypatch.setattr(automatic, "total_free_memory_in_bytes", lambda _: 1e6)
    with pytest.raises(NotConverged, match=r"\"auto\" does not use .* 0\.001 GB left"):
        solve_contact(*arguments)


@pytest.mark.parametrize("solver", ["auto", Iterative()])
@pytest.mark.usefixtures("treat_all_bodies_as_large")
def test_infeasibility_is_proved_before_the_fallback(solver, caplog):
    """A problem without solution is refused by a proof, before the direct solver is tried.

    The body is pushed by more than friction can carry, and Krylov's method fails.
    """
    K, loads, supports, pair, U = nearly_sliding_contact_arguments(
        SolidBlock(n=2), push_over_pressure=0.8
    )
    with caplog.at_level(logging.INFO), pytest.raises(NoEquilibrium, match="slides along"):
        solve_contact(K, loads, supports, pair, U, solver=solver)
    assert not any(FALLBACK_LOG_MESSAGE in record.getMessage() for record in caplog.records)


@pytest.mark.usefixtures("treat_all_bodies_as_large")
def test_linear_problems_fall_back_to_the_direct_solver(monkeypatch):
    monkeypatch.setattr(automatic, "Iterative", lambda: Iterative(options={"ksp_max_it": 3}))
    rubber = ElasticBody(make_distorted_box("tetrahedron"), Spaces.hybrid, "solid", 1.0, 0.5)
    f, foot = (
        rubber.body_force_load((0.0, 0.0, -1.0)),
        rubber.make_clamping_supports(on_plane(0, 0.0)),
    )
    a, expected = (solve(rubber.K, f, foot, solver) for solver in ("auto", Direct()))
    assert a.getAttr("report").method == "LU by mumps"
    assert relative_difference(a, expected) == 0
    case = LoadedBody("pw-T10", nu=0.49)
    K_sigma = case.initial_stress_matrix(case.f, case.supports)
    for computed, matrix, name in (
        (vibration_modes, case.M, "eigenvalues"),
        (buckling, K_sigma, "factors"),
    ):
        modes, expected = (
            computed(case.K, matrix, case.supports, 2, solver=s) for s in (None, Direct())
        )
        assert modes.report == expected.report
        assert getattr(modes, name) == pytest.approx(getattr(expected, name), rel=1e-10)


def test_memory_of_factors_and_free_memory_are_estimated():
    """The estimates of the memory for factors and of the free memory are reasonable.

    MUMPS took 6.2 GB for 212 355 unknowns; the estimate must agree within 30 %. Free memory must be
    less than the memory of the machine.
    """
    assert iterative.estimate_factor_memory_in_bytes(212_355) == pytest.approx(6.2e9, rel=0.3)
    assert (
        0
        < automatic.total_free_memory_in_bytes(MPI.COMM_WORLD)
        < os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    )

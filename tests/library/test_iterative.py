"""The iterative solver gives the numbers of the direct one, or says why it does not."""

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
from pw_elements._compat import cell_nodes
from pw_elements.contact import ContactPair, NoEquilibrium, Plane, solve_contact
from pw_elements.contact.system import krylov
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from pw_elements.solvers import Multigrid, automatic, choose_solver, iterative, matrices
from study.elements import composite
from study.inner_nodes import centre_nodes
from tests.contact.cases import GALERKIN, PW, Q8, ElasticBody, on_plane
from tests.contact.iterative import SolidBlock, nearly_sliding_arguments
from tests.library.properties import rim_of


def box(cell, n=2, comm=MPI.COMM_SELF):
    mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (2 * n, n, n), CellType[cell])
    return move_nodes(mesh, lambda x: x + 0.05 * np.sin(3 * x[:, [1, 2, 0]]) * x[:, :1])


def rectangle(cell):
    build = triangles if cell == "triangle" else quadrilaterals
    mesh = build(MPI.COMM_SELF, (1.0, 0.0), (3.0, 1.0), (8, 4))
    return move_nodes(mesh, lambda x: x + 0.05 * np.sin(3 * x[:, [1, 2, 0]]) * [1, 1, 0])


def bent(build):
    return curved_mesh(build, lambda x: x + 0.1 * np.sin(2 * x[:, [1, 2, 0]]) * (x**0 * [1, 1, 0]))


BODIES = {
    "pw-T10": lambda: (box("tetrahedron"), PW, "solid"),
    "galerkin-T10": lambda: (box("tetrahedron"), GALERKIN, "solid"),
    "pw-H27": lambda: (box("hexahedron"), PW, "solid"),
    "galerkin-H27": lambda: (box("hexahedron"), GALERKIN, "solid"),
    "pw-T6": lambda: (rectangle("triangle"), PW, "plane strain"),
    "galerkin-T6": lambda: (rectangle("triangle"), GALERKIN, "plane stress"),
    "pw-Q9": lambda: (rectangle("quadrilateral"), PW, "axisymmetric"),
    "galerkin-Q8": lambda: (rectangle("quadrilateral"), Q8, "plane stress"),
    "composite-T6": lambda: (rectangle("triangle"), composite, "plane stress"),
    "pw-T6, curved": lambda: (bent(rectangle("triangle")), PW, "axisymmetric"),
    "pw-T10, curved": lambda: (bent(box("tetrahedron")), PW, "solid"),
}


class Case(ElasticBody):
    """A body, its load, and supports with prescribed displacements that are not zero."""

    def __init__(self, name, nu=0.3):
        super().__init__(*BODIES[name](), nu=nu)
        left, right = self.x[:, 0].min(), self.x[:, 0].max()
        self.f = self.body_force_load([0.3, -1.0, 0.2][: self.dim])
        foot = [(i, lambda x: x[0] < left + 0.1, 0.01 * i - 0.005) for i in range(self.dim)]
        self.supports = self.make_supports(
            *foot, (self.dim - 1, lambda x: x[0] > right - 0.1, 0.02)
        )

    def solved(self, solver):
        return solve(self.K, self.f, self.supports, solver)


def difference(a, b):
    return (a - b).norm() / b.norm()


@pytest.mark.parametrize("name", BODIES)
def test_displacements_are_those_of_the_direct_solver(name):
    case = Case(name)
    before = case.K.norm()
    a = case.solved(Iterative())
    assert difference(a, case.solved(Direct())) < 1e-10
    assert case.K.norm() == before  # nothing is written into it
    report = a.getAttr("report")
    assert report.method == "GMRES with p-multigrid"
    assert report.factorisations == 0
    assert 5 < report.krylov_iterations < 80


def test_a_brief_solution_takes_one_cycle_an_iteration():
    case = Case("pw-T10")
    prepared = Iterative().prepare(case.K, supports=case.supports.supports)
    prepared.set_up()
    levels, applied = prepared.ksp.getPC(), []

    class Counted:
        def apply(self, _, x, y):
            applied.append(1)
            levels.apply(x, y)

    ksp = prepared.create_flexible_ksp(prepared.operator, Counted())
    a, every = prepared.solve(case.f), case.f.duplicate()
    ksp.solve(case.f, every)
    assert len(applied) == ksp.getIterationNumber() > 5
    assert difference(every, a) < 1e-10


@pytest.mark.parametrize("name", ["pw-T10", "pw-H27", "galerkin-H27", "pw-T6", "galerkin-Q8"])
def test_the_coarse_level_is_the_stiffness_of_linear_elements(name):
    """P^T K P against a matrix that is assembled from linear functions on both sides."""
    mesh, method, state = BODIES[name]()
    linear, spaces = fem.functionspace(mesh, ("Lagrange", 1, (mesh.geometry.dim,))), method(mesh)
    K, expected = (  # by one rule, any, but the same: cells are not parallelepipeds
        assemble_matrix(Body(of, Material(1.0, 0.3), state, quadrature_degree=8).stiffness())
        for of in (spaces, Spaces(linear, linear))
    )
    coarse = Multigrid(K, Reduction.dirichlet(spaces.trial, []).supports).coarse_matrix
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
    body = ElasticBody(box("tetrahedron"), state="solid")
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
    apart = np.zeros((3 * len(nodes), len(K)))
    apart[:, (far[:, None] * 3 + np.arange(3)).ravel()] = -1 / len(far)
    apart[:, (nodes[:, None] * 3 + np.arange(3)).ravel()] += np.eye(len(apart))
    for _ in range(3):
        normal = random.normal(size=(len(nodes), 3))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        held = np.einsum("na,nb->nab", normal, normal) * random.integers(0, 2, (len(nodes), 1, 1))
        B, springs = apart.T @ block_diag(*held) @ apart, None
        if sprung:
            springs = PETSc.Mat().createAIJ(B.shape, nnz=len(B), comm=MPI.COMM_SELF)
            springs.setValues(range(len(B)), range(len(B)), B)  # zeros have places, too
            springs.assemble()
        grid.constrain(nodes, held, np.ones(len(nodes)), springs)
        blocks = np.eye(3) * supports.free.reshape(-1, 1, 3)
        if not sprung:
            blocks[nodes] -= held
        free, coarse = (block_diag(*some) for some in (blocks, blocks[vertex]))
        moved = free @ P @ coarse
        expected = moved.T @ (K + B * sprung) @ moved
        expected += np.trace(expected) / len(expected) * (np.eye(len(expected)) - coarse)
        assert np.abs(grid.coarse_matrix[:, :] - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("rows", [12_000, 90])
def test_matrices_in_blocks(monkeypatch, rows):
    monkeypatch.setattr(matrices, "_ROWS_AT_ONCE", rows)
    case = Case("pw-T10")
    blocked = assemble_matrix(case.body.stiffness(), blocked=True)
    assert blocked.getType() == "seqbaij"
    coarse = Multigrid(case.K, case.make_supports().supports).coarse_matrix
    again = Multigrid(blocked, case.make_supports().supports).coarse_matrix
    assert (again - coarse).norm() < 1e-14 * coarse.norm()
    known, mass = case.solved(Direct()), assemble_matrix(case.body.mass(), blocked=True)
    for solver in (Direct(), Iterative()):
        assert difference(solve(blocked, case.f, case.supports, solver), known) < 1e-10
    modes = [
        vibration_modes(K, M, case.supports, 3).eigenvalues
        for K, M in ((blocked, mass), (case.K, case.M))
    ]
    assert modes[0] == pytest.approx(modes[1], rel=1e-10)


def test_a_scalar_field():
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], (4, 4, 4))
    V = fem.functionspace(mesh, ("Lagrange", 2))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(test_space(V))
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(v * ufl.dx)
    held = Reduction.dirichlet(V, [fem.dirichletbc(0.5, rim_of(V), V)])
    assert difference(solve(K, f, held, Iterative()), solve(K, f, held, Direct())) < 1e-10
    with pytest.raises(SingularSystem):
        solve(K, f, Reduction.dirichlet(V, []), Iterative())


def test_options_pass_through():
    case = Case("pw-T10")
    options = {"ksp_type": "fgmres", "mg_levels_1_ksp_max_it": 6, "-mg_coarse_pc_type": "lu"}
    plain, thorough, rough = (
        case.solved(Iterative(**given)).getAttr("report")
        for given in ({}, {"options": options}, {"tolerance": 1e-3})
    )
    assert thorough.method == "FGMRES with p-multigrid"
    assert thorough.krylov_iterations < plain.krylov_iterations
    assert rough.krylov_iterations < plain.krylov_iterations / 2


def test_what_does_not_converge_is_not_returned():
    with pytest.raises(NotConverged, match=r"after 6 iterations in all: Poisson.* use Direct\(\)"):
        Case("pw-T10").solved(Iterative(options={"ksp_max_it": 3}))  # begun twice


def test_a_body_without_supports_is_refused():
    case = Case("pw-T10")
    corner = [(i, lambda x: np.linalg.norm(x, axis=0) < 1e-9) for i in range(3)]
    for few in ([], [(0, on_plane(0, 0.0)), (1, on_plane(0, 0.0))], corner):
        with pytest.raises(SingularSystem, match="the supports leave a rigid motion free"):
            solve(case.K, case.f, case.make_supports(*few), Iterative())


def two_cubes():
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
    body = ElasticBody(two_cubes(), state="solid")
    f, left = body.body_force_load((0.0, 1.0, 1.0)), [(i, on_plane(0, 0.0)) for i in range(3)]
    with pytest.raises(SingularSystem, match="the supports leave a rigid motion free"):
        solve(body.K, f, body.make_supports(*left), Iterative())
    held = body.make_supports(*left, *((i, on_plane(0, 4.0)) for i in range(3)))
    a, known = (solve(body.K, f, held, solver) for solver in (Iterative(), Direct()))
    assert difference(a, known) < 1e-10


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
    case = Case(name)
    held = case.make_supports() if free else case.supports
    a, b = (vibration_modes(case.K, case.M, held, 8, solver=s) for s in (Iterative(), Direct()))
    assert a.n_rigid == b.n_rigid == (free and {2: 3, 3: 6}[case.dim])
    assert a.eigenvalues[a.n_rigid :] == pytest.approx(b.eigenvalues[a.n_rigid :], rel=1e-9)
    assert a.residuals.max() < 1e-9
    assert a.report.method == "GMRES with p-multigrid"
    assert a.report.krylov_iterations > 100
    assert b.report.method == ("LDL^T" if name.startswith("galerkin") else "LU") + " by mumps"


@pytest.mark.parametrize("name", ["galerkin-T10", "pw-T10", "pw-T6"])
def test_buckling_factors_are_those_of_the_direct_solver(name):
    case = Case(name)
    K_sigma = case.initial_stress_matrix(case.f, case.supports)
    a, b = (buckling(case.K, K_sigma, case.supports, 2, solver=s) for s in (Iterative(), Direct()))
    assert a.factors == pytest.approx(b.factors, rel=1e-8)
    assert b.report.method == ("LDL^T" if name.startswith("galerkin") else "LU") + " by mumps"
    with pytest.raises(SingularSystem, match="rigid motion free"):
        buckling(case.K, K_sigma, case.make_supports(), solver=Iterative())


def test_modes_that_need_factors_or_more_iterations():
    case = Case("pw-T10")
    problem = case.K, case.M, case.supports
    with pytest.raises(ValueError, match="does not count negative pivots"):
        vibration_modes(*problem, symmetrised=True, solver=Iterative())
    with pytest.raises(NotConverged, match="left a mode with the residual"):
        vibration_modes(*problem, solver=Iterative(options={"ksp_max_it": 3}))


def test_condensation_needs_factors():
    case = Case("pw-Q9")
    U = case.space
    held = [prescribe(U, i, lambda x: x[0] < 1.1) for i in (0, 1)]
    condensed = Reduction.condensation(case.K, U, centre_nodes(U), held)
    with pytest.raises(ValueError, match=r"static condensation .* need Direct\(\)"):
        solve(case.K, case.f, condensed, Iterative())
    assert solve(case.K, case.f, condensed).getAttr("report").method == "LU by mumps"


GAVE_UP = "auto: Iterative gave up, Direct goes on; factors take some"


@pytest.fixture
def small(monkeypatch):
    """Bodies of any size are large."""
    for limit in (
        "_MIN_KRYLOV_DOFS",
        "_MIN_KRYLOV_DOFS_WITHOUT_SUPPORTS",
        "_MIN_KRYLOV_DOFS_FOR_MODES",
    ):
        monkeypatch.setattr(automatic, limit, 1)
    monkeypatch.setattr(krylov, "_ENOUGH", 0)  # GMRES then fails where no node sticks


@pytest.mark.parametrize(("held", "method"), [(False, "LU by mumps"), (True, "GMRES with p-m")])
def test_what_contact_alone_holds_takes_factors_up_to_a_larger_size(monkeypatch, held, method):
    monkeypatch.setattr(automatic, "_MIN_KRYLOV_DOFS", 1)
    solid = SolidBlock(n=2)
    supports = (
        solid.make_supports(*((i, on_plane(2, 1.0)) for i in range(3)))
        if held
        else solid.no_supports
    )
    pair = ContactPair(on_plane(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
    load = solid.traction_load((0.0, 0.0, -1.0), on_plane(0, 0.0)) + solid.traction_load(
        (0.0, 0.0, -1.0), on_plane(0, 2.0)
    )
    (state,) = solve_contact(solid.K, load, supports, pair, solid.space)
    assert state.report.method.startswith(method)


@pytest.mark.usefixtures("small")
def test_contact_goes_on_with_factors(caplog):
    arguments = nearly_sliding_arguments(SolidBlock(n=2))
    known = solve_contact(*arguments, solver=Direct())
    with pytest.raises(NotConverged, match=r"use Direct\(\)") as failed:
        solve_contact(*arguments, solver=Iterative())
    assert "auto" not in str(failed.value)
    told = []
    with caplog.at_level(logging.INFO, logger="pw_elements"):
        states = solve_contact(*arguments, callback=told.append)
    methods = [state.report.method for state in states]
    assert methods == ["GMRES with p-multigrid", "LU by mumps", "LU by mumps"]
    assert [state.increment for state in states] == [1, 2, 3]
    said = [record.getMessage() for record in caplog.records if record.name == "pw_elements"]
    assert sum(words.startswith(GAVE_UP) for words in said) == 1
    assert [progress.state for progress in told if progress.state] == states
    for state, exact in zip(states, known, strict=True):
        assert difference(state.displacement, exact.displacement) < 1e-9
        assert np.array_equal(state.pairs[0].status, exact.pairs[0].status)
        assert state.pairs[0].force == pytest.approx(exact.pairs[0].force, rel=1e-9, abs=1e-9)


@pytest.mark.usefixtures("small")
def test_without_memory_for_factors_the_error_stays(monkeypatch):
    arguments = nearly_sliding_arguments(SolidBlock(n=2))
    monkeypatch.setattr(automatic, "free_memory", lambda _: 1e6)
    with pytest.raises(NotConverged, match=r"\"auto\" does not use .* 0\.001 GB left"):
        solve_contact(*arguments)


@pytest.mark.parametrize("solver", ["auto", Iterative()])
@pytest.mark.usefixtures("small")
def test_a_proof_comes_before_other_ways(solver, caplog):
    """Pushed by more than friction bears: Krylov's method fails, and no method would do."""
    K, loads, supports, pair, U = nearly_sliding_arguments(SolidBlock(n=2), push_ratio=0.8)
    with caplog.at_level(logging.INFO), pytest.raises(NoEquilibrium, match="slides along"):
        solve_contact(K, loads, supports, pair, U, solver=solver)
    assert not any(GAVE_UP in record.getMessage() for record in caplog.records)


@pytest.mark.usefixtures("small")
def test_linear_problems_go_on_with_factors(monkeypatch):
    monkeypatch.setattr(automatic, "Iterative", lambda: Iterative(options={"ksp_max_it": 3}))
    rubber = ElasticBody(box("tetrahedron"), Spaces.hybrid, "solid", 1.0, 0.5)
    f, foot = rubber.body_force_load((0.0, 0.0, -1.0)), rubber.clamp(on_plane(0, 0.0))
    a, known = (solve(rubber.K, f, foot, solver) for solver in ("auto", Direct()))
    assert a.getAttr("report").method == "LU by mumps"
    assert difference(a, known) == 0
    case = Case("pw-T10", nu=0.49)
    K_sigma = case.initial_stress_matrix(case.f, case.supports)
    for computed, matrix, name in (
        (vibration_modes, case.M, "eigenvalues"),
        (buckling, K_sigma, "factors"),
    ):
        found, known = (
            computed(case.K, matrix, case.supports, 2, solver=s) for s in (None, Direct())
        )
        assert found.report == known.report
        assert getattr(found, name) == pytest.approx(getattr(known, name), rel=1e-10)


def test_memory():
    """MUMPS took 6.2 GB for 212 355 unknowns; no more is left than the machine has."""
    assert iterative.memory_of_factors(212_355) == pytest.approx(6.2e9, rel=0.3)
    assert (
        0
        < automatic.free_memory(MPI.COMM_WORLD)
        < os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    )

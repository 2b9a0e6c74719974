"""Krylov's method for hybrid bodies gives the numbers of factors, or says why it does not."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    create_unit_cube,
    create_unit_square,
    exterior_facet_indices,
    meshtags,
)

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    Reduction,
    SingularSystem,
    Spaces,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    buckling,
    prescribe,
    solve,
    split,
    vibration_modes,
)
from pw_elements.solvers import auto_solver
from tests.contact.cases import at

CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")


def block(cell, n, comm=MPI.COMM_SELF):
    """A unit square or cube whose inner nodes are moved."""
    build = create_unit_cube if cell in CELLS[2:] else create_unit_square
    mesh = build(comm, *[n] * (3 if cell in CELLS[2:] else 2), CellType[cell])
    x = mesh.geometry.x[:, : mesh.geometry.dim]
    inner = np.all((x > 1e-9) & (x < 1 - 1e-9), axis=1)
    x[inner] += 0.2 / n * np.sin(9 * x + 5 * np.roll(x, 1, axis=1))[inner]
    return mesh


class Clamped:
    """A block that is clamped at its base, pushed aside and down."""

    def __init__(self, mesh, nu=0.5, modulus=2e11, method=Spaces.hybrid, state=None, length=1.0):
        dim = mesh.geometry.dim
        state = state or ("solid" if dim == 3 else "plane strain")
        self.body = Body(method(mesh), Material(modulus, nu), state)
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        top = boundary_measure(mesh, at(dim - 1, 1.0))
        self.f = assemble_vector(self.body.body_load([2e8, 1e8, -4e8][3 - dim :]))
        self.f.axpy(1.0, assemble_vector(self.body.surface_load([1e8, 1e8, -2e8][3 - dim :], top)))
        down = at(dim - 1, 0.0)
        self.foot = [prescribe(self.space, k, down, 0.01 * k * length) for k in range(dim)]
        self.held = Reduction.dirichlet(self.space, self.foot)

    def solved(self, solver):
        a = solve(self.K, self.f, self.held, solver)
        return [field.x.array for field in split(self.space, a)], a.getAttr("report")


def differences(case):
    """Of displacement and pressure by Krylov's method, over the largest, and its iterations."""
    (mine, report), (exact, _) = case.solved(Iterative()), case.solved(Direct())
    off = [np.abs(a - b).max() / np.abs(b).max() for a, b in zip(mine, exact, strict=True)]
    assert report.method == "GMRES with p-multigrid in a block triangle"
    return max(off), report.krylov_iterations


@pytest.mark.parametrize("nu", [0.3, 0.5])
@pytest.mark.parametrize("method", [Spaces.hybrid, Spaces.taylor_hood])
@pytest.mark.parametrize("cell", CELLS)
def test_both_fields_are_those_of_factors(cell, method, nu):
    case = Clamped(block(cell, 12 if cell in CELLS[:2] else 3), nu, method=method)
    off, iterations = differences(case)
    assert off < 1e-9
    assert iterations < 55


def test_iterations_do_not_grow_with_the_mesh():
    counts = [
        Clamped(block("tetrahedron", n)).solved(Iterative())[1].krylov_iterations for n in (2, 4, 6)
    ]
    assert max(counts) < 60
    assert counts[2] <= counts[1] + 3


def test_units_do_not_matter():
    counts = []
    for length, modulus in ((1.0, 2e11), (1e-3, 2e-6), (1e3, 2e5)):
        mesh = block("tetrahedron", 3)
        case = Clamped(mesh, modulus=modulus, length=length)
        mesh.geometry.x[:] *= length
        case.K = assemble_matrix(case.body.stiffness())
        case.f.scale(modulus / 2e11 * length**2)
        off, iterations = differences(case)
        assert off < 1e-9
        counts.append(iterations)
    assert max(counts) - min(counts) <= 2


def test_a_modulus_that_varies_by_four_powers_of_ten_is_known():
    mesh = block("tetrahedron", 4)
    E = fem.Function(fem.functionspace(mesh, ("Lagrange", 1)))
    E.interpolate(lambda x: 10.0 ** (4 * x[0]))
    off, iterations = differences(Clamped(mesh, 0.4999, E))
    assert off < 1e-7
    assert iterations < 90


def test_enclosed_bodies_need_a_pressure():
    mesh = block("tetrahedron", 3)
    case = Clamped(mesh)
    mesh.topology.create_connectivity(2, 3)
    facets = exterior_facet_indices(mesh.topology)
    nowhere = fem.Function(case.space)
    rim = fem.locate_dofs_topological(case.space.sub(0), 2, facets)
    held = [fem.dirichletbc(nowhere, rim)]
    case.held = Reduction.dirichlet(case.space, held)
    with pytest.raises(SingularSystem, match=r"^an incompressible .* prescribe it at a vertex"):
        case.solved(Iterative())
    corner = prescribe(case.space, "pressure", lambda x: np.linalg.norm(x, axis=0) < 1e-9, 3e8)
    case.held = Reduction.dirichlet(case.space, [*held, corner])
    (u, p), _ = case.solved(Iterative())
    x = case.space.sub(1).collapse()[0].tabulate_dof_coordinates()
    # it rests under its weight, as a fluid would
    assert np.abs(p - (3e8 + x @ [2e8, 1e8, -4e8])).max() < 1e-1
    assert np.abs(u).max() < 1e-12


def test_free_motions_are_refused():
    body = Clamped(block("tetrahedron", 2))
    body.held = Reduction.dirichlet(body.space, body.foot[:2])
    with pytest.raises(SingularSystem, match="leave a rigid motion free"):
        body.solved(Iterative())


@pytest.mark.parametrize(("held", "nu"), [("clamped", 0.4), ("free", 0.5)])
def test_modes_are_those_of_factors(held, nu):
    """Pressures, too; at a given shift the matrix that is inverted is another one."""
    mesh = block("tetrahedron", 3)
    case = Clamped(mesh, nu)
    mesh.geometry.x[:] *= 1.0, 0.7, 2.0  # modes of cubes are double and triple
    case.K, M = assemble_matrix(case.body.stiffness()), assemble_matrix(case.body.mass())
    rigid = 0 if held == "clamped" else 6
    supports = case.held if held == "clamped" else Reduction.dirichlet(case.space, [])
    for shift in (None, -1e10):
        mine, exact = (
            vibration_modes(case.K, M, supports, rigid + 2, shift=shift, solver=solver)
            for solver in (Iterative(), Direct())
        )
        assert mine.report.factorisations == 0
        assert mine.rigid == exact.rigid == rigid
        for k in range(rigid, rigid + 2):
            assert mine.eigenvalues[k] == pytest.approx(exact.eigenvalues[k], rel=1e-9)
            fields = (split(case.space, modes.shapes[k]) for modes in (mine, exact))
            for a, b in zip(*fields, strict=True):
                a, b = a.x.array, b.x.array
                assert min(np.abs(a - b).max(), np.abs(a + b).max()) < 1e-7 * np.abs(b).max()


def test_buckling_factors_are_those_of_factors():
    case = Clamped(block("tetrahedron", 3), modulus=2e9)
    pressed = as_function(case.space, solve(case.K, case.f, case.held))
    K_sigma = assemble_matrix(case.body.initial_stress(case.body.stress(pressed)))
    mine, exact = (
        buckling(case.K, K_sigma, case.held, solver=solver) for solver in (Iterative(), Direct())
    )
    assert mine.factors == pytest.approx(exact.factors, rel=1e-8)
    loose = Reduction.dirichlet(case.space, case.foot[:2])
    with pytest.raises(SingularSystem, match="leave a rigid motion free"):
        buckling(case.K, K_sigma, loose, solver=Iterative())


def test_a_split_pressure_needs_factors():
    mesh = block("tetrahedron", 2)
    cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    spaces = Spaces.hybrid(mesh, meshtags(mesh, 3, cells, cells % 2))
    held = Reduction.dirichlet(spaces, [prescribe(spaces.trial, 0, at(2, 0.0))])
    K = assemble_matrix(Body(spaces, Material(1.0, 0.4), "solid").stiffness())
    with pytest.raises(ValueError, match="a pressure that is split, need Direct"):
        solve(K, K.createVecLeft(), held, Iterative())


def test_radius_and_thickness_are_known():
    mesh = block("triangle", 12)
    mesh.geometry.x[:, 0] += 0.01
    assert differences(Clamped(mesh, state="axisymmetric"))[1] < 60


def test_auto_takes_it_for_large_bodies_in_space():
    spaces = Spaces.hybrid(block("hexahedron", 9))
    assert auto_solver(None, Reduction.dirichlet(spaces.trial, []).supports) == Iterative()

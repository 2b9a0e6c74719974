from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    create_box,
    create_interval,
    create_rectangle,
    create_unit_cube,
    create_unit_square,
)

import pw_elements
from pw_elements import Reduction, Spaces, assemble_matrix, assemble_vector, solve
from pw_elements.spaces import (
    PAPER_NODES,
    macro_element,
    one_cut_element,
    quadratic_element,
    serendipity_element,
)
from pw_elements.spaces.elements import CELLS
from study.paper.s3_weight_functions import SUBELEMENTS, printed_weights
from tests.library.random_meshes import points_within


def test_equals_the_printed_equations_in_all_subtriangles():
    element = macro_element("triangle")
    nodes = element._element.points[list(PAPER_NODES)]
    for number, corners in enumerate(SUBELEMENTS, start=1):
        weights = np.random.default_rng(number).dirichlet(np.ones(3), 100)
        points = weights @ nodes[np.array(corners) - 1]
        printed = printed_weights(points, np.full(100, number))
        ours = element.tabulate(0, points)[0][:, list(PAPER_NODES)]
        assert np.abs(ours - printed).max() < 1e-14


@pytest.mark.parametrize("cell", CELLS)
def test_equals_the_builtin_macro_element(cell):
    points = points_within(cell, 200, 1)
    builtin = basix.ufl.element("iso", cell, 1)
    ours = one_cut_element() if cell == "tetrahedron" else macro_element(cell)
    ours = ours.tabulate(0, points)
    assert np.abs(ours - builtin.tabulate(0, points)).max() < 1e-14


@pytest.mark.parametrize("cell", CELLS)
def test_slopes_are_those_of_the_values(cell):
    # Basix 0.9's own slopes are wrong on intervals, quadrilaterals and hexahedra
    element, step = macro_element(cell), 1e-3
    points = points_within(cell, 200, 1)
    table = element.tabulate(1, points)
    for direction, slope in enumerate(table[1:]):
        h = step * np.eye(points.shape[1])[direction]
        above, below = (element.tabulate(0, points + s * h)[0] for s in (1, -1))
        # (multi)linear pieces: differences are exact where no side of a sub-cell is straddled
        within = np.abs(above - 2 * table[0] + below).max(axis=1) < 1e-13
        assert within.mean() > 0.9
        difference = (above - below) / (2 * step)
        assert np.abs(slope - difference)[within].max() < 1e-11


def test_continuous_across_cells_in_a_form():
    # a jump over interior facets would show in the integral of its square
    for mesh, element in [
        (create_unit_square(MPI.COMM_WORLD, 3, 3), macro_element("triangle")),
        (create_unit_cube(MPI.COMM_WORLD, 2, 2, 2), macro_element("tetrahedron")),
    ]:
        W = fem.functionspace(mesh, element)
        w = fem.Function(W)
        w.x.array[:] = np.sin(np.arange(len(w.x.array), dtype=float))
        jump = fem.assemble_scalar(fem.form(ufl.jump(w) ** 2 * ufl.dS))
        size = fem.assemble_scalar(fem.form(w**2 * ufl.ds))
        assert mesh.comm.allreduce(jump) < 1e-24 * mesh.comm.allreduce(size)


def test_integrates_to_a_quarter_and_a_half_of_an_edge():
    mesh = create_unit_square(MPI.COMM_SELF, 1, 1)
    for element, vertex, middle in [
        (macro_element("triangle"), 1 / 4, 1 / 2),
        (quadratic_element("triangle"), 1 / 6, 2 / 3),
    ]:
        W = fem.functionspace(mesh, element)
        x = ufl.SpatialCoordinate(mesh)
        below = ufl.conditional(ufl.lt(x[1], 1e-9), 1.0, 0.0)
        load = fem.assemble_vector(fem.form(below * ufl.TestFunction(W) * ufl.ds)).array
        nodes = fem.locate_dofs_geometrical(W, lambda x: np.isclose(x[1], 0))
        nodes = nodes[np.argsort(W.tabulate_dof_coordinates()[nodes][:, 0])]
        assert load[nodes] == pytest.approx([vertex, middle, vertex], abs=1e-14)


def test_serendipity_is_nodal_and_holds_the_right_polynomials():
    element = serendipity_element()
    nodes = quadratic_element("quadrilateral")._element.points[:8]
    assert element.dim == 8
    assert np.abs(element.tabulate(0, nodes)[0] - np.eye(8)).max() < 1e-13
    points = points_within("quadrilateral", 200, 1)
    table = element.tabulate(0, points)[0]

    def interpolation_error(f):
        return np.abs(table @ f(*nodes.T) - f(*points.T)).max()

    assert interpolation_error(lambda x, y: x**2 * y - 3 * x * y**2 + y**2 - x * y + 2) < 1e-13
    assert interpolation_error(lambda x, y: x**2 * y**2) > 1e-2  # Q9 has it, Q8 does not


UNIT_SQUARE = [(0.0, 0.0), (1.0, 1.0)]
UNIT_CUBE = [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)]


def meshes():
    comm = MPI.COMM_WORLD
    yield create_interval(comm, 5, [0.0, 1.0])
    yield create_rectangle(comm, UNIT_SQUARE, [4, 3], CellType.triangle)
    yield create_rectangle(comm, UNIT_SQUARE, [4, 3], CellType.quadrilateral)
    yield create_box(comm, UNIT_CUBE, [2, 3, 2], CellType.tetrahedron)
    yield create_box(comm, UNIT_CUBE, [2, 3, 2], CellType.hexahedron)


@pytest.mark.parametrize("mesh", list(meshes()), ids=lambda mesh: mesh.topology.cell_name())
def test_one_numbering_and_one_place_per_node(mesh):
    for components in (0, mesh.geometry.dim):
        spaces = Spaces.petrov_galerkin(mesh, components)
        assert np.array_equal(spaces.trial.dofmap.list, spaces.test.dofmap.list)
        trial, test = (V.tabulate_dof_coordinates() for V in (spaces.trial, spaces.test))
        assert np.abs(trial - test).max() < 1e-14


@pytest.mark.parametrize("mesh", list(meshes()), ids=lambda mesh: mesh.topology.cell_name())
def test_poisson_with_the_test_space_meets_a_quadratic(mesh):
    # a quadratic solution is in the trial space, so any consistent test space must return it
    V = fem.functionspace(mesh, ("Lagrange", 2))
    d = mesh.geometry.dim
    u, v = ufl.TrialFunction(V), ufl.TestFunction(pw_elements.test_space(V))
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(-2.0 * d * v * ufl.dx)
    exact = fem.Function(V)
    exact.interpolate(lambda x: sum(x[i] ** 2 for i in range(d)) + x[0])
    rim = fem.locate_dofs_geometrical(
        V, lambda x: np.any(np.isclose(x[:d], 0) | np.isclose(x[:d], 1), axis=0)
    )
    a = solve(K, f, Reduction.dirichlet(V, [fem.dirichletbc(exact, rim)]))
    assert np.abs(a.array - exact.x.array[: a.getLocalSize()]).max() < 1e-12

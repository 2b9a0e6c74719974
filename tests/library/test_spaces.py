from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    create_box,
    create_interval,
    create_rectangle,
)

import pw_elements
from pw_elements import Reduction, Spaces, assemble_matrix, assemble_vector, solve

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

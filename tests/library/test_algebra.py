import gc

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import create_unit_square

from pw_elements import (
    Body,
    Material,
    Reduction,
    SingularSystem,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
)
from pw_elements.algebra import factorise, symmetric_part
from pw_elements.elasticity import StressState
from study.matrices import dense


def left(x):
    return np.isclose(x[0], 0.0)


def right(x):
    return np.isclose(x[0], 1.0)


@pytest.fixture(params=[Spaces.galerkin, Spaces.petrov_galerkin])
def problem(request):
    """A square pulled to the right: body, K, f."""
    spaces = request.param(create_unit_square(MPI.COMM_SELF, 3, 3))
    body = Body(spaces, Material(7.0, 0.3), StressState.PLANE_STRESS)
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.surface_load((1.0, 0.2), boundary_measure(spaces.mesh, right)))
    return body, K, f


def test_prescribed_values_against_dense_algebra(problem):
    body, K, f = problem
    U = body.spaces.trial
    conditions = [prescribe(U, 0, left), prescribe(U, 1, left), prescribe(U, 0, right, 0.03)]
    a = solve(K, f, Reduction.dirichlet(U, conditions)).array

    A, b = dense(K), f.array.copy()
    for condition in conditions:
        dofs, _ = condition.dof_indices()
        values = np.zeros(len(b))
        condition.set(values)
        A[dofs], b[dofs] = 0, values[dofs]
        A[dofs, dofs] = 1
    assert np.abs(a - np.linalg.solve(A, b)).max() < 1e-12


@pytest.mark.parametrize("components", [(), (0,), (1,)])
def test_missing_supports_end_in_an_error(problem, components):
    # one component held on one side leaves a translation (and a rotation) free
    body, K, f = problem
    U = body.spaces.trial
    supports = Reduction.dirichlet(U, [prescribe(U, i, left) for i in components])
    with pytest.raises(SingularSystem, match="rigid motion"):
        solve(K, f, supports)


def test_a_balanced_load_does_not_hide_a_missing_support():
    # the right-hand side is consistent, so the residual alone would be small
    spaces = Spaces.petrov_galerkin(create_unit_square(MPI.COMM_SELF, 4, 4))
    body = Body(spaces, Material(1.0, 0.3), StressState.PLANE_STRESS)
    K = assemble_matrix(body.stiffness())
    mesh = spaces.mesh
    f = assemble_vector(body.surface_load((1.0, 0.0), boundary_measure(mesh, right)))
    f.axpy(1.0, assemble_vector(body.surface_load((-1.0, 0.0), boundary_measure(mesh, left))))
    with pytest.raises(SingularSystem):
        solve(K, f, Reduction.dirichlet(spaces.trial, []))


def test_bad_conditioning_alone_is_no_singularity():
    # a slender cantilever, stiffness entries over 1e11 and a tip that moves 1e5 times its strain
    from dolfinx.mesh import create_rectangle

    mesh = create_rectangle(MPI.COMM_SELF, [(0, 0), (100, 1)], [200, 1])
    spaces = Spaces.petrov_galerkin(mesh)
    body = Body(spaces, Material(2e11), StressState.PLANE_STRESS)
    K = assemble_matrix(body.stiffness())
    end = boundary_measure(mesh, lambda x: np.isclose(x[0], 100))
    f = assemble_vector(body.surface_load((0.0, -1.0), end))
    U = spaces.trial
    a = solve(K, f, Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)]))
    assert a.array.min() == pytest.approx(-(100**3) / (3 * 2e11 / 12), rel=2e-3)


def test_symmetric_part_and_inertia(problem):
    body, K, _ = problem
    part = dense(symmetric_part(K))
    assert np.abs(part - part.T).max() == 0
    assert np.abs(part - (dense(K) + dense(K).T) / 2).max() < 1e-15
    U = body.spaces.trial
    held = Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)])
    reduced = symmetric_part(held.matrix(K))
    eigenvalues = np.linalg.eigvalsh(dense(reduced))
    assert factorise(reduced, symmetric=True).negative_pivots == (eigenvalues < 0).sum()


def test_matrices_and_vectors_outlive_their_mesh():
    def make():
        spaces = Spaces.petrov_galerkin(create_unit_square(MPI.COMM_SELF, 8, 8))
        body = Body(spaces, Material(1.0), StressState.PLANE_STRESS)
        U = spaces.trial
        held = Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)])
        f = assemble_vector(body.body_load((0.0, -1.0)))
        return assemble_matrix(body.stiffness()), f, held

    systems = [make() for _ in range(5)]
    gc.collect()
    solutions = [solve(*system).norm() for system in systems]
    assert solutions == pytest.approx([solutions[0]] * 5, rel=1e-12)

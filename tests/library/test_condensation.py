from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
from dolfinx.mesh import create_mesh

from pw_elements import Material, Reduction, Spaces, assemble_vector, prescribe, reactions, solve
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from study.meshes.distortion import distort_unit_domain_smoothly
from study.meshes.inner_nodes import centre_nodes, mid_diagonal_nodes
from study.model.discretisation import discretise
from study.model.matrices import to_dense_array
from tests.contact.cases import GALERKIN, Q8, ElasticBody, on_plane
from tests.library.properties import dense_solution

ELASTIC_MATERIAL = Material(7.0, 0.3)


def make_distorted_square(cell, divisions=(3, 2), diagonal_pattern="right"):
    if cell == "quadrilateral":
        return move_nodes(
            quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), divisions),
            distort_unit_domain_smoothly,
        )
    return move_nodes(
        triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), divisions, diagonal_pattern),
        distort_unit_domain_smoothly,
    )


on_left_side = on_plane(0, 0.0)


def sort_rounded_points(points):
    return sorted(map(tuple, np.round(points[:, :2], 12)))


@pytest.fixture(params=["pw-Q8", "pw-Q9"])
def square_load_and_inner_dofs(request):
    """Return the discretisation, body load and inner unknowns of a distorted square.

    The load is not zero at any of the inner unknowns.
    """
    body = discretise(
        request.param, make_distorted_square, ELASTIC_MATERIAL, StressState.PLANE_STRESS
    )
    f = assemble_vector(body.body.body_load((0.3, -1.0)))
    inner = (2 * body.inner_nodes()[:, None] + [0, 1]).ravel()
    assert np.abs(f.array[inner]).min() > 1e-3
    return body, f, inner


def test_condensation_matrices_equal_dense_algebra(square_load_and_inner_dofs):
    body, _, inner = square_load_and_inner_dofs
    reduction = body.supports([])
    K = to_dense_array(body.K)
    kept = np.setdiff1d(np.arange(len(K)), inner)
    inverse = np.linalg.inv(K[np.ix_(inner, inner)])
    left, right = np.zeros((2, len(K), len(kept)))
    left[kept] = right[kept] = np.eye(len(kept))
    left[inner] = -(K[np.ix_(kept, inner)] @ inverse).T
    right[inner] = -inverse @ K[np.ix_(inner, kept)]
    assert np.abs(to_dense_array(reduction.left) - left).max() < 1e-13
    assert np.abs(to_dense_array(reduction.right) - right).max() < 1e-13
    assert np.abs(left - right).max() > 0.01  # the matrix is unsymmetric
    assert np.abs(to_dense_array(reduction.matrix(body.K)) - left.T @ K @ right).max() < 1e-12


def test_condensation_changes_no_displacement_or_reaction(square_load_and_inner_dofs):
    body, f, inner = square_load_and_inner_dofs
    conditions = [
        prescribe(body.space, 0, on_left_side),
        prescribe(body.space, 1, on_left_side, 0.03),
    ]
    a = solve(body.K, f, body.supports(conditions))
    exact = dense_solution(body.K, f, conditions)
    assert np.abs(a.array - exact).max() < 1e-13
    assert np.abs(a.array[inner]).min() > 0
    r = reactions(body.K, a, f).array
    assert np.abs(r - (to_dense_array(body.K) @ exact - f.array)).max() < 1e-12
    assert np.abs(r[inner]).max() < 1e-13


def test_reduced_load_does_not_depend_on_the_inner_offset(square_load_and_inner_dofs):
    body, f, _ = square_load_and_inner_dofs
    reduction = body.supports([prescribe(body.space, 1, on_left_side, 0.03)])
    loaded = reduction.with_offset_for_load(body.K, f)
    assert (loaded.offset - reduction.offset).norm() > 1e-3
    difference = loaded.load(body.K, f) - reduction.load(body.K, f)
    assert difference.norm() < 1e-13


@pytest.mark.parametrize("pattern", ["right", "left", "right_left", "left_right"])
def test_inner_nodes_are_the_middles_of_the_quadrilaterals(pattern):
    # squares become slender rectangles
    def grade(x):
        return np.column_stack([x[:, 0] + 7 * x[:, 0] ** 2, x[:, 1:]])

    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 3), pattern)
    U = Spaces.petrov_galerkin(move_nodes(mesh, grade)).trial
    midpoints = U.tabulate_dof_coordinates()[mid_diagonal_nodes(U)]
    x = grade(np.pad(np.linspace(0, 1, 5)[:, None], ((0, 0), (0, 2))))[:, 0]
    middles = [(a, b) for b in (1 / 6, 3 / 6, 5 / 6) for a in (x[1:] + x[:-1]) / 2]
    assert sort_rounded_points(midpoints) == sort_rounded_points(np.array(middles))


def test_condensation_refuses_triangles_without_partner():
    crossed = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2), "crossed")
    h = np.sqrt(0.75)  # four equilateral triangles in a row, in which no side is the longest
    corners = np.array([[0, 0], [1, 0], [2, 0], [0.5, h], [1.5, h], [2.5, h]])
    strip = _triangle_mesh(corners, [[0, 1, 3], [1, 2, 4], [1, 3, 4], [2, 4, 5]])
    odd = _triangle_mesh(corners, [[0, 1, 3], [1, 3, 4], [1, 2, 4]])
    for mesh in (crossed, strip, odd):
        with pytest.raises(ValueError, match="no partner"):
            mid_diagonal_nodes(Spaces.galerkin(mesh).trial)
    quadrilateral = Spaces.galerkin(make_distorted_square("quadrilateral")).trial
    with pytest.raises(ValueError, match="6-node triangles"):
        mid_diagonal_nodes(quadrilateral)
    for spaces in (Spaces.galerkin(make_distorted_square("triangle")), Q8(quadrilateral.mesh)):
        with pytest.raises(ValueError, match="9-node quadrilaterals"):
            centre_nodes(spaces.trial)


def _triangle_mesh(corner_coordinates, cells):
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    return create_mesh(MPI.COMM_SELF, cells=np.array(cells), x=corner_coordinates, e=element)


def test_nodes_that_cannot_be_condensed_are_refused(square_load_and_inner_dofs):
    body, _, _ = square_load_and_inner_dofs
    U, inner = body.space, body.inner_nodes()
    everywhere = prescribe(U, 0, lambda x: x[0] > -9)
    with pytest.raises(ValueError, match="is to be condensed"):
        body.supports([everywhere])
    other_nodes = np.setdiff1d(np.arange(U.dofmap.index_map.size_local), inner)
    at_rest = U.tabulate_dof_coordinates()[other_nodes]
    others = [
        prescribe(U, i, lambda x: np.isclose(x.T[:, None], at_rest).all(axis=2).any(axis=1))
        for i in (0, 1)
    ]
    with pytest.raises(ValueError, match="nothing but inner and prescribed"):
        body.supports(others)


def test_two_galerkin_triangles_condense_symmetrically():
    body = ElasticBody(make_distorted_square("triangle"), GALERKIN)
    reduction = Reduction.condensation(body.K, body.space, mid_diagonal_nodes(body.space))
    assert np.abs(to_dense_array(reduction.left) - to_dense_array(reduction.right)).max() < 1e-13

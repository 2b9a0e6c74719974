"""Test stiffness and mass of one triangle in section 4, Eq. (21) to Eq. (23) and Eq. (11)."""

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
from dolfinx.mesh import create_mesh

from pw_elements import Body, Material, Spaces, assemble_matrix
from study.model.matrices import to_dense_array
from tests.oracle.assembly import LinearElasticBody as OracleBody
from tests.oracle.elements import tabulate_at_gauss_points

E, NU, RHO = 2.0, 0.3, 1.7
TRIANGLE_CORNERS = np.array([[0.1, 0.2], [1.3, -0.1], [0.4, 0.9]])
SPACES_MAKERS_BY_LINEAR_WEIGHTS = {True: Spaces.petrov_galerkin, False: Spaces.galerkin}


def make_triangle_matrices_and_oracle(linear_weights):
    """Return [K, M] of one triangle, each (12, 12), from the library, and the oracle's body."""
    geometry_element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    mesh = create_mesh(
        MPI.COMM_SELF, cells=np.array([[0, 1, 2]]), x=TRIANGLE_CORNERS, e=geometry_element
    )
    body = Body(
        SPACES_MAKERS_BY_LINEAR_WEIGHTS[linear_weights](mesh), Material(E, NU, RHO), "plane stress"
    )
    U = body.spaces.trial
    matrices = [to_dense_array(assemble_matrix(form)) for form in (body.stiffness(), body.mass())]
    nodes, cells = U.tabulate_dof_coordinates()[:, :2], U.dofmap.list
    oracle_body = OracleBody(nodes, cells, "T6", linear_weights, "plane stress", E, NU, RHO)
    return matrices, oracle_body


@pytest.mark.parametrize("linear_weights", [True, False])
def test_oracle_has_the_stiffness_and_mass_of_the_library(linear_weights):
    (K, M), oracle = make_triangle_matrices_and_oracle(linear_weights)
    np.testing.assert_allclose(oracle.stiffness().toarray(), K, atol=1e-13 * np.abs(K).max())
    np.testing.assert_allclose(oracle.mass().toarray(), M, atol=1e-13 * np.abs(M).max())
    for matrix in (K, M):
        assert np.allclose(matrix, matrix.T) is not linear_weights


def test_printed_sum_over_sub_elements_is_the_librarys_stiffness():
    """The sum of Eq. (23) over sub-elements, with D of Eq. (22), is the library's stiffness matrix.

    The gradients of the weight functions are constant in each sub-element.
    """
    (K, _), oracle = make_triangle_matrices_and_oracle(True)
    D = E / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]])
    functions, x = tabulate_at_gauss_points("T6", True, 3), oracle.nodes[oracle.cells[0]]
    K_by_hand = np.zeros((12, 12))
    for dN, dW, measure in zip(
        functions.slopes, functions.weight_slopes, functions.measure, strict=True
    ):
        J = x.T @ dN
        B, B_bar = (strain_matrix(slopes @ np.linalg.inv(J)) for slopes in (dN, dW))
        K_by_hand += B_bar.T @ D @ B * measure * np.linalg.det(J)
    dofs = (2 * oracle.cells[0][:, None] + [0, 1]).ravel()
    np.testing.assert_allclose(K_by_hand, K[np.ix_(dofs, dofs)], atol=1e-13 * np.abs(K).max())


def strain_matrix(gradients):
    """Return the matrix B (3, 12) of Eq. (6) for gradients (6, 2) of the nodal functions."""
    B = np.zeros((3, 12))
    B[0, 0::2] = B[2, 1::2] = gradients[:, 0]
    B[1, 1::2] = B[2, 0::2] = gradients[:, 1]
    return B

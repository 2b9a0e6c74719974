"""Test the initial stress matrix of section 6, Eq. (25) and Eq. (26), against the oracle's."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import Body, Material, Spaces, as_function, assemble_matrix
from pw_elements.meshes import triangles
from study.model.matrices import to_dense_array
from tests.oracle.assembly import LinearElasticBody as OracleBody


@pytest.mark.parametrize("make_spaces", [Spaces.petrov_galerkin, Spaces.galerkin])
def test_oracle_has_the_geometric_stiffness_of_the_library(make_spaces):
    """Library and oracle have the same geometric stiffness under a nonuniform stress.

    The stress follows from a random displacement.
    """
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (2, 1))
    body = Body(make_spaces(mesh), Material(2.0, 0.3), "plane stress", 0.1)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    a = K.createVecRight()
    a.array[:] = np.random.default_rng(6).uniform(-1, 1, a.getSize())
    matrix = assemble_matrix(body.geometric_stiffness(body.stress(as_function(U, a)), "G"))
    library_matrix = to_dense_array(matrix)
    nodes, cells = U.tabulate_dof_coordinates()[:, :2], U.dofmap.list
    linear_weights = make_spaces == Spaces.petrov_galerkin
    oracle = OracleBody(nodes, cells, "T6", linear_weights, "plane stress", 2.0, 0.3, thickness=0.1)
    oracle_matrix = oracle.geometric_stiffness(a.array).toarray()
    np.testing.assert_allclose(
        oracle_matrix, library_matrix, atol=1e-13 * np.abs(library_matrix).max()
    )
    assert np.allclose(library_matrix, library_matrix.T) is not linear_weights

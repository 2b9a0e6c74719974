"""Stiffness of the composite triangle.

Its other properties are tested in sections C and T of the validation study (study/benchmarks).
"""

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem

from pw_elements import Body, Material, Spaces, assemble_matrix
from pw_elements.meshes import move_nodes, triangles
from pw_elements.spaces import piecewise_linear_sub_cell_element
from study.meshes.distortion import distort_unit_domain_smoothly
from study.model.elements import composite_spaces
from study.model.matrices import to_dense_array
from tests.contact.cases import ElasticBody

E, NU = 2.0, 0.3
DISTORTED_MESH = move_nodes(
    triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 4)), distort_unit_domain_smoothly
)


@pytest.mark.parametrize(
    ("state", "reduced"), [("plane stress", NU / (1 - NU)), ("plane strain", NU / (1 - 2 * NU))]
)
def test_composite_stiffness_is_that_of_the_assumed_strain_method(state, reduced):
    """The stiffness of the composite triangle is that of an assumed-strain method.

    The reference is K = G^T M^-1 D M^-1 G. With discontinuous linear tensor functions q, the matrix
    G has the integrals of eps(u) : q, M is the mass matrix of q, and D has the integrals of
    sigma(e) : q, where sigma(e) is the stress of a strain e that is a combination of the q.
    """
    K = to_dense_array(ElasticBody(DISTORTED_MESH, composite_spaces, state, E).K)
    W = fem.functionspace(DISTORTED_MESH, piecewise_linear_sub_cell_element("triangle", (2,)))
    Q = fem.functionspace(DISTORTED_MESH, basix.ufl.element("DG", "triangle", 1, shape=(2, 2)))
    u, strain, q = ufl.TrialFunction(W), ufl.TrialFunction(Q), ufl.TestFunction(Q)
    stress = E / (1 + NU) * (strain + reduced * ufl.tr(strain) * ufl.Identity(2))
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    G, M, D = (
        to_dense_array(assemble_matrix(ufl.inner(field_of, q) * dx))
        for field_of in (ufl.sym(ufl.grad(u)), strain, stress)
    )
    assumed = np.linalg.solve(M, G)
    assert np.abs(K - assumed.T @ D @ assumed).max() < 1e-13
    linear = to_dense_array(assemble_matrix(Body(Spaces(W, W), Material(E, NU), state).stiffness()))
    assert np.abs(K - linear).max() > 0.1  # differs without the projection

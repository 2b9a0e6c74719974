"""Test the inf-sup constants of section V15 by dense algebra and its seal by library contact."""

from functools import partial

import numpy as np
import pytest
import ufl
from scipy.linalg import cholesky, solve_triangular, svdvals

from pw_elements import assemble_matrix
from pw_elements.contact import ContactPair, Motion, Plane
from pw_elements.elasticity import StressState
from study.benchmarks.v15_incompressible import contact
from study.benchmarks.v15_incompressible.fields import infsup
from study.meshes.distorted_meshes import mesh_distorted_unit_grid
from study.model.discretisation import make_element_spaces
from study.model.matrices import to_dense_array
from tests.contact.cases import ElasticBody, on_plane


@pytest.mark.parametrize("element", ["pw-hybrid-T6", "galerkin-hybrid-Q9", "pw-hybrid-T10"])
def test_inf_sup_constant_is_the_smallest_singular_value_between_norms(element):
    mesh = mesh_distorted_unit_grid(element, 2)
    dim = mesh.geometry.dim
    hybrid_spaces = make_element_spaces(element, mesh)
    state = StressState.SOLID if dim == 3 else StressState.PLANE_STRAIN
    # the shear modulus differs from the page's, because the constant does not depend on it
    body, mu = ElasticBody(mesh, lambda _: hybrid_spaces, state, 12.0, 0.5), 4.0
    supports = body.make_clamping_supports(on_plane(dim - 1, 0.0))

    def norm_factor(space):
        (u, p), (v, q) = ufl.TrialFunctions(space), ufl.TestFunctions(space)
        strains = ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v)))
        gram = supports.matrix(assemble_matrix((2 * mu * strains + p * q / (2 * mu)) * ufl.dx))
        return cholesky(to_dense_array(gram), lower=True)

    b = to_dense_array(supports.matrix(body.K))
    scaled = solve_triangular(norm_factor(hybrid_spaces.test), b, lower=True)
    scaled = solve_triangular(norm_factor(hybrid_spaces.trial), scaled.T, lower=True)
    assert infsup(element, 2).scalars["inf_sup"] == pytest.approx(svdvals(scaled)[-1], rel=1e-6)


def test_seal_at_a_small_squeeze_has_the_force_of_small_displacement_contact():
    squeeze = 0.004
    ring = contact.ORing("pw-hybrid-T6", 6)
    ring.squeeze_to_half_height(1 - squeeze)
    large_strain_force = -ring.nodal_forces()[ring.is_held_by_upper_plate, 1].sum()

    mesh = ring.space.mesh
    body = ElasticBody(mesh, partial(make_element_spaces, "pw-hybrid-T6"), "axisymmetric", 3.0, 0.5)

    def is_on_outer_side(x, side):
        return (np.hypot(x[0] - contact.RING_RADIUS, x[1]) > 1 - 1e-9) & (side * x[1] > 0.5)

    pairs = [
        ContactPair(
            lambda x, side=side: is_on_outer_side(x, side),
            Plane((0.0, side), (0.0, -side)),
            0.0,
            [Motion((0.0, -side * squeeze))],
        )
        for side in (1.0, -1.0)
    ]
    (state,) = body.solve_contact(pairs)
    small_strain_force = -state.pairs[0].force[1]
    n_closed = (state.pairs[0].status > 0).sum()
    assert n_closed == ring.is_held_by_upper_plate.sum()
    assert large_strain_force == pytest.approx(small_strain_force, rel=0.01)

"""Section V15: its inf-sup constants by dense algebra, its seal by the library's contact."""

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
from study.meshes.distorted_meshes import moved_mesh
from study.model.discretisation import spaces
from study.model.matrices import dense
from tests.contact.cases import ElasticBody, on_plane


@pytest.mark.parametrize("element", ["pw-hybrid-T6", "galerkin-hybrid-Q9", "pw-hybrid-T10"])
def test_inf_sup_constants_are_singular_values_between_the_norms(element):
    mesh = moved_mesh(element, 2)
    dim = mesh.geometry.dim
    pair = spaces(element, mesh)
    state = StressState.SOLID if dim == 3 else StressState.PLANE_STRAIN
    # another shear modulus: the norms take it out
    body, mu = ElasticBody(mesh, lambda _: pair, state, 12.0, 0.5), 4.0
    held = body.make_clamping_supports(on_plane(dim - 1, 0.0))

    def norm(space):
        (u, p), (v, q) = (ufl.split(of(space)) for of in (ufl.TrialFunction, ufl.TestFunction))
        strains = ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v)))
        gram = held.matrix(assemble_matrix((2 * mu * strains + p * q / (2 * mu)) * ufl.dx))
        return cholesky(dense(gram), lower=True)

    b = dense(held.matrix(body.K))
    scaled = solve_triangular(norm(pair.test), b, lower=True)
    scaled = solve_triangular(norm(pair.trial), scaled.T, lower=True)
    found = infsup(element, 2).scalars["inf_sup"]
    assert found == pytest.approx(svdvals(scaled)[-1], rel=1e-6)


def test_a_hardly_squeezed_seal_has_the_force_of_contact_at_small_displacements():
    squeeze = 0.004
    ring = contact.Ring("pw-hybrid-T6", 6)
    ring.press(1 - squeeze)
    large = -ring.nodal_forces()[ring.is_upper, 1].sum()

    mesh = ring.space.mesh
    body = ElasticBody(mesh, partial(spaces, "pw-hybrid-T6"), "axisymmetric", 3.0, 0.5)

    def outside(x, side):
        return (np.hypot(x[0] - contact.RING_RADIUS, x[1]) > 1 - 1e-9) & (side * x[1] > 0.5)

    pairs = [
        ContactPair(
            lambda x, side=side: outside(x, side),
            Plane((0.0, side), (0.0, -side)),
            0.0,
            [Motion((0.0, -side * squeeze))],
        )
        for side in (1.0, -1.0)
    ]
    (state,) = body.solve_contact(pairs)
    small = -state.pairs[0].force[1]
    closed = (state.pairs[0].status > 0).sum()
    assert closed == ring.is_upper.sum()
    assert large == pytest.approx(small, rel=0.01)

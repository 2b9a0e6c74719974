"""Matrices and vectors know what they were made of, and what does not go together is refused."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx.mesh import meshtags

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    nodal_flux,
    solve,
    vibration_modes,
)
from pw_elements.elasticity import Sibling
from pw_elements.meshes import triangles
from tests.contact.cases import at


def plate(method="petrov_galerkin", state="plane stress", mesh=None):
    mesh = mesh or triangles(MPI.COMM_SELF, (1.0, 0.0), (3.0, 1.0), (4, 2))
    return Body(getattr(Spaces, method)(mesh), Material(210e3, 0.3, 7.85e-9), state)


def matrices(body):
    return assemble_matrix(body.stiffness()), assemble_matrix(body.mass())


def modes(K, M, body):
    return vibration_modes(K, M, Reduction.dirichlet(body.spaces.trial, []), 4)


def siblings_stiffness_and_standard_mass():
    body = plate("galerkin")
    K, M = matrices(body)
    modes(Sibling.of(body.spaces.trial).matrix(K), M, body)


def masses_of_other_weights():
    new = plate()
    standard = plate("galerkin", mesh=new.spaces.mesh)
    modes(matrices(new)[0], matrices(standard)[1], new)


def mass_of_another_mesh():
    one, other = plate(), plate()
    modes(matrices(one)[0], matrices(other)[1], one)


def mass_of_another_state():
    one = plate()
    modes(
        matrices(one)[0],
        matrices(plate("petrov_galerkin", "axisymmetric", one.spaces.mesh))[1],
        one,
    )


def load_of_another_state():
    one = plate()
    other = plate(state="axisymmetric", mesh=one.spaces.mesh)
    top = boundary_measure(one.spaces.mesh, at(1, 1.0))
    load = assemble_vector(other.surface_load((0.0, -1.0), top))
    solve(matrices(one)[0], load, Reduction.dirichlet(one.spaces.trial, []))


def sibling_of_weights():
    Sibling.of(plate().spaces.test)


def hybrid_with_parts_of_another_mesh():
    one, other = plate().spaces.mesh, plate().spaces.mesh
    cells = np.arange(16, dtype=np.int32)
    Spaces.hybrid(one, meshtags(other, 2, cells, cells % 2))


def flux(depth):
    body = plate()
    spaces = Spaces.petrov_galerkin(body.spaces.mesh, 0)
    zero = assemble_vector(ufl.TestFunction(spaces.test) * ufl.dx)
    nodal_flux(spaces, zero, at(0, 1.0), depth=depth(ufl.SpatialCoordinate(spaces.mesh)))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (siblings_stiffness_and_standard_mass, "symmetric sibling"),
        (masses_of_other_weights, "the mass was made with other weight functions"),
        (mass_of_another_mesh, "the mass belongs to another mesh"),
        (mass_of_another_state, "the mass is one in axisymmetric, the stiffness in plane stress"),
        (load_of_another_state, "the load is one in axisymmetric, the stiffness in plane stress"),
        (sibling_of_weights, "quadratic Lagrange"),
        (hybrid_with_parts_of_another_mesh, "parts.*another mesh"),
        (partial(flux, lambda x: -x[0]), "depth.*positive"),
        (partial(flux, lambda x: ufl.max_value(x[0] - 9, 0.0)), "depth.*positive"),
    ],
)
def test_what_does_not_go_together_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        wrong()

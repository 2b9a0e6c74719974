"""Matrices and vectors know what they were made of, and what does not go together is refused."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx.mesh import meshtags

from pw_elements import Spaces, assemble_vector, nodal_flux, solve, vibration_modes
from pw_elements.elasticity import Sibling
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, PW, Elastic, at


class Plate(Elastic):
    def __init__(self, method=PW, state="plane stress", like=None):
        mesh = like.mesh if like else triangles(MPI.COMM_SELF, (1.0, 0.0), (3.0, 1.0), (4, 2))
        super().__init__(mesh, method, state, 210e3)


NEW = Plate()
STANDARD, ROUND, ELSEWHERE = Plate(GALERKIN), Plate(state="axisymmetric", like=NEW), Plate()


def modes(K, M, body=NEW):
    return vibration_modes(K, M, body.held(), 4)


def parts_of_another_mesh():
    cells = np.arange(16, dtype=np.int32)
    Spaces.hybrid(NEW.mesh, meshtags(ELSEWHERE.mesh, 2, cells, cells % 2))


def flux(depth):
    spaces = PW(NEW.mesh, 0)
    zero = assemble_vector(ufl.TestFunction(spaces.test) * ufl.dx)
    nodal_flux(spaces, zero, at(0, 1.0), depth=depth(ufl.SpatialCoordinate(NEW.mesh)))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (
            lambda: modes(Sibling.of(STANDARD.space).matrix(STANDARD.K), STANDARD.M, STANDARD),
            "symmetric sibling",
        ),
        (
            lambda: modes(NEW.K, Plate(GALERKIN, like=NEW).M),
            "the mass was made with other weight functions",
        ),
        (lambda: modes(NEW.K, ELSEWHERE.M), "the mass belongs to another mesh"),
        (
            lambda: modes(NEW.K, ROUND.M),
            "the mass is one in axisymmetric, the stiffness in plane stress",
        ),
        (
            lambda: solve(NEW.K, ROUND.load((0.0, -1.0), at(1, 1.0)), NEW.held()),
            "the load is one in axisymmetric, the stiffness in plane stress",
        ),
        (lambda: Sibling.of(NEW.body.spaces.test), "quadratic Lagrange"),
        (parts_of_another_mesh, "parts.*another mesh"),
        (lambda: flux(lambda x: -x[0]), "depth.*positive"),
        (lambda: flux(lambda x: ufl.max_value(x[0] - 9, 0.0)), "depth.*positive"),
    ],
)
def test_what_does_not_go_together_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        wrong()

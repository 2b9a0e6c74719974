"""Bodies of a plastic material at large strains, for tests of materials with memory.

The material is that of J. C. Simo (1992, doi:10.1016/0045-7825(92)90123-2) with a neo-Hookean
elastic part and linear isotropic hardening. C_p is the plastic right Cauchy-Green tensor, and its
inverse without the change of volume is the history variable, together with the equivalent plastic
strain.
"""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from pw_elements import Spaces, history_space, prescribe
from pw_elements.contact import ContactPair, ContactProblem, Motion, Sphere
from pw_elements.meshes import triangles
from tests.contact.cases import on_plane

YOUNGS_MODULUS, POISSONS_RATIO, YIELD_STRESS, HARDENING_MODULUS = 200.0, 0.3, 1.0, 10.0
SHEAR_MODULUS = YOUNGS_MODULUS / (2 * (1 + POISSONS_RATIO))
BULK_MODULUS = YOUNGS_MODULUS / (3 * (1 - 2 * POISSONS_RATIO))
# On the yield surface at the start of an increment, the tangent is the plastic one
_YIELD_TOLERANCE = 1e-8


class PlasticMaterial:
    """Stress and new history values of the plastic material in a body.

    Attributes:
        piola_stress: first Piola-Kirchhoff stress (dim, dim).
        inverse_plastic_metric: history function (3, 3), the inverse of C_p.
        plastic_strain: history function, the equivalent plastic strain.
        history: new values by history function.
        dx: measure of the material points.
    """

    def __init__(self, u, spaces, quadrature_degree=4):
        dim = spaces.mesh.geometry.dim
        tensors, self.dx = history_space(spaces, (3, 3), quadrature_degree)
        numbers, _ = history_space(spaces, (), quadrature_degree)
        self.inverse_plastic_metric = fem.Function(tensors)
        self.plastic_strain = fem.Function(numbers)
        self.inverse_plastic_metric.x.array.reshape(-1, 9)[:] = np.eye(3).ravel()
        embedding = ufl.as_tensor(np.eye(3)[:, :dim].tolist())
        identity = ufl.Identity(3)
        F = identity + embedding * ufl.grad(u) * embedding.T
        J = ufl.det(F)
        isochoric = J ** (-1 / 3) * F
        trial = isochoric * self.inverse_plastic_metric * isochoric.T
        mean = ufl.tr(trial) / 3
        trial_stress = SHEAR_MODULUS * ufl.dev(trial)
        norm = ufl.sqrt(ufl.inner(trial_stress, trial_stress) + 1e-30)
        yield_limit = YIELD_STRESS + HARDENING_MODULUS * self.plastic_strain
        excess = norm - np.sqrt(2 / 3) * yield_limit
        stiffness = 2 * SHEAR_MODULUS * mean + 2 / 3 * HARDENING_MODULUS
        flow = ufl.conditional(excess > -_YIELD_TOLERANCE * YIELD_STRESS, excess / stiffness, 0)
        stress = trial_stress * (1 - 2 * SHEAR_MODULUS * mean * flow / norm)
        kirchhoff_stress = BULK_MODULUS / 2 * (J * J - 1) * identity + stress
        self.piola_stress = embedding.T * kirchhoff_stress * ufl.inv(F).T * embedding
        inverse = ufl.inv(isochoric)
        self.history = {
            self.inverse_plastic_metric: inverse
            * (stress / SHEAR_MODULUS + mean * identity)
            * inverse.T,
            self.plastic_strain: self.plastic_strain + np.sqrt(2 / 3) * flow,
        }


class PlasticBody:
    """Plastic body in plane strain or in space.

    Attributes:
        spaces: Petrov-Galerkin spaces, or those that another function makes.
        u: displacements.
        material: stress and history.
        residual: virtual work of the stresses.
    """

    def __init__(self, mesh, make_spaces=Spaces.petrov_galerkin, quadrature_degree=4):
        self.mesh, self.spaces = mesh, make_spaces(mesh)
        self.u = fem.Function(self.spaces.trial)
        self.material = PlasticMaterial(self.u, self.spaces, quadrature_degree)
        gradient = ufl.grad(ufl.TestFunction(self.spaces.test))
        self.residual = ufl.inner(self.material.piola_stress, gradient) * self.material.dx

    def make_problem(self, conditions, pair, **options):
        options = {"history": self.material.history} | options
        return ContactProblem.of_residual(self.residual, self.u, conditions, pair, **options)


INDENTER_MOTIONS = [Motion((0.0, -0.01)), Motion((0.0, -0.02)), Motion((0.01, -0.02))]


def make_plastic_block_under_circle(comm=MPI.COMM_SELF, n=4, **options):
    """Return a 2 x 1 block on a fixed base below a rough circle of radius 0.6, and its problem."""
    body = PlasticBody(triangles(comm, (-1.0, -1.0), (1.0, 0.0), (2 * n, n)))
    base = [prescribe(body.spaces.trial, k, on_plane(1, -1.0)) for k in range(2)]
    pair = ContactPair(on_plane(1, 0.0), Sphere((0.0, 0.6), 0.6), friction=0.3)
    return body, body.make_problem(base, pair, **options)

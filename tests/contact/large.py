"""Rubber that a circle presses and slides on; prints what must not depend on processes, as JSON.

Started by test_large.py with `mpirun -n 1` and more: stores a state, or goes on from one.
"""

import json
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from pw_elements import Spaces, prescribe
from pw_elements.contact import ContactPair, ContactProblem, Motion, Sphere
from pw_elements.meshes import triangles

WAY = [(0.0, -0.15), (0.05, -0.3), (0.3, -0.3)]
STORED = 1


def neo_hookean(F):
    inverse = ufl.inv(F).T
    return F - inverse + 1.5 * ufl.ln(ufl.det(F)) * inverse


def saint_venant(F):
    E = (F.T * F - ufl.Identity(2)) / 2
    return F * (2 * E + 1.5 * ufl.tr(E) * ufl.Identity(2))


class Rubber:
    """A block 2 x 1 on a held base, and a circle of radius 0.6 that touches its upper side."""

    def __init__(self, n=4, stress=neo_hookean, friction=0.3, mesh=None, **options):
        mesh = mesh or triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (2 * n, n))
        pair = Spaces.petrov_galerkin(mesh)
        self.space, self.u = pair.trial, fem.Function(pair.trial)
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 4})
        F = ufl.Identity(2) + ufl.grad(self.u)
        self.residual = ufl.inner(stress(F), ufl.grad(ufl.TestFunction(pair.test))) * dx
        self.base = [fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)]
        self.held = [
            prescribe(self.space, k, lambda x: np.isclose(x[1], -1.0), value)
            for k, value in enumerate(self.base)
        ]
        self.pair = ContactPair(above, Sphere((0.0, 0.6), 0.6), friction=friction)
        self.problem = ContactProblem.of_residual(
            self.residual, self.u, self.held, self.pair, **options
        )

    def states(self, motions, start=None):
        """After each of the translations of the circle."""
        states = [start or self.problem.undeformed]
        for motion in motions:
            states.append(self.problem.step(states[-1], motions=Motion(motion)))
        return states[1:]


def above(x):
    return np.isclose(x[1], 0.0)


def hardened(comm=MPI.COMM_SELF):
    """The block, with a function that counts accepted increments, and is stored."""
    mesh = triangles(comm, (-1.0, -1.0), (1.0, 0.0), (8, 4))
    hardness = fem.Function(fem.functionspace(mesh, ("DG", 0)))

    def update():
        hardness.x.array[:] += 1.0

    stress = lambda F: (1 + 0.1 * hardness) * neo_hookean(F)  # noqa: E731
    return Rubber(mesh=mesh, stress=stress, history=[hardness], update=update), hardness


if __name__ == "__main__":
    path = Path(sys.argv[1]) / "state.npz"
    rubber, _ = hardened(MPI.COMM_WORLD)
    states = rubber.states(WAY)
    if not path.exists():
        rubber.problem.save(states[STORED], path)
    resumed = rubber.states(WAY[STORED + 1 :], rubber.problem.load(path))
    numbers = {}
    for start, last in (("", states[-1]), ("resumed ", resumed[-1])):
        (pair,) = last.pairs
        for name in ("force_normal", "force_tangential", "slip", "gap", "status", "displacement"):
            numbers[start + name] = getattr(pair, name).tolist()
        numbers[start + "norm"] = last.displacement.norm()
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(numbers))

"""Two neo-Hookean bodies of one mesh, pressed together and slid; in parallel, prints numbers.

Started by test_sliding.py with `mpirun -n 1` and more, as JSON.
"""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle

from pw_elements import Spaces, prescribe
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from tests.contact.large import neo_hookean
from tests.contact.two_bodies import joined


def two(lower, upper, divisions, shape, comm=MPI.COMM_SELF):
    """A mesh of two rectangles, ((x0, y0), (x1, y1)) each, with nodes moved by `shape`."""
    meshes = []
    for body, (box, n) in enumerate(zip((lower, upper), divisions, strict=True)):
        mesh = create_rectangle(MPI.COMM_SELF, box, n, CellType.triangle)
        x = mesh.geometry.x
        x[:, :2] = np.stack(shape(*x[:, :2].T, body), axis=1)
        meshes.append(mesh)
    return joined(*meshes, comm)


class Bodies:
    """A body below on a held base, and one above whose top is moved by `motion`."""

    def __init__(self, mesh, own, opposite, base, top, friction=0.3, revolved=False, **options):
        spaces = Spaces.petrov_galerkin(mesh)
        self.space, self.u = spaces.trial, fem.Function(spaces.trial)
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 4})
        F = ufl.Identity(2) + ufl.grad(self.u)
        self.residual = ufl.inner(neo_hookean(F), ufl.grad(ufl.TestFunction(spaces.test))) * dx
        self.motion = [fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)]
        self.held = [prescribe(self.space, k, base) for k in range(2)]
        self.held += [prescribe(self.space, k, top, v) for k, v in enumerate(self.motion)]
        self.pair = ContactPair(own, DeformableSurface(opposite, revolved), friction=friction)
        self.problem = ContactProblem.of_residual(
            self.residual, self.u, self.held, self.pair, **options
        )

    def states(self, motions, start=None):
        """After each of the translations of the upper body's top."""
        states = [start or self.problem.undeformed]
        for end in motions:
            before = [float(v.value) for v in self.motion]

            def load(share, before=before, end=end):
                for value, a, b in zip(self.motion, before, end, strict=True):
                    value.value = (1 - share) * a + share * b

            states.append(self.problem.step(states[-1], load))
        return states[1:]


def die(divisions=((12, 5), (8, 4)), curvature=1.2, friction=0.3, upper_is_slave=True, comm=MPI.COMM_SELF):
    """A parabolic die on a block; the die's lower side is the slave by default."""

    def shape(x, y, body):
        if body == 0:
            return x, y
        low = 0.01 + curvature * x**2 / 2
        return x, low + (y - 0.0) * (1 - low)

    mesh = two(((-1.5, -1.0), (1.5, 0.0)), ((-0.5, 0.0), (0.5, 1.0)), divisions, shape, comm)

    def under(x):
        inside = (np.abs(x[0]) < 0.5 + 1e-9) & (x[1] > 0.005)
        return inside & (np.abs(x[1] - 0.01 - curvature * x[0] ** 2 / 2) < 0.02)

    def above(x):
        return np.isclose(x[1], 0.0)

    sides = (under, above) if upper_is_slave else (above, under)
    return Bodies(
        mesh, *sides, lambda x: np.isclose(x[1], -1), lambda x: np.isclose(x[1], 1), friction
    )

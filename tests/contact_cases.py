"""Contact problems that several tests solve."""

from mpi4py import MPI

import numpy as np

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    State,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
)
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.meshes import triangles


def at(axis, value):
    return lambda x: np.isclose(x[axis], value)


class Block:
    """Block 4 x 2 on a rough plane, pressed by 200 and then pulled at its right side."""

    def __init__(self, n, method=Spaces.petrov_galerkin, comm=MPI.COMM_SELF):
        mesh = triangles(comm, (0.0, 0.0), (4.0, 2.0), (n, n // 2))
        self.body = Body(method(mesh), Material(1000.0, 0.3), State.PLANE_STRESS)
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        self.free = Reduction.dirichlet(self.space, [])
        self.pressure = self.load((0.0, -200.0), at(1, 2.0))

    def load(self, traction, where):
        surface = boundary_measure(self.body.spaces.mesh, where)
        return assemble_vector(self.body.surface_load(traction, surface))

    def pulled(self, traction, increments=10):
        """Load vectors: pressure, then traction in steps."""
        loads = [self.pressure]
        pull = self.load((traction, 0.0), at(0, 4.0))
        for k in range(1, increments + 1):
            f = self.pressure.copy()
            f.axpy(k / increments, pull)
            loads.append(f)
        return loads

    def pair(self, mu, smooth=0.2, shared_is_rough=True):
        edge = smooth - 1e-9 if shared_is_rough else smooth + 1e-9
        return ContactPair(
            at(1, 0.0),
            Plane((0, 0), (0, 1)),
            lambda x: np.where((x[0] > edge) & (x[0] < 4 - edge), mu, 0.0),
        )

    def solve(self, mu, traction, increments=10, start=(), **pair):
        loads = self.pulled(traction, increments)
        return solve_contact(self.K, loads, self.free, [self.pair(mu, **pair)], self.space, start)

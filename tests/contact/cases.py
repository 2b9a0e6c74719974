"""Contact problems that several tests solve."""

from mpi4py import MPI

import numpy as np

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements.contact import ContactPair, Parabola, Plane, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import mapped, triangles


def at(axis, value):
    return lambda x: np.isclose(x[axis], value)


class Block:
    """Block 4 x 2 on a rough plane, pressed by 200 and then pulled at its right side."""

    def __init__(self, n, method=Spaces.petrov_galerkin, comm=MPI.COMM_SELF):
        mesh = triangles(comm, (0.0, 0.0), (4.0, 2.0), (n, n // 2))
        self.body = Body(method(mesh), Material(1000.0, 0.3), StressState.PLANE_STRESS)
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        self.free = Reduction.dirichlet(self.space, [])
        self.pressure = self.load((0.0, -200.0), at(1, 2.0))

    def owned(self):
        """Positions of this process' nodes."""
        count = self.space.dofmap.index_map.size_local
        return self.space.tabulate_dof_coordinates()[:count]

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


class Punch:
    """Parabolic punch of radius 8 on a block 8 x 4 with a fixed base, section 7.3."""

    def __init__(
        self,
        divisions=(19, 4),
        method=Spaces.petrov_galerkin,
        build=triangles,
        grade=1.5,
        comm=MPI.COMM_SELF,
    ):
        def graded(x):
            s = x[:, 0]
            return np.column_stack([4 * (s + (grade - 1) * s**3) / grade, 4 * x[:, 1], x[:, 2]])

        mesh = mapped(build(comm, (-1.0, 0.0), (1.0, 1.0), divisions), graded)
        body = Body(method(mesh), Material(1000.0, 0.25), StressState.PLANE_STRESS)
        self.space = body.spaces.trial
        self.K = assemble_matrix(body.stiffness())
        foot = [prescribe(self.space, i, at(1, 0.0)) for i in range(2)]
        self.foot = Reduction.dirichlet(self.space, foot)

    def solve(self, mu, motions, start=()):
        pair = ContactPair(at(1, 4.0), Parabola((0, 4), 8.0), mu, motions)
        loads = [self.K.createVecLeft()] * len(motions)
        return solve_contact(self.K, loads, self.foot, [pair], self.space, start)


class Greco:
    """GRECO/Raous plate (code_aster SSNV128): friction 1, zones that are open, slip and stick."""

    def __init__(self, n, method=Spaces.petrov_galerkin):
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (0.04, 0.04), (n, n))
        body = Body(method(mesh), Material(1.3e11, 0.2), StressState.PLANE_STRAIN)
        self.space = body.spaces.trial
        self.K = assemble_matrix(body.stiffness())
        top, left = (boundary_measure(mesh, where) for where in (at(1, 0.04), at(0, 0.0)))
        self.load = assemble_vector(body.surface_load((0.0, -5e7), top))
        self.load.axpy(1.0, assemble_vector(body.surface_load((15e7, 0.0), left)))
        self.symmetry = Reduction.dirichlet(self.space, [prescribe(self.space, 0, at(0, 0.04))])

    def solve(self, mu, **options):
        pair = ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)), mu)
        (state,) = solve_contact(self.K, self.load, self.symmetry, [pair], self.space, **options)
        return state

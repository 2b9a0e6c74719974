"""Bodies and contact problems that several tests solve."""

from functools import cached_property

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
)
from pw_elements.contact import ContactPair, ContactProblem, Parabola, Plane, solve_contact
from pw_elements.meshes import move_nodes, triangles
from pw_elements.spaces import SubSpace
from study.elements import serendipity

PW, GALERKIN, Q8 = Spaces.petrov_galerkin, Spaces.galerkin, serendipity


def at(axis, value):
    return lambda x: np.isclose(x[axis], value)


def neo_hookean(F, shear=1.0, lame=1.5):
    """First Piola stress."""
    inverse = ufl.inv(F).T
    return shear * (F - inverse) + lame * ufl.ln(ufl.det(F)) * inverse


def at_large_strains(spaces, stress=neo_hookean, degree=4, give=0.0):
    """Unknowns, and the residual of a body without loads; how much a hybrid one's volume gives."""
    w, weights, hybrid = fem.Function(spaces.trial), ufl.TestFunction(spaces.test), spaces.is_hybrid
    (u, p), (v, q) = (ufl.split(f) if hybrid else (f, 0.0) for f in (w, weights))
    F = ufl.Identity(len(u)) + ufl.grad(u)
    J, inverse = ufl.det(F), ufl.inv(F).T
    density = ufl.inner(F - (1 + p * J) * inverse if hybrid else stress(F), ufl.grad(v))
    density -= q * (J - 1 + give * p) if hybrid else 0
    return w, density * ufl.dx(metadata={"quadrature_degree": degree})


class Elastic:
    def __init__(
        self, mesh, method=PW, state="plane strain", E=1000.0, nu=0.3, thickness=1.0, material=None
    ):
        self.mesh, self.dim = mesh, mesh.geometry.dim
        self.body = Body(method(mesh), material or Material(E, nu), state, thickness)
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())

    @cached_property
    def displacements(self):
        return SubSpace.displacements(self.space).space

    @cached_property
    def x(self):
        """Positions (n, dim) of nodes, ghosts' too."""
        return self.displacements.tabulate_dof_coordinates()[:, : self.dim]

    @cached_property
    def M(self):
        return assemble_matrix(self.body.mass())

    @property
    def nothing(self):
        return self.K.createVecLeft()

    def weight(self, force):
        return assemble_vector(self.body.body_load(force))

    def prestress(self, load, supports, form="G"):
        """Initial stress matrix of the stress under a load."""
        moved = as_function(self.space, solve(self.K, load, supports))
        return assemble_matrix(self.body.initial_stress(self.body.stress(moved), form))

    def load(self, traction, where):
        surface = boundary_measure(self.mesh, where)
        return assemble_vector(self.body.surface_load(np.asarray(traction), surface))

    def held(self, *conditions):
        """Supports: component, marker and, where it is not zero, value of each."""
        return Reduction.dirichlet(self.space, [prescribe(self.space, *c) for c in conditions])

    def clamped(self, where, value=0.0):
        return self.held(*((i, where, value) for i in range(self.dim)))

    def contact(self, pairs, supports=None, loads=None, **options):
        """States; without loads one for each motion of the (first) pair."""
        supports = self.held() if supports is None else supports
        if loads is None:
            motions = (pairs if isinstance(pairs, ContactPair) else pairs[0]).motions
            loads = [self.nothing] * max(1, len(motions))
        return solve_contact(self.K, loads, supports, pairs, self.space, **options)

    def problem(self, pairs, supports=None, **options):
        supports = self.held() if supports is None else supports
        return ContactProblem(self.K, supports, pairs, self.space, **options)


class Block(Elastic):
    """Block 4 x 2 on a rough plane, pressed by 200 and then pulled at its right side."""

    def __init__(self, n, method=PW, comm=MPI.COMM_SELF):
        mesh = triangles(comm, (0.0, 0.0), (4.0, 2.0), (n, n // 2))
        super().__init__(mesh, method, "plane stress")
        self.free = self.held()
        self.pressure = self.load((0.0, -200.0), at(1, 2.0))

    def pulled(self, traction, increments=10):
        """Load vectors: pressure, then traction in steps."""
        pull = self.load((traction, 0.0), at(0, 4.0))
        shares = [k / increments for k in range(1, increments + 1)]
        return [self.pressure, *(self.pressure + share * pull for share in shares)]

    def pair(self, mu, smooth=0.2):
        edge = smooth - 1e-9
        return ContactPair(
            at(1, 0.0),
            Plane((0, 0), (0, 1)),
            lambda x: np.where((x[0] > edge) & (x[0] < 4 - edge), mu, 0.0),
        )

    def solve(self, mu, traction, increments=10, **pair):
        loads = self.pulled(traction, increments)
        return self.contact(self.pair(mu, **pair), self.free, loads)


class Punch(Elastic):
    """Parabolic punch of radius 8 on a block 8 x 4 with a fixed base, section 7.3."""

    def __init__(
        self, divisions=(19, 4), method=PW, build=triangles, grade=1.5, comm=MPI.COMM_SELF
    ):
        def graded(x):
            s = x[:, 0]
            return np.column_stack([4 * (s + (grade - 1) * s**3) / grade, 4 * x[:, 1], x[:, 2]])

        mesh = move_nodes(build(comm, (-1.0, 0.0), (1.0, 1.0), divisions), graded)
        super().__init__(mesh, method, "plane stress", nu=0.25)
        self.foot = self.clamped(at(1, 0.0))

    def pair(self, mu, motions=()):
        return ContactPair(at(1, 4.0), Parabola((0, 4), 8.0), mu, motions)

    def solve(self, mu, motions):
        return self.contact(self.pair(mu, motions), self.foot)


class Greco(Elastic):
    """GRECO/Raous plate (code_aster SSNV128): friction 1, zones that are open, slip and stick."""

    def __init__(self, n, method=PW):
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (0.04, 0.04), (n, n))
        super().__init__(mesh, method, E=1.3e11, nu=0.2)
        self.push = self.load((0.0, -5e7), at(1, 0.04)) + self.load((15e7, 0.0), at(0, 0.0))
        self.symmetry = self.held((0, at(0, 0.04)))

    def pair(self, mu):
        return ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)), mu)

    def solve(self, mu, **options):
        (state,) = self.contact(self.pair(mu), self.symmetry, self.push, **options)
        return state

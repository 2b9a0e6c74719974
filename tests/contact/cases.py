"""Elastic bodies and contact problems that are shared by several tests."""

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
from study.model.elements import serendipity_spaces

PETROV_GALERKIN, GALERKIN, Q8 = Spaces.petrov_galerkin, Spaces.galerkin, serendipity_spaces


def on_plane(axis, coordinate):
    """Return a function that marks those points x (dim, n) at which x[axis] is `coordinate`."""
    return lambda x: np.isclose(x[axis], coordinate)


def make_x_spacing_unequal(points, amplitude=0.1):
    """Return a copy of points (n, 3), shifted along x so that their spacing becomes unequal."""
    return np.column_stack([points[:, 0] + amplitude * np.sin(3 * points[:, 0]), points[:, 1:]])


def rotation_matrix(radians):
    c, s = np.cos(radians), np.sin(radians)
    return np.array([[c, -s], [s, c]])


def list_states_and_substates(states):
    """Return all states, each preceded by the states at the substeps of its increment."""
    return [
        accepted
        for state in states
        for accepted in (*(substate for _, substate in state.substates), state)
    ]


def neo_hookean_piola_stress(F, shear_modulus=1.0, lame_lambda=1.5):
    """Return the first Piola stress of a compressible neo-Hookean material.

    F is the deformation gradient, `shear_modulus` the shear modulus, and `lame_lambda` Lame's
    constant lambda.
    """
    inverse_transpose = ufl.inv(F).T
    return (
        shear_modulus * (F - inverse_transpose)
        + lame_lambda * ufl.ln(ufl.det(F)) * inverse_transpose
    )


def make_finite_strain_unknown_and_residual(
    spaces, piola_stress=neo_hookean_piola_stress, quadrature_degree=4, compressibility=0.0
):
    """Return the unknown function and the residual form of a finite-strain body without loads.

    The unknowns of a hybrid space are the displacement u and the pressure p. The second equation is
    J - 1 + `compressibility` p = 0, where J is the determinant of the deformation gradient.
    """
    w, weights, hybrid = fem.Function(spaces.trial), ufl.TestFunction(spaces.test), spaces.is_hybrid
    (u, p), (v, q) = (ufl.split(f) if hybrid else (f, 0.0) for f in (w, weights))
    F = ufl.Identity(len(u)) + ufl.grad(u)
    J, inverse_transpose = ufl.det(F), ufl.inv(F).T
    density = ufl.inner(
        F - (1 + p * J) * inverse_transpose if hybrid else piola_stress(F), ufl.grad(v)
    )
    density -= q * (J - 1 + compressibility * p) if hybrid else 0
    return w, density * ufl.dx(metadata={"quadrature_degree": quadrature_degree})


class ElasticBody:
    """A linear elastic body on a mesh, with its stiffness, loads, supports and contact problems."""

    def __init__(
        self,
        mesh,
        method=PETROV_GALERKIN,
        state="plane strain",
        E=1000.0,
        nu=0.3,
        thickness=1.0,
        material=None,
    ):
        self.mesh, self.dim = mesh, mesh.geometry.dim
        self.body = Body(method(mesh), material or Material(E, nu), state, thickness)
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())

    @cached_property
    def displacement_space(self):
        return SubSpace.displacements(self.space).space

    @cached_property
    def x(self):
        """Return the positions (n, dim) of the nodes, including those of ghosts."""
        return self.displacement_space.tabulate_dof_coordinates()[:, : self.dim]

    @cached_property
    def M(self):
        return assemble_matrix(self.body.mass())

    @property
    def zero_load(self):
        return self.K.createVecLeft()

    def body_force_load(self, force_per_volume):
        return assemble_vector(self.body.body_load(force_per_volume))

    def initial_stress_matrix(self, load, supports, form="G"):
        """Assemble the initial stress matrix of the stresses that a load causes."""
        displacement = as_function(self.space, solve(self.K, load, supports))
        return assemble_matrix(self.body.geometric_stiffness(self.body.stress(displacement), form))

    def traction_load(self, traction, where):
        surface = boundary_measure(self.mesh, where)
        return assemble_vector(self.body.surface_load(np.asarray(traction), surface))

    def make_supports(self, *conditions):
        """Return the supports given by conditions (component, marker[, value])."""
        return Reduction.dirichlet(self.space, [prescribe(self.space, *c) for c in conditions])

    def make_clamping_supports(self, where, displacement=0.0):
        """Return supports that prescribe all displacement components at the marked nodes."""
        return self.make_supports(*((i, where, displacement) for i in range(self.dim)))

    def solve_contact(self, pairs, supports=None, loads=None, **options):
        """Return the states at the ends of all increments.

        If `loads` is None, there are no loads, and one increment for each motion of the first pair.
        """
        supports = self.make_supports() if supports is None else supports
        if loads is None:
            motions = (pairs if isinstance(pairs, ContactPair) else pairs[0]).motions
            loads = [self.zero_load] * max(1, len(motions))
        return solve_contact(self.K, loads, supports, pairs, self.space, **options)

    def contact_problem(self, pairs, supports=None, **options):
        supports = self.make_supports() if supports is None else supports
        return ContactProblem(self.K, supports, pairs, self.space, **options)


class BlockOnFloor(ElasticBody):
    """A 4 x 2 block on a plane with friction.

    A traction of 200 presses the top of the block; then its right side is pulled.
    """

    def __init__(self, n, method=PETROV_GALERKIN, comm=MPI.COMM_SELF):
        mesh = triangles(comm, (0.0, 0.0), (4.0, 2.0), (n, n // 2))
        super().__init__(mesh, method, "plane stress")
        self.no_supports = self.make_supports()
        self.pressure_load = self.traction_load((0.0, -200.0), on_plane(1, 2.0))

    def press_then_pull_loads(self, pull_traction, n_pull_increments=10):
        """Return load vectors: the pressure alone, then with a pull that grows in equal steps."""
        pull = self.traction_load((pull_traction, 0.0), on_plane(0, 4.0))
        load_factors = [k / n_pull_increments for k in range(1, n_pull_increments + 1)]
        return [
            self.pressure_load,
            *(self.pressure_load + load_factor * pull for load_factor in load_factors),
        ]

    def floor_pair(self, mu, frictionless_end_length=0.2):
        """Return the contact pair of the base and the plane, without friction near both ends."""
        end = frictionless_end_length - 1e-9
        return ContactPair(
            on_plane(1, 0.0),
            Plane((0, 0), (0, 1)),
            lambda x: np.where((x[0] > end) & (x[0] < 4 - end), mu, 0.0),
        )

    def solve(self, mu, pull_traction, n_pull_increments=10, **pair_options):
        loads = self.press_then_pull_loads(pull_traction, n_pull_increments)
        return self.solve_contact(self.floor_pair(mu, **pair_options), self.no_supports, loads)


class PunchedBlock(ElasticBody):
    """An 8 x 4 block with a fixed base under a parabolic punch of radius 8.

    This is the problem in section 7.3 of the paper.
    """

    def __init__(
        self,
        divisions=(19, 4),
        method=PETROV_GALERKIN,
        build=triangles,
        grade=1.5,
        comm=MPI.COMM_SELF,
    ):
        def scale_and_grade(x):
            s = x[:, 0]
            return np.column_stack([4 * (s + (grade - 1) * s**3) / grade, 4 * x[:, 1], x[:, 2]])

        mesh = move_nodes(build(comm, (-1.0, 0.0), (1.0, 1.0), divisions), scale_and_grade)
        super().__init__(mesh, method, "plane stress", nu=0.25)
        self.base_supports = self.make_clamping_supports(on_plane(1, 0.0))

    def punch_pair(self, mu, motions=()):
        return ContactPair(on_plane(1, 4.0), Parabola((0, 4), 8.0), mu, motions)

    def solve(self, mu, motions):
        return self.solve_contact(self.punch_pair(mu, motions), self.base_supports)


class GrecoFrictionBenchmark(ElasticBody):
    """Plate of the GRECO benchmark by Raous (code_aster SSNV128).

    With the benchmark's friction coefficient of 1, some contact nodes are open, some stick and some
    slip.
    """

    def __init__(self, n, method=PETROV_GALERKIN):
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (0.04, 0.04), (n, n))
        super().__init__(mesh, method, E=1.3e11, nu=0.2)
        self.edge_load = self.traction_load((0.0, -5e7), on_plane(1, 0.04)) + self.traction_load(
            (15e7, 0.0), on_plane(0, 0.0)
        )
        self.symmetry_supports = self.make_supports((0, on_plane(0, 0.04)))

    def floor_pair(self, mu):
        return ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), mu)

    def solve(self, mu, **options):
        (state,) = self.solve_contact(
            self.floor_pair(mu), self.symmetry_supports, self.edge_load, **options
        )
        return state

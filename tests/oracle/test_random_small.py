"""Random small contact problems, for which library and oracle give equal results.

Forces and displacements are compared. A block with a distorted mesh is clamped at one side, or it
is supported only by a rigid floor with friction. It is loaded back and forth in increments, by a
moved or pushed rigid surface or by tractions.
"""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import mesh as meshes
from scipy.spatial import cKDTree

from pw_elements import assemble_matrix
from pw_elements.contact import ContactPair, Motion, Parabola, Plane, Sphere
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, Q8, ElasticBody, on_plane
from tests.oracle import assembly
from tests.oracle.contact import NodesAndSurface, relative_law_violation, solve_increments

STRESS_STATES = ("plane stress", "plane strain", "axisymmetric", "solid")
RELATIVE_DIFFERENCE_TOLERANCE = 1e-8


def pytest_generate_tests(metafunc):
    if "seed" in metafunc.fixturenames:
        count = 400 if metafunc.config.getoption("--nightly") else 24
        metafunc.parametrize("seed", range(count))


class RandomSmallProblem:
    """A random small problem; lengths and Young's modulus are of order 1."""

    load_path = (0.0, 0.5, 1.0, 0.2, -0.8, 0.1)  # factors of the sideways loads or motions

    def __init__(self, seed):
        rng = self.rng = np.random.default_rng(seed)
        self.state = STRESS_STATES[seed % 4]
        self.is_solid = self.state == "solid"
        self.dim = 3 if self.is_solid else 2
        self.element = rng.choice(["T10"] if self.is_solid else ["T6", "T6", "Q8", "Q9"])
        self.linear_weights = self.element != "Q8" and bool(
            rng.random() < 0.6 or self.element == "Q9"
        )
        self.nu, self.mu = rng.uniform(0.0, 0.4), rng.uniform(0.0, 1.0)
        self.rests_on_floor = seed // 4 % 3 == 2
        self.surface = (
            "plane" if self.rests_on_floor else rng.choice(["plane", "plane", "round", "ball"])
        )
        if not self.rests_on_floor and rng.random() < 0.1:
            self.mu = 0.0
        self.is_pushed = (
            not self.rests_on_floor and self.surface != "ball" and bool(rng.random() < 0.5)
        )
        self.friction_share = rng.uniform(0.1, 0.8)  # sideways force divided by the friction limit
        self.mesh = self._make_mesh()

    def _make_mesh(self):
        """Return the mesh of a block [1, 2] x ... x [0, 1] with randomly displaced nodes.

        Nodes on a side are displaced within this side.
        """
        corners = [(1.0,) + (0.0,) * (self.dim - 1), (2.0,) + (1.0,) * (self.dim - 1)]
        if self.is_solid:
            n, cell = (2, 2, 1), meshes.CellType.tetrahedron
            mesh = meshes.create_box(MPI.COMM_SELF, corners, n, cell)
        else:
            n = tuple(self.rng.integers(2, 5, 2))
            cell = meshes.CellType.triangle if self.element == "T6" else None
            cell = cell or meshes.CellType.quadrilateral
            mesh = meshes.create_rectangle(MPI.COMM_SELF, corners, n, cell)
        x = mesh.geometry.x
        for axis in range(self.dim):
            is_inner = ~np.isclose(x[:, axis] % 1.0, 0.0)
            step = 0.2 / n[axis] * self.rng.uniform(-1, 1, len(x))
            x[:, axis] += np.where(is_inner, step, 0.0)
        return mesh

    def loads(self, assemble_traction):
        """Return the load vectors of all increments, from tractions on the top and right sides.

        They are zero unless the block rests on the floor. The arguments of `assemble_traction` are
        the axis and the coordinate of a side, and the traction (dim,).
        """
        down, sideways = -np.eye(self.dim)[-1], np.eye(self.dim)[0]
        top_load = assemble_traction(self.dim - 1, 1.0, 0.05 * down) * float(self.rests_on_floor)
        side_load = assemble_traction(0, 2.0, 0.05 * sideways) * float(self.rests_on_floor)
        return [top_load + side_load * (self.mu * self.friction_share * t) for t in self.load_path]

    @property
    def motions(self):
        """Return the translation (None for free components) and the force of each increment."""
        zero, motions = np.zeros(self.dim), []
        if self.rests_on_floor:
            return []
        depth, force = 0.02, 0.02 * (2 * np.pi if self.state == "axisymmetric" else 1.0)
        for k, t in enumerate(self.load_path):
            sideways_factor = t * self.mu * self.friction_share
            translation, force_vector = zero.copy(), zero.copy()
            if self.is_pushed:
                translation, force_vector[-1] = [0.0] * self.dim, -force * (1 + k / 10)
                translation[-1] = None
                if self.state == "axisymmetric" or self.mu == 0:  # not free sideways
                    translation[0] = 0.02 * sideways_factor
                else:
                    translation[0], force_vector[0] = None, force * sideways_factor
            else:
                translation[-1], translation[0] = -depth * (1 + k / 10), 0.03 * sideways_factor
            motions.append((list(translation), force_vector))
        return motions

    @property
    def contact_height(self):
        return 0.0 if self.rests_on_floor else 1.0

    def surface_with_gap_and_normal(self):
        """Return the library's surface, and its gap and normal functions for the oracle."""
        up, apex = np.eye(self.dim)[-1], np.full(self.dim, 0.5)
        apex[0], apex[-1] = 1.5, self.contact_height
        centre, sign = apex + 3.0 * up, 1.0 if self.rests_on_floor else -1.0
        if self.surface == "ball":
            distance = lambda x: np.linalg.norm(x - centre, axis=1)  # noqa: E731
            return (
                Sphere(centre, 3.0),
                lambda x: distance(x) - 3.0,
                lambda x: (x - centre) / distance(x)[:, None],
            )
        is_flat = self.surface == "plane"
        return (
            Plane(apex, sign * up) if is_flat else Parabola(apex, 2.0),
            lambda x: (
                sign * (x[:, -1] - self.contact_height)
                + (not is_flat) * np.sum((x - apex)[:, :-1] ** 2, axis=1) / 4
            ),
            lambda x: np.tile(sign * up, (len(x), 1)),
        )


class SmallLibraryProblem(ElasticBody):
    """A random small problem in the library's formulation."""

    def __init__(self, problem):
        self.problem = problem
        method = (
            PETROV_GALERKIN
            if problem.linear_weights
            else Q8
            if problem.element == "Q8"
            else GALERKIN
        )
        super().__init__(problem.mesh, method, problem.state, 1.0, problem.nu)
        if problem.state == "axisymmetric":
            self.body = replace(self.body, quadrature_degree=20)
            self.K = assemble_matrix(self.body.stiffness())
        self.nodes, self.cells = self.x, self.space.dofmap.list

    def yield_displacements_positions_and_forces(self):
        """Yield displacements, positions of contact nodes and contact forces for each increment.

        Displacements (n, dim) are those of all nodes, positions and forces (m, dim) those of the m
        contact nodes.
        """
        problem, up_axis = self.problem, self.dim - 1
        supports = (
            self.make_supports()
            if problem.rests_on_floor
            else self.make_clamping_supports(on_plane(up_axis, 0.0))
        )
        motions = [Motion(translation, force) for translation, force in problem.motions]
        surface, *_ = problem.surface_with_gap_and_normal()
        pair = ContactPair(on_plane(up_axis, problem.contact_height), surface, problem.mu, motions)
        loads = problem.loads(
            lambda axis, value, traction: self.traction_load(traction, on_plane(axis, value))
        )
        for state in self.solve_contact(pair, supports, loads):
            (contact,) = state.pairs
            displacement = state.displacement.array_r.reshape(-1, self.dim)
            yield displacement, contact.position, contact.force_vector


def solve_by_oracle(problem, nodes, cells, linear_weights):
    """Return the numbers of the contact nodes, and the oracle's states at all increment ends."""
    element, count = str(problem.element), 11 if problem.state == "axisymmetric" else 3
    body = assembly.LinearElasticBody(
        nodes, cells, element, linear_weights, problem.state, 1.0, problem.nu, n_gauss=count
    )

    def assemble_traction_load(axis, coordinate, vector):
        return body.traction_load(lambda x: np.isclose(x[:, axis], coordinate), vector)

    prescribed_mask = body.component_mask(
        lambda x: np.isclose(x[:, -1], 0.0), tuple(range(problem.dim))
    )
    contact_nodes = np.flatnonzero(np.isclose(nodes[:, -1], problem.contact_height))
    _, gap, normal = problem.surface_with_gap_and_normal()
    pair = NodesAndSurface(contact_nodes, gap, normal, problem.mu, problem.motions)
    loads = problem.loads(assemble_traction_load)
    return contact_nodes, solve_increments(
        body.stiffness(), loads, prescribed_mask & (not problem.rests_on_floor), [pair], nodes
    )


def largest_relative_difference(problem, linear_weights):
    """Return the largest relative difference of forces and displacements of library and oracle.

    Forces and displacements are divided by their largest values in each state. `linear_weights` are
    the oracle's weights.
    """
    library = SmallLibraryProblem(problem)
    library_states = list(library.yield_displacements_positions_and_forces())
    contact_nodes, oracle_states = solve_by_oracle(
        problem, library.nodes, library.cells, linear_weights
    )
    largest = 0.0
    for (u, position, force), state in zip(library_states, oracle_states, strict=True):
        order = cKDTree(library.nodes[contact_nodes]).query(position)[1]
        largest = max(largest, np.abs(force - state.forces[0][order]).max() / np.abs(force).max())
        largest = max(largest, np.abs(u - state.displacement).max() / np.abs(u).max())
    return largest


@pytest.mark.random
def test_library_and_oracle_find_the_same_forces_and_displacements(seed):
    problem = RandomSmallProblem(seed)
    assert (
        largest_relative_difference(problem, problem.linear_weights) < RELATIVE_DIFFERENCE_TOLERANCE
    )


def test_a_block_on_a_nearly_frictionless_floor_is_solved():
    """Library and oracle agree on a block that only very small friction holds sideways.

    In the end, one node sticks and all others slip.
    """
    problem = RandomSmallProblem(12)
    problem.rests_on_floor, problem.surface, problem.is_pushed, problem.mu = (
        True,
        "plane",
        False,
        0.005,
    )
    problem.load_path = (0.0,)
    library = SmallLibraryProblem(problem)
    _, (state,) = solve_by_oracle(problem, library.nodes, library.cells, problem.linear_weights)
    assert state.law_error <= 1
    assert (
        largest_relative_difference(problem, problem.linear_weights) < RELATIVE_DIFFERENCE_TOLERANCE
    )


@pytest.mark.parametrize("number", [1, 3, 6, 9, 15])  # seeds with triangles and tetrahedra
def test_library_and_oracle_differ_with_other_weights(number):
    problem = RandomSmallProblem(number)
    assert (
        largest_relative_difference(problem, not problem.linear_weights)
        > 1e5 * RELATIVE_DIFFERENCE_TOLERANCE
    )


def test_problems_are_of_all_kinds():
    problems = [RandomSmallProblem(seed) for seed in range(24)]
    for kind, count in (
        ("state", 4),
        ("element", 4),
        ("linear_weights", 2),
        ("rests_on_floor", 2),
        ("is_pushed", 2),
    ):
        assert len({getattr(problem, kind) for problem in problems}) == count
    assert {problem.surface for problem in problems} == {"plane", "round", "ball"}
    assert any(problem.mu == 0 for problem in problems)
    floating = {problem.state for problem in problems if problem.rests_on_floor}
    assert (
        floating
        == {problem.state for problem in problems if not problem.rests_on_floor}
        == set(STRESS_STATES)
    )


@pytest.mark.parametrize(
    ("force", "motion"),
    [
        ((-1e-3, 0.0), (0.0, 0.0)),  # a contact force that pulls
        ((1.0, 0.0), (-1e-3, 0.0)),  # penetration
        ((1.0, 0.0), (1e-3, 0.0)),  # a contact force across a gap
        ((1.0, 0.301), (0.0, 0.0)),  # friction outside the cone
        ((1.0, 0.1), (0.0, -1e-3)),  # slip inside the cone
        ((1.0, 0.3), (0.0, 1e-3)),  # slip in the direction of friction
    ],
)
def test_every_condition_of_the_law_is_checked(force, motion):
    valid_forces, valid_motions = (
        np.array([[1.0, 0.3], [1.0, 0.1]]),
        np.array([[0.0, -0.5], [0.0, 0.0]]),
    )
    mu = np.full(3, 0.3)
    assert relative_law_violation(valid_forces, valid_motions, mu[:2]) < 1e-15
    assert (
        relative_law_violation(
            np.vstack([valid_forces, force]), np.vstack([valid_motions, motion]), mu
        )
        > 1e-4
    )

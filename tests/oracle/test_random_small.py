"""Random small contact problems: the library's forces and displacements against the oracle's.

A distorted block is clamped at one side, or rests on a rough rigid floor alone. It is loaded in
increments that go to and fro: by a moved or pushed rigid surface, or by tractions.
"""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import mesh as meshes
from scipy.spatial import cKDTree

from pw_elements import assemble_matrix
from pw_elements.contact import ContactPair, Motion, Parabola, Plane, Sphere
from tests.contact.cases import GALERKIN, PW, Q8, ElasticBody, on_plane
from tests.oracle import assembly
from tests.oracle.contact import Pair, measure_law_violation, solve_increments

STATES = ("plane stress", "plane strain", "axisymmetric", "solid")
TOLERANCE = 1e-8


def pytest_generate_tests(metafunc):
    if "seed" in metafunc.fixturenames:
        count = 400 if metafunc.config.getoption("--nightly") else 24
        metafunc.parametrize("seed", range(count))


class Random:
    """One random problem; lengths are of the order of 1, as is Young's modulus."""

    path = (0.0, 0.5, 1.0, 0.2, -0.8, 0.1)  # of what acts sideways

    def __init__(self, seed):
        rng = self.rng = np.random.default_rng(seed)
        self.state = STATES[seed % 4]
        self.solid = self.state == "solid"
        self.dim = 3 if self.solid else 2
        self.element = rng.choice(["T10"] if self.solid else ["T6", "T6", "Q8", "Q9"])
        self.linear = self.element != "Q8" and bool(rng.random() < 0.6 or self.element == "Q9")
        self.nu, self.mu = rng.uniform(0.0, 0.4), rng.uniform(0.0, 1.0)
        self.floats = seed // 4 % 3 == 2
        self.surface = "plane" if self.floats else rng.choice(["plane", "plane", "round", "ball"])
        if not self.floats and rng.random() < 0.1:
            self.mu = 0.0
        self.pushed = not self.floats and self.surface != "ball" and bool(rng.random() < 0.5)
        self.share = rng.uniform(0.1, 0.8)  # of the friction's limit that is pulled with
        self.mesh = self._mesh()

    def _mesh(self):
        """A block [1, 2] x ... x [0, 1], its inner nodes and tangentially its boundary's moved."""
        corners = [(1.0,) + (0.0,) * (self.dim - 1), (2.0,) + (1.0,) * (self.dim - 1)]
        if self.solid:
            n, cell = (2, 2, 1), meshes.CellType.tetrahedron
            mesh = meshes.create_box(MPI.COMM_SELF, corners, n, cell)
        else:
            n = tuple(self.rng.integers(2, 5, 2))
            cell = meshes.CellType.triangle if self.element == "T6" else None
            cell = cell or meshes.CellType.quadrilateral
            mesh = meshes.create_rectangle(MPI.COMM_SELF, corners, n, cell)
        x = mesh.geometry.x
        for axis in range(self.dim):
            inside = ~np.isclose(x[:, axis] % 1.0, 0.0)
            step = 0.2 / n[axis] * self.rng.uniform(-1, 1, len(x))
            x[:, axis] += np.where(inside, step, 0.0)
        return mesh

    def loads(self, traction):
        """Load vectors of each increment, of tractions on the top and the right side."""
        down, aside = -np.eye(self.dim)[-1], np.eye(self.dim)[0]
        pressed = traction(self.dim - 1, 1.0, 0.05 * down) * float(self.floats)
        pulled = traction(0, 2.0, 0.05 * aside) * float(self.floats)
        return [pressed + pulled * (self.mu * self.share * t) for t in self.path]

    @property
    def motions(self):
        """Translation, None where free, and force in each increment."""
        zero, result = np.zeros(self.dim), []
        if self.floats:
            return []
        depth, force = 0.02, 0.02 * (2 * np.pi if self.state == "axisymmetric" else 1.0)
        for k, t in enumerate(self.path):
            aside = t * self.mu * self.share
            move, push = zero.copy(), zero.copy()
            if self.pushed:
                move, push[-1] = [0.0] * self.dim, -force * (1 + k / 10)
                move[-1] = None
                if self.state == "axisymmetric" or self.mu == 0:  # no free radial motion, or held
                    move[0] = 0.02 * aside
                else:
                    move[0], push[0] = None, force * aside
            else:
                move[-1], move[0] = -depth * (1 + k / 10), 0.03 * aside
            result.append((list(move), push))
        return result

    @property
    def level(self):
        return 0.0 if self.floats else 1.0

    def rigid(self):
        """The surface as the library has it, its gap and its normal for the oracle."""
        up, apex = np.eye(self.dim)[-1], np.full(self.dim, 0.5)
        apex[0], apex[-1] = 1.5, self.level
        centre, sign = apex + 3.0 * up, 1.0 if self.floats else -1.0
        if self.surface == "ball":
            away = lambda x: np.linalg.norm(x - centre, axis=1)  # noqa: E731
            return (
                Sphere(centre, 3.0),
                lambda x: away(x) - 3.0,
                lambda x: (x - centre) / away(x)[:, None],
            )
        flat = self.surface == "plane"
        return (
            Plane(apex, sign * up) if flat else Parabola(apex, 2.0),
            lambda x: (
                sign * (x[:, -1] - self.level)
                + (not flat) * np.sum((x - apex)[:, :-1] ** 2, axis=1) / 4
            ),
            lambda x: np.tile(sign * up, (len(x), 1)),
        )


class Library(ElasticBody):
    """The problem by the library."""

    def __init__(self, problem):
        self.contact_problem = problem
        method = PW if problem.linear else Q8 if problem.element == "Q8" else GALERKIN
        super().__init__(problem.mesh, method, problem.state, 1.0, problem.nu)
        if problem.state == "axisymmetric":
            self.body = replace(self.body, quadrature_degree=20)
            self.K = assemble_matrix(self.body.stiffness())
        self.nodes, self.cells = self.x, self.space.dofmap.list

    def solve(self):
        """Displacements (n, dim), positions (m, dim) and nodal forces (m, dim) per increment."""
        problem, last = self.contact_problem, self.dim - 1
        supports = self.make_supports() if problem.floats else self.clamp(on_plane(last, 0.0))
        motions = [Motion(move, push) for move, push in problem.motions]
        surface, *_ = problem.rigid()
        pair = ContactPair(on_plane(last, problem.level), surface, problem.mu, motions)
        loads = problem.loads(lambda axis, value, t: self.traction_load(t, on_plane(axis, value)))
        for state in self.solve_contact(pair, supports, loads):
            (contact,) = state.pairs
            moved = state.displacement.array_r.reshape(-1, self.dim)
            yield moved, contact.position, contact.force_vector


def by_oracle(problem, nodes, cells, linear_weights):
    """Numbers of the contact nodes, and states."""
    element, count = str(problem.element), 11 if problem.state == "axisymmetric" else 3
    body = assembly.Body(
        nodes, cells, element, linear_weights, problem.state, 1.0, problem.nu, n_gauss=count
    )

    def traction(axis, value, traction):
        return body.traction_load(lambda x: np.isclose(x[:, axis], value), traction)

    held = body.component_mask(lambda x: np.isclose(x[:, -1], 0.0), tuple(range(problem.dim)))
    touching = np.flatnonzero(np.isclose(nodes[:, -1], problem.level))
    _, gap, normal = problem.rigid()
    pair = Pair(touching, gap, normal, problem.mu, problem.motions)
    loads = problem.loads(traction)
    return touching, solve_increments(
        body.stiffness(), loads, held & (not problem.floats), [pair], nodes
    )


def difference(problem, linear_weights):
    """Largest of forces and displacements, each over the largest of its kind in its increment."""
    library = Library(problem)
    theirs = list(library.solve())
    touching, ours = by_oracle(problem, library.nodes, library.cells, linear_weights)
    worst = 0.0
    for (u, position, force), state in zip(theirs, ours, strict=True):
        order = cKDTree(library.nodes[touching]).query(position)[1]
        worst = max(worst, np.abs(force - state.forces[0][order]).max() / np.abs(force).max())
        worst = max(worst, np.abs(u - state.displacement).max() / np.abs(u).max())
    return worst


@pytest.mark.random
def test_both_find_the_same_forces_and_displacements(seed):
    problem = Random(seed)
    assert difference(problem, problem.linear) < TOLERANCE


def test_a_block_pressed_evenly_on_a_nearly_smooth_floor():
    """Nothing else holds it sideways: in the end one node sticks, and all others slip."""
    problem = Random(12)
    problem.floats, problem.surface, problem.pushed, problem.mu = True, "plane", False, 0.005
    problem.path = (0.0,)
    library = Library(problem)
    _, (state,) = by_oracle(problem, library.nodes, library.cells, problem.linear)
    assert state.law_error <= 1
    assert difference(problem, problem.linear) < TOLERANCE


@pytest.mark.parametrize("number", [1, 3, 6, 9, 15])  # of triangles and tetrahedra
def test_with_the_other_weights_they_do_not(number):
    problem = Random(number)
    assert difference(problem, not problem.linear) > 1e5 * TOLERANCE


def test_problems_are_of_all_kinds():
    problems = [Random(seed) for seed in range(24)]
    for kind, count in (("state", 4), ("element", 4), ("linear", 2), ("floats", 2), ("pushed", 2)):
        assert len({getattr(problem, kind) for problem in problems}) == count
    assert {problem.surface for problem in problems} == {"plane", "round", "ball"}
    assert any(problem.mu == 0 for problem in problems)
    floating = {problem.state for problem in problems if problem.floats}
    assert floating == {problem.state for problem in problems if not problem.floats} == set(STATES)


@pytest.mark.parametrize(
    ("force", "motion"),
    [
        ((-1e-3, 0.0), (0.0, 0.0)),  # pulls
        ((1.0, 0.0), (-1e-3, 0.0)),  # has gone through
        ((1.0, 0.0), (1e-3, 0.0)),  # pushes from afar
        ((1.0, 0.301), (0.0, 0.0)),  # out of the cone
        ((1.0, 0.1), (0.0, -1e-3)),  # slips inside of it
        ((1.0, 0.3), (0.0, 1e-3)),  # slips along the friction
    ],
)
def test_every_line_of_the_law_is_looked_at(force, motion):
    good, none = np.array([[1.0, 0.3], [1.0, 0.1]]), np.array([[0.0, -0.5], [0.0, 0.0]])
    mu = np.full(3, 0.3)
    assert measure_law_violation(good, none, mu[:2]) < 1e-15
    assert measure_law_violation(np.vstack([good, force]), np.vstack([none, motion]), mu) > 1e-4

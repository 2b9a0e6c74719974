"""Contact against references of other origin: tables, closed solutions, other programs."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box

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
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactPair,
    Motion,
    Plane,
    Sphere,
    solve_contact,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import mapped, quadrilaterals, triangles
from tests.contact.cases import Greco, Punch, at

PW, GALERKIN = Spaces.petrov_galerkin, Spaces.galerkin
DOWN = [Motion((0, -0.25 * k / 10)) for k in range(1, 11)]


@pytest.fixture(scope="module")
def fine_punch():
    return Punch((80, 24), grade=3.0)


def test_punch_force_at_a_given_depth(fine_punch):
    """Section 7.3; two other programs: P = 214.2, without friction, 217.8 with it."""
    (smooth,) = fine_punch.solve(0.0, DOWN[-1:])
    assert smooth.pairs[0].force[1] == pytest.approx(-214.2, abs=0.1)
    x = smooth.pairs[0].position[:, 0]
    touching = x[smooth.pairs[0].status != OPEN]
    assert touching.max() == pytest.approx(1.41, abs=0.04)
    pressure = smooth.pairs[0].force_normal / np.gradient(x)
    assert pressure.max() == pytest.approx(96.2, rel=0.002)

    rough = fine_punch.solve(0.6, DOWN)
    assert rough[-1].pairs[0].force[1] == pytest.approx(-217.8, abs=0.1)
    pressure = rough[-1].pairs[0].force_normal / np.gradient(x)
    assert pressure.max() == pytest.approx(106.4, rel=0.005)
    for state in rough:
        assert state.residuals.largest() < 1e-10


@pytest.mark.parametrize("method", [PW, GALERKIN, Spaces.serendipity])
def test_punch_on_the_mesh_of_the_example(method):
    build = quadrilaterals if method == Spaces.serendipity else triangles
    punch = Punch(method=method, build=build)
    (smooth,) = punch.solve(0.0, DOWN[-1:])
    assert smooth.pairs[0].force[1] == pytest.approx(-214.2, rel=0.01)
    rough = punch.solve(0.6, DOWN)
    assert rough[-1].pairs[0].force[1] == pytest.approx(-217.8, rel=0.01)


def test_force_and_displacement_control_agree_and_the_punch_slides(fine_punch):
    force = 217.3
    down = [Motion((0, None), (0, -force * k / 10)) for k in range(1, 11)]
    pulled = [Motion((None, None), (force * k / 100, -force)) for k in range(1, 11)]
    states = fine_punch.solve(0.6, down + pulled)
    for state, motion in zip(states, down + pulled, strict=True):
        free = [i for i in range(2) if motion.translation[i] is None]
        assert state.pairs[0].force[free] == pytest.approx(motion.forces()[free], abs=1e-8)
        assert state.residuals.largest() < 1e-9
        assert state.unique
    depth = [-state.pairs[0].translation[1] for state in states]
    assert depth[9] == pytest.approx(0.25, abs=5e-4)
    again = fine_punch.solve(0.6, [Motion(state.pairs[0].translation) for state in states])
    for state, other in zip(states, again, strict=True):
        assert other.pairs[0].force == pytest.approx(state.pairs[0].force, abs=1e-6)
    # .0463 with a gap that does not follow the slide; .0481 with one that does
    assert states[-1].pairs[0].translation[0] == pytest.approx(0.0481, abs=1e-4)
    assert max(state.iterations for state in states[10:]) <= 4


@pytest.mark.parametrize("method", [PW, GALERKIN])
def test_greco_plate(method):
    """Published displacements of code_aster's SSNV128, and those of a prototype on 64 x 64."""
    greco = Greco(16, method)
    state = greco.solve(1.0)
    (contact,) = state.pairs
    assert {OPEN, STICK, SLIP} == set(contact.status)
    assert state.iterations <= 9
    assert state.residuals.largest() < 1e-10
    u = state.displacement.array_r.reshape(-1, 2)[:, 0]
    x = greco.space.tabulate_dof_coordinates()
    for place, published, prototype in (
        (0, 2.86, 2.8602),
        (1.25, 2.72, 2.7225),
        (5, 2.28, 2.2868),
        (7.5, 1.98, 1.9807),
        (11.25, 1.5, 1.5414),
    ):
        node = np.argmin(np.hypot(x[:, 0] - place / 1e3, x[:, 1]))
        assert 1e5 * u[node] == pytest.approx(published, rel=0.05)
        assert 1e5 * u[node] == pytest.approx(prototype, rel=2e-3)


@pytest.mark.parametrize("method", [PW, GALERKIN])
def test_axisymmetric_patch(method):
    """Uniform pressure on a cylinder; forces are those of whole circumferences."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (6, 3))
    body = Body(method(mesh), Material(10.0, 0.3), StressState.AXISYMMETRIC)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    top, foot = (boundary_measure(mesh, at(1, z)) for z in (1.0, 0.0))
    f = assemble_vector(body.surface_load((0.0, -3.0), top))
    even = assemble_vector(body.surface_load((0.0, 3.0), foot)).array_r.reshape(-1, 2)[:, 1]
    axis = Reduction.dirichlet(U, [prescribe(U, 0, at(0, 0.0))])
    pair = ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)))
    (state,) = solve_contact(K, f, axis, [pair], U)
    (contact,) = state.pairs
    nodes = np.flatnonzero(np.isclose(U.tabulate_dof_coordinates()[:, 1], 0.0))
    nodes = nodes[np.argsort(U.tabulate_dof_coordinates()[nodes, 0])]
    assert contact.force_normal == pytest.approx(even[nodes], abs=1e-10)
    assert contact.force[1] == pytest.approx(3.0 * np.pi * 2**2)
    assert state.iterations == 1


def test_hertz_sphere():
    """Contact radius and peak pressure for a given force on a large cylinder."""
    E, nu, R, P = 1000.0, 0.3, 10.0, 20.0
    modulus = E / (1 - nu**2)
    a = (0.75 * P * R / modulus) ** (1 / 3)
    peak = 1.5 * P / (np.pi * a**2)

    def graded(x):
        y = x.copy()
        y[:, 0] = 12 * (0.1 * x[:, 0] + 0.9 * x[:, 0] ** 4)
        y[:, 1] = -12 * (0.1 * (1 - x[:, 1]) + 0.9 * (1 - x[:, 1]) ** 4)
        return y

    mesh = mapped(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (40, 30)), graded)
    body = Body(PW(mesh), Material(E, nu), StressState.AXISYMMETRIC)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    held = Reduction.dirichlet(U, [prescribe(U, 0, at(0, 0.0)), prescribe(U, 1, at(1, -12.0))])
    ball = ContactPair(at(1, 0.0), Sphere((0, R), R), 0.0, [Motion((0, None), (0, -P))])
    (state,) = solve_contact(K, K.createVecLeft(), held, [ball], U)
    (contact,) = state.pairs
    r = contact.position[:, 0]
    touching = r[contact.status != OPEN]
    assert touching.max() == pytest.approx(a, abs=2 * np.diff(touching).max())
    weight = boundary_measure(mesh, at(1, 0.0))
    area = assemble_vector(body.surface_load((0.0, 1.0), weight)).array_r.reshape(-1, 2)[:, 1]
    nodes = np.flatnonzero(np.isclose(U.tabulate_dof_coordinates()[:, 1], 0.0))
    nodes = nodes[np.argsort(U.tabulate_dof_coordinates()[nodes, 0])]
    pressure = contact.force_normal / area[nodes]
    hertz = peak * np.sqrt(np.maximum(0.0, 1 - (r / a) ** 2))
    inner = r < 0.8 * a
    assert pressure[inner] == pytest.approx(hertz[inner], rel=0.03)
    assert state.residuals.largest() < 1e-9


@pytest.mark.parametrize("method", [PW, GALERKIN])
@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5])
def test_sliding_block_in_space(method, angle):
    """Shear of uniform size mu p against the slip, whatever its direction: exact."""
    mu, p, E = 0.3, 3.0, 10.0
    along = np.array([np.cos(angle), np.sin(angle)])
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [2, 2, 2], CellType.tetrahedron)
    body = Body(method(mesh), Material(E), StressState.SOLID)  # nu = 0: the slip is uniform, too
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    shear = mu * p * along
    stress = np.zeros((3, 3))
    stress[2, :2] = stress[:2, 2] = -shear
    stress[2, 2] = -p
    f = K.createVecLeft()
    for axis, side in ((0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0)):
        outward = (2 * side - 1) * np.eye(3)[axis]
        face = boundary_measure(mesh, at(axis, side))
        f.axpy(1.0, assemble_vector(body.surface_load(stress @ outward, face)))
    top = [*(-shear * 2 / E), -p / E]
    held = Reduction.dirichlet(U, [prescribe(U, i, at(2, 1.0), top[i]) for i in range(3)])
    dragged = [Motion((0.1 * along[0], 0.1 * along[1], 0.0))]
    floor = ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), mu, dragged)
    (state,) = solve_contact(K, f, held, [floor], U)
    (contact,) = state.pairs
    assert contact.force == pytest.approx([*shear, p], abs=1e-9)
    friction = contact.force_tangential[:, :2]
    assert friction == pytest.approx(mu * contact.force_normal[:, None] * along, abs=1e-9)
    loaded = contact.force_normal > 1e-9
    assert np.all(contact.status[loaded] == SLIP)
    assert contact.slip[loaded, :2] == pytest.approx(
        -0.1 * np.tile(along, (loaded.sum(), 1)), abs=1e-9
    )
    assert state.iterations <= 8
    assert state.residuals.largest() < 1e-9


def ball_in_space():
    """Solves for motions of a sphere on a block: function of friction and motions."""
    mesh = create_box(MPI.COMM_SELF, [(-1, -1, 0), (1, 1, 1)], [6, 6, 3], CellType.tetrahedron)
    body = Body(PW(mesh), Material(1000.0, 0.3), StressState.SOLID)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    foot = Reduction.dirichlet(U, [prescribe(U, i, at(2, 0.0)) for i in range(3)])

    def solved(mu, motions):
        ball = ContactPair(at(2, 1.0), Sphere((0, 0, 3), 2.0), mu, motions)
        return solve_contact(K, [K.createVecLeft()] * len(motions), foot, [ball], U)

    return solved


def test_sphere_under_forces_in_space():
    """Force and displacement control agree although normals and tangents turn on the way."""
    solved = ball_in_space()
    mu, force = 0.4, 120.0
    down = [Motion((0, 0, None), (0, 0, -force))]
    around = [
        Motion((None, None, None), (0.6 * mu * force * c, 0.6 * mu * force * s, -force))
        for c, s in ((1.0, 0.0), (0.8, 0.6), (0.0, 1.0))
    ]
    states = solved(mu, down + around)
    again = solved(mu, [Motion(state.pairs[0].translation) for state in states])
    for state, other in zip(states, again, strict=True):
        assert state.residuals.largest() < 1e-8
        assert other.pairs[0].force == pytest.approx(state.pairs[0].force, abs=1e-5)
        assert other.displacement.array_r == pytest.approx(state.displacement.array_r, abs=1e-8)
    for state, motion in zip(states[1:], around, strict=True):
        assert state.pairs[0].force == pytest.approx(motion.force, abs=1e-6)
        slide, pull = state.pairs[0].translation[:2], np.array(motion.force[:2])
        assert slide @ pull > 0.9 * np.linalg.norm(slide) * np.linalg.norm(pull)


def test_sphere_dragged_around_a_bend_in_space():
    """Partial slip whose direction turns from increment to increment."""
    path = [(0, 0), (0.01, 0.0), (0.02, 0.005), (0.025, 0.02), (0.015, 0.04)]
    motions = [Motion((x, y, -0.1)) for x, y in path]
    states = ball_in_space()(0.3, motions)
    for state in states:
        assert state.residuals.largest() < 1e-8
        assert state.iterations <= 9
    for state in states[2:]:
        (contact,) = state.pairs
        moving = (contact.status == SLIP) & (np.linalg.norm(contact.slip, axis=1) > 1e-6)
        assert moving.sum() > 3
        cosine = np.sum(contact.slip * contact.force_tangential, axis=1)[moving]
        cosine /= np.linalg.norm(contact.slip[moving], axis=1)
        cosine /= np.linalg.norm(contact.force_tangential[moving], axis=1)
        assert cosine == pytest.approx(-1.0, abs=1e-6)

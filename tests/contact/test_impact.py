"""Central differences with contact against known answers, and the study's section V12."""

from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import scipy.linalg

from pw_elements import Sibling, assemble_matrix, critical_step, lumped_mass, prescribe
from pw_elements.contact import (
    STICK,
    ContactFields,
    ContactPair,
    Coulomb,
    Plane,
    solve_impact,
    write,
)
from pw_elements.contact.model import FrictionCone, MatchingNodes
from pw_elements.contact.steps.impact import solve_nodal_contact
from pw_elements.meshes import move_nodes, triangles
from study.matrices import dense
from study.verification import v12_impact
from study.verification.c_mesh_families import on_strip
from tests.contact.cases import GALERKIN, ElasticBody, on_plane
from tests.contact.test_friction import SaturatingFriction

FLOOR = Plane((0.0, 0.0), (0.0, 1.0))


def uneven(x):
    return np.column_stack([x[:, 0] + 0.05 * np.sin(3 * x[:, 0]), x[:, 1:]])


class Thrown(ElasticBody):
    """A block 2 x 1 on the sibling, free to fly."""

    def __init__(self, E=50.0, comm=MPI.COMM_SELF):
        mesh = move_nodes(triangles(comm, (0.0, 0.0), (2.0, 1.0), (6, 3)), uneven)
        super().__init__(mesh, GALERKIN, E=E)
        self.sibling = Sibling.from_space(self.space)
        self.standard, self.K = self.K, self.sibling.matrix(self.K)
        M = self.sibling.matrix(assemble_matrix(self.body.mass()))
        self.M = lumped_mass(M, self.space)
        self.mass = self.M.getDiagonal().array.copy()
        self.total = self.mass[::2].sum()
        self.no_supports = self.sibling.dirichlet([])

    def even(self, vector):
        """The same velocity or displacement of all nodes."""
        found = self.K.createVecRight()
        found.array.reshape(-1, 2)[:] = vector
        return found

    def body_force_load(self, gravity):
        return self.sibling.load(super().body_force_load(gravity))

    def walls(self, marker):
        return self.sibling.dirichlet([prescribe(self.space, 0, marker)])

    def fly(self, duration, velocity, mu=0.0, reduction=None, **stated):
        floor = ContactPair(on_plane(1, 0.0), FLOOR, mu)
        velocity = velocity if isinstance(velocity, PETSc.Vec) else self.even(velocity)
        reduction = reduction or self.no_supports
        problem = self.K, self.M, reduction, floor, self.space
        return solve_impact(*problem, duration, velocity, **stated)


BLOCK = Thrown()


def test_momentum_changes_by_the_impulses_and_energy_by_the_work():
    gravity = np.array([0.2, -1.0])
    history = BLOCK.fly(3.0, (1.0, -0.7), 0.4, load=BLOCK.body_force_load(gravity))
    dt, steps = history.step, len(history.time) - 1
    momentum = (BLOCK.mass * history.velocity.array).reshape(-1, 2).sum(axis=0)
    pushes = history.pairs[0].total.sum(axis=0) * dt
    # half a step of the load less, for velocities at half steps
    falls = BLOCK.total * gravity * dt * (steps - 0.5)
    assert momentum == pytest.approx(BLOCK.total * np.array([1.0, -0.7]) + pushes + falls)
    energies = history.energies
    assert energies.imbalance < 1e-12
    assert energies.normal_work[-1] < -1e-3
    assert energies.friction_work[-1] < -0.1 * energies.total[0]
    assert np.all(
        np.abs(history.pairs[0].force[..., 0]) <= 0.4 * history.pairs[0].force[..., 1] + 1e-12
    )


def test_rough_plane_stops_a_block_after_v2_over_2_mu_g():
    mu, gravity, speed = 0.2, 1.0, 0.5
    block = Thrown(E=5e4)
    weight = block.body_force_load((0.0, -gravity))
    # it starts as it rests on the plane under its weight, rollers at a corner holding it
    roller = block.walls(lambda x: np.isclose(x[0], 0.0) & np.isclose(x[1], 0.0))
    (rests,) = block.solve_contact(ContactPair(on_plane(1, 0.0), FLOOR), roller, weight)
    stop = speed / (mu * gravity)
    options = {"load": weight, "displacement": rests.displacement, "frames": 1}
    history = block.fly(1.3 * stop, (speed, 0.0), mu, **options)
    u = history.displacement.array - rests.displacement.array
    travel = (block.mass * u)[::2].sum() / block.total
    assert travel == pytest.approx(speed**2 / (2 * mu * gravity), rel=0.01)
    velocity = (block.mass * history.velocity.array)[::2].sum() / block.total
    assert abs(velocity) < 0.01 * speed
    sliding = history.time[:-1] < 0.9 * stop
    drag = -history.pairs[0].total[sliding, 0].mean()
    assert drag == pytest.approx(mu * gravity * block.total, rel=0.01)
    assert (history.frames[0].pairs[0].status == STICK).all()


def test_forces_are_those_seen_from_a_train():
    """A body that is thrown at a plane at rest, and a plane that is driven into a resting body."""
    velocity = np.array([0.6, -0.8])
    thrown = BLOCK.fly(1.5, velocity, 0.3)
    driven = BLOCK.fly(1.5, (0.0, 0.0), 0.3, paths=lambda time: -velocity * time)
    size = np.abs(thrown.pairs[0].force).max()
    assert driven.pairs[0].force == pytest.approx(thrown.pairs[0].force, abs=1e-9 * size)
    assert driven.energies.imbalance < 1e-12
    assert driven.energies.normal_work[-1] > 0.1
    assert driven.pairs[0].translation[-1] == pytest.approx(-velocity * driven.time[-1])


@pytest.mark.parametrize("scheme", ["hrz", "sibling"])
def test_bar_moves_as_computed_by_hand(scheme):
    """The loop of section V12's scheme `pw` shares no code with the library's."""
    found = v12_impact.Scheme.of(scheme, on_strip("", 0.25))
    held = found.walls([1.0])
    library, other = v12_impact._by_library(found, held), v12_impact._by_hand(found, held)
    assert library.critical_step == pytest.approx(other.critical_step, rel=1e-8)
    assert library.energy == pytest.approx(other.energy, rel=1e-8)
    rows = len(other.force)
    assert library.force[:rows] == pytest.approx(other.force, abs=1e-6 * other.force.max())


def test_critical_step_is_that_of_the_highest_frequency():
    held = BLOCK.walls(on_plane(0, 0.0))
    R = dense(held.right)
    values = scipy.linalg.eigvalsh(R.T @ dense(BLOCK.K) @ R, R.T @ dense(BLOCK.M) @ R)
    assert critical_step(BLOCK.K, BLOCK.M, held) == pytest.approx(2 / np.sqrt(values[-1]))


@pytest.mark.parametrize("name", ["Coulomb's", "falling"])
def test_law_holds_at_random_points(name):
    """Slip that is left is along the friction, which then is all that the law allows."""
    rng = np.random.default_rng(3)
    n, step = 2000, 0.1
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    motion, shift = rng.normal(size=(2, n, 3))
    gap, mass, mu = rng.normal(size=n), rng.uniform(1, 9, n), rng.choice([0.0, 0.3, 2.0], n)
    gap[:50], half = np.inf, rng.uniform(1, 99, n)
    cone = (
        FrictionCone([Coulomb(0.0)], [mu])
        if name == "Coulomb's"
        else FrictionCone([SaturatingFriction(0.9, None)], [half])
    )
    held = np.zeros((n, 3), bool)
    found = solve_nodal_contact(motion, gap, normal, shift, held, held, mass, cone, step)
    after = motion + step**2 * found.force / mass[:, None]
    reached = gap + np.sum(normal * after, axis=1)
    slip = after - shift - np.sum(normal * (after - shift), axis=1)[:, None] * normal
    falling = 0.9 / (1 + found.force_normal / half)
    limit = (mu if name == "Coulomb's" else falling) * found.force_normal
    assert (found.force_normal >= 0).all()
    assert reached.min() > -1e-12
    assert found.gap == pytest.approx(reached, abs=1e-12)
    assert np.minimum(found.force_normal, reached) == pytest.approx(0.0, abs=1e-12)
    size, slides = (np.linalg.norm(part, axis=1) for part in (found.force_tangential, slip))
    assert (size <= limit * (1 + 1e-12)).all()
    closed = found.force_normal > 0
    assert found.slip == pytest.approx(slip, abs=1e-12)
    work = np.sum(found.force_tangential * slip, axis=1)
    assert work == pytest.approx(-limit * slides, abs=1e-9)
    assert 0 < (slides[closed] < 1e-12).sum() < closed.sum()


def test_law_holds_at_random_points_that_supports_hold_along_the_surface():
    """What a support fixes of the slip stays, and friction opposes all of the slip."""
    rng = np.random.default_rng(5)
    n, step = 2000, 0.1
    normal = np.tile([0.0, 0.0, 1.0], (n, 1))
    motion, shift = rng.normal(size=(2, n, 3))
    held = np.zeros((n, 3), bool)
    held[:, :2] = rng.integers(0, 2, (n, 2))
    motion[held] = 0.0
    gap, mass, mu = rng.normal(size=n), rng.uniform(1, 9, n), rng.choice([0.0, 0.3, 2.0], n)
    cone = FrictionCone([Coulomb(0.0)], [mu])
    found = solve_nodal_contact(motion, gap, normal, shift, held, held, mass, cone, step)
    moved = motion + np.where(held, 0.0, step**2 * found.force / mass[:, None])
    slip = (moved - shift) * [1.0, 1.0, 0.0]
    assert found.slip == pytest.approx(slip, abs=1e-12)
    limit, size = mu * found.force_normal, np.linalg.norm(slip, axis=1)
    force = found.force_tangential
    slides = (size > 1e-12) & (found.force_normal > 0)
    assert (np.linalg.norm(force, axis=1) <= limit * (1 + 1e-12)).all()
    against = -(limit[slides] / size[slides])[:, None] * slip[slides]
    assert force[slides] == pytest.approx(against, abs=1e-9)
    assert (~slides & (found.force_normal > 0)).any()


def test_walls_leave_a_block_the_friction_of_its_floor():
    """A block between smooth walls on a plane that runs away below it."""
    walls = BLOCK.walls(lambda x: x[0] > -1)
    history = BLOCK.fly(1.0, (0.0, -1.0), 0.5, walls, paths=[lambda time: (time, 0.0)])
    pressed = history.pairs[0].force[..., 1]
    assert pressed.max() > 0
    assert history.pairs[0].force[..., 0] == pytest.approx(0.5 * pressed, rel=1e-12)


def test_frames_are_written(tmp_path):
    history = BLOCK.fly(1.0, (0.3, -1.0), 0.2, frames=4)
    assert len(history.frames) == 4
    assert history.frame_times[-1] == pytest.approx(history.time[-1])
    write(tmp_path / "thrown.bp", history.frames, BLOCK.body, history.frame_times)
    assert (tmp_path / "thrown.bp").exists()
    fields = ContactFields.from_state(history.frames[-1], BLOCK.body)
    true = BLOCK.sibling.displacement(history.displacement)
    assert fields.displacement.x.array == pytest.approx(true.array)
    (pair,) = history.frames[-1].pairs
    assert pair.force_vector == pytest.approx(history.pairs[0].force[-1])
    with pytest.raises(ValueError, match="is no solution"):
        BLOCK.contact_problem(ContactPair(on_plane(1, 0.0), FLOOR), BLOCK.no_supports).step(
            history.frames[-1], BLOCK.body_force_load((0.0, -1.0))
        )


def refused(**changed):
    stated = {
        "K": BLOCK.K,
        "M": BLOCK.M,
        "reduction": BLOCK.no_supports,
        "pairs": ContactPair(on_plane(1, 0.0), FLOOR),
        "space": BLOCK.space,
        "duration": 1.0,
        "velocity": BLOCK.even((0.0, -1.0)),
    }
    solve_impact(**{**stated, **changed})


def uneven_mass():
    M = BLOCK.M.copy()
    diagonal = M.getDiagonal()
    diagonal.array[::2] *= 2
    M.setDiagonal(diagonal)
    return M


REFUSED = {
    "unsymmetric": (lambda: {"K": ElasticBody(BLOCK.mesh).K}, "complex.*grow.*Sibling"),
    "full mass": (lambda: {"M": BLOCK.K}, "not diagonal"),
    "no mass": (lambda: {"M": 0.0 * BLOCK.M}, "not positive"),
    "uneven mass": (lambda: {"M": uneven_mass()}, "components differ"),
    "long step": (lambda: {"step": 10.0}, "stable up to"),
    "no step": (lambda: {"step": 0.0}, "has to be positive"),
    "no time": (lambda: {"duration": np.nan}, "finite number"),
    "frames": (lambda: {"frames": 1.5}, "whole number"),
    "paths": (lambda: {"paths": [None, None]}, "2 paths for 1 contact pairs"),
    "no end": (lambda: {"duration": 1e9}, "more than max_steps = 1000000: about .* hours"),
    "jump": (lambda: {"paths": lambda t: (0.0, 0.9 * (t > 0.5) - 1.0)}, "jump into the body"),
    "no path": (lambda: {"paths": [1.0]}, "has to be a function of time"),
    "path": (lambda: {"paths": [lambda _: (1.0,)]}, "path of contact pair 0"),
    "failing path": (lambda: {"paths": [lambda _: 1 / 0]}, "path of contact pair 0 failed"),
    "failing load": (lambda: {"load": lambda _: 1 / 0}, "the load failed"),
    "infinite load": (lambda: {"load": BLOCK.even((np.inf, 0.0))}, "load.*not finite"),
    "condensation": (
        lambda: {"reduction": replace(BLOCK.no_supports, inner_flexibility=BLOCK.K)},
        "no condensation",
    ),
    "matching": (
        lambda: {"pairs": ContactPair(on_plane(1, 0.0), MatchingNodes(on_plane(1, 1.0), FLOOR))},
        "not of two bodies",
    ),
    "inside": (
        lambda: {"displacement": BLOCK.even((0.0, -0.1))},
        "let it start 0.1 farther away",
    ),
    "driven in": (lambda: {"paths": lambda _: (0.0, 0.1)}, "would be shot out"),
    "velocity": (lambda: {"velocity": BLOCK.even((np.nan, 0.0))}, "velocity is not finite"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_impact_is_refused(name):
    changed, words = REFUSED[name]
    with pytest.raises((TypeError, ValueError), match=words):
        refused(**changed())


def test_a_critical_step_needs_a_diagonal_mass():
    with pytest.raises(ValueError, match="not diagonal"):
        critical_step(BLOCK.standard, assemble_matrix(BLOCK.body.mass()), BLOCK.make_supports())


# -- what is watched -------------------------------------------------------------------------


def test_frames_know_whether_displacements_are_small(caplog):
    with caplog.at_level("WARNING", "pw_elements.contact"):
        history = BLOCK.fly(0.4, (0.0, -3.0), frames=2)
    assert max(state.smallness.strain for state in history.frames) > 0.05
    assert "leaves the range of small displacements: largest strain" in caplog.text


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_stiffness_with_negative_eigenvalues_is_refused(sign):
    K = BLOCK.K.copy()
    if sign < 0:
        K.scale(-1.0)
    else:  # a spring between two nodes that pushes them apart
        K.setValues([0, 40], [0, 40], 100 * np.array([[0.0, 1.0], [1.0, 0.0]]), addv=True)
        K.assemble()
    with pytest.raises(ValueError, match="not negative"):
        critical_step(K, BLOCK.M, BLOCK.no_supports)

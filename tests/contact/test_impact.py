"""Impact by central differences, compared with known solutions and with the validation study."""

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
from pw_elements.contact.steps.impact import solve_nodal_contact_of_step
from pw_elements.meshes import move_nodes, triangles
from study.benchmarks.v12_impact.page import (
    integrate_impact_for_any_stiffness,
    integrate_impact_with_library,
)
from study.benchmarks.v12_impact.schemes import StiffnessMassPair
from study.meshes.mesh_families import on_strip
from study.model.matrices import to_dense_array
from tests.contact.cases import GALERKIN, ElasticBody, make_x_spacing_unequal, on_plane
from tests.contact.test_friction import SaturatingFriction

FLOOR = Plane((0.0, 0.0), (0.0, 1.0))


class ThrownBlock(ElasticBody):
    """A 2 x 1 block of the symmetric sibling of the new element, without supports."""

    def __init__(self, E=50.0, comm=MPI.COMM_SELF):
        mesh = move_nodes(
            triangles(comm, (0.0, 0.0), (2.0, 1.0), (6, 3)),
            lambda x: make_x_spacing_unequal(x, 0.05),
        )
        super().__init__(mesh, GALERKIN, E=E)
        self.sibling = Sibling.from_space(self.space)
        self.standard_stiffness, self.K = self.K, self.sibling.matrix(self.K)
        M = self.sibling.matrix(assemble_matrix(self.body.mass()))
        self.M = lumped_mass(M, self.space)
        self.mass = self.M.getDiagonal().array.copy()
        self.total_mass = self.mass[::2].sum()
        self.no_supports = self.sibling.dirichlet([])

    def uniform_vector(self, nodal_value):
        """Return the vector that has the same velocity or displacement at all nodes."""
        uniform = self.K.createVecRight()
        uniform.array.reshape(-1, 2)[:] = nodal_value
        return uniform

    def body_force_load(self, force_per_volume):
        return self.sibling.load(super().body_force_load(force_per_volume))

    def x_supports(self, marker):
        return self.sibling.dirichlet([prescribe(self.space, 0, marker)])

    def solve_impact(self, duration, velocity, mu=0.0, reduction=None, **options):
        floor = ContactPair(on_plane(1, 0.0), FLOOR, mu)
        velocity = velocity if isinstance(velocity, PETSc.Vec) else self.uniform_vector(velocity)
        reduction = reduction or self.no_supports
        arguments = self.K, self.M, reduction, floor, self.space
        return solve_impact(*arguments, duration, velocity, **options)


THROWN_BLOCK = ThrownBlock()


def test_momentum_changes_by_impulses_and_energy_by_work():
    gravity = np.array([0.2, -1.0])
    history = THROWN_BLOCK.solve_impact(
        3.0, (1.0, -0.7), 0.4, load=THROWN_BLOCK.body_force_load(gravity)
    )
    dt, steps = history.step, len(history.time) - 1
    momentum = (THROWN_BLOCK.mass * history.velocity.array).reshape(-1, 2).sum(axis=0)
    contact_impulse = history.pairs[0].total_force.sum(axis=0) * dt
    # velocities belong to the middle of steps; half a step of the load is therefore missing
    load_impulse = THROWN_BLOCK.total_mass * gravity * dt * (steps - 0.5)
    assert momentum == pytest.approx(
        THROWN_BLOCK.total_mass * np.array([1.0, -0.7]) + contact_impulse + load_impulse
    )
    energies = history.energies
    assert energies.imbalance < 1e-12
    assert energies.normal_work[-1] < -1e-3
    assert energies.friction_work[-1] < -0.1 * energies.total[0]
    assert np.all(
        np.abs(history.pairs[0].force[..., 0]) <= 0.4 * history.pairs[0].force[..., 1] + 1e-12
    )


def test_a_rough_plane_stops_a_block_after_v2_over_2_mu_g():
    mu, gravity, speed = 0.2, 1.0, 0.5
    block = ThrownBlock(E=5e4)
    weight = block.body_force_load((0.0, -gravity))
    # the start state is the block at rest under its weight, with rollers at a corner
    roller = block.x_supports(lambda x: np.isclose(x[0], 0.0) & np.isclose(x[1], 0.0))
    (rest_state,) = block.solve_contact(ContactPair(on_plane(1, 0.0), FLOOR), roller, weight)
    stopping_time = speed / (mu * gravity)
    options = {"load": weight, "displacement": rest_state.displacement, "frames": 1}
    history = block.solve_impact(1.3 * stopping_time, (speed, 0.0), mu, **options)
    u = history.displacement.array - rest_state.displacement.array
    travel = (block.mass * u)[::2].sum() / block.total_mass
    assert travel == pytest.approx(speed**2 / (2 * mu * gravity), rel=0.01)
    velocity = (block.mass * history.velocity.array)[::2].sum() / block.total_mass
    assert abs(velocity) < 0.01 * speed
    is_sliding = history.time[:-1] < 0.9 * stopping_time
    drag = -history.pairs[0].total_force[is_sliding, 0].mean()
    assert drag == pytest.approx(mu * gravity * block.total_mass, rel=0.01)
    assert (history.frames[0].pairs[0].status == STICK).all()


def test_forces_are_the_same_in_a_moving_frame():
    """Contact forces do not depend on the motion of the frame of reference.

    The forces on a body that is thrown at a resting plane agree with those on a resting body at
    which the plane is moved with the opposite velocity.
    """
    velocity = np.array([0.6, -0.8])
    thrown = THROWN_BLOCK.solve_impact(1.5, velocity, 0.3)
    driven = THROWN_BLOCK.solve_impact(1.5, (0.0, 0.0), 0.3, paths=lambda time: -velocity * time)
    largest = np.abs(thrown.pairs[0].force).max()
    assert driven.pairs[0].force == pytest.approx(thrown.pairs[0].force, abs=1e-9 * largest)
    assert driven.energies.imbalance < 1e-12
    assert driven.energies.normal_work[-1] > 0.1
    assert driven.pairs[0].translation[-1] == pytest.approx(-velocity * driven.time[-1])


@pytest.mark.parametrize("scheme", ["hrz", "sibling"])
def test_a_bar_moves_as_in_the_time_loop_of_the_study(scheme):
    """A bar that hits a wall moves as in an independent time loop of the validation study.

    Critical step, energy and contact forces are compared with those of the time loop that section
    V12 (study/benchmarks/v12_impact) uses for its scheme `pw`. This loop does not use the library's
    `solve_impact`.
    """
    bar = StiffnessMassPair.from_scheme_name(scheme, on_strip("", 0.25))
    supports = bar.make_smooth_wall_supports([1.0])
    library, own_scheme = (
        integrate_impact_with_library(bar, supports),
        integrate_impact_for_any_stiffness(bar, supports),
    )
    assert library.critical_step == pytest.approx(own_scheme.critical_step, rel=1e-8)
    assert library.relative_energy_at_end == pytest.approx(
        own_scheme.relative_energy_at_end, rel=1e-8
    )
    rows = len(own_scheme.force)
    assert library.force[:rows] == pytest.approx(
        own_scheme.force, abs=1e-6 * own_scheme.force.max()
    )


def test_the_critical_step_is_that_of_the_highest_frequency():
    supports = THROWN_BLOCK.x_supports(on_plane(0, 0.0))
    R = to_dense_array(supports.right)
    values = scipy.linalg.eigvalsh(
        R.T @ to_dense_array(THROWN_BLOCK.K) @ R, R.T @ to_dense_array(THROWN_BLOCK.M) @ R
    )
    assert critical_step(THROWN_BLOCK.K, THROWN_BLOCK.M, supports) == pytest.approx(
        2 / np.sqrt(values[-1])
    )


@pytest.mark.parametrize("name", ["Coulomb's", "falling"])
def test_contact_and_friction_law_hold_for_random_nodal_data(name):
    """Forces computed from random nodal data obey the contact conditions and the friction law.

    Where slip remains, friction opposes it and is at its limit.
    """
    rng = np.random.default_rng(3)
    n, step = 2000, 0.1
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    motion, shift = rng.normal(size=(2, n, 3))
    gap, mass, mu = rng.normal(size=n), rng.uniform(1, 9, n), rng.choice([0.0, 0.3, 2.0], n)
    gap[:50], half_force = np.inf, rng.uniform(1, 99, n)
    cone = (
        FrictionCone([Coulomb(0.0)], [mu])
        if name == "Coulomb's"
        else FrictionCone([SaturatingFriction(0.9, None)], [half_force])
    )
    is_held = np.zeros((n, 3), bool)
    contact = solve_nodal_contact_of_step(
        motion, gap, normal, shift, is_held, is_held, mass, cone, step
    )
    end_motion = motion + step**2 * contact.force / mass[:, None]
    end_gap = gap + np.sum(normal * end_motion, axis=1)
    slip = end_motion - shift - np.sum(normal * (end_motion - shift), axis=1)[:, None] * normal
    coefficient = 0.9 / (1 + contact.force_normal / half_force)
    limit = (mu if name == "Coulomb's" else coefficient) * contact.force_normal
    assert (contact.force_normal >= 0).all()
    assert end_gap.min() > -1e-12
    assert contact.gap == pytest.approx(end_gap, abs=1e-12)
    assert np.minimum(contact.force_normal, end_gap) == pytest.approx(0.0, abs=1e-12)
    shear, slip_length = (
        np.linalg.norm(vectors, axis=1) for vectors in (contact.force_tangential, slip)
    )
    assert (shear <= limit * (1 + 1e-12)).all()
    is_closed = contact.force_normal > 0
    assert contact.slip == pytest.approx(slip, abs=1e-12)
    work = np.sum(contact.force_tangential * slip, axis=1)
    assert work == pytest.approx(-limit * slip_length, abs=1e-9)
    assert 0 < (slip_length[is_closed] < 1e-12).sum() < is_closed.sum()


def test_contact_and_friction_law_hold_at_random_supported_nodes():
    """The friction law holds for random data at nodes with prescribed tangential motions.

    Supports prescribe some components of the slip; friction opposes the whole slip.
    """
    rng = np.random.default_rng(5)
    n, step = 2000, 0.1
    normal = np.tile([0.0, 0.0, 1.0], (n, 1))
    motion, shift = rng.normal(size=(2, n, 3))
    is_held = np.zeros((n, 3), bool)
    is_held[:, :2] = rng.integers(0, 2, (n, 2))
    motion[is_held] = 0.0
    gap, mass, mu = rng.normal(size=n), rng.uniform(1, 9, n), rng.choice([0.0, 0.3, 2.0], n)
    cone = FrictionCone([Coulomb(0.0)], [mu])
    contact = solve_nodal_contact_of_step(
        motion, gap, normal, shift, is_held, is_held, mass, cone, step
    )
    end_motion = motion + np.where(is_held, 0.0, step**2 * contact.force / mass[:, None])
    slip = (end_motion - shift) * [1.0, 1.0, 0.0]
    assert contact.slip == pytest.approx(slip, abs=1e-12)
    limit, slip_length = mu * contact.force_normal, np.linalg.norm(slip, axis=1)
    force = contact.force_tangential
    is_sliding = (slip_length > 1e-12) & (contact.force_normal > 0)
    assert (np.linalg.norm(force, axis=1) <= limit * (1 + 1e-12)).all()
    opposing_friction = -(limit[is_sliding] / slip_length[is_sliding])[:, None] * slip[is_sliding]
    assert force[is_sliding] == pytest.approx(opposing_friction, abs=1e-9)
    assert (~is_sliding & (contact.force_normal > 0)).any()


def test_a_block_between_walls_has_the_friction_of_its_floor():
    """A block between frictionless walls has the full friction of its floor.

    Supports prevent all horizontal motions of the block, while the floor moves sideways below it.
    """
    supports = THROWN_BLOCK.x_supports(lambda x: x[0] > -1)
    history = THROWN_BLOCK.solve_impact(
        1.0, (0.0, -1.0), 0.5, supports, paths=[lambda time: (time, 0.0)]
    )
    normal_force = history.pairs[0].force[..., 1]
    assert normal_force.max() > 0
    assert history.pairs[0].force[..., 0] == pytest.approx(0.5 * normal_force, rel=1e-12)


def test_frames_are_written_and_fields_show_true_displacements(tmp_path):
    history = THROWN_BLOCK.solve_impact(1.0, (0.3, -1.0), 0.2, frames=4)
    assert len(history.frames) == 4
    assert history.frame_times[-1] == pytest.approx(history.time[-1])
    write(tmp_path / "thrown.bp", history.frames, THROWN_BLOCK.body, history.frame_times)
    assert (tmp_path / "thrown.bp").exists()
    fields = ContactFields.from_state(history.frames[-1], THROWN_BLOCK.body)
    true_displacement = THROWN_BLOCK.sibling.displacement(history.displacement)
    assert fields.displacement.x.array == pytest.approx(true_displacement.array)
    (pair,) = history.frames[-1].pairs
    assert pair.force_vector == pytest.approx(history.pairs[0].force[-1])
    with pytest.raises(ValueError, match="has not converged"):
        THROWN_BLOCK.contact_problem(
            ContactPair(on_plane(1, 0.0), FLOOR), THROWN_BLOCK.no_supports
        ).step(history.frames[-1], THROWN_BLOCK.body_force_load((0.0, -1.0)))


def solve_impact_with_changes(**changes):
    arguments = {
        "K": THROWN_BLOCK.K,
        "M": THROWN_BLOCK.M,
        "reduction": THROWN_BLOCK.no_supports,
        "pairs": ContactPair(on_plane(1, 0.0), FLOOR),
        "space": THROWN_BLOCK.space,
        "duration": 1.0,
        "velocity": THROWN_BLOCK.uniform_vector((0.0, -1.0)),
    }
    solve_impact(**{**arguments, **changes})


def mass_with_unequal_components():
    M = THROWN_BLOCK.M.copy()
    diagonal = M.getDiagonal()
    diagonal.array[::2] *= 2
    M.setDiagonal(diagonal)
    return M


INVALID_CHANGES_AND_MESSAGES = {
    "unsymmetric": (lambda: {"K": ElasticBody(THROWN_BLOCK.mesh).K}, "complex.*grow.*Sibling"),
    "full mass": (lambda: {"M": THROWN_BLOCK.K}, "not diagonal"),
    "no mass": (lambda: {"M": 0.0 * THROWN_BLOCK.M}, "not positive"),
    "uneven mass": (lambda: {"M": mass_with_unequal_components()}, "components differ"),
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
    "infinite load": (
        lambda: {"load": THROWN_BLOCK.uniform_vector((np.inf, 0.0))},
        "load.*not finite",
    ),
    "condensation": (
        lambda: {"reduction": replace(THROWN_BLOCK.no_supports, inner_flexibility=THROWN_BLOCK.K)},
        "no condensation",
    ),
    "matching": (
        lambda: {"pairs": ContactPair(on_plane(1, 0.0), MatchingNodes(on_plane(1, 1.0), FLOOR))},
        "impact of two bodies is not supported",
    ),
    "inside": (
        lambda: {"displacement": THROWN_BLOCK.uniform_vector((0.0, -0.1))},
        "let it start 0.1 farther away",
    ),
    "driven in": (lambda: {"paths": lambda _: (0.0, 0.1)}, "would be shot out"),
    "velocity": (
        lambda: {"velocity": THROWN_BLOCK.uniform_vector((np.nan, 0.0))},
        "velocity is not finite",
    ),
}


@pytest.mark.parametrize("name", INVALID_CHANGES_AND_MESSAGES)
def test_invalid_impacts_are_refused(name):
    make_changes, message = INVALID_CHANGES_AND_MESSAGES[name]
    with pytest.raises((TypeError, ValueError), match=message):
        solve_impact_with_changes(**make_changes())


def test_a_critical_step_needs_a_diagonal_mass():
    with pytest.raises(ValueError, match="not diagonal"):
        critical_step(
            THROWN_BLOCK.standard_stiffness,
            assemble_matrix(THROWN_BLOCK.body.mass()),
            THROWN_BLOCK.make_supports(),
        )


# -- checks of the result ---------------------------------------------------------------------


def test_large_strains_of_frames_are_reported(caplog):
    with caplog.at_level("WARNING", "pw_elements.contact"):
        history = THROWN_BLOCK.solve_impact(0.4, (0.0, -3.0), frames=2)
    assert max(state.smallness.strain for state in history.frames) > 0.05
    assert "leaves the range of small displacements: largest strain" in caplog.text


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_stiffness_with_negative_eigenvalues_is_refused(sign):
    K = THROWN_BLOCK.K.copy()
    if sign < 0:
        K.scale(-1.0)
    else:  # a spring of negative stiffness between two nodes
        K.setValues([0, 40], [0, 40], 100 * np.array([[0.0, 1.0], [1.0, 0.0]]), addv=True)
        K.assemble()
    with pytest.raises(ValueError, match="not negative"):
        critical_step(K, THROWN_BLOCK.M, THROWN_BLOCK.no_supports)

"""States that break the law do not leave, whatever the iteration thinks of them."""

from dataclasses import replace

import numpy as np
import pytest

from pw_elements.contact import ContactFailed, ContactPair, Motion, NotFound, Plane
from pw_elements.contact.interface.sliding import LinearisedMortar, SlidingMortar
from pw_elements.contact.iteration import Increment
from pw_elements.contact.nodes import DeformedKinematics, UndeformedKinematics
from pw_elements.contact.steps.verification import (
    ReferenceSizes,
    measure_residuals,
    measure_undeformed,
)
from pw_elements.meshes import triangles
from tests.contact.cases import BlockOnFloor, GrecoPlate, PunchedBlock, on_plane
from tests.contact.sliding import DIE_PATH, iterate_along_path, make_die_on_block, slide_along_path
from tests.contact.test_large import RubberUnderCircle
from tests.contact.test_refusals import SELF, StatedProblem, floor_pair, make_block
from tests.contact.test_turning import ROLLER_MOTIONS, make_roller

TOLERANCE = 1e-9


def at_large_strains():
    return roller_states(make_roller())


def roller_states(rubber):
    states = [rubber.problem.undeformed]
    for motion in ROLLER_MOTIONS:
        states.append(rubber.problem.step(states[-1], motions=motion))
    return states[1:]


def slid_bodies():
    return list(iterate_along_path(make_die_on_block(friction=0.3), DIE_PATH))


HISTORIES = {
    "block": lambda: BlockOnFloor(8).solve(0.3, 20.0, 3),
    "punch": lambda: PunchedBlock().solve(0.3, [Motion((0.0, -0.02)), Motion((0.01, -0.02))]),
    "friction one": lambda: [GrecoPlate(8).solve(1.0)],
    "large strains": at_large_strains,
    "two bodies": slid_bodies,
}


@pytest.mark.parametrize("name", HISTORIES)
def test_residuals_stay_within_tolerance_and_allowance(name):
    for state in HISTORIES[name]():
        for condition, value in vars(state.residuals).items():
            assert value <= TOLERANCE + getattr(state.allowance, condition)
        assert 0 < state.allowance.largest() < 1e-8


@pytest.mark.parametrize("name", HISTORIES)
def test_state_that_the_iteration_takes_too_early_is_refused(name, monkeypatch):
    """The first iterate of every increment passes for a solution, which it mostly is not."""
    monkeypatch.setattr(Increment, "violation", lambda *_: 0.0)
    with pytest.raises(NotFound, match=r"violates .*, computed anew from its displacements"):
        HISTORIES[name]()


def halved_slip(kinematics):
    return replace(kinematics, slip=0.5 * kinematics.slip)


WRONG = {
    "slip": halved_slip,
    "gap": lambda kinematics: replace(kinematics, gap=kinematics.gap + 1e-3),
    "normal": lambda kinematics: replace(kinematics, frame=kinematics.frame @ turned_by(1e-3)),
}


def turned_by(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


@pytest.mark.parametrize("wrong", WRONG)
def test_kinematics_that_are_wrong_lead_to_no_state(wrong, monkeypatch):
    """Gap, slip and normal of the iteration are off, consistently."""
    linearise, change = DeformedKinematics.linearise, WRONG[wrong]
    monkeypatch.setattr(DeformedKinematics, "linearise", lambda *a: change(linearise(*a)))
    with pytest.raises(ContactFailed, match=r"computed anew|active set|singular"):
        at_large_strains()


@pytest.mark.parametrize("wrong", ["gap", "normal"])
def test_kinematics_of_small_displacements_that_are_wrong_lead_to_no_state(wrong, monkeypatch):
    linearise, change = UndeformedKinematics.linearise, WRONG[wrong]
    monkeypatch.setattr(UndeformedKinematics, "linearise", lambda *a: change(linearise(*a)))
    with pytest.raises(NotFound, match="computed anew"):
        HISTORIES["punch"]()


WRONG_KERNELS = {
    "gap": lambda met: replace(met, mean_distance=met.mean_distance + 1e-4 * met.normals),
    "normal": lambda met: replace(met, normals=met.normals @ turned_by(1e-3).T),
    "fractions": lambda met: replace(
        met,
        master_fractions=1.001 * met.master_fractions,
        differentiate_master_forces=lambda r: 1.001 * met.differentiate_master_forces(r),
    ),
}


@pytest.mark.parametrize("wrong", [*WRONG_KERNELS, "slip"])
def test_kernels_of_two_bodies_that_are_wrong_lead_to_no_state(wrong, monkeypatch):
    """Checks measure gap, normal, slip and forces on the master by code of their own."""
    bodies = make_die_on_block(friction=0.3)
    seen, moved = SlidingMortar.linearise, LinearisedMortar.measure_slip_and_rates
    if wrong == "slip":

        def slip_too_far(met, *arguments):
            slip, derivatives = moved(met, *arguments)
            return slip + 1e-4 * met.faced, derivatives

        monkeypatch.setattr(LinearisedMortar, "measure_slip_and_rates", slip_too_far)
    else:
        monkeypatch.setattr(SlidingMortar, "linearise", lambda *a: WRONG_KERNELS[wrong](seen(*a)))
    with pytest.raises(NotFound, match="computed anew"):
        slide_along_path(bodies, DIE_PATH[:2])


def test_residual_of_the_wrong_sign_is_refused_at_once():
    rubber = RubberUnderCircle()
    rubber.residual = -rubber.residual
    with pytest.raises(ValueError, match=r"negative mean stiffness, -.* wrong; give -F"):
        rubber.problem_with()
    body = make_block()
    body.K.scale(-1.0)
    with pytest.raises(ValueError, match=r"negative mean stiffness, -.* wrong; give -K"):
        body.solve(floor_pair(), (0.0, -1.0))


def test_residuals_are_those_of_plain_arithmetic():
    """A solution is disturbed: nothing of the iteration knows of it."""
    body, mu = StatedProblem(triangles(SELF, (0.0, 0.0), (2.0, 1.0), (4, 2))), 0.3
    problem = body.contact_problem(ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), mu))
    load = body.body_force_load((0.1, -1.0))
    state = problem.step(problem.undeformed, load)
    rng, a = np.random.default_rng(0), state.unknowns.copy()
    a.setArray(a.array_r + np.abs(a.array_r).max() * rng.normal(size=a.getLocalSize()))
    wrong, stepping = replace(state, unknowns=a), problem._stepping
    unbalanced = body.K * a - load
    interface = stepping.interface
    found, _ = measure_residuals(
        wrong,
        measure_undeformed(interface, problem.undeformed, wrong, 0.0),
        unbalanced,
        interface,
        body.make_supports(),
        ReferenceSizes(2.0, 0.5, np.ones(len(interface.pair)), 0.0),
        np.empty(0),
    )
    below = np.isclose(body.x[:, 1], 0.0)
    r, u = unbalanced.array_r.reshape(-1, 2), a.array_r.reshape(-1, 2)
    r_t, r_n = r[below].T
    v, g = u[below].T
    slipped = np.minimum((mu * np.maximum(0, r_n) - np.abs(r_t)) / 2, np.abs(v) / 0.5)
    known = {
        "equilibrium": np.abs(r[~below]) / 2,
        "penetration": -g / 0.5,
        "tension": -r_n / 2,
        "complementarity": np.minimum(r_n / 2, g / 0.5),
        "cone": (np.abs(r_t) - mu * np.maximum(0, r_n)) / 2,
        "stick": slipped,
        "direction": np.abs(np.abs(v) * r_t + mu * np.maximum(0, r_n) * v) / (2 * 0.5),
    }
    for name, values in known.items():
        assert getattr(found, name) == pytest.approx(values.max(initial=0.0), rel=1e-9), name
        assert values.max() > 1e-7, name


@pytest.mark.parametrize("angle", [2.0, 5.0, 2 * np.pi, 4 * np.pi])
def test_a_tool_that_turns_in_one_increment_rubs_all_the_way(angle):
    """The pressed circle slips against its turn, so that friction drags the body along with it."""
    rubber = make_roller(pivot=(0.0, 0.6))
    down = (0.0, -0.15)
    pressed = rubber.problem.step(rubber.problem.undeformed, motions=Motion(down))
    once, whole = (
        rubber.problem.step(pressed, motions=Motion(down, rotation=a)) for a in (1.0, angle)
    )
    assert whole.pairs[0].force[0] == pytest.approx(once.pairs[0].force[0], rel=1e-9)
    assert abs(once.pairs[0].force[0]) > 0.05

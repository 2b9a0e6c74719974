"""States that violate the contact law are refused, even if the iteration accepts them."""

from dataclasses import replace

import numpy as np
import pytest

from pw_elements.contact import ContactFailed, ContactPair, Motion, Plane, SolutionNotFound
from pw_elements.contact.interface.mortars.sliding import LinearisedMortar, SlidingMortar
from pw_elements.contact.iteration import IncrementEquations
from pw_elements.contact.nodes import LargeStrainKinematics, SmallStrainKinematics
from pw_elements.contact.steps.verification import (
    VerificationScales,
    measure_residuals_and_allowances,
    measure_small_strain_kinematics,
)
from pw_elements.meshes import triangles
from tests.contact.cases import (
    BlockOnFloor,
    GrecoFrictionBenchmark,
    PunchedBlock,
    on_plane,
    rotation_matrix,
)
from tests.contact.sliding import (
    DIE_TOP_TRANSLATIONS,
    make_die_on_block,
    slide_along_path,
    yield_states_along_path,
)
from tests.contact.test_large import RubberUnderCircle
from tests.contact.test_refusals import SELF_COMM, BodyWithSupports, floor_pair, make_block
from tests.contact.test_turning import ROLLER_MOTIONS, make_rubber_under_roller

RELATIVE_RESIDUAL_TOLERANCE = 1e-9


def solve_roller():
    """Return the states of a circle that is pressed on rubber, slid along it, and rotated."""
    return step_through_roller_motions(make_rubber_under_roller())


def step_through_roller_motions(rubber):
    states = [rubber.problem.undeformed]
    for motion in ROLLER_MOTIONS:
        states.append(rubber.problem.step(states[-1], motions=motion))
    return states[1:]


def slide_die_along_path():
    return list(yield_states_along_path(make_die_on_block(friction=0.3), DIE_TOP_TRANSLATIONS))


HISTORY_SOLVERS_BY_NAME = {
    "block": lambda: BlockOnFloor(8).solve(0.3, 20.0, 3),
    "punch": lambda: PunchedBlock().solve(0.3, [Motion((0.0, -0.02)), Motion((0.01, -0.02))]),
    "friction one": lambda: [GrecoFrictionBenchmark(8).solve(1.0)],
    "large strains": solve_roller,
    "two bodies": slide_die_along_path,
}


@pytest.mark.parametrize("name", HISTORY_SOLVERS_BY_NAME)
def test_residuals_stay_within_tolerance_and_allowance(name):
    for state in HISTORY_SOLVERS_BY_NAME[name]():
        for condition, value in vars(state.residuals).items():
            assert value <= RELATIVE_RESIDUAL_TOLERANCE + getattr(state.allowance, condition)
        assert 0 < state.allowance.largest() < 1e-8


@pytest.mark.parametrize("name", HISTORY_SOLVERS_BY_NAME)
def test_a_state_that_the_iteration_accepts_too_early_is_refused(name, monkeypatch):
    """A state that the iteration accepts too early is refused.

    The iteration is changed to accept the first iterate of every increment as its solution. Most of
    these iterates do not obey the contact law.
    """
    monkeypatch.setattr(IncrementEquations, "max_residual_to_tolerance_ratio", lambda *_: 0.0)
    with pytest.raises(
        SolutionNotFound, match=r"violates .*, computed anew from its displacements"
    ):
        HISTORY_SOLVERS_BY_NAME[name]()


def halve_slip(kinematics):
    return replace(kinematics, slip=0.5 * kinematics.slip)


CORRUPTIONS_OF_KINEMATICS = {
    "slip": halve_slip,
    "gap": lambda kinematics: replace(kinematics, gap=kinematics.gap + 1e-3),
    "normal": lambda kinematics: replace(
        kinematics, frame=kinematics.frame @ rotation_matrix(1e-3)
    ),
}


@pytest.mark.parametrize("wrong", CORRUPTIONS_OF_KINEMATICS)
def test_wrong_kinematics_lead_to_no_state(wrong, monkeypatch):
    """No state is returned if the iteration computes wrong gaps, slips or normals.

    Either the iteration fails, or the verification refuses the state to which it converges.
    """
    linearise, change = LargeStrainKinematics.linearise, CORRUPTIONS_OF_KINEMATICS[wrong]
    monkeypatch.setattr(LargeStrainKinematics, "linearise", lambda *a: change(linearise(*a)))
    with pytest.raises(ContactFailed, match=r"computed anew|active set|singular"):
        solve_roller()


@pytest.mark.parametrize("wrong", ["gap", "normal"])
def test_wrong_kinematics_of_small_displacements_lead_to_no_state(wrong, monkeypatch):
    linearise, change = SmallStrainKinematics.linearise, CORRUPTIONS_OF_KINEMATICS[wrong]
    monkeypatch.setattr(SmallStrainKinematics, "linearise", lambda *a: change(linearise(*a)))
    with pytest.raises(SolutionNotFound, match="computed anew"):
        HISTORY_SOLVERS_BY_NAME["punch"]()


CORRUPTIONS_OF_LINEARISED_MORTAR = {
    "gap": lambda met: replace(met, mean_distance=met.mean_distance + 1e-4 * met.normals),
    "normal": lambda met: replace(
        met,
        directions=replace(met.directions, normals=met.normals @ rotation_matrix(1e-3).T),
    ),
    "fractions": lambda met: replace(
        met,
        master_fractions=1.001 * met.master_fractions,
        differentiate_master_forces=lambda r: 1.001 * met.differentiate_master_forces(r),
    ),
}


@pytest.mark.parametrize("wrong", [*CORRUPTIONS_OF_LINEARISED_MORTAR, "slip"])
def test_wrong_mortar_integrals_lead_to_no_state(wrong, monkeypatch):
    """No state is returned if the mortar integrals of the iteration are wrong.

    The verification refuses it, because it computes gap, normal, slip and forces on the master by
    independent code.
    """
    bodies = make_die_on_block(friction=0.3)
    meet, motions = (
        SlidingMortar.linearise,
        LinearisedMortar.measure_slip_and_motion_derivatives,
    )
    if wrong == "slip":

        def measure_slip_with_error(projected, *arguments):
            slip, derivatives = motions(projected, *arguments)
            return slip + 1e-4 * projected.faces_master[:, None], derivatives

        monkeypatch.setattr(
            LinearisedMortar, "measure_slip_and_motion_derivatives", measure_slip_with_error
        )
    else:
        monkeypatch.setattr(
            SlidingMortar, "linearise", lambda *a: CORRUPTIONS_OF_LINEARISED_MORTAR[wrong](meet(*a))
        )
    with pytest.raises(SolutionNotFound, match="computed anew"):
        slide_along_path(bodies, DIE_TOP_TRANSLATIONS[:2])


def test_a_residual_of_the_wrong_sign_is_refused_at_once():
    rubber = RubberUnderCircle()
    rubber.residual = -rubber.residual
    with pytest.raises(ValueError, match=r"negative mean stiffness, -.* wrong; give -F"):
        rubber.problem_with()
    body = make_block()
    body.K.scale(-1.0)
    with pytest.raises(ValueError, match=r"negative mean stiffness, -.* wrong; give -K"):
        body.solve(floor_pair(), (0.0, -1.0))


def test_residuals_agree_with_plain_arithmetic():
    """The residuals of a state agree with residuals computed by plain arithmetic.

    The state is a randomly disturbed solution; its residuals are therefore not small.
    """
    body, mu = BodyWithSupports(triangles(SELF_COMM, (0.0, 0.0), (2.0, 1.0), (4, 2))), 0.3
    problem = body.contact_problem(ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), mu))
    load = body.body_force_load((0.1, -1.0))
    state = problem.step(problem.undeformed, load)
    rng, unknowns = np.random.default_rng(0), state.unknowns.copy()
    unknowns.setArray(
        unknowns.array_r + np.abs(unknowns.array_r).max() * rng.normal(size=unknowns.getLocalSize())
    )
    disturbed_state, stepping = replace(state, unknowns=unknowns), problem._small_strain_stepping
    unbalanced = body.K * unknowns - load
    interface = stepping.interface
    residuals, _ = measure_residuals_and_allowances(
        disturbed_state,
        measure_small_strain_kinematics(interface, problem.undeformed, disturbed_state, 0.0),
        unbalanced,
        interface,
        reduction=body.make_supports(),
        scales=VerificationScales(2.0, 0.5, np.ones(len(interface.pair)), 0.0),
        free_motion_forces=np.empty(0),
    )
    is_contact_node = np.isclose(body.x[:, 1], 0.0)
    r, u = unbalanced.array_r.reshape(-1, 2), unknowns.array_r.reshape(-1, 2)
    r_t, r_n = r[is_contact_node].T
    sliding, g = u[is_contact_node].T
    stick_violation = np.minimum((mu * np.maximum(0, r_n) - np.abs(r_t)) / 2, np.abs(sliding) / 0.5)
    expected = {
        "equilibrium": np.abs(r[~is_contact_node]) / 2,
        "penetration": -g / 0.5,
        "tension": -r_n / 2,
        "complementarity": np.minimum(r_n / 2, g / 0.5),
        "cone": (np.abs(r_t) - mu * np.maximum(0, r_n)) / 2,
        "stick": stick_violation,
        "direction": np.abs(np.abs(sliding) * r_t + mu * np.maximum(0, r_n) * sliding) / (2 * 0.5),
    }
    for name, values in expected.items():
        assert getattr(residuals, name) == pytest.approx(values.max(initial=0.0), rel=1e-9), name
        assert values.max() > 1e-7, name


@pytest.mark.parametrize("angle", [2.0, 5.0, 2 * np.pi, 4 * np.pi])
def test_a_tool_that_rotates_in_one_increment_slips_all_the_way(angle):
    """A tool that rotates in one increment slips during the whole rotation.

    The friction force, by which the pressed circle drags the body along, is the same as after a
    rotation by only 1 rad.
    """
    rubber = make_rubber_under_roller(pivot=(0.0, 0.6))
    translation = (0.0, -0.15)
    pressed_state = rubber.problem.step(rubber.problem.undeformed, motions=Motion(translation))
    short_state, end_state = (
        rubber.problem.step(pressed_state, motions=Motion(translation, rotation=rotation))
        for rotation in (1.0, angle)
    )
    assert end_state.pairs[0].force[0] == pytest.approx(short_state.pairs[0].force[0], rel=1e-9)
    assert abs(short_state.pairs[0].force[0]) > 0.05

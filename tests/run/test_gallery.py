"""The examples run unchanged except for coarse meshes; their pictures and numbers are right.

`python3 -m tests.run.test_gallery FOLDER` draws the pictures of the gallery.
"""

import re
import sys
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from pw_elements.contact import OPEN, SLIP
from tests.run.test_tutorial import run_program

EXAMPLES_FOLDER = Path(__file__).parents[2] / "examples"
EXAMPLE_NAMES = sorted(
    path.stem for path in EXAMPLES_FOLDER.glob("*.py") if not path.stem.endswith("_mesh")
)
MAX_EXAMPLE_CODE_LINES = 60  # without the docstring and empty lines
# Replacements of the line that sets the mesh size, by example
COARSE_MESH_SETTINGS = {
    "bracket": "size = 12.0",
    "buckling": "cells = 1",
    "driven_wheel": "cells = 4",
    "gears": "size = 0.5",
    "heated_joint": "cells, side = 6, 20.0",
    "identify": "cells, nu = 4, 0.45",
    "poisson": "cells = 8",
    "indentation_hardness": "cells = 14",
    "press_fit": "size = 3.0",
    "relaxing_seal": "cells = 5",
    "roller_on_dome": "size, zone = 0.25, 1.6",
    "rubber_punch": "cells = 4",
    "rubber_roller": "cells = 3",
    "seal": "cells = 8",
    "shaft_seal": "cells = 6",
    "seepage": "size, permeability, head = 3.0, 1e-5, 6.0",
    "snap_fit": "size = 0.4",
    "sphere_on_block": "size, side = 0.3, 4.0",
    "tuning_fork": "size = 8.0",
    "worn_pin": "size = 0.4",
}


def run_example_source(name, folder, is_coarse=True):
    """Run an example in a folder, and return its global variables and its output.

    The result is that of `run_program`. The mesh is coarse unless `is_coarse` is False.
    """
    code = (EXAMPLES_FOLDER / f"{name}.py").read_text()
    if is_coarse and name in COARSE_MESH_SETTINGS:
        setting = COARSE_MESH_SETTINGS[name].partition(" = ")[0]
        line = rf"^{re.escape(setting)} = [^#\n]*"
        code, count = re.subn(
            line, COARSE_MESH_SETTINGS[name] + "  ", code, count=1, flags=re.MULTILINE
        )
        assert count == 1, f"{name} states no {setting}"
    code = code.replace("Path(__file__)", f"Path({str(EXAMPLES_FOLDER / name)!r})")
    with patch.object(sys, "path", [str(EXAMPLES_FOLDER), *sys.path]):
        return run_program(code, folder / f"{name}.py")


@pytest.fixture
def run_example(tmp_path):
    """Return a function that runs an example and checks that it draws its picture."""

    def run_example_and_check_picture(name):
        """Run an example, check that its picture is not empty, and return its global variables."""
        names = run_example_source(name, tmp_path)
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
        return names

    return run_example_and_check_picture


def test_examples_are_short_and_each_is_tested():
    assert len(EXAMPLE_NAMES) >= 12
    tests = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    for name in EXAMPLE_NAMES:
        assert any(f"{test}_".startswith(f"{name}_") for test in tests), name
        code = (EXAMPLES_FOLDER / f"{name}.py").read_text().split('"""', 2)[2]
        count = sum(bool(line.strip()) for line in code.splitlines())
        assert 20 <= count <= MAX_EXAMPLE_CODE_LINES, f"{name} has {count} lines"


def test_plate_with_hole_has_howlands_stress_factor(run_example):
    """The stress concentration at a hole is close to Howland's factor.

    This factor is 3.14, relative to the gross stress, if the diameter of the hole is a fifth of the
    plate's width.
    """
    names = run_example("plate_with_hole")
    assert names["stress"][0] / names["pull"] == pytest.approx(3.14, rel=0.04)
    carried = names["cut"].reaction[:, 1].sum()
    assert carried == pytest.approx(-names["pull"] * names["half_width"] * names["thickness"])


def test_falling_friction_follows_its_law(run_example):
    """The ratios of friction to pressure in the example equal those of its friction law.

    Since the stress is uniform, they follow from the pressures alone.
    """
    names = run_example("falling_friction")
    exact = names["mu"] / (1 + names["pressures"] / names["p_0"])
    for ratio in names["found"].values():
        assert ratio == pytest.approx(exact, rel=1e-8)


def test_poisson_heat_is_even_in_the_new_element_only(run_example):
    """Both elements give the total heat of a side, but only the new one distributes it evenly."""
    names = run_example("poisson")
    spaces_by_method, below = names["ways"], names["below"]
    heats = {
        name: names["heat_at"](below, spaces)[1].reaction
        for name, spaces in spaces_by_method.items()
    }
    zigzag = {name: np.abs(np.diff(heat, 2)).max() for name, heat in heats.items()}
    assert zigzag["standard"] > 5 * zigzag["piecewise linear"]
    totals = [heat.sum() for heat in heats.values()]
    assert totals[0] == pytest.approx(totals[1], rel=0.03)


def test_buckling_load_is_between_two_euler_loads(run_example):
    """The buckling load of a portal lies between two of Euler's loads.

    The portal sways on fixed feet. The loads are those of columns with a fixed end and either a
    free or a guided end.
    """
    names = run_example("buckling")
    inertia = 0.1 * names["column"] ** 3 / 12
    euler = np.pi**2 * 210e9 * inertia / (names["height"] - names["beam"]) ** 2
    sway = names["modes"].factors[0] * names["load"] / 2
    assert euler / 4 < sway < euler
    assert sway == pytest.approx(euler, rel=0.15)


def test_rubber_punch_force_exceeds_a_lower_bound(run_example):
    names = run_example("rubber_punch")
    heights = names["mesh"].geometry.x[:, 1].max()
    assert names["forces"].force[:, 1].sum() < -2 * names["mu"] * names["depth"] * heights
    assert "force of the punch" in names["printed"]


def test_rubber_roller_drives_below_friction_limit(run_example):
    """The driving force of the rubber roller is below the friction limit.

    The width of the contact is about that of a chord of the roller's circle at the same depth.
    """
    names = run_example("rubber_roller")
    force, depth = names["pair"].force, names["depth"]
    assert 0 < force[0] < names["friction"] * force[1]
    assert np.ptp(names["x"]) == pytest.approx(2 * np.sqrt(2 * depth - depth**2), rel=0.4)
    assert names["pressure"][names["closed"]].min() > 0


def test_driven_wheel_has_the_prescribed_torques(run_example):
    """The torques of the wheel equal the prescribed torques.

    At the end, they are as large as the friction law admits.
    """
    names = run_example("driven_wheel")
    prescribed_torques = np.linspace(0.15, 0.9, 6) * names["friction"] * names["load"] * names["R"]
    assert names["torques"][1:7] == pytest.approx(prescribed_torques, rel=1e-8)
    assert np.all(np.diff(names["angles"]) > 0)
    assert np.all(names["torques"][:7] < 0.99 * names["limits"][:7])
    assert names["torques"][-2:] == pytest.approx(names["limits"][-2:], rel=1e-9)
    assert names["pair"].force[1] == pytest.approx(-names["load"], rel=1e-8)


def test_identify_recovers_the_true_parameters(run_example):
    """The true parameters are identified from a record, up to its noise and the mesh's error."""
    names = run_example("identify")
    fit, spread = names["fit"], names["spread"]
    assert fit.success
    assert fit.nfev < 12
    assert np.all(np.abs(fit.x - names["truth"]) < 3 * spread + 0.02 * np.array(names["truth"]))
    assert np.all(spread < 0.06 * np.array(names["truth"]))


def test_snap_fit_snaps_forwards_behind_the_catch(run_example):
    """The catch lifts and holds back the clip on its slope, and pushes it forwards behind it."""
    names = run_example("snap_fit")
    against_push, upwards = -names["forces"][:, 0], names["forces"][:, 2]
    assert upwards[0] == pytest.approx(0.0, abs=1e-9 * upwards.max())
    climbing = slice(2, int(upwards.argmax()))
    # the slope of both bumps is at most 26 degrees, and friction adds 11 degrees
    assert np.all(against_push[climbing] > 0.2 * upwards[climbing])
    assert np.all(against_push < np.tan(np.radians(26.2 + 11.4)) * upwards.max())
    assert against_push.min() < 0
    balance = [state.pairs[0].opposite_force.sum(axis=0) for state in names["states"][1:]]
    assert np.abs(names["forces"] + balance).max() < 1e-10 * upwards.max()


def test_shaft_seal_resistance_grows_at_the_shoulder(run_example):
    """The friction of the lip obeys Coulomb's law; at the shoulder its resistance is larger."""
    forces = run_example("shaft_seal")["forces"]
    friction_ratio, normal = -forces[:, 0] / forces[:, 1], forces[:, 1]
    assert friction_ratio[3] == pytest.approx(0.3, rel=0.03)  # before the shoulder
    assert friction_ratio.max() > 0.4
    assert friction_ratio[-1] == pytest.approx(0.3, rel=0.03)
    assert normal[-1] > 1.5 * normal[0]


def test_seal_force_equals_lindleys_formula(run_example):
    """The force on the seal is that of Lindley's empirical formula for long cords."""
    names = run_example("seal")
    squeeze, modulus, diameter = names["squeeze"], 3 * names["mu"], 2.0
    lindley = modulus * diameter * (1.25 * squeeze**1.5 + 50 * squeeze**6)
    assert names["force"] / (2 * np.pi * names["ring"]) == pytest.approx(lindley, rel=0.05)
    assert names["held"].sum() > 12
    assert names["push"][names["held"]].min() > 0


def test_relaxing_seal_force_decays_with_the_relaxation_time(run_example):
    """Held forces differ from their limit by a multiple of exp(-t / tau), as for a fixed shape."""
    names = run_example("relaxing_seal")
    times, forces = names["times"], np.array(names["forces"])
    held = slice(np.flatnonzero(times == 5.0)[0], None)
    assert forces.argmax() == held.start
    decay = np.exp(-times[held] / names["tau"])
    amplitudes = np.diff(forces[held]) / np.diff(decay)
    assert amplitudes == pytest.approx(amplitudes[0], rel=0.02)
    limit = forces[-1] - amplitudes[-1] * decay[-1]
    stiffest = 1 + names["branch_modulus"] / names["slow"]
    assert 1.8 * limit < forces.max() < stiffest * limit


def test_indentation_hardness_is_a_multiple_of_the_yield_stress(run_example):
    """The mean pressure is Tabor's, and the first unloading has the slope of an elastic punch."""
    names = run_example("indentation_hardness")
    forces, depths, pair = np.array(names["forces"]), np.array(names["depths"]), names["pair"]
    assert np.all(np.diff(forces[:9]) > 0)
    assert np.mean(names["pressures"][4:8]) / names["limit"] == pytest.approx(2.8, rel=0.1)
    contact_radius = np.sqrt(1e3 * forces[8] / (np.pi * names["pressures"][7]))
    slope = 1e3 * (forces[8] - forces[9]) / (depths[7] - depths[8])
    plane_strain_modulus = names["E"] / (1 - names["nu"] ** 2)
    assert slope == pytest.approx(2 * plane_strain_modulus * contact_radius, rel=0.15)
    assert np.all(pair.status == OPEN)
    assert -0.08 < pair.displacement[:, 1].min() < -0.07


def test_seepage_inflow_equals_outflow(run_example):
    """Inflow equals outflow, and there is less seepage than without the pile."""
    names = run_example("seepage")
    all_reactions = names["reactions"](names["K"], names["a"], names["f"])
    assert abs(all_reactions.sum()) < 1e-9 * np.abs(all_reactions.array).sum()
    assert 0 < names["litres"] < 3.6e6 * names["permeability"] * names["head"]


def test_roller_on_dome_has_the_contact_width_of_hertz(run_example):
    names = run_example("roller_on_dome")
    contact = names["state"].pairs[0]
    assert contact.force == pytest.approx([names["push"], -names["press"]], rel=1e-9)
    assert np.count_nonzero(contact.status == SLIP) > 2
    R = 1 / (1 / names["dome"] + 1 / names["roller_radius"])
    half_width = np.sqrt(4 * names["press"] * R * (1 - 0.4**2) / (np.pi * 3000))
    closed = contact.position[contact.status != OPEN, 0]
    assert np.ptp(closed) == pytest.approx(2 * half_width, abs=2 * names["size"])


def test_press_fit_pressure_equals_lames_between_holes(run_example):
    """The pressure between the holes is close to Lamé's, and beside a hole it is far lower."""
    names = run_example("press_fit")
    assert names["pressure"].max() == pytest.approx(names["lame"], rel=0.1)
    assert names["pressure"].min() < 0.3 * names["lame"]


def test_heated_joint_is_in_equilibrium_and_loses_no_heat(run_example):
    """The pressures carry the load, and the steel takes the heat that the aluminium gives.

    The cold contact is uniform. The flow of heat is between those of a perfect joint and of one
    that conducts through its air alone.
    """
    names = run_example("heated_joint")
    side, load = names["side"], names["load"]
    assert names["pressures"][0] == pytest.approx(load, rel=1e-9)
    assert np.ptp(names["pressures"][-1]) > load / 4
    assert names["contact"].force_normal.sum() == pytest.approx(load * side, rel=1e-9)
    a, joint = names["a"], names["joint"]
    flow_through_joint = joint * a
    given = flow_through_joint.array[flow_through_joint.array > 0].sum()
    assert flow_through_joint.sum() == pytest.approx(0.0, abs=1e-9 * given)
    resistances = side / 0.2 + side / 0.05
    bounds = [side * (names["hot"] - names["cold"]) / (resistances + r) for r in (1 / 2.6e-3, 0)]
    assert bounds[0] < given < bounds[1]
    assert f"{len(names['pressures'])} turns" in names["printed"]


def test_worn_pin_loses_archards_volume_and_becomes_flat(run_example):
    """The worn volume is the coefficient times force times path; the pressure becomes even."""
    names = run_example("worn_pin")
    path = names["slip"] * names["increments"]
    assert names["volume"] == pytest.approx(names["wear"] * names["force"] * path, rel=1e-2)
    pressure = names["surface"].pressure(names["states"][-1].pairs[0].force_normal)
    middle = np.abs(names["x"]) < names["flat"] / 2
    even_pressure = names["force"] / (2 * names["flat"])
    assert pressure[middle] == pytest.approx(even_pressure, rel=0.1)
    assert f"{names['volume']:.4f} mm³/mm" in names["printed"]


def test_bar_impact_has_expected_force_and_keeps_energy(run_example):
    names = run_example("bar_impact")
    assert np.median(names["force"][names["force"] > 0.2 * names["expected"]]) == pytest.approx(
        names["expected"], rel=0.03
    )
    assert names["history"].energies.imbalance < 1e-9


def test_tuning_fork_tone_is_below_that_of_a_cantilever(run_example):
    """The tone of the fork is slightly lower than that of one prong as a clamped cantilever."""
    names = run_example("tuning_fork")
    frequency_factor = 1.8751**2 / (2 * np.pi) * names["thick"] / np.sqrt(12) / names["prong"] ** 2
    clamped = frequency_factor * np.sqrt(206e3 / 7.85e-9)
    assert 0.75 * clamped < names["tones"][2] < clamped


def test_gasket_carries_bolt_force_minus_thrust(run_example):
    """The gasket carries the bolt force first, and under pressure this force minus the thrust."""
    names = run_example("gasket")
    bolted, pressed = (state.pairs[0].force[1] for state in names["states"])
    assert bolted == pytest.approx(-names["bolts"], rel=1e-6)
    thrust = names["pressure"] * np.pi * 56**2  # up to the inner radius of the gasket
    assert pressed == pytest.approx(-names["bolts"] + thrust, rel=1e-3)


def test_gears_transmit_force_along_line_of_action(run_example):
    """Apart from friction, the force between the gears acts along the line of action.

    Friction is at most a tenth of the normal force.
    """
    names = run_example("gears")
    contact = names["state"].pairs[0]
    force = contact.force
    angle = np.arctan2(abs(force[0]), abs(force[1]))
    assert abs(angle - np.radians(20)) < np.arctan(0.1) + 0.01
    opposite = contact.opposite_force.sum(axis=0)
    assert opposite == pytest.approx(-force, rel=1e-9)


def test_sphere_on_block_has_peak_pressure_of_hertz(run_example):
    names = run_example("sphere_on_block")
    assert np.nanmax(names["pressure"]) == pytest.approx(names["peak"], rel=0.06)
    assert names["state"].pairs[0].force[2] == pytest.approx(-names["force"] / 4, rel=1e-6)


def test_bracket_foot_carries_pull_and_bolt_force(run_example):
    names = run_example("bracket")
    foot = names["foot"]
    assert foot.force == pytest.approx([-names["pull"], 0, names["bolt"]], rel=0.1, abs=20)
    assert 5 < names["closed"] < 95


if __name__ == "__main__":
    for example_name in EXAMPLE_NAMES:
        run_example_source(example_name, Path(sys.argv[1]), is_coarse=False)

"""The examples, each on a coarse mesh, as they stand: what they print and draw, and its mechanics.

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

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py") if not path.stem.endswith("_mesh"))
LINES = 60  # of code, at most
# what makes meshes of the examples coarse
COARSE = {
    "bracket": "size = 12.0",
    "buckling": "cells = 1",
    "driven_wheel": "cells = 4",
    "gears": "size = 0.5",
    "identify": "cells, nu = 4, 0.45",
    "poisson": "cells = 8",
    "press_fit": "size = 3.0",
    "roller_on_dome": "size, zone = 0.25, 1.6",
    "rubber_punch": "cells = 4",
    "rubber_roller": "cells = 3",
    "seal": "cells = 8",
    "shaft_seal": "cells = 6",
    "seepage": "size, permeability, head = 3.0, 1e-5, 6.0",
    "sphere_on_block": "size, side = 0.3, 4.0",
    "tuning_fork": "size = 8.0",
}


def run(name, folder, coarse=True):
    code = (EXAMPLES / f"{name}.py").read_text()
    if coarse and name in COARSE:
        stated = COARSE[name].partition(" = ")[0]
        line = rf"^{re.escape(stated)} = [^#\n]*"
        code, count = re.subn(line, COARSE[name] + "  ", code, count=1, flags=re.MULTILINE)
        assert count == 1, f"{name} states no {stated}"
    code = code.replace("Path(__file__)", f"Path({str(EXAMPLES / name)!r})")
    with patch.object(sys, "path", [str(EXAMPLES), *sys.path]):
        return run_program(code, folder / f"{name}.py")


@pytest.fixture
def example(tmp_path):
    def computed(name):
        found = run(name, tmp_path)
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
        return found

    return computed


def test_examples_are_short_and_each_is_tested():
    assert len(NAMES) >= 12
    tests = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    for name in NAMES:
        assert name in tests
        code = (EXAMPLES / f"{name}.py").read_text().split('"""', 2)[2]
        count = sum(bool(line.strip()) for line in code.splitlines())
        assert 20 <= count <= LINES, f"{name} has {count} lines"


def test_plate_with_hole(example):
    """Howland's factor for a hole of a fifth of the width is 3.14, over the gross stress."""
    found = example("plate_with_hole")
    assert found["stress"][0] / found["pull"] == pytest.approx(3.14, rel=0.04)
    carried = found["cut"].reaction[:, 1].sum()
    assert carried == pytest.approx(-found["pull"] * found["half_width"] * found["thickness"])


def test_falling_friction(example):
    """A uniform stress, in which the law alone says how large the friction is."""
    found = example("falling_friction")
    exact = found["mu"] / (1 + found["pressures"] / found["p_0"])
    for ratio in found["found"].values():
        assert ratio == pytest.approx(exact, rel=1e-8)


def test_poisson(example):
    """A side's heat, and that only the new element's is even."""
    found = example("poisson")
    ways, below = found["ways"], found["below"]
    heats = {name: found["heat_at"](below, spaces)[1].reaction for name, spaces in ways.items()}
    zigzag = {name: np.abs(np.diff(heat, 2)).max() for name, heat in heats.items()}
    assert zigzag["standard"] > 5 * zigzag["piecewise linear"]
    totals = [heat.sum() for heat in heats.values()]
    assert totals[0] == pytest.approx(totals[1], rel=0.03)


def test_buckling(example):
    """The sway of a portal with fixed feet lies between Euler's of fixed-free and fixed-guided."""
    found = example("buckling")
    inertia = 0.1 * found["column"] ** 3 / 12
    euler = np.pi**2 * 210e9 * inertia / (found["height"] - found["beam"]) ** 2
    sway = found["modes"].factors[0] * found["load"] / 2
    assert euler / 4 < sway < euler
    assert sway == pytest.approx(euler, rel=0.15)


def test_rubber_punch(example):
    found = example("rubber_punch")
    heights = found["mesh"].geometry.x[:, 1].max()
    assert found["forces"].force[:, 1].sum() < -2 * found["mu"] * found["depth"] * heights
    assert "force of the punch" in found["printed"]


def test_rubber_roller(example):
    """It drives, within friction, on about the width that a circle of this depth would cut."""
    found = example("rubber_roller")
    force, depth = found["pair"].force, found["depth"]
    assert 0 < force[0] < found["friction"] * force[1]
    assert np.ptp(found["x"]) == pytest.approx(2 * np.sqrt(2 * depth - depth**2), rel=0.4)
    assert found["pressure"][found["closed"]].min() > 0


def test_driven_wheel(example):
    """Given torques are found, and the law of friction alone says where they end."""
    found = example("driven_wheel")
    asked = np.linspace(0.15, 0.9, 6) * found["friction"] * found["load"] * found["R"]
    assert found["torques"][1:7] == pytest.approx(asked, rel=1e-8)
    assert np.all(np.diff(found["angles"]) > 0)
    assert np.all(found["torques"][:7] < 0.99 * found["limits"][:7])
    assert found["torques"][-2:] == pytest.approx(found["limits"][-2:], rel=1e-9)
    assert found["pair"].force[1] == pytest.approx(-found["load"], rel=1e-8)


def test_identify(example):
    """What the record was made with is found, up to its noise and a coarser mesh."""
    found = example("identify")
    fit, spread = found["fit"], found["spread"]
    assert fit.success
    assert fit.nfev < 12
    assert np.all(np.abs(fit.x - found["truth"]) < 3 * spread + 0.02 * np.array(found["truth"]))
    assert np.all(spread < 0.06 * np.array(found["truth"]))


def test_shaft_seal(example):
    """The lip slides on the shaft by Coulomb's law, and climbs its shoulder against more."""
    forces = example("shaft_seal")["forces"]
    across, normal = -forces[:, 0] / forces[:, 1], forces[:, 1]
    assert across[3] == pytest.approx(0.3, rel=0.03)  # not yet at the shoulder
    assert across.max() > 0.4
    assert across[-1] == pytest.approx(0.3, rel=0.03)
    assert normal[-1] > 1.5 * normal[0]


def test_seal(example):
    """Lindley's force for long cords, found by experiments, and no change of volume."""
    found = example("seal")
    squeeze, modulus, diameter = found["squeeze"], 3 * found["mu"], 2.0
    lindley = modulus * diameter * (1.25 * squeeze**1.5 + 50 * squeeze**6)
    assert found["force"] / (2 * np.pi * found["ring"]) == pytest.approx(lindley, rel=0.05)
    assert found["held"].sum() > 12
    assert found["push"][found["held"]].min() > 0


def test_seepage(example):
    """What flows in flows out, and the seepage is less than without the pile."""
    found = example("seepage")
    whole = found["reactions"](found["K"], found["a"], found["f"])
    assert abs(whole.sum()) < 1e-9 * np.abs(whole.array).sum()
    assert 0 < found["litres"] < 3.6e6 * found["permeability"] * found["head"]


def test_roller_on_dome(example):
    found = example("roller_on_dome")
    contact = found["state"].pairs[0]
    assert contact.force == pytest.approx([found["push"], -found["press"]], rel=1e-9)
    assert np.count_nonzero(contact.status == SLIP) > 2
    R = 1 / (1 / found["dome"] + 1 / found["roller_radius"])
    half_width = np.sqrt(4 * found["press"] * R * (1 - 0.4**2) / (np.pi * 3000))
    closed = contact.position[contact.status != OPEN, 0]
    assert np.ptp(closed) == pytest.approx(2 * half_width, abs=2 * found["size"])


def test_press_fit(example):
    """Between the holes the pressure is near Lamé's, and its mean below it."""
    found = example("press_fit")
    assert found["pressure"].max() == pytest.approx(found["lame"], rel=0.1)
    assert found["pressure"].min() < 0.3 * found["lame"]


def test_bar_impact(example):
    found = example("bar_impact")
    assert np.median(found["force"][found["force"] > 0.2 * found["expected"]]) == pytest.approx(
        found["expected"], rel=0.03
    )
    assert found["history"].energies.imbalance < 1e-9


def test_tuning_fork(example):
    """A prong is a cantilever: the fork's own tone is a little below that of a clamped one."""
    found = example("tuning_fork")
    one = 1.8751**2 / (2 * np.pi) * found["thick"] / np.sqrt(12) / found["prong"] ** 2
    clamped = one * np.sqrt(206e3 / 7.85e-9)
    assert 0.75 * clamped < found["tones"][2] < clamped


def test_gasket(example):
    """The gasket carries the bolts, then the bolts less the pressure's thrust and what it opens."""
    found = example("gasket")
    bolted, pressed = (state.pairs[0].force[1] for state in found["states"])
    assert bolted == pytest.approx(-found["bolts"], rel=1e-6)
    thrust = found["pressure"] * np.pi * 56**2  # up to where the gasket begins
    assert pressed == pytest.approx(-found["bolts"] + thrust, rel=1e-3)


def test_gears(example):
    """The force is along the line of action, but for friction, which is at most a tenth of it."""
    found = example("gears")
    contact = found["state"].pairs[0]
    force = contact.force
    angle = np.arctan2(abs(force[0]), abs(force[1]))
    assert abs(angle - np.radians(20)) < np.arctan(0.1) + 0.01
    opposite = contact.opposite_force.sum(axis=0)
    assert opposite == pytest.approx(-force, rel=1e-9)


def test_sphere_on_block(example):
    found = example("sphere_on_block")
    assert np.nanmax(found["pressure"]) == pytest.approx(found["peak"], rel=0.06)
    assert found["state"].pairs[0].force[2] == pytest.approx(-found["force"] / 4, rel=1e-6)


def test_bracket(example):
    found = example("bracket")
    foot = found["foot"]
    assert foot.force == pytest.approx([-found["pull"], 0, found["bolt"]], rel=0.1, abs=20)
    assert 5 < found["closed"] < 95


if __name__ == "__main__":
    for one in NAMES:
        run(one, Path(sys.argv[1]), coarse=False)

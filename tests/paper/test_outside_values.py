"""Sections 7.2 to 7.4 against values of an independent program for the same reconstructions."""

import numpy as np
import pytest

from study.paper import s7_2_block, s7_3_parabolic_punch, s7_4_rigid_plate


def interior(curves, name, places):
    return np.interp(places, curves["x"], curves[name])


# pressure over p at x = 0.5, 1, 2, 3, 3.5 and shear over p at 1, 2, 3
BLOCK = {
    "pw-T6": ((0.883, 0.881, 0.889, 1.009, 1.156), (0.024, 0.191, 0.303)),
    "galerkin-Q8": ((0.873, 0.882, 0.889, 1.011, 1.157), (0.025, 0.195, 0.303)),
}


@pytest.mark.parametrize("element", BLOCK)
def test_block(element):
    pressure, shear = BLOCK[element]
    result = s7_2_block.block(element)
    p = interior(result.curves, "pressure", [0.5, 1, 2, 3, 3.5]) / s7_2_block.PRESSURE
    q = interior(result.curves, "shear", [1, 2, 3]) / s7_2_block.PRESSURE
    assert p == pytest.approx(pressure, rel=0.01)
    assert q == pytest.approx(shear, abs=0.01)
    assert result.scalars["force_normal"] == pytest.approx(800, rel=1e-9)
    assert result.scalars["force_tangential"] == pytest.approx(120, rel=1e-9)
    assert result.scalars["residual"] < 1e-9
    assert result.scalars["unique"] == 1


def test_condensed_quadrilateral_carries_its_triangles_forces():
    pair, triangles = (s7_2_block.block(element).curves for element in ("pw-Q8", "pw-T6"))
    for name in ("force_n", "force_t"):
        assert pair[name] == pytest.approx(triangles[name], abs=1e-8)


def test_composite_triangle_carries_the_new_ones_forces_on_a_plane():
    composite, new = (s7_2_block.block(element).curves for element in ("composite-T6", "pw-T6"))
    for name in ("force_n", "force_t"):
        assert composite[name] == pytest.approx(new[name], abs=1e-7)


def test_transferred_forces_are_the_new_ones_without_slip():
    galerkin, new = (
        s7_2_block.block(e, friction=5.0, pull=0.1).curves for e in ("galerkin-T6", "pw-T6")
    )
    assert not np.any((new["status"] == 2) & (new["friction"] > 0))
    assert galerkin["force_n_T"] == pytest.approx(new["force_n"], abs=1e-8)


# normal force at depth 0.25 and mu = 0.6
PUNCH = {"galerkin-Q8": 218.3, "galerkin-T6": 218.4, "pw-T6": 218.4}


@pytest.mark.parametrize("element", PUNCH)
def test_punch(element):
    result = s7_3_parabolic_punch.punch(element)
    assert result.scalars["force_indentation"] == pytest.approx(PUNCH[element], rel=0.01)
    share = -result.scalars["force_tangential"] / result.scalars["force_indentation"]
    assert share == pytest.approx(s7_3_parabolic_punch.TANGENTIAL_SHARE, rel=1e-6)
    assert 1.2 < result.scalars["closed_to"] < 1.45


def test_punch_without_friction():
    smooth = {"friction": 0.0, "tangential_share": 0.0}
    result = s7_3_parabolic_punch.punch("pw-T6", divisions=(57, 12), **smooth)
    assert result.scalars["force_indentation"] == pytest.approx(214.2, rel=2e-3)
    assert result.scalars["peak_pressure"] == pytest.approx(96.2, rel=0.01)
    element = 0.075  # contact ends between 1.375 and 1.41
    assert 1.375 - element < result.scalars["closed_to"] < 1.41 + element


# nodal normal forces from the centre to the edge
PLATE = {
    ("galerkin-T6", 0.0): (1.029, 2.066, 1.070, 2.189, 1.163, 2.543, 1.449, 3.386, 5.620),
    ("galerkin-Q8", 0.0): (1.030, 2.089, 1.069, 2.223, 1.152, 2.678, 1.412, 3.441, 5.422),
    ("pw-T6", 0.0): (1.546, 1.550, 1.601, 1.642, 1.755, 1.907, 2.190, 2.540, 6.043),
    ("pw-T6", 20.0): (1.663, 1.664, 1.718, 1.772, 1.892, 2.018, 2.311, 2.457, 5.336),
}


@pytest.mark.parametrize(("element", "angle"), PLATE)
def test_plate(element, angle):
    result = s7_4_rigid_plate.plate(element, friction_angle=angle)
    half = result.curves["force_n"][result.curves["x"] > -1e-9]
    assert half == pytest.approx(PLATE[element, angle], abs=3e-3)
    assert result.scalars["force_normal"] == pytest.approx(s7_4_rigid_plate.FORCE, rel=1e-9)
    if angle:
        assert result.scalars["stick_to"] == pytest.approx(0.75, abs=0.25 / 2 + 1e-9)

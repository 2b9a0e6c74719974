"""Test the meshes, the exact solution and the measures of fits in space in section V22."""

import numpy as np
import pytest
import ufl
from dolfinx.fem import locate_dofs_topological

from pw_elements import assemble_scalar, boundary_measure
from study.benchmarks.v22_fits_in_space import dovetail, press_fit
from study.model.discretisation import make_element_spaces
from study.solutions.calculix.shrink_fit import (
    INTERFERENCE,
    RADII,
    SHRUNK_TUBES,
    compute_lame_pressure,
    divide_tubes,
)

INNER_TUBE = (np.array([0.5, 1.0]), np.linspace(0, 2 * np.pi, 9), np.array([0.0, 0.5, 1.0]))
OUTER_TUBE = (np.array([1.0, 1.5]), np.linspace(0, 2 * np.pi, 11), np.array([0.0, 1.0]))


def integrate_over_sides(mesh, integrand, sides):
    return [
        assemble_scalar(integrand * boundary_measure(mesh, side.astype(np.int32))) for side in sides
    ]


def test_lame_pressure_moves_both_tubes_apart_by_the_interference():
    """Displacements of both tubes are those of textbooks, with Poisson's ratio, which cancels."""
    (a, b, c), E, nu = RADII, press_fit.YOUNGS_MODULUS, press_fit.POISSONS_RATIO
    p = compute_lame_pressure(RADII, 0.02)
    outwards = p * b / E * ((c**2 + b**2) / (c**2 - b**2) + nu)
    inwards = p * b / E * ((b**2 + a**2) / (b**2 - a**2) - nu)
    assert outwards + inwards == pytest.approx(0.02, rel=1e-12)


def test_whole_tubes_have_no_seam_and_the_areas_of_their_cylinders():
    mesh, sides = press_fit.mesh_tubes(INNER_TUBE, OUTER_TUBE)
    x = mesh.geometry.x
    distance = np.linalg.norm(x[:, None] - x[None], axis=2)
    same_place = np.argwhere(np.triu(distance < 1e-9, 1))
    # only nodes of different tubes, on the fit, may coincide
    assert np.allclose(np.hypot(*x[same_place[:, 0], :2].T), 1.0)
    volume = assemble_scalar(1.0 * ufl.dx(domain=mesh, metadata={"quadrature_degree": 6}))
    assert volume == pytest.approx(np.pi * (1.5**2 - 0.5**2), rel=2e-3)
    assert integrate_over_sides(mesh, 1.0, sides) == pytest.approx([2 * np.pi] * 2, rel=2e-3)


def test_normals_of_bore_and_shaft_are_opposite_where_the_shaft_is_as_wide_as_the_bore():
    mesh, sides = press_fit.mesh_tubes(INNER_TUBE, OUTER_TUBE)
    x, n = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
    outwards = (n[0] * x[0] + n[1] * x[1]) / ufl.sqrt(x[0] ** 2 + x[1] ** 2)
    on_bore, on_shaft = integrate_over_sides(mesh, outwards, sides)
    assert on_bore == pytest.approx(-2 * np.pi, rel=5e-3)
    assert on_shaft == pytest.approx(2 * np.pi, rel=5e-3)


def test_nose_of_the_shaft_is_smooth_and_thinner_by_the_given_amount():
    z = np.array([-0.5, -0.35, -0.35 + 1e-4, 0.05])
    outline = np.column_stack([np.full(4, 1.03), z])
    moved = press_fit.bend_shaft_nose(outline, (-0.35, 0.05, 0.06), (0, 1))
    assert moved[:, 1] == pytest.approx(z)
    assert moved[[0, 1, 3], 0] == pytest.approx([1.03, 1.03, 0.97])
    assert abs(moved[2, 0] - 1.03) < 1e-6  # a parabola, so that the slope is zero at its start


@pytest.mark.parametrize("case", SHRUNK_TUBES)
def test_calculix_has_the_nodes_and_sides_of_our_tubes(case):
    problem = SHRUNK_TUBES[case]
    inner, outer = divide_tubes(problem.around)
    inner = (inner[0], *outer[1:]) if problem.matches else inner
    mesh, sides = press_fit.mesh_tubes(
        press_fit._tube(RADII[:2], (0.0, 0.6), inner, np.pi / 2),
        press_fit._tube(RADII[1:], (0.0, 0.6), outer, np.pi / 2),
    )
    space = make_element_spaces("galerkin-T10", mesh).trial
    x = space.tabulate_dof_coordinates()
    theirs = np.array(problem.nodes)
    r = np.hypot(theirs[:, 0], theirs[:, 1])
    is_overlapping = np.isclose(r, RADII[1] + INTERFERENCE)
    nodes = [locate_dofs_topological(space, 2, side.astype(np.int32)) for side in sides]
    assert is_overlapping.sum() == len(nodes[1])
    theirs[is_overlapping, :2] /= 1 + INTERFERENCE
    assert sort_points(theirs) == pytest.approx(sort_points(x), abs=1e-9)
    for numbers, own in zip((problem.slave_nodes, problem.master_nodes), nodes, strict=True):
        assert sort_points(theirs[numbers - 1]) == pytest.approx(sort_points(x[own]), abs=1e-9)


def sort_points(x):
    rounded = np.round(x, 7) + 0.0
    return rounded[np.lexsort(rounded.T)]


@pytest.fixture(scope="module")
def coarse_dovetail(tmp_path_factory):
    path = tmp_path_factory.mktemp("dovetail") / "dovetail.inp"
    dovetail.write_dovetail(path, (0.4, 0.5))
    return dovetail.read_dovetail(path)


def test_flanks_of_the_dovetail_are_inclined_and_face_each_other(coarse_dovetail):
    part, sides = coarse_dovetail
    n = ufl.FacetNormal(part.mesh)
    areas = 0.5 * np.sqrt(2) * 0.8, 0.6 * np.sqrt(2) * 1.6
    for sign, side, area in zip((1, -1), sides, areas, strict=True):
        (measured,) = integrate_over_sides(part.mesh, 1.0, [side])
        along_normal = n[0] * dovetail.FLANK_NORMAL[0] + n[2] * dovetail.FLANK_NORMAL[2]
        (projected,) = integrate_over_sides(part.mesh, along_normal, [side])
        assert measured == pytest.approx(area, rel=1e-9)
        assert projected == pytest.approx(sign * area, rel=1e-9)


def test_scatter_is_the_deviation_from_a_parabola():
    s = np.array([(a, b) for a in np.linspace(-1, 1, 10) for b in np.linspace(-1, 1, 10)])
    smooth = 2 + 0.3 * s[:, 0] - 0.2 * s[:, 0] * s[:, 1] + 0.1 * s[:, 1] ** 2
    assert dovetail._measure_scatter(s, smooth) < 1e-12
    checkerboard = np.array([(-1.0) ** (i + k) for i in range(10) for k in range(10)])
    scatter = dovetail._measure_scatter(s, smooth + 0.1 * checkerboard)
    assert scatter == pytest.approx(0.1 / smooth.mean(), rel=0.02)


def test_a_coarse_shrink_fit_has_nearly_lames_pressure_that_grows_with_the_interference(
    monkeypatch,
):
    errors = press_fit.shrink("pw-T10", 4).scalars
    assert errors["mean_error"] < 0.005
    monkeypatch.setattr(press_fit, "INTERFERENCE", 3e-3)
    again = press_fit.shrink("pw-T10", 4).scalars
    assert again["mean_error"] == pytest.approx(errors["mean_error"], rel=1e-6)

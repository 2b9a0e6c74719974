"""Section W: problems confirmed by what they do not compute."""

from functools import cache, partial

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from scipy.integrate import dblquad, quad

from pw_elements import SurfaceNodes, assemble_vector, boundary_measure, solve
from pw_elements.contact import ContactPair, Plane
from pw_elements.meshes import triangles
from study.benchmarks.w_engineering import page, pressures, sliding
from study.benchmarks.w_engineering.pressures import pressure_matrix
from study.judge.measures import engineering
from study.meshes.solid_meshes import mesh_box
from study.model.discretisation import spaces
from study.model.units import dimensionless
from study.run.store import Result, Results, save
from tests.contact.cases import ElasticBody, on_plane

ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-T10", "pw-T10")


def block(element, cells=3):
    lines = np.linspace(0, 1, cells + 1)
    plane = element.endswith("T6")
    mesh = triangles(MPI.COMM_SELF, (0, 0), (1, 1), (cells, cells)) if plane else None
    mesh = mesh or mesh_box("tetrahedron", lines, lines, lines)
    state = "plane strain" if plane else "solid"
    return ElasticBody(
        mesh, partial(spaces, element), state, sliding.PUNCH_MODULUS, sliding.PUNCH_POISSONS_RATIO
    )


@pytest.mark.parametrize("element", ELEMENTS)
def test_readings_know_the_pressure_of_its_forces(element):
    """Even ones all but tributary areas, linear ones those that are projected; 1 + 2 x."""
    body = block(element).body
    mesh = body.spaces.mesh
    up = mesh.geometry.dim - 1
    surface = SurfaceNodes.from_body(body, on_plane(up, 0.0))
    x = ufl.SpatialCoordinate(mesh)

    def forces(pressure):
        traction = ufl.as_vector([0.0] * up + [pressure])
        load = body.surface_load(traction, boundary_measure(mesh, on_plane(up, 0.0)))
        return assemble_vector(load).array[up :: up + 1][surface.node]

    linear = 1 + 2 * surface.position[:, 0]
    assert pressure_matrix("projected", surface) @ forces(1 + 2 * x[0]) == pytest.approx(linear)
    corners = surface.weight_area < 1e-9
    even = forces(1.0 + 0 * x[0])
    if corners.any():
        with pytest.raises(ValueError, match="own weight vanishes"):
            pressure_matrix("own", surface)
        assert pressure_matrix("skip", surface) @ even == pytest.approx(~corners * 1.0)
        assert pressure_matrix("neighbours", surface) @ even == pytest.approx(1.0)
    else:
        assert pressure_matrix("own", surface) @ even == pytest.approx(1.0)
    uneven = np.ptp(pressure_matrix("tributary", surface) @ even) > 0.1
    assert uneven == element.startswith("galerkin")


@pytest.mark.parametrize("element", ELEMENTS)
def test_an_unworn_punch_has_the_librarys_contact_forces(element):
    punch, body = sliding.Punch.make(element, 4), block(element, 4)
    up = body.dim - 1

    def back(x):
        return np.isclose(x[up], 1) & (np.max(x[:up], axis=0) < sliding.LOADED_WIDTH + 1e-9)

    traction = np.append(np.zeros(up), -sliding.MEAN_PRESSURE / sliding.LOADED_WIDTH**up)
    plate = ContactPair(on_plane(up, 0.0), Plane((0.0,) * (up + 1), np.eye(up + 1)[up]))
    held = body.make_supports(*((i, on_plane(i, 0.0)) for i in range(up)))
    (state,) = body.solve_contact(plate, held, body.traction_load(traction, back))
    found, _ = punch.forces(
        np.zeros(len(punch.load_displacement)), np.ones(len(punch.load_displacement), dtype=bool)
    )
    assert found == pytest.approx(state.pairs[0].force_normal, abs=1e-9)


@cache
def worn_punch(element, rule="own"):
    return sliding.wear_punch(element, rule, 4, 200)


def test_a_worn_punch_ends_in_the_shape_of_an_even_pressure():
    """The face's displacements under the even pressure, by one linear solution."""
    body, end = block("pw-T6", 4), worn_punch("pw-T6")
    above = lambda x: np.isclose(x[1], 1) & (x[0] < sliding.LOADED_WIDTH + 1e-9)  # noqa: E731
    load = body.traction_load((0.0, 1.0), on_plane(1, 0.0)) + body.traction_load(
        (0.0, -1 / sliding.LOADED_WIDTH), above
    )
    corner = (1, lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 1))
    u = solve(body.K, load, body.make_supports((0, on_plane(0, 0.0)), corner))
    moved = u.array_r[1::2][end.punch.surface.node]
    worn_off = end.depth - end.depth.min()
    assert worn_off == pytest.approx(moved.max() - moved, abs=5e-3 * np.ptp(moved))
    assert np.ptp(end.depth) > 0.1 * end.depth.mean()


@pytest.mark.parametrize("element", ["galerkin-T6", "pw-T6", "pw-T10"])
def test_worn_volume_is_force_times_path_and_pressures_end_even(element):
    end = worn_punch(element)
    assert end.punch.surface.weight_area @ end.depth == pytest.approx(
        sliding.PATH * end.punch.force
    )
    assert end.pressure == pytest.approx(sliding.MEAN_PRESSURE, rel=0.01)


def test_a_step_beyond_the_bound_is_refused_and_just_below_it_is_stable():
    bound = worn_punch("pw-T6").step_over_bound * 200
    with pytest.raises(ValueError, match="not stable"):
        sliding.wear_punch("pw-T6", "own", 4, int(bound))
    assert sliding.wear_punch("pw-T6", "own", 4, int(bound) + 2).end_error < 0.05


@cache
def slipped(element, halving):
    return sliding.solve_partial_slip(element, "own", 8, halving)


@pytest.mark.parametrize("element", ELEMENTS[:2])
def test_constant_friction_sticks_as_cattaneo_and_mindlin_say(element):
    """To a third of the distance of nodes; the sides are near, and both directions coupled."""
    found = slipped(element, 1e9)
    assert found.stick == pytest.approx(np.sqrt(1 - found.force), abs=0.02)


@pytest.mark.parametrize("element", ELEMENTS[:2])
def test_shear_is_what_the_law_says_of_the_pressure(element):
    found = slipped(element, sliding.HALVING_PRESSURE)
    p, t, r = found.pressure, found.shear, np.abs(found.x[:, 0])
    limit = sliding.LARGEST_FRICTION * p / (1 + p / sliding.HALVING_PRESSURE)
    assert np.all(np.abs(t) <= limit + 1e-9)
    assert t[r > found.stick + 0.1] == pytest.approx(limit[r > found.stick + 0.1], abs=1e-9)
    assert np.all(t[r < found.stick - 0.1] < 0.99 * limit[r < found.stick - 0.1])
    assert found.force < slipped(element, 1e9).force


@pytest.mark.parametrize("element", ELEMENTS[:2])
def test_heat_that_is_linear_in_the_pressure_is_that_of_the_force(element, monkeypatch):
    """Through a joint so weak that the body has one temperature, whatever the nodal forces."""
    monkeypatch.setattr(pressures, "CONDUCTANCE", 1e-9)
    contact = pressures.HertzContact.solve(element, 4)
    heat = pressures.conduct_heat(element, "own", 4, exponent=1.0).heat
    peak = contact.problem.exact.peak_pressure
    assert heat == pytest.approx(1e-9 * contact.force.sum() / peak, rel=1e-6)


@pytest.mark.parametrize("element", ["galerkin-T6", "sibling-T6"])
def test_impulse_is_the_change_of_momentum_and_energy_balances(element):
    found = sliding.throw_block(element, 4)
    step, mass = found.time[1], 2.0
    assert step * found.force[:, 1].sum() == pytest.approx(
        mass * sliding.SPEED_DOWN * (1 + found.rebound)
    )
    assert found.imbalance < 1e-12
    assert found.force[-1] == pytest.approx(0.0)
    assert 0 < found.slip < 1  # sliding all the time would be 1, and known


def test_stress_below_hertz_contacts_is_the_integral_of_point_forces():
    r, z = 0.35, 0.2
    plane = quad(lambda s: np.sqrt(1 - s**2) / ((r - s) ** 2 + z**2) ** 2, -1, 1)[0]
    space = dblquad(
        lambda angle, s: s
        * np.sqrt(1 - s**2)
        / (r**2 + s**2 - 2 * r * s * np.cos(angle) + z**2) ** 2.5,
        0, 1, 0, 2 * np.pi,
    )[0]  # fmt: skip
    at_point = np.array([r])
    assert pressures.exact_stress(1, at_point, z)[0] == pytest.approx(2 * z**3 / np.pi * plane)
    exact = pressures.exact_stress(2, at_point, z)[0]
    assert exact == pytest.approx(3 * z**3 / (2 * np.pi) * space, rel=1e-6)


def test_a_submodel_below_the_exact_pressure_has_the_exact_stress():
    found = pressures.solve_submodel("pw-T6", "exact", 8)
    assert found.stress == pytest.approx(found.exact, abs=2e-3)


@pytest.mark.parametrize("offset", [-1 / 3, 0.0, 1 / 3])
def test_shifted_lines_keep_body_and_load(offset):
    """Forces of the punch add up to the load, and the contact's force is Hertz' on any mesh."""
    punch = sliding.Punch.make("pw-T6", 4, offset)
    force, _ = punch.forces(
        np.zeros(len(punch.load_displacement)), np.ones(len(punch.load_displacement), dtype=bool)
    )
    assert force.sum() == pytest.approx(sliding.MEAN_PRESSURE)
    assert punch.surface.weight_area.sum() == pytest.approx(1.0)
    contact = pressures.HertzContact.solve("pw-T6", 4, offset)
    exact = contact.problem.exact
    assert contact.force.sum() == pytest.approx(
        exact.peak_pressure * np.pi / 4, rel=0.03
    )  # of one half


def test_other_cells_agree_with_triangles_on_a_fine_mesh():
    """References are independent of the elements compared, but solve the same problems."""
    depth = {
        element: sliding.wear_punch(element, "own", 16, 400).half_depth[0]
        for element in ("galerkin-Q9", "pw-T6")
    }
    assert depth["galerkin-Q9"] == pytest.approx(depth["pw-T6"], rel=1e-3)
    slips = [sliding.solve_partial_slip(e, "own", 16) for e in ("galerkin-Q9", "pw-T6")]
    assert slips[0].force == pytest.approx(slips[1].force, rel=1e-3)
    rebounds = [sliding.throw_block(e, 16).rebound for e in ("galerkin-Q9", "sibling-T6")]
    assert rebounds[0] == pytest.approx(rebounds[1], rel=5e-3)


def store_answers(folder, standard, new, uncertainty=0.001):
    """Store answers on three meshes, each with two shifted ones; the reference is 1."""

    def keep(name, parameters, scalars):
        result = Result(scalars, dimensionless(scalars), {}, dofs=1)
        save(folder, "W", name, result, parameters, {})

    scalars = {"answer": 1.0, "answer_uncertainty": uncertainty}
    keep(
        "reference-wear-T6", {"problem": "reference", "application": "wear", "cell": "T6"}, scalars
    )
    for element, three in (("galerkin-T6", standard), ("pw-T6", new)):
        for mesh in (4, 8, 16):
            key = f"wear-{element}-{mesh}-own"
            stated = {"element": element, "mesh": mesh, "reading": "own"}
            keep(key, {"problem": "wear", **stated}, {"answer": three[0]})
            keep(
                f"shifted-{key}",
                {"problem": "shifted", "application": "wear", **stated},
                {"answer_before": three[1], "answer_beyond": three[2]},
            )
    return Results(folder)


def test_bands_hold_the_range_on_both_sides_of_its_middle(tmp_path):
    results = store_answers(tmp_path, (1.02, 1.03, 1.04), (1.0, 1.001, 0.999))
    wear = (results, "wear", "T6", "")
    assert engineering.answer_band(*wear, False, 0) == pytest.approx((1.01, 1.05))
    assert engineering.error_band(*wear, False, 0) == pytest.approx((0.009, 0.051))
    assert engineering.error_band(*wear, True, 0) == pytest.approx((0.0, 0.003))
    assert engineering.answer_changes(*wear, 0)
    assert engineering.is_resolved(*wear, 0)
    assert engineering.n_changes(results, 2) == 1


@pytest.mark.parametrize(
    "new", [(1.0, 1.02, 1.01), (1.012, 1.0125, 1.0115)], ids=["overlapping", "nearer than 1 %"]
)
def test_answers_in_overlapping_or_near_bands_do_not_change(tmp_path, new):
    results = store_answers(tmp_path, (1.02, 1.021, 1.019), new)
    assert not engineering.answer_changes(results, "wear", "T6", "", 0)


def test_an_uncertain_reference_resolves_no_ratio(tmp_path):
    results = store_answers(tmp_path, (1.02, 1.021, 1.019), (1.0, 1.001, 0.999), uncertainty=0.02)
    assert engineering.answer_changes(results, "wear", "T6", "", 0)
    assert not engineering.is_resolved(results, "wear", "T6", "", 0)


def test_cases_have_three_meshes_and_shifted_ones_of_each_best_reading():
    names = {case.name for case in page.CASES}
    for problem, meshes in page.MESHES.items():
        for cell, three in meshes.items():
            assert len(three) == 3
            for element in page.elements_compared(problem, cell):
                for reading in page.best_readings(problem, element):
                    for mesh in three:
                        key = f"{problem}-{element}-{mesh}-{reading}"
                        assert {key, f"shifted-{key}"} <= names

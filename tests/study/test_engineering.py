"""Test the problems of section W by balances, exact solutions and other implementations."""

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
from study.benchmarks.w_engineering.pressures import nodal_force_to_pressure_matrix
from study.judge.measures import engineering
from study.meshes.solid_meshes import mesh_box_along_lines
from study.model.discretisation import make_element_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result, Results, save
from tests.contact.cases import ElasticBody, on_plane

ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-T10", "pw-T10")


def make_elastic_block(element, cells_per_side=3):
    mesh_lines = np.linspace(0, 1, cells_per_side + 1)
    is_plane = element.endswith("T6")
    mesh = (
        triangles(MPI.COMM_SELF, (0, 0), (1, 1), (cells_per_side, cells_per_side))
        if is_plane
        else None
    )
    mesh = mesh or mesh_box_along_lines("tetrahedron", mesh_lines, mesh_lines, mesh_lines)
    state = "plane strain" if is_plane else "solid"
    return ElasticBody(
        mesh,
        partial(make_element_spaces, element),
        state,
        sliding.PUNCH_MODULUS,
        sliding.PUNCH_POISSONS_RATIO,
    )


@pytest.mark.parametrize("element", ELEMENTS)
def test_pressure_matrix_recovers_pressure_from_nodal_forces(element):
    """Each pressure matrix recovers known pressures from the nodal forces integrated from them.

    The linear pressure 1 + 2 x is recovered by projection. The uniform pressure 1 is recovered by
    all methods except tributary areas for the standard element. If the weight of a node vanishes,
    the method "own" raises an error, and the method "skip" gives zero at this node.
    """
    body = make_elastic_block(element).body
    mesh = body.spaces.mesh
    vertical_axis = mesh.geometry.dim - 1
    surface = SurfaceNodes.from_body(body, on_plane(vertical_axis, 0.0))
    x = ufl.SpatialCoordinate(mesh)

    def nodal_forces(pressure):
        traction = ufl.as_vector([0.0] * vertical_axis + [pressure])
        load = body.surface_load(traction, boundary_measure(mesh, on_plane(vertical_axis, 0.0)))
        return assemble_vector(load).array[vertical_axis :: vertical_axis + 1][surface.node]

    linear_pressure = 1 + 2 * surface.position[:, 0]
    assert nodal_force_to_pressure_matrix("projected", surface) @ nodal_forces(
        1 + 2 * x[0]
    ) == pytest.approx(linear_pressure)
    has_no_weight = surface.weight_area < 1e-9
    even_forces = nodal_forces(1.0 + 0 * x[0])
    if has_no_weight.any():
        with pytest.raises(ValueError, match="own weight vanishes"):
            nodal_force_to_pressure_matrix("own", surface)
        assert nodal_force_to_pressure_matrix("skip", surface) @ even_forces == pytest.approx(
            ~has_no_weight * 1.0
        )
        assert nodal_force_to_pressure_matrix("neighbours", surface) @ even_forces == pytest.approx(
            1.0
        )
    else:
        assert nodal_force_to_pressure_matrix("own", surface) @ even_forces == pytest.approx(1.0)
    is_uneven = np.ptp(nodal_force_to_pressure_matrix("tributary", surface) @ even_forces) > 0.1
    assert is_uneven == element.startswith("galerkin")


@pytest.mark.parametrize("element", ELEMENTS)
def test_an_unworn_punch_has_the_librarys_contact_forces(element):
    punch, body = (
        sliding.CondensedElasticPunch.from_element_and_mesh_size(element, 4),
        make_elastic_block(element, 4),
    )
    vertical_axis = body.dim - 1

    def is_loaded(x):
        return np.isclose(x[vertical_axis], 1) & (
            np.max(x[:vertical_axis], axis=0) < sliding.LOADED_WIDTH + 1e-9
        )

    traction = np.append(
        np.zeros(vertical_axis), -sliding.MEAN_PRESSURE / sliding.LOADED_WIDTH**vertical_axis
    )
    pair = ContactPair(
        on_plane(vertical_axis, 0.0),
        Plane((0.0,) * (vertical_axis + 1), np.eye(vertical_axis + 1)[vertical_axis]),
    )
    supports = body.make_supports(*((i, on_plane(i, 0.0)) for i in range(vertical_axis)))
    (state,) = body.solve_contact(pair, supports, body.traction_load(traction, is_loaded))
    contact_forces, _ = punch.forces(
        np.zeros(len(punch.load_displacement)), np.ones(len(punch.load_displacement), dtype=bool)
    )
    assert contact_forces == pytest.approx(state.pairs[0].force_normal, abs=1e-9)


@cache
def solve_worn_punch(element, pressure_rule="own"):
    return sliding.wear_punch(element, pressure_rule, 4, 200)


def test_final_wear_depth_follows_face_displacement_under_even_pressure():
    """Wear makes the pressure uniform and compensates the displacements of the contact face.

    Therefore, differences in wear depth equal differences in the displacement of the contact face
    under a uniform pressure. This displacement is computed by one linear solution.
    """
    body, worn = make_elastic_block("pw-T6", 4), solve_worn_punch("pw-T6")
    is_loaded = lambda x: np.isclose(x[1], 1) & (x[0] < sliding.LOADED_WIDTH + 1e-9)  # noqa: E731
    load = body.traction_load((0.0, 1.0), on_plane(1, 0.0)) + body.traction_load(
        (0.0, -1 / sliding.LOADED_WIDTH), is_loaded
    )
    corner_support = (1, lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 1))
    u = solve(body.K, load, body.make_supports((0, on_plane(0, 0.0)), corner_support))
    face_displacement = u.array_r[1::2][worn.punch.surface.node]
    depth_differences = worn.depth - worn.depth.min()
    assert depth_differences == pytest.approx(
        face_displacement.max() - face_displacement, abs=5e-3 * np.ptp(face_displacement)
    )
    assert np.ptp(worn.depth) > 0.1 * worn.depth.mean()


@pytest.mark.parametrize("element", ["galerkin-T6", "pw-T6", "pw-T10"])
def test_worn_volume_is_force_times_path_and_pressures_end_even(element):
    worn = solve_worn_punch(element)
    assert worn.punch.surface.weight_area @ worn.depth == pytest.approx(
        sliding.PATH * worn.punch.force
    )
    assert worn.pressure == pytest.approx(sliding.MEAN_PRESSURE, rel=0.01)


def test_wear_step_beyond_the_stability_bound_is_refused_and_below_it_is_stable():
    min_stable_steps = solve_worn_punch("pw-T6").step_over_stability_limit * 200
    with pytest.raises(ValueError, match="not stable"):
        sliding.wear_punch("pw-T6", "own", 4, int(min_stable_steps))
    assert (
        sliding.wear_punch("pw-T6", "own", 4, int(min_stable_steps) + 2).final_pressure_deviation
        < 0.05
    )


@cache
def solve_partial_slip(element, halving_pressure):
    return sliding.solve_partial_slip(element, "own", 8, halving_pressure)


@pytest.mark.parametrize("element", ELEMENTS[:2])
def test_stick_width_under_constant_friction_agrees_with_cattaneo_and_mindlin(element):
    """The stick width is that of Cattaneo and Mindlin within a third of the distance of nodes.

    Exact agreement is not expected, because the body is finite and its normal and tangential
    directions are coupled, whereas the exact solution neglects both.
    """
    slip_result = solve_partial_slip(element, 1e9)
    assert slip_result.stick == pytest.approx(np.sqrt(1 - slip_result.force), abs=0.02)


def test_stick_radius_is_continuous_where_nodes_lie_at_the_limit_of_the_fit():
    """Nodes at exactly 0.6 of the outermost sticking radius: 3, 4 and 5 edges on a square mesh."""
    edges = np.array([(3.0, 0), (0, 3), (4, 0), (5, 0), (3, 4), (4, 3), (6, 0)])
    radius = np.linalg.norm(edges, axis=1)
    sticks = radius < 5.5
    unused_friction = np.sqrt(np.maximum(0, 33 - radius**2) + 0.1 * (radius < 3.5))
    inwards, outwards = (
        sliding._extrapolate_stick_radius(
            edges * (1 + shift * (radius < 3.5))[:, None], unused_friction, sticks
        )
        for shift in (-1e-15, 1e-15)
    )
    assert inwards == pytest.approx(outwards, rel=1e-12)


@pytest.mark.parametrize("element", ELEMENTS[:2])
def test_shear_is_at_the_limit_of_friction_in_slip_and_below_it_in_stick(element):
    slip_result = solve_partial_slip(element, sliding.HALVING_PRESSURE)
    pressure, shear, r = slip_result.pressure, slip_result.shear, np.abs(slip_result.x[:, 0])
    limit = sliding.LARGEST_FRICTION * pressure / (1 + pressure / sliding.HALVING_PRESSURE)
    assert np.all(np.abs(shear) <= limit + 1e-9)
    assert shear[r > slip_result.stick + 0.1] == pytest.approx(
        limit[r > slip_result.stick + 0.1], abs=1e-9
    )
    assert np.all(shear[r < slip_result.stick - 0.1] < 0.99 * limit[r < slip_result.stick - 0.1])
    assert slip_result.force < solve_partial_slip(element, 1e9).force


@pytest.mark.parametrize("element", ELEMENTS[:2])
def test_heat_through_a_weak_joint_is_proportional_to_the_contact_force(element, monkeypatch):
    """Heat flow through a weakly conducting joint is proportional to the total contact force.

    The exponent of one makes the conductance of the joint proportional to the pressure. The joint
    conducts so weakly that the body has a uniform temperature, so that the distribution of the
    contact force over the nodes has no influence.
    """
    monkeypatch.setattr(pressures, "CONDUCTANCE", 1e-9)
    contact = pressures.HertzContact.solve(element, 4)
    heat = pressures.conduct_heat_through_joint(element, "own", 4, conductance_exponent=1.0).heat
    peak = contact.problem.exact.peak_pressure
    assert heat == pytest.approx(1e-9 * contact.force.sum() / peak, rel=1e-6)


@pytest.mark.parametrize("element", ["galerkin-T6", "sibling-T6"])
def test_impulse_is_the_change_of_momentum_and_energy_balances(element):
    impact = sliding.throw_block_at_rough_dome(element, 4)
    step, mass = impact.time[1], 2.0
    assert step * impact.force[:, 1].sum() == pytest.approx(
        mass * sliding.SPEED_DOWN * (1 + impact.rebound_speed_ratio)
    )
    assert impact.imbalance < 1e-12
    assert impact.force[-1] == pytest.approx(0.0)
    assert 0 < impact.slip < 1  # 1 would be sliding all the time, whose result is known


def test_stress_below_hertz_contacts_is_the_integral_of_point_forces():
    r, z = 0.35, 0.2
    plane_integral = quad(lambda s: np.sqrt(1 - s**2) / ((r - s) ** 2 + z**2) ** 2, -1, 1)[0]
    space_integral = dblquad(
        lambda angle, s: s
        * np.sqrt(1 - s**2)
        / (r**2 + s**2 - 2 * r * s * np.cos(angle) + z**2) ** 2.5,
        0, 1, 0, 2 * np.pi,
    )[0]  # fmt: skip
    at_point = np.array([r])
    assert pressures.exact_normal_stress_below_contact(1, at_point, z)[0] == pytest.approx(
        2 * z**3 / np.pi * plane_integral
    )
    exact = pressures.exact_normal_stress_below_contact(2, at_point, z)[0]
    assert exact == pytest.approx(3 * z**3 / (2 * np.pi) * space_integral, rel=1e-6)


def test_a_submodel_below_the_exact_pressure_has_the_exact_stress():
    submodel = pressures.solve_stress_in_refined_submodel("pw-T6", "exact", 8)
    assert submodel.stress == pytest.approx(submodel.exact, abs=2e-3)


@pytest.mark.parametrize("offset", [-1 / 3, 0.0, 1 / 3])
def test_shifted_mesh_lines_preserve_load_area_and_hertz_force(offset):
    """Integral quantities are preserved if mesh lines are shifted by a fraction of a cell.

    The nodal forces of the punch still sum to the load, and the weights of its nodes to the area of
    the face. The force of the Hertz contact, whose end moves within an edge, agrees with the exact
    force to 3 %.
    """
    punch = sliding.CondensedElasticPunch.from_element_and_mesh_size("pw-T6", 4, offset)
    force, _ = punch.forces(
        np.zeros(len(punch.load_displacement)), np.ones(len(punch.load_displacement), dtype=bool)
    )
    assert force.sum() == pytest.approx(sliding.MEAN_PRESSURE)
    assert punch.surface.weight_area.sum() == pytest.approx(1.0)
    contact = pressures.HertzContact.solve("pw-T6", 4, offset)
    exact = contact.problem.exact
    assert contact.force.sum() == pytest.approx(
        exact.peak_pressure * np.pi / 4, rel=0.03
    )  # of half of the contact


def test_quadrilaterals_agree_with_triangles_on_a_fine_mesh():
    """Wear, slip and impact computed with Q9 elements agree with those of triangles.

    The solutions with Q9 elements are references for the triangles. Their agreement with the new T6
    and, in impact, with its sibling shows that they solve the same problems.
    """
    depth = {
        element: sliding.wear_punch(element, "own", 16, 400).depth_at_half_path[0]
        for element in ("galerkin-Q9", "pw-T6")
    }
    assert depth["galerkin-Q9"] == pytest.approx(depth["pw-T6"], rel=1e-3)
    slips = [sliding.solve_partial_slip(e, "own", 16) for e in ("galerkin-Q9", "pw-T6")]
    assert slips[0].force == pytest.approx(slips[1].force, rel=1e-3)
    rebounds = [
        sliding.throw_block_at_rough_dome(e, 16).rebound_speed_ratio
        for e in ("galerkin-Q9", "sibling-T6")
    ]
    assert rebounds[0] == pytest.approx(rebounds[1], rel=5e-3)


def store_wear_answers(folder, standard_answers, new_answers, reference_uncertainty=0.001):
    """Store answers of the standard and the new T6 on three meshes; return the results.

    The first answer of an element is that of the unshifted meshes, the other two are those of
    meshes shifted in either direction. The reference answer is 1.
    """

    def save_result(name, parameters, scalars):
        result = Result(scalars, assign_unit_one_to_scalars(scalars), {}, dofs=1)
        save(folder, "W", name, result, parameters, {})

    scalars = {"answer": 1.0, "answer_uncertainty": reference_uncertainty}
    save_result(
        "reference-wear-T6", {"problem": "reference", "application": "wear", "cell": "T6"}, scalars
    )
    for element, answers in (("galerkin-T6", standard_answers), ("pw-T6", new_answers)):
        for mesh in (4, 8, 16):
            key = f"wear-{element}-{mesh}-own"
            case_parameters = {"element": element, "mesh": mesh, "reading": "own"}
            save_result(key, {"problem": "wear", **case_parameters}, {"answer": answers[0]})
            save_result(
                f"shifted-{key}",
                {"problem": "shifted", "application": "wear", **case_parameters},
                {"answer_before": answers[1], "answer_beyond": answers[2]},
            )
    return Results(folder)


def test_answer_band_is_the_middle_of_shifted_answers_plus_minus_their_range(tmp_path):
    results = store_wear_answers(tmp_path, (1.02, 1.03, 1.04), (1.0, 1.001, 0.999))
    wear_arguments = (results, "wear", "T6", "")
    assert engineering.answer_band_of_shifted_meshes(*wear_arguments, False, 0) == pytest.approx(
        (1.01, 1.05)
    )
    assert engineering.error_range_of_answer_band(*wear_arguments, False, 0) == pytest.approx(
        (0.009, 0.051)
    )
    assert engineering.error_range_of_answer_band(*wear_arguments, True, 0) == pytest.approx(
        (0.0, 0.003)
    )
    assert engineering.answer_changes(*wear_arguments, 0)
    assert engineering.is_error_ratio_resolved(*wear_arguments, 0)
    assert engineering.n_changed_answers(results, 2) == 1


@pytest.mark.parametrize(
    "new_answers",
    [(1.0, 1.02, 1.01), (1.012, 1.0125, 1.0115)],
    ids=["overlapping", "nearer than 1 %"],
)
def test_answer_is_unchanged_if_bands_overlap_or_are_nearer_than_1_percent(tmp_path, new_answers):
    results = store_wear_answers(tmp_path, (1.02, 1.021, 1.019), new_answers)
    assert not engineering.answer_changes(results, "wear", "T6", "", 0)


def test_error_ratio_is_not_resolved_with_an_uncertain_reference(tmp_path):
    results = store_wear_answers(
        tmp_path, (1.02, 1.021, 1.019), (1.0, 1.001, 0.999), reference_uncertainty=0.02
    )
    assert engineering.answer_changes(results, "wear", "T6", "", 0)
    assert not engineering.is_error_ratio_resolved(results, "wear", "T6", "", 0)


def test_cases_have_three_meshes_and_shifted_ones_of_each_best_reading():
    names = {case.name for case in page.CASES}
    for problem, meshes_by_cell in page.MESHES.items():
        for cell, mesh_sizes in meshes_by_cell.items():
            assert len(mesh_sizes) == 3
            for element in pressures.standard_and_new_element(problem, cell):
                for reading in page.candidate_best_pressure_rules(problem, element):
                    for mesh in mesh_sizes:
                        key = f"{problem}-{element}-{mesh}-{reading}"
                        assert {key, f"shifted-{key}"} <= names

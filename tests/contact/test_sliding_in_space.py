"""Two sides in space that slide on each other: mortar integrals, slips, derivatives, paths."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pw_elements.contact.interface import SpaceSlidingMortar, compute_tributary_areas
from pw_elements.contact.interface.mortars.space.projection import TIE_BREAKING_SHIFT
from pw_elements.contact.interface.mortars.space.quadrilaterals import evaluate_weights_at_points
from tests.contact.sides_in_space import (
    compare_mortar_with_verification,
    make_facets_of_height_field,
    make_mortar_of_curved_sides,
    make_mortar_of_flat_sides,
    slave_mask,
)
from tests.oracle.sliding_in_space import mortar_matrices_normals_and_areas

# numbers of vertices of the facets of slave and master
FACET_PAIRINGS = [(3, 3), (3, 4), (4, 3), (4, 4)]
# Largest difference of integrals by two quadratures over quadrilaterals that are no parallelograms
QUADRATURE_ERROR = 1e-9


def make_disturbed_start_and_end_positions(seed, n_corners=(3, 3)):
    """Return a mortar, and randomly disturbed positions (n, 3) of its nodes at start and end.

    Some slave nodes face the master at the end only.
    """
    mortar = make_mortar_of_curved_sides(seed, n_corners=n_corners)
    rng = np.random.default_rng([11, seed])
    end = mortar.x + rng.normal(size=mortar.x.shape) * 0.004
    start = end + rng.normal(size=end.shape) * 0.01 - slave_mask(mortar) * [0.7, 0.2, 0.0]
    return mortar, start, end


def forbid_components_at_two_edges(mortar):
    """Restrict normals at two edges of the slave to planes of symmetry."""
    for axis in (0, 1):
        x = mortar.x[: mortar.n_slave_nodes, axis]
        mortar.allowed_components[np.isclose(x, x.min()), axis] = False


@pytest.mark.parametrize("n_corners", FACET_PAIRINGS)
@pytest.mark.parametrize("seed", range(2))
def test_mortar_derivatives_agree_with_central_differences(seed, n_corners):
    """Derivatives in random directions agree with central differences to 1e-7.

    With odd seeds, normals at two edges of the slave lie in planes of symmetry.
    """
    mortar, start, x = make_disturbed_start_and_end_positions(seed, n_corners)
    if seed % 2:
        forbid_components_at_two_edges(mortar)
    reference, projected = mortar.make_slip_reference(start), mortar.linearise(x)
    rng, faced, h = np.random.default_rng(seed), projected.faces_master, 1e-6
    assert (faced & ~reference.is_facing_master).any()
    assert (faced & reference.is_facing_master).any()
    force, tangents = rng.normal(size=(mortar.n_slave_nodes, 3)), projected.directions.tangents

    def evaluate_mortar_quantities(x):
        projected = mortar.linearise(x)
        slip, _ = projected.measure_slip_and_motion_derivatives(reference, x)
        slip_vectors = np.einsum("mt,mtx->mx", slip, projected.directions.tangents)
        along_tangents = [
            np.sum(tangents[:, i] * vectors, axis=1)[faced]
            for vectors in (slip_vectors, projected.normals)
            for i in (0, 1)
        ]
        return [
            (projected.master_fractions.T @ force).ravel(),
            projected.mean_distance.ravel(),
            projected.gaps[faced],
            *along_tangents,
        ]

    _, motion_derivatives = projected.measure_slip_and_motion_derivatives(reference, x)
    derivatives = [
        projected.differentiate_master_forces(force),
        projected.distance_rate,
        *(derivative[faced] for derivative in motion_derivatives),
    ]
    for _ in range(6):
        direction = rng.normal(size=x.shape)
        ends = [evaluate_mortar_quantities(x + sign * h * direction) for sign in (1, -1)]
        for derivative, forward, backward in zip(derivatives, *ends, strict=True):
            expected = derivative @ direction.ravel()
            error = np.abs((forward - backward) / (2 * h) - expected).max()
            assert error < 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize("n_corners", FACET_PAIRINGS)
@pytest.mark.parametrize("seed", range(6))
def test_the_verification_agrees_with_the_mortar(seed, n_corners):
    """The independent verification and the mortar compute the same integrals for disturbed sides.

    The sides are shifted and rotated, so that they overlap partly.
    """
    mortar = make_mortar_of_curved_sides(seed, n_corners=n_corners)
    tolerance = 1e-12 if n_corners == (3, 3) else QUADRATURE_ERROR
    if seed % 2:
        forbid_components_at_two_edges(mortar)
    rng, is_slave = np.random.default_rng([13, seed]), slave_mask(mortar)
    shifts = rng.uniform(-0.9, 0.9, (2, 3)) * [1.0, 1.0, 0.05]
    positions = [
        (mortar.x + is_slave * shift + rng.normal(size=mortar.x.shape) * 0.006)
        @ Rotation.random(random_state=rng).as_matrix().T
        for shift in shifts
    ]
    for start, end in (positions, positions[::-1]):
        assert max(compare_mortar_with_verification(mortar, start, end).values()) < tolerance
    n_faced = sum(mortar.linearise(x).faces_master.sum() for x in positions)
    assert 0 < n_faced < 2 * mortar.n_slave_nodes


MATCHING_SIDES = {
    "same meshes": ((2, 2), (0.0, 0.0), (1.0, 1.0)),
    "same vertices, partly covered": ((2, 4), (0.75, 0.5), (0.5, 1.0)),
    "slave nodes on master edges": ((4, 2), (0.25, 0.25), (0.5, 1.0)),
    "edges on edges": ((3, 2), (0.0, 0.0), (1.0, 1.0)),
}


@pytest.mark.parametrize(
    ("disturbance", "tolerance"), [(0.0, 1e-12), (1e-12, 3e-11), (1e-4, 1e-12)]
)
@pytest.mark.parametrize("n_corners", FACET_PAIRINGS)
@pytest.mark.parametrize("name", MATCHING_SIDES)
def test_the_verification_agrees_where_vertices_or_edges_coincide(
    name, n_corners, disturbance, tolerance
):
    """Both agree for coinciding vertices and edges, which may be displaced at random.

    Displacements below the tie-breaking shift of 1e-11 edge lengths may change integrals by it.
    """
    mortar = make_mortar_of_flat_sides(*MATCHING_SIDES[name], n_corners=n_corners)
    rng = np.random.default_rng(17)
    x = mortar.x + rng.normal(size=mortar.x.shape) * disturbance
    rotated_x = x @ Rotation.from_rotvec([0.7, 1.1, -0.5]).as_matrix().T
    for start, end in ((mortar.x, x), (rotated_x, rotated_x)):
        assert max(compare_mortar_with_verification(mortar, start, end).values()) < tolerance


@pytest.mark.parametrize("n_corners", [3, 4])
@pytest.mark.parametrize("seed", range(1, 3))
def test_the_verification_agrees_on_a_closed_seam_of_curved_matching_meshes(seed, n_corners):
    """Both sides of a curved cut through one body have the same nodes."""

    def height(x, y):
        return 0.3 * np.sin(2 * x + seed) * np.cos(y)

    slave, master = (
        make_facets_of_height_field(
            3, height, first, outward, jitter=0.03, seed=seed, n_corners=n_corners
        )
        for first, outward in ((0, -1.0), (1000, 1.0))
    )
    mortar = SpaceSlidingMortar(slave, master)
    x = mortar.x + slave_mask(mortar) * [1e-8, 0.0, 0.0]
    tolerance = 1e-12 if n_corners == 3 else QUADRATURE_ERROR
    for start, end in ((mortar.x, mortar.x), (mortar.x, x)):
        assert max(compare_mortar_with_verification(mortar, start, end).values()) < tolerance
    assert np.abs(mortar.linearise(mortar.x).gaps).max() < 1e-12


@pytest.mark.parametrize("name", MATCHING_SIDES)
def test_one_sided_derivatives_of_coinciding_sides_are_consistent(name):
    """Where vertices or edges coincide, derivatives are one-sided and belong to one direction.

    On each slave triangle, all parts' derivatives in the direction of the tie-breaking shift, and
    in directions near it, equal forward differences of the integrals.
    """
    mortar, h = make_mortar_of_flat_sides(*MATCHING_SIDES[name]), 1e-5
    x, rng = mortar.x, np.random.default_rng(19)
    n = len(x)

    def integrate_over_slave_triangle(x, triangle):
        """Return integrals (9, n + 6) of products on a triangle, and their derivatives."""
        parts = mortar._integrate_over_facing_parts(x)
        values, rates = np.zeros((6 + 3 * n,)), np.zeros((6 + 3 * n, n, 3))
        for q in np.flatnonzero(parts.slave_facet == triangle):
            mixed_rates = parts.mixed_products_rate[q].reshape(3, 3, 6, 3)
            values[:6] += parts.slave_products[q]
            rates[:6, parts.nodes[q]] += parts.slave_products_rate[q].reshape(6, 6, 3)
            for i in range(3):
                row = 6 + n * i + parts.master_nodes[q]
                values[row] += parts.mixed_products[q, i]
                for k in range(3):
                    rates[row[k], parts.nodes[q]] += mixed_rates[i, k]
        return values, rates

    for triangle in rng.choice(len(mortar.sides.slave_sub_facets), 6, replace=False):
        corners = x[mortar.sides.slave_sub_facets[triangle]]
        shift = TIE_BREAKING_SHIFT @ (corners[1:] - corners[0])
        direction = np.where(slave_mask(mortar), 0.0, shift / np.linalg.norm(shift))
        direction = direction + 0.03 * rng.normal(size=x.shape)
        start, once, twice = (
            integrate_over_slave_triangle(x + k * h * direction, triangle)[0] for k in range(3)
        )
        _, rates = integrate_over_slave_triangle(x, triangle)
        forward = (4 * once - 3 * start - twice) / (2 * h)
        assert np.abs(rates.reshape(-1, 3 * n) @ direction.ravel() - forward).max() < 1e-8


@pytest.mark.parametrize("name", MATCHING_SIDES)
def test_covered_areas_do_not_change_with_tangential_motions_of_a_covering_master(name):
    """Wholly covered areas do not change if single nodes of the flat master move along it."""
    mortar = make_mortar_of_flat_sides(*MATCHING_SIDES[name])
    parts = mortar._integrate_over_facing_parts(mortar.x)
    corners = mortar.x[mortar.sides.slave_sub_facets]
    inside = (np.abs(corners[..., :2]) < 1 - 1e-9).all(axis=(1, 2))
    assert inside.any()
    is_square = [0, 3, 5]  # numbers of products of a weight function with itself
    area_rates = np.zeros((len(corners), *mortar.x.shape))
    by_part = (2 * parts.slave_products_rate.sum(axis=1)) - parts.slave_products_rate[
        :, is_square
    ].sum(axis=1)
    for facet, nodes, rate in zip(parts.slave_facet, parts.nodes, by_part, strict=True):
        area_rates[facet, nodes] += rate.reshape(6, 3)
    tangential = area_rates[inside][:, mortar.n_slave_nodes :, :2]
    assert np.abs(tangential).max() < 1e-14 < np.abs(area_rates).max()


@pytest.mark.parametrize("n_corners", FACET_PAIRINGS)
@pytest.mark.parametrize("seed", range(2))
def test_a_rigid_motion_of_both_bodies_is_no_slip(seed, n_corners):
    """A rigid motion of both bodies together causes no slip, and keeps paired points paired."""
    mortar, _, x = make_disturbed_start_and_end_positions(seed, n_corners)
    end = x @ Rotation.random(random_state=seed).as_matrix().T + [3.0, -2.0, 1.0]
    start, projected = mortar.make_slip_reference(x), mortar.linearise(end)
    assert abs(projected.distance_rows - start.distance_rows).max() < 1e-13
    slip, _ = projected.measure_slip_and_motion_derivatives(start, end)
    assert np.abs(slip).max() < 1e-13


def make_unfaced(reference):
    """Return a reference of slip in which no node faces the master."""
    return replace(
        reference,
        distance_rows=0.0 * reference.distance_rows,
        is_facing_master=np.zeros_like(reference.is_facing_master),
    )


def rotate_about(x, rotation_vector, centre=(0.0, 0.0, 0.0)):
    """Return positions (n, 3) after a rotation about a centre."""
    return Rotation.from_rotvec(rotation_vector).apply(x - np.array(centre)) + centre


@pytest.mark.parametrize(
    "rotation", [[0.9, 0.0, 0.0], [0.7, -1.6, 0.0], [0.0, 0.0, 0.3], [1.1, -1.2, 2.0]]
)
def test_nodes_that_faced_nothing_at_the_start_do_not_slip_in_a_rigid_motion(rotation):
    """This holds for any distance from the master at the start, on flat and on curved sides."""
    for mortar in (
        make_mortar_of_flat_sides((3, 2), (0.83, 0.31), gap=0.02),
        make_mortar_of_curved_sides(),
    ):
        for shift in ([0.0, 0.0, 0.0], [0.4, -0.3, 0.1]):
            x = mortar.x + slave_mask(mortar) * shift
            end = rotate_about(x, rotation) + np.array([3.0, -2.0, 1.0])
            start, projected = make_unfaced(mortar.make_slip_reference(x)), mortar.linearise(end)
            assert projected.faces_master.sum() > 10
            slip, _ = projected.measure_slip_and_motion_derivatives(start, end)
            assert np.abs(slip).max() < 1e-13


@pytest.mark.parametrize("common_rotation", [[0.0, 0.0, 0.3], [0.8, -1.1, 1.7]])
def test_slip_of_nodes_that_faced_nothing_turns_with_both_bodies(common_rotation):
    """A rotation of both bodies turns slips and does not change them; other nodes do the same.

    The slave comes from beside the master, and both sides are deformed.
    """
    mortar, start_x, x = make_disturbed_start_and_end_positions(0)
    reference = mortar.make_slip_reference(start_x)
    turned_x = rotate_about(x, common_rotation)
    slips = []
    for end in (x, turned_x):
        projected = mortar.linearise(end)
        assert (projected.faces_master & ~reference.is_facing_master).sum() > 5
        slip, _ = projected.measure_slip_and_motion_derivatives(reference, end)
        slips.append(np.einsum("mt,mtx->mx", slip, projected.directions.tangents))
    assert np.abs(slips[0]).max() > 0.5
    assert np.abs(rotate_about(slips[0], common_rotation) - slips[1]).max() < 1e-13


@pytest.mark.parametrize(
    ("slave_twist", "master_twist"), [(0.3, 0.3), (0.4, 0.0), (0.0, 0.4), (-0.5, 0.7)]
)
def test_slip_does_not_depend_on_whether_nodes_faced_the_master_at_the_start(
    slave_twist, master_twist
):
    """Rigid flat sides in contact slide on each other, and each is twisted about the normal."""
    mortar = make_mortar_of_flat_sides((3, 2), (0.1, -0.1), half_widths=(0.4, 1.0))
    tilt = Rotation.from_rotvec([0.5, -0.3, 0.1])
    twisted = np.where(
        slave_mask(mortar),
        rotate_about(np.add(mortar.x, [0.2, 0.1, 0.0]), [0.0, 0.0, slave_twist], (0.5, 0.3, 0.0)),
        rotate_about(mortar.x, [0.0, 0.0, master_twist], (-0.1, 0.4, 0.0)),
    )
    end, start = tilt.apply(twisted), mortar.make_slip_reference(mortar.x)
    projected = mortar.linearise(end)
    assert start.is_facing_master.all()
    assert projected.faces_master.all()
    slip, unfaced_slip = (
        projected.measure_slip_and_motion_derivatives(reference, end)[0]
        for reference in (start, make_unfaced(start))
    )
    assert np.abs(unfaced_slip - slip).max() < 1e-13
    assert np.linalg.norm(slip, axis=1).max() > (0.1 if slave_twist != master_twist else 0.01)


@pytest.mark.parametrize("n_corners", FACET_PAIRINGS)
def test_linear_fields_are_transferred_exactly_and_fractions_add_up_to_one(n_corners):
    """Linear fields are transferred exactly between flat sides that overlap partly.

    Fractions of forces add up to one also on curved sides.
    """
    mortar = make_mortar_of_flat_sides((3, 2), (0.83, 0.31), gap=0.02, n_corners=n_corners)
    projected = mortar.linearise(mortar.x)
    faced = projected.faces_master
    assert 0 < faced.sum() < len(faced)
    fields = mortar.x[:, :2] @ [[3.0, 0.5], [-2.0, 1.0]] - 1.0
    assert np.abs((projected.distance_rows @ fields)[faced]).max() < 1e-12
    assert np.abs(projected.gaps[faced] - 0.02).max() < 1e-13
    # the resultant moment of forces with a linear distribution is kept
    force = projected.areas * (1 + fields[: mortar.n_slave_nodes, 0])
    slave_x, master_x = mortar.x[: mortar.n_slave_nodes], mortar.x[mortar.n_slave_nodes :]
    received = projected.master_fractions.T @ force
    assert np.abs(received @ master_x[:, :2] - force @ slave_x[:, :2]).max() < 1e-12
    for seed in range(3):
        curved, _, x = make_disturbed_start_and_end_positions(seed, n_corners)
        projected = curved.linearise(x)
        fractions = projected.master_fractions.sum(axis=1)
        assert np.abs(fractions - projected.faces_master).max() < 1e-12


@pytest.mark.parametrize("n_corners", FACET_PAIRINGS)
def test_a_uniform_pressure_is_transferred_exactly_between_distorted_flat_meshes(n_corners):
    """Nodes of the master that are wholly covered receive the integrals of their weights."""
    slave, master = (
        make_facets_of_height_field(
            n_cells,
            lambda x, _: 0 * x,
            first_node,
            outward,
            half_width=half_width,
            jitter=0.02,
            seed=n_cells,
            n_corners=n,
        )
        for n_cells, first_node, outward, half_width, n in (
            (4, 0, -1.0, 0.9, n_corners[0]),
            (3, 1000, 1.0, 1.0, n_corners[1]),
        )
    )
    mortar = SpaceSlidingMortar(slave, master)
    projected = mortar.linearise(mortar.x)
    received = projected.master_fractions.T @ projected.areas
    areas = compute_tributary_areas(master, revolved=False)
    inner = np.abs(mortar.x[mortar.n_slave_nodes :, :2]).max(axis=1) < 0.5
    assert inner.sum() > 8
    assert np.abs(received / areas - 1)[inner].max() < QUADRATURE_ERROR
    assert np.abs(projected.areas / compute_tributary_areas(slave, revolved=False) - 1).max() < 1e-9


@pytest.mark.parametrize("n_corners", FACET_PAIRINGS)
def test_integrals_agree_with_those_of_plain_loops(n_corners):
    """The oracle of the tests computes the same normals, areas, distances and fractions."""
    mortar = make_mortar_of_curved_sides(1, (2, 2), n_corners=n_corners)
    x = mortar.x + np.random.default_rng(23).normal(size=mortar.x.shape) * 0.006
    x -= slave_mask(mortar) * [0.8, 0.6, 0.0]
    sides, m = mortar.sides, mortar.n_slave_nodes
    slave = sides.slave_sub_facets, np.repeat(sides.slave_facets, 4, axis=0)
    master = sides.master_sub_facets, np.repeat(sides.master_facets, 4, axis=0)
    fractions, distances, normals, areas = mortar_matrices_normals_and_areas(x, slave, master, m)
    projected = mortar.linearise(x)
    assert 0 < projected.faces_master.sum() < m
    assert np.abs(projected.normals - normals).max() < 1e-13
    for values, expected in (
        (projected.areas, areas),
        (projected.areas[:, None] * projected.distance_rows.toarray(), areas[:, None] * distances),
        (
            projected.areas[:, None] * projected.master_fractions.toarray(),
            areas[:, None] * fractions,
        ),
    ):
        assert np.abs(values - expected).max() < QUADRATURE_ERROR * areas.max()


@pytest.mark.parametrize("shear", [0.0, 0.3, 0.6, 0.95])
def test_weights_at_points_of_quadrilaterals_reproduce_the_points(shear):
    """Bilinear functions are inverted up to where a quadrilateral becomes concave."""
    corners = np.array([[[0.0, 0.0], [1.0, 0.1], [1 - 0.5 * shear, 1 - 0.5 * shear], [-0.2, 0.9]]])
    u = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 2))
    (x0, y0), (x1, y1) = (0.5 - u).T, (0.5 + u).T
    expected = np.stack([x0 * y0, x1 * y0, x1 * y1, x0 * y1], axis=1)
    weights = evaluate_weights_at_points(corners, (expected @ corners[0])[None])
    assert np.abs(weights[0] - expected).max() < 1e-13


@pytest.mark.parametrize("seed", range(3))
def test_closest_points_are_closer_than_all_sampled_points(seed):
    """The points are spread over the master and around it."""
    mortar, x, _ = make_disturbed_start_and_end_positions(seed)
    points = np.random.default_rng(seed).uniform(-1, 1, (mortar.n_slave_nodes, 3)) * [1.2, 1.2, 0.3]
    start = np.concatenate([points, x[mortar.n_slave_nodes :]])
    corners, weights = mortar._find_closest_master_points(start)
    assert (weights >= 0).all()
    assert np.abs(weights.sum(axis=1) - 1).max() < 1e-14
    triangles = {tuple(sorted(triangle)) for triangle in mortar.sides.master_sub_facets.tolist()}
    assert {tuple(sorted(triangle)) for triangle in corners.tolist()} <= triangles
    closest = np.einsum("mk,mkx->mx", weights, start[corners])
    i, j = np.triu_indices(41)
    samples = np.stack([i, j - i, 40 - j], axis=1) / 40
    sampled = np.einsum("sk,tkx->tsx", samples, start[mortar.sides.master_sub_facets])
    distance = np.linalg.norm(points[:, None] - sampled.reshape(-1, 3), axis=2).min(axis=1)
    found = np.linalg.norm(points - closest, axis=1)
    assert (found < distance + 1e-14).all()
    assert set((weights > 0).sum(axis=1)) == {1, 2, 3}  # on vertices, edges and triangles


@pytest.mark.parametrize("n_corners", [(3, 3), (4, 4)])
def test_the_depth_of_penetration_is_measured_inside_the_rim_of_a_side(n_corners):
    """The depth of penetration is measured at nodes that pass within the rim of the other side.

    It is zero for nodes that were not outside the other body at the start.
    """
    mortar = make_mortar_of_flat_sides(
        (2, 2), half_widths=(1.0, 1.0), gap=0.02, n_corners=n_corners
    )
    is_slave, n = slave_mask(mortar), mortar.n_slave_nodes
    lowered_x = mortar.x - is_slave * [0.0, 0.0, 0.52]
    depth = mortar.measure_max_penetration_along_path(mortar.x, lowered_x)
    on_rim = np.isclose(np.abs(mortar.x[:n, :2]).max(axis=1), 1.0)
    assert depth[~on_rim] == pytest.approx(0.5)
    assert not depth[on_rim].any()
    shifted_x = mortar.x + is_slave * [2.5, 0.0, 0.0]
    assert not mortar.measure_max_penetration_along_path(
        shifted_x, shifted_x - is_slave * [0.0, 0.0, 0.52]
    ).any()
    assert not mortar.measure_max_penetration_along_path(lowered_x, lowered_x).any()
    # a single node is driven through the other side and out behind it, and then comes back
    node = np.flatnonzero(~on_rim)[3]
    moved_x = mortar.x.copy()
    moved_x[node, 2] -= 3.0
    depth = mortar.measure_max_penetration_along_path(mortar.x, moved_x)
    assert depth[node] == pytest.approx(2.98)
    assert not np.delete(depth, node).any()


@pytest.mark.parametrize("n_corners", FACET_PAIRINGS)
def test_slip_agrees_with_that_of_the_path_of_a_straight_slide(n_corners):
    """On flat sides, both slips equal the relative motion, also if both bodies rotate besides."""
    mortar = make_mortar_of_flat_sides(
        (2, 3), half_widths=(0.4, 1.0), gap=0.01, n_corners=n_corners
    )
    motion = np.array([0.23, -0.11, 0.0])
    end = mortar.x + slave_mask(mortar) * motion
    slip, _ = mortar.linearise(end).measure_slip_and_motion_derivatives(
        mortar.make_slip_reference(mortar.x), end
    )
    tangents = mortar.linearise(end).directions.tangents
    path_slip = mortar.integrate_slip_along_path(mortar.x, end)
    assert np.abs(np.einsum("mt,mtx->mx", slip, tangents) - motion).max() < 1e-13
    assert np.abs(path_slip - motion).max() < 1e-13
    # a common translation is no slip
    assert np.abs(mortar.integrate_slip_along_path(mortar.x, mortar.x + motion)).max() < 1e-13


@pytest.mark.parametrize("n_corners", [(3, 3), (4, 4)])
@pytest.mark.parametrize(("common_angle", "twist"), [(0.6, 0.0), (0.0, 0.6), (-0.5, 1.0)])
def test_slip_agrees_with_that_of_the_path_if_bodies_turn_about_their_normal(
    common_angle, twist, n_corners
):
    """On flat sides, slips differ by an eleventh of the square of the master's angle at most.

    Both sides turn by a common angle, and the slave by a twist besides. Some of its nodes come from
    beside the master. Nodes at the rim of a side do not count: the slip is that of a mean position.
    """
    mortar = make_mortar_of_flat_sides(
        (3, 3), (0.9, 0.1), half_widths=(0.4, 1.0), gap=0.01, n_corners=n_corners
    )
    twisted_x = rotate_about(mortar.x, [0.0, 0.0, twist], (0.9, 0.1, 0.0)) - [0.6, -0.1, 0.0]
    end = rotate_about(np.where(slave_mask(mortar), twisted_x, mortar.x), [0.0, 0.0, common_angle])
    reference, projected = mortar.make_slip_reference(mortar.x), mortar.linearise(end)
    assert 0 < reference.is_facing_master.sum() < projected.faces_master.sum()
    slip, _ = projected.measure_slip_and_motion_derivatives(reference, end)
    slip = np.einsum("mt,mtx->mx", slip, projected.directions.tangents)
    difference = slip - mortar.integrate_slip_along_path(mortar.x, end)
    x = mortar.x[: len(slip), :2]
    inner = (np.abs(x - [0.9, 0.1]).max(axis=1) < 0.39) & (np.abs(x[:, 0] - 1) > 0.8 / 6)
    assert (inner & ~reference.is_facing_master).any()
    length, error = (np.linalg.norm(values[inner], axis=1) for values in (slip, difference))
    assert (error < (common_angle**2 / 11 + 1e-12) * length.max()).all()


@pytest.mark.parametrize("shape", ["cylinder", "ball"])
def test_slip_agrees_with_that_of_the_path_to_second_order_on_curved_sides(shape):
    """On a cylinder or ball of radius 1, the slips differ by a fraction of angle^2 / 6.

    The slave rotates about the cylinder's axis or the ball's centre. The path's slip is the length
    of the arc, and the slip that of its projection onto the tangent plane.
    """

    def height(x, y):
        return np.sqrt(1 - x**2 - (y**2 if shape == "ball" else 0 * y))

    slave = make_facets_of_height_field(4, height, 0, -1.0, half_width=0.15)
    master = make_facets_of_height_field(10, height, 1000, 1.0, half_width=0.6)
    mortar, errors = SpaceSlidingMortar(slave, master), []
    is_slave, n = slave_mask(mortar), mortar.n_slave_nodes
    inner = np.abs(mortar.x[:n, :2]).max(axis=1) < 0.14
    for angle in (0.3, 0.15):
        rotation = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
        end = np.where(is_slave, mortar.x @ rotation.T, mortar.x)
        reference, projected = mortar.make_slip_reference(mortar.x), mortar.linearise(end)
        slip, _ = projected.measure_slip_and_motion_derivatives(reference, end)
        slip = np.einsum("mt,mtx->mx", slip, projected.directions.tangents)
        path_slip = mortar.integrate_slip_along_path(mortar.x, end)
        radius = np.linalg.norm(mortar.x[:n, [0, 2]], axis=1)
        length = np.linalg.norm(path_slip, axis=1)
        assert np.abs(length / (radius * angle) - 1)[inner].max() < 0.02
        errors.append(np.mean(np.linalg.norm(slip - path_slip, axis=1)[inner] / length[inner]))
    assert errors[0] == pytest.approx(0.3**2 / 6, rel=0.15)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)

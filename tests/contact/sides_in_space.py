"""Two sides of quadratic triangles in space, and comparisons of their mortar integrals."""

import numpy as np

from pw_elements.contact.interface import (
    BoundaryFacets,
    SpaceSlidingMortar,
    measure_gap_and_slip,
)


def make_facets_of_height_field(
    n_cells,
    height,
    first_node,
    outward_z,
    centre=(0.0, 0.0),
    half_width=1.0,
    jitter=0.0,
    seed=0,
    n_corners=3,
):
    """Return the facets of a surface z = height(x, y) over a square.

    There are `n_cells`^2 quadrilaterals, or twice as many triangles if `n_corners` is 3. Nodes
    inside the square are displaced at random in x and y, by `jitter` on average.
    """
    n, rng = 2 * n_cells + 1, np.random.default_rng(seed)
    line = np.linspace(-half_width, half_width, n)
    x = np.stack([*np.meshgrid(line, line, indexing="ij"), np.zeros((n, n))], axis=2)
    x[..., :2] += centre
    x[1:-1, 1:-1, :2] += rng.normal(size=(n - 2, n - 2, 2)) * jitter
    x[..., 2] = height(x[..., 0], x[..., 1])
    if n_corners == 4:
        # vertices in tensor-product order, middles of edges, and centre
        vertices = [(0, 0), (2, 0), (0, 2), (2, 2)]
        local = [[*vertices, (1, 0), (0, 1), (2, 1), (1, 2), (1, 1)]]
    else:
        # vertices of both triangles of a cell, followed by the middles of the opposite edges
        triangles = ((0, 0), (2, 0), (2, 2)), ((0, 0), (2, 2), (0, 2))
        local = [
            [*t, *((np.add(t[i], t[j]) // 2) for i, j in ((1, 2), (0, 2), (0, 1)))]
            for t in triangles
        ]
    corner = 2 * np.stack(np.meshgrid(*[np.arange(n_cells)] * 2, indexing="ij"), -1).reshape(
        -1, 1, 1, 2
    )
    i, j = np.moveaxis((corner + np.array(local)).reshape(-1, len(local[0]), 2), -1, 0)
    return BoundaryFacets(
        first_node + n * i + j, x[i, j], np.tile([0.0, 0.0, outward_z], (len(i), 1))
    )


def make_mortar_of_curved_sides(
    seed=0, n_cells=(3, 2), centre=(0.13, 0.07), half_width=0.6, n_corners=(3, 3)
):
    """Return the mortar of a curved side above a larger curved side with another mesh.

    The facets of both sides have `n_corners` vertices.
    """
    slave = make_facets_of_height_field(
        n_cells[0],
        lambda x, y: 0.02 + 0.1 * (x**2 + y**2),
        0,
        -1.0,
        centre,
        half_width,
        jitter=0.02,
        seed=2 * seed,
        n_corners=n_corners[0],
    )
    master = make_facets_of_height_field(
        n_cells[1],
        lambda x, y: 0.08 * np.sin(2 * x) * np.cos(y),
        1000,
        1.0,
        half_width=0.8,
        jitter=0.02,
        seed=2 * seed + 1,
        n_corners=n_corners[1],
    )
    return SpaceSlidingMortar(slave, master)


def make_mortar_of_flat_sides(
    n_cells, centre=(0.0, 0.0), half_widths=(0.5, 1.0), gap=0.0, n_corners=(3, 3)
):
    """Return the mortar of two parallel flat sides with regular meshes."""
    slave = make_facets_of_height_field(
        n_cells[0],
        lambda x, _: gap + 0 * x,
        0,
        -1.0,
        centre,
        half_widths[0],
        n_corners=n_corners[0],
    )
    master = make_facets_of_height_field(
        n_cells[1],
        lambda x, _: 0 * x,
        1000,
        1.0,
        half_width=half_widths[1],
        n_corners=n_corners[1],
    )
    return SpaceSlidingMortar(slave, master)


def slave_mask(mortar):
    """Return the mask (n, 1) of the slave's nodes among all nodes of a mortar."""
    return (np.arange(len(mortar.x)) < mortar.n_slave_nodes)[:, None]


def compare_mortar_with_verification(mortar, start_positions, end_positions):
    """Return the largest differences between the mortar integrals of verification and iteration.

    The nodes move from `start_positions` (n, 3) to `end_positions` (n, 3). Lengths are divided by
    the longest edge of the slave, and integrals by the largest nodal area.
    """
    projected, projected_start = mortar.linearise(end_positions), mortar.linearise(start_positions)
    slip, _ = projected.measure_slip_and_motion_derivatives(
        mortar.make_slip_reference(start_positions), end_positions
    )
    start, end = (
        mortar.evaluate_mortar_matrices_independently(x) for x in (start_positions, end_positions)
    )
    gap, slip_vector = measure_gap_and_slip(start, end, start_positions, end_positions)
    assert np.array_equal(start.faces_master, projected_start.faces_master)
    assert np.array_equal(np.isfinite(gap), projected.faces_master)
    corners = end_positions[mortar.sides.slave_sub_facets]
    length = np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=2).max()
    slip = np.einsum("mt,mtx->mx", slip, projected.directions.tangents)
    slip[~projected.faces_master] = 0.0
    largest_area = projected.areas.max(initial=1e-300)

    def largest_integral_difference(name):
        values, expected = (
            mortar.areas[:, None] * getattr(mortar, name).toarray() for mortar in (projected, end)
        )
        return np.abs(values - expected).max() / largest_area

    return {
        "gap": np.abs(gap - projected.gaps)[projected.faces_master].max(initial=0.0) / length,
        "slip": np.abs(slip_vector - slip).max() / length,
        "normal": np.abs(end.normals - projected.normals).max(),
        "area": np.abs(end.areas - projected.areas).max() / largest_area,
        "distances": largest_integral_difference("distance_rows"),
        "fractions": largest_integral_difference("master_fractions"),
    }

"""Gaps and pressures between curved sides whose flat sub-triangles do not coincide.

`./run python3 -m tests.contact.test_faceting_in_space` prints the table of docs/theory.md.
"""

from dataclasses import replace
from functools import partial

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import Spaces
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from pw_elements.contact.interface import MortarMatrices, SpaceSlidingMortar
from pw_elements.elasticity import facet_nodes
from pw_elements.meshes import curved_mesh
from pw_elements.spaces import locate_exterior_facets
from tests.contact.cases import make_finite_strain_unknown_and_residual
from tests.contact.sides_in_space import make_facets_of_height_field
from tests.contact.two_bodies import join_meshes

BALL_RADIUS, CLEARANCE = 0.997, 0.003


def make_facets_of_unit_sphere(n_cells, first_node, outward_z, centre, half_width):
    """Return facets around the lowest point of the sphere, with the middles of edges on arcs."""
    facets = make_facets_of_height_field(
        n_cells,
        lambda x, y: -np.sqrt(1 - x**2 - y**2),
        first_node,
        outward_z,
        centre,
        half_width,
    )
    x = facets.facet_x.copy()
    middles = x[:, [1, 0, 0]] + x[:, [2, 2, 1]]
    x[:, 3:] = middles / np.linalg.norm(middles, axis=2, keepdims=True)
    return replace(facets, facet_x=x)


def test_gaps_between_two_meshes_of_one_sphere_fall_faster_than_h_cubed():
    """Gaps of flat sub-triangles would be up to .04 h^2 / R, and of second order."""
    largest_gaps = []
    for n_cells in (4, 8):
        slave = make_facets_of_unit_sphere(n_cells, 0, -1.0, (0.03, -0.02), 0.35)
        master = make_facets_of_unit_sphere(round(1.45 * n_cells), 10_000, 1.0, (0.0, 0.0), 0.6)
        mortar = SpaceSlidingMortar(slave, master)
        linearised = mortar.linearise(mortar.x)
        assert linearised.faces_master.all()
        largest_gaps.append(np.abs(linearised.gaps).max())
    element_size = 0.7 / 4
    assert largest_gaps[0] < 2e-3 * element_size**2
    assert largest_gaps[1] < largest_gaps[0] / 8


def measure_ripple_of_ball_in_socket(n_ball, n_socket, n_radial, is_flat):
    """Return the deviation of pressures from a quadratic function, divided by their mean.

    A ball is pressed by 4 % of its radius into a socket with another mesh. The deviation is the
    root mean square under the ball. There are `n_ball` and `n_socket` cells along the sides of the
    ball and of the socket, and `n_radial` along radii. If `is_flat`, distances are measured between
    flat sub-triangles.
    """
    inner_radius, outer_radius = 0.5, 1.8
    ball = create_box(
        MPI.COMM_SELF,
        [[-0.3, -0.3, inner_radius], [0.3, 0.3, BALL_RADIUS]],
        [n_ball, n_ball, n_radial],
        CellType.tetrahedron,
    )
    socket = create_box(
        MPI.COMM_SELF,
        [[-0.5, -0.5, BALL_RADIUS + CLEARANCE], [0.5, 0.5, outer_radius]],
        [n_socket, n_socket, n_radial],
        CellType.tetrahedron,
    )
    cos, sin = np.cos(0.4), np.sin(0.4)
    ball.geometry.x[:, :2] = ball.geometry.x[:, :2] @ np.array([[cos, sin], [-sin, cos]])

    def map_to_sphere(x):
        down = -np.sqrt(1 - x[:, 0] ** 2 - x[:, 1] ** 2)
        return np.column_stack([x[:, :2], down]) * x[:, 2:]

    mesh = curved_mesh(join_meshes(ball, socket), map_to_sphere)
    spaces = Spaces.petrov_galerkin(mesh)
    space = spaces.trial
    u, residual = make_finite_strain_unknown_and_residual(spaces)
    x = space.tabulate_dof_coordinates()

    def on_sphere(radius):
        return lambda x: np.isclose(np.linalg.norm(x[:3], axis=0), radius, atol=1e-6)

    prescribed = fem.Function(space)
    inner, outer = (
        fem.locate_dofs_geometrical(space, on_sphere(radius))
        for radius in (inner_radius, outer_radius)
    )
    supports = [fem.dirichletbc(prescribed, nodes) for nodes in (inner, outer)]
    under = facet_nodes(space, locate_exterior_facets(mesh, on_sphere(BALL_RADIUS)))
    pair = ContactPair(np.unique(under), DeformableSurface(on_sphere(BALL_RADIUS + CLEARANCE)))
    problem = ContactProblem.of_residual(residual, u, supports, pair)

    mortar = problem._large_strain_stepping.interface.mortars[0]
    if is_flat:
        mortar._second_differences = 0.0 * mortar._second_differences
        mortar.evaluate_mortar_matrices_independently = partial(_copy_matrices, mortar)

    def push_outwards(load_factor):
        values = prescribed.x.array.reshape(-1, 3)
        values[inner] = load_factor * 0.04 * x[inner] / inner_radius

    state = problem.step(problem.undeformed, push_outwards)
    (result,) = state.pairs
    deformed = mortar.x + state.displacement.array_r.reshape(-1, 3)[mortar.nodes]
    slave = np.searchsorted(mortar.nodes[: mortar.n_slave_nodes], result.node)
    pressure = result.force_normal / mortar.linearise(deformed).areas[slave]
    inside = np.hypot(*result.position[:, :2].T) < 0.22
    a, b = result.position[inside, :2].T
    powers = [a**i * b**j for i in range(3) for j in range(3 - i)]
    smooth = np.column_stack(powers)
    fitted = smooth @ np.linalg.lstsq(smooth, pressure[inside])[0]
    assert inside.sum() > 2 * len(powers)
    return np.std(pressure[inside] - fitted) / pressure[inside].mean()


def _copy_matrices(mortar, x):
    """Return the matrices of the iteration in place of those that verify a state."""
    linearised = mortar.linearise(x)
    return MortarMatrices(
        linearised.normals,
        linearised.areas,
        linearised.distance_rows,
        linearised.master_fractions,
        np.zeros(mortar.n_slave_nodes),
        mortar.sides.master_sub_facets,
    )


def test_a_ball_in_a_matching_socket_has_even_pressures():
    """Flat sub-triangles would give ripples that are several times as large."""
    ripple, flat_ripple = (
        measure_ripple_of_ball_in_socket(4, 5, 2, flat) for flat in (False, True)
    )
    assert ripple < 0.1
    assert ripple < flat_ripple / 4


if __name__ == "__main__":
    for n_ball, n_socket, n_radial in ((4, 5, 2), (6, 8, 2), (8, 11, 3)):
        ripples = [
            measure_ripple_of_ball_in_socket(n_ball, n_socket, n_radial, flat)
            for flat in (True, False)
        ]
        print(f"| {0.6 / n_ball:.3f} | {ripples[0]:.1%} | {ripples[1]:.1%} |", flush=True)

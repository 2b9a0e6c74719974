"""Gaps and pressures between curved sides whose flat sub-triangles do not coincide."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import Spaces
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from pw_elements.contact.interface import SpaceSlidingMortar
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


def test_a_ball_in_a_matching_socket_has_even_pressures():
    """A ball is pressed by 4 % of its radius into a socket with another mesh.

    The pressures under it deviate from a quadratic function by 5 % (root mean square) of their
    mean. If distances were measured between flat sub-triangles, they would deviate by 31 %.
    """
    n, inner_radius, outer_radius = 4, 0.5, 1.8
    ball = create_box(
        MPI.COMM_SELF,
        [[-0.3, -0.3, inner_radius], [0.3, 0.3, BALL_RADIUS]],
        [n, n, 2],
        CellType.tetrahedron,
    )
    socket = create_box(
        MPI.COMM_SELF,
        [[-0.5, -0.5, BALL_RADIUS + CLEARANCE], [0.5, 0.5, outer_radius]],
        [n + 1, n + 1, 2],
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

    def push_outwards(load_factor):
        values = prescribed.x.array.reshape(-1, 3)
        values[inner] = load_factor * 0.04 * x[inner] / inner_radius

    state = problem.step(problem.undeformed, push_outwards)
    (result,) = state.pairs
    mortar = problem._large_strain_stepping.interface.mortars[0]
    deformed = mortar.x + state.displacement.array_r.reshape(-1, 3)[mortar.nodes]
    slave = np.searchsorted(mortar.nodes[: mortar.n_slave_nodes], result.node)
    pressure = result.force_normal / mortar.linearise(deformed).areas[slave]
    inside = np.hypot(*result.position[:, :2].T) < 0.22
    a, b = result.position[inside, :2].T
    powers = [a**i * b**j for i in range(3) for j in range(3 - i)]
    smooth = np.column_stack(powers)
    fitted = smooth @ np.linalg.lstsq(smooth, pressure[inside])[0]
    ripple = np.std(pressure[inside] - fitted) / pressure[inside].mean()
    assert inside.sum() > 2 * len(powers)
    assert ripple < 0.1

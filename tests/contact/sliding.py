"""Two neo-Hookean bodies in one mesh that are pressed together and slid along each other."""

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle

from pw_elements import Body, Material, Spaces
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from pw_elements.contact.interface import measure_gap_and_slip
from tests.contact.cases import (
    list_states_and_substates,
    make_finite_strain_unknown_and_residual,
    on_plane,
)
from tests.contact.two_bodies import join_meshes


def mesh_of_two_rectangles(
    corners_of_lower, corners_of_upper, divisions, map_nodes, comm=MPI.COMM_SELF
):
    """Return one mesh of two rectangles whose corners ((x0, y0), (x1, y1)) are given.

    The function `map_nodes` gets coordinates x and y of nodes and the number of the body, 0 or 1,
    and returns the coordinates to which the nodes are moved.
    """
    meshes = []
    for body, (box, n) in enumerate(
        zip((corners_of_lower, corners_of_upper), divisions, strict=True)
    ):
        mesh = create_rectangle(MPI.COMM_SELF, box, n, CellType.triangle)
        x = mesh.geometry.x
        x[:, :2] = np.stack(map_nodes(*x[:, :2].T, body), axis=1)
        meshes.append(mesh)
    return join_meshes(*meshes, comm)


# Translations of the top at the ends of the increments
DIE_TOP_TRANSLATIONS = [(0.0, -0.05), (0.0, -0.12), (0.15, -0.12), (0.4, -0.12)]
SAVED_INCREMENT_INDEX = 1


class SlidingBodies:
    """A body with a fixed base, and a second body above it whose top is moved.

    In addition, base and top may be rotated together about the origin.
    """

    def __init__(
        self, mesh, slave_nodes, master_facets, base, top, friction, rotation_degrees=0.0, **options
    ):
        spaces = Spaces.petrov_galerkin(mesh)
        self.body = Body(spaces, Material(1.0), "plane strain")
        self.space = spaces.trial
        self.u, self.residual = make_finite_strain_unknown_and_residual(spaces)
        self.prescribed_displacement, self.rotation_degrees = (
            fem.Function(self.space),
            rotation_degrees,
        )
        base_and_top = [fem.locate_dofs_geometrical(self.space, where) for where in (base, top)]
        self.conditions = [
            fem.dirichletbc(self.prescribed_displacement, nodes) for nodes in base_and_top
        ]
        self.top = base_and_top[1]
        surface = DeformableSurface(master_facets, revolved=False)
        self.pair = ContactPair(slave_nodes, surface, friction=friction)
        self.problem = ContactProblem.of_residual(
            self.residual, self.u, self.conditions, self.pair, **options
        )

    def prescribe_base_and_top(self, top_translation, rotation_degrees):
        """Prescribe a translation of the top, then a rotation of both base and top.

        The rotation, given in degrees, is about the origin.
        """
        x = self.space.tabulate_dof_coordinates()[:, :2]
        end_positions = x.copy()
        end_positions[self.top] += top_translation
        c, s = np.cos(np.radians(rotation_degrees)), np.sin(np.radians(rotation_degrees))
        self.prescribed_displacement.x.array[:] = (
            end_positions @ np.array([[c, s], [-s, c]]) - x
        ).ravel()


def slide_along_path(bodies, path=DIE_TOP_TRANSLATIONS, start_state=None):
    """Return the states at the ends of the increments of a path."""
    return list(yield_states_along_path(bodies, path, start_state))


def yield_states_along_path(bodies, path, start_state=None):
    """Yield the state at the end of each increment of a path.

    `path` contains the translations of the top at the ends of the increments. The path begins at
    `start_state`, which has to be a state on the path `DIE_TOP_TRANSLATIONS`; by default it begins
    at the undeformed state.
    """
    state, previous = start_state or bodies.problem.undeformed, (0.0, 0.0)
    if start_state is not None:
        previous = DIE_TOP_TRANSLATIONS[start_state.increment - 1]
    for k, end in enumerate(path):
        angles = [bodies.rotation_degrees * j / len(path) for j in (k, k + 1)]

        def load(load_factor, ends=(*previous, *end), angles=angles):
            translation = (1 - load_factor) * np.array(ends[:2]) + load_factor * np.array(ends[2:])
            bodies.prescribe_base_and_top(
                translation, (1 - load_factor) * angles[0] + load_factor * angles[1]
            )

        state = bodies.problem.step(state, load)
        yield state
        previous = end


def make_die_on_block(
    friction=0.3,
    upper_is_slave=True,
    comm=MPI.COMM_SELF,
    curvature=1.2,
    divisions=((12, 3), (8, 3)),
    half_width=1.5,
    **options,
):
    """Return a block under a parabolic die; by default, the lower side of the die is the slave."""

    def map_node_coordinates(x, y, body_index):
        bottom = 0.01 + curvature * x**2 / 2
        return (x, y) if body_index == 0 else (x, bottom + y * (1 - bottom))

    boxes = ((-half_width, -1.0), (half_width, 0.0)), ((-0.5, 0.0), (0.5, 1.0))
    mesh = mesh_of_two_rectangles(*boxes, divisions, map_node_coordinates, comm)

    def on_die_bottom(x):
        within_width = (np.abs(x[0]) < 0.5 + 1e-9) & (x[1] > 0.005)
        return within_width & (np.abs(x[1] - 0.01 - curvature * x[0] ** 2 / 2) < 0.02)

    sides = (
        (on_die_bottom, on_plane(1, 0.0)) if upper_is_slave else (on_plane(1, 0.0), on_die_bottom)
    )
    return SlidingBodies(mesh, *sides, on_plane(1, -1.0), on_plane(1, 1.0), friction, **options)


def compare_mortar_with_verification(mortar, start_positions, end_positions):
    """Return the largest differences between the mortar integrals of verification and iteration.

    The nodes move from `start_positions` (n, 2) to `end_positions` (n, 2). Differences of gaps and
    slips are divided by the length of the slave's longest facet.
    """
    projected, projected_start = mortar.linearise(end_positions), mortar.linearise(start_positions)
    slip, _ = projected.measure_slip_and_motion_derivatives(
        mortar.make_slip_reference(start_positions), end_positions
    )
    facing_parts = [
        mortar.evaluate_mortar_matrices_independently(x) for x in (start_positions, end_positions)
    ]
    gap, slip_vector = measure_gap_and_slip(*facing_parts, start_positions, end_positions)
    assert np.array_equal(facing_parts[0].faces_master, projected_start.faces_master)
    assert np.array_equal(np.isfinite(gap), projected.faces_master)
    length = np.linalg.norm(np.diff(end_positions[mortar.sides.slave_facets], axis=1), axis=2).max()
    slip = np.einsum("mt,mtx->mx", slip, projected.directions.tangents)
    slip[~projected.faces_master] = 0.0
    return {
        "gap": np.abs(gap - projected.gaps)[projected.faces_master].max(initial=0.0) / length,
        "slip": np.abs(slip_vector - slip).max() / length,
        "normal": np.abs(facing_parts[1].normals - projected.normals).max(),
        "area": np.abs(facing_parts[1].areas - projected.areas).max()
        / projected.areas.max(initial=length),
        "parts": np.abs(
            (facing_parts[1].master_fractions - projected.master_fractions).toarray()
        ).max(),
    }


def mortar_and_positions_in_states(bodies, states):
    """Return the mortar of both bodies and the positions (n, 2) of its nodes in each state.

    The states at substeps are included.
    """
    mortar = bodies.problem._large_strain_stepping.interface.mortars[0]
    displacements = [
        step.displacement.array_r.reshape(-1, 2)[mortar.nodes]
        for step in list_states_and_substates(states)
    ]
    return mortar, [mortar.x + u for u in displacements]

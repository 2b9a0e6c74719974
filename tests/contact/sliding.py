"""Two neo-Hookean bodies of one mesh, pressed together and slid on each other."""

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle

from pw_elements import Body, Material, Spaces
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from pw_elements.contact.interface import measure_gap_and_slip
from tests.contact.cases import finite_strain_residual, on_plane
from tests.contact.two_bodies import join_meshes


def mesh_of_two_rectangles(lower, upper, divisions, shape, comm=MPI.COMM_SELF):
    """A mesh of two rectangles, ((x0, y0), (x1, y1)) each, with nodes moved by `shape`."""
    meshes = []
    for body, (box, n) in enumerate(zip((lower, upper), divisions, strict=True)):
        mesh = create_rectangle(MPI.COMM_SELF, box, n, CellType.triangle)
        x = mesh.geometry.x
        x[:, :2] = np.stack(shape(*x[:, :2].T, body), axis=1)
        meshes.append(mesh)
    return join_meshes(*meshes, comm)


DIE_PATH = [(0.0, -0.05), (0.0, -0.12), (0.15, -0.12), (0.4, -0.12)]
STORED_INCREMENT = 1


class SlidingBodies:
    """A body on a held base, and one above whose top is moved, both turned by some degrees."""

    def __init__(
        self, mesh, slave_nodes, master_facets, base, top, friction, rotation_degrees=0.0, **options
    ):
        spaces = Spaces.petrov_galerkin(mesh)
        self.body = Body(spaces, Material(1.0), "plane strain")
        self.space = spaces.trial
        self.u, self.residual = finite_strain_residual(spaces)
        self.prescribed_displacement, self.rotation_degrees = (
            fem.Function(self.space),
            rotation_degrees,
        )
        nodes = [fem.locate_dofs_geometrical(self.space, where) for where in (base, top)]
        self.conditions = [fem.dirichletbc(self.prescribed_displacement, part) for part in nodes]
        self.top = nodes[1]
        surface = DeformableSurface(master_facets, revolved=False)
        self.pair = ContactPair(slave_nodes, surface, friction=friction)
        self.problem = ContactProblem.of_residual(
            self.residual, self.u, self.conditions, self.pair, **options
        )

    def prescribe_base_and_top(self, motion, angle):
        """Moves the top, and turns base and top by an angle about the origin."""
        x = self.space.tabulate_dof_coordinates()[:, :2]
        moved = x.copy()
        moved[self.top] += motion
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        self.prescribed_displacement.x.array[:] = (moved @ np.array([[c, s], [-s, c]]) - x).ravel()


def slide_along_path(bodies, path=DIE_PATH, start=None):
    return list(iterate_along_path(bodies, path, start))


def iterate_along_path(bodies, path, start=None):
    state, before = start or bodies.problem.undeformed, (0.0, 0.0)
    if start is not None:
        before = DIE_PATH[start.increment - 1]
    for k, end in enumerate(path):
        angles = [bodies.rotation_degrees * j / len(path) for j in (k, k + 1)]

        def load(share, ends=(*before, *end), angles=angles):
            motion = (1 - share) * np.array(ends[:2]) + share * np.array(ends[2:])
            bodies.prescribe_base_and_top(motion, (1 - share) * angles[0] + share * angles[1])

        state = bodies.problem.step(state, load)
        yield state
        before = end


def make_die_on_block(
    friction=0.3,
    upper_is_slave=True,
    comm=MPI.COMM_SELF,
    curvature=1.2,
    divisions=((12, 3), (8, 3)),
    half_width=1.5,
    **options,
):
    """A parabolic die on a block; the die's lower side is the slave by default."""

    def shape(x, y, body):
        low = 0.01 + curvature * x**2 / 2
        return (x, y) if body == 0 else (x, low + y * (1 - low))

    boxes = ((-half_width, -1.0), (half_width, 0.0)), ((-0.5, 0.0), (0.5, 1.0))
    mesh = mesh_of_two_rectangles(*boxes, divisions, shape, comm)

    def under(x):
        inside = (np.abs(x[0]) < 0.5 + 1e-9) & (x[1] > 0.005)
        return inside & (np.abs(x[1] - 0.01 - curvature * x[0] ** 2 / 2) < 0.02)

    sides = (under, on_plane(1, 0.0)) if upper_is_slave else (on_plane(1, 0.0), under)
    return SlidingBodies(mesh, *sides, on_plane(1, -1.0), on_plane(1, 1.0), friction, **options)


def kernel_check_differences(mortar, start, end):
    """Largest differences of what checks measure on two sides and what the iteration's kernel does.

    Sides move from positions (n, 2) to others; gaps and slips are over the longest facet.
    """
    met, before = mortar.meet(end), mortar.meet(start)
    slip, _ = met.motions(mortar.make_reference(start), end)
    parts = [mortar.measure_facing(x) for x in (start, end)]
    gap, slip_vector = measure_gap_and_slip(*parts, start, end)
    assert np.array_equal(parts[0].faced, before.faced)
    assert np.array_equal(np.isfinite(gap), met.faced)
    length = np.linalg.norm(np.diff(end[mortar.sides.slave_facets], axis=1), axis=2).max()
    slip = np.where(met.faced, slip, 0.0)[:, None] * met.tangents
    return {
        "gap": np.abs(gap - met.gaps)[met.faced].max(initial=0.0) / length,
        "slip": np.abs(slip_vector - slip).max() / length,
        "normal": np.abs(parts[1].normals - met.normals).max(),
        "area": np.abs(parts[1].areas - met.areas).max() / met.areas.max(initial=length),
        "parts": np.abs((parts[1].master_parts - met.parts).toarray()).max(),
    }


def mortar_positions_in_states(bodies, states):
    """The kernel of both bodies' sides, and their nodes' positions (n, 2) in states and parts."""
    mortar = bodies.problem._finite.interface.mortars[0]
    every = [part for state in states for part in (*(at for _, at in state.substates), state)]
    moved = [part.displacement.array_r.reshape(-1, 2)[mortar.nodes] for part in every]
    return mortar, [mortar.x + u for u in moved]

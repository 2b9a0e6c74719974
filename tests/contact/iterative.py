"""Contact problems of solids on which the direct and the iterative solver have to agree."""

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box

from pw_elements import assemble_vector
from pw_elements.contact import ContactPair, Motion, Plane, Sphere
from tests.contact.cases import PETROV_GALERKIN, ElasticBody, on_plane
from tests.contact.two_bodies import StackedBlocks

PRESS_AND_PUSH_TRACTION = (1e-4, 5e-5, -1e-3)


FLOOR_IN_SPACE = Plane((0, 0, 0), (0, 0, 1))


class SolidBlock(ElasticBody):
    """Block of dimensions 2 x 1 x 1 that is n cells high."""

    def __init__(self, cell="tetrahedron", method=PETROV_GALERKIN, n=3, comm=MPI.COMM_SELF, nu=0.3):
        mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (2 * n, n, n), CellType[cell])
        super().__init__(mesh, method, "solid", nu=nu)
        self.no_supports = self.make_supports()

    def contact_arguments_of_case(self, case_name):
        """Return the arguments of `solve_contact` for a case of `SOLID_CASE_MAKERS_BY_NAME`."""
        loads, supports, pairs = SOLID_CASE_MAKERS_BY_NAME[case_name](self)
        return self.K, loads, supports, pairs, self.space

    def base_supports_moved_by_1_2_3_times(self, length=0.0):
        """Return supports that displace the base along the axes by 1, 2 and 3 times a length."""
        return self.make_supports(*((i, on_plane(2, 0.0), length * (i + 1)) for i in range(3)))

    def press_and_push_load(self):
        """Assemble the load vector of a pressure on the top and a traction on one side."""
        return self.traction_load((0.0, 0.0, -100.0), on_plane(2, 1.0)) + self.traction_load(
            (20.0, 10.0, 0.0), on_plane(0, 0.0)
        )


def nearly_sliding_contact_arguments(solid, push_over_pressure=0.588):
    """Return the arguments of `solve_contact` for a block that nearly slides on a floor.

    The block is pressed, pushed until it nearly slides, and pushed less. While only the last few
    nodes stick, the tangent is nearly singular and GMRES stagnates. `push_over_pressure` is the
    larger push divided by the pressure; friction can carry a ratio of 0.6.
    """
    pressure_load, side_load = (
        solid.traction_load((0.0, 0.0, -1.0), on_plane(2, 1.0)),
        solid.traction_load((1.0, 0, 0), on_plane(0, 0.0)),
    )
    loads = [pressure_load + ratio * side_load for ratio in (0.0, push_over_pressure, 0.3)]
    return (
        solid.K,
        loads,
        solid.no_supports,
        ContactPair(on_plane(2, 0.0), FLOOR_IN_SPACE, 0.3),
        solid.space,
    )


def _rough_floor_loads_supports_pairs(solid):
    """Return loads, supports and pair of a block that only contact with a rough floor holds."""
    return (
        solid.press_and_push_load(),
        solid.no_supports,
        ContactPair(on_plane(2, 0.0), FLOOR_IN_SPACE, 0.3),
    )


def _corner_loads_supports_pairs(solid):
    """Return loads, supports and pairs of a block in a corner of three planes.

    The nodes of each edge belong to one of the two planes that meet there.
    """

    def on_floor(x):
        return np.isclose(x[2], 0) & (x[0] > 1e-9) & (x[1] > 1e-9)

    def on_left_wall(x):
        return np.isclose(x[0], 0) & (x[1] > 1e-9)

    pairs = [
        ContactPair(on_floor, FLOOR_IN_SPACE, 0.2),
        ContactPair(on_left_wall, Plane((0, 0, 0), (1, 0, 0)), 0.2),
        ContactPair(on_plane(1, 0.0), Plane((0, 0, 0), (0, 1, 0)), 0.0),
    ]
    return assemble_vector(solid.body.body_load((-3.0, -2.0, -10.0))), solid.no_supports, pairs


def _tilted_plane_loads_supports_pairs(solid):
    """Return loads, supports and pair of a block that a tilted plane presses on a moved base."""
    normal = np.array([0.1, 0.05, -1.0]) / np.linalg.norm([0.1, 0.05, -1.0])
    plane = Plane((0, 0, 1), tuple(normal))
    pair = ContactPair(on_plane(2, 1.0), plane, 0.4, [Motion((0.01, 0.0, -0.08))])
    return solid.zero_load, solid.base_supports_moved_by_1_2_3_times(0.001), pair


def _moved_sphere_loads_supports_pairs(solid):
    """Return loads, supports and pair of a block under a sphere that moves down, then sideways."""
    motions = [Motion((0, 0, -0.05)), Motion((0.02, 0.01, -0.05))]
    pair = ContactPair(on_plane(2, 1.0), Sphere((1, 0.5, 2), 1.0), 0.3, motions)
    return [solid.zero_load] * 2, solid.base_supports_moved_by_1_2_3_times(0.001), pair


def _pushed_sphere_loads_supports_pairs(solid):
    """Return loads, supports and pair of a block under a sphere that is moved by forces.

    The sphere is free to move in one direction in the first increment, and in all three directions
    in the second one. Gap and normal are therefore linearised repeatedly.
    """
    motions = [Motion((0, 0, None), (0, 0, -5.0)), Motion((None, None, None), (1.0, 0.3, -5.0))]
    pair = ContactPair(on_plane(2, 1.0), Sphere((1, 0.5, 2), 1.0), 0.3, motions)
    return [solid.zero_load] * 2, solid.base_supports_moved_by_1_2_3_times(), pair


def _pushed_plate_loads_supports_pairs(solid):
    """Return loads, supports and pair of a block under a rough plate that is moved by forces.

    The forces press the plate, and then also push it sideways.
    """
    motions = [Motion((None, 0, None), (0, 0, -20.0)), Motion((None, 0, None), (3.0, 0, -20.0))]
    pair = ContactPair(on_plane(2, 1.0), Plane((0, 0, 1), (0, 0, -1)), 0.3, motions)
    return [solid.zero_load] * 2, solid.base_supports_moved_by_1_2_3_times(), pair


SOLID_CASE_MAKERS_BY_NAME = {
    "rough floor": _rough_floor_loads_supports_pairs,
    "corner": _corner_loads_supports_pairs,
    "tilted": _tilted_plane_loads_supports_pairs,
    "sphere": _moved_sphere_loads_supports_pairs,
    "sphere by forces": _pushed_sphere_loads_supports_pairs,
    "plate by forces": _pushed_plate_loads_supports_pairs,
}


def upper_on_lower_contact_arguments(stack: StackedBlocks, slave_side, replacement_surface=None):
    """Return the arguments of `solve_contact` for a block that is held by contact with another one.

    The lower block is clamped at its base; the upper one is pressed and pushed.
    `replacement_surface`, if given, takes the place of the pair's deformable surface.
    """
    pair = stack.make_pair(slave_side, 0.2)
    if replacement_surface is not None:
        pair = ContactPair(pair.nodes, replacement_surface, pair.friction)
    return (
        stack.K,
        stack.traction_load(PRESS_AND_PUSH_TRACTION),
        stack.make_clamping_supports(on_plane(2, 0.0)),
        pair,
        stack.space,
    )


def _both_on_floor_contact_arguments(stack, slave_side):
    """Return the arguments of `solve_contact` for two blocks on a rigid floor without supports."""
    K, load, _, pair, space = upper_on_lower_contact_arguments(stack, slave_side)
    return (
        K,
        load,
        stack.make_supports(),
        [ContactPair(on_plane(2, 0.0), FLOOR_IN_SPACE, 0.3), pair],
        space,
    )


def _frictionless_contact_arguments(stack, slave_side):
    """Return the arguments of `solve_contact` for two stacked blocks without friction.

    Supports hold the base, and prevent horizontal displacements of the top.
    """
    guided = [(i, on_plane(2, end)) for i in range(2) for end in (0.0, 2.0)]
    supports = stack.make_supports(*guided, (2, on_plane(2, 0.0)))
    return (
        stack.K,
        stack.traction_load((0, 0, -1e-3)),
        supports,
        stack.make_pair(slave_side),
        stack.space,
    )


def _force_between_blocks_contact_arguments(stack, slave_side):
    """Return the arguments of `solve_contact` for two clamped blocks with a given contact force.

    The force has a normal and a tangential component.
    """
    sign = 1 if slave_side == "upper" else -1
    motion = Motion((None, 0.0, None), (1e-4, 0.0, sign * 1e-3))
    supports = stack.fixed_base_moved_top_supports((0.0, 0.0, 0.0))
    return (
        stack.K,
        stack.zero_load,
        supports,
        stack.make_pair(slave_side, 0.2, [motion]),
        stack.space,
    )


STACKED_CASE_MAKERS_BY_NAME = {
    "held by contact": upper_on_lower_contact_arguments,
    "on a floor": _both_on_floor_contact_arguments,
    "smooth": _frictionless_contact_arguments,
    "forces through contact": _force_between_blocks_contact_arguments,
}

"""Contact problems in space for which factors and iterations have to agree."""

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box

from pw_elements import assemble_vector
from pw_elements.contact import ContactPair, Motion, Plane, Sphere
from tests.contact.cases import PW, Elastic, at
from tests.contact.two_bodies import Stack

PUSHED = (1e-4, 5e-5, -1e-3)


FLOOR = Plane((0, 0, 0), (0, 0, 1))


class Solid(Elastic):
    """Block 2 x 1 x 1, n cells high."""

    def __init__(self, cell="tetrahedron", method=PW, n=3, comm=MPI.COMM_SELF, nu=0.3):
        mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (2 * n, n, n), CellType[cell])
        super().__init__(mesh, method, "solid", nu=nu)
        self.free = self.held()

    def arguments(self, case):
        """K, loads, supports and pairs of one of `CASES`, as `solve_contact` takes them."""
        loads, supports, pairs = CASES[case](self)
        return self.K, loads, supports, pairs, self.space

    def foot(self, moved=0.0):
        """Supports of the bottom, which they move in all directions."""
        return self.held(*((i, at(2, 0.0), moved * (i + 1)) for i in range(3)))

    def pushed(self):
        """Pressure on the top and a push at the side."""
        return self.load((0.0, 0.0, -100.0), at(2, 1.0)) + self.load((20.0, 10.0, 0.0), at(0, 0.0))


def nearly_sliding(solid, push=0.588):
    """K, loads, supports and pairs of a block that is pressed on a floor, pushed, pushed by less.

    The last nodes that stick let a singular tangent come near, on which GMRES gives up. The push
    is over the pressure; the floor's friction bears 0.6.
    """
    pressed, side = solid.load((0.0, 0.0, -1.0), at(2, 1.0)), solid.load((1.0, 0, 0), at(0, 0.0))
    loads = [pressed + share * side for share in (0.0, push, 0.3)]
    return solid.K, loads, solid.free, ContactPair(at(2, 0.0), FLOOR, 0.3), solid.space


def _rough_floor(solid):
    """Held by contact alone."""
    return solid.pushed(), solid.free, ContactPair(at(2, 0.0), FLOOR, 0.3)


def _corner(solid):
    """Three planes, each edge's nodes with one of them."""

    def below(x):
        return np.isclose(x[2], 0) & (x[0] > 1e-9) & (x[1] > 1e-9)

    def left(x):
        return np.isclose(x[0], 0) & (x[1] > 1e-9)

    pairs = [
        ContactPair(below, FLOOR, 0.2),
        ContactPair(left, Plane((0, 0, 0), (1, 0, 0)), 0.2),
        ContactPair(at(1, 0.0), Plane((0, 0, 0), (0, 1, 0)), 0.0),
    ]
    return assemble_vector(solid.body.body_load((-3.0, -2.0, -10.0))), solid.free, pairs


def _tilted(solid):
    """A plane that no axis is normal to, pushed in; the bottom is moved by its supports."""
    normal = np.array([0.1, 0.05, -1.0]) / np.linalg.norm([0.1, 0.05, -1.0])
    plane = Plane((0, 0, 1), tuple(normal))
    pair = ContactPair(at(2, 1.0), plane, 0.4, [Motion((0.01, 0.0, -0.08))])
    return solid.nothing, solid.foot(0.001), pair


def _sphere(solid):
    """Indented by its motion, then dragged."""
    motions = [Motion((0, 0, -0.05)), Motion((0.02, 0.01, -0.05))]
    pair = ContactPair(at(2, 1.0), Sphere((1, 0.5, 2), 1.0), 0.3, motions)
    return [solid.nothing] * 2, solid.foot(0.001), pair


def _sphere_by_forces(solid):
    """Free to move in one direction, then in three: gap and normal are linearised anew."""
    motions = [Motion((0, 0, None), (0, 0, -5.0)), Motion((None, None, None), (1.0, 0.3, -5.0))]
    pair = ContactPair(at(2, 1.0), Sphere((1, 0.5, 2), 1.0), 0.3, motions)
    return [solid.nothing] * 2, solid.foot(), pair


def _plate_by_forces(solid):
    """A rough plate, pressed and then pushed."""
    motions = [Motion((None, 0, None), (0, 0, -20.0)), Motion((None, 0, None), (3.0, 0, -20.0))]
    pair = ContactPair(at(2, 1.0), Plane((0, 0, 1), (0, 0, -1)), 0.3, motions)
    return [solid.nothing] * 2, solid.foot(), pair


CASES = {
    "rough floor": _rough_floor,
    "corner": _corner,
    "tilted": _tilted,
    "sphere": _sphere,
    "sphere by forces": _sphere_by_forces,
    "plate by forces": _plate_by_forces,
}


def held_by_contact(stack: Stack, slave, surface=None):
    """The upper block rests on the lower one alone, pressed and pushed."""
    pair = stack.pair(slave, 0.2)
    if surface is not None:
        pair = ContactPair(pair.nodes, surface, pair.friction)
    return stack.K, stack.load(PUSHED), stack.clamped(at(2, 0.0)), pair, stack.space


def _on_a_floor(stack, slave):
    """As before, and the lower one rests on a rigid plane alone."""
    K, load, _, pair, space = held_by_contact(stack, slave)
    return K, load, stack.held(), [ContactPair(at(2, 0.0), FLOOR, 0.3), pair], space


def _smooth(stack, slave):
    """Without friction, guided on top."""
    guided = [(i, at(2, end)) for i in range(2) for end in (0.0, 2.0)]
    supports = stack.held(*guided, (2, at(2, 0.0)))
    return stack.K, stack.load((0, 0, -1e-3)), supports, stack.pair(slave), stack.space


def _through_contact(stack, slave):
    """Both clamped, a force between them presses and pushes."""
    sign = 1 if slave == "upper" else -1
    motion = Motion((None, 0.0, None), (1e-4, 0.0, sign * 1e-3))
    supports = stack.moved_top((0.0, 0.0, 0.0))
    return stack.K, stack.nothing, supports, stack.pair(slave, 0.2, [motion]), stack.space


STACKED = {
    "held by contact": held_by_contact,
    "on a floor": _on_a_floor,
    "smooth": _smooth,
    "forces through contact": _through_contact,
}

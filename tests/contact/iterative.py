"""Contact problems in space for which factors and iterations have to agree."""

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements.contact import ContactPair, Motion, Plane, Sphere
from tests.contact.cases import at
from tests.contact.two_bodies import Stack

PUSHED = (1e-4, 5e-5, -1e-3)


class Solid:
    """Block 2 x 1 x 1, n cells high."""

    def __init__(
        self,
        cell="tetrahedron",
        method=Spaces.petrov_galerkin,
        n=3,
        comm=MPI.COMM_SELF,
        nu=0.3,
    ):
        mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (2 * n, n, n), CellType[cell])
        self.body = Body(method(mesh), Material(1000.0, nu), "solid")
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        self.free = Reduction.dirichlet(self.space, [])

    def arguments(self, case):
        """K, loads, supports and pairs of one of `CASES`, as `solve_contact` takes them."""
        loads, supports, pairs = CASES[case](self)
        return self.K, loads, supports, pairs, self.space

    def foot(self, moved=0.0):
        """Supports of the bottom, which they move in all directions."""
        held = [prescribe(self.space, i, at(2, 0.0), moved * (i + 1)) for i in range(3)]
        return Reduction.dirichlet(self.space, held)

    def pushed(self):
        """Pressure on the top and a push at the side."""
        mesh = self.body.spaces.mesh
        load = assemble_vector(
            self.body.surface_load((0.0, 0.0, -100.0), boundary_measure(mesh, at(2, 1.0)))
        )
        side = boundary_measure(mesh, at(0, 0.0))
        load.axpy(1.0, assemble_vector(self.body.surface_load((20.0, 10.0, 0.0), side)))
        return load


def nearly_sliding(solid, push=0.57):
    """K, loads, supports and pairs of a block that is pressed on a floor, pushed, pushed by less.

    The last nodes that stick let a singular tangent come near, on which GMRES gives up.

    Args:
        solid: the block.
        push: over the pressure; the floor's friction bears 0.6.
    """
    mesh = solid.body.spaces.mesh
    side, top = (boundary_measure(mesh, at(*place)) for place in ((0, 0.0), (2, 1.0)))
    loads = []
    for share in (0.0, push, 0.3):
        load = assemble_vector(solid.body.surface_load((0.0, 0.0, -1.0), top))
        load.axpy(share, assemble_vector(solid.body.surface_load((1.0, 0.0, 0.0), side)))
        loads.append(load)
    floor = ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
    return solid.K, loads, solid.free, floor, solid.space


def _rough_floor(solid):
    floor = ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
    return solid.pushed(), solid.free, floor  # held by contact alone


def _corner(solid):
    """Three planes, each edge's nodes with one of them."""

    def below(x):
        return np.isclose(x[2], 0) & (x[0] > 1e-9) & (x[1] > 1e-9)

    def left(x):
        return np.isclose(x[0], 0) & (x[1] > 1e-9)

    pairs = [
        ContactPair(below, Plane((0, 0, 0), (0, 0, 1)), 0.2),
        ContactPair(left, Plane((0, 0, 0), (1, 0, 0)), 0.2),
        ContactPair(at(1, 0.0), Plane((0, 0, 0), (0, 1, 0)), 0.0),
    ]
    return assemble_vector(solid.body.body_load((-3.0, -2.0, -10.0))), solid.free, pairs


def _tilted(solid):
    """A plane that no axis is normal to, pushed in; the bottom is moved by its supports."""
    normal = np.array([0.1, 0.05, -1.0]) / np.linalg.norm([0.1, 0.05, -1.0])
    plane = Plane((0, 0, 1), tuple(normal))
    pair = ContactPair(at(2, 1.0), plane, 0.4, [Motion((0.01, 0.0, -0.08))])
    return solid.K.createVecLeft(), solid.foot(0.001), pair


def _sphere(solid):
    """Indented by its motion, then dragged."""
    motions = [Motion((0, 0, -0.05)), Motion((0.02, 0.01, -0.05))]
    pair = ContactPair(at(2, 1.0), Sphere((1, 0.5, 2), 1.0), 0.3, motions)
    return [solid.K.createVecLeft()] * 2, solid.foot(0.001), pair


def _sphere_by_forces(solid):
    """Free to move in one direction, then in three: gap and normal are linearised anew."""
    motions = [
        Motion((0, 0, None), (0, 0, -5.0)),
        Motion((None, None, None), (1.0, 0.3, -5.0)),
    ]
    pair = ContactPair(at(2, 1.0), Sphere((1, 0.5, 2), 1.0), 0.3, motions)
    return [solid.K.createVecLeft()] * 2, solid.foot(), pair


def _plate_by_forces(solid):
    """A rough plate, pressed and then pushed."""
    motions = [
        Motion((None, 0, None), (0, 0, -20.0)),
        Motion((None, 0, None), (3.0, 0, -20.0)),
    ]
    pair = ContactPair(at(2, 1.0), Plane((0, 0, 1), (0, 0, -1)), 0.3, motions)
    return [solid.K.createVecLeft()] * 2, solid.foot(), pair


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
    base = [prescribe(stack.space, i, at(2, 0.0)) for i in range(3)]
    pair = stack.pair(slave, 0.2)
    if surface is not None:
        pair = ContactPair(pair.nodes, surface, pair.friction)
    return stack.K, stack.load(PUSHED), Reduction.dirichlet(stack.space, base), pair, stack.space


def _on_a_floor(stack, slave):
    """As before, and the lower one rests on a rigid plane alone."""
    K, load, _, pair, space = held_by_contact(stack, slave)
    floor = ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
    return K, load, Reduction.dirichlet(space, []), [floor, pair], space


def _smooth(stack, slave):
    """Without friction, guided on top."""
    guided = [prescribe(stack.space, i, at(2, end)) for i in range(2) for end in (0.0, 2.0)]
    guided.append(prescribe(stack.space, 2, at(2, 0.0)))
    supports = Reduction.dirichlet(stack.space, guided)
    return stack.K, stack.load((0, 0, -1e-3)), supports, stack.pair(slave), stack.space


def _through_contact(stack, slave):
    """Both clamped, a force between them presses and pushes."""
    held = [prescribe(stack.space, i, at(2, end)) for i in range(3) for end in (0.0, 2.0)]
    sign = 1 if slave == "upper" else -1
    motion = Motion((None, 0.0, None), (1e-4, 0.0, sign * 1e-3))
    supports = Reduction.dirichlet(stack.space, held)
    pair = stack.pair(slave, 0.2, [motion])
    return stack.K, stack.K.createVecLeft(), supports, pair, stack.space


STACKED = {
    "held by contact": held_by_contact,
    "on a floor": _on_a_floor,
    "smooth": _smooth,
    "forces through contact": _through_contact,
}

"""Two bodies that meet in curved faces, and press fits, against Lame's exact solutions."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import create_rectangle

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.contact import ContactPair, DeformableSurface, solve_contact
from pw_elements.mechanics import exterior_facets
from pw_elements.recovery import SurfaceNodes
from tests.contact_cases import at
from tests.shells import BETWEEN, INNER, NU, OUTER, Shells
from tests.two_bodies import Stack, joined

SHELLS = [
    ("tube", "triangle", 4),
    ("tube", "quadrilateral", 4),
    ("tube in space", "tetrahedron", 3),
    ("tube in space", "hexahedron", 2),
    ("sphere", "hexahedron", 2),
    ("revolved", "triangle", 4),
    ("revolved", "quadrilateral", 4),
]


def errors(shells):
    """Of displacements, the largest, and of the pressure, the root of the mean square."""
    problem = shells.K, shells.load, shells.supports, shells.pair, shells.space
    (state,) = solve_contact(*problem)
    exact = shells.displacement()
    moved = state.displacement.array.reshape(exact.shape)
    pressure = SurfaceNodes.of(shells.body, shells.own).pressure(state.pairs[0].force_normal)
    off = pressure / shells.pressure - 1
    return np.abs(moved - exact).max() / np.abs(exact).max(), np.sqrt(np.mean(off**2))


@pytest.mark.parametrize("slave", ["inner", "outer"])
@pytest.mark.parametrize(("kind", "cell", "n"), SHELLS)
def test_tubes_and_spheres_come_nearer_with_order_two(kind, cell, n, slave):
    """Measures are those of chords, of second order, and so are pressures of quadratic elements."""
    found = [errors(Shells(kind, cell, (k, 3 * k // 2), slave)) for k in (n, 2 * n)]
    moved, pressure = np.log2(np.divide(*found))
    assert moved > 1.7
    assert pressure > 1.5
    assert found[1][1] < 5e-3


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_gaps_of_meshes_are_of_order_four(cell):
    """They are pressed out where sides are not said to coincide."""
    found = [errors(Shells("tube", cell, (k, 3 * k // 2), "outer", False)) for k in (4, 8)]
    moved, pressure = np.log2(np.divide(*found))
    assert moved > 3.5
    assert pressure > 2.5


def test_sides_that_do_not_coincide_are_named():
    stack = Stack((4, 3), shape=lambda x: x + np.array([0.0, 0.02, 0.0]))
    supports, load = Reduction.dirichlet(stack.space, []), stack.K.createVecLeft()
    pair = stack.pair()
    joined_ = replace(pair, surface=replace(pair.surface, coincident=True))
    with pytest.raises(ValueError, match="farther than meshes of one surface do"):
        solve_contact(stack.K, load, supports, joined_, stack.space)
    with pytest.raises(ValueError, match="give interference or that"):
        replace(joined_, interference=True)


@pytest.mark.parametrize("slave", ["inner", "outer"])
def test_a_press_fit_has_lames_pressure(slave):
    """Of two rings in axisymmetry that cannot grow along the axis; the outer one is too narrow."""
    depth, height, off = 1e-5, 0.5, []
    for n in (4, 8):
        inner, outer = (
            create_rectangle(MPI.COMM_SELF, [(low, 0.0), (high, height)], (k, k // 2))
            for low, high, k in ((INNER, BETWEEN, n), (BETWEEN - depth, OUTER, 3 * n // 2))
        )
        mesh = joined(inner, outer)
        body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, NU), "axisymmetric")
        space, K = body.spaces.trial, assemble_matrix(body.stiffness())
        sides = {
            "inner": exterior_facets(mesh, lambda x: np.abs(x[0] - BETWEEN) < depth / 10),
            "outer": exterior_facets(mesh, lambda x: np.abs(x[0] - BETWEEN + depth) < depth / 10),
        }
        own = sides.pop(slave)
        (theirs,) = sides.values()
        nodes = fem.locate_dofs_topological(space, 1, own)
        pair = ContactPair(nodes, DeformableSurface(theirs, revolved=True), interference=True)
        held = [prescribe(space, 1, at(1, end)) for end in (0.0, height)]
        problem = K, K.createVecLeft(), Reduction.dirichlet(space, held), pair, space
        (state,) = solve_contact(*problem)
        pressure = SurfaceNodes.of(body, own).pressure(state.pairs[0].force_normal)
        a, b, c = INNER, BETWEEN, OUTER
        exact = depth / (1 - NU**2) / (2 * b**3) * (b**2 - a**2) * (c**2 - b**2) / (c**2 - a**2)
        off.append(np.abs(pressure / exact - 1).max())
    assert off[1] < 3e-3
    assert off[0] > 2.5 * off[1]

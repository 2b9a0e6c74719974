"""Two bodies that meet in curved faces, and press fits, against Lame's exact solutions."""

from dataclasses import replace

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import create_rectangle

from pw_elements import Reduction, solve
from pw_elements.contact import SLIP, ContactFields, ContactPair, DeformableSurface
from pw_elements.spaces import exterior_facets
from study.verification.c_mesh_families import meshed
from tests.contact.cases import PW, Elastic, at
from tests.contact.shells import BETWEEN, INNER, NU, OUTER, Shells
from tests.contact.two_bodies import Stack, joined, two_sides

SHELLS = [
    ("tube", "triangle", (4, 8), "inner"),
    ("tube", "quadrilateral", (4, 8), "outer"),
    ("tube in space", "tetrahedron", (2, 4), "inner"),
    ("tube in space", "hexahedron", (2, 4), "outer"),
    ("sphere", "hexahedron", (2, 3), "inner"),
    ("revolved", "triangle", (4, 8), "outer"),
    ("revolved", "quadrilateral", (4, 8), "inner"),
]


def errors(shells):
    """Of displacements, the largest, and of pressures on either side, the root of the mean square.

    Of the opposite side's shear the largest over the pressure, too.
    """
    (state,) = shells.contact(shells.pair, shells.supports, shells.inside)
    (pair,) = state.pairs
    fields = ContactFields.of(state, shells.body)
    found = [largest(shells, state.displacement)]
    for nodes in (pair.node, pair.opposite):
        off = fields.pressure.x.array[nodes] / shells.pressure - 1
        found.append(np.sqrt(np.mean(off**2)))
    shear = fields.traction.x.array.reshape(shells.x.shape)[pair.opposite]
    return np.array(found), np.abs(shear).max() / shells.pressure


def largest(shells, displacement):
    """Error of displacements."""
    exact = shells.displacement()
    return np.abs(displacement.array.reshape(exact.shape) - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize(("kind", "cell", "divisions", "slave"), SHELLS)
def test_tubes_and_spheres_come_nearer_with_order_two(kind, cell, divisions, slave):
    """Measures are those of chords, of second order, and so are pressures of quadratic elements."""
    found, shear = zip(
        *(errors(Shells(kind, cell, (k, 3 * k // 2), slave)) for k in divisions), strict=True
    )
    moved, *pressures = np.log(np.divide(*found)) / np.log(divisions[1] / divisions[0])
    assert moved > 1.7
    assert min(pressures) > 1.5
    assert max(found[1][1:]) < (6e-3 if kind == "sphere" else 5e-3)
    assert shear[1] < 5e-4


@pytest.mark.slow
def test_doubly_curved_tetrahedra_have_pressures_of_order_two():
    """Of a hollow sphere; the order of displacements is nearer to three."""
    found = [errors(Shells("sphere", "tetrahedron", (k, 3 * k // 2)))[0] for k in (2, 4)]
    moved, *pressures = np.log2(np.divide(*found))
    assert moved > 2.4
    assert min(pressures) > 1.5
    assert max(found[1]) < 8e-3


def test_tetrahedra_of_gmsh_err_as_if_the_pressure_were_given():
    """A sphere in a sphere, whose meshes know nothing of each other."""
    shells = Shells("sphere of Gmsh", "tetrahedron", (3, 4.1), "outer")
    found, _ = errors(shells)
    load = shells.inside + shells.pushed(shells.pressure, shells.between)
    alone = largest(shells, solve(shells.K, load, shells.supports))
    assert found[0] < 1.05 * alone
    assert max(found[1:]) < 0.05


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_gaps_of_meshes_are_of_order_four(cell):
    """They are pressed out where sides are not said to coincide."""
    found = [errors(Shells("tube", cell, (k, 3 * k // 2), "outer", False))[0] for k in (4, 8)]
    moved, *pressures = np.log2(np.divide(*found))
    assert moved > 3.5
    assert min(pressures) > 2.5


def test_sides_that_do_not_coincide_are_named():
    stack = Stack((4, 3), shape=lambda x: x + np.array([0.0, 0.02, 0.0]))
    pair = stack.pair()
    joined_ = replace(pair, surface=replace(pair.surface, coincident=True))
    with pytest.raises(ValueError, match="farther than meshes of one surface do"):
        stack.contact(joined_)
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
        rings = Elastic(joined(inner, outer), PW, "axisymmetric", 1.0, NU)
        sides = [
            exterior_facets(rings.mesh, lambda x, r=r: np.abs(x[0] - r) < depth / 10)
            for r in (BETWEEN, BETWEEN - depth)
        ]
        own, theirs = sides if slave == "inner" else sides[::-1]
        nodes = fem.locate_dofs_topological(rings.space, 1, own)
        pair = ContactPair(nodes, DeformableSurface(theirs, revolved=True), interference=True)
        (state,) = rings.contact(pair, rings.held(*((1, at(1, end)) for end in (0.0, height))))
        fields = ContactFields.of(state, rings.body)
        both = np.concatenate([state.pairs[0].node, state.pairs[0].opposite])
        pressure = fields.pressure.x.array[both]
        a, b, c = INNER, BETWEEN, OUTER
        exact = depth / (1 - NU**2) / (2 * b**3) * (b**2 - a**2) * (c**2 - b**2) / (c**2 - a**2)
        off.append(np.abs(pressure / exact - 1).max())
    assert off[1] < 3e-3
    assert off[0] > 2.5 * off[1]


@pytest.mark.parametrize("slave", ["inner", "outer"])
def test_friction_on_a_curved_face_has_coulombs_torque(slave):
    """A ring that is blown up and turned in another one, on meshes of Gmsh, slips all round."""
    mu, grown, turn = 0.3, 1e-3, 2e-3

    def ring(low, high, size):
        def build():
            disks = [[(2, gmsh.model.occ.addDisk(0, 0, 0, r, r))] for r in (high, low)]
            gmsh.model.occ.cut(*disks)

        return meshed(build, 2, size, 2)

    def radius(x):
        return np.hypot(x[0], x[1])

    lame, shear = NU / (1 + NU) / (1 - 2 * NU), 1 / 2 / (1 + NU)
    A, B = np.linalg.solve([[INNER, 1 / INNER], [OUTER, 1 / OUTER]], [grown, 0.0])
    pressure = 2 * shear * B / BETWEEN**2 - 2 * (lame + shear) * A
    torque = 2 * np.pi * BETWEEN**2 * mu * pressure
    off = []
    for size in (0.2, 0.1):
        mesh = joined(ring(INNER, BETWEEN, size), ring(BETWEEN, OUTER, 1.3 * size))
        rings = Elastic(mesh, PW, "plane strain", 1.0, NU)
        sides = two_sides(
            rings,
            lambda x: np.isclose(radius(x), BETWEEN),
            lambda x: np.hypot(x[:, 0], x[:, 1]) > BETWEEN,
        )
        own, theirs = sides if slave == "inner" else sides[::-1]
        nodes = fem.locate_dofs_topological(rings.space, 1, own)
        pair = ContactPair(nodes, DeformableSurface(theirs, coincident=True), mu)
        moved, rest = fem.Function(rings.space), fem.Function(rings.space)
        moved.interpolate(lambda x: grown / INNER * x[:2] + turn * np.array([-x[1], x[0]]))
        held = [
            fem.dirichletbc(u, fem.locate_dofs_geometrical(rings.space, marker))
            for u, marker in (
                (moved, lambda x: np.isclose(radius(x), INNER)),
                (rest, lambda x: np.isclose(radius(x), OUTER)),
            )
        ]
        (state,) = rings.contact(pair, Reduction.dirichlet(rings.space, held))
        (result,) = state.pairs
        assert (result.status == SLIP).all()
        fields, x = ContactFields.of(state, rings.body), rings.x
        errors_ = []
        for at_ in (result.node, result.opposite):
            force = fields.force.x.array.reshape(-1, 2)[at_]
            moment = np.abs(np.sum(x[at_, 0] * force[:, 1] - x[at_, 1] * force[:, 0]))
            errors_.append(abs(moment / torque - 1))
            p, q = fields.pressure.x.array[at_], fields.traction.x.array.reshape(-1, 2)[at_]
            errors_ += [
                np.sqrt(np.mean((p / pressure - 1) ** 2)),
                np.sqrt(np.mean((np.linalg.norm(q, axis=1) / mu / pressure - 1) ** 2)),
            ]
        off.append(errors_)
    assert np.log2(np.divide(*off)).min() > 1.5
    assert max(off[1]) < 1e-3

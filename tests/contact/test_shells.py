"""Two bodies that meet in curved faces, and press fits, against Lame's exact solutions."""

from dataclasses import replace

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle

from pw_elements import Reduction, assemble_vector, boundary_measure, prescribe
from pw_elements.contact import SLIP, ContactFields, ContactPair, DeformableSurface, NotFound, Plane
from pw_elements.meshes import curved_mesh, quadrilaterals, triangles
from study.verification.c_mesh_families import meshed
from tests.contact.cases import GALERKIN, PW, ElasticBody, on_plane
from tests.contact.residuals import (
    ProblemData,
    largest_residual,
    measure_residuals,
    split_into_substeps,
)
from tests.contact.two_bodies import PLANE_CELLS, StackedBlocks, join_meshes, split_facets_by_side

INNER, BETWEEN, OUTER, PRESSURE, NU = 1.0, 1.5, 2.2, 1e-3, 0.3


def _tube(low, high, n, cell):
    size = (max(2, round(1.5 * n * (high - low))), 2 * n, max(1, n // 3))
    if cell in PLANE_CELLS:
        ends = [(low, 0.0), (high, 1.0)]
        return curved_mesh(create_rectangle(MPI.COMM_SELF, ends, size[:2], CellType[cell]), _rolled)
    ends = [(low, 0, 0), (high, 1.0, 0.5)]
    return curved_mesh(create_box(MPI.COMM_SELF, ends, size, CellType[cell]), _rolled)


def _rolled(x):
    """A quarter of a circle about the last axis, of a strip."""
    angle = np.pi / 2 * x[:, 1]
    return np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle), x[:, 2]])


def meeting(body, where, is_outside, slave, coincident=True, **options):
    """The pair of the faces at a marker, one body in the other."""
    inner, outer = split_facets_by_side(body, where, is_outside)
    own, theirs = (inner, outer) if slave == "inner" else (outer, inner)
    nodes = fem.locate_dofs_topological(body.space, body.dim - 1, own)
    return ContactPair(nodes, DeformableSurface(theirs, coincident=coincident), **options)


class Shells(ElasticBody):
    """One in the other, the outer one free outside; symmetry planes hold them."""

    def __init__(self, kind, cell, divisions, slave="inner", coincident=True):
        self.power = 3 if kind == "revolved" else 2  # in its stresses; this is a sphere
        mesh = join_meshes(
            _tube(INNER, BETWEEN, divisions[0], cell), _tube(BETWEEN, OUTER, divisions[1], cell)
        )
        state = {"tube": "plane strain", "revolved": "axisymmetric"}.get(kind, "solid")
        super().__init__(mesh, state=state, E=1.0, nu=NU)

        def on(radius):
            return lambda x: np.isclose(np.hypot(x[0], x[1]), radius)

        beyond = lambda x: np.hypot(x[:, 0], x[:, 1]) > BETWEEN  # noqa: E731
        self.pair = meeting(self, on(BETWEEN), beyond, slave, coincident)
        self.inside = self.pushed(PRESSURE, on(INNER))
        ends = [(i, on_plane(i, 0.0)) for i in range(self.dim)]
        self.supports = self.make_supports(
            *ends, *[(2, on_plane(2, 0.5))] * (kind == "tube in space")
        )

    def pushed(self, pressure, where):
        surface = boundary_measure(self.mesh, where, 6)
        return assemble_vector(
            self.body.surface_load(-pressure * ufl.FacetNormal(self.mesh), surface)
        )

    @property
    def pressure(self):
        """Between them, exact."""
        k = self.power
        return PRESSURE * ((OUTER / BETWEEN) ** k - 1) / ((OUTER / INNER) ** k - 1)

    def displacement(self):
        """Exact, (nodes, dim)."""
        k = self.power
        r = np.linalg.norm(self.x[:, :2], axis=1)
        scale = PRESSURE * INNER**k / (OUTER**k - INNER**k)
        if k == 2:
            moved = scale * (1 + NU) * ((1 - 2 * NU) * r + OUTER**2 / r)
        else:
            moved = scale * ((1 - 2 * NU) * r + (1 + NU) / 2 * OUTER**3 / r**2)
        directed = np.zeros_like(self.x)
        directed[:, :2] = (moved / r)[:, None] * self.x[:, :2]
        return directed


SHELLS = [
    ("tube", "triangle", (4, 8), "inner"),
    ("tube", "quadrilateral", (4, 8), "outer"),
    ("tube in space", "tetrahedron", (2, 4), "inner"),
    ("tube in space", "hexahedron", (2, 4), "outer"),
    ("revolved", "triangle", (4, 8), "outer"),
    ("revolved", "quadrilateral", (4, 8), "inner"),
]


def errors(shells):
    """Of displacements, the largest, and of pressures on either side, the root of the mean square.

    Of the opposite side's shear the largest over the pressure, too.
    """
    (state,) = shells.solve_contact(shells.pair, shells.supports, shells.inside)
    (pair,) = state.pairs
    fields = ContactFields.from_state(state, shells.body)
    exact = shells.displacement()
    wrong = state.displacement.array.reshape(exact.shape) - exact
    found = [np.abs(wrong).max() / np.abs(exact).max()]
    for nodes in (pair.node, pair.opposite_node):
        off = fields.pressure.x.array[nodes] / shells.pressure - 1
        found.append(np.sqrt(np.mean(off**2)))
    shear = fields.traction.x.array.reshape(shells.x.shape)[pair.opposite_node]
    return np.array(found), np.abs(shear).max() / shells.pressure


@pytest.mark.parametrize(("kind", "cell", "divisions", "slave"), SHELLS)
def test_tubes_and_spheres_come_nearer_with_order_two(kind, cell, divisions, slave):
    """Measures are those of chords, of second order, and so are pressures of quadratic elements."""
    found, shear = zip(
        *(errors(Shells(kind, cell, (k, 3 * k // 2), slave)) for k in divisions), strict=True
    )
    moved, *pressures = np.log(np.divide(*found)) / np.log(divisions[1] / divisions[0])
    assert moved > 1.7
    assert min(pressures) > 1.5
    assert max(found[1][1:]) < 5e-3
    assert shear[1] < 5e-4


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_gaps_of_meshes_are_of_order_four(cell):
    """They are pressed out where sides are not said to coincide."""
    found = [errors(Shells("tube", cell, (k, 3 * k // 2), "outer", False))[0] for k in (4, 8)]
    moved, *pressures = np.log2(np.divide(*found))
    assert moved > 3.5
    assert min(pressures) > 2.5


def test_sides_that_do_not_coincide_are_named():
    stack = StackedBlocks((4, 3), map_upper=lambda x: x + np.array([0.0, 0.02, 0.0]))
    pair = stack.make_pair()
    coincident = replace(pair, surface=replace(pair.surface, coincident=True))
    with pytest.raises(ValueError, match="farther than meshes of one surface do"):
        stack.solve_contact(coincident)
    with pytest.raises(ValueError, match="interference of coincident sides is a depth"):
        replace(coincident, interference=True)


# -- press fits ------------------------------------------------------------------------------------

DEPTH = 1e-3 * BETWEEN


def fitted(state, edges, interference, depth=DEPTH, slave="inner"):
    """Largest error of Lame's pressure on either side of two rings that cannot grow along the axis.

    The outer one is too narrow by a depth, or is said to be: by a number or a function.
    """
    round_, said = state == "plane strain", interference is not True

    def ring(low, high, n):
        ends = [(low, 0.0), (high, 1.0 if round_ else 0.5)]
        flat = create_rectangle(MPI.COMM_SELF, ends, (n // 2, n) if round_ else (n, n // 2))
        return curved_mesh(flat, _rolled) if round_ else flat

    def radius(x):
        return np.hypot(x[0], x[1]) if round_ else x[0]

    bore = BETWEEN - (0.0 if said else depth)
    mesh = join_meshes(ring(INNER, BETWEEN, edges[0]), ring(bore, OUTER, edges[1]))
    rings = ElasticBody(mesh, PW, state, 1.0, NU)
    near = lambda x: np.abs(radius(x) - BETWEEN) < 2 * depth  # noqa: E731
    beyond = lambda x: radius(x.T) > BETWEEN  # noqa: E731
    pair = meeting(rings, near, beyond, slave, said, interference=interference)
    ends = [(0, on_plane(0, 0.0))] if round_ else [(1, on_plane(1, 0.5))]
    (found,) = rings.solve_contact(pair, rings.make_supports((1, on_plane(1, 0.0)), *ends))
    both = np.concatenate([found.pairs[0].node, found.pairs[0].opposite_node])
    pressure = ContactFields.from_state(found, rings.body).pressure.x.array[both]
    a, b, c = INNER, BETWEEN, OUTER
    exact = depth / (1 - NU**2) / (2 * b**3) * (b**2 - a**2) * (c**2 - b**2) / (c**2 - a**2)
    return np.abs(pressure / exact - 1).max()


@pytest.mark.parametrize("slave", ["inner", "outer"])
def test_a_press_fit_has_lames_pressure(slave):
    off = [fitted("axisymmetric", (n, 3 * n // 2), True, 1e-5, slave) for n in (4, 8)]
    assert off[1] < 3e-3
    assert off[0] > 2.5 * off[1]


@pytest.mark.parametrize("depth", [DEPTH, lambda x: DEPTH * np.hypot(x[0], x[1]) / BETWEEN])
def test_nominal_interference_has_lames_pressure_on_coarse_meshes(depth):
    assert fitted("plane strain", (5, 7), depth) < 0.01


def test_gaps_of_meshes_beside_an_interference_are_warned_of(caplog):
    assert fitted("plane strain", (5, 7), True) > 0.1
    (warning,) = caplog.messages
    assert "coincident=True" in warning
    caplog.clear()
    assert fitted("plane strain", (24, 24), True) < 0.04
    assert not caplog.messages


@pytest.mark.parametrize("slave", ["inner", "outer"])
def test_friction_on_a_curved_face_has_coulombs_torque(slave):
    """A ring that is blown up and turned in another one, on meshes of Gmsh, slips all round."""
    mu, grown, turn = 0.3, 1e-3, 2e-3

    def ring(low, high, size):
        def build():
            disks = [[(2, gmsh.model.occ.addDisk(0, 0, 0, r, r))] for r in (high, low)]
            gmsh.model.occ.cut(*disks)

        return meshed(build, 2, size, 2)

    lame, shear = NU / (1 + NU) / (1 - 2 * NU), 1 / 2 / (1 + NU)
    A, B = np.linalg.solve([[INNER, 1 / INNER], [OUTER, 1 / OUTER]], [grown, 0.0])
    pressure = 2 * shear * B / BETWEEN**2 - 2 * (lame + shear) * A
    torque = 2 * np.pi * BETWEEN**2 * mu * pressure
    off = []
    for size in (0.2, 0.1):
        mesh = join_meshes(ring(INNER, BETWEEN, size), ring(BETWEEN, OUTER, 1.3 * size))
        rings = ElasticBody(mesh, PW, "plane strain", 1.0, NU)
        there = lambda x: np.isclose(np.hypot(x[0], x[1]), BETWEEN)  # noqa: E731
        beyond = lambda x: np.hypot(x[:, 0], x[:, 1]) > BETWEEN  # noqa: E731
        pair = meeting(rings, there, beyond, slave, friction=mu)
        moved, rest = fem.Function(rings.space), fem.Function(rings.space)
        moved.interpolate(lambda x: grown / INNER * x[:2] + turn * np.array([-x[1], x[0]]))
        held = []
        for u, r in ((moved, INNER), (rest, OUTER)):
            rim = lambda x, r=r: np.isclose(np.hypot(x[0], x[1]), r)  # noqa: E731
            held.append(fem.dirichletbc(u, fem.locate_dofs_geometrical(rings.space, rim)))
        (state,) = rings.solve_contact(pair, Reduction.dirichlet(rings.space, held))
        (result,) = state.pairs
        assert (result.status == SLIP).all()
        fields, x = ContactFields.from_state(state, rings.body), rings.x
        errors_ = []
        for at_ in (result.node, result.opposite_node):
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


# -- a ring that is shrunk onto a rigid shaft ------------------------------------------------------

BORE, RIM, HEIGHT = 2.0, 3.5, 0.6
MODULUS, FIT = 500.0, 0.01


def lame():
    """Pressure between the shaft and a ring in plane strain; G. Lamé (1852), any textbook."""
    opening = (1 - 2 * NU) * BORE + RIM**2 / BORE
    return FIT * MODULUS / (1 + NU) * (RIM**2 - BORE**2) / BORE**2 / opening


class Ring(ElasticBody):
    """A ring between two smooth planes, its bore smaller than the shaft by `FIT`."""

    def __init__(self, n, method=PW, build=triangles):
        mesh = build(MPI.COMM_SELF, (BORE, 0.0), (RIM, HEIGHT), (n, 2))
        super().__init__(mesh, method, "axisymmetric", MODULUS, NU)
        self.ends = self.make_supports(*((1, on_plane(1, z)) for z in (0.0, HEIGHT)))

    def pair(self, mu=0.0, interference=True):
        shaft = Plane((BORE + FIT, 0), (1, 0))
        return ContactPair(on_plane(0, BORE), shaft, mu, interference=interference)


@pytest.mark.parametrize(
    ("method", "build"), [(PW, triangles), (GALERKIN, triangles), (PW, quadrilaterals)]
)
def test_a_shrunk_ring_has_lames_pressure(method, build):
    errors = []
    for ring in (Ring(n, method, build) for n in (3, 6)):
        one, two = ring.solve_contact(ring.pair(), ring.ends, [ring.zero_load] * 2)
        errors.append(abs(one.pairs[0].force[0] / (2 * np.pi * BORE * HEIGHT) / lame() - 1))
        assert np.abs(one.pairs[0].gap).max() < 1e-12
        # gone after the first increment
        assert two.displacement.array_r == pytest.approx(one.displacement.array_r, abs=1e-12)
    assert errors[1] < 1e-4
    assert errors[1] < errors[0] / 6


def test_interference_has_to_be_asked_for():
    ring = Ring(3)
    with pytest.raises(ValueError, match="is to say interference=True"):
        ring.solve_contact(ring.pair(interference=False), ring.ends)


def test_a_fit_in_parts_obeys_the_law_in_each_of_them(monkeypatch):
    ring = Ring(3)
    problem = ring.contact_problem(ring.pair(0.2), ring.ends)
    solved, first = problem._stepping._solve_part, problem.undeformed

    def timid(state, target, *others):
        if target.load_factor - (0.0 if state is first else 0.5) > 0.5:
            raise NotFound("too much")
        return solved(state, target, *others)

    monkeypatch.setattr(problem._stepping, "_solve_part", timid)
    cut = problem.step(first, ring.zero_load)
    conditions = [prescribe(ring.space, 1, on_plane(1, z)) for z in (0.0, HEIGHT)]
    stated = ProblemData(ring.K, ring.space, [ring.zero_load], conditions, [ring.pair(0.2)])
    assert [share for share, _ in cut.substates] == [0.5]
    assert largest_residual(measure_residuals(*split_into_substeps(stated, [cut]))) < 1e-9
    unscaled, steps, _ = split_into_substeps(stated, [cut])
    assert largest_residual(measure_residuals(unscaled, steps)) > 1e-3

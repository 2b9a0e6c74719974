"""Press fits, and bodies in contact along curved faces, compared with Lame's exact solutions."""

from dataclasses import replace

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle

from pw_elements import Reduction, assemble_vector, boundary_measure, prescribe
from pw_elements.contact import (
    SLIP,
    ContactFields,
    ContactPair,
    DeformableSurface,
    Plane,
    SolutionNotFound,
)
from pw_elements.meshes import curved_mesh, quadrilaterals, triangles
from study.meshes.mesh_families import mesh_with_gmsh
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, ElasticBody, on_plane
from tests.contact.residuals import (
    LinearContactProblemData,
    largest_residual,
    recompute_residuals_per_step,
    split_increments_at_substeps,
)
from tests.contact.two_bodies import PLANE_CELLS, StackedBlocks, join_meshes, split_facets_by_side

INNER_RADIUS, INTERFACE_RADIUS, OUTER_RADIUS, PRESSURE, NU = 1.0, 1.5, 2.2, 1e-3, 0.3


def _make_quarter_tube_mesh(inner_radius, outer_radius, cells_per_length, cell):
    """Return the mesh of a quarter of a tube; `cells_per_length` scales all numbers of cells."""
    divisions = (
        max(2, round(1.5 * cells_per_length * (outer_radius - inner_radius))),
        2 * cells_per_length,
        max(1, cells_per_length // 3),
    )
    if cell in PLANE_CELLS:
        corners = [(inner_radius, 0.0), (outer_radius, 1.0)]
        return curved_mesh(
            create_rectangle(MPI.COMM_SELF, corners, divisions[:2], CellType[cell]),
            _roll_strip_into_quarter_circle,
        )
    corners = [(inner_radius, 0, 0), (outer_radius, 1.0, 0.5)]
    return curved_mesh(
        create_box(MPI.COMM_SELF, corners, divisions, CellType[cell]),
        _roll_strip_into_quarter_circle,
    )


def _roll_strip_into_quarter_circle(x):
    """Map points of a strip to a quarter of a ring about the third axis."""
    angle = np.pi / 2 * x[:, 1]
    return np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle), x[:, 2]])


def make_interface_pair(body, where, is_outside, slave, coincident=True, **pair_options):
    """Return the contact pair of two nested bodies that touch along the marked faces."""
    inner_facets, outer_facets = split_facets_by_side(body, where, is_outside)
    slave_facets, master_facets = (
        (inner_facets, outer_facets) if slave == "inner" else (outer_facets, inner_facets)
    )
    nodes = fem.locate_dofs_topological(body.space, body.dim - 1, slave_facets)
    return ContactPair(
        nodes, DeformableSurface(master_facets, coincident=coincident), **pair_options
    )


class NestedShells(ElasticBody):
    """Two nested tubes or spheres under an inner pressure, held by symmetry planes."""

    def __init__(self, kind, cell, divisions, slave="inner", coincident=True):
        self.power = (
            3 if kind == "revolved" else 2
        )  # exponent of the radius in the stresses; "revolved" is an axisymmetric sphere
        mesh = join_meshes(
            _make_quarter_tube_mesh(INNER_RADIUS, INTERFACE_RADIUS, divisions[0], cell),
            _make_quarter_tube_mesh(INTERFACE_RADIUS, OUTER_RADIUS, divisions[1], cell),
        )
        state = {"tube": "plane strain", "revolved": "axisymmetric"}.get(kind, "solid")
        super().__init__(mesh, state=state, E=1.0, nu=NU)

        def on_radius(radius):
            return lambda x: np.isclose(np.hypot(x[0], x[1]), radius)

        is_outside = lambda x: np.hypot(x[:, 0], x[:, 1]) > INTERFACE_RADIUS  # noqa: E731
        self.pair = make_interface_pair(
            self, on_radius(INTERFACE_RADIUS), is_outside, slave, coincident
        )
        self.pressure_load = self.assemble_pressure_load(PRESSURE, on_radius(INNER_RADIUS))
        ends = [(i, on_plane(i, 0.0)) for i in range(self.dim)]
        self.supports = self.make_supports(
            *ends, *[(2, on_plane(2, 0.5))] * (kind == "tube in space")
        )

    def assemble_pressure_load(self, pressure, where):
        surface = boundary_measure(self.mesh, where, 6)
        return assemble_vector(
            self.body.surface_load(-pressure * ufl.FacetNormal(self.mesh), surface)
        )

    @property
    def exact_contact_pressure(self):
        """Return the exact pressure between the two shells."""
        power = self.power
        return (
            PRESSURE
            * ((OUTER_RADIUS / INTERFACE_RADIUS) ** power - 1)
            / ((OUTER_RADIUS / INNER_RADIUS) ** power - 1)
        )

    def exact_displacement(self):
        """Return the exact displacements (nodes, dim) of both shells."""
        power = self.power
        r = np.linalg.norm(self.x[:, :2], axis=1)
        scale = PRESSURE * INNER_RADIUS**power / (OUTER_RADIUS**power - INNER_RADIUS**power)
        if power == 2:
            radial = scale * (1 + NU) * ((1 - 2 * NU) * r + OUTER_RADIUS**2 / r)
        else:
            radial = scale * ((1 - 2 * NU) * r + (1 + NU) / 2 * OUTER_RADIUS**3 / r**2)
        vectors = np.zeros_like(self.x)
        vectors[:, :2] = (radial / r)[:, None] * self.x[:, :2]
        return vectors


SHELL_CASES = [
    ("tube", "triangle", (4, 8), "inner"),
    ("tube", "quadrilateral", (4, 8), "outer"),
    ("tube in space", "tetrahedron", (2, 4), "inner"),
    ("tube in space", "hexahedron", (2, 4), "outer"),
    ("revolved", "triangle", (4, 8), "outer"),
    ("revolved", "quadrilateral", (4, 8), "inner"),
]


def solve_and_measure_errors_and_shear(shells):
    """Return the errors of displacement and pressures, and the largest shear stress of the master.

    The error of the displacements is their largest error divided by the largest displacement. The
    errors of the pressures on both sides are root mean squares relative to the exact pressure. The
    shear stress is divided by this pressure.
    """
    (state,) = shells.solve_contact(shells.pair, shells.supports, shells.pressure_load)
    (pair,) = state.pairs
    fields = ContactFields.from_state(state, shells.body)
    exact_displacement = shells.exact_displacement()
    difference = state.displacement.array.reshape(exact_displacement.shape) - exact_displacement
    errors = [np.abs(difference).max() / np.abs(exact_displacement).max()]
    for nodes in (pair.node, pair.opposite_node):
        error = fields.pressure.x.array[nodes] / shells.exact_contact_pressure - 1
        errors.append(np.sqrt(np.mean(error**2)))
    shear = fields.traction.x.array.reshape(shells.x.shape)[pair.opposite_node]
    return np.array(errors), np.abs(shear).max() / shells.exact_contact_pressure


@pytest.mark.parametrize(("kind", "cell", "divisions", "slave"), SHELL_CASES)
def test_errors_of_tubes_and_spheres_are_of_second_order(kind, cell, divisions, slave):
    """The errors of displacements and pressures in tubes and spheres are of second order.

    The reason is that integrals over the chords of curved faces have errors of second order.
    """
    errors, shear = zip(
        *(
            solve_and_measure_errors_and_shear(NestedShells(kind, cell, (k, 3 * k // 2), slave))
            for k in divisions
        ),
        strict=True,
    )
    displacement_order, *pressure_orders = np.log(np.divide(*errors)) / np.log(
        divisions[1] / divisions[0]
    )
    assert displacement_order > 1.7
    assert min(pressure_orders) > 1.5
    assert max(errors[1][1:]) < 5e-3
    assert shear[1] < 5e-4


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_effects_of_mesh_gaps_are_of_fourth_order(cell):
    """Gaps between the meshes of curved faces cause errors of fourth order in the displacements.

    The two sides are not declared coincident; pressure therefore has to close the gaps that arise
    because both meshes approximate the same circle differently.
    """
    errors = [
        solve_and_measure_errors_and_shear(
            NestedShells("tube", cell, (k, 3 * k // 2), "outer", False)
        )[0]
        for k in (4, 8)
    ]
    displacement_order, *pressure_orders = np.log2(np.divide(*errors))
    assert displacement_order > 3.5
    assert min(pressure_orders) > 2.5


def test_sides_that_do_not_coincide_are_refused():
    stack = StackedBlocks((4, 3), map_upper=lambda x: x + np.array([0.0, 0.02, 0.0]))
    pair = stack.make_pair()
    coincident = replace(pair, surface=replace(pair.surface, coincident=True))
    with pytest.raises(ValueError, match="farther than meshes of one surface do"):
        stack.solve_contact(coincident)
    with pytest.raises(ValueError, match="interference of coincident sides is a depth"):
        replace(coincident, interference=True)


# -- press fits ------------------------------------------------------------------------------------

PRESS_FIT_DEPTH = 1e-3 * INTERFACE_RADIUS


def press_fit_pressure_error(
    state, cells_per_ring, interference, depth=PRESS_FIT_DEPTH, slave="inner"
):
    """Return the largest relative deviation from Lame's pressure in a press fit of two rings.

    Both sides are considered. The rings are fixed along the axis. If `interference` is True, the
    bore of the outer ring is too narrow by `depth`. Otherwise, the meshes fit together, and
    `interference` is the depth as a number or a function.
    """
    is_plane, is_nominal = state == "plane strain", interference is not True

    def make_ring_mesh(inner_radius, outer_radius, n):
        ends = [(inner_radius, 0.0), (outer_radius, 1.0 if is_plane else 0.5)]
        strip = create_rectangle(MPI.COMM_SELF, ends, (n // 2, n) if is_plane else (n, n // 2))
        return curved_mesh(strip, _roll_strip_into_quarter_circle) if is_plane else strip

    def radius(x):
        return np.hypot(x[0], x[1]) if is_plane else x[0]

    bore = INTERFACE_RADIUS - (0.0 if is_nominal else depth)
    mesh = join_meshes(
        make_ring_mesh(INNER_RADIUS, INTERFACE_RADIUS, cells_per_ring[0]),
        make_ring_mesh(bore, OUTER_RADIUS, cells_per_ring[1]),
    )
    rings = ElasticBody(mesh, PETROV_GALERKIN, state, 1.0, NU)
    near_interface = lambda x: np.abs(radius(x) - INTERFACE_RADIUS) < 2 * depth  # noqa: E731
    is_outside = lambda x: radius(x.T) > INTERFACE_RADIUS  # noqa: E731
    pair = make_interface_pair(
        rings, near_interface, is_outside, slave, is_nominal, interference=interference
    )
    ends = [(0, on_plane(0, 0.0))] if is_plane else [(1, on_plane(1, 0.5))]
    (solution,) = rings.solve_contact(pair, rings.make_supports((1, on_plane(1, 0.0)), *ends))
    both_sides = np.concatenate([solution.pairs[0].node, solution.pairs[0].opposite_node])
    pressure = ContactFields.from_state(solution, rings.body).pressure.x.array[both_sides]
    a, b, c = INNER_RADIUS, INTERFACE_RADIUS, OUTER_RADIUS
    exact = depth / (1 - NU**2) / (2 * b**3) * (b**2 - a**2) * (c**2 - b**2) / (c**2 - a**2)
    return np.abs(pressure / exact - 1).max()


@pytest.mark.parametrize("slave", ["inner", "outer"])
def test_a_press_fit_has_lames_pressure(slave):
    errors = [
        press_fit_pressure_error("axisymmetric", (n, 3 * n // 2), True, 1e-5, slave) for n in (4, 8)
    ]
    assert errors[1] < 3e-3
    assert errors[0] > 2.5 * errors[1]


@pytest.mark.parametrize(
    "depth", [PRESS_FIT_DEPTH, lambda x: PRESS_FIT_DEPTH * np.hypot(x[0], x[1]) / INTERFACE_RADIUS]
)
def test_nominal_interference_has_lames_pressure_on_coarse_meshes(depth):
    assert press_fit_pressure_error("plane strain", (5, 7), depth) < 0.01


def test_mesh_gaps_beside_an_interference_are_logged_as_warnings(caplog):
    assert press_fit_pressure_error("plane strain", (5, 7), True) > 0.1
    (warning,) = caplog.messages
    assert "coincident=True" in warning
    caplog.clear()
    assert press_fit_pressure_error("plane strain", (24, 24), True) < 0.04
    assert not caplog.messages


@pytest.mark.parametrize("slave", ["inner", "outer"])
def test_friction_on_a_curved_face_has_coulombs_torque(slave):
    """A ring that rotates within another ring has the friction torque of Coulomb's law.

    The inner ring expands, rotates, and slips along its whole circumference. Both meshes are made
    by Gmsh. Torque, pressure and shear stress are compared with the exact solution.
    """
    mu, radial_displacement, rotation = 0.3, 1e-3, 2e-3

    def make_ring_mesh(inner_radius, outer_radius, size):
        def build_ring_geometry():
            disks = [
                [(2, gmsh.model.occ.addDisk(0, 0, 0, rim_radius, rim_radius))]
                for rim_radius in (outer_radius, inner_radius)
            ]
            gmsh.model.occ.cut(*disks)

        return mesh_with_gmsh(build_ring_geometry, 2, size, 2)

    lame, shear = NU / (1 + NU) / (1 - 2 * NU), 1 / 2 / (1 + NU)
    A, B = np.linalg.solve(
        [[INNER_RADIUS, 1 / INNER_RADIUS], [OUTER_RADIUS, 1 / OUTER_RADIUS]],
        [radial_displacement, 0.0],
    )
    pressure = 2 * shear * B / INTERFACE_RADIUS**2 - 2 * (lame + shear) * A
    torque = 2 * np.pi * INTERFACE_RADIUS**2 * mu * pressure
    errors_by_size = []
    for size in (0.2, 0.1):
        mesh = join_meshes(
            make_ring_mesh(INNER_RADIUS, INTERFACE_RADIUS, size),
            make_ring_mesh(INTERFACE_RADIUS, OUTER_RADIUS, 1.3 * size),
        )
        rings = ElasticBody(mesh, PETROV_GALERKIN, "plane strain", 1.0, NU)
        on_interface = lambda x: np.isclose(np.hypot(x[0], x[1]), INTERFACE_RADIUS)  # noqa: E731
        is_outside = lambda x: np.hypot(x[:, 0], x[:, 1]) > INTERFACE_RADIUS  # noqa: E731
        pair = make_interface_pair(rings, on_interface, is_outside, slave, friction=mu)
        inner_motion, outer_motion = fem.Function(rings.space), fem.Function(rings.space)
        inner_motion.interpolate(
            lambda x: (
                radial_displacement / INNER_RADIUS * x[:2] + rotation * np.array([-x[1], x[0]])
            )
        )
        conditions = []
        for rim_motion, rim_radius in ((inner_motion, INNER_RADIUS), (outer_motion, OUTER_RADIUS)):
            on_rim = lambda x, rim_radius=rim_radius: np.isclose(np.hypot(x[0], x[1]), rim_radius)  # noqa: E731
            conditions.append(
                fem.dirichletbc(rim_motion, fem.locate_dofs_geometrical(rings.space, on_rim))
            )
        (state,) = rings.solve_contact(pair, Reduction.dirichlet(rings.space, conditions))
        (result,) = state.pairs
        assert (result.status == SLIP).all()
        fields, x = ContactFields.from_state(state, rings.body), rings.x
        errors = []
        for side_nodes in (result.node, result.opposite_node):
            force = fields.force.x.array.reshape(-1, 2)[side_nodes]
            moment = np.abs(np.sum(x[side_nodes, 0] * force[:, 1] - x[side_nodes, 1] * force[:, 0]))
            errors.append(abs(moment / torque - 1))
            p, q = (
                fields.pressure.x.array[side_nodes],
                fields.traction.x.array.reshape(-1, 2)[side_nodes],
            )
            errors += [
                np.sqrt(np.mean((p / pressure - 1) ** 2)),
                np.sqrt(np.mean((np.linalg.norm(q, axis=1) / mu / pressure - 1) ** 2)),
            ]
        errors_by_size.append(errors)
    assert np.log2(np.divide(*errors_by_size)).min() > 1.5
    assert max(errors_by_size[1]) < 1e-3


# -- a ring that is shrunk onto a rigid shaft ------------------------------------------------------

BORE_RADIUS, RIM_RADIUS, RING_HEIGHT = 2.0, 3.5, 0.6
YOUNGS_MODULUS, INTERFERENCE = 500.0, 0.01


def exact_shrink_fit_pressure():
    """Return the pressure of a ring on a shaft in plane strain (G. Lamé, 1852; any textbook)."""
    compliance = (1 - 2 * NU) * BORE_RADIUS + RIM_RADIUS**2 / BORE_RADIUS
    return (
        INTERFERENCE
        * YOUNGS_MODULUS
        / (1 + NU)
        * (RIM_RADIUS**2 - BORE_RADIUS**2)
        / BORE_RADIUS**2
        / compliance
    )


class ShrunkRing(ElasticBody):
    """A ring between two frictionless planes, whose bore is too small by `INTERFERENCE`."""

    def __init__(self, n, method=PETROV_GALERKIN, build=triangles):
        mesh = build(MPI.COMM_SELF, (BORE_RADIUS, 0.0), (RIM_RADIUS, RING_HEIGHT), (n, 2))
        super().__init__(mesh, method, "axisymmetric", YOUNGS_MODULUS, NU)
        self.end_supports = self.make_supports(*((1, on_plane(1, z)) for z in (0.0, RING_HEIGHT)))

    def shaft_pair(self, mu=0.0, interference=True):
        shaft = Plane((BORE_RADIUS + INTERFERENCE, 0), (1, 0))
        return ContactPair(on_plane(0, BORE_RADIUS), shaft, mu, interference=interference)


@pytest.mark.parametrize(
    ("method", "build"),
    [(PETROV_GALERKIN, triangles), (GALERKIN, triangles), (PETROV_GALERKIN, quadrilaterals)],
)
def test_a_shrunk_ring_has_lames_pressure(method, build):
    errors = []
    for ring in (ShrunkRing(n, method, build) for n in (3, 6)):
        first_state, second_state = ring.solve_contact(
            ring.shaft_pair(), ring.end_supports, [ring.zero_load] * 2
        )
        errors.append(
            abs(
                first_state.pairs[0].force[0]
                / (2 * np.pi * BORE_RADIUS * RING_HEIGHT)
                / exact_shrink_fit_pressure()
                - 1
            )
        )
        assert np.abs(first_state.pairs[0].gap).max() < 1e-12
        # the interference acts from the first increment on
        assert second_state.displacement.array_r == pytest.approx(
            first_state.displacement.array_r, abs=1e-12
        )
    assert errors[1] < 1e-4
    assert errors[1] < errors[0] / 6


def test_initial_penetration_needs_interference():
    ring = ShrunkRing(3)
    with pytest.raises(ValueError, match="or set interference=True"):
        ring.solve_contact(ring.shaft_pair(interference=False), ring.end_supports)


def test_a_fit_in_substeps_obeys_the_law_in_each_of_them(monkeypatch):
    ring = ShrunkRing(3)
    problem = ring.contact_problem(ring.shaft_pair(0.2), ring.end_supports)
    solve_part, undeformed = problem._small_strain_stepping._solve_substep, problem.undeformed

    def fail_above_half(state, target, *arguments):
        if target.load_factor - (0.0 if state is undeformed else 0.5) > 0.5:
            raise SolutionNotFound("too much")
        return solve_part(state, target, *arguments)

    monkeypatch.setattr(problem._small_strain_stepping, "_solve_substep", fail_above_half)
    cut_state = problem.step(undeformed, ring.zero_load)
    conditions = [prescribe(ring.space, 1, on_plane(1, z)) for z in (0.0, RING_HEIGHT)]
    problem_data = LinearContactProblemData(
        ring.K, ring.space, [ring.zero_load], conditions, [ring.shaft_pair(0.2)]
    )
    assert [fraction for fraction, _ in cut_state.substates] == [0.5]
    assert (
        largest_residual(
            recompute_residuals_per_step(*split_increments_at_substeps(problem_data, [cut_state]))
        )
        < 1e-9
    )
    substep_problem, steps, _ = split_increments_at_substeps(problem_data, [cut_state])
    assert largest_residual(recompute_residuals_per_step(substep_problem, steps)) > 1e-3

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle

from pw_elements import (
    Reduction,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    force_transfer,
    forces_along,
    nodal_flux,
    reactions,
    solve,
)
from pw_elements.elasticity import order_by_position
from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, Q8, ElasticBody, on_plane
from tests.library.properties import boundary_dofs, make_distorted_unit_mesh

CELL_TYPES = [CellType.tetrahedron, CellType.hexahedron, CellType.triangle, CellType.quadrilateral]
PLANE_BODY_SETTINGS = [
    (triangles, GALERKIN, "plane stress"),
    (triangles, PETROV_GALERKIN, "plane strain"),
    (triangles, GALERKIN, "axisymmetric"),
    (triangles, PETROV_GALERKIN, "axisymmetric"),
    (quadrilaterals, Q8, "plane stress"),
    (quadrilaterals, PETROV_GALERKIN, "plane stress"),
]


def make_block_of_uneven_cells(
    make_mesh=triangles, method=PETROV_GALERKIN, state="plane stress", thickness=1.0
):
    """Create an elastic block of about 2 x 1 with cells of different widths."""
    mesh = make_mesh(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (5, 2))
    mesh = move_nodes(mesh, lambda x: x + 0.1 * np.sin(3 * x[:, :1]) * [1, 0, 0])
    return ElasticBody(mesh, method, state, 10.0, thickness=thickness)


def uniform_pressure_forces(body, where, pressure=3.0):
    """Return the nodal forces (m,) of a uniform pressure, in the order of the surface's nodes."""
    f = body.traction_load(pressure * np.eye(body.dim)[-1], where)
    x = body.space.tabulate_dof_coordinates()
    nodes = np.flatnonzero(where(x.T))
    nodes = nodes[order_by_position(x[nodes])]
    return f.array_r.reshape(-1, body.dim)[nodes, -1]


@pytest.mark.parametrize(("side", "axis"), [(0, 1), (1, 0)])
def test_forces_along_a_side_are_ordered_by_position(side, axis):
    """Forces along a side are ordered by the positions along this side.

    On a side at constant x, for example, round-off of x must not affect the order.
    """
    body = make_block_of_uneven_cells()
    body.mesh.geometry.x[::2] *= 1 + 1e-15
    end = body.mesh.geometry.x[:, side].max()
    f = body.traction_load((2.0, 5.0), on_plane(side, end))
    line = forces_along(body.space, f, on_plane(side, end))
    assert np.all(np.diff(line.position[:, axis]) > 0)
    assert np.allclose(line.force.sum(axis=0), f.array_r.reshape(-1, 2).sum(axis=0))


@pytest.mark.parametrize(("build", "method", "state"), PLANE_BODY_SETTINGS)
def test_nodal_pressures_reproduce_a_uniform_pressure(build, method, state):
    thickness = 1.0 if state == "axisymmetric" else 0.4
    body = make_block_of_uneven_cells(build, method, state, thickness)
    surface = SurfaceNodes.from_body(body.body, on_plane(1, 0.0))
    end = 2 + 0.1 * np.sin(6)
    total = np.pi * end**2 if state == "axisymmetric" else thickness * end
    assert surface.weight_area.sum() == pytest.approx(total)
    assert surface.tributary_area.sum() == pytest.approx(total)
    force = uniform_pressure_forces(body, on_plane(1, 0.0))
    pressure = surface.pressure(force)
    on_axis = state == "axisymmetric" and method == GALERKIN  # without weight on the axis
    assert np.flatnonzero(np.isnan(pressure)).tolist() == [0] * on_axis
    assert pressure[on_axis:] == pytest.approx(3.0)
    if method != PETROV_GALERKIN:
        assert not np.allclose(surface.tributary_pressure(force), 3.0, rtol=0.2)
        return
    assert surface.tributary_pressure(force) == pytest.approx(3.0)
    assert surface.tributary_pressure(np.column_stack([force, 2 * force]))[:, 1] == pytest.approx(6)


@pytest.mark.parametrize(("method", "expected"), [(GALERKIN, 2.0), (PETROV_GALERKIN, 1.0)])
def test_sawtooth_of_uniform_pressure_is_two_for_standard_and_one_for_new_element(method, expected):
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (6, 2))
    body = ElasticBody(mesh, method, "plane stress")
    surface = SurfaceNodes.from_body(body.body, on_plane(1, 0.0))
    force = uniform_pressure_forces(body, on_plane(1, 0.0))
    assert surface.sawtooth(force) == pytest.approx(expected)
    uneven_block = abs(2 * expected / (expected + 1) - 2 / (expected + 1))
    assert surface.unevenness(force) == pytest.approx(uneven_block, abs=1e-12)
    assert surface.unevenness(surface.pressure(force)) == pytest.approx(0, abs=1e-12)
    assert np.isnan(surface.sawtooth(force, np.zeros(len(force), dtype=bool)))


def test_sawtooth_and_unevenness_leave_out_open_and_rim_nodes():
    surface = SurfaceNodes.from_body(make_block_of_uneven_cells().body, on_plane(1, 0.0))
    force = np.array([9.0, 9, 1, 2, 1, 3, 1, 9, 9, 9, 9])
    assert surface.sawtooth(force, np.arange(11) < 7) == pytest.approx(2.5)
    assert surface.unevenness(np.arange(11.0)) == pytest.approx(0)


@pytest.mark.parametrize("cell", CELL_TYPES[:2])
@pytest.mark.parametrize("method", [GALERKIN, PETROV_GALERKIN])
def test_surface_nodes_and_pressures_on_faces_of_solids(cell, method):
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (3, 2, 1)], [4, 4, 1], cell)
    body = ElasticBody(mesh, method, "solid")
    surface = SurfaceNodes.from_body(body.body, on_plane(2, 0.0))
    assert len(surface.position) == 9 * 9
    assert surface.rim.sum() == 4 * 8
    assert len(surface.edges) == 4 * 5 * 2 + (16 if cell is CellType.tetrahedron else 0)
    assert surface.tributary_area.sum() == pytest.approx(6)
    force = uniform_pressure_forces(body, on_plane(2, 0.0))
    pressure = surface.pressure(force)
    weightless = np.isnan(pressure)
    assert pressure[~weightless] == pytest.approx(3.0)
    t10 = method == GALERKIN and cell is CellType.tetrahedron
    assert weightless.sum() == (5 * 5 if t10 else 0)  # corners of cells
    if method == PETROV_GALERKIN:
        assert surface.tributary_pressure(force) == pytest.approx(3.0)
    if t10:
        assert surface.sawtooth(force) > 1e6
        corner = np.flatnonzero(weightless)
        assert surface.tributary_pressure(force)[corner] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("cell", CELL_TYPES)
def test_transferred_loads_are_those_of_the_weight_functions(cell):
    dim = 3 if cell in CELL_TYPES[:2] else 2
    if dim == 3:
        mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 2, 1)], (2, 3, 2), cell)
    else:
        mesh = create_rectangle(MPI.COMM_SELF, [(0, 0), (1, 2)], (2, 3), cell)
    move_nodes(mesh, lambda x: x + 0.1 * x[:, [1, 0, 2]] * np.array([1.0, -0.5, 0.0]))
    state = "solid" if dim == 3 else "plane strain"
    bodies = [ElasticBody(mesh, method, state) for method in (GALERKIN, PETROV_GALERKIN)]
    everywhere = lambda x: np.full(x.shape[1], True)  # noqa: E731
    transferred, shared = (body.traction_load(np.arange(dim) + 1.0, everywhere) for body in bodies)
    T = force_transfer(bodies[0].space)
    assert (T * transferred).array == pytest.approx(shared.array, abs=1e-14)
    even = T.createVecLeft()
    even.set(1.0)
    transferred = T.createVecRight()
    T.multTranspose(even, transferred)
    assert transferred.array == pytest.approx(1.0, abs=1e-15)  # nothing is lost


def test_edges_rim_and_tributary_areas_of_a_line_are_exact():
    surface = SurfaceNodes.from_body(make_block_of_uneven_cells().body, on_plane(1, 0.0))
    assert surface.edges.tolist() == [[k, k - 1, k + 1] for k in (1, 3, 5, 7, 9)]
    assert np.flatnonzero(surface.rim).tolist() == [0, 10]
    halves = np.diff(surface.position[:, 0]) / 2
    assert surface.tributary_area == pytest.approx(np.convolve(halves, [1, 1]))


EXACT_GRADIENT = np.array([1.3, -0.7, 0.4])


def on_left_side(x):
    return np.isclose(x[0], 0.0)


def solve_poisson_for_reactions(cell, method, components=0, field=None, source=0.0):
    """Return the reactions of div grad u = -source with u prescribed on the whole boundary."""
    spaces = method(mesh := make_distorted_unit_mesh(cell, 3), components)
    U = spaces.trial
    u, v = ufl.TrialFunction(U), ufl.TestFunction(spaces.test)
    g = fem.Function(U)

    def linear(x):
        value = EXACT_GRADIENT[: mesh.geometry.dim] @ x[: mesh.geometry.dim]
        return np.array([(k + 1) * value for k in range(components)]) if components else value

    g.interpolate(field or linear)
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    q = fem.Constant(mesh, np.full(components, source) if components else np.float64(source))
    f = assemble_vector(ufl.inner(q, v) * ufl.dx)
    a = solve(K, f, Reduction.dirichlet(U, fem.dirichletbc(g, boundary_dofs(U))))
    return spaces, reactions(K, a, f), f


@pytest.mark.parametrize("cell", CELL_TYPES)
@pytest.mark.parametrize("components", [0, 2])
def test_a_uniform_flux_is_exact_at_every_node(cell, components):
    expected = (
        -EXACT_GRADIENT[0] * np.arange(1, components + 1) if components else -EXACT_GRADIENT[0]
    )
    new, r_new, _ = solve_poisson_for_reactions(cell, PETROV_GALERKIN, components)
    standard, r, _ = solve_poisson_for_reactions(cell, GALERKIN, components)
    ways = [(new, r_new, "geometric"), (new, r_new, "weight")]
    ways.append((standard, force_transfer(standard.trial) * r, "geometric"))
    if cell != CellType.tetrahedron:
        ways.append((standard, r, "weight"))
    for spaces, forces, area in ways:
        heat = nodal_flux(spaces, forces, on_left_side, area)
        inside = ~heat.surface.rim
        assert inside.any()
        assert np.abs(heat.flux[inside] - expected).max() < 1e-12, area


@pytest.mark.parametrize("method", [GALERKIN, PETROV_GALERKIN])
def test_the_total_flux_balances_the_source(method):
    def field(x):
        return np.sin(3 * x[0]) * x[1]

    spaces, r, f = solve_poisson_for_reactions(
        CellType.tetrahedron, method, field=field, source=-2.0
    )
    heat = nodal_flux(spaces, r, lambda x: x[0] > -1.0)
    assert heat.reaction.sum() == pytest.approx(-f.sum(), abs=1e-12)
    assert heat.surface.tributary_area.sum() == pytest.approx(6.0, rel=0.1)  # of moved vertices
    assert (heat.flux * heat.surface.tributary_area).sum() == pytest.approx(-f.sum(), abs=1e-12)


def test_fluxes_are_divided_by_the_depth():
    spaces, r, _ = solve_poisson_for_reactions(CellType.triangle, PETROV_GALERKIN)
    thin, thick = (nodal_flux(spaces, r, on_left_side, depth=depth) for depth in (1.0, 4.0))
    assert np.allclose(thin.flux, 4 * thick.flux, rtol=1e-14)

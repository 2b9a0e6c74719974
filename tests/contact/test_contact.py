"""Contact of blocks and of a ring with rigid surfaces: patch tests, comparisons, friction."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box

from pw_elements.contact import SLIP, STICK, ContactPair, Motion, Plane, SignedDistance, Sphere
from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, Q8, ElasticBody, on_plane

PRESSURE = 3.0
FLOOR = Plane((0, 0), (0, 1))


def distort_unit_square(x):
    """Return moved nodes of the unit square; nodes on a side stay on this side."""
    distorted = x.copy()
    bubble = np.sin(np.pi * x[:, 0])
    distorted[:, 0] += 0.07 * bubble + 0.05 * bubble * np.sin(5 * x[:, 1])
    distorted[:, 1] += 0.06 * np.sin(np.pi * x[:, 1]) * np.cos(4 * x[:, 0])
    return distorted


@pytest.mark.parametrize(
    ("build", "method", "state", "force_shares"),
    [
        (triangles, GALERKIN, "plane stress", (1 / 6, 2 / 3)),
        (triangles, PETROV_GALERKIN, "plane strain", (1 / 4, 1 / 2)),
        (quadrilaterals, Q8, "plane strain", (1 / 6, 2 / 3)),
        (quadrilaterals, GALERKIN, "plane stress", (1 / 6, 2 / 3)),
        (quadrilaterals, PETROV_GALERKIN, "plane stress", (1 / 4, 1 / 2)),
    ],
)
def test_contact_patch_has_the_exact_nodal_forces(build, method, state, force_shares):
    mesh = move_nodes(build(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 4)), distort_unit_square)
    body = ElasticBody(mesh, method, state, 10.0)
    load, (end, middle) = body.traction_load((0.0, -PRESSURE), on_plane(1, 1.0)), force_shares
    pair = ContactPair(on_plane(1, 0.0), FLOOR)
    (solution,) = body.solve_contact(pair, body.make_supports((0, on_plane(0, 0.0))), load)
    (contact,) = solution.pairs
    length = np.diff(contact.position[::2, 0])
    expected = np.zeros(len(contact.position))
    np.add.at(expected, np.arange(0, len(expected) - 2, 2), end * length)
    np.add.at(expected, np.arange(1, len(expected), 2), middle * length)
    np.add.at(expected, np.arange(2, len(expected), 2), end * length)
    assert contact.force_normal / expected == pytest.approx(PRESSURE, rel=1e-10)
    assert np.abs(contact.force_tangential).max() < 1e-10
    assert solution.iterations == 1
    assert solution.residuals.largest() < 1e-12


@pytest.mark.parametrize("method", [GALERKIN, PETROV_GALERKIN])
@pytest.mark.parametrize("state", ["solid", "axisymmetric"])
def test_contact_patch_is_exact_in_space_and_in_axisymmetry(state, method):
    """The contact forces under a uniform pressure are exact in space and in axisymmetry.

    They are compared with the load vector of the same pressure on the contact side. With the
    standard element, the vertices of ten-node tetrahedra carry no force. In axisymmetry, forces are
    those of the whole circumference.
    """
    if state == "solid":
        box = [(0, 0, 0), (1, 1, 1)]
        mesh, area = create_box(MPI.COMM_SELF, box, [2, 2, 2], CellType.tetrahedron), 1.0
    else:
        mesh, area = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (6, 3)), np.pi * 2**2
    body = ElasticBody(mesh, method, state, 10.0)
    normal, axis = np.eye(body.dim)[-1], body.dim - 1
    sides = body.make_supports(*((i, on_plane(i, 0.0)) for i in range(axis)))
    pair = ContactPair(on_plane(axis, 0.0), Plane(0 * normal, normal))
    (solution,) = body.solve_contact(
        pair, sides, body.traction_load(-PRESSURE * normal, on_plane(axis, 1.0))
    )
    (contact,) = solution.pairs
    expected = body.traction_load(PRESSURE * normal, on_plane(axis, 0.0)).array_r.reshape(
        -1, body.dim
    )
    assert contact.force_normal == pytest.approx(expected[contact.node, -1], abs=1e-10)
    assert contact.force == pytest.approx(PRESSURE * area * normal, abs=1e-10)
    assert solution.residuals.largest() < 1e-12
    assert solution.iterations == 1


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_tip_under_force_with_normals_by_differences_has_the_state_of_a_circle(unit):
    """A circular tip whose normals are computed by differences yields the state of a `Sphere`.

    The round-off of these normals changes with the position of the tip, which follows from a force.
    """
    block = quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (4 * unit, 2 * unit), (16, 8))
    body, states = ElasticBody(block), []
    tip = SignedDistance(lambda x: np.hypot(x[:, 0] - 2 * unit, x[:, 1] - 10 * unit) - 8 * unit)
    motion = Motion((0, None), (0, -10 * unit))
    for surface in (tip, Sphere((2 * unit, 10 * unit), 8 * unit)):
        pair = ContactPair(on_plane(1, 2 * unit), surface, 0.3, motion)
        states += body.solve_contact(pair, body.make_clamping_supports(on_plane(1, 0.0)))
        assert states[-1].iterations < 10
        assert not states[-1].substates
    (tip_pair,), (circle_pair,) = (state.pairs for state in states)
    assert {STICK, SLIP} < set(circle_pair.status)
    assert np.array_equal(tip_pair.status, circle_pair.status)
    assert tip_pair.force_vector == pytest.approx(circle_pair.force_vector, abs=1e-7 * unit)


@pytest.mark.parametrize(("method", "angle"), [(PETROV_GALERKIN, 0.7), (GALERKIN, 2.5)])
def test_a_sliding_block_in_space_has_uniform_shear_against_its_slip(method, angle):
    """A block slides on a plane in some direction; its shear stress is mu times the pressure.

    The shear opposes the slip. The stress is uniform, and nodal forces are exact.
    """
    mu, p, E = 0.3, 3.0, 10.0
    direction = np.array([np.cos(angle), np.sin(angle)])
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [2, 2, 2], CellType.tetrahedron)
    body = ElasticBody(
        mesh, method, "solid", E, 0.0
    )  # without Poisson's effect slip is uniform, like the shear
    shear, stress, f = mu * p * direction, np.zeros((3, 3)), body.zero_load
    stress[2, :2] = stress[:2, 2] = -shear
    stress[2, 2] = -p
    for axis, side in ((0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0)):
        f += body.traction_load(stress @ ((2 * side - 1) * np.eye(3)[axis]), on_plane(axis, side))
    supports = body.make_supports(
        *((i, on_plane(2, 1.0), u) for i, u in enumerate([*(-shear * 2 / E), -p / E]))
    )
    motions = [Motion((0.1 * direction[0], 0.1 * direction[1], 0.0))]
    (state,) = body.solve_contact(
        ContactPair(on_plane(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), mu, motions), supports, f
    )
    (contact,) = state.pairs
    assert contact.force == pytest.approx([*shear, p], abs=1e-9)
    friction = contact.force_tangential[:, :2]
    assert friction == pytest.approx(mu * contact.force_normal[:, None] * direction, abs=1e-9)
    is_loaded = contact.force_normal > 1e-9
    assert np.all(contact.status[is_loaded] == SLIP)
    slip = -0.1 * np.tile(direction, (is_loaded.sum(), 1))
    assert contact.slip[is_loaded, :2] == pytest.approx(slip, abs=1e-9)
    assert state.iterations <= 8
    assert state.residuals.largest() < 1e-9

"""Blocks and a ring on rigid surfaces: patch tests, tables, histories."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box

from pw_elements.contact import SLIP, STICK, ContactPair, Motion, Plane, SignedDistance, Sphere
from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from tests.contact.cases import GALERKIN, PW, Q8, Elastic, at

PRESSURE = 3.0
FLOOR = Plane((0, 0), (0, 1))


def skewed(x):
    """Moves all nodes of the unit square but in y those below and above, in x those aside."""
    moved = x.copy()
    bubble = np.sin(np.pi * x[:, 0])
    moved[:, 0] += 0.07 * bubble + 0.05 * bubble * np.sin(5 * x[:, 1])
    moved[:, 1] += 0.06 * np.sin(np.pi * x[:, 1]) * np.cos(4 * x[:, 0])
    return moved


@pytest.mark.parametrize(
    ("build", "method", "state", "shares"),
    [
        (triangles, GALERKIN, "plane stress", (1 / 6, 2 / 3)),
        (triangles, PW, "plane strain", (1 / 4, 1 / 2)),
        (quadrilaterals, Q8, "plane strain", (1 / 6, 2 / 3)),
        (quadrilaterals, GALERKIN, "plane stress", (1 / 6, 2 / 3)),
        (quadrilaterals, PW, "plane stress", (1 / 4, 1 / 2)),
    ],
)
def test_contact_patch(build, method, state, shares):
    mesh = move_nodes(build(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 4)), skewed)
    body = Elastic(mesh, method, state, 10.0)
    load, (end, middle) = body.load((0.0, -PRESSURE), at(1, 1.0)), shares
    pair = ContactPair(at(1, 0.0), FLOOR)
    (found,) = body.contact(pair, body.held((0, at(0, 0.0))), load)
    (contact,) = found.pairs
    length = np.diff(contact.position[::2, 0])
    expected = np.zeros(len(contact.position))
    np.add.at(expected, np.arange(0, len(expected) - 2, 2), end * length)
    np.add.at(expected, np.arange(1, len(expected), 2), middle * length)
    np.add.at(expected, np.arange(2, len(expected), 2), end * length)
    assert contact.force_normal / expected == pytest.approx(PRESSURE, rel=1e-10)
    assert np.abs(contact.force_tangential).max() < 1e-10
    assert found.iterations == 1
    assert found.residuals.largest() < 1e-12


@pytest.mark.parametrize("method", [GALERKIN, PW])
@pytest.mark.parametrize("state", ["solid", "axisymmetric"])
def test_contact_patch_in_space_and_round_an_axis(state, method):
    """Corners of a face carry nothing on T10; in axisymmetry forces are of whole circles."""
    if state == "solid":
        box = [(0, 0, 0), (1, 1, 1)]
        mesh, area = create_box(MPI.COMM_SELF, box, [2, 2, 2], CellType.tetrahedron), 1.0
    else:
        mesh, area = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (6, 3)), np.pi * 2**2
    body = Elastic(mesh, method, state, 10.0)
    up, axis = np.eye(body.dim)[-1], body.dim - 1
    sides = body.held(*((i, at(i, 0.0)) for i in range(axis)))
    pair = ContactPair(at(axis, 0.0), Plane(0 * up, up))
    (found,) = body.contact(pair, sides, body.load(-PRESSURE * up, at(axis, 1.0)))
    (contact,) = found.pairs
    even = body.load(PRESSURE * up, at(axis, 0.0)).array_r.reshape(-1, body.dim)
    assert contact.force_normal == pytest.approx(even[contact.node, -1], abs=1e-10)
    assert contact.force == pytest.approx(PRESSURE * area * up, abs=1e-10)
    assert found.residuals.largest() < 1e-12
    assert found.iterations == 1


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_tip_under_force_is_found_where_differences_are_its_normals(unit):
    """Their round-off changes with each place of the tip: it is found as the circle is."""
    block = quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (4 * unit, 2 * unit), (16, 8))
    body, states = Elastic(block), []
    tip = SignedDistance(lambda x: np.hypot(x[:, 0] - 2 * unit, x[:, 1] - 10 * unit) - 8 * unit)
    press = Motion((0, None), (0, -10 * unit))
    for surface in (tip, Sphere((2 * unit, 10 * unit), 8 * unit)):
        pair = ContactPair(at(1, 2 * unit), surface, 0.3, press)
        states += body.contact(pair, body.clamped(at(1, 0.0)))
        assert states[-1].iterations < 10
        assert not states[-1].substates
    (found,), (known,) = (state.pairs for state in states)
    assert {STICK, SLIP} < set(known.status)
    assert np.array_equal(found.status, known.status)
    assert found.force_vector == pytest.approx(known.force_vector, abs=1e-7 * unit)


@pytest.mark.parametrize(("method", "angle"), [(PW, 0.7), (GALERKIN, 2.5)])
def test_sliding_block_in_space(method, angle):
    """Shear of uniform size mu p against the slip, whatever its direction: exact."""
    mu, p, E = 0.3, 3.0, 10.0
    along = np.array([np.cos(angle), np.sin(angle)])
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [2, 2, 2], CellType.tetrahedron)
    body = Elastic(mesh, method, "solid", E, 0.0)  # without Poisson's effect slip is uniform, too
    shear, stress, f = mu * p * along, np.zeros((3, 3)), body.nothing
    stress[2, :2] = stress[:2, 2] = -shear
    stress[2, 2] = -p
    for axis, side in ((0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0)):
        f += body.load(stress @ ((2 * side - 1) * np.eye(3)[axis]), at(axis, side))
    held = body.held(*((i, at(2, 1.0), u) for i, u in enumerate([*(-shear * 2 / E), -p / E])))
    dragged = [Motion((0.1 * along[0], 0.1 * along[1], 0.0))]
    (state,) = body.contact(
        ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), mu, dragged), held, f
    )
    (contact,) = state.pairs
    assert contact.force == pytest.approx([*shear, p], abs=1e-9)
    friction = contact.force_tangential[:, :2]
    assert friction == pytest.approx(mu * contact.force_normal[:, None] * along, abs=1e-9)
    loaded = contact.force_normal > 1e-9
    assert np.all(contact.status[loaded] == SLIP)
    slip = -0.1 * np.tile(along, (loaded.sum(), 1))
    assert contact.slip[loaded, :2] == pytest.approx(slip, abs=1e-9)
    assert state.iterations <= 8
    assert state.residuals.largest() < 1e-9

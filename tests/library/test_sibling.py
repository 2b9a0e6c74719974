"""The symmetric sibling: a basis of the standard element's space, and contact in it."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from dolfinx.mesh import CellType, create_box, create_rectangle

from pw_elements import (
    Body,
    Material,
    Reduction,
    Sibling,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    force_transfer,
    lumped_mass,
    prescribe,
    solve,
)
from pw_elements.contact import (
    OPEN,
    ContactPair,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    solve_contact,
)
from pw_elements.contact.interface import nodal_interface
from pw_elements.elasticity import StressState
from study.matrices import dense
from tests.contact.cases import at

CELLS = ["triangle", "quadrilateral", "tetrahedron", "hexahedron"]


def body_on(cell, divisions=2, spaces=Spaces.galerkin):
    kind = CellType[cell]
    if cell in ("triangle", "quadrilateral"):
        ends, state = [(0.0, 0.0), (2.0, 1.0)], StressState.PLANE_STRAIN
        mesh = create_rectangle(MPI.COMM_SELF, ends, (2 * divisions, divisions), kind)
    else:
        ends, state = [(0.0, 0.0, 0.0), (2.0, 1.0, 1.0)], StressState.SOLID
        mesh = create_box(MPI.COMM_SELF, ends, (2 * divisions, divisions, divisions), kind)
    x = mesh.geometry.x
    x[:, 0] += 0.05 * np.sin(4 * x[:, 0]) * np.cos(3 * x[:, 1])
    return Body(spaces(mesh), Material(10.0, 0.3), state)


@pytest.mark.parametrize("cell", CELLS)
def test_basis_and_inverse_are_those_of_the_force_transfer(cell):
    space = body_on(cell, 1).spaces.trial
    sibling, T = Sibling.of(space), dense(force_transfer(space))
    assert dense(sibling.basis) == pytest.approx(T.T, abs=1e-15)
    assert dense(sibling.inverse) == pytest.approx(np.linalg.inv(T).T, abs=1e-13)


@pytest.mark.parametrize("cell", CELLS)
def test_displacements_and_spectrum_are_galerkins(cell):
    body = body_on(cell, 1)
    U, dim = body.spaces.trial, body.spaces.mesh.geometry.dim
    K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
    face = boundary_measure(body.spaces.mesh, at(0, 0.05 * np.sin(0.0)))
    f = assemble_vector(body.surface_load(np.arange(1.0, dim + 1), face))
    held = [prescribe(U, i, at(1, 1.0), 0.1 * i) for i in range(dim)]
    sibling = Sibling.of(U)
    own, mass = sibling.matrix(K), sibling.matrix(M)
    assert own.isSymmetric(1e-12)
    assert sibling.matrix(assemble_matrix(body.stiffness(), blocked=True)).equal(own)
    supports = sibling.dirichlet(held)
    assert not (dense(supports.right).T @ supports.offset.array).any()
    a = solve(own, sibling.load(f), supports)
    u = solve(K, f, Reduction.dirichlet(U, held))
    assert sibling.displacement(a).array == pytest.approx(u.array, abs=1e-11)
    assert sibling.coefficients(u).array == pytest.approx(a.array, abs=1e-11)
    expected = scipy.linalg.eigvalsh(dense(K), dense(M))
    assert scipy.linalg.eigvalsh(dense(own), dense(mass)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("cell", CELLS)
def test_lumped_mass_falls_evenly(cell):
    """Row sums are the integrals of the functions that share out a body force."""
    body = body_on(cell, 1)
    U, dim = body.spaces.trial, body.spaces.mesh.geometry.dim
    sibling = Sibling.of(U)
    mass = lumped_mass(sibling.matrix(assemble_matrix(body.mass())), U).getDiagonal()
    load = sibling.load(assemble_vector(body.body_load(np.ones(dim))))
    assert load.array == pytest.approx(mass.array, rel=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_closed_edges_lie_on_a_curved_surface(cell):
    """T^-T g puts the nodes of edges that are closed on it, nodal gaps would not."""
    body = body_on(cell, 3)
    U, dim = body.spaces.trial, body.spaces.mesh.geometry.dim
    sibling = Sibling.of(U)
    K = sibling.matrix(assemble_matrix(body.stiffness()))
    foot = sibling.dirichlet([prescribe(U, i, at(dim - 1, 0.0)) for i in range(dim)])
    shape = Parabola((1.0, *[0.5] * (dim - 2), 1.0), 4.0)
    down = (*[0.0] * (dim - 1), -0.08)
    pair = ContactPair(at(dim - 1, 1.0), shape, motions=[Motion(down)])
    (state,) = solve_contact(K, K.createVecLeft(), foot, pair, U)
    (found,) = state.pairs
    u = sibling.displacement(state.displacement).array.reshape(-1, dim)[found.node]
    gap = shape.gap(found.position - np.array(down)) - u[:, -1]
    closed = found.status != OPEN
    assert closed.sum() > 3
    # nodes all of whose neighbours in the basis are closed
    shares = dense(sibling.basis)[dim - 1 :: dim, dim - 1 :: dim][found.node]
    inner = closed & (
        shares[:, np.setdiff1d(np.arange(shares.shape[1]), found.node[closed])] == 0
    ).all(axis=1)
    assert inner.sum() > 2
    assert gap[inner] == pytest.approx(0.0, abs=1e-12)
    assert (gap[~inner] > 1e-6).any()


def test_closed_edges_lie_on_a_sphere():
    body = body_on("triangle", 2)
    U = body.spaces.trial
    sibling = Sibling.of(U)
    K = sibling.matrix(assemble_matrix(body.stiffness()))
    foot = sibling.dirichlet([prescribe(U, i, at(1, 0.0)) for i in range(2)])
    ball = ContactPair(at(1, 1.0), Sphere((1.0, 3.0), 2.0), motions=[Motion((0.02, -0.06))])
    (state,) = solve_contact(K, K.createVecLeft(), foot, ball, U)
    (found,) = state.pairs
    u = sibling.displacement(state.displacement).array.reshape(-1, 2)[found.node]
    shape, place = Sphere((1.02, 2.94), 2.0), found.position
    gap = shape.gap(place) + np.sum(shape.normal(place) * u, axis=1)
    between = np.flatnonzero(found.status != OPEN)[1:-1]
    assert len(between) > 0
    # but for tangential displacements times the turn of normals along an edge; nodal gaps on
    # the coefficients would leave h^2/(32 R) = 4e-3
    assert np.abs(gap[between]).max() < 2e-4
    assert state.residuals.largest() < 1e-9


def test_what_does_not_belong_together_is_refused():
    body, new = body_on("triangle", 1), body_on("triangle", 1, Spaces.petrov_galerkin)
    U = body.spaces.trial
    K, f = assemble_matrix(body.stiffness()), assemble_vector(body.body_load((0.0, 1.0)))
    sibling = Sibling.of(U)
    held = sibling.dirichlet([prescribe(U, i, at(1, 0.0)) for i in (0, 1)])
    with pytest.raises(ValueError, match="belongs to the symmetric sibling"):
        solve(sibling.matrix(K), f, held)
    with pytest.raises(ValueError, match="belongs to the symmetric sibling"):
        solve(K, sibling.load(f), held)
    with pytest.raises(ValueError, match="belongs to the sibling already"):
        sibling.matrix(sibling.matrix(K))
    with pytest.raises(ValueError, match="other weight functions"):
        Sibling.of(new.spaces.trial).matrix(assemble_matrix(new.stiffness()))
    with pytest.raises(ValueError, match="quadratic Lagrange spaces only"):
        Sibling.of(Spaces.serendipity(body_on("quadrilateral", 1).spaces.mesh).trial)
    middle = U.tabulate_dof_coordinates()[U.dofmap.list[0][3]]
    with pytest.raises(ValueError, match="prescribe whole edges"):
        sibling.dirichlet(prescribe(U, 0, lambda x: np.isclose(x.T, middle).all(axis=1)))
    free = sibling.dirichlet([])
    floor = ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)))
    with pytest.raises(ValueError, match="belongs to the symmetric sibling"):
        solve_contact(sibling.matrix(K), f, free, floor, U)


def test_gaps_are_those_of_coefficients_where_all_neighbours_face_the_surface():
    body = body_on("triangle", 3)
    U = body.spaces.trial
    sibling = Sibling.of(U)

    def rolling(x):
        return np.where(x[:, 0] < 1.3, 3 - np.cos(3 * x[:, 0]) - x[:, 1], np.inf)

    upwards = np.array([[0.0, -1.0]])
    surface = SignedDistance(rolling, lambda x: np.repeat(upwards, len(x), axis=0))
    pair = ContactPair(at(1, 1.0), surface)
    interface = nodal_interface([pair], U, sibling.dirichlet([]), sibling)
    x = U.tabulate_dof_coordinates()
    given = surface.gap(x[:, :2])
    inverse = dense(sibling.inverse)[::2, ::2]
    on_top = np.isclose(x[:, 1], 1.0)
    changed = 0
    for node, gap in zip(interface.node, interface.gaps(None), strict=True):
        needed = np.flatnonzero(inverse[node])
        assert on_top[needed].all()
        if np.isfinite(given[needed]).all():
            assert gap == pytest.approx(inverse[node, needed] @ given[needed], abs=1e-12)
            changed += gap != pytest.approx(given[node], abs=1e-6)
        else:
            assert gap == given[node]
    assert changed > 2
    assert np.isinf(interface.gaps(None)).any()

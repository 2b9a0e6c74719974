"""Tests of the sibling, the symmetric twin of the new element (see `Sibling`).

They cover its basis, spectrum, lumped mass and contact.
"""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from dolfinx.mesh import CellType, create_box, create_rectangle

from pw_elements import Sibling, assemble_matrix, force_transfer, lumped_mass, prescribe, solve
from pw_elements.contact import OPEN, ContactPair, Motion, Parabola, Plane, solve_contact
from study.model.matrices import to_dense_array
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, Q8, ElasticBody, on_plane

COMM, CELL_NAMES = MPI.COMM_SELF, ["triangle", "quadrilateral", "tetrahedron", "hexahedron"]


class BlockWithSymmetricSibling(ElasticBody):
    """Elastic block whose cells have different shapes, with the sibling of its element."""

    def __init__(self, cell, divisions=2, method=GALERKIN):
        n = (2 * divisions, divisions, divisions)
        if cell in CELL_NAMES[:2]:
            mesh = create_rectangle(COMM, [(0.0, 0.0), (2.0, 1.0)], n[:2], CellType[cell])
        else:
            mesh = create_box(COMM, [(0.0, 0.0, 0.0), (2.0, 1.0, 1.0)], n, CellType[cell])
        x = mesh.geometry.x
        x[:, 0] += 0.05 * np.sin(4 * x[:, 0]) * np.cos(3 * x[:, 1])
        super().__init__(mesh, method, "plane strain" if cell in CELL_NAMES[:2] else "solid", 10.0)
        self.sibling = Sibling.from_space(self.space)

    def make_sibling_supports(self, *conditions):
        """Create the sibling's supports from (component, marker) or (component, marker, value)."""
        return self.sibling.dirichlet([prescribe(self.space, *c) for c in conditions])

    def solve_contact_state_and_displacements(self, pair):
        """Solve contact with the sibling; return the state and the contact nodes' displacements.

        The block is clamped at its base. Displacements are (m, dim) for m contact nodes.
        """
        K, up = self.sibling.matrix(self.K), self.dim - 1
        foot = self.make_sibling_supports(*((i, on_plane(up, 0.0)) for i in range(self.dim)))
        (state,) = solve_contact(K, self.zero_load, foot, pair, self.space)
        u = self.sibling.displacement(state.displacement).array.reshape(-1, self.dim)
        return state, u[state.pairs[0].node]


@pytest.mark.parametrize("cell", CELL_NAMES)
def test_basis_and_inverse_are_those_of_the_force_transfer(cell):
    block = BlockWithSymmetricSibling(cell, 1)
    T = to_dense_array(force_transfer(block.space))
    assert to_dense_array(block.sibling.basis) == pytest.approx(T.T, abs=1e-15)
    assert to_dense_array(block.sibling.inverse) == pytest.approx(np.linalg.inv(T).T, abs=1e-13)


@pytest.mark.parametrize("cell", CELL_NAMES)
def test_sibling_displacements_and_spectrum_are_galerkins(cell):
    block = BlockWithSymmetricSibling(cell, 1)
    sibling, K, M = block.sibling, block.K, block.M
    f = block.traction_load(np.arange(1.0, block.dim + 1), on_plane(0, 0.0))
    prescribed = [(i, on_plane(1, 1.0), 0.1 * i) for i in range(block.dim)]
    sibling_K, mass, supports = (
        sibling.matrix(K),
        sibling.matrix(M),
        block.make_sibling_supports(*prescribed),
    )
    assert sibling_K.isSymmetric(1e-12)
    assert sibling.matrix(assemble_matrix(block.body.stiffness(), blocked=True)).equal(sibling_K)
    assert not (to_dense_array(supports.right).T @ supports.offset.array).any()
    a, u = (
        solve(sibling_K, sibling.load(f), supports),
        solve(K, f, block.make_sibling_supports(*prescribed)),
    )
    assert sibling.displacement(a).array == pytest.approx(u.array, abs=1e-11)
    assert sibling.coefficients(u).array == pytest.approx(a.array, abs=1e-11)
    expected = scipy.linalg.eigvalsh(to_dense_array(K), to_dense_array(M))
    assert scipy.linalg.eigvalsh(to_dense_array(sibling_K), to_dense_array(mass)) == pytest.approx(
        expected, abs=1e-9
    )


@pytest.mark.parametrize("cell", CELL_NAMES)
def test_lumped_mass_equals_the_load_of_a_unit_body_force(cell):
    """Lumped masses of the sibling equal its load vector of a unit body force.

    Both are integrals of the basis functions, which are the row sums of the mass matrix.
    """
    block = BlockWithSymmetricSibling(cell, 1)
    mass = lumped_mass(block.sibling.matrix(block.M), block.space).getDiagonal()
    load = block.sibling.load(block.body_force_load(np.ones(block.dim)))
    assert load.array == pytest.approx(mass.array, rel=1e-12)


@pytest.mark.parametrize("cell", CELL_NAMES)
def test_closed_edges_lie_on_a_curved_surface(cell):
    """All nodes of edges whose ends are closed lie on a curved surface.

    For this, the sibling uses the gaps T^-T g, with T the force transfer matrix and g the nodal
    gaps. The nodal gaps themselves would leave mid-side nodes off the surface.
    """
    block = BlockWithSymmetricSibling(cell, 3)
    dim = block.dim
    shape = Parabola((1.0, *[0.5] * (dim - 2), 1.0), 4.0)
    down = (*[0.0] * (dim - 1), -0.08)
    state, u = block.solve_contact_state_and_displacements(
        ContactPair(on_plane(dim - 1, 1.0), shape, motions=[Motion(down)])
    )
    (pair_state,) = state.pairs
    gap = shape.gap(pair_state.position - np.array(down)) - u[:, -1]
    closed = pair_state.status != OPEN
    assert closed.sum() > 3
    # closed nodes that the basis couples with closed nodes only
    shares = to_dense_array(block.sibling.basis)[dim - 1 :: dim, dim - 1 :: dim][pair_state.node]
    open_ = np.setdiff1d(np.arange(shares.shape[1]), pair_state.node[closed])
    inner = closed & (shares[:, open_] == 0).all(axis=1)
    assert inner.sum() > 2
    assert gap[inner] == pytest.approx(0.0, abs=1e-12)
    assert (gap[~inner] > 1e-6).any()


def test_mismatched_matrices_of_the_sibling_are_refused():
    block, new = (
        BlockWithSymmetricSibling("triangle", 1),
        BlockWithSymmetricSibling("triangle", 1, PETROV_GALERKIN),
    )
    sibling, K, U, f = block.sibling, block.K, block.space, block.body_force_load((0.0, 1.0))
    supports, sibling_K = (
        block.make_sibling_supports((0, on_plane(1, 0.0)), (1, on_plane(1, 0.0))),
        sibling.matrix(K),
    )
    floor = ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)))
    middle = U.tabulate_dof_coordinates()[U.dofmap.list[0][3]]
    for attempt, words in (
        (lambda: solve(sibling_K, f, supports), "belongs to the symmetric sibling"),
        (lambda: solve(K, sibling.load(f), supports), "belongs to the symmetric sibling"),
        (
            lambda: solve_contact(sibling_K, f, block.make_sibling_supports(), floor, U),
            "belongs to the symmetric sibling",
        ),
        (lambda: sibling.matrix(sibling_K), "belongs to the sibling already"),
        (lambda: new.sibling.matrix(new.K), "other weight functions"),
        (
            lambda: Sibling.from_space(Q8(BlockWithSymmetricSibling("quadrilateral").mesh).trial),
            "quadratic Lagrange spaces",
        ),
        (
            lambda: block.make_sibling_supports((0, lambda x: np.isclose(x.T, middle).all(axis=1))),
            "whole edges",
        ),
    ):
        with pytest.raises(ValueError, match=words):
            attempt()

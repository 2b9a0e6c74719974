"""Contact of two bodies whose nodes match."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import reactions
from pw_elements.contact import OPEN, SLIP, ContactPair, Parabola, Plane
from pw_elements.contact.model import MatchingNodes
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, PW, ElasticBody, on_plane
from tests.contact.two_bodies import join_meshes

HEIGHT, LENGTH = 1.0, 2.0


def nodes_of_block_at_height(space, height, of_upper):
    """Nodes at a height, of the body below or above it."""
    x, cells = space.tabulate_dof_coordinates(), space.dofmap.list
    axis = space.mesh.geometry.dim - 1
    above = x[cells][:, :, axis].mean(axis=1) > height
    there = np.flatnonzero(np.isclose(x[:, axis], height))
    return np.intersect1d(np.unique(cells[above == of_upper]), there).astype(np.int32)


class MatchingBlocks(ElasticBody):
    """Two equal blocks, one on top of the other; their nodes coincide along y = 1."""

    def __init__(self, method=PW, divisions=(6, 3), gap=0.0, comm=MPI.COMM_SELF):
        lower, upper = (
            triangles(MPI.COMM_SELF, (0.0, y), (LENGTH, y + HEIGHT), divisions)
            for y in (0.0, HEIGHT + gap)
        )
        super().__init__(join_meshes(lower, upper, comm), method, E=100.0)
        self.gap, self.top = gap, 2 * HEIGHT + gap
        self.base_supports = self.make_supports((1, on_plane(1, 0.0)), (0, on_plane(0, 0.0)))

    def traction_load(self, traction, where=None):
        return super().traction_load(traction, where or on_plane(1, self.top))

    def block_nodes(self, of_upper):
        return nodes_of_block_at_height(
            self.space, HEIGHT + self.gap if of_upper else HEIGHT, of_upper
        )

    def make_pair(self, friction=0.3, slave_is_upper=True, shape=None):
        up = 1.0 if slave_is_upper else -1.0
        level = HEIGHT if slave_is_upper else HEIGHT + self.gap
        shape = shape or Plane((0.0, level), (0.0, up))
        opposite = MatchingNodes(self.block_nodes(not slave_is_upper), shape, (0.0, -up * self.gap))
        return ContactPair(self.block_nodes(slave_is_upper), opposite, friction)


@pytest.mark.parametrize(("method", "own_is_upper"), [(GALERKIN, True), (PW, True), (PW, False)])
def test_uniform_pressure_passes_exactly(method, own_is_upper):
    blocks, down = MatchingBlocks(method), (0.0, -3.0)
    pair_ = blocks.make_pair(slave_is_upper=own_is_upper)
    (state,) = blocks.solve_contact(pair_, blocks.base_supports, blocks.traction_load(down))
    (pair,) = state.pairs
    end, middle = (1 / 6, 2 / 3) if method == GALERKIN else (1 / 4, 1 / 2)
    expected = np.full(13, 2 * end)
    expected[1::2] = middle
    expected[[0, -1]] = end
    assert pair.force_normal == pytest.approx(expected * 3.0 * LENGTH / 6, rel=1e-10)
    assert np.abs(pair.gap).max() < 1e-12
    assert state.residuals.largest() < 1e-10
    # equal and opposite on both bodies: nothing is left of K a - f but the foot
    r = reactions(blocks.K, state.displacement, blocks.traction_load(down)).array_r.reshape(-1, 2)
    own, other = blocks.block_nodes(own_is_upper), blocks.block_nodes(not own_is_upper)
    assert r[own].sum(axis=0) == pytest.approx(-r[other].sum(axis=0), abs=1e-10)
    assert r[own].sum(axis=0) == pytest.approx(pair.force, abs=1e-10)


@pytest.mark.parametrize("gap", [0.0, 0.1])
def test_either_side_may_be_the_pair_s_own(gap):
    blocks, results = MatchingBlocks(gap=gap), []
    for own_is_upper in (True, False):
        sign = -1.0 if own_is_upper else 1.0  # Parabola's rigid side is above for a positive radius
        level = HEIGHT if own_is_upper else HEIGHT + gap
        pair = blocks.make_pair(0.2, own_is_upper, Parabola((LENGTH / 2, level), sign * 10.0))
        loads = [blocks.traction_load((pull, -2.0)) for pull in (0.0, 0.3)]
        state = blocks.solve_contact(pair, blocks.clamp(on_plane(1, 0.0)), loads)[-1]
        results.append((state.displacement.array_r, state.pairs[0]))
    (moved, own), (moved_too, other) = results
    assert {OPEN, SLIP} <= set(own.status.tolist())
    assert moved == pytest.approx(moved_too, abs=1e-9)
    assert own.force_normal == pytest.approx(other.force_normal, abs=1e-8)
    assert own.force_tangential == pytest.approx(-other.force_tangential, abs=1e-8)
    assert own.gap == pytest.approx(other.gap, abs=1e-9)


APART = MatchingBlocks(gap=0.1)
LOWER, UPPER = APART.block_nodes(False), APART.block_nodes(True)


def facing(nodes=UPPER, opposite=LOWER, point=(0, 1), up=(0, 1), offset=(0.0, -0.1)):
    return ContactPair(nodes, MatchingNodes(opposite, Plane(point, up), offset), 0.3)


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        (facing(offset=None), "face no node of the opposite side"),
        (facing(offset=(0.0, 0.0, 0.1)), "offset .* is not 2-D"),
        (facing(opposite=LOWER[:3]), "face no node of the opposite"),
        (facing(opposite=lambda x: x[1] > 9), "no opposite nodes"),
        (facing(point=(0, 1, 0), up=(0, 1, 0)), "the point of its surface has 3 components"),
        ([facing(), ContactPair(LOWER, Plane((0, 0), (0, 1)))], "belong to two contact pairs"),
        (facing(on_plane(1, 1.1 + 1 / 6), offset=(0.0, -0.1 - 1 / 6)), "inside of the body"),
    ],
)
def test_what_matching_refuses(pair, message):
    with pytest.raises(ValueError, match=message):
        APART.contact_problem(pair, APART.base_supports)


def test_supports_of_one_side_only_are_refused():
    one_sided = (0, lambda x: np.isclose(x[1], 1.1) & np.isclose(x[0], 1.0))
    supports = APART.make_supports((1, on_plane(1, 0.0)), (0, on_plane(0, 0.0)), one_sided)
    said = r"at \(1, 1.1\) have a prescribed displacement that their counterparts have not"
    with pytest.raises(ValueError, match=said):
        APART.contact_problem(facing(), supports)

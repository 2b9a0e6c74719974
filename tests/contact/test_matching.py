"""Contact between two bodies whose nodes match in pairs."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import reactions
from pw_elements.contact import OPEN, SLIP, ContactPair, Parabola, Plane
from pw_elements.contact.model import MatchingNodes
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, ElasticBody, on_plane
from tests.contact.two_bodies import join_meshes

BLOCK_HEIGHT, BLOCK_LENGTH = 1.0, 2.0


def nodes_of_block_at_height(space, height, of_upper):
    """Return the nodes at a height that belong to the block above it (`of_upper`) or below it."""
    x, cells = space.tabulate_dof_coordinates(), space.dofmap.list
    axis = space.mesh.geometry.dim - 1
    is_above = x[cells][:, :, axis].mean(axis=1) > height
    nodes = np.flatnonzero(np.isclose(x[:, axis], height))
    return np.intersect1d(np.unique(cells[is_above == of_upper]), nodes).astype(np.int32)


class MatchingBlocks(ElasticBody):
    """Two equal blocks, one above the other, whose nodes match along the interface y = 1."""

    def __init__(self, method=PETROV_GALERKIN, divisions=(6, 3), gap=0.0, comm=MPI.COMM_SELF):
        lower, upper = (
            triangles(MPI.COMM_SELF, (0.0, y), (BLOCK_LENGTH, y + BLOCK_HEIGHT), divisions)
            for y in (0.0, BLOCK_HEIGHT + gap)
        )
        super().__init__(join_meshes(lower, upper, comm), method, E=100.0)
        self.gap, self.top = gap, 2 * BLOCK_HEIGHT + gap
        self.base_supports = self.make_supports((1, on_plane(1, 0.0)), (0, on_plane(0, 0.0)))

    def traction_load(self, traction, where=None):
        return super().traction_load(traction, where or on_plane(1, self.top))

    def nodes_facing_other_block(self, of_upper):
        return nodes_of_block_at_height(
            self.space, BLOCK_HEIGHT + self.gap if of_upper else BLOCK_HEIGHT, of_upper
        )

    def make_pair(self, friction=0.3, slave_is_upper=True, shape=None):
        direction = 1.0 if slave_is_upper else -1.0
        level = BLOCK_HEIGHT if slave_is_upper else BLOCK_HEIGHT + self.gap
        shape = shape or Plane((0.0, level), (0.0, direction))
        surface = MatchingNodes(
            self.nodes_facing_other_block(not slave_is_upper), shape, (0.0, -direction * self.gap)
        )
        return ContactPair(self.nodes_facing_other_block(slave_is_upper), surface, friction)


@pytest.mark.parametrize(
    ("method", "slave_is_upper"),
    [(GALERKIN, True), (PETROV_GALERKIN, True), (PETROV_GALERKIN, False)],
)
def test_uniform_pressure_is_transferred_exactly(method, slave_is_upper):
    blocks, traction = MatchingBlocks(method), (0.0, -3.0)
    contact_pair = blocks.make_pair(slave_is_upper=slave_is_upper)
    (state,) = blocks.solve_contact(
        contact_pair, blocks.base_supports, blocks.traction_load(traction)
    )
    (pair,) = state.pairs
    end, middle = (1 / 6, 2 / 3) if method == GALERKIN else (1 / 4, 1 / 2)
    expected = np.full(13, 2 * end)
    expected[1::2] = middle
    expected[[0, -1]] = end
    assert pair.force_normal == pytest.approx(expected * 3.0 * BLOCK_LENGTH / 6, rel=1e-10)
    assert np.abs(pair.gap).max() < 1e-12
    assert state.residuals.largest() < 1e-10
    # forces on both bodies are equal and opposite; K a - f vanishes elsewhere, except at the base
    r = reactions(blocks.K, state.displacement, blocks.traction_load(traction)).array_r.reshape(
        -1, 2
    )
    slave_nodes, master_nodes = (
        blocks.nodes_facing_other_block(slave_is_upper),
        blocks.nodes_facing_other_block(not slave_is_upper),
    )
    assert r[slave_nodes].sum(axis=0) == pytest.approx(-r[master_nodes].sum(axis=0), abs=1e-10)
    assert r[slave_nodes].sum(axis=0) == pytest.approx(pair.force, abs=1e-10)


@pytest.mark.parametrize("gap", [0.0, 0.1])
def test_either_side_may_be_the_slave(gap):
    blocks, results = MatchingBlocks(gap=gap), []
    for slave_is_upper in (True, False):
        # the rigid side of a parabola is above it if its radius is positive
        sign = -1.0 if slave_is_upper else 1.0
        level = BLOCK_HEIGHT if slave_is_upper else BLOCK_HEIGHT + gap
        pair = blocks.make_pair(
            0.2, slave_is_upper, Parabola((BLOCK_LENGTH / 2, level), sign * 10.0)
        )
        loads = [blocks.traction_load((pull, -2.0)) for pull in (0.0, 0.3)]
        state = blocks.solve_contact(pair, blocks.make_clamping_supports(on_plane(1, 0.0)), loads)[
            -1
        ]
        results.append((state.displacement.array_r, state.pairs[0]))
    (displacement, upper_pair), (other_displacement, lower_pair) = results
    assert {OPEN, SLIP} <= set(upper_pair.status.tolist())
    assert displacement == pytest.approx(other_displacement, abs=1e-9)
    assert upper_pair.force_normal == pytest.approx(lower_pair.force_normal, abs=1e-8)
    assert upper_pair.force_tangential == pytest.approx(-lower_pair.force_tangential, abs=1e-8)
    assert upper_pair.gap == pytest.approx(lower_pair.gap, abs=1e-9)


SEPARATED_BLOCKS = MatchingBlocks(gap=0.1)
LOWER_INTERFACE_NODES, UPPER_INTERFACE_NODES = (
    SEPARATED_BLOCKS.nodes_facing_other_block(False),
    SEPARATED_BLOCKS.nodes_facing_other_block(True),
)


def make_matching_pair(
    nodes=UPPER_INTERFACE_NODES,
    opposite_nodes=LOWER_INTERFACE_NODES,
    plane_point=(0, 1),
    plane_normal=(0, 1),
    offset=(0.0, -0.1),
):
    return ContactPair(
        nodes, MatchingNodes(opposite_nodes, Plane(plane_point, plane_normal), offset), 0.3
    )


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        (make_matching_pair(offset=None), "face no node of the opposite side"),
        (make_matching_pair(offset=(0.0, 0.0, 0.1)), "offset .* is not 2-D"),
        (
            make_matching_pair(opposite_nodes=LOWER_INTERFACE_NODES[:3]),
            "face no node of the opposite",
        ),
        (make_matching_pair(opposite_nodes=lambda x: x[1] > 9), "no opposite nodes"),
        (
            make_matching_pair(plane_point=(0, 1, 0), plane_normal=(0, 1, 0)),
            "the point of its surface has 3 components",
        ),
        (
            [make_matching_pair(), ContactPair(LOWER_INTERFACE_NODES, Plane((0, 0), (0, 1)))],
            "belong to two contact pairs",
        ),
        (
            make_matching_pair(on_plane(1, 1.1 + 1 / 6), offset=(0.0, -0.1 - 1 / 6)),
            "inside of the body",
        ),
    ],
)
def test_invalid_matching_pairs_are_refused(pair, message):
    with pytest.raises(ValueError, match=message):
        SEPARATED_BLOCKS.contact_problem(pair, SEPARATED_BLOCKS.base_supports)


def test_supports_of_one_side_only_are_refused():
    one_sided = (0, lambda x: np.isclose(x[1], 1.1) & np.isclose(x[0], 1.0))
    supports = SEPARATED_BLOCKS.make_supports(
        (1, on_plane(1, 0.0)), (0, on_plane(0, 0.0)), one_sided
    )
    message = r"at \(1, 1.1\) have a prescribed displacement that their counterparts have not"
    with pytest.raises(ValueError, match=message):
        SEPARATED_BLOCKS.contact_problem(make_matching_pair(), supports)

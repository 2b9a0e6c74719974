"""Contact of two bodies whose nodes match."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_mesh

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    reactions,
    solve,
)
from pw_elements._compat import cell_nodes
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactPair,
    ContactProblem,
    Motion,
    Parabola,
    Plane,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from tests.contact.cases import at

HEIGHT, LENGTH = 1.0, 2.0


def doubled(mesh, shift, comm=MPI.COMM_SELF):
    """A mesh of one process and its copy, moved by a vector, as one mesh of two bodies."""
    x, cells = mesh.geometry.x, cell_nodes(mesh)
    if comm.rank > 0:
        x, cells = x[:0], cells[:0]
    both = np.vstack([x, x + shift])[:, : mesh.geometry.dim]
    element = mesh.ufl_domain().ufl_coordinate_element()
    return create_mesh(
        comm,
        cells=np.vstack([cells, cells + len(x)]).astype(np.int64),
        x=np.ascontiguousarray(both),
        e=element,
    )


def lower_nodes(space, coordinate, upper):
    """Nodes at a height, of the body below or above it."""
    x = space.tabulate_dof_coordinates()
    axis = space.mesh.geometry.dim - 1
    cells = space.dofmap.list
    above = x[cells][:, :, axis].mean(axis=1) > coordinate
    return np.intersect1d(
        np.unique(cells[above == upper]), np.flatnonzero(np.isclose(x[:, axis], coordinate))
    ).astype(np.int32)


class Blocks:
    """Two equal blocks, one on top of the other; their nodes coincide along y = 1."""

    def __init__(
        self, method=Spaces.petrov_galerkin, divisions=(6, 3), gap=0.0, comm=MPI.COMM_SELF
    ):
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, HEIGHT), divisions)
        mesh = doubled(mesh, (0.0, HEIGHT + gap, 0.0), comm)
        self.gap = gap
        self.body = Body(method(mesh), Material(100.0, 0.3), StressState.PLANE_STRAIN)
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        self.foot = [prescribe(self.space, 1, at(1, 0.0)), prescribe(self.space, 0, at(0, 0.0))]

    def load(self, traction):
        top = boundary_measure(self.body.spaces.mesh, at(1, 2 * HEIGHT + self.gap))
        return assemble_vector(self.body.surface_load(traction, top))

    def nodes(self, upper):
        where = HEIGHT + self.gap if upper else HEIGHT
        if self.gap:
            return fem.locate_dofs_geometrical(self.space, at(1, where))
        return lower_nodes(self.space, where, upper)

    def pair(self, friction=0.3, own_is_upper=True, shape=None):
        """The upper block's nodes on the lower's, or the other way round."""
        up = 1.0 if own_is_upper else -1.0
        level = HEIGHT if own_is_upper else HEIGHT + self.gap
        shape = shape or Plane((0.0, level), (0.0, up))
        opposite = MatchingNodes(self.nodes(not own_is_upper), shape, (0.0, -up * self.gap))
        return ContactPair(self.nodes(own_is_upper), opposite, friction)

    def problem(self, pair):
        return ContactProblem(self.K, Reduction.dirichlet(self.space, self.foot), pair, self.space)


def two_blocks():
    blocks = Blocks()
    return blocks.problem(blocks.pair()), blocks.load((0.0, -3.0))


@pytest.mark.parametrize("own_is_upper", [True, False])
@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
def test_uniform_pressure_passes_exactly(method, own_is_upper):
    blocks = Blocks(method)
    state = blocks.problem(blocks.pair(own_is_upper=own_is_upper)).step(
        blocks.problem(blocks.pair()).undeformed
        if own_is_upper
        else blocks.problem(blocks.pair(own_is_upper=False)).undeformed,
        blocks.load((0.0, -3.0)),
    )
    (pair,) = state.pairs
    end, middle = (1 / 6, 2 / 3) if method == Spaces.galerkin else (1 / 4, 1 / 2)
    expected = np.full(13, 2 * end)
    expected[1::2] = middle
    expected[[0, -1]] = end
    assert pair.force_normal == pytest.approx(expected * 3.0 * LENGTH / 6, rel=1e-10)
    assert np.abs(pair.gap).max() < 1e-12
    assert state.residuals.largest() < 1e-10
    # equal and opposite on both bodies: nothing is left of K a - f but the foot
    r = reactions(blocks.K, state.displacement, blocks.load((0.0, -3.0))).array_r.reshape(-1, 2)
    own, other = blocks.nodes(own_is_upper), blocks.nodes(not own_is_upper)
    assert r[own].sum(axis=0) == pytest.approx(-r[other].sum(axis=0), abs=1e-10)
    assert r[own].sum(axis=0) == pytest.approx(pair.force, abs=1e-10)


@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
def test_bodies_that_stick_are_one_body(method):
    """With friction enough, two blocks move as the block that they would be if glued."""
    blocks = Blocks(method)
    load = blocks.load((1.0, -10.0))
    problem = blocks.problem(blocks.pair(friction=5.0))
    state = problem.step(problem.undeformed, load)
    closed = state.pairs[0].status == STICK
    assert closed.all()
    whole = triangles(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, 2 * HEIGHT), (6, 6))
    body = Body(method(whole), Material(100.0, 0.3), StressState.PLANE_STRAIN)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    top = boundary_measure(whole, at(1, 2 * HEIGHT))
    f = assemble_vector(body.surface_load((1.0, -10.0), top))
    a = solve(
        K, f, Reduction.dirichlet(U, [prescribe(U, 1, at(1, 0.0)), prescribe(U, 0, at(0, 0.0))])
    )
    x, y = U.tabulate_dof_coordinates(), blocks.space.tabulate_dof_coordinates()
    nearest = [np.argmin(np.linalg.norm(x - place, axis=1)) for place in y]
    glued = a.array_r.reshape(-1, 2)[nearest]
    assert state.displacement.array_r.reshape(-1, 2) == pytest.approx(glued, abs=1e-11)


@pytest.mark.parametrize("gap", [0.0, 0.1])
def test_either_side_may_be_the_pair_s_own(gap):
    """Slipping and opening too: forces turn round, everything else is the same."""
    blocks = Blocks(gap=gap)
    curved = 10.0
    results = []
    for own_is_upper in (True, False):
        sign = -1.0 if own_is_upper else 1.0  # Parabola's rigid side is above for a positive radius
        level = HEIGHT if own_is_upper else HEIGHT + gap
        shape = Parabola((LENGTH / 2, level), sign * curved)
        held = [prescribe(blocks.space, i, at(1, 0.0)) for i in (0, 1)]
        supports = Reduction.dirichlet(blocks.space, held)
        pair = blocks.pair(0.2, own_is_upper, shape)
        problem = ContactProblem(blocks.K, supports, pair, blocks.space)
        state = problem.undeformed
        for pull in (0.0, 0.3):
            state = problem.step(state, blocks.load((pull, -2.0)))
        results.append(state)
    own, other = results
    assert {OPEN, SLIP} <= set(own.pairs[0].status.tolist())
    assert own.displacement.array_r == pytest.approx(other.displacement.array_r, abs=1e-9)
    assert own.pairs[0].force_normal == pytest.approx(other.pairs[0].force_normal, abs=1e-8)
    assert own.pairs[0].force_tangential == pytest.approx(
        -other.pairs[0].force_tangential, abs=1e-8
    )
    assert own.pairs[0].gap == pytest.approx(other.pairs[0].gap, abs=1e-9)


def test_relative_motion_and_its_force():
    """An approach that is given, and the same one by its force, between two held blocks."""
    blocks = Blocks(gap=0.25)
    ends = [prescribe(blocks.space, i, at(1, y)) for i in (0, 1) for y in (0.0, 2 * HEIGHT + 0.25)]
    pair = blocks.pair(0.3, shape=Parabola((LENGTH / 2, HEIGHT + 0.25), -50.0))
    problem = ContactProblem(blocks.K, Reduction.dirichlet(blocks.space, ends), pair, blocks.space)
    nothing = blocks.K.createVecLeft()
    given = problem.step(problem.undeformed, nothing, [Motion((0.0, 0.01))])
    force = given.pairs[0].force
    assert force[1] > 0
    by_force = problem.step(problem.undeformed, nothing, [Motion((0.0, None), (0.0, force[1]))])
    assert by_force.pairs[0].translation == pytest.approx((0.0, 0.01), rel=1e-9)
    assert by_force.pairs[0].force_normal == pytest.approx(given.pairs[0].force_normal, rel=1e-8)


def test_two_blocks_in_space():
    box = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [2, 2, 2], CellType.tetrahedron)
    mesh = doubled(box, (0.0, 0.0, 1.0))
    body = Body(Spaces.petrov_galerkin(mesh), Material(10.0, 0.3), StressState.SOLID)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.surface_load((0.0, 0.0, -1.0), boundary_measure(mesh, at(2, 2.0))))
    sides = [prescribe(U, i, at(i, 0.0)) for i in (0, 1)] + [prescribe(U, 2, at(2, 0.0))]
    lower, upper = (lower_nodes(U, 1.0, above) for above in (False, True))
    pair = ContactPair(upper, MatchingNodes(lower, Plane((0, 0, 1), (0, 0, 1))), 0.3)
    problem = ContactProblem(K, Reduction.dirichlet(U, sides), pair, U)
    state = problem.step(problem.undeformed, f)
    assert state.pairs[0].force == pytest.approx((0, 0, 1), abs=1e-10)
    assert np.all(state.pairs[0].force_normal > 1e-3)
    assert state.residuals.largest() < 1e-10


def test_what_matching_refuses():
    blocks = Blocks(gap=0.1)
    lower, upper = blocks.nodes(False), blocks.nodes(True)
    shape = Plane((0, 1), (0, 1))
    below = (0.0, -0.1)

    def refused(pair, message, conditions=()):
        supports = Reduction.dirichlet(blocks.space, [*blocks.foot, *conditions])
        with pytest.raises(ValueError, match=message):
            ContactProblem(blocks.K, supports, pair, blocks.space)

    refused(ContactPair(upper, MatchingNodes(lower, shape)), "face no node of the opposite side")
    refused(
        ContactPair(upper, MatchingNodes(lower, shape, (0.0, 0.0, 0.1))), "offset .* is not 2-D"
    )
    refused(
        ContactPair(upper, MatchingNodes(lower[:3], shape, below)), "face no node of the opposite"
    )
    refused(
        ContactPair(upper, MatchingNodes(lambda x: x[1] > 9, shape, below)), "no opposite nodes"
    )
    refused(
        ContactPair(upper, MatchingNodes(lower, Plane((0, 1, 0), (0, 1, 0)), below)),
        "the point of its surface has 3 components",
    )
    refused(
        [
            ContactPair(upper, MatchingNodes(lower, shape, below)),
            ContactPair(lower, Plane((0, 0), (0, 1))),
        ],
        "belong to two contact pairs",
    )
    one_sided = prescribe(blocks.space, 0, lambda x: np.isclose(x[1], 1.1) & np.isclose(x[0], 1.0))
    refused(
        ContactPair(upper, MatchingNodes(lower, shape, below), 0.3),
        r"at \(1, 1.1\) have a prescribed displacement that their counterparts have not",
        [one_sided],
    )
    inside = lambda x: np.isclose(x[1], 1.1 + 1 / 6)  # noqa: E731
    refused(
        ContactPair(inside, MatchingNodes(lower, shape, (0.0, -0.1 - 1 / 6))), "inside of the body"
    )

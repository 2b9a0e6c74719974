"""Refusals against statics done by hand and another linear program."""

import re
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box
from scipy.optimize import linprog

from pw_elements import (
    Direct,
    Iterative,
    Reduction,
    assemble_matrix,
    assemble_vector,
    prescribe,
    solve,
)
from pw_elements.contact import (
    ContactFailed,
    ContactPair,
    FlatPunch,
    FreeBody,
    Motion,
    NoEquilibrium,
    NotFound,
    Plane,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.contact.rescue import refusals
from pw_elements.contact.rescue.refusals import (
    NodeVelocities,
    find_escape_motion,
    find_proof,
    proves_imbalance,
)
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import triangles
from pw_elements.solvers import matrices
from tests.contact.cases import ElasticBody, GrecoPlate, on_plane
from tests.contact.test_large import RubberUnderCircle
from tests.contact.test_matching import nodes_of_block_at_height
from tests.contact.two_bodies import join_meshes
from tests.oracle.proofs import is_valid_proof, measure_proof_defects

SELF = MPI.COMM_SELF
FLOOR, CEILING = Plane((0, 0), (0, 1)), Plane((0, 1), (0, -1))
GROUND = Plane((0, 0, 0), (0, 0, 1))


class StatedProblem(ElasticBody):
    """A body and its supports; pairs and loads of one increment follow."""

    def __init__(self, mesh, state="plane strain", conditions=()):
        super().__init__(mesh, state=state)
        self.conditions = [prescribe(self.space, axis, where) for axis, where in conditions]

    def solve(self, pairs, load):
        """Of pairs and loads per volume, or a load vector."""
        pairs = [pairs] if isinstance(pairs, ContactPair) else pairs
        if isinstance(load, tuple):
            load = assemble_vector(self.body.body_load(load))
        self.pairs, self.loads = pairs, [load]
        supports = Reduction.dirichlet(self.space, self.conditions)
        return self.solve_contact(pairs, supports, load)[0]

    def nodal_load_at(self, place, force):
        return nodal_load(
            self.space, lambda x: np.all(np.isclose(x.T[:, : self.dim], place), axis=1), force
        )


def make_block(comm=SELF, conditions=(), state="plane strain", left=0.0):
    return StatedProblem(triangles(comm, (left, 0.0), (left + 2.0, 1.0), (4, 2)), state, conditions)


def ring(comm=SELF):
    return make_block(comm, state="axisymmetric", left=1.0)


def clamped(comm=SELF):
    return make_block(comm, [(0, on_plane(1, 0.0)), (1, on_plane(1, 0.0))])


def solid(comm=SELF, conditions=()):
    mesh = create_box(comm, [(0, 0, 0), (2, 2, 1)], [2, 2, 1], CellType.tetrahedron)
    return StatedProblem(mesh, "solid", conditions)


def floor_pair(mu=0.3, surface=FLOOR):
    return ContactPair(on_plane(1, 0.0), surface, mu)


def two_apart(comm=SELF, x=5.0, y=0.0):
    first, second = (
        triangles(SELF, low, (low[0] + 2.0, low[1] + 1.0), (4, 2)) for low in ((0.0, 0.0), (x, y))
    )
    return StatedProblem(join_meshes(first, second, comm))


def stacked(body, below, between):
    """Pairs of a block on a block on the floor."""
    lower, upper = (nodes_of_block_at_height(body.space, 1.0, above) for above in (False, True))
    return [
        floor_pair(below),
        ContactPair(upper, MatchingNodes(lower, Plane((0, 1), (0, 1))), between),
    ]


def refusal(stated, pairs, load, match=None, kind=NoEquilibrium):
    with pytest.raises(kind, match=match) as caught:
        stated.solve(pairs, load)
    assert type(caught.value) is kind
    if kind is NoEquilibrium:
        found = measure_proof_defects(stated, 0, caught.value)
        assert is_valid_proof(found), found
    return caught.value


# -- by hand ---------------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [0.1, 1.5])
def test_block_on_an_incline_slides_where_it_is_steeper_than_friction(mu):
    """Weight (s, -c) at the middle of its base; what is missing follows from s - mu c."""
    body = make_block()
    for share, slides in ((0.99, False), (1.01, True), (1.001, True)):
        s, c = share * mu / np.hypot(1, mu * share), 1 / np.hypot(1, mu * share)
        load = body.nodal_load_at((1, 0), (s, -c))
        if not slides:
            assert body.solve(floor_pair(mu), load).residuals.largest() < 1e-10
            continue
        error = refusal(body, floor_pair(mu), load, "the body slides along x on pair 0")
        short = s - mu * c
        least = (-short, 0) if mu < 1 else (0, -short / mu)
        assert error.missing.force == pytest.approx(np.array([least]), abs=2e-6 * c)
        assert error.missing.moment == pytest.approx(0.0, abs=1e-6 * c)
        direction = error.velocity.translation[0] / error.velocity.translation[0, 0]
        assert direction == pytest.approx([1, mu], rel=1e-6)
        assert error.velocity.rotation == pytest.approx(0.0, abs=1e-9)
        assert error.velocity.centre == pytest.approx(np.array([[1, 0.5]]))


def test_body_in_space_is_dragged_along_a_diagonal():
    """The cone is round: no polygon's corner is taken for it, in any direction."""
    body, ground = solid(), ContactPair(on_plane(2, 0.0), GROUND, 0.3)
    for angle in np.radians([0.0, 30.0, 100.0]):
        pull = 0.3 * np.array([np.cos(angle), np.sin(angle)])
        load = body.nodal_load_at((1, 1, 0), (*(1.0001 * pull), -1.0))
        error = refusal(body, ground, load, "the body slides along .* on pair 0")
        slid = error.velocity.translation[0]
        assert slid[:2] / np.linalg.norm(slid[:2]) == pytest.approx(pull / 0.3, abs=0.02)
        body.solve(ground, body.nodal_load_at((1, 1, 0), (*(0.98 * pull), -1.0)))


BOTH = "translation .* of the body around .* with .* of the body around .* slides along x on pair 0"
UPPER = r"the body around \(1, 1\.5\), by .* slides along x on pair 1\. .* of \(-0\.1, 0\)"


@pytest.mark.parametrize(("below", "between", "said"), [(0.5, 0.3, UPPER), (0.3, 0.5, BOTH)])
def test_upper_or_both_of_two_stacked_blocks_are_dragged_off(below, between, said):
    body = two_apart(x=0.0, y=1.0)
    load = body.traction_load((0.2, -0.5), on_plane(1, 2.0))
    error = refusal(body, stacked(body, below, between), load, said)
    first, second = error.velocity.translation
    assert first == pytest.approx(second if said == BOTH else 0.0, abs=1e-9)


def test_only_the_block_that_nothing_holds_is_named():
    body = two_apart()
    load = assemble_vector(body.body.body_load((0.0, -1.0))) + body.nodal_load_at((6, 1), (0, 5.0))
    error = refusal(body, floor_pair(), load, r"\(6, 0\.5\), by .* lifts off pair 0\. At")
    assert error.missing.force == pytest.approx(np.array([[0, 0], [0, -3]]), rel=1e-5)


def test_axisymmetric_body_is_lifted_along_its_axis_only():
    error = refusal(ring(), floor_pair(), (1.0, 1.0), "the body lifts off pair 0")
    volume = np.pi * (3**2 - 1)
    assert error.missing.force == pytest.approx(np.array([[0, -volume]]), rel=1e-6)
    assert error.velocity.translation == pytest.approx(np.array([[0, 1]]))
    ring().solve(floor_pair(), (1.0, -1.0))


def pushed_by(surface, force, mu=0.3):
    return ContactPair(on_plane(1, 1.0), surface, mu, [Motion((None, None), force)])


def test_plate_that_is_pulled_off_or_along():
    body = clamped()
    plate = pushed_by(CEILING, (0, 1.0))
    error = refusal(
        body, plate, body.zero_load, "y of the surface of pair 0, by .* lifts off pair 0"
    )
    assert error.missing.surface == pytest.approx(np.array([[0, -1]]), rel=1e-6)
    words = r"slides along -x on pair 0\. At .* \(-0\.1, 0\) of the surface of pair 0"
    error = refusal(body, pushed_by(CEILING, (0.4, -1.0)), body.zero_load, words)
    assert error.missing.force == pytest.approx(0.0)


# -- motions that are free --------------------------------------------------------------------


class Inclined:
    """A level surface whose normal is inclined."""

    def gap(self, x):
        return x[:, 1]

    def normal(self, x):
        return np.tile([-0.6, 0.8], (len(x), 1))


def corner(x):
    return np.all(np.isclose(x.T, 0.0), axis=1)


ICE, ICE_IN_SPACE = floor_pair(0.0), ContactPair(on_plane(2, 0.0), GROUND)
PLATE = ContactPair(on_plane(1, 1.0), CEILING, 0.3, [Motion((None, 0))])
AWAY = ContactPair(on_plane(2, 1.0), FlatPunch((9, 9, 1), (0, 0, -1), 0.1), 0.3)
EDGE = [(axis, lambda x: np.isclose(x[0], 0) & np.isclose(x[2], 0)) for axis in (0, 2)]
ONE, OTHER = (rf"translation x of the body around \({x}, 0\.5\)" for x in (1, 6))
AXES = zip("zyx", (r"0, 0, 0\.5", "0, 1, 0", "1, 0, 0"), strict=True)
ABOUT = " and ".join(rf"rotation about the axis along {a} through \({at}\) of .*" for a, at in AXES)
SPIN = r"rotation about the axis along z through \(1, 1, 0\.5\) of .* and translation x of .* and"
HINGE = r"rotation about the axis along y through \(0, 1, 0\) of the body and translation y"
RING = ContactPair(on_plane(0, 3.0), Plane((3, 0), (-1, 0)))
DOWN, SINK = (0.0, -1.0), (0.0, 0.0, -1.0)
FREE = {
    "ice": (make_block, ICE, DOWN, "^increment 0: translation x"),
    "inclined": (make_block, floor_pair(0.0, Inclined()), DOWN, r"translation \(0\.8, 0\.6\)"),
    "apart": (two_apart, ICE, DOWN, f"{ONE} and {OTHER}"),
    # a rough plate lies on a block on ice: it is free with the block, not by itself
    "together": (
        make_block,
        [ICE, PLATE],
        DOWN,
        "0: translation x of the body with translation x of",
    ),
    "space": (solid, ICE_IN_SPACE, SINK, SPIN),
    "pinned": (lambda c: solid(c, [(axis, corner) for axis in range(3)]), AWAY, SINK, ABOUT),
    "hinged": (lambda c: solid(c, EDGE), AWAY, SINK, HINGE),
    "axis": (ring, RING, (0.0, 1.0), "0: translation y"),
}


@pytest.mark.parametrize("name", FREE)
def test_free_motions_are_named_so_that_supports_can_follow(name):
    make, pairs, load, words = FREE[name]
    refusal(make(SELF), pairs, load, f"{words}.*: held", FreeBody)


def refusal_messages(comm):
    """Refusals without equilibrium, then of free bodies."""
    above, space = two_apart(comm, 0.0, 1.0), ContactPair(on_plane(2, 0.0), GROUND, 0.3)
    plate = pushed_by(CEILING, (0, 1.0))
    cases = [
        *(
            (make_block(comm), floor_pair(mu), f)
            for mu, f in ((0.3, (0.4, -1.0)), (3.0, (2.5, -1.0)))
        ),
        (make_block(comm), floor_pair(), (0.0, 1.0)),
        (clamped(comm), plate, (0.0, 0.0)),
        (two_apart(comm), floor_pair(), (0.4, -1.0)),
        (above, stacked(above, 0.6, 0.3), (0.4, -1.0)),
        (solid(comm), space, (0.3, 0.3, -1.0)),
        (ring(comm), floor_pair(0.0), (0.3, 1.0)),
    ]
    cases += [(make(comm), pairs, load) for make, pairs, load, _ in FREE.values()]
    found = []
    for stated, pairs, load in cases:
        with pytest.raises(ContactFailed) as error:
            stated.solve(pairs, load)
        found.append(f"{error.type.__name__}: {error.value}")
    return found


# -- no proof ---------------------------------------------------------------------------------


def test_state_that_came_nearest_is_kept_but_nothing_goes_on_from_it(tmp_path):
    greco = GrecoPlate(16)
    with pytest.raises(NotFound, match="came nearest violates the law by") as caught:
        greco.solve(1.0, max_iterations=3, remedies=())
    state = caught.value.state
    assert not state.converged
    assert state.iterations == 3
    assert 1e-6 < state.residuals.largest() < 10
    problem = greco.contact_problem(greco.floor_pair(1.0), greco.symmetry_supports)
    with pytest.raises(ValueError, match="no solution: go on from the one before"):
        problem.step(state, greco.edge_load)
    with pytest.raises(ValueError, match="the state is not a solution"):
        problem.save(state, tmp_path / "state.npz")


def carried_at_most(error):
    return float(re.search(r"of at most (\S+) along", str(error)).group(1))


def test_ring_that_is_pushed_off_its_shaft_is_told_what_friction_carries():
    """Smaller increments cannot help; the capacity is mu times the force of the fit."""
    ring = StatedProblem(triangles(SELF, (1.0, 0.0), (2.0, 1.0), (4, 4)), "axisymmetric")
    pair = ContactPair(on_plane(0, 1.0), Plane((1.01, 0), (1, 0)), 0.3, interference=True)
    problem, area = ring.contact_problem(pair), np.pi * (2**2 - 1)
    fitted = problem.step(problem.undeformed, ring.traction_load((0, 1e-9), on_plane(1, 1.0)))
    capacity = 0.3 * fitted.pairs[0].force_normal.sum()
    pushed = problem.step(fitted, ring.traction_load((0, 0.95 * capacity / area), on_plane(1, 1.0)))
    assert pushed.pairs[0].force[1] == pytest.approx(-0.95 * capacity)
    with pytest.raises(NotFound, match=r"pair 0 is exhausted: .*increments do not") as caught:
        problem.step(fitted, ring.traction_load((0, 1.5 * capacity / area), on_plane(1, 1.0)))
    assert "may find one" not in str(caught.value)
    assert carried_at_most(caught.value) == pytest.approx(capacity, rel=0.03)


def test_tool_that_is_pushed_along_by_more_than_friction_is_told_what_that_carries():
    rubber = RubberUnderCircle(friction=0.3)
    pressed = rubber.problem.step(rubber.problem.undeformed, motions=Motion((0.0, -0.15)))
    normal = pressed.pairs[0].force_normal.sum()
    with pytest.raises(NotFound, match=r"pair 0 is exhausted: .*increments do not") as caught:
        rubber.problem.step(pressed, motions=Motion((None, -0.15), (-0.6 * normal, 0.0)))
    assert carried_at_most(caught.value) == pytest.approx(0.3 * normal, rel=0.15)


def test_refusals_of_other_causes_do_not_blame_friction():
    greco = GrecoPlate(16)
    with pytest.raises(NotFound, match=r"may find one$"):
        greco.solve(1.0, max_iterations=3, remedies=())


# -- another program, other forces ---------------------------------------------------------------


def rigid_points(rng, count, dim):
    """Points of a rigid body at rest, with normals and friction that differ."""
    x = rng.uniform(-1, 1, (count, dim))
    n = rng.normal(size=(count, dim))
    if rng.random() < 0.7:  # a floor rather than a cage
        n[:, -1] = 2 + np.abs(n[:, -1])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    modes = np.zeros((count, dim, 3 * dim - 3))
    modes[:, :, :dim] = np.eye(dim)
    if dim == 2:
        modes[:, 0, 2], modes[:, 1, 2] = -x[:, 1], x[:, 0]
    else:
        for k in range(3):
            modes[:, :, 3 + k] = np.cross(np.eye(3)[k], x)
    mu = rng.choice([0.0, 0.2, 0.7, 3.0], count)
    normal = np.einsum("na,nak->nk", n, modes)
    tangential = modes - n[:, :, None] * normal[:, None]
    no = np.zeros(count, dtype=bool)
    return NodeVelocities(np.zeros(count, dtype=int), mu, no, normal, tangential), n, mu, modes


def balanced(n, mu, modes, power, directions):
    """Whether forces along these generators of cones balance loads: a program of forces."""
    spread = []
    for normal, friction in zip(n, mu, strict=True):
        t = np.linalg.svd(normal[None])[2][1:]
        for d in directions @ t:
            spread.append(normal + friction * d)
    each = len(directions)
    work = np.array([modes[k // each].T @ force for k, force in enumerate(spread)])
    found = linprog(np.zeros(len(work)), A_eq=work.T, b_eq=-power, bounds=(0, None))
    assert found.status in (0, 2)
    return found.status == 0


@pytest.mark.parametrize("seed", range(60))
def test_proof_is_found_where_no_forces_balance_the_loads_and_nowhere_else(seed):
    """Coulomb's cones in the plane are two edges; in space between two polygons."""
    rng = np.random.default_rng((7, seed))
    dim = 2 + seed % 2
    points, n, mu, modes = rigid_points(rng, int(rng.integers(1, 8)), dim)
    power = rng.normal(size=modes.shape[2])
    if rng.random() < 0.6:  # loads that near admissible forces balance
        forces = n + 0.5 * mu[:, None] * rng.normal(size=n.shape)
        power = -np.einsum("nak,na->k", modes, forces) + 0.3 * rng.normal() * power
    found = find_proof(points, power, np.abs(power))
    proved = found is not None
    if dim == 2:
        assert proved is not balanced(n, mu, modes, power, np.array([[1.0], [-1.0]]))
    else:
        angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        if balanced(n, mu, modes, power, circle):
            assert not proved
        if not balanced(n, mu, modes, power, circle / np.cos(np.pi / 64)):
            assert proved
    if found is not None:  # the least that is missing suffices
        velocity, missing = found
        more = 1e-5 * np.abs(power).max()
        assert -missing @ velocity == pytest.approx(power @ velocity, abs=more)
        again = power + missing
        assert find_escape_motion(points, again)[0] @ again < more


def test_no_motion_proves_anything_where_forces_balance_the_loads():
    """Motions of any kind, and those next to an escape."""
    overstepped = proved = 0
    for seed in range(200):
        rng = np.random.default_rng((8, seed))
        points, n, mu, modes = rigid_points(rng, int(rng.integers(1, 8)), 2)
        power = rng.normal(size=modes.shape[2])
        if rng.random() < 0.6:
            forces = n + 0.5 * mu[:, None] * rng.normal(size=n.shape)
            power = -np.einsum("nak,na->k", modes, forces) + 0.3 * rng.normal() * power
        balance = balanced(n, mu, modes, power, np.array([[1.0], [-1.0]]))
        velocity, _ = find_escape_motion(points, power)
        for motion in (rng.normal(size=len(power)), velocity + rng.normal(size=len(power)), power):
            oversteps = points.cone_margin(motion).min() < -1e-3
            overstepped += balance and oversteps and power @ motion > 1e-3
            if proves_imbalance(points, power, np.abs(power), motion):
                proved += 1
                assert not balance, (seed, motion)
    assert overstepped > 50  # motions in which loads do work, and only contact forces tell
    assert proved > 10


def test_an_escape_that_oversteps_a_cone_proves_nothing(monkeypatch):
    """A block on a floor that a linear program would slide: friction takes the work away."""
    eye = np.eye(2)
    no = np.zeros(1, dtype=bool)
    normal, tangential = np.array([[0.0, 1.0]]), np.array([[eye[0], [0.0, 0.0]]])
    points = NodeVelocities(np.zeros(1, dtype=int), np.array([0.5]), no, normal, tangential)
    power = np.array([0.3, -1.0])  # pushed by less than friction, pressed by one
    along = np.array([1.0, 0.0])
    monkeypatch.setattr(refusals, "find_escape_motion", lambda *_: (along, np.zeros(2)))
    assert find_proof(points, power, np.abs(power)) is None
    assert find_proof(replace(points, friction_slope=np.zeros(1)), power, np.abs(power)) is not None


@pytest.mark.parametrize("blocked", [False, True])
def test_motions_of_many_pieces_are_found_as_those_of_few(monkeypatch, blocked):
    """Sparse algebra, and parts of a stiffness in blocks, give the words of the dense one."""
    both, words = two_apart(), []
    both.K = assemble_matrix(both.body.stiffness(), blocked=blocked)
    for few in (60, 0):
        monkeypatch.setattr(matrices, "_FEW_MODES", few)
        unbraked = refusal(both, floor_pair(0.3), (0.5, -1.0))
        words.append((str(unbraked), unbraked.missing.moment.round(9).tolist()))
        with pytest.raises(FreeBody) as loose:
            both.solve(ContactPair(on_plane(1, 1.0), CEILING, 0.0), (0.0, 0.0))
        words[-1] += (str(loose.value),)
        assert both.solve(floor_pair(0.3), (0.1, -1.0)).converged
    assert words[0] == words[1]


def test_stiffness_between_pieces_holds_them():
    """A block held by springs to one that is clamped, beside others that only touch the floor."""
    both = two_apart()
    both.conditions = [
        prescribe(both.space, i, lambda x: np.isclose(x[1], 0.0) & (x[0] < 2.5)) for i in (0, 1)
    ]
    load, pair = (0.0, 0.0), ContactPair(on_plane(1, 1.0), CEILING, 0.0)
    with pytest.raises(FreeBody):
        both.solve(pair, load)
    free = both.x[:, 0] > 2.5
    one, other = (np.flatnonzero(part)[[0, -1]] for part in (~free, free))
    rows = (2 * np.stack([one, other], axis=1)[:, :, None] + [0, 1]).astype(np.int32)
    K = both.K.copy()
    K.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    for pair_of_nodes in rows:
        for dofs in pair_of_nodes.T:
            K.setValues(dofs, dofs, [100.0, -100.0, -100.0, 100.0], addv=True)
    K.assemble()
    both.K = K
    assert both.solve(pair, load).displacement.norm() == pytest.approx(0.0, abs=1e-12)
    reduction = Reduction.dirichlet(both.space, both.conditions)
    pushed = nodal_load(both.space, lambda x: np.isclose(x[0], 7.0), (1.0, 1.0))
    first, second = (solve(K, pushed, reduction, how) for how in (Direct(), Iterative()))
    assert (first - second).norm() < 1e-8 * first.norm()

"""Refusals of contact problems, compared with statics by hand and a separate linear program."""

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
    Plane,
    SolutionNotFound,
)
from pw_elements.contact.model import MatchingNodes, describe_exhausted_friction
from pw_elements.contact.rescue import refusals
from pw_elements.contact.rescue.refusals import (
    NodeVelocitiesInRigidMotions,
    does_motion_prove_no_equilibrium,
    find_motion_proving_no_equilibrium,
    find_unresisted_motion_of_most_work,
)
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import triangles
from pw_elements.solvers import matrices
from tests.contact.cases import ElasticBody, GrecoFrictionBenchmark, on_plane
from tests.contact.test_large import RubberUnderCircle
from tests.contact.test_matching import nodes_of_block_at_height
from tests.contact.two_bodies import join_meshes
from tests.oracle.proofs import is_valid_proof, measure_proof_defects

SELF_COMM = MPI.COMM_SELF
FLOOR, CEILING = Plane((0, 0), (0, 1)), Plane((0, 1), (0, -1))
FLOOR_IN_SPACE = Plane((0, 0, 0), (0, 0, 1))


class BodyWithSupports(ElasticBody):
    """A body with its supports; the pairs and the load of one increment are passed to `solve`."""

    def __init__(self, mesh, state="plane strain", conditions=()):
        super().__init__(mesh, state=state)
        self.conditions = [prescribe(self.space, axis, where) for axis, where in conditions]

    def solve(self, pairs, load):
        """Return the state for given pairs and a load, which is a vector or a force per volume."""
        pairs = [pairs] if isinstance(pairs, ContactPair) else pairs
        if isinstance(load, tuple):
            load = assemble_vector(self.body.body_load(load))
        self.pairs, self.loads = pairs, [load]
        supports = Reduction.dirichlet(self.space, self.conditions)
        return self.solve_contact(pairs, supports, load)[0]

    def nodal_force_load_at(self, position, force):
        """Assemble the load vector of a nodal force at a position."""
        return nodal_load(
            self.space, lambda x: np.all(np.isclose(x.T[:, : self.dim], position), axis=1), force
        )


def make_block(comm=SELF_COMM, conditions=(), state="plane strain", left_x=0.0):
    return BodyWithSupports(
        triangles(comm, (left_x, 0.0), (left_x + 2.0, 1.0), (4, 2)), state, conditions
    )


def make_ring(comm=SELF_COMM):
    return make_block(comm, state="axisymmetric", left_x=1.0)


def make_clamped_block(comm=SELF_COMM):
    return make_block(comm, [(0, on_plane(1, 0.0)), (1, on_plane(1, 0.0))])


def make_solid_block(comm=SELF_COMM, conditions=()):
    mesh = create_box(comm, [(0, 0, 0), (2, 2, 1)], [2, 2, 1], CellType.tetrahedron)
    return BodyWithSupports(mesh, "solid", conditions)


def floor_pair(mu=0.3, surface=FLOOR):
    return ContactPair(on_plane(1, 0.0), surface, mu)


def make_two_blocks(comm=SELF_COMM, second_corner_x=5.0, second_corner_y=0.0):
    """Return two separate blocks in one mesh, without supports.

    The lower left corner of the first block is the origin; that of the second block is given.
    """
    first_mesh, second_mesh = (
        triangles(SELF_COMM, corner, (corner[0] + 2.0, corner[1] + 1.0), (4, 2))
        for corner in ((0.0, 0.0), (second_corner_x, second_corner_y))
    )
    return BodyWithSupports(join_meshes(first_mesh, second_mesh, comm))


def make_stacked_pairs(body, floor_friction, block_friction):
    """Return the contact pairs of two stacked blocks: lower block and floor, and both blocks."""
    lower_nodes, upper_nodes = (
        nodes_of_block_at_height(body.space, 1.0, of_upper) for of_upper in (False, True)
    )
    return [
        floor_pair(floor_friction),
        ContactPair(upper_nodes, MatchingNodes(lower_nodes, Plane((0, 1), (0, 1))), block_friction),
    ]


def catch_refusal_and_check_proof(
    problem, pairs, load, message_pattern=None, error_type=NoEquilibrium
):
    """Solve a problem that has to be refused, check the proof in the error, and return it."""
    with pytest.raises(error_type, match=message_pattern) as caught:
        problem.solve(pairs, load)
    assert type(caught.value) is error_type
    if error_type is NoEquilibrium:
        defects = measure_proof_defects(problem, 0, caught.value)
        assert is_valid_proof(defects), defects
    return caught.value


# -- by hand ---------------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [0.1, 1.5])
def test_a_block_on_an_incline_slides_where_it_is_steeper_than_friction(mu):
    """A block slides on an incline whose slope exceeds the friction coefficient mu.

    The weight (s, -c) acts at the middle of the base, where s and c are the sine and cosine of the
    inclination. The missing force is s - mu c along the incline if mu < 1, and otherwise the normal
    force (s - mu c) / mu.
    """
    body = make_block()
    for slope_ratio, is_refused in ((0.99, False), (1.01, True), (1.001, True)):
        s, c = slope_ratio * mu / np.hypot(1, mu * slope_ratio), 1 / np.hypot(1, mu * slope_ratio)
        load = body.nodal_force_load_at((1, 0), (s, -c))
        if not is_refused:
            assert body.solve(floor_pair(mu), load).residuals.largest() < 1e-10
            continue
        error = catch_refusal_and_check_proof(
            body, floor_pair(mu), load, "the body slides along x on pair 0"
        )
        imbalance = s - mu * c
        missing_force = (-imbalance, 0) if mu < 1 else (0, -imbalance / mu)
        assert error.missing.force == pytest.approx(np.array([missing_force]), abs=2e-6 * c)
        assert error.missing.moment == pytest.approx(0.0, abs=1e-6 * c)
        direction = error.velocity.translation[0] / error.velocity.translation[0, 0]
        assert direction == pytest.approx([1, mu], rel=1e-6)
        assert error.velocity.rotation == pytest.approx(0.0, abs=1e-9)
        assert error.velocity.centre == pytest.approx(np.array([[1, 0.5]]))


def test_a_body_in_space_slides_in_any_direction():
    """A body on a plane in space slides in any direction in which a force exceeds the friction.

    The limit is the same in all directions: the friction cone is not replaced by a pyramid.
    """
    body, ground_pair = make_solid_block(), ContactPair(on_plane(2, 0.0), FLOOR_IN_SPACE, 0.3)
    for angle in np.radians([0.0, 30.0, 100.0]):
        pull = 0.3 * np.array([np.cos(angle), np.sin(angle)])
        load = body.nodal_force_load_at((1, 1, 0), (*(1.0001 * pull), -1.0))
        error = catch_refusal_and_check_proof(
            body, ground_pair, load, "the body slides along .* on pair 0"
        )
        velocity = error.velocity.translation[0]
        assert velocity[:2] / np.linalg.norm(velocity[:2]) == pytest.approx(pull / 0.3, abs=0.02)
        body.solve(ground_pair, body.nodal_force_load_at((1, 1, 0), (*(0.98 * pull), -1.0)))


BOTH_SLIDE_PATTERN = (
    "translation .* of the body around .* with .* of the body around .* slides along x on pair 0"
)
UPPER_SLIDES_PATTERN = (
    r"the body around \(1, 1\.5\), by .* slides along x on pair 1\. .* of \(-0\.1, 0\)"
)


@pytest.mark.parametrize(
    ("floor_friction", "block_friction", "message"),
    [(0.5, 0.3, UPPER_SLIDES_PATTERN), (0.3, 0.5, BOTH_SLIDE_PATTERN)],
)
def test_the_upper_or_both_of_two_stacked_blocks_slide(floor_friction, block_friction, message):
    body = make_two_blocks(second_corner_x=0.0, second_corner_y=1.0)
    load = body.traction_load((0.2, -0.5), on_plane(1, 2.0))
    error = catch_refusal_and_check_proof(
        body, make_stacked_pairs(body, floor_friction, block_friction), load, message
    )
    lower_velocity, upper_velocity = error.velocity.translation
    assert lower_velocity == pytest.approx(
        upper_velocity if message == BOTH_SLIDE_PATTERN else 0.0, abs=1e-9
    )


def test_only_the_loose_one_of_two_blocks_is_named():
    body = make_two_blocks()
    load = assemble_vector(body.body.body_load((0.0, -1.0))) + body.nodal_force_load_at(
        (6, 1), (0, 5.0)
    )
    error = catch_refusal_and_check_proof(
        body, floor_pair(), load, r"\(6, 0\.5\), by .* lifts off pair 0\. At"
    )
    assert error.missing.force == pytest.approx(np.array([[0, 0], [0, -3]]), rel=1e-5)


def test_an_axisymmetric_body_is_lifted_along_its_axis_only():
    error = catch_refusal_and_check_proof(
        make_ring(), floor_pair(), (1.0, 1.0), "the body lifts off pair 0"
    )
    volume = np.pi * (3**2 - 1)
    assert error.missing.force == pytest.approx(np.array([[0, -volume]]), rel=1e-6)
    assert error.velocity.translation == pytest.approx(np.array([[0, 1]]))
    make_ring().solve(floor_pair(), (1.0, -1.0))


def pushed_surface_pair(surface, force, mu=0.3):
    """Return the contact pair of the top with a free surface that a force pushes."""
    return ContactPair(on_plane(1, 1.0), surface, mu, [Motion((None, None), force)])


def test_a_plate_that_is_pulled_off_or_along_is_refused():
    body = make_clamped_block()
    plate = pushed_surface_pair(CEILING, (0, 1.0))
    error = catch_refusal_and_check_proof(
        body, plate, body.zero_load, "y of the surface of pair 0, by .* lifts off pair 0"
    )
    assert error.missing.surface == pytest.approx(np.array([[0, -1]]), rel=1e-6)
    message = r"slides along -x on pair 0\. At .* \(-0\.1, 0\) of the surface of pair 0"
    error = catch_refusal_and_check_proof(
        body, pushed_surface_pair(CEILING, (0.4, -1.0)), body.zero_load, message
    )
    assert error.missing.force == pytest.approx(0.0)


# -- motions that are free --------------------------------------------------------------------


class HorizontalGapInclinedNormal:
    """A surface with the gap of a horizontal plane and the normal of an inclined one."""

    def gap(self, x):
        return x[:, 1]

    def normal(self, x):
        return np.tile([-0.6, 0.8], (len(x), 1))


def is_at_origin(x):
    return np.all(np.isclose(x.T, 0.0), axis=1)


FRICTIONLESS_FLOOR, FRICTIONLESS_FLOOR_IN_SPACE = (
    floor_pair(0.0),
    ContactPair(on_plane(2, 0.0), FLOOR_IN_SPACE),
)
FREE_PLATE_PAIR = ContactPair(on_plane(1, 1.0), CEILING, 0.3, [Motion((None, 0))])
DISTANT_PUNCH_PAIR = ContactPair(on_plane(2, 1.0), FlatPunch((9, 9, 1), (0, 0, -1), 0.1), 0.3)
EDGE_SUPPORT_CONDITIONS = [
    (axis, lambda x: np.isclose(x[0], 0) & np.isclose(x[2], 0)) for axis in (0, 2)
]
FIRST_BODY_TRANSLATION_PATTERN, SECOND_BODY_TRANSLATION_PATTERN = (
    rf"translation x of the body around \({x}, 0\.5\)" for x in (1, 6)
)
ROTATION_AXES_AND_POINT_PATTERNS = zip("zyx", (r"0, 0, 0\.5", "0, 1, 0", "1, 0, 0"), strict=True)
THREE_ROTATIONS_PATTERN = " and ".join(
    rf"rotation about the axis along {a} through \({point}\) of .*"
    for a, point in ROTATION_AXES_AND_POINT_PATTERNS
)
SPIN_AND_TRANSLATION_PATTERN = (
    r"rotation about the axis along z through \(1, 1, 0\.5\) of .* and translation x of .* and"
)
HINGE_MOTION_PATTERN = (
    r"rotation about the axis along y through \(0, 1, 0\) of the body and translation y"
)
RING_WALL_PAIR = ContactPair(on_plane(0, 3.0), Plane((3, 0), (-1, 0)))
FRICTION_OF_FIRST_PAIR_REMEDY = "give contact pair 0 friction, which acts only under pressure"
FACING_NODES_REMEDY = "give contact pair 0 nodes that face its surface, as none of them does"
GRAVITY, GRAVITY_IN_SPACE = (0.0, -1.0), (0.0, 0.0, -1.0)
FREE_MOTION_CASES = {
    "ice": (
        make_block,
        FRICTIONLESS_FLOOR,
        GRAVITY,
        "^increment 0: translation x",
        [FRICTION_OF_FIRST_PAIR_REMEDY],
    ),
    "inclined": (
        make_block,
        floor_pair(0.0, HorizontalGapInclinedNormal()),
        GRAVITY,
        r"translation \(0\.8, 0\.6\)",
        [FRICTION_OF_FIRST_PAIR_REMEDY],
    ),
    "apart": (
        make_two_blocks,
        FRICTIONLESS_FLOOR,
        GRAVITY,
        f"{FIRST_BODY_TRANSLATION_PATTERN} and {SECOND_BODY_TRANSLATION_PATTERN}",
        [FRICTION_OF_FIRST_PAIR_REMEDY],
    ),
    # a rough plate on a block on a frictionless floor is free together with the block
    "together": (
        make_block,
        [FRICTIONLESS_FLOOR, FREE_PLATE_PAIR],
        GRAVITY,
        "0: translation x of the body with translation x of",
        ["prescribe the translation of a surface that is free", FRICTION_OF_FIRST_PAIR_REMEDY],
    ),
    "space": (
        make_solid_block,
        FRICTIONLESS_FLOOR_IN_SPACE,
        GRAVITY_IN_SPACE,
        SPIN_AND_TRANSLATION_PATTERN,
        [FRICTION_OF_FIRST_PAIR_REMEDY],
    ),
    "pinned": (
        lambda c: make_solid_block(c, [(axis, is_at_origin) for axis in range(3)]),
        DISTANT_PUNCH_PAIR,
        GRAVITY_IN_SPACE,
        THREE_ROTATIONS_PATTERN,
        [FACING_NODES_REMEDY],
    ),
    "hinged": (
        lambda c: make_solid_block(c, EDGE_SUPPORT_CONDITIONS),
        DISTANT_PUNCH_PAIR,
        GRAVITY_IN_SPACE,
        HINGE_MOTION_PATTERN,
        [FACING_NODES_REMEDY],
    ),
    "axis": (
        make_ring,
        RING_WALL_PAIR,
        (0.0, 1.0),
        "0: translation y",
        [FRICTION_OF_FIRST_PAIR_REMEDY],
    ),
    # friction under the first block would not hold the second
    "second": (
        make_two_blocks,
        ContactPair(lambda x: np.isclose(x[1], 0.0) & (x[0] < 4), FLOOR),
        GRAVITY,
        f"{FIRST_BODY_TRANSLATION_PATTERN} and .*{SECOND_BODY_TRANSLATION_PATTERN}",
        [],
    ),
}


@pytest.mark.parametrize("name", FREE_MOTION_CASES)
def test_free_motions_are_named(name):
    make_body, pairs, load, message, remedies = FREE_MOTION_CASES[name]
    error = catch_refusal_and_check_proof(
        make_body(SELF_COMM), pairs, load, f"{message}.*: held", FreeBody
    )
    support = "hold it by a support, whose reaction is zero unless the loads drive the motion"
    assert str(error).split("; ")[-1].split(", or ") == [support, *remedies]


def collect_refusal_messages(comm):
    """Return the error messages of problems without equilibrium, then those of free bodies."""
    upper_on_lower, floor_in_space = (
        make_two_blocks(comm, 0.0, 1.0),
        ContactPair(on_plane(2, 0.0), FLOOR_IN_SPACE, 0.3),
    )
    plate = pushed_surface_pair(CEILING, (0, 1.0))
    cases = [
        *(
            (make_block(comm), floor_pair(mu), f)
            for mu, f in ((0.3, (0.4, -1.0)), (3.0, (2.5, -1.0)))
        ),
        (make_block(comm), floor_pair(), (0.0, 1.0)),
        (make_clamped_block(comm), plate, (0.0, 0.0)),
        (make_two_blocks(comm), floor_pair(), (0.4, -1.0)),
        (upper_on_lower, make_stacked_pairs(upper_on_lower, 0.6, 0.3), (0.4, -1.0)),
        (make_solid_block(comm), floor_in_space, (0.3, 0.3, -1.0)),
        (make_ring(comm), floor_pair(0.0), (0.3, 1.0)),
    ]
    cases += [(make(comm), pairs, load) for make, pairs, load, *_ in FREE_MOTION_CASES.values()]
    messages = []
    for problem, pairs, load in cases:
        with pytest.raises(ContactFailed) as error:
            problem.solve(pairs, load)
        messages.append(f"{error.type.__name__}: {error.value}")
    return messages


# -- no proof ---------------------------------------------------------------------------------


def test_the_nearest_state_of_a_failure_is_kept_but_cannot_be_continued(tmp_path):
    greco = GrecoFrictionBenchmark(16)
    with pytest.raises(SolutionNotFound, match="came nearest violates the law by") as caught:
        greco.solve(1.0, max_iterations=3, remedies=())
    state = caught.value.state
    assert not state.converged
    assert state.iterations == 3
    assert 1e-6 < state.residuals.largest() < 10
    problem = greco.contact_problem(greco.floor_pair(1.0), greco.symmetry_supports)
    with pytest.raises(ValueError, match="has not converged: continue from the last converged"):
        problem.step(state, greco.edge_load)
    with pytest.raises(ValueError, match="the state is not a solution"):
        problem.save(state, tmp_path / "state.npz")


def friction_capacity_in_message(error):
    """Return the largest possible friction force that an error message states."""
    return float(re.search(r"of at most (\S+) along", str(error)).group(1))


def friction_demand_in_message(error):
    """Return the friction force that would be needed, which an error message states."""
    return float(re.search(r"would have to carry (\S+) of", str(error)).group(1))


def test_friction_limits_at_the_start_are_not_stated_for_pairs_without_force_or_with_more():
    """The limit of friction is that of the nearest state if the one at the start says nothing.

    Either there was no contact force at the start, or the limit was above the friction needed.
    """
    _, problem, fitted, *_ = press_ring_on_shaft()
    failed, message = replace(fitted, converged=False), "in the nearest state"
    (pair,) = fitted.pairs
    shear = pair.force_normal[:, None] * [0.0, 0.3]
    failed = replace(failed, pairs=(replace(pair, force_tangential=shear),))
    capacity = f"{0.3 * pair.force_normal.sum():.4g}"
    # before, a fit that is twice as tight does not limit the friction after it is loosened
    tighter_fit = replace(fitted, pairs=(replace(pair, force_normal=2.0 * pair.force_normal),))
    for start_state in (problem.undeformed, tighter_fit):
        text = describe_exhausted_friction(failed, start_state)
        assert f"of at most {capacity} along" in text
        assert message in text


def press_ring_on_shaft():
    """Return a ring pressed on a shaft, its problem, state, end area and friction capacity.

    The ring is fitted with interference. The capacity is the friction coefficient times the normal
    force of the fit.
    """
    ring = BodyWithSupports(triangles(SELF_COMM, (1.0, 0.0), (2.0, 1.0), (4, 4)), "axisymmetric")
    pair = ContactPair(on_plane(0, 1.0), Plane((1.01, 0), (1, 0)), 0.3, interference=True)
    problem, area = ring.contact_problem(pair), np.pi * (2**2 - 1)
    fitted = problem.step(problem.undeformed, ring.traction_load((0, 1e-9), on_plane(1, 1.0)))
    return ring, problem, fitted, area, 0.3 * fitted.pairs[0].force_normal.sum()


@pytest.mark.parametrize("overload", [1.02, 1.2, 1.5, 2.0, 3.0, 100.0])
def test_the_refusal_of_a_ring_pushed_off_its_shaft_states_the_friction_capacity(overload):
    """The refusal of a ring that is pushed off its shaft states how much friction is available.

    This is the friction coefficient times the normal force of the fit, however large the load is,
    and not of a state that the load has deformed further. Smaller increments cannot help, and the
    message does not suggest them.
    """
    ring, problem, fitted, area, capacity = press_ring_on_shaft()
    pushed = problem.step(fitted, ring.traction_load((0, 0.95 * capacity / area), on_plane(1, 1.0)))
    assert pushed.pairs[0].force[1] == pytest.approx(-0.95 * capacity)
    load = ring.traction_load((0, overload * capacity / area), on_plane(1, 1.0))
    with pytest.raises(
        SolutionNotFound, match=r"pair 0 is exhausted: .*increments do not"
    ) as caught:
        problem.step(fitted, load)
    assert "may find one" not in str(caught.value)
    assert friction_capacity_in_message(caught.value) == pytest.approx(capacity, rel=1e-3)
    assert friction_demand_in_message(caught.value) == pytest.approx(overload * capacity, rel=0.02)


@pytest.mark.parametrize("overload", [7.0, 20.0, 100.0])
def test_a_ring_pushed_far_off_its_shaft_is_in_no_equilibrium(overload):
    """A push that far exceeds the friction of a press fit is refused.

    With soft springs, the ring slides until round-off exceeds the load; such a state must not be
    accepted as a solution.
    """
    ring, problem, fitted, area, capacity = press_ring_on_shaft()
    load = ring.traction_load((0, overload * capacity / area), on_plane(1, 1.0))
    with pytest.raises(SolutionNotFound, match=r"pair 0 is exhausted: .*increments do not"):
        problem.step(fitted, load)


def test_the_refusal_of_a_tool_pushed_too_hard_states_the_friction_capacity():
    rubber = RubberUnderCircle(friction=0.3)
    pressed = rubber.problem.step(rubber.problem.undeformed, motions=Motion((0.0, -0.15)))
    normal = pressed.pairs[0].force_normal.sum()
    with pytest.raises(
        SolutionNotFound, match=r"pair 0 is exhausted: .*increments do not"
    ) as caught:
        rubber.problem.step(pressed, motions=Motion((None, -0.15), (-0.6 * normal, 0.0)))
    assert friction_capacity_in_message(caught.value) == pytest.approx(0.3 * normal, rel=0.15)


def test_refusals_of_other_causes_do_not_blame_friction():
    greco = GrecoFrictionBenchmark(16)
    with pytest.raises(SolutionNotFound, match=r"may find one$"):
        greco.solve(1.0, max_iterations=3, remedies=())


# -- another program, other forces ---------------------------------------------------------------


def draw_rigid_contact_points(rng, count, dim):
    """Return random contact points of a rigid body, and their data for the separate program.

    The data are normals (n, dim), friction coefficients (n,), and the velocities (n, dim, modes) of
    the points in the rigid motions.
    """
    x = rng.uniform(-1, 1, (count, dim))
    n = rng.normal(size=(count, dim))
    if rng.random() < 0.7:  # normals that differ little, as on a floor
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
    none_marked = np.zeros(count, dtype=bool)
    return (
        NodeVelocitiesInRigidMotions(
            np.zeros(count, dtype=int), mu, none_marked, normal, tangential
        ),
        n,
        mu,
        modes,
    )


def can_contact_forces_balance_loads(normals, mu, rigid_modes, load_power, tangential_directions):
    """Return whether some admissible contact forces balance the loads.

    Each contact force is a nonnegative combination of the vectors normal + mu * direction, where
    `tangential_directions` are given in a basis of the node's tangent plane.
    """
    generators = []
    for normal, friction in zip(normals, mu, strict=True):
        t = np.linalg.svd(normal[None])[2][1:]
        for d in tangential_directions @ t:
            generators.append(normal + friction * d)
    n_directions = len(tangential_directions)
    work = np.array(
        [rigid_modes[k // n_directions].T @ force for k, force in enumerate(generators)]
    )
    solution = linprog(np.zeros(len(work)), A_eq=work.T, b_eq=-load_power, bounds=(0, None))
    assert solution.status in (0, 2)
    return solution.status == 0


@pytest.mark.parametrize("seed", range(60))
def test_a_proof_is_found_exactly_where_no_forces_balance_the_loads(seed):
    """A proof of "no equilibrium" is found exactly where no contact forces balance the loads.

    A separate linear program decides whether forces balance the loads. In the plane, two vectors
    span each friction cone. In space, the program is solved with a pyramid inside each cone and
    with a pyramid around it.
    """
    rng = np.random.default_rng((7, seed))
    dim = 2 + seed % 2
    points, n, mu, modes = draw_rigid_contact_points(rng, int(rng.integers(1, 8)), dim)
    power = rng.normal(size=modes.shape[2])
    if rng.random() < 0.6:  # loads that are balanced by nearly admissible forces
        forces = n + 0.5 * mu[:, None] * rng.normal(size=n.shape)
        power = -np.einsum("nak,na->k", modes, forces) + 0.3 * rng.normal() * power
    velocity_and_missing = find_motion_proving_no_equilibrium(points, power, np.abs(power))
    is_proved = velocity_and_missing is not None
    if dim == 2:
        assert is_proved is not can_contact_forces_balance_loads(
            n, mu, modes, power, np.array([[1.0], [-1.0]])
        )
    else:
        angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        if can_contact_forces_balance_loads(n, mu, modes, power, circle):
            assert not is_proved
        if not can_contact_forces_balance_loads(n, mu, modes, power, circle / np.cos(np.pi / 64)):
            assert is_proved
    if velocity_and_missing is not None:  # the smallest missing load is enough for an equilibrium
        velocity, missing = velocity_and_missing
        tolerance = 1e-5 * np.abs(power).max()
        assert -missing @ velocity == pytest.approx(power @ velocity, abs=tolerance)
        completed_power = power + missing
        assert (
            find_unresisted_motion_of_most_work(points, completed_power)[0] @ completed_power
            < tolerance
        )


def test_no_motion_is_a_proof_where_forces_balance_the_loads():
    """No motion is accepted as a proof if contact forces balance the loads.

    One motion is random, one is near the motion by which the body would escape, and one follows the
    loads.
    """
    n_overstepped = n_proved = 0
    for seed in range(200):
        rng = np.random.default_rng((8, seed))
        points, n, mu, modes = draw_rigid_contact_points(rng, int(rng.integers(1, 8)), 2)
        power = rng.normal(size=modes.shape[2])
        if rng.random() < 0.6:
            forces = n + 0.5 * mu[:, None] * rng.normal(size=n.shape)
            power = -np.einsum("nak,na->k", modes, forces) + 0.3 * rng.normal() * power
        is_balanced = can_contact_forces_balance_loads(
            n, mu, modes, power, np.array([[1.0], [-1.0]])
        )
        velocity, _ = find_unresisted_motion_of_most_work(points, power)
        for motion in (rng.normal(size=len(power)), velocity + rng.normal(size=len(power)), power):
            violates_cone = points.friction_cone_margins(motion).min() < -1e-3
            n_overstepped += is_balanced and violates_cone and power @ motion > 1e-3
            if does_motion_prove_no_equilibrium(points, power, np.abs(power), motion):
                n_proved += 1
                assert not is_balanced, (seed, motion)
    assert n_overstepped > 50  # motions with positive work of loads, but larger resistance
    assert n_proved > 10


def test_a_motion_outside_the_friction_cone_is_no_proof(monkeypatch):
    """A motion that violates the friction cone is not accepted as a proof.

    The motion replaces the result of the linear program. In it a block slides on a floor, where
    friction would take up more work than the load does.
    """
    eye = np.eye(2)
    none_marked = np.zeros(1, dtype=bool)
    normal, tangential = np.array([[0.0, 1.0]]), np.array([[eye[0], [0.0, 0.0]]])
    points = NodeVelocitiesInRigidMotions(
        np.zeros(1, dtype=int), np.array([0.5]), none_marked, normal, tangential
    )
    power = np.array([0.3, -1.0])  # the push is smaller than friction under a unit normal force
    motion = np.array([1.0, 0.0])
    monkeypatch.setattr(
        refusals, "find_unresisted_motion_of_most_work", lambda *_: (motion, np.zeros(2))
    )
    assert find_motion_proving_no_equilibrium(points, power, np.abs(power)) is None
    assert (
        find_motion_proving_no_equilibrium(
            replace(points, friction_slope=np.zeros(1)), power, np.abs(power)
        )
        is not None
    )


@pytest.mark.parametrize("blocked", [False, True])
def test_sparse_and_dense_algebra_find_the_same_free_motions(monkeypatch, blocked):
    """Sparse and dense algebra find the same motions of bodies, and give the same messages.

    The library uses sparse algebra if there are many bodies. Stiffness matrices in blocks of nodal
    unknowns are tested as well.
    """
    two_blocks, messages = make_two_blocks(), []
    two_blocks.K = assemble_matrix(two_blocks.body.stiffness(), blocked=blocked)
    for n_dense in (60, 0):
        monkeypatch.setattr(matrices, "_MAX_DENSE_MODES", n_dense)
        refusal = catch_refusal_and_check_proof(two_blocks, floor_pair(0.3), (0.5, -1.0))
        messages.append((str(refusal), refusal.missing.moment.round(9).tolist()))
        with pytest.raises(FreeBody) as free_body:
            two_blocks.solve(ContactPair(on_plane(1, 1.0), CEILING, 0.0), (0.0, 0.0))
        messages[-1] += (str(free_body.value),)
        assert two_blocks.solve(floor_pair(0.3), (0.1, -1.0)).converged
    assert messages[0] == messages[1]


def test_a_stiffness_between_bodies_holds_them():
    """Springs between a free and a clamped block, added to the stiffness matrix, hold the free one.

    Nothing else holds the free block, which is refused without the springs.
    """
    two_blocks = make_two_blocks()
    two_blocks.conditions = [
        prescribe(two_blocks.space, i, lambda x: np.isclose(x[1], 0.0) & (x[0] < 2.5))
        for i in (0, 1)
    ]
    load, pair = (0.0, 0.0), ContactPair(on_plane(1, 1.0), CEILING, 0.0)
    with pytest.raises(FreeBody):
        two_blocks.solve(pair, load)
    is_free = two_blocks.x[:, 0] > 2.5
    fixed_nodes, free_nodes = (
        np.flatnonzero(node_mask)[[0, -1]] for node_mask in (~is_free, is_free)
    )
    rows = (2 * np.stack([fixed_nodes, free_nodes], axis=1)[:, :, None] + [0, 1]).astype(np.int32)
    K = two_blocks.K.copy()
    K.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    for pair_of_nodes in rows:
        for dofs in pair_of_nodes.T:
            K.setValues(dofs, dofs, [100.0, -100.0, -100.0, 100.0], addv=True)
    K.assemble()
    two_blocks.K = K
    assert two_blocks.solve(pair, load).displacement.norm() == pytest.approx(0.0, abs=1e-12)
    reduction = Reduction.dirichlet(two_blocks.space, two_blocks.conditions)
    push_load = nodal_load(two_blocks.space, lambda x: np.isclose(x[0], 7.0), (1.0, 1.0))
    direct_solution, iterative_solution = (
        solve(K, push_load, reduction, solver) for solver in (Direct(), Iterative())
    )
    assert (direct_solution - iterative_solution).norm() < 1e-8 * direct_solution.norm()

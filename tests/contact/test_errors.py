from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements.checks import DegenerateMesh, check_mesh
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactPair,
    FreeBody,
    Motion,
    NoEquilibrium,
    NotFound,
    NotUnique,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    solve_contact,
)
from pw_elements.contact.iteration import ActiveSet, Contact
from pw_elements.contact.iteration.policy import Cycles
from pw_elements.contact.model import Cone, Coulomb
from pw_elements.elasticity import StressState, nodal_load
from pw_elements.meshes import curved, mapped, quadrilaterals, triangles
from tests.contact.cases import Block, Greco, at

BLOCK = Block(4)
FLOOR = Plane((0, 0), (0, 1))


def solved(pair, load=None, reduction=BLOCK.free, **options):
    load = BLOCK.pressure if load is None else load
    return solve_contact(BLOCK.K, load, reduction, [pair], BLOCK.space, **options)


def floor(mu=0.3, **options):
    return ContactPair(at(1, 0.0), FLOOR, mu, **options)


@pytest.mark.parametrize("mu", [-0.1, np.nan, np.inf])
def test_impossible_friction_names_nodes(mu):
    with pytest.raises(ValueError, match=r"nodes at \(2, 0\) have a friction"):
        solved(floor(lambda x: np.where(np.isclose(x[0], 2.0), mu, 0.3)))


def test_prescribed_normal_displacement_names_nodes():
    held = Reduction.dirichlet(
        BLOCK.space, [prescribe(BLOCK.space, 1, lambda x: np.isclose(x[0], 0))]
    )
    message = r"at \(0, 0\) have a prescribed normal.*away from the support"
    with pytest.raises(ValueError, match=message):
        solved(floor(), reduction=held)


def test_prescribed_tangential_displacement_is_allowed():
    held = Reduction.dirichlet(
        BLOCK.space, [prescribe(BLOCK.space, 0, lambda x: np.isclose(x[0], 0))]
    )
    (state,) = solved(floor(), reduction=held)
    assert state.residuals.largest() < 1e-12


def test_surface_through_the_body_names_nodes():
    high = ContactPair(at(1, 0.0), Plane((0, 0.1), (0, 1)), 0.3)
    with pytest.raises(ValueError, match=r"\(0, 0\)(, .*){5} and 3 more lie inside the rigid"):
        solved(high)
    pressed = ContactPair(at(1, 0.0), FLOOR, 0.3, [Motion((0, 0.1))])
    (state,) = solved(pressed)
    assert state.pairs[0].force[1] == pytest.approx(800)


def test_no_nodes_and_nodes_of_two_pairs():
    with pytest.raises(ValueError, match="pair 0 has no nodes"):
        solved(ContactPair(at(1, -1.0), FLOOR))
    with pytest.raises(ValueError, match="belong to two contact pairs"):
        solve_contact(BLOCK.K, BLOCK.pressure, BLOCK.free, [floor(), floor()], BLOCK.space)
    with pytest.raises(ValueError, match="no contact pair"):
        solve_contact(BLOCK.K, BLOCK.pressure, BLOCK.free, [], BLOCK.space)


def test_loads_and_motions_have_to_make_sense():
    f = BLOCK.pressure.copy()
    f.setValue(0, np.nan)
    f.assemble()
    with pytest.raises(ValueError, match="load of increment 1 is not finite"):
        solved(floor(), [BLOCK.pressure, f])
    with pytest.raises(ValueError, match="2 motions for 1 increments"):
        solved(floor(motions=[Motion((0, 0))] * 2))
    with pytest.raises(ValueError, match="motion of contact pair 0 is not 2-D"):
        solved(floor(motions=[Motion((0, 0, 0))]))
    with pytest.raises(ValueError, match="no load increment"):
        solved(floor(), [])
    with pytest.raises(ValueError, match="1 of a motion's translation = inf"):
        Motion((0, np.inf))
    with pytest.raises(ValueError, match="a translation and a force"):
        Motion((0, 0), (1.0, 0))


def test_combined_displacements_are_refused():
    pressed = Reduction.dirichlet(BLOCK.space, [])
    twice = pressed.right.copy()
    twice.scale(2.0)
    with pytest.raises(ValueError, match="combines the displacements"):
        solved(floor(), reduction=Reduction(twice, twice, pressed.offset))


def test_lifted_body():
    up = BLOCK.pressure.copy()
    up.scale(-1.0)
    with pytest.raises(NoEquilibrium, match=r"the body lifts off pair 0. At least .* \(0, -800\)"):
        solved(floor(), up)


def test_dragged_body():
    with pytest.raises(NoEquilibrium, match=r"slides along x on pair 0. .* force of \(-12, 0\)"):
        BLOCK.solve(0.3, 0.7 * 200, smooth=0.0)


def test_overturned_body():
    high = boundary_measure(BLOCK.body.spaces.mesh, lambda x: np.isclose(x[0], 4.0) & (x[1] > 0.9))
    f = BLOCK.pressure.copy()
    f.axpy(1.0, assemble_vector(BLOCK.body.surface_load((1800.0, 0.0), high)))
    with pytest.raises(NoEquilibrium, match=r"turns about \(4, 0\) and lifts off pair 0"):
        solved(floor(10.0), f)


def test_body_on_ice_is_held_by_nothing():
    with pytest.raises(FreeBody, match="translation x: held neither by supports nor by contact"):
        solved(floor(0.0))
    ball = ContactPair(at(1, 0.0), Sphere((2, -3), 3.0))
    side = Reduction.dirichlet(
        BLOCK.space,
        [prescribe(BLOCK.space, 0, lambda x: np.isclose(x[0], 2) & np.isclose(x[1], 0))],
    )
    solved(ball, reduction=side)  # a circle's normals hold the rotation


def test_free_surface_is_named():
    foot = [prescribe(BLOCK.space, i, at(1, 2.0)) for i in range(2)]
    free = floor(0.0, motions=[Motion((None, None), (0, 100.0))])
    with pytest.raises(FreeBody, match="translation x of the surface of pair 0"):
        solved(free, reduction=Reduction.dirichlet(BLOCK.space, foot))
    pulled = floor(0.3, motions=[Motion((0, None), (0, -100.0))])
    with pytest.raises(NoEquilibrium, match="the surface of pair 0 lifts off the body"):
        solved(pulled, reduction=Reduction.dirichlet(BLOCK.space, foot))


def test_meshes_that_are_none():
    square = ((0.0, 0.0), (1.0, 1.0), (3, 3))

    def flat(x):
        return np.where(x > 0.9, 2 / 3, x)

    def folded(x):
        inner = np.all(np.isclose(x[:, :2], 1 / 3), axis=1)
        return np.where(inner[:, None], [1.2, 0.9, 0.0], x)

    for build in (triangles, quadrilaterals):
        check_mesh(build(MPI.COMM_SELF, *square))
        with pytest.raises(DegenerateMesh, match="no volume"):
            check_mesh(mapped(build(MPI.COMM_SELF, *square), flat))
    with pytest.raises(DegenerateMesh, match=r"cells around .* same side of a facet"):
        check_mesh(mapped(triangles(MPI.COMM_SELF, *square), folded))
    with pytest.raises(DegenerateMesh, match="inside out"):
        check_mesh(mapped(quadrilaterals(MPI.COMM_SELF, *square), folded))
    bent = curved(
        triangles(MPI.COMM_SELF, *square), lambda x: x + 0.4 * np.sin(9 * x[:, [1, 0, 2]])
    )
    with pytest.raises(DegenerateMesh):
        check_mesh(bent)


def test_cycles_and_exhausted_iterations_are_errors():
    greco = Greco(16)
    with pytest.raises(NotFound, match="runs through the same"):
        greco.solve(10.0, remedies=())
    with pytest.raises(NotFound, match="after 3 iterations"):
        greco.solve(1.0, max_iterations=3, remedies=())


def test_cycling_nodes_change_one_at_a_time():
    """Two nodes that swap their states: the remedy lets the worse one go first."""
    history = Cycles(MPI.COMM_SELF)
    one, two = (
        ActiveSet(np.array(s, dtype=np.int8), np.zeros((2, 1)), *np.zeros((3, 2)))
        for s in ([OPEN, STICK], [STICK, OPEN])
    )
    frame = np.tile(np.eye(2), (2, 1, 1))
    force = np.array([[2.0, 0.0], [-1.0, 0.0]])  # of the first set: one closes, one opens
    cone = Cone([Coulomb(0.3)], [np.full(2, 0.3)])
    contact = Contact(frame, np.zeros(2), np.zeros((2, 1)), force, cone, np.ones(2))
    assert not history.repeats(one)
    assert history.slowed(one, contact).status.tolist() == [STICK, OPEN]
    assert not history.repeats(two)
    assert history.repeats(one)
    assert history.slowed(one, contact).status.tolist() == [OPEN, OPEN]
    assert not history.repeats(one)
    assert not history.repeats(two)
    with pytest.raises(NotFound, match="2 active sets"):
        history.repeats(one)


class OneNode:
    """A body all fixed but for one contact node, which a force pulls along the floor."""

    def __init__(self):
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1))
        body = Body(Spaces.petrov_galerkin(mesh), Material(10.0, 0.3), StressState.PLANE_STRESS)
        self.space = body.spaces.trial
        self.K = assemble_matrix(body.stiffness())

        def corner(x):
            return np.isclose(x[0], 1.0) & np.isclose(x[1], 0.0)

        rest = [prescribe(self.space, i, lambda x: ~corner(x)) for i in range(2)]
        self.reduction = Reduction.dirichlet(self.space, rest)
        self.corner = corner
        self.stiffness = self.reduction.matrix(self.K)[:, :]

    def solve(self, mu, force, start=(), **options):
        load = nodal_load(self.space, self.corner, force)
        pair = ContactPair(self.corner, FLOOR, mu)
        return solve_contact(self.K, load, self.reduction, [pair], self.space, start, **options)


def test_large_friction_has_several_answers_and_says_so():
    node = OneNode()
    (tt, _), (nt, _) = node.stiffness
    side = np.sign(nt)
    critical = abs(tt / nt)

    (below,) = node.solve(0.5 * critical, (-side * 0.6 * critical, -1.0))
    assert below.unique
    assert below.pairs[0].status.tolist() == [SLIP]

    def slipping(state):
        """The same, as a guess, with a node that slips."""
        status, force = np.array([SLIP], dtype=np.int8), np.array([[side, 0.0]])
        return [
            replace(state, pairs=(replace(state.pairs[0], status=status, force_tangential=force),))
        ]

    # the equations of slip have no solution, or at the limit of stick one for any slip
    pushed = (-side * 2 * critical, -1.0)
    with pytest.raises(NotFound, match="the equations have no solution"):
        node.solve(critical, pushed, remedies=())
    (lifted,) = node.solve(critical, pushed)
    assert lifted.pairs[0].status.tolist() == [OPEN]
    assert lifted.pairs[0].gap > 0.1
    # singular but for round-off, which would turn the slip around at the limit itself
    almost = critical * (1 - 1e-13)
    limit = (-side * almost, -1.0)
    (resting,) = node.solve(almost, limit)
    with pytest.raises(NotUnique, match="too large for a unique answer") as caught:
        node.solve(almost, limit, slipping(resting))
    assert caught.value.state.residuals.largest() < 1e-5
    assert np.abs(caught.value.state.pairs[0].slip).max() > 1e-3

    # the node may stick, or slip and thereby relieve itself
    load = (-side * 1.5 * critical, -1.0)
    (stick,) = node.solve(3 * critical, load)
    assert stick.pairs[0].status.tolist() == [STICK]
    (slip,) = node.solve(3 * critical, load, slipping(stick))
    assert slip.pairs[0].status.tolist() == [SLIP]
    assert slip.pairs[0].force_normal < 0.9 * stick.pairs[0].force_normal
    assert max(state.residuals.largest() for state in (stick, slip)) < 1e-12

    assert Greco(16).solve(1.0).unique
    assert not Greco(16).solve(50.0).unique


def test_prescribed_values_have_to_be_tangential_for_every_pair():
    left = prescribe(BLOCK.space, 0, at(0, 0.0))
    wall = ContactPair(at(0, 0.0), Plane((0, 0), (1, 0)))
    with pytest.raises(ValueError, match="prescribed normal displacement"):
        solved(wall, reduction=Reduction.dirichlet(BLOCK.space, [left]))


class Gap:
    """A surface whose gap and normal are given."""

    def __init__(self, gap, normal=(0.0, 1.0)):
        self.gap, self._normal = gap, normal

    def normal(self, x):
        return np.tile(np.asarray(self._normal), (len(x), 1))


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_gap_that_is_no_number_is_refused_wherever_it_comes_up():
    with pytest.raises(ValueError, match=r"\(0, 0\).* see a surface whose gap is not a number"):
        solved(ContactPair(at(1, 0.0), Gap(lambda x: np.sqrt(x[:, 0] - 0.1))))
    arc = Gap(lambda x: x[:, 1] - np.sqrt(36 - (x[:, 0] - 2.0) ** 2) + 6.0)
    moved = ContactPair(at(1, 0.0), arc, 0.3, [Motion((0, 0)), Motion((-5, 0))])
    with pytest.raises(ValueError, match="gap is not a number"):
        solved(moved, [BLOCK.pressure] * 2)


@pytest.mark.parametrize("normal", [(0.0, 2.0), (0.0, 0.0), (np.nan, 1.0)])
def test_normal_has_to_be_a_unit_vector(normal):
    with pytest.raises(ValueError, match="whose normal is no unit vector"):
        solved(ContactPair(at(1, 0.0), Gap(lambda x: x[:, 1], normal)))


def test_surface_has_the_dimension_of_the_body():
    with pytest.raises(
        ValueError, match="pair 0: the point of its surface has 3 components in 2-D"
    ):
        solved(ContactPair(at(1, 0.0), Plane((0, 0, 0), (0, 1, 0))))
    with pytest.raises(ValueError, match="the apex of its surface has 1 components in 2-D"):
        solved(ContactPair(at(1, 0.0), Parabola((0.0,), -1.0)))


def test_circle_is_no_surface_in_space():
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [1, 1, 1], CellType.tetrahedron)
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0), StressState.SOLID)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    pair = ContactPair(at(2, 0.0), Sphere((0, 0), 1.0))
    with pytest.raises(ValueError, match="the centre of its surface has 2 components in 3-D"):
        solve_contact(K, K.createVecLeft(), Reduction.dirichlet(U, []), pair, U)


def test_nodes_by_number_and_by_mask():
    marked = np.isclose(BLOCK.space.tabulate_dof_coordinates()[:, 1], 0.0)
    (state,) = solved(floor())
    for nodes in (marked, np.flatnonzero(marked)):
        (again,) = solved(ContactPair(nodes, FLOOR, 0.3))
        assert again.pairs[0].force_normal == pytest.approx(state.pairs[0].force_normal)
    count = len(marked)
    for nodes in ([-1], [count], marked[:-1]):
        with pytest.raises(ValueError, match=rf"nodes of contact pair 0 .* {count} in all"):
            solved(ContactPair(np.array(nodes), FLOOR))
    with pytest.raises(ValueError, match="lie inside of the body, not on its boundary"):
        solved(ContactPair(lambda x: x[1] < 0.6, FLOOR))


def test_error_names_its_increment():
    lifted = BLOCK.pressure * -1.0
    with pytest.raises(FreeBody, match=r"^increment 2: ") as caught:
        solved(floor(), [BLOCK.pressure, BLOCK.pressure, lifted])
    assert len(caught.value.states) == 2
    assert caught.value.states[1].pairs[0].force[1] == pytest.approx(800)


def test_surface_that_faces_the_wrong_way_is_refused():
    with pytest.raises(ValueError, match="pair 0 pushes the body outwards at each of its nodes"):
        solved(ContactPair(at(1, 0.0), Plane((0, 0), (0, -1)), 0.3))
    above = SignedDistance(lambda x: x[:, 1] - 2.0)
    with pytest.raises(ValueError, match="reverse it"):
        solved(ContactPair(at(1, 2.0), above))


def test_shapes_of_users_functions_are_told():
    with pytest.raises(ValueError, match=r"of the shape \(2,\) .* takes points as rows"):
        solved(ContactPair(at(1, 0.0), SignedDistance(lambda x: x[1])))
    with pytest.raises(ValueError, match=r"the gap of .* pair 0 gave .* shape \(1,\)"):
        solved(ContactPair(at(1, 0.0), Gap(lambda x: x[:1, 1])))
    with pytest.raises(ValueError, match=r"the friction of .* pair 0 .* points as columns"):
        solved(floor(lambda x: np.full(len(x), 0.3)))


def test_one_pair_and_one_start_need_no_list():
    pair = floor()
    (state,) = solve_contact(BLOCK.K, BLOCK.pressure, BLOCK.free, pair, BLOCK.space)
    (again,) = solve_contact(BLOCK.K, BLOCK.pressure, BLOCK.free, pair, BLOCK.space, state)
    assert again.iterations == 1
    with pytest.raises(ValueError, match="max_iterations = 0: has to be a whole number"):
        solved(floor(), max_iterations=0)


@pytest.mark.parametrize("share", [0.5, 0.8])
@pytest.mark.parametrize("mu", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("n", [4, 8, 16])
@pytest.mark.parametrize("element", ["new triangle", "standard quadrilateral"])
def test_a_plate_under_force_that_is_pressed_and_pushed_at_once(element, n, mu, share):
    """A clamped block's plate is held by friction alone, and Q < mu P: there is a solution."""
    build, method = {
        "new triangle": (triangles, Spaces.petrov_galerkin),
        "standard quadrilateral": (quadrilaterals, Spaces.serendipity),
    }[element]
    mesh = build(MPI.COMM_SELF, (0.0, 0.0), (4.0, 2.0), (n, n // 2))
    body = Body(method(mesh), Material(1000.0, 0.3), StressState.PLANE_STRAIN)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    clamped = Reduction.dirichlet(U, [prescribe(U, i, at(1, 0.0)) for i in (0, 1)])
    plate = ContactPair(
        at(1, 2.0), Plane((0, 2), (0, -1)), mu, [Motion((None, None), (share * mu, -1.0))]
    )
    (state,) = solve_contact(K, K.createVecLeft(), clamped, plate, U)
    assert state.residuals.largest() < 1e-10
    assert state.pairs[0].force == pytest.approx((share * mu, -1.0), rel=1e-9)
    status = state.pairs[0].status
    assert (status == STICK).any()
    # one set of status with all slipping would leave the plate free
    assert not np.all(status == SLIP)

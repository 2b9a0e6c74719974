"""Interface laws, each compared with a solution that is known exactly."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import create_box
from scipy.optimize import brentq

from pw_elements import Sibling, Spaces, SurfaceNodes, prescribe
from pw_elements.contact import (
    OPEN,
    ContactPair,
    ContactProblem,
    Motion,
    Plane,
    SolutionNotFound,
)
from pw_elements.contact.model import (
    CohesiveContact,
    ElasticInterface,
    InterfaceResponse,
    InterfaceValues,
    Tie,
    UnilateralContact,
    find_wrong_derivatives,
)
from pw_elements.contact.steps import stepping
from pw_elements.meshes import triangles
from tests.contact.cases import (
    GALERKIN,
    PETROV_GALERKIN,
    BlockOnFloor,
    ElasticBody,
    make_finite_strain_unknown_and_residual,
    on_plane,
)
from tests.contact.test_friction import FOR_DIRECT_AND_ITERATIVE_SOLVER
from tests.contact.test_large import CIRCLE_MOTIONS, RubberUnderCircle, step_through
from tests.contact.two_bodies import StackedBlocks, round_lower_side
from tests.parallel import assert_same_on_processes

E, HEIGHT, WIDTH = 1000.0, 2.0, 1.0
BAR_STIFFNESS = E / HEIGHT  # pressure per displacement
LAYER = ElasticInterface(normal_stiffness=400.0, tangential_stiffness=150.0)
# softens by 105 per length, more slowly than the bar unloads
DUCTILE = CohesiveContact(stiffness=2000.0, strength=2.0, toughness=0.02)
# softens by 2000 per length, faster than the bar unloads
BRITTLE = CohesiveContact(stiffness=2000.0, strength=2.0, toughness=0.002)


def falling_friction(pressure, path):
    """Return a coefficient that falls with pressure and with path, and its derivatives."""
    by_pressure, by_path = 1 / (1 + pressure / 40.0), np.exp(-path / 0.5)
    mu = 0.1 + 0.3 * by_pressure * by_path
    return mu, -0.3 / 40 * by_pressure**2 * by_path, -0.3 / 0.5 * by_pressure * by_path


LAWS_BY_NAME = {
    "elastic": LAYER,
    "tie": Tie(),
    "Coulomb": UnilateralContact(0.3),
    "falling friction": UnilateralContact(falling_friction),
    "regularised": UnilateralContact(falling_friction, regularisation_length=0.02),
    "wear": UnilateralContact(0.2, wear_coefficient=0.01),
    "cohesion": CohesiveContact(stiffness=20.0, strength=2.0, toughness=1.0),
}


class Bar(ElasticBody):
    """A block without lateral contraction, whose exact stresses are uniform, over a floor."""

    def __init__(self, method=PETROV_GALERKIN, comm=MPI.COMM_SELF):
        mesh = triangles(comm, (0.0, 0.0), (WIDTH, HEIGHT), (3, 4))
        super().__init__(mesh, method, E=E, nu=0.0)

    def make_problem(self, law, top_displacement=0.0, **options):
        """Return the problem of the bar, whose top is held, or pressed if it is None."""
        top = on_plane(1, HEIGHT)
        supports = self.make_supports((0, top))
        if top_displacement is not None:
            supports = self.make_supports((0, top, 0.0), (1, top, top_displacement))
        return self.contact_problem(floor_pair(law), supports, **options)

    def weights(self):
        return SurfaceNodes.from_body(self.body, on_plane(1, 0.0)).weight_area


def floor_pair(law):
    return ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), interface_law=law)


def step_floor_through(problem, translations):
    """Return the states after each translation (n, 2) of the floor."""
    states = [problem.undeformed]
    for translation in translations:
        states.append(problem.step(states[-1], motions=Motion(translation)))
    return states[1:]


def make_random_values(law, n=200, dim=3, seed=0):
    random = np.random.default_rng(seed)
    history = np.zeros((n, law.n_history))
    if law.n_history:
        history[:] = random.uniform(0, 0.5, (n, law.n_history))
    increment = random.uniform(-1, 1, (n, dim - 1))
    return InterfaceValues(
        gap=random.uniform(-0.5, 0.5, n),
        slip=increment + random.uniform(-0.3, 0.3, (n, dim - 1)),
        slip_increment=increment,
        force=random.uniform(-3, 3, (n, dim)),
        history=history,
        weight=random.uniform(0.5, 2, n),
        stiffness=random.uniform(2, 5, n),
        position=np.zeros((n, dim)),
    )


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", LAWS_BY_NAME)
def test_derivatives_are_those_of_the_force(name, dim):
    """No derivative of a law differs from differences, and an error of 1e-5 is found."""
    law, values = LAWS_BY_NAME[name], make_random_values(LAWS_BY_NAME[name], dim=dim)
    wrong, _ = find_wrong_derivatives(law, values)
    assert not wrong.any()

    class Falsified:
        n_history = law.n_history

        def evaluate(self, values):
            response = law.evaluate(values)
            return replace(response, by_motion=response.by_motion * (1 + 1e-5))

    wrong, _ = find_wrong_derivatives(Falsified(), values)
    np.testing.assert_array_equal(wrong, law.evaluate(values).by_motion.any(axis=(1, 2)))


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize("method", [PETROV_GALERKIN, GALERKIN])
def test_an_elastic_layer_and_a_bar_are_springs_in_series(solver, method):
    """The layer transfers pressure, tension and shear in proportion to gap and slip."""
    bar = Bar(method)
    pressure = 3.0
    shear = 2.0
    problem = bar.make_problem(LAYER, None, solver=solver)
    load = bar.traction_load((0.0, -pressure), on_plane(1, HEIGHT))
    for sign in (1.0, -1.0):
        (pair,) = problem.step(problem.undeformed, sign * load).pairs
        np.testing.assert_allclose(pair.gap, -sign * pressure / 400.0, rtol=1e-9)
        np.testing.assert_allclose(pair.force_normal, sign * pressure * bar.weights(), rtol=1e-9)
    # shear tractions on all sides but the base
    load = bar.traction_load((shear, 0.0), on_plane(1, HEIGHT))
    load += bar.traction_load((0.0, shear), on_plane(0, WIDTH))
    load += bar.traction_load((0.0, -shear), on_plane(0, 0.0))
    problem = bar.contact_problem(floor_pair(LAYER), solver=solver)
    state = problem.step(problem.undeformed, load)
    np.testing.assert_allclose(state.pairs[0].slip[:, 0], shear / 150.0, rtol=1e-8)
    exact = np.column_stack([shear / 150.0 + shear / (E / 2) * bar.x[:, 1], 0 * bar.x[:, 0]])
    np.testing.assert_allclose(
        state.displacement.array.reshape(-1, 2), exact, atol=1e-8 * exact.max()
    )


@pytest.mark.parametrize("method", [PETROV_GALERKIN, GALERKIN])
def test_weights_in_axisymmetry_are_those_of_the_circumference(method):
    """A cylinder on a layer moves as a whole under a uniform pressure."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (WIDTH, HEIGHT), (3, 4))
    cylinder = ElasticBody(mesh, method, "axisymmetric", E=E, nu=0.0)
    supports = cylinder.make_supports((0, on_plane(0, 0.0), 0.0))
    problem = cylinder.contact_problem(floor_pair(LAYER), supports)
    load = cylinder.traction_load((0.0, -3.0), on_plane(1, HEIGHT))
    (pair,) = problem.step(problem.undeformed, load).pairs
    np.testing.assert_allclose(pair.gap, -3.0 / 400.0, rtol=1e-8)
    np.testing.assert_allclose(pair.force[1], 3.0 * np.pi * WIDTH**2, rtol=1e-9)


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_unilateral_contact_is_one_of_the_laws(solver):
    """The law of contact with Coulomb friction gives the states of pairs without a law."""
    block = BlockOnFloor(8)
    pairs = [
        ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), friction=0.3),
        floor_pair(UnilateralContact(0.3)),
    ]
    loads = block.press_then_pull_loads(90.0, 4)
    for expected, state in zip(
        *(block.solve_contact(p, block.no_supports, loads, solver=solver) for p in pairs),
        strict=True,
    ):
        largest = np.abs(expected.pairs[0].force_vector).max()
        np.testing.assert_allclose(
            state.pairs[0].force_vector, expected.pairs[0].force_vector, atol=1e-9 * largest
        )


def test_unilateral_contact_is_one_of_the_laws_at_large_strains():
    """On a circle that rubs over rubber, the law gives the states of pairs without a law."""
    rubber = RubberUnderCircle()
    law_problem = rubber.problem_with(friction=0.0, interface_law=UnilateralContact(0.3))
    for expected, state in zip(
        step_through(rubber.problem, CIRCLE_MOTIONS),
        step_through(law_problem, CIRCLE_MOTIONS),
        strict=True,
    ):
        largest = np.abs(expected.pairs[0].force_vector).max()
        np.testing.assert_allclose(
            state.pairs[0].force_vector, expected.pairs[0].force_vector, atol=1e-8 * largest
        )


def test_friction_falls_with_pressure_and_path():
    """Nodes that slide under a changing pressure have the friction of their pressure and path."""
    bar = Bar()
    problem = bar.make_problem(UnilateralContact(falling_friction), top_displacement=-0.05)
    path = np.zeros(7)
    for state in step_floor_through(problem, [(0.2, 0.0), (0.5, 0.0), (0.1, 0.0)]):
        (pair,) = state.pairs
        slip = np.linalg.norm(pair.slip, axis=1)
        closed = pair.status != OPEN
        assert closed.sum() > 3
        assert slip[closed].min() > 0.01
        path += slip
        mu, _, _ = falling_friction(pair.force_normal / bar.weights(), path)
        np.testing.assert_allclose(
            pair.force_tangential,
            -(mu * pair.force_normal / np.where(closed, slip, 1.0))[:, None] * pair.slip,
            atol=1e-9 * pair.force_normal.max(),
        )
        np.testing.assert_allclose(pair.law_history[:, 2], path, rtol=1e-12)


@pytest.mark.parametrize("method", [PETROV_GALERKIN, GALERKIN])
def test_friction_of_tetrahedra_falls_with_pressure_and_path(method):
    """The weights of vertices of standard tetrahedra vanish: such nodes have no pressure."""
    mesh = create_box(MPI.COMM_SELF, [[0.0, 0.0, 0.0], [WIDTH, WIDTH, HEIGHT]], [3, 3, 3])
    block = ElasticBody(mesh, method, "solid", E=E, nu=0.0)
    top = on_plane(2, HEIGHT)
    supports = block.make_supports((0, top), (1, top), (2, top, -0.05))
    floor = ContactPair(
        on_plane(2, 0.0),
        Plane((0, 0, 0), (0, 0, 1)),
        interface_law=UnilateralContact(falling_friction),
    )
    problem = block.contact_problem(floor, supports)
    pressed = problem.step(problem.undeformed)
    (pair,) = problem.step(pressed, motions=Motion((0.2, 0.1, 0.0))).pairs
    weights = SurfaceNodes.from_body(block.body, on_plane(2, 0.0)).weight_area
    has_weight = weights > 1e-10 * weights.max()
    assert has_weight.all() == (method is PETROV_GALERKIN)
    pressure = np.where(has_weight, pair.force_normal / np.where(has_weight, weights, 1.0), 0.0)
    slip = np.linalg.norm(pair.slip, axis=1)
    slides = (pair.status != OPEN) & (slip > 0.01)
    assert slides.sum() > 20
    mu, _, _ = falling_friction(pressure[slides], slip[slides])
    directions = pair.slip[slides] / slip[slides, None]
    np.testing.assert_allclose(
        pair.force_tangential[slides],
        -(mu * pair.force_normal[slides])[:, None] * directions,
        atol=1e-9 * pair.force_normal.max(),
    )


def test_regularised_friction_slips_as_far_as_its_force_demands():
    """In a uniformly pressed and sheared block, the slip follows from the smooth friction law."""
    bar, pressure, shear, length = Bar(), 10.0, 2.0, 0.003
    law = UnilateralContact(0.3, regularisation_length=length)
    pressed = bar.traction_load((0.0, -pressure), on_plane(1, HEIGHT))
    load = bar.traction_load((shear, -pressure), on_plane(1, HEIGHT))
    load += bar.traction_load((0.0, shear), on_plane(0, WIDTH))
    load += bar.traction_load((0.0, -shear), on_plane(0, 0.0))
    problem = bar.contact_problem(floor_pair(law))
    (pair,) = problem.step(problem.step(problem.undeformed, pressed), load).pairs
    slip = length * shear / np.sqrt((0.3 * pressure) ** 2 - shear**2)
    np.testing.assert_allclose(pair.slip[:, 0], slip, rtol=1e-7)
    np.testing.assert_allclose(pair.force_tangential[:, 0], -shear * bar.weights(), rtol=1e-9)


@pytest.mark.parametrize("map_upper", [None, round_lower_side], ids=["flat", "with gaps"])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_a_tie_joins_bodies_whose_meshes_do_not_match(cell, map_upper):
    """Tied blocks stretch like one body; initial gaps are kept, and cause no forces."""
    stack = StackedBlocks((3, 4), cell, map_upper=map_upper)
    pair = replace(stack.make_pair("upper"), interface_law=Tie())
    supports = stack.make_supports(*((i, on_plane(i, 0.0)) for i in range(stack.dim)))
    problem = stack.contact_problem(pair, supports)
    at_rest = problem.step(problem.undeformed)
    assert at_rest.displacement.norm() < 1e-18
    tension = stack.traction_load(1e-3 * np.eye(stack.dim)[stack.up])
    state = problem.step(at_rest, tension)
    (tied,) = state.pairs
    np.testing.assert_allclose(tied.gap, at_rest.pairs[0].gap, atol=1e-12)
    np.testing.assert_allclose(tied.force[stack.up], -1e-3, rtol=1e-9)
    if map_upper is None:
        exact = -stack.uniaxial_displacement()
        np.testing.assert_allclose(
            state.displacement.array.reshape(-1, stack.dim), exact, atol=1e-9 * np.abs(exact).max()
        )


def test_worn_volume_is_coefficient_times_force_times_path():
    """Under a constant load, wear lowers the bar by Archard's depth of earlier increments."""
    bar, pressure, wear = Bar(), 5.0, 2e-4
    problem = bar.make_problem(UnilateralContact(0.0, wear_coefficient=wear), None)
    load, state = bar.traction_load((0.0, -pressure), on_plane(1, HEIGHT)), problem.undeformed
    path, worn = 0.0, 0.0
    for position in (0.0, 0.3, 0.1, 0.6):
        before = state.pairs[0].translation[0]
        state = problem.step(state, load, Motion((position, 0.0)))
        (pair,) = state.pairs
        np.testing.assert_allclose(pair.gap, -worn, atol=1e-14)
        path += abs(position - before)
        worn = wear * pressure * path
        depth = pair.law_history[:, 3]
        volume = np.sum(depth * bar.weights())
        assert volume == pytest.approx(wear * pair.force[1] * path, rel=1e-9, abs=1e-15)
        np.testing.assert_allclose(depth, worn, rtol=1e-9, atol=1e-15)


def test_wear_relieves_a_bar_between_two_held_ends():
    """At prescribed displacements, the pressure falls from increment to increment."""
    bar, wear, depth = Bar(), 1e-3, 0.0
    problem = bar.make_problem(UnilateralContact(0.0, wear_coefficient=wear), -0.01)
    positions = np.linspace(0.0, 2.0, 6)
    for state, step in zip(
        step_floor_through(problem, [(x, 0.0) for x in positions]),
        np.diff(positions, prepend=0.0),
        strict=True,
    ):
        pressure = BAR_STIFFNESS * (0.01 - depth)
        np.testing.assert_allclose(state.pairs[0].force_normal, pressure * bar.weights(), rtol=1e-8)
        depth += wear * pressure * step


def cohesive_traction(law, opening, largest):
    """Return the traction of the triangular law after the opening `largest`."""
    d_0, d_f = law.strength / law.stiffness, 2 * law.toughness / law.strength
    if largest <= d_0:
        return law.stiffness * opening
    at_largest = max(0.0, law.strength * (d_f - largest) / (d_f - d_0))
    return at_largest * opening / largest


def bar_traction_excess(opening, distance, largest):
    """Return the traction of the stretched bar less that of the ductile law at an opening."""
    law_traction = cohesive_traction(DUCTILE, opening, max(largest, opening))
    return BAR_STIFFNESS * (distance - opening) - law_traction


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_a_bar_is_torn_off_along_the_softening_branch(solver):
    """Equilibria of bar and cohesive law are followed to separation, with unloading between."""
    problem = Bar().make_problem(DUCTILE, solver=solver)
    largest, dissipated = 0.0, []
    distances = np.array([0.4, 0.6, 1.0, 1.2, 1.4, 0.8, -0.1, 1.6, 1.8, 2.1, 2.2]) * 0.01
    for distance, state in zip(
        distances, step_floor_through(problem, [(0.0, -d) for d in distances]), strict=True
    ):
        (pair,) = state.pairs
        if distance < 0:
            opening, traction = 0.0, BAR_STIFFNESS * distance
        else:
            opening = brentq(
                bar_traction_excess, 0.0, distance + 1e-9, (distance, largest), xtol=1e-15
            )
            largest = max(largest, opening)
            traction = cohesive_traction(DUCTILE, opening, largest)
        np.testing.assert_allclose(pair.gap, opening, atol=1e-9 * 0.02)
        np.testing.assert_allclose(pair.force[1], -traction * WIDTH, atol=1e-8)
        np.testing.assert_allclose(pair.law_history[:, 2], largest, atol=1e-9 * 0.02)
        dissipated.append(traction)
    assert dissipated[-1] == 0


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize("gap", [0.01, 0.03], ids=["damaged", "without bond"])
def test_an_initial_gap_has_damaged_the_bond(solver, gap):
    """A force closes the gap, and the bond then pulls with the strength that is left."""
    bar = Bar()
    pair = ContactPair(on_plane(1, 0.0), Plane((0, -gap), (0, 1)), interface_law=DUCTILE)
    supports = bar.make_supports((0, on_plane(1, HEIGHT)), (1, on_plane(1, HEIGHT)))
    problem = bar.contact_problem(pair, supports, solver=solver)
    pressed = problem.step(problem.undeformed, motions=Motion((0, None), force=(0, 3.0)))
    np.testing.assert_allclose(pressed.pairs[0].force[1], 3.0, rtol=1e-9)
    np.testing.assert_allclose(pressed.pairs[0].gap, 0.0, atol=1e-15)
    distance = 0.006
    pulled = problem.step(pressed, motions=Motion((0, gap - distance)))
    opening = brentq(bar_traction_excess, 0.0, distance + 1e-9, (distance, gap), xtol=1e-15)
    traction = cohesive_traction(DUCTILE, opening, gap)
    np.testing.assert_allclose(pulled.pairs[0].gap, opening, rtol=1e-9)
    np.testing.assert_allclose(pulled.pairs[0].force[1], -traction * WIDTH, atol=1e-9)
    assert (traction == 0) == (gap > DUCTILE.final_opening)


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize("distance", [0.0052, 0.006, 0.02])
def test_a_state_beyond_a_snap_back_is_refused(solver, distance):
    """The reason is given, whether the increment ends just behind the snap-back or far beyond."""
    problem = Bar().make_problem(BRITTLE, solver=solver)
    elastic = problem.step(problem.undeformed, motions=Motion((0.0, -0.0048)))
    assert elastic.pairs[0].gap.max() < BRITTLE.elastic_limit
    with pytest.raises(SolutionNotFound, match=r"snap-back"):
        problem.step(elastic, motions=Motion((0.0, -distance)))


def make_rubber_problem(law, **options):
    """Return a rubber block without lateral strain, whose base is held by an interface law."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    u, residual = make_finite_strain_unknown_and_residual(Spaces.petrov_galerkin(mesh))
    space = u.function_space
    conditions = [
        *(prescribe(space, 0, on_plane(0, x), 0.0) for x in (0.0, 1.0)),
        prescribe(space, 1, on_plane(1, 1.0), 0.0),
    ]
    return ContactProblem.of_residual(residual, u, conditions, floor_pair(law), **options)


def rubber_stress(stretch):
    """Return the nominal stress of the rubber at a stretch, without lateral strain."""
    return stretch - 1 / stretch + 1.5 * np.log(stretch) / stretch


def rubber_stress_excess(gap, distance, layer_stiffness):
    """Return the stress of the stretched rubber less that of a layer with the given gap."""
    return rubber_stress(1 + distance - gap) - layer_stiffness * gap


def torn_rubber_stress_excess(opening, distance, law):
    """Return the stress of the stretched rubber less that of a cohesive law at an opening."""
    return rubber_stress(1 + distance - opening) - cohesive_traction(law, opening, opening)


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_an_elastic_layer_holds_rubber_at_large_strains(solver):
    """Layer and rubber are springs in series, in tension and compression."""
    problem = make_rubber_problem(ElasticInterface(2.0, 1.0), solver=solver)
    for distance in (0.5, -0.3):
        state = problem.step(problem.undeformed, motions=Motion((0.0, -distance)))
        gap = brentq(rubber_stress_excess, -0.5, 0.5, (distance, 2.0), xtol=1e-14)
        np.testing.assert_allclose(state.pairs[0].gap, gap, rtol=1e-8)
        np.testing.assert_allclose(state.pairs[0].force[1], -2.0 * gap, rtol=1e-8)


def test_rubber_is_torn_off_its_base():
    """Softening that the rubber can follow is accepted, and a snap-back is refused."""
    law = CohesiveContact(stiffness=20.0, strength=0.5, toughness=0.2)
    problem = make_rubber_problem(law)
    distances = np.linspace(0.1, 0.9, 9)
    for distance, state in zip(
        distances, step_floor_through(problem, [(0.0, -d) for d in distances]), strict=True
    ):
        opening = brentq(
            torn_rubber_stress_excess, 0.0, distance + 1e-9, (distance, law), xtol=1e-14
        )
        np.testing.assert_allclose(state.pairs[0].gap, opening, atol=1e-8)
    brittle = make_rubber_problem(CohesiveContact(stiffness=20.0, strength=0.5, toughness=0.01))
    with pytest.raises(SolutionNotFound, match=r"snap-back"):
        step_floor_through(brittle, [(0.0, -0.15), (0.0, -0.3)])


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_an_elastic_layer_between_two_bodies_adds_its_compliance(cell):
    """Two pulled blocks with a layer between meshes that do not match have uniform stresses."""
    stack = StackedBlocks((3, 4), cell)
    pair = replace(stack.make_pair("upper"), interface_law=ElasticInterface(0.5, 0.1))
    base = on_plane(stack.up, 0.0)
    supports = stack.make_supports(
        (stack.up, base), *((i, on_plane(i, 0.0)) for i in range(stack.up))
    )
    problem = stack.contact_problem(pair, supports)
    tension = 1e-3
    state = problem.step(
        problem.undeformed, stack.traction_load(tension * np.eye(stack.dim)[stack.up])
    )
    np.testing.assert_allclose(state.pairs[0].gap, tension / 0.5, rtol=1e-8)
    exact = -stack.uniaxial_displacement()
    is_upper = compute_upper_nodes(stack)
    exact[is_upper, stack.up] += tension / 0.5
    np.testing.assert_allclose(
        state.displacement.array.reshape(-1, stack.dim), exact, atol=1e-9 * np.abs(exact).max()
    )


def compute_upper_nodes(stack):
    """Return a mask (n,) of the nodes of the upper block."""
    return (stack.x[:, stack.up] > 1 + 1e-9) | stack.side_node_mask("upper")


@pytest.mark.parametrize("law", [DUCTILE, UnilateralContact(0.2, wear_coefficient=1e-3)])
def test_a_saved_state_goes_on_with_its_history(tmp_path, law):
    """A step from a file equals the step from the state, and the file of another law is refused."""
    bar = Bar()
    problem = bar.make_problem(law, -0.002)
    path = [(0.001, 0.002), (0.002, -0.006), (0.0015, -0.005), (0.001, -0.008)]
    states = step_floor_through(problem, path)
    problem.save(states[1], tmp_path / "state.npz")
    again = Bar().make_problem(law, -0.002)
    state = again.load(tmp_path / "state.npz")
    np.testing.assert_array_equal(state.pairs[0].law_history, states[1].pairs[0].law_history)
    for translation, expected in zip(path[2:], states[2:], strict=True):
        state = again.step(state, motions=Motion(translation))
        np.testing.assert_allclose(
            state.displacement.array, expected.displacement.array, rtol=1e-11, atol=1e-15
        )
        np.testing.assert_allclose(
            state.pairs[0].law_history, expected.pairs[0].law_history, rtol=1e-11
        )
    with pytest.raises(ValueError, match=r"another interface law"):
        bar.make_problem(replace(LAYER, normal_stiffness=401.0), -0.002).load(
            tmp_path / "state.npz"
        )


def solve_torn_block(comm):
    """Return the results of a block that is peeled off a cohesive floor, as arrays by name."""
    bar = Bar(comm=comm)
    supports = bar.make_supports((0, on_plane(1, HEIGHT), 0.004), (1, on_plane(1, HEIGHT), 0.002))
    problem = bar.contact_problem(floor_pair(DUCTILE), supports)
    states = step_floor_through(problem, [(0.0, -d) for d in (0.002, 0.004, 0.006)])
    pair = states[-1].pairs[0]
    return {"force": pair.force_vector, "gap": pair.gap, "history": pair.law_history}


def test_two_processes_give_the_same_states():
    """Forces and history do not depend on the number of processes."""
    assert_same_on_processes(solve_torn_block, process_counts=(2,), rel=1e-9)


class WrongLayer:
    """An elastic layer whose derivatives have the wrong sign."""

    n_history = 0

    def initial_history(self, gap, weight):  # noqa: ARG002
        return np.zeros((len(gap), 0))

    def evaluate(self, values):
        response = LAYER.evaluate(values)
        return InterfaceResponse(
            response.force, -response.by_motion, response.by_force, values.history
        )


def test_an_independent_evaluation_rejects_a_wrong_force(monkeypatch):
    """A state whose force is not that of the law at its displacements is not returned."""
    problem = Bar().make_problem(LAYER)
    motion = Motion((0.0, -0.01))
    assert problem.step(problem.undeformed, motions=motion).residuals.law < 1e-9
    measure = stepping.measure_small_strain_kinematics

    def measure_with_error(*args):
        kinematics = measure(*args)
        return replace(kinematics, gap=kinematics.gap * (1 + 1e-7))

    monkeypatch.setattr(stepping, "measure_small_strain_kinematics", measure_with_error)
    with pytest.raises(SolutionNotFound, match=r"violates law by"):
        problem.step(problem.undeformed, motions=motion)


@pytest.mark.parametrize("law", [Tie(), ElasticInterface(50.0, 20.0)], ids=["tie", "layer"])
def test_laws_join_sliding_bodies_at_large_strains(law):
    """Two rubber blocks under uniform strain have the gap of the law, and else behave as one."""
    stack, distance = StackedBlocks((2, 3)), 0.2
    u, residual = make_finite_strain_unknown_and_residual(stack.body.spaces)
    conditions = [
        *(prescribe(u.function_space, 0, on_plane(0, x), 0.0) for x in (0.0, 1.0)),
        prescribe(u.function_space, 1, on_plane(1, 0.0), 0.0),
        prescribe(u.function_space, 1, on_plane(1, 2.0), distance),
    ]
    pair = replace(stack.make_pair("upper"), interface_law=law)
    pair = replace(pair, surface=replace(pair.surface, revolved=False))
    problem = ContactProblem.of_residual(residual, u, conditions, pair)
    (result,) = problem.step(problem.undeformed).pairs
    gap = 0.0
    if isinstance(law, ElasticInterface):
        gap = brentq(stacked_rubber_stress_excess, 0.0, distance, (distance, 50.0), xtol=1e-15)
    np.testing.assert_allclose(result.gap, gap, atol=1e-9)
    stress = rubber_stress(1 + (distance - gap) / 2)
    np.testing.assert_allclose(result.force[1], -stress, rtol=1e-8)


def stacked_rubber_stress_excess(gap, distance, layer_stiffness):
    """Return the stress of two stretched blocks less that of a layer with the given gap."""
    return rubber_stress(1 + (distance - gap) / 2) - layer_stiffness * gap


def test_slip_along_a_support_is_refused():
    """The law would miss the slip of a node that a support holds along its sliding surface."""
    bar = Bar()
    supports = bar.make_supports((0, on_plane(0, 0.0)), (1, on_plane(1, HEIGHT), -0.001))
    problem = bar.contact_problem(
        floor_pair(UnilateralContact(0.0, wear_coefficient=0.1)), supports
    )
    pressed = problem.step(problem.undeformed)
    with pytest.raises(ValueError, match=r"contact nodes at \(0, 0\) slip in a direction"):
        problem.step(pressed, motions=Motion((0.1, 0.0)))


def test_wrong_laws_are_refused_before_any_computation():
    """Errors name the derivative, or the argument that contradicts a law."""
    with pytest.raises(ValueError, match=r"by_motion\[\d, \d\] = .*return the derivatives"):
        Bar().make_problem(WrongLayer())
    bar = Bar(GALERKIN)
    sibling = Sibling.from_space(bar.space)
    for K, match in ((bar.K.copy(), "no record"), (sibling.matrix(bar.K), "symmetrised stiffness")):
        with pytest.raises(ValueError, match=match):
            ContactProblem(K, bar.make_supports(), floor_pair(LAYER), bar.space)
    with pytest.raises(TypeError, match=r"n_history, initial_history and evaluate"):
        floor_pair(lambda gap: gap)
    with pytest.raises(ValueError, match=r"give the friction to the law"):
        ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), 0.3, interface_law=Tie())
    with pytest.raises(ValueError, match=r"toughness of a cohesive law is 0\.0009"):
        CohesiveContact(stiffness=2000.0, strength=2.0, toughness=0.0009)
    with pytest.raises(ValueError, match=r"normal_stiffness is -1\.0"):
        ElasticInterface(-1.0, 1.0)

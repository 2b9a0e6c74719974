"""Interface laws at nodes of several pairs, compared with exact or independent solutions."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from scipy.optimize import fsolve

from pw_elements import Direct, Iterative, Spaces, boundary_measure
from pw_elements.contact import ContactPair, ContactProblem, Motion, NotUnique, Plane
from pw_elements.contact.model import CohesiveContact, ElasticInterface, Tie, UnilateralContact
from pw_elements.meshes import triangles
from tests.contact.cases import (
    GALERKIN,
    PETROV_GALERKIN,
    make_finite_strain_unknown_and_residual,
    on_plane,
)
from tests.contact.test_friction import FOR_DIRECT_AND_ITERATIVE_SOLVER, assert_friction_law
from tests.contact.test_interface_laws import HEIGHT, WIDTH, Bar, floor_pair
from tests.contact.test_law_fields import (
    SOFTENING_TEMPERATURE,
    WarmLayer,
    make_temperature,
    stiffness_at,
)
from tests.contact.test_several_pairs import (
    CornerBlock,
    CornerOfThreeBlocks,
    forces_of_pairs,
    values_at_origin,
)
from tests.parallel import assert_same_on_processes

PRESSURES = np.array([1.0, 2.0, 1.5])
STIFFNESSES = np.array([200.0, 300.0, 500.0])


def with_laws(pairs, laws):
    """Return the pairs with the interface laws of a list, which may contain None."""
    return [replace(pair, interface_law=law) for pair, law in zip(pairs, laws, strict=True)]


def pressure_load(block, pressures=PRESSURES):
    """Return the load of pressures on the sides of the block that face away from the corner."""
    load = block.zero_load
    for axis in range(block.dim):
        traction = -pressures[axis] * np.eye(block.dim)[axis]
        load.axpy(1.0, block.traction_load(traction, on_plane(axis, 1.0)))
    return load


def tributary_areas(pair):
    """Return the areas (m,) of a side of length 1 that belong to its evenly spaced nodes."""
    axis = np.argmax(np.abs(pair.normal[0]))
    tangential = np.delete(pair.position, axis, axis=1)
    n_intervals = len(np.unique(tangential[:, 0].round(9))) - 1
    at_end = np.isclose(tangential, 0) | np.isclose(tangential, 1)
    return np.prod(np.where(at_end, 0.5, 1.0) / n_intervals, axis=1)


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize(
    ("dim", "method"), [(2, PETROV_GALERKIN), (2, GALERKIN), (3, PETROV_GALERKIN)]
)
def test_layers_on_all_walls_of_a_corner_have_uniform_pressures(solver, dim, method):
    """Layers without shear stiffness leave the stress of the block uniform."""
    block = CornerBlock(dim, method=method)
    laws = [ElasticInterface(k, 0.0) for k in STIFFNESSES[:dim]]
    problem = block.contact_problem(with_laws(block.corner_pairs(), laws), solver=solver)
    state = problem.step(problem.undeformed, pressure_load(block))
    for axis, pair in enumerate(state.pairs):
        np.testing.assert_allclose(pair.gap, -PRESSURES[axis] / STIFFNESSES[axis], rtol=1e-9)
        np.testing.assert_allclose(pair.force, PRESSURES[axis] * np.eye(dim)[axis], atol=1e-9)
        if method is PETROV_GALERKIN:
            areas = tributary_areas(pair)
            np.testing.assert_allclose(pair.force_normal, PRESSURES[axis] * areas, rtol=1e-9)
    assert state.residuals.law < 1e-9


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize("dim", [2, 3])
def test_layers_with_shear_stiffness_are_springs_at_the_nodes(solver, dim):
    """A common node has the springs of all its walls, in an assembly that knows no contact."""
    block = CornerBlock(dim, divisions=5 - dim)
    laws = [ElasticInterface(k, 0.3 * k) for k in STIFFNESSES[:dim]]
    problem = block.contact_problem(with_laws(block.corner_pairs(), laws), solver=solver)
    load, motions = pressure_load(block), [Motion(1e-3 * np.eye(dim)[k - 1]) for k in range(dim)]
    state = problem.step(problem.undeformed, load, motions)
    matrix, rhs = block.K[:, :], load.array.copy()
    for pair, law, motion in zip(problem.undeformed.pairs, laws, motions, strict=True):
        areas = tributary_areas(pair)
        for node, n, area in zip(pair.node, pair.normal, areas, strict=True):
            k, t = law.normal_stiffness, law.tangential_stiffness
            spring = area * (t * np.eye(dim) + (k - t) * np.outer(n, n))
            unknowns = dim * node + np.arange(dim)
            matrix[np.ix_(unknowns, unknowns)] += spring
            rhs[unknowns] += spring @ motion.translation
    exact = np.linalg.solve(matrix, rhs)
    np.testing.assert_allclose(
        state.displacement.array, exact, atol=1e-9 * np.abs(exact).max(), rtol=0
    )
    for pair, law, motion in zip(state.pairs, laws, motions, strict=True):
        relative = exact.reshape(-1, dim)[pair.node] - motion.translation
        normal = np.sum(relative * pair.normal, axis=1)
        np.testing.assert_allclose(pair.gap, normal, atol=1e-9 * np.abs(exact).max())
        areas = tributary_areas(pair)
        force = law.normal_stiffness * normal[:, None] * pair.normal
        force += law.tangential_stiffness * (relative - normal[:, None] * pair.normal)
        np.testing.assert_allclose(pair.force_vector, -areas[:, None] * force, atol=1e-8)


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_a_cushion_on_a_hard_floor_bears_its_part_of_the_pressure(solver):
    """A layer on one plane and contact with a lower plane act on the same nodes."""
    bar, thickness = Bar(), 0.001
    layer = floor_pair(ElasticInterface(400.0, 0.0))
    floor = ContactPair(on_plane(1, 0.0), Plane((0, -thickness), (0, 1)))
    supports = bar.make_supports((0, on_plane(1, HEIGHT)))
    problem = bar.contact_problem([layer, floor], supports, solver=solver)
    state = problem.undeformed
    for pressure in (0.2, 1.0, 0.3):
        load = bar.traction_load((0.0, -pressure), on_plane(1, HEIGHT))
        state = problem.step(state, load)
        of_layer = min(pressure, 400.0 * thickness)
        exact = [of_layer * WIDTH, (pressure - of_layer) * WIDTH]
        np.testing.assert_allclose(forces_of_pairs(state)[:, 1], exact, atol=1e-9)
        np.testing.assert_allclose(state.pairs[0].gap, -of_layer / 400.0, rtol=1e-9)


def test_layers_on_one_plane_are_springs_in_parallel():
    bar, pressure = Bar(), 2.0
    pairs = [floor_pair(ElasticInterface(k, 10.0)) for k in (100.0, 300.0)]
    problem = bar.contact_problem(pairs, bar.make_supports((0, on_plane(1, HEIGHT))))
    load = bar.traction_load((0.0, -pressure), on_plane(1, HEIGHT))
    state = problem.step(problem.undeformed, load)
    np.testing.assert_allclose(forces_of_pairs(state)[:, 1], [0.5, 1.5], rtol=1e-9)
    np.testing.assert_allclose(state.pairs[1].gap, -pressure / 400.0, rtol=1e-9)


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize("dim", [2, 3])
def test_a_tie_and_contact_are_the_supports_of_a_corner(solver, dim):
    """Pressed nodes of a tied and of smooth walls are held like nodes of supports."""
    block = CornerBlock(dim)
    pairs = with_laws(block.corner_pairs(), [Tie(), None, None][:dim])
    problem = block.contact_problem(pairs, solver=solver)
    load = pressure_load(block)
    state = problem.step(problem.undeformed, load)
    supports = block.make_supports(
        *((axis, on_plane(0, 0.0)) for axis in range(dim)),
        *((axis, on_plane(axis, 0.0)) for axis in range(1, dim)),
    )
    held = block.contact_problem(
        ContactPair(on_plane(0, 1.0), Plane(2 * np.eye(dim)[0], -np.eye(dim)[0])), supports
    )
    exact = held.step(held.undeformed, load).displacement.array
    np.testing.assert_allclose(
        state.displacement.array, exact, atol=1e-9 * np.abs(exact).max(), rtol=0
    )
    np.testing.assert_allclose(forces_of_pairs(state).sum(axis=0), PRESSURES[:dim], atol=1e-9)
    assert state.pairs[1].force_normal.min() > 0


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_two_ties_of_a_node_share_the_change_of_its_force_equally(solver):
    block = CornerBlock(2)
    problem = block.contact_problem(with_laws(block.corner_pairs(), [Tie(), Tie()]), solver=solver)
    state = problem.undeformed
    for factor in (1.0, -0.5):
        state = problem.step(state, pressure_load(block, factor * PRESSURES))
        (one, slip, _), (other, _, _) = map(values_at_origin, state.pairs)
        np.testing.assert_allclose(one, other, rtol=0.1)
        assert np.abs(slip).max() < 1e-12
        total = forces_of_pairs(state).sum(axis=0)
        np.testing.assert_allclose(total, factor * PRESSURES[:2], atol=1e-9)


def test_laws_that_share_a_normal_force_in_an_undetermined_way_are_refused():
    bar = Bar()
    load = bar.traction_load((0.0, -1.0), on_plane(1, HEIGHT))
    for law in (Tie(), UnilateralContact()):
        pairs = [floor_pair(law), floor_pair(None)]
        problem = bar.contact_problem(pairs, bar.make_supports((0, on_plane(1, HEIGHT))))
        with pytest.raises(NotUnique, match=r"how they share the force is not determined"):
            problem.step(problem.undeformed, load)


class CohesiveWall:
    """A cohesive law on the wall of a corner, and contact with friction on its floor."""

    LAW = CohesiveContact(stiffness=2000.0, strength=1.0, toughness=0.05)

    def __init__(self, comm=MPI.COMM_SELF, **options):
        self.block = CornerBlock(2, comm=comm)
        wall, floor = self.block.corner_pairs()
        pairs = [replace(wall, interface_law=self.LAW), replace(floor, friction=0.2)]
        supports = self.block.make_supports((0, on_plane(0, 1.0)))
        self.problem = self.block.contact_problem(pairs, supports, **options)

    def step_through(self, distances, state=None):
        """Return the states after moving the wall away from the pressed block."""
        states = [state or self.problem.undeformed]
        load = self.block.traction_load((0.0, -2.0), on_plane(1, 1.0))
        for distance in distances:
            states.append(self.problem.step(states[-1], load, [Motion((-distance, 0.0)), None]))
        return states[1:]


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_a_wall_is_torn_off_a_block_that_stands_on_a_floor(solver, tmp_path):
    """Tractions follow the cohesive law; damage is that of the largest opening; files keep it."""
    case, law = CohesiveWall(solver=solver), CohesiveWall.LAW
    distances = (0.0005, 0.005, 0.02, 0.01, 0.06, 0.11)
    states = case.step_through(distances)
    largest = np.zeros(len(states[0].pairs[0].gap))
    for state in states:
        wall, floor = state.pairs
        opening = np.hypot(wall.gap, wall.law_history[:, :2] @ np.array([0.0, 1.0]))
        largest = np.maximum(largest, opening)
        np.testing.assert_allclose(wall.law_history[:, 2], largest, rtol=1e-9)
        d_0, d_f = law.elastic_limit, law.final_opening
        softening = d_0 * (d_f - largest) / (largest * (d_f - d_0))
        sound = np.where(largest <= d_0, 1.0, np.maximum(0.0, softening))
        areas = tributary_areas(wall)
        exact = -areas * sound * law.stiffness * wall.gap
        is_open = wall.gap > 1e-12
        np.testing.assert_allclose(wall.force_normal[is_open], exact[is_open], atol=1e-9)
        assert wall.gap.min() > -1e-12
        assert wall.force_normal[~is_open].min(initial=0.0) > -1e-9
        assert_friction_law(floor, lambda force, mu: mu * force, 0.2)
        assert abs(state.pairs[0].force[1] + floor.force[1] - 2.0) < 1e-9
    assert states[1].pairs[0].force[0] < -0.9 * law.strength
    assert abs(states[-1].pairs[0].force[0]) < 1e-9
    case.problem.save(states[2], tmp_path / "torn.npz")
    again = CohesiveWall(solver=solver)
    resumed = again.step_through(distances[3:], again.problem.load(tmp_path / "torn.npz"))
    for state, expected in zip(resumed, states[3:], strict=True):
        for pair, expected_pair in zip(state.pairs, expected.pairs, strict=True):
            for name in ("force_vector", "gap", "law_history"):
                np.testing.assert_allclose(
                    getattr(pair, name), getattr(expected_pair, name), atol=1e-9
                )


def solve_corners_with_laws(comm):
    """Return results of corners with laws by name, for rigid walls and for bodies."""
    results = {}
    states = {"torn": CohesiveWall(comm).step_through((0.005, 0.02))[-1]}
    block = CornerBlock(2, comm=comm)
    laws = [UnilateralContact(0.3, wear_coefficient=1e-3), ElasticInterface(300.0, 50.0)]
    for solver in (Direct(), Iterative()):
        problem = block.contact_problem(with_laws(block.corner_pairs(), laws), solver=solver)
        pressed = problem.step(problem.undeformed, pressure_load(block))
        name = type(solver).__name__
        states[name] = problem.step(pressed, pressure_load(block), [Motion((0, 1e-3)), None])
        bodies = CornerOfThreeBlocks(comm)
        states[f"bodies {name}"] = press_block_with_layers(bodies, solver)
    for name, state in states.items():
        for number, pair in enumerate(state.pairs):
            for attribute in ("force_vector", "gap", "slip"):
                results[f"{name} {number} {attribute}"] = getattr(pair, attribute)
        results[f"{name} history"] = state.pairs[0].law_history
    return results


def press_block_with_layers(bodies, solver):
    """Return the state of a block that plates press on layers between it and two other bodies."""
    laws = [ElasticInterface(200.0, 0.0), ElasticInterface(300.0, 0.0), None, None]
    pairs = with_laws([*bodies.corner_pairs(), *bodies.plate_pairs()], laws)
    problem = bodies.contact_problem(pairs, bodies.supports, solver=solver)
    plates = [Motion((0, None), force=(0, -3.0)), Motion((None, 0), force=(-2.0, 0))]
    return problem.step(problem.undeformed, motions=[None, None, *plates])


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_layers_between_a_block_and_two_bodies_have_uniform_pressures(solver):
    state = press_block_with_layers(CornerOfThreeBlocks(), solver)
    exact = [(0, 3.0), (2.0, 0), (0, -3.0), (-2.0, 0)]
    np.testing.assert_allclose(forces_of_pairs(state), exact, atol=1e-9)
    np.testing.assert_allclose(state.pairs[0].gap, -3.0 / 200.0, rtol=1e-8)
    np.testing.assert_allclose(state.pairs[1].gap, -2.0 / 300.0, rtol=1e-8)


def test_several_processes_give_the_same_states():
    assert_same_on_processes(solve_corners_with_laws, rel=1e-9)


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_regularised_friction_in_a_groove_approaches_coulombs_law(solver):
    """A nearly rigid block slides along the edge of two planes that press it with known forces."""
    block, mu, distance = CornerBlock(3, divisions=2, E=1e6), 0.3, 0.01
    forces = np.array([1.0, 2.0, 0.0])
    supports = block.make_supports((2, lambda x: x[:2].min(axis=0) > 1e-9))
    load, motions = block.press_into_corner(forces), [Motion((0, 0, distance))] * 2
    for length in (1e-2, 1e-3, 1e-4):
        law = UnilateralContact(mu, regularisation_length=length)
        pairs = with_laws(block.corner_pairs()[:2], [law, law])
        problem = block.contact_problem(pairs, supports, solver=solver)
        pressed = problem.step(problem.undeformed, load)
        state = problem.step(pressed, load, motions)
        ratio = distance / np.hypot(distance, length)
        for axis, pair in enumerate(state.pairs):
            smooth_size = np.sqrt(np.sum(pair.slip**2, axis=1) + length**2)
            friction = -(mu * pair.force_normal / smooth_size)[:, None] * pair.slip
            np.testing.assert_allclose(pair.force_tangential, friction, atol=1e-9)
            np.testing.assert_allclose(pair.force[2], ratio * mu * forces[axis], rtol=1e-4)
        np.testing.assert_allclose(forces_of_pairs(state).sum(axis=0)[:2], forces[:2], atol=1e-8)
    coulomb = block.contact_problem(block.corner_pairs(mu)[:2], supports, solver=solver)
    state = coulomb.step(coulomb.step(coulomb.undeformed, load), load, motions)
    np.testing.assert_allclose(forces_of_pairs(state)[:, 2], mu * forces[:2], rtol=1e-4)


def test_each_pair_of_a_node_has_its_own_path_and_worn_depth():
    """Planes that slide by different distances wear by coefficient times force times path."""
    block = CornerBlock(2)
    laws = [UnilateralContact(0.1, wear_coefficient=k) for k in (1e-4, 3e-4)]
    problem = block.contact_problem(with_laws(block.corner_pairs(), laws))
    load = pressure_load(block)
    states = [problem.step(problem.undeformed, load)]
    for shift in (0.01, 0.02, 0.03):
        motions = [Motion((0, -shift)), Motion((-2 * shift, 0))]
        states.append(problem.step(states[-1], load, motions))
    for k, law in enumerate(laws):
        depth, path = 0.0, 0.0
        for state in states:
            pair = state.pairs[k]
            areas = tributary_areas(pair)
            slip = np.linalg.norm(pair.slip, axis=1)
            closed = pair.force_normal > 0
            path = path + np.where(closed, slip, 0.0)
            depth = depth + law.wear_coefficient * pair.force_normal / areas * slip
            np.testing.assert_allclose(pair.law_history[:, 2], path, rtol=1e-9)
            np.testing.assert_allclose(pair.law_history[:, 3], depth, rtol=1e-9, atol=1e-15)
    paths = [pair.law_history[np.isclose(pair.position, 0).all(axis=1), 2] for pair in state.pairs]
    assert 0.02 < paths[0][0] < 0.04 < paths[1][0] < 0.08


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_rubber_on_layers_in_a_corner_has_uniform_stretches(solver):
    """At large strains, nominal stresses of a pulled block are those of the layers."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    u, residual = make_finite_strain_unknown_and_residual(Spaces.petrov_galerkin(mesh))
    (weights,) = residual.arguments()
    pressures, stiffnesses, pairs = np.array([-0.3, -0.5]), np.array([2.0, 3.0]), []
    x = ufl.SpatialCoordinate(mesh)
    loaded = boundary_measure(mesh, lambda x: np.isclose(x[:2], 1.0).any(axis=0))
    for axis in (0, 1):
        is_loaded = ufl.conditional(ufl.gt(x[axis], 1 - 1e-9), 1.0, 0.0)
        residual += pressures[axis] * is_loaded * weights[axis] * loaded
        law = ElasticInterface(stiffnesses[axis], 0.0)
        plane = Plane((0, 0), np.eye(2)[axis])
        pairs.append(ContactPair(on_plane(axis, 0.0), plane, interface_law=law))
    problem = ContactProblem.of_residual(residual, u, [], pairs, solver=solver)
    state = problem.step(problem.undeformed)

    def excess(stretches):
        J = np.prod(stretches)
        return stretches - 1 / stretches + 1.5 * np.log(J) / stretches + pressures

    stretches = fsolve(excess, [1.1, 1.2], xtol=1e-14)
    gaps = -pressures / stiffnesses
    for pair, gap in zip(state.pairs, gaps, strict=True):
        np.testing.assert_allclose(pair.gap, gap, rtol=1e-8)
    x = u.function_space.tabulate_dof_coordinates()[:, :2]
    exact = gaps + (stretches - 1) * x
    np.testing.assert_allclose(state.displacement.array.reshape(-1, 2), exact, atol=1e-8)


def test_derivatives_by_a_field_are_those_of_each_pair():
    """A common node has the derivatives of both of its layers."""
    block = CornerBlock(2)
    T = make_temperature(block.mesh, lambda x: 100.0 + 50.0 * x[0] - 30.0 * x[1])
    pairs = [
        replace(pair, interface_law=WarmLayer(k), interface_fields={"temperature": T})
        for pair, k in zip(block.corner_pairs(), STIFFNESSES[:2], strict=True)
    ]
    problem = block.contact_problem(pairs)
    state = problem.step(problem.undeformed, pressure_load(block))
    for k, pair in enumerate(state.pairs):
        D = problem.differentiate_forces_by_fields(problem.undeformed, state, k)["temperature"]
        forces = (D * T.x.petsc_vec).array.reshape(-1, 2)
        temperature = 100.0 + pair.position @ np.array([50.0, -30.0])
        # T d/dT of a stiffness k / (1 + T / T_0) is -T / T_0 / (1 + T / T_0) times the stiffness
        factor = -temperature / (SOFTENING_TEMPERATURE + temperature)
        areas = tributary_areas(pair)
        motion = pair.gap[:, None] * pair.normal + 0.5 * pair.slip
        stiffness = stiffness_at(temperature, STIFFNESSES[k])
        exact = np.zeros_like(forces)
        exact[pair.node] = -(areas * factor * stiffness)[:, None] * motion
        np.testing.assert_allclose(forces, exact, atol=1e-9 * np.abs(exact).max())

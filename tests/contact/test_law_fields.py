"""Interface laws that depend on fields, compared with exact and with differenced solutions."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scipy.optimize import brentq

from pw_elements import Reduction, Spaces, assemble_matrix, prescribe, solve
from pw_elements.conduction import interface_conduction
from pw_elements.contact import ContactPair, ContactProblem, Motion, Plane
from pw_elements.contact.model import InterfaceResponse, MatchingNodes, UnilateralContact
from pw_elements.meshes import triangles
from tests.contact.cases import (
    GALERKIN,
    PETROV_GALERKIN,
    ElasticBody,
    make_finite_strain_unknown_and_residual,
    on_plane,
)
from tests.contact.test_friction import FOR_DIRECT_AND_ITERATIVE_SOLVER
from tests.contact.test_interface_laws import HEIGHT, LAYER, Bar, E, rubber_stress
from tests.contact.two_bodies import StackedBlocks
from tests.parallel import assert_same_on_processes

SOFTENING_TEMPERATURE = 200.0
UP_DOWN = Plane((0, 0), (0, 1))


class WarmLayer:
    """An elastic layer with the stiffness k / (1 + T / 200), T the mean of all columns of fields.

    The shear stiffness is half of it. With `falsification` the derivatives by fields are wrong.
    """

    n_history = 0

    def __init__(self, stiffness=400.0, falsification=1.0):
        self.stiffness, self.falsification = stiffness, falsification

    def initial_history(self, gap, weight):  # noqa: ARG002
        return np.zeros((len(gap), 0))

    def evaluate(self, values):
        n_fields, dim = values.fields.shape[1], values.force.shape[1]
        factor = 1 + values.fields.mean(axis=1) / SOFTENING_TEMPERATURE
        unit = self.stiffness * np.array([1.0] + [0.5] * (dim - 1))
        motion = np.column_stack([values.gap, values.slip])
        force = -(values.weight / factor)[:, None] * unit * motion
        by_motion = -(values.weight / factor)[:, None, None] * np.diag(unit)
        by_field = -force / (factor * SOFTENING_TEMPERATURE * n_fields)[:, None]
        return InterfaceResponse(
            force,
            by_motion,
            np.zeros_like(by_motion),
            values.history,
            self.falsification * np.repeat(by_field[:, :, None], n_fields, axis=2),
        )


class OneSidedLayer(WarmLayer):
    """A warm layer that depends on one column of the fields only."""

    def __init__(self, column, stiffness=400.0):
        super().__init__(stiffness)
        self.column = column

    def evaluate(self, values):
        one = values.fields[:, [self.column]]
        response = super().evaluate(replace(values, fields=one))
        by_fields = np.zeros((*response.force.shape, values.fields.shape[1]))
        by_fields[:, :, [self.column]] = response.by_fields
        return replace(response, by_fields=by_fields)


def stiffness_at(temperature, stiffness=400.0):
    return stiffness / (1 + temperature / SOFTENING_TEMPERATURE)


def make_temperature(mesh, expression, degree=2):
    """Return a temperature with values `expression` of positions (3, n)."""
    T = fem.Function(fem.functionspace(mesh, ("P", degree)))
    T.interpolate(expression)
    return T


def warm_floor_pair(T, law=None):
    return ContactPair(
        on_plane(1, 0.0),
        UP_DOWN,
        interface_law=law or WarmLayer(),
        interface_fields={"temperature": T},
    )


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_a_layer_softens_with_a_uniform_temperature(solver):
    """Each increment has the stiffness of the temperature at its start."""
    bar, pressure = Bar(), 3.0
    T = make_temperature(bar.mesh, lambda x: 0 * x[0])
    supports = bar.make_supports((0, on_plane(1, HEIGHT)))
    problem = bar.contact_problem(warm_floor_pair(T), supports, solver=solver)
    load, state = bar.traction_load((0.0, -pressure), on_plane(1, HEIGHT)), problem.undeformed
    for temperature in (0.0, 100.0, 300.0, 50.0):
        T.x.array[:] = temperature
        state = problem.step(state, load)
        gap = -pressure / stiffness_at(temperature)
        np.testing.assert_allclose(state.pairs[0].gap, gap, rtol=1e-9)


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("method", [PETROV_GALERKIN, GALERKIN])
def test_a_loaded_block_turns_on_a_layer_with_a_linear_temperature(solver, degree, method):
    """Under a uniform pressure p the gap -p / k(T) is linear, and the block turns as a whole.

    The exact displacement is uniform compression, a translation and a rotation, without slip.
    """
    bar, pressure = Bar(method), 3.0
    T = make_temperature(bar.mesh, lambda x: 50.0 + 100.0 * x[0], degree)
    problem = bar.contact_problem(warm_floor_pair(T), solver=solver)
    load = bar.traction_load((0.0, -pressure), on_plane(1, HEIGHT))
    state = problem.step(problem.undeformed, load)
    (pair,) = state.pairs
    gap = -pressure / stiffness_at(50.0 + 100.0 * pair.position[:, 0])
    np.testing.assert_allclose(pair.gap, gap, rtol=1e-8)
    np.testing.assert_allclose(pair.force_normal, pressure * bar.weights(), rtol=1e-8)
    x, y = bar.x.T
    turn = pressure / 400.0 * 100.0 / SOFTENING_TEMPERATURE
    at_base = -pressure / stiffness_at(50.0 + 100.0 * x)
    exact = np.column_stack([turn * y, at_base - pressure / E * y])
    np.testing.assert_allclose(
        state.displacement.array.reshape(-1, 2), exact, atol=1e-8 * np.abs(exact).max()
    )


def solve_loaded_body(problem, temperatures, values, load):
    """Return the state after a step with the given values (n,) of a temperature."""
    temperatures.x.array[:] = values
    temperatures.x.scatter_forward()
    return problem.step(problem.undeformed, load)


def make_small_strain_case(name, comm=MPI.COMM_SELF):
    """Return a problem with a warm layer, its temperature, and a load that bends and shears."""
    if name == "rigid":
        body = Bar(comm=comm)
        top, traction = on_plane(1, HEIGHT), (0.4, -3.0)
    else:
        body = StackedBlocks((3, 4), "tetrahedron" if name == "space" else "triangle", comm=comm)
        top, traction = None, (1e-4, -1e-3) if body.dim == 2 else (1e-4, -5e-5, -1e-3)
    T = make_temperature(body.mesh, lambda x: 60 + 80 * x[0] * x[1] + 30 * np.sin(3 * x[0]), 1)
    if name == "rigid":
        pair, supports = warm_floor_pair(T), None
    else:
        pair = replace(
            body.make_pair("upper"),
            interface_law=WarmLayer(stiffness=0.5),
            interface_fields={"temperature": T},
        )
        supports = body.make_supports(*((i, on_plane(body.up, 0.0)) for i in range(body.dim)))
    load = body.traction_load(traction, top)
    return body.contact_problem(pair, supports), T, load


@pytest.mark.parametrize("name", ["rigid", "plane", "space"])
def test_force_derivatives_act_like_loads_on_whole_states(name):
    """Two states with other temperatures differ as if the forces' derivatives were a load.

    Central differences of solved states are compared, so that errors are of third order.
    """
    problem, T, load = make_small_strain_case(name)
    start = T.x.array.copy()
    x = T.function_space.tabulate_dof_coordinates()
    direction = np.cos(2 * x[:, 0] + x[:, 1]) + 0.5
    state = solve_loaded_body(problem, T, start, load)
    (D,) = problem.differentiate_forces_by_fields(problem.undeformed, state).values()
    change = D.createVecRight()
    change.setArray(direction)
    additional = D * change
    assert additional.norm() > 1e-5 * load.norm()
    hot, cold = (solve_loaded_body(problem, T, start + h * direction, load) for h in (0.1, -0.1))
    more, less = (solve_loaded_body(problem, T, start, load + h * additional) for h in (0.1, -0.1))
    by_field = (hot.displacement - cold.displacement).array
    by_load = (more.displacement - less.displacement).array
    np.testing.assert_allclose(by_field, by_load, atol=2e-5 * np.abs(by_load).max())
    assert np.abs(by_load).max() > 1e-6 * np.abs(state.displacement.array).max()


@pytest.mark.parametrize("column", [0, 1])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_each_side_of_two_bodies_has_its_own_temperature(cell, column):
    """The layer takes the temperature of the side that its law names, on meshes that differ."""
    blocks = StackedBlocks((2, 3), cell, nu=0.0)
    sides = np.array([20.0, 180.0])  # lower and upper block
    T = make_temperature(blocks.mesh, lambda x: 0 * x[0])
    cells = T.function_space.dofmap.list
    middle = T.function_space.tabulate_dof_coordinates()[cells].mean(axis=1)[:, blocks.up]
    for side, temperature in enumerate(sides):
        T.x.array[cells[(middle > 1) == bool(side)]] = temperature
    pair = replace(
        blocks.make_pair("upper"),
        interface_law=OneSidedLayer(column, stiffness=0.5),
        interface_fields={"temperature": T},
    )
    supports = blocks.make_supports(*((i, on_plane(i, 0.0)) for i in range(blocks.dim)))
    problem = blocks.contact_problem(pair, supports)
    load = blocks.traction_load(-1e-3 * np.eye(blocks.dim)[blocks.up])
    (result,) = problem.step(problem.undeformed, load).pairs
    k = stiffness_at(sides[1 - column], 0.5)
    np.testing.assert_allclose(result.gap, -1e-3 / k, rtol=1e-8)


def stretched_stress_excess(gap, distance, stiffness, height):
    return rubber_stress(1 + (distance - gap) / height) - stiffness * gap


@FOR_DIRECT_AND_ITERATIVE_SOLVER
def test_a_layer_softens_under_rubber_at_large_strains(solver):
    """Rubber and layer are springs in series at each temperature."""
    block = ElasticBody(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2)))
    u, residual = make_finite_strain_unknown_and_residual(block.body.spaces)
    conditions = [
        *(prescribe(u.function_space, 0, on_plane(0, x), 0.0) for x in (0.0, 1.0)),
        prescribe(u.function_space, 1, on_plane(1, 1.0), 0.0),
    ]
    T, law = make_temperature(block.mesh, lambda x: 0 * x[0]), WarmLayer(2.0)
    problem = ContactProblem.of_residual(
        residual, u, conditions, warm_floor_pair(T, law), solver=solver
    )
    state = problem.undeformed
    for temperature, distance in ((0.0, 0.2), (150.0, 0.2), (400.0, 0.3)):
        T.x.array[:] = temperature
        state = problem.step(state, motions=Motion((0.0, -distance)))
        k = stiffness_at(temperature, 2.0)
        gap = brentq(stretched_stress_excess, 0.0, distance, (distance, k, 1.0), xtol=1e-15)
        np.testing.assert_allclose(state.pairs[0].gap, gap, rtol=1e-8)


def test_layers_soften_between_sliding_bodies_at_large_strains():
    """Two rubber blocks pull at a layer with the mean temperature of both sides.

    The derivative of the forces is the one of the exact layer: k'(T) g times area for the sum.
    """
    stack, distance = StackedBlocks((2, 3)), 0.2
    u, residual = make_finite_strain_unknown_and_residual(stack.body.spaces)
    conditions = [
        *(prescribe(u.function_space, 0, on_plane(0, x), 0.0) for x in (0.0, 1.0)),
        prescribe(u.function_space, 1, on_plane(1, 0.0), 0.0),
        prescribe(u.function_space, 1, on_plane(1, 2.0), distance),
    ]
    T = make_temperature(stack.mesh, lambda x: 0 * x[0] + 120.0)
    pair = replace(
        stack.make_pair("upper"),
        interface_law=WarmLayer(5.0),
        interface_fields={"temperature": T},
    )
    pair = replace(pair, surface=replace(pair.surface, revolved=False))
    problem = ContactProblem.of_residual(residual, u, conditions, pair)
    state = problem.step(problem.undeformed)
    (result,) = state.pairs
    k = stiffness_at(120.0, 5.0)
    gap = brentq(stretched_stress_excess, 0.0, distance, (distance, k, 2.0), xtol=1e-15)
    np.testing.assert_allclose(result.gap, gap, rtol=1e-8)
    (D,) = problem.differentiate_forces_by_fields(problem.undeformed, state).values()
    change = D.createVecRight()
    change.set(1.0)
    forces = (D * change).array.reshape(-1, 2)
    # a softer layer pulls less at the upper block, and less at the lower one
    softening = k / (SOFTENING_TEMPERATURE + 120.0) * gap
    assert forces[result.node, 1].sum() == pytest.approx(softening, rel=1e-8)
    assert forces[result.opposite_node, 1].sum() == pytest.approx(-softening, rel=1e-8)


def solve_coupled_bars(comm, count=60):
    """Return gap, temperatures and flow of two bars that press and heat a layer, by turns."""
    blocks, conductivity = StackedBlocks((2, 3), nu=0.0, comm=comm), 2.0
    heat = Spaces.petrov_galerkin(blocks.mesh, 0)
    T = fem.Function(heat.trial)
    pair = replace(
        blocks.make_pair("upper"),
        interface_law=WarmLayer(0.5),
        interface_fields={"temperature": T},
    )
    supports = blocks.fixed_base_moved_top_supports((0.0, -0.01), ((0, lambda x: x[0] > -1),))
    problem = blocks.contact_problem(pair, supports)
    trial, weight = ufl.TrialFunction(heat.trial), ufl.TestFunction(heat.test)
    bodies = assemble_matrix(conductivity * ufl.inner(ufl.grad(trial), ufl.grad(weight)) * ufl.dx)
    held = Reduction.dirichlet(
        heat.trial,
        [
            prescribe(heat.trial, 0, on_plane(1, 0.0), 20.0),
            prescribe(heat.trial, 0, on_plane(1, 2.0), 220.0),
        ],
    )
    for _ in range(count):
        state = problem.step(problem.undeformed)
        exchange, _ = interface_conduction(
            state, blocks.body, heat, lambda pressure, _: 1e3 * pressure
        )
        solution = solve(bodies + exchange, exchange.createVecLeft(), held)
        change = np.abs(solution.array - T.x.array[: solution.getLocalSize()]).max(initial=0.0)
        T.x.array[: solution.getLocalSize()] = solution.array
        T.x.scatter_forward()
        if comm.allreduce(change, MPI.MAX) < 1e-10:
            break
    flow = (exchange * solution).array.reshape(-1)
    return {
        "gap": state.pairs[0].gap,
        "heat": np.array([comm.allreduce(np.abs(flow).sum(), MPI.SUM) / 2]),
    }


def test_staggered_bars_have_the_exact_coupled_state():
    """The conductance depends on the pressure, and the layer's stiffness on the temperature.

    With bars of modulus 1 and length 1 on both sides, the pressure p follows from one equation.
    """

    def interface_temperatures(p):
        flux = 200.0 / (1 / 2.0 + 1 / (1e3 * p) + 1 / 2.0)
        return 20.0 + flux / 2.0, 220.0 - flux / 2.0, flux

    def excess(p):
        k = stiffness_at(np.mean(interface_temperatures(p)[:2]), 0.5)
        return p * (2.0 + 1 / k) - 0.01

    p = brentq(excess, 1e-6, 1.0, xtol=1e-16)
    result = solve_coupled_bars(MPI.COMM_SELF)
    np.testing.assert_allclose(result["gap"], -p * (0.01 / p - 2.0), rtol=1e-8)
    assert result["heat"] == pytest.approx(interface_temperatures(p)[2], rel=1e-8)


def solve_derivatives_in_parallel(comm):
    """Return sums of derivatives and the forces of two bodies with a varying temperature."""
    problem, T, load = make_small_strain_case("plane", comm)
    state = problem.step(problem.undeformed, load)
    (D,) = problem.differentiate_forces_by_fields(problem.undeformed, state).values()
    change, smooth = D.createVecRight(), D.createVecLeft()
    n = change.getLocalSize()
    change.setArray(np.cos(T.function_space.tabulate_dof_coordinates()[:n] @ [1.0, 2.0, 0.0]))
    x = problem.undeformed.displacement.getLocalSize() // 2
    smooth.setArray(np.tile([1.0, 2.0], x))
    forces = D * change
    return {
        "force": state.pairs[0].force_vector,
        "derivative": np.array([forces.norm(), forces.dot(forces)]),
        "sum": np.array([abs(forces.dot(smooth)) < 1e-12 * forces.norm()], dtype=float),
    }


@pytest.mark.parametrize("function", [solve_coupled_bars, solve_derivatives_in_parallel])
def test_two_processes_give_the_same_states(function):
    assert_same_on_processes(function, process_counts=(2,), rel=1e-8)


def test_a_state_notices_that_its_field_has_changed():
    """No derivative is returned for a state at a temperature that is no longer present."""
    problem, T, load = make_small_strain_case("rigid")
    state = problem.step(problem.undeformed, load)
    matrix = problem.differentiate_forces_by_fields(problem.undeformed, state)["temperature"]
    T.x.array[:] *= 1.001
    with pytest.raises(ValueError, match=r"fields have changed since the state was computed"):
        problem.differentiate_forces_by_fields(problem.undeformed, state)
    T.x.array[:] /= 1.001
    again = problem.differentiate_forces_by_fields(problem.undeformed, state)["temperature"]
    assert (matrix - again).norm() < 1e-10 * matrix.norm()


def test_matching_nodes_have_the_linear_temperatures_of_both_sides():
    """Under a uniform pressure, the gap follows the mean of two linear temperatures."""
    blocks, pressure = StackedBlocks((3, 3), nu=0.0), 1e-3
    T = make_temperature(blocks.mesh, lambda x: 50 + 100 * x[0], 1)
    cells = T.function_space.dofmap.list
    is_upper = T.function_space.tabulate_dof_coordinates()[cells].mean(axis=1)[:, 1] > 1
    T.x.array[np.unique(cells[is_upper])] *= 1.5
    pair = ContactPair(
        blocks.side_node_mask("upper"),
        MatchingNodes(blocks.side_node_mask("lower"), Plane((0, 1), (0, 1))),
        interface_law=WarmLayer(0.5),
        interface_fields={"temperature": T},
    )
    load = blocks.traction_load((0.0, -pressure))
    supports = blocks.make_supports(*((i, on_plane(1, 0.0)) for i in range(2)))
    (state,) = blocks.solve_contact(pair, supports, load)
    temperature = 1.25 * (50 + 100 * state.pairs[0].position[:, 0])
    gap = -pressure / stiffness_at(temperature, 0.5)
    np.testing.assert_allclose(state.pairs[0].gap, gap, rtol=1e-8)


def test_wrong_fields_are_refused_before_any_computation():
    """Errors name the field, or the derivative that contradicts differences."""
    bar = Bar()
    T = make_temperature(bar.mesh, lambda x: 300 + x[0])
    with pytest.raises(ValueError, match=r"gives by_fields\[\d, 0\] = "):
        bar.contact_problem(warm_floor_pair(T, WarmLayer(falsification=1.01)))
    with pytest.raises(ValueError, match=r"returns no by_fields"):
        bar.contact_problem(warm_floor_pair(T, LAYER))
    other = make_temperature(Bar().mesh, lambda x: x[0])
    with pytest.raises(ValueError, match=r"'temperature' is on another mesh"):
        bar.contact_problem(warm_floor_pair(other))
    with pytest.raises(ValueError, match=r"no interface law"):
        ContactPair(on_plane(1, 0.0), UP_DOWN, interface_fields={"temperature": T})
    with pytest.raises(ValueError, match=r"values of shape \(2,\)"):
        warm_floor_pair(fem.Function(bar.space))
    with pytest.raises(ValueError, match=r"type complex128"):
        warm_floor_pair(fem.Function(T.function_space, dtype=np.complex128))
    with pytest.raises(ValueError, match=r"continuous Lagrange space"):
        warm_floor_pair(fem.Function(fem.functionspace(bar.mesh, ("DG", 0))))
    with pytest.raises(TypeError, match=r"interface field 'temperature'"):
        warm_floor_pair(20.0)
    problem = bar.make_problem(LAYER, -0.001)
    state = problem.step(problem.undeformed)
    with pytest.raises(ValueError, match=r"contact pair 0 has no interface_fields"):
        problem.differentiate_forces_by_fields(problem.undeformed, state)


class WarmContact:
    """Unilateral contact, as an implicit law that also has a field."""

    n_history = UnilateralContact(0.0).n_history
    initial_history = UnilateralContact(0.0).initial_history

    def evaluate(self, values):
        response = UnilateralContact(0.0).evaluate(values)
        return replace(response, by_fields=np.zeros((*values.force.shape, 1)))


def test_closed_contact_has_no_derivative_at_constant_displacements():
    bar = Bar()
    T = make_temperature(bar.mesh, lambda x: 0 * x[0])
    top = on_plane(1, HEIGHT)
    supports = bar.make_supports((0, top), (1, top, -0.001))
    problem = bar.contact_problem(warm_floor_pair(T, WarmContact()), supports)
    state = problem.step(problem.undeformed)
    with pytest.raises(ValueError, match=r"no force as a function of gap and slip"):
        problem.differentiate_forces_by_fields(problem.undeformed, state)

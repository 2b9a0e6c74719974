"""Materials with memory: history functions at quadrature points, updates, restarts, line search."""

import re
from unittest.mock import patch

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box
from scipy.optimize import brentq

from pw_elements import (
    Direct,
    Iterative,
    Spaces,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    history_space,
    prescribe,
)
from pw_elements.contact import ContactPair, DeformableSurface, Motion, Plane, Sphere
from pw_elements.contact.iteration import line_search
from pw_elements.meshes import quadrilaterals, triangles
from pw_elements.spaces import cell_measure
from tests.contact import plastic
from tests.contact.cases import on_plane
from tests.contact.plastic import (
    INDENTER_MOTIONS,
    PlasticBody,
    make_plastic_block_under_circle,
)
from tests.contact.test_large import RubberUnderCircle, collect_first_pair_fields, step_through
from tests.contact.two_bodies import join_meshes
from tests.parallel import assert_same_values, run_on_processes

BOX = [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)]
MESH_MAKERS_BY_CELL = {
    "triangle": lambda: triangles(MPI.COMM_SELF, (0, 0), (1, 1), (2, 2)),
    "quadrilateral": lambda: quadrilaterals(MPI.COMM_SELF, (0, 0), (1, 1), (2, 2)),
    "tetrahedron": lambda: create_box(MPI.COMM_SELF, BOX, (1, 1, 1), CellType.tetrahedron),
    "hexahedron": lambda: create_box(MPI.COMM_SELF, BOX, (1, 1, 1), CellType.hexahedron),
}


@pytest.mark.parametrize("degree", [2, 5])
@pytest.mark.parametrize("kind", ["petrov_galerkin", "galerkin", "hybrid"])
@pytest.mark.parametrize("cell", MESH_MAKERS_BY_CELL)
def test_history_functions_have_their_values_at_the_points_of_the_cell_measure(cell, kind, degree):
    """A form of values at history points equals the form of the expression itself.

    The integrand is no polynomial, so that other points would give other integrals.
    """
    mesh = MESH_MAKERS_BY_CELL[cell]()
    spaces = getattr(Spaces, kind)(mesh)
    x = ufl.SpatialCoordinate(mesh)
    expression = ufl.exp(ufl.sin(5 * x[0]) + x[1] ** 2) * ufl.as_vector(
        [1, x[mesh.geometry.dim - 1]]
    )
    space, dx = history_space(spaces, (2,), degree)
    values = fem.Function(space)
    points = space.element.interpolation_points
    points = points() if callable(points) else points
    values.interpolate(fem.Expression(expression, points))
    displacements = spaces.displacements.test
    weight = ufl.dot(ufl.TestFunction(displacements), ufl.as_vector([1.0] * len(x)))
    reference = assemble_vector(
        ufl.inner(expression, expression) * weight * cell_measure(displacements, degree)
    )
    difference = assemble_vector(ufl.inner(values, values) * weight * dx)
    difference.axpy(-1, reference)
    assert difference.norm() < 1e-14 * reference.norm()


def test_new_values_are_evaluated_before_any_function_changes():
    """Two functions whose new values are each other's values are swapped."""
    rubber = RubberUnderCircle()
    space, _ = history_space(Spaces.petrov_galerkin(rubber.space.mesh))
    first, second = fem.Function(space), fem.Function(space)
    first.x.array[:], second.x.array[:] = 1.0, 2.0
    problem = rubber.problem_with(options={"history": {first: second, second: first}})
    states = step_through(problem, [Motion((0.0, -0.05)), Motion((0.0, -0.1))])
    values = [[np.unique(f).tolist() for f in state.history] for state in states]
    assert values == [[[2.0], [1.0]], [[1.0], [2.0]]]


def make_invalid_histories():
    """Return options of a problem that has no valid history, and a part of the error message."""
    rubber = RubberUnderCircle()
    mesh = rubber.space.mesh
    number = fem.Function(history_space(Spaces.petrov_galerkin(mesh))[0])
    shared = fem.Function(fem.functionspace(mesh, ("Lagrange", 1)))
    number_nan = fem.Function(number.function_space)
    number_nan.x.array[:] = np.nan
    histories = {
        "shape": ({number: ufl.grad(rubber.u)}, "has the shape (2, 2), and the function has ()"),
        "shared": ({shared: ufl.div(rubber.u)}, "create its space by history_space(spaces)"),
        "number": ({number: 1.0}, "give a UFL expression"),
        "key": ({ufl.div(rubber.u): number}, "it has to be a Function"),
        "nan": ({number_nan: ufl.div(rubber.u)}, "not finite"),
        "test function": (
            {number: ufl.div(ufl.TestFunction(rubber.space))},
            "has a test or trial function",
        ),
        "normal": (
            {number: ufl.FacetNormal(mesh)[0]},
            "a new value of the history cannot be compiled",
        ),
        "update": ({number: ufl.div(rubber.u)}, "there is an update as well"),
    }
    return rubber, histories


@pytest.mark.parametrize(
    "kind", ["shape", "shared", "number", "key", "nan", "test function", "normal", "update"]
)
def test_a_history_without_valid_new_values_is_refused(kind):
    rubber, histories = make_invalid_histories()
    history, message = histories[kind]
    options = {"history": history} | ({"update": lambda: None} if kind == "update" else {})
    with pytest.raises((TypeError, ValueError), match=re.escape(message)):
        rubber.problem_with(options=options)


def test_new_values_that_are_not_finite_are_refused():
    rubber = RubberUnderCircle()
    number = fem.Function(history_space(Spaces.petrov_galerkin(rubber.space.mesh))[0])
    problem = rubber.problem_with(options={"history": {number: 1 / number}})
    with pytest.raises(ValueError, match="function 0 to values that are not finite"):
        rubber.press(problem)


# One material point


def integrate_plastic_material(deformation_gradients):
    """Return the Piola stresses (3, 3) and equivalent plastic strains along a strain path.

    The elastic left Cauchy-Green tensor is carried along by the relative deformation gradient. The
    consistency condition is solved by a bracketing method.
    """
    mu, identity = plastic.SHEAR_MODULUS, np.eye(3)
    elastic, strain, previous, results = identity, 0.0, identity, []
    for F in deformation_gradients:
        relative = F @ np.linalg.inv(previous)
        relative = relative / np.cbrt(np.linalg.det(relative))
        trial = relative @ elastic @ relative.T
        mean = np.trace(trial) / 3
        trial_stress = mu * (trial - mean * identity)
        norm = np.linalg.norm(trial_stress)

        def excess(flow, norm=norm, mean=mean, strain=strain):
            limit = plastic.YIELD_STRESS + plastic.HARDENING_MODULUS * (
                strain + np.sqrt(2 / 3) * flow
            )
            return norm - 2 * mu * mean * flow - np.sqrt(2 / 3) * limit

        flow = brentq(excess, 0, norm / mu, xtol=1e-17) if excess(0.0) > 0 else 0.0
        stress = trial_stress - 2 * mu * mean * flow * trial_stress / norm
        strain += np.sqrt(2 / 3) * flow
        elastic, previous = stress / mu + mean * identity, F
        J = np.linalg.det(F)
        kirchhoff = plastic.BULK_MODULUS / 2 * (J**2 - 1) * identity + stress
        results.append((kirchhoff @ np.linalg.inv(F).T, strain))
    return results


# Displacements (shears and stretch) of the upper side: loading, reversal and unloading
UPPER_SIDE_DISPLACEMENTS = [
    (0.0, 0.0, -0.002),
    (0.01, 0.0, -0.02),
    (0.1, 0.03, -0.05),
    (0.1, -0.05, -0.04),
    (0.0985, -0.0492, -0.0403),
    (-0.1, 0.0, -0.03),
]


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_uniformly_deformed_blocks_have_the_stress_of_one_integrated_material_point(cell):
    """A block below a sticking plate has uniform stresses if all other faces follow the plate."""
    body = PlasticBody(MESH_MAKERS_BY_CELL[cell](), quadrature_degree=2)
    space, dim = body.spaces.trial, body.mesh.geometry.dim
    x, up = space.tabulate_dof_coordinates()[:, :dim], np.eye(dim)[-1]
    is_on_side = (np.isclose(x, 0) | np.isclose(x, 1))[:, : dim - 1].any(axis=1)
    is_held = is_on_side | np.isclose(x[:, -1], 0)
    prescribed = fem.Function(space)
    supports = [fem.dirichletbc(prescribed, np.flatnonzero(is_held).astype(np.int32))]

    def is_inside_upper_side(x):
        is_inside = (x[: dim - 1] > 0.01) & (x[: dim - 1] < 0.99)
        return np.isclose(x[dim - 1], 1) & is_inside.all(axis=0)

    plate = ContactPair(is_inside_upper_side, Plane(up, -up), friction=5.0)
    problem = body.make_problem(supports, plate)
    ends = [np.delete(d, 1) if dim == 2 else np.array(d) for d in UPPER_SIDE_DISPLACEMENTS]
    deformation_gradients = []
    for end in ends:
        F = np.eye(3)
        F[:dim, dim - 1] += end
        deformation_gradients.append(F)
    results = integrate_plastic_material(deformation_gradients)
    state, start = problem.undeformed, np.zeros(dim)
    for end, (stress, strain) in zip(ends, results, strict=True):

        def deform(fraction, start=start, end=end):
            displacement = (1 - fraction) * start + fraction * end
            prescribed.x.array[:] = np.outer(x[:, -1], displacement).ravel()

        state, start = problem.step(state, deform, Motion(end.tolist())), end
        assert not state.substates
        assert np.abs(body.material.plastic_strain.x.array - strain).max() < 1e-10 * results[-1][1]
        forces = assemble_vector(body.residual).array_r.reshape(-1, dim)
        volume_integral = forces.T @ x  # of the Piola stress over the block of volume one
        error = np.abs(volume_integral - stress[:dim, :dim]).max()
        assert error < 1e-10 * np.abs(stress).max()
    strains = [strain for _, strain in results]
    assert strains[0] == 0.0
    assert strains[3] == strains[4] > 0.05
    assert strains[5] > strains[4]


# Newton's method


def test_the_tangent_is_the_derivative_of_the_residual_in_plastic_flow():
    body, problem = make_plastic_block_under_circle()
    start = step_through(problem, INDENTER_MOTIONS[:1])[0]
    problem.step(start, motions=INDENTER_MOTIONS[1])
    for function, values in zip(body.material.history, start.history, strict=True):
        function.x.array[:] = values
    u = body.u.x.array.copy()
    direction = np.cos(np.arange(1.0, len(u) + 1))
    tangent = assemble_matrix(ufl.derivative(body.residual, body.u))
    step, residuals = 1e-9, []
    for sign in (1, -1):
        body.u.x.array[:] = u + sign * step * direction
        residuals.append(assemble_vector(body.residual).array_r.copy())
    vector = tangent.createVecRight()
    vector.array[:] = direction
    product = (tangent * vector).array_r
    difference = (residuals[0] - residuals[1]) / (2 * step)
    assert np.abs(difference - product).max() < 1e-5 * np.abs(product).max()


def test_the_line_search_saves_linear_systems_and_substeps():
    """Without shortened steps, the increment in which the tool is pushed sideways is cut."""
    counts = []
    for max_halvings in (line_search._MAX_HALVINGS_BY_MONOTONICITY_TEST, 0):
        with patch.object(line_search, "_MAX_HALVINGS_BY_MONOTONICITY_TEST", max_halvings):
            _, problem = make_plastic_block_under_circle()
            states = step_through(problem, INDENTER_MOTIONS)
        counts.append([(state.iterations, len(state.substates)) for state in states])
    with_search, without = counts
    assert all(iterations <= 10 and not substeps for iterations, substeps in with_search)
    assert without[-1][1] > 0
    assert without[-1][0] > 3 * with_search[-1][0]


# Increments and states


def test_substeps_of_a_cut_increment_count_as_increments():
    """A history variable that holds the time at the start of a step tells the substeps' lengths."""

    def solve(ends, max_iterations):
        body, block_problem = make_plastic_block_under_circle()
        time = fem.Constant(body.mesh, 0.0)
        space, _ = history_space(body.spaces)
        start_time, sum_of_squares = fem.Function(space), fem.Function(space)
        problem = body.make_problem(
            [prescribe(body.spaces.trial, k, on_plane(1, -1.0)) for k in range(2)],
            block_problem.pairs[0],
            history=body.material.history
            | {start_time: time, sum_of_squares: sum_of_squares + (time - start_time) ** 2},
            max_iterations=max_iterations,
        )
        state, start = problem.undeformed, 0.0
        for end in ends:

            def set_time(fraction, start=start, end=end):
                time.value = (1 - fraction) * start + fraction * end

            state, start = problem.step(state, set_time, Motion((0.0, -0.05 * end))), end
        return state

    cut = solve([1.0], 5)
    ends = [fraction for fraction, _ in cut.substates] + [1.0]
    assert len(ends) > 2
    lengths = np.diff([0.0, *ends])
    assert np.abs(cut.history[2] - 1.0).max() < 1e-15
    assert np.abs(cut.history[3] - np.sum(lengths**2)).max() < 1e-14
    uncut = solve(ends, 25)
    assert not uncut.substates
    for values, expected in zip(cut.history, uncut.history, strict=True):
        assert np.abs(values - expected).max() < 1e-9 * np.abs(expected).max()


def collect_fields_of_whole_and_resumed_histories(comm, folder, other_folder):
    """Return fields at the end of a plastic history, solved as a whole and resumed from a file.

    Args:
        comm: communicator of the block.
        folder: folder to which the state before the last increment is written.
        other_folder: folder with the file of another number of processes, or None.
    """
    body, problem = make_plastic_block_under_circle(comm)
    *_, previous, end = step_through(problem, INDENTER_MOTIONS)

    def collect(name, state, material):
        (pair,) = state.pairs
        fields = collect_first_pair_fields({name: state})
        fields[f"{name} force"] = pair.force
        metric, strain = material.inverse_plastic_metric, material.plastic_strain
        for k, integrand in enumerate((strain, ufl.tr(metric) - 3, metric[0, 1] ** 2)):
            fields[f"{name} integral {k}"] = assemble_scalar(integrand * material.dx)
        return {key: np.nan_to_num(value, posinf=-1.0) for key, value in fields.items()}

    fields = collect("whole", end, body.material)
    problem.save(previous, folder / "plastic.npz")
    for name, path in (("resumed", folder), ("other", other_folder or folder)):
        other_body, other_problem = make_plastic_block_under_circle(comm)
        loaded = other_problem.load(path / "plastic.npz")
        (state,) = step_through(other_problem, INDENTER_MOTIONS[-1:], loaded)
        fields |= collect(name, state, other_body.material)
    return fields


def test_plastic_histories_are_resumed_on_any_number_of_processes(tmp_path, request):
    folders = [tmp_path / str(n) for n in range(3)]
    for folder in folders:
        folder.mkdir()
    serial = collect_fields_of_whole_and_resumed_histories(MPI.COMM_SELF, folders[0], None)
    for name, values in serial.items():
        whole = serial[re.sub("resumed|other", "whole", name)]
        assert np.abs(values - whole).max() <= 1e-12 * max(np.abs(whole).max(), 1e-3), name
    assert serial["whole integral 0"] > 1e-3
    for n_processes in (2, 3) if request.config.getoption("--nightly") else (3,):
        for rank, parallel in enumerate(
            run_on_processes(
                n_processes,
                collect_fields_of_whole_and_resumed_histories,
                folders[n_processes - 1],
                folders[0],
            )
        ):
            assert_same_values(serial, parallel, 1e-9, f"process {rank} of {n_processes}")


# Solvers and bodies


def test_iterative_and_direct_solvers_find_the_same_plastic_state():
    forces, strains = [], []
    for solver in (Direct(), Iterative()):
        mesh = create_box(MPI.COMM_SELF, [(-1, -1, -1), (1, 1, 0)], (3, 3, 2), CellType.tetrahedron)
        body = PlasticBody(mesh, quadrature_degree=2)
        base = [prescribe(body.spaces.trial, k, on_plane(2, -1.0)) for k in range(3)]
        ball = ContactPair(on_plane(2, 0.0), Sphere((0.0, 0.0, 1.0), 1.0), friction=0.3)
        problem = body.make_problem(base, ball, solver=solver)
        motions = [Motion((0.0, 0.0, -0.02)), Motion((0.01, 0.0, -0.03))]
        state = step_through(problem, motions)[-1]
        forces.append(state.pairs[0].force_vector)
        strains.append(body.material.plastic_strain.x.array.copy())
    assert strains[0].max() > 0.005
    for direct, iterative in (forces, strains):
        assert np.abs(direct - iterative).max() < 1e-9 * np.abs(direct).max()


def test_two_plastic_blocks_press_and_push_each_other():
    """Both bodies yield; the forces of both sides balance, and the plastic strains remain."""
    lower = triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (8, 4))
    upper = triangles(MPI.COMM_SELF, (-0.5, 0.0), (0.5, 1.0), (6, 5))
    upper.geometry.x[:, 1] += 0.001
    body = PlasticBody(join_meshes(lower, upper))
    pushed = [fem.Constant(body.mesh, 0.0) for _ in range(2)]
    space = body.spaces.trial
    supports = [prescribe(space, k, on_plane(1, -1.0)) for k in range(2)]
    supports += [prescribe(space, k, on_plane(1, 1.001), pushed[k]) for k in range(2)]
    lower_side = DeformableSurface(on_plane(1, 0.0), revolved=False)
    problem = body.make_problem(supports, ContactPair(on_plane(1, 0.001), lower_side, friction=0.3))
    states = [problem.undeformed]
    for start, end in (
        ((0, 0), (0, -0.02)),
        ((0, -0.02), (0.01, -0.03)),
        ((0.01, -0.03), (0, 0.01)),
    ):

        def move(fraction, start=start, end=end):
            for component in range(2):
                pushed[component].value = (1 - fraction) * start[component] + fraction * end[
                    component
                ]

        states.append(problem.step(states[-1], move))
    _, pressed, slid, unloaded = states
    for state in (pressed, slid):
        (pair,) = state.pairs
        assert pair.force[1] > 0.5
        assert np.allclose(pair.force, -pair.opposite_force.sum(axis=0), rtol=1e-9)
    assert np.abs(unloaded.pairs[0].force_vector).max() < 1e-12
    strains, y = unloaded.history[1], ufl.SpatialCoordinate(body.mesh)[1]
    assert np.array_equal(strains >= slid.history[1], np.ones(len(strains), dtype=bool))
    for is_in_body in (ufl.lt(y, 0.0005), ufl.gt(y, 0.0005)):
        plastic_strain = ufl.conditional(is_in_body, body.material.plastic_strain, 0)
        assert assemble_scalar(plastic_strain * body.material.dx) > 1e-4

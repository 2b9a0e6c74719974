"""Sensitivities of histories, compared with central differences of recomputed histories."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Iterative,
    Spaces,
    as_function,
    assemble_scalar,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements.contact import SLIP, ContactPair, ContactProblem, Motion, SignedDistance, Sphere
from pw_elements.meshes import triangles
from tests.contact.cases import (
    ElasticBody,
    make_finite_strain_unknown_and_residual,
    neo_hookean_piola_stress,
    on_plane,
)
from tests.contact.test_large import RubberUnderCircle, make_hardening_rubber_and_hardness

RELATIVE_PARAMETER_STEP = 1e-5  # change of a parameter, relative to its value
PARAMETER_NAMES = ("shear", "lame", "base", "load", "friction", "depth", "slide", "push")


class RandomRubber:
    """A rubber block with random data and parameters of all kinds, under a moving, pushing tool."""

    def __init__(self, seed, dim=2, steps=3, max_iterations=25, comm=MPI.COMM_SELF):
        rng = np.random.default_rng(seed)
        self.dim, self.steps, self.max_iterations, axis = dim, steps, max_iterations, dim - 1
        bottom = (-0.7, -0.8)[dim - 2]
        if dim == 2:
            mesh = triangles(comm, (-1.0, bottom), (1.0, 0.0), (10, 4))
        else:
            corners = ((-1.0, -1.0, bottom), (1.0, 1.0, 0.0))
            mesh = create_box(comm, corners, (3, 3, 2), CellType.tetrahedron)
        self.shear, self.lame, self.base = (fem.Constant(mesh, v) for v in (1.0, 1.5, 0.0))
        self.load = fem.Constant(mesh, np.zeros(dim))
        spaces = Spaces.petrov_galerkin(mesh)
        self.space = spaces.trial
        stress = lambda F: neo_hookean_piola_stress(F, self.shear, self.lame)  # noqa: E731
        self.u, internal_work = make_finite_strain_unknown_and_residual(spaces, stress, 3)
        weight, side = ufl.TestFunction(spaces.test), boundary_measure(mesh, on_plane(0, 1.0))
        self.residual = internal_work - ufl.inner(self.load, weight) * side
        F, dx = ufl.Identity(dim) + ufl.grad(self.u), ufl.dx(metadata={"quadrature_degree": 3})
        self.energy = self.shear * ufl.inner(F, F) * dx + ufl.inner(self.load, self.u) * side
        self.top = fem.locate_dofs_geometrical(self.space, on_plane(axis, 0.0))
        self.conditions = [
            prescribe(self.space, i, on_plane(axis, bottom), *value)
            for i, value in enumerate([(self.base,), *[()] * (dim - 1)])
        ]
        centre, radius = rng.uniform(-0.1, 0.1, dim), rng.uniform(0.6, 1.0)
        centre[axis] = radius
        axes = np.ones(dim)
        axes[0] = rng.uniform(1.0, 1.5)

        def level_set(x):
            return np.sqrt(np.sum(((x - centre) / axes) ** 2, axis=1)) * radius - radius**2

        def level_gradient(x):
            scaled = (x - centre) / axes
            return scaled / axes / np.linalg.norm(scaled, axis=1, keepdims=True) * radius

        self.surface = (
            Sphere(centre, radius)
            if rng.random() < 0.5
            else SignedDistance(level_set, level_gradient)
        )
        self.tool_path = np.zeros((3, dim))
        self.tool_path[:, axis] = -0.06, -0.1, -0.12
        self.tool_path[:, 0] = 0.0, 0.05, rng.uniform(0.1, 0.2)
        self.traction = rng.uniform(-0.05, 0.05, dim)
        self.values = dict(
            zip(PARAMETER_NAMES, (1.0, 1.5, 0.02, 1.0, 0.0, 1.0, 1.0, 1.0), strict=True)
        )
        self.values["friction"] = rng.uniform(0.1, 0.5)
        self.push_force = -rng.uniform(0.1, 0.2)

    def solve(self, **changed_values):
        """Return the problem and its states after changing the values of some parameters."""
        values = self.values | changed_values
        self.shear.value, self.lame.value = values["shear"], values["lame"]
        pair = ContactPair(self.top, self.surface, friction=values["friction"])
        problem = ContactProblem.of_residual(
            self.residual, self.u, self.conditions, pair, max_iterations=self.max_iterations
        )

        def make_load(k):
            def load(load_factor):
                self.base.value = values["base"] * (k + load_factor) / 3
                self.load.value = values["load"] * self.traction * (k + load_factor) / 3

            return load

        states, self.loads = [problem.undeformed], [make_load(k) for k in range(3)][: self.steps]
        for k, load in enumerate(self.loads):
            translation = self.tool_path[k] * values["depth"]
            translation[0] = self.tool_path[k, 0] * values["slide"]
            motion = Motion(translation)
            if k == 2:
                force = np.zeros(self.dim)
                force[-1] = self.push_force * values["push"]
                motion = Motion([*translation[:-1], None], force)
            states.append(problem.step(states[-1], load, motion))
        return problem, states

    @property
    def parameters(self):
        """Return the parameters, keyed by `PARAMETER_NAMES`, with rates in all states if needed."""
        ramp, n = np.arange(4) / 3, self.steps + 1
        depth, slide, push = np.zeros((3, 4, self.dim))
        depth[1:3, -1], slide[1:, 0], push[3, -1] = (
            self.tool_path[:2, -1],
            self.tool_path[:, 0],
            self.push_force,
        )
        arguments = [
            *(self.shear, self.lame, (self.base, ramp[:n])),
            (self.load, np.outer(ramp, self.traction)[:n]),
            ("friction", 0),
            *(("motion", 0, rates[:n]) for rates in (depth, slide, push)),
        ]
        return dict(zip(PARAMETER_NAMES, arguments, strict=True))

    @property
    def outputs(self):
        """Return the outputs whose derivatives are computed."""
        x, v = ufl.SpatialCoordinate(self.space.mesh), ufl.TestFunction(self.space)
        weights = assemble_vector(ufl.inner(x, v) * ufl.dx)
        axis = self.dim - 1
        forces = [("force", 0, i) for i in (0, axis)]
        return [*forces, ("translation", 0, axis), self.energy, weights]

    def recompute_outputs(self, states):
        """Recompute the outputs (states - 1, outputs) from the states without `sensitivity`."""
        rows, weights = [], self.outputs[-1]
        for state, load in zip(states[1:], self.loads, strict=True):
            load(1.0)
            self.u.x.array[:] = as_function(self.space, state.unknowns).x.array
            (pair,) = state.pairs
            pair_values = pair.force[0], pair.force[-1], pair.translation[-1]
            rows.append([*pair_values, assemble_scalar(self.energy), weights.dot(state.unknowns)])
        return np.array(rows)


def list_contact_statuses(states):
    return [pair.status.tolist() for state in states for pair in state.pairs]


class LinearBlockUnderCircle:
    """A block at small displacements on which a circle is pressed, slid, and pushed by a force."""

    max_iterations, loads = 25, ()
    values = dict.fromkeys(("depth", "slide", "push", "load"), 1.0) | {"friction": 0.2}

    def __init__(self):
        mesh = triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (12, 6))
        self.body = ElasticBody(mesh, E=10.0)
        self.K, self.load = self.body.K, self.body.traction_load((0.02, -0.05), on_plane(0, 1.0))
        self.supports = self.body.make_clamping_supports(on_plane(1, -1.0))
        self.outputs = [("force", 0, 0), ("force", 0, 1), ("translation", 0, 1), self.load]

    def solve(self, friction=0.2, depth=1.0, slide=1.0, push=1.0, load=1.0, solver=None):
        circle = Sphere((0.03, 0.6), 0.6)
        pair = ContactPair(on_plane(1, 0.0), circle, friction=friction)
        problem = self.body.contact_problem(pair, self.supports, solver=solver)
        states, f = [problem.undeformed], self.load.copy()
        f.scale(load)
        motions = [
            Motion((0.0, -0.01 * depth)),
            Motion((0.01 * slide, -0.01 * depth)),
            Motion((0.015 * slide, None), (0.0, -0.12 * push)),
        ]
        for motion in motions:
            states.append(problem.step(states[-1], f, motion))
        return problem, states

    @property
    def parameters(self):
        depth, slide, push = np.zeros((3, 4, 2))
        depth[1:3, 1], slide[2:, 0], push[3, 1] = -0.01, (0.01, 0.015), -0.12
        motions = {"depth": depth, "slide": slide, "push": push}
        motion_parameters = {name: ("motion", 0, rates) for name, rates in motions.items()}
        return {
            "friction": ("friction", 0),
            "load": (self.load, [0.0, 1.0, 1.0, 1.0]),
        } | motion_parameters

    def recompute_outputs(self, states):
        """Recompute the outputs (states - 1, outputs) from the states without `sensitivity`."""
        pair_values = [
            [*state.pairs[0].force, state.pairs[0].translation[1]] for state in states[1:]
        ]
        return np.hstack([pair_values, [[self.load.dot(state.unknowns)] for state in states[1:]]])


def sensitivity_errors_by_group(case, sensitivities, states, n_groups):
    """Return the relative error of the derivatives for each group of parameters.

    The reference is a central difference in which all parameters of the group change together.
    Groups whose change alters the status of a node are left out.
    """
    errors, names = {}, [*case.parameters]
    for group in np.array_split(names, n_groups):
        rates, end_results, same_statuses = (
            {name: abs(case.values[name]) for name in group},
            [],
            True,
        )
        for step in (RELATIVE_PARAMETER_STEP, -RELATIVE_PARAMETER_STEP):
            changed = {name: case.values[name] + step * rate for name, rate in rates.items()}
            _, changed_states = case.solve(**changed)
            end_results.append(case.recompute_outputs(changed_states))
            same_statuses &= list_contact_statuses(changed_states) == list_contact_statuses(states)
        if same_statuses:
            differences = (end_results[0] - end_results[1]) / (2 * RELATIVE_PARAMETER_STEP)
            directional = sum(
                rate * sensitivities[:, :, names.index(name)] for name, rate in rates.items()
            )
            scale = np.abs(differences).max(axis=0) + 1e-3 * (np.abs(differences).max() or 1.0)
            errors[str(group)] = float((np.abs(directional - differences) / scale).max())
    return errors


@pytest.mark.parametrize(
    ("make_case", "groups"),
    [
        (lambda: RandomRubber(0), 4),
        (lambda: RandomRubber(1), 1),
        (lambda: RandomRubber(5, dim=3), 1),
        (lambda: RandomRubber(6, max_iterations=4, steps=2), 1),
        (LinearBlockUnderCircle, 2),
    ],
)
def test_sensitivities_agree_with_differences_and_with_the_adjoint(make_case, groups):
    case = make_case()
    problem, states = case.solve()
    arguments = states, case.outputs, list(case.parameters.values()), case.loads
    sensitivities = problem.sensitivity(*arguments)
    assert any((pair.status == SLIP).any() for state in states for pair in state.pairs)
    assert any(state.substates for state in states) == (case.max_iterations < 25)
    weights = np.random.default_rng(0).normal(size=sensitivities.shape[:2])
    gradient = problem.sensitivity(*arguments, weights)
    expected = np.einsum("so,sop->p", weights, sensitivities)
    assert np.abs(gradient - expected).max() < 1e-10 * np.abs(gradient).max()
    errors = sensitivity_errors_by_group(case, sensitivities, states, groups)
    assert len(errors) > 0.6 * groups
    assert max(errors.values()) < 1e-6, errors


def test_sensitivities_use_the_present_stiffness():
    case = LinearBlockUnderCircle()
    problem, states = case.solve()
    arguments = states[:3], [("force", 0, 0), ("force", 0, 1)], [("friction", 0)]
    problem.sensitivity(*arguments)
    case.K.shift(0.01)
    expected = case.solve()[0].sensitivity(*arguments)
    assert np.abs(problem.sensitivity(*arguments) - expected).max() < 1e-10 * np.abs(expected).max()


def test_invalid_arguments_of_sensitivities_are_refused():
    case = RandomRubber(0, steps=2)
    problem, states = case.solve()
    valid = states, case.outputs, [case.shear], case.loads
    invalid_parameters = [
        (case.load, "needs rates"),
        ((case.load, np.ones(3)), r"\(3, 2\) finite numbers"),
        (("friction", 1), "number 1 of 1 contact pairs"),
        (("radius", 0), "give a constant"),
    ]
    for arguments, message in (
        (
            (*valid[:3], [case.loads[0]] * 2),
            "state 2 is not the end of a step from the state before",
        ),
        ((states[:1], *valid[1:]), "give the states at the start and at the end"),
        *(((*valid[:2], [value], case.loads), message) for value, message in invalid_parameters),
        *(
            ((states, [value], *valid[2:]), "give a func")
            for value in (("pressure", 0, 0), "force")
        ),
        ((*valid, np.ones(2)), "weights of the shape"),
    ):
        with pytest.raises(ValueError, match=message):
            problem.sensitivity(*arguments)
    rubber, _ = make_hardening_rubber_and_hardness()
    undeformed = rubber.problem.undeformed
    with pytest.raises(ValueError, match="has a history"):
        rubber.problem.sensitivity([undeformed, undeformed], [("force", 0, 1)], [("friction", 0)])
    steel = LinearBlockUnderCircle()
    problem, states = steel.solve()
    with pytest.raises(ValueError, match="a stiffness K has no known constants"):
        problem.sensitivity(states, [("force", 0, 1)], [case.shear])
    problem, states = steel.solve(solver=Iterative())
    with pytest.raises(ValueError, match="nor by an iterative solver"):
        problem.sensitivity(states, [("force", 0, 1)], [("friction", 0)])


def test_parameters_without_effect_and_invalid_numbers_are_refused():
    case = RandomRubber(0, steps=1)
    problem, states = case.solve()
    outputs, n = case.outputs, len(case.outputs)
    absent_constant = fem.Constant(case.u.function_space.mesh, 2.0)
    nan_vector = case.u.x.petsc_vec.duplicate()
    nan_vector.set(np.nan)
    for arguments, message in (
        ((outputs, [absent_constant], case.loads), r"the constant of value 2\.0 .* contains it"),
        (
            (outputs, [(absent_constant, np.ones(2))], case.loads),
            r"the constant of value 2\.0 .* contains it",
        ),
        ((outputs, [(case.shear, [1.0, 1.0j])], case.loads), r"rates .* complex.* real"),
        ((outputs, [(case.shear, [True, True])], case.loads), r"rates .* real"),
        ((outputs, [(case.shear, [1.0, np.inf])], case.loads), r"rates .* finite"),
        ((outputs, [(case.shear, ["1", "2"])], case.loads), r"rates .* real"),
        ((outputs, [(nan_vector, np.ones(2))], case.loads), r"the load .* is not finite"),
        (([nan_vector], [case.shear], case.loads), "the output, a vector of weights, is not"),
        ((outputs, [case.shear], case.loads, np.full((1, n), np.nan)), r"weights .* finite"),
        ((outputs, [case.shear], case.loads, np.full((1, n), 1j)), r"weights .* real"),
    ):
        with pytest.raises(ValueError, match=message):
            problem.sensitivity(states, *arguments)
    with pytest.raises(TypeError, match=r"load of step 0 .* function of the share"):
        problem.sensitivity(states, outputs, [case.shear], [nan_vector])
    # constants that occur only in a functional or in a condition are accepted
    functional = absent_constant * ufl.inner(case.u, case.u) * ufl.dx
    sensitivities = problem.sensitivity(
        states, [functional], [absent_constant, (case.base, [0.0, 1.0])], case.loads
    )
    u = as_function(case.space, states[1].unknowns)
    assert sensitivities[0, 0, 0] == pytest.approx(
        assemble_scalar(ufl.inner(u, u) * ufl.dx), rel=1e-12
    )
    assert sensitivities[0, 0, 1] != 0
    steel = LinearBlockUnderCircle()
    problem, states = steel.solve()
    with pytest.raises(ValueError, match="`loads` belong to a residual"):
        problem.sensitivity(states, [("force", 0, 1)], [("friction", 0)], [steel.load] * 3)


def test_a_status_that_is_about_to_change_is_refused():
    """Sensitivities are refused if the status of a node is about to change.

    The circle just touches a node without any force.
    """
    problem = RubberUnderCircle().problem
    states = [problem.undeformed, problem.step(problem.undeformed)]
    message = r"state 1 has contact nodes, first at \(0, 0\), about to change their status: a force"
    with pytest.raises(ValueError, match=message):
        problem.sensitivity(states, [("force", 0, 1)], [("friction", 0)])

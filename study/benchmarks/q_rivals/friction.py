"""Hertz line contact with Coulomb friction, pressed in one increment, by five methods."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from time import process_time
from typing import Any, NamedTuple

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix
from pw_elements.contact import ContactPair, Motion, Parabola, solve_contact
from pw_elements.elasticity import StressState
from study.benchmarks.q_rivals.errors import ERROR_WITHOUT_SOLUTION, sample_traction_over_distance
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.hertz_problem import (
    NU,
    RADIUS,
    E,
    Form,
    NoSolution,
    Problem,
    line_contact_problem,
    solve_newton,
)

Array = npt.NDArray[Any]

FRICTION_COEFFICIENT = 0.3
REFERENCE_EDGES = 32
"""Number of edges over the half width in the reference mesh, which is solved with the new element.

The standard element's tractions differ by 0.36 % on this mesh."""


class ContactTractions(NamedTuple):
    """Contact tractions computed by a method, and the number of linear systems solved.

    Args:
        pressure: Pressure as a UFL expression.
        shear: Shear traction as a UFL expression.
        factorisations: Number of linear systems that were solved.
    """

    pressure: Form
    shear: Form
    factorisations: int


@dataclass(frozen=True)
class FrictionMethod:
    """A contact method with friction.

    Args:
        label: Name of the method in tables.
        solve: Function of the problem and, if the method has one, of its parameter.
        parameter_sweep: Values of the parameter that are tried; empty if the method has no
            parameter.
    """

    label: str
    solve: Callable[..., ContactTractions]
    parameter_sweep: tuple[float, ...] = ()


# Methods


def solve_friction_with_pw_elements(problem: Problem, spaces: Spaces) -> ContactTractions:
    """Solve frictional contact by pw_elements at nodes.

    Tractions are nodal forces divided by the integrals of the element's test functions.
    """
    body = Body(spaces, Material(E, NU), StressState.PLANE_STRAIN)
    K = assemble_matrix(body.stiffness())
    supports = Reduction.dirichlet(spaces.trial, problem.far_field_supports(spaces.trial))
    motion = Motion((0.0, -problem.exact.approach))
    indenter = Parabola((0.0, 0.0), RADIUS)
    pair = ContactPair(problem.may_touch, indenter, FRICTION_COEFFICIENT, [motion])
    (state,) = solve_contact(K, K.createVecLeft(), supports, [pair], spaces.trial)
    (contact,), forces = state.pairs, np.zeros((2, spaces.trial.dofmap.index_map.size_local))
    forces[:, contact.node] = contact.force_normal, -contact.force_tangential[:, 0]
    pressure, shear = (
        problem.interpolate_on_sub_cells(
            problem.divide_by_test_function_integrals(force, spaces.test)
        )
        for force in forces
    )
    return ContactTractions(pressure, shear, state.iterations)


def solve_friction_by_nitsche(
    problem: Problem, scaled_gamma: float, theta: float = 1.0
) -> ContactTractions:
    """Solve frictional contact by Nitsche's method at integration points.

    The shear is the trial shear traction of sticking, limited by friction times pressure.

    Args:
        problem: Line contact problem.
        scaled_gamma: Nitsche parameter gamma h / E.
        theta: 1 for the symmetric form, -1 for the skew-symmetric one.
    """
    V = problem.make_space()
    u, v = fem.Function(V), ufl.TestFunction(V)
    gamma = fem.Constant(problem.mesh, scaled_gamma * E / problem.edge_length)
    (shear_u, normal_u), (shear_v, normal_v) = (
        (problem.stress(w)[0, 1], problem.stress(w)[1, 1]) for w in (u, v)
    )
    pressure = ufl.max_value(0, gamma * (u[1] - problem.gap) - normal_u)
    limit = FRICTION_COEFFICIENT * pressure
    shear = ufl.max_value(-limit, ufl.min_value(limit, gamma * u[0] - shear_u))
    terms = pressure * (gamma * v[1] - theta * normal_v) + shear * (gamma * v[0] - theta * shear_v)
    terms -= theta * (normal_u * normal_v + shear_u * shear_v)
    form = problem.virtual_work(u, v) + terms / gamma * problem.contact_measure
    return ContactTractions(pressure, shear, solve_newton(form, u, problem.far_field_supports(V)))


def solve_friction_by_augmented_lagrangian(
    problem: Problem, scaled_augmentation: float
) -> ContactTractions:
    """Solve frictional contact by the augmented Lagrangian with linear multipliers.

    Args:
        problem: Line contact problem.
        scaled_augmentation: Augmentation parameter times h / E.
    """
    elements = [basix.ufl.element("Lagrange", "triangle", d, shape=(2,)) for d in (2, 1)]
    W = fem.functionspace(problem.mesh, basix.ufl.mixed_element(elements))
    w, (v, m) = fem.Function(W), ufl.TestFunctions(W)
    u, t = ufl.split(w)
    augmentation = fem.Constant(problem.mesh, scaled_augmentation * E / problem.edge_length)
    pressure = ufl.max_value(0, t[1] + augmentation * (u[1] - problem.gap))
    limit = FRICTION_COEFFICIENT * pressure
    shear = ufl.max_value(-limit, ufl.min_value(limit, t[0] + augmentation * u[0]))
    traction = ufl.as_vector((shear, pressure))
    law = ufl.inner(traction, v) + ufl.inner(traction - t, m) / augmentation
    no_multipliers = [problem.zero_multipliers_outside(W.sub(1).sub(axis)) for axis in (0, 1)]
    supports = [*problem.far_field_supports(W.sub(0)), *no_multipliers]
    count = solve_newton(problem.virtual_work(u, v) + law * problem.contact_measure, w, supports)
    return ContactTractions(t[1], t[0], count)


def _solve_friction_with_new_element(problem: Problem) -> ContactTractions:
    return solve_friction_with_pw_elements(problem, Spaces.petrov_galerkin(problem.mesh))


def _solve_friction_with_standard_element(problem: Problem) -> ContactTractions:
    return solve_friction_with_pw_elements(problem, Spaces.galerkin(problem.mesh))


def _solve_friction_by_skew_nitsche(problem: Problem, scaled_gamma: float) -> ContactTractions:
    return solve_friction_by_nitsche(problem, scaled_gamma, theta=-1.0)


NITSCHE_SWEEP = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Values of gamma h / E."""
AUGMENTED_SWEEP = (0.1, 1.0, 10.0, 100.0)
"""Values of the augmentation parameter times h / E."""
FRICTION_METHODS = {
    "new": FrictionMethod("new element", _solve_friction_with_new_element),
    "standard": FrictionMethod("standard, own weights", _solve_friction_with_standard_element),
    "nitsche": FrictionMethod("Nitsche, symmetric", solve_friction_by_nitsche, NITSCHE_SWEEP),
    "skew": FrictionMethod(
        "Nitsche, skew-symmetric", _solve_friction_by_skew_nitsche, NITSCHE_SWEEP
    ),
    "augmented": FrictionMethod(
        "augmented Lagrangian P2/P1", solve_friction_by_augmented_lagrangian, AUGMENTED_SWEEP
    ),
}

# Errors


def friction(name: str, edges: int, offset: float) -> Result:
    """Compute the errors of a method with friction, at the parameter with the smallest shear error.

    Errors of pressure and shear are L2 norms relative to the norms of the reference tractions.

    Args:
        name: Name of the method.
        edges: Number of element edges over the half width of the contact.
        offset: Position of the end of the contact within the next edge, as a fraction of the edge.
    """
    problem, method = line_contact_problem(edges, offset), FRICTION_METHODS[name]
    candidates: list[dict[str, float]] = []
    for parameter in method.parameter_sweep or (None,):
        arguments = () if parameter is None else (parameter,)
        try:
            start = process_time()
            *tractions, factorisations = method.solve(problem, *arguments)
            seconds = process_time() - start
        except NoSolution:
            candidates.append({"shear_l2": ERROR_WITHOUT_SOLUTION})
            continue
        errors = {}
        for quantity, traction, reference in zip(
            ("pressure", "shear"),
            tractions,
            _compute_fine_mesh_reference_tractions(offset),
            strict=True,
        ):
            x, values = _sample_traction_over_peak_pressure(problem, traction)
            expected = np.interp(x, *reference)
            error = np.linalg.norm(values - expected) / np.linalg.norm(expected)
            errors[f"{quantity}_l2"] = float(error)
        parameters = {} if parameter is None else {"parameter": parameter}
        candidates.append(
            errors | parameters | {"factorisations": factorisations, "cpu_seconds": seconds}
        )
    scalars = min(candidates, key=lambda candidate: candidate["shear_l2"])
    scalars["shear_l2_largest"] = max(candidate["shear_l2"] for candidate in candidates)
    dofs = problem.make_space().dofmap.index_map.size_local * 2
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=dofs)


@cache
def _compute_fine_mesh_reference_tractions(offset: float) -> list[tuple[Array, Array]]:
    """Return positions (n,) and values (n,) of pressure and shear, computed on a fine mesh."""
    problem = line_contact_problem(REFERENCE_EDGES, offset)
    return [
        _sample_traction_over_peak_pressure(problem, traction)
        for traction in _solve_friction_with_new_element(problem)[:2]
    ]


def _sample_traction_over_peak_pressure(problem: Problem, traction: Form) -> tuple[Array, Array]:
    x, values = sample_traction_over_distance(problem, traction)
    return x, values / problem.exact.peak_pressure

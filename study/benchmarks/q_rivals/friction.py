"""Five methods with Coulomb friction, for the line contact pressed in one increment."""

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
from study.benchmarks.q_rivals.errors import ERROR_WITHOUT_SOLUTION, sample_traction
from study.model.units import dimensionless
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
"""Number of edges of the new element's reference mesh; the standard one differs by 0.36 % there."""


class Tractions(NamedTuple):
    """Tractions on the surface computed by a method, and its cost.

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
        label: Name in tables.
        solve: Function of the problem and of the parameter, if the method has one.
        sweep: Values of the parameter; empty if there is none.
    """

    label: str
    solve: Callable[..., Tractions]
    sweep: tuple[float, ...] = ()


# Methods


def solve_with_library(problem: Problem, spaces: Spaces) -> Tractions:
    """Solve by pw_elements; divide nodal forces by the integrals of the test functions."""
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
        problem.interpolate_linearly(problem.divide_by_weights(force, spaces.test))
        for force in forces
    )
    return Tractions(pressure, shear, state.iterations)


def solve_nitsche(problem: Problem, parameter: float, theta: float = 1.0) -> Tractions:
    """Solve by Nitsche's method at integration points; theta = -1 gives the skew-symmetric form.

    The shear is the trial shear of sticking, limited by the friction that the pressure allows.
    """
    V = problem.make_space()
    u, v = fem.Function(V), ufl.TestFunction(V)
    gamma = fem.Constant(problem.mesh, parameter * E / problem.size)
    (shear_u, normal_u), (shear_v, normal_v) = (
        (problem.stress(w)[0, 1], problem.stress(w)[1, 1]) for w in (u, v)
    )
    pressure = ufl.max_value(0, gamma * (u[1] - problem.gap) - normal_u)
    limit = FRICTION_COEFFICIENT * pressure
    shear = ufl.max_value(-limit, ufl.min_value(limit, gamma * u[0] - shear_u))
    terms = pressure * (gamma * v[1] - theta * normal_v) + shear * (gamma * v[0] - theta * shear_v)
    terms -= theta * (normal_u * normal_v + shear_u * shear_v)
    form = problem.virtual_work(u, v) + terms / gamma * problem.contact_measure
    return Tractions(pressure, shear, solve_newton(form, u, problem.far_field_supports(V)))


def solve_augmented(problem: Problem, parameter: float) -> Tractions:
    """Solve by the augmented Lagrangian with linear multipliers for pressure and shear."""
    elements = [basix.ufl.element("Lagrange", "triangle", d, shape=(2,)) for d in (2, 1)]
    W = fem.functionspace(problem.mesh, basix.ufl.mixed_element(elements))
    w, (v, m) = fem.Function(W), ufl.TestFunctions(W)
    u, t = ufl.split(w)
    augmentation = fem.Constant(problem.mesh, parameter * E / problem.size)
    pressure = ufl.max_value(0, t[1] + augmentation * (u[1] - problem.gap))
    limit = FRICTION_COEFFICIENT * pressure
    shear = ufl.max_value(-limit, ufl.min_value(limit, t[0] + augmentation * u[0]))
    traction = ufl.as_vector((shear, pressure))
    law = ufl.inner(traction, v) + ufl.inner(traction - t, m) / augmentation
    no_multipliers = [problem.zero_multipliers_outside(W.sub(1).sub(axis)) for axis in (0, 1)]
    supports = [*problem.far_field_supports(W.sub(0)), *no_multipliers]
    count = solve_newton(problem.virtual_work(u, v) + law * problem.contact_measure, w, supports)
    return Tractions(t[1], t[0], count)


def _solve_new_element(problem: Problem) -> Tractions:
    return solve_with_library(problem, Spaces.petrov_galerkin(problem.mesh))


def _solve_standard_element(problem: Problem) -> Tractions:
    return solve_with_library(problem, Spaces.galerkin(problem.mesh))


def _solve_skew_nitsche(problem: Problem, parameter: float) -> Tractions:
    return solve_nitsche(problem, parameter, theta=-1.0)


NITSCHE_SWEEP = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Values of gamma h / E."""
AUGMENTED_SWEEP = (0.1, 1.0, 10.0, 100.0)
"""Values of the augmentation parameter times h / E."""
FRICTION_METHODS = {
    "new": FrictionMethod("new element", _solve_new_element),
    "standard": FrictionMethod("standard, own weights", _solve_standard_element),
    "nitsche": FrictionMethod("Nitsche, symmetric", solve_nitsche, NITSCHE_SWEEP),
    "skew": FrictionMethod("Nitsche, skew-symmetric", _solve_skew_nitsche, NITSCHE_SWEEP),
    "augmented": FrictionMethod("augmented Lagrangian P2/P1", solve_augmented, AUGMENTED_SWEEP),
}

# Errors


def friction(name: str, edges: int, offset: float) -> Result:
    """Return errors of a method at the parameter with the smallest error of the shear.

    Errors of pressure and shear are L2 norms relative to those of the reference.

    Args:
        name: Name of the method.
        edges: Number of edges over the half width.
        offset: Position within the next edge at which contact ends, over the edge's length.
    """
    problem, method = line_contact_problem(edges, offset), FRICTION_METHODS[name]
    candidates: list[dict[str, float]] = []
    for parameter in method.sweep or (None,):
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
            ("pressure", "shear"), tractions, _compute_reference_tractions(offset), strict=True
        ):
            x, values = _sample_traction_over_peak(problem, traction)
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
    return Result(scalars, dimensionless(scalars), dofs=dofs)


@cache
def _compute_reference_tractions(offset: float) -> list[tuple[Array, Array]]:
    """Return points and values of the new element's pressure and shear on a fine mesh."""
    problem = line_contact_problem(REFERENCE_EDGES, offset)
    return [
        _sample_traction_over_peak(problem, traction)
        for traction in _solve_new_element(problem)[:2]
    ]


def _sample_traction_over_peak(problem: Problem, traction: Form) -> tuple[Array, Array]:
    x, values = sample_traction(problem, traction)
    return x, values / problem.exact.peak_pressure

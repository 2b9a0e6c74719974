"""Nitsche's method, symmetric or skew-symmetric, with Coulomb friction."""

import ufl
from dolfinx import fem

from study.rivals.friction import COEFFICIENT
from study.rivals.problem import E, Form, Problem, newton

SWEEP = (1.0, 3.0, 10.0, 30.0, 100.0)


def solve(problem: Problem, parameter: float, theta: float = 1.0) -> tuple[Form, Form, int]:
    """The shear is the nearest to sticking that the pressure allows, at integration points."""
    V = problem.space()
    u, v = fem.Function(V), ufl.TestFunction(V)
    gamma = fem.Constant(problem.mesh, parameter * E / problem.size)
    (s, p), (s_v, p_v) = ((problem.stress(w)[0, 1], problem.stress(w)[1, 1]) for w in (u, v))
    pressure = ufl.max_value(0, gamma * (u[1] - problem.gap) - p)
    most = COEFFICIENT * pressure
    shear = ufl.max_value(-most, ufl.min_value(most, gamma * u[0] - s))
    terms = pressure * (gamma * v[1] - theta * p_v) + shear * (gamma * v[0] - theta * s_v)
    terms -= theta * (p * p_v + s * s_v)
    form = problem.work(u, v) + terms / gamma * problem.surface
    count = newton(form, u, problem.supports(V))
    return pressure, shear, count

"""Augmented Lagrangian P2/P1 with Coulomb friction."""

import basix.ufl
import ufl
from dolfinx import fem

from study.rivals.friction import COEFFICIENT
from study.rivals.problem import E, Form, Problem, newton

SWEEP = (0.1, 1.0, 10.0, 100.0)


def solve(problem: Problem, parameter: float) -> tuple[Form, Form, int]:
    """Multipliers of degree 1 for pressure and shear."""
    elements = [basix.ufl.element("Lagrange", "triangle", d, shape=(2,)) for d in (2, 1)]
    W = fem.functionspace(problem.mesh, basix.ufl.displacement_pressure_element(elements))
    w, (v, m) = fem.Function(W), ufl.TestFunctions(W)
    u, t = ufl.split(w)
    r = fem.Constant(problem.mesh, parameter * E / problem.size)
    pressure = ufl.max_value(0, t[1] + r * (u[1] - problem.gap))
    most = COEFFICIENT * pressure
    shear = ufl.max_value(-most, ufl.min_value(most, t[0] + r * u[0]))
    traction = ufl.as_vector((shear, pressure))
    law = ufl.inner(traction, v) + ufl.inner(traction - t, m) / r
    nowhere = [problem.nowhere_else(W.sub(1).sub(axis)) for axis in (0, 1)]
    supports = [*problem.supports(W.sub(0)), *nowhere]
    count = newton(problem.work(u, v) + law * problem.surface, w, supports)
    return t[1], t[0], count

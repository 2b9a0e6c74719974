"""Whether a stiffness or a residual is one of an axisymmetric body.

The stiffness of a `Body` has a record of its state of stress. The residual of a user has none,
unless it contains forms of a `Body`, but it contains the hoop strain.
"""

from petsc4py import PETSc

import ufl
from dolfinx import fem
from ufl.algorithms import extract_arguments, extract_coefficients
from ufl.classes import Division, FixedIndex, Indexed, SpatialCoordinate
from ufl.core.expr import Expr
from ufl.corealg.traversal import unique_pre_traversal

from pw_elements.elasticity.body import StressState
from pw_elements.spaces import collect_stress_states, read_record


def is_axisymmetric_stiffness(K: PETSc.Mat) -> bool:
    """Return whether a stiffness (n, n) has the record of an axisymmetric `Body`."""
    return StressState.AXISYMMETRIC.value in read_record(K).stress_states


def is_axisymmetric_residual(residual: ufl.Form, u: fem.Function) -> bool:
    """Return whether a residual contains forms of an axisymmetric `Body`, or the hoop strain.

    The hoop strain is a component of the unknown, or of the weight function, divided by the radius
    `SpatialCoordinate(mesh)[0]`. If a form contains it in another way, the result is False.

    Args:
        residual: residual of the body.
        u: unknown function of the residual.
    """
    if StressState.AXISYMMETRIC.value in collect_stress_states(residual):
        return True
    return any(
        _is_unknown_or_weight_divided_by_radius(node, u)
        for part in residual.integrals_by_type("cell")
        for node in unique_pre_traversal(part.integrand())
    )


def _is_unknown_or_weight_divided_by_radius(expression: Expr, u: fem.Function) -> bool:
    if not isinstance(expression, Division):
        return False
    numerator, divisor = expression.ufl_operands
    is_radius = (
        isinstance(divisor, Indexed)
        and isinstance(divisor.ufl_operands[0], SpatialCoordinate)
        and tuple(divisor.ufl_operands[1]) == (FixedIndex(0),)
    )
    return is_radius and (
        u in extract_coefficients(numerator) or bool(extract_arguments(numerator))
    )

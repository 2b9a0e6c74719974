"""Smooth displacement fields for manufactured solutions; their loads are derived by UFL."""

from collections.abc import Callable
from types import ModuleType
from typing import Any, TypeAlias

ArrayOrExpression: TypeAlias = Any
"""Arrays of numpy or expressions of UFL."""
DisplacementField = Callable[
    [ModuleType, ArrayOrExpression, ArrayOrExpression], tuple[ArrayOrExpression, ...]
]
"""Function (m, x, compliance) that returns the components of a displacement.

m is the module (numpy or UFL) whose functions are called, and x is the point. The compliance is the
reciprocal of Lamé's first constant: terms multiplied by it have a bounded pressure as nu tends to
1/2.
"""


def plane(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return the sum of an isochoric plane field and `plane_pressure`."""
    p = plane_pressure(m, x, compliance)
    return (
        1.5 * m.sin(2 * x[0]) * m.cos(1.5 * x[1]) + p[0],
        -2 * m.cos(2 * x[0]) * m.sin(1.5 * x[1]) + p[1],
    )


def plane_pressure(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return a plane field whose stress tends to a pure pressure as nu tends to 1/2.

    A body force balances this pressure.
    """
    return compliance * m.sin(x[0] + x[1]), compliance * m.cos(x[0] - 2 * x[1])


def round_about(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return the sum of an isochoric axisymmetric field and `round_about_pressure`."""
    r, z = x[0], x[1]
    p = round_about_pressure(m, x, compliance)
    return (
        r * (1 - r**2 / 3) * m.cos(z) + p[0],
        (4 / 3 * r**2 - 2) * m.sin(z) + p[1],
    )


def round_about_pressure(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return an axisymmetric field like `plane_pressure`: u_r is odd in r, u_z even."""
    r, z = x[0], x[1]
    return (
        compliance * m.sin(1.2 * r) * m.cos(z + 0.3),
        compliance * m.cos(1.5 * r) * m.sin(1.1 * z),
    )


def solid(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return the sum of an isochoric field in space and `solid_pressure`."""
    p = solid_pressure(m, x, compliance)
    return (
        m.sin(x[1] + 2 * x[2]) + p[0],
        m.cos(1.5 * x[0] - x[2]) + p[1],
        m.sin(x[0] + x[1]) + p[2],
    )


def solid_pressure(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return a field in space like `plane_pressure`."""
    return (
        compliance * m.sin(x[0] + x[1]),
        compliance * m.cos(x[1] - 2 * x[2]),
        compliance * m.sin(x[0] + 1.3 * x[2]),
    )

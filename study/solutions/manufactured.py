"""Smooth displacement fields for manufactured solutions, whose loads are derived by UFL."""

from collections.abc import Callable
from types import ModuleType
from typing import Any, TypeAlias

ArrayOrExpression: TypeAlias = Any
"""Arrays of NumPy or expressions of UFL."""
DisplacementField = Callable[
    [ModuleType, ArrayOrExpression, ArrayOrExpression], tuple[ArrayOrExpression, ...]
]
"""Function (m, x, compliance) that returns the components of a displacement.

`m` is the module (NumPy or UFL) whose functions sin and cos are called, `x` the point, and
`compliance` the reciprocal of Lamé's first constant: the pressure of terms multiplied by it remains
bounded as Poisson's ratio nu tends to 1/2.
"""


def plane(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return a plane displacement, the sum of a divergence-free field and `plane_pressure`."""
    p = plane_pressure(m, x, compliance)
    return (
        1.5 * m.sin(2 * x[0]) * m.cos(1.5 * x[1]) + p[0],
        -2 * m.cos(2 * x[0]) * m.sin(1.5 * x[1]) + p[1],
    )


def plane_pressure(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return a plane displacement whose stress tends to a pure pressure as nu tends to 1/2.

    The pressure varies in space and is balanced by a body force.
    """
    return compliance * m.sin(x[0] + x[1]), compliance * m.cos(x[0] - 2 * x[1])


def round_about(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return an axisymmetric displacement.

    It is the sum of a divergence-free field and `axisymmetric_field_of_bounded_pressure`.
    """
    r, z = x[0], x[1]
    p = axisymmetric_field_of_bounded_pressure(m, x, compliance)
    return (
        r * (1 - r**2 / 3) * m.cos(z) + p[0],
        (4 / 3 * r**2 - 2) * m.sin(z) + p[1],
    )


def axisymmetric_field_of_bounded_pressure(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return an axisymmetric displacement whose stress tends to a pressure as nu tends to 1/2.

    u_r is odd in r and u_z even, so that the field is smooth on the axis.
    """
    r, z = x[0], x[1]
    return (
        compliance * m.sin(1.2 * r) * m.cos(z + 0.3),
        compliance * m.cos(1.5 * r) * m.sin(1.1 * z),
    )


def solid(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return a displacement in space.

    It is the sum of a divergence-free field and `spatial_field_of_bounded_pressure`.
    """
    p = spatial_field_of_bounded_pressure(m, x, compliance)
    return (
        m.sin(x[1] + 2 * x[2]) + p[0],
        m.cos(1.5 * x[0] - x[2]) + p[1],
        m.sin(x[0] + x[1]) + p[2],
    )


def spatial_field_of_bounded_pressure(
    m: ModuleType, x: ArrayOrExpression, compliance: ArrayOrExpression
) -> tuple[ArrayOrExpression, ...]:
    """Return a displacement in space whose stress tends to a pressure as nu tends to 1/2."""
    return (
        compliance * m.sin(x[0] + x[1]),
        compliance * m.cos(x[1] - 2 * x[2]),
        compliance * m.sin(x[0] + 1.3 * x[2]),
    )

"""Integrals over cells: weights on tetrahedra need points on sub-cells FFCx knows nothing of.

Stiffnesses need four points instead of twelve: stresses of quadratic displacements are linear in
straight cells, and the means of slopes at the vertices integrate their products exactly.

For all other elements FFCx takes the right rule by itself: that of the halved cell wherever a
test or trial function is piecewise linear. So it does on the faces of tetrahedra.
"""

from collections.abc import Callable
from typing import Any

import basix.ufl
import ufl
from basix import CellType, PolysetType
from dolfinx import fem
from ufl.algorithms import (
    compute_form_data,
    extract_arguments,
    extract_coefficients,
    extract_elements,
    extract_sub_elements,
)
from ufl.classes import Grad
from ufl.corealg.traversal import unique_pre_traversal

from pw_elements.arrays import Array
from pw_elements.spaces.elements import TwelveCellElement, twelve_cell_rule, vertex_rule

# Under this name metadata of a body's integrals have its state of stress
STATE = "stress_state"


def cell_measure(space: fem.FunctionSpace, degree: int) -> ufl.Measure:
    """Measure dx for integrals of test functions, also in DOLFINx's own assembly.

        dx = cell_measure(W, 2)
        load = fem.assemble_vector(fem.form(f * ufl.TestFunction(W) * dx))

    Args:
        space: the test space.
        degree: of the polynomials that are integrated exactly on each sub-cell.
    """
    metadata: dict[str, Any] = {"quadrature_degree": degree}
    if _halved_tetrahedra(space.ufl_element()):
        metadata |= _custom(*twelve_cell_rule(degree))
    return ufl.Measure("dx", domain=space.mesh, metadata=metadata)


def with_cell_rules(form: ufl.Form) -> ufl.Form:
    """The form with such points in its integrals over tetrahedra, if its functions need them."""
    return _with(form, _ruled)


def without_states(form: ufl.Form) -> ufl.Form:
    return _with(form, lambda part: {k: v for k, v in part.metadata().items() if k != STATE})


def with_degrees(form: ufl.Form) -> ufl.Form:
    """The form with UFL's estimate of the degree written into measures that state none.

    A derivative of the form then has the same points, of which Newton's method has its order.
    """

    def stated(part: ufl.Integral) -> dict[str, Any]:
        known: dict[str, Any] = part.metadata()
        if known.keys() & {"quadrature_degree", "quadrature_rule"}:
            return known
        return {**known, "quadrature_degree": _estimated_degree(part)}

    return _with(form, stated)


def _with(form: ufl.Form, metadata: Callable[[ufl.Integral], dict[str, Any]]) -> ufl.Form:
    return ufl.Form([part.reconstruct(metadata=metadata(part)) for part in form.integrals()])


def _ruled(integral: ufl.Integral) -> dict[str, Any]:
    """The metadata of an integral, with points on sub-cells if it needs and has none."""
    metadata: dict[str, Any] = integral.metadata()
    rule = metadata.get("quadrature_rule", "default")
    halved = any(map(_halved_tetrahedra, extract_elements(integral)))
    if integral.integral_type() != "cell" or rule == "custom" or not halved:
        return metadata
    if rule != "default":
        raise ValueError(
            f"the measure's quadrature_rule {rule!r} is one of the whole tetrahedron, but weights "
            "are linear on sub-cells: give the quadrature_degree alone"
        )
    degree = metadata.get("quadrature_degree", -1)
    if degree < 0:
        degree = _estimated_degree(integral)
    if degree == 1 and _is_linear_times_slopes(integral):
        return {**metadata, **_custom(*vertex_rule())}
    return {**metadata, **_custom(*twelve_cell_rule(degree))}


def _is_linear_times_slopes(integral: ufl.Integral) -> bool:
    """Whether it has slopes of one function that is the mean of three cuts, times linear ones."""
    functions = [*extract_arguments(integral), *extract_coefficients(integral)]
    halved = [f for f in functions if _halved_tetrahedra(f.ufl_element())]
    if len(halved) > 1 or _estimated_degree(integral) > 1:
        return False
    nodes = (
        node for part in _prepared(integral) for node in unique_pre_traversal(part.integrand())
    )
    valued = {
        operand for node in nodes if not isinstance(node, Grad) for operand in node.ufl_operands
    }
    means = all(
        isinstance(e, TwelveCellElement) for e in _halved_tetrahedra(halved[0].ufl_element())
    )
    return means and halved[0] not in valued


def _estimated_degree(integral: ufl.Integral) -> int:
    parts = _prepared(integral)
    return max(int(part.metadata()["estimated_polynomial_degree"]) for part in parts)


def _prepared(integral: ufl.Integral) -> list[ufl.Integral]:
    """The integrals that FFCx makes of it, of derivatives of functions alone."""
    data = compute_form_data(
        ufl.Form([integral]), do_apply_integral_scaling=True, do_append_everywhere_integrals=False
    )
    return [part for group in data.integral_data for part in group.integrals]


def _custom(points: Array, weights: Array) -> dict[str, Any]:
    return {  # tuples, for UFL's signature of a form abbreviates arrays
        "quadrature_rule": "custom",
        "quadrature_points": tuple(tuple(map(float, x)) for x in points),
        "quadrature_weights": tuple(map(float, weights)),
    }


def _halved_tetrahedra(element: basix.ufl._ElementBase) -> list[basix.ufl._BasixElement]:
    """The weights on tetrahedra that an element is, or holds; the twelve cells halve all."""
    return [
        part
        for part in extract_sub_elements([element])
        if isinstance(part, basix.ufl._BasixElement)
        and part.cell_type is CellType.tetrahedron
        and part.polyset_type is PolysetType.macroedge
    ]

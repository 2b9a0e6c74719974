"""Integrals over cells: weights on tetrahedra need points on sub-cells FFCx knows nothing of.

For all other elements FFCx takes the right rule by itself: that of the halved cell wherever a
test or trial function is piecewise linear. So it does on the faces of tetrahedra.
"""

from collections.abc import Callable
from typing import Any

import basix.ufl
import ufl
from basix import CellType, PolysetType
from dolfinx import fem
from ufl.algorithms import compute_form_data, extract_elements, extract_sub_elements

from pw_elements.spaces.elements import twelve_cell_rule

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
    if _is_halved_tetrahedron(space.ufl_element()):
        metadata |= _twelve_cells(degree)
    return ufl.Measure("dx", domain=space.mesh, metadata=metadata)


def with_cell_rules(form: ufl.Form) -> ufl.Form:
    """The form with such points in its integrals over tetrahedra, if its functions need them."""
    return _with(form, lambda part: _rule(part) if _lacks_rule(part) else part.metadata())


def without_states(form: ufl.Form) -> ufl.Form:
    """The form without states of stress, which are no matter of its compilation."""
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


def _lacks_rule(integral: ufl.Integral) -> bool:
    return (
        integral.integral_type() == "cell"
        and integral.metadata().get("quadrature_rule") != "custom"
        and any(map(_is_halved_tetrahedron, extract_elements(integral)))
    )


def _rule(integral: ufl.Integral) -> dict[str, Any]:
    metadata = integral.metadata()
    rule = metadata.get("quadrature_rule", "default")
    if rule != "default":
        raise ValueError(
            f"the measure's quadrature_rule {rule!r} is one of the whole tetrahedron, but weights "
            "are linear on sub-cells: give the quadrature_degree alone"
        )
    degree = metadata.get("quadrature_degree", -1)
    if degree < 0:
        degree = _estimated_degree(integral)
    return {**metadata, **_twelve_cells(degree)}


def _estimated_degree(integral: ufl.Integral) -> int:
    data = compute_form_data(
        ufl.Form([integral]), do_apply_integral_scaling=True, do_append_everywhere_integrals=False
    )
    parts = [part for group in data.integral_data for part in group.integrals]
    return max(int(part.metadata()["estimated_polynomial_degree"]) for part in parts)


def _twelve_cells(degree: int) -> dict[str, Any]:
    points, weights = twelve_cell_rule(degree)
    return {  # tuples, for UFL's signature of a form abbreviates arrays
        "quadrature_rule": "custom",
        "quadrature_points": tuple(tuple(map(float, x)) for x in points),
        "quadrature_weights": tuple(map(float, weights)),
    }


def _is_halved_tetrahedron(element: basix.ufl._ElementBase) -> bool:
    """Whether it is, or holds, weights on tetrahedra; the twelve cells halve the one-cut's too."""
    return any(
        isinstance(part, basix.ufl._BasixElement)
        and part.cell_type is CellType.tetrahedron
        and part.polyset_type is PolysetType.macroedge
        for part in extract_sub_elements([element])
    )

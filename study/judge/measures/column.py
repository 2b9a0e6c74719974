"""Measures for section 7.5: eigenvalues and contact forces of the stepped column, and Table 1.

A *shift* is the relative difference between an eigenvalue of one element and that of another
element or variant, in per cent.
"""

from collections.abc import Sequence

import numpy as np

from study.judge.measures.stored_cases import (
    T6_ELEMENTS,
    Selection,
    load_section_results,
    select_results,
)
from study.paper.items import TABLE_1
from study.run.store import Results

_MODES = range(1, 7)


def printed_eigenvalue(results: Results, element: str, mode: int) -> float:
    """Return an eigenvalue as printed in Table 1, without units."""
    return TABLE_1[element][mode - 1]


def printed_shift(results: Results, element: str, over: str, mode: int) -> float:
    """Return the relative difference between two printed eigenvalues of a mode, in per cent."""
    return 100 * (TABLE_1[element][mode - 1] / TABLE_1[over][mode - 1] - 1)


def largest_printed_shift(results: Results, pairs: Sequence[Sequence[str]]) -> float:
    """Return the largest absolute `printed_shift` over modes and pairs of elements, in per cent."""
    return max(
        abs(printed_shift(results, element, over, mode))
        for element, over in pairs
        for mode in _MODES
    )


def printed_shift_rms(results: Results, element: str, over: str) -> float:
    """Return the root mean square of `printed_shift` over the modes, in per cent."""
    return _root_mean_square([printed_shift(results, element, over, mode) for mode in _MODES])


def eigenvalue_shift(results: Results, case: str, over: str, mode: int) -> float:
    """Return the relative difference between the computed eigenvalues of two cases, in per cent."""
    name = f"omega2_{mode}"
    return 100 * (results.scalar(f"7.5/{case}", name) / results.scalar(f"7.5/{over}", name) - 1)


def eigenvalue_shifts_of_cases_and_modes(
    results: Results, cases: Selection, over: str
) -> list[float]:
    """Return the shifts of all modes and matching cases relative to the case `over`, in per cent.

    Args:
        results: Stored results.
        cases: Values of parameters, or a regular expression for the names of cases.
        over: Name of the case that provides the divisors.
    """
    return [
        eigenvalue_shift(results, stored.case, over, mode)
        for stored in select_results(results, "7.5", cases)
        for mode in _MODES
    ]


def largest_eigenvalue_shift(results: Results, cases: Selection, over: str) -> float:
    """Return the largest absolute value of `eigenvalue_shifts_of_cases_and_modes`, in per cent."""
    return max(map(abs, eigenvalue_shifts_of_cases_and_modes(results, cases, over)))


def highest_eigenvalue_shift(results: Results, cases: Selection, over: str) -> float:
    """Return the largest shift of an eigenvalue, considering signs, in per cent."""
    return max(eigenvalue_shifts_of_cases_and_modes(results, cases, over))


def mean_eigenvalue_shift(results: Results, case: str, over: str) -> float:
    """Return the mean shift of the eigenvalues over the modes, considering signs, in per cent."""
    return float(np.mean(eigenvalue_shifts_of_cases_and_modes(results, case, over)))


def smallest_mean_eigenvalue_shift(results: Results, cases: Sequence[str], over: str) -> float:
    """Return the smallest `mean_eigenvalue_shift` of several cases, in per cent."""
    return min(mean_eigenvalue_shift(results, case, over) for case in cases)


def shift_misfit(results: Results, case: str, over: str, element: str, printed_over: str) -> float:
    """Return the root mean square difference between computed and printed shifts of all modes.

    The unit is percentage points.

    Args:
        results: Stored results.
        case: Name of a case.
        over: Name of the case that provides the divisors.
        element: Row of Table 1 that corresponds to `case`.
        printed_over: Row of Table 1 that corresponds to `over`.
    """
    return _root_mean_square(
        [
            eigenvalue_shift(results, case, over, mode)
            - printed_shift(results, element, printed_over, mode)
            for mode in _MODES
        ]
    )


def largest_relative_shift_misfit(
    results: Results, case: str, over: str, element: str, printed_over: str
) -> float:
    """Return the largest relative deviation of a computed from a printed shift over all modes.

    See `shift_misfit` for the arguments.
    """
    return max(
        abs(eigenvalue_shift(results, case, over, mode) / printed_value - 1)
        for mode in _MODES
        for printed_value in [printed_shift(results, element, printed_over, mode)]
    )


def misfit_margin(
    results: Results,
    cases: Selection,
    others: Selection,
    over: str,
    element: str,
    printed_over: str,
) -> float:
    """Return the smallest `shift_misfit` of `others` minus the largest one of `cases`.

    It is positive if all matching cases are nearer to the printed shifts than all others. The unit
    is percentage points; see `shift_misfit` for the other arguments.
    """

    def shift_misfits_of_cases(selection: Selection) -> list[float]:
        stored_results = select_results(results, "7.5", selection)
        return [
            shift_misfit(results, stored.case, over, element, printed_over)
            for stored in stored_results
        ]

    return min(shift_misfits_of_cases(others)) - max(shift_misfits_of_cases(cases))


def percent_deviation_from_printed_eigenvalue(
    results: Results, case: str, element: str, mode: int
) -> float:
    """Return the relative deviation of a computed from a printed eigenvalue, in per cent."""
    return 100 * (results.scalar(f"7.5/{case}", f"omega2_{mode}") / TABLE_1[element][mode - 1] - 1)


def largest_deviation_from_printed(results: Results, case: str, element: str) -> float:
    """Return the largest deviation of a computed eigenvalue from Table 1, in per cent.

    The maximum of absolute values is taken over the modes.
    """
    return max(
        abs(percent_deviation_from_printed_eigenvalue(results, case, element, mode))
        for mode in _MODES
    )


def blind_test_scalar(results: Results, row: str, name: str) -> float:
    """Return a stored scalar of the test whether any treatment gives the printed shifts of Table 1.

    Args:
        results: the stored results.
        row: "six" or "eight" nodes, or "both" (all twelve shifts).
        name: name of the number, see `study.paper.table_1.inverse.judge_row`.
    """
    return results.scalar("7.5/blind", f"{row}_{name}")


def column_height(results: Results, reading: str) -> float:
    """Return the height in m of a similar column whose first eigenvalue has the digits of CAX8's.

    Args:
        results: Stored results.
        reading: Interpretation of the printed data: "mixed" (kN together with kg) or "SI".
    """
    case = {"mixed": "galerkin-Q8", "SI": "galerkin-Q8-SI"}[reading]
    height = results.curves("7.5/galerkin-Q8")["nodes"][:, 1].max()
    ratio = results.scalar(f"7.5/{case}", "omega2_1") / TABLE_1["CAX8"][0]
    return float(height * np.sqrt(ratio))


def farthest_sawtooth(results: Results, element: str, value: float) -> float:
    """Return the ratio of mid-side to corner force that is farthest from a value.

    The four contact surfaces of the column are compared.
    """
    ratios = [results.scalar(f"7.5/{element}", f"sawtooth_{surface}") for surface in (1, 2, 3, 4)]
    return max(ratios, key=lambda ratio: abs(ratio - value))


def percent_of_force_on_surface_4(results: Results, key: str, surface: int) -> float:
    """Return the normal force on a surface of the column, in per cent of that on surface 4."""
    force = results.scalar(key, f"force_normal_{surface}")
    return 100 * force / results.scalar(key, "force_normal_4")


def column_force_imbalance(results: Results) -> float:
    """Return the largest relative difference between the forces below and on top of the column.

    The forces below are those on the base and the shoulders.

    The maximum is taken over all stored cases of the column in contact.
    """
    return max(
        abs(
            sum(
                percent_of_force_on_surface_4(results, stored.key, surface) for surface in (1, 2, 3)
            )
            / 100
            - 1
        )
        for stored in load_section_results(results, "7.5")
        if "force_normal_4" in stored.scalars
    )


def column_transfer_defect(results: Results, component: str) -> float:
    """Return the largest difference between transferred and new nodal forces on all four surfaces.

    The transferred forces are those of the standard triangle, multiplied by the matrix T of
    `force_transfer`. The difference is in per cent of the new triangle's mean normal force of the
    nodes of the same surface.
    """
    galerkin, pw = (results.curves(f"7.5/{element}") for element in T6_ELEMENTS)
    return max(
        100
        * np.abs(galerkin[f"{component}_T_{surface}"] - pw[f"{component}_{surface}"]).max()
        / pw[f"force_n_{surface}"].mean()
        for surface in (1, 2, 3, 4)
    )


def axis_force_ratio(results: Results, element: str) -> float:
    """Return the normal force of a node on the axis, divided by the mean of its surface's nodes.

    The larger ratio of surfaces 1 and 4 is returned.
    """
    curves = results.curves(f"7.5/{element}")
    return float(
        max(
            curves[f"force_n_{surface}"][0] / curves[f"force_n_{surface}"].mean()
            for surface in (1, 4)
        )
    )


def _root_mean_square(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))

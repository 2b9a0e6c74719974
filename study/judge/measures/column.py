"""Measures of section 7.5 that its own quantities need, printed ones too."""

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
    """An eigenvalue of Table 1 as printed."""
    return TABLE_1[element][mode - 1]


def printed_shift(results: Results, element: str, over: str, mode: int) -> float:
    """Relative distance of two printed eigenvalues, in per cent."""
    return 100 * (TABLE_1[element][mode - 1] / TABLE_1[over][mode - 1] - 1)


def largest_printed_shift(results: Results, pairs: Sequence[Sequence[str]]) -> float:
    """Largest size of it over all modes and pairs of columns."""
    return max(
        abs(printed_shift(results, element, over, mode))
        for element, over in pairs
        for mode in _MODES
    )


def printed_shift_rms(results: Results, element: str, over: str) -> float:
    """Root mean square of it over the modes."""
    return _rms([printed_shift(results, element, over, mode) for mode in _MODES])


def eigenvalue_shift(results: Results, case: str, over: str, mode: int) -> float:
    """Relative distance of two computed eigenvalues of the column, in per cent."""
    name = f"omega2_{mode}"
    return 100 * (results.scalar(f"7.5/{case}", name) / results.scalar(f"7.5/{over}", name) - 1)


def eigenvalue_shifts(results: Results, cases: Selection, over: str) -> list[float]:
    """Shifts of all modes (one number each) of cases, by parameters or an expression for names."""
    return [
        eigenvalue_shift(results, stored.case, over, mode)
        for stored in select_results(results, "7.5", cases)
        for mode in _MODES
    ]


def largest_eigenvalue_shift(results: Results, cases: Selection, over: str) -> float:
    """Largest of `eigenvalue_shifts` in absolute value."""
    return max(map(abs, eigenvalue_shifts(results, cases, over)))


def highest_eigenvalue_shift(results: Results, cases: Selection, over: str) -> float:
    """Highest of `eigenvalue_shifts`, with its sign."""
    return max(eigenvalue_shifts(results, cases, over))


def mean_eigenvalue_shift(results: Results, case: str, over: str) -> float:
    """Mean of a case's eigenvalue shifts over the modes, with its sign."""
    return float(np.mean(eigenvalue_shifts(results, case, over)))


def smallest_mean_eigenvalue_shift(results: Results, cases: Sequence[str], over: str) -> float:
    """The smallest of the means of several cases."""
    return min(mean_eigenvalue_shift(results, case, over) for case in cases)


def shift_misfit(results: Results, case: str, over: str, element: str, printed_over: str) -> float:
    """Root mean square over the modes of computed less printed shift, in per cent points."""
    return _rms(
        [
            eigenvalue_shift(results, case, over, mode)
            - printed_shift(results, element, printed_over, mode)
            for mode in _MODES
        ]
    )


def largest_relative_shift_misfit(
    results: Results, case: str, over: str, element: str, printed_over: str
) -> float:
    """Largest |computed less printed shift| over the printed one, over the modes."""
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
    """Smallest misfit among other cases less the largest among the cases, in per cent points."""

    def misfits(selection: Selection) -> list[float]:
        stored_results = select_results(results, "7.5", selection)
        return [
            shift_misfit(results, stored.case, over, element, printed_over)
            for stored in stored_results
        ]

    return min(misfits(others)) - max(misfits(cases))


def eigenvalue_deviation_from_printed(
    results: Results, case: str, element: str, mode: int
) -> float:
    """Relative distance of a computed eigenvalue from a printed one, in per cent."""
    return 100 * (results.scalar(f"7.5/{case}", f"omega2_{mode}") / TABLE_1[element][mode - 1] - 1)


def largest_deviation_from_printed(results: Results, case: str, element: str) -> float:
    """Largest size of it over the modes."""
    return max(
        abs(eigenvalue_deviation_from_printed(results, case, element, mode)) for mode in _MODES
    )


def blind_test_scalar(results: Results, row: str, name: str) -> float:
    """Number of Table 1's blind test.

    Args:
        results: the stored results.
        row: "six" or "eight" nodes, or "both" (all twelve shifts).
        name: as in `study.paper.table_1.inverse.judge_row`.
    """
    return results.scalar("7.5/blind", f"{row}_{name}")


def largest_shift_odds(results: Results) -> float:
    """Largest odds against chance of the user elements' rows of shifts and of all twelve shifts."""
    return max(blind_test_scalar(results, row, "odds") for row in ("six", "eight", "both"))


def column_height(results: Results, reading: str) -> float:
    """Height in m at which the column's first eigenvalue is CAX8's, printed number for number.

    `reading` is "mixed" (kN with kg) or "SI".
    """
    case = {"mixed": "galerkin-Q8", "SI": "galerkin-Q8-SI"}[reading]
    height = results.curves("7.5/galerkin-Q8")["nodes"][:, 1].max()
    ratio = results.scalar(f"7.5/{case}", "omega2_1") / TABLE_1["CAX8"][0]
    return float(height * np.sqrt(ratio))


def farthest_sawtooth(results: Results, element: str, value: float) -> float:
    """Mid-side over corner force, on that surface where it is farthest from a value."""
    ratios = [results.scalar(f"7.5/{element}", f"sawtooth_{surface}") for surface in (1, 2, 3, 4)]
    return max(ratios, key=lambda ratio: abs(ratio - value))


def surface_force_percent(results: Results, key: str, surface: int) -> float:
    """Part of the force on surface 4 that a surface carries, in per cent."""
    force = results.scalar(key, f"force_normal_{surface}")
    return 100 * force / results.scalar(key, "force_normal_4")


def column_force_imbalance(results: Results) -> float:
    """Largest relative difference of the forces below and on top of the column, all elements."""
    return max(
        abs(
            sum(surface_force_percent(results, stored.key, surface) for surface in (1, 2, 3)) / 100
            - 1
        )
        for stored in load_section_results(results, "7.5")
        if "force_normal_4" in stored.scalars
    )


def column_transfer_defect(results: Results, component: str) -> float:
    """T times the standard triangle's nodal forces against the new one's, on all four surfaces.

    Largest difference in per cent of the surface's mean normal force of a node.
    """
    galerkin, pw = (results.curves(f"7.5/{element}") for element in T6_ELEMENTS)
    return max(
        100
        * np.abs(galerkin[f"{component}_T_{surface}"] - pw[f"{component}_{surface}"]).max()
        / pw[f"force_n_{surface}"].mean()
        for surface in (1, 2, 3, 4)
    )


def axis_force_ratio(results: Results, element: str) -> float:
    """Largest normal force of a node on the axis over the mean of its surface's nodes."""
    curves = results.curves(f"7.5/{element}")
    return float(
        max(
            curves[f"force_n_{surface}"][0] / curves[f"force_n_{surface}"].mean()
            for surface in (1, 4)
        )
    )


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))

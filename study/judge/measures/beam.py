"""Measures of section 7.6."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from study.judge.measures.stored_cases import T6_ELEMENTS, load_section_results, select_results
from study.paper.items import TABLE_2
from study.run.store import Results, StoredResult


def printed_critical_stress(results: Results, element: str, mode: int) -> float:
    """A critical stress of Table 2 as printed."""
    return TABLE_2[element][mode - 1]


def printed_euler_difference(results: Results, element: str, mode: int) -> float:
    """How far a printed critical stress lies below Euler's printed one, in per cent of it."""
    euler = TABLE_2["Euler"][mode - 1]
    return 100 * (euler - TABLE_2[element][mode - 1]) / euler


def printed_deviation_from_exact(
    results: Results, element: str, mode: int, reference: str
) -> float:
    """Relative distance of a printed critical stress from an exact one, in per cent."""
    exact = results.scalar("7.6/exact", f"{reference}_{mode}")
    return 100 * (TABLE_2[element][mode - 1] / exact - 1)


def computed_deviation_from_printed(results: Results, case: str, element: str, mode: int) -> float:
    """Relative distance of a computed critical stress from a printed one, in per cent."""
    computed = results.scalar(f"7.6/{case}", f"sigma_cr_{mode}")
    return 100 * (computed / TABLE_2[element][mode - 1] - 1)


def computed_stress_difference(results: Results, case: str, over: str, mode: int) -> float:
    """Relative distance of two computed critical stresses, in per cent."""
    name = f"sigma_cr_{mode}"
    return 100 * (results.scalar(f"7.6/{case}", name) / results.scalar(f"7.6/{over}", name) - 1)


def printed_stress_difference(results: Results, element: str, over: str, mode: int) -> float:
    """Relative distance of two printed critical stresses, in per cent."""
    return 100 * (TABLE_2[element][mode - 1] / TABLE_2[over][mode - 1] - 1)


def stress_difference_misfit(
    results: Results, case: str, over: str, element: str, printed_over: str, mode: int
) -> float:
    """Computed less printed relative distance of two critical stresses, in per cent points."""
    computed_difference = computed_stress_difference(results, case, over, mode)
    return computed_difference - printed_stress_difference(results, element, printed_over, mode)


def printed_offset_from_mean(
    results: Results, element: str, ends: Sequence[str], mode: int
) -> float:
    """Distance of a printed critical stress from the mean of two others, over half of theirs."""
    stress, first_stress, second_stress = (TABLE_2[name][mode - 1] for name in (element, *ends))
    return abs(2 * stress - first_stress - second_stress) / abs(first_stress - second_stress)


def exact_stress_difference(results: Results, name: str, over: str, mode: int) -> float:
    """Relative distance of two reference values, in per cent."""
    stress = results.scalar("7.6/exact", f"{name}_{mode}")
    return 100 * (stress / results.scalar("7.6/exact", f"{over}_{mode}") - 1)


def uniform_load_divisions(results: Results, case: str) -> list[tuple[int, int]]:
    """Divisions of the uniform-load cases that treat a beam as this case does, coarse to fine."""
    stored_results = _uniform_load_results(results, **_element_and_form(results, case))
    return [(nx, ny) for nx, ny in (stored.parameters["divisions"] for stored in stored_results)]


def uniform_load_errors(results: Results, case: str, mode: int) -> list[float]:
    """Relative errors of the same cases against the exact value of their form."""
    return _critical_stress_errors(results, mode, **_element_and_form(results, case))


def _element_and_form(results: Results, case: str) -> dict[str, Any]:
    """What a beam's result depends on besides load, supports and mesh."""
    parameters = results[f"7.6/{case}"].parameters
    return {name: parameters[name] for name in ("element", "form", "prestress_symmetrised")}


def _uniform_load_results(results: Results, **treatment: object) -> list[StoredResult]:
    stored_results = select_results(
        results, "7.6", {"problem": "beam", "load": "uniform", **treatment}
    )
    return sorted(stored_results, key=lambda stored: stored.parameters["divisions"])


def _critical_stress_errors(
    results: Results, mode: int, form: str, **treatment: object
) -> list[float]:
    exact_stress = results.scalar("7.6/exact", f"{form}_{mode}")
    stored_results = _uniform_load_results(results, form=form, **treatment)
    return [stored.scalars[f"sigma_cr_{mode}"] / exact_stress - 1 for stored in stored_results]


def finest_error(results: Results, case: str) -> float:
    """Larger of both modes' relative errors on the finest uniform-load mesh, in per cent."""
    return 100 * max(abs(uniform_load_errors(results, case, mode)[-1]) for mode in (1, 2))


def finest_squares_over_height(results: Results, case: str) -> float:
    """Squares over the beam's height on the finest uniform-load mesh."""
    return float(uniform_load_divisions(results, case)[-1][1])


def signed_error(results: Results, case: str, mode: int) -> float:
    """Relative error of a mode on the finest uniform-load mesh with its sign, in per cent."""
    return 100 * uniform_load_errors(results, case, mode)[-1]


def convergence_order(results: Results, case: str, mode: int) -> float:
    """Observed order in the element size between the two finest uniform-load meshes."""
    coarse, fine = uniform_load_errors(results, case, mode)[-2:]
    return float(np.log2(abs(coarse / fine)))


def pw_galerkin_difference(results: Results, form: str) -> float:
    """Largest relative difference of pw-T6 and galerkin-T6 under uniform load, all meshes."""
    return max(
        abs(galerkin_error - pw_error)
        for mode in (1, 2)
        for galerkin_error, pw_error in zip(
            *(
                _critical_stress_errors(results, mode, form, element=element)
                for element in T6_ELEMENTS
            ),
            strict=True,
        )
    )


def largest_imaginary(results: Results) -> float:
    """Largest |Im| over |Re| of all computed buckling factors."""
    imaginary_parts = [
        stored.scalars[f"imaginary_{mode}"]
        for stored in load_section_results(results, "7.6")
        if "imaginary_1" in stored.scalars
        for mode in (1, 2)
    ]
    return max(imaginary_parts)


def best_model_deviation(results: Results, row: str, mode: int) -> float:
    """Relative distance of the nearest model of a row of Table 2 from the print, in per cent.

    Args:
        results: the stored results.
        row: "cps6" or "user".
        mode: 1 or 2.
    """
    stress = results.scalar("7.6/inverse", f"sigma_cr_{row}_{mode}")
    return 100 * (stress / TABLE_2[_PRINTED_ROW_NAMES[row]][mode - 1] - 1)


_PRINTED_ROW_NAMES = {"cps6": "CPS6", "user": "6-node user element"}


def inverse_problem_scalar(results: Results, row: str, group: str, name: str) -> float:
    """Number of the inverse problem: of the nearest model, or of all models of a group.

    Args:
        results: the stored results.
        row: "cps6", "user" or "both" (all four values).
        group: "all", "corner" or "midside", the node at which the load acts.
        name: as in `study.paper.table_2.inverse.judge_row`.
    """
    return results.scalar("7.6/inverse", f"{row}_{group}_{name}")


def largest_odds(results: Results) -> float:
    """Largest odds against chance of the best models of CPS6, user element and all four values."""
    return max(
        inverse_problem_scalar(results, row, "all", "odds") for row in (*_PRINTED_ROW_NAMES, "both")
    )


def stress_change_by_weights(results: Results, group: str, name: str, mode: int) -> float:
    """Change of a critical stress by the weight functions alone in a group of models, in per cent.

    Args:
        results: the stored results.
        group: "corner" or "midside", the node at which the load acts.
        name: "least", "largest" or "median".
        mode: 1 or 2.
    """
    return results.scalar("7.6/inverse", f"weights_{group}_{name}_{mode}")

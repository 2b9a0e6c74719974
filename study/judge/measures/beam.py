"""Measures for section 7.6 (buckling of a beam)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from study.judge.measures.stored_cases import T6_ELEMENTS, load_section_results, select_results
from study.paper.items import TABLE_2
from study.run.store import Results, StoredResult


def printed_critical_stress(results: Results, element: str, mode: int) -> float:
    """Return a critical stress as printed in Table 2."""
    return TABLE_2[element][mode - 1]


def printed_euler_difference(results: Results, element: str, mode: int) -> float:
    """Return how far a printed critical stress lies below the printed Euler stress, in per cent."""
    euler = TABLE_2["Euler"][mode - 1]
    return 100 * (euler - TABLE_2[element][mode - 1]) / euler


def printed_deviation_from_exact(
    results: Results, element: str, mode: int, reference: str
) -> float:
    """Return the relative deviation of a printed from an exact critical stress, in per cent."""
    exact = results.scalar("7.6/exact", f"{reference}_{mode}")
    return 100 * (TABLE_2[element][mode - 1] / exact - 1)


def computed_deviation_from_printed(results: Results, case: str, element: str, mode: int) -> float:
    """Return the relative deviation of a computed from a printed critical stress, in per cent."""
    computed = results.scalar(f"7.6/{case}", f"sigma_cr_{mode}")
    return 100 * (computed / TABLE_2[element][mode - 1] - 1)


def computed_stress_difference(results: Results, case: str, over: str, mode: int) -> float:
    """Return the relative difference between two computed critical stresses, in per cent."""
    name = f"sigma_cr_{mode}"
    return 100 * (results.scalar(f"7.6/{case}", name) / results.scalar(f"7.6/{over}", name) - 1)


def printed_stress_difference(results: Results, element: str, over: str, mode: int) -> float:
    """Return the relative difference between two printed critical stresses, in per cent."""
    return 100 * (TABLE_2[element][mode - 1] / TABLE_2[over][mode - 1] - 1)


def stress_difference_misfit(
    results: Results, case: str, over: str, element: str, printed_over: str, mode: int
) -> float:
    """Return the computed minus the printed relative difference of two critical stresses.

    The unit is percentage points.
    """
    computed_difference = computed_stress_difference(results, case, over, mode)
    return computed_difference - printed_stress_difference(results, element, printed_over, mode)


def printed_offset_from_mean(
    results: Results, element: str, ends: Sequence[str], mode: int
) -> float:
    """Return the distance of a printed critical stress from the mean of two other printed ones.

    The distance is divided by half the difference of the other two.
    """
    stress, first_stress, second_stress = (TABLE_2[name][mode - 1] for name in (element, *ends))
    return abs(2 * stress - first_stress - second_stress) / abs(first_stress - second_stress)


def exact_stress_difference(results: Results, name: str, over: str, mode: int) -> float:
    """Return the relative difference between two reference values, in per cent."""
    stress = results.scalar("7.6/exact", f"{name}_{mode}")
    return 100 * (stress / results.scalar("7.6/exact", f"{over}_{mode}") - 1)


def uniform_load_divisions(results: Results, case: str) -> list[tuple[int, int]]:
    """Return the mesh divisions of the uniform-load cases with the element and form of a case.

    They are sorted from the coarsest to the finest mesh.
    """
    stored_results = _uniform_load_results(results, **_element_and_form(results, case))
    return [(nx, ny) for nx, ny in (stored.parameters["divisions"] for stored in stored_results)]


def uniform_load_errors(results: Results, case: str, mode: int) -> list[float]:
    """Return the relative errors of the cases of `uniform_load_divisions` for a buckling mode."""
    return _critical_stress_errors(results, mode, **_element_and_form(results, case))


def _element_and_form(results: Results, case: str) -> dict[str, Any]:
    """Return the parameters of a beam's result other than load, supports and mesh."""
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
    """Return the larger error of the two modes on the finest uniform-load mesh, in per cent."""
    return 100 * max(abs(uniform_load_errors(results, case, mode)[-1]) for mode in (1, 2))


def finest_squares_over_height(results: Results, case: str) -> float:
    """Return the number of squares along the height of the finest uniform-load mesh."""
    return float(uniform_load_divisions(results, case)[-1][1])


def signed_error(results: Results, case: str, mode: int) -> float:
    """Return the signed relative error of a mode on the finest uniform-load mesh, in per cent."""
    return 100 * uniform_load_errors(results, case, mode)[-1]


def convergence_order(results: Results, case: str, mode: int) -> float:
    """Return the observed order of convergence between the two finest uniform-load meshes."""
    coarse, fine = uniform_load_errors(results, case, mode)[-2:]
    return float(np.log2(abs(coarse / fine)))


def pw_galerkin_difference(results: Results, form: str) -> float:
    """Return the largest relative difference between pw-T6 and galerkin-T6 under uniform load.

    The maximum is taken over both modes and all meshes.
    """
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
    """Return the largest ratio |Im|/|Re| of all computed buckling factors."""
    imaginary_parts = [
        stored.scalars[f"imaginary_{mode}"]
        for stored in load_section_results(results, "7.6")
        if "imaginary_1" in stored.scalars
        for mode in (1, 2)
    ]
    return max(imaginary_parts)


def best_model_deviation(results: Results, row: str, mode: int) -> float:
    """Return the relative deviation of the nearest model from a row of Table 2, in per cent.

    Args:
        results: the stored results.
        row: "cps6" or "user".
        mode: 1 or 2.
    """
    stress = results.scalar("7.6/inverse", f"sigma_cr_{row}_{mode}")
    return 100 * (stress / TABLE_2[_PRINTED_ROW_NAMES[row]][mode - 1] - 1)


_PRINTED_ROW_NAMES = {"cps6": "CPS6", "user": "6-node user element"}


def inverse_problem_scalar(results: Results, row: str, group: str, name: str) -> float:
    """Return a number of the inverse problem, for the nearest model or all models of a group.

    Args:
        results: the stored results.
        row: "cps6", "user" or "both" (all four values).
        group: type of the node at which the load acts: "all", "corner" or "midside".
        name: name of the number, see `study.paper.table_2.inverse.judge_row`.
    """
    return results.scalar("7.6/inverse", f"{row}_{group}_{name}")


def largest_odds(results: Results) -> float:
    """Return the largest odds against chance of the best models.

    There is one best model each for CPS6, for the user element and for all four values.
    """
    return max(
        inverse_problem_scalar(results, row, "all", "odds") for row in (*_PRINTED_ROW_NAMES, "both")
    )


def stress_change_by_weights(results: Results, group: str, name: str, mode: int) -> float:
    """Return the change of a critical stress due to the weight functions alone, in per cent.

    Args:
        results: the stored results.
        group: group of models, by the node at which the load acts: "corner" or "midside".
        name: statistic over the group: "least", "largest" or "median".
        mode: 1 or 2.
    """
    return results.scalar("7.6/inverse", f"weights_{group}_{name}_{mode}")

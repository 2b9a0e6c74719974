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
    """Return the relative difference of a printed critical stress from the printed Euler stress.

    The unit is per cent; the sign is positive if the critical stress is below the Euler stress.
    """
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
    """Return the offset of a printed critical stress from the mean of two others in Table 2.

    The absolute offset is divided by half the difference of the two others, whose rows are `ends`.
    """
    stress, first_stress, second_stress = (TABLE_2[name][mode - 1] for name in (element, *ends))
    return abs(2 * stress - first_stress - second_stress) / abs(first_stress - second_stress)


def exact_stress_difference(results: Results, name: str, over: str, mode: int) -> float:
    """Return the relative difference between two reference values, in per cent."""
    stress = results.scalar("7.6/exact", f"{name}_{mode}")
    return 100 * (stress / results.scalar("7.6/exact", f"{over}_{mode}") - 1)


def mesh_divisions_of_uniform_load_cases(results: Results, case: str) -> list[tuple[int, int]]:
    """Return the mesh divisions (nx, ny) of a mesh series of the beam under uniform load.

    The series has the element and the form of the geometric stiffness of the given case. It is
    sorted from the coarsest to the finest mesh.
    """
    stored_results = _uniform_load_results_by_mesh(
        results, **_element_form_and_symmetrisation_of_case(results, case)
    )
    return [(nx, ny) for nx, ny in (stored.parameters["divisions"] for stored in stored_results)]


def stress_errors_of_uniform_load_cases(results: Results, case: str, mode: int) -> list[float]:
    """Return the relative errors of a critical stress on the meshes of uniform-load cases."""
    return _uniform_load_stress_errors_by_mesh(
        results, mode, **_element_form_and_symmetrisation_of_case(results, case)
    )


def _element_form_and_symmetrisation_of_case(results: Results, case: str) -> dict[str, Any]:
    """Return element, form of the geometric stiffness and symmetrisation of a beam's case."""
    parameters = results[f"7.6/{case}"].parameters
    return {name: parameters[name] for name in ("element", "form", "prestress_symmetrised")}


def _uniform_load_results_by_mesh(
    results: Results, **required_parameters: object
) -> list[StoredResult]:
    stored_results = select_results(
        results, "7.6", {"problem": "beam", "load": "uniform", **required_parameters}
    )
    return sorted(stored_results, key=lambda stored: stored.parameters["divisions"])


def _uniform_load_stress_errors_by_mesh(
    results: Results, mode: int, form: str, **required_parameters: object
) -> list[float]:
    exact_stress = results.scalar("7.6/exact", f"{form}_{mode}")
    stored_results = _uniform_load_results_by_mesh(results, form=form, **required_parameters)
    return [stored.scalars[f"sigma_cr_{mode}"] / exact_stress - 1 for stored in stored_results]


def finest_error(results: Results, case: str) -> float:
    """Return the larger error of the two modes on the finest uniform-load mesh, in per cent."""
    return 100 * max(
        abs(stress_errors_of_uniform_load_cases(results, case, mode)[-1]) for mode in (1, 2)
    )


def finest_squares_over_height(results: Results, case: str) -> float:
    """Return the number of squares along the height of the beam on the finest uniform-load mesh."""
    return float(mesh_divisions_of_uniform_load_cases(results, case)[-1][1])


def signed_error(results: Results, case: str, mode: int) -> float:
    """Return the signed relative error of a critical stress on the finest uniform-load mesh.

    The unit is per cent.
    """
    return 100 * stress_errors_of_uniform_load_cases(results, case, mode)[-1]


def convergence_order(results: Results, case: str, mode: int) -> float:
    """Return the observed order of a critical stress on the two finest meshes under uniform load.

    The meshes differ by a factor of two.
    """
    coarse, fine = stress_errors_of_uniform_load_cases(results, case, mode)[-2:]
    return float(np.log2(abs(coarse / fine)))


def pw_galerkin_difference(results: Results, form: str) -> float:
    """Return the largest difference of the relative errors of pw-T6 and galerkin-T6, uniform load.

    The maximum is taken over both modes and all meshes.
    """
    return max(
        abs(galerkin_error - pw_error)
        for mode in (1, 2)
        for galerkin_error, pw_error in zip(
            *(
                _uniform_load_stress_errors_by_mesh(results, mode, form, element=element)
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
    """Return the relative deviation from a printed critical stress, in per cent, of the best model.

    The best model comes nearest to a row of Table 2; see `study.paper.table_2.inverse`.

    Args:
        results: the stored results.
        row: "cps6" or "user".
        mode: 1 or 2.
    """
    stress = results.scalar("7.6/inverse", f"sigma_cr_{row}_{mode}")
    return 100 * (stress / TABLE_2[_PRINTED_ROW_NAMES[row]][mode - 1] - 1)


_PRINTED_ROW_NAMES = {"cps6": "CPS6", "user": "6-node user element"}


def inverse_problem_scalar(results: Results, row: str, group: str, name: str) -> float:
    """Return a stored scalar of the search for models that give the printed values of Table 2.

    Args:
        results: the stored results.
        row: "cps6", "user" or "both" (all four values).
        group: type of the node at which the load acts: "all", "corner" or "midside".
        name: name of the number, see `study.paper.table_2.inverse.judge_row`.
    """
    return results.scalar("7.6/inverse", f"{row}_{group}_{name}")


def stress_change_by_weights(results: Results, group: str, name: str, mode: int) -> float:
    """Return the change of a critical stress due to the weight functions alone, in per cent.

    Args:
        results: the stored results.
        group: models in which the load acts at a "corner" or at a "midside" node.
        name: statistic over these models: "least", "largest" or "median".
        mode: 1 or 2.
    """
    return results.scalar("7.6/inverse", f"weights_{group}_{name}_{mode}")

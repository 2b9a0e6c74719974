"""Measures for sections whose problems have known solutions (C, V5, V6 and V8)."""

import re

import numpy as np

from study.judge.measures.stored_cases import (
    Selection,
    find_result_with_changed_parameters,
    select_results,
)
from study.run.cases import find_page_source
from study.run.pages import read_literal_constants
from study.run.store import Results, StoredResult

# Standard element with the same nodes as each new element
_STANDARD_ELEMENTS = {"pw-T6": "galerkin-T6", "pw-T10": "galerkin-T10"}


def greco_deviation(results: Results, cases: Selection, reference: str) -> float:
    """Return the largest deviation of the GRECO plate from reference displacements, in per cent.

    The maximum is taken over matching cases and the reference points; `reference` is "published" or
    "prototype".
    """
    return max(
        100 * abs(stored.scalars[f"u_{number}"] / displacement - 1)
        for stored in select_results(results, "V6", cases)
        for number, displacement in enumerate(_greco_reference_displacements(reference), start=1)
    )


def greco_reference_displacement(results: Results, place: int, reference: str) -> float:
    """Return the displacement of the GRECO plate in m at a reference point.

    Args:
        results: Not used.
        place: Number of the reference point, starting from 1.
        reference: "published" or "prototype".
    """
    return _greco_reference_displacements(reference)[place - 1]


def greco_change(results: Results, cases: Selection, other: str) -> float:
    """Return the largest relative change of the GRECO plate's displacements from another case.

    The maximum is taken over matching cases and the reference points, in per cent.
    """
    names = [
        f"u_{number}"
        for number, _ in enumerate(_greco_reference_displacements("published"), start=1)
    ]
    return max(
        100 * abs(stored.scalars[name] / results.scalar(f"V6/{other}", name) - 1)
        for stored in select_results(results, "V6", cases)
        for name in names
    )


def _greco_reference_displacements(reference: str) -> tuple[float, ...]:
    """Return the displacements in m that the page of section V6 lists for a reference."""
    constants = read_literal_constants(find_page_source("V6"))
    displacements: tuple[float, ...] = constants[f"{reference.upper()}_DISPLACEMENTS"]
    return displacements


def zone_end(results: Results, key: str, zone: str) -> float:
    """Return the position in mm up to which the GRECO plate is open, or from which it sticks.

    `zone` is "open" or "stick".
    """
    return 1e3 * results.scalar(key, {"open": "open_up_to", "stick": "sticking_from"}[zone])


def zone_shift(results: Results, key: str, other: str, zone: str) -> float:
    """Return the distance in mm between the values of `zone_end` in two cases."""
    return abs(zone_end(results, key, zone) - zone_end(results, other, zone))


def refinement_order(results: Results, element: str, name: str) -> float:
    """Return the observed order of an error of section V5, from the coarsest to the finest mesh."""
    stored_results = sorted(
        select_results(results, "V5", {"element": element, "far_field": True}),
        key=lambda stored: stored.scalars["element_size"],
    )
    sizes, errors = (
        [stored_results[i].scalars[name_of_scalar] for i in (0, -1)]
        for name_of_scalar in ("element_size", name)
    )
    return float(np.log(errors[1] / errors[0]) / np.log(sizes[1] / sizes[0]))


def largest_error_ratio(results: Results, settings: Selection, name: str) -> float:
    """Return the largest ratio of new to standard errors on the finest meshes of section C.

    New T6 and T10 are compared with standard ones. `settings` are parameters, or a regular
    expression for the part of the case's name after the element.
    """
    return max(
        new.scalars[name] / standard.scalars[name]
        for new, standard in _pair_new_and_standard_results(results, settings)
    )


def largest_ratio_on_meshes(results: Results, settings: Selection, name: str) -> float:
    """Return the largest ratio of new to standard errors over all meshes of section C."""
    return max(
        float((new.curves[name] / standard.curves[name]).max())
        for new, standard in _pair_new_and_standard_results(results, settings)
    )


def ratio_at_poissons_ratio(results: Results, settings: str, name: str, nu: float) -> float:
    """Return the largest ratio of new to standard errors at one Poisson's ratio of the scans.

    `settings` is a regular expression for the names of the scans.
    """
    ratios = []
    selection = {"problem": "scan", "setting": _list_matching_scan_settings(results, settings)}
    for new, standard in _pair_new_and_standard_results(results, selection):
        (index,) = np.flatnonzero(new.curves["nu"] == nu)
        ratios.append(float(new.curves[name][index] / standard.curves[name][index]))
    return max(ratios)


def _list_matching_scan_settings(results: Results, settings: str) -> list[str]:
    scans = select_results(results, "C", {"problem": "scan", "element": list(_STANDARD_ELEMENTS)})
    names = [stored.parameters["setting"] for stored in scans]
    return [name for name in names if re.fullmatch(settings, name)]


def _pair_new_and_standard_results(
    results: Results, settings: Selection
) -> list[tuple[StoredResult, StoredResult]]:
    """Return pairs of results of the new and the standard T6 or T10 in the same settings."""
    cases: Selection
    if isinstance(settings, str):
        cases = f"({'|'.join(_STANDARD_ELEMENTS)})-({settings})"
    else:
        cases = {**settings, "element": list(_STANDARD_ELEMENTS)}
    return [
        (
            new,
            find_result_with_changed_parameters(
                results, new, element=_STANDARD_ELEMENTS[new.parameters["element"]]
            ),
        )
        for new in select_results(results, "C", cases)
    ]


def eigenvalue_errors_on_finest_mesh(results: Results, key: str) -> np.ndarray:
    """Return the signed relative errors (modes,) of the eigenvalues on the finest mesh."""
    errors: np.ndarray = results.curves(key)["errors"][-1]
    return errors


def highest_mode_error(results: Results, key: str) -> float:
    """Return the largest signed error, negative if all eigenvalues are too small."""
    return float(eigenvalue_errors_on_finest_mesh(results, key).max())


def largest_mode_error_ratio(results: Results, key: str, other: str) -> float:
    """Return the largest ratio |error of case `key`| / |error of case `other`| over all modes.

    The errors are those of eigenvalues on the finest mesh.
    """
    return float(
        np.abs(
            eigenvalue_errors_on_finest_mesh(results, key)
            / eigenvalue_errors_on_finest_mesh(results, other)
        ).max()
    )


def finest_imaginary(results: Results, key: str) -> float:
    """Return the largest ratio |Im|/|Re| of the eigenvalues on the finest mesh."""
    return float(results.curves(key)["imaginaries"][-1])

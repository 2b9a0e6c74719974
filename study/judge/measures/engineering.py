"""Measures for section W: does the choice of the element change an engineer's answer?

An *answer* is a scalar that an application computes. A *reading* is a rule that gives contact
pressures from nodal forces. The *rank* of a mesh is its position in the order from coarse to fine,
starting from 0. The criteria were written down before the values that they judge were computed:

* An element's *band* on a mesh is derived from its answers on three meshes of the same size whose
  lines are shifted relative to each other: it is the middle of their range, plus and minus the
  width of the range. If answers were normally distributed, nine of ten meshes of that size would
  give an answer in the band.
* On a mesh, the answer *changes* if the bands of the two elements do not overlap and their middles
  differ by more than `MIN_RELEVANT_DIFFERENCE`.
* The *error band* contains the distances of all answers in the band from all values within the
  uncertainty of the reference. A ratio of errors is *resolved* if the error bands of the two
  elements do not overlap.

Pins use an older criterion, `answer_difference_over_error`: on the two coarser meshes, the two
answers differ by more than the smaller of their errors and by more than `MIN_RELEVANT_DIFFERENCE`.
"""

from collections.abc import Sequence

from study.run.store import MissingResult, Results, StoredResult

MIN_RELEVANT_DIFFERENCE = 0.01  # relative to the reference; smaller differences are irrelevant
UNBIASED_READINGS = (
    "own",
    "skip",
    "projected",
    "none",
)  # "none" is for problems that do not read pressures
COMMON_CODE_READINGS = ("skip", "neighbours", "tributary")
"""Pressure readings of common codes.

"skip" gives no pressure at nodes whose own weights vanish, "neighbours" gives the mean of the
adjacent nodes, and "tributary" divides the force by the tributary area.
"""
ELEMENT_PREFIXES = ("galerkin", "pw", "sibling")
SHIFT_SUFFIXES = ("before", "beyond")
Band = tuple[float, float]


# Bands


def answer_band_of_shifted_meshes(
    results: Results, problem: str, cell: str, name: str, new: bool, rank: int
) -> Band:
    """Return the band of an element's answers, divided by the reference, with its best reading.

    Args:
        results: stored results.
        problem: problem of section W.
        cell: "T6" or "T10".
        name: prefix of the answer, such as "stick_"; empty for the first answer.
        new: whether the element is the new one (its sibling in the impact problem); otherwise, it
            is the standard element.
        rank: position of the mesh in the order from coarse to fine, starting from 0.
    """
    reference, _ = reference_answer(results, problem, cell, name)
    reading = reading_with_smallest_errors(results, problem, cell, name, new)
    answers = _answers_on_three_shifted_meshes(results, problem, cell, name, new, rank, reading)
    return _widen_range_to_band([answer / reference for answer in answers])


def error_range_of_answer_band(
    results: Results, problem: str, cell: str, name: str, new: bool, rank: int
) -> Band:
    """Return the smallest and largest relative error of the answers in an element's band.

    See `answer_band_of_shifted_meshes` for the arguments.
    """
    return _error_range_of_band(
        results,
        problem,
        cell,
        name,
        answer_band_of_shifted_meshes(results, problem, cell, name, new, rank),
    )


def is_error_ratio_resolved(
    results: Results, problem: str, cell: str, name: str, rank: int
) -> bool:
    """Return whether the error bands of the standard and the new element do not overlap."""
    standard, new = (
        error_range_of_answer_band(results, problem, cell, name, is_new, rank)
        for is_new in (False, True)
    )
    return not _bands_overlap(standard, new)


def middle_distance(results: Results, problem: str, cell: str, name: str, rank: int) -> float:
    """Return the distance between the middles of both elements' bands, over the reference."""
    standard, new = (
        answer_band_of_shifted_meshes(results, problem, cell, name, is_new, rank)
        for is_new in (False, True)
    )
    return abs(sum(standard) - sum(new)) / 2


def answer_changes(results: Results, problem: str, cell: str, name: str, rank: int) -> bool:
    """Return whether the choice of the element changes an answer on a mesh.

    The docstring of this module defines the criterion.
    """
    standard, new = (
        answer_band_of_shifted_meshes(results, problem, cell, name, is_new, rank)
        for is_new in (False, True)
    )
    distance = middle_distance(results, problem, cell, name, rank)
    return not _bands_overlap(standard, new) and distance > MIN_RELEVANT_DIFFERENCE


def n_changed_answers(results: Results, rank: int, cell: str = "") -> float:
    """Return the number of answers that change on the meshes of a rank.

    `cell` is "T6" or "T10", or empty for both.
    """
    return float(
        sum(
            answer_changes(results, *answer, rank)
            for answer in _list_answer_keys_of_cell(results, cell)
        )
    )


def n_resolved_error_ratios(results: Results, rank: int, better: bool) -> float:
    """Return the number of resolved error ratios that favour one of the elements.

    The element is the new one if `better` is true, and the standard one otherwise.
    """
    count = 0
    for answer in list_answer_keys(results):
        standard, new = (
            error_range_of_answer_band(results, *answer, is_new, rank) for is_new in (False, True)
        )
        count += new[1] < standard[0] if better else standard[1] < new[0]
    return float(count)


def reading_with_smallest_errors(
    results: Results, problem: str, cell: str, name: str, new: bool
) -> str:
    """Return the reading with the smallest sum over all meshes of the largest error in the band."""
    meshes = _list_mesh_numbers(results, problem, cell)
    element = _element_name(problem, cell, new)
    shifted_results = results.where("W", problem="shifted", application=problem, element=element)
    candidates = sorted({stored.parameters["reading"] for stored in shifted_results})
    if not candidates:
        raise MissingResult(f"section W has no shifted {problem} of {element}: run ./run study W")
    reference, _ = reference_answer(results, problem, cell, name)

    def sum_largest_errors_over_meshes(reading: str) -> float:
        bands = [
            _widen_range_to_band(
                [
                    answer / reference
                    for answer in _answers_on_three_shifted_meshes(
                        results, problem, cell, name, new, rank, reading
                    )
                ]
            )
            for rank in range(len(meshes))
        ]
        return sum(_error_range_of_band(results, problem, cell, name, band)[1] for band in bands)

    return min(candidates, key=sum_largest_errors_over_meshes)


def reference_answer(results: Results, problem: str, cell: str, name: str) -> tuple[float, float]:
    """Return the reference value of an answer and its relative uncertainty."""
    scalars = results[f"W/reference-{problem}-{cell}"].scalars
    value = scalars[f"{name}answer"]
    return value, scalars[f"{name}answer_uncertainty"] / abs(value)


def reference_uncertainty(
    results: Results, problem: str = "", cell: str = "", name: str | None = None
) -> float:
    """Return the largest relative uncertainty of the references that match the arguments."""
    return max(
        reference_answer(results, *answer_key)[1]
        for answer_key in list_answer_keys(results)
        if problem in ("", answer_key[0])
        and cell in ("", answer_key[1])
        and name in (None, answer_key[2])
    )


def answer_errors_by_mesh(
    results: Results, problem: str, cell: str, name: str, readings: Sequence[str], new: bool = False
) -> list[float]:
    """Return the relative errors of an answer, from the coarsest to the finest mesh.

    On each mesh, the first available reading is used; meshes without any of them are omitted.
    """
    errors = []
    for mesh in _list_mesh_numbers(results, problem, cell):
        stored_results = _find_results_with_readings(
            results, problem, mesh, _element_name(problem, cell, new), readings
        )
        if stored_results:
            errors.append(_answer_error(results, stored_results[0], name))
    return errors


def reading_error(
    results: Results, problem: str, cell: str, name: str, reading: str, rank: int, new: bool = False
) -> float:
    """Return the relative error of an element's answer with one reading on the mesh of a rank."""
    return answer_errors_by_mesh(results, problem, cell, name, [reading], new)[rank]


def least_rule_error(results: Results, problem: str, cell: str, name: str = "") -> float:
    """Return the smallest relative error of the standard element with common readings.

    The minimum is taken over all meshes and `COMMON_CODE_READINGS`.
    """
    return min(_standard_errors_by_common_readings(results, problem, cell, name))


def largest_rule_error(results: Results, problem: str, cell: str, name: str = "") -> float:
    """Return the largest relative error of the standard element with common readings.

    The maximum is taken over all meshes and `COMMON_CODE_READINGS`.
    """
    return max(_standard_errors_by_common_readings(results, problem, cell, name))


def _standard_errors_by_common_readings(
    results: Results, problem: str, cell: str, name: str
) -> list[float]:
    # "skip" is not used for conductance: joints with vanishing own weights conduct nothing anyway
    rules = [rule for rule in COMMON_CODE_READINGS if (problem, rule) != ("conductance", "skip")]
    return [
        error
        for rule in rules
        for error in answer_errors_by_mesh(results, problem, cell, name, (rule,))
    ]


def _answers_on_three_shifted_meshes(
    results: Results, problem: str, cell: str, name: str, new: bool, rank: int, reading: str
) -> list[float]:
    mesh = _list_mesh_numbers(results, problem, cell)[rank]
    key = f"{problem}-{_element_name(problem, cell, new)}-{mesh}-{reading}"
    shifted = results[f"W/shifted-{key}"].scalars
    return [
        results.scalar(f"W/{key}", f"{name}answer"),
        *(shifted[f"{name}answer_{ending}"] for ending in SHIFT_SUFFIXES),
    ]


def _widen_range_to_band(values: Sequence[float]) -> Band:
    """Return the middle of the range of the values, minus and plus the width of the range."""
    low, high = min(values), max(values)
    return (low + high) / 2 - (high - low), (low + high) / 2 + (high - low)


def _error_range_of_band(results: Results, problem: str, cell: str, name: str, band: Band) -> Band:
    uncertainty = reference_answer(results, problem, cell, name)[1]
    low, high = band[0] - 1 - uncertainty, band[1] - 1 + uncertainty
    least_error = 0.0 if low <= 0 <= high else min(abs(low), abs(high))
    return least_error, max(abs(low), abs(high))


def _bands_overlap(first: Band, second: Band) -> bool:
    return first[0] <= second[1] and second[0] <= first[1]


# Differences on single meshes


def answer_difference_over_error(
    results: Results,
    problem: str,
    cell: str,
    name: str = "",
    readings: Sequence[str] = UNBIASED_READINGS,
) -> float:
    """Return the difference of the two elements' answers, divided by the smallest significant one.

    The divisor is the smaller of the two errors, but at least `MIN_RELEVANT_DIFFERENCE`. The
    smaller quotient of the two coarser meshes is returned.

    Args:
        results: stored results.
        problem: problem of section W.
        cell: "T6" or "T10".
        name: prefix of the answer, such as "stick_"; empty for the first answer.
        readings: readings from which the best one of each element is chosen.
    """
    ratios = []
    for mesh in _list_mesh_numbers(results, problem, cell)[:2]:
        pair = select_results_with_best_readings(results, problem, cell, mesh, name, readings)
        smaller_error = min(_answer_error(results, stored, name) for stored in pair)
        ratios.append(
            _relative_answer_difference(results, *pair, name)
            / max(smaller_error, MIN_RELEVANT_DIFFERENCE)
        )
    return min(ratios)


def answer_differences_by_mesh(
    results: Results, problem: str, cell: str, name: str = ""
) -> tuple[float, ...]:
    """Return the relative differences of the two elements' answers, from coarse to fine meshes."""
    return tuple(
        _relative_answer_difference(
            results, *select_results_with_best_readings(results, problem, cell, mesh, name), name
        )
        for mesh in _list_mesh_numbers(results, problem, cell)
    )


def n_distinct_answers(results: Results) -> float:
    """Return the number of answers that differ between the elements by more than both errors.

    They must do so on each of the two coarser meshes.
    """
    count = 0
    for problem, cell, name in list_answer_keys(results):
        pairs = [
            select_results_with_best_readings(results, problem, cell, mesh, name)
            for mesh in _list_mesh_numbers(results, problem, cell)[:2]
        ]
        count += all(
            _relative_answer_difference(results, *pair, name)
            > max(_answer_error(results, stored, name) for stored in pair)
            for pair in pairs
        )
    return float(count)


def select_results_with_best_readings(
    results: Results,
    problem: str,
    cell: str,
    mesh: int,
    name: str = "",
    readings: Sequence[str] = UNBIASED_READINGS,
) -> tuple[StoredResult, StoredResult]:
    """Return the results of the standard and the new element, each with its most accurate reading.

    In dynamics, the sibling (symmetric element with transferred weights) replaces the new element.

    Raises:
        MissingResult: if either result is missing.
    """
    best_results = [
        min(candidates, key=lambda stored: _answer_error(results, stored, name))
        for element in ELEMENT_PREFIXES
        if (
            candidates := _find_results_with_readings(
                results, problem, mesh, f"{element}-{cell}", readings
            )
        )
    ]
    if len(best_results) != 2:
        raise MissingResult(f"section W has no two elements' {problem} on {cell}, mesh {mesh}")
    return best_results[0], best_results[1]


def _answer_error(results: Results, stored: StoredResult, name: str) -> float:
    """Return the relative error of a stored answer."""
    problem, element = stored.parameters["problem"], stored.parameters["element"]
    reference, _ = reference_answer(results, problem, element.split("-")[1], name)
    return abs(stored.scalars[f"{name}answer"] / reference - 1)


def _relative_answer_difference(
    results: Results, standard: StoredResult, new: StoredResult, name: str
) -> float:
    """Return the difference of two answers, divided by their reference value."""
    cell = new.parameters["element"].split("-")[1]
    reference, _ = reference_answer(results, new.parameters["problem"], cell, name)
    return abs((standard.scalars[f"{name}answer"] - new.scalars[f"{name}answer"]) / reference)


def list_answer_keys(results: Results) -> list[tuple[str, str, str]]:
    """Return the problem, cell type and name prefix of every answer."""
    answer_keys = {
        (
            reference.parameters["application"],
            reference.parameters["cell"],
            name.removesuffix("answer"),
        )
        for reference in results.where("W", problem="reference")
        for name in reference.scalars
        if name.endswith("answer")
    }
    if not answer_keys:
        raise MissingResult("section W has no references: run ./run study W")
    return sorted(answer_keys)


def _list_answer_keys_of_cell(results: Results, cell: str) -> list[tuple[str, str, str]]:
    return [answer for answer in list_answer_keys(results) if cell in ("", answer[1])]


def _element_name(problem: str, cell: str, new: bool) -> str:
    return f"{('sibling' if problem == 'impact' else 'pw') if new else 'galerkin'}-{cell}"


def _find_results_with_readings(
    results: Results, problem: str, mesh: int, element: str, readings: Sequence[str]
) -> list[StoredResult]:
    parameters = {"problem": problem, "mesh": mesh, "reading": list(readings)}
    return results.where("W", **parameters, element=element)


def _list_mesh_numbers(results: Results, problem: str, cell: str) -> list[int]:
    """Return the numbers of the meshes, from the coarsest to the finest."""
    elements = [f"{element}-{cell}" for element in ELEMENT_PREFIXES]
    stored_results = results.where("W", problem=problem, element=elements)
    if not stored_results:
        raise MissingResult(f"section W has no {problem} on {cell}: run ./run study W")
    return sorted({int(stored.parameters["mesh"]) for stored in stored_results})

"""Section W: does the choice of the element change an engineer's answer?

Criteria, which were written down before the values that they judge:

* An element's *band* on a mesh contains its answers on three meshes of equal size whose lines are
  shifted against each other: middle of their range plus and minus the whole range. Were answers
  normally distributed, nine of ten meshes of that size would give one in the band.
* On a mesh the answer *changes* if the bands of both elements do not overlap and their middles
  differ by more than `MIN_RELEVANT_DIFFERENCE`.
* The band of an *error* contains the distances of all answers in the band from all values that the
  reference may have. A ratio of errors is *resolved* if their bands do not overlap.

Pins use an older criterion, `answer_difference_over_error`: both answers differ, on the two
coarser meshes, by more than the smaller of their errors and by more than `MIN_RELEVANT_DIFFERENCE`.
"""

from collections.abc import Sequence

from study.run.store import MissingResult, Results, StoredResult

MIN_RELEVANT_DIFFERENCE = 0.01  # of the reference: less is nobody's reason to change elements
UNBIASED_READINGS = (
    "own",
    "skip",
    "projected",
    "none",
)  # the last of problems that read no pressure
COMMON_CODE_READINGS = ("skip", "neighbours", "tributary")
"""Readings of common codes: no pressure where own weights vanish, mean of neighbours, force over
tributary area."""
ELEMENT_PREFIXES = ("galerkin", "pw", "sibling")
SHIFT_SUFFIXES = ("before", "beyond")
Band = tuple[float, float]


# Bands


def answer_band(results: Results, problem: str, cell: str, name: str, new: bool, rank: int) -> Band:
    """Return the band of an element's answers, relative to the reference, by its best reading.

    Args:
        results: stored ones.
        problem: of section W.
        cell: "T6" or "T10".
        name: prefix of the answer, such as "stick_"; empty for the first one.
        new: whether it is the new element (in impact its sibling), not the standard one.
        rank: of the mesh, 0 is the coarsest.
    """
    reference, _ = reference_answer(results, problem, cell, name)
    reading = best_reading(results, problem, cell, name, new)
    answers = _shifted_answers(results, problem, cell, name, new, rank, reading)
    return _band_of_values([answer / reference for answer in answers])


def error_band(results: Results, problem: str, cell: str, name: str, new: bool, rank: int) -> Band:
    """Return the least and the largest relative error in the band, see `answer_band`."""
    return _error_band(
        results, problem, cell, name, answer_band(results, problem, cell, name, new, rank)
    )


def is_resolved(results: Results, problem: str, cell: str, name: str, rank: int) -> bool:
    """Return whether the bands of both elements' errors do not overlap."""
    standard, new = (
        error_band(results, problem, cell, name, is_new, rank) for is_new in (False, True)
    )
    return not _bands_overlap(standard, new)


def middle_distance(results: Results, problem: str, cell: str, name: str, rank: int) -> float:
    """Return the distance of the middles of both elements' bands, relative to the reference."""
    standard, new = (
        answer_band(results, problem, cell, name, is_new, rank) for is_new in (False, True)
    )
    return abs(sum(standard) - sum(new)) / 2


def answer_changes(results: Results, problem: str, cell: str, name: str, rank: int) -> bool:
    """Return whether the answer changes on a mesh, as the head of this module defines it."""
    standard, new = (
        answer_band(results, problem, cell, name, is_new, rank) for is_new in (False, True)
    )
    distance = middle_distance(results, problem, cell, name, rank)
    return not _bands_overlap(standard, new) and distance > MIN_RELEVANT_DIFFERENCE


def n_changed_answers(results: Results, rank: int, cell: str = "") -> float:
    """Return how many answers change on the meshes of a rank, of one kind of cells or of both."""
    return float(
        sum(
            answer_changes(results, *answer, rank)
            for answer in _list_answers_of_cell(results, cell)
        )
    )


def n_disjoint_bands(results: Results, rank: int, cell: str = "") -> float:
    """Return how many answers have bands that do not overlap, however near they are."""
    bands = [
        [answer_band(results, *answer, is_new, rank) for is_new in (False, True)]
        for answer in _list_answers_of_cell(results, cell)
    ]
    return float(sum(not _bands_overlap(standard, new) for standard, new in bands))


def n_resolved_error_ratios(results: Results, rank: int, better: bool) -> float:
    """Return how many ratios of errors are resolved in favour of the new element, or against."""
    count = 0
    for answer in _list_answers(results):
        standard, new = (error_band(results, *answer, is_new, rank) for is_new in (False, True))
        count += new[1] < standard[0] if better else standard[1] < new[0]
    return float(count)


def largest_band_distance(results: Results, rank: int, cell: str = "") -> float:
    """Return the largest distance of the middles of both elements' bands."""
    return max(
        middle_distance(results, *answer, rank) for answer in _list_answers_of_cell(results, cell)
    )


def largest_possible_difference(results: Results, rank: int, cell: str = "") -> float:
    """Return the largest difference that two answers in both elements' bands can have."""
    largest = 0.0
    for answer in _list_answers_of_cell(results, cell):
        standard, new = (answer_band(results, *answer, is_new, rank) for is_new in (False, True))
        largest = max(largest, standard[1] - new[0], new[1] - standard[0])
    return largest


def best_reading(results: Results, problem: str, cell: str, name: str, new: bool) -> str:
    """Return the reading whose largest errors, over the band, are least in the mean of meshes."""
    meshes = _list_meshes(results, problem, cell)
    element = _element_name(problem, cell, new)
    shifted_results = results.where("W", problem="shifted", application=problem, element=element)
    candidates = sorted({stored.parameters["reading"] for stored in shifted_results})
    if not candidates:
        raise MissingResult(f"section W has no shifted {problem} of {element}: run ./run study W")
    reference, _ = reference_answer(results, problem, cell, name)

    def sum_of_largest_errors(reading: str) -> float:
        bands = [
            _band_of_values(
                [
                    answer / reference
                    for answer in _shifted_answers(results, problem, cell, name, new, rank, reading)
                ]
            )
            for rank in range(len(meshes))
        ]
        return sum(_error_band(results, problem, cell, name, band)[1] for band in bands)

    return min(candidates, key=sum_of_largest_errors)


def reference_answer(results: Results, problem: str, cell: str, name: str) -> tuple[float, float]:
    """Return the reference of an answer, and its uncertainty over it."""
    scalars = results[f"W/reference-{problem}-{cell}"].scalars
    value = scalars[f"{name}answer"]
    return value, scalars[f"{name}answer_uncertainty"] / abs(value)


def reference_uncertainty(
    results: Results, problem: str = "", cell: str = "", name: str | None = None
) -> float:
    """Return the largest relative uncertainty of references, of all or of those that are named."""
    return max(
        reference_answer(results, *answer_key)[1]
        for answer_key in _list_answers(results)
        if problem in ("", answer_key[0])
        and cell in ("", answer_key[1])
        and name in (None, answer_key[2])
    )


def reading_errors(
    results: Results, problem: str, cell: str, name: str, readings: Sequence[str], new: bool = False
) -> list[float]:
    """Return relative errors of an element on all meshes with the first of some readings."""
    errors = []
    for mesh in _list_meshes(results, problem, cell):
        stored_results = _find_results(
            results, problem, mesh, _element_name(problem, cell, new), readings
        )
        if stored_results:
            errors.append(_answer_error(results, stored_results[0], name))
    return errors


def reading_error(
    results: Results, problem: str, cell: str, name: str, reading: str, rank: int, new: bool = False
) -> float:
    """Return the relative error of an element with a reading on the mesh of a rank."""
    return reading_errors(results, problem, cell, name, [reading], new)[rank]


def least_rule_error_ratio(
    results: Results, cell: str, readings: Sequence[str], name: str = ""
) -> float:
    """Return the least ratio, over meshes and rules, of the standard element's wear to the new's.

    It is the rule's error, less the reference's uncertainty, over the largest error in the new
    element's band.
    """
    uncertainty = reference_answer(results, "wear", cell, name)[1]
    error_ratios = []
    for rank, mesh in enumerate(_list_meshes(results, "wear", cell)):
        new_error = error_band(results, "wear", cell, name, True, rank)[1]
        for reading in readings:
            (rule_result,) = _find_results(results, "wear", mesh, f"galerkin-{cell}", (reading,))
            error_ratios.append(
                (_answer_error(results, rule_result, name) - uncertainty) / new_error
            )
    return min(error_ratios)


def least_rule_error(results: Results, problem: str, cell: str, name: str = "") -> float:
    """Return the least error of the rules with the standard element, on all meshes."""
    return min(_rule_errors(results, problem, cell, name))


def largest_rule_error(results: Results, problem: str, cell: str, name: str = "") -> float:
    """Return the largest error of the rules with the standard element, on all meshes."""
    return max(_rule_errors(results, problem, cell, name))


def _rule_errors(results: Results, problem: str, cell: str, name: str) -> list[float]:
    # where own weights vanish joints conduct nothing, by the element's own functions
    rules = [rule for rule in COMMON_CODE_READINGS if (problem, rule) != ("conductance", "skip")]
    return [
        error for rule in rules for error in reading_errors(results, problem, cell, name, (rule,))
    ]


def _shifted_answers(
    results: Results, problem: str, cell: str, name: str, new: bool, rank: int, reading: str
) -> list[float]:
    mesh = _list_meshes(results, problem, cell)[rank]
    key = f"{problem}-{_element_name(problem, cell, new)}-{mesh}-{reading}"
    shifted = results[f"W/shifted-{key}"].scalars
    return [
        results.scalar(f"W/{key}", f"{name}answer"),
        *(shifted[f"{name}answer_{ending}"] for ending in SHIFT_SUFFIXES),
    ]


def _band_of_values(values: Sequence[float]) -> Band:
    """Return the middle of the values' range, less and plus that range."""
    low, high = min(values), max(values)
    return (low + high) / 2 - (high - low), (low + high) / 2 + (high - low)


def _error_band(results: Results, problem: str, cell: str, name: str, band: Band) -> Band:
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
    """Difference of both elements' answers over what counts, on the mesh where it is less.

    Args:
        results: stored ones.
        problem: of section W.
        cell: "T6" or "T10".
        name: prefix of the answer, such as "stick_"; none of the first one.
        readings: among which an element has its best one.
    """
    ratios = []
    for mesh in _list_meshes(results, problem, cell)[:2]:
        pair = select_best_results(results, problem, cell, mesh, name, readings)
        smaller_error = min(_answer_error(results, stored, name) for stored in pair)
        ratios.append(
            _relative_answer_difference(results, *pair, name)
            / max(smaller_error, MIN_RELEVANT_DIFFERENCE)
        )
    return min(ratios)


def answer_differences(
    results: Results, problem: str, cell: str, name: str = ""
) -> tuple[float, ...]:
    """Relative differences of both elements' answers, from the coarsest to the finest mesh."""
    return tuple(
        _relative_answer_difference(
            results, *select_best_results(results, problem, cell, mesh, name), name
        )
        for mesh in _list_meshes(results, problem, cell)
    )


def largest_answer_difference(results: Results, finer: bool = True) -> float:
    """Largest relative difference of both elements' answers on the finer, or the coarser, mesh."""
    return max(
        answer_differences(results, *answer)[int(finer)] for answer in _list_answers(results)
    )


def n_distinct_answers(results: Results) -> float:
    """How many answers differ, on the two coarser meshes, by more than both elements' errors."""
    count = 0
    for problem, cell, name in _list_answers(results):
        pairs = [
            select_best_results(results, problem, cell, mesh, name)
            for mesh in _list_meshes(results, problem, cell)[:2]
        ]
        count += all(
            _relative_answer_difference(results, *pair, name)
            > max(_answer_error(results, stored, name) for stored in pair)
            for pair in pairs
        )
    return float(count)


def select_best_results(
    results: Results,
    problem: str,
    cell: str,
    mesh: int,
    name: str = "",
    readings: Sequence[str] = UNBIASED_READINGS,
) -> tuple[StoredResult, StoredResult]:
    """The standard element's result and the new one's (in dynamics the sibling's), best readings.

    Raises:
        MissingResult: if there is none.
    """
    best_results = [
        min(candidates, key=lambda stored: _answer_error(results, stored, name))
        for element in ELEMENT_PREFIXES
        if (candidates := _find_results(results, problem, mesh, f"{element}-{cell}", readings))
    ]
    if len(best_results) != 2:
        raise MissingResult(f"section W has no two elements' {problem} on {cell}, mesh {mesh}")
    return best_results[0], best_results[1]


def _answer_error(results: Results, stored: StoredResult, name: str) -> float:
    """Relative distance of a stored answer from its reference."""
    problem, element = stored.parameters["problem"], stored.parameters["element"]
    reference, _ = reference_answer(results, problem, element.split("-")[1], name)
    return abs(stored.scalars[f"{name}answer"] / reference - 1)


def _relative_answer_difference(
    results: Results, standard: StoredResult, new: StoredResult, name: str
) -> float:
    """Difference of two answers over their reference."""
    cell = new.parameters["element"].split("-")[1]
    reference, _ = reference_answer(results, new.parameters["problem"], cell, name)
    return abs((standard.scalars[f"{name}answer"] - new.scalars[f"{name}answer"]) / reference)


def _list_answers(results: Results) -> list[tuple[str, str, str]]:
    """Problem, cell and prefix of every answer."""
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


def _list_answers_of_cell(results: Results, cell: str) -> list[tuple[str, str, str]]:
    return [answer for answer in _list_answers(results) if cell in ("", answer[1])]


def _element_name(problem: str, cell: str, new: bool) -> str:
    return f"{('sibling' if problem == 'impact' else 'pw') if new else 'galerkin'}-{cell}"


def _find_results(
    results: Results, problem: str, mesh: int, element: str, readings: Sequence[str]
) -> list[StoredResult]:
    parameters = {"problem": problem, "mesh": mesh, "reading": list(readings)}
    return results.where("W", **parameters, element=element)


def _list_meshes(results: Results, problem: str, cell: str) -> list[int]:
    """Meshes from the coarsest to the finest."""
    elements = [f"{element}-{cell}" for element in ELEMENT_PREFIXES]
    stored_results = results.where("W", problem=problem, element=elements)
    if not stored_results:
        raise MissingResult(f"section W has no {problem} on {cell}: run ./run study W")
    return sorted({int(stored.parameters["mesh"]) for stored in stored_results})

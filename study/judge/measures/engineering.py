"""Section W: does the choice of the element change an engineer's answer?

Criteria, which were written down before the values that they judge:

* An element's *band* on a mesh contains its answers on three meshes of equal size whose lines are
  shifted against each other: middle of their range plus and minus the whole range. Were answers
  normally distributed, nine of ten meshes of that size would give one in the band.
* On a mesh the answer *changes* if the bands of both elements do not overlap and their middles
  differ by more than `WORTH`.
* The band of an *error* contains the distances of all answers in the band from all values that the
  reference may have. A ratio of errors is *resolved* if their bands do not overlap.

Pins use an older criterion, `answer_change`: both answers differ, on the two coarser meshes, by
more than the smaller of their errors and by more than `WORTH`.
"""

from collections.abc import Sequence

from study.run.store import MissingResult, Results, StoredResult

WORTH = 0.01  # of the reference: less is nobody's reason to change elements
HONEST = ("own", "skip", "projected", "none")  # the last of problems that read no pressure
RULES = ("skip", "neighbours", "tributary")
"""Readings of common codes: no pressure where own weights vanish, mean of neighbours, force over
tributary area."""
ELEMENTS = ("galerkin", "pw", "sibling")
SHIFTS = ("before", "beyond")
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
    value, _ = reference_answer(results, problem, cell, name)
    reading = best_reading(results, problem, cell, name, new)
    stored = _shifted_answers(results, problem, cell, name, new, rank, reading)
    return _widen([answer / value for answer in stored])


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
    return not _overlap(standard, new)


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
    return not _overlap(standard, new) and distance > WORTH


def n_changes(results: Results, rank: int, cell: str = "") -> float:
    """Return how many answers change on the meshes of a rank, of one kind of cells or of both."""
    return float(sum(answer_changes(results, *one, rank) for one in _chosen(results, cell)))


def n_disjoint(results: Results, rank: int, cell: str = "") -> float:
    """Return how many answers have bands that do not overlap, however near they are."""
    bands = [
        [answer_band(results, *one, new, rank) for new in (False, True)]
        for one in _chosen(results, cell)
    ]
    return float(sum(not _overlap(standard, new) for standard, new in bands))


def n_resolved(results: Results, rank: int, better: bool) -> float:
    """Return how many ratios of errors are resolved in favour of the new element, or against."""
    count = 0
    for one in _answers(results):
        standard, new = (error_band(results, *one, is_new, rank) for is_new in (False, True))
        count += new[1] < standard[0] if better else standard[1] < new[0]
    return float(count)


def largest_band_distance(results: Results, rank: int, cell: str = "") -> float:
    """Return the largest distance of the middles of both elements' bands."""
    return max(middle_distance(results, *one, rank) for one in _chosen(results, cell))


def largest_possible_difference(results: Results, rank: int, cell: str = "") -> float:
    """Return the largest difference that two answers in both elements' bands can have."""
    largest = 0.0
    for one in _chosen(results, cell):
        standard, new = (answer_band(results, *one, is_new, rank) for is_new in (False, True))
        largest = max(largest, standard[1] - new[0], new[1] - standard[0])
    return largest


def best_reading(results: Results, problem: str, cell: str, name: str, new: bool) -> str:
    """Return the reading whose largest errors, over the band, are least in the mean of meshes."""
    meshes = _meshes(results, problem, cell)
    element = _element(problem, cell, new)
    found = results.where("W", problem="shifted", application=problem, element=element)
    candidates = sorted({one.parameters["reading"] for one in found})
    if not candidates:
        raise MissingResult(f"section W has no shifted {problem} of {element}: run ./run study W")
    value, _ = reference_answer(results, problem, cell, name)

    def largest_errors(reading: str) -> float:
        bands = [
            _widen(
                [
                    answer / value
                    for answer in _shifted_answers(results, problem, cell, name, new, rank, reading)
                ]
            )
            for rank in range(len(meshes))
        ]
        return sum(_error_band(results, problem, cell, name, band)[1] for band in bands)

    return min(candidates, key=largest_errors)


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
        reference_answer(results, *one)[1]
        for one in _answers(results)
        if problem in ("", one[0]) and cell in ("", one[1]) and name in (None, one[2])
    )


def reading_errors(
    results: Results, problem: str, cell: str, name: str, readings: Sequence[str], new: bool = False
) -> list[float]:
    """Return relative errors of an element on all meshes with the first of some readings."""
    errors = []
    for mesh in _meshes(results, problem, cell):
        stored = _find(results, problem, mesh, _element(problem, cell, new), readings)
        if stored:
            errors.append(_error(results, stored[0], name))
    return errors


def reading_error(
    results: Results, problem: str, cell: str, name: str, reading: str, rank: int, new: bool = False
) -> float:
    """Return the relative error of an element with a reading on the mesh of a rank."""
    return reading_errors(results, problem, cell, name, [reading], new)[rank]


def rule_error(results: Results, cell: str, readings: Sequence[str], name: str = "") -> float:
    """Return the least ratio, over meshes and rules, of the standard element's wear to the new's.

    It is the rule's error, less the reference's uncertainty, over the largest error in the new
    element's band.
    """
    uncertainty = reference_answer(results, "wear", cell, name)[1]
    ratios = []
    for rank, mesh in enumerate(_meshes(results, "wear", cell)):
        new = error_band(results, "wear", cell, name, True, rank)[1]
        for reading in readings:
            (stored,) = _find(results, "wear", mesh, f"galerkin-{cell}", (reading,))
            ratios.append((_error(results, stored, name) - uncertainty) / new)
    return min(ratios)


def least_rule_error(results: Results, problem: str, cell: str, name: str = "") -> float:
    """Return the least error of the rules with the standard element, on all meshes."""
    return min(_rule_errors(results, problem, cell, name))


def largest_rule_error(results: Results, problem: str, cell: str, name: str = "") -> float:
    """Return the largest error of the rules with the standard element, on all meshes."""
    return max(_rule_errors(results, problem, cell, name))


def _rule_errors(results: Results, problem: str, cell: str, name: str) -> list[float]:
    # where own weights vanish joints conduct nothing, by the element's own functions
    rules = [rule for rule in RULES if (problem, rule) != ("conductance", "skip")]
    return [
        error for rule in rules for error in reading_errors(results, problem, cell, name, (rule,))
    ]


def _shifted_answers(
    results: Results, problem: str, cell: str, name: str, new: bool, rank: int, reading: str
) -> list[float]:
    mesh = _meshes(results, problem, cell)[rank]
    key = f"{problem}-{_element(problem, cell, new)}-{mesh}-{reading}"
    shifted = results[f"W/shifted-{key}"].scalars
    return [
        results.scalar(f"W/{key}", f"{name}answer"),
        *(shifted[f"{name}answer_{ending}"] for ending in SHIFTS),
    ]


def _widen(values: Sequence[float]) -> Band:
    """Return the middle of the values' range, less and plus that range."""
    low, high = min(values), max(values)
    return (low + high) / 2 - (high - low), (low + high) / 2 + (high - low)


def _error_band(results: Results, problem: str, cell: str, name: str, band: Band) -> Band:
    uncertainty = reference_answer(results, problem, cell, name)[1]
    low, high = band[0] - 1 - uncertainty, band[1] - 1 + uncertainty
    least = 0.0 if low <= 0 <= high else min(abs(low), abs(high))
    return least, max(abs(low), abs(high))


def _overlap(one: Band, other: Band) -> bool:
    return one[0] <= other[1] and other[0] <= one[1]


# Differences on single meshes


def answer_change(
    results: Results, problem: str, cell: str, name: str = "", readings: Sequence[str] = HONEST
) -> float:
    """Difference of both elements' answers over what counts, on the mesh where it is less.

    Args:
        results: stored ones.
        problem: of section W.
        cell: "T6" or "T10".
        name: prefix of the answer, such as "stick_"; none of the first one.
        readings: among which an element has its best one.
    """
    changes = []
    for mesh in _meshes(results, problem, cell)[:2]:
        pair = answers(results, problem, cell, mesh, name, readings)
        better = min(_error(results, one, name) for one in pair)
        changes.append(_difference(results, *pair, name) / max(better, WORTH))
    return min(changes)


def differences(results: Results, problem: str, cell: str, name: str = "") -> tuple[float, ...]:
    """Relative differences of both elements' answers, from the coarsest to the finest mesh."""
    return tuple(
        _difference(results, *answers(results, problem, cell, mesh, name), name)
        for mesh in _meshes(results, problem, cell)
    )


def largest_difference(results: Results, finer: bool = True) -> float:
    """Largest relative difference of both elements' answers on the finer, or the coarser, mesh."""
    return max(differences(results, *one)[int(finer)] for one in _answers(results))


def answers_apart(results: Results) -> float:
    """How many answers differ, on the two coarser meshes, by more than both elements' errors."""
    count = 0
    for problem, cell, name in _answers(results):
        pairs = [
            answers(results, problem, cell, mesh, name)
            for mesh in _meshes(results, problem, cell)[:2]
        ]
        count += all(
            _difference(results, *pair, name) > max(_error(results, one, name) for one in pair)
            for pair in pairs
        )
    return float(count)


def answers(
    results: Results,
    problem: str,
    cell: str,
    mesh: int,
    name: str = "",
    readings: Sequence[str] = HONEST,
) -> tuple[StoredResult, StoredResult]:
    """The standard element's result and the new one's (in dynamics the sibling's), best readings.

    Raises:
        MissingResult: if there is none.
    """
    best = [
        min(found, key=lambda one: _error(results, one, name))
        for element in ELEMENTS
        if (found := _find(results, problem, mesh, f"{element}-{cell}", readings))
    ]
    if len(best) != 2:
        raise MissingResult(f"section W has no two elements' {problem} on {cell}, mesh {mesh}")
    return best[0], best[1]


def _error(results: Results, stored: StoredResult, name: str) -> float:
    """Relative distance of a stored answer from its reference."""
    problem, element = stored.parameters["problem"], stored.parameters["element"]
    value, _ = reference_answer(results, problem, element.split("-")[1], name)
    return abs(stored.scalars[f"{name}answer"] / value - 1)


def _difference(results: Results, standard: StoredResult, new: StoredResult, name: str) -> float:
    """Difference of two answers over their reference."""
    cell = new.parameters["element"].split("-")[1]
    value, _ = reference_answer(results, new.parameters["problem"], cell, name)
    return abs((standard.scalars[f"{name}answer"] - new.scalars[f"{name}answer"]) / value)


def _answers(results: Results) -> list[tuple[str, str, str]]:
    """Problem, cell and prefix of every answer."""
    found = {
        (one.parameters["application"], one.parameters["cell"], name.removesuffix("answer"))
        for one in results.where("W", problem="reference")
        for name in one.scalars
        if name.endswith("answer")
    }
    if not found:
        raise MissingResult("section W has no references: run ./run study W")
    return sorted(found)


def _chosen(results: Results, cell: str) -> list[tuple[str, str, str]]:
    return [one for one in _answers(results) if cell in ("", one[1])]


def _element(problem: str, cell: str, new: bool) -> str:
    return f"{('sibling' if problem == 'impact' else 'pw') if new else 'galerkin'}-{cell}"


def _find(
    results: Results, problem: str, mesh: int, element: str, readings: Sequence[str]
) -> list[StoredResult]:
    stated = {"problem": problem, "mesh": mesh, "reading": list(readings)}
    return results.where("W", **stated, element=element)


def _meshes(results: Results, problem: str, cell: str) -> list[int]:
    """Meshes from the coarsest to the finest."""
    elements = [f"{element}-{cell}" for element in ELEMENTS]
    found = results.where("W", problem=problem, element=elements)
    if not found:
        raise MissingResult(f"section W has no {problem} on {cell}: run ./run study W")
    return sorted({int(one.parameters["mesh"]) for one in found})

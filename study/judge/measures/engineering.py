"""Section W: does the choice of the element change an engineer's answer?

Of each problem one or several answers are stored, with a reference and the error, the distance
from it over its size. Both elements have their best honest reading on each of two meshes: that of
the smallest error among pressures over own weights and forces projected to linear functions.

The answer changes if both elements' answers differ, on both meshes, by more than the smaller of
their errors (the discretisation error of the mesh, by the element that is better there) and by
more than `WORTH`. Two answers on the same side of the reference never differ by more than the
larger error, so that "by more than both errors" would hold for opposite signs only.
"""

from collections.abc import Sequence

from study.run.store import MissingResult, Results, StoredResult

WORTH = 0.01  # of the reference: less is nobody's reason to change elements
HONEST = ("own", "skip", "projected", "none")  # the last of problems that read no pressure
ELEMENTS = ("galerkin", "pw", "sibling")


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
    for mesh in _meshes(results, problem, cell):
        pair = answers(results, problem, cell, mesh, name, readings)
        better = min(one.scalars[f"{name}error"] for one in pair)
        changes.append(_apart(*pair, name) / max(better, WORTH))
    return min(changes)


def best_error(
    results: Results, problem: str, cell: str, name: str, new: bool, finer: bool
) -> float:
    """Error of one of the elements on one of the meshes."""
    mesh = _meshes(results, problem, cell)[finer]
    return answers(results, problem, cell, mesh, name)[new].scalars[f"{name}error"]


def reference_error(results: Results) -> float:
    """Largest distance of either element from the mean of both on meshes that are references."""
    found = []
    for problem, cell, name in _answers(results):
        coarser = _meshes(results, problem, cell)
        for one in results.where("W", problem=problem):
            fine = one.parameters["mesh"] not in coarser
            if fine and one.parameters["element"].endswith(cell):
                found.append(one.scalars[f"{name}error"])
    return max(found)


def differences(results: Results, problem: str, cell: str, name: str = "") -> tuple[float, float]:
    """Relative differences of both elements' answers, on the coarser and the finer mesh."""
    coarse, fine = (
        _apart(*answers(results, problem, cell, mesh, name), name)
        for mesh in _meshes(results, problem, cell)
    )
    return coarse, fine


def largest_difference(results: Results, finer: bool = True) -> float:
    """Largest relative difference of both elements' answers on the finer, or the coarser, mesh."""
    return max(differences(results, *one)[finer] for one in _answers(results))


def answers_apart(results: Results) -> float:
    """How many answers differ, on both meshes, by more than the errors of both elements."""
    counted = 0
    for problem, cell, name in _answers(results):
        pairs = [
            answers(results, problem, cell, mesh, name) for mesh in _meshes(results, problem, cell)
        ]
        counted += all(
            _apart(*pair, name) > max(one.scalars[f"{name}error"] for one in pair) for pair in pairs
        )
    return float(counted)


def rule_error(results: Results, cell: str, readings: Sequence[str], name: str = "") -> float:
    """Smallest ratio, over rules for the standard element's wear and meshes, to the new's error."""
    ratios = []
    for mesh in _meshes(results, "wear", cell):
        new = answers(results, "wear", cell, mesh, name)[1]
        for reading in readings:
            found = _found(results, "wear", cell, mesh, "galerkin", (reading,))
            ratios.append(found[0].scalars[f"{name}error"] / new.scalars[f"{name}error"])
    return min(ratios)


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
        min(found, key=lambda one: one.scalars[f"{name}error"])
        for element in ELEMENTS
        if (found := _found(results, problem, cell, mesh, element, readings))
    ]
    if len(best) != 2:
        raise MissingResult(f"section W has no two elements' {problem} on {cell}, mesh {mesh}")
    return best[0], best[1]


def _apart(standard: StoredResult, new: StoredResult, name: str) -> float:
    """Relative difference of two answers."""
    apart = standard.scalars[f"{name}answer"] - new.scalars[f"{name}answer"]
    return abs(apart / new.scalars[f"{name}reference"])


def _answers(results: Results) -> list[tuple[str, str, str]]:
    """Problem, cell and prefix of every answer."""
    found = {
        (one.parameters["problem"], one.parameters["element"].split("-")[1], name[:-6])
        for one in results.section("W")
        for name in one.scalars
        if name.endswith("answer")
    }
    if not found:
        raise MissingResult("section W has no answers: run ./run study W")
    return sorted(found)


def _found(
    results: Results, problem: str, cell: str, mesh: int, element: str, readings: Sequence[str]
) -> list[StoredResult]:
    stated = {"problem": problem, "mesh": mesh, "reading": list(readings)}
    return results.where("W", **stated, element=f"{element}-{cell}")


def _meshes(results: Results, problem: str, cell: str) -> list[int]:
    """The two coarsest; a finer one is a reference."""
    elements = [f"{element}-{cell}" for element in ELEMENTS]
    found = results.where("W", problem=problem, element=elements)
    if not found:
        raise MissingResult(f"section W has no {problem} on {cell}: run ./run study W")
    return sorted({int(one.parameters["mesh"]) for one in found})[:2]

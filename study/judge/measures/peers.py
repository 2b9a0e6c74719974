"""Measures for section P, the comparison with an independent code, CalculiX."""

from collections.abc import Sequence

from study.judge.measures.stored_cases import load_section_results
from study.run.store import Results

CONTACT_PEERS = (
    "block-even",
    "block-part",
    "block-lifting",
    "block-friction-0.15",
    "block-friction-0.30",
)


def largest_peer_difference(
    results: Results, name: str, component: str, cases: Sequence[str] = CONTACT_PEERS
) -> float:
    """Return the largest difference of nodal forces from CalculiX, in per cent of the mean force.

    Args:
        results: Stored results.
        name: Kind of the difference, the first part of the scalar's name.
        component: Component of the forces, the last part of the scalar's name.
        cases: Names of cases of section P.
    """
    return 100 * max(
        value
        for case in cases
        for scalar, value in results[f"P/{case}"].scalars.items()
        if scalar == f"{name}_{component}"
    )


def peer_critical_stress_difference(results: Results, element: str) -> float:
    """Return the largest relative difference of critical stresses of an element from CalculiX."""
    beams = [
        stored
        for stored in load_section_results(results, "P")
        if f"difference_{element}" in stored.scalars
    ]
    return max(s.scalars[f"difference_{element}"] for s in beams)


def peer_standard_difference(
    results: Results, rule: str, name: str, cases: Sequence[str], best: bool = False
) -> float:
    """Return the largest relative difference between CalculiX and the standard elements.

    Args:
        results: stored results.
        rule: quadrature of the standard elements, "exact" or "reduced" (as in CalculiX).
        name: name of the numbers that are compared.
        cases: names of cases of section P.
        best: whether the smallest instead of the largest difference over the cases is returned.
    """
    differences = [results.scalar(f"P/{case}", f"{rule}_{name}") for case in cases]
    return min(differences) if best else max(differences)

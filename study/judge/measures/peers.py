"""Measures of the comparison with an independent code."""

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
    """Largest of one kind of difference from CalculiX, per cent of the mean nodal force."""
    return 100 * max(
        value
        for case in cases
        for scalar, value in results[f"P/{case}"].scalars.items()
        if scalar == f"{name}_{component}"
    )


def peer_critical_stress_difference(results: Results, element: str) -> float:
    """Largest relative difference of a critical stress from CalculiX's."""
    beams = [
        stored
        for stored in load_section_results(results, "P")
        if f"difference_{element}" in stored.scalars
    ]
    return max(s.scalars[f"difference_{element}"] for s in beams)


def peer_standard_difference(
    results: Results, rule: str, name: str, cases: Sequence[str], best: bool = False
) -> float:
    """Largest relative difference of CalculiX from the standard elements; or the smallest one.

    Args:
        results: of the study.
        rule: of our quadrature: "exact" or "reduced", which is CalculiX's.
        name: of the numbers that are compared.
        cases: of section P.
        best: whether it is the smallest of the cases' differences.
    """
    differences = [results.scalar(f"P/{case}", f"{rule}_{name}") for case in cases]
    return min(differences) if best else max(differences)

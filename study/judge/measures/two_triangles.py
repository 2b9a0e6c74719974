"""Measures for section 7.1 (two triangles)."""

import numpy as np

from study.judge.measures.stored_cases import select_results
from study.run.store import Results


def middle_over_side(results: Results, element: str) -> float:
    """Return the reaction at the central node, divided by the larger of the other two."""
    side_reactions = [results.scalar(f"7.1/{element}", f"reaction_{i}") for i in (0, 2)]
    return results.scalar(f"7.1/{element}", "reaction_1") / max(side_reactions)


def corner_over_midside(results: Results, element: str) -> float:
    """Return the ratio of the smallest corner to the largest mid-side reaction of a row of squares.

    The corners at both ends of the row are excluded.
    """
    reactions = results.curves(f"7.1/{element}-row")["reaction"]
    return float(reactions[2:-2:2].min() / reactions[1::2].max())


def reaction_spread(results: Results, element: str) -> float:
    """Return the largest change of a reaction with the material, stress state or diagonal."""
    reactions = np.array(
        [
            [stored.scalars[f"reaction_{i}"] for i in range(3)]
            for stored in select_results(results, "7.1", {"element": element, "squares": 1})
        ]
    )
    return float(np.ptp(reactions, axis=0).max())

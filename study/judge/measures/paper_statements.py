"""Measures of statements that the paper makes in passing: cost, and the shear of its Fig. 10."""

from typing import Literal

import numpy as np

from study.core.store import Results

FINE_PUNCH = "7.3/pw-T6-114x24"


def factor_entries_ratio(results: Results, key: str, other: str) -> float:
    """Entries of the factors of one case's matrix over those of another one's."""
    return results.scalar(key, "entries") / results.scalar(other, "entries")


def shear_off_fine(
    results: Results, key: str, within: float, kind: Literal["largest", "rms"] = "largest"
) -> float:
    """Shear over tributary lengths below the punch of section 7.3 against the fine mesh's.

    The fine mesh's traction is averaged over the same lengths. Nodes in |x| < `within`; in per
    cent of the fine mesh's largest shear.
    """
    ours, fine = results.curves(key), results.curves(FINE_PUNCH)
    x, shear = fine["x"], fine["shear"]
    integral = np.concatenate([[0.0], np.cumsum(np.diff(x) * (shear[1:] + shear[:-1]) / 2)])
    nodes = ours["x"]
    borders = np.concatenate([nodes[:1], (nodes[1:] + nodes[:-1]) / 2, nodes[-1:]])
    known = np.diff(np.interp(borders, x, integral)) / np.diff(borders)
    off = (ours["shear_tributary"] - known)[np.abs(nodes) < within]
    size = np.abs(off).max() if kind == "largest" else np.sqrt(np.mean(off**2))
    return float(100 * size / np.abs(shear).max())

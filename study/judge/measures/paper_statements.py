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


# Section, and the scalar of mid-side over corner force
_EXAMPLES = [(section, "sawtooth") for section in ("7.2", "7.3", "7.4")]
_EXAMPLES += [("7.5", f"sawtooth_{surface}") for surface in (1, 2, 3, 4)]
_STANDARD = ("galerkin-T6", "galerkin-Q8")


def corner_share_in_examples(results: Results) -> float:
    """Corner over mid-side force of the standard elements, where it is farthest from a half."""
    shares = [
        1 / results.scalar(f"{section}/{element}", name)
        for section, name in _EXAMPLES
        for element in _STANDARD
    ]
    return max(shares, key=lambda share: abs(share - 0.5))


def unevenness_of_standard(results: Results) -> float:
    """Largest unevenness of the standard elements' pressure over the node's own test function.

    Plane examples; in per cent of the pressure.
    """
    plane = [section for section, _ in _EXAMPLES if section != "7.5"]
    return 100 * max(
        results.scalar(f"{section}/{element}", "unevenness")
        for section in plane
        for element in _STANDARD
    )

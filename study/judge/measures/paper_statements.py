"""Measures of statements that the paper makes in passing: cost, and the shear of its Fig. 10."""

from typing import Literal

import numpy as np

from study.core.store import Results
from study.vocabulary import STICK

FINE_PUNCH = "7.3/pw-T6-114x24"


def factor_entries_ratio(results: Results, key: str, other: str) -> float:
    """Entries of the factors of one case's matrix over those of another one's."""
    return results.scalar(key, "entries") / results.scalar(other, "entries")


def shear_off_fine(
    results: Results,
    key: str,
    within: float | None = None,
    kind: Literal["largest", "rms"] = "largest",
    fine: str = FINE_PUNCH,
    surface: str = "",
) -> float:
    """Shear over tributary lengths against a fine mesh's, averaged over the same lengths.

    Nodes in |x| < `within`, or those that stick; in per cent of the fine mesh's largest shear. A
    numbered surface is that of a body of revolution: over rings.
    """
    end = f"_{surface}" if surface else ""
    ours, known = results.curves(key), results.curves(fine)
    x, shear = known[f"x{end}"], known[f"shear{end}"]
    ring = x if surface else np.ones_like(x)
    nodes = ours[f"x{end}"]
    borders = np.concatenate([nodes[:1], (nodes[1:] + nodes[:-1]) / 2, nodes[-1:]])
    force, size = (
        np.diff(np.interp(borders, x, np.concatenate([[0.0], np.cumsum(part)])))
        for part in (np.diff(x) * (y[1:] + y[:-1]) / 2 for y in (shear * ring, ring))
    )
    used = ours[f"status{end}"] == STICK if within is None else np.abs(nodes) < within
    off = (ours[f"shear_tributary{end}"] - force / size)[used]
    distance = np.abs(off).max() if kind == "largest" else np.sqrt(np.mean(off**2))
    return float(100 * distance / np.abs(shear).max())


def shear_zigzag(results: Results, key: str, surface: str = "") -> float:
    """Largest second difference of the shear of three sticking nodes, per cent of the largest."""
    end = f"_{surface}" if surface else ""
    curves = results.curves(key)
    shear, sticks = curves[f"shear{end}"], curves[f"status{end}"] == STICK
    second = np.abs(shear[1:-1] - (shear[:-2] + shear[2:]) / 2)
    return float(
        100 * second[sticks[1:-1] & sticks[:-2] & sticks[2:]].max() / np.nanmax(np.abs(shear))
    )


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

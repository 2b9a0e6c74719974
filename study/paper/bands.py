"""Variants of the cases of sections 7.2 to 7.5, for data that our copy of the paper does not state.

This module does not import the solver. Figures draw a case and its variants as a band from the
smallest to the largest value.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Variants = Mapping[str, Mapping[str, object]]
"""Changed parameters of each variant, by the suffix of the case's name."""

UNPRINTED_DATA: dict[str, Variants] = {
    "7.2": {
        "-pull0.15": {"pull": 0.15},
        "-pull0.40": {"pull": 0.4},
        "-together": {"pressed_first": False},
        "-smooth": {"shared_is_rough": False},
        "-strain": {"state": "plane strain"},
        "-low": {"divisions": (25, 8), "height": 1.28},
        "-high": {"height": 8 / 3},
    },
    # in each of these variants the force is about the printed one
    "7.3": {
        "-16x4-R8": {"width": 16.0},
        "-6x4-R9": {"width": 6.0, "radius": 9.0},
        "-8x3-R4": {"height": 3.0, "radius": 4.0},
        "-8x5-R13": {"height": 5.0, "radius": 13.0},
        "-force-held": {"depth_held": False},
    },
    "7.4": {
        "-deep": {"half_width": 40.0, "depth": 20.0},
        "-shallow": {"half_width": 10.0, "depth": 5.0},
        "-strain": {"state": "plane strain"},
    },
    "7.5": {
        "-gaps0.0-0.0": {"gaps": (0.0, 0.0)},
        "-gaps0.2-0.2": {"gaps": (2e-4, 2e-4)},
        "-second": {"section": "second"},
    },
}
"""Variants of dimensions, loads and stress states that the paper does not print, by section."""
UNPRINTED_DATA_LABEL = "unknown data"


def make_variants_with_other_diagonals(pattern: str) -> Variants:
    """Return the variants in which quadrilaterals are cut into triangles by other patterns.

    `pattern` is the pattern of the basic case.
    """
    patterns = ("right", "left", "left_right", "right_left", "crossed")
    return {f"-{name}": {"pattern": name} for name in patterns if name != pattern}


OTHER_DIAGONALS = {
    section: make_variants_with_other_diagonals("right") for section in ("7.2", "7.3", "7.5")
}
OTHER_DIAGONALS["7.4"] = make_variants_with_other_diagonals("left_right")
DIAGONALS_LABEL = "all diagonals"


def list_keys_of_case_and_variants(key: str, variants: Mapping[str, Variants]) -> list[str]:
    """Return the keys of a case, such as "7.2/pw-T6", and of all its variants."""
    section = key.partition("/")[0]
    return [key, *(key + suffix for suffix in variants[section])]


def envelope_of_lines(lines: Sequence[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Return the envelope (smallest and largest values) of piecewise-linear lines.

    Args:
        lines: Increasing positions (m,) and values (m,) of each line; NaN marks a gap.

    Returns:
        Positions (n,) of all lines' points within the range of the first line, and the smallest and
        largest values (n,) there.
    """
    first_positions = lines[0][0]
    x = np.unique(np.concatenate([positions for positions, _ in lines]))
    x = x[(x >= first_positions[0]) & (x <= first_positions[-1])]
    min_distance = 1e-9 * (x[-1] - x[0])  # closer positions differ by round-off only
    x = x[np.diff(x, prepend=-np.inf) > min_distance]
    interpolated = []
    for positions, values in lines:
        is_number = ~np.isnan(values)
        interpolated.append(np.interp(x, positions[is_number], values[is_number]))
    return x, np.min(interpolated, axis=0), np.max(interpolated, axis=0)

"""What the paper, as far as we have it, leaves open in sections 7.2 to 7.5: families of cases.

Free of any solver: figures draw a family as a band, from the least to the largest value.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Family = Mapping[str, Mapping[str, object]]

# By what follows an element's name in those of cases: the parameters that differ
DATA: dict[str, Family] = {
    "7.2": {
        "-pull0.15": {"pull": 0.15},
        "-pull0.40": {"pull": 0.4},
        "-together": {"pressed_first": False},
        "-smooth": {"shared_is_rough": False},
        "-strain": {"state": "plane strain"},
        "-low": {"divisions": (25, 8), "height": 1.28},
        "-high": {"height": 8 / 3},
    },
    # each with about the printed force
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
"""Dimensions, loads and states that are not printed."""
DATA_NAME = "unknown data"


def diagonals(drawn: str) -> Family:
    """How quadrilaterals can be cut into triangles otherwise than `drawn`."""
    patterns = ("right", "left", "left_right", "right_left", "crossed")
    return {f"-{name}": {"pattern": name} for name in patterns if name != drawn}


DIAGONALS = {section: diagonals("right") for section in ("7.2", "7.3", "7.5")}
DIAGONALS["7.4"] = diagonals("left_right")
DIAGONALS_NAME = "all diagonals"


def members(key: str, families: Mapping[str, Family]) -> list[str]:
    """Keys of a case, such as "7.2/pw-T6", and of all others of its family."""
    return [key, *(key + suffix for suffix in families[key.partition("/")[0]])]


def envelope(lines: Sequence[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Places (n,) of all lines' points within the first line, and the least and largest values.

    Args:
        lines: each of places (m,), which increase, and values (m,); NaN marks a gap.
    """
    first = lines[0][0]
    x = np.unique(np.concatenate([places for places, _ in lines]))
    x = x[(x >= first[0]) & (x <= first[-1])]
    x = x[np.diff(x, prepend=-np.inf) > 1e-9 * (x[-1] - x[0])]  # places that round-off made two
    known = [(places[~np.isnan(values)], values[~np.isnan(values)]) for places, values in lines]
    every = np.array([np.interp(x, *line) for line in known])
    return x, every.min(axis=0), every.max(axis=0)

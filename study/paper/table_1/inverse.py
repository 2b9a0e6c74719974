"""Table 1 as a blind test: which treatment of the user elements gives their printed shifts?

What follows was fixed before any shift was computed on the fitted columns; those on the two columns
of the page, which were fitted to the user elements' rows as well, were known.

Rows: the six shifts of the 6-node user element over CAX6, the six of the 8-node one over CAX8, and
all twelve by pairs of treatments that share supports, integration, kind of mass and whether the
matrices are symmetrised. A mechanism is a treatment (or such a pair) under one set of supports.

Band: per mode from the least to the largest shift of a mechanism over the columns that fit CAX6 and
CAX8 under its supports, widened by the print's rounding (one digit, half of either eigenvalue's).
A mechanism's distance from a row is the largest distance of a printed shift from its band. Sets of
supports with fewer than `MIN_COLUMNS` columns have no bands and are left out.

Chance: the share of 10 000 random rows that some mechanism meets as closely as the best one meets
the print. Random rows are normal about zero and have the printed scatter in three ways: independent
modes with the root mean square of the printed shifts; independent modes, each with its printed
size; and the latter with the mechanisms' rank correlations. The largest share counts.

Criterion: a row is explained if the odds against chance, (1 - chance) / chance, are at least 20 and
the distance is zero: all printed shifts lie in their bands. The nearest treatment is the one with
the smallest root mean square of its median shifts less the printed ones; it is told, and does not
decide.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import spearmanr

from study.model.units import units_of
from study.paper.items import TABLE_1
from study.paper.table_1.columns import Array, Supports
from study.paper.table_1.ensemble import ACCEPTED_DEVIATION, SUPPORTS
from study.paper.table_1.family import TREATMENTS, FamilyRecord, Treatment
from study.run.store import Result, StudyError

RANDOM_ROWS, SEED = 10_000, 51
MIN_ODDS = 20.0
"""Odds against chance from which on a row is explained; Table 2's, too."""
MIN_COLUMNS = 5

PRINTED_ROWS = {"six": ("6-node user element", "CAX6"), "eight": ("8-node user element", "CAX8")}
DIGITS = np.array([1.0, 1e2, 1e2, 1e2, 1e2, 1e2])
"""Last printed digits of Table 1."""
TREATMENTS_OF_ROW = {"six": ("six",), "eight": ("eight",), "both": ("six", "eight")}
MASSES = ("new", "standard", "lumped", "lumped_after", "quadrilateral")
SYMMETRISED, LEFT_MATRICES = ("no", "yes", "before"), ("", "transposed", "same")
"""Words of treatments, in the order of their numbers in results."""
MASS_OF_SIX_NODES = {"lumped_after": "lumped", "quadrilateral": "standard"}
"""Mass of the 6-node element that goes with one of the 8-node element, where names differ."""
STANDARD_MASS = {
    "six": Treatment(0, "standard"),
    "eight": Treatment(0, "standard", "no", "transposed"),
}
"""The new stiffness, as derived, with the standard mass."""


class Mechanisms(NamedTuple):
    """Bands and medians of mechanisms, in per cent.

    Args:
        low, high: ends (mechanisms, modes) of the bands without rounding.
        median: shifts (mechanisms, modes).
        place: supports and treatment (or two) of each mechanism, by their numbers.
    """

    low: Array
    high: Array
    median: Array
    place: npt.NDArray[np.intp]

    def distances(self, rows: Array, rounding: Array) -> Array:
        """Return the distance (rows,) of rows (rows, modes) from the nearest mechanism."""
        least = np.full(len(rows), np.inf)
        for low, high in zip(self.low - rounding, self.high + rounding, strict=True):
            outside = np.maximum(np.maximum(low - rows, rows - high), 0)
            least = np.minimum(least, outside.max(axis=1))
        return least


def printed_shifts(name: str) -> tuple[Array, Array]:
    """Return the printed shifts (6,) of "six" or "eight" nodes and their rounding, in per cent."""
    element, over = (np.array(TABLE_1[column]) for column in PRINTED_ROWS[name])
    return 100 * (element / over - 1), 100 * DIGITS / over


def collect(
    shifts: Array, supports: npt.NDArray[np.intp], treatments: npt.NDArray[np.intp]
) -> Mechanisms:
    """Return the mechanisms of all supports with enough columns.

    Args:
        shifts: of all columns (columns, mechanisms of one set of supports, modes).
        supports: numbers (columns,) of the columns' supports.
        treatments: numbers (mechanisms, 1 or 2) of the treatments.
    """
    low, high, median, place = [], [], [], []
    for number in np.unique(supports):
        chosen = shifts[supports == number]
        if len(chosen) < MIN_COLUMNS:
            continue
        for k in np.flatnonzero(np.isfinite(chosen).all(axis=(0, 2))):
            low.append(chosen[:, k].min(axis=0))
            high.append(chosen[:, k].max(axis=0))
            median.append(np.median(chosen[:, k], axis=0))
            place.append([number, *treatments[k]])
    return Mechanisms(np.array(low), np.array(high), np.array(median), np.array(place))


def list_pairs() -> npt.NDArray[np.intp]:
    """Return the numbers (pairs, 2) of treatments of 6 and 8 nodes that go together."""
    return np.array(
        [
            (i, k)
            for k, eight in enumerate(TREATMENTS["eight"])
            for i, six in enumerate(TREATMENTS["six"])
            if six.points == eight.points
            and six.mass == MASS_OF_SIX_NODES.get(eight.mass, eight.mass)
            and (six.symmetrised == "no") == (eight.symmetrised == "no")
        ]
    )


def draw_rows(printed: Array, mechanisms: Mechanisms) -> list[Array]:
    """Return random rows (10 000, modes) with the printed scatter, drawn in three ways."""
    random = np.random.default_rng(SEED)
    normal = random.standard_normal((RANDOM_ROWS, len(printed)))
    rank = np.atleast_2d(spearmanr(mechanisms.median).statistic)
    # Pairwise correlations need not make a positive matrix
    values, vectors = np.linalg.eigh(2 * np.sin(np.pi / 6 * rank))
    factor = vectors * np.sqrt(np.maximum(values, 0))
    factor /= np.linalg.norm(factor, axis=1, keepdims=True)
    correlated = random.standard_normal((RANDOM_ROWS, len(printed))) @ factor.T
    rms = np.sqrt(np.mean(printed**2))
    return [rms * normal, np.abs(printed) * normal, np.abs(printed) * correlated]


def judge_row(mechanisms: Mechanisms, printed: Array, rounding: Array) -> dict[str, float]:
    """Return distance, chance, odds and the nearest treatment of one row.

    The mechanism of the smallest distance (and misfit) has numbers `best_*`, the one of the smallest
    misfit `nearest_*`: bands, misfit (root mean square of median less printed shifts), how many
    printed shifts lie in its bands, and its place: supports (0), treatments (1, 2).
    """
    distance = float(mechanisms.distances(printed[None], rounding)[0])
    shares = [
        float(np.mean(mechanisms.distances(rows, rounding) <= distance))
        for rows in draw_rows(printed, mechanisms)
    ]
    share = max(shares)
    misfits = np.sqrt(np.mean((mechanisms.median - printed) ** 2, axis=1))
    nearest = int(misfits.argmin())
    outside = _outside(mechanisms, printed, rounding)
    best = int(np.lexsort((misfits, outside.max(axis=1)))[0])
    scalars = {
        "mechanisms": float(len(mechanisms.place)),
        "distance": distance,
        "within": float((outside.max(axis=1) == 0).sum()),
        "chance": share,
        "odds": (1 - share) / max(share, 1 / RANDOM_ROWS),
        "rms": float(np.sqrt(np.mean(printed**2))),
    }
    scalars |= {f"chance_{k}": value for k, value in enumerate(shares, start=1)}
    for name, index in (("best", best), ("nearest", nearest)):
        scalars[f"{name}_misfit"] = float(misfits[index])
        scalars[f"{name}_in_bands"] = float((outside[index] == 0).sum())
        bands = zip(*(part[index] for part in mechanisms[:3]), strict=True)
        for mode, (low, high, median) in enumerate(bands, start=1):
            scalars |= {f"{name}_low_{mode}": low, f"{name}_high_{mode}": high}
            scalars[f"{name}_median_{mode}"] = median
        scalars |= {f"{name}_place_{k}": float(x) for k, x in enumerate(mechanisms.place[index])}
    return scalars


def _outside(mechanisms: Mechanisms, printed: Array, rounding: Array) -> Array:
    """Return by how much (mechanisms, modes) printed shifts lie outside of the bands."""
    low, high = mechanisms.low - rounding, mechanisms.high + rounding
    return np.maximum(np.maximum(low - printed, printed - high), 0)


def blind_test(record: str) -> Result:
    """Judge both rows and all twelve shifts by all mechanisms.

    Scalars are named by row (six, eight, both); those of supports by their number among the
    candidates. Curves: `<row>_low`, `<row>_high`, `<row>_median` (mechanisms, modes) and
    `<row>_place` (mechanisms, 2 or 3), see `Mechanisms`.

    Args:
        record: digest of the records of columns and shifts, by which a stored result is outdated if
            they have changed.

    Raises:
        StudyError: if the records have another digest.
    """
    tracked = FamilyRecord()
    if tracked.digest != record:
        raise StudyError(f"the records of Table 1 have the digest {tracked.digest}, not {record}")
    columns = tracked.list_columns()
    supports = np.array([SUPPORTS.index(column[0]) for column in columns])
    shifts = {name: tracked.shifts(name) for name in TREATMENTS}
    numbers = {name: np.arange(len(t))[:, None] for name, t in TREATMENTS.items()}
    printed = {name: printed_shifts(name) for name in TREATMENTS}
    pairs = list_pairs()
    shifts["both"] = np.concatenate(
        [shifts["six"][:, pairs[:, 0]], shifts["eight"][:, pairs[:, 1]]], axis=2
    )
    numbers["both"] = pairs
    shift, rounding = (
        np.concatenate(parts) for parts in zip(printed["six"], printed["eight"], strict=True)
    )
    printed["both"] = shift, rounding

    scalars: dict[str, float] = {}
    curves: dict[str, npt.NDArray[np.generic]] = {}
    for name, values in shifts.items():
        mechanisms = collect(values, supports, numbers[name])
        row = judge_row(mechanisms, *printed[name])
        for kind in ("best", "nearest"):
            place = [int(row.pop(f"{kind}_place_{k}")) for k in range(mechanisms.place.shape[1])]
            row |= {f"{kind}_{key}": x for key, x in _describe_place(name, place).items()}
        scalars |= {f"{name}_{key}": value for key, value in row.items()}
        curves |= {
            f"{name}_low": mechanisms.low,
            f"{name}_high": mechanisms.high,
            f"{name}_median": mechanisms.median,
            f"{name}_place": mechanisms.place,
        }
    scalars |= _describe_columns(tracked, supports)
    for name in TREATMENTS:
        scalars |= _describe_standard_mass(name, shifts[name], supports, printed[name][0])
        scalars[f"{name}_treatments"] = float(len(TREATMENTS[name]))
    kinds = dict.fromkeys(
        ("*_distance", "*_misfit", "*_rms", "*_low_*", "*_high_*", "*_median_*"), "%"
    )
    kinds |= dict.fromkeys(("accepted_deviation", "largest_axis", "least_four"), "%")
    kinds |= {f"least_{number}": "%" for number in range(len(SUPPORTS))}
    return Result(scalars, units_of(scalars, {**kinds, "*": "1"}), curves)


def _describe_place(name: str, place: list[int]) -> dict[str, float]:
    """Return supports and treatments of a mechanism as numbers, mostly places in lists.

    Surfaces 1 and 4 are 14; `mass_1` and the like are of the first treatment.
    """
    supports = SUPPORTS[place[0]]
    numbers = {
        "surfaces": float("".join(map(str, supports.surfaces))),
        "tangential": float(supports.tangential),
    }
    for k, (row, number) in enumerate(zip(TREATMENTS_OF_ROW[name], place[1:], strict=True), 1):
        treatment = TREATMENTS[row][number]
        numbers |= {
            f"points_{k}": float(treatment.points),
            f"mass_{k}": float(MASSES.index(treatment.mass)),
            f"symmetrised_{k}": float(SYMMETRISED.index(treatment.symmetrised)),
            f"left_{k}": float(LEFT_MATRICES.index(treatment.left)),
        }
    return numbers


def _describe_columns(tracked: FamilyRecord, supports: npt.NDArray[np.intp]) -> dict[str, float]:
    """Return how many columns fit, and by how much the nearest one fails where none does."""
    four = [SUPPORTS.index(Supports((1, 2, 3, 4), tangential)) for tangential in (False, True)]
    rows = tracked.columns["rows"]
    scalars = {
        "columns": float(len(supports)),
        "accepted_deviation": ACCEPTED_DEVIATION,
        "candidates": float(len(SUPPORTS)),
        "supports": float(
            sum(np.count_nonzero(supports == number) >= MIN_COLUMNS for number in set(supports))
        ),
        "least_columns": float(MIN_COLUMNS),
        "draws": float(sum(row["draws"] for row in rows)),
        "largest_axis": max(row["axis"] for row in tracked.rows),
        "least_four": min(rows[number]["least"] for number in four),
    }
    for number, row in enumerate(rows):
        scalars |= {f"columns_{number}": len(row["columns"]), f"least_{number}": row["least"]}
    return scalars


def _describe_standard_mass(
    name: str, shifts: Array, supports: npt.NDArray[np.intp], printed: Array
) -> dict[str, float]:
    """Return bands and misfit of the standard mass beside the new stiffness as derived.

    They are those on the page's supports, the base normal to it.
    """
    chosen = supports == SUPPORTS.index(Supports((1,), tangential=False))
    values = shifts[chosen][:, TREATMENTS[name].index(STANDARD_MASS[name])]
    median = np.median(values, axis=0)
    bands = zip(values.min(axis=0), values.max(axis=0), median, strict=True)
    scalars = {
        f"{name}_mass_misfit": float(np.sqrt(np.mean((median - printed) ** 2))),
        f"{name}_mass_rms": float(np.sqrt(np.mean(median**2))),
    }
    for mode, (low, high, middle) in enumerate(bands, start=1):
        scalars |= {f"{name}_mass_low_{mode}": low, f"{name}_mass_high_{mode}": high}
        scalars[f"{name}_mass_median_{mode}"] = middle
    return scalars

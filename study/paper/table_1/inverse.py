"""Table 1 as a blind test: which treatment of the user elements gives their printed shifts?

A shift is the relative difference between an eigenvalue of a user element and that of the standard
element with the same number of nodes, in per cent. The following procedure was fixed before any
shift was computed on the columns fitted to CAX6 and CAX8. Only the shifts on the two columns of
`study.paper.s7_5_profiles` were known, which were fitted to the user elements' rows, too.

Rows: the six shifts of the 6-node user element relative to CAX6, the six of the 8-node one relative
to CAX8, and all twelve. For all twelve, pairs of treatments are considered that share supports,
integration, kind of mass and whether the matrices are symmetrised. A mechanism is a treatment (or
such a pair) together with one set of supports.

Band: for each mode, it extends from the smallest to the largest shift of a mechanism over the
columns that fit CAX6 and CAX8 under its supports. It is widened by the rounding of the printed
numbers (half a digit of either eigenvalue). A mechanism's distance from a row is the largest
distance of a printed shift from its band. Sets of supports with fewer than `MIN_COLUMNS` columns
have no bands and are omitted.

Chance: the fraction of 10 000 random rows to which some mechanism is as near as the nearest one is
to the printed row. Random rows are normally distributed about zero. They have the scatter of the
printed shifts in three ways: independent modes with the root mean square of the printed shifts;
independent modes, each with the size of its printed shift; and the latter with the mechanisms' rank
correlations. The largest fraction counts.

Criterion: a row is explained if the odds against chance, (1 - chance) / chance, are at least 20 and
the distance is zero, i.e. all printed shifts lie in their bands. The nearest treatment, whose
median shifts have the smallest root mean square difference from the printed ones, is reported but
does not decide.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import spearmanr

from study.model.units import assign_units_to_scalars
from study.paper.items import TABLE_1
from study.paper.table_1.columns import Array, Supports
from study.paper.table_1.ensemble import ACCEPTED_DEVIATION, SUPPORTS, read_columns
from study.paper.table_1.family import TREATMENTS, Treatment, read_shifts
from study.run import records
from study.run.store import Result, StudyError

RANDOM_ROWS, SEED = 10_000, 51
MIN_ODDS = 20.0
"""Smallest odds against chance at which a row is explained, as for Table 2."""
MIN_COLUMNS = 5

PRINTED_ROWS = {"six": ("6-node user element", "CAX6"), "eight": ("8-node user element", "CAX8")}
DIGITS = np.array([1.0, 1e2, 1e2, 1e2, 1e2, 1e2])
"""Units (6,) of the last printed digits of the eigenvalues in Table 1."""
TREATMENTS_OF_ROW = {"six": ("six",), "eight": ("eight",), "both": ("six", "eight")}
MASSES = ("new", "standard", "lumped", "lumped_after", "quadrilateral")
SYMMETRISED, LEFT_MATRICES = ("no", "yes", "before"), ("", "transposed", "same")
"""Words for treatments; results contain their indices in these tuples."""
MASS_OF_SIX_NODES = {"lumped_after": "lumped", "quadrilateral": "standard"}
"""Mass of the 6-node element that corresponds to one of the 8-node element, if names differ."""
STANDARD_MASS = {
    "six": Treatment(0, "standard"),
    "eight": Treatment(0, "standard", "no", "transposed"),
}
"""Treatments that combine the new stiffness, as derived, with the standard mass."""


class TreatmentShiftBands(NamedTuple):
    """Bands and medians of the shifts of all mechanisms, in per cent.

    Args:
        low: Lower ends (mechanisms, modes) of the bands, without rounding.
        high: Upper ends (mechanisms, modes) of the bands, without rounding.
        median: Median shifts (mechanisms, modes).
        place: Indices (mechanisms, 2 or 3) of the supports and of one or two treatments.
    """

    low: Array
    high: Array
    median: Array
    place: npt.NDArray[np.intp]

    def distances(self, rows: Array, rounding: Array) -> Array:
        """Return the distance of each row of shifts from the nearest mechanism, in per cent.

        Args:
            rows: Shifts (rows, modes).
            rounding: Rounding (modes,) by which bands are widened on either side.
        """
        least = np.full(len(rows), np.inf)
        for low, high in zip(self.low - rounding, self.high + rounding, strict=True):
            outside = np.maximum(np.maximum(low - rows, rows - high), 0)
            least = np.minimum(least, outside.max(axis=1))
        return least


def printed_shifts_and_rounding(name: str) -> tuple[Array, Array]:
    """Return the printed shifts (6,) of a user element and their rounding (6,), in per cent.

    `name` is "six" or "eight", the number of nodes.
    """
    element, over = (np.array(TABLE_1[column]) for column in PRINTED_ROWS[name])
    return 100 * (element / over - 1), 100 * DIGITS / over


def collect_shift_bands(
    shifts: Array, supports: npt.NDArray[np.intp], treatments: npt.NDArray[np.intp]
) -> TreatmentShiftBands:
    """Return the mechanisms of all supports with at least `MIN_COLUMNS` columns.

    Mechanisms for which a shift is not finite are omitted.

    Args:
        shifts: Shifts (columns, m, modes) for m treatments or pairs of treatments.
        supports: Indices (columns,) of the columns' supports.
        treatments: Indices (m, 1 or 2) of the treatments.
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
    return TreatmentShiftBands(np.array(low), np.array(high), np.array(median), np.array(place))


def list_matching_treatment_pairs() -> npt.NDArray[np.intp]:
    """Return the indices (pairs, 2) of compatible treatments of the 6- and 8-node elements.

    They share integration, kind of mass and whether the matrices are symmetrised.
    """
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


def draw_random_rows_of_shifts(printed: Array, mechanisms: TreatmentShiftBands) -> list[Array]:
    """Return three sets of random rows (10 000, modes) with the scatter of the printed shifts.

    The module's docstring defines the three distributions.
    """
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


def compare_row_with_shift_bands(
    mechanisms: TreatmentShiftBands, printed: Array, rounding: Array
) -> dict[str, float]:
    """Compare a printed row of shifts with all mechanisms, and return the scalars to store.

    `distance`, `chance` and `odds` are defined in the module's docstring. Scalars that begin with
    `best` belong to the mechanism with the smallest distance (among equal ones, with the smallest
    misfit), those that begin with `nearest` to the one with the smallest misfit. The misfit is the
    root mean square of median minus printed shifts. `<name>_in_bands` counts the printed shifts in
    the mechanism's bands; `<name>_place_0` is the index of its supports, `<name>_place_1` and
    `<name>_place_2` are the indices of its treatments.

    Args:
        mechanisms: Bands and medians of all mechanisms.
        printed: Printed shifts (modes,), in per cent.
        rounding: Their rounding (modes,), in per cent.
    """
    distance = float(mechanisms.distances(printed[None], rounding)[0])
    shares = [
        float(np.mean(mechanisms.distances(rows, rounding) <= distance))
        for rows in draw_random_rows_of_shifts(printed, mechanisms)
    ]
    share = max(shares)
    misfits = np.sqrt(np.mean((mechanisms.median - printed) ** 2, axis=1))
    nearest = int(misfits.argmin())
    distances_outside = _distances_outside_bands(mechanisms, printed, rounding)
    best = int(np.lexsort((misfits, distances_outside.max(axis=1)))[0])
    scalars = {
        "mechanisms": float(len(mechanisms.place)),
        "distance": distance,
        "within": float((distances_outside.max(axis=1) == 0).sum()),
        "chance": share,
        "odds": (1 - share) / max(share, 1 / RANDOM_ROWS),
        "rms": float(np.sqrt(np.mean(printed**2))),
    }
    scalars |= {f"chance_{k}": value for k, value in enumerate(shares, start=1)}
    for name, index in (("best", best), ("nearest", nearest)):
        scalars[f"{name}_misfit"] = float(misfits[index])
        scalars[f"{name}_in_bands"] = float((distances_outside[index] == 0).sum())
        bands = zip(*(part[index] for part in mechanisms[:3]), strict=True)
        for mode, (low, high, median) in enumerate(bands, start=1):
            scalars |= {f"{name}_low_{mode}": low, f"{name}_high_{mode}": high}
            scalars[f"{name}_median_{mode}"] = median
        scalars |= {f"{name}_place_{k}": float(x) for k, x in enumerate(mechanisms.place[index])}
    return scalars


def _distances_outside_bands(
    mechanisms: TreatmentShiftBands, printed: Array, rounding: Array
) -> Array:
    """Return the distances (mechanisms, modes) of the printed shifts from their bands."""
    low, high = mechanisms.low - rounding, mechanisms.high + rounding
    return np.maximum(np.maximum(low - printed, printed - high), 0)


def digest_records() -> str:
    """Return the digest of the recorded columns and shifts."""
    return records.digest_files(records.TABLE_1_COLUMNS, records.TABLE_1_SHIFTS)[:16]


def blind_test(record: str) -> Result:
    """Compare the shifts of either user element and all twelve shifts with all mechanisms.

    Scalars begin with the name of the row ("six", "eight" or "both"); those about supports end in
    the index of the supports in `SUPPORTS`. Curves: `<row>_low`, `<row>_high`, `<row>_median`
    (mechanisms, modes) and `<row>_place` (mechanisms, 2 or 3), see `Mechanisms`.

    Args:
        record: Digest of the recorded columns and shifts. It is a parameter in order that stored
            results become outdated if the records change.

    Raises:
        StudyError: If the records have another digest.
    """
    digest = digest_records()
    if digest != record:
        raise StudyError(f"the records of Table 1 have the digest {digest}, not {record}")
    supports = np.array([SUPPORTS.index(column[0]) for column in read_columns().values()])
    shifts = {name: read_shifts(name) for name in TREATMENTS}
    numbers = {name: np.arange(len(t))[:, None] for name, t in TREATMENTS.items()}
    printed = {name: printed_shifts_and_rounding(name) for name in TREATMENTS}
    pairs = list_matching_treatment_pairs()
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
        mechanisms = collect_shift_bands(values, supports, numbers[name])
        row = compare_row_with_shift_bands(mechanisms, *printed[name])
        for kind in ("best", "nearest"):
            place = [int(row.pop(f"{kind}_place_{k}")) for k in range(mechanisms.place.shape[1])]
            row |= {
                f"{kind}_{key}": x
                for key, x in _encode_supports_and_treatments(name, place).items()
            }
        scalars |= {f"{name}_{key}": value for key, value in row.items()}
        curves |= {
            f"{name}_low": mechanisms.low,
            f"{name}_high": mechanisms.high,
            f"{name}_median": mechanisms.median,
            f"{name}_place": mechanisms.place,
        }
    scalars |= _summarise_fitted_columns(supports)
    for name in TREATMENTS:
        scalars |= _summarise_standard_mass_treatment(
            name, shifts[name], supports, printed[name][0]
        )
        scalars[f"{name}_treatments"] = float(len(TREATMENTS[name]))
    kinds = dict.fromkeys(
        ("*_distance", "*_misfit", "*_rms", "*_low_*", "*_high_*", "*_median_*"), "%"
    )
    kinds |= dict.fromkeys(("accepted_deviation", "largest_axis", "least_four"), "%")
    kinds |= {f"least_{number}": "%" for number in range(len(SUPPORTS))}
    return Result(scalars, assign_units_to_scalars(scalars, {**kinds, "*": "1"}), curves)


def _encode_supports_and_treatments(name: str, place: list[int]) -> dict[str, float]:
    """Return the supports and treatments of a mechanism as numbers.

    `surfaces` contains the numbers of the supported surfaces as digits, e.g. 14 for surfaces 1 and
    4. `mass_k`, `symmetrised_k` and `left_k` are indices in `MASSES`, `SYMMETRISED` and
    `LEFT_MATRICES` for treatment k = 1 or 2.

    Args:
        name: Row: "six", "eight" or "both".
        place: Indices of the supports and of one or two treatments.
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


def _summarise_fitted_columns(supports: npt.NDArray[np.intp]) -> dict[str, float]:
    """Return scalars on the columns that fit CAX6 and CAX8.

    They include the number of columns, in total and for each set of supports, and the smallest
    deviation from Table 1 for each set of supports.

    Args:
        supports: Indices (columns,) of the columns' supports.
    """
    four = [SUPPORTS.index(Supports((1, 2, 3, 4), tangential)) for tangential in (False, True)]
    rows = [row.content for row in records.read_rows(records.TABLE_1_COLUMNS).values()]
    shifts = records.read_rows(records.TABLE_1_SHIFTS)
    scalars = {
        "columns": float(len(supports)),
        "accepted_deviation": ACCEPTED_DEVIATION,
        "candidates": float(len(SUPPORTS)),
        "supports": float(
            sum(np.count_nonzero(supports == number) >= MIN_COLUMNS for number in set(supports))
        ),
        "least_columns": float(MIN_COLUMNS),
        "draws": float(sum(row["draws"] for row in rows)),
        "largest_axis": max(row.content["axis"] for row in shifts.values()),
        "least_four": min(rows[number]["least"] for number in four),
    }
    for number, row in enumerate(rows):
        scalars |= {f"columns_{number}": len(row["columns"]), f"least_{number}": row["least"]}
    return scalars


def _summarise_standard_mass_treatment(
    name: str, shifts: Array, supports: npt.NDArray[np.intp], printed: Array
) -> dict[str, float]:
    """Return bands and misfit for the standard mass combined with the new stiffness as derived.

    Only columns whose base is supported in the normal direction, as in section 7.5, are considered.

    Args:
        name: User element, "six" or "eight".
        shifts: Shifts (columns, treatments, modes), in per cent.
        supports: Indices (columns,) of the columns' supports.
        printed: Printed shifts (modes,), in per cent.
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

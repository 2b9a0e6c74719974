"""Table 2 as an inverse problem: which models of the family give the printed critical stresses?

The following procedure was fixed before the first value of the family was computed.

Rows: CPS6's two values are compared with models of the standard element, the user element's two
with the new element, and all four with pairs of models that share mesh and set-up. CPS6M has no
model. A model's distance from a row is the largest relative deviation from its printed values. The
best model has the smallest distance.

Chance: 10 000 random rows are drawn from a normal distribution with the models' scatter: the
standard deviation of each value is half of the range between the models' 16 % and 84 % quantiles,
and the correlations are their rank correlations. The chance is the fraction of random rows that
have a model as near as the best model is to the printed row. It is computed for random rows around
the printed values and around the models' median, and the larger one counts.

Criterion: a row is explained if the odds against chance, (1 - chance) / chance, are at least 20 for
the whole family. Groups of models (A a corner node, A a mid-side node) are shown, but do not
decide.

Likelihood: normal about each model, with the sum of the variance of the print's rounding and the
square of the models' uncertainty. The uncertainty is the median change (times 1.4826) between
adjacent meshes: one more square along the beam, or another pattern of diagonals. A model's share is
its likelihood over the sum for all distinct models.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree
from scipy.stats import spearmanr

from study.model.units import assign_units_to_scalars
from study.paper.items import TABLE_2
from study.paper.table_2.family import (
    ENDS,
    FORMS,
    LOADS,
    MESHES,
    MIDDLES,
    PATTERNS,
    PRESTRESS_SUPPORTS,
    SET_UPS,
    TREATMENTS,
    Array,
    Family,
    Treatment,
    read_family,
)
from study.run import records
from study.run.store import Result, StudyError

RANDOM_ROWS, SEED = 10_000, 51
MIN_ODDS = 20.0
"""Smallest odds against chance at which a row is explained."""
QUANTILES = (0.16, 0.84)
"""Quantiles that are one standard deviation from the median of a normal distribution."""
MEDIAN_TO_DEVIATION = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""
PRINTED_DIGIT = 1e5
"""Unit of the last printed digit of Table 2's computed values, in Pa."""

ROWS = {"cps6": "CPS6", "user": "6-node user element"}
ELEMENTS = {"cps6": "standard", "user": "new"}
GROUPS = ("all", "corner", "midside")
NEAR_HIT_TREATMENT = Treatment("G", "point", 3, "no")
"""Treatment stated by the paper: matrices as derived, exactly integrated, form G."""

Mask = npt.NDArray[np.bool_]


class Models(NamedTuple):
    """Models that are compared with a row of Table 2.

    Args:
        deviation: Relative deviations (n, k) from the k printed values, in per cent.
        place: Indices (n, p) of each model's mesh, set-up and treatment (or two treatments) in the
            family.
    """

    deviation: Array
    place: npt.NDArray[np.intp]

    def select(self, mask: Mask) -> "Models":
        """Return the models for which a mask (n,) is true."""
        return Models(self.deviation[mask], self.place[mask])

    def group(self, name: str) -> "Models":
        """Return the models of a group.

        `name` is "all", or the type of the node at point A, "corner" or "midside".
        """
        if name == "all":
            return self
        is_corner = np.isin(self.place[:, 0], _CORNER_MESHES)
        return self.select(is_corner == (name == "corner"))

    def index_of_nearest_model(self) -> int:
        """Return the index of the model with the smallest distance from the printed values.

        The distance is the largest absolute deviation.
        """
        return int(np.abs(self.deviation).max(axis=1).argmin())


@dataclass(frozen=True)
class NearestModelDistances:
    """Distribution of the distances of random rows from their nearest models, in per cent.

    Args:
        distances: Sorted distances of the random rows around the printed values.
        distances_around_median: Sorted distances of the random rows around the models' median.
        covariance: Covariance matrix of the random rows.
    """

    distances: Array
    distances_around_median: Array
    covariance: Array

    def fraction_of_random_rows_within(self, distance: float) -> float:
        """Return the fraction of random rows that have a model within a distance.

        The larger fraction of the rows around the printed values and around the median is returned.
        """
        drawn = self.distances, self.distances_around_median
        return max(float(np.searchsorted(d, distance, "right")) / len(d) for d in drawn)

    def distance_reached_by_fraction(self, share: float) -> float:
        """Return the distance within which a fraction of the random rows has a model.

        The smaller distance of the rows around the printed values and around the median is
        returned.
        """
        drawn = self.distances, self.distances_around_median
        return min(float(np.quantile(d, share)) for d in drawn)


def collect_models_of_row(stresses: Array, row: str) -> Models:
    """Return the models of one row for which both critical stresses exist.

    Args:
        stresses: Critical stresses of one element, an array of `Family`.
        row: "cps6" or "user".
    """
    place = np.argwhere(np.isfinite(stresses).all(axis=-1))
    printed = np.array(TABLE_2[ROWS[row]])
    return Models(100 * (stresses[tuple(place.T)] / printed - 1), place)


def collect_model_pairs(family: Family) -> Models:
    """Return all pairs of models with the same mesh and set-up, with four deviations each."""
    cps6, user = (
        100 * (family.stresses[ELEMENTS[row]] / np.array(TABLE_2[ROWS[row]]) - 1) for row in ROWS
    )
    shape = (*cps6.shape[:3], user.shape[2], 2)
    pairs = np.concatenate(
        [np.broadcast_to(cps6[:, :, :, None], shape), np.broadcast_to(user[:, :, None], shape)],
        axis=-1,
    )
    place = np.argwhere(np.isfinite(pairs).all(axis=-1))
    return Models(pairs[tuple(place.T)], place)


def remove_duplicate_models(models: Models) -> Models:
    """Return the models without duplicates; the first of models with equal deviations is kept."""
    _, first = np.unique(models.deviation.round(6), axis=0, return_index=True)
    first.sort()
    return Models(models.deviation[first], models.place[first])


def simulate_nearest_model_distances(models: Models) -> NearestModelDistances:
    """Draw random rows with the models' scatter and compute distances from the nearest models."""
    low, high = np.quantile(models.deviation, QUANTILES, axis=0)
    scatter = (high - low) / 2
    rank = np.atleast_2d(spearmanr(models.deviation).statistic)
    if rank.size == 1:  # for two columns, `rank` is a number
        rank = np.array([[1.0, rank.item()], [rank.item(), 1.0]])
    correlation = 2 * np.sin(np.pi / 6 * rank)
    covariance = correlation * np.outer(scatter, scatter)
    random = np.random.default_rng(SEED)
    offsets = random.multivariate_normal(
        np.zeros(len(scatter)), covariance, RANDOM_ROWS, method="eigh"
    )
    tree = KDTree(models.deviation)
    distances = [
        np.sort(tree.query(centre + offsets, p=np.inf)[0])
        for centre in (np.zeros(len(scatter)), np.median(models.deviation, axis=0))
    ]
    return NearestModelDistances(distances[0], distances[1], covariance)


def stress_change_between_adjacent_meshes(stresses: Array, row: str) -> Array:
    """Return typical changes (2,) of both critical stresses between adjacent meshes, in per cent.

    Adjacent meshes differ by one square along the beam or by the pattern of the diagonals.

    Args:
        stresses: Critical stresses of one element, an array of `Family`.
        row: "cps6" or "user"; changes are relative to its printed values.
    """
    neighbours = [
        (i, k)
        for (i, one), (k, other) in combinations(enumerate(MESHES), 2)
        if one.ny == other.ny
        and ((one.pattern == other.pattern and abs(one.nx - other.nx) == 1) or one.nx == other.nx)
    ]
    first, second = np.array(neighbours).T
    change = 100 * (stresses[first] - stresses[second]) / np.array(TABLE_2[ROWS[row]])
    return MEDIAN_TO_DEVIATION * np.nanmedian(np.abs(change), axis=(0, 1, 2))


def half_printed_digit_in_percent(row: str) -> Array:
    """Return half a unit of the last printed digit, (2,), in per cent of the printed values."""
    return 100 * PRINTED_DIGIT / 2 / np.array(TABLE_2[ROWS[row]])


def likelihood_shares(models: Models, uncertainty: Array, half_digit: Array) -> Array:
    """Return the likelihood of each model, divided by the sum for all models, (n,).

    Args:
        models: Distinct models.
        uncertainty: Standard deviation (k,) due to the mesh, in per cent.
        half_digit: Half a unit of the last printed digit (k,), in per cent.
    """
    deviation = np.sqrt(uncertainty**2 + half_digit**2 / 3)
    exponent = -((models.deviation / deviation) ** 2).sum(axis=1) / 2
    likelihood = np.exp(exponent - exponent.max())
    return likelihood / likelihood.sum()


def compare_row_with_models(
    models: Models, uncertainty: Array, half_digit: Array
) -> tuple[dict[str, float], NearestModelDistances]:
    """Compare distinct models with a row, and return the scalars to store and the chance.

    Args:
        models: Distinct models of the row.
        uncertainty: Standard deviation (k,) due to the mesh, in per cent.
        half_digit: Half a unit of the last printed digit (k,), in per cent.
    """
    best, chance = models.index_of_nearest_model(), simulate_nearest_model_distances(models)
    distance = float(np.abs(models.deviation[best]).max())
    share = chance.fraction_of_random_rows_within(distance)
    shares = likelihood_shares(models, uncertainty, half_digit)
    mesh_shares = np.bincount(models.place[:, 0], shares)
    scalars = {
        "models": float(len(models.deviation)),
        "distance": distance,
        "chance": share,
        "odds": (1 - share) / max(share, 1 / RANDOM_ROWS),
        "critical_distance": chance.distance_reached_by_fraction(1 / (1 + MIN_ODDS)),
        "largest_share": float(shares.max()),
        "largest_mesh_share": float(mesh_shares.max()),
        "within_rounding": float((np.abs(models.deviation) <= half_digit).all(axis=1).sum()),
    }
    scalars |= {f"best_{k}": x for k, x in enumerate(models.deviation[best], start=1)}
    return scalars, chance


def digest_record() -> str:
    """Return the digest of the recorded models."""
    return records.digest_files(records.TABLE_2)[:16]


def inverse_problem(record: str) -> Result:
    """Compare either row and all four values of Table 2 with all models and with groups of models.

    Names of scalars begin with the row ("cps6", "user" or "both") and the group; see
    `_compare_near_hit_models` and `_stress_changes_by_weight_functions` for others. Curves:
    `<row>_deviation` (n, 2) and `<row>_corner` (n) of the distinct models of a row;
    `<row>_covariance` of its random rows; `<row>_nearest` (m) quantiles `share` (m) of the random
    rows' distances from their nearest model.

    Args:
        record: Digest of the record of the models. It is a parameter in order that stored results
            become outdated if the record changes.

    Raises:
        StudyError: If the record has another digest.
    """
    digest = digest_record()
    if digest != record:
        raise StudyError(f"the record of Table 2 has the digest {digest}, not {record}")
    family = read_family()
    uncertainty = {
        row: stress_change_between_adjacent_meshes(family.stresses[element], row)
        for row, element in ELEMENTS.items()
    }
    half_digit = {row: half_printed_digit_in_percent(row) for row in ROWS}
    models = {
        row: collect_models_of_row(family.stresses[element], row)
        for row, element in ELEMENTS.items()
    }
    models["both"] = collect_model_pairs(family)
    for error_by_row in (uncertainty, half_digit):
        error_by_row["both"] = np.concatenate([error_by_row[row] for row in ROWS])

    scalars: dict[str, float] = {}
    curves: dict[str, np.ndarray] = {"share": np.linspace(0, 1, 501)}
    for row, all_models in models.items():
        for group in GROUPS:
            chosen = remove_duplicate_models(all_models.group(group))
            numbers, chance = compare_row_with_models(chosen, uncertainty[row], half_digit[row])
            numbers |= _encode_mesh_set_up_and_treatment(
                chosen.place[chosen.index_of_nearest_model()]
            )
            scalars |= {f"{row}_{group}_{name}": value for name, value in numbers.items()}
            if group == "all":
                curves[f"{row}_nearest"] = np.quantile(chance.distances, curves["share"])
                curves[f"{row}_covariance"] = chance.covariance
                if row in ROWS:
                    curves[f"{row}_deviation"] = chosen.deviation.astype(np.float32)
                    curves[f"{row}_corner"] = np.isin(chosen.place[:, 0], _CORNER_MESHES)
        scalars[f"{row}_family"] = float(len(all_models.deviation))
    for row in ROWS:
        values = zip(uncertainty[row], half_digit[row], strict=True)
        for mode, (change, digit) in enumerate(values, start=1):
            scalars |= {f"{row}_uncertainty_{mode}": change, f"{row}_rounding_{mode}": digit}
        stresses = family.stresses[ELEMENTS[row]]
        best = tuple(models[row].place[models[row].index_of_nearest_model()])
        scalars |= {f"sigma_cr_{row}_{mode}": stresses[best][mode - 1] for mode in (1, 2)}
        scalars[f"{row}_none"] = float(np.isnan(stresses).any(axis=-1).sum())
    scalars |= _compare_near_hit_models(
        family, models["user"], uncertainty["user"], half_digit["user"]
    )
    scalars |= _stress_changes_by_weight_functions(family)
    kinds = dict.fromkeys(("sigma_cr_*", "near_lowest_?", "near_highest_?"), "Pa")
    percent = ("*_distance", "*_best_?", "*_rounding_?", "*_uncertainty_?", "weights_*")
    kinds |= dict.fromkeys(percent, "%")
    units = assign_units_to_scalars(scalars, {**kinds, "*": "1"})
    return Result(scalars, units, curves)


_CORNER_MESHES = [i for i, mesh in enumerate(MESHES) if mesh.ny % 2 == 0]


def _encode_mesh_set_up_and_treatment(place: npt.NDArray[np.intp]) -> dict[str, float]:
    """Return a model's mesh, set-up and treatment as numbers.

    Words are replaced by their indices in the lists of `study.paper.table_2.family`.
    """
    mesh, set_up = MESHES[place[0]], SET_UPS[place[1]]
    return {
        "nx": mesh.nx,
        "ny": mesh.ny,
        "pattern": PATTERNS.index(mesh.pattern),
        "load": LOADS.index(set_up.load),
        "end": ENDS.index(set_up.end),
        "middle": MIDDLES.index(set_up.middle),
        "prestress": PRESTRESS_SUPPORTS.index(set_up.prestress),
        **{f"treatment_{k}": float(t) for k, t in enumerate(place[2:], start=1)},
    }


def _compare_near_hit_models(
    family: Family, models: Models, uncertainty: Array, half_digit: Array
) -> dict[str, float]:
    """Return scalars of the models of the user element that follow the paper most closely.

    Only their mesh and the supports of the mid-section vary. Matrices are as derived and exactly
    integrated, with form G, the point load, and v = 0 only at A. `near_*` are the scalars of
    `compare_row_with_models` for these models, and `near_midside_*` for those with A at a mid-side
    node; `near_chance_in_family` is the chance of a distance as small in the whole family.
    `near_lowest_*` and `near_highest_*` are extreme critical stresses over all patterns with the
    squares and supports of the best model, and `near_cps6_distance` is the distance of the nearest
    model of CPS6's row with these squares and supports.
    """
    treatment = TREATMENTS["new"].index(NEAR_HIT_TREATMENT)
    set_ups = [
        i
        for i, set_up in enumerate(SET_UPS)
        if (set_up.load, set_up.end, set_up.prestress) == ("point", "centre", "antisymmetric")
    ]
    is_near = (models.place[:, 2] == treatment) & np.isin(models.place[:, 1], set_ups)
    chosen = remove_duplicate_models(models.select(is_near))
    numbers, _ = compare_row_with_models(chosen, uncertainty, half_digit)
    midside, _ = compare_row_with_models(chosen.group("midside"), uncertainty, half_digit)
    numbers |= {f"midside_{name}": midside[name] for name in ("models", "chance", "odds")}
    place = chosen.place[chosen.index_of_nearest_model()]
    numbers |= _encode_mesh_set_up_and_treatment(place)
    chance_in_family = simulate_nearest_model_distances(remove_duplicate_models(models))
    numbers["chance_in_family"] = chance_in_family.fraction_of_random_rows_within(
        numbers["distance"]
    )
    squares = MESHES[place[0]][1:]
    meshes = [i for i, mesh in enumerate(MESHES) if mesh[1:] == squares]
    for mode in (1, 2):
        patterns = family.stresses["new"][meshes, place[1], treatment, mode - 1]
        numbers |= {f"lowest_{mode}": patterns.min(), f"highest_{mode}": patterns.max()}
    same_mesh = family.stresses["standard"][meshes][:, [place[1]]]
    numbers["cps6_distance"] = float(
        np.abs(collect_models_of_row(same_mesh, "cps6").deviation).max(axis=1).min()
    )
    return {f"near_{name}": value for name, value in numbers.items()}


def _stress_changes_by_weight_functions(family: Family) -> dict[str, float]:
    """Return the changes of critical stresses due to the weight functions alone, in per cent.

    The new element is compared with the standard one, both exactly integrated with the stress at
    each point, under the point load. The smallest, largest and median changes over meshes, supports
    and forms are given for A at a corner and for A at a mid-side node.
    """
    pairs = [
        (
            TREATMENTS["standard"].index(Treatment(form, "point", 0)),
            TREATMENTS["new"].index(Treatment(form, "point", 3)),
        )
        for form in FORMS
    ]
    standard, new = (list(indices) for indices in zip(*pairs, strict=True))
    set_ups = [i for i, set_up in enumerate(SET_UPS) if set_up.load == "point"]
    ratio = (
        family.stresses["new"][:, set_ups][:, :, new]
        / family.stresses["standard"][:, set_ups][:, :, standard]
    )
    is_corner = np.isin(np.arange(len(MESHES)), _CORNER_MESHES)
    ranges: dict[str, float] = {}
    for group, chosen in (("corner", is_corner), ("midside", ~is_corner)):
        changes = 100 * (ratio[chosen].reshape(-1, 2) - 1)
        for mode, change in enumerate(changes.T, start=1):
            ranges |= {
                f"weights_{group}_least_{mode}": float(np.nanmin(change)),
                f"weights_{group}_largest_{mode}": float(np.nanmax(change)),
                f"weights_{group}_median_{mode}": float(np.nanmedian(change)),
            }
    return ranges

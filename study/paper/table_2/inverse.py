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
the whole family. Groups of models (A a corner node, A a mid-side node) are shown, but do not decide.

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

from study.model.units import units_of
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
    ModelsRecord,
    Treatment,
)
from study.run.store import Result, StudyError

RANDOM_ROWS, SEED = 10_000, 51
MIN_ODDS = 20.0
"""Least odds against chance at which a row is explained."""
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
    """Models of a row, with their deviations (n, k) in per cent from the k printed values.

    `place` (n, p) is the place of each model in the family: the indices of its mesh, its set-up and
    its treatment (or two treatments).
    """

    deviation: Array
    place: npt.NDArray[np.intp]

    def select(self, mask: Mask) -> "Models":
        """Return the models that a mask (n,) selects."""
        return Models(self.deviation[mask], self.place[mask])

    def group(self, name: str) -> "Models":
        """Return the models of a group: "all", or those with A a "corner" or a "midside" node."""
        if name == "all":
            return self
        is_corner = np.isin(self.place[:, 0], _CORNER_MESHES)
        return self.select(is_corner == (name == "corner"))

    def best(self) -> int:
        """Return the index of the model with the smallest distance from the printed values."""
        return int(np.abs(self.deviation).max(axis=1).argmin())


@dataclass(frozen=True)
class Chance:
    """Distribution of the distances between random rows and their nearest models.

    Args:
        distances: Sorted distances of the random rows around the printed values.
        distances_median: Sorted distances of the random rows around the models' median.
        covariance: Covariance matrix of the random rows.
    """

    distances: Array
    distances_median: Array
    covariance: Array

    def within(self, distance: float) -> float:
        """Return the fraction of random rows with a model within a distance, the larger of both."""
        drawn = self.distances, self.distances_median
        return max(float(np.searchsorted(d, distance, "right")) / len(d) for d in drawn)

    def distance_of(self, share: float) -> float:
        """Return the distance within which at most this fraction of random rows has a model."""
        drawn = self.distances, self.distances_median
        return min(float(np.quantile(d, share)) for d in drawn)


def collect(stresses: Array, row: str) -> Models:
    """Return the models of one row that have both critical stresses, from an array of `Family`."""
    place = np.argwhere(np.isfinite(stresses).all(axis=-1))
    printed = np.array(TABLE_2[ROWS[row]])
    return Models(100 * (stresses[tuple(place.T)] / printed - 1), place)


def collect_pairs(family: Family) -> Models:
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


def distinct(models: Models) -> Models:
    """Return the models without duplicates: of models with equal values only the first is kept."""
    _, first = np.unique(models.deviation.round(6), axis=0, return_index=True)
    first.sort()
    return Models(models.deviation[first], models.place[first])


def estimate_chance(models: Models) -> Chance:
    """Draw random rows with the models' scatter and find their distances from the models."""
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
    return Chance(distances[0], distances[1], covariance)


def model_uncertainty(stresses: Array, row: str) -> Array:
    """Return the typical changes (2,) of the values between adjacent meshes, in per cent."""
    neighbours = [
        (i, k)
        for (i, one), (k, other) in combinations(enumerate(MESHES), 2)
        if one.ny == other.ny
        and ((one.pattern == other.pattern and abs(one.nx - other.nx) == 1) or one.nx == other.nx)
    ]
    first, second = np.array(neighbours).T
    change = 100 * (stresses[first] - stresses[second]) / np.array(TABLE_2[ROWS[row]])
    return MEDIAN_TO_DEVIATION * np.nanmedian(np.abs(change), axis=(0, 1, 2))


def rounding(row: str) -> Array:
    """Return half a unit of the last printed digit, (2,), in per cent of the printed values."""
    return 100 * PRINTED_DIGIT / 2 / np.array(TABLE_2[ROWS[row]])


def likelihood_shares(models: Models, uncertainty: Array, half_digit: Array) -> Array:
    """Return each model's share (n,) of the total likelihood."""
    deviation = np.sqrt(uncertainty**2 + half_digit**2 / 3)
    exponent = -((models.deviation / deviation) ** 2).sum(axis=1) / 2
    likelihood = np.exp(exponent - exponent.max())
    return likelihood / likelihood.sum()


def judge_row(
    models: Models, uncertainty: Array, half_digit: Array
) -> tuple[dict[str, float], Chance]:
    """Return the scalars of one row for a set of distinct models, and its chance."""
    best, chance = models.best(), estimate_chance(models)
    distance = float(np.abs(models.deviation[best]).max())
    share = chance.within(distance)
    shares = likelihood_shares(models, uncertainty, half_digit)
    mesh_shares = np.bincount(models.place[:, 0], shares)
    scalars = {
        "models": float(len(models.deviation)),
        "distance": distance,
        "chance": share,
        "odds": (1 - share) / max(share, 1 / RANDOM_ROWS),
        "critical_distance": chance.distance_of(1 / (1 + MIN_ODDS)),
        "largest_share": float(shares.max()),
        "largest_mesh_share": float(mesh_shares.max()),
        "within_rounding": float((np.abs(models.deviation) <= half_digit).all(axis=1).sum()),
    }
    scalars |= {f"best_{k}": x for k, x in enumerate(models.deviation[best], start=1)}
    return scalars, chance


def inverse_problem(record: str) -> Result:
    """Judge each row and all four values by all models and by each group, and the near hit.

    Scalars are named by row (cps6, user, or both) and group. Curves: `<row>_deviation` (n, 2) and
    `<row>_corner` (n) of the distinct models of a row; `<row>_covariance` of its random rows;
    `<row>_nearest` (m) quantiles `share` (m) of the random rows' distances from their nearest model.

    Args:
        record: Digest of the record of the models. It is a parameter in order that stored results
            become outdated if the record changes.

    Raises:
        StudyError: If the record has another digest.
    """
    tracked = ModelsRecord()
    if tracked.digest != record:
        raise StudyError(f"{tracked.path.name} has the digest {tracked.digest}, not {record}")
    family = tracked.family()
    uncertainty = {
        row: model_uncertainty(family.stresses[element], row) for row, element in ELEMENTS.items()
    }
    half_digit = {row: rounding(row) for row in ROWS}
    models = {row: collect(family.stresses[element], row) for row, element in ELEMENTS.items()}
    models["both"] = collect_pairs(family)
    for known in (uncertainty, half_digit):
        known["both"] = np.concatenate([known[row] for row in ROWS])

    scalars: dict[str, float] = {}
    curves: dict[str, np.ndarray] = {"share": np.linspace(0, 1, 501)}
    for row, all_models in models.items():
        for group in GROUPS:
            chosen = distinct(all_models.group(group))
            numbers, chance = judge_row(chosen, uncertainty[row], half_digit[row])
            numbers |= _describe(chosen.place[chosen.best()])
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
        best = tuple(models[row].place[models[row].best()])
        scalars |= {f"sigma_cr_{row}_{mode}": stresses[best][mode - 1] for mode in (1, 2)}
        scalars[f"{row}_none"] = float(np.isnan(stresses).any(axis=-1).sum())
    scalars |= _judge_near_hit(family, models["user"], uncertainty["user"], half_digit["user"])
    scalars |= _ranges_of_weights(family)
    kinds = dict.fromkeys(("sigma_cr_*", "near_lowest_?", "near_highest_?"), "Pa")
    percent = ("*_distance", "*_best_?", "*_rounding_?", "*_uncertainty_?", "weights_*")
    kinds |= dict.fromkeys(percent, "%")
    units = units_of(scalars, {**kinds, "*": "1"})
    return Result(scalars, units, curves)


_CORNER_MESHES = [i for i, mesh in enumerate(MESHES) if mesh.ny % 2 == 0]


def _describe(place: npt.NDArray[np.intp]) -> dict[str, float]:
    """Return a model's mesh, set-up and treatment as numbers: indices in the family's lists."""
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


def _judge_near_hit(
    family: Family, models: Models, uncertainty: Array, half_digit: Array
) -> dict[str, float]:
    """Return scalars of those models of the user element in which only mesh and mid-section vary.

    These models have matrices as derived, exact integration, form G, the point load, and v = 0 at A
    only. `near_*` are the scalars of `judge_row` for these models, and `near_midside_*` for those
    with A at a mid-side node; `near_chance_in_family` is the chance of a distance as small in the
    whole family. `near_lowest_*` and `near_highest_*` are extreme critical stresses over all
    patterns with the squares and supports of the best model, and `near_cps6_distance` is the
    distance of the nearest model of CPS6's row with these squares and supports.
    """
    treatment = TREATMENTS["new"].index(NEAR_HIT_TREATMENT)
    set_ups = [
        i
        for i, set_up in enumerate(SET_UPS)
        if (set_up.load, set_up.end, set_up.prestress) == ("point", "centre", "antisymmetric")
    ]
    is_near = (models.place[:, 2] == treatment) & np.isin(models.place[:, 1], set_ups)
    chosen = distinct(models.select(is_near))
    numbers, _ = judge_row(chosen, uncertainty, half_digit)
    midside, _ = judge_row(chosen.group("midside"), uncertainty, half_digit)
    numbers |= {f"midside_{name}": midside[name] for name in ("models", "chance", "odds")}
    place = chosen.place[chosen.best()]
    numbers |= _describe(place)
    chance_in_family = estimate_chance(distinct(models))
    numbers["chance_in_family"] = chance_in_family.within(numbers["distance"])
    squares = MESHES[place[0]][1:]
    meshes = [i for i, mesh in enumerate(MESHES) if mesh[1:] == squares]
    for mode in (1, 2):
        patterns = family.stresses["new"][meshes, place[1], treatment, mode - 1]
        numbers |= {f"lowest_{mode}": patterns.min(), f"highest_{mode}": patterns.max()}
    same_mesh = family.stresses["standard"][meshes][:, [place[1]]]
    numbers["cps6_distance"] = float(np.abs(collect(same_mesh, "cps6").deviation).max(axis=1).min())
    return {f"near_{name}": value for name, value in numbers.items()}


def _ranges_of_weights(family: Family) -> dict[str, float]:
    """Return by how much the weight functions alone change critical stresses, in per cent.

    The new element is compared with the standard one, both exactly integrated with the stress at
    each point, under the point load. The least, largest and median changes over meshes, supports
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

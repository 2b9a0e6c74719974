"""Table 2 as an inverse problem: which models of the family give the printed critical stresses?

What follows was fixed before the first value of the family was computed.

Rows: CPS6's two values by the standard element, the user element's two by the new one, and all four
by pairs that share mesh and set-up. CPS6M has no model. A model's distance from a row is the largest
relative deviation from its printed values. The best model has the smallest distance.

Chance: 10 000 random rows are drawn from a normal distribution with the models' scatter: per value
half of the range between their 16 % and 84 % quantiles, with their rank correlations. The chance is
the share of random rows that have a model as near as the best one is to the print. It is computed
for random rows around the print and around the models' median, and the larger one counts.

Criterion: a row is explained if the odds against chance, (1 - chance) / chance, are at least 20, over
the whole family. Groups of models (A a corner node, A a mid-side node) are shown, but do not decide.

Likelihood: normal about each model, with a variance that adds that of the print's rounding and the
square of the models' uncertainty. This is the median change (times 1.4826) from one mesh to the next
one: one more square along the beam, or another pattern of diagonals. A model's share is its
likelihood over the sum for all distinct models.
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
"""Odds against chance from which on a row is explained."""
QUANTILES = (0.16, 0.84)
"""Of a normal distribution they are a standard deviation from the median."""
MEDIAN_TO_DEVIATION = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute values."""
PRINTED_DIGIT = 1e5
"""Last printed digit of Table 2's computed values, in Pa."""

ROWS = {"cps6": "CPS6", "user": "6-node user element"}
ELEMENTS = {"cps6": "standard", "user": "new"}
GROUPS = ("all", "corner", "midside")
NEAR_HIT_TREATMENT = Treatment("G", "point", 3, "no")
"""The paper's: matrices as derived, exactly integrated, form G."""

Mask = npt.NDArray[np.bool_]


class Models(NamedTuple):
    """Models of a row: deviations (n, k) from the k printed values in per cent, and whose they are.

    `place` (n, p) is the place of each model in the family: mesh, set-up, treatment (or two).
    """

    deviation: Array
    place: npt.NDArray[np.intp]

    def select(self, mask: Mask) -> "Models":
        """Return the models of a mask (n,)."""
        return Models(self.deviation[mask], self.place[mask])

    def group(self, name: str) -> "Models":
        """Return all models, or those whose loaded point A is a corner or a mid-side node."""
        if name == "all":
            return self
        is_corner = np.isin(self.place[:, 0], _CORNER_MESHES)
        return self.select(is_corner == (name == "corner"))

    def best(self) -> int:
        """Return the model with the smallest distance from the print."""
        return int(np.abs(self.deviation).max(axis=1).argmin())


@dataclass(frozen=True)
class Chance:
    """How often random rows are met as closely as the printed one.

    Args:
        distances: of the random rows around the print from their nearest models, sorted.
        distances_median: of those around the models' median, sorted.
        covariance: of the random rows.
    """

    distances: Array
    distances_median: Array
    covariance: Array

    def within(self, distance: float) -> float:
        """Return the share of random rows with a model within a distance, the larger of both."""
        drawn = self.distances, self.distances_median
        return max(float(np.searchsorted(d, distance, "right")) / len(d) for d in drawn)

    def distance_of(self, share: float) -> float:
        """Return the distance within which at most this share of random rows has a model."""
        drawn = self.distances, self.distances_median
        return min(float(np.quantile(d, share)) for d in drawn)


def collect(stresses: Array, row: str) -> Models:
    """Return the models of one row with both critical stresses; stresses as in `Family`."""
    place = np.argwhere(np.isfinite(stresses).all(axis=-1))
    printed = np.array(TABLE_2[ROWS[row]])
    return Models(100 * (stresses[tuple(place.T)] / printed - 1), place)


def collect_pairs(family: Family) -> Models:
    """Return all pairs of models that share mesh and set-up, with four deviations each."""
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
    """Return one model of each set of models with the same values, the first in the family."""
    _, first = np.unique(models.deviation.round(6), axis=0, return_index=True)
    first.sort()
    return Models(models.deviation[first], models.place[first])


def estimate_chance(models: Models) -> Chance:
    """Draw random rows with the models' scatter and find their distances from the models."""
    low, high = np.quantile(models.deviation, QUANTILES, axis=0)
    scatter = (high - low) / 2
    rank = np.atleast_2d(spearmanr(models.deviation).statistic)
    if rank.size == 1:  # of two columns it is a number
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
    """Return by how much a value changes from one mesh to the next, (2,), in per cent."""
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
    """Return half a unit of the last printed digit in per cent of the printed values, (2,)."""
    return 100 * PRINTED_DIGIT / 2 / np.array(TABLE_2[ROWS[row]])


def likelihood_shares(models: Models, uncertainty: Array, half_digit: Array) -> Array:
    """Return each model's share (n,) of the likelihood."""
    deviation = np.sqrt(uncertainty**2 + half_digit**2 / 3)
    exponent = -((models.deviation / deviation) ** 2).sum(axis=1) / 2
    likelihood = np.exp(exponent - exponent.max())
    return likelihood / likelihood.sum()


def judge_row(
    models: Models, uncertainty: Array, half_digit: Array
) -> tuple[dict[str, float], Chance]:
    """Return the numbers of one row over some distinct models, and its chance."""
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
    """Judge each row and all four values by all models, by those of a group, and the near hit.

    Scalars are named by row (cps6, user, or both) and group. Curves: `<row>_deviation` (n, 2) and
    `<row>_corner` (n) of the distinct models of a row; `<row>_covariance` of its random rows;
    `<row>_nearest` (m) quantiles `share` (m) of the random rows' distances from their nearest model.

    Args:
        record: digest of the record of the models, by which a stored result is outdated if the
            record has changed.

    Raises:
        StudyError: if the record has another digest.
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
    """Return mesh, set-up and treatment of a model as numbers: places in the family's lists."""
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
    """Return the numbers of the user element's models that leave only mesh and mid-section open.

    They have the matrices as derived, exactly integrated, form G, the point load and v = 0 at A
    alone. `near_*` are numbers of these models, as of a row, and of those with A at a mid-side node;
    `near_chance_in_family` is the chance in the whole family of a distance as small.
    `near_lowest_*` and `near_highest_*` are over the patterns with the best model's squares and
    supports, and `near_cps6_distance` is that of the nearest model of CPS6's row there.
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

    New over standard element, both exactly integrated with the stress at each point, under the
    point load: least, largest and median over meshes, supports and forms, by the place of A.
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

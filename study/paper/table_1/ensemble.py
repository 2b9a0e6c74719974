"""Columns fitted to CAX6 and CAX8 of Table 1 alone, for each set of supports of the vibration.

They are recorded: `./run python3 -m study.publish.renew_records 'table-1-columns/*'` fits all anew,
in 16 CPU minutes.

What follows was fixed before any eigenvalue of a user element was computed on these columns.

The column is fitted to the twelve printed eigenvalues of CAX6 and CAX8, by the standard 6-node
triangle and the standard 8-node quadrilateral with their consistent mass; the user elements' rows
take no part. Eight lengths are free. Divisions (759 quadrilaterals), diagonals, grading towards the
re-entrant corners and fillets in them are drawn at random, and so are the lengths from which the
fit starts; each step changes them as little as it can, so that many different columns result.

Acceptance: all twelve computed eigenvalues within `ACCEPTED_DEVIATION` of the print. That is the
largest printed difference between CAX6 and CAX8 (0.020 % in mode 6), which a column with coarse
elements at sharp corners does not meet, and a quarter of the largest printed shift of the 6-node
user element.

Supports: the vibration step follows the contact step, so that closed contact nodes may support it.
All combinations of the four surfaces are tried, normal to the surface or in its plane as well. A
set of supports under which no column comes within `SCOUTED_DEVIATION` on a coarse mesh is left out.
"""

from functools import cache
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from pw_elements.meshes import DiagonalPattern
from study.paper.items import TABLE_1
from study.paper.s7_5_profiles import PROFILES
from study.paper.table_1.columns import (
    N_RADII,
    Array,
    MovingMeshElement,
    Shape,
    Supports,
    Topology,
    compute_standard_element_eigenvalues,
    make_standard_quadrilateral_element,
    make_standard_triangle_element,
)
from study.run import records
from study.run.records import RecordRow

SUPPORTS = tuple(
    Supports(surfaces, tangential)
    for count in (1, 2, 3, 4)
    for surfaces in combinations((1, 2, 3, 4), count)
    for tangential in (False, True)
)
"""Candidates: all combinations of surfaces, each normal, or normal and tangential."""

ACCEPTED_DEVIATION, SCOUTED_DEVIATION = 0.02, 0.5
"""Largest deviation from a printed eigenvalue, in per cent."""
COLUMNS, MAX_DRAWS, MAX_DRAWS_WITHOUT_SUCCESS = 12, 72, 8
"""Accepted columns for each set of supports, and the draws after which no more are tried."""
SCOUTS, SCOUT_STEPS, STEPS = 6, 25, 16
"""Starts of the coarse fit, its steps, and those of a column's fit."""
SCOUT_SCATTER, SCATTER = 0.4, 0.1
"""Standard deviations of the logarithms of the lengths at the starts."""
SEED = 1

DIVISIONS: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...] = (
    ((5, 1, 7, 4), (26, 17, 21, 5)),
    ((5, 1, 7, 4), (24, 17, 22, 4)),
    ((5, 2, 8, 4), (24, 14, 19, 4)),
    ((4, 1, 9, 5), (24, 16, 21, 4)),
)
"""Rings and heights of the page's mesh and of three others, of 759 quadrilaterals each."""
PATTERNS: tuple[DiagonalPattern, ...] = ("right", "left", "right_left")
COARSE_TOPOLOGY = Topology((2, 1, 3, 2), (8, 6, 8, 3), "right")
GRADINGS, FILLETS = (1.0, 16.0), (0.0, 0.35)
"""Ranges, of the logarithm and of the value; every third column has sharp corners."""

PRINTED = np.array([TABLE_1["CAX6"], TABLE_1["CAX8"]])
_DIFFERENCE_STEP, _DAMPING, _MAX_CHANGE = 1e-4, 1e-2, 0.2
"""Of a logarithm of a length; the damping in per cent for each unit of it."""


class Column(NamedTuple):
    """A column that fits: its mesh, shape, and the eigenvalues (2, 6) of CAX6 and CAX8."""

    topology: Topology
    shape: Shape
    standard: Array


@cache
def make_standard_elements(topology: Topology) -> tuple[MovingMeshElement, MovingMeshElement]:
    """Return the standard triangle and quadrilateral on a topology."""
    return (
        make_standard_triangle_element(topology),
        make_standard_quadrilateral_element(topology),
    )


def deviations(values: Array) -> Array:
    """Return computed over printed eigenvalues (2, 6) less 1, in per cent; NaN becomes infinite."""
    return np.nan_to_num(100 * (values / PRINTED - 1), nan=np.inf)


def _fit(
    elements: tuple[MovingMeshElement, ...],
    printed: Array,
    start: Shape,
    supports: Supports,
    steps: int,
) -> tuple[Shape, Array]:
    """Return the shape of the smallest sum of squares that damped Gauss-Newton steps find.

    Args:
        elements: with a printed row each; the last one gives the derivatives.
        printed: eigenvalues (elements, 6).
        start: shape from which the steps go on.
        supports: of the vibration.
        steps: their largest number.
    """

    def logarithms(shape: Shape, chosen: tuple[MovingMeshElement, ...]) -> Array:
        values = [
            compute_standard_element_eigenvalues(element, shape, supports) for element in chosen
        ]
        return 100 * np.log(np.array(values))

    scale = np.exp((logarithms(start, elements[-1:])[0] - 100 * np.log(printed[-1])).mean() / 200)
    shape = start._replace(lengths=start.lengths * scale)
    misfit = logarithms(shape, elements) - 100 * np.log(printed)
    for _ in range(steps):
        if np.abs(misfit).max() < ACCEPTED_DEVIATION / 4:
            break
        base = misfit[-1] + 100 * np.log(printed[-1])
        derivative = np.empty((base.size, shape.lengths.size))
        for k in range(shape.lengths.size):
            factors = np.ones(shape.lengths.size)
            factors[k] += _DIFFERENCE_STEP
            changed = shape._replace(lengths=shape.lengths * factors)
            derivative[:, k] = (logarithms(changed, elements[-1:])[0] - base) / _DIFFERENCE_STEP
        jacobian = np.concatenate([derivative] * len(elements))
        normal = jacobian.T @ jacobian + _DAMPING * np.eye(jacobian.shape[1])
        change = -np.linalg.solve(normal, jacobian.T @ misfit.ravel())
        change *= min(1.0, _MAX_CHANGE / np.abs(change).max())
        while True:
            trial = shape._replace(lengths=shape.lengths * np.exp(change))
            trial_misfit = np.full_like(misfit, np.inf)
            if _is_column(trial.lengths):
                trial_misfit = logarithms(trial, elements) - 100 * np.log(printed)
            if np.nansum(trial_misfit**2) < np.sum(misfit**2) and np.isfinite(trial_misfit).all():
                break
            change = change / 4
            if np.abs(change).max() < _DIFFERENCE_STEP / 10:
                return shape, misfit
        previous, shape, misfit = np.sum(misfit**2), trial, trial_misfit
        if np.sum(misfit**2) > 0.999 * previous:
            break
    return shape, misfit


def _is_column(lengths: Array) -> bool:
    r1, r2, r3, r4 = lengths[:N_RADII]
    return bool(0 < r4 < 0.98 * r1 and r1 < 0.98 * r2 and r2 < 0.98 * r3)


def _draw_lengths(centre: Array, scatter: float, random: np.random.Generator) -> Array:
    while True:
        lengths = centre * np.exp(scatter * random.standard_normal(centre.size))
        if _is_column(lengths):
            return lengths


def page_lengths(name: str) -> Array:
    """Return radii and heights (8,) of a column of the page: "first" or "second"."""
    profile = PROFILES[name]
    return np.array([*profile.radii, *profile.heights])


def scout(supports: Supports) -> tuple[Array, float]:
    """Fit columns to CAX8 on a coarse mesh; return the best's lengths and largest deviation, in %."""
    random = np.random.default_rng([SEED, *supports.surfaces, supports.tangential])
    element = make_standard_quadrilateral_element(COARSE_TOPOLOGY)
    best, least = page_lengths("first"), np.inf
    for k in range(SCOUTS):
        start = page_lengths("first" if k % 2 == 0 else "second")
        lengths = start if k < 2 else _draw_lengths(start, SCOUT_SCATTER, random)
        shape, misfit = _fit((element,), PRINTED[1:], Shape(lengths), supports, SCOUT_STEPS)
        if np.abs(misfit).max() < least:
            best, least = shape.lengths, float(np.abs(misfit).max())
        if least < ACCEPTED_DEVIATION:
            break
    return best, least


def fit_columns(supports: Supports, centre: Array) -> tuple[list[Column], int, float]:
    """Return the accepted columns around some lengths (8,), the draws, and the least deviation."""
    random = np.random.default_rng([SEED, *supports.surfaces, supports.tangential])
    accepted: list[Column] = []
    least = np.inf
    for draw in range(1, MAX_DRAWS + 1):
        divisions = DIVISIONS[random.integers(len(DIVISIONS))]
        topology = Topology(*divisions, PATTERNS[random.integers(len(PATTERNS))])
        grading = round(float(np.exp(random.uniform(*np.log(GRADINGS)))), 3)
        fillet = 0.0 if draw % 3 == 0 else round(float(random.uniform(*FILLETS)), 3)
        start = Shape(_draw_lengths(centre, SCATTER, random), grading, fillet)
        pair = make_standard_elements(topology)
        shape, _ = _fit(pair, PRINTED, start, supports, STEPS)
        shape = shape._replace(lengths=shape.lengths.round(7))
        values = np.array(
            [compute_standard_element_eigenvalues(element, shape, supports) for element in pair]
        )
        least = min(least, float(np.abs(deviations(values)).max()))
        if np.abs(deviations(values)).max() <= ACCEPTED_DEVIATION:
            accepted.append(Column(topology, shape, values))
        if len(accepted) == COLUMNS or (not accepted and draw == MAX_DRAWS_WITHOUT_SUCCESS):
            break
    return accepted, draw, least


# The record

RECORD_TOLERANCE = 10
"""Last digits by which a column that is fitted again may differ from the record."""
_LENGTH_DIGIT, _SCOUTED_DIGIT, _LEAST_DIGIT = 1e-7, 1e-3, 1e-4
"""Last recorded digits of lengths in m, and of deviations in per cent."""


def list_keys() -> list[str]:
    """Return the keys of all rows, such as "table-1-columns/14-tangential"."""
    return [f"table-1-columns/{_name_supports(supports)}" for supports in SUPPORTS]


def digest_input(supports: Supports) -> str:
    """Return the digest of all that decides which columns are fitted under some supports."""
    return records.digest_input(
        {
            "supports": supports[:2],
            "printed": PRINTED.tolist(),
            "deviations": [ACCEPTED_DEVIATION, SCOUTED_DEVIATION],
            "draws": [COLUMNS, MAX_DRAWS, MAX_DRAWS_WITHOUT_SUCCESS],
            "steps": [SCOUTS, SCOUT_STEPS, STEPS, SCOUT_SCATTER, SCATTER, SEED],
            "starts": [page_lengths(name).tolist() for name in ("first", "second")],
            "meshes": [DIVISIONS, PATTERNS, COARSE_TOPOLOGY, GRADINGS, FILLETS],
        }
    )


def compute_row(key: str) -> RecordRow:
    """Fit the columns under the supports of a key."""
    supports = SUPPORTS[list_keys().index(key)]
    centre, scouted = scout(supports)
    columns: list[Column] = []
    draws, least = 0, scouted
    if scouted <= SCOUTED_DEVIATION:
        columns, draws, least = fit_columns(supports, centre)
    content = {
        "supports": [list(supports.surfaces), supports.tangential],
        "scouted": round(scouted, 3),
        "draws": draws,
        "least": round(least, 4),
        "columns": [
            [
                [*map(list, column.topology[:2]), column.topology.pattern],
                column.shape.lengths.tolist(),
                *column.shape[1:],
            ]
            for column in columns
        ],
    }
    return records.create_row_with_current_date(key, digest_input(supports), content)


def difference_of_rows(row: RecordRow, recorded: RecordRow) -> float:
    """Return the largest difference of two rows in last digits; infinite for other meshes.

    Args:
        row: Computed row.
        recorded: Recorded row with the same key.
    """
    new, old = row.content, recorded.content
    if new["draws"] != old["draws"] or _list_meshes(new) != _list_meshes(old):
        return float("inf")
    differences = [
        abs(new["scouted"] - old["scouted"]) / _SCOUTED_DIGIT,
        abs(new["least"] - old["least"]) / _LEAST_DIGIT,
    ]
    for (_, lengths, *_), (_, old_lengths, *_) in zip(new["columns"], old["columns"], strict=True):
        differences.append(np.abs(np.subtract(lengths, old_lengths)).max() / _LENGTH_DIGIT)
    return float(max(differences))


def read_columns() -> dict[str, tuple[Supports, Topology, Shape]]:
    """Return all recorded columns with their supports, by names such as "14-tangential-1"."""
    columns = {}
    for row in records.read_rows(records.TABLE_1_COLUMNS).values():
        supports = Supports(tuple(row.content["supports"][0]), row.content["supports"][1])
        for number, (topology, lengths, grading, fillet) in enumerate(row.content["columns"], 1):
            columns[f"{_name_supports(supports)}-{number}"] = (
                supports,
                Topology(tuple(topology[0]), tuple(topology[1]), topology[2]),
                Shape(np.array(lengths), grading, fillet),
            )
    return columns


def _name_supports(supports: Supports) -> str:
    return "".join(map(str, supports.surfaces)) + "-tangential" * supports.tangential


def _list_meshes(content: dict[str, Any]) -> list[Any]:
    return [[topology, grading, fillet] for topology, _, grading, fillet in content["columns"]]

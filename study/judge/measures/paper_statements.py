"""Measures for statements of the paper on cost and on the shear stress of Fig. 10."""

from typing import Literal

import numpy as np
import numpy.typing as npt

from study.model.vocabulary import STICK
from study.paper.bands import OTHER_DIAGONALS, list_keys_of_case_and_variants
from study.run.store import Results

Array = npt.NDArray[np.float64]

FINE_PUNCH = "7.3/pw-T6-114x24"
STICK_HALF_LENGTH = 1.1  # half length over which the punch sticks
N_SHEAR_SAMPLES = 20_001  # samples of the shear, about 90 between adjacent nodes


def factor_entries_ratio(results: Results, key: str, other: str) -> float:
    """Return the ratio of the numbers of entries in the matrix factors of two cases."""
    return results.scalar(key, "entries") / results.scalar(other, "entries")


def shear_deviation_from_fine(
    results: Results,
    key: str,
    within: float | None = None,
    kind: Literal["largest", "rms"] = "largest",
    averaged_on: str = "",
    fine: str = FINE_PUNCH,
    surface: str = "",
) -> float:
    """Return the deviation of the shear along a contact surface from that on a fine mesh.

    The shear at a node is its force divided by the integral of its own test function. The shear on
    the fine mesh is averaged with that function. The deviation is in per cent of the largest shear
    on the fine mesh.

    Args:
        results: stored results.
        key: key of the case.
        within: if given, nodes with |x| < `within` are compared; otherwise, nodes that stick.
        kind: whether the largest or the root mean square deviation is returned.
        averaged_on: key of a coarser case, with whose test functions both shears are averaged.
        fine: key of the case on the fine mesh.
        surface: number of the contact surface if the body is axisymmetric.
    """
    suffix = f"_{surface}" if surface else ""
    curves, fine_curves, case = (
        results.curves(key),
        results.curves(fine),
        results[averaged_on or key],
    )
    nodes, standard = case.curves[f"x{suffix}"], case.parameters["element"].startswith("galerkin")
    x = np.linspace(fine_curves[f"x{suffix}"][0], fine_curves[f"x{suffix}"][-1], N_SHEAR_SAMPLES)
    weights = _evaluate_test_functions_on_line(nodes, x, standard) * (x if surface else 1.0)

    def average_shear_with_test_functions(sampled_curves: dict[str, Array]) -> Array:
        shear = np.interp(x, sampled_curves[f"x{suffix}"], sampled_curves[f"shear{suffix}"])
        with np.errstate(invalid="ignore", divide="ignore"):  # no weight on the axis
            return weights @ shear / weights.sum(axis=1)

    deviation = (
        average_shear_with_test_functions(curves) if averaged_on else curves[f"shear{suffix}"]
    ) - average_shear_with_test_functions(fine_curves)
    sticks = case.curves[f"status{suffix}"] == STICK
    deviation = deviation[sticks if within is None else np.abs(nodes) < within]
    deviation_size = (
        np.nanmax(np.abs(deviation)) if kind == "largest" else np.sqrt(np.mean(deviation**2))
    )
    return float(100 * deviation_size / np.nanmax(np.abs(fine_curves[f"shear{suffix}"])))


def _evaluate_test_functions_on_line(nodes: Array, x: Array, standard: bool) -> Array:
    """Return the test functions (m, n) of nodes (m,) on a line at positions (n,).

    They are quadratic functions if `standard` is true, and otherwise hat functions.
    """
    if not standard:
        return np.array([np.interp(x, nodes, unit) for unit in np.eye(len(nodes))])
    corners = nodes[::2]
    hats = np.array([np.interp(x, corners, unit_vector) for unit_vector in np.eye(len(corners))])
    functions = np.empty((len(nodes), len(x)))
    functions[1::2] = 4 * hats[:-1] * hats[1:]
    functions[::2] = hats
    functions[2::2] -= functions[1::2] / 2
    functions[:-1:2] -= functions[1::2] / 2
    return functions


def extreme_shear_deviation(results: Results, end: Literal["least", "largest"]) -> float:
    """Return the smallest or largest `shear_deviation_from_fine` of pw-T6 below the punch.

    The extreme is taken over meshes with different diagonals. `end` is "least" or "largest".
    """
    keys = list_keys_of_case_and_variants("7.3/pw-T6", OTHER_DIAGONALS)
    return (min if end == "least" else max)(
        shear_deviation_from_fine(results, key, STICK_HALF_LENGTH) for key in keys
    )


# Section, and name of the scalar with the ratio of mid-side to corner force
_SAWTOOTH_SCALARS = [(section, "sawtooth") for section in ("7.2", "7.3", "7.4")]
_SAWTOOTH_SCALARS += [("7.5", f"sawtooth_{surface}") for surface in (1, 2, 3, 4)]
_STANDARD_ELEMENTS = ("galerkin-T6", "galerkin-Q8")


def farthest_corner_force_ratio(results: Results) -> float:
    """Return the ratio of corner to mid-side force that deviates most from 1/2.

    Both standard elements and all contact examples are considered.
    """
    ratios = [
        1 / results.scalar(f"{section}/{element}", name)
        for section, name in _SAWTOOTH_SCALARS
        for element in _STANDARD_ELEMENTS
    ]
    return max(ratios, key=lambda ratio: abs(ratio - 0.5))

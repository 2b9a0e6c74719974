"""Measures for the contact examples in sections 7.2 to 7.5."""

from collections.abc import Mapping

import numpy as np

from study.judge.measures.stored_cases import T6_ELEMENTS
from study.model.vocabulary import OPEN, SLIP, STICK
from study.run.store import Results

BLOCK_PRESSURE = 200.0


def slip_sawtooth(results: Results, key: str) -> float:
    """Return the ratio of shear forces at slipping mid-side nodes and at their adjacent corners.

    For each mid-side node, the force is divided by the mean of the forces at both adjacent corners;
    the median of these ratios is returned.
    """
    curves = results.curves(key)
    return _median_midside_to_corner_shear(
        curves, (curves["status"] == SLIP) & (curves["friction"] > 0), 3
    )


def stick_sawtooth(results: Results, key: str) -> float:
    """Return the ratio of shear forces at sticking mid-side nodes and at their adjacent corners.

    It is computed as in `slip_sawtooth`.
    """
    curves = results.curves(key)
    return _median_midside_to_corner_shear(curves, curves["status"] == STICK, 1)


def _median_midside_to_corner_shear(
    curves: Mapping[str, np.ndarray], is_evaluated: np.ndarray, first_midside: int
) -> float:
    force = curves["force_t"]
    midside_nodes = np.arange(first_midside, len(force) - first_midside, 2)
    evaluated_midside_nodes = midside_nodes[
        is_evaluated[midside_nodes]
        & is_evaluated[midside_nodes - 1]
        & is_evaluated[midside_nodes + 1]
    ]
    return float(
        np.median(
            2
            * force[evaluated_midside_nodes]
            / (force[evaluated_midside_nodes - 1] + force[evaluated_midside_nodes + 1])
        )
    )


def stress_difference(
    results: Results, key: str, other: str, low: float, high: float, name: str = "pressure"
) -> float:
    """Return the largest difference of two stress curves in low <= x <= high.

    It is in per cent of the mean absolute value of the second curve.
    """
    first_curves, second_curves = results.curves(key), results.curves(other)
    x = first_curves["x"][(first_curves["x"] >= low - 1e-9) & (first_curves["x"] <= high + 1e-9)]
    first_stress, second_stress = (
        np.interp(x, curves["x"], curves[name]) for curves in (first_curves, second_curves)
    )
    return float(100 * np.abs(first_stress - second_stress).max() / np.abs(second_stress).mean())


def transfer_defect(results: Results, section: str, component: str, suffix: str = "") -> float:
    """Return the largest difference between transferred and new nodal forces.

    The transferred forces are those of the standard triangle, multiplied by the matrix T of
    `force_transfer`. The difference is in per cent of the mean normal force of the closed nodes of
    the new triangle.
    """
    galerkin, pw = (results.curves(f"{section}/{element}{suffix}") for element in T6_ELEMENTS)
    mean = pw["force_n"][pw["status"] != OPEN].mean()
    return float(100 * np.abs(galerkin[f"{component}_T"] - pw[component]).max() / mean)


def displacement_change(results: Results, section: str) -> float:
    """Return the relative difference of the displacements of new and standard triangle.

    It is the ratio of Euclidean norms, in per cent.
    """
    galerkin, pw = (
        results.curves(f"{section}/{element}")["displacement"] for element in T6_ELEMENTS
    )
    return float(100 * np.linalg.norm(pw - galerkin) / np.linalg.norm(galerkin))


def displacement_change_by_smooth_nodes(results: Results, element: str) -> float:
    """Return the change of the mean tangential displacement if the shared nodes are frictionless.

    It is in per cent of the value with friction at these nodes.
    """
    rough_mean, smooth_mean = (
        results.curves(f"7.2/{element}{suffix}")["displacement"][:, 0].mean()
        for suffix in ("", "-smooth")
    )
    return float(100 * (smooth_mean / rough_mean - 1))


# Section, suffix of the case after the name of the element, name of the scalar
_SAWTOOTH_SCALARS = [(section, "", "sawtooth") for section in ("7.2", "7.3", "7.4")]
_SAWTOOTH_SCALARS += [
    ("7.5", column, f"sawtooth_{surface}") for column in ("", "-second") for surface in (1, 2, 3, 4)
]


def largest_unevenness_of_forces(results: Results) -> float:
    """Return the largest deviation from 1 of the ratio of mid-side to corner force, new elements.

    The maximum is taken over pw-T6, pw-Q8 and the contact surfaces of sections 7.2 to 7.5.
    """
    return max(
        abs(results.scalar(f"{section}/{element}{suffix}", name) - 1)
        for section, suffix, name in _SAWTOOTH_SCALARS
        for element in ("pw-T6", "pw-Q8")
    )


def smallest_sawtooth_of_standard(results: Results) -> float:
    """Return the smallest ratio of mid-side to corner force, standard elements.

    The minimum is taken over galerkin-T6, galerkin-Q8 and the contact surfaces of sections 7.2 to
    7.5.
    """
    return min(
        results.scalar(f"{section}/{element}{suffix}", name)
        for section, suffix, name in _SAWTOOTH_SCALARS
        for element in ("galerkin-T6", "galerkin-Q8")
    )


def condensation_change(results: Results, section: str) -> float:
    """Return the largest difference of nodal forces between pw-Q8 and pw-T6.

    It is relative to the largest normal force of pw-T6.
    """
    q8_curves, t6_curves = (
        results.curves(f"{section}/{element}") for element in ("pw-Q8", "pw-T6")
    )
    differences = [
        np.abs(q8_curves[name] - t6_curves[name]).max() for name in ("force_n", "force_t")
    ]
    return float(max(differences) / t6_curves["force_n"].max())

"""Measures of the contact examples: sections 7.2 to 7.5."""

from collections.abc import Mapping

import numpy as np

from study.judge.measures.stored_cases import T6
from study.model.vocabulary import OPEN, SLIP, STICK
from study.run.store import Results

BLOCK_PRESSURE = 200.0


def slip_sawtooth(results: Results, key: str) -> float:
    """Median over slipping mid-side nodes of shear force over the mean of both corners'."""
    curves = results.curves(key)
    return _shear_sawtooth(curves, (curves["status"] == SLIP) & (curves["friction"] > 0), 3)


def stick_sawtooth(results: Results, key: str) -> float:
    """The same over sticking nodes."""
    curves = results.curves(key)
    return _shear_sawtooth(curves, curves["status"] == STICK, 1)


def _shear_sawtooth(curves: Mapping[str, np.ndarray], chosen: np.ndarray, first: int) -> float:
    force = curves["force_t"]
    middle = np.arange(first, len(force) - first, 2)
    used = middle[chosen[middle] & chosen[middle - 1] & chosen[middle + 1]]
    return float(np.median(2 * force[used] / (force[used - 1] + force[used + 1])))


def stress_difference(
    results: Results, key: str, other: str, low: float, high: float, name: str = "pressure"
) -> float:
    """Largest difference of two stress curves in low <= x <= high, in per cent of their mean."""
    a, b = results.curves(key), results.curves(other)
    x = a["x"][(a["x"] >= low - 1e-9) & (a["x"] <= high + 1e-9)]
    ours, theirs = (np.interp(x, c["x"], c[name]) for c in (a, b))
    return float(100 * np.abs(ours - theirs).max() / np.abs(theirs).mean())


def transfer_defect(results: Results, section: str, component: str, suffix: str = "") -> float:
    """T times the standard triangle's nodal forces against the new one's.

    Largest difference in per cent of the mean normal force of a closed node.
    """
    galerkin, pw = (results.curves(f"{section}/{element}{suffix}") for element in T6)
    mean = pw["force_n"][pw["status"] != OPEN].mean()
    return float(100 * np.abs(galerkin[f"{component}_T"] - pw[component]).max() / mean)


def displacement_change(results: Results, section: str) -> float:
    """Displacements of the new triangle against the standard one's, relative, in per cent."""
    galerkin, pw = (results.curves(f"{section}/{element}")["displacement"] for element in T6)
    return float(100 * np.linalg.norm(pw - galerkin) / np.linalg.norm(galerkin))


def node_choice(results: Results, element: str) -> float:
    """Change of the mean tangential displacement by making the shared nodes smooth, per cent."""
    rough, smooth = (
        results.curves(f"7.2/{element}{suffix}")["displacement"][:, 0].mean()
        for suffix in ("", "-smooth")
    )
    return float(100 * (smooth / rough - 1))


# Section, what follows the element's name in a case, scalar
_SAWTOOTH = [(section, "", "sawtooth") for section in ("7.2", "7.3", "7.4")]
_SAWTOOTH += [
    ("7.5", column, f"sawtooth_{surface}") for column in ("", "-second") for surface in (1, 2, 3, 4)
]


def largest_unevenness_of_forces(results: Results) -> float:
    """Largest |sawtooth - 1| of the paper's two new elements in sections 7.2 to 7.5."""
    return max(
        abs(results.scalar(f"{section}/{element}{suffix}", name) - 1)
        for section, suffix, name in _SAWTOOTH
        for element in ("pw-T6", "pw-Q8")
    )


def smallest_sawtooth_of_standard(results: Results) -> float:
    """Smallest sawtooth of the two standard elements in sections 7.2 to 7.5."""
    return min(
        results.scalar(f"{section}/{element}{suffix}", name)
        for section, suffix, name in _SAWTOOTH
        for element in ("galerkin-T6", "galerkin-Q8")
    )


def condensation_change(results: Results, section: str) -> float:
    """Largest difference of nodal forces of pw-Q8 and pw-T6, relative to the largest force."""
    a, b = (results.curves(f"{section}/{element}") for element in ("pw-Q8", "pw-T6"))
    differences = [np.abs(a[name] - b[name]).max() for name in ("force_n", "force_t")]
    return float(max(differences) / b["force_n"].max())

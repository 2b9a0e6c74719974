"""Numerical uncertainty of a number from three meshes: observed order, extrapolation and GCI.

Like the report, this module requires NumPy only.

The grid convergence index (GCI) is the relative change from the medium to the fine mesh, divided
by r^p - 1 and multiplied by a safety factor; r is the refinement ratio and p the observed order.
Sources: I. B. Celik et al., J. Fluids Eng. 130, 078001, 2008; P. J. Roache, J. Fluids Eng. 116,
405-413, 1994.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

SAFETY_FACTOR = 1.25
"""Safety factor of the GCI for three meshes, as proposed by Roache and adopted by Celik et al."""
MIN_ORDER, MAX_ORDER = 0.5, 4.5
"""Range of accepted observed orders.

The theoretical orders in this study lie between 1 (energies and forces where stresses are singular
like r^-1/2) and 4 (energies and eigenvalues of quadratic elements in smooth problems).
"""
MIN_REFINEMENT_RATIO = 1.3
"""Smallest ratio of successive mesh sizes, as recommended by Celik et al."""
CHANGE_ROUND_OFF = 1e-9
"""Relative difference below which values on two meshes are considered equal."""
MIN_COMPUTED_ORDER, MAX_COMPUTED_ORDER = 1e-6, 60.0
"""Range in which the order is computed.

Below it, the changes do not decrease; above it, the medium mesh is practically exact.
"""

Reason = Literal["", "oscillatory", "divergent", "equal on two meshes", "order out of range"]
"""Reason why three values are not in the asymptotic range; empty if they are."""


@dataclass(frozen=True)
class GridConvergence:
    """Convergence of one number on three meshes.

    Attributes:
        values: Values from the coarse to the fine mesh.
        reason: Reason why the values are not asymptotic; empty if they are.
        order: Observed order p; None if it cannot be computed.
        extrapolated: Richardson's extrapolation to mesh size zero; None if not asymptotic.
        index: GCI of the value on the fine mesh, relative to that value; None if not asymptotic.
    """

    values: tuple[float, float, float]
    reason: Reason
    order: float | None = None
    extrapolated: float | None = None
    index: float | None = None

    @property
    def coarse_error(self) -> float | None:
        """Estimated relative error of the value on the coarse mesh, with its sign."""
        return None if self.extrapolated is None else self.values[0] / self.extrapolated - 1


def grid_convergence(values: Sequence[float], sizes: Sequence[float]) -> GridConvergence:
    """Estimate the observed order, extrapolated value and GCI of a number on three meshes.

    This function accepts monotonic convergence only. Celik et al. take the absolute value of the
    logarithm, which assigns an order to oscillating and diverging values, too.

    Args:
        values: Values (3,) on three meshes, in any order.
        sizes: Mesh sizes (3,) in the same order; only their ratios matter.

    Raises:
        ValueError: If there are not three finite values and three positive sizes, or if the ratio
            of two sizes is less than `MIN_REFINEMENT_RATIO`.
    """
    if len(values) != 3 or len(sizes) != 3:
        raise ValueError(f"expected three values and sizes, got {len(values)} and {len(sizes)}")
    if not (np.isfinite(values).all() and np.isfinite(sizes).all() and min(sizes) > 0):
        raise ValueError(f"values {values} and sizes {sizes} have to be finite, sizes positive")
    descending = sorted(zip(sizes, values, strict=True), reverse=True)
    coarse_ratio, fine_ratio = (large / small for (large, _), (small, _) in pairwise(descending))
    if min(coarse_ratio, fine_ratio) < MIN_REFINEMENT_RATIO:
        raise ValueError(
            f"mesh sizes {sizes} have a ratio below {MIN_REFINEMENT_RATIO}; refine more"
        )
    coarse, medium, fine = (float(value) for _, value in descending)
    sorted_values = (coarse, medium, fine)
    changes = medium - coarse, fine - medium
    if min(map(abs, changes)) <= CHANGE_ROUND_OFF * max(map(abs, sorted_values)):
        return GridConvergence(sorted_values, "equal on two meshes")
    change_ratio = changes[0] / changes[1]
    if change_ratio < 0:
        return GridConvergence(sorted_values, "oscillatory")
    order = solve_for_observed_order(change_ratio, coarse_ratio, fine_ratio)
    if order is None:
        return GridConvergence(sorted_values, "divergent")
    if not MIN_ORDER <= order <= MAX_ORDER:
        return GridConvergence(sorted_values, "order out of range", order)
    correction = changes[1] / (fine_ratio**order - 1)
    index = SAFETY_FACTOR * abs(correction / fine)
    return GridConvergence(sorted_values, "", order, fine + correction, index)


def solve_for_observed_order(
    change_ratio: float, coarse_ratio: float, fine_ratio: float
) -> float | None:
    """Return the order p > 0 of three values phi(h) = phi_0 + c h^p, or None if none fits.

    Args:
        change_ratio: Change of the value from the coarse to the medium mesh, divided by the change
            from the medium to the fine mesh; must be positive.
        coarse_ratio: Size of the coarse mesh divided by that of the medium mesh.
        fine_ratio: Size of the medium mesh divided by that of the fine mesh.
    """

    def log_change_ratio_of_order(p: float) -> float:
        growth = np.expm1(p * np.log(coarse_ratio)) / np.expm1(p * np.log(fine_ratio))
        return float(p * np.log(fine_ratio) + np.log(growth))

    target = np.log(change_ratio)
    if log_change_ratio_of_order(MIN_COMPUTED_ORDER) >= target:
        return None
    if log_change_ratio_of_order(MAX_COMPUTED_ORDER) <= target:
        return MAX_COMPUTED_ORDER
    low, high = MIN_COMPUTED_ORDER, MAX_COMPUTED_ORDER
    while (middle := (low + high) / 2) not in (low, high):  # until low and high are adjacent
        low, high = (middle, high) if log_change_ratio_of_order(middle) < target else (low, middle)
    return low

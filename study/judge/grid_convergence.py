"""Numerical uncertainty of a number by three meshes: observed order, extrapolation and GCI.

Needs NumPy alone, as the report does.

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
"""Factor of the GCI for three meshes; Roache's, which Celik et al. keep."""
MIN_ORDER, MAX_ORDER = 0.5, 4.5
"""Observed orders that are accepted.

The theoretical ones of this study are between 1 (energies and forces where stresses are singular
like r^-1/2) and 4 (energies and eigenvalues of quadratic elements in smooth problems).
"""
MIN_REFINEMENT_RATIO = 1.3
"""Smallest ratio of two mesh sizes, as Celik et al. recommend."""
CHANGE_ROUND_OFF = 1e-9
"""Relative difference below which the values on two meshes count as equal."""
MIN_COMPUTED_ORDER, MAX_COMPUTED_ORDER = 1e-6, 60.0
"""Orders that are solved for: below, changes do not decrease; above, the medium mesh is exact."""

Reason = Literal["", "oscillatory", "divergent", "equal on two meshes", "order out of range"]
"""Reason why three values are not asymptotic; empty if they are."""


@dataclass(frozen=True)
class GridConvergence:
    """Convergence of one number on three meshes.

    Attributes:
        values: Values from the coarse to the fine mesh.
        reason: Why they are not asymptotic; empty if they are.
        order: Observed order p; None if there is none.
        extrapolated: Richardson's extrapolation to mesh size zero; None if not asymptotic.
        index: GCI of the fine mesh's value, relative to it; None if not asymptotic.
    """

    values: tuple[float, float, float]
    reason: Reason
    order: float | None = None
    extrapolated: float | None = None
    index: float | None = None

    @property
    def coarse_error(self) -> float | None:
        """Estimated relative error of the coarse mesh's value, with its sign."""
        return None if self.extrapolated is None else self.values[0] / self.extrapolated - 1


def grid_convergence(values: Sequence[float], sizes: Sequence[float]) -> GridConvergence:
    """Estimate observed order, extrapolated value and GCI of a number on three meshes.

    Unlike Celik et al., who take the size of the logarithm and so give oscillating and diverging
    values an order as well, this accepts monotonic convergence only.

    Args:
        values: Values on three meshes, in any order, (3,).
        sizes: Mesh sizes, (3,); only their ratios count.

    Raises:
        ValueError: If there are not three finite values and positive sizes, or if two sizes have a
            ratio below `MIN_REFINEMENT_RATIO`.
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
    order = solve_order(change_ratio, coarse_ratio, fine_ratio)
    if order is None:
        return GridConvergence(sorted_values, "divergent")
    if not MIN_ORDER <= order <= MAX_ORDER:
        return GridConvergence(sorted_values, "order out of range", order)
    correction = changes[1] / (fine_ratio**order - 1)
    index = SAFETY_FACTOR * abs(correction / fine)
    return GridConvergence(sorted_values, "", order, fine + correction, index)


def solve_order(change_ratio: float, coarse_ratio: float, fine_ratio: float) -> float | None:
    """Return the order p > 0 of values phi(h) = phi_0 + c h^p; None if there is none.

    Args:
        change_ratio: Change from the coarse to the medium mesh over that from the medium to the
            fine mesh, positive.
        coarse_ratio: Size of the coarse over that of the medium mesh.
        fine_ratio: Size of the medium over that of the fine mesh.
    """

    def log_change_ratio(p: float) -> float:
        growth = np.expm1(p * np.log(coarse_ratio)) / np.expm1(p * np.log(fine_ratio))
        return float(p * np.log(fine_ratio) + np.log(growth))

    target = np.log(change_ratio)
    if log_change_ratio(MIN_COMPUTED_ORDER) >= target:
        return None
    if log_change_ratio(MAX_COMPUTED_ORDER) <= target:
        return MAX_COMPUTED_ORDER
    low, high = MIN_COMPUTED_ORDER, MAX_COMPUTED_ORDER
    while (middle := (low + high) / 2) not in (low, high):  # until neighbouring numbers are reached
        low, high = (middle, high) if log_change_ratio(middle) < target else (low, middle)
    return low

"""Fit the columns of section 7.5 to Table 1: `python3 -m study.paper.table_1.fit`, in a minute.

Fig. 15 is lost, so eight lengths are unknown; each column of Table 1 has six modes. The lengths are
fitted by least squares to the four printed columns, each computed with its own element and a
consistent mass. Since many columns fit, the changes of the lengths are included in the sum of
squares, which selects the column nearest to the start.
"""

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from study.paper import s7_5_model
from study.paper.items import TABLE_1
from study.paper.s7_5_profiles import ColumnProfile

ELEMENT_BY_PRINTED_NAME = {
    "CAX6": "galerkin-T6",
    "6-node user element": "pw-T6",
    "CAX8": "galerkin-Q8",
    "8-node user element": "pw-Q8",
}
STARTS = {
    "first": (0.0477, 0.1116, 0.1466, 0.0404, 0.2319, 0.1437, 0.1838, 0.0335),
    "second": (0.0429, 0.1004, 0.1319, 0.0525, 0.2551, 0.1581, 0.1654, 0.0670),
}
"""Radii and heights from the base upwards, in m.

The first column was fitted by hand on coarser meshes. The second is far from it: its top is twice
as high.
"""
WEIGHT_OF_CHANGE = 1.0
"""Deviation of an eigenvalue, in %, that counts as much as doubling a length."""


def make_profile_from_lengths(lengths: npt.ArrayLike) -> ColumnProfile:
    """Return the column with radii (4) and heights (4), given together as lengths (8,) in m."""
    r1, r2, r3, r4, h1, h2, h3, h4 = np.asarray(lengths, dtype=float)
    return ColumnProfile((r1, r2, r3, r4), (h1, h2, h3, h4))


def deviations_from_table_1(profile: ColumnProfile) -> npt.NDArray[np.float64]:
    """Return the relative deviations (4, 6) from the printed eigenvalues, in per cent.

    Rows are elements in the order of `ELEMENT_BY_PRINTED_NAME`, columns are modes.
    """
    return np.array(
        [
            100 * (s7_5_model.compute_column_eigenvalues(element, profile) / TABLE_1[printed] - 1)
            for printed, element in ELEMENT_BY_PRINTED_NAME.items()
        ]
    )


def fit_lengths(start: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the radii and heights (8,) in m that fit Table 1, rounded to 0.01 mm.

    `start` contains the radii and heights (8,) from which the fit starts.
    """
    start_lengths = np.asarray(start, dtype=float)

    def deviations_and_length_changes(factors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        deviations = deviations_from_table_1(
            make_profile_from_lengths(start_lengths * factors)
        ).ravel()
        return np.append(deviations, WEIGHT_OF_CHANGE * (factors - 1))

    no_change = np.ones(len(start_lengths))
    fit = least_squares(
        deviations_and_length_changes, no_change, diff_step=1e-4, xtol=1e-4, ftol=1e-4
    )
    return np.asarray(np.round(start_lengths * fit.x, 5))


def main() -> None:
    """Fit both columns, and print their lengths and deviations from Table 1."""
    for name, start in STARTS.items():
        lengths = fit_lengths(start)
        print(f"{name}: radii {lengths[:4].tolist()} m, heights {lengths[4:].tolist()} m")
        deviations = deviations_from_table_1(make_profile_from_lengths(lengths))
        for row, printed in enumerate(ELEMENT_BY_PRINTED_NAME):
            print(f"  {printed:20s}", *(f"{value:+7.3f} %" for value in deviations[row]))


if __name__ == "__main__":
    main()

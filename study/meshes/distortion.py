"""Smooth distortion of meshes, for problems in which no two cells may be congruent."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def distort_unit_domain_smoothly(x: Array) -> Array:
    """Return points (n, 3) of the unit square or cube, mapped by a smooth distortion.

    Points with x = 0 keep this coordinate. No two triangles of a regular mesh remain congruent.
    """
    mapped = x.copy()
    mapped[:, 0] *= 1 + 0.1 * np.cos(3.3 * x[:, 1]) + 0.05 * np.sin(2.1 * x[:, 0])
    mapped[:, 1] += 0.07 * np.cos(2.7 * x[:, 0]) * np.sin(1.9 * x[:, 1] + 0.4)
    return mapped

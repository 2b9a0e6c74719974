"""Smooth distortion of meshes, for problems in which no two cells may be congruent."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def smooth_distortion(x: Array) -> Array:
    """Map points (n, 3) of a unit square or cube smoothly; the side x = 0 stays in its plane.

    No two triangles of a regular mesh remain congruent.
    """
    mapped = x.copy()
    mapped[:, 0] *= 1 + 0.1 * np.cos(3.3 * x[:, 1]) + 0.05 * np.sin(2.1 * x[:, 0])
    mapped[:, 1] += 0.07 * np.cos(2.7 * x[:, 0]) * np.sin(1.9 * x[:, 1] + 0.4)
    return mapped

"""A rigid surface as a user would write it: a polygonal line with its gap and normal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

PointArray = npt.NDArray[np.float64]


def unit_left_normals(vectors: PointArray) -> PointArray:
    return np.column_stack((-vectors[:, 1], vectors[:, 0])) / np.linalg.norm(
        vectors, axis=1, keepdims=True
    )


@dataclass(frozen=True)
class PolylineSurface:
    """Polygonal line in the plane; its first and last segments extend to infinity.

    The body lies to the left of the line, seen from the first to the last point. Corners that
    protrude into the body are rounded with `radius`; they are sharp if it is zero. At a point whose
    nearest point is a sharp corner, the normal points from the corner to this point. Re-entrant
    corners are always sharp.
    """

    points: Sequence[Sequence[float]]
    radius: float = 0.0

    def gap(self, x: PointArray) -> npt.NDArray[np.float64]:
        return self._gap_and_normal(x)[0]

    def normal(self, x: PointArray) -> PointArray:
        return self._gap_and_normal(x)[1]

    def _corners_offset_by_radius(self) -> PointArray:
        """Return the corners of the line after it is offset away from the body by `radius`."""
        points = np.asarray(self.points, dtype=float)
        normals = unit_left_normals(np.diff(points, axis=0))
        offset = points.copy()
        offset[0] -= self.radius * normals[0]
        offset[-1] -= self.radius * normals[-1]
        normal_sum = normals[:-1] + normals[1:]
        offset[1:-1] -= 2 * self.radius * normal_sum / np.sum(normal_sum**2, axis=1, keepdims=True)
        return offset

    def _gap_and_normal(self, x: PointArray) -> tuple[npt.NDArray[np.float64], PointArray]:
        line = self._corners_offset_by_radius()
        normals = unit_left_normals(span := np.diff(line, axis=0))
        turns_right = np.sum(span[1:] * normals[:-1], axis=1) < 0
        s = np.einsum("nkd,kd->nk", x[:, None] - line[:-1], span) / np.sum(span**2, axis=1)
        low, high = np.zeros(len(span)), np.ones(len(span))
        low[0], high[-1] = -np.inf, np.inf
        clamped = np.clip(s, low, high)
        from_nearest = x[:, None] - line[:-1] - clamped[..., None] * span
        nearest = np.argmin(np.linalg.norm(from_nearest, axis=2), axis=1)
        row = np.arange(len(x))
        from_nearest, s, clamped = (
            from_nearest[row, nearest],
            s[row, nearest],
            clamped[row, nearest],
        )

        distance = np.linalg.norm(from_nearest, axis=1)
        sign = np.sign(np.sum(from_nearest * normals[nearest], axis=1))
        direction = normals[nearest]
        corner = (s != clamped) & (distance > 0)
        if corner.any():  # the nearest point is a protruding corner
            first_segment = nearest[corner] - (s[corner] < 0)
            sign[corner] = np.where(turns_right[first_segment], 1.0, -1.0)
            direction[corner] = sign[corner, None] * from_nearest[corner] / distance[corner, None]
        return sign * distance - self.radius, direction

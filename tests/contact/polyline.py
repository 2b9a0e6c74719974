"""A rigid surface as a user would write one: a polygonal line, with its gap and its normal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]


def unit_left_normals(vectors: Points) -> Points:
    return np.column_stack((-vectors[:, 1], vectors[:, 0])) / np.linalg.norm(
        vectors, axis=1, keepdims=True
    )


@dataclass(frozen=True)
class Polyline:
    """Polygonal line in the plane, whose first and last segment extend to infinity.

    The body lies to the left when one walks from the first point to the last. Corners that
    protrude into the body are sharp (the normal at a point nearest to the corner is the
    line that joins them) or rounded from within; re-entrant ones stay sharp.
    """

    points: Sequence[Sequence[float]]
    radius: float = 0.0

    def gap(self, x: Points) -> npt.NDArray[np.float64]:
        return self._gap_and_normal(x)[0]

    def normal(self, x: Points) -> Points:
        return self._gap_and_normal(x)[1]

    def _offset_points(self) -> Points:
        """The line moved into the rigid by the radius, corners where its segments meet."""
        points = np.asarray(self.points, dtype=float)
        normals = unit_left_normals(np.diff(points, axis=0))
        inset = points.copy()
        inset[0] -= self.radius * normals[0]
        inset[-1] -= self.radius * normals[-1]
        both = normals[:-1] + normals[1:]
        inset[1:-1] -= 2 * self.radius * both / np.sum(both**2, axis=1, keepdims=True)
        return inset

    def _gap_and_normal(self, x: Points) -> tuple[npt.NDArray[np.float64], Points]:
        line = self._offset_points()
        normals = unit_left_normals(span := np.diff(line, axis=0))
        turns_right = np.sum(span[1:] * normals[:-1], axis=1) < 0
        s = np.einsum("nkd,kd->nk", x[:, None] - line[:-1], span) / np.sum(span**2, axis=1)
        low, high = np.zeros(len(span)), np.ones(len(span))
        low[0], high[-1] = -np.inf, np.inf
        clamped = np.clip(s, low, high)
        away = x[:, None] - line[:-1] - clamped[..., None] * span
        nearest = np.argmin(np.linalg.norm(away, axis=2), axis=1)
        row = np.arange(len(x))
        away, s, clamped = away[row, nearest], s[row, nearest], clamped[row, nearest]

        distance = np.linalg.norm(away, axis=1)
        sign = np.sign(np.sum(away * normals[nearest], axis=1))
        direction = normals[nearest]
        corner = (s != clamped) & (distance > 0)
        if corner.any():  # nearest to a corner, outside of one that sticks out
            before = nearest[corner] - (s[corner] < 0)
            sign[corner] = np.where(turns_right[before], 1.0, -1.0)
            direction[corner] = sign[corner, None] * away[corner] / distance[corner, None]
        return sign * distance - self.radius, direction

"""The stepped column of section 7.5: a synthetic section, and its meshes.

The paper's Fig. 15 is lost. These radii and heights were fitted to its Table 1 and are not the
only ones that fit; whatever is computed with them is synthetic and labelled so. What two of them
tell alike may be said of the paper's; what they do not, its numbers alone cannot decide.
"""

from dataclasses import dataclass
from itertools import pairwise

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, create_mesh

from pw_elements.meshes import DiagonalPattern

Points = npt.NDArray[np.float64]

# Triangles of a quadrilateral with the corners 2 3 above 0 1; "right" goes up to the right. The
# crossed ones have their centre, 4
_RIGHT, _LEFT = [0, 1, 3, 0, 2, 3], [0, 1, 2, 1, 2, 3]
_CROSSED = [0, 1, 4, 1, 3, 4, 3, 2, 4, 2, 0, 4]
_OF_EVEN_AND_ODD = {
    "right": (_RIGHT, _RIGHT),
    "left": (_LEFT, _LEFT),
    "left_right": (_LEFT, _RIGHT),
    "right_left": (_RIGHT, _LEFT),
    "crossed": (_CROSSED, _CROSSED),
}


@dataclass(frozen=True)
class Face:
    """A horizontal face that can touch a rigid surface.

    Args:
        inner: smallest radius.
        outer: largest radius.
        level: height above the base.
        outward: -1 if it looks down, 1 if up.
    """

    inner: float
    outer: float
    level: float
    outward: float

    def holds(self, x: Points) -> npt.NDArray[np.bool_]:
        """Whether points (3, n) lie on it."""
        radial = (x[0] > self.inner - 1e-9) & (x[0] < self.outer + 1e-9)
        return np.isclose(x[1], self.level) & radial


@dataclass(frozen=True)
class Profile:
    """A column of cylinders, and the divisions of its mesh.

    Args:
        radii: of the cylinders from the base upwards, in m.
        heights: theirs, in m.
        ring_divisions: elements over the rings between successive radii, from the axis.
        height_divisions: elements over the heights.
    """

    radii: tuple[float, float, float, float]
    heights: tuple[float, float, float, float]
    ring_divisions: tuple[int, ...] = (5, 1, 7, 4)
    height_divisions: tuple[int, ...] = (26, 17, 21, 5)

    @property
    def levels(self) -> Points:
        """Heights of base, steps and top (5,) above the base."""
        return np.concatenate([[0.0], np.cumsum(self.heights)])

    @property
    def faces(self) -> tuple[Face, ...]:
        """Surfaces 1 to 4: the base, the two shoulders, the top."""
        radii, levels = self.radii, self.levels
        return (
            Face(0.0, radii[0], levels[0], -1.0),
            Face(radii[0], radii[1], levels[1], -1.0),
            Face(radii[1], radii[2], levels[2], -1.0),
            Face(0.0, radii[3], levels[4], 1.0),
        )


PROFILES = {
    "first": Profile((0.04787, 0.11121, 0.14669, 0.04126), (0.23155, 0.14025, 0.18777, 0.03384)),
    "second": Profile((0.04233, 0.09821, 0.13936, 0.03448), (0.23225, 0.15762, 0.15352, 0.07237)),
}
"""Columns found by `study.paper.s7_5_fit`, of 759 quadrilaterals each."""


def axis(x: Points) -> npt.NDArray[np.bool_]:
    """Whether points (3, n) lie on the axis of rotation."""
    return np.isclose(x[0], 0.0)


def mesh(section: Profile, cell: str, refined: int = 1, pattern: DiagonalPattern = "right") -> Mesh:
    """The section in quadrilaterals, or in triangles: each quadrilateral cut in two or four.

    Mesh lines run through all steps; blocks outside of the section are left out.

    Args:
        section: radii, heights and divisions.
        cell: "quadrilateral" or "triangle".
        refined: factor of all divisions.
        pattern: diagonals of the quadrilaterals; of two neighbours, where they alternate.
    """
    r = _lines((0.0, *sorted(section.radii)), section.ring_divisions, refined)
    z = _lines(section.levels, section.height_divisions, refined)
    below = np.searchsorted(section.levels[1:-1], (z[1:] + z[:-1]) / 2)  # cylinder of each row
    inside = (r[1:] + r[:-1])[:, None] / 2 < np.array(section.radii)[below]

    number = np.arange(len(r) * len(z)).reshape(len(r), len(z))
    corners = (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:])
    quadrilaterals = np.column_stack([corner[inside] for corner in corners])
    used, cells = np.unique(quadrilaterals, return_inverse=True)
    cells = cells.reshape(quadrilaterals.shape)
    x = np.column_stack([np.repeat(r, len(z)), np.tile(z, len(r))])[used]
    if cell == "triangle":
        if pattern == "crossed":
            centres = x[cells].mean(axis=1)
            cells = np.column_stack([cells, len(x) + np.arange(len(cells))])
            x = np.concatenate([x, centres])
        odd = (np.indices(inside.shape).sum(axis=0) % 2)[inside]
        of_even, of_odd = (cells[:, corners] for corners in _OF_EVEN_AND_ODD[pattern])
        cells = np.where(odd[:, None], of_odd, of_even).reshape(-1, 3)
    geometry = basix.ufl.element("Lagrange", cell, 1, shape=(2,))
    return create_mesh(MPI.COMM_SELF, cells=cells.astype(np.int64), x=x, e=geometry)


def _lines(borders: npt.ArrayLike, divisions: tuple[int, ...], refined: int) -> Points:
    """Mesh lines from the first border to the last, evenly spaced between two of them."""
    spans = pairwise(np.asarray(borders, dtype=float))
    parts = [
        np.linspace(a, b, refined * n, endpoint=False)
        for (a, b), n in zip(spans, divisions, strict=True)
    ]
    return np.append(np.concatenate(parts), np.asarray(borders)[-1])

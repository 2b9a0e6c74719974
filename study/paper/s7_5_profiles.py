"""Synthetic cross-sections of the stepped column of section 7.5, and their meshes.

The paper's Fig. 15 is lost. The radii and heights were fitted to Table 1 and are not the only ones
that fit, so all results for them are synthetic and labelled as such. Only properties that both
columns share can be expected of the paper's column.
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

# Corners of the triangles of a quadrilateral whose corners 2 3 lie above 0 1; the diagonal "right"
# goes up to the right, and crossed diagonals meet in the centre, 4
_RIGHT, _LEFT = [0, 1, 3, 0, 2, 3], [0, 1, 2, 1, 2, 3]
_CROSSED = [0, 1, 4, 1, 3, 4, 3, 2, 4, 2, 0, 4]
_TRIANGLES_OF_EVEN_AND_ODD_CELLS = {
    "right": (_RIGHT, _RIGHT),
    "left": (_LEFT, _LEFT),
    "left_right": (_LEFT, _RIGHT),
    "right_left": (_RIGHT, _LEFT),
    "crossed": (_CROSSED, _CROSSED),
}


@dataclass(frozen=True)
class ContactFace:
    """Horizontal face of the column that can touch a rigid surface.

    Args:
        inner: Smallest radius, in m.
        outer: Largest radius, in m.
        level: Height above the base, in m.
        outward: Vertical component of the outward normal: -1 or 1.
    """

    inner: float
    outer: float
    level: float
    outward: float

    def contains(self, x: Points) -> npt.NDArray[np.bool_]:
        """Return a mask (n,) of the points (3, n) that lie on the face."""
        is_within_radii = (x[0] > self.inner - 1e-9) & (x[0] < self.outer + 1e-9)
        return np.isclose(x[1], self.level) & is_within_radii


@dataclass(frozen=True)
class ColumnProfile:
    """Column of stacked cylinders with the divisions of its mesh.

    Args:
        radii: Radii of the cylinders from the base upwards, in m.
        heights: Heights of the cylinders, in m.
        ring_divisions: Numbers of elements between successive radii, from the axis outwards.
        height_divisions: Number of elements over the height of each cylinder.
    """

    radii: tuple[float, float, float, float]
    heights: tuple[float, float, float, float]
    ring_divisions: tuple[int, ...] = (5, 1, 7, 4)
    height_divisions: tuple[int, ...] = (26, 17, 21, 5)

    @property
    def levels_above_base(self) -> Points:
        """Heights (5,) of the base, the three steps and the top above the base, in m."""
        return np.concatenate([[0.0], np.cumsum(self.heights)])

    @property
    def faces(self) -> tuple[ContactFace, ...]:
        """Contact surfaces 1 to 4: the base, the two shoulders, and the top."""
        radii, levels = self.radii, self.levels_above_base
        return (
            ContactFace(0.0, radii[0], levels[0], -1.0),
            ContactFace(radii[0], radii[1], levels[1], -1.0),
            ContactFace(radii[1], radii[2], levels[2], -1.0),
            ContactFace(0.0, radii[3], levels[4], 1.0),
        )


PROFILES = {
    "first": ColumnProfile(
        (0.04787, 0.11121, 0.14669, 0.04126), (0.23155, 0.14025, 0.18777, 0.03384)
    ),
    "second": ColumnProfile(
        (0.04233, 0.09821, 0.13936, 0.03448), (0.23225, 0.15762, 0.15352, 0.07237)
    ),
}
"""Columns fitted by `study.paper.table_1.fit`; the mesh of each has 759 quadrilaterals."""


def on_axis(x: Points) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of the points (3, n) that lie on the axis of rotation."""
    return np.isclose(x[0], 0.0)


def mesh_column(
    profile: ColumnProfile, cell: str, refined: int = 1, pattern: DiagonalPattern = "right"
) -> Mesh:
    """Mesh the cross-section of a column by quadrilaterals or triangles.

    Each quadrilateral is cut into two triangles, or four if the diagonals are "crossed". Mesh lines
    run through all steps; blocks outside the cross-section are left out.

    Args:
        profile: Radii, heights and divisions.
        cell: "quadrilateral" or "triangle".
        refined: Factor by which all numbers of divisions are multiplied.
        pattern: Pattern of the diagonals that cut quadrilaterals into triangles.
    """
    r = _divide_intervals_into_mesh_lines(
        (0.0, *sorted(profile.radii)), profile.ring_divisions, refined
    )
    z = _divide_intervals_into_mesh_lines(
        profile.levels_above_base, profile.height_divisions, refined
    )
    r_centres, z_centres = (r[1:] + r[:-1]) / 2, (z[1:] + z[:-1]) / 2
    cylinder_of_row = np.searchsorted(profile.levels_above_base[1:-1], z_centres)
    is_inside = r_centres[:, None] < np.array(profile.radii)[cylinder_of_row]

    grid_nodes = np.arange(len(r) * len(z)).reshape(len(r), len(z))
    corners = (
        grid_nodes[:-1, :-1],
        grid_nodes[1:, :-1],
        grid_nodes[:-1, 1:],
        grid_nodes[1:, 1:],
    )
    quadrilaterals = np.column_stack([corner[is_inside] for corner in corners])
    used_nodes, cells = np.unique(quadrilaterals, return_inverse=True)
    cells = cells.reshape(quadrilaterals.shape)
    x = np.column_stack([np.repeat(r, len(z)), np.tile(z, len(r))])[used_nodes]
    if cell == "triangle":
        if pattern == "crossed":
            centres = x[cells].mean(axis=1)
            cells = np.column_stack([cells, len(x) + np.arange(len(cells))])
            x = np.concatenate([x, centres])
        is_odd = (np.indices(is_inside.shape).sum(axis=0) % 2)[is_inside]
        even, odd = _TRIANGLES_OF_EVEN_AND_ODD_CELLS[pattern]
        cells = np.where(is_odd[:, None], cells[:, odd], cells[:, even]).reshape(-1, 3)
    geometry = basix.ufl.element("Lagrange", cell, 1, shape=(2,))
    return create_mesh(MPI.COMM_SELF, cells=cells.astype(np.int64), x=x, e=geometry)


def _divide_intervals_into_mesh_lines(
    borders: npt.ArrayLike, divisions: tuple[int, ...], refined: int
) -> Points:
    """Return mesh lines from the first border to the last.

    Interval i between successive borders is divided into refined * divisions[i] equal parts.
    """
    spans = pairwise(np.asarray(borders, dtype=float))
    lines = [
        np.linspace(start, end, refined * n, endpoint=False)
        for (start, end), n in zip(spans, divisions, strict=True)
    ]
    return np.append(np.concatenate(lines), np.asarray(borders)[-1])

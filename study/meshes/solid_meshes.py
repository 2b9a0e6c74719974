"""Meshes of pieces of a half space z < 0: graded boxes, and discs in prisms, of T10 or H27."""

from collections.abc import Callable

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, Mesh, create_box, create_mesh

from pw_elements._compat import cell_geometry_nodes
from pw_elements.meshes import move_nodes

Array = npt.NDArray[np.float64]

# Corner of the square inside the disc, over its radius: on the axes, and on the diagonal
_SQUARE, _DIAGONAL = 0.5, 0.4
# Elements between square and circle shrink as this power of the distance from the latter, over
# the distance of the square
_SHRINKING = 2


def cell_of(element: str) -> str:
    """Cell of an element by its name."""
    return "tetrahedron" if element.endswith("T10") else "hexahedron"


def box(cell: str, x: Array, y: Array, z: Array) -> Mesh:
    """Box whose mesh lines along each axis are given; six tetrahedra in each hexahedron."""
    lines = (x, y, z)
    divisions = [len(of_axis) - 1 for of_axis in lines]

    def placed(points: Array) -> Array:
        columns = [
            np.interp(points[:, axis], np.arange(len(of_axis)), of_axis)
            for axis, of_axis in enumerate(lines)
        ]
        return np.column_stack(columns)

    corners = [(0.0, 0.0, 0.0), tuple(map(float, divisions))]
    return move_nodes(create_box(MPI.COMM_SELF, corners, divisions, CellType[cell]), placed)


def quarter_disc(cell: str, elements: int, radii: Array, z: Array) -> Mesh:
    """Quarter of a cylinder; one of its cylindrical layers of nodes is that of radius 1.

    Args:
        cell: "tetrahedron" or "hexahedron".
        elements: along each side of the square in the middle, and from it to radius 1.
        radii: beyond 1, of further layers of nodes; the last is the cylinder's.
        z: increasing, of the layers of nodes across the axis.
    """
    blocks = [_middle(elements), *(_ring(elements, radii, mirrored) for mirrored in (False, True))]
    cells, start = [], 0
    for points in blocks:
        number = start + np.arange(points[..., 0].size).reshape(points.shape[:2])
        cells.append(_quadrilaterals(number))
        start += number.size
    plane, squares = _merged(np.concatenate([p.reshape(-1, 2) for p in blocks]), np.vstack(cells))
    if cell == "hexahedron":
        return _extruded(plane, squares, z, cell, _hexahedra)
    triangles = np.concatenate([squares[:, [0, 1, 3]], squares[:, [0, 3, 2]]])
    return _extruded(plane, np.sort(triangles, axis=1), z, cell, _tetrahedra)


def with_mirror_image(lower: Mesh, distance: float) -> Mesh:
    """Both a body below z = 0 and its mirror image, a distance above it."""
    x, cells = lower.geometry.x, cell_geometry_nodes(lower)
    image = x * [1.0, 1.0, -1.0] + [0.0, 0.0, distance]
    return create_mesh(
        lower.comm,
        cells=np.concatenate([cells, cells + len(x)]).astype(np.int64),
        x=np.concatenate([x, image]),
        e=lower.ufl_domain().ufl_coordinate_element(),
    )


def _middle(n: int) -> Array:
    """Nodes (n + 1, n + 1, 2) of the square, whose outer corner is drawn in."""
    s, t = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    x = _SQUARE * s + (_DIAGONAL - _SQUARE) * s * t
    y = _SQUARE * t + (_DIAGONAL - _SQUARE) * s * t
    return np.stack([x, y], axis=2)


def _ring(n: int, radii: Array, mirrored: bool) -> Array:
    """Nodes (rings, n + 1, 2) from the square to the cylinder, below or above the diagonal."""
    along = np.linspace(0, 1, n + 1)[None, :, None]
    start, end = np.array([_SQUARE, 0.0]), np.array([_DIAGONAL, _DIAGONAL])
    angle = np.pi / 4 * along[..., 0]
    round_ = np.stack([np.cos(angle), np.sin(angle)], axis=2)
    across = 1 - np.linspace(1, 0, n + 1)[:, None, None] ** _SHRINKING
    inner = (1 - across) * (start + along * (end - start)) + across * round_
    nodes = np.concatenate([inner, radii[:, None, None] * round_])
    return nodes[..., ::-1] if mirrored else nodes


def _quadrilaterals(number: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    corners = (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:])
    return np.stack([corner.ravel() for corner in corners], axis=1)


def _merged(x: Array, cells: npt.NDArray[np.int64]) -> tuple[Array, npt.NDArray[np.int64]]:
    """Nodes that coincide are one."""
    _, first, which = np.unique(np.round(x, 9), axis=0, return_index=True, return_inverse=True)
    return x[first], which.reshape(-1)[cells]


def _extruded(
    plane: Array,
    faces: npt.NDArray[np.int64],
    z: Array,
    cell: str,
    cut: Callable[[npt.NDArray[np.int64], npt.NDArray[np.int64]], npt.NDArray[np.int64]],
) -> Mesh:
    count = len(plane)
    x = np.concatenate([np.column_stack([plane, np.full(count, height)]) for height in z])
    cells = [cut(faces + k * count, faces + (k + 1) * count) for k in range(len(z) - 1)]
    return create_mesh(
        MPI.COMM_SELF,
        cells=np.concatenate(cells),
        x=x,
        e=basix.ufl.element("Lagrange", cell, 1, shape=(3,)),
    )


def _hexahedra(below: npt.NDArray[np.int64], above: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    return np.hstack([below, above])


def _tetrahedra(
    below: npt.NDArray[np.int64], above: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    """Three in each prism; sorted columns make the diagonals of neighbours meet."""
    a, b, c = below.T
    d, e, f = above.T
    return np.concatenate(
        [np.stack(four, axis=1) for four in ((a, b, c, f), (a, b, e, f), (a, d, e, f))]
    )

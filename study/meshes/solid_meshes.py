"""Boxes and quarter cylinders in the half space z < 0, meshed by tetrahedra or hexahedra."""

from collections.abc import Callable

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, Mesh, create_box, create_mesh

from pw_elements._compat import cell_geometry_nodes
from pw_elements.meshes import move_nodes

Array = npt.NDArray[np.float64]

# Square inside the unit disc: length of its sides on the axes, and coordinate x = y of its outer
# corner
_SQUARE_SIDE, _SQUARE_CORNER = 0.5, 0.4
# Exponent to which the evenly spaced relative distances of the node lines between square and circle
# from the circle are raised
_SIZE_EXPONENT = 2


def solid_cell_name(element: str) -> str:
    """Return the name of the cell type of a solid element."""
    return "tetrahedron" if element.endswith("T10") else "hexahedron"


def mesh_box_along_lines(cell: str, x_lines: Array, y_lines: Array, z_lines: Array) -> Mesh:
    """Mesh a box along increasing mesh lines; for tetrahedra, each hexahedron is divided into six.

    Args:
        cell: "tetrahedron" or "hexahedron".
        x_lines: Coordinates of the planes x = constant.
        y_lines: Coordinates of the planes y = constant.
        z_lines: Coordinates of the planes z = constant.
    """
    lines = (x_lines, y_lines, z_lines)
    divisions = [len(axis_lines) - 1 for axis_lines in lines]

    def map_to_lines(points: Array) -> Array:
        columns = [
            np.interp(points[:, axis], np.arange(len(axis_lines)), axis_lines)
            for axis, axis_lines in enumerate(lines)
        ]
        return np.column_stack(columns)

    corners = [(0.0, 0.0, 0.0), tuple(map(float, divisions))]
    return move_nodes(create_box(MPI.COMM_SELF, corners, divisions, CellType[cell]), map_to_lines)


def mesh_quarter_cylinder(cell: str, n_elements: int, outer_radii: Array, z_layers: Array) -> Mesh:
    """Mesh a quarter of a cylinder, with a cylindrical layer of nodes at radius 1.

    Args:
        cell: "tetrahedron" or "hexahedron".
        n_elements: Number of elements along each side of the square in the middle, and from this
            square to radius 1.
        outer_radii: Radii > 1 of further layers of nodes; the last is the radius of the cylinder.
        z_layers: Increasing coordinates z of the layers of nodes.
    """
    blocks = [
        _nodes_of_inner_square(n_elements),
        *(
            _nodes_outside_inner_square(n_elements, outer_radii, mirrored)
            for mirrored in (False, True)
        ),
    ]
    cells, start = [], 0
    for points in blocks:
        number = start + np.arange(points[..., 0].size).reshape(points.shape[:2])
        cells.append(_quadrilaterals_of_node_grid(number))
        start += number.size
    plane, squares = _merge_coinciding_nodes(
        np.concatenate([p.reshape(-1, 2) for p in blocks]), np.vstack(cells)
    )
    if cell == "hexahedron":
        return _extrude_mesh(plane, squares, z_layers, cell, _join_faces_into_hexahedra)
    triangles = np.concatenate([squares[:, [0, 1, 3]], squares[:, [0, 3, 2]]])
    return _extrude_mesh(
        plane, np.sort(triangles, axis=1), z_layers, cell, _split_prisms_into_tetrahedra
    )


def add_mirrored_body(lower: Mesh, distance: float) -> Mesh:
    """Return a mesh of two bodies: a given one below z = 0, and its mirror image above.

    Their surfaces are `distance` apart.
    """
    x, cells = lower.geometry.x, cell_geometry_nodes(lower)
    image = x * [1.0, 1.0, -1.0] + [0.0, 0.0, distance]
    return create_mesh(
        lower.comm,
        cells=np.concatenate([cells, cells + len(x)]).astype(np.int64),
        x=np.concatenate([x, image]),
        e=lower.ufl_domain().ufl_coordinate_element(),
    )


def _nodes_of_inner_square(n: int) -> Array:
    """Return the nodes (n + 1, n + 1, 2) of the square around the axis of a quarter cylinder.

    Its outer corner is moved inwards.
    """
    s, t = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    x = _SQUARE_SIDE * s + (_SQUARE_CORNER - _SQUARE_SIDE) * s * t
    y = _SQUARE_SIDE * t + (_SQUARE_CORNER - _SQUARE_SIDE) * s * t
    return np.stack([x, y], axis=2)


def _nodes_outside_inner_square(n: int, outer_radii: Array, mirrored: bool) -> Array:
    """Return the nodes (rings, n + 1, 2) between the inner square and the outer radius.

    They lie on one side of the diagonal x = y: below it, or above it if `mirrored` is true.
    """
    position_along = np.linspace(0, 1, n + 1)[None, :, None]
    start, end = np.array([_SQUARE_SIDE, 0.0]), np.array([_SQUARE_CORNER, _SQUARE_CORNER])
    angle = np.pi / 4 * position_along[..., 0]
    on_unit_circle = np.stack([np.cos(angle), np.sin(angle)], axis=2)
    position_across = 1 - np.linspace(1, 0, n + 1)[:, None, None] ** _SIZE_EXPONENT
    inner = (1 - position_across) * (
        start + position_along * (end - start)
    ) + position_across * on_unit_circle
    nodes = np.concatenate([inner, outer_radii[:, None, None] * on_unit_circle])
    return nodes[..., ::-1] if mirrored else nodes


def _quadrilaterals_of_node_grid(node_numbers: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    corners = (
        node_numbers[:-1, :-1],
        node_numbers[1:, :-1],
        node_numbers[:-1, 1:],
        node_numbers[1:, 1:],
    )
    return np.stack([corner.ravel() for corner in corners], axis=1)


def _merge_coinciding_nodes(
    x: Array, cells: npt.NDArray[np.int64]
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Merge nodes that coincide to 1e-9, and renumber the cells."""
    _, first_index, number = np.unique(
        np.round(x, 9), axis=0, return_index=True, return_inverse=True
    )
    return x[first_index], number.reshape(-1)[cells]


def _extrude_mesh(
    plane_nodes: Array,
    faces: npt.NDArray[np.int64],
    z_layers: Array,
    cell: str,
    make_cells_between_layers: Callable[
        [npt.NDArray[np.int64], npt.NDArray[np.int64]], npt.NDArray[np.int64]
    ],
) -> Mesh:
    """Extrude a plane mesh to layers of solid cells.

    Args:
        plane_nodes: Nodes (n, 2) of the plane mesh.
        faces: Nodes of each face of the plane mesh.
        z_layers: Coordinates z of the layers of nodes, in increasing order.
        cell: "tetrahedron" or "hexahedron".
        make_cells_between_layers: Function that returns the solid cells between two layers, from
            the nodes of the faces below and above.
    """
    count = len(plane_nodes)
    x = np.concatenate(
        [np.column_stack([plane_nodes, np.full(count, height)]) for height in z_layers]
    )
    cells = [
        make_cells_between_layers(faces + k * count, faces + (k + 1) * count)
        for k in range(len(z_layers) - 1)
    ]
    return create_mesh(
        MPI.COMM_SELF,
        cells=np.concatenate(cells),
        x=x,
        e=basix.ufl.element("Lagrange", cell, 1, shape=(3,)),
    )


def _join_faces_into_hexahedra(
    below: npt.NDArray[np.int64], above: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    return np.hstack([below, above])


def _split_prisms_into_tetrahedra(
    below: npt.NDArray[np.int64], above: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    """Split each prism into three tetrahedra.

    The columns of nodes are sorted, such that the diagonals of adjacent prisms match.
    """
    a, b, c = below.T
    d, e, f = above.T
    return np.concatenate(
        [np.stack(four, axis=1) for four in ((a, b, c, f), (a, b, e, f), (a, d, e, f))]
    )

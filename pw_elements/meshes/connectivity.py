"""Check that neighbouring cells have consistent nodes, and find the sides of cells that are facets.

DOLFINx does not check the nodes of cells. A missing node crashes the process. If two cells have
different mid-side nodes on the same edge, DOLFINx drops one of these nodes silently.
"""

import basix
import basix.ufl
import numpy as np

from pw_elements.arrays import Indices


def encode_rows_ignoring_order(rows: Indices) -> Indices:
    """Return an integer code (n,) for each row (n, k) of nodes.

    Rows with the same nodes, in any order, have equal codes.
    """
    rows = np.sort(rows, axis=1)
    codes, width = rows[:, 0], int(rows.max(initial=0)) + 1
    for column in rows[:, 1:].T:
        codes = np.unique(codes, return_inverse=True)[1] * width + column
    return np.unique(codes, return_inverse=True)[1].astype(np.int64)


def check_consistent_nodes_of_cells(
    cells: Indices, cell_type: str, degree: int, element_numbers: Indices, node_numbers: Indices
) -> None:
    """Check that no cell has a node twice and that neighbouring cells have consistent nodes.

    Args:
        cells: indices (n, k) of the cells' nodes in DOLFINx' order.
        cell_type: type of the cells, such as "triangle".
        degree: degree of the geometry, 1 or 2.
        element_numbers: numbers (n,) of the cells in the file, used in error messages.
        node_numbers: numbers of the nodes in the file, used in error messages.

    Raises:
        ValueError: if an element has a node twice, if two cells have different nodes in the middle
            of the same edge or face, or if a node lies on different edges or faces in two cells.
            The message names the element and the node.
    """
    sorted_cells = np.sort(cells, axis=1)
    repeated = (np.diff(sorted_cells, axis=1) == 0).any(axis=1)
    if repeated.any():
        raise ValueError(f"element {element_numbers[repeated.argmax()]} has a node twice")
    if degree == 1:
        return
    basix_element = basix.ufl.element("Lagrange", cell_type, degree)
    topology = basix.topology(basix.CellType[cell_type])
    # code of the entity to which each node belongs: 0 for vertices, otherwise the code of an edge,
    # face or cell
    entity_of_node = np.full(len(node_numbers), -1)
    entity_of_node[cells[:, : len(topology[0])]] = 0
    next_code = 1
    for dim in range(1, len(topology)):
        entity_dofs = basix_element.entity_dofs[dim]
        entity_corners = [
            vertices
            for vertices, inner_nodes in zip(topology[dim], entity_dofs, strict=True)
            if inner_nodes
        ]
        if not entity_corners:
            continue
        middle_nodes = cells[:, [inner_nodes[0] for inner_nodes in entity_dofs]]
        entity_code = next_code + encode_rows_ignoring_order(
            cells[:, entity_corners].reshape(-1, len(entity_corners[0]))
        )
        entity_code = entity_code.reshape(middle_nodes.shape)
        is_assigned = entity_of_node[middle_nodes] >= 0
        entity_of_node[middle_nodes] = np.where(
            is_assigned, entity_of_node[middle_nodes], entity_code
        )
        node_of_code = np.full(int(entity_code.max()) + 1, -1)
        node_of_code[entity_code] = middle_nodes
        is_wrong = (entity_of_node[middle_nodes] != entity_code) | (
            node_of_code[entity_code] != middle_nodes
        )
        if is_wrong.any():
            row, side = np.argwhere(is_wrong)[0]
            raise ValueError(
                f"element {element_numbers[row]} has the node "
                f"{node_numbers[middle_nodes[row, side]]} in the "
                "middle of an edge or face where a neighbour has another one, or has it elsewhere"
            )
        next_code = int(entity_code.max()) + 1


def match_cell_sides_to_facets(
    cells: Indices, cell_type: str, facet_corners: Indices
) -> tuple[Indices, Indices, Indices]:
    """Find the sides of cells that are in a list of facets.

    Args:
        cells: indices (n, k) of the cells' nodes in DOLFINx' order.
        cell_type: type of the cells, such as "triangle".
        facet_corners: indices (m, c) of the facets' corners, in any order.

    Returns:
        Three arrays with one entry for each side that is in the list: index of the cell, number of
        the side in this cell, and index of the facet. If a facet is repeated in the list, the index
        is that of its first occurrence.
    """
    dim = basix.cell.geometry(basix.CellType[cell_type]).shape[1]
    corners = np.array(basix.topology(basix.CellType[cell_type])[dim - 1])
    is_corner = np.zeros(max(int(cells.max()), int(facet_corners.max(initial=0))) + 1, dtype=bool)
    is_corner[facet_corners] = True
    cell_index, side = np.nonzero(is_corner[cells[:, corners]].all(axis=2))
    side_corners = cells[cell_index[:, None], corners[side]]
    code = encode_rows_ignoring_order(np.concatenate([facet_corners, side_corners]))
    facet_of_code = np.full(int(code.max(initial=-1)) + 1, len(facet_corners))
    np.minimum.at(facet_of_code, code[: len(facet_corners)], np.arange(len(facet_corners)))
    facet_index = facet_of_code[code[len(facet_corners) :]]
    is_facet = facet_index < len(facet_corners)
    return cell_index[is_facet], side[is_facet], facet_index[is_facet]

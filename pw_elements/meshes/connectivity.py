"""Cells by the nodes that they share: whether they agree, and which facets they have.

DOLFINx takes the nodes of cells as they are: a node that is missing ends the process, and of two
middle nodes of one edge one is lost without a word.
"""

import basix
import basix.ufl
import numpy as np

from pw_elements.arrays import Indices


def encode_rows(rows: Indices) -> Indices:
    """Return one number for each row (n, k) of nodes, equal for rows that have the same nodes."""
    rows = np.sort(rows, axis=1)
    code, width = rows[:, 0], int(rows.max(initial=0)) + 1
    for column in rows[:, 1:].T:
        code = np.unique(code, return_inverse=True)[1] * width + column
    return np.unique(code, return_inverse=True)[1].astype(np.int64)


def check_nodes_of_cells(
    cells: Indices, cell: str, degree: int, elements: Indices, nodes: Indices
) -> None:
    """Refuse cells that have a node twice, or whose neighbours have other nodes on their side.

    Args:
        cells: rows of nodes (n, k), in DOLFINx' order.
        cell: their type, such as "triangle".
        degree: of the geometry, 1 or 2.
        elements: numbers (n,) by which messages name the cells.
        nodes: numbers by which messages name the nodes.

    Raises:
        ValueError: if that is so, with the numbers of an element and a node.
    """
    ordered = np.sort(cells, axis=1)
    repeated = (np.diff(ordered, axis=1) == 0).any(axis=1)
    if repeated.any():
        raise ValueError(f"element {elements[repeated.argmax()]} has a node twice")
    if degree == 1:
        return
    element = basix.ufl.element("Lagrange", cell, degree)
    parts_of = basix.topology(basix.CellType[cell])
    # every node has one place: a corner, or the middle of one edge, face or cell
    place = np.full(len(nodes), -1)
    place[cells[:, : len(parts_of[0])]] = 0
    first = 1
    for dim in range(1, len(parts_of)):
        dofs = element.entity_dofs[dim]
        corners = [part for part, inside in zip(parts_of[dim], dofs, strict=True) if inside]
        if not corners:
            continue
        middle = cells[:, [inside[0] for inside in dofs]]
        code = first + encode_rows(cells[:, corners].reshape(-1, len(corners[0])))
        code = code.reshape(middle.shape)
        taken = place[middle] >= 0
        place[middle] = np.where(taken, place[middle], code)
        node_of = np.full(int(code.max()) + 1, -1)
        node_of[code] = middle
        wrong = (place[middle] != code) | (node_of[code] != middle)
        if wrong.any():
            which, side = np.argwhere(wrong)[0]
            raise ValueError(
                f"element {elements[which]} has the node {nodes[middle[which, side]]} in the "
                "middle of an edge or face where a neighbour has another one, or has it elsewhere"
            )
        first = int(code.max()) + 1


def find_facets(cells: Indices, cell: str, facets: Indices) -> tuple[Indices, Indices, Indices]:
    """Find facets among the sides of cells.

    Args:
        cells: rows of nodes (n, k), in DOLFINx' order.
        cell: their type.
        facets: corners (m, c) of facets, in any order.

    Returns:
        Of each side that is one of the facets: cell, side, and facet, the first of equal ones.
    """
    dim = basix.cell.geometry(basix.CellType[cell]).shape[1]
    corners = np.array(basix.topology(basix.CellType[cell])[dim - 1])
    in_facet = np.zeros(max(int(cells.max()), int(facets.max(initial=0))) + 1, dtype=bool)
    in_facet[facets] = True
    of_cell, side = np.nonzero(in_facet[cells[:, corners]].all(axis=2))
    rows = cells[of_cell[:, None], corners[side]]
    code = encode_rows(np.concatenate([facets, rows]))
    first_of = np.full(int(code.max(initial=-1)) + 1, len(facets))
    np.minimum.at(first_of, code[: len(facets)], np.arange(len(facets)))
    facet = first_of[code[len(facets) :]]
    matched = facet < len(facets)
    return of_cell[matched], side[matched], facet[matched]

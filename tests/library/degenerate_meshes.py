"""Meshes that make no body, and some that do; as a program, what all processes say of them.

Started by test_mesh_checks.py, under `mpirun -n 2` and 3, too; prints JSON.
"""

import json
import sys

from mpi4py import MPI

import basix.ufl
import numpy as np
from dolfinx.mesh import create_mesh

from pw_elements.checks import DegenerateMesh, check_mesh
from tests.library.random_meshes import Grid, structured

SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
# a triangle's side (1, 0) to (1, 1) beside two halves of it
HALVES = [[1, 4, 6], [6, 4, 5], [6, 5, 2]]
TORN = [*SQUARE, [2, 0], [2, 1], [1, 0.5]]
NODES = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1], [0, -1], [1, -1], [2, -1], [1, 0], [2, 0]]
CRACKED = [[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4], [6, 7, 0], [7, 9, 0], [7, 8, 9], [8, 10, 9]]

TORN_APART = (
    "have hanging nodes: smaller facets of their neighbours lie on them, and the mesh is torn "
    "apart there"
)
ONE_SIDE = "lie on the same side of a facet as their neighbour"


def box(cell, counts, low, high):
    ends = zip(low, high, counts, strict=True)
    return structured(cell, [np.linspace(a, b, n + 1) for a, b, n in ends], 1)


def together(*grids):
    """Grids as one, without common nodes."""
    first = np.cumsum([0, *(len(grid.x) for grid in grids)])
    cells = [grid.cells + count for grid, count in zip(grids, first, strict=False)]
    return Grid(grids[0].cell, np.vstack([grid.x for grid in grids]), np.vstack(cells))


def two(cell, counts, others, low):
    dim = len(low)
    high = [a + 1.0 for a in low]
    grid = together(box(cell, counts, [0.0] * dim, [1.0] * dim), box(cell, others, low, high))
    return grid.cell, grid.x, grid.cells


def coarse_beside_fine():
    """A hexahedron, and four beside it that share its four corners there."""
    fine = box("hexahedron", (1, 2, 2), (1, 0, 0), (2, 1, 1))
    corners = np.array([[0, y, z] for z in (0, 1) for y in (0, 1)], dtype=float)
    shared = [
        int(np.flatnonzero(np.isclose(fine.x, [1, y, z]).all(axis=1))[0])
        for z in (0, 1)
        for y in (0, 1)
    ]
    n = len(fine.x)
    coarse = [number for k in range(4) for number in (n + k, shared[k])]
    return "hexahedron", np.vstack([fine.x, corners]), np.vstack([fine.cells, [coarse]])


GOOD = {
    "two bodies that match": lambda: two("triangle", (3, 3), (3, 3), (0.0, 1.0)),
    "two bodies that match in 3-D": lambda: two(
        "hexahedron", (2, 2, 2), (2, 2, 2), (0.0, 0.0, 1.0)
    ),
    "two bodies that touch": lambda: two("triangle", (4, 4), (3, 3), (0.3, 1.0)),
    "two bodies that touch in 3-D": lambda: two(
        "tetrahedron", (2, 2, 2), (3, 3, 3), (0.0, 0.3, 1.0)
    ),
    "two quadrilaterals that touch": lambda: two("quadrilateral", (4, 4), (2, 2), (0.0, 1.0)),
    "a crack": lambda: ("triangle", NODES, CRACKED),
}
BAD = {
    "folded": (
        lambda: (
            "triangle",
            [*SQUARE, [1.2, 0.9]],
            [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
        ),
        "cells around (0.7333, 0.3), (0.7333, 0.9667), (1.067, 0.6333) " + ONE_SIDE,
    ),
    "flat": (
        lambda: ("triangle", [[0, 0], [1, 0], [2, 0], [0, 1]], [[0, 1, 3], [0, 1, 2]]),
        "cells around (1, 0) have no volume",
    ),
    "not convex": (
        lambda: ("quadrilateral", [[0, 0], [1, 0], [0, 1], [0.3, 0.3]], [[0, 1, 2, 3]]),
        "cells around (0.325, 0.325) are turned inside out in a part of them",
    ),
    "hanging nodes": (
        lambda: ("triangle", TORN, [[0, 1, 2], [0, 2, 3], *HALVES]),
        f"facets around (1, 0.5) {TORN_APART}",
    ),
    "hanging nodes in 3-D": (
        coarse_beside_fine,
        f"facets around (1, 0.5, 0.5) {TORN_APART}",
    ),
    "overlap": (
        lambda: two("quadrilateral", (2, 2), (2, 2), (0.5, 0.5)),
        "cells around (0.75, 0.75) lie in other parts of the mesh",
    ),
    "overlap in 3-D": (
        lambda: two("hexahedron", (2, 2, 2), (2, 2, 2), (0.5, 0.5, 0.5)),
        "cells around (0.75, 0.75, 0.75) lie in other parts of the mesh",
    ),
}
# DOLFINx may not survive making them
CROWDED = {
    "twice the same cell": lambda: (
        "quadrilateral",
        [[0, 0], [1, 0], [0, 1], [1, 1]],
        [[0, 1, 2, 3]] * 2,
    ),
    "three triangles at an edge": lambda: (
        "triangle",
        [*SQUARE, [0.5, 0.8]],
        [[0, 1, 2], [0, 2, 3], [0, 2, 4]],
    ),
}


def built(comm, kind, x, cells):
    """A mesh whose nodes and cells the first process has."""
    x, cells = np.array(x, dtype=float), np.array(cells, dtype=np.int64)
    if comm.rank > 0:
        x, cells = x[:0], cells[:0]
    element = basix.ufl.element("Lagrange", kind, 1, shape=(x.shape[1],))
    return create_mesh(comm, cells=cells, x=x, e=element)


def said(comm, make):
    try:
        check_mesh(built(comm, *make()))
    except DegenerateMesh as error:
        return str(error)
    return "passes"


if __name__ == "__main__":
    cases = GOOD | {name: make for name, (make, _) in BAD.items()}
    if sys.argv[1:]:
        cases = {name: CROWDED[name] for name in sys.argv[1:]}
    outcome = {name: MPI.COMM_WORLD.allgather(said(MPI.COMM_WORLD, m)) for name, m in cases.items()}
    if MPI.COMM_WORLD.rank == 0:
        sys.stdout.write(json.dumps(outcome) + "\n")

"""Mesh checks are compared with elementary geometry on randomly distorted meshes."""

import gc
import logging
import re
import subprocess
import sys
import weakref
from contextlib import suppress

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
from dolfinx.mesh import create_mesh, create_unit_square
from hypothesis import given
from hypothesis import strategies as st

from pw_elements import Body, Material, Spaces
from pw_elements.checks import DegenerateMesh, check_mesh, meshes
from pw_elements.meshes import curved_mesh
from tests.library.random_meshes import SEED_STRATEGY, Grid, grids, structured_grid
from tests.parallel import PROJECT, run_on_processes

UNIT_LINE_OF_THREE_CELLS = np.linspace(0.0, 1.0, 4)


SQUARE_CORNERS = [[0, 0], [1, 0], [1, 1], [0, 1]]
# cells on the right of the edge from (1, 0) to (1, 1), which they divide into two halves
TRIANGLES_BESIDE_DIVIDED_EDGE = [[1, 4, 6], [6, 4, 5], [6, 5, 2]]
NODES_WITH_HANGING_NODE = [*SQUARE_CORNERS, [2, 0], [2, 1], [1, 0.5]]
CRACKED_MESH_NODES = [
    [0, 0],
    [1, 0],
    [2, 0],
    [0, 1],
    [1, 1],
    [2, 1],
    [0, -1],
    [1, -1],
    [2, -1],
    [1, 0],
    [2, 0],
]
CRACKED_MESH_CELLS = [
    [0, 1, 3],
    [1, 4, 3],
    [1, 2, 4],
    [2, 5, 4],
    [6, 7, 0],
    [7, 9, 0],
    [7, 8, 9],
    [8, 10, 9],
]

HANGING_NODES_MESSAGE = (
    "have hanging nodes: smaller facets of their neighbours lie on them, and the mesh is torn "
    "apart there"
)
FOLDED_CELLS_MESSAGE = "lie on the same side of a facet as their neighbour"


def make_box_grid(cell, divisions, lower_corner, upper_corner):
    ends = zip(lower_corner, upper_corner, divisions, strict=True)
    return structured_grid(cell, [np.linspace(a, b, n + 1) for a, b, n in ends], 1)


def join_grids(*grids):
    offsets = np.cumsum([0, *(len(grid.x) for grid in grids)])
    cells = [grid.cells + count for grid, count in zip(grids, offsets, strict=False)]
    return Grid(grids[0].cell, np.vstack([grid.x for grid in grids]), np.vstack(cells))


def make_two_unit_boxes(cell, divisions, other_divisions, other_lower_corner):
    dim = len(other_lower_corner)
    high = [a + 1.0 for a in other_lower_corner]
    grid = join_grids(
        make_box_grid(cell, divisions, [0.0] * dim, [1.0] * dim),
        make_box_grid(cell, other_divisions, other_lower_corner, high),
    )
    return grid.cell, grid.x, grid.cells


def make_brick_beside_four_smaller_bricks():
    """Return a hexahedron and four smaller hexahedra that share four of its corners."""
    fine = make_box_grid("hexahedron", (1, 2, 2), (1, 0, 0), (2, 1, 1))
    corners = np.array([[0, y, z] for z in (0, 1) for y in (0, 1)], dtype=float)
    shared = [
        int(np.flatnonzero(np.isclose(fine.x, [1, y, z]).all(axis=1))[0])
        for z in (0, 1)
        for y in (0, 1)
    ]
    n_fine = len(fine.x)
    coarse = [number for k in range(4) for number in (n_fine + k, shared[k])]
    return "hexahedron", np.vstack([fine.x, corners]), np.vstack([fine.cells, [coarse]])


VALID_MESHES = {
    "two bodies that match": lambda: make_two_unit_boxes("triangle", (3, 3), (3, 3), (0.0, 1.0)),
    "two bodies that match in 3-D": lambda: make_two_unit_boxes(
        "hexahedron", (2, 2, 2), (2, 2, 2), (0.0, 0.0, 1.0)
    ),
    "two bodies that touch": lambda: make_two_unit_boxes("triangle", (4, 4), (3, 3), (0.3, 1.0)),
    "two bodies that touch in 3-D": lambda: make_two_unit_boxes(
        "tetrahedron", (2, 2, 2), (3, 3, 3), (0.0, 0.3, 1.0)
    ),
    "a crack": lambda: ("triangle", CRACKED_MESH_NODES, CRACKED_MESH_CELLS),
}
DEGENERATE_MESHES_WITH_MESSAGES = {
    "folded": (
        lambda: (
            "triangle",
            [*SQUARE_CORNERS, [1.2, 0.9]],
            [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
        ),
        "cells around (0.7333, 0.3), (0.7333, 0.9667), (1.067, 0.6333) " + FOLDED_CELLS_MESSAGE,
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
        lambda: (
            "triangle",
            NODES_WITH_HANGING_NODE,
            [[0, 1, 2], [0, 2, 3], *TRIANGLES_BESIDE_DIVIDED_EDGE],
        ),
        f"facets around (1, 0.5) {HANGING_NODES_MESSAGE}",
    ),
    "hanging nodes in 3-D": (
        make_brick_beside_four_smaller_bricks,
        f"facets around (1, 0.5, 0.5) {HANGING_NODES_MESSAGE}",
    ),
    "overlap": (
        lambda: make_two_unit_boxes("quadrilateral", (2, 2), (2, 2), (0.5, 0.5)),
        "cells around (0.75, 0.75) lie in other parts of the mesh",
    ),
    "overlap in 3-D": (
        lambda: make_two_unit_boxes("hexahedron", (2, 2, 2), (2, 2, 2), (0.5, 0.5, 0.5)),
        "cells around (0.75, 0.75, 0.75) lie in other parts of the mesh",
    ),
}


THREE_CELLS_AT_FACET_MESSAGE = (
    "cells around (0.5833, 0.6667), (0.5833, 0.6833), (0.6667, 0.5833) share a facet with two "
    "others"
)


def make_three_triangles_at_edge():
    """Return the cell name, nodes and cells of a mesh in which three triangles share an edge.

    The mesh has many more cells, because DOLFINx may crash if there are few.
    """
    x = [[i / 4, j / 4] for j in range(5) for i in range(5)] + [[0.5, 0.8]]
    corners = [[i, i + 1, i + 5, i + 6] for i in range(20) if i % 5 < 4]
    cells = [three for a, b, c, d in corners for three in ([a, b, d], [a, d, c])]
    return "triangle", x, [*cells, [12, 18, 25]]


def build_mesh(comm, cell_name, node_coordinates, cells):
    """Create a mesh from the nodes and cells that are given on process 0."""
    node_coordinates, cells = (
        np.array(node_coordinates, dtype=float),
        np.array(cells, dtype=np.int64),
    )
    if comm.rank > 0:
        node_coordinates, cells = node_coordinates[:0], cells[:0]
    element = basix.ufl.element("Lagrange", cell_name, 1, shape=(node_coordinates.shape[1],))
    return create_mesh(comm, cells=cells, x=node_coordinates, e=element)


def is_refused_as_degenerate(mesh):
    try:
        check_mesh(mesh)
    except DegenerateMesh:
        return True
    return False


@given(SEED_STRATEGY, st.floats(0.0, 0.6), st.sampled_from(["triangle", "tetrahedron"]))
def test_simplices_that_fill_a_box_more_than_once_are_refused_and_no_others(seed, distortion, cell):
    dim = 2 if cell == "triangle" else 3
    grid = structured_grid(cell, [UNIT_LINE_OF_THREE_CELLS] * dim, seed)
    is_inner = np.all((grid.x > 0.01) & (grid.x < 0.99), axis=1)
    rng = np.random.default_rng(seed)
    x = grid.x + is_inner[:, None] * distortion * rng.uniform(-1, 1, grid.x.shape)
    edges = x[grid.cells][:, 1:] - x[grid.cells][:, :1]
    volume = np.abs(np.linalg.det(edges)).sum() / (2 if dim == 2 else 6)
    if 1e-9 < volume - 1 < 1e-6:
        return  # the excess may count as round-off
    assert is_refused_as_degenerate(Grid(cell, x, grid.cells).mesh()) == (volume > 1 + 1e-9)


@given(SEED_STRATEGY, st.floats(0.0, 0.5))
def test_quadrilaterals_are_refused_unless_convex_and_beside_each_other(seed, distortion):
    grid = structured_grid("quadrilateral", [UNIT_LINE_OF_THREE_CELLS] * 2, seed)
    rng = np.random.default_rng(seed)
    x = grid.x + distortion * rng.uniform(-1, 1, grid.x.shape)
    a, b, c, d = np.swapaxes(x[grid.cells], 0, 1)
    corner_determinants = [
        np.linalg.det(np.stack([q - p, r - p], axis=1))
        for p, q, r in ((a, b, c), (b, d, a), (d, c, b), (c, a, d))
    ]
    if np.abs(corner_determinants).min() < 1e-6:
        return
    # if all cells are convex, only cells at the boundary can overlap; small distortions exclude it
    is_valid = np.min(corner_determinants) > 0
    if is_valid and distortion > 0.16:
        return
    assert is_refused_as_degenerate(Grid("quadrilateral", x, grid.cells).mesh()) == (not is_valid)


@given(SEED_STRATEGY, st.floats(0.05, 1.4), st.floats(0.0, 2 * np.pi))
def test_two_bodies_are_refused_if_a_centre_at_the_side_of_one_is_in_the_other(
    seed, distance, angle
):
    rng = np.random.default_rng(seed)
    rotation_angle = rng.uniform(0, 2 * np.pi)
    R = np.array(
        [
            [np.cos(rotation_angle), -np.sin(rotation_angle)],
            [np.sin(rotation_angle), np.cos(rotation_angle)],
        ]
    )
    shift = distance * np.array([np.cos(angle), np.sin(angle)])
    body, other_body = (
        structured_grid("triangle", [np.linspace(-0.5, 0.5, n + 1)] * 2, seed) for n in (4, 3)
    )
    other_x = other_body.x @ R.T + shift

    def rim_cell_centres(x, cells):
        """Return the centres of the cells that have a side on the boundary of the square."""
        on = [np.isclose(np.abs(x), 0.5)[cells][..., k].sum(axis=1) == 2 for k in (0, 1)]
        return x[cells[on[0] | on[1]]].mean(axis=1)

    depths = np.concatenate(
        [
            0.5 - np.abs((rim_cell_centres(body.x, body.cells) - shift) @ R).max(axis=1),
            0.5
            - np.abs(rim_cell_centres(other_body.x, other_body.cells) @ R.T + shift).max(axis=1),
        ]
    )
    if np.abs(depths).min() < 1e-6:
        return
    cells = np.vstack([body.cells, other_body.cells + len(body.x)])
    mesh_of_both = Grid("triangle", np.vstack([body.x, other_x]), cells)
    assert is_refused_as_degenerate(mesh_of_both.mesh()) == (depths.max() > 0)


@given(grids(("triangle", "quadrilateral", "tetrahedron", "hexahedron")))
def test_smoothly_deformed_boxes_pass_the_mesh_checks(grid):
    curved = curved_mesh(grid.mesh(), lambda x: x + 0.01 * np.sin(3 * x[:, [1, 2, 0]]))
    for mesh in (grid.mesh(), curved):
        check_mesh(mesh)


@pytest.mark.parametrize("name", VALID_MESHES)
def test_valid_meshes_pass_and_cracks_are_logged(name, caplog):
    caplog.set_level(logging.INFO, "pw_elements")
    check_mesh(build_mesh(MPI.COMM_SELF, *VALID_MESHES[name]()))
    logged = [(record.levelname, record.getMessage()) for record in caplog.records]
    if name == "a crack":
        message = "facets coincide, but share no nodes: a crack in one piece of the mesh at "
        assert logged == [("WARNING", f"{message}(0.5, 0), (1.5, 0)")]
    elif name.startswith("two bodies that match"):
        assert len(logged) == 1
        assert logged[0][0] == "INFO"
        assert "two pieces of the mesh that touch at " in logged[0][1]
    else:
        assert not logged


@pytest.mark.parametrize("name", DEGENERATE_MESHES_WITH_MESSAGES)
def test_degenerate_meshes_raise_their_messages(name):
    make_mesh, message = DEGENERATE_MESHES_WITH_MESSAGES[name]
    with pytest.raises(ValueError, match=re.escape(message)) as raised:
        check_mesh(build_mesh(MPI.COMM_SELF, *make_mesh()))
    assert (raised.type, str(raised.value)) == (DegenerateMesh, message)


def collect_mesh_check_outcomes(comm, mesh_makers):
    outcome = {}
    for name, make_mesh in mesh_makers.items():
        outcome[name] = "passes"
        try:
            check_mesh(build_mesh(comm, *make_mesh()))
        except DegenerateMesh as error:
            outcome[name] = str(error)
    return outcome


def collect_outcomes_of_all_meshes(comm):
    return collect_mesh_check_outcomes(
        comm,
        VALID_MESHES
        | {name: make_mesh for name, (make_mesh, _) in DEGENERATE_MESHES_WITH_MESSAGES.items()},
    )


THREE_CELLS_AT_FACET_SCRIPT = """
import os
from mpi4py import MPI
from tests.library.test_mesh_checks import collect_mesh_check_outcomes, make_three_triangles_at_edge
outcomes = collect_mesh_check_outcomes(MPI.COMM_SELF, {"": make_three_triangles_at_edge})
print(*outcomes.values(), flush=True)
os._exit(0)
"""


def test_more_than_two_cells_at_a_facet_are_refused():
    """Meshes with more than two cells at a facet are refused.

    They are built in a separate process, because DOLFINx may crash or hang. One of five attempts
    has to give the error.
    """
    command, outputs = [sys.executable, "-c", THREE_CELLS_AT_FACET_SCRIPT], []
    while THREE_CELLS_AT_FACET_MESSAGE not in outputs and len(outputs) < 5:
        outputs.append("a hang")
        with suppress(subprocess.TimeoutExpired):
            run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=300)
            outputs[-1] = run.stdout.strip()
    assert THREE_CELLS_AT_FACET_MESSAGE in outputs


def test_all_processes_give_the_same_mesh_check_outcome():
    expected = {
        name: words for name, (_, words) in DEGENERATE_MESHES_WITH_MESSAGES.items()
    } | dict.fromkeys(VALID_MESHES, "passes")
    assert run_on_processes(2, collect_outcomes_of_all_meshes) == [expected] * 2


def test_a_mesh_is_checked_once_until_it_moves_and_is_not_kept_alive(monkeypatch):
    checks = []
    original = meshes._CellChecks
    monkeypatch.setattr(meshes, "_CellChecks", lambda mesh: checks.append(1) or original(mesh))
    mesh = create_unit_square(MPI.COMM_SELF, 3, 3)
    spaces = Spaces.petrov_galerkin(mesh)
    for _ in range(3):
        Body(spaces, Material(1.0), "plane stress")
    assert len(checks) == 1
    mesh.geometry.x[:] *= 2
    Body(spaces, Material(1.0), "plane stress")
    assert len(checks) == 2
    mesh.geometry.x[:, 0] = 0.0
    for _ in range(2):  # failed checks are not remembered, so the second one fails again
        with pytest.raises(DegenerateMesh, match="have no volume"):
            Body(spaces, Material(1.0), "plane stress")
    reference = weakref.ref(mesh)
    del mesh, spaces
    gc.collect()
    assert reference() is None

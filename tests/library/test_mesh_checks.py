"""What a mesh can tell: judged against plain arithmetic on meshes that were moved at random."""

import gc
import json
import logging
import os
import shutil
import subprocess
import sys
import weakref
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import create_unit_square
from hypothesis import given
from hypothesis import strategies as st

from pw_elements import Body, Material, Spaces
from pw_elements.checks import DegenerateMesh, check_mesh, meshes
from pw_elements.meshes import curved
from tests.library.degenerate_meshes import BAD, GOOD, built
from tests.library.random_meshes import SEEDS, Grid, grids, structured

PROJECT = Path(__file__).parents[2]
LINES = np.linspace(0.0, 1.0, 4)


def refused(mesh):
    try:
        check_mesh(mesh)
    except DegenerateMesh:
        return True
    return False


def test_the_error_is_one_of_values():
    assert issubclass(DegenerateMesh, ValueError)


@given(SEEDS, st.floats(0.0, 0.6), st.sampled_from(["triangle", "tetrahedron"]))
def test_simplices_that_fill_a_box_more_than_once_are_refused_and_no_others(seed, by, cell):
    dim = 2 if cell == "triangle" else 3
    grid = structured(cell, [LINES] * dim, seed)
    inner = np.all((grid.x > 0.01) & (grid.x < 0.99), axis=1)
    rng = np.random.default_rng(seed)
    x = grid.x + inner[:, None] * by * rng.uniform(-1, 1, grid.x.shape)
    edges = x[grid.cells][:, 1:] - x[grid.cells][:, :1]
    volume = np.abs(np.linalg.det(edges)).sum() / (2 if dim == 2 else 6)
    if 1e-9 < volume - 1 < 1e-6:
        return  # by so little that it may be taken for round-off
    assert refused(Grid(cell, x, grid.cells).mesh()) == (volume > 1 + 1e-9)


@given(SEEDS, st.floats(0.0, 0.5))
def test_quadrilaterals_are_refused_unless_convex_and_beside_each_other(seed, by):
    grid = structured("quadrilateral", [LINES] * 2, seed)
    rng = np.random.default_rng(seed)
    x = grid.x + by * rng.uniform(-1, 1, grid.x.shape)
    a, b, c, d = np.swapaxes(x[grid.cells], 0, 1)
    turns = [
        np.linalg.det(np.stack([q - p, r - p], axis=1))
        for p, q, r in ((a, b, c), (b, d, a), (d, c, b), (c, a, d))
    ]
    if np.abs(turns).min() < 1e-6:
        return
    # of one sense all over the mesh, which leaves nothing but overlaps of the boundary
    right = np.min(turns) > 0
    if right and by > 0.16:
        return
    assert refused(Grid("quadrilateral", x, grid.cells).mesh()) == (not right)


@given(SEEDS, st.floats(0.05, 1.4), st.floats(0.0, 2 * np.pi))
def test_two_bodies_are_refused_if_a_centre_at_the_side_of_one_is_in_the_other(seed, far, angle):
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0, 2 * np.pi)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    shift = far * np.array([np.cos(angle), np.sin(angle)])
    one, two = (structured("triangle", [np.linspace(-0.5, 0.5, n + 1)] * 2, seed) for n in (4, 3))
    placed = two.x @ R.T + shift

    def rim(x, cells):
        """Centres of the cells with a side on the rim of a square."""
        on = [np.isclose(np.abs(x), 0.5)[cells][..., k].sum(axis=1) == 2 for k in (0, 1)]
        return x[cells[on[0] | on[1]]].mean(axis=1)

    depths = np.concatenate(
        [
            0.5 - np.abs((rim(one.x, one.cells) - shift) @ R).max(axis=1),
            0.5 - np.abs(rim(two.x, two.cells) @ R.T + shift).max(axis=1),
        ]
    )
    if np.abs(depths).min() < 1e-6:
        return
    cells = np.vstack([one.cells, two.cells + len(one.x)])
    both = Grid("triangle", np.vstack([one.x, placed]), cells)
    assert refused(both.mesh()) == (depths.max() > 0)


@given(grids(("triangle", "quadrilateral", "tetrahedron", "hexahedron")))
def test_boxes_in_smooth_images_pass(grid):
    bent = curved(grid.mesh(), lambda x: x + 0.01 * np.sin(3 * x[:, [1, 2, 0]]))
    for mesh in (grid.mesh(), bent):
        check_mesh(mesh)


@pytest.mark.parametrize("name", GOOD)
def test_legitimate_meshes_pass(name, caplog):
    caplog.set_level(logging.INFO, "pw_elements")
    check_mesh(built(MPI.COMM_SELF, *GOOD[name]()))
    said = [(record.levelname, record.getMessage()) for record in caplog.records]
    if name == "a crack":
        words = "facets coincide, but share no nodes: a crack in one piece of the mesh at "
        assert said == [("WARNING", f"{words}(0.5, 0), (1.5, 0)")]
    elif name.startswith("two bodies that match"):
        assert len(said) == 1
        assert said[0][0] == "INFO"
        assert "two pieces of the mesh that touch at " in said[0][1]
    else:
        assert not said


@pytest.mark.parametrize("name", BAD)
def test_degenerate_meshes_are_named(name):
    make, words = BAD[name]
    with pytest.raises(DegenerateMesh) as caught:
        check_mesh(built(MPI.COMM_SELF, *make()))
    assert str(caught.value) == words


@pytest.mark.parametrize("name", ["twice the same cell", "three triangles at an edge"])
def test_more_than_two_cells_at_a_facet(name):
    """In a process of its own: building such a mesh is beyond what DOLFINx promises."""
    command = [sys.executable, "-m", "tests.library.degenerate_meshes", name]
    for _ in range(5):  # DOLFINx itself crashes now and then, before anything is said
        run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=1800)
        if run.stdout:
            break
    said = {
        "twice the same cell": "cells around (0.5, 0.5) have the same vertices as another cell",
        "three triangles at an edge": "cells around (0.3333, 0.6667), (0.5, 0.6), (0.6667, 0.3333) "
        "share a facet with two others",
    }
    assert json.loads(run.stdout) == {name: [said[name]]}


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
@pytest.mark.parametrize("processes", [2, 3])
def test_all_processes_say_the_same(processes):
    command = [
        "mpirun",
        "-n",
        str(processes),
        sys.executable,
        "-m",
        "tests.library.degenerate_meshes",
    ]
    quiet = os.environ | {"OMPI_MCA_mpi_yield_when_idle": "1"}
    run = subprocess.run(
        command, cwd=PROJECT, env=quiet, capture_output=True, text=True, timeout=1800
    )
    assert run.returncode == 0, run.stderr
    expected = {name: [words] * processes for name, (_, words) in BAD.items()}
    expected |= {name: ["passes"] * processes for name in GOOD}
    assert json.loads(run.stdout) == expected


def test_a_mesh_is_looked_at_once_until_it_moves_and_is_not_kept(monkeypatch):
    looked = []
    real = meshes._Cells
    monkeypatch.setattr(meshes, "_Cells", lambda mesh: looked.append(1) or real(mesh))
    mesh = create_unit_square(MPI.COMM_SELF, 3, 3)
    spaces = Spaces.petrov_galerkin(mesh)
    for _ in range(3):
        Body(spaces, Material(1.0), "plane stress")
    assert len(looked) == 1
    mesh.geometry.x[:] *= 2
    Body(spaces, Material(1.0), "plane stress")
    assert len(looked) == 2
    mesh.geometry.x[:, 0] = 0.0
    for _ in range(2):  # that it is none is not remembered
        with pytest.raises(DegenerateMesh, match="have no volume"):
            Body(spaces, Material(1.0), "plane stress")
    alive = weakref.ref(mesh)
    del mesh, spaces
    gc.collect()
    assert alive() is None


def test_one_body_is_as_large_as_its_boundary_says():
    """Area vectors that cancel inside make the volume the boundary's integral of x.n / dim."""
    mesh = structured("triangle", [LINES] * 2, 3, 0.5).mesh()
    cells = meshes._Cells(mesh)
    cells.check()
    surface = meshes._Surface(cells)
    volume = np.sum(surface.area * surface.corner.mean(axis=1)) / 2
    assert volume == pytest.approx(1.0, rel=1e-14)

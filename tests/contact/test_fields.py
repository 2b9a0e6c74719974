"""Contact results as functions, in files for ParaView, and in pictures."""

import os
import shutil
from unittest.mock import patch

from mpi4py import MPI

import matplotlib as mpl
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Reduction,
    as_function,
    assemble_scalar,
    boundary_measure,
    prescribe,
    reactions,
)
from pw_elements._compat import cell_geometry_nodes
from pw_elements.contact import (
    SLIP,
    STICK,
    ContactFields,
    ContactPair,
    Motion,
    Parabola,
    Plane,
    Sphere,
    plot,
    write,
)
from pw_elements.files import FOLDER_MARK_FILE_NAME
from pw_elements.meshes import move_nodes, triangles
from study.model.elements import composite_spaces
from study.solutions.half_space import ElasticHalfSpace as HalfPlane
from study.solutions.half_space import HertzLine, HertzSphere
from tests.contact.cases import (
    GALERKIN,
    PETROV_GALERKIN,
    BlockOnFloor,
    ElasticBody,
    make_x_spacing_unequal,
    on_plane,
)
from tests.library import vtx

FIELD_NAMES_WITHOUT_PRESSURES = ["displacement", "contact_force", "gap", "slip", "status"]
PRESSURE_FIELD_NAMES = ["pressure", "tributary_pressure", "traction"]


def nodes_where(space, where):
    return fem.locate_dofs_geometrical(space, where)


def solve_ball_on_block(
    comm=MPI.COMM_SELF, cell=CellType.tetrahedron, method=PETROV_GALERKIN, nu=0.3, n=4
):
    """Return a block and its states under a sphere that is pressed on it, then moved sideways."""
    mesh = create_box(comm, [(-1, -1, 0), (1, 1, 1)], (n, n, 2), cell)
    body = ElasticBody(mesh, method, "solid", nu=nu)
    motions = [Motion((0, 0, -0.1)), Motion((0.01, 0.02, None), (0, 0, -80.0))]
    pair = ContactPair(on_plane(2, 1.0), Sphere((0, 0, 3), 2.0), 0.3, motions)
    return body, body.solve_contact(pair, body.make_clamping_supports(on_plane(2, 0.0)))


@pytest.mark.parametrize("cell", [CellType.tetrahedron, CellType.hexahedron])
def test_fields_and_pictures_in_space_add_up_to_the_contact_force(cell, tmp_path):
    body, (*_, state) = solve_ball_on_block(cell=cell, n=6)
    (pair,), fields = state.pairs, ContactFields.from_state(state, body.body)
    force = fields.force.x.array.reshape(-1, 3)
    assert force.sum(axis=0) == pytest.approx(pair.force, rel=1e-9)
    assert force[:, 2].sum() == pytest.approx(-80.0, rel=1e-9)
    # sub-cells are 1/6 wide and nodes on the rim of the face are open: closed nodes have area 1/36
    top = nodes_where(body.space, on_plane(2, 1.0))
    outwards = body.x[top] - (np.array([0.0, 0.0, 3.0]) + pair.translation)
    normal = outwards / np.linalg.norm(outwards, axis=1)[:, None]
    traction = fields.traction.x.array.reshape(-1, 3)[top]
    traction += fields.pressure.x.array[top, None] * normal
    assert np.abs(traction / 36 - force[top]).max() < 1e-9 * np.abs(force).max()
    assert (fields.pressure.x.array[top] > 0).sum() > 20
    reaction = reactions(body.K, state.displacement, body.zero_load).array_r.reshape(-1, 3)
    assert np.abs(reaction - force)[body.x[:, 2] > 1e-9].max() < 1e-9 * np.abs(force).max()

    axes = plot(state, body.body)
    (coloured_faces,) = (c for c in axes.collections if hasattr(c, "_triangulation"))
    corners, values = coloured_faces._triangulation.triangles, coloured_faces.get_array()
    x, y = pair.position[:, :2][corners].transpose(2, 0, 1)
    signed = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    assert np.abs(signed).sum() / 2 == pytest.approx(4.0)  # each point of the face is covered once
    assert np.abs(signed).min() > 0.1 * np.abs(signed).max()
    # the triangles interpolate like the weight functions; the integral is therefore the force
    total = (np.abs(signed) / 2 * values[corners].mean(axis=1)).sum()
    tolerance = 1e-9 if cell is CellType.tetrahedron else 0.02
    assert total == pytest.approx(pair.force_normal.sum(), rel=tolerance)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels[0] == "edge of contact"
    assert labels[-1].startswith("shear, at most")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x", "y")
    axes.figure.savefig(tmp_path / "face.png")
    assert (tmp_path / "face.png").stat().st_size > 10_000


def test_a_space_alone_gives_all_fields_but_pressures():
    block = BlockOnFloor(4)
    (state,) = block.solve(0.3, 60.0, n_pull_increments=0)
    fields = ContactFields.from_state(state, block.space)
    assert [f.name for f in fields.functions()] == FIELD_NAMES_WITHOUT_PRESSURES
    assert fields.pressure is None
    fields = ContactFields.from_state(state, block.body)
    assert [
        f.name for f in fields.functions()
    ] == FIELD_NAMES_WITHOUT_PRESSURES + PRESSURE_FIELD_NAMES


def test_as_function_overwrites_the_values_of_a_function():
    block = BlockOnFloor(4)
    u = as_function(block.space, block.pressure_load, "load")
    doubled_load = 2.0 * block.pressure_load
    constant = fem.Constant(block.mesh, 0.5)
    form = fem.form(constant * ufl.inner(u, u) * ufl.dx)
    integral = fem.assemble_scalar(form)
    assert as_function(block.space, doubled_load, out=u) is u
    assert u.name == "load"
    assert fem.assemble_scalar(form) == pytest.approx(4 * integral)
    with pytest.raises(ValueError, match="belongs to another space"):
        as_function(block.space, doubled_load, out=fem.Function(BlockOnFloor(4).space))
    with pytest.raises(ValueError, match="the vector has 90 degrees of freedom, the space has 182"):
        as_function(BlockOnFloor(6).space, doubled_load)


def solve_hertz_and_measure_error_and_indicator(edges_per_half_width, cell=None):
    """Solve a Hertz contact; return the stress error, its indicator, cell size and half-width.

    If `cell` is None, the problem is a line contact on triangles. Otherwise it is a quarter of the
    contact of a sphere, on cells of this type.
    """
    elastic, radius = HalfPlane(1.0, 0.3), 1000.0
    exact_solution = HertzSphere(elastic, radius, 1.0) if cell else HertzLine(elastic, radius, 5e-4)
    a, dim = exact_solution.half_width, 3 if cell else 2
    h = a / (edges_per_half_width + 0.4)
    contact_end = (np.floor(2 * a / h) + 0.1) * h
    n_cells = 2 * (edges_per_half_width + 1) if cell else 3 * edges_per_half_width
    side = n_cells * h
    if cell:
        corners = [(0, 0, -side), (side, side, 0)]
        mesh = create_box(MPI.COMM_SELF, corners, [n_cells] * 3, cell)
    else:
        mesh = triangles(MPI.COMM_SELF, (0.0, -side), (side, 0.0), (n_cells, n_cells), "left")
    elastic = ElasticBody(mesh, state="solid" if cell else "plane strain", E=1.0)
    body, space = elastic.body, elastic.space

    def exact_displacement(x):
        r = np.linalg.norm(x[: dim - 1], axis=0)
        radial, vertical = exact_solution.displacement(np.column_stack([r, x[dim - 1]])).T
        return np.vstack([radial * x[: dim - 1] / np.maximum(r, h / 4), vertical])

    def on_outer_sides(x):
        return np.isclose(x[:dim], side).any(axis=0) | np.isclose(x[dim - 1], -side)

    def near_contact(x):
        return np.isclose(x[dim - 1], 0) & (x[: dim - 1] < contact_end).all(axis=0)

    exact_function = fem.Function(space)
    exact_function.interpolate(exact_displacement)
    symmetry_conditions = [
        prescribe(space, i, lambda x, i=i: np.isclose(x[i], 0) & ~on_outer_sides(x))
        for i in range(dim - 1)
    ]
    supports = Reduction.dirichlet(
        space,
        [fem.dirichletbc(exact_function, nodes_where(space, on_outer_sides)), *symmetry_conditions],
    )
    punch = Parabola((0,) * dim, radius)
    motion = Motion([0.0] * (dim - 1) + [-exact_solution.approach])
    (state,) = elastic.solve_contact(ContactPair(near_contact, punch, 0.0, [motion]), supports)
    fields, x = ContactFields.from_state(state, body), ufl.SpatialCoordinate(mesh)
    squared_radius = sum(x[i] ** 2 for i in range(dim - 1))
    exact = exact_solution.peak_pressure * ufl.sqrt(ufl.max_value(0.0, 1 - squared_radius / a**2))
    squared_error = (body.stress(fields.displacement)[dim - 1, dim - 1] + exact) ** 2
    error = np.sqrt(assemble_scalar(squared_error * boundary_measure(mesh, near_contact, 12)))
    return error, fields.error_indicator(), h, a


def test_the_indicator_is_the_error_of_the_stresses():
    """The error indicator agrees with the true error of the stresses in a Hertz contact.

    The true error is the difference between computed stresses and Hertz' pressure. The indicator
    halves if the cell size is halved, and it is largest at the edge of the contact.
    """
    norms = []
    for edges in (6, 12):
        error, indicator, h, a = solve_hertz_and_measure_error_and_indicator(edges)
        norms.append(np.linalg.norm(indicator.x.array))
        assert 0.85 < norms[-1] / error < 1.05
        mesh = indicator.function_space.mesh
        worst_cell = mesh.geometry.x[cell_geometry_nodes(mesh)[indicator.x.array.argmax()]].mean(
            axis=0
        )
        assert abs(worst_cell[0] - a) < 2 * h
        assert -h < worst_cell[1] < 0
    assert 1.7 < norms[0] / norms[1] < 2.3


@pytest.mark.parametrize(
    ("cell", "bounds"), [(CellType.tetrahedron, (0.85, 1.05)), (CellType.hexahedron, (1.1, 1.4))]
)
def test_the_indicator_is_near_the_error_in_space(cell, bounds):
    error, indicator, _, _ = solve_hertz_and_measure_error_and_indicator(3, cell)
    assert bounds[0] < np.linalg.norm(indicator.x.array) / error < bounds[1]


def test_an_error_indicator_without_a_stress_is_refused():
    body, (*_, state) = solve_ball_on_block()
    with pytest.raises(ValueError, match="one that is not hybrid"):
        ContactFields.from_state(state, body.space).error_indicator()
    body, (*_, state) = solve_ball_on_block(method=GALERKIN)
    with pytest.raises(ValueError, match="nodes of this element have no weight"):
        ContactFields.from_state(state, body.body).error_indicator()


def test_states_of_another_body_or_of_other_nodes_are_refused():
    block, finer_block = BlockOnFloor(4), BlockOnFloor(6)
    (state,) = block.solve(0.3, 60.0, n_pull_increments=0)
    skewed_spaces = PETROV_GALERKIN(
        move_nodes(triangles(MPI.COMM_SELF, (0.0, 0.0), (4.0, 2.0), (4, 2)), make_x_spacing_unequal)
    )
    half_pair = ContactPair(lambda x: on_plane(1, 0.0)(x) & (x[0] < 2.6), Plane((0, 0), (0, 1)))
    (half_state,) = block.solve_contact(
        half_pair, block.make_supports((0, on_plane(0, 0.0))), block.pressure_load
    )
    fields = ContactFields.from_state(state, block.body)
    ContactFields.from_state(half_state, block.space)
    for attempt, message in (
        (lambda: ContactFields.from_state(state, finer_block.body), "belongs to another space"),
        (lambda: ContactFields.from_state(state, skewed_spaces.trial), "belongs to another space"),
        (lambda: fields.fill(half_state), "other contact nodes than the fields"),
    ):
        with pytest.raises(ValueError, match=message):
            attempt()
    for function in (ContactFields.from_state, plot):
        with pytest.raises(TypeError, match="solve_contact gives a list of states"):
            function([state], block.body)
        with pytest.raises(TypeError, match=r"body is of the type BlockOnFloor: "):
            function(state, block)
        with pytest.raises(ValueError, match=r"contact pair 0: its nodes at \(2\.5, 0\) belong"):
            function(half_state, block.body)


@pytest.mark.skipif(vtx.load_adios2_library() is None, reason="no C library of ADIOS2")
def test_files_hold_the_states(tmp_path):
    block = BlockOnFloor(12)
    states = block.solve(0.3, 60.0, n_pull_increments=2)
    write(tmp_path / "block.bp", states[:1], block.body)
    write(tmp_path / "block.bp", states, block.body)  # replaces the first file
    assert [path.name for path in tmp_path.iterdir()] == ["block.bp"]
    steps = vtx.read_times_and_fields(tmp_path / "block.bp")
    assert [time for time, _ in steps] == [1.0, 2.0, 3.0]
    xml = vtx.read_vtk_schema(tmp_path / "block.bp")
    for name in FIELD_NAMES_WITHOUT_PRESSURES + PRESSURE_FIELD_NAMES:
        assert f'Name="{name}"' in xml
    for (_, values), state in zip(steps, states, strict=True):
        assert values["connectivity"].shape == (len(block.space.dofmap.list), 7)
        assert np.abs(values["geometry"][:, :2] - block.x).max() < 1e-14
        assert np.array_equal(values["displacement"][:, :2].ravel(), state.displacement.array_r)
        (pair,) = state.pairs
        x = values["geometry"]
        base_nodes = np.flatnonzero(np.isclose(x[:, 1], 0.0))
        base_nodes = base_nodes[np.argsort(x[base_nodes, 0])]
        area = np.full(25, 4 / 24)
        area[[0, -1]] /= 2
        pressure = values["pressure"][base_nodes, 0]
        assert pressure == pytest.approx(pair.force_normal / area, rel=1e-9)
        shear = values["traction"][base_nodes, 0]
        assert shear == pytest.approx(pair.force_tangential[:, 0] / area, rel=1e-9, abs=1e-6)
        assert np.array_equal(values["status"][base_nodes, 0], pair.status)
        assert np.array_equal(values["gap"][base_nodes, 0], pair.gap)
        assert np.isnan(np.delete(values["gap"], base_nodes, axis=0)).all()
        assert values["contact_force"][base_nodes, 1] == pytest.approx(pair.force_normal)


def test_files_that_cannot_be_written_are_refused(tmp_path):
    block = BlockOnFloor(4)
    states = block.solve(0.3, 60.0, n_pull_increments=1)
    path = tmp_path / "block.bp"
    for arguments, message in (
        ((tmp_path / "block.vtu", states), "ends in .bp"),
        ((path, []), "no state to write"),
        ((path, states, [0.0]), "as many times"),
        ((path, states, [1.0, 1.0]), "each after the last"),
        ((path, states, [1.0, np.inf]), "finite"),
    ):
        with pytest.raises(ValueError, match=message):
            write(arguments[0], arguments[1], block.body, *arguments[2:])
    with pytest.raises(FileNotFoundError, match="folder does not exist"):
        write(tmp_path / "missing" / "block.bp", states, block.body)
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="not replaced"):
        write(path, states, block.body)
    assert path.read_text() == "mine"
    path.unlink()
    full_disk = patch.object(
        os, "posix_fallocate", side_effect=OSError(28, "No space left on device")
    )
    with full_disk, pytest.raises(OSError, match=r"it takes about 0\.\d+ MB: .*block\.bp"):
        write(path, states, block.body)
    assert list(tmp_path.iterdir()) == []
    composite_block = BlockOnFloor(4, composite_spaces)
    (state,) = composite_block.solve(0.3, 60.0, n_pull_increments=0)
    with pytest.raises(ValueError, match="not Lagrange's of degree 2"):
        write(path, state, composite_block.body)
    write(path, states[0], block.space)
    (state,) = BlockOnFloor(6).solve(0.3, 60.0, n_pull_increments=0)
    with pytest.raises(ValueError, match="belongs to another space"):
        write(path, [states[0], state], block.space, [0.0, 1.0])
    assert [file.name for file in tmp_path.iterdir()] == ["block.bp"]


def test_a_users_folder_that_resembles_a_series_is_not_overwritten(tmp_path):
    """A user's folder that looks like a time series is not overwritten.

    Neither is a time series to which a user has added files.
    """
    block = BlockOnFloor(4)
    states = block.solve(0.3, 60.0, n_pull_increments=1)
    copy, path = tmp_path / "copy.bp", tmp_path / "block.bp"
    write(path, states[:1], block.body)
    shutil.copytree(path, copy)
    (copy / FOLDER_MARK_FILE_NAME).unlink()  # as if another program had written it
    contents = {file: file.read_bytes() for file in copy.iterdir()}
    with pytest.raises(FileExistsError, match="does not say that it is a time series"):
        write(copy, states, block.body)
    assert {file: file.read_bytes() for file in copy.iterdir()} == contents
    (path / "data.1").write_text("mine")
    with pytest.raises(FileExistsError, match=r"it holds data\.1, not written with it"):
        write(path, states, block.body)
    assert (path / "data.1").read_text() == "mine"
    assert sorted(os.listdir(tmp_path)) == ["block.bp", "copy.bp"]


def test_an_error_while_writing_leaves_the_old_series(tmp_path, monkeypatch):
    block = BlockOnFloor(4)
    states = block.solve(0.3, 60.0, n_pull_increments=1)
    path = tmp_path / "block.bp"
    write(path, states[:1], block.body)
    old_contents = {file: file.read_bytes() for file in path.iterdir()}
    fill = ContactFields.fill

    def fail_at_second_state(self, state):
        if state is states[1]:
            raise RuntimeError("no more")
        fill(self, state)

    monkeypatch.setattr(ContactFields, "fill", fail_at_second_state)
    with pytest.raises(RuntimeError, match="no more"):
        write(path, states, block.body)
    assert {file: file.read_bytes() for file in path.iterdir()} == old_contents
    assert os.listdir(tmp_path) == ["block.bp"]


def points_of_plotted_lines(axes):
    return [line.get_xydata() for line in axes.lines]


def test_the_picture_of_a_contact_line_shows_pressure_shear_and_status():
    from matplotlib import pyplot

    mpl.use("Agg")
    block = BlockOnFloor(12)
    state = block.solve(0.3, 60.0, n_pull_increments=2)[-1]
    axes = plot(state, block.body)
    (pair,) = state.pairs
    area = np.full(25, 4 / 24)
    area[[0, -1]] /= 2
    expected = {"pressure": pair.force_normal / area, "shear": pair.force_tangential[:, 0] / area}
    for values in expected.values():
        curve = np.column_stack([pair.position[:, 0], values])
        assert any(
            c.shape == curve.shape and np.allclose(c, curve) for c in points_of_plotted_lines(axes)
        )
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert len(labels) == len(set(labels)) == 4
    n_points_by_label = {line.get_label(): len(line.get_xdata()) for line in axes.lines}
    assert n_points_by_label["shear, stick"] == np.count_nonzero(pair.status == STICK)
    assert n_points_by_label["shear, slip"] == np.count_nonzero(pair.status == SLIP)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("arc length", "traction")
    second_axes = pyplot.subplots()[1]
    assert plot(state, block.body, axes=second_axes, along=0) is second_axes
    assert second_axes.get_xlabel() == "x"
    for points, points_along_x in zip(
        points_of_plotted_lines(axes), points_of_plotted_lines(second_axes), strict=True
    ):
        if len(points) == 25:  # nodes from the left to the right; arc length begins at x = 0
            assert points == pytest.approx(points_along_x)
    with pytest.raises(ValueError, match="pair 1: the state has 1"):
        plot(state, block.body, pair=1)
    with pytest.raises(ValueError, match="along = 2"):
        plot(state, block.body, along=2)

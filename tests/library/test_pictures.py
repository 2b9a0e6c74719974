"""Pictures of bodies show known shapes with the right areas and colours."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle
from matplotlib.figure import Figure

from pw_elements import Body, Material, Spaces, draw
from pw_elements.meshes import curved_mesh, triangles

COMM = MPI.COMM_SELF


def polygon_area(polygon):
    x, y = np.asarray(polygon).T[:2]
    return 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))


def coloured_polygons(axes):
    """Return the coloured (not transparent) polygons of a 3-D picture, with their colours."""
    (collection,) = axes.collections
    colours = collection.get_facecolors()
    paths = [path.vertices[:-1] for path in collection.get_paths()]
    return [(p, c) for p, c in zip(paths, colours, strict=True) if c[3] > 0]


@pytest.fixture
def figure_axes():
    return Figure().subplots()


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_plane_body_is_drawn_where_it_has_moved(figure_axes, cell):
    mesh = create_rectangle(COMM, [[0, 0], [2, 1]], [3, 2], CellType[cell])
    u = fem.Function(fem.functionspace(mesh, ("Lagrange", 2, (2,))))
    u.interpolate(lambda x: np.array([0.1 * x[0], 0.2 + 0 * x[1]]))
    draw(mesh, u[0], u, scale=10, axes=figure_axes)
    (body,) = (c for c in figure_axes.collections if c.get_array() is not None)
    ends = body.get_datalim(figure_axes.transData)
    assert [ends.x0, ends.x1, ends.y0, ends.y1] == pytest.approx([0, 4, 2, 3])
    assert body.get_clim() == pytest.approx((0.0, 0.2))


@pytest.mark.parametrize(
    ("cell", "view", "faces"),
    [("tetrahedron", (30, 40), 3), ("hexahedron", (0, 20), 2), ("hexahedron", (1e-5, 20), 3)],
)
def test_faces_of_a_box_that_look_at_the_viewer_are_drawn(figure_axes, cell, view, faces):
    """The faces of a box that are turned to the viewer are drawn, and no others.

    Their projected area is the area of the box's shadow along the line of sight.
    """
    size = np.array([1.0, 2.0, 3.0])
    mesh = create_box(COMM, [np.zeros(3), size], [2, 2, 2], CellType[cell])
    draw(mesh, ufl.SpatialCoordinate(mesh)[2], axes=figure_axes, view=view)
    up, turned = np.radians(view)
    eye = [np.cos(up) * np.cos(turned), np.cos(up) * np.sin(turned), np.sin(up)]
    shadow = np.abs(eye) @ (np.prod(size) / size)
    assert sum(polygon_area(p) for p, _ in coloured_polygons(figure_axes)) == pytest.approx(shadow)
    assert len(coloured_polygons(figure_axes)) == faces * 128  # each face is drawn in 128 parts


def test_height_and_colour_in_the_picture_follow_the_z_coordinate(figure_axes):
    mesh = create_box(COMM, [np.zeros(3), np.ones(3)], [2, 2, 2])
    draw(mesh, ufl.SpatialCoordinate(mesh)[2], axes=figure_axes, view=(0, 0), colours="gray")
    parts = coloured_polygons(figure_axes)
    height = np.array([p[:, 1].mean() for p, _ in parts])
    grey = np.array([c[0] for _, c in parts])
    assert np.corrcoef(height, grey)[0, 1] > 0.99


def test_a_ball_is_seen_as_a_disc(figure_axes):
    box = create_box(COMM, [-np.ones(3), np.ones(3)], [4, 4, 4])

    def map_cube_to_ball(x):
        size = np.linalg.norm(x, axis=1, keepdims=True)
        return x * np.abs(x).max(axis=1, keepdims=True) / np.where(size > 0, size, 1)

    draw(curved_mesh(box, map_cube_to_ball), axes=figure_axes, view=(17, 33))
    assert sum(polygon_area(p) for p, _ in coloured_polygons(figure_axes)) == pytest.approx(
        np.pi, rel=0.02
    )


def test_stress_on_the_axis_of_rotation_is_drawn(figure_axes):
    mesh = triangles(COMM, (0.0, 0.0), (1.0, 1.0), (2, 2))
    body = Body(Spaces.galerkin(mesh), Material(1.0, 0.3), "axisymmetric")
    u = fem.Function(body.spaces.trial)
    u.interpolate(lambda x: np.array([x[0], 0 * x[1]]))
    draw(mesh, body.stress(u)[1, 1], axes=figure_axes)
    (drawn,) = (c for c in figure_axes.collections if c.get_array() is not None)
    assert np.isfinite(drawn.get_array()).all()
    assert np.asarray(drawn.get_array()) == pytest.approx(2 * 0.3 / (1.3 * 0.4))


def test_a_label_makes_a_colour_bar_and_limits_are_kept():
    mesh = triangles(COMM, (0.0, 0.0), (1.0, 1.0), (2, 2))
    x = ufl.SpatialCoordinate(mesh)
    axes = draw(mesh, x[0], label="x [m]", limits=(-1, 3))
    bar = axes.figure.axes[1]
    assert (bar.get_ylabel(), bar.get_ylim()) == ("x [m]", (-1, 3))

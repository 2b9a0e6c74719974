"""Pictures of plane and solid bodies with Matplotlib.

    u = as_function(U, solve(K, f, held))
    axes = draw(mesh, body.von_mises(u), u, scale=100, label="von Mises stress [MPa]")
    axes.figure.savefig("bracket.png", dpi=150)

Solid bodies are drawn in parallel projection. The functions need Matplotlib, but no display. For
sections, animations and large meshes, write files for ParaView.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, exterior_facet_indices
from scipy.spatial.transform import Rotation
from ufl.algorithms import extract_coefficients
from ufl.core.expr import Expr
from ufl.domain import extract_unique_domain

from pw_elements._compat import interpolation_points
from pw_elements.arrays import Array, Indices
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.elasticity import locate_facet_nodes_in_cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable


SUB_TRIANGLE_NODES_BY_NODE_COUNT = {
    6: [[0, 5, 4], [1, 3, 5], [2, 4, 3], [3, 4, 5]],
    9: [
        *([0, 4, 8], [0, 8, 5], [4, 1, 6], [4, 6, 8]),
        *([5, 8, 7], [5, 7, 2], [8, 6, 3], [8, 3, 7]),
    ],
}
"""Nodes of the sub-triangles of a cell, by its number of nodes: 6 (triangle), 9 (quadrilateral).

Nodes are numbered in Basix' order.
"""
_FACET_TYPE_BY_NODE_COUNT = {6: basix.CellType.triangle, 9: basix.CellType.quadrilateral}
_OUTLINE_NODES_BY_NODE_COUNT = {6: [0, 5, 1, 3, 2, 4], 9: [0, 4, 1, 6, 3, 7, 2, 5]}
# Parts into which each edge of a facet of a solid is divided; each resulting triangle has one
# colour
_DRAWN_PARTS_PER_FACET_EDGE = 4
_BODY_COLOUR_WITHOUT_VALUES = (0.78, 0.82, 0.86)
_MAX_DRAWN_COORDINATE = 1e150  # areas of faces with larger coordinates overflow
# A triangle is visible if the component of its unit normal towards the eye is larger than this
_MIN_NORMAL_COMPONENT_TOWARDS_EYE = 1e-9
# Direction to the light (right, up, towards the eye), and brightness of surfaces in shadow
_LIGHT_DIRECTION = np.array([0.35, 0.5, 0.79])
_SHADOW_BRIGHTNESS = 0.55


class _DrawnFaces(NamedTuple):
    """Faces to be drawn, gathered from all processes, each with k nodes in Basix' order."""

    x: Array  # deformed positions (f, k, dim) of the nodes
    values: Array  # values (f, k) of the field at the nodes, zero if no field is drawn
    cell_centres: Array  # centres (f, dim) of the cells to which the faces belong


@check_same_arguments_on_all_processes
def draw(
    mesh: Mesh,
    values: Expr | None = None,
    displacement: fem.Function | None = None,
    scale: float = 1.0,
    axes: Axes | None = None,
    label: str = "",
    colours: str = "viridis",
    limits: tuple[float, float] | None = None,
    view: tuple[float, float] = (25.0, -60.0),
    edges: bool = True,
) -> Axes:
    """Draw a deformed body, coloured by a field; all processes have to call this function.

        draw(mesh, u[1], u, label="deflection [mm]")
        draw(mesh, body.von_mises(u), u, scale=50, axes=axes, view=(30, 45))

    The field is evaluated in each cell separately. The colours may therefore jump between cells, as
    stresses do. Curved cells are drawn curved.

    Args:
        mesh: mesh of triangles, quadrilaterals, tetrahedra or hexahedra.
        values: scalar field to be shown, a function or UFL expression; None for a grey body.
        displacement: displacement field; None for the undeformed body.
        scale: factor by which displacements are multiplied.
        axes: Matplotlib's axes to draw in; None for the axes of a new figure.
        label: label of the colour bar; without a label, no colour bar is drawn.
        colours: name of a colour map of Matplotlib.
        limits: lower and upper limit of the colour range; None for the range of the values. Limits
            are useful if stresses are unbounded at sharp corners.
        view: direction of the view of a solid body: elevation of the eye above the xy plane and
            azimuth in this plane, in degrees. The z axis points up.
        edges: whether the edges of the cells are drawn.

    Returns:
        The axes. Each process draws the whole body in axes of its own; save the figure on one
        process.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: if the values are not scalar; if a displacement, scale, view or limits are not
            finite or have the wrong size; if a function belongs to another mesh; if the cells are
            not supported; or if the colour map is unknown.
    """
    arguments.check_double_precision_mesh(mesh)
    with raise_errors_on_all_processes(mesh.comm):
        _check_fields(mesh, values, displacement)
        check_matplotlib_axes(axes)
    import matplotlib.pyplot as plt

    arguments.check_finite_number("scale", scale)
    arguments.check_type("label", label, str, "it has to be a string")
    arguments.check_flag("edges", edges)
    if not (isinstance(colours, str) and colours in plt.colormaps()):
        raise ValueError(f"colours = {colours!r}: give the name of one of Matplotlib's colour maps")
    arguments.check_vector("view", view, 2)
    if limits is not None:
        arguments.check_vector("limits", limits, 2)
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    faces = _collect_faces(mesh, values, displacement, scale)
    axes = plt.subplots(layout="constrained")[1] if axes is None else axes
    palette = (
        ListedColormap([_BODY_COLOUR_WITHOUT_VALUES]) if values is None else plt.get_cmap(colours)
    )
    # thinner lines if there are more faces
    line_width = float(np.clip(25 / np.sqrt(len(faces.x)), 0.1, 0.6)) if edges else 0.0
    colour_range = (
        Normalize(*limits) if limits else Normalize(np.min(faces.values), np.max(faces.values))
    )
    colour_map = ScalarMappable(colour_range, palette)
    if mesh.geometry.dim == 2:
        _draw_plane_faces(axes, faces, colour_map, line_width)
    else:
        _draw_solid_faces(axes, faces, colour_map, line_width, view)
    axes.autoscale_view()
    axes.set_aspect("equal")
    if label:
        axes.figure.colorbar(colour_map, ax=axes, label=label, shrink=0.8)
    return axes


def check_matplotlib_axes(axes: object) -> None:
    """Raise TypeError on this process unless `axes` is None or an instance of Matplotlib's Axes."""
    if axes is not None:
        from matplotlib.axes import Axes

        arguments.check_type("axes", axes, Axes, "give Matplotlib's, figure.subplots()")


def _check_fields(mesh: Mesh, values: Expr | None, displacement: fem.Function | None) -> None:
    dim = mesh.geometry.dim
    for field in (values, displacement):
        if isinstance(field, fem.Function) and field.function_space.mesh is not mesh:
            raise ValueError(f"the function {field.name} belongs to another mesh")
    if mesh.topology.dim != dim or dim == 1:
        raise ValueError(f"a mesh of {mesh.topology.dim}-D cells in {dim}-D space is not drawn")
    if values is not None:
        arguments.check_type("values", values, Expr, "give a function or a UFL expression")
        if values.ufl_shape != ():
            raise ValueError(f"values have the shape {values.ufl_shape}: draw one component, u[0]")
        domain = extract_unique_domain(values)
        if domain is None or isinstance(values, fem.Constant):
            raise ValueError("values are a constant: there is nothing to draw")
        if domain != mesh.ufl_domain():
            raise ValueError("the values belong to another mesh")
        if any(f.ufl_element().has_custom_quadrature for f in extract_coefficients(values)):
            raise ValueError(
                "the values contain a history function, which has values at quadrature points "
                "alone: draw mean values of cells"
            )
    if displacement is not None:
        remedy = "as_function(U, a) makes a function of a vector"
        arguments.check_type("displacement", displacement, fem.Function, remedy)
        if displacement.ufl_shape != (dim,):
            raise ValueError(
                f"the displacement has the shape {displacement.ufl_shape}: a vector has ({dim},)"
            )


def _collect_faces(
    mesh: Mesh, values: Expr | None, displacement: fem.Function | None, scale: float
) -> _DrawnFaces:
    """Return the cells of a plane body, or the exterior facets of a solid body, to be drawn.

    Collective: every process returns the faces of all processes. Values that are not finite are
    replaced by the mean of the other values in the cell.
    """
    dim = mesh.geometry.dim
    position = ufl.SpatialCoordinate(mesh)
    if displacement is not None:
        position = position + fem.Constant(mesh, float(scale)) * displacement
    coordinates = _evaluate_at_cell_nodes(mesh, position, (dim,))
    with raise_errors_on_all_processes(mesh.comm):
        if not np.all(np.abs(coordinates) < _MAX_DRAWN_COORDINATE):
            raise ValueError("the displacement times scale is not finite, or off any picture")
    node_values = (
        np.zeros(coordinates.shape[:2])
        if values is None
        else _evaluate_at_cell_nodes(mesh, values, ())
    )
    is_defined = np.isfinite(node_values)  # the hoop strain u_r / r is 0 / 0 at r = 0
    mean = np.where(is_defined, node_values, 0.0).sum(axis=1) / np.maximum(
        is_defined.sum(axis=1), 1
    )
    node_values = np.where(is_defined, node_values, mean[:, None])
    if dim == 2:
        cells = np.arange(mesh.topology.index_map(dim).size_local)[:, None]
        nodes_in_cell = np.arange(coordinates.shape[1])[None]
    else:
        nodes = fem.functionspace(mesh, ("Lagrange", 2))
        mesh.topology.create_connectivity(2, 3)
        facet_cells, nodes_in_cell = locate_facet_nodes_in_cells(
            nodes, exterior_facet_indices(mesh.topology)
        )
        cells = facet_cells[:, None]
    cell_centres = coordinates.mean(axis=1)[cells[:, 0]]
    gathered = mesh.comm.allgather(
        (coordinates[cells, nodes_in_cell], node_values[cells, nodes_in_cell], cell_centres)
    )
    return _DrawnFaces(*(np.concatenate(parts) for parts in zip(*gathered, strict=True)))


def _evaluate_at_cell_nodes(mesh: Mesh, expression: Expr, value_shape: tuple[int, ...]) -> Array:
    """Evaluate an expression in each local cell (including ghosts) at the cell's nodes.

    Returns:
        Values (cells, nodes per cell, *shape).
    """
    cell = mesh.topology.cell_name()
    element = basix.ufl.element("Lagrange", cell, 2, shape=value_shape, discontinuous=True)
    space = fem.functionspace(mesh, element)
    function = fem.Function(space)
    function.interpolate(fem.Expression(expression, interpolation_points(space)))
    return function.x.array.reshape(-1, *value_shape)[space.dofmap.list]


def _draw_plane_faces(
    axes: Axes, faces: _DrawnFaces, colour_map: ScalarMappable, line_width: float
) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.tri import Triangulation

    n_nodes = faces.x.shape[1]
    x, first_node = faces.x.reshape(-1, 2), n_nodes * np.arange(len(faces.x))
    triangles = (
        np.array(SUB_TRIANGLE_NODES_BY_NODE_COUNT[n_nodes]) + first_node[:, None, None]
    ).reshape(-1, 3)
    values = faces.values.ravel()
    cells = Triangulation(x[:, 0], x[:, 1], triangles)
    axes.tripcolor(cells, values, shading="gouraud", cmap=colour_map.cmap, norm=colour_map.norm)
    outlines = faces.x[:, [*_OUTLINE_NODES_BY_NODE_COUNT[n_nodes], 0]]
    axes.add_collection(
        LineCollection(list(outlines), colors="k", linewidths=line_width, alpha=0.6)
    )


def _draw_solid_faces(
    axes: Axes,
    faces: _DrawnFaces,
    colour_map: ScalarMappable,
    line_width: float,
    view: tuple[float, float],
) -> None:
    """Draw the faces that are turned towards the eye, from the farthest to the nearest."""
    from matplotlib.collections import PolyCollection

    corners, outline, shape_values = _triangulate_facet(_FACET_TYPE_BY_NODE_COUNT[faces.x.shape[1]])
    # unit vectors to the right, upwards and towards the eye
    view_rotation = (
        Rotation.from_euler("ZX", [view[1] + 90, 90 - view[0]], degrees=True).as_matrix().T
    )
    x = np.einsum("pn,fnd,ed->fpe", shape_values, faces.x, view_rotation)
    values = np.einsum("pn,fn->fp", shape_values, faces.values)
    triangles = x[:, corners]
    normals = np.cross(
        triangles[:, :, 1] - triangles[:, :, 0], triangles[:, :, 2] - triangles[:, :, 0]
    )
    outward_vectors = triangles.mean(axis=2) - (faces.cell_centres @ view_rotation.T)[:, None]
    normals *= np.sign(np.sum(normals * outward_vectors, axis=-1, keepdims=True))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    light = _SHADOW_BRIGHTNESS + (1 - _SHADOW_BRIGHTNESS) * np.clip(
        normals @ _LIGHT_DIRECTION, 0, 1
    )
    colour = colour_map.to_rgba(values[:, corners].mean(axis=2))
    colour[..., :3] *= light[..., None]

    polygons, face_colours, edge_colours = [], [], []
    for face in np.argsort(x[..., 2].mean(axis=1)):
        (visible,) = np.nonzero(normals[face, :, 2] > _MIN_NORMAL_COMPONENT_TOWARDS_EYE)
        if len(visible):
            polygons += [*triangles[face, visible, :, :2], x[face, outline, :2]]
            face_colours += [*colour[face, visible], np.zeros(4)]
            edge_colours += [*colour[face, visible], np.array([0, 0, 0, 0.6 if line_width else 0])]
    # thin lines in the colour of the triangle close the gaps between triangles
    line_widths = np.where(np.array(face_colours)[:, 3] > 0, 0.3, line_width)
    axes.add_collection(
        PolyCollection(
            polygons, facecolors=face_colours, edgecolors=edge_colours, linewidths=line_widths
        )
    )
    axes.set_axis_off()


def _triangulate_facet(facet_type: basix.CellType) -> tuple[Indices, Indices, Array]:
    """Cut a quadratic facet into small triangles for drawing.

    Returns:
        Indices (t, 3) of the points of the triangles, indices of the points on the outline in
        cyclic order, and values (points, nodes) of the shape functions at all points.
    """
    from scipy.spatial import Delaunay

    points = basix.create_lattice(
        facet_type, _DRAWN_PARTS_PER_FACET_EDGE, basix.LatticeType.equispaced, exterior=True
    )
    element = basix.create_element(
        basix.ElementFamily.P, facet_type, 2, basix.LagrangeVariant.gll_warped
    )
    hull_points = Delaunay(points).convex_hull.ravel()
    rim_points = np.unique(hull_points)
    from_centre = points[rim_points] - basix.geometry(facet_type).mean(axis=0)
    outline = rim_points[np.argsort(np.arctan2(from_centre[:, 1], from_centre[:, 0]))]
    return Delaunay(points).simplices, outline, element.tabulate(0, points)[0, :, :, 0]

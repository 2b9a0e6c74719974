"""Pictures of bodies, in the plane and in space, by Matplotlib.

    u = as_function(U, solve(K, f, held))
    axes = draw(mesh, body.von_mises(u), u, scale=100, label="von Mises stress [MPa]")
    axes.figure.savefig("bracket.png", dpi=150)

Bodies in space are seen from afar (parallel projection): nothing but Matplotlib is needed, and no
screen. For sections, animations and large meshes write files for ParaView.
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
from ufl.core.expr import Expr
from ufl.domain import extract_unique_domain

from pw_elements._compat import interpolation_points
from pw_elements.arrays import Array, Indices
from pw_elements.checks import arguments, check_same_arguments, collective_errors
from pw_elements.elasticity import locate_facets_in_cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable


SUB_TRIANGLES = {
    6: [[0, 5, 4], [1, 3, 5], [2, 4, 3], [3, 4, 5]],
    9: [
        *([0, 4, 8], [0, 8, 5], [4, 1, 6], [4, 6, 8]),
        *([5, 8, 7], [5, 7, 2], [8, 6, 3], [8, 3, 7]),
    ],
}
"""Sub-triangles of a triangle of 6 and a quadrilateral of 9 nodes, in Basix' order."""
_FACETS = {6: basix.CellType.triangle, 9: basix.CellType.quadrilateral}
_OUTLINES = {6: [0, 5, 1, 3, 2, 4], 9: [0, 4, 1, 6, 3, 7, 2, 5]}
# Parts of an edge of a facet in space, each with one colour
_PARTS = 4
_GREY = (0.78, 0.82, 0.86)
_FAR = 1e150  # beyond, areas overflow
# Least component of a face's unit normal towards the eye at which the face is drawn
_EDGE_ON = 1e-9
# Direction to the light (to the right, upwards, towards the eye); brightness of what it misses
_LIGHT = np.array([0.35, 0.5, 0.79])
_SHADE = 0.55


class _Faces(NamedTuple):
    """Faces to be seen, of all processes: k nodes each, in the order of Basix."""

    x: Array  # (f, k, dim), deformed
    values: Array  # (f, k), zero where none are drawn
    behind: Array  # (f, dim), the middle of the cell that each belongs to


@check_same_arguments
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
    """Draws a body, deformed and coloured by a field; every process calls it.

        draw(mesh, u[1], u, label="deflection [mm]")
        draw(mesh, body.von_mises(u), u, scale=50, axes=axes, view=(30, 45))

    The field is drawn cell by cell, so that stresses may jump between cells. Curved cells are drawn
    curved.

    Args:
        mesh: of triangles, quadrilaterals, tetrahedra or hexahedra.
        values: scalar field, a function or UFL expression; by default the body is plain.
        displacement: vector field that moves the body; by default it is not moved.
        scale: factor of the displacements.
        axes: to draw in; by default those of a new figure.
        label: of the colour bar, which is drawn only with a label.
        colours: name of Matplotlib's colour map.
        limits: least and greatest value of the colours, beyond which they do not change: stresses
            at sharp corners are unbounded. By default those of the values.
        view: elevation above and azimuth in the plane of x and y of the eye, in degrees; z is up.
        edges: whether the cells' edges are drawn.

    Returns:
        The axes. Each process has its own; let one of them save the figure.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for values that are not scalar, a displacement, scale, view or limits that are
            not finite or of the wrong size, another mesh's function, unknown cells or colours.
    """
    arguments.check_mesh_type(mesh)
    with collective_errors(mesh.comm):
        _check(mesh, values, displacement)
        check_axes(axes)
    import matplotlib.pyplot as plt

    arguments.check_number("scale", scale)
    arguments.check_type("label", label, str, "it has to be a string")
    arguments.check_flag("edges", edges)
    if not (isinstance(colours, str) and colours in plt.colormaps()):
        raise ValueError(f"colours = {colours!r}: give the name of one of Matplotlib's colour maps")
    arguments.check_vector("view", view, 2)
    if limits is not None:
        arguments.check_vector("limits", limits, 2)
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    faces = _faces(mesh, values, displacement, scale)
    axes = plt.subplots(layout="constrained")[1] if axes is None else axes
    palette = ListedColormap([_GREY]) if values is None else plt.get_cmap(colours)
    # hair lines where cells are many
    width = float(np.clip(25 / np.sqrt(len(faces.x)), 0.1, 0.6)) if edges else 0.0
    ends = Normalize(*limits) if limits else Normalize(np.min(faces.values), np.max(faces.values))
    shown = ScalarMappable(ends, palette)
    if mesh.geometry.dim == 2:
        _plane(axes, faces, shown, width)
    else:
        _space(axes, faces, shown, width, view)
    axes.autoscale_view()
    axes.set_aspect("equal")
    if label:
        axes.figure.colorbar(shown, ax=axes, label=label, shrink=0.8)
    return axes


def check_axes(axes: object) -> None:
    """Raises TypeError for what is not Matplotlib's; local."""
    if axes is not None:
        from matplotlib.axes import Axes

        arguments.check_type("axes", axes, Axes, "give Matplotlib's, figure.subplots()")


def _check(mesh: Mesh, values: Expr | None, displacement: fem.Function | None) -> None:
    dim = mesh.geometry.dim
    for thing in (values, displacement):
        if isinstance(thing, fem.Function) and thing.function_space.mesh is not mesh:
            raise ValueError(f"the function {thing.name} belongs to another mesh")
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
    if displacement is not None:
        remedy = "as_function(U, a) makes a function of a vector"
        arguments.check_type("displacement", displacement, fem.Function, remedy)
        if displacement.ufl_shape != (dim,):
            raise ValueError(
                f"the displacement has the shape {displacement.ufl_shape}: a vector has ({dim},)"
            )


def _faces(
    mesh: Mesh, values: Expr | None, displacement: fem.Function | None, scale: float
) -> _Faces:
    dim = mesh.geometry.dim
    place = ufl.SpatialCoordinate(mesh)
    if displacement is not None:
        place = place + fem.Constant(mesh, float(scale)) * displacement
    moved = _in_cells(mesh, place, (dim,))
    with collective_errors(mesh.comm):
        if not np.all(np.abs(moved) < _FAR):
            raise ValueError("the displacement times scale is not finite, or off any picture")
    field = np.zeros(moved.shape[:2]) if values is None else _in_cells(mesh, values, ())
    known = np.isfinite(field)  # on the axis of rotation u_r / r is 0 / 0
    mean = np.where(known, field, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    field = np.where(known, field, mean[:, None])
    if dim == 2:
        cells = np.arange(mesh.topology.index_map(dim).size_local)[:, None]
        places = np.arange(moved.shape[1])[None]
    else:
        nodes = fem.functionspace(mesh, ("Lagrange", 2))
        mesh.topology.create_connectivity(2, 3)
        own, places = locate_facets_in_cells(nodes, exterior_facet_indices(mesh.topology))
        cells = own[:, None]
    behind = moved.mean(axis=1)[cells[:, 0]]
    each = mesh.comm.allgather((moved[cells, places], field[cells, places], behind))
    return _Faces(*(np.concatenate(parts) for parts in zip(*each, strict=True)))


def _in_cells(mesh: Mesh, expression: Expr, shape: tuple[int, ...]) -> Array:
    """Values (cells, nodes, ...) at the nodes of each cell, ghosts too, as they are from within."""
    cell = mesh.topology.cell_name()
    element = basix.ufl.element("Lagrange", cell, 2, shape=shape, discontinuous=True)
    space = fem.functionspace(mesh, element)
    function = fem.Function(space)
    function.interpolate(fem.Expression(expression, interpolation_points(space)))
    return function.x.array.reshape(-1, *shape)[space.dofmap.list]


def _plane(axes: Axes, faces: _Faces, shown: ScalarMappable, width: float) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.tri import Triangulation

    count = faces.x.shape[1]
    x, first = faces.x.reshape(-1, 2), count * np.arange(len(faces.x))
    triangles = (np.array(SUB_TRIANGLES[count]) + first[:, None, None]).reshape(-1, 3)
    values = faces.values.ravel()
    cells = Triangulation(x[:, 0], x[:, 1], triangles)
    axes.tripcolor(cells, values, shading="gouraud", cmap=shown.cmap, norm=shown.norm)
    rims = faces.x[:, [*_OUTLINES[count], 0]]
    axes.add_collection(LineCollection(list(rims), colors="k", linewidths=width, alpha=0.6))


def _space(
    axes: Axes, faces: _Faces, shown: ScalarMappable, width: float, view: tuple[float, float]
) -> None:
    """Faces that are turned to the eye, the farthest first."""
    from matplotlib.collections import PolyCollection

    corners, rim, shares = _parts(_FACETS[faces.x.shape[1]])
    # unit vectors to the right, upwards and towards the eye
    seen_from = Rotation.from_euler("ZX", [view[1] + 90, 90 - view[0]], degrees=True).as_matrix().T
    x = np.einsum("pn,fnd,ed->fpe", shares, faces.x, seen_from)
    values = np.einsum("pn,fn->fp", shares, faces.values)
    parts = x[:, corners]
    normal = np.cross(parts[:, :, 1] - parts[:, :, 0], parts[:, :, 2] - parts[:, :, 0])
    outwards = parts.mean(axis=2) - (faces.behind @ seen_from.T)[:, None]
    normal *= np.sign(np.sum(normal * outwards, axis=-1, keepdims=True))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = _SHADE + (1 - _SHADE) * np.clip(normal @ _LIGHT, 0, 1)
    colour = shown.to_rgba(values[:, corners].mean(axis=2))
    colour[..., :3] *= light[..., None]

    drawn, fills, lines = [], [], []
    for face in np.argsort(x[..., 2].mean(axis=1)):
        (turned,) = np.nonzero(normal[face, :, 2] > _EDGE_ON)
        if len(turned):
            drawn += [*parts[face, turned, :, :2], x[face, rim, :2]]
            fills += [*colour[face, turned], np.zeros(4)]
            lines += [*colour[face, turned], np.array([0, 0, 0, 0.6 if width else 0])]
    # hair lines of their own colour close the gaps between parts
    widths = np.where(np.array(fills)[:, 3] > 0, 0.3, width)
    axes.add_collection(
        PolyCollection(drawn, facecolors=fills, edgecolors=lines, linewidths=widths)
    )
    axes.set_axis_off()


def _parts(cell: basix.CellType) -> tuple[Indices, Indices, Array]:
    """Triangles (t, 3) that a facet is cut into, its rim, and the nodes' shares in corners."""
    from scipy.spatial import Delaunay

    points = basix.create_lattice(cell, _PARTS, basix.LatticeType.equispaced, exterior=True)
    element = basix.create_element(basix.ElementFamily.P, cell, 2, basix.LagrangeVariant.gll_warped)
    outer = Delaunay(points).convex_hull.ravel()
    on_rim = np.unique(outer)
    around = points[on_rim] - basix.geometry(cell).mean(axis=0)
    rim = on_rim[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]
    return Delaunay(points).simplices, rim, element.tabulate(0, points)[0, :, :, 0]

"""Families of meshes for convergence studies, by name of the element and cell size."""

from collections.abc import Callable

from mpi4py import MPI

import basix.ufl
import gmsh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh, create_mesh

from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from study.model.discretisation import requires_quadrilateral_cells

Array = npt.NDArray[np.float64]

# Radii of the quarter ring and of the eighth of a hollow ball
INNER_RADIUS, OUTER_RADIUS = 1.0, 2.0

# Number of finest meshes to which the line is fitted that gives the order of convergence
_N_FITTED_MESHES = 3

# Gmsh's element type by dimension and order, and the positions of its nodes in Basix's order; Gmsh
# numbers mid-side nodes along the outline, Basix opposite to the vertices
_GMSH_CELL_TYPES = {(2, 1): 2, (2, 2): 9, (3, 1): 4, (3, 2): 11}
_GMSH_NODES_IN_BASIX_ORDER = {
    (2, 1): [0, 1, 2],
    (2, 2): [0, 1, 2, 4, 5, 3],
    (3, 1): [0, 1, 2, 3],
    (3, 2): [0, 1, 2, 3, 8, 9, 5, 7, 6, 4],
}


def on_square(element: str, cell_side: float) -> Mesh:
    """Mesh the unit square with Gmsh triangles, distorted quadrilaterals or pairs of triangles."""
    return (
        mesh_with_gmsh(_add_unit_square_to_gmsh, 2, cell_side)
        if _has_gmsh_triangles(element)
        else move_nodes(_structured_square_mesh(element, cell_side), _distort_inside_of_unit_square)
    )


def on_pairs(_: str, cell_side: float) -> Mesh:
    """Mesh the unit square with pairs of triangles that form quadrilaterals, for any element."""
    return on_square("pw-Q8", cell_side)


def on_ring(_: str, cell_side: float) -> Mesh:
    """Mesh a quarter ring with Gmsh; only sides of cells on the boundary are curved."""
    return mesh_with_gmsh(_add_quarter_ring_to_gmsh, 2, cell_side, order=2)


def on_curved_ring(element: str, cell_side: float) -> Mesh:
    """Mesh a quarter ring with curved cells, by mapping `on_square` to polar coordinates."""
    return curved_mesh(on_square(element, cell_side), _map_unit_square_to_quarter_ring)


def on_cube(_: str, cell_side: float) -> Mesh:
    """Mesh the unit cube with Gmsh tetrahedra."""
    return mesh_with_gmsh(_add_unit_cube_to_gmsh, 3, cell_side)


def on_strip(_: str, cell_side: float) -> Mesh:
    """Mesh an upright strip 1 x 4 with Gmsh triangles."""
    return mesh_with_gmsh(_add_strip_to_gmsh, 2, cell_side)


def on_bar(_: str, cell_side: float) -> Mesh:
    """Mesh an upright bar 1 x 1 x 4 with Gmsh tetrahedra."""
    return mesh_with_gmsh(_add_bar_to_gmsh, 3, cell_side)


def on_hollow_ball(_: str, cell_side: float) -> Mesh:
    """Mesh an eighth of a hollow ball with Gmsh tetrahedra, which are curved on both spheres."""
    return mesh_with_gmsh(_add_eighth_of_hollow_ball_to_gmsh, 3, cell_side, order=2)


def fit_convergence_order(cell_sizes: Array, errors: Array) -> float:
    """Return the order of convergence of errors (n,), sorted from the coarsest to the finest mesh.

    The order is the slope of a line fitted to the logarithms of the cell sizes and errors of the
    finest meshes.
    """
    return float(
        np.polyfit(np.log(cell_sizes[-_N_FITTED_MESHES:]), np.log(errors[-_N_FITTED_MESHES:]), 1)[0]
    )


def mean_cell_size(mesh: Mesh) -> float:
    """Return the mean cell volume to the power 1/dim."""
    one = fem.Constant(mesh, default_scalar_type(1.0))
    volume = fem.assemble_scalar(fem.form(one * ufl.dx(domain=mesh)))
    dimension = mesh.topology.dim
    return float((volume / mesh.topology.index_map(dimension).size_global) ** (1 / dimension))


def _add_unit_square_to_gmsh() -> None:
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)


def _add_quarter_ring_to_gmsh() -> None:
    disks = [
        (2, gmsh.model.occ.addDisk(0, 0, 0, radius, radius))
        for radius in (OUTER_RADIUS, INNER_RADIUS)
    ]
    ring, _ = gmsh.model.occ.cut(disks[:1], disks[1:])
    quadrant = gmsh.model.occ.addRectangle(0, 0, 0, OUTER_RADIUS, OUTER_RADIUS)
    gmsh.model.occ.intersect(ring, [(2, quadrant)])


def _add_unit_cube_to_gmsh() -> None:
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)


def _add_strip_to_gmsh() -> None:
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 4)


def _add_bar_to_gmsh() -> None:
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 4)


def _add_eighth_of_hollow_ball_to_gmsh() -> None:
    balls = [
        (3, gmsh.model.occ.addSphere(0, 0, 0, radius)) for radius in (OUTER_RADIUS, INNER_RADIUS)
    ]
    shell, _ = gmsh.model.occ.cut(balls[:1], balls[1:])
    octant = gmsh.model.occ.addBox(0, 0, 0, OUTER_RADIUS, OUTER_RADIUS, OUTER_RADIUS)
    gmsh.model.occ.intersect(shell, [(3, octant)])


def mesh_with_gmsh(
    add_geometry: Callable[[], None],
    dimension: int,
    cell_size: float,
    order: int = 1,
    size_formula: str | None = None,
) -> Mesh:
    """Mesh a shape reproducibly with Gmsh on one process.

    Args:
        add_geometry: Function that adds the shape to the Gmsh model with OpenCASCADE.
        dimension: Dimension of the shape.
        cell_size: Cell size, or the smallest cell size if a formula is given.
        order: Polynomial order of the cell geometry.
        size_formula: Cell size as a function of x, y, z in Gmsh's notation; None for a uniform
            size.
    """
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for option, value in {
            "General.Terminal": 0,
            "General.NumThreads": 1,  # with several threads, the mesh is not reproducible
            "Mesh.MeshSizeMin": cell_size,
            "Mesh.MeshSizeMax": 1e22 if size_formula else cell_size,
            "Mesh.Algorithm": 5,  # Delaunay
            "Mesh.Algorithm3D": 1,
        }.items():
            gmsh.option.setNumber(option, value)
        add_geometry()
        gmsh.model.occ.synchronize()
        if size_formula:
            field = gmsh.model.mesh.field.add("MathEval")
            gmsh.model.mesh.field.setString(field, "F", size_formula)
            gmsh.model.mesh.field.setAsBackgroundMesh(field)
            gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.model.mesh.generate(dimension)
        gmsh.model.mesh.setOrder(order)
        tags, x, _ = gmsh.model.mesh.getNodes()
        _, nodes = gmsh.model.mesh.getElementsByType(_GMSH_CELL_TYPES[dimension, order])
    finally:
        gmsh.finalize()
    permutation = _GMSH_NODES_IN_BASIX_ORDER[dimension, order]
    used_tags, cells = np.unique(
        nodes.reshape(-1, len(permutation))[:, permutation], return_inverse=True
    )
    by_tag = np.argsort(tags)
    rows = by_tag[np.searchsorted(tags[by_tag], used_tags)]
    cell = {2: "triangle", 3: "tetrahedron"}[dimension]
    return create_mesh(
        MPI.COMM_SELF,
        cells=cells.reshape(-1, len(permutation)).astype(np.int64),
        x=np.ascontiguousarray(x.reshape(-1, 3)[rows, :dimension]),
        e=basix.ufl.element("Lagrange", cell, order, shape=(dimension,)),
    )


def _has_gmsh_triangles(element: str) -> bool:
    return element.endswith("T6")


def _structured_square_mesh(element: str, cell_side: float) -> Mesh:
    divisions = (round(1 / cell_side),) * 2
    build = quadrilaterals if requires_quadrilateral_cells(element) else triangles
    return build(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), divisions)


def _distort_inside_of_unit_square(x: Array) -> Array:
    """Map points (n, 3) of the unit square smoothly; its boundary stays fixed."""
    mapped = x.copy()
    bubble = np.sin(np.pi * x[:, 0]) * np.sin(np.pi * x[:, 1])
    mapped[:, 0] += 0.1 * bubble * np.cos(2 * x[:, 1])
    mapped[:, 1] += 0.1 * bubble * np.cos(2 * x[:, 0] + 1)
    return mapped


def _map_unit_square_to_quarter_ring(x: Array) -> Array:
    """Map points (n, 3) of the unit square to the quarter ring."""
    radius, angle = INNER_RADIUS + (OUTER_RADIUS - INNER_RADIUS) * x[:, 0], np.pi / 2 * x[:, 1]
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), x[:, 2]])

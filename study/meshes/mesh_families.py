"""Families of meshes for a study of convergence: an element's name and a length of sides."""

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
from study.model.discretisation import is_quadrilateral

Array = npt.NDArray[np.float64]

# Radii of the quarter ring and of the eighth of a hollow ball
INNER, OUTER = 1.0, 2.0

# Meshes, the finest ones, through whose errors the straight line of logarithms goes
_FITTED = 3

# By dimension and order: Gmsh's element type, and its nodes in Basix's order, for Gmsh lists
# mid-side nodes along the outline, Basix opposite to the vertices
_TYPES = {(2, 1): 2, (2, 2): 9, (3, 1): 4, (3, 2): 11}
_NODES = {
    (2, 1): [0, 1, 2],
    (2, 2): [0, 1, 2, 4, 5, 3],
    (3, 1): [0, 1, 2, 3],
    (3, 2): [0, 1, 2, 3, 8, 9, 5, 7, 6, 4],
}


def on_square(element: str, side: float) -> Mesh:
    """Unit square with straight sides: triangles by Gmsh, quadrilaterals and pairs moved."""
    return (
        meshed(_square, 2, side)
        if _is_triangle(element)
        else move_nodes(_squares(element, side), _moved)
    )


def on_pairs(_: str, side: float) -> Mesh:
    """The unit square of 6-node triangles in the pairs that make quadrilaterals."""
    return on_square("pw-Q8", side)


def on_ring(_: str, side: float) -> Mesh:
    """Quarter ring whose elements inside have straight sides, by Gmsh."""
    return meshed(_quarter_ring, 2, side, order=2)


def on_curved_ring(element: str, side: float) -> Mesh:
    """Quarter ring, all sides of all elements curved: `on_square` in polar coordinates."""
    return curved_mesh(on_square(element, side), _polar)


def on_cube(_: str, side: float) -> Mesh:
    """Unit cube of tetrahedra by Gmsh."""
    return meshed(_cube, 3, side)


def on_strip(_: str, side: float) -> Mesh:
    """Strip 1 x 4, upright, of triangles by Gmsh."""
    return meshed(_strip, 2, side)


def on_bar(_: str, side: float) -> Mesh:
    """Bar 1 x 1 x 4, upright, of tetrahedra by Gmsh."""
    return meshed(_bar, 3, side)


def on_hollow_ball(_: str, side: float) -> Mesh:
    """Eighth of a hollow ball of tetrahedra by Gmsh, curved on both spheres."""
    return meshed(_hollow_ball, 3, side, order=2)


def order(h: Array, error: Array) -> float:
    """Order of convergence: slope of the straight line through the logarithms of both (n,)."""
    return float(np.polyfit(np.log(h[-_FITTED:]), np.log(error[-_FITTED:]), 1)[0])


def cell_size(mesh: Mesh) -> float:
    """Side that the mesh's cells would have if they were equal squares or cubes."""
    one = fem.Constant(mesh, default_scalar_type(1.0))
    volume = fem.assemble_scalar(fem.form(one * ufl.dx(domain=mesh)))
    dimension = mesh.topology.dim
    return float((volume / mesh.topology.index_map(dimension).size_global) ** (1 / dimension))


def _square() -> None:
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)


def _quarter_ring() -> None:
    disks = [(2, gmsh.model.occ.addDisk(0, 0, 0, radius, radius)) for radius in (OUTER, INNER)]
    ring, _ = gmsh.model.occ.cut(disks[:1], disks[1:])
    quadrant = gmsh.model.occ.addRectangle(0, 0, 0, OUTER, OUTER)
    gmsh.model.occ.intersect(ring, [(2, quadrant)])


def _cube() -> None:
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)


def _strip() -> None:
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 4)


def _bar() -> None:
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 4)


def _hollow_ball() -> None:
    balls = [(3, gmsh.model.occ.addSphere(0, 0, 0, radius)) for radius in (OUTER, INNER)]
    shell, _ = gmsh.model.occ.cut(balls[:1], balls[1:])
    octant = gmsh.model.occ.addBox(0, 0, 0, OUTER, OUTER, OUTER)
    gmsh.model.occ.intersect(shell, [(3, octant)])


def meshed(
    build: Callable[[], None],
    dimension: int,
    size: float,
    order: int = 1,
    growth: str | None = None,
) -> Mesh:
    """A shape's mesh by Gmsh, the same each time.

    Args:
        build: makes the shape by OpenCASCADE.
        dimension: of it.
        size: of cells; of the smallest ones if they grow.
        order: of cells.
        growth: formula of the size at x, y, z, in Gmsh's words.
    """
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for option, value in {
            "General.Terminal": 0,
            "General.NumThreads": 1,  # the same mesh each time
            "Mesh.MeshSizeMin": size,
            "Mesh.MeshSizeMax": 1e22 if growth else size,
            "Mesh.Algorithm": 5,  # Delaunay
            "Mesh.Algorithm3D": 1,
        }.items():
            gmsh.option.setNumber(option, value)
        build()
        gmsh.model.occ.synchronize()
        if growth:
            field = gmsh.model.mesh.field.add("MathEval")
            gmsh.model.mesh.field.setString(field, "F", growth)
            gmsh.model.mesh.field.setAsBackgroundMesh(field)
            gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.model.mesh.generate(dimension)
        gmsh.model.mesh.setOrder(order)
        tags, x, _ = gmsh.model.mesh.getNodes()
        _, nodes = gmsh.model.mesh.getElementsByType(_TYPES[dimension, order])
    finally:
        gmsh.finalize()
    permutation = _NODES[dimension, order]
    used, cells = np.unique(
        nodes.reshape(-1, len(permutation))[:, permutation], return_inverse=True
    )
    by_tag = np.argsort(tags)
    place = by_tag[np.searchsorted(tags[by_tag], used)]
    cell = {2: "triangle", 3: "tetrahedron"}[dimension]
    return create_mesh(
        MPI.COMM_SELF,
        cells=cells.reshape(-1, len(permutation)).astype(np.int64),
        x=np.ascontiguousarray(x.reshape(-1, 3)[place, :dimension]),
        e=basix.ufl.element("Lagrange", cell, order, shape=(dimension,)),
    )


def _is_triangle(element: str) -> bool:
    return element.endswith("T6")


def _squares(element: str, side: float) -> Mesh:
    divisions = (round(1 / side),) * 2
    build = quadrilaterals if is_quadrilateral(element) else triangles
    return build(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), divisions)


def _moved(x: Array) -> Array:
    """Smooth map (n, 3) of the unit square to itself, no two cells alike."""
    moved = x.copy()
    bubble = np.sin(np.pi * x[:, 0]) * np.sin(np.pi * x[:, 1])
    moved[:, 0] += 0.1 * bubble * np.cos(2 * x[:, 1])
    moved[:, 1] += 0.1 * bubble * np.cos(2 * x[:, 0] + 1)
    return moved


def _polar(x: Array) -> Array:
    """Map (n, 3) of the unit square to the quarter ring."""
    radius, angle = INNER + (OUTER - INNER) * x[:, 0], np.pi / 2 * x[:, 1]
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), x[:, 2]])

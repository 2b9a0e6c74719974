"""Meshes of bodies that are fitted into each other: tubes, and a dovetail in its slot."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, create_mesh, locate_entities_boundary
from scipy.spatial import cKDTree

from pw_elements._compat import cell_geometry_nodes
from pw_elements.meshes import TaggedMesh, curved_mesh, from_file
from study.meshes.solid_meshes import mesh_box_along_lines
from study.meshes.two_body_meshes import join_lower_and_upper_mesh

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
TubeLines = tuple[Array, Array, Array]
"""Mesh lines of a tube: radii, angles, and coordinates along the axis."""

DOVETAIL_FACES = ("BLADE_FLANK", "SLOT_FLANK", "BLADE_TOP", "SLOT_BASE")


def bend_shaft_nose(x: Array, nose: tuple[float, float, float], columns: tuple[int, int]) -> Array:
    """Return points (n, dim) of a shaft whose end is made conical; smooth where the cone begins.

    Args:
        x: Points (n, dim) of the straight shaft.
        nose: Coordinate along the axis where the cone begins, its end, and the decrease of the
            radius there. The outline is a parabola.
        columns: Columns of the radius and of the coordinate along the axis.
    """
    start, end, decrease = nose
    radius, axial = columns
    moved = x.copy()
    share = np.clip((x[:, axial] - start) / (end - start), 0.0, 1.0)
    moved[:, radius] -= decrease * share**2
    return moved


def merge_coinciding_nodes(mesh: Mesh) -> Mesh:
    """Return the mesh with one node wherever nodes are less than 1e-9 apart."""
    x = mesh.geometry.x
    pairs = cKDTree(x).query_pairs(1e-9, output_type="ndarray")
    node = np.arange(len(x))
    node[pairs.max(axis=1)] = pairs.min(axis=1)
    kept, number = np.unique(node, return_inverse=True)
    order = np.argsort(mesh.topology.original_cell_index)
    cells = number[cell_geometry_nodes(mesh)[order]].astype(np.int64)
    return create_mesh(
        mesh.comm, cells=cells, x=x[kept], e=mesh.ufl_domain().ufl_coordinate_element()
    )


def mesh_tubes(
    inner: TubeLines, outer: TubeLines, nose: tuple[float, float, float] | None = None
) -> tuple[Mesh, tuple[Indices, Indices]]:
    """Mesh sectors of two tubes, or tubes, about z by quadratic tetrahedra with curved sides.

    Args:
        inner: Mesh lines of the inner tube. Angles from 0 to 2 pi mesh the whole tube.
        outer: Mesh lines of the outer tube.
        nose: Arguments of `bend_shaft_nose` for the inner tube; None for a straight one.

    Returns:
        Mesh, and the facets of the bore of the outer tube and of the outside of the inner tube.
    """

    def bend_to_tube(x: Array, is_inner: bool) -> Array:
        if is_inner and nose is not None:
            x = bend_shaft_nose(x, nose, (0, 2))
        return np.column_stack([x[:, 0] * np.cos(x[:, 1]), x[:, 0] * np.sin(x[:, 1]), x[:, 2]])

    tubes = [
        merge_coinciding_nodes(
            curved_mesh(
                mesh_box_along_lines("tetrahedron", *lines),
                partial(bend_to_tube, is_inner=is_inner),
            )
        )
        for lines, is_inner in ((inner, True), (outer, False))
    ]
    mesh, is_inner_cell = join_lower_and_upper_mesh(*tubes)

    def is_on_bore(x: Array) -> Mask:
        return np.asarray(np.isclose(np.hypot(x[0], x[1]), outer[0][0]))

    def is_on_shaft(x: Array) -> Mask:
        radius = np.full(x.shape[1], inner[0][-1])
        if nose is not None:
            outline = np.column_stack([radius, x[2]])
            radius = bend_shaft_nose(outline, nose, (0, 1))[:, 0]
        return np.asarray(np.isclose(np.hypot(x[0], x[1]), radius))

    mesh.topology.create_connectivity(2, 3)
    cells_of_facets = mesh.topology.connectivity(2, 3)

    def find_facets(is_on_side: Callable[[Array], Mask], is_of_inner: bool) -> Indices:
        facets = locate_entities_boundary(mesh, 2, is_on_side).astype(np.int64)
        cells = np.array([cells_of_facets.links(facet)[0] for facet in facets])
        return facets[is_inner_cell[cells] == is_of_inner]

    bore, shaft = find_facets(is_on_bore, False), find_facets(is_on_shaft, True)
    return mesh, (bore, shaft)


def write_dovetail(path: Path, sizes: tuple[float, float]) -> None:
    """Write an assembly of half a blade's dovetail root in its slot as an Abaqus file, by Gmsh.

    The symmetry plane is x = 0, and the dovetail can slide along y. The flanks that touch are
    inclined by 45°. Parts and faces are sets: BLADE, SLOT, BLADE_FLANK, SLOT_FLANK, BLADE_TOP and
    SLOT_BASE.

    Args:
        path: Path of the file.
        sizes: Cell sizes of blade and slot.
    """
    # outlines in the plane (x, z)
    blade = [(0, 0), (1.0, 0), (1.0, 0.4), (0.5, 0.9), (0.5, 1.6), (0, 1.6)]
    slot = [(1.15, -0.1), (2.0, -0.1), (2.0, 1.2), (0.55, 1.2), (0.55, 0.85), (1.15, 0.25)]
    depths = (0.0, 0.8), (-0.6, 2.0)  # along y
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for option, value in {
            "General.Terminal": 0,
            "General.NumThreads": 1,
            "Mesh.Algorithm": 5,
            "Mesh.Algorithm3D": 1,
            "Mesh.SaveGroupsOfNodes": 0,
        }.items():
            gmsh.option.setNumber(option, value)
        occ = gmsh.model.occ
        solids = []
        for outline, (start, end) in zip((blade, slot), depths, strict=True):
            points = [occ.addPoint(px, start, pz) for px, pz in outline]
            ends = zip(points, [*points[1:], points[0]], strict=True)
            lines = [occ.addLine(*pair) for pair in ends]
            face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
            solids += [tag for dim, tag in occ.extrude([(2, face)], 0, end - start, 0) if dim == 3]
        occ.synchronize()
        for name, solid, size in zip(("BLADE", "SLOT"), solids, sizes, strict=True):
            gmsh.model.addPhysicalGroup(3, [solid], name=name)
            points = gmsh.model.getBoundary([(3, solid)], recursive=True)
            gmsh.model.mesh.setSize(points, size)

        def find_face(solid: int, middle: tuple[float, float]) -> list[int]:
            return [
                tag
                for dim, tag in gmsh.model.getBoundary([(3, solid)], oriented=False)
                if np.allclose(np.array(occ.getCenterOfMass(dim, tag))[[0, 2]], middle, atol=1e-6)
            ]

        for name, solid, middle in zip(
            DOVETAIL_FACES,
            (solids[0], solids[1], solids[0], solids[1]),
            ((0.75, 0.65), (0.85, 0.55), (0.25, 1.6), (2.0, 0.55)),
            strict=True,
        ):
            gmsh.model.addPhysicalGroup(2, find_face(solid, middle), name=name)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def read_dovetail(path: Path) -> tuple[TaggedMesh, tuple[Indices, Indices]]:
    """Read the assembly; return it, and the facets of the blade's flank and of the slot's."""
    part = from_file(path, MPI.COMM_SELF)
    blade, slot = (part.facets(name).astype(np.int64) for name in DOVETAIL_FACES[:2])
    return part, (blade, slot)

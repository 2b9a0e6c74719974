"""Create structured meshes of rectangles, move nodes, and read mesh files of Gmsh and Abaqus."""

from pw_elements.meshes.files import from_file, from_gmsh
from pw_elements.meshes.shapes import (
    DIAGONAL_PATTERNS,
    DiagonalPattern,
    curved_mesh,
    move_nodes,
    quadrilaterals,
    triangles,
)
from pw_elements.meshes.tagged import TaggedMesh

__all__ = ["curved_mesh", "from_file", "from_gmsh", "move_nodes", "quadrilaterals", "triangles"]

"""Structured rectangles, their smooth images, and meshes of Gmsh and Abaqus with their sets."""

from pw_elements.meshes.files import from_file, from_gmsh
from pw_elements.meshes.shapes import (
    PATTERNS,
    Pattern,
    curved,
    mapped,
    quadrilaterals,
    triangles,
)
from pw_elements.meshes.tagged import TaggedMesh

__all__ = ["curved", "from_file", "from_gmsh", "mapped", "quadrilaterals", "triangles"]

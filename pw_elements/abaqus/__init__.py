"""Reader for meshes and sets in Abaqus input files, a format that CalculiX and Gmsh also use.

The module `lines` reads text and numbers, `deck` collects tables of nodes, elements and sets,
`types` lists the element types, and `mesh` creates arrays of cells and tagged facets.
"""

from pw_elements.abaqus.lines import to_upper_ascii
from pw_elements.abaqus.mesh import (
    AbaqusMeshArrays,
    abaqus_nodes_and_facets_in_dolfinx_order,
    read_abaqus_mesh,
)
from pw_elements.abaqus.types import ABAQUS_EDGE_CORNERS

__all__ = [
    "ABAQUS_EDGE_CORNERS",
    "AbaqusMeshArrays",
    "abaqus_nodes_and_facets_in_dolfinx_order",
    "read_abaqus_mesh",
    "to_upper_ascii",
]

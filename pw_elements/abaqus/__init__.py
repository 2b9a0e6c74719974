"""Reader of meshes and sets in Abaqus' input files, which CalculiX and Gmsh write, too.

`lines` reads text and numbers, `deck` collects tables of nodes, elements and sets, `types` lists
the element types, and `mesh` makes arrays of cells and tagged facets.
"""

from pw_elements.abaqus.lines import to_upper_ascii
from pw_elements.abaqus.mesh import DeckMesh, read_deck

__all__ = ["DeckMesh", "read_deck", "to_upper_ascii"]

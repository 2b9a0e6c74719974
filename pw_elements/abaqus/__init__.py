"""Meshes and sets of Abaqus' input files, which CalculiX and Gmsh write, too.

`lines` reads text, `deck` makes tables of it, `types` knows the elements, `mesh` makes arrays of
cells and tagged facets.
"""

from pw_elements.abaqus.lines import capitals
from pw_elements.abaqus.mesh import DeckMesh, read_deck

__all__ = ["DeckMesh", "capitals", "read_deck"]

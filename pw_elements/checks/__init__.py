"""Checks of what a user gives, on all processes at once: asked at the faces, never in a loop."""

from pw_elements.checks.arguments import sizes_of
from pw_elements.checks.guard import answer, collective, processes, same_everywhere
from pw_elements.checks.meshes import DegenerateMesh, check_cells, check_mesh, listed, pieces_of

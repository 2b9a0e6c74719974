"""Checks of what a user gives, on all processes at once: asked at the faces, never in a loop."""

from pw_elements.checks.arguments import sizes_of
from pw_elements.checks.guard import (
    ROUND_OFF,
    answer,
    collective,
    compare_function,
    compare_numbers,
    processes,
    refused_together,
    relative_difference,
    same_everywhere,
    spread_rows,
)
from pw_elements.checks.meshes import (
    MAX_COORDINATE,
    DegenerateMesh,
    check_cells,
    check_mesh,
    listed,
    pieces_of,
)

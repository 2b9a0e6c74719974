"""Checks of users' arguments, functions and meshes, with errors on all processes together.

Public functions make these checks once, before any computation.
"""

from pw_elements.checks.arguments import vector_sizes
from pw_elements.checks.guard import (
    RANK_DIFFERENCE_TOLERANCE,
    call_user_function,
    check_same_arguments,
    check_same_function,
    check_same_values,
    collective_errors,
    defer_errors_if_parallel,
    evenly_spaced_rows,
    find_communicator,
    relative_difference,
)
from pw_elements.checks.meshes import (
    MAX_COORDINATE,
    DegenerateMesh,
    check_cells,
    check_mesh,
    connected_components,
    format_points,
)

"""Checks of users' arguments, functions and meshes; errors are raised on all processes.

Public functions make these checks once, before any computation. `JoinedSpace`, the space of bodies
with a mesh each, is here because checks of spaces and meshes have to know it.
"""

from pw_elements.checks.arguments import count_local_and_global_dofs
from pw_elements.checks.compiler import find_compiler_problem
from pw_elements.checks.guard import (
    MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS,
    call_user_function,
    check_same_arguments_on_all_processes,
    check_same_function,
    check_same_values,
    defer_errors_if_parallel,
    evenly_spaced_rows,
    find_largest_communicator,
    max_relative_difference,
    raise_errors_on_all_processes,
)
from pw_elements.checks.joined import (
    JoinedFunction,
    JoinedSpace,
    evaluate_at_owned_nodes,
    list_bodies,
)
from pw_elements.checks.meshes import (
    MAX_COORDINATE,
    DegenerateMesh,
    check_cell_shapes_and_facets,
    check_mesh,
    format_points,
    label_components_of_space,
)

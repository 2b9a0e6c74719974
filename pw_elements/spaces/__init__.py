"""Finite elements, function spaces, selected parts of bodies, quadrature and assembly."""

from pw_elements.spaces.assembly import (
    STRESS_STATE_KEY,
    AssemblyRecord,
    add_estimated_degrees,
    add_sub_cell_rules,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    cell_measure,
    compile_form,
    read_record,
)
from pw_elements.spaces.elements import macro_element, quadratic_element
from pw_elements.spaces.hybrid import (
    PRESSURE_MODE_TOLERANCE,
    SubSpace,
    equilibration_scale,
    has_split_pressure,
    is_hybrid,
    list_fields,
    tie_pressures,
)
from pw_elements.spaces.parts import (
    Marker,
    Part,
    evaluate_marker,
    local_numbers,
    locate_exterior_facets,
    locate_nodes,
    piecewise_constants_by_tag,
    require_nodes,
)
from pw_elements.spaces.spaces import (
    Spaces,
    as_function,
    check_part_tags,
    gather_from_owners,
    scalar_space,
    split,
    test_space,
)

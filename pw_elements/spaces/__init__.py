"""Finite elements, function spaces, selected parts of bodies, quadrature and assembly."""

from pw_elements.spaces.assembly import (
    STRESS_STATE_METADATA_KEY,
    AssemblyRecord,
    add_estimated_quadrature_degrees,
    add_sub_cell_quadrature_rules,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    cell_measure,
    collect_stress_states,
    compile_form,
    history_space,
    read_record,
)
from pw_elements.spaces.elements import piecewise_linear_sub_cell_element, quadratic_element
from pw_elements.spaces.hybrid import (
    CONSTANT_PRESSURE_ROUND_OFF_OVER_STIFFNESS,
    SubSpace,
    has_discontinuous_pressure,
    is_hybrid,
    list_fields,
    pressure_continuity_matrix,
    pressure_equilibration_scales,
)
from pw_elements.spaces.parts import (
    EntitySelection,
    Marker,
    evaluate_marker,
    locate_exterior_facets,
    locate_exterior_facets_of_bodies,
    locate_nodes,
    piecewise_constants_by_tag,
    require_nodes,
    selected_local_numbers,
    separate_mesh,
)
from pw_elements.spaces.spaces import (
    Spaces,
    as_function,
    check_part_tags_type,
    gather_nodal_values,
    scalar_component_space,
    split,
    test_space,
)
from pw_elements.spaces.sub_cells import compile_tangent

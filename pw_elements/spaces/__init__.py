"""Elements, spaces, parts of bodies, quadrature and assembly."""

from pw_elements.spaces.assembly import (
    STATE,
    Assembled,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    cell_measure,
    compiled_form,
    with_cell_rules,
    with_degrees,
)
from pw_elements.spaces.elements import macro_element, quadratic_element
from pw_elements.spaces.hybrid import (
    NOTHING,
    SubSpace,
    equilibration,
    fields_of,
    is_hybrid,
    is_split,
    tied,
)
from pw_elements.spaces.parts import (
    Marker,
    Part,
    by_cell_tag,
    exterior_facets,
    marked,
    nodes_of,
    numbered,
    some_nodes_of,
)
from pw_elements.spaces.spaces import (
    Spaces,
    as_function,
    check_parts,
    of_owners,
    scalar_space,
    split,
    test_space,
)

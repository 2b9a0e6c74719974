"""Contact points, and the operators that couple their motions and forces to the unknowns."""

from pw_elements.contact.interface.build import (
    build_interface,
    build_interface_with_other_friction,
)
from pw_elements.contact.interface.law_fields import make_distributed_matrix
from pw_elements.contact.interface.law_points import (
    describe_weight_functions,
    make_interface_laws,
)
from pw_elements.contact.interface.mortars import (
    N_SLIP_PATH_PIECES,
    BoundaryFacets,
    MortarMatrices,
    MortarSlipReference,
    OverlapQuadrature,
    PlaneSlidingMortar,
    SlidingMortar,
    SpaceSlidingMortar,
    compute_cell_lengths_or_areas,
    compute_facet_nodes_positions_and_facet_normals,
    compute_tributary_areas,
    gather_boundary_facets,
    integrate_outward_normals,
    measure_gap_and_slip,
    rotate_with_normal,
)
from pw_elements.contact.interface.operators import (
    MIN_COSINE_OF_OUTWARD_PUSHING_SURFACE_NORMAL,
    RELATIVE_COORDINATE_ROUND_OFF,
    ContactInterface,
    InvalidContactNodes,
)
from pw_elements.contact.interface.pair_points import (
    FACED_INDEX_OF_DEFORMABLE_SURFACE,
    FACED_INDEX_OF_RIGID_SURFACE,
    average_midpoints_of_adjacent_cells,
    check_piecewise_linear_weight_functions,
    compute_bounding_box_extents,
    find_reduced_column_of_each_unknown,
    make_sliding_mortar,
)
from pw_elements.contact.interface.probes import (
    check_user_surface_derivatives,
    sample_friction_coefficients,
    sample_interference,
    sample_surface_around_pair,
)
from pw_elements.contact.interface.shared_nodes import MIN_DEGREES_BETWEEN_NORMALS, SharedNodes

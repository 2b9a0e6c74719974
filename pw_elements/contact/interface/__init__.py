"""Contact points, and the operators that couple their motions and forces to the unknowns."""

from pw_elements.contact.interface.build import build_interface
from pw_elements.contact.interface.facing import (
    MortarMatrices,
    measure_gap_and_slip,
)
from pw_elements.contact.interface.mortar import (
    Overlap,
    Trace,
    compute_flat_facets,
    compute_tributary_areas,
    gather_trace,
)
from pw_elements.contact.interface.operators import (
    COORDINATE_ROUND_OFF,
    MIN_OUTWARD_COSINE,
    Interface,
    InvalidContactNodes,
)
from pw_elements.contact.interface.overlap import compute_cell_sizes
from pw_elements.contact.interface.pair_points import (
    DEFORMABLE,
    RIGID,
    average_cell_midpoints,
    check_piecewise_linear_weights,
    compute_extents,
    find_reduced_columns,
)
from pw_elements.contact.interface.probes import (
    check_closest_points,
    probe_friction,
    probe_interference,
    probe_surface,
)
from pw_elements.contact.interface.sliding import N_PATH_PIECES, SlidingMortar, SlidingReference

"""Contact points, and the operators between them and the unknowns."""

from pw_elements.contact.interface.build import (
    average_cell_midpoints,
    build_interface,
    check_piecewise_linear_weights,
    find_reduced_columns,
)
from pw_elements.contact.interface.facing import (
    MortarMatrices,
    measure_gap_and_slip,
)
from pw_elements.contact.interface.mortar import (
    Overlap,
    Trace,
    compute_cell_sizes,
    compute_flat_facets,
    compute_tributary_areas,
    gather_trace,
)
from pw_elements.contact.interface.operators import (
    DEFORMABLE,
    OUTWARDS,
    RIGID,
    ROUND_OFF,
    Interface,
    NoContactStated,
    extents,
)
from pw_elements.contact.interface.probes import (
    probe_friction,
    probe_interference,
    probe_surface,
)
from pw_elements.contact.interface.sliding import N_PATH_PIECES, SlidingMortar, SlidingReference

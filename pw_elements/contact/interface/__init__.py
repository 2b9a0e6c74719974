"""Contact points, and the operators between them and the unknowns."""

from pw_elements.contact.interface.build import (
    check_weights,
    free_columns,
    midpoints_around,
    nodal_interface,
)
from pw_elements.contact.interface.facing import (
    FacedParts,
    measure_gap_and_slip,
)
from pw_elements.contact.interface.mortar import (
    Overlap,
    Trace,
    compute_cell_sizes,
    flat_facets,
    gathered_trace,
    whole_areas,
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
from pw_elements.contact.interface.sliding import PATH_PIECES, SlidingMortar, SlidingReference

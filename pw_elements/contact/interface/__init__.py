"""Contact points, and the operators between them and the unknowns."""

from pw_elements.contact.interface.build import nodal_interface
from pw_elements.contact.interface.geometry import Trace, gathered_trace, sizes
from pw_elements.contact.interface.mortar import Overlap, check_weights, whole_areas
from pw_elements.contact.interface.nodes import free_columns, midpoints_around
from pw_elements.contact.interface.operators import (
    DEFORMABLE,
    RIGID,
    ROUND_OFF,
    Interface,
    NoContactStated,
)

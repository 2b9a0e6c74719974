"""The semismooth Newton iteration: law, kinematics, linear systems, active sets."""

from pw_elements.contact.iteration.finite import (
    CellGuard,
    DeformedKinematics,
    FiniteEquilibrium,
    Sliding,
    Tools,
)
from pw_elements.contact.iteration.law import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    TOLERANCE,
    ActiveSet,
    Contact,
    LinearisedLaw,
    Place,
    equations,
    mixed,
    sticking,
)
from pw_elements.contact.iteration.newton import (
    Increment,
    Iterate,
    LinearEquilibrium,
    Reference,
    contact_state,
    newton,
    pair_states,
    reference_sizes,
    undeformed,
)
from pw_elements.contact.iteration.policy import Policy, initial_active_set, resumed, same
from pw_elements.contact.iteration.system import ContactSystem, Tangent, border_columns, local_rows

"""Newton's method for one increment: equilibrium, equations, active sets and the final state."""

from pw_elements.contact.iteration.finite import CellGuard, FiniteEquilibrium, SlidingEquilibrium
from pw_elements.contact.iteration.increment import (
    DISPLACEMENT_ROUND_OFF,
    Increment,
    LinearEquilibrium,
    LinearIncrement,
    NewtonState,
)
from pw_elements.contact.iteration.newton import solve_increment
from pw_elements.contact.iteration.results import (
    make_contact_state,
    make_pair_states,
    make_undeformed_state,
)
from pw_elements.contact.iteration.target import (
    IncrementTarget,
    interpolate_targets,
    make_balanced_target,
)
from pw_elements.contact.iteration.updates import (
    ActiveSetUpdate,
    CycleKeepingSetUpdate,
    DeformedSetUpdate,
    choose_first_set,
    report_no_free_motions,
    resume_active_set,
)

"""Newton's method for one increment: equilibrium, equations, active sets and the final state."""

from pw_elements.contact.iteration.finite import (
    CellInversionCheck,
    LargeStrainEquilibrium,
    SlidingBodiesEquilibrium,
)
from pw_elements.contact.iteration.increment import (
    RELATIVE_DISPLACEMENT_ROUND_OFF,
    IncrementEquations,
    LinearEquilibrium,
    LinearIncrementEquations,
)
from pw_elements.contact.iteration.increment_data import (
    NewtonIterate,
    TargetLoadsAndMotions,
    interpolate_targets,
    make_target_in_equilibrium_with_state,
)
from pw_elements.contact.iteration.line_search import LineSearchIncrementEquations
from pw_elements.contact.iteration.newton import solve_increment
from pw_elements.contact.iteration.results import (
    check_determinant_sign_if_laws_soften,
    check_interface_laws_at_solution,
    make_contact_state,
    make_pair_states,
    make_undeformed_state,
)
from pw_elements.contact.iteration.updates import (
    ActiveSetUpdate,
    LargeStrainActiveSetUpdate,
    UpdateKeepingCyclingSetsUntilSolved,
    choose_first_active_set,
    close_nearest_nodes_of_free_surfaces,
    open_points_with_dependent_normals,
    raise_if_force_shares_are_not_unique,
    recover_active_set_of_state,
    report_no_free_motions,
)

"""Alternative methods after a failed iteration, proofs and checks of what has no solution."""

from pw_elements.contact.rescue.passing import (
    interpolate_placements_and_path,
    raise_if_slave_nodes_pass_through_master,
    raise_if_supports_meet_or_pass,
    raise_if_tools_reach_or_pass_supports,
)
from pw_elements.contact.rescue.placing import (
    PiecesMovingWithSupports,
    does_rigid_motion_end_all_contact,
)
from pw_elements.contact.rescue.refusals import (
    prove_no_equilibrium,
    raise_if_body_is_loose,
    rescue_increment,
)
from pw_elements.contact.rescue.rigid import RigidMotions
from pw_elements.contact.rescue.smallness import (
    SmallDisplacementAndSurfacePassingCheck,
    measure_max_strain_and_rotation,
    prepare_gradients_at_vertices,
    warn_if_no_longer_small,
    warn_if_slip_and_path_slip_differ,
)
from pw_elements.contact.rescue.springs import solve_with_softening_springs
from pw_elements.contact.rescue.substeps import (
    combine_substeps_with_summed_slip,
    count_equal_nearly_straight_segments,
    round_up_to_power_of_two,
    solve_in_substeps,
)
from pw_elements.contact.rescue.support_path import (
    BodySupports,
    LoadFractionSetter,
    find_rigidly_moved_contact_free_start,
)

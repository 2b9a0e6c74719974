"""Other methods of solution after a failed iteration, and proofs that there is no solution."""

from pw_elements.contact.rescue.passing import (
    refuse_passed_nodes,
    refuse_supports_through_each_other,
    refuse_tools_through_supports,
    sample_placements,
)
from pw_elements.contact.rescue.placing import SupportedPieces, ends_all_contact
from pw_elements.contact.rescue.refusals import (
    prove_no_equilibrium,
    refuse_loose_body,
    rescue_increment,
    solve_with_springs,
)
from pw_elements.contact.rescue.rigid import RigidMotions
from pw_elements.contact.rescue.substeps import (
    combine_substeps,
    count_straight_segments,
    round_up_to_power_of_two,
    solve_in_substeps,
)
from pw_elements.contact.rescue.support_path import (
    BodySupports,
    LoadFunction,
    find_contact_free_start,
)

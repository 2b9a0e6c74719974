"""What is tried after the iteration has failed, and proofs and refusals where no state exists."""

from pw_elements.contact.rescue.passing import (
    find_passed,
    refuse_supports_through_each_other,
    refuse_tools_through_supports,
    sample_ways,
)
from pw_elements.contact.rescue.placing import SupportedPieces, ends_clear
from pw_elements.contact.rescue.refusals import (
    check_loose,
    prove_no_equilibrium,
    rescue,
    solve_with_springs,
)
from pw_elements.contact.rescue.rigid import RigidMotions
from pw_elements.contact.rescue.substeps import combine_substeps, solve_in_substeps

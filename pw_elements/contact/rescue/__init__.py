"""What is tried after the iteration has failed, and proofs and refusals where no state exists."""

from pw_elements.contact.rescue.passing import (
    find_passed,
    refuse_supports_through_each_other,
    refuse_tools_through_supports,
)
from pw_elements.contact.rescue.placing import SupportedPieces, ends_clear
from pw_elements.contact.rescue.refusals import (
    by_springs,
    check_loose,
    no_equilibrium,
    rescue,
)
from pw_elements.contact.rescue.rigid import RigidMotions

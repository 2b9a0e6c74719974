"""What is tried after the iteration has failed, and proofs that no state exists."""

from pw_elements.contact.rescue.refusals import (
    by_springs,
    check_loose,
    no_equilibrium,
    rescue,
)
from pw_elements.contact.rescue.rigid import RigidMotions

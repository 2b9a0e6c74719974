"""What is tried after the iteration has failed, and proofs that no state exists."""

from pw_elements.contact.rescue.condensed import REMEDIES, Condensation, Remedy, otherwise
from pw_elements.contact.rescue.refusals import no_equilibrium, refusal
from pw_elements.contact.rescue.rigid import RigidMotions
from pw_elements.contact.rescue.statuses import search

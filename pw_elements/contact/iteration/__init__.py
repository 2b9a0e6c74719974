"""The semismooth Newton iteration: law, kinematics, linear systems, active sets."""

from pw_elements.contact.iteration.kinematics import Kinematics
from pw_elements.contact.iteration.law import OPEN, SLIP, STICK, ActiveSet, Contact, equations
from pw_elements.contact.iteration.newton import TOLERANCE, Increment, Iterate, Reference, newton
from pw_elements.contact.iteration.policy import Policy, first_active_set, first_unknowns
from pw_elements.contact.iteration.results import contact_state, undeformed
from pw_elements.contact.iteration.system import ContactSystem

"""Increments, impact, and the watch over them."""

from pw_elements.contact.steps.impact import Energies, ImpactHistory, PairHistory, solve_impact
from pw_elements.contact.steps.problem import ContactProblem, solve_contact
from pw_elements.contact.steps.stepping import Progress

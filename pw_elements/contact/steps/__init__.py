"""Increments of contact problems, impact, sensitivities, and checks of solutions."""

from pw_elements.contact.steps.impact import Energies, ImpactHistory, PairHistory, solve_impact
from pw_elements.contact.steps.problem import ContactProblem
from pw_elements.contact.steps.series import solve_contact, solve_for_values

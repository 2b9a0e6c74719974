"""Increments of contact problems, impact, sensitivities, and checks of solutions."""

from pw_elements.contact.steps.impact import Energies, ImpactHistory, PairHistory, solve_impact
from pw_elements.contact.steps.problem import ContactProblem, solve_contact
from pw_elements.contact.steps.series import solve_for_values

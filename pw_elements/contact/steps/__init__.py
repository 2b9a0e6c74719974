"""Increments, impact, and checks that they stay small."""

from pw_elements.contact.steps.impact import Energies, ImpactHistory, PairHistory, solve_impact
from pw_elements.contact.steps.problem import ContactProblem, solve_contact

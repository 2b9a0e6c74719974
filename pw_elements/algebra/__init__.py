"""Reduced problems: linear, nonlinear, and eigenvalues."""

from pw_elements.algebra.eigen import (
    BucklingModes,
    NoModes,
    VibrationModes,
    buckling,
    critical_step,
    diagonal_mass,
    vibration_modes,
)
from pw_elements.algebra.linear import factorise, free_pressure, reactions, solve, symmetric_part
from pw_elements.algebra.nonlinear import PetrovGalerkinProblem, System
from pw_elements.algebra.problem_checks import check_load, check_problem, is_finite
from pw_elements.algebra.reduction import Reduction, equilibrated, masked, prescribed, supported

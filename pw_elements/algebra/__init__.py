"""Linear, nonlinear and eigenvalue problems under supports and static condensation."""

from pw_elements.algebra.eigen import (
    BucklingModes,
    NoModes,
    VibrationModes,
    buckling,
    critical_step,
    extract_diagonal_mass,
    vibration_modes,
)
from pw_elements.algebra.linear import (
    factorise,
    has_free_constant_pressure,
    reactions,
    solve,
    symmetric_part,
)
from pw_elements.algebra.nonlinear import PetrovGalerkinProblem, ResidualSystem
from pw_elements.algebra.problem_checks import check_load, check_problem, is_finite
from pw_elements.algebra.reduction import (
    Reduction,
    constrained_operator,
    evaluate_conditions,
    full_size_reduction,
    reduce_load,
    reduce_matrix,
    scale_pressures,
)

"""Linear, nonlinear and eigenvalue problems under supports and static condensation."""

from pw_elements.algebra.eigen import (
    BucklingModes,
    TooFewModes,
    VibrationModes,
    buckling,
    critical_step,
    extract_diagonal_mass,
    vibration_modes,
)
from pw_elements.algebra.joined import (
    JoinedProblem,
    JoinedResidualSystem,
    make_residual_problem,
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
    free_dofs_and_prescribed_values,
    full_size_masking_reduction,
    matrix_free_constrained_operator,
    reduce_load_and_update_offset,
    reduce_matrix,
    scale_pressures_to_displacements,
)

"""Linear solvers by factorisation and by Krylov methods with multigrid."""

from pw_elements.solvers.automatic import SolverOrAuto, choose_solver, compute_with_direct_fallback
from pw_elements.solvers.direct import (
    Direct,
    FreeConstantPressure,
    LinearSolver,
    NotConverged,
    PreparedSolver,
    SeparateSupportsSolver,
    SingularSystem,
    SolverReport,
    has_separate_supports,
)
from pw_elements.solvers.iterative import (
    ITERATIVE_NEEDS_SUPPORTS_MESSAGE,
    Iterative,
    as_krylov_solver,
    solve_with_ksp,
)
from pw_elements.solvers.matrices import (
    ConstrainedOperator,
    ConstraintProjection,
    StiffnessWithAddedMatrix,
    Supports,
    add_scaled,
    block_diagonal_matrix,
    collect_garbage,
    destroy_objects,
    diagonal_blocks,
    galerkin_product,
    group_connected_nodes,
    identity_with_free_columns,
    is_stored_in_blocks,
    matrix_from_python_context,
    null_space_basis,
    qr_triangle,
    to_aij,
)
from pw_elements.solvers.multigrid import Multigrid
from pw_elements.solvers.rigid_components import ComponentRigidModes, has_free_rigid_motion

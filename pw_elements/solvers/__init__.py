"""Linear solvers: factors, Krylov methods and multigrid."""

from pw_elements.solvers.direct import (
    Direct,
    FreePressure,
    LinearSolver,
    MatrixFree,
    NotConverged,
    PreparedSolver,
    SingularSystem,
    SolverReport,
    is_matrix_free,
)
from pw_elements.solvers.iterative import (
    NO_SUPPORTS,
    Iterative,
    Pieces,
    Solver,
    auto_solver,
    free_motion,
    solve_by,
    with_fallback,
    with_levels,
)
from pw_elements.solvers.matrices import (
    Masked,
    Projection,
    Supports,
    add,
    block_diagonal,
    collect_garbage,
    destroy,
    diagonal_blocks,
    galerkin_product,
    is_blocked,
    null_space,
    python_matrix,
    selection,
    together,
    triangle,
    unblocked,
)
from pw_elements.solvers.multigrid import Multigrid

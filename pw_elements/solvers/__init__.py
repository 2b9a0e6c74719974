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
    Krylov,
    Pieces,
    SaddlePoint,
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
    connected_pieces,
    destroy,
    galerkin_product,
    is_blocked,
    python_matrix,
    selection,
    unbalanced,
    unblocked,
)
from pw_elements.solvers.multigrid import Multigrid

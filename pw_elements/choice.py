"""The choice between factors and Krylov's method, where the user leaves it to "auto".

Factors serve every body, as long as there is memory for them; Krylov's method takes little, and
may give up where supports or contact hardly hold the body. Then factors go on, if they fit.
"""

import logging
from collections.abc import Callable
from typing import TypeVar

from pw_elements import memory
from pw_elements.iterative import Iterative, Solver
from pw_elements.linear_solver import Direct, LinearSolver, SolverNotConverged
from pw_elements.projection import Supports

T = TypeVar("T")

log = logging.getLogger("pw_elements")

# Unknowns in space from which on "auto" takes Krylov's method; for modes, which take some 50
# solutions, it is slower than factors until these take several gigabytes
_MANY, _MANY_FOR_MODES = 15_000, 200_000
# Memory that has to be left, over what factors are expected to take, which is a fit
_ROOM = 2.0


def chosen(
    solver: Solver, supports: Supports | None, needs_factors: str = "", modes: bool = False
) -> LinearSolver:
    """The solver that is meant: factors in the plane and of small bodies by "auto", or None.

    Args:
        solver: as the user gives it.
        supports: of the problem; None where its reduction is more than supports.
        needs_factors: why only factors will do, if so.
        modes: whether eigenvalues are looked for.

    Raises:
        ValueError: for another word.
    """
    if solver is not None and not isinstance(solver, str):
        return solver
    if solver not in (None, "auto"):
        raise ValueError(f'solver {solver!r}: use Direct(), Iterative() or "auto"')
    if supports is None:
        return Direct()
    mesh, dofs = supports.space.mesh, _unknowns(supports)
    if mesh.geometry.dim < 3 or dofs < (_MANY_FOR_MODES if modes else _MANY):
        return Direct()
    taken: LinearSolver = Direct() if needs_factors else Iterative()
    if mesh.comm.rank == 0:
        log.info(
            "auto: %s for %d unknowns in space%s; factors take some %.2g GB",
            type(taken).__name__,
            dofs,
            f" ({needs_factors})" if needs_factors else "",
            memory.of_factors(dofs) / 1e9,
        )
    return taken


def by_chosen(
    taken: LinearSolver,
    solver: Solver,
    supports: Supports | None,
    compute: Callable[[LinearSolver], T],
) -> T:
    """What a computation gives with the solver that was `chosen`, or with `factors_instead`.

    Args:
        taken: that solver.
        solver: as the user gives it.
        supports: of the problem.
        compute: of a solver.

    Raises:
        SolverNotConverged: as `factors_instead` says.
    """
    try:
        return compute(taken)
    except SolverNotConverged as failure:
        instead = factors_instead(solver, supports, failure)
    return compute(instead)  # whatever the first attempt took has been freed


def factors_instead(
    solver: Solver, supports: Supports | None, failure: SolverNotConverged
) -> Direct:
    """Factors, where Krylov's method has given up that "auto" had taken.

    Args:
        solver: as the user gives it.
        supports: of the problem.
        failure: of the method.

    Raises:
        SolverNotConverged: the failure, if the user named the method, or if there is not twice
            the memory that factors are expected to take.
    """
    if supports is None or solver not in (None, "auto"):
        raise failure
    comm = supports.space.mesh.comm
    taken, left = memory.of_factors(_unknowns(supports)), memory.free(comm)
    if not _ROOM * taken <= left:
        raise SolverNotConverged(
            f'{failure}. "auto" does not use Direct() with {left / 1e9:.2g} GB left'
        ) from failure
    if comm.rank == 0:
        log.info(
            "auto: Iterative gave up, Direct goes on; factors take some %.2g of %.2g GB",
            taken / 1e9,
            left / 1e9,
        )
    return Direct()


def _unknowns(supports: Supports) -> int:
    """Number of unknowns, prescribed ones among them."""
    dofmap = supports.space.dofmap
    return int(dofmap.index_map.size_global * dofmap.index_map_bs)

"""The solver "auto", which chooses between a factorisation and a Krylov method.

A factorisation works for every body whose factors fit into memory. A Krylov method needs little
memory but may fail if supports or contact hardly hold the body. The computation is then repeated
with a factorisation, provided that the factors fit into memory.
"""

import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

from pw_elements.checks import arguments, count_local_and_global_dofs
from pw_elements.progress import log_on_root
from pw_elements.solvers.direct import Direct, LinearSolver, NotConverged
from pw_elements.solvers.iterative import Iterative, estimate_factor_memory_in_bytes
from pw_elements.solvers.matrices import Supports
from pw_elements.solvers.rigid_components import has_free_rigid_motion
from pw_elements.spaces import is_hybrid

SolverOrAuto: TypeAlias = LinearSolver | Literal["auto"] | None

T = TypeVar("T")

# Smallest numbers of unknowns for which "auto" uses the Krylov method in three dimensions: for one
# solution, and for modes. Modes need about 50 solutions, and the Krylov method is slower than
# factors unless these take several gigabytes
_MIN_KRYLOV_DOFS = 15_000
_MIN_KRYLOV_DOFS_FOR_MODES = 200_000
# The same for one solution if a component is held only by contact, which needs more iterations. For
# a lap joint with 14 310 unknowns, factors took 2.7 s and the Krylov method 4.2 s of CPU time; with
# 46 242 unknowns, they took 16.5 s and 12.2 s
_MIN_KRYLOV_DOFS_IF_HELD_BY_CONTACT = 30_000
# Free memory that is required for factors, relative to their estimated size
_MIN_FREE_MEMORY_OVER_FACTOR_MEMORY = 2.0


def total_free_memory_in_bytes(comm: MPI.Comm) -> float:
    """Return the total free memory in bytes on the machines of all processes; collective."""
    machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
    # one process of each machine reports the smallest value of all processes on this machine, since
    # the memory of a group of processes may be limited
    free = machine.allreduce(_machine_free_memory_in_bytes(), MPI.MIN)
    total = comm.allreduce(free if machine.rank == 0 else 0.0, MPI.SUM)
    machine.Free()
    return float(total)


def _machine_free_memory_in_bytes() -> float:
    """Return the free memory of this machine, or of its container or job if less, in bytes."""
    try:
        fields = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        free = 1024.0 * int(fields["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):  # not Linux
        free = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    try:
        group = Path("/proc/self/cgroup").read_text().rpartition("0::/")[2].strip()
        limits = Path("/sys/fs/cgroup") / group
        limit, used = ((limits / f"memory.{name}").read_text() for name in ("max", "current"))
        return min(free, float(limit) - float(used))
    except (OSError, ValueError):  # no limit, or "max"
        return free


def choose_solver(
    requested_solver: SolverOrAuto,
    supports: Supports | None,
    direct_only_reason: str = "",
    for_modes: bool = False,
    compute_contact_stiffness: Callable[[], PETSc.Mat] | None = None,
) -> LinearSolver:
    """Return the solver to use: the user's own solver, or the one that "auto" chooses.

    Args:
        requested_solver: solver given by the user; None means "auto".
        supports: free unknowns of a reduction made by `Reduction.dirichlet`; None for any other
            reduction.
        direct_only_reason: reason why only a factorisation can be used, or "" if there is none.
        for_modes: whether eigenvalues are computed.
        compute_contact_stiffness: function that returns the stiffness (n, n) of a body in contact,
            whose supports alone may not hold it; it is called only if the choice depends on this.
            None without contact.

    Raises:
        ValueError: for a solver that is neither an object nor "auto".
    """
    if requested_solver is not None and not isinstance(requested_solver, str):
        return requested_solver
    if not (requested_solver is None or arguments.is_one_of(requested_solver, ("auto",))):
        raise ValueError(f'solver {requested_solver!r}: use Direct(), Iterative() or "auto"')
    if supports is None:
        return Direct()
    mesh, dofs = supports.space.mesh, count_local_and_global_dofs(supports.space)[1]
    if mesh.geometry.dim < 3 or dofs < (
        _MIN_KRYLOV_DOFS_FOR_MODES if for_modes else _MIN_KRYLOV_DOFS
    ):
        return Direct()
    is_small = dofs < _MIN_KRYLOV_DOFS_IF_HELD_BY_CONTACT and not is_hybrid(supports.space)
    if (
        compute_contact_stiffness is not None
        and is_small
        and has_free_rigid_motion(compute_contact_stiffness(), supports)
    ):
        log_on_root(
            mesh.comm, logging.INFO, f"auto: Direct for {dofs} unknowns that contact has to hold"
        )
        return Direct()
    choice: LinearSolver = Direct() if direct_only_reason else Iterative()
    reason = f" ({direct_only_reason})" if direct_only_reason else ""
    memory = f"factors take some {estimate_factor_memory_in_bytes(dofs) / 1e9:.2g} GB"
    decision = f"auto: {type(choice).__name__} for {dofs} unknowns in space{reason}; {memory}"
    log_on_root(mesh.comm, logging.INFO, decision)
    return choice


def compute_with_direct_fallback(
    chosen_solver: LinearSolver,
    requested_solver: SolverOrAuto,
    supports: Supports | None,
    compute: Callable[[LinearSolver], T],
) -> T:
    """Return `compute(chosen_solver)`, or `compute(Direct())` if a choice of "auto" fails.

    Args:
        chosen_solver: solver to use, as returned by `choose_solver`.
        requested_solver: solver given by the user.
        supports: free unknowns of the problem; None if the reduction was not made by
            `Reduction.dirichlet`.
        compute: function that computes the result with a solver.

    Raises:
        NotConverged: if a solver fails that "auto" did not choose, or if the factors do not fit
            into memory.
    """
    try:
        return compute(chosen_solver)
    except NotConverged as failure:
        if supports is None or requested_solver not in (None, "auto"):
            raise
        comm = supports.space.mesh.comm
        needed, free = (
            estimate_factor_memory_in_bytes(count_local_and_global_dofs(supports.space)[1]),
            total_free_memory_in_bytes(comm),
        )
        if not _MIN_FREE_MEMORY_OVER_FACTOR_MEMORY * needed <= free:
            raise NotConverged(
                f'{failure}. "auto" does not use Direct() with {free / 1e9:.2g} GB left'
            ) from failure
    memory = f"factors take some {needed / 1e9:.2g} of {free / 1e9:.2g} GB"
    log_on_root(comm, logging.INFO, f"auto: Iterative gave up, Direct goes on; {memory}")
    return compute(Direct())  # the first attempt has freed its memory

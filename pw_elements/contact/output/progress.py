"""Reports on the progress of a contact computation, to the log and to the user's function.

The module guarantees that nodes are counted only if the log is enabled or there is a function of
the user. An error in the user's function on one process is raised on all processes. The module
assumes that all processes report together.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.checks import raise_errors_on_all_processes
from pw_elements.contact.model import ContactState
from pw_elements.contact.nodes import HELD, OPEN, SLIP, STICK, ActiveSet
from pw_elements.progress import log_on_root


@dataclass(frozen=True)
class Progress:
    """Progress of a contact computation after an iteration, or at the end of an increment.

    After an iteration, nodes are counted in the iteration's active set.

    Args:
        increment: number of the increment, counted from 0 as in the errors of `solve_contact`.
        iteration: number of linear systems solved in this increment so far.
        violation: largest violation of the laws of contact and friction, divided by its tolerance.
        open: number of open nodes of all pairs.
        stick: number of sticking nodes of all pairs.
        slip: number of slipping nodes of all pairs.
        state: contact state at the end of the increment; None after an iteration.
    """

    increment: int
    iteration: int
    violation: float
    open: int
    stick: int
    slip: int
    state: ContactState | None = None

    def __str__(self) -> str:
        return f"{self.open} open, {self.stick} stick, {self.slip} slip"


ProgressCallback: TypeAlias = Callable[[Progress], object]


class ProgressReporter:
    """Reporter that logs the progress of one increment and passes it to the user's function.

    Its methods are collective.

    Args:
        comm: communicator of the mesh.
        increment: number of the increment, counted from 0.
        callback: function of the user, or None.

    Attributes:
        violation: violation of the last solution, as in `Progress`.
    """

    def __init__(self, comm: MPI.Comm, increment: int, callback: ProgressCallback | None) -> None:
        self._comm, self._increment, self._callback = comm, increment, callback
        self.violation = 0.0
        # whether any process wants reports of iterations, and of increments
        is_logged = logging.getLogger("pw_elements.contact").isEnabledFor
        levels = (logging.DEBUG, logging.INFO)
        is_wanted = [bool(callback or (comm.rank == 0 and is_logged(level))) for level in levels]
        self._reports_iterations, self._reports_increments = np.any(
            comm.allgather(is_wanted), axis=0
        )

    def report_iteration(self, iteration: int, active: ActiveSet, violation: float) -> None:
        """Log an iteration and call the user's function if any process wants this report."""
        if not self._reports_iterations:
            return
        counts = self._comm.allreduce(np.bincount(active.status, minlength=HELD + 1))
        progress = self._make_progress_with_node_counts(iteration, violation, counts)
        message = f"iteration {iteration}: {progress}, violation / tolerance {violation:.1e}"
        self._log_and_call_user(logging.DEBUG, message, progress)

    def report_increment(self, state: ContactState, seconds: float) -> None:
        """Log the end of the increment and call the user's function if any process wants this.

        Args:
            state: state at the end of the increment.
            seconds: time that the increment took.
        """
        if not self._reports_increments:
            return
        status = np.concatenate([pair.status for pair in state.pairs])
        counts, report = np.bincount(status, minlength=HELD + 1), state.report
        progress = self._make_progress_with_node_counts(
            state.iterations, self.violation, counts, state
        )
        message = (
            f"{progress.iteration} iterations, {progress}, "
            f"residual {state.residuals.largest():.1e}, {report.method}, "
            f"{report.factorisations} factorisations, {seconds:.2f} s"
        )
        self._log_and_call_user(logging.INFO, message, progress)

    def _make_progress_with_node_counts(
        self,
        iteration: int,
        violation: float,
        counts_by_status: npt.NDArray[np.intp],
        state: ContactState | None = None,
    ) -> Progress:
        """Return a progress report with the number of nodes of each status on all processes."""
        sticking = int(counts_by_status[STICK] + counts_by_status[HELD])
        numbers_of_nodes = int(counts_by_status[OPEN]), sticking, int(counts_by_status[SLIP])
        return Progress(self._increment, iteration, violation, *numbers_of_nodes, state)

    def _log_and_call_user(self, level: int, message: str, progress: Progress) -> None:
        """Log a message and call the user's function.

        An error in the user's function is raised on all processes.

        Args:
            level: level of the log message.
            message: message without the number of the increment.
            progress: argument of the user's function.
        """
        log_on_root(self._comm, level, f"increment {self._increment}: {message}", ".contact")
        with raise_errors_on_all_processes(self._comm):
            if self._callback is not None:
                self._callback(progress)

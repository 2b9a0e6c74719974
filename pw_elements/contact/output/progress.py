"""Reports of how far a contact computation is, to the log and to the user's function."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.checks import collective_errors
from pw_elements.contact.model import ContactState
from pw_elements.contact.nodes import HELD, OPEN, SLIP, STICK, ActiveSet
from pw_elements.progress import log_on_root


@dataclass(frozen=True)
class Progress:
    """How far a contact computation is: after an iteration, or at the end of an increment.

    Args:
        increment: number of increments before this one: they count from 0, as in the errors of
            `solve_contact`.
        iteration: number of linear systems solved in this increment.
        violation: largest violation of the laws of contact and friction, over its tolerance.
        open: number of open nodes of all pairs; after an iteration, as it was assumed.
        stick: number of sticking ones.
        slip: number of slipping ones.
        state: at the end of the increment; None after an iteration.
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


Callback: TypeAlias = Callable[[Progress], object]


class ProgressReporter:
    """Logs one increment and calls the user's callback; all processes make and use it together."""

    def __init__(self, comm: MPI.Comm, increment: int, callback: Callback | None) -> None:
        self._comm, self._increment, self._callback = comm, increment, callback
        self.violation = 0.0  # of the last solution, as in `Progress`
        # whether any process wants to know of iterations, and of increments
        is_logged = logging.getLogger("pw_elements.contact").isEnabledFor
        levels = (logging.DEBUG, logging.INFO)
        wanted = [bool(callback or (comm.rank == 0 and is_logged(level))) for level in levels]
        self._reports_iterations, self._reports_increments = np.any(comm.allgather(wanted), axis=0)

    def report_iteration(self, iteration: int, active: ActiveSet, violation: float) -> None:
        """Log an iteration and call the user's function, if anybody wants to know."""
        if not self._reports_iterations:
            return
        counts = self._comm.allreduce(np.bincount(active.status, minlength=HELD + 1))
        now = self._progress(iteration, violation, counts)
        words = f"iteration {iteration}: {now}, violation / tolerance {violation:.1e}"
        self._tell(logging.DEBUG, words, now)

    def report_increment(self, state: ContactState, seconds: float) -> None:
        """Log the end of the increment and call the user's function, if anybody wants to know."""
        if not self._reports_increments:
            return
        status = np.concatenate([pair.status for pair in state.pairs])
        counts, report = np.bincount(status, minlength=HELD + 1), state.report
        now = self._progress(state.iterations, self.violation, counts, state)
        words = (
            f"{now.iteration} iterations, {now}, residual {state.residuals.largest():.1e}, "
            f"{report.method}, {report.factorisations} factorisations, {seconds:.2f} s"
        )
        self._tell(logging.INFO, words, now)

    def _progress(
        self,
        iteration: int,
        violation: float,
        counts: npt.NDArray[np.intp],
        state: ContactState | None = None,
    ) -> Progress:
        sticking = int(counts[STICK] + counts[HELD])
        each = int(counts[OPEN]), sticking, int(counts[SLIP])
        return Progress(self._increment, iteration, violation, *each, state)

    def _tell(self, level: int, words: str, now: Progress) -> None:
        """Logs, and calls the user's function: what it raises on one process is raised on all."""
        log_on_root(self._comm, level, f"increment {self._increment}: {words}", ".contact")
        with collective_errors(self._comm):
            if self._callback is not None:
                self._callback(now)

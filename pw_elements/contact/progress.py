"""What is told of a contact computation while it runs: to the log, and to the user's function."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.collective import collective
from pw_elements.contact.law import OPEN, SLIP, STICK, ActiveSet
from pw_elements.contact.state import ContactState
from pw_elements.progress import hush

log = logging.getLogger("pw_elements.contact")


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


def checked_callback(comm: MPI.Comm, callback: Callback | None) -> Callback | None:
    """The user's function.

    Raises:
        ValueError: if it is none.
    """
    with collective(comm):
        if not (callback is None or callable(callback)):
            raise ValueError(f"callback: {type(callback).__name__} in place of a function")
    return callback


class Reporter:
    """Tells of one increment: on all processes, which make it together.

    Attributes:
        wanted: whether anybody wants to know of iterations.
        violation: of the last solution, as in `Progress`.
    """

    def __init__(self, comm: MPI.Comm, increment: int, callback: Callback | None) -> None:
        self._comm, self._increment, self._callback = comm, increment, callback
        logged = comm.rank == 0 and log.isEnabledFor(logging.DEBUG)
        self.violation = 0.0
        self.wanted: bool = comm.allreduce(callback is not None or logged, MPI.LOR)

    def iterated(self, iteration: int, active: ActiveSet, violation: float) -> None:
        """Tells of an iteration."""
        counts = self._comm.allreduce(np.bincount(active.status, minlength=3))
        now = Progress(self._increment, iteration, violation, *_three(counts))
        self._log(
            logging.DEBUG, f"iteration {iteration}: {now}, violation / tolerance {violation:.1e}"
        )
        self._call(now)

    def ended(self, state: ContactState, seconds: float) -> None:
        """Tells of the end of the increment, which took some seconds."""
        status = np.concatenate([pair.status for pair in state.pairs])
        counts = np.bincount(status, minlength=3)
        now = Progress(self._increment, state.iterations, self.violation, *_three(counts), state)
        report = state.report
        self._log(
            logging.INFO,
            f"{now.iteration} iterations, {now}, residual {state.residuals.largest():.1e}, "
            f"{report.method}, {report.factorisations} factorisations, {seconds:.2f} s",
        )
        if self.wanted:
            self._call(now)

    def _log(self, level: int, what: str) -> None:
        if self._comm.rank == 0:
            log.log(level, "increment %d: %s", self._increment, what)

    def _call(self, now: Progress) -> None:
        """Calls the user's function; what it raises on one process is raised on all."""
        hush()
        with collective(self._comm):
            if self._callback is not None:
                self._callback(now)


def _three(counts: npt.NDArray[np.intp]) -> tuple[int, int, int]:
    return int(counts[OPEN]), int(counts[STICK]), int(counts[SLIP])

"""What goes on while a computation runs: the library's loggers, and lines on stderr.

Loggers are "pw_elements", "pw_elements.contact", "pw_elements.eigen", "pw_elements.linear_solver"
and "pw_elements.problems": increments and eigenvalue problems at the level INFO, iterations and
factorisations at DEBUG, on process 0 alone.

    logging.basicConfig(level=logging.INFO)

Where the log does not speak, a line on stderr names what is being done, every ten seconds at most.
For silence say so:

    logging.getLogger("pw_elements").setLevel(logging.ERROR)
"""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

from mpi4py import MPI

logger = logging.getLogger("pw_elements")

# What is being done now, the outermost first; seconds between lines, and when the last one was
# written, or could have been
_doing: list[str] = []
_PAUSE = 10.0
_written = perf_counter()


@contextmanager
def report_activity(comm: MPI.Comm, activity: str) -> Iterator[None]:
    """Says on stderr what is being done in a block, and in what block around it."""
    global _written
    speaks = logger.isEnabledFor(logging.INFO) and logger.hasHandlers()
    silent = comm.rank > 0 or speaks or bool(logger.handlers) or logger.level > logging.INFO
    _doing.append(activity)
    if not silent and perf_counter() - _written >= _PAUSE:
        _written = perf_counter()
        print(", ".join(_doing), file=sys.stderr, flush=True)
    try:
        yield
    finally:
        _doing.pop()


def log_on_root(comm: MPI.Comm, level: int, message: str, subsystem: str = "") -> None:
    """Logs words once, on process 0; `of` names the logger, such as ".contact"."""
    if comm.rank == 0:
        logging.getLogger(f"pw_elements{subsystem}").log(level, message)

"""Progress of a computation: the library's loggers, and lines on stderr.

Loggers are "pw_elements", "pw_elements.contact", "pw_elements.eigen", "pw_elements.linear_solver"
and "pw_elements.problems". They log increments and eigenvalue problems at the level INFO,
iterations and factorisations at DEBUG, on process 0 alone.

    logging.basicConfig(level=logging.INFO)

If INFO is not logged, a line on stderr names the current activity, at most every ten seconds. This
turns it off:

    logging.getLogger("pw_elements").setLevel(logging.ERROR)
"""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

from mpi4py import MPI

logger = logging.getLogger("pw_elements")

# Current activities, the outermost first; seconds between two reports; time of the last report, or
# of the import
_activities: list[str] = []
_MIN_PAUSE = 10.0
_last_report = perf_counter()


@contextmanager
def report_activity(comm: MPI.Comm, activity: str) -> Iterator[None]:
    """Name the activity of a block, and of blocks around it, on stderr at intervals."""
    global _last_report
    logs_info = logger.isEnabledFor(logging.INFO) and logger.hasHandlers()
    is_silent = comm.rank > 0 or logs_info or bool(logger.handlers) or logger.level > logging.INFO
    _activities.append(activity)
    if not is_silent and perf_counter() - _last_report >= _MIN_PAUSE:
        _last_report = perf_counter()
        print(", ".join(_activities), file=sys.stderr, flush=True)
    try:
        yield
    finally:
        _activities.pop()


def log_on_root(comm: MPI.Comm, level: int, message: str, subsystem: str = "") -> None:
    """Log a message on process 0; `subsystem` names the child logger, such as ".contact"."""
    if comm.rank == 0:
        logging.getLogger(f"pw_elements{subsystem}").log(level, message)

"""Report the progress of a computation through loggers or by lines on stderr.

The library's loggers are "pw_elements", "pw_elements.contact", "pw_elements.eigen",
"pw_elements.linear_solver" and "pw_elements.problems". Only process 0 logs. Increments and
eigenvalue problems are logged at the level INFO, iterations and factorisations at the level DEBUG:

    logging.basicConfig(level=logging.INFO)

If messages of the level INFO are not logged, a line on stderr names the current activity, at most
every ten seconds. The following call switches these lines off:

    logging.getLogger("pw_elements").setLevel(logging.ERROR)
"""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

from mpi4py import MPI

logger = logging.getLogger("pw_elements")

# Current activities, the outermost first
_current_activities: list[str] = []
_MIN_SECONDS_BETWEEN_REPORTS = 10.0
# Time of the last report; before the first report, time at which this module was imported
_last_report_time = perf_counter()


@contextmanager
def report_activity(comm: MPI.Comm, activity: str) -> Iterator[None]:
    """Report the activity of a `with` block, and the activities of enclosing blocks, on stderr.

    Only process 0 reports. Nothing is printed within ten seconds after the last report, or if the
    library's logger logs messages of the level INFO, has a handler or a level above INFO.
    """
    global _last_report_time
    logs_info = logger.isEnabledFor(logging.INFO) and logger.hasHandlers()
    is_silent = comm.rank > 0 or logs_info or bool(logger.handlers) or logger.level > logging.INFO
    _current_activities.append(activity)
    if not is_silent and perf_counter() - _last_report_time >= _MIN_SECONDS_BETWEEN_REPORTS:
        _last_report_time = perf_counter()
        print(", ".join(_current_activities), file=sys.stderr, flush=True)
    try:
        yield
    finally:
        _current_activities.pop()


def log_on_root(comm: MPI.Comm, level: int, message: str, subsystem: str = "") -> None:
    """Log a message on process 0; `subsystem` names the child logger, such as ".contact"."""
    if comm.rank == 0:
        logging.getLogger(f"pw_elements{subsystem}").log(level, message)

"""What goes on while a computation runs: the library's loggers, and lines on stderr.

Loggers are "pw_elements", "pw_elements.contact", "pw_elements.eigen", "pw_elements.linear_solver"
and "pw_elements.problems": increments and eigenvalue problems at the level INFO, iterations and
factorisations at DEBUG, on process 0 alone.

    logging.basicConfig(level=logging.INFO)

Where the log does not speak and stderr is a terminal, a line there names what is being done, and
is wiped out when it is done. Pipes and files get such a line every ten seconds at most. For silence
say so:

    logging.getLogger("pw_elements").setLevel(logging.ERROR)
"""

import logging
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from mpi4py import MPI

logger = logging.getLogger("pw_elements")

# Characters of a bar
_BAR = 20
_WIPE = "\r\033[K"
# What is being done now, the outermost first, and since when
_doing: list[str] = []
_since = 0.0
# Seconds between lines that are not on a terminal; when the last one was written, or could have
# been, and when the last thing was done
_PAUSE = 10.0
_written = _ended = float("-inf")


@contextmanager
def doing(comm: MPI.Comm, what: str) -> Iterator[Callable[[str], None] | None]:
    """Says on stderr what is being done in a block, below what is said around it.

    What it yields adds words, in place of those that it added before; None where nothing is said.
    """
    global _since, _written, _ended
    if comm.rank > 0 or _settled():
        yield None
        return
    if not _doing:
        _since = perf_counter()
        _written = _since if _since - _ended > _PAUSE else _written
    depth = len(_doing)
    _doing.append(what)
    _show()

    def more(words: str) -> None:
        _doing[depth] = f"{what}, {words}"
        _show()

    try:
        yield more if sys.stderr.isatty() else None
    finally:
        _doing.pop()
        _ended = perf_counter()
        _show()


def bar(done: int, total: int) -> str:
    """How much of a total is done, as a bar and in numbers."""
    full = _BAR * done // total
    return f"|{'#' * full}{'-' * (_BAR - full)}| {done}/{total}"


def told(comm: MPI.Comm, level: int, words: str, of: str = "") -> None:
    """Logs words once, on process 0; `of` names the logger, such as ".contact"."""
    if comm.rank == 0:
        logging.getLogger(f"pw_elements{of}").log(level, words)


def hush() -> None:
    """Wipes the line out until the next thing is done: something else is to be written."""
    if _doing and sys.stderr.isatty():
        sys.stderr.write(_WIPE)
        sys.stderr.flush()


def _settled() -> bool:
    speaks = logger.isEnabledFor(logging.INFO) and logger.hasHandlers()
    return speaks or bool(logger.handlers) or logger.level > logging.INFO


def _show() -> None:
    global _written
    line, now = ", ".join(_doing), perf_counter()
    if now - _since >= 1:
        line = f"{now - _since:.0f} s {line}"
    if not sys.stderr.isatty():
        if _doing and now - _written >= _PAUSE:
            _written = now
            sys.stderr.write(f"{line}\n")
            sys.stderr.flush()
        return
    width = shutil.get_terminal_size().columns - 1
    sys.stderr.write(_WIPE + line[:width] if _doing else _WIPE)
    sys.stderr.flush()

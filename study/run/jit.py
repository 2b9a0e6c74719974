"""Recover from compilations of forms by other processes that are slow or were killed."""

import re
import time
from pathlib import Path

_TIMED_OUT = re.compile(r"JIT compilation timed out.* remove (/.*\.c)\)")
_FILE_EXISTS = re.compile(r"File exists: '(/.*\.c)\.cached'")
STALE_SECONDS = 60.0
"""Time in seconds without changes to its files after which a compilation is taken as killed."""


def recover_from_jit_conflict(error: Exception) -> bool:
    """Return whether an error is due to another process that compiles the same form.

    DOLFINx lets the first process compile a form, and other processes wait for it; they fail after
    ten seconds. If the first process was killed, all attempts fail. The files of the form are
    therefore removed if they have not changed for `STALE_SECONDS`, or if two processes have
    compiled the form.

    Args:
        error: Exception that a computation raised.

    Returns:
        True if the computation should be tried again.
    """
    timed_out, file_exists = (p.search(str(error)) for p in (_TIMED_OUT, _FILE_EXISTS))
    match = timed_out or file_exists
    if not match:
        return False
    source = Path(match[1])
    change_times = [path.stat().st_mtime for path in source.parent.glob(f"{source.stem}.*")]
    if file_exists or time.time() - max(change_times, default=0.0) > STALE_SECONDS:
        source.with_suffix(".c.cached").unlink(missing_ok=True)
        source.unlink(missing_ok=True)
    return True

"""Recover from compilations of forms by other processes that were killed, or are slow."""

import re
import time
from pathlib import Path

_TIMED_OUT = re.compile(r"JIT compilation timed out.* remove (/.*\.c)\)")
_FILE_EXISTS = re.compile(r"File exists: '(/.*\.c)\.cached'")
STALE_SECONDS = 60.0
"""Time without a change of files after which a compilation counts as killed."""


def recover_from_jit_conflict(error: Exception) -> bool:
    """Return whether an exception is due to a compilation by another process; then try again.

    DOLFINx leaves a form to the process that has begun to compile it, and fails after ten seconds,
    on every attempt if that process has been killed. In this case, and where two processes have
    compiled the same form, its files are removed; otherwise the other process gets more time.
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

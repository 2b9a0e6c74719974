"""Recover if another process that compiles the same form is slow or has been killed."""

import re
import time
from pathlib import Path

_TIMED_OUT = re.compile(r"JIT compilation timed out.* remove (/.*\.c)\)")
_FILE_EXISTS = re.compile(r"File exists: '(/.*\.c)\.cached'")
STALE_SECONDS = 60.0
"""Seconds without changes to the files after which a compilation is considered killed."""


def recover_from_jit_conflict(error: Exception) -> bool:
    """Return whether an exception was caused by another process compiling the same form.

    If so, the caller should try again. DOLFINx leaves a form to the process that has begun to
    compile it, and fails after ten seconds of waiting; if that process was killed, every attempt
    fails. In this case, or if two processes have compiled the same form, the form's files are
    removed; otherwise the other process is given more time.
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

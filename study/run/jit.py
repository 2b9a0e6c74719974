"""Compilations of forms that were killed, or are slow: neither must cost a case."""

import re
import time
from pathlib import Path

_BLOCKED = re.compile(r"JIT compilation timed out.* remove (/.*\.c)\)")
_TWICE = re.compile(r"File exists: '(/.*\.c)\.cached'")
SLOW = 60.0  # seconds after which a compilation that shows no sign of life has been killed


def unblocked(error: Exception) -> bool:
    """Tell whether an exception is about another's compilation, and it is worth trying again.

    DOLFINx leaves a form to the process that has begun to compile it, and gives up after ten
    seconds, for ever if that process has been killed. Then its files are removed here; else it
    is given more time. Two that compiled the same after all are told apart by a new start.
    """
    blocked, twice = _BLOCKED.search(str(error)), _TWICE.search(str(error))
    found = blocked or twice
    if not found:
        return False
    source = Path(found[1])
    signs = [path.stat().st_mtime for path in source.parent.glob(f"{source.stem}.*")]
    if twice or time.time() - max(signs, default=0.0) > SLOW:
        source.with_suffix(".c.cached").unlink(missing_ok=True)
        source.unlink(missing_ok=True)
    return True

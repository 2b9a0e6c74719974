"""Starts the command line under its supervisor."""

import os
import sys
from contextlib import suppress

from study.core.supervisor import supervise


def _run() -> int:
    from study.command import main  # slow to import, which a signal may interrupt, too

    return main()


if __name__ == "__main__":
    status = supervise(_run, "study")
    with suppress(OSError, ValueError):  # nobody reads any more
        sys.stdout.flush()
        sys.stderr.flush()
    # all is written: MPI's and UCX's own end may crash in a process whose parent was forked
    os._exit(status)

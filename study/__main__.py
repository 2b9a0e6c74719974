"""Starts the command line under its supervisor."""

import sys

from study.core.supervisor import supervise


def _run() -> int:
    from study.command import main  # slow to import, which a signal may interrupt, too

    return main()


if __name__ == "__main__":
    sys.exit(supervise(_run, "study"))

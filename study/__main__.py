"""Starts the command line: from here on, Ctrl-C ends it with one line."""

import sys

from study.core import interrupt

if __name__ == "__main__":
    with interrupt.handled(interrupt.end):
        from study.command import main

        sys.exit(main())

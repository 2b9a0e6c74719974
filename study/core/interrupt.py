"""Ctrl-C: one line, at whatever moment it comes."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

INTERRUPTED = "study: interrupted; the results so far are kept"


def end(*_: object) -> None:
    """Handle Ctrl-C by ending at once: before anything was written, or when it comes again."""
    print(INTERRUPTED, file=sys.stderr, flush=True)
    os._exit(130)


def stop(*_: object) -> None:
    """Handle Ctrl-C by an exception, which lets the workers go; the next one ends at once."""
    signal.signal(signal.SIGINT, end)
    raise KeyboardInterrupt


@contextmanager
def handled(by: Callable[..., None]) -> Iterator[None]:
    """Let one of the two handle Ctrl-C meanwhile, unless it is ignored."""
    before = signal.getsignal(signal.SIGINT)
    if before in (signal.default_int_handler, end, stop):
        signal.signal(signal.SIGINT, by)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)

"""Commands as processes of their own, and all that they start: found by descent and by a mark."""

import os
import secrets
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

MARK = "PW_ELEMENTS_TEST_MARK"
SIGNALS = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)


class Started:
    """A command in a session of its own, whose descendants inherit a mark in their environment.

    Its standard output is a pipe that stays open, its messages go to a file.
    """

    def __init__(self, command, messages, ignored=(), **environment):
        self.mark = secrets.token_hex(16)
        self.messages = messages

        def as_in_a_terminal():  # whatever the tests themselves ignore or block
            signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
            for one in SIGNALS:
                signal.signal(one, signal.SIG_IGN if one in ignored else signal.SIG_DFL)

        with messages.open("wb") as stream:
            self.process = subprocess.Popen(
                command,
                env=os.environ | environment | {MARK: self.mark},
                stdout=subprocess.PIPE,
                stderr=stream,
                start_new_session=True,
                preexec_fn=as_in_a_terminal,
                text=True,
            )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in self.left():
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        self.process.wait()
        self.process.stdout.close()

    @property
    def pid(self):
        return self.process.pid

    def read_until(self, line):
        """Read standard output up to a line."""
        for read in self.process.stdout:
            if read.strip() == line:
                return
        raise AssertionError(f"{line!r} was not printed: {self.lines()}")

    def send(self, number, group=False):
        """Send a signal to the first process, or to all of its group."""
        with suppress(ProcessLookupError):
            (os.killpg if group else os.kill)(self.pid, number)

    def wait(self, seconds=1800):
        return self.process.wait(seconds)

    def lines(self):
        return self.messages.read_text().splitlines()

    def below(self):
        """Return the descendants, by generation: children first."""
        parents = {}
        for process in _processes():
            with suppress(OSError):
                parents[process] = int(_fields(process)[1])
        generations = [[self.pid]]
        while generations[-1]:
            generations.append([p for p, parent in parents.items() if parent in generations[-1]])
        return [process for generation in generations[1:] for process in generation]

    def marked(self):
        """Return the processes that have the mark, wherever they belong by now."""
        marked = []
        for process in _processes():
            with suppress(OSError):
                variables = Path(f"/proc/{process}/environ").read_bytes().split(b"\0")
                if f"{MARK}={self.mark}".encode() in variables and _fields(process)[0] != "Z":
                    marked.append(process)
        return marked

    def left(self):
        """Return all that is still there of the command, which itself may have ended."""
        return sorted({*self.marked(), *self.below()})

    def left_in_the_end(self):
        """Return what stays there for long, after an end that leaves nobody to wait for it."""
        deadline = time.monotonic() + 600
        while (left := self.left()) and time.monotonic() < deadline:
            time.sleep(0.02)
        return left


def command_line(process):
    """Return the command line of a process, or nothing if it has ended."""
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def _processes():
    return [int(path.name) for path in Path("/proc").iterdir() if path.name.isdecimal()]


def _fields(process):
    """Return state, parent and so on."""
    return Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(")")[2].split()

"""Run commands in separate processes, and find all descendants of these processes.

Descendants are found by following parents, and by a marker in their environment.
"""

import os
import secrets
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

MARKER_ENVIRONMENT_VARIABLE = "PW_ELEMENTS_TEST_MARK"
TERMINATION_SIGNALS = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)


class SpawnedCommand:
    """A command in its own session, whose descendants inherit a marker in their environment.

    Standard output is a pipe that stays open. Standard error is written to a file.

    Args:
        command: list of the program and its arguments.
        messages: path of the file for standard error.
        ignored: signals that the command ignores.
        environment: additional environment variables.
    """

    def __init__(self, command, messages, ignored=(), **environment):
        self.marker = secrets.token_hex(16)
        self.messages = messages

        def reset_signals():  # the tests themselves may ignore or block signals
            signal.pthread_sigmask(signal.SIG_UNBLOCK, TERMINATION_SIGNALS)
            for number in TERMINATION_SIGNALS:
                signal.signal(number, signal.SIG_IGN if number in ignored else signal.SIG_DFL)

        with messages.open("wb") as stream:
            self.process = subprocess.Popen(
                command,
                env=os.environ | environment | {MARKER_ENVIRONMENT_VARIABLE: self.marker},
                stdout=subprocess.PIPE,
                stderr=stream,
                start_new_session=True,
                preexec_fn=reset_signals,
                text=True,
            )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in self.list_survivors():
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        self.process.wait()
        self.process.stdout.close()

    @property
    def pid(self):
        return self.process.pid

    def read_output_until(self, line):
        """Read standard output up to and including a given line."""
        for output in self.process.stdout:
            if output.strip() == line:
                return
        raise AssertionError(f"{line!r} was not printed: {self.read_messages()}")

    def send_signal(self, signal_number, to_group=False):
        """Send a signal to the process started directly or, if `to_group` is True, to its group."""
        with suppress(ProcessLookupError):
            (os.killpg if to_group else os.kill)(self.pid, signal_number)

    def wait(self, timeout_seconds=1800):
        """Wait until the process that was started directly ends, and return its exit status.

        Its descendants may continue to run.
        """
        return self.process.wait(timeout_seconds)

    def read_messages(self):
        """Return the lines of standard error."""
        return self.messages.read_text().splitlines()

    def list_descendants(self):
        """Return the IDs of all descendants, ordered by generation, children first."""
        parents = {}
        for process in _list_process_ids():
            with suppress(OSError):
                parents[process] = int(_read_stat_fields(process)[1])
        generations = [[self.pid]]
        while generations[-1]:
            generations.append([p for p, parent in parents.items() if parent in generations[-1]])
        return [process for generation in generations[1:] for process in generation]

    def list_marked_processes(self):
        """Return the IDs of all running processes with the marker, whatever their parent."""
        marked_processes = []
        for process in _list_process_ids():
            with suppress(OSError):
                variables = Path(f"/proc/{process}/environ").read_bytes().split(b"\0")
                if (
                    f"{MARKER_ENVIRONMENT_VARIABLE}={self.marker}".encode() in variables
                    and _read_stat_fields(process)[0] != "Z"
                ):
                    marked_processes.append(process)
        return marked_processes

    def list_survivors(self):
        """Return the IDs of the processes still running, even if the first one has ended."""
        return sorted({*self.list_marked_processes(), *self.list_descendants()})

    def list_survivors_after_waiting(self):
        """Wait at most 600 s for all processes to end, and return the IDs of those that remain."""
        deadline = time.monotonic() + 600
        while (survivors := self.list_survivors()) and time.monotonic() < deadline:
            time.sleep(0.02)
        return survivors


def read_command_line(process_id):
    """Return the command line of a process, or an empty string if the process has ended."""
    try:
        return Path(f"/proc/{process_id}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def _list_process_ids():
    """Return the IDs of all processes on this machine."""
    return [int(path.name) for path in Path("/proc").iterdir() if path.name.isdecimal()]


def _read_stat_fields(process_id):
    """Return the fields of /proc/PID/stat after the process's name: state, parent and so on."""
    return Path(f"/proc/{process_id}/stat").read_text(errors="replace").rpartition(")")[2].split()

"""Supervise commands, such that a signal ends all processes of a command with one line of output.

The work of a command is done in a separate process, the worker. The process that the user starts,
the leader, only waits. On SIGHUP, SIGINT or SIGTERM it kills all of its descendants and prints
which signal was received and which files are kept. Since results are written atomically, processes
can be killed at any time, and no other code has to handle signals. PETSc, MPI, compilers, CalculiX
and Sphinx would handle them in different ways, or not at all.

A guard process between leader and worker does the same if the leader itself is killed. Leader and
guard adopt orphaned descendants (`PR_SET_CHILD_SUBREAPER`), and guard and worker are signalled when
their parents end (`PR_SET_PDEATHSIG`). On systems other than Linux, commands run without
supervision, and a one-line message is printed for Ctrl-C only.

    python3 -m study.run.supervisor MODULE [ARGUMENT ...]

runs a module like `python3 -m MODULE`, but under a supervisor.
"""

import os
import runpy
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

# Other modules are imported in functions: signals that arrive before `supervise` are not handled

SIGNALS: set[signal.Signals] = {signal.SIGHUP, signal.SIGINT, signal.SIGTERM}
"""Signals that end a command with a one-line message, unless they are ignored (nohup)."""

RESUME_HINTS = {
    "study": "the results so far are kept, and the same command without --force computes the rest",
    "figures": "results and figures so far are kept, and the same command goes on with the rest",
    "site": "an earlier site is kept, and the same command makes it anew",
}
"""Message for each command: which files are kept when it is ended, and how to resume it."""

SUPERVISOR = "PW_ELEMENTS_SUPERVISOR"
"""Environment variable that contains the process ID of the supervisor."""

_SET_DEATH_SIGNAL, _SET_SUBREAPER = 1, 36  # options of prctl(2)
_MAX_KILL_SECONDS = 10.0  # processes that survive SIGKILL for longer are abandoned
_PAUSE_SECONDS = 0.002  # between two attempts to kill


def supervise(command: Callable[[], int], name: str) -> int:
    """Run a command in a separate process; when it ends, kill all of its descendants.

    Because the process forks, call this function before initialising MPI or starting threads.

    Args:
        command: Function that does the work and returns the exit status, or raises SystemExit.
        name: Name of the command in messages and in `RESUME_HINTS`.

    Returns:
        Exit status of the command, or 128 plus the number of the signal that ended it.
    """
    _open_closed_streams()
    if _has_supervisor():
        return command()
    if sys.platform != "linux":
        return _run_without_supervisor(command, name)
    stopping: set[signal.Signals] = {
        number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN
    }
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*stopping, signal.SIGTERM, signal.SIGCHLD})
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # if ignored, no exit status
    _control_process(_SET_SUBREAPER, 1)
    sys.stdout.flush()
    sys.stderr.flush()
    leader, folder = os.getpid(), _make_temporary_folder()
    guard = os.fork()
    if guard:
        status = _run_leader(guard, stopping)
        _remove_folder(folder)
        if status > 128 and status != 128 + signal.SIGPIPE:
            with suppress(OSError):  # the terminal may be closed
                print(_format_signal_message(name, status - 128), file=sys.stderr, flush=True)
        return status
    _start_worker_under_guard(leader, folder)
    # The signals remain blocked in the worker and its descendants
    signal.pthread_sigmask(signal.SIG_SETMASK, before | stopping)
    os.environ[SUPERVISOR] = str(leader)
    if folder:
        os.environ["TMPDIR"] = folder
    return command()


def run_supervised(command: Callable[[], int], name: str) -> NoReturn:
    """Run a command like `supervise`, and exit this process with the command's status.

    The libraries are not finalised. If Python loads MPI at start-up, UCX shares file descriptors
    with the worker, which has already closed them, and finalising UCX would crash the leader.
    """
    status = supervise(command, name)
    with suppress(OSError, ValueError, AttributeError):  # a closed pipe
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(status)


def _open_closed_streams() -> None:
    """Redirect closed standard streams, which occur under some daemons, to the null device."""
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, number)
            if null != number:
                os.close(null)
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115


@contextmanager
def block_signals() -> Iterator[None]:
    """Block `SIGNALS` in this process and in processes that are started within the context."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def list_descendants(process: int) -> list[int]:
    """Return the process IDs of all descendants of a process, in ascending order."""
    parents = _read_parents()
    family = {process}
    while children := {child for child, parent in parents.items() if parent in family} - family:
        family |= children
    return sorted(family - {process})


def _run_leader(guard: int, stopping: set[signal.Signals]) -> int:
    """Wait for a signal or the end of the guard; kill all descendants and return the status."""
    while True:
        caught = signal.sigwait({*stopping, signal.SIGCHLD})
        status = _collect_ended_children(guard)
        if status is None and caught in stopping:
            status = 128 + caught
        if status is not None:
            _end_descendants()
            return status


def _start_worker_under_guard(leader: int, folder: str | None) -> None:
    """Fork the worker, in which this function returns.

    The guard stays in this function until the worker or the leader has ended, and then exits.
    """
    guard = os.getpid()
    _control_process(_SET_SUBREAPER, 1)
    _control_process(_SET_DEATH_SIGNAL, signal.SIGTERM)  # blocked, for sigwait
    worker = os.fork()
    if not worker:
        _control_process(_SET_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != guard:  # the guard has ended already
            os._exit(1)
        return
    status = None
    while status is None and os.getppid() == leader:
        signal.sigwait({signal.SIGTERM, signal.SIGCHLD})
        status = _collect_ended_children(worker)
    _end_descendants()
    if os.getppid() != leader:
        _remove_folder(folder)
    os._exit(status or 0)


def _collect_ended_children(child: int) -> int | None:
    """Reap all children that have ended; return the status of `child` if it is among them."""
    status = None
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            if ended[0] == child:
                code = os.waitstatus_to_exitcode(ended[1])
                status = code if code >= 0 else 128 - code
    return status


def _end_descendants() -> None:
    """Kill all descendants of this process, including orphans, which it adopts."""
    deadline = time.monotonic() + _MAX_KILL_SECONDS
    while time.monotonic() < deadline:
        for process in list_descendants(os.getpid()):
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:  # no child is left
            return
        time.sleep(_PAUSE_SECONDS)


def _has_supervisor() -> bool:
    """Return whether an ancestor of this process supervises it."""
    supervisor, parents, process = os.environ.get(SUPERVISOR, ""), _read_parents(), os.getppid()
    while process and str(process) != supervisor:
        process = parents.get(process, 0)
    return bool(process)


def _read_parents() -> dict[int, int]:
    """Return the parent of each visible process."""
    parents = {}
    for process in os.listdir("/proc"):
        if not process.isdecimal():
            continue
        with suppress(OSError), open(f"/proc/{process}/stat", "rb") as stream:  # it may have ended
            parents[int(process)] = int(stream.read().rpartition(b")")[2].split()[1])
    return parents


def _control_process(option: int, value: int) -> None:
    import ctypes

    with suppress(AttributeError):
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _make_temporary_folder() -> str | None:
    """Create a folder for the command's temporary files; return None if this fails."""
    import tempfile

    try:
        return tempfile.mkdtemp(prefix="pw-elements-")
    except OSError:
        return None


def _remove_folder(folder: str | None) -> None:
    import shutil

    if folder:
        shutil.rmtree(folder, ignore_errors=True)


def _run_without_supervisor(command: Callable[[], int], name: str) -> int:
    try:
        return command()
    except KeyboardInterrupt:
        print(_format_signal_message(name, signal.SIGINT), file=sys.stderr, flush=True)
        return 128 + signal.SIGINT


def _format_signal_message(name: str, number: int) -> str:
    """Return a line that names the signal that ended a command and the files that are kept."""
    numbers = {one.value for one in signal.Signals}
    signal_name = signal.Signals(number).name if number in numbers else f"signal {number}"
    verb = "interrupted" if number in SIGNALS else "ended"
    cause = " (out of memory?)" if number == signal.SIGKILL else ""
    kept = RESUME_HINTS.get(name, "files that it has written are kept")
    return f"{name}: {verb} by {signal_name}{cause}; {kept}"


def _run_module() -> int:
    """Run the module that the first command-line argument names."""
    module = sys.argv[1]
    del sys.argv[0]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("supervisor: name a module, as in python3 -m study.run.supervisor study")
    run_supervised(_run_module, sys.argv[1].removeprefix("study."))

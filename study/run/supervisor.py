"""One supervisor for every command: a signal ends all of its processes, and tells one line.

A command's work runs in a process of its own. The process that the user knows does nothing but
wait: at SIGHUP, SIGINT or SIGTERM it kills all of its descendants, whatever they are doing, and
says which signal it was and what is kept. Results are written wholly or not at all, so that there
is nothing to wait for, and no work has to answer signals: PETSc, MPI, compilers, CalculiX and
Sphinx each would in their own way, or not at all.

Between the two stands a guard, which does the same where the leader itself is killed. Leader and
guard adopt whatever their descendants leave behind (`PR_SET_CHILD_SUBREAPER`), and each process
of the three ends with the one above it (`PR_SET_PDEATHSIG`). Elsewhere than on Linux a command runs
without them, and only Ctrl-C ends it with a line.

    python3 -m study.run.supervisor MODULE [ARGUMENT ...]

runs a module as `python3 -m MODULE` does, under a supervisor.
"""

import os
import runpy
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

# Other modules are imported where they are used: until `supervise` is called, a signal has its
# usual effect

SIGNALS: set[signal.Signals] = {signal.SIGHUP, signal.SIGINT, signal.SIGTERM}
"""Signals that end a command with one line; where one is ignored, as by nohup, it stays so."""

KEPT = {
    "study": "the results so far are kept, and the same command without --force computes the rest",
    "figures": "results and figures so far are kept, and the same command goes on with the rest",
    "site": "an earlier site is kept, and the same command makes it anew",
}
"""What is kept when a command is ended, and how to go on."""

SUPERVISOR = "PW_ELEMENTS_SUPERVISOR"
"""Variable in which descendants find the process that supervises them."""

_SET_DEATH_SIGNAL, _SET_SUBREAPER = 1, 36  # options of prctl(2)
_LAST_ATTEMPT = 10.0  # seconds after which processes that SIGKILL does not end are given up
_PAUSE = 0.002  # seconds between two attempts


def supervise(command: Callable[[], int], name: str) -> int:
    """Run a command in a process of its own, and end all of its descendants with it.

    To be called before MPI is initialised and before there are threads, which no fork survives.

    Args:
        command: Does the work and returns the exit status; it may raise SystemExit, too.
        name: The command's name in messages; for those in `KEPT`, they tell what is kept.

    Returns:
        The exit status of the command, or 128 and the number of the signal that ended it.
    """
    _open_closed_streams()
    if _has_supervisor():
        return command()
    if sys.platform != "linux":
        return _run_alone(command, name)
    stopping: set[signal.Signals] = {
        one for one in SIGNALS if signal.getsignal(one) != signal.SIG_IGN
    }
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*stopping, signal.SIGTERM, signal.SIGCHLD})
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # where it is ignored, no status is left
    _control_process(_SET_SUBREAPER, 1)
    sys.stdout.flush()
    sys.stderr.flush()
    leader, folder = os.getpid(), _make_temporary_folder()
    guard = os.fork()
    if guard:
        status = _lead(guard, stopping)
        _remove_folder(folder)
        if status > 128 and status != 128 + signal.SIGPIPE:
            with suppress(OSError):  # a terminal that has gone reads nothing
                print(_farewell(name, status - 128), file=sys.stderr, flush=True)
        return status
    _guard_worker(leader, folder)
    # the worker: the signals stay blocked, in all that it starts as well
    signal.pthread_sigmask(signal.SIG_SETMASK, before | stopping)
    os.environ[SUPERVISOR] = str(leader)
    if folder:
        os.environ["TMPDIR"] = folder
    return command()


def run_supervised(command: Callable[[], int], name: str) -> NoReturn:
    """Run a command as `supervise` does, and end this process with its status.

    The process ends without the libraries' own finalisation, as everything has been written: where
    Python itself loads MPI at start-up, UCX shares descriptors with the worker, which has closed
    them, and crashes in the leader.
    """
    status = supervise(command, name)
    with suppress(OSError, ValueError, AttributeError):  # nobody reads any more
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(status)


def _open_closed_streams() -> None:
    """Let standard streams that are closed, as under some daemons, be those of the null device."""
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, number)
            if null != number:
                os.close(null)
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Let processes that are started meanwhile leave these signals to this one."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def descendants(process: int) -> list[int]:
    """Return the processes below a process, of all generations."""
    parents = _parents()
    below = {process}
    while more := {child for child, parent in parents.items() if parent in below} - below:
        below |= more
    return sorted(below - {process})


def _lead(guard: int, stopping: set[signal.Signals]) -> int:
    """Wait for a signal or the end of the guard; return the status when nothing is left."""
    while True:
        caught = signal.sigwait({*stopping, signal.SIGCHLD})
        status = _reap(guard)
        if status is None and caught in stopping:
            status = 128 + caught
        if status is not None:
            _end_descendants()
            return status


def _guard_worker(leader: int, folder: str | None) -> None:
    """Fork the worker, in which this returns, and stay behind until it or the leader has ended."""
    guard = os.getpid()
    _control_process(_SET_SUBREAPER, 1)
    _control_process(_SET_DEATH_SIGNAL, signal.SIGTERM)  # which is blocked, and waited for
    worker = os.fork()
    if not worker:
        _control_process(_SET_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != guard:  # it ended before
            os._exit(1)
        return
    status = None
    while status is None and os.getppid() == leader:
        signal.sigwait({signal.SIGTERM, signal.SIGCHLD})
        status = _reap(worker)
    _end_descendants()
    if os.getppid() != leader:
        _remove_folder(folder)
    os._exit(status or 0)


def _reap(child: int) -> int | None:
    """Collect all children that have ended; return the status of this one if it is among them."""
    found = None
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            if ended[0] == child:
                code = os.waitstatus_to_exitcode(ended[1])
                found = code if code >= 0 else 128 - code
    return found


def _end_descendants() -> None:
    """Kill all descendants of this process; those whose parents end become its children."""
    deadline = time.monotonic() + _LAST_ATTEMPT
    while time.monotonic() < deadline:
        for process in descendants(os.getpid()):
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:  # there is none any more
            return
        time.sleep(_PAUSE)


def _has_supervisor() -> bool:
    """Tell whether a process above this one supervises it."""
    supervisor, parents, process = os.environ.get(SUPERVISOR, ""), _parents(), os.getppid()
    while process and str(process) != supervisor:
        process = parents.get(process, 0)
    return bool(process)


def _parents() -> dict[int, int]:
    """Return the parent of each process that can be seen."""
    parents = {}
    for process in os.listdir("/proc"):
        if not process.isdecimal():
            continue
        with suppress(OSError), open(f"/proc/{process}/stat", "rb") as stream:  # if it is there yet
            parents[int(process)] = int(stream.read().rpartition(b")")[2].split()[1])
    return parents


def _control_process(option: int, value: int) -> None:
    import ctypes

    with suppress(AttributeError):
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _make_temporary_folder() -> str | None:
    """Return a folder for all temporary files of the command, or None where none can be made."""
    import tempfile

    try:
        return tempfile.mkdtemp(prefix="pw-elements-")
    except OSError:
        return None


def _remove_folder(folder: str | None) -> None:
    import shutil

    if folder:
        shutil.rmtree(folder, ignore_errors=True)


def _run_alone(command: Callable[[], int], name: str) -> int:
    try:
        return command()
    except KeyboardInterrupt:
        print(_farewell(name, signal.SIGINT), file=sys.stderr, flush=True)
        return 128 + signal.SIGINT


def _farewell(name: str, number: int) -> str:
    """Return the line that tells which signal ended a command, and what is kept."""
    known = {one.value for one in signal.Signals}
    what = signal.Signals(number).name if number in known else f"signal {number}"
    how = "interrupted" if number in SIGNALS else "ended"
    cause = " (out of memory?)" if number == signal.SIGKILL else ""
    kept = KEPT.get(name, "files that it has written are kept")
    return f"{name}: {how} by {what}{cause}; {kept}"


def _run_module() -> int:
    """Run the module that the first argument names."""
    module = sys.argv[1]
    del sys.argv[0]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("supervisor: name a module, as in python3 -m study.run.supervisor study")
    run_supervised(_run_module, sys.argv[1].removeprefix("study."))

"""Supervise commands, such that a signal ends all processes of a command and prints one line.

The process that the user starts (the leader) only waits; the command runs in another process (the
worker). On SIGHUP, SIGINT or SIGTERM, the leader kills all of its descendants and prints which
signal was received and which files are kept. Results are written atomically, so processes can be
killed at any time and no other code has to handle signals. PETSc, MPI, compilers, CalculiX and
Sphinx would handle signals in different ways or not at all.

A guard process between leader and worker kills the descendants if the leader itself is killed.
Leader and guard adopt orphaned descendants (`PR_SET_CHILD_SUBREAPER`), and guard and worker receive
a signal when their parents end (`PR_SET_PDEATHSIG`). On systems other than Linux, commands run
unsupervised, and only Ctrl-C gives a one-line message.

    python3 -m study.run.supervisor MODULE [ARGUMENT ...]

runs a module like `python3 -m MODULE`, but supervised.
"""

import os
import runpy
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

# Other modules are imported in functions: signals that arrive before `run_in_supervised_process`
# are not handled

SIGNALS: set[signal.Signals] = {signal.SIGHUP, signal.SIGINT, signal.SIGTERM}
"""Signals that end a command with a one-line message, unless they are ignored, as under nohup."""

RESUME_HINTS = {
    "study": "the results so far are kept, and the same command without --force computes the rest",
    "figures": "results and figures so far are kept, and the same command goes on with the rest",
    "site": "an earlier site is kept, and the same command makes it anew",
}
"""Text for each command: which files are kept if it is interrupted, and how to continue."""

SUPERVISOR = "PW_ELEMENTS_SUPERVISOR"
"""Name of the environment variable that contains the process ID of the leader."""

_SET_DEATH_SIGNAL, _SET_SUBREAPER = 1, 36  # options of prctl(2)
_MAX_KILL_SECONDS = 10.0  # processes that survive SIGKILL for longer are abandoned
_PAUSE_SECONDS = 0.002  # between two attempts to kill


def run_in_supervised_process(command: Callable[[], int], name: str) -> int:
    """Run a command in a separate process; when it ends, kill all descendants of this process.

    This process forks; call this function before MPI is initialised or threads are started. In the
    forked process, the function returns the status of the command. A command that is started within
    a supervised command is run in the current process.

    Args:
        command: Function that executes the command and returns the exit status, or raises
            SystemExit.
        name: Name of the command in messages and in `RESUME_HINTS`.

    Returns:
        Exit status of the command, or 128 plus the number of the signal that ended it.
    """
    _redirect_closed_streams_to_devnull()
    if _has_supervisor():
        return command()
    if sys.platform != "linux":
        return _run_without_supervisor(command, name)
    stopping: set[signal.Signals] = {
        number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN
    }
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*stopping, signal.SIGTERM, signal.SIGCHLD})
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # if ignored, no exit status
    _set_process_option(_SET_SUBREAPER, 1)
    sys.stdout.flush()
    sys.stderr.flush()
    leader, folder = os.getpid(), _create_temporary_folder()
    guard = os.fork()
    if guard:
        status = _wait_for_end_and_kill_descendants(guard, stopping)
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


def run_supervised_and_exit(command: Callable[[], int], name: str) -> NoReturn:
    """Run a command by `run_in_supervised_process`, and exit with its status.

    Libraries are not finalised on exit. If Python loads MPI at start-up, UCX shares file
    descriptors with the worker, which has already closed them, and finalising UCX would crash the
    leader.

    Args:
        command: Function that executes the command and returns the exit status.
        name: Name of the command in messages.
    """
    status = run_in_supervised_process(command, name)
    with suppress(OSError, ValueError, AttributeError):  # a closed pipe
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(status)


def _redirect_closed_streams_to_devnull() -> None:
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
    """Context manager that blocks `SIGNALS` in this process and in processes started within it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def list_descendants(process: int) -> list[int]:
    """Return the process IDs of all descendants of a process, in ascending order."""
    parents = _read_parent_of_each_process()
    family = {process}
    while children := {child for child, parent in parents.items() if parent in family} - family:
        family |= children
    return sorted(family - {process})


def _wait_for_end_and_kill_descendants(
    guard_process: int, stopping_signals: set[signal.Signals]
) -> int:
    """Wait until a signal arrives or the guard ends; then kill all descendants.

    Args:
        guard_process: Process ID of the guard.
        stopping_signals: Signals that end the command.

    Returns:
        Exit status of the guard, or 128 plus the number of the signal.
    """
    while True:
        caught = signal.sigwait({*stopping_signals, signal.SIGCHLD})
        status = _reap_ended_children(guard_process)
        if status is None and caught in stopping_signals:
            status = 128 + caught
        if status is not None:
            _kill_descendants()
            return status


def _start_worker_under_guard(leader: int, folder: str | None) -> None:
    """Fork the worker from the guard; this function returns in the worker only.

    The guard waits in this function until the worker or the leader has ended, kills all
    descendants, and exits.

    Args:
        leader: Process ID of the leader.
        folder: Temporary folder, which the guard removes if the leader was killed.
    """
    guard = os.getpid()
    _set_process_option(_SET_SUBREAPER, 1)
    _set_process_option(_SET_DEATH_SIGNAL, signal.SIGTERM)  # blocked, for sigwait
    worker = os.fork()
    if not worker:
        _set_process_option(_SET_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != guard:  # the guard has ended already
            os._exit(1)
        return
    status = None
    while status is None and os.getppid() == leader:
        signal.sigwait({signal.SIGTERM, signal.SIGCHLD})
        status = _reap_ended_children(worker)
    _kill_descendants()
    if os.getppid() != leader:
        _remove_folder(folder)
    os._exit(status or 0)


def _reap_ended_children(child: int) -> int | None:
    """Collect the exit statuses of all children that have ended, without waiting.

    Returns:
        Exit status of the process `child`, or 128 plus the number of the signal that killed it;
        None if it has not ended.
    """
    status = None
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            if ended[0] == child:
                code = os.waitstatus_to_exitcode(ended[1])
                status = code if code >= 0 else 128 - code
    return status


def _kill_descendants() -> None:
    """Kill all descendants of this process, including orphans that it has adopted.

    Processes that survive SIGKILL for `_MAX_KILL_SECONDS` are abandoned.
    """
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
    """Return whether an ancestor of this process is the leader of a supervised command."""
    supervisor, parents, process = (
        os.environ.get(SUPERVISOR, ""),
        _read_parent_of_each_process(),
        os.getppid(),
    )
    while process and str(process) != supervisor:
        process = parents.get(process, 0)
    return bool(process)


def _read_parent_of_each_process() -> dict[int, int]:
    """Return the process ID of the parent of each visible process, by process ID."""
    parents = {}
    for process in os.listdir("/proc"):
        if not process.isdecimal():
            continue
        with suppress(OSError), open(f"/proc/{process}/stat", "rb") as stream:  # it may have ended
            parents[int(process)] = int(stream.read().rpartition(b")")[2].split()[1])
    return parents


def _set_process_option(option: int, value: int) -> None:
    import ctypes

    with suppress(AttributeError):
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _create_temporary_folder() -> str | None:
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
    """Return a line that names the signal that ended a command, and states which files are kept."""
    numbers = {one.value for one in signal.Signals}
    signal_name = signal.Signals(number).name if number in numbers else f"signal {number}"
    verb = "interrupted" if number in SIGNALS else "ended"
    cause = " (out of memory?)" if number == signal.SIGKILL else ""
    kept = RESUME_HINTS.get(name, "files that it has written are kept")
    return f"{name}: {verb} by {signal_name}{cause}; {kept}"


def _run_module() -> int:
    """Run the module named by the first command-line argument, with the remaining arguments."""
    module = sys.argv[1]
    del sys.argv[0]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("supervisor: name a module, as in python3 -m study.run.supervisor study")
    run_supervised_and_exit(_run_module, sys.argv[1].removeprefix("study."))

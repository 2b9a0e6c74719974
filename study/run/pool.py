"""Run tasks in worker processes; a task that fails or is killed does not affect the others."""

import heapq
import importlib
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from pathlib import Path
from typing import Any, TypeAlias

from study.run.supervisor import block_signals

Channel: TypeAlias = connection.Connection


@dataclass(frozen=True)
class Task:
    """Function call that a worker process executes.

    Attributes:
        name: Name of the task.
        function: Function to call, or its name as "module:name" if only the worker should import
            it.
        arguments: Positional arguments.
        expected_seconds: Expected time in seconds; tasks that take longest start first.
    """

    name: str
    function: Callable[..., Any] | str
    arguments: tuple[Any, ...] = ()
    expected_seconds: float = 0.0


@dataclass(frozen=True)
class TaskFailure:
    """Outcome of a task that raised an exception.

    Attributes:
        message: One-line description of the exception.
    """

    message: str


@dataclass(frozen=True)
class TaskKilled:
    """Outcome of a task whose worker process was killed, e.g. because it ran out of memory."""


class Pool:
    """Pool of worker processes; iterating over it yields each completed task and its outcome.

    The outcome is the value that the function returns, a `TaskFailure` or a `TaskKilled`. Tasks can
    be added during the iteration. Workers block signals, and exit when this process does.

    Args:
        max_processes: Maximum number of worker processes, which are started on demand.
    """

    def __init__(self, max_processes: int) -> None:
        self._max_processes = max_processes
        self._queue: list[tuple[float, int, Task]] = []
        self._n_submitted = 0
        self._idle_workers: list[_Worker] = []
        self._busy_workers: dict[Channel, tuple[_Worker, Task]] = {}
        ignore_broken_pipe_signal()

    def submit(self, task: Task) -> None:
        """Add a task; it starts during the iteration, before tasks of smaller expected time."""
        heapq.heappush(self._queue, (-task.expected_seconds, self._n_submitted, task))
        self._n_submitted += 1

    def __iter__(self) -> Iterator[tuple[Task, object]]:
        try:
            while self._queue or self._busy_workers:
                self._assign_tasks()
                ready = connection.wait(list(self._busy_workers))
                for channel in [channel for channel in self._busy_workers if channel in ready]:
                    worker, task = self._busy_workers.pop(channel)
                    outcome = worker.wait_for_outcome()
                    if isinstance(outcome, TaskKilled):
                        worker.kill()
                    else:
                        self._idle_workers.append(worker)
                    yield task, outcome
        finally:
            for worker, _ in self._busy_workers.values():
                worker.kill()
            for worker in self._idle_workers:
                worker.channel.close()
            for worker in self._idle_workers:
                worker.stop()
            self._idle_workers, self._busy_workers = [], {}

    def _assign_tasks(self) -> None:
        """Assign queued tasks to idle workers, or to new ones up to the maximum number."""
        while self._queue and len(self._busy_workers) < self._max_processes:
            worker = self._idle_workers.pop() if self._idle_workers else _Worker()
            task = self._queue[0][-1]
            if worker.assign(task):
                heapq.heappop(self._queue)
                self._busy_workers[worker.channel] = (worker, task)
            else:  # it was killed while idle
                worker.kill()


class _Worker:
    """Worker process that executes one task at a time, and the pipe for communicating with it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")  # MPI does not survive a fork
        self.channel: Channel
        self.channel, worker_channel = context.Pipe()
        self._process = context.Process(
            target=_run_tasks_until_channel_closes, args=(worker_channel,), daemon=True
        )
        resource_tracker.ensure_running()  # otherwise start() does, and unblocks Ctrl-C
        try:
            with block_signals():  # the process inherits this
                self._process.start()
        finally:
            worker_channel.close()

    def assign(self, task: Task) -> bool:
        """Send a task to the worker; return False if the worker process has ended."""
        try:
            self.channel.send((task.function, task.arguments))
        except OSError:
            return False
        return True

    def wait_for_outcome(self) -> object:
        """Wait for the end of the task; return its outcome, or `TaskKilled`."""
        try:
            return self.channel.recv()
        except (EOFError, OSError):
            return TaskKilled()

    def stop(self) -> None:
        """End an idle worker by closing its pipe; kill it if it has not ended in 10 seconds."""
        self.channel.close()
        self._process.join(10)
        self.kill()

    def kill(self) -> None:
        """Kill the worker process by SIGKILL, because PETSc prints messages on other signals."""
        self.channel.close()
        self._process.kill()
        self._process.join()


def ignore_broken_pipe_signal() -> None:
    """Ignore the signal SIGPIPE, which PETSc treats as a crash.

    Writing to a closed pipe then raises BrokenPipeError.
    """
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)


def format_error_line(error: BaseException) -> str:
    """Return a one-line description of an exception, including its file and line number."""
    lines = str(error).strip().splitlines()
    frame = traceback.extract_tb(error.__traceback__)[-1]
    message = f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
    return f"{message} ({Path(frame.filename).name}, line {frame.lineno})"


def _run_tasks_until_channel_closes(channel: Channel) -> None:
    """Execute tasks in a worker process until the main process ends or closes the pipe.

    Args:
        channel: End of the pipe from which tasks are read and to which outcomes are written.
    """
    threading.Thread(target=_exit_when_parent_ends, daemon=True).start()
    while True:
        try:
            outcome = _receive_and_run_task(channel)
            ignore_broken_pipe_signal()  # again, as PETSc may have been imported
            channel.send(outcome)
        except (EOFError, OSError):
            return


def _receive_and_run_task(channel: Channel) -> object:
    data = channel.recv_bytes()
    try:
        function, arguments = pickle.loads(data)
        if isinstance(function, str):
            module, _, name = function.partition(":")
            function = getattr(importlib.import_module(module), name)
        return function(*arguments)
    except Exception as error:
        return TaskFailure(format_error_line(error))


def _exit_when_parent_ends() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

"""Run tasks in worker processes, such that a failed or killed task does not affect the others."""

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
    """Function call to be executed by a worker process, which imports the function's module.

    Attributes:
        name: Name of the task.
        function: Function to call, or "module:name" if only the worker should import the module.
        arguments: Arguments of the call.
        cost: Expected seconds; the longest tasks start first.
    """

    name: str
    function: Callable[..., Any] | str
    arguments: tuple[Any, ...] = ()
    cost: float = 0.0


@dataclass(frozen=True)
class TaskFailure:
    """Outcome of a task that raised an exception.

    Attributes:
        message: Description of the exception in one line.
    """

    message: str


@dataclass(frozen=True)
class TaskKilled:
    """Outcome of a task whose process was killed."""


class Pool:
    """Pool of worker processes; iteration yields each completed task with its outcome.

    Tasks can be added during the iteration. Workers do not handle signals, and they exit when this
    process does.

    Args:
        processes: Maximum number of processes, which are started on demand.
    """

    def __init__(self, processes: int) -> None:
        self._max_processes = processes
        self._queue: list[tuple[float, int, Task]] = []
        self._n_submitted = 0
        self._idle_workers: list[_Worker] = []
        self._busy_workers: dict[Channel, tuple[_Worker, Task]] = {}
        ignore_broken_pipe_signal()

    def submit(self, task: Task) -> None:
        """Add a task to the queue."""
        heapq.heappush(self._queue, (-task.cost, self._n_submitted, task))
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
    """Worker process and the channel for communicating with it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")  # MPI does not survive a fork
        self.channel: Channel
        self.channel, worker_channel = context.Pipe()
        self._process = context.Process(target=_run_worker, args=(worker_channel,), daemon=True)
        resource_tracker.ensure_running()  # otherwise start() does, and unblocks Ctrl-C
        try:
            with block_signals():  # the process inherits this
                self._process.start()
        finally:
            worker_channel.close()

    def assign(self, task: Task) -> bool:
        """Send a task to the worker; return False if its process has ended."""
        try:
            self.channel.send((task.function, task.arguments))
        except OSError:
            return False
        return True

    def wait_for_outcome(self) -> object:
        """Wait for the end of the task and return its outcome."""
        try:
            return self.channel.recv()
        except (EOFError, OSError):
            return TaskKilled()

    def stop(self) -> None:
        """Stop the worker process, which must be idle."""
        self.channel.close()
        self._process.join(10)
        self.kill()

    def kill(self) -> None:
        """Kill the worker process; on any other signal, PETSc would print messages."""
        self.channel.close()
        self._process.kill()
        self._process.join()


def ignore_broken_pipe_signal() -> None:
    """Ignore SIGPIPE, which PETSc treats as a crash; writing to a closed pipe then fails."""
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)


def format_error_line(error: BaseException) -> str:
    """Return a one-line description of an exception, including its file and line number."""
    lines = str(error).strip().splitlines()
    frame = traceback.extract_tb(error.__traceback__)[-1]
    message = f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
    return f"{message} ({Path(frame.filename).name}, line {frame.lineno})"


def _run_worker(channel: Channel) -> None:
    """Run tasks until the main process closes the channel or ends."""
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    while True:
        try:
            outcome = _run_task(channel)
            ignore_broken_pipe_signal()  # again, as PETSc may have been imported
            channel.send(outcome)
        except (EOFError, OSError):
            return


def _run_task(channel: Channel) -> object:
    data = channel.recv_bytes()
    try:
        function, arguments = pickle.loads(data)
        if isinstance(function, str):
            module, _, name = function.partition(":")
            function = getattr(importlib.import_module(module), name)
        return function(*arguments)
    except Exception as error:
        return TaskFailure(format_error_line(error))


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

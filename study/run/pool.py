"""Tasks in worker processes: one that fails or is killed costs no other, nor does it wait."""

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

from study.run.supervisor import signals_blocked

Channel: TypeAlias = connection.Connection


@dataclass(frozen=True)
class Task:
    """A call of a function of a module: workers import it.

    Attributes:
        name: What it is for.
        function: The function; or "module:name" of one that this process need not import.
        arguments: What it is called with.
        cost: Expected seconds: the longest starts first.
    """

    name: str
    function: Callable[..., Any] | str
    arguments: tuple[Any, ...] = ()
    cost: float = 0.0


@dataclass(frozen=True)
class Failed:
    """Outcome of a task that raised an exception.

    Attributes:
        why: The exception in one line.
    """

    why: str


@dataclass(frozen=True)
class Killed:
    """Outcome of a task whose process ended under it."""


class Pool:
    """Worker processes; iterating gives each task as it ends, with its outcome.

    Tasks may be added meanwhile. Workers leave signals to this process, and end with it.

    Args:
        processes: How many there may be; they start as there is work.
    """

    def __init__(self, processes: int) -> None:
        self._most = processes
        self._waiting: list[tuple[float, int, Task]] = []
        self._count = 0
        self._idle: list[_Worker] = []
        self._busy: dict[Channel, tuple[_Worker, Task]] = {}
        ignore_broken_pipes()

    def submit(self, task: Task) -> None:
        """Add a task."""
        heapq.heappush(self._waiting, (-task.cost, self._count, task))
        self._count += 1

    def __iter__(self) -> Iterator[tuple[Task, object]]:
        try:
            while self._waiting or self._busy:
                self._start()
                ready = connection.wait(list(self._busy))
                for channel in [channel for channel in self._busy if channel in ready]:
                    worker, task = self._busy.pop(channel)
                    outcome = worker.outcome()
                    if isinstance(outcome, Killed):
                        worker.kill()
                    else:
                        self._idle.append(worker)
                    yield task, outcome
        finally:
            for worker, _ in self._busy.values():
                worker.kill()
            for worker in self._idle:
                worker.channel.close()
            for worker in self._idle:
                worker.end()
            self._idle, self._busy = [], {}

    def _start(self) -> None:
        """Give waiting tasks to workers that have none."""
        while self._waiting and len(self._busy) < self._most:
            worker = self._idle.pop() if self._idle else _Worker()
            task = self._waiting[0][-1]
            if worker.give(task):
                heapq.heappop(self._waiting)
                self._busy[worker.channel] = (worker, task)
            else:  # killed while it had nothing to do
                worker.kill()


class _Worker:
    """A process, and the channel to it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")  # MPI does not survive a fork
        self.channel: Channel
        self.channel, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs,), daemon=True)
        resource_tracker.ensure_running()  # which would unblock Ctrl-C
        try:
            with signals_blocked():  # the process inherits it from its first moment on
                self._process.start()
        finally:
            theirs.close()

    def give(self, task: Task) -> bool:
        """Hand a task over; return whether the process is still there."""
        try:
            self.channel.send((task.function, task.arguments))
        except OSError:
            return False
        return True

    def outcome(self) -> object:
        """Return what became of the task."""
        try:
            return self.channel.recv()
        except (EOFError, OSError):
            return Killed()

    def end(self) -> None:
        """Let the process end, which has nothing to do."""
        self.channel.close()
        self._process.join(10)
        self.kill()

    def kill(self) -> None:
        """End the process, whatever it does; PETSc has words for any other signal."""
        self.channel.close()
        self._process.kill()
        self._process.join()


def ignore_broken_pipes() -> None:
    """Have writing fail where nobody reads: PETSc takes the signal for a crash, and aborts."""
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)


def one_line(error: BaseException) -> str:
    """Return an exception and its place in one line."""
    lines = str(error).strip().splitlines()
    place = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
    return f"{what} ({Path(place.filename).name}, line {place.lineno})"


def _work(channel: Channel) -> None:
    """Do tasks as they come, until the main process closes the channel or is no more."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            outcome = _done(channel)
            ignore_broken_pipes()  # once a task may have imported PETSc
            channel.send(outcome)
        except (EOFError, OSError):
            return


def _done(channel: Channel) -> object:
    data = channel.recv_bytes()
    try:
        function, arguments = pickle.loads(data)
        if isinstance(function, str):
            module, _, name = function.partition(":")
            function = getattr(importlib.import_module(module), name)
        return function(*arguments)
    except Exception as error:
        return Failed(one_line(error))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

"""Compute cases, several at a time, and store each result as soon as it is there."""

import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tqdm import tqdm

from study.core.cases import Case, Section, fingerprint
from study.core.provenance import provenance
from study.core.store import CorruptResult, Results, discard, save

Validity = Literal["stored", "outdated", "missing", "corrupt"]
Task = tuple[Case, str]  # with its fingerprint, taken before anything runs


@dataclass(frozen=True)
class Done:
    """How the computation of a case ended.

    Attributes:
        cost: Its time and size in words.
        error: What it failed with, in one line; empty if it did not.
    """

    cost: str = ""
    error: str = ""


def state(case: Case, results: Results) -> Validity:
    """Tell whether a case has a stored result, and whether it still holds."""
    if case.key not in results:
        return "missing"
    try:
        stored = results[case.key]
    except CorruptResult:
        return "corrupt"
    return "stored" if stored.provenance.get("fingerprint") == fingerprint(case) else "outdated"


def discard_others(section: Section, out: Path) -> None:
    """Remove results that are no case of their section any more: measures would count them."""
    known = {case.name for case in section.cases}
    for stored in set(Results(out).cases(section.id)) - known:
        discard(out, section.id, stored)


def run(cases: list[Case], out: Path, jobs: int, force: bool) -> list[str]:
    """Compute the cases whose stored results do not hold; report on stderr as they finish.

    Args:
        cases: All that are wanted.
        out: Folder of the results.
        jobs: Number of processes; if it is 1, the cases run in this one.
        force: Compute also what is stored and holds.

    Returns:
        Keys of the cases that did not finish. Their old results are removed: they would pass for
        results of this run.
    """
    progress = _Progress(cases)
    results = Results(out)
    todo = []
    for case in cases:
        before = state(case, results)
        if before == "corrupt":
            progress.note(f"{case.key}: its stored result cannot be read and is computed again")
        if before == "stored" and not force:
            progress.ended(case, "  reused")
        else:
            todo.append((case, fingerprint(case)))
    failed, unfinished = [], []
    for case, done in _serial(todo, out) if jobs == 1 else _parallel(todo, out, jobs):
        if done is None:
            unfinished.append(case.key)
        elif done.error:
            failed.append(case.key)
            progress.ended(case, f"  failed: {done.error}")
        else:
            progress.ended(case, done.cost)
        if done is None or done.error:
            discard(out, case.section, case.name)
    if unfinished:
        progress.note(
            "a worker process was killed (out of memory?), unfinished: " + ", ".join(unfinished)
        )
    progress.close()
    return failed + unfinished


def compute(case: Case, mark: str, out: Path) -> Done:
    """Run one case and store its result under its fingerprint; an exception becomes one line."""
    try:
        start = time.perf_counter()
        result = case.run(**case.parameters)
        seconds = time.perf_counter() - start
        origin = provenance(seconds, result.dofs, result.processes, mark)
        save(out, case.section, case.name, result, case.stored_parameters, origin)
    except Exception as error:
        return Done(error=_one_line(error))
    cost = f"{seconds:7.2f} s {result.dofs:6d} dofs"
    if "iterations" in result.scalars:
        cost += f" {result.scalars['iterations']:4.0f} iterations"
    return Done(cost)


class _Progress:
    """Lines about cases on stderr, above a bar if it is a terminal."""

    def __init__(self, cases: list[Case]) -> None:
        self.total, self.count = len(cases), 0
        self.width = max((len(case.key) for case in cases), default=0)
        terminal = sys.stderr.isatty()
        self.bar = tqdm(total=self.total, file=sys.stderr, disable=not terminal, leave=False)

    def note(self, line: str) -> None:
        self.bar.write(line, file=sys.stderr)

    def ended(self, case: Case, how: str) -> None:
        self.count += 1
        digits = len(str(self.total))
        self.note(f"[{self.count:{digits}}/{self.total}] {case.key:{self.width}} {how}")
        self.bar.update()

    def close(self) -> None:
        self.bar.close()


def _serial(todo: list[Task], out: Path) -> Iterator[tuple[Case, Done | None]]:
    for case, mark in todo:
        yield case, compute(case, mark, out)


def _parallel(todo: list[Task], out: Path, jobs: int) -> Iterator[tuple[Case, Done | None]]:
    """Yield the cases as they end, with None for one whose worker process was killed."""
    if not todo:
        return
    context = multiprocessing.get_context("spawn")  # MPI does not survive a fork
    pool = ProcessPoolExecutor(min(jobs, len(todo)), context)
    futures: dict[Future[Done], Case] = {}
    try:
        # workers start within submit and inherit this: Ctrl-C is handled here, once
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            for case, mark in todo:
                futures[pool.submit(compute, case, mark, out)] = case
        except BrokenProcessPool:
            pass  # what was not submitted comes last
        finally:
            signal.signal(signal.SIGINT, handler)
        for future in as_completed(futures):
            try:
                yield futures[future], future.result()
            except BrokenProcessPool:
                yield futures[future], None
        for case, _ in todo[len(futures) :]:
            yield case, None
    except BaseException:
        for worker in multiprocessing.active_children():
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _one_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    place = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
    return f"{what} ({Path(place.filename).name}, line {place.lineno})"

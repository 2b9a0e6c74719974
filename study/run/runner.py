"""Compute cases, several at a time, and store each result as soon as it is there."""

import logging
import math
import sys
import time
from collections import Counter
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from study.run.cases import Case, Section, fingerprints, title
from study.run.expected import expected
from study.run.jit import unblocked
from study.run.pool import Failed, Killed, Pool, Task, one_line
from study.run.provenance import provenance
from study.run.store import (
    CorruptResult,
    OutdatedResult,
    Result,
    Results,
    discard,
    is_result,
    save,
    sweep,
)

# Cases run beside each other: their lines on what goes on would cross those of the runner, and that
# the paper's displacements are not small is no news in each of several hundred
logging.getLogger("pw_elements").addHandler(logging.NullHandler())

STRAY = "is the result of no case, and cannot be read: move it away"
PATIENCE = 20  # times that a case is tried again because another process compiles what it needs

Validity = Literal["stored", "outdated", "missing", "corrupt"]
Todo = tuple[Case, str]  # with its fingerprint, taken before anything runs


@dataclass(frozen=True)
class Done:
    """How the computation of a case ended.

    Attributes:
        seconds: What it took.
        error: What it failed with, in one line; empty if it did not.
    """

    seconds: float = 0.0
    error: str = ""


@dataclass(frozen=True)
class Beside:
    """What several processes do beside the cases, by functions as "module:name".

    Attributes:
        shared: Gives arguments for `prepare`, for each thing that many cases share.
        prepare: Makes one of them ready, before the cases.
        needs: Gives the keys of results that each drawing needs, by its name.
        draw: Makes one, given its name and the folder of results, as soon as they are there. It
            tells nothing: who draws all of them afterwards finds these done, or the fault again.
    """

    shared: str
    prepare: str
    needs: str
    draw: str


def states(cases: list[Case], results: Results) -> dict[str, Validity]:
    """Tell, by keys, whether cases have a stored result, and whether it still holds."""
    marks = fingerprints(cases)
    recomputed = _fingerprints_of_recomputed(cases)
    return {key: _state(key, {mark, recomputed.get(key)}, results) for key, mark in marks.items()}


def _fingerprints_of_recomputed(cases: list[Case]) -> dict[str, str]:
    """Return, by keys, fingerprints of recorded results that `--all` has computed."""
    return fingerprints([case.recomputed for case in cases if case.recomputed])


def _state(key: str, marks: set[str | None], results: Results) -> Validity:
    if key not in results:
        return "missing"
    try:
        stored = results[key]
    except OutdatedResult:
        return "outdated"
    except CorruptResult:
        return "corrupt"
    return "stored" if stored.provenance.get("fingerprint") in marks else "outdated"


def discard_others(section: Section, out: Path) -> None:
    """Remove results that are no case of their section any more: measures would count them.

    Files that are no results stay, and are named.
    """
    known = {case.name for case in section.cases}
    for stored in sorted(set(Results(out).cases(section.id)) - known):
        path = out / section.id / f"{stored}.json"
        if is_result(path):
            discard(out, section.id, stored)
        else:
            _say(f"{path} {STRAY}")


def run(
    cases: list[Case], out: Path, jobs: int, force: bool, beside: Beside | None = None
) -> list[str]:
    """Compute the cases whose stored results do not hold; tell on stderr of sections as they end.

    Sections come in their order, and within one the longest case first.

    Args:
        cases: All that are wanted.
        out: Folder of the results.
        jobs: Number of processes; if it is 1, the cases run in this one.
        force: Compute also what is stored and holds.
        beside: What several processes do besides.

    Returns:
        Keys of the cases that did not finish. An old result of theirs is kept if it holds, and
        else removed: it would pass for one of this run.
    """
    sweep(out)
    results = Results(out)
    marks = fingerprints(cases)
    recomputed = _fingerprints_of_recomputed(cases)
    todo, holds = [], set()
    for case in cases:
        before = _state(case.key, {marks[case.key], recomputed.get(case.key)}, results)
        if before == "corrupt":
            _say(f"{case.key}: its stored result cannot be read and is computed again")
        if before == "stored":
            holds.add(case.key)
        if before != "stored" or force:
            todo.append((case, marks[case.key]))
    reused = f"{len(cases) - len(todo)} of {len(cases)} results are reused"
    recorded = sum(bool(case.record) for case, _ in todo)
    parts = [f"{len(todo) - recorded} to be computed"] if len(todo) > recorded else []
    parts += [f"{recorded} to be read from tracked records"] if recorded else []
    _say("; ".join([reused, *parts]))
    progress = _Progress([case for case, _ in todo])
    seconds = expected(results)
    order = list(progress.open)
    todo.sort(key=lambda one: (order.index(one[0].section), -seconds.get(one[0].key, 0.0)))
    failed, unfinished = [], []
    if jobs == 1:
        ended = _serial(todo, out)
    else:
        ready = {case.key for case in cases} - {case.key for case, _ in todo}
        ended = _parallel(todo, out, jobs, beside, ready)
    with closing(ended):  # and with it the processes, if this one is interrupted
        for case, done in ended:
            if done is None:
                unfinished.append(case.key)
            elif done.error:
                failed.append(case.key)
                kept = "; its stored result still holds and is kept" if case.key in holds else ""
                _say(f"{case.key}: failed: {done.error}{kept}")
            if (done is None or done.error) and case.key not in holds:
                discard(out, case.section, case.name)
            progress.ended(case, done)
    if unfinished:
        _say("a worker process was killed (out of memory?), unfinished: " + ", ".join(unfinished))
    return failed + unfinished


def compute(case: Case, mark: str, out: Path) -> Done:
    """Run one case and store its result under its fingerprint; an exception becomes one line."""
    try:
        start = time.perf_counter()
        result = _result(case)
        seconds = time.perf_counter() - start
        origin = provenance(seconds, result.dofs, result.processes, mark, case.record)
        save(out, case.section, case.name, result, case.stored_parameters, origin)
    except Exception as error:
        return Done(error=one_line(error))
    return Done(seconds)


def _result(case: Case) -> Result:
    for _ in range(PATIENCE):
        try:
            return case.run(**case.parameters)
        except Exception as error:
            if not unblocked(error):
                raise
    return case.run(**case.parameters)


class _Progress:
    """Tells of each section when its last case has ended, but in the order of the sections."""

    def __init__(self, cases: list[Case]) -> None:
        sections = [case.section for case in cases]
        self.open = {section: sections.count(section) for section in dict.fromkeys(sections)}
        self.seconds: dict[str, list[float]] = {section: [] for section in self.open}
        self.recorded: Counter[str] = Counter()
        self.lost: dict[str, Counter[str]] = {section: Counter() for section in self.open}

    def ended(self, case: Case, done: Done | None) -> None:
        self.open[case.section] -= 1
        if done and not done.error and case.record:
            self.recorded[case.section] += 1
        elif done and not done.error:
            self.seconds[case.section].append(done.seconds)
        else:  # a case whose process was killed has not failed
            self.lost[case.section]["failed" if done else "unfinished"] += 1
        while self.open and not next(iter(self.open.values())):
            section = next(iter(self.open))
            del self.open[section]
            seconds = self.seconds[section]
            lost = "".join(f", {count} {how}" for how, count in self.lost[section].items())
            recorded = self.recorded[section]
            computed = f"{len(seconds)} computed in {sum(seconds):.1f} s"
            parts = [computed] if seconds or not recorded else []
            parts += [f"{recorded} read from tracked records"] if recorded else []
            _say(f"{section:4} {title(section)}: {', '.join(parts)}{lost}")


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _serial(todo: list[Todo], out: Path) -> Generator[tuple[Case, Done | None]]:
    for case, mark in todo:
        yield case, compute(case, mark, out)


def _parallel(
    todo: list[Todo],
    out: Path,
    jobs: int,
    beside: Beside | None,
    ready: set[str],
) -> Generator[tuple[Case, Done | None]]:
    """Yield the cases as they end, with None for one whose worker process was killed."""
    if not todo:
        return
    pool = Pool(jobs)
    drawings = _Drawings(ready)
    if beside:
        if len(todo) > jobs:
            pool.submit(Task(_SHARED, beside.shared, (), math.inf))
        pool.submit(Task(_NEEDS, beside.needs, (), 1.0))
    cases = {case.key: case for case, _ in todo}
    for case, mark in todo:
        pool.submit(Task(case.key, compute, (case, mark, out)))
    for task, outcome in pool:
        if task.name in cases:
            done = _ended(outcome)
            if done and not done.error:
                ready.add(task.name)
            yield cases[task.name], done
        elif beside and task.name == _SHARED and isinstance(outcome, list):
            for arguments in outcome:
                pool.submit(Task("prepare", beside.prepare, arguments, math.inf))
        elif task.name == _NEEDS and isinstance(outcome, dict):
            drawings.waiting = outcome
        for name in drawings.possible():
            assert beside is not None
            pool.submit(Task("draw", beside.draw, (name, out.resolve())))


# None of these names is the key of a case, which has a slash
_SHARED, _NEEDS = "shared", "needs"


class _Drawings:
    """Which drawings still wait for results."""

    def __init__(self, ready: set[str]) -> None:
        self.ready = ready
        self.waiting: dict[str, list[str]] = {}

    def possible(self) -> list[str]:
        """Return those whose results are all there, each once."""
        now = [name for name, keys in self.waiting.items() if self.ready.issuperset(keys)]
        for name in now:
            del self.waiting[name]
        return now


def _ended(outcome: object) -> Done | None:
    if isinstance(outcome, Failed):  # before the case began
        return Done(error=outcome.why)
    if isinstance(outcome, Killed):
        return None
    assert isinstance(outcome, Done)
    return outcome

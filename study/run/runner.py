"""Compute cases in parallel, and store each result as soon as it is computed."""

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

from study.run.cases import Case, Section, compute_fingerprints, title
from study.run.expected import expected_seconds
from study.run.jit import recover_from_jit_conflict
from study.run.pool import Pool, Task, TaskFailure, TaskKilled, format_error_line
from study.run.provenance import create_provenance
from study.run.store import (
    CorruptResult,
    OutdatedResult,
    Result,
    Results,
    discard,
    is_result_file,
    remove_unfinished_files,
    save,
)

# Log lines of parallel cases would be interleaved with those of the runner, and several hundred
# cases would warn that displacements are not small
logging.getLogger("pw_elements").addHandler(logging.NullHandler())

STRAY = "is the result of no case, and cannot be read: move it away"
MAX_COMPILATION_ATTEMPTS = 20
"""Maximum number of attempts at a case while another process compiles the same form."""

Validity = Literal["stored", "outdated", "missing", "corrupt"]
CaseToRun = tuple[Case, str]
"""A case and its fingerprint, which was computed before any case ran."""


@dataclass(frozen=True)
class CaseOutcome:
    """Outcome of the computation of a case.

    Attributes:
        seconds: Wall time in seconds.
        error: Description of the error in one line; empty if the case succeeded.
    """

    seconds: float = 0.0
    error: str = ""


@dataclass(frozen=True)
class ParallelTasks:
    """Further tasks of the worker processes, given by names of functions ("module:name").

    Only the worker processes import these functions.

    Attributes:
        list_preparations: Function that returns the arguments of each call of `prepare`.
        prepare: Function that prepares something that many cases share; it is called before the
            cases run.
        list_needs: Function that returns, by name of figure, the keys of the results that each
            figure needs. Empty if no figures are drawn.
        draw: Function that draws a figure, given its name and the folder of results. It is called
            as soon as the results that the figure needs are stored. Errors are ignored, because
            they occur again when all figures are drawn.
    """

    list_preparations: str
    prepare: str
    list_needs: str = ""
    draw: str = ""


def states(cases: list[Case], results: Results) -> dict[str, Validity]:
    """Return, for the key of each case, whether a result is stored and whether it is outdated."""
    current = compute_fingerprints(cases)
    recomputed = _fingerprints_of_recomputed(cases)
    return {
        key: _case_state(key, {fingerprint, recomputed.get(key)}, results)
        for key, fingerprint in current.items()
    }


def _fingerprints_of_recomputed(cases: list[Case]) -> dict[str, str]:
    """Return, by key, the fingerprints that recorded results have if `--all` computes them."""
    return compute_fingerprints([case.recomputed for case in cases if case.recomputed])


def _case_state(key: str, valid_fingerprints: set[str | None], results: Results) -> Validity:
    if key not in results:
        return "missing"
    try:
        stored = results[key]
    except OutdatedResult:
        return "outdated"
    except CorruptResult:
        return "corrupt"
    return "stored" if stored.provenance.get("fingerprint") in valid_fingerprints else "outdated"


def discard_others(section: Section, out: Path) -> None:
    """Remove the results of cases that a section no longer has, which measures would include.

    Files that are not results are kept and reported.
    """
    case_names = {case.name for case in section.cases}
    for stored in sorted(set(Results(out).cases(section.id)) - case_names):
        path = out / section.id / f"{stored}.json"
        if is_result_file(path):
            discard(out, section.id, stored)
        else:
            _print_progress(f"{path} {STRAY}")


def run(
    cases: list[Case], out: Path, jobs: int, force: bool, tasks: ParallelTasks | None = None
) -> list[str]:
    """Compute cases without a valid stored result; report each completed section on stderr.

    Sections are computed in their order, and the cases of a section by decreasing expected time.

    Args:
        cases: The cases.
        out: Folder of the results.
        jobs: Number of processes; if it is 1, the cases run in the current process.
        force: Whether to compute all cases, including those with a valid stored result.
        tasks: Further tasks, which are executed only if there are several processes.

    Returns:
        Keys of the cases that did not finish. An earlier result of such a case is kept if it is
        valid and removed otherwise.
    """
    remove_unfinished_files(out)
    results = Results(out)
    current_fingerprints = compute_fingerprints(cases)
    recomputed = _fingerprints_of_recomputed(cases)
    to_run, valid_keys = [], set()
    for case in cases:
        state = _case_state(
            case.key, {current_fingerprints[case.key], recomputed.get(case.key)}, results
        )
        if state == "corrupt":
            _print_progress(f"{case.key}: its stored result cannot be read and is computed again")
        if state == "stored":
            valid_keys.add(case.key)
        if state != "stored" or force:
            to_run.append((case, current_fingerprints[case.key]))
    reused = f"{len(cases) - len(to_run)} of {len(cases)} results are reused"
    recorded = sum(bool(case.record) for case, _ in to_run)
    parts = [f"{len(to_run) - recorded} to be computed"] if len(to_run) > recorded else []
    parts += [f"{recorded} to be read from tracked records"] if recorded else []
    _print_progress("; ".join([reused, *parts]))
    progress = _Progress([case for case, _ in to_run])
    seconds = expected_seconds(results)
    order = list(progress.open)
    to_run.sort(key=lambda item: (order.index(item[0].section), -seconds.get(item[0].key, 0.0)))
    failed, unfinished = [], []
    if jobs == 1:
        ended = _run_serially(to_run, out)
    else:
        ready = {case.key for case in cases} - {case.key for case, _ in to_run}
        ended = _run_in_parallel(to_run, out, jobs, tasks, ready)
    with closing(ended):  # ends the worker processes if this process is interrupted
        for case, outcome in ended:
            if outcome is None:
                unfinished.append(case.key)
            elif outcome.error:
                failed.append(case.key)
                kept = (
                    "; its stored result still holds and is kept" if case.key in valid_keys else ""
                )
                _print_progress(f"{case.key}: failed: {outcome.error}{kept}")
            if (outcome is None or outcome.error) and case.key not in valid_keys:
                discard(out, case.section, case.name)
            progress.record_end(case, outcome)
    if unfinished:
        _print_progress(
            "a worker process was killed (out of memory?), unfinished: " + ", ".join(unfinished)
        )
    return failed + unfinished


def compute_case(case: Case, fingerprint: str, out: Path) -> CaseOutcome:
    """Run one case and store its result with its fingerprint; return the time or the error."""
    try:
        start = time.perf_counter()
        result = _run_until_compiled(case)
        seconds = time.perf_counter() - start
        origin = create_provenance(seconds, result.dofs, result.processes, fingerprint, case.record)
        save(out, case.section, case.name, result, case.stored_parameters, origin)
    except Exception as error:
        return CaseOutcome(error=format_error_line(error))
    return CaseOutcome(seconds)


def _run_until_compiled(case: Case) -> Result:
    for _ in range(MAX_COMPILATION_ATTEMPTS):
        try:
            return case.run(**case.parameters)
        except Exception as error:
            if not recover_from_jit_conflict(error):
                raise
    return case.run(**case.parameters)


class _Progress:
    """Progress report with one line per completed section, in the order of the sections."""

    def __init__(self, cases: list[Case]) -> None:
        sections = [case.section for case in cases]
        self.open = {section: sections.count(section) for section in dict.fromkeys(sections)}
        self.seconds: dict[str, list[float]] = {section: [] for section in self.open}
        self.recorded: Counter[str] = Counter()
        self.lost: dict[str, Counter[str]] = {section: Counter() for section in self.open}

    def record_end(self, case: Case, outcome: CaseOutcome | None) -> None:
        self.open[case.section] -= 1
        if outcome and not outcome.error and case.record:
            self.recorded[case.section] += 1
        elif outcome and not outcome.error:
            self.seconds[case.section].append(outcome.seconds)
        else:  # a case whose process was killed has not failed
            self.lost[case.section]["failed" if outcome else "unfinished"] += 1
        while self.open and not next(iter(self.open.values())):
            section = next(iter(self.open))
            del self.open[section]
            seconds = self.seconds[section]
            lost = "".join(f", {count} {how}" for how, count in self.lost[section].items())
            recorded = self.recorded[section]
            computed = f"{len(seconds)} computed in {sum(seconds):.1f} s"
            parts = [computed] if seconds or not recorded else []
            parts += [f"{recorded} read from tracked records"] if recorded else []
            _print_progress(f"{section:4} {title(section)}: {', '.join(parts)}{lost}")


def _print_progress(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _run_serially(to_run: list[CaseToRun], out: Path) -> Generator[tuple[Case, CaseOutcome | None]]:
    for case, fingerprint in to_run:
        yield case, compute_case(case, fingerprint, out)


def _run_in_parallel(
    to_run: list[CaseToRun],
    out: Path,
    jobs: int,
    tasks: ParallelTasks | None,
    ready: set[str],
) -> Generator[tuple[Case, CaseOutcome | None]]:
    """Yield each case with its outcome as it ends; the outcome is None if its worker was killed."""
    if not to_run:
        return
    pool = Pool(jobs)
    drawings = _PendingDrawings(ready)
    if tasks and len(to_run) > jobs:
        pool.submit(Task(_PREPARATIONS, tasks.list_preparations, (), math.inf))
    if tasks and tasks.list_needs:
        pool.submit(Task(_NEEDS, tasks.list_needs, (), 1.0))
    cases = {case.key: case for case, _ in to_run}
    for case, fingerprint in to_run:
        pool.submit(Task(case.key, compute_case, (case, fingerprint, out)))
    for task, outcome in pool:
        if task.name in cases:
            case_outcome = _case_outcome(outcome)
            if case_outcome and not case_outcome.error:
                ready.add(task.name)
            yield cases[task.name], case_outcome
        elif tasks and task.name == _PREPARATIONS and isinstance(outcome, list):
            for arguments in outcome:
                pool.submit(Task("prepare", tasks.prepare, arguments, math.inf))
        elif task.name == _NEEDS and isinstance(outcome, dict):
            drawings.waiting = outcome
        elif task.name in (_PREPARATIONS, _NEEDS) and isinstance(outcome, TaskFailure):
            _print_progress(f"{task.name} of parallel tasks: {outcome.message}")
        for name in drawings.take_ready():
            assert tasks is not None
            pool.submit(Task("draw", tasks.draw, (name, out.resolve())))


# These names cannot coincide with keys of cases, which contain a slash
_PREPARATIONS, _NEEDS = "preparations", "needs"


class _PendingDrawings:
    """Drawings that are waiting for the results they need."""

    def __init__(self, ready: set[str]) -> None:
        self.ready = ready
        self.waiting: dict[str, list[str]] = {}

    def take_ready(self) -> list[str]:
        """Remove and return the drawings whose results are all available."""
        names = [name for name, keys in self.waiting.items() if self.ready.issuperset(keys)]
        for name in names:
            del self.waiting[name]
        return names


def _case_outcome(outcome: object) -> CaseOutcome | None:
    if isinstance(outcome, TaskFailure):  # before the case began
        return CaseOutcome(error=outcome.message)
    if isinstance(outcome, TaskKilled):
        return None
    assert isinstance(outcome, CaseOutcome)
    return outcome

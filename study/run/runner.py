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
from study.run.expected import expect_seconds_of_cases
from study.run.jit import recover_from_jit_conflict
from study.run.pool import Pool, Task, TaskFailure, TaskKilled, format_error_line
from study.run.provenance import create_provenance
from study.run.store import (
    CorruptResult,
    OutdatedResult,
    Result,
    Results,
    discard_result,
    is_result_file,
    remove_unfinished_files,
    save,
)

# Log lines of parallel cases would be interleaved with those of the runner, and several hundred
# cases would warn that displacements are not small
logging.getLogger("pw_elements").addHandler(logging.NullHandler())

STRAY = "is the result of no case, and cannot be read: move it away"
MAX_COMPILATION_ATTEMPTS = 20
"""Maximum number of attempts to run a case while another process compiles one of its forms."""

Validity = Literal["stored", "outdated", "missing", "corrupt"]
CaseToRun = tuple[Case, str]
"""Case with its fingerprint, i.e. the digest of the code and input that its result depends on."""


@dataclass(frozen=True)
class CaseOutcome:
    """Outcome of the computation of a case.

    Attributes:
        seconds: Elapsed time in seconds.
        error: One-line description of the error; empty if the case succeeded.
    """

    seconds: float = 0.0
    error: str = ""


@dataclass(frozen=True)
class WorkerTaskFunctions:
    """Names ("module:name") of functions that worker processes call besides computing cases.

    Only the worker processes import these functions.

    Attributes:
        list_preparations_path: Function that returns a list with the argument tuples for `prepare`.
        prepare: Function that prepares data shared by many cases, e.g. compiled forms. It is called
            with each tuple of arguments before cases are run.
        list_needs: Function that returns the keys of the results that each figure requires, by name
            of figure. Empty if no figures are drawn.
        draw: Function that draws a figure, given its name and the folder of results. It is called
            as soon as the required results are stored. Its errors are ignored, because they occur
            again when all figures are drawn.
    """

    list_preparations_path: str
    prepare: str
    list_needs: str = ""
    draw: str = ""


def find_states_of_stored_results(cases: list[Case], results: Results) -> dict[str, Validity]:
    """Determine whether the result of each case is stored and valid.

    Returns:
        "stored", "outdated", "missing" or "corrupt", by key of the case.
    """
    current = compute_fingerprints(cases)
    recomputed = _fingerprints_if_records_are_recomputed(cases)
    return {
        key: _state_of_stored_result(key, {fingerprint, recomputed.get(key)}, results)
        for key, fingerprint in current.items()
    }


def _fingerprints_if_records_are_recomputed(cases: list[Case]) -> dict[str, str]:
    """Return the fingerprints of the cases that compute recorded results, by key.

    A result that was computed by `--all` is valid, too, when it is usually read from a record.
    """
    return compute_fingerprints([case.computing_case for case in cases if case.computing_case])


def _state_of_stored_result(
    key: str, valid_fingerprints: set[str | None], results: Results
) -> Validity:
    if key not in results:
        return "missing"
    try:
        stored = results[key]
    except OutdatedResult:
        return "outdated"
    except CorruptResult:
        return "corrupt"
    return "stored" if stored.provenance.get("fingerprint") in valid_fingerprints else "outdated"


def discard_results_without_case(section: Section, out: Path) -> None:
    """Remove stored results that belong to no case of a section, e.g. after a case was renamed.

    Otherwise they would count when all results of the section are evaluated. Files that are not
    results are kept and reported.
    """
    case_names = {case.name for case in section.cases}
    for stored in sorted(set(Results(out).cases(section.id)) - case_names):
        path = out / section.id / f"{stored}.json"
        if is_result_file(path):
            discard_result(out, section.id, stored)
        else:
            _print_progress(f"{path} {STRAY}")


def run_cases_without_valid_result(
    cases: list[Case],
    out: Path,
    jobs: int,
    recompute_valid_results: bool,
    tasks: WorkerTaskFunctions | None = None,
) -> list[str]:
    """Compute the cases that have no valid stored result, and report progress on stderr.

    Sections are computed in their order, and the cases of a section by decreasing expected time.

    Args:
        cases: Cases to be computed.
        out: Folder of the results.
        jobs: Number of processes; if it is 1, the cases are run in the current process.
        recompute_valid_results: Whether to recompute valid stored results, too.
        tasks: Further functions that worker processes call; disregarded if `jobs` is 1.

    Returns:
        Keys of the cases that failed or whose process was killed. An earlier result of such a case
        is kept if it is valid, and is otherwise removed.
    """
    remove_unfinished_files(out)
    results = Results(out)
    current_fingerprints = compute_fingerprints(cases)
    recomputed = _fingerprints_if_records_are_recomputed(cases)
    to_run, valid_keys = [], set()
    for case in cases:
        state = _state_of_stored_result(
            case.key, {current_fingerprints[case.key], recomputed.get(case.key)}, results
        )
        if state == "corrupt":
            _print_progress(f"{case.key}: its stored result cannot be read and is computed again")
        if state == "stored":
            valid_keys.add(case.key)
        if state != "stored" or recompute_valid_results:
            to_run.append((case, current_fingerprints[case.key]))
    reused = f"{len(cases) - len(to_run)} of {len(cases)} results are reused"
    recorded = sum(bool(case.record) for case, _ in to_run)
    parts = [f"{len(to_run) - recorded} to be computed"] if len(to_run) > recorded else []
    parts += [f"{recorded} to be read from tracked records"] if recorded else []
    _print_progress("; ".join([reused, *parts]))
    progress = _ProgressReport([case for case, _ in to_run])
    seconds = expect_seconds_of_cases(results)
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
                discard_result(out, case.section, case.name)
            progress.count_case_and_print_ended_sections(case, outcome)
    if unfinished:
        _print_progress(
            "a worker process was killed (out of memory?), unfinished: " + ", ".join(unfinished)
        )
    return failed + unfinished


def compute_and_store_case(case: Case, fingerprint: str, out: Path) -> CaseOutcome:
    """Run a case and store its result.

    Args:
        case: The case.
        fingerprint: Fingerprint of the case, which is stored with the result.
        out: Folder of the results.

    Returns:
        Elapsed time, or a description of the exception that was raised.
    """
    try:
        start = time.perf_counter()
        result = _run_case_with_jit_retries(case)
        seconds = time.perf_counter() - start
        origin = create_provenance(seconds, result.dofs, result.processes, fingerprint, case.record)
        save(out, case.section, case.name, result, case.stored_parameters, origin)
    except Exception as error:
        return CaseOutcome(error=format_error_line(error))
    return CaseOutcome(seconds)


def _run_case_with_jit_retries(case: Case) -> Result:
    for _ in range(MAX_COMPILATION_ATTEMPTS):
        try:
            return case.run(**case.parameters)
        except Exception as error:
            if not recover_from_jit_conflict(error):
                raise
    return case.run(**case.parameters)


class _ProgressReport:
    """Progress report on stderr, with one line per completed section in the order of the sections.

    Args:
        cases: Cases to be computed, in the order of the sections.
    """

    def __init__(self, cases: list[Case]) -> None:
        sections = [case.section for case in cases]
        self.open = {section: sections.count(section) for section in dict.fromkeys(sections)}
        self.computing_seconds_by_section: dict[str, list[float]] = {
            section: [] for section in self.open
        }
        self.recorded: Counter[str] = Counter()
        self.lost: dict[str, Counter[str]] = {section: Counter() for section in self.open}

    def count_case_and_print_ended_sections(self, case: Case, outcome: CaseOutcome | None) -> None:
        self.open[case.section] -= 1
        if outcome and not outcome.error and case.record:
            self.recorded[case.section] += 1
        elif outcome and not outcome.error:
            self.computing_seconds_by_section[case.section].append(outcome.seconds)
        else:  # a case whose process was killed has not failed
            self.lost[case.section]["failed" if outcome else "unfinished"] += 1
        while self.open and not next(iter(self.open.values())):
            section = next(iter(self.open))
            del self.open[section]
            seconds = self.computing_seconds_by_section[section]
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
        yield case, compute_and_store_case(case, fingerprint, out)


def _run_in_parallel(
    to_run: list[CaseToRun],
    out: Path,
    jobs: int,
    tasks: WorkerTaskFunctions | None,
    available_keys: set[str],
) -> Generator[tuple[Case, CaseOutcome | None]]:
    """Run cases in worker processes; yield each case and its outcome when it ends.

    The outcome is None if the worker process was killed.

    Args:
        to_run: Cases and their fingerprints.
        out: Folder of the results.
        jobs: Number of worker processes.
        tasks: Further functions that worker processes call.
        available_keys: Keys of valid stored results; keys of computed results are added.
    """
    if not to_run:
        return
    pool = Pool(jobs)
    drawings = _PendingDrawings(available_keys)
    if tasks and len(to_run) > jobs:
        pool.submit(Task(_PREPARATIONS, tasks.list_preparations_path, (), math.inf))
    if tasks and tasks.list_needs:
        pool.submit(Task(_NEEDS, tasks.list_needs, (), 1.0))
    cases = {case.key: case for case, _ in to_run}
    for case, fingerprint in to_run:
        pool.submit(Task(case.key, compute_and_store_case, (case, fingerprint, out)))
    for task, outcome in pool:
        if task.name in cases:
            case_outcome = _convert_task_outcome_to_case_outcome(outcome)
            if case_outcome and not case_outcome.error:
                available_keys.add(task.name)
            yield cases[task.name], case_outcome
        elif tasks and task.name == _PREPARATIONS and isinstance(outcome, list):
            for arguments in outcome:
                pool.submit(Task("prepare", tasks.prepare, arguments, math.inf))
        elif task.name == _NEEDS and isinstance(outcome, dict):
            drawings.waiting = outcome
        elif task.name in (_PREPARATIONS, _NEEDS) and isinstance(outcome, TaskFailure):
            _print_progress(f"{task.name} of parallel tasks: {outcome.message}")
        for name in drawings.remove_figures_that_can_be_drawn():
            assert tasks is not None
            pool.submit(Task("draw", tasks.draw, (name, out.resolve())))


# These names cannot coincide with keys of cases, which contain a slash
_PREPARATIONS, _NEEDS = "preparations", "needs"


class _PendingDrawings:
    """Figures that wait for the results they require.

    Args:
        available_keys: Keys of available results, to which the caller adds new ones.
    """

    def __init__(self, available_keys: set[str]) -> None:
        self.ready = available_keys
        self.waiting: dict[str, list[str]] = {}

    def remove_figures_that_can_be_drawn(self) -> list[str]:
        """Remove the figures whose results are all available, and return their names."""
        names = [name for name, keys in self.waiting.items() if self.ready.issuperset(keys)]
        for name in names:
            del self.waiting[name]
        return names


def _convert_task_outcome_to_case_outcome(outcome: object) -> CaseOutcome | None:
    if isinstance(outcome, TaskFailure):  # before the case began
        return CaseOutcome(error=outcome.message)
    if isinstance(outcome, TaskKilled):
        return None
    assert isinstance(outcome, CaseOutcome)
    return outcome

"""Run the study: compute what is not stored yet, judge the claims, draw, write the report."""

import argparse
import errno
import os
import resource
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TextIO

from study.run import runner
from study.run.cases import SECTIONS, Case, Section, load_section
from study.run.files import ForeignFileOrFolder
from study.run.folder import ensure_writable
from study.run.pool import ignore_broken_pipe_signal
from study.run.store import EXIT_CORRUPT, Results, StudyError, TrackedResults

if TYPE_CHECKING:
    from study.judge.claims import Claim, Verdict

ROOT = Path(__file__).resolve().parents[2]
FROM = Path(os.environ.get("PW_ELEMENTS_FOLDER", ""))
"""Where ./run study was called, if not in the project's folder."""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES)
OPEN_FILES = 64  # that two processes, their pipes and the report need
MEMORY = 1 << 30  # bytes of address space: OpenBLAS tries for ever to get a buffer it is not given
NAMED = 5  # outdated results that are named; more are counted

USAGE = """\
  study                   all sections, then claims, figures and report
  study 7.1 7.6           these sections only; the rest is taken from stored results
  study 7.1/pw-T6 3/weights    these cases only, without claims, figures and report
  study --all             also what is otherwise read from tracked records: finer meshes, more
                          elements and variants (39 CPU minutes more), and times and memory of
                          section K (29 minutes more, one row at a time); results of CalculiX stay
                          recorded
  study list              sections and cases, and whether a stored result holds
  study check             judge the claims by the stored results
  study report            claims, figures and report again from stored results

check and report take stored results as they are, and say on stderr which are outdated, missing or
corrupt, that is not as they were written. What needs missing or corrupt ones is not judged.
Sections and cases that are named print the verdicts that depend on them; the other commands all.

exit status: 0; 1 if a case failed or a verdict differs from the pinned one; 2 for bad usage or
no room; 3 if stored results are corrupt, whatever the other verdicts; 141 if nobody reads any more
what it says; 128 and its number if a signal ended it, as 130 after Ctrl-C
"""


class FigureDrawing(NamedTuple):
    """Functions that draw figures; the study does not import them.

    Attributes:
        list_needs: See `runner.ParallelTasks`.
        draw: See `runner.ParallelTasks`.
        draw_all: Draw the figures that are not up to date, given the folder of results, whether no
            result may be missing, and the number of processes; return whether none failed.
    """

    list_needs: str
    draw: str
    draw_all: Callable[[Path, bool, int], bool]


def main(arguments: list[str] | None = None, figures: FigureDrawing | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Arguments of the command line; by default those of this process.
        figures: Functions that draw the figures. Without them, the report contains the figures that
            were drawn before.

    Returns:
        The exit status.
    """
    parser = argparse.ArgumentParser(
        prog="study",
        description=__doc__,
        epilog=USAGE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("what", nargs="*", help="sections, cases, or one of list, check, report")
    parser.add_argument("--force", action="store_true", help="compute also what is stored")
    parser.add_argument("--all", action="store_true", help="compute also what is recorded")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="processes")
    results = ROOT / "results" if FROM.is_absolute() else Path("results")
    parser.add_argument("--out", type=_folder, default=results, metavar="DIR")
    options = parser.parse_intermixed_args(arguments)
    try:
        status = _command(options, figures)
        sys.stdout.flush()
        return status
    except (StudyError, ForeignFileOrFolder) as error:
        print(f"study: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # who reads has seen enough, as in "study list | head"
        _silence(sys.stdout, sys.stderr)
        return 141  # as a shell has it of programs that end by the signal
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        where = error.filename or ("what it says" if _unsaid() else options.out)
        print(f"study: {where}: {error.strerror}", file=sys.stderr)
        return 2


def _unsaid() -> bool:
    """Tell whether there is no room for what has been printed, and forget it then."""
    try:
        print(flush=True)
    except OSError:
        _silence(sys.stdout)
        return True
    return False


def _silence(*streams: TextIO) -> None:
    for stream in streams:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _folder(name: str) -> Path:
    if not name:
        raise argparse.ArgumentTypeError("the name of a folder is empty")
    return FROM / name


def _command(options: argparse.Namespace, figures: FigureDrawing | None) -> int:
    match options.what:
        case ["list"]:
            return show(options.out)
        case ["check"]:
            return check(options.out)
        case ["report"]:
            return report(options.out, options.jobs, figures)
        case wanted:
            return study(
                wanted, options.out, options.jobs, options.force, options.all, figures=figures
            )


def study(
    wanted: list[str],
    out: Path,
    jobs: int,
    force: bool = False,
    recompute: bool = False,
    *,
    figures: FigureDrawing | None = None,
) -> int:
    """Compute the sections, or all if none is given, and conclude; or nothing but single cases.

    Args:
        wanted: Sections, or keys of cases.
        out: Folder of the results.
        jobs: Number of processes.
        force: Compute also what is stored and holds.
        recompute: Compute also what is otherwise read from tracked records.
        figures: Functions that draw the figures.

    Returns:
        The exit status.
    """
    for command in {"list", "check", "report"} & set(wanted):
        raise StudyError(f"{command} stands alone, without sections")
    sections = list(dict.fromkeys(one.partition("/")[0] for one in wanted)) or list(SECTIONS)
    for unknown in (section for section in sections if section not in SECTIONS):
        raise StudyError(f"there is no section {unknown}; there are {', '.join(SECTIONS)}")
    if jobs < 1:
        raise StudyError(f"--jobs needs at least 1 process, not {jobs}")
    _ensure_open_files()
    _ensure_memory()
    ensure_writable(out)
    if any("/" in one for one in wanted):
        cases = _cases(wanted, sections)
        if recompute:
            cases = _recomputed(cases, out)
        return int(bool(runner.run(cases, out, jobs, force)))
    from study.judge import claims  # single cases need neither it nor the packages it imports

    known = claims.load_claims()  # an error in them is to be known now, not at the end
    loaded = _load(sections)
    for section in loaded:
        runner.discard_others(section, out)
    cases = [case for section in loaded for case in section.cases]
    if recompute:
        cases = _recomputed(cases, out)
    failed = runner.run(cases, out, jobs, force, None if wanted else _parallel_tasks(figures))
    status = conclude(out, known, not wanted, jobs, wanted, figures=figures)
    return max(status, int(bool(failed)))


def _parallel_tasks(figures: FigureDrawing | None) -> runner.ParallelTasks:
    return runner.ParallelTasks(
        list_preparations="study.model.forms:shared",
        prepare="study.model.forms:compile_shared",
        list_needs=figures.list_needs if figures else "",
        draw=figures.draw if figures else "",
    )


def _recomputed(cases: list[Case], out: Path) -> list[Case]:
    """Replace recorded cases by those that compute them; measure the cost of section K anew."""
    from study.benchmarks.k_cost import measure, page

    costs = {case.key: case for case in cases if case.section == "K"}
    if costs:
        print("study: measuring times and memory of section K, one row at a time", file=sys.stderr)
        record = out / "cost.json"
        measure.write_record(record, {case.name for case in costs.values()})
        costs = {case.key: case for case in page.load_cases(record)}
    return [costs.get(case.key) or case.recomputed or case for case in cases]


def _cases(wanted: list[str], sections: list[str]) -> list[Case]:
    """Return cases by their keys, and those of whole sections."""
    known = [case for section in _load(sections) for case in section.cases]
    keys = {case.key for case in known}
    for unknown in (one for one in wanted if "/" in one and one not in keys):
        raise StudyError(f"there is no case {unknown}: see ./run study list")
    return [case for case in known if not {case.key, case.section}.isdisjoint(wanted)]


def report(out: Path, jobs: int = 1, figures: FigureDrawing | None = None) -> int:
    """Judge, draw and write the report again."""
    from study.judge import claims

    results = _ensure_stored(out)
    ensure_writable(out)
    _tell_outdated(results)
    return conclude(out, claims.load_claims(), complete=False, jobs=jobs, figures=figures)


def check(out: Path) -> int:
    """Print the claims whose verdict differs from the pinned one; without a verdict, it does.

    That results are outdated, missing or corrupt is said on stderr.

    Returns:
        3 if results are corrupt, 1 if a verdict differs, else 0.
    """
    from study.judge import claims

    results = _ensure_stored(out)
    _tell_outdated(results)
    verdicts = claims.judge(claims.load_claims(), results)
    differing = [verdict for verdict in verdicts if verdict.differs]
    print(claims.table(differing) + claims.summary(verdicts))
    _tell_unreadable(verdicts)
    return EXIT_CORRUPT if _any_corrupt(results) else int(bool(differing))


def show(out: Path) -> int:
    """Print the sections with their cases and what is stored of them."""
    results = Results(out)
    lines = []
    for section in _load(list(SECTIONS)):
        lines.append(f"{section.id}  {section.title}")
        states = runner.states(section.cases, results)
        lines += [f"    {state:8}  {key}" for key, state in states.items()]
    print("\n".join(lines))
    return 0


def conclude(
    out: Path,
    known: "list[Claim]",
    complete: bool,
    jobs: int = 1,
    of: Sequence[str] = (),
    *,
    figures: FigureDrawing | None = None,
) -> int:
    """Write claims, figures and report from what is stored, and print verdicts.

    Args:
        out: Folder of the results.
        known: The claims.
        complete: Whether nothing may be missing, as after a run of all sections.
        jobs: Number of processes that draw.
        of: Sections: verdicts that depend on their results are printed; without any, all verdicts.
        figures: Functions that draw the figures.

    Returns:
        3 if stored results are corrupt; 1 if a printed verdict differs from the pinned one, a
        figure cannot be drawn, or something is missing that may not; else 0.
    """
    from study.judge import claims, facts
    from study.publish.report import build  # slow to import, and worker processes do not need it

    results = Results(out)
    judged = [_judge(claim, results) for claim in known]
    verdicts = [verdict for verdict, _ in judged]
    facts.write(out, verdicts, results)
    if figures is None:
        print("study: figures are not drawn; ./run study draws them", file=sys.stderr)
    drawn = figures is None or figures.draw_all(out, complete, jobs)
    incomplete = build(results, out)
    printed = [verdict for verdict, read in judged if not of or read & {*of}]
    differing = [
        verdict
        for verdict in printed
        if verdict.differs and (complete or verdict.verdict != "not judged")
    ]
    print(claims.table(differing) + claims.summary(printed))
    _tell_unreadable(printed)
    for part in incomplete if complete else ():
        print(f"report: incomplete, {part}", file=sys.stderr)
    print(f"report: {out / 'report.html'} and {out / 'report.pdf'}")
    if _any_corrupt(results):
        return EXIT_CORRUPT
    return int(bool(differing) or not drawn or (complete and bool(incomplete)))


def _judge(claim: "Claim", results: Results) -> "tuple[Verdict, set[str]]":
    """Judge a claim; return the sections whose results it depends on, too."""
    from study.judge import claims

    tracked = TrackedResults(results)
    (verdict,) = claims.judge([claim], tracked)
    return verdict, tracked.sections


def _load(sections: list[str]) -> list[Section]:
    loaded = [load_section(section) for section in sections]
    ignore_broken_pipe_signal()  # which PETSc, imported just now, takes for a crash
    return loaded


def _ensure_open_files() -> None:
    allowed = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if 0 <= allowed < OPEN_FILES:
        raise StudyError(
            f"{allowed} open files are allowed, and {OPEN_FILES} are needed: "
            f"allow them by ulimit -n {OPEN_FILES}"
        )


def _ensure_memory() -> None:
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    if 0 <= allowed < MEMORY:
        raise StudyError(
            f"a process is allowed {allowed >> 20} MB of memory, and needs {MEMORY >> 20}: "
            f"allow them by ulimit -v {MEMORY >> 10}"
        )


def _ensure_stored(out: Path) -> Results:
    """Return the results of a folder, but refuse one without any."""
    results = Results(out)
    if not any(results.cases(section) for section in SECTIONS):
        raise StudyError(f"there are no results in {out}: run ./run study")
    return results


def _any_corrupt(results: Results) -> bool:
    return any(results.corrupt_results(section) for section in SECTIONS)


def _tell_unreadable(verdicts: "Sequence[Verdict]") -> None:
    """Say why claims are not judged though their results are there."""
    claims_by_reason: dict[str, list[str]] = {}
    for verdict in verdicts:
        if verdict.unreadable:
            claims_by_reason.setdefault(verdict.unreadable, []).append(verdict.claim.id)
    for reason, ids in claims_by_reason.items():
        are = "is" if len(ids) == 1 else "are"
        print(f"study: {_first(ids)} {are} not judged: {reason}", file=sys.stderr)


def _first(names: list[str]) -> str:
    """Return the first few names, and how many more there are."""
    rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + rest


def _tell_outdated(results: Results) -> None:
    """Say which stored results code or parameters have left behind, are missing or corrupt."""
    try:
        cases = [case for section in _load(list(SECTIONS)) for case in section.cases]
    except StudyError as error:  # results can be judged where they cannot be computed
        print(f"study: whether results are outdated cannot be told: {error}", file=sys.stderr)
        cases = []
    states = runner.states(cases, results)
    for what in ("outdated", "missing", "corrupt") if cases else ():
        _tell_state(what, [key for key, state in states.items() if state == what], len(cases))
    corrupt = {key: why for one in SECTIONS for key, why in results.corrupt_results(one).items()}
    for key in sorted(corrupt.keys() - states.keys()):
        stray = f"{results.folder / key}.json {runner.STRAY}"
        print(f"study: {stray if cases else corrupt[key]}", file=sys.stderr)


def _tell_state(what: str, keys: list[str], n_cases: int) -> None:
    """Say how many results are in a state, and how to mend it: by cases, if they are few."""
    if not keys:
        return
    sections = list(dict.fromkeys(key.partition("/")[0] for key in keys))
    again = keys if len(keys) <= NAMED else [] if len(sections) == len(SECTIONS) else sections
    print(
        f"study: of {n_cases} results {len(keys)} {'is' if len(keys) == 1 else 'are'} {what}: "
        f"{_first(keys)}; run {' '.join(['./run study', *again])}",
        file=sys.stderr,
    )

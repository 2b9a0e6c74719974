"""Run the study: compute missing results, judge the claims, draw figures, write the report."""

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
from study.run.folder import create_writable_results_folder
from study.run.pool import ignore_broken_pipe_signal
from study.run.store import EXIT_CORRUPT, Results, StudyError, TrackedResults

if TYPE_CHECKING:
    from study.judge.claims import Claim, Verdict

ROOT = Path(__file__).resolve().parents[2]
CALLER_FOLDER = Path(os.environ.get("PW_ELEMENTS_FOLDER", ""))
"""Folder from which the user called `./run study`; empty if it is the project's own folder."""

UNWRITABLE_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES)
MIN_OPEN_FILES = 64  # required by two processes, their pipes and the report
MIN_ADDRESS_SPACE = 1 << 30
"""Smallest accepted limit of the address space in bytes; below it, OpenBLAS hangs at start-up."""
MAX_LISTED_NAMES = 5  # if there are more, only their number is printed

USAGE = """\
  study                   all sections, then claims, figures and report
  study 7.1 7.6           these sections only; the rest is taken from stored results
  study 7.1/pw-T6 3/weights    these cases only, without claims, figures and report
  study --all             also what is otherwise read from tracked records: finer meshes, more
                          elements and variants (57 CPU minutes more), and times and memory of
                          section K (35 minutes more, one row at a time); results of CalculiX stay
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


class FigureDrawingFunctions(NamedTuple):
    """Functions that draw figures, passed as arguments because the study does not import them.

    Attributes:
        list_needs: Function that lists the results needed by each figure, as "module:name".
        draw: Function that draws one figure, as "module:name"; see `runner.WorkerTaskFunctions`.
        draw_outdated_figures: Function that draws all figures that are not up to date and returns
            whether it succeeded. Its arguments are the folder of the results, whether a missing
            result is an error, and the number of processes.
    """

    list_needs: str
    draw: str
    draw_outdated_figures: Callable[[Path, bool, int], bool]


def main(arguments: list[str] | None = None, figures: FigureDrawingFunctions | None = None) -> int:
    """Parse the arguments of `./run study`, run the command, and return its exit status.

    Args:
        arguments: Command-line arguments; by default, those of this process.
        figures: Functions that draw the figures. If None, the report includes the figures that were
            drawn earlier.
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
    default_folder = ROOT / "results" if CALLER_FOLDER.is_absolute() else Path("results")
    parser.add_argument(
        "--out", type=_resolve_folder_from_caller, default=default_folder, metavar="DIR"
    )
    options = parser.parse_intermixed_args(arguments)
    try:
        status = _run_command(options, figures)
        sys.stdout.flush()
        return status
    except (StudyError, ForeignFileOrFolder) as error:
        print(f"study: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader has closed the pipe, as in "study list | head"
        _redirect_to_devnull(sys.stdout, sys.stderr)
        return 141  # exit status that shells report for programs ended by SIGPIPE
    except OSError as error:
        if error.errno not in UNWRITABLE_ERRNOS:
            raise
        unwritable_target = error.filename or (
            "what it says" if _discard_output_if_unwritable() else options.out
        )
        print(f"study: {unwritable_target}: {error.strerror}", file=sys.stderr)
        return 2


def _discard_output_if_unwritable() -> bool:
    """Flush stdout; if that fails, redirect stdout to the null device.

    Returns:
        Whether stdout could not be written.
    """
    try:
        print(flush=True)
    except OSError:
        _redirect_to_devnull(sys.stdout)
        return True
    return False


def _redirect_to_devnull(*streams: TextIO) -> None:
    for stream in streams:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _resolve_folder_from_caller(name: str) -> Path:
    if not name:
        raise argparse.ArgumentTypeError("the name of a folder is empty")
    return CALLER_FOLDER / name


def _run_command(options: argparse.Namespace, figures: FigureDrawingFunctions | None) -> int:
    match options.what:
        case ["list"]:
            return print_cases_and_states(options.out)
        case ["check"]:
            return print_differing_verdicts(options.out)
        case ["report"]:
            return rewrite_report_from_stored_results(options.out, options.jobs, figures)
        case selection:
            return run_study(
                selection, options.out, options.jobs, options.force, options.all, figures=figures
            )


def run_study(
    selected_sections_or_keys: list[str],
    out: Path,
    jobs: int,
    force: bool = False,
    recompute_recorded: bool = False,
    *,
    figures: FigureDrawingFunctions | None = None,
) -> int:
    """Compute results; then judge claims, draw figures and write the report.

    If the selection contains keys of cases, the cases are computed and nothing else is done.

    Args:
        selected_sections_or_keys: Names of sections, such as "7.1", or keys of cases, such as
            "7.1/pw-T6". If empty, all sections are computed.
        out: Folder of the results.
        jobs: Number of processes.
        force: Whether to recompute results that are stored and valid.
        recompute_recorded: Whether to compute results that are otherwise read from the records in
            version control.
        figures: Functions that draw the figures.

    Returns:
        Exit status: that of `judge_and_report`, but at least 1 if a case has failed.
    """
    for command in {"list", "check", "report"} & set(selected_sections_or_keys):
        raise StudyError(f"{command} stands alone, without sections")
    sections = list(
        dict.fromkeys(name.partition("/")[0] for name in selected_sections_or_keys)
    ) or list(SECTIONS)
    for unknown_section in (section for section in sections if section not in SECTIONS):
        raise StudyError(f"there is no section {unknown_section}; there are {', '.join(SECTIONS)}")
    if jobs < 1:
        raise StudyError(f"--jobs needs at least 1 process, not {jobs}")
    _check_open_files_limit()
    _check_memory_limit()
    create_writable_results_folder(out)
    if any("/" in name for name in selected_sections_or_keys):
        cases = _select_cases(selected_sections_or_keys, sections)
        if recompute_recorded:
            cases = _replace_recorded_and_remeasure_cost_cases(cases, out)
        return int(bool(runner.run_cases_without_valid_result(cases, out, jobs, force)))
    from study.judge import claims  # not required for single cases

    all_claims = claims.load_claims()  # errors in claims are reported before computing
    loaded_sections = _load_sections(sections)
    for section in loaded_sections:
        runner.discard_results_without_case(section, out)
    cases = [case for section in loaded_sections for case in section.cases]
    if recompute_recorded:
        cases = _replace_recorded_and_remeasure_cost_cases(cases, out)
    failed_keys = runner.run_cases_without_valid_result(
        cases,
        out,
        jobs,
        force,
        None if selected_sections_or_keys else _create_parallel_tasks(figures),
    )
    status = judge_and_report(
        out,
        all_claims,
        not selected_sections_or_keys,
        jobs,
        selected_sections_or_keys,
        figures=figures,
    )
    return max(status, int(bool(failed_keys)))


def _create_parallel_tasks(figures: FigureDrawingFunctions | None) -> runner.WorkerTaskFunctions:
    return runner.WorkerTaskFunctions(
        list_preparations_path="study.model.forms:list_forms_to_compile",
        prepare="study.model.forms:compile_element_forms",
        list_needs=figures.list_needs if figures else "",
        draw=figures.draw if figures else "",
    )


def _replace_recorded_and_remeasure_cost_cases(cases: list[Case], out: Path) -> list[Case]:
    """Replace cases that are read from records by cases that compute the same results.

    If the list contains cases of section K, their times and memory are measured at once, one after
    the other, and written to `<out>/cost.json`.
    """
    from study.benchmarks.k_cost import measure, page

    cost_cases = {case.key: case for case in cases if case.section == "K"}
    if cost_cases:
        print("study: measuring times and memory of section K, one row at a time", file=sys.stderr)
        record_path = out / "cost.json"
        measure.measure_cases_and_write_record(
            record_path, {case.name for case in cost_cases.values()}
        )
        cost_cases = {case.key: case for case in page.load_cases_from_record(record_path)}
    return [cost_cases.get(case.key) or case.computing_case or case for case in cases]


def _select_cases(selected_sections_or_keys: list[str], sections: list[str]) -> list[Case]:
    """Return the cases whose keys or sections are in the selection, in the order of the sections.

    Raises:
        StudyError: If the selection contains a key that belongs to no case.
    """
    all_cases = [case for section in _load_sections(sections) for case in section.cases]
    keys = {case.key for case in all_cases}
    for unknown_key in (
        name for name in selected_sections_or_keys if "/" in name and name not in keys
    ):
        raise StudyError(f"there is no case {unknown_key}: see ./run study list")
    return [
        case
        for case in all_cases
        if not {case.key, case.section}.isdisjoint(selected_sections_or_keys)
    ]


def rewrite_report_from_stored_results(
    out: Path, jobs: int = 1, figures: FigureDrawingFunctions | None = None
) -> int:
    """Judge the claims, draw figures and write the report from stored results."""
    from study.judge import claims

    results = _open_stored_results(out)
    create_writable_results_folder(out)
    _print_outdated_missing_corrupt_results(results)
    return judge_and_report(
        out, claims.load_claims(), require_complete=False, jobs=jobs, figures=figures
    )


def print_differing_verdicts(out: Path) -> int:
    """Judge all claims by the stored results, and print the claims with unexpected verdicts.

    Claims that cannot be judged are printed, too. Outdated, missing and corrupt results are listed
    on stderr.

    Returns:
        Exit status: 3 if results are corrupt, 1 if a verdict differs from the expected (pinned)
        one, otherwise 0.
    """
    from study.judge import claims

    results = _open_stored_results(out)
    _print_outdated_missing_corrupt_results(results)
    verdicts = claims.judge_claims(claims.load_claims(), results)
    differing_verdicts = [verdict for verdict in verdicts if verdict.differs]
    print(claims.format_verdict_table(differing_verdicts) + claims.summarise_verdicts(verdicts))
    _print_reasons_of_unjudged_claims(verdicts)
    return EXIT_CORRUPT if _has_corrupt_results(results) else int(bool(differing_verdicts))


def print_cases_and_states(out: Path) -> int:
    """Print all sections and cases, and whether each case has a valid stored result."""
    results = Results(out)
    lines = []
    for section in _load_sections(list(SECTIONS)):
        lines.append(f"{section.id}  {section.title}")
        states = runner.find_states_of_stored_results(section.cases, results)
        lines += [f"    {state:8}  {key}" for key, state in states.items()]
    print("\n".join(lines))
    return 0


def judge_and_report(
    out: Path,
    all_claims: "list[Claim]",
    require_complete: bool,
    jobs: int = 1,
    sections: Sequence[str] = (),
    *,
    figures: FigureDrawingFunctions | None = None,
) -> int:
    """Judge the claims, write them to a file, draw figures, write the report and print verdicts.

    Args:
        out: Folder of the results.
        all_claims: Claims to be judged.
        require_complete: Whether missing results are an error, as after a run of all sections.
        jobs: Number of processes that draw figures.
        sections: Verdicts are printed only if results of one of these sections were read to judge
            the claim. If empty, all verdicts are printed.
        figures: Functions that draw the figures.

    Returns:
        Exit status: 3 if stored results are corrupt; 1 if a printed verdict differs from the pinned
        one, a figure cannot be drawn, or required results are missing; otherwise 0.
    """
    from study.judge import claims, facts
    from study.publish.report import build_report  # slow, and workers do not need it

    results = Results(out)
    verdicts_with_sections = [_judge_and_track_sections(claim, results) for claim in all_claims]
    verdicts = [verdict for verdict, _ in verdicts_with_sections]
    facts.write_claims_with_facts(out, verdicts, results)
    if figures is None:
        print("study: figures are not drawn; ./run study draws them", file=sys.stderr)
    figures_drawn = figures is None or figures.draw_outdated_figures(out, require_complete, jobs)
    missing_content = build_report(results, out)
    printed_verdicts = [
        verdict
        for verdict, sections_read in verdicts_with_sections
        if not sections or sections_read & {*sections}
    ]
    differing_verdicts = [
        verdict
        for verdict in printed_verdicts
        if verdict.differs and (require_complete or verdict.verdict != "not judged")
    ]
    print(
        claims.format_verdict_table(differing_verdicts)
        + claims.summarise_verdicts(printed_verdicts)
    )
    _print_reasons_of_unjudged_claims(printed_verdicts)
    for gap in missing_content if require_complete else ():
        print(f"report: incomplete, {gap}", file=sys.stderr)
    print(f"report: {out / 'report.html'} and {out / 'report.pdf'}")
    if _has_corrupt_results(results):
        return EXIT_CORRUPT
    return int(
        bool(differing_verdicts)
        or not figures_drawn
        or (require_complete and bool(missing_content))
    )


def _judge_and_track_sections(claim: "Claim", results: Results) -> "tuple[Verdict, set[str]]":
    """Judge one claim; return the verdict and the sections whose results were read for it."""
    from study.judge import claims

    tracked_results = TrackedResults(results)
    (verdict,) = claims.judge_claims([claim], tracked_results)
    return verdict, tracked_results.sections_read


def _load_sections(sections: list[str]) -> list[Section]:
    loaded_sections = [load_section(section) for section in sections]
    ignore_broken_pipe_signal()  # PETSc, which has just been imported, treats the signal as a crash
    return loaded_sections


def _check_open_files_limit() -> None:
    max_open_files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if 0 <= max_open_files < MIN_OPEN_FILES:
        raise StudyError(
            f"{max_open_files} open files are allowed, and {MIN_OPEN_FILES} are needed: "
            f"allow them by ulimit -n {MIN_OPEN_FILES}"
        )


def _check_memory_limit() -> None:
    max_address_space = resource.getrlimit(resource.RLIMIT_AS)[0]
    if 0 <= max_address_space < MIN_ADDRESS_SPACE:
        raise StudyError(
            f"a process is allowed {max_address_space >> 20} MB of memory, and needs "
            f"{MIN_ADDRESS_SPACE >> 20}: "
            f"allow them by ulimit -v {MIN_ADDRESS_SPACE >> 10}"
        )


def _open_stored_results(out: Path) -> Results:
    """Return the results of a folder; raise StudyError if it contains none."""
    results = Results(out)
    if not any(results.cases(section) for section in SECTIONS):
        raise StudyError(f"there are no results in {out}: run ./run study")
    return results


def _has_corrupt_results(results: Results) -> bool:
    return any(results.error_messages_of_corrupt_results(section) for section in SECTIONS)


def _print_reasons_of_unjudged_claims(verdicts: "Sequence[Verdict]") -> None:
    """Print the claims whose results exist but cannot be used, grouped by the reason."""
    claims_by_reason: dict[str, list[str]] = {}
    for verdict in verdicts:
        if verdict.unreadable_reason:
            claims_by_reason.setdefault(verdict.unreadable_reason, []).append(verdict.claim.id)
    for reason, claim_ids in claims_by_reason.items():
        verb = "is" if len(claim_ids) == 1 else "are"
        print(f"study: {_abbreviate_list(claim_ids)} {verb} not judged: {reason}", file=sys.stderr)


def _abbreviate_list(names: list[str]) -> str:
    """Join names by commas; after the first `MAX_LISTED_NAMES`, state only how many follow."""
    suffix = f" and {len(names) - MAX_LISTED_NAMES} more" if len(names) > MAX_LISTED_NAMES else ""
    return ", ".join(names[:MAX_LISTED_NAMES]) + suffix


def _print_outdated_missing_corrupt_results(results: Results) -> None:
    """Print which results are outdated, missing or corrupt, and files that belong to no case.

    If the cases cannot be loaded, e.g. without the solver, only corrupt files are printed.
    """
    try:
        cases = [case for section in _load_sections(list(SECTIONS)) for case in section.cases]
    except StudyError as error:  # judging does not require the solver
        print(f"study: whether results are outdated cannot be told: {error}", file=sys.stderr)
        cases = []
    states = runner.find_states_of_stored_results(cases, results)
    for bad_state in ("outdated", "missing", "corrupt") if cases else ():
        _print_state_and_remedy(
            bad_state, [key for key, state in states.items() if state == bad_state], len(cases)
        )
    corrupt_results = {
        key: reason
        for section in SECTIONS
        for key, reason in results.error_messages_of_corrupt_results(section).items()
    }
    for key in sorted(corrupt_results.keys() - states.keys()):
        stray_message = f"{results.folder / key}.json {runner.STRAY}"
        print(f"study: {stray_message if cases else corrupt_results[key]}", file=sys.stderr)


def _print_state_and_remedy(state: str, keys: list[str], n_cases: int) -> None:
    """Print the number of results in a state such as "outdated", and how to recompute them.

    Args:
        state: Name of the state.
        keys: Keys of the results in this state; if there are none, nothing is printed.
        n_cases: Number of all cases.
    """
    if not keys:
        return
    sections = list(dict.fromkeys(key.partition("/")[0] for key in keys))
    rerun_arguments = (
        keys
        if len(keys) <= MAX_LISTED_NAMES
        else []
        if len(sections) == len(SECTIONS)
        else sections
    )
    print(
        f"study: of {n_cases} results {len(keys)} {'is' if len(keys) == 1 else 'are'} {state}: "
        f"{_abbreviate_list(keys)}; run {' '.join(['./run study', *rerun_arguments])}",
        file=sys.stderr,
    )

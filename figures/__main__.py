"""Draw a figure by its name: compute missing results, then write the figure as PNG and PDF.

The command prints the caption and the paper's statements about the figure, with printed and
computed values and verdicts. Without a name, it lists all figures. Some figures of the paper share
a drawing, e.g. fig07 and fig08.
"""

import argparse
import difflib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from figures.drawing import (
    DrawingOutcome,
    FigureEntry,
    check_that_export_overwrites_only_exports,
    draw_figure,
    export_figure_as_png_and_pdf,
    figure_title,
    find_index_entry_if_up_to_date,
    list_names_of_all_figures,
    load_figure_script,
    natural_sort_key,
)
from study.judge.claims import Claim, judge_claims, load_paper_claims
from study.paper.items import ITEMS
from study.run.folder import create_writable_results_folder
from study.run.pool import Pool, Task, TaskFailure
from study.run.store import Results, StudyError, write_json
from study.run.supervisor import run_supervised_and_exit

ROOT = Path(__file__).parents[1]
CALLING_FOLDER = Path(os.environ.get("PW_ELEMENTS_FOLDER", ""))
"""Folder from which the user called `./run figure`; empty if it is the project's own folder."""

MAX_LISTED_FIGURES = 3  # if more figures are not drawn, they are not named individually
KIND_ABBREVIATIONS = {"figure": "fig", "table": "tab"}


def main(arguments: list[str] | None = None) -> int:
    """Draw the figures that the arguments name, or list all figures if there are no names.

    Args:
        arguments: Command-line arguments; by default, those of this process.

    Returns:
        Exit status: 1 if a figure cannot be drawn; 2 if there is no figure of a given name, if
        results cannot be written, or if files that are not figures would be overwritten; otherwise
        0.
    """
    parser = argparse.ArgumentParser(prog="./run figure", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help='as fig05, "Fig. 5", tab01')
    parser.add_argument(
        "--results",
        type=CALLING_FOLDER.joinpath,
        metavar="DIR",
        help="default: the project's results; if those cannot be written, OUT/results",
    )
    parser.add_argument(
        "--out",
        type=CALLING_FOLDER.joinpath,
        metavar="DIR",
        help="default: figures, among the results",
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes")
    parsed_arguments = parser.parse_args(arguments)
    descriptions = {
        name: description
        for name, (_, description) in list_script_and_description_by_figure().items()
    }
    table = "".join(f"{name:25} {what}\n" for name, what in descriptions.items())
    if not parsed_arguments.names:
        print(table, end="")
        return 0
    names = [normalise_figure_name(name) for name in parsed_arguments.names]
    for name, typed in zip(names, parsed_arguments.names, strict=True):
        if name not in descriptions:
            close_matches = difflib.get_close_matches(name, descriptions, cutoff=0.5)
            hint = f"; did you mean {' or '.join(close_matches)}?" if close_matches else "."
            _print_message(f"there is no figure {typed}{hint} All names:\n{table.rstrip()}")
            return 2
    results = _choose_results_folder(parsed_arguments.results, parsed_arguments.out)
    if results is None:
        _print_message(
            f"{ROOT / 'results'} cannot be written: name another folder by --results or --out"
        )
        return 2
    scripts_by_name = {name: list_script_and_description_by_figure()[name][0] for name in names}
    try:
        for name in scripts_by_name if parsed_arguments.out else ():
            check_that_export_overwrites_only_exports(parsed_arguments.out / name)
    except OSError as error:
        _print_message(str(error))
        return 2
    if not _compute_needed_results(
        list(dict.fromkeys(scripts_by_name.values())), results, parsed_arguments.jobs
    ):
        return 1
    folder = parsed_arguments.out or results / "figures"
    try:
        for name, script in scripts_by_name.items():
            for path in export_figure_as_png_and_pdf(script, Results(results), folder / name):
                print(path)
            print(format_caption_and_judged_statements(name, script, Results(results)))
    except (StudyError, OSError) as error:
        _print_message(str(error))
        return 1
    return 0


def normalise_figure_name(typed_name: str) -> str:
    """Convert inputs such as "Fig. 5", "fig5" or "Table 1" to names such as "fig05" or "tab01".

    Other names are returned unchanged.
    """
    pattern = r"(fig|figure|tab|table)s?[.\s_-]*0*(\d+)"
    if match := re.fullmatch(pattern, typed_name.strip(), re.IGNORECASE):
        return f"{match[1].lower()[:3]}{int(match[2]):02}"
    return typed_name


def format_caption_and_judged_statements(name: str, script: str, results: Results) -> str:
    """Return the caption of a figure, and the statements of the paper about it with judged values.

    Args:
        name: Name of a figure or table, such as "fig07", as in the sources of claims.
        script: Name of the script that draws it, such as "fig07_08".
        results: Stored results.
    """
    lines = [load_figure_script(script).caption(results)]
    claims = [claim for claim in load_paper_claims() if name in cited_figures(claim)]
    for verdict in judge_claims(claims, results):
        claim, judgement = verdict.claim, verdict.claim.judgement
        lines.append(f"{claim.id}: {claim.statement}")
        if judgement is not None:
            value_kind = "printed" if claim.printed else "expected"
            computed = "missing" if verdict.measured is None else f"{verdict.measured:.6g}"
            unit = f" {judgement.unit}" if judgement.unit else ""
            lines.append(
                f"  {value_kind} {judgement.relation} {judgement.value:.6g} ± "
                f"{judgement.tol:.3g}{unit}, "
                f"computed {computed}{unit}: {verdict.verdict} ({claim.grade})"
            )
        else:
            lines.append(f"  {verdict.verdict}")
    return "\n".join(lines)


def cited_figures(claim: Claim) -> set[str]:
    """Return names such as "fig07" of the figures and tables that the source of a claim cites."""
    names = set()
    pattern = r"(Fig|Table)s?\.? (\d+(?:(?:, | and |, and |-|–)\d+)*)"
    for kind, numbers in re.findall(pattern, claim.source):
        for number_range in re.split(r", and |, | and ", numbers):
            first_number, *last_numbers = (int(number) for number in re.split("[-–]", number_range))
            names |= {
                f"{kind.lower()[:3]}{n:02}"
                for n in range(first_number, (last_numbers or [first_number])[0] + 1)
            }
    return names


def list_script_and_description_by_figure() -> dict[str, tuple[str, str]]:
    """Return the script and the description of each figure, by name of figure.

    Figures and tables of the paper come first, ordered by number; several may share a script.
    """
    paper_items = [
        (f"{KIND_ABBREVIATIONS[item.kind]}{int(item.number):02}", Path(item.figure).stem, item)
        for item in ITEMS
        if item.figure
    ]
    paper_figures = {
        name: (script, f"{item.kind.capitalize()} {item.number}: {item.content}")
        for name, script, item in paper_items
    }
    return paper_figures | {
        name: (name, figure_title(name))
        for name in list_names_of_all_figures()
        if name not in paper_figures
    }


def draw_outdated_figures(folder: Path, require_all_results: bool, jobs: int = 1) -> bool:
    """Draw all figures that are not up to date, and write the index of figures.

    Args:
        folder: Folder of the stored results, from which figures are drawn.
        require_all_results: Whether missing results are an error; otherwise the figure is omitted.
        jobs: Number of processes.

    Returns:
        True if no script failed and no required result is missing.
    """
    script_names, results = list_names_of_all_figures(), Results(folder)
    current_entries = {name: find_index_entry_if_up_to_date(name, results) for name in script_names}
    entries_by_name: dict[str, FigureEntry] = {
        name: entry for name, entry in current_entries.items() if entry
    }
    any_failed, missing_by_figure = False, {}
    for name, outcome in _draw_figures(
        [name for name in script_names if name not in entries_by_name], folder, jobs
    ):
        if outcome.entry:
            entries_by_name[name] = outcome.entry
        elif outcome.missing:
            missing_by_figure[name] = outcome.missing
        else:
            _print_message(f"{name}: {outcome.error}")
            any_failed = True
    _report_missing_results(missing_by_figure, require_all_results)
    ordered_entries = [
        entries_by_name[name] for name in sorted(entries_by_name, key=natural_sort_key)
    ]
    try:
        write_json(folder / "figures" / "index.json", ordered_entries)
    except OSError as error:
        _print_message(f"the index of figures cannot be written: {error}")
        return False
    return not (any_failed or (require_all_results and missing_by_figure))


def _choose_results_folder(requested_folder: Path | None, out: Path | None) -> Path | None:
    """Choose the folder of results.

    Args:
        requested_folder: Folder from the command line, if any, which is used without a check.
        out: Folder of the drawn figures, if given.

    Returns:
        Absolute path of the requested folder, the project's folder if it is writable, or a
        subfolder of `out`; None if there is no such folder.
    """
    if requested_folder is not None:
        return requested_folder.absolute()
    results = ROOT / "results"
    try:
        create_writable_results_folder(results)
    except StudyError:
        return (out / "results").absolute() if out else None
    return results


def _compute_needed_results(script_names: list[str], results: Path, jobs: int) -> bool:
    """Run the study for all results that the given scripts require; return whether it succeeded."""
    keys = [key for name in script_names for key in load_figure_script(name).needs]
    command = [sys.executable, "-m", "study", *dict.fromkeys(keys)]
    command += ["--out", str(results), "--jobs", str(jobs)]
    return subprocess.run(command, cwd=ROOT, check=False).returncode == 0


def _draw_figures(
    names: list[str], folder: Path, jobs: int
) -> Iterator[tuple[str, DrawingOutcome]]:
    """Draw figures, in parallel if there are many; yield names and outcomes in the given order."""
    if jobs == 1 or len(names) <= MAX_LISTED_FIGURES:
        yield from ((name, draw_figure(name, folder)) for name in names)
        return
    pool = Pool(min(jobs, len(names)))
    for name in names:
        pool.submit(Task(name, draw_figure, (name, folder)))
    outcomes = {task.name: outcome for task, outcome in pool}
    for name in names:
        outcome = outcomes[name]
        if isinstance(outcome, DrawingOutcome):
            yield name, outcome
        else:
            error = (
                outcome.message if isinstance(outcome, TaskFailure) else "its process was killed"
            )
            yield name, DrawingOutcome(None, [], error)


def _report_missing_results(
    missing_by_figure: dict[str, list[str]], name_every_figure: bool
) -> None:
    """Print which figures are not drawn because results are missing.

    Args:
        missing_by_figure: Keys of the missing results, by name of figure.
        name_every_figure: Whether to name each figure. Otherwise, if there are more than
            `MAX_LISTED_FIGURES`, only their number and the sections of the results are printed.
    """
    if name_every_figure or len(missing_by_figure) <= MAX_LISTED_FIGURES:
        for name, keys in missing_by_figure.items():
            _print_message(f"{name}: not drawn, for want of {', '.join(keys)}")
    else:
        sections = dict.fromkeys(
            key.partition("/")[0] for keys in missing_by_figure.values() for key in keys
        )
        _print_message(
            f"{len(missing_by_figure)} not drawn, for want of results of sections "
            f"{', '.join(sections)}"
        )


def _print_message(message: str) -> None:
    print(f"figures: {message}", file=sys.stderr)


if __name__ == "__main__":
    run_supervised_and_exit(main, "figures")

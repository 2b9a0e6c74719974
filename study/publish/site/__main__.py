"""Make the site from stored results: `./run site [--results DIR] [--out DIR]`."""

import argparse
import os
import sys
from pathlib import Path

from study.publish.site import build_site
from study.run.cases import SECTIONS
from study.run.folder import create_or_mark_results_folder
from study.run.store import EXIT_CORRUPT, CorruptResult, Results, StudyError
from study.run.supervisor import run_supervised_and_exit

USAGE = """\
exit status: 0; 1 if something is missing; 2 for bad usage or if the site cannot be written;
3 if stored results are corrupt: the pages say what could not be shown
"""


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments of `./run site`, write the website, and return the exit status."""
    parser = argparse.ArgumentParser(prog="site", description=__doc__, epilog=USAGE)
    parser.add_argument("--results", type=Path, default=Path("results"), metavar="DIR")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: site, among the results")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="processes")
    options = parser.parse_args(arguments)
    caller_folder = Path(os.environ.get("PW_ELEMENTS_FOLDER", "."))
    out = caller_folder / options.out if options.out else options.results / "site"
    results = Results(options.results)
    try:
        if not any(results.cases(section) for section in SECTIONS):
            raise StudyError(f"there are no results in {results.folder}: run ./run study")
        create_or_mark_results_folder(results.folder)  # for the gallery's pictures
        problems = build_site(results, out.resolve(), options.jobs)
    except (StudyError, OSError) as error:
        print(f"site: {error}", file=sys.stderr)
        return EXIT_CORRUPT if isinstance(error, CorruptResult) else 2
    for problem in problems:
        print(f"site: {problem}", file=sys.stderr)
    print(f"site: {out / 'index.html'}")
    if any(results.error_messages_of_corrupt_results(section) for section in SECTIONS):
        return EXIT_CORRUPT
    return int(bool(problems))


if __name__ == "__main__":
    run_supervised_and_exit(main, "site")

"""Make the site from stored results: `./run site [--results DIR] [--out DIR]`."""

import argparse
import os
import sys
from pathlib import Path

from study.core.store import Results, StudyError
from study.core.supervisor import supervise
from study.site import build


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status: 1 if something is missing, 2 for bad usage."""
    parser = argparse.ArgumentParser(prog="site", description=__doc__)
    parser.add_argument("--results", type=Path, default=Path("results"), metavar="DIR")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: site, among the results")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="processes")
    options = parser.parse_args(arguments)
    folder = Path(os.environ.get("PW_ELEMENTS_FOLDER", "."))
    out = folder / options.out if options.out else options.results / "site"
    try:
        missing = build(Results(options.results), out.resolve(), options.jobs)
    except StudyError as error:
        print(f"site: {error}", file=sys.stderr)
        return 2
    for line in missing:
        print(f"site: {line}", file=sys.stderr)
    print(f"site: {out / 'index.html'}")
    return int(bool(missing))


if __name__ == "__main__":
    sys.exit(supervise(main, "site"))

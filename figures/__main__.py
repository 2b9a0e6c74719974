"""Draw the figures from stored results: `python3 -m figures [name ...] --results DIR`."""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path

from figures.drawing import Drawn, Entry, draw, natural, scripts, up_to_date
from study.core.pool import Failed, Pool, Task
from study.core.store import Results, write_json

FEW = 3  # so many figures that are not drawn are named one by one


def main(arguments: list[str] | None = None) -> int:
    """Draw the named figures, or all that are not up to date.

    Returns:
        0; 1 if a script failed, or a result is missing although all are said to be there; 2 if
        nothing could start.
    """
    parser = argparse.ArgumentParser(prog="python3 -m figures", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help="figures to draw (default: all)")
    parser.add_argument("--results", type=Path, default=Path("results"), metavar="DIR")
    parser.add_argument("--complete", action="store_true", help="fail where a result is missing")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes")
    options = parser.parse_args(arguments)
    known = scripts()
    unknown = [name for name in options.names if name not in known]
    if unknown:
        _say(f"there is no figure {unknown[0]}, but {', '.join(known)}")
        return 2
    results = Results(options.results)
    index: dict[str, Entry] = _index(results) if options.names else {}
    todo = options.names
    if not todo:
        current = {name: up_to_date(name, results) for name in known}
        index = {name: entry for name, entry in current.items() if entry}
        todo = [name for name in known if name not in index]
    failed, wanting = False, {}
    for name, drawn in _drawn(todo, options.results, options.jobs):
        index.pop(name, None)
        if drawn.entry:
            index[name] = drawn.entry
        elif drawn.missing:
            wanting[name] = drawn.missing
        else:
            _say(f"{name}: {drawn.error}")
            failed = True
    _tell(wanting, bool(options.names) or options.complete)
    ordered = [index[name] for name in sorted(index, key=natural)]
    try:
        write_json(options.results / "figures" / "index.json", ordered)
    except OSError as error:
        _say(f"{error.filename} cannot be written: {error.strerror}")
        return 1
    return int(failed or (options.complete and bool(wanting)))


def _drawn(names: list[str], folder: Path, jobs: int) -> Iterator[tuple[str, Drawn]]:
    """Draw figures, in processes of their own where that pays, and yield them in their order."""
    if jobs == 1 or len(names) <= FEW:
        yield from ((name, draw(name, folder)) for name in names)
        return
    pool = Pool(min(jobs, len(names)))
    for name in names:
        pool.submit(Task(name, draw, (name, folder)))
    found = {task.name: outcome for task, outcome in pool}
    for name in names:
        outcome = found[name]
        if isinstance(outcome, Drawn):
            yield name, outcome
        else:
            why = outcome.why if isinstance(outcome, Failed) else "its process was killed"
            yield name, Drawn(None, [], why)


def _tell(wanting: dict[str, list[str]], each: bool) -> None:
    """Say which figures want results; not one by one if they are many and nobody asked."""
    if each or len(wanting) <= FEW:
        for name, keys in wanting.items():
            _say(f"{name}: not drawn, for want of {', '.join(keys)}")
    else:
        sections = dict.fromkeys(key.partition("/")[0] for keys in wanting.values() for key in keys)
        _say(f"{len(wanting)} not drawn, for want of results of sections {', '.join(sections)}")


def _index(results: Results) -> dict[str, Entry]:
    """Return the entries of earlier drawings by name; an unreadable index counts as none."""
    try:
        entries = json.loads((results.folder / "figures" / "index.json").read_bytes())
        return {entry["name"]: entry for entry in entries}
    except (OSError, ValueError, TypeError, KeyError):
        return {}


def _say(line: str) -> None:
    print(f"figures: {line}", file=sys.stderr)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        _say("interrupted")
        sys.exit(130)

"""Draw the figures from stored results: `python3 -m figures [name ...] --results DIR`."""

import argparse
import hashlib
import io
import json
import pkgutil
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt

import figures
from figures.style import style
from study.core.store import Results, StudyError, write_json, write_whole

FRAME = {"__main__", "style", "symbols", "beam", "column", "contact", "convergence"}

DIGEST = "digest"  # of what the figures in a folder were all drawn from


def scripts() -> list[str]:
    """Return the names of all figure scripts, fig2 before fig10."""
    names = {module.name for module in pkgutil.iter_modules(figures.__path__)}
    return sorted(names - FRAME, key=_natural)


def draw(name: str, results: Results) -> dict[str, Any] | None:
    """Draw one figure into `<results>/figures`; return its entry of the index.

    Returns:
        None if a result that the figure needs has not been computed.
    """
    script = import_module(f"figures.{name}")
    missing = [key for key in script.NEEDS if key not in results]
    if missing:
        _say(f"{name}: not drawn, for want of {', '.join(missing)}")
        return None
    with style():
        figure = script.draw(results)
        try:
            width, height = (round(96 * inches) for inches in figure.get_size_inches())
            for kind, metadata in (("png", {}), ("svg", {"Date": None})):
                stream = io.BytesIO()
                figure.savefig(stream, format=kind, metadata=metadata)
                write_whole(_folder(results) / f"{name}.{kind}", stream.getvalue())
        finally:
            plt.close(figure)
    return {
        "name": name,
        "title": (script.__doc__ or name).strip().splitlines()[0].rstrip("."),
        "section": script.SECTION,
        "caption": script.caption(results),
        "alt": script.alt(results),
        "width": width,
        "height": height,
    }


def main(arguments: list[str] | None = None) -> int:
    """Draw the named figures, or all.

    Returns:
        0; 1 if a script failed, or a result is missing although all are said to be there; 2 if
        nothing could start.
    """
    parser = argparse.ArgumentParser(prog="python3 -m figures", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help="figures to draw (default: all)")
    parser.add_argument("--results", type=Path, default=Path("results"), metavar="DIR")
    parser.add_argument("--complete", action="store_true", help="fail where a result is missing")
    options = parser.parse_args(arguments)
    known = scripts()
    unknown = [name for name in options.names if name not in known]
    if unknown:
        _say(f"there is no figure {unknown[0]}, but {', '.join(known)}")
        return 2
    results = Results(options.results)
    digest = _digest(results)
    if not options.names and _drawn(results, known, digest):
        return 0
    index = _index(results) if options.names else {}
    failed = False
    for name in options.names or known:
        index.pop(name, None)
        try:
            entry = draw(name, results)
        except StudyError as error:
            _say(f"{name}: {error}")
            failed = True
        except Exception as error:  # one bad script must not take the others' figures away
            _say(f"{name}: {type(error).__name__}: {error}")
            failed = True
        else:
            if entry:
                index[name] = entry
            failed |= options.complete and not entry
    ordered = [index[name] for name in sorted(index, key=_natural)]
    write_json(_folder(results) / "index.json", ordered)
    if not failed and not options.names:
        write_whole(_folder(results) / DIGEST, digest.encode())
    return int(failed)


def _digest(results: Results) -> str:
    """Digest of all that the figures depend on: results, scripts, measures, Matplotlib."""
    project = Path(__file__).parents[1]
    scripts = [path for folder in figures.__path__ for path in Path(folder).glob("*.py")]
    sources = [*scripts, *project.glob("study/**/*.py")]
    digest = hashlib.sha256(matplotlib.__version__.encode())
    for path in sorted([*sources, *results.folder.glob("*/*.json")]):
        if path.parent != _folder(results):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def _drawn(results: Results, names: list[str], digest: str) -> bool:
    """Whether every figure is there, drawn from just this."""
    index = _index(results)
    mark = _folder(results) / DIGEST
    files = [_folder(results) / f"{name}.{kind}" for name in index for kind in ("png", "svg")]
    up_to_date = mark.is_file() and mark.read_text() == digest
    return (
        bool(index)
        and up_to_date
        and set(index) <= set(names)
        and all(path.is_file() for path in files)
    )


def _folder(results: Results) -> Path:
    return results.folder / "figures"


def _index(results: Results) -> dict[str, dict[str, Any]]:
    """Return the entries of earlier drawings by name; an unreadable index counts as none."""
    try:
        entries = json.loads((_folder(results) / "index.json").read_bytes())
        return {entry["name"]: entry for entry in entries}
    except (OSError, ValueError, TypeError, KeyError):
        return {}


def _natural(name: str) -> list[tuple[int, str]]:
    parts = re.findall(r"\d+|\D+", name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def _say(line: str) -> None:
    print(f"figures: {line}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())

"""Compare a release's tag with the version and its date: `python3 .ci/tag.py v0.1.0`.

The version is `__version__` in `pw_elements/__init__.py`. `CHANGELOG.md` has to begin with it and
with the date of its release, and `CITATION.cff` has to have both. The script needs only Python.
"""

import datetime
import re
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]


def find_faults(project: Path, tag: str) -> list[str]:
    """Return a line for each file of a project that does not agree with the tag."""
    version = tag.removeprefix("v")
    code = (project / "pw_elements" / "__init__.py").read_text("utf-8")
    changes = (project / "CHANGELOG.md").read_text("utf-8")
    citation = (project / "CITATION.cff").read_text("utf-8")
    heading = re.search(r"^## (.*)$", changes, re.MULTILINE)
    date = re.fullmatch(rf"{re.escape(version)} \((.*)\)", heading[1]) if heading else None
    faults = []
    if not re.fullmatch(r"v\d+\.\d+\.\d+", tag):
        faults.append(f"the tag {tag} is not v and three numbers, as v0.1.0")
    if f'\n__version__ = "{version}"\n' not in code:
        faults.append(f"pw_elements/__init__.py has another __version__ than {version}")
    if not date or not _is_date(date[1]):
        faults.append(f"the first heading of CHANGELOG.md is not '## {version} (YEAR-MONTH-DAY)'")
    elif f"\nversion: {version}\ndate-released: {date[1]}\n" not in citation:
        faults.append("CITATION.cff has another version or date-released than CHANGELOG.md")
    return faults


def _is_date(text: str) -> bool:
    try:
        return datetime.date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


def main(tag: str) -> int:
    """Print what does not agree with the tag; return 1 if there is something, otherwise 0."""
    faults = find_faults(PROJECT, tag)
    for line in faults:
        print(f"tag: {line}", file=sys.stderr)
    if not faults:
        print(f"== {tag} agrees with __version__, CHANGELOG.md and CITATION.cff")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

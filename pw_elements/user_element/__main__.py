"""Write the C source of a user element for Abaqus, and a Fortran file that may call it.

    python3 -m pw_elements.user_element --cell triangle --state plane-strain --out pw_t6.c

The guide's page "User elements in Abaqus" explains their use. They have never been run in Abaqus.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from pw_elements.elasticity import StressState
from pw_elements.files import ForeignFileOrFolder, replace_file_atomically
from pw_elements.user_element.source import CELLS, LAWS, generate_user_element

_GENERATED_MARK = b"NEVER RUN IN ABAQUS"


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the arguments, write the two files, and return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python3 -m pw_elements.user_element",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--cell", required=True, choices=CELLS)
    states = {state.value.replace(" ", "-"): state for state in StressState}
    parser.add_argument("--state", required=True, choices=tuple(states))
    parser.add_argument("--law", default="linear", choices=LAWS, help="default: linear")
    parser.add_argument(
        "--out", required=True, type=Path, metavar="FILE.c", help="beside it, FILE.f is written"
    )
    options = parser.parse_args(arguments)
    if options.out.suffix != ".c":
        parser.error(f"--out {options.out}: the name has to end with .c")
    try:
        element = generate_user_element(options.cell, states[options.state], options.law)
    except ValueError as error:
        parser.error(str(error))
    files = {".c": element.c_source, ".f": element.fortran_source}
    try:
        for suffix, text in files.items():
            path = options.out.with_suffix(suffix)
            replace_file_atomically(path, text.encode(), _is_generated)
            print(path)
    except (OSError, ForeignFileOrFolder) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    return 0


def _is_generated(path: Path) -> bool:
    """Return whether a file was written by this command, so that it may be replaced."""
    return _GENERATED_MARK in path.read_bytes()


if __name__ == "__main__":
    sys.exit(main())

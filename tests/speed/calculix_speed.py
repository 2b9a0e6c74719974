"""Measure CalculiX on the block of section 7.2, for comparison with `contact_speed`.

    python3 -m tests.speed.calculix_speed [--divisions 160] [--runs 3]

The command runs `ccx` with one thread and prints a table. It needs CalculiX, but not DOLFINx. The
block is pressed on the middle half of its upper side, in one step, and is in frictionless contact
with one rigid face by CalculiX's node-to-surface method.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from study.solutions.calculix.calculix import ask_calculix_for_its_version, find_calculix
from study.solutions.calculix.decks import BlockWithPrintedContactPressure, RectangleOfTrianglePairs


def measure(ccx: str, divisions: int, runs: int) -> list[float]:
    """Return the wall times of whole runs in seconds, without writing the deck."""

    class Fine(BlockWithPrintedContactPressure):
        mesh = RectangleOfTrianglePairs((0.0, 0.0), (4.0, 2.0), (divisions, divisions // 2))

    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "job.inp").write_text(Fine(pressed=(1.0, 3.0)).deck())
        for _ in range(runs):
            begin = time.perf_counter()
            subprocess.run(
                [ccx, "job"],
                cwd=folder,
                env=os.environ | {"OMP_NUM_THREADS": "1"},
                stdout=subprocess.DEVNULL,
                check=True,
            )
            seconds.append(time.perf_counter() - begin)
    return seconds


def main() -> int:
    """Print a table of wall times; return 1 if CalculiX is not installed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--divisions", type=int, nargs="+", default=[40, 80, 160])
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    ccx = find_calculix()
    if ccx is None:
        print("calculix_speed: ccx (Debian's calculix-ccx) is not installed", file=sys.stderr)
        return 1
    print(f"| triangles | CalculiX {ask_calculix_for_its_version(ccx)} |\n| ---: | ---: |")
    for divisions in options.divisions:
        seconds = measure(ccx, divisions, options.runs)
        middle, low, high = statistics.median(seconds), min(seconds), max(seconds)
        print(f"| {divisions * divisions} | {middle:.2f} s ({low:.2f}-{high:.2f}) |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Measure CalculiX on the block of section K: 10-node tetrahedra on a rough plane.

    python3 -m tests.speed.calculix_block [--cells 8 11] [--deck FOLDER]

The command runs `ccx` with one thread and prints a table. It needs CalculiX, but not DOLFINx. With
8 cells along the height, the model has 28 611 unknowns; with 11 cells, 71 415.

A block of 2 x 1 x 1 made of C3D10 elements is in surface-to-surface contact (mu = 0.3) with one
rigid face. In one step, it is pressed from above and pushed at one side in both tangential
directions. Since CalculiX's contact accounts for displacements, the loads are a thousandth of those
in section K. CPU time and memory are those of a whole run, without writing the deck. With
`--deck`, the decks are written but not run. The command
`./run python3 -m study.publish.renew_records 'K/*-CalculiX'` records the same runs.
"""

import argparse
import sys
from pathlib import Path

from study.benchmarks.k_cost.measure import make_calculix_block_on_rough_plane, measure_calculix_run
from study.solutions.calculix.calculix import ask_calculix_for_its_version, find_calculix


def main() -> int:
    """Print a table of costs, or write the decks; return 1 if CalculiX is not installed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cells", type=int, nargs="+", default=[8, 11])
    parser.add_argument("--deck", type=Path, help="folder to write the decks to")
    options = parser.parse_args()
    if options.deck:
        for cells in options.cells:
            (options.deck / f"block-{cells}.inp").write_text(
                make_calculix_block_on_rough_plane(cells).deck()
            )
        return 0
    calculix = find_calculix()
    if calculix is None:
        print("calculix_block: ccx (Debian's calculix-ccx) is not installed", file=sys.stderr)
        return 1
    print(f"CalculiX {ask_calculix_for_its_version(calculix)}, C3D10\n")
    print("| unknowns | CPU s | wall s | MB | iterations |\n|---:|---:|---:|---:|---:|")
    for cells in options.cells:
        cost = measure_calculix_run(calculix, make_calculix_block_on_rough_plane(cells))
        print(
            f"| {cost['dofs']} | {cost['whole_seconds']:.1f} | {cost['wall_seconds']:.1f} | "
            f"{cost['megabytes']:.0f} | {cost['iterations']} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""CalculiX on the block of section K's record: 10-node tetrahedra on a rough plane.

    python3 -m tests.speed.calculix_block [--cells 8 11] [--deck FOLDER]

runs `ccx` with one thread where it is installed (on the system itself: it needs no DOLFINx) and
prints a table; 8 cells along the height make 28 611 unknowns, 11 make 71 415. A block 2 x 1 x 1
of C3D10 lies on one rigid face by surface-to-surface contact (mu = 0.3), is pressed from above
and pushed at one side in both directions, in one step. Contact makes CalculiX follow
displacements, so that the loads are a thousandth. CPU seconds and memory are those of the whole
run, the deck written beforehand; with `--deck` the decks are written, and nothing is run, with
`--record` the costs become rows of section K's record.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from study.benchmarks.k_cost.measure import RECORD, Row, describe_machine
from study.solutions.calculix.calculix import PeerError, executable, version
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.standard_decks import RoughBlock


@dataclass(frozen=True)
class Cost:
    """Of one run.

    Attributes:
        cpu: Seconds, of system calls too.
        wall: Seconds.
        megabytes: Largest resident size.
        iterations: Of the contact.
    """

    cpu: float
    wall: float
    megabytes: float
    iterations: int


def block(cells: int) -> RoughBlock:
    """The block with so many cubes along its height."""
    return RoughBlock("C3D10", Grid("T10", (0.0,) * 3, (2.0, 1.0, 1.0), (2 * cells, cells, cells)))


def measure(ccx: str, problem: RoughBlock) -> Cost:
    """Costs of one run.

    Raises:
        PeerError: if CalculiX fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "job.inp").write_text(problem.deck())
        begin = time.perf_counter()
        output = [(os.POSIX_SPAWN_OPEN, 1, f"{folder}/said", os.O_WRONLY | os.O_CREAT, 0o600)]
        command = ["env", "-C", folder, "OMP_NUM_THREADS=1", ccx, "job"]
        started = os.posix_spawnp("env", command, os.environ, file_actions=output)
        _, status, used = os.wait4(started, 0)
        wall = time.perf_counter() - begin
        said = Path(folder, "said").read_text()
        if status or "Job finished" not in said or "*ERROR" in said:
            raise PeerError(f"CalculiX failed:\n{said[-1000:]}")
        iterations = sum(int(row.split()[3]) for row in _increments(Path(folder, "job.sta")))
    return Cost(used.ru_utime + used.ru_stime, wall, used.ru_maxrss / 1024, iterations)


def _increments(path: Path) -> list[str]:
    return path.read_text().splitlines()[2:]


def _record(cells: int, dofs: int, cost: Cost) -> None:
    row = Row("contact", "C3D10", cells, "CalculiX")
    content = json.loads(RECORD.read_text(encoding="utf-8"))
    content["rows"] = [one for one in content["rows"] if Row(**one["row"]) != row]
    measured = {"dofs": dofs, "iterations": cost.iterations, "megabytes": cost.megabytes}
    measured |= {"whole_seconds": cost.cpu, "wall_seconds": cost.wall}
    content["rows"].append(
        {"row": asdict(row), "machine": describe_machine(), "measured": measured}
    )
    RECORD.write_text(json.dumps(content, indent=1) + "\n")


def main() -> int:
    """Measures and prints; 1 where there is no CalculiX."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cells", type=int, nargs="+", default=[8, 11])
    parser.add_argument("--deck", type=Path, help="folder to write the decks to")
    parser.add_argument("--record", action="store_true", help="for section K")
    options = parser.parse_args()
    if options.deck:
        for cells in options.cells:
            (options.deck / f"block-{cells}.inp").write_text(block(cells).deck())
        return 0
    ccx = executable()
    if ccx is None:
        print("calculix_block: ccx (Debian's calculix-ccx) is not installed", file=sys.stderr)
        return 1
    print(f"CalculiX {version(ccx)}, C3D10\n")
    print("| unknowns | CPU s | wall s | MB | iterations |\n|---:|---:|---:|---:|---:|")
    for cells in options.cells:
        problem = block(cells)
        cost = measure(ccx, problem)
        print(
            f"| {3 * len(problem.grid.nodes)} | {cost.cpu:.1f} | {cost.wall:.1f} | "
            f"{cost.megabytes:.0f} | {cost.iterations} |",
            flush=True,
        )
        if options.record:
            _record(cells, 3 * len(problem.grid.nodes), cost)
    return 0


if __name__ == "__main__":
    sys.exit(main())

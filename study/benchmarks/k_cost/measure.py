"""Measure time and memory, each row in processes of its own, and write the record of section K.

    ./run python3 -m study.benchmarks.k_cost.measure                 all rows, some 40 minutes
    ./run python3 -m study.benchmarks.k_cost.measure --only contact  rows of some tasks

Seconds are CPU time of all processes, medians of three runs where one takes less than ten seconds;
megabytes are the largest resident sizes, added up, imports included. Other work on the machine
changes them little, wall time much: rows that were measured on a busy machine say so.
"""

import argparse
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from study.benchmarks.k_cost.tasks import TASKS, Row
from study.run.store import write_json

RECORD = Path(__file__).parents[2] / "run" / "cost_record.json"
N_RUNS = 3
LONG_RUN = 10.0
"""CPU seconds above which one run is enough."""
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}
"""One thread per process: with several, CPU time would not be comparable."""


# Rows


def list_rows() -> Iterator[Row]:
    """Yield all rows of the record but CalculiX's."""
    plane = [(element, n) for element in ("galerkin-T6", "pw-T6") for n in (32, 64, 128, 256)]
    solid = [(element, n) for element in ("galerkin-T10", "pw-T10") for n in (5, 8, 11)]
    for element, n in plane + solid:
        for task in ("assembly", "factors"):
            yield Row(task, element, n)
    for element, n in [*plane, *((e, n) for e, n in solid if n < 11)]:
        yield Row("frequencies", element, n)
    for element in ("galerkin-T10", "pw-T10"):
        for n in (5, 8, 11):
            yield Row("contact", element, n)
            yield Row("contact", element, n, "Iterative")
        yield Row("contact", element, 16, "Iterative")
    for processes in (2, 4):
        yield Row("contact", "pw-T10", 16, "Iterative", processes)
    yield Row("contact", "pw-T10", 27, "Iterative")
    yield Row("contact", "pw-T10", 35, "Iterative", 2)
    for method in ("Direct", "Iterative", "compared"):
        yield Row("bodies", "pw-T10", 10, method)
    for n in (7, 14):
        yield Row("bodies", "pw-T10", n, "Iterative")
    for processes in (1, 2, 3):
        yield Row("bodies", "pw-T10", 20, "Iterative", processes)
    for n in (10, 20, 40, 80):
        yield Row("search", "pw-T10", n, "graded")
    for n in (30, 100, 300, 1000):
        yield Row("pieces", "pw-T6", n)
    for n in (10, 25, 50, 100):
        yield Row("pieces", "pw-T10", n, "Iterative")
    for n in (5, 10, 17):
        yield Row("sliding", "pw-T10", n, "Iterative")
    for n in (8, 11):
        yield Row("contact", "pw-hybrid-T10", n)
    for n in (8, 11, 16, 22):
        yield Row("contact", "pw-hybrid-T10", n, "Iterative")
    yield Row("contact", "pw-hybrid-T10", 16, "Iterative", 2)
    for element in ("galerkin-hybrid-T10", "pw-hybrid-T10"):
        for n in (5, 8):
            yield Row("incompressible", element, n)
        for n in (5, 8, 11, 16, 22):
            yield Row("incompressible", element, n, "Iterative")
    yield Row("incompressible", "pw-hybrid-T10", 22, "Iterative", 2)
    for n in (5, 8, 11, 13, 16, 27):
        yield Row("linear", "pw-T10", n, "Iterative")
    for n in (17, 35):
        yield Row("linear", "pw-T10", n, "Iterative", 2)


# Record


def main() -> None:
    """Write the record; rows that are not measured now stay as they are."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--only", nargs="*", help="tasks")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        _run_here(Row(**json.loads(options.one)))
        return
    names = {row.name for row in list_rows() if options.only is None or row.task in options.only}
    write_record(RECORD, names)


def write_record(path: Path, names: set[str]) -> None:
    """Measure rows by their names, and write them among those of the tracked record."""
    content = json.loads(RECORD.read_text()) if RECORD.is_file() else {"rows": []}
    entries = {Row(**entry["row"]).name: entry for entry in content["rows"]}
    for row in list_rows():
        if row.name in names:
            machine = describe_machine()
            measured = measure_row(row)
            entries[row.name] = {"row": asdict(row), "machine": machine, "measured": measured}
            print(row.name, measured, file=sys.stderr, flush=True)
            write_json(path, {"rows": list(entries.values())})


def describe_machine() -> str:
    """Return cores, processor and memory; "busy" where more work waits than there are cores."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":")[1].strip() for line in lines if "model name" in line), "?")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    machine = f"{os.cpu_count()} cores of {model or platform.machine()}, {memory:.0f} GB, shared"
    load = os.getloadavg()[0]
    return f"{machine}, busy (load {load:.0f})" if load > (os.cpu_count() or 1) else machine


def measure_row(row: Row) -> dict[str, float]:
    """Return the medians of several runs, or the numbers of a single long one."""
    runs: list[dict[str, float]] = []
    for _ in range(N_RUNS):
        runs.append(run_alone(row))
        if runs[-1]["whole_seconds"] > LONG_RUN:
            break
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


def run_alone(row: Row) -> dict[str, float]:
    """Return the numbers of a row, measured by processes of its own."""
    module = "study.benchmarks.k_cost.measure"
    command = [sys.executable, "-m", module, "--one", json.dumps(asdict(row))]
    if row.processes > 1:
        command = ["mpirun", "-n", str(row.processes), *command]
    environment = os.environ | ENVIRONMENT
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    numbers: dict[str, float] = json.loads(run.stdout.strip().splitlines()[-1])
    return numbers


def _run_here(row: Row) -> None:
    """Measure one row in this process, and print its numbers."""
    from mpi4py import MPI

    comm, started = MPI.COMM_WORLD, time.perf_counter()
    numbers = TASKS[row.task](row)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    numbers["wall_seconds"] = comm.allreduce(time.perf_counter() - started, MPI.MAX)
    numbers["whole_seconds"] = comm.allreduce(time.process_time())
    numbers["megabytes"] = comm.allreduce(peak)
    if comm.rank == 0:
        print(json.dumps(numbers))


if __name__ == "__main__":
    main()

"""Measure CPU time and memory for section K, each measurement in separate processes.

`./run python3 -m study.publish.renew_records 'K/*'` performs all measurements and writes the
record. Times are CPU seconds summed over all processes: the median of three runs, or a single run
if it takes more than ten seconds. Tasks with the name "peer-*" are measured with other programs:
all rows of a task are run in turn, three times, and the run with the least CPU time is recorded.
They need CalculiX (`ccx` in the path, or named by the environment variable `CALCULIX`) and felupe
with pypardiso (`./run pip install felupe pypardiso`, or in a folder of `PW_ELEMENTS_PATH`). Memory in megabytes is the sum of the processes' largest resident
sizes, including imports. Other work on the machine affects CPU time and memory little, but wall
time much; the record notes if the machine was busy.
"""

import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import numpy as np

from study.benchmarks.k_cost.tasks import (
    CALCULIX,
    EXACT_DIGITS,
    FELUPE,
    FORCING,
    PEER_OF_TASK,
    TASKS,
    Measurement,
    measure_felupe,
)
from study.model.corner_forces import corner_over_midside_on_face
from study.run import records
from study.solutions.calculix import calculix
from study.solutions.calculix.blocks_in_space import SLIDING_BLOCKS, SlidingBlock
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.output import Array, CalculixError
from study.solutions.calculix.shrink_fit import (
    INTERFERENCE,
    RADII,
    SHRUNK_TUBES,
    ShrunkTubes,
    compute_lame_pressure,
)
from study.solutions.calculix.standard_decks import (
    BlockOnRoughRigidPlane,
    BlockOnRoughRigidPlaneByNodes,
)
from study.solutions.felupe import cylinder

CALCULIX_LOAD_FACTOR = 1000.0
"""Loads of the block in section K over those in the deck for CalculiX."""
N_RUNS = 3
LONG_RUN_SECONDS = 10.0
"""CPU seconds above which a measurement is not repeated."""
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}
"""Environment of measured processes: one thread each, so that CPU times are comparable."""


# Measurements


def list_measurements() -> Iterator[Measurement]:
    """Yield all measurements of section K in the order of the record's rows."""
    plane = [(element, n) for element in ("galerkin-T6", "pw-T6") for n in (32, 64, 128, 256)]
    solid = [(element, n) for element in ("galerkin-T10", "pw-T10") for n in (5, 8, 11)]
    for element, n in (*plane, *solid):
        if n in (256, 11):
            yield Measurement("assembly", element, n)
        yield Measurement("factors", element, n)
    for element, n in (*plane, *((e, n) for e, n in solid if n < 11)):
        yield Measurement("frequencies", element, n)
    for element in ("galerkin-T10", "pw-T10"):
        for n in (5, 8, 11):
            yield Measurement("contact", element, n)
            yield Measurement("contact", element, n, "Iterative")
        yield Measurement("contact", element, 16, "Iterative")
    yield Measurement("contact", "pw-T10", 16, "Iterative", processes=2)
    yield Measurement("contact", "pw-T10", 27, "Iterative")
    yield Measurement("contact", "pw-T10", 35, "Iterative", processes=2)
    for n in (8, 11):
        yield Measurement("contact", "C3D10", n, CALCULIX)
    for n in (8, 11, 16, 27):
        yield Measurement("linear", "pw-T10", n, "Iterative")
    yield Measurement("linear", "pw-T10", 35, "Iterative", processes=2)
    for method in ("Direct", "Iterative", "compared"):
        yield Measurement("bodies", "pw-T10", 10, method)
    for n in (7, 14):
        yield Measurement("bodies", "pw-T10", n, "Iterative")
    for processes in (1, 2, 3):
        yield Measurement("bodies", "pw-T10", 20, "Iterative", processes)
    for n in (10, 25, 50, 100):
        yield Measurement("pieces", "pw-T10", n, "Iterative")
    for n in (5, 10, 17):
        yield Measurement("sliding", "pw-T10", n, "Iterative")
    for n in (6, 10, 17):
        if n < 17:
            yield Measurement("sliding-bodies", "pw-T10", n)
        yield Measurement("sliding-bodies", "pw-T10", n, "Iterative")
    yield Measurement("contact", "pw-hybrid-T10", 11)
    for n in (8, 11, 16, 22):
        yield Measurement("contact", "pw-hybrid-T10", n, "Iterative")
    for element, numbers in (("galerkin", (8, 22)), ("pw", (5, 8, 11, 16, 22))):
        yield Measurement("incompressible", f"{element}-hybrid-T10", 8)
        for n in numbers:
            yield Measurement("incompressible", f"{element}-hybrid-T10", n, "Iterative")
    yield Measurement("incompressible", "pw-hybrid-T10", 22, "Iterative", processes=2)
    for element, method in (
        ("pw-T10", "Direct"),
        ("pw-T10", "Iterative"),
        ("galerkin-T10", "Iterative"),
        ("C3D10", f"{CALCULIX}-nodes"),
        ("C3D10", CALCULIX),
    ):
        yield Measurement("peer-block", element, 5, method)
    for element, method in (
        ("pw-T6", "Direct"),
        ("galerkin-T6", "Direct"),
        ("triangle6", FELUPE),
    ):
        yield Measurement("peer-rubber", element, 16, method)
    for element, method in (
        ("pw-T10", "Direct"),
        ("galerkin-T10", "Direct"),
        ("C3D10", f"{CALCULIX}-surface"),
        ("C3D10", f"{CALCULIX}-mortar"),
    ):
        yield Measurement("peer-sliding", element, 1, method)
    for element, method in (("pw-T10", "Direct"), ("C3D10", CALCULIX)):
        yield Measurement("peer-fit", element, 8, method)


# Record


def measurement_from_record_row(row: records.RecordRow) -> Measurement:
    """Return the measurement (task, element, size, method) that a row of the record describes."""
    return Measurement(**row.content["row"])


def measure_cases_and_write_record(path: Path, measured_case_names: Iterable[str]) -> None:
    """Repeat measurements, and write a copy of the tracked record with the new rows.

    Rows of other programs, and rows that are compared with them, are copied unchanged.

    Args:
        path: File to write; it is updated after each measurement.
        measured_case_names: Names of the measurements to repeat.
    """
    rows = records.read_rows(records.TIME_AND_MEMORY)
    for measurement in list_measurements():
        if measurement.name in measured_case_names and is_measured_without_peers(measurement):
            row = rows[measurement.key] = measure_and_make_record_row(measurement)
            print(row.key, row.content["measured"], file=sys.stderr, flush=True)
            records.write_rows(path, rows.values())


def is_measured_without_peers(measurement: Measurement) -> bool:
    """Return whether a measurement needs no other program."""
    return not (measurement.peer or measurement.is_compared_with_peer)


def find_missing_peer(measurement: Measurement) -> str:
    """Return which program must be installed to measure a row; empty if none is missing."""
    peer = measurement.peer or PEER_OF_TASK.get(measurement.task)
    if peer == CALCULIX and not calculix.find_calculix():
        return calculix.MISSING
    if peer == FELUPE and (missing := cylinder.find_missing_packages()):
        return f"{' and '.join(missing)} (packages of Python) not installed"
    return ""


def measure_and_make_record_row(measurement: Measurement) -> records.RecordRow:
    """Measure time and memory, and return a row of the record with the numbers and the machine."""
    machine = describe_machine_and_load()
    versions = None
    if measurement.peer == CALCULIX:
        calculix_path = calculix.find_calculix()
        if calculix_path is None:
            raise CalculixError(calculix.MISSING)
        versions = {"calculix": calculix.ask_calculix_for_its_version(calculix_path)}
    elif measurement.peer == FELUPE:
        versions = cylinder.list_versions()
    measured = (
        measure_alternately(measurement.task)[measurement]
        if measurement.is_compared_with_peer
        else measure_medians_of_repeated_runs(measurement)
    )
    content = {"row": asdict(measurement), "measured": measured}
    input_sha256 = records.digest_input(asdict(measurement))
    return records.create_row_with_current_date(
        measurement.key, input_sha256, content, versions, machine
    )


def describe_machine_and_load() -> str:
    """Describe cores, processor and memory; add "busy" if the load exceeds the number of cores."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":")[1].strip() for line in lines if "model name" in line), "?")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    machine = f"{os.cpu_count()} cores of {model or platform.machine()}, {memory:.0f} GB, shared"
    load = os.getloadavg()[0]
    return f"{machine}, busy (load {load:.0f})" if load > (os.cpu_count() or 1) else machine


def measure_medians_of_repeated_runs(measurement: Measurement) -> dict[str, float]:
    """Return the median of each measured quantity over `N_RUNS` runs, or one long run's values."""
    runs: list[dict[str, float]] = []
    for _ in range(N_RUNS):
        runs.append(measure_one_run_in_new_processes(measurement))
        if runs[-1]["whole_seconds"] > LONG_RUN_SECONDS:
            break
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


@cache
def measure_alternately(task: str) -> dict[Measurement, dict[str, float]]:
    """Run all measurements of a task in turn, `N_RUNS` times; return those of the fastest runs.

    Args:
        task: Name of a task that is compared with another program.

    Returns:
        Measured quantities of the run with the least CPU time, by measurement.
    """
    measurements = [candidate for candidate in list_measurements() if candidate.task == task]
    fastest: dict[Measurement, dict[str, float]] = {}
    for _ in range(N_RUNS):
        for measurement in measurements:
            run = measure_one_run_in_new_processes(measurement)
            best = fastest.setdefault(measurement, run)
            if run["whole_seconds"] < best["whole_seconds"]:
                fastest[measurement] = run
    return fastest


def measure_one_run_in_new_processes(measurement: Measurement) -> dict[str, float]:
    """Run a measurement once in new processes, and return the measured quantities by name."""
    module = "study.benchmarks.k_cost.measure"
    command = [sys.executable, "-m", module, json.dumps(asdict(measurement))]
    if measurement.processes > 1:
        command = ["mpirun", "-n", str(measurement.processes), *command]
    environment = os.environ | ENVIRONMENT
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    numbers: dict[str, float] = json.loads(run.stdout.strip().splitlines()[-1])
    return numbers


def _measure_in_this_process_and_print(measurement: Measurement) -> None:
    """Measure in this process, and print the measured quantities as one line of JSON."""
    if measurement.peer == CALCULIX:
        calculix_path = calculix.find_calculix()
        assert calculix_path is not None
        if measurement.task == "peer-sliding":
            kind = measurement.method.removeprefix(f"{CALCULIX}-")
            block = SLIDING_BLOCKS[f"block-sliding-in-space-{kind}"]
            block = replace(block, sliding_elements=measurement.cells)
            cost, answer = run_and_measure_calculix(calculix_path, block)
            cost["increments"] = block.increments * len(block.times)
            cost |= {"normal": answer["N"][-1], "tangential": answer["T"][-1]}
            print(json.dumps(cost))
            return
        if measurement.task == "peer-fit":
            tubes = replace(SHRUNK_TUBES["shrunk-tubes"], around=measurement.cells)
            cost, answer = run_and_measure_calculix(calculix_path, tubes)
            error = np.abs(answer["pressure"] / compute_lame_pressure(RADII, INTERFERENCE) - 1)
            print(json.dumps(cost | {"increments": 1, "largest_error": float(error.max())}))
            return
        by_nodes = measurement.method != CALCULIX
        problem = make_calculix_block_on_rough_plane(measurement.cells, by_nodes)
        cost, answer = run_and_measure_calculix(calculix_path, problem)
        if measurement.is_compared_with_peer:
            cost |= evaluate_calculix_block(problem, answer)
        print(json.dumps(cost))
        return
    start = time.perf_counter()
    if measurement.peer == FELUPE:
        numbers = measure_felupe(measurement)
        numbers["wall_seconds"] = time.perf_counter() - start
        numbers["whole_seconds"] = time.process_time()
        numbers["megabytes"] = read_peak_memory_in_megabytes()
        print(json.dumps(numbers))
        return
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    numbers = TASKS[measurement.task](measurement)
    numbers["wall_seconds"] = comm.allreduce(time.perf_counter() - start, MPI.MAX)
    numbers["whole_seconds"] = comm.allreduce(time.process_time())
    numbers["megabytes"] = comm.allreduce(read_peak_memory_in_megabytes())
    if comm.rank == 0:
        print(json.dumps(numbers))


def read_peak_memory_in_megabytes() -> float:
    """Return the largest resident size of this process so far, in megabytes.

    Unlike `ru_maxrss`, this value excludes the peak memory of the parent process.
    """
    status = Path("/proc/self/status").read_text()
    (kilobytes,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return int(kilobytes) / 1024


# Cost relative to its parts


def compute_time_ratios_of_contact_to_its_parts(
    contact: Measurement, measured_numbers: dict[Measurement, dict[str, float]]
) -> dict[str, float]:
    """Return ratios of the CPU time of a whole contact analysis to that of its linear parts.

    The measurement of the task "linear" for the same block provides the times of assembly, of one
    set-up of the multigrid levels, and of linear solutions with the clamped stiffness K to two
    accuracies. The denominator of the ratio `over_bare` is the time of assembly, one set-up, and
    one linear solution per Newton step. The time of such a solution is interpolated between the
    two accuracies according to the residual reduction required in the step (`digits` is the sum of
    the decimal logarithms of these reductions). The set-up is counted once, although contact
    renews parts of the levels; imports, meshing, and the set-up and checks of contact are not
    counted. The denominator of `over_solutions` is a lower bound: assembly, and one linear solution
    to the relative residual `FORCING` per step, without set-up and without an exact last step.

    Args:
        contact: Measurement whose ratios are computed.
        measured_numbers: Measured quantities of all measurements, by name.

    Returns:
        The two ratios; empty unless `contact` is an iterative contact solution for which a "linear"
        measurement exists.
    """
    linear_measurement = replace(contact, task="linear")
    is_iterative_contact = contact.task == "contact" and contact.method == "Iterative"
    if not is_iterative_contact or linear_measurement not in measured_numbers:
        return {}
    linear, measured = measured_numbers[linear_measurement], measured_numbers[contact]
    n_steps = measured["iterations"]
    forcing_digits = -math.log10(FORCING)
    further_digits = measured["digits"] - n_steps * forcing_digits
    seconds_per_digit = (linear["exact_seconds"] - linear["seconds"]) / (
        EXACT_DIGITS - forcing_digits
    )
    solutions = n_steps * linear["seconds"] + linear["assembly_seconds"]
    parts = solutions + linear["set_up_seconds"] + further_digits * seconds_per_digit
    whole = measured["whole_seconds"]
    return {"over_bare": whole / parts, "over_solutions": whole / solutions}


# CalculiX on the block that stands on a rough plane


def make_calculix_block_on_rough_plane(
    cells_along_height: int, by_nodes: bool = False
) -> BlockOnRoughRigidPlane:
    """Return the CalculiX problem of the block on a rough plane.

    Args:
        cells_along_height: Number of cubes (of six tetrahedra) along the height of the block.
        by_nodes: Whether contact is node-to-surface; otherwise it is surface-to-surface.
    """
    grid = Grid(
        "T10",
        (0.0,) * 3,
        (2.0, 1.0, 1.0),
        (2 * cells_along_height, cells_along_height, cells_along_height),
    )
    make_problem = BlockOnRoughRigidPlaneByNodes if by_nodes else BlockOnRoughRigidPlane
    return make_problem("C3D10", grid)


def measure_calculix_run(calculix_path: str, problem: BlockOnRoughRigidPlane) -> dict[str, float]:
    """Run CalculiX once on one thread; return unknowns, iterations, megabytes and seconds.

    The measured memory is at least that of this process, which should therefore be small.

    Args:
        calculix_path: Path of CalculiX.
        problem: Problem to solve.

    Raises:
        CalculixError: If CalculiX fails.
    """
    return run_and_measure_calculix(calculix_path, problem)[0]


def run_and_measure_calculix(
    calculix_path: str, problem: BlockOnRoughRigidPlane | SlidingBlock | ShrunkTubes
) -> tuple[dict[str, float], dict[str, Array]]:
    """Run CalculiX once; return the measured quantities and the numbers that it printed.

    The arguments and errors are those of `measure_calculix_run`.
    """
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "job.inp").write_text(problem.deck())
        start = time.perf_counter()
        output_path = Path(folder, "output")
        flags = os.O_WRONLY | os.O_CREAT
        redirection = [(os.POSIX_SPAWN_OPEN, 1, str(output_path), flags, 0o600)]
        command = ["env", "-C", folder, "OMP_NUM_THREADS=1", calculix_path, "job"]
        process = os.posix_spawnp("env", command, os.environ, file_actions=redirection)
        _, status, usage = os.wait4(process, 0)
        wall_seconds = time.perf_counter() - start
        calculix.check_calculix_finished(status, output_path.read_text())
        increments = Path(folder, "job.sta").read_text().splitlines()[2:]
        iterations = sum(int(line.split()[3]) for line in increments)
        suffix = getattr(problem, "output_suffix", ".dat")
        answer = problem.read_numbers(Path(folder, f"job{suffix}").read_text())
    nodes = problem.grid.nodes if isinstance(problem, BlockOnRoughRigidPlane) else problem.nodes
    cost = {
        "dofs": 3 * len(nodes),
        "iterations": iterations,
        "megabytes": usage.ru_maxrss / 1024,
        "whole_seconds": usage.ru_utime + usage.ru_stime,
        "wall_seconds": wall_seconds,
    }
    return cost, answer


def evaluate_calculix_block(
    problem: BlockOnRoughRigidPlane, answer: dict[str, Array]
) -> dict[str, float]:
    """Return forces and the largest displacement of CalculiX, scaled to the loads of section K.

    CalculiX prints no nodal contact forces. They are the stiffness matrix of the library's standard
    element, which is the same element on the same mesh, times the printed displacements.

    Args:
        problem: Problem that CalculiX has solved.
        answer: Numbers that CalculiX printed.
    """
    from study.benchmarks.p_calculix.standard_elements import (
        REDUCED_DEGREES,
        StandardElementModel,
    )

    nodes = np.array(problem.grid.nodes)
    displacement = answer["displacement"].reshape(-1, 3)[: len(nodes)]
    model = StandardElementModel(problem, REDUCED_DEGREES[problem.grid.cell])
    a = model.K.createVecRight()
    a.setArray(displacement[model.grid_index].ravel())
    nodal_force = model.reorder_to_grid_numbering((model.K * a).array_r.reshape(-1, 3))
    base = np.array(problem.grid.find_nodes(problem.marker_of_bottom)) - 1
    cells = problem.grid.divisions[2]
    force = CALCULIX_LOAD_FACTOR * answer["force"]
    return {
        "increments": 1,
        "normal": float(abs(force[2])),
        "tangential": float(np.linalg.norm(force[:2])),
        "corner_over_mid": corner_over_midside_on_face(nodes[base], nodal_force[base, 2], cells),
        "largest_displacement": CALCULIX_LOAD_FACTOR
        * float(np.linalg.norm(displacement, axis=1).max()),
    }


if __name__ == "__main__":
    _measure_in_this_process_and_print(Measurement(**json.loads(sys.argv[1])))

"""Measures time and memory, each row by processes of its own, and writes the record of section K.

    ./run python3 -m study.cost.measure                 all rows, some 40 minutes
    ./run python3 -m study.cost.measure --only contact  rows of some tasks

Seconds are CPU time of all processes, medians of three runs where one takes less than ten seconds;
megabytes are the largest resident sizes, added up, imports included. Other work on the machine
changes them little, wall time much: of that only the parallel rows say anything.
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
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

RECORD = Path(__file__).with_name("record.json")
REPEATS = 3
# Seconds above which one run is enough
ONCE = 10.0
# Of the body: a block 2 x 1 (x 1), E, nu
YOUNGS_MODULUS, POISSONS_RATIO = 1000.0, 0.3
PRESSURE, PUSH, FRICTION = 100.0, 20.0, 0.3
MODES = 6
# Threads would blur what CPU time means
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}


@dataclass(frozen=True)
class Row:
    """What is measured.

    Args:
        task: "assembly", "factors", "frequencies" or "contact".
        element: as in the study, or one of CalculiX.
        cells: along the height of the block.
        method: "Direct", "Iterative", or "nested": from the state of half as many cells; or
            "CalculiX", which `study.benchmarks.calculix_block` measures.
        processes: of MPI.
    """

    task: str
    element: str
    cells: int
    method: str = "Direct"
    processes: int = 1

    @property
    def name(self) -> str:
        """For files."""
        parallel = f"-{self.processes}" if self.processes > 1 else ""
        return f"{self.task}-{self.element}-{self.cells}-{self.method}{parallel}"


def rows() -> Iterator[Row]:
    """All of the record."""
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
    for n in (11, 16, 27):
        yield Row("contact", "pw-T10", n, "nested")
    yield Row("contact", "pw-T10", 27, "Iterative")
    for method in ("Iterative", "nested"):
        yield Row("contact", "pw-T10", 35, method, 2)


def main() -> None:
    """Writes the record; rows that are not measured now stay as they are."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--only", nargs="*", help="tasks")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        _one(Row(**json.loads(given.one)))
        return
    known = {}
    if RECORD.is_file():
        known = {Row(**row["row"]).name: row for row in json.loads(RECORD.read_text())["rows"]}
    for row in rows():
        if given.only is None or row.task in given.only:
            known[row.name] = {"row": asdict(row), "measured": _median(row)}
            print(row.name, known[row.name]["measured"], flush=True)
            content = {"machine": machine(), "rows": list(known.values())}
            RECORD.write_text(json.dumps(content, indent=1) + "\n")


def machine() -> str:
    """The machine in words."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":")[1].strip() for line in lines if "model name" in line), "?")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return f"{os.cpu_count()} cores of {model or platform.machine()}, {memory:.0f} GB, shared"


def _median(row: Row) -> dict[str, float]:
    """Of several runs."""
    runs: list[dict[str, float]] = []
    for _ in range(REPEATS):
        runs.append(_run(row))
        if runs[-1]["whole_seconds"] > ONCE:
            break
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


def _run(row: Row) -> dict[str, float]:
    command = [sys.executable, "-m", "study.cost.measure", "--one", json.dumps(asdict(row))]
    if row.processes > 1:
        command = ["mpirun", "-n", str(row.processes), *command]
    environment = os.environ | ENVIRONMENT
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    numbers: dict[str, float] = json.loads(run.stdout.strip().splitlines()[-1])
    return numbers


def _one(row: Row) -> None:
    """Measures one row in this process, and prints it."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    tasks: dict[str, Callable[[Row], dict[str, float]]] = {
        "assembly": _assembly,
        "factors": _factors,
        "frequencies": _frequencies,
        "contact": _contact,
    }
    started = time.perf_counter()
    numbers = tasks[row.task](row)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    numbers["wall_seconds"] = comm.allreduce(time.perf_counter() - started, MPI.MAX)
    numbers["whole_seconds"] = comm.allreduce(time.process_time())
    numbers["megabytes"] = comm.allreduce(peak)
    if comm.rank == 0:
        print(json.dumps(numbers))


def _body(element: str, cells: int) -> Any:  # noqa: ANN401
    """The block, without anything assembled."""
    from mpi4py import MPI

    from dolfinx.mesh import CellType, create_box, create_rectangle

    from pw_elements import Body, Material, StressState
    from study.discretisation import spaces

    comm = MPI.COMM_WORLD
    if element.endswith("T10"):
        corners = [(0.0, 0.0, 0.0), (2.0, 1.0, 1.0)]
        mesh = create_box(comm, corners, (2 * cells, cells, cells), CellType.tetrahedron)
        state = "solid"
    else:
        mesh = create_rectangle(comm, [(0.0, 0.0), (2.0, 1.0)], (2 * cells, cells))
        state = "plane strain"
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    return Body(spaces(element, mesh), material, StressState(state))


def _seconds(work: Callable[[], Any]) -> tuple[Any, float]:
    from mpi4py import MPI

    start = time.process_time()
    made = work()
    return made, MPI.COMM_WORLD.allreduce(time.process_time() - start)


def _assembly(row: Row) -> dict[str, float]:
    from pw_elements import assemble_matrix

    body = _body(row.element, row.cells)
    form = body.stiffness()
    assemble_matrix(form)  # compiled now
    K, seconds = _seconds(lambda: assemble_matrix(form))
    return {"dofs": K.getSize()[0], "seconds": seconds, "entries": K.getInfo()["nz_used"]}


def _clamped(row: Row) -> tuple[Any, Any, Any]:
    """Body, stiffness, and supports of the base."""
    import numpy as np

    from pw_elements import Reduction, assemble_matrix, prescribe

    body = _body(row.element, row.cells)
    space = body.spaces.trial
    up = body.spaces.mesh.geometry.dim - 1

    def below(x: Any) -> Any:  # noqa: ANN401
        return np.isclose(x[up], 0.0)

    base = [prescribe(space, i, below) for i in range(up + 1)]
    return body, assemble_matrix(body.stiffness()), Reduction.dirichlet(space, base)


def _factors(row: Row) -> dict[str, float]:
    """LDL^T of the standard element, LU of the new one."""
    from pw_elements.algebra import factorise

    _, K, supports = _clamped(row)
    matrix = supports.matrix(K)
    symmetric = row.element.startswith("galerkin")
    prepared, seconds = _seconds(lambda: factorise(matrix, symmetric))
    entries = prepared.ksp.getPC().getFactorMatrix().getMumpsInfog(29)
    entries = entries if entries >= 0 else -1e6 * entries
    return {"dofs": matrix.getSize()[0], "seconds": seconds, "entries": float(entries)}


def _frequencies(row: Row) -> dict[str, float]:
    from pw_elements import assemble_matrix, vibration_modes

    body, K, supports = _clamped(row)
    M = assemble_matrix(body.mass())
    _, seconds = _seconds(lambda: vibration_modes(K, M, supports, MODES))
    return {"dofs": K.getSize()[0], "seconds": seconds}


def _contact(row: Row) -> dict[str, float]:
    """The block on a rough plane, pressed and pushed, held by contact alone."""
    import pw_elements as pw

    def solver() -> Any:  # noqa: ANN401
        return pw.Direct() if row.method == "Direct" else pw.Iterative()

    start: list[Any] = []
    if row.method == "nested":
        start = [_solved(row.element, row.cells // 2, solver(), [])]
    state, seconds = _seconds(lambda: _solved(row.element, row.cells, solver(), start))
    return {
        "dofs": state.displacement.getSize(),
        "seconds": seconds,
        "iterations": state.iterations,
        "factorisations": state.report.factorisations,
        "krylov_iterations": state.report.krylov_iterations,
        "sticking": float((state.pairs[0].status == 1).sum()),
        "slipping": float((state.pairs[0].status == 2).sum()),
    }


def _solved(element: str, cells: int, solver: Any, start: list[Any]) -> Any:  # noqa: ANN401
    """With assembly."""
    import numpy as np

    import pw_elements as pw
    from pw_elements.contact import ContactPair, Plane, solve_contact

    body = _body(element, cells)
    space, mesh = body.spaces.trial, body.spaces.mesh
    K = pw.assemble_matrix(body.stiffness(), blocked=isinstance(solver, pw.Iterative))
    top = pw.boundary_measure(mesh, lambda x: np.isclose(x[2], 1.0))
    side = pw.boundary_measure(mesh, lambda x: np.isclose(x[0], 0.0))
    load = pw.assemble_vector(body.surface_load((0.0, 0.0, -PRESSURE), top))
    load.axpy(1.0, pw.assemble_vector(body.surface_load((PUSH, PUSH / 2, 0.0), side)))
    floor = ContactPair(lambda x: np.isclose(x[2], 0.0), Plane((0, 0, 0), (0, 0, 1)), FRICTION)
    free = pw.Reduction.dirichlet(space, [])
    (state,) = solve_contact(K, load, free, floor, space, start, solver=solver)
    return state


if __name__ == "__main__":
    main()

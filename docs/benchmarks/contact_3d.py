"""Cost of frictional contact in space: a table, by one process per row.

    ./run python3 docs/benchmarks/contact_3d.py                  28 611 to 212 355 unknowns
    ./run python3 docs/benchmarks/contact_3d.py 8 11 16 27       cells along the height
    ./run python3 docs/benchmarks/contact_3d.py --processes 2 16

A block 2 x 1 x 1 of 10-node tetrahedra with piecewise-linear weights stands on a rough rigid plane
(mu = 0.3); it is pressed from above, and pushed at one side in both directions. CPU seconds are of
all processes and of the whole run: imports, mesh, assembly, contact. Those of `solve_contact` alone
stand beside; with "nested" it starts from the state of a mesh of half as many cells a side, whose
computation counts in the whole run. MB are the largest resident sizes, added up. Statuses are
numbers of open, sticking and slipping nodes. Other work on the machine changes the wall's seconds
much more than the CPU's.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).parents[2]
# Up to here factors are compared; beyond they take minutes, and gigabytes
MOST_BY_FACTORS = 80_000


def measured(cells: int, method: str) -> dict[str, Any]:
    """One row; `method` is "Direct", "Iterative" or "nested" (from half as many cells)."""
    from mpi4py import MPI
    from petsc4py import PETSc

    import numpy as np
    from dolfinx.mesh import CellType, create_box

    import pw_elements as pw
    from pw_elements.contact import ContactPair, Plane, solve_contact
    from pw_elements.contact.model import ContactState

    comm = MPI.COMM_WORLD
    started = time.perf_counter()

    def solved(n: int, start: list[ContactState]) -> tuple[ContactState, float]:
        box = [(0.0, 0.0, 0.0), (2.0, 1.0, 1.0)]
        mesh = create_box(comm, box, (2 * n, n, n), CellType.tetrahedron)
        body = pw.Body(pw.Spaces.petrov_galerkin(mesh), pw.Material(1000.0, 0.3), "solid")
        K = pw.assemble_matrix(body.stiffness(), blocked=method != "Direct")
        top, side = (
            pw.boundary_measure(mesh, lambda x, k=k, at=at: np.isclose(x[k], at))
            for k, at in ((2, 1.0), (0, 0.0))
        )
        load = pw.assemble_vector(body.surface_load((0.0, 0.0, -100.0), top))
        load.axpy(1.0, pw.assemble_vector(body.surface_load((20.0, 10.0, 0.0), side)))
        U = body.spaces.trial
        floor = ContactPair(lambda x: np.isclose(x[2], 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
        solver = pw.Direct() if method == "Direct" else pw.Iterative()
        before = time.process_time()
        free = pw.Reduction.dirichlet(U, [])
        (state,) = solve_contact(K, load, free, floor, U, start, solver=solver)
        spent = time.process_time() - before
        PETSc.garbage_cleanup(K.comm)
        return state, spent

    start = [solved(cells // 2, [])[0]] if method == "nested" else []
    state, contact = solved(cells, start)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "unknowns": state.displacement.getSize(),
        "processes": comm.size,
        "method": method,
        "cpu": comm.allreduce(time.process_time()),
        "contact": comm.allreduce(contact),
        "wall": comm.allreduce(time.perf_counter() - started, MPI.MAX),
        "megabytes": comm.allreduce(peak),
        "newton": state.iterations,
        "gmres": state.report.krylov_iterations,
        "statuses": np.bincount(state.pairs[0].status, minlength=3).tolist(),
        "displacement": state.displacement.norm(),
        "residual": state.residuals.largest(),
    }


def row(cells: int, method: str, processes: int) -> dict[str, Any]:
    """One row, by processes of its own."""
    command = [sys.executable, __file__, "--one", method, str(cells)]
    if processes > 1:
        command = ["mpirun", "-n", str(processes), *command]
    run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)
    numbers: dict[str, Any] = json.loads(run.stdout.strip().splitlines()[-1])
    return numbers


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("cells", nargs="*", type=int, default=[8, 11, 16])
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        sys.path.insert(0, str(PROJECT))
        from mpi4py import MPI

        numbers = measured(given.cells[0], given.one)
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(numbers))
        return
    print(
        "| unknowns | method | CPU s | contact | wall s | MB | Newton | GMRES | open, stick, slip |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for cells in given.cells:
        methods = ["Iterative", "nested"]
        if 3 * (4 * cells + 1) * (2 * cells + 1) ** 2 <= MOST_BY_FACTORS:
            methods.insert(0, "Direct")
        for method in methods:
            r = row(cells, method, given.processes)
            statuses = ", ".join(map(str, r["statuses"]))
            print(
                f"| {r['unknowns']} | {method} | {r['cpu']:.1f} | {r['contact']:.1f} | "
                f"{r['wall']:.1f} | {r['megabytes']:.0f} | {r['newton']} | {r['gmres']} | "
                f"{statuses} |",
                flush=True,
            )


if __name__ == "__main__":
    main()

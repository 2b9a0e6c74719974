"""Measure what process 0 needs beyond the others for files, in bytes per unknown of the model.

    ./run python3 -m tests.speed.memory_growth [--cells 16 24 32]

A cube of 10-node tetrahedra rests on one of its faces. On four processes, its mesh is read from a
file of Gmsh (`from_file`), and a state is saved and, in new processes, loaded. The command prints,
for each of these steps, how much more the peak memory of process 0 rises than that of the last
process. Both have equal shares of the model; the difference is what process 0 needs because it
reads and writes files for all. Its slope over the numbers of unknowns is printed for the objects of
Python with NumPy's arrays, which are counted exactly, and for the resident memory of Linux, which
includes what libraries in C and C++ need, but misses what they take from memory freed before. The
larger one is extrapolated to 1e8 and 1e9 unknowns. The last row is the size of a pair's state,
which all processes have, per contact node and for one face of the cube.

Times play no role, and other programs do not disturb.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

PROCESSES = 4
MESH, SAVE, LOAD = "mesh read from a file", "state saved", "state loaded"
UNKNOWNS_OF_LARGE_MODELS = (1e8, 1e9)
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    # freed memory returns to the system at once and is not taken for that of the next step
    "MALLOC_MMAP_THRESHOLD_": "65536",
    "MALLOC_TRIM_THRESHOLD_": "65536",
}
T = TypeVar("T")


def main() -> None:
    """Run all sizes and numbers of processes, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cells", type=int, nargs="+", default=[16, 24, 32])
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        measure_on_each_process(options.measure)
        return
    runs = []
    with tempfile.TemporaryDirectory() as folder:
        for cells in options.cells:
            path = Path(folder, f"cube-{cells}.msh")
            command = [sys.executable, "-c", _WRITE_CUBE, str(path), str(cells)]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            runs.append(_run_in_new_processes(path))  # reads the mesh and saves a state
            for first, second in zip(runs[-1], _run_in_new_processes(path), strict=True):
                first |= {name: value for name, value in second.items() if name.startswith(LOAD)}
    print(format_table(runs))


def format_table(runs: list[list[dict[str, float]]]) -> str:
    """Return a Markdown table of bytes per unknown, and of gigabytes for large models.

    Args:
        runs: Measured numbers of each process, by name, for each size.
    """
    titles = [f"at {size:.0e} unknowns / GB" for size in UNKNOWNS_OF_LARGE_MODELS]
    lines = [
        f"| step | arrays / B per unknown | resident / B per unknown | {' | '.join(titles)} |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    unknowns = [run[0]["unknowns"] for run in runs]
    for step in (MESH, SAVE, LOAD):
        slopes = [
            float(np.polyfit(unknowns, [run[0][name] - run[-1][name] for run in runs], 1)[0])
            for name in (step, f"{step}, resident")
        ]
        sizes = [f"{max(slopes) * size / 1e9:.3g}" for size in UNKNOWNS_OF_LARGE_MODELS]
        lines.append(f"| {step} | {slopes[0]:.1f} | {slopes[1]:.1f} | {' | '.join(sizes)} |")
    last = runs[-1][0]
    per_node = last["pair"] / last["contact_nodes"]
    nodes_of_face = [(size / 3) ** (2 / 3) for size in UNKNOWNS_OF_LARGE_MODELS]
    sizes = [f"{per_node * nodes / 1e9:.2g}" for nodes in nodes_of_face]
    lines.append(f"| state of a pair | {per_node:.0f} per contact node | – | {' | '.join(sizes)} |")
    return "\n".join(lines)


def measure_on_each_process(path: Path) -> None:
    """Read the mesh, save or load a state, and print the numbers of each process as JSON.

    Args:
        path: File of the mesh. The state is written beside it, or loaded if there is one.
    """
    from mpi4py import MPI
    from petsc4py import PETSc

    from pw_elements import Reduction, Spaces
    from pw_elements.contact import ContactPair, ContactProblem, Plane
    from pw_elements.meshes import from_file

    comm = MPI.COMM_WORLD
    part, mesh_growth = measure_peak_growth(MESH, lambda: from_file(path))
    space = Spaces.galerkin(part.mesh).trial
    index_map = space.dofmap.index_map
    share, unknowns = 3 * index_map.size_local, 3 * index_map.size_global
    K = PETSc.Mat().createAIJ(((share, unknowns), (share, unknowns)), nnz=1, comm=comm)
    first = K.getOwnershipRange()[0]
    for row in range(first, first + share):
        K.setValue(row, row, 1.0)
    K.assemble()
    floor = ContactPair(lambda x: np.isclose(x[2], 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
    problem = ContactProblem(K, Reduction.dirichlet(space, []), floor, space)
    state_path = path.with_suffix(".state")
    has_state = comm.bcast(state_path.exists())
    if has_state:
        _, state_growth = measure_peak_growth(LOAD, lambda: problem.load(state_path))
    else:
        _, state_growth = measure_peak_growth(
            SAVE, lambda: problem.save(problem.undeformed, state_path)
        )
    (pair,) = problem.undeformed.pairs
    numbers = mesh_growth | state_growth
    numbers |= {
        "unknowns": unknowns,
        "pair": sum(values.nbytes for values in vars(pair).values()),
        "contact_nodes": len(pair.node),
    }
    all_numbers = comm.gather(numbers)
    if comm.rank == 0:
        print(json.dumps(all_numbers))


def measure_peak_growth(step: str, work: Callable[[], T]) -> tuple[T, dict[str, float]]:
    """Call a function; return its result, and how far memory rose meanwhile, in bytes.

    Args:
        step: Name of the growth of arrays and, with ", resident", of that of resident memory.
        work: Function; its result itself is counted, too.
    """
    before = _read_resident_memory("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    tracemalloc.start()
    result = work()
    arrays = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    resident = _read_resident_memory("VmHWM") - before
    return result, {step: arrays, f"{step}, resident": resident}


def _read_resident_memory(name: str) -> int:
    """Return a resident size of this process in bytes: "VmRSS" (now) or "VmHWM" (largest)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    (kilobytes,) = (line.split()[1] for line in lines if line.startswith(name))
    return 1024 * int(kilobytes)


def _run_in_new_processes(path: Path) -> list[dict[str, float]]:
    """Measure in new processes; return the numbers of each."""
    command = ["mpirun", "-n", str(PROCESSES), sys.executable, "-m", "tests.speed.memory_growth"]
    run = subprocess.run(
        [*command, "--measure", str(path)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | ENVIRONMENT,
    )
    numbers: list[dict[str, float]] = json.loads(run.stdout.strip().splitlines()[-1])
    return numbers


_WRITE_CUBE = """
import sys

import gmsh

path, cells = sys.argv[1], int(sys.argv[2])
gmsh.initialize()
gmsh.option.setNumber("Mesh.Binary", 1)
gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
gmsh.model.occ.synchronize()
for dim in (1, 2, 3):
    for _, tag in gmsh.model.getEntities(dim):
        if dim == 1:
            gmsh.model.mesh.setTransfiniteCurve(tag, cells + 1)
        elif dim == 2:
            gmsh.model.mesh.setTransfiniteSurface(tag)
        else:
            gmsh.model.mesh.setTransfiniteVolume(tag)
gmsh.model.addPhysicalGroup(3, [1], name="body")
gmsh.model.mesh.generate(3)
gmsh.write(path)
"""
"""Program that writes a file of Gmsh: a cube of tetrahedra with so many cells along each edge."""


if __name__ == "__main__":
    main()

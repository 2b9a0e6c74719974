"""Measures time and memory, each row by processes of its own, and writes the record of section K.

    ./run python3 -m study.cost.measure                 all rows, some 40 minutes
    ./run python3 -m study.cost.measure --only contact  rows of some tasks

Seconds are CPU time of all processes, medians of three runs where one takes less than ten seconds;
megabytes are the largest resident sizes, added up, imports included. Other work on the machine
changes them little, wall time much: rows that were measured on a busy machine say so.

Contact's time is set against what its parts take by themselves, for which "linear" rows measure
assembly, one set-up of the multigrid levels, and bare solutions of K, clamped at its base, to two
accuracies. The denominator `over_bare` has assembly, one set-up, and a bare solution for each of
Newton's steps to the very reduction of the residual that this step asked for (`digits` is the sum
of their decimal logarithms), between the two accuracies by interpolation. A solution of K from
scratch cannot do without levels, so their set-up is in it, but once only, though contact makes
parts of them anew; imports, mesh, contact's set-up and checks are not. The denominator of
`over_solutions` is the least that can be said: each step as one bare solution to `FORCING`, and
assembly; no levels, no exact last step.
"""

import argparse
import json
import math
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from study.run.store import write_json

RECORD = Path(__file__).with_name("record.json")
REPEATS = 3
# Seconds above which one run is enough
ONCE = 10.0
# Of two blocks: the upper one's modulus over the lower one's, its cells over the lower one's, its
# sides across (the lower one is a unit cube)
STIFFER, FINER, SIDES = 3.0, 0.8, (0.13, 0.83)
# Cells along the sides of a piece, by the dimension
EACH = {2: 4, 3: 6}
# Width of the wide cells around the lower block where the search is measured
RIM = 6.0
# Of the body: a block 2 x 1 (x 1), E, nu
YOUNGS_MODULUS, POISSONS_RATIO = 1000.0, 0.3
PRESSURE, PUSH, FRICTION, FRICTION_BETWEEN = 100.0, 20.0, 0.3, 0.2
MODES = 6
# Of a ball of radius 1 on a block of rubber 2 x 2 x 1: where it is pressed, and then moved, to
BALL = ((0.0, 0.0, -0.15), (0.1, 0.0, -0.15))
# What a linear system on contact's way is solved to, over its right-hand side
FORCING = 0.02
EXACT_DIGITS = 11
# Threads would blur what CPU time means
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}


@dataclass(frozen=True)
class Row:
    """What is measured.

    Args:
        task: "assembly", "factors", "frequencies", "contact", "bodies": two on each other,
            "search": who faces whom there, "pieces": loose ones side by side on a plane,
            "sliding": a rough ball pressed into rubber, and on along it, at large strains,
            "incompressible": a solution, or "linear": one solution of K on contact's way, of the
            clamped block.
        element: as in the study, or one of CalculiX.
        cells: along the height of the block, or of the lower one; or the number of pieces.
        method: "Direct", "Iterative", "compared": both, for their difference; "graded": wide cells
            around the others; or "CalculiX", which `tests.speed.calculix_block` measures.
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


def main() -> None:
    """Writes the record; rows that are not measured now stay as they are."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--only", nargs="*", help="tasks")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        _one(Row(**json.loads(given.one)))
        return
    write_record(
        RECORD, {row.name for row in rows() if given.only is None or row.task in given.only}
    )


def write_record(path: Path, names: set[str]) -> None:
    """Measure rows by their names, and write them among those of the tracked record."""
    content = json.loads(RECORD.read_text()) if RECORD.is_file() else {"rows": []}
    known = {Row(**row["row"]).name: row for row in content["rows"]}
    for row in rows():
        if row.name in names:
            where = machine()
            known[row.name] = {"row": asdict(row), "machine": where, "measured": _median(row)}
            print(row.name, known[row.name]["measured"], file=sys.stderr, flush=True)
            write_json(path, {"rows": list(known.values())})


def machine() -> str:
    """The machine in words; busy where more work waits than it has cores."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":")[1].strip() for line in lines if "model name" in line), "?")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    words = f"{os.cpu_count()} cores of {model or platform.machine()}, {memory:.0f} GB, shared"
    busy = os.getloadavg()[0] > (os.cpu_count() or 1)
    return f"{words}, busy (load {os.getloadavg()[0]:.0f})" if busy else words


def _median(row: Row) -> dict[str, float]:
    """Of several runs."""
    runs: list[dict[str, float]] = []
    for _ in range(REPEATS):
        runs.append(alone(row))
        if runs[-1]["whole_seconds"] > ONCE:
            break
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


def alone(row: Row) -> dict[str, float]:
    """What is measured of a row, by processes of its own."""
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
        "bodies": _bodies,
        "search": _search,
        "pieces": _pieces,
        "sliding": _sliding,
        "incompressible": _incompressible,
        "linear": _linear,
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

    from pw_elements import Body, Material
    from pw_elements.elasticity import StressState
    from study.model.discretisation import spaces

    comm = MPI.COMM_WORLD
    if element.endswith("T10"):
        corners = [(0.0, 0.0, 0.0), (2.0, 1.0, 1.0)]
        mesh = create_box(comm, corners, (2 * cells, cells, cells), CellType.tetrahedron)
        state = "solid"
    else:
        mesh = create_rectangle(comm, [(0.0, 0.0), (2.0, 1.0)], (2 * cells, cells))
        state = "plane strain"
    material = Material(YOUNGS_MODULUS, 0.5 if "hybrid" in element else POISSONS_RATIO)
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


def _clamped(row: Row) -> tuple[Any, Any]:
    """Body, and supports of the base."""
    import numpy as np

    from pw_elements import Reduction, prescribe

    body = _body(row.element, row.cells)
    space = body.spaces.trial
    up = body.spaces.mesh.geometry.dim - 1

    def below(x: Any) -> Any:  # noqa: ANN401
        return np.isclose(x[up], 0.0)

    base = [prescribe(space, i, below) for i in range(up + 1)]
    return body, Reduction.dirichlet(space, base)


def _factors(row: Row) -> dict[str, float]:
    """LDL^T of the standard element, LU of the new one."""
    from pw_elements import assemble_matrix
    from pw_elements.algebra import factorise

    body, supports = _clamped(row)
    matrix = supports.matrix(assemble_matrix(body.stiffness()))
    symmetric = row.element.startswith("galerkin")
    prepared, seconds = _seconds(lambda: factorise(matrix, symmetric))
    entries = prepared.ksp.getPC().getFactorMatrix().getMumpsInfog(29)
    entries = entries if entries >= 0 else -1e6 * entries
    return {"dofs": matrix.getSize()[0], "seconds": seconds, "entries": float(entries)}


def _frequencies(row: Row) -> dict[str, float]:
    from pw_elements import assemble_matrix, vibration_modes

    body, supports = _clamped(row)
    K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
    _, seconds = _seconds(lambda: vibration_modes(K, M, supports, MODES))
    return {"dofs": K.getSize()[0], "seconds": seconds}


def _incompressible(row: Row) -> dict[str, float]:
    """The clamped block, pressed and pushed from above, nu = 1/2."""
    import numpy as np

    import pw_elements as pw

    body, supports = _clamped(row)
    K = pw.assemble_matrix(body.stiffness())
    top = pw.boundary_measure(body.spaces.mesh, lambda x: np.isclose(x[2], 1.0))
    load = pw.assemble_vector(body.surface_load((PUSH, PUSH / 2, -PRESSURE), top))
    solver = pw.Direct() if row.method == "Direct" else pw.Iterative()
    a, seconds = _seconds(lambda: pw.solve(K, load, supports, solver))
    report = a.getAttr("report")
    moved, pressure = pw.split(body.spaces.trial, a)
    return {
        "dofs": K.getSize()[0],
        "seconds": seconds,
        "krylov_iterations": report.krylov_iterations,
        "moved": float(moved.x.petsc_vec.norm()),
        "pressure": float(pressure.x.petsc_vec.norm()),
    }


def _linear(row: Row) -> dict[str, float]:
    """Assembly, the levels, and solutions by them to `FORCING` and `exact`, to 1e-11."""
    import pw_elements as pw
    from pw_elements.algebra import full_size_reduction

    body, supports = _clamped(row)
    K, assembly = _seconds(lambda: pw.assemble_matrix(body.stiffness(), blocked=True))
    load = full_size_reduction(supports).load(K, _pressed(body))

    def levels() -> Any:  # noqa: ANN401
        prepared = pw.Iterative().prepare(K, supports=supports.supports)
        prepared.set_up()
        return prepared

    prepared, set_up = _seconds(levels)
    step, exact = load.duplicate(), prepared.ksp.getTolerances()[0]
    prepared.ksp.setTolerances(rtol=FORCING)
    _, seconds = _seconds(lambda: prepared.ksp.solve(load, step))
    iterations = prepared.ksp.getIterationNumber()
    prepared.ksp.setTolerances(rtol=exact)
    _, exact_seconds = _seconds(lambda: prepared.ksp.solve(load, step))
    return {
        "dofs": K.getSize()[0],
        "seconds": seconds,
        "exact_seconds": exact_seconds,
        "assembly_seconds": assembly,
        "set_up_seconds": set_up,
        "iterations": iterations,
        "krylov_iterations": prepared.report.krylov_iterations - iterations,
    }


def _contact(row: Row) -> dict[str, float]:
    """The block on a rough plane, pressed and pushed, held by contact alone."""
    import pw_elements as pw

    digits: list[float] = []

    solver = pw.Direct() if row.method == "Direct" else _watched(digits)
    state, seconds = _seconds(lambda: _solved(row.element, row.cells, solver))
    return ({} if row.method == "Direct" else {"digits": sum(digits)}) | {
        "dofs": state.unknowns.getSize(),
        "seconds": seconds,
        "iterations": state.iterations,
        "factorisations": state.report.factorisations,
        "krylov_iterations": state.report.krylov_iterations,
        "sticking": float((state.pairs[0].status == 1).sum()),
        "slipping": float((state.pairs[0].status == 2).sum()),
    }


def _watched(digits: list[float]) -> Any:  # noqa: ANN401
    """`Iterative()`, which tells by how many digits each linear system is to be reduced."""
    import pw_elements as pw

    def first(ksp: Any, iteration: int, residual: float) -> None:  # noqa: ANN401
        if iteration == 0:
            digits.append(math.log10(residual / ksp.getTolerances()[1]))

    class Watched(pw.Iterative):
        def prepare(self, *stated: Any, **named: Any) -> Any:  # noqa: ANN401
            krylov: Any = super().prepare(*stated, **named)
            method = krylov.briefly

            def briefly(*of: Any) -> Any:  # noqa: ANN401
                ksp = method(*of)
                ksp.setMonitor(first)
                return ksp

            krylov.briefly = briefly
            return krylov

    return Watched()


def _pressed(body: Any) -> Any:  # noqa: ANN401
    """Load from above and at a side."""
    import numpy as np

    import pw_elements as pw

    mesh = body.spaces.mesh
    top = pw.boundary_measure(mesh, lambda x: np.isclose(x[2], 1.0))
    side = pw.boundary_measure(mesh, lambda x: np.isclose(x[0], 0.0))
    load = pw.assemble_vector(body.surface_load((0.0, 0.0, -PRESSURE), top))
    load.axpy(1.0, pw.assemble_vector(body.surface_load((PUSH, PUSH / 2, 0.0), side)))
    return load


def _solved(element: str, cells: int, solver: Any) -> Any:  # noqa: ANN401
    """With assembly."""
    import numpy as np

    import pw_elements as pw
    from pw_elements.contact import ContactPair, Plane, solve_contact

    body = _body(element, cells)
    space = body.spaces.trial
    K = pw.assemble_matrix(body.stiffness(), blocked=isinstance(solver, pw.Iterative))
    load = _pressed(body)
    floor = ContactPair(lambda x: np.isclose(x[2], 0.0), Plane((0, 0, 0), (0, 0, 1)), FRICTION)
    free = pw.Reduction.dirichlet(space, [])
    (state,) = solve_contact(K, load, free, floor, space, solver=solver)
    return state


def _bodies(row: Row) -> dict[str, float]:
    """A block on a coarser one, which alone holds it: pressed and pushed, with friction."""
    import numpy as np

    import pw_elements as pw

    if row.method == "compared":
        states, seconds = _seconds(
            lambda: [_stacked(row, s) for s in (pw.Direct(), pw.Iterative())]
        )
        moved, statuses = zip(*((s.displacement, s.pairs[0].status) for s in states), strict=True)
        return {
            "dofs": moved[0].getSize(),
            "seconds": seconds,
            "difference": (moved[1] - moved[0]).norm(3) / moved[0].norm(3),
            "other_statuses": float(np.sum(statuses[0] != statuses[1])),
        }
    solver = pw.Direct() if row.method == "Direct" else pw.Iterative()
    state, seconds = _seconds(lambda: _stacked(row, solver))
    (pair,) = state.pairs
    return {
        "dofs": state.displacement.getSize(),
        "seconds": seconds,
        "iterations": state.iterations,
        "factorisations": state.report.factorisations,
        "krylov_iterations": state.report.krylov_iterations,
        "sticking": float((pair.status == 1).sum()),
        "slipping": float((pair.status == 2).sum()),
        "displacement": state.displacement.norm(),
    }


def _two_blocks(
    sizes: tuple[int, int], deep: tuple[int, int], rim: float = 0.0
) -> tuple[Any, Callable[[int, Any], Any]]:
    """A block on a coarser one, which a rim of wide cells may surround; and what is the upper's.

    Args:
        sizes: cells along the sides of the lower and of the upper block.
        deep: cells along their heights.
        rim: width of the lower one's outermost cells; zero for that of the others.
    """
    from mpi4py import MPI

    import numpy as np
    from dolfinx.mesh import CellType, compute_midpoints, create_box, create_mesh

    from pw_elements._compat import cell_nodes

    comm = MPI.COMM_WORLD
    low, high = SIDES
    corners = ([(0, 0, 0), (1, 1, 1)], [(low, low, 1), (high, high, 2)])
    lower, upper = (
        create_box(MPI.COMM_SELF, ends, (n, n, d), CellType.tetrahedron)
        for ends, n, d in zip(corners, sizes, deep, strict=True)
    )
    if rim:
        known, wide = [0, 1 / sizes[0], 1 - 1 / sizes[0], 1], [-rim, 0, 1, 1 + rim]
        lower.geometry.x[:, :2] = np.interp(lower.geometry.x[:, :2], known, wide)
    x = np.concatenate([lower.geometry.x, upper.geometry.x])
    cells = np.concatenate([cell_nodes(lower), cell_nodes(upper) + len(lower.geometry.x)])
    if comm.rank:
        cells, x = cells[:0], x[:0]
    element = lower.ufl_domain().ufl_coordinate_element()
    mesh = create_mesh(comm, cells=cells.astype(np.int64), x=x, e=element)

    def above(dim: int, entities: Any) -> Any:  # noqa: ANN401
        mesh.topology.create_connectivity(dim, 3)
        behind = mesh.topology.connectivity(dim, 3)
        of = entities if dim == 3 else np.array([behind.links(f)[0] for f in entities])
        return compute_midpoints(mesh, 3, of.astype(np.int32))[:, 2] > 1

    return mesh, above


def _between(space: Any, above: Callable[[int, Any], Any]) -> Any:  # noqa: ANN401
    """The pair of the upper block's nodes and the lower one's facets."""
    import numpy as np
    from dolfinx import fem
    from dolfinx.mesh import exterior_facet_indices, locate_entities_boundary

    from pw_elements.contact import ContactPair, DeformableSurface

    mesh = space.mesh
    between = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 1.0))
    between = np.intersect1d(between, exterior_facet_indices(mesh.topology))
    of_upper = above(2, between)
    nodes = fem.locate_dofs_topological(space, 2, between[of_upper])
    return ContactPair(nodes, DeformableSurface(between[~of_upper]), FRICTION_BETWEEN)


def _search(row: Row) -> dict[str, float]:
    """The mortar of two layers whose meshes do not match; "graded": with a rim of wide cells."""
    from pw_elements import Reduction
    from pw_elements.contact.interface import build_interface
    from pw_elements.spaces import AssemblyRecord
    from study.model.discretisation import spaces

    rim = RIM if row.method == "graded" else 0.0
    mesh, above = _two_blocks((row.cells, round(FINER * row.cells)), (1, 1), rim)
    space = spaces(row.element, mesh).trial
    pair, free = _between(space, above), Reduction.dirichlet(space, [])
    known = AssemblyRecord(stress_states=frozenset({"solid"}))
    _, seconds = _seconds(lambda: build_interface([pair], space, free, known))
    return {"dofs": space.dofmap.index_map.size_global * 3, "seconds": seconds}


def _pieces(row: Row) -> dict[str, float]:
    """Loose squares or cubes on a rough plane, each pressed and pushed."""
    from mpi4py import MPI

    import numpy as np
    from dolfinx.mesh import CellType, create_box, create_mesh, create_rectangle

    import pw_elements as pw
    from pw_elements._compat import cell_nodes
    from pw_elements.contact import ContactPair, Plane, solve_contact
    from pw_elements.elasticity import StressState
    from study.model.discretisation import spaces

    comm, dim = MPI.COMM_WORLD, 3 if row.element.endswith("T10") else 2
    if dim == 3:
        corners, n = [(0, 0, 0), (1, 1, 1)], (EACH[3],) * 3
        one = create_box(MPI.COMM_SELF, corners, n, CellType.tetrahedron)
    else:
        one = create_rectangle(MPI.COMM_SELF, [(0, 0), (1, 1)], (EACH[2],) * 2)
    away = np.column_stack([2.0 * np.arange(row.cells), *np.zeros((dim - 1, row.cells))])
    x = (one.geometry.x[:, :dim] + away[:, None]).reshape(-1, dim)
    cells = cell_nodes(one) + len(one.geometry.x) * np.arange(row.cells)[:, None, None]
    cells = cells.reshape(-1, dim + 1).astype(np.int64)
    if comm.rank:
        cells, x = cells[:0], x[:0]
    mesh = create_mesh(comm, cells=cells, x=x, e=one.ufl_domain().ufl_coordinate_element())
    state = StressState.SOLID if dim == 3 else StressState.PLANE_STRAIN
    material = pw.Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = pw.Body(spaces(row.element, mesh), material, state)
    space, solver = body.spaces.trial, pw.Direct() if row.method == "Direct" else pw.Iterative()

    def whole() -> Any:  # noqa: ANN401
        K = pw.assemble_matrix(body.stiffness(), blocked=row.method == "Iterative")
        top = pw.boundary_measure(mesh, lambda x: np.isclose(x[dim - 1], 1.0))
        pressed = (PUSH / 10, *[0.0] * (dim - 2), -PRESSURE / 10)
        load = pw.assemble_vector(body.surface_load(pressed, top))
        up = np.eye(dim)[dim - 1]
        floor = ContactPair(lambda x: np.isclose(x[dim - 1], 0.0), Plane(0 * up, up), FRICTION)
        free = pw.Reduction.dirichlet(space, [])
        (found,) = solve_contact(K, load, free, floor, space, solver=solver)
        return found

    found, seconds = _seconds(whole)
    return {
        "dofs": found.displacement.getSize(),
        "seconds": seconds,
        "iterations": found.iterations,
        "krylov_iterations": found.report.krylov_iterations,
        "displacement": found.displacement.norm(),
    }


def _sliding(row: Row) -> dict[str, float]:
    """Two increments of neo-Hookean rubber, and one of the linear body on the same mesh."""
    from mpi4py import MPI

    import numpy as np
    import ufl
    from dolfinx import fem
    from dolfinx.mesh import CellType, create_box

    import pw_elements as pw
    from pw_elements.contact import ContactPair, ContactProblem, Motion, Sphere, solve_contact
    from study.model.discretisation import spaces

    n = (2 * row.cells, 2 * row.cells, row.cells)
    corners = [(-1.0, -1.0, -1.0), (1.0, 1.0, 0.0)]
    mesh = create_box(MPI.COMM_WORLD, corners, n, CellType.tetrahedron)
    made = spaces(row.element, mesh)
    space, u = made.trial, fem.Function(made.trial)
    F = ufl.Identity(3) + ufl.grad(u)
    inverse = ufl.inv(F).T
    stress = F - inverse + 1.5 * ufl.ln(ufl.det(F)) * inverse
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 2})
    residual = ufl.inner(stress, ufl.grad(ufl.TestFunction(made.test))) * dx
    base = [pw.prescribe(space, k, lambda x: np.isclose(x[2], -1.0)) for k in range(3)]
    motions = [Motion(motion) for motion in BALL]
    pair = ContactPair(
        lambda x: np.isclose(x[2], 0.0), Sphere((0.0, 0.0, 1.0), 1.0), FRICTION, motions[:1]
    )
    tangent = ufl.derivative(residual, u, ufl.TrialFunction(space))
    supports = pw.Reduction.dirichlet(space, base)
    pw.assemble_matrix(tangent, blocked=True)  # compiled now

    def linear() -> Any:  # noqa: ANN401
        K = pw.assemble_matrix(tangent, blocked=True)
        nothing = K.createVecLeft()
        return solve_contact(K, nothing, supports, pair, space, solver=pw.Iterative())

    _, linear_seconds = _seconds(linear)
    problem = ContactProblem.of_residual(residual, u, base, pair, solver=pw.Iterative())
    state, seconds, steps, krylov = problem.undeformed, 0.0, 0, 0
    for motion in motions:
        state, taken = _seconds(partial(problem.step, state, None, motion))
        seconds, steps = seconds + taken, steps + state.iterations
        krylov += state.report.krylov_iterations
    (ball,) = state.pairs
    return {
        "dofs": space.dofmap.index_map.size_global * 3,
        "seconds": seconds,
        "linear_seconds": linear_seconds,
        "over_linear": seconds / len(motions) / linear_seconds,
        "iterations": steps,
        "krylov_iterations": krylov,
        "sticking": float((ball.status == 1).sum()),
        "slipping": float((ball.status == 2).sum()),
        "displacement": state.displacement.norm(),
        "pressed": float(-ball.force[2]),
        "pushed": float(ball.force[0]),
    }


def _stacked(row: Row, solver: Any) -> Any:  # noqa: ANN401
    """Its state, with assembly."""
    import numpy as np
    from dolfinx.mesh import meshtags

    import pw_elements as pw
    from pw_elements.contact import solve_contact
    from pw_elements.elasticity import StressState
    from study.model.discretisation import spaces

    sizes = (row.cells, round(FINER * row.cells))
    mesh, above = _two_blocks(sizes, sizes)
    own = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    tags = meshtags(mesh, 3, own, above(3, own).astype(np.int32))
    materials = {
        k: pw.Material(E * YOUNGS_MODULUS, POISSONS_RATIO) for k, E in ((0, 1), (1, STIFFER))
    }
    body = pw.Body(
        spaces(row.element, mesh), pw.Material.by_tag(mesh, tags, materials), StressState.SOLID
    )
    space = body.spaces.trial
    top = pw.boundary_measure(mesh, lambda x: np.isclose(x[2], 2.0))
    load = pw.assemble_vector(body.surface_load((PUSH / 2, PUSH / 4, -PRESSURE), top))
    base = [pw.prescribe(space, i, lambda x: np.isclose(x[2], 0.0)) for i in range(3)]
    K = pw.assemble_matrix(body.stiffness(), blocked=isinstance(solver, pw.Iterative))
    supports = pw.Reduction.dirichlet(space, base)
    pair = _between(space, above)
    (state,) = solve_contact(K, load, supports, pair, space, solver=solver)
    return state


if __name__ == "__main__":
    main()

"""Tasks whose time and memory section K measures.

Each task returns the number of unknowns `dofs`, the CPU seconds of the task and, if applicable,
iteration counts and norms of the solution. Each task imports only the modules that it needs,
because imports contribute to the measured time and memory of a process.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from study.model.corner_forces import corner_over_midside_on_face, corner_over_midside_on_line
from study.model.vocabulary import OPEN, SLIP, STICK

if TYPE_CHECKING:
    from petsc4py import PETSc

    import ufl
    from dolfinx import fem
    from dolfinx.mesh import Mesh

    from pw_elements import Body, Direct, Iterative, Reduction
    from pw_elements.contact import ContactPair, ContactProblem
    from pw_elements.contact.model import ContactState

T = TypeVar("T")
Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
IsUpper = Callable[[int, npt.NDArray[np.int32]], Mask]
"""Function (dim, entities (m,)) that returns a mask (m,) of the entities in the upper block."""


@dataclass(frozen=True)
class Measurement:
    """Task, problem size, method and number of processes for which time and memory are measured.

    Args:
        task: Name of the task: "assembly", "factors" (factorisation) or "frequencies" of the
            clamped block; "contact" (the block on a rough plane); "bodies" (a block on another);
            "pieces" (loose cubes on a plane); "sliding" (a rough ball pressed into rubber and moved
            along it, at large strains); "sliding-bodies" (a block of rubber that slides on
            another); "incompressible" (the clamped block with a pressure field);
            "linear" (the clamped block by the solver of contact problems); "peer-block",
            "peer-rubber", "peer-sliding" and "peer-fit" (a block on a rough plane, rubber ironed by
            a rough cylinder, the block of section V18 that slides on another, and the tube of
            section V22 that is shrunk onto another, all compared with another program).
        element: Element of the study or of the other program.
        cells: Number of cells along the height of the (lower) block; for "pieces", number of cubes;
            for "peer-sliding", number of elements over which the block slides; for "peer-fit",
            number of cells of a quarter of the outer tube.
        method: "Direct", "Iterative", "compared" (both, to compute their difference), or the other
            program: "CalculiX", "CalculiX-surface", "CalculiX-nodes" or "CalculiX-mortar" (by
            surface-to-surface, node-to-surface or mortar contact) or "felupe".
        processes: Number of MPI processes.
    """

    task: str
    element: str
    cells: int
    method: str = "Direct"
    processes: int = 1

    @property
    def name(self) -> str:
        """Name of the case in section K, such as "contact-pw-T10-8-Iterative"."""
        parallel = f"-{self.processes}" if self.processes > 1 else ""
        return f"{self.task}-{self.element}-{self.cells}-{self.method}{parallel}"

    @property
    def key(self) -> str:
        """Key of the case and of the record's row, such as "K/contact-pw-T10-8-Iterative"."""
        return f"K/{self.name}"

    @property
    def peer(self) -> str:
        """The other program that is measured, "CalculiX" or "felupe"; empty for the library."""
        return next((peer for peer in PEERS if self.method.startswith(peer)), "")

    @property
    def is_compared_with_peer(self) -> bool:
        """Whether it is measured alternately with other programs; see `measure_alternately`."""
        return self.task in PEER_OF_TASK


CALCULIX, FELUPE = "CalculiX", "felupe"
PEERS = (CALCULIX, FELUPE)
"""Other programs; the methods of their measurements begin with these names."""
PEER_OF_TASK = {
    "peer-block": CALCULIX,
    "peer-rubber": FELUPE,
    "peer-sliding": CALCULIX,
    "peer-fit": CALCULIX,
}
"""Other program with which the library is compared, by task."""

# Tasks

# Block of size 2 x 1 (x 1): material, loads, friction
YOUNGS_MODULUS, POISSONS_RATIO = 1000.0, 0.3
PRESSURE, PUSH, FRICTION = 100.0, 20.0, 0.3
N_MODES = 6

# Two blocks: the lower one is a unit cube
STIFFNESS_RATIO, CELL_RATIO = 3.0, 0.8
"""Ratios upper / lower block of Young's moduli and of the numbers of cells along an edge."""
UPPER_ENDS = (0.13, 0.83)
"""Horizontal coordinates at which the upper block begins and ends."""
FRICTION_BETWEEN = 0.2

CELLS_OF_CUBE = 6
"""Cells along the side of a loose cube."""
BALL_MOTIONS = ((0.0, 0.0, -0.15), (0.1, 0.0, -0.15))
"""Translations of a ball of radius 1 that is pressed into a block 2 x 2 x 1 and moved along it."""
SLIDING_DISPLACEMENTS = ((0.0, 0.0, -0.03), (0.1, 0.0, -0.03))
"""Displacements of the top of a block that slides on another one."""

RUBBER_DEGREE = 4
"""Degree of the quadrature in the block of rubber."""

FORCING = 0.02
"""Relative residual to which the linear system of one contact iteration is solved."""
EXACT_DIGITS = 11
"""Decimal digits by which `Iterative` reduces the residual of a linear problem."""


def time_cpu(work: Callable[[], T]) -> tuple[T, float]:
    """Call a function; return its result and the CPU seconds, summed over all MPI processes."""
    from mpi4py import MPI

    start = time.process_time()
    result = work()
    return result, MPI.COMM_WORLD.allreduce(time.process_time() - start)


def _create_solver(method: str) -> "Direct | Iterative":
    from pw_elements import Direct, Iterative

    return Direct() if method == "Direct" else Iterative()


# The clamped block


def measure_stiffness_assembly(measurement: Measurement) -> dict[str, float]:
    """Measure the assembly of the stiffness matrix of the block."""
    from pw_elements import assemble_matrix

    form = _create_block(measurement.element, measurement.cells).stiffness()
    assemble_matrix(form)  # compiles the form
    K, seconds = time_cpu(lambda: assemble_matrix(form))
    return {"dofs": K.getSize()[0], "seconds": seconds, "entries": K.getInfo()["nz_used"]}


def measure_factorisation(measurement: Measurement) -> dict[str, float]:
    """Measure the factorisation by MUMPS of the clamped block's stiffness matrix.

    It is LDL^T for the standard element, and LU for the new element, whose matrix is unsymmetric.
    """
    from pw_elements import assemble_matrix
    from pw_elements.algebra import factorise

    body, supports = _create_clamped_block(measurement)
    matrix = supports.matrix(assemble_matrix(body.stiffness()))
    symmetric = measurement.element.startswith("galerkin")
    prepared, seconds = time_cpu(lambda: factorise(matrix, symmetric))
    entries = prepared.ksp.getPC().getFactorMatrix().getMumpsInfog(29)
    entries = entries if entries >= 0 else -1e6 * entries  # MUMPS returns large numbers in millions
    return {"dofs": matrix.getSize()[0], "seconds": seconds, "entries": float(entries)}


def measure_frequencies(measurement: Measurement) -> dict[str, float]:
    """Measure the computation of the `N_MODES` lowest frequencies of the clamped block."""
    from pw_elements import assemble_matrix, vibration_modes

    body, supports = _create_clamped_block(measurement)
    K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
    _, seconds = time_cpu(lambda: vibration_modes(K, M, supports, N_MODES))
    return {"dofs": K.getSize()[0], "seconds": seconds}


def measure_clamped_incompressible_block(measurement: Measurement) -> dict[str, float]:
    """Measure the solution of the clamped block at nu = 1/2 under pressure and shear on top."""
    from pw_elements import assemble_matrix, assemble_vector, boundary_measure, solve, split

    body, supports = _create_clamped_block(measurement)
    K = assemble_matrix(body.stiffness())
    top = boundary_measure(body.spaces.mesh, lambda x: np.isclose(x[2], 1.0))
    load = assemble_vector(body.surface_load((PUSH, PUSH / 2, -PRESSURE), top))
    solver = _create_solver(measurement.method)
    a, seconds = time_cpu(lambda: solve(K, load, supports, solver))
    report = a.getAttr("report")
    displacement, pressure = split(body.spaces.trial, a)
    return {
        "dofs": K.getSize()[0],
        "seconds": seconds,
        "krylov_iterations": report.krylov_iterations,
        "moved": float(displacement.x.petsc_vec.norm()),
        "pressure": float(pressure.x.petsc_vec.norm()),
    }


def measure_multigrid_set_up_and_solutions(measurement: Measurement) -> dict[str, float]:
    """Measure assembly, set-up of the multigrid levels, and two iterative solutions of the block.

    The first solution reduces the residual to `FORCING` times the load, the second one by
    `EXACT_DIGITS` decimal digits.
    """
    from pw_elements import Iterative, assemble_matrix
    from pw_elements.algebra import full_size_masking_reduction

    body, supports = _create_clamped_block(measurement)
    K, assembly = time_cpu(lambda: assemble_matrix(body.stiffness(), blocked=True))
    load = full_size_masking_reduction(supports).load(K, _assemble_pressure_and_push(body))

    def set_up_multigrid_levels() -> Any:  # noqa: ANN401
        prepared = Iterative().prepare(K, supports=supports.supports)
        prepared.set_up()
        return prepared

    prepared, set_up = time_cpu(set_up_multigrid_levels)
    solution, exact_tolerance = load.duplicate(), prepared.ksp.getTolerances()[0]
    prepared.ksp.setTolerances(rtol=FORCING)
    _, seconds = time_cpu(lambda: prepared.ksp.solve(load, solution))
    iterations = prepared.ksp.getIterationNumber()
    prepared.ksp.setTolerances(rtol=exact_tolerance)
    _, exact_seconds = time_cpu(lambda: prepared.ksp.solve(load, solution))
    return {
        "dofs": K.getSize()[0],
        "seconds": seconds,
        "exact_seconds": exact_seconds,
        "assembly_seconds": assembly,
        "set_up_seconds": set_up,
        "iterations": iterations,
        "krylov_iterations": prepared.report.krylov_iterations - iterations,
    }


def _create_block(element: str, cells: int) -> "Body":
    """Create the block 2 x 1 (x 1) with its mesh, element spaces and material."""
    from mpi4py import MPI

    from dolfinx.mesh import CellType, create_box, create_rectangle

    from pw_elements import Body, Material
    from pw_elements.elasticity import StressState
    from study.model.discretisation import make_element_spaces

    comm = MPI.COMM_WORLD
    if element.endswith("T10"):
        corners = [(0.0, 0.0, 0.0), (2.0, 1.0, 1.0)]
        mesh = create_box(comm, corners, (2 * cells, cells, cells), CellType.tetrahedron)
        state = StressState.SOLID
    else:
        mesh = create_rectangle(comm, [(0.0, 0.0), (2.0, 1.0)], (2 * cells, cells))
        state = StressState.PLANE_STRAIN
    material = Material(YOUNGS_MODULUS, 0.5 if "hybrid" in element else POISSONS_RATIO)
    return Body(make_element_spaces(element, mesh), material, state)


def _create_clamped_block(measurement: Measurement) -> "tuple[Body, Reduction]":
    """Create the block and the reduction that fixes its base."""
    from pw_elements import Reduction, prescribe

    body = _create_block(measurement.element, measurement.cells)
    space, dim = body.spaces.trial, body.spaces.mesh.geometry.dim
    base = [prescribe(space, i, lambda x: np.isclose(x[dim - 1], 0.0)) for i in range(dim)]
    return body, Reduction.dirichlet(space, base)


def _assemble_pressure_and_push(body: "Body") -> "PETSc.Vec":
    """Assemble the load vector of a pressure on top and a tangential push on the side x = 0."""
    from pw_elements import assemble_vector, boundary_measure

    mesh = body.spaces.mesh
    top = boundary_measure(mesh, lambda x: np.isclose(x[2], 1.0))
    side = boundary_measure(mesh, lambda x: np.isclose(x[0], 0.0))
    load = assemble_vector(body.surface_load((0.0, 0.0, -PRESSURE), top))
    load.axpy(1.0, assemble_vector(body.surface_load((PUSH, PUSH / 2, 0.0), side)))
    return load


# The block on a rough plane


def measure_block_on_rough_plane(measurement: Measurement) -> dict[str, float]:
    """Measure contact of the block with a rough plane; only contact holds the block."""
    from pw_elements import Direct

    digits: list[float] = []
    solver = (
        Direct() if measurement.method == "Direct" else _create_solver_that_records_digits(digits)
    )
    state, seconds = time_cpu(
        lambda: _solve_contact_of_block_on_plane(measurement.element, measurement.cells, solver)
    )
    (pair,) = state.pairs
    return ({} if measurement.method == "Direct" else {"digits": sum(digits)}) | {
        "dofs": state.unknowns.getSize(),
        "seconds": seconds,
        "iterations": state.iterations,
        "factorisations": state.report.factorisations,
        "krylov_iterations": state.report.krylov_iterations,
        "sticking": float((pair.status == STICK).sum()),
        "slipping": float((pair.status == SLIP).sum()),
    }


def _solve_contact_of_block_on_plane(
    element: str, cells: int, solver: "Direct | Iterative"
) -> "ContactState":
    """Assemble the block and its loads, and solve its contact with a rough plane."""
    from pw_elements import Iterative, Reduction, assemble_matrix
    from pw_elements.contact import ContactPair, Plane, solve_contact

    body = _create_block(element, cells)
    space = body.spaces.trial
    K = assemble_matrix(body.stiffness(), blocked=isinstance(solver, Iterative))
    load = _assemble_pressure_and_push(body)
    floor = ContactPair(lambda x: np.isclose(x[2], 0.0), Plane((0, 0, 0), (0, 0, 1)), FRICTION)
    no_supports = Reduction.dirichlet(space, [])
    (state,) = solve_contact(K, load, no_supports, floor, space, solver=solver)
    return state


def _create_solver_that_records_digits(digits: list[float]) -> "Iterative":
    """Create an `Iterative` solver that records the required residual reduction of each solution.

    Args:
        digits: List to which the decimal logarithm of initial residual / tolerance is appended.
    """
    from pw_elements import Iterative

    def append_digits_of_initial_residual(
        ksp: "PETSc.KSP", iteration: int, residual: float
    ) -> None:
        if iteration == 0:
            digits.append(math.log10(residual / ksp.getTolerances()[1]))

    class DigitRecordingSolver(Iterative):
        def prepare(self, *arguments: Any, **options: Any) -> Any:  # noqa: ANN401
            prepared: Any = super().prepare(*arguments, **options)
            create_ksp = prepared.create_flexible_ksp

            def create_monitored_ksp(*arguments: Any) -> "PETSc.KSP":  # noqa: ANN401
                ksp = create_ksp(*arguments)
                ksp.setMonitor(append_digits_of_initial_residual)
                return ksp

            prepared.create_flexible_ksp = create_monitored_ksp
            return prepared

    return DigitRecordingSolver()


# Two blocks


def measure_contact_of_two_blocks(measurement: Measurement) -> dict[str, float]:
    """Measure frictional contact of a block that is pressed and pushed on a larger block."""
    from petsc4py import PETSc

    from pw_elements import Direct, Iterative

    if measurement.method == "compared":
        states, seconds = time_cpu(
            lambda: [
                _solve_contact_of_two_blocks(measurement, solver)
                for solver in (Direct(), Iterative())
            ]
        )
        a, b = (state.displacement for state in states)
        statuses = [state.pairs[0].status for state in states]
        largest = PETSc.NormType.INFINITY
        return {
            "dofs": a.getSize(),
            "seconds": seconds,
            "difference": (b - a).norm(largest) / a.norm(largest),
            "other_statuses": float(np.sum(statuses[0] != statuses[1])),
        }
    solver = _create_solver(measurement.method)
    state, seconds = time_cpu(lambda: _solve_contact_of_two_blocks(measurement, solver))
    (pair,) = state.pairs
    return {
        "dofs": state.displacement.getSize(),
        "seconds": seconds,
        "iterations": state.iterations,
        "factorisations": state.report.factorisations,
        "krylov_iterations": state.report.krylov_iterations,
        "sticking": float((pair.status == STICK).sum()),
        "slipping": float((pair.status == SLIP).sum()),
        "displacement": state.displacement.norm(),
    }


def _solve_contact_of_two_blocks(
    measurement: Measurement, solver: "Direct | Iterative"
) -> "ContactState":
    """Mesh, assemble and solve the contact of the two blocks."""
    from dolfinx.mesh import meshtags

    import pw_elements as pw
    from pw_elements.contact import solve_contact
    from pw_elements.elasticity import StressState
    from study.model.discretisation import make_element_spaces

    sizes = (measurement.cells, round(CELL_RATIO * measurement.cells))
    mesh, is_upper = _mesh_two_blocks(sizes)
    cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    tags = meshtags(mesh, 3, cells, is_upper(3, cells).astype(np.int32))
    materials = {
        tag: pw.Material(ratio * YOUNGS_MODULUS, POISSONS_RATIO)
        for tag, ratio in ((0, 1), (1, STIFFNESS_RATIO))
    }
    material = pw.Material.by_tag(mesh, tags, materials)
    body = pw.Body(make_element_spaces(measurement.element, mesh), material, StressState.SOLID)
    space = body.spaces.trial
    top = pw.boundary_measure(mesh, lambda x: np.isclose(x[2], 2.0))
    load = pw.assemble_vector(body.surface_load((PUSH / 2, PUSH / 4, -PRESSURE), top))
    base = [pw.prescribe(space, i, lambda x: np.isclose(x[2], 0.0)) for i in range(3)]
    K = pw.assemble_matrix(body.stiffness(), blocked=isinstance(solver, pw.Iterative))
    supports = pw.Reduction.dirichlet(space, base)
    pair = _create_contact_pair_of_blocks(space, is_upper)
    (state,) = solve_contact(K, load, supports, pair, space, solver=solver)
    return state


def _mesh_two_blocks(lower_and_upper_divisions: tuple[int, int]) -> "tuple[Mesh, IsUpper]":
    """Create one mesh of two blocks, and a function that finds the entities of the upper block.

    Args:
        lower_and_upper_divisions: Number of cells along each edge of the lower and of the upper
            block.
    """
    from mpi4py import MPI

    from dolfinx.mesh import CellType, compute_midpoints, create_box, create_mesh

    from pw_elements._compat import cell_geometry_nodes

    comm = MPI.COMM_WORLD
    low, high = UPPER_ENDS
    corners = ([(0, 0, 0), (1, 1, 1)], [(low, low, 1), (high, high, 2)])
    lower, upper = (
        create_box(MPI.COMM_SELF, ends, (n, n, n), CellType.tetrahedron)
        for ends, n in zip(corners, lower_and_upper_divisions, strict=True)
    )
    x = np.concatenate([lower.geometry.x, upper.geometry.x])
    cells = np.concatenate(
        [cell_geometry_nodes(lower), cell_geometry_nodes(upper) + len(lower.geometry.x)]
    )
    if comm.rank:
        cells, x = cells[:0], x[:0]
    element = lower.ufl_domain().ufl_coordinate_element()
    mesh = create_mesh(comm, cells=cells.astype(np.int64), x=x, e=element)

    def is_in_upper_block(dim: int, entities: npt.NDArray[np.int32]) -> Mask:
        mesh.topology.create_connectivity(dim, 3)
        to_cells = mesh.topology.connectivity(dim, 3)
        if dim < 3:
            entities = np.array([to_cells.links(facet)[0] for facet in entities])
        return np.asarray(compute_midpoints(mesh, 3, entities.astype(np.int32))[:, 2] > 1)

    return mesh, is_in_upper_block


def _create_contact_pair_of_blocks(space: "fem.FunctionSpace", is_upper: IsUpper) -> "ContactPair":
    """Create the contact pair of the upper block's nodes (slave) and the lower block's facets."""
    from dolfinx import fem
    from dolfinx.mesh import exterior_facet_indices, locate_entities_boundary

    from pw_elements.contact import ContactPair, DeformableSurface

    mesh = space.mesh
    facets = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 1.0))
    facets = np.intersect1d(facets, exterior_facet_indices(mesh.topology))
    is_slave = is_upper(2, facets)
    nodes = fem.locate_dofs_topological(space, 2, facets[is_slave])
    return ContactPair(nodes, DeformableSurface(facets[~is_slave]), FRICTION_BETWEEN)


# Loose cubes


def measure_contact_of_loose_cubes(measurement: Measurement) -> dict[str, float]:
    """Measure contact of separate cubes with a rough plane, each cube pressed and pushed."""
    import pw_elements as pw
    from pw_elements.contact import ContactPair, Plane, solve_contact
    from pw_elements.elasticity import StressState
    from study.model.discretisation import make_element_spaces

    mesh = _mesh_row_of_separate_cubes(measurement.cells)
    material = pw.Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = pw.Body(make_element_spaces(measurement.element, mesh), material, StressState.SOLID)
    space, solver = body.spaces.trial, _create_solver(measurement.method)

    def assemble_and_solve_contact() -> "ContactState":
        K = pw.assemble_matrix(body.stiffness(), blocked=measurement.method == "Iterative")
        top = pw.boundary_measure(mesh, lambda x: np.isclose(x[2], 1.0))
        load = pw.assemble_vector(body.surface_load((PUSH / 10, 0.0, -PRESSURE / 10), top))
        plane = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        floor = ContactPair(lambda x: np.isclose(x[2], 0.0), plane, FRICTION)
        no_supports = pw.Reduction.dirichlet(space, [])
        (state,) = solve_contact(K, load, no_supports, floor, space, solver=solver)
        return state

    solution, seconds = time_cpu(assemble_and_solve_contact)
    return {
        "dofs": solution.displacement.getSize(),
        "seconds": seconds,
        "iterations": solution.iterations,
        "krylov_iterations": solution.report.krylov_iterations,
        "displacement": solution.displacement.norm(),
    }


def _mesh_row_of_separate_cubes(n_cubes: int) -> "Mesh":
    """Create a mesh of separate unit cubes in a row, with gaps of length one."""
    from mpi4py import MPI

    from dolfinx.mesh import CellType, create_box, create_mesh

    from pw_elements._compat import cell_geometry_nodes

    comm, n, corners = MPI.COMM_WORLD, CELLS_OF_CUBE, [(0, 0, 0), (1, 1, 1)]
    cube = create_box(MPI.COMM_SELF, corners, (n, n, n), CellType.tetrahedron)
    n_nodes, numbers = len(cube.geometry.x), np.arange(n_cubes)
    shifts = np.column_stack([2.0 * numbers, np.zeros(n_cubes), np.zeros(n_cubes)])
    x = (cube.geometry.x + shifts[:, None]).reshape(-1, 3)
    cells = cell_geometry_nodes(cube) + n_nodes * numbers[:, None, None]
    cells = cells.reshape(-1, 4).astype(np.int64)
    if comm.rank:
        cells, x = cells[:0], x[:0]
    return create_mesh(comm, cells=cells, x=x, e=cube.ufl_domain().ufl_coordinate_element())


# A ball on rubber


def measure_ball_sliding_on_rubber(measurement: Measurement) -> dict[str, float]:
    """Measure a rough ball that is pressed into neo-Hookean rubber and moved along it.

    The two increments at large strains are compared with one increment of the linearised body on
    the same mesh; `over_linear` is the ratio of CPU times per increment.
    """
    from mpi4py import MPI

    import ufl
    from dolfinx.mesh import CellType, create_box

    import pw_elements as pw
    from pw_elements.contact import ContactPair, ContactProblem, Motion, Sphere, solve_contact

    n = (2 * measurement.cells, 2 * measurement.cells, measurement.cells)
    corners = [(-1.0, -1.0, -1.0), (1.0, 1.0, 0.0)]
    mesh = create_box(MPI.COMM_WORLD, corners, n, CellType.tetrahedron)
    u, residual = _make_rubber_residual(measurement.element, mesh)
    space = u.function_space
    tangent = ufl.derivative(residual, u, ufl.TrialFunction(space))
    base = [pw.prescribe(space, k, lambda x: np.isclose(x[2], -1.0)) for k in range(3)]
    supports = pw.Reduction.dirichlet(space, base)
    motions = [Motion(translation) for translation in BALL_MOTIONS]
    sphere = Sphere((0.0, 0.0, 1.0), 1.0)
    pair = ContactPair(lambda x: np.isclose(x[2], 0.0), sphere, FRICTION, motions[:1])
    pw.assemble_matrix(tangent, blocked=True)  # compiles the form

    def assemble_and_solve_linearised_contact() -> "list[ContactState]":
        K = pw.assemble_matrix(tangent, blocked=True)
        no_load = K.createVecLeft()
        return solve_contact(K, no_load, supports, pair, space, solver=pw.Iterative())

    _, linear_seconds = time_cpu(assemble_and_solve_linearised_contact)
    problem = ContactProblem.of_residual(residual, u, base, pair, solver=pw.Iterative())
    state, numbers = _measure_steps(
        problem, [partial(problem.step, load=None, motions=motion) for motion in motions]
    )
    (ball,) = state.pairs
    return numbers | {
        "linear_seconds": linear_seconds,
        "over_linear": numbers["seconds"] / len(motions) / linear_seconds,
        "pressed": float(-ball.force[2]),
        "pushed": float(ball.force[0]),
    }


def _make_rubber_residual(element: str, mesh: "Mesh") -> "tuple[fem.Function, ufl.Form]":
    """Return the displacement of neo-Hookean rubber, and its residual."""
    import ufl
    from dolfinx import fem

    from study.model.discretisation import make_element_spaces

    spaces = make_element_spaces(element, mesh)
    u = fem.Function(spaces.trial)
    F = ufl.Identity(3) + ufl.grad(u)
    F_inverse = ufl.inv(F).T
    stress = F - F_inverse + 1.5 * ufl.ln(ufl.det(F)) * F_inverse
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 2})
    return u, ufl.inner(stress, ufl.grad(ufl.TestFunction(spaces.test))) * dx


def _measure_steps(
    problem: "ContactProblem", steps: "Sequence[Callable[[ContactState], ContactState]]"
) -> "tuple[ContactState, dict[str, float]]":
    """Compute increments of one contact pair; return the last state and the measured numbers."""
    states, seconds = [problem.undeformed], 0.0
    for step in steps:
        state, step_seconds = time_cpu(partial(step, states[-1]))
        states.append(state)
        seconds += step_seconds
    (pair,) = state.pairs
    return state, {
        "dofs": state.displacement.getSize(),
        "seconds": seconds,
        "iterations": sum(state.iterations for state in states[1:]),
        "krylov_iterations": sum(state.report.krylov_iterations for state in states[1:]),
        "sticking": float((pair.status == STICK).sum()),
        "slipping": float((pair.status == SLIP).sum()),
        "displacement": state.displacement.norm(),
    }


def measure_block_sliding_on_block(measurement: Measurement) -> dict[str, float]:
    """Measure a block of rubber that is pressed onto another one and slid along it."""
    from dolfinx import fem

    import pw_elements as pw
    from pw_elements.contact import ContactProblem

    n = measurement.cells
    mesh, is_upper = _mesh_two_blocks((n, round(CELL_RATIO * n)))
    u, residual = _make_rubber_residual(measurement.element, mesh)
    space = u.function_space
    top = [fem.Constant(mesh, 0.0) for _ in range(3)]
    supports = [
        *(pw.prescribe(space, k, lambda x: np.isclose(x[2], 0.0)) for k in range(3)),
        *(pw.prescribe(space, k, lambda x: np.isclose(x[2], 2.0), top[k]) for k in range(3)),
    ]
    pair = _create_contact_pair_of_blocks(space, is_upper)
    solver = _create_solver(measurement.method)
    problem = ContactProblem.of_residual(residual, u, supports, pair, solver=solver)

    def move_top(start: Array, end: Array, factor: float) -> None:
        for constant, a, b in zip(top, start, end, strict=True):
            constant.value = (1 - factor) * a + factor * b

    ends = pairwise(np.array([(0.0, 0.0, 0.0), *SLIDING_DISPLACEMENTS]))
    state, numbers = _measure_steps(
        problem, [partial(problem.step, load=partial(move_top, *end)) for end in ends]
    )
    force = state.pairs[0].force
    return numbers | {"normal": float(force[2]), "tangential": float(-force[0])}


# Comparison with other programs

N_PRESSING, N_IRONING = 10, 24
"""Increments in which the cylinder moves down, and then sideways."""


def measure_block_for_comparison(measurement: Measurement) -> dict[str, float]:
    """Measure contact of the block with a rough plane, and return forces besides the costs."""
    solver = _create_solver(measurement.method)
    state, seconds = time_cpu(
        lambda: _solve_contact_of_block_on_plane(measurement.element, measurement.cells, solver)
    )
    (pair,) = state.pairs
    displacement = state.displacement.array_r.reshape(-1, 3)
    return {
        "dofs": state.displacement.getSize(),
        "seconds": seconds,
        "increments": 1,
        "iterations": state.iterations,
        "factorisations": state.report.factorisations,
        "normal": float(pair.force_normal.sum()),
        "tangential": float(np.linalg.norm(pair.force_tangential.sum(axis=0))),
        "corner_over_mid": corner_over_midside_on_face(
            pair.position, pair.force_normal, measurement.cells
        ),
        "largest_displacement": float(np.linalg.norm(displacement, axis=1).max()),
    }


def measure_rubber_for_comparison(measurement: Measurement) -> dict[str, float]:
    """Measure a block of rubber that is ironed by a rough cylinder, in plane strain."""
    from mpi4py import MPI

    from pw_elements import prescribe
    from pw_elements.contact import ContactPair, ContactProblem, Motion, Sphere
    from study.meshes.line_mesh import mesh_along_lines
    from study.solutions.calculix.cylinder import HALF_WIDTH, HEIGHT, block_mesh_line_positions
    from study.solutions.felupe import cylinder
    from study.solutions.rubber import MAX_ITERATIONS, NeoHookeanBody

    def may_touch(x: Array) -> Mask:
        is_near = np.abs(x[0]) < cylinder.CONTACT_ZONE_FRACTION * HALF_WIDTH
        return np.asarray(np.isclose(x[1], 0) & is_near)

    def is_base(x: Array) -> Mask:
        return np.asarray(np.isclose(x[1], -HEIGHT))

    lines = block_mesh_line_positions(measurement.cells)
    mesh = mesh_along_lines(MPI.COMM_SELF, *lines, "triangle")
    rubber = NeoHookeanBody(measurement.element, mesh, RUBBER_DEGREE)
    space = rubber.solution.function_space
    supports = [prescribe(space, k, is_base) for k in range(2)]
    pair = ContactPair(may_touch, Sphere((0.0, 1.0), 1.0), friction=cylinder.FRICTION)
    translations = cylinder.list_cylinder_translations(N_PRESSING, N_IRONING)
    problem = ContactProblem.of_residual(
        rubber.residual,
        rubber.solution,
        supports,
        pair,
        solver=_create_solver(measurement.method),
        max_iterations=MAX_ITERATIONS,
    )

    def iron_block() -> "list[ContactState]":
        state, states = problem.undeformed, []
        for translation in translations:
            state = problem.step(state, None, Motion(translation))
            states.append(state)
        return states

    states, seconds = time_cpu(iron_block)
    (last,) = states[-1].pairs
    order = np.argsort(last.position[:, 0])
    order = order[last.status[order] != OPEN]
    is_corner = rubber.is_vertex[last.node[order]]
    return {
        "dofs": 2 * len(rubber.x),
        "seconds": seconds,
        "increments": len(states),
        "iterations": sum(state.iterations for state in states),
        "factorisations": sum(state.report.factorisations for state in states),
        "normal": float(-last.force[1]),
        "tangential": float(last.force[0]),
        "corner_over_mid": corner_over_midside_on_line(last.force_normal[order], is_corner),
    }


def measure_sliding_block_for_comparison(measurement: Measurement) -> dict[str, float]:
    """Measure the block of section V18 that slides on another one, with the energy of CalculiX."""
    from study.benchmarks.v18_bodies_in_space.problems import press_and_slide_block

    (bodies, record), seconds = time_cpu(
        lambda: press_and_slide_block(measurement.element, True, measurement.cells)
    )
    (last,) = record.states[-1].pairs
    return {
        "dofs": bodies.x.size,
        "seconds": seconds,
        "increments": len(record.states),
        "iterations": sum(state.iterations for state in record.states),
        "normal": float(last.force[2]),
        "tangential": float(-last.force[0]),
    }


def measure_shrink_fit_for_comparison(measurement: Measurement) -> dict[str, float]:
    """Measure the tube of section V22 that is shrunk onto another one."""
    from study.benchmarks.v22_fits_in_space.press_fit import shrink

    result, seconds = time_cpu(lambda: shrink(measurement.element, measurement.cells))
    return {
        "dofs": result.dofs,
        "seconds": seconds,
        "increments": 1,
        "largest_error": result.scalars["force_over_weight_error"],
    }


def measure_felupe(measurement: Measurement) -> dict[str, float]:
    """Measure the same block of rubber with felupe."""
    from study.solutions.felupe import cylinder

    translations = cylinder.list_cylinder_translations(N_PRESSING, N_IRONING)
    result = cylinder.solve_with_felupe(measurement.cells, translations)
    return {
        "dofs": result.unknowns,
        "seconds": result.seconds,
        "increments": len(translations),
        "iterations": result.iterations,
        "factorisations": result.iterations,
        "normal": result.normal_force,
        "tangential": result.tangential_force,
        "corner_over_mid": corner_over_midside_on_line(result.nodal_normal_force, result.is_corner),
    }


TASKS: dict[str, Callable[[Measurement], dict[str, float]]] = {
    "assembly": measure_stiffness_assembly,
    "factors": measure_factorisation,
    "frequencies": measure_frequencies,
    "contact": measure_block_on_rough_plane,
    "bodies": measure_contact_of_two_blocks,
    "pieces": measure_contact_of_loose_cubes,
    "sliding": measure_ball_sliding_on_rubber,
    "sliding-bodies": measure_block_sliding_on_block,
    "incompressible": measure_clamped_incompressible_block,
    "linear": measure_multigrid_set_up_and_solutions,
    "peer-block": measure_block_for_comparison,
    "peer-rubber": measure_rubber_for_comparison,
    "peer-sliding": measure_sliding_block_for_comparison,
    "peer-fit": measure_shrink_fit_for_comparison,
}
"""Function that performs each task, by the name of the task in the record."""

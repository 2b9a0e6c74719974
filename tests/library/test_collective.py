"""All processes raise the same error if one of them fails or is given a different argument."""

import re
from dataclasses import replace
from itertools import islice
from time import perf_counter
from unittest.mock import patch

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from pw_elements import (
    PetrovGalerkinProblem,
    Reduction,
    SurfaceNodes,
    boundary_measure,
    forces_along,
    lumped_mass,
    prescribe,
    solve,
)
from pw_elements.algebra import symmetric_part
from pw_elements.checks import guard
from pw_elements.contact import (
    ContactPair,
    ContactProblem,
    Motion,
    Plane,
    SignedDistance,
    solve_contact,
    solve_impact,
)
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import curved_mesh, move_nodes, triangles
from pw_elements.solvers import SolverReport
from tests.contact.cases import BlockOnFloor, on_plane
from tests.contact.iterative import SolidBlock
from tests.library.public_calls import (
    ROOT,
    collect_public_callables_by_name,
    make_valid_collective_calls,
    yield_altered_values,
)
from tests.library.rank_scenarios import diagonal_matrix, floor_pair
from tests.parallel import run_on_processes

# Time limit (s) for a list of scenarios; a process that exceeds it is assumed to wait forever
SCENARIOS_TIMEOUT_SECONDS = 600

COMM = MPI.COMM_WORLD
BLOCK_ON_FLOOR = BlockOnFloor(8, comm=COMM)
DISPLACEMENT_SPACE, K, MESH, LOAD = (
    BLOCK_ON_FLOOR.space,
    BLOCK_ON_FLOOR.K,
    BLOCK_ON_FLOOR.body.spaces.mesh,
    BLOCK_ON_FLOOR.pressure_load,
)
BOTTOM_MARKER, FLOOR, ZERO_MOTION = on_plane(1, 0.0), Plane((0, 0), (0, 1)), Motion((0, 0))
# The process on which calls fail: the last one that owns nodes on the floor
OWNED_NODE_POSITIONS = BLOCK_ON_FLOOR.x[: BLOCK_ON_FLOOR.space.dofmap.index_map.size_local]
FAILING_RANK = max(
    COMM.allgather(COMM.rank if np.isclose(OWNED_NODE_POSITIONS[:, 1], 0.0).any() else -1)
)
IS_FAILING_RANK = COMM.rank == FAILING_RANK
NODE_NUMBERS_INVALID_ON_FAILING_RANK = np.array([10**6 if IS_FAILING_RANK else 0])

DIFFERENCE_MESSAGE = (
    f"this differs between processes 0 and {FAILING_RANK}, but all of them have to state the same"
)
FAILING_RANK_MESSAGE_PART = f"of which process {FAILING_RANK} has "
INVALID_NUMBER_MESSAGE_PART = (
    f"1000000: local numbers are counted from 0, {FAILING_RANK_MESSAGE_PART}"
)


ERROR_ON_FAILING_RANK = KeyError("x")


def return_or_fail_on_one_rank(value):
    """Return a value, or raise `ERROR_ON_FAILING_RANK` if this process is the one that fails."""
    if IS_FAILING_RANK:
        raise ERROR_ON_FAILING_RANK
    return value


def marker_failing_on_one_rank(x):
    return return_or_fail_on_one_rank(BOTTOM_MARKER(x))


def marker_giving_scalar_on_one_rank(x):
    return BOTTOM_MARKER(x) if not IS_FAILING_RANK else True


def square_mesh(n_rows):
    return triangles(COMM, (0, 0), (1, 1), (4, n_rows))


def solve_block_contact(
    pair=None, loads=LOAD, reduction=BLOCK_ON_FLOOR.no_supports, K=K, **options
):
    return solve_contact(
        K, loads, reduction, pair or BLOCK_ON_FLOOR.floor_pair(0.3), DISPLACEMENT_SPACE, **options
    )


class PlaneWithClosestPointsFailingOnOneRank(Plane):
    """Plane whose method for closest points fails on one process."""

    def gap_normal_and_curvature(self, x):
        return return_or_fail_on_one_rank(super().gap_normal_and_curvature(x))


class FrictionLawFailingOnOneRank:
    """Friction law that fails on one process, in `parameter_at` or after some calls of `limit`."""

    def __init__(self, first="limit", last=0):
        self._first, self._left = first, last

    def parameter_at(self, _):
        return return_or_fail_on_one_rank(0.0) if self._first == "at" else 0.3

    def limit(self, mu, force):
        self._left -= 1
        return (
            return_or_fail_on_one_rank(mu * force) if self._left < 0 else mu * force
        ), mu + 0 * force


class KrylovSolverFailingOnOneRank:
    """Krylov solver that fails on one process after a given number of matrix products."""

    matrix_free, determinant_signs, report = True, (), SolverReport("steepest descent", 0)

    def __init__(self, products, steps=3):
        self._products, self._steps = products, steps

    def prepare(self, *_, **__):
        return self

    def iterate(self, product, precondition, right, _):
        for k in range(self._steps):
            if k == self._products:
                return_or_fail_on_one_rank(0)
            product(precondition(right))
        return 0 * right

    def release(self):
        pass


def solve_plate_contact(solver):
    solid = SolidBlock(n=2, comm=COMM)
    plate = solid.contact_arguments_of_case("plate by forces")
    return solve_contact(*plate, solver=solver)


def solve_residual_step(surface=FLOOR, load=None, conditions=(), **options):
    u, v = fem.Function(DISPLACEMENT_SPACE), ufl.TestFunction(BLOCK_ON_FLOOR.body.spaces.test)
    top_conditions = [prescribe(DISPLACEMENT_SPACE, i, on_plane(1, 2.0)) for i in (0, 1)]
    form = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx
    all_conditions = [*top_conditions, *conditions]
    problem = ContactProblem.of_residual(
        form, u, all_conditions, ContactPair(BOTTOM_MARKER, surface), **options
    )
    return problem.step(problem.undeformed, load, motions=Motion((0, 0.01)))


def raise_singular_matrix(*_):
    raise np.linalg.LinAlgError("singular")


def solve_infeasible_with_failing_proof():
    """Solve a problem without solution, for which the proof of no equilibrium fails.

    Only process 0 computes this proof.
    """
    with patch(
        "pw_elements.contact.rescue.refusals._prove_no_equilibrium_by_motion_groups",
        raise_singular_matrix,
    ):
        return solve_block_contact(loads=BLOCK_ON_FLOOR.press_then_pull_loads(1e3, 1))


class PlaneFailingOnOneRank:
    """Plane one of whose methods fails, or returns a wrong shape, on one process."""

    def __init__(self, fails="", wrong=""):
        self._fails, self._wrong = fails, wrong

    def return_or_fail(self, method_name, values):
        if method_name == self._fails:
            return_or_fail_on_one_rank(values)
        return values[:1] if IS_FAILING_RANK and method_name == self._wrong else values

    def gap(self, x):
        return self.return_or_fail("gap", x[:, 1])

    def normal(self, x):
        return self.return_or_fail("normal", np.tile([0.0, 1.0], (len(x), 1)))


class ObjectWithMeshFailingOnOneRank:
    """Object to be passed instead of a reduction; its attribute `mesh` fails on one process."""

    @property
    def mesh(self):
        return return_or_fail_on_one_rank(None)


def copy_with_nan_on_one_rank(vector):
    vector = vector.copy()
    if IS_FAILING_RANK:
        vector.array[:] = np.nan
    return vector


def stiffness_with_nan_on_one_rank():
    matrix = K.copy()
    if IS_FAILING_RANK:
        row = matrix.getOwnershipRange()[0]
        matrix.setValue(row, row, np.nan)
    matrix.assemble()
    return matrix


def vector_of_ones():
    vector = K.createVecRight()
    vector.set(1.0)
    return vector


def make_contact_problem(block=BLOCK_ON_FLOOR):
    return ContactProblem(block.K, block.no_supports, block.floor_pair(0.3), block.space)


def solve_step(motions):
    return make_contact_problem().step(make_contact_problem().undeformed, LOAD, motions)


def step_from_other_state_on_one_rank():
    problem_here, small_problem = (
        make_contact_problem(),
        make_contact_problem(BlockOnFloor(4, comm=COMM)),
    )
    return problem_here.step((small_problem if IS_FAILING_RANK else problem_here).undeformed, LOAD)


def step_from_state_changed_on_one_rank(**changes_on_failing_rank):
    """Solve an increment from a state whose values are changed on one process."""
    start = make_contact_problem().undeformed
    (pair,) = start.pairs
    wrong_values = {
        name: getattr(pair, name) + (value if IS_FAILING_RANK else 0.0)
        for name, value in changes_on_failing_rank.items()
    }
    return make_contact_problem().step(replace(start, pairs=(replace(pair, **wrong_values),)), LOAD)


def solve_block_impact(duration=1.0, velocity=None, pair=None, **options):
    body = (
        symmetric_part(K),
        diagonal_matrix(K, vector_of_ones()),
        BLOCK_ON_FLOOR.no_supports,
        pair or BLOCK_ON_FLOOR.floor_pair(0.3),
        DISPLACEMENT_SPACE,
    )
    return solve_impact(*body, duration, velocity or vector_of_ones(), **options)


def make_clamped_bottom_reduction():
    return Reduction.dirichlet(
        DISPLACEMENT_SPACE, [prescribe(DISPLACEMENT_SPACE, i, BOTTOM_MARKER) for i in (0, 1)]
    )


def solve_nonlinear(load, **options):
    u = fem.Function(DISPLACEMENT_SPACE)
    F = ufl.inner(ufl.grad(u), ufl.grad(ufl.TestFunction(DISPLACEMENT_SPACE))) * ufl.dx
    PetrovGalerkinProblem(F, u, prescribe(DISPLACEMENT_SPACE, 0, BOTTOM_MARKER), **options).solve(
        load
    )


FAILING_CALLS_WITH_MESSAGES = [
    (
        f"the marker of the prescribed nodes failed on process {FAILING_RANK}: KeyError: 'x'",
        lambda: prescribe(DISPLACEMENT_SPACE, 0, marker_failing_on_one_rank),
    ),
    (
        "the marker of the prescribed nodes gave bool of",
        lambda: prescribe(DISPLACEMENT_SPACE, 0, marker_giving_scalar_on_one_rank),
    ),
    (
        "the marker of the boundary gave bool of the shape ()",
        lambda: boundary_measure(MESH, marker_giving_scalar_on_one_rank),
    ),
    (
        f"facets have the numbers 1000000 to {INVALID_NUMBER_MESSAGE_PART}",
        lambda: boundary_measure(MESH, NODE_NUMBERS_INVALID_ON_FAILING_RANK),
    ),
    (
        "facets are float64 of the shape (1,)",
        lambda: boundary_measure(MESH, np.array([0.0 if IS_FAILING_RANK else 0])),
    ),
    (
        f"facets are a mask of 3: it is one of all, {FAILING_RANK_MESSAGE_PART}",
        lambda: boundary_measure(
            MESH, np.ones(3, dtype=bool) if IS_FAILING_RANK else marker_failing_on_one_rank
        ),
    ),
    (
        f"force: {DIFFERENCE_MESSAGE}",
        lambda: nodal_load(
            DISPLACEMENT_SPACE, BOTTOM_MARKER, (np.nan if IS_FAILING_RANK else 1.0, 0.0)
        ),
    ),
    (
        "the mass matrix has entries that are not",
        lambda: lumped_mass(
            diagonal_matrix(K, copy_with_nan_on_one_rank(vector_of_ones())), DISPLACEMENT_SPACE
        ),
    ),
    (
        f"the nodes to be condensed have the numbers 1000000 to {INVALID_NUMBER_MESSAGE_PART}",
        lambda: Reduction.condensation(K, DISPLACEMENT_SPACE, NODE_NUMBERS_INVALID_ON_FAILING_RANK),
    ),
    (
        "the load is not finite",
        lambda: solve(K, copy_with_nan_on_one_rank(LOAD), make_clamped_bottom_reduction()),
    ),
    (
        "TypeError: the reduction is of the type ObjectWithMeshFailingOnOneRank",
        lambda: solve(K, LOAD, ObjectWithMeshFailingOnOneRank()),
    ),
    (
        f"the nodes of contact pair 0 have the numbers 1000000 to {INVALID_NUMBER_MESSAGE_PART}",
        lambda: solve_block_contact(
            ContactPair([10**6] if IS_FAILING_RANK else BOTTOM_MARKER, FLOOR)
        ),
    ),
    (
        f"pairs: {DIFFERENCE_MESSAGE}",
        lambda: solve_block_contact([BLOCK_ON_FLOOR.floor_pair(0.3)] * (1 + IS_FAILING_RANK)),
    ),
    (
        "the friction of contact pair 0 gave float64 of the shape",
        lambda: solve_block_contact(
            floor_pair(lambda x: x[0] if not IS_FAILING_RANK else x[0, :-1])
        ),
    ),
    (
        f"pairs: {DIFFERENCE_MESSAGE}",
        lambda: solve_block_contact(floor_pair(0.3 + IS_FAILING_RANK)),
    ),
    (
        "the normal of the surface of contact pair 0 gave float64 of the shape (1, 2)",
        lambda: solve_block_contact(floor_pair(surface=PlaneFailingOnOneRank(wrong="normal"))),
    ),
    (
        f"pairs: {DIFFERENCE_MESSAGE}",
        lambda: solve_block_contact(floor_pair(motions=[ZERO_MOTION] * (1 + IS_FAILING_RANK))),
    ),
    (
        "the load of increment 0 is not finite",
        lambda: solve_block_contact(loads=copy_with_nan_on_one_rank(LOAD)),
    ),
    (
        "the stiffness has entries that are not",
        lambda: solve_block_contact(K=stiffness_with_nan_on_one_rank()),
    ),
    (
        f"motions: {DIFFERENCE_MESSAGE}",
        lambda: solve_step([Motion((0, 0.1 if IS_FAILING_RANK else 0.2))]),
    ),
    (f"state: {DIFFERENCE_MESSAGE}", step_from_other_state_on_one_rank),
    (f"state: {DIFFERENCE_MESSAGE}", lambda: step_from_state_changed_on_one_rank(slip=1e-15)),
    (
        f"state: {DIFFERENCE_MESSAGE}",
        lambda: step_from_state_changed_on_one_rank(displacement=np.nan),
    ),
    ("LinAlgError: singular", solve_infeasible_with_failing_proof),
    (
        "FileNotFoundError: the state cannot be written to /nowhere/",
        lambda: make_contact_problem().save(
            make_contact_problem().undeformed, "/nowhere/state.npz"
        ),
    ),
    (
        f"the paths: {DIFFERENCE_MESSAGE}",
        lambda: solve_block_impact(paths=[lambda time: (0, time + IS_FAILING_RANK)]),
    ),
    (
        "the load at the time 0 is not finite",
        lambda: solve_block_impact(load=lambda _: copy_with_nan_on_one_rank(LOAD)),
    ),
]


# Calls with users' functions of all kinds, each of which fails on one process
CALLS_WITH_FAILING_USER_FUNCTION = {
    "marker of nodes": lambda: prescribe(DISPLACEMENT_SPACE, 0, marker_failing_on_one_rank),
    "marker of loaded nodes": lambda: nodal_load(
        DISPLACEMENT_SPACE, marker_failing_on_one_rank, (1.0, 0.0)
    ),
    "marker of facets": lambda: boundary_measure(MESH, marker_failing_on_one_rank),
    "marker of a line": lambda: forces_along(DISPLACEMENT_SPACE, LOAD, marker_failing_on_one_rank),
    "marker of a surface": lambda: SurfaceNodes.from_body(
        BLOCK_ON_FLOOR.body, marker_failing_on_one_rank
    ),
    "marker of a pair": lambda: solve_block_contact(ContactPair(marker_failing_on_one_rank, FLOOR)),
    "image": lambda: move_nodes(square_mesh(4), return_or_fail_on_one_rank),
    "image of a curved mesh": lambda: curved_mesh(square_mesh(4), return_or_fail_on_one_rank),
    "friction": lambda: solve_block_contact(
        floor_pair(lambda x: return_or_fail_on_one_rank(0 * x[0]))
    ),
    "law, of a node": lambda: solve_block_contact(floor_pair(FrictionLawFailingOnOneRank("at"))),
    "law, at once": lambda: solve_block_contact(floor_pair(FrictionLawFailingOnOneRank())),
    "law, later": lambda: solve_block_contact(floor_pair(FrictionLawFailingOnOneRank(last=30))),
    "law, in an impact": lambda: solve_block_impact(
        0.1, 0 * vector_of_ones(), floor_pair(FrictionLawFailingOnOneRank(last=28)), load=LOAD
    ),
    "gap": lambda: solve_block_contact(floor_pair(surface=PlaneFailingOnOneRank(fails="gap"))),
    "normal": lambda: solve_block_contact(
        floor_pair(surface=PlaneFailingOnOneRank(fails="normal"))
    ),
    "closest points": lambda: solve_residual_step(
        PlaneWithClosestPointsFailingOnOneRank((0, 0), (0, 1))
    ),
    "signed distance": lambda: solve_residual_step(
        SignedDistance(lambda x: return_or_fail_on_one_rank(x[:, 1]))
    ),
    "its gradient": lambda: solve_residual_step(
        SignedDistance(lambda x: x[:, 1], lambda x: return_or_fail_on_one_rank(0 * x + [0, 1]))
    ),
    "callback": lambda: solve_block_contact(callback=return_or_fail_on_one_rank),
    "callback of one process": lambda: solve_block_contact(
        callback=return_or_fail_on_one_rank if IS_FAILING_RANK else None
    ),
    "load of a residual": lambda: solve_nonlinear(return_or_fail_on_one_rank),
    "load of a step": lambda: solve_residual_step(load=return_or_fail_on_one_rank),
    "update": lambda: solve_residual_step(update=lambda: return_or_fail_on_one_rank(0)),
    "callback at large strains": lambda: solve_residual_step(callback=return_or_fail_on_one_rank),
    "load of an impact": lambda: solve_block_impact(
        load=lambda _: return_or_fail_on_one_rank(LOAD)
    ),
    "path": lambda: solve_block_impact(paths=[lambda _: return_or_fail_on_one_rank((0, 0))]),
    "iterate, at once": lambda: solve_plate_contact(KrylovSolverFailingOnOneRank(0)),
    "iterate, between products": lambda: solve_plate_contact(KrylovSolverFailingOnOneRank(2)),
    "iterate, at the end": lambda: solve_plate_contact(KrylovSolverFailingOnOneRank(3, 4)),
}
USER_FUNCTION_ERRORS = [KeyboardInterrupt(), KeyError("x"), SystemExit(3), GeneratorExit()]


def collect_unexpected_outcomes(comm, user_errors):
    """Return the scenarios with an unexpected outcome on any process, and all their outcomes."""
    failures = [
        (message, outcomes)
        for message, scenario in FAILING_CALLS_WITH_MESSAGES
        if len(set(outcomes := gather_error_messages(comm, scenario))) > 1
        or not outcomes[0].startswith(message)
    ]
    global ERROR_ON_FAILING_RANK
    for ERROR_ON_FAILING_RANK in user_errors:
        for name, call in CALLS_WITH_FAILING_USER_FUNCTION.items():
            outcomes = gather_error_messages(comm, call)
            message = (
                "KeyError: 'x'"
                if isinstance(ERROR_ON_FAILING_RANK, Exception)
                else repr(ERROR_ON_FAILING_RANK)
            )
            if len(set(outcomes)) > 1 or message not in outcomes[0]:
                failures.append((name, repr(ERROR_ON_FAILING_RANK), outcomes))
    return failures


def gather_error_messages(comm, function):
    """Call a function on all processes, and return each one's error message, or "nothing"."""
    try:
        function()
        outcome = "nothing"
    except Exception as error:
        prefix = "" if type(error) is ValueError else f"{type(error).__name__}: "
        outcome = f"{prefix}{error}"
    except BaseException as error:
        outcome = repr(error)
    return comm.allgather(outcome)


def collect_undetected_argument_changes(comm, max_values_per_argument):
    """Return the calls that raise no common error although an argument differs on one process.

    The second returned value is the number of all calls.
    """
    failures, count = [], 0
    for name, (function, arguments) in make_valid_collective_calls(comm).items():
        for argument, value in arguments.items():
            for altered in islice(yield_altered_values(value), max_values_per_argument):
                changed_arguments = arguments | (
                    {argument: altered} if comm.rank == comm.size - 1 else {}
                )
                outcomes = gather_error_messages(
                    comm, lambda f=function, arguments_here=changed_arguments: f(**arguments_here)
                )
                count += 1
                if len(set(outcomes)) > 1 or outcomes[0] == "nothing":
                    failures.append((name, argument, repr(altered), outcomes))
    return failures, count


def collect_all_failures(comm, user_errors, max_values_per_argument):
    return collect_unexpected_outcomes(comm, user_errors), *collect_undetected_argument_changes(
        comm, max_values_per_argument
    )


@pytest.mark.random
def test_an_error_and_a_different_argument_on_one_process_end_all_with_the_same_words(request):
    processes, errors, max_values = 2, USER_FUNCTION_ERRORS[:1], 1
    if request.config.getoption("--nightly"):
        processes, errors, max_values = 3, USER_FUNCTION_ERRORS, 10
    limit = (1 + len(errors)) * SCENARIOS_TIMEOUT_SECONDS
    for failures, argument_failures, count in run_on_processes(
        processes, collect_all_failures, errors, max_values, limit=limit
    ):
        assert failures == argument_failures == []
        assert count > 200


def test_each_public_function_compares_its_arguments_or_is_listed_as_local():
    """Each public function compares its arguments between processes or is documented as local.

    Dataclasses compare their fields in `__post_init__`, or the arguments of `__init__`.
    """
    text = (ROOT / "docs/how-to/parallel.md").read_text()
    local_names = set(
        re.findall(r"`([\w.]+)`", text.partition("stay local:")[2].partition("\n\n")[0])
    )
    collective_names = set(make_valid_collective_calls(MPI.COMM_SELF))
    assert local_names | collective_names == set(collect_public_callables_by_name())
    assert not local_names & collective_names
    for name, obj in collect_public_callables_by_name().items():
        functions = (
            [obj]
            if not isinstance(obj, type)
            else [obj.__init__, getattr(obj, "__post_init__", None)]
        )
        assert any(hasattr(function, "compares") for function in functions) == (
            name in collective_names
        ), name


def test_only_the_time_series_writer_calls_mpi_abort():
    """Only the module that writes time series calls MPI's Abort.

    If a process fails while the others are inside ADIOS2, they would wait for it forever.
    """
    paths = (ROOT / "pw_elements").rglob("*.py")
    assert [p.name for p in paths if "Abort(" in p.read_text()] == ["time_series.py"]


def argument_comparison_time_over_solution_time(comm):
    """Return the time for digests and their comparison, divided by that for a contact solution."""
    block = BlockOnFloor(80, comm=comm)
    assert block.K.getSize()[0] > 25_600
    durations, open_calls, compute_digest = [], [], guard._compute_digest

    def timed_digest(value):
        if open_calls:
            return compute_digest(value)
        open_calls.append(value)
        start = perf_counter()
        digest = compute_digest(value)
        durations.append(perf_counter() - start)
        open_calls.pop()
        return digest

    with patch.object(guard, "_compute_digest", timed_digest):
        start = perf_counter()
        block.solve(0.3, 60.0, n_pull_increments=2)
        solution_time = perf_counter() - start
    start = perf_counter()
    for _ in range(100):
        comm.Allreduce(np.zeros(3, dtype=int), np.empty(3, dtype=int))
    return (sum(durations) + len(durations) * (perf_counter() - start) / 100) / solution_time


@pytest.mark.random
def test_comparing_arguments_takes_below_one_percent_of_a_solution(request):
    if not request.config.getoption("--nightly"):
        pytest.skip("with --nightly")
    assert max(run_on_processes(2, argument_comparison_time_over_solution_time, limit=600)) < 0.01

"""What fails or differs on one process ends all of them, at once and with the same words."""

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
from tests.library.faces import ROOT, calls, otherwise, public
from tests.parallel import run_on

# Seconds that a list of scenarios may take on a busy machine; a process that waits takes for ever
WAITING = 600

COMM = MPI.COMM_WORLD
BLOCK = BlockOnFloor(8, comm=COMM)
U, K, MESH, LOAD = BLOCK.space, BLOCK.K, BLOCK.body.spaces.mesh, BLOCK.pressure_load
FOOT, FLOOR, STILL = on_plane(1, 0.0), Plane((0, 0), (0, 1)), Motion((0, 0))
# The process where things go wrong: the last one that owns nodes of the floor
OWNED = BLOCK.x[: BLOCK.space.dofmap.index_map.size_local]
WRONG = max(COMM.allgather(COMM.rank if np.isclose(OWNED[:, 1], 0.0).any() else -1))
BAD = COMM.rank == WRONG
NODES = np.array([10**6 if BAD else 0])

DIFFERS = f"this differs between processes 0 and {WRONG}, but all of them have to state the same"
HERE = f"of which process {WRONG} has "
FAR = f"1000000: local numbers are counted from 0, {HERE}"


RAISED = KeyError("x")


def errs(value):
    """What a user's function gives that fails on one process."""
    if BAD:
        raise RAISED
    return value


def errs_below(x):
    return errs(FOOT(x))


def one_value(x):
    return FOOT(x) if not BAD else True


def square(n):
    return triangles(COMM, (0, 0), (1, 1), (4, n))


def contact(pair=None, loads=LOAD, reduction=BLOCK.no_supports, K=K, **options):
    return solve_contact(K, loads, reduction, pair or BLOCK.floor_pair(0.3), U, **options)


class Unreached(Plane):
    """A floor whose closest points fail on one process."""

    def closest(self, x):
        return errs(super().closest(x))


class Law:
    """Friction that fails on one process, when it is first or last asked."""

    def __init__(self, first="limit", last=0):
        self._first, self._left = first, last

    def parameter_at(self, _):
        return errs(0.0) if self._first == "at" else 0.3

    def limit(self, mu, force):
        self._left -= 1
        return (errs(mu * force) if self._left < 0 else mu * force), mu + 0 * force


class Foreign:
    """A Krylov method that fails on one process, after some products."""

    matrix_free, determinant_signs, report = True, (), SolverReport("steepest descent", 0)

    def __init__(self, products, steps=3):
        self._products, self._steps = products, steps

    def prepare(self, *_, **__):
        return self

    def iterate(self, product, precondition, right, _):
        for k in range(self._steps):
            if k == self._products:
                errs(0)
            product(precondition(right))
        return 0 * right

    def release(self):
        pass


def by(solver):
    solid = SolidBlock(n=2, comm=COMM)
    plate = solid.case_arguments("plate by forces")
    return solve_contact(*plate, solver=solver)


def slid(surface=FLOOR, load=None, conditions=(), **options):
    u, v = fem.Function(U), ufl.TestFunction(BLOCK.body.spaces.test)
    top = [prescribe(U, i, on_plane(1, 2.0)) for i in (0, 1)]
    stretched = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx
    held = [*top, *conditions]
    problem = ContactProblem.of_residual(stretched, u, held, ContactPair(FOOT, surface), **options)
    return problem.step(problem.undeformed, load, motions=Motion((0, 0.01)))


def floor(mu=0.3, surface=FLOOR, motions=()):
    return ContactPair(FOOT, surface, mu, motions)


def singular(*_):
    raise np.linalg.LinAlgError("singular")


def dragged_off():
    """What process 0 does by itself where the iteration has failed."""
    with patch("pw_elements.contact.rescue.refusals._combine_proofs", singular):
        return contact(loads=BLOCK.pull_loads(1e3, 1))


class Gap:
    """A surface that fails at a process' points, or answers in a wrong shape."""

    def __init__(self, fails="", wrong=""):
        self._fails, self._wrong = fails, wrong

    def answered(self, name, values):
        if name == self._fails:
            errs(values)
        return values[:1] if BAD and name == self._wrong else values

    def gap(self, x):
        return self.answered("gap", x[:, 1])

    def normal(self, x):
        return self.answered("normal", np.tile([0.0, 1.0], (len(x), 1)))


class Thing:
    """No reduction, and what would tell its processes fails on one."""

    @property
    def mesh(self):
        return errs(None)


def nan_on_one(vector):
    vector = vector.copy()
    if BAD:
        vector.array[:] = np.nan
    return vector


def nan_in_matrix():
    matrix = K.copy()
    if BAD:
        row = matrix.getOwnershipRange()[0]
        matrix.setValue(row, row, np.nan)
    matrix.assemble()
    return matrix


def diagonal(vector):
    matrix = K.duplicate()
    matrix.setDiagonal(vector)
    matrix.assemble()
    return matrix


def ones():
    vector = K.createVecRight()
    vector.set(1.0)
    return vector


def problem(block=BLOCK):
    return ContactProblem(block.K, block.no_supports, block.floor_pair(0.3), block.space)


def step(motions):
    return problem().step(problem().undeformed, LOAD, motions)


def other_state():
    here, small = problem(), problem(BlockOnFloor(4, comm=COMM))
    return here.step((small if BAD else here).undeformed, LOAD)


def step_from(**values):
    """A step from a state that has other values on one process."""
    start = problem().undeformed
    (pair,) = start.pairs
    wrong = {name: getattr(pair, name) + (value if BAD else 0.0) for name, value in values.items()}
    return problem().step(replace(start, pairs=(replace(pair, **wrong),)), LOAD)


def impact(duration=1.0, velocity=None, pair=None, **stated):
    body = symmetric_part(K), diagonal(ones()), BLOCK.no_supports, pair or BLOCK.floor_pair(0.3), U
    return solve_impact(*body, duration, velocity or ones(), **stated)


def held():
    return Reduction.dirichlet(U, [prescribe(U, i, FOOT) for i in (0, 1)])


def stated(load, **options):
    u = fem.Function(U)
    F = ufl.inner(ufl.grad(u), ufl.grad(ufl.TestFunction(U))) * ufl.dx
    PetrovGalerkinProblem(F, u, prescribe(U, 0, FOOT), **options).solve(load)


# fmt: off
SCENARIOS = [
    (f"the marker of the prescribed nodes failed on process {WRONG}: KeyError: 'x'",
     lambda: prescribe(U, 0, errs_below)),
    ("the marker of the prescribed nodes gave bool of", lambda: prescribe(U, 0, one_value)),
    ("the marker of the boundary gave bool of the shape ()",
     lambda: boundary_measure(MESH, one_value)),
    (f"facets have the numbers 1000000 to {FAR}", lambda: boundary_measure(MESH, NODES)),
    ("facets are float64 of the shape (1,)",
     lambda: boundary_measure(MESH, np.array([0.0 if BAD else 0]))),
    (f"facets are a mask of 3: it is one of all, {HERE}",
     lambda: boundary_measure(MESH, np.ones(3, dtype=bool) if BAD else errs_below)),
    (f"force: {DIFFERS}", lambda: nodal_load(U, FOOT, (np.nan if BAD else 1.0, 0.0))),
    ("the mass matrix has entries that are not",
     lambda: lumped_mass(diagonal(nan_on_one(ones())), U)),
    (f"the nodes to be condensed have the numbers 1000000 to {FAR}",
     lambda: Reduction.condensation(K, U, NODES)),
    ("the load is not finite", lambda: solve(K, nan_on_one(LOAD), held())),
    ("TypeError: the reduction is of the type Thing", lambda: solve(K, LOAD, Thing())),
    (f"the nodes of contact pair 0 have the numbers 1000000 to {FAR}",
     lambda: contact(ContactPair([10**6] if BAD else FOOT, FLOOR))),
    (f"pairs: {DIFFERS}", lambda: contact([BLOCK.floor_pair(0.3)] * (1 + BAD))),
    ("the friction of contact pair 0 gave float64 of the shape",
     lambda: contact(floor(lambda x: x[0] if not BAD else x[0, :-1]))),
    (f"pairs: {DIFFERS}", lambda: contact(floor(0.3 + BAD))),
    ("the normal of the surface of contact pair 0 gave float64 of the shape (1, 2)",
     lambda: contact(floor(surface=Gap(wrong="normal")))),
    (f"pairs: {DIFFERS}",
     lambda: contact(floor(motions=[STILL] * (1 + BAD)))),
    ("the load of increment 0 is not finite", lambda: contact(loads=nan_on_one(LOAD))),
    ("the stiffness has entries that are not", lambda: contact(K=nan_in_matrix())),
    (f"motions: {DIFFERS}", lambda: step([Motion((0, 0.1 if BAD else 0.2))])),
    (f"state: {DIFFERS}", other_state),
    (f"state: {DIFFERS}", lambda: step_from(slip=1e-15)),
    (f"state: {DIFFERS}", lambda: step_from(displacement=np.nan)),
    ("LinAlgError: singular", dragged_off),
    ("FileNotFoundError: the state cannot be written to /nowhere/",
     lambda: problem().save(problem().undeformed, "/nowhere/state.npz")),
    (f"the paths: {DIFFERS}", lambda: impact(paths=[lambda time: (0, time + BAD)])),
    ("the load at the time 0 is not finite", lambda: impact(load=lambda _: nan_on_one(LOAD))),
]
# fmt: on


# fmt: off
# Every way in which a user's function is called; on one process it fails
USERS = {
    "marker of nodes": lambda: prescribe(U, 0, errs_below),
    "marker of loaded nodes": lambda: nodal_load(U, errs_below, (1.0, 0.0)),
    "marker of facets": lambda: boundary_measure(MESH, errs_below),
    "marker of a line": lambda: forces_along(U, LOAD, errs_below),
    "marker of a surface": lambda: SurfaceNodes.from_body(BLOCK.body, errs_below),
    "marker of a pair": lambda: contact(ContactPair(errs_below, FLOOR)),
    "image": lambda: move_nodes(square(4), errs),
    "image of a curved mesh": lambda: curved_mesh(square(4), errs),
    "friction": lambda: contact(floor(lambda x: errs(0 * x[0]))),
    "law, of a node": lambda: contact(floor(Law("at"))),
    "law, at once": lambda: contact(floor(Law())),
    "law, later": lambda: contact(floor(Law(last=30))),
    "law, in an impact": lambda: impact(0.1, 0 * ones(), floor(Law(last=28)), load=LOAD),
    "gap": lambda: contact(floor(surface=Gap(fails="gap"))),
    "normal": lambda: contact(floor(surface=Gap(fails="normal"))),
    "closest points": lambda: slid(Unreached((0, 0), (0, 1))),
    "signed distance": lambda: slid(SignedDistance(lambda x: errs(x[:, 1]))),
    "its gradient": lambda: slid(SignedDistance(lambda x: x[:, 1], lambda x: errs(0 * x + [0, 1]))),
    "callback": lambda: contact(callback=errs),
    "callback of one process": lambda: contact(callback=errs if BAD else None),
    "load of a residual": lambda: stated(errs),
    "load of a step": lambda: slid(load=errs),
    "update": lambda: slid(update=lambda: errs(0)),
    "callback at large strains": lambda: slid(callback=errs),
    "load of an impact": lambda: impact(load=lambda _: errs(LOAD)),
    "path": lambda: impact(paths=[lambda _: errs((0, 0))]),
    "iterate, at once": lambda: by(Foreign(0)),
    "iterate, between products": lambda: by(Foreign(2)),
    "iterate, at the end": lambda: by(Foreign(3, 4)),
}
# fmt: on
ERRORS = [KeyboardInterrupt(), KeyError("x"), SystemExit(3), GeneratorExit()]


def said(comm, errors):
    """What all processes say in each scenario that ends otherwise than it should."""
    wrong = [
        (words, each)
        for words, scenario in SCENARIOS
        if len(set(each := gather_outcomes(comm, scenario))) > 1 or not each[0].startswith(words)
    ]
    global RAISED
    for RAISED in errors:
        for name, call in USERS.items():
            each = gather_outcomes(comm, call)
            words = "KeyError: 'x'" if isinstance(RAISED, Exception) else repr(RAISED)
            if len(set(each)) > 1 or words not in each[0]:
                wrong.append((name, repr(RAISED), each))
    return wrong


def gather_outcomes(comm, function):
    try:
        function()
        found = "nothing"
    except Exception as error:
        kind = "" if type(error) is ValueError else f"{type(error).__name__}: "
        found = f"{kind}{error}"
    except BaseException as error:
        found = repr(error)
    return comm.allgather(found)


def differing(comm, most):
    """Calls of public functions that do not end alike if one argument of a process differs."""
    wrong, count = [], 0
    for name, (function, right) in calls(comm).items():
        for argument, value in right.items():
            for other in islice(otherwise(value), most):
                changed = right | ({argument: other} if comm.rank == comm.size - 1 else {})
                each = gather_outcomes(comm, lambda f=function, given=changed: f(**given))
                count += 1
                if len(set(each)) > 1 or each[0] == "nothing":
                    wrong.append((name, argument, repr(other), each))
    return wrong, count


def unlike(comm, errors, most):
    return said(comm, errors), *differing(comm, most)


@pytest.mark.random
def test_an_error_and_a_different_argument_on_one_process_end_all_with_the_same_words(request):
    processes, errors, most = 2, ERRORS[:1], 1
    if request.config.getoption("--nightly"):
        processes, errors, most = 3, ERRORS, 10
    limit = (1 + len(errors)) * WAITING
    for wrong, different, count in run_on(processes, unlike, errors, most, limit=limit):
        assert wrong == different == []
        assert count > 200


def test_each_public_function_compares_its_arguments_or_is_listed_as_local():
    """Dataclasses do it where they are made, in their `__post_init__`."""
    text = (ROOT / "docs/how-to/parallel.md").read_text()
    local = set(re.findall(r"`([\w.]+)`", text.partition("stay local:")[2].partition("\n\n")[0]))
    known = set(calls(MPI.COMM_SELF))
    assert local | known == set(public())
    assert not local & known
    for name, thing in public().items():
        parts = (
            [thing]
            if not isinstance(thing, type)
            else [thing.__init__, getattr(thing, "__post_init__", None)]
        )
        assert any(hasattr(p, "compares") for p in parts) == (name in known), name


def test_only_a_writer_that_others_wait_for_ends_them_all():
    """Within ADIOS2 they would wait for ever for a process that has failed alone."""
    paths = (ROOT / "pw_elements").rglob("*.py")
    assert [p.name for p in paths if "Abort(" in p.read_text()] == ["fields.py"]


def shares(comm):
    """Time of digests and of comparing them, over that of a contact solution."""
    body = BlockOnFloor(80, comm=comm)
    assert body.K.getSize()[0] > 25_600
    spent, within, compare = [], [], guard._digest

    def timed(value):
        if within:
            return compare(value)
        within.append(value)
        begun = perf_counter()
        found = compare(value)
        spent.append(perf_counter() - begun)
        within.pop()
        return found

    with patch.object(guard, "_digest", timed):
        begun = perf_counter()
        body.solve(0.3, 60.0, increments=2)
        whole = perf_counter() - begun
    begun = perf_counter()
    for _ in range(100):
        comm.Allreduce(np.zeros(3, dtype=int), np.empty(3, dtype=int))
    return (sum(spent) + len(spent) * (perf_counter() - begun) / 100) / whole


@pytest.mark.random
def test_comparing_arguments_takes_a_hundredth_at_most(request):
    if not request.config.getoption("--nightly"):
        pytest.skip("with --nightly")
    assert max(run_on(2, shares, limit=600)) < 0.01

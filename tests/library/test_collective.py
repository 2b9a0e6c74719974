"""What fails on one process fails on all of them, at once and with the same words."""

from dataclasses import replace
from unittest.mock import patch

from mpi4py import MPI

import numpy as np
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
from pw_elements.contact import (
    ContactPair,
    ContactProblem,
    Motion,
    Plane,
    solve_contact,
    solve_impact,
)
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import curved, mapped, triangles
from tests.contact.cases import Block, at
from tests.parallel import run_on

COMM = MPI.COMM_WORLD
BLOCK = Block(8, comm=COMM)
U, K, MESH, LOAD = BLOCK.space, BLOCK.K, BLOCK.body.spaces.mesh, BLOCK.pressure
FOOT, FLOOR, STILL = at(1, 0.0), Plane((0, 0), (0, 1)), Motion((0, 0))
# The process where things go wrong: the last one that owns nodes of the floor
OWNED = BLOCK.x[: BLOCK.space.dofmap.index_map.size_local]
WRONG = max(COMM.allgather(COMM.rank if np.isclose(OWNED[:, 1], 0.0).any() else -1))
BAD = COMM.rank == WRONG
NODES = np.array([10**6 if BAD else 0])

FAILED = f"failed on process {WRONG}: KeyError: 'x'"
DIFFERS = f"this differs between processes 0 and {WRONG}, but all of them have to state the same"
HERE = f"of which process {WRONG} has "
FAR = f"1000000: local numbers are counted from 0, {HERE}"


def errs(value):
    """What a user's function gives that fails on one process."""
    if BAD:
        raise KeyError("x")
    return value


def errs_below(x):
    return errs(FOOT(x))


def one_value(x):
    return FOOT(x) if not BAD else True


def square(n):
    return triangles(COMM, (0, 0), (1, 1), (4, n))


def contact(pair=None, loads=LOAD, reduction=BLOCK.free, K=K, **options):
    return solve_contact(K, loads, reduction, pair or BLOCK.pair(0.3), U, **options)


class Unreached(Plane):
    """A floor whose closest points fail on one process."""

    def closest(self, x):
        return errs(super().closest(x))


def slid():
    u, v = fem.Function(U), ufl.TestFunction(BLOCK.body.spaces.test)
    top = [prescribe(U, i, at(1, 2.0)) for i in (0, 1)]
    pair = ContactPair(FOOT, Unreached((0, 0), (0, 1)))
    stretched = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx
    problem = ContactProblem.of_residual(stretched, u, top, pair)
    return problem.step(problem.undeformed, motions=Motion((0, 0.01)))


def floor(mu=0.3, surface=FLOOR, motions=()):
    return ContactPair(FOOT, surface, mu, motions)


def singular(*_):
    raise np.linalg.LinAlgError("singular")


def dragged_off(proved=lambda *_: None, search=singular):
    """What process 0 does by itself where the iteration has failed."""
    with (
        patch("pw_elements.contact.rescue.refusals._proved", proved),
        patch("pw_elements.contact.rescue.condensed._search", search),
    ):
        return contact(loads=BLOCK.pulled(1e3, 1))


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
    return ContactProblem(block.K, block.free, block.pair(0.3), block.space)


def step(motions):
    return problem().step(problem().undeformed, LOAD, motions)


def other_state():
    here, small = problem(), problem(Block(4, comm=COMM))
    return here.step((small if BAD else here).undeformed, LOAD)


def step_from(**values):
    """A step from a state that has other values on one process."""
    start = problem().undeformed
    (pair,) = start.pairs
    wrong = {name: getattr(pair, name) + (value if BAD else 0.0) for name, value in values.items()}
    return problem().step(replace(start, pairs=(replace(pair, **wrong),)), LOAD)


def impact(duration=1.0, **stated):
    unit, pair = diagonal(ones()), BLOCK.pair(0.3)
    return solve_impact(symmetric_part(K), unit, BLOCK.free, pair, U, duration, ones(), **stated)


def held():
    return Reduction.dirichlet(U, [prescribe(U, i, FOOT) for i in (0, 1)])


def stated(load, **options):
    u = fem.Function(U)
    F = ufl.inner(ufl.grad(u), ufl.grad(ufl.TestFunction(U))) * ufl.dx
    PetrovGalerkinProblem(F, u, prescribe(U, 0, FOOT), **options).solve(load)


# fmt: off
SCENARIOS = [
    (f"the marker of the prescribed nodes {FAILED}", lambda: prescribe(U, 0, errs_below)),
    ("the marker of the prescribed nodes gave bool of", lambda: prescribe(U, 0, one_value)),
    ("component 2", lambda: prescribe(U, 2 if BAD else 0, FOOT)),
    (f"the component: {DIFFERS}", lambda: prescribe(U, int(BAD), FOOT)),
    ("the prescribed value = '0'", lambda: prescribe(U, 0, FOOT, "0" if BAD else 0.0)),
    (f"the marker of the boundary {FAILED}", lambda: boundary_measure(MESH, errs_below)),
    ("the marker of the boundary gave bool of the shape ()",
     lambda: boundary_measure(MESH, one_value)),
    (f"facets have the numbers 1000000 to {FAR}", lambda: boundary_measure(MESH, NODES)),
    ("facets are float64 of the shape (1,)",
     lambda: boundary_measure(MESH, np.array([0.0 if BAD else 0]))),
    (f"facets are a mask of 3: it is one of all, {HERE}",
     lambda: boundary_measure(MESH, np.ones(3, dtype=bool) if BAD else errs_below)),
    (f"the marker of the loaded nodes {FAILED}", lambda: nodal_load(U, errs_below, (1.0, 0.0))),
    ("nodal force (nan, 0.0)", lambda: nodal_load(U, FOOT, (np.nan if BAD else 1.0, 0.0))),
    (f"the nodal force: {DIFFERS}", lambda: nodal_load(U, FOOT, (1.0 + BAD, 0.0))),
    ("the mass matrix has entries that are not",
     lambda: lumped_mass(diagonal(nan_on_one(ones())), U)),
    (f"the marker of the line {FAILED}", lambda: forces_along(U, LOAD, errs_below)),
    (f"the marker of the boundary {FAILED}", lambda: SurfaceNodes.of(BLOCK.body, errs_below)),
    ("TypeError: a condition is None", lambda: Reduction.dirichlet(U, [None] if BAD else [])),
    (f"the nodes to be condensed have the numbers 1000000 to {FAR}",
     lambda: Reduction.condensation(K, U, NODES)),
    ("the load is not finite", lambda: solve(K, nan_on_one(LOAD), held())),
    (f"the image of the mesh {FAILED}", lambda: mapped(square(4), errs)),
    (f"the image of the mesh {FAILED}", lambda: curved(square(4), errs)),
    (f"divisions: {DIFFERS}", lambda: square(4 + BAD)),
    (f"the marker of contact pair 0 {FAILED}", lambda: contact(ContactPair(errs_below, FLOOR))),
    (f"the nodes of contact pair 0 have the numbers 1000000 to {FAR}",
     lambda: contact(ContactPair([10**6] if BAD else FOOT, FLOOR))),
    ("TypeError: a contact pair is of the type Plane", lambda: contact([FLOOR] if BAD else None)),
    (f"the number of contact pairs: {DIFFERS}", lambda: contact([BLOCK.pair(0.3)] * (1 + BAD))),
    (f"the friction of contact pair 0 {FAILED}", lambda: contact(floor(lambda x: errs(0 * x[0])))),
    ("the friction of contact pair 0 gave float64 of the shape",
     lambda: contact(floor(lambda x: x[0] if not BAD else x[0, :-1]))),
    (f"the friction of contact pair 0: {DIFFERS}", lambda: contact(floor(0.3 + BAD))),
    (f"the gap of the surface of contact pair 0 {FAILED}",
     lambda: contact(floor(surface=Gap(fails="gap")))),
    (f"the closest points of the surface of contact pair 0 {FAILED}", slid),
    ("the normal of the surface of contact pair 0 gave float64 of the shape (1, 2)",
     lambda: contact(floor(surface=Gap(wrong="normal")))),
    (f"the motions of contact pair 0: {DIFFERS}",
     lambda: contact(floor(motions=[STILL] * (1 + BAD)))),
    ("the load of increment 0 is not finite", lambda: contact(loads=nan_on_one(LOAD))),
    ("TypeError: a load is 0.0", lambda: contact(loads=[0.0] if BAD else LOAD)),
    (f"the number of loads: {DIFFERS}", lambda: contact(loads=[LOAD] * (1 + BAD))),
    ("TypeError: the reduction is Dirichlet conditions",
     lambda: contact(reduction=[] if BAD else BLOCK.free)),
    ("max_iterations = 0", lambda: contact(max_iterations=0 if BAD else 50)),
    (f"max_iterations: {DIFFERS}", lambda: contact(max_iterations=49 if BAD else 50)),
    ("the stiffness has entries that are not", lambda: contact(K=nan_in_matrix())),
    ("TypeError: a state to start from is 0", lambda: contact(start=[0] if BAD else ())),
    ("2 motions for 1 contact pairs", lambda: step([STILL] * (1 + BAD))),
    (f"the motions: {DIFFERS}", lambda: step([Motion((0, 0.1 if BAD else 0.2))])),
    ("the state belongs to other contact nodes than this problem's", other_state),
    (f"the state: {DIFFERS}", lambda: step_from(slip=1e-15)),
    ("the state has forces or displacements that are not", lambda: step_from(displacement=np.nan)),
    ("LinAlgError: singular", lambda: dragged_off(proved=singular)),
    ("LinAlgError: singular", dragged_off),
    ("FileNotFoundError: the state cannot be written to /nowhere/",
     lambda: problem().save(problem().undeformed, "/nowhere/state.npz")),
    (f"the load {FAILED}", lambda: stated(lambda _: errs(0))),
    (f"the load: {DIFFERS}", lambda: stated(fem.Constant(MESH, 1.0 + BAD))),
    ("TypeError: the solver is 3", lambda: stated(None, solver=3 if BAD else None)),
    (f"the path of contact pair 0 {FAILED}", lambda: impact(paths=[lambda _: errs((0, 0))])),
    (f"the paths: {DIFFERS}", lambda: impact(paths=[lambda time: (0, time + BAD)])),
    ("the load at the time 0 is not finite", lambda: impact(load=lambda _: nan_on_one(LOAD))),
    (f"the duration: {DIFFERS}", lambda: impact(duration=1.0 + BAD)),
]
# fmt: on


def said(comm):
    """What all processes say in each scenario that ends otherwise than it should."""
    wrong = []
    for words, scenario in SCENARIOS:
        try:
            scenario()
            found = "nothing"
        except Exception as error:
            kind = "" if type(error) is ValueError else f"{type(error).__name__}: "
            found = f"{kind}{error}"
        each = comm.allgather(found)
        if len(set(each)) > 1 or not found.startswith(words):
            wrong.append((words, each))
    return wrong


def test_an_error_on_one_process_ends_all_with_the_same_words():
    assert run_on(3, said) == [[]] * 3

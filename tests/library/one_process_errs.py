"""Errors on one process only: all processes have to end with the same words, at once.

Started by test_collective.py with `mpirun -n 2` and 3; names of scenarios choose some of them.
Prints, as JSON, the process that errs, and what each process said in each scenario.
"""

import faulthandler
import json
import sys
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
from pw_elements.meshes import curved, mapped, on_lines, triangles
from tests.contact.cases import Block, at

COMM = MPI.COMM_WORLD
# A process that waits for another longer than this waits for ever
PATIENCE = 60

BLOCK = Block(8, comm=COMM)
U, K, MESH, LOAD = BLOCK.space, BLOCK.K, BLOCK.body.spaces.mesh, BLOCK.pressure
FLOOR = Plane((0, 0), (0, 1))
# The process where things go wrong: the last one that owns nodes of the floor
WRONG = max(COMM.allgather(COMM.rank if np.isclose(BLOCK.owned()[:, 1], 0.0).any() else -1))
BAD = COMM.rank == WRONG


def raises(*_):
    raise KeyError("x")


def bottom(x):
    """A marker that fails."""
    return at(1, 0.0)(x) if not BAD else raises()


def scalar(x):
    return at(1, 0.0)(x) if not BAD else True


def contact(pair=None, loads=LOAD, reduction=BLOCK.free, **options):
    return solve_contact(K, loads, reduction, pair or BLOCK.pair(0.3), U, **options)


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
        if BAD and name == self._fails:
            raises()
        return values[:1] if BAD and name == self._wrong else values

    def gap(self, x):
        return self.answered("gap", x[:, 1])

    def normal(self, x):
        return self.answered("normal", np.tile([0.0, 1.0], (len(x), 1)))


def floor(mu=0.3, surface=FLOOR, motions=()):
    return ContactPair(at(1, 0.0), surface, mu, motions)


def mu_fails(x):
    return np.full(x.shape[1], 0.3) if not BAD else raises()


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


def increments_differ():
    return contact(loads=[LOAD] * (2 if BAD else 1))


def condense():
    nodes = np.array([10**6 if BAD else 0])
    return Reduction.condensation(K, U, nodes)


def other_state():
    problem = ContactProblem(K, BLOCK.free, BLOCK.pair(0.3), U)
    small = Block(4, comm=COMM)
    other = ContactProblem(small.K, small.free, small.pair(0.3), small.space).undeformed
    return problem.step(other if BAD else problem.undeformed, LOAD)


def two_motions():
    problem = ContactProblem(K, BLOCK.free, BLOCK.pair(0.3), U)
    return problem.step(problem.undeformed, LOAD, [Motion((0, 0))] * (2 if BAD else 1))


def motions_differ():
    problem = ContactProblem(K, BLOCK.free, BLOCK.pair(0.3), U)
    return problem.step(problem.undeformed, LOAD, [Motion((0, 0.1 if BAD else 0.2))])


def step_from(**values):
    """A step from a state that has other values on one process."""
    problem = ContactProblem(K, BLOCK.free, BLOCK.pair(0.3), U)
    (pair,) = problem.undeformed.pairs
    wrong = {name: getattr(pair, name) + (value if BAD else 0.0) for name, value in values.items()}
    return problem.step(replace(problem.undeformed, pairs=(replace(pair, **wrong),)), LOAD)


def save_nowhere():
    problem = ContactProblem(K, BLOCK.free, BLOCK.pair(0.3), U)
    problem.save(problem.undeformed, "/nowhere/state.npz")


def impact(duration=1.0, **stated):
    ones = K.createVecRight()
    ones.set(1.0)
    unit = K.duplicate()
    unit.setDiagonal(ones)
    unit.assemble()
    return solve_impact(
        symmetric_part(K), unit, BLOCK.free, BLOCK.pair(0.3), U, duration, ones, **stated
    )


def held():
    return Reduction.dirichlet(U, [prescribe(U, i, at(1, 0.0)) for i in (0, 1)])


def scaled(x):
    return 2 * x if not BAD else raises()


def mass_with_nan():
    ones = nan_on_one(K.createVecLeft())
    mass = K.duplicate()
    mass.setDiagonal(ones + 1.0)
    mass.assemble()
    return lumped_mass(mass, U)


def stated(load, **options):
    u = fem.Function(U)
    F = ufl.inner(ufl.grad(u), ufl.grad(ufl.TestFunction(U))) * ufl.dx
    PetrovGalerkinProblem(F, u, prescribe(U, 0, at(1, 0.0)), **options).solve(load)


SCENARIOS = {
    "marker of prescribe": lambda: prescribe(U, 0, bottom),
    "marker of prescribe gives one value": lambda: prescribe(U, 0, scalar),
    "component": lambda: prescribe(U, 2 if BAD else 0, at(1, 0.0)),
    "component differs": lambda: prescribe(U, int(BAD), at(1, 0.0)),
    "value is no number": lambda: prescribe(U, 0, at(1, 0.0), "0" if BAD else 0.0),
    "marker of boundary_measure": lambda: boundary_measure(MESH, bottom),
    "marker of the boundary gives one value": lambda: boundary_measure(MESH, scalar),
    "facet number": lambda: boundary_measure(MESH, np.array([10**6 if BAD else 0])),
    "facet type": lambda: boundary_measure(MESH, np.array([0.0 if BAD else 0])),
    "facet mask": lambda: boundary_measure(MESH, np.ones(3, dtype=bool) if BAD else bottom),
    "marker of nodal_load": lambda: nodal_load(U, bottom, (1.0, 0.0)),
    "nodal force": lambda: nodal_load(U, at(1, 0.0), (np.nan if BAD else 1.0, 0.0)),
    "nodal force differs": lambda: nodal_load(U, at(1, 0.0), (1.0 + BAD, 0.0)),
    "mass": mass_with_nan,
    "marker of forces_along": lambda: forces_along(U, LOAD, bottom),
    "marker of surface nodes": lambda: SurfaceNodes.of(BLOCK.body, bottom),
    "condition": lambda: Reduction.dirichlet(U, [None] if BAD else []),
    "node to be condensed": condense,
    "load of solve": lambda: solve(K, nan_on_one(LOAD), held()),
    "image": lambda: mapped(triangles(COMM, (0, 0), (1, 1), (4, 4)), scaled),
    "image of curved cells": lambda: curved(triangles(COMM, (0, 0), (1, 1), (4, 4)), scaled),
    "divisions differ": lambda: triangles(COMM, (0, 0), (1, 1), (4, 5 if BAD else 4)),
    "mesh lines": lambda: on_lines(COMM, [0, 1], [0, np.nan if BAD else 1.0], "triangle"),
    "marker of a pair": lambda: contact(ContactPair(bottom, FLOOR)),
    "nodes of a pair": lambda: contact(ContactPair([10**6] if BAD else at(1, 0.0), FLOOR)),
    "kind of a pair": lambda: contact(None if not BAD else [FLOOR]),
    "number of pairs": lambda: contact([BLOCK.pair(0.3)] * (1 + BAD)),
    "friction": lambda: contact(floor(mu_fails)),
    "shape of friction": lambda: contact(floor(lambda x: x[0] if not BAD else x[0, :-1])),
    "friction differs": lambda: contact(floor(0.3 + BAD)),
    "gap": lambda: contact(floor(surface=Gap(fails="gap"))),
    "normal": lambda: contact(floor(surface=Gap(wrong="normal"))),
    "motions of pairs": lambda: contact(floor(motions=[Motion((0, 0))] * (1 + BAD))),
    "loads": lambda: contact(loads=nan_on_one(LOAD)),
    "kind of loads": lambda: contact(loads=[0.0] if BAD else LOAD),
    "number of loads": increments_differ,
    "supports": lambda: contact(reduction=[] if BAD else BLOCK.free),
    "max_iterations": lambda: contact(max_iterations=0 if BAD else 50),
    "max_iterations differ": lambda: contact(max_iterations=49 if BAD else 50),
    "stiffness": lambda: solve_contact(nan_in_matrix(), LOAD, BLOCK.free, BLOCK.pair(0.3), U),
    "start": lambda: contact(start=[0] if BAD else ()),
    "motions of a step": two_motions,
    "motions of a step differ": motions_differ,
    "state of a step": other_state,
    "state of a step differs": lambda: step_from(slip=1e-15),
    "state of a step with NaN": lambda: step_from(displacement=np.nan),
    "proof": lambda: dragged_off(proved=singular),
    "search": dragged_off,
    "file": save_nowhere,
    "load of a residual": lambda: stated(lambda _: 0 if not BAD else raises()),
    "load of a residual differs": lambda: stated(fem.Constant(MESH, 1.0 + BAD)),
    "solver of a residual": lambda: stated(None, solver=3 if BAD else None),
    "path of a surface": lambda: impact(paths=[lambda _: (0, 0) if not BAD else raises()]),
    "paths differ": lambda: impact(paths=[lambda time: (0, time + BAD)]),
    "load in time": lambda: impact(load=lambda _: nan_on_one(LOAD)),
    "duration differs": lambda: impact(duration=1.0 + BAD),
}


def said(scenario):
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    try:
        scenario()
        words = "nothing"
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
    each = COMM.gather(words)
    faulthandler.cancel_dump_traceback_later()
    return each


if __name__ == "__main__":
    outcomes = {name: said(SCENARIOS[name]) for name in sys.argv[1:] or SCENARIOS}
    if COMM.rank == 0:
        sys.stdout.write(json.dumps({"wrong": WRONG, "said": outcomes}) + "\n")

"""Histories of eleven increments that are resumed after the sixth.

Started by test_contact_stepping.py with `mpirun`, too: `write FOLDER` stores the states after the
sixth increment, `resume FOLDER` goes on from them; both print the states as JSON.
"""

import json
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np

from pw_elements import Reduction, prescribe
from pw_elements.contact import ContactPair, ContactProblem, Motion, Parabola
from tests.contact.cases import Block, Punch, at
from tests.contact.two_bodies import Stack

RESUMED = 6


def block(comm=MPI.COMM_SELF):
    """Pressed, then pulled to the right, and back to the left."""
    case = Block(20, comm=comm)
    pull = case.load((60.0, 0.0), at(0, 4.0))
    shares = [0, 0.3, 0.6, 0.9, 1.0, 0.6, 0.2, -0.2, -0.6, -0.9, 0.0]
    problem = ContactProblem(case.K, case.free, case.pair(0.3), case.space)
    return problem, [(case.pressure + pull * share,) for share in shares]


def punch(comm=MPI.COMM_SELF):
    """A curved punch: pressed, pushed by forces, drawn by displacements, and released."""
    case = Punch(comm=comm)
    pair = ContactPair(at(1, 4.0), Parabola((0, 4), 8.0), 0.6)
    problem = ContactProblem(case.K, case.foot, pair, case.space)
    motions = [Motion((0, None), (0, -217.3 * k / 3)) for k in (1, 2, 3)]
    motions += [Motion((None, None), (40 * k, -217.3)) for k in (0.5, 1.0, 0.5, 0.0, -0.8)]
    motions += [Motion((-0.05, -0.2)), Motion((-0.1, -0.1)), Motion((0.0, -0.15))]
    nothing = case.K.createVecLeft()
    return problem, [(nothing, [motion]) for motion in motions]


def mortar(comm=MPI.COMM_SELF, element="petrov_galerkin", nu=0.3):
    """A body on another, held by it alone: pressed, then drawn to and fro."""
    stack = Stack((5, 4), element=element, nu=nu, comm=comm)
    held = [prescribe(stack.space, i, at(1, 0.0)) for i in (0, 1)]
    supports = Reduction.dirichlet(stack.space, held)
    problem = ContactProblem(stack.K, supports, stack.pair("upper", 0.3), stack.space)
    shares = [0, 0.1, 0.2, 0.25, 0.1, -0.1, -0.2, -0.25, -0.1, 0.1, 0.0]
    down, along = (stack.load(1e-3 * axis) for axis in np.eye(2)[::-1])
    return problem, [(along * share - down,) for share in shares]


def rubber(comm=MPI.COMM_SELF):
    """The same of incompressible bodies."""
    return mortar(comm, "hybrid", 0.5)


histories = {"mortar": mortar, "rubber": rubber, "block": block, "punch": punch}


def whole(problem, steps, guess=None):
    """All states from the undeformed body on; the first from a guess."""
    states = [
        problem.step(problem.undeformed, *steps[0], *(() if len(steps[0]) > 1 else ((),)), guess)
    ]
    return states + resumed(problem, steps, states[0], 1)


def resumed(problem, steps, state, after=RESUMED):
    """The states that follow one."""
    states = []
    for step in steps[after:]:
        state = problem.step(state, *step)
        states.append(state)
    return states


def fields(state):
    """All numbers of a state, by name."""
    values = {"displacement": state.displacement.array_r}
    for k, pair in enumerate(state.pairs):
        finite = {
            name: np.where(np.isfinite(array), array, 0.0) for name, array in vars(pair).items()
        }
        # meaning nothing but a direction of round-off where hardly a force is
        del finite["direction"], finite["turning"]
        for name in ("node", "faced", "opposite"):  # in the numbering of the processes, too
            del finite[name]
        values |= {f"{name} {k}": array for name, array in finite.items() if array.size}
    return values


if __name__ == "__main__":
    kind, folder = sys.argv[1], Path(sys.argv[2])
    comm = MPI.COMM_WORLD
    numbers = {}
    for name, history in histories.items():
        problem, steps = history(comm)
        path = folder / f"{name}.npz"
        if kind == "write":
            states = whole(problem, steps)
            problem.save(states[RESUMED - 1], path)
        else:
            states = resumed(problem, steps, problem.load(path))
        numbers[name] = [
            {key: array.tolist() for key, array in fields(state).items() if key != "displacement"}
            | {"size": state.displacement.norm()}
            for state in states
        ]
    if comm.rank == 0:
        print(json.dumps(numbers))

"""Histories of seven increments that are resumed after the fourth."""

from mpi4py import MPI

import numpy as np

from pw_elements.contact import Motion
from tests.contact.cases import Block, Punch, at
from tests.contact.two_bodies import Stack

RESUMED = 4


def block(comm=MPI.COMM_SELF):
    """Pressed, then pulled to the right, and back to the left."""
    case = Block(12, comm=comm)
    pull = case.load((60.0, 0.0), at(0, 4.0))
    shares = [0, 0.5, 1.0, 0.3, -0.5, -0.9, 0.0]
    return case.problem(case.pair(0.3)), [(case.pressure + pull * share,) for share in shares]


def punch(comm=MPI.COMM_SELF):
    """A curved punch: pressed, pushed by forces, drawn by displacements, and released."""
    case = Punch(comm=comm)
    motions = [Motion((0, None), (0, -217.3 * share)) for share in (0.5, 1.0)]
    motions += [Motion((None, None), (40 * share, -217.3)) for share in (1.0, -0.5, -0.8)]
    motions += [Motion((-0.1, -0.15)), Motion((0.0, -0.1))]
    return case.problem(case.pair(0.6), case.foot), [(case.nothing, [m]) for m in motions]


def rubber(comm=MPI.COMM_SELF):
    """An incompressible body on another, held by it alone: pressed, then drawn to and fro."""
    stack = Stack((4, 3), element="hybrid", nu=0.5, comm=comm)
    problem = stack.problem(stack.pair("upper", 0.3), stack.clamped(at(1, 0.0)))
    down, along = (stack.load(1e-3 * axis) for axis in np.eye(2)[::-1])
    return problem, [(along * share - down,) for share in (0, 0.15, 0.25, 0.1, -0.1, -0.25, 0.1)]


histories = {"rubber": rubber, "block": block, "punch": punch}


def whole(problem, steps):
    """All states from the undeformed body on."""
    return resumed(problem, steps, problem.undeformed, 0)


def resumed(problem, steps, state, after=RESUMED):
    states = []
    for step in steps[after:]:
        state = problem.step(state, *step)
        states.append(state)
    return states


def fields(state):
    values = {"displacement": state.displacement.array_r}
    # directions mean nothing but round-off where hardly a force is; others are numbered as nodes
    left_out = ("direction", "turning", "node", "faced", "opposite")
    for k, pair in enumerate(state.pairs):
        for name, array in vars(pair).items():
            if name not in left_out and array.size:
                values[f"{name} {k}"] = np.where(np.isfinite(array), array, 0.0)
    return values


def scale_of(name, states):
    """What differences of a field are compared with: the history's largest force or length."""
    kind = name.split()[0]
    if "force" in kind:
        return max(np.abs(fields(state)["force_normal 0"]).max() for state in states)
    if kind in ("displacement", "gap", "slip", "translation"):
        return max(np.abs(fields(state)["displacement"]).max() for state in states)
    return 1.0

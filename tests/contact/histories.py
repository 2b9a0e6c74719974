"""Load histories of seven increments, which tests interrupt and resume after the fourth one."""

from mpi4py import MPI

import numpy as np

from pw_elements.contact import Motion
from tests.contact.cases import BlockOnFloor, PunchedBlock, on_plane
from tests.contact.two_bodies import StackedBlocks

INCREMENTS_BEFORE_RESUME = 4


def make_block_problem_and_steps(comm=MPI.COMM_SELF):
    """Return the problem and step arguments of a block on a plane.

    The block is pressed, pulled to the right, and pulled back.
    """
    case = BlockOnFloor(12, comm=comm)
    pull = case.traction_load((60.0, 0.0), on_plane(0, 4.0))
    load_factors = [0, 0.5, 1.0, 0.3, -0.5, -0.9, 0.0]
    return case.contact_problem(case.floor_pair(0.3)), [
        (case.pressure_load + pull * load_factor,) for load_factor in load_factors
    ]


def make_punch_problem_and_steps(comm=MPI.COMM_SELF):
    """Return the problem and step arguments of a parabolic punch on a block.

    Forces press the punch and push it sideways; then it is moved to two prescribed positions.
    """
    case = PunchedBlock(comm=comm)
    motions = [Motion((0, None), (0, -217.3 * factor)) for factor in (0.5, 1.0)]
    motions += [Motion((None, None), (40 * factor, -217.3)) for factor in (1.0, -0.5, -0.8)]
    motions += [Motion((-0.1, -0.15)), Motion((0.0, -0.1))]
    return case.contact_problem(case.punch_pair(0.6), case.base_supports), [
        (case.zero_load, [m]) for m in motions
    ]


def make_incompressible_blocks_problem_and_steps(comm=MPI.COMM_SELF):
    """Return the problem and step arguments of two stacked incompressible blocks.

    The upper block is pressed on the lower one and pulled back and forth.
    """
    stack = StackedBlocks((4, 3), element="hybrid", nu=0.5, comm=comm)
    problem = stack.contact_problem(
        stack.make_pair("upper", 0.3), stack.make_clamping_supports(on_plane(1, 0.0))
    )
    down, sideways = (stack.traction_load(1e-3 * axis) for axis in np.eye(2)[::-1])
    return problem, [
        (sideways * load_factor - down,) for load_factor in (0, 0.15, 0.25, 0.1, -0.1, -0.25, 0.1)
    ]


HISTORY_MAKERS_BY_NAME = {
    "rubber": make_incompressible_blocks_problem_and_steps,
    "block": make_block_problem_and_steps,
    "punch": make_punch_problem_and_steps,
}


def solve_history(problem, step_arguments):
    """Return all states of a history, beginning with the undeformed body."""
    return resume_history(problem, step_arguments, problem.undeformed, 0)


def resume_history(problem, step_arguments, state, n_done_steps=INCREMENTS_BEFORE_RESUME):
    """Continue a history from a state, and return the states of the remaining increments.

    `state` is the state after the first `n_done_steps` increments.
    """
    states = []
    for step in step_arguments[n_done_steps:]:
        state = problem.step(state, *step)
        states.append(state)
    return states


def collect_comparable_fields(state):
    """Return a state's displacement and the fields of its pairs that do not depend on a partition.

    The fields are keyed by their names and the number of the pair. Values that are not finite are
    replaced by 0.
    """
    values = {"displacement": state.displacement.array_r}
    # directions are round-off where forces vanish; numbers of nodes depend on the partition
    excluded = ("direction", "friction_ratio", "node", "faced_node", "opposite_node")
    for k, pair in enumerate(state.pairs):
        for name, array in vars(pair).items():
            if name not in excluded and array.size:
                values[f"{name} {k}"] = np.where(np.isfinite(array), array, 0.0)
    return values


def largest_force_or_length_in_history(field_name, states):
    """Return the largest force or length in a history, by which a field's differences are scaled.

    The scale is 1 if the field contains neither forces nor lengths.
    """
    kind = field_name.split()[0]
    if "force" in kind:
        return max(
            np.abs(collect_comparable_fields(state)["force_normal 0"]).max() for state in states
        )
    if kind in ("displacement", "gap", "slip", "translation"):
        return max(
            np.abs(collect_comparable_fields(state)["displacement"]).max() for state in states
        )
    return 1.0

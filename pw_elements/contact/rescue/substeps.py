"""Solve an increment in substeps, which are halved after a failure and grow after a success.

The module guarantees that each substep is a solution from which the next one starts. It assumes
that a failed substep does not change the problem.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array
from pw_elements.contact.interface import InvalidContactNodes
from pw_elements.contact.model import ContactFailed, ContactState
from pw_elements.contact.nodes import OPEN
from pw_elements.progress import log_on_root
from pw_elements.solvers import SingularSystem

# Largest ratio of path length to chord for prescribed displacements in one substep; it is the ratio
# for a quarter circle
_MAX_PATH_TO_CHORD_RATIO = np.pi / np.sqrt(8)
# Smallest length of a path that may count as curved, relative to the longest path of any node
_MIN_CURVED_TO_LONGEST_PATH_RATIO = 1e-3
# Bound of the round-off in the binary logarithm of a number of substeps
_ROUND_OFF_OF_LOG2_SUBSTEPS = 1e-9


def solve_in_substeps(
    solve_to_load_factor: Callable[[ContactState, float], ContactState],
    state: ContactState,
    first_size_min_size_and_growth: tuple[float, float, float],
    may_continue: Callable[[], bool] = lambda: True,
) -> tuple[list[tuple[float, ContactState]], tuple[float, Exception] | None]:
    """Solve an increment in substeps, which are halved after a failure and grow after a success.

    Args:
        solve_to_load_factor: function that solves for the state at a fraction of the increment's
            loads and motions, between 0 and 1, starting from a given state.
        state: state at the start of the increment.
        first_size_min_size_and_growth: size of the first substep, which is also the largest size;
            smallest size of a substep; and factor by which substeps grow after a success.
        may_continue: function that returns whether another substep may be tried.

    Returns:
        Fraction and state at the end of each solved substep; and fraction and error of the last
        failure, or None if the last substep has been solved.
    """
    max_size, min_size, growth = first_size_min_size_and_growth
    size = max_size
    fraction, current_state, failure = 0.0, state, None
    substeps: list[tuple[float, ContactState]] = []
    while fraction < 1 and size >= min_size and may_continue():
        next_fraction = min(1.0, fraction + size)
        try:
            current_state = replace(
                solve_to_load_factor(current_state, next_fraction), increment=state.increment + 1
            )
        except (ContactFailed, InvalidContactNodes, SingularSystem) as error:
            words = f"not from {fraction:.4g} to {next_fraction:.4g} of the increment: {error}"
            log_on_root(state.displacement.comm, logging.INFO, words, ".contact")
            size, failure = (next_fraction - fraction) / 2, (next_fraction, error)
            continue
        fraction, size, failure = next_fraction, min(growth * size, max_size), None
        substeps.append((next_fraction, current_state))
    return substeps, failure


def combine_substeps_with_summed_slip(
    substeps: Sequence[tuple[float, ContactState]],
) -> ContactState:
    """Return the state of the last substep, with slips summed over all substeps."""
    end, pairs = substeps[-1][1], []
    for k, pair in enumerate(end.pairs):
        is_closed = (pair.status != OPEN)[:, None]
        slips = {
            name: is_closed
            * np.sum([getattr(substep.pairs[k], name) for _, substep in substeps], axis=0)
            for name in ("slip", "path_slip")
        }
        pairs.append(replace(pair, **slips))
    return replace(end, pairs=tuple(pairs), substates=tuple(substeps[:-1]))


def round_up_to_power_of_two(number: float) -> int:
    """Return the smallest power of two that is at least 1 and not below `number`.

    Round-off in `number` is ignored.
    """
    return 2 ** max(0, int(np.ceil(np.log2(max(number, 1.0)) - _ROUND_OFF_OF_LOG2_SUBSTEPS)))


def count_equal_nearly_straight_segments(node_paths: Array, comm: MPI.Comm) -> int:
    """Return the number of equal segments in which the paths of all nodes are nearly straight.

    In each segment, the path of a node is at most `_MAX_PATH_TO_CHORD_RATIO` times as long as its
    chord. The number of segments is a power of two.

    Args:
        node_paths: displacements (samples + 1, nodes, dim) of the nodes of this process.
        comm: communicator of the mesh.
    """
    step_lengths = np.linalg.norm(np.diff(node_paths, axis=0), axis=2)
    longest_path = comm.allreduce(step_lengths.sum(axis=0).max(initial=0.0), MPI.MAX)
    n_samples = n_segments = len(step_lengths)
    while n_segments > 1:
        segment_size = 2 * n_samples // n_segments
        path_lengths = step_lengths.reshape(
            n_samples // segment_size, segment_size, step_lengths.shape[1]
        ).sum(axis=1)
        distances = np.linalg.norm(
            node_paths[segment_size::segment_size] - node_paths[:-1:segment_size], axis=2
        )
        is_bent = (path_lengths > _MAX_PATH_TO_CHORD_RATIO * distances) & (
            path_lengths > _MIN_CURVED_TO_LONGEST_PATH_RATIO * longest_path
        )
        if comm.allreduce(bool(is_bent.any()), MPI.LOR):
            break
        n_segments //= 2
    return n_segments

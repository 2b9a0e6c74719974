"""An increment in parts, which are halved where they fail and grow again where they succeed."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pw_elements.contact.interface import NoContactStated
from pw_elements.contact.model import ContactFailed, ContactState
from pw_elements.contact.nodes import OPEN
from pw_elements.progress import log_on_root
from pw_elements.solvers import SingularSystem


def solve_in_substeps(
    step: Callable[[ContactState, float], ContactState],
    state: ContactState,
    sizes: tuple[float, float, float],
    may_go_on: Callable[[], bool] = lambda: True,
) -> tuple[list[tuple[float, ContactState]], tuple[float, Exception] | None]:
    """Solve an increment in parts: halved after a failure, larger after a success.

    Args:
        step: solves from a state to a share of the increment.
        state: at its start.
        sizes: the first part's, which is the largest; the smallest one's; the factor after success.
        may_go_on: whether another part may be tried.

    Returns:
        Ends (share, state) of the parts, and where and how the last one failed, or None.
    """
    largest, smallest, growth = sizes
    size = largest
    reached, current, failure = 0.0, state, None
    parts: list[tuple[float, ContactState]] = []
    while reached < 1 and size >= smallest and may_go_on():
        share = min(1.0, reached + size)
        try:
            current = replace(step(current, share), increment=state.increment + 1)
        except (ContactFailed, NoContactStated, SingularSystem) as failed:
            words = f"not from {reached:.4g} to {share:.4g} of the increment: {failed}"
            log_on_root(state.displacement.comm, logging.INFO, words, ".contact")
            size, failure = (share - reached) / 2, (share, failed)
            continue
        reached, size, failure = share, min(growth * size, largest), None
        parts.append((share, current))
    return parts, failure


def combine_substeps(parts: Sequence[tuple[float, ContactState]]) -> ContactState:
    """Return the last part, with the slips of all."""
    last, pairs = parts[-1][1], []
    for k, pair in enumerate(last.pairs):
        closed = (pair.status != OPEN)[:, None]
        slips = {
            name: closed * np.sum([getattr(part.pairs[k], name) for _, part in parts], axis=0)
            for name in ("slip", "path_slip")
        }
        pairs.append(replace(pair, **slips))
    return replace(last, pairs=tuple(pairs), substates=tuple(parts[:-1]))

"""Comparison of the law's slip with that of the path of material points: `PairState.path_slip`."""

import logging

import numpy as np

from pw_elements.arrays import Array
from pw_elements.checks import format_points
from pw_elements.contact.interface import Interface
from pw_elements.contact.model import ContactState, PairState
from pw_elements.contact.nodes import OPEN
from pw_elements.progress import log_on_root

# Largest difference of both slips over the larger one
MAX_DIFFERENCE = 0.1
# What differences do not count below, over the shortest facet around a node that another deformed
# body faces, whose slip is a mean over facets, and over the largest displacement elsewhere
_OF_FACET, _OF_DISPLACEMENT = 0.05, 1e-6


class SlipCheck:
    """Logs a warning where slips of rough nodes differ, once for each pair."""

    def __init__(self, interface: Interface) -> None:
        self._comm, self._warned = interface.comm, set[int]()
        self._facets = {
            k: (mortar.nodes[: mortar.slaves], mortar.measure_facets())
            for k, mortar in interface.mortars.items()
        }

    def check(self, state: ContactState) -> None:
        for k, pair in enumerate(state.pairs):
            apart = measure_slip_difference(pair)
            allowed: Array | float = _OF_DISPLACEMENT * state.scale.length
            if k in self._facets:
                nodes, lengths = self._facets[k]
                allowed = _OF_FACET * lengths[np.searchsorted(nodes, pair.node)]
            sizes = [np.linalg.norm(slip, axis=1) for slip in (pair.slip, pair.path_slip)]
            rough = (pair.status != OPEN) & (pair.friction > 0)
            wrong = rough & (apart > np.maximum(MAX_DIFFERENCE * np.maximum(*sizes), allowed))
            if wrong.any() and k not in self._warned:
                self._warned.add(k)
                words = (
                    f"increment {state.increment - 1}, contact pair {k}: slip differs from that "
                    f"of the path by up to {apart[wrong].max():.3g}, more than "
                    f"{MAX_DIFFERENCE:.0%} of it, at {wrong.sum()} contact nodes first at "
                    f"{format_points(pair.position[wrong])}, where friction may be wrong: make "
                    "smaller increments and compare `PairState.slip` with `path_slip`"
                )
                log_on_root(self._comm, logging.WARNING, words, ".contact")


def measure_slip_difference(pair: PairState) -> Array:
    """Return the size (m,) of the difference of both slips of a pair's nodes."""
    return np.asarray(np.linalg.norm(pair.slip - pair.path_slip, axis=1))

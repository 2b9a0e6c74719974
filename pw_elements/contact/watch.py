"""The watch over an increment: displacements stay small, surfaces stay outside of the body."""

import logging

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from pw_elements.contact.facets import Exterior, Facets
from pw_elements.contact.gradients import Gradients
from pw_elements.contact.interface import Interface
from pw_elements.contact.law import OPEN
from pw_elements.contact.newton import Increment, Iterate
from pw_elements.contact.passage import Passage
from pw_elements.contact.points import RIGID
from pw_elements.contact.state import ContactState, Smallness

# Second-order terms are left out: strains e err by e/2 of themselves, a rotation w turns forces
# by w and makes strains of w^2/2. Half of the way to the next node, a node has another partner.
_LIMITS = Smallness(strain=0.05, rotation=0.05, slip=0.5)

_logger = logging.getLogger("pw_elements.contact")


class Watch:
    """Watches the increments of a body.

    Args:
        interface: its contact points, nodes.
        space: of the displacements.
    """

    def __init__(self, interface: Interface, space: fem.FunctionSpace) -> None:
        exterior = Exterior.of(space)
        facets = Facets.around(interface.node, space, exterior)
        self._interface, self._sizes = interface, facets.sizes()
        self._passage = Passage(interface, space, exterior, facets)
        self._gradients = Gradients(space)

    def before(self, increment: Increment) -> None:
        """Looks at the motions that are prescribed, before anything is solved.

        Raises:
            SurfacePassed: if one of them leads through the body.
        """
        past = increment.past
        known = np.isfinite(increment.prescribed)
        translations = np.where(known, increment.prescribed, past.translations)
        self._passage.check_way(past, translations)

    def after(self, increment: Increment, now: Iterate, before: ContactState) -> Smallness:
        """How small the displacements of a solution are; logs what no longer is, once.

        Raises:
            SurfacePassed: if a rigid surface has gone through the body, or pushes it outwards.
        """
        self._passage.check_way(increment.past, now.translations)
        strain, rotation = self._gradients.largest(self._interface.field.part(now.full))
        self._passage.check(now, strain)
        smallness = Smallness(strain, rotation, self._slip(increment, now))
        if self._interface.comm.rank == 0:
            _warn(smallness, before.smallness, before.increment)
        return smallness

    def _slip(self, increment: Increment, now: Iterate) -> float:
        """Over the size of facets; from the undeformed body on where bodies face each other."""
        interface, contact, past = self._interface, now.contact, increment.past
        moved = now.displacement - now.translations[interface.pair]
        was = past.displacement - past.translations[interface.pair]
        moved = moved - np.where((interface.faced == RIGID)[:, None], was, 0.0)
        slip = np.linalg.norm(np.einsum("nab,nb->na", contact.frame[:, 1:], moved), axis=1)
        closed = contact.active_set().status != OPEN
        largest = np.max(slip / self._sizes, where=closed, initial=0.0)
        return float(interface.comm.allreduce(largest, MPI.MAX))


def _warn(smallness: Smallness, before: Smallness, increment: int) -> None:
    """Logs what has left the range of small displacements in an increment, counted from 0."""
    left = [
        f"largest {name} {value:.3g} (above {limit:g})"
        for name, value in vars(smallness).items()
        if value > (limit := getattr(_LIMITS, name)) >= getattr(before, name)
    ]
    if left:
        _logger.warning(
            "increment %d leaves the range of small displacements: %s", increment, ", ".join(left)
        )

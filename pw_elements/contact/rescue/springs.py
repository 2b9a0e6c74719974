"""Springs that hold the contact points, where the active-set iteration has failed.

From each point, and from each surface that is free to move, a spring goes to where it was found
last. So nothing is loose, tangents are regular, and stiff springs leave points to themselves: the
iteration then ends. Ends follow what is found, and springs get softer (the method of proximal
points: R. T. Rockafellar, 1976, https://doi.org/10.1137/0314056, whose proof does not cover
friction); where it fails they get stiffer again. Sooner or later an active set stays, whatever the
springs; it starts the ordinary iteration, which alone decides what is a solution.
"""

import logging
from collections.abc import Callable
from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from pw_elements.arrays import Array
from pw_elements.contact.iteration import ActiveSet, Increment, Iterate, Place, Policy, newton, same
from pw_elements.contact.model import ContactFailed, NotUnique
from pw_elements.progress import told
from pw_elements.solvers import SingularSystem

# Stiffness of the first and of the softest springs, over the points' own
_FIRST, _SOFTEST = 1e-2, 1e-13
# How much softer they get where a state is found, and stiffer where none is
_SOFTER, _STIFFER = 30.0, 5.0
# After a failure the factor of softening is raised to this power, but stays above the least
_SLOWER, _LEAST = 0.7, 2.0
_FAILURES = 20
# Iterations with springs, and without
_MOST = 25
_CONFIRMED = 12
_LOOSE = (
    "the loads are balanced without any contact force, and the body is loose: it can be where "
    "nothing touches it, in many places; a support, or a load that presses it against something, "
    "makes it one"
)


class Sprung(Protocol):
    """Makes an increment with springs."""

    def __call__(self, share: float, unknowns: PETSc.Vec, translations: Array) -> Increment:
        """With springs of a share of the points' stiffness.

        They end where all unknowns (n,) and the surfaces' translations (pairs, dim) are given.
        """


def by_springs(
    increment: Increment,
    sprung: Sprung,
    active: ActiveSet,
    place: Place,
    unknowns: PETSc.Vec,
    policy: Callable[[], Policy],
    most: int,
    left: Callable[[], float],
) -> Iterate | None:
    """The solution of an increment, or None; it starts at a place, from all unknowns (n,) there.

    It goes on as long as linear systems are `left` to be solved, `most` in one iteration. Raises
    NotUnique where tangents are singular at a solution.
    """

    def at_most(some: int) -> int:
        return int(max(1, min(some, most, left())))

    comm, translations = increment.interface.comm, place.translations
    share, softer, failures, known = _FIRST, _SOFTER, 0, None
    words = f"by springs, for what {left():.0f} linear systems take at most"
    told(comm, logging.INFO, words, ".contact")
    while share > _SOFTEST and failures < _FAILURES and left() > 0:
        held = sprung(share, unknowns, translations)
        free = Policy(lambda *_: [], increment.interface)
        try:
            found = newton(held, active, place, free, at_most(_MOST))
        except ContactFailed as failed:
            told(comm, logging.INFO, f"not with springs of {share:.0e}: {failed}", ".contact")
            failures, softer = failures + 1, max(_LEAST, softer**_SLOWER)
            share *= _STIFFER
            continue
        unknowns, translations = found.full, found.translations
        place = increment.kinematics(translations, found.displacement, found.force)
        now = increment.seen(found.reduced, translations, place)
        violation = increment.violation(now)
        if increment.nearest is None or violation < increment.nearest[1]:
            increment.nearest = now, violation
        active = found.contact.at_rest
        if violation <= 1 or (known is not None and same(known, active, comm)):
            try:
                solution = newton(increment, active, place, policy(), at_most(_CONFIRMED))
                told(comm, logging.INFO, f"solved by springs of {share:.0e}", ".contact")
                return solution
            except ContactFailed as failed:
                told(comm, logging.INFO, f"not from springs of {share:.0e}: {failed}", ".contact")
                if violation <= 1:
                    if isinstance(failed.__cause__, SingularSystem):
                        force = comm.allreduce(np.abs(now.force).max(initial=0.0), MPI.MAX)
                        loose = force <= increment.round_off(now)
                        raise NotUnique(_LOOSE if loose else f"at a solution, {failed}") from failed
                    return now  # which the iteration leaves by round-off
        known, share = active, share / softer
    return None

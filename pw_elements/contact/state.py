"""Results of a contact computation, the same on every process."""

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.contact.law import OPEN, Contact
from pw_elements.contact.pairs import ContactNodes
from pw_elements.recovery import by_position

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PairState:
    """One pair at the end of one increment; its m nodes in the order of their positions.

    Args:
        position: (m, dim), undeformed, sorted by the first coordinate, then the next.
        normal: (m, dim), from the rigid surface into the body.
        force_normal: (m,), nodal force along the normal; compression is positive.
        force_tangential: (m, dim), the rest of the nodal force of the surface on the body.
        gap: (m,), infinite for nodes that nothing faces.
        slip: (m, dim), tangential displacement relative to the surface in this increment;
            zero for open nodes.
        friction: (m,), Coulomb's mu.
        status: (m,), OPEN, STICK or SLIP.
        translation: (dim,) of the surface from its initial place.
        force: (dim,), total force of the surface on the body; in axisymmetry sums round the
            axis, so that the radial one is no resultant.
    """

    position: Array
    normal: Array
    force_normal: Array
    force_tangential: Array
    gap: Array
    slip: Array
    friction: Array
    status: npt.NDArray[np.int8]
    translation: Array
    force: Array


@dataclass(frozen=True)
class Residuals:
    """How well each condition holds, largest value over all nodes.

    Forces over the largest nodal contact force, lengths over the largest displacement of a
    contact node or its surface; a contact without any force or displacement but round-off is
    measured in its own units.

    Args:
        equilibrium: unbalanced force of nodes that are not in contact.
        penetration: -g where it is positive.
        tension: -r_n where it is positive.
        complementarity: smaller of r_n and g.
        cone: |r_t| - mu r_n where it is positive.
        stick: slip of nodes whose friction is not used up.
        direction: |v| r_t + mu r_n v of slipping nodes.
        balance: total force against the one prescribed for free translations.
    """

    equilibrium: float
    penetration: float
    tension: float
    complementarity: float
    cone: float
    stick: float
    direction: float
    balance: float

    def largest(self) -> float:
        """The worst of them."""
        return max(vars(self).values())


@dataclass(frozen=True)
class ContactState:
    """The body at the end of one increment.

    Args:
        displacement: full vector (n,) in the trial space's numbering.
        pairs: one state per contact pair.
        iterations: linear systems solved.
        unique: False if determinants of tangents factorised so far have different signs.
            Then the friction is so large that several states can be in equilibrium with the
            same loads; another start or smaller increments may lead to another one.
        residuals: of all conditions.
    """

    displacement: PETSc.Vec
    pairs: tuple[PairState, ...]
    iterations: int
    unique: bool
    residuals: Residuals


def pair_states(
    nodes: ContactNodes,
    contact: Contact,
    status: npt.NDArray[np.int8],
    force: Array,
    translations: Array,
) -> tuple[PairState, ...]:
    """Gathers the contact nodes of all processes, sorted by position."""
    normal, tangents = contact.frame[:, 0], contact.frame[:, 1:]
    slip = np.einsum("nab,na->nb", tangents, contact.slip)
    slip[status == OPEN] = 0.0
    friction = np.einsum("nab,na->nb", tangents, contact.force[:, 1:])
    states = []
    for k in range(len(nodes.pairs)):
        mine = nodes.pair == k
        position = nodes.gathered(nodes.position[mine])
        order = by_position(position)
        columns = (normal, contact.force[:, 0], friction, contact.gap, slip)
        n, r_n, r_t, gap, v = (nodes.gathered(values[mine])[order] for values in columns)
        states.append(
            PairState(
                position[order],
                n,
                r_n,
                r_t,
                gap,
                v,
                nodes.gathered(nodes.friction[mine])[order],
                nodes.gathered(status[mine])[order],
                translations[k].copy(),
                nodes.gathered(force[mine]).sum(axis=0),
            )
        )
    return tuple(states)

"""Proof, by statics alone, that no contact forces balance the loads."""

from pw_elements.contact.errors import NoEquilibrium
from pw_elements.contact.kinematics import Kinematics
from pw_elements.contact.newton import Increment
from pw_elements.contact.statics import RigidMotions


def no_equilibrium(
    increment: Increment, place: Kinematics, rigid: RigidMotions
) -> NoEquilibrium | None:
    """The refusal with its proof, if there is one.

    Args:
        increment: whose iteration has failed.
        place: kinematics at its start.
        rigid: motions of the body's pieces and of free surfaces.
    """
    return None

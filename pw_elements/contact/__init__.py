"""Unilateral contact with Coulomb friction between an elastic body and rigid surfaces."""

from pw_elements.contact.errors import (
    ContactNotConverged,
    DegenerateMesh,
    FreeBody,
    NotUnique,
)
from pw_elements.contact.law import OPEN, SLIP, STICK
from pw_elements.contact.pairs import ContactPair, Motion
from pw_elements.contact.solver import solve_contact
from pw_elements.contact.state import ContactState, PairState, Residuals
from pw_elements.contact.surfaces import (
    FlatPunch,
    Parabola,
    Plane,
    Polyline,
    SignedDistance,
    Sphere,
    Surface,
)

__all__ = [
    "OPEN",
    "SLIP",
    "STICK",
    "ContactNotConverged",
    "ContactPair",
    "ContactState",
    "DegenerateMesh",
    "FlatPunch",
    "FreeBody",
    "Motion",
    "NotUnique",
    "PairState",
    "Parabola",
    "Plane",
    "Polyline",
    "Residuals",
    "SignedDistance",
    "Sphere",
    "Surface",
    "solve_contact",
]

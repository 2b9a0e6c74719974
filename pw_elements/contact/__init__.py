"""Unilateral contact with Coulomb friction: an elastic body and rigid surfaces, or two bodies.

A block is pressed on a rough floor, then a punch is pushed into its top by a force of 40:

    floor = ContactPair(lambda x: np.isclose(x[1], 0), Plane((0, 0), (0, 1)), friction=0.3)
    punch = ContactPair(
        lambda x: np.isclose(x[1], 2),
        Parabola((2, 2), radius=8),
        friction=0.3,
        motions=[Motion((0, 0)), Motion((0, None), force=(0, -40))],
    )
    states = solve_contact(K, [pressed, pressed], supports, [floor, punch], U)
    below, above = states[-1].pairs
    below.position, below.force_normal, below.force_tangential, below.status
    above.translation, above.force, states[-1].iterations, states[-1].residuals
    write("punch.bp", states, body)  # for ParaView
    plot(states[-1], body, pair=1)

A body that is thrown at a floor, by explicit dynamics:

    history = solve_impact(K, lumped, supports, floor, U, duration=1.0, velocity=thrown, frames=50)
    write("thrown.bp", history.frames, body, history.frame_times)
"""

from pw_elements._compat import renamed
from pw_elements.contact.errors import (
    ClosedBranch,
    ContactFailed,
    DegenerateMesh,
    FreeBody,
    MissingForce,
    NoEquilibrium,
    NoSolution,
    NotFound,
    NotUnique,
    RigidVelocity,
    SurfacePassed,
)
from pw_elements.contact.explicit import solve_impact
from pw_elements.contact.fields import ContactFields
from pw_elements.contact.history import solve_contact
from pw_elements.contact.impact_history import Energies, ImpactHistory, PairHistory
from pw_elements.contact.law import OPEN, SLIP, STICK
from pw_elements.contact.pairs import ContactPair, DeformableSurface, MatchingNodes, Motion
from pw_elements.contact.pictures import draw_surface, plot
from pw_elements.contact.polyline import Polyline
from pw_elements.contact.problem import ContactProblem
from pw_elements.contact.progress import Progress
from pw_elements.contact.series import write
from pw_elements.contact.state import ContactState, PairState, Residuals, Smallness
from pw_elements.contact.surfaces import (
    FlatPunch,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    Surface,
)

__all__ = [
    "OPEN",
    "SLIP",
    "STICK",
    "ClosedBranch",
    "ContactFailed",
    "ContactFields",
    "ContactPair",
    "ContactProblem",
    "ContactState",
    "DeformableSurface",
    "DegenerateMesh",
    "Energies",
    "FlatPunch",
    "FreeBody",
    "ImpactHistory",
    "MatchingNodes",
    "MissingForce",
    "Motion",
    "NoEquilibrium",
    "NoSolution",
    "NotFound",
    "NotUnique",
    "PairHistory",
    "PairState",
    "Parabola",
    "Plane",
    "Polyline",
    "Progress",
    "Residuals",
    "RigidVelocity",
    "SignedDistance",
    "Smallness",
    "Sphere",
    "Surface",
    "SurfacePassed",
    "draw_surface",
    "plot",
    "solve_contact",
    "solve_impact",
    "write",
]

__getattr__ = renamed(__name__, {"ContactNotConverged": ("NotFound", NotFound)})

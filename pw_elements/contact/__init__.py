"""Unilateral contact with friction between a body and rigid surfaces, or between two bodies.

A block is pressed onto a floor with friction; then a punch is pushed into its top by a force of 40:

    floor = ContactPair(lambda x: np.isclose(x[1], 0), Plane((0, 0), (0, 1)), friction=0.3)
    punch = ContactPair(
        lambda x: np.isclose(x[1], 2),
        Parabola((2, 2), radius=8),
        friction=0.3,
        motions=[Motion((0, 0)), Motion((0, None), force=(0, -40))],
    )
    states = solve_contact(K, [pressed, pressed], supports, [floor, punch], U)
    on_floor, under_punch = states[-1].pairs
    on_floor.position, on_floor.force_normal, on_floor.force_tangential, on_floor.status
    under_punch.translation, under_punch.force, states[-1].iterations, states[-1].residuals
    write("punch.bp", states, body)  # for ParaView
    plot(states[-1], body, pair=1)

Large strains and large sliding of a body that is defined by its residual F:

    problem = ContactProblem.of_residual(F, u, conditions, ContactPair(top, Sphere((0, 1), 1.0)))
    pressed = problem.step(problem.undeformed, motions=Motion((0, -0.25)))

Impact of a body on a floor, by explicit dynamics:

    history = solve_impact(K, lumped, supports, floor, U, duration=1.0, velocity=thrown, frames=50)
    write("thrown.bp", history.frames, body, history.frame_times)
"""

from pw_elements.contact.model import (
    ContactFailed,
    ContactPair,
    DeformableSurface,
    FlatPunch,
    FreeBody,
    Motion,
    NoEquilibrium,
    NotUnique,
    Parabola,
    Plane,
    SignedDistance,
    SolutionNotFound,
    Sphere,
    SurfacePassed,
)
from pw_elements.contact.model.friction import Coulomb
from pw_elements.contact.nodes import HELD, OPEN, SLIP, STICK
from pw_elements.contact.output import ContactFields, plot, write
from pw_elements.contact.steps import (
    ContactProblem,
    solve_contact,
    solve_for_values,
    solve_impact,
)

__all__ = [
    "HELD",
    "OPEN",
    "SLIP",
    "STICK",
    "ContactFailed",
    "ContactFields",
    "ContactPair",
    "ContactProblem",
    "Coulomb",
    "DeformableSurface",
    "FlatPunch",
    "FreeBody",
    "Motion",
    "NoEquilibrium",
    "NotUnique",
    "Parabola",
    "Plane",
    "SignedDistance",
    "SolutionNotFound",
    "Sphere",
    "SurfacePassed",
    "plot",
    "solve_contact",
    "solve_for_values",
    "solve_impact",
    "write",
]
